/* input.h: what the timing programs take from the command line, and the numbers, directions and
 * map that they work on.
 */
#ifndef INPUT_H
#define INPUT_H

#include "../examples/common/image.h"

#define NUMBER_COUNT (1u << 20)     /* pairs of random numbers made beforehand: 8 MB */
#define SLICE_COUNT  (1u << 18)     /* samples, or pdfs, a round */

typedef struct bench_options {
    const char *map_path;           /* a file, or the name of a made-up map */
    int width, block_count;
} bench_options;

typedef struct bench_input {
    bench_options options;
    image map;
    float *numbers;                 /* NUMBER_COUNT pairs */
    float *directions;              /* SLICE_COUNT unit vectors, uniform on the sphere */
} bench_input;

/* Prints what is wrong with what, and exits. */
void input_fail(const char *subject, const char *what);

/* Reads the options and makes all of it; exits where that fails, and after --help. */
void input_create(int argc, char **argv, bench_input *input);
void input_destroy(bench_input *input);

/* Enlarges a map to the width asked for, if it is narrower. Its texels vary by 5 %, as no real map
   is flat over a square of texels. Returns 0 if there is no memory. */
int input_enlarge(image *map, int width);

#endif
