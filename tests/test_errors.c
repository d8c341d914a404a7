/* test_errors.c: examples/common/errors.h against values worked out by hand, against FLIP computed
 * slowly and in another way, and against its published properties.
 *
 *     test_errors [time]     time: what FLIP of 160 x 120 takes, and no tests
 *
 * tests/mutants.txt has the faults that these points must find.
 */
#include "check.h"

#include "../examples/common/errors.h"
#include "../examples/common/random.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define PPD ERROR_FLIP_PPD
#define PI 3.14159265358979323846

/* ---- pictures ---- */

static image flat(int width, int height, float r, float g, float b)
{
    image map;
    size_t i;

    if (!image_alloc(&map, width, height)) {
        printf("Bail out! no memory\n");
        exit(1);
    }
    for (i = 0; i < (size_t)width * (size_t)height; i++) {
        map.rgb[3 * i] = r;
        map.rgb[3 * i + 1] = g;
        map.rgb[3 * i + 2] = b;
    }
    return map;
}

static void set_grey(image *map, int x, int y, float value)
{
    float *at = map->rgb + 3 * ((size_t)y * (size_t)map->width + (size_t)x);

    at[0] = at[1] = at[2] = value;
}

/* Smooth colours, and `noise` times noise on them. */
static image coloured(int width, int height, float noise, uint64_t seed)
{
    image map = flat(width, height, 0.0f, 0.0f, 0.0f);
    pcg32 random = pcg32_make(seed, 1);
    int x, y, c;

    for (y = 0; y < height; y++)
        for (x = 0; x < width; x++)
            for (c = 0; c < 3; c++) {
                const float smooth = 0.5f + 0.4f * sinf(0.3f * (float)x * (float)(c + 1) +
                                                        0.2f * (float)(y * c));
                map.rgb[3 * (y * width + x) + c] = smooth + noise * (pcg32_float(&random) - 0.5f);
            }
    return map;
}

/* Frees both, for values of one pair of pictures. */
static double flip_of(image a, image b)
{
    const double flip = error_flip(&a, &b, 1.0f, PPD, NULL);

    image_free(&a);
    image_free(&b);
    return flip;
}

/* ---- errors of radiance ---- */

/* Two pixels: squares of differences are 1, 4, 0, 0, 0, 9, of sum 14. The reference's mean is 2. */
static void test_radiance(void)
{
    image t = flat(2, 1, 2.0f, 0.0f, 3.0f), r = flat(2, 1, 1.0f, 2.0f, 3.0f);
    image a = flat(1, 1, 1.0f, 1.0f, 1.0f), b = flat(1, 1, 4.0f, 4.0f, 4.0f);
    image one = flat(1, 1, 2.0f, 2.0f, 2.0f);

    t.rgb[3] = 1.0f;
    t.rgb[4] = 2.0f;
    t.rgb[5] = 6.0f;
    CHECK(IS_NEAR(error_mean(&t), 14.0 / 6.0, 1e-12) && IS(error_mean(&r), 2.0), "means");
    CHECK(IS_NEAR(error_rmse(&t, &r), sqrt(14.0 / 6.0), 1e-12), "RMSE");
    CHECK(IS_NEAR(error_relative_rmse(&t, &r), sqrt(14.0 / 6.0) / 2.0, 1e-12), "relative RMSE");
    /* By pixels: (5/3) / 4.04 and (9/3) / 4.04. */
    CHECK(IS_NEAR(error_relative_mse(&t, &r), (5.0 / 3.0 + 3.0) / 4.04 / 2.0, 1e-12),
          "relative MSE");
    CHECK(IS_NEAR(error_mse_two(&one, &a, &b), -2.0, 1e-12),
          "of two references: (2 - 1)(2 - 4) = -2");
    CHECK(IS_NEAR(error_mse_two(&t, &r, &r), 14.0 / 6.0, 1e-12), "of one taken twice: its MSE");
    image_free(&t);
    image_free(&r);
    image_free(&a);
    image_free(&b);
    image_free(&one);
}

