/* demo.c: samples environment maps, prints what each sampler costs and how far it is off, and
 * draws pictures.
 *
 * Without a file it does so with made-up maps, so it needs a C compiler and nothing else. Every
 * figure is measured while it runs.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "baselines.h"
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

#define MAP_WIDTH 2048
#define MAP_HEIGHT 1024

#define BUILD_ROUNDS 3               /* odd: the median is a measurement */
#define SAMPLE_ROUNDS 3
#define SAMPLES_A_ROUND (1 << 18)
#define SCRAMBLINGS 32               /* sets of points behind an error */

typedef struct demo {
    const char *folder;              /* for pictures */
    char name[256];                  /* of the map: the start of its pictures' names */
    const char *subject;             /* what an error is about: the path of the map, or its name */
    image map;
    envsamp_image view;              /* of `map`, for the library */
    char error[IMAGE_PATH_MAX + 256];
} demo;

static void progress(const demo *d, const char *what)
{
    fflush(stdout);
    fprintf(stderr, "demo: %s: %s\n", d->name, what);
}

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

static int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

static double median(double *values, size_t count)
{
    qsort(values, count, sizeof *values, ascending);
    return values[count / 2];
}

static double clock_ms(void)
{
    return 1000.0 * (double)clock() / (double)CLOCKS_PER_SEC;
}

static void table_free(table *t)
{
    free(t->memory.data);
    t->memory.data = NULL;
}

/* Builds a table `rounds` times over; its build_ms is the median. */
static envsamp_result table_build(table *t, const envsamp_image *view, const envsamp_kd_desc *desc,
                                  envsamp_buffer scratch, int rounds)
{
    double ms[BUILD_ROUNDS];
    envsamp_result result = ENVSAMP_OK;
    int i;

    for (i = 0; i < rounds && result == ENVSAMP_OK; i++) {
        double start = clock_ms();

        result = envsamp_kd_build(view, desc, t->memory, scratch, &t->kd);
        ms[i] = clock_ms() - start;
    }
    if (result == ENVSAMP_OK) {
        t->build_ms = median(ms, (size_t)rounds);
        envsamp_kd_get_info(t->kd, &t->info);
    }
    return result;
}

/* Makes a table, to be freed with table_free. Returns 0, with the reason in d->error. */
static int table_make(table *t, demo *d, const envsamp_kd_desc *desc, int rounds)
{
    envsamp_sizes sizes;
    envsamp_buffer scratch;
    envsamp_result result = envsamp_kd_sizes(&d->view, desc, &sizes);

    t->kd = NULL;
    t->memory.data = malloc(t->memory.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    if (result == ENVSAMP_OK && t->memory.data && scratch.data)
        result = table_build(t, &d->view, desc, scratch, rounds);
    free(scratch.data);
    if (t->kd)
        return 1;
    table_free(t);
    return fail(d, result == ENVSAMP_OK ? "not enough memory" : envsamp_result_string(result));
}

/* ---- what a sampler costs ---- */

typedef struct method {
    const char *name;
    int block_count;
    envsamp_kd_select select;
    envsamp_kd_criterion criterion;
    envsamp_kd_model model;
    envsamp_kd_objective objective;
} method;

static const method methods[] = {
    {"WARP, split by EXCESS", 6144, ENVSAMP_KD_WARP, ENVSAMP_KD_EXCESS, ENVSAMP_KD_LOG,
     ENVSAMP_KD_L1},
    {"WARP, split by EXCESS", 16384, ENVSAMP_KD_WARP, ENVSAMP_KD_EXCESS, ENVSAMP_KD_LOG,
     ENVSAMP_KD_L1},
    {"ALIAS, split by EXCESS", 1024, ENVSAMP_KD_ALIAS, ENVSAMP_KD_EXCESS, ENVSAMP_KD_LOG,
     ENVSAMP_KD_L1},
    {"ALIAS, split by EXCESS", 6144, ENVSAMP_KD_ALIAS, ENVSAMP_KD_EXCESS, ENVSAMP_KD_LOG,
     ENVSAMP_KD_L1},
    {"ALIAS, split by EXCESS", 16384, ENVSAMP_KD_ALIAS, ENVSAMP_KD_EXCESS, ENVSAMP_KD_LOG,
     ENVSAMP_KD_L1},
    {"ALIAS, split by SSE", 6144, ENVSAMP_KD_ALIAS, ENVSAMP_KD_SSE, ENVSAMP_KD_LOG,
     ENVSAMP_KD_L1},
    {"FIT LOG L1, by SSE (*)", 6144, ENVSAMP_KD_FIT, ENVSAMP_KD_SSE, ENVSAMP_KD_LOG,
     ENVSAMP_KD_L1},
    {"FIT LOG L1", 6144, ENVSAMP_KD_FIT, ENVSAMP_KD_EXCESS, ENVSAMP_KD_LOG, ENVSAMP_KD_L1},
    {"FIT LOG CHI2", 6144, ENVSAMP_KD_FIT, ENVSAMP_KD_EXCESS, ENVSAMP_KD_LOG, ENVSAMP_KD_CHI2},
    {"FIT POWER CHI2", 6144, ENVSAMP_KD_FIT, ENVSAMP_KD_EXCESS, ENVSAMP_KD_POWER,
     ENVSAMP_KD_CHI2}
};

enum { METHOD_COUNT = sizeof methods / sizeof methods[0] };

static envsamp_kd_desc method_desc(const method *m)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();

    desc.nearest = 1;              /* as the CDF: radiance constant over a texel */
    desc.block_count = m->block_count;
    desc.select = m->select;
    desc.criterion = m->criterion;
    desc.model = m->model;
    desc.objective = m->objective;
    return desc;
}

