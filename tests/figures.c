/* figures.c: what kd tables cost in variance, map by map, beside brute-force minima of the fits.
 *
 *     figures [POINTS]   prints tables on stdout, progress on stderr; takes a few minutes.
 *                        POINTS: how many a map WARP is inverted at, default 1000000
 *
 * Reads the real maps that `make data` fetches, or, where one is missing, takes made-up maps.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "../examples/common/random.h"
#include "sampler.h"
#include "kd_reference.h"
#include "../bench/map_set.h"
#include "../bench/warp_walk.h"

#define BLOCKS 6144
#define SIZES 4                 /* block counts at which L1 is compared with a scan */

static const int sizes[SIZES] = { 16, 256, 6144, 65536 };

enum {
    SSE = 0, VARIANCE, RANGE, EXCESS,               /* excess variance of ALIAS */
    LOG_L1, LOG_CHI2, POWER_L1, POWER_CHI2,         /* and of FIT */
    ALPHA, BETA, L1,                                /* LOG L1; beta of POWER CHI2 */
    RATIO, RATIO_FIT,                               /* largest L / (pdf integral) */
    DRAWN, DRAWN_FIT,                               /* total variation over all u0 */
    LEAST, GAP = LEAST + SIZES,                     /* least L1 of a scan; worst gap above it */
    FEW, DEFAULT, MANY,                             /* excess variance of WARP by blocks */
    RATIO_WARP, CUTS, DEEPEST,
    ACROSS, DOWN, CROSSED, BACK, BACK_ANY,          /* see fill_inverse */
    BILINEAR,                                       /* see fill_bilinear: three for each sampler */
    NEAREST = BILINEAR + 9, COLUMNS = NEAREST + 2
};

static const char *const headings[COLUMNS] = {
    "SSE", "VARIANCE", "RANGE", "EXCESS", "LOG L1", "LOG CHI2", "POW L1", "POW CHI2",
    "alpha", "beta", "l1", "ratio", "fit ratio", "drawn", "fit drawn",
    "l1 16", "l1 256", "l1 6144", "l1 65536", "worst gap",
    "1024", "6144", "16384", "ratio", "cuts", "deepest", "u0", "u1", "crossed", "back", "back any",
    "WARP", "z", "excess", "ALIAS", "z", "excess", "cdf", "z", "excess", "nearest", "bias"
};

typedef struct row { double value[COLUMNS]; } row;

static void fill_alias(const image *map, row *out)
{
    int criterion;

    for (criterion = 0; criterion < 4; criterion++) {
        envsamp_kd_desc desc = kd_desc(BLOCKS, ENVSAMP_KD_ALIAS);
        reference r;

        desc.criterion = (envsamp_kd_criterion)criterion;
        if (reference_build(&r, map, &desc))
            out->value[SSE + criterion] = r.f.info.excess_variance;
        if (r.f.kd && criterion == ENVSAMP_KD_EXCESS) {
            out->value[RATIO] = r.f.info.max_ratio;
            out->value[DRAWN] = reference_realised(&r);
        }
        reference_free(&r);
    }
}

static void fill_published(const reference *r, row *out)
{
    out->value[ALPHA] = r->f.info.alpha;
    out->value[L1] = r->f.info.l1;
    out->value[RATIO_FIT] = r->f.info.max_ratio;
    out->value[DRAWN_FIT] = reference_realised(r);
}

static void fill_fits(const image *map, row *out)
{
    int i;

    for (i = 0; i < 4; i++) {
        envsamp_kd_desc desc = kd_desc(BLOCKS, ENVSAMP_KD_FIT);
        reference r;

        desc.model = i / 2 ? ENVSAMP_KD_POWER : ENVSAMP_KD_LOG;
        desc.objective = i % 2 ? ENVSAMP_KD_CHI2 : ENVSAMP_KD_L1;
        if (reference_build(&r, map, &desc)) {
            out->value[LOG_L1 + i] = r.f.info.excess_variance;
            out->value[BETA] = r.f.info.beta;
            if (i == 0)
                fill_published(&r, out);
        }
        reference_free(&r);
    }
}

