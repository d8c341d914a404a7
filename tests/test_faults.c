/* test_faults.c: what users of other samplers report, asked of all samplers here on small maps, in
 * a second or two: draws, densities and what a table says of itself agree with sums over the map;
 * edges, the seam and u = 1 belong where they should; suns stay quiet; every number that ALIAS can
 * draw is drawn as often as claimed.
 *
 * The other tests ask more of each part; this one is what `make mutants` asks first.
 */
#include "check.h"

#include "../envsamp.h"

#include "sampler.h"
#include "../examples/common/random.h"

#include <float.h>

#define WIDTH 32
#define HEIGHT 16
#define UNIT 16777216           /* 2^24: how many values a float u has */

/* ---- maps ---- */

typedef enum content { SUNNY, DARK_PARTS, LAMP, GLARE, HALVES, QUARTER, STARS } content;

#define TABLED (HALVES + 1)     /* the first of them have all tables made */

static const char *const content_names[] = {
    "a sun", "dark parts", "a lamp", "a glare", "two halves", "a quarter", "stars"
};

static float pixels[WIDTH * HEIGHT];

/* A sky with a sun of four texels; a map whose lower half and some columns are black; one lamp of a
   texel in the seam column of a dim room; a sun beside which nothing has a share of 2^-24; 1 and 3,
   in four quarters; 1 round to u = 1/4, then 3; lamps of a texel, and below them an even ground
   that is as bright. */
static envsamp_image make_map(content kind)
{
    pcg32 random = pcg32_make(7, (uint64_t)kind);
    int x, y;

    for (y = 0; y < HEIGHT; y++)
        for (x = 0; x < WIDTH; x++) {
            const float noise = pcg32_float(&random);
            const int sun = x / 2 == 4 && y / 2 == 2;
            float *texel = &pixels[y * WIDTH + x];

            switch (kind) {
            case SUNNY: *texel = sun ? 1e5f : 1.0f + noise; break;
            case DARK_PARTS: *texel = y >= HEIGHT / 2 || x % 8 == 3 ? 0.0f : noise; break;
            case LAMP: *texel = x == 0 && y == 5 ? 1e3f : 0.5f; break;
            case GLARE: *texel = sun ? 1e12f : 1.0f; break;
            case QUARTER: *texel = x < WIDTH / 4 ? 1.0f : 3.0f; break;
            case STARS: *texel = y >= HEIGHT / 2 ? 30.0f : noise < 0.1f ? 300.0f : 0.1f; break;
            default: *texel = (x < WIDTH / 2) == (y < HEIGHT / 2) ? 1.0f : 3.0f;
            }
        }
    return kd_image(pixels, WIDTH, HEIGHT, 1);
}

/* Radiance, by a lookup that is not the library's: v is clamped to the rows, beyond a pole the map
   goes on half a turn round. */
static double texel_at(int x, int y)
{
    if (y < 0 || y >= HEIGHT) {
        y = y < 0 ? 0 : HEIGHT - 1;
        x += WIDTH / 2;
    }
    return (double)pixels[y * WIDTH + (x + WIDTH) % WIDTH];
}

static double radiance(double u, double v, int bilinear)
{
    const double x = u * WIDTH - (bilinear ? 0.5 : 0.0), y = v * HEIGHT - (bilinear ? 0.5 : 0.0);
    const int i = (int)floor(x), j = (int)floor(y);
    const double fx = x - i, fy = y - j;

    if (!bilinear)
        return texel_at(i, j < HEIGHT ? j : HEIGHT - 1);
    return (1.0 - fy) * ((1.0 - fx) * texel_at(i, j) + fx * texel_at(i + 1, j))
         + fy * ((1.0 - fx) * texel_at(i, j + 1) + fx * texel_at(i + 1, j + 1));
}

static void direction(double u, double v, float dir[3])
{
    dir[0] = (float)(cos(2.0 * KD_PI * u) * sin(KD_PI * v));
    dir[1] = (float)(sin(2.0 * KD_PI * u) * sin(KD_PI * v));
    dir[2] = (float)cos(KD_PI * v);
}

/* ---- a table against sums over the map, and against its own draws ---- */

#define SPLIT 16                /* points a texel, each way: blocks end at sixteenths of texels */
#define STRATA 400              /* numbers each way, one in each */

