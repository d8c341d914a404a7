/* lights_judge.h: what any set of lights of a map must be.
 *
 *     grid g = grid_make(&view);
 *     verdict v = { ... 0 ... };
 *     judge_set(&set, &g, &v);                  energy, and every light
 *     CHECK(verdict_good(&v), ...
 *
 * Include it after the implementation of envsamp.h.
 */
#ifndef LIGHTS_JUDGE_H
#define LIGHTS_JUDGE_H

#include "lights_map.h"

#define ENERGY 1e-5             /* relative: what the lights sum to */
#define INTEGRAL 1e-10          /* relative: a sum of doubles */

enum { BAD_LENGTH = 1, BAD_IRRADIANCE = 2, BAD_CONE = 4, BAD_SIZE = 8, BAD_KIND = 16 };

typedef struct verdict {
    double energy, integral;    /* off, relative, in the worst channel */
    int flags, wrong, lights;   /* what is wrong with how many of so many lights */
    int sets, failed, unfilled; /* calls; those that failed or wrote too far; of a wrong sum of
                                   solid angles */
} verdict;

/* EnvDirects come first. */
static inline int judge_light(const envsamp_light *l, int direct)
{
    const double dir[3] = { (double)l->dir[0], (double)l->dir[1], (double)l->dir[2] };
    int flags = 0, c;

    if (!(fabs(sqrt(dot(dir, dir)) - 1.0) <= 1e-6))
        flags |= BAD_LENGTH;
    for (c = 0; c < 3; c++)
        if (!(l->irradiance[c] >= 0.0f && l->irradiance[c] <= FLT_MAX))
            flags |= BAD_IRRADIANCE;
    if (!(l->cos_extent >= -1.0f && l->cos_extent <= 1.0f))
        flags |= BAD_CONE;
    if (!(l->solid_angle > 0.0f && (double)l->solid_angle <= 4.0 * KD_PI * (1.0 + 1e-6)))
        flags |= BAD_SIZE;
    return flags | (l->direct == direct ? 0 : BAD_KIND);
}

static inline void judge_set(const light_set *s, const grid *g, verdict *v)
{
    const int count = s->desc.count;
    double sr = 0.0;
    int c, i;

    v->sets++;
    v->failed += s->result != ENVSAMP_OK || !set_intact(s) || s->info.count != count;
    if (s->result != ENVSAMP_OK)
        return;
    for (c = 0; c < 3; c++) {
        const double known = g->total.rgb[c];
        double sum = 0.0;

        for (i = 0; i < count; i++)
            sum += (double)s->lights[i].irradiance[c];
        worst(&v->energy, fmax(fabs(sum - known) - LEAST * count, 0.0) / fmax(known, 1e-300));
        worst(&v->integral, fabs(s->info.integral[c] - known) / fmax(known, 1e-300));
    }
    for (i = 0; i < count; i++) {
        const int flags = judge_light(&s->lights[i], i < s->info.direct_count);

        v->flags |= flags;
        v->wrong += flags != 0;
        v->lights++;
        sr += (double)s->lights[i].solid_angle;
    }
    v->unfilled += !(sr <= g->total.sr * (1.0 + 1e-5));
}

static inline int verdict_good(const verdict *v)
{
    return v->sets > 0 && v->failed == 0 && v->energy <= ENERGY && v->integral <= INTEGRAL
        && v->lights > 0 && v->wrong == 0 && v->unfilled == 0;
}

#endif
