/* render.c: a small renderer that lights scenes by an environment map through envsamp.h.
 *
 *     render --env sky --scene knot --method facing+mis --spp 64 --out knot.png
 *     render --env data/city.pfm --scene metal --method decomposed --lights 32 --reduce 2
 *     render --list
 *
 * What to copy for a renderer of one's own: environment.c, which places a map in the world, builds
 * tables and draws from them, and add_light_sample and add_escaped of integrator.c, which are next
 * event estimation with multiple importance sampling.
 */
#define _POSIX_C_SOURCE 200112L
#define ENVSAMP_IMPLEMENTATION
#include "../../envsamp.h"

#include "../common/exr.h"
#include "../common/image.h"
#include "../common/maps.h"
#include "../common/progress.h"
#include "environment.h"
#include "integrator.h"
#include "lights.h"
#include "product.h"
#include "scene.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define MADE_WIDTH 1024
#define SIDE_MAX 16384

typedef struct options {
    const char *env, *scene, *method, *out;
    int spp, lights, threads, bounces, width, height, blocks, reduce, side;
    int independent, interleave;
    double seconds, rotate, compensation, exponent, exposure, seed;
} options;

/* Each of 32 rays from a point is a sample. */
typedef struct product_method { const char *name, *what; } product_method;

static const product_method product_methods[] = {
    {"double", "halftoned light x BRDF x cosine, 32 samples at a time"},
    {"triple", "the same x visibility by spheres inside of the objects"},
    {NULL, NULL}
};

static int fail(const char *subject, const char *what)
{
    fprintf(stderr, "render: %s: %s\n", subject, what);
    return 0;
}

/* ---- command line ---- */

/* An option that takes a value: a text, a whole number or a number in a range. */
typedef struct option {
    const char *name, *value, *help;
    const char **text;
    int *whole;
    double *number, least, most;
} option;

#define OPTIONS 18

static void list_options(options *o, option list[OPTIONS])
{
    const option all[OPTIONS] = {
        {"--env", "MAP", "lat-long .exr, .hdr or .pfm, or a made-up map (studio)", &o->env, 0, 0,
         0, 0},
        {"--scene", "NAME", "(knot)", &o->scene, 0, 0, 0, 0},
        {"--method", "NAME", "of sampling (facing+mis), or of --lights (relaxed)", &o->method, 0,
         0, 0, 0},
        {"--spp", "N", "samples a pixel (32)", 0, &o->spp, 0, 1, 1 << 24},
        {"--seconds", "S", "as many samples as the time allows, instead of --spp", 0, 0,
         &o->seconds, 0.01, 1e6},
        {"--lights", "K", "the map as that many directional lights", 0, &o->lights, 0, 1, 65536},
        {"--reduce", "N", "with --lights, those that are no lamps at 1/N of the size (1)", 0,
         &o->reduce, 0, 1, 16},
        {"--side", "N", "rays through N x N fixed places of a pixel (any; with --lights 2)", 0,
         &o->side, 0, 1, 64},
        {"--bounces", "N", "1: direct light (1)", 0, &o->bounces, 0, 1, 1000},
        {"--rotate", "DEG", "turns the map about the vertical axis (0)", 0, 0, &o->rotate, -1e4,
         1e4},
        {"--compensation", "X", "MIS compensation, 0 to 1 (0)", 0, 0, &o->compensation, 0, 1},
        {"--exponent", "X", "importance exponent (the library's default)", 0, 0, &o->exponent, 0,
         10},
        {"--blocks", "N", "of kd (the library's default)", 0, &o->blocks, 0, 1, 1048576},
        {"--threads", "T", "(all cores)", 0, &o->threads, 0, 1, 256},
        {"--seed", "N", "(1)", 0, 0, &o->seed, 0, 4294967295.0},
        {"--width", "W", "of the picture (640)", 0, &o->width, 0, 1, SIDE_MAX},
        {"--height", "H", "(360)", 0, &o->height, 0, 1, SIDE_MAX},
        {"--out", "FILE", ".exr and .pfm are linear, .png is tone-mapped (render.png)", &o->out,
         0, 0, 0, 0}
    };

    memcpy(list, all, sizeof all);
}

static void print_help(const option list[OPTIONS])
{
    int i;

    printf("usage: render [options]\n\n");
    for (i = 0; i < OPTIONS; i++)
        printf("  %-14s %-5s %s\n", list[i].name, list[i].value, list[i].help);
    printf("  %-20s %s\n", "--exposure X", "factor before tone mapping (by the picture)");
    printf("  %-20s %s\n", "--independent", "independent numbers instead of Owen-Sobol points");
    printf("  %-20s %s\n", "--interleave", "with --lights, 8 sets that pixels take turns in");
    printf("  %-20s %s\n", "--list", "scenes, methods and made-up maps");
}

