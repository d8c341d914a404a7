/* scale.c: what a build costs as maps grow to 32768 x 16384, in steps, and where few rows changed.
 *
 *     scale [huge] [MAP]    prints tables on stdout, progress on stderr; takes a minute or two.
 *                           huge: sizes are tried even where memory seems too small for them
 *
 * Large maps are never in memory: their rows are made as the library asks for them. Times are CPU
 * time of the thread, so that a busy neighbour counts for little. All memory that a timed build
 * works in has been written to before.
 */
#define _POSIX_C_SOURCE 200809L
#ifdef __APPLE__
#define _DARWIN_C_SOURCE            /* ru_maxrss */
#endif

#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#define ROUND_COUNT 9
#include "../examples/common/progress.h"
#include "../examples/common/random.h"
#include "input.h"
#include "promise.h"
#include "timing.h"

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#define BASE_WIDTH   2048           /* the size that others are compared with */
#define BASE_HEIGHT  1024
#define STEP_WORK    60.0           /* of a build in steps, in builds of the least width */
#define SIZE_COUNT   5              /* each twice as wide as the one before */
#define NOISE_COUNT  32768          /* where the noise of a row may begin */
#define FOUR_PI      12.566370614359172954

#define PROMISED_RATIO    1.3       /* time a texel at 16384 x 8192, to that at 2048 x 1024 */
#define PROMISED_SCRATCH  9.0       /* bytes a texel */
#define PROMISED_ERROR    1e-6      /* of the integral of a constant map, relative */
#define PROMISED_STEP     2.0       /* ms */
#define PROMISED_TOTAL    1.15      /* of a build in steps, to one in one call */

/* Rounds of each size. A round of the largest takes ten seconds. */
static const int round_counts[SIZE_COUNT] = { ROUND_COUNT, ROUND_COUNT, 5, 3, 1 };
static const int promised_size = 3;

/* Of rebuilds: one row in so many changed; 1: all of them. */
static const int shares[] = { 1, 4, 16, 64 };
#define SHARES (int)(sizeof shares / sizeof shares[0])
#define REBUILD_SIZES 3

/* The made-up or given map, enlarged: every texel of the base, `stretch` times as wide and high,
   times noise of 5 %, as no real map is flat over a square of texels. */
typedef struct large_map {
    const float *base;              /* luminance, BASE_WIDTH x BASE_HEIGHT */
    const float *noise;
    int stretch;
} large_map;

typedef struct scale_state {
    bench_input input;
    float *base, *noise;
    int huge;
    progress shown;
    double done, work;
} scale_state;

/* A build: of which sampler, and its memory. */
typedef struct build {
    const char *name;
    int is_cdf;
    envsamp_kd_desc kd_desc;
    envsamp_sizes sizes;
    envsamp_buffer table, scratch;
    envsamp_kd_job *kd_job;
    envsamp_cdf_job *cdf_job;
    const envsamp_kd *kd;           /* what was built */
    const envsamp_cdf *cdf;
} build;

/* ---- builds of either kind ---- */

static void check(const build *b, envsamp_result result)
{
    if (result != ENVSAMP_OK)
        input_fail(b->name, envsamp_result_string(result));
}

static build build_make(const char *name, int is_cdf, envsamp_kd_select select, int block_count)
{
    build b;

    memset(&b, 0, sizeof b);
    b.name = name;
    b.is_cdf = is_cdf;
    b.kd_desc = envsamp_kd_defaults();
    b.kd_desc.select = select;
    b.kd_desc.block_count = block_count;
    return b;
}

static void build_measure(build *b, const envsamp_image *map)
{
    check(b, b->is_cdf ? envsamp_cdf_sizes(map, NULL, &b->sizes)
                       : envsamp_kd_sizes(map, &b->kd_desc, &b->sizes));
}

static void build_release(build *b)
{
    free(b->table.data);
    free(b->scratch.data);
    b->table.data = b->scratch.data = NULL;
}

/* Returns 0 where there is too little memory. */
static int build_allocate(build *b, const envsamp_image *map)
{
    void *table = NULL, *scratch = NULL;

    build_measure(b, map);
    if (posix_memalign(&table, 64, b->sizes.table_bytes) != 0)
        table = NULL;
    if (posix_memalign(&scratch, 64, b->sizes.scratch_bytes) != 0)
        scratch = NULL;
    b->table.data = table;
    b->table.bytes = b->sizes.table_bytes;
    b->scratch.data = scratch;
    b->scratch.bytes = b->sizes.scratch_bytes;
    if (table && scratch)
        return 1;
    build_release(b);
    return 0;
}

