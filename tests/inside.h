/* inside.h: what tests see of the inside of a table. Of all tests only inside.c has the library's
 * private names; the others ask it, and are linked to the library as its users are.
 */
#ifndef INSIDE_H
#define INSIDE_H

#include "../envsamp.h"

#include <string.h>

/* ---- fields ---- */

/* Where the header of a table has a field, in bytes, and the 32 bits that it holds. */
#define KD_AT(field)        inside_kd_at(#field)
#define CDF_AT(field)       inside_cdf_at(#field)
#define KD_WORD(kd, field)  inside_word(kd, KD_AT(field))
#define CDF_WORD(cdf, field) inside_word(cdf, CDF_AT(field))
#define CDF_PLACE(cdf, field) inside_place(cdf, CDF_AT(field))      /* of 64 bits */

/* Where a tile or a block has its edges, and behind them its link: a density, of blocks. */
#define KD_RECORD_AT(number) (KD_AT(end) + 20 * (size_t)(number))

extern size_t inside_kd_at(const char *field);      /* "end": the size of the header */
extern size_t inside_cdf_at(const char *field);
extern uint32_t inside_word(const void *table, size_t at);
extern size_t inside_place(const void *table, size_t at);

/* Makes the checksum of a damaged table right; where the header claims more bytes than there are it
   becomes 0. */
extern void inside_seal(void *table, size_t bytes);

/* ---- blocks of WARP, read from the table ---- */

#define KD_LINK 0x80000000u     /* top bit of a link that is no density */
#define KD_DEEPEST 32           /* cuts below a tile */

/* A block, or a part of a tile on the way to one: its place in the unit square in units of 2^-24,
   its edges as stored, x0, x1, y0, y1, and the link that leads to it. */
typedef struct kd_warp_block {
    double low[2], high[2];
    float edge[4];
    uint32_t link;
    int tile, depth, number;    /* that of the block, or of the first in it */
} kd_warp_block;

static inline float kd_density(const kd_warp_block *block)
{
    float pdf;

    memcpy(&pdf, &block->link, sizeof pdf);
    return pdf;
}

extern int kd_tile_count(const envsamp_kd *kd);

/* Where the cuts below the tiles begin, in bytes. A link to one is its place in words. */
extern size_t inside_kd_cuts(const envsamp_kd *kd);

/* A tile, on the way to its blocks. */
extern kd_warp_block kd_tile(const envsamp_kd *kd, int tile);

/* All blocks, by their numbers. Returns how many; `room` at most, and no tree deeper than
   the limit is walked to its end. */
extern int kd_warp_blocks(const envsamp_kd *kd, kd_warp_block *blocks, int room);

/* The block that draws (u0, u1), each in [0, 1). */
extern kd_warp_block kd_warp_at(const envsamp_kd *kd, double u0, double u1);

/* ---- light x cosine ---- */

/* A part of the unit square that a node of `facing` names: from low to high as light alone draws
   it, from `start` on and `size` wide in the numbers that come in, by weights that are computed in
   double. Its share of them is size[0] size[1]. */
typedef struct inside_part {
    double low[2], high[2], start[2], size[2];
    double weight;              /* of light x cosine, where the whole map's light is 1 */
    uint32_t link;              /* stored: 1 over its area, or another node */
    int depth;                  /* cuts above it */
} inside_part;

/* Parts for a normal of length 1, of which those without KD_LINK fill the unit square. `plain`: a
   level of cuts, from 0, whose sides have the shares of light alone, or -1. Returns how many;
   `room` at most. */
extern int inside_facing(const envsamp_kd *kd, const double normal[3], int plain,
                         inside_part *parts, int room);

/* ---- ALIAS ---- */

/* x0, x1, y0, y1 of a block as stored: ALIAS and FIT. */
extern void inside_kd_edges(const envsamp_kd *kd, int block, float edge[4]);

extern int inside_alias_block(const envsamp_kd *kd, float u0, float u1);

/* ---- cdf ---- */

typedef struct inside_texel { uint32_t column, row; } inside_texel;

/* Where rows, and the columns of a row, begin among 2^24 numbers, and where the last ends. */
extern const uint32_t *inside_row_edges(const envsamp_cdf *cdf);
extern const uint32_t *inside_edges(const envsamp_cdf *cdf, uint32_t row);

/* The upper edge of a row as a kd table has it. */
extern float inside_row_edge(const envsamp_cdf *cdf, uint32_t row);

/* The texel that is drawn, the one that a direction lies in, and the density of one. */
extern inside_texel inside_draw(const envsamp_cdf *cdf, float u0, float u1);
extern inside_texel inside_find(const envsamp_cdf *cdf, const float dir[3]);
extern float inside_texel_pdf(const envsamp_cdf *cdf, uint32_t column, uint32_t row);

/* The guided search of a row's edges, with the guide of another row. */
extern uint32_t inside_search(const envsamp_cdf *cdf, uint32_t row, uint32_t guide, uint32_t draw);

/* ---- small math ---- */

extern void inside_sincos_pi(double x, double *sine, double *cosine);
extern double inside_log2(double x);
extern double inside_exp2(double x);
extern float inside_exp2m1(double x);
extern void inside_cos_sin_turn(float u, float *cosine, float *sine);
extern float inside_turn(float y, float x);
extern float inside_polar_fraction(float north, float south);
extern double inside_random(uint32_t seed, uint32_t index);

/* ---- mappings ---- */

/* As sampling has them, faster than the public functions. */
extern void inside_octahedral_dir(const float uv[2], float dir[3]);
extern void inside_octahedral_uv(const float dir[3], float uv[2]);

extern void inside_wrap(envsamp_mapping mapping, int width, int height, int *x, int *y);

/* ---- what a map brings about on small machines, or hardly ever ---- */

/* What a _sizes function says of so many bytes. */
extern envsamp_result inside_set_sizes(envsamp_sizes *sizes, uint64_t table, uint64_t scratch);

#endif
