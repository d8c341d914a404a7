/* Zero is the default: a description of zeros, and one of which a single field was set, give the
   bits that _defaults() gives; what 0 would mean is said by a negative number; fields that are not
   used yet must be 0. */
#include "../envsamp.h"
#include "lights_fixture.h"
#include "check.h"

#include <float.h>

enum { WIDTH = 96, HEIGHT = 48 };

/* Noise with a sun, so that every setting matters. */
static float pixels[3 * WIDTH * HEIGHT];

static envsamp_image make_map(void)
{
    pcg32 random = pcg32_make(3, 5);
    int i;

    for (i = 0; i < 3 * WIDTH * HEIGHT; i++)
        pixels[i] = pcg32_float(&random) + (i / 6 == 700 ? 2000.0f : 0.0f);
    return kd_image(pixels, WIDTH, HEIGHT, 3);
}

/* ---- tables ---- */

/* Whether two descriptions, or NULL, give the same sizes and the same table. */
static int kd_same(const envsamp_kd_desc *a, const envsamp_kd_desc *b)
{
    const envsamp_image map = make_map();
    const envsamp_kd_desc *desc[2];
    const envsamp_kd *kd[2];
    envsamp_sizes sizes[2];
    kd_guarded table[2], scratch[2];
    int i, same = 1;

    desc[0] = a;
    desc[1] = b;
    for (i = 0; i < 2; i++) {
        same &= envsamp_kd_sizes(&map, desc[i], &sizes[i]) == ENVSAMP_OK;
        table[i] = kd_guarded_make(sizes[i].table_bytes, 1 + i);
        scratch[i] = kd_guarded_make(sizes[i].scratch_bytes, 3 + i);
        same &= envsamp_kd_build(&map, desc[i], table[i].buffer, scratch[i].buffer, &kd[i])
             == ENVSAMP_OK;
    }
    same = same && sizes[0].table_bytes == sizes[1].table_bytes
        && sizes[0].scratch_bytes == sizes[1].scratch_bytes
        && envsamp_kd_bytes(kd[0]) == envsamp_kd_bytes(kd[1])
        && !memcmp(kd[0], kd[1], envsamp_kd_bytes(kd[0]));
    for (i = 0; i < 2; i++) {
        free(table[i].block);
        free(scratch[i].block);
    }
    return same;
}

static envsamp_kd_desc kd_zeros(void)
{
    envsamp_kd_desc desc;

    memset(&desc, 0, sizeof desc);
    return desc;
}

static void test_kd(void)
{
    const envsamp_kd_desc defaults = envsamp_kd_defaults();
    envsamp_kd_desc zeros = kd_zeros(), other;
    const envsamp_image map = make_map();
    kd_fixture f;

    CHECK(kd_same(&zeros, &defaults), "kd: zeros are the defaults");
    CHECK(kd_same(NULL, &defaults), "kd: no description is the defaults");
    zeros.block_count = other.block_count = 500;
    other = defaults;
    other.block_count = 500;
    CHECK(kd_same(&zeros, &other), "kd: block_count alone in a description of zeros");
    CHECK(!kd_same(&zeros, &defaults), "kd: rejected: 500 blocks are not the defaults");
    other.criterion = ENVSAMP_KD_SSE;
    CHECK(!kd_same(&zeros, &other), "kd: rejected: SSE is not the default");
    other = zeros;
    other.nearest = 1;
    CHECK(!kd_same(&zeros, &other), "kd: rejected: nearest is not the default");
    zeros = kd_zeros();
    kd_fixture_build(&f, &map, &zeros);
    CHECK(f.info.block_count > 3000 && f.info.block_count <= 6144 && !f.info.nearest,
          "kd: zeros ask for 6144 blocks and bilinear lookups: %d blocks, nearest %d",
          f.info.block_count, f.info.nearest);
    kd_fixture_free(&f);
}

