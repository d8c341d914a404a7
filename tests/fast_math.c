/* What holds with -ffast-math, too: no read outside a table or a map for any bits of numbers,
   directions and settings; figures that are finite; the law of a build without it; bad pixels
   counted; what is no number refused.

   tests/test_fast_math.sh compiles this file twice: with -DUNDER_TEST and the flags to be tested it
   is the functions of the header, without it the checks, and the same functions to compare with.
   Tables, maps and inputs of batches end, or begin, at pages that may not be touched. */
#define _DEFAULT_SOURCE
#define ENVSAMP_STATIC
#define ENVSAMP_IMPLEMENTATION
#include "envsamp.h"

#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>

/* ---- the functions of the header ---- */

typedef enum kind { WARP, ALIAS, LOG, POWER, CDF, KINDS } kind;

typedef struct library {
    envsamp_result (*build)(kind kind, const envsamp_image *map, envsamp_kd_desc desc,
                            envsamp_buffer table, envsamp_buffer scratch, const void **made);
    envsamp_result (*open)(kind kind, const void *table, size_t bytes, const void **opened);
    size_t (*bytes)(kind kind, const void *table);
    void (*info)(kind kind, const void *table, envsamp_kd_info *info);
    envsamp_sample (*sample)(kind kind, const void *table, float u0, float u1);
    float (*pdf)(kind kind, const void *table, const float dir[3]);
    int (*invert)(kind kind, const void *table, const float dir[3], float u[2]);
    void (*sample_n)(kind kind, const void *table, size_t n, float *const *of);
    void (*pdf_n)(kind kind, const void *table, size_t n, float *const *of);
    envsamp_sample (*sample_facing)(const envsamp_kd *kd, const float normal[3], float u0,
                                    float u1);
    float (*pdf_facing)(const envsamp_kd *kd, const float normal[3], const float dir[3]);
    int (*invert_facing)(const envsamp_kd *kd, const float normal[3], const float dir[3],
                         float u[2]);
    void (*sample_facing_n)(const envsamp_kd *kd, const float normal[3], size_t n,
                            const float *u0, const float *u1, float *x, float *y, float *z,
                            float *pdf);
    void (*pdf_facing_n)(const envsamp_kd *kd, const float normal[3], size_t n, const float *x,
                         const float *y, const float *z, float *pdf);
    envsamp_result (*get_block)(const envsamp_kd *kd, int index, envsamp_kd_block *block);
    void (*uv_to_dir)(envsamp_mapping mapping, float u, float v, float dir[3]);
    void (*dir_to_uv)(envsamp_mapping mapping, const float dir[3], float uv[2]);
    void (*lookup)(const envsamp_image *map, int nearest, const float dir[3], float rgb[3]);
    float (*mis_power)(float pdf_taken, float pdf_other);
    envsamp_result (*halftone)(const float *importance, int width, int height, size_t stride,
                               const envsamp_halftone_desc *desc, envsamp_texel *texels,
                               int capacity, int *count, envsamp_buffer scratch);
    envsamp_result (*lights)(const envsamp_image *map, const envsamp_lights_desc *desc,
                             envsamp_light *lights, int capacity, envsamp_buffer scratch,
                             envsamp_lights_info *info);
    envsamp_result (*interleave)(const envsamp_light *lights, int count, int set, int set_count,
                                 float extent, uint32_t seed, envsamp_light *out);
    envsamp_result (*emissive_mask)(const envsamp_image *map, const envsamp_lights_desc *desc,
                                    uint8_t *mask, envsamp_buffer scratch, float *threshold);
    envsamp_result (*lm)(const envsamp_lm_desc *desc, envsamp_lm_fn fn, void *user,
                         double *params, envsamp_buffer scratch, envsamp_lm_info *info);
} library;

extern const library under_test;

static envsamp_result build(kind kind, const envsamp_image *map, envsamp_kd_desc desc,
                            envsamp_buffer table, envsamp_buffer scratch, const void **made)
{
    envsamp_cdf_desc cdf_desc;
    const envsamp_kd *kd;
    const envsamp_cdf *cdf;
    envsamp_result result;

    *made = NULL;
    if (kind == CDF) {
        memset(&cdf_desc, 0, sizeof cdf_desc);
        cdf_desc.mis_compensation = desc.mis_compensation;
        cdf_desc.nearest = desc.nearest;
        cdf_desc.strict = desc.strict;
        cdf_desc.importance_exponent = desc.importance_exponent;
        result = envsamp_cdf_build(map, &cdf_desc, table, scratch, &cdf);
        *made = cdf;
        return result;
    }
    desc.select = kind == WARP ? ENVSAMP_KD_WARP : kind == ALIAS ? ENVSAMP_KD_ALIAS
                                                                 : ENVSAMP_KD_FIT;
    desc.model = kind == POWER ? ENVSAMP_KD_POWER : ENVSAMP_KD_LOG;
    desc.facing = kind == WARP;
    result = envsamp_kd_build(map, &desc, table, scratch, &kd);
    *made = kd;
    return result;
}

static envsamp_result open_table(kind kind, const void *table, size_t bytes, const void **opened)
{
    const envsamp_kd *kd = NULL;
    const envsamp_cdf *cdf = NULL;
    envsamp_result result = kind == CDF ? envsamp_cdf_open(table, bytes, &cdf)
                                        : envsamp_kd_open(table, bytes, &kd);

    *opened = kind == CDF ? (const void *)cdf : (const void *)kd;
    return result;
}

static size_t table_bytes(kind kind, const void *table)
{
    return kind == CDF ? envsamp_cdf_bytes((const envsamp_cdf *)table)
                       : envsamp_kd_bytes((const envsamp_kd *)table);
}

static void table_info(kind kind, const void *table, envsamp_kd_info *info)
{
    envsamp_cdf_info cdf;

    memset(info, 0, sizeof *info);
    memset(&cdf, 0, sizeof cdf);
    if (kind != CDF) {
        envsamp_kd_get_info((const envsamp_kd *)table, info);
        return;
    }
    envsamp_cdf_get_info((const envsamp_cdf *)table, &cdf);
    info->integral = cdf.integral;
    info->excess_variance = cdf.excess_variance;
    info->max_ratio = cdf.max_ratio;
    info->bad_pixel_count = cdf.bad_pixel_count;
}

