/* light.h: what lights a scene, and what draws from it: solid angles of the texels of a lat-long
 * map, directions about an axis, and samplers of different kinds behind one function.
 *
 *     sampler by = sampler_of_kd("WARP", kd);
 *     envsamp_sample s = by.draw(by.table, u0, u1);
 *
 * Needs envsamp.h.
 */
#ifndef LIGHT_H
#define LIGHT_H

#include "../../envsamp.h"
#include "image.h"

#include <math.h>

#define LIGHT_PI 3.14159265358979f

static inline float dot3(const float a[3], const float b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Solid angle of a texel in row y of a map of that size. */
static inline float texel_sr(int width, int height, int y)
{
    const float step = LIGHT_PI / (float)height;

    return 4.0f * LIGHT_PI / (float)width * sinf(0.5f * step) * sinf(step * ((float)y + 0.5f));
}

static inline float texel_luminance(const image *map, int x, int y)
{
    return envsamp_luminance(map->rgb + 3 * ((size_t)y * (size_t)map->width + (size_t)x));
}

/* A direction about a unit axis: the density is in proportion to a power of its cosine, which 1
   makes that of a diffuse surface. */
static inline void draw_lobe(const float axis[3], float power, const float u[2], float dir[3])
{
    const float cosine = powf(1.0f - u[1], 1.0f / (power + 1.0f));
    const float sine = sqrtf(fmaxf(1.0f - cosine * cosine, 0.0f));
    const float sign = axis[2] < 0.0f ? -1.0f : 1.0f;
    const float a = -1.0f / (sign + axis[2]), b = axis[0] * axis[1] * a;
    const float side[3] = {1.0f + sign * axis[0] * axis[0] * a, sign * b, -sign * axis[0]};
    const float other[3] = {b, sign + axis[1] * axis[1] * a, -axis[1]};
    const float x = sine * cosf(2.0f * LIGHT_PI * u[0]), y = sine * sinf(2.0f * LIGHT_PI * u[0]);
    int i;

    for (i = 0; i < 3; i++)
        dir[i] = x * side[i] + y * other[i] + cosine * axis[i];
}

/* ---- samplers ---- */

/* Only dir and pdf of a sample count. */
typedef struct sampler {
    const char *name;
    envsamp_sample (*draw)(const void *table, float u0, float u1);
    const void *table;
} sampler;

static inline envsamp_sample sampler_draw_kd(const void *table, float u0, float u1)
{
    return envsamp_kd_sample((const envsamp_kd *)table, u0, u1);
}

static inline envsamp_sample sampler_draw_uniform(const void *table, float u0, float u1)
{
    const float z = 1.0f - 2.0f * u1, level = sqrtf(fmaxf(1.0f - z * z, 0.0f));
    envsamp_sample s = {{0.0f, 0.0f, 0.0f}, 0.25f / LIGHT_PI, {0.0f, 0.0f}};

    (void)table;
    s.dir[0] = level * cosf(2.0f * LIGHT_PI * u0);
    s.dir[1] = level * sinf(2.0f * LIGHT_PI * u0);
    s.dir[2] = z;
    return s;
}

static inline sampler sampler_of_kd(const char *name, const envsamp_kd *kd)
{
    sampler by = {NULL, sampler_draw_kd, NULL};

    by.name = name;
    by.table = kd;
    return by;
}

/* Every direction is as likely as any other. */
static inline sampler sampler_uniform(const char *name)
{
    sampler by = {NULL, sampler_draw_uniform, NULL};

    by.name = name;
    return by;
}

#endif
