/* errors.c: see errors.h. The symbols of FLIP's paper are named where its constants stand. */
#include "errors.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define WORST_SHARE 0.002       /* of the pixels, left out by error_relative_mse */
#define DARK 0.01               /* of the squared mean, added to squared radiance */

static size_t value_count(const image *map)
{
    return 3 * (size_t)map->width * (size_t)map->height;
}

static int same_size(const image *a, const image *b)
{
    return a->rgb && b->rgb && a->width == b->width && a->height == b->height;
}

double error_mean(const image *map)
{
    const size_t count = value_count(map);
    double sum = 0.0;
    size_t i;

    for (i = 0; i < count; i++)
        sum += (double)map->rgb[i];
    return count > 0 ? sum / (double)count : (double)NAN;
}

/* ---- of radiance ---- */

double error_mse_two(const image *test, const image *a, const image *b)
{
    const size_t count = value_count(test);
    double sum = 0.0;
    size_t i;

    if (!same_size(test, a) || !same_size(test, b))
        return (double)NAN;
    for (i = 0; i < count; i++)
        sum += ((double)test->rgb[i] - (double)a->rgb[i]) *
               ((double)test->rgb[i] - (double)b->rgb[i]);
    return sum / (double)count;
}

double error_rmse(const image *test, const image *reference)
{
    return sqrt(error_mse_two(test, reference, reference));
}

/* What is relative to nothing is infinite, unless it is nothing. */
static double ratio(double error, double size)
{
    if (isnan(error) || error == 0.0)
        return error;
    return size > 0.0 ? error / size : (double)INFINITY;
}

double error_relative_rmse(const image *test, const image *reference)
{
    const double rmse = error_rmse(test, reference);

    return isnan(rmse) ? rmse : ratio(rmse, error_mean(reference));
}

static double pixel_relative(const float *test, const float *reference, double least)
{
    double squares = 0.0, mean = 0.0;
    int c;

    for (c = 0; c < 3; c++) {
        const double error = (double)test[c] - (double)reference[c];
        squares += error * error / 3.0;
        mean += (double)reference[c] / 3.0;
    }
    return ratio(squares, mean * mean + least);
}

static int compare_doubles(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

double error_relative_mse(const image *test, const image *reference)
{
    const size_t count = value_count(test) / 3;
    const size_t kept = count - (size_t)(WORST_SHARE * (double)count);
    double *errors, sum = 0.0, mean;
    int unordered = 0;
    size_t i;

    if (!same_size(test, reference))
        return (double)NAN;
    errors = (double *)malloc(count * sizeof *errors);
    if (!errors)
        return (double)NAN;
    mean = error_mean(reference);
    for (i = 0; i < count; i++) {
        errors[i] = pixel_relative(test->rgb + 3 * i, reference->rgb + 3 * i, DARK * mean * mean);
        unordered |= isnan(errors[i]);
    }
    qsort(errors, count, sizeof *errors, compare_doubles);
    for (i = 0; i < kept; i++)
        sum += errors[i];
    free(errors);
    return unordered ? (double)NAN : sum / (double)kept;
}

/* ---- of pictures as shown ---- */

/* 0 to 1; what is no radiance is 0. */
static double shown_value(float radiance, float exposure)
{
    const float value = radiance * exposure;

    if (!(value > 0.0f))
        return 0.0;
    return value < 1.0f ? (double)value : 1.0;
}

static double encode_srgb(double linear)
{
    return linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1.0 / 2.4) - 0.055;
}

double error_psnr(const image *test, const image *reference, float exposure)
{
    const size_t count = value_count(test);
    double sum = 0.0;
    size_t i;

    if (!same_size(test, reference))
        return (double)NAN;
    for (i = 0; i < count; i++) {
        const double error = encode_srgb(shown_value(test->rgb[i], exposure)) -
                             encode_srgb(shown_value(reference->rgb[i], exposure));
        sum += error * error;
    }
    return sum > 0.0 ? -10.0 * log10(sum / (double)count) : (double)INFINITY;
}

/* ---- FLIP: constants of the paper ---- */

#define PI 3.14159265358979323846
#define COLOUR_EXPONENT 0.7     /* q_c */
#define COLOUR_KNEE 0.4         /* p_c: below this share of the largest difference ... */
#define COLOUR_SHARE 0.95       /* p_t: ... differences take this share of the range */
#define FEATURE_DEGREES 0.082   /* w: width of an edge or point that one sees */
#define FEATURE_EXPONENT 0.5    /* q_f */
#define WIDEST 0.04             /* largest b of `sensitivity` */
#define RADIUS_MAX 160          /* pixels, at ERROR_FLIP_PPD_MAX */

/* Contrast sensitivity to luminance, red-green and blue-yellow: a sum of two Gaussians, of spatial
 * frequency squared, with weights a and widths b. */
