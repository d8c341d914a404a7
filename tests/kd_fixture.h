/* kd_fixture.h: kd tables for tests, in buffers of exactly the size asked for, between canaries.
 *
 *     kd_fixture f;
 *     if (kd_fixture_build(&f, &map, &desc)) ... f.kd, f.info ...
 *     kd_fixture_free(&f);
 */
#ifndef KD_FIXTURE_H
#define KD_FIXTURE_H

#include "inside.h"
#include "../examples/common/random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define KD_CANARY 64            /* bytes on either side, a multiple of ENVSAMP_ALIGN */
#define KD_CANARY_BYTE 0xa5
#define KD_PI 3.14159265358979323846

/* A buffer with canaries, filled with rubbish. */
typedef struct kd_guarded { unsigned char *block; envsamp_buffer buffer; } kd_guarded;

static inline void *kd_allocate(size_t bytes)
{
    void *block = calloc(bytes ? bytes : 1, 1);

    if (!block) {
        printf("Bail out! out of memory\n");
        exit(1);
    }
    return block;
}

static inline kd_guarded kd_guarded_make(size_t bytes, int rubbish)
{
    kd_guarded guarded;

    guarded.block = (unsigned char *)kd_allocate(bytes + 2 * KD_CANARY);
    memset(guarded.block, KD_CANARY_BYTE, bytes + 2 * KD_CANARY);
    memset(guarded.block + KD_CANARY, rubbish, bytes);
    guarded.buffer.data = guarded.block + KD_CANARY;
    guarded.buffer.bytes = bytes;
    return guarded;
}

/* Whether nothing was written outside of the buffer. */
static inline int kd_guarded_intact(const kd_guarded *guarded)
{
    const unsigned char *end = guarded->block + KD_CANARY + guarded->buffer.bytes;
    int i, intact = 1;

    for (i = 0; i < KD_CANARY; i++)
        intact &= guarded->block[i] == KD_CANARY_BYTE && end[i] == KD_CANARY_BYTE;
    return intact;
}

typedef struct kd_fixture {
    envsamp_image image;
    envsamp_kd_desc desc;
    envsamp_sizes sizes;
    kd_guarded table, scratch;
    envsamp_result result;
    const envsamp_kd *kd;
    envsamp_kd_info info;
} kd_fixture;

/* For maps that are constant over a texel, which all references here take them for. */
static inline envsamp_kd_desc kd_desc(int blocks, envsamp_kd_select select)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();

    desc.block_count = blocks;
    desc.select = select;
    desc.nearest = 1;
    return desc;
}

static inline envsamp_image kd_image(const float *pixels, int width, int height, int channels)
{
    envsamp_image map;

    memset(&map, 0, sizeof map);
    map.pixels = pixels;
    map.width = width;
    map.height = height;
    map.channels = channels;
    map.mapping = ENVSAMP_LATLONG;
    return map;
}

/* Whether the table was built; f->result says why not. Free the fixture in either case. */
static inline int kd_fixture_build(kd_fixture *f, const envsamp_image *map,
                                   const envsamp_kd_desc *desc)
{
    memset(f, 0, sizeof *f);
    f->image = *map;
    f->desc = *desc;
    f->result = envsamp_kd_sizes(map, desc, &f->sizes);
    f->table = kd_guarded_make(f->sizes.table_bytes, 0x3c);
    f->scratch = kd_guarded_make(f->sizes.scratch_bytes, 0xc3);
    if (f->result == ENVSAMP_OK)
        f->result = envsamp_kd_build(map, desc, f->table.buffer, f->scratch.buffer, &f->kd);
    if (f->result == ENVSAMP_OK)
        envsamp_kd_get_info(f->kd, &f->info);
    return f->result == ENVSAMP_OK;
}

static inline int kd_fixture_intact(const kd_fixture *f)
{
    return kd_guarded_intact(&f->table) && kd_guarded_intact(&f->scratch);
}

static inline void kd_fixture_free(kd_fixture *f)
{
    free(f->table.block);
    free(f->scratch.block);
    memset(f, 0, sizeof *f);
}

