/* map_pictures.h: a map with the blocks of a table over it, and the points of samplers over the
 * map and over the unit square that WARP makes of it.
 *
 * Each function returns 1, or 0 if memory is short; the picture is to be freed with picture_free.
 * Needs envsamp.h, picture.c and -lm.
 */
#ifndef MAP_PICTURES_H
#define MAP_PICTURES_H

#include "light.h"
#include "picture.h"
#include "random.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BLOCKS_WIDTH 1024
#define BLOCKS_HEIGHT 512

static const unsigned char map_white[3] = {255, 255, 255}, map_black[3] = {0, 0, 0};
static const unsigned char map_ground[3] = {38, 40, 44};

/* Puts the map's geometric mean at a middle grey. `integral` is of its luminance. */
static inline float map_exposure(const image *map, double integral)
{
    const float floor_luminance = 1e-4f * (float)integral;
    double sum = 0.0;
    int x, y;

    for (y = 0; y < map->height; y++) {
        double row = 0.0;

        for (x = 0; x < map->width; x++)
            row += (double)logf(fmaxf(texel_luminance(map, x, y), floor_luminance));
        sum += row * (double)texel_sr(map->width, map->height, y);
    }
    return (float)(0.16 / exp(sum / (4.0 * (double)LIGHT_PI)));
}

/* One pixel of an outline over the pixel `under`: darker on a bright one, else brighter. */
static inline void outline_pixel(picture *canvas, int x, int y, const unsigned char under[3],
                                 float cover)
{
    const int bright = 2 * under[0] + 5 * under[1] + under[2] > 8 * 48;

    picture_blend(canvas, x, y, bright ? map_black : map_white, bright ? cover : 0.6f * cover);
}

static inline const unsigned char *picture_pixel(const picture *from, int x, int y)
{
    return from->rgb + 3 * ((size_t)y * (size_t)from->width + (size_t)x);
}

/* Copies rows of a picture into a larger one. */
static inline void picture_paste(picture *canvas, int x, int y, const picture *from)
{
    const size_t bytes = (size_t)from->width * 3;
    int row;

    for (row = 0; row < from->height; row++)
        memcpy(canvas->rgb + 3 * ((size_t)(y + row) * (size_t)canvas->width + (size_t)x),
               from->rgb + (size_t)row * bytes, bytes);
}

#define PLATE_MARGIN 12
#define PLATE_TITLE 30

/* ---- blocks ---- */

/* The upper and left sides of a block; its neighbours draw the others. Outlines of blocks of a
   few pixels are fainter, so that the map is still seen between them. */
static inline void outline_block(picture *canvas, const picture *under,
                                 const envsamp_kd_block *block)
{
    const int x0 = (int)(block->uv_min[0] * (float)canvas->width + 0.5f);
    const int x1 = (int)(block->uv_max[0] * (float)canvas->width + 0.5f);
    const int y0 = (int)(block->uv_min[1] * (float)canvas->height + 0.5f);
    const int y1 = (int)(block->uv_max[1] * (float)canvas->height + 0.5f);
    const int side = x1 - x0 < y1 - y0 ? x1 - x0 : y1 - y0;
    const float cover = side >= 8 ? 0.6f : side >= 4 ? 0.4f : 0.2f;
    int i;

    for (i = x0; i < x1 && y1 > y0; i++)
        outline_pixel(canvas, i, y0, picture_pixel(under, i, y0), cover);
    for (i = y0 + 1; i < y1 && x1 > x0; i++)
        outline_pixel(canvas, x0, i, picture_pixel(under, x0, i), cover);
}

static inline int blocks_picture(picture *out, const char *name, const image *map, float exposure,
                                 const envsamp_kd *kd)
{
    picture under = {0, 0, NULL}, lined = {0, 0, NULL};
    envsamp_kd_block block;
    char title[100];
    int made, i;

    made = picture_alloc(out, BLOCKS_WIDTH, BLOCKS_HEIGHT + PLATE_TITLE)
        && picture_alloc(&under, BLOCKS_WIDTH, BLOCKS_HEIGHT)
        && picture_alloc(&lined, BLOCKS_WIDTH, BLOCKS_HEIGHT);
    if (made) {
        picture_map(&under, 0, 0, under.width, under.height, map, exposure);
        picture_paste(&lined, 0, 0, &under);
        for (i = 0; envsamp_kd_get_block(kd, i, &block) == ENVSAMP_OK; i++)
            outline_block(&lined, &under, &block);
        picture_paste(out, 0, PLATE_TITLE, &lined);
        snprintf(title, sizeof title, "%.20s: THE %d BLOCKS OF WARP", name, i);
        picture_text(out, PLATE_MARGIN, 8, 2, map_white, title);
    } else {
        picture_free(out);
    }
    picture_free(&under);
    picture_free(&lined);
    return made;
}

