/* strip.c: a scene in five panels at equal time: inversion, WARP, light x cosine, lights and the
 * reference. It is the first picture of the README.
 *
 *     strip [-t THREADS] [-o FILE.png] [MAP [SCENE]]
 *
 * MAP is a file; data/city.pfm, or, where it is missing, the made-up studio. Samples are with MIS,
 * ours with compensation. Every panel takes the processor time of four samples a pixel by
 * inversion, within a sample; of lights, as many as a doubling finds. The number is FLIP: how
 * visible the difference from the reference is, 0 to 1.
 */
#include "stage.h"

#include "../examples/common/errors.h"
#include "../examples/common/maps.h"
#include "../examples/common/picture.h"
#include "../examples/render/lights.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define WIDTH 300
#define HEIGHT 225
#define GAP 6
#define LABEL 30
#define TITLE 30
#define SAMPLES 4
#define TURNS 3                     /* the least of so many times counts */
#define TRUTH 512
#define SEED 3

enum { INVERSION, WARP, FACING, LIGHTS, REFERENCE, PANELS };

static const char *const names[PANELS] = {"INVERSION", "WARP", "LIGHT X COSINE", "LIGHTS",
                                          "REFERENCE"};
static const char *const methods[LIGHTS] = {"inversion+mis", "kd-warp+mis", "facing+mis"};

static void fail(const char *what)
{
    fprintf(stderr, "strip: %s\n", what);
    exit(1);
}

static method open_method(const stage *s, const char *name, float compensation)
{
    const sampler_options options = {compensation, 0.0f, 0};
    char error[256];
    method by;

    if (!method_open(&by, name, &s->environment, &options, error, sizeof error))
        fail(error);
    return by;
}

/* As many samples as fit into `budget` seconds, or SAMPLES where that is 0. Returns how many. */
static uint32_t shade_samples(const stage *s, int which, double *budget, image *out)
{
    method by = open_method(s, methods[which], which == INVERSION ? 0.0f : 1.0f);
    double once = HUGE_VAL;
    uint32_t count = SAMPLES;
    int turn;

    for (turn = 0; turn < TURNS; turn++)
        once = fmin(once, stage_render(s, &by, SAMPLES, 0, SEED, out) / SAMPLES);
    if (*budget > 0.0)
        count = (uint32_t)(*budget / once + 0.5) > 1 ? (uint32_t)(*budget / once + 0.5) : 1;
    else
        *budget = SAMPLES * once;
    stage_render(s, &by, count, 0, SEED, out);
    method_close(&by);
    return count;
}

static double shade_lights(const stage *s, int count, image *out)
{
    const clock_t start = clock();
    char error[256];
    light_list list;
    lights_job job;

    if (!lights_make(&list, "relaxed", count, SEED, &s->environment, error, sizeof error))
        fail(error);
    memset(&job, 0, sizeof job);
    job.scene = s->scene;
    job.environment = &s->environment;
    job.list = &list;
    job.sets = LIGHTS_SETS;
    job.side = 1;
    job.threads = s->config->threads;
    if (!lights_render(&job, out))
        fail("out of memory");
    lights_free(&list);
    return (double)(clock() - start) / CLOCKS_PER_SEC;
}

static void draw_panel(picture *canvas, int which, const stage *s, const image *shown,
                       unsigned count)
{
    static const unsigned char white[3] = {255, 255, 255}, grey[3] = {170, 170, 170};
    const int left = which * (WIDTH + GAP), top = TITLE + LABEL, below = top + HEIGHT + 8;
    char text[32];

    picture_map(canvas, left, top, WIDTH, HEIGHT, shown, s->exposure);
    picture_text(canvas, left + 8, TITLE + 8, 2, white, names[which]);
    if (which == REFERENCE)
        return;
    snprintf(text, sizeof text, "%u %s", count, which == LIGHTS ? "LIGHTS" : "SAMPLES");
    picture_text(canvas, left + 8, below, 2, grey, text);
    snprintf(text, sizeof text, "FLIP %.3f",
             error_flip(shown, &s->mean, s->exposure, ERROR_FLIP_PPD, NULL));
    picture_text(canvas, left + WIDTH - 8 - 12 * (int)strlen(text), below, 2, white, text);
}

static void draw_strip(const stage *s, const char *path)
{
    static const unsigned char ground[3] = {30, 32, 36}, white[3] = {255, 255, 255};
    double budget = 0.0;
    char error[256];
    picture canvas;
    image shown;
    int which;

    if (!picture_alloc(&canvas, PANELS * (WIDTH + GAP) - GAP, TITLE + HEIGHT + 2 * LABEL)
        || !image_alloc(&shown, WIDTH, HEIGHT))
        fail("out of memory");
    picture_fill(&canvas, 0, 0, canvas.width, canvas.height, ground);
    picture_text(&canvas, 8, 10, 2, white, "Equal time. Samples with MIS, those of envsamp.h "
                 "with compensation. FLIP: visible difference, 0 to 1");
    for (which = 0; which < LIGHTS; which++)
        draw_panel(&canvas, which, s, &shown, shade_samples(s, which, &budget, &shown));
    for (which = 16; shade_lights(s, which, &shown) < budget && which < 1024; which *= 2)
        ;
    draw_panel(&canvas, LIGHTS, s, &shown, (unsigned)which);
    draw_panel(&canvas, REFERENCE, s, &s->mean, 0);
    if (!picture_write(&canvas, path, error, sizeof error))
        fail(error);
    printf("%s\n", path);
    picture_free(&canvas);
    image_free(&shown);
}

int main(int argc, char **argv)
{
    stage_config config = {"build/references", WIDTH, HEIGHT, 1, TRUTH};
    const char *out = "build/pictures/strip.png", *file = "data/city.pfm", *scene_name = "knot";
    char error[256];
    image map;
    stage s;
    int i = 1;

    for (; i + 1 < argc && argv[i][0] == '-'; i += 2)
        if (!strcmp(argv[i], "-t"))
            config.threads = atoi(argv[i + 1]);
        else
            out = argv[i + 1];
    file = i < argc ? argv[i] : file;
    scene_name = i + 1 < argc ? argv[i + 1] : scene_name;
    if (!image_read(file, &map, error, sizeof error)
        && (i < argc || !map_make("studio", 512, 256, &map)))
        fail(error);
    if (!stage_open(&s, &config, "strip", &map, scene_name, 1, error, sizeof error))
        fail(error);
    draw_strip(&s, out);
    stage_close(&s);
    image_free(&map);
    return 0;
}
