/* placement.h: a map in the world of an engine: turned, y up, exposed and tinted, by the table that
 * was built once of the map as it is.
 *
 *     environment e = environment_make(kd, &image);      z up, exposure 1, white
 *     environment_y_up(&e, 0);
 *     environment_turn(&e, up, 0.5f);
 *     e.exposure = 2.0f;
 *     environment_light light = environment_sample(&e, u0, u1);
 *     float pdf = environment_pdf(&e, bsdf_dir);         all directions are the world's
 *
 * Why nothing is rebuilt: a rotation or a mirror keeps solid angle, so a density per steradian is
 * the same number before and after it; exposure scales the light of all directions alike, so the
 * best density stays what it was; and under a tint the density is still positive wherever there is
 * light, which is all that an unbiased estimate asks for.
 *
 * What a tint costs: draws are in proportion to the luminance before the tint. Where the largest
 * factor of a tint is k times the smallest, the excess variance (of L/pdf, relative, a draw) comes
 * to (k - 1)^2 / 4k at most, where the table itself has none: 0.13 at k = 2, 2 at k = 10. That
 * takes a map of red and blue lamps; in a grey map it is 0, and each channel by itself has the
 * variance that it had. Rebuild, with the tint in the pixels, where a strong tint is to stay and
 * the map is colourful: examples/placement.c prints the excess variance before and after.
 *
 * Valid C and C++. Needs envsamp.h and -lm.
 */
#ifndef PLACEMENT_H
#define PLACEMENT_H

#include "../../envsamp.h"

#include <math.h>

/* How radiance is looked up between texels. The table must be built for the lookup that is used,
   so the same constant goes into desc.nearest and into envsamp_lookup. The default is 0; here it is
   1, so that a sum over texels is exact and everything can be checked against it. */
#define NEAREST 1

typedef struct environment {
    const envsamp_kd *kd;        /* of *image as it is: nothing below was known to the build */
    const envsamp_image *image;  /* read by every lookup */
    float to_map[3][3];          /* from world to map; row i is the map's axis i, in the world */
    float exposure;              /* factor of radiance; 2^EV */
    float tint[3];               /* factor of each channel, 0 or more */
} environment;

/* A direction of the world, its density per steradian, and the light that comes from there. */
typedef struct environment_light {
    float dir[3], pdf, radiance[3];
} environment_light;

/* ---- placing ---- */

/* In an engine with z up: the map as it is. */
static inline environment environment_make(const envsamp_kd *kd, const envsamp_image *map)
{
    const environment e = { kd, map, { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } }, 1, { 1, 1, 1 } };

    return e;
}

/* In an engine with y up, the map not turned: its +z is the engine's +y, its +x remains +x, and u
   runs from there towards -z, where the map's +y is. In a left-handed engine u runs towards +z: the
   same place, as the z axis points the other way; that matrix mirrors one axis, determinant -1. The
   matrix of the other hand shows the map mirrored, left and right exchanged. Sample and pdf still
   agree then, so neither noise nor energy tells: look at writing in the map. */
static inline void environment_y_up(environment *e, int left_handed)
{
    const float to_map[3][3] = { { 1, 0, 0 }, { 0, 0, left_handed ? 1.0f : -1.0f }, { 0, 1, 0 } };
    int i, k;

    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++)
            e->to_map[i][k] = to_map[i][k];
}

/* Turns the placed map about a unit axis of the world, radians, from x to y when it is z: by the
   right-hand rule in a right-handed engine, by the left-hand rule in a left-handed one. A sky that
   turns is better placed afresh at its angle each frame: rounding errors of many small turns add up
   until the rows are no longer orthonormal, and then pdf is wrong. */
static inline void environment_turn(environment *e, const float axis[3], float angle)
{
    const float c = cosf(angle), s = sinf(angle);
    int i, k;

    for (i = 0; i < 3; i++) {        /* turning the map turns its axes, which the rows are */
        const float v[3] = { e->to_map[i][0], e->to_map[i][1], e->to_map[i][2] };
        const float along = (1.0f - c) * (axis[0] * v[0] + axis[1] * v[1] + axis[2] * v[2]);

        for (k = 0; k < 3; k++) {
            const int a = (k + 1) % 3, b = (k + 2) % 3;

            e->to_map[i][k] = c * v[k] + s * (axis[a] * v[b] - axis[b] * v[a]) + along * axis[k];
        }
    }
}

/* ---- using ---- */

static inline void environment_to_map(const environment *e, const float world[3], float map[3])
{
    int i;

    for (i = 0; i < 3; i++)
        map[i] = e->to_map[i][0] * world[0] + e->to_map[i][1] * world[1]
                 + e->to_map[i][2] * world[2];
}

/* The transpose is the inverse, of a mirror as well. */
static inline void environment_to_world(const environment *e, const float map[3], float world[3])
{
    int i;

    for (i = 0; i < 3; i++)
        world[i] = e->to_map[0][i] * map[0] + e->to_map[1][i] * map[1] + e->to_map[2][i] * map[2];
}

/* Light of the map in a direction of the map, exposed and tinted. */
static inline void environment_lookup(const environment *e, const float map_dir[3],
                                      float radiance[3])
{
    int i;

    envsamp_lookup(e->image, NEAREST, map_dir, radiance);
    for (i = 0; i < 3; i++)
        radiance[i] *= e->exposure * e->tint[i];
}

static inline void environment_radiance(const environment *e, const float dir[3],
                                        float radiance[3])
{
    float map_dir[3];

    environment_to_map(e, dir, map_dir);
    environment_lookup(e, map_dir, radiance);
}

/* Draws a direction of the world. The light is looked up before the turn: there and back again the
   direction may be rounded into the next texel. */
static inline environment_light environment_sample(const environment *e, float u0, float u1)
{
    const envsamp_sample s = envsamp_kd_sample(e->kd, u0, u1);
    environment_light light;

    environment_to_world(e, s.dir, light.dir);
    environment_lookup(e, s.dir, light.radiance);
    light.pdf = s.pdf;               /* exposure and tint change the light, not where it is drawn */
    return light;
}

/* Density of environment_sample in a direction of the world, for MIS: into the map first. Without
   that the picture stays plausible, but light is counted twice here and not at all there. */
static inline float environment_pdf(const environment *e, const float dir[3])
{
    float map_dir[3];

    environment_to_map(e, dir, map_dir);
    return envsamp_kd_pdf(e->kd, map_dir);
}

#endif
