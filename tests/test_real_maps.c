/* test_real_maps.c: what 6144 blocks cost in variance on the real maps that `make data` fetches.
 * Without the maps every check is skipped.
 */
#include "check.h"

#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "kd_reference.h"
#include "../examples/common/random.h"

#define BLOCKS 6144
#define PAIRS (1 << 18)         /* samples a map whose pdf is asked for */

/* Figures of one map. */
typedef struct figures {
    int present, built;
    double alias, sse;          /* excess variance of ALIAS by EXCESS and by SSE */
    double l1, chi2;            /* of FIT */
    double brute_force;         /* of ALIAS, by sums over the texels */
    size_t bounds_bytes;
    long mismatched;            /* samples whose pdf(dir) is another */
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

static figures measure(int index)
{
    envsamp_kd_desc desc = kd_desc(BLOCKS, ENVSAMP_KD_ALIAS);
    figures m;
    reference r;
    image map;

    memset(&m, 0, sizeof m);
    m.present = reference_real_map(index, &map);
    if (!m.present)
        return m;
    m.built = reference_build(&r, &map, &desc);
    if (m.built) {
        m.alias = r.f.info.excess_variance;
        m.brute_force = reference_excess(&r);
        m.bounds_bytes = r.f.kd->pdf_at - r.f.kd->bounds_at;
        m.mismatched = mismatches(r.f.kd);
    }
    reference_free(&r);
    desc.criterion = ENVSAMP_KD_SSE;
    m.sse = built_excess(&map, &desc, &m.built);
    desc = kd_desc(BLOCKS, ENVSAMP_KD_FIT);
    m.l1 = built_excess(&map, &desc, &m.built);
    desc.objective = ENVSAMP_KD_CHI2;
    m.chi2 = built_excess(&map, &desc, &m.built);
    image_free(&map);
    return m;
}

static void check_map(int index, const figures *m)
{
    const char *name = reference_real_name(index);

    CHECK(m->built, "%s builds", name);
    CHECK(m->alias <= 0.14, "%s: ALIAS has excess variance %.5f", name, m->alias);
    CHECK(fabs(m->alias - m->brute_force) <= 2e-6 * (1.0 + m->alias),
          "%s: as a sum over its texels has, %.5f", name, m->brute_force);
    CHECK(m->chi2 <= m->l1 * (1.0 + 1e-9), "%s: FIT by CHI2 has %.4f, by L1 %.4f", name, m->chi2,
          m->l1);
    CHECK(m->mismatched * 2000 < PAIRS, "%s: pdf(sample) differs in %ld of %d", name,
          m->mismatched, PAIRS);
    CHECK(m->bounds_bytes == 49152, "%s: bounds of %d bytes", name, (int)m->bounds_bytes);
}

static double median(const double *falling, int count)
{
    return 0.5 * (falling[(count - 1) / 2] + falling[count / 2]);
}

static void check_all(const figures *all)
{
    double excess[REFERENCE_REAL_COUNT], ratio[REFERENCE_REAL_COUNT];
    int i;

    for (i = 0; i < REFERENCE_REAL_COUNT; i++) {
        excess[i] = all[i].alias;
        ratio[i] = all[i].alias / all[i].sse;
    }
    qsort(excess, REFERENCE_REAL_COUNT, sizeof *excess, reference_falling);
    qsort(ratio, REFERENCE_REAL_COUNT, sizeof *ratio, reference_falling);
    CHECK(excess[1] <= 0.018, "17 maps have at most %.5f, one %.5f", excess[1], excess[0]);
    CHECK(median(excess, REFERENCE_REAL_COUNT) <= 0.004, "the median is %.5f",
          median(excess, REFERENCE_REAL_COUNT));
    CHECK(median(ratio, REFERENCE_REAL_COUNT) < 0.85,
          "EXCESS has a median %.3f of the variance of SSE", median(ratio, REFERENCE_REAL_COUNT));
}

int main(void)
{
    figures all[REFERENCE_REAL_COUNT];
    int i, present = 0;

    for (i = 0; i < REFERENCE_REAL_COUNT; i++) {
        all[i] = measure(i);
        present += all[i].present;
        if (all[i].present)
            check_map(i, &all[i]);
        else
            CHECK_SKIP("a real map is missing: run make data");
    }
    if (present == REFERENCE_REAL_COUNT)
        check_all(all);
    else
        CHECK_SKIP("medians over the real maps: run make data");
    return check_done();
}
