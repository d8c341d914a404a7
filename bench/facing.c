/* facing.c: what light x cosine gains and costs: error of diffuse irradiance over all maps, and
 * times, beside light alone and multiple importance sampling.
 *
 *     facing_table [--width N] [--block-count N] [MAP]
 *
 * Tables on stdout, progress on stderr; one or two minutes. MAP is for the times alone: see bench.
 *
 * Errors: RMS relative error over 64 normals and 16 sets of numbers, then the geometric mean over
 * maps. Lookups and tables are bilinear; exact irradiance is a sum over parts of texels. Numbers
 * are others for every normal. MIS: half of the samples from the surface, by the cosine, weighed by
 * the power heuristic. Hidden: a third of 6 x 12 equal patches of the sphere, the same for all,
 * lets no light through.
 */
#define _POSIX_C_SOURCE 200809L
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "../examples/common/irradiance.h"
#include "baselines.h"
#include "input.h"
#include "map_set.h"
#include "promise.h"

#define ROUND_COUNT 15
#include "timing.h"

#define COUNTS 3
#define SEEDS 16
#define PATCH_ROWS 6
#define PATCH_COLUMNS 12
#define PATCHES (PATCH_ROWS * PATCH_COLUMNS)
#define TIMED 65536                 /* samples or densities a round */
#define BATCH 256                   /* divides TIMED, as the next */
#define SMALL_BATCH 16              /* what a renderer has for one point */

static const int counts[COUNTS] = { 16, 64, 128 };

enum { LIGHT, LIGHT_MIS, FACING, FACING_MIS, WAYS };
enum { SOBOL, INDEPENDENT, NUMBERS };
enum { OPEN, HIDDEN, VIEWS };

static const char *const way_names[WAYS] = { "light only", "MIS light + cosine", "facing",
                                             "facing with MIS" };
static const char *const number_names[NUMBERS] = { "Owen-Sobol", "independent" };
static const char *const view_names[VIEWS] = { "", ", a third hidden" };

typedef double errors[VIEWS][NUMBERS][COUNTS][WAYS];

typedef struct subject {
    image map;
    envsamp_image view;
    bench_table table;
    irradiance exact[VIEWS];
} subject;

/* ---- what is hidden ---- */

static int patch_of(const float dir[3])
{
    float uv[2];
    int row, column;

    envsamp_dir_to_uv(ENVSAMP_LATLONG, dir, uv);
    row = (int)((1.0f - dir[2]) * (0.5f * PATCH_ROWS));
    column = (int)(uv[0] * PATCH_COLUMNS);
    row = row < 0 ? 0 : row < PATCH_ROWS ? row : PATCH_ROWS - 1;
    return row * PATCH_COLUMNS + (column < PATCH_COLUMNS ? column : PATCH_COLUMNS - 1);
}

/* The third of all patches with the lowest hashes. */
static int is_hidden(const float dir[3])
{
    static unsigned char hidden[PATCHES];
    static int made;
    int i, k;

    for (i = 0; i < PATCHES && !made; i++) {
        int lower = 0;

        for (k = 0; k < PATCHES; k++)
            lower += hash_u32((uint32_t)k + 1) < hash_u32((uint32_t)i + 1);
        hidden[i] = lower < PATCHES / 3;
    }
    made = 1;
    return hidden[patch_of(dir)];
}

/* ---- irradiance ---- */

/* Of the interpolated map: its texels are split, as irradiance_make does. */
static void make_exact(subject *s)
{
    const int split = 1 + (IRRADIANCE_ROWS - 1) / s->map.height;
    const int columns = s->map.width * split, rows = s->map.height * split;
    float *across = bench_allocate((size_t)columns * IRRADIANCE_NORMALS * sizeof *across);
    float *light = bench_allocate((size_t)columns * VIEWS * sizeof *light);
    int view, x, y;

    for (view = 0; view < VIEWS; view++) {
        memset(&s->exact[view], 0, sizeof s->exact[view]);
        irradiance_normals(&s->exact[view]);
    }
    irradiance_across(&s->exact[OPEN], columns, across);
    for (y = 0; y < rows; y++) {
        const float sr = texel_sr(columns, rows, y), v = ((float)y + 0.5f) / (float)rows;

        for (x = 0; x < columns; x++) {
            float dir[3], rgb[3];

            envsamp_uv_to_dir(ENVSAMP_LATLONG, ((float)x + 0.5f) / (float)columns, v, dir);
            envsamp_lookup(&s->view, 0, dir, rgb);
            light[x] = sr * envsamp_luminance(rgb);
            light[columns + x] = is_hidden(dir) ? 0.0f : light[x];
        }
        for (view = 0; view < VIEWS; view++)
            irradiance_add_row(&s->exact[view], light + view * columns, across, columns,
                               LIGHT_PI * v);
    }
    free(across);
    free(light);
}

