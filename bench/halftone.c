/* halftone.c: how evenly error diffusion samples maps: error of irradiance, error of the number of
 * samples in rectangles, star discrepancy, counts and time, beside random and Sobol points.
 *
 *     halftone [-q]      tables on stdout, progress on stderr; two minutes, -q: without all counts
 *
 * Importance is luminance x solid angle of a texel; a sample is the direction of the texel's centre
 * and stands for S/M. Irradiance: RMS relative error over 64 normals, then the geometric mean over
 * maps. Random and Sobol points: root mean square over 64 seeds, others for every map.
 */
#define _POSIX_C_SOURCE 200809L
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "../examples/common/irradiance.h"
#include "baselines.h"
#include "map_set.h"

#define ROUND_COUNT 31
#include "timing.h"

#define M_COUNT 5
#define M_MAX 4096
#define RECTANGLES 100
#define SEEDS 64
#define GRID 64                     /* corners of star discrepancy, a side */
#define KERNELS 5                   /* without RANDOM */

static const int counts[M_COUNT] = { 16, 32, 64, 256, 1024 };
static const char *const kernels[KERNELS] = { "Szirmay", "Floyd-Steinberg", "Jarvis", "Stucki",
                                              "Ostromoukhov" };

/* What makes samples: halftones, then lights, then points through the CDF. */
enum { RANDOM, SOBOL, TEXELS, CELLS = TEXELS + KERNELS, REPEAT, LIGHTS_HALFTONE, LIGHTS_RANDOM,
       ROWS };

typedef struct spot { float uv[2], dir[3], light; } spot;      /* light: what it stands for */

typedef struct rectangle { int x0, y0, x1, y1; double mass; } rectangle;

typedef struct subject {
    image map;
    envsamp_image view;
    float *importance;
    double *below;                  /* sums over the texels above and left of a corner */
    irradiance exact;
    baseline_cdf cdf;
    rectangle rectangles[RECTANGLES];
    envsamp_buffer scratch;
    spot spots[M_MAX];
    envsamp_texel texels[M_MAX];
    envsamp_light lights[M_MAX];
} subject;

/* Of one way to make samples of one map: the first two are squares, to be averaged. */
typedef struct errors {
    double irradiance[M_COUNT], rectangles[M_COUNT];
    double worst[M_COUNT], star;
} errors;

/* ---- a map ---- */

static double mass_of(const subject *s, int x0, int y0, int x1, int y1)
{
    const size_t stride = (size_t)s->map.width + 1;
    const double *top = s->below + stride * (size_t)y0, *end = s->below + stride * (size_t)y1;
    const double total = s->below[stride * ((size_t)s->map.height + 1) - 1];

    return (end[x1] - end[x0] - top[x1] + top[x0]) / total;
}

static void make_importance(subject *s)
{
    const int width = s->map.width, height = s->map.height;
    const size_t stride = (size_t)width + 1;
    int x, y;

    s->importance = bench_allocate((size_t)width * (size_t)height * sizeof(float));
    s->below = bench_allocate(stride * ((size_t)height + 1) * sizeof(double));
    for (y = 0; y < height; y++)
        for (x = 0; x < width; x++) {
            const size_t texel = (size_t)y * (size_t)width + (size_t)x;
            double *corner = s->below + stride * ((size_t)y + 1) + (size_t)x + 1;

            s->importance[texel] = texel_luminance(&s->map, x, y) * texel_sr(width, height, y);
            corner[0] = corner[-1] + corner[-(ptrdiff_t)stride] - corner[-(ptrdiff_t)stride - 1]
                      + (double)s->importance[texel];
        }
}

static void make_rectangles(subject *s)
{
    pcg32 random = pcg32_make(3, 3);
    int i, side;

    for (i = 0; i < RECTANGLES; i++) {
        int at[2][2];

        for (side = 0; side < 2; side++) {
            const uint32_t length = (uint32_t)(side ? s->map.height : s->map.width);
            const int a = (int)(pcg32_next(&random) % length);
            const int b = (int)(pcg32_next(&random) % length);

            at[side][0] = a < b ? a : b;
            at[side][1] = 1 + (a < b ? b : a);
        }
        s->rectangles[i].x0 = at[0][0];
        s->rectangles[i].x1 = at[0][1];
        s->rectangles[i].y0 = at[1][0];
        s->rectangles[i].y1 = at[1][1];
        s->rectangles[i].mass = mass_of(s, at[0][0], at[1][0], at[0][1], at[1][1]);
    }
}

