/* test_rebuild.c: a table rebuilt from the rows that changed has the bits of one built from all
 * rows, and no other row is read. */
#include "check.h"

#include "../envsamp.h"

#include "random.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define WIDTH 72
#define HEIGHT 37

/* ---- a map of rows ---- */

typedef struct row_map {
    float pixels[HEIGHT][WIDTH * 3];
    int first, count;       /* rows that may be read */
    int reads, strays;      /* rows that were read, and those of them that may not be */
    int fails_at;           /* row that cannot be read; -1 none */
} row_map;

static envsamp_result give_row(int y, float *row, void *user)
{
    row_map *map = (row_map *)user;

    map->reads++;
    map->strays += y < map->first || y >= map->first + map->count;
    memcpy(row, map->pixels[y], sizeof map->pixels[y]);
    return y == map->fails_at ? ENVSAMP_ERR_VALUE : ENVSAMP_OK;
}

/* Noise times `light`, and a lamp in the middle row. */
static void paint_rows(row_map *map, int first, int count, float light, uint64_t seed)
{
    pcg32 random = pcg32_make(seed, 3);
    int y, x;

    for (y = first; y < first + count && y < HEIGHT; y++)
        for (x = 0; x < WIDTH * 3; x++) {
            const float value = pcg32_float(&random);

            map->pixels[y][x] = value < 0.05f ? 0.0f : light * value * value;
        }
    if (first <= HEIGHT / 2 && first + count > HEIGHT / 2)
        map->pixels[HEIGHT / 2][WIDTH] = 4000.0f * light;
}

static row_map *new_map(void)
{
    row_map *map = (row_map *)calloc(1, sizeof *map);

    if (!map)
        abort();
    map->count = HEIGHT;
    map->fails_at = -1;
    paint_rows(map, 0, HEIGHT, 1.0f, 1);
    return map;
}

/* ---- builds ---- */

typedef struct builder {
    envsamp_image image;
    envsamp_kd_desc desc;
    envsamp_buffer table, scratch;
    const envsamp_kd *kd;
    row_map *map;
} builder;

static builder new_builder(row_map *map, const envsamp_kd_desc *desc, envsamp_mapping mapping)
{
    builder b = { { NULL, WIDTH, HEIGHT, 3, 0, ENVSAMP_LATLONG }, { 0 }, { NULL, 0 }, { NULL, 0 },
                  NULL, NULL };

    b.image.mapping = mapping;
    b.desc = *desc;
    b.map = map;
    b.table.data = malloc(b.table.bytes = 1 << 20);
    b.scratch.data = malloc(b.scratch.bytes = 1 << 21);
    if (!b.table.data || !b.scratch.data)
        abort();
    memset(b.scratch.data, 0x55, b.scratch.bytes);
    return b;
}

static void free_builder(builder *b)
{
    free(b->table.data);
    free(b->scratch.data);
}

static envsamp_result build(builder *b)
{
    b->map->first = 0;
    b->map->count = HEIGHT;
    return envsamp_kd_build_rows(&b->image, give_row, b->map, &b->desc, b->table, b->scratch,
                                 &b->kd);
}

static envsamp_result begin_rebuild(builder *b, int first, int count, envsamp_kd_job **job)
{
    b->map->first = first;
    b->map->count = count;
    b->map->reads = b->map->strays = 0;
    b->kd = NULL;
    return envsamp_kd_rebuild_begin(&b->image, give_row, b->map, &b->desc, first, count, b->table,
                                    b->scratch, job);
}

static envsamp_result rebuild(builder *b, int first, int count)
{
    envsamp_kd_job *job = NULL;
    envsamp_result result = begin_rebuild(b, first, count, &job);

    return result == ENVSAMP_OK ? envsamp_kd_finish(job, &b->kd) : result;
}

/* Whether a table has the bits of one that is built from all rows. */
static int is_as_built(const builder *b)
{
    builder all = new_builder(b->map, &b->desc, b->image.mapping);
    int same = build(&all) == ENVSAMP_OK && b->kd && envsamp_kd_bytes(b->kd)
            == envsamp_kd_bytes(all.kd) && !memcmp(b->kd, all.kd, envsamp_kd_bytes(all.kd));

    free_builder(&all);
    return same;
}

/* ---- tests ---- */

