/* test_kd_warp.c: what only WARP promises: strata of the unit square stay together on the sphere,
 * directions invert to the numbers that draw them, the way down to a block is short, and batches
 * are scalar calls bit for bit (those of ALIAS and FIT too).
 *
 *     test_kd_warp [quick]       quick: without the long ones, for slow tools
 */
#include "check.h"

#include "../envsamp.h"

#include "kd_reference.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"

#include <float.h>

#define UNIT 16777216.0         /* 2^24: how many values a float u has */
#define EDGE 5e-7               /* of u and v: how near an edge a float direction is ambiguous */

/* ---- a table and its blocks ---- */

typedef struct subject {
    reference r;
    kd_warp_block *blocks;      /* in the order of the table */
    int count;
    image map;
} subject;

/* Builds from s->map. Free it in either case. */
static int subject_build(subject *s, int blocks)
{
    const envsamp_kd_desc desc = kd_desc(blocks, ENVSAMP_KD_WARP);
    const int built = reference_build(&s->r, &s->map, &desc);

    s->blocks = NULL;
    s->count = 0;
    CHECK(built && kd_fixture_intact(&s->r.f), "%dx%d, %d blocks of %d asked for", s->map.width,
          s->map.height, s->r.f.info.block_count, blocks);
    if (built) {
        s->count = s->r.f.info.block_count;
        s->blocks = (kd_warp_block *)kd_allocate((size_t)s->count * sizeof *s->blocks);
        if (kd_warp_blocks(s->r.f.kd, s->blocks, s->count) != s->count)
            CHECK(0, "as many blocks as the table says");
    }
    return built;
}

static int subject_make(subject *s, const char *name, int width, int height, int blocks)
{
    map_make(name, width, height, &s->map);
    return subject_build(s, blocks);
}

static void subject_free(subject *s)
{
    free(s->blocks);
    reference_free(&s->r);
    image_free(&s->map);
}

static void worst(double *so_far, double value)
{
    if (!(value <= *so_far))
        *so_far = value;
}

/* A number of 24 bits that lies from `low` to `high`, units of 2^-24. */
static float inside(pcg32 *random, double low, double high)
{
    const double at = low + floor((high - low) * (double)pcg32_float(random));

    return (float)((at < high ? at : high - 1.0) / UNIT);
}

static int is_whole(double x)
{
    return x == floor(x);
}

static int same_block(const kd_warp_block *a, const kd_warp_block *b)
{
    return kd_bits_equal(a->low, b->low, sizeof a->low)
        && kd_bits_equal(a->high, b->high, sizeof a->high);
}

static int lit(const kd_warp_block *b)
{
    return b->high[0] > b->low[0] && b->high[1] > b->low[1];
}

/* ---- strata ---- */

/* Samples of each tile, its corners among them, lie in its rectangle of the map: how many do not,
   by sample.uv and by the direction. */
static long strays_of_tile(const subject *s, int tile, pcg32 *random)
{
    const kd_warp_block b = kd_tile(s->r.f.kd, tile);
    const kd_rect rect = kd_warp_rect(&s->r.f, &b);
    long strays = 0;
    int i;

    for (i = 0; i < 40; i++) {
        const float u0 = i & 1 ? inside(random, b.low[0], b.high[0])
                               : (float)((i & 2 ? b.high[0] - 1.0 : b.low[0]) / UNIT);
        const float u1 = i & 4 ? inside(random, b.low[1], b.high[1])
                               : (float)((i & 8 ? b.high[1] - 1.0 : b.low[1]) / UNIT);
        const envsamp_sample p = envsamp_kd_sample(s->r.f.kd, u0, u1);
        const double sine = sqrt((double)p.dir[0] * (double)p.dir[0]
                                 + (double)p.dir[1] * (double)p.dir[1]);
        double u, v;

        kd_point(p.dir, &u, &v);
        u += (double)p.uv[0] - u > 0.5 ? 1.0 : u - (double)p.uv[0] > 0.5 ? -1.0 : 0.0;
        strays += kd_outside(&rect, (double)p.uv[0], (double)p.uv[1]) > EDGE
               || (sine > 0.0 && kd_outside(&rect, u, v) > EDGE);
    }
    return strays;
}

static void test_strata(const char *name, int width, int height, int blocks)
{
    pcg32 random = pcg32_make(1, 0);
    long strays = 0;
    subject s;
    int i;

    if (subject_make(&s, name, width, height, blocks)) {
        for (i = 0; i < kd_tile_count(s.r.f.kd); i++)
            strays += strays_of_tile(&s, i, &random);
        CHECK(!strays, "%s: samples of %d strata lie in their rectangles, but %ld", name,
              kd_tile_count(s.r.f.kd), strays);
    }
    subject_free(&s);
}

/* Crown cuts halve the light, within a few percent: tiles hold equal shares of it. */
static void test_halves(const char *name, int width, int height, int blocks)
{
    double *share, most = 0.0;
    subject s;
    int i, tiles;

    if (!subject_make(&s, name, width, height, blocks))
        return;
    tiles = kd_tile_count(s.r.f.kd);
    share = (double *)kd_allocate((size_t)tiles * sizeof *share);
    for (i = 0; i < s.count; i++)
        share[s.blocks[i].tile] += s.r.mass[i] / s.r.integral * (double)tiles;
    for (i = 0; i < tiles; i++)
        worst(&most, fabs(share[i] - 1.0));
    CHECK(most < 3e-2, "%s: %d tiles hold the same light, to %.1e", name, tiles, most);
    free(share);
    subject_free(&s);
}

/* ---- the map from the unit square to a block ---- */

/* The figures of test_inside, over samples in blocks. */
typedef struct motion { double across, down, z, off; long falls, other; } motion;