static const struct { double a[2], b[2]; } sensitivity[3] = {
    { { 1.0, 0.0 }, { 0.0047, 1e-5 } },
    { { 1.0, 0.0 }, { 0.0053, 1e-5 } },
    { { 34.1, 13.5 }, { 0.04, 0.025 } }
};

typedef struct matrix { double m[3][3]; } matrix;

/* Linear sRGB to XYZ, each over that of white, which is D65 at (0.3127, 0.3290). */
static const matrix to_xyz = { {
    { 10135552.0 / 23359437.0, 8788810.0 / 23359437.0, 4435075.0 / 23359437.0 },
    { 2613072.0 / 12288897.0, 8788810.0 / 12288897.0, 887015.0 / 12288897.0 },
    { 1425312.0 / 80288307.0, 8788810.0 / 80288307.0, 70074185.0 / 80288307.0 }
} };

/* ---- FLIP: filters ---- */

/* A row of weights, the middle one at `radius`. */
typedef struct kernel { int radius; float weights[2 * RADIUS_MAX + 1]; } kernel;

/* Weights above zero sum to 1, those below to -1. */
static void kernel_normalise(kernel *k, const double *weights)
{
    double above = 0.0, below = 0.0;
    int i;

    for (i = 0; i <= 2 * k->radius; i++) {
        above += weights[i] > 0.0 ? weights[i] : 0.0;
        below -= weights[i] < 0.0 ? weights[i] : 0.0;
    }
    for (i = 0; i <= 2 * k->radius; i++)
        k->weights[i] = (float)(weights[i] < 0.0 ? weights[i] / below : weights[i] / above);
}

/* exp(-pi^2 x^2 / b), x in degrees. Returns the sum of its weights before they are normalised. */
static double kernel_sensitivity(kernel *k, double b, double ppd)
{
    double weights[2 * RADIUS_MAX + 1], sum = 0.0;
    int i;

    k->radius = (int)ceil(3.0 * sqrt(WIDEST / (2.0 * PI * PI)) * ppd);
    for (i = 0; i <= 2 * k->radius; i++) {
        const double x = (i - k->radius) / ppd;
        weights[i] = exp(-PI * PI * x * x / b);
        sum += weights[i];
    }
    kernel_normalise(k, weights);
    return sum;
}

/* A Gaussian and its first and second derivative, up to factors that normalising removes. */
static void kernel_features(kernel k[3], double ppd)
{
    const double deviation = 0.5 * FEATURE_DEGREES * ppd;
    double weights[3][2 * RADIUS_MAX + 1];
    int i;

    k[0].radius = k[1].radius = k[2].radius = (int)ceil(3.0 * deviation);
    for (i = 0; i <= 2 * k[0].radius; i++) {
        const double x = (i - k[0].radius) / deviation;
        weights[0][i] = exp(-0.5 * x * x);
        weights[1][i] = -x * weights[0][i];
        weights[2][i] = (x * x - 1.0) * weights[0][i];
    }
    for (i = 0; i < 3; i++)
        kernel_normalise(&k[i], weights[i]);
}

static int clamp(int i, int count)
{
    return i < 0 ? 0 : i < count ? i : count - 1;
}

static void add_scaled(float *to, const float *from, float scale, int count)
{
    int x;

    for (x = 0; x < count; x++)
        to[x] += scale * from[x];
}

/* Planes of a picture being filtered, of width x height values each; `row` has room for a row and a
 * margin of RADIUS_MAX at both ends. */
typedef struct workspace { int width, height; float *row, *across; } workspace;

/* Adds `scale` times the plane, filtered along rows by h and along columns by v, to `out`. What
 * lies outside is as the nearest pixel. */
static void filter(const workspace *space, const float *plane, const kernel *h, const kernel *v,
                   float scale, float *out)
{
    const int width = space->width, height = space->height;
    int x, y, i;

    memset(space->across, 0, (size_t)width * (size_t)height * sizeof(float));
    for (y = 0; y < height; y++) {
        const float *from = plane + (size_t)y * (size_t)width;
        float *to = space->across + (size_t)y * (size_t)width;
        for (x = -h->radius; x < width + h->radius; x++)
            space->row[x + h->radius] = from[clamp(x, width)];
        for (i = 0; i <= 2 * h->radius; i++)
            add_scaled(to, space->row + i, h->weights[i], width);
    }
    for (y = 0; y < height; y++)
        for (i = 0; i <= 2 * v->radius; i++)
            add_scaled(out + (size_t)y * (size_t)width,
                       space->across + (size_t)clamp(y + i - v->radius, height) * (size_t)width,
                       scale * v->weights[i], width);
}

/* ---- FLIP: colour ---- */

