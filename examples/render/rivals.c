/* rivals.c: see rivals.h. Every method labels each texel with a light; then the lights are summed.
 *
 * Structured importance sampling [Agarwal, Ramamoorthi, Belongie, Jensen 2003]. Known: importance
 * of a region is L w^(1/4), L being its light and w its solid angle; the map is cut into levels at
 * multiples of the standard deviation of its radiance, levels into connected components; each gets
 * lights by its importance, from the brightest level down; within a component they are placed by
 * Hochbaum and Shmoys' farthest-first traversal; a stratum's light is integrated, and comes from
 * its centre. Filled in: six levels; rounding by Sainte-Lague; the first light of all is placed on
 * its component's brightest texel; a component too small for a light goes to the nearest one; the
 * centre is that of light, since that of solid angle has 1.4 times the error at 32 lights.
 *
 * TMMS [Feng, Yang, Wan, Yu 2016]. Known, from its abstract: mean-shift clusters of the tone-mapped
 * map, too many of them, are refined by splits and merges that balance their importance. Filled in:
 * Reinhard's global operator; fixed bandwidths in place of adaptive ones; importance L w^(1/4);
 * splits at the centroid of light, across the axis along which it spreads most; merges of the least
 * important with the neighbour that leaves the least importance. It is a method after theirs.
 *
 * FHIS [Ostromoukhov, Donohue, Jodoin 2004]. Known, from its abstract: points of a Penrose tiling
 * that is subdivided over and over are numbered in the Fibonacci system; a point is a sample where
 * its number is below the density; tabulated correction vectors even the pattern out. Filled in:
 * half rhombs with a point at the centroid; one part of a half keeps its number, the others are
 * numbered behind all, in the order of parents, so that numbers grow as Fibonacci's do; the tiling
 * lies on azimuth and height, which keep areas; strata are the texels nearest to each sample, and a
 * texel is shared by samples in it. There are no correction vectors: their table is not known. */
#include "rivals.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PI 3.14159265358979323846
#define LEVELS 6                /* of structured importance sampling */
#define WINDOW 6                /* of mean shift: texels to each side, ... */
#define RANGE 0.06f             /* ... difference of tone, from 0 to 1, ... */
#define SHIFTS 5                /* ... and steps */
#define SMALL 16                /* texels of a cluster that may join the most similar neighbour */
#define TILES_MAX 1e10         /* of the whole tiling: what a float's vertices can tell apart */

/* A map as texels; `label` is the light of each. */
typedef struct sky {
    int width, height, count;
    float *rgb, *luminance, *dir;       /* 3, 1, 3 a texel */
    double *sr;                         /* of a row's texels */
    int *label;
    double light;                       /* luminance x solid angle of all */
    void *memory[5];
} sky;

const char *rival_name(rival method)
{
    static const char *const names[RIVAL_COUNT] = { "structured", "TMMS", "FHIS" };

    return (int)method >= 0 && method < RIVAL_COUNT ? names[method] : "unknown";
}

/* ---- the map ---- */

static void sky_free(sky *s)
{
    int i;

    for (i = 0; i < 5; i++)
        free(s->memory[i]);
}

static double sky_light(const sky *s, int i)
{
    return (double)s->luminance[i] * s->sr[i / s->width];
}

static void sky_row(sky *s, const envsamp_image *image, int y)
{
    const size_t stride = image->row_stride_bytes;
    const size_t packed = (size_t)image->width * (size_t)image->channels * sizeof(float);
    const char *row = (const char *)image->pixels + (stride ? stride : packed) * (size_t)y;
    int x, c;

    for (x = 0; x < s->width; x++) {
        const int i = y * s->width + x;
        float *rgb = s->rgb + 3 * i;
        for (c = 0; c < 3; c++) {
            const int from = image->channels == 1 ? x : x * image->channels + c;
            memcpy(rgb + c, row + (size_t)from * sizeof(float), sizeof(float));
            if (!(rgb[c] > 0.0f && rgb[c] <= FLT_MAX))
                rgb[c] = 0.0f;
        }
        envsamp_uv_to_dir(ENVSAMP_LATLONG, ((float)x + 0.5f) / (float)s->width,
                          ((float)y + 0.5f) / (float)s->height, s->dir + 3 * i);
        s->luminance[i] = envsamp_luminance(rgb);
        s->label[i] = -1;
        s->light += sky_light(s, i);
    }
}

