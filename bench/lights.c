/* lights.c: what a map as a few directional lights shows of a scene with shadows, beside all of its
 * light: every method, 16, 32 and 64 lights, map by map; and what making them takes.
 *
 *     lights         tables on stdout, progress on stderr; half a minute
 *
 * The scene: five diffuse or semi-glossy spheres on a diffuse plane, seen by 80 x 60 rays, each
 * lit point in all directions or in shadow of a sphere or the plane. RMSE of luminance over the
 * points, relative to their mean. The reference shades with squares of 4 x 4 texels, bright ones
 * texel by texel.
 */
#define _POSIX_C_SOURCE 200809L
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "../examples/common/irradiance.h"
#include "baselines.h"
#include "map_set.h"

#define ROUND_COUNT 15
#include "timing.h"

#define COLUMNS 80
#define ROWS 60
#define SPHERES 5
#define LIGHTS_MAX 1024
#define K_COUNT 3
#define SQUARE 4                    /* texels a side */
#define BRIGHT 2e-4                 /* share of the light above which a square is split */
#define SEEDS 8                     /* of random lights, whose squares of errors are averaged */

static const int counts[K_COUNT] = { 16, 32, 64 };

enum { RANDOM, HALFTONE, MEDIAN_CUT, VARIANCE_CUT, RELAXED, METHODS };

static const envsamp_lights_method methods[METHODS] = {
    ENVSAMP_LIGHTS_RANDOM, ENVSAMP_LIGHTS_HALFTONE, ENVSAMP_LIGHTS_MEDIAN_CUT,
    ENVSAMP_LIGHTS_VARIANCE_CUT, ENVSAMP_LIGHTS_RELAXED
};
static const char *const names[METHODS] = { "random", "halftone", "median cut", "variance cut",
                                            "relaxed" };

/* Light from a direction: luminance x solid angle. */
typedef struct beam { float dir[3], light; } beam;

/* A point that the eye sees: its normal, the mirrored view, and the exponent of its gloss or 0. */
typedef struct point { float at[3], normal[3], mirror[3], gloss; } point;

typedef struct scene {
    point points[COLUMNS * ROWS];
    int count;
} scene;

typedef struct subject {
    image map;
    envsamp_image view;
    envsamp_buffer scratch;
    envsamp_light lights[LIGHTS_MAX];
    beam few[LIGHTS_MAX], *all;
    int all_count;
    float *shown, *reference;       /* of every point */
} subject;

/* ---- the scene ---- */

static const struct { float centre[3], radius, gloss; } spheres[SPHERES] = {
    { { -2.1f, 0.2f, 1.0f }, 1.0f, 0.0f }, { { 0.1f, 0.9f, 0.8f }, 0.8f, 8.0f },
    { { 2.0f, 0.0f, 1.0f }, 1.0f, 24.0f }, { { -0.7f, -1.3f, 0.45f }, 0.45f, 24.0f },
    { { 1.0f, -1.5f, 0.35f }, 0.35f, 0.0f }
};

/* Distance along a ray of unit length to a sphere, or -1. */
static float sphere_hit(int which, const float from[3], const float dir[3])
{
    const float *c = spheres[which].centre, radius = spheres[which].radius;
    const float to[3] = { c[0] - from[0], c[1] - from[1], c[2] - from[2] };
    const float along = dot3(to, dir), rest = radius * radius - dot3(to, to) + along * along;
    const float near = rest > 0.0f ? along - sqrtf(rest) : -1.0f;

    return near > 1e-3f ? near : -1.0f;
}

/* What a ray from the eye meets first; 0 if nothing near. */
static int meet(const float eye[3], const float dir[3], point *p)
{
    float nearest = dir[2] < 0.0f ? -eye[2] / dir[2] : -1.0f, facing;
    int which = -1, i;

    for (i = 0; i < SPHERES; i++) {
        const float t = sphere_hit(i, eye, dir);

        if (t > 0.0f && (nearest < 0.0f || t < nearest)) {
            nearest = t;
            which = i;
        }
    }
    if (nearest < 0.0f || nearest > 14.0f)
        return 0;
    for (i = 0; i < 3; i++) {
        p->at[i] = eye[i] + nearest * dir[i];
        p->normal[i] = which < 0 ? (i == 2 ? 1.0f : 0.0f)
                                 : (p->at[i] - spheres[which].centre[i]) / spheres[which].radius;
    }
    facing = dot3(p->normal, dir);
    for (i = 0; i < 3; i++)
        p->mirror[i] = dir[i] - 2.0f * facing * p->normal[i];
    p->gloss = which < 0 ? 0.0f : spheres[which].gloss;
    return 1;
}