/* A table, by sums over a fine grid of directions. */
typedef struct sums {
    double light, pdf, second;  /* integrals of L, pdf and L^2/pdf */
    double ratio;               /* largest L/pdf */
    int dark;                   /* points with light and no density */
} sums;

static sums sum_up(const sampler *s, int bilinear)
{
    sums t = { 0.0, 0.0, 0.0, 0.0, 0 };
    int i, j;

    for (j = 0; j < HEIGHT * SPLIT; j++) {
        const double top = KD_PI * j / (HEIGHT * SPLIT), end = KD_PI * (j + 1) / (HEIGHT * SPLIT);
        const double sr = 2.0 * KD_PI * (cos(top) - cos(end)) / (WIDTH * SPLIT);

        for (i = 0; i < WIDTH * SPLIT; i++) {
            const double u = (i + 0.5) / (WIDTH * SPLIT), v = (j + 0.5) / (HEIGHT * SPLIT);
            const double light = radiance(u, v, bilinear);
            float dir[3];
            double pdf;

            direction(u, v, dir);
            pdf = (double)sampler_pdf(s, dir);
            t.light += light * sr;
            t.pdf += pdf * sr;
            t.dark += light > 0.0 && !(pdf > 0.0);
            if (pdf > 0.0) {
                t.second += light * light / pdf * sr;
                t.ratio = light / pdf > t.ratio ? light / pdf : t.ratio;
            }
        }
    }
    return t;
}

/* What it does, by draws. */
typedef struct draws { double mean; int differ, dark, black, u_is_1; } draws;

static draws draw_all(const sampler *s, int bilinear)
{
    pcg32 random = pcg32_make(1, 2);
    draws d = { 0.0, 0, 0, 0, 0 };
    int i, j;

    for (j = 0; j < STRATA; j++)
        for (i = 0; i < STRATA; i++) {
            const float u0 = ((float)i + pcg32_float(&random)) / STRATA;
            const float u1 = ((float)j + pcg32_float(&random)) / STRATA;
            const envsamp_sample sample = sampler_draw(s, u0, u1);
            const double light = radiance((double)sample.uv[0], (double)sample.uv[1], bilinear);

            d.mean += light / (double)sample.pdf / STRATA / STRATA;
            d.differ += sampler_pdf(s, sample.dir) != sample.pdf;
            d.dark += !(sample.pdf > 0.0f);
            d.black += !(light > 0.0);
            d.u_is_1 += !(sample.uv[0] < 1.0f);
        }
    return d;
}

/* Blocks of whole texels are summed up exactly; those of WARP end anywhere, and where radiance is
   interpolated its largest ratio may lie between the points of the fine grid. One block draws a sun
   so rarely that E[L/pdf] is rough. */
static void test_table(content what, int kind, int bilinear, int blocks)
{
    const int whole = !bilinear && kind != SAMPLER_WARP;
    const double room = whole ? 1e-5 : 2e-2, rough = blocks > 1 ? 2e-2 : 0.1;
    const envsamp_image map = make_map(what);
    sampler_request request = sampler_ask(kind, &map, blocks);
    sampler_info info;
    double second, ratio;
    sums t;
    draws d;
    sampler s;

    request.bilinear = bilinear;
    if (!sampler_make(&s, &request)) {
        CHECK(0, "%s of %s: %s", sampler_names[kind], content_names[what],
              envsamp_result_string(s.result));
        sampler_free(&s);
        return;
    }
    info = sampler_get_info(&s);
    t = sum_up(&s, bilinear);
    d = draw_all(&s, bilinear);
    second = t.second / t.light / t.light;
    ratio = t.ratio / t.light;
    CHECK(!t.dark && fabs(t.pdf - 1.0) <= room
          && fabs(info.integral / t.light - 1.0) <= (bilinear ? 2e-4 : 1e-6), "%s of %s, %d blocks,"
          " bilinear %d: the pdf integrates to %.6f, and is 0 at %d lit points; the integral is "
          "%.1e off", sampler_names[kind], content_names[what], blocks, bilinear, t.pdf, t.dark,
          info.integral / t.light - 1.0);
    CHECK(fabs((1.0 + info.excess_variance) / second - 1.0) <= 0.5 * room, "excess variance %.6f, "
          "told %.6f", second - 1.0, info.excess_variance);
    CHECK(ratio <= info.max_ratio * (bilinear ? 1.0 + 2e-3 : 1.0 + 1e-5)
          && (!whole || ratio >= info.max_ratio * (1.0 - 1e-5)), "largest ratio %.6f, told %.6f",
          ratio, info.max_ratio);
    CHECK(!d.dark && !d.u_is_1 && d.differ * 1000 < STRATA * STRATA
          && (kind != SAMPLER_CDF || bilinear || !d.black) && fabs(d.mean / t.light - 1.0) < rough,
          "E[L/pdf] is %.1e off; in %d draws pdf(dir) differs, in %d it is 0, in %d the map is, in "
          "%d u is 1", d.mean / t.light - 1.0, d.differ, d.dark, d.black, d.u_is_1);
    sampler_free(&s);
}

