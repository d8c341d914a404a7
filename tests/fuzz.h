/* fuzz.h: what the fuzz targets of fuzz.c share: a reader of their input, guarded memory, checks,
 * and maps.
 *
 * The reader hands out the bytes of the input, and, where they end, goes on with random numbers
 * that are seeded by a hash of all of them. So every input, the empty one too, is a whole case, and
 * one with some bytes changed is another. Include it after the implementation of envsamp.h.
 */
#ifndef FUZZ_H
#define FUZZ_H

#include "../envsamp.h"
#include "../examples/common/random.h"

#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(__has_feature)
#if __has_feature(address_sanitizer)
#define FUZZ_ASAN
#endif
#elif defined(__SANITIZE_ADDRESS__)
#define FUZZ_ASAN
#endif
#ifdef FUZZ_ASAN
#include <sanitizer/asan_interface.h>
#else
#define ASAN_POISON_MEMORY_REGION(at, bytes) ((void)(at), (void)(bytes))
#define ASAN_UNPOISON_MEMORY_REGION(at, bytes) ((void)(at), (void)(bytes))
#endif

/* A check that fails ends the program: a fuzzer keeps the input then, and a replay names it. */
static void fuzz_fail(const char *what, const char *file, int line)
{
    fflush(stdout);
    fprintf(stderr, "%s:%d: this does not hold: %s\n", file, line, what);
    abort();
}

#define FUZZ_CHECK(condition) ((condition) ? (void)0 : fuzz_fail(#condition, __FILE__, __LINE__))

/* ---- the input ---- */

typedef struct fuzz_input {
    const uint8_t *data;
    size_t size, at;
    pcg32 random;               /* seeded by the data, and independent of how far they are read */
} fuzz_input;

static fuzz_input fuzz_begin(const uint8_t *data, size_t size)
{
    uint64_t hash = 0xcbf29ce484222325u;    /* FNV-1a */
    fuzz_input in;
    size_t i;

    for (i = 0; i < size; i++)
        hash = (hash ^ data[i]) * 0x100000001b3u;
    in.data = data;
    in.size = size;
    in.at = 0;
    in.random = pcg32_make(hash, (uint64_t)size);
    return in;
}

static uint32_t fuzz_byte(fuzz_input *in)
{
    return in->at < in->size ? in->data[in->at++] : pcg32_next(&in->random) >> 24;
}

static uint32_t fuzz_word(fuzz_input *in)
{
    uint32_t word = fuzz_byte(in) << 24;

    word |= fuzz_byte(in) << 16;
    word |= fuzz_byte(in) << 8;
    return word | fuzz_byte(in);
}

/* 0 .. count - 1. One byte of the input where that is enough. */
static uint32_t fuzz_below(fuzz_input *in, uint32_t count)
{
    return (count <= 256 ? fuzz_byte(in) : fuzz_word(in)) % count;
}

static int fuzz_range(fuzz_input *in, int low, int high)
{
    return low + (int)fuzz_below(in, (uint32_t)(high - low) + 1);
}

/* Whether to do what happens once in `count` cases. */
static int fuzz_rarely(fuzz_input *in, uint32_t count)
{
    return fuzz_below(in, count) == count - 1;
}

static float fuzz_bits(uint32_t bits)
{
    float value;

    memcpy(&value, &bits, sizeof value);
    return value;
}

static uint32_t fuzz_bits_of(float value)
{
    uint32_t bits;

    memcpy(&bits, &value, sizeof bits);
    return bits;
}

static int fuzz_any_int(fuzz_input *in)
{
    static const int special[] = { 0, 1, -1, 2, 16, 255, 65535, 65536, 1048576, 1048577,
                                   INT_MAX, INT_MAX - 1, INT_MIN, INT_MIN + 1 };
    const uint32_t kind = fuzz_byte(in);

    return kind < 192 ? special[kind % 14] : (int)(fuzz_word(in) >> 1) - (1 << 30);
}

/* Mostly within a range that makes sense, and any number once in `rarity` times. */
static int fuzz_int(fuzz_input *in, int low, int high, uint32_t rarity)
{
    return fuzz_rarely(in, rarity) ? fuzz_any_int(in) : fuzz_range(in, low, high);
}

