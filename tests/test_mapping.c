/* test_mapping.c: all samplers in all mappings, with MIS compensation and exponents, against sums
 * map that know nothing of the library. */
#include "check.h"
#include "statistics.h"

#include "../envsamp.h"

#include "sampler.h"

#include <float.h>

/* ---- mappings, once more ---- */

static double wrap_turn(double u)
{
    return u - floor(u);
}

/* Direction of a point of the map. Octahedral [Clarberg]: a and b are the distances from the axes,
   r their sum; the lower half is folded out over the diagonals. */
static void direction_of(envsamp_mapping mapping, double u, double v, double dir[3])
{
    double a = fabs(2.0 * u - 1.0), b = fabs(2.0 * v - 1.0), r = a + b, turn, ring;
    const double theta = (mapping == ENVSAMP_LATLONG ? KD_PI : 0.5 * KD_PI) * v;

    if (mapping != ENVSAMP_OCTAHEDRAL) {
        dir[0] = cos(2.0 * KD_PI * u) * sin(theta);
        dir[1] = sin(2.0 * KD_PI * u) * sin(theta);
        dir[2] = cos(theta);
        return;
    }
    if (r > 1.0) {
        b = 1.0 - a;
        r = 2.0 - r;
        dir[2] = r * r - 1.0;
    } else {
        dir[2] = 1.0 - r * r;
    }
    turn = r > 0.0 ? 0.5 * KD_PI * b / r : 0.0;
    ring = r * sqrt(2.0 - r * r);
    dir[0] = (u < 0.5 ? -ring : ring) * cos(turn);
    dir[1] = (v < 0.5 ? -ring : ring) * sin(turn);
}

/* Point of a direction. Hemisphere: v above 1 below the horizon. */
static void point_of(envsamp_mapping mapping, const float dir[3], double *u, double *v)
{
    const double x = (double)dir[0], y = (double)dir[1], z = (double)dir[2];
    const double ring = sqrt(x * x + y * y);
    double a, b, r;

    if (mapping != ENVSAMP_OCTAHEDRAL) {
        *u = wrap_turn(atan2(y, x) / (2.0 * KD_PI));
        *v = atan2(ring, z) / (mapping == ENVSAMP_LATLONG ? KD_PI : 0.5 * KD_PI);
        return;
    }
    r = sqrt(2.0) * sin(0.5 * atan2(ring, fabs(z)));
    b = r * atan2(fabs(y), fabs(x)) / (0.5 * KD_PI);
    a = r - b;
    if (z < 0.0) {
        const double kept = a;

        a = 1.0 - b;
        b = 1.0 - kept;
    }
    *u = 0.5 * (1.0 + copysign(a, x));
    *v = 0.5 * (1.0 + copysign(b, y));
}

static double whole_sphere(envsamp_mapping mapping)
{
    return mapping == ENVSAMP_HEMISPHERE ? 2.0 * KD_PI : 4.0 * KD_PI;
}

static double solid_angle(envsamp_mapping mapping, double u0, double u1, double v0, double v1)
{
    const double turn = mapping == ENVSAMP_LATLONG ? KD_PI : 0.5 * KD_PI;

    if (mapping == ENVSAMP_OCTAHEDRAL)
        return 4.0 * KD_PI * (u1 - u0) * (v1 - v0);
    return 2.0 * KD_PI * (u1 - u0) * 2.0 * sin(0.5 * turn * (v0 + v1))
         * sin(0.5 * turn * (v1 - v0));
}

/* ---- lookups, once more: maps of one channel ---- */

/* The texel (x, y), which may be one beyond an edge. */
static double texel(const envsamp_image *map, int x, int y)
{
    const int w = map->width, h = map->height;

    if (map->mapping == ENVSAMP_OCTAHEDRAL) {
        if (x < 0 || x >= w) {
            x = x < 0 ? 0 : w - 1;
            y = h - 1 - y;
        }
        if (y < 0 || y >= h) {
            y = y < 0 ? 0 : h - 1;
            x = w - 1 - x;
        }
    } else {
        if (y < 0 || (y >= h && map->mapping == ENVSAMP_LATLONG))
            x += w / 2;                         /* over a pole */
        y = y < 0 ? 0 : y >= h ? h - 1 : y;
        x = (x + 2 * w) % w;
    }
    return (double)map->pixels[y * w + x];
}

static double radiance(const envsamp_image *map, int bilinear, double u, double v)
{
    const double shift = bilinear ? 0.5 : 0.0;
    const double px = u * (double)map->width - shift, py = v * (double)map->height - shift;
    const int x = (int)floor(px), y = (int)floor(py);
    const double fx = px - (double)x, fy = py - (double)y;

    if (!bilinear)
        return texel(map, x < map->width ? x : map->width - 1,
                     y < map->height ? y : map->height - 1);
    return (1.0 - fy) * ((1.0 - fx) * texel(map, x, y) + fx * texel(map, x + 1, y))
         + fy * ((1.0 - fx) * texel(map, x, y + 1) + fx * texel(map, x + 1, y + 1));
}

/* ---- sums over a part of a map ---- */

typedef struct sums { double sr, light, square, max; } sums;

/* Adds a rectangle in which radiance is bilinear: two points of Gauss across, exact for squares,
   five down, where the sine is. */
static void add_piece(const envsamp_image *map, int bilinear, const double at[4], sums *total)
{
    static const double across[2] = { -0.57735026918962576451, 0.57735026918962576451 };
    static const double down[5] = { -0.90617984593866399280, -0.53846931010568309104, 0.0,
                                    0.53846931010568309104, 0.90617984593866399280 };
    static const double weights[5] = { 0.23692688505618908751, 0.47862867049936646804,
                                       0.56888888888888888889, 0.47862867049936646804,
                                       0.23692688505618908751 };
    const double u = 0.5 * (at[0] + at[1]), half_u = 0.5 * (at[1] - at[0]);
    const double v = 0.5 * (at[2] + at[3]), half_v = 0.5 * (at[3] - at[2]);
    const double turn = map->mapping == ENVSAMP_LATLONG ? KD_PI : 0.5 * KD_PI;
    const double shrink = 1.0 - 1e-12;
    int i, k;

    for (k = 0; k < 5; k++)
        for (i = 0; i < 2; i++) {
            const double pv = v + half_v * down[k];
            const double value = radiance(map, bilinear, u + half_u * across[i], pv);
            double sr = half_u * half_v * weights[k] * 4.0 * KD_PI;

            if (map->mapping != ENVSAMP_OCTAHEDRAL)
                sr *= 0.5 * turn * sin(turn * pv);
            total->sr += sr;
            total->light += sr * value;
            total->square += sr * value * value;
        }
    for (i = 0; i < 4; i++)
        total->max = fmax(total->max, radiance(map, bilinear,
                                               u + (i & 1 ? half_u : -half_u) * shrink,
                                               v + (i & 2 ? half_v : -half_v) * shrink));
}

/* An edge or a centre of a texel, if x is one but for rounding. */
static double snapped(double x, double lines)
{
    const double line = floor(x * lines + 0.5) / lines;

    return fabs(x - line) < 4e-7 ? line : x;
}

/* Sums over a rectangle of the map, cut at the edges and at the centres of texels. */
static sums sums_over(const envsamp_image *map, int bilinear, double u0, double u1, double v0,
                      double v1)
{
    const double w = 2.0 * (double)map->width, h = 2.0 * (double)map->height;
    sums total = { 0.0, 0.0, 0.0, 0.0 };
    int x, y;

    u0 = snapped(u0, w);
    u1 = snapped(u1, w);
    v0 = snapped(v0, h);
    v1 = snapped(v1, h);
    for (y = (int)floor(v0 * h); (double)y < v1 * h; y++)
        for (x = (int)floor(u0 * w); (double)x < u1 * w; x++) {
            double at[4];

            at[0] = fmax(u0, (double)x / w);
            at[1] = fmin(u1, (double)(x + 1) / w);
            at[2] = fmax(v0, (double)y / h);
            at[3] = fmin(v1, (double)(y + 1) / h);
            if (at[0] < at[1] && at[2] < at[3])
                add_piece(map, bilinear, at, &total);
        }
    return total;
}

/* ---- maps ---- */

