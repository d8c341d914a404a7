/* render_tables.c: every sampler and every set of lights side by side in the renderer of
 * examples/render, as cells of a CSV file and as tables in Markdown.
 *
 *     render_tables [-q] [-t THREADS] [-o FOLDER] [TABLE...]
 *
 * TABLE is samplers, safe, bounces, lights, ablation, ergun, ward, product or calls; all without
 * one. Cells go to
 * FOLDER/render.csv (bench/results) as they are done, and are not measured again; tables to
 * FOLDER/render.md. References are kept in build/references. An hour and a half on two cores; -q
 * measures a little of everything in seconds, under the made-up map, to see that it works.
 *
 * A cell is TABLE,map,scene,method and seven numbers: samples a pixel, or lights; seconds of
 * processor time; relative RMSE against two references; root of the relative MSE without the worst
 * 0.2 % of pixels; PSNR; FLIP; and one of the table's own.
 */
#define _POSIX_C_SOURCE 200809L
#include "cells.h"
#include "render_report.h"
#include "stage.h"

#include "../examples/common/folder.h"
#include "../examples/common/maps.h"
#include "../examples/render/lights.h"
#include "../examples/render/product.h"
#include "../examples/render/rivals.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define ROUND_COUNT 3
#include "timing.h"

#define ERROR_SIZE 512
#define SEED 7
#define ABLATION_SEEDS 4
#define REFERENCES "build/references"

typedef struct program {
    int quick, threads;
    const char *folder;
    stage_config direct, bounced;
    cells cells;
    const char *map_name;
    image map;
} program;

static void fail(const char *what)
{
    fprintf(stderr, "render_tables: %s\n", what);
    exit(1);
}

/* ---- cells ---- */

static const char *key_of(const program *p, const char *table, const char *where,
                          const char *label)
{
    static char key[CELL_KEY];

    snprintf(key, sizeof key, "%s,%s,%s,%s", table, p->map_name, where, label);
    return key;
}

static int is_done(const program *p, const char *table, const char *where, const char *label)
{
    return cells_find(&p->cells, key_of(p, table, where, label)) != NULL;
}

static double value_of(const program *p, const char *table, const char *where, const char *label,
                       int which)
{
    const cell *found = cells_find(&p->cells, key_of(p, table, where, label));

    return found ? found->value[which] : (double)NAN;
}

/* Judges a picture where there is one. */
static void keep(program *p, const stage *s, const char *table, const char *where,
                 const char *label, double count, double time, const image *picture, double own)
{
    double value[CELL_VALUES] = {0.0};

    value[CELL_COUNT] = count;
    value[CELL_SECONDS] = time;
    if (picture)
        stage_judge(s, picture, value + CELL_RELATIVE);
    value[CELL_OWN] = own;
    if (!cells_add(&p->cells, key_of(p, table, where, label), value))
        fail("a cell cannot be written");
}

static void open_stage(const program *p, stage *s, const char *where, int bounces)
{
    char error[ERROR_SIZE];

    if (!stage_open(s, bounces > 1 ? &p->bounced : &p->direct, p->map_name, &p->map, where, bounces,
                    error, sizeof error))
        fail(error);
}

static image make_picture(const stage *s)
{
    image out;

    if (!image_alloc(&out, s->config->width, s->config->height))
        fail("out of memory");
    return out;
}

/* ---- samplers ---- */

static method open_method(const stage *s, const table_method *of)
{
    const sampler_options options = {of->compensation, of->exponent, of->blocks};
    char error[ERROR_SIZE];
    method by;

    if (!method_open(&by, of->name, &s->environment, &options, error, sizeof error))
        fail(error);
    return by;
}

static void sample_cell(program *p, const stage *s, const char *table, const char *where,
                        const table_method *of, uint32_t count, int independent)
{
    image picture;
    method by;
    double time;

    if (is_done(p, table, where, of->label))
        return;
    by = open_method(s, of);
    picture = make_picture(s);
    time = stage_render(s, &by, count, independent, SEED, &picture);
    keep(p, s, table, where, of->label, count, time, &picture, 0.0);
    image_free(&picture);
    method_close(&by);
}

/* Processor time of a sample of the whole picture. */
static double sample_seconds(const stage *s, const table_method *of)
{
    method by = open_method(s, of);
    image picture = make_picture(s);
    const double time = stage_render(s, &by, 4, 0, SEED, &picture) / 4.0;

    method_close(&by);
    image_free(&picture);
    return time;
}