/* So that no build that is timed is the first to touch a page. */
static void build_touch(build *b)
{
    memset(b->table.data, 1, b->table.bytes);
    memset(b->scratch.data, 1, b->scratch.bytes);
}

static void build_begin(build *b, const envsamp_image *map, envsamp_row_fn fn, void *user)
{
    check(b, b->is_cdf ? envsamp_cdf_begin(map, fn, user, NULL, b->table, b->scratch,
                                           &b->cdf_job)
                       : envsamp_kd_begin(map, fn, user, &b->kd_desc, b->table, b->scratch,
                                          &b->kd_job));
}

/* Returns whether nothing is left to do. */
static int build_step(build *b, int items)
{
    int done = 0;

    check(b, b->is_cdf ? envsamp_cdf_step(b->cdf_job, items, &done)
                       : envsamp_kd_step(b->kd_job, items, &done));
    return done;
}

static void build_finish(build *b)
{
    check(b, b->is_cdf ? envsamp_cdf_finish(b->cdf_job, &b->cdf)
                       : envsamp_kd_finish(b->kd_job, &b->kd));
}

static void build_by_rows(build *b, const envsamp_image *map, envsamp_row_fn fn, void *user)
{
    build_begin(b, map, fn, user);
    build_finish(b);
}

static void build_in_one_call(build *b, const envsamp_image *map)
{
    check(b, b->is_cdf ? envsamp_cdf_build(map, NULL, b->table, b->scratch, &b->cdf)
                       : envsamp_kd_build(map, &b->kd_desc, b->table, b->scratch, &b->kd));
}

static void build_in_steps(build *b, const envsamp_image *map, int items)
{
    build_begin(b, map, NULL, NULL);
    while (!build_step(b, items))
        ;
    build_finish(b);
}

static size_t built_bytes(const build *b)
{
    return b->is_cdf ? envsamp_cdf_bytes(b->cdf) : envsamp_kd_bytes(b->kd);
}

static double built_integral(const build *b)
{
    envsamp_cdf_info cdf_info;
    envsamp_kd_info kd_info;

    memset(&cdf_info, 0, sizeof cdf_info);
    memset(&kd_info, 0, sizeof kd_info);
    check(b, b->is_cdf ? envsamp_cdf_get_info(b->cdf, &cdf_info)
                       : envsamp_kd_get_info(b->kd, &kd_info));
    return b->is_cdf ? cdf_info.integral : kd_info.integral;
}

/* ---- clocks and memory ---- */