/* 1000 pixels: the two worst are left out, the third is not. */
static void test_worst(void)
{
    image t = flat(40, 25, 1.0f, 1.0f, 1.0f), r = flat(40, 25, 1.0f, 1.0f, 1.0f);

    set_grey(&t, 3, 3, 1e6f);
    set_grey(&t, 39, 24, 11.0f);
    CHECK(IS(error_relative_mse(&t, &r), 0.0), "0.2 %% of the pixels are left out");
    set_grey(&t, 0, 0, 3.0f);
    CHECK(IS_NEAR(error_relative_mse(&t, &r), 4.0 / 1.01 / 998.0, 1e-12), "and no more, the worst");
    set_grey(&t, 39, 24, NAN);
    CHECK(isnan(error_relative_mse(&t, &r)), "a NaN is not left out");
    image_free(&t);
    image_free(&r);
}

/* The expected error of a picture without error is 0 by two noisy references, and not by one. */
static void test_two_references(void)
{
    const int side = 200;
    const double count = 3.0 * side * side;
    image truth = flat(side, side, 1.0f, 1.0f, 1.0f), off = flat(side, side, 1.1f, 1.1f, 1.1f);
    image a = flat(side, side, 0.0f, 0.0f, 0.0f), b = flat(side, side, 0.0f, 0.0f, 0.0f);
    pcg32 random = pcg32_make(7, 7);
    size_t i;

    for (i = 0; i < 3 * (size_t)side * (size_t)side; i++) {
        a.rgb[i] = 0.5f + pcg32_float(&random);
        b.rgb[i] = 0.5f + pcg32_float(&random);
    }
    /* A product of two such differences has a standard deviation of 1/12. */
    CHECK(IS_NEAR(error_mse_two(&truth, &a, &b), 0.0, 5.0 / 12.0 / sqrt(count)),
          "two noisy references: no error of what has none");
    CHECK(IS_NEAR(error_mse_two(&truth, &a, &a), 1.0 / 12.0, 1e-3), "one has its own");
    CHECK(IS_NEAR(error_mse_two(&off, &a, &b), 0.01, 1e-3), "two noisy references: 0.1 squared");
    image_free(&truth);
    image_free(&off);
    image_free(&a);
    image_free(&b);
}

static void test_nothing(void)
{
    image a = flat(3, 2, 0.0f, 0.0f, 0.0f), b = flat(2, 3, 0.0f, 0.0f, 0.0f), map;
    image light = flat(3, 2, 1.0f, 1.0f, 1.0f), empty = { 0, 0, NULL };
    const double inf = (double)INFINITY;

    CHECK(isnan(error_rmse(&a, &b)) && isnan(error_relative_rmse(&a, &b)) &&
          isnan(error_relative_mse(&a, &b)) && isnan(error_psnr(&a, &b, 1.0f)) &&
          isnan(error_mse_two(&a, &a, &b)) && isnan(error_mse_two(&a, &b, &a)), "sizes differ");
    CHECK(isnan(error_flip(&a, &b, 1.0f, PPD, &map)) && !map.rgb && isnan(
          error_flip(&empty, &empty, 1.0f, PPD, NULL)) && isnan(error_rmse(&empty, &empty)),
          "sizes differ, or nothing: FLIP and its map");
    CHECK(isnan(error_flip(&a, &a, 1.0f, 0.5f, &map)) && !map.rgb &&
          isnan(error_flip(&a, &a, 1.0f, NAN, NULL)) &&
          isnan(error_flip(&a, &a, 1.0f, 1001.0f, NULL)), "pixels per degree out of range");
    CHECK(error_flip(&a, &light, 1.0f, ERROR_FLIP_PPD_MIN, NULL) > 0.96 &&
          error_flip(&a, &light, 1.0f, ERROR_FLIP_PPD_MAX, NULL) > 0.96, "at both ends of it");
    CHECK(IS(error_relative_rmse(&a, &a), 0.0) && IS(error_relative_mse(&a, &a), 0.0) &&
          error_relative_rmse(&light, &a) == inf && error_relative_mse(&light, &a) == inf,
          "relative to black");
    image_free(&a);
    image_free(&b);
    image_free(&light);
}

/* ---- pictures as shown ---- */

