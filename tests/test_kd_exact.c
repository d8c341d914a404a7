/* test_kd_exact.c: kd tables against brute-force sums over the map, and sampling, pdf, mappings
 * and lookup against libm and hand-computed values. Nothing here is statistical.
 */
#include "check.h"

#include "../envsamp.h"

#include "kd_fixture.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"

#include <float.h>

#define UNIT 16777216           /* 2^24: how many values a float u has */
#define EDGE 5e-7               /* of u and v: how near an edge a float direction is ambiguous */

/* ---- a table and which blocks hold each texel ---- */

typedef struct grid {
    kd_fixture f;
    kd_cover cover;
    const kd_rect *rects;
    float *pdfs;                /* of each block, from a direction in its middle */
    int untiled;                /* texels that no block holds, or more than one */
} grid;

static int grid_build(grid *g, const envsamp_image *map, const envsamp_kd_desc *desc)
{
    int i;

    memset(g, 0, sizeof *g);
    if (!kd_fixture_build(&g->f, map, desc))
        return 0;
    g->cover = kd_cover_make(&g->f);
    g->rects = g->cover.rects;
    g->untiled = kd_cover_faults(&g->cover);
    g->pdfs = (float *)kd_allocate((size_t)g->f.info.block_count * sizeof *g->pdfs);
    for (i = 0; i < g->f.info.block_count; i++) {
        const kd_rect *r = &g->rects[i];
        float dir[3];

        kd_direction(0.5 * (r->u0 + r->u1), 0.5 * (r->v0 + r->v1), dir);
        g->pdfs[i] = envsamp_kd_pdf(g->f.kd, dir);
    }
    return 1;
}

static void grid_free(grid *g)
{
    kd_cover_free(&g->cover);
    free(g->pdfs);
    kd_fixture_free(&g->f);
}

/* Whether a pdf is that of a block in the texel of one point, and no further than EDGE from
   another, u to within a turn. */
static int texel_accepts(const grid *g, double near_u, double near_v, double u, double v, float pdf)
{
    const int texel = kd_cover_texel(&g->cover, near_u, near_v);
    int k, turn;

    for (k = g->cover.first[texel]; k < g->cover.first[texel + 1]; k++) {
        const kd_rect *r = &g->rects[g->cover.pieces[k].block];
        const double own = r->probability / r->solid_angle;

        for (turn = -1; turn <= 1; turn++)
            if (kd_outside(r, u + (double)turn, v) <= EDGE
                && fabs((double)pdf - own) <= 4e-7 * own)
                return 1;
    }
    return 0;
}

/* Whether a pdf at (u, v) is that of the block there, or, at an edge, of one that adjoins it. */
static int grid_accepts(const grid *g, double u, double v, float pdf)
{
    int i;

    for (i = 0; i < 9; i++)
        if (texel_accepts(g, u + EDGE * (double)(i % 3 - 1), v + EDGE * (double)(i / 3 - 1), u, v,
                          pdf))
            return 1;
    return 0;
}

/* Whether a pdf is that of a block that touches a pole. */
static int pole_accepts(const grid *g, int south, float pdf)
{
    int i;

    for (i = 0; i < g->f.info.block_count; i++) {
        const kd_rect *r = &g->rects[i];
        const double own = r->probability / r->solid_angle;

        if ((south ? 1.0 - r->v1 : r->v0) <= EDGE && fabs((double)pdf - own) <= 4e-7 * own)
            return 1;
    }
    return 0;
}

/* A pole has every azimuth, and which of them the signs of its zeros mean is the library's. */
static int grid_accepts_direction(const grid *g, const float dir[3])
{
    const float pdf = envsamp_kd_pdf(g->f.kd, dir);
    double u, v;

    kd_point(dir, &u, &v);
    if (!(fabsf(dir[0]) + fabsf(dir[1]) > 0.0f))
        return pole_accepts(g, dir[2] < 0.0f, pdf);
    return grid_accepts(g, u, v, pdf);
}

/* ---- the audit of a table: the worst of each property over many tables ---- */

typedef struct audit {
    int tables, failed, untiled, overrun;
    double sum, solid, claimed, corners, pdf, sphere;
    long blocks, narrow;
    double integral, excess, ratio, l1;
    long lit_unsampled, unsorted, unranked;
    long samples, mismatched, strays, dark;
    double length, point, place;
    long edge_misses, scan_misses, batch_differences, rebuild_differences;
} audit;

static void worst(double *so_far, double value)
{
    if (!(value <= *so_far))
        *so_far = value;
}

/* Blocks so narrow that their middle may round into the next one, which WARP makes in a sun. */
static int wide_enough(const kd_rect *r)
{
    return r->u1 - r->u0 > 4.0 * EDGE && r->v1 - r->v0 > 4.0 * EDGE;
}

static void audit_blocks(const grid *g, audit *a)
{
    double sum = 0.0, sphere = 0.0, before = 2.0;
    int i;

    for (i = 0; i < g->f.info.block_count; i++) {
        const kd_rect *rect = &g->rects[i];
        envsamp_kd_block block;

        envsamp_kd_get_block(g->f.kd, i, &block);
        sum += rect->probability;
        sphere += wide_enough(rect) ? (double)g->pdfs[i] * rect->solid_angle : rect->probability;
        a->blocks++;
        a->narrow += !wide_enough(rect);
        worst(&a->solid, fabs((double)block.solid_angle / rect->solid_angle - 1.0));
        worst(&a->claimed, fabs((double)block.probability - rect->probability)
                           / (rect->probability > 0.0 ? rect->probability : 1e-9));
        worst(&a->corners, fabs((double)block.uv_min[0] - rect->u0));
        worst(&a->corners, fabs((double)block.uv_min[1] - rect->v0));
        worst(&a->corners, fabs((double)block.uv_max[0] - rect->u1));
        worst(&a->corners, fabs((double)block.uv_max[1] - rect->v1));
        if (wide_enough(rect) && g->pdfs[i] > 0.0f)
            worst(&a->pdf, fabs((double)block.probability / (double)block.solid_angle
                                / (double)g->pdfs[i] - 1.0));
        else if (wide_enough(rect))
            worst(&a->pdf, rect->probability > 0.0 ? 1.0 : 0.0);
        a->unsorted += g->f.desc.select == ENVSAMP_KD_FIT
                    && rect->probability > before * (1.0 + 1e-6);
        before = rect->probability;
    }
    worst(&a->sum, fabs(sum - 1.0));
    worst(&a->sphere, fabs(sphere - 1.0));
}

