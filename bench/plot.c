/* plot.c: see plot.h. */
#include "plot.h"

#include "../examples/common/picture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WIDTH        900
#define HEIGHT       640
#define LEFT         100            /* margins */
#define RIGHT        196            /* names of the lines */
#define TOP          56
#define BOTTOM       70
#define SCALE        2              /* of text */
#define TEXT_WIDTH   (PICTURE_GLYPH_WIDTH * SCALE)
#define TEXT_HEIGHT  (PICTURE_GLYPH_HEIGHT * SCALE)
#define NAME_SPACING (TEXT_HEIGHT + 6)
#define GUIDE_OFFSET 1.6            /* guides start so many times above and below all lines */

static const unsigned char paper[3] = { 255, 255, 255 }, ink[3] = { 40, 40, 40 };
static const unsigned char grid[3] = { 226, 226, 226 }, guide[3] = { 150, 150, 150 };

typedef struct drawing {
    picture canvas;
    const plot *p;
    double low, high;               /* of the y axis: log10 */
} drawing;

/* ---- places ---- */

static double place_x(const drawing *d, double index)
{
    return LEFT + index / (d->p->count - 1.0) * (WIDTH - LEFT - RIGHT);
}

static double place_y(const drawing *d, double value)
{
    const double share = (log10(value) - d->low) / (d->high - d->low);

    return HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM);
}

/* Smallest or largest value of all lines at one place. */
static double extreme_at(const plot *p, int index, int largest)
{
    double found = p->series[0].values[index];
    int k;

    for (k = 1; k < p->series_count; k++)
        found = largest ? fmax(found, p->series[k].values[index])
                        : fmin(found, p->series[k].values[index]);
    return found;
}

/* Where a guide begins, so that it stays clear of all lines above, or below, it. */
static double guide_start(const plot *p, double slope)
{
    const int largest = slope > -0.75;
    double start = 0.0;
    int i;

    for (i = 0; i < p->count; i++) {
        const double back = extreme_at(p, i, largest) * pow(2.0, -slope * i);

        if (i == 0 || (largest ? back > start : back < start))
            start = back;
    }
    return largest ? start * GUIDE_OFFSET : start / GUIDE_OFFSET;
}

static double guide_at(const plot *p, double slope, double index)
{
    return guide_start(p, slope) * pow(2.0, slope * index);
}

static void fit_axis(drawing *d)
{
    const plot *p = d->p;
    int i;

    d->high = log10(guide_at(p, -0.5, 0.0));
    d->low = log10(guide_at(p, -1.0, p->count - 1.0));
    for (i = 0; i < p->count; i++) {
        d->high = fmax(d->high, log10(extreme_at(p, i, 1)));
        d->low = fmin(d->low, log10(extreme_at(p, i, 0)));
    }
    d->high += 0.05;
    d->low -= 0.05;
}

/* ---- axes ---- */

static void straight(drawing *d, double x0, double y0, double x1, double y1, double width,
                     const unsigned char colour[3])
{
    double a[2], b[2];

    a[0] = x0;
    a[1] = y0;
    b[0] = x1;
    b[1] = y1;
    picture_line(&d->canvas, a, b, width, colour);
}

static void text_at(drawing *d, double x, double y, const unsigned char colour[3],
                    const char *text)
{
    picture_text(&d->canvas, (int)x, (int)y, SCALE, colour, text);
}

/* 4, 16, 64..: there is no room for all. */
static void draw_x_axis(drawing *d)
{
    const plot *p = d->p;
    const double bottom = HEIGHT - BOTTOM;
    char number[32];
    int i;

    for (i = 0; i < p->count; i++) {
        const double x = floor(place_x(d, i)) + 0.5;

        straight(d, x, TOP, x, bottom, 1.0, grid);
        straight(d, x, bottom, x, bottom + (i % 2 ? 4.0 : 8.0), 1.0, ink);
        if (i % 2)
            continue;
        snprintf(number, sizeof number, "%.0f", p->first * pow(2.0, i));
        text_at(d, x - 0.5 * TEXT_WIDTH * (double)strlen(number) + 1.0, bottom + 14.0, ink,
                number);
    }
    text_at(d, LEFT + 0.5 * (WIDTH - LEFT - RIGHT - TEXT_WIDTH * (double)strlen(p->x_title)),
            HEIGHT - TEXT_HEIGHT - 12.0, ink, p->x_title);
}