static void test_psnr(void)
{
    image a = flat(4, 2, 0.25f, 0.25f, 0.25f), b = flat(4, 2, 0.0f, 0.0f, 0.0f);
    image bright = flat(4, 2, 7.0f, 2.0f, INFINITY), white = flat(4, 2, 1.0f, 1.0f, 1.0f);

    /* sRGB of 0.25 is 0.537099, of 0.5 0.735357. */
    CHECK(IS_NEAR(error_psnr(&a, &b, 1.0f), -20.0 * log10(0.537099), 1e-4), "PSNR of 0.25");
    CHECK(IS_NEAR(error_psnr(&b, &a, 2.0f), -20.0 * log10(0.735357), 1e-4), "twice as bright");
    CHECK(error_psnr(&a, &a, 1.0f) == (double)INFINITY &&
          error_psnr(&bright, &white, 1.0f) == (double)INFINITY, "what looks the same");
    CHECK(IS_NEAR(error_psnr(&b, &white, 1.0f), 0.0, 1e-12), "black and white: 0 dB");
    b.rgb[4] = NAN;
    CHECK(IS_NEAR(error_psnr(&b, &white, 1.0f), 0.0, 1e-12), "NaN is shown as black");
    image_free(&a);
    image_free(&b);
    image_free(&bright);
    image_free(&white);
}

/* Of flat pictures: CIELAB of the two colours by hand, from the primaries of IEC 61966-2-1. The
 * distance between green and blue is 203.305, whose 0.7th power is 41.2766. */
static void test_flip_flat(void)
{
    static const struct { float a[3], b[3]; double distance, flip; } pairs[] = {
        { { 0, 0, 0 }, { 1, 1, 1 }, 100.0, 0.967379 },
        { { 0, 1, 0 }, { 0, 0, 1 }, 203.304976, 1.0 },
        { { 1, 0, 0 }, { 0, 1, 0 }, 158.463415, 0.986661 },
        { { 1, 0, 0 }, { 0, 0, 1 }, 93.582396, 0.965078 },
        { { 0.18f, 0.18f, 0.18f }, { 0.2f, 0.2f, 0.2f }, 2.341104, 0.104365 },
        { { 0.001f, 0.001f, 0.001f }, { 0, 0, 0 }, 0.903296, 0.053585 },
        { { 0.5f, 0.2f, 0.1f }, { 0.4f, 0.3f, 0.1f }, 17.861516, 0.432816 }
    };
    const double knee = 0.4 * 41.27657;
    int i;

    for (i = 0; i < (int)(sizeof pairs / sizeof pairs[0]); i++) {
        const float *a = pairs[i].a, *b = pairs[i].b;
        const double power = pow(pairs[i].distance, 0.7);
        const double by_hand = power < knee ? 0.95 * power / knee
                                            : 0.95 + 0.05 * (power - knee) / (1.5 * knee);

        CHECK(IS_NEAR(by_hand, pairs[i].flip, 2e-6) &&
              IS_NEAR(flip_of(flat(1, 1, a[0], a[1], a[2]), flat(1, 1, b[0], b[1], b[2])),
                      pairs[i].flip, 5e-5) &&
              IS_NEAR(flip_of(flat(31, 17, a[0], a[1], a[2]), flat(31, 17, b[0], b[1], b[2])),
                      pairs[i].flip, 5e-5), "FLIP of a flat pair, %d: %g", i, pairs[i].flip);
    }
    CHECK(IS_NEAR(flip_of(flat(2, 2, -3.0f, NAN, -INFINITY), flat(2, 2, 9.0f, 1e30f, INFINITY)),
                  0.967379, 5e-5), "beyond black and white");
}

/* ---- FLIP once more, slowly ---- */

/* Whole two-dimensional kernels in double, in degrees; a kernel's sum is not split. */
static double slow_weight(int kind, double x, double y)
{
    const double s = 0.041, g = exp(-(x * x + y * y) / (2.0 * s * s)), r = x * x + y * y;

    switch (kind) {
    case 0: return sqrt(PI / 0.0047) * exp(-PI * PI * r / 0.0047);
    case 1: return sqrt(PI / 0.0053) * exp(-PI * PI * r / 0.0053);
    case 2: return 34.1 * sqrt(PI / 0.04) * exp(-PI * PI * r / 0.04) +
                   13.5 * sqrt(PI / 0.025) * exp(-PI * PI * r / 0.025);
    case 3: return -x * g;
    case 4: return (x * x / (s * s) - 1.0) * g;
    case 5: return -y * g;
    default: return (y * y / (s * s) - 1.0) * g;
    }
}

