/* light_sets.c: a map's directional lights without shadows, when the map turns, and interleaved.
 *
 *     light_sets     tables on stdout, progress on stderr; a minute
 *
 * Lobes: light x lobe, as 64 surfaces see it that nothing shades, from lights and from all texels.
 *
 * Stability: the map turned by a degree about +z, which is a shift by a fraction of a texel. Lights
 * of the map, turned by the same, are matched with those of the turned map so that the sum of
 * angles is least. How far a light went is told in radii of its cone, or of half a texel where the
 * cone is smaller.
 *
 * Interleaved sets: what a filter over a tile of 8 pixels shows where all of them see the same
 * point: the mean over 8 sets; and what it has to remove: the standard deviation among them. Beside
 * envsamp_lights_interleave the published way, every light of every set turned independently to a
 * place that is uniform in the same disc.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "../examples/common/irradiance.h"
#include "light_scene.h"
#include "map_set.h"

#define K_COUNT 3
#define LIGHTS_MAX 64
#define LOBES 3
#define NORMALS IRRADIANCE_NORMALS
#define RANDOM_SEEDS 8              /* of random lights, whose squares of errors are averaged */
#define TURN_DEGREES 1.0
#define SETS 8
#define SET_SEEDS 4
#define SET_LIGHTS 32
#define EXTENTS 3

static const int counts[K_COUNT] = { 16, 32, 64 };
static const int exponents[LOBES] = { 1, 8, 32 };       /* powers of two; 1: diffuse */
static const float extents[EXTENTS] = { 0.1f, 0.5f, 1.0f };

enum { RANDOM, HALFTONE, MEDIAN_CUT, VARIANCE_CUT, DECOMPOSED, RELAXED, METHODS };

static const struct { envsamp_lights_method method; const char *name; int interleaved; }
methods[METHODS] = {
    { ENVSAMP_LIGHTS_RANDOM, "random", 0 }, { ENVSAMP_LIGHTS_HALFTONE, "halftone", 1 },
    { ENVSAMP_LIGHTS_MEDIAN_CUT, "median cut", 0 },
    { ENVSAMP_LIGHTS_VARIANCE_CUT, "variance cut", 1 },
    { ENVSAMP_LIGHTS_DECOMPOSED, "decomposed", 1 }, { ENVSAMP_LIGHTS_RELAXED, "relaxed", 1 }
};

/* How the lights of a set are turned. */
enum { AS_THEY_ARE, AT_RANDOM, MATCHED, WAYS };

/* Light x lobe at every normal. */
typedef struct lobe_sums { double at[LOBES][NORMALS]; } lobe_sums;

/* How far lights went, in their radii. */
typedef struct drift { double ratio[MAP_SET_MAX][LIGHTS_MAX]; } drift;

/* Root mean squares over points, relative to their mean. */
typedef struct set_error { double error, noise; } set_error;

typedef struct results {
    double lobes[METHODS][LOBES][K_COUNT];              /* means over maps */
    drift turned[METHODS][K_COUNT], still[METHODS][K_COUNT];
    set_error sets[METHODS][WAYS][EXTENTS];             /* means over maps */
} results;

/* ---- lights ---- */

/* A method that makes no lights ends the program. */
static void make_lights(const image *map, int method, int count, uint32_t seed,
                        envsamp_light *lights)
{
    const envsamp_image view = bench_view(map);
    envsamp_lights_desc desc = envsamp_lights_defaults();
    envsamp_buffer scratch;
    envsamp_sizes sizes;
    envsamp_result result;

    desc.method = methods[method].method;
    desc.count = count;
    desc.seed = seed;
    envsamp_lights_sizes(&view, &desc, &sizes);
    scratch.bytes = sizes.scratch_bytes;
    scratch.data = bench_allocate(scratch.bytes);
    result = envsamp_lights(&view, &desc, lights, count, scratch, NULL);
    free(scratch.data);
    if (result != ENVSAMP_OK) {
        printf("%s: no %d lights: %s\n", methods[method].name, count,
               envsamp_result_string(result));
        exit(EXIT_FAILURE);
    }
}

/* ---- lobes without shadows ---- */

static void add_beam(lobe_sums *sums, const irradiance *e, const beam *b)
{
    int k, l, n;

    for (k = 0; k < NORMALS; k++) {
        double power = (double)dot3(e->normals[k], b->dir);

        if (power <= 0.0)
            continue;
        for (l = 0, n = 1; l < LOBES; l++) {
            for (; n < exponents[l]; n *= 2)
                power *= power;
            sums->at[l][k] += (double)b->light * (n + 1) / (2.0 * ENVSAMP__PI) * power;
        }
    }
}

