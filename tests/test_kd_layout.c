/* test_kd_layout.c: another reader of stored tables, which knows the byte offsets that the header's
 * section KD TABLE tells and none of its structs, against the library: samples of WARP and ALIAS
 * and densities of all, in double, for every mapping.
 */
#include "check.h"

#include "../envsamp.h"

#include "kd_fixture.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"


/* ---- the reader: bytes alone ---- */

/* Offsets of the header's fields, in bytes. */
enum { AT_MAGIC = 0, AT_VERSION = 4, AT_MAPPING = 12, AT_BYTES = 16, AT_SELECT = 24,
       AT_TILE_BITS_X = 28, AT_TILE_BITS_Y = 32, AT_ALIAS_SHIFT = 36, AT_ALIAS = 40,
       AT_GRID_BITS_X = 44, AT_GRID_BITS_Y = 48, AT_GRID = 52, AT_BILINEAR = 76, AT_WIDTH = 80,
       AT_HEIGHT = 84, AT_BLOCK_COUNT = 88, AT_NODES = 96, AT_COMPENSATION = 100,
       AT_INTEGRAL = 112, AT_EXCESS = 120, AT_MAX_RATIO = 128, AT_BAD_PIXELS = 160, AT_NODE_COUNT = 68,
       AFTER_HEADER = 192 };

enum { WARP = 0, ALIAS = 1, FIT = 2 };
enum { LATLONG = 0, HEMISPHERE = 1, OCTAHEDRAL = 2 };

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

/* Word `part` of a record, of 5 words. */
static uint32_t record(const unsigned char *table, uint32_t index, size_t part)
{
    return word(table, AFTER_HEADER + 20 * (size_t)index + 4 * part);
}