/* Where a point of the unit square should lie, from the edges of its block alone. */
static void expect_point(const kd_warp_block *b, float u0, float u1, double *u, double *v)
{
    const double f0 = ((double)u0 * UNIT - b->low[0]) / (b->high[0] - b->low[0]);
    const double f1 = ((double)u1 * UNIT - b->low[1]) / (b->high[1] - b->low[1]);
    const double near = fabs((double)b->edge[2]);
    const double between = f1 * kd_cap_between(b->edge[2], b->edge[3]);
    const double north = signbit(b->edge[2]) ? 2.0 - near + between : near + between;
    const double south = signbit(b->edge[2]) ? near - between : 2.0 - near - between;

    *u = (double)b->edge[0] + f0 * ((double)b->edge[1] - (double)b->edge[0]);
    *v = north < south ? 2.0 / KD_PI * asin(sqrt(0.5 * fmax(north, 0.0)))
                       : 1.0 - 2.0 / KD_PI * asin(sqrt(0.5 * fmax(south, 0.0)));
}

/* How far off a polar angle is whose 1 - cos theta, or 1 + cos theta, was rounded: little in blocks
   at the near pole, more where a block that reaches far ends at the other one. */
static double polar_slack(const kd_warp_block *b, double sine)
{
    const double y0 = fabs((double)b->edge[2]), y1 = fabs((double)b->edge[3]);
    const int across = (signbit(b->edge[2]) != 0) != (signbit(b->edge[3]) != 0);
    const double error = 2e-7 * (across ? 2.0 : fmax(y0, y1));

    return fmin(error / fmax(sine, 1e-30), sqrt(2.0 * error));
}

/* One sample, and its neighbours 2^-24 further on if they are of the block too. */
static void move_inside(const subject *s, const kd_warp_block *b, float u0, float u1, motion *m)
{
    const envsamp_kd *kd = s->r.f.kd;
    const envsamp_sample p = envsamp_kd_sample(kd, u0, u1);
    const float pdf = kd_density(b), step = (float)(1.0 / UNIT);
    float dir[3];
    double u, v;
    int c;

    expect_point(b, u0, u1, &u, &v);
    worst(&m->across, fabs((double)p.uv[0] - u));
    worst(&m->down, fabs((double)p.uv[1] - v) / (3e-7 + polar_slack(b, sin(KD_PI * v))));
    worst(&m->z, fabs((double)p.dir[2] - cos(KD_PI * v)));
    kd_direction(u, v, dir);
    for (c = 0; c < 2; c++)
        worst(&m->off, fabs((double)p.dir[c] - (double)dir[c])
                       / (1e-6 + polar_slack(b, sin(KD_PI * v))));
    m->other += !kd_bits_equal(&p.pdf, &pdf, sizeof pdf);
    if ((double)u0 * UNIT + 1.0 < b->high[0])
        m->falls += envsamp_kd_sample(kd, u0 + step, u1).uv[0] < p.uv[0];
    if ((double)u1 * UNIT + 1.0 < b->high[1])
        m->falls += envsamp_kd_sample(kd, u0, u1 + step).dir[2] > p.dir[2];
}

/* The map is linear in azimuth and in cos theta within each block, from edge to edge. Being so, it
   is continuous, and rises by less for less. Corners tell that the block is all of its
   rectangle. */
static void test_inside(const char *name, int width, int height, int blocks)
{
    pcg32 random = pcg32_make(2, 0);
    motion m = { 0.0, 0.0, 0.0, 0.0, 0, 0 };
    subject s;
    int i, k;

    if (!subject_make(&s, name, width, height, blocks))
        return;
    for (i = 0; i < s.count; i++) {
        const kd_warp_block *b = &s.blocks[i];

        for (k = 0; k < 12 && lit(b); k++) {
            const float u0 = k < 4 ? (float)((k & 1 ? b->high[0] - 1.0 : b->low[0]) / UNIT)
                                   : inside(&random, b->low[0], b->high[0]);
            const float u1 = k < 4 ? (float)((k & 2 ? b->high[1] - 1.0 : b->low[1]) / UNIT)
                                   : inside(&random, b->low[1], b->high[1]);

            move_inside(&s, b, u0, u1, &m);
        }
    }
    CHECK(!m.other, "%s: blocks are drawn from all over their rectangles, but %ld", name, m.other);
    CHECK(m.across <= 2e-7, "%s: azimuth is linear in u0, to %.1e turns", name, m.across);
    CHECK(m.z <= 2e-7, "%s: cos theta is linear in u1, to %.1e", name, m.z);
    CHECK(m.down <= 1.0, "%s: v is there, %.2f of what may be", name, m.down);
    CHECK(m.off <= 1.0, "%s: directions are there, %.2f of what may be", name, m.off);
    CHECK(!m.falls, "%s: both rise inside blocks, but for %ld steps", name, m.falls);
    subject_free(&s);
}

/* ---- probabilities ---- */

static void test_areas(const char *name, int width, int height, int blocks)
{
    double area = 0.0, pdf = 0.0;
    int i, fractions = 0, unlit = 0;
    subject s;

    if (!subject_make(&s, name, width, height, blocks))
        return;
    for (i = 0; i < s.count; i++) {
        const kd_warp_block *b = &s.blocks[i];
        const kd_rect *rect = &s.r.rects[i];

        fractions += !is_whole(b->low[0]) || !is_whole(b->low[1]) || !is_whole(b->high[0])
                  || !is_whole(b->high[1]);
        area += (b->high[0] - b->low[0]) * (b->high[1] - b->low[1]);
        unlit += s.r.peak[i] > 0.0 ? !lit(b) : lit(b);
        worst(&pdf, fabs((double)kd_density(b) - rect->probability / rect->solid_angle)
                    / (1e-30 + (double)kd_density(b)));
    }
    CHECK(!fractions, "%s: edges in the unit square are multiples of 2^-24, but %d", name,
          fractions);
    CHECK(area == UNIT * UNIT, "%s: blocks fill the unit square: %.17g", name, area / UNIT / UNIT);
    CHECK(!unlit, "%s: lit blocks and no others have a part of it, but %d", name, unlit);
    CHECK(pdf <= 1.2e-7, "%s: densities are area / solid angle, to %.1e", name, pdf);
    subject_free(&s);
}

/* Odd multiples of 2^-(bits + 1) from low to high, which are in units of 2^-24. */
static double lattice_points(double low, double high, int bits)
{
    const double step = ldexp(1.0, 24 - bits);

    return ceil(high / step - 0.5) - ceil(low / step - 0.5);
}

