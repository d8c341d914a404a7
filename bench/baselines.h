/* baselines.h: what the library is compared with, each as a careful renderer writes it.
 *
 * Every baseline is made from a packed RGB float lat-long image, takes luminance x sin(theta)
 * of a texel's centre as its importance, and finds direction and pdf with libm. Tables are on
 * the heap; they are float, the sums they are made from double. u is azimuth / 2 pi, v is
 * polar angle / pi, both in [0,1). A sample that falls on a pole exactly has pdf 0.
 */
#ifndef BASELINES_H
#define BASELINES_H

#include <stddef.h>
#include <stdint.h>

typedef struct baseline_sample {
    float dir[3];
    float pdf;              /* per steradian */
    float uv[2];
} baseline_sample;

/* The ceiling: nothing but the two numbers that every sampler starts from. */
static inline baseline_sample baseline_random_only(float u0, float u1)
{
    baseline_sample sample = { { 0.0f, 0.0f, 0.0f }, 1.0f, { 0.0f, 0.0f } };

    sample.uv[0] = u0;
    sample.uv[1] = u1;
    return sample;
}

/* ---- inversion: marginal and conditional CDF, binary search in both ---- */

typedef struct baseline_cdf {
    int width, height;
    float *marginal;        /* height + 1, ascending from 0 to 1 */
    float *conditional;     /* height rows of width + 1 */
    float *density;         /* height rows of width: pdf over the unit square */
} baseline_cdf;

/* The _create functions return nonzero, or zero where memory is short or the map is black;
   nothing is then left to destroy. */
int    baseline_cdf_create(const float *rgb, int width, int height, baseline_cdf *cdf);
void   baseline_cdf_destroy(baseline_cdf *cdf);
size_t baseline_cdf_bytes(const baseline_cdf *cdf);
baseline_sample baseline_cdf_sample(const baseline_cdf *cdf, float u0, float u1);
void   baseline_cdf_sample_uv(const baseline_cdf *cdf, float u0, float u1, float uv[2]);
float  baseline_cdf_pdf(const baseline_cdf *cdf, const float dir[3]);

/* ---- alias tables [Vose 1991] ---- */

typedef struct baseline_alias_entry {
    float threshold;        /* below it the entry itself, else its alias */
    uint32_t alias;
} baseline_alias_entry;

/* One table over all texels: u0 picks the texel and what is left of it is the position across,
   so that 2^21 texels leave it 3 bits; u1 is the position down. */
typedef struct baseline_texel_alias {
    int width, height;
    baseline_alias_entry *entries;
    float *density;
} baseline_texel_alias;

int    baseline_texel_alias_create(const float *rgb, int width, int height,
                                   baseline_texel_alias *table);
void   baseline_texel_alias_destroy(baseline_texel_alias *table);
size_t baseline_texel_alias_bytes(const baseline_texel_alias *table);
baseline_sample baseline_texel_alias_sample(const baseline_texel_alias *table, float u0,
                                            float u1);
float  baseline_texel_alias_pdf(const baseline_texel_alias *table, const float dir[3]);

/* One table over rows, picked by u1, and one per row over its columns, picked by u0. */
typedef struct baseline_row_alias {
    int width, height;
    baseline_alias_entry *marginal;     /* height */
    baseline_alias_entry *conditional;  /* height rows of width */
    float *density;
} baseline_row_alias;

int    baseline_row_alias_create(const float *rgb, int width, int height,
                                 baseline_row_alias *table);
void   baseline_row_alias_destroy(baseline_row_alias *table);
size_t baseline_row_alias_bytes(const baseline_row_alias *table);
baseline_sample baseline_row_alias_sample(const baseline_row_alias *table, float u0, float u1);
float  baseline_row_alias_pdf(const baseline_row_alias *table, const float dir[3]);

/* ---- the yardstick of build times: every pixel read once, its importance written ---- */

/* row_weights: solid angle in sr of a texel of each of the `height` rows. */
void baseline_row_weights(int width, int height, float *row_weights);
void baseline_luminance_pass(const float *rgb, int width, int height, const float *row_weights,
                             float *importance);

#endif
