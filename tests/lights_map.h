/* lights_map.h: maps for tests of lights, made up or real, and sums over their texels by brute
 * force, with libm. Nothing here knows anything of the library.
 *
 *     canvas c = noise_map(40, 26, 3, 1.0f);
 *     grid g = grid_make(&c.view);              sums over texels: g.cells, g.total
 *     free(g.cells);
 *     free(c.pixels);
 *
 * Include it after the implementation of envsamp.h.
 */
#ifndef LIGHTS_MAP_H
#define LIGHTS_MAP_H

#include "kd_reference.h"
#include "lights_fixture.h"

#define LEAST 1.5e-45           /* as far apart are floats below 1e-38 */

/* ---- vectors ---- */

static inline double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline double distance(const double a[3], const double b[3])
{
    const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];

    return sqrt(x * x + y * y + z * z);
}

static inline double normalise(double v[3])
{
    const double length = sqrt(dot(v, v));
    int c;

    for (c = 0; c < 3; c++)
        v[c] /= length > 0.0 ? length : 1.0;
    return length;
}

static inline void dir_of(const envsamp_light *l, double dir[3])
{
    int c;

    for (c = 0; c < 3; c++)
        dir[c] = (double)l->dir[c];
    normalise(dir);
}

static inline double luminance_of(const double rgb[3])
{
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
}

/* ---- the map, by brute force ---- */

static inline double row_sr(const envsamp_image *map, int y)
{
    const long double pi = 3.14159265358979323846264338327950288L;
    const long double turn = map->mapping == ENVSAMP_LATLONG ? pi : 0.5L * pi;
    const long double w = (long double)map->width, h = (long double)map->height;

    if (map->mapping == ENVSAMP_OCTAHEDRAL)
        return (double)(4.0L * pi / (w * h));
    return (double)(2.0L * pi / w * (cosl(turn * (long double)y / h)
                                     - cosl(turn * (long double)(y + 1) / h)));
}

static inline const float *pixel_of(const envsamp_image *map, int x, int y)
{
    const size_t channels = (size_t)map->channels;
    const size_t stride = map->row_stride_bytes ? map->row_stride_bytes / sizeof(float)
                                                : (size_t)map->width * channels;

    return map->pixels + (size_t)y * stride + (size_t)x * channels;
}

/* NaN and infinity make a texel black, negative channels are 0. */
static inline void texel_rgb(const envsamp_image *map, int x, int y, double rgb[3])
{
    const float *pixel = pixel_of(map, x, y);
    int c, finite = 1;

    for (c = 0; c < 3; c++) {
        rgb[c] = (double)pixel[map->channels == 1 ? 0 : c];
        finite &= isfinite(rgb[c]) != 0;
    }
    for (c = 0; c < 3; c++)
        rgb[c] = finite && rgb[c] > 0.0 ? rgb[c] : 0.0;
}

/* Direction of a point of the map, in texels. Octahedral: [Clarberg]. */
static inline void point_dir(const envsamp_image *map, double x, double y, double dir[3])
{
    const double u = x / (double)map->width, v = y / (double)map->height;
    const double polar = v * (map->mapping == ENVSAMP_LATLONG ? KD_PI : 0.5 * KD_PI);

    dir[0] = sin(polar) * cos(2.0 * KD_PI * u);
    dir[1] = sin(polar) * sin(2.0 * KD_PI * u);
    dir[2] = cos(polar);
    if (map->mapping == ENVSAMP_OCTAHEDRAL) {
        const double a = fabs(2.0 * u - 1.0), b = fabs(2.0 * v - 1.0);
        const double depth = 1.0 - a - b, r = 1.0 - fabs(depth);
        const double phi = r > 0.0 ? ((b - a) / r + 1.0) * 0.25 * KD_PI : 0.0;
        const double ring = r * sqrt(2.0 - r * r);

        dir[0] = copysign(ring * cos(phi), u - 0.5);
        dir[1] = copysign(ring * sin(phi), v - 0.5);
        dir[2] = copysign(1.0 - r * r, depth);
    }
}

/* A texel, or sums over some: luminance, it times direction, channels; all times solid angle. */
typedef struct cell { double luminance, v[3], rgb[3], sr; } cell;

typedef struct grid { envsamp_image view; cell *cells, total; double lit_sr; int lit; } grid;

static inline void add_cell(cell *sum, const cell *part)
{
    int c;

    sum->luminance += part->luminance;
    sum->sr += part->sr;
    for (c = 0; c < 3; c++) {
        sum->v[c] += part->v[c];
        sum->rgb[c] += part->rgb[c];
    }
}