static volatile float sink;          /* keeps the timed loops from being left out */

static double kd_sample_ms(const envsamp_kd *kd)
{
    pcg32 random = pcg32_make(1, 0);
    double start = clock_ms();
    float sum = 0.0f;
    int i;

    for (i = 0; i < SAMPLES_A_ROUND; i++) {
        float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        envsamp_sample s = envsamp_kd_sample(kd, u0, u1);

        sum += s.dir[0] + s.dir[1] + s.dir[2] + s.pdf;
    }
    sink = sum;
    return clock_ms() - start;
}

static double cdf_sample_ms(const baseline_cdf *cdf)
{
    pcg32 random = pcg32_make(1, 0);
    double start = clock_ms();
    float sum = 0.0f;
    int i;

    for (i = 0; i < SAMPLES_A_ROUND; i++) {
        float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        baseline_sample s = baseline_cdf_sample(cdf, u0, u1);

        sum += s.dir[0] + s.dir[1] + s.dir[2] + s.pdf;
    }
    sink = sum;
    return clock_ms() - start;
}

/* Of the table, or, where that is NULL, of the CDF. */
static double sample_ns(const envsamp_kd *kd, const baseline_cdf *cdf)
{
    double ms[SAMPLE_ROUNDS];
    int i;

    for (i = 0; i < SAMPLE_ROUNDS; i++)
        ms[i] = kd ? kd_sample_ms(kd) : cdf_sample_ms(cdf);
    return median(ms, SAMPLE_ROUNDS) * 1e6 / SAMPLES_A_ROUND;
}

static double cdf_kib(const demo *d)
{
    return 4.0 * (double)d->map.width * (double)d->map.height / 1024.0;
}

static void print_heading(const demo *d, double integral)
{
    printf("\n%s, %d x %d texels, integral of luminance %.4g\n\n", d->name, d->map.width,
           d->map.height, integral);
    printf("%-23s %6s %7s %8s %7s %8s %7s %9s %8s\n", "", "", "table", "smaller", "bounds",
           "build", "sample", "excess", "largest");
    printf("%-23s %6s %7s %8s %7s %8s %7s %9s %8s %8s\n", "method", "blocks", "KiB", "than CDF",
           "KiB", "ms", "ns", "variance", "L/pdf", "alpha");
}

/* How many times smaller than the full CDF. */
static void print_smaller(const demo *d, double kib)
{
    const double ratio = cdf_kib(d) / kib;

    printf(ratio < 99.95 ? " %7.1fx" : " %7.0fx", ratio);
}