/* Noise of a hundred to one; `black`: one texel in 16 is. */
static envsamp_image make_noise(int width, int height, envsamp_mapping mapping, int black)
{
    float *pixels = (float *)kd_allocate((size_t)(width * height) * sizeof *pixels);
    pcg32 random = pcg32_make(31, (uint64_t)(width * 100 + height));
    envsamp_image map;
    int i;

    for (i = 0; i < width * height; i++) {
        const float u = pcg32_float(&random);

        pixels[i] = pcg32_next(&random) % 16u == 0 && black ? 0.0f : 0.1f + 10.0f * u * u * u;
    }
    map = kd_image(pixels, width, height, 1);
    map.mapping = mapping;
    return map;
}

static envsamp_image make_map(int width, int height, envsamp_mapping mapping)
{
    return make_noise(width, height, mapping, width * height > 64);
}

static void free_map(envsamp_image *map)
{
    union { const float *read; void *whole; } pixels;

    pixels.read = map->pixels;
    free(pixels.whole);
    map->pixels = NULL;
}

/* What compensation leaves of a map, and the amount in force. */
static envsamp_image what_is_left(const envsamp_image *map, int bilinear, float amount,
                                  float *in_force)
{
    const double mean = sums_over(map, bilinear, 0.0, 1.0, 0.0, 1.0).light
                      / whole_sphere(map->mapping);
    const int count = map->width * map->height;
    float *pixels = (float *)kd_allocate((size_t)count * sizeof *pixels);
    double brightest = 0.0;
    envsamp_image left = *map;
    int i;

    for (i = 0; i < count; i++)
        brightest = fmax(brightest, (double)map->pixels[i]);
    *in_force = brightest > 1.001 * (double)amount * mean ? amount : 0.0f;
    for (i = 0; i < count; i++)
        pixels[i] = (float)fmax((double)map->pixels[i] - (double)*in_force * mean, 0.0);
    left.pixels = pixels;
    return left;
}

/* What draws are in proportion to: a map to a power, times any factor. */
static envsamp_image importance_of(const envsamp_image *map, float exponent)
{
    const int count = map->width * map->height;
    float *pixels = (float *)kd_allocate((size_t)count * sizeof *pixels);
    envsamp_image raised = *map;
    int i;

    for (i = 0; i < count; i++)
        pixels[i] = exponent > 0.0f ? powf(map->pixels[i], exponent) : map->pixels[i];
    raised.pixels = pixels;
    return raised;
}

static void print_request(char *text, size_t size, const sampler_request *r)
{
    snprintf(text, size, "%s, %s, %d by %d, bilinear %d, compensation %g, exponent %g",
             sampler_names[r->kind], sampler_mappings[r->image.mapping], r->image.width,
             r->image.height, r->bilinear, (double)r->compensation, (double)r->exponent);
}

/* ---- splits: each is the best of all cuts ---- */

/* A block, in cells: where radiance is bilinear these lie between texel centres. Its edges are at
   64ths of cells, and cells are taken whole or, if so many pieces are no more than 128 and no more
   than 64 across, divided by a power of 2. */
typedef struct split_block { double low[2], high[2]; int pieces; } split_block;

static int pieces_between(double low, double high, int pieces)
{
    return (int)(ceil(high * pieces) - floor(low * pieces));
}

static split_block split_block_of(const envsamp_image *map, int bilinear,
                                  const envsamp_kd_block *b)
{
    const double texels[2] = { (double)map->width, (double)map->height };
    const double offset = bilinear ? 0.5 : 0.0;
    int axis, across, down;
    split_block s;

    for (axis = 0; axis < 2; axis++) {
        s.low[axis] = floor(64.0 * ((double)b->uv_min[axis] * texels[axis] + offset) + 0.5) / 64.0;
        s.high[axis] = floor(64.0 * ((double)b->uv_max[axis] * texels[axis] + offset) + 0.5) / 64.0;
    }
    for (s.pieces = bilinear ? 64 : 1; s.pieces > 1; s.pieces /= 2) {
        across = pieces_between(s.low[0], s.high[0], s.pieces);
        down = pieces_between(s.low[1], s.high[1], s.pieces);
        if (across <= 64 && across * down <= 128)
            break;
    }
    return s;
}

/* What a part is worth: the least of these sums is what EXCESS wants, of the others the squares
   about the mean are. */
static double part_cost(const envsamp_image *map, int bilinear, const split_block *b,
                        envsamp_kd_criterion criterion)
{
    const double w = (double)map->width, h = (double)map->height, offset = bilinear ? 0.5 : 0.0;
    const sums part = sums_over(map, bilinear, (b->low[0] - offset) / w, (b->high[0] - offset) / w,
                                (b->low[1] - offset) / h, (b->high[1] - offset) / h);

    return criterion == ENVSAMP_KD_EXCESS ? sqrt(part.sr * part.square)
                                          : part.square - part.light * part.light / part.sr;
}

static double cut_cost(const envsamp_image *map, int bilinear, const split_block *b,
                       envsamp_kd_criterion criterion, int axis, double at)
{
    split_block low = *b, high = *b;

    low.high[axis] = high.low[axis] = at;
    return part_cost(map, bilinear, &low, criterion) + part_cost(map, bilinear, &high, criterion);
}

/* Splits: how many were tried, are not the best, and are fine cuts of polar angle; the least share
   that one gains of what the best does. */
typedef struct split_tally { int splits, others, fine; double least; } split_tally;

/* The block before, and its lower part after the split. */
static void judge_split(const envsamp_image *map, int bilinear, envsamp_kd_criterion criterion,
                        const envsamp_kd_block *whole, const envsamp_kd_block *part,
                        split_tally *t)
{
    const split_block b = split_block_of(map, bilinear, whole);
    const split_block low = split_block_of(map, bilinear, part);
    const double none = part_cost(map, bilinear, &b, criterion);
    const int taken = low.high[0] < b.high[0] ? 0 : 1;
    double best = none, chosen = cut_cost(map, bilinear, &b, criterion, taken, low.high[taken]);
    int axis, i;

    for (axis = 0; axis < 2; axis++)
        for (i = (int)floor(b.low[axis] * b.pieces) + 1; i < b.high[axis] * b.pieces; i++)
            best = fmin(best, cut_cost(map, bilinear, &b, criterion, axis, (double)i / b.pieces));
    if (none - best < 1e-4 * none)          /* hardly more than rounding */
        return;
    t->splits++;
    t->others += chosen > best + 1e-9 * none;
    t->fine += taken == 1 && low.high[1] > floor(low.high[1]);
    t->least = fmin(t->least, (none - chosen) / (none - best));
}

/* Tables of one block more each: the one that is new was split from one that is gone. */
static void judge_splits(const envsamp_image *map, int bilinear, envsamp_kd_criterion criterion,
                         split_tally *t)
{
    enum { BLOCKS = 6 };
    envsamp_kd_block before[BLOCKS], after[BLOCKS];
    envsamp_kd_desc desc = kd_desc(1, ENVSAMP_KD_ALIAS);
    int i, split;

    desc.nearest = !bilinear;
    desc.criterion = criterion;
    for (; desc.block_count <= BLOCKS; desc.block_count++) {
        kd_fixture f;

        if (!kd_fixture_build(&f, map, &desc) || f.info.block_count < desc.block_count) {
            kd_fixture_free(&f);
            return;
        }
        for (split = -1, i = 0; i < desc.block_count; i++) {
            envsamp_kd_get_block(f.kd, i, &after[i]);
            if (i + 1 < desc.block_count && after[i].solid_angle < before[i].solid_angle)
                split = i;
        }
        if (split >= 0)
            judge_split(map, bilinear, criterion, &before[split], &after[split], t);
        memcpy(before, after, sizeof before);
        kd_fixture_free(&f);
    }
}

/* With bilinear lookups a few are not the best: rows far from the poles are taken for even in solid
   angle while splits are sought, and edges that a float rounds may make a block one piece wider. */
