/* test_cdf.c: inversion over texels: guided and plain search agree, what is drawn is what is
 * claimed, directions invert, every edge and every bad input is safe.
 *
 *     test_cdf [quick]       quick: without the long ones, for slow tools
 */
#include "check.h"

#include "../envsamp.h"

#include "kd_fixture.h"
#include "statistics.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"

#include <float.h>

#define UNIT 16777216.0         /* 2^24: how many values a float u has */

/* ---- a table ---- */

typedef struct subject {
    image map;
    envsamp_image view;
    envsamp_cdf_desc desc;
    envsamp_sizes sizes;
    kd_guarded table, scratch;
    envsamp_result result;
    const envsamp_cdf *cdf;
    envsamp_cdf_info info;
} subject;

/* Builds from s->view, by s->desc, which is all zeros for a map of constant texels. Whether there
   is a table; s->result says why not. */
static int subject_build(subject *s)
{
    s->result = envsamp_cdf_sizes(&s->view, &s->desc, &s->sizes);
    s->table = kd_guarded_make(s->sizes.table_bytes, 0x3c);
    s->scratch = kd_guarded_make(s->sizes.scratch_bytes, 0xc3);
    if (s->result == ENVSAMP_OK)
        s->result = envsamp_cdf_build(&s->view, &s->desc, s->table.buffer, s->scratch.buffer,
                                      &s->cdf);
    if (s->result == ENVSAMP_OK)
        envsamp_cdf_get_info(s->cdf, &s->info);
    return s->result == ENVSAMP_OK;
}

static int subject_of(subject *s, const float *pixels, int width, int height, int channels)
{
    memset(s, 0, sizeof *s);
    s->desc.nearest = 1;
    s->view = kd_image(pixels, width, height, channels);
    return subject_build(s);
}

static int subject_make(subject *s, const char *name, int width, int height)
{
    memset(s, 0, sizeof *s);
    s->desc.nearest = 1;
    map_make(name, width, height, &s->map);
    s->view = kd_image(s->map.rgb, width, height, 3);
    return subject_build(s);
}

static int subject_intact(const subject *s)
{
    return kd_guarded_intact(&s->table) && kd_guarded_intact(&s->scratch);
}

static void subject_free(subject *s)
{
    free(s->table.block);
    free(s->scratch.block);
    image_free(&s->map);
}

static double texel_sr(const subject *s, int x, int y)
{
    return kd_solid_angle(s->view.width, s->view.height, x, y, x + 1, y + 1);
}

/* Probability of a texel, by the edges of the table. */
static double texel_probability(const subject *s, uint32_t x, uint32_t y)
{
    const uint32_t *rows = inside_row_edges(s->cdf);
    const uint32_t *edges = inside_edges(s->cdf, y);

    return (double)(rows[y + 1] - rows[y]) / UNIT * ((double)(edges[x + 1] - edges[x]) / UNIT);
}

static void worst(double *so_far, double value)
{
    if (!(value <= *so_far))
        *so_far = value;
}

/* ---- guided search is a search ---- */

static uint32_t plain_find(const uint32_t *edges, uint32_t count, uint32_t draw)
{
    uint32_t low = 0, high = count - 1;

    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;

        if (edges[middle + 1] > draw)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

static int same_texel(const envsamp_cdf *cdf, float u0, float u1)
{
    const inside_texel t = inside_draw(cdf, u0, u1);
    const uint32_t row = plain_find(inside_row_edges(cdf), CDF_WORD(cdf, height),
                                    (uint32_t)((double)u1 * UNIT));

    return t.row == row && t.column == plain_find(inside_edges(cdf, row), CDF_WORD(cdf, width),
                                                  (uint32_t)((double)u0 * UNIT));
}

static void test_search(const char *name, int width, int height, long count)
{
    pcg32 random = pcg32_make(5, 0);
    long differ = 0, i;
    subject s;

    subject_make(&s, name, width, height);
    for (i = 0; i < count; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);

        differ += !same_texel(s.cdf, u0, u1);
    }
    CHECK(s.cdf && subject_intact(&s) && differ == 0,
          "%s, %dx%d: %ld of %ld points are not where a binary search finds them", name, width,
          height, differ, count);
    subject_free(&s);
}

/* Long cells: thousands of dark texels beside a lamp, black ones between them. And a control: the
   guide of another row leads astray. */
static void test_long_cells(void)
{
    enum { WIDTH = 20000 };
    float *pixels = (float *)kd_allocate(2 * WIDTH * sizeof *pixels);
    long differ = 0, astray = 0, draw;
    subject s;
    int x;

    for (x = 0; x < 2 * WIDTH; x++)
        pixels[x] = x % 3 ? 1e-9f * (float)(1 + x % 7) : 0.0f;
    pixels[WIDTH / 3] = 1.0f;
    pixels[2 * WIDTH - 1] = 1000.0f;
    subject_of(&s, pixels, WIDTH, 2, 1);
    for (draw = 0; draw < 1 << 24; draw += draw < 300000 || draw > 16400000 ? 1 : 501) {
        const uint32_t *edges = inside_edges(s.cdf, 0);

        differ += !same_texel(s.cdf, (float)((double)draw / UNIT), 0.0f)
               || !same_texel(s.cdf, (float)((double)draw / UNIT), 0.99f);
        astray += inside_search(s.cdf, 0, 1, (uint32_t)draw)
                != plain_find(edges, WIDTH, (uint32_t)draw);
    }
    CHECK(differ == 0, "long cells: %ld draws differ from a binary search", differ);
    CHECK(astray > 1000, "control: with the wrong guide %ld do", astray);
    subject_free(&s);
    free(pixels);
}