static void scene_make(scene *s)
{
    const float eye[3] = { 0.0f, -7.5f, 3.2f }, ahead[2] = { 0.92f, -0.39f };
    int i, c;

    s->count = 0;
    for (i = 0; i < COLUMNS * ROWS; i++) {
        const float a = ((float)(i % COLUMNS) + 0.5f - 0.5f * COLUMNS) * 0.95f / COLUMNS;
        const float b = (0.5f * ROWS - (float)(i / COLUMNS) - 0.5f) * 0.95f / COLUMNS;
        float dir[3] = { a, ahead[0] - b * ahead[1], ahead[1] + b * ahead[0] }, length;

        length = sqrtf(dot3(dir, dir));
        for (c = 0; c < 3; c++)
            dir[c] /= length;
        s->count += meet(eye, dir, &s->points[s->count]);
    }
}

/* What a point shows of light from a direction: diffuse with a lobe about the mirrored view. */
static float response(const point *p, const float dir[3])
{
    const float cosine = dot3(p->normal, dir);
    float shown = 0.5f * cosine / LIGHT_PI;
    int i;

    if (cosine <= 0.0f || dir[2] <= 0.0f)
        return 0.0f;
    for (i = 0; i < SPHERES; i++)
        if (sphere_hit(i, p->at, dir) > 0.0f)
            return 0.0f;
    if (p->gloss > 0.0f)
        shown += 0.3f * (p->gloss + 1.0f) / (2.0f * LIGHT_PI)
               * powf(fmaxf(dot3(p->mirror, dir), 0.0f), p->gloss);
    return shown;
}

static void shade(const scene *s, const beam *beams, int count, float *shown)
{
    int i, k;

    for (i = 0; i < s->count; i++) {
        double sum = 0.0;

        for (k = 0; k < count; k++)
            sum += (double)(beams[k].light * response(&s->points[i], beams[k].dir));
        shown[i] = (float)sum;
    }
}

static double relative_rmse(const scene *s, const float *shown, const float *right)
{
    double squares = 0.0, sum = 0.0;
    int i;

    for (i = 0; i < s->count; i++) {
        const double error = (double)shown[i] - (double)right[i];

        squares += error * error;
        sum += (double)right[i];
    }
    return sqrt(squares * s->count) / sum;
}

/* ---- all of a map ---- */

static double texel_light(const subject *s, int x, int y)
{
    return (double)(texel_luminance(&s->map, x, y) * texel_sr(s->map.width, s->map.height, y));
}

/* Adds a square's light from its centroid, or from every texel. */
static void add_square(subject *s, int x0, int y0, double bright)
{
    double sum = 0.0, v[3] = { 0.0, 0.0, 0.0 }, length;
    beam *first = s->all + s->all_count;
    int x, y, c, texels = 0;

    for (y = y0; y < y0 + SQUARE && y < s->map.height; y++)
        for (x = x0; x < x0 + SQUARE && x < s->map.width; x++, texels++) {
            const double light = texel_light(s, x, y);

            envsamp_uv_to_dir(ENVSAMP_LATLONG, ((float)x + 0.5f) / (float)s->map.width,
                              ((float)y + 0.5f) / (float)s->map.height, first[texels].dir);
            first[texels].light = (float)light;
            for (c = 0; c < 3; c++)
                v[c] += light * (double)first[texels].dir[c];
            sum += light;
        }
    if (sum > bright) {
        s->all_count += texels;
        return;
    }
    length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (c = 0; c < 3 && length > 0.0; c++)
        first->dir[c] = (float)(v[c] / length);
    first->light = (float)sum;
    s->all_count++;
}

static int subject_make(subject *s, const scene *view)
{
    const size_t texels = (size_t)s->map.width * (size_t)s->map.height;
    double total = 0.0;
    int x, y;

    image_clean(&s->map);
    s->view = kd_image(s->map.rgb, s->map.width, s->map.height, 3);
    s->scratch.bytes = (size_t)16 << 20;
    s->scratch.data = kd_allocate(s->scratch.bytes);
    s->all = kd_allocate(texels * sizeof *s->all);
    s->shown = kd_allocate((size_t)view->count * sizeof *s->shown);
    s->reference = kd_allocate((size_t)view->count * sizeof *s->reference);
    s->all_count = 0;
    for (y = 0; y < s->map.height; y++)
        for (x = 0; x < s->map.width; x++)
            total += texel_light(s, x, y);
    for (y = 0; y < s->map.height; y += SQUARE)
        for (x = 0; x < s->map.width; x += SQUARE)
            add_square(s, x, y, BRIGHT * total);
    shade(view, s->all, s->all_count, s->reference);
    return total > 0.0;
}

static void subject_free(subject *s)
{
    free(s->scratch.data);
    free(s->all);
    free(s->shown);
    free(s->reference);
    image_free(&s->map);
}

/* ---- a few lights ---- */

static int make_lights(subject *s, int method, int count, uint32_t seed)
{
    envsamp_lights_desc desc = envsamp_lights_defaults();

    desc.method = methods[method];
    desc.count = count;
    desc.seed = seed;
    return envsamp_lights(&s->view, &desc, s->lights, LIGHTS_MAX, s->scratch, NULL) == ENVSAMP_OK;
}