static float fuzz_unit(fuzz_input *in) { return unit_float(fuzz_word(in)); }

/* A positive number of any size from 2^low on, `octaves` of them. */
static float fuzz_scaled(fuzz_input *in, int low, uint32_t octaves)
{
    return ldexpf(1.0f + fuzz_unit(in), low + (int)fuzz_below(in, octaves));
}

static float fuzz_float(fuzz_input *in)
{
    static const float special[] = { 0.0f, -0.0f, 1.0f, -1.0f, 0.5f, 2.0f, 0.99999994f,
        1.00000012f, 1e-45f, -1e-45f, FLT_MIN, FLT_MAX, -FLT_MAX, 1.8e38f, 1e-20f, 1e20f,
        INFINITY, -INFINITY, NAN };
    const uint32_t kind = fuzz_byte(in);

    if (kind < 96)
        return special[kind % 19];
    if (kind < 128)
        return fuzz_bits(fuzz_word(in));
    if (kind < 160)
        return (float)fuzz_range(in, -40, 40) / 8.0f;
    return kind < 192 ? fuzz_scaled(in, -126, 254) : fuzz_unit(in);
}

static void fuzz_dir(fuzz_input *in, float dir[3])
{
    const int any = fuzz_rarely(in, 4);
    int c;

    for (c = 0; c < 3; c++)
        dir[c] = any ? fuzz_float(in) : 2.0f * pcg32_float(&in->random) - 1.0f;
}

/* ---- guarded memory ---- */

#define FUZZ_CANARY 64

/* Memory of exactly so many bytes: what lies before and behind is poisoned for the address
   sanitizer, and compared at the end where there is none. */
typedef struct fuzz_guard { uint8_t *block, *data; size_t bytes; } fuzz_guard;

/* `lag` bytes past a multiple of 64: a promise of less alignment is not taken for more. */
static fuzz_guard fuzz_guard_make(size_t bytes, size_t lag, int fill)
{
    const size_t all = bytes + 2 * FUZZ_CANARY + 64 + lag;
    fuzz_guard guard;

    guard.block = (uint8_t *)malloc(all);
    if (!guard.block) {
        fprintf(stderr, "out of memory\n");
        exit(2);
    }
    guard.data = guard.block + FUZZ_CANARY;
    guard.data += (64 - (uintptr_t)guard.data % 64) % 64 + lag;
    guard.bytes = bytes;
    memset(guard.data - FUZZ_CANARY, 0xa5, FUZZ_CANARY);
    memset(guard.data + bytes, 0xa5, FUZZ_CANARY);
    memset(guard.data, fill, bytes);
    ASAN_POISON_MEMORY_REGION(guard.data - FUZZ_CANARY, FUZZ_CANARY);
    ASAN_POISON_MEMORY_REGION(guard.data + bytes, FUZZ_CANARY);
    return guard;
}

/* Aligned as a build wants its buffers, and no more. */
static fuzz_guard fuzz_buffer_make(size_t bytes, int fill)
{
    return fuzz_guard_make(bytes, ENVSAMP_ALIGN, fill);
}

static envsamp_buffer fuzz_buffer(const fuzz_guard *guard)
{
    envsamp_buffer buffer;

    buffer.data = guard->data;
    buffer.bytes = guard->bytes;
    return buffer;
}

static void fuzz_guard_free(fuzz_guard *guard)
{
    int i, intact = 1;

    if (!guard->block)
        return;
    ASAN_UNPOISON_MEMORY_REGION(guard->data - FUZZ_CANARY, FUZZ_CANARY);
    ASAN_UNPOISON_MEMORY_REGION(guard->data + guard->bytes, FUZZ_CANARY);
    for (i = 1; i <= FUZZ_CANARY; i++)
        intact &= guard->data[-i] == 0xa5 && guard->data[guard->bytes + (size_t)i - 1] == 0xa5;
    FUZZ_CHECK(intact && "nothing is written before or behind a buffer");
    free(guard->block);
    memset(guard, 0, sizeof *guard);
}

