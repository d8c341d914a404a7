/* inversion.h: what renderers ship: inversion of the CDF over all texels by binary search.
 *
 *     inversion *table = inversion_make(&map, 0.0f);
 *     envsamp_sample s = inversion_sample(table, u0, u1);
 *     float pdf = inversion_pdf(table, dir);
 *     free(table);
 *
 * The weight of a texel is the largest of its channels, dilated: the largest among it and its eight
 * neighbours, so that density is above zero wherever a bilinear lookup is; times sin(theta) of its
 * middle. The library is measured against this; it calls nothing of the library.
 */
#ifndef RENDER_INVERSION_H
#define RENDER_INVERSION_H

#include "../../envsamp.h"
#include "../common/image.h"

typedef struct inversion inversion;

/* One block of memory, to be freed with free; NULL if memory is short or the map is black.
   compensation: 0 none .. 1 full, as mis_compensation of the library, for MIS alone. */
inversion *inversion_make(const image *map, float compensation);

size_t inversion_bytes(const inversion *table);

/* Only dir, pdf and uv count, as of envsamp_cdf_sample. */
envsamp_sample inversion_sample(const inversion *table, float u0, float u1);

float inversion_pdf(const inversion *table, const float dir[3]);

#endif