/* Draw i of the 2^24 that a table of ALIAS tells apart: the bits of u0 that choose a bin lead. */
static inline void kd_alias_draw(const envsamp_kd *kd, int i, float u[2])
{
    const int bits = 12 - (int)KD_WORD(kd, alias_shift) / 2;

    u[0] = (float)(i >> (24 - bits)) / (float)(1 << bits);
    u[1] = (float)(i & ((1 << (24 - bits)) - 1)) / (float)(1 << (24 - bits));
}

/* ---- what a table should hold, from the map alone ---- */

/* Solid angle of texels [x0, x1) x [y0, y1), by the plain formula in the widest type. */
static inline double kd_solid_angle(int width, int height, int x0, int y0, int x1, int y1)
{
    const long double pi = 3.14159265358979323846264338327950288L;
    const long double top = pi * (long double)y0 / (long double)height;
    const long double end = pi * (long double)y1 / (long double)height;

    return (double)(2.0L * pi * (long double)(x1 - x0) / (long double)width
                    * (cosl(top) - cosl(end)));
}

/* Luminance of a texel, in double; NaN and infinity make it black, negative channels are 0. */
static inline double kd_texel(const envsamp_image *map, int x, int y)
{
    const double weights[3] = { 0.2126, 0.7152, 0.0722 };
    const size_t stride = map->row_stride_bytes ? map->row_stride_bytes / sizeof(float)
                                                : (size_t)map->width * (size_t)map->channels;
    const float *pixel = map->pixels + (size_t)y * stride + (size_t)x * (size_t)map->channels;
    double sum = 0.0;
    int c;

    for (c = 0; c < 3; c++) {
        const double value = (double)pixel[map->channels == 1 ? 0 : c];

        if (isnan(value) || isinf(value))
            return 0.0;
        sum += weights[c] * (value > 0.0 ? value : 0.0);
    }
    return sum;
}

/* A block: where it lies, in texels and in the map, and how often it is drawn. A fraction of a row
   of texels is one of its solid angle. */
typedef struct kd_rect {
    double x0, y0, x1, y1;
    double u0, v0, u1, v1;
    double solid_angle, probability;
} kd_rect;

/* From the north pole, 1 - cos theta, of the upper edge of a row. */
static inline double kd_cap(int row, int height)
{
    const long double pi = 3.14159265358979323846264338327950288L;
    const long double sine = sinl(pi * (long double)row / (2.0L * (long double)height));

    return (double)(2.0L * sine * sine);
}

/* A stored edge in azimuth, in texels; one that rounds to a texel's edge is there. */
static inline double kd_edge_x(float edge, int width)
{
    const double x = (double)edge * (double)width, whole = floor(x + 0.5);

    return (float)(whole / (double)width) == edge ? whole : x;
}

/* A stored edge in polar angle, v by the way. */
static inline double kd_edge_y(float edge, int height, double *v)
{
    const double cap = fabs((double)edge), at = 2.0 / KD_PI * asin(sqrt(0.5 * cap));
    const int near = (int)(at * (double)height + 0.5);
    double y = (double)near;

    if ((float)kd_cap(near, height) != (float)cap) {
        int row = (int)(at * (double)height);

        row += kd_cap(row + 1, height) <= cap;
        row -= kd_cap(row, height) > cap;
        y = (double)row + (cap - kd_cap(row, height))
                        / (kd_cap(row + 1, height) - kd_cap(row, height));
    }
    *v = signbit(edge) ? 1.0 - at : at;
    return signbit(edge) ? (double)height - y : y;
}

/* 1 - cos theta from one stored edge to another, without cancellation. */
static inline double kd_cap_between(float y0, float y1)
{
    const double near0 = fabs((double)y0), near1 = fabs((double)y1);

    if ((signbit(y0) != 0) == (signbit(y1) != 0))
        return signbit(y0) ? near0 - near1 : near1 - near0;
    return (1.0 - near0) + (1.0 - near1);
}

/* Where a block lies by its stored edges: what samples of it really fill. */
static inline kd_rect kd_edges_rect(const kd_fixture *f, const float edge[4], double probability)
{
    kd_rect rect;

    rect.u0 = (double)edge[0];
    rect.u1 = (double)edge[1];
    rect.x0 = kd_edge_x(edge[0], f->image.width);
    rect.x1 = kd_edge_x(edge[1], f->image.width);
    rect.y0 = kd_edge_y(edge[2], f->image.height, &rect.v0);
    rect.y1 = kd_edge_y(edge[3], f->image.height, &rect.v1);
    rect.solid_angle = 2.0 * KD_PI * (rect.u1 - rect.u0) * kd_cap_between(edge[2], edge[3]);
    rect.probability = probability;
    return rect;
}

