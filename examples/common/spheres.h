/* spheres.h: a diffuse and a glossy sphere lit by a map, a few samples a pixel, beside a reference.
 *
 *     spheres *s = calloc(1, sizeof *s);
 *     s->map = &map;
 *     s->view = &view;
 *     s->by[0] = sampler_of_kd("WARP", kd);  ...
 *     spheres_shade(s);
 *     ... s->panels[surface][i].rmse ...
 *     spheres_draw(s, &canvas)
 *
 * Needs envsamp.h, picture.c and -lm.
 */
#ifndef SPHERES_H
#define SPHERES_H

#include "light.h"
#include "picture.h"
#include "random.h"

#include <stdio.h>
#include <string.h>

#define SPHERE_SIDE 136              /* pixels of a sphere's square */
#define SPHERE_RADIUS 51.0f
#define LABEL_HEIGHT 42
#define SPHERE_TITLE 26
#define SPHERE_SAMPLES 16            /* a pixel */
#define GLOSS 32                     /* exponent of the lobe, a power of two */
#define CELLS_X 96
#define CELLS_Y 48
#define CELL_COUNT (CELLS_X * CELLS_Y)

enum { DIFFUSE, GLOSSY, SURFACE_COUNT };

#ifndef SPHERE_SAMPLERS
#define SPHERE_SAMPLERS 4
#endif
#define REFERENCE SPHERE_SAMPLERS    /* the panel behind those of the samplers */
#define PANEL_COUNT (SPHERE_SAMPLERS + 1)

/* The light of a cell of the map, for the reference: radiance x solid angle, and the same times
   the direction, a channel. */
typedef struct cell {
    float power[3], vector[3][3], dir[3];
} cell;

typedef struct panel {
    float rgb[SPHERE_SIDE * SPHERE_SIDE * 3];
    double rmse;                     /* relative to the mean of the reference */
} panel;

typedef struct spheres {
    const image *map;
    const envsamp_image *view;       /* of `map`, for the library */
    sampler by[SPHERE_SAMPLERS];
    cell cells[CELL_COUNT];
    float to_eye[3], right[3];       /* up is +z */
    panel panels[SURFACE_COUNT][PANEL_COUNT];
} spheres;

static inline void add_texel(cell *c, const float rgb[3], float sr, const float dir[3])
{
    int i, axis;

    for (i = 0; i < 3; i++) {
        c->power[i] += rgb[i] * sr;
        for (axis = 0; axis < 3; axis++)
            c->vector[i][axis] += rgb[i] * sr * dir[axis];
    }
}

static inline void aim_cell(cell *c)
{
    float length;
    int axis;

    for (axis = 0; axis < 3; axis++)
        c->dir[axis] = c->vector[0][axis] + c->vector[1][axis] + c->vector[2][axis];
    length = sqrtf(dot3(c->dir, c->dir));
    for (axis = 0; axis < 3 && length > 0.0f; axis++)
        c->dir[axis] /= length;
}

static inline void gather_cells(spheres *s)
{
    const image *map = s->map;
    int x, y, i;

    for (y = 0; y < map->height; y++)
        for (x = 0; x < map->width; x++) {
            const size_t texel = (size_t)y * (size_t)map->width + (size_t)x;
            const long long across = (long long)x * CELLS_X / map->width;
            const long long down = (long long)y * CELLS_Y / map->height;
            float dir[3];

            envsamp_uv_to_dir(ENVSAMP_LATLONG, ((float)x + 0.5f) / (float)map->width,
                              ((float)y + 0.5f) / (float)map->height, dir);
            add_texel(&s->cells[down * CELLS_X + across], map->rgb + 3 * texel,
                      texel_sr(map->width, map->height, y), dir);
        }
    for (i = 0; i < CELL_COUNT; i++)
        aim_cell(&s->cells[i]);
}

/* The eye stands where the strongest light falls in over its left shoulder. */
static inline void place_eye(spheres *s)
{
    float x = 0.0f, y = 0.0f, azimuth;
    int i;

    for (i = 0; i < CELL_COUNT; i++) {
        x += s->cells[i].vector[1][0];
        y += s->cells[i].vector[1][1];
    }
    azimuth = atan2f(y, x) + 0.9f;
    s->to_eye[0] = cosf(azimuth);
    s->to_eye[1] = sinf(azimuth);
    s->to_eye[2] = 0.0f;
    s->right[0] = -s->to_eye[1];
    s->right[1] = s->to_eye[0];
    s->right[2] = 0.0f;
}