/* How often each block is drawn by a whole lattice of u0 and u1, by where the samples lie, against
   what its rectangle says and against its probability. */
static void test_lattice(const char *name, int blocks, int bits)
{
    const int side = 1 << bits;
    const double all = (double)side * (double)side;
    double *drawn, distance = 0.0, claimed = 0.0;
    subject s;
    int i, j;

    if (!subject_make(&s, name, 128, 64, blocks))
        return;
    drawn = (double *)kd_allocate((size_t)s.count * sizeof *drawn);
    for (j = 0; j < side; j++)
        for (i = 0; i < side; i++) {
            const envsamp_sample p = envsamp_kd_sample(
                s.r.f.kd, ((float)i + 0.5f) / (float)side, ((float)j + 0.5f) / (float)side);

            drawn[kd_cover_owner(&s.r.cover, (double)p.uv[0], (double)p.uv[1])] += 1.0;
        }
    for (i = 0; i < s.count; i++) {
        const kd_warp_block *b = &s.blocks[i];
        const double points = lattice_points(b->low[0], b->high[0], bits)
                            * lattice_points(b->low[1], b->high[1], bits);

        distance += 0.5 * fabs(drawn[i] - points) / all;
        claimed += 0.5 * fabs(drawn[i] / all - s.r.rects[i].probability);
    }
    CHECK(distance <= 1e-5, "%s: all of %dx%d numbers draw blocks as their rectangles say, to %.1e",
          name, side, side, distance);
    CHECK(claimed <= 0.02, "%s: and as their probabilities do, to %.1e", name, claimed);
    free(drawn);
    subject_free(&s);
}

/* ---- inverting ---- */

/* How much wider a block is in the unit square than on the sphere, across and down. */
static double stretch(const kd_warp_block *b, int axis)
{
    const double size = axis ? 0.5 * kd_cap_between(b->edge[2], b->edge[3])
                             : (double)b->edge[1] - (double)b->edge[0];

    return (b->high[axis] - b->low[axis]) / UNIT / size;
}

/* What was found over many points. */
typedef struct inverse {
    long points, crossed, other_pdf, refused, outside, far;
    double error[2];            /* in units of 2^-24 times the stretch, or 1 */
    double angle;               /* over what is allowed */
} inverse;

static void invert_sample(const subject *s, float u0, float u1, inverse *out)
{
    const envsamp_kd *kd = s->r.f.kd;
    const envsamp_sample p = envsamp_kd_sample(kd, u0, u1);
    const float pdf = envsamp_kd_pdf(kd, p.dir);
    const kd_warp_block from = kd_warp_at(kd, (double)u0, (double)u1);
    const float before[2] = { u0, u1 };
    kd_warp_block to;
    float u[2];
    int axis;

    out->points++;
    if (!envsamp_kd_invert(kd, p.dir, u)) {
        out->refused++;
        return;
    }
    if (!(u[0] >= 0.0f && u[0] < 1.0f && u[1] >= 0.0f && u[1] < 1.0f)) {
        out->outside++;
        return;
    }
    to = kd_warp_at(kd, (double)u[0], (double)u[1]);
    out->other_pdf += !kd_bits_equal(&pdf, &p.pdf, sizeof pdf);
    if (!kd_bits_equal(&pdf, &p.pdf, sizeof pdf) || !same_block(&from, &to)) {
        out->crossed++;
        return;
    }
    for (axis = 0; axis < 2; axis++)
        worst(&out->error[axis], fabs((double)u[axis] - (double)before[axis]) * UNIT
                                 / fmax(1.0, stretch(&from, axis)));
}

/* Sampled and inverted: the numbers come back within 4 times 2^-24, times the stretch, because the
   direction in between is floats. Those that round into another block are few. */
static void test_invert(const char *name, int width, int height, int blocks, int count)
{
    pcg32 random = pcg32_make(3, 0);
    inverse out = { 0, 0, 0, 0, 0, 0, { 0.0, 0.0 }, 0.0 };
    subject s;
    int i;

    if (subject_make(&s, name, width, height, blocks)) {
        for (i = 0; i < count; i++) {
            const float u0 = pcg32_float(&random);

            invert_sample(&s, u0, pcg32_float(&random), &out);
        }
        CHECK(!out.refused && !out.outside, "%s: samples invert to numbers, but %ld and %ld", name,
              out.refused, out.outside);
        CHECK(out.other_pdf * 2000 < out.points, "%s: pdf(sample) differs in %ld of %ld", name,
              out.other_pdf, out.points);
        CHECK(out.crossed * 1000 < out.points, "%s: %ld round over an edge, density alike or not",
              name, out.crossed);
        CHECK(out.error[0] <= 4.0, "%s: u0 comes back to %.2f of 2^-24", name, out.error[0]);
        CHECK(out.error[1] <= 4.0, "%s: u1 comes back to %.2f of 2^-24", name, out.error[1]);
    }
    subject_free(&s);
}

static double angle_between(const float a[3], const float b[3])
{
    double ax = (double)a[0], ay = (double)a[1], az = (double)a[2];
    double bx = (double)b[0], by = (double)b[1], bz = (double)b[2];
    double cx = ay * bz - az * by, cy = az * bx - ax * bz, cz = ax * by - ay * bx;

    return atan2(sqrt(cx * cx + cy * cy + cz * cz), ax * bx + ay * by + az * bz);
}

/* How far apart on the sphere numbers are that differ by 2^-24, and what rounding adds. */
static double step_angle(const kd_warp_block *b, const float dir[3])
{
    const double x = (double)dir[0], y = (double)dir[1], z = (double)dir[2];
    const double r = sqrt(x * x + y * y), sine = r / sqrt(r * r + z * z);
    const double turns = 1.0 / UNIT / stretch(b, 0), cap = 2.0 / UNIT / stretch(b, 1);

    return 2.0 * KD_PI * turns * sine + fmin(cap / fmax(sine, 1e-30), sqrt(2.0 * cap))
         + polar_slack(b, sine);
}