static void make_numbers(int numbers, uint32_t i, uint32_t seed, float u[2])
{
    if (numbers == SOBOL) {
        sobol_owen(i, seed, u);
    } else {
        pcg32 random = pcg32_make(seed, i);

        u[0] = pcg32_float(&random);
        u[1] = pcg32_float(&random);
    }
}

/* Irradiance of a normal, with nothing hidden and with a third. */
static void estimate(const subject *s, int way, int numbers, uint32_t count, const float normal[3],
                     uint32_t seed, double sums[VIEWS])
{
    const int facing = way == FACING || way == FACING_MIS, mis = way & 1;
    const uint32_t from_cosine = mis ? count / 2 : 0, from_light = count - from_cosine;
    const envsamp_kd *kd = s->table.kd;
    uint32_t i;

    sums[OPEN] = sums[HIDDEN] = 0.0;
    for (i = 0; i < count; i++) {
        const int by_cosine = i >= from_light;
        float u[2], dir[3], rgb[3], cosine, pdf, weight;

        make_numbers(numbers, by_cosine ? i - from_light : i,
                     hash_combine(seed, (uint32_t)by_cosine), u);
        if (by_cosine) {
            draw_lobe(normal, 1.0f, u, dir);
            pdf = facing ? envsamp_kd_pdf_facing(kd, normal, dir) : envsamp_kd_pdf(kd, dir);
        } else {
            const envsamp_sample from = facing ? envsamp_kd_sample_facing(kd, normal, u[0], u[1])
                                               : envsamp_kd_sample(kd, u[0], u[1]);

            memcpy(dir, from.dir, sizeof dir);
            pdf = from.pdf;
        }
        cosine = dot3(normal, dir);
        if (!(cosine > 0.0f))
            continue;
        envsamp_lookup(&s->view, 0, dir, rgb);
        if (by_cosine)
            weight = envsamp_mis_power(cosine / LIGHT_PI, pdf) * LIGHT_PI / (float)from_cosine;
        else
            weight = (mis ? envsamp_mis_power(pdf, cosine / LIGHT_PI) : 1.0f) * cosine
                   / (pdf * (float)from_light);
        weight *= envsamp_luminance(rgb);
        sums[OPEN] += (double)weight;
        sums[HIDDEN] += is_hidden(dir) ? 0.0 : (double)weight;
    }
}

/* Root mean squares over normals that see light, and seeds. */
static void measure(const subject *s, int way, int numbers, int count, double rmse[VIEWS])
{
    double squares[VIEWS] = { 0.0 }, lit[VIEWS] = { 0.0 }, sums[VIEWS];
    uint32_t seed;
    int k, view;

    for (seed = 0; seed < SEEDS; seed++)
        for (k = 0; k < IRRADIANCE_NORMALS; k++) {
            estimate(s, way, numbers, (uint32_t)count, s->exact[OPEN].normals[k],
                     hash_combine(seed, (uint32_t)k), sums);
            for (view = 0; view < VIEWS; view++)
                if (s->exact[view].exact[k] > 0.0) {
                    const double error = sums[view] / s->exact[view].exact[k] - 1.0;

                    squares[view] += error * error;
                    lit[view] += 1.0;
                }
        }
    for (view = 0; view < VIEWS; view++)
        rmse[view] = sqrt(squares[view] / lit[view]);
}

static void measure_map(const subject *s, errors out)
{
    int numbers, m, way, view;

    for (numbers = 0; numbers < NUMBERS; numbers++)
        for (m = 0; m < COUNTS; m++)
            for (way = 0; way < WAYS; way++) {
                double rmse[VIEWS];

                measure(s, way, numbers, counts[m], rmse);
                for (view = 0; view < VIEWS; view++)
                    out[view][numbers][m][way] = rmse[view];
            }
}

