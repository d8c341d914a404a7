/* test_bilinear.c: tables for maps that are looked up bilinearly, kd and cdf, of all three
 * mappings: what they claim against an integration of the test's own, density wherever there is
 * light, integrals by Monte Carlo beside lookups that must be rejected, and the way back.
 *
 * The reference here interpolates, wraps and finds directions by itself, in double and with libm.
 * Of the library it asks only tables. Which fault each part guards against stands above it.
 */
#include "check.h"

#include "../envsamp.h"

#include "kd_fixture.h"
#include "statistics.h"
#include "../examples/common/random.h"

#include <float.h>

#define UNIT 16777216.0         /* numbers that a float u can be */

static const char *const mapping_names[] = { "lat-long", "hemisphere", "octahedral" };

/* ---- maps ---- */

typedef struct map {
    char name[64];
    float *pixels;
    envsamp_image image;
} map;

static map map_black(envsamp_mapping mapping, int width, int height)
{
    map m;

    memset(&m, 0, sizeof m);
    m.pixels = (float *)kd_allocate((size_t)width * (size_t)height * sizeof *m.pixels);
    m.image = kd_image(m.pixels, width, height, 1);
    m.image.mapping = mapping;
    return m;
}

static void map_free(map *m)
{
    free(m->pixels);
    memset(m, 0, sizeof *m);
}

static map map_lone(envsamp_mapping mapping, int width, int height, int x, int y)
{
    map m = map_black(mapping, width, height);

    m.pixels[y * width + x] = 3.0f;
    snprintf(m.name, sizeof m.name, "%s %dx%d, only (%d, %d)", mapping_names[mapping], width,
             height, x, y);
    return m;
}

typedef enum content { CONSTANT, RANDOM, HOLES, SMOOTH, CHECKER, SUN, CONTENTS } content;

static const char *const content_names[] = {
    "constant", "random", "holes", "smooth", "checkerboard", "sun"
};

/* Values are multiples of 1/256 and so few that all means of two or four are exact in a float, but
   beside the sun, which is 1e9 times as bright as its sky. */
static float content_value(content kind, int x, int y, int width, int height, pcg32 *random)
{
    const double turn = 2.0 * KD_PI * ((double)x + 0.5) / (double)width;
    const double down = KD_PI * ((double)y + 0.5) / (double)height;
    const int number = (int)(pcg32_next(random) >> 24);

    switch (kind) {
    case RANDOM: return (float)(1 + number) / 256.0f;
    case HOLES: return (float)(number < 160 ? 0 : number) / 256.0f;
    case SMOOTH: return (float)floor(128.0 + 100.0 * sin(turn) * sin(down)) / 256.0f;
    case CHECKER: return (x + y) % 2 ? 1.0f : 0.0f;
    case SUN: return x == width / 3 && y == height / 3 ? 1e9f : (float)(128 + number) / 256.0f;
    default: return 0.75f;
    }
}

static map map_make(content kind, envsamp_mapping mapping, int width, int height)
{
    pcg32 random = pcg32_make(5, (uint64_t)(width * 100 + height));
    map m = map_black(mapping, width, height);
    int x, y;

    for (y = 0; y < height; y++)
        for (x = 0; x < width; x++)
            m.pixels[y * width + x] = content_value(kind, x, y, width, height, &random);
    if (kind == CHECKER && width * height == 1)
        m.pixels[0] = 1.0f;             /* else black */
    if (kind == HOLES)
        m.pixels[(height / 2) * width] = 0.5f;
    snprintf(m.name, sizeof m.name, "%s %dx%d, %s", mapping_names[mapping], width, height,
             content_names[kind]);
    return m;
}

/* ---- the reference: texels, radiance, directions ---- */

/* What a lookup may do wrong. */
typedef enum fault {
    HONEST = 0, HALF_TEXEL, CLAMPED_SEAM, ROWS_WRAPPED, POLE_STRAIGHT, EDGE_MIRRORED, FAULTS
} fault;

static const char *const fault_names[] = {
    "that is right", "that is half a texel off", "that clamps at the seam",
    "that wraps rows round", "that goes straight on at a pole",
    "that does not turn over at an octahedral edge"
};

/* Texels one beyond an edge. Over the edge of the octahedral square a map goes on from the same
   edge, turned by half a turn about its middle; over a pole it goes on half a turn round; below the
   horizon of a hemisphere its last row stays. */
static double texel(const map *m, int x, int y, fault wrong)
{
    const int width = m->image.width, height = m->image.height;
    const int beyond_x = x < 0 || x >= width, below = y >= height, beyond_y = y < 0 || below;

    if (m->image.mapping == ENVSAMP_OCTAHEDRAL) {
        if (beyond_x) {
            x = x < 0 ? -1 - x : 2 * width - 1 - x;
            y = wrong == EDGE_MIRRORED ? y : height - 1 - y;
        }
        if (beyond_y) {
            y = y < 0 ? -1 - y : 2 * height - 1 - y;
            x = wrong == EDGE_MIRRORED ? x : width - 1 - x;
        }
        return (double)m->pixels[y * width + x];
    }
    if (beyond_y && wrong == ROWS_WRAPPED) {
        y = below ? 0 : height - 1;
    } else if (beyond_y) {
        y = below ? 2 * height - 1 - y : -1 - y;
        if (wrong != POLE_STRAIGHT && !(below && m->image.mapping == ENVSAMP_HEMISPHERE))
            x += width / 2;
    }
    if (wrong == CLAMPED_SEAM)
        x = x < 0 ? 0 : x < width ? x : width - 1;
    return (double)m->pixels[y * width + (x + width) % width];
}

/* Bilinear interpolation between texel centres; u and v in [0, 1]. Where texels meet it is
   continuous, so which of them a corner counts to does not matter. */
static double radiance(const map *m, double u, double v, fault wrong)
{
    const double shift = wrong == HALF_TEXEL ? 0.5 : 0.0;
    const double s = u * (double)m->image.width - 0.5 + shift, column = floor(s);
    const double t = v * (double)m->image.height - 0.5, row = floor(t);
    const double fx = s - column, fy = t - row;
    const int x = (int)column, y = (int)row;

    if (m->image.mapping == ENVSAMP_HEMISPHERE && v > 1.0)
        return 0.0;
    return (1.0 - fy) * ((1.0 - fx) * texel(m, x, y, wrong) + fx * texel(m, x + 1, y, wrong))
         + fy * ((1.0 - fx) * texel(m, x, y + 1, wrong) + fx * texel(m, x + 1, y + 1, wrong));
}

/* Equal-area octahedral square: see the header's reference [7]. */
static void octahedral_direction(double u, double v, double dir[3])
{
    const double a = 2.0 * u - 1.0, b = 2.0 * v - 1.0, rest = 1.0 - fabs(a) - fabs(b);
    const double r = 1.0 - fabs(rest);
    const double phi = r > 0.0 ? 0.25 * KD_PI * ((fabs(b) - fabs(a)) / r + 1.0) : 0.0;
    const double sine = r * sqrt(2.0 - r * r);

    dir[0] = copysign(sine * cos(phi), a);
    dir[1] = copysign(sine * sin(phi), b);
    dir[2] = copysign(1.0 - r * r, rest);
}

