/* mis_scene.h: spheres on a plane, with shadows, lit by a map through multiple importance sampling;
 * at the same number of rays, beside either sampler alone and a reference.
 *
 *     mis_scene *s = calloc(1, sizeof *s);
 *     s->view = &view;
 *     s->plain = mis_light_of_kd(kd);
 *     s->compensated = mis_light_of_kd(compensated);
 *     mis_scene_shade(s, 1);
 *     ... s->panels[MIS_COMPENSATED].rmse ...
 *     mis_scene_draw(s, &canvas)
 *
 * Looks the map up bilinearly, as the tables have to be made. Needs envsamp.h, picture.c and -lm.
 */
#ifndef MIS_SCENE_H
#define MIS_SCENE_H

#include "light.h"
#include "picture.h"
#include "random.h"

#include <stdio.h>
#include <string.h>

#define SCENE_WIDTH 192              /* pixels */
#define SCENE_HEIGHT 112
#define SCENE_LABEL 42
#define SCENE_TITLE 26
#define SCENE_RAYS 16                /* a pixel; with MIS half of them by each sampler */
#define SCENE_REFERENCE_RAYS 256
#ifndef SCENE_GLOSS
#define SCENE_GLOSS 32.0f            /* exponent of the lobe */
#endif

/* Centre, radius, and whether it is glossy, of each. */
#ifndef SCENE_SPHERES
#define SCENE_SPHERES {{-1.12f, 0.0f, 1.0f}, 1.0f, 0}, {{1.12f, 0.0f, 1.0f}, 1.0f, 1}
#endif

enum { MIS_BSDF, MIS_MAP, MIS_PLAIN, MIS_COMPENSATED, MIS_REFERENCE, MIS_PANELS };

/* A table that can be drawn from and asked for the density of any direction. */
typedef struct mis_light {
    const void *table;
    envsamp_sample (*draw)(const void *table, float u0, float u1);
    float (*pdf)(const void *table, const float dir[3]);
} mis_light;

typedef struct mis_panel {
    float rgb[SCENE_WIDTH * SCENE_HEIGHT * 3];
    double rmse;                     /* of luminance, relative to the mean of the reference */
} mis_panel;

typedef struct mis_scene {
    const envsamp_image *view;
    mis_light plain, compensated;
    float turn[2];                   /* cosine and sine: from the scene into the map */
    mis_panel panels[MIS_PANELS];
} mis_scene;

static inline float mis_kd_pdf(const void *table, const float dir[3])
{
    return envsamp_kd_pdf((const envsamp_kd *)table, dir);
}

static inline mis_light mis_light_of_kd(const envsamp_kd *kd)
{
    mis_light light = {NULL, sampler_draw_kd, mis_kd_pdf};

    light.table = kd;
    return light;
}

static inline envsamp_sample mis_cdf_draw(const void *table, float u0, float u1)
{
    return envsamp_cdf_sample((const envsamp_cdf *)table, u0, u1);
}

static inline float mis_cdf_pdf(const void *table, const float dir[3])
{
    return envsamp_cdf_pdf((const envsamp_cdf *)table, dir);
}

static inline mis_light mis_light_of_cdf(const envsamp_cdf *cdf)
{
    mis_light light = {NULL, mis_cdf_draw, mis_cdf_pdf};

    light.table = cdf;
    return light;
}

/* ---- the scene ---- */

typedef struct mis_sphere { float centre[3], radius; int glossy; } mis_sphere;

static const mis_sphere mis_spheres[] = {SCENE_SPHERES};

#define MIS_SPHERES ((int)(sizeof mis_spheres / sizeof mis_spheres[0]))

/* Distance to a sphere along a ray of unit length, or -1. */
static inline float mis_sphere_hit(const mis_sphere *sphere, const float from[3],
                                   const float dir[3])
{
    const float *centre = sphere->centre;
    const float to[3] = {centre[0] - from[0], centre[1] - from[1], centre[2] - from[2]};
    const float along = dot3(to, dir);
    const float rest = sphere->radius * sphere->radius - dot3(to, to) + along * along;
    const float near = rest > 0.0f ? along - sqrtf(rest) : -1.0f;

    return near > 1e-3f ? near : -1.0f;
}