static void test_splits(envsamp_mapping mapping, int bilinear)
{
    static const int sizes[][2] = { { 1, 2 }, { 2, 1 }, { 3, 2 }, { 2, 4 }, { 4, 4 }, { 1, 8 },
                                    { 11, 9 } };
    const double allowed = !bilinear ? 0.0 : mapping == ENVSAMP_OCTAHEDRAL ? 0.01 : 0.1;
    split_tally t = { 0, 0, 0, 1.0 };
    int i, k;

    for (i = 0; i < (int)(sizeof sizes / sizeof sizes[0]) * 24; i++) {
        const int *size = sizes[i / 24];
        pcg32 random = pcg32_make((uint64_t)i, 41);
        float pixels[99];
        envsamp_image map = kd_image(pixels, size[0], size[1], 1);

        map.mapping = mapping;
        for (k = 0; k < 99; k++)
            pixels[k] = 0.1f + 10.0f * powf(pcg32_float(&random), 3.0f);
        judge_splits(&map, bilinear, (envsamp_kd_criterion)(i % 4), &t);
    }
    CHECK(t.splits > 500 && (t.fine > 200) == bilinear, "%s, bilinear %d: %d splits, of which %d "
          "are of polar angle within cells", sampler_mappings[mapping], bilinear, t.splits, t.fine);
    CHECK((double)t.others <= allowed * (double)t.splits, "and %d of them are not the best of all "
          "cuts; the least gains %.5f of what that does", t.others, t.least);
}

/* ---- blocks and densities, exactly ---- */

typedef struct exact {
    double sum, sphere;         /* of probabilities; of solid angles: relative, off from 1 */
    double q, figures;          /* probabilities, excess variance and ratio: off */
    double integral;            /* off, relative */
    int shape, tiles;           /* blocks with bad edges; points not in exactly one block */
    double pdf_off;             /* share of directions with a pdf that is not their block's */
} exact;

static int block_holds(const envsamp_kd_block *b, double u, double v)
{
    return u >= (double)b->uv_min[0] && u < (double)b->uv_max[0]
        && v >= (double)b->uv_min[1] && v < (double)b->uv_max[1];
}

/* Random points lie in one block each, and have its density. */
static void judge_points(const sampler *s, const envsamp_kd_block *blocks, int count, exact *e)
{
    const envsamp_mapping mapping = s->request.image.mapping;
    pcg32 random = pcg32_make(17, 0);
    int i, k, off = 0;

    for (i = 0; i < 2000; i++) {
        const double u = (double)pcg32_float(&random), v = (double)pcg32_float(&random);
        double dir[3], expected = 0.0;
        float rounded[3];
        int holders = 0;

        for (k = 0; k < count; k++)
            if (block_holds(&blocks[k], u, v)) {
                holders++;
                expected = (double)blocks[k].probability / (double)blocks[k].solid_angle;
            }
        e->tiles += holders != 1;
        direction_of(mapping, u, v, dir);
        for (k = 0; k < 3; k++)
            rounded[k] = (float)dir[k];
        off += !(fabs((double)sampler_pdf(s, rounded) - expected) <= 1e-5 * expected);
    }
    e->pdf_off = (double)off / 2000.0;
}

static sums block_sums(const sampler *s, const envsamp_image *left, const envsamp_kd_block *b)
{
    return sums_over(left, s->request.bilinear, (double)b->uv_min[0], (double)b->uv_max[0],
                     (double)b->uv_min[1], (double)b->uv_max[1]);
}

static int block_count(const sampler *s)
{
    envsamp_kd_info info;

    memset(&info, 0, sizeof info);
    envsamp_kd_get_info(s->kd, &info);
    return info.block_count;
}

/* How often blocks are to be drawn: by the root of solid angle times the sum of squares, which
   makes the variance least. WARP: so within a tile, and all tiles alike. FIT: as they say. */
static void wanted_probabilities(const sampler *s, const envsamp_image *importance,
                                 const envsamp_kd_block *blocks, int count, double *wanted)
{
    kd_warp_block *warped = (kd_warp_block *)kd_allocate((size_t)count * sizeof *warped);
    double *tiles = (double *)kd_allocate((size_t)count * sizeof *tiles);
    int tile_count = 1, i;

    if (s->request.kind == SAMPLER_WARP) {
        tile_count = kd_tile_count(s->kd);
        kd_warp_blocks(s->kd, warped, count);       /* else all are of tile 0 */
    }
    for (i = 0; i < count; i++) {
        const sums part = block_sums(s, importance, &blocks[i]);

        wanted[i] = s->request.kind == SAMPLER_FIT ? (double)blocks[i].probability
                                                   : sqrt(part.sr * part.square);
        tiles[warped[i].tile] += wanted[i];
    }
    for (i = 0; i < count; i++)
        wanted[i] /= tiles[warped[i].tile] * (double)tile_count;
    free(warped);
    free(tiles);
}

static void judge_block(const sampler *s, const envsamp_kd_block *b, exact *e)
{
    const double sr = solid_angle(s->request.image.mapping, (double)b->uv_min[0],
                                  (double)b->uv_max[0], (double)b->uv_min[1],
                                  (double)b->uv_max[1]);

    e->shape += !(b->uv_min[0] >= 0.0f && b->uv_min[0] < b->uv_max[0] && b->uv_max[0] <= 1.0f
                  && b->uv_min[1] >= 0.0f && b->uv_min[1] < b->uv_max[1] && b->uv_max[1] <= 1.0f
                  && b->probability >= 0.0f);
    e->shape += !(fabs((double)b->solid_angle - sr) <= 1e-5 * sr + 2e-6);
    e->sum += (double)b->probability;
    e->sphere += (double)b->solid_angle / whole_sphere(s->request.image.mapping);
}

static void judge_blocks(const sampler *s, const envsamp_image *left,
                         const envsamp_image *importance, exact *e)
{
    const sums all = sums_over(left, s->request.bilinear, 0.0, 1.0, 0.0, 1.0);
    const sampler_info info = sampler_get_info(s);
    const int count = block_count(s);
    envsamp_kd_block *blocks = (envsamp_kd_block *)kd_allocate((size_t)count * sizeof *blocks);
    double *wanted = (double *)kd_allocate((size_t)count * sizeof *wanted);
    double second = 0.0, ratio = 0.0;
    int i;

    for (i = 0; i < count; i++) {
        envsamp_kd_get_block(s->kd, i, &blocks[i]);
        judge_block(s, &blocks[i], e);
    }
    e->sum -= 1.0;
    e->sphere -= 1.0;
    wanted_probabilities(s, importance, blocks, count, wanted);
    for (i = 0; i < count; i++) {
        const sums part = block_sums(s, left, &blocks[i]);
        const double p = (double)blocks[i].probability;

        e->q = fmax(e->q, fabs(p - wanted[i]));
        if (p > 0.0) {
            second += part.square * part.sr / p;
            ratio = fmax(ratio, part.max * part.sr / (p * all.light));
        }
    }
    e->figures = fabs(second / all.light / all.light / (1.0 + info.excess_variance) - 1.0);
    e->figures = fmax(e->figures, fabs(ratio / info.max_ratio - 1.0));
    judge_points(s, blocks, count, e);
    free(blocks);
    free(wanted);
}

/* cdf: density in quarters of texels, where radiance is bilinear and density constant. */
static void judge_cells(const sampler *s, const envsamp_image *left,
                        const envsamp_image *importance, exact *e)
{
    const int w = 2 * left->width, h = 2 * left->height, bilinear = s->request.bilinear;
    const sums all = sums_over(left, bilinear, 0.0, 1.0, 0.0, 1.0);
    const sums drawn_by = sums_over(importance, bilinear, 0.0, 1.0, 0.0, 1.0);
    const sampler_info info = sampler_get_info(s);
    double second = 0.0, ratio = 0.0;
    int x, y, k;

    for (y = 0; y < h; y++)
        for (x = 0; x < w; x++) {
            const double u0 = (double)x / (double)w, u1 = (double)(x + 1) / (double)w;
            const double v0 = (double)y / (double)h, v1 = (double)(y + 1) / (double)h;
            const sums part = sums_over(left, bilinear, u0, u1, v0, v1);
            double dir[3], pdf;
            float rounded[3];

            direction_of(left->mapping, 0.5 * (u0 + u1), 0.5 * (v0 + v1), dir);
            for (k = 0; k < 3; k++)
                rounded[k] = (float)dir[k];
            pdf = (double)sampler_pdf(s, rounded);
            e->sum += pdf * part.sr;
            if (!bilinear)
                e->q = fmax(e->q, fabs(pdf - sums_over(importance, bilinear, u0, u1, v0, v1).max
                                             / drawn_by.light) * part.sr);
            e->shape += part.light > 1e-6 * part.sr && !(pdf > 0.0);
            if (pdf > 0.0) {
                second += part.square / pdf;
                ratio = fmax(ratio, part.max / (pdf * all.light));
            }
        }
    e->sum -= 1.0;
    e->figures = fabs(second / all.light / all.light / (1.0 + info.excess_variance) - 1.0);
    e->figures = fmax(e->figures, fabs(ratio / info.max_ratio - 1.0));
}

