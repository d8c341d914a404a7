/* engine.c: a frame loop under a sky whose sun moves.
 *
 *     engine [--size 2048x1024] [--blocks 512] [--budget-ms 2] [--threads 2] [--help]
 *
 * In each frame threads sample the table of an older sky, while this one builds the next table in
 * steps, as many as fit into a few milliseconds. At the frame's end, when nobody samples, the table
 * that is whole is shown. A few lights for shadow maps, of a small picture of the sky, follow it.
 *
 *     sky.c       the sky and its sun, row by row
 *     tables.c    two tables that are swapped
 *     budget.c    which steps fit into a frame
 *     builder.c   tables and budget together
 *     workers.c   threads that sample, and check that they see one whole table
 *     lights.c    lights that move with the sky and do not pop
 *     change.c    how much irradiance changes from frame to frame
 *     sizes.c     what tables of all kinds take
 *
 * Exit status 1: a frame saw a table that was half built, or two at once, or an error, in one line.
 */
#define _POSIX_C_SOURCE 200809L
#define ENVSAMP_IMPLEMENTATION
#include "envsamp.h"

#include "builder.h"
#include "change.h"
#include "clock.h"
#include "lights.h"
#include "options.h"
#include "sizes.h"
#include "workers.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LIGHTS_WIDTH 128        /* of the picture that lights are made of */
#define LIGHTS_HEIGHT 64
#define LIGHTS_EVERY 6          /* frames they aim at the sky anew */
#define LIGHTS_PART 0.1f        /* of the way that they go in a frame */
#define MORNING 1.2f            /* where the sun begins its way, in radians */

/* Mean and worst of what frames tell. */
typedef struct figure { double sum, worst; int count; } figure;

typedef struct engine {
    options options;
    sky map, picture;           /* of tables, and of lights */
    float *pixels;              /* the picture's */
    builder builder;
    workers workers;
    light_set lights;
    void *first;                /* CONTROL_MIXED: a copy of the first table */
    change of_sky, of_raw, of_lights;
    figure library, rows, wall, age;
    int swaps, over;            /* frames above the budget */
} engine;

static void figure_add(figure *f, double value)
{
    f->sum += value;
    f->worst = value > f->worst ? value : f->worst;
    f->count++;
}

static float sun_at(const engine *e, int frame)
{
    return MORNING + (float)(e->options.speed * frame) * SKY_PI / 180.0f;
}

/* ---- lights ---- */

/* A graphics card would draw this picture. */
static void draw_picture(engine *e, int frame)
{
    int y;

    sky_set(&e->picture, sun_at(e, frame));
    for (y = 0; y < LIGHTS_HEIGHT; y++)
        sky_row(y, e->pixels + 3 * LIGHTS_WIDTH * y, &e->picture);
}

/* Adds the time. */
static envsamp_result move_lights(engine *e, int frame, double *spent_ms)
{
    envsamp_result result = ENVSAMP_OK;
    const double start = thread_ms();

    if (frame % LIGHTS_EVERY == 0)
        result = light_set_aim(&e->lights, &e->picture.view);
    light_set_follow(&e->lights, LIGHTS_PART);
    *spent_ms += thread_ms() - start;
    return result;
}

static void judge_lights(engine *e, int frame)
{
    double irradiance[CHANGE_NORMALS];

    change_of_map(&e->picture.view, irradiance);
    change_add(&e->of_sky, irradiance);
    change_of_lights(e->lights.now, e->lights.count, irradiance);
    change_add(&e->of_lights, irradiance);
    if (frame % LIGHTS_EVERY != 0)
        return;
    change_of_lights(e->lights.raw, e->lights.wanted, irradiance);
    change_add(&e->of_raw, irradiance);
}

/* ---- frames ---- */

static void start_workers(engine *e, int frame)
{
    const tables *t = &e->builder.tables;
    const worker_job job = { t->shown, e->first ? (const envsamp_kd *)e->first : t->shown,
                             t->table[0].bytes, frame };

    workers_start(&e->workers, &job);
    figure_add(&e->age, frame - t->shown_frame);
}

/* At its end, when nobody samples. */
static envsamp_result end_frame(engine *e, int done)
{
    tables *t = &e->builder.tables;

    e->swaps += done;
    if (done)
        return tables_swap(t);
    if (e->options.control == CONTROL_EARLY)
        t->shown = (const envsamp_kd *)t->table[t->back].data;
    return ENVSAMP_OK;
}

static envsamp_result run_frame(engine *e, int frame)
{
    const double start = wall_ms();
    double spent_ms = 0.0;
    envsamp_result result = ENVSAMP_OK;
    int done = 0;

    start_workers(e, frame);
    if (e->options.lights)
        draw_picture(e, frame);
    if (e->options.lights)
        result = move_lights(e, frame, &spent_ms);
    if (!e->builder.tables.job)
        sky_set(&e->map, sun_at(e, frame));
    if (result == ENVSAMP_OK)
        result = builder_frame(&e->builder, frame, spent_ms, &done);
    workers_wait(&e->workers);
    if (result == ENVSAMP_OK)
        result = end_frame(e, done);
    figure_add(&e->library, e->builder.budget.spent);
    figure_add(&e->rows, e->builder.rows_ms);
    figure_add(&e->wall, wall_ms() - start);
    e->over += e->builder.budget.spent > e->options.budget_ms;
    if (e->options.lights)
        judge_lights(e, frame);
    return result;
}

