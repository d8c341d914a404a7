/* test_alignment.c: buffers at any multiple of 8 bytes, which malloc gives on every machine: every
 * family builds in them, tables open there, and all bits are those of buffers aligned to 64. What is
 * not aligned to ENVSAMP_ALIGN is refused by all.
 */
#include "../envsamp.h"
#include "../examples/common/random.h"
#include "check.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 61, HEIGHT = 37, POINTS = 600, LIGHTS = 24, TABLE = 0, SCRATCH = 1 };

/* What one build gave: the bytes of a table, or of results. */
typedef struct outcome { envsamp_result result; size_t bytes; unsigned char *data; } outcome;

typedef struct area { unsigned char *block; envsamp_buffer buffer; } area;

static float pixels[3 * WIDTH * HEIGHT];
static envsamp_image map = { pixels, WIDTH, HEIGHT, 3, 0, ENVSAMP_LATLONG };

/* A buffer that begins so many bytes after a multiple of 64, with something before and after it. */
static area area_make(size_t bytes, size_t off)
{
    area a;

    a.block = (unsigned char *)malloc(bytes + 192);
    if (!a.block) {
        printf("Bail out! out of memory\n");
        exit(1);
    }
    memset(a.block, 0xa5, bytes + 192);
    a.buffer.data = a.block + (64 - (uintptr_t)a.block % 64) + off;
    a.buffer.bytes = bytes;
    return a;
}

/* Frees it; returns whether nothing was written around it. */
static int area_free(area *a)
{
    unsigned char *start = (unsigned char *)a->buffer.data, *end = start + a->buffer.bytes;
    unsigned char *at;
    int intact = 1;

    for (at = a->block; at < a->block + a->buffer.bytes + 192; at++)
        intact &= (at >= start && at < end) || *at == 0xa5;
    free(a->block);
    return intact;
}

static void keep(outcome *o, const void *data, size_t bytes)
{
    o->data = (unsigned char *)realloc(o->data, o->bytes + bytes);
    if (!o->data) {
        printf("Bail out! out of memory\n");
        exit(1);
    }
    memcpy(o->data + o->bytes, data, bytes);
    o->bytes += bytes;
}

/* Samples, densities and inverses of a table, one at a time and together. */
static void keep_samples(outcome *o, const envsamp_kd *kd, const envsamp_cdf *cdf)
{
    static float u[2][POINTS], xyz[3][POINTS], pdf[2][POINTS], back[2];
    pcg32 random = pcg32_make(11, 3);
    int i;

    for (i = 0; i < POINTS; i++) {
        envsamp_sample s;
        float single;

        u[0][i] = pcg32_float(&random);
        u[1][i] = pcg32_float(&random);
        s = kd ? envsamp_kd_sample(kd, u[0][i], u[1][i]) : envsamp_cdf_sample(cdf, u[0][i], u[1][i]);
        single = kd ? envsamp_kd_pdf(kd, s.dir) : envsamp_cdf_pdf(cdf, s.dir);
        if (kd)
            envsamp_kd_invert(kd, s.dir, back);
        else
            envsamp_cdf_invert(cdf, s.dir, back);
        keep(o, &s, sizeof s);
        keep(o, &single, sizeof single);
        keep(o, back, sizeof back);
    }
    if (kd) {
        envsamp_kd_sample_n(kd, POINTS, u[0], u[1], xyz[0], xyz[1], xyz[2], pdf[0]);
        envsamp_kd_pdf_n(kd, POINTS, xyz[0], xyz[1], xyz[2], pdf[1]);
    } else {
        envsamp_cdf_sample_n(cdf, POINTS, u[0], u[1], xyz[0], xyz[1], xyz[2], pdf[0]);
        envsamp_cdf_pdf_n(cdf, POINTS, xyz[0], xyz[1], xyz[2], pdf[1]);
    }
    keep(o, xyz, sizeof xyz);
    keep(o, pdf, sizeof pdf);
}

static envsamp_result table_sizes(int kind, envsamp_kd_desc *desc, envsamp_sizes *sizes)
{
    *desc = envsamp_kd_defaults();
    desc->block_count = 300;
    desc->select = (envsamp_kd_select)(kind % 3);
    return kind < 3 ? envsamp_kd_sizes(&map, desc, sizes) : envsamp_cdf_sizes(&map, NULL, sizes);
}

/* A table of kind 0 to 3, from buffers that are `off[0]` and `off[1]` bytes off, opened again in a
   copy as far off as the table was. */
static int run_table(int kind, const size_t off[2], outcome *o)
{
    envsamp_kd_desc desc;
    envsamp_sizes sizes = { 0, 0 };
    area table, scratch, copy;
    const envsamp_kd *kd = NULL;
    const envsamp_cdf *cdf = NULL;
    size_t bytes = 0;
    int intact;

    table_sizes(kind, &desc, &sizes);
    table = area_make(sizes.table_bytes, off[TABLE]);
    scratch = area_make(sizes.scratch_bytes, off[SCRATCH]);
    copy = area_make(sizes.table_bytes, off[TABLE]);
    o->result = kind < 3 ? envsamp_kd_build(&map, &desc, table.buffer, scratch.buffer, &kd)
                         : envsamp_cdf_build(&map, NULL, table.buffer, scratch.buffer, &cdf);
    if (o->result == ENVSAMP_OK) {
        bytes = kd ? envsamp_kd_bytes(kd) : envsamp_cdf_bytes(cdf);
        memcpy(copy.buffer.data, table.buffer.data, bytes);
        keep(o, copy.buffer.data, bytes);
        o->result = kd ? envsamp_kd_open(copy.buffer.data, bytes, &kd)
                       : envsamp_cdf_open(copy.buffer.data, bytes, &cdf);
    }
    if (o->result == ENVSAMP_OK)
        keep_samples(o, kd, cdf);
    intact = area_free(&table) & area_free(&scratch) & area_free(&copy);
    return intact;
}

