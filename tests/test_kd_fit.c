/* test_kd_fit.c: the fits of FIT against brute-force scans of their parameters, and how often
 * blocks are really drawn against what tables claim, over every value of u0.
 */
#include "check.h"

#include "../envsamp.h"

#include "kd_reference.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"

#define MADE_COUNT 4
#define MAP_COUNT (MADE_COUNT + REAL_MAP_COUNT)
#define L1_GAP 5e-4             /* relative, above the least that a scan finds */
#define POWER_GAP 1e-4          /* the same for POWER's L1, whose minimum is a kink in a valley */
#define POWER_CHI2_BEHIND 1e-6  /* of 1 + variance, CHI2 above L1, both POWER, at any count */
#define REALISED 2e-4           /* total variation */

/* ---- maps: made-up ones, then the real ones ---- */

static const char *map_name(int index)
{
    static const char *const made[MADE_COUNT] = { "sky", "studio", "night", "foliage" };

    return index < MADE_COUNT ? made[index] : real_map_name(index - MADE_COUNT);
}

static int map_get(int index, image *map)
{
    if (index < MADE_COUNT)
        return map_make(map_name(index), 512, 256, map);
    return real_map_read(index - MADE_COUNT, map);
}

static envsamp_kd_desc fit_desc(int blocks, envsamp_kd_model model,
                                envsamp_kd_objective objective)
{
    envsamp_kd_desc desc = kd_desc(blocks, ENVSAMP_KD_FIT);

    desc.model = model;
    desc.objective = objective;
    return desc;
}

/* ---- the worst of each property over many fits ---- */

typedef struct audit {
    int fits, failed;
    double gap_l1, gap_chi2;        /* relative, of the cost above the scan's */
    double l1, excess;              /* of info against brute force, relative */
    double bins;                    /* of probabilities against the model of info, relative */
    long rising;                    /* blocks above the one before */
} audit;

static void worst(double *so_far, double value)
{
    if (!(value <= *so_far))
        *so_far = value;
}

/* Probabilities are the model's bins, in falling order, for alpha and beta of info. */
static void audit_bins(const reference *r, audit *a)
{
    const double alpha = r->f.info.alpha, beta = r->f.info.beta;
    const int count = r->f.info.block_count;
    int lit = 0, k;
    double low = 0.0, whole;

    for (k = 0; k < count; k++)
        lit += r->mass[k] > 0.0;
    whole = reference_model(alpha, beta, (double)lit);
    for (k = 0; k < lit; k++) {
        const double high = reference_model(alpha, beta, (double)(k + 1));
        const double bin = (high - low) / whole;

        worst(&a->bins, fabs(r->rects[k].probability / bin - 1.0));
        if (k > 0 && r->rects[k].probability > r->rects[k - 1].probability * (1.0 + 2e-7))
            a->rising++;
        low = high;
    }
    for (; k < count; k++)
        a->rising += r->rects[k].probability > 0.0;
}

static void audit_info(const reference *r, audit *a)
{
    const reference_target t = reference_target_of(r, r->f.desc.objective);
    const double cost = reference_cost(&t, log2(r->f.info.alpha), r->f.info.beta);

    worst(&a->l1, fabs(r->f.info.l1 - reference_l1(r)) / (0.1 + reference_l1(r)));
    worst(&a->excess, fabs(r->f.info.excess_variance - reference_excess(r))
                      / (1.0 + reference_excess(r)));
    if (r->f.desc.objective == ENVSAMP_KD_L1)
        worst(&a->l1, fabs(cost - r->f.info.l1) / (0.1 + cost));
    else
        worst(&a->excess, fabs(reference_cost_excess(r, &t, cost) - r->f.info.excess_variance)
                          / (1.0 + r->f.info.excess_variance));
    free(t.share);
}

/* How far a LOG fit is above the scan's minimum. */
static void audit_gap(const reference *r, double step, audit *a)
{
    const reference_target t = reference_target_of(r, r->f.desc.objective);
    const double least = reference_minimum(&t, 1.0, REFERENCE_LOG2_ALPHA_MIN, step);

    if (t.objective == ENVSAMP_KD_L1) {
        worst(&a->gap_l1, r->f.info.l1 / least - 1.0);
    } else {
        const double excess = reference_cost_excess(r, &t, least);

        worst(&a->gap_chi2, (1.0 + r->f.info.excess_variance) / (1.0 + excess) - 1.0);
    }
    free(t.share);
}

