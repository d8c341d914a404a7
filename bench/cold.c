/* cold.c: what a sample and a pdf cost in a renderer, whose rays evict the table between two groups
 * of calls, and how many cache lines of the table a call reads.
 *
 * Between two groups of GROUP_SIZE calls 8 MB of other memory are read. Contenders take turns, one
 * group of each; reported is the median over the groups. The baselines are compiled apart, the
 * library in this file, as a user has it.
 */
#define _POSIX_C_SOURCE 200809L

#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#define ROUND_COUNT 1001            /* groups */
#include "../examples/common/progress.h"
#include "baselines.h"
#include "input.h"
#include "timing.h"
#include "warp_walk.h"

#define GROUP_SIZE  4
#define EVICT_BYTES ((size_t)8 << 20)
#define LINE        64u
#define WALK_COUNT  4096            /* calls whose lines are counted */

enum { SAMPLE, PDF, KINDS };

typedef struct cold_row {
    const char *name;
    int select, block_count;        /* select: of kd, or one of the next two */
    void *memory;
    const void *table;
    double times[KINDS][ROUND_COUNT];   /* ns a call */
} cold_row;

enum { CDF = 100, INVERSION };

static cold_row rows[] = {
    { "warp", ENVSAMP_KD_WARP, 6144, NULL, NULL, { { 0.0 } } },
    { "warp", ENVSAMP_KD_WARP, 16384, NULL, NULL, { { 0.0 } } },
    { "alias", ENVSAMP_KD_ALIAS, 6144, NULL, NULL, { { 0.0 } } },
    { "alias", ENVSAMP_KD_ALIAS, 16384, NULL, NULL, { { 0.0 } } },
    { "fit", ENVSAMP_KD_FIT, 6144, NULL, NULL, { { 0.0 } } },
    { "fit", ENVSAMP_KD_FIT, 16384, NULL, NULL, { { 0.0 } } },
    { "cdf", CDF, 0, NULL, NULL, { { 0.0 } } },
    { "inversion", INVERSION, 0, NULL, NULL, { { 0.0 } } }
};
#define ROWS (sizeof rows / sizeof rows[0])

static volatile double kept;        /* so that no call is left out */

/* ---- tables ---- */

static void *aligned_memory(size_t bytes)
{
    void *memory = NULL;

    if (posix_memalign(&memory, LINE, bytes ? bytes : 1))
        input_fail("set-up", "out of memory");
    return memory;
}

static void build(cold_row *row, const image *map)
{
    envsamp_image texels;
    envsamp_kd_desc kd = envsamp_kd_defaults();
    envsamp_cdf_desc cdf = envsamp_cdf_defaults();
    envsamp_sizes sizes = { 0, 0 };
    envsamp_buffer table, scratch;
    const envsamp_kd *built_kd = NULL;
    const envsamp_cdf *built_cdf = NULL;

    memset(&texels, 0, sizeof texels);
    texels.pixels = map->rgb;
    texels.width = map->width;
    texels.height = map->height;
    texels.channels = 3;
    kd.select = (envsamp_kd_select)row->select;
    kd.block_count = row->block_count;
    if (row->select == INVERSION) {
        row->table = row->memory = aligned_memory(sizeof(baseline_cdf));
        if (!baseline_cdf_create(map->rgb, map->width, map->height, row->memory))
            input_fail(row->name, "out of memory, or a black map");
        return;
    }
    if (row->select == CDF)
        envsamp_cdf_sizes(&texels, &cdf, &sizes);
    else
        envsamp_kd_sizes(&texels, &kd, &sizes);
    table.data = row->memory = aligned_memory(sizes.table_bytes);
    table.bytes = sizes.table_bytes;
    scratch.data = aligned_memory(sizes.scratch_bytes);
    scratch.bytes = sizes.scratch_bytes;
    if (row->select == CDF)
        envsamp_cdf_build(&texels, &cdf, table, scratch, &built_cdf);
    else
        envsamp_kd_build(&texels, &kd, table, scratch, &built_kd);
    row->table = row->select == CDF ? (const void *)built_cdf : built_kd;
    free(scratch.data);
    if (!row->table)
        input_fail(row->name, "the build failed");
}

static void release(cold_row *row)
{
    if (row->select == INVERSION)
        baseline_cdf_destroy(row->memory);
    free(row->memory);
}

/* ---- time ---- */

static void evict(const char *other)
{
    int sum = 0;
    size_t at;

    for (at = 0; at < EVICT_BYTES; at += LINE)
        sum += other[at];
    kept += sum;
}

#define SAMPLE_GROUP(name, type, result, function)                                          \
static double name(const void *table, const float (*group)[3])                              \
{                                                                                           \
    double sum = 0.0;                                                                       \
    int i;                                                                                  \
                                                                                            \
    for (i = 0; i < GROUP_SIZE; i++) {                                                      \
        result s = function((const type *)table, group[i][0], group[i][1]);                 \
                                                                                            \
        sum += (double)((s.dir[0] + s.dir[1]) + (s.dir[2] + s.pdf) + (s.uv[0] + s.uv[1]));  \
    }                                                                                       \
    return sum;                                                                             \
}