/* The LOG fit of L1 against a scan, at every block count. */
static void fill_gaps(const image *map, row *out)
{
    int i;

    out->value[GAP] = -1.0;
    for (i = 0; i < SIZES; i++) {
        const envsamp_kd_desc desc = kd_desc(sizes[i], ENVSAMP_KD_FIT);
        reference_target t;
        reference r;

        if (reference_build(&r, map, &desc)) {
            t = reference_target_of(&r, ENVSAMP_KD_L1);
            out->value[LEAST + i] = reference_minimum(&t, 1.0, REFERENCE_LOG2_ALPHA_MIN,
                                                      sizes[i] > BLOCKS ? 1.0 / 16 : 1.0 / 64);
            out->value[GAP] = fmax(out->value[GAP],
                                   r.f.info.l1 / out->value[LEAST + i] - 1.0);
            free(t.share);
        }
        reference_free(&r);
    }
}

/* ---- WARP: invert undoes sample ---- */

/* What the inverses of one map come to: the worst of each, and how many were counted. */
typedef struct inverse {
    double error[2];            /* |invert(sample(u)) - u|, see error_unit */
    double angle, angle_any;    /* of sample(invert(dir)) and dir: a sample's, any */
    int crossed;
} inverse;

static double angle_between(const float a[3], const float b[3])
{
    const double x = (double)a[1] * (double)b[2] - (double)a[2] * (double)b[1];
    const double y = (double)a[2] * (double)b[0] - (double)a[0] * (double)b[2];
    const double z = (double)a[0] * (double)b[1] - (double)a[1] * (double)b[0];

    return atan2(sqrt(x * x + y * y + z * z), (double)a[0] * (double)b[0]
                 + (double)a[1] * (double)b[1] + (double)a[2] * (double)b[2]);
}

/* v of an edge, as a table stores it. */
static double edge_v(float edge)
{
    const double v = 2.0 * asin(sqrt(0.5 * fabs((double)edge))) / KD_PI;

    return signbit(edge) ? 1.0 - v : v;
}

/* What half a unit in the last place of the map means in u: 2^-24, times how much longer the block
   is in the unit square than in the map, if it is. */
static void error_unit(const envsamp_kd *kd, const warp_leaf *leaf, double unit[2])
{
    const double across = ((double)leaf->cut[1] - (double)leaf->cut[0])
                        / (double)(1 << kd->tile_bits_x);
    const double down = ((double)leaf->cut[3] - (double)leaf->cut[2])
                      / (double)(1 << kd->tile_bits_y);

    unit[0] = fmax(across / ((double)leaf->edge[1] - (double)leaf->edge[0]), 1.0) / 16777216.0;
    unit[1] = fmax(down / (edge_v(leaf->edge[3]) - edge_v(leaf->edge[2])), 1.0) / 16777216.0;
}

/* A direction that rounds across the edge of its block comes back from the next one, where the
   numbers may be others: it is counted, and its error is not. */
static void add_sampled(const envsamp_kd *kd, const float u[2], inverse *out)
{
    const warp_leaf leaf = warp_locate(kd, u);
    const envsamp_sample s = envsamp_kd_sample(kd, u[0], u[1]);
    warp_leaf found;
    double unit[2];
    float back[2];
    int k;

    if (!envsamp_kd_invert(kd, s.dir, back)) {
        out->crossed++;
        return;
    }
    out->angle = fmax(out->angle,
                      angle_between(s.dir, envsamp_kd_sample(kd, back[0], back[1]).dir));
    found = warp_locate(kd, back);
    if (found.tile != leaf.tile || found.path != leaf.path) {
        out->crossed++;
        return;
    }
    error_unit(kd, &leaf, unit);
    for (k = 0; k < 2; k++)
        out->error[k] = fmax(out->error[k], fabs((double)back[k] - (double)u[k]) / unit[k]);
}

static void add_any(const envsamp_kd *kd, const float u[2], inverse *out)
{
    const float z = 1.0f - 2.0f * u[0], r = sqrtf(1.0f - z * z), phi = 6.2831853f * u[1];
    float dir[3], back[2];

    dir[0] = r * cosf(phi);
    dir[1] = r * sinf(phi);
    dir[2] = z;
    if (envsamp_kd_invert(kd, dir, back))
        out->angle_any = fmax(out->angle_any,
                              angle_between(dir, envsamp_kd_sample(kd, back[0], back[1]).dir));
}

/* ACROSS, DOWN: the worst error of u0 and u1. CROSSED: share of points whose direction rounds
   across an edge. BACK: the worst angle, in radians, of sampling what a sample's direction is
   inverted to; BACK_ANY: what any direction is. */