static envsamp_sample sample(kind kind, const void *table, float u0, float u1)
{
    return kind == CDF ? envsamp_cdf_sample((const envsamp_cdf *)table, u0, u1)
                       : envsamp_kd_sample((const envsamp_kd *)table, u0, u1);
}

static float pdf(kind kind, const void *table, const float dir[3])
{
    return kind == CDF ? envsamp_cdf_pdf((const envsamp_cdf *)table, dir)
                       : envsamp_kd_pdf((const envsamp_kd *)table, dir);
}

static int invert(kind kind, const void *table, const float dir[3], float u[2])
{
    return kind == CDF ? envsamp_cdf_invert((const envsamp_cdf *)table, dir, u)
                       : envsamp_kd_invert((const envsamp_kd *)table, dir, u);
}

/* of: u0, u1, x, y, z, pdf */
static void sample_n(kind kind, const void *table, size_t n, float *const *of)
{
    if (kind == CDF)
        envsamp_cdf_sample_n((const envsamp_cdf *)table, n, of[0], of[1], of[2], of[3], of[4],
                             of[5]);
    else
        envsamp_kd_sample_n((const envsamp_kd *)table, n, of[0], of[1], of[2], of[3], of[4],
                            of[5]);
}

/* of: x, y, z, pdf */
static void pdf_n(kind kind, const void *table, size_t n, float *const *of)
{
    if (kind == CDF)
        envsamp_cdf_pdf_n((const envsamp_cdf *)table, n, of[0], of[1], of[2], of[3]);
    else
        envsamp_kd_pdf_n((const envsamp_kd *)table, n, of[0], of[1], of[2], of[3]);
}

#ifdef UNDER_TEST

const library under_test =

#else

static const library reference =

#endif
{
    build, open_table, table_bytes, table_info, sample, pdf, invert, sample_n, pdf_n,
    envsamp_kd_sample_facing, envsamp_kd_pdf_facing, envsamp_kd_invert_facing,
    envsamp_kd_sample_facing_n, envsamp_kd_pdf_facing_n,
    envsamp_kd_get_block, envsamp_uv_to_dir, envsamp_dir_to_uv, envsamp_lookup, envsamp_mis_power,
    envsamp_halftone, envsamp_lights, envsamp_lights_interleave, envsamp_emissive_mask, envsamp_lm
};

#ifndef UNDER_TEST

#include "check.h"

/* ---- numbers and memory ---- */

static float from_bits(uint32_t bits)
{
    float value;

    memcpy(&value, &bits, sizeof value);
    return value;
}

static uint32_t to_bits(float value)
{
    uint32_t bits;

    memcpy(&bits, &value, sizeof bits);
    return bits;
}

static int is_finite(float value) { return (to_bits(value) & 0x7f800000u) != 0x7f800000u; }

static int is_finite_double(double value)
{
    uint64_t bits;

    memcpy(&bits, &value, sizeof bits);
    return (bits >> 52 & 0x7ff) != 0x7ff;
}

/* Finite, and 0 or more. */
static int is_size(float value) { return is_finite(value) && value >= 0.0f; }

static uint32_t random_state = 12345;

static uint32_t random_bits(void)
{
    uint32_t x;

    random_state = random_state * 747796405u + 2891336453u;
    x = ((random_state >> ((random_state >> 28) + 4)) ^ random_state) * 277803737u;
    return (x >> 22) ^ x;
}

static float random_unit(void) { return (float)(random_bits() >> 8) / 16777216.0f; }

static const uint32_t special[] = {
    0x00000000u, 0x80000000u,                               /* zeros */
    0x00000001u, 0x80000001u, 0x007fffffu, 0x00800000u,     /* 1e-45, and about FLT_MIN */
    0x0da24260u, 0xa2b8cbccu, 0x33800000u,                  /* 1e-30, -5e-18, 2^-24 */
    0x3effffffu, 0x3f000000u, 0xbf000000u,                  /* about 1/2 */
    0x3f7ffffeu, 0x3f7fffffu, 0x3f800000u, 0x3f800001u, 0xbf800000u,    /* about 1 */
    0x5d5e0b6bu, 0xdf800000u, 0x7149f2cau,                  /* 1e18, -2^64, 1e30 */
    0x7effffffu, 0x7f7fffffu, 0xff7fffffu,                  /* about FLT_MAX */
    0x7f800000u, 0xff800000u,                               /* infinities */
    0x7f800001u, 0x7fc00000u, 0x7fffffffu, 0xffc00000u, 0xffffffffu     /* NaN */
};
enum { SPECIAL = sizeof special / sizeof *special, RANDOM = 4096,
       PAIRS = SPECIAL * SPECIAL + RANDOM, TRIPLES = SPECIAL * SPECIAL * SPECIAL + RANDOM };

enum { REGION = 4 << 20, PAGE = 65536 };

/* A region between two pages that may not be touched. */
static char *make_region(void)
{
    char *memory = (char *)mmap(NULL, REGION + 2 * PAGE, PROT_READ | PROT_WRITE,
                                MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);

    if (memory == MAP_FAILED || mprotect(memory, PAGE, PROT_NONE)
        || mprotect(memory + PAGE + REGION, PAGE, PROT_NONE)) {
        printf("Bail out! no memory\n");
        exit(1);
    }
    return memory + PAGE;
}

/* The first bytes of a region, or the last, aligned. */
static void *put(char *region, size_t bytes, size_t align, int last)
{
    return last ? region + (REGION - bytes) / align * align : region;
}

static char *table_region, *map_region, *scratch_region, *input_region[3];

/* ---- maps ---- */

enum { WIDTH = 99, HEIGHT = 37, TEXELS = WIDTH * HEIGHT };

/* Noise with lamps, and nothing in a corner. */
static envsamp_image make_map(int mapping, int channels)
{
    float *pixels = (float *)put(map_region, sizeof(float) * TEXELS * (size_t)channels, 4, 1);
    envsamp_image map;
    int i, c;

    for (i = 0; i < TEXELS; i++)
        for (c = 0; c < channels; c++) {
            int x = i % WIDTH, y = i / WIDTH;
            float lamp = (x + 3 * y) % 41 == 5 ? 20.0f : y == 12 && x == 30 ? 4000.0f : 0.0f;

            pixels[i * channels + c] = x < 20 && y < 9 ? 0.0f : 0.05f + random_unit() + lamp;
        }
    memset(&map, 0, sizeof map);
    map.pixels = pixels;
    map.width = WIDTH;
    map.height = HEIGHT;
    map.channels = channels;
    map.mapping = (envsamp_mapping)mapping;
    return map;
}