static void test_exact(const sampler *s)
{
    const sampler_request *r = &s->request;
    const sampler_info info = sampler_get_info(s);
    float in_force;
    envsamp_image left = what_is_left(&r->image, r->bilinear, r->compensation, &in_force);
    envsamp_image importance = importance_of(&left, r->exponent);
    exact e;
    char text[120];

    memset(&e, 0, sizeof e);
    e.integral = sums_over(&r->image, r->bilinear, 0.0, 1.0, 0.0, 1.0).light / info.integral - 1.0;
    if (r->kind == SAMPLER_CDF)
        judge_cells(s, &left, &importance, &e);
    else
        judge_blocks(s, &left, &importance, &e);
    print_request(text, sizeof text, r);
    CHECK(fabs(e.integral) < 2e-7 && info.mis_compensation == in_force
          && info.bilinear == r->bilinear && info.mapping == r->image.mapping
          && info.bad_pixel_count == 0, "%s: integral %.1e off, compensation %g in force", text,
          e.integral, (double)info.mis_compensation);
    CHECK(fabs(e.sum) < 1e-6 && fabs(e.sphere) < 1e-6 && !e.shape && !e.tiles,
          "%s: probabilities %.1e and sphere %.1e off, %d bad edges, %d points untiled", text,
          e.sum, e.sphere, e.shape, e.tiles);
    CHECK(e.q < 1e-6 && e.figures < 5e-5 && e.pdf_off <= 0.001,
          "%s: %.1e off the mass, figures %.1e, pdf of %.1e of the points", text, e.q, e.figures,
          e.pdf_off);
    free_map(&left);
    free_map(&importance);
}

/* ---- samples ---- */

static double angle(const float a[3], const float b[3])
{
    const double x = (double)a[0] - (double)b[0], y = (double)a[1] - (double)b[1];
    const double z = (double)a[2] - (double)b[2];

    return 2.0 * asin(fmin(0.5 * sqrt(x * x + y * y + z * z), 1.0));
}

/* How far points of the map are apart, round the seam, and across the octahedron's edges, where
   two points are one direction. Near a pole, `ring` away from the axis, u does not say much. */
static double apart(envsamp_mapping mapping, const float a[2], const float b[2], double ring)
{
    double du = fabs((double)a[0] - (double)b[0]), dv = fabs((double)a[1] - (double)b[1]), least;
    const double mirror_u = fabs(1.0 - (double)a[0] - (double)b[0]);
    const double mirror_v = fabs(1.0 - (double)a[1] - (double)b[1]);
    const double edge_u = fmin((double)a[0], 1.0 - (double)a[0]);
    const double edge_v = fmin((double)a[1], 1.0 - (double)a[1]);

    if (mapping != ENVSAMP_OCTAHEDRAL)
        return fmax(fmin(du, 1.0 - du) * ring, dv);
    least = fmax(du, dv);
    least = fmin(least, fmax(fmax(du, mirror_v), edge_u));
    least = fmin(least, fmax(fmax(mirror_u, dv), edge_v));
    return fmin(least, fmax(fmax(edge_u, edge_v), fmin(du, mirror_u) + fmin(dv, mirror_v)));
}

typedef struct drawn {
    double length, uv, place;   /* off, at most */
    int count, below, unsound;
    int other, lost;            /* with another pdf, or taken for black; with u that is none */
    double again;               /* inverted and sampled again: off, in units of what is allowed */
} drawn;

/* How far neighbours of (u0, u1) among 24-bit numbers are drawn. */
static double reach(const sampler *s, float u0, float u1, const float dir[3])
{
    const float step = 1.0f / 16777216.0f, most = 1.0f - step;
    double far = 0.0;
    int i;

    for (i = 0; i < 4; i++) {
        const float a = u0 + (i == 0 ? step : i == 1 ? -step : 0.0f);
        const float b = u1 + (i == 2 ? step : i == 3 ? -step : 0.0f);
        const envsamp_sample near = sampler_draw(s, fminf(fmaxf(a, 0.0f), most),
                                                 fminf(fmaxf(b, 0.0f), most));

        far = fmax(far, angle(near.dir, dir));
    }
    return far;
}

static void judge_inverse(const sampler *s, float u0, float u1, const envsamp_sample *sample,
                          drawn *d)
{
    float u[2] = { -1.0f, -1.0f };
    const int found = sampler_invert(s, sample->dir, u);
    envsamp_sample again;

    if (!sampler_inverts(s)) {
        d->lost += found || u[0] != 0.0f || u[1] != 0.0f;
        return;
    }
    d->lost += !(u[0] >= 0.0f && u[0] < 1.0f && u[1] >= 0.0f && u[1] < 1.0f);
    if (!found) {                           /* taken for the black block beside it */
        d->other++;
        return;
    }
    again = sampler_draw(s, u[0], u[1]);
    if (again.pdf == sample->pdf)           /* else across an edge */
        d->again = fmax(d->again, angle(again.dir, sample->dir)
                                  / (1e-6 + reach(s, u0, u1, sample->dir)));
}

static void judge_sample(const sampler *s, float u0, float u1, drawn *d)
{
    const envsamp_mapping mapping = s->request.image.mapping;
    const envsamp_sample sample = sampler_draw(s, u0, u1);
    const double x = (double)sample.dir[0], y = (double)sample.dir[1], z = (double)sample.dir[2];
    const float pdf = sampler_pdf(s, sample.dir);
    double there[3];
    float uv[2];

    d->count++;
    d->length = fmax(d->length, fabs(sqrt(x * x + y * y + z * z) - 1.0));
    d->below += mapping == ENVSAMP_HEMISPHERE && !(z >= 0.0);
    d->unsound += !(sample.pdf > 0.0f && sample.pdf <= FLT_MAX && sample.uv[0] >= 0.0f
                    && sample.uv[0] <= 1.0f && sample.uv[1] >= 0.0f && sample.uv[1] <= 1.0f);
    envsamp_dir_to_uv(mapping, sample.dir, uv);
    d->uv = fmax(d->uv, apart(mapping, uv, sample.uv, sqrt(x * x + y * y)));
    direction_of(mapping, (double)sample.uv[0], (double)sample.uv[1], there);
    d->place = fmax(d->place, fabs(there[0] - x) + fabs(there[1] - y) + fabs(there[2] - z));
    if (!(pdf == sample.pdf))
        d->other++;
    else
        judge_inverse(s, u0, u1, &sample, d);
}

static void test_samples(const sampler *s)
{
    static const float ends[4] = { 0.0f, 0.5f, 5.9604644775390625e-08f, 0.999999940395355224609f };
    pcg32 random = pcg32_make(23, 0);
    drawn d;
    char text[120];
    int i;

    memset(&d, 0, sizeof d);
    for (i = 0; i < 16; i++)
        judge_sample(s, ends[i % 4], ends[i / 4], &d);
    d.other = 0;                            /* these lie on edges, where any pdf will do */
    for (i = 0; i < 4000; i++)
        judge_sample(s, pcg32_float(&random), pcg32_float(&random), &d);
    print_request(text, sizeof text, &s->request);
    CHECK(d.length <= 1e-6 && d.uv <= 1e-6 && d.place <= 3e-6 && !d.below && !d.unsound,
          "%s: length %.1e, uv %.1e, place %.1e off, %d below the horizon, %d unsound", text,
          d.length, d.uv, d.place, d.below, d.unsound);
    CHECK(d.other <= d.count / 2000 && !d.lost && d.again <= 1.0,
          "%s: %d of %d lie across an edge, %d inverted wrongly, the others by %.2f of the bound",
          text, d.other, d.count, d.lost, d.again);
}