static double slow_filter(const double *plane, int width, int height, int at_x, int at_y, int kind)
{
    const double ppd = (double)PPD;
    const int radius = (int)ceil((kind < 3 ? 3.0 * sqrt(0.02) / PI : 3.0 * 0.041) * ppd);
    double sums[2] = { 0.0, 0.0 }, weights[2] = { 0.0, 0.0 };
    int x, y;

    for (y = -radius; y <= radius; y++)
        for (x = -radius; x <= radius; x++) {
            const double weight = slow_weight(kind, x / ppd, y / ppd);
            const int from_x = at_x + x < 0 ? 0 : at_x + x >= width ? width - 1 : at_x + x;
            const int from_y = at_y + y < 0 ? 0 : at_y + y >= height ? height - 1 : at_y + y;

            weights[weight < 0.0] += fabs(weight);
            sums[weight < 0.0] += weight * plane[from_y * width + from_x];
        }
    return sums[0] / weights[0] + (weights[1] > 0.0 ? sums[1] / weights[1] : 0.0);
}

static double slow_cube_root(double t)
{
    return t > 0.008856451679 ? pow(t, 1.0 / 3.0) : 7.787037037 * t + 16.0 / 116.0;
}

/* Over white: rows of the matrix are X / Xn, Y and Z / Zn. */
static void slow_xyz(const double rgb[3], double xyz[3])
{
    xyz[0] = 0.433895389 * rgb[0] + 0.376242370 * rgb[1] + 0.189862241 * rgb[2];
    xyz[1] = 0.212636822 * rgb[0] + 0.715183014 * rgb[1] + 0.072180164 * rgb[2];
    xyz[2] = 0.017752423 * rgb[0] + 0.109465611 * rgb[1] + 0.872781966 * rgb[2];
}

/* What is filtered is made again at each pixel: plain, and the reason why this is slow. */
static void slow_seen(const image *map, int x, int y, double lab[3], double features[2])
{
    static const double inverse[3][3] = {
        { 3.080342, -1.537399, -0.542943 }, { -0.921178, 1.875930, 0.045248 },
        { 0.052881, -0.204011, 1.151131 }
    };
    const int count = map->width * map->height;
    double *planes[4], xyz[3], rgb[3], seen[3], size[4];
    int i, c;

    for (c = 0; c < 4; c++)
        planes[c] = (double *)malloc((size_t)count * sizeof(double));
    for (i = 0; i < count; i++) {
        for (c = 0; c < 3; c++)
            rgb[c] = fmin(fmax((double)map->rgb[3 * i + c], 0.0), 1.0);
        slow_xyz(rgb, xyz);
        planes[0][i] = 116.0 * xyz[1] - 16.0;
        planes[1][i] = 500.0 * (xyz[0] - xyz[1]);
        planes[2][i] = 200.0 * (xyz[1] - xyz[2]);
        planes[3][i] = xyz[1];
    }
    for (c = 0; c < 3; c++)
        seen[c] = slow_filter(planes[c], map->width, map->height, x, y, c);
    for (c = 0; c < 4; c++)
        size[c] = slow_filter(planes[3], map->width, map->height, x, y, 3 + c);
    features[0] = hypot(size[0], size[2]);
    features[1] = hypot(size[1], size[3]);
    xyz[1] = (seen[0] + 16.0) / 116.0;
    xyz[0] = seen[1] / 500.0 + xyz[1];
    xyz[2] = xyz[1] - seen[2] / 200.0;
    for (c = 0; c < 3; c++)
        rgb[c] = fmin(fmax(inverse[c][0] * xyz[0] + inverse[c][1] * xyz[1] +
                           inverse[c][2] * xyz[2], 0.0), 1.0);
    slow_xyz(rgb, xyz);
    lab[0] = 116.0 * slow_cube_root(xyz[1]) - 16.0;
    lab[1] = 5.0 * lab[0] * (slow_cube_root(xyz[0]) - slow_cube_root(xyz[1]));
    lab[2] = 2.0 * lab[0] * (slow_cube_root(xyz[1]) - slow_cube_root(xyz[2]));
    for (c = 0; c < 4; c++)
        free(planes[c]);
}

