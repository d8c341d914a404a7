/* test_filtered.c: examples/common/filtered.h: levels by hand, integrals, a constant map, what
 * filtering takes from the noise and adds as bias.
 */
#include "check.h"

#include "../envsamp.h"
#include "../examples/common/filtered.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PI 3.14159265358979323846

static image make_map(int width, int height, float value, float noise)
{
    pcg32 random = pcg32_make(3, 5);
    image map;
    int i;

    if (!image_alloc(&map, width, height)) {
        printf("Bail out! no memory\n");
        exit(1);
    }
    for (i = 0; i < 3 * width * height; i++)
        map.rgb[i] = value + noise * pcg32_float(&random);
    return map;
}

static filtered make_levels(const image *map)
{
    filtered f;

    if (!filtered_make(map, &f)) {
        printf("Bail out! no levels\n");
        exit(1);
    }
    return f;
}

/* Mean over the sphere of a channel. */
static double mean_of(const image *map, int c)
{
    double sum = 0.0;
    int x, y;

    for (y = 0; y < map->height; y++)
        for (x = 0; x < map->width; x++)
            sum += (double)map->rgb[3 * (y * map->width + x) + c] / map->width *
                   (cos(PI * y / map->height) - cos(PI * (y + 1) / map->height)) / 2.0;
    return sum;
}

/* ---- levels ---- */

static void test_pyramid(int width, int height, int count)
{
    image map = make_map(width, height, 0.0f, 1.0f);
    filtered f = make_levels(&map);
    double worst = 0.0;
    int i, c;

    for (i = 0; i < f.count; i++)
        for (c = 0; c < 3; c++)
            worst = fmax(worst, fabs(mean_of(&f.levels[i], c) / mean_of(&map, c) - 1.0));
    CHECK(IS(f.count, count) && IS(f.levels[0].width, width) &&
          IS(f.levels[f.count - 1].width, 1) && IS(f.levels[f.count - 1].height, 1) &&
          IS(memcmp(f.levels[0].rgb, map.rgb, 12 * (size_t)(width * height)), 0),
          "%d x %d: %d levels", width, height, f.count);
    CHECK(worst < 1e-6, "all of the map's integral, within %.1g", worst);
    filtered_free(&f);
    CHECK(!f.levels[0].rgb && f.count == 0, "and freed");
    image_free(&map);
}

/* Four texels to one, by solid angle: rows of 4 cover heights of 1 - 0.7071 and 0.7071. */
static void test_by_hand(void)
{
    image map = make_map(8, 4, 0.0f, 0.0f);
    const double low = sqrt(0.5), high = 1.0 - low;
    filtered f;

    map.rgb[0] = 1.0f;                      /* texels (0, 0) and (1, 1) */
    map.rgb[3 * 9] = 10.0f;
    f = make_levels(&map);
    CHECK(IS_NEAR(f.levels[1].rgb[0], 0.5 * high + 5.0 * low, 1e-6) &&
          IS(f.levels[1].rgb[3], 0.0), "a texel of level 1, by hand");
    filtered_free(&f);
    image_free(&map);
}

/* Of the sphere's 32 texels, row 1 has 2 pi / 8 x 0.7071 each. */
static void test_level(void)
{
    image map = make_map(8, 4, 1.0f, 0.0f);
    filtered f = make_levels(&map);
    const double texel = 2.0 * PI / 8.0 * sqrt(0.5), cap = 2.0 * PI / 8.0 * (1.0 - sqrt(0.5));
    const float side[3] = { 0.9f, 0.1f, 0.42426f }, pole[3] = { 0.0f, 0.0f, -1.0f };
    const float one = (float)(1.0 / texel);

    CHECK(IS(f.count, 4) && IS_NEAR(filtered_level(&f, side, one / 16.0f, 1, 0.0f), 2.0, 1e-5) &&
          IS_NEAR(filtered_level(&f, side, one / 16.0f, 4, 0.0f), 1.0, 1e-5) &&
          IS_NEAR(filtered_level(&f, side, one / 32.0f, 8, 0.0f), 1.0, 1e-5), "16 texels: 2");
    CHECK(IS_NEAR(filtered_level(&f, side, one / 4.0f, 1, FILTERED_BIAS), 2.0, 1e-5) &&
          IS_NEAR(filtered_level(&f, side, one / 2.0f, 1, 0.0f), 0.5, 1e-5), "bias, and halves");
    CHECK(IS_NEAR(filtered_level(&f, pole, (float)(0.25 / cap), 1, 0.0f), 1.0, 1e-5),
          "the texels at a pole are smaller");
    CHECK(IS(filtered_level(&f, side, 1e9f, 1000, 1.0f), 0.0) &&
          IS(filtered_level(&f, side, 1e-9f, 1, 0.0f), 3.0) &&
          IS(filtered_level(&f, side, 0.0f, 1, 0.0f), 3.0) &&
          IS(filtered_level(&f, side, NAN, 1, 0.0f), 3.0) &&
          IS(filtered_level(&f, side, INFINITY, 1, 1.0f), 0.0) &&
          IS(filtered_level(&f, side, 1.0f, 0, 0.0f), 3.0), "not beyond the first or the last");
    filtered_free(&f);
    image_free(&map);
}

/* ---- lookups ---- */