static const struct { int first, count; float light; } changes[] = {
    { 1, 3, 1.0f }, { 3, 2, 1.0f }, { 0, 1, 0.7f }, { HEIGHT - 1, 1, 2.0f }, { 0, 0, 1.0f },
    { 17, 3, 0.01f }, { 16, 5, 1e-30f }, { 11, 16, 1e30f }, { 12, 1, 1e-6f }, { 18, 1, 1.0f },
    { 0, HEIGHT, 3e-38f }, { 30, 50, 1.0f }, { 12, 13, 1.0f }
};

static void test_same_bits(void)
{
    static const envsamp_mapping mappings[] = { ENVSAMP_LATLONG, ENVSAMP_HEMISPHERE,
                                                ENVSAMP_OCTAHEDRAL };
    int m, nearest, select;
    size_t i;

    for (m = 0; m < 3; m++)
        for (nearest = 0; nearest < 2; nearest++)
            for (select = 0; select < 3; select++) {
                envsamp_kd_desc desc = envsamp_kd_defaults();
                row_map *map = new_map();
                int folds = mappings[m] == ENVSAMP_OCTAHEDRAL && !nearest;
                int different = 0, strays = 0, failures, miscounted = 0;
                builder b;

                desc.block_count = 300;
                desc.select = (envsamp_kd_select)select;
                desc.nearest = nearest;
                b = new_builder(map, &desc, mappings[m]);
                failures = build(&b) != ENVSAMP_OK;
                for (i = 0; i < sizeof changes / sizeof *changes; i++) {
                    int first = changes[i].first, count = changes[i].count;
                    int rows = first + count > HEIGHT ? HEIGHT - first : count;

                    paint_rows(map, first, count, changes[i].light, 10 + i);
                    failures += rebuild(&b, first, count) != ENVSAMP_OK;
                    strays += map->strays;
                    miscounted += map->reads != rows;
                    different += !is_as_built(&b);
                }
                CHECK(IS(failures, 0) && IS(different, 0)
                      && (folds || (IS(strays, 0) && IS(miscounted, 0))),
                      "%d changes, mapping %d, nearest %d, select %d: the bits of full builds",
                      (int)(sizeof changes / sizeof *changes), m, nearest, select);
                free_builder(&b);
                free(map);
            }
}

/* The comparison sees a row that was not read. */
static void test_control(void)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    row_map *map = new_map();
    builder b = new_builder(map, &desc, ENVSAMP_LATLONG);

    build(&b);
    paint_rows(map, 8, 2, 3.0f, 5);
    CHECK(IS(rebuild(&b, 8, 1), ENVSAMP_OK) && !is_as_built(&b),
          "control: of two rows that changed, one is read: other bits");
    free_builder(&b);
    free(map);
}

static void test_descriptions(void)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    row_map *map = new_map();
    builder b = new_builder(map, &desc, ENVSAMP_LATLONG);
    int failed;

    build(&b);
    b.desc.block_count = 200;
    b.desc.facing = 1;
    CHECK(IS(rebuild(&b, 0, 0), ENVSAMP_OK) && IS(map->reads, 0) && is_as_built(&b),
          "another number of blocks, with `facing`, and no row read");
    b.desc = envsamp_kd_defaults();
    b.desc.mis_compensation = 0.5f;
    CHECK(IS(rebuild(&b, 4, 1), ENVSAMP_OK) && is_as_built(&b),
          "with compensation: every row is read");
    b.desc.mis_compensation = 0.0f;
    CHECK(IS(rebuild(&b, 4, 1), ENVSAMP_ERR_FORMAT), "from cells of compensated light: refused");
    b.desc.importance_exponent = 1.5f;
    CHECK(IS(rebuild(&b, 4, 1), ENVSAMP_OK) && is_as_built(&b),
          "with an exponent: every row is read");
    b.desc.importance_exponent = 1.0f;
    CHECK(IS(rebuild(&b, 4, 1), ENVSAMP_ERR_FORMAT), "from cells of a power of light: refused");
    build(&b);
    map->pixels[20][7] = -1.0f;
    map->pixels[5][0] = INFINITY;
    failed = rebuild(&b, 20, 1) != ENVSAMP_OK || rebuild(&b, 5, 1) != ENVSAMP_OK;
    CHECK(IS(failed, 0) && is_as_built(&b), "bad pixels in rows that were and were not read again");
    b.desc.strict = 1;
    CHECK(IS(rebuild(&b, 9, 1), ENVSAMP_ERR_VALUE), "strict: bad pixels of rows that are not read");
    free_builder(&b);
    free(map);
}

