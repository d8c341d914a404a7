/* test_kd_faults.c: kd tables of maps that break samplers, and every kind of bad input. */
#include "check.h"

#include "../envsamp.h"

#include "kd_fixture.h"
#include "../examples/common/random.h"

#include <float.h>

/* ---- what a table of a map is worth, by brute force ---- */

typedef struct verdict {
    int built, blocks, overrun;
    double sum, sphere;         /* of probabilities; of the pdf over the sphere: off from 1 */
    int untiled;                /* texels that blocks do not hold exactly once */
    int unsampled;              /* lit texels in blocks whose pdf is 0 */
    int stray;                  /* samples in blocks without a lit texel */
    int unsound;                /* samples that are not unit directions with a pdf */
    double integral, excess, ratio;     /* off, relative */
    kd_fixture f;               /* info only: the memory is freed */
} verdict;

/* Which blocks hold a lit texel. */
static char *lit_blocks(const kd_fixture *f, const kd_cover *c)
{
    char *lit = (char *)kd_allocate((size_t)c->count);
    int i, k;

    for (i = 0; i < c->width * c->height; i++)
        for (k = c->first[i]; k < c->first[i + 1]; k++)
            lit[c->pieces[k].block] |= kd_texel(&f->image, i % c->width, i / c->width) > 0.0;
    return lit;
}

static int sample_is_sound(const envsamp_sample *s)
{
    const double x = (double)s->dir[0], y = (double)s->dir[1], z = (double)s->dir[2];

    return fabs(x * x + y * y + z * z - 1.0) < 3e-6 && s->pdf > 0.0f && s->pdf <= FLT_MAX;
}

/* Whether (u, v) lies in a lit block, its edges included. */
static int point_is_lit(const kd_cover *c, const char *lit, float u, float v)
{
    const double slack_u = 1e-4 / (double)c->width, slack_v = 1e-4 / (double)c->height;
    int i;

    for (i = 0; i < c->count; i++) {
        const kd_rect *r = &c->rects[i];

        if (lit[i] && (double)u >= r->u0 - slack_u && (double)u <= r->u1 + slack_u
            && (double)v >= r->v0 - slack_v && (double)v <= r->v1 + slack_v)
            return 1;
    }
    return 0;
}

static void judge_samples(const kd_fixture *f, const kd_cover *c, verdict *v)
{
    char *lit = lit_blocks(f, c);
    pcg32 random = pcg32_make(29, 0);
    int i;

    for (i = 0; i < 300; i++) {
        const float u0 = i ? pcg32_float(&random) : 0.0f, u1 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(f->kd, i == 1 ? 1.0f : u0, u1);

        v->unsound += !sample_is_sound(&s);
        v->stray += !point_is_lit(c, lit, s.uv[0], s.uv[1]);
    }
    free(lit);
}

/* The density of each block, from a direction in its middle, but where WARP makes blocks so narrow
   that this may round into the next one. */
static double *judge_blocks(const kd_fixture *f, const kd_cover *c, verdict *v)
{
    double *pdfs = (double *)kd_allocate((size_t)c->count * sizeof *pdfs);
    double sum = 0.0, sphere = 0.0;
    int i;

    for (i = 0; i < c->count; i++) {
        const kd_rect *r = &c->rects[i];
        envsamp_kd_block block;
        float dir[3];

        envsamp_kd_get_block(f->kd, i, &block);
        sum += (double)block.probability;
        kd_direction(0.5 * (r->u0 + r->u1), 0.5 * (r->v0 + r->v1), dir);
        pdfs[i] = r->u1 - r->u0 > 2e-6 && r->v1 - r->v0 > 2e-6
                ? (double)envsamp_kd_pdf(f->kd, dir) : r->probability / r->solid_angle;
        sphere += pdfs[i] * r->solid_angle;
    }
    v->sum = fabs(sum - 1.0);
    v->sphere = fabs(sphere - 1.0);
    return pdfs;
}

/* Sums over the map. */
typedef struct totals { double integral, second, ratio; } totals;

static void judge_texel(const kd_cover *c, const double *pdfs, int texel, double value, double sr,
                        totals *s, verdict *v)
{
    int k;

    s->integral += sr * value;
    for (k = c->first[texel]; k < c->first[texel + 1]; k++) {
        const double pdf = pdfs[c->pieces[k].block], part = sr * c->pieces[k].share;

        v->unsampled += value > 0.0 && !(pdf > 0.0);
        if (value > 0.0 && pdf > 0.0) {
            s->second += part * value / pdf * value;
            s->ratio = fmax(s->ratio, value / pdf);
        }
    }
}

static void judge_texels(const kd_fixture *f, const kd_cover *c, verdict *v)
{
    totals s = { 0.0, 0.0, 0.0 };
    double *pdfs = judge_blocks(f, c, v), excess;
    int x, y;

    for (y = 0; y < c->height; y++) {
        const double sr = kd_solid_angle(c->width, c->height, 0, y, 1, y + 1);

        for (x = 0; x < c->width; x++)
            judge_texel(c, pdfs, y * c->width + x, kd_texel(&f->image, x, y), sr, &s, v);
    }
    excess = fmax(s.second / s.integral / s.integral - 1.0, 0.0);
    v->untiled = kd_cover_faults(c);
    v->integral = fabs(f->info.integral / s.integral - 1.0);
    v->excess = fabs(f->info.excess_variance - excess) / (1.0 + excess);
    v->ratio = fabs(f->info.max_ratio / (s.ratio / s.integral) - 1.0);
    free(pdfs);
}