/* ---- what is drawn is what is claimed ---- */

/* All 2^24 values of u0: each texel of a row as often as its edges say; so for rows. */
static void test_every_draw(void)
{
    static const float pixels[15] = { 0.0f, 1e-12f, 3.0f, 0.0f, 0.5f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
                                      0.0f, 7.0f, 1e5f, 2.0f, 0.0f };
    double columns[5] = { 0.0 }, rows[3] = { 0.0 };
    const uint32_t *edges, *row_edges;
    subject s;
    long i;
    int k, wrong = 0;

    subject_of(&s, pixels, 5, 3, 1);
    edges = inside_edges(s.cdf, 0);
    row_edges = inside_row_edges(s.cdf);
    for (i = 0; i < 1 << 24; i++) {
        const float u = (float)((double)i / UNIT);

        columns[inside_draw(s.cdf, u, 0.0f).column] += 1.0;
        rows[inside_draw(s.cdf, 0.5f, u).row] += 1.0;
    }
    for (k = 0; k < 5; k++)
        wrong += columns[k] != (double)(edges[k + 1] - edges[k]);
    for (k = 0; k < 3; k++)
        wrong += rows[k] != (double)(row_edges[k + 1] - row_edges[k]);
    CHECK(IS(wrong, 0) && rows[1] <= 0.0 && columns[0] <= 0.0 && columns[1] >= 1.0,
          "all 2^24 numbers: each texel and row as often as claimed, black never, lit once");
    subject_free(&s);
}

/* Brute force over the map: the sum of probabilities, the integral of the density, mass, variance
   and ratio; densities at the centres of texels; no lit texel without, no black one with. */
static void test_exact(const char *name, int width, int height)
{
    double mass = 0.0, sum = 0.0, covered = 0.0, second = 0.0, ratio = 0.0, off = 0.0;
    int x, y, wrong = 0;
    subject s;

    subject_make(&s, name, width, height);
    for (y = 0; y < height; y++)
        for (x = 0; x < width; x++)
            mass += kd_texel(&s.view, x, y) * texel_sr(&s, x, y);
    for (y = 0; y < height; y++)
        for (x = 0; x < width; x++) {
            const double value = kd_texel(&s.view, x, y), sr = texel_sr(&s, x, y);
            const double chance = texel_probability(&s, (uint32_t)x, (uint32_t)y);
            float dir[3];
            double pdf;

            kd_direction((x + 0.5) / width, (y + 0.5) / height, dir);
            pdf = (double)envsamp_cdf_pdf(s.cdf, dir);
            sum += chance;
            covered += pdf * sr;
            wrong += (value > 0.0) != (pdf > 0.0);
            if (value > 0.0) {
                worst(&off, fabs(pdf * sr / chance - 1.0));
                second += value * value * sr / pdf;
                worst(&ratio, value / pdf / mass);
            }
        }
    second = second / mass / mass - 1.0;
    CHECK(fabs(sum - 1.0) < 1e-12 && fabs(covered - 1.0) < 1e-6, "%s, %dx%d: probabilities sum to "
          "1 %+.1e, pdf integrates to 1 %+.1e", name, width, height, sum - 1.0, covered - 1.0);
    CHECK(wrong == 0 && off < 1e-4, "dark where it is black, and nowhere else; pdf is off by %.1e",
          off);
    CHECK(fabs(s.info.integral / mass - 1.0) < 1e-6, "integral %.9g", s.info.integral);
    CHECK(fabs(s.info.excess_variance - second) < 3e-7
          && s.info.excess_variance < (width + height) / UNIT
          && fabs(s.info.max_ratio - ratio) < 1e-4
          && s.info.max_ratio < 1.0001 + 2.0 * (width + height) / UNIT,
          "excess variance %.3g (%.3g), max ratio %.7g (%.7g)", s.info.excess_variance, second,
          s.info.max_ratio, ratio);
    subject_free(&s);
}

/* ---- statistics ---- */

enum { SOUND, NO_SINE, SHIFTED, SWAPPED, TWO_PERCENT, KINDS };
static const char *const kind_names[KINDS] = { "samples", "control: no sine",
    "control: half a texel off", "control: u and v swapped", "control: a cell 2 % off" };