static void print_method(const demo *d, const method *m, const table *t, double ns)
{
    double table_kib = (double)envsamp_kd_bytes(t->kd) / 1024.0;

    printf("%-23s %6d %7.1f", m->name, t->info.block_count, table_kib);
    print_smaller(d, table_kib);
    if (m->select == ENVSAMP_KD_WARP)       /* its tree stands for bounds */
        printf(" %7s", "-");
    else
        printf(" %7.1f", 16.0 * (double)t->info.block_count / 1024.0);
    printf(" %8.2f %7.1f %9.5f %8.3g", t->build_ms, ns, t->info.excess_variance,
           t->info.max_ratio);
    if (m->select == ENVSAMP_KD_FIT)
        printf(" %8.3g\n", t->info.alpha);
    else
        printf(" %8s\n", "-");
}

static int print_cdf(demo *d)
{
    baseline_cdf cdf;
    double ms[BUILD_ROUNDS], ns = 0.0;
    int i, made = 1;

    for (i = 0; i < BUILD_ROUNDS && made; i++) {
        double start = clock_ms();

        made = baseline_cdf_create(d->map.rgb, d->map.width, d->map.height, &cdf);
        ms[i] = clock_ms() - start;
        if (made && i == BUILD_ROUNDS - 1)
            ns = sample_ns(NULL, &cdf);
        if (made)
            baseline_cdf_destroy(&cdf);
    }
    if (!made)
        return fail(d, "not enough memory for the full CDF");
    printf("%-23s %6s %7.1f %7.1fx %7s %8.2f %7.1f %9d %8d %8s\n", "full CDF, binary search",
           "-", cdf_kib(d), 1.0, "-", median(ms, BUILD_ROUNDS), ns, 0, 1, "-");
    return 1;
}

static int print_methods(demo *d)
{
    int i;

    for (i = 0; i < METHOD_COUNT; i++) {
        envsamp_kd_desc desc = method_desc(&methods[i]);
        table t;

        if (!table_make(&t, d, &desc, BUILD_ROUNDS))
            return 0;
        if (i == 0)
            print_heading(d, t.info.integral);
        print_method(d, &methods[i], &t, sample_ns(t.kd, NULL));
        table_free(&t);
    }
    return print_cdf(d);
}

static void print_legend(void)
{
    printf("\nsample: direction and pdf, two random numbers included. excess variance: of L/pdf,\n"
           "relative to the squared integral, 0 for the full CDF; largest L/pdf: relative to the\n"
           "integral. The CDF's KiB are 4 bytes a texel, without the densities that the one timed\n"
           "keeps beside. Times: medians of %d runs. RMSE of irradiance: relative, over %d\n"
           "normals and %d Owen-scrambled sets of N points; of a sphere: relative to its mean.\n"
           "(*) as published: Ergun, Kurt, Ozturk 2012.\n", BUILD_ROUNDS, IRRADIANCE_NORMALS,
           SCRAMBLINGS);
}

/* ---- pictures, and errors of what they show ---- */

enum { BY_UNIFORM, BY_FIT, BY_ALIAS, BY_WARP };      /* samplers of spheres, the best last */

typedef struct tables { table warp, alias, fit; } tables;

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
    const float exposure = map_exposure(&d->map, t->warp.info.integral);
    sampler by[2];
    picture canvas;
    int made;

    by[0] = sampler_of_kd("WARP", t->warp.kd);
    by[1] = sampler_of_kd("ALIAS", t->alias.kd);
    made = blocks_picture(&canvas, &d->map, exposure, t->warp.kd);
    if (!save(d, &canvas, made, "blocks"))
        return 0;
    made = points_picture(&canvas, &d->map, &d->view, exposure, t->warp.kd, by, 2);
    return save(d, &canvas, made, "samples");
}

static void print_irradiance(const demo *d, const irradiance *exact, const sampler *by, int count)
{
    static const uint32_t points[] = {16, 64, 256, 1024};
    int i, j;

    printf("\nRMSE of irradiance, Sobol points:  N = %4u    N = %4u    N = %4u    N = %4u\n",
           points[0], points[1], points[2], points[3]);
    for (i = 0; i < count; i++) {
        printf("%-32s", by[i].name);
        for (j = 0; j < 4; j++)
            printf(" %11.5f", irradiance_rmse(exact, &d->view, &by[i], points[j], SCRAMBLINGS));
        printf("\n");
    }
}