/* Lights by method 0 to 5 and a mask; which of them is `kind`. */
static int run_lights(int kind, const size_t off[2], outcome *o)
{
    static envsamp_light lights[LIGHTS];
    static uint8_t mask[WIDTH * HEIGHT];
    envsamp_lights_desc desc = envsamp_lights_defaults();
    envsamp_sizes sizes = { 0, 0 };
    area scratch;

    desc.count = LIGHTS;
    desc.method = kind < 6 ? (envsamp_lights_method)kind : ENVSAMP_LIGHTS_DECOMPOSED;
    envsamp_lights_sizes(&map, &desc, &sizes);
    scratch = area_make(sizes.scratch_bytes, off[SCRATCH]);
    o->result = kind < 6 ? envsamp_lights(&map, &desc, lights, LIGHTS, scratch.buffer, NULL)
                         : envsamp_emissive_mask(&map, &desc, mask, scratch.buffer, NULL);
    if (o->result == ENVSAMP_OK && kind < 6)
        keep(o, lights, sizeof lights);
    else if (o->result == ENVSAMP_OK)
        keep(o, mask, sizeof mask);
    return area_free(&scratch);
}

static int run_halftone(int kind, const size_t off[2], outcome *o)
{
    static envsamp_texel texels[LIGHTS];
    envsamp_halftone_desc desc;
    envsamp_sizes sizes = { 0, 0 };
    area scratch;
    int count = 0;

    memset(&desc, 0, sizeof desc);
    desc.count = LIGHTS;
    desc.kernel = (envsamp_kernel)kind;
    desc.scan = ENVSAMP_SCAN_TEXELS;
    envsamp_halftone_sizes(3 * WIDTH, HEIGHT, &desc, &sizes);
    scratch = area_make(sizes.scratch_bytes, off[SCRATCH]);
    o->result = envsamp_halftone(pixels, 3 * WIDTH, HEIGHT, 0, &desc, texels, LIGHTS, &count,
                                 scratch.buffer);
    if (o->result == ENVSAMP_OK)
        keep(o, texels, (size_t)count * sizeof *texels);
    return area_free(&scratch);
}

/* A fit of a exp(b x) to a few points. */
static void residuals_of(const double *params, double *residuals, void *user)
{
    int i;

    (void)user;
    for (i = 0; i < 9; i++)
        residuals[i] = params[0] * exp(params[1] * i) - (2.0 + i % 3) * exp(-0.3 * i);
}

static int run_lm(int kind, const size_t off[2], outcome *o)
{
    envsamp_lm_desc desc = { 2, 9, 0, 0.0, 0.0, 0.0 };
    double params[2] = { 1.0, 0.0 };
    area scratch = area_make(envsamp_lm_scratch_bytes(&desc), off[SCRATCH]);

    (void)kind;
    o->result = envsamp_lm(&desc, residuals_of, NULL, params, scratch.buffer, NULL);
    keep(o, params, sizeof params);
    return area_free(&scratch);
}

/* Buffers 8 and 24 bytes off give what those at multiples of 64 do; 1 to 7 off are refused. */
static void try_family(const char *name, int (*run)(int, const size_t *, outcome *), int kind,
                       int has_table)
{
    outcome even = { ENVSAMP_OK, 0, NULL };
    size_t off[2] = { 0, 0 };
    int same = run(kind, off, &even) && even.result == ENVSAMP_OK && even.bytes > 0, refused = 0, i;

    for (i = 1; i < 4; i++) {
        outcome o = { ENVSAMP_OK, 0, NULL };

        off[TABLE] = i & 1 ? 8 : 0;
        off[SCRATCH] = i & 2 ? 24 : 0;
        same &= run(kind, off, &o) && o.result == ENVSAMP_OK && o.bytes == even.bytes
             && !memcmp(o.data, even.data, o.bytes);
        free(o.data);
    }
    for (i = 1; i < 8; i++) {
        outcome o = { ENVSAMP_OK, 0, NULL };

        off[TABLE] = 0;
        off[SCRATCH] = (size_t)i;
        refused += run(kind, off, &o) && o.result == ENVSAMP_ERR_ALIGN;
        off[TABLE] = (size_t)i;
        off[SCRATCH] = 0;
        refused += has_table && run(kind, off, &o) && o.result == ENVSAMP_ERR_ALIGN;
        free(o.data);
    }
    CHECK(same, "%s %d: the same bits 8 bytes off", name, kind);
    CHECK(refused == (has_table ? 14 : 7), "%s %d: %d buffers out of alignment are refused", name,
          kind, refused);
    free(even.data);
}

int main(void)
{
    pcg32 random = pcg32_make(5, 9);
    int i;

    for (i = 0; i < 3 * WIDTH * HEIGHT; i++)
        pixels[i] = pcg32_float(&random) + (i / 3 == 900 ? 400.0f : 0.0f);
    for (i = 0; i < 4; i++)
        try_family(i < 3 ? "kd" : "cdf", run_table, i, 1);
    for (i = 0; i < 7; i++)
        try_family(i < 6 ? "lights" : "mask", run_lights, i, 0);
    for (i = 0; i < 6; i++)
        try_family("halftone", run_halftone, i, 0);
    try_family("lm", run_lm, 0, 0);
    return check_done();
}