/* Where light comes to be seen: a point, its normal, the mirrored view, and what it is made of. */
typedef struct mis_point {
    float at[3], normal[3], mirror[3], albedo;
    int glossy;
} mis_point;

/* What a ray from the eye meets; 0 for the map. */
static inline int mis_hit(const float from[3], const float dir[3], mis_point *p)
{
    float nearest = dir[2] < 0.0f ? -from[2] / dir[2] : -1.0f, facing;
    int which = -1, i;

    for (i = 0; i < MIS_SPHERES; i++) {
        const float t = mis_sphere_hit(&mis_spheres[i], from, dir);

        if (t > 0.0f && (nearest < 0.0f || t < nearest)) {
            nearest = t;
            which = i;
        }
    }
    if (nearest < 0.0f)
        return 0;
    for (i = 0; i < 3; i++) {
        p->at[i] = from[i] + nearest * dir[i];
        p->normal[i] = i == 2 ? 1.0f : 0.0f;
        if (which >= 0)
            p->normal[i] = (p->at[i] - mis_spheres[which].centre[i]) / mis_spheres[which].radius;
    }
    facing = dot3(p->normal, dir);
    for (i = 0; i < 3; i++)
        p->mirror[i] = dir[i] - 2.0f * facing * p->normal[i];
    p->glossy = which >= 0 && mis_spheres[which].glossy;
    p->albedo = which < 0 ? 0.5f : 0.8f;
    return 1;
}

static inline int mis_shadowed(const mis_point *p, const float dir[3])
{
    int shadowed = dot3(p->normal, dir) <= 0.0f || dir[2] <= 0.0f, i;

    for (i = 0; i < MIS_SPHERES && !shadowed; i++)
        shadowed = mis_sphere_hit(&mis_spheres[i], p->at, dir) > 0.0f;
    return shadowed;
}

/* Density with which the surface sends a ray on: a cosine, or its power about the mirrored view.
   Times the albedo it is also what the surface shows of light from there. */
static inline float mis_lobe(const mis_point *p, const float dir[3])
{
    const float cosine = dot3(p->glossy ? p->mirror : p->normal, dir);

    if (cosine <= 0.0f)
        return 0.0f;
    return p->glossy ? (SCENE_GLOSS + 1.0f) / (2.0f * LIGHT_PI) * powf(cosine, SCENE_GLOSS)
                     : cosine / LIGHT_PI;
}

/* A direction with the density of mis_lobe. */
static inline void mis_draw_lobe(const mis_point *p, const float u[2], float dir[3])
{
    draw_lobe(p->glossy ? p->mirror : p->normal, p->glossy ? SCENE_GLOSS : 1.0f, u, dir);
}

/* ---- light ---- */

/* A direction of the scene in the map. */
static inline void mis_to_map(const mis_scene *s, const float dir[3], float out[3])
{
    const float x = dir[0], y = dir[1];

    out[0] = s->turn[0] * x - s->turn[1] * y;
    out[1] = s->turn[1] * x + s->turn[0] * y;
    out[2] = dir[2];
}

static inline void mis_from_map(const mis_scene *s, const float dir[3], float out[3])
{
    const float x = dir[0], y = dir[1];

    out[0] = s->turn[0] * x + s->turn[1] * y;
    out[1] = s->turn[0] * y - s->turn[1] * x;
    out[2] = dir[2];
}

/* Adds a ray: what the surface shows of the map there, over the densities of all who might have
   sent it, which is the balance heuristic. */
static inline void mis_add(const mis_scene *s, const mis_point *p, const float dir[3],
                           float density, float rgb[3])
{
    const float shown = p->albedo * mis_lobe(p, dir);
    float radiance[3], map_dir[3];
    int i;

    if (!(shown > 0.0f && density > 0.0f) || mis_shadowed(p, dir))
        return;
    mis_to_map(s, dir, map_dir);
    envsamp_lookup(s->view, 0, map_dir, radiance);
    for (i = 0; i < 3; i++)
        rgb[i] += shown * radiance[i] / density;
}