#define PDF_GROUP(name, type, function)                                                     \
static double name(const void *table, const float (*group)[3])                              \
{                                                                                           \
    double sum = 0.0;                                                                       \
    int i;                                                                                  \
                                                                                            \
    for (i = 0; i < GROUP_SIZE; i++)                                                        \
        sum += (double)function((const type *)table, group[i]);                             \
    return sum;                                                                             \
}

SAMPLE_GROUP(kd_samples, envsamp_kd, envsamp_sample, envsamp_kd_sample)
SAMPLE_GROUP(cdf_samples, envsamp_cdf, envsamp_sample, envsamp_cdf_sample)
SAMPLE_GROUP(baseline_samples, baseline_cdf, baseline_sample, baseline_cdf_sample)
PDF_GROUP(kd_pdfs, envsamp_kd, envsamp_kd_pdf)
PDF_GROUP(cdf_pdfs, envsamp_cdf, envsamp_cdf_pdf)
PDF_GROUP(baseline_pdfs, baseline_cdf, baseline_cdf_pdf)

static double no_calls(const void *table, const float (*group)[3])
{
    (void)table;
    return (double)group[0][0];
}

typedef double (*group_function)(const void *table, const float (*group)[3]);

static group_function function_of(const cold_row *row, int kind)
{
    if (row->select == CDF)
        return kind == SAMPLE ? cdf_samples : cdf_pdfs;
    if (row->select == INVERSION)
        return kind == SAMPLE ? baseline_samples : baseline_pdfs;
    return kind == SAMPLE ? kd_samples : kd_pdfs;
}

/* ns a group. The numbers are copied before the table is evicted. */
static double time_group(group_function function, const void *table, const bench_input *input,
                         int kind, int round, const char *other)
{
    float group[GROUP_SIZE][3];
    double start, end, sum;
    int i;

    for (i = 0; i < GROUP_SIZE; i++) {
        const size_t at = (size_t)(round * GROUP_SIZE + i);

        if (kind == SAMPLE)
            memcpy(group[i], input->numbers + 2 * at, 2 * sizeof(float));
        else
            memcpy(group[i], input->directions + 3 * at, 3 * sizeof(float));
    }
    evict(other);
    start = seconds();
    start = seconds();                  /* the first call brings the clock into the cache */
    sum = function(table, (const float (*)[3])group);
    end = seconds();
    kept += sum;
    return (end - start) * 1e9;
}

static void measure(const bench_input *input)
{
    static double empty[ROUND_COUNT];
    char *other = aligned_memory(EVICT_BYTES);
    progress shown = progress_start("cold");
    double nothing;
    int round, kind;
    size_t i;

    memset(other, 1, EVICT_BYTES);
    for (round = 0; round < ROUND_COUNT; round++) {
        progress_show(&shown, (double)round / ROUND_COUNT, "rounds");
        empty[round] = time_group(no_calls, NULL, input, SAMPLE, round, other);
        for (i = 0; i < ROWS; i++)
            for (kind = SAMPLE; kind < KINDS; kind++)
                rows[i].times[kind][round] = time_group(function_of(&rows[i], kind),
                                                        rows[i].table, input, kind, round, other);
    }
    progress_end(&shown);
    nothing = median(empty);
    for (i = 0; i < ROWS; i++)
        for (kind = SAMPLE; kind < KINDS; kind++)
            for (round = 0; round < ROUND_COUNT; round++)
                rows[i].times[kind][round] = (rows[i].times[kind][round] - nothing) / GROUP_SIZE;
    free(other);
}

/* ---- cache lines ---- */

/* Lines of a table that a call has read. */
typedef struct line_set { size_t line[128]; int count; } line_set;

static void touch(line_set *set, const envsamp_kd *kd, const void *at, size_t bytes)
{
    const size_t first = (size_t)((const char *)at - (const char *)kd);
    size_t line;
    int i;

    for (line = first / LINE; line <= (first + bytes - 1) / LINE; line++) {
        for (i = 0; i < set->count && set->line[i] != line; i++)
            continue;
        if (i == set->count && i < 128)
            set->line[set->count++] = line;
    }
}

#define TOUCH(field) touch(&set, kd, &kd->field, sizeof kd->field)

