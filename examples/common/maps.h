/* maps.h: made-up environment maps, so that nothing here needs a download.
 *
 * Latitude-longitude, row 0 at the +z pole; column u * width lies at azimuth 2 pi u from +x
 * towards +y. The same name and size give the same map.
 *
 *     sky       clear sky with soft clouds over a plain; the sun, one degree wide, is 10^5 times
 *               brighter than the sky
 *     studio    dark room lit by softboxes and one strip light
 *     constant  1 everywhere
 *     night     street with many lamps, lit windows and stars, most of them a single texel
 *     foliage   under trees: strong noise at the size of a texel
 */
#ifndef MAPS_H
#define MAPS_H

#include "image.h"

/* Every name map_make knows, NULL at the end. */
extern const char *const map_names[];

/* Makes the map into *out, to be freed with image_free. Returns 1, or 0 with *out empty on an
 * unknown name, a size that image_alloc refuses, or too little memory. */
int map_make(const char *name, int width, int height, image *out);

#endif
