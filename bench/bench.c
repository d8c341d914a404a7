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

#define ROUND_COUNT 9
#include "../examples/common/progress.h"
#include "../examples/common/random.h"
#include "baselines.h"
#include "input.h"
#include "promise.h"
#include "timing.h"
#include "warp_walk.h"

#define BATCH_COUNT 256             /* divides SLICE_COUNT */

typedef struct bench_state {
    bench_input input;
    float *row_weights;
    double checksum;
    progress shown;
} bench_state;

enum { GIVEN, DRAWN, PDF, INVERT, BUILD, PASS, MEASURE_COUNT };

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
   a NULL member is not measured. Only build, given, drawn, pdf and invert are timed. */
typedef struct bench_family {
    const char *(*prepare)(bench_row *row, const bench_state *bench);  /* memory */
    void (*reset)(bench_row *row);                                     /* before a build */
    const char *(*build)(bench_row *row, const bench_state *bench);    /* timed */
    void (*release)(bench_row *row);
    double (*given)(const void *table, const float *numbers, size_t count);
    double (*drawn)(const void *table, uint64_t seed, size_t count);
    double (*pdf)(const void *table, const float *directions, size_t count);
    double (*invert)(const void *table, const float *directions, size_t count);
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
    const envsamp_image out = { map->rgb, map->width, map->height, 3, 0, ENVSAMP_LATLONG };

    return out;
}

static void *aligned_memory(size_t bytes)
{
    void *memory = NULL;

    return posix_memalign(&memory, 64, bytes ? bytes : 1) == 0 ? memory : NULL;
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
    envsamp_image map = as_envsamp_image(&bench->input.map);                                      \
    envsamp_##kind##_desc desc = kind##_desc(row, bench);                                   \
    envsamp_sizes sizes;                                                                    \
    envsamp_result result = envsamp_##kind##_sizes(&map, &desc, &sizes);                    \
                                                                                            \
    return result == ENVSAMP_OK ? library_memory(row, sizes) : reason(result);              \
}                                                                                           \
static const char *kind##_build(bench_row *row, const bench_state *bench)                   \
{                                                                                           \
    envsamp_image map = as_envsamp_image(&bench->input.map);                                      \
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
    kind##_pdf_loop, NULL                                                                   \
};

static envsamp_kd_desc kd_desc(const bench_row *row, const bench_state *bench)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();

    desc.nearest = 1;              /* as the others: radiance constant over a texel */
    desc.select = (envsamp_kd_select)row->select;
    desc.block_count = bench->input.options.block_count;
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

/* envsamp_kd_pdf_n, with directions copied into its arrays. */
static double kd_lean_pdf(const void *table, const float *directions, size_t count)
{
    float x[BATCH_COUNT], y[BATCH_COUNT], z[BATCH_COUNT];
    double sum = 0.0;
    size_t from, i;

    for (from = 0; from < count; from += BATCH_COUNT) {
        for (i = 0; i < BATCH_COUNT; i++) {
            x[i] = directions[3 * (from + i)];
            y[i] = directions[3 * (from + i) + 1];
            z[i] = directions[3 * (from + i) + 2];
        }
        envsamp_kd_pdf_n(table, BATCH_COUNT, x, y, z, x);
        for (i = 0; i < BATCH_COUNT; i++)
            sum += (double)x[i];
    }
    return sum;
}

static const bench_family kd_lean_family = {
    kd_prepare, NULL, kd_build, library_release, kd_lean_given, kd_lean_drawn,
    kd_lean_pdf, NULL
};

static double kd_invert_loop(const void *table, const float *directions, size_t count)
{
    double sum = 0.0;
    size_t i;

    for (i = 0; i < count; i++) {
        float u[2];

        envsamp_kd_invert(table, directions + 3 * i, u);
        sum += (double)(u[0] + u[1]);
    }
    return sum;
}

static const bench_family kd_warp_family = {
    kd_prepare, NULL, kd_build, library_release, kd_given, kd_drawn, kd_pdf_loop, kd_invert_loop
};

static envsamp_cdf_desc cdf_desc(const bench_row *row, const bench_state *bench)
{
    envsamp_cdf_desc desc = envsamp_cdf_defaults();

    (void)row;
    (void)bench;
    desc.nearest = 1;              /* as the others */
    return desc;
}

LIBRARY_FAMILY(cdf)

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
    const image *map = &bench->input.map;                                                         \
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
    kind##_pdf_loop, NULL                                                                   \
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
    uv_only_given, uv_only_drawn, NULL, NULL
};