static float *pixel(const envsamp_image *map, int index)
{
    return (float *)(uintptr_t)map->pixels + index;
}

static void fill(const envsamp_image *map, float value)
{
    int i;

    for (i = 0; i < TEXELS * map->channels; i++)
        *pixel(map, i) = value;
}

/* ---- tables ---- */

typedef struct made { kind kind; envsamp_mapping mapping; const void *table; } made;

static envsamp_kd_desc description(int nearest)
{
    envsamp_kd_desc desc;

    memset(&desc, 0, sizeof desc);
    desc.block_count = 150;
    desc.nearest = nearest;
    return desc;
}

static envsamp_result build_by(const library *by, kind kind, const envsamp_image *map,
                               const envsamp_kd_desc *desc, made *out)
{
    static char memory[REGION];
    envsamp_buffer table, scratch;

    table.data = (void *)((uintptr_t)(memory + 15) / 16 * 16);
    table.bytes = sizeof memory - 16;
    scratch.data = scratch_region;
    scratch.bytes = REGION;
    out->kind = kind;
    out->mapping = map->mapping;
    return by->build(kind, map, *desc, table, scratch, &out->table);
}

/* Moves a table to one of the ends of its region, and opens it there. */
static int move_table(const library *by, made *table, int last)
{
    size_t bytes = under_test.bytes(table->kind, table->table);
    void *to = put(table_region, bytes, ENVSAMP_ALIGN, last);

    memmove(to, table->table, bytes);
    return by->open(table->kind, to, bytes, &table->table) == ENVSAMP_OK;
}

/* ---- samples and densities of anything ---- */

static void fill_inputs(int count, int columns, float **of, int reach)
{
    int i, k;

    for (k = 0; k < columns; k++)
        of[k] = (float *)put(input_region[k], sizeof(float) * (size_t)count, 4, 1);
    for (i = 0; i < count; i++) {
        int rest = i;

        for (k = 0; k < columns; k++, rest /= SPECIAL)
            of[k][i] = from_bits(i < reach ? special[rest % SPECIAL] : random_bits());
    }
}

static int good_dir(const float *dir)
{
    double x = (double)dir[0], y = (double)dir[1], z = (double)dir[2];
    double off = x * x + y * y + z * z - 1.0;

    return is_finite(dir[0]) && is_finite(dir[1]) && is_finite(dir[2]) && off < 2e-6
        && off > -2e-6;
}

static int good_sample(const envsamp_sample *s)
{
    return good_dir(s->dir) && is_finite(s->pdf) && s->pdf > 0.0f
        && is_size(s->uv[0]) && s->uv[0] <= 1.0f && is_size(s->uv[1]) && s->uv[1] <= 1.000001f;
}

static float output[4][TRIPLES];

/* How many samples are no good, of all kinds of numbers. */
static int bad_samples(const made *t)
{
    float *of[6];
    int bad = 0, i;

    fill_inputs(PAIRS, 2, of, SPECIAL * SPECIAL);
    for (i = 0; i < 4; i++)
        of[2 + i] = output[i];
    under_test.sample_n(t->kind, t->table, PAIRS, of);
    for (i = 0; i < PAIRS; i++) {
        envsamp_sample s = under_test.sample(t->kind, t->table, of[0][i], of[1][i]), n = s;

        n.dir[0] = output[0][i];
        n.dir[1] = output[1][i];
        n.dir[2] = output[2][i];
        n.pdf = output[3][i];
        bad += !good_sample(&s) || !good_sample(&n);
    }
    return bad;
}

/* How many densities, inverses and points are no good, of all kinds of directions. */
static int bad_densities(const made *t)
{
    float *of[4];
    int bad = 0, i;

    fill_inputs(TRIPLES, 3, of, SPECIAL * SPECIAL * SPECIAL);
    of[3] = output[0];
    under_test.pdf_n(t->kind, t->table, TRIPLES, of);
    for (i = 0; i < TRIPLES; i++) {
        float dir[3], u[2], uv[2], one;
        int none, inverts;

        dir[0] = of[0][i];
        dir[1] = of[1][i];
        dir[2] = of[2][i];
        none = !is_finite(dir[0]) || !is_finite(dir[1]) || !is_finite(dir[2])
            || !((to_bits(dir[0]) | to_bits(dir[1]) | to_bits(dir[2])) << 1);
        one = under_test.pdf(t->kind, t->table, dir);
        bad += !is_size(one) || !is_size(output[0][i])
            || (none && (to_bits(one) || to_bits(output[0][i])));
        inverts = under_test.invert(t->kind, t->table, dir, u);
        bad += inverts ? none || !is_size(u[0]) || !is_size(u[1]) || u[0] >= 1.0f || u[1] >= 1.0f
                       : to_bits(u[0]) || to_bits(u[1]);
        under_test.dir_to_uv(t->mapping, dir, uv);
        bad += !is_size(uv[0]) || !is_size(uv[1]) || uv[0] > 1.0f || uv[1] > 2.0f;
    }
    return bad;
}

/* ---- samples that face a normal ---- */

/* The normals of `special` numbers, and random bits. */
static void make_normal(int index, float normal[3])
{
    int k, rest = index * 7;

    for (k = 0; k < 3; k++, rest /= SPECIAL)
        normal[k] = from_bits(index < TRIPLES / 8 ? special[rest % SPECIAL] : random_bits());
}

/* Whether a normal is one, by its bits. */
static int is_normal(const float normal[3])
{
    float most = 0.0f;
    int k, finite = 1;

    for (k = 0; k < 3; k++) {
        finite &= is_finite(normal[k]);
        if (from_bits(to_bits(normal[k]) & 0x7fffffffu) > most)
            most = from_bits(to_bits(normal[k]) & 0x7fffffffu);
    }
    return finite && to_bits(most) >= 0x00800000u;
}

/* Whether a sample, its density and its numbers are in their ranges; and, for no normal, those of
   light alone. */
