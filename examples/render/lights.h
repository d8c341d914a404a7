/* lights.h: a scene lit by a list of directional lights, each with a shadow ray.
 *
 *     light_list list;
 *     if (!lights_make(&list, "relaxed", 32, 0, &environment, error, sizeof error)) ...
 *     lights_render(&job, &picture);
 *     lights_free(&list);
 *
 * A list may come from anywhere: only dir, irradiance, cos_extent and direct of its lights count,
 * in the directions of the map. With `sets` of 8, pixels take turns in using one of as many lists,
 * in which every light is turned within its cone: interleaved sampling. With `reduce` above 1, the
 * lights whose `direct` is 0 are rendered in a picture that is smaller by that factor, and brought
 * up by upsample.h.
 */
#ifndef RENDER_LIGHTS_H
#define RENDER_LIGHTS_H

#include "environment.h"
#include "scene.h"
#include "tiles.h"
#include "upsample.h"

typedef struct light_list {
    envsamp_light *lights;
    int count;
} light_list;

typedef struct light_method { const char *name, *what; envsamp_lights_method number; } light_method;

/* The library's; a name of NULL at the end. */
extern const light_method light_methods[];

/* Returns 0, with one line in `error`, for an unknown name and for what the library refuses. */
int lights_make(light_list *list, const char *name, int count, uint32_t seed,
                const environment *e, char *error, size_t error_size);

/* The same by a description of the library. */
int lights_build(light_list *list, const envsamp_lights_desc *desc, const environment *e,
                 char *error, size_t error_size);
void lights_free(light_list *list);

/* Makes lights whose radiance, irradiance over solid angle, is above `times` the mean of the list
   EnvDirects, and others not: for lists that come without, whose lamps are not to be rendered in a
   smaller picture. LIGHTS_LAMP: what keeps the error of RELAXED nearly as it is at full size. */
#define LIGHTS_LAMP 2.0f
void lights_mark(light_list *list, float times);

#define LIGHTS_SETS 8

typedef struct lights_job {
    const scene *scene;
    const environment *environment;
    const light_list *list;
    int sets;                        /* 1, or LIGHTS_SETS: interleaved */
    float extent;                    /* of envsamp_lights_interleave; 0: 0.1 */
    int side;                        /* side x side rays through a pixel */
    int reduce;                      /* 1: all lights at full size; else 2, 3, .. */
    const upsample_sigmas *sigmas;   /* NULL: the published ones */
    uint32_t seed;
    int threads;
    const tile_progress *progress;   /* may be NULL */
} lights_job;

/* Renders into an image of the size wanted. Returns 0 if memory is short. */
int lights_render(const lights_job *job, image *out);

#endif
