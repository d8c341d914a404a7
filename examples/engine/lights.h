/* lights.h: K lights of a sky that moves, which move with it and never pop.
 *
 *     light_set set;
 *     if (!light_set_make(&set, &map, 16)) return 1;
 *     now and then:   light_set_aim(&set, &map);       new lights of the map, for ours to follow
 *     each frame:     light_set_follow(&set, 0.2f);    part of the way
 *                     for (i = 0; i < set.count; i++) shade(&set.now[i]);
 *
 * envsamp_lights knows nothing of the frame before: a cut falls elsewhere, and a light jumps. Here
 * each new light, the brightest first, is matched with the nearest of ours. Ours moves to its
 * direction and takes on its energy, a part of the way in each frame, so that their sum follows the
 * map's. One without a match fades, and a new one without a match begins dark. So there are more
 * than K at a time, up to LIGHTS_FADING times as many.
 */
#ifndef ENGINE_LIGHTS_H
#define ENGINE_LIGHTS_H

#include "envsamp.h"

#define LIGHTS_FADING 3

typedef struct light_set {
    int wanted;                     /* K */
    int count, most;                /* ours, and the most at a time */
    float jump;                     /* largest change of one light in a frame, over all light */
    envsamp_light *now;             /* ours */
    envsamp_light *aim;             /* what each of ours follows */
    envsamp_light *raw;             /* K, as envsamp_lights gave them last */
    envsamp_lights_desc desc;
    envsamp_buffer scratch;
} light_set;

/* Returns 0 where memory is short. The map's size is that of all maps to come. */
int light_set_make(light_set *set, const envsamp_image *map, int wanted);
void light_set_free(light_set *set);

envsamp_result light_set_aim(light_set *set, const envsamp_image *map);
void light_set_follow(light_set *set, float part);

#endif
