/* light_sums.h: what light from many directions does to surfaces of many normals: exact sums, and
 * spherical harmonics of order 2.
 *
 *     static light_sums sums;
 *     light_sums_texel(&map, x, y, dir, rgb);       for every texel
 *     light_sums_add(&sums, dir, rgb);
 *     sums.irradiance[k][c]                         of normal k
 *     light_sums_order_2(&sums, k, c)               the same from nine coefficients
 *
 * [Ramamoorthi and Hanrahan, An efficient representation for irradiance environment maps, 2001]
 */
#ifndef LIGHT_SUMS_H
#define LIGHT_SUMS_H

#include "envsamp.h"

#include <math.h>

#define LIGHT_SUMS_NORMALS 256
#define LIGHT_SUMS_PI 3.14159265358979

typedef struct light_sums {
    double harmonics[9][3];                         /* of radiance; irradiance needs PI, 2 PI / 3
                                                       and PI / 4 times those of order 0, 1, 2 */
    double irradiance[LIGHT_SUMS_NORMALS][3];
} light_sums;

static inline double light_sums_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Spread over the sphere along a spiral. */
static inline void light_sums_normal(int k, double normal[3])
{
    const double z = 1.0 - (2.0 * k + 1.0) / LIGHT_SUMS_NORMALS, level = sqrt(1.0 - z * z);
    const double turn = LIGHT_SUMS_PI * (3.0 - sqrt(5.0)) * k;

    normal[0] = level * cos(turn);
    normal[1] = level * sin(turn);
    normal[2] = z;
}

/* The nine functions, in the order (0, 0), (1, -1), (1, 0), (1, 1), (2, -2) to (2, 2). */
static inline void light_sums_basis(const double d[3], double y[9])
{
    const double scale[9] = { 0.28209479177, 0.48860251190, 0.48860251190, 0.48860251190,
                              1.09254843059, 1.09254843059, 0.31539156525, 1.09254843059,
                              0.54627421529 };
    const double value[9] = { 1.0, d[1], d[2], d[0], d[0] * d[1], d[1] * d[2],
                              3.0 * d[2] * d[2] - 1.0, d[0] * d[2], d[0] * d[0] - d[1] * d[1] };
    int i;

    for (i = 0; i < 9; i++)
        y[i] = scale[i] * value[i];
}

/* Direction of the middle of a texel, and its radiance x solid angle. The map: lat-long, RGB. */
static inline void light_sums_texel(const envsamp_image *map, int x, int y, double dir[3],
                                    double rgb[3])
{
    const double tall = LIGHT_SUMS_PI / map->height;
    const double sr = 2.0 * LIGHT_SUMS_PI / map->width * (cos(tall * y) - cos(tall * (y + 1)));
    const float *texel = map->pixels + 3 * ((size_t)y * (size_t)map->width + (size_t)x);
    float d[3];
    int k;

    envsamp_uv_to_dir(ENVSAMP_LATLONG, ((float)x + 0.5f) / (float)map->width,
                      ((float)y + 0.5f) / (float)map->height, d);
    for (k = 0; k < 3; k++) {
        dir[k] = (double)d[k];
        rgb[k] = sr * (double)texel[k];
    }
}

static inline void light_sums_add(light_sums *s, const double dir[3], const double rgb[3])
{
    static double normals[LIGHT_SUMS_NORMALS][3];
    double y[9];
    int i, k, c;

    for (k = 0; k < LIGHT_SUMS_NORMALS && normals[LIGHT_SUMS_NORMALS - 1][2] >= 0.0; k++)
        light_sums_normal(k, normals[k]);
    light_sums_basis(dir, y);
    for (i = 0; i < 9; i++)
        for (c = 0; c < 3; c++)
            s->harmonics[i][c] += rgb[c] * y[i];
    for (k = 0; k < LIGHT_SUMS_NORMALS; k++) {
        const double cosine = light_sums_dot(normals[k], dir);

        for (c = 0; c < 3 && cosine > 0.0; c++)
            s->irradiance[k][c] += rgb[c] * cosine;
    }
}

/* Irradiance of normal k from the nine coefficients. */
static inline double light_sums_order_2(const light_sums *s, int k, int c)
{
    double normal[3], y[9], sum = 0.0;
    int i;

    light_sums_normal(k, normal);
    light_sums_basis(normal, y);
    for (i = 0; i < 9; i++)
        sum += (i == 0 ? 1.0 : i < 4 ? 2.0 / 3.0 : 0.25) * s->harmonics[i][c] * y[i];
    return LIGHT_SUMS_PI * sum;
}

#endif