/* What samples of a map cost. */
typedef struct cost { double integral, second, ratio; } cost;

static void cost_texel(const grid *g, int texel, double value, double sr, cost *c, audit *a)
{
    int k;

    for (k = g->cover.first[texel]; k < g->cover.first[texel + 1]; k++) {
        const kd_piece *piece = &g->cover.pieces[k];
        const kd_rect *rect = &g->rects[piece->block];
        const double over = value * rect->solid_angle / rect->probability;

        if (rect->probability > 0.0) {
            c->second += piece->share * sr * value * over;
            c->ratio = over > c->ratio ? over : c->ratio;
        } else {
            a->lit_unsampled += value > 0.0;
        }
    }
    c->integral += sr * value;
}

/* Integral, excess variance and largest ratio, texel by texel in double. */
static void audit_info(const grid *g, audit *a)
{
    const envsamp_image *map = &g->f.image;
    cost c = { 0.0, 0.0, 0.0 };
    double excess;
    int x, y;

    for (y = 0; y < map->height; y++) {
        const double sr = kd_solid_angle(map->width, map->height, 0, y, 1, y + 1);

        for (x = 0; x < map->width; x++)
            cost_texel(g, y * map->width + x, kd_texel(map, x, y), sr, &c, a);
    }
    excess = c.second / c.integral / c.integral - 1.0;
    worst(&a->integral, fabs(g->f.info.integral / c.integral - 1.0));
    worst(&a->ratio, fabs(g->f.info.max_ratio / (c.ratio / c.integral) - 1.0));
    worst(&a->excess, fabs(g->f.info.excess_variance - excess) / (1.0 + excess));
    if (!(g->f.info.excess_variance >= 0.0))
        worst(&a->excess, 1.0);
}

/* FIT for L1 ranks blocks by mass, and l1 is how far their probabilities are from it. */
static void audit_ranks(const grid *g, audit *a)
{
    const envsamp_image *map = &g->f.image;
    double l1 = 0.0, before = HUGE_VAL;
    int i, x, y;

    for (i = 0; g->f.desc.select == ENVSAMP_KD_FIT && i < g->f.info.block_count; i++) {
        const kd_rect *r = &g->rects[i];
        double mass = 0.0;

        for (y = (int)r->y0; y < (int)r->y1; y++)
            for (x = (int)r->x0; x < (int)r->x1; x++)
                mass += kd_texel(map, x, y)
                      * kd_solid_angle(map->width, map->height, 0, y, 1, y + 1);
        a->unranked += g->f.desc.objective == ENVSAMP_KD_L1 && mass > before * (1.0 + 1e-6);
        before = mass;
        l1 += fabs(mass / g->f.info.integral - r->probability);
    }
    worst(&a->l1, fabs(g->f.info.l1 - l1));
}

static double turn_distance(double a, double b)
{
    const double distance = fabs(a - b);

    return distance < 0.5 ? distance : 1.0 - distance;
}

/* At a pole u is any, so the distance in u counts by the sine of the polar angle. */
static void audit_sample(const grid *g, float u0, float u1, audit *a)
{
    const envsamp_sample s = envsamp_kd_sample(g->f.kd, u0, u1);
    const float pdf = envsamp_kd_pdf(g->f.kd, s.dir);
    const double x = (double)s.dir[0], y = (double)s.dir[1], z = (double)s.dir[2];
    double u, v;
    float uv[2];

    kd_point(s.dir, &u, &v);
    envsamp_dir_to_uv(ENVSAMP_LATLONG, s.dir, uv);
    worst(&a->length, fabs(sqrt(x * x + y * y + z * z) - 1.0));
    worst(&a->point, turn_distance((double)s.uv[0], u) * sqrt(x * x + y * y));
    worst(&a->point, fabs((double)s.uv[1] - v));
    worst(&a->place, turn_distance((double)s.uv[0], (double)uv[0]) * sqrt(x * x + y * y));
    worst(&a->place, fabs((double)s.uv[1] - (double)uv[1]));
    a->samples++;
    a->dark += !(s.pdf > 0.0f);
    if (memcmp(&pdf, &s.pdf, sizeof pdf) != 0) {
        a->mismatched++;
        a->strays += !grid_accepts(g, u, v, s.pdf) || !grid_accepts(g, u, v, pdf);
    }
}

static void audit_sampling(const grid *g, int count, audit *a)
{
    pcg32 random = pcg32_make(7, (uint64_t)a->tables);
    int i;

    for (i = 0; i < count; i++) {
        const float u0 = pcg32_float(&random);

        audit_sample(g, u0, pcg32_float(&random), a);
    }
}

/* Both floats beside each component of a direction on the edge must hit what adjoins it. */
static long edge_misses(const grid *g, double u, double v)
{
    float dir[3], near[3];
    long misses = 0;
    int c, side;

    kd_direction(u, v, dir);
    for (c = 0; c < 3; c++)
        for (side = -1; side <= 1; side++) {
            memcpy(near, dir, sizeof near);
            near[c] = side ? nextafterf(dir[c], 2.0f * (float)side) : dir[c];
            misses += !grid_accepts_direction(g, near);
        }
    return misses;
}

static void audit_edges(const grid *g, audit *a)
{
    int i;

    for (i = 0; i < g->f.info.block_count; i++) {
        const kd_rect *r = &g->rects[i];
        const double u = 0.5 * (r->u0 + r->u1), v = 0.5 * (r->v0 + r->v1);

        a->edge_misses += edge_misses(g, r->u0, v) + edge_misses(g, r->u1, v)
                        + edge_misses(g, u, r->v0) + edge_misses(g, u, r->v1);
    }
}

static void audit_scan(const grid *g, int count, audit *a)
{
    pcg32 random = pcg32_make(11, (uint64_t)a->tables);
    float dir[3];
    int i;

    for (i = 0; i < count; i++) {
        kd_random_direction(&random, dir);
        a->scan_misses += !grid_accepts_direction(g, dir);
    }
}

