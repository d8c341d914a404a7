/* hdr.c: see hdr.h. A file is a header of lines, an empty line, the resolution line, scanlines. */
#include "hdr.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* New runs are possible for scanlines of these lengths only. */
#define NEW_RUNS_MIN 8
#define NEW_RUNS_MAX 32767

/* A file's bytes, where the next one is, and where an error goes. */
typedef struct source {
    const unsigned char *bytes;
    size_t count, at;
    const char *path;
    char *error;
    size_t error_size;
} source;

/* Scanlines of `length` texels each. Texel i of scanline s is texel start + s line_step + i step of
 * the image. */
typedef struct layout {
    int scanlines, length, width, height;
    long start, line_step, step;
    float factor[3];            /* of radiance, by channel */
} layout;

static int fail(const source *s, const char *reason)
{
    return image_fail(s->error, s->error_size, s->path, "%s", reason);
}

/* ---- header ---- */

/* The next line without its end, cut to fit. Returns 0, with the error, if there is none. */
static int read_line(source *s, char *line, size_t size)
{
    size_t used = 0;

    while (s->at < s->count) {
        const char c = (char)s->bytes[s->at++];
        if (c == '\n' && used > 0 && s->bytes[s->at - 2] == '\r')
            return fail(s, "has lines that end with a carriage return: a transfer as text has "
                           "changed its bytes");
        line[used] = '\0';
        if (c == '\n')
            return 1;
        if (used + 1 < size)
            line[used++] = c;
    }
    return fail(s, "ends within its header");
}

/* Divides `count` factors by numbers from text; 0 if one is missing or not above zero. */
static int divide(const char *text, int count, double *factor)
{
    double value = 0.0;
    char *end;
    int c;

    for (c = 0; c < 3; c++) {
        if (c < count) {
            value = strtod(text, &end);
            if (end == text || !(value > 0.0 && value <= DBL_MAX))
                return 0;
            text = end;
        }
        factor[c] /= value;
    }
    return 1;
}

static int read_variable(const source *s, const char *line, double factor[3])
{
    if (strncmp(line, "EXPOSURE=", 9) == 0)
        return divide(line + 9, 1, factor) || fail(s, "has an EXPOSURE that is no number above 0");
    if (strncmp(line, "COLORCORR=", 10) == 0)
        return divide(line + 10, 3, factor) ||
               fail(s, "has a COLORCORR that is not three numbers above 0");
    if (strncmp(line, "FORMAT=", 7) != 0 || strcmp(line + 7, "32-bit_rle_rgbe") == 0)
        return 1;
    if (strcmp(line + 7, "32-bit_rle_xyze") == 0)
        return fail(s, "holds XYZE colours, which are not read; ra_xyze -r in.hdr out.hdr "
                       "converts it");
    return image_fail(s->error, s->error_size, s->path, "has the format '%.40s', where only "
                      "32-bit_rle_rgbe is read", line + 7);
}

/* Lines up to the empty one. */
static int read_header(source *s, float factor[3])
{
    double all[3] = { 1.0, 1.0, 1.0 };
    char line[256];
    int c;

    if (!read_line(s, line, sizeof line))
        return 0;
    if (strncmp(line, "#?", 2) != 0)
        return fail(s, "is not a Radiance file: it does not begin with #?");
    do {
        if (!read_line(s, line, sizeof line) || !read_variable(s, line, all))
            return 0;
    } while (line[0]);
    for (c = 0; c < 3; c++) {
        if (!(all[c] >= (double)FLT_MIN && all[c] <= (double)FLT_MAX))
            return fail(s, "has EXPOSURE or COLORCORR lines beyond what a float holds");
        factor[c] = (float)all[c];
    }
    return 1;
}

/* ---- resolution line ---- */

/* One of +X, -X, +Y, -Y and a number of texels along it. */
typedef struct axis { int sign, name; long texels; } axis;

static int read_axis(const char **text, axis *a)
{
    const char *at = *text;
    char *end;

    if ((at[0] != '+' && at[0] != '-') || (at[1] != 'X' && at[1] != 'Y') || at[2] != ' ' ||
        at[3] < '0' || at[3] > '9')
        return 0;
    a->sign = at[0];
    a->name = at[1];
    a->texels = strtol(at + 3, &end, 10);
    while (*end == ' ')
        end++;
    *text = end;
    return 1;
}

/* Y grows upwards, so -Y is from the top down, as rows are here. */
static long axis_layout(const axis *a, long width, long *start)
{
    const long step = a->name == 'X' ? 1 : width;

    if ((a->sign == '+') == (a->name == 'X'))
        return step;
    *start += step * (a->texels - 1);
    return -step;
}

static int read_resolution(source *s, layout *out)
{
    const char *text;
    char line[64];
    axis axes[2];
    long width, height;

    if (!read_line(s, line, sizeof line))
        return 0;
    text = line;
    if (!read_axis(&text, &axes[0]) || !read_axis(&text, &axes[1]) || *text ||
        axes[0].name == axes[1].name)
        return image_fail(s->error, s->error_size, s->path, "has no resolution line such as "
                          "'-Y 512 +X 1024', but '%.40s'", line);
    width = axes[axes[0].name != 'X'].texels;
    height = axes[axes[0].name == 'X'].texels;
    if (!image_size_valid(width, height))
        return image_fail(s->error, s->error_size, s->path, "has a size of %ld x %ld texels, which "
                          "is outside what can be read", width, height);
    out->width = (int)width;
    out->height = (int)height;
    out->scanlines = (int)axes[0].texels;
    out->length = (int)axes[1].texels;
    out->start = 0;
    out->line_step = axis_layout(&axes[0], width, &out->start);
    out->step = axis_layout(&axes[1], width, &out->start);
    return 1;
}

