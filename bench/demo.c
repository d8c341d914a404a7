/* demo.c: samples a map, prints what each sampler costs and how far it is off, and draws pictures.
 *
 *     demo [-o FOLDER] [MAP]
 *
 * The map is a file or made up, so that the demo needs a C compiler and nothing else. Every figure
 * is measured while it runs. samplers.c has the tables of all methods.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "baseline_sampler.h"
#include "../examples/common/folder.h"
#include "../examples/common/image.h"
#include "../examples/common/irradiance.h"
#include "../examples/common/map_pictures.h"
#include "../examples/common/maps.h"
#include "../examples/common/mis_scene.h"
#include "../examples/common/random.h"
#include "../examples/common/spheres.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define MAP_WIDTH 1024
#define MAP_HEIGHT 512

#define SAMPLES (1 << 18)            /* timed, of each sampler */
#define SCRAMBLINGS 32               /* sets of points behind an error */

typedef struct demo {
    const char *folder;              /* for pictures */
    char name[256];                  /* of the map: the start of its pictures' names */
    const char *subject;             /* what an error is about: the path of the map, or its name */
    image map;
    envsamp_image view;              /* of `map`, for the library */
    char error[IMAGE_PATH_MAX + 256];
} demo;

static int fail(demo *d, const char *reason)
{
    return image_fail(d->error, sizeof d->error, d->subject, "%s", reason);
}

/* ---- a table of the library ---- */

typedef struct table {
    envsamp_buffer memory;
    const envsamp_kd *kd;
    envsamp_kd_info info;
    double build_ms;
} table;

static double clock_ms(void)
{
    return 1000.0 * (double)clock() / (double)CLOCKS_PER_SEC;
}

static void table_free(table *t)
{
    free(t->memory.data);
    t->memory.data = NULL;
}