/* Whether all of some methods have their cells. */
static int all_done(const program *p, const char *table, const char *where,
                    const table_method *methods, int count)
{
    int i = 0;

    while (i < count && is_done(p, table, where, methods[i].label))
        i++;
    return i == count;
}

/* Seconds of processor time a sample of the whole picture: the least of three turns. */
static void time_methods(program *p, const stage *s, const char *table, const char *where,
                         const table_method *methods, int method_count)
{
    const uint32_t count = p->quick ? 1 : 4;
    image picture = make_picture(s);
    double least[TABLE_METHODS];
    method by[TABLE_METHODS];
    int i, round;

    for (i = 0; i < method_count; i++)
        by[i] = open_method(s, &methods[i]);
    for (round = 0; round < ROUND_COUNT; round++)
        for (i = 0; i < method_count; i++) {
            const double time = stage_render(s, &by[i], count, 0, SEED, &picture) / count;

            least[i] = round ? fmin(least[i], time) : time;
        }
    for (i = 0; i < method_count; i++) {
        if (!is_done(p, table, where, methods[i].label))
            keep(p, s, table, where, methods[i].label, count, least[i], NULL, 0.0);
        method_close(&by[i]);
    }
    image_free(&picture);
}

/* At as many samples, by Sobol points and, of direct light, independent numbers; and in the time
   that the first method takes. */
static void measure_samplers(program *p, const char *where, int bounces,
                             const table_method *methods, int method_count)
{
    const char *table = bounces > 1 ? "bounces" : "samplers";
    const uint32_t count = p->quick ? 2 : 16;
    char alone[32], equal[32], cost[32];
    stage s;
    int i;

    snprintf(alone, sizeof alone, "%s-independent", table);
    snprintf(equal, sizeof equal, "%s-time", table);
    snprintf(cost, sizeof cost, "%s-cost", table);
    if (all_done(p, equal, where, methods, method_count))
        return;
    open_stage(p, &s, where, bounces);
    if (!all_done(p, cost, where, methods, method_count))
        time_methods(p, &s, cost, where, methods, method_count);
    for (i = 0; i < method_count; i++) {
        const table_method *of = &methods[i];
        const double budget = count * value_of(p, cost, where, methods[0].label, CELL_SECONDS);
        const double fits = budget / value_of(p, cost, where, of->label, CELL_SECONDS);

        sample_cell(p, &s, table, where, of, count, 0);
        if (bounces == 1)
            sample_cell(p, &s, alone, where, of, count, 1);
        sample_cell(p, &s, equal, where, of, (uint32_t)fmax(fits + 0.5, 1.0), 0);
    }
    stage_close(&s);
}

static void measure_direct(program *p, const char *where)
{
    measure_samplers(p, where, 1, table_methods, TABLE_METHODS);
}

static void measure_safe(program *p, const char *where)
{
    measure_samplers(p, where, 1, table_safe, TABLE_SAFE);
}

static void measure_bounced(program *p, const char *where)
{
    measure_samplers(p, where, 5, table_methods, TABLE_METHODS);
}

/* ---- lights ---- */

static void make_list(light_list *list, const table_lights *of, int count, const stage *s)
{
    char error[ERROR_SIZE];
    int i;

    for (i = 0; i < RIVAL_COUNT; i++) {
        if (strcmp(rival_name((rival)i), of->method))
            continue;
        list->lights = calloc((size_t)count, sizeof *list->lights);
        if (!list->lights || rival_lights((rival)i, &s->environment.view, count, SEED,
                                          list->lights, &list->count) != ENVSAMP_OK)
            fail("lights of a rival");
        return;
    }
    if (!lights_make(list, of->method, count, SEED, &s->environment, error, sizeof error))
        fail(error);
}

/* Returns seconds of processor time. */
static double render_list(const stage *s, const light_list *list, int sets, int reduce,
                          image *picture)
{
    const clock_t start = clock();
    lights_job job;

    memset(&job, 0, sizeof job);
    job.scene = s->scene;
    job.environment = &s->environment;
    job.list = list;
    job.sets = sets;
    job.side = 1;
    job.reduce = reduce;
    job.seed = SEED;
    job.threads = s->config->threads;
    if (!lights_render(&job, picture))
        fail("out of memory");
    return (double)(clock() - start) / CLOCKS_PER_SEC;
}

