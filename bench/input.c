/* input.c: see input.h. */
#include "input.h"

#include "../examples/common/maps.h"
#include "../examples/common/random.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BLOCK_COUNT_MAX 1048576
#define WIDTH_MAX       65534

void input_fail(const char *subject, const char *what)
{
    fflush(stdout);
    fprintf(stderr, "bench: %s: %s\n", subject, what);
    exit(1);
}

/* ---- the command line ---- */

static void print_help(void)
{
    printf("usage: bench [--block-count N] [--width N] [MAP]\n"
           "\n"
           "Times the samplers of envsamp.h beside other samplers.\n"
           "\n"
           "  MAP              a lat-long map in an HDR or PFM file, or a made-up one: sky,\n"
           "                   studio, constant, night or foliage (sky)\n"
           "  --block-count N  blocks of the kd-tree, 1 to %d (6144)\n"
           "  --width N        width that the map is made or enlarged to, 2 to %d (2048)\n"
           "  --help           this text\n",
           BLOCK_COUNT_MAX, WIDTH_MAX);
}

static int parse_int(const char *name, const char *text, int lowest, int highest)
{
    char *end = NULL;
    long value;

    errno = 0;
    value = text ? strtol(text, &end, 10) : 0;
    if (!text || end == text || *end || errno || value < lowest || value > highest) {
        fprintf(stderr, "bench: %s needs a whole number from %d to %d\n", name, lowest, highest);
        exit(1);
    }
    return (int)value;
}

static bench_options parse_options(int argc, char **argv)
{
    bench_options out = { "sky", 2048, 6144 };
    int i, maps = 0;

    for (i = 1; i < argc; i++)
        if (strcmp(argv[i], "--help") == 0) {
            print_help();
            exit(0);
        } else if (strcmp(argv[i], "--block-count") == 0) {
            i++;
            out.block_count = parse_int("--block-count", argv[i], 1, BLOCK_COUNT_MAX);
        } else if (strcmp(argv[i], "--width") == 0) {
            i++;
            out.width = parse_int("--width", argv[i], 2, WIDTH_MAX);
        } else if (argv[i][0] == '-') {
            input_fail(argv[i], "no such option; see --help");
        } else if (maps++) {
            input_fail(argv[i], "a second map; one is enough");
        } else {
            out.map_path = argv[i];
        }
    return out;
}

/* ---- the map ---- */

int input_enlarge(image *map, int width)
{
    pcg32 random = pcg32_make(2, 2);
    image large;
    int x, y, c;

    if (width <= map->width)
        return 1;
    if (!image_alloc(&large, width, width / 2))
        return 0;
    for (y = 0; y < large.height; y++)
        for (x = 0; x < large.width; x++) {
            size_t from = (size_t)((int64_t)y * map->height / large.height) * (size_t)map->width
                        + (size_t)((int64_t)x * map->width / large.width);
            size_t to = (size_t)y * (size_t)large.width + (size_t)x;
            float noise = 0.975f + 0.05f * pcg32_float(&random);

            for (c = 0; c < 3; c++)
                large.rgb[3 * to + (size_t)c] = noise * map->rgb[3 * from + (size_t)c];
        }
    image_free(map);
    *map = large;
    return 1;
}

static int is_made_up(const char *name)
{
    int i = 0;

    while (map_names[i] && strcmp(map_names[i], name) != 0)
        i++;
    return map_names[i] != NULL;
}

static void make_map(bench_input *input)
{
    const bench_options *options = &input->options;
    char error[512];

    if (is_made_up(options->map_path)) {
        if (!map_make(options->map_path, options->width, options->width / 2, &input->map))
            input_fail(options->map_path, "the map could not be made");
    } else {
        if (!image_read(options->map_path, &input->map, error, sizeof error)) {
            fprintf(stderr, "bench: %s\n", error);
            exit(1);
        }
        if (input->map.width != 2 * input->map.height)
            input_fail(options->map_path, "not twice as wide as high");
        if (!input_enlarge(&input->map, options->width))
            input_fail(options->map_path, "out of memory");
    }
}

/* ---- numbers ---- */

static void fill_numbers(bench_input *input)
{
    pcg32 random = pcg32_make(1, 1);
    size_t i;

    for (i = 0; i < 2 * (size_t)NUMBER_COUNT; i++)
        input->numbers[i] = pcg32_float(&random);
}

static void fill_directions(bench_input *input)
{
    size_t i;

    for (i = 0; i < SLICE_COUNT; i++) {
        float z = 1.0f - 2.0f * input->numbers[2 * i], radius = sqrtf(1.0f - z * z);
        float phi = 6.2831853f * input->numbers[2 * i + 1];

        input->directions[3 * i + 0] = radius * cosf(phi);
        input->directions[3 * i + 1] = radius * sinf(phi);
        input->directions[3 * i + 2] = z;
    }
}

void input_create(int argc, char **argv, bench_input *input)
{
    memset(input, 0, sizeof *input);
    input->options = parse_options(argc, argv);
    make_map(input);
    input->numbers = malloc(2 * (size_t)NUMBER_COUNT * sizeof(float));
    input->directions = malloc(3 * (size_t)SLICE_COUNT * sizeof(float));
    if (!input->numbers || !input->directions)
        input_fail("set-up", "out of memory");
    fill_numbers(input);
    fill_directions(input);
}

void input_destroy(bench_input *input)
{
    free(input->numbers);
    free(input->directions);
    image_free(&input->map);
    memset(input, 0, sizeof *input);
}