/* ---- suns ---- */

/* What suns cost at most, 1.5 times of today: a table whose blocks are drawn by their light, not by
   its root mean square, or do not end at the sun, costs more. */
static const double most_excess[SAMPLER_KINDS][2][2] = {    /* sun, lamp; nearest, bilinear */
    { { 5e-5, 0.035 }, { 1e-5, 0.032 } }, { { 2e-5, 0.035 }, { 1e-5, 0.033 } },
    { { 0.47, 0.29 }, { 0.2, 0.165 } }, { { 1e-5, 0.52 }, { 1e-5, 0.77 } }
};

static void test_sun(content what, int kind, int bilinear)
{
    const double most = most_excess[kind][what == LAMP][bilinear];
    const envsamp_image map = make_map(what);
    sampler_request request = sampler_ask(kind, &map, 200);
    sampler s;

    request.bilinear = bilinear;
    sampler_make(&s, &request);
    CHECK(s.result == ENVSAMP_OK && sampler_get_info(&s).excess_variance <= most, "%s of %s, "
          "bilinear %d: excess variance %.6f, at most %.6f", sampler_names[kind],
          content_names[what], bilinear, s.result == ENVSAMP_OK
          ? sampler_get_info(&s).excess_variance : -1.0, most);
    sampler_free(&s);
}

/* Blocks that a lamp is in beside dim texels are drawn more often than by their light: by the root
   of the mean square, which costs least: 2.5 and 2.2. By light alone it is 3.1 and 3.0. */
static void test_stars(int kind, double most)
{
    const envsamp_image map = make_map(STARS);
    sampler_request request = sampler_ask(kind, &map, 8);
    double excess;
    sampler s;

    sampler_make(&s, &request);
    excess = s.result == ENVSAMP_OK ? sampler_get_info(&s).excess_variance : DBL_MAX;
    CHECK(excess <= most, "%s of stars: excess variance %.6f, at most %.6f", sampler_names[kind],
          excess, most);
    sampler_free(&s);
}

/* ---- edges ---- */

/* Directions exactly on edges: they belong to what comes after the edge, as numbers do. */
static void test_edges(int kind)
{
    const envsamp_image map = make_map(HALVES);
    const sampler_request request = sampler_ask(kind, &map, 64);
    const float back[3] = { -1.0f, 0.0f, 0.5f }, after[3] = { -1.0f, -1e-3f, 0.5f };
    const float front[3] = { 1.0f, 0.0f, 0.5f }, first[3] = { 1.0f, 1e-3f, 0.5f };
    const float last[3] = { 1.0f, -1e-3f, 0.5f }, seam[3] = { 1.0f, -1e-30f, 0.5f };
    const float level[3] = { 0.6f, 0.8f, 0.0f }, below[3] = { 0.6f, 0.8f, -1e-3f };
    float uv[2];
    sampler s;

    if (!sampler_make(&s, &request)) {
        CHECK(0, "%s of two halves", sampler_names[kind]);
        sampler_free(&s);
        return;
    }
    CHECK(sampler_pdf(&s, back) == sampler_pdf(&s, after), "%s: u = 1/2 is in the second half",
          sampler_names[kind]);
    CHECK(sampler_pdf(&s, level) == sampler_pdf(&s, below), "%s: the equator is in the lower half",
          sampler_names[kind]);
    CHECK(sampler_pdf(&s, front) == sampler_pdf(&s, first), "%s: u = 0 is in the first half",
          sampler_names[kind]);
    CHECK(sampler_pdf(&s, seam) == sampler_pdf(&s, last), "%s: just below u = 1 is in the second",
          sampler_names[kind]);
    CHECK(sampler_pdf(&s, last) > 1.5f * sampler_pdf(&s, first), "%s: control: which is brighter",
          sampler_names[kind]);
    envsamp_dir_to_uv(ENVSAMP_LATLONG, seam, uv);
    CHECK(uv[0] < 1.0f, "u of a direction is below 1: %.9g", (double)uv[0]);
    sampler_free(&s);
}

