/* demo.c: samples environment maps, prints what each sampler costs, and draws pictures.
 *
 * Without a file it does so with made-up maps, so it needs a C compiler and nothing else. Every
 * figure is measured while it runs.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "../bench/baselines.h"
#include "common/image.h"
#include "common/maps.h"
#include "common/picture.h"
#include "common/random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#ifdef _WIN32
#include <direct.h>
#define MAKE_FOLDER(path) _mkdir(path)
#else
#include <sys/stat.h>
#include <sys/types.h>
#define MAKE_FOLDER(path) mkdir(path, 0777)
#endif

#define PI 3.14159265358979f
#define MAP_WIDTH 2048
#define MAP_HEIGHT 1024

#define BUILD_ROUNDS 5               /* odd: the median is a measurement */
#define SAMPLE_ROUNDS 5
#define SAMPLES_A_ROUND (1 << 19)

static const unsigned char white[3] = {255, 255, 255}, black[3] = {0, 0, 0};

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
    printf("%-23s %6s %7s %8s %7s %8s %8s %7s %9s\n", "", "", "table", "smaller", "bounds",
           "smaller", "build", "sample", "excess");
    printf("%-23s %6s %7s %8s %7s %8s %8s %7s %9s %8s\n", "method", "blocks", "KiB", "than CDF",
           "KiB", "than CDF", "ms", "ns", "variance", "alpha");
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
    double bounds_kib = 8.0 * (double)t->info.block_count / 1024.0;

    printf("%-23s %6d %7.1f", m->name, t->info.block_count, table_kib);
    print_smaller(d, table_kib);
    printf(" %7.1f", bounds_kib);
    print_smaller(d, bounds_kib);
    printf(" %8.2f %7.1f %9.5f", t->build_ms, ns, t->info.excess_variance);
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
    printf("%-23s %6s %7.1f %7.1fx %7s %8s %8.2f %7.1f %9d %8s\n", "full CDF, binary search",
           "-", cdf_kib(d), 1.0, "-", "-", median(ms, BUILD_ROUNDS), ns, 0, "-");
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
           "relative to the squared integral, 0 for the full CDF. Its KiB are 4 bytes a texel,\n"
           "without the densities that the one timed keeps beside. Times: medians of %d runs.\n"
           "(*) as published: Ergun, Kurt, Ozturk 2012.\n", BUILD_ROUNDS);
}

/* ---- pictures of the map ---- */

#define MAP_PICTURE_WIDTH 1024
#define MAP_PICTURE_HEIGHT 512
#define SHOWN_SAMPLES 4096

static int save(demo *d, const picture *canvas, const char *what)
{
    char path[IMAGE_PATH_MAX];
    int length = snprintf(path, sizeof path, "%s/%s_%s.png", d->folder, d->name, what);

    if (length < 0 || (size_t)length >= sizeof path)
        return image_fail(d->error, sizeof d->error, d->folder, "the path is too long");
    if (!picture_write(canvas, path, d->error, sizeof d->error))
        return 0;
    printf("%s\n", path);
    return 1;
}

static float texel_luminance(const demo *d, int x, int y)
{
    return envsamp_luminance(d->map.rgb + 3 * ((size_t)y * (size_t)d->map.width + (size_t)x));
}

static float texel_sr(const demo *d, int y)
{
    const float step = PI / (float)d->map.height;

    return 4.0f * PI / (float)d->map.width * sinf(0.5f * step) * sinf(step * ((float)y + 0.5f));
}

/* Puts the map's geometric mean at a middle grey. */
static float map_exposure(const demo *d, double integral)
{
    const float floor_luminance = 1e-4f * (float)integral;
    double sum = 0.0;
    int x, y;

    for (y = 0; y < d->map.height; y++)
        for (x = 0; x < d->map.width; x++)
            sum += (double)texel_sr(d, y)
                   * log((double)fmaxf(texel_luminance(d, x, y), floor_luminance));
    return (float)(0.16 / exp(sum / (4.0 * (double)PI)));
}

/* One pixel of an outline: darker on a bright map, brighter on a dark one. */
static void outline_pixel(picture *canvas, const picture *under, int x, int y, float cover)
{
    const unsigned char *p;
    int bright;

    if (x >= under->width || y >= under->height)
        return;
    p = under->rgb + 3 * ((size_t)y * (size_t)under->width + (size_t)x);
    bright = 2 * p[0] + 5 * p[1] + p[2] > 8 * 48;
    picture_blend(canvas, x, y, bright ? black : white, bright ? cover : 0.6f * cover);
}