/* Chi-square of samples in cells of 8x8 texels against masses summed over the map. */
static void test_masses(int kind)
{
    enum { WIDTH = 128, HEIGHT = 64, ACROSS = 16, DOWN = 8, COUNT = 4000000 };
    double *expected = (double *)kd_allocate(ACROSS * DOWN * sizeof(double));
    double *hits = (double *)kd_allocate(ACROSS * DOWN * sizeof(double));
    pcg32 random = pcg32_make(11, 3);
    stat_result result;
    subject s;
    int x, y, i, brightest = 0;

    subject_make(&s, "studio", WIDTH, HEIGHT);
    for (y = 0; y < HEIGHT; y++)
        for (x = 0; x < WIDTH; x++)
            expected[y / 8 * ACROSS + x / 8] += kd_texel(&s.view, x, y)
                * (kind == NO_SINE ? 1.0 : texel_sr(&s, x, y));
    for (i = 0; i < ACROSS * DOWN; i++)
        brightest = expected[i] > expected[brightest] ? i : brightest;
    expected[brightest] *= kind == TWO_PERCENT ? 1.02 : 1.0;
    for (i = 0; i < COUNT; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample p = envsamp_cdf_sample(s.cdf, kind == SWAPPED ? u1 : u0,
                                                    kind == SWAPPED ? u0 : u1);
        double u, v;

        kd_point(p.dir, &u, &v);
        if (kind == SWAPPED) {              /* the same point, its coordinates exchanged */
            const double w = u;

            u = v;
            v = w;
        }
        u += kind == SHIFTED ? 0.5 / WIDTH : 0.0;
        u -= u >= 1.0 ? 1.0 : 0.0;
        x = (int)(u * ACROSS);
        y = (int)(v * DOWN);
        hits[(y < DOWN ? y : DOWN - 1) * ACROSS + (x < ACROSS ? x : ACROSS - 1)] += 1.0;
    }
    result = stat_chi2_test(expected, hits, ACROSS * DOWN, NULL);
    CHECK(result.pass == (kind == SOUND), "%s: %s, chi2 %.0f of %.0f, p = %.2g", kind_names[kind],
          stat_verdict_string(result.verdict), result.chi2, result.dof, result.p);
    free(expected);
    free(hits);
    subject_free(&s);
}

/* E[f / pdf] of f = L (1 + z) is its integral. Control: of a density that is 0.2 % off. */
static void test_integral(void)
{
    pcg32 random = pcg32_make(3, 9);
    stat_moments good = { 0.0, 0.0, 0.0 }, bad = { 0.0, 0.0, 0.0 };
    double integral = 0.0;
    subject s;
    int x, y, i;

    subject_make(&s, "night", 256, 128);
    for (y = 0; y < 128; y++)
        for (x = 0; x < 256; x++) {
            const double z = 0.5 * (cos(KD_PI * y / 128.0) + cos(KD_PI * (y + 1) / 128.0));

            integral += kd_texel(&s.view, x, y) * texel_sr(&s, x, y) * (1.0 + z);
        }
    for (i = 0; i < 1000000; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample p = envsamp_cdf_sample(s.cdf, u0, u1);
        const inside_texel t = inside_draw(s.cdf, u0, u1);
        const double f = kd_texel(&s.view, (int)t.column, (int)t.row) * (1.0 + (double)p.dir[2]);

        stat_moments_add(&good, f / (double)p.pdf);
        stat_moments_add(&bad, f / (1.002 * (double)p.pdf));
    }
    CHECK(stat_mean_test(&good, integral, 1e-6 * integral) > STAT_ALPHA, "E[f/pdf] is %.6f of the "
          "integral", good.mean / integral);
    CHECK(stat_mean_test(&bad, integral, 1e-6 * integral) < STAT_ALPHA, "control: 0.2 %% are seen");
    subject_free(&s);
}

/* ---- there and back ---- */

static void test_inverse(const char *name, int width, int height)
{
    enum { COUNT = 1000000 };
    pcg32 random = pcg32_make(21, 0);
    double off[2] = { 0.0, 0.0 }, control = 0.0;
    long across = 0, exact = 0, pdfs = 0, none = 0, i;
    subject s;

    subject_make(&s, name, width, height);
    for (i = 0; i < COUNT; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample p = envsamp_cdf_sample(s.cdf, u0, u1);
        const inside_texel t = inside_draw(s.cdf, u0, u1);
        const inside_texel at = inside_find(s.cdf, p.dir);
        const uint32_t *edge = inside_edges(s.cdf, t.row) + t.column;
        const uint32_t *row = inside_row_edges(s.cdf) + t.row;
        const float y0 = inside_row_edge(s.cdf, t.row), y1 = inside_row_edge(s.cdf, t.row + 1);
        double stretch[2];
        float u[2];

        pdfs += envsamp_cdf_pdf(s.cdf, p.dir) != p.pdf;
        if (t.column != at.column || t.row != at.row) {
            across++;
            continue;
        }
        none += !envsamp_cdf_invert(s.cdf, p.dir, u);
        exact += u[0] == u0 && u[1] == u1;
        stretch[0] = (double)(edge[1] - edge[0]) / UNIT * width;
        stretch[1] = (double)(row[1] - row[0]) / UNIT
                   / (0.5 * kd_cap_between(y0, y1));
        worst(&off[0], fabs((double)u[0] - (double)u0) * UNIT / (1.0 + 4.0 * stretch[0]));
        worst(&off[1], fabs((double)u[1] - (double)u1) * UNIT / (1.0 + 4.0 * stretch[1]));
        worst(&control, fabs((double)u[0] - (double)u1) * UNIT / (1.0 + 4.0 * stretch[0]));
    }
    CHECK(none == 0 && off[0] <= 1.0 && off[1] <= 1.0, "%s, %dx%d: inverses are %.2f and %.2f of "
          "what is promised off, %.1f %% exact", name, width, height, off[0], off[1],
          1e2 * (double)exact / COUNT);
    CHECK(control > 10.0, "control: u1 for u0 is %.0f off", control);
    CHECK((double)across <= COUNT / 1e6 * width && pdfs <= across, "%ld of %d samples lie "
          "across an edge, %ld with another pdf", across, COUNT, pdfs);
    subject_free(&s);
}

