/* baselines.c: see baselines.h. */
#define _GNU_SOURCE     /* sincosf, where there is one */

#include "baselines.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PI_F      3.14159265358979f
#define PI_D      3.14159265358979323846
#define BELOW_ONE 0.99999994f   /* the largest float below 1 */

/* ---- shared: lat-long geometry and importance ---- */

/* One instruction, where fminf is a call into libm for the sake of NaN. */
static float smaller(float a, float b)
{
    return a < b ? a : b;
}

/* gcc makes one call of the two by itself; clang does not while errno is kept. */
static void sine_cosine(float angle, float *sine, float *cosine)
{
#if defined(__GLIBC__)
    sincosf(angle, sine, cosine);
#else
    *sine = sinf(angle);
    *cosine = cosf(angle);
#endif
}

static baseline_sample sample_at(float u, float v, float density)
{
    float sin_phi, cos_phi, sin_theta, cos_theta;
    baseline_sample sample;

    sine_cosine(2.0f * PI_F * u, &sin_phi, &cos_phi);
    sine_cosine(PI_F * v, &sin_theta, &cos_theta);
    sample.dir[0] = cos_phi * sin_theta;
    sample.dir[1] = sin_phi * sin_theta;
    sample.dir[2] = cos_theta;
    sample.pdf = sin_theta > 0.0f ? density / (2.0f * PI_F * PI_F * sin_theta) : 0.0f;
    sample.uv[0] = u;
    sample.uv[1] = v;
    return sample;
}

static int clamp_index(float position, int count)
{
    int index = (int)position;

    return index < count ? index : count - 1;
}

static float pdf_at(const float *density, int width, int height, const float dir[3])
{
    float z = dir[2] < -1.0f ? -1.0f : smaller(dir[2], 1.0f);
    float sin_theta = sqrtf(dir[0] * dir[0] + dir[1] * dir[1]);
    float u = atan2f(dir[1], dir[0]) * (0.5f / PI_F), v = acosf(z) * (1.0f / PI_F);
    int x, y;

    if (sin_theta <= 0.0f)
        return 0.0f;
    x = clamp_index((u < 0.0f ? u + 1.0f : u) * (float)width, width);
    y = clamp_index(v * (float)height, height);
    return density[(size_t)y * (size_t)width + (size_t)x] / (2.0f * PI_F * PI_F * sin_theta);
}

static float luminance(const float *rgb)
{
    return 0.2126f * rgb[0] + 0.7152f * rgb[1] + 0.0722f * rgb[2];
}

/* Writes the importance of a row and returns its sum. */
static double row_importance(const float *rgb, int width, int height, int row, float *importance)
{
    float weight = (float)sin(PI_D * (row + 0.5) / height);
    const float *pixel = rgb + (size_t)row * (size_t)width * 3;
    double sum = 0.0;
    int x;

    for (x = 0; x < width; x++, pixel += 3) {
        importance[x] = luminance(pixel) * weight;
        sum += (double)importance[x];
    }
    return sum;
}

/* Importance of every texel into `importance`, of every row into `row_sums`; the total. */
static double map_importance(const float *rgb, int width, int height, float *importance,
                             double *row_sums)
{
    double total = 0.0;
    int y;

    for (y = 0; y < height; y++) {
        float *row = importance + (size_t)y * (size_t)width;

        row_sums[y] = row_importance(rgb, width, height, y, row);
        total += row_sums[y];
    }
    return total;
}

/* Importance becomes density over the unit square. */
static void scale(float *values, size_t count, double factor)
{
    float f = (float)factor;
    size_t i;

    for (i = 0; i < count; i++)
        values[i] *= f;
}

static size_t texel_count(int width, int height)
{
    return (size_t)width * (size_t)height;
}

/* ---- inversion ---- */

/* A CDF of `count` + 1 entries; uniform where all values are zero. */
static void make_cdf(const float *values, int count, double sum, float *cdf)
{
    double running = 0.0, inverse = sum > 0.0 ? 1.0 / sum : 0.0;
    int i;

    cdf[0] = 0.0f;
    for (i = 0; i < count; i++) {
        running += (double)values[i];
        cdf[i + 1] = (float)(sum > 0.0 ? running * inverse : (i + 1.0) / count);
    }
    cdf[count] = 1.0f;
}