/* The upper and left sides of a block; its neighbours draw the others. Outlines of blocks of a
   few pixels are fainter, so that the map is still seen between them. */
static void outline_block(picture *canvas, const picture *under, const envsamp_kd_block *block)
{
    const int x0 = (int)(block->uv_min[0] * (float)canvas->width + 0.5f);
    const int x1 = (int)(block->uv_max[0] * (float)canvas->width + 0.5f);
    const int y0 = (int)(block->uv_min[1] * (float)canvas->height + 0.5f);
    const int y1 = (int)(block->uv_max[1] * (float)canvas->height + 0.5f);
    const int side = x1 - x0 < y1 - y0 ? x1 - x0 : y1 - y0;
    const float cover = side >= 8 ? 0.6f : side >= 4 ? 0.4f : 0.2f;
    int i;

    for (i = x0; i < x1 && y1 > y0; i++)
        outline_pixel(canvas, under, i, y0, cover);
    for (i = y0 + 1; i < y1 && x1 > x0; i++)
        outline_pixel(canvas, under, x0, i, cover);
}

static void draw_blocks(picture *canvas, const picture *under, const table *t)
{
    int i;

    for (i = 0; i < t->info.block_count; i++) {
        envsamp_kd_block block;

        if (envsamp_kd_get_block(t->kd, i, &block) == ENVSAMP_OK)
            outline_block(canvas, under, &block);
    }
}

/* A dot of one colour in a ring of black, so that it shows on anything. */
static void draw_dot(picture *canvas, int x, int y)
{
    static const unsigned char colour[3] = {255, 120, 0};
    int i, j;

    for (j = -2; j <= 2; j++)
        for (i = -2; i <= 2; i++)
            if (i * i + j * j <= 4 && i * i + j * j > 1)
                picture_blend(canvas, x + i, y + j, black, 0.35f);
    for (j = -1; j <= 1; j++)
        for (i = -1; i <= 1; i++)
            if (i * i + j * j <= 1)
                picture_blend(canvas, x + i, y + j, colour, 1.0f);
}

static void draw_samples(picture *canvas, const envsamp_kd *kd)
{
    uint32_t i;

    for (i = 0; i < SHOWN_SAMPLES; i++) {
        float u[2];
        envsamp_sample s;

        sobol_owen(i, 7, u);
        s = envsamp_kd_sample(kd, u[0], u[1]);
        draw_dot(canvas, (int)(s.uv[0] * (float)canvas->width),
                 (int)(s.uv[1] * (float)canvas->height));
    }
}

static int map_pictures(demo *d, const table *t)
{
    const size_t bytes = (size_t)MAP_PICTURE_WIDTH * MAP_PICTURE_HEIGHT * 3;
    picture under, canvas;
    int ok = 0;

    if (picture_alloc(&under, MAP_PICTURE_WIDTH, MAP_PICTURE_HEIGHT)
        + picture_alloc(&canvas, MAP_PICTURE_WIDTH, MAP_PICTURE_HEIGHT) == 2) {
        picture_map(&under, 0, 0, under.width, under.height, &d->map,
                    map_exposure(d, t->info.integral));
        memcpy(canvas.rgb, under.rgb, bytes);
        draw_blocks(&canvas, &under, t);
        ok = save(d, &canvas, "blocks");
        memcpy(canvas.rgb, under.rgb, bytes);
        draw_samples(&canvas, t->kd);
        ok = ok && save(d, &canvas, "samples");
    } else {
        fail(d, "not enough memory for a picture");
    }
    picture_free(&under);
    picture_free(&canvas);
    return ok;
}

/* ---- pictures of spheres ---- */

#define SPHERE_SIDE 136              /* pixels of a sphere's square */
#define SPHERE_RADIUS 51.0f
#define LABEL_HEIGHT 42
#define SPHERE_SAMPLES 16            /* a pixel */
#define GLOSS 32                     /* exponent of the lobe, a power of two */
#define CELLS_X 128
#define CELLS_Y 64
#define CELL_COUNT (CELLS_X * CELLS_Y)

enum { DIFFUSE, GLOSSY, SURFACE_COUNT };
enum { BY_UNIFORM, BY_FIT, BY_ALIAS, REFERENCE, PANEL_COUNT };

