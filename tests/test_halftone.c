/* test_halftone.c: as many texels as are asked for, and just those that a plain scan chooses by the
 * kernels as published; density even, from the first texel on; RANDOM draws independently; bad
 * input is refused and touches nothing. Each statistical check beside controls that it must reject.
 *
 *     test_halftone [quick]       quick: without the long ones, for slow tools
 */
#include "check.h"

#include "../envsamp.h"

#include "kd_fixture.h"
#include "kd_reference.h"
#include "statistics.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"

#include <float.h>
#include <limits.h>

#define RUBBISH 0x5a            /* what texels are filled with before a call */
#define WIDTH 512               /* of the maps */
#define HEIGHT 256
#define MADE_UP 5
#define KERNELS ENVSAMP_KERNEL_RANDOM       /* those that diffuse */

static const char *const kernel_names[KERNELS + 1] = {
    "Szirmay-Kalos", "Floyd-Steinberg", "Jarvis", "Stucki", "Ostromoukhov", "random"
};
static const char *const scan_names[2] = { "cells", "texels" };

/* ---- importance maps ---- */

typedef struct chart {
    const char *name;
    float *value;
    int width, height, lit;
    double total, largest;
} chart;

static chart chart_make(const char *name, int width, int height)
{
    chart c;

    memset(&c, 0, sizeof c);
    c.name = name;
    c.width = width;
    c.height = height;
    c.value = (float *)kd_allocate((size_t)width * (size_t)height * sizeof *c.value);
    return c;
}

/* To be called when its values are changed. */
static void chart_sum(chart *c)
{
    int i;

    c->total = c->largest = 0.0;
    c->lit = 0;
    for (i = 0; i < c->width * c->height; i++) {
        const double value = (double)c->value[i];

        c->total += value;
        c->largest = value > c->largest ? value : c->largest;
        c->lit += value > 0.0;
    }
}

/* Luminance times solid angle of a map, which is freed. */
static chart chart_of_image(const char *name, image *map)
{
    const envsamp_image view = kd_image(map->rgb, map->width, map->height, 3);
    chart c = chart_make(name, map->width, map->height);
    int x, y;

    for (y = 0; y < c.height; y++) {
        const double sr = kd_solid_angle(c.width, c.height, 0, y, 1, y + 1);

        for (x = 0; x < c.width; x++)
            c.value[y * c.width + x] = (float)(kd_texel(&view, x, y) * sr);
    }
    chart_sum(&c);
    image_free(map);
    return c;
}

static chart chart_made_up(const char *name, int width, int height)
{
    image map;

    if (!map_make(name, width, height, &map)) {
        printf("Bail out! out of memory\n");
        exit(1);
    }
    return chart_of_image(name, &map);
}

/* Whole numbers of 1 to 999, so that sums are exact, some of them replaced by 0. */
static chart chart_random(const char *name, int width, int height, double black)
{
    pcg32 random = pcg32_make((uint64_t)width, (uint64_t)height);
    chart c = chart_make(name, width, height);
    int i;

    for (i = 0; i < width * height; i++) {
        c.value[i] = (float)(1 + pcg32_next(&random) % 999);
        if ((double)pcg32_float(&random) < black)
            c.value[i] = 0.0f;
    }
    chart_sum(&c);
    return c;
}

/* A lamp, so that some cells are worth many samples. */
static chart chart_lamp(int width, int height)
{
    chart c = chart_random("a lamp", width, height, 0.1);
    int x, y;

    for (y = height / 3; y < height / 2; y++)
        for (x = width / 2; x < width * 2 / 3; x++)
            c.value[y * width + x] *= 100.0f;
    chart_sum(&c);
    return c;
}

static chart chart_even(int width, int height, float value)
{
    chart c = chart_make("constant", width, height);
    int i;

    for (i = 0; i < width * height; i++)
        c.value[i] = value;
    chart_sum(&c);
    return c;
}

/* The made-up maps, and the real ones that are there. */
static chart maps[MADE_UP + REAL_MAP_COUNT];
static int map_count;

static void maps_make(void)
{
    image map;
    int i;

    for (i = 0; map_names[i]; i++)
        maps[map_count++] = chart_made_up(map_names[i], WIDTH, HEIGHT);
    for (i = 0; i < REAL_MAP_COUNT; i++)
        if (real_map_read(i, &map))
            maps[map_count++] = chart_of_image(real_map_name(i), &map);
    if (map_count == MADE_UP)
        CHECK_SKIP("no real maps: make data fetches them");
}

static void maps_free(void)
{
    while (map_count)
        free(maps[--map_count].value);
}

/* ---- one call, in buffers of exactly the size asked for ---- */

typedef struct draw {
    kd_guarded texels, scratch;
    const envsamp_texel *texel;
    envsamp_sizes sizes;
    envsamp_result result;
    int count;
} draw;

static envsamp_halftone_desc describe(int count, int kernel, int scan, int repeat, uint32_t seed)
{
    envsamp_halftone_desc desc;

    memset(&desc, 0, sizeof desc);
    desc.count = count;
    desc.kernel = (envsamp_kernel)kernel;
    desc.seed = seed;
    desc.scan = (envsamp_scan)scan;
    desc.once = !repeat;
    return desc;
}

/* Calls with scratch that is full of this rubbish. */
static draw draw_make_in(const chart *c, const envsamp_halftone_desc *desc, int rubbish)
{
    draw d;

    memset(&d, 0, sizeof d);
    d.count = -1;
    d.result = envsamp_halftone_sizes(c->width, c->height, desc, &d.sizes);
    d.texels = kd_guarded_make((size_t)desc->count * sizeof *d.texel, RUBBISH);
    d.scratch = kd_guarded_make(d.sizes.scratch_bytes, rubbish);
    d.texel = (const envsamp_texel *)d.texels.buffer.data;
    if (d.result == ENVSAMP_OK)
        d.result = envsamp_halftone(c->value, c->width, c->height, 0, desc,
                                    (envsamp_texel *)d.texels.buffer.data, desc->count, &d.count,
                                    d.scratch.buffer);
    return d;
}

static draw draw_make(const chart *c, const envsamp_halftone_desc *desc)
{
    return draw_make_in(c, desc, 0xc3);
}

static void draw_free(draw *d)
{
    free(d->texels.block);
    free(d->scratch.block);
}

static int all_rubbish(const void *data, size_t bytes)
{
    const unsigned char *byte = (const unsigned char *)data;

    return !bytes || (byte[0] == RUBBISH && !memcmp(byte, byte + 1, bytes - 1));
}

/* ---- the path ---- */

/* M, or as many as there are to choose. */
static int expected_count(const chart *c, const envsamp_halftone_desc *desc)
{
    return !desc->once || desc->count < c->lit ? desc->count : c->lit;
}

/* Cells: two a sample on average and about square, or texels; of RANDOM bands of 16 rows. */
typedef struct grid { int width, height, across, down; } grid;

static grid grid_of(int width, int height, const envsamp_halftone_desc *desc)
{
    double side = sqrt((double)width * (double)height / (2.0 * (double)desc->count));
    grid g;

    side = desc->kernel == ENVSAMP_KERNEL_RANDOM ? 16.0
         : desc->scan == ENVSAMP_SCAN_TEXELS || side < 1.0 ? 1.0 : side;
    g.width = width;
    g.height = height;
    g.across = desc->kernel == ENVSAMP_KERNEL_RANDOM ? 1 : (int)((double)width / side);
    g.down = (int)((double)height / side);
    g.across = g.across > 1 ? g.across : 1;
    g.down = g.down > 1 ? g.down : 1;
    return g;
}

/* Where part `index` of `count` begins. */
static int edge_of(int index, int count, int length)
{
    return (int)((long long)index * length / count);
}

/* A cell: which one in its row of cells, its texels, and the direction of the scan. */
typedef struct cell {
    int index, strip, step;
    int x0, y0, x1, y1;
    int bands;
    double importance;
} cell;

/* The turn-th cell of a row of them, which are walked to and fro. One that is worth n >= 2 samples
   is walked in 2 floor(sqrt(n / 2)) + 1 bands, or as many as it has rows, an odd number. */
static cell cell_of(const chart *c, const envsamp_halftone_desc *desc, const grid *g, int strip,
                    int turn)
{
    double worth;
    cell k;
    int x, y;

    k.strip = strip;
    k.step = strip % 2 ? -1 : 1;
    k.index = strip % 2 ? g->across - 1 - turn : turn;
    k.x0 = edge_of(k.index, g->across, g->width);
    k.x1 = edge_of(k.index + 1, g->across, g->width);
    k.y0 = edge_of(strip, g->down, g->height);
    k.y1 = edge_of(strip + 1, g->down, g->height);
    k.importance = 0.0;
    for (y = k.y0; y < k.y1; y++)
        for (x = k.x0; x < k.x1; x++)
            k.importance += (double)c->value[y * c->width + x];
    worth = k.importance / (c->total / (double)expected_count(c, desc));
    k.bands = worth < 2.0 || desc->kernel == ENVSAMP_KERNEL_RANDOM
            ? 1 : 2 * (int)sqrt(worth / 2.0) + 1;
    if (k.bands > k.y1 - k.y0)
        k.bands = (k.y1 - k.y0 - 1) / 2 * 2 + 1;
    return k;
}

