/* test_rivals.c: examples/render/rivals.h: energy, solid angles, counts, a lone sun, determinism,
 * what is refused, and that the lights are where the light is.
 */
#include "check.h"

#include "../examples/common/maps.h"
#include "../examples/common/random.h"
#include "../examples/render/rivals.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PI 3.14159265358979323846
#define K 32
#define LIGHTS 80

static envsamp_image view_of(const image *map)
{
    const envsamp_image view = { map->rgb, map->width, map->height, 3, 0, ENVSAMP_LATLONG };

    return view;
}

static double row_sr(const image *map, int y)
{
    return 2.0 * PI / map->width * (cos(PI * y / map->height) - cos(PI * (y + 1) / map->height));
}

/* ---- what holds for every map ---- */

static int energy_kept(const image *map, const envsamp_light *lights, int made)
{
    double exact[3] = { 0.0, 0.0, 0.0 }, sums[3] = { 0.0, 0.0, 0.0 }, sr = 0.0;
    int i, x, y, c, good = 1;

    for (y = 0; y < map->height; y++)
        for (x = 0; x < map->width; x++)
            for (c = 0; c < 3; c++)
                exact[c] += row_sr(map, y) * (double)map->rgb[3 * (y * map->width + x) + c];
    for (i = 0; i < made; i++) {
        sr += (double)lights[i].solid_angle;
        for (c = 0; c < 3; c++)
            sums[c] += (double)lights[i].irradiance[c];
    }
    for (c = 0; c < 3; c++)
        good &= IS_NEAR(sums[c] / exact[c], 1.0, 1e-5);
    return good && IS_NEAR(sr / (4.0 * PI), 1.0, 1e-5);
}

/* Unit directions, positive solid angles, and cones that can hold them. */
static int lights_sound(const envsamp_light *lights, int made)
{
    int i, good = 1;

    for (i = 0; i < made; i++) {
        const float *d = lights[i].dir;
        good &= IS_NEAR(d[0] * d[0] + d[1] * d[1] + d[2] * d[2], 1.0, 1e-5);
        good &= lights[i].solid_angle > 0.0f && lights[i].cos_extent <= 1.0f &&
                lights[i].cos_extent >= -1.0f && lights[i].direct == 0;
        good &= 2.0 * PI * (1.0 - (double)lights[i].cos_extent) >
                0.2 * (double)lights[i].solid_angle || lights[i].solid_angle < 1e-2f;
    }
    return good;
}

static void check_map(const char *name, const image *map)
{
    const envsamp_image view = view_of(map);
    envsamp_light lights[LIGHTS], again[LIGHTS];
    int which, made, made_again;

    for (which = 0; which < RIVAL_COUNT; which++) {
        const rival method = (rival)which;
        const envsamp_result result = rival_lights(method, &view, K, 0, lights, &made);
        CHECK(IS(result, ENVSAMP_OK) && IS(made, K) && energy_kept(map, lights, made) &&
              lights_sound(lights, made), "%s, %s: %d lights of all energy", rival_name(method),
              name, made);
        memset(again, 255, sizeof again);
        rival_lights(method, &view, K, 0, again, &made_again);
        CHECK(IS(made_again, made) &&
              IS(memcmp(lights, again, (size_t)made * sizeof *lights), 0), "the same again");
    }
}

static void test_maps(void)
{
    static const char *const names[] = { "sky", "studio", "night", "foliage", "constant" };
    image map;
    int i;

    for (i = 0; i < 5; i++)
        if (map_make(names[i], 128, 64, &map)) {
            check_map(names[i], &map);
            image_free(&map);
        }
}

/* ---- a lone sun ---- */

static image grey_map(int width, int height, float value)
{
    image map;
    int i;

    if (!image_alloc(&map, width, height)) {
        printf("Bail out! no memory\n");
        exit(1);
    }
    for (i = 0; i < 3 * width * height; i++)
        map.rgb[i] = value;
    return map;
}

/* How bright the brightest light is, over the sun of texel (40, 20), and how far away from it. */
static void nearest_light(const image *map, const envsamp_light *lights, int made, double *energy,
                          double *degrees)
{
    double sun = row_sr(map, 20) * (double)map->rgb[3 * (20 * map->width + 40)];
    float dir[3], best = -2.0f;
    int i, at = 0;

    envsamp_uv_to_dir(ENVSAMP_LATLONG, 40.5f / (float)map->width, 20.5f / (float)map->height, dir);
    for (i = 1; i < made; i++)
        if (lights[i].irradiance[0] > lights[at].irradiance[0])
            at = i;
    for (i = 0; i < 3; i++)
        best += dir[i] * lights[at].dir[i] + (i == 0 ? 2.0f : 0.0f);
    *degrees = acos(fmin((double)best, 1.0)) * 180.0 / PI;
    *energy = (double)lights[at].irradiance[0] / sun;
}