/* ---- points: a row a sampler, the map on the left, the unit square on the right ---- */

#define POINT_COUNT 256
#define STRATA_SIDE 16               /* strata of the unit square, each way */
#define STRATA_COUNT (STRATA_SIDE * STRATA_SIDE)
#define PLATE_HEIGHT 416
#define PLATE_MAP (2 * PLATE_HEIGHT)
#define PLATE_SQUARE (PLATE_MAP + PLATE_MARGIN)      /* where the square begins */
#define PLATE_WIDTH (PLATE_SQUARE + PLATE_HEIGHT)

/* What all rows start from: the map, and in the square that map as WARP flattens it, where every
   pixel has the same share of the light. */
typedef struct plate {
    const envsamp_kd *warp;
    picture under;
    short *strata;                   /* of each pixel; -1 where WARP draws nothing */
} plate;

/* The stratum of a point of the unit square. */
static inline short stratum_of(const float u[2])
{
    const int column = (int)(u[0] * STRATA_SIDE), row = (int)(u[1] * STRATA_SIDE);

    return (short)(row * STRATA_SIDE + column);
}

static inline void plate_free(plate *p)
{
    picture_free(&p->under);
    free(p->strata);
}

static inline void plate_fill_map(plate *p, const image *map, float exposure)
{
    int x, y;

    picture_map(&p->under, 0, 0, PLATE_MAP, PLATE_HEIGHT, map, exposure);
    for (y = 0; y < PLATE_HEIGHT; y++)
        for (x = 0; x < PLATE_MAP; x++) {
            float dir[3], u[2];

            envsamp_uv_to_dir(ENVSAMP_LATLONG, ((float)x + 0.5f) / PLATE_MAP,
                              ((float)y + 0.5f) / PLATE_HEIGHT, dir);
            if (envsamp_kd_invert(p->warp, dir, u))
                p->strata[y * PLATE_WIDTH + x] = stratum_of(u);
        }
}

static inline void plate_fill_square(plate *p, const envsamp_image *view, float exposure)
{
    image one = {1, 1, NULL};
    float rgb[3], u[2];
    int x, y;

    one.rgb = rgb;
    for (y = 0; y < PLATE_HEIGHT; y++)
        for (x = 0; x < PLATE_HEIGHT; x++) {
            const int pixel = y * PLATE_WIDTH + PLATE_SQUARE + x;
            envsamp_sample s;

            u[0] = ((float)x + 0.5f) / PLATE_HEIGHT;
            u[1] = ((float)y + 0.5f) / PLATE_HEIGHT;
            s = envsamp_kd_sample(p->warp, u[0], u[1]);
            envsamp_lookup(view, 1, s.dir, rgb);
            image_tonemap(&one, exposure, p->under.rgb + 3 * (size_t)pixel);
            p->strata[pixel] = stratum_of(u);
        }
}

static inline int plate_make(plate *p, const image *map, const envsamp_image *view,
                             float exposure, const envsamp_kd *warp)
{
    int i;

    p->warp = warp;
    p->strata = malloc(PLATE_WIDTH * PLATE_HEIGHT * sizeof *p->strata);
    if (!picture_alloc(&p->under, PLATE_WIDTH, PLATE_HEIGHT) || !p->strata) {
        plate_free(p);
        return 0;
    }
    for (i = 0; i < PLATE_WIDTH * PLATE_HEIGHT; i++)
        p->strata[i] = -1;
    picture_fill(&p->under, 0, 0, PLATE_WIDTH, PLATE_HEIGHT, map_ground);
    plate_fill_map(p, map, exposure);
    plate_fill_square(p, view, exposure);
    return 1;
}

/* A round dot in a dark ring, so that it shows on anything. */
static inline void draw_dot(picture *canvas, float x, float y)
{
    static const unsigned char colour[3] = {255, 150, 0};
    double at[2];

    at[0] = (double)x;
    at[1] = (double)y;
    picture_line(canvas, at, at, 6.5, map_black);
    picture_line(canvas, at, at, 4.0, colour);
}

