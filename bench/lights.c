/* lights.c: what a map as a few directional lights shows of a scene with shadows, beside all of its
 * light: every method, and those of examples/render/rivals.h, 16, 32 and 64 lights, map by map; and
 * what making them takes.
 *
 *     lights         tables on stdout, progress on stderr; minutes
 *
 * The scene is that of light_scene.h. RMSE of luminance over its points, relative to their mean; of
 * what is drawn at random by the root of the mean square over 8 seeds.
 */
#define _POSIX_C_SOURCE 200809L
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "../examples/render/rivals.h"
#include "baselines.h"
#include "light_scene.h"
#include "map_set.h"

#define ROUND_COUNT 15
#include "timing.h"

#define LIGHTS_MAX 64
#define K_COUNT 3
#define SEEDS 8                     /* of what is drawn: their squares of errors are averaged */

static const int counts[K_COUNT] = { 16, 32, 64 };

/* The methods, the best last, behind them what is left of DECOMPOSED without parts of it, and the
 * rivals that the library does not have. */
enum { RANDOM, HALFTONE, MEDIAN_CUT, VARIANCE_CUT, DECOMPOSED, RELAXED, METHODS,
       ABLATIONS = 5, RIVALS = METHODS + ABLATIONS, WAYS = RIVALS + RIVAL_COUNT };

static const struct {
    const char *name;
    envsamp_lights_method method;
    int seeded, mask, rounds;
    float weight[3];
} ways[WAYS] = {
    { "random", ENVSAMP_LIGHTS_RANDOM, 1, 1, 1, { 1.0f, 5.0f, 1.0f } },
    { "halftone", ENVSAMP_LIGHTS_HALFTONE, 0, 1, 1, { 1.0f, 5.0f, 1.0f } },
    { "median cut", ENVSAMP_LIGHTS_MEDIAN_CUT, 0, 1, 1, { 1.0f, 5.0f, 1.0f } },
    { "variance cut", ENVSAMP_LIGHTS_VARIANCE_CUT, 0, 1, 1, { 1.0f, 5.0f, 1.0f } },
    { "decomposed", ENVSAMP_LIGHTS_DECOMPOSED, 1, 1, 1, { 1.0f, 5.0f, 1.0f } },
    { "relaxed", ENVSAMP_LIGHTS_RELAXED, 0, 1, 1, { 1.0f, 5.0f, 1.0f } },
    { "decomposed: importance sampling alone", ENVSAMP_LIGHTS_DECOMPOSED, 1, 0, 0,
      { 1.0f, 5.0f, 1.0f } },
    { "- with masking", ENVSAMP_LIGHTS_DECOMPOSED, 1, 1, 0, { 1.0f, 5.0f, 1.0f } },
    { "- with k-means", ENVSAMP_LIGHTS_DECOMPOSED, 1, 0, 1, { 1.0f, 5.0f, 1.0f } },
    { "decomposed, weights 1 0 0", ENVSAMP_LIGHTS_DECOMPOSED, 1, 1, 1, { 1.0f, 0.0f, 0.0f } },
    { "decomposed, weights 0 1 2", ENVSAMP_LIGHTS_DECOMPOSED, 1, 1, 1, { 0.0f, 1.0f, 2.0f } },
    { "structured importance sampling", ENVSAMP_LIGHTS_RANDOM, 0, 0, 0, { 0.0f, 0.0f, 0.0f } },
    { "tone-mapped mean shift", ENVSAMP_LIGHTS_RANDOM, 0, 0, 0, { 0.0f, 0.0f, 0.0f } },
    { "fast hierarchical sampling", ENVSAMP_LIGHTS_RANDOM, 1, 0, 0, { 0.0f, 0.0f, 0.0f } }
};

typedef struct subject {
    image map;
    envsamp_image view;
    envsamp_buffer scratch;
    envsamp_light lights[LIGHTS_MAX];
    beam few[LIGHTS_MAX], *all;
    float *shown, *reference;       /* of every point */
} subject;

/* ---- all of a map ---- */