static lobe_sums lobes_of_map(const irradiance *e, const image *map)
{
    lobe_sums sums = { { { 0.0 } } };
    int x, y;

    for (y = 0; y < map->height; y++)
        for (x = 0; x < map->width; x++) {
            const beam b = texel_beam(map, x, y);

            add_beam(&sums, e, &b);
        }
    return sums;
}

static lobe_sums lobes_of_lights(const irradiance *e, const envsamp_light *lights, int count)
{
    lobe_sums sums = { { { 0.0 } } };
    beam beams[LIGHTS_MAX];
    int i;

    light_beams(lights, count, beams);
    for (i = 0; i < count; i++)
        add_beam(&sums, e, &beams[i]);
    return sums;
}

static double lobe_rmse(const double *shown, const double *right)
{
    double squares = 0.0, sum = 0.0;
    int k;

    for (k = 0; k < NORMALS; k++) {
        squares += (shown[k] - right[k]) * (shown[k] - right[k]);
        sum += right[k];
    }
    return sqrt(squares * NORMALS) / sum;
}

/* Adds a map's errors to their means. */
static void measure_lobes(const image *map, const lobe_sums *right, const irradiance *e, int m,
                          int k, results *all, int map_count)
{
    const uint32_t seeds = m == RANDOM ? RANDOM_SEEDS : 1;
    double squares[LOBES] = { 0.0 };
    envsamp_light lights[LIGHTS_MAX];
    uint32_t seed;
    int l;

    for (seed = 0; seed < seeds; seed++) {
        lobe_sums shown;

        make_lights(map, m, counts[k], seeds > 1 ? seed + 1 : 0, lights);
        shown = lobes_of_lights(e, lights, counts[k]);
        for (l = 0; l < LOBES; l++) {
            const double rmse = lobe_rmse(shown.at[l], right->at[l]);

            squares[l] += rmse * rmse / seeds;
        }
    }
    for (l = 0; l < LOBES; l++)
        all->lobes[m][l][k] += sqrt(squares[l]) / map_count;
}

/* ---- a map that turns ---- */

/* Every texel's light goes to the two that it then covers, so that none is lost. */
static void turn_map(const image *map, double degrees, image *turned)
{
    const double texels = degrees / 360.0 * map->width;
    const int shift = (int)floor(texels), wide = map->width;
    const float part = (float)(texels - shift);
    int x, y, c;

    if (!image_alloc(turned, wide, map->height)) {
        printf("out of memory\n");
        exit(EXIT_FAILURE);
    }
    for (y = 0; y < map->height; y++)
        for (x = 0; x < wide; x++) {
            const float *row = map->rgb + 3 * (size_t)y * (size_t)wide;
            const float *left = row + 3 * ((x + 2 * wide - shift - 1) % wide);
            const float *here = row + 3 * ((x + 2 * wide - shift) % wide);
            float *out = turned->rgb + 3 * ((size_t)y * (size_t)wide + (size_t)x);

            for (c = 0; c < 3; c++)
                out[c] = (1.0f - part) * here[c] + part * left[c];
        }
}

static void turn_lights(envsamp_light *lights, int count, double degrees)
{
    const double s = sin(degrees * ENVSAMP__PI / 180.0), c = cos(degrees * ENVSAMP__PI / 180.0);
    int i;

    for (i = 0; i < count; i++) {
        const double x = (double)lights[i].dir[0], y = (double)lights[i].dir[1];

        lights[i].dir[0] = (float)(c * x - s * y);
        lights[i].dir[1] = (float)(s * x + c * y);
    }
}

/* By the chord, which is exactly zero between directions that are the same. */
static double angle_between(const float a[3], const float b[3])
{
    const double x = (double)(a[0] - b[0]), y = (double)(a[1] - b[1]), z = (double)(a[2] - b[2]);

    return 2.0 * asin(fmin(0.5 * sqrt(x * x + y * y + z * z), 1.0));
}

/* Two sets of lights, being matched. Row and column 0 stand for none. */
typedef struct matching {
    int count;
    double angle[LIGHTS_MAX + 1][LIGHTS_MAX + 1];
    double row_price[LIGHTS_MAX + 1], column_price[LIGHTS_MAX + 1];
    int row_of[LIGHTS_MAX + 1];         /* of each column; 0: free */
} matching;