static verdict judge(const envsamp_image *map, const envsamp_kd_desc *desc)
{
    verdict v;
    kd_fixture f;

    memset(&v, 0, sizeof v);
    v.built = kd_fixture_build(&f, map, desc);
    v.overrun = !kd_fixture_intact(&f);
    v.blocks = f.info.block_count;
    if (v.built) {
        kd_cover c = kd_cover_make(&f);

        judge_texels(&f, &c, &v);
        judge_samples(&f, &c, &v);
        kd_cover_free(&c);
    }
    kd_fixture_free(&f);
    return v;
}

/* Variants of a description: ALIAS, then FIT by model and objective, then WARP. */
#define VARIANTS 24

static envsamp_kd_desc variant(int blocks, int index)
{
    const int kind = index / 4;
    envsamp_kd_desc desc = kd_desc(blocks, kind == 0 ? ENVSAMP_KD_ALIAS : ENVSAMP_KD_FIT);

    desc.select = kind == 5 ? ENVSAMP_KD_WARP : desc.select;
    desc.criterion = (envsamp_kd_criterion)(index % 4);
    desc.model = kind > 2 ? ENVSAMP_KD_POWER : ENVSAMP_KD_LOG;
    desc.objective = kind && kind % 2 == 0 ? ENVSAMP_KD_CHI2 : ENVSAMP_KD_L1;
    return desc;
}

/* WARP's tiles cut texels, so blocks may be flat before there are as many as asked. */
static int has_blocks(const envsamp_kd_desc *desc, int blocks, int expected)
{
    if (desc->select == ENVSAMP_KD_WARP && expected > 1)
        return blocks >= 1 && blocks <= expected;
    return blocks == expected;
}

/* Judges a map in every variant; tolerance is relative, of all figures. */
static void check_map(const char *name, const envsamp_image *map, int blocks, int expected,
                      double tolerance)
{
    int i, built = 0, short_of = 0, overrun = 0, unsampled = 0, stray = 0, unsound = 0;
    int untiled = 0;
    double sums = 0.0, figures = 0.0;

    for (i = 0; i < VARIANTS; i++) {
        const envsamp_kd_desc desc = variant(blocks, i);
        const verdict v = judge(map, &desc);

        built += v.built;
        short_of += !has_blocks(&desc, v.blocks, expected);
        overrun += v.overrun;
        untiled += v.untiled;
        unsampled += v.unsampled;
        stray += v.stray;
        unsound += v.unsound;
        sums = fmax(sums, isnan(v.sum + v.sphere) ? HUGE_VAL : fmax(v.sum, v.sphere));
        figures = fmax(figures, isnan(v.integral + v.excess + v.ratio) ? HUGE_VAL
                                : fmax(v.integral, fmax(v.excess, v.ratio)));
    }
    CHECK(built == VARIANTS && !overrun, "%s: %d of %d variants build", name, built, VARIANTS);
    CHECK(!short_of || expected < 0, "%s: %d of them not with %d blocks", name, short_of, expected);
    CHECK(!untiled, "%s: blocks tile the map, but for %d texels", name, untiled);
    CHECK(sums <= 1e-6, "%s: the pdf integrates to 1, but for %.1e", name, sums);
    CHECK(!unsampled, "%s: radiance above 0 has a pdf above 0: %d texels not", name, unsampled);
    CHECK(!stray && !unsound, "%s: samples are sound and hit light: %d and %d not", name, unsound,
          stray);
    CHECK(figures <= tolerance, "%s: integral, excess and ratio are %.1e off", name, figures);
}

/* ---- maps ---- */

#define ANY_COUNT (-1)

static void test_black(void)
{
    float pixels[32] = { 0 };
    const float values[] = { 0.0f, -0.0f, -1.0f, NAN, INFINITY, -INFINITY };
    envsamp_image map = kd_image(pixels, 8, 4, 1);
    int v, i;

    for (v = 0; v < 18; v++) {
        const envsamp_kd_desc desc = kd_desc(16, (envsamp_kd_select)(v / 6));
        kd_fixture f;

        for (i = 0; i < 32; i++)
            pixels[i] = values[v % 6];
        kd_fixture_build(&f, &map, &desc);
        CHECK(f.result == ENVSAMP_ERR_BLACK && !f.kd, "a map of %g only is black",
              (double)values[v % 6]);
        CHECK(kd_fixture_intact(&f), "and nothing is written beside the buffers");
        kd_fixture_free(&f);
    }
}

/* Every number of blocks, the largest of all included, on small maps: what cannot be is refused
   nowhere, and there are no more blocks than asked for. */
