/* decomposed_reference.h: lights of DECOMPOSED made again by brute force over the texels, with
 * libm: the threshold of emissive texels by a sort, numbers of lights, k-means from where they are
 * drawn, and EnvIndirects by halving rectangles; and the judge of every set.
 *
 *     emission e = emission_make(&view, &desc);
 *     swarm w = swarm_make(&e, &desc, mask);        EnvDirects: w.sum, w.at
 *     made = reference_halves(&e, mask, &desc, wanted, boxes, &margin);
 *
 * `margin` is the least difference that decided: what is below rounding says nothing. Include it
 * after the implementation of envsamp.h.
 */
#ifndef DECOMPOSED_REFERENCE_H
#define DECOMPOSED_REFERENCE_H

#include "check.h"
#include "lights_judge.h"

static inline envsamp_lights_desc ask(int count)
{
    envsamp_lights_desc desc = envsamp_lights_defaults();

    desc.method = ENVSAMP_LIGHTS_DECOMPOSED;
    desc.count = count;
    return desc;
}

/* ---- luminance, and the threshold by a sort ---- */

static inline float texel_luminance(const envsamp_image *map, int x, int y)
{
    double rgb[3];
    float clean[3];
    int c;

    texel_rgb(map, x, y, rgb);
    for (c = 0; c < 3; c++)
        clean[c] = (float)rgb[c];
    return map->channels == 1 ? clean[0] : fminf(envsamp_luminance(clean), FLT_MAX);
}

typedef struct ranked { float luminance; double sr; } ranked;

typedef struct ranking {
    ranked *texels;             /* by luminance */
    int count;
    double sr, mean;
    float least, most;
} ranking;

static inline int by_luminance(const void *a, const void *b)
{
    const ranked *x = (const ranked *)a, *y = (const ranked *)b;

    return (x->luminance > y->luminance) - (x->luminance < y->luminance);
}

static inline ranking ranking_make(const envsamp_image *view)
{
    long double sr = 0.0L, light = 0.0L;
    ranking r;
    int x, y, i = 0;

    r.count = view->width * view->height;
    r.texels = (ranked *)kd_allocate((size_t)r.count * sizeof *r.texels);
    for (y = 0; y < view->height; y++)
        for (x = 0; x < view->width; x++, i++) {
            r.texels[i].luminance = texel_luminance(view, x, y);
            r.texels[i].sr = row_sr(view, y);
            sr += (long double)r.texels[i].sr;
            light += (long double)r.texels[i].sr * (long double)r.texels[i].luminance;
        }
    qsort(r.texels, (size_t)r.count, sizeof *r.texels, by_luminance);
    r.least = r.texels[0].luminance;
    r.most = r.texels[r.count - 1].luminance;
    r.sr = (double)sr;
    r.mean = (double)(light / sr);
    return r;
}

static inline float to_float(double value)
{
    return value < (double)FLT_MAX ? (float)value : FLT_MAX;
}

/* L_T. What is compared may be off by 1e-12, up or down: `slack`. */
static inline float ranked_threshold(const ranking *r, const envsamp_lights_desc *desc,
                                     double slack)
{
    const double target = fmax((double)desc->percentile, 0.0) * r->sr;
    const double limit = fmax(fmax((double)desc->lambda * r->mean, 0.0),
                              (double)desc->gamma * (double)r->most);
    long double sum = 0.0L;
    float bound = 0.0f;
    int i;

    for (i = 0; i < r->count && target > 0.0 && (double)sum < target + slack * r->sr; i++) {
        bound = r->texels[i].luminance;
        sum += (long double)r->texels[i].sr;
    }
    return fmaxf(bound, to_float(limit * (1.0 + slack)));
}

/* ---- emissive texels ---- */

/* The scratch of any DECOMPOSED will do. */
static inline envsamp_result mask_make(const envsamp_image *view, const envsamp_lights_desc *desc,
                                       int rubbish, uint8_t *mask, float *threshold)
{
    const envsamp_lights_desc one = ask(1);
    envsamp_sizes sizes;
    kd_guarded scratch;
    envsamp_result result;

    envsamp_lights_sizes(view, &one, &sizes);
    scratch = kd_guarded_make(sizes.scratch_bytes, rubbish);
    result = envsamp_emissive_mask(view, desc, mask, scratch.buffer, threshold);
    if (!kd_guarded_intact(&scratch))
        result = ENVSAMP_ERR_MEMORY;
    free(scratch.block);
    return result;
}

