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

/* The mean, into an image of that size. */
void film_image(const film *f, image *out);

typedef struct render_job {
    const scene *scene;
    const environment *environment;
    const method *method;
    int bounces;                     /* 1: direct light */
    int independent;                 /* 0: Owen-scrambled Sobol points */
    uint32_t seed;
    int threads;
    const tile_progress *progress;   /* may be NULL */
} render_job;

/* Adds `count` samples a pixel. The sum is the same however they are divided among calls. */
void render_samples(const render_job *job, film *f, uint32_t count);

#endif