static void test_block_counts(int width, int height)
{
    const int counts[] = { 1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13, 23, 24, 25, 100, 1048576 };
    float *pixels = (float *)kd_allocate((size_t)(width * height) * sizeof *pixels);
    envsamp_image map = kd_image(pixels, width, height, 1);
    pcg32 random = pcg32_make(30, (uint64_t)width);
    int i, k, wrong = 0;

    for (i = 0; i < width * height; i++)
        pixels[i] = ldexpf(0.1f + pcg32_float(&random), (int)(pcg32_next(&random) % 24));
    for (i = 0; i < (int)(sizeof counts / sizeof counts[0]); i++)
        for (k = 0; k < 4; k++) {
            envsamp_kd_desc desc = kd_desc(counts[i], ENVSAMP_KD_WARP);
            verdict v;

            desc.criterion = (envsamp_kd_criterion)k;
            v = judge(&map, &desc);
            wrong += !v.built || v.overrun || v.untiled || v.unsampled || v.unsound || v.stray
                  || v.blocks > counts[i] || !(v.sum <= 1e-6 && v.sphere <= 1e-6)
                  || !(v.integral <= 1e-6 && v.excess <= 2e-6 && v.ratio <= 2e-6);
        }
    CHECK(!wrong, "WARP, %dx%d, 1 to 1048576 blocks: %d tables wrong", width, height, wrong);
    free(pixels);
}

/* With blocks enough, the lit texel gets a block of its own: ratio 1, excess 0. The solid angle of
   a table's block is that between edges that are floats: for a texel up to (width + height) 2^-24
   off, for the parts of a texel that tiles of WARP make a little more. */
static void test_lone_texel(int width, int height, int x, int y)
{
    float *pixels = (float *)kd_allocate((size_t)(width * height) * sizeof *pixels);
    envsamp_image map = kd_image(pixels, width, height, 1);
    const double rounding = ldexp((double)(width + height), -24);
    char name[64];
    int i, alone = 0;

    pixels[y * width + x] = 0.25f;
    snprintf(name, sizeof name, "%dx%d lit at (%d, %d)", width, height, x, y);
    check_map(name, &map, 60, ANY_COUNT, 1e-6);
    for (i = 0; i < VARIANTS; i++) {
        const envsamp_kd_desc desc = variant(60, i);
        kd_fixture f;

        kd_fixture_build(&f, &map, &desc);
        alone += f.info.excess_variance < 1e-6 && fabs(f.info.max_ratio - 1.0)
                                        < (desc.select == ENVSAMP_KD_WARP ? 5e-5 : rounding);
        kd_fixture_free(&f);
    }
    CHECK(alone == VARIANTS, "%s: with a block of its own in %d of %d", name, alone, VARIANTS);
    free(pixels);
}

static void test_lone_texels(void)
{
    const int xs[] = { 0, 7, 8, 15 }, ys[] = { 0, 3, 4, 7 };
    int i;

    for (i = 0; i < 16; i++)
        test_lone_texel(16, 8, xs[i % 4], ys[i / 4]);
    test_lone_texel(97, 61, 0, 0);
    test_lone_texel(97, 61, 96, 60);
    test_lone_texel(97, 61, 48, 0);
    test_lone_texel(97, 61, 0, 30);
    test_lone_texel(97, 61, 96, 30);
    test_lone_texel(512, 256, 511, 255);
}

static void test_thin_maps(void)
{
    const int sizes[][2] = { { 1, 1 }, { 1, 2 }, { 2, 1 }, { 1, 300 }, { 300, 1 }, { 2, 999 },
                             { 1, 5000 }, { 5000, 1 }, { 3, 3 } };
    char name[64];
    int s, i;

    for (s = 0; s < 9; s++) {
        const int width = sizes[s][0], height = sizes[s][1], texels = width * height;
        float *pixels = (float *)kd_allocate((size_t)texels * sizeof *pixels);
        envsamp_image map = kd_image(pixels, width, height, 1);
        pcg32 random = pcg32_make(31, (uint64_t)s);

        for (i = 0; i < texels; i++)
            pixels[i] = 0.01f + pcg32_float(&random);
        snprintf(name, sizeof name, "%dx%d", width, height);
        check_map(name, &map, 40, texels < 40 ? texels : 40, 1e-6);
        free(pixels);
    }
}

/* The widest and the tallest map there may be. */
static void test_longest_sides(void)
{
    float *pixels = (float *)kd_allocate(65535 * sizeof *pixels);
    int i;

    for (i = 0; i < 65535; i++)
        pixels[i] = (float)(1 + i % 7);
    for (i = 0; i < 4; i++) {
        const int tall = i % 2;
        envsamp_image map = kd_image(pixels, tall ? 1 : 65535, tall ? 65535 : 1, 1);
        const envsamp_kd_desc desc = kd_desc(500, i < 2 ? ENVSAMP_KD_ALIAS : ENVSAMP_KD_WARP);
        const verdict v = judge(&map, &desc);

        CHECK(v.built && v.blocks == 500 && !v.overrun, "%dx%d builds", map.width, map.height);
        CHECK(v.sum < 1e-6 && v.sphere < 2e-6 && !v.unsampled && !v.unsound && !v.untiled,
              "and its pdf integrates to 1, but for %.1e", v.sphere);
        CHECK(v.integral < 1e-6 && v.excess < 2e-6 && v.ratio < 2e-6, "figures %.1e %.1e %.1e",
              v.integral, v.excess, v.ratio);
    }
    free(pixels);
}

