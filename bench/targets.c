/* targets.c: how many blocks the maps need for a target of excess variance, and what that takes.
 *
 *     targets    tables on stdout; a minute
 *
 * Median, least and most over all maps, as they are and enlarged to 2048 by 1024, and how many maps
 * came to the limit of blocks. Time is that of this process, of one build each.
 */
#define _POSIX_C_SOURCE 200809L
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#define ROUND_COUNT 1
#include "map_set.h"
#include "input.h"
#include "timing.h"

#define WIDTH 2048
#define LIMIT 65536             /* blocks, where there is a target; 6144 where there is none */

enum { BLOCKS, EXCESS, KILOBYTES, MILLISECONDS, FIGURES };

static const char *const select_names[] = { "WARP", "ALIAS" };
static const float targets[] = { 0.0f, 0.02f, 0.01f, 0.005f, 0.002f };

#define TARGETS ((int)(sizeof targets / sizeof targets[0]))

static double figures[2][2][TARGETS][FIGURES][MAP_SET_MAX];     /* [large][select] */

static void fail(const char *what)
{
    fprintf(stderr, "targets: %s\n", what);
    exit(1);
}

static double cpu_seconds(void)
{
    struct timespec now;

    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static envsamp_buffer get(size_t bytes)
{
    envsamp_buffer buffer = { bench_allocate(bytes), bytes };

    memset(buffer.data, 0x3c, bytes);   /* so that no page is got for the first time in a build */
    return buffer;
}

static void measure(const image *map, int large, int select, int target, int index)
{
    double (*out)[MAP_SET_MAX] = figures[large][select][target];
    const envsamp_image view = bench_view(map);
    envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_buffer table, scratch;
    envsamp_sizes sizes;
    envsamp_kd_info info;
    const envsamp_kd *kd;
    double start;

    desc.select = (envsamp_kd_select)select;
    desc.excess_target = targets[target];
    desc.block_count = target > 0 ? LIMIT : 0;
    if (envsamp_kd_sizes(&view, &desc, &sizes) != ENVSAMP_OK)
        fail("sizes");
    table = get(sizes.table_bytes);
    scratch = get(sizes.scratch_bytes);
    start = cpu_seconds();
    if (envsamp_kd_build(&view, &desc, table, scratch, &kd) != ENVSAMP_OK)
        fail("a build");
    out[MILLISECONDS][index] = 1e3 * (cpu_seconds() - start);
    envsamp_kd_get_info(kd, &info);
    out[BLOCKS][index] = (double)info.block_count;
    out[EXCESS][index] = info.excess_variance;
    out[KILOBYTES][index] = (double)envsamp_kd_bytes(kd) / 1024.0;
    free(table.data);
    free(scratch.data);
}

static void measure_all(const image *map, int large, int index)
{
    int select, target;

    for (select = 0; select < 2; select++)
        for (target = 0; target < TARGETS; target++)
            measure(map, large, select, target, index);
}

/* Maps that have as many blocks as the limit. */
static int count_limited(const double *blocks, int count)
{
    int i, limited = 0;

    for (i = 0; i < count; i++)
        limited += blocks[i] >= (double)LIMIT;
    return limited;
}

/* Median, least and most; sorts the values. */
static void print_figure(double *values, int count, int width, int digits)
{
    qsort(values, (size_t)count, sizeof *values, ascending);
    printf(" %*.*f%*.*f%*.*f", width, digits, 0.5 * (values[(count - 1) / 2] + values[count / 2]),
           width, digits, values[0], width, digits, values[count - 1]);
}

static void print_table(int large, int select, int count)
{
    static const int widths[FIGURES] = { 7, 7, 6, 7 }, digits[FIGURES] = { 0, 4, 0, 0 };
    int target, figure;

    printf("\n%-6s%9s%13s%22s%19s%22s limit\n", select_names[select],
           large ? "2048x1024" : "512x256", "blocks", "excess variance", "KB", "ms");
    for (target = 0; target < TARGETS; target++) {
        if (target > 0)
            printf("%-6.3g", (double)targets[target]);
        else
            printf("%-6s", "none");
        for (figure = 0; figure < FIGURES; figure++)
            print_figure(figures[large][select][target][figure], count, widths[figure],
                         digits[figure]);
        printf("%6d\n", count_limited(figures[large][select][target][BLOCKS], count));
    }
}

int main(void)
{
    map_set set = map_set_find("targets");
    image map;
    int i;

    print_cpu();
    print_compiler(BENCH_FLAGS);
    printf("maps      %d, %s, bilinear; median, least and most\n", set.count, map_set_kind(&set));
    for (i = 0; i < set.count; i++) {
        if (!map_set_load(&set, i, &map))
            return 1;
        measure_all(&map, 0, i);
        if (!input_enlarge(&map, WIDTH))
            fail("out of memory");
        measure_all(&map, 1, i);
        image_free(&map);
    }
    map_set_done(&set);
    for (i = 0; i < 4; i++)
        print_table(i / 2, i % 2, set.count);
    return 0;
}