static double slow_flip(const image *a, const image *b, int x, int y)
{
    double lab[2][3], features[2][2], power, colour, edge, point;

    slow_seen(a, x, y, lab[0], features[0]);
    slow_seen(b, x, y, lab[1], features[1]);
    power = pow(fabs(lab[0][0] - lab[1][0]) + hypot(lab[0][1] - lab[1][1], lab[0][2] - lab[1][2]),
                0.7) / 41.27657;
    colour = power < 0.4 ? power * 0.95 / 0.4 : 0.95 + (power - 0.4) * 0.05 / 0.6;
    edge = fabs(features[0][0] - features[1][0]);
    point = fabs(features[0][1] - features[1][1]);
    return pow(colour, 1.0 - sqrt(fmax(edge, point) / sqrt(2.0)));
}

static void check_slow(const char *title, const image *a, const image *b)
{
    double worst = 0.0, sum = 0.0, mean;
    image map;
    int x, y;

    mean = error_flip(a, b, 1.0f, PPD, &map);
    for (y = 0; y < a->height; y++)
        for (x = 0; x < a->width; x++) {
            const double slow = slow_flip(a, b, x, y);
            const double fast = (double)map.rgb[3 * (y * a->width + x) + 1];

            worst = fmax(worst, fabs(slow - fast));
            sum += slow;
        }
    CHECK(worst < 5e-5 && IS_NEAR(mean, sum / (a->width * a->height), 1e-5),
          "%s: each pixel as computed slowly, within %.1g; mean %.6f", title, worst, mean);
    image_free(&map);
}

static void test_flip_slow(void)
{
    image a = coloured(14, 11, 0.0f, 1), b = coloured(14, 11, 0.3f, 2);
    image c = coloured(5, 29, 0.8f, 3), d = coloured(5, 29, 0.1f, 4);
    image dark = flat(14, 11, 0.0f, 0.0f, 0.0f), step = flat(14, 11, 0.0f, 0.0f, 0.0f);
    image pure = flat(14, 11, 0.0f, 0.0f, 0.0f);
    int x, y;

    for (y = 0; y < 11; y++)
        for (x = 7; x < 14; x++)
            set_grey(&step, x, y, 1.0f);
    set_grey(&step, 2, 5, 1.0f);
    /* Blurred by as much as each opponent colour is, they leave what a screen can show. */
    for (y = 0; y < 11; y++)
        for (x = 0; x < 14; x++)
            pure.rgb[3 * (14 * y + x) + (x / 4 + y / 3) % 3] = 1.0f;
    check_slow("pure colours", &pure, &b);
    check_slow("noise", &a, &b);
    check_slow("a tall picture", &c, &d);
    check_slow("an edge and a point", &step, &dark);
    image_free(&a);
    image_free(&b);
    image_free(&c);
    image_free(&d);
    image_free(&dark);
    image_free(&step);
    image_free(&pure);
}

/* ---- FLIP's properties ---- */

static void test_flip_properties(void)
{
    image a = coloured(33, 21, 0.2f, 5), b = coloured(33, 21, 0.9f, 6), map, turned, shifted;
    const double flip = error_flip(&a, &b, 1.0f, PPD, &map);
    double sum = 0.0, least = 1.0, most = 0.0;
    int i, c, grey = 1;

    for (i = 0; i < 33 * 21; i++) {
        const float *at = map.rgb + 3 * i;
        least = fmin(least, (double)at[0]);
        most = fmax(most, (double)at[0]);
        sum += (double)at[0];
        grey &= at[0] == at[1] && at[0] == at[2];
    }
    CHECK(least >= 0.0 && most <= 1.0 && grey && IS_NEAR(sum / (33 * 21), flip, 1e-6),
          "its map is grey, of %.3f to %.3f, whose mean is %.4f", least, most, flip);
    CHECK(IS(error_flip(&a, &a, 1.0f, PPD, NULL), 0.0), "0 of a picture and itself");
    CHECK(IS(error_flip(&b, &a, 1.0f, PPD, NULL), flip), "symmetric");
    turned = flat(33, 21, 0.0f, 0.0f, 0.0f);
    shifted = flat(33, 21, 0.0f, 0.0f, 0.0f);
    for (i = 0; i < 33 * 21; i++)
        for (c = 0; c < 3; c++) {
            turned.rgb[3 * (33 * 21 - 1 - i) + c] = a.rgb[3 * i + c];
            shifted.rgb[3 * (33 * 21 - 1 - i) + c] = b.rgb[3 * i + c];
        }
    CHECK(IS_NEAR(error_flip(&turned, &shifted, 1.0f, PPD, NULL), flip, 1e-5),
          "the same upside down");
    for (i = 0; i < 3 * 33 * 21; i++) {
        turned.rgb[i] = 4.0f * a.rgb[i];
        shifted.rgb[i] = 4.0f * b.rgb[i];
    }
    CHECK(IS(error_flip(&turned, &shifted, 0.25f, PPD, NULL), flip), "exposure is applied");
    image_free(&turned);
    image_free(&shifted);
    image_free(&map);
    image_free(&a);
    image_free(&b);
}

