/* test_kd_statistics.c: samples of kd tables against the densities that they claim, counted over
 * cells of the map, by integrals of known functions, and by where they fall inside blocks; each
 * kind of test beside faults that it must reject.
 */
#include "check.h"

#include "../envsamp.h"

#include "kd_reference.h"
#include "statistics.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"

static const char *const select_names[] = { "WARP", "ALIAS", "FIT", "POWER" };

#define POWER ((envsamp_kd_select)3)    /* FIT, with this model */

#define SAMPLES (1 << 20)
#define EDGE 5e-7               /* of u and v: how near an edge a float direction is ambiguous */

static int build(reference *r, const image *map, int blocks, envsamp_kd_select select)
{
    envsamp_kd_desc desc = kd_desc(blocks, select == POWER ? ENVSAMP_KD_FIT : select);
    int built;

    desc.model = select == POWER ? ENVSAMP_KD_POWER : ENVSAMP_KD_LOG;
    built = reference_build(r, map, &desc);
    if (!built)
        CHECK(0, "a table of %d blocks builds: %s", blocks, envsamp_result_string(r->f.result));
    return built;
}

/* ---- cells of the map ---- */

typedef struct cells {
    int columns, rows;
    double *expected, *hits;
} cells;

static cells cells_make(int columns, int rows)
{
    const size_t count = (size_t)columns * (size_t)rows;
    cells c;

    c.columns = columns;
    c.rows = rows;
    c.expected = (double *)kd_allocate(count * sizeof *c.expected);
    c.hits = (double *)kd_allocate(count * sizeof *c.hits);
    return c;
}

static void cells_free(cells *c)
{
    free(c->expected);
    free(c->hits);
}

/* Height of a zone of the sphere in cos theta, or, for the fault, in v. */
static double zone(double v0, double v1, int by_area)
{
    return by_area ? v1 - v0 : 2.0 * sin(0.5 * KD_PI * (v0 + v1)) * sin(0.5 * KD_PI * (v1 - v0));
}

static double overlap_u(const kd_rect *rect, const cells *c, int column)
{
    const double low = fmax(rect->u0, (double)column / (double)c->columns);
    const double high = fmin(rect->u1, (double)(column + 1) / (double)c->columns);

    return high > low ? (high - low) / (rect->u1 - rect->u0) : 0.0;
}

static double overlap_v(const kd_rect *rect, const cells *c, int row, int by_area)
{
    const double low = fmax(rect->v0, (double)row / (double)c->rows);
    const double high = fmin(rect->v1, (double)(row + 1) / (double)c->rows);

    return high > low ? zone(low, high, by_area) / zone(rect->v0, rect->v1, by_area) : 0.0;
}

/* Shares a block's probability among the cells that it reaches. */
static void expect_block(const kd_rect *rect, int by_area, cells *c)
{
    int x, y;

    for (y = (int)(rect->v0 * (double)c->rows); y < c->rows; y++) {
        const double part = overlap_v(rect, c, y, by_area) * rect->probability;

        if ((double)y >= rect->v1 * (double)c->rows)
            break;
        for (x = (int)(rect->u0 * (double)c->columns); x < c->columns; x++) {
            if ((double)x >= rect->u1 * (double)c->columns)
                break;
            c->expected[y * c->columns + x] += part * overlap_u(rect, c, x);
        }
    }
}

static void expect_blocks(const reference *r, int by_area, cells *c)
{
    int i;

    for (i = 0; i < r->f.info.block_count; i++)
        expect_block(&r->rects[i], by_area, c);
}

/* One cell a texel: luminance times solid angle, or, for the fault, times area. */
static void expect_texels(const reference *r, int by_area, cells *c)
{
    const double height = (double)c->rows;
    int x, y;

    for (y = 0; y < c->rows; y++)
        for (x = 0; x < c->columns; x++)
            c->expected[y * c->columns + x] = kd_texel(&r->f.image, x, y)
                * zone((double)y / height, (double)(y + 1) / height, by_area);
}