static void direction(envsamp_mapping mapping, double u, double v, double dir[3])
{
    const double theta = (mapping == ENVSAMP_LATLONG ? KD_PI : 0.5 * KD_PI) * v;

    if (mapping == ENVSAMP_OCTAHEDRAL) {
        octahedral_direction(u, v, dir);
        return;
    }
    dir[0] = cos(2.0 * KD_PI * u) * sin(theta);
    dir[1] = sin(2.0 * KD_PI * u) * sin(theta);
    dir[2] = cos(theta);
}

static void float_direction(envsamp_mapping mapping, double u, double v, float dir[3])
{
    double exact[3];

    direction(mapping, u, v, exact);
    dir[0] = (float)exact[0];
    dir[1] = (float)exact[1];
    dir[2] = (float)exact[2];
}

/* The point of a map in a direction; v above 1 below the horizon of a hemisphere. */
static void point(envsamp_mapping mapping, const float dir[3], double *u, double *v)
{
    const double x = (double)dir[0], y = (double)dir[1], z = (double)dir[2];
    const double side = sqrt(x * x + y * y), length = sqrt(side * side + z * z);
    double r, a, b;

    kd_point(dir, u, v);
    if (mapping == ENVSAMP_HEMISPHERE)
        *v *= 2.0;
    if (mapping != ENVSAMP_OCTAHEDRAL)
        return;
    r = side / sqrt(length * (length + fabs(z)));       /* sqrt(1 - |z|), nothing cancels */
    b = r * atan2(fabs(y), fabs(x)) * 2.0 / KD_PI;
    a = r - b;
    *u = 0.5 + 0.5 * copysign(z < 0.0 ? 1.0 - b : a, x);
    *v = 0.5 + 0.5 * copysign(z < 0.0 ? 1.0 - a : b, y);
}

/* ---- the reference: integrals ---- */

#define NODES 12

static double gauss_node[NODES], gauss_weight[NODES];       /* of [0, 1] */

/* Gauss-Legendre: roots of the Legendre polynomial by Newton's method. */
static void gauss_make(void)
{
    int i, k, round;

    for (i = 0; i < NODES; i++) {
        double x = cos(KD_PI * ((double)i + 0.75) / ((double)NODES + 0.5)), slope = 0.0;

        for (round = 0; round < 50; round++) {
            double p = 1.0, last = 0.0;

            for (k = 0; k < NODES; k++) {
                const double next = ((2.0 * k + 1.0) * x * p - (double)k * last) / (k + 1.0);

                last = p;
                p = next;
            }
            slope = (double)NODES * (x * p - last) / (x * x - 1.0);
            x -= p / slope;
        }
        gauss_node[i] = 0.5 + 0.5 * x;
        gauss_weight[i] = 1.0 / ((1.0 - x * x) * slope * slope);
    }
}

/* Solid angle by area of the map, at v. */
static double area_element(envsamp_mapping mapping, double v)
{
    switch (mapping) {
    case ENVSAMP_LATLONG: return 2.0 * KD_PI * KD_PI * sin(KD_PI * v);
    case ENVSAMP_HEMISPHERE: return KD_PI * KD_PI * sin(0.5 * KD_PI * v);
    default: return 4.0 * KD_PI;
    }
}

/* Solid angle, integrals of L and L^2, largest L. */
typedef struct sums { double sr, light, square, peak; } sums;

/* Adds a rectangle of the map on which radiance is bilinear: given by its corners. Across, a square
   of what is linear is integrated by two nodes exactly. */
static void add_piece(const map *m, double u0, double v0, double u1, double v1, sums *s)
{
    const double across[2] = { 0.5 - sqrt(1.0 / 12.0), 0.5 + sqrt(1.0 / 12.0) };
    const double a = radiance(m, u0, v0, HONEST), b = radiance(m, u1, v0, HONEST);
    const double c = radiance(m, u0, v1, HONEST), d = radiance(m, u1, v1, HONEST);
    int i, k;

    for (i = 0; i < NODES; i++) {
        const double t = gauss_node[i];
        const double sr = gauss_weight[i] * (u1 - u0) * (v1 - v0)
                        * area_element(m->image.mapping, v0 + t * (v1 - v0));
        const double left = a + t * (c - a), right = b + t * (d - b);

        s->sr += sr;
        for (k = 0; k < 2; k++) {
            const double value = left + across[k] * (right - left);

            s->light += 0.5 * sr * value;
            s->square += 0.5 * sr * value * value;
        }
    }
    s->peak = fmax(s->peak, fmax(fmax(a, b), fmax(c, d)));
}

/* A rectangle of the map, quarter texel by quarter texel. */
static sums integrate(const map *m, double u0, double v0, double u1, double v1)
{
    const double wide = 2.0 * (double)m->image.width, high = 2.0 * (double)m->image.height;
    sums s = { 0.0, 0.0, 0.0, 0.0 };
    double x, y;

    for (y = floor(v0 * high); y < v1 * high; y += 1.0)
        for (x = floor(u0 * wide); x < u1 * wide; x += 1.0) {
            const double left = fmax(u0, x / wide), right = fmin(u1, (x + 1.0) / wide);
            const double top = fmax(v0, y / high), end = fmin(v1, (y + 1.0) / high);

            if (left < right && top < end)
                add_piece(m, left, top, right, end, &s);
        }
    return s;
}

/* ---- tables ---- */

typedef enum sampler { WARP, ALIAS, FIT, CDF, SAMPLERS } sampler;

static const char *const sampler_names[] = { "WARP", "ALIAS", "FIT", "cdf" };

typedef struct table {
    sampler kind;
    const map *m;
    kd_fixture f;
    kd_guarded memory, scratch;     /* of a cdf */
    const envsamp_cdf *cdf;
    double integral, excess, max_ratio;
    int intact, bilinear;
} table;

static int table_build_cdf(table *t, int bilinear, float compensation)
{
    envsamp_cdf_desc desc = envsamp_cdf_defaults();
    envsamp_cdf_info info;
    envsamp_sizes sizes;

    memset(&info, 0, sizeof info);
    desc.nearest = !bilinear;
    desc.mis_compensation = compensation;
    envsamp_cdf_sizes(&t->m->image, &desc, &sizes);
    t->memory = kd_guarded_make(sizes.table_bytes, 0x3c);
    t->scratch = kd_guarded_make(sizes.scratch_bytes, 0xc3);
    if (envsamp_cdf_build(&t->m->image, &desc, t->memory.buffer, t->scratch.buffer, &t->cdf))
        return 0;
    t->intact = kd_guarded_intact(&t->memory) && kd_guarded_intact(&t->scratch);
    envsamp_cdf_get_info(t->cdf, &info);
    t->integral = info.integral;
    t->excess = info.excess_variance;
    t->max_ratio = info.max_ratio;
    t->bilinear = !info.nearest;
    return 1;
}