static void fill_inverse(const envsamp_kd *kd, int points, row *out)
{
    pcg32 random = pcg32_make(3, 3);
    inverse worst;
    float u[2];
    int i;

    memset(&worst, 0, sizeof worst);
    for (i = 0; i < points; i++) {
        u[0] = pcg32_float(&random);
        u[1] = pcg32_float(&random);
        add_sampled(kd, u, &worst);
        add_any(kd, u, &worst);
    }
    out->value[ACROSS] = worst.error[0];
    out->value[DOWN] = worst.error[1];
    out->value[CROSSED] = (double)worst.crossed / points;
    out->value[BACK] = worst.angle;
    out->value[BACK_ANY] = worst.angle_any;
}

static void fill_warp(const image *map, int points, row *out)
{
    static const int blocks[3] = { 1024, BLOCKS, 16384 };
    const envsamp_image view = kd_image(map->rgb, map->width, map->height, 3);
    int i;

    for (i = 0; i < 3; i++) {
        const envsamp_kd_desc desc = kd_desc(blocks[i], ENVSAMP_KD_WARP);
        kd_fixture f;

        if (kd_fixture_build(&f, &view, &desc))
            out->value[FEW + i] = f.info.excess_variance;
        if (f.kd && blocks[i] == BLOCKS) {
            const warp_cuts cuts = warp_count_cuts(f.kd);

            out->value[RATIO_WARP] = f.info.max_ratio;
            out->value[CUTS] = cuts.expected;
            out->value[DEEPEST] = cuts.deepest;
            fill_inverse(f.kd, points, out);
        }
        kd_fixture_free(&f);
    }
}

/* ---- bilinear lookups ---- */

#define LOOKUPS (1 << 20)

/* Mean and standard deviation of L / (pdf integral) by bilinear lookups, where `integral` is that
   of the interpolated map. */
static void estimate(const sampler *s, const envsamp_image *view, double integral, double *mean,
                     double *deviation)
{
    pcg32 random = pcg32_make(31, 7);
    double sum = 0.0, square = 0.0;
    int i;

    for (i = 0; i < LOOKUPS; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample from = sampler_draw(s, u0, u1);
        float rgb[3];
        double value;

        envsamp_lookup(view, 0, from.dir, rgb);
        value = (double)envsamp_luminance(rgb) / ((double)from.pdf * integral);
        sum += value;
        square += value * value;
    }
    *mean = sum / LOOKUPS;
    *deviation = sqrt(fmax(square / LOOKUPS - *mean * *mean, 0.0));
}

/* Tables made for bilinear lookups: standard deviation, z of the mean from 1, and the excess
   variance that the table claims; and a WARP table made for nearest texels: deviation and bias. */
static void fill_bilinear(const image *map, row *out)
{
    static const int kinds[4] = { SAMPLER_WARP, SAMPLER_ALIAS, SAMPLER_CDF, SAMPLER_WARP };
    const envsamp_image view = kd_image(map->rgb, map->width, map->height, 3);
    double integral = 0.0, mean, deviation;
    int i;

    for (i = 0; i < 4; i++) {
        sampler_request request = sampler_ask(kinds[i], &view, BLOCKS);
        sampler s;

        request.bilinear = i < 3;
        if (sampler_make(&s, &request)) {
            const sampler_info info = sampler_get_info(&s);

            integral = i < 3 ? info.integral : integral;
            estimate(&s, &view, integral, &mean, &deviation);
            if (i < 3) {
                out->value[BILINEAR + 3 * i] = deviation;
                out->value[BILINEAR + 3 * i + 1] = (mean - 1.0) / (deviation / sqrt(LOOKUPS));
                out->value[BILINEAR + 3 * i + 2] = info.excess_variance;
            } else {
                out->value[NEAREST] = deviation;
                out->value[NEAREST + 1] = mean - 1.0;
            }
        }
        sampler_free(&s);
    }
}

/* How many maps a sampler keeps within a standard deviation of 0.2. */
static void print_within(const map_set *set, const row *rows)
{
    int kind, i, count;

    printf("\nstandard deviation at most 0.2 on, of %d maps:", set->count);
    for (kind = 0; kind < 4; kind++) {
        for (i = count = 0; i < set->count; i++)
            count += rows[i].value[BILINEAR + 3 * kind] <= 0.2;
        printf(" %s %d", headings[BILINEAR + 3 * kind], count);
    }
    printf("\n");
}