static int cdf_refused(const envsamp_cdf_desc *desc)
{
    const envsamp_image map = make_map();
    envsamp_sizes sizes;

    return envsamp_cdf_sizes(&map, desc, &sizes) == ENVSAMP_ERR_PARAM;
}

static int kd_refused(const envsamp_kd_desc *desc)
{
    const envsamp_image map = make_map();
    envsamp_sizes sizes;

    return envsamp_kd_sizes(&map, desc, &sizes) == ENVSAMP_ERR_PARAM;
}

/* Values out of range and those that another field does not allow are refused. */
static void test_refused(void)
{
    const float values[] = { 1.0f, -1.0f, 0.5f, 2.0f, 2.5f, FLT_MIN, NAN, INFINITY, -INFINITY };
    const int count = (int)(sizeof values / sizeof *values);
    int i, wrong = 0;

    for (i = 0; i < count; i++) {
        envsamp_kd_desc target = kd_zeros(), exponent = kd_zeros();
        envsamp_cdf_desc cdf = envsamp_cdf_defaults();

        target.excess_target = exponent.importance_exponent = cdf.importance_exponent = values[i];
        wrong += kd_refused(&target) != !(values[i] > 0.0f && values[i] <= FLT_MAX);
        wrong += kd_refused(&exponent) != !(values[i] >= 0.5f && values[i] <= 2.0f);
        wrong += cdf_refused(&cdf) != kd_refused(&exponent);
    }
    CHECK(!wrong, "%d of %d values are accepted or refused wrongly", wrong, 3 * count);
    for (i = 0; i < 4; i++) {
        envsamp_kd_desc desc = kd_zeros();

        desc.facing = i % 2 ? 1 : -1;
        desc.select = i < 2 ? ENVSAMP_KD_ALIAS : ENVSAMP_KD_FIT;
        CHECK(kd_refused(&desc), "facing %d is refused without WARP", desc.facing);
    }
}

static int cdf_same(const envsamp_cdf_desc *a, const envsamp_cdf_desc *b)
{
    const envsamp_image map = make_map();
    const envsamp_cdf_desc *desc[2];
    const envsamp_cdf *cdf[2];
    kd_guarded table[2], scratch[2];
    envsamp_sizes sizes;
    int i, same = 1;

    desc[0] = a;
    desc[1] = b;
    for (i = 0; i < 2; i++) {
        same &= envsamp_cdf_sizes(&map, desc[i], &sizes) == ENVSAMP_OK;
        table[i] = kd_guarded_make(sizes.table_bytes, 1 + i);
        scratch[i] = kd_guarded_make(sizes.scratch_bytes, 3 + i);
        same &= envsamp_cdf_build(&map, desc[i], table[i].buffer, scratch[i].buffer, &cdf[i])
             == ENVSAMP_OK;
    }
    same = same && envsamp_cdf_bytes(cdf[0]) == envsamp_cdf_bytes(cdf[1])
        && !memcmp(cdf[0], cdf[1], envsamp_cdf_bytes(cdf[0]));
    for (i = 0; i < 2; i++) {
        free(table[i].block);
        free(scratch[i].block);
    }
    return same;
}

static void test_cdf(void)
{
    const envsamp_cdf_desc defaults = envsamp_cdf_defaults();
    envsamp_cdf_desc zeros;

    memset(&zeros, 0, sizeof zeros);
    CHECK(cdf_same(&zeros, &defaults), "cdf: zeros are the defaults");
    CHECK(cdf_same(NULL, &defaults), "cdf: no description is the defaults");
    zeros.nearest = 1;
    CHECK(!cdf_same(&zeros, &defaults), "cdf: rejected: nearest is not the default");
}

/* ---- lights ---- */