static inline kd_rect kd_warp_rect(const kd_fixture *f, const kd_warp_block *b)
{
    return kd_edges_rect(f, b->edge,
                         ldexp((b->high[0] - b->low[0]) * (b->high[1] - b->low[1]), -48));
}

/* Block of ALIAS and FIT. */
static inline kd_rect kd_listed_rect(const kd_fixture *f, int index)
{
    envsamp_kd_block block;
    float edge[4];

    memset(&block, 0, sizeof block);
    envsamp_kd_get_block(f->kd, index, &block);
    inside_kd_edges(f->kd, index, edge);
    return kd_edges_rect(f, edge, (double)block.probability);
}

/* Whether a block has the stored edges of whole texels. */
static inline int kd_rect_whole(const kd_rect *r)
{
    return !(r->x0 > floor(r->x0) || r->x1 > floor(r->x1) || r->y0 > floor(r->y0)
             || r->y1 > floor(r->y1));
}

/* ---- all blocks, and the parts of texels that they hold ---- */

typedef struct kd_piece { int block; double share; } kd_piece;

/* Texel t has the pieces first[t] to first[t + 1] - 1. */
typedef struct kd_cover {
    int width, height, count;
    int whole;                  /* blocks must be of whole texels: ALIAS and FIT, not bilinear */
    kd_rect *rects;             /* in the order of the table */
    int *first;
    kd_piece *pieces;
} kd_cover;

static inline kd_rect *kd_rects(const kd_fixture *f)
{
    const int count = f->info.block_count;
    kd_rect *rects = (kd_rect *)kd_allocate((size_t)count * sizeof *rects);
    kd_warp_block *blocks;
    int i;

    for (i = 0; f->desc.select != ENVSAMP_KD_WARP && i < count; i++)
        rects[i] = kd_listed_rect(f, i);
    if (f->desc.select == ENVSAMP_KD_WARP) {
        blocks = (kd_warp_block *)kd_allocate((size_t)count * sizeof *blocks);
        kd_warp_blocks(f->kd, blocks, count);
        for (i = 0; i < count; i++)
            rects[i] = kd_warp_rect(f, &blocks[i]);
        free(blocks);
    }
    return rects;
}

static inline int kd_rect_inside(const kd_rect *r, int width, int height)
{
    return r->x0 >= 0.0 && r->y0 >= 0.0 && r->x0 < r->x1 && r->y0 < r->y1
        && r->x1 <= (double)width && r->y1 <= (double)height;
}

/* How much of [at, at + 1) lies in [low, high). */
static inline double kd_overlap(double low, double high, int at)
{
    return fmin(high, (double)(at + 1)) - fmax(low, (double)at);
}

/* Counts a block's pieces in first[t + 2], or writes them at first[t + 1], which grows. */
static inline void kd_cover_add(kd_cover *c, int index, int write)
{
    const kd_rect *r = &c->rects[index];
    int x, y;

    for (y = (int)r->y0; (double)y < r->y1; y++)
        for (x = (int)r->x0; (double)x < r->x1; x++) {
            int *first = &c->first[y * c->width + x];

            if (write) {
                c->pieces[first[1]].block = index;
                c->pieces[first[1]].share = kd_overlap(r->x0, r->x1, x)
                                          * kd_overlap(r->y0, r->y1, y);
            }
            first[write ? 1 : 2]++;
        }
}

/* Blocks that do not lie in the map hold nothing. */
static inline kd_cover kd_cover_make(const kd_fixture *f)
{
    const int texels = f->image.width * f->image.height;
    kd_cover c;
    int i;

    c.width = f->image.width;
    c.height = f->image.height;
    c.count = f->info.block_count;
    c.whole = f->desc.select != ENVSAMP_KD_WARP && f->desc.nearest;
    c.rects = kd_rects(f);
    c.first = (int *)kd_allocate(((size_t)texels + 2) * sizeof *c.first);
    for (i = 0; i < c.count; i++)
        if (kd_rect_inside(&c.rects[i], c.width, c.height))
            kd_cover_add(&c, i, 0);
    for (i = 2; i < texels + 2; i++)
        c.first[i] += c.first[i - 1];
    c.pieces = (kd_piece *)kd_allocate((size_t)c.first[texels + 1] * sizeof *c.pieces);
    for (i = 0; i < c.count; i++)
        if (kd_rect_inside(&c.rects[i], c.width, c.height))
            kd_cover_add(&c, i, 1);
    return c;
}