/* ---- below the horizon ---- */

static void test_horizon(const sampler *s)
{
    pcg32 random = pcg32_make(29, 0);
    int i, faults = 0;
    char text[120];

    for (i = 0; i < 2000; i++) {
        float dir[3], u[2] = { 1.0f, 1.0f };

        kd_random_direction(&random, dir);
        dir[2] = i < 1000 ? -fabsf(dir[2]) - 1e-6f : i < 1500 ? -1e-6f : -1e-3f;
        faults += sampler_pdf(s, dir) != 0.0f;
        faults += sampler_invert(s, dir, u) || u[0] != 0.0f || u[1] != 0.0f;
    }
    print_request(text, sizeof text, &s->request);
    CHECK(!faults, "%s: nothing below the horizon, %d faults", text, faults);
}

/* ---- batches, copies, damage ---- */

static int same_bits(const sampler *a, const sampler *b, size_t n, pcg32 *random)
{
    float *u = (float *)kd_allocate((2 * n + 1) * sizeof *u);
    float *out = (float *)kd_allocate((4 * n + 1) * sizeof *out);
    float *pdf = (float *)kd_allocate((n + 1) * sizeof *pdf);
    int good = 1;
    size_t i;

    for (i = 0; i < 2 * n; i++)
        u[i] = i == 3 ? NAN : i == 7 ? 1.0f : pcg32_float(random);
    out[4 * n] = pdf[n] = 77.0f;
    sampler_draw_n(b, n, u, out);
    for (i = 0; i < n; i++) {
        const envsamp_sample one = sampler_draw(a, u[i], u[n + i]);

        good &= kd_bits_equal(&one.dir[0], out + i, 4) && kd_bits_equal(&one.dir[1], out + n + i, 4)
             && kd_bits_equal(&one.dir[2], out + 2 * n + i, 4)
             && kd_bits_equal(&one.pdf, out + 3 * n + i, 4);
    }
    for (i = 0; i < n; i += 3) {            /* some other directions, not of unit length */
        float dir[3];

        kd_random_direction(random, dir);
        out[i] = dir[0] * 3.0f;
        out[n + i] = dir[1] * 3.0f;
        out[2 * n + i] = i == 9 ? NAN : dir[2] * 3.0f;
    }
    sampler_pdf_n(b, n, out, pdf);
    for (i = 0; i < n; i++) {
        const float dir[3] = { out[i], out[n + i], out[2 * n + i] };
        const float one = sampler_pdf(a, dir);

        good &= kd_bits_equal(&one, pdf + i, 4);
    }
    good &= out[4 * n] == 77.0f && pdf[n] == 77.0f;
    free(u);
    free(out);
    free(pdf);
    return good;
}

/* A field of a table damaged: mapping, bilinear and compensation. Returns what opens all the
   same. */
static int opens_damaged(const sampler *s, kd_guarded *copy)
{
    static const uint32_t wrong[] = { 0, 1, 2, 3, 255, 0xffffffffu, 0x3f000000u, 0x3f800000u,
                                      0xbf800000u, 0x7fc00000u, 0x7f800000u, 0x40000000u };
    const size_t kd_at[] = { KD_AT(mapping), KD_AT(bilinear),
                             KD_AT(mis_compensation) };
    const size_t cdf_at[] = { CDF_AT(mapping), CDF_AT(bilinear),
                              CDF_AT(mis_compensation) };
    unsigned char *bytes = (unsigned char *)copy->buffer.data;
    int i, k, opened = 0;

    for (k = 0; k < 3; k++)
        for (i = 0; i < 12; i++) {
            const size_t at = s->request.kind == SAMPLER_CDF ? cdf_at[k] : kd_at[k];
            uint32_t kept;
            sampler other = *s;

            memcpy(&kept, bytes + at, sizeof kept);
            memcpy(bytes + at, &wrong[i], sizeof kept);
            if (kept != wrong[i])
                opened += sampler_open(&other, bytes, copy->buffer.bytes) != ENVSAMP_ERR_FORMAT
                       || sampler_data(&other);
            memcpy(bytes + at, &kept, sizeof kept);
        }
    return opened;
}

static void test_copies(const sampler *s)
{
    static const size_t counts[] = { 0, 1, 63, 64, 65, 1000 };
    const sampler_info info = sampler_get_info(s);
    kd_guarded copy = kd_guarded_make(sampler_bytes(s), 0);
    pcg32 random = pcg32_make(41, 0);
    sampler other = *s;
    int i, good, damaged;
    sampler_info again;
    char text[120];

    memcpy(copy.buffer.data, sampler_data(s), copy.buffer.bytes);
    good = sampler_open(&other, copy.buffer.data, copy.buffer.bytes) == ENVSAMP_OK;
    print_request(text, sizeof text, &s->request);
    if (!good) {
        CHECK(0, "%s: a copy does not open", text);
        free(copy.block);
        return;
    }
    again = sampler_get_info(&other);
    good &= again.mis_compensation == info.mis_compensation && again.mapping == info.mapping
         && again.bilinear == info.bilinear && kd_bits_equal(&again.integral, &info.integral, 8);
    for (i = 0; i < 6; i++)
        good &= same_bits(s, s, counts[i], &random) && same_bits(s, &other, counts[i], &random);
    damaged = opens_damaged(s, &copy);
    CHECK(good && !damaged, "%s: batches and a copy give the same bits, %d damaged copies open",
          text, damaged);
    free(copy.block);
}

static void test_maps(int width, int height, int blocks)
{
    static const float exponents[] = { 0.0f, 0.0f, 0.5f, 1.5f };
    int i, with;

    for (i = 0; i < SAMPLER_KINDS * 3 * 2; i++)
        for (with = 0; with < 4; with++) {
            envsamp_image map = make_map(width, height,
                                         (envsamp_mapping)(i / SAMPLER_KINDS % 3));
            sampler_request request = sampler_ask(i % SAMPLER_KINDS, &map, blocks);
            sampler s;

            request.bilinear = i / SAMPLER_KINDS / 3;
            request.compensation = with % 2 ? 0.8f : 0.0f;
            request.exponent = exponents[with];
            if (sampler_make(&s, &request)) {
                test_exact(&s);
                test_samples(&s);
                test_copies(&s);
                if (map.mapping == ENVSAMP_HEMISPHERE)
                    test_horizon(&s);
            } else {
                CHECK(0, "%s: %d by %d: %s", sampler_names[request.kind], width, height,
                      envsamp_result_string(s.result));
            }
            sampler_free(&s);
            free_map(&map);
        }
}

/* ---- how often texels are drawn ---- */

#define DRAWS 400000

typedef enum fault {
    SOUND = 0,
    NO_SINE,            /* the table is of luminance, without solid angle */
    HALF_TEXEL,         /* samples are half a texel off in u */
    SWAPPED,            /* u and v change places */
    NO_FOLD,            /* an octahedral map sampled as if it were lat-long */
    BAD_FOLD            /* p and q do not change places below the equator */
} fault;

static const char *const fault_names[] = {
    "sound", "no sine", "half a texel off", "u and v swapped", "octahedral taken for lat-long",
    "folded wrongly"
};

/* Masses of texels, by luminance times solid angle; of ALIAS, whose blocks are texels, too. Where
   blocks are larger, a block's mass is spread over it. */