/* Inverts a direction and samples there again. */
static void invert_direction(const subject *s, const float dir[3], inverse *out)
{
    const envsamp_kd *kd = s->r.f.kd;
    const int lit_there = envsamp_kd_pdf(kd, dir) > 0.0f;
    envsamp_sample p;
    kd_warp_block b;
    float u[2];

    out->points++;
    if (!envsamp_kd_invert(kd, dir, u)) {
        out->refused += lit_there;
        out->outside += u[0] < 0.0f || u[0] > 0.0f || u[1] < 0.0f || u[1] > 0.0f;
        return;
    }
    out->far += !lit_there;
    if (!(u[0] >= 0.0f && u[0] < 1.0f && u[1] >= 0.0f && u[1] < 1.0f)) {
        out->outside++;
        return;
    }
    p = envsamp_kd_sample(kd, u[0], u[1]);
    b = kd_warp_at(kd, (double)u[0], (double)u[1]);
    worst(&out->angle, angle_between(dir, p.dir) / (1e-6 + step_angle(&b, dir)));
}

static void check_there_again(const subject *s, const char *name, int count)
{
    pcg32 random = pcg32_make(4, 0);
    inverse sampled = { 0, 0, 0, 0, 0, 0, { 0.0, 0.0 }, 0.0 }, any = sampled;
    float dir[3];
    int i;

    for (i = 0; i < count; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample p = envsamp_kd_sample(s->r.f.kd, u0, u1);

        invert_direction(s, p.dir, &sampled);
        kd_random_direction(&random, dir);
        if (i % 4 == 0) {               /* near a pole */
            dir[0] *= 1e-3f;
            dir[1] *= 1e-3f;
        }
        invert_direction(s, dir, &any);
    }
    CHECK(sampled.refused * 2000 <= sampled.points && any.refused * 2000 <= any.points,
          "%s: lit directions invert, but %ld and %ld", name, sampled.refused, any.refused);
    CHECK(!sampled.outside && !any.outside,
          "%s: numbers are below 1, and two zeros where there are none", name);
    CHECK(sampled.far * 2000 <= sampled.points && any.far * 2000 <= any.points,
          "%s: unlit ones do not invert, but %ld and %ld", name, sampled.far, any.far);
    CHECK(sampled.angle <= 1.0, "%s: a sample's direction is drawn again, %.2f of what may be",
          name, sampled.angle);
    CHECK(any.angle <= 1.0, "%s: so is any direction, %.2f of what may be", name, any.angle);
}

static void test_there_again(const char *name, int width, int height, int blocks, int count)
{
    subject s;

    if (subject_make(&s, name, width, height, blocks))
        check_there_again(&s, name, count);
    subject_free(&s);
}

#define POLES 2                 /* where azimuth is any */

/* Poles, seam, axes, the equator: with zeros of both signs, which must not matter. */
static void test_special_directions(void)
{
    const float list[][3] = { { 0, 0, 1 }, { 0, 0, -1 }, { 1, 0, 0 }, { -1, 0, 0 }, { 0, 1, 0 },
                              { 0, -1, 0 }, { 0.6f, 0.8f, 0 }, { -0.6f, 0, 0.8f },
                              { 0.6f, 0, 0.8f }, { 0.6f, 0, -0.8f },
                              { 0, 0.6f, 0.8f }, { 0, -0.6f, -0.8f } };
    inverse out = { 0, 0, 0, 0, 0, 0, { 0.0, 0.0 }, 0.0 };
    int i, signs, c, differ = 0;
    subject s;

    if (!subject_make(&s, "foliage", 256, 128, 6144))
        return;
    for (i = 0; i < (int)(sizeof list / sizeof list[0]); i++)
        for (signs = 0; signs < 8; signs++) {
            float dir[3], u[2], plain[2];

            for (c = 0; c < 3; c++)
                dir[c] = signs >> c & 1 && !(list[i][c] < 0.0f || list[i][c] > 0.0f) ? -0.0f
                                                                                     : list[i][c];
            invert_direction(&s, dir, &out);
            envsamp_kd_invert(s.r.f.kd, dir, u);
            envsamp_kd_invert(s.r.f.kd, list[i], plain);
            differ += i >= POLES && !kd_bits_equal(u, plain, sizeof u);
        }
    CHECK(!out.refused && out.angle <= 1.0, "poles, seam and equator invert, %.2f of what may be",
          out.angle);
    CHECK(!differ, "zeros of both signs are the same, but for %d", differ);
    subject_free(&s);
}

/* Just before the seam, u0 comes from the end of the unit square, just after it from its start,
   whatever y is beside x; and what it draws lies there. */
static void test_seam(void)
{
    const float heights[] = { 0.0f, 0.6f, -0.6f, 100.0f };
    inverse out = { 0, 0, 0, 0, 0, 0, { 0.0, 0.0 }, 0.0 };
    int i, k, wrong = 0;
    subject s;

    if (subject_make(&s, "foliage", 256, 128, 6144))
        for (i = 6; i < 45; i++)
            for (k = 0; k < 4; k++) {
                float dir[3] = { 0.8f, 0.0f, 0.0f }, before[2], after[2];

                dir[2] = heights[k];
                dir[1] = (float)pow(10.0, (double)-i);
                wrong += !envsamp_kd_invert(s.r.f.kd, dir, after) || after[0] > 0.01f;
                invert_direction(&s, dir, &out);
                dir[1] = -dir[1];
                wrong += !envsamp_kd_invert(s.r.f.kd, dir, before)
                      || (before[0] < 0.99f && before[0] > 0.0f);
                invert_direction(&s, dir, &out);
            }
    CHECK(!wrong, "both sides of the seam are both ends of the unit square, but for %d", wrong);
    CHECK(out.angle <= 1.0, "and are drawn again, %.3g of what may be", out.angle);
    subject_free(&s);
}