static void lights_cell(program *p, const stage *s, const char *table, const char *where,
                        const table_lights *of, int count)
{
    image picture;
    light_list list;
    double time;

    if (is_done(p, table, where, of->label))
        return;
    picture = make_picture(s);
    make_list(&list, of, count, s);
    if (of->reduce > 1 && !strcmp(of->method, "relaxed"))
        lights_mark(&list, LIGHTS_LAMP);    /* DECOMPOSED tells its lamps itself */
    time = render_list(s, &list, of->sets, of->reduce, &picture);
    keep(p, s, table, where, of->label, count, time, &picture, 0.0);
    lights_free(&list);
    image_free(&picture);
}

/* All at 32 lights; and those that take another time, with MIS, in the time of the first. */
static void measure_lights(program *p, const char *where)
{
    static const table_method mis[2] = {{"kd-warp+mis", "kd-warp+mis", 0.0f, 0.0f, 0},
                                        {"facing+mis", "facing+mis", 0.0f, 0.0f, 0}};
    const int count = p->quick ? 8 : 32;
    double budget;
    stage s;
    int i;

    if (is_done(p, "lights", where, table_lights_all[TABLE_LIGHTS - 1].label)
        && is_done(p, "lights-time", where, mis[1].label))
        return;
    open_stage(p, &s, where, 1);
    for (i = 0; i < TABLE_LIGHTS; i++)
        lights_cell(p, &s, "lights", where, &table_lights_all[i], count);
    budget = value_of(p, "lights", where, table_lights_all[0].label, CELL_SECONDS);
    for (i = 0; i < TABLE_LIGHTS; i++) {
        const double time = value_of(p, "lights", where, table_lights_all[i].label, CELL_SECONDS);
        const double fits = (double)count * budget / fmax(time, 1e-6);

        if (table_lights_all[i].reduce > 1)
            lights_cell(p, &s, "lights-time", where, &table_lights_all[i],
                        (int)fmin(fmax(fits + 0.5, 1.0), 4.0 * count));
    }
    for (i = 0; i < 2; i++)
        if (!is_done(p, "lights-time", where, mis[i].label))
            sample_cell(p, &s, "lights-time", where, &mis[i],
                        (uint32_t)fmax(budget / sample_seconds(&s, &mis[i]) + 0.5, 1.0), 0);
    stage_close(&s);
}

/* ---- [Wu 2024], table 2 ---- */

/* Numbers of a cell are means over seeds, which decide where EnvDirects start. */
static void ablation_cell(program *p, const stage *s, const char *where, const table_ablation *of)
{
    envsamp_lights_desc desc = envsamp_lights_defaults();
    const int seeds = p->quick ? 1 : ABLATION_SEEDS;
    double value[CELL_VALUES] = {0.0}, errors[STAGE_ERRORS];
    image picture = make_picture(s);
    char error[ERROR_SIZE];
    int seed, i;

    desc.count = p->quick ? 8 : 32;
    desc.method = ENVSAMP_LIGHTS_DECOMPOSED;
    desc.mask_scale = of->mask_scale;
    desc.refine_rounds = of->refine_rounds;
    desc.weight_variance = of->weights[0];
    desc.weight_extent = of->weights[1];
    desc.weight_energy = of->weights[2];
    value[CELL_COUNT] = desc.count;
    for (seed = 0; seed < seeds; seed++) {
        light_list list;

        desc.seed = SEED + (uint32_t)seed;
        if (!lights_build(&list, &desc, &s->environment, error, sizeof error))
            fail(error);
        value[CELL_SECONDS] += render_list(s, &list, of->sets, of->reduce, &picture) / seeds;
        stage_judge(s, &picture, errors);
        for (i = 0; i < STAGE_ERRORS; i++)
            value[CELL_RELATIVE + i] += errors[i] / seeds;
        lights_free(&list);
    }
    image_free(&picture);
    if (!cells_add(&p->cells, key_of(p, "ablation", where, of->label), value))
        fail("a cell cannot be written");
}

static void measure_ablation(program *p, const char *where)
{
    stage s;
    int i;

    if (is_done(p, "ablation", where, table_ablations[TABLE_ABLATIONS - 1].label))
        return;
    open_stage(p, &s, where, 1);
    for (i = 0; i < TABLE_ABLATIONS; i++)
        if (!is_done(p, "ablation", where, table_ablations[i].label))
            ablation_cell(p, &s, where, &table_ablations[i]);
    stage_close(&s);
}

