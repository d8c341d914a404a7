/* lights.c: see lights.h. */
#include "lights.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define NEAR 0.9f                   /* cosine of the angle within which lights match */
#define DARK 1e-5f                  /* of all light: one that fades ends there */

int light_set_make(light_set *set, const envsamp_image *map, int wanted)
{
    const size_t most = (size_t)wanted * LIGHTS_FADING;
    envsamp_sizes sizes;

    memset(set, 0, sizeof *set);
    set->wanted = wanted;
    set->desc.count = wanted;
    set->desc.method = ENVSAMP_LIGHTS_VARIANCE_CUT;
    if (envsamp_lights_sizes(map, &set->desc, &sizes) == ENVSAMP_OK)
        set->scratch.data = malloc(set->scratch.bytes = sizes.scratch_bytes);
    set->now = malloc(most * sizeof *set->now);
    set->aim = malloc(most * sizeof *set->aim);
    set->raw = malloc((size_t)wanted * sizeof *set->raw);
    if (set->scratch.data && set->now && set->aim && set->raw)
        return 1;
    light_set_free(set);
    return 0;
}

void light_set_free(light_set *set)
{
    free(set->scratch.data);
    free(set->now);
    free(set->aim);
    free(set->raw);
    memset(set, 0, sizeof *set);
}

static float cosine(const envsamp_light *a, const envsamp_light *b)
{
    return a->dir[0] * b->dir[0] + a->dir[1] * b->dir[1] + a->dir[2] * b->dir[2];
}

/* How far two lights differ as vectors: direction x energy. */
static float distance(const envsamp_light *a, const envsamp_light *b)
{
    const float from = envsamp_luminance(a->irradiance), to = envsamp_luminance(b->irradiance);
    float square = 0.0f;
    int k;

    for (k = 0; k < 3; k++) {
        const float step = to * b->dir[k] - from * a->dir[k];

        square += step * step;
    }
    return sqrtf(square);
}

static void scale(envsamp_light *light, float factor)
{
    int c;

    for (c = 0; c < 3; c++)
        light->irradiance[c] *= factor;
}

static int brighter(const void *a, const void *b)
{
    const float x = envsamp_luminance(((const envsamp_light *)a)->irradiance);
    const float y = envsamp_luminance(((const envsamp_light *)b)->irradiance);

    return (x < y) - (x > y);
}

/* Adds a light to another, whose direction becomes the mean of both by energy. */
static void join(envsamp_light *light, const envsamp_light *other)
{
    const float a = envsamp_luminance(light->irradiance), b = envsamp_luminance(other->irradiance);
    const float share = b / fmaxf(a + b, 1e-30f);
    float square = 0.0f;
    int k;

    for (k = 0; k < 3; k++) {
        light->irradiance[k] += other->irradiance[k];
        light->dir[k] += share * (other->dir[k] - light->dir[k]);
        square += light->dir[k] * light->dir[k];
    }
    for (k = 0; k < 3 && square > 0.0f; k++)
        light->dir[k] /= sqrtf(square);
    light->solid_angle += share * (other->solid_angle - light->solid_angle);
    light->cos_extent += share * (other->cos_extent - light->cos_extent);
}

/* The nearest of the first `count` that is not taken, with a cosine above `least`; -1 if none. */
static int nearest(const light_set *set, const envsamp_light *light, int count, const char *taken,
                   float least)
{
    int found = -1, i;

    for (i = 0; i < count; i++) {
        const float near = cosine(&set->now[i], light);

        if (near > least && !(taken && taken[i])) {
            least = near;
            found = i;
        }
    }
    return found;
}

/* Gives each new light one of ours that follows it; where there is no room for another, it joins
   what the nearest follows. At first ours are the new ones. */
static void match(light_set *set, char *taken)
{
    const int before = set->count;
    int i, slot;

    for (i = 0; i < set->wanted; i++) {
        slot = nearest(set, &set->raw[i], before, taken, NEAR);
        if (slot < 0 && set->count == set->wanted * LIGHTS_FADING) {
            join(&set->aim[nearest(set, &set->raw[i], set->count, NULL, -2.0f)], &set->raw[i]);
            continue;
        }
        if (slot < 0) {
            slot = set->count++;
            set->now[slot] = set->raw[i];
            if (before > 0)
                scale(&set->now[slot], 0.0f);
        }
        set->aim[slot] = set->raw[i];
        taken[slot] = 1;
    }
}

envsamp_result light_set_aim(light_set *set, const envsamp_image *map)
{
    char *taken = calloc((size_t)set->wanted * LIGHTS_FADING, 1);
    envsamp_result result = taken ? envsamp_lights(map, &set->desc, set->raw, set->wanted,
                                                   set->scratch, NULL) : ENVSAMP_ERR_MEMORY;
    int i;

    if (result == ENVSAMP_OK) {
        qsort(set->raw, (size_t)set->wanted, sizeof *set->raw, brighter);
        for (i = 0; i < set->count; i++) {
            set->aim[i] = set->now[i];
            scale(&set->aim[i], 0.0f);
        }
        match(set, taken);
        set->most = set->count > set->most ? set->count : set->most;
    }
    free(taken);
    return result;
}

/* Part of the way of both direction and energy: a dim one that follows a bright one is soon where
   that is. */
void light_set_follow(light_set *set, float part)
{
    float total = 0.0f, largest = 0.0f;
    int i, kept = 0;

    for (i = 0; i < set->count; i++) {
        const envsamp_light before = set->now[i];
        envsamp_light aim = set->aim[i];

        scale(&set->now[i], 1.0f - part);
        scale(&aim, part);
        join(&set->now[i], &aim);
        total += envsamp_luminance(set->now[i].irradiance);
        largest = fmaxf(largest, distance(&before, &set->now[i]));
    }
    set->jump = fmaxf(set->jump, largest / fmaxf(total, 1e-30f));
    for (i = 0; i < set->count; i++)
        if (envsamp_luminance(set->aim[i].irradiance) > 0.0f
            || envsamp_luminance(set->now[i].irradiance) > DARK * total) {
            set->now[kept] = set->now[i];
            set->aim[kept++] = set->aim[i];
        }
    set->count = kept;
}