/* The same where no cell of a grid begins: an edge at u = 1/4 between two blocks. */
static void test_quarter(int kind)
{
    const envsamp_image map = make_map(QUARTER);
    const sampler_request request = sampler_ask(kind, &map, 2);
    const float on[3] = { 0.0f, 1.0f, 0.5f }, before[3] = { 1e-3f, 1.0f, 0.5f };
    const float after[3] = { -1e-3f, 1.0f, 0.5f };
    sampler s;

    sampler_make(&s, &request);
    CHECK(s.result == ENVSAMP_OK && sampler_pdf(&s, on) == sampler_pdf(&s, after)
          && sampler_pdf(&s, before) < sampler_pdf(&s, after), "%s: u = 1/4 is after it",
          sampler_names[kind]);
    sampler_free(&s);
}

/* Numbers exactly on the edges of WARP's blocks draw the block after the edge. */
static void test_warp_edges(void)
{
    const envsamp_image map = make_map(SUNNY);
    const sampler_request request = sampler_ask(SAMPLER_WARP, &map, 150);
    kd_warp_block blocks[150];
    int i, count = 0, wrong = 0;
    sampler s;

    if (sampler_make(&s, &request))
        count = kd_warp_blocks(s.kd, blocks, 150);
    for (i = 0; i < count; i++) {
        const float u0 = (float)(blocks[i].low[0] / UNIT), u1 = (float)(blocks[i].low[1] / UNIT);
        const float end0 = (float)((blocks[i].high[0] - 1.0) / UNIT);
        const float end1 = (float)((blocks[i].high[1] - 1.0) / UNIT);

        wrong += sampler_draw(&s, u0, u1).pdf != kd_density(&blocks[i]);
        wrong += sampler_draw(&s, end0, end1).pdf != kd_density(&blocks[i]);
    }
    CHECK(count == 150 && !wrong, "WARP: corners of %d blocks draw them, but %d", count, wrong);
    sampler_free(&s);
}

/* The first and the last numbers of each texel of a cdf draw it. Beside a glare most dark texels
   have one number only, which has to lie inside for pdf(dir) to be theirs. */
static void test_cdf_edges(content what)
{
    const envsamp_image map = make_map(what);
    const sampler_request request = sampler_ask(SAMPLER_CDF, &map, 1);
    int i, count = 0, wrong = 0, differ = 0;
    sampler s;

    sampler_make(&s, &request);
    for (i = 0; s.result == ENVSAMP_OK && i < 2 * WIDTH * HEIGHT; i++) {
        const uint32_t x = (uint32_t)(i / 2 % WIDTH), y = (uint32_t)(i / 2 / WIDTH);
        const uint32_t *down = inside_row_edges(s.cdf) + y;
        const uint32_t *across = inside_edges(s.cdf, y) + x, last = (uint32_t)(i % 2);
        const float pdf = inside_texel_pdf(s.cdf, x, y);
        envsamp_sample sample;

        if (down[0] == down[1] || across[0] == across[1])
            continue;
        sample = sampler_draw(&s, (float)(across[last] - last) / (float)UNIT,
                              (float)(down[last] - last) / (float)UNIT);
        wrong += sample.pdf != pdf;
        differ += sampler_pdf(&s, sample.dir) != pdf;
        count++;
    }
    CHECK(count > 0 && !wrong && (what != GLARE || differ * 25 < count), "cdf of %s: of %d numbers"
          " at edges %d draw another texel; pdf(dir) differs in %d", content_names[what], count,
          wrong, differ);
    sampler_free(&s);
}

