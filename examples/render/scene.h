/* scene.h: the renderer's scenes, made in code, and rays through them by Embree.
 *
 *     scene *s = scene_open("vase", error, sizeof error);
 *     scene_ray(s, x, y, aspect, from, dir);            (x, y) of the picture, 0..1
 *     if (scene_closest(s, from, dir, &hit))
 *         ... hit.basis.z, hit.material ...
 *     scene_close(s);
 *
 * +z is up, as in the library. Once open, a scene is read-only: any number of threads may ask it.
 */
#ifndef RENDER_SCENE_H
#define RENDER_SCENE_H

#include "material.h"
#include "vector.h"

#include <stddef.h>

typedef struct scene scene;

/* Where a ray ends. */
typedef struct scene_hit {
    float at[3];             /* a little off the surface, on the side that the ray came from */
    float flat[3];           /* normal of the triangle; on that side too */
    vec_basis basis;         /* of the shading normal */
    float distance;
    const material *material;
} scene_hit;

typedef struct scene_entry { const char *name, *what; } scene_entry;

/* All that scene_open knows; a name of NULL at the end. */
extern const scene_entry scene_list[];

/* NULL, with one line in `error`, for an unknown name or too little memory. */
scene *scene_open(const char *name, char *error, size_t error_size);

/* A sphere alone, of any material; NULL if memory is short. */
scene *scene_sphere(const material *m);
void scene_close(scene *s);

/* The ray from the eye through a point of the picture; (0, 0) is its upper left corner. */
void scene_ray(const scene *s, float x, float y, float aspect, float from[3], float dir[3]);

/* What the ray meets first; 0 for nothing. dir is of unit length. */
int scene_closest(const scene *s, const float from[3], const float dir[3], scene_hit *hit);

/* Whether anything is in the way. */
int scene_occluded(const scene *s, const float from[3], const float dir[3]);

/* Spheres inside of the scene's objects: what they hide is hidden. For points inside of a vase they
   hide too much. */
typedef struct scene_proxy { float centre[3], radius; } scene_proxy;

#define PROXIES_MAX 96

/* How many there are; *proxies points into the scene. */
int scene_proxies(const scene *s, const scene_proxy **proxies);

#endif