typedef struct shown_points {
    float uv[POINT_COUNT][2], u[POINT_COUNT][2];    /* on the map; in the square, where `known` */
    int known[POINT_COUNT], hits[STRATA_COUNT], empty;
} shown_points;

/* The same points for every sampler: one in each stratum, as long as a sampler keeps them there. */
static inline void points_make(shown_points *p, const envsamp_kd *warp, const sampler *by)
{
    uint32_t i;

    memset(p, 0, sizeof *p);
    for (i = 0; i < POINT_COUNT; i++) {
        float u[2];
        envsamp_sample s;

        sobol_owen(i, 7, u);
        s = by->draw(by->table, u[0], u[1]);
        envsamp_dir_to_uv(ENVSAMP_LATLONG, s.dir, p->uv[i]);
        p->known[i] = envsamp_kd_invert(warp, s.dir, p->u[i]);
        if (p->known[i])
            p->hits[stratum_of(p->u[i])]++;
    }
    for (i = 0; i < STRATA_COUNT; i++)
        p->empty += p->hits[i] == 0;
}

/* Outlines of all strata, and colour over those that no point has hit. */
static inline void plate_draw_strata(const plate *p, picture *canvas, int top,
                                     const shown_points *drawn)
{
    static const unsigned char missed[3] = {225, 20, 60};
    int x, y;

    for (y = 0; y < PLATE_HEIGHT; y++)
        for (x = 0; x < PLATE_WIDTH; x++) {
            const short *stratum = p->strata + y * PLATE_WIDTH + x;
            const int left = x > 0 ? stratum[-1] : -1, up = y > 0 ? stratum[-PLATE_WIDTH] : -1;

            if (*stratum < 0)
                continue;
            if (drawn->hits[*stratum] == 0)
                picture_blend(canvas, PLATE_MARGIN + x, top + y, missed, 0.5f);
            if ((left >= 0 && left != *stratum) || (up >= 0 && up != *stratum))
                outline_pixel(canvas, PLATE_MARGIN + x, top + y, picture_pixel(&p->under, x, y),
                              0.6f);
        }
}

static inline void plate_draw(const plate *p, picture *canvas, int y, const sampler *by)
{
    const int top = y + PLATE_TITLE;
    shown_points drawn;
    char title[80];
    int i;

    points_make(&drawn, p->warp, by);
    picture_paste(canvas, PLATE_MARGIN, top, &p->under);
    plate_draw_strata(p, canvas, top, &drawn);
    for (i = 0; i < POINT_COUNT; i++) {
        draw_dot(canvas, PLATE_MARGIN + drawn.uv[i][0] * PLATE_MAP,
                 (float)top + drawn.uv[i][1] * PLATE_HEIGHT);
        if (drawn.known[i])
            draw_dot(canvas, PLATE_MARGIN + PLATE_SQUARE + drawn.u[i][0] * PLATE_HEIGHT,
                     (float)top + drawn.u[i][1] * PLATE_HEIGHT);
    }
    snprintf(title, sizeof title, "%s: %d Sobol points, %d of %d parts of equal light empty",
             by->name, POINT_COUNT, drawn.empty, STRATA_COUNT);
    picture_text(canvas, PLATE_MARGIN, y + 8, 2, map_white, title);
    picture_text(canvas, PLATE_MARGIN + PLATE_SQUARE, y + 8, 2, map_white,
                 "in the unit square of WARP");
}

static inline int points_picture(picture *out, const image *map, const envsamp_image *view,
                                 float exposure, const envsamp_kd *warp, const sampler *by,
                                 int count)
{
    const int height = count * (PLATE_TITLE + PLATE_HEIGHT) + PLATE_MARGIN;
    plate p;
    int i, made;

    if (!plate_make(&p, map, view, 0.5f * exposure, warp))      /* darker than the points */
        return 0;
    made = picture_alloc(out, PLATE_WIDTH + 2 * PLATE_MARGIN, height);
    if (made)
        picture_fill(out, 0, 0, out->width, out->height, map_ground);
    for (i = 0; i < count && made; i++)
        plate_draw(&p, out, i * (PLATE_TITLE + PLATE_HEIGHT), &by[i]);
    plate_free(&p);
    return made;
}

#endif