/* What may be wrong with samples. */
typedef enum fault { HONEST = 0, HALF_TEXEL, SWAPPED, TURNED } fault;

static void spoil(const reference *r, fault kind, double *u, double *v)
{
    const double keep = *u;

    if (kind == HALF_TEXEL)
        *u += 0.5 / (double)r->f.image.width;
    if (kind == TURNED)
        *u += 10.0 / 360.0;
    *u -= floor(*u);
    if (kind == SWAPPED) {
        *u = *v < 1.0 ? *v : 0.0;
        *v = keep;
    }
}

static void cells_hit(cells *c, double u, double v)
{
    int x = (int)(u * (double)c->columns), y = (int)(v * (double)c->rows);

    x = x < c->columns ? x : c->columns - 1;
    y = y < c->rows ? y : c->rows - 1;
    c->hits[y * c->columns + x] += 1.0;
}

static void cells_sample(const reference *r, int count, uint64_t seed, fault kind, cells *c)
{
    pcg32 random = pcg32_make(seed, 1);
    int i;

    for (i = 0; i < count; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(r->f.kd, u0, u1);
        double u, v;

        kd_point(s.dir, &u, &v);
        spoil(r, kind, &u, &v);
        cells_hit(c, u, v);
    }
}

static stat_result cells_test(const cells *c)
{
    return stat_chi2_test(c->expected, c->hits, (size_t)c->columns * (size_t)c->rows, NULL);
}

/* ---- samples against the density of the blocks ---- */

static void test_blocks(const char *name, int blocks, envsamp_kd_select select)
{
    const char *kind = select_names[select];
    cells c = cells_make(64, 32);
    stat_result result;
    reference r;
    image map;

    map_make(name, 256, 128, &map);
    if (build(&r, &map, blocks, select)) {
        expect_blocks(&r, 0, &c);
        cells_sample(&r, 2 * SAMPLES, 11, HONEST, &c);
        result = cells_test(&c);
        CHECK(result.pass, "%s, %s, %d blocks: %s, p = %.3g, %d cells, %.3f pooled", name, kind,
              r.f.info.block_count, stat_verdict_string(result.verdict), result.p,
              (int)result.cells, result.pooled_mass);
    }
    reference_free(&r);
    image_free(&map);
    cells_free(&c);
}

static void test_all_blocks(void)
{
    static const char *const names[] = { "sky", "studio", "night", "foliage" };
    const int counts[] = { 100, 6144, 32768 };
    int i, k;

    for (i = 0; i < 4; i++)
        for (k = 0; k < 3; k++) {
            test_blocks(names[i], counts[k], ENVSAMP_KD_ALIAS);
            test_blocks(names[i], counts[k], ENVSAMP_KD_FIT);
            if (k < 2)
                test_blocks(names[i], counts[k], POWER);
            test_blocks(names[i], counts[k], ENVSAMP_KD_WARP);
        }
}

/* ---- samples against the map itself ---- */

/* With as many blocks as texels, ALIAS draws texels by luminance times solid angle. */
static void test_texels(const char *name, int width, int height)
{
    cells c = cells_make(width, height);
    stat_result result;
    reference r;
    image map;

    map_make(name, width, height, &map);
    if (build(&r, &map, width * height, ENVSAMP_KD_ALIAS)) {
        expect_texels(&r, 0, &c);
        cells_sample(&r, 2 * SAMPLES, 12, HONEST, &c);
        result = cells_test(&c);
        CHECK(result.pass, "%s, %dx%d texels: %s, p = %.3g, %d cells", name, width, height,
              stat_verdict_string(result.verdict), result.p, (int)result.cells);
    }
    reference_free(&r);
    image_free(&map);
    cells_free(&c);
}