static int good_facing(const envsamp_kd *kd, const float normal[3], float u0, float u1,
                       const float dir[3])
{
    envsamp_sample s = under_test.sample_facing(kd, normal, u0, u1), alone;
    float pdf = under_test.pdf_facing(kd, normal, dir), light, u[2], v[2];
    int inverts = under_test.invert_facing(kd, normal, dir, u), good;

    good = good_sample(&s) && is_size(pdf) && is_size(u[0]) && is_size(u[1]) && u[0] < 1.0f
        && u[1] < 1.0f && (inverts || !(to_bits(u[0]) | to_bits(u[1])));
    if (is_normal(normal))
        return good;
    alone = under_test.sample(WARP, kd, u0, u1);
    light = under_test.pdf(WARP, kd, dir);
    return good && to_bits(pdf) == to_bits(light) && !memcmp(&s, &alone, sizeof s)
        && under_test.invert(WARP, kd, dir, v) == inverts && !memcmp(u, v, sizeof u);
}

enum { FACED = 60, NORMALS = 3000 };

/* How many of them are no good, of all kinds of numbers, for normals of all kinds. */
static int bad_facing(const envsamp_kd *kd)
{
    static float normal[3];
    int bad = 0, i, k;

    for (i = 0; i < NORMALS; i++) {
        float *of[3];

        make_normal(i * (TRIPLES / NORMALS), normal);
        fill_inputs(FACED, 3, of, 0);
        for (k = 0; k < FACED; k++) {
            float dir[3];

            if (k % 2) {
                of[0][k] = from_bits(special[random_bits() % SPECIAL]);
                of[1][k] = from_bits(special[random_bits() % SPECIAL]);
                of[2][k] = random_unit();
            }
            dir[0] = of[0][k];
            dir[1] = of[1][k];
            dir[2] = of[2][k];
            bad += !good_facing(kd, normal, of[0][k], of[1][k], dir);
        }
        under_test.pdf_facing_n(kd, normal, FACED, of[0], of[1], of[2], output[0]);
        for (k = 0; k < FACED; k++)
            bad += !is_size(output[0][k]);
        under_test.sample_facing_n(kd, normal, FACED, of[0], of[1], of[0], of[1], of[2],
                                   output[0]);
        for (k = 0; k < FACED; k++) {
            float dir[3];

            dir[0] = of[0][k];
            dir[1] = of[1][k];
            dir[2] = of[2][k];
            bad += !good_dir(dir) || !is_size(output[0][k]) || !(output[0][k] > 0.0f);
        }
    }
    return bad;
}

/* ---- the law ---- */

static int near_dir(const float *a, const float *b, double within)
{
    double x = (double)a[0] - (double)b[0], y = (double)a[1] - (double)b[1];
    double z = (double)a[2] - (double)b[2];

    return x * x + y * y + z * z <= within * within;
}

static int near(double a, double b, double relative)
{
    double off = a > b ? a - b : b - a;

    return off <= relative * (b < 0.0 ? -b : b);
}

enum { DRAWS = 8192 };

/* How many of DRAWS samples, densities and inverses of a table are not those of the reference. */
static int deviations(const made *t)
{
    static float u0[DRAWS], u1[DRAWS];
    float *of[6], *at[4];
    int off = 0, i;

    of[0] = u0;
    of[1] = u1;
    for (i = 0; i < DRAWS; i++) {
        u0[i] = random_unit();
        u1[i] = random_unit();
    }
    for (i = 0; i < 4; i++)
        of[2 + i] = at[i] = output[i];
    under_test.sample_n(t->kind, t->table, DRAWS, of);
    for (i = 0; i < DRAWS; i++) {
        envsamp_sample s = under_test.sample(t->kind, t->table, u0[i], u1[i]);
        envsamp_sample r = reference.sample(t->kind, t->table, u0[i], u1[i]);
        float n[3], u[2], v[2];

        n[0] = output[0][i];
        n[1] = output[1][i];
        n[2] = output[2][i];
        off += !near_dir(s.dir, r.dir, 1e-5) || !near((double)s.pdf, (double)r.pdf, 1e-5);
        off += !near_dir(n, r.dir, 1e-5) || !near((double)output[3][i], (double)r.pdf, 1e-5);
        off += !near((double)under_test.pdf(t->kind, t->table, r.dir),
                     (double)reference.pdf(t->kind, t->table, r.dir), 1e-5);
        if (under_test.invert(t->kind, t->table, r.dir, u)
            != reference.invert(t->kind, t->table, r.dir, v))
            off++;
        else if (t->kind == WARP || t->kind == CDF)
            off += !near((double)u[0] + 1.0, (double)v[0] + 1.0, 1e-4)
                || !near((double)u[1] + 1.0, (double)v[1] + 1.0, 1e-4);
        output[0][i] = r.dir[0];
        output[1][i] = r.dir[1];
        output[2][i] = r.dir[2];
        output[3][i] = reference.pdf(t->kind, t->table, r.dir);
    }
    for (i = 0; i < DRAWS; i++)
        u0[i] = output[3][i];
    under_test.pdf_n(t->kind, t->table, DRAWS, at);
    for (i = 0; i < DRAWS; i++)
        off += !near((double)output[3][i], (double)u0[i], 1e-5);
    return off;
}

/* How many of DRAWS samples that face normals, their densities and inverses are not those of the
   reference. */
static int facing_deviations(const envsamp_kd *kd)
{
    float normal[3] = { 1.0f, 0.0f, 0.0f };
    int off = 0, i, k;

    for (i = 0; i < DRAWS; i++) {
        float u0 = random_unit(), u1 = random_unit(), u[2], v[2];
        envsamp_sample s, r;

        for (k = 0; k < 3 && i % 16 == 0; k++)
            normal[k] = random_unit() - 0.5f;
        s = under_test.sample_facing(kd, normal, u0, u1);
        r = reference.sample_facing(kd, normal, u0, u1);
        off += !near_dir(s.dir, r.dir, 1e-3) || !near((double)s.pdf, (double)r.pdf, 1e-2);
        off += !near((double)under_test.pdf_facing(kd, normal, r.dir), (double)r.pdf, 1e-2);
        if (!under_test.invert_facing(kd, normal, r.dir, u)
            || !reference.invert_facing(kd, normal, r.dir, v))
            off++;
        else
            off += !near((double)u[0] + 1.0, (double)v[0] + 1.0, 1e-3)
                || !near((double)u[1] + 1.0, (double)v[1] + 1.0, 1e-3);
    }
    return off;
}

/* Standard deviations by which the share of each octant, drawn with a density, misses its solid
   angle: the largest. */