static double *texel_masses(const sampler *s, const envsamp_image *map)
{
    const int w = map->width, h = map->height, by_texel = s->request.kind == SAMPLER_CDF
                                                       || s->request.kind == SAMPLER_ALIAS;
    const int count = by_texel ? w * h : block_count(s);
    double *masses = (double *)kd_allocate((size_t)(w * h) * sizeof *masses);
    double *wanted = (double *)kd_allocate((size_t)count * sizeof *wanted);
    envsamp_kd_block *blocks = (envsamp_kd_block *)kd_allocate((size_t)count * sizeof *blocks);
    int i, k;

    for (i = 0; !by_texel && i < count; i++)
        envsamp_kd_get_block(s->kd, i, &blocks[i]);
    if (!by_texel)
        wanted_probabilities(s, map, blocks, count, wanted);
    for (i = 0; i < w * h; i++) {
        const double u0 = (double)(i % w) / (double)w, u1 = (double)(i % w + 1) / (double)w;
        const double v0 = (double)(i / w) / (double)h, v1 = (double)(i / w + 1) / (double)h;

        if (by_texel)
            masses[i] = (double)map->pixels[i] * solid_angle(map->mapping, u0, u1, v0, v1);
        for (k = 0; !by_texel && k < count; k++) {
            const double x0 = fmax(u0, snapped((double)blocks[k].uv_min[0], (double)w));
            const double x1 = fmin(u1, snapped((double)blocks[k].uv_max[0], (double)w));
            const double y0 = fmax(v0, snapped((double)blocks[k].uv_min[1], (double)h));
            const double y1 = fmin(v1, snapped((double)blocks[k].uv_max[1], (double)h));

            if (x0 < x1 && y0 < y1)
                masses[i] += wanted[k] * solid_angle(map->mapping, x0, x1, y0, y1)
                           / (double)blocks[k].solid_angle;
        }
    }
    free(wanted);
    free(blocks);
    return masses;
}

static int texel_at(const envsamp_image *map, double u, double v)
{
    const int x = (int)(u * (double)map->width), y = (int)(v * (double)map->height);

    return (y < map->height ? y : map->height - 1) * map->width
         + (x < map->width ? x : map->width - 1);
}

/* A direction, rounded to floats, may lie across the edge of its texel: a black one is not hit
   where a lit one is within 2e-7. */
static int across_edge(const envsamp_image *map, double u, double v)
{
    int texel = texel_at(map, u, v), i;

    for (i = 0; i < 4 && !(map->pixels[texel] > 0.0f); i++)
        texel = texel_at(map, fmax(u + (i == 0 ? 2e-7 : i == 1 ? -2e-7 : 0.0), 0.0),
                         fmax(v + (i == 2 ? 2e-7 : i == 3 ? -2e-7 : 0.0), 0.0));
    return texel;
}

/* The texel of a direction, by a sampler's fault elsewhere. */
static int hit_texel(const envsamp_image *map, const float dir[3], fault wrong)
{
    double u, v, kept;

    point_of(map->mapping, dir, &u, &v);
    if (wrong == HALF_TEXEL)
        u = wrap_turn(u + 0.5 / (double)map->width);
    if (wrong == SWAPPED) {
        kept = u;
        u = v;
        v = kept;
    }
    if (wrong == BAD_FOLD && dir[2] < 0.0f) {
        kept = fabs(2.0 * u - 1.0);
        u = 0.5 * (1.0 + copysign(fabs(2.0 * v - 1.0), u - 0.5));
        v = 0.5 * (1.0 + copysign(kept, v - 0.5));
    }
    return wrong ? texel_at(map, u, v) : across_edge(map, u, v);
}

/* The map that the table is made of: without solid angle where the sine is dropped. */
static envsamp_image table_map(const envsamp_image *map, fault wrong)
{
    const int w = map->width, h = map->height;
    float *pixels = (float *)kd_allocate((size_t)(w * h) * sizeof *pixels);
    envsamp_image other = *map;
    int i;

    for (i = 0; i < w * h; i++) {
        const double v0 = (double)(i / w) / (double)h, v1 = (double)(i / w + 1) / (double)h;

        pixels[i] = map->pixels[i];
        if (wrong == NO_SINE)
            pixels[i] /= (float)solid_angle(map->mapping, 0.0, 1.0, v0, v1);
    }
    other.pixels = pixels;
    if (wrong == NO_FOLD)
        other.mapping = ENVSAMP_LATLONG;
    return other;
}

static void test_hits(int kind, envsamp_mapping mapping, fault wrong)
{
    const int height = mapping == ENVSAMP_OCTAHEDRAL ? 24 : 16;
    envsamp_image map = make_noise(24, height, mapping, !wrong);    /* a control that hits black */
    envsamp_image other = table_map(&map, wrong);                   /* texels were no test of p */
    const sampler_request request = sampler_ask(kind, &other, 24 * height);
    double *hits = (double *)kd_allocate((size_t)(24 * height) * sizeof *hits), *masses;
    pcg32 random = pcg32_make(61, (uint64_t)kind);
    stat_result result;
    sampler s;
    int i;

    sampler_make(&s, &request);
    for (i = 0; i < DRAWS; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);

        hits[hit_texel(&map, sampler_draw(&s, u0, u1).dir, wrong)] += 1.0;
    }
    masses = texel_masses(&s, &map);    /* of the map, whatever the table is of */
    result = stat_chi2_test(masses, hits, (size_t)(24 * height), NULL);
    if (wrong)
        CHECK(result.verdict == STAT_REJECTED, "control: %s, %s, %s: %s",
              sampler_names[kind], sampler_mappings[mapping], fault_names[wrong],
              stat_verdict_string(result.verdict));
    else
        CHECK(result.pass, "%s, %s: %lu cells, %s, p = %.2g", sampler_names[kind],
              sampler_mappings[mapping], (unsigned long)result.cells,
              stat_verdict_string(result.verdict), result.p);
    sampler_free(&s);
    free_map(&map);
    free_map(&other);
    free(hits);
    free(masses);
}

static void test_all_hits(void)
{
    const int controlled[] = { SAMPLER_ALIAS, SAMPLER_CDF };
    int mapping, i;

    for (mapping = 0; mapping < 3; mapping++) {
        for (i = 0; i < SAMPLER_KINDS; i++)
            test_hits(i, (envsamp_mapping)mapping, SOUND);
        for (i = 0; i < 2; i++) {
            if (mapping != ENVSAMP_OCTAHEDRAL)
                test_hits(controlled[i], (envsamp_mapping)mapping, NO_SINE);
            test_hits(controlled[i], (envsamp_mapping)mapping, HALF_TEXEL);
            test_hits(controlled[i], (envsamp_mapping)mapping, SWAPPED);
        }
    }
    for (i = 0; i < 2; i++) {
        test_hits(controlled[i], ENVSAMP_OCTAHEDRAL, NO_FOLD);
        test_hits(controlled[i], ENVSAMP_OCTAHEDRAL, BAD_FOLD);
    }
}

/* ---- MIS compensation ---- */

/* Density is zero in texels that are dimmer than what is subtracted, and in the others in
   proportion to what is left: of blocks or cells that are texels. */
static void test_dim_texels(int kind, envsamp_mapping mapping, float amount)
{
    envsamp_image map = make_map(24, 16, mapping);
    sampler_request request = sampler_ask(kind, &map, 24 * 16);
    int i, k, lit = 0, dark = 0, unknown = 0;
    double off = 0.0, total;
    envsamp_image left;
    float in_force;
    sampler s;

    request.compensation = amount;
    sampler_make(&s, &request);
    left = what_is_left(&map, 0, amount, &in_force);
    total = sums_over(&left, 0, 0.0, 1.0, 0.0, 1.0).light;
    for (i = 0; i < 24 * 16; i++) {
        const double u = ((double)(i % 24) + 0.5) / 24.0, v = ((double)(i / 24) + 0.5) / 16.0;
        const double sr = solid_angle(mapping, (double)(i % 24) / 24.0,
                                      (double)(i % 24 + 1) / 24.0, (double)(i / 24) / 16.0,
                                      (double)(i / 24 + 1) / 16.0);
        double dir[3], pdf;
        float rounded[3];

        direction_of(mapping, u, v, dir);
        for (k = 0; k < 3; k++)
            rounded[k] = (float)dir[k];
        pdf = (double)sampler_pdf(&s, rounded);
        lit += left.pixels[i] > 1e-4f && !(pdf > 0.0);
        dark += left.pixels[i] <= 0.0f && pdf != 0.0;
        unknown += left.pixels[i] > 0.0f && left.pixels[i] <= 1e-4f;
        off += 0.5 * fabs(pdf * sr - (double)left.pixels[i] / total * sr);
    }
    CHECK(in_force == amount && sampler_get_info(&s).mis_compensation == amount && !lit && !dark
          && unknown < 4 && off < 2e-5, "%s, %s, compensation %g: %d texels wrongly dark, %d "
          "wrongly lit, %.1e of the mass off", sampler_names[kind], sampler_mappings[mapping],
          (double)amount, lit, dark, off);
    sampler_free(&s);
    free_map(&left);
    free_map(&map);
}