/* ---- many at a time ---- */

static void test_batches(void)
{
    enum { COUNT = 1000 };
    static float u[2][COUNT], x[3][COUNT], pdf[COUNT], again[COUNT];
    pcg32 random = pcg32_make(8, 8);
    int i, wrong = 0, differ;
    size_t n;
    subject s;

    subject_make(&s, "foliage", 300, 77);
    for (i = 0; i < COUNT; i++) {
        u[0][i] = pcg32_float(&random);
        u[1][i] = pcg32_float(&random);
    }
    u[0][3] = NAN;
    u[1][4] = INFINITY;
    u[0][5] = -0.5f;
    for (n = 0; n < COUNT; n = 2 * n + 1) {
        envsamp_cdf_sample_n(s.cdf, n, u[0], u[1], x[0], x[1], x[2], pdf);
        envsamp_cdf_pdf_n(s.cdf, n, x[0], x[1], x[2], again);
        for (i = 0; i < (int)n; i++) {
            const envsamp_sample p = envsamp_cdf_sample(s.cdf, u[0][i], u[1][i]);
            const float alone = envsamp_cdf_pdf(s.cdf, p.dir);

            wrong += !kd_bits_equal(&p.dir[0], &x[0][i], 4)
                  || !kd_bits_equal(&p.dir[1], &x[1][i], 4)
                  || !kd_bits_equal(&p.dir[2], &x[2][i], 4) || !kd_bits_equal(&p.pdf, &pdf[i], 4)
                  || !kd_bits_equal(&alone, &again[i], 4);
        }
    }
    CHECK(IS(wrong, 0), "batches of 0 to 511 are scalar calls bit for bit");
    x[0][0] = NAN;
    x[1][1] = INFINITY;
    x[0][2] = x[1][2] = x[2][2] = 0.0f;
    envsamp_cdf_pdf_n(s.cdf, 3, x[0], x[1], x[2], again);
    differ = again[0] != 0.0f || again[1] != 0.0f || again[2] != 0.0f;
    CHECK(IS(differ, 0), "and 0 for what is no direction");
    envsamp_cdf_sample_n(s.cdf, 0, NULL, NULL, NULL, NULL, NULL, NULL);
    envsamp_cdf_pdf_n(s.cdf, 0, NULL, NULL, NULL, NULL);
    subject_free(&s);
}

/* Batches read ahead: where the table is larger than caches, too, they are scalar calls. */
static void test_large_batches(void)
{
    enum { COUNT = 1000, ROUNDS = 10000 };
    static float u[2][COUNT], x[COUNT], y[COUNT], z[COUNT], pdf[COUNT];
    pcg32 random = pcg32_make(4, 4);
    long differ = 0;
    int round, i;
    subject s;

    subject_make(&s, "night", 2048, 1024);
    for (round = 0; round < ROUNDS; round++) {
        for (i = 0; i < COUNT; i++) {
            u[0][i] = pcg32_float(&random);
            u[1][i] = pcg32_float(&random);
        }
        envsamp_cdf_sample_n(s.cdf, COUNT, u[0], u[1], x, y, z, pdf);
        for (i = 0; i < COUNT; i++) {
            const envsamp_sample p = envsamp_cdf_sample(s.cdf, u[0][i], u[1][i]);

            differ += !kd_bits_equal(&p.dir[0], &x[i], 4) || !kd_bits_equal(&p.dir[1], &y[i], 4)
                   || !kd_bits_equal(&p.dir[2], &z[i], 4) || !kd_bits_equal(&p.pdf, &pdf[i], 4);
        }
    }
    CHECK(differ == 0, "%ld of 10^7 samples of batches differ from scalar calls", differ);
    subject_free(&s);
}

/* ---- edges of the range, odd shapes, bad pixels ---- */

/* Samples and densities at every kind of number: finite, of unit length, inside the map, lit. */
static int sane(const subject *s)
{
    const float u[] = { 0.0f, -0.0f, 0x1p-24f, 0x1p-149f, 0.5f, 0.49999997f, 0.99999994f, 1.0f,
                        2.0f, -1.0f, -1e30f, FLT_MAX, INFINITY, -INFINITY, NAN, -NAN };
    const float odd[][3] = { { 0, 0, 0 }, { 0, 0, 1 }, { 0, 0, -1 }, { -0.0f, -0.0f, 2 },
                             { 1, 0, 0 }, { 1, -0.0f, 0 }, { 1, -1e-30f, 0 }, { -1, 0, 0 },
                             { 0, 1, 0 }, { 1e-15f, 0, 1e-15f }, { 1e18f, 1e18f, 1e18f },
                             { NAN, 0, 0 }, { 0, INFINITY, 0 }, { FLT_MAX, FLT_MAX, FLT_MAX },
                             { 0, NAN, -INFINITY }, { 1e-40f, 0, 0 } };
    const int count = (int)(sizeof u / sizeof *u), odd_count = (int)(sizeof odd / sizeof *odd);
    int i, j, good = 1;

    for (i = 0; i < count; i++)
        for (j = 0; j < count; j++) {
            const envsamp_sample p = envsamp_cdf_sample(s->cdf, u[i], u[j]);
            const double length = (double)p.dir[0] * (double)p.dir[0]
                + (double)p.dir[1] * (double)p.dir[1] + (double)p.dir[2] * (double)p.dir[2];
            float back[2];

            good &= fabs(sqrt(length) - 1.0) < 1e-6 && p.pdf > 0.0f && p.pdf <= FLT_MAX
                 && p.uv[0] >= 0.0f && p.uv[0] < 1.0f && p.uv[1] >= 0.0f && p.uv[1] <= 1.0f;
            envsamp_cdf_invert(s->cdf, p.dir, back);
            good &= back[0] >= 0.0f && back[0] < 1.0f && back[1] >= 0.0f && back[1] < 1.0f;
        }
    for (i = 0; i < odd_count; i++) {
        const float pdf = envsamp_cdf_pdf(s->cdf, odd[i]);
        float back[2];

        good &= pdf >= 0.0f && pdf <= FLT_MAX;
        good &= envsamp_cdf_invert(s->cdf, odd[i], back) == (pdf > 0.0f);
        good &= back[0] >= 0.0f && back[0] < 1.0f && back[1] >= 0.0f && back[1] < 1.0f;
    }
    return good;
}