/* No cut of a checkerboard gains anything until its blocks are small. */
static void test_checkerboard(int width, int height, int side)
{
    float *pixels = (float *)kd_allocate((size_t)(width * height) * sizeof *pixels);
    envsamp_image map = kd_image(pixels, width, height, 1);
    const int cells = width / side * (height / side), asked = cells < 400 ? cells : 400;
    char name[64];
    int i;

    for (i = 0; i < width * height; i++)
        pixels[i] = (i % width / side + i / width / side) % 2 ? 1.0f : 0.25f;
    snprintf(name, sizeof name, "%dx%d checkerboard, squares of %d", width, height, side);
    check_map(name, &map, asked, asked, 1e-6);
    free(pixels);
}

/* Noise round 1 with a sun of 2x2 texels. */
static void test_sun(float sun, double tolerance)
{
    static float pixels[96 * 48];
    envsamp_image map = kd_image(pixels, 96, 48, 1);
    pcg32 random = pcg32_make(37, 0);
    char name[64];
    int i;

    for (i = 0; i < 96 * 48; i++)
        pixels[i] = 0.5f + pcg32_float(&random);
    pixels[10 * 96 + 30] = pixels[10 * 96 + 31] = sun;
    pixels[11 * 96 + 30] = pixels[11 * 96 + 31] = sun;
    snprintf(name, sizeof name, "sun of %g", (double)sun);
    check_map(name, &map, 700, 700, tolerance);
}

/* Each texel is `value` times a number, from `low` to 1. */
static void test_scale(const char *name, float value, float low, int channels, double tolerance)
{
    static float pixels[96 * 48 * 3];
    envsamp_image map = kd_image(pixels, 96, 48, channels);
    pcg32 random = pcg32_make(41, 0);
    const int flat = !(low < 1.0f);
    int i;

    for (i = 0; i < 96 * 48 * channels; i++)
        pixels[i] = value * (low + (1.0f - low) * pcg32_float(&random));
    check_map(name, &map, 300, flat ? 1 : 300, tolerance);
}

/* Denormals round to 1.4e-45, and so do the moments that choose the blocks. */
static void test_extreme_values(void)
{
    const float tiny = nextafterf(0.0f, 1.0f);
    static float pixels[64 * 64];
    envsamp_image map = kd_image(pixels, 64, 64, 1);
    verdict v;
    int i;

    test_scale("FLT_MAX everywhere", FLT_MAX, 1.0f, 1, 1e-6);
    test_scale("FLT_MAX in RGB everywhere", FLT_MAX, 1.0f, 3, 1e-6);
    test_scale("noise up to FLT_MAX", FLT_MAX, 0.1f, 1, 1e-6);
    test_scale("RGB noise up to FLT_MAX", FLT_MAX, 0.1f, 3, 1e-6);
    test_scale("noise of 1e-30", 1e-30f, 0.1f, 1, 1e-6);
    test_scale("noise round FLT_MIN", FLT_MIN, 0.1f, 1, 1e-5);
    test_scale("denormal noise", 1e-40f, 0.5f, 1, 1e-4);
    test_scale("denormal RGB noise", 1e-40f, 0.5f, 3, 1e-3);
    test_scale("the least denormal everywhere", tiny, 1.0f, 1, 1e-6);
    pixels[17 * 64 + 5] = tiny;
    for (i = 0; i < 2; i++) {
        const envsamp_kd_desc desc = kd_desc(100, i ? ENVSAMP_KD_WARP : ENVSAMP_KD_ALIAS);

        v = judge(&map, &desc);
        CHECK(v.built && !v.unsampled && !v.unsound && !v.stray && v.sum < 1e-6
              && v.sphere < 1e-6, "select %d: one least denormal is sampled", (int)desc.select);
        CHECK(v.integral < 1e-6, "and is the integral, to %.1e", v.integral);
    }
}

/* A least denormal beside FLT_MAX: 83 orders of magnitude. */
static void test_whole_range(void)
{
    static float pixels[32 * 16];
    envsamp_image map = kd_image(pixels, 32, 16, 1);
    int i;

    for (i = 0; i < 32 * 16; i++)
        pixels[i] = i < 256 ? ldexpf(1.0f, -149 + i % 149) : ldexpf(1.0f, i % 128);
    pixels[0] = FLT_MAX;
    check_map("from the least denormal to FLT_MAX", &map, 200, 200, 1e-5);
}

/* ---- bad pixels ---- */

static int tables_equal(const kd_fixture *a, const kd_fixture *b)
{
    return a->kd && b->kd && envsamp_kd_bytes(a->kd) == envsamp_kd_bytes(b->kd)
        && kd_bits_equal(a->kd, b->kd, envsamp_kd_bytes(a->kd));
}

static int tables_sample_equal(const kd_fixture *a, const kd_fixture *b)
{
    pcg32 random = pcg32_make(43, 0);
    int i;

    for (i = 0; a->kd && b->kd && i < 2000; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(a->kd, u0, u1);
        const envsamp_sample t = envsamp_kd_sample(b->kd, u0, u1);

        if (!kd_bits_equal(&s, &t, sizeof s)
            || envsamp_kd_pdf(a->kd, s.dir) != envsamp_kd_pdf(b->kd, s.dir))
            return 0;
    }
    return i == 2000;
}

