/* kd_fixture.h: kd tables for tests, in buffers of exactly the size asked for, between canaries.
 *
 *     kd_fixture f;
 *     if (kd_fixture_build(&f, &map, &desc)) ... f.kd, f.info ...
 *     kd_fixture_free(&f);
 *
 * Include it after the implementation of envsamp.h.
 */
#ifndef KD_FIXTURE_H
#define KD_FIXTURE_H

#include "../envsamp.h"

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

static inline envsamp_kd_desc kd_desc(int blocks, envsamp_kd_select select)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();

    desc.block_count = blocks;
    desc.select = select;
    desc.bilinear = 0;
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

/* A block in whole texels, with its solid angle by kd_solid_angle. */
typedef struct kd_rect { int x0, y0, x1, y1; double solid_angle, probability; } kd_rect;

static inline kd_rect kd_rect_of(const kd_fixture *f, int index)
{
    const float width = (float)f->image.width, height = (float)f->image.height;
    envsamp_kd_block block;
    kd_rect rect;

    memset(&block, 0, sizeof block);
    envsamp_kd_get_block(f->kd, index, &block);
    rect.x0 = (int)(block.uv_min[0] * width + 0.5f);
    rect.y0 = (int)(block.uv_min[1] * height + 0.5f);
    rect.x1 = (int)(block.uv_max[0] * width + 0.5f);
    rect.y1 = (int)(block.uv_max[1] * height + 0.5f);
    rect.solid_angle = kd_solid_angle(f->image.width, f->image.height, rect.x0, rect.y0,
                                      rect.x1, rect.y1);
    rect.probability = (double)block.probability;
    return rect;
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