/* Counts the parts of texels that samples lie in. */
static void parts_sample(const reference *r, int count, cells *c)
{
    pcg32 random = pcg32_make(23, 1);
    int i, k;

    for (i = 0; i < count; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(r->f.kd, u0, u1);
        int texel, block;
        double u, v;

        kd_point(s.dir, &u, &v);
        texel = kd_cover_texel(&r->cover, u, v);
        block = kd_cover_owner(&r->cover, u, v);
        for (k = r->cover.first[texel]; k < r->cover.first[texel + 1]; k++)
            c->hits[k] += r->cover.pieces[k].block == block ? 1.0 : 0.0;
    }
}

/* Blocks of WARP hold parts of texels: block by texel is a cell of its own, of which the share of
   the block's solid angle, by sums over the map, is what its samples must keep to. */
static void test_parts(const char *name, int width, int height, int blocks)
{
    stat_result result;
    reference r;
    image map;
    cells c;
    int t, k, pieces;

    map_make(name, width, height, &map);
    if (!build(&r, &map, blocks, ENVSAMP_KD_WARP))
        return;
    pieces = r.cover.first[width * height];
    c = cells_make(pieces, 1);
    for (t = 0; t < width * height; t++)
        for (k = r.cover.first[t]; k < r.cover.first[t + 1]; k++) {
            const kd_rect *rect = &r.rects[r.cover.pieces[k].block];

            c.expected[k] = rect->probability * r.cover.pieces[k].share / rect->solid_angle
                          * kd_solid_angle(width, height, 0, t / width, 1, t / width + 1);
        }
    parts_sample(&r, 4 * SAMPLES, &c);
    result = cells_test(&c);
    CHECK(result.pass, "%s, WARP, %dx%d, %d blocks, %d parts of texels: %s, p = %.3g", name, width,
          height, r.f.info.block_count, pieces, stat_verdict_string(result.verdict), result.p);
    cells_free(&c);
    reference_free(&r);
    image_free(&map);
}

/* ---- faults that the tests above must see ---- */

static void must_reject(const char *what, const cells *c)
{
    const stat_result result = cells_test(c);

    CHECK(result.verdict == STAT_REJECTED || result.verdict == STAT_ZERO_CELL_HIT,
          "rejected: %s, %s, chi2 %.0f of %.0f", what, stat_verdict_string(result.verdict),
          result.chi2, result.dof);
}

static void control_samples(const reference *r, const char *what, fault kind)
{
    cells c = cells_make(64, 32);

    expect_texels(r, 0, &c);
    cells_sample(r, SAMPLES, 13, kind, &c);
    must_reject(what, &c);
    cells_free(&c);
}

/* Solid angle left out of the importance, and of the density inside of blocks. */
static void control_sine(const reference *r, const reference *coarse)
{
    cells c = cells_make(64, 32);

    expect_texels(r, 1, &c);
    cells_sample(r, SAMPLES, 14, HONEST, &c);
    must_reject("texels by area", &c);
    cells_free(&c);
    c = cells_make(64, 32);
    expect_blocks(coarse, 1, &c);
    cells_sample(coarse, SAMPLES, 15, HONEST, &c);
    must_reject("samples in blocks by area", &c);
    cells_free(&c);
}

static int heaviest(const cells *c)
{
    int best = 0, i;

    for (i = 1; i < c->columns * c->rows; i++)
        best = c->expected[i] > c->expected[best] ? i : best;
    return best;
}

static void control_cell(const reference *r)
{
    cells c = cells_make(8, 4);
    stat_result result;

    expect_blocks(r, 0, &c);
    cells_sample(r, 4 * SAMPLES, 16, HONEST, &c);
    result = cells_test(&c);
    CHECK(result.pass, "32 large cells: p = %.3g", result.p);
    c.expected[heaviest(&c)] *= 1.02;
    must_reject("2 % more in one cell", &c);
    cells_free(&c);
}

