/* hdr.h: RGB images from Radiance files (.hdr, .pic, .rgbe).
 *
 *     image map;
 *     if (!hdr_read("studio.hdr", &map, error, sizeof error)) { puts(error); return 1; }
 *
 * image_read calls this for files that begin with "#?". Rows may be flat or in old or new runs, and
 * all eight orientations of the resolution line are turned so that row 0 is the top and column 0
 * the left edge. EXPOSURE and COLORCORR lines are divided out, as the format says, which gives
 * radiance as it was before a picture was adjusted; some other readers ignore them. A texel is
 * mantissa x 2^(exponent - 136) without the half step that Radiance itself adds, as most readers
 * have it. XYZE is refused. Results and errors are those of image.h.
 */
#ifndef HDR_H
#define HDR_H

#include "image.h"

int hdr_read(const char *path, image *out, char *error, size_t error_size);

/* A file in memory; `path` is only for the error. */
int hdr_decode(const unsigned char *bytes, size_t count, const char *path, image *out,
               char *error, size_t error_size);

#endif