static void print_list(void)
{
    int i;

    printf("Scenes:\n");
    for (i = 0; scene_list[i].name; i++)
        printf("  %-14s %s\n", scene_list[i].name, scene_list[i].what);
    printf("\nMethods, for --spp and --seconds. A sample is one direction from the light and its "
           "shadow ray;\nwith +mis also one from the BSDF, its ray, and the densities of both in "
           "both. At more than\none bounce every point of a path takes a sample.\n");
    for (i = 0; light_samplers[i].name; i++)
        printf("  %-10s%s %s\n", light_samplers[i].name,
               light_samplers[i].sample ? "[+mis]" : "      ", light_samplers[i].what);
    for (i = 0; product_methods[i].name; i++)
        printf("  %-16s %s\n", product_methods[i].name, product_methods[i].what);
    printf("\nMethods, for --lights. Every light has a shadow ray from every point that is "
           "shaded.\n");
    for (i = 0; light_methods[i].name; i++)
        printf("  %-14s   %s\n", light_methods[i].name, light_methods[i].what);
    printf("\nMade-up maps:\n ");
    for (i = 0; map_names[i]; i++)
        printf(" %s", map_names[i]);
    printf("\n");
}

/* Puts a value where the option wants it. */
static int take_value(const option *o, const char *value)
{
    char text[200];
    double number;
    char *end;

    if (o->text) {
        *o->text = value;
        return *value ? 1 : fail(o->name, "the name is empty");
    }
    errno = 0;
    number = strtod(value, &end);
    if (end == value || *end || errno || !(number >= o->least && number <= o->most)
        || (!o->number && number != floor(number))) {
        snprintf(text, sizeof text, "%.60s: not a %snumber from %g to %.10g", value,
                 o->number ? "" : "whole ", o->least, o->most);
        return fail(o->name, text);
    }
    if (o->number)
        *o->number = number;
    else
        *o->whole = (int)number;
    return 1;
}

/* Returns 1 to render, 0 to fail, -1 when all is said. */
static int take_options(options *o, int argc, char **argv)
{
    const option exposure = {"--exposure", "X", "", NULL, NULL, &o->exposure, 1e-9, 1e9};
    option list[OPTIONS];
    int i, k;

    list_options(o, list);
    for (i = 1; i < argc; i++) {
        const option *found = !strcmp(argv[i], exposure.name) ? &exposure : NULL;

        for (k = 0; k < OPTIONS; k++)
            if (!strcmp(argv[i], list[k].name))
                found = &list[k];
        if (found) {
            if (i + 1 == argc)
                return fail(argv[i], "a value is missing");
            if (!take_value(found, argv[++i]))
                return 0;
        } else if (!strcmp(argv[i], "--independent")) {
            o->independent = 1;
        } else if (!strcmp(argv[i], "--interleave")) {
            o->interleave = 1;
        } else if (!strcmp(argv[i], "--list")) {
            print_list();
            return -1;
        } else if (!strcmp(argv[i], "--help")) {
            print_help(list);
            return -1;
        } else {
            return fail(argv[i], "no such option; --help shows them");
        }
    }
    return 1;
}

static options default_options(void)
{
    options o;

    memset(&o, 0, sizeof o);
    o.env = "studio";
    o.scene = "knot";
    o.out = "render.png";
    o.spp = 32;
    o.bounces = o.reduce = 1;
    o.width = 640;
    o.height = 360;
    o.seed = 1.0;
    o.threads = (int)sysconf(_SC_NPROCESSORS_ONLN);
    return o;
}

/* ---- files ---- */

static int ends_with(const char *text, const char *end)
{
    const size_t length = strlen(text), tail = strlen(end);

    return length > tail && !strcmp(text + length - tail, end);
}

/* Before an hour of rendering: whether the file can be written. */
static int check_out(const char *path)
{
    char temporary[IMAGE_PATH_MAX], error[IMAGE_PATH_MAX + 256];
    FILE *file;

    if (!ends_with(path, ".png") && !ends_with(path, ".pfm") && !ends_with(path, ".exr"))
        return fail(path, "the name has to end in .png, .pfm or .exr");
    if (!image_temporary_path(path, temporary, error, sizeof error)) {
        fprintf(stderr, "render: %s\n", error);
        return 0;
    }
    file = fopen(temporary, "wb");
    if (!file)
        return fail(path, strerror(errno));
    fclose(file);
    remove(temporary);
    return 1;
}

static int check_map(const char *name, const image *map)
{
    const size_t count = 3 * (size_t)map->width * (size_t)map->height;
    size_t i = 0;

    if (map->width != 2 * map->height)
        return fail(name, "the map is not twice as wide as high");
    while (i < count && !(map->rgb[i] > 0.0f))
        i++;
    return i < count ? 1 : fail(name, "the map is black");
}

