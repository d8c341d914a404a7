/* shapes.c: what builds of long maps take, beside those of as many texels at 2 to 1.
 *
 *     shapes     a table on stdout; a minute or two
 *
 * Milliseconds of the fastest of three builds, and over that at 2 to 1. A sky with some noise.
 *
 * -DHEADER='"path"' takes another envsamp.h, of which version 0.2 is asked.
 */
#define _POSIX_C_SOURCE 200809L
#ifndef HEADER
#define HEADER "../envsamp.h"
#endif
#define ENVSAMP_IMPLEMENTATION
#include HEADER

#include "../examples/common/progress.h"
#include "../examples/common/random.h"
#include "table.h"
#define ROUND_COUNT 3
#include "timing.h"

#include <math.h>
#include <stdio.h>

enum { CDF = 3, HALFTONE, LIGHTS, JOBS = LIGHTS + 6 };

static const char *const names[JOBS] = {
    "WARP", "ALIAS", "FIT", "cdf", "halftone", "relaxed", "decomp.", "median", "variance",
    "l.halft.", "random"
};

/* Sizes of as many texels; the first of each are at 2 to 1. */
static const int sizes[][2] = {
    { 4096, 2048 }, { 2896, 2896 }, { 512, 16384 }, { 16384, 512 }, { 128, 65535 }, { 65535, 128 },
    { 1448, 724 }, { 1024, 1024 }, { 16, 65535 }, { 65535, 16 },
    { 362, 181 }, { 256, 256 }, { 1, 65535 }, { 65535, 1 }
};

#define SIZES ((int)(sizeof sizes / sizeof sizes[0]))

static void fail(const char *what)
{
    fprintf(stderr, "shapes: %s\n", what);
    exit(1);
}

static float *make_sky(int width, int height)
{
    float *pixels = (float *)bench_allocate((size_t)width * (size_t)height * sizeof *pixels);
    pcg32 random = pcg32_make(94, 0);
    int x, y;

    for (y = 0; y < height; y++)
        for (x = 0; x < width; x++)
            pixels[(size_t)y * (size_t)width + (size_t)x]
                = (1.0f - 0.7f * (float)y / (float)height) * (0.8f + 0.4f * pcg32_float(&random));
    return pixels;
}

static void run_lights(const envsamp_image *view, int method)
{
    envsamp_lights_desc desc = envsamp_lights_defaults();
    static envsamp_light lights[32];
    envsamp_sizes bytes;
    envsamp_buffer scratch;

    desc.method = (envsamp_lights_method)method;
    if (envsamp_lights_sizes(view, &desc, &bytes) != ENVSAMP_OK)
        fail("sizes of lights");
    scratch.bytes = bytes.scratch_bytes;
    scratch.data = bench_allocate(scratch.bytes);
    if (envsamp_lights(view, &desc, lights, 32, scratch, NULL) != ENVSAMP_OK)
        fail("lights");
    free(scratch.data);
}

static void run_halftone(const envsamp_image *view)
{
    static envsamp_texel texels[4096];
    envsamp_halftone_desc desc;
    envsamp_sizes bytes;
    envsamp_buffer scratch;
    int count;

    memset(&desc, 0, sizeof desc);
    desc.count = 1024;
    if (envsamp_halftone_sizes(view->width, view->height, &desc, &bytes) != ENVSAMP_OK)
        fail("sizes of halftones");
    scratch.bytes = bytes.scratch_bytes;
    scratch.data = bench_allocate(scratch.bytes);
    if (envsamp_halftone(view->pixels, view->width, view->height, 0, &desc, texels, 4096, &count,
                         scratch) != ENVSAMP_OK)
        fail("halftone");
    free(scratch.data);
}

/* Buffers of a kd table, by its number as in envsamp_kd_select, or of a cdf. */
typedef struct builder { envsamp_buffer table, scratch; } builder;

static builder builder_make(const envsamp_image *view, int job)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_sizes bytes;
    builder b;

    desc.select = (envsamp_kd_select)job;
    if ((job == CDF ? envsamp_cdf_sizes(view, NULL, &bytes)
                    : envsamp_kd_sizes(view, &desc, &bytes)) != ENVSAMP_OK)
        fail("sizes of tables");
    b.table.data = bench_allocate(b.table.bytes = bytes.table_bytes);
    b.scratch.data = bench_allocate(b.scratch.bytes = bytes.scratch_bytes);
    return b;
}

static void run_build(const builder *b, const envsamp_image *view, int job)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    const envsamp_kd *kd;
    const envsamp_cdf *cdf;

    desc.select = (envsamp_kd_select)job;
    if ((job == CDF ? envsamp_cdf_build(view, NULL, b->table, b->scratch, &cdf)
                    : envsamp_kd_build(view, &desc, b->table, b->scratch, &kd)) != ENVSAMP_OK)
        fail(names[job]);
}

/* Milliseconds without memory being got for the first time. */
static double time_job(const envsamp_image *view, int job)
{
    builder b = {{NULL, 0}, {NULL, 0}};
    double best = 1e30;
    int i;

    if (job < HALFTONE)
        b = builder_make(view, job);
    for (i = 0; i < 3; i++) {
        const double start = seconds();

        if (job < HALFTONE)
            run_build(&b, view, job);
        else if (job == HALFTONE)
            run_halftone(view);
        else
            run_lights(view, job - LIGHTS);
        best = fmin(best, 1e3 * (seconds() - start));
    }
    free(b.table.data);
    free(b.scratch.data);
    return best;
}

int main(void)
{
    progress shown = progress_start("shapes");
    double first[JOBS], times[JOBS];
    int i, k;

    printf("%-12s", "");
    for (k = 0; k < JOBS; k++)
        printf("%14s", names[k]);
    printf("\n");
    for (i = 0; i < SIZES; i++) {
        float *pixels = make_sky(sizes[i][0], sizes[i][1]);
        envsamp_image view;

        memset(&view, 0, sizeof view);
        view.pixels = pixels;
        view.width = sizes[i][0];
        view.height = sizes[i][1];
        view.channels = 1;
        for (k = 0; k < JOBS; k++) {
            progress_show(&shown, (double)(JOBS * i + k) / (SIZES * JOBS), names[k]);
            times[k] = time_job(&view, k);
            if (sizes[i][0] == 2 * sizes[i][1])
                first[k] = times[k];
        }
        progress_end(&shown);
        printf("%5dx%-6d", sizes[i][0], sizes[i][1]);
        for (k = 0; k < JOBS; k++)
            printf("%8.1f %4.1fx", times[k], times[k] / first[k]);
        printf("\n");
        fflush(stdout);
        free(pixels);
    }
    return 0;
}