/* Bad pixels count as a build counts them: they are mended once here. */
static int subject_make(subject *s)
{
    image_clean(&s->map);
    s->view = bench_view(&s->map);
    make_importance(s);
    make_rectangles(s);
    s->scratch.bytes = (size_t)1 << 20;
    s->scratch.data = bench_allocate(s->scratch.bytes);
    return irradiance_make(&s->exact, &s->map)
        && baseline_cdf_create(s->map.rgb, s->map.width, s->map.height, &s->cdf);
}

static void subject_free(subject *s)
{
    free(s->importance);
    free(s->below);
    free(s->scratch.data);
    baseline_cdf_destroy(&s->cdf);
    image_free(&s->map);
}

/* ---- samples ---- */

static double total_of(const subject *s)
{
    return s->below[((size_t)s->map.width + 1) * ((size_t)s->map.height + 1) - 1];
}

static void put_spot(subject *s, int i, float u, float v, double light)
{
    spot *at = &s->spots[i];

    at->uv[0] = u;
    at->uv[1] = v;
    at->light = (float)light;
    envsamp_uv_to_dir(ENVSAMP_LATLONG, u, v, at->dir);
}

static envsamp_halftone_desc desc_of(int row, int count, uint32_t seed)
{
    envsamp_halftone_desc desc;

    memset(&desc, 0, sizeof desc);
    desc.count = count;
    desc.kernel = row == RANDOM ? ENVSAMP_KERNEL_RANDOM
                : row < CELLS ? (envsamp_kernel)(row - TEXELS) : ENVSAMP_KERNEL_SZIRMAY;
    desc.seed = row == RANDOM ? seed : 0;
    desc.scan = row >= TEXELS && row < CELLS ? ENVSAMP_SCAN_TEXELS : ENVSAMP_SCAN_CELLS;
    desc.once = row < REPEAT;
    return desc;
}

/* Texels of a halftone; 0 if it is not of `count`. */
static int halftone(subject *s, const envsamp_halftone_desc *desc)
{
    int count;

    return envsamp_halftone(s->importance, s->map.width, s->map.height, 0, desc, s->texels, M_MAX,
                            &count, s->scratch) == ENVSAMP_OK && count == desc->count;
}

static void make_halftone(subject *s, int row, int count, uint32_t seed)
{
    const envsamp_halftone_desc desc = desc_of(row, count, seed);
    int i;

    if (!halftone(s, &desc))
        printf("%s: not %d samples\n", row == RANDOM ? "random" : kernels[desc.kernel], count);
    for (i = 0; i < count; i++)
        put_spot(s, i, ((float)s->texels[i].x + 0.5f) / (float)s->map.width,
                 ((float)s->texels[i].y + 0.5f) / (float)s->map.height, total_of(s) / count);
}

static void make_lights(subject *s, int row, int count, uint32_t seed)
{
    envsamp_lights_desc desc = envsamp_lights_defaults();
    int i;

    desc.count = count;
    desc.method = row == LIGHTS_RANDOM ? ENVSAMP_LIGHTS_RANDOM : ENVSAMP_LIGHTS_HALFTONE;
    desc.seed = row == LIGHTS_RANDOM ? seed : 0;
    if (envsamp_lights(&s->view, &desc, s->lights, M_MAX, s->scratch, NULL) != ENVSAMP_OK)
        printf("no %d lights\n", count);
    for (i = 0; i < count; i++) {
        float uv[2];

        envsamp_dir_to_uv(ENVSAMP_LATLONG, s->lights[i].dir, uv);
        put_spot(s, i, uv[0], uv[1], (double)envsamp_luminance(s->lights[i].irradiance));
    }
}

static void make_samples(subject *s, int row, int count, uint32_t seed)
{
    int i;

    if (row >= LIGHTS_HALFTONE) {
        make_lights(s, row, count, seed);
    } else if (row != SOBOL) {
        make_halftone(s, row, count, seed);
    } else {
        for (i = 0; i < count; i++) {
            float u[2], uv[2];

            sobol_owen((uint32_t)i, seed, u);
            baseline_cdf_sample_uv(&s->cdf, u[0], u[1], uv);
            put_spot(s, i, uv[0], uv[1], total_of(s) / count);
        }
    }
}

/* ---- errors ---- */