/* ---- times, of this thread alone ---- */

static double cpu_ns(void)
{
    struct timespec now;

    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return 1e9 * (double)now.tv_sec + (double)now.tv_nsec;
}

static double least(const double times[ROUND_COUNT])
{
    double smallest = times[0];
    int i;

    for (i = 1; i < ROUND_COUNT; i++)
        smallest = times[i] < smallest ? times[i] : smallest;
    return smallest;
}

static envsamp_kd_desc facing_desc(int facing, int block_count)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();

    desc.facing = facing;
    desc.block_count = block_count;
    return desc;
}

/* Least times of a build with and without, in ns, the tables of which stay. */
static void time_builds(const image *map, int block_count, int rounds, bench_table tables[2],
                        double ns[2])
{
    const envsamp_image view = bench_view(map);
    int round, with;

    for (round = 0; round < rounds; round++)
        for (with = 0; with < 2; with++) {
            bench_table *f = &tables[with];
            const envsamp_kd_desc desc = facing_desc(with, block_count);
            double start;

            if (!round && !bench_table_build(f, &view, &desc))
                input_fail("build", envsamp_result_string(f->result));
            start = cpu_ns();
            envsamp_kd_build(&view, &desc, f->memory, f->scratch, &f->kd);
            start = cpu_ns() - start;
            ns[with] = round && ns[with] < start ? ns[with] : start;
        }
}

enum { SAMPLE, SAMPLE_FACING, SAMPLE_N, SAMPLE_FACING_N, PDF, PDF_FACING, PDF_N, PDF_FACING_N,
       SAMPLE_SMALL, SAMPLE_FACING_SMALL, INVERSION, OPERATIONS };

static const char *const operation_names[OPERATIONS] = {
    "sample", "sample_facing", "sample_n", "sample_facing_n", "pdf", "pdf_facing", "pdf_n",
    "pdf_facing_n", "sample_n, of 16", "sample_facing_n, of 16",
    "inversion of a CDF by binary search"
};

typedef struct timed {
    const envsamp_kd *kd;
    baseline_cdf cdf;
    float normals[IRRADIANCE_NORMALS][3];
    float u[2][TIMED], dir[3][TIMED];
} timed;

/* One at a time; all that is returned is added up. The normal is another for every call. */
static float run_single(const timed *t, int what)
{
    float sum = 0.0f;
    int i;

    for (i = 0; i < TIMED; i++) {
        const float *normal = t->normals[i % IRRADIANCE_NORMALS];
        const float dir[3] = { t->dir[0][i], t->dir[1][i], t->dir[2][i] };

        if (what == PDF) {
            sum += envsamp_kd_pdf(t->kd, dir);
        } else if (what == PDF_FACING) {
            sum += envsamp_kd_pdf_facing(t->kd, normal, dir);
        } else if (what == INVERSION) {
            const baseline_sample s = baseline_cdf_sample(&t->cdf, t->u[0][i], t->u[1][i]);

            sum += s.dir[0] + s.dir[1] + s.dir[2] + s.pdf + s.uv[0] + s.uv[1];
        } else {
            const envsamp_sample s = what == SAMPLE
                ? envsamp_kd_sample(t->kd, t->u[0][i], t->u[1][i])
                : envsamp_kd_sample_facing(t->kd, normal, t->u[0][i], t->u[1][i]);

            sum += s.dir[0] + s.dir[1] + s.dir[2] + s.pdf + s.uv[0] + s.uv[1];
        }
    }
    return sum;
}

/* In batches, another normal for each. */
static float run_batches(const timed *t, int what, int size)
{
    const int sampled = what != PDF_N && what != PDF_FACING_N;
    float x[BATCH], y[BATCH], z[BATCH], pdf[BATCH], sum = 0.0f;
    int i, k;

    for (i = 0; i < TIMED; i += size) {
        const float *normal = t->normals[i / size % IRRADIANCE_NORMALS];
        const float *const u[2] = { t->u[0] + i, t->u[1] + i };
        const float *const dir[3] = { t->dir[0] + i, t->dir[1] + i, t->dir[2] + i };
        const size_t n = (size_t)size;

        if (what == SAMPLE_N || what == SAMPLE_SMALL)
            envsamp_kd_sample_n(t->kd, n, u[0], u[1], x, y, z, pdf);
        else if (sampled)
            envsamp_kd_sample_facing_n(t->kd, normal, n, u[0], u[1], x, y, z, pdf);
        else if (what == PDF_N)
            envsamp_kd_pdf_n(t->kd, n, dir[0], dir[1], dir[2], pdf);
        else
            envsamp_kd_pdf_facing_n(t->kd, normal, n, dir[0], dir[1], dir[2], pdf);
        for (k = 0; k < size; k++)
            sum += pdf[k] + (sampled ? x[k] + y[k] + z[k] : 0.0f);
    }
    return sum;
}