static envsamp_kd_info audit_fit(const image *map, const envsamp_kd_desc *desc, double step,
                                 audit *a)
{
    envsamp_kd_info info;
    reference r;

    memset(&info, 0, sizeof info);
    a->fits++;
    if (reference_build(&r, map, desc)) {
        info = r.f.info;
        audit_bins(&r, a);
        audit_info(&r, a);
        if (step > 0.0)
            audit_gap(&r, step, a);
    } else {
        a->failed++;
    }
    reference_free(&r);
    return info;
}

static void audit_report(const char *name, const audit *a)
{
    CHECK(!a->failed && a->fits, "%s: %d fits", name, a->fits);
    CHECK(a->gap_l1 <= L1_GAP, "%s: L1 is at most %.1e above the scan's", name, a->gap_l1);
    CHECK(a->gap_chi2 <= 1e-6, "%s: CHI2 is at most %.1e above the scan's", name, a->gap_chi2);
    CHECK(a->l1 <= 2e-6, "%s: info.l1 is %.1e off", name, a->l1);
    CHECK(a->excess <= 2e-6, "%s: info.excess_variance is %.1e off", name, a->excess);
    CHECK(a->bins <= 1e-6, "%s: blocks have the model's probabilities, to %.1e", name, a->bins);
    CHECK(!a->rising, "%s: blocks fall in probability, but %ld", name, a->rising);
}

/* ---- every map, every model and objective ---- */

/* Figures of the four fits of a map, [model][objective]. */
typedef struct fits { envsamp_kd_info info[2][2]; } fits;

static fits fit_all(const image *map, int blocks, double step, audit *a)
{
    fits all;
    int model, objective;

    for (model = 0; model < 2; model++)
        for (objective = 0; objective < 2; objective++) {
            const envsamp_kd_desc desc = fit_desc(blocks, (envsamp_kd_model)model,
                                                  (envsamp_kd_objective)objective);

            all.info[model][objective] = audit_fit(map, &desc, model ? 0.0 : step, a);
        }
    return all;
}

/* How far fits fall behind others that they should beat. */
typedef struct order {
    double chi2_behind;         /* CHI2 after L1, LOG */
    double power_behind;        /* the same for POWER */
    double power_l1_behind, power_chi2_behind;      /* POWER after LOG */
} order;

static void order_add(const fits *all, order *o)
{
    const envsamp_kd_info *log = all->info[0], *power = all->info[1];

    worst(&o->chi2_behind, (1.0 + log[1].excess_variance) / (1.0 + log[0].excess_variance) - 1.0);
    worst(&o->power_behind, (1.0 + power[1].excess_variance)
                            / (1.0 + power[0].excess_variance) - 1.0);
    worst(&o->power_l1_behind, power[0].l1 / log[0].l1 - 1.0);
    worst(&o->power_chi2_behind, (1.0 + power[1].excess_variance)
                                 / (1.0 + log[1].excess_variance) - 1.0);
}

static void test_map(int index, order *o, order *at_6144)
{
    const int counts[] = { 16, 256, 6144 };
    image map;
    audit a;
    int i;

    memset(&a, 0, sizeof a);
    if (!map_get(index, &map)) {
        CHECK_SKIP("a real map for fits: run make data");
        return;
    }
    for (i = 0; i < 3; i++) {
        const fits all = fit_all(&map, counts[i], 1.0 / 32.0, &a);

        order_add(&all, o);
        if (counts[i] == 6144)
            order_add(&all, at_6144);
    }
    audit_report(map_name(index), &a);
    image_free(&map);
}

static void test_maps(void)
{
    order o = { -1.0, -1.0, -1.0, -1.0 }, at_6144 = o;
    int i;

    for (i = 0; i < MAP_COUNT; i++)
        test_map(i, &o, &at_6144);
    CHECK(o.chi2_behind <= 1e-9, "CHI2 has no more variance than L1: %.1e", o.chi2_behind);
    CHECK(at_6144.power_behind <= 1e-9, "nor for POWER at 6144 blocks: %.1e",
          at_6144.power_behind);
    CHECK(o.power_behind <= POWER_CHI2_BEHIND, "for POWER at any count hardly more: %.1e",
          o.power_behind);
    CHECK(o.power_l1_behind <= 1e-6, "POWER's L1 is no worse than LOG's: %.1e",
          o.power_l1_behind);
    CHECK(o.power_chi2_behind <= 1e-6, "POWER's variance is no worse than LOG's: %.1e",
          o.power_chi2_behind);
}

