/* bench.c: what a sample, a pdf and a build cost, beside the samplers of baselines.h.
 *
 * Contenders take turns: one round of each, then the next round, so that a change of clock
 * frequency or a busy neighbour meets all alike. Reported is the median over the rounds, and
 * the median of the ratios within a round. Every timing loop is a function of its own that
 * adds up all that a sampler returns; the baselines are compiled apart, the library in this
 * file, as a user has it.
 */
#define _POSIX_C_SOURCE 200809L

#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "../examples/common/image.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"
#include "baselines.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#ifndef BENCH_FLAGS
#define BENCH_FLAGS "not given"
#endif

#define ROUND_COUNT     9           /* odd, so that the median is a measurement */
#define NUMBER_COUNT    (1u << 20)  /* pairs of random numbers made beforehand: 8 MB */
#define SLICE_COUNT     (1u << 18)  /* samples, or pdfs, a round */
#define BATCH_COUNT     256         /* divides SLICE_COUNT */
#define BLOCK_COUNT_MAX 1048576
#define WIDTH_MAX       65534

typedef struct bench_options {
    const char *map_path;           /* NULL: the made-up sky */
    int width, block_count;
} bench_options;

typedef struct bench_state {
    bench_options options;
    image map;
    float *numbers;                 /* NUMBER_COUNT pairs */
    float *directions;              /* SLICE_COUNT unit vectors, uniform on the sphere */
    float *row_weights;
    double checksum;
    double last_notice;             /* seconds; of the last line of progress */
} bench_state;

enum { GIVEN, DRAWN, PDF, BUILD, PASS, MEASURE_COUNT };

/* One line of a table: a sampler, how it is set, and what was measured. */
typedef struct bench_row {
    const char *name;
    const struct bench_family *family;
    int select, criterion;          /* kd; criterion NOT_SET: the default */
    void *memory;                   /* of the table */
    const void *table;
    envsamp_buffer scratch;
    size_t table_bytes;
    double times[MEASURE_COUNT][ROUND_COUNT];   /* ns an operation; BUILD: ns;
                                                   PASS: ns of the pass before it */
} bench_row;

#define NOT_SET (-1)

/* What a kind of sampler can do. Functions that return a string return NULL or what is wrong;
   a NULL member is not measured. Only build, given, drawn and pdf are timed. */
typedef struct bench_family {
    const char *(*prepare)(bench_row *row, const bench_state *bench);  /* memory */
    void (*reset)(bench_row *row);                                     /* before a build */
    const char *(*build)(bench_row *row, const bench_state *bench);    /* timed */
    void (*release)(bench_row *row);
    double (*given)(const void *table, const float *numbers, size_t count);
    double (*drawn)(const void *table, uint64_t seed, size_t count);
    double (*pdf)(const void *table, const float *directions, size_t count);
} bench_family;

/* ---- timing loops: all that is returned goes into the sum, so nothing is left out ---- */

#define ADD_SAMPLE(sum, s)                                                                  \
    ((sum) += (double)(((s).dir[0] + (s).dir[1]) + ((s).dir[2] + (s).pdf)                   \
                       + ((s).uv[0] + (s).uv[1])))

#define SAMPLE_LOOPS(kind, table_type, sample_type, sample_function)                        \
static double kind##_given(const void *table, const float *numbers, size_t count)           \
{                                                                                           \
    const table_type *typed = table;                                                        \
    double sum = 0.0;                                                                       \
    size_t i;                                                                               \
                                                                                            \
    for (i = 0; i < count; i++) {                                                           \
        sample_type s = sample_function(typed, numbers[2 * i], numbers[2 * i + 1]);         \
        ADD_SAMPLE(sum, s);                                                                 \
    }                                                                                       \
    return sum;                                                                             \
}                                                                                           \
static double kind##_drawn(const void *table, uint64_t seed, size_t count)                  \
{                                                                                           \
    const table_type *typed = table;                                                        \
    pcg32 random = pcg32_make(seed, 0);                                                     \
    double sum = 0.0;                                                                       \
    size_t i;                                                                               \
                                                                                            \
    for (i = 0; i < count; i++) {                                                           \
        float u0 = pcg32_float(&random), u1 = pcg32_float(&random);                         \
        sample_type s = sample_function(typed, u0, u1);                                     \
        ADD_SAMPLE(sum, s);                                                                 \
    }                                                                                       \
    return sum;                                                                             \
}

