/* change.h: how much irradiance changes from frame to frame, over many normals.
 *
 *     static change c;
 *     each frame: change_of_map(&map, irradiance); change_add(&c, irradiance);
 *     c.worst is the largest change of a normal, over the largest irradiance of that frame.
 */
#ifndef ENGINE_CHANGE_H
#define ENGINE_CHANGE_H

#include "envsamp.h"

#define CHANGE_NORMALS 64

typedef struct change {
    int frames;
    double before[CHANGE_NORMALS], worst;
} change;

/* Luminance of the irradiance of each normal. The map: lat-long, RGB, packed. */
void change_of_map(const envsamp_image *map, double irradiance[CHANGE_NORMALS]);
void change_of_lights(const envsamp_light *lights, int count, double irradiance[CHANGE_NORMALS]);

void change_add(change *c, const double irradiance[CHANGE_NORMALS]);

#endif
