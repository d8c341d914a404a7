/* test_kd_layout.c: another reader of stored tables, which knows the byte offsets that the header's
 * section KD TABLE tells and none of its structs, against the library: samples and densities of
 * WARP and ALIAS, in double.
 */
#include "check.h"

#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "kd_fixture.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"

#define POINTS 100000

/* ---- the reader: bytes alone ---- */

/* Offsets of the header's fields, in bytes. */
enum { AT_MAGIC = 0, AT_VERSION = 4, AT_BYTES = 8, AT_SELECT = 16, AT_WIDTH = 32, AT_HEIGHT = 36,
       AT_BLOCK_COUNT = 40, AT_ALIAS_SHIFT = 48, AT_GRID_BITS_X = 52, AT_GRID_BITS_Y = 56,
       AT_TILE_BITS_X = 60, AT_TILE_BITS_Y = 64, AT_TILES = 92, AT_WARP = 96, AT_ROWS = 100,
       AT_BOUNDS = 104, AT_PDF = 108, AT_ALIAS = 112, AT_ROOTS = 116, AT_NODES = 120,
       AT_GRID = 124, AT_INTEGRAL = 128, AT_EXCESS = 136, AT_MAX_RATIO = 144 };

#define TOP_BIT 0x80000000u

static uint32_t word(const unsigned char *table, size_t at)
{
    return (uint32_t)table[at] | (uint32_t)table[at + 1] << 8 | (uint32_t)table[at + 2] << 16
         | (uint32_t)table[at + 3] << 24;
}

/* Word `part` of entry `index`, `size` bytes each, of the array whose offset stands at `field`. */
static uint32_t entry(const unsigned char *table, size_t field, uint32_t index, size_t size,
                      size_t part)
{
    return word(table, word(table, field) + size * (size_t)index + 4 * part);
}

/* A float by its bits: sign, exponent, fraction. */
static double real(uint32_t bits)
{
    const int exponent = (int)(bits >> 23 & 0xff);
    const double fraction = (double)(bits & 0x7fffff) + (exponent ? 8388608.0 : 0.0);
    const double size = ldexp(fraction, (exponent ? exponent : 1) - 150);

    return bits & TOP_BIT ? -size : size;
}

/* What a double of the header holds, one that is zero or normal. */
static double real_double(const unsigned char *table, size_t at)
{
    const uint32_t low = word(table, at), high = word(table, at + 4);
    const double fraction = ldexp((double)(high & 0xfffff), 32) + (double)low;

    return high | low ? ldexp(1.0 + ldexp(fraction, -52), (int)(high >> 20 & 0x7ff) - 1023) : 0.0;
}

typedef struct place { double dir[3], pdf; } place;

/* Azimuth in turns, 1 - cos theta, 1 + cos theta. */
static void direct(double turns, double north, double south, double dir[3])
{
    const double sine = sqrt(north * south);

    dir[0] = cos(2.0 * KD_PI * turns) * sine;
    dir[1] = sin(2.0 * KD_PI * turns) * sine;
    dir[2] = 0.5 * (south - north);
}

/* 1 - cos theta and 1 + cos theta of an edge. */
static double edge_north(uint32_t bits)
{
    return bits & TOP_BIT ? 2.0 + real(bits) : real(bits);
}

static double edge_south(uint32_t bits)
{
    return bits & TOP_BIT ? -real(bits) : 2.0 - real(bits);
}

static double between(double from, double to, double f)
{
    return from + f * (to - from);
}

static place read_warp(const unsigned char *t, double u0, double u1)
{
    const double across = ldexp(u0, (int)word(t, AT_TILE_BITS_X));
    const double down = ldexp(u1, (int)word(t, AT_TILE_BITS_Y));
    const uint32_t tile = ((uint32_t)down << word(t, AT_TILE_BITS_X)) + (uint32_t)across;
    const double f[2] = { across - floor(across), down - floor(down) };
    double low[2] = { 0.0, 0.0 }, high[2] = { 1.0, 1.0 }, part[2];
    uint32_t edge[4], link = entry(t, AT_ROOTS, tile, 4, 0);
    place p;
    int k;

    for (k = 0; k < 4; k++)
        edge[k] = entry(t, AT_TILES, tile, 16, (size_t)k);
    while (link & TOP_BIT) {
        const uint32_t index = link ^ TOP_BIT, cut = entry(t, AT_WARP, index, 16, 0);
        const int axis = (int)(cut >> 31), above = f[axis] >= fabs(real(cut));

        *(above ? &low[axis] : &high[axis]) = fabs(real(cut));
        edge[2 * axis + !above] = entry(t, AT_WARP, index, 16, 1);
        link = entry(t, AT_WARP, index, 16, above ? 3 : 2);
    }
    for (k = 0; k < 2; k++)
        part[k] = (f[k] - low[k]) / (high[k] - low[k]);
    p.pdf = real(link);
    direct(between(real(edge[0]), real(edge[1]), part[0]),
           between(edge_north(edge[2]), edge_north(edge[3]), part[1]),
           between(edge_south(edge[2]), edge_south(edge[3]), part[1]), p.dir);
    return p;
}