/* A name of maps.h, or a file. */
static int read_map(const char *name, image *map)
{
    char error[IMAGE_PATH_MAX + 256];
    int i;

    for (i = 0; map_names[i]; i++)
        if (!strcmp(name, map_names[i]))
            return map_make(name, MADE_WIDTH, MADE_WIDTH / 2, map)
                || fail(name, "not enough memory for the map");
    if (!image_read(name, map, error, sizeof error)) {
        fprintf(stderr, "render: %s\n", error);
        return 0;
    }
    image_clean(map);
    if (check_map(name, map))
        return 1;
    image_free(map);
    return 0;
}

static int compare_floats(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;

    return (x > y) - (x < y);
}

/* Brings the middle eight tenths of luminances to a middle grey, or to less where a tenth of the
   picture would then be white; 0 if memory is short. */
static float find_exposure(const image *picture)
{
    const size_t pixels = (size_t)picture->width * (size_t)picture->height;
    float *luminance = malloc(pixels * sizeof *luminance);
    double sum = 0.0, bright;
    size_t i;

    if (!luminance)
        return 0.0f;
    for (i = 0; i < pixels; i++)
        luminance[i] = envsamp_luminance(picture->rgb + 3 * i);
    qsort(luminance, pixels, sizeof *luminance, compare_floats);
    for (i = pixels / 10; i < pixels - pixels / 10; i++)
        sum += (double)luminance[i];
    bright = (double)luminance[pixels - 1 - pixels / 10];
    free(luminance);
    return sum > 0.0 ? (float)fmin(0.33 * 0.8 * (double)pixels / sum, 0.9 / bright) : 1.0f;
}

static int write_png(const char *path, const image *picture, float exposure, char *error,
                     size_t error_size)
{
    unsigned char *rgb = malloc(3 * (size_t)picture->width * (size_t)picture->height);
    int ok;

    if (!(exposure > 0.0f))
        exposure = find_exposure(picture);
    if (!rgb || !(exposure > 0.0f)) {
        free(rgb);
        return image_fail(error, error_size, path, "not enough memory");
    }
    image_tonemap(picture, exposure, rgb);
    ok = image_write_png(path, picture->width, picture->height, rgb, error, error_size);
    free(rgb);
    return ok;
}

static int write_picture(const options *o, const image *picture)
{
    char error[IMAGE_PATH_MAX + 256];
    int ok;

    if (ends_with(o->out, ".png"))
        ok = write_png(o->out, picture, (float)o->exposure, error, sizeof error);
    else if (ends_with(o->out, ".pfm"))
        ok = image_write_pfm(o->out, picture, error, sizeof error);
    else
        ok = exr_write(o->out, picture, error, sizeof error);
    if (!ok)
        fprintf(stderr, "render: %s\n", error);
    return ok;
}

/* ---- progress ---- */

typedef struct clockwork {
    progress bar;
    tile_progress tiles;             /* what moves it */
    double start;                    /* seconds */
    double limit;                    /* of --seconds; 0: none */
} clockwork;