/* ---- [Ergun et al. 2012], figures 3 to 6 ---- */

static void measure_ergun(program *p, const char *where)
{
    uint32_t count;
    char table[32];
    stage s;
    int i;

    open_stage(p, &s, where, 1);
    for (count = 8; count <= (p->quick ? 8u : 64u); count *= 2)
        for (i = 0; i < TABLE_ERGUN; i++) {
            snprintf(table, sizeof table, "ergun-%u", (unsigned)count);
            sample_cell(p, &s, table, where, &table_ergun[i], count, 1);
        }
    for (i = 0; i < TABLE_ERGUN; i++) {
        const double time = value_of(p, "ergun-8", where, table_ergun[i].label, CELL_SECONDS);
        const double budget = value_of(p, "ergun-8", where, table_ergun[0].label, CELL_SECONDS);

        sample_cell(p, &s, "ergun-time", where, &table_ergun[i],
                    (uint32_t)fmax(8.0 * budget / fmax(time, 1e-6) + 0.5, 1.0), 1);
    }
    stage_close(&s);
}

/* ---- [Ergun et al. 2012], figure 7 ---- */

static void filtered_cell(program *p, const stage *s, const filtered *levels, const char *table,
                          const char *where, uint32_t count)
{
    image picture;
    double time;

    if (is_done(p, table, where, FILTERED_LABEL))
        return;
    picture = make_picture(s);
    time = stage_render_filtered(s, levels, FILTERED_BIAS, count, SEED, &picture);
    keep(p, s, table, where, FILTERED_LABEL, count, time, &picture, 0.0);
    image_free(&picture);
}

/* By samples, and in the time of FILTERED_EQUAL filtered ones. */
static void measure_ward(program *p, const char *where)
{
    filtered levels;
    uint32_t count;
    char table[32];
    stage s;
    int i;

    if (is_done(p, "ward-time", where, table_filtered[TABLE_FILTERED - 1].label))
        return;
    open_stage(p, &s, where, 1);
    if (!filtered_make(&p->map, &levels))
        fail("out of memory");
    for (count = 4; count <= (p->quick ? 16u : 256u); count *= 4) {
        snprintf(table, sizeof table, "ward-%u", (unsigned)count);
        filtered_cell(p, &s, &levels, table, where, count);
        for (i = 0; i < TABLE_FILTERED; i++)
            sample_cell(p, &s, table, where, &table_filtered[i], count, 0);
    }
    filtered_cell(p, &s, &levels, "ward-time", where, FILTERED_EQUAL);
    for (i = 0; i < TABLE_FILTERED; i++) {
        const double budget = value_of(p, "ward-16", where, FILTERED_LABEL, CELL_SECONDS);
        const double time = value_of(p, "ward-16", where, table_filtered[i].label, CELL_SECONDS);

        sample_cell(p, &s, "ward-time", where, &table_filtered[i],
                    (uint32_t)fmax(FILTERED_EQUAL * budget / fmax(time, 1e-6) + 0.5, 1.0), 0);
    }
    filtered_free(&levels);
    stage_close(&s);
}

/* ---- product sampling, [Szirmay-Kalos et al.] figures 1.6 and 1.7 ---- */

static void product_cell(program *p, const stage *s, const char *where, int triple)
{
    const char *label = triple ? "triple" : "double";
    image picture;
    product_job job;
    clock_t start;
    film f;

    if (is_done(p, "product", where, label))
        return;
    memset(&job, 0, sizeof job);
    job.scene = s->scene;
    job.environment = &s->environment;
    job.triple = triple;
    job.side = 1;
    job.rays = PRODUCT_RAYS;
    job.seed = SEED;
    job.threads = s->config->threads;
    picture = make_picture(s);
    job.product = product_make(&s->environment);
    if (!job.product || !film_make(&f, picture.width, picture.height))
        fail("out of memory");
    start = clock();
    product_samples(&job, &f, 1);
    film_image(&f, &picture);
    keep(p, s, "product", where, label, PRODUCT_RAYS, (double)(clock() - start) / CLOCKS_PER_SEC,
         &picture, 0.0);
    film_free(&f);
    image_free(&picture);
    product_free((product *)(uintptr_t)job.product);
}