/* ---- maps ---- */

#define FUZZ_MOST_FLOATS 65536      /* of a map that is really made */

/* A map, whose pixels end where the last row does. */
typedef struct fuzz_map {
    envsamp_image image;
    fuzz_guard pixels;
    int made;                   /* the pixels are those of the image; else they are none */
    int skew;                   /* the address of the image's is so many bytes off */
} fuzz_map;

enum { FUZZ_CONSTANT, FUZZ_ANY_BITS, FUZZ_WIDE, FUZZ_LAMP, FUZZ_NOISE, FUZZ_ANY, FUZZ_HUGE,
       FUZZ_TINY, FUZZ_STYLES };

static float fuzz_radiance(fuzz_input *in, uint32_t style)
{
    switch (style) {
    case FUZZ_ANY_BITS: return fuzz_bits(pcg32_next(&in->random));
    case FUZZ_WIDE:     return ldexpf(1.0f + pcg32_float(&in->random),
                                      (int)(pcg32_next(&in->random) % 20u) - 10);
    case FUZZ_LAMP:     return pcg32_next(&in->random) % 32u ? 0.0f : fuzz_scaled(in, -4, 24);
    case FUZZ_ANY:      return fuzz_float(in);
    case FUZZ_HUGE:     return FLT_MAX * (1.0f - 0.9f * pcg32_float(&in->random));
    case FUZZ_TINY:     return fuzz_bits(pcg32_next(&in->random) % 0x01000000u);
    default:            return pcg32_float(&in->random);
    }
}

/* Most values come from the generator: a fuzzer finds styles and sizes, not texels. */
static void fuzz_fill_row(fuzz_input *in, float *row, int count, uint32_t style, float constant)
{
    int x;

    for (x = 0; x < count; x++)
        row[x] = style == FUZZ_CONSTANT ? constant : fuzz_radiance(in, style);
}

static size_t fuzz_row_bytes(const envsamp_image *image)
{
    return (size_t)image->width * (size_t)image->channels * sizeof(float);
}

static size_t fuzz_stride(const envsamp_image *image)
{
    return image->row_stride_bytes ? image->row_stride_bytes : fuzz_row_bytes(image);
}

static float *fuzz_row(const fuzz_map *map, int y)
{
    return (float *)(void *)(map->pixels.data + (size_t)y * fuzz_stride(&map->image));
}

/* Whether the contract takes the sizes and the mapping of an image. */
static int fuzz_image_good(const envsamp_image *image)
{
    return image->width >= 1 && image->width <= 65535 && image->height >= 1
        && image->height <= 65535
        && (image->channels == 1 || image->channels == 3 || image->channels == 4)
        && fuzz_stride(image) % sizeof(float) == 0 && fuzz_stride(image) >= fuzz_row_bytes(image)
        && fuzz_stride(image) <= SIZE_MAX / (size_t)image->height
        && (uint32_t)image->mapping <= ENVSAMP_OCTAHEDRAL;
}

static void fuzz_fill_map(fuzz_input *in, fuzz_map *map)
{
    const int count = map->image.width * map->image.channels;
    const uint32_t style = fuzz_below(in, FUZZ_STYLES);
    const float constant = fuzz_float(in);
    int y, spoilt = fuzz_rarely(in, 4) ? 1 + (int)fuzz_below(in, 8) : 0;

    for (y = 0; y < map->image.height; y++)
        fuzz_fill_row(in, fuzz_row(map, y), count, style, constant);
    while (spoilt-- > 0) {
        float *row = fuzz_row(map, (int)fuzz_below(in, (uint32_t)map->image.height));

        row[fuzz_below(in, (uint32_t)count)] = fuzz_float(in);
    }
}