static int irradiance_errors(demo *d, const tables *t)
{
    static irradiance exact;
    baseline_cdf cdf;
    sampler by[3];

    if (!irradiance_make(&exact, &d->map)
        || !baseline_cdf_create(d->map.rgb, d->map.width, d->map.height, &cdf))
        return fail(d, "not enough memory for the irradiance");
    by[0] = sampler_of_kd("WARP", t->warp.kd);
    by[1] = sampler_of_kd("ALIAS", t->alias.kd);
    by[2] = sampler_of_cdf("full CDF, binary search", &cdf);
    print_irradiance(d, &exact, by, 3);
    baseline_cdf_destroy(&cdf);
    return 1;
}

static void print_spheres(const spheres *s)
{
    static const char *const surface_names[SURFACE_COUNT] = {"diffuse", "glossy"};
    int surface;

    printf("\n%-32s %11s %11s %11s %11s\n", "RMSE of a sphere, 16 points", "uniform", "FIT",
           "ALIAS", "WARP");
    for (surface = 0; surface < SURFACE_COUNT; surface++) {
        const panel *panels = s->panels[surface];

        printf("%-32s %11.3f %11.3f %11.3f %11.3f\n", surface_names[surface],
               panels[BY_UNIFORM].rmse, panels[BY_FIT].rmse, panels[BY_ALIAS].rmse,
               panels[BY_WARP].rmse);
    }
    printf("\n");
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
    s->by[BY_FIT] = sampler_of_kd("FIT", t->fit.kd);
    s->by[BY_ALIAS] = sampler_of_kd("ALIAS", t->alias.kd);
    s->by[BY_WARP] = sampler_of_kd("WARP", t->warp.kd);
    spheres_shade(s);
    print_spheres(s);
    made = spheres_draw(s, &canvas);
    ok = save(d, &canvas, made, "sphere");
    free(s);
    return ok;
}

/* ---- multiple importance sampling ---- */

/* A cdf table, to be freed with free(memory->data). Returns NULL where memory is short. */
static const envsamp_cdf *cdf_make(const demo *d, float compensation, envsamp_buffer *memory)
{
    envsamp_cdf_desc desc = envsamp_cdf_defaults();
    envsamp_sizes sizes;
    envsamp_buffer scratch;
    const envsamp_cdf *cdf = NULL;

    desc.mis_compensation = compensation;
    envsamp_cdf_sizes(&d->view, &desc, &sizes);
    memory->data = malloc(memory->bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    envsamp_cdf_build(&d->view, &desc, *memory, scratch, &cdf);
    free(scratch.data);
    return cdf;
}

/* The gain is by how much the variance falls. */
static void print_mis_row(const char *name, const mis_panel *panels)
{
    const double plain = panels[MIS_PLAIN].rmse, compensated = panels[MIS_COMPENSATED].rmse;
    const double gain = compensated > 0.0 ? plain * plain / (compensated * compensated) : 1.0;

    printf("%-32s %11.4f %11.4f %11.4f %11.4f %7.2f\n", name, panels[MIS_BSDF].rmse,
           panels[MIS_MAP].rmse, plain, compensated, gain);
}

static int mis_shade(demo *d, mis_scene *s, picture *canvas)
{
    envsamp_buffer memory[2] = {{NULL, 0}, {NULL, 0}};
    const envsamp_cdf *plain = cdf_make(d, 0.0f, &memory[0]);
    const envsamp_cdf *compensated = cdf_make(d, 1.0f, &memory[1]);
    const int ok = plain && compensated;
    int made = 0;

    if (ok) {
        mis_scene_shade(s, 1);
        printf("\n%-32s %11s %11s %11s %11s %7s\n", "RMSE of a scene, 16 rays", "BSDF", "map",
               "MIS", "compensated", "gain");
        print_mis_row("kd, WARP", s->panels);
        made = mis_scene_draw(s, canvas);
        s->plain = mis_light_of_cdf(plain);
        s->compensated = mis_light_of_cdf(compensated);
        mis_scene_shade(s, 0);
        print_mis_row("cdf", s->panels);
        printf("\n");
    }
    free(memory[0].data);
    free(memory[1].data);
    return made;
}

/* The tables of this scene are made for bilinear lookups. */
static int mis_picture(demo *d)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    mis_scene *s = calloc(1, sizeof *s);
    table plain, compensated;
    picture canvas = {0, 0, NULL};
    int ok = 0;

    plain.memory.data = compensated.memory.data = NULL;
    if (!s)
        return fail(d, "not enough memory for a picture");
    if (table_make(&plain, d, &desc, 1)) {
        desc.mis_compensation = 1.0f;
        if (table_make(&compensated, d, &desc, 1)) {
            s->view = &d->view;
            s->plain = mis_light_of_kd(plain.kd);
            s->compensated = mis_light_of_kd(compensated.kd);
            ok = save(d, &canvas, mis_shade(d, s, &canvas), "mis");
        }
    }
    table_free(&plain);
    table_free(&compensated);
    free(s);
    return ok;
}