static baseline_sample random_only(const bench_state *unused, float u0, float u1)
{
    (void)unused;
    return baseline_random_only(u0, u1);
}

SAMPLE_LOOPS(random_only, bench_state, baseline_sample, random_only)
static const bench_family random_only_family = {
    NULL, NULL, NULL, NULL, random_only_given, random_only_drawn, NULL, NULL
};

static const char *pass_prepare(bench_row *row, const bench_state *bench)
{
    size_t texels = (size_t)bench->input.map.width * (size_t)bench->input.map.height;

    row->table = row->memory = calloc(texels, sizeof(float));
    row->table_bytes = texels * sizeof(float);
    return row->memory ? NULL : "out of memory";
}

static const char *pass_build(bench_row *row, const bench_state *bench)
{
    const image *map = &bench->input.map;

    baseline_luminance_pass(map->rgb, map->width, map->height, bench->row_weights, row->memory);
    return NULL;
}

static void pass_release(bench_row *row)
{
    free(row->memory);
}

static const bench_family pass_family = {
    pass_prepare, NULL, pass_build, pass_release, NULL, NULL, NULL, NULL
};

/* ---- the rows ---- */

#define ROW(name, family, select, criterion) \
    { name, &family, select, criterion, NULL, NULL, { NULL, 0 }, 0, { { 0.0 } } }
#define COUNT(rows) (sizeof (rows) / sizeof (rows)[0])

enum { ONLY, WARP, WARP_LEAN, ALIAS, ALIAS_LEAN, FIT, FIT_LEAN, CDF, INVERSION };

#define SAMPLE_REFERENCE ALIAS
static bench_row sample_rows[] = {
    ROW("two random numbers only", random_only_family, 0, NOT_SET),
    ROW("envsamp kd, warp", kd_warp_family, ENVSAMP_KD_WARP, NOT_SET),
    ROW("envsamp kd, warp, _n", kd_lean_family, ENVSAMP_KD_WARP, NOT_SET),
    ROW("envsamp kd, alias", kd_family, ENVSAMP_KD_ALIAS, NOT_SET),
    ROW("envsamp kd, alias, _n", kd_lean_family, ENVSAMP_KD_ALIAS, NOT_SET),
    ROW("envsamp kd, fit", kd_family, ENVSAMP_KD_FIT, NOT_SET),
    ROW("envsamp kd, fit, _n", kd_lean_family, ENVSAMP_KD_FIT, NOT_SET),
    ROW("envsamp cdf", cdf_family, 0, NOT_SET),
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
    ROW("envsamp kd, warp", kd_family, ENVSAMP_KD_WARP, NOT_SET),
    ROW("envsamp cdf", cdf_family, 0, NOT_SET),
    ROW("inversion", baseline_cdf_family, 0, NOT_SET),
    ROW("alias table, texels", baseline_texel_alias_family, 0, NOT_SET),
    ROW("alias table, rows", baseline_row_alias_family, 0, NOT_SET)
};

/* ---- cdf: its guides beside a binary search of its own edges ---- */

/* std::upper_bound over the edges: the index i with edges[i] <= draw < edges[i + 1]. */
static uint32_t search(const uint32_t *edges, uint32_t count, uint32_t draw)
{
    const uint32_t *first = edges + 1;
    uint32_t left = count;

    while (left > 0) {
        uint32_t half = left / 2;

        if (draw < first[half]) {
            left = half;
        } else {
            first += half + 1;
            left -= half + 1;
        }
    }
    return (uint32_t)(first - edges) - 1;
}

/* As envsamp_cdf_sample, but inlined: without what the caller does not use. */
static inline envsamp_sample guided_draw(const envsamp_cdf *cdf, float u0, float u1)
{
    uint32_t across = envsamp__draw(u0), down = envsamp__draw(u1);
    float pdf;
    envsamp__point p = envsamp__cdf_point(cdf, envsamp__cdf_find_row(cdf, down), down, across,
                                          &pdf);

    return envsamp__point_sample(cdf->mapping, p, pdf);
}