/* One texel with half of the light. FHIS has many samples in it, and of the sky as many as that. */
static void test_sun(void)
{
    image map = grey_map(128, 64, 0.1f);
    const double sky = 0.1 * 4.0 * PI;
    envsamp_image view = view_of(&map);
    envsamp_light lights[LIGHTS];
    double energy, degrees;
    int which, made, i, in_sun = 0;

    for (i = 0; i < 3; i++)
        map.rgb[3 * (20 * 128 + 40) + i] = (float)(sky / row_sr(&map, 20));
    for (which = 0; which < RIVAL_FHIS; which++) {
        rival_lights((rival)which, &view, K, 0, lights, &made);
        nearest_light(&map, lights, made, &energy, &degrees);
        CHECK(IS_NEAR(energy, 1.0, 1e-3) && IS_NEAR(degrees, 0.0, 0.05),
              "%s: the sun is a light of its own", rival_name((rival)which));
    }
    rival_lights(RIVAL_FHIS, &view, K, 0, lights, &made);
    for (i = 0; i < made; i++) {
        float uv[2];
        envsamp_dir_to_uv(ENVSAMP_LATLONG, lights[i].dir, uv);
        in_sun += (int)(uv[0] * 128.0f) == 40 && (int)(uv[1] * 64.0f) == 20;
    }
    CHECK(abs(in_sun - K / 2) <= 3, "FHIS: %d of %d samples are in the sun", in_sun, K);
    image_free(&map);
}

/* ---- where the lights are ---- */

/* Of a uniform map, lights are spread: each half of the sphere has half of them and of the energy,
 * and none covers far more than its share. */
static void test_spread(void)
{
    image map = grey_map(128, 64, 1.0f);
    const envsamp_image view = view_of(&map);
    envsamp_light lights[64];
    int which, made, i, c;

    for (which = 0; which < RIVAL_COUNT; which++) {
        double most = 0.0, sum[3] = { 0.0, 0.0, 0.0 };
        int above[3] = { 0, 0, 0 };
        rival_lights((rival)which, &view, 64, 0, lights, &made);
        for (i = 0; i < made; i++) {
            most = fmax(most, (double)lights[i].solid_angle * 64.0 / (4.0 * PI));
            for (c = 0; c < 3; c++) {
                above[c] += lights[i].dir[c] > 0.0f;
                sum[c] += (double)(lights[i].dir[c] * lights[i].irradiance[0]) / (4.0 * PI);
            }
        }
        CHECK(most < 3.0 && abs(above[0] - 32) < 9 && abs(above[1] - 32) < 9 &&
              abs(above[2] - 32) < 9 && fabs(sum[0]) + fabs(sum[1]) + fabs(sum[2]) < 0.1,
              "%s: spread over the sphere: %d, %d, %d of 64 above 0, the largest %.2f of its share",
              rival_name((rival)which), above[0], above[1], above[2], most);
    }
    image_free(&map);
}

/* FHIS draws by density: in the half with three quarters of the light are as many samples. */
static void test_density(void)
{
    image map = grey_map(128, 64, 1.0f);
    const envsamp_image view = view_of(&map);
    envsamp_light lights[1000];
    uint32_t seed;
    int made, i, x, y, c;

    for (y = 0; y < 64; y++)
        for (x = 0; x < 64; x++)
            for (c = 0; c < 3; c++)
                map.rgb[3 * (128 * y + x) + c] = 3.0f;
    for (seed = 0; seed < 4; seed++) {
        int bright = 0;
        rival_lights(RIVAL_FHIS, &view, 1000, seed, lights, &made);
        for (i = 0; i < made; i++)
            bright += lights[i].dir[1] > 0.0f;
        CHECK(abs(bright - 750) < 15, "FHIS, seed %u: %d of 1000 samples in the half of 750",
              (unsigned)seed, bright);
    }
    image_free(&map);
}

/* Samples of a uniform map keep apart: shares of the sphere that are nearest to each vary less than
 * those of independent samples, whose deviation is 0.53 of their mean. */
static void test_evenness(void)
{
    image map = grey_map(256, 128, 1.0f);
    const envsamp_image view = view_of(&map);
    envsamp_light lights[500];
    double squares = 0.0;
    uint32_t seed;
    int made, i;

    for (seed = 0; seed < 4; seed++) {
        rival_lights(RIVAL_FHIS, &view, 500, seed, lights, &made);
        for (i = 0; i < made; i++) {
            const double off = (double)lights[i].solid_angle * 500.0 / (4.0 * PI) - 1.0;
            squares += off * off / 2000.0;
        }
    }
    CHECK(IS_NEAR(sqrt(squares), 0.29, 0.04), "FHIS: shares of the sphere vary by %.3f",
          sqrt(squares));
    image_free(&map);
}

/* ---- small maps, other layouts, and what is refused ---- */