static double seconds_now(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void report(double share, void *user)
{
    clockwork *c = user;

    progress_show(&c->bar, c->limit > 0.0 ? fmin((seconds_now() - c->start) / c->limit, 1.0)
                                          : share, NULL);
}

static void start_clock(clockwork *c)
{
    c->start = seconds_now();
    c->bar = progress_start("render");
    c->tiles.report = report;
    c->tiles.user = c;
}

/* ---- pictures ---- */

static void add_samples(void *job, film *f, uint32_t count)
{
    render_samples(job, f, count);
}

static void add_products(void *job, film *f, uint32_t count)
{
    product_samples(job, f, count);
}

/* Passes of 1, 1, 2, 4, .. samples, as long as another one fits into the time that is left. */
static void render_seconds(void (*add)(void *job, film *f, uint32_t count), void *job, film *f,
                           double seconds)
{
    const double start = seconds_now();
    double spent = 0.0;
    uint32_t count = 1;

    do {
        add(job, f, count);
        spent = seconds_now() - start;
        count = (uint32_t)fmin(f->samples, (seconds - spent) / (spent / f->samples));
    } while (count > 0 && spent < seconds);
}

/* `rays`: samples that each of the film's is made of. */
static int render_film(const options *o, const char *name,
                       void (*add)(void *job, film *f, uint32_t count), void *job, int rays,
                       clockwork *c, image *picture)
{
    film f;

    if (!film_make(&f, o->width, o->height))
        return fail(o->out, "not enough memory for the picture");
    start_clock(c);
    if (o->seconds > 0.0)
        render_seconds(add, job, &f, o->seconds);
    else
        add(job, &f, (uint32_t)((o->spp + rays - 1) / rays));
    progress_end(&c->bar);
    film_image(&f, picture);
    printf("%s, %s, %s: %u samples a pixel, %.2f s\n", o->env, o->scene, name,
           (unsigned)f.samples * (unsigned)rays, seconds_now() - c->start);
    film_free(&f);
    return 1;
}

static int render_paths(const options *o, const scene *s, const environment *e, clockwork *c,
                        image *picture)
{
    const sampler_options table = {(float)o->compensation, (float)o->exponent, o->blocks};
    const char *name = o->method ? o->method : "facing+mis";
    char error[512];
    render_job job;
    method by;
    int ok;

    if (!method_open(&by, name, e, &table, error, sizeof error))
        return fail("--method", error);
    memset(&job, 0, sizeof job);
    job.scene = s;
    job.environment = e;
    job.method = &by;
    job.bounces = o->bounces;
    job.side = o->side;
    job.independent = o->independent;
    job.seed = (uint32_t)o->seed;
    job.threads = o->threads;
    job.progress = &c->tiles;
    ok = render_film(o, name, add_samples, &job, 1, c, picture);
    method_close(&by);
    return ok;
}

static int render_products(const options *o, const scene *s, const environment *e, clockwork *c,
                           image *picture)
{
    product *light = product_make(e);
    product_job job;
    int ok;

    if (!light)
        return fail(o->env, "not enough memory for product sampling");
    memset(&job, 0, sizeof job);
    job.scene = s;
    job.environment = e;
    job.product = light;
    job.triple = !strcmp(o->method, "triple");
    job.side = o->side;
    job.rays = PRODUCT_RAYS;
    job.seed = (uint32_t)o->seed;
    job.threads = o->threads;
    job.progress = &c->tiles;
    ok = render_film(o, o->method, add_products, &job, job.rays, c, picture);
    product_free(light);
    return ok;
}

static int render_lights(const options *o, const scene *s, const environment *e, clockwork *c,
                         image *picture)
{
    const char *name = o->method ? o->method : "relaxed";
    char error[512];
    light_list list;
    lights_job job;
    int ok;

    if (!lights_make(&list, name, o->lights, (uint32_t)o->seed, e, error, sizeof error))
        return fail("--method", error);
    if (strcmp(name, "decomposed"))
        lights_mark(&list, LIGHTS_LAMP);
    memset(&job, 0, sizeof job);
    job.scene = s;
    job.environment = e;
    job.list = &list;
    job.sets = o->interleave ? LIGHTS_SETS : 1;
    job.side = o->side ? o->side : 2;
    job.reduce = o->reduce;
    job.seed = (uint32_t)o->seed;
    job.threads = o->threads;
    job.progress = &c->tiles;
    start_clock(c);
    ok = lights_render(&job, picture);
    progress_end(&c->bar);
    lights_free(&list);
    if (!ok)
        return fail(o->out, "not enough memory for the picture");
    printf("%s, %s, %s: %d lights, %.2f s\n", o->env, o->scene, name, o->lights,
           seconds_now() - c->start);
    return 1;
}

static int is_product(const char *name)
{
    int i = 0;

    while (name && product_methods[i].name && strcmp(product_methods[i].name, name))
        i++;
    return name && product_methods[i].name;
}

static int render(const options *o)
{
    image map = {0, 0, NULL}, picture = {0, 0, NULL};
    clockwork c;
    char error[256];
    environment e;
    scene *s;
    int ok;

    start_clock(&c);
    c.limit = o->seconds;
    if (o->bounces > 1 && (o->lights || is_product(o->method)))
        return fail("--bounces", "lights and products are of direct light only");
    if (o->seconds > 0.0 && o->lights)
        return fail("--seconds", "not with --lights");
    if (!check_out(o->out) || !read_map(o->env, &map))
        return 0;
    environment_make(&e, &map, (float)o->rotate);
    s = scene_open(o->scene, error, sizeof error);
    if (!s)
        fail("--scene", error);
    ok = s && (image_alloc(&picture, o->width, o->height)
               || fail(o->out, "not enough memory for the picture"));
    ok = ok && (o->lights ? render_lights(o, s, &e, &c, &picture)
                : is_product(o->method) ? render_products(o, s, &e, &c, &picture)
                : render_paths(o, s, &e, &c, &picture));
    ok = ok && write_picture(o, &picture);
    scene_close(s);
    image_free(&picture);
    image_free(&map);
    return ok;
}

int main(int argc, char **argv)
{
    options o = default_options();
    const int taken = take_options(&o, argc, argv);

    return taken < 0 || (taken > 0 && render(&o)) ? EXIT_SUCCESS : EXIT_FAILURE;
}