/* All samples of a lone texel lie in it. */
static void test_lone(int width, int height, int x, int y)
{
    float *pixels = (float *)kd_allocate((size_t)(width * height) * sizeof *pixels);
    pcg32 random = pcg32_make(2, 2);
    int i, inside = 1;
    subject s;

    pixels[y * width + x] = 3.0f;
    inside &= subject_of(&s, pixels, width, height, 1) && sane(&s);
    for (i = 0; i < 2000 && inside; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample p = envsamp_cdf_sample(s.cdf, u0, u1);

        inside &= fabs((double)p.uv[0] * width - x - 0.5) <= 0.5 + 1e-6 * width
               && fabs((double)p.uv[1] * height - y - 0.5) <= 0.5 + 1e-6 * height
               && fabs((double)p.pdf * texel_sr(&s, x, y) - 1.0) < 1e-5;
    }
    CHECK(inside && subject_intact(&s) && fabs(s.info.integral / 3.0 / texel_sr(&s, x, y) - 1.0)
          < 1e-12, "%dx%d: only texel %d, %d lit", width, height, x, y);
    subject_free(&s);
    free(pixels);
}

static void test_shapes(void)
{
    static const int shapes[][2] = { { 1, 1 }, { 1, 2 }, { 2, 1 }, { 1, 300 }, { 300, 1 },
                                     { 3, 5 }, { 4, 4 }, { 5, 4 }, { 1, 65535 }, { 65535, 1 } };
    size_t k;

    for (k = 0; k < sizeof shapes / sizeof *shapes; k++) {
        const int width = shapes[k][0], height = shapes[k][1];
        float *pixels = (float *)kd_allocate((size_t)(width * height) * sizeof *pixels);
        const envsamp_cdf *again;
        const float dir[3] = { -0.3f, 0.2f, 0.9f };
        subject s;
        int i;

        for (i = 0; i < width * height; i++)
            pixels[i] = 2.0f;
        CHECK(subject_of(&s, pixels, width, height, 1) && subject_intact(&s) && sane(&s),
              "constant, %dx%d", width, height);
        CHECK(fabs(s.info.integral / (8.0 * KD_PI) - 1.0) < 1e-9
              && fabs((double)envsamp_cdf_pdf(s.cdf, dir) * 4.0 * KD_PI - 1.0) < 5e-3
              && s.info.excess_variance < (width + height) / UNIT
              && envsamp_cdf_open(s.table.buffer.data, s.table.buffer.bytes, &again) == ENVSAMP_OK,
              "it opens, its pdf is %.6f of 1/4pi",
              (double)envsamp_cdf_pdf(s.cdf, dir) * 4.0 * KD_PI);
        subject_free(&s);
        free(pixels);
    }
    test_lone(8, 4, 0, 0);
    test_lone(8, 4, 7, 0);
    test_lone(8, 4, 0, 3);
    test_lone(8, 4, 7, 3);
    test_lone(1, 1, 0, 0);
    test_lone(2048, 4, 2047, 2);
    test_lone(3, 1000, 1, 999);
}

static void test_pixels(void)
{
    float pixels[12] = { 1.0f, NAN, 2.0f, INFINITY, -1.0f, 3.0f, -INFINITY, -0.0f, 1e-45f, 0.0f,
                         FLT_MAX, 4.0f };
    subject s;
    int i;

    subject_of(&s, pixels, 4, 3, 1);
    CHECK(s.cdf && s.info.bad_pixel_count == 4 && sane(&s), "NaN, infinite and negative pixels: %d "
          "counted", (int)s.info.bad_pixel_count);
    CHECK(texel_probability(&s, 0, 2) > 0.0 && texel_probability(&s, 1, 0) <= 0.0
          && texel_probability(&s, 0, 1) <= 0.0,
          "a denormal is drawn beside FLT_MAX, a bad one not");
    subject_free(&s);
    memset(&s, 0, sizeof s);
    s.view = kd_image(pixels, 4, 3, 1);
    s.desc.nearest = s.desc.strict = 1;
    CHECK(!subject_build(&s) && IS(s.result, ENVSAMP_ERR_VALUE) && !s.cdf && subject_intact(&s)
          && IS(envsamp_cdf_open(s.table.buffer.data, s.table.buffer.bytes, &s.cdf),
             ENVSAMP_ERR_FORMAT), "strict: refused, and no table left");
    subject_free(&s);
    for (i = 0; i < 12; i++)
        pixels[i] = i & 1 ? 0.0f : -2.0f;
    CHECK(!subject_of(&s, pixels, 4, 3, 1) && IS(s.result, ENVSAMP_ERR_BLACK) && !s.cdf, "black");
    subject_free(&s);
    for (i = 0; i < 12; i++)
        pixels[i] = 1e-45f;
    CHECK(subject_of(&s, pixels, 4, 3, 1) && sane(&s) && IS_NEAR(s.info.max_ratio, 1.0, 1e-3),
          "denormals alone");
    subject_free(&s);
    for (i = 0; i < 12; i++)
        pixels[i] = FLT_MAX;
    CHECK(subject_of(&s, pixels, 2, 2, 3) && sane(&s) && IS_NEAR(s.info.max_ratio, 1.0, 1e-3),
          "FLT_MAX everywhere");
    subject_free(&s);
}