static inline cell cell_of(const envsamp_image *view, int x, int y, double sr)
{
    cell texel;
    double dir[3];
    int c;

    texel_rgb(view, x, y, texel.rgb);
    point_dir(view, (double)x + 0.5, (double)y + 0.5, dir);
    texel.sr = sr;
    texel.luminance = luminance_of(texel.rgb) * sr;
    for (c = 0; c < 3; c++) {
        texel.rgb[c] *= sr;
        texel.v[c] = texel.luminance * dir[c];
    }
    return texel;
}

static inline grid grid_make(const envsamp_image *view)
{
    grid g;
    int x, y;

    memset(&g, 0, sizeof g);
    g.view = *view;
    g.cells = (cell *)kd_allocate((size_t)view->width * (size_t)view->height * sizeof *g.cells);
    for (y = 0; y < view->height; y++) {
        const double sr = row_sr(view, y);

        for (x = 0; x < view->width; x++) {
            const cell texel = cell_of(view, x, y, sr);

            g.cells[(size_t)y * (size_t)view->width + (size_t)x] = texel;
            add_cell(&g.total, &texel);
            g.lit += texel.luminance > 0.0;
            g.lit_sr += texel.luminance > 0.0 ? sr : 0.0;
        }
    }
    return g;
}

/* ---- maps of one's own ---- */

typedef struct canvas { float *pixels; envsamp_image view; } canvas;

static inline canvas canvas_make(int width, int height, int channels, int gap)
{
    const int stride = width * channels + gap;
    canvas c;

    c.pixels = (float *)kd_allocate((size_t)stride * (size_t)height * sizeof *c.pixels);
    c.view = kd_image(c.pixels, width, height, channels);
    c.view.row_stride_bytes = gap ? (size_t)stride * sizeof(float) : 0;
    return c;
}

static inline float *canvas_at(const canvas *c, int x, int y)
{
    return c->pixels + (pixel_of(&c->view, x, y) - c->view.pixels);
}

static inline void canvas_fill(const canvas *c, int x0, int y0, int x1, int y1, float value)
{
    int x, y, i;

    for (y = y0; y < y1; y++)
        for (x = x0; x < x1; x++)
            for (i = 0; i < c->view.channels; i++)
                canvas_at(c, x, y)[i] = value;
}

/* Noise of many colours; black where `lit` of 1 says so. */
static inline canvas noise_map(int width, int height, uint64_t seed, float lit)
{
    canvas c = canvas_make(width, height, 3, 0);
    pcg32 random = pcg32_make(seed, 4);
    int i, k;

    for (i = 0; i < width * height; i++) {
        const int shines = pcg32_float(&random) < lit;

        for (k = 0; k < 3; k++)
            c.pixels[3 * i + k] = shines ? 0.5f + pcg32_float(&random) : 0.0f;
    }
    return c;
}

/* The same map in other clothes, with NaN where nobody should look. */
enum { MONO, PACKED, STRIDED, FOUR, LAYOUTS };

static inline canvas canvas_of(const image *map, int layout)
{
    static const int channels[LAYOUTS] = { 1, 3, 3, 4 }, gaps[LAYOUTS] = { 3, 0, 5, 2 };
    canvas c = canvas_make(map->width, map->height, channels[layout], gaps[layout]);
    const int stride = map->width * channels[layout] + gaps[layout];
    int x, y, i;

    for (i = 0; i < stride * map->height; i++)
        c.pixels[i] = NAN;
    for (y = 0; y < map->height; y++)
        for (x = 0; x < map->width; x++) {
            const float *rgb = map->rgb + 3 * ((size_t)y * (size_t)map->width + (size_t)x);

            if (layout == MONO)
                *canvas_at(&c, x, y) = envsamp_luminance(rgb);
            else
                memcpy(canvas_at(&c, x, y), rgb, 3 * sizeof *rgb);
        }
    return c;
}

/* A real map, every `step`-th texel of it. */
static inline int real_map(int index, int step, image *out)
{
    image map;
    int x, y, made;

    if (!real_map_read(index, &map))
        return 0;
    made = image_alloc(out, map.width / step, map.height / step);
    for (y = 0; made && y < out->height; y++)
        for (x = 0; x < out->width; x++)
            memcpy(out->rgb + 3 * (y * out->width + x),
                   map.rgb + 3 * (y * step * map.width + x * step), 3 * sizeof *out->rgb);
    image_free(&map);
    return made;
}

static inline void worst(double *so_far, double value)
{
    if (!(value <= *so_far))
        *so_far = value;
}

#endif