/* Numbers that are none of [0, 1) draw as the nearest that is, and none draws a u of 1. */
static void test_u_of_1(int kind, int blocks)
{
    const float bad[] = { 1.0f, 2.0f, 1e30f, INFINITY, NAN, -1.0f, -INFINITY };
    const envsamp_image map = make_map(SUNNY);
    const sampler_request request = sampler_ask(kind, &map, blocks);
    const float most = (float)(UNIT - 1) / (float)UNIT;
    int i, wrong = 0, u_is_1 = 0;
    sampler s;

    sampler_make(&s, &request);
    for (i = 0; s.result == ENVSAMP_OK && i < 7; i++) {
        const envsamp_sample a = sampler_draw(&s, bad[i], 0.3f), b = sampler_draw(&s, most, 0.3f);
        const envsamp_sample c = sampler_draw(&s, 0.3f, bad[i]), d = sampler_draw(&s, 0.3f, most);

        wrong += memcmp(&a, &b, sizeof a) != 0;
        wrong += memcmp(&c, &d, sizeof c) != 0;
    }
    for (i = 0; s.result == ENVSAMP_OK && i < 4096; i++)
        u_is_1 += !(sampler_draw(&s, most, (float)(4099 * i) / (float)UNIT).uv[0] < 1.0f);
    CHECK(s.result == ENVSAMP_OK && !wrong && !u_is_1, "%s, %d blocks: 1 and above, NaN and "
          "infinity draw as 1 - 2^-24: %d do not; u of a sample is 1 in %d", sampler_names[kind],
          blocks, wrong, u_is_1);
    sampler_free(&s);
}

/* ---- every number ---- */

/* ALIAS: all 2^24 numbers; each block is drawn exactly as often as its probability says. */
static void test_every_draw(content what, int blocks)
{
    const envsamp_image map = make_map(what);
    const sampler_request request = sampler_ask(SAMPLER_ALIAS, &map, blocks);
    int *drawn = (int *)kd_allocate(((size_t)blocks + 1) * sizeof *drawn);
    int i, count, wrong = 0, sum = 0;
    sampler s;

    sampler_make(&s, &request);
    count = s.result == ENVSAMP_OK ? (int)KD_WORD(s.kd, block_count) : 0;
    for (i = 0; count > 0 && i < UNIT; i++) {
        float u[2];
        int block;

        kd_alias_draw(s.kd, i, u);
        block = inside_alias_block(s.kd, u[0], u[1]);
        drawn[block >= 0 && block < count ? block : blocks]++;
    }
    for (i = 0; i < count; i++) {
        envsamp_kd_block block;

        envsamp_kd_get_block(s.kd, i, &block);
        wrong += fabs((double)block.probability * UNIT / drawn[i] - 1.0) > 3e-7;
        sum += drawn[i];
    }
    CHECK(count > 0 && !wrong && sum == UNIT, "ALIAS of %s, %d blocks: %d are drawn more or less "
          "often than claimed; %d draws", content_names[what], count, wrong, sum);
    free(drawn);
    sampler_free(&s);
}

/* ---- sizes ---- */

/* The smallest maps, of a value that is not black, and black. */
static void test_smallest(int kind)
{
    const float one[9] = { 0.7f, 0.7f, 0.7f, 0.7f, 0.7f, 0.7f, 0.7f, 0.7f, 0.7f };
    const float none[9] = { 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f };
    const int sizes[][2] = { { 1, 1 }, { 1, 3 }, { 3, 1 }, { 2, 2 } };
    int i, wrong = 0, black = 0;

    for (i = 0; i < 2 * 3 * 4; i++) {
        envsamp_image map = kd_image(one, sizes[i % 4][0], sizes[i % 4][1], 1);
        sampler_request request;
        envsamp_sample sample;
        double expected = 0.25 / KD_PI;
        sampler s;

        map.mapping = (envsamp_mapping)(i / 4 % 3);
        expected *= map.mapping == ENVSAMP_HEMISPHERE ? 2.0 : 1.0;
        request = sampler_ask(kind, &map, 5);
        request.bilinear = i / 12;
        if (sampler_make(&s, &request)) {
            sample = sampler_draw(&s, 0.6f, 0.3f);
            wrong += fabs((double)sample.pdf / expected - 1.0) > 1e-5
                  || fabs((double)sampler_pdf(&s, sample.dir) / expected - 1.0) > 1e-5
                  || fabs(sampler_get_info(&s).integral * expected / 0.7 - 1.0) > 1e-6
                  || !sampler_opens(&s);
        } else {
            wrong++;
        }
        sampler_free(&s);
        request.image.pixels = none;
        black += sampler_make(&s, &request) || s.result != ENVSAMP_ERR_BLACK || sampler_opens(&s);
        sampler_free(&s);
    }
    CHECK(!wrong, "%s: maps of 1x1 to 2x2 texels are constant, but %d", sampler_names[kind], wrong);
    CHECK(!black, "%s: black ones are refused, but %d", sampler_names[kind], black);
}

