/* image.h: float RGB images in memory, read from HDR, EXR and PFM files, written as PFM and PNG.
 *
 *     image map;
 *     char error[256];
 *     if (!image_read("studio.pfm", &map, error, sizeof error)) { puts(error); return 1; }
 *     ...
 *     image_free(&map);
 *
 * Every function that returns int gives 1 on success and 0 on failure. A failure puts one line,
 * "path: reason", in `error` (error_size bytes, may be NULL), owns nothing and leaves no file.
 * Link image.c, hdr.c and -lm. EXR files need -DHAVE_OPENEXR, exr.c and the OpenEXR library.
 */
#ifndef IMAGE_H
#define IMAGE_H

#include <stddef.h>
#include <stdio.h>

#define IMAGE_SIDE_MAX 65536
#define IMAGE_TEXELS_MAX (1L << 28)

/* Linear radiance, three floats a texel, rows packed, row 0 first. */
typedef struct image {
    int width, height;
    float *rgb;
} image;

/* Zeroed texels. Fails on a side below 1 or above IMAGE_SIDE_MAX, more than IMAGE_TEXELS_MAX
 * texels, or too little memory; *out is then empty, and image_free on it is harmless. */
int image_alloc(image *out, int width, int height);

void image_free(image *map);

/* What is no radiance becomes 0, channel by channel: negative, infinite, NaN. */
void image_clean(image *map);

/* Reads a Radiance HDR, an EXR or a PFM file, told apart by its first bytes, not by its name. Of
 * a PNG, TIFF or other well-known kind the error says what it is, and what converts it. */
int image_read(const char *path, image *out, char *error, size_t error_size);

/* Colour or grey PFM of either byte order, times the size of the header's scale. */
int image_read_pfm(const char *path, image *out, char *error, size_t error_size);

/* Colour PFM in the byte order of this machine; reads back bit for bit. */
int image_write_pfm(const char *path, const image *map, char *error, size_t error_size);

/* PNG of 8 bits a channel, `rgb` being 3 * width * height bytes of sRGB, row 0 on top. */
int image_write_png(const char *path, int width, int height, const unsigned char *rgb,
                    char *error, size_t error_size);

/* Multiplies by `exposure`, clips to [0, 1] (NaN to 0) and encodes as sRGB into 3 bytes a texel. */
void image_tonemap(const image *map, float exposure, unsigned char *rgb);

/* ---- for other file formats beside this one ---- */

#define IMAGE_PATH_MAX 4096

/* Whether a map of this size can be allocated and indexed. */
int image_size_valid(long long width, long long height);

/* Puts "path: reason" into `error`, on one line, and returns 0. */
#if defined(__GNUC__)
__attribute__((format(printf, 4, 5)))
#endif
int image_fail(char *error, size_t error_size, const char *path, const char *format, ...);

/* Opens a file to be read; NULL, with the error, also for a folder, a pipe or a device. */
FILE *image_open(const char *path, char *error, size_t error_size);

/* All bytes of a file, to be freed; NULL with the error. */
unsigned char *image_read_bytes(const char *path, size_t *count, char *error, size_t error_size);

/* Files are written under a temporary name beside `path`, and renamed once complete. Fails where
   `path` is a folder, a pipe or a device, which a file would replace. */
int image_temporary_path(const char *path, char temporary[IMAGE_PATH_MAX],
                         char *error, size_t error_size);

/* Renames the complete temporary file to `path`, or removes it when that fails. */
int image_publish(const char *temporary, const char *path, char *error, size_t error_size);

#endif