static int cdf_fill(const float *rgb, baseline_cdf *cdf, float *row_values, double *row_sums)
{
    int width = cdf->width, height = cdf->height, y;
    double total = map_importance(rgb, width, height, cdf->density, row_sums);

    if (!(total > 0.0))
        return 0;
    for (y = 0; y < height; y++) {
        make_cdf(cdf->density + texel_count(width, y), width, row_sums[y],
                 cdf->conditional + texel_count(width + 1, y));
        row_values[y] = (float)row_sums[y];
    }
    make_cdf(row_values, height, total, cdf->marginal);
    scale(cdf->density, texel_count(width, height), (double)width * height / total);
    return 1;
}

int baseline_cdf_create(const float *rgb, int width, int height, baseline_cdf *cdf)
{
    double *row_sums = malloc((size_t)height * sizeof *row_sums);
    float *row_values = malloc((size_t)height * sizeof *row_values);
    int made;

    cdf->width = width;
    cdf->height = height;
    cdf->marginal = malloc(((size_t)height + 1) * sizeof(float));
    cdf->conditional = malloc(texel_count(width + 1, height) * sizeof(float));
    cdf->density = malloc(texel_count(width, height) * sizeof(float));
    made = row_sums && row_values && cdf->marginal && cdf->conditional && cdf->density
        && cdf_fill(rgb, cdf, row_values, row_sums);
    free(row_sums);
    free(row_values);
    if (!made)
        baseline_cdf_destroy(cdf);
    return made;
}

void baseline_cdf_destroy(baseline_cdf *cdf)
{
    free(cdf->marginal);
    free(cdf->conditional);
    free(cdf->density);
    memset(cdf, 0, sizeof *cdf);
}

size_t baseline_cdf_bytes(const baseline_cdf *cdf)
{
    size_t floats = (size_t)cdf->height + 1 + texel_count(cdf->width + 1, cdf->height)
        + texel_count(cdf->width, cdf->height);

    return floats * sizeof(float);
}

/* The last i in [0, count) with cdf[i] <= u; and where u lies between it and the next. With
   branches on purpose: a guessed one lets the next read start early, and where reads miss the
   cache that is faster than a search by conditional moves. */
static int invert_cdf(const float *cdf, int count, float u, float *fraction)
{
    int low = 1, high = count, first;
    float width;

    while (low < high) {
        int middle = (int)(((unsigned)low + (unsigned)high) >> 1);

        if (cdf[middle] <= u)
            low = middle + 1;
        else
            high = middle;
    }
    first = low - 1;
    width = cdf[first + 1] - cdf[first];
    *fraction = width > 0.0f ? (u - cdf[first]) / width : 0.0f;
    return first;
}

static size_t cdf_invert(const baseline_cdf *cdf, float u0, float u1, float uv[2])
{
    float fraction_x, fraction_y;
    int y = invert_cdf(cdf->marginal, cdf->height, u1, &fraction_y);
    int x = invert_cdf(cdf->conditional + texel_count(cdf->width + 1, y), cdf->width, u0,
                       &fraction_x);

    uv[0] = smaller(((float)x + fraction_x) / (float)cdf->width, BELOW_ONE);
    uv[1] = smaller(((float)y + fraction_y) / (float)cdf->height, BELOW_ONE);
    return texel_count(cdf->width, y) + (size_t)x;
}

baseline_sample baseline_cdf_sample(const baseline_cdf *cdf, float u0, float u1)
{
    float uv[2];
    size_t texel = cdf_invert(cdf, u0, u1, uv);

    return sample_at(uv[0], uv[1], cdf->density[texel]);
}

void baseline_cdf_sample_uv(const baseline_cdf *cdf, float u0, float u1, float uv[2])
{
    cdf_invert(cdf, u0, u1, uv);
}

float baseline_cdf_pdf(const baseline_cdf *cdf, const float dir[3])
{
    return pdf_at(cdf->density, cdf->width, cdf->height, dir);
}

/* ---- alias tables ---- */

