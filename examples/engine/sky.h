/* sky.h: a made-up sky with soft clouds, whose rows are made as a build asks for them.
 *
 *     sky day;
 *     if (!sky_make(&day, 2048, 1024, 1)) return 1;      one channel: luminance
 *     sky_set(&day, 1.2f);                     the sun's way: 0 sunrise, PI / 2 noon, PI sunset
 *     envsamp_kd_begin(&day.view, sky_row, &day, ...);
 *     sky_free(&day);
 *
 * The disc of the sun is a degree wide. It moves by parts of a texel, and its texels sum to its
 * irradiance, so maps of all sizes have the same light.
 */
#ifndef ENGINE_SKY_H
#define ENGINE_SKY_H

#include "envsamp.h"

#define SKY_PI 3.14159265f
#define SKY_DISC 128            /* most columns and rows of texels of the disc */

typedef struct sky {
    envsamp_image view;         /* its size, without pixels */
    float sun[3];               /* the direction towards it */
    float irradiance[3];        /* of a surface that faces it */
    float day;                  /* brightness of the sky: 1 at noon */
    float *clouds;              /* a number for each texel, 0 to 1 */
    float *across;              /* cosine of each column's azimuth from the sun */
    int left, top;              /* of the disc */
    float disc[SKY_DISC][SKY_DISC];
} sky;

/* Colour, or luminance if `channels` is 1. Sizes up to 16384 x 8192. Returns 0 where memory is
   short. */
int sky_make(sky *s, int width, int height, int channels);
void sky_free(sky *s);

/* Moves the sun. Not while a build reads rows. */
void sky_set(sky *s, float angle);

/* An envsamp_row_fn. `user` is the sky. */
envsamp_result sky_row(int y, float *row, void *user);

#endif
