/* irradiance.h: how far the irradiance that a sampler estimates is off.
 *
 *     static irradiance exact;
 *     if (irradiance_make(&exact, &map))
 *         printf("%g\n", irradiance_rmse(&exact, &view, &by, 256, 32));
 *
 * Needs envsamp.h and -lm.
 */
#ifndef IRRADIANCE_H
#define IRRADIANCE_H

#include "light.h"
#include "random.h"

#include <stdlib.h>

#define IRRADIANCE_NORMALS 64
#define IRRADIANCE_ROWS 1024         /* texels of smaller maps are split, for the horizon's sake */

typedef struct irradiance {
    float normals[IRRADIANCE_NORMALS][3];
    double exact[IRRADIANCE_NORMALS];
} irradiance;

/* Spread over the sphere along a spiral. */
static inline void irradiance_normals(irradiance *e)
{
    const float golden = LIGHT_PI * (3.0f - sqrtf(5.0f));
    int k;

    for (k = 0; k < IRRADIANCE_NORMALS; k++) {
        const float z = 1.0f - (2.0f * (float)k + 1.0f) / IRRADIANCE_NORMALS;
        const float level = sqrtf(1.0f - z * z);

        e->normals[k][0] = level * cosf(golden * (float)k);
        e->normals[k][1] = level * sinf(golden * (float)k);
        e->normals[k][2] = z;
    }
}

/* The cosine of each normal with each azimuth, at the equator. */
static inline void irradiance_across(const irradiance *e, int columns, float *across)
{
    int k, x;

    for (x = 0; x < columns; x++) {
        const float phi = 2.0f * LIGHT_PI * ((float)x + 0.5f) / (float)columns;
        const float c = cosf(phi), s = sinf(phi);

        for (k = 0; k < IRRADIANCE_NORMALS; k++)
            across[(size_t)k * (size_t)columns + (size_t)x] = e->normals[k][0] * c
                                                              + e->normals[k][1] * s;
    }
}

/* Adds a row of cells: `light` is luminance x solid angle. */
static inline void irradiance_add_row(irradiance *e, const float *light, const float *across,
                                      int columns, float theta)
{
    const float level = sinf(theta), z = cosf(theta);
    int k, x;

    for (k = 0; k < IRRADIANCE_NORMALS; k++, across += columns) {
        const float up = e->normals[k][2] * z;
        double sum = 0.0;

        for (x = 0; x < columns; x++) {
            const float cosine = across[x] * level + up;

            sum += (double)(light[x] * (cosine > 0.0f ? cosine : 0.0f));
        }
        e->exact[k] += sum;
    }
}

/* Sums over the texels of a map. Returns 0 if memory is short. */
static inline int irradiance_make(irradiance *e, const image *map)
{
    const int split = 1 + (IRRADIANCE_ROWS - 1) / map->height;
    const int columns = map->width * split, rows = map->height * split;
    float *across = malloc((size_t)columns * IRRADIANCE_NORMALS * sizeof *across);
    float *light = malloc((size_t)columns * sizeof *light);
    const int made = across && light;
    int k, x, y;

    irradiance_normals(e);
    for (k = 0; k < IRRADIANCE_NORMALS; k++)
        e->exact[k] = 0.0;
    if (made)
        irradiance_across(e, columns, across);
    for (y = 0; y < rows && made; y++) {
        const float sr = texel_sr(columns, rows, y);

        for (x = 0; x < columns; x++)
            light[x] = sr * texel_luminance(map, x / split, y / split);
        irradiance_add_row(e, light, across, columns, LIGHT_PI * ((float)y + 0.5f) / (float)rows);
    }
    free(across);
    free(light);
    return made;
}

static inline void irradiance_estimate(const irradiance *e, const envsamp_image *view,
                                       const sampler *by, uint32_t points, uint32_t seed,
                                       double sums[IRRADIANCE_NORMALS])
{
    uint32_t i;
    int k;

    for (k = 0; k < IRRADIANCE_NORMALS; k++)
        sums[k] = 0.0;
    for (i = 0; i < points; i++) {
        float u[2], rgb[3], weight;
        envsamp_sample s;

        sobol_owen(i, seed, u);
        s = by->draw(by->table, u[0], u[1]);
        envsamp_lookup(view, 1, s.dir, rgb);
        weight = s.pdf > 0.0f ? envsamp_luminance(rgb) / (s.pdf * (float)points) : 0.0f;
        for (k = 0; k < IRRADIANCE_NORMALS; k++)
            sums[k] += (double)(weight * fmaxf(dot3(e->normals[k], s.dir), 0.0f));
    }
}

/* Root mean square of the relative error over the normals that see light and `scramblings` sets
   of Owen-scrambled Sobol points. */
static inline double irradiance_rmse(const irradiance *e, const envsamp_image *view,
                                     const sampler *by, uint32_t points, uint32_t scramblings)
{
    double sums[IRRADIANCE_NORMALS], squares = 0.0, count = 0.0;
    uint32_t seed;
    int k;

    for (seed = 1; seed <= scramblings; seed++) {
        irradiance_estimate(e, view, by, points, seed, sums);
        for (k = 0; k < IRRADIANCE_NORMALS; k++)
            if (e->exact[k] > 0.0) {
                const double error = sums[k] / e->exact[k] - 1.0;

                squares += error * error;
                count += 1.0;
            }
    }
    return count > 0.0 ? sqrt(squares / count) : 0.0;
}

#endif