/* The leading bits of u0 are the bin; the number that they lead is below the bin's own draws or it
   is the alias's, and its place among those, with the lower half of u1, is the azimuth. */
static place read_alias(const unsigned char *t, double u0, double u1)
{
    const uint32_t shift = word(t, AT_ALIAS_SHIFT), draw = (uint32_t)(u0 * 16777216.0);
    const uint32_t bin = draw >> shift, at = draw & ((1u << shift) - 1);
    const uint32_t both = entry(t, AT_ALIAS, bin, 4, 0), own = both >> (24 - shift);
    const uint32_t block = at < own ? bin : both & ((1u << (24 - shift)) - 1);
    const double lower = u1 * 4096.0 + 0.5 - floor(u1 * 4096.0 + 0.5);
    const double fx = ((double)(at < own ? at : at - own) + lower)
                    / (double)(at < own ? own : (1u << shift) - own);
    const uint32_t x = entry(t, AT_BOUNDS, block, 8, 0), y = entry(t, AT_BOUNDS, block, 8, 1);
    const uint32_t top = entry(t, AT_ROWS, y & 0xffff, 4, 0);
    const uint32_t end = entry(t, AT_ROWS, y >> 16, 4, 0);
    place p;

    p.pdf = real(entry(t, AT_PDF, block, 4, 0));
    direct(between((double)(x & 0xffff), (double)(x >> 16), fx) / (double)word(t, AT_WIDTH),
           between(edge_north(top), edge_north(end), u1),
           between(edge_south(top), edge_south(end), u1), p.dir);
    return p;
}

/* Azimuth, 0 to 4, and polar, 0 to 2, as nodes and grid have them. */
static void unroll(const float dir[3], double *azimuth, double *polar)
{
    const double x = (double)dir[0], y = (double)dir[1], z = (double)dir[2];
    const double r = sqrt(x * x + y * y), q = r > 0.0 ? fabs(y) / (fabs(x) + fabs(y)) : 0.0;
    const double upper = x < 0.0 ? 2.0 - q : q, s = r / (r + fabs(z));

    *azimuth = y < 0.0 ? 4.0 - upper : upper;
    *polar = z < 0.0 ? 2.0 - s : s;
}

static uint32_t cell(double at, double range, uint32_t bits)
{
    const uint32_t count = 1u << bits, index = (uint32_t)(at / range * (double)count);

    return index < count ? index : count - 1;
}

/* The density in a direction; *slack tells how near the nearest cut was, in its coordinate. */
static double read_pdf(const unsigned char *t, const float dir[3], double *slack)
{
    double at[2];
    uint32_t link, x, y;

    unroll(dir, &at[0], &at[1]);
    x = cell(at[0], 4.0, word(t, AT_GRID_BITS_X));
    y = cell(at[1], 2.0, word(t, AT_GRID_BITS_Y));
    link = entry(t, AT_GRID, (y << word(t, AT_GRID_BITS_X)) + x, 4, 0);
    *slack = 1.0;
    while (link & TOP_BIT) {
        const uint32_t cut = entry(t, AT_NODES, link ^ TOP_BIT, 12, 0);
        const double from = at[cut >> 31] - fabs(real(cut));

        *slack = fmin(*slack, fabs(from));
        link = entry(t, AT_NODES, link ^ TOP_BIT, 12, from >= 0.0 ? 2 : 1);
    }
    return real(link);
}

/* ---- against the library ---- */

/* dir: over 1e-6, or, about the poles, over what rounding 1 - cos theta means there. */
typedef struct differences { double dir, pdf; long densities, near; } differences;

static void compare_sample(const envsamp_kd *kd, const unsigned char *table, float u0, float u1,
                           differences *d)
{
    const int warp = word(table, AT_SELECT) == 0;
    const envsamp_sample s = envsamp_kd_sample(kd, u0, u1);
    const place p = warp ? read_warp(table, (double)u0, (double)u1)
                         : read_alias(table, (double)u0, (double)u1);
    const double sine = sqrt(p.dir[0] * p.dir[0] + p.dir[1] * p.dir[1]);
    int c;

    for (c = 0; c < 3; c++)
        d->dir = fmax(d->dir, fabs((double)s.dir[c] - p.dir[c])
                              / fmax(1e-6, 3e-7 / fmax(sine, 1e-30)));
    d->pdf = fmax(d->pdf, fabs((double)s.pdf - p.pdf));
}