static const char *const panel_names[PANEL_COUNT] = {"UNIFORM", "FIT", "ALIAS", "REFERENCE"};

/* The light of a cell of the map, for the reference: radiance x solid angle, and the same times
   the direction, a channel. */
typedef struct cell {
    float power[3], vector[3][3], dir[3];
} cell;

typedef struct panel {
    float rgb[SPHERE_SIDE * SPHERE_SIDE * 3];
    double rmse;                     /* relative to the mean of the reference */
} panel;

typedef struct spheres {
    const demo *d;
    const envsamp_kd *tables[PANEL_COUNT];
    cell cells[CELL_COUNT];
    float to_eye[3], right[3];       /* up is +z */
    panel panels[SURFACE_COUNT][PANEL_COUNT];
} spheres;

static float dot3(const float a[3], const float b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void add_texel(cell *c, const float rgb[3], float sr, const float dir[3])
{
    int i, axis;

    for (i = 0; i < 3; i++) {
        c->power[i] += rgb[i] * sr;
        for (axis = 0; axis < 3; axis++)
            c->vector[i][axis] += rgb[i] * sr * dir[axis];
    }
}

static void aim_cell(cell *c)
{
    float length;
    int axis;

    for (axis = 0; axis < 3; axis++)
        c->dir[axis] = c->vector[0][axis] + c->vector[1][axis] + c->vector[2][axis];
    length = sqrtf(dot3(c->dir, c->dir));
    for (axis = 0; axis < 3 && length > 0.0f; axis++)
        c->dir[axis] /= length;
}

static void gather_cells(spheres *s)
{
    const image *map = &s->d->map;
    int x, y, i;

    for (y = 0; y < map->height; y++)
        for (x = 0; x < map->width; x++) {
            const size_t texel = (size_t)y * (size_t)map->width + (size_t)x;
            const long long across = (long long)x * CELLS_X / map->width;
            const long long down = (long long)y * CELLS_Y / map->height;
            float dir[3];

            envsamp_uv_to_dir(ENVSAMP_LATLONG, ((float)x + 0.5f) / (float)map->width,
                              ((float)y + 0.5f) / (float)map->height, dir);
            add_texel(&s->cells[down * CELLS_X + across], map->rgb + 3 * texel,
                      texel_sr(s->d, y), dir);
        }
    for (i = 0; i < CELL_COUNT; i++)
        aim_cell(&s->cells[i]);
}

/* The eye stands where the strongest light falls in over its left shoulder. */
static void place_eye(spheres *s)
{
    float x = 0.0f, y = 0.0f, azimuth;
    int i;

    for (i = 0; i < CELL_COUNT; i++) {
        x += s->cells[i].vector[1][0];
        y += s->cells[i].vector[1][1];
    }
    azimuth = atan2f(y, x) + 0.9f;
    s->to_eye[0] = cosf(azimuth);
    s->to_eye[1] = sinf(azimuth);
    s->to_eye[2] = 0.0f;
    s->right[0] = -s->to_eye[1];
    s->right[1] = s->to_eye[0];
    s->right[2] = 0.0f;
}

/* The normal and the mirrored view at a pixel; 0 beside the sphere. */
static int sphere_at(const spheres *s, int column, int row, float normal[3], float mirror[3])
{
    const float half = 0.5f * SPHERE_SIDE;
    const float a = ((float)column + 0.5f - half) / SPHERE_RADIUS;
    const float b = (half - (float)row - 0.5f) / SPHERE_RADIUS;
    const float c = 1.0f - a * a - b * b;
    float facing;
    int i;

    if (c <= 0.0f)
        return 0;
    for (i = 0; i < 3; i++)
        normal[i] = a * s->right[i] + sqrtf(c) * s->to_eye[i] + (i == 2 ? b : 0.0f);
    facing = dot3(normal, s->to_eye);
    for (i = 0; i < 3; i++)
        mirror[i] = 2.0f * facing * normal[i] - s->to_eye[i];
    return 1;
}

/* cos^GLOSS, such that it integrates to 1. */
static float lobe(float cosine)
{
    int power;

    for (power = 1; power < GLOSS; power *= 2)
        cosine *= cosine;
    return cosine * (GLOSS + 1) / (2.0f * PI);
}

/* What a surface that sends all light on shows of radiance from `dir`. */
static float response(int surface, const float normal[3], const float mirror[3],
                      const float dir[3])
{
    const float cosine = dot3(surface == DIFFUSE ? normal : mirror, dir);

    if (cosine <= 0.0f)
        return 0.0f;
    return surface == DIFFUSE ? cosine / PI : lobe(cosine);
}

static void shade_reference(const spheres *s, int surface, const float normal[3],
                            const float mirror[3], float rgb[3])
{
    int i, channel;

    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    for (i = 0; i < CELL_COUNT; i++) {
        const cell *c = &s->cells[i];
        const float gloss = surface == GLOSSY ? response(GLOSSY, normal, mirror, c->dir) : 0.0f;

        for (channel = 0; channel < 3; channel++)
            rgb[channel] += surface == DIFFUSE ? fmaxf(dot3(normal, c->vector[channel]), 0.0f) / PI
                                               : gloss * c->power[channel];
    }
}

static envsamp_sample draw_direction(const envsamp_kd *kd, pcg32 *random)
{
    const float u0 = pcg32_float(random), u1 = pcg32_float(random);
    envsamp_sample sample;
    float level;

    if (kd)
        return envsamp_kd_sample(kd, u0, u1);
    sample.uv[0] = sample.uv[1] = 0.0f;
    sample.pdf = 0.25f / PI;
    sample.dir[2] = 1.0f - 2.0f * u1;
    level = sqrtf(fmaxf(1.0f - sample.dir[2] * sample.dir[2], 0.0f));
    sample.dir[0] = level * cosf(2.0f * PI * u0);
    sample.dir[1] = level * sinf(2.0f * PI * u0);
    return sample;
}

static void shade_sampled(const spheres *s, int surface, const envsamp_kd *kd, pcg32 random,
                          const float normal[3], const float mirror[3], float rgb[3])
{
    int i, channel;

    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    for (i = 0; i < SPHERE_SAMPLES; i++) {
        const envsamp_sample sample = draw_direction(kd, &random);
        const float weight = response(surface, normal, mirror, sample.dir)
                             / (sample.pdf * SPHERE_SAMPLES);
        float radiance[3];

        if (!(weight > 0.0f))
            continue;
        envsamp_lookup(&s->d->view, 0, sample.dir, radiance);
        for (channel = 0; channel < 3; channel++)
            rgb[channel] += weight * radiance[channel];
    }
}

static void shade_panel(spheres *s, int surface, int which)
{
    float *rgb = s->panels[surface][which].rgb, normal[3], mirror[3];
    int i;

    for (i = 0; i < SPHERE_SIDE * SPHERE_SIDE; i++, rgb += 3) {
        if (!sphere_at(s, i % SPHERE_SIDE, i / SPHERE_SIDE, normal, mirror))
            continue;
        if (which == REFERENCE)
            shade_reference(s, surface, normal, mirror, rgb);
        else
            shade_sampled(s, surface, s->tables[which], pcg32_make(11, (uint64_t)i), normal,
                          mirror, rgb);
    }
}

/* Root mean square error over the pixels and channels of the sphere, relative to the mean. */
static double panel_rmse(const panel *p, const panel *reference)
{
    double squares = 0.0, sum = 0.0, count = 0.0;
    int i;

    for (i = 0; i < SPHERE_SIDE * SPHERE_SIDE * 3; i++) {
        double error = (double)p->rgb[i] - (double)reference->rgb[i];

        squares += error * error;
        sum += (double)reference->rgb[i];
        count += reference->rgb[i] > 0.0f;
    }
    return sqrt(squares * count) / sum;
}

/* The brightest point just below white, unless that leaves the rest in the dark. */
static float panel_exposure(const panel *reference)
{
    float largest = 0.0f, sum = 0.0f, count = 0.0f;
    int i;

    for (i = 0; i < SPHERE_SIDE * SPHERE_SIDE; i++) {
        const float luminance = envsamp_luminance(reference->rgb + 3 * i);

        largest = fmaxf(largest, luminance);
        sum += luminance;
        count += luminance > 0.0f ? 1.0f : 0.0f;
    }
    return fmaxf(0.75f / largest, 0.14f * count / sum);
}

static void draw_ball(picture *canvas, int x, int y, const spheres *s, int surface, int which)
{
    const float exposure = panel_exposure(&s->panels[surface][REFERENCE]);
    float normal[3], mirror[3], rgb[3];
    unsigned char colour[3];
    image one = {1, 1, NULL};
    int i;

    one.rgb = rgb;
    for (i = 0; i < SPHERE_SIDE * SPHERE_SIDE; i++) {
        if (!sphere_at(s, i % SPHERE_SIDE, i / SPHERE_SIDE, normal, mirror))
            continue;
        memcpy(rgb, s->panels[surface][which].rgb + 3 * i, sizeof rgb);
        image_tonemap(&one, exposure, colour);
        picture_blend(canvas, x + i % SPHERE_SIDE, y + i / SPHERE_SIDE, colour, 1.0f);
    }
}

static void centred_text(picture *canvas, int x, int y, const char *text)
{
    const int width = 2 * PICTURE_GLYPH_WIDTH * (int)strlen(text) - 2;

    picture_text(canvas, x + (SPHERE_SIDE - width) / 2, y, 2, white, text);
}

static void draw_panel(picture *canvas, int x, int y, const spheres *s, int surface, int which)
{
    const int below = y + SPHERE_SIDE;
    char text[32];

    draw_ball(canvas, x, y, s, surface, which);
    centred_text(canvas, x, below, panel_names[which]);
    snprintf(text, sizeof text, "RMSE %#.3g", s->panels[surface][which].rmse);
    if (which != REFERENCE)
        centred_text(canvas, x, below + 18, text);
}

static int draw_spheres(demo *d, const spheres *s)
{
    static const unsigned char ground[3] = {38, 40, 44};
    const int panel_height = SPHERE_SIDE + LABEL_HEIGHT;
    picture canvas;
    int surface, which, ok;

    if (!picture_alloc(&canvas, PANEL_COUNT * SPHERE_SIDE, SURFACE_COUNT * panel_height))
        return fail(d, "not enough memory for a picture");
    picture_fill(&canvas, 0, 0, canvas.width, canvas.height, ground);
    for (surface = 0; surface < SURFACE_COUNT; surface++)
        for (which = 0; which < PANEL_COUNT; which++)
            draw_panel(&canvas, which * SPHERE_SIDE, surface * panel_height, s, surface, which);
    ok = save(d, &canvas, "sphere");
    picture_free(&canvas);
    return ok;
}

static void print_spheres(const spheres *s)
{
    static const char *const surface_names[SURFACE_COUNT] = {"diffuse", "glossy"};
    int surface;

    printf("\nRMSE of a lit sphere, %d samples a pixel:  uniform      FIT    ALIAS\n",
           SPHERE_SAMPLES);
    for (surface = 0; surface < SURFACE_COUNT; surface++)
        printf("%-42s %8.3f %8.3f %8.3f\n", surface_names[surface],
               s->panels[surface][BY_UNIFORM].rmse, s->panels[surface][BY_FIT].rmse,
               s->panels[surface][BY_ALIAS].rmse);
    printf("\n");
}

static int sphere_picture(demo *d, const table *alias, const table *fit)
{
    spheres *s = calloc(1, sizeof *s);
    int surface, which, ok;

    if (!s)
        return fail(d, "not enough memory for a picture");
    s->d = d;
    s->tables[BY_FIT] = fit->kd;
    s->tables[BY_ALIAS] = alias->kd;
    gather_cells(s);
    place_eye(s);
    for (surface = 0; surface < SURFACE_COUNT; surface++) {
        for (which = 0; which < PANEL_COUNT; which++)
            shade_panel(s, surface, which);
        for (which = 0; which < PANEL_COUNT; which++)
            s->panels[surface][which].rmse = panel_rmse(&s->panels[surface][which],
                                                        &s->panels[surface][REFERENCE]);
    }
    print_spheres(s);
    ok = draw_spheres(d, s);
    free(s);
    return ok;
}

/* ---- one map ---- */

static int make_pictures(demo *d)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    table alias, fit;
    int ok = 0;

    if (!table_make(&alias, d, &desc, 1))
        return 0;
    desc.select = ENVSAMP_KD_FIT;
    desc.objective = ENVSAMP_KD_CHI2;
    if (table_make(&fit, d, &desc, 1)) {
        ok = sphere_picture(d, &alias, &fit) && map_pictures(d, &alias);
        table_free(&fit);
    }
    table_free(&alias);
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
           "pictures into FOLDER (default: build/pictures). FILE is a PFM or, in a build with\n"
           "OpenEXR, an EXR. Without FILE: three made-up maps.\n");
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