/* From column `from`: lowers prices until another column costs nothing more, which it returns. */
static int next_column(matching *m, int from, double *slack, int *back, int *seen)
{
    const int row = m->row_of[from];
    double least = HUGE_VAL;
    int j, next = 0;

    seen[from] = 1;
    for (j = 1; j <= m->count; j++) {
        const double more = m->angle[row][j] - m->row_price[row] - m->column_price[j];

        if (seen[j])
            continue;
        if (more < slack[j]) {
            slack[j] = more;
            back[j] = from;
        }
        if (slack[j] < least) {
            least = slack[j];
            next = j;
        }
    }
    for (j = 0; j <= m->count; j++)
        if (seen[j]) {
            m->row_price[m->row_of[j]] += least;
            m->column_price[j] -= least;
        } else {
            slack[j] -= least;
        }
    return next;
}

/* The least sum of angles, row by row by a cheapest chain of changes [Kuhn 1955, Munkres 1957]. */
static void match(matching *m)
{
    int row, j;

    memset(m->row_price, 0, sizeof m->row_price);
    memset(m->column_price, 0, sizeof m->column_price);
    memset(m->row_of, 0, sizeof m->row_of);
    for (row = 1; row <= m->count; row++) {
        int back[LIGHTS_MAX + 1] = { 0 }, seen[LIGHTS_MAX + 1] = { 0 }, at = 0;
        double slack[LIGHTS_MAX + 1];

        for (j = 0; j <= m->count; j++)
            slack[j] = HUGE_VAL;
        m->row_of[0] = row;
        do
            at = next_column(m, at, slack, back, seen);
        while (m->row_of[at]);
        for (; at; at = back[at])
            m->row_of[at] = m->row_of[back[at]];
    }
}

/* Compares the lights of a map with those of the turned one. */
static void measure_drift(const image *map, const image *turned, double degrees, int method,
                          int count, double *ratios)
{
    static matching m;
    const double half_texel = 0.5 * ENVSAMP__PI / map->height;
    envsamp_light from[LIGHTS_MAX], to[LIGHTS_MAX];
    int i, j;

    make_lights(map, method, count, 0, from);
    make_lights(turned, method, count, 0, to);
    turn_lights(from, count, degrees);
    m.count = count;
    for (i = 0; i < count; i++)
        for (j = 0; j < count; j++)
            m.angle[i + 1][j + 1] = angle_between(from[i].dir, to[j].dir);
    match(&m);
    for (j = 1; j <= count; j++) {
        const envsamp_light *light = &from[m.row_of[j] - 1];
        const double cone = acos(fmax(fmin((double)light->cos_extent, 1.0), -1.0));

        ratios[j - 1] = m.angle[m.row_of[j]][j] / fmax(cone, half_texel);
    }
}

/* ---- interleaved sets ---- */

/* Turns a light to a place that is uniform in a disc about it. */
static void turn_at_random(envsamp_light *light, float extent, pcg32 *random)
{
    const double cone = acos(fmax(fmin((double)light->cos_extent, 1.0), -1.0));
    const double angle = cone * (double)extent * sqrt((double)pcg32_float(random));
    const double azimuth = 2.0 * ENVSAMP__PI * (double)pcg32_float(random);
    const float along = (float)cos(angle), c = (float)(sin(angle) * cos(azimuth));
    const float s = (float)(sin(angle) * sin(azimuth)), d[3] = { light->dir[0], light->dir[1],
                                                                 light->dir[2] };
    const int flat = fabsf(d[2]) < 0.9f;
    const float a[3] = { flat ? -d[1] : 0.0f, flat ? d[0] : -d[2], flat ? 0.0f : d[1] };
    const float b[3] = { d[1] * a[2] - d[2] * a[1], d[2] * a[0] - d[0] * a[2],
                         d[0] * a[1] - d[1] * a[0] };
    const float length = sqrtf(dot3(a, a));
    int i;

    for (i = 0; i < 3; i++)
        light->dir[i] = along * d[i] + (c * a[i] + s * b[i]) / length;
}

static void turn_set(const envsamp_light *lights, int way, int set, float extent, uint32_t seed,
                     envsamp_light *out)
{
    pcg32 random = pcg32_make(seed, (uint64_t)set);
    int i;

    memcpy(out, lights, SET_LIGHTS * sizeof *out);
    if (way == MATCHED)
        envsamp_lights_interleave(lights, SET_LIGHTS, set, SETS, extent, seed, out);
    for (i = 0; i < SET_LIGHTS && way == AT_RANDOM; i++)
        turn_at_random(&out[i], extent, &random);
}

