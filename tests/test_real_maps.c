/* test_real_maps.c: what 6144 blocks cost in variance on the real maps that `make data` fetches.
 * Without the maps every check is skipped.
 */
#include "check.h"

#include "../envsamp.h"

#include "kd_reference.h"
#include "../examples/common/random.h"

#define BLOCKS 6144
#define UNIT 16777216.0         /* 2^24: how many values a float u has */
#define INVERTED 100000         /* samples a map whose direction is inverted */
#define PAIRS (1 << 18)         /* samples a map whose pdf is asked for */

/* Figures of one map. */
typedef struct figures {
    int present, built;
    double alias, sse;          /* excess variance of ALIAS by EXCESS and by SSE */
    double l1, chi2;            /* of FIT */
    double brute_force;         /* of ALIAS, by sums over the texels */
    size_t edges_bytes;
    long mismatched;            /* samples whose pdf(dir) is another */
    double warp, warp_brute_force;      /* excess variance of WARP */
    double cuts;                /* expected below a tile */
    long warp_mismatched;
    long crossed;               /* samples whose direction rounds into another block */
    double inverse;             /* how far numbers come back, in 2^-24 times the stretch, or 1 */
} figures;

static double built_excess(const image *map, const envsamp_kd_desc *desc, int *built)
{
    const envsamp_image view = kd_image(map->rgb, map->width, map->height, 3);
    kd_fixture f;
    double excess = 0.0;

    if (kd_fixture_build(&f, &view, desc))
        excess = f.info.excess_variance;
    else
        *built = 0;
    kd_fixture_free(&f);
    return excess;
}

static long mismatches(const envsamp_kd *kd)
{
    pcg32 random = pcg32_make(81, 0);
    long count = 0;
    int i;

    for (i = 0; i < PAIRS; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(kd, u0, u1);
        const float pdf = envsamp_kd_pdf(kd, s.dir);

        count += pdf < s.pdf || pdf > s.pdf;
    }
    return count;
}

/* How much wider a block is in the unit square than on the sphere. */
static double stretch(const kd_warp_block *b, int axis)
{
    const double size = axis ? 0.5 * kd_cap_between(b->edge[2], b->edge[3])
                             : (double)b->edge[1] - (double)b->edge[0];

    return (b->high[axis] - b->low[axis]) / UNIT / size;
}

static void invert(const envsamp_kd *kd, figures *m)
{
    pcg32 random = pcg32_make(82, 0);
    int i, axis;

    for (i = 0; i < INVERTED; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(kd, u0, u1);
        const kd_warp_block from = kd_warp_at(kd, (double)u0, (double)u1);
        const float pdf = envsamp_kd_pdf(kd, s.dir), before[2] = { u0, u1 };
        kd_warp_block to;
        float u[2];

        envsamp_kd_invert(kd, s.dir, u);
        to = kd_warp_at(kd, (double)u[0], (double)u[1]);
        if (pdf < s.pdf || pdf > s.pdf || from.edge[0] < to.edge[0] || from.edge[0] > to.edge[0]
            || from.edge[2] < to.edge[2] || from.edge[2] > to.edge[2] || from.tile != to.tile) {
            m->crossed++;
            continue;
        }
        for (axis = 0; axis < 2; axis++)
            m->inverse = fmax(m->inverse, fabs((double)u[axis] - (double)before[axis]) * UNIT
                                          / fmax(1.0, stretch(&from, axis)));
    }
}

static double expected_cuts(const reference *r)
{
    const int count = r->f.info.block_count;
    kd_warp_block *blocks = (kd_warp_block *)kd_allocate((size_t)count * sizeof *blocks);
    double cuts = 0.0;
    int i;

    kd_warp_blocks(r->f.kd, blocks, count);
    for (i = 0; i < count; i++)
        cuts += r->rects[i].probability * (double)blocks[i].depth;
    free(blocks);
    return cuts;
}

static void measure_warp(const image *map, figures *m)
{
    const envsamp_kd_desc desc = kd_desc(BLOCKS, ENVSAMP_KD_WARP);
    reference r;

    if (!reference_build(&r, map, &desc)) {
        m->built = 0;
    } else {
        m->warp = r.f.info.excess_variance;
        m->warp_brute_force = fmax(reference_excess(&r), 0.0);
        m->cuts = expected_cuts(&r);
        m->warp_mismatched = mismatches(r.f.kd);
        invert(r.f.kd, m);
    }
    reference_free(&r);
}