static void subject_make(subject *s, const scene *view)
{
    image_clean(&s->map);
    s->view = bench_view(&s->map);
    s->scratch.bytes = (size_t)16 << 20;
    s->scratch.data = bench_allocate(s->scratch.bytes);
    s->all = bench_allocate((size_t)s->map.width * (size_t)s->map.height * sizeof *s->all);
    s->shown = bench_allocate((size_t)view->count * sizeof *s->shown);
    s->reference = bench_allocate((size_t)view->count * sizeof *s->reference);
    shade(view, s->all, map_beams(&s->map, s->all), s->reference);
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

static int make_lights(subject *s, int way, int count, uint32_t seed)
{
    envsamp_lights_desc desc = envsamp_lights_defaults();
    int made;

    if (way >= RIVALS)
        return rival_lights((rival)(way - RIVALS), &s->view, count, seed, s->lights, &made) ==
               ENVSAMP_OK && made == count;
    desc.method = ways[way].method;
    desc.count = count;
    desc.seed = seed;
    desc.mask_scale = ways[way].mask ? desc.mask_scale : -1.0f;
    desc.refine_rounds = ways[way].rounds ? desc.refine_rounds : -1;
    desc.weight_variance = ways[way].weight[0];
    desc.weight_extent = ways[way].weight[1];
    desc.weight_energy = ways[way].weight[2];
    return envsamp_lights(&s->view, &desc, s->lights, LIGHTS_MAX, s->scratch, NULL) == ENVSAMP_OK;
}

static double measure(const scene *view, subject *s, int way, int count)
{
    const uint32_t seeds = ways[way].seeded ? SEEDS : 1;
    double squares = 0.0, rmse;
    uint32_t seed;

    for (seed = 0; seed < seeds; seed++) {
        if (!make_lights(s, way, count, seed))
            printf("%s: no %d lights\n", ways[way].name, count);
        shade(view, s->few, light_beams(s->lights, count, s->few), s->shown);
        rmse = relative_rmse(view, s->shown, s->reference);
        squares += rmse * rmse / seeds;
    }
    return sqrt(squares);
}

/* ---- tables ---- */

static void print_means(const map_set *set, double (*all)[WAYS][K_COUNT])
{
    double mean[WAYS][K_COUNT] = { { 0.0, 0.0, 0.0 } }, best;
    int i, m, k;

    for (i = 0; i < set->count; i++)
        for (m = 0; m < WAYS; m++)
            for (k = 0; k < K_COUNT; k++)
                mean[m][k] += all[i][m][k] / set->count;
    printf("\nMean relative RMSE over %d maps, %s, and over that of the best published method\n\n"
           "| lights | 16 | 32 | 64 | / best, 16 | 32 | 64 |\n|---|---|---|---|---|---|---|\n",
           set->count, map_set_kind(set));
    for (m = 0; m < WAYS; m++) {
        printf("| %s |", ways[m].name);
        for (k = 0; k < K_COUNT; k++)
            printf(" %.4f |", mean[m][k]);
        for (k = 0; k < K_COUNT; k++) {
            best = fmin(mean[MEDIAN_CUT][k], fmin(mean[VARIANCE_CUT][k], mean[DECOMPOSED][k]));
            for (i = RIVALS; i < WAYS; i++)
                best = fmin(best, mean[i][k]);
            printf(" %.3f |", mean[m][k] / best);
        }
        printf("\n");
    }
}

static void print_maps(const map_set *set, double (*all)[WAYS][K_COUNT])
{
    int i, m;

    printf("\n32 lights, map by map\n\n| map |");
    for (m = 0; m < METHODS; m++)
        printf(" %s |", ways[m].name);
    printf("\n|---|---|---|---|---|---|---|\n");
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

    if (!map_make("studio", 1024, 512, &s->map))
        return;
    subject_make(s, view);
    row_weights = bench_allocate((size_t)s->map.height * sizeof *row_weights);
    importance = bench_allocate((size_t)s->map.width * (size_t)s->map.height * sizeof *importance);
    baseline_row_weights(s->map.width, s->map.height, row_weights);
    for (round = 0; round < ROUND_COUNT; round++)
        for (m = 0; m <= METHODS; m++) {
            double start;

            if (m == METHODS)           /* warms the caches for itself */
                baseline_luminance_pass(s->map.rgb, s->map.width, s->map.height, row_weights,
                                        importance);
            start = seconds();
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
        printf("| %s | %.2f | %.1f |\n", ways[m].name, 1e3 * median(times[m]),
               median_ratio(times[m], times[METHODS]));
    free(row_weights);
    free(importance);
    subject_free(s);
}

int main(void)
{
    static scene view;
    static subject s;
    static double all[MAP_SET_MAX][WAYS][K_COUNT];
    map_set set = map_set_find("scene");
    int i, m, k;

    scene_make(&view);
    for (i = 0; i < set.count; i++) {
        if (!map_set_load(&set, i, &s.map))
            return EXIT_FAILURE;
        subject_make(&s, &view);
        for (m = 0; m < WAYS; m++)
            for (k = 0; k < K_COUNT; k++)
                all[i][m][k] = measure(&view, &s, m, counts[k]);
        subject_free(&s);
    }
    map_set_done(&set);
    print_cpu();
    print_compiler(BENCH_FLAGS);
    print_means(&set, all);
    print_maps(&set, all);
    print_times(&s, &view);
    return EXIT_SUCCESS;
}