typedef struct emission {
    grid g;
    float *luminance;           /* of each texel, */
    double (*dir)[3];           /* and the direction of its middle */
    uint8_t *mask;
    float threshold;
    int *texel, count;          /* emissive ones */
    double light[2], sr[2];     /* of texels that are not emissive, and that are */
} emission;

static inline emission emission_make(const envsamp_image *view, const envsamp_lights_desc *desc)
{
    const size_t texels = (size_t)view->width * (size_t)view->height;
    emission e;
    int x, y, i = 0;

    memset(&e, 0, sizeof e);
    e.g = grid_make(view);
    e.luminance = (float *)kd_allocate(texels * sizeof *e.luminance);
    e.dir = (double (*)[3])kd_allocate(texels * sizeof *e.dir);
    e.mask = (uint8_t *)kd_allocate(texels);
    e.texel = (int *)kd_allocate(texels * sizeof *e.texel);
    mask_make(view, desc, RUBBISH, e.mask, &e.threshold);
    for (y = 0; y < view->height; y++)
        for (x = 0; x < view->width; x++, i++) {
            e.luminance[i] = texel_luminance(view, x, y);
            point_dir(view, (double)x + 0.5, (double)y + 0.5, e.dir[i]);
            e.light[e.mask[i]] += (double)e.luminance[i] * e.g.cells[i].sr;
            e.sr[e.mask[i]] += e.g.cells[i].sr;
            if (e.mask[i])
                e.texel[e.count++] = i;
        }
    return e;
}

static inline void emission_free(emission *e)
{
    free(e->g.cells);
    free(e->luminance);
    free(e->dir);
    free(e->mask);
    free(e->texel);
}

/* How many EnvDirects there must be, before rounding. */
static inline double budget_of(const emission *e, int count)
{
    const double dim = e->light[0] * pow(e->sr[0], 0.25), lit = e->light[1] * pow(e->sr[1], 0.25);

    return (double)count * lit / (dim + lit);
}

static inline int budget_right(const emission *e, int count, int directs)
{
    const double wanted = budget_of(e, count), slack = e->light[0] > 0.0 ? 1e-6 : 0.0;
    const int most = e->light[0] > 0.0 ? count - 1 : count;
    const int least = e->light[1] > 0.0 ? 1 : 0;
    int low = (int)floor(wanted + 0.5 - slack), high = (int)floor(wanted + 0.5 + slack);

    if (e->light[0] > 0.0) {
        low = low < least ? least : low;
        high = high < least ? least : high;
        low = low > most ? most : low;
        high = high > most ? most : high;
        low = low > e->count ? e->count : low;
        high = high > e->count ? e->count : high;
    }
    return directs >= low && directs <= high;
}

/* Cosine of the angle that EnvDirects keep free, and of twice that angle. */
static inline double near_cosine(const envsamp_lights_desc *desc)
{
    return desc->mask_scale > 0.0f
         ? 1.0 - 2.0 * (double)desc->mask_scale / (double)desc->count : 2.0;
}

static inline double far_cosine(const emission *e, const envsamp_lights_desc *desc)
{
    const double near = near_cosine(desc);

    return near > 1.0 || near <= 0.0 || !(e->light[0] > 0.0) ? -2.0 : 2.0 * near * near - 1.0;
}

/* The emissive texel that a light stands on, or -1. */
static inline int texel_under(const emission *e, const envsamp_light *l)
{
    double dir[3], best = -2.0;
    int i, at = -1;

    dir_of(l, dir);
    for (i = 0; i < e->count; i++) {
        const double cosine = dot(e->dir[e->texel[i]], dir);

        if (cosine > best) {
            best = cosine;
            at = e->texel[i];
        }
    }
    return at >= 0 && distance(e->dir[at], dir) <= 1e-6 ? at : -1;
}

/* ---- what every set must be ---- */

/* What is wrong with EnvDirects. */
typedef struct direct_tally {
    verdict v;
    int thresholds, budgets, bright, far, off, shared, directs;
} direct_tally;