/* ---- sums ---- */

/* Rows of 16384 texels, or as many rows, of nearly the same value: in floats sums of them are 1e-7
   to 1e-5 off. With MIS compensation the integral is summed up ahead of the build. */
static void test_long_sums(int kind, int width, int height)
{
    float *values = (float *)kd_allocate((size_t)width * (size_t)height * sizeof *values);
    const envsamp_image map = kd_image(values, width, height, 1);
    pcg32 random = pcg32_make(5, 5);
    double sum = 0.0, off[2];
    int x, y, i;

    for (y = 0; y < height; y++) {
        const double middle = KD_PI * (y + 0.5) / height, half = 0.5 * KD_PI / height;
        const double sr = 4.0 * KD_PI / width * sin(middle) * sin(half);

        for (x = 0; x < width; x++) {
            values[y * width + x] = 0.7f + 0.01f * pcg32_float(&random);
            sum += (double)values[y * width + x] * sr;
        }
    }
    for (i = 0; i < 2; i++) {
        sampler_request request = sampler_ask(kind, &map, 16);
        sampler s;

        request.compensation = 0.5f * (float)i;
        off[i] = sampler_make(&s, &request) ? sampler_get_info(&s).integral / sum - 1.0 : 1.0;
        sampler_free(&s);
    }
    CHECK(fabs(off[0]) < 1e-9 && fabs(off[1]) < 1e-9, "%s of %dx%d: the integral is %.1e off, and "
          "%.1e with compensation", sampler_names[kind], width, height, off[0], off[1]);
    free(values);
}

/* ---- texels that are none ---- */

/* One bad channel of a pixel among good ones makes the table that 0 there, or a black pixel, makes,
   and is counted; 3 or 4 channels, in rows longer and shorter than what is read at a time. */
static void test_bad_channels(int kind, int channels)
{
    const float bad[] = { -0.01f, NAN, INFINITY, -INFINITY };
    float good[70 * 4], spoiled[70 * 4], mended[70 * 4];
    int i, k, wrong = 0;

    for (i = 0; i < 70 * 4; i++)
        good[i] = 1.0f + 0.01f * (float)i;
    for (i = 0; i < 4 * 3 * 2; i++) {
        const int at = (i / 12 ? 66 : 5) * channels, black = i % 4 > 0;
        envsamp_image map = kd_image(spoiled, 70, 1, channels);
        sampler_request request = sampler_ask(kind, &map, 20);
        sampler s, t;

        memcpy(spoiled, good, sizeof good);
        memcpy(mended, good, sizeof good);
        spoiled[at + i / 4 % 3] = bad[i % 4];
        mended[at + i / 4 % 3] = 0.0f;
        for (k = 0; k < 3 && black; k++)
            mended[at + k] = 0.0f;
        sampler_make(&s, &request);
        request.image.pixels = mended;
        sampler_make(&t, &request);
        wrong += s.result != ENVSAMP_OK || t.result != ENVSAMP_OK
              || sampler_get_info(&s).bad_pixel_count != 1
              || sampler_get_info(&s).integral != sampler_get_info(&t).integral;
        sampler_free(&s);
        sampler_free(&t);
    }
    CHECK(!wrong, "%s, %d channels: a bad one is 0 and counted, but in %d of 24",
          sampler_names[kind], channels, wrong);
}

/* ---- damage ---- */