#define BATCH 517

static void audit_batch(const grid *g, audit *a)
{
    static float u0[BATCH], u1[BATCH], x[BATCH], y[BATCH], z[BATCH], pdf[BATCH], again[BATCH];
    pcg32 random = pcg32_make(13, (uint64_t)a->tables);
    int i;

    for (i = 0; i < BATCH; i++) {
        u0[i] = pcg32_float(&random);
        u1[i] = pcg32_float(&random);
    }
    envsamp_kd_sample_n(g->f.kd, BATCH, u0, u1, x, y, z, pdf);
    envsamp_kd_pdf_n(g->f.kd, BATCH, x, y, z, again);
    for (i = 0; i < BATCH; i++) {
        const envsamp_sample s = envsamp_kd_sample(g->f.kd, u0[i], u1[i]);
        const float one = envsamp_kd_pdf(g->f.kd, s.dir);
        const float batch[4] = { x[i], y[i], z[i], pdf[i] };

        a->batch_differences += !kd_bits_equal(batch, s.dir, sizeof s.dir)
                             || !kd_bits_equal(&pdf[i], &s.pdf, sizeof(float))
                             || !kd_bits_equal(&again[i], &one, sizeof(float));
    }
}

/* Other rubbish in the buffers must not matter. */
static void audit_rebuild(const grid *g, audit *a)
{
    kd_guarded table = kd_guarded_make(g->f.sizes.table_bytes, 0xff);
    kd_guarded scratch = kd_guarded_make(g->f.sizes.scratch_bytes, 0x7f);
    const envsamp_kd *kd;
    const envsamp_result result = envsamp_kd_build(&g->f.image, &g->f.desc, table.buffer,
                                                   scratch.buffer, &kd);

    a->rebuild_differences += result != ENVSAMP_OK
                           || envsamp_kd_bytes(kd) != envsamp_kd_bytes(g->f.kd)
                           || !kd_bits_equal(kd, g->f.kd, envsamp_kd_bytes(kd));
    free(table.block);
    free(scratch.block);
}

static void audit_table(const envsamp_image *map, const envsamp_kd_desc *desc, int samples,
                        audit *a)
{
    grid g;

    a->tables++;
    if (!grid_build(&g, map, desc)) {
        a->failed++;
        kd_fixture_free(&g.f);
        return;
    }
    a->untiled += g.untiled;
    a->overrun += !kd_fixture_intact(&g.f);
    if (!g.untiled) {
        audit_blocks(&g, a);
        audit_info(&g, a);
        audit_ranks(&g, a);
        audit_sampling(&g, samples, a);
        audit_edges(&g, a);
        audit_scan(&g, samples, a);
        audit_batch(&g, a);
        audit_rebuild(&g, a);
    }
    grid_free(&g);
}

/* Tolerances: a float is 6e-8 off, a float pdf times a solid angle 1.2e-7; sums of squares pass
   through cells of floats. */
static void audit_report(const char *name, const audit *a)
{
    CHECK(!a->failed && a->tables, "%s: %d tables build", name, a->tables);
    CHECK(!a->untiled, "%s: blocks tile the map, %d texels do not", name, a->untiled);
    CHECK(!a->overrun, "%s: nothing is written beside the buffers", name);
    CHECK(a->sum <= 1e-6, "%s: probabilities sum to 1, but for %.1e", name, a->sum);
    CHECK(a->solid <= 2e-7, "%s: solid angles are %.1e off", name, a->solid);
    CHECK(a->claimed <= 2e-7, "%s: probabilities of blocks are %.1e off", name, a->claimed);
    CHECK(a->corners <= 3e-7, "%s: corners of blocks are %.1e off", name, a->corners);
    CHECK(a->narrow * 10 <= a->blocks, "%s: %ld of %ld blocks are too narrow to aim at", name,
          a->narrow, a->blocks);
    CHECK(a->pdf <= 4e-7, "%s: probability / solid angle is the pdf, to %.1e", name, a->pdf);
    CHECK(a->sphere <= 1e-6, "%s: the pdf integrates to 1, but for %.1e", name, a->sphere);
    CHECK(a->integral <= 5e-7, "%s: the integral is %.1e off", name, a->integral);
    CHECK(a->excess <= 2e-6, "%s: the excess variance is %.1e off", name, a->excess);
    CHECK(a->ratio <= 1e-6, "%s: the largest ratio is %.1e off", name, a->ratio);
    CHECK(!a->lit_unsampled, "%s: %ld lit texels have pdf 0", name, a->lit_unsampled);
    CHECK(!a->unsorted, "%s: FIT blocks fall in probability, %ld rise", name, a->unsorted);
    CHECK(!a->unranked, "%s: as their masses do, but for %ld", name, a->unranked);
    CHECK(a->l1 <= 2e-6, "%s: l1 is %.1e off", name, a->l1);
    CHECK(a->mismatched * 2000 < a->samples, "%s: pdf(sample) differs in %ld of %ld", name,
          a->mismatched, a->samples);
    CHECK(!a->strays, "%s: and is then that of a neighbour, but for %ld", name, a->strays);
    CHECK(!a->dark, "%s: every sample has a pdf above 0, but %ld", name, a->dark);
    CHECK(a->length <= 1e-6, "%s: directions have unit length, to %.1e", name, a->length);
    CHECK(a->point <= 4e-7, "%s: sample.uv is where dir points, to %.1e", name, a->point);
    CHECK(a->place <= 6e-7, "%s: and what dir_to_uv says, to %.1e", name, a->place);
    CHECK(!a->edge_misses, "%s: beside edges the pdf is a neighbour's, but for %ld", name,
          a->edge_misses);
    CHECK(!a->scan_misses, "%s: the pdf is that of the block found by scanning, but for %ld", name,
          a->scan_misses);
    CHECK(!a->batch_differences, "%s: batches are scalar calls, but for %ld", name,
          a->batch_differences);
    CHECK(!a->rebuild_differences, "%s: building again gives the same bits, but for %ld", name,
          a->rebuild_differences);
}

/* ---- every option on every made-up map ---- */