/* ---- one map ---- */

static int tables_make(tables *t, demo *d)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();

    t->warp.memory.data = t->alias.memory.data = t->fit.memory.data = NULL;
    desc.nearest = 1;              /* as irradiance and spheres take the map */
    if (!table_make(&t->warp, d, &desc, 1))
        return 0;
    desc.select = ENVSAMP_KD_ALIAS;
    if (!table_make(&t->alias, d, &desc, 1))
        return 0;
    desc.select = ENVSAMP_KD_FIT;
    desc.objective = ENVSAMP_KD_CHI2;
    return table_make(&t->fit, d, &desc, 1);
}

static int make_pictures(demo *d)
{
    tables t;
    const int ok = tables_make(&t, d) && irradiance_errors(d, &t) && sphere_picture(d, &t)
                   && mis_picture(d) && map_pictures(d, &t);

    table_free(&t.warp);
    table_free(&t.alias);
    table_free(&t.fit);
    return ok;
}

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
    size_t bad = clean(&d->map);
    table probe;

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
    if (!table_make(&probe, d, NULL, 1))    /* before anything is written */
        return 0;
    table_free(&probe);
    if (bad)
        printf("%s: %lu texels are negative, infinite or NaN, and taken as 0\n", d->name,
               (unsigned long)bad);
    progress(d, "building and timing");
    MAKE_FOLDER(d->folder);          /* where it fails, so does the first picture */
    if (!print_methods(d))
        return 0;
    progress(d, "drawing");
    return make_pictures(d);
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

static int do_file(demo *d, const char *path)
{
    int ok;

    d->subject = path;
    name_of_path(path, d->name, sizeof d->name);
    ok = image_read(path, &d->map, d->error, sizeof d->error) && do_map(d);
    image_free(&d->map);
    return ok;
}

static int do_made_up(demo *d, const char *name)
{
    int ok;

    d->subject = name;
    name_of_path(name, d->name, sizeof d->name);
    progress(d, "making the map");
    ok = map_make(name, MAP_WIDTH, MAP_HEIGHT, &d->map) ? do_map(d)
                                                        : fail(d, "not enough memory");
    image_free(&d->map);
    return ok;
}

/* ---- options ---- */

#define USAGE "usage: demo [-o FOLDER] [FILE]\n"

static int help(void)
{
    printf(USAGE
           "Samples a lat-long environment map, prints what each sampler costs, and draws\n"
           "pictures into FOLDER (default: build/pictures). FILE is an HDR, a PFM or, in a\n"
           "build with OpenEXR, an EXR. Without FILE: three made-up maps.\n");
    return EXIT_SUCCESS;
}

/* Returns nonzero if the arguments make sense. */
static int parse(int argc, char **argv, demo *d, const char **path)
{
    int i;

    for (i = 1; i < argc; i++) {
        if (!strcmp(argv[i], "-o") && i + 1 < argc)
            d->folder = argv[++i];
        else if (argv[i][0] != '-' && argv[i][0] && !*path)
            *path = argv[i];
        else
            return 0;
    }
    return 1;
}

int main(int argc, char **argv)
{
    static const char *const made_up[] = {"sky", "studio", "constant"};
    static demo d;
    const char *path = NULL;
    int i, ok = 1;

    if (argc > 1 && (!strcmp(argv[1], "-h") || !strcmp(argv[1], "--help")))
        return help();
    d.folder = "build/pictures";
    if (!parse(argc, argv, &d, &path)) {
        fprintf(stderr, USAGE);
        return EXIT_FAILURE;
    }
    if (path)
        ok = do_file(&d, path);
    for (i = 0; i < 3 && !path && ok; i++)
        ok = do_made_up(&d, made_up[i]);
    if (ok)
        print_legend();
    fflush(stdout);
    if (!ok)
        fprintf(stderr, "demo: %s\n", d.error);
    return ok ? EXIT_SUCCESS : EXIT_FAILURE;
}