static double irradiance_error(const subject *s, int count)
{
    double squares = 0.0, normals = 0.0;
    int i, k;

    for (k = 0; k < IRRADIANCE_NORMALS; k++) {
        double sum = 0.0, error;

        for (i = 0; i < count; i++)
            sum += (double)(s->spots[i].light * fmaxf(dot3(s->exact.normals[k], s->spots[i].dir),
                                                      0.0f));
        if (!(s->exact.exact[k] > 0.0))
            continue;
        error = sum / s->exact.exact[k] - 1.0;
        squares += error * error;
        normals += 1.0;
    }
    return squares / normals;
}

static int count_within(const subject *s, int count, const rectangle *r)
{
    int inside = 0, i;

    for (i = 0; i < count; i++) {
        const int x = (int)(s->spots[i].uv[0] * (float)s->map.width);
        const int y = (int)(s->spots[i].uv[1] * (float)s->map.height);

        inside += x >= r->x0 && x < r->x1 && y >= r->y0 && y < r->y1;
    }
    return inside;
}

/* Mean square of the error of the number of samples in a rectangle; *worst becomes the largest over
   the square root of the perimeter. */
static double rectangle_error(const subject *s, int count, double *worst)
{
    double squares = 0.0;
    int i;

    for (i = 0; i < RECTANGLES; i++) {
        const rectangle *r = &s->rectangles[i];
        const double error = count_within(s, count, r) - count * r->mass;

        squares += error * error;
        *worst = fmax(*worst, fabs(error) / sqrt(2.0 * (r->x1 - r->x0 + r->y1 - r->y0)));
    }
    return squares / RECTANGLES;
}

/* Largest error of the share of samples in a rectangle that begins in the upper left corner. */
static double star_discrepancy(const subject *s, int count)
{
    double star = 0.0;
    rectangle r = { 0, 0, 0, 0, 0.0 };
    int i, j;

    for (j = 1; j <= GRID; j++)
        for (i = 1; i <= GRID; i++) {
            r.x1 = i * s->map.width / GRID;
            r.y1 = j * s->map.height / GRID;
            star = fmax(star, fabs((double)count_within(s, count, &r) / count
                                   - mass_of(s, 0, 0, r.x1, r.y1)));
        }
    return star;
}

static errors measure(subject *s, int row, int map)
{
    const int seeds = row == RANDOM || row == SOBOL || row == LIGHTS_RANDOM ? SEEDS : 1;
    errors e;
    int m, seed;

    memset(&e, 0, sizeof e);
    for (m = 0; m < M_COUNT; m++)
        for (seed = 1; seed <= seeds; seed++) {
            make_samples(s, row, counts[m], (uint32_t)(map * SEEDS + seed));
            e.irradiance[m] += irradiance_error(s, counts[m]) / seeds;
            e.rectangles[m] += rectangle_error(s, counts[m], &e.worst[m]) / seeds;
            if (counts[m] == 256)
                e.star += star_discrepancy(s, counts[m]) / seeds;
        }
    return e;
}

/* ---- tables ---- */

#define AT_256 3                    /* in counts */

static const char *name_of(int row, char name[48])
{
    static const char *const others[] = { "cells", "cells, repeat", "lights, HALFTONE",
                                          "lights, RANDOM" };

    if (row == RANDOM || row == SOBOL)
        return row == RANDOM ? "random" : "Sobol points through the CDF";
    if (row >= CELLS)
        return others[row - CELLS];
    snprintf(name, 48, "%s, texels, as published", kernels[row - TEXELS]);
    return name;
}

/* Geometric mean over maps of the root of what `field` of the errors says. */
static double mean_root(const errors (*all)[ROWS], int maps, int row, int m, int rectangles)
{
    double sum = 0.0;
    int i;

    for (i = 0; i < maps; i++)
        sum += 0.5 * log(rectangles ? all[i][row].rectangles[m] : all[i][row].irradiance[m]);
    return exp(sum / maps);
}

static void print_irradiance(const errors (*all)[ROWS], int maps)
{
    char name[48];
    int row, m;

    printf("\nRMS relative error of irradiance, and over that of random from 32 samples on\n\n");
    printf("| samples |");
    for (m = 0; m < M_COUNT; m++)
        printf(" %d |", counts[m]);
    printf(" / random, 32 | 64 | 256 | 1024 |\n|---|---|---|---|---|---|---|---|---|---|\n");
    for (row = 0; row < ROWS; row++) {
        printf("| %s |", name_of(row, name));
        for (m = 0; m < M_COUNT; m++)
            printf(" %.4f |", mean_root(all, maps, row, m, 0));
        for (m = 1; m < M_COUNT; m++)
            printf(" %.3f |", mean_root(all, maps, row, m, 0) / mean_root(all, maps, RANDOM, m, 0));
        printf("\n");
    }
}