/* Masses as differences of a running float sum over the texels. */
static void expect_float_sums(const reference *r, cells *c)
{
    const int width = r->f.image.width, height = r->f.image.height;
    float running = 0.0f;
    int x, y;

    for (y = 0; y < height; y++) {
        const double sr = kd_solid_angle(width, height, 0, y, 1, y + 1);

        for (x = 0; x < width; x++) {
            const float before = running;

            running += (float)(kd_texel(&r->f.image, x, y) * sr);
            c->expected[y * c->rows / height * c->columns + x * c->columns / width]
                += (double)running - (double)before;
        }
    }
}

static void control_float_sums(void)
{
    cells c = cells_make(2, 128), rounded = cells_make(2, 128);
    stat_result result;
    reference r;
    image map;

    map_make("constant", 2048, 1024, &map);
    if (build(&r, &map, 6144, ENVSAMP_KD_ALIAS)) {
        expect_blocks(&r, 0, &c);
        cells_sample(&r, SAMPLES, 17, HONEST, &c);
        result = cells_test(&c);
        CHECK(result.pass, "a large map: p = %.3g", result.p);
        expect_float_sums(&r, &rounded);
        memcpy(rounded.hits, c.hits, 2 * 128 * sizeof *c.hits);
        must_reject("float sums", &rounded);
    }
    reference_free(&r);
    image_free(&map);
    cells_free(&c);
    cells_free(&rounded);
}

/* Faults in samples of WARP: the cells expect what its blocks claim, with nothing from the table's
   own densities. */
static void test_warp_controls(void)
{
    static const char *const what[] = { "", "WARP: half a texel in u", "WARP: u and v swapped",
                                        "WARP: a map turned by 10 degrees" };
    cells c;
    reference r;
    image map;
    int kind;

    map_make("foliage", 64, 32, &map);
    if (build(&r, &map, 64 * 32, ENVSAMP_KD_WARP)) {
        for (kind = HALF_TEXEL; kind <= TURNED; kind++) {
            c = cells_make(64, 32);
            expect_blocks(&r, 0, &c);
            cells_sample(&r, SAMPLES, 18, (fault)kind, &c);
            must_reject(what[kind], &c);
            cells_free(&c);
        }
        c = cells_make(64, 32);
        expect_blocks(&r, 1, &c);
        cells_sample(&r, SAMPLES, 19, HONEST, &c);
        must_reject("WARP: samples in blocks by area", &c);
        cells_free(&c);
        control_cell(&r);
    }
    reference_free(&r);
    image_free(&map);
}

static void test_controls(void)
{
    reference r, coarse;
    image map;

    map_make("foliage", 64, 32, &map);
    if (build(&r, &map, 64 * 32, ENVSAMP_KD_ALIAS)) {
        control_samples(&r, "half a texel in u", HALF_TEXEL);
        control_samples(&r, "u and v swapped", SWAPPED);
        control_samples(&r, "a map turned by 10 degrees", TURNED);
        control_cell(&r);
    }
    if (build(&coarse, &map, 64, ENVSAMP_KD_ALIAS))
        control_sine(&r, &coarse);
    reference_free(&r);
    reference_free(&coarse);
    image_free(&map);
    control_float_sums();
    test_warp_controls();
}

/* ---- nothing is drawn where the map is black ---- */

/* Whether all texels about a point are black. */
static int in_the_dark(const reference *r, double u, double v)
{
    const double width = (double)r->f.image.width, height = (double)r->f.image.height;
    int i, dark = 1;

    for (i = 0; i < 9; i++) {
        double at = u + EDGE * (double)(i % 3 - 1), down = v + EDGE * (double)(i / 3 - 1);
        int x = (int)((at - floor(at)) * width), y = (int)(fmax(down, 0.0) * height);

        x = x < r->f.image.width ? x : 0;
        y = y < r->f.image.height ? y : r->f.image.height - 1;
        dark &= kd_texel(&r->f.image, x, y) <= 0.0;
    }
    return dark;
}