/* ---- beginning and end ---- */

static envsamp_result engine_make(engine *e)
{
    const options *o = &e->options;
    envsamp_result result = ENVSAMP_ERR_MEMORY;

    if (!sky_make(&e->map, o->width >> o->half, o->height >> o->half, 1)
        || !sky_make(&e->picture, LIGHTS_WIDTH, LIGHTS_HEIGHT, 3))
        return result;
    e->pixels = calloc(3 * LIGHTS_WIDTH * LIGHTS_HEIGHT, sizeof *e->pixels);
    e->picture.view.pixels = e->pixels;
    sky_set(&e->map, sun_at(e, 0));
    if (!e->pixels || (o->lights && !light_set_make(&e->lights, &e->picture.view, o->lights)))
        return result;
    draw_picture(e, 0);
    if (o->lights && (result = light_set_aim(&e->lights, &e->picture.view)) != ENVSAMP_OK)
        return result;
    result = builder_make(&e->builder, &e->map, &o->desc, o->budget_ms, o->items);
    if (result == ENVSAMP_OK && o->control == CONTROL_MIXED) {
        e->first = malloc(e->builder.tables.table[0].bytes);
        if (!e->first)
            return ENVSAMP_ERR_MEMORY;
        memcpy(e->first, e->builder.tables.table[0].data, e->builder.tables.table[0].bytes);
    }
    if (result == ENVSAMP_OK && !workers_make(&e->workers, o->threads, o->samples))
        return ENVSAMP_ERR_MEMORY;
    return result;
}

static void engine_free(engine *e)
{
    if (e->workers.count > 0)
        workers_free(&e->workers);
    builder_free(&e->builder);
    light_set_free(&e->lights);
    sky_free(&e->map);
    sky_free(&e->picture);
    free(e->pixels);
    free(e->first);
}

static void print_lights(const engine *e)
{
    printf("lights: %d, at most %d at a time; largest change of irradiance in a frame, over the "
           "largest irradiance:\n  sky %.5f, lights as they come %.5f, those that follow %.5f; of "
           "one light, over all light, %.5f\n", e->lights.wanted, e->lights.most, e->of_sky.worst,
           e->of_raw.worst, e->of_lights.worst, (double)e->lights.jump);
}

/* Returns whether every frame saw one whole table. */
static int print_figures(const engine *e)
{
    const options *o = &e->options;
    const budget *b = &e->builder.budget;
    int half_built = 0, mixed = 0, i;
    double across = 0.0;
    long samples = 0;

    for (i = 0; i < e->workers.count; i++) {
        half_built += e->workers.each[i].half_built;
        mixed += e->workers.each[i].mixed;
        samples += e->workers.each[i].samples;
        across = across > e->workers.each[i].across ? across : e->workers.each[i].across;
    }
    printf("%d x %d, luminance%s, %s, %d blocks; sun %g degrees a frame; %d frames\n", o->width,
           o->height, o->half ? " at half of that" : "",
           o->desc.select == ENVSAMP_KD_ALIAS ? "ALIAS" : "WARP", o->desc.block_count, o->speed,
           o->frames);
    printf("in envsamp.h, CPU time of a frame: mean %.2f ms, worst %.2f ms; above the budget of "
           "%g ms: %d frames\n", e->library.sum / e->library.count, e->library.worst,
           o->budget_ms, e->over);
    printf("rows of the sky: mean %.2f ms, worst %.2f ms; wall time of a frame: mean %.2f ms, "
           "worst %.2f ms\n", e->rows.sum / e->rows.count, e->rows.worst,
           e->wall.sum / e->wall.count, e->wall.worst);
    printf("tables: %d shown; age mean %.1f, worst %.0f frames; the fastest build %.2f ms, longest "
           "step %.2f ms\n", e->swaps, e->age.sum / e->age.count, e->age.worst, b->least, b->worst);
    if (o->lights)
        print_lights(e);
    printf("samples: %ld by %d threads; at most %.2f %% in a frame have a density across an edge\n",
           samples, o->threads, 100.0 * across);
    if (half_built + mixed == 0)
        printf("every frame saw one whole table\n");
    else
        printf("frames of a thread that saw a half-built table: %d, two tables: %d\n", half_built,
               mixed);
    return half_built + mixed == 0;
}

int main(int argc, char **argv)
{
    static engine e;
    char error[256];
    const int read = options_read(&e.options, argc, argv, error, sizeof error);
    envsamp_result result;
    int frame, good = 0;

    if (read < 0)
        fputs(options_help, stdout);
    if (read == 0)
        fprintf(stderr, "%s\n", error);
    if (read <= 0)
        return read == 0;
    if (e.options.sizes)
        return !sizes_print(&e.options);
    result = engine_make(&e);
    for (frame = 0; frame < e.options.frames && result == ENVSAMP_OK; frame++)
        result = run_frame(&e, frame);
    if (result == ENVSAMP_OK)
        good = print_figures(&e);
    else
        fprintf(stderr, "engine: %s\n", envsamp_result_string(result));
    engine_free(&e);
    return !good;
}