static double worst_octant(const made *t)
{
    double sum[8] = { 0.0 }, square[8] = { 0.0 }, worst = 0.0;
    double area = 3.14159265358979323846 / 2.0;
    int i, k;

    for (i = 0; i < DRAWS; i++) {
        envsamp_sample s = under_test.sample(t->kind, t->table, random_unit(), random_unit());
        double weight = 1.0 / (double)s.pdf;

        k = (s.dir[0] < 0.0f) + 2 * (s.dir[1] < 0.0f) + 4 * (s.dir[2] < 0.0f);
        sum[k] += weight;
        square[k] += weight * weight;
    }
    for (k = 1; k < (t->mapping == ENVSAMP_HEMISPHERE ? 4 : 7); k++) {  /* black in the others */
        double mean = sum[k] / DRAWS, variance = square[k] / DRAWS - mean * mean;
        double off = (mean - area) * (mean - area) / (variance / DRAWS);

        worst = off > worst ? off : worst;
    }
    return sqrt(worst);
}

/* Chi-square of the blocks that samples fall in, less its expectation, over its deviation. */
static double block_excess(const made *t)
{
    enum { BLOCKS = 200 };
    static envsamp_kd_block block[BLOCKS];
    static int met[BLOCKS];
    const envsamp_kd *kd = (const envsamp_kd *)t->table;
    double chi2 = 0.0, rest = 0.0, rest_met = 0.0;
    envsamp_kd_info info;
    int cells = 0, i, k;

    under_test.info(t->kind, t->table, &info);
    memset(met, 0, sizeof met);
    for (k = 0; k < info.block_count; k++)
        under_test.get_block(kd, k, &block[k]);
    for (i = 0; i < DRAWS; i++) {
        envsamp_sample s = under_test.sample(t->kind, t->table, random_unit(), random_unit());

        for (k = 0; k + 1 < info.block_count; k++)
            if (s.uv[0] >= block[k].uv_min[0] && s.uv[0] < block[k].uv_max[0]
                && s.uv[1] >= block[k].uv_min[1] && s.uv[1] < block[k].uv_max[1])
                break;
        met[k]++;
    }
    for (k = 0; k < info.block_count; k++) {
        double wanted = (double)block[k].probability * DRAWS, off = met[k] - wanted;

        if (wanted >= 10.0) {
            chi2 += off * off / wanted;
            cells++;
        } else {
            rest += wanted;
            rest_met += met[k];
        }
    }
    if (rest >= 10.0) {
        chi2 += (rest_met - rest) * (rest_met - rest) / rest;
        cells++;
    }
    return (chi2 - (cells - 1)) / sqrt(2.0 * (cells - 1));
}

static int good_info(const made *t, const made *r)
{
    envsamp_kd_info a, b;

    under_test.info(t->kind, t->table, &a);
    reference.info(r->kind, r->table, &b);
    return is_finite_double(a.integral) && is_finite_double(a.excess_variance)
        && is_finite_double(a.max_ratio) && is_finite_double(a.l1)
        && near(a.integral, b.integral, 1e-5) && a.bad_pixel_count == b.bad_pixel_count
        && near(a.excess_variance + 0.01, b.excess_variance + 0.01, 0.05);
}

static void test_tables(void)
{
    static const char *const name[] = { "warp", "alias", "fit by log", "fit by power", "cdf" };
    int mapping, nearest, k, last;

    for (k = 0; k < KINDS; k++) {
        int built = 0, opened = 0, samples = 0, densities = 0, off = 0, told = 0;
        double octant = 0.0, excess = -9.0, worst;

        printf("# %s\n", name[k]);
        fflush(stdout);
        for (mapping = 0; mapping < 3; mapping++)
            for (nearest = 0; nearest < 2; nearest++) {
                envsamp_image map = make_map(mapping, 1 + 2 * nearest);
                envsamp_kd_desc desc = description(nearest);
                static char copy[REGION];
                made t, r;

                desc.importance_exponent = mapping == ENVSAMP_HEMISPHERE ? 0.75f : 0.0f;
                built += build_by(&under_test, (kind)k, &map, &desc, &t) == ENVSAMP_OK;
                memcpy(copy, t.table, under_test.bytes(t.kind, t.table));
                built += build_by(&reference, (kind)k, &map, &desc, &r) == ENVSAMP_OK;
                told += good_info(&t, &r);
                opened += move_table(&under_test, &r, 0);
                off += deviations(&r);
                t.table = copy;
                for (last = 0; last < 2; last++) {
                    opened += move_table(&reference, &t, last);
                    opened += move_table(&under_test, &t, last);
                    samples += bad_samples(&t);
                    densities += bad_densities(&t);
                }
                worst = worst_octant(&t);
                octant = worst > octant ? worst : octant;
                worst = k == CDF ? excess : block_excess(&t);
                excess = worst > excess ? worst : excess;
            }
        CHECK(built == 12 && told == 6, "%s: %d of 12 builds, %d of 6 infos", name[k], built,
              told);
        CHECK(opened == 30, "%s: opened %d of 30 times, here and there", name[k], opened);
        CHECK(samples == 0, "%s: %d samples of any numbers are no good", name[k], samples);
        CHECK(densities == 0, "%s: %d densities or inverses of any directions", name[k],
              densities);
        CHECK(off < 6 * 5 * DRAWS / 500, "%s: %d of %d are not those of the reference", name[k],
              off, 6 * 5 * DRAWS);
        CHECK(octant < 6.0 && excess < 6.0, "%s: law: octants %.1f, blocks %.1f deviations",
              name[k], octant, excess);
    }
}

/* Tables of WARP, at both ends of their region. */
static void test_facing(void)
{
    int mapping, last, opened = 0, bad = 0, off = 0;

    for (mapping = 0; mapping < 3; mapping++) {
        envsamp_image map = make_map(mapping, 3);
        envsamp_kd_desc desc = description(mapping & 1);
        envsamp_kd_info info;
        made t;

        build_by(&reference, WARP, &map, &desc, &t);
        for (last = 0; last < 2; last++) {
            opened += move_table(&under_test, &t, last);
            under_test.info(WARP, t.table, &info);
            opened += info.facing != 0;
            bad += bad_facing((const envsamp_kd *)t.table);
            off += facing_deviations((const envsamp_kd *)t.table);
        }
    }
    CHECK(opened == 12 && bad == 0, "%d samples that face normals of any numbers are no good", bad);
    CHECK(off < 6 * 3 * DRAWS / 500, "%d of %d are not those of the reference", off, 6 * 3 * DRAWS);
}

/* ---- damaged tables ---- */

