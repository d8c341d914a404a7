/* placement.h: a map in the world of an engine: the right way round, turned, exposed and tinted, by
 * the table that was built once of the map as it is.
 *
 *     environment e = environment_make(kd, &image);      the map's own axes, exposure 1, white
 *     if (!environment_place(&e, "three.js")) ...        as that engine shows the same picture
 *     environment_rotate(&e, 0.5f);                      about the engine's up axis, radians
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
 * the map is colourful.
 *
 * Valid C and C++. Needs envsamp.h and -lm. examples/render has another type `environment`.
 */
#ifndef PLACEMENT_H
#define PLACEMENT_H

#include "../../envsamp.h"

#include <math.h>
#include <string.h>

typedef struct environment {
    const envsamp_kd *kd;        /* of *image as it is: nothing below was known to the build */
    const envsamp_image *image;  /* read by every lookup */
    float to_map[3][3];          /* from world to map; row i is the map's axis i, in the world */
    float exposure;              /* factor of radiance; 2^EV */
    float tint[3];               /* factor of each channel, 0 or more */
    int nearest;                 /* how to look up: as the table was built */
} environment;

/* A direction of the world, its density per steradian, and the light that comes from there. */
typedef struct environment_light {
    float dir[3], pdf, radiance[3];
} environment_light;

/* How an engine shows a picture that it is given. */
typedef struct environment_preset {
    const char *name;
    float to_map[3][3];          /* from its world to the map; row 2 is its up axis */
    envsamp_mapping mapping;     /* of the pictures that it reads */
} environment_preset;

/* ---- placing ---- */

/* Matrices are from each engine's lookup, direction to u and v, which tests/test_placement.c has in
 * formulas. A name of NULL ends the table. Where an engine turns its environment by a setting, the
 * matrix is that of the setting at zero; pbrt's are in the light's own space.
 *
 * Unreal: a picture imported as a cube map. Filament: cube maps that cmgen or
 * IBLPrefilterContext made with their default, mirrored. Unity: the material Skybox/Panoramic; what
 * it imports as a cube map was not checked, and so is left out. glTF has no such maps itself, but
 * its Sample Viewer has. */
static inline const environment_preset *environment_presets(void)
{
    static const environment_preset presets[] = {
        { "three.js",           { { -1, 0, 0 }, { 0, 0, -1 }, { 0, 1, 0 } }, ENVSAMP_LATLONG },
        { "Blender Cycles",     { { -1, 0, 0 }, { 0, 1, 0 },  { 0, 0, 1 } }, ENVSAMP_LATLONG },
        { "Mitsuba 3",          { { 0, 0, -1 }, { 1, 0, 0 },  { 0, 1, 0 } }, ENVSAMP_LATLONG },
        { "Unity",              { { -1, 0, 0 }, { 0, 0, 1 },  { 0, 1, 0 } }, ENVSAMP_LATLONG },
        { "Unreal",             { { 0, 1, 0 },  { -1, 0, 0 }, { 0, 0, 1 } }, ENVSAMP_LATLONG },
        { "Godot 4",            { { 0, 0, -1 }, { 1, 0, 0 },  { 0, 1, 0 } }, ENVSAMP_LATLONG },
        { "Filament",           { { 0, 0, -1 }, { 1, 0, 0 },  { 0, 1, 0 } }, ENVSAMP_LATLONG },
        { "glTF Sample Viewer", { { -1, 0, 0 }, { 0, 0, -1 }, { 0, 1, 0 } }, ENVSAMP_LATLONG },
        { "Tungsten",           { { -1, 0, 0 }, { 0, 0, -1 }, { 0, 1, 0 } }, ENVSAMP_LATLONG },
        { "pbrt-v3",            { { 1, 0, 0 },  { 0, 1, 0 },  { 0, 0, 1 } }, ENVSAMP_LATLONG },
        { "pbrt-v4",            { { 1, 0, 0 },  { 0, 1, 0 },  { 0, 0, 1 } }, ENVSAMP_OCTAHEDRAL },
        { NULL,                 { { 0, 0, 0 },  { 0, 0, 0 },  { 0, 0, 0 } }, ENVSAMP_LATLONG }
    };

    return presets;
}

/* In a world whose axes are the map's. */
static inline environment environment_make(const envsamp_kd *kd, const envsamp_image *map)
{
    environment e = { kd, map, { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } }, 1, { 1, 1, 1 }, 0 };
    envsamp_kd_info info;

    if (envsamp_kd_get_info(kd, &info) == ENVSAMP_OK)
        e.nearest = info.nearest;
    return e;
}

/* As the engine of that name shows the picture; ends all turns before. Returns 0, with nothing
   changed, for another name, and for a map of another mapping than the engine reads.

   Why a table: the mirror image has the same energy and noise, and sample and pdf agree in it, so
   nothing but a look at writing in the map tells that it is wrong. */
static inline int environment_place(environment *e, const char *name)
{
    const environment_preset *preset = environment_presets();

    while (preset->name && strcmp(preset->name, name))
        preset++;
    if (!preset->name || preset->mapping != e->image->mapping)
        return 0;
    memcpy(e->to_map, preset->to_map, sizeof e->to_map);
    return 1;
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

/* Turns the map about its own vertical axis, which after environment_place is the engine's up axis:
   radians, as the engine turns an object by that angle. */
static inline void environment_rotate(environment *e, float angle)
{
    const float up[3] = { e->to_map[2][0], e->to_map[2][1], e->to_map[2][2] };

    environment_turn(e, up, angle);
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

    envsamp_lookup(e->image, e->nearest, map_dir, radiance);
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