/* The LOG fit of L1 to so many blocks that half of them are single texels. */
static void test_many_blocks(int index)
{
    const envsamp_kd_desc desc = fit_desc(65536, ENVSAMP_KD_LOG, ENVSAMP_KD_L1);
    image map;
    audit a;

    memset(&a, 0, sizeof a);
    if (!map_get(index, &map)) {
        CHECK_SKIP("a real map of 65536 blocks: run make data");
        return;
    }
    audit_fit(&map, &desc, 1.0 / 16.0, &a);
    audit_report(map_name(index), &a);
    image_free(&map);
}

/* ---- POWER against a scan of both parameters ---- */

static double power_minimum(const reference_target *t)
{
    double least = DBL_MAX, beta;

    for (beta = 0.1; beta < 4.0; beta += 0.05)
        least = fmin(least, reference_minimum(t, beta, -20.0, 0.25));
    return least;
}

static void test_power(int index, int blocks, envsamp_kd_objective objective)
{
    const envsamp_kd_desc desc = fit_desc(blocks, ENVSAMP_KD_POWER, objective);
    const char *kind = objective == ENVSAMP_KD_L1 ? "L1" : "CHI2";
    reference_target t;
    reference r;
    image map;
    double least, cost;

    if (!map_get(index, &map)) {
        CHECK_SKIP("a real map for POWER: run make data");
        return;
    }
    if (!reference_build(&r, &map, &desc)) {
        CHECK(0, "POWER of %s builds", map_name(index));
        return;
    }
    t = reference_target_of(&r, objective);
    least = power_minimum(&t);
    cost = reference_cost(&t, log2(r.f.info.alpha), r.f.info.beta);
    CHECK(cost <= least * (1.0 + (objective == ENVSAMP_KD_L1 ? POWER_GAP : L1_GAP)),
          "%s, %d blocks: POWER's %s is %.1e above a scan's", map_name(index), blocks, kind,
          cost / least - 1.0);
    free(t.share);
    reference_free(&r);
    image_free(&map);
}

/* ---- every value of u0 ---- */

static void test_realised(int index, const envsamp_kd_desc *desc, double bound)
{
    static const char *const models[2] = { "LOG", "POWER" };
    const char *name = desc->select == ENVSAMP_KD_ALIAS ? "ALIAS" : models[desc->model];
    double distance = 1.0;
    reference r;
    image map;

    if (!map_get(index, &map)) {
        CHECK_SKIP("a real map for all values of u0: run make data");
        return;
    }
    if (reference_build(&r, &map, desc))
        distance = reference_realised(&r);
    CHECK(distance <= bound, "%s, %d blocks, %s: all u0 draw what is claimed, to %.2e",
          map_name(index), r.f.info.block_count, name, distance);
    reference_free(&r);
    image_free(&map);
}

/* Float probabilities and samples that round into the next block are all that may differ. */
static void test_realised_alias(int index, int blocks)
{
    const envsamp_kd_desc desc = kd_desc(blocks, ENVSAMP_KD_ALIAS);

    test_realised(index, &desc, 1e-7);
}

static void test_realised_fit(int index, int blocks, envsamp_kd_model model)
{
    const envsamp_kd_desc desc = fit_desc(blocks, model, ENVSAMP_KD_CHI2);

    test_realised(index, &desc, REALISED);
}

static void test_draws(void)
{
    const int city = MADE_COUNT + 2;
    envsamp_kd_desc published = fit_desc(6144, ENVSAMP_KD_LOG, ENVSAMP_KD_L1);

    test_realised_alias(0, 6144);
    test_realised_alias(2, 65536);
    test_realised_alias(city, 6144);
    test_realised(0, &published, REALISED);
    test_realised(1, &published, REALISED);
    test_realised(city, &published, REALISED);
    test_realised_fit(0, 256, ENVSAMP_KD_LOG);
    test_realised_fit(2, 6144, ENVSAMP_KD_LOG);
    test_realised_fit(0, 6144, ENVSAMP_KD_POWER);
    test_realised_fit(3, 6144, ENVSAMP_KD_POWER);
}

/* ---- degenerate maps ---- */

/* Four texels a row, each of the shares given, so that as many blocks have those masses. */
static void column_map(image *map, const double *share, int count)
{
    int x, y, c;

    image_alloc(map, count, 8);
    for (y = 0; y < 8; y++)
        for (x = 0; x < count; x++)
            for (c = 0; c < 3; c++)
                map->rgb[3 * (y * count + x) + c] = (float)share[x];
}