/* ---- scanlines, each into 4 bytes a texel ---- */

typedef enum outcome { GOOD, CUT_OFF, DAMAGED } outcome;

/* The four bytes of a texel, each in runs (a count above 128, and the byte) and literals. */
static outcome read_new_runs(source *s, unsigned char *row, int length)
{
    int c, i, n;

    for (c = 0; c < 4; c++)
        for (i = 0; i < length; ) {
            int same;
            if (s->count - s->at < 2)
                return CUT_OFF;
            n = s->bytes[s->at++];
            same = n > 128;
            n -= same ? 128 : 0;
            if (n == 0 || n > length - i)
                return DAMAGED;
            if (s->count - s->at < (same ? 1u : (size_t)n))
                return CUT_OFF;
            for (; n > 0; n--, i++) {
                row[4 * i + c] = s->bytes[s->at];
                s->at += (same && n > 1) ? 0 : 1;
            }
        }
    return GOOD;
}

/* Texels as they are; mantissas of 1 1 1 say that the last one is repeated `exponent` times, with
 * higher bytes of that number in further such texels. */
static outcome read_old_runs(source *s, unsigned char *row, int length)
{
    int i = 0, shift = 0;

    while (i < length) {
        const unsigned char *texel = s->bytes + s->at;
        if (s->count - s->at < 4)
            return CUT_OFF;
        s->at += 4;
        if (texel[0] == 1 && texel[1] == 1 && texel[2] == 1) {
            long repeats = shift < 24 ? (long)texel[3] << shift : -1;
            if (i == 0 || repeats < 0 || repeats > length - i)
                return DAMAGED;
            for (; repeats > 0; repeats--, i++)
                memcpy(row + 4 * i, row + 4 * (i - 1), 4);
            shift += 8;
        } else {
            memcpy(row + 4 * i++, texel, 4);
            shift = 0;
        }
    }
    return GOOD;
}

static outcome read_scanline(source *s, unsigned char *row, int length)
{
    const unsigned char *head = s->bytes + s->at;

    if (length < NEW_RUNS_MIN || length > NEW_RUNS_MAX || s->count - s->at < 4 || head[0] != 2 ||
        head[1] != 2 || head[2] > 127)
        return read_old_runs(s, row, length);
    s->at += 4;
    if ((head[2] << 8 | head[3]) != length)
        return DAMAGED;
    return read_new_runs(s, row, length);
}

/* ---- texels ---- */

static void put_scanline(const layout *l, const float scales[256], int scanline,
                         const unsigned char *row, image *out)
{
    long at = l->start + l->line_step * scanline;
    int i, c;

    for (i = 0; i < l->length; i++, at += l->step, row += 4)
        for (c = 0; c < 3; c++)
            out->rgb[3 * at + c] = (float)row[c] * scales[row[3]] * l->factor[c];
}

static int read_scanlines(source *s, const layout *l, unsigned char *row, image *out)
{
    float scales[256];
    int i;

    scales[0] = 0.0f;
    for (i = 1; i < 256; i++)
        scales[i] = ldexpf(1.0f, i - 136);
    for (i = 0; i < l->scanlines; i++) {
        const outcome got = read_scanline(s, row, l->length);
        if (got != GOOD)
            return image_fail(s->error, s->error_size, s->path, got == CUT_OFF ?
                              "ends within scanline %d of %d" : "is damaged in scanline %d of %d",
                              i + 1, l->scanlines);
        put_scanline(l, scales, i, row, out);
    }
    return 1;
}

int hdr_decode(const unsigned char *bytes, size_t count, const char *path, image *out,
               char *error, size_t error_size)
{
    source s = { bytes, count, 0, path, error, error_size };
    unsigned char *row;
    layout l = { 0, 0, 0, 0, 0, 0, 0, { 1.0f, 1.0f, 1.0f } };
    int done = 0;

    memset(out, 0, sizeof *out);
    if (!read_header(&s, l.factor) || !read_resolution(&s, &l))
        return 0;
    /* So that a few damaged bytes do not ask for gigabytes: no scanline takes less than a texel. */
    if ((s.count - s.at) / 4 < (size_t)l.scanlines)
        return image_fail(error, error_size, path, "has a size of %d x %d texels, but ends after "
                          "%lu bytes of them", l.width, l.height, (unsigned long)(s.count - s.at));
    row = (unsigned char *)malloc(4 * (size_t)l.length);
    if (!row || !image_alloc(out, l.width, l.height))
        fail(&s, "does not fit in memory");
    else
        done = read_scanlines(&s, &l, row, out);
    free(row);
    if (!done)
        image_free(out);
    return done;
}

int hdr_read(const char *path, image *out, char *error, size_t error_size)
{
    size_t count;
    unsigned char *bytes = image_read_bytes(path, &count, error, error_size);
    int done;

    memset(out, 0, sizeof *out);
    if (!bytes)
        return 0;
    done = hdr_decode(bytes, count, path, out, error, error_size);
    free(bytes);
    return done;
}