/* Of emissive texels that a light may stand for. */
static inline cell within(const emission *e, int at, double cosine)
{
    cell sum;
    int i;

    memset(&sum, 0, sizeof sum);
    for (i = 0; i < e->count; i++)
        if (dot(e->dir[e->texel[i]], e->dir[at]) >= cosine - 1e-9)
            add_cell(&sum, &e->g.cells[e->texel[i]]);
    return sum;
}

static inline int exceeds(const envsamp_light *l, const cell *sum)
{
    int c, more = (double)l->solid_angle > sum->sr * (1.0 + ENERGY);

    for (c = 0; c < 3; c++)
        more |= (double)l->irradiance[c] > sum->rgb[c] * (1.0 + ENERGY) + LEAST;
    return more;
}

/* Where it is crowded several may share a texel. */
static inline void judge_directs(const light_set *s, const emission *e, int crowded,
                                 direct_tally *t)
{
    const double reach = far_cosine(e, &s->desc);
    uint8_t *taken = (uint8_t *)kd_allocate((size_t)e->g.view.width * (size_t)e->g.view.height);
    cell all, sum;
    int i, c;

    memset(&sum, 0, sizeof sum);
    memset(&all, 0, sizeof all);
    for (i = 0; i < e->count; i++)
        add_cell(&all, &e->g.cells[e->texel[i]]);
    for (i = 0; i < s->info.direct_count; i++) {
        const envsamp_light *l = &s->lights[i];
        const int at = texel_under(e, l);

        sum.sr += (double)l->solid_angle;
        for (c = 0; c < 3; c++)
            sum.rgb[c] += (double)l->irradiance[c];
        t->off += at < 0;
        if (at >= 0) {
            const cell there = within(e, at, reach);

            t->far += exceeds(l, &there);
            t->shared += taken[at] && !crowded;
            taken[at] = 1;
        }
        t->directs++;
    }
    for (c = 0; c < 3; c++)
        t->bright += sum.rgb[c] > all.rgb[c] * (1.0 + ENERGY) + LEAST * s->desc.count;
    t->bright += sum.sr > all.sr * (1.0 + ENERGY);
    free(taken);
}

static inline void judge_made(const light_set *s, const emission *e, direct_tally *t)
{
    const int crowded = !(e->light[0] > 0.0) && s->desc.count > e->count;

    if (s->result == ENVSAMP_OK) {
        t->thresholds += memcmp(&s->info.threshold, &e->threshold, sizeof e->threshold) != 0;
        t->budgets += !budget_right(e, s->desc.count, s->info.direct_count);
        judge_directs(s, e, crowded, t);
    }
    judge_set(s, &e->g, &t->v);
}

static inline void judge(const emission *e, const envsamp_lights_desc *desc, direct_tally *t)
{
    light_set s;

    set_make(&s, &e->g.view, desc);
    judge_made(&s, e, t);
    set_free(&s);
}

static inline int tally_good(const direct_tally *t)
{
    return verdict_good(&t->v) && !t->thresholds && !t->budgets && !t->bright && !t->far
        && !t->off && !t->shared;
}

static inline void check_tally(const char *name, const direct_tally *t)
{
    CHECK(tally_good(t), "%s: %d of %d sets wrong, %d fill too much, energy %.1e, integral %.1e "
          "off, %d of %d lights wrong, flags %d; %d thresholds, %d numbers of EnvDirects; of %d "
          "%d are not on emissive texels, %d share one, %d stand for too much, sums of %d",
          name, t->v.failed, t->v.sets, t->v.unfilled, t->v.energy, t->v.integral, t->v.wrong,
          t->v.lights, t->v.flags, t->thresholds, t->budgets, t->directs, t->off, t->shared,
          t->far, t->bright);
}

/* ---- k-means, made again from where lights are drawn ---- */

enum { MOST_LIGHTS = 96 };

typedef struct swarm {
    const emission *e;
    double axis[MOST_LIGHTS][3];
    int at[MOST_LIGHTS];        /* texel of each light */
    cell sum[MOST_LIGHTS];      /* what it stands for */
    int lights, *owner;         /* of each emissive texel */
    double margin;              /* least difference of cosines that decided; -1: an empty cell */
} swarm;

