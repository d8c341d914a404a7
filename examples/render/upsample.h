/* upsample.h: a small picture of soft light brought up to full size along the edges of the scene.
 *
 *     upsample_add(&small, &small_rgb, &large, NULL, &picture);
 *
 * Joint bilateral upsampling [Kopf, Cohen, Lischinski, Uyttendaele 2007] as Wu uses it [Efficient
 * Environment Map Rendering based on Decomposition, 2024, section 3.4]: every pixel is the mean of
 * 5 x 5 small pixels about it, weighed by a Gaussian of their distance in small pixels, and by
 * Gaussians of the differences of normal, depth and albedo.
 *
 * Two things differ. Depth is compared as the distance of a small pixel's point from the tangent
 * plane of the large one's, over its depth: so a ground that is seen at a slant is one surface. And
 * weights are relative to the largest of them, so that a pixel which resembles none of its 25 takes
 * the most similar ones instead of none.
 */
#ifndef RENDER_UPSAMPLE_H
#define RENDER_UPSAMPLE_H

#include "../common/image.h"

/* What a pixel shows of the scene: means over those of its samples that meet it. */
typedef struct feature {
    float at[3], normal[3], albedo[3];
    float depth;                     /* 0: nothing but the map */
    float share;                     /* of the samples that meet the scene */
} feature;

typedef struct features {
    int width, height;
    feature *pixels;
} features;

/* Standard deviations: in small pixels, and of the features. */
typedef struct upsample_sigmas { float spatial, normal, depth, albedo; } upsample_sigmas;

/* Those of Wu: 1, and 0.005 for all features. */
extern const upsample_sigmas upsample_published;

int features_make(features *f, int width, int height);
void features_free(features *f);

/* Adds the small picture, brought up, to a large one, times the share of each large pixel. A small
   pixel holds the mean over those of its samples that meet the scene. sigmas NULL: those of Wu. */
void upsample_add(const features *small, const image *small_rgb, const features *large,
                  const upsample_sigmas *sigmas, image *rgb);

#endif