/* The difference at a pixel of two pictures of 41 x 41. */
static double difference_at(const image *a, const image *b, int x, int y)
{
    image map;
    double value;

    error_flip(a, b, 1.0f, PPD, &map);
    value = (double)map.rgb[3 * (41 * y + x)];
    image_free(&map);
    return value;
}

/* One level of grey apart by 2 %: a line or a point shows more than as much of it all over. */
static void test_flip_features(void)
{
    image grey = flat(41, 41, 0.5f, 0.5f, 0.5f), all = flat(41, 41, 0.51f, 0.51f, 0.51f);
    image half = flat(41, 41, 0.5f, 0.5f, 0.5f), point = flat(41, 41, 0.5f, 0.5f, 0.5f);
    image coarse = flat(41, 41, 0.0f, 0.0f, 0.0f), fine = flat(41, 41, 0.0f, 0.0f, 0.0f);
    double everywhere, edge, beyond;
    int x, y;

    for (y = 0; y < 41; y++)
        for (x = 0; x < 41; x++) {
            if (x > 20)
                set_grey(&half, x, y, 0.51f);
            set_grey(&coarse, x, y, x / 10 % 2 ? 1.0f : 0.0f);
            set_grey(&fine, x, y, x % 2 ? 1.0f : 0.0f);
        }
    set_grey(&point, 20, 20, 1.0f);
    everywhere = difference_at(&grey, &all, 20, 20);
    edge = difference_at(&grey, &half, 21, 20);
    beyond = difference_at(&grey, &half, 40, 20);
    /* The step of 0.01 is the response to the edge: power (0.01 / sqrt 2)^0.5 = 0.0841. */
    CHECK(IS_NEAR(beyond, everywhere, 1e-6) && IS(difference_at(&grey, &half, 1, 20), 0.0),
          "far from an edge, colours count alone: %.4f", beyond);
    CHECK(edge > 0.6 * everywhere && edge < pow(everywhere, 1.0 - 0.0841),
          "beside it the eye's blur leaves less of the colour, and the edge counts: %.4f", edge);
    CHECK(difference_at(&grey, &point, 20, 20) > 2.0 * difference_at(&grey, &point, 24, 20) &&
          IS(difference_at(&grey, &point, 40, 20), 0.0), "a point is found, where it is");
    CHECK(difference_at(&fine, &coarse, 20, 20) > 0.5 &&
          error_flip(&fine, &grey, 1.0f, PPD, NULL) <
              0.6 * error_flip(&coarse, &grey, 1.0f, PPD, NULL),
          "stripes too fine to be seen differ less from grey");
    CHECK(error_flip(&fine, &grey, 1.0f, 300.0f, NULL) <
              0.5 * error_flip(&fine, &grey, 1.0f, 20.0f, NULL), "and less from farther away");
    image_free(&grey);
    image_free(&all);
    image_free(&half);
    image_free(&point);
    image_free(&coarse);
    image_free(&fine);
}

static int print_time(void)
{
    image a = coloured(160, 120, 0.0f, 1), b = coloured(160, 120, 0.3f, 2);
    const clock_t start = clock();
    double flip = 0.0;
    int i;

    for (i = 0; i < 20; i++)
        flip = error_flip(&a, &b, 1.0f, PPD, NULL);
    printf("FLIP of 160 x 120: %.1f ms (%.4f)\n",
           1e3 * (double)(clock() - start) / (double)CLOCKS_PER_SEC / 20.0, flip);
    image_free(&a);
    image_free(&b);
    return 0;
}

int main(int count, char **arguments)
{
    if (count > 1 && strcmp(arguments[1], "time") == 0)
        return print_time();
    test_radiance();
    test_worst();
    test_two_references();
    test_nothing();
    test_psnr();
    test_flip_flat();
    test_flip_slow();
    test_flip_properties();
    test_flip_features();
    return check_done();
}
