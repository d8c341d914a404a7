/* Irradiance of a surface that faces up, under a small sky with a sun. Link libm. */
#define ENVSAMP_IMPLEMENTATION
#include "envsamp.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define WIDTH 256
#define HEIGHT 128
#define SAMPLE_COUNT 4096

static const float pi = 3.14159265f;
static float sky[WIDTH * HEIGHT]; /* luminance; row 0 at the zenith, +z */

static double make_sky(void) /* returns its irradiance, as a sum over texels */
{
    double step = (double)pi / HEIGHT, sum = 0.0;

    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        int x = i % WIDTH, y = i / WIDTH, sun = x / 2 == 45 && y / 2 == 15;
        double north = sin(step * y), south = sin(step * (y + 1));

        sky[i] = sun ? 20000.0f : y < HEIGHT / 2 ? 1.0f + 0.02f * (float)y : 0.1f;
        if (y < HEIGHT / 2)
            sum += (double)(sky[i] * pi) / WIDTH * (south * south - north * north);
    }
    return sum;
}

int main(void)
{
    double exact = make_sky(), sum = 0.0, mis = 0.0;
    envsamp_image image = { sky, WIDTH, HEIGHT, 1, 0, ENVSAMP_LATLONG };
    envsamp_sizes sizes;
    envsamp_buffer table, scratch;
    const envsamp_kd *kd;

    envsamp_kd_sizes(&image, NULL, &sizes); /* the build repeats what fails here */
    table.data = malloc(table.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    envsamp_result result = envsamp_kd_build(&image, NULL, table, scratch, &kd);
    free(scratch.data);
    for (int i = 0; i < SAMPLE_COUNT && result == ENVSAMP_OK; i++) {
        float u0 = (float)fmod(0.75487767 * i, 1.0), u1 = (float)fmod(0.56984029 * i, 1.0);
        envsamp_sample s = envsamp_kd_sample(kd, u0, u1); /* a direction that the sky chose */
        float cosine = s.dir[2] > 0.0f ? s.dir[2] : 0.0f, dir[3], light[3];

        envsamp_lookup(&image, 0, s.dir, light); /* bilinear, for which tables are made */
        sum += (double)(light[0] * cosine / s.pdf);
        mis += (double)(light[0] * cosine / s.pdf * envsamp_mis_power(s.pdf, cosine / pi));
        envsamp_uv_to_dir(ENVSAMP_LATLONG, u0, acosf(sqrtf(u1)) / pi, dir); /* the surface's */
        envsamp_lookup(&image, 0, dir, light);
        mis += (double)(light[0] * pi * envsamp_mis_power(dir[2] / pi, envsamp_kd_pdf(kd, dir)));
    }
    printf("%s: irradiance %.4f, with MIS %.4f, of texels %.4f\n", envsamp_result_string(result),
           sum / SAMPLE_COUNT, mis / SAMPLE_COUNT, exact);
    free(table.data);
    return result != ENVSAMP_OK;
}