/* Puts one bad pixel of each kind in `bad`, and what it counts as in `mended`; returns how many. */
static size_t spoil(float *bad, float *mended, int channels)
{
    const float values[] = { NAN, -NAN, INFINITY, -INFINITY, -1.0f, -FLT_MIN / 4, -FLT_MAX };
    size_t count = 0;
    int v, c, k;

    for (v = 0; v < 7; v++)
        for (c = 0; c < (channels < 3 ? channels : 3); c++, count++) {
            const size_t at = (size_t)(13 + 17 * (int)count) * (size_t)channels;

            bad[at + (size_t)c] = values[v];
            for (k = 0; k < channels; k++)
                mended[at + (size_t)k] = v < 4 || k == c ? 0.0f : mended[at + (size_t)k];
        }
    bad[2 * channels] = NAN;            /* several bad channels are one bad pixel */
    bad[2 * channels + channels - 1] = -1.0f;
    for (k = 0; k < channels; k++)
        mended[2 * channels + k] = 0.0f;
    if (channels == 1)
        mended[2] = 0.0f;
    return count + 1;
}

static void test_bad_pixels(int channels, envsamp_kd_select select)
{
    static float bad[64 * 32 * 4], mended[64 * 32 * 4];
    envsamp_image bad_map = kd_image(bad, 64, 32, channels);
    envsamp_image mended_map = kd_image(mended, 64, 32, channels);
    envsamp_kd_desc desc = kd_desc(200, select);
    pcg32 random = pcg32_make(47, 0);
    kd_fixture a, b;
    size_t count;
    int i;

    for (i = 0; i < 64 * 32 * 4; i++)
        bad[i] = mended[i] = i % 29 ? pcg32_float(&random) : -0.0f;
    count = spoil(bad, mended, channels);
    kd_fixture_build(&a, &bad_map, &desc);
    kd_fixture_build(&b, &mended_map, &desc);
    CHECK(a.result == ENVSAMP_OK && a.info.bad_pixel_count == count,
          "%d channels: %lu bad pixels are counted", channels, (unsigned long)count);
    CHECK(IS(b.result, ENVSAMP_OK) && IS(b.info.bad_pixel_count, 0), "-0 is not one of them");
    CHECK(tables_sample_equal(&a, &b) && a.info.integral == b.info.integral
          && a.info.excess_variance == b.info.excess_variance,
          "bad pixels count as black, negative channels as 0");
    kd_fixture_free(&a);
    kd_fixture_free(&b);
    desc.strict = 1;
    kd_fixture_build(&a, &bad_map, &desc);
    kd_fixture_build(&b, &mended_map, &desc);
    CHECK(IS(a.result, ENVSAMP_ERR_VALUE) && !a.kd && kd_fixture_intact(&a), "strict refuses them");
    CHECK(IS(b.result, ENVSAMP_OK), "and takes a map without");
    kd_fixture_free(&a);
    kd_fixture_free(&b);
}

static void test_strict(void)
{
    const float values[] = { NAN, INFINITY, -INFINITY, -1.0f, -FLT_MIN / 4 };
    static float pixels[37 * 21 * 3];
    envsamp_kd_desc desc = kd_desc(50, ENVSAMP_KD_FIT);
    int v, at, channels, refused = 0, counted = 0;

    for (channels = 1; channels <= 3; channels += 2)
        for (v = 0; v < 5; v++)
            for (at = 0; at < 37 * 21 * channels; at += 37 * channels - 1) {
                envsamp_image map = kd_image(pixels, 37, 21, channels);
                kd_fixture f;
                int i;

                for (i = 0; i < 37 * 21 * channels; i++)
                    pixels[i] = 1.0f;
                pixels[at] = values[v];
                desc.strict = 1;
                kd_fixture_build(&f, &map, &desc);
                refused += f.result != ENVSAMP_ERR_VALUE;
                kd_fixture_free(&f);
                desc.strict = 0;
                kd_fixture_build(&f, &map, &desc);
                counted += f.result != ENVSAMP_OK || f.info.bad_pixel_count != 1;
                kd_fixture_free(&f);
            }
    CHECK(!refused, "strict refuses a bad pixel wherever it is, but for %d", refused);
    CHECK(!counted, "else it is counted, but for %d", counted);
}

/* The fourth channel means nothing, whatever it holds. */
static void test_ignored_channel(envsamp_kd_select select)
{
    static float three[40 * 20 * 3], four[40 * 20 * 4], one[40 * 20];
    envsamp_kd_desc desc = kd_desc(150, select);
    envsamp_image maps[3];
    pcg32 random = pcg32_make(53, 0);
    kd_fixture a, b, c;
    int i, k;

    for (i = 0; i < 40 * 20; i++) {
        for (k = 0; k < 3; k++)
            three[3 * i + k] = four[4 * i + k] = pcg32_float(&random);
        four[4 * i + 3] = i % 3 ? NAN : -1.0f;
        one[i] = envsamp_luminance(three + 3 * i);
    }
    maps[0] = kd_image(three, 40, 20, 3);
    maps[1] = kd_image(four, 40, 20, 4);
    maps[2] = kd_image(one, 40, 20, 1);
    desc.strict = 1;
    kd_fixture_build(&a, &maps[0], &desc);
    kd_fixture_build(&b, &maps[1], &desc);
    kd_fixture_build(&c, &maps[2], &desc);
    CHECK(tables_equal(&a, &b), "four channels make the table of three");
    CHECK(tables_equal(&a, &c), "one channel of luminance makes it too");
    kd_fixture_free(&a);
    kd_fixture_free(&b);
    kd_fixture_free(&c);
}