/* With an amount of 0, as without; an amount too small to matter is remembered. */
static void test_no_compensation(int kind, envsamp_mapping mapping)
{
    envsamp_image map = make_map(20, 12, mapping);
    envsamp_kd_desc kd = envsamp_kd_defaults();
    envsamp_cdf_desc cdf = envsamp_cdf_defaults();
    sampler_request request = sampler_ask(kind, &map, kd.block_count);
    sampler with, without;

    request.bilinear = 1;
    request.compensation = 0.0f;
    sampler_make(&with, &request);
    kd.select = (envsamp_kd_select)kind;
    sampler_prepare(&without, &request, 1);
    if (kind == SAMPLER_CDF)
        envsamp_cdf_build(&map, &cdf, without.table.buffer, without.scratch.buffer, &without.cdf);
    else
        envsamp_kd_build(&map, &kd, without.table.buffer, without.scratch.buffer, &without.kd);
    CHECK(sampler_equal(&with, &without) && sampler_get_info(&with).mis_compensation == 0.0f,
          "%s, %s: compensation 0 is none", sampler_names[kind], sampler_mappings[mapping]);
    sampler_free(&with);
    request.compensation = 1e-6f;
    sampler_make(&with, &request);
    CHECK(!sampler_equal(&with, &without) && sampler_get_info(&with).mis_compensation == 1e-6f,
          "%s, %s: compensation 1e-6 is some", sampler_names[kind], sampler_mappings[mapping]);
    sampler_free(&with);
    sampler_free(&without);
    free_map(&map);
}

/* Of a constant map nothing would be left, or only rounding: it is sampled as it is. */
static void test_constant(int kind, envsamp_mapping mapping, float amount, float value)
{
    envsamp_image map = make_map(24, 16, mapping);
    float *pixels = (float *)kd_allocate(24 * 16 * sizeof *pixels);
    const double whole = whole_sphere(mapping);
    pcg32 random = pcg32_make(3, 0);
    sampler_request request;
    int i, faults = 0, bilinear;
    sampler s;

    for (i = 0; i < 24 * 16; i++)
        pixels[i] = value * (i % 3 ? 1.0f : 1.0f + 1e-6f);
    free_map(&map);
    map.pixels = pixels;
    for (bilinear = 0; bilinear < 2; bilinear++) {
        request = sampler_ask(kind, &map, 50);
        request.bilinear = bilinear;
        request.compensation = amount;
        if (!sampler_make(&s, &request)) {
            faults++;
            sampler_free(&s);
            continue;
        }
        faults += sampler_get_info(&s).mis_compensation != (amount < 0.9f ? amount : 0.0f);
        faults += !(fabs(sampler_get_info(&s).integral / ((double)value * whole) - 1.0) < 2e-6);
        for (i = 0; i < 2000; i++) {
            const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
            const envsamp_sample sample = sampler_draw(&s, u0, u1);

            faults += kind != SAMPLER_FIT && !(fabs((double)sample.pdf * whole - 1.0) < 1e-4);
            faults += !(sample.pdf > 0.0f && sampler_pdf(&s, sample.dir) > 0.0f);
        }
        sampler_free(&s);
    }
    CHECK(!faults, "%s, %s: a map of %g with compensation %g, %d faults", sampler_names[kind],
          sampler_mappings[mapping], (double)value, (double)amount, faults);
    free_map(&map);
}

/* ---- exponents of importance ---- */

/* An exponent of 1 is none; one next to it is not. */
static void test_no_exponent(int kind, envsamp_mapping mapping)
{
    envsamp_image map = make_map(20, 12, mapping);
    sampler_request request = sampler_ask(kind, &map, 100);
    sampler with, without;

    sampler_make(&without, &request);
    request.exponent = 1.0f;
    sampler_make(&with, &request);
    CHECK(sampler_equal(&with, &without), "%s, %s: an exponent of 1 is none", sampler_names[kind],
          sampler_mappings[mapping]);
    sampler_free(&with);
    request.exponent = 1.01f;
    sampler_make(&with, &request);
    CHECK(!sampler_equal(&with, &without), "%s, %s: rejected: 1.01 is some", sampler_names[kind],
          sampler_mappings[mapping]);
    sampler_free(&with);
    sampler_free(&without);
    free_map(&map);
}

/* What is lit is drawn, however dim beside the brightest. */
static void test_dimmest(int kind, envsamp_mapping mapping, float exponent, float brightest)
{
    const float values[] = { 0.0f, 1e-45f, 1e-38f, 1e-30f, 1e-10f, 1.0f };
    const int width = 24, height = 16;
    float *pixels = (float *)kd_allocate((size_t)(width * height) * sizeof *pixels);
    envsamp_image map = kd_image(pixels, width, height, 1);
    int i, k, unlit = 0, bilinear;

    for (i = 0; i < width * height; i++)
        pixels[i] = i == 200 ? brightest : values[i % 6];
    map.mapping = mapping;
    for (bilinear = 0; bilinear < 2; bilinear++) {
        sampler_request request = sampler_ask(kind, &map, width * height);
        sampler s;

        request.exponent = exponent;
        request.bilinear = bilinear;
        unlit += !sampler_make(&s, &request) || !sampler_opens(&s);
        for (i = 0; i < width * height && s.result == ENVSAMP_OK; i++) {
            double dir[3];
            float rounded[3];

            direction_of(mapping, ((double)(i % width) + 0.5) / (double)width,
                         ((double)(i / width) + 0.5) / (double)height, dir);
            for (k = 0; k < 3; k++)
                rounded[k] = (float)dir[k];
            unlit += pixels[i] > 0.0f && !(sampler_pdf(&s, rounded) > 0.0f);
        }
        sampler_free(&s);
    }
    CHECK(!unlit, "%s, %s, exponent %g beside %g: %d lit texels have no density",
          sampler_names[kind], sampler_mappings[mapping], (double)exponent, (double)brightest,
          unlit);
    free_map(&map);
}

/* A map 2^40 times as bright is drawn alike. */
static void test_brighter(int kind, envsamp_mapping mapping, float exponent)
{
    envsamp_image map = make_map(24, 16, mapping), bright = map;
    float *pixels = (float *)kd_allocate(24 * 16 * sizeof *pixels);
    sampler_request request = sampler_ask(kind, &map, 90);
    pcg32 random = pcg32_make(37, 0);
    int i, faults = 0;
    sampler s, t;

    for (i = 0; i < 24 * 16; i++)
        pixels[i] = 1099511627776.0f * map.pixels[i];
    bright.pixels = pixels;
    request.exponent = exponent;
    request.compensation = 0.3f;
    sampler_make(&s, &request);
    request.image = bright;
    sampler_make(&t, &request);
    for (i = 0; i < 1000; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample a = sampler_draw(&s, u0, u1), b = sampler_draw(&t, u0, u1);

        faults += !(kd_bits_equal(a.dir, b.dir, sizeof a.dir)
                    && kd_bits_equal(&a.pdf, &b.pdf, sizeof a.pdf));
    }
    CHECK(!faults, "%s, %s, exponent %g: %d of 1000 samples differ in a map 2^40 times as bright",
          sampler_names[kind], sampler_mappings[mapping], (double)exponent, faults);
    sampler_free(&s);
    sampler_free(&t);
    free_map(&map);
    free_map(&bright);
}

static void test_exponents(int kind, envsamp_mapping mapping)
{
    test_no_exponent(kind, mapping);
    test_dimmest(kind, mapping, 2.0f, 1e30f);
    test_dimmest(kind, mapping, 2.0f, FLT_MAX);
    test_dimmest(kind, mapping, 0.5f, 1.0f);
    test_brighter(kind, mapping, 2.0f);
    test_brighter(kind, mapping, 0.7f);
}

/* ---- MIS compensation: irradiance ---- */