/* Root mean square over maps and rectangles. */
static double pooled(const errors (*all)[ROWS], int maps, int row, int m)
{
    double sum = 0.0;
    int i;

    for (i = 0; i < maps; i++)
        sum += all[i][row].rectangles[m];
    return sqrt(sum / maps);
}

static void print_rectangles(const errors (*all)[ROWS], int maps)
{
    char name[48];
    int row, m, i;

    printf("\nErrors of the number of samples in %d rectangles, of 256 samples: RMS over all maps, "
           "geometric\nmean over maps, both over those of random; largest error over the square "
           "root of the perimeter\nin texels, of 64, 256 and 1024 samples; star discrepancy\n\n"
           "| 256 samples | RMS | / random | geometric mean | / random | largest | star |\n"
           "|---|---|---|---|---|---|---|\n", RECTANGLES);
    for (row = 0; row < LIGHTS_HALFTONE; row++) {
        double worst = 0.0, star = 0.0;

        for (i = 0; i < maps; i++) {
            for (m = AT_256 - 1; m < M_COUNT; m++)
                worst = fmax(worst, all[i][row].worst[m]);
            star += log(all[i][row].star) / maps;
        }
        printf("| %s | %.2f | %.3f | %.2f | %.3f | %.2f | %.4f |\n", name_of(row, name),
               pooled(all, maps, row, AT_256),
               pooled(all, maps, row, AT_256) / pooled(all, maps, RANDOM, AT_256),
               mean_root(all, maps, row, AT_256, 1),
               mean_root(all, maps, row, AT_256, 1) / mean_root(all, maps, RANDOM, AT_256, 1),
               worst, exp(star));
    }
}

/* Where one texel is worth several samples, choosing it once is not enough. */
static void print_maps(const map_set *set, const errors (*all)[ROWS], const double *share)
{
    static const int rows[] = { RANDOM, SOBOL, TEXELS + 1, CELLS, REPEAT };
    const int columns = (int)(sizeof rows / sizeof *rows);
    int i, k;

    printf("\nMap by map, 256 samples: irradiance, then rectangles; 'largest': samples that the "
           "brightest texel\nis worth; as published by Floyd-Steinberg\n\n"
           "| map | largest | random | Sobol | published | cells | repeat | random | Sobol | "
           "published | cells | repeat |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n");
    for (i = 0; i < set->count; i++) {
        printf("| %s | %.2f |", map_set_name(set, i), 256.0 * share[i]);
        for (k = 0; k < columns; k++)
            printf(" %.4f |", sqrt(all[i][rows[k]].irradiance[AT_256]));
        for (k = 0; k < columns; k++)
            printf(" %.2f |", sqrt(all[i][rows[k]].rectangles[AT_256]));
        printf("\n");
    }
}

static double largest_share(const subject *s)
{
    const size_t count = (size_t)s->map.width * (size_t)s->map.height;
    float largest = 0.0f;
    size_t i;

    for (i = 0; i < count; i++)
        largest = fmaxf(largest, s->importance[i]);
    return (double)largest / total_of(s);
}

/* ---- counts ---- */

/* How many of all M from 1 to M_MAX, kernels and, if few, scans do not give M samples. */
static long wrong_counts(subject *s, long *runs)
{
    long wrong = 0;
    int kernel, m, repeat;

    for (kernel = ENVSAMP_KERNEL_SZIRMAY; kernel <= ENVSAMP_KERNEL_RANDOM; kernel++)
        for (m = 1; m <= M_MAX; m++)
            for (repeat = 0; repeat < (m % 64 ? 1 : 4); repeat++) {
                envsamp_halftone_desc desc = desc_of(CELLS, m, 0);

                desc.kernel = (envsamp_kernel)kernel;
                desc.once = !(repeat & 1);
                desc.scan = repeat & 2 ? ENVSAMP_SCAN_TEXELS : ENVSAMP_SCAN_CELLS;
                wrong += !halftone(s, &desc);
                ++*runs;
            }
    return wrong;
}

static void count_map(subject *s, const char *name, long *runs, long *wrong)
{
    if (!subject_make(s)) {
        printf("%s: not enough memory\n", name);
        exit(EXIT_FAILURE);
    }
    *wrong += wrong_counts(s, runs);
    subject_free(s);
}