/* The largest of some values, and by how much. */
typedef struct contest { double best, second; int at; } contest;

static inline void contest_add(contest *c, double value, int at)
{
    if (value > c->best) {
        c->second = c->best;
        c->best = value;
        c->at = at;
    } else if (value > c->second) {
        c->second = value;
    }
}

/* Gives each emissive texel to the nearest light; returns how many changed hands. */
static inline int swarm_assign(swarm *w)
{
    int moved = 0, i, k;

    for (i = 0; i < w->e->count; i++) {
        contest nearest = { -3.0, -3.0, 0 };

        for (k = 0; k < w->lights; k++)
            contest_add(&nearest, dot(w->e->dir[w->e->texel[i]], w->axis[k]), k);
        w->margin = fmin(w->margin, nearest.best - nearest.second);
        moved += w->owner[i] != nearest.at;
        w->owner[i] = nearest.at;
    }
    return moved;
}

static inline void swarm_centre(swarm *w)
{
    int i, k;

    memset(w->sum, 0, sizeof w->sum);
    for (i = 0; i < w->e->count; i++)
        add_cell(&w->sum[w->owner[i]], &w->e->g.cells[w->e->texel[i]]);
    for (k = 0; k < w->lights; k++) {
        w->margin = w->sum[k].luminance > 0.0 ? w->margin : -1.0;
        memcpy(w->axis[k], w->sum[k].v, sizeof w->axis[k]);
        normalise(w->axis[k]);
    }
}

/* On the emissive texel of its cell that is nearest to the centroid; what is too far from there is
   given back: its mark in `mask` goes. */
static inline void swarm_place(swarm *w, double reach, uint8_t *mask)
{
    const emission *e = w->e;
    int i, k;

    memcpy(mask, e->mask, (size_t)e->g.view.width * (size_t)e->g.view.height);
    memset(w->sum, 0, sizeof w->sum);
    for (k = 0; k < w->lights; k++) {
        contest nearest = { -3.0, -3.0, 0 };

        for (i = 0; i < e->count; i++)
            if (w->owner[i] == k)
                contest_add(&nearest, dot(e->dir[e->texel[i]], w->axis[k]), e->texel[i]);
        w->margin = fmin(w->margin, nearest.best > -3.0 ? nearest.best - nearest.second : -1.0);
        w->at[k] = nearest.at;
    }
    for (i = 0; i < e->count; i++) {
        const double cosine = dot(e->dir[e->texel[i]], e->dir[w->at[w->owner[i]]]);

        w->margin = fmin(w->margin, fabs(cosine - reach));
        if (cosine < reach)
            mask[e->texel[i]] = 0;
        else
            add_cell(&w->sum[w->owner[i]], &e->g.cells[e->texel[i]]);
    }
}

/* From the lights of a set without rounds. */
static inline swarm swarm_make(const emission *e, const envsamp_lights_desc *desc, uint8_t *mask)
{
    envsamp_lights_desc drawn = *desc;
    int moved = 1, i, k;
    light_set s;
    swarm w;

    memset(&w, 0, sizeof w);
    drawn.refine_rounds = -1;
    set_make(&s, &e->g.view, &drawn);
    w.e = e;
    w.margin = 1.0;
    w.owner = (int *)kd_allocate((size_t)e->count * sizeof *w.owner);
    w.lights = s.info.direct_count < MOST_LIGHTS ? s.info.direct_count : MOST_LIGHTS;
    for (k = 0; k < w.lights; k++)
        memcpy(w.axis[k], e->dir[texel_under(e, &s.lights[k])], sizeof w.axis[k]);
    swarm_assign(&w);
    for (i = 0; i < desc->refine_rounds && moved; i++) {
        swarm_centre(&w);
        moved = swarm_assign(&w);
    }
    swarm_place(&w, far_cosine(e, desc), mask);
    set_free(&s);
    return w;
}

/* How far a light is from what it must be for a sum over texels, a share of it, and a place; NULL:
   the centroid. */