/* Lists the texels of a cell in the order of the scan, y width + x: bands to and fro, and in each
   columns down and up, down first. Returns how many. */
static int cell_path(const cell *k, int width, int *path)
{
    int band, i, j, count = 0;

    for (band = 0; band < k->bands; band++) {
        const int right = band % 2 ? k->step < 0 : k->step > 0;
        const int top = k->y0 + edge_of(band, k->bands, k->y1 - k->y0);
        const int end = k->y0 + edge_of(band + 1, k->bands, k->y1 - k->y0);

        for (i = 0; i < k->x1 - k->x0; i++)
            for (j = 0; j < end - top; j++) {
                const int x = right ? k->x0 + i : k->x1 - 1 - i;

                path[count++] = ((i + k->strip) % 2 ? end - 1 - j : top + j) * width + x;
            }
    }
    return count;
}

/* Room for the path of any cell. */
static int *path_make(const chart *c)
{
    return (int *)kd_allocate((size_t)c->width * (size_t)c->height * sizeof(int));
}

/* ---- counts ---- */

/* Whether a chosen texel is one: in the map, above zero, of the right probability. */
static int texel_sound(const envsamp_texel *t, const chart *c)
{
    double value, share;

    if (t->x < 0 || t->x >= c->width || t->y < 0 || t->y >= c->height)
        return 0;
    value = (double)c->value[t->y * c->width + t->x];
    share = fmax(value / c->total, (double)FLT_MIN);    /* never 0, as it divides */
    return value > 0.0 && fabs((double)t->probability - share) <= 1e-7 * share;
}

/* Whether a draw is in the order of the scan; so none is twice in it, but where that may be. */
static int in_order(const draw *d, const chart *c, const envsamp_halftone_desc *desc)
{
    const int twice = !desc->once || desc->kernel == ENVSAMP_KERNEL_RANDOM;
    const grid g = grid_of(c->width, c->height, desc);
    int *path = path_make(c), strip, turn, i, seen = 0;

    for (strip = 0; strip < g.down; strip++)
        for (turn = 0; turn < g.across && seen < d->count; turn++) {
            const cell k = cell_of(c, desc, &g, strip, turn);
            const int count = cell_path(&k, c->width, path);

            for (i = 0; i < count && seen < d->count; i++) {
                const int first = seen;

                while (seen < d->count && (twice || seen == first)
                       && d->texel[seen].y * c->width + d->texel[seen].x == path[i])
                    seen++;
            }
        }
    free(path);
    return seen == d->count;
}

/* Whether a draw is right but for its choice: how many, all sound and in order, and nothing written
   beyond. */
static int draw_sound(const draw *d, const chart *c, const envsamp_halftone_desc *desc)
{
    int i;

    if (d->result != ENVSAMP_OK || d->count != expected_count(c, desc) || d->sizes.table_bytes
        || !kd_guarded_intact(&d->texels) || !kd_guarded_intact(&d->scratch))
        return 0;
    for (i = 0; i < d->count; i++)
        if (!texel_sound(&d->texel[i], c))
            return 0;
    return in_order(d, c, desc)
        && all_rubbish(d->texel + d->count, (size_t)(desc->count - d->count) * sizeof *d->texel);
}

static int call_sound(const chart *c, int count, int kernel, int scan, int repeat, uint32_t seed)
{
    const envsamp_halftone_desc desc = describe(count, kernel, scan, repeat, seed);
    draw d = draw_make(c, &desc);
    const int sound = draw_sound(&d, c, &desc);

    draw_free(&d);
    return sound;
}

/* RANDOM has no cells, and `repeat` only tells it how many to draw where few texels are lit. */
static int scans_of(int kernel)
{
    return kernel == ENVSAMP_KERNEL_RANDOM ? 1 : 2;
}

static int least_repeat(int kernel)
{
    return kernel == ENVSAMP_KERNEL_RANDOM;
}

/* How many of M from `first` to 4096, in steps, are wrong; half have an error at the start. */
static int wrong_counts(const chart *c, int kernel, int scan, int repeat, int first, int step)
{
    int count, wrong = 0;

    for (count = first; count <= 4096; count += step)
        wrong += !call_sound(c, count, kernel, scan, repeat,
                             count / 2 % 2 ? 0u : hash_u32((uint32_t)count));
    return wrong;
}

/* What is left of the error in the black rows below cannot be chosen there. */
static chart chart_half_black(void)
{
    chart c = chart_random("lower half black", 24, 20, 0.1);

    memset(c.value + 9 * 24, 0, 11 * 24 * sizeof *c.value);
    chart_sum(&c);
    return c;
}

/* Every count in two small maps, every seventh in a row and a column. */
static void test_counts(int kernel, int scan)
{
    chart small[4];
    int i, repeat, step;

    small[0] = chart_random("a third black", 17, 13, 0.33);
    small[1] = chart_half_black();
    small[2] = chart_random("a row", 50, 1, 0.1);
    small[3] = chart_random("a column", 1, 40, 0.1);
    for (i = 0; i < 4; i++) {
        int wrong = 0;

        step = i < 2 ? 1 : 7;
        for (repeat = least_repeat(kernel); repeat < 2; repeat++)
            wrong += wrong_counts(&small[i], kernel, scan, repeat, 1, step);
        CHECK(wrong == 0, "%s, %s, %s: of M from 1 to 4096 in steps of %d %d are wrong",
              small[i].name, kernel_names[kernel], scan_names[scan], step, wrong);
        free(small[i].value);
    }
}

/* Every count, odd ones repeating; with diffusion over texels, which takes long, every 13th. */
static void test_counts_of_one(int kernel, int scan)
{
    const int step = scan == ENVSAMP_SCAN_TEXELS ? 13 : 1;
    chart c = chart_made_up(map_names[kernel % MADE_UP], 128, 64);
    const int wrong = wrong_counts(&c, kernel, scan, 1, 1, 2 * step)
                    + wrong_counts(&c, kernel, scan, 0, 1 + step, 2 * step);

    CHECK(wrong == 0, "%s, 128x64, %s, %s: of M from 1 to 4096 in steps of %d %d are wrong",
          c.name, kernel_names[kernel], scan_names[scan], step, wrong);
    free(c.value);
}

static void test_counts_of_maps(int kernel, int scan)
{
    static const int counts[] = { 1, 2, 3, 16, 31, 32, 64, 256, 1000, 1024, 4095, 4096 };
    int map, k, repeat, wrong = 0, calls = 0;

    for (map = 0; map < map_count; map++)
        for (k = 0; k < (int)(sizeof counts / sizeof *counts); k++)
            for (repeat = least_repeat(kernel); repeat < 2; repeat++)
                if (scan == ENVSAMP_SCAN_CELLS || (k + map + repeat) % 12 == 0) {
                    wrong += !call_sound(&maps[map], counts[k], kernel, scan, repeat,
                                         (uint32_t)((k + map) % 3));
                    calls++;
                }
    CHECK(wrong == 0, "%d maps, %s, %s: %d of %d are wrong", map_count, kernel_names[kernel],
          scan_names[scan], wrong, calls);
}

/* ---- a plain scan ---- */

/* What is sent from the cell in the middle of the first row while the scan goes to the right. */
typedef struct weights { double row[3][5]; } weights;

/* Szirmay-Kalos et al. 2009; Floyd, Steinberg 1976; Jarvis, Judice, Ninke 1976; Stucki 1981. */
static const weights published[4] = {
    { { { 0, 0, 0, 3, 0 }, { 0, 0, 3, 2, 0 } } },
    { { { 0, 0, 0, 7, 0 }, { 0, 3, 5, 1, 0 } } },
    { { { 0, 0, 0, 7, 5 }, { 3, 5, 7, 5, 3 }, { 1, 3, 5, 3, 1 } } },
    { { { 0, 0, 0, 8, 4 }, { 2, 4, 8, 4, 2 }, { 1, 2, 4, 2, 1 } } }
};

/* Ostromoukhov 2001: ahead, behind below and below, for each of 256 levels, of which the upper half
   is the lower one backwards. */
