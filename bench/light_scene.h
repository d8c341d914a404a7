/* light_scene.h: a scene with shadows, lit by beams from few or many directions.
 *
 *     static scene view;
 *     scene_make(&view);
 *     beams = bench_allocate(width * height * sizeof *beams);
 *     shade(&view, beams, map_beams(&map, beams), reference);
 *     shade(&view, few, light_beams(lights, 32, few), shown);
 *     printf("%g\n", relative_rmse(&view, shown, reference));
 *
 * Five diffuse or semi-glossy spheres on a diffuse plane, seen by 80 x 60 rays, each lit point in
 * all directions or in shadow of a sphere or the plane.
 *
 * Needs envsamp.h and -lm.
 */
#ifndef LIGHT_SCENE_H
#define LIGHT_SCENE_H

#include "../examples/common/light.h"

#include <string.h>

#define COLUMNS 80
#define ROWS 60
#define SPHERES 5
#define SQUARE 4                    /* texels a side */
#define BRIGHT 2e-4                 /* share of the light above which a square is split */

/* Light from a direction: luminance x solid angle. */
typedef struct beam { float dir[3], light; } beam;

/* A point that the eye sees: its normal, the mirrored view, and the exponent of its gloss or 0. */
typedef struct point { float at[3], normal[3], mirror[3], gloss; } point;

typedef struct scene {
    point points[COLUMNS * ROWS];
    int count;
} scene;

/* ---- the scene ---- */

static const struct { float centre[3], radius, gloss; } spheres[SPHERES] = {
    { { -2.1f, 0.2f, 1.0f }, 1.0f, 0.0f }, { { 0.1f, 0.9f, 0.8f }, 0.8f, 8.0f },
    { { 2.0f, 0.0f, 1.0f }, 1.0f, 24.0f }, { { -0.7f, -1.3f, 0.45f }, 0.45f, 24.0f },
    { { 1.0f, -1.5f, 0.35f }, 0.35f, 0.0f }
};

/* Distance along a ray of unit length to a sphere, or -1. */
static inline float sphere_hit(int which, const float from[3], const float dir[3])
{
    const float *c = spheres[which].centre, radius = spheres[which].radius;
    const float to[3] = { c[0] - from[0], c[1] - from[1], c[2] - from[2] };
    const float along = dot3(to, dir), rest = radius * radius - dot3(to, to) + along * along;
    const float near = rest > 0.0f ? along - sqrtf(rest) : -1.0f;

    return near > 1e-3f ? near : -1.0f;
}

/* What a ray from the eye meets first; 0 if nothing near. */
static inline int meet(const float eye[3], const float dir[3], point *p)
{
    float nearest = dir[2] < 0.0f ? -eye[2] / dir[2] : -1.0f, facing;
    int which = -1, i;

    for (i = 0; i < SPHERES; i++) {
        const float t = sphere_hit(i, eye, dir);

        if (t > 0.0f && (nearest < 0.0f || t < nearest)) {
            nearest = t;
            which = i;
        }
    }
    if (nearest < 0.0f || nearest > 14.0f)
        return 0;
    for (i = 0; i < 3; i++) {
        p->at[i] = eye[i] + nearest * dir[i];
        p->normal[i] = which < 0 ? (i == 2 ? 1.0f : 0.0f)
                                 : (p->at[i] - spheres[which].centre[i]) / spheres[which].radius;
    }
    facing = dot3(p->normal, dir);
    for (i = 0; i < 3; i++)
        p->mirror[i] = dir[i] - 2.0f * facing * p->normal[i];
    p->gloss = which < 0 ? 0.0f : spheres[which].gloss;
    return 1;
}

static inline void scene_make(scene *s)
{
    const float eye[3] = { 0.0f, -7.5f, 3.2f }, ahead[2] = { 0.92f, -0.39f };
    int i, c;

    s->count = 0;
    for (i = 0; i < COLUMNS * ROWS; i++) {
        const float a = ((float)(i % COLUMNS) + 0.5f - 0.5f * COLUMNS) * 0.95f / COLUMNS;
        const float b = (0.5f * ROWS - (float)(i / COLUMNS) - 0.5f) * 0.95f / COLUMNS;
        float dir[3] = { a, ahead[0] - b * ahead[1], ahead[1] + b * ahead[0] }, length;

        length = sqrtf(dot3(dir, dir));
        for (c = 0; c < 3; c++)
            dir[c] /= length;
        s->count += meet(eye, dir, &s->points[s->count]);
    }
}

