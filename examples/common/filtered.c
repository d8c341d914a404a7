/* filtered.c: see filtered.h. */
#include "filtered.h"

#include "../../envsamp.h"

#include <math.h>
#include <string.h>

#define PI 3.14159265358979323846

/* cos a - cos b, without cancellation near the poles. */
static double band(double a, double b)
{
    return 2.0 * sin(0.5 * (a + b)) * sin(0.5 * (b - a));
}

/* Adds what texel (x, y) of `to` covers of a row of `from`: the share `height` of the sphere. */
static void add_row(const image *from, const image *to, int x, int row, double height,
                    double sums[4])
{
    const double scale = (double)from->width / to->width;
    const double left = x * scale, right = (x + 1) * scale;
    int i, c;

    for (i = (int)left; i < from->width && i < right; i++) {
        const double weight = height * (fmin(right, i + 1.0) - fmax(left, i));
        const float *texel = from->rgb + 3 * ((size_t)row * (size_t)from->width + (size_t)i);
        for (c = 0; c < 3; c++)
            sums[c] += weight * (double)texel[c];
        sums[3] += weight;
    }
}

static void reduce(const image *from, image *to)
{
    const double scale = (double)from->height / to->height, step = PI / from->height;
    int x, y, row, c;

    for (y = 0; y < to->height; y++)
        for (x = 0; x < to->width; x++) {
            const double top = y * scale, bottom = (y + 1) * scale;
            double sums[4] = { 0.0, 0.0, 0.0, 0.0 };
            float *out = to->rgb + 3 * ((size_t)y * (size_t)to->width + (size_t)x);
            for (row = (int)top; row < from->height && row < bottom; row++)
                add_row(from, to, x, row,
                        band(step * fmax(top, row), step * fmin(bottom, row + 1.0)), sums);
            for (c = 0; c < 3; c++)
                out[c] = (float)(sums[c] / sums[3]);
        }
}

int filtered_make(const image *map, filtered *out)
{
    int width = map->width, height = map->height;

    memset(out, 0, sizeof *out);
    for (;;) {
        image *level = &out->levels[out->count];
        if (!image_alloc(level, width, height)) {
            filtered_free(out);
            return 0;
        }
        if (out->count++ == 0)
            memcpy(level->rgb, map->rgb, 3 * sizeof(float) * (size_t)width * (size_t)height);
        else
            reduce(level - 1, level);
        if (width == 1 && height == 1)
            return 1;
        width = width > 1 ? width / 2 : 1;
        height = height > 1 ? height / 2 : 1;
    }
}

void filtered_free(filtered *f)
{
    int i;

    for (i = 0; i < FILTERED_LEVELS_MAX; i++)
        image_free(&f->levels[i]);
    f->count = 0;
}

/* Solid angle of the map's texel in a direction. */
static double texel_solid_angle(const image *map, const float dir[3])
{
    const double step = PI / map->height;
    float uv[2];
    int row;

    envsamp_dir_to_uv(ENVSAMP_LATLONG, dir, uv);
    row = (int)(uv[1] * (float)map->height);
    row = row < map->height ? row : map->height - 1;
    return 2.0 * PI / map->width * band(step * row, step * (row + 1));
}

float filtered_level(const filtered *f, const float dir[3], float pdf, int sample_count,
                     float bias)
{
    const double most = f->count - 1;
    double ratio, level;

    if (!(pdf > 0.0f) || sample_count < 1)
        return (float)most;
    ratio = 1.0 / ((double)sample_count * (double)pdf * texel_solid_angle(&f->levels[0], dir));
    level = 0.5 * log2(ratio) + (double)bias;
    return (float)fmin(fmax(level, 0.0), most);
}

static void lookup_level(const image *level, const float dir[3], float rgb[3])
{
    const envsamp_image view = { level->rgb, level->width, level->height, 3, 0, ENVSAMP_LATLONG };

    envsamp_lookup(&view, 0, dir, rgb);
}

void filtered_lookup(const filtered *f, const float dir[3], float pdf, int sample_count, float bias,
                     float rgb[3])
{
    const float level = filtered_level(f, dir, pdf, sample_count, bias);
    const int fine = (int)level;
    const float part = level - (float)fine;
    float coarse[3];
    int c;

    lookup_level(&f->levels[fine], dir, rgb);
    if (!(part > 0.0f))
        return;
    lookup_level(&f->levels[fine + 1], dir, coarse);
    for (c = 0; c < 3; c++)
        rgb[c] += part * (coarse[c] - rgb[c]);
}