/* A point lit by `map_rays` from the table and `bsdf_rays` from the surface. */
static inline void mis_light_point(const mis_scene *s, const mis_light *light, const mis_point *p,
                                   uint32_t map_rays, uint32_t bsdf_rays, uint32_t seed,
                                   float rgb[3])
{
    const float to_map = (float)map_rays, to_bsdf = (float)bsdf_rays;
    float u[2], dir[3], map_dir[3], density;
    uint32_t i;

    for (i = 0; i < map_rays; i++) {
        envsamp_sample from;

        sobol_owen(i, seed, u);
        from = light->draw(light->table, u[0], u[1]);
        mis_from_map(s, from.dir, dir);
        mis_add(s, p, dir, to_map * from.pdf + to_bsdf * mis_lobe(p, dir), rgb);
    }
    for (i = 0; i < bsdf_rays; i++) {
        sobol_owen(i, hash_combine(seed, 1), u);
        mis_draw_lobe(p, u, dir);
        density = to_bsdf * mis_lobe(p, dir);
        mis_to_map(s, dir, map_dir);
        if (map_rays)
            density += to_map * light->pdf(light->table, map_dir);
        mis_add(s, p, dir, density, rgb);
    }
}

/* The scene is fixed, and the map turned over it so that its strongest light falls in from the left
   and from behind the eye. */
static inline void mis_turn_map(mis_scene *s)
{
    float x = 0.0f, y = 0.0f, azimuth;
    uint32_t i;

    for (i = 0; i < 256; i++) {
        float u[2];
        envsamp_sample from;

        sobol_owen(i, 5, u);
        from = s->plain.draw(s->plain.table, u[0], u[1]);
        x += from.dir[0];
        y += from.dir[1];
    }
    azimuth = atan2f(y, x) + 2.2f;   /* of the scene's +x in the map */
    s->turn[0] = cosf(azimuth);
    s->turn[1] = sinf(azimuth);
}

/* The ray of a pixel, and what it meets; 0 for the map. */
static inline int mis_pixel(int column, int row, mis_point *p, float dir[3])
{
    const float down[2] = {0.9394f, -0.3429f};       /* where the eye looks: along y and z */
    const float from[3] = {0.0f, -6.6f * down[0], 0.75f - 6.6f * down[1]};
    const float scale = 0.92f / SCENE_WIDTH;
    const float a = ((float)column + 0.5f - 0.5f * SCENE_WIDTH) * scale;
    const float b = (0.5f * SCENE_HEIGHT - (float)row - 0.5f) * scale;
    float length;
    int i;

    dir[0] = a;
    dir[1] = down[0] - b * down[1];
    dir[2] = down[1] + b * down[0];
    length = sqrtf(dot3(dir, dir));
    for (i = 0; i < 3; i++)
        dir[i] /= length;
    return mis_hit(from, dir, p);
}

static inline void mis_shade_pixel(const mis_scene *s, int which, int pixel, float rgb[3])
{
    const mis_light *light = which == MIS_COMPENSATED ? &s->compensated : &s->plain;
    const uint32_t rays = which == MIS_REFERENCE ? SCENE_REFERENCE_RAYS : SCENE_RAYS;
    const uint32_t to_bsdf = which == MIS_BSDF ? rays : which == MIS_MAP ? 0 : rays / 2;
    const uint32_t seed = hash_combine(which == MIS_REFERENCE ? 17 : 13, (uint32_t)pixel);
    mis_point p;
    float dir[3];

    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    if (mis_pixel(pixel % SCENE_WIDTH, pixel / SCENE_WIDTH, &p, dir)) {
        mis_light_point(s, light, &p, rays - to_bsdf, to_bsdf, seed, rgb);
    } else {
        mis_to_map(s, dir, dir);
        envsamp_lookup(s->view, 0, dir, rgb);
    }
}