/* What lies between the rows is not read, nor anything after the last texel. */
static void test_stride(int channels, int padding, envsamp_kd_select select)
{
    const int width = 45, height = 23, row = width * channels, stride = row + padding;
    float *packed = (float *)kd_allocate((size_t)(row * height) * sizeof *packed);
    float *padded = (float *)kd_allocate((size_t)(stride * height - padding) * sizeof *padded);
    envsamp_kd_desc desc = kd_desc(150, select);
    envsamp_image map = kd_image(packed, width, height, channels), wide = map;
    pcg32 random = pcg32_make(59, 0);
    kd_fixture a, b;
    int i;

    for (i = 0; i < stride * height - padding; i++)
        padded[i] = NAN;
    for (i = 0; i < row * height; i++)
        packed[i] = padded[i / row * stride + i % row] = pcg32_float(&random);
    wide.pixels = padded;
    wide.row_stride_bytes = (size_t)stride * sizeof *padded;
    desc.strict = 1;
    kd_fixture_build(&a, &map, &desc);
    kd_fixture_build(&b, &wide, &desc);
    CHECK(tables_equal(&a, &b), "%d channels, rows padded by %d floats: the same table", channels,
          padding);
    kd_fixture_free(&a);
    kd_fixture_free(&b);
    free(packed);
    free(padded);
}

/* ---- bad input ---- */

static float ramp[16 * 8 * 4];

static envsamp_image good_image(void)
{
    int i;

    for (i = 0; i < 16 * 8 * 4; i++)
        ramp[i] = (float)(1 + i % 13);
    return kd_image(ramp, 16, 8, 3);
}

/* Sizes and build both refuse, write nothing beside the buffers, and leave no table. */
static int refused(const envsamp_image *map, const envsamp_kd_desc *desc, envsamp_result expected)
{
    kd_guarded table = kd_guarded_make(8192, 0x3c), scratch = kd_guarded_make(1 << 16, 0x3c);
    const envsamp_kd *kd = (const envsamp_kd *)table.buffer.data, *opened;
    envsamp_sizes sizes = { 1, 1 };
    int good = envsamp_kd_sizes(map, desc, &sizes) == expected;

    good &= sizes.table_bytes == 0 && sizes.scratch_bytes == 0;
    good &= envsamp_kd_build(map, desc, table.buffer, scratch.buffer, &kd) == expected && !kd;
    good &= envsamp_kd_open(table.buffer.data, table.buffer.bytes, &opened) == ENVSAMP_ERR_FORMAT;
    good &= !opened && kd_guarded_intact(&table) && kd_guarded_intact(&scratch);
    free(table.block);
    free(scratch.block);
    return good;
}

static void test_bad_sizes(void)
{
    const int sides[] = { 0, -1, 65536, 2147483647, -2147483647 - 1 };
    const int channels[] = { 0, -1, 2, 5, 100 };
    const size_t strides[] = { 16 * 12 - 4, 4, 1, (size_t)-4, (size_t)-1 / 8 / 4 * 4 + 4 };
    const envsamp_kd_desc desc = kd_desc(8, ENVSAMP_KD_ALIAS);
    envsamp_image map;
    int i;

    for (i = 0; i < 5; i++) {
        map = good_image();
        map.width = sides[i];
        CHECK(refused(&map, &desc, ENVSAMP_ERR_SIZE), "width %d", sides[i]);
        map = good_image();
        map.height = sides[i];
        CHECK(refused(&map, &desc, ENVSAMP_ERR_SIZE), "height %d", sides[i]);
        map = good_image();
        map.channels = channels[i];
        CHECK(refused(&map, &desc, ENVSAMP_ERR_SIZE), "%d channels", channels[i]);
    }
    for (i = 0; i < (int)(sizeof strides / sizeof strides[0]); i++) {
        map = good_image();
        map.row_stride_bytes = strides[i];
        CHECK(refused(&map, &desc, ENVSAMP_ERR_SIZE), "stride %lu", (unsigned long)strides[i]);
    }
}

static int refused_desc(const envsamp_kd_desc *desc)
{
    const envsamp_image map = good_image();

    return refused(&map, desc, ENVSAMP_ERR_PARAM);
}