static int sample_lines(const envsamp_kd *kd, const float u[2])
{
    line_set set = { { 0 }, 0 };
    envsamp__choice choice;
    uint32_t bits;

    TOUCH(select);
    TOUCH(mapping);
    if (kd->select == ENVSAMP_KD_WARP) {
        const void *read[64];
        size_t bytes[64];
        int count = warp_reads(kd, u, read, bytes), i;

        TOUCH(tile_bits_x);
        TOUCH(tile_bits_y);
        for (i = 0; i < count; i++)
            touch(&set, kd, read[i], bytes[i]);
        return set.count;
    }
    if (kd->select == ENVSAMP_KD_ALIAS) {
        TOUCH(alias_shift);
        TOUCH(alias_at);
        bits = 24 - kd->alias_shift;
        choice = envsamp__alias_choose(kd, u[0], u[1]);
        touch(&set, kd, ENVSAMP__ARRAY(uint32_t, kd, alias)
                        + ((uint32_t)(u[1] * (float)(1 << (bits / 2))) << (bits - bits / 2))
                        + (uint32_t)(u[0] * (float)(1 << (bits - bits / 2))), 4);
    } else {
        TOUCH(model);
        TOUCH(fit_alpha);
        TOUCH(fit_end);
        TOUCH(fit_total);
        choice = envsamp__fit_choose(kd, u[0], u[1]);
    }
    touch(&set, kd, ENVSAMP__RECORDS(kd) + choice.block,
          sizeof(envsamp__record));
    return set.count;
}

static int pdf_lines(const envsamp_kd *kd, const float dir[3])
{
    line_set set = { { 0 }, 0 };
    envsamp__l1_coords d = envsamp__dir_to_grid(kd->mapping, dir[0], dir[1], dir[2],
                                                ENVSAMP_SQRTF(dir[0] * dir[0] + dir[1] * dir[1]));
    const float across = (float)(1 << kd->grid_bits_x), down = (float)(1 << kd->grid_bits_y);
    const uint32_t *cell = ENVSAMP__ARRAY(uint32_t, kd, grid)
        + ((size_t)envsamp__index(d.polar * 0.5f * down, 1u << kd->grid_bits_y)
           << kd->grid_bits_x)
        + envsamp__index(d.azimuth * 0.25f * across, 1u << kd->grid_bits_x);
    uint64_t place;
    uint32_t link = envsamp__grid_link(kd, d, &place);

    TOUCH(mapping);
    TOUCH(grid_bits_x);
    TOUCH(grid_bits_y);
    TOUCH(grid_at);
    touch(&set, kd, cell, sizeof *cell);
    while (link & ENVSAMP__INNER) {
        touch(&set, kd, ENVSAMP__LINKED(envsamp__pdf_node, kd, link), sizeof(envsamp__pdf_node));
        link = envsamp__node_step(kd, link, place);
    }
    return set.count;
}

static double mean_lines(const cold_row *row, const bench_input *input, int kind)
{
    double sum = 0.0;
    size_t i;

    for (i = 0; i < WALK_COUNT; i++)
        sum += kind == SAMPLE ? sample_lines(row->table, input->numbers + 2 * i)
                              : pdf_lines(row->table, input->directions + 3 * i);
    return sum / WALK_COUNT;
}

/* ---- reporting ---- */

static void print_row(const cold_row *row, const cold_row *inversion, const bench_input *input)
{
    char name[32];
    int kind;

    snprintf(name, sizeof name, row->block_count ? "%s, %d" : "%s", row->name, row->block_count);
    printf("%-24s", name);
    for (kind = SAMPLE; kind < KINDS; kind++) {
        printf(" %9.1f %7.2f", median(row->times[kind]),
               median(inversion->times[kind]) / median(row->times[kind]));
        if (row->block_count)
            printf(" %6.2f", mean_lines(row, input, kind));
        else
            printf(" %6s", "-");
    }
    printf(" %9.0f\n", row->block_count ? (double)envsamp_kd_bytes(row->table) / 1000.0
                     : row->select == CDF ? (double)envsamp_cdf_bytes(row->table) / 1000.0
                     : (double)baseline_cdf_bytes(row->table) / 1000.0);
}

int main(int argc, char **argv)
{
    static bench_input input;
    size_t i;

    input_create(argc, argv, &input);
    for (i = 0; i < ROWS; i++)
        build(&rows[i], &input.map);
    print_cpu();
    print_compiler(BENCH_FLAGS);
    printf("map       %s, %d x %d, bilinear\n\n", input.options.map_path, input.map.width,
           input.map.height);
    measure(&input);
    printf("Evicted: 8 MB read between groups of %d calls; ns a call, how often faster than\n"
           "inversion, and cache lines of the table that a call reads. Median of %d groups.\n\n",
           GROUP_SIZE, ROUND_COUNT);
    printf("%-24s %9s %7s %6s %9s %7s %6s %9s\n", "", "sample ns", "faster", "lines", "pdf ns",
           "faster", "lines", "table kB");
    for (i = 0; i < ROWS; i++)
        print_row(&rows[i], &rows[ROWS - 1], &input);
    for (i = 0; i < ROWS; i++)
        release(&rows[i]);
    input_destroy(&input);
    return 0;
}