static long samples_in_the_dark(const reference *r)
{
    pcg32 random = pcg32_make(21, 0);
    long dark = 0;
    int i;

    for (i = 0; i < SAMPLES; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(r->f.kd, u0, u1);
        double u, v;

        kd_point(s.dir, &u, &v);
        dark += in_the_dark(r, u, v) || !(s.pdf > 0.0f);
    }
    return dark;
}

/* A map of which scattered texels, the lower pole and a quarter are black. WARP's tiles cut texels,
   so that it has no blocks for as many lit and black ones: there few are scattered, and the lit
   ones are even. */
static void test_dark(envsamp_kd_select select)
{
    const int warp = select == ENVSAMP_KD_WARP;
    pcg32 random = pcg32_make(22, 0);
    reference r;
    image map;
    int i, c;

    map_make(warp ? "constant" : "foliage", 64, 32, &map);
    for (i = 0; i < 64 * 32; i++)
        if (pcg32_float(&random) < (warp ? 0.02f : 0.3f) || i >= 64 * 30
            || (i % 64 > 15 && i % 64 < 32))
            for (c = 0; c < 3; c++)
                map.rgb[3 * i + c] = 0.0f;
    if (build(&r, &map, 64 * 32, select)) {
        const long dark = samples_in_the_dark(&r);

        CHECK(!dark, "select %d: no sample where the map is black, but %ld", (int)select, dark);
    }
    reference_free(&r);
    image_free(&map);
}

/* ---- where samples fall inside of their blocks ---- */

#define BINS 32

typedef struct position { double fx, fy; int block; } position;

/* From sample.uv which block, from the direction where in it, both 0..1, uniform in solid angle. */
static position position_of(const reference *r, const envsamp_sample *s)
{
    const kd_rect *rect;
    position p;
    double u, v;

    p.block = reference_owner(r, (double)s->uv[0], (double)s->uv[1]);
    rect = &r->rects[p.block];
    kd_point(s->dir, &u, &v);
    u += (double)s->uv[0] - u > 0.5 ? 1.0 : 0.0;
    u -= u - (double)s->uv[0] > 0.5 ? 1.0 : 0.0;
    p.fx = (u - rect->u0) / (rect->u1 - rect->u0);
    p.fy = zone(rect->v0, v, 0) / zone(rect->v0, rect->v1, 0);
    p.fx = fmin(fmax(p.fx, 0.0), 1.0);
    p.fy = fmin(fmax(p.fy, 0.0), 1.0);
    return p;
}

static cells position_cells(void)
{
    cells c = cells_make(BINS, BINS);
    int i;

    for (i = 0; i < BINS * BINS; i++)
        c.expected[i] = 1.0;
    return c;
}

static void position_report(const char *what, const cells *c)
{
    const stat_result result = cells_test(c);

    CHECK(result.pass, "uniform in %s: %s, p = %.3g", what, stat_verdict_string(result.verdict),
          result.p);
}

static void test_positions(const char *name, int blocks, envsamp_kd_select select)
{
    pcg32 random = pcg32_make(31, 0);
    cells c = position_cells(), first = position_cells();
    char what[32];
    reference r;
    image map;
    int i;

    map_make(name, 256, 128, &map);
    if (!build(&r, &map, blocks, select))
        return;
    for (i = 0; i < 2 * SAMPLES; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(r.f.kd, u0, u1);
        const position p = position_of(&r, &s);

        cells_hit(&c, p.fx, p.fy);
        if (p.block == 0)
            cells_hit(&first, p.fx, p.fy);
    }
    snprintf(what, sizeof what, "%s blocks", select_names[select]);
    position_report(what, &c);
    if (select == ENVSAMP_KD_FIT) {
        CHECK(r.f.info.alpha < 1.0, "%s: alpha is %.3g", name, r.f.info.alpha);
        position_report("FIT's first block, drawn most", &first);
    }
    reference_free(&r);
    image_free(&map);
    cells_free(&c);
    cells_free(&first);
}

