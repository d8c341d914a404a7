/* bench_batch.c: what the functions of many at a time cost when compilers may use AVX2, beside
 * inversion by binary search as scalar code of -O2 does it.
 *
 * The library is compiled in this file, with -O3 -mavx2, the baseline apart. Each contender takes
 * turns with the baseline: A, B, A, B; reported are medians over the rounds, and the median of
 * the ratios within a round. Where the machine has no AVX2 this says so and does nothing.
 */
#define _POSIX_C_SOURCE 200809L

#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#define ROUND_COUNT 15
#include "../examples/common/progress.h"
#include "baselines.h"
#include "input.h"
#include "promise.h"
#include "timing.h"

#define BATCH_COUNT 1024            /* divides SLICE_COUNT: in and out fit the first cache */

/* Inputs as arrays of one component: numbers, then directions, of SLICE_COUNT each. */
enum { U0, U1, X, Y, Z, INPUT_COUNT };

enum { WARP, ALIAS, FIT, TABLE_COUNT };

typedef struct batch_state {
    bench_input input;
    float *inputs[INPUT_COUNT];
    baseline_cdf cdf;
    void *memory[TABLE_COUNT];
    const envsamp_kd *tables[TABLE_COUNT];
    double checksum;
} batch_state;

/* ---- what is timed ---- */

/* Called through pointers that compilers cannot see through, so that all results are written. */
typedef void (*sample_n_function)(const envsamp_kd *, size_t, const float *, const float *,
                                  float *, float *, float *, float *);
typedef void (*pdf_n_function)(const envsamp_kd *, size_t, const float *, const float *,
                               const float *, float *);
static volatile sample_n_function sample_n = envsamp_kd_sample_n;
static volatile pdf_n_function pdf_n = envsamp_kd_pdf_n;

static double sample_batches(const batch_state *b, const envsamp_kd *kd)
{
    float x[BATCH_COUNT], y[BATCH_COUNT], z[BATCH_COUNT], pdf[BATCH_COUNT];
    double sum = 0.0;
    size_t i;

    for (i = 0; i < SLICE_COUNT; i += BATCH_COUNT) {
        sample_n(kd, BATCH_COUNT, b->inputs[U0] + i, b->inputs[U1] + i, x, y, z, pdf);
        sum += (double)(x[0] + y[1] + z[2] + pdf[3]);
    }
    return sum;
}

static double pdf_batches(const batch_state *b, const envsamp_kd *kd)
{
    float pdf[BATCH_COUNT];
    double sum = 0.0;
    size_t i;

    for (i = 0; i < SLICE_COUNT; i += BATCH_COUNT) {
        pdf_n(kd, BATCH_COUNT, b->inputs[X] + i, b->inputs[Y] + i, b->inputs[Z] + i, pdf);
        sum += (double)pdf[0];
    }
    return sum;
}

static double sample_inversion(const batch_state *b, const envsamp_kd *unused)
{
    double sum = 0.0;
    size_t i;

    (void)unused;
    for (i = 0; i < SLICE_COUNT; i++) {
        baseline_sample s = baseline_cdf_sample(&b->cdf, b->inputs[U0][i], b->inputs[U1][i]);

        sum += (double)((s.dir[0] + s.dir[1]) + (s.dir[2] + s.pdf));
    }
    return sum;
}

static double pdf_inversion(const batch_state *b, const envsamp_kd *unused)
{
    double sum = 0.0;
    size_t i;

    (void)unused;
    for (i = 0; i < SLICE_COUNT; i++)
        sum += (double)baseline_cdf_pdf(&b->cdf, b->input.directions + 3 * i);
    return sum;
}

typedef double (*timed_function)(const batch_state *b, const envsamp_kd *kd);

static double nanoseconds(timed_function function, batch_state *b, const envsamp_kd *kd)
{
    double start = seconds();

    b->checksum += function(b, kd);
    return (seconds() - start) * 1e9 / SLICE_COUNT;
}

/* ---- the rows ---- */

#define NOTHING 0.0

typedef struct batch_row {
    const char *name;
    int table;
    timed_function function;
    const char *reference_name;
    timed_function reference;
    double promised;                /* times as fast as the reference, or NOTHING */
} batch_row;

static const batch_row rows[] = {
    { "ALIAS sample_n", ALIAS, sample_batches, "inversion, sample", sample_inversion, 40.0 },
    { "WARP sample_n", WARP, sample_batches, "inversion, sample", sample_inversion, 20.0 },
    { "FIT sample_n", FIT, sample_batches, "inversion, sample", sample_inversion, NOTHING },
    { "ALIAS pdf_n", ALIAS, pdf_batches, "inversion, sample", sample_inversion, NOTHING },
    { "WARP pdf_n", WARP, pdf_batches, "inversion, sample", sample_inversion, NOTHING },
    { "ALIAS pdf_n", ALIAS, pdf_batches, "inversion, pdf", pdf_inversion, NOTHING },
    { "WARP pdf_n", WARP, pdf_batches, "inversion, pdf", pdf_inversion, NOTHING }
};