#define PDF_LOOP(kind, table_type, pdf_function)                                            \
static double kind##_pdf_loop(const void *table, const float *directions, size_t count)     \
{                                                                                           \
    const table_type *typed = table;                                                        \
    double sum = 0.0;                                                                       \
    size_t i;                                                                               \
                                                                                            \
    for (i = 0; i < count; i++)                                                             \
        sum += (double)pdf_function(typed, directions + 3 * i);                             \
    return sum;                                                                             \
}

/* ---- families of the library ---- */

static const char *reason(envsamp_result result)
{
    return result == ENVSAMP_OK ? NULL : envsamp_result_string(result);
}

static envsamp_image as_envsamp_image(const image *map)
{
    envsamp_image out;

    memset(&out, 0, sizeof out);
    out.pixels = map->rgb;
    out.width = map->width;
    out.height = map->height;
    out.channels = 3;
    out.mapping = ENVSAMP_LATLONG;
    return out;
}

static void *aligned_memory(size_t bytes)
{
    void *memory = NULL;

    return posix_memalign(&memory, ENVSAMP_ALIGN, bytes ? bytes : 1) == 0 ? memory : NULL;
}

static const char *library_memory(bench_row *row, envsamp_sizes sizes)
{
    row->memory = aligned_memory(sizes.table_bytes);
    row->table_bytes = sizes.table_bytes;
    row->scratch.data = aligned_memory(sizes.scratch_bytes);
    row->scratch.bytes = sizes.scratch_bytes;
    return row->memory && row->scratch.data ? NULL : "out of memory";
}

static void library_release(bench_row *row)
{
    free(row->memory);
    free(row->scratch.data);
}

/* Needs kind_desc(row, bench), which sets a description as the row asks. */
#define LIBRARY_FAMILY(kind)                                                                \
SAMPLE_LOOPS(kind, envsamp_##kind, envsamp_sample, envsamp_##kind##_sample)                 \
PDF_LOOP(kind, envsamp_##kind, envsamp_##kind##_pdf)                                        \
static const char *kind##_prepare(bench_row *row, const bench_state *bench)                 \
{                                                                                           \
    envsamp_image map = as_envsamp_image(&bench->map);                                      \
    envsamp_##kind##_desc desc = kind##_desc(row, bench);                                   \
    envsamp_sizes sizes;                                                                    \
    envsamp_result result = envsamp_##kind##_sizes(&map, &desc, &sizes);                    \
                                                                                            \
    return result == ENVSAMP_OK ? library_memory(row, sizes) : reason(result);              \
}                                                                                           \
static const char *kind##_build(bench_row *row, const bench_state *bench)                   \
{                                                                                           \
    envsamp_image map = as_envsamp_image(&bench->map);                                      \
    envsamp_##kind##_desc desc = kind##_desc(row, bench);                                   \
    envsamp_buffer buffer = { row->memory, row->table_bytes };                              \
    const envsamp_##kind *table = NULL;                                                     \
    envsamp_result result = envsamp_##kind##_build(&map, &desc, buffer, row->scratch,       \
                                                   &table);                                 \
                                                                                            \
    row->table = table;                                                                     \
    return reason(result);                                                                  \
}                                                                                           \
static const bench_family kind##_family = {                                                 \
    kind##_prepare, NULL, kind##_build, library_release, kind##_given, kind##_drawn,        \
    kind##_pdf_loop                                                                         \
};

static envsamp_kd_desc kd_desc(const bench_row *row, const bench_state *bench)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();

    desc.select = (envsamp_kd_select)row->select;
    desc.block_count = bench->options.block_count;
    if (row->criterion != NOT_SET)
        desc.criterion = (envsamp_kd_criterion)row->criterion;
    return desc;
}