static int lights_same(const envsamp_lights_desc *a, const envsamp_lights_desc *b)
{
    static envsamp_light lights[2][64];
    static uint8_t mask[2][WIDTH * HEIGHT];
    const envsamp_image map = make_map();
    const envsamp_lights_desc *desc[2];
    envsamp_lights_info info[2];
    envsamp_sizes sizes[2];
    float threshold[2] = { 0.0f, 1.0f };
    int i, same = 1;

    desc[0] = a;
    desc[1] = b;
    memset(lights, 0, sizeof lights);
    memset(info, 0, sizeof info);
    for (i = 0; i < 2; i++) {
        kd_guarded scratch;

        same &= envsamp_lights_sizes(&map, desc[i], &sizes[i]) == ENVSAMP_OK;
        scratch = kd_guarded_make(sizes[i].scratch_bytes + (1 << 20), 7 + i);
        same &= envsamp_lights(&map, desc[i], lights[i], 64, scratch.buffer, &info[i])
             == ENVSAMP_OK;
        same &= envsamp_emissive_mask(&map, desc[i], mask[i], scratch.buffer, &threshold[i])
             == ENVSAMP_OK;
        free(scratch.block);
    }
    return same && sizes[0].scratch_bytes == sizes[1].scratch_bytes
        && info[0].count == info[1].count && info[0].direct_count == info[1].direct_count
        && !memcmp(lights[0], lights[1], sizeof lights[0])
        && !memcmp(mask[0], mask[1], sizeof mask[0])
        && !memcmp(&threshold[0], &threshold[1], sizeof threshold[0]);
}

static void test_lights(void)
{
    const envsamp_lights_desc defaults = envsamp_lights_defaults();
    envsamp_lights_desc zeros, other;
    int method;

    memset(&zeros, 0, sizeof zeros);
    CHECK(lights_same(&zeros, &defaults), "lights: zeros are the defaults");
    CHECK(lights_same(NULL, &defaults), "lights: no description is the defaults");
    for (method = 0; method <= ENVSAMP_LIGHTS_RANDOM; method++) {
        other = defaults;
        zeros.method = other.method = (envsamp_lights_method)method;
        CHECK(lights_same(&zeros, &other), "lights, method %d: zeros are the defaults", method);
    }
    zeros.method = other.method = ENVSAMP_LIGHTS_DECOMPOSED;
    other.count = 31;
    CHECK(!lights_same(&zeros, &other), "lights: rejected: 31 lights are not the defaults");
    other = zeros;
    other.weight_energy = 1.0f;
    CHECK(!lights_same(&zeros, &other), "lights: rejected: one weight alone is no default");
}

static envsamp_lights_desc lights_zeros(envsamp_lights_method method)
{
    envsamp_lights_desc desc;

    memset(&desc, 0, sizeof desc);
    desc.method = method;
    return desc;
}

/* A negative number is what 0 would be: as good as a number too small to matter. */
static void test_negative(void)
{
    envsamp_lights_desc a = lights_zeros(ENVSAMP_LIGHTS_DECOMPOSED), b = a;

    a.percentile = a.lambda = a.gamma = -1.0f;
    b.percentile = b.lambda = b.gamma = -1e30f;
    CHECK(lights_same(&a, &b), "lights: thresholds below 0 are 0, whatever their size");
    b.gamma = 0.0f;
    CHECK(!lights_same(&a, &b), "lights: rejected: a threshold of 0 is the default");
    a = b = lights_zeros(ENVSAMP_LIGHTS_DECOMPOSED);     /* with many EnvDirects: */
    a.percentile = b.percentile = 0.5f;
    a.lambda = a.gamma = b.lambda = b.gamma = -1.0f;
    a.mask_scale = -1.0f;
    b.mask_scale = -1e30f;
    CHECK(lights_same(&a, &b), "lights: a mask_scale below 0 is no mask, whatever its size");
    b.mask_scale = 0.0f;
    CHECK(!lights_same(&a, &b), "lights: rejected: no mask is not the default");
    a = b = lights_zeros(ENVSAMP_LIGHTS_RELAXED);
    a.refine_rounds = -1;
    b.refine_rounds = -2147483647 - 1;
    CHECK(lights_same(&a, &b), "lights: rounds below 0 are none, whatever their number");
    b.refine_rounds = 0;
    CHECK(!lights_same(&a, &b), "lights: rejected: no rounds are not the default");
}