static void audit_options(const envsamp_image *map, int blocks, audit *a)
{
    int criterion, model, objective;

    for (criterion = 0; criterion <= ENVSAMP_KD_RANGE; criterion++) {
        envsamp_kd_desc desc = kd_desc(blocks, ENVSAMP_KD_ALIAS);

        desc.criterion = (envsamp_kd_criterion)criterion;
        audit_table(map, &desc, 4000, a);
        desc.select = ENVSAMP_KD_WARP;
        audit_table(map, &desc, 4000, a);
        desc.select = ENVSAMP_KD_FIT;
        for (model = 0; model <= ENVSAMP_KD_POWER; model++)
            for (objective = 0; objective <= ENVSAMP_KD_CHI2; objective++) {
                desc.model = (envsamp_kd_model)model;
                desc.objective = (envsamp_kd_objective)objective;
                audit_table(map, &desc, 4000, a);
            }
    }
}

static void test_options(void)
{
    static const int sizes[][3] = { { 64, 32, 500 }, { 147, 75, 900 }, { 33, 130, 257 } };
    char name[64];
    int m, s;

    for (m = 0; map_names[m]; m++)
        for (s = 0; s < 3; s++) {
            audit a = { 0 };
            image map;
            envsamp_image view;

            map_make(map_names[m], sizes[s][0], sizes[s][1], &map);
            view = kd_image(map.rgb, map.width, map.height, 3);
            audit_options(&view, sizes[s][2], &a);
            snprintf(name, sizeof name, "%s %dx%d", map_names[m], map.width, map.height);
            audit_report(name, &a);
            image_free(&map);
        }
}

static void test_default_size(void)
{
    char name[64];
    int m;

    for (m = 0; map_names[m]; m++) {
        envsamp_kd_desc desc = kd_desc(6144, ENVSAMP_KD_ALIAS);
        audit a = { 0 };
        image map;
        envsamp_image view;

        map_make(map_names[m], 1024, 512, &map);
        view = kd_image(map.rgb, map.width, map.height, 3);
        audit_table(&view, &desc, 100000, &a);
        desc.select = ENVSAMP_KD_FIT;
        audit_table(&view, &desc, 100000, &a);
        desc.select = ENVSAMP_KD_WARP;
        audit_table(&view, &desc, 100000, &a);
        snprintf(name, sizeof name, "%s, 6144 blocks", map_names[m]);
        audit_report(name, &a);
        image_free(&map);
    }
}

/* 16384 rows of few columns: in the pole rows cos theta differs from 1 by 1.8e-8. Bright poles
   make blocks there. */
static void test_tall_map(void)
{
    const int width = 8, height = 16384;
    float *pixels = (float *)kd_allocate((size_t)(width * height) * sizeof *pixels);
    envsamp_image map = kd_image(pixels, width, height, 1);
    envsamp_kd_desc desc = kd_desc(4096, ENVSAMP_KD_ALIAS);
    pcg32 random = pcg32_make(3, 0);
    audit a = { 0 };
    grid g;
    int i, thin = 0;

    for (i = 0; i < width * height; i++) {
        const int y = i / width, pole = y < 3 || y >= height - 3;

        pixels[i] = pcg32_float(&random) * (pole ? 1e6f : 1.0f);
    }
    audit_table(&map, &desc, 20000, &a);
    desc.select = ENVSAMP_KD_WARP;
    audit_table(&map, &desc, 20000, &a);
    audit_report("8x16384", &a);
    desc.select = ENVSAMP_KD_ALIAS;
    if (grid_build(&g, &map, &desc)) {
        for (i = 0; i < g.f.info.block_count; i++)
            thin += g.rects[i].y1 - g.rects[i].y0 < 1.5
                 && (g.rects[i].y0 < 0.5 || g.rects[i].y1 > (double)height - 0.5);
        grid_free(&g);
    }
    CHECK(thin > 1, "%d of those blocks are a single pole row high", thin);
    free(pixels);
}

/* ---- how many blocks ---- */

static int blocks_made(const envsamp_image *map, const envsamp_kd_desc *desc)
{
    kd_fixture f;
    const int made = kd_fixture_build(&f, map, desc) ? f.info.block_count : -1;

    kd_fixture_free(&f);
    return made;
}

static void test_flat_map(void)
{
    static float pixels[48 * 20];
    envsamp_image map = kd_image(pixels, 48, 20, 1);
    int i;

    for (i = 0; i < 48 * 20; i++)
        pixels[i] = 0.7f;
    for (i = 0; i < 12; i++) {
        envsamp_kd_desc desc = kd_desc(300, (envsamp_kd_select)(i / 4));
        const float up[3] = { 0.0f, 0.6f, 0.8f };
        kd_fixture f;

        desc.criterion = (envsamp_kd_criterion)(i % 4);
        CHECK(kd_fixture_build(&f, &map, &desc), "a flat map, criterion %d", i % 4);
        CHECK(f.info.block_count == 1, "stops at 1 block: %d", f.info.block_count);
        CHECK(IS_NEAR(f.info.integral / (0.7 * 4.0 * KD_PI), 1.0, 1e-7), "has integral 4 pi L");
        CHECK(f.info.excess_variance < 1e-6, "excess %.1e", f.info.excess_variance);
        CHECK(f.kd && IS_NEAR((double)envsamp_kd_pdf(f.kd, up) * 4.0 * KD_PI, 1.0, 1e-6),
              "pdf is 1 / 4 pi");
        kd_fixture_free(&f);
    }
}

static void test_constant_integral(void)
{
    static const int sizes[][2] = { { 1, 1 }, { 4, 2 }, { 101, 77 }, { 2048, 1024 } };
    envsamp_kd_desc desc = kd_desc(64, ENVSAMP_KD_ALIAS);
    int s;

    for (s = 0; s < 4; s++) {
        image map;
        envsamp_image view;
        kd_fixture f;

        map_make("constant", sizes[s][0], sizes[s][1], &map);
        view = kd_image(map.rgb, map.width, map.height, 3);
        kd_fixture_build(&f, &view, &desc);
        CHECK(fabs(f.info.integral - 4.0 * KD_PI) < 2e-6, "%dx%d of ones: %.9f is 4 pi",
              map.width, map.height, f.info.integral);
        kd_fixture_free(&f);
        image_free(&map);
    }
}