/* Makes a table, to be freed with table_free. Returns 0, with the reason in d->error. */
static int table_make(table *t, demo *d, const envsamp_kd_desc *desc)
{
    envsamp_sizes sizes;
    envsamp_buffer scratch;
    envsamp_result result = envsamp_kd_sizes(&d->view, desc, &sizes);
    double start;

    t->kd = NULL;
    t->memory.data = malloc(t->memory.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    start = clock_ms();
    if (result == ENVSAMP_OK && t->memory.data && scratch.data)
        result = envsamp_kd_build(&d->view, desc, t->memory, scratch, &t->kd);
    t->build_ms = clock_ms() - start;
    free(scratch.data);
    if (t->kd) {
        envsamp_kd_get_info(t->kd, &t->info);
        return 1;
    }
    table_free(t);
    return fail(d, result == ENVSAMP_OK ? "not enough memory" : envsamp_result_string(result));
}

/* ---- what a sampler costs ---- */

enum { WARP, ALIAS, FIT, KD_TABLES };

typedef struct tables {
    table kd[KD_TABLES];
    baseline_cdf cdf;
    double cdf_ms;
} tables;

static const char *const kd_names[KD_TABLES] = {"WARP, the default", "ALIAS", "FIT"};

/* 0, with the reason in d->error, and what is made to be freed, where something fails. */
static int tables_make(tables *t, demo *d)
{
    double start;
    int i;

    memset(t, 0, sizeof *t);
    for (i = 0; i < KD_TABLES; i++) {
        envsamp_kd_desc desc = envsamp_kd_defaults();

        desc.nearest = 1;          /* as the CDF: radiance constant over a texel */
        desc.select = i == WARP ? ENVSAMP_KD_WARP : i == ALIAS ? ENVSAMP_KD_ALIAS : ENVSAMP_KD_FIT;
        desc.objective = ENVSAMP_KD_CHI2;
        if (!table_make(&t->kd[i], d, &desc))
            return 0;
    }
    start = clock_ms();
    if (!baseline_cdf_create(d->map.rgb, d->map.width, d->map.height, &t->cdf))
        return fail(d, "not enough memory for the full CDF");
    t->cdf_ms = clock_ms() - start;
    return 1;
}

static void tables_free(tables *t)
{
    int i;

    for (i = 0; i < KD_TABLES; i++)
        table_free(&t->kd[i]);
    baseline_cdf_destroy(&t->cdf);
}

static volatile float sink;          /* keeps the timed loop from being left out */

static double sample_ns(const sampler *by)
{
    pcg32 random = pcg32_make(1, 0);
    double start = clock_ms();
    float sum = 0.0f;
    int i;

    for (i = 0; i < SAMPLES; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample s = by->draw(by->table, u0, u1);

        sum += s.dir[0] + s.dir[1] + s.dir[2] + s.pdf;
    }
    sink = sum;
    return (clock_ms() - start) * 1e6 / SAMPLES;
}

static void print_row(const demo *d, const irradiance *exact, const sampler *by, double kib,
                      double build_ms, double excess)
{
    static const uint32_t points[] = {16, 64, 256};
    int i;

    printf("%-24s %9.1f %8.1f %8.1f %9.5f", by->name, kib, build_ms, sample_ns(by), excess);
    for (i = 0; i < 3; i++)
        printf(" %9.5f", irradiance_rmse(exact, &d->view, by, points[i], SCRAMBLINGS));
    printf("\n");
}

static void print_heading(const demo *d)
{
    printf("\n%s, %d x %d texels\n\n", d->name, d->map.width, d->map.height);
    printf("%-24s %9s %8s %8s %9s %29s\n", "", "table", "build", "sample", "excess",
           "RMSE of irradiance, Sobol");
    printf("%-24s %9s %8s %8s %9s %9s %9s %9s\n", "method", "KiB", "ms", "ns", "variance",
           "16", "64", "256");
}

static int print_methods(demo *d, const tables *t)
{
    static irradiance exact;
    const double texels = (double)d->map.width * (double)d->map.height;
    sampler by;
    int i;

    if (!irradiance_make(&exact, &d->map))
        return fail(d, "not enough memory for the irradiance");
    print_heading(d);
    for (i = 0; i < KD_TABLES; i++) {
        by = sampler_of_kd(kd_names[i], t->kd[i].kd);
        print_row(d, &exact, &by, (double)envsamp_kd_bytes(t->kd[i].kd) / 1024.0,
                  t->kd[i].build_ms, t->kd[i].info.excess_variance);
    }
    by = sampler_of_cdf("full CDF, binary search", &t->cdf);
    print_row(d, &exact, &by, 4.0 * texels / 1024.0, t->cdf_ms, 0.0);
    if (t->kd[WARP].info.block_count == 1)
        printf("\nThe map is flat, and a table of one block is exact: kd tables are as small as "
               "they can\nbe, and all rows draw every direction alike. What is left of the errors "
               "is the cosine's.\n");
    printf("\n");
    return 1;
}

static void print_legend(void)
{
    printf("\nsample: a direction and its pdf, and two random numbers. excess variance: of radiance"
           " over\npdf, relative to the squared integral; the full CDF has none. RMSE: relative, "
           "over %d\nnormals and %d sets of points; in pictures relative to the mean of the "
           "reference.\nThe CDF's KiB are 4 bytes a texel.\n", IRRADIANCE_NORMALS, SCRAMBLINGS);
}

/* ---- pictures, and errors of what they show ---- */

enum { BY_UNIFORM, BY_FIT, BY_ALIAS, BY_WARP };      /* samplers of spheres, the best last */

/* Saves and frees a picture; `made` is 0 where there was no memory for it. */
static int save(demo *d, picture *canvas, int made, const char *what)
{
    char path[IMAGE_PATH_MAX];
    int length = snprintf(path, sizeof path, "%s/%s_%s.png", d->folder, d->name, what), ok;

    if (!made)
        return fail(d, "not enough memory for a picture");
    if (length < 0 || (size_t)length >= sizeof path)
        ok = image_fail(d->error, sizeof d->error, d->folder, "the path is too long");
    else
        ok = picture_write(canvas, path, d->error, sizeof d->error);
    picture_free(canvas);
    if (ok)
        printf("%s\n", path);
    return ok;
}

static int map_pictures(demo *d, const tables *t)
{
    const float exposure = map_exposure(&d->map, t->kd[WARP].info.integral);
    sampler by[2];
    picture canvas;
    int made;

    by[0] = sampler_of_kd("WARP", t->kd[WARP].kd);
    by[1] = sampler_of_kd("ALIAS", t->kd[ALIAS].kd);
    made = blocks_picture(&canvas, d->name, &d->map, exposure, t->kd[WARP].kd);
    if (!save(d, &canvas, made, "blocks"))
        return 0;
    made = points_picture(&canvas, &d->map, &d->view, exposure, t->kd[WARP].kd, by, 2);
    return save(d, &canvas, made, "samples");
}

static int sphere_picture(demo *d, const tables *t)
{
    spheres *s = calloc(1, sizeof *s);
    picture canvas;
    int made, ok;

    if (!s)
        return fail(d, "not enough memory for a picture");
    s->map = &d->map;
    s->view = &d->view;
    s->by[BY_UNIFORM] = sampler_uniform("UNIFORM");
    s->by[BY_FIT] = sampler_of_kd("FIT", t->kd[FIT].kd);
    s->by[BY_ALIAS] = sampler_of_kd("ALIAS", t->kd[ALIAS].kd);
    s->by[BY_WARP] = sampler_of_kd("WARP", t->kd[WARP].kd);
    spheres_shade(s);
    made = spheres_draw(s, &canvas);
    ok = save(d, &canvas, made, "sphere");
    free(s);
    return ok;
}

/* ---- multiple importance sampling ---- */

/* The tables of this scene are made for bilinear lookups. */
static int mis_picture(demo *d)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    mis_scene *s = calloc(1, sizeof *s);
    table plain, compensated;
    picture canvas = {0, 0, NULL};
    int made, ok = 0;

    plain.memory.data = compensated.memory.data = NULL;
    if (!s)
        return fail(d, "not enough memory for a picture");
    if (table_make(&plain, d, &desc)) {
        desc.mis_compensation = 1.0f;
        if (table_make(&compensated, d, &desc)) {
            s->view = &d->view;
            s->plain = mis_light_of_kd(plain.kd);
            s->compensated = mis_light_of_kd(compensated.kd);
            mis_scene_shade(s, 1);
            made = mis_scene_draw(s, &canvas);
            ok = save(d, &canvas, made, "mis");
        }
    }
    table_free(&plain);
    table_free(&compensated);
    free(s);
    return ok;
}