/* The same but for how row and column are found. */
static envsamp_sample searched_draw(const envsamp_cdf *cdf, float u0, float u1)
{
    uint32_t across = envsamp__draw(u0), down = envsamp__draw(u1);
    const uint32_t *rows = ENVSAMP__ARRAY(uint32_t, cdf, row_edges), *edges;
    const envsamp__cdf_row *row = ENVSAMP__ARRAY(envsamp__cdf_row, cdf, rows);
    float fx, fy, x0, x1;
    envsamp__cdf_texel at;
    envsamp__point p;
    envsamp_sample s;

    at.row = search(rows, cdf->height, down);
    edges = ENVSAMP__CDF_EDGES(ENVSAMP__ARRAY, cdf, at.row);
    at.column = search(edges, cdf->width, across);
    at.valid = 1;
    row += at.row;
    rows += at.row;
    edges += at.column;
    fx = ((float)(int)(across - edges[0]) + 0.5f) / (float)(int)(edges[1] - edges[0]);
    fy = ((float)(int)(down - rows[0]) + 0.5f) / (float)(int)(rows[1] - rows[0]);
    x0 = fmaxf((float)(int)at.column - cdf->offset, 0.0f);
    x1 = fminf((float)(int)at.column - cdf->offset + 1.0f, (float)(int)cdf->image_width);
    p.x = (x0 + fx * (x1 - x0)) * cdf->inverse_width;
    p.north = row[0].top.north + fy * (row[1].top.north - row[0].top.north);
    p.south = row[0].top.south + fy * (row[1].top.south - row[0].top.south);
    s.pdf = envsamp__cdf_density(cdf, at);
    s.uv[0] = p.x = envsamp__clamp_unit(p.x);
    s.uv[1] = envsamp__polar_fraction(p.north, p.south);
    envsamp__point_dir(p, ENVSAMP_SQRTF(p.north * p.south), &s.dir[0], &s.dir[1], &s.dir[2]);
    return s;
}

#define INVERSION_COUNT (1u << 22)  /* points a round: each round warms the caches by itself */

#define INVERSION_LOOP(name, function, result)                                              \
static double name(const envsamp_cdf *cdf, uint64_t seed)                                   \
{                                                                                           \
    pcg32 random = pcg32_make(seed, 0);                                                     \
    double sum = 0.0;                                                                       \
    size_t i;                                                                               \
                                                                                            \
    for (i = 0; i < INVERSION_COUNT; i++) {                                                 \
        float u0 = pcg32_float(&random), u1 = pcg32_float(&random);                         \
        envsamp_sample s = function(cdf, u0, u1);                                           \
                                                                                            \
        sum += (double)(result);                                                            \
    }                                                                                       \
    return sum;                                                                             \
}

#define UV (s.uv[0] + s.uv[1])
#define DIR_PDF ((s.dir[0] + s.dir[1]) + (s.dir[2] + s.pdf))
INVERSION_LOOP(searched_uv, searched_draw, UV)
INVERSION_LOOP(guided_uv, guided_draw, UV)
INVERSION_LOOP(searched_dir, searched_draw, DIR_PDF)
INVERSION_LOOP(guided_dir, guided_draw, DIR_PDF)

static double guided_n(const envsamp_cdf *cdf, uint64_t seed)
{
    float u0[BATCH_COUNT], u1[BATCH_COUNT], x[BATCH_COUNT], y[BATCH_COUNT], z[BATCH_COUNT];
    float pdf[BATCH_COUNT];
    pcg32 random = pcg32_make(seed, 0);
    double sum = 0.0;
    size_t from, i;

    for (from = 0; from < INVERSION_COUNT; from += BATCH_COUNT) {
        for (i = 0; i < BATCH_COUNT; i++) {
            u0[i] = pcg32_float(&random);
            u1[i] = pcg32_float(&random);
        }
        envsamp_cdf_sample_n(cdf, BATCH_COUNT, u0, u1, x, y, z, pdf);
        for (i = 0; i < BATCH_COUNT; i++)
            sum += (double)((x[i] + y[i]) + (z[i] + pdf[i]));
    }
    return sum;
}

enum { SEARCHED_UV, GUIDED_UV, SEARCHED_DIR, GUIDED_DIR, GUIDED_N, INVERSION_KINDS };
static double (*const inversion_loops[INVERSION_KINDS])(const envsamp_cdf *, uint64_t) = {
    searched_uv, guided_uv, searched_dir, guided_dir, guided_n
};
static double inversion_times[INVERSION_KINDS][ROUND_COUNT];     /* ns */

/* What one and the other draw must be the same: their sums are. */
static void measure_inversion(const envsamp_cdf *cdf)
{
    int round, i;

    for (round = 0; round < ROUND_COUNT; round++) {
        double sums[INVERSION_KINDS];

        for (i = 0; i < INVERSION_KINDS; i++) {
            double start = seconds();

            sums[i] = inversion_loops[i](cdf, (uint64_t)round);
            inversion_times[i][round] = (seconds() - start) * 1e9 / INVERSION_COUNT;
        }
        if (memcmp(&sums[SEARCHED_UV], &sums[GUIDED_UV], sizeof *sums)
            || memcmp(&sums[SEARCHED_DIR], &sums[GUIDED_DIR], sizeof *sums)
            || memcmp(&sums[SEARCHED_DIR], &sums[GUIDED_N], sizeof *sums))
            input_fail("cdf", "guided and searched samples differ");
    }
}