static void test_bad_descriptions(void)
{
    const int counts[] = { -2, -1, 1048577, 2147483647, -2147483647 - 1 }, wrong[] = { -1, 4, 99 };
    const float compensations[] = { 1.0000001f, -1e-30f, -0.5f, 2.0f, NAN, INFINITY };
    const envsamp_kd_desc good = kd_desc(8, ENVSAMP_KD_FIT);
    envsamp_kd_desc desc;
    int i;

    for (i = 0; i < 5; i++) {
        desc = good;
        desc.block_count = counts[i];
        CHECK(refused_desc(&desc), "%d blocks", counts[i]);
    }
    for (i = 0; i < 3; i++) {
        desc = good;
        desc.select = (envsamp_kd_select)wrong[i];
        CHECK(refused_desc(&desc), "select %d", wrong[i]);
        desc = good;
        desc.criterion = (envsamp_kd_criterion)wrong[i];
        CHECK(refused_desc(&desc), "criterion %d", wrong[i]);
        desc = good;
        desc.model = (envsamp_kd_model)(wrong[i] == 4 ? 2 : wrong[i]);
        CHECK(refused_desc(&desc), "model %d", (int)desc.model);
        desc = good;
        desc.objective = (envsamp_kd_objective)(wrong[i] == 4 ? 2 : wrong[i]);
        CHECK(refused_desc(&desc), "objective %d", (int)desc.objective);
    }
    for (i = 0; i < 6; i++) {
        desc = good;
        desc.mis_compensation = compensations[i];
        CHECK(refused_desc(&desc), "compensation %g", (double)compensations[i]);
    }
}

/* What bounds the refused is accepted: any `nearest`, both ends of compensation. */
static void test_good_descriptions(void)
{
    const int nearest[] = { 0, 1, -7 };
    const float compensations[] = { 0.0f, 0.5f, 1.0f };
    const envsamp_kd *kd;
    int mapping, i, k, select, wrong = 0;

    for (mapping = 0; mapping <= ENVSAMP_OCTAHEDRAL; mapping++)
        for (i = 0; i < 3; i++)
            for (k = 0; k < 3; k++)
                for (select = 0; select <= ENVSAMP_KD_FIT; select++) {
                    envsamp_kd_desc desc = kd_desc(8, (envsamp_kd_select)select);
                    envsamp_image map = good_image();
                    kd_fixture f;

                    map.mapping = (envsamp_mapping)mapping;
                    desc.nearest = nearest[i];
                    desc.mis_compensation = compensations[k];
                    wrong += !kd_fixture_build(&f, &map, &desc) || !kd_fixture_intact(&f)
                          || envsamp_kd_open(f.kd, envsamp_kd_bytes(f.kd), &kd) != ENVSAMP_OK
                          || f.info.nearest != (nearest[i] != 0)
                          || (int)f.info.mapping != mapping
                          || !kd_bits_equal(&f.info.mis_compensation, &compensations[k],
                                            sizeof(float));
                    kd_fixture_free(&f);
                }
    CHECK(!wrong, "mappings, bilinear or not, compensation up to 1: %d of 81 do not build", wrong);
}

static void test_bad_mappings(void)
{
    const int mappings[] = { 3, -1, 99, -2147483647 - 1 };
    const envsamp_kd_desc desc = kd_desc(8, ENVSAMP_KD_ALIAS);
    int i;

    for (i = 0; i < 4; i++) {
        envsamp_image map = good_image();

        map.mapping = (envsamp_mapping)mappings[i];
        CHECK(refused(&map, &desc, ENVSAMP_ERR_PARAM), "mapping %d", mappings[i]);
    }
}

/* Builds with both buffers as given; whether the result is as expected and no table is left. */
static int build_refused(const kd_fixture *f, const envsamp_image *map, envsamp_buffer table,
                         envsamp_buffer scratch, envsamp_result expected)
{
    const envsamp_kd *kd = (const envsamp_kd *)f->table.buffer.data;
    const envsamp_result result = envsamp_kd_build(map, &f->desc, table, scratch, &kd);
    int good = IS(result, expected) && !kd && kd_fixture_intact(f);

    good &= IS(envsamp_kd_open(f->table.buffer.data, f->table.buffer.bytes, &kd),
               ENVSAMP_ERR_FORMAT);
    return good && !kd;
}

static void test_bad_buffers(void)
{
    envsamp_image map = good_image();
    const envsamp_kd_desc desc = kd_desc(8, ENVSAMP_KD_ALIAS);
    envsamp_buffer none = { NULL, 1 << 20 }, moved;
    kd_fixture f;
    int i;

    kd_fixture_build(&f, &map, &desc);
    memset(f.table.buffer.data, 0x3c, f.table.buffer.bytes);
    CHECK(build_refused(&f, &map, none, f.scratch.buffer, ENVSAMP_ERR_NULL), "no table");
    CHECK(build_refused(&f, &map, f.table.buffer, none, ENVSAMP_ERR_NULL), "no scratch");
    CHECK(build_refused(&f, NULL, f.table.buffer, f.scratch.buffer, ENVSAMP_ERR_NULL), "no image");
    map.pixels = NULL;
    CHECK(build_refused(&f, &map, f.table.buffer, f.scratch.buffer, ENVSAMP_ERR_NULL),
          "no pixels");
    map = good_image();
    for (i = 1; i < ENVSAMP_ALIGN; i++) {
        moved = f.table.buffer;
        moved.data = (char *)moved.data + i;
        CHECK(build_refused(&f, &map, moved, f.scratch.buffer, ENVSAMP_ERR_ALIGN),
              "table %d bytes off", i);
        moved = f.scratch.buffer;
        moved.data = (char *)moved.data + i;
        CHECK(build_refused(&f, &map, f.table.buffer, moved, ENVSAMP_ERR_ALIGN),
              "scratch %d bytes off", i);
    }
    kd_fixture_free(&f);
}

