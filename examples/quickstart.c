/* quickstart.c: the light that fog scatters under a map, by samples of the map and by multiple
 * importance sampling.
 *
 *     cc examples/quickstart.c examples/common/image.c examples/common/hdr.c -lm -o quickstart
 *     ./quickstart sky.hdr
 *
 * Without a file it makes a sky with a sun. The fog scatters evenly to all sides: its phase
 * function is in the place of BRDF x cosine. The ground hides the lower half of the map. Prints the
 * radiance by both ways, and by a sum over the map.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "common/load.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define SAMPLE_COUNT 4096

static const float even = 0.25f / 3.14159265f;  /* density of all directions alike, per steradian */

static const float *f(const float dir[3])
{
    static const float phase[3] = { 0.25f / 3.14159265f, 0.25f / 3.14159265f, 0.25f / 3.14159265f };

    (void)dir;                                  /* your BRDF x cosine depends on it */
    return phase;
}

static float visible(const float dir[3])        /* your ray into the scene */
{
    return dir[2] > 0.0f ? 1.0f : 0.0f;
}

static float *make_sky(int *width, int *height)
{
    float *rgb = (float *)malloc(256 * 128 * 3 * sizeof *rgb);

    *width = 256;
    *height = 128;
    for (int i = 0; i < 256 * 128 * 3 && rgb; i++) {
        int x = i / 3 % 256, y = i / 3 / 256, sun = x / 2 == 45 && y / 2 == 15;

        rgb[i] = sun ? 20000.0f : y < 64 ? 1.0f + 0.3f * (float)(i % 3) : 0.1f;
    }
    if (!rgb)
        fprintf(stderr, "out of memory\n");
    return rgb;
}

/* Luminance over directions that are spread evenly. */
static double sum_over_map(const envsamp_image *image)
{
    const int side = 2048;
    double sum = 0.0;

    for (int i = 0; i < side * side; i++) {
        float u = ((float)(i % side) + 0.5f) / (float)side, dir[3], rgb[3];

        envsamp_uv_to_dir(ENVSAMP_OCTAHEDRAL, u, ((float)(i / side) + 0.5f) / (float)side, dir);
        envsamp_lookup(image, 0, dir, rgb);
        sum += (double)(envsamp_luminance(rgb) * visible(dir));
    }
    return sum / side / side;                   /* phase function x solid angle is 1 over them */
}

int main(int argc, char **argv)
{
    int width, height;
    float *pixels = argc > 1 ? load_map(argv[1], &width, &height) : make_sky(&width, &height);
    float radiance[3] = { 0.0f, 0.0f, 0.0f }, mis = 0.0f, rgb[3], bsdf_dir[3];

    if (!pixels)
        return 1;
    envsamp_image image = { pixels, width, height, 3, 0, ENVSAMP_LATLONG };
    envsamp_sizes sizes;
    envsamp_buffer table, scratch;
    const envsamp_kd *kd;

    envsamp_kd_sizes(&image, NULL, &sizes);     /* NULL: the defaults; the build repeats errors */
    table.data = malloc(table.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    envsamp_result result = envsamp_kd_build(&image, NULL, table, scratch, &kd);
    free(scratch.data);
    if (result != ENVSAMP_OK) {
        printf("%s\n", envsamp_result_string(result));
        free(table.data);
        free(pixels);
        return 1;
    }
    for (int i = 0; i < SAMPLE_COUNT; i++) {
        float u0 = (float)fmod(0.75487767 * i, 1.0), u1 = (float)fmod(0.56984029 * i, 1.0);

        envsamp_sample s = envsamp_kd_sample(kd, u0, u1);           /* a direction of the map */
        envsamp_uv_to_dir(ENVSAMP_OCTAHEDRAL, u1, u0, bsdf_dir);    /* one of the fog */
        float pdf = envsamp_kd_pdf(kd, bsdf_dir);
        envsamp_lookup(&image, 0, s.dir, rgb);
        for (int c = 0; c < 3; c++)
            radiance[c] += f(s.dir)[c] * rgb[c] * visible(s.dir) / s.pdf;
        mis += envsamp_luminance(rgb) * even * visible(s.dir) / s.pdf
             * envsamp_mis_power(s.pdf, even);
        envsamp_lookup(&image, 0, bsdf_dir, rgb);
        mis += envsamp_luminance(rgb) * visible(bsdf_dir) * envsamp_mis_power(even, pdf);
    }
    printf("samples of the map %.5g, with MIS %.5g, sum over the map %.5g\n",
           (double)envsamp_luminance(radiance) / SAMPLE_COUNT, (double)mis / SAMPLE_COUNT,
           sum_over_map(&image));
    free(table.data);
    free(pixels);
    return 0;
}