/* What a point shows of light from a direction: diffuse with a lobe about the mirrored view. */
static inline float response(const point *p, const float dir[3])
{
    const float cosine = dot3(p->normal, dir);
    float shown = 0.5f * cosine / LIGHT_PI;
    int i;

    if (cosine <= 0.0f || dir[2] <= 0.0f)
        return 0.0f;
    for (i = 0; i < SPHERES; i++)
        if (sphere_hit(i, p->at, dir) > 0.0f)
            return 0.0f;
    if (p->gloss > 0.0f)
        shown += 0.3f * (p->gloss + 1.0f) / (2.0f * LIGHT_PI)
               * powf(fmaxf(dot3(p->mirror, dir), 0.0f), p->gloss);
    return shown;
}

static inline void shade(const scene *s, const beam *beams, int count, float *shown)
{
    int i, k;

    for (i = 0; i < s->count; i++) {
        double sum = 0.0;

        for (k = 0; k < count; k++)
            sum += (double)(beams[k].light * response(&s->points[i], beams[k].dir));
        shown[i] = (float)sum;
    }
}

static inline double relative_rmse(const scene *s, const float *shown, const float *right)
{
    double squares = 0.0, sum = 0.0;
    int i;

    for (i = 0; i < s->count; i++) {
        const double error = (double)shown[i] - (double)right[i];

        squares += error * error;
        sum += (double)right[i];
    }
    return sqrt(squares * s->count) / sum;
}

/* ---- all of a map ---- */

static inline beam texel_beam(const image *map, int x, int y)
{
    beam b;

    envsamp_uv_to_dir(ENVSAMP_LATLONG, ((float)x + 0.5f) / (float)map->width,
                      ((float)y + 0.5f) / (float)map->height, b.dir);
    b.light = texel_luminance(map, x, y) * texel_sr(map->width, map->height, y);
    return b;
}

/* A square's light from its centroid, or, if it is bright, from every texel; how many beams. */
static inline int square_beams(const image *map, int x0, int y0, double bright, beam *beams)
{
    double sum = 0.0, v[3] = { 0.0, 0.0, 0.0 }, length;
    int x, y, c, texels = 0;

    for (y = y0; y < y0 + SQUARE && y < map->height; y++)
        for (x = x0; x < x0 + SQUARE && x < map->width; x++, texels++) {
            beams[texels] = texel_beam(map, x, y);
            for (c = 0; c < 3; c++)
                v[c] += (double)beams[texels].light * (double)beams[texels].dir[c];
            sum += (double)beams[texels].light;
        }
    if (sum > bright)
        return texels;
    length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (c = 0; c < 3 && length > 0.0; c++)
        beams->dir[c] = (float)(v[c] / length);
    beams->light = (float)sum;
    return 1;
}

/* All of a map's light. `beams` has room for one a texel. Returns how many there are. */
static inline int map_beams(const image *map, beam *beams)
{
    double total = 0.0;
    int x, y, count = 0;

    for (y = 0; y < map->height; y++)
        for (x = 0; x < map->width; x++)
            total += (double)(texel_luminance(map, x, y) * texel_sr(map->width, map->height, y));
    for (y = 0; y < map->height; y += SQUARE)
        for (x = 0; x < map->width; x += SQUARE)
            count += square_beams(map, x, y, BRIGHT * total, beams + count);
    return count;
}

/* ---- a few lights ---- */

static inline int light_beams(const envsamp_light *lights, int count, beam *beams)
{
    int i;

    for (i = 0; i < count; i++) {
        memcpy(beams[i].dir, lights[i].dir, sizeof beams[i].dir);
        beams[i].light = envsamp_luminance(lights[i].irradiance);
    }
    return count;
}

#endif
