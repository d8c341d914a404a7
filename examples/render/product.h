/* product.h: product sampling: for every point, rays chosen by error diffusion over light x BRDF x
 * cosine, the double product, or also x a cheap visibility, the triple product.
 *
 *     product *light = product_make(&environment);
 *     product_samples(&job, &film, 1);                  job.rays rays from one point a pixel
 *     product_free(light);
 *
 * [Szirmay-Kalos, Szecsi, Penzov: Environment Mapping with Floyd-Steinberg Halftoning, 2010,
 * section 1.3.3], with envsamp_halftone. examples/product.c explains how, for two spheres on a
 * plane; here it is done for any scene. What differs:
 *
 * - The importance map of a point covers the whole sphere: 32 x 32 parts of equal area, each the
 *   root of a mip chain down to 256 x 256.
 * - Within a part of some size the BRDF is that of a rougher surface, as rough as the part is wide:
 *   so a highlight narrower than a part is not missed by looking at its middle.
 * - A share of light, of BRDF and of visibility is added to each, so that density is above zero
 *   wherever light may come from, and the result unbiased, whatever the map, surface and proxies.
 */
#ifndef RENDER_PRODUCT_H
#define RENDER_PRODUCT_H

#include "environment.h"
#include "integrator.h"
#include "scene.h"

#define PRODUCT_RAYS 32              /* as published */
#define PRODUCT_RAYS_MAX 256

typedef struct product product;

/* NULL if memory is short. Of the map as it is placed in the world now. */
product *product_make(const environment *e);
void product_free(product *p);

typedef struct product_job {
    const scene *scene;
    const environment *environment;
    const product *product;
    int triple;
    int side;                        /* as in render_job */
    int rays;                        /* M, from every point; 1 .. PRODUCT_RAYS_MAX */
    uint32_t seed;
    int threads;
    const tile_progress *progress;   /* may be NULL */
} product_job;

/* Adds `count` points a pixel, with direct light. The sum is the same however they are divided
   among calls. */
void product_samples(const product_job *job, film *f, uint32_t count);

#endif