static envsamp_result sky_make(sky *s, const envsamp_image *image)
{
    const size_t count = (size_t)image->width * (size_t)image->height;
    const double half = 0.5 * PI / image->height;
    int y, i;

    memset(s, 0, sizeof *s);
    s->width = image->width;
    s->height = image->height;
    s->count = (int)count;
    s->memory[0] = s->rgb = (float *)malloc(3 * count * sizeof(float));
    s->memory[1] = s->luminance = (float *)malloc(count * sizeof(float));
    s->memory[2] = s->dir = (float *)malloc(3 * count * sizeof(float));
    s->memory[3] = s->label = (int *)malloc(count * sizeof(int));
    s->memory[4] = s->sr = (double *)malloc((size_t)s->height * sizeof(double));
    for (i = 0; i < 5; i++)
        if (!s->memory[i])
            return ENVSAMP_ERR_MEMORY;
    for (y = 0; y < s->height; y++) {
        s->sr[y] = 4.0 * PI / s->width * sin(half) * sin(half * (2 * y + 1));
        sky_row(s, image, y);
    }
    return s->light > 0.0 ? ENVSAMP_OK : ENVSAMP_ERR_BLACK;
}

static float dot(const float a[3], const float b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* The texel at the right or below, or -1. Azimuth goes round. */
static int neighbour(const sky *s, int i, int below)
{
    if (below)
        return i + s->width < s->count ? i + s->width : -1;
    return i % s->width + 1 < s->width ? i + 1 : i + 1 - s->width;
}

static double importance(double light, double sr)
{
    return light * sqrt(sqrt(sr));
}

/* ---- lights of labels ---- */


typedef struct sums { double rgb[3], sr, by_sr[3], by_light[3]; } sums;

static void sum_strata(const sky *s, sums *all)
{
    int i, c;

    for (i = 0; i < s->count; i++) {
        sums *to = &all[s->label[i]];
        const double sr = s->sr[i / s->width], light = sky_light(s, i);
        to->sr += sr;
        for (c = 0; c < 3; c++) {
            to->rgb[c] += (double)s->rgb[3 * i + c] * sr;
            to->by_sr[c] += (double)s->dir[3 * i + c] * sr;
            to->by_light[c] += (double)s->dir[3 * i + c] * light;
        }
    }
}

static int set_direction(envsamp_light *light, const double v[3])
{
    const double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    int c;

    for (c = 0; c < 3 && length > 1e-12; c++)
        light->dir[c] = (float)(v[c] / length);
    return length > 1e-12;
}

/* Every texel has a label below `made`. Unless directions are `given`, they become the centroids of
 * light, or, of strata without any, those of solid angle. */
static envsamp_result sum_lights(const sky *s, int made, int given, envsamp_light *lights)
{
    sums *all = (sums *)calloc((size_t)made, sizeof *all);
    int i, c;

    if (!all)
        return ENVSAMP_ERR_MEMORY;
    sum_strata(s, all);
    for (i = 0; i < made; i++) {
        envsamp_light *light = &lights[i];
        if (!given) {
            const float up[3] = { 0.0f, 0.0f, 1.0f };
            memcpy(light->dir, up, sizeof up);
            if (!set_direction(light, all[i].by_light))
                set_direction(light, all[i].by_sr);
        }
        for (c = 0; c < 3; c++)
            light->irradiance[c] = (float)all[i].rgb[c];
        light->solid_angle = (float)all[i].sr;
        light->cos_extent = 1.0f;
        light->direct = 0;
    }
    for (i = 0; i < s->count; i++) {
        envsamp_light *light = &lights[s->label[i]];
        const float cosine = dot(light->dir, s->dir + 3 * i);
        light->cos_extent = fmaxf(fminf(light->cos_extent, cosine), -1.0f);
    }
    free(all);
    return ENVSAMP_OK;
}

/* Labels texels that have none yet with the nearest of `made` directions. */
static void label_nearest(sky *s, const envsamp_light *lights, int made)
{
    int i, k;

    for (i = 0; i < s->count; i++) {
        float best = -2.0f;
        if (s->label[i] >= 0)
            continue;
        for (k = 0; k < made; k++) {
            const float cosine = dot(lights[k].dir, s->dir + 3 * i);
            if (cosine > best) {
                best = cosine;
                s->label[i] = k;
            }
        }
    }
}

/* ---- sets that join ---- */

static int find_root(int *parent, int i)
{
    while (parent[i] != i)
        i = parent[i] = parent[parent[i]];
    return i;
}

static void join(int *parent, int a, int b)
{
    a = find_root(parent, a);
    b = find_root(parent, b);
    if (a < b)
        parent[b] = a;
    else
        parent[a] = b;
}

/* Numbers sets from 0 in the order of their first members, which are their roots. `parent` becomes
 * those numbers. Returns how many sets there are. */
static int number_sets(int *parent, int count)
{
    int i, sets = 0;

    for (i = 0; i < count; i++)
        parent[i] = find_root(parent, i);
    for (i = 0; i < count; i++)
        parent[i] = parent[i] == i ? -1 - sets++ : parent[parent[i]];
    for (i = 0; i < count; i++)
        parent[i] = -1 - parent[i];
    return sets;
}

/* ---- structured importance sampling ---- */

typedef struct component {
    double light, sr, importance;
    int texels, lights, level;
} component;

/* 0, and then by standard deviations up to LEVELS - 1. */
static void find_levels(const sky *s, int *level)
{
    double mean = s->light / (4.0 * PI), squares = 0.0, deviation;
    int i;

    for (i = 0; i < s->count; i++) {
        const double off = (double)s->luminance[i] - mean;
        squares += off * off * s->sr[i / s->width];
    }
    deviation = sqrt(squares / (4.0 * PI));
    for (i = 0; i < s->count; i++) {
        const double step = deviation > 1e-6 * mean ? (double)s->luminance[i] / deviation : 0.0;
        level[i] = step < LEVELS - 1 ? (int)step : LEVELS - 1;
    }
}

/* Writes each texel's component; returns how many. */
static int find_components(const sky *s, const int *level, int *of)
{
    int i, below;

    for (i = 0; i < s->count; i++)
        of[i] = i;
    for (i = 0; i < s->count; i++)
        for (below = 0; below < 2; below++) {
            const int next = neighbour(s, i, below);
            if (next >= 0 && level[next] == level[i])
                join(of, i, next);
        }
    return number_sets(of, s->count);
}

/* Gives out `count` lights by importance, at most one a texel. Returns how many are given. */
static int share_lights(component *all, int components, int count)
{
    int i, given;

    for (given = 0; given < count; given++) {
        int best = -1;
        double most = 0.0;
        for (i = 0; i < components; i++) {
            const double claim = all[i].importance / (2 * all[i].lights + 1);
            if (claim > most && all[i].lights < all[i].texels) {
                most = claim;
                best = i;
            }
        }
        if (best < 0)
            break;
        all[best].lights++;
    }
    return given;
}

/* Places a component's lights one by one as far as can be from all before; labels its texels. */
static void place_farthest(sky *s, const int *of, int which, int lights, int *made,
                           envsamp_light *out, float *nearest)
{
    const int first = *made;
    int i, k, l, at;

    for (i = 0; i < s->count; i++)
        for (nearest[i] = -2.0f, k = 0; of[i] == which && k < first; k++)
            nearest[i] = fmaxf(nearest[i], dot(out[k].dir, s->dir + 3 * i));
    for (l = 0; l < lights; l++) {
        for (at = -1, i = 0; i < s->count; i++)
            if (of[i] == which && (at < 0 || nearest[i] < nearest[at] ||
                                   (*made == 0 && s->luminance[i] > s->luminance[at])))
                at = i;
        memcpy(out[*made].dir, s->dir + 3 * at, sizeof out->dir);
        for (i = 0; i < s->count; i++)
            if (of[i] == which)
                nearest[i] = fmaxf(nearest[i], dot(out[*made].dir, s->dir + 3 * i));
        (*made)++;
    }
    for (i = 0; i < s->count; i++)
        if (of[i] == which) {
            float best = -2.0f;
            for (k = first; k < *made; k++)
                if (dot(out[k].dir, s->dir + 3 * i) > best) {
                    best = dot(out[k].dir, s->dir + 3 * i);
                    s->label[i] = k;
                }
        }
}

static envsamp_result structured(sky *s, int count, envsamp_light *lights, int *made)
{
    int *level = (int *)malloc((size_t)s->count * sizeof(int));
    int *of = (int *)malloc((size_t)s->count * sizeof(int));
    float *nearest = (float *)malloc((size_t)s->count * sizeof(float));
    component *all = NULL;
    int components = 0, i, l;

    if (level && of && nearest) {
        find_levels(s, level);
        components = find_components(s, level, of);
        all = (component *)calloc((size_t)components, sizeof *all);
    }
    for (i = 0; all && i < s->count; i++) {
        component *c = &all[of[i]];
        c->light += sky_light(s, i);
        c->sr += s->sr[i / s->width];
        c->texels += s->luminance[i] > 0.0f;
        c->level = level[i];
    }
    for (i = 0; i < components && all; i++)
        all[i].importance = importance(all[i].light, all[i].sr);
    if (all)
        share_lights(all, components, count);
    *made = 0;
    for (l = LEVELS - 1; l >= 0 && all; l--)
        for (i = 0; i < components; i++)
            if (all[i].level == l && all[i].lights > 0)
                place_farthest(s, of, i, all[i].lights, made, lights, nearest);
    label_nearest(s, lights, *made);
    free(level);
    free(of);
    free(nearest);
    free(all);
    return all ? sum_lights(s, *made, 0, lights) : ENVSAMP_ERR_MEMORY;
}

/* ---- tone-mapped mean shift ---- */

/* Reinhard's global operator with key 0.18. */
static void map_tones(const sky *s, float *tone)
{
    double sum = 0.0, scale;
    int i;

    for (i = 0; i < s->count; i++)
        sum += log(1e-6 * s->light + (double)s->luminance[i]) * s->sr[i / s->width];
    scale = 0.18 / exp(sum / (4.0 * PI));
    for (i = 0; i < s->count; i++) {
        const double scaled = scale * (double)s->luminance[i];
        tone[i] = (float)(scaled / (1.0 + scaled));
    }
}

/* The tone of the mode that a texel's window climbs to. */
static float shift_texel(const sky *s, const float *tone, int i)
{
    float at_x = (float)(i % s->width), at_y = (float)(i / s->width), value = tone[i];
    int step, x, y;

    for (step = 0; step < SHIFTS; step++) {
        const int mid_x = (int)floorf(at_x + 0.5f), mid_y = (int)floorf(at_y + 0.5f);
        float sum = 0.0f, sum_x = 0.0f, sum_y = 0.0f, count = 0.0f;
        for (y = mid_y - WINDOW; y <= mid_y + WINDOW; y++)
            for (x = mid_x - WINDOW; x <= mid_x + WINDOW && y >= 0 && y < s->height; x++) {
                const int column = (x % s->width + s->width) % s->width;
                const float other = tone[y * s->width + column];
                if (fabsf(other - value) > RANGE)
                    continue;
                sum += other;
                sum_x += (float)x;
                sum_y += (float)y;
                count += 1.0f;
            }
        if (!(count > 0.0f))
            break;
        value = sum / count;
        at_x = sum_x / count;
        at_y = sum_y / count;
    }
    return value;
}

/* A stratum, or cluster, while they are split and merged. */
typedef struct stratum { double light, sr; int texels, lit; } stratum;

typedef struct border { int a, b; float difference; } border;

static int compare_borders(const void *a, const void *b)
{
    const border *x = (const border *)a, *y = (const border *)b;

    if (x->difference < y->difference || x->difference > y->difference)
        return x->difference < y->difference ? -1 : 1;
    return x->a != y->a ? (x->a > y->a) - (x->a < y->a) : (x->b > y->b) - (x->b < y->b);
}

/* Each pair of neighbours of different labels once, most similar first; returns how many. */
static int find_borders(const sky *s, const float *tone, border *out)
{
    int i, below, count = 0, kept = 0;

    for (i = 0; i < s->count; i++)
        for (below = 0; below < 2; below++) {
            const int next = neighbour(s, i, below);
            if (next < 0 || s->label[next] == s->label[i])
                continue;
            out[count].a = s->label[i] < s->label[next] ? s->label[i] : s->label[next];
            out[count].b = s->label[i] < s->label[next] ? s->label[next] : s->label[i];
            out[count++].difference = tone ? fabsf(tone[i] - tone[next]) : 0.0f;
        }
    qsort(out, (size_t)count, sizeof *out, compare_borders);
    for (i = 0; i < count; i++)
        if (kept == 0 || out[kept - 1].a != out[i].a || out[kept - 1].b != out[i].b)
            out[kept++] = out[i];
    return kept;
}

static void gather(const sky *s, stratum *all, int strata)
{
    int i;

    memset(all, 0, (size_t)strata * sizeof *all);
    for (i = 0; i < s->count; i++) {
        stratum *to = &all[s->label[i]];
        to->light += sky_light(s, i);
        to->sr += s->sr[i / s->width];
        to->texels++;
        to->lit += s->luminance[i] > 0.0f;
    }
}

static void absorb(int *parent, stratum *all, int a, int b)
{
    const int to = a < b ? a : b, from = a < b ? b : a;

    parent[from] = to;
    all[to].light += all[from].light;
    all[to].sr += all[from].sr;
    all[to].texels += all[from].texels;
    all[to].lit += all[from].lit;
}

/* Labels by the roots of `parent`, numbered anew; returns how many. */
static int relabel(sky *s, int *parent, int strata)
{
    const int kept = number_sets(parent, strata);
    int i;

    for (i = 0; i < s->count; i++)
        s->label[i] = parent[s->label[i]];
    return kept;
}

/* Clusters of similar modes; small dim ones join the most similar neighbour. Returns how many. */
static int find_clusters(sky *s, const float *tone, double fair, border *borders, int *parent,
                         stratum *all)
{
    int i, below, strata, count;

    for (i = 0; i < s->count; i++)
        parent[i] = i;
    for (i = 0; i < s->count; i++)
        for (below = 0; below < 2; below++) {
            const int next = neighbour(s, i, below);
            if (next >= 0 && fabsf(tone[next] - tone[i]) < 0.5f * RANGE)
                join(parent, i, next);
        }
    strata = number_sets(parent, s->count);
    memcpy(s->label, parent, (size_t)s->count * sizeof(int));
    gather(s, all, strata);
    count = find_borders(s, tone, borders);
    for (i = 0; i < strata; i++)
        parent[i] = i;
    for (i = 0; i < count; i++) {
        const int a = find_root(parent, borders[i].a), b = find_root(parent, borders[i].b);
        const stratum *lesser = all[a].texels < all[b].texels ? &all[a] : &all[b];
        if (a != b && lesser->texels < SMALL &&
            importance(lesser->light, lesser->sr) < 0.25 * fair)
            absorb(parent, all, a, b);
    }
    return relabel(s, parent, strata);
}

/* The centroid of a stratum's light, and the axis along which its light spreads most. */
static void longest_axis(const sky *s, int which, float mean[3], float axis[3])
{
    double m[3] = { 0.0, 0.0, 0.0 }, v[3][3] = { { 0.0 } }, a[3] = { 0.6, 0.5, 0.62 }, light = 0.0;
    int i, j, c;

    for (i = 0; i < s->count; i++)
        for (c = 0; c < 3 && s->label[i] == which; c++) {
            m[c] += sky_light(s, i) * (double)s->dir[3 * i + c];
            light += sky_light(s, i) / 3.0;
        }
    for (c = 0; c < 3; c++)
        mean[c] = (float)(m[c] / light);
    for (i = 0; i < s->count; i++)
        for (c = 0; c < 3 && s->label[i] == which; c++)
            for (j = 0; j < 3; j++)
                v[c][j] += sky_light(s, i) / light * (double)(s->dir[3 * i + c] - mean[c]) *
                           (double)(s->dir[3 * i + j] - mean[j]);
    for (i = 0; i < 30; i++) {              /* power iteration */
        double b[3], length = 0.0;
        for (c = 0; c < 3; c++) {
            b[c] = v[c][0] * a[0] + v[c][1] * a[1] + v[c][2] * a[2];
            length += b[c] * b[c];
        }
        for (c = 0; c < 3 && length > 0.0; c++)
            a[c] = b[c] / sqrt(length);
    }
    for (c = 0; c < 3; c++)
        axis[c] = (float)a[c];
}

/* Moves one side to label `fresh`, if both have lit texels; otherwise returns 0. */
static int split(sky *s, stratum *all, int which, int fresh)
{
    float mean[3], axis[3], middle;
    int i, lit = 0;

    if (all[which].lit < 2)
        return 0;
    longest_axis(s, which, mean, axis);
    middle = dot(mean, axis);
    for (i = 0; i < s->count; i++)
        if (s->label[i] == which && dot(s->dir + 3 * i, axis) > middle)
            lit += s->luminance[i] > 0.0f;
    if (lit == 0 || lit == all[which].lit)
        return 0;
    for (i = 0; i < s->count; i++)
        if (s->label[i] == which && dot(s->dir + 3 * i, axis) > middle)
            s->label[i] = fresh;
    gather(s, all, fresh + 1);
    return 1;
}

/* Splits the most important until none is above `fair`, and at least until there are `least`. */
static int split_all(sky *s, stratum *all, int strata, double fair, int least, int room)
{
    int i, best;

    for (gather(s, all, strata); strata < room; strata++) {
        for (best = -1, i = 0; i < strata; i++)
            if (all[i].lit > 1 && (best < 0 || importance(all[i].light, all[i].sr) >
                                               importance(all[best].light, all[best].sr)))
                best = i;
        if (best < 0 || (strata >= least && importance(all[best].light, all[best].sr) <= fair) ||
            !split(s, all, best, strata))
            break;
    }
    return strata;
}

static int merge_all(sky *s, stratum *all, int strata, int count, border *borders, int *parent)
{
    const int border_count = find_borders(s, NULL, borders);
    int left = strata, i;

    for (i = 0; i < strata; i++)
        parent[i] = i;
    for (; left > count; left--) {
        int least = -1, with = -1;
        double lowest = 0.0;
        for (i = 0; i < strata; i++)
            if (parent[i] == i && (least < 0 || importance(all[i].light, all[i].sr) <
                                                importance(all[least].light, all[least].sr)))
                least = i;
        for (i = 0; i < border_count; i++) {
            const int a = find_root(parent, borders[i].a), b = find_root(parent, borders[i].b);
            const int other = a == least ? b : b == least ? a : -1;
            double merged;
            if (a == b || other < 0)
                continue;
            merged = importance(all[least].light + all[other].light, all[least].sr + all[other].sr);
            if (with < 0 || merged < lowest) {
                with = other;
                lowest = merged;
            }
        }
        if (with < 0)
            break;
        absorb(parent, all, least, with);
    }
    return relabel(s, parent, strata);
}

static envsamp_result mean_shift(sky *s, int count, envsamp_light *lights, int *made)
{
    const size_t texels = (size_t)s->count;
    const double fair = importance(s->light / count, 4.0 * PI / count);
    float *tone = (float *)malloc(texels * sizeof(float));
    float *modes = (float *)malloc(texels * sizeof(float));
    int *parent = (int *)malloc((texels + 1) * sizeof(int));
    stratum *all = (stratum *)malloc((texels + 1) * sizeof *all);
    border *borders = (border *)malloc(2 * texels * sizeof *borders);
    const int ready = tone && modes && parent && all && borders;
    int i, strata;

    if (ready) {
        map_tones(s, tone);
        for (i = 0; i < s->count; i++)
            modes[i] = shift_texel(s, tone, i);
        strata = find_clusters(s, modes, fair, borders, parent, all);
        strata = split_all(s, all, strata, fair, count, strata + 4 * count < s->count
                                                        ? strata + 4 * count : s->count);
        *made = merge_all(s, all, strata, count, borders, parent);
    }
    free(tone);
    free(modes);
    free(parent);
    free(all);
    free(borders);
    return ready ? sum_lights(s, *made, 0, lights) : ENVSAMP_ERR_MEMORY;
}

/* ---- fast hierarchical importance sampling ---- */

/* Half of a thin or of a thick rhomb of Penrose's tiling, on a map of 2 x 1 whose rows are equal
 * steps of height, with its number. `done`: parts of it would have numbers too high for samples. */
typedef struct tile { float a[2], b[2], c[2]; int thick, done; double number; } tile;

/* Halves at a stage; `total` is how many there were without those that are done. */
typedef struct tiling { tile *tiles; int count, room; double total; } tiling;

static void between(const float from[2], const float to[2], float out[2])
{
    const float golden = 0.61803399f;

    out[0] = from[0] + golden * (to[0] - from[0]);
    out[1] = from[1] + golden * (to[1] - from[1]);
}

static tile make_tile(int thick, const float a[2], const float b[2], const float c[2],
                      double number)
{
    tile t;

    t.thick = thick;
    t.done = 0;
    t.number = number;
    memcpy(t.a, a, sizeof t.a);
    memcpy(t.b, b, sizeof t.b);
    memcpy(t.c, c, sizeof t.c);
    return t;
}

/* One part of each half keeps its number. Those of the others begin behind all numbers, and grow
 * with their parents'. */
static int subdivide(tiling *all)
{
    const double growth = 2.61803398875, first = all->total;
    const int count = all->count;
    int i;

    if (all->room < 3 * count) {
        tile *more = (tile *)realloc(all->tiles, 3 * (size_t)count * sizeof *more);
        if (!more)
            return 0;
        all->tiles = more;
        all->room = 3 * count;
    }
    for (i = 0; i < count; i++) {
        tile *tiles = all->tiles;
        const tile t = tiles[i];
        const double next = first + (growth - 1.0) * t.number;
        float p[2], q[2];
        if (t.done)
            continue;
        if (t.thick) {
            between(t.b, t.a, p);
            between(t.b, t.c, q);
            tiles[i] = make_tile(1, q, t.c, t.a, t.number);
            tiles[all->count++] = make_tile(1, p, q, t.b, next);
            tiles[all->count++] = make_tile(0, q, p, t.a, next + 0.5 * (growth - 1.0));
        } else {
            between(t.a, t.b, p);
            tiles[i] = make_tile(0, t.c, p, t.b, t.number);
            tiles[all->count++] = make_tile(1, p, t.c, t.a, next);
        }
    }
    all->total *= growth;
    return 1;
}

/* Ten halves about a point, turned by the seed, that cover the map. */
static int first_tiles(uint32_t seed, tiling *all)
{
    const float middle[2] = { 0.99f, 0.51f };
    const double turn = 0.1 + 2.399963 * seed;
    float rim[10][2];
    int i;

    all->tiles = (tile *)malloc(10 * sizeof *all->tiles);
    all->count = all->room = all->tiles ? 10 : 0;
    all->total = 10.0;
    for (i = 0; i < 10; i++) {
        rim[i][0] = (float)(0.99 + 1.25 * cos(0.2 * PI * i + turn));
        rim[i][1] = (float)(0.51 + 1.25 * sin(0.2 * PI * i + turn));
    }
    for (i = 0; i < all->count; i++)
        all->tiles[i] = make_tile(0, middle, rim[i % 2 ? (i + 1) % 10 : i],
                                  rim[i % 2 ? i : i + 1], i);
    return all->count;
}

/* Row of the texels at a height, given as the share of the map from the top. */
static int height_row(const sky *s, double height)
{
    const double top = fmin(fmax(height, 0.0), 1.0);
    const int y = (int)(acos(1.0 - 2.0 * top) / PI * s->height);

    return y < s->height ? y : s->height - 1;
}

static int turn_column(const sky *s, double turn)
{
    const int x = (int)(fmin(fmax(turn, 0.0), 1.0) * s->width);

    return x < s->width ? x : s->width - 1;
}

/* The texel at a tile's point, or -1 outside of the map; `uz` is the point, 0 to 1. */
static int tile_texel(const sky *s, const tile *t, float uz[2])
{
    int c;

    for (c = 0; c < 2; c++) {
        uz[c] = (t->a[c] + t->b[c] + t->c[c]) / (c ? 3.0f : 6.0f);
        if (!(uz[c] >= 0.0f && uz[c] < 1.0f))
            return -1;
    }
    return height_row(s, (double)uz[1]) * s->width + turn_column(s, (double)uz[0]);
}

/* The most luminance of a tile; of a tile of many texels, `most`. */
static double tile_luminance(const sky *s, const tile *t, double most)
{
    double low[2], high[2], found = 0.0;
    int x, y, c;

    for (c = 0; c < 2; c++) {
        const double scale = c ? 1.0 : 0.5;
        low[c] = scale * (double)fminf(t->a[c], fminf(t->b[c], t->c[c]));
        high[c] = scale * (double)fmaxf(t->a[c], fmaxf(t->b[c], t->c[c]));
        if (high[c] < 0.0 || low[c] > 1.0)
            return 0.0;
    }
    if ((high[0] - low[0]) * s->width * (height_row(s, high[1]) - height_row(s, low[1]) + 1) > 64.0)
        return most;
    for (y = height_row(s, low[1]); y <= height_row(s, high[1]); y++)
        for (x = turn_column(s, low[0]); x <= turn_column(s, high[0]); x++)
            found = fmax(found, (double)s->luminance[y * s->width + x]);
    return found;
}

/* A point becomes a sample where its number is below the density: the first `count` to do so as
 * density is scaled up are those of the least number over luminance. Ascending in *keys. */
static int first_samples(const sky *s, const tiling *all, int count, double *keys,
                         envsamp_light *lights)
{
    int i, k, made = 0;

    for (i = 0; i < all->count; i++) {
        float uz[2];
        const int texel = tile_texel(s, &all->tiles[i], uz);
        const float luminance = texel < 0 ? 0.0f : s->luminance[texel];
        const double key = luminance > 0.0f ? (all->tiles[i].number + 0.5) / (double)luminance
                                            : DBL_MAX;
        if (key >= DBL_MAX || (made == count && key >= keys[made - 1]))
            continue;
        made += made < count;
        for (k = made - 1; k > 0 && keys[k - 1] > key; k--) {
            keys[k] = keys[k - 1];
            lights[k] = lights[k - 1];
        }
        keys[k] = key;
        envsamp_uv_to_dir(ENVSAMP_LATLONG, uz[0],
                          (float)(acos(1.0 - 2.0 * (double)uz[1]) / PI), lights[k].dir);
    }
    return made;
}

/* Subdivides where numbers that come could be below the density. Returns how many samples. */
static int draw_samples(const sky *s, tiling *all, int count, double *keys, envsamp_light *lights)
{
    double most = 0.0;
    int i, made = 0;

    for (i = 0; i < s->count; i++)
        most = fmax(most, (double)s->luminance[i]);
    for (;;) {
        int left = 0;
        made = first_samples(s, all, count, keys, lights);
        for (i = 0; i < all->count; i++) {
            tile *t = &all->tiles[i];
            const double luminance = t->done ? 0.0 : tile_luminance(s, t, most);
            /* Four times as high, since points still move within their tiles. */
            t->done = !(luminance > 0.0) ||
                      (made == count && all->total / luminance > 4.0 * keys[made - 1]);
            left += !t->done;
        }
        if (left == 0 || all->total > TILES_MAX || !subdivide(all))
            return made;
    }
}

static int dir_label(const sky *s, const float dir[3])
{
    float uv[2];

    envsamp_dir_to_uv(ENVSAMP_LATLONG, dir, uv);
    return s->label[turn_column(s, (double)uv[0]) +
                    s->width * (int)fmin((double)uv[1] * s->height, s->height - 1.0)];
}

/* A light without a texel, for another is nearer to all, has its share of the light of the texel
 * that it is in. */
static void share_texels(const sky *s, int made, envsamp_light *lights)
{
    int i, j, c;

    for (i = 0; i < made; i++) {
        int sharing = 1;
        for (j = 0; j < made && lights[i].solid_angle > 0.0f; j++)
            sharing += lights[j].solid_angle <= 0.0f && dir_label(s, lights[j].dir) == i;
        if (sharing == 1)
            continue;
        for (c = 0; c < 3; c++)
            lights[i].irradiance[c] /= (float)sharing;
        lights[i].solid_angle /= (float)sharing;
        for (j = 0; j < made; j++)
            if (lights[j].solid_angle <= 0.0f && dir_label(s, lights[j].dir) == i) {
                float dir[3];
                memcpy(dir, lights[j].dir, sizeof dir);
                lights[j] = lights[i];
                memcpy(lights[j].dir, dir, sizeof dir);
            }
    }
}

static envsamp_result penrose(sky *s, int count, uint32_t seed, envsamp_light *lights, int *made)
{
    double *keys = (double *)malloc((size_t)count * sizeof *keys);
    envsamp_result result = ENVSAMP_ERR_MEMORY;
    tiling all;

    if (first_tiles(seed, &all) && keys) {
        *made = draw_samples(s, &all, count, keys, lights);
        label_nearest(s, lights, *made);
        result = *made ? sum_lights(s, *made, 1, lights) : ENVSAMP_ERR_BLACK;
        if (result == ENVSAMP_OK)
            share_texels(s, *made, lights);
    }
    free(all.tiles);
    free(keys);
    return result;
}

/* ---- any of them ---- */

envsamp_result rival_lights(rival method, const envsamp_image *image, int count, uint32_t seed,
                            envsamp_light *lights, int *made)
{
    envsamp_result result;
    sky s;

    if (!image || !image->pixels || !lights || !made)
        return ENVSAMP_ERR_NULL;
    *made = 0;
    if (image->width < 1 || image->height < 1 || image->width > 16384 || image->height > 8192 ||
        (image->channels != 1 && image->channels != 3 && image->channels != 4) ||
        (image->row_stride_bytes && image->row_stride_bytes < (size_t)image->width *
         (size_t)image->channels * sizeof(float)))
        return ENVSAMP_ERR_SIZE;
    if (count < 1 || count > RIVAL_LIGHTS_MAX || image->mapping != ENVSAMP_LATLONG ||
        (int)method < 0 || method >= RIVAL_COUNT)
        return ENVSAMP_ERR_PARAM;
    result = sky_make(&s, image);
    if (result == ENVSAMP_OK)
        result = method == RIVAL_STRUCTURED ? structured(&s, count, lights, made)
               : method == RIVAL_TMMS ? mean_shift(&s, count, lights, made)
                                      : penrose(&s, count, seed, lights, made);
    sky_free(&s);
    return result;
}
