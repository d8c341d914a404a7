/* builds.c: what builds take and give, over all maps, of one version of the library or of two.
 *
 *     builds     tables on stdout; some minutes
 *
 * The maps are enlarged to 2048 by 1024. Time is in luminance passes, each map's own, and in builds
 * of a plain float CDF, of the same rounds. With WITH_BEFORE an older version is measured too, in
 * turns with this one: make builds HEADER=old/envsamp.h.
 */
#define _POSIX_C_SOURCE 200809L
#define ROUND_COUNT 7
#include "../envsamp.h"
#include "map_set.h"

#include "baselines.h"
#include "builds.h"
#include "input.h"
#include "timing.h"

#define WIDTH 2048
#define HEIGHT (WIDTH / 2)
#define VERSIONS_MAX 2

static const char *const kind_names[BUILD_KINDS] = { "WARP", "ALIAS", "cdf" };

static const builds_version *const versions[] = {
#ifdef WITH_BEFORE
    &builds_before,
#endif
    &builds_now
};
#define VERSIONS ((int)(sizeof versions / sizeof versions[0]))

/* Of every map. */
static double passes[VERSIONS_MAX][BUILD_KINDS][MAP_SET_MAX];
static double plain[VERSIONS_MAX][BUILD_KINDS][MAP_SET_MAX];
static double small_ms[VERSIONS_MAX][MAP_SET_MAX];
static double excess[VERSIONS_MAX][2][BUILD_KINDS][MAP_SET_MAX];
static size_t scratch_bytes[VERSIONS_MAX][BUILD_KINDS];

static void fail(const char *what)
{
    fprintf(stderr, "builds: %s\n", what);
    exit(1);
}

static void *get(size_t bytes)
{
    void *data = malloc(bytes ? bytes : 1);

    if (!data)
        fail("out of memory");
    memset(data, 0, bytes);     /* so that no page is got for the first time in a build */
    return data;
}

static build prepare(const builds_version *version, int kind, int block_count, const image *map)
{
    build b;

    memset(&b, 0, sizeof b);
    b.kind = kind;
    b.block_count = block_count;
    b.rgb = map->rgb;
    b.width = map->width;
    b.height = map->height;
    if (!version->sizes(&b))
        fail("sizes");
    b.table = get(b.table_bytes);
    b.scratch = get(b.scratch_bytes);
    return b;
}

