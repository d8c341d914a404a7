/* rivals.h: published ways to turn a map into K directional lights that envsamp.h does not have, to
 * compare its own with.
 *
 *     int made;
 *     envsamp_light lights[32];
 *     if (rival_lights(RIVAL_STRUCTURED, &view, 32, 0, lights, &made) == ENVSAMP_OK) ...
 *
 * Each is written from what can be known of it; rivals.c says at each what its text leaves open and
 * how that was filled in. Every texel belongs to one light, so energies sum to the map's and solid
 * angles to the sphere. These are examples: they call malloc, and are not made for speed.
 *
 * Needs envsamp.h; link rivals.c and -lm.
 */
#ifndef RIVALS_H
#define RIVALS_H

#include "../../envsamp.h"

typedef enum rival {
    RIVAL_STRUCTURED,   /* structured importance sampling [Agarwal et al. 2003] */
    RIVAL_TMMS,         /* after tone-mapped mean-shift [Feng et al. 2016] */
    RIVAL_FHIS,         /* after fast hierarchical importance sampling [Ostromoukhov et al. 2004] */
    RIVAL_COUNT
} rival;

#define RIVAL_LIGHTS_MAX 4096

const char *rival_name(rival method);

/* Lights of a lat-long map. `lights` has room for `count`, 1 to RIVAL_LIGHTS_MAX. *made is how many
 * there are: `count`, or fewer where fewer texels are above zero. FHIS alone depends on `seed`.
 * What is no radiance (negative, NaN, infinite) is taken as zero.
 * Returns ENVSAMP_OK, or ERR_NULL, ERR_SIZE, ERR_PARAM, ERR_BLACK or ERR_MEMORY. */
envsamp_result rival_lights(rival method, const envsamp_image *image, int count, uint32_t seed,
                            envsamp_light *lights, int *made);

#endif
