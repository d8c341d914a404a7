/* fuzz_hdr.c: the reader of .hdr files on any bytes: it refuses them with one line, or gives an image
 * whose texels are finite and not negative. For fuzz.sh. */
#include "hdr.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

extern int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char error[200] = "";
    image map;
    size_t i, count;

    if (!hdr_decode(data, size, "fuzzed", &map, error, sizeof error)) {
        if (!error[0] || strchr(error, '\n') || map.rgb)
            abort();
        return 0;
    }
    count = 3 * (size_t)map.width * (size_t)map.height;
    for (i = 0; i < count; i++)
        if (!(map.rgb[i] >= 0.0f && map.rgb[i] <= 3.4e38f))
            abort();
    image_free(&map);
    return 0;
}