/* The normal and the mirrored view at a pixel; 0 beside the sphere. */
static inline int sphere_at(const spheres *s, int column, int row, float normal[3], float mirror[3])
{
    const float half = 0.5f * SPHERE_SIDE;
    const float a = ((float)column + 0.5f - half) / SPHERE_RADIUS;
    const float b = (half - (float)row - 0.5f) / SPHERE_RADIUS;
    const float c = 1.0f - a * a - b * b;
    float facing;
    int i;

    if (c <= 0.0f)
        return 0;
    for (i = 0; i < 3; i++)
        normal[i] = a * s->right[i] + sqrtf(c) * s->to_eye[i] + (i == 2 ? b : 0.0f);
    facing = dot3(normal, s->to_eye);
    for (i = 0; i < 3; i++)
        mirror[i] = 2.0f * facing * normal[i] - s->to_eye[i];
    return 1;
}

/* cos^GLOSS, such that it integrates to 1. */
static inline float lobe(float cosine)
{
    int power;

    for (power = 1; power < GLOSS; power *= 2)
        cosine *= cosine;
    return cosine * (GLOSS + 1) / (2.0f * LIGHT_PI);
}

/* What a surface that sends all light on shows of radiance from `dir`. */
static inline float response(int surface, const float normal[3], const float mirror[3],
                      const float dir[3])
{
    const float cosine = dot3(surface == DIFFUSE ? normal : mirror, dir);

    if (cosine <= 0.0f)
        return 0.0f;
    return surface == DIFFUSE ? cosine / LIGHT_PI : lobe(cosine);
}

static inline void shade_reference(const spheres *s, int surface, const float normal[3],
                            const float mirror[3], float rgb[3])
{
    int i, channel;

    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    for (i = 0; i < CELL_COUNT; i++) {
        const cell *c = &s->cells[i];
        const float gloss = surface == GLOSSY ? response(GLOSSY, normal, mirror, c->dir) : 0.0f;

        for (channel = 0; channel < 3; channel++)
            rgb[channel] += surface == DIFFUSE ? fmaxf(dot3(normal, c->vector[channel]), 0.0f)
                                                 / LIGHT_PI
                                               : gloss * c->power[channel];
    }
}

static inline void shade_sampled(const spheres *s, int surface, const sampler *by, uint32_t seed,
                          const float normal[3], const float mirror[3], float rgb[3])
{
    uint32_t i;
    int channel;

    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    for (i = 0; i < SPHERE_SAMPLES; i++) {
        float u[2], radiance[3], weight;
        envsamp_sample sample;

        sobol_owen(i, seed, u);
        sample = by->draw(by->table, u[0], u[1]);
        weight = response(surface, normal, mirror, sample.dir) / (sample.pdf * SPHERE_SAMPLES);
        if (!(weight > 0.0f))
            continue;
        envsamp_lookup(s->view, 1, sample.dir, radiance);
        for (channel = 0; channel < 3; channel++)
            rgb[channel] += weight * radiance[channel];
    }
}

static inline void shade_panel(spheres *s, int surface, int which)
{
    float *rgb = s->panels[surface][which].rgb, normal[3], mirror[3];
    int i;

    for (i = 0; i < SPHERE_SIDE * SPHERE_SIDE; i++, rgb += 3) {
        if (!sphere_at(s, i % SPHERE_SIDE, i / SPHERE_SIDE, normal, mirror))
            continue;
        if (which == REFERENCE)
            shade_reference(s, surface, normal, mirror, rgb);
        else
            shade_sampled(s, surface, &s->by[which], hash_combine(11, (uint32_t)i), normal, mirror,
                          rgb);
    }
}

/* Root mean square error over the pixels and channels of the sphere, relative to the mean. */
static inline double panel_rmse(const panel *p, const panel *reference)
{
    double squares = 0.0, sum = 0.0, count = 0.0;
    int i;

    for (i = 0; i < SPHERE_SIDE * SPHERE_SIDE * 3; i++) {
        double error = (double)p->rgb[i] - (double)reference->rgb[i];

        squares += error * error;
        sum += (double)reference->rgb[i];
        count += reference->rgb[i] > 0.0f;
    }
    return sqrt(squares * count) / sum;
}

