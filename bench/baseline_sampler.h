/* baseline_sampler.h: inversion by binary search as a sampler of light.h.
 *
 *     sampler by = sampler_of_cdf("full CDF, binary search", &cdf);
 *
 * Needs baselines.c.
 */
#ifndef BASELINE_SAMPLER_H
#define BASELINE_SAMPLER_H

#include "../examples/common/light.h"
#include "baselines.h"

static inline envsamp_sample sampler_draw_cdf(const void *table, float u0, float u1)
{
    const baseline_sample from = baseline_cdf_sample((const baseline_cdf *)table, u0, u1);
    envsamp_sample s = {{0.0f, 0.0f, 0.0f}, 0.0f, {0.0f, 0.0f}};
    int i;

    for (i = 0; i < 3; i++)
        s.dir[i] = from.dir[i];
    s.pdf = from.pdf;
    return s;
}

static inline sampler sampler_of_cdf(const char *name, const baseline_cdf *cdf)
{
    sampler by = {NULL, sampler_draw_cdf, NULL};

    by.name = name;
    by.table = cdf;
    return by;
}

#endif