static void test_null_results(void)
{
    envsamp_image map = good_image();
    const envsamp_kd_desc desc = kd_desc(8, ENVSAMP_KD_ALIAS);
    envsamp_kd_block block;
    envsamp_kd_info info;
    envsamp_sizes sizes = { 1, 1 };
    kd_fixture f;

    kd_fixture_build(&f, &map, &desc);
    CHECK(IS(envsamp_kd_sizes(&map, &desc, NULL), ENVSAMP_ERR_NULL), "sizes nowhere");
    CHECK(IS(envsamp_kd_sizes(NULL, &desc, &sizes), ENVSAMP_ERR_NULL) && IS(sizes.table_bytes, 0)
          && IS(sizes.scratch_bytes, 0), "sizes of nothing are zero");
    CHECK(IS(envsamp_kd_build(&map, &desc, f.table.buffer, f.scratch.buffer, NULL),
             ENVSAMP_ERR_NULL), "a table nowhere");
    CHECK(IS(envsamp_kd_get_info(NULL, &info), ENVSAMP_ERR_NULL)
          && IS(envsamp_kd_get_info(f.kd, NULL), ENVSAMP_ERR_NULL), "info");
    CHECK(IS(envsamp_kd_get_block(NULL, 0, &block), ENVSAMP_ERR_NULL)
          && IS(envsamp_kd_get_block(f.kd, 0, NULL), ENVSAMP_ERR_NULL), "a block");
    CHECK(IS(envsamp_kd_get_block(f.kd, -1, &block), ENVSAMP_ERR_PARAM)
          && IS(envsamp_kd_get_block(f.kd, f.info.block_count, &block), ENVSAMP_ERR_PARAM)
          && IS(envsamp_kd_get_block(f.kd, f.info.block_count - 1, &block), ENVSAMP_OK),
          "blocks out of range");
    kd_fixture_free(&f);
}

/* A build that fails over a buffer with a good table must not leave that to be opened. */
static void test_stale_table(void)
{
    envsamp_image map = good_image();
    envsamp_kd_desc desc = kd_desc(8, ENVSAMP_KD_ALIAS);
    const envsamp_kd *kd;
    kd_fixture f;
    int i, k;

    for (i = 0; i < 4; i++) {
        const int strict = i % 2;

        map = good_image();
        desc.select = i < 2 ? ENVSAMP_KD_ALIAS : ENVSAMP_KD_WARP;
        desc.strict = 0;
        kd_fixture_build(&f, &map, &desc);
        CHECK(f.kd && IS(envsamp_kd_open(f.kd, f.table.buffer.bytes, &kd), ENVSAMP_OK),
              "a table that opens");
        f.desc.strict = strict;
        for (k = 0; k < 16 * 8 * 3; k++)
            ramp[k] = strict && k ? 1.0f : strict ? NAN : 0.0f;
        CHECK(build_refused(&f, &map, f.table.buffer, f.scratch.buffer,
                            strict ? ENVSAMP_ERR_VALUE : ENVSAMP_ERR_BLACK),
              "does not after a build failed with: %s",
              envsamp_result_string(strict ? ENVSAMP_ERR_VALUE : ENVSAMP_ERR_BLACK));
        kd_fixture_free(&f);
    }
}

int main(void)
{
    test_black();
    test_block_counts(1, 1);
    test_block_counts(2, 1);
    test_block_counts(1, 3);
    test_block_counts(7, 5);
    test_block_counts(12, 6);
    test_block_counts(40, 20);
    test_lone_texels();
    test_thin_maps();
    test_longest_sides();
    test_checkerboard(64, 64, 1);
    test_checkerboard(64, 64, 2);
    test_checkerboard(64, 64, 4);
    test_checkerboard(256, 128, 1);
    test_checkerboard(256, 128, 2);
    test_checkerboard(256, 128, 4);
    test_sun(1e9f, 1e-6);
    test_sun(1e30f, 1e-5);
    test_extreme_values();
    test_whole_range();
    test_bad_pixels(1, ENVSAMP_KD_ALIAS);
    test_bad_pixels(1, ENVSAMP_KD_WARP);
    test_bad_pixels(3, ENVSAMP_KD_ALIAS);
    test_bad_pixels(3, ENVSAMP_KD_WARP);
    test_bad_pixels(4, ENVSAMP_KD_ALIAS);
    test_bad_pixels(4, ENVSAMP_KD_WARP);
    test_strict();
    test_ignored_channel(ENVSAMP_KD_ALIAS);
    test_ignored_channel(ENVSAMP_KD_WARP);
    test_stride(1, 3, ENVSAMP_KD_ALIAS);
    test_stride(1, 3, ENVSAMP_KD_WARP);
    test_stride(3, 1, ENVSAMP_KD_ALIAS);
    test_stride(3, 1, ENVSAMP_KD_WARP);
    test_stride(3, 6, ENVSAMP_KD_ALIAS);
    test_stride(3, 6, ENVSAMP_KD_WARP);
    test_stride(4, 5, ENVSAMP_KD_ALIAS);
    test_stride(4, 5, ENVSAMP_KD_WARP);
    test_bad_sizes();
    test_bad_descriptions();
    test_good_descriptions();
    test_bad_mappings();
    test_bad_buffers();
    test_null_results();
    test_stale_table();
    return check_done();
}