static inline void spheres_shade(spheres *s)
{
    int surface, which;

    gather_cells(s);
    place_eye(s);
    for (surface = 0; surface < SURFACE_COUNT; surface++) {
        panel *panels = s->panels[surface];

        for (which = 0; which < PANEL_COUNT; which++)
            shade_panel(s, surface, which);
        for (which = 0; which < PANEL_COUNT; which++)
            panels[which].rmse = panel_rmse(&panels[which], &panels[REFERENCE]);
    }
}

/* ---- the picture ---- */

static const unsigned char sphere_ground[3] = {38, 40, 44}, sphere_text[3] = {255, 255, 255};

/* The brightest point just below white, unless that leaves the rest in the dark. */
static inline float panel_exposure(const panel *reference)
{
    float largest = 0.0f, sum = 0.0f, count = 0.0f;
    int i;

    for (i = 0; i < SPHERE_SIDE * SPHERE_SIDE; i++) {
        const float luminance = envsamp_luminance(reference->rgb + 3 * i);

        largest = fmaxf(largest, luminance);
        sum += luminance;
        count += luminance > 0.0f ? 1.0f : 0.0f;
    }
    return fmaxf(0.75f / largest, 0.14f * count / sum);
}

static inline void draw_ball(picture *canvas, int x, int y, const spheres *s, int surface,
                             int which)
{
    const float exposure = panel_exposure(&s->panels[surface][REFERENCE]);
    float normal[3], mirror[3], rgb[3];
    unsigned char colour[3];
    image one = {1, 1, NULL};
    int i;

    one.rgb = rgb;
    for (i = 0; i < SPHERE_SIDE * SPHERE_SIDE; i++) {
        if (!sphere_at(s, i % SPHERE_SIDE, i / SPHERE_SIDE, normal, mirror))
            continue;
        memcpy(rgb, s->panels[surface][which].rgb + 3 * i, sizeof rgb);
        image_tonemap(&one, exposure, colour);
        picture_blend(canvas, x + i % SPHERE_SIDE, y + i / SPHERE_SIDE, colour, 1.0f);
    }
}

static inline void centred_text(picture *canvas, int x, int y, const char *text)
{
    const int width = 2 * PICTURE_GLYPH_WIDTH * (int)strlen(text) - 2;

    picture_text(canvas, x + (SPHERE_SIDE - width) / 2, y, 2, sphere_text, text);
}

static inline void draw_panel(picture *canvas, int x, int y, const spheres *s, int surface,
                              int which)
{
    const double rmse = s->panels[surface][which].rmse;
    const int below = y + SPHERE_SIDE;
    char text[32];

    draw_ball(canvas, x, y, s, surface, which);
    centred_text(canvas, x, below, which == REFERENCE ? "REFERENCE" : s->by[which].name);
    snprintf(text, sizeof text, "RMSE %.*f", rmse < 1.0 ? 3 : rmse < 10.0 ? 2 : 1, rmse);
    if (which != REFERENCE)
        centred_text(canvas, x, below + 18, text);
}

/* Returns 0 if memory is short; the picture is to be freed with picture_free. */
static inline int spheres_draw(const spheres *s, picture *out)
{
    const int panel_height = SPHERE_SIDE + LABEL_HEIGHT;
    char title[64];
    int surface, which;

    if (!picture_alloc(out, PANEL_COUNT * SPHERE_SIDE,
                       SPHERE_TITLE + SURFACE_COUNT * panel_height + 4))
        return 0;
    picture_fill(out, 0, 0, out->width, out->height, sphere_ground);
    snprintf(title, sizeof title, "%d samples a pixel. RMSE over the mean", SPHERE_SAMPLES);
    picture_text(out, 8, 8, 2, sphere_text, title);
    for (surface = 0; surface < SURFACE_COUNT; surface++)
        for (which = 0; which < PANEL_COUNT; which++)
            draw_panel(out, which * SPHERE_SIDE, SPHERE_TITLE + surface * panel_height, s, surface,
                       which);
    return 1;
}

#endif