/* Room to build a table of `count` entries: a scaled weight and a place in a worklist each. */
typedef struct alias_scratch {
    double *weight;
    uint32_t *list;         /* entries below 1 from the front, the others from the back */
} alias_scratch;

static int alias_scratch_create(size_t count, alias_scratch *scratch)
{
    scratch->weight = malloc(count * sizeof *scratch->weight);
    scratch->list = malloc(count * sizeof *scratch->list);
    return scratch->weight && scratch->list;
}

static void alias_scratch_destroy(alias_scratch *scratch)
{
    free(scratch->weight);
    free(scratch->list);
}

/* scratch->weight holds the weights, of any scale; consumed. */
static void make_alias(size_t count, double sum, alias_scratch *scratch,
                       baseline_alias_entry *entries)
{
    double *weight = scratch->weight, factor = sum > 0.0 ? (double)count / sum : 0.0;
    uint32_t *list = scratch->list;
    size_t small = 0, large = count, i;

    for (i = 0; i < count; i++) {
        weight[i] = sum > 0.0 ? weight[i] * factor : 1.0;
        entries[i].threshold = 1.0f;
        entries[i].alias = (uint32_t)i;
        if (weight[i] < 1.0)
            list[small++] = (uint32_t)i;
        else
            list[--large] = (uint32_t)i;
    }
    while (small > 0 && large < count) {
        uint32_t low = list[--small], high = list[large];

        entries[low].threshold = (float)weight[low];
        entries[low].alias = high;
        weight[high] -= 1.0 - weight[low];
        if (weight[high] < 1.0) {
            large++;
            list[small++] = high;
        }
    }
    /* Round-off alone leaves entries behind: they keep the threshold 1. */
}

/* The entry that u in [0,1) picks; what is left of u, again in [0,1), goes to `rest`. */
static uint32_t pick_alias(const baseline_alias_entry *entries, uint32_t count, float u,
                           float *rest)
{
    float position = u * (float)count, left, threshold;
    uint32_t index = (uint32_t)position;

    if (index >= count)
        index = count - 1;
    left = smaller(position - (float)index, BELOW_ONE);
    threshold = entries[index].threshold;
    if (left < threshold) {
        *rest = smaller(left / threshold, BELOW_ONE);
        return index;
    }
    *rest = smaller((left - threshold) / (1.0f - threshold), BELOW_ONE);
    return entries[index].alias;
}

static void copy_weights(const float *values, size_t count, double *weights)
{
    size_t i;

    for (i = 0; i < count; i++)
        weights[i] = (double)values[i];
}

static int texel_alias_fill(const float *rgb, baseline_texel_alias *table,
                            alias_scratch *scratch, double *row_sums)
{
    size_t count = texel_count(table->width, table->height);
    double total = map_importance(rgb, table->width, table->height, table->density, row_sums);

    if (!(total > 0.0))
        return 0;
    copy_weights(table->density, count, scratch->weight);
    make_alias(count, total, scratch, table->entries);
    scale(table->density, count, (double)count / total);
    return 1;
}

int baseline_texel_alias_create(const float *rgb, int width, int height,
                                baseline_texel_alias *table)
{
    size_t count = texel_count(width, height);
    double *row_sums = malloc((size_t)height * sizeof *row_sums);
    alias_scratch scratch;
    int made = alias_scratch_create(count, &scratch);

    table->width = width;
    table->height = height;
    table->entries = malloc(count * sizeof *table->entries);
    table->density = malloc(count * sizeof *table->density);
    made = made && row_sums && table->entries && table->density
        && texel_alias_fill(rgb, table, &scratch, row_sums);
    alias_scratch_destroy(&scratch);
    free(row_sums);
    if (!made)
        baseline_texel_alias_destroy(table);
    return made;
}

void baseline_texel_alias_destroy(baseline_texel_alias *table)
{
    free(table->entries);
    free(table->density);
    memset(table, 0, sizeof *table);
}

size_t baseline_texel_alias_bytes(const baseline_texel_alias *table)
{
    return texel_count(table->width, table->height)
        * (sizeof *table->entries + sizeof *table->density);
}