/* 1, 2 and 5 times the powers of ten. */
static void draw_y_axis(drawing *d)
{
    static const double steps[3] = { 1.0, 2.0, 5.0 };
    char number[32];
    int decade, i;

    for (decade = (int)floor(d->low); decade <= (int)ceil(d->high); decade++)
        for (i = 0; i < 3; i++) {
            const double value = steps[i] * pow(10.0, decade);
            const double y = floor(place_y(d, value)) + 0.5;

            if (log10(value) < d->low || log10(value) > d->high)
                continue;
            straight(d, LEFT, y, WIDTH - RIGHT, y, 1.0, grid);
            straight(d, LEFT - 8.0, y, LEFT, y, 1.0, ink);
            snprintf(number, sizeof number, "%g", value);
            text_at(d, LEFT - 12.0 - TEXT_WIDTH * (double)strlen(number),
                    y - 0.5 * TEXT_HEIGHT, ink, number);
        }
}

static void draw_frame(drawing *d)
{
    const double right = WIDTH - RIGHT + 0.5, bottom = HEIGHT - BOTTOM + 0.5;

    straight(d, LEFT + 0.5, TOP + 0.5, LEFT + 0.5, bottom, 1.0, ink);
    straight(d, LEFT + 0.5, bottom, right, bottom, 1.0, ink);
    text_at(d, LEFT, 0.5 * (TOP - TEXT_HEIGHT), ink, d->p->title);
}

/* ---- lines ---- */

static void draw_guide(drawing *d, double slope, const char *name)
{
    const double step = 0.2, last = d->p->count - 1.0;
    const double middle = 0.42 * last;
    double at;

    for (at = 0.0; at + 0.5 * step <= last; at += step)
        straight(d, place_x(d, at), place_y(d, guide_at(d->p, slope, at)),
                 place_x(d, at + 0.5 * step),
                 place_y(d, guide_at(d->p, slope, at + 0.5 * step)), 1.5, guide);
    at = place_y(d, guide_at(d->p, slope, middle));
    if (slope > -0.75)              /* above its line, which falls to the right */
        text_at(d, place_x(d, middle) + 6.0, at - TEXT_HEIGHT - 10.0, guide, name);
    else                            /* below */
        text_at(d, place_x(d, middle) - TEXT_WIDTH * (double)strlen(name) - 6.0, at + 10.0,
                guide, name);
}

static void draw_series(drawing *d, const plot_series *series)
{
    int i;

    for (i = 0; i + 1 < d->p->count; i++)
        straight(d, place_x(d, i), place_y(d, series->values[i]), place_x(d, i + 1),
                 place_y(d, series->values[i + 1]), 2.5, series->colour);
}

typedef struct name_place { int series; double wanted, y; } name_place;

static int higher(const void *a, const void *b)
{
    const double left = ((const name_place *)a)->wanted, right = ((const name_place *)b)->wanted;

    return (left > right) - (left < right);
}

/* Names keep their order and their distance: pushed down from the top, then up from the bottom,
   halfway between the two. */
static void spread_names(name_place *names, int count)
{
    double down[PLOT_SERIES_MAX], up[PLOT_SERIES_MAX];
    int i;

    for (i = 0; i < count; i++)
        down[i] = i ? fmax(names[i].wanted, down[i - 1] + NAME_SPACING) : names[i].wanted;
    for (i = count - 1; i >= 0; i--)
        up[i] = i + 1 < count ? fmin(names[i].wanted, up[i + 1] - NAME_SPACING)
                              : names[i].wanted;
    for (i = 0; i < count; i++)
        names[i].y = 0.5 * (down[i] + up[i]);
}

static void draw_names(drawing *d)
{
    const plot *p = d->p;
    const double right = WIDTH - RIGHT;
    name_place names[PLOT_SERIES_MAX];
    int i;

    for (i = 0; i < p->series_count; i++) {
        names[i].series = i;
        names[i].wanted = place_y(d, p->series[i].values[p->count - 1]);
    }
    qsort(names, (size_t)p->series_count, sizeof names[0], higher);
    spread_names(names, p->series_count);
    for (i = 0; i < p->series_count; i++) {
        const plot_series *series = &p->series[names[i].series];

        straight(d, right + 3.0, names[i].wanted, right + 18.0, names[i].y, 1.0,
                 series->colour);
        text_at(d, right + 24.0, names[i].y - 0.5 * TEXT_HEIGHT, series->colour, series->name);
    }
}

int plot_write(const plot *p, const char *path, char *error, size_t error_size)
{
    drawing d;
    int i, written;

    d.p = p;
    if (!picture_alloc(&d.canvas, WIDTH, HEIGHT))
        return image_fail(error, error_size, path, "out of memory");
    picture_fill(&d.canvas, 0, 0, WIDTH, HEIGHT, paper);
    fit_axis(&d);
    draw_x_axis(&d);
    draw_y_axis(&d);
    draw_frame(&d);
    draw_guide(&d, -0.5, "N^-1/2");
    draw_guide(&d, -1.0, "N^-1");
    for (i = p->series_count - 1; i >= 0; i--)
        draw_series(&d, &p->series[i]);
    draw_names(&d);
    written = picture_write(&d.canvas, path, error, error_size);
    picture_free(&d.canvas);
    return written;
}