/* Fits of the four kinds to columns of these masses: a table that says what it does. */
static void test_columns(const char *name, const double *share, int count, int blocks,
                         double slack)
{
    audit a;
    image map;
    fits all;
    order o = { -1.0, -1.0, -1.0, -1.0 };

    memset(&a, 0, sizeof a);
    column_map(&map, share, count);
    all = fit_all(&map, blocks, 0.0, &a);
    CHECK(all.info[0][0].block_count == blocks, "%s: %d blocks", name,
          all.info[0][0].block_count);
    audit_report(name, &a);
    order_add(&all, &o);
    CHECK(o.chi2_behind <= slack, "%s: CHI2 has no more variance than L1: %.1e", name,
          o.chi2_behind);
    CHECK(o.power_chi2_behind <= 1e-6, "%s: POWER has no more than LOG", name);
    image_free(&map);
}

/* One block takes all; two are met exactly by a model of one parameter. */
static void test_few_blocks(void)
{
    const double one[4] = { 1.0, 1.0, 1.0, 1.0 }, two[4] = { 8.0, 8.0, 3.0, 3.0 };
    const double lone[4] = { 0.0, 5.0, 0.0, 0.0 };
    const envsamp_kd_desc desc = fit_desc(4, ENVSAMP_KD_LOG, ENVSAMP_KD_L1);
    envsamp_kd_info info;
    audit a;
    image map;

    test_columns("one block", one, 4, 1, 1e-9);
    test_columns("two blocks", two, 4, 2, 1e-9);
    test_columns("one lit block of three", lone, 4, 3, 1e-9);
    memset(&a, 0, sizeof a);
    column_map(&map, two, 4);
    info = audit_fit(&map, &desc, 0.0, &a);
    CHECK(info.l1 <= 1e-6, "two blocks are fitted exactly: L1 is %.1e", info.l1);
    CHECK(info.excess_variance <= 1e-5, "and have no variance: %.1e", info.excess_variance);
    image_free(&map);
}

/* Blocks of almost the same mass want a flat model, alpha far above their number. They differ by
   as much as floats of the pyramid tell for certain: a map of less contrast may count as flat. */
static void test_equal_blocks(void)
{
    const envsamp_kd_desc desc = fit_desc(64, ENVSAMP_KD_LOG, ENVSAMP_KD_L1);
    double share[64];
    envsamp_kd_info info;
    audit a;
    image map;
    int i;

    for (i = 0; i < 64; i++)
        share[i] = i % 2 ? 1.0 : 1.002;
    test_columns("equal blocks", share, 64, 64, 1e-7);
    memset(&a, 0, sizeof a);
    column_map(&map, share, 64);
    info = audit_fit(&map, &desc, 1.0 / 32.0, &a);
    CHECK(info.l1 <= 1e-3, "equal blocks: L1 is %.1e", info.l1);
    CHECK(info.alpha > 64.0 * 100.0, "and alpha is %.3g", info.alpha);
    image_free(&map);
}

/* One block with nearly all of the mass wants alpha to vanish. Alpha is bounded, and so is the
   scan; CHI2 and L1 may end on different sides of the bound. */
static void test_one_heavy_block(void)
{
    const envsamp_kd_desc desc = fit_desc(64, ENVSAMP_KD_LOG, ENVSAMP_KD_L1);
    pcg32 random = pcg32_make(5, 0);
    double share[64], least;
    reference_target t;
    reference r;
    image map;
    int i;

    for (i = 0; i < 64; i++)
        share[i] = 1.0 + (double)pcg32_float(&random);
    share[17] = 1e7;
    test_columns("a heavy block", share, 64, 64, 1e-6);
    column_map(&map, share, 64);
    CHECK(reference_build(&r, &map, &desc), "a heavy block: a table");
    t = reference_target_of(&r, ENVSAMP_KD_L1);
    least = reference_minimum(&t, 1.0, log2(1e-7), 1.0 / 32.0);
    CHECK(r.f.info.l1 <= least * (1.0 + L1_GAP), "a heavy block: L1 is %.4f, alpha %.1e",
          r.f.info.l1, r.f.info.alpha);
    free(t.share);
    reference_free(&r);
    image_free(&map);
}

int main(void)
{
    test_maps();
    test_many_blocks(0);
    test_many_blocks(MADE_COUNT + 2);
    test_power(0, 256, ENVSAMP_KD_L1);
    test_power(3, 256, ENVSAMP_KD_CHI2);
    test_power(MADE_COUNT + 4, 256, ENVSAMP_KD_CHI2);
    test_power(MADE_COUNT + 4, 256, ENVSAMP_KD_L1);
    test_draws();
    test_few_blocks();
    test_equal_blocks();
    test_one_heavy_block();
    return check_done();
}