static void multiply(const matrix *by, const double v[3], double out[3])
{
    int i;

    for (i = 0; i < 3; i++)
        out[i] = by->m[i][0] * v[0] + by->m[i][1] * v[1] + by->m[i][2] * v[2];
}

/* By cofactors. */
static matrix invert(const matrix *from)
{
    double determinant = 0.0;
    matrix out;
    int i, j;

    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            const double *p = from->m[(j + 1) % 3], *q = from->m[(j + 2) % 3];
            out.m[i][j] = p[(i + 1) % 3] * q[(i + 2) % 3] - p[(i + 2) % 3] * q[(i + 1) % 3];
        }
    for (i = 0; i < 3; i++)
        determinant += from->m[0][i] * out.m[i][0];
    for (i = 0; i < 9; i++)
        out.m[i / 3][i % 3] /= determinant;
    return out;
}

static double lab_curve(double t)
{
    const double d = 6.0 / 29.0;

    return t > d * d * d ? cbrt(t) : t / (3.0 * d * d) + 4.0 / 29.0;
}

/* CIELAB whose a and b shrink with lightness, as chroma does to the eye: the Hunt effect. */
static void hunt_lab(const double rgb[3], double lab[3])
{
    double xyz[3], l;

    multiply(&to_xyz, rgb, xyz);
    l = 116.0 * lab_curve(xyz[1]) - 16.0;
    lab[0] = l;
    lab[1] = 0.01 * l * 500.0 * (lab_curve(xyz[0]) - lab_curve(xyz[1]));
    lab[2] = 0.01 * l * 200.0 * (lab_curve(xyz[1]) - lab_curve(xyz[2]));
}

/* HyAB distance: city block between lightness and chroma, Euclidean within chroma. */
static double hyab(const double a[3], const double b[3])
{
    return fabs(a[0] - b[0]) + hypot(a[1] - b[1], a[2] - b[2]);
}

/* q_c-th power of the distance between green and blue, the largest. */
static double largest_difference(void)
{
    const double green[3] = { 0.0, 1.0, 0.0 }, blue[3] = { 0.0, 0.0, 1.0 };
    double lab[2][3];

    hunt_lab(green, lab[0]);
    hunt_lab(blue, lab[1]);
    return pow(hyab(lab[0], lab[1]), COLOUR_EXPONENT);
}

static double colour_difference(double distance, double largest)
{
    const double power = pow(distance, COLOUR_EXPONENT), knee = COLOUR_KNEE * largest;

    if (power < knee)
        return COLOUR_SHARE * power / knee;
    return COLOUR_SHARE + (1.0 - COLOUR_SHARE) * (power - knee) / (largest - knee);
}

/* ---- FLIP ---- */

/* What the eye sees of a picture: planes of colour in hunt_lab's coordinates, of edges and points.
 * While it is made, the first three are luminance, red-green and blue-yellow. */
enum { FIRST, SECOND, THIRD, EDGES, POINTS, PLANES };
typedef struct seen { float *planes[PLANES]; } seen;

/* Linearised CIELAB: (116 y - 16, 500 (x - y), 200 (y - z)). */
static void opponents(const image *map, float exposure, float *planes[3])
{
    const size_t count = value_count(map) / 3;
    size_t i;
    int c;

    for (i = 0; i < count; i++) {
        double rgb[3], xyz[3];
        for (c = 0; c < 3; c++)
            rgb[c] = shown_value(map->rgb[3 * i + (size_t)c], exposure);
        multiply(&to_xyz, rgb, xyz);
        planes[0][i] = (float)(116.0 * xyz[1] - 16.0);
        planes[1][i] = (float)(500.0 * (xyz[0] - xyz[1]));
        planes[2][i] = (float)(200.0 * (xyz[1] - xyz[2]));
    }
}

/* The eye's limited resolution. `filtered` is zero before. */
static void filter_colours(const workspace *space, float *const planes[3], double ppd,
                           float *filtered[3])
{
    int c, i;

    for (c = 0; c < 3; c++) {
        double shares[2] = { 0.0, 0.0 };
        kernel k[2];
        for (i = 0; i < 2; i++) {
            const double b = sensitivity[c].b[i], sum = kernel_sensitivity(&k[i], b, ppd);
            shares[i] = sensitivity[c].a[i] * sqrt(PI / b) * sum * sum;
        }
        for (i = 0; i < 2; i++)
            if (shares[i] > 0.0)
                filter(space, planes[c], &k[i], &k[i], (float)(shares[i] / (shares[0] + shares[1])),
                       filtered[c]);
    }
}