static void compare_pdf(const envsamp_kd *kd, const unsigned char *table, const float dir[3],
                        differences *d)
{
    double slack;
    const double pdf = read_pdf(table, dir, &slack), got = (double)envsamp_kd_pdf(kd, dir);

    if (pdf < got || pdf > got) {
        d->near++;
        d->densities += slack > 1e-6;
    }
}

static void compare(const kd_fixture *f, const unsigned char *table, const char *what)
{
    differences d = { 0.0, 0.0, 0, 0 };
    pcg32 random = pcg32_make(91, 0);
    int i;

    for (i = 0; i < POINTS; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(f->kd, u0, u1);
        const float dir[3] = { u0 - 0.5f, u1 - 0.5f, pcg32_float(&random) - 0.5f };

        compare_sample(f->kd, table, u0, u1, &d);
        compare_pdf(f->kd, table, s.dir, &d);
        compare_pdf(f->kd, table, dir, &d);
    }
    CHECK(d.dir <= 1.0, "%s: samples are where the bytes say, %.2f of what may be", what, d.dir);
    CHECK(d.pdf <= 0.0, "%s: with their densities, but for %.1e", what, d.pdf);
    CHECK(!d.densities && d.near * 2000 < 2 * POINTS,
          "%s: densities of directions too, but for %ld, and %ld at edges", what, d.densities,
          d.near);
}

/* The fields that say what the table is. */
static void check_header(const kd_fixture *f, const unsigned char *table, const char *what)
{
    const double figures[3] = { f->info.integral, f->info.excess_variance, f->info.max_ratio };
    int i, wrong = 0;

    CHECK(table[0] == 'E' && table[1] == 'S' && table[2] == 'K' && table[3] == 'D'
          && word(table, AT_VERSION) == 2 && word(table, AT_BYTES) == envsamp_kd_bytes(f->kd)
          && word(table, AT_SELECT) == (uint32_t)f->desc.select, "%s: who it is", what);
    CHECK(word(table, AT_WIDTH) == (uint32_t)f->image.width
          && word(table, AT_HEIGHT) == (uint32_t)f->image.height
          && word(table, AT_BLOCK_COUNT) == (uint32_t)f->info.block_count, "%s: its size", what);
    for (i = 0; i < 3; i++)
        wrong += fabs(real_double(table, AT_INTEGRAL + 8 * (size_t)i) - figures[i]) > 0.0;
    CHECK(!wrong, "%s: integral, excess variance, largest ratio", what);
}

static void test_layout(envsamp_kd_select select, const char *name, int width, int height,
                        int blocks)
{
    const envsamp_kd_desc desc = kd_desc(blocks, select);
    unsigned char *table;
    envsamp_image view;
    char what[64];
    kd_fixture f;
    image map;

    map_make(name, width, height, &map);
    view = kd_image(map.rgb, width, height, 3);
    snprintf(what, sizeof what, "%s, %s %dx%d", select == ENVSAMP_KD_WARP ? "WARP" : "ALIAS", name,
             width, height);
    CHECK(kd_fixture_build(&f, &view, &desc), "%s, %d blocks", what, blocks);
    if (f.kd) {
        table = (unsigned char *)kd_allocate(envsamp_kd_bytes(f.kd));
        memcpy(table, f.kd, envsamp_kd_bytes(f.kd));
        check_header(&f, table, what);
        compare(&f, table, what);
        free(table);
    }
    kd_fixture_free(&f);
    image_free(&map);
}

int main(void)
{
    const envsamp_kd_select selects[2] = { ENVSAMP_KD_WARP, ENVSAMP_KD_ALIAS };
    const uint32_t one = 1;
    unsigned char first;
    int i;

    memcpy(&first, &one, 1);
    if (!first) {
        CHECK_SKIP("tables of this machine are not little-endian");
        return check_done();
    }
    for (i = 0; i < 2; i++) {
        test_layout(selects[i], "sky", 512, 256, 6144);
        test_layout(selects[i], "studio", 256, 128, 1000);
        test_layout(selects[i], "night", 147, 75, 900);
        test_layout(selects[i], "foliage", 512, 256, 6144);
        test_layout(selects[i], "foliage", 33, 130, 100);
        test_layout(selects[i], "foliage", 64, 32, 2);
        test_layout(selects[i], "constant", 64, 32, 10);
    }
    return check_done();
}