/* An image of up to so many texels a side, any of whose fields may rarely be anything. */
static fuzz_map fuzz_map_make(fuzz_input *in, int most)
{
    static const int channels[] = { 1, 3, 4 };
    envsamp_image *image;
    fuzz_map map;
    size_t bytes;

    memset(&map, 0, sizeof map);
    image = &map.image;
    image->mapping = (envsamp_mapping)fuzz_int(in, 0, 2, 64);
    image->channels = fuzz_rarely(in, 64) ? fuzz_any_int(in) : channels[fuzz_below(in, 3)];
    image->width = fuzz_int(in, 1, most, 64);
    image->height = fuzz_int(in, 1, most, 64);
    if (fuzz_rarely(in, 4))
        image->row_stride_bytes = fuzz_row_bytes(image) + 4 * (size_t)fuzz_below(in, 16) - 4;
    if (fuzz_rarely(in, 64))
        image->row_stride_bytes = (size_t)((uint64_t)fuzz_word(in) << 8 * fuzz_below(in, 5));
    map.made = fuzz_image_good(image)
            && fuzz_stride(image) / sizeof(float) <= FUZZ_MOST_FLOATS / (size_t)image->height;
    bytes = map.made ? fuzz_stride(image) * (size_t)(image->height - 1) + fuzz_row_bytes(image)
                     : sizeof(float);
    map.pixels = fuzz_guard_make(bytes, sizeof(float), 0xff);   /* NaN between rows */
    if (map.made)
        fuzz_fill_map(in, &map);
    map.skew = fuzz_rarely(in, 64) ? fuzz_range(in, 1, 3) : 0;
    image->pixels = (const float *)(const void *)(map.pixels.data + map.skew);
    if (fuzz_rarely(in, 64)) {
        image->pixels = NULL;
        map.skew = 0;
    }
    return map;
}

static void fuzz_map_free(fuzz_map *map) { fuzz_guard_free(&map->pixels); }

/* ---- what is true of a map, by a plain program ---- */

/* A pixel as a build counts it. Returns whether a channel is bad. */
static int fuzz_texel(const fuzz_map *map, int x, int y, float rgb[3])
{
    const float *pixel = fuzz_row(map, y) + (size_t)x * (size_t)map->image.channels;
    int bad = 0, black = 0, c;

    for (c = 0; c < 3; c++) {
        rgb[c] = pixel[map->image.channels == 1 ? 0 : c];
        black |= !(fabsf(rgb[c]) <= FLT_MAX);
        bad |= rgb[c] < 0.0f;
        rgb[c] = rgb[c] > 0.0f ? rgb[c] : 0.0f;
    }
    if (black)
        rgb[0] = rgb[1] = rgb[2] = 0.0f;
    return bad || black;
}

typedef struct fuzz_facts {
    double integral[3], luminance;      /* over the sphere */
    double brightest;                   /* luminance of a texel */
    size_t lit;                         /* texels whose luminance, a float, is above zero */
    size_t bad;
} fuzz_facts;

static fuzz_facts fuzz_map_facts(const fuzz_map *map)
{
    const double pi = 3.14159265358979323846;
    const envsamp_image *image = &map->image;
    fuzz_facts facts;
    int x, y, c;

    memset(&facts, 0, sizeof facts);
    for (y = 0; y < image->height; y++) {
        const double end = image->mapping == ENVSAMP_LATLONG ? pi : 0.5 * pi;
        const double middle = end * (y + 0.5) / image->height, half = 0.5 * end / image->height;
        const double sr = image->mapping == ENVSAMP_OCTAHEDRAL
                        ? 4.0 * pi / image->width / image->height
                        : 4.0 * pi / image->width * sin(middle) * sin(half);

        for (x = 0; x < image->width; x++) {
            float rgb[3];
            double luminance;

            facts.bad += fuzz_texel(map, x, y, rgb) ? 1 : 0;
            for (c = 0; c < 3; c++)
                facts.integral[c] += sr * (double)rgb[c];
            luminance = 0.2126 * (double)rgb[0] + 0.7152 * (double)rgb[1]
                      + 0.0722 * (double)rgb[2];
            facts.luminance += sr * luminance;
            facts.lit += (image->channels == 1 ? rgb[0] : envsamp_luminance(rgb)) > 0.0f;
            facts.brightest = luminance > facts.brightest ? luminance : facts.brightest;
        }
    }
    return facts;
}

#endif