static void measure_product(program *p, const char *where)
{
    stage s;
    int i;

    open_stage(p, &s, where, 1);
    product_cell(p, &s, where, 0);
    product_cell(p, &s, where, 1);
    for (i = 0; i < TABLE_PRODUCT; i++)
        sample_cell(p, &s, "product", where, &table_product[i], PRODUCT_RAYS, 0);
    stage_close(&s);
}

/* ---- what calls cost in a renderer ---- */

static const light_sampler *watched;
static double call_seconds[2];          /* of samples, of densities */
static double call_count[2];

static envsamp_sample watch_sample(const void *table, const float axis[3], float u0, float u1)
{
    const double start = seconds();
    const envsamp_sample s = watched->sample(table, axis, u0, u1);

    call_seconds[0] += seconds() - start;
    call_count[0] += 1.0;
    return s;
}

static float watch_pdf(const void *table, const float axis[3], const float dir[3])
{
    const double start = seconds();
    const float pdf = watched->pdf(table, axis, dir);

    call_seconds[1] += seconds() - start;
    call_count[1] += 1.0;
    return pdf;
}

/* What a reading of the clock costs, of which every call pays one. */
static double clock_cost(void)
{
    const double start = seconds();
    int i;

    for (i = 0; i < 100000; i++)
        seconds();
    return (seconds() - start) / 100000.0;
}

/* One thread: nanoseconds a call, the mean over a frame, methods by turns. */
static void measure_calls(program *p, const char *where)
{
    static double ns[2][TABLE_CALLS][ROUND_COUNT];
    stage_config one = p->direct;
    light_sampler rows[TABLE_CALLS];
    method by[TABLE_CALLS];
    stage s;
    image picture;
    int i, k, round;

    if (is_done(p, "calls-pdf", where, table_calls[TABLE_CALLS - 1].label))
        return;
    open_stage(p, &s, where, 1);
    one.threads = 1;
    s.config = &one;
    picture = make_picture(&s);
    for (i = 0; i < TABLE_CALLS; i++)
        by[i] = open_method(&s, &table_calls[i]);
    for (round = 0; round < ROUND_COUNT; round++)
        for (i = 0; i < TABLE_CALLS; i++) {
            const double reading = clock_cost();

            call_seconds[0] = call_seconds[1] = call_count[0] = call_count[1] = 0.0;
            watched = by[i].by;
            rows[i] = *watched;
            rows[i].sample = watch_sample;
            rows[i].pdf = watch_pdf;
            by[i].by = &rows[i];
            stage_render(&s, &by[i], p->quick ? 1 : 4, 0, SEED, &picture);
            by[i].by = watched;
            for (k = 0; k < 2; k++)
                ns[k][i][round] = 1e9 * (call_seconds[k] / call_count[k] - reading);
        }
    for (i = 0; i < TABLE_CALLS; i++) {
        for (k = 0; k < 2; k++)
            if (!is_done(p, k ? "calls-pdf" : "calls-sample", where, table_calls[i].label))
                keep(p, &s, k ? "calls-pdf" : "calls-sample", where, table_calls[i].label, 1.0,
                     0.0, NULL, median(ns[k][i]));
        method_close(&by[i]);
    }
    image_free(&picture);
    stage_close(&s);
}

/* ---- all maps ---- */

typedef struct experiment {
    const char *name;
    void (*measure)(program *p, const char *where);
    const char *const *scenes;
    const char *const *maps;         /* NULL: all real ones */
} experiment;

static const char *const ergun_maps[] = {"sunset", "city", "constant", NULL};
static const char *const some_maps[] = {"sunset", "city", "studio", "forest", NULL};

static const experiment experiments[] = {
    {"lights", measure_lights, table_all_scenes, NULL},
    {"ablation", measure_ablation, table_all_scenes, NULL},
    {"calls", measure_calls, table_scenes, some_maps},
    {"ergun", measure_ergun, table_scenes, ergun_maps},
    {"ward", measure_ward, table_ward_scene, NULL},
    {"product", measure_product, table_scenes, some_maps},
    {"samplers", measure_direct, table_scenes, NULL},
    {"safe", measure_safe, table_metal_scene, NULL},
    {"bounces", measure_bounced, table_scenes, NULL}
};

#define EXPERIMENTS ((int)(sizeof experiments / sizeof experiments[0]))