static void test_block_counts(void)
{
    float pixels[12 * 6] = { 0 };
    envsamp_image map = kd_image(pixels, 12, 6, 1);
    pcg32 random = pcg32_make(5, 0);
    int i;

    for (i = 0; i < 72; i++)
        pixels[i] = 0.1f + pcg32_float(&random);
    for (i = 0; i < 8; i++) {       /* WARP cuts texels: see test_kd_warp.c */
        envsamp_kd_desc desc = kd_desc(1048576, i < 4 ? ENVSAMP_KD_ALIAS : ENVSAMP_KD_FIT);
        const int wanted[] = { 1, 2, 3, 71, 72, 73 };
        int k;

        desc.criterion = (envsamp_kd_criterion)(i % 4);
        CHECK(blocks_made(&map, &desc) == 72, "72 texels give at most 72 blocks, case %d", i);
        for (k = 0; k < 6; k++) {
            desc.block_count = wanted[k];
            CHECK(blocks_made(&map, &desc) == (wanted[k] < 72 ? wanted[k] : 72),
                  "%d blocks of 72 texels, case %d", wanted[k], i);
        }
    }
}

/* ---- random numbers of every kind ---- */

static int sample_is_sound(const envsamp_sample *s)
{
    const double x = (double)s->dir[0], y = (double)s->dir[1], z = (double)s->dir[2];

    return fabs(x * x + y * y + z * z - 1.0) < 1e-6 && s->pdf > 0.0f && s->pdf <= FLT_MAX
        && s->uv[0] >= 0.0f && s->uv[0] < 1.0f && s->uv[1] >= 0.0f && s->uv[1] <= 1.0f;
}

static void test_special_numbers(void)
{
    const float special[] = { 0.0f, 1.0f - FLT_EPSILON / 2, 1.0f, -1.0f, 2.0f, NAN, -NAN, INFINITY,
                              -INFINITY, FLT_MIN / 2, -FLT_MIN / 2, FLT_MAX, -FLT_MAX, -0.0f,
                              0.5f, 1e-10f, 4294967296.0f, 0x1p-13f };
    const int count = (int)(sizeof special / sizeof special[0]);
    const int blocks[] = { 1, 2, 777, 4096 };
    int b, kind, i, j;
    image map;
    envsamp_image view;

    map_make("sky", 128, 64, &map);
    view = kd_image(map.rgb, 128, 64, 3);
    for (b = 0; b < 4; b++)
        for (kind = 0; kind < 4; kind++) {
            envsamp_kd_desc desc = kd_desc(blocks[b], (envsamp_kd_select)(kind < 3 ? kind : 2));
            kd_fixture f;
            int unsound = 0;

            desc.model = kind == 3 ? ENVSAMP_KD_POWER : ENVSAMP_KD_LOG;
            kd_fixture_build(&f, &view, &desc);
            for (i = 0; f.kd && i < count; i++)
                for (j = 0; j < count; j++) {
                    const envsamp_sample s = envsamp_kd_sample(f.kd, special[i], special[j]);

                    unsound += !sample_is_sound(&s);
                }
            CHECK(f.kd && !unsound, "%d blocks, kind %d: all u give unit directions, but %d",
                  blocks[b], kind, unsound);
            kd_fixture_free(&f);
        }
    image_free(&map);
}

static void test_special_directions(envsamp_kd_select select)
{
    const float bad[][3] = { { 0, 0, 0 }, { NAN, 0, 1 }, { 0, NAN, 1 }, { 0, 0, NAN },
                             { NAN, NAN, NAN }, { INFINITY, 0, 0 }, { INFINITY, INFINITY, 0 },
                             { 0, 0, -INFINITY }, { FLT_MAX, FLT_MAX, FLT_MAX } };
    const float poles[][3] = { { 0, 0, 1 }, { 0, 0, -1 }, { -0.0f, -0.0f, 1 }, { 1, 0, 0 },
                               { 1, -0.0f, 0 }, { -1, 0, 0 }, { -1, -0.0f, 0 }, { 0, -1, 0 },
                               { 1, -1e-9f, 0 }, { 1e-20f, -1e-20f, 1 } };
    envsamp_kd_desc desc = kd_desc(300, select);
    image map;
    envsamp_image view;
    grid g;
    int i, misses = 0;

    map_make("foliage", 64, 32, &map);
    view = kd_image(map.rgb, 64, 32, 3);
    if (grid_build(&g, &view, &desc)) {
        for (i = 0; i < (int)(sizeof bad / sizeof bad[0]); i++)
            CHECK(envsamp_kd_pdf(g.f.kd, bad[i]) == 0.0f, "select %d: no direction %d has pdf 0",
                  (int)select, i);
        for (i = 0; i < (int)(sizeof poles / sizeof poles[0]); i++) {
            const float pdf = envsamp_kd_pdf(g.f.kd, poles[i]);

            misses += !(pdf > 0.0f);
            misses += poles[i][2] == 0.0f && !grid_accepts_direction(&g, poles[i]);
        }
    }
    CHECK(IS(misses, 0), "poles and axes are found, with zeros of both signs");
    grid_free(&g);
    image_free(&map);
}

/* Scaling by a power of two changes no bit; any other scale may move across an edge. */
static void test_unnormalised(envsamp_kd_select select)
{
    const float exact[] = { 0x1p-40f, 0x1p-7f, 2.0f, 1024.0f, 0x1p40f };
    const float rounded[] = { 3.0f, 1e-17f, 1e17f, 0.1f };
    envsamp_kd_desc desc = kd_desc(2000, select);
    pcg32 random = pcg32_make(17, 0);
    int i, k, c, different = 0, misses = 0;
    float dir[3], longer[3];
    image map;
    envsamp_image view;
    grid g;

    map_make("foliage", 256, 128, &map);
    view = kd_image(map.rgb, 256, 128, 3);
    CHECK(grid_build(&g, &view, &desc), "a table for directions of any length");
    for (i = 0; i < 5000; i++) {
        kd_random_direction(&random, dir);
        for (k = 0; k < 9; k++) {
            const float scale = k < 5 ? exact[k] : rounded[k - 5];

            for (c = 0; c < 3; c++)
                longer[c] = dir[c] * scale;
            if (k < 5)
                different += envsamp_kd_pdf(g.f.kd, longer) != envsamp_kd_pdf(g.f.kd, dir);
            else
                misses += !grid_accepts_direction(&g, longer);
        }
    }
    CHECK(!different, "length does not matter: %d differ", different);
    CHECK(!misses, "nor where it rounds: %d differ", misses);
    grid_free(&g);
    image_free(&map);
}

