/* load.h: the pixels of a map's file and nothing else, as stbi_loadf gives them. image.c has it.
 *
 *     int width, height;
 *     float *pixels = load_map("sky.hdr", &width, &height);     three floats a texel, row 0 first
 *     ...
 *     free(pixels);
 */
#ifndef LOAD_H
#define LOAD_H

#ifdef __cplusplus
extern "C" {
#endif

/* Kinds of files and limits are those of image_read. NULL, with one line on stderr, if it fails. */
float *load_map(const char *path, int *width, int *height);

#ifdef __cplusplus
}
#endif

#endif