/* ---- arguments ---- */

static void test_arguments(void)
{
    const float pixels[4] = { 1.0f, 2.0f, 3.0f, 4.0f };
    const envsamp_cdf *cdf;
    envsamp_cdf_info info;
    envsamp_sizes sizes;
    envsamp_image view;
    envsamp_buffer less;
    const int mappings[] = { ENVSAMP_LATLONG, ENVSAMP_HEMISPHERE, ENVSAMP_OCTAHEDRAL, 3, -1 };
    const float compensations[] = { 0.0f, 0.5f, 1.0f, 1.0000001f, -1e-30f, -1.0f, NAN, INFINITY,
                                    -INFINITY };
    int i, wrong = 0;
    subject s;

    subject_of(&s, pixels, 2, 2, 1);
    less = s.table.buffer;
    CHECK(IS(envsamp_cdf_sizes(NULL, NULL, &sizes), ENVSAMP_ERR_NULL) && IS(sizes.table_bytes, 0)
          && IS(envsamp_cdf_sizes(&s.view, NULL, NULL), ENVSAMP_ERR_NULL)
          && IS(envsamp_cdf_build(&s.view, NULL, less, less, NULL), ENVSAMP_ERR_NULL)
          && IS(envsamp_cdf_build(NULL, NULL, less, less, &cdf), ENVSAMP_ERR_NULL) && !cdf
          && IS(envsamp_cdf_open(NULL, 10, &cdf), ENVSAMP_ERR_NULL)
          && IS(envsamp_cdf_open(less.data, 10, NULL), ENVSAMP_ERR_NULL)
          && IS(envsamp_cdf_get_info(NULL, &info), ENVSAMP_ERR_NULL)
          && IS(envsamp_cdf_get_info(s.cdf, NULL), ENVSAMP_ERR_NULL), "missing pointers");
    view = s.view;
    view.pixels = NULL;
    CHECK(IS(envsamp_cdf_sizes(&view, NULL, &sizes), ENVSAMP_OK)
          && IS(envsamp_cdf_build(&view, NULL, less, s.scratch.buffer, &cdf), ENVSAMP_ERR_NULL),
          "no pixels: sizes, but no table");
    view = s.view;
    view.height = 65536;
    CHECK(IS(envsamp_cdf_sizes(&view, NULL, &sizes), ENVSAMP_ERR_SIZE), "too high");
    view.height = view.width = 65535;
    CHECK(envsamp_cdf_sizes(&view, NULL, &sizes) == (sizeof(size_t) > 4 ? ENVSAMP_OK
          : ENVSAMP_ERR_SIZE), "65535x65535 wants %.1f GB", 1e-9 * (double)sizes.table_bytes);
    view = s.view;
    for (i = 0; i < 5; i++) {
        view.mapping = (envsamp_mapping)mappings[i];
        wrong += envsamp_cdf_sizes(&view, NULL, &sizes)
              != (i < 3 ? ENVSAMP_OK : ENVSAMP_ERR_PARAM) || (sizes.table_bytes > 0) != (i < 3);
    }
    CHECK(!wrong, "mappings that are none are refused, the three not: %d wrong", wrong);
    for (i = 0; i < 9; i++) {
        s.desc.mis_compensation = compensations[i];
        wrong += envsamp_cdf_sizes(&s.view, &s.desc, &sizes)
              != (i < 3 ? ENVSAMP_OK : ENVSAMP_ERR_PARAM);
    }
    CHECK(!wrong, "so is compensation out of [0, 1]: %d wrong", wrong);
    s.desc.mis_compensation = 0.0f;
    less.bytes--;
    CHECK(IS(envsamp_cdf_build(&s.view, &s.desc, less, s.scratch.buffer, &cdf), ENVSAMP_ERR_MEMORY)
          && !cdf, "a byte of table less");
    less = s.scratch.buffer;
    less.bytes--;
    CHECK(IS(envsamp_cdf_build(&s.view, &s.desc, s.table.buffer, less, &cdf), ENVSAMP_ERR_MEMORY),
          "a byte of scratch less");
    less.data = (char *)s.scratch.buffer.data + 4;
    less.bytes++;
    CHECK(IS(envsamp_cdf_build(&s.view, &s.desc, s.table.buffer, less, &cdf), ENVSAMP_ERR_ALIGN)
          && IS(envsamp_cdf_open(less.data, CDF_AT(end), &cdf), ENVSAMP_ERR_ALIGN), "not aligned");
    subject_free(&s);
}