static void test_small(void)
{
    image map = grey_map(1, 1, 2.0f), few = grey_map(16, 8, 0.0f);
    envsamp_image view = view_of(&map);
    envsamp_light lights[K];
    envsamp_result result;
    int which, made, i;

    for (i = 0; i < 15; i++)
        few.rgb[3 * (17 * (i / 3) + 9) + i % 3] = 1.0f + (float)i;
    for (which = 0; which < RIVAL_COUNT; which++) {
        const rival method = (rival)which;
        view = view_of(&map);
        result = rival_lights(method, &view, K, 0, lights, &made);
        CHECK(IS(result, ENVSAMP_OK) && IS(made, method == RIVAL_FHIS ? K : 1) &&
              energy_kept(&map, lights, made), "%s: 1 x 1 texel, %d lights", rival_name(method),
              made);
        view = view_of(&few);
        result = rival_lights(method, &view, K, 0, lights, &made);
        CHECK(IS(result, ENVSAMP_OK) && (made == 5 || method != RIVAL_STRUCTURED) &&
              energy_kept(&few, lights, made), "%s: 5 lit texels, %d lights", rival_name(method),
              made);
    }
    image_free(&map);
    image_free(&few);
}

/* Padded rows of four channels, a NaN and a negative number: the same as when they are clean. */
static void test_layouts(void)
{
    float padded[16][33 * 4];
    image map;
    envsamp_image view;
    envsamp_light lights[K], other[K];
    int which, made, x, y, c;

    if (!map_make("studio", 32, 16, &map))
        return;
    for (c = 0; c < 3; c++)
        map.rgb[3 * 100 + c] = 0.0f;
    for (y = 0; y < 16; y++)
        for (x = 0; x < 33; x++)
            for (c = 0; c < 4; c++)
                padded[y][4 * x + c] = x < 32 && c < 3 ? map.rgb[3 * (32 * y + x) + c] : 1e9f;
    padded[3][4 * 4] = NAN;
    padded[3][4 * 4 + 1] = -1.0f;
    padded[3][4 * 4 + 2] = INFINITY;
    for (which = 0; which < RIVAL_COUNT; which++) {
        view = view_of(&map);
        rival_lights((rival)which, &view, K, 0, lights, &made);
        view.pixels = padded[0];
        view.channels = 4;
        view.row_stride_bytes = sizeof padded[0];
        rival_lights((rival)which, &view, K, 0, other, &made);
        CHECK(IS(made, K) && IS(memcmp(lights, other, sizeof lights), 0),
              "%s: strides, four channels, no radiance", rival_name((rival)which));
    }
    image_free(&map);
}

static void test_refused(void)
{
    image map = grey_map(8, 4, 1.0f), black = grey_map(8, 4, 0.0f);
    envsamp_image view = view_of(&map), bad = view_of(&map);
    envsamp_light lights[K];
    int made = 7, which;

    CHECK(IS(rival_lights(RIVAL_TMMS, NULL, K, 0, lights, &made), ENVSAMP_ERR_NULL) &&
          IS(rival_lights(RIVAL_TMMS, &view, K, 0, NULL, &made), ENVSAMP_ERR_NULL) &&
          IS(rival_lights(RIVAL_TMMS, &view, K, 0, lights, NULL), ENVSAMP_ERR_NULL), "NULL");
    CHECK(IS(rival_lights(RIVAL_TMMS, &view, 0, 0, lights, &made), ENVSAMP_ERR_PARAM) &&
          IS(made, 0) && IS(rival_lights(RIVAL_TMMS, &view, RIVAL_LIGHTS_MAX + 1, 0, lights, &made),
          ENVSAMP_ERR_PARAM) && IS(rival_lights(RIVAL_COUNT, &view, K, 0, lights, &made),
          ENVSAMP_ERR_PARAM), "counts, methods");
    bad.width = 0;
    CHECK(IS(rival_lights(RIVAL_FHIS, &bad, K, 0, lights, &made), ENVSAMP_ERR_SIZE), "no width");
    bad = view;
    bad.channels = 2;
    CHECK(IS(rival_lights(RIVAL_FHIS, &bad, K, 0, lights, &made), ENVSAMP_ERR_SIZE), "channels");
    bad = view;
    bad.row_stride_bytes = 8;
    CHECK(IS(rival_lights(RIVAL_FHIS, &bad, K, 0, lights, &made), ENVSAMP_ERR_SIZE), "stride");
    bad = view;
    bad.mapping = ENVSAMP_OCTAHEDRAL;
    CHECK(IS(rival_lights(RIVAL_FHIS, &bad, K, 0, lights, &made), ENVSAMP_ERR_PARAM), "mapping");
    view = view_of(&black);
    for (which = 0; which < RIVAL_COUNT; which++)
        CHECK(IS(rival_lights((rival)which, &view, K, 0, lights, &made), ENVSAMP_ERR_BLACK) &&
              IS(made, 0), "%s: a black map", rival_name((rival)which));
    CHECK(strcmp(rival_name((rival)9), "unknown") == 0, "a name for no method");
    image_free(&map);
    image_free(&black);
}

int main(void)
{
    test_maps();
    test_sun();
    test_spread();
    test_density();
    test_evenness();
    test_small();
    test_layouts();
    test_refused();
    return check_done();
}
