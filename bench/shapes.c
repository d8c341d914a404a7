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

#include "../tests/sampler.h"
#define ROUND_COUNT 3
#include "timing.h"

#include <stdio.h>

enum { HALFTONE = SAMPLER_KINDS, LIGHTS, JOBS = LIGHTS + 6 };

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
    float *pixels = (float *)kd_allocate((size_t)width * (size_t)height * sizeof *pixels);
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
    scratch.data = kd_allocate(scratch.bytes);
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
    scratch.data = kd_allocate(scratch.bytes);
    if (envsamp_halftone(view->pixels, view->width, view->height, 0, &desc, texels, 4096, &count,
                         scratch) != ENVSAMP_OK)
        fail("halftone");
    free(scratch.data);
}

/* Milliseconds without memory being got for the first time. */
static double time_job(const envsamp_image *view, int job)
{
    double best = 1e30, start;
    sampler_request request = sampler_ask(job, view, 6144);
    sampler s;
    int i;

    request.bilinear = 1;
    if (job < HALFTONE)
        sampler_prepare(&s, &request, 1);
    for (i = 0; i < 3; i++) {
        start = seconds();
        if (job < HALFTONE && sampler_build(&s) != ENVSAMP_OK)
            fail(envsamp_result_string(s.result));
        if (job == HALFTONE)
            run_halftone(view);
        if (job >= LIGHTS)
            run_lights(view, job - LIGHTS);
        best = fmin(best, 1e3 * (seconds() - start));
    }
    if (job < HALFTONE)
        sampler_free(&s);
    return best;
}

int main(void)
{
    double first[JOBS];
    int i, k;

    printf("%-12s", "");
    for (k = 0; k < JOBS; k++)
        printf("%14s", names[k]);
    printf("\n");
    for (i = 0; i < SIZES; i++) {
        float *pixels = make_sky(sizes[i][0], sizes[i][1]);
        const envsamp_image view = kd_image(pixels, sizes[i][0], sizes[i][1], 1);

        printf("%5dx%-6d", sizes[i][0], sizes[i][1]);
        for (k = 0; k < JOBS; k++) {
            const double time = time_job(&view, k);

            if (sizes[i][0] == 2 * sizes[i][1])
                first[k] = time;
            printf("%8.1f %4.1fx", time, time / first[k]);
            fflush(stdout);
        }
        printf("\n");
        free(pixels);
    }
    return 0;
}
