/* plot.h: lines over powers of two on logarithmic axes, drawn as a PNG.
 *
 *     plot_series series[] = { { "INVERSION", { 200, 60, 50 }, errors } };
 *     plot p = { "RMSE", "SAMPLES", 4.0, 11, series, 1 };
 *     plot_write(&p, "convergence.png", error, sizeof error);
 *
 * Two dashed guides show the slopes -1/2 and -1. Link image.c, hdr.c and picture.c.
 */
#ifndef PLOT_H
#define PLOT_H

#include <stddef.h>

#define PLOT_SERIES_MAX 8

typedef struct plot_series {
    const char *name;
    unsigned char colour[3];
    const double *values;           /* `count` of the plot, above 0 */
} plot_series;

typedef struct plot {
    const char *title, *x_title;
    double first;                   /* of the values on the x axis: first, 2 first, 4 first.. */
    int count;
    const plot_series *series;
    int series_count;               /* 1..PLOT_SERIES_MAX */
} plot;

/* As image_write_png. */
int plot_write(const plot *p, const char *path, char *error, size_t error_size);

#endif
