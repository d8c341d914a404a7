/* kd_reference.h: what kd tables must hold, by brute force over the map and with libm: sums over
 * the texels of each block, the excess variance, and the models of FIT with their best fits.
 *
 *     reference r;
 *     if (reference_build(&r, &map, &desc)) ... r.f.info ... reference_excess(&r) ...
 *     reference_free(&r);
 *
 * Include it after the implementation of envsamp.h. Nothing here calls the library but for the
 * build, the facts about the table and its blocks.
 */
#ifndef KD_REFERENCE_H
#define KD_REFERENCE_H

#include "kd_fixture.h"

#include <float.h>

#include "../examples/common/real_maps.h"

/* ---- a table, and the sums over its blocks ---- */

typedef struct reference {
    kd_fixture f;
    kd_cover cover;
    const kd_rect *rects;       /* in the order of the table */
    double *mass, *square;      /* of each block: sums of L and of L^2 times solid angle */
    double *peak;               /* largest L */
    double integral;
} reference;

/* Shares a texel among the blocks that hold parts of it. */
static inline void reference_add_texel(reference *r, int texel, double value, double sr)
{
    int k;

    for (k = r->cover.first[texel]; k < r->cover.first[texel + 1]; k++) {
        const int index = r->cover.pieces[k].block;
        const double part = r->cover.pieces[k].share * sr;

        r->mass[index] += value * part;
        r->square[index] += value * value * part;
        r->peak[index] = value > r->peak[index] ? value : r->peak[index];
    }
    r->integral += value * sr;
}

/* Whether the table was built. Free it in either case. The map must outlive it. */
static inline int reference_build(reference *r, const image *map, const envsamp_kd_desc *desc)
{
    const envsamp_image view = kd_image(map->rgb, map->width, map->height, 3);
    size_t count;
    int x, y;

    memset(r, 0, sizeof *r);
    if (!kd_fixture_build(&r->f, &view, desc))
        return 0;
    count = (size_t)r->f.info.block_count;
    r->cover = kd_cover_make(&r->f);
    r->rects = r->cover.rects;
    r->mass = (double *)kd_allocate(count * sizeof *r->mass);
    r->square = (double *)kd_allocate(count * sizeof *r->square);
    r->peak = (double *)kd_allocate(count * sizeof *r->peak);
    for (y = 0; y < map->height; y++) {
        const double sr = kd_solid_angle(map->width, map->height, 0, y, 1, y + 1);

        for (x = 0; x < map->width; x++)
            reference_add_texel(r, y * map->width + x, kd_texel(&view, x, y), sr);
    }
    return 1;
}

static inline void reference_free(reference *r)
{
    kd_cover_free(&r->cover);
    free(r->mass);
    free(r->square);
    free(r->peak);
    kd_fixture_free(&r->f);
    memset(r, 0, sizeof *r);
}

/* E[(L/pdf)^2] / integral^2 - 1 */
static inline double reference_excess(const reference *r)
{
    double second = 0.0;
    int i;

    for (i = 0; i < r->f.info.block_count; i++)
        if (r->square[i] > 0.0)
            second += r->rects[i].solid_angle * r->square[i] / r->rects[i].probability;
    return second / r->integral / r->integral - 1.0;
}

/* Largest L / (pdf integral). */
static inline double reference_max_ratio(const reference *r)
{
    double largest = 0.0;
    int i;

    for (i = 0; i < r->f.info.block_count; i++)
        if (r->peak[i] > 0.0) {
            const double ratio = r->peak[i] * r->rects[i].solid_angle
                               / (r->rects[i].probability * r->integral);

            largest = ratio > largest ? ratio : largest;
        }
    return largest;
}

/* Sum over blocks of |share of the mass - probability|. */
static inline double reference_l1(const reference *r)
{
    double sum = 0.0;
    int i;

    for (i = 0; i < r->f.info.block_count; i++)
        sum += fabs(r->mass[i] / r->integral - r->rects[i].probability);
    return sum;
}

/* The block that a point of the map lies in. */
static inline int reference_owner(const reference *r, double u, double v)
{
    return kd_cover_owner(&r->cover, u, v);
}

/* Total variation between the probabilities and how often the blocks are drawn by all 2^24
   values of u0, or, of ALIAS, of u0 and u1. */
static inline double reference_realised(const reference *r)
{
    const int all = 1 << 24, count = r->f.info.block_count;
    double *drawn = (double *)kd_allocate((size_t)count * sizeof *drawn);
    double distance = 0.0;
    int i;

    for (i = 0; i < all; i++) {
        const envsamp_sample s = envsamp_kd_sample(r->f.kd, (float)i / (float)all, 0.5f);
        float u[2];

        kd_alias_draw(r->f.kd, i, u);
        drawn[r->f.desc.select == ENVSAMP_KD_ALIAS
              ? inside_alias_block(r->f.kd, u[0], u[1])
              : reference_owner(r, (double)s.uv[0], (double)s.uv[1])] += 1.0;
    }
    for (i = 0; i < count; i++)
        distance += 0.5 * fabs(drawn[i] / (double)all - r->rects[i].probability);
    free(drawn);
    return distance;
}