/* Word `part` of what a link leads to. */
static uint32_t linked(const unsigned char *table, uint32_t link, size_t part)
{
    return word(table, 4 * ((size_t)(link ^ TOP_BIT) + part));
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
static void direct_polar(double turns, double north, double south, double dir[3])
{
    const double sine = sqrt(north * south);

    dir[0] = cos(2.0 * KD_PI * turns) * sine;
    dir[1] = sin(2.0 * KD_PI * turns) * sine;
    dir[2] = 0.5 * (south - north);
}

/* Of the octahedral square, by concentric squares: each is a circle of latitude, and its sides are
   the quadrants. */
static void direct_octahedral(double u, double v, double dir[3])
{
    const double a = 2.0 * u - 1.0, b = 2.0 * v - 1.0, depth = 1.0 - fabs(a) - fabs(b);
    const double r = 1.0 - fabs(depth), ring = r * sqrt(2.0 - r * r);
    const double phi = r > 0.0 ? 0.25 * KD_PI * ((fabs(b) - fabs(a)) / r + 1.0) : 0.0;

    dir[0] = copysign(cos(phi) * ring, a);
    dir[1] = copysign(sin(phi) * ring, b);
    dir[2] = copysign(1.0 - r * r, depth);
}

/* And back: u, v. */
static void square_of(const float dir[3], double uv[2])
{
    const double x = (double)dir[0], y = (double)dir[1], z = (double)dir[2];
    const double length = sqrt(x * x + y * y + z * z), up = fabs(z) / length;
    const double r = sqrt((x * x + y * y) / (length * length) / (1.0 + up));
    const double turn = 2.0 / KD_PI * atan2(fabs(y), fabs(x)), b = r * turn, a = r - b;

    uv[0] = 0.5 + 0.5 * copysign(z < 0.0 ? 1.0 - b : a, x);
    uv[1] = 0.5 + 0.5 * copysign(z < 0.0 ? 1.0 - a : b, y);
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

/* The direction at fractions of the way from edge to edge: x0, x1, y0, y1. */
static void direct(const unsigned char *t, const uint32_t edge[4], double fx, double fy,
                   double dir[3])
{
    const double x = between(real(edge[0]), real(edge[1]), fx);

    if (word(t, AT_MAPPING) == OCTAHEDRAL)
        direct_octahedral(x, between(real(edge[2]), real(edge[3]), fy), dir);
    else
        direct_polar(x, between(edge_north(edge[2]), edge_north(edge[3]), fy),
                     between(edge_south(edge[2]), edge_south(edge[3]), fy), dir);
}

static place read_warp(const unsigned char *t, double u0, double u1)
{
    const double across = ldexp(u0, (int)word(t, AT_TILE_BITS_X));
    const double down = ldexp(u1, (int)word(t, AT_TILE_BITS_Y));
    const uint32_t tile = ((uint32_t)down << word(t, AT_TILE_BITS_X)) + (uint32_t)across;
    const double f[2] = { across - floor(across), down - floor(down) };
    double low[2] = { 0.0, 0.0 }, high[2] = { 1.0, 1.0 }, part[2];
    uint32_t edge[4], link = record(t, tile, 4);
    place p;
    int k;

    for (k = 0; k < 4; k++)
        edge[k] = record(t, tile, (size_t)k);
    while (link & TOP_BIT) {
        const uint32_t cut = linked(t, link, 0);
        const int axis = (int)(cut >> 31), above = f[axis] >= fabs(real(cut));

        *(above ? &low[axis] : &high[axis]) = fabs(real(cut));
        edge[2 * axis + !above] = linked(t, link, 1);
        link = linked(t, link, above ? 3 : 2);
    }
    for (k = 0; k < 2; k++)
        part[k] = (f[k] - low[k]) / (high[k] - low[k]);
    p.pdf = real(link);
    direct(t, edge, part[0], part[1], p.dir);
    return p;
}

/* The leading bits of u1 and u0 are the bin, what is left of u0 is the azimuth. The draw that is
   left of u1, in the order of the bin, is below the bin's own draws or it is the alias's, and how
   far it is from the end of those is the polar angle, backwards for its own. */
static place read_alias(const unsigned char *t, double u0, double u1)
{
    const uint32_t shift = word(t, AT_ALIAS_SHIFT), bits = 24 - shift, bits_y = bits / 2;
    const double across = ldexp(u0, (int)(bits - bits_y)), down = ldexp(u1, (int)bits_y);
    const uint32_t bin = ((uint32_t)down << (bits - bits_y)) + (uint32_t)across;
    const uint32_t order = (uint32_t)((4294967295u - bin) * (uint64_t)2654435769u) >> 8;
    const uint32_t at = (uint32_t)ldexp(down - floor(down), 24) ^ order;
    const uint32_t both = entry(t, AT_ALIAS, bin, 4, 0), own = both >> bits << bits;
    const uint32_t block = at < own ? bin : both - own;
    const double fy = at < own ? (double)(own - at) / (double)own
                               : (double)(at - own) / (double)((1u << 24) - own);
    uint32_t edge[4];
    place p;
    int k;

    for (k = 0; k < 4; k++)
        edge[k] = record(t, block, (size_t)k);
    p.pdf = real(record(t, block, 4));
    direct(t, edge, across - floor(across), fy, p.dir);
    return p;
}

/* Azimuth, 0 to 4, and polar, 0 to 2, as nodes and grid have them; of an octahedral map 4 u and
   2 v. */
static void unroll(uint32_t mapping, const float dir[3], double at[2])
{
    const double x = (double)dir[0], y = (double)dir[1], z = (double)dir[2];
    const double r = sqrt(x * x + y * y), q = r > 0.0 ? fabs(y) / (fabs(x) + fabs(y)) : 0.0;
    const double upper = x < 0.0 ? 2.0 - q : q, s = r / (r + fabs(z));

    at[0] = y < 0.0 ? 4.0 - upper : upper;
    at[1] = z < 0.0 ? 2.0 - s : s;
    if (mapping == OCTAHEDRAL) {
        square_of(dir, at);
        at[0] *= 4.0;
        at[1] *= 2.0;
    }
}

/* How near a place is to where the map ends: there a direction may round across. */
static double to_border(uint32_t mapping, const double at[2])
{
    if (mapping == OCTAHEDRAL)
        return fmin(fmin(at[0], 4.0 - at[0]), fmin(at[1], 2.0 - at[1]));
    return mapping == HEMISPHERE ? fabs(at[1] - 1.0) : 1.0;
}

static uint32_t cell(double at, double range, uint32_t bits)
{
    const uint32_t count = 1u << bits, index = (uint32_t)(at / range * (double)count);

    return index < count ? index : count - 1;
}

/* The density in a direction; *slack tells how near the nearest cut was, in its coordinate. */
static double read_pdf(const unsigned char *t, const float dir[3], double *slack)
{
    const double polar_end = word(t, AT_MAPPING) == HEMISPHERE ? 1.0 : 2.0;
    double at[2];
    uint32_t link, x, y;

    unroll(word(t, AT_MAPPING), dir, at);
    *slack = to_border(word(t, AT_MAPPING), at);
    if (at[1] > polar_end)
        return 0.0;
    x = cell(at[0], 4.0, word(t, AT_GRID_BITS_X));
    y = cell(at[1], polar_end, word(t, AT_GRID_BITS_Y));
    link = entry(t, AT_GRID, (y << word(t, AT_GRID_BITS_X)) + x, 4, 0);
    while (link & TOP_BIT) {
        size_t number = 0;

        while (number < 3) {
            const uint32_t cut = linked(t, link, number);
            const double from = at[cut >> 31] - fabs(real(cut));

            if (cut)                    /* 0: there is none */
                *slack = fmin(*slack, fabs(from));
            number = 2 * number + (from >= 0.0 ? 2 : 1);
        }
        link = linked(t, link, number);
    }
    return real(link);
}

/* ---- against the library ---- */

/* dir: over 1e-6, or, about the poles of azimuth, over what rounding 1 - cos theta means there. */
typedef struct differences { double dir, pdf; long densities, near, dark; } differences;

static void compare_sample(const envsamp_kd *kd, const unsigned char *table, float u0, float u1,
                           differences *d)
{
    const envsamp_sample s = envsamp_kd_sample(kd, u0, u1);
    const place p = word(table, AT_SELECT) == WARP ? read_warp(table, (double)u0, (double)u1)
                                                   : read_alias(table, (double)u0, (double)u1);
    const double sine = word(table, AT_MAPPING) == OCTAHEDRAL ? 1.0
                      : sqrt(p.dir[0] * p.dir[0] + p.dir[1] * p.dir[1]);
    int c;

    for (c = 0; c < 3; c++)
        d->dir = fmax(d->dir, fabs((double)s.dir[c] - p.dir[c])
                              / fmax(1e-6, 3e-7 / fmax(sine, 1e-30)));
    d->pdf = fmax(d->pdf, fabs((double)s.pdf - p.pdf));
}

/* A coordinate is good to 1e-6, of the octahedral square 4 times the 3e-7 of its points. */
static void compare_pdf(const envsamp_kd *kd, const unsigned char *table, const float dir[3],
                        differences *d)
{
    double slack;
    const double pdf = read_pdf(table, dir, &slack), got = (double)envsamp_kd_pdf(kd, dir);

    d->dark += !(pdf > 0.0);
    if (pdf < got || pdf > got) {
        d->near++;
        d->densities += slack > (word(table, AT_MAPPING) == OCTAHEDRAL ? 1.2e-6 : 1e-6);
    }
}

static void compare(const kd_fixture *f, const unsigned char *table, int points,
                    const char *what)
{
    differences d = { 0.0, 0.0, 0, 0, 0 };
    pcg32 random = pcg32_make(91, 0);
    int i;

    for (i = 0; i < points; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(f->kd, u0, u1);
        const float dir[3] = { u0 - 0.5f, u1 - 0.5f, pcg32_float(&random) - 0.5f };

        if (word(table, AT_SELECT) != FIT)
            compare_sample(f->kd, table, u0, u1, &d);
        compare_pdf(f->kd, table, s.dir, &d);
        compare_pdf(f->kd, table, dir, &d);
    }
    if (word(table, AT_SELECT) != FIT) {
        CHECK(d.dir <= 1.0, "%s: samples are where the bytes say, %.2f of what may be", what,
              d.dir);
        CHECK(d.pdf <= 0.0, "%s: with their densities, but for %.1e", what, d.pdf);
    }
    CHECK(!d.densities && d.near * 2000 < 2 * points,
          "%s: densities of directions too, but for %ld, and %ld at edges", what, d.densities,
          d.near);
    CHECK(d.dark * 2 < 2 * points, "%s: with light in most of them: %ld without", what, d.dark);
}

/* The fields that say what the table is. */
static void check_header(const kd_fixture *f, const unsigned char *table, const char *what)
{
    const double figures[3] = { f->info.integral, f->info.excess_variance, f->info.max_ratio };
    int i, wrong = 0;

    CHECK(table[0] == 'E' && table[1] == 'S' && table[2] == 'K' && table[3] == 'D'
          && word(table, AT_VERSION) == 6 && word(table, AT_BYTES) == envsamp_kd_bytes(f->kd)
          && word(table, AT_SELECT) == (uint32_t)f->desc.select, "%s: who it is", what);
    CHECK(word(table, AT_WIDTH) == (uint32_t)f->image.width
          && word(table, AT_HEIGHT) == (uint32_t)f->image.height
          && word(table, AT_BLOCK_COUNT) == (uint32_t)f->info.block_count, "%s: its size", what);
    CHECK(word(table, AT_MAPPING) == (uint32_t)f->image.mapping
          && word(table, AT_BILINEAR) == (f->desc.nearest ? 0u : 1u)
          && fabs(real(word(table, AT_COMPENSATION)) - (double)f->desc.mis_compensation) <= 0.0
          && word(table, AT_BAD_PIXELS) == 0 && word(table, AT_BAD_PIXELS + 4) == 0,
          "%s: what it is of", what);
    for (i = 0; i < 3; i++)
        wrong += fabs(real_double(table, AT_INTEGRAL + 8 * (size_t)i) - figures[i]) > 0.0;
    CHECK(!wrong, "%s: integral, excess variance, largest ratio", what);
}

/* The arrays follow the header and one another, each as large as it is said to be. */
static void check_arrays(const unsigned char *table, const char *what)
{
    const int warp = word(table, AT_SELECT) == WARP, alias = word(table, AT_SELECT) == ALIAS;
    const uint32_t blocks = word(table, AT_BLOCK_COUNT);
    const uint32_t records = warp ? 1u << (word(table, AT_TILE_BITS_X)
                                           + word(table, AT_TILE_BITS_Y)) : blocks;
    const uint32_t bins = alias ? 1u << (24 - word(table, AT_ALIAS_SHIFT)) : 0;
    const uint32_t cells = 1u << (word(table, AT_GRID_BITS_X) + word(table, AT_GRID_BITS_Y));
    const uint32_t at[4] = { AT_ALIAS, AT_NODES, AT_GRID, AT_BYTES };
    const uint32_t size[4] = { 4 * bins, 28 * word(table, AT_NODE_COUNT), 4 * cells, 0 };
    uint32_t end = AFTER_HEADER + 20 * records + 16 * (blocks - records);
    int i, wrong = 0;

    for (i = 0; i < 4; i++) {
        wrong += word(table, at[i]) != end;
        end += size[i];
    }
    CHECK(word(table, AT_NODE_COUNT) >= 1 && word(table, AT_NODE_COUNT) <= blocks / 2 + 1,
          "%s: %u nodes for %u blocks", what, word(table, AT_NODE_COUNT), blocks);
    CHECK(!wrong && (!alias || (bins >= blocks && bins < 2 * blocks)),
          "%s: arrays are where they belong, but %d", what, wrong);
}

/* Edges rise inside the map, and polar angles change their pole at the equator of LATLONG alone. */
static void check_edges(const unsigned char *table, const char *what)
{
    const int warp = word(table, AT_SELECT) == WARP;
    const uint32_t count = warp ? 1u << (word(table, AT_TILE_BITS_X) + word(table, AT_TILE_BITS_Y))
                                : word(table, AT_BLOCK_COUNT);
    const uint32_t mapping = word(table, AT_MAPPING);
    const double end = mapping == LATLONG ? 2.0 : 1.0;
    double area = 0.0, last = 0.0;
    uint32_t i;
    int k, wrong = 0;

    for (i = 0; i < count; i++) {
        double edge[4];

        for (k = 0; k < 4; k++) {
            const uint32_t bits = record(table, i, (size_t)k);

            edge[k] = k < 2 || mapping == OCTAHEDRAL ? real(bits) : edge_north(bits);
            wrong += bits & TOP_BIT && (k < 2 || mapping != LATLONG);
        }
        wrong += !(edge[0] >= 0.0 && edge[0] < edge[1] && edge[1] <= 1.0);
        wrong += !(edge[2] >= 0.0 && edge[2] < edge[3]
                   && edge[3] <= end);
        last = fmax(last, edge[3]);
        area += (edge[1] - edge[0]) * (edge[3] - edge[2]);
    }
    area -= end;
    CHECK(last >= end, "%s: where the map ends", what);
    CHECK(!wrong && fabs(area) <= 1e-6, "%s: %s cover the map, but for %.1e", what,
          warp ? "tiles" : "blocks", area);
}

/* What to build. */
typedef struct build {
    envsamp_kd_select select;
    envsamp_mapping mapping;
    int bilinear;
    float mis;
    int points;                 /* samples to compare, and twice as many densities */
} build;

static void test_layout(build b, const char *name, int width, int height, int blocks)
{
    static const char *const selects[3] = { "WARP", "ALIAS", "FIT" };
    static const char *const mappings[3] = { "lat-long", "hemisphere", "octahedral" };
    envsamp_kd_desc desc = kd_desc(blocks, b.select);
    unsigned char *table;
    envsamp_image view;
    char what[96];
    kd_fixture f;
    image map;

    map_make(name, width, height, &map);
    view = kd_image(map.rgb, width, height, 3);
    view.mapping = b.mapping;
    desc.nearest = !b.bilinear;
    desc.mis_compensation = b.mis;
    snprintf(what, sizeof what, "%s, %s%s, %s %dx%d", selects[b.select], mappings[b.mapping],
             b.bilinear ? ", bilinear" : "", name, width, height);
    CHECK(kd_fixture_build(&f, &view, &desc), "%s, %d blocks", what, blocks);
    if (f.kd) {
        table = (unsigned char *)kd_allocate(envsamp_kd_bytes(f.kd));
        memcpy(table, f.kd, envsamp_kd_bytes(f.kd));
        check_header(&f, table, what);
        check_arrays(table, what);
        check_edges(table, what);
        compare(&f, table, b.points, what);
        free(table);
    }
    kd_fixture_free(&f);
    image_free(&map);
}

static void test_maps(build b)
{
    test_layout(b, "sky", 512, 256, 6144);
    test_layout(b, "studio", 256, 128, 1000);
    test_layout(b, "night", 147, 75, 900);
    test_layout(b, "foliage", 512, 256, 6144);
    test_layout(b, "foliage", 33, 130, 100);
    test_layout(b, "foliage", 64, 32, 2);
    test_layout(b, "constant", 64, 32, 10);
}

/* Squares too, as octahedral maps are. */
static void test_mapping(build b)
{
    test_layout(b, "sky", 256, 256, 6144);
    test_layout(b, "studio", 256, 128, 1000);
    test_layout(b, "night", 75, 75, 900);
    test_layout(b, "foliage", 33, 130, 100);
    test_layout(b, "foliage", 32, 32, 2);
    test_layout(b, "constant", 32, 32, 10);
}

int main(void)
{
    const uint32_t one = 1;
    unsigned char first;
    build b = { ENVSAMP_KD_WARP, ENVSAMP_LATLONG, 0, 0.0f, 0 };
    int select, mapping;

    memcpy(&first, &one, 1);
    if (!first) {
        CHECK_SKIP("tables of this machine are not little-endian");
        return check_done();
    }
    for (select = WARP; select <= FIT; select++) {
        b.select = (envsamp_kd_select)select;
        b.mapping = ENVSAMP_LATLONG;
        b.bilinear = 0;
        b.points = 100000;
        test_maps(b);
        b.points = 20000;
        for (mapping = LATLONG; mapping <= OCTAHEDRAL; mapping++) {
            b.mapping = (envsamp_mapping)mapping;
            for (b.bilinear = mapping == LATLONG; b.bilinear < 2; b.bilinear++)
                test_mapping(b);
        }
        b.bilinear = 1;
        b.mis = 0.25f;
        test_layout(b, "sky", 64, 64, 300);
        b.mis = 0.0f;
    }
    return check_done();
}
