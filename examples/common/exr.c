/* exr.c: exr.h by way of OpenEXR's C interface. */
#include "exr.h"

#include <ImfCRgbaFile.h>

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define HALF_MAX 65504.0f

/* The library wants the address of texel (0, 0) of the plane, which may lie far outside the
 * buffer: integer arithmetic forms it without an invalid pointer expression. */
static ImfRgba *plane_origin(ImfRgba *texels, int x_min, int y_min, int width)
{
    const intptr_t offset = (intptr_t)y_min * width + x_min;

    return (ImfRgba *)((intptr_t)texels - offset * (intptr_t)sizeof(ImfRgba));
}

static void unpack_texels(const ImfRgba *texels, image *out)
{
    const size_t count = (size_t)out->width * (size_t)out->height;
    size_t i;

    for (i = 0; i < count; i++) {
        out->rgb[3 * i] = ImfHalfToFloat(texels[i].r);
        out->rgb[3 * i + 1] = ImfHalfToFloat(texels[i].g);
        out->rgb[3 * i + 2] = ImfHalfToFloat(texels[i].b);
    }
}

static int read_window(ImfInputFile *file, const char *path, image *out,
                       char *error, size_t error_size)
{
    int x_min, y_min, x_max, y_max, done = 0;
    long long width, height;
    ImfRgba *texels;

    ImfHeaderDataWindow(ImfInputHeader(file), &x_min, &y_min, &x_max, &y_max);
    width = (long long)x_max - x_min + 1;
    height = (long long)y_max - y_min + 1;
    if (!image_size_valid(width, height))
        return image_fail(error, error_size, path, "has a data window of %lld x %lld texels, "
                          "which is outside what can be read", width, height);
    texels = (ImfRgba *)calloc((size_t)(width * height), sizeof *texels);
    if (!texels || !image_alloc(out, (int)width, (int)height))
        image_fail(error, error_size, path, "does not fit in memory");
    else if (!ImfInputSetFrameBuffer(file, plane_origin(texels, x_min, y_min, (int)width), 1,
                                     (size_t)width) ||
             !ImfInputReadPixels(file, y_min, y_max))
        image_fail(error, error_size, path, "cannot be read: %s", ImfErrorMessage());
    else
        done = 1;
    if (done)
        unpack_texels(texels, out);
    else
        image_free(out);
    free(texels);
    return done;
}

int exr_read(const char *path, image *out, char *error, size_t error_size)
{
    ImfInputFile *file;
    FILE *stream = image_open(path, error, error_size);
    int done;

    memset(out, 0, sizeof *out);
    /* Opened first here, because the system's reason is clearer than the library's. */
    if (!stream)
        return 0;
    fclose(stream);
    file = ImfOpenInputFile(path);
    if (!file)
        return image_fail(error, error_size, path, "is not a readable EXR file: %s",
                          ImfErrorMessage());
    done = read_window(file, path, out, error, error_size);
    ImfCloseInputFile(file);
    return done;
}

static ImfHalf pack_half(float value)
{
    ImfHalf half;

    if (value > HALF_MAX)
        value = HALF_MAX;
    if (value < -HALF_MAX)
        value = -HALF_MAX;
    ImfFloatToHalf(value, &half);
    return half;
}

/* The caller frees the result. NULL without memory. */
static ImfRgba *pack_texels(const image *map)
{
    const size_t count = (size_t)map->width * (size_t)map->height;
    ImfRgba *texels = (ImfRgba *)malloc(count * sizeof *texels);
    size_t i;

    for (i = 0; texels && i < count; i++) {
        texels[i].r = pack_half(map->rgb[3 * i]);
        texels[i].g = pack_half(map->rgb[3 * i + 1]);
        texels[i].b = pack_half(map->rgb[3 * i + 2]);
        texels[i].a = pack_half(1.0f);
    }
    return texels;
}

static int write_texels(const char *path, const ImfHeader *header, const image *map,
                        const ImfRgba *texels)
{
    ImfOutputFile *file = ImfOpenOutputFile(path, header, IMF_WRITE_RGBA);
    int done;

    if (!file)
        return 0;
    done = ImfOutputSetFrameBuffer(file, texels, 1, (size_t)map->width) &&
           ImfOutputWritePixels(file, map->height);
    return ImfCloseOutputFile(file) && done;
}

int exr_write(const char *path, const image *map, char *error, size_t error_size)
{
    char temporary[IMAGE_PATH_MAX];
    ImfHeader *header = ImfNewHeader();
    ImfRgba *texels = pack_texels(map);
    int done = 0;

    if (!header || !texels) {
        image_fail(error, error_size, path, "not enough memory to write an EXR file");
    } else if (image_temporary_path(path, temporary, error, error_size)) {
        ImfHeaderSetDisplayWindow(header, 0, 0, map->width - 1, map->height - 1);
        ImfHeaderSetDataWindow(header, 0, 0, map->width - 1, map->height - 1);
        ImfHeaderSetCompression(header, IMF_ZIP_COMPRESSION);
        if (write_texels(temporary, header, map, texels)) {
            done = image_publish(temporary, path, error, error_size);
        } else {
            image_fail(error, error_size, path, "cannot be written: %s", ImfErrorMessage());
            remove(temporary);
        }
    }
    if (header)
        ImfDeleteHeader(header);
    free(texels);
    return done;
}