/* One step at a time, and moved to another buffer between. */
static void test_steps(void)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    row_map *map = new_map();
    builder b = new_builder(map, &desc, ENVSAMP_LATLONG), other = new_builder(map, &desc,
                                                                              ENVSAMP_LATLONG);
    envsamp_kd_job *job;
    int done = 0;

    build(&b);
    memcpy(other.scratch.data, b.scratch.data, b.scratch.bytes);
    paint_rows(map, 6, 9, 0.3f, 8);
    if (begin_rebuild(&other, 6, 9, &job) == ENVSAMP_OK) {
        while (!done)
            envsamp_kd_step(job, 1, &done);
        envsamp_kd_finish(job, &other.kd);
    }
    CHECK(is_as_built(&other), "step by step, from scratch that was moved");
    paint_rows(map, 7, 2, 5.0f, 9);
    if (begin_rebuild(&other, 7, 2, &job) == ENVSAMP_OK)
        envsamp_kd_step(job, HEIGHT, &done);
    CHECK(IS(rebuild(&other, 0, 0), ENVSAMP_OK) && is_as_built(&other),
          "abandoned after its rows: the next one goes on from there");
    if (begin_rebuild(&other, 7, 2, &job) == ENVSAMP_OK)
        envsamp_kd_step(job, 8, &done);
    CHECK(IS(rebuild(&other, 0, 0), ENVSAMP_ERR_FORMAT), "abandoned amid its rows: refused");
    build(&other);
    map->fails_at = 7;
    CHECK(IS(rebuild(&other, 7, 2), ENVSAMP_ERR_VALUE)
          && IS(rebuild(&other, 0, 1), ENVSAMP_ERR_FORMAT), "a row failed: refused from then on");
    free_builder(&b);
    free_builder(&other);
    free(map);
}

static void test_refused(void)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    row_map *map = new_map();
    builder b = new_builder(map, &desc, ENVSAMP_LATLONG);
    envsamp_kd_job *job = NULL;

    CHECK(IS(begin_rebuild(&b, 4, 1, &job), ENVSAMP_ERR_FORMAT) && !job,
          "scratch of no build: refused");
    CHECK(IS(begin_rebuild(&b, 0, INT_MAX, &job), ENVSAMP_OK) && job, "all rows: a build");
    build(&b);
    CHECK(IS(begin_rebuild(&b, -1, 3, &job), ENVSAMP_ERR_PARAM)
          && IS(begin_rebuild(&b, 1, -3, &job), ENVSAMP_ERR_PARAM) && !job
          && IS(begin_rebuild(&b, 0, 1, NULL), ENVSAMP_ERR_NULL), "negative rows, no job");
    CHECK(IS(rebuild(&b, INT_MAX, INT_MAX), ENVSAMP_OK) && IS(map->reads, 0) && is_as_built(&b),
          "rows beyond the map: none is read");
    b.image.mapping = ENVSAMP_HEMISPHERE;
    CHECK(IS(rebuild(&b, 4, 1), ENVSAMP_ERR_FORMAT), "another mapping: refused");
    b.image.mapping = ENVSAMP_LATLONG;
    build(&b);
    b.desc.nearest = 1;
    CHECK(IS(rebuild(&b, 4, 1), ENVSAMP_ERR_FORMAT), "other lookups: refused");
    b.desc.nearest = 0;
    CHECK(IS(rebuild(&b, 4, 1), ENVSAMP_OK) && is_as_built(&b), "a refusal leaves scratch as it was");
    b.image.height--;
    CHECK(IS(rebuild(&b, 4, 1), ENVSAMP_ERR_FORMAT), "another height: refused");
    b.image.height++;
    build(&b);
    memset(map->pixels, 0, sizeof map->pixels);
    CHECK(IS(rebuild(&b, 0, HEIGHT), ENVSAMP_ERR_BLACK), "all black");
    paint_rows(map, 2, 1, 1.0f, 4);
    CHECK(IS(rebuild(&b, 2, 1), ENVSAMP_OK) && is_as_built(&b), "lit again by one row");
    free_builder(&b);
    free(map);
}

int main(void)
{
    test_same_bits();
    test_control();
    test_descriptions();
    test_steps();
    test_refused();
    return check_done();
}