static int batch_of(int what)
{
    if (what == SAMPLE_SMALL || what == SAMPLE_FACING_SMALL)
        return SMALL_BATCH;
    return what == SAMPLE_N || what == SAMPLE_FACING_N || what == PDF_N || what == PDF_FACING_N
         ? BATCH : 1;
}

/* Numbers are fresh in every round, as the caches of inversion find them in a renderer. */
static void time_operations(timed *t, const bench_input *input, double ns[OPERATIONS])
{
    static double times[OPERATIONS][ROUND_COUNT];
    volatile float sink = 0.0f;
    int round, what, i, c;

    for (round = 0; round < ROUND_COUNT; round++) {
        for (i = 0; i < TIMED; i++) {
            const size_t at = (size_t)round * TIMED + (size_t)i;

            for (c = 0; c < 2; c++)
                t->u[c][i] = input->numbers[2 * (at % NUMBER_COUNT) + (size_t)c];
            for (c = 0; c < 3; c++)
                t->dir[c][i] = input->directions[3 * (at % SLICE_COUNT) + (size_t)c];
        }
        for (what = 0; what < OPERATIONS; what++) {
            const int size = batch_of(what);
            const double start = cpu_ns();

            sink += size > 1 ? run_batches(t, what, size) : run_single(t, what);
            times[what][round] = (cpu_ns() - start) / TIMED;
        }
    }
    (void)sink;
    for (what = 0; what < OPERATIONS; what++)
        ns[what] = least(times[what]);
}

/* ---- reports ---- */

static double mean_of(errors *all, int maps, int view, int numbers, int m, int way)
{
    double sum = 0.0;
    int i;

    for (i = 0; i < maps; i++)
        sum += log(all[i][view][numbers][m][way]);
    return exp(sum / maps);
}

static void print_errors(errors *all, int maps)
{
    int view, numbers, m, way;

    printf("| samples |");
    for (way = 0; way < WAYS; way++)
        printf(" %s |", way_names[way]);
    printf(" facing / light |\n|---|---|---|---|---|---|\n");
    for (view = 0; view < VIEWS; view++)
        for (numbers = 0; numbers < NUMBERS; numbers++)
            for (m = 0; m < COUNTS; m++) {
                printf("| %d, %s%s |", counts[m], number_names[numbers], view_names[view]);
                for (way = 0; way < WAYS; way++)
                    printf(" %.4f |", mean_of(all, maps, view, numbers, m, way));
                printf(" %.2f |\n", mean_of(all, maps, view, numbers, m, FACING)
                                    / mean_of(all, maps, view, numbers, m, LIGHT));
            }
}

static void print_ratio(const char *name, double ratio, double promised)
{
    printf("%-56s %6.3f%s\n", name, ratio, promise("<=", promised, ratio <= promised));
}

/* The worst row of the table, and on how many maps facing is behind. */
static void print_error_ratios(errors *all, int maps)
{
    double worst = 0.0;
    int view, numbers, m, i, behind = 0;

    for (view = 0; view < VIEWS; view++)
        for (numbers = 0; numbers < NUMBERS; numbers++)
            for (m = 0; m < COUNTS; m++) {
                worst = fmax(worst, mean_of(all, maps, view, numbers, m, FACING)
                                    / mean_of(all, maps, view, numbers, m, LIGHT_MIS));
                for (i = 0; i < maps; i++) {
                    const double *rmse = all[i][view][numbers][m];

                    behind += rmse[FACING] > fmin(rmse[LIGHT], rmse[LIGHT_MIS]);
                }
            }
    printf("\n");
    print_ratio("facing / light only, 16 Owen-Sobol points",
                  mean_of(all, maps, OPEN, SOBOL, 0, FACING)
                  / mean_of(all, maps, OPEN, SOBOL, 0, LIGHT), 0.30);
    print_ratio("facing / light only, 64", mean_of(all, maps, OPEN, SOBOL, 1, FACING)
                                             / mean_of(all, maps, OPEN, SOBOL, 1, LIGHT), 0.35);
    print_ratio("facing / MIS light + cosine, the worst row", worst, 1.0);
    printf("behind the best of light only and MIS in %d of %d rows of single maps\n\n", behind,
           maps * VIEWS * NUMBERS * COUNTS);
}

