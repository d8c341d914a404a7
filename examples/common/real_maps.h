/* real_maps.h: the real maps that `make data` fetches, by their names.
 *
 *     for (i = 0; i < REAL_MAP_COUNT; i++)
 *         if (real_map_read(i, &map)) { ... real_map_name(i) ...; image_free(&map); }
 *
 * Needs image.c, hdr.c and -lm.
 */
#ifndef REAL_MAPS_H
#define REAL_MAPS_H

#include "image.h"

#define REAL_MAP_COUNT 18

static inline const char *real_map_name(int index)
{
    static const char *const names[REAL_MAP_COUNT] = {
        "apartment", "bridge", "city", "dawn", "esplanade", "forest", "hall", "lab", "lobby",
        "night", "park", "sky", "studio", "sunrise", "sunset", "venice", "warehouse", "workshop"
    };

    return names[index];
}

/* Reads data/NAME.pfm; 0 where it is not there. */
static inline int real_map_read(int index, image *map)
{
    char path[64];

    snprintf(path, sizeof path, "data/%s.pfm", real_map_name(index));
    return image_read_pfm(path, map, NULL, 0);
}

#endif