static const short variable[128][3] = {
    { 13, 0, 5 }, { 13, 0, 5 }, { 21, 0, 10 }, { 7, 0, 4 }, { 8, 0, 5 }, { 47, 3, 28 },
    { 23, 3, 13 }, { 15, 3, 8 }, { 22, 6, 11 }, { 43, 15, 20 }, { 7, 3, 3 }, { 501, 224, 211 },
    { 249, 116, 103 }, { 165, 80, 67 }, { 123, 62, 49 }, { 489, 256, 191 }, { 81, 44, 31 },
    { 483, 272, 181 }, { 60, 35, 22 }, { 53, 32, 19 }, { 237, 148, 83 }, { 471, 304, 161 },
    { 3, 2, 1 }, { 481, 314, 185 }, { 354, 226, 155 }, { 1389, 866, 685 }, { 227, 138, 125 },
    { 267, 158, 163 }, { 327, 188, 220 }, { 61, 34, 45 }, { 627, 338, 505 }, { 1227, 638, 1075 },
    { 20, 10, 19 }, { 1937, 1000, 1767 }, { 977, 520, 855 }, { 657, 360, 551 }, { 71, 40, 57 },
    { 2005, 1160, 1539 }, { 337, 200, 247 }, { 2039, 1240, 1425 }, { 257, 160, 171 },
    { 691, 440, 437 }, { 1045, 680, 627 }, { 301, 200, 171 }, { 177, 120, 95 },
    { 2141, 1480, 1083 }, { 1079, 760, 513 }, { 725, 520, 323 }, { 137, 100, 57 },
    { 2209, 1640, 855 }, { 53, 40, 19 }, { 2243, 1720, 741 }, { 565, 440, 171 }, { 759, 600, 209 },
    { 1147, 920, 285 }, { 2311, 1880, 513 }, { 97, 80, 19 }, { 335, 280, 57 }, { 1181, 1000, 171 },
    { 793, 680, 95 }, { 599, 520, 57 }, { 2413, 2120, 171 }, { 405, 360, 19 }, { 2447, 2200, 57 },
    { 11, 10, 0 }, { 158, 151, 3 }, { 178, 179, 7 }, { 1030, 1091, 63 }, { 248, 277, 21 },
    { 318, 375, 35 }, { 458, 571, 63 }, { 878, 1159, 147 }, { 5, 7, 1 }, { 172, 181, 37 },
    { 97, 76, 22 }, { 72, 41, 17 }, { 119, 47, 29 }, { 4, 1, 1 }, { 4, 1, 1 }, { 4, 1, 1 },
    { 4, 1, 1 }, { 4, 1, 1 }, { 4, 1, 1 }, { 4, 1, 1 }, { 4, 1, 1 }, { 4, 1, 1 }, { 65, 18, 17 },
    { 95, 29, 26 }, { 185, 62, 53 }, { 30, 11, 9 }, { 35, 14, 11 }, { 85, 37, 28 }, { 55, 26, 19 },
    { 80, 41, 29 }, { 155, 86, 59 }, { 5, 3, 2 }, { 5, 3, 2 }, { 5, 3, 2 }, { 5, 3, 2 },
    { 5, 3, 2 }, { 5, 3, 2 }, { 5, 3, 2 }, { 5, 3, 2 }, { 5, 3, 2 }, { 5, 3, 2 }, { 5, 3, 2 },
    { 5, 3, 2 }, { 5, 3, 2 }, { 305, 176, 119 }, { 155, 86, 59 }, { 105, 56, 39 }, { 80, 41, 29 },
    { 65, 32, 23 }, { 55, 26, 19 }, { 335, 152, 113 }, { 85, 37, 28 }, { 115, 48, 37 },
    { 35, 14, 11 }, { 355, 136, 109 }, { 30, 11, 9 }, { 365, 128, 107 }, { 185, 62, 53 },
    { 25, 8, 7 }, { 95, 29, 26 }, { 385, 112, 103 }, { 65, 18, 17 }, { 395, 104, 101 }, { 4, 1, 1 }
};

/* One of the three, evenly between two levels. */
static double variable_share(double level, int which)
{
    const int low = (int)level, high = low < 255 ? low + 1 : 255;
    const short *a = variable[low < 128 ? low : 255 - low];
    const short *b = variable[high < 128 ? high : 255 - high];
    const double t = level - (double)low;

    return (1.0 - t) * (double)a[which] / (double)(a[0] + a[1] + a[2])
         + t * (double)b[which] / (double)(b[0] + b[1] + b[2]);
}

/* Shares of the error of a texel, which sum to 1. */
static weights weights_of(const envsamp_halftone_desc *desc, double level)
{
    double sum[3] = { 0.0, 0.0, 0.0 }, below;
    weights w;
    int i, k;

    memset(&w, 0, sizeof w);
    if (desc->kernel == ENVSAMP_KERNEL_OSTROMOUKHOV) {
        w.row[0][3] = variable_share(level, 0);
        w.row[1][1] = variable_share(level, 1);
        w.row[1][2] = variable_share(level, 2);
    } else {
        w = published[desc->kernel];
    }
    for (k = 0; k < 3; k++)
        for (i = 0; i < 5; i++)
            sum[k] += w.row[k][i];
    below = (sum[1] + sum[2]) / (sum[0] + sum[1] + sum[2]);
    for (k = 0; k < 3; k++)
        for (i = 0; i < 5; i++)
            w.row[k][i] *= k ? below / (sum[1] + sum[2]) : (1.0 - below) / sum[0];
    return w;
}

/* A scan on its way. */
typedef struct plain {
    const chart *c;
    const envsamp_halftone_desc *desc;
    grid g;
    double quantum;             /* S/M */
    double sum;                 /* what was passed and not yet chosen */
    double *waiting;            /* errors sent to cells */
    envsamp_texel *texel;
    int wanted, chosen, lit;    /* lit: still to come */
} plain;

static void plain_texel(plain *p, int x, int y)
{
    const double value = (double)p->c->value[y * p->c->width + x];
    int more = value > 0.0;

    p->sum += value;
    p->lit -= value > 0.0;
    while (more && p->chosen < p->wanted
           && (p->sum > 0.5 * p->quantum
               || (p->desc->once && p->lit < p->wanted - p->chosen))) {
        p->texel[p->chosen].x = x;
        p->texel[p->chosen++].y = y;
        p->sum -= p->quantum;
        more = !p->desc->once;
    }
}

/* With CELLS the next one gets all: at the end of a row, the one below. */
static void plain_pass(plain *p, const cell *from)
{
    const int to = from->index + from->step, at = from->strip * p->g.across;

    if (to >= 0 && to < p->g.across)
        p->waiting[at + to] += p->sum;
    else if (from->strip + 1 < p->g.down)
        p->waiting[at + p->g.across + from->index] += p->sum;
}

/* Sends the error of a texel on; what would leave the map goes to the others. */
static void plain_send(plain *p, const cell *from)
{
    const double worth = from->importance / p->quantum;
    const weights w = weights_of(p->desc, 255.0 * (worth < 1.0 ? worth : 1.0));
    double inside = 0.0;
    int pass, i, k;

    for (pass = 0; pass < 2; pass++)
        for (k = 0; k < 3 && from->strip + k < p->g.down; k++)
            for (i = 0; i < 5; i++) {
                const int to = from->index + from->step * (i - 2);

                if (to < 0 || to >= p->g.across)
                    continue;
                if (pass && inside > 0.0)
                    p->waiting[(from->strip + k) * p->g.across + to]
                        += p->sum * w.row[k][i] / inside;
                else
                    inside += w.row[k][i];
            }
}

/* Chooses into `texel`, which has room for desc->count. `start` is the error at the start in parts
   of S/M. Returns how many. */
static int plain_scan(const chart *c, const envsamp_halftone_desc *desc, double start,
                      envsamp_texel *texel)
{
    int *path = path_make(c), strip, turn, i;
    plain p;

    memset(&p, 0, sizeof p);
    p.c = c;
    p.desc = desc;
    p.g = grid_of(c->width, c->height, desc);
    p.texel = texel;
    p.wanted = expected_count(c, desc);
    p.lit = c->lit;
    p.quantum = c->total / (double)p.wanted;
    p.waiting = (double *)kd_allocate((size_t)p.g.across * (size_t)p.g.down * sizeof(double));
    p.waiting[0] = start * p.quantum;
    for (strip = 0; strip < p.g.down; strip++)
        for (turn = 0; turn < p.g.across; turn++) {
            const cell k = cell_of(c, desc, &p.g, strip, turn);
            const int count = cell_path(&k, c->width, path);

            p.sum = p.waiting[strip * p.g.across + k.index];
            for (i = 0; i < count; i++)
                plain_texel(&p, path[i] % c->width, path[i] / c->width);
            if (desc->scan == ENVSAMP_SCAN_CELLS)
                plain_pass(&p, &k);
            else
                plain_send(&p, &k);
        }
    free(p.waiting);
    free(path);
    return p.chosen;
}

/* Whether a draw is that of a plain scan. With `repeat` an error may be left over where the end of
   the scan is black; then the last are what they may be, with CELLS two at most. */
static int same_choice(const draw *d, const chart *c, const envsamp_halftone_desc *desc,
                       const envsamp_texel *texel, int count)
{
    const int rest = d->count - count;
    int i;

    if (!draw_sound(d, c, desc) || rest < 0 || (rest && desc->once)
        || (rest > 2 && desc->scan == ENVSAMP_SCAN_CELLS))
        return 0;
    for (i = 0; i < count; i++)
        if (d->texel[i].x != texel[i].x || d->texel[i].y != texel[i].y)
            return 0;
    return 1;
}

/* Whether a draw is that of a plain scan by another description. */
static int as_plain(const chart *c, const envsamp_halftone_desc *desc,
                    const envsamp_halftone_desc *other)
{
    envsamp_texel *texel = (envsamp_texel *)kd_allocate((size_t)desc->count * sizeof *texel);
    draw d = draw_make(c, desc);
    const int same = same_choice(&d, c, desc, texel, plain_scan(c, other, 0.0, texel));

    draw_free(&d);
    free(texel);
    return same;
}