static void test_no_directions(void)
{
    const float bad[][3] = { { 0, 0, 0 }, { -0.0f, -0.0f, -0.0f }, { NAN, 0, 1 }, { 0, NAN, 1 },
                             { 0, 0, NAN }, { NAN, NAN, NAN }, { INFINITY, 0, 0 },
                             { 0, -INFINITY, 1 }, { 1, 0, INFINITY }, { INFINITY, INFINITY, 1 } };
    int i, wrong = 0, select;
    const float up[3] = { 0.36f, 0.48f, 0.8f };
    subject s;

    if (subject_make(&s, "foliage", 64, 32, 300))
        for (i = 0; i < (int)(sizeof bad / sizeof bad[0]); i++) {
            float u[2] = { 7, 7 };

            wrong += envsamp_kd_invert(s.r.f.kd, bad[i], u) != 0
                  || !(u[0] >= 0.0f && u[0] < 1.0f && u[1] >= 0.0f && u[1] < 1.0f);
        }
    CHECK(!wrong, "no numbers draw what is no direction, but for %d", wrong);
    for (select = ENVSAMP_KD_ALIAS; select <= ENVSAMP_KD_FIT; select++) {
        const envsamp_kd_desc desc = kd_desc(300, (envsamp_kd_select)select);
        const envsamp_image view = kd_image(s.map.rgb, 64, 32, 3);
        float u[2] = { 7, 7 };
        kd_fixture f;

        kd_fixture_build(&f, &view, &desc);
        CHECK(f.kd && envsamp_kd_invert(f.kd, up, u) == 0, "select %d does not invert", select);
        kd_fixture_free(&f);
    }
    subject_free(&s);
}

/* Powers of two change no bit of u; other lengths round, by less than an inverse does. */
static void test_lengths(void)
{
    const float exact[] = { 0x1p-40f, 0x1p-7f, 2.0f, 1024.0f, 0x1p40f };
    const float rounded[] = { 3.0f, 1e-15f, 1e17f, 0.1f };
    pcg32 random = pcg32_make(5, 0);
    int i, k, c, different = 0, moved = 0, crossed = 0;
    subject s;

    if (!subject_make(&s, "foliage", 256, 128, 2000))
        return;
    for (i = 0; i < 5000; i++) {
        float dir[3], longer[3], u[2], w[2];
        kd_warp_block from, to;

        kd_random_direction(&random, dir);
        envsamp_kd_invert(s.r.f.kd, dir, u);
        from = kd_warp_at(s.r.f.kd, (double)u[0], (double)u[1]);
        for (k = 0; k < 9; k++) {
            for (c = 0; c < 3; c++)
                longer[c] = dir[c] * (k < 5 ? exact[k] : rounded[k - 5]);
            envsamp_kd_invert(s.r.f.kd, longer, w);
            to = kd_warp_at(s.r.f.kd, (double)w[0], (double)w[1]);
            different += k < 5 && !kd_bits_equal(u, w, sizeof u);
            crossed += !same_block(&from, &to);
            for (c = 0; c < 2 && same_block(&from, &to); c++)
                moved += fabs((double)u[c] - (double)w[c]) * UNIT > 4.0 * fmax(1.0,
                                                                    stretch(&from, c));
        }
    }
    CHECK(!different, "length does not matter: %d differ", different);
    CHECK(!moved && crossed < 20, "nor where it rounds: %d differ, %d cross an edge", moved,
          crossed);
    subject_free(&s);
}

/* ---- batches ---- */

#define MOST 1000

typedef struct batch { float x[MOST], y[MOST], z[MOST], w[MOST]; } batch;

static const float nasty[] = { 0.0f, -0.0f, 1.0f, -1.0f, 0.99999994f, NAN, -NAN, INFINITY,
                               -INFINITY, FLT_MAX, -FLT_MAX, FLT_MIN / 4, -0.25f, 1.5f, 4097.25f };
#define NASTIES ((int)(sizeof nasty / sizeof nasty[0]))

/* Plain numbers with nasty ones among them. */
static void batch_fill(batch *b, int every, pcg32 *random)
{
    int i;

    for (i = 0; i < MOST; i++) {
        const uint32_t odd = pcg32_next(random);

        b->x[i] = odd % (uint32_t)every ? pcg32_float(random)
                                        : nasty[pcg32_next(random) % (uint32_t)NASTIES];
        b->y[i] = odd % (uint32_t)every > 1 ? pcg32_float(random)
                                            : nasty[pcg32_next(random) % (uint32_t)NASTIES];
        b->z[i] = odd % 5 ? pcg32_float(random) - 0.5f
                          : nasty[pcg32_next(random) % (uint32_t)NASTIES];
        b->w[i] = 7.0f;
    }
}

/* How many samples of a batch differ from calls one at a time; -1 if more was written. */
static int sample_differences(const envsamp_kd *kd, int n, int in_place, pcg32 *random)
{
    static batch in, out;
    int i, differences = 0;

    batch_fill(&in, 4, random);
    out = in;
    if (in_place)
        envsamp_kd_sample_n(kd, (size_t)n, out.x, out.y, out.x, out.y, out.z, out.w);
    else
        envsamp_kd_sample_n(kd, (size_t)n, in.x, in.y, out.x, out.y, out.z, out.w);
    for (i = 0; i < n; i++) {
        const envsamp_sample s = envsamp_kd_sample(kd, in.x[i], in.y[i]);
        const float got[4] = { out.x[i], out.y[i], out.z[i], out.w[i] };

        differences += !kd_bits_equal(got, s.dir, sizeof s.dir)
                    || !kd_bits_equal(&got[3], &s.pdf, sizeof(float));
    }
    for (i = n; i < MOST; i++)
        if (!kd_bits_equal(&out.x[i], &in.x[i], 4) || !kd_bits_equal(&out.y[i], &in.y[i], 4)
            || !kd_bits_equal(&out.z[i], &in.z[i], 4) || !kd_bits_equal(&out.w[i], &in.w[i], 4))
            return -1;
    return differences;
}

static int pdf_differences(const envsamp_kd *kd, int n, int in_place, pcg32 *random)
{
    static batch in, out;
    float *pdf = in_place == 0 ? out.w : in_place == 1 ? out.x : in_place == 2 ? out.y : out.z;
    int i, differences = 0;

    batch_fill(&in, 6, random);
    out = in;
    envsamp_kd_pdf_n(kd, (size_t)n, out.x, out.y, out.z, pdf);
    for (i = 0; i < n; i++) {
        const float dir[3] = { in.x[i], in.y[i], in.z[i] }, one = envsamp_kd_pdf(kd, dir);

        differences += !kd_bits_equal(&pdf[i], &one, sizeof one) || !(one >= 0.0f);
    }
    return differences;
}

