/* exr_to_pfm.c: turns an EXR image, or a Radiance HDR one, into a PFM one.
 *
 *     exr_to_pfm in.exr out.pfm
 */
#include "image.h"

#include <stdio.h>

int main(int argument_count, char **arguments)
{
    image map;
    char error[512];
    int done;

    if (argument_count != 3) {
        fprintf(stderr, "usage: exr_to_pfm in.exr out.pfm\n");
        return 2;
    }
    done = image_read(arguments[1], &map, error, sizeof error) &&
           image_write_pfm(arguments[2], &map, error, sizeof error);
    if (!done)
        fprintf(stderr, "exr_to_pfm: %s\n", error);
    image_free(&map);
    return done ? 0 : 1;
}