/* Sums of whole numbers are exact, but errors are not: that none differ is no matter of course, but
   a texel where rounding decides comes once in 10^12. */
static void test_plain(int kernel, int scan)
{
    static const struct { int width, height; double black; } shapes[] = {
        { 64, 32, 0.0 }, { 33, 47, 0.3 }, { 100, 3, 0.05 }, { 5, 90, 0.5 }, { 67, 1, 0.1 },
        { 1, 53, 0.0 }, { 128, 64, 0.95 }, { 2, 2, 0.0 }, { 70, 41, -1.0 }
    };
    static const int counts[] = { 1, 2, 3, 5, 16, 31, 64, 257, 1000, 3000 };
    int shape, k, repeat, differ = 0, control = 0, scans = 0;

    for (shape = 0; shape < (int)(sizeof shapes / sizeof *shapes); shape++) {
        const int width = shapes[shape].width, height = shapes[shape].height;
        chart c = shapes[shape].black < 0.0 ? chart_lamp(width, height)
                : chart_random("", width, height, shapes[shape].black);

        for (k = 0; k < (int)(sizeof counts / sizeof *counts); k++)
            for (repeat = 0; repeat < 2; repeat++, scans++) {
                const envsamp_halftone_desc desc = describe(counts[k], kernel, scan, repeat, 0);
                const envsamp_halftone_desc other =
                    scan == ENVSAMP_SCAN_CELLS
                        ? describe(counts[k], kernel, ENVSAMP_SCAN_TEXELS, repeat, 0)
                        : describe(counts[k], (kernel + 1) % KERNELS, scan, repeat, 0);

                differ += !as_plain(&c, &desc, &desc);
                control += !as_plain(&c, &desc, &other);
            }
        free(c.value);
    }
    CHECK(differ == 0, "%s, %s: %d of %d scans are not plain ones", kernel_names[kernel],
          scan_names[scan], differ, scans);
    CHECK(control > scans / 4, "control: by another kernel, or scan, %d are not", control);
}

/* Importances of maps, whose sums are rounded. */
static void test_plain_maps(int scan)
{
    int map, differ = 0;

    for (map = 0; map < map_count; map++) {
        const envsamp_halftone_desc desc = describe(100 + 31 * map, map % KERNELS, scan,
                                                    map / KERNELS % 2, 0);

        differ += !as_plain(&maps[map], &desc, &desc);
    }
    CHECK(differ == 0, "%s: of maps %d of %d scans are not plain ones", scan_names[scan], differ,
          map_count);
}

/* Of four texels alike, for one sample, the second takes the sum to half of S/M, not past it. */
static void test_threshold(void)
{
    chart ones = chart_even(4, 1, 1.0f);
    int kernel, wrong = 0;

    for (kernel = 0; kernel < KERNELS; kernel++) {
        const envsamp_halftone_desc desc = describe(1, kernel, ENVSAMP_SCAN_CELLS, 0, 0);
        draw d = draw_make(&ones, &desc);

        wrong += d.count != 1 || d.texel[0].x != 2;
        draw_free(&d);
    }
    CHECK(IS(wrong, 0), "a texel is chosen past half of S/M, not at it");
    free(ones.value);
}

/* A row of ones shows the error at the start, which is even in S/M from -1/2 to 1/2: one sample of
   it is at `1/2 - error` of its length. */
static double start_of(const chart *ones, uint32_t seed)
{
    const envsamp_halftone_desc desc = describe(1, 0, ENVSAMP_SCAN_CELLS, 1, seed);
    draw d = draw_make(ones, &desc);
    const double at = d.count == 1 ? (double)d.texel[0].x : -1.0;

    draw_free(&d);
    return 0.5 - (at + 0.5) / (double)ones->width;
}

static int ascending(const void *a, const void *b)
{
    double x, y;

    memcpy(&x, a, sizeof x);
    memcpy(&y, b, sizeof y);
    return (x > y) - (x < y);
}

static void test_start_even(void)
{
    enum { SEEDS = 4000 };
    static double start[SEEDS];
    chart ones = chart_even(4096, 1, 1.0f);
    double product = 0.0, distance;
    int i;

    for (i = 0; i < SEEDS; i++) {
        start[i] = 0.5 + start_of(&ones, (uint32_t)i + 1);
        product += i ? 12.0 * (start[i] - 0.5) * (start[i - 1] - 0.5) / SEEDS : 0.0;
    }
    qsort(start, SEEDS, sizeof *start, ascending);
    distance = stat_ks_distance(start, SEEDS);
    CHECK(distance < stat_ks_bound(SEEDS, STAT_ALPHA), "errors at the start are even, to %.4f",
          distance);
    CHECK(fabs(product) < 5.0 / sqrt(SEEDS), "those of two seeds in a row correlate by %.4f",
          product);
    CHECK(IS_NEAR(start_of(&ones, 0), 0.0, 1.0 / 4096.0), "that of seed 0 is none");
    free(ones.value);
}

static int same_texels(const envsamp_texel *a, int count_a, const envsamp_texel *b, int count_b)
{
    int i, same = count_a == count_b;

    for (i = 0; i < count_a && same; i++)
        same = a[i].x == b[i].x && a[i].y == b[i].y;
    return same;
}

/* A start that is known to 1 in 65535: where two plain scans, from either end of that, choose the
   same, so must the library. */
static void test_start(int scan)
{
    chart ones = chart_even(65535, 1, 1.0f), c = chart_random("", 64, 32, 0.1);
    envsamp_texel texel[2][200];
    int kernel, differ = 0, known = 0, moved = 0;
    uint32_t seed;

    for (kernel = 0; kernel < KERNELS; kernel++)
        for (seed = 1; seed <= 40; seed++) {
            const envsamp_halftone_desc desc = describe(1 + (int)seed * 4, kernel, scan,
                                                        (int)seed % 2, seed * 0x1234567u);
            const double start = start_of(&ones, desc.seed);
            const int low = plain_scan(&c, &desc, start - 0.5 / 65535.0, texel[0]);
            int high = plain_scan(&c, &desc, start + 0.5 / 65535.0, texel[1]);
            draw d;

            if (!same_texels(texel[0], low, texel[1], high))
                continue;
            d = draw_make(&c, &desc);
            known++;
            differ += !same_choice(&d, &c, &desc, texel[0], low);
            high = plain_scan(&c, &desc, 0.0, texel[1]);
            moved += !same_texels(texel[0], low, texel[1], high);
            draw_free(&d);
        }
    CHECK(differ == 0 && known > 150, "%s: from another start %d of %d scans are not plain ones",
          scan_names[scan], differ, known);
    CHECK(moved > known / 2, "control: from no error at the start %d are not", moved);
    free(ones.value);
    free(c.value);
}

/* ---- density ---- */

#define RECTS 100
#define DENSITY 2.5             /* samples too many or few, in sqrt(perimeter in cells) */
#define QUIETER 0.4             /* RMS of that at M = 256, over that of RANDOM: 0.28 to 0.34 */

typedef struct rect { int x0, y0, x1, y1; } rect;

static rect rects[RECTS];
static double rect_mass[MADE_UP + REAL_MAP_COUNT][RECTS];

static double mass_within(const chart *c, const rect *r)
{
    double sum = 0.0;
    int x, y;

    for (y = r->y0; y < r->y1; y++)
        for (x = r->x0; x < r->x1; x++)
            sum += (double)c->value[y * c->width + x];
    return sum / c->total;
}

static int count_within(const draw *d, const rect *r)
{
    int i, count = 0;

    for (i = 0; i < d->count; i++)
        count += d->texel[i].x >= r->x0 && d->texel[i].x < r->x1
              && d->texel[i].y >= r->y0 && d->texel[i].y < r->y1;
    return count;
}

static void random_range(pcg32 *random, int length, int *low, int *high)
{
    const int a = (int)(pcg32_next(random) % (uint32_t)length);
    const int b = (int)(pcg32_next(random) % (uint32_t)length);

    *low = a < b ? a : b;
    *high = (a < b ? b : a) + 1;
}

static void rects_make(void)
{
    pcg32 random = pcg32_make(3, 3);
    int map, i;

    for (i = 0; i < RECTS; i++) {
        random_range(&random, WIDTH, &rects[i].x0, &rects[i].x1);
        random_range(&random, HEIGHT, &rects[i].y0, &rects[i].y1);
    }
    for (map = 0; map < map_count; map++)
        for (i = 0; i < RECTS; i++)
            rect_mass[map][i] = mass_within(&maps[map], &rects[i]);
}

/* How far counts in rectangles are off: at worst, in sqrt(perimeter in cells), and squares. */
typedef struct density { double worst, squares; int count; } density;

static void density_add(density *all, int map, const envsamp_halftone_desc *desc)
{
    const double side = sqrt((double)WIDTH * HEIGHT / (2.0 * desc->count));
    draw d = draw_make(&maps[map], desc);
    int i;

    for (i = 0; i < RECTS; i++) {
        const rect *r = &rects[i];
        const double perimeter = 2.0 * (double)(r->x1 - r->x0 + r->y1 - r->y0);
        const double off = fabs((double)count_within(&d, r) - desc->count * rect_mass[map][i]);

        all->worst = fmax(all->worst, off / sqrt(perimeter / side));
        all->squares += off * off;
        all->count++;
    }
    draw_free(&d);
}