/* ---- the rest ---- */

/* Cells, kernel and once of a halftone; the tolerances and iterations of least squares. */
static void test_halftone(void)
{
    envsamp_halftone_desc zeros, said;
    envsamp_texel a[50], b[50];
    kd_guarded scratch = kd_guarded_make(1 << 16, 0);
    envsamp_image map = make_map();
    int count[2] = { 0, 0 }, i, repeats = 0;

    memset(&zeros, 0, sizeof zeros);
    zeros.count = 50;
    said = zeros;
    said.kernel = ENVSAMP_KERNEL_SZIRMAY;
    said.scan = ENVSAMP_SCAN_CELLS;
    envsamp_halftone(map.pixels, WIDTH, HEIGHT, 0, &zeros, a, 50, &count[0], scratch.buffer);
    envsamp_halftone(map.pixels, WIDTH, HEIGHT, 0, &said, b, 50, &count[1], scratch.buffer);
    for (i = 1; i < count[0]; i++)
        repeats += a[i].x == a[i - 1].x && a[i].y == a[i - 1].y;
    CHECK(count[0] == 50 && count[1] == 50 && !memcmp(a, b, sizeof a) && repeats > 10,
          "halftone: zeros are SZIRMAY, CELLS, and a texel may repeat: %d do", repeats);
    said.once = 1;
    envsamp_halftone(map.pixels, WIDTH, HEIGHT, 0, &said, b, 50, &count[1], scratch.buffer);
    CHECK(IS(count[1], 50) && memcmp(a, b, sizeof a),
          "halftone: rejected: once is not the default");
    zeros.count = 0;
    CHECK(IS(envsamp_halftone(map.pixels, WIDTH, HEIGHT, 0, &zeros, a, 50, &count[0],
             scratch.buffer), ENVSAMP_ERR_PARAM), "halftone: a count has no default");
    free(scratch.block);
}

static void rosenbrock(const double *p, double *r, void *user)
{
    (void)user;
    r[0] = 10.0 * (p[1] - p[0] * p[0]);
    r[1] = 1.0 - p[0];
}

static envsamp_lm_info solve(const envsamp_lm_desc *desc, double *params)
{
    kd_guarded scratch = kd_guarded_make(envsamp_lm_scratch_bytes(desc), 0);
    envsamp_lm_info info;

    memset(&info, 0, sizeof info);
    params[0] = -1.2;
    params[1] = 1.0;
    CHECK(IS(envsamp_lm(desc, rosenbrock, NULL, params, scratch.buffer, &info), ENVSAMP_OK),
          "lm: solved");
    free(scratch.block);
    return info;
}

static void test_lm(void)
{
    envsamp_lm_desc zeros, said;
    double a[2], b[2];
    envsamp_lm_info info[2];

    memset(&zeros, 0, sizeof zeros);
    zeros.param_count = zeros.residual_count = 2;
    said = zeros;
    said.max_iterations = 200;
    said.ftol = said.xtol = said.gtol = 1e-12;
    info[0] = solve(&zeros, a);
    info[1] = solve(&said, b);
    CHECK(!memcmp(a, b, sizeof a) && info[0].iterations == info[1].iterations
          && info[0].converged, "lm: zeros are 200 iterations and tolerances of 1e-12");
    said.max_iterations = 3;
    info[1] = solve(&said, b);
    CHECK(info[0].iterations != info[1].iterations, "lm: rejected: 3 iterations");
}

int main(void)
{
    test_kd();
    test_refused();
    test_cdf();
    test_lights();
    test_negative();
    test_halftone();
    test_lm();
    return check_done();
}