/* No description is the defaults: bilinear, no compensation, not strict. */
static void test_defaults(void)
{
    const envsamp_cdf_desc defaults = envsamp_cdf_defaults();
    const envsamp_cdf *cdf = NULL;
    envsamp_sizes sizes;
    kd_guarded table;
    subject s;

    CHECK(!defaults.nearest && !(defaults.mis_compensation > 0.0f) && !defaults.strict,
          "the defaults are bilinear");
    memset(&s, 0, sizeof s);
    map_make("night", 37, 19, &s.map);
    s.view = kd_image(s.map.rgb, 37, 19, 3);
    s.desc = defaults;
    subject_build(&s);
    table = kd_guarded_make(s.sizes.table_bytes, 0x42);
    CHECK(s.cdf && !s.info.nearest && sane(&s)
          && IS(envsamp_cdf_sizes(&s.view, NULL, &sizes), ENVSAMP_OK)
          && !memcmp(&sizes, &s.sizes, sizeof sizes)
          && IS(envsamp_cdf_build(&s.view, NULL, table.buffer, s.scratch.buffer, &cdf), ENVSAMP_OK)
          && !memcmp(cdf, s.cdf, sizes.table_bytes), "NULL gives the table of the defaults");
    free(table.block);
    subject_free(&s);
}

/* ---- bilinear cells ---- */

/* Two columns of a map are lit, or two rows. The density in the cell before both, where radiance
   rises from 0 to 1, over that in the cell between them, where it is 1. */
static double ramp_to_plateau(int width, int height, int rows)
{
    const int x = width / 2, y = height / 2;
    float *pixels = (float *)kd_allocate((size_t)width * (size_t)height * sizeof *pixels);
    float dir[3], plateau, ramp;
    subject s;
    int i;

    for (i = 0; i < width * height; i++) {
        const int at = rows ? i / width - y : i % width - x;

        pixels[i] = at == 0 || at == -1 ? 1.0f : 0.0f;
    }
    memset(&s, 0, sizeof s);
    s.view = kd_image(pixels, width, height, 1);
    subject_build(&s);
    envsamp_uv_to_dir(ENVSAMP_LATLONG, (float)x / (float)width, (float)y / (float)height, dir);
    plateau = s.cdf ? envsamp_cdf_pdf(s.cdf, dir) : 1.0f;
    envsamp_uv_to_dir(ENVSAMP_LATLONG, (float)(x - !rows) / (float)width,
                      (float)(y - rows) / (float)height, dir);
    ramp = s.cdf ? envsamp_cdf_pdf(s.cdf, dir) : 0.0f;
    subject_free(&s);
    free(pixels);
    return (double)ramp / (double)plateau;
}

/* Cells are drawn by root mean squares: 1/sqrt(3) where radiance rises from 0 to 1, not its mean,
   1/2. Between rows solid angle adds less than 1e-3 to that at the equator. */
static void test_weights(void)
{
    const double across = ramp_to_plateau(16, 8, 0), down = ramp_to_plateau(16, 512, 1);

    CHECK(IS_NEAR(across, 0.57735, 1e-3) && IS_NEAR(down, 0.57735, 1e-3),
          "a cell of a ramp has %.5f and %.5f of the density of an even one: 1/sqrt(3)", across,
          down);
}

/* ---- the table as bytes ---- */

static double integral_of(const envsamp_cdf *cdf)
{
    envsamp_cdf_info info;

    envsamp_cdf_get_info(cdf, &info);
    return info.integral;
}

static void test_bytes(envsamp_mapping mapping, int bilinear, int width, int height)
{
    subject s, t;
    const envsamp_cdf *cdf;
    kd_guarded copy;
    size_t bytes, i, k;
    int opened = 0, unsafe = 0, caught = 0;

    memset(&s, 0, sizeof s);
    map_make("night", width, height, &s.map);
    s.view = kd_image(s.map.rgb, width, height, 3);
    s.view.mapping = mapping;
    s.desc.nearest = !bilinear;
    subject_build(&s);
    memset(&t, 0, sizeof t);
    t.view = s.view;
    t.table = kd_guarded_make(s.sizes.table_bytes, 0x99);
    t.scratch = kd_guarded_make(s.sizes.scratch_bytes, 0x11);
    envsamp_cdf_build(&t.view, &s.desc, t.table.buffer, t.scratch.buffer, &t.cdf);
    bytes = envsamp_cdf_bytes(s.cdf);
    CHECK(bytes == s.sizes.table_bytes && t.cdf && !memcmp(s.cdf, t.cdf, bytes),
          "mapping %d, bilinear %d: %lu bytes, the same whatever was in the buffers", (int)mapping,
          bilinear, (unsigned long)bytes);
    copy = kd_guarded_make(bytes + 32, 0x77);
    memcpy(copy.buffer.data, s.cdf, bytes);
    CHECK(IS(envsamp_cdf_open(copy.buffer.data, bytes, &cdf), ENVSAMP_OK)
          && IS(envsamp_cdf_open(copy.buffer.data, bytes + 32, &cdf), ENVSAMP_OK), "a copy opens");
    t.cdf = cdf;
    for (i = 0; i < bytes; i++)
        opened += envsamp_cdf_open(copy.buffer.data, i, &cdf) == ENVSAMP_OK;
    CHECK(IS(opened, 0), "a part of it does not");
    for (i = 0; i < bytes; i++)
        for (k = 0; k < 8; k += 3) {
            ((unsigned char *)copy.buffer.data)[i] ^= (unsigned char)(1 << k);
            opened += envsamp_cdf_open(copy.buffer.data, bytes, &cdf) == ENVSAMP_OK;
            inside_seal(copy.buffer.data, bytes);
            if (envsamp_cdf_open(copy.buffer.data, bytes, &cdf) == ENVSAMP_OK)
                unsafe += !sane(&t) && integral_of(t.cdf) > 0.0;
            else
                caught++;
            memcpy(copy.buffer.data, s.cdf, bytes);
        }
    CHECK(IS(opened, 0), "no damaged one does");
    CHECK(unsafe == 0 && caught > 1000 && kd_guarded_intact(&copy), "with its checksum made right "
          "%d of %d kinds of damage are seen, and the others sample safely", caught,
          (int)(3 * bytes));
    free(copy.block);
    subject_free(&t);
    subject_free(&s);
}