static int table_build(table *t, const map *m, sampler kind, int blocks, int bilinear,
                       float compensation)
{
    const envsamp_kd_select selects[] = { ENVSAMP_KD_WARP, ENVSAMP_KD_ALIAS, ENVSAMP_KD_FIT };
    envsamp_kd_desc desc = envsamp_kd_defaults();

    memset(t, 0, sizeof *t);
    t->kind = kind;
    t->m = m;
    if (kind == CDF)
        return table_build_cdf(t, bilinear, compensation);
    desc.select = selects[kind];
    desc.block_count = blocks;
    desc.nearest = !bilinear;
    desc.mis_compensation = compensation;
    if (!kd_fixture_build(&t->f, &m->image, &desc))
        return 0;
    t->intact = kd_fixture_intact(&t->f);
    t->integral = t->f.info.integral;
    t->excess = t->f.info.excess_variance;
    t->max_ratio = t->f.info.max_ratio;
    t->bilinear = !t->f.info.nearest;
    return 1;
}

/* A bilinear table, or the end of the program: no map here is black. */
static void table_make(table *t, const map *m, sampler kind, int blocks)
{
    if (!table_build(t, m, kind, blocks, 1, 0.0f) || !t->intact || t->bilinear != 1) {
        printf("Bail out! no sound table: %s, %s\n", sampler_names[kind], m->name);
        exit(1);
    }
}

static void table_free(table *t)
{
    if (t->kind == CDF) {
        free(t->memory.block);
        free(t->scratch.block);
    } else {
        kd_fixture_free(&t->f);
    }
    memset(t, 0, sizeof *t);
}

static envsamp_sample table_sample(const table *t, float u0, float u1)
{
    return t->kind == CDF ? envsamp_cdf_sample(t->cdf, u0, u1)
                          : envsamp_kd_sample(t->f.kd, u0, u1);
}

static float table_pdf(const table *t, const float dir[3])
{
    return t->kind == CDF ? envsamp_cdf_pdf(t->cdf, dir) : envsamp_kd_pdf(t->f.kd, dir);
}

static int table_invert(const table *t, const float dir[3], float u[2])
{
    return t->kind == CDF ? envsamp_cdf_invert(t->cdf, dir, u)
                          : envsamp_kd_invert(t->f.kd, dir, u);
}

/* The largest of some errors, and whose it is. */
typedef struct worst { double error; char name[64]; } worst;

static void worst_of(worst *w, double error, const char *name)
{
    if (!(error <= w->error)) {             /* a NaN too */
        w->error = error;
        snprintf(w->name, sizeof w->name, "%s", name);
    }
}

/* ---- 1. figures, exactly ----
 *
 * Guards against border knots that are not the mean across pole, seam or fold; half-wide border
 * cells taken for whole ones; solid angle taken for even within a row (`at`, `spread`); moments of
 * blocks that are not those of where the blocks ended up; maxima of whole cells for parts of them.
 */

/* What a table's figures must be, from its blocks or cells and the map. */
typedef struct figures {
    double second;              /* E[(L/pdf)^2] */
    double low, high;           /* largest L / pdf, and if blocks are a little larger */
    double probability;         /* of all blocks or cells together: integral of pdf */
    double sr;                  /* solid angle of all */
    double density;             /* how far pdf is off probability / solid angle, relative */
    int dark;                   /* blocks that hold light and are not drawn */
} figures;

static void add_block(const table *t, const sums *s, double probability, figures *f)
{
    const double pdf = probability / s->sr;

    f->probability += probability;
    if (probability > 0.0)
        f->second += s->square / pdf;
    else
        f->dark += s->light > 1e-6 * t->integral;
}

/* Where a block lies: told in floats, v within 2e-7, u within 6e-8. */
#define EDGE_U 6e-8
#define EDGE_V 2e-7

/* Beside a sun a block may reach 1e7 times its radiance by such an edge, so that of the largest
   L / pdf the one without the rims is the least that may be told, the one with more the most. */
static void add_peak(const table *t, const envsamp_kd_block *b, figures *f)
{
    const double u0 = (double)b->uv_min[0], u1 = (double)b->uv_max[0];
    const double v0 = (double)b->uv_min[1], v1 = (double)b->uv_max[1];
    const double inverse = (double)b->solid_angle / (double)b->probability;
    const sums less = integrate(t->m, u0 + EDGE_U, v0 + EDGE_V, u1 - EDGE_U, v1 - EDGE_V);
    const sums more = integrate(t->m, fmax(u0 - EDGE_U, 0.0), fmax(v0 - EDGE_V, 0.0),
                                fmin(u1 + EDGE_U, 1.0), fmin(v1 + EDGE_V, 1.0));

    f->low = fmax(f->low, less.peak * inverse);
    f->high = fmax(f->high, more.peak * inverse);
}

/* The density at the centre, where the block is so large that a direction in floats lies in it. */
static void add_density(const table *t, const envsamp_kd_block *b, figures *f)
{
    const double u0 = (double)b->uv_min[0], u1 = (double)b->uv_max[0];
    const double v0 = (double)b->uv_min[1], v1 = (double)b->uv_max[1];
    float centre[3];

    if (u1 - u0 < 2e-6 || v1 - v0 < 2e-6 || !(b->probability > 0.0f))
        return;
    float_direction(t->m->image.mapping, 0.5 * (u0 + u1), 0.5 * (v0 + v1), centre);
    f->density = fmax(f->density, fabs((double)envsamp_kd_pdf(t->f.kd, centre)
                                       * (double)b->solid_angle / (double)b->probability - 1.0));
}

static figures figures_of_kd(const table *t)
{
    figures f = { 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0 };
    int i;

    for (i = 0; i < t->f.info.block_count; i++) {
        envsamp_kd_block b;
        sums s;

        envsamp_kd_get_block(t->f.kd, i, &b);
        s = integrate(t->m, (double)b.uv_min[0], (double)b.uv_min[1], (double)b.uv_max[0],
                      fmin((double)b.uv_max[1], 1.0));
        s.sr = (double)b.solid_angle;
        f.sr += s.sr;
        add_block(t, &s, (double)b.probability, &f);
        if (b.probability > 0.0f)
            add_peak(t, &b, &f);
        add_density(t, &b, &f);
    }
    return f;
}

/* Cells end at texel centres and at the border. */
static double cell_edge(int index, int texels)
{
    return index == 0 ? 0.0 : index > texels ? 1.0 : ((double)index - 0.5) / (double)texels;
}

static figures figures_of_cdf(const table *t)
{
    const int width = t->m->image.width, height = t->m->image.height;
    figures f = { 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0 };
    int x, y;

    for (y = 0; y <= height; y++)
        for (x = 0; x <= width; x++) {
            const double u0 = cell_edge(x, width), u1 = cell_edge(x + 1, width);
            const double v0 = cell_edge(y, height), v1 = cell_edge(y + 1, height);
            const sums s = integrate(t->m, u0, v0, u1, v1);
            float centre[3];
            double pdf;

            float_direction(t->m->image.mapping, 0.5 * (u0 + u1), 0.5 * (v0 + v1), centre);
            pdf = (double)envsamp_cdf_pdf(t->cdf, centre);
            f.sr += s.sr;
            add_block(t, &s, pdf * s.sr, &f);
            f.low = f.high = fmax(f.low, pdf > 0.0 ? s.peak / pdf : 0.0);
        }
    return f;
}