baseline_sample baseline_texel_alias_sample(const baseline_texel_alias *table, float u0,
                                            float u1)
{
    uint32_t width = (uint32_t)table->width, height = (uint32_t)table->height;
    float rest;
    uint32_t texel = pick_alias(table->entries, width * height, u0, &rest);
    uint32_t y = texel / width, x = texel - y * width;
    float u = smaller(((float)x + rest) / (float)width, BELOW_ONE);
    float v = smaller(((float)y + u1) / (float)height, BELOW_ONE);

    return sample_at(u, v, table->density[texel]);
}

float baseline_texel_alias_pdf(const baseline_texel_alias *table, const float dir[3])
{
    return pdf_at(table->density, table->width, table->height, dir);
}

static int row_alias_fill(const float *rgb, baseline_row_alias *table, alias_scratch *scratch,
                          double *row_sums)
{
    int width = table->width, height = table->height, y;
    double total = map_importance(rgb, width, height, table->density, row_sums);

    if (!(total > 0.0))
        return 0;
    for (y = 0; y < height; y++) {
        copy_weights(table->density + texel_count(width, y), (size_t)width, scratch->weight);
        make_alias((size_t)width, row_sums[y], scratch,
                   table->conditional + texel_count(width, y));
    }
    memcpy(scratch->weight, row_sums, (size_t)height * sizeof *row_sums);
    make_alias((size_t)height, total, scratch, table->marginal);
    scale(table->density, texel_count(width, height), (double)width * height / total);
    return 1;
}

int baseline_row_alias_create(const float *rgb, int width, int height,
                              baseline_row_alias *table)
{
    double *row_sums = malloc((size_t)height * sizeof *row_sums);
    alias_scratch scratch;
    int made = alias_scratch_create((size_t)(width > height ? width : height), &scratch);

    table->width = width;
    table->height = height;
    table->marginal = malloc((size_t)height * sizeof *table->marginal);
    table->conditional = malloc(texel_count(width, height) * sizeof *table->conditional);
    table->density = malloc(texel_count(width, height) * sizeof *table->density);
    made = made && row_sums && table->marginal && table->conditional && table->density
        && row_alias_fill(rgb, table, &scratch, row_sums);
    alias_scratch_destroy(&scratch);
    free(row_sums);
    if (!made)
        baseline_row_alias_destroy(table);
    return made;
}

void baseline_row_alias_destroy(baseline_row_alias *table)
{
    free(table->marginal);
    free(table->conditional);
    free(table->density);
    memset(table, 0, sizeof *table);
}

size_t baseline_row_alias_bytes(const baseline_row_alias *table)
{
    return (size_t)table->height * sizeof *table->marginal
        + texel_count(table->width, table->height)
        * (sizeof *table->conditional + sizeof *table->density);
}

baseline_sample baseline_row_alias_sample(const baseline_row_alias *table, float u0, float u1)
{
    uint32_t width = (uint32_t)table->width, height = (uint32_t)table->height;
    float rest_x, rest_y, u, v;
    uint32_t y = pick_alias(table->marginal, height, u1, &rest_y);
    size_t row = (size_t)y * width;
    uint32_t x = pick_alias(table->conditional + row, width, u0, &rest_x);

    u = smaller(((float)x + rest_x) / (float)width, BELOW_ONE);
    v = smaller(((float)y + rest_y) / (float)height, BELOW_ONE);
    return sample_at(u, v, table->density[row + x]);
}

float baseline_row_alias_pdf(const baseline_row_alias *table, const float dir[3])
{
    return pdf_at(table->density, table->width, table->height, dir);
}

/* ---- the yardstick ---- */

void baseline_row_weights(int width, int height, float *row_weights)
{
    double scale_sr = 4.0 * PI_D / width * sin(0.5 * PI_D / height);
    int y;

    for (y = 0; y < height; y++)
        row_weights[y] = (float)(scale_sr * sin(PI_D * (y + 0.5) / height));
}

void baseline_luminance_pass(const float *rgb, int width, int height, const float *row_weights,
                             float *importance)
{
    int x, y;

    for (y = 0; y < height; y++) {
        float weight = row_weights[y];

        for (x = 0; x < width; x++, rgb += 3)
            *importance++ = luminance(rgb) * weight;
    }
}