/* ---- measuring ---- */

static double measure_given(bench_row *row, bench_state *bench, unsigned round)
{
    const float *numbers = bench->input.numbers + 2 * (round * SLICE_COUNT % NUMBER_COUNT);
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

static double measure_pdf(bench_row *row, bench_state *bench)
{
    double start = seconds();

    bench->checksum += row->family->pdf(row->table, bench->input.directions, SLICE_COUNT);
    return (seconds() - start) * 1e9 / SLICE_COUNT;
}

static double measure_invert(bench_row *row, bench_state *bench)
{
    double start = seconds();

    bench->checksum += row->family->invert(row->table, bench->input.directions, SLICE_COUNT);
    return (seconds() - start) * 1e9 / SLICE_COUNT;
}

static double measure_build(bench_row *row, bench_state *bench)
{
    const char *error;
    double start;

    if (row->family->reset)
        row->family->reset(row);
    start = seconds();
    error = row->family->build(row, bench);
    if (error)
        input_fail(row->name, error);
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
        return measure_pdf(row, bench);
    if (what == INVERT && family->invert)
        return measure_invert(row, bench);
    if (what == BUILD && family->build)
        return measure_build(row, bench);
    return 0.0;
}

/* The first round warms caches and memory and is not counted. A round measures everything, so
   that the ratio of a pdf to a sample is one of neighbours too. */
static void measure_rounds(bench_row *rows, size_t count, bench_state *bench)
{
    const double all = (double)((ROUND_COUNT + 1) * count);
    int round, what;
    size_t i;

    bench->shown = progress_start("bench");
    for (round = -1; round < ROUND_COUNT; round++)
        for (i = 0; i < count; i++) {
            progress_show(&bench->shown, ((double)(round + 1) * (double)count + (double)i) / all,
                          "samples and pdfs");
            for (what = GIVEN; what <= INVERT; what++) {
                double time = measure(&rows[i], bench, what, (unsigned)(round + 1));

                if (round >= 0)
                    rows[i].times[what][round] = time;
            }
        }
    progress_end(&bench->shown);
}

/* Builds of one row after another, each in turn with the luminance pass, so that both find the
   caches as the pair leaves them. */
static void measure_builds(bench_row *rows, size_t count, bench_state *bench)
{
    int round;
    size_t i;

    bench->shown = progress_start("bench");
    for (i = 0; i < count; i++)
        for (round = -1; round < ROUND_COUNT; round++) {
            double pass = measure(&rows[BUILD_REFERENCE], bench, BUILD, 0);
            double build = measure(&rows[i], bench, BUILD, 0);

            if (round >= 0) {
                rows[i].times[PASS][round] = pass;
                rows[i].times[BUILD][round] = build;
            }
            progress_show(&bench->shown, ((double)i + (round + 1.0) / ROUND_COUNT)
                                         / ((double)count + 1.0), rows[i].name);
        }
    progress_end(&bench->shown);
}

static void prepare_rows(bench_row *rows, size_t count, bench_state *bench)
{
    const char *error;
    size_t i;

    for (i = 0; i < count; i++) {
        error = rows[i].family->prepare ? rows[i].family->prepare(&rows[i], bench) : NULL;
        if (error)
            input_fail(rows[i].name, error);
    }
}

static void build_all(bench_row *rows, size_t count, bench_state *bench)
{
    size_t i;

    for (i = 0; i < count; i++) {
        measure(&rows[i], bench, BUILD, 0);
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
           "generator (drawn); pdf, and the numbers, of uniform directions. _n: in batches of %d,\n"
           "without uv. ns an operation, and that relative to \"%s\". %d blocks.\n\n",
           BATCH_COUNT, reference->name, bench->input.options.block_count);
    printf("%-24s %9s %7s %9s %7s %9s %7s %9s %9s\n", "", "given ns", "ratio", "drawn ns",
           "ratio", "pdf ns", "ratio", "invert ns", "table kB");
    for (i = 0; i < COUNT(sample_rows); i++) {
        printf("%-24s", sample_rows[i].name);
        print_time(&sample_rows[i], reference, GIVEN);
        print_time(&sample_rows[i], reference, DRAWN);
        print_time(&sample_rows[i], reference, PDF);
        if (sample_rows[i].times[INVERT][0] > 0.0)
            printf(" %9.1f", median(sample_rows[i].times[INVERT]));
        else
            printf(" %9s", "-");
        printf(" %9.0f\n", (double)sample_rows[i].table_bytes / 1000.0);
    }
}

static void print_ratio(const char *name, const double *times, const double *reference,
                        const char *relation, double promised)
{
    const double ratio = median_ratio(times, reference);
    const int kept = relation[0] == '<' ? ratio <= promised : ratio >= promised;

    printf("%-44s %7.2f%s\n", name, ratio, promise(relation, promised, kept));
}

static void print_ratios(void)
{
    const bench_row *warp = &sample_rows[WARP], *alias = &sample_rows[ALIAS];
    const bench_row *inversion = &sample_rows[INVERSION];
    const envsamp_kd *kd = warp->table;
    const warp_cuts cuts = warp_count_cuts(kd);

    printf("\nWARP: %u tiles, %.2f cuts below a tile expected, %d at most; table %lu bytes\n",
           (unsigned)warp_tile_count(kd), cuts.expected, cuts.deepest,
           (unsigned long)envsamp_kd_bytes(kd));
    printf("\n%-44s %7s%s\n", "Of times, given numbers, one at a time", "ratio",
           promise_heading());
    print_ratio("sample: WARP / ALIAS", warp->times[GIVEN], alias->times[GIVEN], "<=", 2.5);
    print_ratio("sample: inversion / WARP", inversion->times[GIVEN], warp->times[GIVEN], ">=", 6.0);
    print_ratio("sample: inversion / WARP, no uv (_n)", inversion->times[GIVEN],
                sample_rows[WARP_LEAN].times[GIVEN], ">=", 6.0);
    print_ratio("pdf of WARP / sample of ALIAS", warp->times[PDF], alias->times[GIVEN],
                "<=", 2.0);
    print_ratio("pdf of ALIAS / sample of ALIAS", alias->times[PDF], alias->times[GIVEN],
                "<=", 2.0);
    print_ratio("pdf_n of ALIAS / sample of ALIAS", sample_rows[ALIAS_LEAN].times[PDF],
                alias->times[GIVEN], "<=", 2.0);
}

static void print_inversion(void)
{
    static const char *const names[INVERSION_KINDS] = {
        "uv, binary search", "uv, guided", "direction, pdf: search", "direction, pdf: guided",
        "direction, pdf: _n"
    };
    int i;

    printf("\ncdf, its guides beside a binary search of its edges: ns a sample of %u fresh ones\n",
           INVERSION_COUNT);
    for (i = 0; i < INVERSION_KINDS; i++)
        printf("%-24s %9.1f\n", names[i], median(inversion_times[i]));
    print_ratio("uv: search / guided", inversion_times[SEARCHED_UV],
                inversion_times[GUIDED_UV], ">=", 4.0);
    print_ratio("direction, pdf: search / _n", inversion_times[SEARCHED_DIR],
                inversion_times[GUIDED_N], ">=", 4.0);
}

static void print_builds(const bench_state *bench)
{
    double texels = (double)bench->input.map.width * bench->input.map.height;
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

static void print_setting(const bench_state *bench)
{
    print_cpu();
    print_compiler(BENCH_FLAGS);
    printf("map       %s, %d x %d\n", bench->input.options.map_path,
           bench->input.map.width, bench->input.map.height);
    printf("rounds    %d of %u operations, median\n\n", ROUND_COUNT, SLICE_COUNT);
    fflush(stdout);
}

int main(int argc, char **argv)
{
    static bench_state bench;

    input_create(argc, argv, &bench.input);
    bench.row_weights = malloc((size_t)bench.input.map.height * sizeof(float));
    if (!bench.row_weights)
        input_fail("set-up", "out of memory");
    baseline_row_weights(bench.input.map.width, bench.input.map.height, bench.row_weights);
    print_setting(&bench);

    prepare_rows(sample_rows, COUNT(sample_rows), &bench);
    build_all(sample_rows, COUNT(sample_rows), &bench);
    measure_rounds(sample_rows, COUNT(sample_rows), &bench);
    print_samples(&bench);
    print_ratios();
    measure_inversion(sample_rows[CDF].table);
    print_inversion();
    fflush(stdout);
    release_rows(sample_rows, COUNT(sample_rows));

    prepare_rows(build_rows, COUNT(build_rows), &bench);
    measure_builds(build_rows, COUNT(build_rows), &bench);
    print_builds(&bench);
    release_rows(build_rows, COUNT(build_rows));

    free(bench.row_weights);
    input_destroy(&bench.input);
    return 0;
}