/* The worst of what one sampler's tables tell of maps of one mapping. */
typedef struct verdict {
    worst integral, sun_integral, excess, ratio, one, sphere, density, dark;
    int tables;
} verdict;

/* Errors of one table. `light` is the integral of the map. */
static void judge(const table *t, double light, int sun, verdict *v)
{
    const figures f = t->kind == CDF ? figures_of_cdf(t) : figures_of_kd(t);
    const double sphere = t->m->image.mapping == ENVSAMP_HEMISPHERE ? 2.0 * KD_PI : 4.0 * KD_PI;
    const double told = t->max_ratio * light, second = f.second / light / light;
    const char *name = t->m->name;

    v->tables++;
    worst_of(sun ? &v->sun_integral : &v->integral, fabs(t->integral / light - 1.0), name);
    worst_of(&v->excess, fabs(t->excess + 1.0 - second) / second, name);
    worst_of(&v->ratio, fmax(f.low / told - 1.0, told / f.high - 1.0), name);
    worst_of(&v->one, fabs(f.probability - 1.0), name);
    worst_of(&v->sphere, fabs(f.sr / sphere - 1.0), name);
    worst_of(&v->density, f.density, name);
    worst_of(&v->dark, (double)f.dark, name);
}

#define SIZES 9
#define LONES 9

static const int sizes[SIZES][2] = {
    { 1, 1 }, { 1, 7 }, { 9, 1 }, { 2, 2 }, { 5, 3 }, { 16, 8 }, { 8, 16 }, { 33, 17 }, { 64, 32 }
};

/* Map `index` of a size: the contents, then lone texels in the corners, on the pole rows, in the
   columns of the seam, one of them by the horizon, and in the middle. */
static map map_number(int index, envsamp_mapping mapping, int width, int height)
{
    const int x[LONES] = { 0, width - 1, 0, width - 1, width / 3, width / 3, 0, width - 1,
                           width / 2 };
    const int y[LONES] = { 0, 0, height - 1, height - 1, 0, height - 1, height / 3, height / 2,
                           height / 2 };

    return index < CONTENTS ? map_make((content)index, mapping, width, height)
                            : map_lone(mapping, width, height, x[index - CONTENTS],
                                       y[index - CONTENTS]);
}

static void judge_map(const map *m, sampler kind, int sun, verdict *v)
{
    const int blocks[] = { 1, 30, 6144 };
    const double light = integrate(m, 0.0, 0.0, 1.0, 1.0).light;
    int i;

    for (i = kind == CDF ? 2 : 0; i < 3; i++) {
        table t;

        table_make(&t, m, kind, blocks[i]);
        judge(&t, light, sun, v);
        table_free(&t);
    }
}

/* Knots of the border are floats: half of 1e9 and a bit rounds by 2^-26. cdf: densities are floats.
   kd: the horizon is told EDGE_V off, and light by it may be but half a row of 32 high: 2e-7 of
   1/64. */
static void test_figures_of(envsamp_mapping mapping, sampler kind)
{
    static const verdict none;
    verdict v = none;
    int i, k;

    for (k = 0; k < SIZES; k++)
        for (i = 0; i < CONTENTS + LONES; i++) {
            map m = map_number(i, mapping, sizes[k][0], sizes[k][1]);

            judge_map(&m, kind, i == SUN, &v);
            map_free(&m);
        }
    printf("# %s of %d %s maps\n", sampler_names[kind], v.tables, mapping_names[mapping]);
    CHECK(v.integral.error <= 1e-9, "integral is that of the interpolation, %.1e off (%s)",
          v.integral.error, v.integral.name);
    CHECK(v.sun_integral.error <= 3e-8, "and %.1e with a sun (%s)", v.sun_integral.error,
          v.sun_integral.name);
    CHECK(v.excess.error <= (kind == CDF ? 1e-7 : 1.3e-5), "excess_variance is, second "
          "moment %.1e off (%s)", v.excess.error, v.excess.name);
    CHECK(v.ratio.error <= 1e-6, "max_ratio is, %.1e off (%s)", v.ratio.error, v.ratio.name);
    CHECK(v.one.error <= 1e-6, "pdf integrates to 1, %.1e off (%s)", v.one.error, v.one.name);
    CHECK(v.sphere.error <= 1e-6, "blocks cover the map, %.1e off (%s)", v.sphere.error,
          v.sphere.name);
    CHECK(v.density.error <= 3e-7, "pdf is probability over solid angle, %.1e off (%s)",
          v.density.error, v.density.name);
    CHECK(!(v.dark.error > 0.0), "no light is left out (%s)", v.dark.name);
}

/* With MIS compensation the integral stays that of the map: a sum over texels, by the solid angle
   that each lends its knots. */
static void test_compensated(void)
{
    worst integral = { 0.0, "" }, one = { 0.0, "" };
    int mapping, i, k;

    for (mapping = 0; mapping < 3; mapping++)
        for (k = 0; k < SIZES; k++)
            for (i = RANDOM; i < CONTENTS + LONES; i++) {
                map m = map_number(i, (envsamp_mapping)mapping, sizes[k][0], sizes[k][1]);
                const double light = integrate(&m, 0.0, 0.0, 1.0, 1.0).light;
                const double slack = i == SUN ? 3e-8 : 1e-9;
                table t;

                if (table_build(&t, &m, (i + k) % 2 ? CDF : ALIAS, 300, 1, 0.5f)) {
                    const figures f = t.kind == CDF ? figures_of_cdf(&t) : figures_of_kd(&t);

                    worst_of(&integral, fabs(t.integral / light - 1.0) / slack, m.name);
                    worst_of(&one, fabs(f.probability - 1.0), m.name);
                }
                table_free(&t);
                map_free(&m);
            }
    CHECK(integral.error <= 1.0, "compensated: integral is that of the map, %.1e of what may be "
          "off (%s)", integral.error, integral.name);
    CHECK(one.error <= 1e-6, "compensated: pdf integrates to 1, %.1e off (%s)", one.error,
          one.name);
}

static void test_figures(void)
{
    int mapping, kind;

    for (mapping = 0; mapping < 3; mapping++)
        for (kind = 0; kind < SAMPLERS; kind++)
            test_figures_of((envsamp_mapping)mapping, (sampler)kind);
    test_compensated();
}

/* ---- 2. density where there is light ----
 *
 * Guards against a border that does not go on where lookups do: no mean across the seam, the poles,
 * or the fold; footprints of a texel instead of two; edges of black blocks on the wrong side.
 */

/* Coordinates along one axis: a grid of 1/16 texel, and by each edge of a cell the floats beside
   it. Returns how many there are. */
static int probes(int texels, double *at)
{
    int i, count = 0;

    for (i = 0; i <= 16 * texels; i++) {
        const double place = (double)i / (16.0 * (double)texels);

        at[count++] = place;
        if (i % 8 == 0 && i > 0)
            at[count++] = (double)nextafterf((float)place, 0.0f);
        if (i % 8 == 0 && i < 16 * texels)
            at[count++] = (double)nextafterf((float)place, 1.0f);
    }
    return count;
}

/* What was found at many points. */
typedef struct support {
    long points, lit, dark;     /* dark: lit points without density */
    double darkest;             /* radiance of the brightest of those, in units of what may be */
    double lookup;              /* how far envsamp_lookup is off, likewise */
    char where[128];
} support;