/* Whether a table opens with one bit of its integral turned over, and the checksum as it was. */
static int opens_flipped(sampler *s)
{
    const size_t at = s->cdf ? CDF_AT(integral) : KD_AT(integral);
    unsigned char *byte = (unsigned char *)s->table.buffer.data + at;
    int opens;

    *byte ^= 1;
    opens = sampler_opens(s);
    *byte ^= 1;
    return opens;
}

/* Whether a table whose word at an offset is replaced opens, with its checksum made right. */
static int opens_with(sampler *s, size_t at, uint32_t word)
{
    unsigned char *byte = (unsigned char *)s->table.buffer.data;
    uint32_t kept;
    int opens;

    memcpy(&kept, byte + at, 4);
    memcpy(byte + at, &word, 4);
    inside_seal(byte, s->table.buffer.bytes);
    opens = sampler_opens(s);
    memcpy(byte + at, &kept, 4);
    return opens;
}

/* The checksum that belongs to a table's bytes; the table keeps its own. */
static uint32_t checksum_of(sampler *s)
{
    const size_t at = s->cdf ? CDF_AT(checksum) : KD_AT(checksum);
    unsigned char *byte = (unsigned char *)s->table.buffer.data;
    uint32_t kept, sum;

    memcpy(&kept, byte + at, 4);
    inside_seal(byte, s->table.buffer.bytes);
    memcpy(&sum, byte + at, 4);
    memcpy(byte + at, &kept, 4);
    return sum;
}

static void flip(unsigned char *at, uint32_t bits)
{
    uint32_t word;

    memcpy(&word, at, 4);
    word ^= bits;
    memcpy(at, &word, 4);
}

/* Two words near the end of a table with the same bit turned over, one of the upper ones: a product
   alone carries them nowhere, and one makes up for the other. */
static void test_checksum(int kind)
{
    enum { WORDS = 64, APART = 8 };
    const envsamp_image map = make_map(SUNNY);
    const sampler_request request = sampler_ask(kind, &map, 40);
    int missed = 0, i, k;
    unsigned bit;
    sampler s;

    sampler_make(&s, &request);
    if (s.result == ENVSAMP_OK) {
        const size_t bytes = s.cdf ? CDF_PLACE(s.cdf, bytes) : KD_WORD(s.kd, bytes);
        const uint32_t whole = checksum_of(&s);

        for (i = 0; i < WORDS; i++)
            for (k = 0; k <= APART; k++)
                for (bit = 28; bit < 32; bit++) {
                    unsigned char *one = (unsigned char *)s.table.buffer.data + bytes - 4 * (i + 1);
                    unsigned char *other = one - 4 * k;

                    flip(one, 1u << bit);
                    flip(other, k ? 1u << bit : 0);
                    missed += checksum_of(&s) == whole;
                    flip(one, 1u << bit);
                    flip(other, k ? 1u << bit : 0);
                }
        CHECK(checksum_of(&s) == whole, "%s: the bytes are as they were", sampler_names[kind]);
    }
    CHECK(s.result == ENVSAMP_OK && !missed,
          "%s: its checksum notices one and two bits that are turned over, but %d",
          sampler_names[kind], missed);
    sampler_free(&s);
}

/* 40 blocks: 64 bins, whose words are own << 6 | alias, so not every alias is a block. */
static void test_damaged_kd(int kind)
{
    const envsamp_image map = make_map(SUNNY);
    const sampler_request request = sampler_ask(kind, &map, 40);
    const uint32_t room = 1u << 18, back = 0x80000000u, infinite = 0x7f800000u;
    uint32_t node, end;
    int opened = 0, whole;
    sampler s;

    sampler_make(&s, &request);
    if (s.result != ENVSAMP_OK || KD_WORD(s.kd, block_count) != 40) {
        CHECK(0, "%s: a table of 40 blocks", sampler_names[kind]);
        sampler_free(&s);
        return;
    }
    whole = opens_with(&s, KD_AT(spare), 0);
    node = KD_WORD(s.kd, nodes_at) + 28 * 5;
    end = KD_WORD(s.kd, grid_at) / 4;           /* in words, as links are */
    opened += opens_with(&s, node + 12, back | node / 4);       /* to itself */
    opened += opens_with(&s, node + 16, back | end);
    opened += opens_with(&s, node + 16, back | (node / 4 + 8));     /* into the middle of one */
    opened += opens_with(&s, node + 16, infinite);
    opened += opens_with(&s, KD_WORD(s.kd, grid_at) + 16, back | end);
    if (kind != SAMPLER_WARP)
        opened += opens_with(&s, (uint32_t)KD_RECORD_AT(2) + 16, infinite);
    if (kind == SAMPLER_ALIAS) {
        opened += opens_with(&s, KD_WORD(s.kd, alias_at), 40);
        opened += opens_with(&s, KD_WORD(s.kd, alias_at), (room + 1) << 6);
        opened += opens_with(&s, KD_WORD(s.kd, alias_at) + 4 * 63, 1u << 6);
    }
    CHECK(whole && !opened, "%s: damaged tables with the right checksum: %d open",
          sampler_names[kind], opened);
    CHECK(!opens_flipped(&s), "nor with the wrong one");
    sampler_free(&s);
}