static void print_counts(map_set *set, subject *s)
{
    long runs = 0, wrong = 0;
    int i;

    set->shown = progress_start("halftone, counts");
    for (i = 0; i < set->count && set->real; i++)
        if (map_set_load(set, i, &s->map))
            count_map(s, map_set_name(set, i), &runs, &wrong);
    for (i = 0; map_names[i]; i++)
        if (map_make(map_names[i], 512, 256, &s->map))
            count_map(s, map_names[i], &runs, &wrong);
    map_set_done(set);
    printf("\nCounts: all M from 1 to %d, every kernel, %d real and %d made-up maps; every 64th M "
           "also with\nrepeat and texel by texel: %ld of %ld halftones have not M samples\n",
           M_MAX, set->real ? set->count : 0, i, wrong, runs);
}

/* ---- time ---- */

enum { PASS, TIME_CELLS, TIME_RANDOM, TIME_TEXELS, TIME_LIGHTS, TIMED };

static const char *const timed[TIMED] = { "luminance pass", "cells", "RANDOM", "Szirmay, texels",
                                          "envsamp_lights, HALFTONE" };

static void time_once(subject *s, int which, float *row_weights, float *importance)
{
    envsamp_halftone_desc desc = desc_of(CELLS, 1024, 0);

    if (which == PASS) {
        baseline_luminance_pass(s->map.rgb, s->map.width, s->map.height, row_weights, importance);
    } else if (which == TIME_LIGHTS) {
        make_lights(s, LIGHTS_HALFTONE, 1024, 0);
    } else {
        desc.kernel = which == TIME_RANDOM ? ENVSAMP_KERNEL_RANDOM : ENVSAMP_KERNEL_SZIRMAY;
        desc.scan = which == TIME_TEXELS ? ENVSAMP_SCAN_TEXELS : ENVSAMP_SCAN_CELLS;
        halftone(s, &desc);
    }
}

static void print_times(subject *s)
{
    static double times[TIMED][ROUND_COUNT];
    float *row_weights, *importance;
    int round, i;

    if (!map_make("studio", 1024, 512, &s->map) || !subject_make(s))
        return;
    row_weights = bench_allocate((size_t)s->map.height * sizeof *row_weights);
    importance = bench_allocate((size_t)s->map.width * (size_t)s->map.height * sizeof *importance);
    baseline_row_weights(s->map.width, s->map.height, row_weights);
    for (round = 0; round < ROUND_COUNT; round++)
        for (i = 0; i < TIMED; i++) {
            const double start = seconds();

            time_once(s, i, row_weights, importance);
            times[i][round] = seconds() - start;
        }
    printf("\n1024 samples of studio at 1024x512, one core, medians of %d rounds, and over a pass "
           "over the pixels\nthat writes luminance x solid angle\n\n| | ms | passes |\n"
           "|---|---|---|\n", ROUND_COUNT);
    for (i = 0; i < TIMED; i++)
        printf("| %s | %.2f | %.2f |\n", timed[i], 1e3 * median(times[i]),
               median_ratio(times[i], times[PASS]));
    free(row_weights);
    free(importance);
    subject_free(s);
}

int main(int argc, char **argv)
{
    static subject s;
    static errors all[MAP_SET_MAX][ROWS];
    map_set set = map_set_find("halftone");
    double share[MAP_SET_MAX];
    int i, row;

    if (argc > 2 || (argc == 2 && strcmp(argv[1], "-q"))) {
        fprintf(stderr, "usage: halftone [-q]\n");
        return EXIT_FAILURE;
    }
    for (i = 0; i < set.count; i++) {
        if (!map_set_load(&set, i, &s.map) || !subject_make(&s))
            return EXIT_FAILURE;
        share[i] = largest_share(&s);
        for (row = 0; row < ROWS; row++)
            all[i][row] = measure(&s, row, i);
        subject_free(&s);
    }
    map_set_done(&set);
    print_cpu();
    print_compiler(BENCH_FLAGS);
    printf("%d maps: %s\n", set.count, map_set_kind(&set));
    print_irradiance((const errors (*)[ROWS])all, set.count);
    print_rectangles((const errors (*)[ROWS])all, set.count);
    print_maps(&set, (const errors (*)[ROWS])all, share);
    print_times(&s);
    if (argc == 1)
        print_counts(&set, &s);
    return EXIT_SUCCESS;
}