/* Radiance that rounding may bring about, or take away: uv of a direction is within 3e-7. */
static double rounding(const map *m, double peak)
{
    return 3e-7 * (double)(m->image.width + m->image.height) * peak;
}

static void probe(const table *tables, const map *m, double peak, double u, double v, support *out)
{
    const double slack = rounding(m, peak);
    double own_u, own_v, own, most;
    float dir[3], rgb[3];
    int k;

    float_direction(m->image.mapping, u, v, dir);
    if (m->image.mapping != ENVSAMP_OCTAHEDRAL && !(fabsf(dir[0]) + fabsf(dir[1]) > 0.0f))
        return;                             /* u is anything: see test_poles */
    point(m->image.mapping, dir, &own_u, &own_v);
    own = radiance(m, own_u, own_v, HONEST);
    envsamp_lookup(&m->image, 0, dir, rgb);
    most = fmax(own, (double)rgb[0]);
    out->points++;
    out->lit += most > slack;
    out->lookup = fmax(out->lookup, fabs(own - (double)rgb[0]) / slack);
    for (k = 0; k < SAMPLERS && most > 0.0; k++)
        if (!(table_pdf(&tables[k], dir) > 0.0f)) {
            out->dark++;
            if (most / slack > out->darkest) {
                out->darkest = most / slack;
                snprintf(out->where, sizeof out->where, "%s, %s: u %.8f v %.8f", m->name,
                         sampler_names[k], u, v);
            }
        }
}

/* Every `step`th point of a grid over the map. */
static void probe_map(const map *m, double peak, int blocks, int step, support *out)
{
    const int width = m->image.width, height = m->image.height;
    double *u = (double *)kd_allocate((size_t)(20 * width + 8) * sizeof *u);
    double *v = (double *)kd_allocate((size_t)(20 * height + 8) * sizeof *v);
    const int across = probes(width, u), down = probes(height, v);
    table tables[SAMPLERS];
    int i, k;

    for (k = 0; k < SAMPLERS; k++)
        table_make(&tables[k], m, (sampler)k, blocks);
    for (k = 0; k < down; k += step)
        for (i = 0; i < across; i += step)
            probe(tables, m, peak, u[i], v[k], out);
    for (k = 0; k < SAMPLERS; k++)
        table_free(&tables[k]);
    free(u);
    free(v);
}

static void test_support(envsamp_mapping mapping)
{
    static const int small[][2] = { { 1, 1 }, { 1, 5 }, { 6, 1 }, { 2, 2 }, { 4, 4 }, { 5, 3 },
                                    { 8, 5 } };
    static const support none;
    support lone = none, any = none;
    int i, k;

    for (k = 0; k < (int)(sizeof small / sizeof *small); k++)
        for (i = 0; i < small[k][0] * small[k][1]; i++) {
            map m = map_lone(mapping, small[k][0], small[k][1], i % small[k][0],
                             i / small[k][0]);

            probe_map(&m, 3.0, 6144, 1, &lone);
            map_free(&m);
        }
    for (k = 0; k < SIZES - 1; k++)
        for (i = 0; i < CONTENTS + LONES; i++) {
            map m = map_number(i, mapping, sizes[k][0], sizes[k][1]);

            probe_map(&m, i == SUN ? 1e9 : 3.0, i % 2 ? 50 : 6144, 3, &any);
            map_free(&m);
        }
    CHECK(!(lone.darkest > 1.0), "%s: lone texels have density at %ld lit points of %ld, but %ld "
          "of at most %.2f of what rounding makes (%s)", mapping_names[mapping], lone.lit,
          lone.points, lone.dark, lone.darkest, lone.where);
    CHECK(!(any.darkest > 1.0), "%s: so have other maps at %ld of %ld, but %ld of at most %.2f "
          "(%s)", mapping_names[mapping], any.lit, any.points, any.dark, any.darkest, any.where);
    CHECK(fmax(lone.lookup, any.lookup) <= 2.0 && lone.lit > 1000 && any.lit > 1000,
          "%s: lookups are this test's, %.2f and %.2f of what rounding makes",
          mapping_names[mapping], lone.lookup, any.lookup);
}

/* Lit lookups without density in a direction whose x and y are zeros of any sign. */
static int dark_pole(const map *m, sampler kind, float z, int *lit)
{
    const float zeros[] = { 0.0f, -0.0f };
    int i, wrong = 0;
    table t;

    table_make(&t, m, kind, 6144);
    for (i = 0; i < 4; i++) {
        const float dir[3] = { zeros[i & 1], zeros[i >> 1], z };
        float rgb[3];

        envsamp_lookup(&m->image, 0, dir, rgb);
        *lit += rgb[0] > 0.0f;
        wrong += rgb[0] > 0.0f && !(table_pdf(&t, dir) > 0.0f);
    }
    table_free(&t);
    return wrong;
}

/* At the very poles a direction has no azimuth, but signs of zeros, which lookups and densities
   must take alike: over an odd width it makes a difference which azimuth is meant. */
static void test_poles(envsamp_mapping mapping)
{
    int width, x, y, kind, wrong[2] = { 0, 0 }, lit = 0;

    for (width = 1; width <= 8; width++)
        for (x = 0; x < width; x++)
            for (y = 0; y < 4; y++)
                for (kind = 0; kind < SAMPLERS; kind++) {
                    map m = map_lone(mapping, width, 4, x, y);

                    wrong[width & 1] += dark_pole(&m, (sampler)kind, 1.0f, &lit);
                    wrong[width & 1] += dark_pole(&m, (sampler)kind, -1.0f, &lit);
                    map_free(&m);
                }
    CHECK(lit > 100 && wrong[0] == 0, "%s: exactly at the poles lit lookups have density, even "
          "widths: %d of %d not", mapping_names[mapping], wrong[0], lit);
    CHECK(wrong[1] == 0, "%s: and odd widths: %d not", mapping_names[mapping], wrong[1]);
}

/* The last row of a hemisphere reaches down to the horizon, and no further, for both. */
static void test_horizon(void)
{
    const float above[] = { 0.0f, -0.0f, 1e-30f, 1e-8f, 0.03f };
    int x, kind, i, k, dark = 0, lit = 0, below = 0;

    for (x = 0; x < 5; x++)
        for (kind = 0; kind < SAMPLERS; kind++) {
            map m = map_lone(ENVSAMP_HEMISPHERE, 5, 4, x, 3);
            table t;

            table_make(&t, &m, (sampler)kind, 6144);
            for (i = 0; i < 64; i++)
                for (k = 0; k < 5; k++) {
                    const double turn = 2.0 * KD_PI * ((double)i + 0.5) / 64.0;
                    float dir[3], rgb[3];

                    dir[0] = (float)cos(turn);
                    dir[1] = (float)sin(turn);
                    dir[2] = above[k];
                    envsamp_lookup(&m.image, 0, dir, rgb);
                    lit += rgb[0] > 0.0f;
                    dark += rgb[0] > 0.0f && !(table_pdf(&t, dir) > 0.0f);
                    dir[2] = -0.001f;
                    envsamp_lookup(&m.image, 0, dir, rgb);
                    below += rgb[0] > 0.0f || table_pdf(&t, dir) > 0.0f;
                }
            table_free(&t);
            map_free(&m);
        }
    CHECK(lit > 1000 && !dark && !below, "at the horizon %d of %d lit lookups have no density; "
          "below it %d have light or density", dark, lit, below);
}