/* ---- all 2^24 draws ---- */

/* Returns how many samples are not in the block that is drawn, nor on its edge but for rounding. */
static int count_draws(const grid *g, uint32_t *counts)
{
    int i, strays = 0;

    for (i = 0; i < UNIT; i++) {
        envsamp_sample s;
        float u[2];
        int block;

        kd_alias_draw(g->f.kd, i, u);
        s = envsamp_kd_sample(g->f.kd, u[0], u[1]);
        block = inside_alias_block(g->f.kd, u[0], u[1]);
        strays += !(kd_outside(&g->rects[block], (double)s.uv[0], (double)s.uv[1]) <= EDGE);
        counts[block]++;
    }
    return strays;
}

/* Each block's float probability tells its whole number of draws, as long as that is below 2^22. */
static void test_every_draw(const char *name, int blocks)
{
    envsamp_kd_desc desc = kd_desc(blocks, ENVSAMP_KD_ALIAS);
    uint32_t *counts;
    image map;
    envsamp_image view;
    grid g;
    int i, strays, wrong = 0, fractions = 0, unreached = 0;

    map_make(name, 128, 64, &map);
    view = kd_image(map.rgb, 128, 64, 3);
    CHECK(grid_build(&g, &view, &desc), "%s, %d blocks for all draws", name, blocks);
    counts = (uint32_t *)kd_allocate((size_t)g.f.info.block_count * sizeof *counts);
    memset(counts, 0, (size_t)g.f.info.block_count * sizeof *counts);
    strays = count_draws(&g, counts);
    for (i = 0; i < g.f.info.block_count; i++) {
        const double draws = g.rects[i].probability * (double)UNIT;

        fractions += fabs(draws - floor(draws + 0.5)) > 0.4;
        wrong += (double)counts[i] != floor(draws + 0.5) && draws < 4194304.0;
        unreached += !counts[i];
    }
    CHECK(!fractions, "probabilities are multiples of 2^-24, but for %d", fractions);
    CHECK(!strays, "samples lie in the blocks that are drawn, but for %d", strays);
    CHECK(!wrong, "each block is drawn exactly as often as it claims, but for %d", wrong);
    CHECK(!unreached, "each block is drawn, but %d", unreached);
    free(counts);
    grid_free(&g);
    image_free(&map);
}

/* ---- mappings ---- */

static void test_uv_to_dir(envsamp_mapping mapping)
{
    const double range = mapping == ENVSAMP_LATLONG ? 1.0 : 0.5;
    double length = 0.0, error = 0.0, round_trip = 0.0;
    pcg32 random = pcg32_make(19, 0);
    int i, c;

    for (i = 0; i < 300000; i++) {
        const float u = pcg32_float(&random), v = i % 1001 ? pcg32_float(&random) : 0.0f;
        double squares = 0.0;
        float dir[3], expected[3], uv[2];

        envsamp_uv_to_dir(mapping, u, v, dir);
        kd_direction((double)u, range * (double)v, expected);
        for (c = 0; c < 3; c++) {
            squares += (double)dir[c] * (double)dir[c];
            worst(&error, fabs((double)dir[c] - (double)expected[c]));
        }
        worst(&length, fabs(sqrt(squares) - 1.0));
        envsamp_dir_to_uv(mapping, dir, uv);
        worst(&round_trip, fabs((double)uv[1] - (double)v) * range);
        if (v > 1e-6f && v < 1.0f - 1e-6f)
            worst(&round_trip, turn_distance((double)uv[0], (double)u));
    }
    CHECK(length <= 2e-7, "mapping %d: length is 1 within 2e-7: %.1e", (int)mapping, length);
    CHECK(error <= 2e-7, "mapping %d: direction is %.1e off", (int)mapping, error);
    CHECK(round_trip <= 5e-7, "mapping %d: there and back is %.1e off", (int)mapping, round_trip);
}

static void test_dir_to_uv(envsamp_mapping mapping)
{
    const double range = mapping == ENVSAMP_LATLONG ? 1.0 : 0.5;
    double error_u = 0.0, error_v = 0.0;
    pcg32 random = pcg32_make(23, 0);
    int i, outside = 0;

    for (i = 0; i < 300000; i++) {
        const float scale = i % 3 ? 1.0f : i % 2 ? 1e-15f : 1e15f, flat = i % 7 ? 1.0f : 1e-6f;
        float dir[3], uv[2];
        double u, v;

        kd_random_direction(&random, dir);
        dir[0] *= scale * flat;
        dir[1] *= scale * (i % 11 ? flat : 1e-9f);
        dir[2] *= scale;
        kd_point(dir, &u, &v);
        envsamp_dir_to_uv(mapping, dir, uv);
        worst(&error_u, turn_distance((double)uv[0], u));
        worst(&error_v, fabs((double)uv[1] - v / range));
        outside += !(uv[0] >= 0.0f && uv[0] < 1.0f && uv[1] >= 0.0f
                     && (double)uv[1] * range <= 1.0);
    }
    CHECK(error_u <= 3e-7, "mapping %d: u is within 3e-7: %.1e", (int)mapping, error_u);
    CHECK(error_v <= 3e-7, "mapping %d: v is within 3e-7: %.1e", (int)mapping, error_v);
    CHECK(!outside, "mapping %d: points lie in the map, but for %d", (int)mapping, outside);
}

static int uv_is(envsamp_mapping mapping, float x, float y, float z, float u, float v)
{
    const float dir[3] = { x, y, z };
    float uv[2];

    envsamp_dir_to_uv(mapping, dir, uv);
    return IS_NEAR(uv[0], u, 3e-7) && IS_NEAR(uv[1], v, 3e-7);
}