static void test_damaged_cdf(void)
{
    const envsamp_image map = make_map(SUNNY);
    const sampler_request request = sampler_ask(SAMPLER_CDF, &map, 1);
    uint32_t guides, word;
    int opened = 0, whole, lit;
    float density;
    sampler s;

    if (!sampler_make(&s, &request)) {
        CHECK(0, "cdf: a table");
        sampler_free(&s);
        return;
    }
    memcpy(&guides, (const char *)s.table.buffer.data + CDF_PLACE(s.cdf, guide_at), 4);
    whole = opens_with(&s, CDF_AT(spare), 0);
    opened += opens_with(&s, CDF_PLACE(s.cdf, guide_at), guides + 1);
    opened += opens_with(&s, CDF_PLACE(s.cdf, edges_at), 1);
    opened += opens_with(&s, CDF_PLACE(s.cdf, edges_at) + 4 * WIDTH, UNIT - 1);
    opened += opens_with(&s, CDF_PLACE(s.cdf, edges_at) + 4 * 7, UNIT + 1);
    opened += opens_with(&s, CDF_PLACE(s.cdf, rows_at) + 8, 0x7f800000u);
    memcpy(&density, (const char *)s.table.buffer.data + CDF_PLACE(s.cdf, rows_at) + 8, 4);
    density *= 1.02f;                   /* of the first row: not that of its edges */
    memcpy(&word, &density, 4);
    opened += opens_with(&s, CDF_PLACE(s.cdf, rows_at) + 8, word);
    lit = density > 0.0f;
    CHECK(whole && lit && !opened, "cdf: damaged tables with the right checksum: %d open", opened);
    CHECK(!opens_flipped(&s), "nor with the wrong one");
    sampler_free(&s);
}

int main(void)
{
    const int blocks[] = { 1, 60, 500 };
    int kind, i, k;

    for (kind = 0; kind < SAMPLER_KINDS; kind++) {
        for (i = 0; i < TABLED; i++)
            for (k = kind == SAMPLER_CDF ? 2 : 0; k < 3; k++) {
                test_table((content)i, kind, 0, blocks[k]);
                test_table((content)i, kind, 1, blocks[k]);
            }
        test_edges(kind);
        test_quarter(kind);
        test_u_of_1(kind, 1);
        test_u_of_1(kind, 150);
        test_smallest(kind);
        test_long_sums(kind, 16384, 4);
        test_long_sums(kind, 4, 16384);
        test_bad_channels(kind, 3);
        test_bad_channels(kind, 4);
    }
    for (kind = 0; kind < SAMPLER_KINDS; kind++)
        test_checksum(kind);
    for (kind = 0; kind < SAMPLER_CDF; kind++)
        test_damaged_kd(kind);
    test_damaged_cdf();
    for (kind = 0; kind < SAMPLER_KINDS; kind++)
        for (i = 0; i < 4; i++)
            test_sun(i / 2 ? LAMP : SUNNY, kind, i % 2);
    test_stars(SAMPLER_WARP, 2.7);
    test_stars(SAMPLER_ALIAS, 2.5);
    test_warp_edges();
    test_cdf_edges(SUNNY);
    test_cdf_edges(DARK_PARTS);
    test_cdf_edges(GLARE);
    test_every_draw(SUNNY, 300);
    test_every_draw(DARK_PARTS, 1000);
    return check_done();
}