/* Puts NaN in each word of a small table in turn, with a checksum that fits. */
static void test_damage(void)
{
    static uint32_t copy[1 << 14];
    int k, differ = 0, words = 0, open = 0;

    for (k = 0; k < KINDS; k++) {
        envsamp_image map = make_map(0, 1);
        envsamp_kd_desc desc = description(1);
        void *to;
        size_t bytes, at;
        made t;

        map.pixels += 20 * WIDTH;               /* where nothing is black */
        map.width = map.height = 4;
        desc.block_count = 12;
        build_by(&reference, (kind)k, &map, &desc, &t);
        bytes = reference.bytes(t.kind, t.table);
        memcpy(copy, t.table, bytes);
        to = put(table_region, bytes, ENVSAMP_ALIGN, 1);
        for (at = 0; at < 2 * bytes / 4; at++) {
            const uint32_t nan = at & 1 ? 0xfff80000u : 0x7ff80000u;
            const void *opened, *wanted;
            uint32_t sum;

            memcpy(to, copy, bytes);
            memcpy((char *)to + at / 2 * 4, &nan, 4);
            if (k == CDF && at / 2 < 4 * 6)
                continue;                   /* the size, and what must fit it */
            if (k == CDF) {
                sum = envsamp__checksum(to);
                memcpy((char *)to + offsetof(envsamp_cdf, checksum), &sum, 4);
            } else if (at / 2 > 5) {            /* not the size */
                sum = envsamp__checksum(to);
                memcpy((char *)to + offsetof(envsamp_kd, checksum), &sum, 4);
            }
            words++;
            differ += (under_test.open(t.kind, to, bytes, &opened) == ENVSAMP_OK)
                   != (reference.open(t.kind, to, bytes, &wanted) == ENVSAMP_OK);
            open += wanted != NULL;
        }
    }
    CHECK(differ == 0 && open > 0 && open < words / 2,
          "%d of %d tables with a NaN are judged otherwise; %d pass", differ, words, open);
}

/* ---- maps of anything ---- */

/* Whether the weight of two densities, infinite ones too, is none. */
static int bad_weight(uint32_t a, uint32_t b)
{
    float weight;

    a &= 0x7fffffffu;
    b &= 0x7fffffffu;
    if (a > 0x7f800000u || b > 0x7f800000u)
        return 0;
    weight = under_test.mis_power(from_bits(a), from_bits(b));
    return !is_size(weight) || weight > 1.0f;
}

static void test_points(void)
{
    int mapping, i, k, bad = 0, looks = 0, weights = 0;

    for (mapping = 0; mapping < 3; mapping++) {
        envsamp_image map = make_map(mapping, 3);
        float *of[3], rgb[3];

        fill_inputs(TRIPLES, 3, of, SPECIAL * SPECIAL * SPECIAL);
        for (i = 0; i < TRIPLES; i++) {
            float dir[3], out[3];

            if (i < SPECIAL * SPECIAL || i >= TRIPLES - RANDOM) {
                under_test.uv_to_dir(map.mapping, of[0][i], of[1][i], out);
                bad += !good_dir(out);
                weights += bad_weight(to_bits(of[0][i]), to_bits(of[1][i]));
            }
            dir[0] = of[0][i];
            dir[1] = of[1][i];
            dir[2] = of[2][i];
            for (k = 0; k < 2; k++) {
                under_test.lookup(&map, k, dir, rgb);
                looks += !is_size(rgb[0]) || !is_size(rgb[1]) || !is_size(rgb[2]);
            }
        }
        for (i = looks == 0 ? 0 : DRAWS; i < DRAWS; i++) {
            float dir[3], want[3];

            reference.uv_to_dir(map.mapping, random_unit(), random_unit(), dir);
            under_test.lookup(&map, 0, dir, rgb);
            reference.lookup(&map, 0, dir, want);
            looks += !near((double)rgb[1] + 1.0, (double)want[1] + 1.0, 0.02);
        }
    }
    CHECK(bad == 0, "%d directions of any points", bad);
    CHECK(looks == 0, "%d lookups in any directions", looks);
    CHECK(weights == 0, "%d weights of any densities are not finite", weights);
}

/* The brightest pixels that there are, everywhere, or in all corners and on the edges. */
static void test_bright(void)
{
    static const float value[] = { 1e38f, 1.8e38f, 2.5e38f, 3.40282347e38f };
    int k, mapping, channels, i, spots, good = 0, all = 0;

    for (k = 0; k < KINDS; k++)
        for (i = 0; i < 4 * 3 * 2 * 2 * 2; i++) {
            envsamp_kd_desc desc = description(i / 4 % 2);
            envsamp_image map;
            envsamp_kd_info info;
            double area = 4.0 * 3.14159265358979323846, want = area * (double)value[i % 4];
            int x;
            made t;

            channels = 1 + 2 * (i / 8 % 2);
            spots = i / 16 % 2;
            mapping = i / 32;
            desc.importance_exponent = mapping > 0 ? 0.5f * (float)(mapping + 2) : 0.0f;
            map = make_map(mapping, channels);
            fill(&map, spots ? 1e30f : value[i % 4]);
            for (x = 0; x < TEXELS * channels && spots; x++)
                if (x / channels % WIDTH % (WIDTH - 1) == 0
                    && x / channels / WIDTH % (HEIGHT - 1) < 2)
                    *pixel(&map, x) = value[i % 4];
            want *= mapping == ENVSAMP_HEMISPHERE ? 0.5 : 1.0;
            all++;
            if (build_by(&under_test, (kind)k, &map, &desc, &t) != ENVSAMP_OK)
                continue;
            under_test.info(t.kind, t.table, &info);
            if (spots) {
                double told = info.integral;
                made r;

                if (!move_table(&under_test, &t, 1) || bad_samples(&t))
                    continue;
                build_by(&reference, (kind)k, &map, &desc, &r);
                reference.info(r.kind, r.table, &info);
                want = info.integral;
                info.integral = told;
            }
            good += is_finite_double(info.integral) && near(info.integral, want, 1e-4)
                 && is_finite_double(info.excess_variance) && is_finite_double(info.max_ratio)
                 && (spots || info.excess_variance < 1e-4) && move_table(&reference, &t, 1)
                 && move_table(&under_test, &t, 1);
        }
    CHECK(good == all, "%d of %d tables of the brightest pixels", good, all);
}