/* ---- the models of FIT ---- */

static inline int reference_falling(const void *a, const void *b)
{
    double x, y;

    memcpy(&x, a, sizeof x);
    memcpy(&y, b, sizeof y);
    return (x < y) - (x > y);
}

/* What a fit aims at: shares of the blocks in falling order, of the mass for L1, of
   sqrt(solid angle x sum L^2) for CHI2. */
typedef struct reference_target {
    double *share;
    int count;                  /* of shares above zero */
    double total;
    envsamp_kd_objective objective;
} reference_target;

static inline reference_target reference_target_of(const reference *r,
                                                   envsamp_kd_objective objective)
{
    const int blocks = r->f.info.block_count;
    reference_target t;
    int i;

    t.share = (double *)kd_allocate((size_t)blocks * sizeof *t.share);
    t.total = 0.0;
    t.count = 0;
    t.objective = objective;
    for (i = 0; i < blocks; i++) {
        t.share[i] = objective == ENVSAMP_KD_L1 ? r->mass[i]
                                                : sqrt(r->rects[i].solid_angle * r->square[i]);
        t.total += t.share[i];
        t.count += t.share[i] > 0.0;
    }
    qsort(t.share, (size_t)blocks, sizeof *t.share, reference_falling);
    for (i = 0; i < blocks; i++)
        t.share[i] /= t.total;
    return t;
}

/* Integral of (alpha + x)^-beta from 0 to x, but for a constant. */
static inline double reference_model(double alpha, double beta, double x)
{
    const double log_ratio = log1p(x / alpha), gamma = 1.0 - beta;

    return fabs(gamma) < 1e-9 ? log_ratio : expm1(gamma * log_ratio) / gamma;
}

/* L1: the distance. CHI2: the sum of share^2 / bin, at least 1. */
static inline double reference_cost(const reference_target *t, double log2_alpha, double beta)
{
    const double alpha = exp2(log2_alpha);
    const double whole = reference_model(alpha, beta, (double)t->count);
    double low = 0.0, cost = 0.0;
    int k;

    for (k = 0; k < t->count; k++) {
        const double high = reference_model(alpha, beta, (double)(k + 1));
        const double bin = (high - low) / whole;

        cost += t->objective == ENVSAMP_KD_L1 ? fabs(t->share[k] - bin)
                                              : t->share[k] * t->share[k] / bin;
        low = high;
    }
    return cost;
}

/* CHI2's cost as excess variance. */
static inline double reference_cost_excess(const reference *r, const reference_target *t,
                                           double cost)
{
    return cost * (t->total / r->integral) * (t->total / r->integral) - 1.0;
}

/* Smallest cost within a step of log2 alpha, by golden sections. */
static inline double reference_refine(const reference_target *t, double beta, double middle,
                                      double step)
{
    const double golden = 0.61803398874989485;
    double low = middle - step, high = middle + step, best = DBL_MAX;
    double a = high - golden * (high - low), b = low + golden * (high - low);
    double cost_a = reference_cost(t, a, beta), cost_b = reference_cost(t, b, beta);
    int i;

    for (i = 0; i < 24; i++) {
        best = fmin(best, fmin(cost_a, cost_b));
        if (cost_a < cost_b) {
            high = b;
            b = a;
            cost_b = cost_a;
            cost_a = reference_cost(t, a = high - golden * (high - low), beta);
        } else {
            low = a;
            a = b;
            cost_a = cost_b;
            cost_b = reference_cost(t, b = low + golden * (high - low), beta);
        }
    }
    return fmin(best, fmin(cost_a, cost_b));
}

#define REFERENCE_LOG2_ALPHA_MIN (-40.0)   /* far below what any map wants */

/* Smallest cost at one beta: a dense scan of log2 alpha, from `from` to a model that is flat,
   then golden sections about every minimum of the scan that is within a hundredth of the best. */
static inline double reference_minimum(const reference_target *t, double beta, double from,
                                       double step)
{
    const double end = 12.0 + log2((double)t->count);
    const int count = (int)((end - from) / step) + 1;
    double *cost = (double *)kd_allocate((size_t)count * sizeof *cost), best = DBL_MAX;
    double refined;
    int i;

    for (i = 0; i < count; i++) {
        cost[i] = reference_cost(t, from + step * (double)i, beta);
        best = fmin(best, cost[i]);
    }
    refined = best;
    for (i = 0; i < count; i++)
        if (cost[i] <= 1.01 * best && (i == 0 || cost[i] <= cost[i - 1])
            && (i + 1 == count || cost[i] <= cost[i + 1]))
            refined = fmin(refined, reference_refine(t, beta, from + step * (double)i, step));
    free(cost);
    return refined;
}

#endif