static void test_batches(void)
{
    const int sizes[] = { 0, 1, 2, 63, 64, 65, 127, 128, 129, 1000 };
    const int blocks[] = { 1, 2, 700 };
    pcg32 random = pcg32_make(6, 0);
    int select, b, k, way;

    for (select = 0; select <= ENVSAMP_KD_FIT; select++) {
        int samples = 0, pdfs = 0, built = 0;

        for (b = 0; b < 3; b++) {
            const envsamp_kd_desc desc = kd_desc(blocks[b], (envsamp_kd_select)select);
            envsamp_image view;
            kd_fixture f;
            image map;

            map_make("foliage", 128, 64, &map);
            view = kd_image(map.rgb, 128, 64, 3);
            built += kd_fixture_build(&f, &view, &desc);
            for (k = 0; f.kd && k < (int)(sizeof sizes / sizeof sizes[0]); k++)
                for (way = 0; way < 4; way++) {
                    samples += sample_differences(f.kd, sizes[k], way & 1, &random) != 0;
                    pdfs += pdf_differences(f.kd, sizes[k], way, &random) != 0;
                }
            if (f.kd)
                envsamp_kd_sample_n(f.kd, 0, NULL, NULL, NULL, NULL, NULL, NULL);
            kd_fixture_free(&f);
            image_free(&map);
        }
        CHECK(built == 3 && !samples, "select %d: batches of samples are scalar calls, %d are not",
              select, samples);
        CHECK(!pdfs, "select %d: batches of densities are scalar calls, %d are not", select, pdfs);
    }
}

/* ---- the tree ---- */

static void test_cuts(const char *name)
{
    const envsamp_kd_desc desc = kd_desc(6144, ENVSAMP_KD_WARP);
    kd_warp_block *blocks = (kd_warp_block *)kd_allocate(6144 * sizeof *blocks);
    int i, deepest = 0, count = 0;
    double cuts = 0.0;
    envsamp_image view;
    kd_fixture f;
    image map;

    map_make(name, 2048, 1024, &map);
    view = kd_image(map.rgb, 2048, 1024, 3);
    if (kd_fixture_build(&f, &view, &desc))
        count = kd_warp_blocks(f.kd, blocks, 6144);
    for (i = 0; i < count; i++) {
        cuts += kd_warp_rect(&f, &blocks[i]).probability * (double)blocks[i].depth;
        deepest = blocks[i].depth > deepest ? blocks[i].depth : deepest;
    }
    CHECK(count == 6144 && kd_tile_count(f.kd) == 2048, "%s: %d blocks, 2048 tiles", name, count);
    CHECK(cuts <= 2.0, "%s: %.2f cuts below a tile are expected", name, cuts);
    CHECK(deepest <= KD_DEEPEST, "%s: the most are %d", name, deepest);
    CHECK(f.sizes.table_bytes <= 262144 && envsamp_kd_bytes(f.kd) <= 262144,
          "%s: a table of %lu bytes", name, (unsigned long)envsamp_kd_bytes(f.kd));
    free(blocks);
    kd_fixture_free(&f);
    image_free(&map);
}

/* Wherever splits want to follow one another, they stop at 32 below a tile. */
static void test_deep(envsamp_kd_criterion criterion)
{
    envsamp_kd_desc desc = kd_desc(3000, ENVSAMP_KD_WARP);
    static float pixels[4096];
    envsamp_image map = kd_image(pixels, 4096, 1, 1);
    kd_warp_block *blocks = (kd_warp_block *)kd_allocate(3000 * sizeof *blocks);
    int i, count, deepest = 0;
    kd_fixture f;

    for (i = 0; i < 4096; i++)
        pixels[i] = ldexpf(1.0f, -i / 24);
    desc.criterion = criterion;
    CHECK(kd_fixture_build(&f, &map, &desc), "a staircase, criterion %d", (int)criterion);
    count = f.kd ? kd_warp_blocks(f.kd, blocks, 3000) : 0;
    for (i = 0; i < count; i++)
        deepest = blocks[i].depth > deepest ? blocks[i].depth : deepest;
    CHECK(count == f.info.block_count && deepest <= KD_DEEPEST,
          "%d blocks are at most %d cuts below their tiles", count, deepest);
    free(blocks);
    kd_fixture_free(&f);
}

/* ---- where the unit square has no room ---- */

/* What the table says of itself is still so: figures by sums over texels, densities by looking up
   the middle of blocks, samples by where they lie. */
static void check_agreement(const subject *s, const char *what)
{
    const double excess = fmax(reference_excess(&s->r), 0.0), ratio = reference_max_ratio(&s->r);
    pcg32 random = pcg32_make(7, 0);
    int i, dark = 0, strays = 0, wrong = 0;

    for (i = 0; i < s->count; i++) {
        const kd_rect *r = &s->r.rects[i];
        const float pdf = kd_density(&s->blocks[i]);
        float dir[3], found;

        dark += s->r.peak[i] > 0.0 && !(pdf > 0.0f);
        kd_direction(0.5 * (r->u0 + r->u1), 0.5 * (r->v0 + r->v1), dir);
        found = envsamp_kd_pdf(s->r.f.kd, dir);
        wrong += r->u1 - r->u0 > 2e-6 && r->v1 - r->v0 > 2e-6
              && !kd_bits_equal(&pdf, &found, sizeof pdf);
    }
    for (i = 0; i < 20000; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample p = envsamp_kd_sample(s->r.f.kd, u0, u1);
        const kd_warp_block b = kd_warp_at(s->r.f.kd, (double)u0, (double)u1);
        const kd_rect r = kd_warp_rect(&s->r.f, &b);

        strays += kd_outside(&r, (double)p.uv[0], (double)p.uv[1]) > EDGE || !(p.pdf > 0.0f);
    }
    CHECK(!kd_cover_faults(&s->r.cover), "%s: %d blocks tile the map", what, s->count);
    CHECK(!dark && !wrong && !strays, "%s: densities and samples agree, but for %d, %d and %d",
          what, dark, wrong, strays);
    CHECK(fabs(s->r.f.info.excess_variance - excess) <= 2e-6 * (1.0 + excess)
          && fabs(s->r.f.info.max_ratio / ratio - 1.0) <= 2e-6, "%s: excess %.6g, ratio %.6g", what,
          excess, ratio);
}

