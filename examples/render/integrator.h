/* integrator.h: what a scene shows under a map: direct light, or paths of several bounces.
 *
 *     film f;
 *     if (!film_make(&f, 640, 480)) ...
 *     render_samples(&job, &f, 64);
 *     film_image(&f, &picture);
 *     film_free(&f);
 *
 * At every point that a path meets, one direction is drawn from the light by the method's sampler,
 * and one by the BSDF. The latter makes the path go on; what it brings of the map counts with MIS
 * and with "bsdf". With MIS, weights are those of the power heuristic, for one sample of each.
 */
#ifndef RENDER_INTEGRATOR_H
#define RENDER_INTEGRATOR_H

#include "environment.h"
#include "numbers.h"
#include "scene.h"
#include "tiles.h"

#include <stdint.h>

/* Sums over the samples so far. */
typedef struct film {
    int width, height;
    uint32_t samples;
    double *rgb;                     /* 3 a pixel */
    double *squares;                 /* of luminance: for the variance of a pixel */
} film;

int film_make(film *f, int width, int height);
void film_free(film *f);

/* Adds a sample of a pixel. `samples` is not changed: it counts those of every pixel. */
void film_add(film *f, int x, int y, const float rgb[3]);

/* The mean, into an image of that size. */
void film_image(const film *f, image *out);

/* What a sample of a pixel shows, added to rgb. */
typedef void (*film_shade)(const void *job, const film *f, int x, int y, uint32_t sample,
                           float rgb[3]);

/* Adds `count` samples a pixel, by threads over tiles. progress may be NULL. The sum is the same
   however they are divided among calls and threads. */
void film_run(film *f, uint32_t count, int threads, film_shade shade, const void *job,
              const tile_progress *progress);

typedef struct render_job {
    const scene *scene;
    const environment *environment;
    const method *method;
    int bounces;                     /* 1: direct light */
    int side;                        /* 0: anywhere in a pixel; else see pixel_ray */
    int independent;                 /* 0: Owen-scrambled Sobol points */
    uint32_t seed;
    int threads;
    const tile_progress *progress;   /* may be NULL */
} render_job;

/* The ray of a sample through pixel (x, y), and its numbers. `side` above 0: samples take turns in
   going through the middles of side x side parts of the pixel, as those of lights.h do: so that
   what is compared differs in light only, not in how edges are smoothed. */
numbers pixel_ray(const scene *s, const film *f, int x, int y, int side, int independent,
                  uint32_t seed, uint32_t sample, float from[3], float dir[3]);

/* Adds `count` samples a pixel. The sum is the same however they are divided among calls. */
void render_samples(const render_job *job, film *f, uint32_t count);

#endif