/* From opponents to hunt_lab's coordinates, by way of what a screen can show. */
static void colours_seen(float *planes[3], size_t count)
{
    const matrix to_rgb = invert(&to_xyz);
    size_t i;
    int c;

    for (i = 0; i < count; i++) {
        const double y = ((double)planes[0][i] + 16.0) / 116.0;
        const double xyz[3] = { y + (double)planes[1][i] / 500.0, y,
                                y - (double)planes[2][i] / 200.0 };
        double rgb[3], lab[3];
        multiply(&to_rgb, xyz, rgb);
        for (c = 0; c < 3; c++)
            rgb[c] = fmin(fmax(rgb[c], 0.0), 1.0);
        hunt_lab(rgb, lab);
        for (c = 0; c < 3; c++)
            planes[c][i] = (float)lab[c];
    }
}

/* Sizes of the first and second derivative of luminance. Both `found` are zero before,
 * and scratch[0] and [1] are overwritten. */
static void find_features(const workspace *space, const float *luminance, double ppd,
                          float *found[2], float *scratch[2])
{
    const size_t count = (size_t)space->width * (size_t)space->height;
    kernel k[3];
    size_t i;
    int which;

    kernel_features(k, ppd);
    for (which = 0; which < 2; which++) {
        memset(scratch[0], 0, count * sizeof(float));
        memset(scratch[1], 0, count * sizeof(float));
        filter(space, luminance, &k[which + 1], &k[0], 1.0f / 116.0f, scratch[0]);
        filter(space, luminance, &k[0], &k[which + 1], 1.0f / 116.0f, scratch[1]);
        for (i = 0; i < count; i++)
            found[which][i] = sqrtf(scratch[0][i] * scratch[0][i] + scratch[1][i] * scratch[1][i]);
    }
}

/* The planes in `s` are zero before; `scratch` is of three planes. */
static void see(const workspace *space, const image *map, float exposure, double ppd,
                float *scratch[3], seen *s)
{
    opponents(map, exposure, scratch);
    filter_colours(space, scratch, ppd, s->planes);
    find_features(space, scratch[0], ppd, s->planes + EDGES, scratch + 1);
    colours_seen(s->planes, (size_t)space->width * (size_t)space->height);
}

/* A difference of features raises that of colour. */
static double difference(const seen *a, const seen *b, size_t i, double largest)
{
    const double feature = fmax(fabs((double)a->planes[EDGES][i] - (double)b->planes[EDGES][i]),
                                fabs((double)a->planes[POINTS][i] - (double)b->planes[POINTS][i]));
    const double power = pow(feature / sqrt(2.0), FEATURE_EXPONENT);
    double lab[2][3], colour;
    int c;

    for (c = 0; c < 3; c++) {
        lab[0][c] = (double)a->planes[c][i];
        lab[1][c] = (double)b->planes[c][i];
    }
    colour = colour_difference(hyab(lab[0], lab[1]), largest);
    return fmin(pow(colour, 1.0 - fmin(power, 1.0)), 1.0);
}

static double compare(const seen *a, const seen *b, size_t count, image *map)
{
    const double largest = largest_difference();
    double sum = 0.0;
    size_t i;

    for (i = 0; i < count; i++) {
        const double d = difference(a, b, i, largest);
        if (map)
            map->rgb[3 * i] = map->rgb[3 * i + 1] = map->rgb[3 * i + 2] = (float)d;
        sum += d;
    }
    return sum / (double)count;
}

double error_flip(const image *test, const image *reference, float exposure,
                  float pixels_per_degree, image *map)
{
    const size_t count = value_count(test) / 3;
    const double ppd = (double)pixels_per_degree;
    workspace space = { test->width, test->height, NULL, NULL };
    float *memory = NULL, *scratch[3];
    seen both[2];
    double mean = (double)NAN;
    int i;

    if (map)
        memset(map, 0, sizeof *map);
    if (!same_size(test, reference) ||
        !(ppd >= (double)ERROR_FLIP_PPD_MIN && ppd <= (double)ERROR_FLIP_PPD_MAX))
        return mean;
    memory = (float *)calloc((2 * PLANES + 5) * count + 2 * RADIUS_MAX, sizeof *memory);
    if (memory && (!map || image_alloc(map, test->width, test->height))) {
        for (i = 0; i < PLANES; i++) {
            both[0].planes[i] = memory + (size_t)i * count;
            both[1].planes[i] = memory + (size_t)(PLANES + i) * count;
        }
        for (i = 0; i < 3; i++)
            scratch[i] = memory + (size_t)(2 * PLANES + i) * count;
        space.across = memory + (2 * PLANES + 3) * count;
        space.row = memory + (2 * PLANES + 4) * count;
        see(&space, test, exposure, ppd, scratch, &both[0]);
        see(&space, reference, exposure, ppd, scratch, &both[1]);
        mean = compare(&both[0], &both[1], count, map);
    }
    free(memory);
    return mean;
}