/* Over all maps, without `repeat` over those where no texel is worth a sample. */
static density density_of(int count, int kernel, int scan, int repeat)
{
    const int seeds = kernel == ENVSAMP_KERNEL_RANDOM ? 16 : 1;
    density all = { 0.0, 0.0, 0 };
    int map, seed;

    for (map = 0; map < map_count; map++)
        for (seed = 0; seed < seeds; seed++) {
            const envsamp_halftone_desc desc = describe(count, kernel, scan, repeat,
                                                        (uint32_t)(seed ? 16 * map + seed : 0));

            if (repeat || count * maps[map].largest < maps[map].total)
                density_add(&all, map, &desc);
        }
    return all;
}

static double density_rms(const density *d)
{
    return sqrt(d->squares / (double)d->count);
}

static void test_density(int count, int repeat)
{
    const density random = density_of(count, ENVSAMP_KERNEL_RANDOM, 0, repeat);
    int kernel;

    CHECK(random.worst > DENSITY, "control: M = %d, RANDOM is %.2f off, RMS %.2f", count,
          random.worst, density_rms(&random));
    for (kernel = 0; kernel < KERNELS; kernel++) {
        const density cells = density_of(count, kernel, ENVSAMP_SCAN_CELLS, repeat);
        const density texels = density_of(count, kernel, ENVSAMP_SCAN_TEXELS, repeat);

        CHECK(cells.worst <= DENSITY && cells.count >= 2 * RECTS, "M = %d, repeat %d, %s: counts "
              "in %d rectangles are %.2f off, RMS %.2f", count, repeat, kernel_names[kernel],
              cells.count, cells.worst, density_rms(&cells));
        CHECK(texels.worst > DENSITY, "control: as published %.2f, RMS %.2f", texels.worst,
              density_rms(&texels));
        if (count == 256)
            CHECK(density_rms(&cells) <= QUIETER * density_rms(&random)
                  && density_rms(&texels) > QUIETER * density_rms(&random),
                  "RMS is %.3f of RANDOM's; control: as published %.2f",
                  density_rms(&cells) / density_rms(&random),
                  density_rms(&texels) / density_rms(&random));
    }
}

/* ---- few samples ---- */

/* Share of the map's importance up to the first texel that is chosen, in the order of the scan. */
static double mass_to_first(const chart *c, const envsamp_halftone_desc *desc, const draw *d)
{
    const int first = d->texel[0].y * c->width + d->texel[0].x;
    const grid g = grid_of(c->width, c->height, desc);
    int *path = path_make(c), strip, turn, i, found = 0;
    double sum = 0.0;

    for (strip = 0; strip < g.down && !found; strip++)
        for (turn = 0; turn < g.across && !found; turn++) {
            const cell k = cell_of(c, desc, &g, strip, turn);
            const int count = cell_path(&k, c->width, path);

            for (i = 0; i < count && !found; i++) {
                sum += (double)c->value[path[i]];
                found = path[i] == first;
            }
        }
    free(path);
    return sum / c->total;
}

/* How far the mean row of a draw is from that of the map, in heights of it. */
static double mean_row_off(const chart *c, const draw *d)
{
    double of_map = 0.0, of_draw = 0.0;
    int i;

    for (i = 0; i < c->width * c->height; i++)
        of_map += (double)c->value[i] * (0.5 + (double)(i / c->width));
    for (i = 0; i < d->count; i++)
        of_draw += 0.5 + (double)d->texel[i].y;
    return fabs(of_draw / (double)d->count - of_map / c->total) / (double)c->height;
}

/* Even, darker towards the top, and darker towards the bottom. */
static chart gradient_make(int kind)
{
    chart c = chart_even(WIDTH, HEIGHT, 1.0f);
    int i;

    for (i = 0; kind && i < WIDTH * HEIGHT; i++)
        c.value[i] = (float)(kind == 1 ? 1 + i / WIDTH : HEIGHT - i / WIDTH);
    c.name = kind == 0 ? "even" : kind == 1 ? "darker to the top" : "darker to the bottom";
    chart_sum(&c);
    return c;
}

/* With M samples the first must not lie beyond 3/2 of what one is worth, nor the mean row farther
   off than 0.35 of the height of a row of cells. */
static void test_few(int scan, int kind)
{
    chart c = gradient_make(kind);
    double worst_first = 0.0, worst_row = 0.0;
    int count, kernel;

    for (count = 16; count <= 64; count *= 2)
        for (kernel = 0; kernel < KERNELS; kernel++) {
            const envsamp_halftone_desc desc = describe(count, kernel, scan, 0, 0);
            draw d = draw_make(&c, &desc);

            worst_first = fmax(worst_first, count * mass_to_first(&c, &desc, &d));
            worst_row = fmax(worst_row, mean_row_off(&c, &d) * sqrt(count));
            draw_free(&d);
        }
    if (scan == ENVSAMP_SCAN_CELLS)
        CHECK(worst_first <= 1.5 && worst_row <= 0.35, "16 to 64 samples, %s: the first after "
              "%.2f of a sample, mean row off by %.3f / sqrt(M)", c.name, worst_first, worst_row);
    else
        CHECK(worst_first > 1.5 && worst_row > 0.35, "control: as published %.2f, %.3f",
              worst_first, worst_row);
    free(c.value);
}

/* ---- random draws ---- */

/* Counts in blocks of 8x8 texels of maps of 64x64. */
#define BLOCKS 64

static int block_of(int x, int y)
{
    return y / 8 * 8 + x / 8;
}

static void add_masses(const chart *c, double mass[BLOCKS])
{
    int i;

    for (i = 0; i < c->width * c->height; i++)
        mass[block_of(i % c->width, i / c->width)] += (double)c->value[i];
}

static void add_hits(const draw *d, double hits[BLOCKS])
{
    int i;

    for (i = 0; i < d->count; i++)
        hits[block_of(d->texel[i].x, d->texel[i].y)] += 1.0;
}

static int brightest_of(const double *mass, int count)
{
    int i, brightest = 0;

    for (i = 0; i < count; i++)
        brightest = mass[i] > mass[brightest] ? i : brightest;
    return brightest;
}

enum { AS_DRAWN, TWO_PERCENT, SWAPPED, UPSIDE_DOWN, ONE_MORE, KINDS };
static const char *const kind_names[KINDS] = {
    "4 million", "control: a block 2 % off", "control: x and y swapped", "control: upside down",
    "control: one more a seed in the first block"
};

static void check_masses(const double mass[BLOCKS], const double hits[BLOCKS], int kind)
{
    double expected[BLOCKS], seen[BLOCKS];
    stat_result result;
    int i;

    for (i = 0; i < BLOCKS; i++) {
        const int swapped = i % 8 * 8 + i / 8, down = 56 - i / 8 * 8 + i % 8;

        expected[i] = mass[i];
        seen[i] = hits[kind == SWAPPED ? swapped : kind == UPSIDE_DOWN ? down : i];
    }
    i = brightest_of(mass, BLOCKS);
    expected[i] *= kind == TWO_PERCENT ? 1.02 : 1.0;
    seen[0] += kind == ONE_MORE ? 4000.0 : 0.0;
    result = stat_chi2_test(expected, seen, BLOCKS, NULL);
    CHECK(result.pass == (kind == AS_DRAWN), "RANDOM, %s: %s, chi2 %.0f of %.0f, p = %.2g",
          kind_names[kind], stat_verdict_string(result.verdict), result.chi2, result.dof,
          result.p);
}

static void test_random_masses(void)
{
    double mass[BLOCKS] = { 0.0 }, hits[BLOCKS] = { 0.0 };
    chart c = chart_made_up("studio", 64, 64);
    uint32_t seed;
    int kind;

    add_masses(&c, mass);
    for (seed = 0; seed < 4000; seed++) {
        const envsamp_halftone_desc desc = describe(1000, ENVSAMP_KERNEL_RANDOM, 0, 0, seed);
        draw d = draw_make(&c, &desc);

        add_hits(&d, hits);
        draw_free(&d);
    }
    for (kind = 0; kind < KINDS; kind++)
        check_masses(mass, hits, kind);
    free(c.value);
}

/* Counts in two rectangles of one seed after the other. */
typedef struct tally { stat_moments a, b; double together, in_turn, last; } tally;

static tally tally_of(const chart *c, int kernel, const rect *a, const rect *b, int seeds,
                      int count)
{
    tally n;
    int seed;

    memset(&n, 0, sizeof n);
    for (seed = 1; seed <= seeds; seed++) {
        const envsamp_halftone_desc desc = describe(count, kernel, 0, 1, (uint32_t)seed);
        draw d = draw_make(c, &desc);
        const double in_a = (double)count_within(&d, a), in_b = (double)count_within(&d, b);

        stat_moments_add(&n.a, in_a);
        stat_moments_add(&n.b, in_b);
        n.together += in_a * in_b / seeds;
        n.in_turn += n.last * in_a / seeds;
        n.last = in_a;
        draw_free(&d);
    }
    return n;
}