static void test_lookup(void)
{
    image flat = make_map(24, 11, 0.7f, 0.0f), map = make_map(32, 16, 0.0f, 1.0f);
    filtered constant = make_levels(&flat), f = make_levels(&map);
    pcg32 random = pcg32_make(1, 1);
    double worst[4] = { 0.0, 0.0, 0.0, 0.0 };
    envsamp_image view;
    int i, c;

    memset(&view, 0, sizeof view);
    view.pixels = map.rgb;
    view.width = 32;
    view.height = 16;
    view.channels = 3;
    for (i = 0; i < 2000; i++) {
        float dir[3], rgb[3], right[3], half[3];
        pcg32_dir(&random, dir);
        filtered_lookup(&constant, dir, powf(10.0f, 4.0f - 8.0f * pcg32_float(&random)), 4, 1.0f,
                        rgb);
        for (c = 0; c < 3; c++)
            worst[0] = fmax(worst[0], fabs((double)rgb[c] - (double)0.7f));
        filtered_lookup(&f, dir, 1e9f, 1, 1.0f, rgb);
        envsamp_lookup(&view, 0, dir, right);
        for (c = 0; c < 3; c++)
            worst[1] = fmax(worst[1], fabs((double)rgb[c] - (double)right[c]));
        filtered_lookup(&f, dir, 0.0f, 1, 1.0f, rgb);
        for (c = 0; c < 3; c++)
            worst[2] = fmax(worst[2], fabs((double)rgb[c] - mean_of(&map, c)));
        filtered_lookup(&f, dir, 1e9f, 1, -100.0f, right);
        filtered_lookup(&f, dir, 1e-9f, 1, -100.0f, half);
        for (c = 0; c < 3; c++)
            worst[3] = fmax(worst[3], fabs((double)half[c] - (double)right[c]));
    }
    CHECK(worst[0] < 1e-6, "a constant map, at any level: within %.1g", worst[0]);
    CHECK(IS(worst[1], 0.0), "many samples: the map itself");
    CHECK(worst[2] < 1e-6, "few: the mean of the map, within %.1g", worst[2]);
    CHECK(IS(worst[3], 0.0), "a bias far below 0: level 0");
    filtered_free(&f);
    filtered_free(&constant);
    image_free(&flat);
    image_free(&map);
}

/* Between two levels radiance is linear. */
static void test_between(void)
{
    image map = make_map(32, 16, 0.0f, 1.0f);
    filtered f = make_levels(&map);
    const float dir[3] = { 0.36f, 0.48f, 0.8f };
    float low[3], middle[3], high[3], pdf = 0.2f, level;
    int c, good = 1;

    level = filtered_level(&f, dir, pdf, 4, 0.0f);
    filtered_lookup(&f, dir, pdf, 4, floorf(level) - level, low);
    filtered_lookup(&f, dir, pdf, 4, 0.25f + floorf(level) - level, middle);
    filtered_lookup(&f, dir, pdf, 4, 1.0f + floorf(level) - level, high);
    for (c = 0; c < 3; c++)
        good &= IS_NEAR(middle[c], 0.75 * (double)low[c] + 0.25 * (double)high[c], 1e-5) &&
                fabsf(low[c] - high[c]) > 1e-3f;
    CHECK(level > 0.0f && level < 4.0f && good, "a quarter of the way from a level to the next");
    filtered_free(&f);
    image_free(&map);
}

/* ---- estimates ---- */

/* RMSE and bias of the map's mean over uniform directions, relative; bias -100: no filter. */
static void estimate(const filtered *f, double right, int count, float bias, double *rmse,
                     double *off)
{
    const int sets = 400;
    pcg32 random = pcg32_make(9, (uint64_t)count);
    double squares = 0.0, sum = 0.0;
    int i, j;

    for (i = 0; i < sets; i++) {
        double mean = 0.0;
        for (j = 0; j < count; j++) {
            float dir[3], rgb[3];
            pcg32_dir(&random, dir);
            filtered_lookup(f, dir, (float)(0.25 / PI), count, bias, rgb);
            mean += (double)rgb[1] / count;
        }
        squares += (mean / right - 1.0) * (mean / right - 1.0) / sets;
        sum += (mean / right - 1.0) / sets;
    }
    *rmse = sqrt(squares);
    *off = sum;
}

static void test_estimates(void)
{
    double rmse[4], off[4];
    image map;
    filtered f;

    if (!map_make("studio", 128, 64, &map))
        return;
    f = make_levels(&map);
    estimate(&f, mean_of(&map, 1), 16, -100.0f, &rmse[0], &off[0]);
    estimate(&f, mean_of(&map, 1), 16, 0.0f, &rmse[1], &off[1]);
    estimate(&f, mean_of(&map, 1), 16, FILTERED_BIAS, &rmse[2], &off[2]);
    estimate(&f, mean_of(&map, 1), 1, FILTERED_BIAS, &rmse[3], &off[3]);
    CHECK(rmse[1] < 0.7 * rmse[0] && rmse[2] < rmse[1],
          "16 samples: relative RMSE %.3f, filtered %.3f, with the published bias %.3f", rmse[0],
          rmse[1], rmse[2]);
    CHECK(fabs(off[2]) < 5.0 * rmse[2] / sqrt(400.0) + 0.01, "their mean is off by %.4f", off[2]);
    CHECK(rmse[3] < 0.5 * rmse[0] / 4.0 && fabs(off[3]) < 0.05,
          "one sample is near the mean: RMSE %.4f", rmse[3]);
    filtered_free(&f);
    image_free(&map);
}

int main(void)
{
    test_pyramid(64, 32, 7);
    test_pyramid(23, 9, 5);
    test_pyramid(1, 1, 1);
    test_pyramid(3, 17, 5);
    test_by_hand();
    test_level();
    test_lookup();
    test_between();
    test_estimates();
    return check_done();
}