/* A dim sky, a dimmer ground, and a sun of one texel that gives as much light as the sky. */
static envsamp_image sun_map(envsamp_mapping mapping)
{
    const int height = mapping == ENVSAMP_OCTAHEDRAL ? 24 : 16;
    envsamp_image map = make_map(24, height, mapping);
    float *pixels = (float *)kd_allocate((size_t)(24 * height) * sizeof *pixels);
    double dir[3];
    int i, sun;

    for (i = 0; i < 24 * height; i++) {
        direction_of(mapping, ((double)(i % 24) + 0.5) / 24.0,
                     ((double)(i / 24) + 0.5) / (double)height, dir);
        pixels[i] = (dir[2] > 0.0 ? 0.5f : 0.2f) + 0.02f * map.pixels[i];
    }
    sun = mapping == ENVSAMP_OCTAHEDRAL ? 8 * 24 + 8 : mapping == ENVSAMP_LATLONG ? 4 * 24 + 5
                                                                                : 8 * 24 + 5;
    pixels[sun] = 80.0f;
    free_map(&map);
    map.pixels = pixels;
    return map;
}

/* Of irradiance from above: the value, and the variance of a sample of the map plus one of the
   cosine, each weighted by the power heuristic; by sums over 12 by 12 points of each texel. */
typedef struct irradiance { double value, variance, alone; } irradiance;

static irradiance integrate_irradiance(const sampler *s, const envsamp_image *map)
{
    const int w = 12 * map->width, h = 12 * map->height;
    double map_mean = 0.0, map_square = 0.0, cosine_mean = 0.0, cosine_square = 0.0;
    irradiance sum = { 0.0, 0.0, 0.0 };
    int x, y, k;

    for (y = 0; y < h; y++)
        for (x = 0; x < w; x++) {
            const double u = ((double)x + 0.5) / (double)w, v = ((double)y + 0.5) / (double)h;
            double sr = solid_angle(map->mapping, 0.0, 1.0 / (double)w, (double)y / (double)h,
                                    (double)(y + 1) / (double)h);
            double dir[3], f, pc, pm, wm;
            float rounded[3];

            direction_of(map->mapping, u, v, dir);
            if (dir[2] <= 0.0)
                continue;
            for (k = 0; k < 3; k++)
                rounded[k] = (float)dir[k];
            f = radiance(map, 0, u, v) * dir[2];
            pc = dir[2] / KD_PI;
            pm = (double)sampler_pdf(s, rounded);
            wm = pm * pm / (pm * pm + pc * pc);
            sum.value += sr * f;
            map_mean += sr * f * wm;
            map_square += pm > 0.0 ? sr * f * wm * f * wm / pm : 0.0;
            cosine_mean += sr * f * (1.0 - wm);
            cosine_square += sr * f * (1.0 - wm) * f * (1.0 - wm) / pc;
            sum.alone += pm > 0.0 ? sr * f : 0.0;
        }
    sum.variance = map_square - map_mean * map_mean + cosine_square - cosine_mean * cosine_mean;
    return sum;
}

/* Light that arrives from a direction, times the cosine. */
static double arriving(const envsamp_image *map, const float dir[3])
{
    double u, v;

    if (!(dir[2] > 0.0f))
        return 0.0;
    point_of(map->mapping, dir, &u, &v);
    return radiance(map, 0, u, fmin(v, 1.0)) * (double)dir[2];
}

/* Estimates of irradiance: in MIS, and by the map's samples alone. */
static void estimate(const sampler *s, const envsamp_image *map, stat_moments *mis,
                     stat_moments *alone)
{
    pcg32 random = pcg32_make(83, (uint64_t)s->request.kind);
    int i;

    memset(mis, 0, sizeof *mis);
    memset(alone, 0, sizeof *alone);
    for (i = 0; i < DRAWS; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample a = sampler_draw(s, u0, u1);
        const double r = sqrt((double)pcg32_float(&random));
        const double phi = 2.0 * KD_PI * (double)pcg32_float(&random);
        const double by_map = arriving(map, a.dir) / (double)a.pdf;
        const float pc = (float)(fmax((double)a.dir[2], 0.0) / KD_PI);
        float b[3], pb;
        double sum;

        b[0] = (float)(r * cos(phi));
        b[1] = (float)(r * sin(phi));
        b[2] = (float)sqrt(1.0 - r * r);
        pb = (float)((double)b[2] / KD_PI);
        sum = by_map * (double)envsamp_mis_power(a.pdf, pc);
        if (pb > 0.0f)
            sum += arriving(map, b) / (double)pb
                 * (double)envsamp_mis_power(pb, sampler_pdf(s, b));
        stat_moments_add(mis, sum);
        stat_moments_add(alone, by_map);
    }
}

static void test_irradiance(int kind, envsamp_mapping mapping)
{
    envsamp_image map = sun_map(mapping);
    sampler_request request = sampler_ask(kind, &map, 200);
    stat_moments mis[2], alone[2];
    irradiance truth[2];
    sampler s;
    int i;

    for (i = 0; i < 2; i++) {
        double forgiven, measured;

        request.compensation = (float)i;
        sampler_make(&s, &request);
        truth[i] = integrate_irradiance(&s, &map);
        estimate(&s, &map, &mis[i], &alone[i]);
        forgiven = 1e-4 * truth[i].value;
        measured = stat_moments_variance(&mis[i]) / truth[i].variance;
        CHECK(stat_mean_test(&mis[i], truth[i].value, forgiven) > STAT_ALPHA,
              "%s, %s, compensation %d: irradiance %.5f by MIS, %.5f by sums",
              sampler_names[kind], sampler_mappings[mapping], i, mis[i].mean, truth[i].value);
        CHECK(measured > 0.95 && measured < 1.05, "%s, %s, compensation %d: variance is %.3f of "
              "that by sums", sampler_names[kind], sampler_mappings[mapping], i, measured);
        sampler_free(&s);
    }
    CHECK(truth[1].variance < 0.2 * truth[0].variance,
          "%s, %s: compensation lowers the variance to %.3f", sampler_names[kind],
          sampler_mappings[mapping], truth[1].variance / truth[0].variance);
    CHECK(stat_mean_test(&alone[0], truth[0].value, 1e-4 * truth[0].value) > STAT_ALPHA,
          "%s, %s: alone, without compensation, there is no bias: %.5f", sampler_names[kind],
          sampler_mappings[mapping], alone[0].mean);
    CHECK(stat_mean_test(&alone[1], truth[1].value, 1e-4 * truth[1].value) < STAT_ALPHA,
          "control: %s, %s: alone, with compensation, there is: %.5f", sampler_names[kind],
          sampler_mappings[mapping], alone[1].mean);
    CHECK(stat_mean_test(&alone[1], truth[1].alone, 0.02 * truth[1].value) > STAT_ALPHA,
          "%s, %s: what is missed is what has no density: %.5f", sampler_names[kind],
          sampler_mappings[mapping], truth[1].alone);
    free_map(&map);
}

static void test_compensation(void)
{
    int kind, mapping;

    for (mapping = 0; mapping < 3; mapping++) {
        const envsamp_mapping m = (envsamp_mapping)mapping;

        test_dim_texels(SAMPLER_ALIAS, m, 0.5f);
        test_dim_texels(SAMPLER_ALIAS, m, 1.0f);
        test_dim_texels(SAMPLER_CDF, m, 0.25f);
        test_dim_texels(SAMPLER_CDF, m, 1.0f);
        for (kind = 0; kind < SAMPLER_KINDS; kind++) {
            test_exponents(kind, m);
            test_no_compensation(kind, m);
            test_constant(kind, m, 1.0f, 1.0f);
            test_constant(kind, m, 1.0f, 3.7e-5f);
            test_constant(kind, m, 0.5f, 0.7f);
            test_irradiance(kind, m);
        }
    }
}

int main(void)
{
    int mapping;

    for (mapping = 0; mapping < 3; mapping++) {
        test_splits((envsamp_mapping)mapping, 0);
        test_splits((envsamp_mapping)mapping, 1);
    }
    test_maps(1, 1, 64);
    test_maps(1, 7, 64);
    test_maps(9, 1, 64);
    test_maps(2, 1, 64);
    test_maps(3, 5, 64);
    test_maps(32, 16, 300);
    test_maps(64, 64, 300);
    test_all_hits();
    test_compensation();
    return check_done();
}