static inline double off_cell(const envsamp_light *l, const cell *sum, double share,
                              const double *at)
{
    double middle[3], dir[3], length, off;
    int c;

    memcpy(middle, sum->v, sizeof middle);
    length = normalise(middle);
    dir_of(l, dir);
    off = 1e-1 * distance(at ? at : middle, dir);
    worst(&off, 1e-1 * fabs((double)l->cos_extent
                            - fmax(2.0 * length / sum->luminance - 1.0, -1.0)));
    worst(&off, fabs((double)l->solid_angle / (sum->sr * share) - 1.0));
    for (c = 0; c < 3; c++)
        worst(&off, fabs((double)l->irradiance[c] / (sum->rgb[c] * share) - 1.0));
    return off;
}

#define SAME 2e-6               /* off_cell of the same lights */

/* ---- EnvIndirects, made again ---- */

/* A rectangle of texels. */
typedef struct box {
    int x0, y0, x1, y1, copies;
    cell sum;
    double term[3];             /* standard deviation x solid angle, longer side, light */
} box;

/* Whether it is at least as long across as down, on the sphere, and how long it is. */
static inline int box_wide(const envsamp_image *map, const box *b, double *longer)
{
    const double polar = map->mapping == ENVSAMP_LATLONG ? KD_PI : 0.5 * KD_PI;
    const double middle = 0.5 * (double)(b->y0 + b->y1) / (double)map->height;
    double across = (double)(b->x1 - b->x0) / (double)map->width;
    double down = (double)(b->y1 - b->y0) / (double)map->height;

    if (map->mapping != ENVSAMP_OCTAHEDRAL) {
        across *= 2.0 * KD_PI * sin(polar * middle);
        down *= polar;
    }
    *longer = fmax(across, down);
    return across >= down;
}

/* Of texels that are not marked. */
static inline box box_make(const emission *e, const uint8_t *mask, int x0, int y0, int x1, int y1)
{
    const size_t width = (size_t)e->g.view.width;
    double squares = 0.0, mean;
    size_t x, y;
    box b;

    memset(&b, 0, sizeof b);
    b.x0 = x0;
    b.y0 = y0;
    b.x1 = x1;
    b.y1 = y1;
    b.copies = 1;
    for (y = (size_t)y0; y < (size_t)y1; y++)
        for (x = (size_t)x0; x < (size_t)x1; x++)
            if (!mask[y * width + x])
                add_cell(&b.sum, &e->g.cells[y * width + x]);
    mean = b.sum.sr > 0.0 ? b.sum.luminance / b.sum.sr : 0.0;
    for (y = (size_t)y0; y < (size_t)y1; y++)
        for (x = (size_t)x0; x < (size_t)x1; x++)
            if (!mask[y * width + x]) {
                const cell *texel = &e->g.cells[y * width + x];
                const double off = texel->luminance / texel->sr - mean;

                squares += off * off * texel->sr;
            }
    b.term[0] = b.sum.sr > 0.0 ? sqrt(squares / b.sum.sr) * b.sum.sr : 0.0;
    box_wide(&e->g.view, &b, &b.term[1]);
    b.term[2] = b.sum.luminance;
    return b;
}

static inline int box_texel(const box *b)
{
    return b->x1 - b->x0 == 1 && b->y1 - b->y0 == 1;
}

/* Halves a box across its longer side, and what is left of it when black halves are taken away;
   0 if that is one texel. */
static inline int box_halve(const emission *e, const uint8_t *mask, box *b, box *rest)
{
    while (!box_texel(b)) {
        const box whole = *b;
        const int x = (b->x0 + b->x1) / 2, y = (b->y0 + b->y1) / 2;
        double longer;

        if (b->y1 - b->y0 == 1 || (b->x1 - b->x0 > 1 && box_wide(&e->g.view, b, &longer))) {
            *b = box_make(e, mask, whole.x0, whole.y0, x, whole.y1);
            *rest = box_make(e, mask, x, whole.y0, whole.x1, whole.y1);
        } else {
            *b = box_make(e, mask, whole.x0, whole.y0, whole.x1, y);
            *rest = box_make(e, mask, whole.x0, y, whole.x1, whole.y1);
        }
        if (b->sum.luminance > 0.0 && rest->sum.luminance > 0.0)
            return 1;
        *b = b->sum.luminance > 0.0 ? *b : *rest;
    }
    return 0;
}