/* Independent draws are in a rectangle of mass m binomially often: M m on average, with a variance
   of M m (1 - m); in two that do not overlap with the covariance -M m n; and one seed tells nothing
   of the next. */
static void test_independence(void)
{
    enum { SEEDS = 40000, COUNT = 32 };
    const rect a = { 3, 5, 40, 17 }, b = { 10, 17, 60, 30 };
    chart c = chart_made_up("foliage", 64, 32);
    const tally n = tally_of(&c, ENVSAMP_KERNEL_RANDOM, &a, &b, SEEDS, COUNT);
    const tally even = tally_of(&c, ENVSAMP_KERNEL_SZIRMAY, &a, &b, SEEDS / 10, COUNT);
    const double m = mass_within(&c, &a), m2 = mass_within(&c, &b);
    const double variance = COUNT * m * (1.0 - m), within = 5.0 / sqrt(SEEDS);
    const double ratio = stat_moments_variance(&n.a) / variance;
    const double covariance = n.together - n.a.mean * n.b.mean;
    const double in_turn = n.in_turn - n.a.mean * n.a.mean;

    CHECK(m > 0.1 && m2 > 0.1 && stat_mean_test(&n.a, COUNT * m, 0.0) > STAT_ALPHA
          && stat_mean_test(&n.b, COUNT * m2, 0.0) > STAT_ALPHA,
          "RANDOM, in a rectangle on average: %.3f of %.3f", n.a.mean, COUNT * m);
    CHECK(stat_mean_test(&n.a, COUNT * (m + 0.002), 0.0) < STAT_ALPHA, "control: not %.3f",
          COUNT * (m + 0.002));
    CHECK(fabs(ratio - 1.0) < 1.5 * within, "variance is %.4f of that of a binomial distribution",
          ratio);
    CHECK(fabs(covariance / variance + m2 / (1.0 - m)) < within, "covariance %.4f, %.4f expected",
          covariance, -COUNT * m * m2);
    CHECK(fabs(in_turn / variance) < within, "seeds that follow one another correlate by %.4f",
          in_turn / variance);
    CHECK(stat_moments_variance(&even.a) < 0.3 * variance, "control: diffused, the variance is "
          "%.3f of that", stat_moments_variance(&even.a) / variance);
    free(c.value);
}

/* ---- diffusion from many seeds ---- */

static int is_wide(int kernel)
{
    return kernel == ENVSAMP_KERNEL_JARVIS || kernel == ENVSAMP_KERNEL_STUCKI;
}

/* One row, a kernel with one weight ahead: nothing is lost on the way, so each texel is chosen as
   often as it is worth, M p. */
static void test_frequency_row(int kernel, int scan)
{
    enum { TEXELS = 64, COUNT = 10, SEEDS = 30000 };
    double mass[TEXELS], hits[TEXELS] = { 0.0 };
    chart c = chart_random("", TEXELS, 1, 0.2);
    stat_result result;
    uint32_t seed;
    int i, sound;

    for (seed = 1; seed <= SEEDS; seed++) {
        const envsamp_halftone_desc desc = describe(COUNT, kernel, scan, (int)seed % 2, seed);
        draw d = draw_make(&c, &desc);

        for (i = 0; i < d.count; i++)
            hits[d.texel[i].x] += 1.0;
        draw_free(&d);
    }
    for (i = 0; i < TEXELS; i++)
        mass[i] = (double)c.value[i];
    result = stat_chi2_test(mass, hits, TEXELS, NULL);
    sound = result.pass;
    i = brightest_of(mass, TEXELS);
    mass[i] *= 1.1;
    CHECK(sound && !stat_chi2_test(mass, hits, TEXELS, NULL).pass, "%s, %s, texels of a row: p = "
          "%.2g; control: not with one a tenth brighter", kernel_names[kernel], scan_names[scan],
          result.p);
    free(c.value);
}

/* As in a row, so over the whole map: total variation between frequencies and masses of blocks,
   with M = 64, is 0.006, which is what 2000 seeds can tell. */
static void test_frequency(int kernel, const char *name)
{
    enum { COUNT = 64, SEEDS = 2000 };
    const double most = 0.012;
    double mass[BLOCKS] = { 0.0 }, hits[BLOCKS] = { 0.0 }, one[BLOCKS], off, single = 0.0;
    chart c = chart_made_up(name, 64, 64);
    uint32_t seed;

    add_masses(&c, mass);
    for (seed = 1; seed <= SEEDS; seed++) {
        const envsamp_halftone_desc desc = describe(COUNT, kernel, 0, 1, seed);
        draw d = draw_make(&c, &desc);

        memset(one, 0, sizeof one);
        add_hits(&d, hits);
        add_hits(&d, one);
        single += stat_total_variation(one, mass, BLOCKS) / SEEDS;
        draw_free(&d);
    }
    off = stat_total_variation(hits, mass, BLOCKS);
    CHECK(off <= most && single > most, "%s, %s: blocks are chosen as often as they are worth to "
          "%.3f; control: by one seed to %.3f", kernel_names[kernel], name, off, single);
    free(c.value);
}

/* ---- odd maps ---- */

/* Every kernel, scan and repetition, with counts about that of lit texels; of large maps fewer. How
   many are wrong. */
static int wrong_calls(const chart *c)
{
    const int counts[] = { 1, c->lit, 100, c->lit + 1, c->lit - 1, 2, 3, 7 };
    const int few = c->width * c->height > 10000;
    int kernel, scan, repeat, k, wrong = 0;

    for (kernel = 0; kernel <= KERNELS; kernel++)
        for (scan = 0; scan < scans_of(kernel); scan++)
            for (repeat = 0; repeat < 2; repeat++)
                for (k = 0; k < (few ? 3 : 8); k++)
                    if (counts[k] > 0)
                        wrong += !call_sound(c, counts[k], kernel, scan, repeat, 0xffffffffu)
                              || (!few && !call_sound(c, counts[k], kernel, scan, repeat, 0));
    return wrong;
}

static void check_odd(chart *c, const char *what)
{
    int wrong;

    chart_sum(c);
    wrong = wrong_calls(c);
    CHECK(wrong == 0, "%s, %dx%d: %d calls are wrong", what, c->width, c->height, wrong);
    free(c->value);
}

static void test_shapes(void)
{
    static const int shapes[][2] = { { 1, 1 }, { 1, 2 }, { 2, 1 }, { 1, 300 }, { 300, 1 },
                                     { 31, 33 }, { 33, 31 }, { 1, 65535 }, { 65535, 1 } };
    size_t k;

    for (k = 0; k < sizeof shapes / sizeof *shapes; k++) {
        chart even = chart_even(shapes[k][0], shapes[k][1], 3.0f);

        check_odd(&even, "even");
    }
}

/* One lit texel: in a corner, or in the middle of a run of 32 columns. */
static void test_lone(int width, int height, int x, int y)
{
    chart c = chart_make("", width, height);
    char what[64];

    c.value[y * width + x] = 5.0f;
    snprintf(what, sizeof what, "only texel %d, %d is lit", x, y);
    check_odd(&c, what);
}

static void test_lones(void)
{
    test_lone(8, 5, 0, 0);
    test_lone(8, 5, 7, 0);
    test_lone(8, 5, 0, 4);
    test_lone(8, 5, 7, 4);
    test_lone(65, 33, 0, 0);
    test_lone(65, 33, 64, 0);
    test_lone(65, 33, 0, 32);
    test_lone(65, 33, 64, 32);
    test_lone(65, 33, 31, 16);
    test_lone(65, 33, 32, 17);
}

static void test_ranges(void)
{
    chart c = chart_even(40, 10, FLT_MAX);
    int i;

    check_odd(&c, "FLT_MAX");
    c = chart_even(40, 10, 0x1p-149f);
    check_odd(&c, "the smallest denormal");
    c = chart_even(40, 10, 0x1p-149f);
    for (i = 0; i < 400; i += 3)
        c.value[i] = FLT_MAX;
    check_odd(&c, "both");
    c = chart_make("", 33, 17);
    for (i = 0; i < 33 * 17; i += 2)
        c.value[i] = 1.0f;
    check_odd(&c, "checkerboard");
    c = chart_random("", 64, 64, 0.97);
    check_odd(&c, "nearly all black");
}

/* How often texel (x, y) is chosen, and whether these are in a row. */
static int times_chosen(const draw *d, int x, int y, int *in_a_row)
{
    int i, times = 0, first = 0, last = 0;

    for (i = 0; i < d->count; i++)
        if (d->texel[i].x == x && d->texel[i].y == y) {
            first = times ? first : i;
            last = i;
            times++;
        }
    *in_a_row = times == 0 || last - first == times - 1;
    return times;
}

/* A sun of 99.99 % of the light: with `repeat` it has that part of the samples, else one. */
static void test_sun(void)
{
    chart c = chart_even(64, 32, 1.0f);
    int kernel, scan, repeat, row, wrong = 0;

    c.value[13 * 64 + 40] = 1e4f * 2047.0f;
    chart_sum(&c);
    for (kernel = 0; kernel < KERNELS; kernel++)
        for (scan = 0; scan < 2; scan++)
            for (repeat = 0; repeat < 2; repeat++) {
                const envsamp_halftone_desc desc = describe(1000, kernel, scan, repeat, 0);
                draw d = draw_make(&c, &desc);
                const int times = times_chosen(&d, 40, 13, &row);

                wrong += !draw_sound(&d, &c, &desc) || !row
                      || (repeat ? times < 999 : times != 1);
                draw_free(&d);
            }
    CHECK(wrong == 0, "a sun is chosen again and again, or once: %d wrong", wrong);
    check_odd(&c, "a sun of 99.99 % of the light");
}