static void test_bad_pixels(void)
{
    static const uint32_t bad[] = { 0x7f800000u, 0xff800000u, 0x7f800001u, 0xffffffffu,
                                    0x7fc00000u, 0xbf800000u, 0x80000001u };
    int k, channels, i, counted = 0, refused = 0, all = 0;

    for (k = 0; k < KINDS + 1; k++)
        for (channels = 1; channels < 5; channels += 1 + (channels == 1))
            for (i = 0; i < 7; i++) {
                envsamp_image map = make_map(i % 3, channels);
                envsamp_kd_desc desc = description(i & 1);
                envsamp_lights_desc lights;
                envsamp_lights_info told;
                envsamp_light light[32];
                envsamp_buffer scratch;
                envsamp_kd_info info;
                made t;

                all++;
                *pixel(&map, channels * 7 + (channels > 1)) = from_bits(bad[i]);
                *pixel(&map, channels * (9 * WIDTH - 1)) = from_bits(bad[i]);
                *pixel(&map, channels * (TEXELS - 1)) = from_bits(bad[i]);
                if (k < KINDS) {
                    if (build_by(&under_test, (kind)k, &map, &desc, &t) == ENVSAMP_OK) {
                        under_test.info(t.kind, t.table, &info);
                        counted += info.bad_pixel_count == 3 && is_finite_double(info.integral);
                    }
                    desc.strict = 1;
                    refused += build_by(&under_test, (kind)k, &map, &desc, &t)
                            == ENVSAMP_ERR_VALUE;
                    continue;
                }
                memset(&lights, 0, sizeof lights);
                lights.method = (envsamp_lights_method)(i % 6);
                scratch.data = scratch_region;
                scratch.bytes = REGION;
                counted += under_test.lights(&map, &lights, light, 32, scratch, &told)
                        == ENVSAMP_OK && told.bad_pixel_count == 3;
                lights.strict = 1;
                refused += under_test.lights(&map, &lights, light, 32, scratch, &told)
                        == ENVSAMP_ERR_VALUE;
            }
    CHECK(counted == all, "bad pixels are counted in %d of %d maps", counted, all);
    CHECK(refused == all, "bad pixels are refused by strict in %d of %d maps", refused, all);
}

/* ---- settings ---- */

static const uint32_t no_number[] = { 0x7f800000u, 0xff800000u, 0x7f800001u, 0x7fc00000u,
                                      0xffc00000u, 0xffffffffu };

static void residuals_of(const double *params, double *residuals, void *user)
{
    residuals[0] = 10.0 * (params[1] - params[0] * params[0]);
    residuals[1] = 1.0 - params[0];
    if (user && params[0] > *(const double *)user)
        residuals[0] = (double)from_bits(0x7fc00000u);
}

static void test_lm(void)
{
    double memory[32], params[2], wall = 0.5;
    envsamp_buffer scratch;
    envsamp_lm_desc desc;
    envsamp_lm_info info;
    int i, k, refused = 0;

    scratch.data = scratch_region;
    scratch.bytes = sizeof memory;
    for (i = 0; i < 6; i++)
        for (k = 0; k < 7; k++) {
            double nan = (double)from_bits(no_number[i]);
            envsamp_result result;

            memset(&desc, 0, sizeof desc);
            desc.param_count = desc.residual_count = 2;
            params[0] = -1.2;
            params[1] = 1.0;
            *(k == 0 ? &desc.ftol : k == 1 ? &desc.xtol : k == 2 ? &desc.gtol
              : k == 3 ? &params[0] : k == 4 ? &params[1] : &memory[0]) = nan;
            wall = k == 5 ? -2.0 : k == 6 ? 0.5 : 9.0;
            result = under_test.lm(&desc, residuals_of, &wall, params, scratch, &info);
            if (k < 3 && i == 0)
                refused += result == ENVSAMP_OK;        /* an infinite tolerance is met at once */
            else if (k < 3)
                refused += result == ENVSAMP_ERR_PARAM;
            else if (k < 6)
                refused += result == ENVSAMP_ERR_VALUE;
            else
                refused += result == ENVSAMP_OK && params[0] <= 0.5 && params[0] > 0.4
                        && is_finite_double(params[1]) && is_finite_double(info.cost);
        }
    CHECK(refused == 6 * 7, "lm: %d of %d calls with what is no number", refused, 6 * 7);
    memset(&desc, 0, sizeof desc);
    desc.param_count = desc.residual_count = 2;
    params[0] = -1.2;
    params[1] = 1.0;
    i = under_test.lm(&desc, residuals_of, NULL, params, scratch, &info);
    CHECK(i == ENVSAMP_OK && info.converged && near(params[0], 1.0, 1e-6)
          && near(params[1], 1.0, 1e-6), "lm finds the minimum: %g, %g", params[0], params[1]);
}

static void test_settings(void)
{
    static envsamp_light light[32], out[32];
    static uint8_t mask[TEXELS];
    envsamp_image map = make_map(0, 3);
    envsamp_buffer scratch;
    int refused = 0, all = 0, turned = 0, i, k, method;

    scratch.data = scratch_region;
    scratch.bytes = REGION;
    for (i = 0; i < 6; i++) {
        const float nan = from_bits(no_number[i]);
        envsamp_lights_desc lights;

        for (k = 0; k < KINDS; k++)
            for (method = 0; method < 3; method++) {
                envsamp_kd_desc desc = description(0);
                made t;

                if (k == CDF && method == 1)
                    continue;
                *(method == 0 ? &desc.mis_compensation : method == 1 ? &desc.excess_target
                                                       : &desc.importance_exponent) = nan;
                all++;
                refused += build_by(&under_test, (kind)k, &map, &desc, &t) == ENVSAMP_ERR_PARAM;
            }
        for (method = 0; method < 6; method++)
            for (k = 0; k < 7; k++) {
                float *const field[] = { &lights.percentile, &lights.lambda, &lights.gamma,
                                         &lights.mask_scale, &lights.weight_variance,
                                         &lights.weight_extent, &lights.weight_energy };

                memset(&lights, 0, sizeof lights);
                lights.method = (envsamp_lights_method)method;
                *field[k] = nan;
                all++;
                refused += under_test.lights(&map, &lights, light, 32, scratch, NULL)
                        == ENVSAMP_ERR_PARAM;
                all += k < 3;
                refused += k < 3 && under_test.emissive_mask(&map, &lights, mask, scratch, NULL)
                        == ENVSAMP_ERR_PARAM;
            }
        memset(&lights, 0, sizeof lights);
        reference.lights(&map, &lights, light, 32, scratch, NULL);
        all++;
        refused += under_test.interleave(light, 32, 0, 1, nan, 1, out) == ENVSAMP_ERR_PARAM;
        for (k = 0; k < 32; k++)
            light[k].cos_extent = nan;
        turned += under_test.interleave(light, 32, 0, 2, 1.0f, 1, out) == ENVSAMP_OK;
        for (k = 0; k < 32; k++)
            turned += no_number[i] == 0xff800000u ? good_dir(out[k].dir)    /* as a cosine of -1 */
                                                  : near_dir(out[k].dir, light[k].dir, 1e-6);
    }
    CHECK(refused == all, "%d of %d settings that are no numbers are refused", refused, all);
    CHECK(turned == 6 * 33, "cones that are no numbers turn nothing: %d of %d", turned, 6 * 33);
}