LIBRARY_FAMILY(kd)

/* Direction and pdf alone, as envsamp_kd_sample_n gives them. */
static double kd_lean_batch(const envsamp_kd *kd, const float *u0, const float *u1, size_t count)
{
    float x[BATCH_COUNT], y[BATCH_COUNT], z[BATCH_COUNT], pdf[BATCH_COUNT];
    double sum = 0.0;
    size_t i;

    envsamp_kd_sample_n(kd, count, u0, u1, x, y, z, pdf);
    for (i = 0; i < count; i++)
        sum += (double)((x[i] + y[i]) + (z[i] + pdf[i]));
    return sum;
}

static double kd_lean_given(const void *table, const float *numbers, size_t count)
{
    float u0[BATCH_COUNT], u1[BATCH_COUNT];
    double sum = 0.0;
    size_t from, i;

    for (from = 0; from < count; from += BATCH_COUNT) {
        for (i = 0; i < BATCH_COUNT; i++) {
            u0[i] = numbers[2 * (from + i)];
            u1[i] = numbers[2 * (from + i) + 1];
        }
        sum += kd_lean_batch(table, u0, u1, BATCH_COUNT);
    }
    return sum;
}

static double kd_lean_drawn(const void *table, uint64_t seed, size_t count)
{
    float u0[BATCH_COUNT], u1[BATCH_COUNT];
    pcg32 random = pcg32_make(seed, 0);
    double sum = 0.0;
    size_t from, i;

    for (from = 0; from < count; from += BATCH_COUNT) {
        for (i = 0; i < BATCH_COUNT; i++) {
            u0[i] = pcg32_float(&random);
            u1[i] = pcg32_float(&random);
        }
        sum += kd_lean_batch(table, u0, u1, BATCH_COUNT);
    }
    return sum;
}

static const bench_family kd_lean_family = {
    kd_prepare, NULL, kd_build, library_release, kd_lean_given, kd_lean_drawn, NULL
};

/* ---- families of the baselines; they allocate as they build ---- */