/* With `repeat` the brightest texel of a map is chosen as often as it is worth to two. */
static void test_brightest(void)
{
    double worst = 0.0;
    int map, kernel, i, row, wrong = 0;

    for (map = 0; map < map_count; map++)
        for (kernel = 0; kernel < KERNELS; kernel++) {
            const chart *c = &maps[map];
            const envsamp_halftone_desc desc = describe(1024, kernel, 0, 1, 0);
            draw d = draw_make(c, &desc);

            for (i = 0; (double)c->value[i] < c->largest; i++)
                continue;
            worst = fmax(worst, fabs(times_chosen(&d, i % WIDTH, i / WIDTH, &row)
                                     - 1024.0 * c->largest / c->total));
            wrong += !row;
            draw_free(&d);
        }
    CHECK(worst < 2.0 && wrong == 0, "of 1024 samples the brightest texels have as many as they "
          "are worth, to %.2f", worst);
}

/* ---- bad input ---- */

/* A call that is fine, and one to be spoiled. */
typedef struct call {
    const float *importance;
    int width, height;
    size_t stride;
    const envsamp_halftone_desc *desc;
    envsamp_texel *texels;
    int capacity;
    int *count;
    envsamp_buffer scratch;
} call;

#define STAGE_COUNT 50

typedef struct stage {
    chart c;
    envsamp_halftone_desc desc;
    kd_guarded texels, scratch;
    int count;
    call fine, spoilt;
} stage;

static envsamp_result call_make(const call *c)
{
    return envsamp_halftone(c->importance, c->width, c->height, c->stride, c->desc, c->texels,
                            c->capacity, c->count, c->scratch);
}

/* Three whole runs of 32 columns and a tail of four, three rows. */
static void stage_make(stage *s, int kernel)
{
    envsamp_sizes sizes;

    memset(s, 0, sizeof *s);
    s->c = chart_random("", 100, 3, 0.2);
    s->desc = describe(STAGE_COUNT, kernel, ENVSAMP_SCAN_CELLS, 0, 7);
    envsamp_halftone_sizes(100, 3, &s->desc, &sizes);
    s->texels = kd_guarded_make(STAGE_COUNT * sizeof(envsamp_texel), RUBBISH);
    s->scratch = kd_guarded_make(sizes.scratch_bytes, 0xc3);
    s->fine.importance = s->c.value;
    s->fine.width = 100;
    s->fine.height = 3;
    s->fine.desc = &s->desc;
    s->fine.texels = (envsamp_texel *)s->texels.buffer.data;
    s->fine.capacity = STAGE_COUNT;
    s->fine.count = &s->count;
    s->fine.scratch = s->scratch.buffer;
    s->spoilt = s->fine;
}

static void stage_free(stage *s)
{
    free(s->c.value);
    free(s->texels.block);
    free(s->scratch.block);
}

/* Whether the spoilt call is refused with this result, leaves *count 0 and texels as they were.
   Then it is fine again. */
static int refused(stage *s, envsamp_result expected)
{
    envsamp_result result;

    s->count = 77;
    result = call_make(&s->spoilt);
    if (!s->spoilt.count)
        s->count = 0;
    s->spoilt = s->fine;
    return IS(result, expected) && IS(s->count, 0)
        && all_rubbish(s->texels.buffer.data, s->texels.buffer.bytes)
        && kd_guarded_intact(&s->texels) && kd_guarded_intact(&s->scratch);
}

/* That what was refused was so for the reason given: put right, it is not. */
static int accepted(stage *s)
{
    const envsamp_result result = call_make(&s->fine);
    const int whole = IS(result, ENVSAMP_OK) && IS(s->count, STAGE_COUNT);

    memset(s->texels.buffer.data, RUBBISH, s->texels.buffer.bytes);
    return whole;
}

static void test_pointers(stage *s)
{
    envsamp_sizes sizes = { 1, 1 };
    int good = 1;

    s->spoilt.importance = NULL;
    good &= refused(s, ENVSAMP_ERR_NULL);
    s->spoilt.desc = NULL;
    good &= refused(s, ENVSAMP_ERR_NULL);
    s->spoilt.texels = NULL;
    good &= refused(s, ENVSAMP_ERR_NULL);
    s->spoilt.count = NULL;
    good &= refused(s, ENVSAMP_ERR_NULL);
    s->spoilt.scratch.data = NULL;
    good &= refused(s, ENVSAMP_ERR_NULL);
    CHECK(good && IS(envsamp_halftone_sizes(8, 8, &s->desc, NULL), ENVSAMP_ERR_NULL)
          && IS(envsamp_halftone_sizes(8, 8, NULL, &sizes), ENVSAMP_ERR_NULL)
          && !sizes.table_bytes && !sizes.scratch_bytes && accepted(s), "missing pointers");
}

/* Whether a description is refused, by both functions. */
static int desc_refused(stage *s, int count, int kernel, int scan)
{
    const envsamp_halftone_desc desc = describe(count, kernel, scan, 0, 0);
    envsamp_sizes sizes = { 1, 1 };

    s->spoilt.desc = &desc;
    return refused(s, ENVSAMP_ERR_PARAM)
        && envsamp_halftone_sizes(100, 3, &desc, &sizes) == ENVSAMP_ERR_PARAM
        && !sizes.table_bytes && !sizes.scratch_bytes;
}

static void test_descriptions(stage *s)
{
    static const int bad_counts[] = { 0, -1, INT_MIN };
    static const int bad_kernels[] = { -1, ENVSAMP_KERNEL_RANDOM + 1, INT_MAX };
    static const int bad_scans[] = { -1, ENVSAMP_SCAN_TEXELS + 1, INT_MAX };
    int i, good = 1;

    for (i = 0; i < 3; i++)
        good &= desc_refused(s, bad_counts[i], 0, 0) && desc_refused(s, 5, bad_kernels[i], 0)
             && desc_refused(s, 5, 0, bad_scans[i]);
    CHECK(good && accepted(s), "count, kernel and scan out of range");
}

static void test_sizes(stage *s)
{
    static const int bad[] = { 0, -1, 65536, INT_MIN, INT_MAX };
    static const size_t strides[] = { 399, 396, 4, SIZE_MAX, SIZE_MAX - 3, SIZE_MAX / 2 - 3 };
    envsamp_sizes sizes;
    int i, good = 1;

    for (i = 0; i < 5; i++) {
        s->spoilt.width = bad[i];
        good &= refused(s, ENVSAMP_ERR_SIZE);
        s->spoilt.height = bad[i];
        good &= refused(s, ENVSAMP_ERR_SIZE);
        sizes.table_bytes = sizes.scratch_bytes = 1;
        good &= envsamp_halftone_sizes(bad[i], 8, &s->desc, &sizes) == ENVSAMP_ERR_SIZE
             && envsamp_halftone_sizes(8, bad[i], &s->desc, &sizes) == ENVSAMP_ERR_SIZE
             && !sizes.table_bytes && !sizes.scratch_bytes;
    }
    CHECK(good && accepted(s), "width and height out of 1 to 65535");
    for (i = 0, good = 1; i < (int)(sizeof strides / sizeof *strides); i++) {
        s->spoilt.stride = strides[i];
        good &= refused(s, ENVSAMP_ERR_SIZE);
    }
    s->fine.stride = s->spoilt.stride = 400;
    CHECK(good && accepted(s), "strides that are less than a row, or too many");
    for (i = 1; i < 4; i++) {
        s->spoilt.stride = 400 + (size_t)i;
        good &= refused(s, ENVSAMP_ERR_ALIGN);
        s->spoilt.importance = (const float *)((uintptr_t)s->c.value + (uintptr_t)i);
        good &= refused(s, ENVSAMP_ERR_ALIGN);
    }
    CHECK(good && accepted(s), "strides and importance at no multiple of 4");
}

static void test_memory(stage *s)
{
    int good = 1, i;

    for (i = 0; i < STAGE_COUNT; i++) {
        s->spoilt.capacity = i;
        good &= refused(s, ENVSAMP_ERR_MEMORY);
    }
    s->spoilt.capacity = -1;
    CHECK(good && refused(s, ENVSAMP_ERR_MEMORY) && accepted(s), "room for fewer than M texels");
    s->spoilt.scratch.bytes--;
    good = refused(s, ENVSAMP_ERR_MEMORY);
    s->spoilt.scratch.bytes = 0;
    CHECK(good && refused(s, ENVSAMP_ERR_MEMORY) && accepted(s), "a byte of scratch less");
    for (i = 1; i < ENVSAMP_ALIGN; i++) {
        s->spoilt.scratch.data = (char *)s->scratch.buffer.data + i;
        good &= refused(s, ENVSAMP_ERR_ALIGN);
    }
    CHECK(good && accepted(s), "scratch that is not aligned");
}