static int dir_is(float u, float v, float x, float y, float z)
{
    float dir[3];

    envsamp_uv_to_dir(ENVSAMP_LATLONG, u, v, dir);
    return IS_NEAR(dir[0], x, 5e-7) && IS_NEAR(dir[1], y, 5e-7) && IS_NEAR(dir[2], z, 5e-7);
}

static void test_mapping_points(void)
{
    const envsamp_mapping whole = ENVSAMP_LATLONG, half = ENVSAMP_HEMISPHERE;
    const float below = 1.0f - FLT_EPSILON / 2;
    float dir[3] = { 9, 9, 9 };

    CHECK(uv_is(whole, 0, 0, 1, 0, 0) && uv_is(whole, 0, 0, -1, 0, 1), "poles");
    CHECK(uv_is(whole, 0, 0, 0, 0, 0), "the zero vector is (0, 0)");
    CHECK(uv_is(whole, 1, 0, 0, 0, 0.5f) && uv_is(whole, 0, 1, 0, 0.25f, 0.5f)
          && uv_is(whole, -1, 0, 0, 0.5f, 0.5f) && uv_is(whole, 0, -1, 0, 0.75f, 0.5f), "axes");
    CHECK(uv_is(whole, 1, -0.0f, 0, 0, 0.5f), "the seam from below rounds to u = 0");
    CHECK(uv_is(whole, -1, -0.0f, 0, 0.5f, 0.5f), "half a turn with a negative zero");
    CHECK(uv_is(whole, 1, -1e-12f, 0, 0, 0.5f), "just before the seam u stays below 1");
    CHECK(uv_is(half, 1, 0, 0, 0, 1) && uv_is(half, 0, 0, 1, 0, 0), "hemisphere");
    CHECK(dir_is(0, 0, 0, 0, 1) && dir_is(0.3f, 1, 0, 0, -1), "directions of the poles");
    CHECK(dir_is(0, 0.5f, 1, 0, 0) && dir_is(1, 0.5f, 1, 0, 0) && dir_is(below, 0.5f, 1, 0, 0),
          "both sides of the seam");
    CHECK(dir_is(-0.75f, 0.5f, 0, 1, 0) && dir_is(3.25f, 0.5f, 0, 1, 0), "u wraps round");
    CHECK(dir_is(0, -2, 0, 0, 1) && dir_is(0, 5, 0, 0, -1), "v is clamped");
    CHECK(dir_is(NAN, 0.5f, 1, 0, 0) && dir_is(0, NAN, 0, 0, 1), "NaN counts as 0");
    CHECK(dir_is(0, INFINITY, 0, 0, -1) && dir_is(0, -INFINITY, 0, 0, 1), "infinite v");
    envsamp_uv_to_dir((envsamp_mapping)77, 0.2f, 0.2f, dir);
    CHECK(IS(dir[0], 0.0f) && IS(dir[1], 0.0f) && IS(dir[2], 0.0f), "unknown mappings give zero");
}

/* ---- lookup ---- */

/* Where texel (x, y) of a 4x2 map has the value 1, 2, 4 .. 128, red; green is twice that. */
static float lookup(int bilinear, double u, double v)
{
    static float pixels[8][3];
    envsamp_image map = kd_image(&pixels[0][0], 4, 2, 3);
    float dir[3], rgb[3];
    int i;

    for (i = 0; i < 8; i++) {
        pixels[i][0] = (float)(1 << i);
        pixels[i][1] = (float)(2 << i);
        pixels[i][2] = -1.0f;
    }
    kd_direction(u, v, dir);
    envsamp_lookup(&map, !bilinear, dir, rgb);
    return rgb[2] == 0.0f && fabsf(rgb[1] - 2.0f * rgb[0]) < 1e-3f ? rgb[0] : -1.0f;
}

static int lookup_is(int bilinear, double u, double v, double expected)
{
    return IS_NEAR(lookup(bilinear, u, v), expected, 1e-5 * (expected + 16.0));
}

static void test_lookup(void)
{
    int x, y, nearest = 0, centres = 0;

    for (y = 0; y < 2; y++)
        for (x = 0; x < 4; x++) {
            const double u = ((double)x + 0.5) / 4.0, v = ((double)y + 0.5) / 2.0;
            const double value = (double)(1 << (4 * y + x));

            nearest += lookup_is(0, u, v, value) && lookup_is(0, u + 0.12, v - 0.24, value)
                    && lookup_is(0, u - 0.12, v + 0.24, value);
            centres += lookup_is(1, u, v, value);
        }
    CHECK(nearest == 8, "the nearest texel, all over it: %d of 8", nearest);
    CHECK(centres == 8, "bilinear is the texel in its centre: %d of 8", centres);
    CHECK(lookup_is(1, 0.25, 0.25, 1.5), "halfway between columns");
    CHECK(lookup_is(1, 0.125, 0.5, 8.5), "halfway between rows");
    CHECK(lookup_is(1, 0.3125, 0.375, 0.75 * (0.25 * 1 + 0.75 * 2)
                                      + 0.25 * (0.25 * 16 + 0.75 * 32)),
          "a point between four texels");
    CHECK(lookup_is(1, 0.0, 0.25, 4.5), "across the seam");
    CHECK(lookup_is(1, 1.0 - 0.03125, 0.25, 0.625 * 8 + 0.375 * 1), "left of the seam");
    CHECK(lookup_is(1, 0.03125, 0.75, 0.625 * 16 + 0.375 * 128), "right of the seam");
    CHECK(lookup_is(1, 0.0, 0.0, 3.75), "the upper pole is the mean of its row");
    CHECK(lookup_is(1, 0.125, 0.125, 0.75 * 1 + 0.25 * 4), "over the upper pole");
    CHECK(lookup_is(1, 0.375, 0.9375, 0.625 * 32 + 0.375 * 128), "over the lower pole");
    CHECK(lookup_is(0, 0.0, 0.0, 1.0) || lookup_is(0, 0.0, 0.0, 2.0), "nearest at the pole");
}

