/* picture.h: 8-bit pictures to draw on, with a small font, written as PNG.
 *
 *     picture canvas;
 *     if (picture_alloc(&canvas, 640, 360)) {
 *         picture_text(&canvas, 10, 10, 2, white, "RMSE 0.013");
 *         picture_write(&canvas, "out.png", error, sizeof error);
 *     }
 *     picture_free(&canvas);
 *
 * Link image.c, hdr.c and -lm. What falls outside of a picture is not drawn.
 */
#ifndef PICTURE_H
#define PICTURE_H

#include "image.h"

/* sRGB, three bytes a pixel, row 0 on top. */
typedef struct picture {
    int width, height;
    unsigned char *rgb;
} picture;

#define PICTURE_GLYPH_WIDTH 6   /* pixels, the gap included, at scale 1 */
#define PICTURE_GLYPH_HEIGHT 7

/* A black picture. Returns 0, with *out empty, on a side below 1 or too little memory. */
int  picture_alloc(picture *out, int width, int height);
void picture_free(picture *canvas);

/* Moves a pixel towards a colour: `cover` 0 leaves it, 1 replaces it. */
void picture_blend(picture *canvas, int x, int y, const unsigned char colour[3], float cover);

void picture_fill(picture *canvas, int x, int y, int width, int height,
                  const unsigned char colour[3]);

/* A smooth line with round ends; `width` in pixels, whose centres lie at halves. */
void picture_line(picture *canvas, const double a[2], const double b[2], double width,
                  const unsigned char colour[3]);

/* Writes text with its top left corner at (x, y), `scale` pixels a dot. Lower-case letters are
 * drawn as capitals; what the font lacks, as a space. */
void picture_text(picture *canvas, int x, int y, int scale, const unsigned char colour[3],
                  const char *text);

/* A map shrunk, or grown, into the rectangle: each pixel the mean of its texels, tone-mapped. */
void picture_map(picture *canvas, int x, int y, int width, int height, const image *map,
                 float exposure);

/* As image_write_png. */
int picture_write(const picture *canvas, const char *path, char *error, size_t error_size);

#endif