static void print_times(const double ns[OPERATIONS], const double build[2],
                        const bench_table tables[2])
{
    const double bytes = (double)envsamp_kd_bytes(tables[1].kd);
    int what;

    for (what = 0; what < OPERATIONS; what++)
        printf("%-36s %8.1f ns\n", operation_names[what], ns[what]);
    printf("%-36s %8.2f ms, without %.2f\n", "build with facing", 1e-6 * build[1], 1e-6 * build[0]);
    printf("%-36s %8.0f bytes, without %.0f\n\n", "table with facing", bytes,
           (double)envsamp_kd_bytes(tables[0].kd));
    print_ratio("sample_facing / sample", ns[SAMPLE_FACING] / ns[SAMPLE], 4.0);
    print_ratio("sample_facing / inversion", ns[SAMPLE_FACING] / ns[INVERSION], 1.0);
    print_ratio("sample_facing_n / sample", ns[SAMPLE_FACING_N] / ns[SAMPLE], 2.5);
    print_ratio("pdf_facing / pdf", ns[PDF_FACING] / ns[PDF], 3.0);
    print_ratio("build, with / without", build[1] / build[0], 1.1);
    print_ratio("table, KiB", bytes / 1024.0, 330.0);
}

static void report_times(const bench_input *input)
{
    static timed t;
    bench_table tables[2];
    irradiance e;
    double ns[OPERATIONS], build[2];

    time_builds(&input->map, input->options.block_count, ROUND_COUNT / 2, tables, build);
    irradiance_normals(&e);
    memcpy(t.normals, e.normals, sizeof t.normals);
    t.kd = tables[1].kd;
    if (!baseline_cdf_create(input->map.rgb, input->map.width, input->map.height, &t.cdf))
        input_fail("inversion", "out of memory");
    time_operations(&t, input, ns);
    printf("Times: %s, %d x %d, CPU time, the least of %d rounds; normals change with every call,\n"
           "of _n with every %d or %d\n\n", input->options.map_path, input->map.width,
           input->map.height, ROUND_COUNT, BATCH, SMALL_BATCH);
    print_times(ns, build, tables);
    baseline_cdf_destroy(&t.cdf);
    bench_table_free(&tables[0]);
    bench_table_free(&tables[1]);
}

static void report_errors(void)
{
    static errors all[MAP_SET_MAX];
    static subject s;
    map_set set = map_set_find("facing");
    double log_build = 0.0, build[2];
    bench_table tables[2];
    int i;

    for (i = 0; i < set.count; i++) {
        if (!map_set_load(&set, i, &s.map))
            exit(EXIT_FAILURE);
        image_clean(&s.map);
        s.view = bench_view(&s.map);
        time_builds(&s.map, 0, 3, tables, build);
        log_build += log(build[1] / build[0]) / set.count;
        s.table = tables[1];
        make_exact(&s);
        measure_map(&s, all[i]);
        bench_table_free(&tables[0]);
        bench_table_free(&tables[1]);
        image_free(&s.map);
    }
    map_set_done(&set);
    printf("RMS relative error of irradiance of 64 normals, geometric mean of %d %s maps, 6144\n"
           "blocks, bilinear\n\n", set.count, map_set_kind(&set));
    print_errors(all, set.count);
    print_error_ratios(all, set.count);
    print_ratio("build of these maps, with / without", exp(log_build), 1.1);
    printf("\n");
    fflush(stdout);
}

int main(int argc, char **argv)
{
    static bench_input input;

    input_create(argc, argv, &input);
    print_cpu();
    print_compiler(BENCH_FLAGS);
    printf("\n");
    report_errors();
    report_times(&input);
    input_destroy(&input);
    return 0;
}