/* Of 8 pictures of the scene: the error of their mean, and how much they differ. */
static set_error compare_sets(const scene *view, float (*shown)[COLUMNS * ROWS], const float *right)
{
    static float mean[COLUMNS * ROWS];
    double spread = 0.0, sum = 0.0;
    set_error e;
    int i, set;

    for (i = 0; i < view->count; i++) {
        double all = 0.0;

        for (set = 0; set < SETS; set++)
            all += (double)shown[set][i] / SETS;
        for (set = 0; set < SETS; set++)
            spread += ((double)shown[set][i] - all) * ((double)shown[set][i] - all) / SETS;
        mean[i] = (float)all;
        sum += all;
    }
    e.error = relative_rmse(view, mean, right);
    e.noise = sum > 0.0 ? sqrt(spread * view->count) / sum : 0.0;
    return e;
}

/* Root mean squares over the seeds. */
static set_error measure_sets(const scene *view, const float *right, const envsamp_light *lights,
                              int way, float extent)
{
    static float shown[SETS][COLUMNS * ROWS];
    const uint32_t seeds = way == AS_THEY_ARE ? 1 : SET_SEEDS;
    set_error mean = { 0.0, 0.0 };
    uint32_t seed;
    int set;

    for (seed = 1; seed <= seeds; seed++) {
        set_error e;

        for (set = 0; set < SETS; set++) {
            envsamp_light turned[SET_LIGHTS];
            beam beams[SET_LIGHTS];

            turn_set(lights, way, set, extent, seed, turned);
            shade(view, beams, light_beams(turned, SET_LIGHTS, beams), shown[set]);
        }
        e = compare_sets(view, shown, right);
        mean.error += e.error * e.error / seeds;
        mean.noise += e.noise * e.noise / seeds;
    }
    mean.error = sqrt(mean.error);
    mean.noise = sqrt(mean.noise);
    return mean;
}

/* Adds a map's errors to their means. Lights as they are know no extent. */
static void measure_ways(const scene *view, const float *right, const envsamp_light *lights,
                         set_error (*sets)[EXTENTS], int map_count)
{
    int way, i;

    for (way = 0; way < WAYS; way++)
        for (i = 0; i < (way == AS_THEY_ARE ? 1 : EXTENTS); i++) {
            const set_error e = measure_sets(view, right, lights, way, extents[i]);

            sets[way][i].error += e.error / map_count;
            sets[way][i].noise += e.noise / map_count;
        }
}

/* ---- all of a map ---- */

static void measure_map_lobes(const image *map, results *all, int map_count)
{
    irradiance e;
    lobe_sums right;
    int m, k;

    irradiance_normals(&e);
    right = lobes_of_map(&e, map);
    for (m = 0; m < METHODS; m++)
        for (k = 0; k < K_COUNT; k++)
            measure_lobes(map, &right, &e, m, k, all, map_count);
}

static void measure_map_drift(const image *map, results *all, int index)
{
    image turned, still;
    int m, k;

    turn_map(map, TURN_DEGREES, &turned);
    turn_map(map, 0.0, &still);
    for (m = 0; m < METHODS; m++)
        for (k = 0; k < K_COUNT; k++) {
            measure_drift(map, &turned, TURN_DEGREES, m, counts[k],
                          all->turned[m][k].ratio[index]);
            measure_drift(map, &still, 0.0, m, counts[k], all->still[m][k].ratio[index]);
        }
    image_free(&turned);
    image_free(&still);
}

static void measure_map_sets(const image *map, const scene *view, results *all,
                             int map_count)
{
    static float right[COLUMNS * ROWS];
    beam *beams = bench_allocate((size_t)map->width * (size_t)map->height * sizeof *beams);
    envsamp_light lights[SET_LIGHTS];
    int m;

    shade(view, beams, map_beams(map, beams), right);
    free(beams);
    for (m = 0; m < METHODS; m++)
        if (methods[m].interleaved) {
            make_lights(map, m, SET_LIGHTS, 0, lights);
            measure_ways(view, right, lights, all->sets[m], map_count);
        }
}

/* ---- tables ---- */

static int ascending(const void *a, const void *b)
{
    const double left = *(const double *)a, right = *(const double *)b;

    return (left > right) - (left < right);
}

/* Sorts the values. */
static double middle(double *values, int count)
{
    qsort(values, (size_t)count, sizeof *values, ascending);
    return 0.5 * (values[(count - 1) / 2] + values[count / 2]);
}