/* ---- printing ---- */

static void print_value(int column, double value)
{
    if (column == ALPHA || column == BETA || column == RATIO || column == RATIO_FIT
        || (column >= RATIO_WARP && column <= DOWN))
        printf(" %9.3g", value);
    else if (column == DRAWN || column == DRAWN_FIT || column == GAP
             || (column >= CROSSED && column < BILINEAR))
        printf(" %9.1e", value);
    else
        printf(" %9.5f", value);
}

static void print_row(const char *name, const row *values, int from, int to)
{
    int i;

    printf("%-10s", name);
    for (i = from; i < to; i++)
        print_value(i, values->value[i]);
    printf("\n");
}

/* Median and maximum of every column. */
static void summarise(const row *rows, int count, row *median, row *maximum)
{
    double sorted[MAP_SET_MAX];
    int i, k;

    for (k = 0; k < COLUMNS; k++) {
        for (i = 0; i < count; i++)
            sorted[i] = rows[i].value[k];
        qsort(sorted, (size_t)count, sizeof *sorted, reference_falling);
        maximum->value[k] = sorted[0];
        median->value[k] = 0.5 * (sorted[(count - 1) / 2] + sorted[count / 2]);
    }
}

static void print_table(const char *title, const map_set *set, const row *rows, int from,
                        int to)
{
    row median, maximum;
    int i;

    printf("\n%s\n\n%-10s", title, "map");
    for (i = from; i < to; i++)
        printf(" %9s", headings[i]);
    printf("\n");
    for (i = 0; i < set->count; i++)
        print_row(map_set_name(set, i), &rows[i], from, to);
    summarise(rows, set->count, &median, &maximum);
    print_row("median", &median, from, to);
    print_row("maximum", &maximum, from, to);
}

static int fill(map_set *set, int index, int points, row *out)
{
    image map;

    memset(out, 0, sizeof *out);
    if (!map_set_load(set, index, &map))
        return 0;
    fill_warp(&map, points, out);
    fill_bilinear(&map, out);
    fill_alias(&map, out);
    fill_fits(&map, out);
    fill_gaps(&map, out);
    image_free(&map);
    return 1;
}

int main(int argc, char **argv)
{
    const int points = argc > 1 ? atoi(argv[1]) : 1000000;
    map_set set = map_set_find("figures");
    static row rows[MAP_SET_MAX];
    char title[512];
    int i;

    if (argc > 2 || points < 1) {
        fprintf(stderr, "usage: figures [POINTS]\n");
        return 1;
    }
    for (i = 0; i < set.count; i++)
        if (!fill(&set, i, points, &rows[i]))
            return 1;
    map_set_done(&set);
    printf("%d %s maps of 512x256, %d blocks\n", set.count, map_set_kind(&set), BLOCKS);
    print_table("WARP: excess variance by blocks; largest L/(pdf integral), cuts below a tile\n"
                "expected and at most", &set, rows, FEW, ACROSS);
    snprintf(title, sizeof title,
             "WARP, %d points a map: worst |invert(sample(u)) - u|, in 2^-24 times the stretch\n"
             "of the block; share of points whose direction rounds across an edge; worst angle of\n"
             "sample(invert(dir)), in radians, at samples and at any direction, which may lie in a\n"
             "block so dark that few of the 2^48 pairs of numbers draw it", points);
    print_table(title, &set, rows, ACROSS, BILINEAR);
    snprintf(title, sizeof title,
             "Bilinear lookups: standard deviation of L/(pdf integral) over %d points, z of its\n"
             "mean, and the excess variance that the table claims, for tables made for them; and of\n"
             "a WARP table made for nearest texels: deviation and bias", LOOKUPS);
    print_table(title, &set, rows, BILINEAR, COLUMNS);
    print_within(&set, rows);
    print_table("Excess variance of ALIAS by criterion, and of FIT by model and objective "
                "(LOG L1: as published)", &set, rows, SSE, ALPHA);
    print_table("LOG L1: alpha and l1; POWER CHI2: beta; largest L/(pdf integral), and total\n"
                "variation of the blocks that all 2^24 draws give, ALIAS and LOG L1",
                &set, rows, ALPHA, LEAST);
    print_table("LOG L1: least l1 of a scan of alpha, by block count, and the worst relative gap "
                "of the fit", &set, rows, LEAST, FEW);
    return 0;
}
