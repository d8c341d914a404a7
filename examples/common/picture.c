/* picture.c: see picture.h. */
#include "picture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- font: five columns by seven rows, the leftmost column in bit 4 ---- */

static const char glyph_names[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.,:%+-/()=^";

static const unsigned char glyph_rows[][PICTURE_GLYPH_HEIGHT] = {
    {0x0e, 0x11, 0x11, 0x1f, 0x11, 0x11, 0x11}, {0x1e, 0x11, 0x11, 0x1e, 0x11, 0x11, 0x1e},
    {0x0e, 0x11, 0x10, 0x10, 0x10, 0x11, 0x0e}, {0x1e, 0x11, 0x11, 0x11, 0x11, 0x11, 0x1e},
    {0x1f, 0x10, 0x10, 0x1e, 0x10, 0x10, 0x1f}, {0x1f, 0x10, 0x10, 0x1e, 0x10, 0x10, 0x10},
    {0x0e, 0x11, 0x10, 0x17, 0x11, 0x11, 0x0f}, {0x11, 0x11, 0x11, 0x1f, 0x11, 0x11, 0x11},
    {0x0e, 0x04, 0x04, 0x04, 0x04, 0x04, 0x0e}, {0x07, 0x02, 0x02, 0x02, 0x02, 0x12, 0x0c},
    {0x11, 0x12, 0x14, 0x18, 0x14, 0x12, 0x11}, {0x10, 0x10, 0x10, 0x10, 0x10, 0x10, 0x1f},
    {0x11, 0x1b, 0x15, 0x15, 0x11, 0x11, 0x11}, {0x11, 0x19, 0x15, 0x15, 0x13, 0x11, 0x11},
    {0x0e, 0x11, 0x11, 0x11, 0x11, 0x11, 0x0e}, {0x1e, 0x11, 0x11, 0x1e, 0x10, 0x10, 0x10},
    {0x0e, 0x11, 0x11, 0x11, 0x15, 0x12, 0x0d}, {0x1e, 0x11, 0x11, 0x1e, 0x14, 0x12, 0x11},
    {0x0f, 0x10, 0x10, 0x0e, 0x01, 0x01, 0x1e}, {0x1f, 0x04, 0x04, 0x04, 0x04, 0x04, 0x04},
    {0x11, 0x11, 0x11, 0x11, 0x11, 0x11, 0x0e}, {0x11, 0x11, 0x11, 0x11, 0x0a, 0x0a, 0x04},
    {0x11, 0x11, 0x11, 0x15, 0x15, 0x1b, 0x11}, {0x11, 0x11, 0x0a, 0x04, 0x0a, 0x11, 0x11},
    {0x11, 0x11, 0x0a, 0x04, 0x04, 0x04, 0x04}, {0x1f, 0x01, 0x02, 0x04, 0x08, 0x10, 0x1f},
    {0x0e, 0x11, 0x13, 0x15, 0x19, 0x11, 0x0e}, {0x04, 0x0c, 0x04, 0x04, 0x04, 0x04, 0x0e},
    {0x0e, 0x11, 0x01, 0x06, 0x08, 0x10, 0x1f}, {0x1f, 0x02, 0x04, 0x06, 0x01, 0x11, 0x0e},
    {0x02, 0x06, 0x0a, 0x12, 0x1f, 0x02, 0x02}, {0x1f, 0x10, 0x1e, 0x01, 0x01, 0x11, 0x0e},
    {0x06, 0x08, 0x10, 0x1e, 0x11, 0x11, 0x0e}, {0x1f, 0x01, 0x02, 0x02, 0x04, 0x04, 0x04},
    {0x0e, 0x11, 0x11, 0x0e, 0x11, 0x11, 0x0e}, {0x0e, 0x11, 0x11, 0x0f, 0x01, 0x02, 0x0c},
    {0x00, 0x00, 0x00, 0x00, 0x00, 0x0c, 0x0c}, {0x00, 0x00, 0x00, 0x00, 0x0c, 0x04, 0x08},
    {0x00, 0x0c, 0x0c, 0x00, 0x0c, 0x0c, 0x00}, {0x18, 0x19, 0x02, 0x04, 0x08, 0x13, 0x03},
    {0x00, 0x04, 0x04, 0x1f, 0x04, 0x04, 0x00}, {0x00, 0x00, 0x00, 0x1f, 0x00, 0x00, 0x00},
    {0x01, 0x01, 0x02, 0x04, 0x08, 0x10, 0x10}, {0x02, 0x04, 0x08, 0x08, 0x08, 0x04, 0x02},
    {0x08, 0x04, 0x02, 0x02, 0x02, 0x04, 0x08}, {0x00, 0x00, 0x1f, 0x00, 0x1f, 0x00, 0x00},
    {0x04, 0x0a, 0x11, 0x00, 0x00, 0x00, 0x00}
};

static const unsigned char *glyph_of(char c)
{
    const char *found;

    if (c >= 'a' && c <= 'z')
        c = (char)(c - 'a' + 'A');
    found = c ? strchr(glyph_names, c) : NULL;
    return found ? glyph_rows[found - glyph_names] : NULL;
}

/* ---- drawing ---- */

int picture_alloc(picture *out, int width, int height)
{
    out->width = out->height = 0;
    out->rgb = NULL;
    if (!image_size_valid(width, height))
        return 0;
    out->rgb = calloc((size_t)width * (size_t)height, 3);
    if (!out->rgb)
        return 0;
    out->width = width;
    out->height = height;
    return 1;
}

void picture_free(picture *canvas)
{
    free(canvas->rgb);
    canvas->rgb = NULL;
    canvas->width = canvas->height = 0;
}

static unsigned char *pixel_at(const picture *canvas, int x, int y)
{
    if (x < 0 || y < 0 || x >= canvas->width || y >= canvas->height)
        return NULL;
    return canvas->rgb + 3 * ((size_t)y * (size_t)canvas->width + (size_t)x);
}

void picture_blend(picture *canvas, int x, int y, const unsigned char colour[3], float cover)
{
    unsigned char *pixel = pixel_at(canvas, x, y);
    int i;

    for (i = 0; pixel && i < 3; i++)
        pixel[i] = (unsigned char)((float)pixel[i] * (1.0f - cover) + (float)colour[i] * cover
                                   + 0.5f);
}

void picture_fill(picture *canvas, int x, int y, int width, int height,
                  const unsigned char colour[3])
{
    int i, j;

    for (j = 0; j < height; j++)
        for (i = 0; i < width; i++)
            picture_blend(canvas, x + i, y + j, colour, 1.0f);
}

/* Distance of (x, y) to the line from a to b. */
static double line_distance(double x, double y, const double a[2], const double b[2])
{
    const double dx = b[0] - a[0], dy = b[1] - a[1], square = dx * dx + dy * dy;
    double t = square > 0.0 ? ((x - a[0]) * dx + (y - a[1]) * dy) / square : 0.0;

    t = t > 0.0 ? (t < 1.0 ? t : 1.0) : 0.0;
    return hypot(x - a[0] - t * dx, y - a[1] - t * dy);
}

void picture_line(picture *canvas, const double a[2], const double b[2], double width,
                  const unsigned char colour[3])
{
    const double reach = 0.5 * width + 0.5;
    const int x0 = (int)fmax(fmin(a[0], b[0]) - reach, 0.0);
    const int y0 = (int)fmax(fmin(a[1], b[1]) - reach, 0.0);
    const int x1 = (int)fmin(fmax(a[0], b[0]) + reach, canvas->width - 1.0);
    const int y1 = (int)fmin(fmax(a[1], b[1]) + reach, canvas->height - 1.0);
    int x, y;

    for (y = y0; y <= y1; y++)
        for (x = x0; x <= x1; x++) {
            const double inside = reach - line_distance(x + 0.5, y + 0.5, a, b);

            if (inside > 0.0)
                picture_blend(canvas, x, y, colour, (float)fmin(inside, 1.0));
        }
}

static void draw_glyph(picture *canvas, int x, int y, int scale, const unsigned char colour[3],
                       const unsigned char *rows)
{
    int i, j;

    for (j = 0; j < PICTURE_GLYPH_HEIGHT; j++)
        for (i = 0; i < 5; i++)
            if (rows[j] >> (4 - i) & 1)
                picture_fill(canvas, x + i * scale, y + j * scale, scale, scale, colour);
}

void picture_text(picture *canvas, int x, int y, int scale, const unsigned char colour[3],
                  const char *text)
{
    for (; *text; text++, x += PICTURE_GLYPH_WIDTH * scale) {
        const unsigned char *rows = glyph_of(*text);

        if (rows)
            draw_glyph(canvas, x, y, scale, colour, rows);
    }
}

/* ---- maps ---- */

/* The texels first .. last-1 that pixel `i` of `count` covers: at least one. */
static void covered(int i, int count, int texels, int *first, int *last)
{
    *first = (int)((long long)i * texels / count);
    *last = (int)((long long)(i + 1) * texels / count);
    if (*last == *first)
        *last = *first + 1;
}

static void mean_texel(const image *map, int x0, int x1, int y0, int y1, float mean[3])
{
    const float share = 1.0f / ((float)(x1 - x0) * (float)(y1 - y0));
    int x, y, i;

    mean[0] = mean[1] = mean[2] = 0.0f;
    for (y = y0; y < y1; y++)
        for (x = x0; x < x1; x++)
            for (i = 0; i < 3; i++)
                mean[i] += share * map->rgb[3 * ((size_t)y * (size_t)map->width + (size_t)x)
                                            + (size_t)i];
}

void picture_map(picture *canvas, int x, int y, int width, int height, const image *map,
                 float exposure)
{
    float mean[3];
    image one = {1, 1, NULL};
    int i, j, x0, x1, y0, y1;

    one.rgb = mean;
    for (j = 0; j < height; j++)
        for (i = 0; i < width; i++) {
            unsigned char *pixel = pixel_at(canvas, x + i, y + j);

            covered(i, width, map->width, &x0, &x1);
            covered(j, height, map->height, &y0, &y1);
            mean_texel(map, x0, x1, y0, y1, mean);
            if (pixel)
                image_tonemap(&one, exposure, pixel);
        }
}

int picture_write(const picture *canvas, const char *path, char *error, size_t error_size)
{
    return image_write_png(path, canvas->width, canvas->height, canvas->rgb, error, error_size);
}
