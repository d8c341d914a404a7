/* ward.c: a sphere of Ward (0.5, 0.001) by filtered importance sampling, beside samples of the BSDF,
 * MIS and the reference: figure 7 of [Ergun et al. 2012], a row a map.
 *
 *     ward [-t THREADS] [-o FILE.png] [MAP...]
 *
 * MAP is a file; two at most. Without: data/forest.pfm, under which filtering pays, and
 * data/dawn.pfm, whose small sun it blurs; where these are missing, the made-up studio. All take
 * SAMPLES a pixel, with MIS as many of both kinds. The number is FLIP, 0 to 1. The table of all maps
 * is one of make tables.
 */
#include "stage.h"

#include "../examples/common/errors.h"
#include "../examples/common/maps.h"
#include "../examples/common/picture.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WIDTH 200
#define HEIGHT 200
#define GAP 6
#define LABEL 26
#define SAMPLES 16
#define TRUTH 256
#define SEED 3
#define MAPS_MAX 2

enum { FILTERED, BSDF, FIT_MIS, FACING_MIS, REFERENCE, PANELS };

static const char *const names[PANELS] = {"FILTERED", "BSDF", "FIT, MIS", "LIGHT X COSINE",
                                          "REFERENCE"};
static const char *const methods[REFERENCE] = {NULL, "bsdf", "kd-fit+mis", "facing+mis"};

static void fail(const char *what)
{
    fprintf(stderr, "ward: %s\n", what);
    exit(1);
}

static void shade_method(const stage *s, int which, image *out)
{
    const sampler_options options = {which == FACING_MIS ? 1.0f : 0.0f, 0.0f, 0};
    char error[256];
    method by;

    if (!method_open(&by, methods[which], &s->environment, &options, error, sizeof error))
        fail(error);
    stage_render(s, &by, SAMPLES, 0, SEED, out);
    method_close(&by);
}

static void shade_filtered_samples(const stage *s, image *out)
{
    filtered levels;

    if (!filtered_make(s->environment.map, &levels))
        fail("out of memory");
    stage_render_filtered(s, &levels, FILTERED_BIAS, SAMPLES, SEED, out);
    filtered_free(&levels);
}

static void draw_row(picture *canvas, int top, const stage *s)
{
    static const unsigned char white[3] = {255, 255, 255};
    image shown;
    char text[32];
    int which;

    if (!image_alloc(&shown, WIDTH, HEIGHT))
        fail("out of memory");
    for (which = 0; which < PANELS; which++) {
        const int left = which * (WIDTH + GAP);

        if (which == FILTERED)
            shade_filtered_samples(s, &shown);
        else if (which < REFERENCE)
            shade_method(s, which, &shown);
        picture_map(canvas, left, top, WIDTH, HEIGHT, which == REFERENCE ? &s->mean : &shown,
                    s->exposure);
        snprintf(text, sizeof text, "FLIP %.3f",
                 error_flip(&shown, &s->mean, s->exposure, ERROR_FLIP_PPD, NULL));
        if (which < REFERENCE)
            picture_text(canvas, left + 8, top + HEIGHT + 6, 2, white, text);
    }
    image_free(&shown);
}

static void draw_map(picture *canvas, int top, const stage_config *config, const char *file,
                     int made_up)
{
    char name[64], error[256];
    image map;
    stage s;

    if (!image_read(file, &map, error, sizeof error)
        && (!made_up || !map_make("studio", 512, 256, &map)))
        fail(error);
    snprintf(name, sizeof name, "ward%d", top);
    if (!stage_open(&s, config, name, &map, STAGE_WARD, 1, error, sizeof error))
        fail(error);
    draw_row(canvas, top, &s);
    stage_close(&s);
    image_free(&map);
}

int main(int argc, char **argv)
{
    static const unsigned char ground[3] = {30, 32, 36}, white[3] = {255, 255, 255};
    const char *files[MAPS_MAX] = {"data/forest.pfm", "data/dawn.pfm"};
    const char *out = "build/pictures/ward.png";
    stage_config config = {"build/references", WIDTH, HEIGHT, 1, TRUTH};
    char title[96], error[256];
    picture canvas;
    int i = 1, k, count;

    for (; i + 1 < argc && argv[i][0] == '-'; i += 2)
        if (!strcmp(argv[i], "-t"))
            config.threads = atoi(argv[i + 1]);
        else
            out = argv[i + 1];
    count = argc - i < 1 || argc - i > MAPS_MAX ? MAPS_MAX : argc - i;
    if (!picture_alloc(&canvas, PANELS * (WIDTH + GAP) - GAP,
                       2 * LABEL + count * (HEIGHT + LABEL)))
        fail("out of memory");
    picture_fill(&canvas, 0, 0, canvas.width, canvas.height, ground);
    snprintf(title, sizeof title, "Ward (0.5, 0.001), %d samples a pixel. FLIP: visible "
             "difference, 0 to 1", SAMPLES);
    picture_text(&canvas, 8, 8, 2, white, title);
    for (k = 0; k < PANELS; k++)
        picture_text(&canvas, k * (WIDTH + GAP) + 8, LABEL + 6, 2, white, names[k]);
    for (k = 0; k < count; k++)
        draw_map(&canvas, 2 * LABEL + k * (HEIGHT + LABEL), &config,
                 i < argc ? argv[i + k] : files[k], i >= argc);
    if (!picture_write(&canvas, out, error, sizeof error))
        fail(error);
    printf("%s\n", out);
    picture_free(&canvas);
    return 0;
}
