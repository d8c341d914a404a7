/* filtered.h: filtered importance sampling [Krivanek, Colbert: Real-time Shading with Filtered
 * Importance Sampling, 2008]. Samples are drawn from the BSDF, and each looks the map up in a mip
 * level as coarse as the samples are sparse there: little noise at few samples, paid for with bias.
 *
 *     filtered levels;
 *     if (!filtered_make(&map, &levels)) ...
 *     filtered_lookup(&levels, dir, pdf, sample_count, FILTERED_BIAS, rgb);
 *     filtered_free(&levels);
 *
 * A sample stands for a solid angle of 1 / (count pdf). Its level is half the binary logarithm of
 * that over the solid angle of the map's texel there, plus a bias, at least 0. Link filtered.c,
 * image.c, hdr.c, envsamp.h's implementation and -lm.
 */
#ifndef FILTERED_H
#define FILTERED_H

#include "image.h"

#define FILTERED_LEVELS_MAX 17

/* Published: samples overlap by a factor of 4 in solid angle, which is a level. */
#define FILTERED_BIAS 1.0f

/* Level 0 is a copy of the map, the last one of 1 x 1 texel. */
typedef struct filtered {
    int count;
    image levels[FILTERED_LEVELS_MAX];
} filtered;

/* Levels of a lat-long map of any size, half as wide and high each. Texels are means by solid
 * angle, so every level has the map's integral. Returns 0, with *out empty, without memory. */
int filtered_make(const image *map, filtered *out);

void filtered_free(filtered *f);

/* 0 to count - 1. A pdf that is not above zero gives the coarsest. */
float filtered_level(const filtered *f, const float dir[3], float pdf, int sample_count,
                     float bias);

/* Radiance of that level: bilinear in the two next to it, linear between them. */
void filtered_lookup(const filtered *f, const float dir[3], float pdf, int sample_count, float bias,
                     float rgb[3]);

#endif