/* Whether all about a point is black. */
static int black_about(const map *m, double u, double v)
{
    const double off = 5e-7;
    int i, lit = 0;

    for (i = 0; i < 4; i++)
        lit |= radiance(m, fmin(fmax(u + (i & 1 ? off : -off), 0.0), 1.0),
                        fmin(fmax(v + (i & 2 ? off : -off), 0.0), 1.0), HONEST) > 0.0;
    return !lit;
}

/* Where samples fall. */
typedef struct fallen {
    long points;
    long without;               /* pdf of the sample not a positive number */
    long other, none;           /* pdf of its direction another, or 0 */
    long black;                 /* cdf: in a cell that is black */
} fallen;

static void fall(const table *t, int count, fallen *out)
{
    pcg32 random = pcg32_make(17, (uint64_t)t->kind);
    int i;

    for (i = 0; i < count; i++) {
        const float u0 = pcg32_float(&random);
        const envsamp_sample s = table_sample(t, u0, pcg32_float(&random));
        const float pdf = table_pdf(t, s.dir);
        double u, v;

        out->points++;
        out->without += !(s.pdf > 0.0f && s.pdf <= FLT_MAX);
        out->other += !kd_bits_equal(&pdf, &s.pdf, sizeof pdf);
        out->none += !(pdf > 0.0f);
        if (t->kind == CDF) {
            point(t->m->image.mapping, s.dir, &u, &v);
            out->black += black_about(t->m, u, v);
        }
    }
}

/* The pdf of a direction is that of the sample that it is of, but where the direction, rounded to
   floats, lies across an edge: at maps of 64 by 32, of blocks down to 1/16 texel, fewer than 1 in
   20000; of cells 1 in 50000. Guards against edges of the two that are not the same. */
static void test_samples(envsamp_mapping mapping)
{
    static const fallen nothing;
    fallen of_kd = nothing, of_cdf = nothing;
    int i, k, kind;

    for (k = 0; k < SIZES; k++)
        for (i = 0; i < CONTENTS + LONES; i++)
            for (kind = 0; kind < SAMPLERS; kind++) {
                map m = map_number(i, mapping, sizes[k][0], sizes[k][1]);
                table t;

                table_make(&t, &m, (sampler)kind, 6144);
                fall(&t, 2000, kind == CDF ? &of_cdf : &of_kd);
                table_free(&t);
                map_free(&m);
            }
    CHECK(!of_kd.without && !of_cdf.without, "%s: all samples have density",
          mapping_names[mapping]);
    CHECK(of_kd.other * 20000 < of_kd.points, "%s: %ld of %ld samples of blocks have the density of"
          " another, %ld none", mapping_names[mapping], of_kd.other, of_kd.points, of_kd.none);
    CHECK(of_cdf.other * 50000 < of_cdf.points, "%s: %ld of %ld of cells have, %ld none",
          mapping_names[mapping], of_cdf.other, of_cdf.points, of_cdf.none);
    CHECK(!of_cdf.black, "%s: none of those lies in a black cell", mapping_names[mapping]);
}

/* ---- 3. Monte Carlo ----
 *
 * Guards against whatever makes tables and lookups disagree, as the controls do; and against a
 * variance that is not what is told.
 */

#define DRAWS (1 << 17)
#define WEIGHTS 4               /* 1, x, y, z of the direction: else what a lookup only moves, as at
                                   the seam, goes unnoticed */
#define CONTENT_CASES 7
#define CASES (3 * SAMPLERS * CONTENT_CASES)

/* Integrals of L times the weights, over that of L. Two nodes an axis in 1/8 of a quarter texel. */
static void known_integrals(const map *m, double known[WEIGHTS])
{
    const int wide = 16 * m->image.width, high = 16 * m->image.height;
    double dir[3];
    int x, y, k;

    for (k = 0; k < WEIGHTS; k++)
        known[k] = 0.0;
    for (y = 0; y < 2 * high; y++) {
        const double shift = y % 2 ? 0.5 + sqrt(1.0 / 12.0) : 0.5 - sqrt(1.0 / 12.0);
        const double v = ((double)(y / 2) + shift) / (double)high;
        const double sr = area_element(m->image.mapping, v);

        for (x = 0; x < 2 * wide; x++) {
            const double along = x % 2 ? 0.5 + sqrt(1.0 / 12.0) : 0.5 - sqrt(1.0 / 12.0);
            const double u = ((double)(x / 2) + along) / (double)wide;
            const double light = sr * radiance(m, u, v, HONEST);

            direction(m->image.mapping, u, v, dir);
            known[0] += light;
            for (k = 1; k < WEIGHTS; k++)
                known[k] += light * dir[k - 1];
        }
    }
    for (k = 1; k < WEIGHTS; k++)
        known[k] /= known[0];
    known[0] = 1.0;
}

typedef struct estimate { stat_moments weighted[WEIGHTS], square; } estimate;

/* Means of L / pdf over the integral, by the library's lookup or, where `wrong` is set, by that of
   this test with a fault, or HONEST. */
static estimate draw(const table *t, const fault *wrong)
{
    static const estimate none;
    pcg32 random = pcg32_make(29, 3);
    estimate e = none;
    int i, k;

    for (i = 0; i < DRAWS; i++) {
        const float u0 = pcg32_float(&random);
        const envsamp_sample s = table_sample(t, u0, pcg32_float(&random));
        double value, u, v;

        if (wrong) {
            point(t->m->image.mapping, s.dir, &u, &v);
            value = radiance(t->m, u, v, *wrong);
        } else {
            float rgb[3];

            envsamp_lookup(&t->m->image, 0, s.dir, rgb);
            value = (double)rgb[0];
        }
        value /= (double)s.pdf * t->integral;
        stat_moments_add(&e.square, value * value);
        for (k = 0; k < WEIGHTS; k++)
            stat_moments_add(&e.weighted[k], k ? value * (double)s.dir[k - 1] : value);
    }
    return e;
}

/* The least p of the means; in floats they are 1e-6 off. */
static double least_p(const estimate *e, const double known[WEIGHTS])
{
    double least = 1.0;
    int k;

    for (k = 0; k < WEIGHTS; k++)
        least = fmin(least, stat_mean_test(&e->weighted[k], known[k], 2e-6));
    return least;
}

static double monte_carlo_alpha(void)
{
    return stat_sidak(STAT_ALPHA, CASES * (WEIGHTS + 1));
}

static map monte_carlo_map(int index, envsamp_mapping mapping)
{
    switch (index) {
    case 0: return map_make(RANDOM, mapping, 33, 17);
    case 1: return map_make(HOLES, mapping, 16, 8);
    case 2: return map_make(SUN, mapping, 32, 16);
    case 3: return map_make(SMOOTH, mapping, 5, 3);
    case 4: return map_lone(mapping, 16, 8, 0, 3);
    case 5: return map_lone(mapping, 9, 5, 3, 0);
    default: return map_lone(mapping, 2, 2, 1, 1);
    }
}

