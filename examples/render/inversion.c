/* inversion.c: see inversion.h. */
#include "inversion.h"
#include "vector.h"

#include <stdlib.h>

struct inversion {
    int width, height;
    float *marginal;                 /* height + 1, from 0 to 1 */
    float *conditional;              /* height rows of width + 1 */
    float *density;                  /* height rows of width: over the unit square */
};

size_t inversion_bytes(const inversion *table)
{
    const size_t width = (size_t)table->width, height = (size_t)table->height;

    return sizeof *table + (height + 1 + height * (2 * width + 1)) * sizeof(float);
}

static float brightest(const image *map, int x, int y)
{
    const size_t row = (size_t)(y < 0 ? 0 : y < map->height ? y : map->height - 1);
    const size_t column = (size_t)((x + map->width) % map->width);
    const float *rgb = map->rgb + 3 * (row * (size_t)map->width + column);

    return fmaxf(fmaxf(rgb[0], rgb[1]), rgb[2]);
}

static float dilated(const image *map, int x, int y)
{
    float most = 0.0f;
    int i;

    for (i = 0; i < 9; i++)
        most = fmaxf(most, brightest(map, x + i % 3 - 1, y + i / 3 - 1));
    return most;
}

/* Sums `weights`, count of them, into a CDF of count + 1. Even where all are zero. */
static double make_cdf(const float *weights, int count, float *cdf)
{
    double sum = 0.0, running = 0.0;
    int i;

    for (i = 0; i < count; i++)
        sum += (double)weights[i];
    cdf[0] = 0.0f;
    for (i = 0; i < count; i++) {
        running += (double)weights[i];
        cdf[i + 1] = (float)(sum > 0.0 ? running / sum : (double)(i + 1) / count);
    }
    cdf[count] = 1.0f;
    return sum;
}

static float row_sine(const image *map, int y)
{
    return sinf(VEC_PI * ((float)y + 0.5f) / (float)map->height);
}

/* Weights of all texels, in place of densities; less `compensation` times their mean, unless that
   leaves nothing. */
static void weigh_texels(const image *map, float compensation, float *weight)
{
    const size_t width = (size_t)map->width, count = width * (size_t)map->height;
    double sum = 0.0, sines = 0.0;
    float most = 0.0f, dim;
    size_t i;

    for (i = 0; i < count; i++) {
        const int y = (int)(i / width);

        weight[i] = dilated(map, (int)(i % width), y);
        sum += (double)(weight[i] * row_sine(map, y));
        sines += (double)row_sine(map, y);
        most = fmaxf(most, weight[i]);
    }
    dim = compensation * (float)(sum / sines);
    dim = dim < 0.999f * most ? dim : 0.0f;
    for (i = 0; i < count; i++)
        weight[i] = row_sine(map, (int)(i / width)) * fmaxf(weight[i] - dim, 0.0f);
}

inversion *inversion_make(const image *map, float compensation)
{
    const size_t width = (size_t)map->width, height = (size_t)map->height;
    const size_t floats = 2 * height + 1 + height * (2 * width + 1);
    inversion *table = malloc(sizeof *table + floats * sizeof(float));
    float *rows;
    double sum = 0.0;
    int x, y;

    if (!table)
        return NULL;
    table->width = map->width;
    table->height = map->height;
    table->marginal = (float *)(void *)(table + 1);
    table->conditional = table->marginal + height + 1;
    table->density = table->conditional + height * (width + 1);
    rows = table->density + height * width;
    weigh_texels(map, compensation, table->density);
    for (y = 0; y < map->height; y++) {
        float *row = table->density + (size_t)y * width;

        rows[y] = (float)make_cdf(row, map->width,
                                  table->conditional + (size_t)y * (width + 1));
        sum += (double)rows[y];
    }
    make_cdf(rows, map->height, table->marginal);
    for (y = 0; y < map->height && sum > 0.0; y++)
        for (x = 0; x < map->width; x++)
            table->density[(size_t)y * width + (size_t)x] *= (float)((double)width * (double)height
                                                                     / sum);
    if (sum > 0.0)
        return table;
    free(table);
    return NULL;
}

/* The last entry that u is not below; its part of the unit interval is not empty. */
static int find(const float *cdf, int count, float u)
{
    int low = 0, high = count;

    while (high - low > 1) {
        const int middle = (low + high) / 2;

        if (cdf[middle] <= u)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Where u lies between two entries, 0..1. */
static float between(const float *cdf, float u)
{
    const float width = cdf[1] - cdf[0];

    return width > 0.0f ? fminf((u - cdf[0]) / width, 0.999999f) : 0.5f;
}

/* From a density over the unit square to one per steradian. */
static float per_steradian(float density, float sine)
{
    return sine > 0.0f ? density / (2.0f * VEC_PI * VEC_PI * sine) : 0.0f;
}

envsamp_sample inversion_sample(const inversion *table, float u0, float u1)
{
    const size_t width = (size_t)table->width;
    const int y = find(table->marginal, table->height, u1);
    const float *row = table->conditional + (size_t)y * (width + 1);
    const int x = find(row, table->width, u0);
    const float v = ((float)y + between(table->marginal + y, u1)) / (float)table->height;
    const float u = ((float)x + between(row + x, u0)) / (float)table->width;
    const float sine = sinf(VEC_PI * v);
    envsamp_sample s;

    vec_set(s.dir, cosf(2.0f * VEC_PI * u) * sine, sinf(2.0f * VEC_PI * u) * sine,
            cosf(VEC_PI * v));
    s.pdf = per_steradian(table->density[(size_t)y * width + (size_t)x], sine);
    s.uv[0] = u;
    s.uv[1] = v;
    return s;
}

float inversion_pdf(const inversion *table, const float dir[3])
{
    const float theta = acosf(fminf(fmaxf(dir[2], -1.0f), 1.0f));
    const float turn = atan2f(dir[1], dir[0]) / (2.0f * VEC_PI);
    const float u = turn < 0.0f ? turn + 1.0f : turn;
    const int x = (int)(u * (float)table->width) % table->width;
    const int y = (int)(theta / VEC_PI * (float)table->height);
    const int row = y < table->height ? y : table->height - 1;

    return per_steradian(table->density[(size_t)row * (size_t)table->width + (size_t)x],
                         sinf(theta));
}