static inline void kd_cover_free(kd_cover *c)
{
    free(c->rects);
    free(c->first);
    free(c->pieces);
}

/* Texels that blocks do not hold exactly once, and blocks outside of the map, or of parts of texels
   where they must not be. */
static inline int kd_cover_faults(const kd_cover *c)
{
    int i, k, faults = 0;

    for (i = 0; i < c->count; i++)
        faults += !kd_rect_inside(&c->rects[i], c->width, c->height)
               || (c->whole && !kd_rect_whole(&c->rects[i]));
    for (i = 0; i < c->width * c->height; i++) {
        double whole = 0.0;

        for (k = c->first[i]; k < c->first[i + 1]; k++)
            whole += c->pieces[k].share;
        faults += !(fabs(whole - 1.0) <= 1e-7);
    }
    return faults;
}

/* The texel of a point of the map, u to within a turn. */
static inline int kd_cover_texel(const kd_cover *c, double u, double v)
{
    int x = (int)((u < 0.0 ? u + 1.0 : u >= 1.0 ? u - 1.0 : u) * (double)c->width);
    int y = (int)((v > 0.0 ? v : 0.0) * (double)c->height);

    x = x < c->width ? x : c->width - 1;
    y = y < c->height ? y : c->height - 1;
    return y * c->width + x;
}

/* How far outside of a block a point lies, u and v alike; 0 inside. */
static inline double kd_outside(const kd_rect *r, double u, double v)
{
    const double across = r->u0 - u > u - r->u1 ? r->u0 - u : u - r->u1;
    const double down = r->v0 - v > v - r->v1 ? r->v0 - v : v - r->v1;
    const double most = across > down ? across : down;

    return most > 0.0 ? most : 0.0;
}

/* The block that a point of the map lies in, or is nearest to; -1 none. */
static inline int kd_cover_owner(const kd_cover *c, double u, double v)
{
    const int texel = kd_cover_texel(c, u, v), first = c->first[texel];
    int k, owner = -1;
    double least = HUGE_VAL;

    if (c->first[texel + 1] == first + 1)
        return c->pieces[first].block;
    for (k = first; k < c->first[texel + 1]; k++) {
        const kd_rect *r = &c->rects[c->pieces[k].block];
        const double outside = kd_outside(r, u, v);

        if (u >= r->u0 && u < r->u1 && v >= r->v0 && v < r->v1)
            return c->pieces[k].block;
        if (outside < least) {
            least = outside;
            owner = c->pieces[k].block;
        }
    }
    return owner;
}

/* A direction, uniform over the sphere. */
static inline void kd_random_direction(pcg32 *random, float dir[3])
{
    const double z = 2.0 * (double)pcg32_float(random) - 1.0;
    const double phi = 2.0 * KD_PI * (double)pcg32_float(random), r = sqrt(1.0 - z * z);

    dir[0] = (float)(r * cos(phi));
    dir[1] = (float)(r * sin(phi));
    dir[2] = (float)z;
}

/* A point of the map to a direction, with libm. */
static inline void kd_direction(double u, double v, float dir[3])
{
    const double sine = sin(KD_PI * v);

    dir[0] = (float)(cos(2.0 * KD_PI * u) * sine);
    dir[1] = (float)(sin(2.0 * KD_PI * u) * sine);
    dir[2] = (float)cos(KD_PI * v);
}

/* A direction to a point of the map, with libm. */
static inline void kd_point(const float dir[3], double *u, double *v)
{
    const double x = (double)dir[0], y = (double)dir[1], z = (double)dir[2];

    *u = atan2(y, x) / (2.0 * KD_PI);
    *u = *u < 0.0 ? *u + 1.0 : *u;
    *v = atan2(sqrt(x * x + y * y), z) / KD_PI;
}

static inline int kd_bits_equal(const void *a, const void *b, size_t bytes)
{
    return !memcmp(a, b, bytes);
}

#endif