/* Over pixels that show the scene. */
static inline double mis_rmse(const mis_panel *panel, const mis_panel *reference)
{
    double squares = 0.0, sum = 0.0, count = 0.0;
    mis_point p;
    float dir[3];
    int i;

    for (i = 0; i < SCENE_WIDTH * SCENE_HEIGHT; i++) {
        const double right = (double)envsamp_luminance(reference->rgb + 3 * i);
        const double error = (double)envsamp_luminance(panel->rgb + 3 * i) - right;

        if (!mis_pixel(i % SCENE_WIDTH, i / SCENE_WIDTH, &p, dir))
            continue;
        squares += error * error;
        sum += right;
        count += 1.0;
    }
    return sum > 0.0 ? sqrt(squares * count) / sum : 0.0;
}

/* Shades every panel, or, with other tables, those that depend on them. */
static inline void mis_scene_shade(mis_scene *s, int all)
{
    int which, i;

    if (all)
        mis_turn_map(s);
    for (which = 0; which < MIS_PANELS; which++)
        for (i = 0; i < SCENE_WIDTH * SCENE_HEIGHT
                    && (all || (which != MIS_BSDF && which != MIS_REFERENCE)); i++)
            mis_shade_pixel(s, which, i, s->panels[which].rgb + 3 * i);
    for (which = 0; which < MIS_PANELS; which++)
        s->panels[which].rmse = mis_rmse(&s->panels[which], &s->panels[MIS_REFERENCE]);
}

/* ---- the picture ---- */

/* The mean of what the scene shows at a middle grey. */
static inline float mis_exposure(const mis_panel *reference)
{
    float sum = 0.0f, count = 0.0f, dir[3];
    mis_point p;
    int i;

    for (i = 0; i < SCENE_WIDTH * SCENE_HEIGHT; i++)
        if (mis_pixel(i % SCENE_WIDTH, i / SCENE_WIDTH, &p, dir)) {
            sum += envsamp_luminance(reference->rgb + 3 * i);
            count += 1.0f;
        }
    return sum > 0.0f ? 0.3f * count / sum : 1.0f;
}

/* With its error, if it has any. */
static inline void mis_draw_panel(picture *canvas, int x, int y, const mis_panel *panel,
                                  float exposure, const char *name)
{
    static const unsigned char white[3] = {255, 255, 255};
    const double rmse = panel->rmse;
    unsigned char colour[3];
    image one = {1, 1, NULL};
    char text[32];
    float rgb[3];
    int i;

    one.rgb = rgb;
    for (i = 0; i < SCENE_WIDTH * SCENE_HEIGHT; i++) {
        memcpy(rgb, panel->rgb + 3 * i, sizeof rgb);
        image_tonemap(&one, exposure, colour);
        picture_blend(canvas, x + i % SCENE_WIDTH, y + i / SCENE_WIDTH, colour, 1.0f);
    }
    picture_text(canvas, x + 6, y + SCENE_HEIGHT + 4, 2, white, name);
    snprintf(text, sizeof text, "RMSE %.*f", rmse < 1.0 ? 3 : rmse < 10.0 ? 2 : 1, rmse);
    if (rmse > 0.0)
        picture_text(canvas, x + 6, y + SCENE_HEIGHT + 22, 2, white, text);
}

/* Returns 0 if memory is short; the picture is to be freed with picture_free. */
static inline int mis_scene_draw(const mis_scene *s, picture *out)
{
    static const char *const names[MIS_PANELS] = {"BSDF", "MAP", "MIS", "COMPENSATED",
                                                  "REFERENCE"};
    static const unsigned char ground[3] = {38, 40, 44};
    const float exposure = mis_exposure(&s->panels[MIS_REFERENCE]);
    static const unsigned char white[3] = {255, 255, 255};
    char title[64];
    int which;

    if (!picture_alloc(out, MIS_PANELS * SCENE_WIDTH, SCENE_TITLE + SCENE_HEIGHT + SCENE_LABEL))
        return 0;
    picture_fill(out, 0, 0, out->width, out->height, ground);
    snprintf(title, sizeof title, "%d rays a pixel. RMSE over the mean", SCENE_RAYS);
    picture_text(out, 6, 6, 2, white, title);
    for (which = 0; which < MIS_PANELS; which++)
        mis_draw_panel(out, which * SCENE_WIDTH, SCENE_TITLE, &s->panels[which], exposure,
                       names[which]);
    return 1;
}

#endif