/* envsamp_kd_get_block against the walk down the tree, in order. */
static void check_blocks(const subject *s, const char *what)
{
    double off = 0.0, probability = 0.0;
    int i, order = 0;

    for (i = 0; i < s->count; i++) {
        const kd_rect *r = &s->r.rects[i];
        envsamp_kd_block block;

        order += envsamp_kd_get_block(s->r.f.kd, i, &block) != ENVSAMP_OK;
        worst(&off, fabs((double)block.uv_min[0] - r->u0) + fabs((double)block.uv_max[0] - r->u1));
        worst(&off, fabs((double)block.uv_min[1] - r->v0) + fabs((double)block.uv_max[1] - r->v1));
        worst(&probability, fabs((double)block.probability - r->probability)
                            / (1e-30 + r->probability));
    }
    CHECK(!order && off <= 6e-7 && probability <= 1.2e-7, "%s: %d blocks as told, to %.1e, %.1e",
          what, s->count, off, probability);
}

/* The tiles of a long map are at most 8 times as long as wide, in texels, and samples invert. */
static void test_long(int width, int height)
{
    envsamp_kd_desc desc = kd_desc(6144, ENVSAMP_KD_WARP);
    pcg32 random = pcg32_make(4, 7);
    double longer = 0.0, off = 0.0;
    envsamp_image view;
    kd_fixture f;
    image map;
    int i, k;

    map_make("foliage", width, height, &map);
    view = kd_image(map.rgb, width, height, 3);
    if (kd_fixture_build(&f, &view, &desc)) {
        longer = log2((double)width / (double)height)
               - (double)KD_WORD(f.kd, tile_bits_x) + (double)KD_WORD(f.kd, tile_bits_y);
        for (i = 0; i < 20000; i++) {
            const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
            const envsamp_sample s = envsamp_kd_sample(f.kd, u0, u1);
            envsamp_sample again;
            float u[2];

            envsamp_kd_invert(f.kd, s.dir, u);
            again = envsamp_kd_sample(f.kd, u[0], u[1]);
            for (k = 0; k < 3; k++)
                worst(&off, fabs((double)again.dir[k] - (double)s.dir[k]));
        }
    }
    CHECK(f.kd && fabs(longer) <= 3.0, "%dx%d: tiles of 2^%.0f to 1", width, height, longer);
    CHECK(off > 0.0 && off <= 1e-5, "%dx%d: what is sampled inverts, to %.1e", width, height, off);
    kd_fixture_free(&f);
    image_free(&map);
}

/* One lit texel of 1.5e-5 turns, 256 floats wide, is not cut into 512 columns: tiles are fewer. */
static void test_coarse(void)
{
    const int width = 65535, height = 16;
    float *pixels = (float *)kd_allocate((size_t)width * (size_t)height * sizeof *pixels);
    const envsamp_image view = kd_image(pixels, width, height, 1);
    const envsamp_kd_desc desc = kd_desc(1048576, ENVSAMP_KD_WARP);
    pcg32 random = pcg32_make(3, 7);
    int i, tiles, outside = 0;
    kd_fixture f;

    pixels[7 * width + width - 1] = 5.0f;
    tiles = kd_fixture_build(&f, &view, &desc) ? kd_tile_count(f.kd) : 0;
    CHECK(tiles == 65536, "a texel at the end of a row has a quarter of the tiles of others: %d",
          tiles);
    for (i = 0; f.kd && i < 10000; i++) {
        const float u0 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(f.kd, u0, pcg32_float(&random));

        outside += s.uv[0] < 1.0f - 1.6e-5f || fabsf(s.uv[1] - 7.5f / 16.0f) > 0.5f / 16.0f + 1e-6f
                || !(s.pdf > 0.0f);
    }
    CHECK(f.info.excess_variance < 1e-5 && !outside, "excess %.1e, %d of 10000 samples beside it",
          f.info.excess_variance, outside);
    kd_fixture_free(&f);
    free(pixels);
}

/* A map of one column and 65535 rows, one of them as bright as to be cut into blocks that are
   thinner than floats of v tell. What is told is still a block. */
static void test_thin(envsamp_mapping mapping, int row)
{
    float *pixels = (float *)kd_allocate(65535 * sizeof *pixels);
    const envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_image view = kd_image(pixels, 1, 65535, 1);
    int i, axis, thin = 0, wrong = 0;
    kd_fixture f;

    view.mapping = mapping;
    for (i = 0; i < 65535; i++)
        pixels[i] = i == row ? 1e9f : 1e-3f;
    CHECK(kd_fixture_build(&f, &view, &desc), "mapping %d, row %d is bright", (int)mapping, row);
    for (i = 0; i < f.info.block_count; i++) {
        envsamp_kd_block b;

        envsamp_kd_get_block(f.kd, i, &b);
        for (axis = 0; axis < 2; axis++)
            wrong += !(b.uv_min[axis] >= 0.0f && b.uv_min[axis] < b.uv_max[axis]
                       && b.uv_max[axis] <= 1.0f);
        thin += nextafterf(b.uv_min[1], 2.0f) >= b.uv_max[1];
    }
    CHECK(!wrong && thin > 50, "edges of all rise, but of %d; %d are as thin as can be", wrong,
          thin);
    kd_fixture_free(&f);
    free(pixels);
}

/* Black columns, rows, pole and quarter: cuts at the edges of the unit square, 0 and -0, with
   nothing on one side. */