static void test_lookup_values(void)
{
    float pixels[] = { NAN, 3.0f, 5.0f, INFINITY, -4.0f, 2.0f };
    envsamp_image one = kd_image(pixels + 1, 1, 1, 1), rgb_map = kd_image(pixels, 2, 1, 3);
    const float across[3] = { 0, 1, 0 }, back[3] = { 0, -1, 0 }, zero[3] = { 0, 0, 0 };
    const float none[3] = { NAN, NAN, NAN };
    float rgb[3];

    envsamp_lookup(&one, 0, across, rgb);
    CHECK(IS(rgb[0], 3.0f) && IS(rgb[1], 3.0f) && IS(rgb[2], 3.0f), "one channel gives three, 1x1");
    envsamp_lookup(&one, 1, zero, rgb);
    CHECK(IS(rgb[0], 3.0f), "the zero vector looks up");
    envsamp_lookup(&one, 0, none, rgb);
    CHECK(rgb[0] >= 0.0f && rgb[0] <= 3.01f, "NaN stays in the map");
    envsamp_lookup(&rgb_map, 1, across, rgb);
    CHECK(IS(rgb[0], 0.0f) && IS(rgb[1], 0.0f) && IS(rgb[2], 0.0f), "NaN makes a pixel black");
    pixels[3] = 7.0f;
    envsamp_lookup(&rgb_map, 1, back, rgb);
    CHECK(IS(rgb[0], 7.0f) && IS(rgb[1], 0.0f) && IS(rgb[2], 2.0f),
          "a negative channel counts as 0");
}

/* ---- small things ---- */

static int near(float a, float b)
{
    return IS_NEAR(a, b, 1e-6 * fabs((double)b));
}

static void test_mis_power(void)
{
    const float inf = INFINITY;

    CHECK(near(envsamp_mis_power(1, 1), 0.5f) && near(envsamp_mis_power(3, 1), 0.9f)
          && near(envsamp_mis_power(1, 3), 0.1f), "squares over the sum of squares");
    CHECK(IS(envsamp_mis_power(0, 0), 0.0f) && IS(envsamp_mis_power(0, 5), 0.0f)
          && IS(envsamp_mis_power(5, 0), 1.0f), "zeros");
    CHECK(IS(envsamp_mis_power(inf, 1), 1.0f) && IS(envsamp_mis_power(1, inf), 0.0f)
          && IS(envsamp_mis_power(inf, inf), 0.5f) && IS(envsamp_mis_power(0, inf), 0.0f),
          "infinities");
    CHECK(near(envsamp_mis_power(3e30f, 1e30f), 0.9f)
          && near(envsamp_mis_power(FLT_MAX, FLT_MAX), 0.5f), "squares that overflow");
    CHECK(near(envsamp_mis_power(3e-30f, 1e-30f), 0.9f), "squares that vanish");
    CHECK(IS(envsamp_mis_power(FLT_MAX, 1e-30f), 1.0f)
          && IS(envsamp_mis_power(1e-30f, FLT_MAX), 0.0f),
          "far apart");
}

static void test_small_functions(void)
{
    const float red[3] = { 1, 0, 0 }, green[3] = { 0, 1, 0 }, blue[3] = { 0, 0, 1 };
    const envsamp_kd_desc desc = envsamp_kd_defaults();
    static const char *const subject[] = { "error", "pointer", "width", "description", "pixel",
                                           "importance", "buffer", "aligned", "table" };
    int i, missing = 0, strange = 0;

    CHECK(near(envsamp_luminance(red), 0.2126f) && near(envsamp_luminance(green), 0.7152f)
          && near(envsamp_luminance(blue), 0.0722f), "Rec. 709 luminance");
    for (i = -2; i < 40; i++) {
        const char *words = envsamp_result_string((envsamp_result)i);

        missing += !words || !words[0];
    }
    for (i = ENVSAMP_OK; i <= ENVSAMP_ERR_FORMAT; i++)
        strange += !strstr(envsamp_result_string((envsamp_result)i), subject[i]);
    CHECK(IS(missing, 0), "every result has words");
    CHECK(IS(strange, 0) && IS(ENVSAMP_ERR_FORMAT, 8), "that name what is wrong");
    CHECK(IS(desc.block_count, 6144) && IS(desc.mis_compensation, 0.0f) && !desc.strict,
          "defaults");
}

static void test_null_description(void)
{
    const float dir[3] = { 0.36f, 0.48f, 0.8f };
    envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_sizes sizes;
    image map;
    envsamp_image view;
    kd_fixture f;
    const envsamp_kd *kd = NULL;
    float u[2] = { 7, 7 };

    map_make("studio", 64, 32, &map);
    view = kd_image(map.rgb, 64, 32, 3);
    kd_fixture_build(&f, &view, &desc);
    CHECK(IS(envsamp_kd_sizes(&view, NULL, &sizes), ENVSAMP_OK)
          && kd_bits_equal(&sizes, &f.sizes, sizeof sizes), "no description: sizes of defaults");
    view.pixels = NULL;
    CHECK(IS(envsamp_kd_sizes(&view, NULL, &sizes), ENVSAMP_OK), "sizes need no pixels");
    view.pixels = map.rgb;
    CHECK(f.kd && IS(envsamp_kd_invert(f.kd, dir, u), 1), "WARP, the default, inverts");
    memset(f.table.buffer.data, 0, f.table.buffer.bytes);
    CHECK(IS(envsamp_kd_build(&view, NULL, f.table.buffer, f.scratch.buffer, &kd), ENVSAMP_OK)
          && kd && envsamp_kd_pdf(kd, dir) > 0.0f, "no description: a table of defaults");
    kd_fixture_free(&f);
    image_free(&map);
}

int main(void)
{
    int select;

    test_options();
    test_default_size();
    test_tall_map();
    test_flat_map();
    test_constant_integral();
    test_block_counts();
    test_special_numbers();
    for (select = 0; select < 3; select++) {
        test_special_directions((envsamp_kd_select)select);
        test_unnormalised((envsamp_kd_select)select);
    }
    test_every_draw("studio", 300);
    test_every_draw("foliage", 512);
    test_every_draw("night", 1023);
    test_uv_to_dir(ENVSAMP_LATLONG);
    test_uv_to_dir(ENVSAMP_HEMISPHERE);
    test_dir_to_uv(ENVSAMP_LATLONG);
    test_dir_to_uv(ENVSAMP_HEMISPHERE);
    test_mapping_points();
    test_lookup();
    test_lookup_values();
    test_mis_power();
    test_small_functions();
    test_null_description();
    return check_done();
}
