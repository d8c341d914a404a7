/* path_tracer.c: paths on a sphere and a plane under a map, by multiple importance sampling.
 *
 *     path_tracer MAP OUTPUT.png [SAMPLES] [ALBEDO]
 *
 * MAP is a file, or a made-up map by name (see common/maps.h). At every point a path draws one
 * direction of the map and one of the diffuse surface, and weighs both by the power heuristic.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"
#include "common/image.h"
#include "common/maps.h"
#include "common/placement.h"
#include "common/random.h"

#include <stdio.h>
#include <stdlib.h>

#define WIDTH 240
#define HEIGHT 180
#define PI 3.14159265f

static float dot(const float a[3], const float b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* A unit sphere on the plane z = 0. Returns 0 where a ray meets neither. */
static int trace(const float from[3], const float dir[3], float at[3], float normal[3])
{
    const float to[3] = { from[0], from[1], from[2] - 1.0f }, b = dot(to, dir);
    const float root = b * b - dot(to, to) + 1.0f, plane = -from[2] / dir[2];
    const float sphere = -b - sqrtf(fmaxf(root, 0.0f));
    const int on_ball = root > 0.0f && sphere > 1e-3f && !(plane > 1e-3f && plane < sphere);

    if (!on_ball && !(plane > 1e-3f))
        return 0;
    for (int k = 0; k < 3; k++) {
        at[k] = from[k] + (on_ball ? sphere : plane) * dir[k];
        normal[k] = on_ball ? at[k] - (k == 2 ? 1.0f : 0.0f) : k == 2 ? 1.0f : 0.0f;
    }
    return 1;
}

/* A direction with a density of cosine / PI, of which albedo times is BRDF x cosine: the normal
   plus a point of the unit sphere. */
static void draw_cosine(const float normal[3], pcg32 *random, float dir[3])
{
    const float z = 1.0f - 2.0f * pcg32_float(random), r = sqrtf(fmaxf(1.0f - z * z, 0.0f));
    const float phi = 2.0f * PI * pcg32_float(random);
    float sum[3] = { normal[0] + r * cosf(phi), normal[1] + r * sinf(phi), normal[2] + z };
    const float length = sqrtf(dot(sum, sum));

    for (int k = 0; k < 3; k++)
        dir[k] = length > 1e-6f ? sum[k] / length : normal[k];
}

/* Adds the light of one path, which begins with a ray: from and dir change. */
static void add_path(const environment *sky, float albedo, float from[3], float dir[3],
                     pcg32 *random, float rgb[3])
{
    float through = 1.0f, pdf = 0.0f, radiance[3], at[3], normal[3], other[3];

    for (int bounce = 0; bounce < 100; bounce++) {
        if (!trace(from, dir, at, normal)) {        /* the surface's direction meets the map */
            environment_radiance(sky, dir, radiance);
            through *= bounce ? envsamp_mis_power(pdf, environment_pdf(sky, dir)) : 1.0f;
            for (int c = 0; c < 3; c++)
                rgb[c] += through * radiance[c];
            return;
        }
        const float u0 = pcg32_float(random);
        const environment_light light = environment_sample(sky, u0, pcg32_float(random));

        through *= albedo;
        pdf = fmaxf(dot(normal, light.dir), 0.0f) / PI;
        if (pdf > 0.0f && !trace(at, light.dir, from, other))
            for (int c = 0; c < 3; c++)             /* the map's direction meets nothing else */
                rgb[c] += through * pdf * light.radiance[c] / light.pdf
                        * envsamp_mis_power(light.pdf, pdf);
        draw_cosine(normal, random, dir);
        pdf = fmaxf(dot(normal, dir), 0.0f) / PI;
        memcpy(from, at, sizeof at);
    }
}

static int render(const environment *sky, float albedo, int samples, const char *path, char *error)
{
    static float rgb[3 * WIDTH * HEIGHT];
    static unsigned char srgb[3 * WIDTH * HEIGHT];
    const image picture = { WIDTH, HEIGHT, rgb };
    pcg32 random = pcg32_make(1, 0);
    double mean = 0.0;

    for (int i = 0; i < WIDTH * HEIGHT * samples; i++) {
        const int pixel = i / samples, x = pixel % WIDTH, y = pixel / WIDTH;
        float from[3] = { -5.0f, 0.0f, 2.0f }, sum[3] = { 0.0f, 0.0f, 0.0f };
        float dir[3] = { 1.0f, 0.4f - 0.8f * ((float)x + pcg32_float(&random)) / WIDTH,
                         0.15f - 0.6f * ((float)y + pcg32_float(&random)) / HEIGHT };
        const float length = sqrtf(dot(dir, dir));

        for (int k = 0; k < 3; k++)
            dir[k] /= length;
        add_path(sky, albedo, from, dir, &random, sum);
        for (int c = 0; c < 3; c++)
            rgb[3 * pixel + c] += sum[c] / (float)samples;
        mean += (double)(sum[0] + sum[1] + sum[2]) / (3.0 * WIDTH * HEIGHT * samples);
    }
    printf("mean of the picture %.4f\n", mean);
    image_tonemap(&picture, 1.0f, srgb);
    return image_write_png(path, WIDTH, HEIGHT, srgb, error, 512);
}

static const envsamp_kd *build(const envsamp_image *view, void **memory)
{
    const envsamp_kd *kd = NULL;
    envsamp_buffer table, scratch;
    envsamp_sizes sizes;

    envsamp_kd_sizes(view, NULL, &sizes);           /* the build repeats what fails here */
    *memory = table.data = malloc(table.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    envsamp_kd_build(view, NULL, table, scratch, &kd);      /* kd stays NULL if it fails */
    free(scratch.data);
    return kd;
}

int main(int argc, char **argv)
{
    int samples = argc > 3 ? atoi(argv[3]) : 16, good = 0;
    const float albedo = argc > 4 ? (float)atof(argv[4]) : 0.6f;
    char error[512] = "usage: path_tracer MAP OUTPUT.png [SAMPLES] [ALBEDO]";
    image map = { 0, 0, NULL };
    void *memory = NULL;

    if (argc > 2 && samples > 0 && (map_make(argv[1], 512, 256, &map)
                                    || image_read(argv[1], &map, error, sizeof error))) {
        const envsamp_image view = { map.rgb, map.width, map.height, 3, 0, ENVSAMP_LATLONG };
        environment sky = environment_make(build(&view, &memory), &view);

        environment_place(&sky, "Blender Cycles");  /* z up, and a picture the right way round */
        image_fail(error, sizeof error, argv[1], "black, or too large for memory");
        good = sky.kd && render(&sky, albedo, samples, argv[2], error);
    }
    if (!good)
        fprintf(stderr, "%s\n", error);
    free(memory);
    image_free(&map);
    return !good;
}
