/* exr.h: RGB images from and to OpenEXR files, through OpenEXR's C interface.
 *
 * Needs the OpenEXR library (pkg-config OpenEXR); image_read calls this when it is compiled with
 * -DHAVE_OPENEXR. That interface works in half floats: radiance above 65504 in a file of full
 * floats is read as infinity. Results and errors are those of image.h.
 */
#ifndef EXR_H
#define EXR_H

#include "image.h"

/* The image is the file's data window, wherever in the plane that window lies. */
int exr_read(const char *path, image *out, char *error, size_t error_size);

/* Half RGBA with alpha 1, ZIP compression; radiance is clipped to 65504. */
int exr_write(const char *path, const image *map, char *error, size_t error_size);

#endif