static figures measure(int index)
{
    envsamp_kd_desc desc = kd_desc(BLOCKS, ENVSAMP_KD_ALIAS);
    figures m;
    reference r;
    image map;

    memset(&m, 0, sizeof m);
    m.present = real_map_read(index, &map);
    if (!m.present)
        return m;
    m.built = reference_build(&r, &map, &desc);
    if (m.built) {
        m.alias = r.f.info.excess_variance;
        m.brute_force = reference_excess(&r);
        m.edges_bytes = (KD_WORD(r.f.kd, alias_at) - KD_RECORD_AT(0)) / 20 * 16;
        m.mismatched = mismatches(r.f.kd);
    }
    reference_free(&r);
    desc.criterion = ENVSAMP_KD_SSE;
    m.sse = built_excess(&map, &desc, &m.built);
    desc = kd_desc(BLOCKS, ENVSAMP_KD_FIT);
    m.l1 = built_excess(&map, &desc, &m.built);
    desc.objective = ENVSAMP_KD_CHI2;
    m.chi2 = built_excess(&map, &desc, &m.built);
    measure_warp(&map, &m);
    image_free(&map);
    return m;
}

static void check_map(int index, const figures *m)
{
    const char *name = real_map_name(index);

    CHECK(m->built, "%s builds", name);
    CHECK(m->alias <= 0.14, "%s: ALIAS has excess variance %.5f", name, m->alias);
    CHECK(fabs(m->alias - m->brute_force) <= 2e-6 * (1.0 + m->alias),
          "%s: as a sum over its texels has, %.5f", name, m->brute_force);
    CHECK(m->chi2 <= m->l1 * (1.0 + 1e-9), "%s: FIT by CHI2 has %.4f, by L1 %.4f", name, m->chi2,
          m->l1);
    CHECK(m->mismatched * 2000 < PAIRS, "%s: pdf(sample) differs in %ld of %d", name,
          m->mismatched, PAIRS);
    CHECK(m->edges_bytes == 98304, "%s: edges of %d bytes", name, (int)m->edges_bytes);
}

static void check_warp(int index, const figures *m)
{
    const char *name = real_map_name(index);

    CHECK(m->warp <= 0.2, "%s: WARP has excess variance %.5f", name, m->warp);
    CHECK(fabs(m->warp - m->warp_brute_force) <= 2e-6 * (1.0 + m->warp),
          "%s: as a sum over its texels has, %.5f", name, m->warp_brute_force);
    CHECK(m->cuts <= 2.0, "%s: %.2f cuts below a tile are expected", name, m->cuts);
    CHECK(m->warp_mismatched * 2000 < PAIRS, "%s: WARP's pdf(sample) differs in %ld of %d", name,
          m->warp_mismatched, PAIRS);
    CHECK(m->inverse <= 4.0, "%s: samples invert, to %.2f of 2^-24", name, m->inverse);
    CHECK(m->crossed * 1000 < INVERTED, "%s: but %ld of %d that round over an edge", name,
          m->crossed, INVERTED);
}

static double median(const double *falling, int count)
{
    return 0.5 * (falling[(count - 1) / 2] + falling[count / 2]);
}

static void check_all(const figures *all)
{
    double excess[REAL_MAP_COUNT], ratio[REAL_MAP_COUNT], warp[REAL_MAP_COUNT];
    int i;

    for (i = 0; i < REAL_MAP_COUNT; i++) {
        excess[i] = all[i].alias;
        ratio[i] = all[i].alias / all[i].sse;
        warp[i] = all[i].warp;
    }
    qsort(excess, REAL_MAP_COUNT, sizeof *excess, reference_falling);
    qsort(warp, REAL_MAP_COUNT, sizeof *warp, reference_falling);
    qsort(ratio, REAL_MAP_COUNT, sizeof *ratio, reference_falling);
    CHECK(excess[1] <= 0.018, "17 maps have at most %.5f, one %.5f", excess[1], excess[0]);
    CHECK(median(excess, REAL_MAP_COUNT) <= 0.004, "the median is %.5f",
          median(excess, REAL_MAP_COUNT));
    CHECK(median(ratio, REAL_MAP_COUNT) < 0.85,
          "EXCESS has a median %.3f of the variance of SSE", median(ratio, REAL_MAP_COUNT));
    CHECK(median(warp, REAL_MAP_COUNT) <= 0.008, "the median of WARP is %.5f, the worst %.5f",
          median(warp, REAL_MAP_COUNT), warp[0]);
}

int main(void)
{
    figures all[REAL_MAP_COUNT];
    int i, present = 0;

    for (i = 0; i < REAL_MAP_COUNT; i++) {
        all[i] = measure(i);
        present += all[i].present;
        if (all[i].present) {
            check_map(i, &all[i]);
            check_warp(i, &all[i]);
        } else {
            CHECK_SKIP("a real map is missing: run make data");
        }
    }
    if (present == REAL_MAP_COUNT)
        check_all(all);
    else
        CHECK_SKIP("medians over the real maps: run make data");
    return check_done();
}
