/* sizes.c: see sizes.h. */
#include "sizes.h"
#include "builder.h"
#include "random.h"

#include <stdio.h>
#include <stdlib.h>

#define ROUNDS 3
#define NOON 1.2f
#define SAMPLES 65536

/* Excess variance of a table under bilinear lookups of the whole map, from samples of its own:
   E[(L / pdf)^2] / E[L / pdf]^2 - 1. */
static double excess(const envsamp_image *map, const envsamp_kd *kd)
{
    double second = 0.0, sum = 0.0;
    float u[2], rgb[3];
    uint32_t i;

    for (i = 0; i < SAMPLES; i++) {
        envsamp_sample s;
        double weight;

        sobol_owen(i, 1, u);
        s = envsamp_kd_sample(kd, u[0], u[1]);
        envsamp_lookup(map, 0, s.dir, rgb);
        weight = (double)rgb[0] / (double)s.pdf;
        second += weight * weight;
        sum += weight;
    }
    return second * SAMPLES / sum / sum - 1.0;
}

/* Frames, milliseconds and the longest step of a build: the best of some. */
static int measure(builder *b, double *best_ms, double *rows_ms, int *best_frames)
{
    int round, done;

    *best_ms = *rows_ms = 1e30;
    *best_frames = 1 << 30;
    for (round = 0; round < ROUNDS; round++) {
        double total = 0.0, rows = 0.0;
        int frames = 0;

        for (done = 0; !done; frames++) {
            if (builder_frame(b, round, 0.0, &done) != ENVSAMP_OK)
                return 0;
            total += b->budget.spent;
            rows += b->rows_ms;
        }
        if (tables_swap(&b->tables) != ENVSAMP_OK)
            return 0;
        *best_ms = total < *best_ms ? total : *best_ms;
        *rows_ms = rows < *rows_ms ? rows : *rows_ms;
        *best_frames = frames < *best_frames ? frames : *best_frames;
    }
    return 1;
}

static int print_line(const options *o, const envsamp_image *map, sky *source,
                      envsamp_kd_select select, int blocks)
{
    envsamp_kd_desc desc = o->desc;
    double ms, rows_ms;
    int frames, good;
    builder b;

    desc.select = select;
    desc.block_count = blocks;
    if (builder_make(&b, source, &desc, o->budget_ms, 0) != ENVSAMP_OK)
        return 0;
    good = measure(&b, &ms, &rows_ms, &frames);
    if (good)
        printf("%5d x %-5d %-5s %5d  %6.2f ms  %6.2f ms  %5.2f ms  %3d  %3d  %4zu KB  %7.4f\n",
               source->view.width, source->view.height,
               select == ENVSAMP_KD_ALIAS ? "ALIAS" : "WARP", blocks, ms, rows_ms, b.budget.worst,
               frames, 2 * frames - 1, envsamp_kd_bytes(b.tables.shown) / 1024,
               excess(map, b.tables.shown));
    builder_free(&b);
    fflush(stdout);
    return good;
}

static int print_lines(const options *o, sky *whole, sky *half, const envsamp_image *map)
{
    static const int blocks[6] = { 256, 512, 1024, 2048, 4096, 6144 };
    int i, good = 1;

    printf("budget %g ms a frame; CPU time, the best of %d builds; `longest' is of %d items; `age' "
           "the worst, in frames,\nif each table is built in as many; excess variance is of "
           "lookups of the whole map\n", o->budget_ms, ROUNDS, BUILDER_ITEMS);
    printf("%-13s %-5s %6s  %9s  %9s  %8s  %3s  %3s  %7s  %7s\n", "map", "", "blocks",
           "envsamp.h", "rows", "longest", "in", "age", "table", "excess");
    for (i = 0; i < 24 && good; i++)
        good = print_line(o, map, i < 12 ? whole : half,
                          i / 6 % 2 ? ENVSAMP_KD_ALIAS : ENVSAMP_KD_WARP, blocks[i % 6]);
    return good;
}

int sizes_print(const options *o)
{
    static sky whole, half;
    float *pixels = malloc((size_t)o->width * (size_t)o->height * sizeof *pixels);
    int good = pixels && sky_make(&whole, o->width, o->height, 1)
            && sky_make(&half, o->width / 2, o->height / 2, 1), y;

    if (good) {
        envsamp_image map = whole.view;

        map.pixels = pixels;
        sky_set(&whole, NOON);
        sky_set(&half, NOON);
        for (y = 0; y < o->height; y++)
            sky_row(y, pixels + (size_t)y * (size_t)o->width, &whole);
        good = print_lines(o, &whole, &half, &map);
    }
    if (!good)
        fprintf(stderr, "engine: out of memory\n");
    sky_free(&whole);
    sky_free(&half);
    free(pixels);
    return good;
}