#define COUNT (sizeof rows / sizeof rows[0])

/* The first round warms caches and is not counted. */
static void measure(const batch_row *row, batch_state *b, progress *shown)
{
    double reference[ROUND_COUNT], times[ROUND_COUNT], ratio;
    const envsamp_kd *kd = b->tables[row->table];
    int round;

    for (round = -1; round < ROUND_COUNT; round++) {
        const double a = nanoseconds(row->reference, b, NULL);
        const double c = nanoseconds(row->function, b, kd);

        if (round >= 0) {
            reference[round] = a;
            times[round] = c;
        }
    }
    ratio = median_ratio(reference, times);
    progress_end(shown);
    printf("%-16s %8.2f   %-18s %8.1f %8.1f%s\n", row->name, median(times), row->reference_name,
           median(reference), ratio, row->promised > NOTHING
                                         ? promise(">=", row->promised, ratio >= row->promised)
                                         : "");
    fflush(stdout);
}

/* ---- setting up ---- */

static void *aligned_memory(size_t bytes)
{
    void *memory = NULL;

    if (posix_memalign(&memory, 64, bytes ? bytes : 1) != 0)
        input_fail("set-up", "out of memory");
    return memory;
}

static void build(batch_state *b, int table, envsamp_kd_select select)
{
    const envsamp_image map = { b->input.map.rgb, b->input.map.width, b->input.map.height, 3, 0,
                                ENVSAMP_LATLONG };
    envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_sizes sizes;
    envsamp_buffer buffer, scratch;
    envsamp_result result;

    desc.nearest = 1;              /* as the baseline: radiance constant over a texel */
    desc.select = select;
    desc.block_count = b->input.options.block_count;
    result = envsamp_kd_sizes(&map, &desc, &sizes);
    buffer.data = b->memory[table] = aligned_memory(buffer.bytes = sizes.table_bytes);
    scratch.data = aligned_memory(scratch.bytes = sizes.scratch_bytes);
    if (result == ENVSAMP_OK)
        result = envsamp_kd_build(&map, &desc, buffer, scratch, &b->tables[table]);
    free(scratch.data);
    if (result != ENVSAMP_OK)
        input_fail("a table", envsamp_result_string(result));
}

static void spread(batch_state *b)
{
    size_t i;
    int k;

    for (k = 0; k < INPUT_COUNT; k++)
        b->inputs[k] = aligned_memory(SLICE_COUNT * sizeof(float));
    for (i = 0; i < SLICE_COUNT; i++) {
        b->inputs[U0][i] = b->input.numbers[2 * i];
        b->inputs[U1][i] = b->input.numbers[2 * i + 1];
        for (k = 0; k < 3; k++)
            b->inputs[X + k][i] = b->input.directions[3 * i + (size_t)k];
    }
}

static void set_up(int argc, char **argv, batch_state *b)
{
    const image *map = &b->input.map;

    input_create(argc, argv, &b->input);
    spread(b);
    build(b, WARP, ENVSAMP_KD_WARP);
    build(b, ALIAS, ENVSAMP_KD_ALIAS);
    build(b, FIT, ENVSAMP_KD_FIT);
    if (!baseline_cdf_create(map->rgb, map->width, map->height, &b->cdf))
        input_fail("inversion", "out of memory, or a black map");
}

static void tear_down(batch_state *b)
{
    int k;

    baseline_cdf_destroy(&b->cdf);
    for (k = 0; k < TABLE_COUNT; k++)
        free(b->memory[k]);
    for (k = 0; k < INPUT_COUNT; k++)
        free(b->inputs[k]);
    input_destroy(&b->input);
}

static void run(int argc, char **argv)
{
    static batch_state state;
    progress shown;
    size_t i;

    set_up(argc, argv, &state);
    print_compiler(BENCH_FLAGS "; inversion -O2");
    printf("map       %s, %d x %d, %d blocks\n", state.input.options.map_path,
           state.input.map.width, state.input.map.height, state.input.options.block_count);
    printf("rounds    %d of %u operations, in batches of %d, median\n\n", ROUND_COUNT,
           SLICE_COUNT, BATCH_COUNT);
    printf("%-16s %8s   %-18s %8s %8s%s\n", "Many at a time", "ns", "one at a time", "ns",
           "ratio", promise_heading());
    shown = progress_start("bench_batch");
    for (i = 0; i < COUNT; i++) {
        progress_show(&shown, (double)i / COUNT, rows[i].name);
        measure(&rows[i], &state, &shown);
    }
    printf("\nchecksum %.9g\n", state.checksum);
    tear_down(&state);
}

static int has_avx2(void)
{
#if defined(__AVX2__)
    return __builtin_cpu_supports("avx2") != 0;
#else
    return 0;
#endif
}

int main(int argc, char **argv)
{
    printf("\n");
    if (has_avx2())
        run(argc, argv);
    else
        printf("bench_batch: skipped, as this machine or this build has no AVX2\n");
    return 0;
}