/* The largest term of boxes that can be cut. */
static inline double most_term(const box *boxes, int made, int term)
{
    double most = 0.0;
    int i;

    for (i = 0; i < made; i++)
        if (!box_texel(&boxes[i]))
            most = fmax(most, boxes[i].term[term]);
    return most > 0.0 ? most : 1.0;
}

/* The box to be cut next, or -1. */
static inline int next_box(const box *boxes, int made, const double scale[3], double *margin)
{
    contest largest = { -1.0, -1.0, -1 };
    int i;

    for (i = 0; i < made; i++)
        if (!box_texel(&boxes[i]))
            contest_add(&largest, dot(scale, boxes[i].term), i);
    *margin = largest.at >= 0 ? fmin(*margin, largest.best - largest.second) : *margin;
    return largest.at;
}

/* Returns how many boxes there are; copies add up to `wanted`. Terms are weighed anew after every
   cut. */
static inline int reference_halves(const emission *e, const uint8_t *mask,
                                   const envsamp_lights_desc *desc, int wanted, box *boxes,
                                   double *margin)
{
    const double weights[3] = { (double)desc->weight_variance, (double)desc->weight_extent,
                                (double)desc->weight_energy };
    double scale[3];
    int made = 1, weighed = 0, at, k;

    boxes[0] = box_make(e, mask, 0, 0, e->g.view.width, e->g.view.height);
    while (made < wanted) {
        for (k = 0; k < 3 && weighed != made; k++)
            scale[k] = weights[k] / most_term(boxes, made, k);
        weighed = made;
        at = next_box(boxes, made, scale, margin);
        if (at < 0)
            break;
        made += box_halve(e, mask, &boxes[at], &boxes[made]);
    }
    for (k = made; k < wanted; k++) {
        contest largest = { -1.0, -1.0, 0 };

        for (at = 0; at < made; at++)
            contest_add(&largest, boxes[at].sum.luminance / boxes[at].copies, at);
        boxes[largest.at].copies++;
    }
    return made;
}

/* How many EnvIndirects have no box. */
static inline int odd_lights(const light_set *s, const box *boxes, int made)
{
    int right = 0, i, k;

    for (i = 0; i < made; i++)
        for (k = s->info.direct_count; k < s->desc.count; k++)
            right += off_cell(&s->lights[k], &boxes[i].sum, 1.0 / boxes[i].copies, NULL) <= SAME;
    return abs(s->desc.count - s->info.direct_count - right);
}

/* ---- lights made again ---- */

/* Lights made again: how many were, were left to rounding, and differ. */
typedef struct remake { int sets, left, directs, indirects, lights, given_back; } remake;

static inline void remake_indirects(const light_set *s, const emission *e, const uint8_t *mask,
                                    remake *r)
{
    const int wanted = s->desc.count - s->info.direct_count;
    box *boxes = (box *)kd_allocate((size_t)(wanted + 1) * sizeof *boxes);
    double margin = 1.0;
    const int made = reference_halves(e, mask, &s->desc, wanted, boxes, &margin);

    r->sets++;
    r->lights += wanted;
    if (margin < 1e-9)
        r->left++;
    else
        r->indirects += odd_lights(s, boxes, made);
    free(boxes);
}

/* A set and its remake by brute force. */
static inline void remake_set(const emission *e, const envsamp_lights_desc *desc, remake *r)
{
    uint8_t *mask = (uint8_t *)kd_allocate((size_t)e->g.view.width * (size_t)e->g.view.height);
    swarm w = swarm_make(e, desc, mask);
    light_set s;
    int i, k;

    set_make(&s, &e->g.view, desc);
    if (w.margin < 1e-6) {
        r->sets++;
        r->left++;
    } else {
        r->directs += s.info.direct_count != w.lights;
        for (k = 0; k < w.lights; k++)
            r->directs += !(off_cell(&s.lights[k], &w.sum[k], 1.0, e->dir[w.at[k]]) <= SAME);
        for (i = 0; i < e->count; i++)
            r->given_back += !mask[e->texel[i]];
        r->lights += w.lights;
        remake_indirects(&s, e, mask, r);
    }
    set_free(&s);
    free(w.owner);
    free(mask);
}

#endif