static double cpu_seconds(void)
{
    struct timespec now;

    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Of any number of values, which it sorts. */
static double median_of(double *values, int count)
{
    qsort(values, (size_t)count, sizeof values[0], ascending);
    return 0.5 * (values[(count - 1) / 2] + values[count / 2]);
}

/* Shows the work that is done, in builds of a map of the least width, and adds some. */
static void show(scale_state *scale, const char *what, double builds)
{
    progress_show(&scale->shown, scale->done / scale->work, what);
    scale->done += builds;
}

/* Builds of all sizes take `rounds` times what one of the least width does, times their texels. */
static double size_work(int size)
{
    return (double)(1 << (2 * size));
}

static double all_work(void)
{
    double work = 3.0 * STEP_WORK;
    int size;

    for (size = 0; size < REBUILD_SIZES; size++)
        work += 2.0 * (round_counts[size] + 1.0) * SHARES * size_work(size);
    for (size = 0; size < SIZE_COUNT; size++)
        work += (round_counts[size] + 1.0 + 2.0) * size_work(size)
              + (size <= promised_size ? size_work(size) : 0.0);
    return work;
}

/* Bytes that can be had without swapping, or a negative number where nobody tells. */
static double available_bytes(void)
{
    char line[256];
    double kilobytes = -1.0;
    FILE *file = fopen("/proc/meminfo", "r");

    while (file && fgets(line, sizeof line, file))
        if (strncmp(line, "MemAvailable:", 13) == 0)
            kilobytes = strtod(line + 13, NULL);
    if (file)
        fclose(file);
    return 1024.0 * kilobytes;
}

/* Whether there seems to be memory for a build. That malloc grants it is not enough: a system may
   hand out more than it has, and end the program when it is used. */
static int memory_permits(const scale_state *scale, build *b, const envsamp_image *map)
{
    double available = available_bytes(), needed;

    build_measure(b, map);
    needed = (double)b->sizes.table_bytes + (double)b->sizes.scratch_bytes;
    return scale->huge || available < 0.0 || 1.25 * needed <= available;
}

/* Largest resident memory of this process so far. */
static double peak_bytes(void)
{
    struct rusage usage;

    getrusage(RUSAGE_SELF, &usage);
#ifdef __APPLE__
    return (double)usage.ru_maxrss;
#else
    return 1024.0 * (double)usage.ru_maxrss;
#endif
}

/* ---- rows ---- */

static envsamp_result large_row(int y, float *row, void *user)
{
    const large_map *source = user;
    const float *base = source->base + (size_t)(y / source->stretch) * BASE_WIDTH;
    const float *noise = source->noise + (uint32_t)y * 40503u % NOISE_COUNT;
    int stretch = source->stretch, x, i;

    for (x = 0; x < BASE_WIDTH; x++, row += stretch, noise += stretch)
        for (i = 0; i < stretch; i++)
            row[i] = base[x] * noise[i];
    return ENVSAMP_OK;
}

static envsamp_result constant_row(int y, float *row, void *user)
{
    int width = *(const int *)user, x;

    (void)y;
    for (x = 0; x < width; x++)
        row[x] = 1.0f;
    return ENVSAMP_OK;
}

/* An image of luminance without its pixels. */
static envsamp_image image_of_rows(int width)
{
    envsamp_image map;

    memset(&map, 0, sizeof map);
    map.width = width;
    map.height = width / 2;
    map.channels = 1;
    map.mapping = ENVSAMP_LATLONG;
    return map;
}

static large_map large_map_of(const scale_state *scale, int size)
{
    large_map source;

    source.base = scale->base;
    source.noise = scale->noise;
    source.stretch = 1 << size;
    return source;
}

static double texels_of(const envsamp_image *map)
{
    return (double)map->width * (double)map->height;
}

/* Makes the base of the large maps. */
static void make_base(scale_state *scale)
{
    const image *map = &scale->input.map;
    size_t noise_count = NOISE_COUNT + ((size_t)BASE_WIDTH << (SIZE_COUNT - 1)), i;
    pcg32 random = pcg32_make(2, 2);
    int x, y;

    scale->base = malloc((size_t)BASE_WIDTH * BASE_HEIGHT * sizeof(float));
    scale->noise = malloc(noise_count * sizeof(float));
    if (!scale->base || !scale->noise)
        input_fail("set-up", "out of memory");
    for (y = 0; y < BASE_HEIGHT; y++)
        for (x = 0; x < BASE_WIDTH; x++) {
            size_t from = (size_t)((int64_t)y * map->height / BASE_HEIGHT) * (size_t)map->width
                        + (size_t)((int64_t)x * map->width / BASE_WIDTH);

            scale->base[(size_t)y * BASE_WIDTH + (size_t)x]
                = envsamp_luminance(map->rgb + 3 * from);
        }
    for (i = 0; i < noise_count; i++)
        scale->noise[i] = 0.975f + 0.05f * pcg32_float(&random);
}

/* ---- 1: time a texel ---- */

enum { WHOLE, ROWS, NET, TIME_COUNT };

/* ns a texel of a build, of its rows alone, and of the one without the other. */
static void time_build(build *b, const scale_state *scale, int size, double *time)
{
    envsamp_image map = image_of_rows(BASE_WIDTH << size);
    large_map source = large_map_of(scale, size);
    double start, built, made;
    float *row = malloc((size_t)map.width * sizeof(float));
    volatile float sink;
    int y;

    if (!row)
        input_fail(b->name, "out of memory");
    start = cpu_seconds();
    build_by_rows(b, &map, large_row, &source);
    built = cpu_seconds();
    for (y = 0; y < map.height; y++) {
        large_row(y, row, &source);
        sink = row[y];
    }
    made = cpu_seconds();
    (void)sink;
    free(row);
    time[WHOLE] = (built - start) * 1e9 / texels_of(&map);
    time[ROWS] = (made - built) * 1e9 / texels_of(&map);
    time[NET] = time[WHOLE] - time[ROWS];
}

static build warp_build(const scale_state *scale)
{
    return build_make("kd, WARP", 0, ENVSAMP_KD_WARP, scale->input.options.block_count);
}

/* Builds of one size, each between two of the smallest; times and ratios are medians. */
static void time_rounds(const scale_state *scale, build *small, build *large, int size,
                        double *time, double *ratio)
{
    double times[TIME_COUNT][ROUND_COUNT], ratios[TIME_COUNT][ROUND_COUNT];
    double before[TIME_COUNT], now[TIME_COUNT], after[TIME_COUNT];
    int round, i;

    time_build(small, scale, 0, before);            /* not counted */
    time_build(small, scale, 0, before);
    for (round = 0; round < round_counts[size]; round++) {
        time_build(large, scale, size, now);
        time_build(small, scale, 0, after);
        for (i = 0; i < TIME_COUNT; i++) {
            times[i][round] = now[i];
            ratios[i][round] = 2.0 * now[i] / (before[i] + after[i]);
            before[i] = after[i];
        }
    }
    for (i = 0; i < TIME_COUNT; i++) {
        time[i] = median_of(times[i], round_counts[size]);
        ratio[i] = median_of(ratios[i], round_counts[size]);
    }
}

static void print_times(scale_state *scale)
{
    envsamp_image map = image_of_rows(BASE_WIDTH);
    build small = warp_build(scale), large = warp_build(scale);
    double time[TIME_COUNT], ratio[TIME_COUNT];
    int size;

    printf("Time: CPU ns a texel of building from the map enlarged, whose rows a callback makes:\n"
           "in all, of the rows alone, and of the rest (net); relative to %d x %d, built\n"
           "before and after each. WARP, %d blocks, bilinear.\n\n",
           BASE_WIDTH, BASE_HEIGHT, small.kd_desc.block_count);
    printf("%-16s %7s %9s %9s %9s %9s %9s%s\n", "", "rounds", "build ns", "ratio", "rows ns",
           "net ns", "net ratio", promise_heading());
    if (!build_allocate(&small, &map))
        input_fail(small.name, "out of memory");
    build_touch(&small);
    for (size = 0; size < SIZE_COUNT; size++) {
        map = image_of_rows(BASE_WIDTH << size);
        show(scale, "time of builds", (round_counts[size] + 1.0) * size_work(size));
        printf("%5d x %-8d", map.width, map.height);
        if (!memory_permits(scale, &large, &map) || !build_allocate(&large, &map)) {
            printf(" skipped: memory\n");
            continue;
        }
        build_touch(&large);
        time_rounds(scale, &small, &large, size, time, ratio);
        build_release(&large);
        progress_end(&scale->shown);
        printf(" %7d %9.2f %9.2f %9.2f %9.2f %9.2f", round_counts[size], time[WHOLE],
               ratio[WHOLE], time[ROWS], time[NET], ratio[NET]);
        printf("%s\n", size != promised_size ? ""
                       : promise("<=", PROMISED_RATIO, ratio[NET] <= PROMISED_RATIO));
        fflush(stdout);
    }
    build_release(&small);
}

/* ---- 2: memory ---- */

typedef struct memory_use {
    double peak;                    /* bytes that a build adds to the process */
    double table;                   /* bytes of the table that was built */
} memory_use;

/* What a build does in a process of its own, whose peak is not that of others. */
static memory_use use_memory(build *b, const scale_state *scale, int size)
{
    envsamp_image map = image_of_rows(BASE_WIDTH << size);
    large_map source = large_map_of(scale, size);
    double before = peak_bytes();
    memory_use use;

    if (!build_allocate(b, &map))
        input_fail(b->name, "out of memory");
    build_by_rows(b, &map, large_row, &source);
    use.peak = peak_bytes() - before;
    use.table = (double)built_bytes(b);
    return use;
}

/* Returns 0 where the process that built came to nothing. */
static int measure_memory(build *b, const scale_state *scale, int size, memory_use *use)
{
    int ends[2], status = 0, complete;
    pid_t child;

    fflush(stdout);
    if (pipe(ends) != 0)
        return 0;
    child = fork();
    if (child == 0) {
        *use = use_memory(b, scale, size);
        _exit(write(ends[1], use, sizeof *use) != (ssize_t)sizeof *use);
    }
    close(ends[1]);
    complete = child > 0 && read(ends[0], use, sizeof *use) == (ssize_t)sizeof *use;
    close(ends[0]);
    if (child > 0)
        waitpid(child, &status, 0);
    return complete;
}

static void print_memory(scale_state *scale)
{
    build b = warp_build(scale);
    memory_use use;
    int size;

    printf("\nMemory of the same builds: what is asked for, and by how much the largest resident\n"
           "memory of the process grows.\n\n");
    printf("%-16s %12s %12s %12s %12s%s\n", "", "scratch MB", "B a texel", "peak MB",
           "table kB", promise_heading());
    for (size = 0; size < SIZE_COUNT; size++) {
        envsamp_image map = image_of_rows(BASE_WIDTH << size);
        double each;
        int fits;

        show(scale, "memory of a build", size_work(size));
        fits = memory_permits(scale, &b, &map);
        each = (double)b.sizes.scratch_bytes / texels_of(&map);
        printf("%5d x %-8d %12.1f %12.2f", map.width, map.height,
               (double)b.sizes.scratch_bytes * 1e-6, each);
        if (fits && measure_memory(&b, scale, size, &use))
            printf(" %12.1f %12.1f", use.peak * 1e-6, use.table * 1e-3);
        else
            printf(" %12s %12s", fits ? "failed" : "skipped", fits ? "-" : "memory");
        progress_end(&scale->shown);
        printf("%s\n", promise("<=", PROMISED_SCRATCH, each <= PROMISED_SCRATCH));
        fflush(stdout);
    }
}

/* ---- 3: the integral of a constant map ---- */

static void print_integral(scale_state *scale, build b, int width)
{
    envsamp_image map = image_of_rows(width);
    double error;

    show(scale, b.name, (double)width * width / BASE_WIDTH / BASE_WIDTH);
    if (!memory_permits(scale, &b, &map) || !build_allocate(&b, &map)) {
        printf(" %17s", "skipped: memory");
        return;
    }
    build_by_rows(&b, &map, constant_row, &width);
    error = built_integral(&b) / FOUR_PI - 1.0;
    printf(" %10.1e%s", error,
           promise("+-", PROMISED_ERROR, -PROMISED_ERROR <= error && error <= PROMISED_ERROR));
    build_release(&b);
}

static void print_integrals(scale_state *scale)
{
    int size;

    printf("\nThe integral of a constant map, relative to 4 pi, less 1.\n\n");
    printf("%-16s %10s %*s\n", "", "kd", promises_shown() ? 27 : 10, "cdf");
    for (size = 0; size < SIZE_COUNT; size++) {
        int width = BASE_WIDTH << size;

        printf("%5d x %-8d", width, width / 2);
        print_integral(scale, warp_build(scale), width);
        if (size <= promised_size)
            print_integral(scale, build_make("cdf", 1, ENVSAMP_KD_WARP, 0), width);
        else
            printf(" %10s", "-");
        progress_end(&scale->shown);
        printf("\n");
        fflush(stdout);
    }
}

/* ---- 4: builds in steps ---- */

static const int item_counts[] = { 1, 16, 64, 256 };
#define ITEMS (int)(sizeof item_counts / sizeof item_counts[0])

/* Of a build in steps of so many items. */
typedef struct stepped {
    int step_count;
    int longest_at;                 /* 0: begin; step_count + 1: finish */
    double longest;                 /* ms: begin, a step, or finish */
    double one_call, total;         /* ms; to that of a build in one call, median ratio */
} stepped;

static int count_steps(build *b, const envsamp_image *map, int items)
{
    int count = 1;

    build_begin(b, map, NULL, NULL);
    for (; !build_step(b, items); count++)
        ;
    build_finish(b);
    return count;
}

static void keep_least(double *least, double start)
{
    double time = cpu_seconds() - start;

    *least = time < *least ? time : *least;
}

/* The steps are the same every time: the least of the repeats is what a step takes undisturbed.
   least[0] is begin, least[step_count + 1] finish. */
static void time_steps(build *b, const envsamp_image *map, int items, int step_count,
                       double *least)
{
    int done = 0, step;
    double start = cpu_seconds();

    build_begin(b, map, NULL, NULL);
    keep_least(&least[0], start);
    for (step = 1; !done && step <= step_count; step++) {
        start = cpu_seconds();
        done = build_step(b, items);
        keep_least(&least[step], start);
    }
    if (!done || step != step_count + 1)
        input_fail(b->name, "not the same steps again");
    start = cpu_seconds();
    build_finish(b);
    keep_least(&least[step], start);
}

static void find_longest(build *b, const envsamp_image *map, int items, stepped *out)
{
    int count = out->step_count = count_steps(b, map, items), round, i;
    double *least = malloc((size_t)(count + 2) * sizeof *least);

    if (!least)
        input_fail(b->name, "out of memory");
    for (i = 0; i < count + 2; i++)
        least[i] = DBL_MAX;
    for (round = 0; round < 2 * ROUND_COUNT; round++)
        time_steps(b, map, items, count, least);
    out->longest_at = 0;
    for (i = 1; i < count + 2; i++)
        if (least[i] > least[out->longest_at])
            out->longest_at = i;
    out->longest = least[out->longest_at] * 1e3;
    free(least);
}

static void time_totals(build *b, const envsamp_image *map, int items, stepped *out)
{
    double one_call[ROUND_COUNT], in_steps[ROUND_COUNT];
    int round;

    for (round = 0; round < ROUND_COUNT; round++) {
        double start = cpu_seconds(), middle;

        build_in_one_call(b, map);
        middle = cpu_seconds();
        build_in_steps(b, map, items);
        in_steps[round] = cpu_seconds() - middle;
        one_call[round] = middle - start;
    }
    out->one_call = median(one_call) * 1e3;
    out->total = median_ratio(in_steps, one_call);
}

/* Whether steps make the very table that one call makes. */
static void check_same_table(build *b, const envsamp_image *map, int items)
{
    size_t bytes;
    void *copy;

    build_in_one_call(b, map);
    bytes = built_bytes(b);
    copy = malloc(bytes);
    if (!copy)
        input_fail(b->name, "out of memory");
    memcpy(copy, b->table.data, bytes);
    build_in_steps(b, map, items);
    if (built_bytes(b) != bytes || memcmp(copy, b->table.data, bytes) != 0)
        input_fail(b->name, "another table than that of one call");
    free(copy);
}

static int keeps_promise(const stepped *s)
{
    return s->longest <= PROMISED_STEP && s->total <= PROMISED_TOTAL;
}

static void print_stepped(const char *name, int items, const stepped *s)
{
    printf("%-16s %7d %8d %11.3f", name, items, s->step_count, s->longest);
    if (s->longest_at == 0)
        printf(" %9s", "begin");
    else if (s->longest_at > s->step_count)
        printf(" %9s", "finish");
    else
        printf(" %9d", s->longest_at);
    printf(" %12.2f %8.3f%s\n", s->one_call, s->total,
           !promises_shown() ? "" : keeps_promise(s) ? "   within" : "   beyond");
}

static void print_build_in_steps(scale_state *scale, build b, const envsamp_image *map)
{
    int i, kept = 0;

    show(scale, b.name, STEP_WORK);
    if (!build_allocate(&b, map))
        input_fail(b.name, "out of memory");
    build_touch(&b);
    for (i = 0; i < ITEMS; i++) {
        stepped s;

        check_same_table(&b, map, item_counts[i]);
        find_longest(&b, map, item_counts[i], &s);
        time_totals(&b, map, item_counts[i], &s);
        progress_end(&scale->shown);
        print_stepped(i ? "" : b.name, item_counts[i], &s);
        kept |= keeps_promise(&s) << i;
        fflush(stdout);
    }
    build_release(&b);
    if (!promises_shown())
        return;
    printf("%-16s %s", "", kept ? "kept with" : "MISSED");
    for (i = 0; i < ITEMS; i++)
        if (kept >> i & 1)
            printf(" %d", item_counts[i]);
    printf("%s\n", kept ? " items a step" : "");
}

static void print_steps(scale_state *scale)
{
    const image *given = &scale->input.map;
    envsamp_image map = image_of_rows(given->width);
    int blocks = scale->input.options.block_count;

    map.pixels = given->rgb;
    map.height = given->height;
    map.channels = 3;
    printf("\nBuilds in steps, %d x %d RGB: the longest call, begin and finish included, where\n"
           "each counts with its least time in %d builds, and which step it is; a build in one\n"
           "call, and one in steps relative to that; all CPU time.\n\n",
           map.width, map.height, 2 * ROUND_COUNT);
    if (promises_shown())
        printf("Promised, with one of these numbers of items: longest <= %g ms, total <= %g.\n\n",
               PROMISED_STEP, PROMISED_TOTAL);
    printf("%-16s %7s %8s %11s %9s %12s %8s\n", "", "items", "steps", "longest ms", "at step",
           "one call ms", "total");
    print_build_in_steps(scale, build_make("kd, WARP", 0, ENVSAMP_KD_WARP, blocks), &map);
    print_build_in_steps(scale, build_make("kd, ALIAS", 0, ENVSAMP_KD_ALIAS, blocks), &map);
    print_build_in_steps(scale, build_make("cdf", 1, ENVSAMP_KD_WARP, 0), &map);
}

/* ---- 5: rebuilds ---- */

static void rebuild(build *b, const envsamp_image *map, large_map *source, int rows)
{
    check(b, envsamp_kd_rebuild_begin(map, large_row, source, &b->kd_desc, 0, rows, b->table,
                                      b->scratch, &b->kd_job));
    build_finish(b);
}

/* Median ms of rebuilds, by turns. */
static void print_rebuild(scale_state *scale, build b, int size)
{
    const envsamp_image map = image_of_rows(BASE_WIDTH << size);
    large_map source = large_map_of(scale, size);
    double times[SHARES][ROUND_COUNT];
    int rounds = round_counts[size], round, i;

    show(scale, b.name, (rounds + 1.0) * SHARES * size_work(size));
    if (!build_allocate(&b, &map))
        input_fail(b.name, "out of memory");
    build_touch(&b);
    rebuild(&b, &map, &source, map.height);
    for (round = 0; round < rounds; round++)
        for (i = 0; i < SHARES; i++) {
            const double start = cpu_seconds();

            rebuild(&b, &map, &source, map.height / shares[i]);
            times[i][round] = 1e3 * (cpu_seconds() - start);
        }
    progress_end(&scale->shown);
    printf("%5d x %-8d %-10s", map.width, map.height, b.name);
    for (i = 0; i < SHARES; i++)
        printf(" %9.2f", median_of(times[i], rounds));
    printf("\n");
    fflush(stdout);
    build_release(&b);
}

static void print_rebuilds(scale_state *scale)
{
    int blocks = scale->input.options.block_count, size;

    printf("\nRebuilds of which so many rows changed, by row callback: ms, making the rows "
           "included.\n\n%-16s %-10s %9s %9s %9s %9s\n", "", "", "all rows", "1/4", "1/16", "1/64");
    for (size = 0; size < REBUILD_SIZES; size++) {
        print_rebuild(scale, build_make("kd, WARP", 0, ENVSAMP_KD_WARP, blocks), size);
        print_rebuild(scale, build_make("kd, ALIAS", 0, ENVSAMP_KD_ALIAS, blocks), size);
    }
}

/* ---- the program ---- */

static void print_help(void)
{
    printf("usage: scale [huge] [--block-count N] [--width N] [MAP]\n"
           "\n"
           "Times builds of large maps by row callback, in steps, and of rows that changed.\n"
           "\n"
           "  huge             try all sizes, even where memory seems too small: 3 GB for the\n"
           "                   largest\n"
           "  MAP              a lat-long map in an HDR or PFM file, or a made-up one: sky,\n"
           "                   studio, constant, night or foliage (sky)\n"
           "  --block-count N  blocks of the kd-tree (6144)\n"
           "  --width N        of the map that is built in steps, made or enlarged to it (2048)\n"
           "  --help           this text\n");
}

/* Takes the word out of the command line; the rest is that of other programs. */
static int take_huge(int *argc, char **argv)
{
    int from, to = 1, huge = 0;

    for (from = 1; from < *argc; from++)
        if (strcmp(argv[from], "--help") == 0) {
            print_help();
            exit(0);
        } else if (strcmp(argv[from], "huge") == 0) {
            huge = 1;
        } else {
            argv[to++] = argv[from];
        }
    *argc = to;
    return huge;
}

int main(int argc, char **argv)
{
    static scale_state scale;

    scale.huge = take_huge(&argc, argv);
    input_create(argc, argv, &scale.input);
    make_base(&scale);
    print_cpu();
    print_compiler(BENCH_FLAGS);
    printf("map       %s, %d x %d\n\n", scale.input.options.map_path, scale.input.map.width,
           scale.input.map.height);
    fflush(stdout);

    scale.shown = progress_start("scale");
    scale.work = all_work();
    print_times(&scale);
    print_memory(&scale);
    print_integrals(&scale);
    print_steps(&scale);
    print_rebuilds(&scale);

    free(scale.base);
    free(scale.noise);
    input_destroy(&scale.input);
    return 0;
}