/* The draws of blocks which at most `most` of all draw. */
static int rare_draws(const reference *r, double most, int *draws, int room)
{
    int count = 0, i;

    for (i = 0; i < 1 << 24 && count < room; i++) {
        envsamp_sample s;
        int block;
        float u[2];

        kd_alias_draw(r->f.kd, i, u);
        s = envsamp_kd_sample(r->f.kd, u[0], u[1]);
        block = reference_owner(r, (double)s.uv[0], (double)s.uv[1]);
        if (r->rects[block].probability * 16777216.0 < most + 0.5)
            draws[count++] = i;
    }
    return count;
}

/* Blocks of one, or a few, of the 2^24 draws: what places a sample is left of u0, and of u1 the
   lowest bits. */
static void test_rare_blocks(double most)
{
    pcg32 random = pcg32_make(32, 0);
    cells c = position_cells();
    int *draws = (int *)kd_allocate(65536 * sizeof *draws), count = 0, i;
    reference r;
    image map;

    map_make("sky", 512, 256, &map);
    if (build(&r, &map, 131072, ENVSAMP_KD_ALIAS))
        count = rare_draws(&r, most, draws, 65536);
    CHECK(count >= 100, "%d of all draws are of blocks with at most %.0f", count, most);
    for (i = 0; count && i < SAMPLES; i++) {
        const int draw = draws[pcg32_next(&random) % (uint32_t)count];
        const float right = pcg32_float(&random), down = pcg32_float(&random);
        envsamp_sample s;
        position p;
        float u[2], next[2];

        kd_alias_draw(r.f.kd, draw, u);
        kd_alias_draw(r.f.kd, 1 << (12 + (int)KD_WORD(r.f.kd, alias_shift) / 2) | 1, next);
        s = envsamp_kd_sample(r.f.kd, u[0] + right * next[0], u[1] + down * next[1]);
        p = position_of(&r, &s);
        cells_hit(&c, p.fx, p.fy);
    }
    position_report("blocks of few draws", &c);
    reference_free(&r);
    image_free(&map);
    cells_free(&c);
    free(draws);
}

/* ---- integrals of known functions ---- */

typedef enum integrand { ONE = 0, LOBE, RADIANCE, WAVES, INTEGRANDS } integrand;

static const char *integrand_name(integrand kind)
{
    static const char *const names[INTEGRANDS] = { "1", "cos^2 lobe", "L", "waves" };

    return names[kind];
}

static double cosine_to_axis(const float dir[3])
{
    return (2.0 * (double)dir[0] - (double)dir[1] + 2.0 * (double)dir[2]) / 3.0;
}

static double evaluate(const reference *r, integrand kind, const float dir[3])
{
    const double cosine = cosine_to_axis(dir);
    double u, v;
    int x, y;

    if (kind == ONE)
        return 1.0;
    if (kind == LOBE)
        return cosine > 0.0 ? cosine * cosine : 0.0;
    kd_point(dir, &u, &v);
    if (kind == WAVES)
        return 1.0 + 0.9 * sin(14.0 * KD_PI * u);
    x = (int)(u * (double)r->f.image.width);
    y = (int)(v * (double)r->f.image.height);
    x = x < r->f.image.width ? x : 0;
    y = y < r->f.image.height ? y : r->f.image.height - 1;
    return kd_texel(&r->f.image, x, y);
}

static double known_integral(const reference *r, integrand kind)
{
    switch (kind) {
    case LOBE: return 2.0 * KD_PI / 3.0;
    case RADIANCE: return r->integral;
    default: return 4.0 * KD_PI;
    }
}

/* f/pdf over random u0, and over random or regular u1. */
static stat_moments estimate(const reference *r, integrand kind, int count, int lattice,
                             uint64_t seed)
{
    pcg32 random = pcg32_make(seed, 4);
    stat_moments moments = { 0.0, 0.0, 0.0 };
    int i;

    for (i = 0; i < count; i++) {
        const float u0 = pcg32_float(&random);
        const float u1 = lattice ? ((float)(i % 64) + 0.5f) / 64.0f : pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(r->f.kd, u0, u1);

        stat_moments_add(&moments, evaluate(r, kind, s.dir) / (double)s.pdf);
    }
    return moments;
}