static int has_map(const experiment *e, const char *name, int real)
{
    int i;

    for (i = 0; e->maps && e->maps[i]; i++)
        if (!strcmp(e->maps[i], name))
            return 1;
    return !e->maps && real;
}

/* A real map by its name, or a made-up one; 0 where it is not there. */
static int load_map(program *p, const char *name, int real)
{
    char path[64];

    snprintf(path, sizeof path, "data/%s.pfm", name);
    p->map_name = name;
    if (real)
        return image_read(path, &p->map, NULL, 0);
    return map_make(name, p->quick ? 64 : 512, p->quick ? 32 : 256, &p->map);
}

static int is_wanted(int argc, char **names, const char *name)
{
    int i;

    for (i = 0; i < argc; i++)
        if (!strcmp(names[i], name))
            return 1;
    return argc == 0;
}

static void measure_map(program *p, int map, int argc, char **argv)
{
    const int real = map < REPORT_REAL;
    const char *name = report_maps[map];
    int i, k;

    if (!load_map(p, name, real)) {
        fprintf(stderr, "no data/%s.pfm: left out; make data fetches it\n", name);
        return;
    }
    for (i = 0; i < EXPERIMENTS; i++) {
        const experiment *e = &experiments[i];

        if (!is_wanted(argc, argv, e->name) || !(p->quick || has_map(e, name, real)))
            continue;
        for (k = 0; k < 1 || (!p->quick && e->scenes[k]); k++) {
            fprintf(stderr, "%s, %s, %s\n", name, e->scenes[k], e->name);
            e->measure(p, e->scenes[k]);
        }
    }
    image_free(&p->map);
}

/* ---- the program ---- */

static void usage(void)
{
    int i;

    fprintf(stderr, "usage: render_tables [-q] [-t THREADS] [-o FOLDER] [TABLE...]\n  tables:");
    for (i = 0; i < EXPERIMENTS; i++)
        fprintf(stderr, " %s", experiments[i].name);
    fprintf(stderr, "\n");
    exit(1);
}

static int parse(program *p, int argc, char **argv)
{
    int i, k;

    p->threads = 1;
    p->folder = "bench/results";
    for (i = 1; i < argc && argv[i][0] == '-'; i++)
        if (!strcmp(argv[i], "-q"))
            p->quick = 1;
        else if (!strcmp(argv[i], "-t") && i + 1 < argc)
            p->threads = atoi(argv[++i]);
        else if (!strcmp(argv[i], "-o") && i + 1 < argc)
            p->folder = argv[++i];
        else
            usage();
    for (k = i; k < argc; k++) {
        int known = 0, e;

        for (e = 0; e < EXPERIMENTS; e++)
            known |= !strcmp(argv[k], experiments[e].name);
        if (!known)
            usage();
    }
    if (p->threads < 1 || p->threads > 256)
        usage();
    return i;
}

static void configure(program *p)
{
    p->direct.folder = p->bounced.folder = REFERENCES;
    p->direct.threads = p->bounced.threads = p->threads;
    p->direct.width = p->quick ? 32 : 160;
    p->direct.height = p->quick ? 24 : 120;
    p->bounced.width = p->quick ? 16 : 80;
    p->bounced.height = p->quick ? 12 : 60;
    p->direct.reference_samples = p->bounced.reference_samples = p->quick ? 16 : 256;
}

int main(int argc, char **argv)
{
    char path[IMAGE_PATH_MAX], header[512], error[ERROR_SIZE];
    static program p;
    int names = parse(&p, argc, argv), i;

    configure(&p);
    MAKE_FOLDER("build");
    MAKE_FOLDER(REFERENCES);
    MAKE_FOLDER(p.folder);
    report_header(header, sizeof header, BENCH_FLAGS, BENCH_COMMIT, &p.direct, &p.bounced);
    snprintf(path, sizeof path, "%s/render.csv", p.folder);
    if (!cells_open(&p.cells, path, header, error, sizeof error))
        fail(error);
    for (i = p.quick ? REPORT_REAL : 0; i < REPORT_MAPS; i++)
        measure_map(&p, i, argc - names, argv + names);
    snprintf(path, sizeof path, "%s/render.md", p.folder);
    if (!report_write(&p.cells, path, error, sizeof error))
        fail(error);
    cells_close(&p.cells);
    printf("%s\n", path);
    return 0;
}