/* Of a row's two heights the larger follows from the other, and may not differ by a bit. */
static void test_row_sides(void)
{
    const envsamp_cdf *again;
    float *rows;        /* three for each edge; the heights from either pole come first */
    int opened = 0, control, y;
    subject s;

    subject_make(&s, "night", 37, 19);
    rows = (float *)s.table.buffer.data + CDF_PLACE(s.cdf, rows_at) / sizeof *rows;
    for (y = 0; y <= 19; y++) {
        float *larger = rows + 3 * y + (rows[3 * y] > rows[3 * y + 1] ? 0 : 1);
        const float kept = *larger;
        uint32_t bits;

        memcpy(&bits, larger, sizeof bits);
        bits ^= 1u;
        memcpy(larger, &bits, sizeof bits);
        inside_seal(s.table.buffer.data, s.sizes.table_bytes);
        opened += envsamp_cdf_open(s.cdf, s.sizes.table_bytes, &again) == ENVSAMP_OK;
        *larger = kept;
    }
    for (y = 0; y < 19; y++) {          /* a row that begins where it ends */
        float kept[2];

        memcpy(kept, rows + 3 * y, sizeof kept);
        memcpy(rows + 3 * y, rows + 3 * y + 3, sizeof kept);
        inside_seal(s.table.buffer.data, s.sizes.table_bytes);
        opened += envsamp_cdf_open(s.cdf, s.sizes.table_bytes, &again) == ENVSAMP_OK;
        memcpy(rows + 3 * y, kept, sizeof kept);
    }
    inside_seal(s.table.buffer.data, s.sizes.table_bytes);
    control = envsamp_cdf_open(s.cdf, s.sizes.table_bytes, &again) == ENVSAMP_OK;
    CHECK(opened == 0 && control, "rows whose heights do not agree, or that have none: %d of 39 "
          "open; control: the whole table does", opened);
    subject_free(&s);
}

/* Channels and strides: the same map in other clothes is the same table. */
static void test_layouts(void)
{
    enum { WIDTH = 67, HEIGHT = 21, STRIDE = WIDTH * 4 + 3 };
    float *four = (float *)kd_allocate(STRIDE * HEIGHT * sizeof *four);
    subject s, t;
    int x, y;

    subject_make(&s, "sky", WIDTH, HEIGHT);
    for (y = 0; y < HEIGHT; y++)
        for (x = 0; x < WIDTH; x++) {
            memcpy(four + y * STRIDE + 4 * x, s.map.rgb + 3 * (y * WIDTH + x), 3 * sizeof *four);
            four[y * STRIDE + 4 * x + 3] = NAN;
        }
    memset(&t, 0, sizeof t);
    t.view = kd_image(four, WIDTH, HEIGHT, 4);
    t.view.row_stride_bytes = STRIDE * sizeof *four;
    t.desc = s.desc;
    subject_build(&t);
    CHECK(t.cdf && !memcmp(s.cdf, t.cdf, s.sizes.table_bytes), "four channels and a row stride");
    subject_free(&t);
    subject_free(&s);
    free(four);
}

int main(int argc, char **argv)
{
    const int quick = argc > 1 && strcmp(argv[1], "quick") == 0;
    int kind;

    test_search("night", 2048, 1024, quick ? 1000000 : 10000000);
    test_search("sky", 1000, 501, 2000000);
    test_search("foliage", 3, 7, 100000);
    test_long_cells();
    if (!quick)
        test_every_draw();
    test_exact("sky", 512, 256);
    test_exact("night", 333, 101);
    test_exact("constant", 64, 32);
    for (kind = 0; kind < KINDS; kind++)
        test_masses(kind);
    test_integral();
    test_inverse("studio", 2048, 1024);
    test_inverse("sky", 256, 128);
    test_inverse("foliage", 5, 3);
    test_batches();
    test_large_batches();
    test_shapes();
    test_pixels();
    test_arguments();
    test_defaults();
    test_weights();
    test_bytes(ENVSAMP_LATLONG, 0, 37, 19);
    test_bytes(ENVSAMP_LATLONG, 1, 37, 19);
    test_bytes(ENVSAMP_HEMISPHERE, 1, 16, 13);
    test_bytes(ENVSAMP_OCTAHEDRAL, 0, 16, 16);
    test_bytes(ENVSAMP_OCTAHEDRAL, 1, 17, 17);
    test_row_sides();
    test_layouts();
    return check_done();
}