static void test_monte_carlo(envsamp_mapping mapping)
{
    const double alpha = monte_carlo_alpha();
    double known[WEIGHTS];
    int i, kind;

    for (i = 0; i < CONTENT_CASES; i++) {
        map m = monte_carlo_map(i, mapping);

        known_integrals(&m, known);
        for (kind = 0; kind < SAMPLERS; kind++) {
            double p, p_square;
            estimate e;
            table t;

            table_make(&t, &m, (sampler)kind, i % 2 ? 6144 : 300);
            e = draw(&t, NULL);
            p = least_p(&e, known);
            p_square = stat_mean_test(&e.square, 1.0 + t.excess, 1e-6 * (1.0 + t.excess));
            CHECK(p >= alpha && p_square >= alpha, "%s, %s: mean %.6f, p = %.2g; variance %.5f is "
                  "as told, %.5f, p = %.2g", m.name, sampler_names[kind], e.weighted[0].mean, p,
                  e.square.mean - 1.0, t.excess, p_square);
            table_free(&t);
        }
        map_free(&m);
    }
}

/* ---- what the means must reject ---- */

/* Under FIT a sun's variance is too large to tell. */
static void control_table(map m, int sun)
{
    double known[WEIGHTS];
    int kind;

    known_integrals(&m, known);
    for (kind = 0; kind < SAMPLERS; kind++) {
        estimate e;
        table t;

        if (sun && kind == FIT)
            continue;
        if (table_build(&t, &m, (sampler)kind, 6144, 0, 0.0f)) {
            e = draw(&t, NULL);
            CHECK(t.bilinear == 0 && least_p(&e, known) < monte_carlo_alpha(), "rejected: a table "
                  "for nearest texels, %s, %s: mean %.4f", m.name, sampler_names[kind],
                  e.weighted[0].mean);
        } else {
            CHECK(0, "a table for nearest texels builds");
        }
        table_free(&t);
    }
    map_free(&m);
}

/* A lookup with a fault, beside the same without. */
static void control_lookup(map m, fault wrong)
{
    const fault honest = HONEST;
    double known[WEIGHTS];
    int kind;

    known_integrals(&m, known);
    for (kind = 0; kind < SAMPLERS; kind++) {
        estimate good, bad;
        table t;

        table_make(&t, &m, (sampler)kind, 6144);
        good = draw(&t, &honest);
        bad = draw(&t, &wrong);
        CHECK(least_p(&good, known) >= monte_carlo_alpha()
              && least_p(&bad, known) < monte_carlo_alpha(), "rejected: a lookup %s, %s, %s: %.4f,"
              " %+.4f, %+.4f, %+.4f off", fault_names[wrong], m.name, sampler_names[kind],
              bad.weighted[0].mean - 1.0, bad.weighted[1].mean - known[1],
              bad.weighted[2].mean - known[2], bad.weighted[3].mean - known[3]);
        table_free(&t);
    }
    map_free(&m);
}

static void test_controls(void)
{
    control_table(map_lone(ENVSAMP_LATLONG, 16, 8, 5, 3), 0);
    control_table(map_make(SUN, ENVSAMP_HEMISPHERE, 32, 16), 1);
    control_table(map_lone(ENVSAMP_OCTAHEDRAL, 16, 16, 0, 3), 0);
    control_lookup(map_lone(ENVSAMP_LATLONG, 16, 8, 5, 3), HALF_TEXEL);
    control_lookup(map_lone(ENVSAMP_OCTAHEDRAL, 16, 16, 7, 7), HALF_TEXEL);
    control_lookup(map_lone(ENVSAMP_LATLONG, 16, 8, 0, 3), CLAMPED_SEAM);
    control_lookup(map_lone(ENVSAMP_HEMISPHERE, 16, 8, 15, 6), CLAMPED_SEAM);
    control_lookup(map_lone(ENVSAMP_LATLONG, 16, 8, 5, 0), ROWS_WRAPPED);
    control_lookup(map_lone(ENVSAMP_HEMISPHERE, 16, 8, 5, 7), ROWS_WRAPPED);
    control_lookup(map_lone(ENVSAMP_LATLONG, 16, 8, 5, 0), POLE_STRAIGHT);
    control_lookup(map_lone(ENVSAMP_HEMISPHERE, 9, 5, 3, 0), POLE_STRAIGHT);
    control_lookup(map_lone(ENVSAMP_OCTAHEDRAL, 16, 16, 0, 3), EDGE_MIRRORED);
    control_lookup(map_lone(ENVSAMP_OCTAHEDRAL, 16, 8, 12, 7), EDGE_MIRRORED);
}

/* ---- 4. there and back ----
 *
 * Guards against cells of which invert has another width or place than sampling, as the half-wide
 * ones at the border.
 */

/* What the numbers of a sample may be off, in units of 2^-24, both axes: as the header has it, 4
   times how much the block is stretched, or the cell, and there a unit more, since a cdf returns
   whole ones. Returns 0 for a direction that rounds across an edge. */
static int allowed(const table *t, float u0, float u1, const float dir[3], const float back[2],
                   double most[2])
{
    int axis;

    if (t->kind == CDF) {
        const inside_texel from = inside_draw(t->cdf, u0, u1);
        const inside_texel to = inside_find(t->cdf, dir);
        const uint32_t *across = inside_edges(t->cdf, from.row) + from.column;
        const uint32_t *down = inside_row_edges(t->cdf) + from.row;
        const int width = t->m->image.width, height = t->m->image.height;
        const double v0 = cell_edge((int)from.row, height);
        const double v1 = cell_edge((int)from.row + 1, height);
        const double turns = t->m->image.mapping == ENVSAMP_LATLONG ? KD_PI : 0.5 * KD_PI;
        const double cap = t->m->image.mapping == ENVSAMP_OCTAHEDRAL ? v1 - v0
                         : sin(0.5 * turns * (v0 + v1)) * sin(0.5 * turns * (v1 - v0));

        most[0] = 1.0 + 4.0 * (double)(across[1] - across[0]) / UNIT
                / (cell_edge((int)from.column + 1, width) - cell_edge((int)from.column, width));
        most[1] = 1.0 + 4.0 * (double)(down[1] - down[0]) / UNIT / cap;
        return from.column == to.column && from.row == to.row;
    } else {
        const kd_warp_block from = kd_warp_at(t->f.kd, (double)u0, (double)u1);
        const kd_warp_block to = kd_warp_at(t->f.kd, (double)back[0], (double)back[1]);

        for (axis = 0; axis < 2; axis++) {
            const double size = !axis ? (double)from.edge[1] - (double)from.edge[0]
                              : t->m->image.mapping == ENVSAMP_OCTAHEDRAL
                              ? (double)from.edge[3] - (double)from.edge[2]
                              : 0.5 * kd_cap_between(from.edge[2], from.edge[3]);

            most[axis] = 4.0 * fmax(1.0, (from.high[axis] - from.low[axis]) / UNIT / size);
        }
        return kd_bits_equal(from.edge, to.edge, sizeof from.edge);
    }
}

typedef struct back { long points, across, refused; worst error; double control; } back;