/* ---- one map ---- */

/* Sets to zero what cannot be radiance, as the library does, so that the full CDF can be built
   too: a pixel with a NaN or an infinity, and a negative channel. Returns how many pixels. */
static size_t clean(image *map)
{
    const size_t count = (size_t)map->width * (size_t)map->height;
    size_t pixel, bad = 0;
    int i;

    for (pixel = 0; pixel < count; pixel++) {
        float *rgb = map->rgb + 3 * pixel;
        int finite = 1, negative = 0;

        for (i = 0; i < 3; i++) {
            finite = finite && rgb[i] - rgb[i] == 0.0f;
            negative = negative || rgb[i] < 0.0f;
        }
        for (i = 0; i < 3; i++)
            if (!finite || rgb[i] < 0.0f)
                rgb[i] = 0.0f;
        bad += (size_t)(!finite || negative);
    }
    return bad;
}

static int do_map(demo *d)
{
    const size_t bad = clean(&d->map);
    tables t;
    int ok;

    if (d->map.width != 2 * d->map.height)
        return image_fail(d->error, sizeof d->error, d->subject,
                          "is %d x %d, and a lat-long map is twice as wide as high",
                          d->map.width, d->map.height);
    d->view.pixels = d->map.rgb;
    d->view.width = d->map.width;
    d->view.height = d->map.height;
    d->view.channels = 3;
    d->view.row_stride_bytes = 0;
    d->view.mapping = ENVSAMP_LATLONG;
    ok = tables_make(&t, d);
    if (ok && bad)
        printf("%s: %lu texels are negative, infinite or NaN, and taken as 0\n", d->name,
               (unsigned long)bad);
    if (ok)
        MAKE_FOLDER(d->folder);      /* where it fails, so does the first picture */
    ok = ok && print_methods(d, &t) && sphere_picture(d, &t) && mis_picture(d)
         && map_pictures(d, &t);
    tables_free(&t);
    return ok;
}

/* The file's name without folders and without what follows the last dot. */
static void name_of_path(const char *path, char *name, size_t size)
{
    const char *start = path, *dot, *p;
    size_t length;

    for (p = path; *p; p++)
        if (*p == '/' || *p == '\\')
            start = p + 1;
    dot = strrchr(start, '.');
    length = dot && dot > start ? (size_t)(dot - start) : strlen(start);
    length = length < size ? length : size - 1;
    memcpy(name, start, length);
    name[length] = '\0';
}

/* `subject`: a name of maps.h, or a path. */
static int do_subject(demo *d, const char *subject)
{
    int ok;

    d->subject = subject;
    name_of_path(subject, d->name, sizeof d->name);
    ok = (map_make(subject, MAP_WIDTH, MAP_HEIGHT, &d->map)
          || image_read(subject, &d->map, d->error, sizeof d->error)) && do_map(d);
    image_free(&d->map);
    return ok;
}

/* ---- options ---- */

#define USAGE "usage: demo [-o FOLDER] [MAP]\n"

static int help(void)
{
    printf(USAGE
           "Samples a lat-long environment map, prints what each sampler costs, and draws\n"
           "pictures into FOLDER (default: build/pictures). MAP is an HDR, a PFM or, in a\n"
           "build with OpenEXR, an EXR file, or a made-up map: sky (the default), studio,\n"
           "constant, night or foliage.\n");
    return EXIT_SUCCESS;
}

/* Returns nonzero if the arguments make sense. */
static int parse(int argc, char **argv, demo *d, const char **subject)
{
    int i;

    for (i = 1; i < argc; i++) {
        if (!strcmp(argv[i], "-o") && i + 1 < argc)
            d->folder = argv[++i];
        else if (argv[i][0] != '-' && argv[i][0] && !*subject)
            *subject = argv[i];
        else
            return 0;
    }
    return 1;
}

int main(int argc, char **argv)
{
    static demo d;
    const char *subject = NULL;
    int ok;

    if (argc > 1 && (!strcmp(argv[1], "-h") || !strcmp(argv[1], "--help")))
        return help();
    d.folder = "build/pictures";
    if (!parse(argc, argv, &d, &subject)) {
        fprintf(stderr, USAGE);
        return EXIT_FAILURE;
    }
    ok = do_subject(&d, subject ? subject : "sky");
    if (ok)
        print_legend();
    fflush(stdout);
    if (!ok)
        fprintf(stderr, "demo: %s\n", d.error);
    return ok ? EXIT_SUCCESS : EXIT_FAILURE;
}