/* A regular u1 integrates each block by the midpoint rule, whose own error is forgiven. */
static void test_integrals(const char *name, int blocks, envsamp_kd_select select, int lattice)
{
    const double forgiven = lattice ? 2e-4 : 1e-6;
    reference r;
    image map;
    int i;

    map_make(name, 256, 128, &map);
    if (!build(&r, &map, blocks, select))
        return;
    for (i = 0; i < INTEGRANDS; i++) {
        const double known = known_integral(&r, (integrand)i);
        const stat_moments m = estimate(&r, (integrand)i, SAMPLES, lattice, 41 + (uint64_t)i);
        const double p = stat_mean_test(&m, known, forgiven * known);

        CHECK(p >= STAT_ALPHA, "%s, %s%s: integral of %s is %.5f of what it should be, p = %.3g",
              name, select_names[select],
              lattice ? ", regular u1" : "", integrand_name((integrand)i), m.mean / known, p);
    }
    reference_free(&r);
    image_free(&map);
}

/* An estimator with a pdf from before a turn of the map must fail. */
static void test_integral_control(void)
{
    stat_moments moments = { 0.0, 0.0, 0.0 };
    pcg32 random = pcg32_make(51, 0);
    reference r;
    image map;
    int i;

    map_make("foliage", 256, 128, &map);
    if (!build(&r, &map, 6144, ENVSAMP_KD_ALIAS))
        return;
    for (i = 0; i < SAMPLES; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(r.f.kd, u0, u1);
        float turned[3];

        envsamp_uv_to_dir(ENVSAMP_LATLONG, s.uv[0] + 10.0f / 360.0f, s.uv[1], turned);
        stat_moments_add(&moments, evaluate(&r, LOBE, turned)
                                   / (double)envsamp_kd_pdf(r.f.kd, turned));
    }
    CHECK(stat_mean_test(&moments, known_integral(&r, LOBE), 0.0) < STAT_ALPHA,
          "rejected: an integral with the pdf of another direction, %.4f of what it should be",
          moments.mean / known_integral(&r, LOBE));
    reference_free(&r);
    image_free(&map);
}

/* ---- variance ---- */

/* The mean of (L/pdf)^2 is integral^2 (1 + excess_variance). */
static void test_variance(const char *name, int blocks, envsamp_kd_select select)
{
    stat_moments moments = { 0.0, 0.0, 0.0 };
    pcg32 random = pcg32_make(61, 0);
    reference r;
    image map;
    double p;
    int i;

    map_make(name, 256, 128, &map);
    if (!build(&r, &map, blocks, select))
        return;
    for (i = 0; i < SAMPLES; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(r.f.kd, u0, u1);
        const double ratio = evaluate(&r, RADIANCE, s.dir) / (double)s.pdf / r.integral;

        stat_moments_add(&moments, ratio * ratio);
    }
    p = stat_mean_test(&moments, 1.0 + r.f.info.excess_variance, 1e-6);
    CHECK(p >= STAT_ALPHA, "%s, %s, %d blocks: variance %.5f is as told, %.5f, p = %.3g", name,
          select_names[select], r.f.info.block_count, moments.mean - 1.0,
          r.f.info.excess_variance, p);
    reference_free(&r);
    image_free(&map);
}

/* ---- two samplers together ---- */

/* One sample of each of two tables, weighted by the power heuristic; `blind` scales the density
   of the other table, which is a fault unless it is 1. */