/* ---- halftones and lights ---- */

static void test_halftone(void)
{
    static envsamp_texel texel[200];
    envsamp_image map = make_map(0, 1);
    envsamp_halftone_desc desc;
    envsamp_buffer scratch;
    double total = 0.0;
    int i, k, count, good = 0, refused = 0;

    scratch.data = scratch_region;
    scratch.bytes = REGION;
    for (i = 0; i < TEXELS; i++)
        total += (double)map.pixels[i];
    memset(&desc, 0, sizeof desc);
    desc.count = 200;
    for (i = 0; i < 24; i++) {
        int fine = 1, quarter[4] = { 0, 0, 0, 0 };

        desc.kernel = (envsamp_kernel)(i % 6);
        desc.scan = (envsamp_scan)(i / 6 % 2);
        desc.once = i / 12;
        fine = under_test.halftone(map.pixels, WIDTH, HEIGHT, 0, &desc, texel, 200, &count,
                                   scratch) == ENVSAMP_OK && count == 200;
        for (k = 0; k < count && fine; k++) {
            fine = texel[k].x >= 0 && texel[k].x < WIDTH && texel[k].y >= 0 && texel[k].y < HEIGHT;
            if (fine) {
                float value = map.pixels[texel[k].y * WIDTH + texel[k].x];

                fine = value > 0.0f && near((double)texel[k].probability, (double)value / total,
                                            1e-5);
                quarter[2 * (texel[k].y >= HEIGHT / 2) + (texel[k].x >= WIDTH / 2)]++;
            }
        }
        good += fine && quarter[1] > 10 && quarter[2] > 10 && quarter[3] > 10;
    }
    CHECK(good == 24, "halftones: %d of 24 are good", good);
    for (i = 0; i < 6; i++) {
        *pixel(&map, 5 * WIDTH + 11 * i) = from_bits(no_number[i]);
        refused += under_test.halftone(map.pixels, WIDTH, HEIGHT, 0, &desc, texel, 200, &count,
                                       scratch) == ENVSAMP_ERR_VALUE && count == 0;
        *pixel(&map, 5 * WIDTH + 11 * i) = 1.0f;
    }
    CHECK(refused == 6, "importance that is no number is refused %d of 6 times", refused);
}

/* Lights of every method, of a map as it is and of the brightest. */
static void test_lights(void)
{
    static envsamp_light light[32];
    static uint8_t mask[TEXELS], want[TEXELS];
    envsamp_buffer scratch;
    int i, k, c, good = 0, masks = 0;

    scratch.data = scratch_region;
    scratch.bytes = REGION;
    for (i = 0; i < 36; i++) {
        envsamp_image map = make_map(i / 6 % 3, 3);
        envsamp_lights_desc desc;
        envsamp_lights_info info, told;
        double sum[3] = { 0.0, 0.0, 0.0 };
        int fine = 1, off = 0;
        float a, b;

        memset(&desc, 0, sizeof desc);
        desc.method = (envsamp_lights_method)(i % 6);
        for (k = 0; k < 3 * TEXELS && i >= 18; k++)
            *pixel(&map, k) = k % 7 ? 1e36f : 3e38f;
        fine = reference.lights(&map, &desc, light, 32, scratch, &info) == ENVSAMP_OK
            && under_test.lights(&map, &desc, light, 32, scratch, &told) == ENVSAMP_OK;
        for (k = 0; k < 32; k++) {
            fine = fine && good_dir(light[k].dir) && is_size(light[k].solid_angle)
                && is_finite(light[k].cos_extent);
            for (c = 0; c < 3; c++) {
                fine = fine && is_size(light[k].irradiance[c]);
                sum[c] += (double)light[k].irradiance[c];
            }
        }
        for (c = 0; c < 3; c++)
            fine = fine && near(told.integral[c], info.integral[c], 1e-9)
                && (i >= 18 || near(sum[c], info.integral[c], 1e-5));
        good += fine && told.bad_pixel_count == 0;
        masks += reference.emissive_mask(&map, &desc, want, scratch, &b) == ENVSAMP_OK
              && under_test.emissive_mask(&map, &desc, mask, scratch, &a) == ENVSAMP_OK
              && near((double)a, (double)b, 1e-5);
        for (k = 0; k < TEXELS; k++)
            off += mask[k] != want[k];
        masks -= off > TEXELS / 100;
    }
    CHECK(good == 36, "lights: %d of 36 sets are good", good);
    CHECK(masks == 36, "%d of 36 masks are those of the reference", masks);
}

/* None at all, of which there is no address either. */
static void test_none(void)
{
    float *const of[6] = { NULL, NULL, NULL, NULL, NULL, NULL };
    envsamp_image map = make_map(0, 1);
    envsamp_kd_desc desc = description(0);
    int k;

    for (k = 0; k < KINDS; k++) {
        made t;

        build_by(&reference, (kind)k, &map, &desc, &t);
        under_test.sample_n(t.kind, t.table, 0, of);
        under_test.pdf_n(t.kind, t.table, 0, of);
    }
    CHECK(1, "batches of none return");
}

int main(void)
{
    int i;

    table_region = make_region();
    map_region = make_region();
    scratch_region = make_region();
    for (i = 0; i < 3; i++)
        input_region[i] = make_region();
    test_tables();
    test_facing();
    test_none();
    test_damage();
    test_points();
    test_bright();
    test_bad_pixels();
    test_settings();
    test_lm();
    test_halftone();
    test_lights();
    return check_done();
}

#endif