/* Time of this process alone: a build is long enough to be interrupted, a luminance pass is not. */
static double cpu_seconds(void)
{
    struct timespec now;

    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static double run(const builds_version *version, build *b)
{
    const double start = cpu_seconds();

    if (!version->run(b))
        fail("a build");
    return cpu_seconds() - start;
}

static void release(build *b)
{
    free(b->table);
    free(b->scratch);
}

static void time_map(const image *map, int index)
{
    static float importance[WIDTH * HEIGHT], weights[HEIGHT];
    double luminance[ROUND_COUNT], cdf[ROUND_COUNT], time[VERSIONS_MAX][BUILD_KINDS][ROUND_COUNT];
    build b[VERSIONS_MAX][BUILD_KINDS];
    int round, v, kind;

    baseline_row_weights(WIDTH, HEIGHT, weights);
    for (v = 0; v < VERSIONS; v++)
        for (kind = 0; kind < BUILD_KINDS; kind++) {
            b[v][kind] = prepare(versions[v], kind, 6144, map);
            scratch_bytes[v][kind] = b[v][kind].scratch_bytes;
        }
    for (round = 0; round < ROUND_COUNT; round++) {
        baseline_cdf table;
        double start = cpu_seconds();

        baseline_luminance_pass(map->rgb, WIDTH, HEIGHT, weights, importance);
        luminance[round] = cpu_seconds() - start;
        start = cpu_seconds();
        if (!baseline_cdf_create(map->rgb, WIDTH, HEIGHT, &table))
            fail("a plain CDF");
        cdf[round] = cpu_seconds() - start;
        baseline_cdf_destroy(&table);
        for (kind = 0; kind < BUILD_KINDS; kind++)
            for (v = 0; v < VERSIONS; v++)
                time[v][kind][round] = run(versions[v], &b[v][kind]);
    }
    for (v = 0; v < VERSIONS; v++)
        for (kind = 0; kind < BUILD_KINDS; kind++) {
            passes[v][kind][index] = median(time[v][kind]) / median(luminance);
            plain[v][kind][index] = median_ratio(time[v][kind], cdf);
            excess[v][0][kind][index] = b[v][kind].excess;
            release(&b[v][kind]);
            b[v][kind] = prepare(versions[v], kind, 16384, map);
            run(versions[v], &b[v][kind]);
            excess[v][1][kind][index] = b[v][kind].excess;
            release(&b[v][kind]);
        }
}

/* The map as it is, not enlarged. */
static void time_small(const image *map, int index)
{
    double time[ROUND_COUNT];
    int v, round;

    for (v = 0; v < VERSIONS; v++) {
        build b = prepare(versions[v], BUILD_WARP, 6144, map);

        for (round = 0; round < ROUND_COUNT; round++)
            time[round] = 1e3 * run(versions[v], &b);
        small_ms[v][index] = median(time);
        release(&b);
    }
}

/* The middle and the largest of the values of all maps. */
static double middle(const double *values, int count)
{
    double sorted[MAP_SET_MAX];

    memcpy(sorted, values, (size_t)count * sizeof *values);
    qsort(sorted, (size_t)count, sizeof *sorted, ascending);
    return 0.5 * (sorted[(count - 1) / 2] + sorted[count / 2]);
}

static double worst(const double *values, int count)
{
    double most = values[0];
    int i;

    for (i = 1; i < count; i++)
        most = values[i] > most ? values[i] : most;
    return most;
}

static void print_pair(const char *name, const char *what, const double *before,
                       const double *now, double (*of)(const double *, int), int count)
{
    printf("%-6s %-34s", name, what);
    if (VERSIONS == 2)
        printf("%10.4g", of(before, count));
    printf("%10.4g\n", of(now, count));
}

static void print_all(int count)
{
    const int now = VERSIONS - 1;
    int kind, k, i;

    printf("%-41s%s%10s\n", "", VERSIONS == 2 ? "    before" : "", "now");
    for (kind = 0; kind < BUILD_KINDS; kind++) {
        const char *name = kind_names[kind];

        print_pair(name, "luminance passes, median", passes[0][kind], passes[now][kind], middle,
                   count);
        print_pair(name, "luminance passes, worst", passes[0][kind], passes[now][kind], worst,
                   count);
        print_pair(name, "plain CDF builds, median", plain[0][kind], plain[now][kind], middle,
                   count);
        printf("%-6s %-34s", name, "scratch, bytes a texel");
        for (i = 0; i < VERSIONS; i++)
            printf("%10.4g", (double)scratch_bytes[i][kind] / (double)(WIDTH * HEIGHT));
        printf("\n");
        for (k = 0; k < 2; k++) {
            print_pair(name, k ? "excess variance, 16384, median" : "excess variance, 6144, median",
                       excess[0][k][kind], excess[now][k][kind], middle, count);
            print_pair(name, k ? "excess variance, 16384, worst" : "excess variance, 6144, worst",
                       excess[0][k][kind], excess[now][k][kind], worst, count);
        }
    }
    print_pair("WARP", "512x256, 6144 blocks, ms, median", small_ms[0], small_ms[now], middle,
               count);
}

int main(void)
{
    map_set set = map_set_find("builds");
    image map;
    int i;

    print_cpu();
    print_compiler(BENCH_FLAGS);
    printf("maps      %d, %s, enlarged to %d by %d, bilinear, 6144 blocks\n\n", set.count,
           map_set_kind(&set), WIDTH, HEIGHT);
    for (i = 0; i < set.count; i++) {
        if (!map_set_load(&set, i, &map))
            return 1;
        time_small(&map, i);
        if (!input_enlarge(&map, WIDTH))
            fail("out of memory");
        time_map(&map, i);
        image_free(&map);
    }
    map_set_done(&set);
    print_all(set.count);
    return 0;
}