static stat_moments estimate_both(const reference *a, const reference *b, integrand kind,
                                  float blind)
{
    pcg32 random = pcg32_make(71, 0);
    stat_moments moments = { 0.0, 0.0, 0.0 };
    int i;

    for (i = 0; i < SAMPLES; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const float u2 = pcg32_float(&random), u3 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(a->f.kd, u0, u1);
        const envsamp_sample t = envsamp_kd_sample(b->f.kd, u2, u3);
        const float ws = envsamp_mis_power(s.pdf, blind * envsamp_kd_pdf(b->f.kd, s.dir));
        const float wt = envsamp_mis_power(t.pdf, envsamp_kd_pdf(a->f.kd, t.dir));

        stat_moments_add(&moments, evaluate(a, kind, s.dir) / (double)s.pdf * (double)ws
                                   + evaluate(a, kind, t.dir) / (double)t.pdf * (double)wt);
    }
    return moments;
}

static void test_both_control(const reference *a, const reference *b)
{
    const stat_moments m = estimate_both(a, b, RADIANCE, 1.5f);
    const double known = known_integral(a, RADIANCE);

    CHECK(stat_mean_test(&m, known, 1e-4 * known) < STAT_ALPHA,
          "rejected: weights from a density half too high, %.5f of what it should be",
          m.mean / known);
}

/* Densities of a sample differ where its direction rounds over an edge: at most 1 in 2000. */
static void test_both(void)
{
    reference a, b;
    image studio, foliage;
    int i;

    map_make("studio", 256, 128, &studio);
    map_make("foliage", 256, 128, &foliage);
    if (!build(&a, &studio, 6144, ENVSAMP_KD_ALIAS) || !build(&b, &foliage, 500, ENVSAMP_KD_FIT))
        return;
    for (i = 0; i < INTEGRANDS; i++) {
        const stat_moments m = estimate_both(&a, &b, (integrand)i, 1.0f);
        const double known = known_integral(&a, (integrand)i);
        const double p = stat_mean_test(&m, known, 1e-4 * known);

        CHECK(p >= STAT_ALPHA, "two samplers: integral of %s is %.5f of what it is, p = %.3g",
              integrand_name((integrand)i), m.mean / known, p);
    }
    test_both_control(&a, &b);
    reference_free(&a);
    reference_free(&b);
    image_free(&studio);
    image_free(&foliage);
}

/* ---- all ---- */

static void test_means(void)
{
    const envsamp_kd_select selects[] = { ENVSAMP_KD_ALIAS, ENVSAMP_KD_FIT, ENVSAMP_KD_WARP };
    int i;

    for (i = 0; i < 3; i++) {
        test_integrals("studio", 6144, selects[i], 0);
        test_integrals("foliage", 256, selects[i], 0);
        test_integrals("night", 6144, selects[i], 0);
        if (selects[i] != ENVSAMP_KD_WARP)      /* whose u1 chooses blocks too */
            test_integrals("foliage", 6144, selects[i], 1);
        test_variance("studio", 500, selects[i]);
        test_variance("foliage", 6144, selects[i]);
        test_variance("sky", 6144, selects[i]);
    }
    test_integral_control();
    test_both();
}

int main(void)
{
    test_all_blocks();
    test_texels("sky", 32, 16);
    test_texels("studio", 32, 16);
    test_texels("night", 32, 16);
    test_texels("foliage", 37, 19);
    test_texels("foliage", 64, 32);
    test_parts("sky", 64, 32, 1000);
    test_parts("foliage", 37, 19, 500);
    test_parts("studio", 64, 32, 3000);
    test_controls();
    test_dark(ENVSAMP_KD_ALIAS);
    test_dark(ENVSAMP_KD_FIT);
    test_dark(ENVSAMP_KD_WARP);
    test_positions("sky", 6144, ENVSAMP_KD_ALIAS);
    test_positions("foliage", 32768, ENVSAMP_KD_ALIAS);
    test_positions("sky", 6144, ENVSAMP_KD_FIT);
    test_positions("night", 6144, POWER);
    test_positions("sky", 6144, ENVSAMP_KD_WARP);
    test_positions("foliage", 32768, ENVSAMP_KD_WARP);
    test_rare_blocks(1.0);
    test_rare_blocks(4.0);
    test_means();
    return check_done();
}