static double measure(const scene *view, subject *s, int method, int count)
{
    const uint32_t seeds = method == RANDOM ? SEEDS : 1;
    double squares = 0.0, rmse;
    uint32_t seed;
    int i;

    for (seed = 0; seed < seeds; seed++) {
        if (!make_lights(s, method, count, seeds > 1 ? seed + 1 : 0))
            printf("%s: no %d lights\n", names[method], count);
        for (i = 0; i < count; i++) {
            memcpy(s->few[i].dir, s->lights[i].dir, sizeof s->few[i].dir);
            s->few[i].light = envsamp_luminance(s->lights[i].irradiance);
        }
        shade(view, s->few, count, s->shown);
        rmse = relative_rmse(view, s->shown, s->reference);
        squares += rmse * rmse / seeds;
    }
    return sqrt(squares);
}

/* ---- tables ---- */

static void print_means(const map_set *set, double (*all)[METHODS][K_COUNT])
{
    double mean[METHODS][K_COUNT] = { { 0.0, 0.0, 0.0 } };
    int i, m, k;

    for (i = 0; i < set->count; i++)
        for (m = 0; m < METHODS; m++)
            for (k = 0; k < K_COUNT; k++)
                mean[m][k] += all[i][m][k] / set->count;
    printf("\nMean relative RMSE over %d maps, %s, and over that of variance cut\n\n"
           "| lights | 16 | 32 | 64 | / variance cut, 16 | 32 | 64 |\n"
           "|---|---|---|---|---|---|---|\n", set->count, map_set_kind(set));
    for (m = 0; m < METHODS; m++) {
        printf("| %s |", names[m]);
        for (k = 0; k < K_COUNT; k++)
            printf(" %.4f |", mean[m][k]);
        for (k = 0; k < K_COUNT; k++)
            printf(" %.3f |", mean[m][k] / mean[VARIANCE_CUT][k]);
        printf("\n");
    }
}

static void print_maps(const map_set *set, double (*all)[METHODS][K_COUNT])
{
    int i, m;

    printf("\n32 lights, map by map\n\n| map |");
    for (m = 0; m < METHODS; m++)
        printf(" %s |", names[m]);
    printf("\n|---|---|---|---|---|---|\n");
    for (i = 0; i < set->count; i++) {
        printf("| %s |", map_set_name(set, i));
        for (m = 0; m < METHODS; m++)
            printf(" %.4f |", all[i][m][1]);
        printf("\n");
    }
}

static void print_times(subject *s, const scene *view)
{
    static double times[METHODS + 1][ROUND_COUNT];
    float *row_weights, *importance;
    int round, m;

    if (!map_make("studio", 1024, 512, &s->map) || !subject_make(s, view))
        return;
    row_weights = kd_allocate((size_t)s->map.height * sizeof *row_weights);
    importance = kd_allocate((size_t)s->map.width * (size_t)s->map.height * sizeof *importance);
    baseline_row_weights(s->map.width, s->map.height, row_weights);
    for (round = 0; round < ROUND_COUNT; round++)
        for (m = 0; m <= METHODS; m++) {
            const double start = seconds();

            if (m == METHODS)
                baseline_luminance_pass(s->map.rgb, s->map.width, s->map.height, row_weights,
                                        importance);
            else
                make_lights(s, m, 32, 0);
            times[m][round] = seconds() - start;
        }
    printf("\n32 lights of studio at 1024x512, one core, medians of %d rounds, and over a pass over"
           " the\npixels that writes luminance x solid angle, of %.2f ms\n\n| | ms | passes |\n"
           "|---|---|---|\n", ROUND_COUNT, 1e3 * median(times[METHODS]));
    for (m = 0; m < METHODS; m++)
        printf("| %s | %.2f | %.1f |\n", names[m], 1e3 * median(times[m]),
               median_ratio(times[m], times[METHODS]));
    free(row_weights);
    free(importance);
    subject_free(s);
}

int main(void)
{
    static scene view;
    static subject s;
    static double all[MAP_SET_MAX][METHODS][K_COUNT];
    const map_set set = map_set_find();
    int i, m, k;

    scene_make(&view);
    for (i = 0; i < set.count; i++) {
        if (!map_set_load(&set, i, &s.map) || !subject_make(&s, &view))
            return EXIT_FAILURE;
        for (m = 0; m < METHODS; m++)
            for (k = 0; k < K_COUNT; k++)
                all[i][m][k] = measure(&view, &s, m, counts[k]);
        subject_free(&s);
    }
    print_cpu();
    print_compiler(BENCH_FLAGS);
    print_means(&set, all);
    print_maps(&set, all);
    print_times(&s, &view);
    return EXIT_SUCCESS;
}