static void test_black_parts(int width, int height, int blocks)
{
    const char *what = "black parts";
    pcg32 random = pcg32_make(9, 0);
    int i, x, y, cuts = 0;
    subject s;

    if (!image_alloc(&s.map, width, height))
        return;
    for (i = 0; i < width * height * 3; i++) {
        x = i / 3 % width;
        y = i / 3 / width;
        s.map.rgb[i] = x % 9 > 3 && y % 7 > 2 && y > height / 8 && (x > width / 4 || y < height / 2)
                     ? 0.1f + pcg32_float(&random) : 0.0f;
    }
    if (subject_build(&s, blocks)) {
        for (i = 0; i < s.count; i++)
            cuts += !lit(&s.blocks[i]);
        CHECK(cuts > 10, "%s: %d blocks have no place in the unit square", what, cuts);
        check_blocks(&s, what);
        check_agreement(&s, what);
        check_there_again(&s, what, 50000);
    }
    subject_free(&s);
}

/* Noise, and a sun of some texels over whose light nothing else counts. */
static void test_sun(int width, int height, float sun, int side, int blocks, int crowded)
{
    pcg32 random = pcg32_make(8, 0);
    const envsamp_kd *kd;
    char what[64];
    subject s;
    int i;

    if (!image_alloc(&s.map, width, height))
        return;
    for (i = 0; i < width * height * 3; i++) {
        const int x = i / 3 % width, y = i / 3 / width;

        s.map.rgb[i] = 0.1f + pcg32_float(&random);
        if (x >= width / 3 && x < width / 3 + side && y >= height / 4 && y < height / 4 + side)
            s.map.rgb[i] = sun;
    }
    snprintf(what, sizeof what, "%dx%d, a sun of %g", width, height, (double)sun);
    if (subject_build(&s, blocks)) {
        check_agreement(&s, what);
        CHECK(!crowded || s.count < blocks, "%s: has no room for %d of %d blocks", what,
              blocks - s.count, blocks);
        CHECK(envsamp_kd_open(s.r.f.kd, envsamp_kd_bytes(s.r.f.kd), &kd) == ENVSAMP_OK,
              "%s: opens", what);
    }
    subject_free(&s);
}

/* ---- the same bytes ---- */

static void test_same_bytes(const char *name, int width, int height, int blocks)
{
    const int rubbish[] = { 0x00, 0xff, 0x7f, 0x80 };
    envsamp_kd_desc desc = kd_desc(blocks, ENVSAMP_KD_WARP);
    envsamp_image view;
    int i, k, differ = 0;
    kd_fixture f;
    image map;

    map_make(name, width, height, &map);
    view = kd_image(map.rgb, width, height, 3);
    CHECK(kd_fixture_build(&f, &view, &desc), "%s, %d blocks", name, blocks);
    for (i = 0; f.kd && i < 4; i++)
        for (k = 0; k < 4; k++) {
            kd_guarded table = kd_guarded_make(f.sizes.table_bytes, rubbish[i]);
            kd_guarded scratch = kd_guarded_make(f.sizes.scratch_bytes, rubbish[k]);
            const envsamp_kd *kd;

            differ += envsamp_kd_build(&view, &desc, table.buffer, scratch.buffer, &kd)
                          != ENVSAMP_OK
                   || envsamp_kd_bytes(kd) != envsamp_kd_bytes(f.kd)
                   || !kd_bits_equal(kd, f.kd, envsamp_kd_bytes(kd));
            free(table.block);
            free(scratch.block);
        }
    CHECK(!differ, "%s: whatever the buffers held, but for %d", name, differ);
    kd_fixture_free(&f);
    image_free(&map);
}

/* ---- all ---- */

static void test_maps(void)
{
    static const char *const names[] = { "sky", "studio", "night", "foliage" };
    int i;

    for (i = 0; i < 4; i++) {
        test_strata(names[i], 256, 128, 6144);
        test_inside(names[i], 256, 128, 6144);
        test_areas(names[i], 256, 128, 6144);
        test_invert(names[i], 512, 256, 6144, 200000);
        test_there_again(names[i], 512, 256, 6144, 100000);
        test_cuts(names[i]);
        test_same_bytes(names[i], 97, 61, 900);
    }
    test_strata("foliage", 33, 130, 257);
    test_halves("studio", 256, 128, 6144);
    test_halves("foliage", 256, 128, 6144);
    test_halves("night", 1000, 300, 3000);
    test_inside("sky", 64, 32, 5);
    test_inside("foliage", 97, 61, 1);
    test_areas("sky", 512, 256, 32768);
    test_areas("foliage", 61, 97, 100);
    test_invert("foliage", 64, 32, 12, 100000);
    test_invert("constant", 64, 32, 100, 100000);
    test_there_again("foliage", 64, 32, 12, 100000);
    test_there_again("constant", 64, 32, 100, 100000);
}

int main(int argc, char **argv)
{
    if (argc < 2 || strcmp(argv[1], "quick") != 0) {
        test_maps();
        test_lattice("foliage", 300, 12);
        test_lattice("studio", 50, 11);
    }
    test_special_directions();
    test_seam();
    test_no_directions();
    test_lengths();
    test_batches();
    test_deep(ENVSAMP_KD_SSE);
    test_deep(ENVSAMP_KD_VARIANCE);
    test_deep(ENVSAMP_KD_RANGE);
    test_deep(ENVSAMP_KD_EXCESS);
    test_black_parts(90, 70, 3000);
    test_black_parts(36, 21, 500);
    test_sun(96, 48, 1e9f, 2, 700, 1);
    test_sun(256, 128, 1e9f, 1, 6144, 0);
    test_sun(256, 128, 1e20f, 3, 6144, 1);
    test_sun(7, 5, 1e9f, 1, 35, 0);
    test_sun(3, 3, 1e4f, 1, 1048576, 0);
    test_sun(40, 1, 1e12f, 1, 1000, 0);
    test_sun(1, 40, 1e12f, 1, 1000, 0);
    test_coarse();
    test_long(16, 8192);
    test_long(8192, 16);
    test_long(64, 1024);
    test_thin(ENVSAMP_HEMISPHERE, 65534);
    test_thin(ENVSAMP_LATLONG, 16000);
    test_thin(ENVSAMP_LATLONG, 65534);
    return check_done();
}