static void print_lobes(const map_set *set, const results *all)
{
    int m, l, k;

    printf("Light x lobe at %d normals without shadows, diffuse and cos^n, for 16, 32 and 64"
           " lights:\nmean relative RMSE over %d maps, %s\n\n"
           "| | diffuse, 16 | 32 | 64 | n = 8, 16 | 32 | 64 | n = 32, 16 | 32 | 64 |\n"
           "|---|---|---|---|---|---|---|---|---|---|\n", NORMALS, set->count, map_set_kind(set));
    for (m = 0; m < METHODS; m++) {
        printf("| %s |", methods[m].name);
        for (l = 0; l < LOBES; l++)
            for (k = 0; k < K_COUNT; k++)
                printf(" %.4f |", all->lobes[m][l][k]);
        printf("\n");
    }
}

/* One row: medians over all lights and over those of a map. Sorts the ratios of each map. */
static void print_drift(const map_set *set, const char *name, int count, drift *d)
{
    static double every[MAP_SET_MAX * LIGHTS_MAX];
    double mean = 0.0, worst = -1.0;
    int i, least = 0, worst_map = 0;

    for (i = 0; i < set->count; i++) {
        double of_map;

        memcpy(every + i * count, d->ratio[i], (size_t)count * sizeof *every);
        of_map = middle(d->ratio[i], count);
        mean += of_map / set->count;
        least += of_map < 0.25;
        if (of_map > worst) {
            worst = of_map;
            worst_map = i;
        }
    }
    printf("| %s | %d | %.3f | %.3f | %.3f | %s | %d |\n", name, count,
           middle(every, set->count * count), mean, worst, map_set_name(set, worst_map), least);
}

static double greatest(const map_set *set, results *all)
{
    double most = 0.0;
    int m, k, i, j;

    for (m = 0; m < METHODS; m++)
        for (k = 0; k < K_COUNT; k++)
            for (i = 0; i < set->count; i++)
                for (j = 0; j < counts[k]; j++)
                    most = fmax(most, all->still[m][k].ratio[i][j]);
    return most;
}

static void print_stability(const map_set *set, results *all)
{
    int m, k;

    printf("\nThe map turned by %g degree: how far lights go, in radii of their cones. Median of"
           " all\nlights, mean and largest median of a map, maps of %d with a median below 1/4\n\n"
           "| | lights | median | mean of maps | worst map | which | maps below 1/4 |\n"
           "|---|---|---|---|---|---|---|\n", TURN_DEGREES, set->count);
    for (m = 0; m < METHODS; m++)
        for (k = 0; k < K_COUNT; k++)
            print_drift(set, methods[m].name, counts[k], &all->turned[m][k]);
    printf("\nWithout a turn, the largest of all lights: %g\n", greatest(set, all));
}

static void print_extents(void)
{
    int way, i;

    printf("| | as they are |");
    for (way = AT_RANDOM; way < WAYS; way++)
        for (i = 0; i < EXTENTS; i++)
            printf(" %s%.2g |", i ? "" : way == AT_RANDOM ? "at random, " : "interleaved, ",
                   (double)extents[i]);
    printf("\n|---|---|");
    for (i = 0; i < 2 * EXTENTS; i++)
        printf("---|");
    printf("\n");
}

static void print_sets(const map_set *set, results *all)
{
    int m, what, way, i;

    printf("\n%d sets of %d lights in a scene with shadows, by extent of turns: mean over %d maps"
           " of\nthe relative RMSE of the mean of the sets, and of the deviation among them\n\n",
           SETS, SET_LIGHTS, set->count);
    print_extents();
    for (m = 0; m < METHODS; m++)
        for (what = 0; what < 2 && methods[m].interleaved; what++) {
            printf("| %s, %s |", methods[m].name, what ? "deviation" : "error");
            for (way = 0; way < WAYS; way++)
                for (i = 0; i < (way == AS_THEY_ARE ? 1 : EXTENTS); i++)
                    printf(" %.4f |", what ? all->sets[m][way][i].noise
                                           : all->sets[m][way][i].error);
            printf("\n");
        }
}

int main(void)
{
    static scene view;
    static results all;
    map_set set = map_set_find("light_sets");
    int i;

    scene_make(&view);
    for (i = 0; i < set.count; i++) {
        image map;

        if (!map_set_load(&set, i, &map))
            return EXIT_FAILURE;
        image_clean(&map);
        measure_map_lobes(&map, &all, set.count);
        measure_map_drift(&map, &all, i);
        measure_map_sets(&map, &view, &all, set.count);
        image_free(&map);
    }
    map_set_done(&set);
    print_lobes(&set, &all);
    print_stability(&set, &all);
    print_sets(&set, &all);
    return EXIT_SUCCESS;
}