static void invert_map(const map *m, sampler kind, int count, back *out)
{
    pcg32 random = pcg32_make(41, (uint64_t)kind);
    table t;
    int i, axis;

    table_make(&t, m, kind, 6144);
    for (i = 0; i < count; i++) {
        float u[2], again[2];
        envsamp_sample s;
        double most[2];

        u[0] = pcg32_float(&random);
        u[1] = pcg32_float(&random);
        s = table_sample(&t, u[0], u[1]);
        out->points++;
        if (!table_invert(&t, s.dir, again)) {
            out->refused++;
            continue;
        }
        if (!allowed(&t, u[0], u[1], s.dir, again, most)) {
            out->across++;
            continue;
        }
        for (axis = 0; axis < 2; axis++) {
            const double unit = most[axis] / UNIT;

            worst_of(&out->error, fabs((double)again[axis] - (double)u[axis]) / unit, m->name);
            out->control = fmax(out->control, fabs((double)again[axis] - (double)u[1 - axis])
                                              / unit);
        }
    }
    table_free(&t);
}

static void test_inverse(envsamp_mapping mapping)
{
    const sampler kinds[] = { WARP, CDF };
    int i, k, n;

    for (n = 0; n < 2; n++) {
        back out = { 0, 0, 0, { 0.0, "" }, 0.0 };

        for (k = 0; k < SIZES; k++)
            for (i = 0; i < CONTENTS + LONES; i++) {
                map m = map_number(i, mapping, sizes[k][0], sizes[k][1]);

                invert_map(&m, kinds[n], 3000, &out);
                map_free(&m);
            }
        CHECK(!out.refused && out.error.error <= 1.0, "%s, %s: numbers come back, %.2f of what is "
              "promised off (%s), %ld do not", mapping_names[mapping], sampler_names[kinds[n]],
              out.error.error, out.error.name, out.refused);
        CHECK(out.across * 10000 < out.points && out.control > 10.0, "%ld of %ld lie across an "
              "edge; control: u1 for u0 is %.0f off", out.across, out.points, out.control);
    }
}

/* ---- 5. quality ----
 *
 * Guards against searches that go by solid angle, or by light, that is not there: near the poles a
 * lamp of one texel would then stay in few blocks, or have tiles of unlike light.
 */

static void test_lamps(envsamp_mapping mapping)
{
    const int places[][2] = { { 170, 64 }, { 170, 0 }, { 170, 1 }, { 0, 30 }, { 170, 255 },
                              { 300, 128 } };
    const sampler kinds[] = { WARP, ALIAS };
    int i, k;

    for (k = 0; k < 2; k++) {
        worst excess = { 0.0, "" };

        for (i = 0; i < (int)(sizeof places / sizeof *places); i++) {
            map m = map_lone(mapping, 512, 256, places[i][0], places[i][1]);
            table t;

            table_make(&t, &m, kinds[k], 6144);
            worst_of(&excess, t.excess, m.name);
            table_free(&t);
            map_free(&m);
        }
        CHECK(excess.error <= 0.05, "%s, %s: a lamp of a texel is finely divided wherever it is, "
              "variance %.3f at most (%s)", mapping_names[mapping], sampler_names[kinds[k]],
              excess.error, excess.name);
    }
}

/* ---- 6. the rest ---- */

static void test_defaults(void)
{
    map m = map_make(RANDOM, ENVSAMP_LATLONG, 16, 8);
    envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_sizes plain, bilinear, nearest;
    kd_fixture f;

    CHECK(!envsamp_kd_defaults().nearest && !envsamp_cdf_defaults().nearest,
          "bilinear lookups are the default");
    envsamp_kd_sizes(&m.image, NULL, &plain);
    envsamp_kd_sizes(&m.image, &desc, &bilinear);
    desc.nearest = 1;
    envsamp_kd_sizes(&m.image, &desc, &nearest);
    CHECK(plain.scratch_bytes == bilinear.scratch_bytes
          && nearest.scratch_bytes < bilinear.scratch_bytes, "also with no description");
    desc.nearest = 7;
    CHECK(kd_fixture_build(&f, &m.image, &desc) && IS(f.info.nearest, 1),
          "any number but 0 means yes");
    kd_fixture_free(&f);
    map_free(&m);
}

/* Batches are scalar calls, and a table that is copied is still good. */
static void test_batches(envsamp_mapping mapping)
{
    enum { COUNT = 301 };
    float u[2][COUNT], x[3][COUNT], pdf[COUNT], other[COUNT];
    pcg32 random = pcg32_make(8, 0);
    int kind, i, wrong = 0;

    for (i = 0; i < COUNT; i++) {
        u[0][i] = pcg32_float(&random);
        u[1][i] = pcg32_float(&random);
    }
    for (kind = 0; kind < SAMPLERS; kind++) {
        map m = map_make(HOLES, mapping, 33, 17);
        const envsamp_cdf *cdf;
        const envsamp_kd *kd;
        table t;

        table_make(&t, &m, (sampler)kind, 6144);
        if (kind == CDF) {
            wrong += envsamp_cdf_open(t.cdf, envsamp_cdf_bytes(t.cdf), &cdf) != ENVSAMP_OK;
            envsamp_cdf_sample_n(t.cdf, COUNT, u[0], u[1], x[0], x[1], x[2], pdf);
            envsamp_cdf_pdf_n(t.cdf, COUNT, x[0], x[1], x[2], other);
        } else {
            wrong += envsamp_kd_open(t.f.kd, envsamp_kd_bytes(t.f.kd), &kd) != ENVSAMP_OK;
            envsamp_kd_sample_n(t.f.kd, COUNT, u[0], u[1], x[0], x[1], x[2], pdf);
            envsamp_kd_pdf_n(t.f.kd, COUNT, x[0], x[1], x[2], other);
        }
        for (i = 0; i < COUNT; i++) {
            const envsamp_sample s = table_sample(&t, u[0][i], u[1][i]);
            const float there = table_pdf(&t, s.dir), dir[3] = { x[0][i], x[1][i], x[2][i] };

            wrong += !kd_bits_equal(s.dir, dir, sizeof dir)
                  || !kd_bits_equal(&s.pdf, &pdf[i], sizeof(float))
                  || !kd_bits_equal(&there, &other[i], sizeof(float));
        }
        table_free(&t);
        map_free(&m);
    }
    CHECK(wrong == 0, "%s: tables open, batches are scalar calls bit for bit",
          mapping_names[mapping]);
}

int main(void)
{
    int mapping;

    gauss_make();
    test_figures();
    for (mapping = 0; mapping < 3; mapping++) {
        test_support((envsamp_mapping)mapping);
        test_samples((envsamp_mapping)mapping);
        test_poles((envsamp_mapping)mapping);
    }
    test_horizon();
    for (mapping = 0; mapping < 3; mapping++)
        test_monte_carlo((envsamp_mapping)mapping);
    test_controls();
    for (mapping = 0; mapping < 3; mapping++) {
        test_inverse((envsamp_mapping)mapping);
        test_lamps((envsamp_mapping)mapping);
        test_batches((envsamp_mapping)mapping);
    }
    test_defaults();
    return check_done();
}