/* Bad values everywhere in a row: first and last, in a run of 32 columns and in the tail. */
static void test_values(stage *s)
{
    static const float bad[] = { NAN, -NAN, INFINITY, -INFINITY, -1.0f, -0x1p-149f, -FLT_MAX };
    int i, k, good = 1;

    for (i = 0; i < 300; i++)
        for (k = 0; k < (int)(sizeof bad / sizeof *bad); k++) {
            const float kept = s->c.value[i];

            s->c.value[i] = bad[k];
            good &= refused(s, ENVSAMP_ERR_VALUE);
            s->c.value[i] = kept;
        }
    CHECK(good && accepted(s), "NaN, infinite and negative importances, at each texel");
    memset(s->c.value, 0, 300 * sizeof *s->c.value);
    good = refused(s, ENVSAMP_ERR_BLACK);
    for (i = 0; i < 300; i += 7)
        s->c.value[i] = -0.0f;
    CHECK(good && refused(s, ENVSAMP_ERR_BLACK), "all black, some of it -0");
    s->c.value[150] = -1.0f;
    CHECK(refused(s, ENVSAMP_ERR_VALUE), "all black, but one that is negative");
}

static void test_bad_input(void)
{
    int kernel;

    for (kernel = 0; kernel <= KERNELS; kernel += KERNELS) {
        stage s;

        stage_make(&s, kernel);
        test_pointers(&s);
        test_descriptions(&s);
        test_sizes(&s);
        test_memory(&s);
        test_values(&s);
        stage_free(&s);
    }
}

/* As much scratch as the header says, each part of it aligned. */
static void test_scratch(void)
{
    static const int counts[] = { 1, 2, 100, 100000, INT_MAX };
    static const int widths[] = { 1, 2, 3, 500, 65535 };
    int kernel, scan, i, k, wrong = 0;

    for (kernel = 0; kernel <= KERNELS; kernel++)
        for (scan = 0; scan < 2; scan++)
            for (i = 0; i < 5; i++)
                for (k = 0; k < 5; k++) {
                    const envsamp_halftone_desc desc = describe(counts[i], kernel, scan, 0, 1);
                    const size_t row = scan == ENVSAMP_SCAN_TEXELS && kernel < KERNELS
                                     ? (is_wide(kernel) ? 24 : 16) * (size_t)widths[k] : 0;
                    const size_t bytes = 12 * (size_t)widths[k] + row;
                    envsamp_sizes sizes = { 1, 0 };

                    wrong += envsamp_halftone_sizes(widths[k], 65535, &desc, &sizes) != ENVSAMP_OK
                          || sizes.table_bytes || sizes.scratch_bytes < bytes
                          || sizes.scratch_bytes > bytes + 5 * 16;
                }
    CHECK(wrong == 0, "scratch is what the header says: %d times not", wrong);
}

/* ---- the same texels ---- */

/* Whether two draws are the same bytes. Frees both. */
static int same_draws(draw a, draw b)
{
    const int same = a.result == ENVSAMP_OK && b.result == ENVSAMP_OK && a.count == b.count
                  && a.count > 0
                  && !memcmp(a.texel, b.texel, (size_t)a.count * sizeof *a.texel);

    draw_free(&a);
    draw_free(&b);
    return same;
}

/* Every kernel, scan and repetition: again, with other rubbish in scratch, from another map that
   must choose the same. And another seed, which must not. How many are wrong. */
static int wrong_repeats(const chart *c, const chart *again)
{
    int kernel, scan, repeat, wrong = 0;

    for (kernel = 0; kernel <= KERNELS; kernel++)
        for (scan = 0; scan < scans_of(kernel); scan++)
            for (repeat = 0; repeat < 2; repeat++) {
                const envsamp_halftone_desc desc = describe(99, kernel, scan, repeat, 5);
                const envsamp_halftone_desc other = describe(99, kernel, scan, repeat, 6);

                wrong += !same_draws(draw_make(c, &desc), draw_make(again, &desc))
                      || !same_draws(draw_make(c, &desc), draw_make_in(again, &desc, 0))
                      || !same_draws(draw_make(c, &desc), draw_make_in(again, &desc, 0xff))
                      || same_draws(draw_make(c, &desc), draw_make(again, &other));
            }
    return wrong;
}

static void test_again(void)
{
    chart c = chart_made_up("night", 70, 35), scaled = chart_make("", 70, 35);
    int i, wrong = wrong_repeats(&c, &c), power;

    CHECK(wrong == 0, "again, whatever is in scratch, the same bytes; control: not by another "
          "seed: %d wrong", wrong);
    for (power = -60, wrong = 0; power <= 120; power += 60) {
        for (i = 0; i < 70 * 35; i++)
            scaled.value[i] = (float)ldexp((double)c.value[i], power);
        chart_sum(&scaled);
        wrong += wrong_repeats(&c, &scaled);
    }
    CHECK(wrong == 0, "times a power of two the same bytes: %d wrong", wrong);
    for (i = 0; i < 70 * 35; i++)
        scaled.value[i] = c.value[i] = c.value[i] < 0.0f || i % 5 ? c.value[i] : 0.0f;
    for (i = 0; i < 70 * 35; i++)
        scaled.value[i] = scaled.value[i] > 0.0f ? scaled.value[i] : -0.0f;
    wrong = wrong_repeats(&c, &scaled);
    CHECK(wrong == 0, "-0 is as 0: %d wrong", wrong);
    free(c.value);
    free(scaled.value);
}

/* Rows that lie apart, with NaN between them; and more room than is needed. */
static void test_stride(void)
{
    enum { ACROSS = 70, DOWN = 35, STRIDE = ACROSS + 13, COUNT = 99 };
    chart c = chart_made_up("night", ACROSS, DOWN), wide = chart_make("", STRIDE, DOWN);
    kd_guarded texels = kd_guarded_make((COUNT + 9) * sizeof(envsamp_texel), RUBBISH);
    kd_guarded scratch = kd_guarded_make(1 << 16, 0x11);
    int kernel, x, y, count, wrong = 0;

    for (y = 0; y < DOWN; y++)
        for (x = 0; x < STRIDE; x++)
            wide.value[y * STRIDE + x] = x < ACROSS ? c.value[y * ACROSS + x] : NAN;
    for (kernel = 0; kernel <= KERNELS; kernel++) {
        const envsamp_halftone_desc desc = describe(COUNT, kernel, 0, 0, 3);
        draw d = draw_make(&c, &desc);

        memset(texels.buffer.data, RUBBISH, texels.buffer.bytes);
        wrong += envsamp_halftone(wide.value, ACROSS, DOWN, STRIDE * sizeof *wide.value, &desc,
                                  (envsamp_texel *)texels.buffer.data, COUNT + 9, &count,
                                  scratch.buffer) != ENVSAMP_OK
              || count != COUNT
              || memcmp(texels.buffer.data, d.texel, COUNT * sizeof(envsamp_texel))
              || !all_rubbish((envsamp_texel *)texels.buffer.data + COUNT,
                              9 * sizeof(envsamp_texel));
        draw_free(&d);
    }
    CHECK(IS(wrong, 0) && kd_guarded_intact(&texels) && kd_guarded_intact(&scratch),
          "rows that lie apart, and room to spare, change nothing");
    free(texels.block);
    free(scratch.block);
    free(wide.value);
    free(c.value);
}

/* ---- all of it ---- */

static void test_all_counts(void)
{
    int kernel, scan;

    for (kernel = 0; kernel <= KERNELS; kernel++)
        for (scan = 0; scan < scans_of(kernel); scan++) {
            test_counts(kernel, scan);
            test_counts_of_one(kernel, scan);
            test_counts_of_maps(kernel, scan);
        }
}

static void test_choices(void)
{
    int kernel, scan;

    for (scan = 0; scan < 2; scan++) {
        for (kernel = 0; kernel < KERNELS; kernel++)
            test_plain(kernel, scan);
        test_plain_maps(scan);
        test_start(scan);
    }
    test_start_even();
    test_threshold();
}

static void test_statistics(void)
{
    int kernel, scan, repeat, count, kind;

    for (repeat = 0; repeat < 2; repeat++)
        for (count = 64; count <= 1024; count *= 4)
            test_density(count, repeat);
    for (kind = 0; kind < 3; kind++)
        for (scan = 0; scan < 2; scan++)
            test_few(scan, kind);
    test_random_masses();
    test_independence();
    for (kernel = 0; kernel < KERNELS; kernel++) {
        for (scan = 0; scan < 2 && !is_wide(kernel); scan++)
            test_frequency_row(kernel, scan);
        test_frequency(kernel, "constant");
        test_frequency(kernel, "foliage");
    }
}

int main(int argc, char **argv)
{
    maps_make();
    rects_make();
    if (argc < 2 || strcmp(argv[1], "quick") != 0) {
        test_all_counts();
        test_statistics();
    }
    test_choices();
    test_shapes();
    test_lones();
    test_ranges();
    test_sun();
    test_brightest();
    test_bad_input();
    test_scratch();
    test_again();
    test_stride();
    maps_free();
    return check_done();
}