#define BASELINE_FAMILY(kind)                                                               \
SAMPLE_LOOPS(kind, kind, baseline_sample, kind##_sample)                                    \
PDF_LOOP(kind, kind, kind##_pdf)                                                            \
static const char *kind##_prepare(bench_row *row, const bench_state *bench)                 \
{                                                                                           \
    (void)bench;                                                                            \
    row->table = row->memory = calloc(1, sizeof(kind));                                     \
    return row->memory ? NULL : "out of memory";                                            \
}                                                                                           \
static void kind##_reset(bench_row *row)                                                    \
{                                                                                           \
    kind##_destroy(row->memory);                                                            \
}                                                                                           \
static const char *kind##_build(bench_row *row, const bench_state *bench)                   \
{                                                                                           \
    const image *map = &bench->map;                                                         \
                                                                                            \
    if (!kind##_create(map->rgb, map->width, map->height, row->memory))                     \
        return "out of memory, or a black map";                                             \
    row->table_bytes = kind##_bytes(row->table);                                            \
    return NULL;                                                                            \
}                                                                                           \
static void kind##_release(bench_row *row)                                                  \
{                                                                                           \
    if (row->memory)                                                                        \
        kind##_destroy(row->memory);                                                        \
    free(row->memory);                                                                      \
}                                                                                           \
static const bench_family kind##_family = {                                                 \
    kind##_prepare, kind##_reset, kind##_build, kind##_release, kind##_given, kind##_drawn, \
    kind##_pdf_loop                                                                         \
};

BASELINE_FAMILY(baseline_cdf)
BASELINE_FAMILY(baseline_texel_alias)
BASELINE_FAMILY(baseline_row_alias)

static baseline_sample uv_only(const baseline_cdf *cdf, float u0, float u1)
{
    baseline_sample sample = baseline_random_only(0.0f, 0.0f);

    baseline_cdf_sample_uv(cdf, u0, u1, sample.uv);
    return sample;
}

SAMPLE_LOOPS(uv_only, baseline_cdf, baseline_sample, uv_only)
static const bench_family uv_only_family = {
    baseline_cdf_prepare, baseline_cdf_reset, baseline_cdf_build, baseline_cdf_release,
    uv_only_given, uv_only_drawn, NULL
};

static baseline_sample random_only(const bench_state *unused, float u0, float u1)
{
    (void)unused;
    return baseline_random_only(u0, u1);
}

SAMPLE_LOOPS(random_only, bench_state, baseline_sample, random_only)
static const bench_family random_only_family = {
    NULL, NULL, NULL, NULL, random_only_given, random_only_drawn, NULL
};

static const char *pass_prepare(bench_row *row, const bench_state *bench)
{
    size_t texels = (size_t)bench->map.width * (size_t)bench->map.height;

    row->table = row->memory = calloc(texels, sizeof(float));
    row->table_bytes = texels * sizeof(float);
    return row->memory ? NULL : "out of memory";
}

static const char *pass_build(bench_row *row, const bench_state *bench)
{
    const image *map = &bench->map;

    baseline_luminance_pass(map->rgb, map->width, map->height, bench->row_weights, row->memory);
    return NULL;
}

static void pass_release(bench_row *row)
{
    free(row->memory);
}

static const bench_family pass_family = {
    pass_prepare, NULL, pass_build, pass_release, NULL, NULL, NULL
};

/* ---- the rows ---- */

#define ROW(name, family, select, criterion) \
    { name, &family, select, criterion, NULL, NULL, { NULL, 0 }, 0, { { 0.0 } } }
#define COUNT(rows) (sizeof (rows) / sizeof (rows)[0])

#define SAMPLE_REFERENCE 1
static bench_row sample_rows[] = {
    ROW("two random numbers only", random_only_family, 0, NOT_SET),
    ROW("envsamp kd, alias", kd_family, ENVSAMP_KD_ALIAS, NOT_SET),
    ROW("envsamp kd, alias, no uv", kd_lean_family, ENVSAMP_KD_ALIAS, NOT_SET),
    ROW("envsamp kd, fit", kd_family, ENVSAMP_KD_FIT, NOT_SET),
    ROW("envsamp kd, fit, no uv", kd_lean_family, ENVSAMP_KD_FIT, NOT_SET),
    ROW("inversion, binary search", baseline_cdf_family, 0, NOT_SET),
    ROW("inversion, uv only", uv_only_family, 0, NOT_SET),
    ROW("alias table, texels", baseline_texel_alias_family, 0, NOT_SET),
    ROW("alias table, rows", baseline_row_alias_family, 0, NOT_SET)
};

#define BUILD_REFERENCE 0
static bench_row build_rows[] = {
    ROW("luminance pass", pass_family, 0, NOT_SET),
    ROW("envsamp kd, alias, SSE", kd_family, ENVSAMP_KD_ALIAS, ENVSAMP_KD_SSE),
    ROW("envsamp kd, alias, variance", kd_family, ENVSAMP_KD_ALIAS, ENVSAMP_KD_VARIANCE),
    ROW("envsamp kd, alias, range", kd_family, ENVSAMP_KD_ALIAS, ENVSAMP_KD_RANGE),
    ROW("envsamp kd, alias, excess", kd_family, ENVSAMP_KD_ALIAS, ENVSAMP_KD_EXCESS),
    ROW("envsamp kd, fit", kd_family, ENVSAMP_KD_FIT, NOT_SET),
    ROW("inversion", baseline_cdf_family, 0, NOT_SET),
    ROW("alias table, texels", baseline_texel_alias_family, 0, NOT_SET),
    ROW("alias table, rows", baseline_row_alias_family, 0, NOT_SET)
};

/* ---- measuring ---- */

static double seconds(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void fail(const char *subject, const char *what)
{
    fflush(stdout);
    fprintf(stderr, "bench: %s: %s\n", subject, what);
    exit(1);
}

static void notice(bench_state *bench, const char *phase, int done, int total)
{
    double now = seconds();

    if (now - bench->last_notice < 1.0)
        return;
    bench->last_notice = now;
    fprintf(stderr, "bench: %s, %d of %d\n", phase, done, total);
}

static double measure_given(bench_row *row, bench_state *bench, unsigned round)
{
    const float *numbers = bench->numbers + 2 * (round * SLICE_COUNT % NUMBER_COUNT);
    double start = seconds();

    bench->checksum += row->family->given(row->table, numbers, SLICE_COUNT);
    return (seconds() - start) * 1e9 / SLICE_COUNT;
}

static double measure_drawn(bench_row *row, bench_state *bench, unsigned round)
{
    double start = seconds();

    bench->checksum += row->family->drawn(row->table, round, SLICE_COUNT);
    return (seconds() - start) * 1e9 / SLICE_COUNT;
}

static double measure_pdf(bench_row *row, bench_state *bench, unsigned round)
{
    double start = seconds();

    (void)round;
    bench->checksum += row->family->pdf(row->table, bench->directions, SLICE_COUNT);
    return (seconds() - start) * 1e9 / SLICE_COUNT;
}

static double measure_build(bench_row *row, bench_state *bench, unsigned round)
{
    const char *error;
    double start;

    (void)round;
    if (row->family->reset)
        row->family->reset(row);
    start = seconds();
    error = row->family->build(row, bench);
    if (error)
        fail(row->name, error);
    return (seconds() - start) * 1e9;
}

static double measure(bench_row *row, bench_state *bench, int what, unsigned round)
{
    const bench_family *family = row->family;

    if (what == GIVEN && family->given)
        return measure_given(row, bench, round);
    if (what == DRAWN && family->drawn)
        return measure_drawn(row, bench, round);
    if (what == PDF && family->pdf)
        return measure_pdf(row, bench, round);
    if (what == BUILD && family->build)
        return measure_build(row, bench, round);
    return 0.0;
}

/* The first round warms caches and memory and is not counted. */
static void measure_rounds(bench_row *rows, size_t count, bench_state *bench, int what,
                           const char *phase)
{
    int round;
    size_t i;

    for (round = -1; round < ROUND_COUNT; round++)
        for (i = 0; i < count; i++) {
            double time = measure(&rows[i], bench, what, (unsigned)(round + 1));

            if (round >= 0)
                rows[i].times[what][round] = time;
            notice(bench, phase, round + 1, ROUND_COUNT);
        }
}

/* Builds of one row after another, each in turn with the luminance pass, so that both find the
   caches as the pair leaves them. */
static void measure_builds(bench_row *rows, size_t count, bench_state *bench)
{
    int round;
    size_t i;

    for (i = 0; i < count; i++)
        for (round = -1; round < ROUND_COUNT; round++) {
            double pass = measure(&rows[BUILD_REFERENCE], bench, BUILD, 0);
            double build = measure(&rows[i], bench, BUILD, 0);

            if (round >= 0) {
                rows[i].times[PASS][round] = pass;
                rows[i].times[BUILD][round] = build;
            }
            notice(bench, "builds, row", (int)i + 1, (int)count);
        }
}

static void prepare_rows(bench_row *rows, size_t count, bench_state *bench)
{
    const char *error;
    size_t i;

    for (i = 0; i < count; i++) {
        error = rows[i].family->prepare ? rows[i].family->prepare(&rows[i], bench) : NULL;
        if (error)
            fail(rows[i].name, error);
    }
}

static void build_all(bench_row *rows, size_t count, bench_state *bench)
{
    size_t i;

    for (i = 0; i < count; i++) {
        measure(&rows[i], bench, BUILD, 0);
        notice(bench, "building the tables", (int)i + 1, (int)count);
    }
}

static void release_rows(bench_row *rows, size_t count)
{
    size_t i;

    for (i = 0; i < count; i++)
        if (rows[i].family->release)
            rows[i].family->release(&rows[i]);
}

/* ---- reporting ---- */

static int ascending(const void *a, const void *b)
{
    double left = *(const double *)a, right = *(const double *)b;

    return (left > right) - (left < right);
}

static double median(const double *values)
{
    double sorted[ROUND_COUNT];

    memcpy(sorted, values, sizeof sorted);
    qsort(sorted, ROUND_COUNT, sizeof sorted[0], ascending);
    return sorted[ROUND_COUNT / 2];
}

static double median_ratio(const double *times, const double *reference)
{
    double ratios[ROUND_COUNT];
    int i;

    for (i = 0; i < ROUND_COUNT; i++)
        ratios[i] = times[i] / reference[i];
    return median(ratios);
}

static void print_time(const bench_row *row, const bench_row *reference, int what)
{
    if (row->times[what][0] > 0.0)
        printf(" %9.1f %7.2f", median(row->times[what]),
               median_ratio(row->times[what], reference->times[what]));
    else
        printf(" %9s %7s", "-", "-");
}

static void print_samples(const bench_state *bench)
{
    const bench_row *reference = &sample_rows[SAMPLE_REFERENCE];
    size_t i;

    printf("Sampling: direction, pdf and uv from two numbers, of an array (given) or of a\n"
           "generator (drawn); pdf of uniform directions. ns an operation, and that relative\n"
           "to \"%s\". %d blocks.\n\n", reference->name, bench->options.block_count);
    printf("%-28s %9s %7s %9s %7s %9s %7s %9s\n", "", "given ns", "ratio", "drawn ns", "ratio",
           "pdf ns", "ratio", "table kB");
    for (i = 0; i < COUNT(sample_rows); i++) {
        printf("%-28s", sample_rows[i].name);
        print_time(&sample_rows[i], reference, GIVEN);
        print_time(&sample_rows[i], reference, DRAWN);
        print_time(&sample_rows[i], reference, PDF);
        printf(" %9.0f\n", (double)sample_rows[i].table_bytes / 1000.0);
    }
}

static void print_builds(const bench_state *bench)
{
    double texels = (double)bench->map.width * bench->map.height;
    size_t i;

    printf("\nBuilding: ms, and that relative to one pass writing luminance x solid angle, timed\n"
           "before each.\n"
           "The library builds into memory given to it; the others allocate.\n\n");
    printf("%-28s %9s %7s %9s %13s\n", "", "build ms", "ratio", "table kB", "scratch B/txl");
    for (i = 0; i < COUNT(build_rows); i++) {
        const bench_row *row = &build_rows[i];

        printf("%-28s %9.2f %7.2f %9.0f", row->name, median(row->times[BUILD]) * 1e-6,
               median_ratio(row->times[BUILD], row->times[PASS]),
               (double)row->table_bytes / 1000.0);
        if (row->scratch.data)
            printf(" %13.2f\n", (double)row->scratch.bytes / texels);
        else
            printf(" %13s\n", "-");
    }
    printf("\nchecksum %.9g\n", bench->checksum);
}

static void print_cpu(void)
{
    char line[256];
    FILE *file = fopen("/proc/cpuinfo", "r");

    while (file && fgets(line, sizeof line, file))
        if (strncmp(line, "model name", 10) == 0 && strchr(line, ':')) {
            printf("cpu       %s", strchr(line, ':') + 2);
            break;
        }
    if (file)
        fclose(file);
}

static void print_setting(const bench_state *bench)
{
    print_cpu();
#if defined(__clang__)
    printf("compiler  clang %s\n", __clang_version__);
#elif defined(__GNUC__)
    printf("compiler  gcc %s\n", __VERSION__);
#endif
    printf("flags     %s\n", BENCH_FLAGS);
    printf("map       %s, %d x %d\n", bench->options.map_path,
           bench->map.width, bench->map.height);
    printf("rounds    %d of %u operations, median\n\n", ROUND_COUNT, SLICE_COUNT);
    fflush(stdout);
}

/* ---- setting up ---- */

static void fill_numbers(bench_state *bench)
{
    pcg32 random = pcg32_make(1, 1);
    size_t i;

    for (i = 0; i < 2 * (size_t)NUMBER_COUNT; i++)
        bench->numbers[i] = pcg32_float(&random);
}

static void fill_directions(bench_state *bench)
{
    size_t i;

    for (i = 0; i < SLICE_COUNT; i++) {
        float z = 1.0f - 2.0f * bench->numbers[2 * i], radius = sqrtf(1.0f - z * z);
        float phi = 6.2831853f * bench->numbers[2 * i + 1];

        bench->directions[3 * i + 0] = radius * cosf(phi);
        bench->directions[3 * i + 1] = radius * sinf(phi);
        bench->directions[3 * i + 2] = z;
    }
}

/* Enlarges a map to the width asked for, if it is narrower. Its texels vary by 5 %, as no real
   map is flat over a square of texels. */
static int enlarge(image *map, int width)
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

static void make_map(bench_state *bench)
{
    const bench_options *options = &bench->options;
    char error[512];

    if (is_made_up(options->map_path)) {
        if (!map_make(options->map_path, options->width, options->width / 2, &bench->map))
            fail(options->map_path, "the map could not be made");
    } else {
        if (!image_read(options->map_path, &bench->map, error, sizeof error)) {
            fprintf(stderr, "bench: %s\n", error);
            exit(1);
        }
        if (bench->map.width != 2 * bench->map.height)
            fail(options->map_path, "not twice as wide as high");
        if (!enlarge(&bench->map, options->width))
            fail(options->map_path, "out of memory");
    }
    notice(bench, "map made", 1, 1);
}

static void set_up(bench_state *bench)
{
    bench->last_notice = seconds();
    make_map(bench);
    bench->numbers = malloc(2 * (size_t)NUMBER_COUNT * sizeof(float));
    bench->directions = malloc(3 * (size_t)SLICE_COUNT * sizeof(float));
    bench->row_weights = malloc((size_t)bench->map.height * sizeof(float));
    if (!bench->numbers || !bench->directions || !bench->row_weights)
        fail("set-up", "out of memory");
    fill_numbers(bench);
    fill_directions(bench);
    baseline_row_weights(bench->map.width, bench->map.height, bench->row_weights);
}

static void print_help(void)
{
    printf("usage: bench [--block-count N] [--width N] [MAP]\n"
           "\n"
           "Times the samplers of envsamp.h beside other samplers.\n"
           "\n"
           "  MAP              a lat-long map in a file, or a made-up one: sky, studio, constant,\n"
           "                   night or foliage (sky)\n"
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
            fail(argv[i], "no such option; see --help");
        } else if (maps++) {
            fail(argv[i], "a second map; one is enough");
        } else {
            out.map_path = argv[i];
        }
    return out;
}

int main(int argc, char **argv)
{
    static bench_state bench;

    bench.options = parse_options(argc, argv);
    set_up(&bench);
    print_setting(&bench);

    prepare_rows(sample_rows, COUNT(sample_rows), &bench);
    build_all(sample_rows, COUNT(sample_rows), &bench);
    measure_rounds(sample_rows, COUNT(sample_rows), &bench, GIVEN, "samples, given, round");
    measure_rounds(sample_rows, COUNT(sample_rows), &bench, DRAWN, "samples, drawn, round");
    measure_rounds(sample_rows, COUNT(sample_rows), &bench, PDF, "pdfs, round");
    print_samples(&bench);
    fflush(stdout);
    release_rows(sample_rows, COUNT(sample_rows));

    prepare_rows(build_rows, COUNT(build_rows), &bench);
    measure_builds(build_rows, COUNT(build_rows), &bench);
    print_builds(&bench);
    release_rows(build_rows, COUNT(build_rows));

    free(bench.numbers);
    free(bench.directions);
    free(bench.row_weights);
    image_free(&bench.map);
    return 0;
}
