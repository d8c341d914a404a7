/* sun_and_sky.c: sun out, sky in: a map as a few directional lights, and the rest of it.
 *
 *     sun_and_sky MAP [twice]           MAP: a file, or a made-up map by name (see common/maps.h)
 *
 * 1. envsamp_lights with DECOMPOSED gives EnvDirects: directional lights with shadow maps. What is
 *    above the threshold of envsamp_emissive_mask, close to one, goes into the light.
 * 2. Direction x irradiance of a light is the sum of direction x light over what went into it. So
 *    it is exact for every normal that has none of that at its horizon.
 * 3. The rest: the map without that, prefiltered; or nine coefficients, which are some percent off.
 * Exit status 1: they are not the map within 1e-4, away from a sun's horizon. `twice`: suns stay.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"
#include "common/image.h"
#include "common/light_sums.h"
#include "common/maps.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LIGHTS 16                /* most suns, and what envsamp_lights is asked for */
#define CLOSE 0.9994             /* cosine of 2 degrees */

typedef struct sun { double dir[3], colour[3], sum[3]; } sun;   /* sum: of direction x light */
typedef struct parts { sun suns[LIGHTS]; int count; light_sums map, rest, lights; } parts;

/* Another EnvDirect, unless it is close to one. A channel that is next to nothing stays. */
static void add_sun(parts *p, const envsamp_light *light)
{
    sun *s = &p->suns[p->count];

    for (int k = 0; k < 3; k++) {
        s->dir[k] = (double)light->dir[k];
        s->colour[k] = (double)light->irradiance[k];
        if (s->colour[k] < 0.01 * (double)envsamp_luminance(light->irradiance))
            s->colour[k] = 0.0;
    }
    for (int i = 0; i < p->count; i++)
        if (light_sums_dot(p->suns[i].dir, s->dir) > CLOSE)
            return;
    p->count++;
}

/* Moves a part of a texel's light, in the colour of the sun, into the nearest one that is close. */
static void take(parts *p, const double dir[3], double part, double rgb[3])
{
    sun *s = NULL;
    double amount = 1e300;

    for (int i = 0; i < p->count; i++)
        if (light_sums_dot(p->suns[i].dir, dir) > (s ? light_sums_dot(s->dir, dir) : CLOSE))
            s = &p->suns[i];
    for (int c = 0; c < 3 && s; c++)
        if (s->colour[c] > 0.0)
            amount = fmin(amount, part * rgb[c] / s->colour[c]);
    for (int k = 0; k < 3 && s; k++) {
        s->sum[k] += amount * dir[k];
        rgb[k] -= amount * s->colour[k];
    }
}

/* Finds the suns, and sums over the map and over what they leave of it. */
static envsamp_result split(const envsamp_image *map, parts *p)
{
    const envsamp_lights_desc desc = { LIGHTS, ENVSAMP_LIGHTS_DECOMPOSED, .gamma = 0.02f };
    uint8_t *mask = (uint8_t *)malloc((size_t)map->width * (size_t)map->height);
    envsamp_light lights[LIGHTS];
    envsamp_lights_info info = { 0 };
    double dir[3], rgb[3];
    envsamp_sizes sizes;
    float threshold;

    envsamp_lights_sizes(map, &desc, &sizes);       /* the lights repeat what fails here */
    const envsamp_buffer scratch = { malloc(sizes.scratch_bytes), sizes.scratch_bytes };
    envsamp_result result = envsamp_lights(map, &desc, lights, LIGHTS, scratch, &info);
    if (result == ENVSAMP_OK)
        result = envsamp_emissive_mask(map, &desc, mask, scratch, &threshold);
    for (int i = 0; i < info.direct_count; i++)
        add_sun(p, &lights[i]);
    for (int i = 0; i < map->width * map->height && result == ENVSAMP_OK; i++) {
        light_sums_texel(map, i % map->width, i / map->width, dir, rgb);
        light_sums_add(&p->map, dir, rgb);
        if (mask[i])
            take(p, dir, 1.0 - (double)(threshold / envsamp_luminance(map->pixels + 3 * i)), rgb);
        light_sums_add(&p->rest, dir, rgb);
    }
    free(scratch.data);
    free(mask);
    return result;
}

static void print_sun(const sun *s, light_sums *lights)
{
    const double length = sqrt(light_sums_dot(s->sum, s->sum)), part = 1.0 / fmax(length, 1e-300);
    const double dir[3] = { part * s->sum[0], part * s->sum[1], part * s->sum[2] };
    const double rgb[3] = { length * s->colour[0], length * s->colour[1], length * s->colour[2] };

    light_sums_add(lights, dir, rgb);
    for (int k = 0; k < 6; k++)
        printf("%s%.6g%s", k ? " " : "sun ", k < 3 ? dir[k] : rgb[k - 3], k < 5 ? "" : "\n");
}

/* Adds relative errors: prefiltered, the same close to a sun's horizon, and by coefficients. */
static void judge(const parts *p, int k, int c, double error[3])
{
    const double map = p->map.irradiance[k][c], lights = p->lights.irradiance[k][c];
    const double rest = light_sums_order_2(&p->map, k, c) - light_sums_order_2(&p->lights, k, c);
    int at = 0;
    double n[3];

    light_sums_normal(k, n);
    for (int i = 0; i < p->count; i++)
        at |= fabs(light_sums_dot(n, p->suns[i].dir)) < sqrt(1.0 - CLOSE * CLOSE);
    error[at] = fmax(error[at], fabs((p->rest.irradiance[k][c] + lights) / map - 1.0));
    error[2] = fmax(error[2], fabs((rest + lights) / map - 1.0));
}

int main(int argc, char **argv)
{
    static parts p;
    char text[512] = "usage: sun_and_sky MAP [twice]";
    envsamp_result result = ENVSAMP_ERR_NULL;
    double error[3] = { 0.0 };
    image map = { 0 };

    if ((argc == 2 || (argc == 3 && !strcmp(argv[2], "twice")))
        && (map_make(argv[1], 512, 256, &map) || image_read(argv[1], &map, text, 512))) {
        const envsamp_image view = { map.rgb, map.width, map.height, 3, 0, ENVSAMP_LATLONG };

        image_clean(&map);
        result = split(&view, &p);
        image_fail(text, 512, argv[1], "%s", envsamp_result_string(result));
    }
    image_free(&map);
    if (result != ENVSAMP_OK)
        return fprintf(stderr, "%s\n", text), 1;
    for (int i = 0; i < p.count; i++)
        print_sun(&p.suns[i], &p.lights);
    for (int i = 0; i < 27; i++)
        printf("%s%.6g%s", i % 3 ? " " : "rest ", p.map.harmonics[i / 3][i % 3]
               - p.lights.harmonics[i / 3][i % 3], i % 3 < 2 ? "" : "\n");
    p.rest = argc == 3 ? p.map : p.rest;
    for (int i = 0; i < 3 * LIGHT_SUMS_NORMALS; i++)
        judge(&p, i / 3, i % 3, error);
    printf("error with the rest prefiltered %.1e, close to a sun's horizon %.1e, "
           "as coefficients %.3f\n", error[0], error[1], error[2]);
    return !(error[0] < 1e-4);
}
