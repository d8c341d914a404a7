/* samplers.c: what every kind of table costs, and how far it is off, beside the full CDF.
 *
 *     samplers [-q] [MAP]     tables on stdout; half a minute. -q: without times, which stay empty
 *
 * MAP is an HDR or PFM file, or a name of maps.h, made at 2048 x 1024; without it sky and studio.
 * Tables are for lookups of the nearest texel, as the CDF is; those of MIS for bilinear ones.
 */
#define _POSIX_C_SOURCE 200809L
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "../examples/common/irradiance.h"
#include "../examples/common/maps.h"
#include "../examples/common/mis_scene.h"
#include "../examples/common/progress.h"
#include "baseline_sampler.h"
#include "table.h"

#define ROUND_COUNT 3
#include "timing.h"

#define MAP_WIDTH 2048
#define SAMPLES (1 << 18)            /* a round */
#define SCRAMBLINGS 32               /* sets of points behind an error */

typedef struct subject {
    const char *name;
    image map;
    envsamp_image view;
    int timed, index, count;         /* among all maps */
    progress *shown;
} subject;

static void fail(const char *what, const char *why)
{
    fflush(stdout);
    fprintf(stderr, "samplers: %s: %s\n", what, why);
    exit(EXIT_FAILURE);
}

/* `done`: of 20 parts of a map. */
static void show(const subject *s, double done)
{
    progress_show(s->shown, (s->index + done / 20.0) / s->count, s->name);
}

/* ---- methods ---- */

typedef struct method {
    const char *name;
    int block_count;
    envsamp_kd_select select;
    envsamp_kd_criterion criterion;
    envsamp_kd_model model;
    envsamp_kd_objective objective;
} method;

static const method methods[] = {
    {"WARP, split by EXCESS", 6144, ENVSAMP_KD_WARP, ENVSAMP_KD_EXCESS, ENVSAMP_KD_LOG,
     ENVSAMP_KD_L1},
    {"WARP, split by EXCESS", 16384, ENVSAMP_KD_WARP, ENVSAMP_KD_EXCESS, ENVSAMP_KD_LOG,
     ENVSAMP_KD_L1},
    {"ALIAS, split by EXCESS", 1024, ENVSAMP_KD_ALIAS, ENVSAMP_KD_EXCESS, ENVSAMP_KD_LOG,
     ENVSAMP_KD_L1},
    {"ALIAS, split by EXCESS", 6144, ENVSAMP_KD_ALIAS, ENVSAMP_KD_EXCESS, ENVSAMP_KD_LOG,
     ENVSAMP_KD_L1},
    {"ALIAS, split by EXCESS", 16384, ENVSAMP_KD_ALIAS, ENVSAMP_KD_EXCESS, ENVSAMP_KD_LOG,
     ENVSAMP_KD_L1},
    {"ALIAS, split by SSE", 6144, ENVSAMP_KD_ALIAS, ENVSAMP_KD_SSE, ENVSAMP_KD_LOG,
     ENVSAMP_KD_L1},
    {"FIT LOG L1, by SSE (*)", 6144, ENVSAMP_KD_FIT, ENVSAMP_KD_SSE, ENVSAMP_KD_LOG,
     ENVSAMP_KD_L1},
    {"FIT LOG L1", 6144, ENVSAMP_KD_FIT, ENVSAMP_KD_EXCESS, ENVSAMP_KD_LOG, ENVSAMP_KD_L1},
    {"FIT LOG CHI2", 6144, ENVSAMP_KD_FIT, ENVSAMP_KD_EXCESS, ENVSAMP_KD_LOG, ENVSAMP_KD_CHI2},
    {"FIT POWER CHI2", 6144, ENVSAMP_KD_FIT, ENVSAMP_KD_EXCESS, ENVSAMP_KD_POWER,
     ENVSAMP_KD_CHI2}
};

enum { METHODS = sizeof methods / sizeof methods[0] };

static envsamp_kd_desc method_desc(const method *m)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();

    desc.nearest = 1;
    desc.block_count = m->block_count;
    desc.select = m->select;
    desc.criterion = m->criterion;
    desc.model = m->model;
    desc.objective = m->objective;
    return desc;
}

static void table_make(bench_table *t, const subject *s, const envsamp_kd_desc *desc)
{
    if (!bench_table_build(t, &s->view, desc))
        fail(s->name, envsamp_result_string(t->result));
}

/* ---- times ---- */

static double build_ms(const subject *s, const envsamp_kd_desc *desc, bench_table *t)
{
    double ms[ROUND_COUNT];
    int i;

    for (i = 0; i < ROUND_COUNT; i++) {
        const double start = seconds();

        envsamp_kd_build(&s->view, desc, t->memory, t->scratch, &t->kd);
        ms[i] = 1e3 * (seconds() - start);
    }
    return median(ms);
}

static double cdf_build_ms(const subject *s)
{
    double ms[ROUND_COUNT];
    baseline_cdf cdf;
    int i;

    for (i = 0; i < ROUND_COUNT; i++) {
        const double start = seconds();

        if (!baseline_cdf_create(s->map.rgb, s->map.width, s->map.height, &cdf))
            fail(s->name, "not enough memory for the full CDF");
        ms[i] = 1e3 * (seconds() - start);
        baseline_cdf_destroy(&cdf);
    }
    return median(ms);
}

static volatile float sink;          /* keeps the timed loop from being left out */

static double sample_ns(const sampler *by)
{
    double ns[ROUND_COUNT];
    int round, i;

    for (round = 0; round < ROUND_COUNT; round++) {
        pcg32 random = pcg32_make(1, 0);
        const double start = seconds();
        float sum = 0.0f;

        for (i = 0; i < SAMPLES; i++) {
            const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
            const envsamp_sample sample = by->draw(by->table, u0, u1);

            sum += sample.dir[0] + sample.dir[1] + sample.dir[2] + sample.pdf;
        }
        sink = sum;
        ns[round] = 1e9 * (seconds() - start) / SAMPLES;
    }
    return median(ns);
}

/* ---- the table ---- */

static double cdf_kib(const subject *s)
{
    return 4.0 * (double)s->map.width * (double)s->map.height / 1024.0;
}

static void print_times(const subject *s, double build, double sample)
{
    if (s->timed)
        printf(" %8.2f %7.1f", build, sample);
    else
        printf(" %8s %7s", "", "");
}

static void print_method(const subject *s, const method *m)
{
    const envsamp_kd_desc desc = method_desc(m);
    bench_table t;
    sampler by;
    double kib, build = 0.0, sample = 0.0;

    show(s, 3.0 + (double)(m - methods) * 0.5);
    table_make(&t, s, &desc);
    by = sampler_of_kd(m->name, t.kd);
    if (s->timed) {
        build = build_ms(s, &desc, &t);
        sample = sample_ns(&by);
    }
    kib = (double)envsamp_kd_bytes(t.kd) / 1024.0;
    progress_end(s->shown);
    printf("%-23s %6d %7.1f", m->name, t.info.block_count, kib);
    printf(cdf_kib(s) / kib < 99.95 ? " %7.1fx" : " %7.0fx", cdf_kib(s) / kib);
    if (m->select == ENVSAMP_KD_WARP)       /* its tree stands for bounds */
        printf(" %7s", "-");
    else
        printf(" %7.1f", 16.0 * (double)t.info.block_count / 1024.0);
    print_times(s, build, sample);
    printf(" %9.5f %8.3g", t.info.excess_variance, t.info.max_ratio);
    if (m->select == ENVSAMP_KD_FIT)
        printf(" %8.3g\n", t.info.alpha);
    else
        printf(" %8s\n", "-");
    fflush(stdout);
    bench_table_free(&t);
}

static void print_methods(const subject *s, const baseline_cdf *cdf)
{
    const sampler by = sampler_of_cdf("full CDF, binary search", cdf);
    int i;

    printf("%s, %d x %d texels\n\n", s->name, s->map.width, s->map.height);
    printf("%-23s %6s %7s %8s %7s %8s %7s %9s %8s\n", "", "", "table", "smaller", "bounds",
           "build", "sample", "excess", "largest");
    printf("%-23s %6s %7s %8s %7s %8s %7s %9s %8s %8s\n", "method", "blocks", "KiB", "than CDF",
           "KiB", "ms", "ns", "variance", "L/pdf", "alpha");
    for (i = 0; i < METHODS; i++)
        print_method(s, &methods[i]);
    printf("%-23s %6s %7.1f %7.1fx %7s", by.name, "-", cdf_kib(s), 1.0, "-");
    print_times(s, s->timed ? cdf_build_ms(s) : 0.0, s->timed ? sample_ns(&by) : 0.0);
    printf(" %9d %8d %8s\n", 0, 1, "-");
}

/* ---- errors ---- */

static void print_irradiance(const subject *s, const baseline_cdf *cdf)
{
    static const uint32_t points[] = {16, 64, 256, 1024};
    static irradiance exact;
    envsamp_kd_desc desc = envsamp_kd_defaults();
    bench_table warp, alias;
    sampler by[3];
    int i, j;

    desc.nearest = 1;
    table_make(&warp, s, &desc);
    desc.select = ENVSAMP_KD_ALIAS;
    table_make(&alias, s, &desc);
    if (!irradiance_make(&exact, &s->map))
        fail(s->name, "not enough memory for the irradiance");
    by[0] = sampler_of_kd("WARP", warp.kd);
    by[1] = sampler_of_kd("ALIAS", alias.kd);
    by[2] = sampler_of_cdf("full CDF, binary search", cdf);
    show(s, 9.0);
    progress_end(s->shown);
    printf("\nRMSE of irradiance, Sobol points:  N = %4u    N = %4u    N = %4u    N = %4u\n",
           (unsigned)points[0], (unsigned)points[1], (unsigned)points[2], (unsigned)points[3]);
    for (i = 0; i < 3; i++) {
        printf("%-32s", by[i].name);
        for (j = 0; j < 4; j++)
            printf(" %11.5f", irradiance_rmse(&exact, &s->view, &by[i], points[j], SCRAMBLINGS));
        printf("\n");
    }
    bench_table_free(&warp);
    bench_table_free(&alias);
}

/* A cdf table, to be freed with free(memory->data). */
static const envsamp_cdf *cdf_make(const subject *s, float compensation, envsamp_buffer *memory)
{
    envsamp_cdf_desc desc = envsamp_cdf_defaults();
    envsamp_sizes sizes;
    envsamp_buffer scratch;
    const envsamp_cdf *cdf = NULL;

    desc.mis_compensation = compensation;
    envsamp_cdf_sizes(&s->view, &desc, &sizes);
    memory->data = bench_allocate(memory->bytes = sizes.table_bytes);
    scratch.data = bench_allocate(scratch.bytes = sizes.scratch_bytes);
    envsamp_cdf_build(&s->view, &desc, *memory, scratch, &cdf);
    free(scratch.data);
    return cdf;
}

/* The gain is by how much the variance falls. */
static void print_mis_row(const char *map, const char *by, const mis_panel *panels)
{
    const double plain = panels[MIS_PLAIN].rmse, compensated = panels[MIS_COMPENSATED].rmse;
    const double gain = compensated > 0.0 ? plain * plain / (compensated * compensated) : 1.0;
    char name[64];

    snprintf(name, sizeof name, "%.40s, %s", map, by);
    printf("%-32s %11.4f %11.4f %11.4f %11.4f %7.2f\n", name, panels[MIS_BSDF].rmse,
           panels[MIS_MAP].rmse, plain, compensated, gain);
}

static void print_mis(const subject *s)
{
    static mis_scene scene;
    envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_buffer memory[2];
    bench_table plain, compensated;

    table_make(&plain, s, &desc);
    desc.mis_compensation = 1.0f;
    table_make(&compensated, s, &desc);
    scene.view = &s->view;
    scene.plain = mis_light_of_kd(plain.kd);
    scene.compensated = mis_light_of_kd(compensated.kd);
    show(s, 10.0);
    mis_scene_shade(&scene, 1);
    progress_end(s->shown);
    printf("\n%-32s %11s %11s %11s %11s %7s\n", "RMSE of a scene, 16 rays", "BSDF", "map", "MIS",
           "compensated", "gain");
    print_mis_row(s->name, "kd, WARP", scene.panels);
    scene.plain = mis_light_of_cdf(cdf_make(s, 0.0f, &memory[0]));
    scene.compensated = mis_light_of_cdf(cdf_make(s, 1.0f, &memory[1]));
    mis_scene_shade(&scene, 0);
    print_mis_row(s->name, "cdf", scene.panels);
    printf("\n");
    free(memory[0].data);
    free(memory[1].data);
    bench_table_free(&plain);
    bench_table_free(&compensated);
}

static void do_map(const char *name, int timed, int index, int count, progress *shown)
{
    baseline_cdf cdf;
    char error[512];
    subject s;

    s.name = name;
    s.timed = timed;
    s.index = index;
    s.count = count;
    s.shown = shown;
    show(&s, 0.0);
    if (!map_make(name, MAP_WIDTH, MAP_WIDTH / 2, &s.map)
        && !image_read(name, &s.map, error, sizeof error)) {
        fprintf(stderr, "samplers: %s\n", error);
        exit(EXIT_FAILURE);
    }
    image_clean(&s.map);
    s.view = bench_view(&s.map);
    if (!baseline_cdf_create(s.map.rgb, s.map.width, s.map.height, &cdf))
        fail(name, "the map is black, or memory short");
    progress_end(shown);
    print_methods(&s, &cdf);
    print_irradiance(&s, &cdf);
    print_mis(&s);
    baseline_cdf_destroy(&cdf);
    image_free(&s.map);
}

int main(int argc, char **argv)
{
    const int timed = !(argc > 1 && !strcmp(argv[1], "-q")), first = timed ? 1 : 2;
    progress shown = progress_start("samplers");

    if (argc > first + 1 || (argc > first && argv[first][0] == '-')) {
        fprintf(stderr, "usage: samplers [-q] [MAP]\n");
        return EXIT_FAILURE;
    }
    if (argc > first) {
        do_map(argv[first], timed, 0, 1, &shown);
    } else {
        do_map("sky", timed, 0, 2, &shown);
        do_map("studio", timed, 1, 2, &shown);
    }
    printf("sample: direction and pdf, two random numbers included. excess variance: of L/pdf,\n"
           "relative to the squared integral, 0 for the full CDF; largest L/pdf: relative to the\n"
           "integral. The CDF's KiB are 4 bytes a texel, without the densities that the one timed\n"
           "keeps beside. Times: medians of %d runs. RMSE of irradiance: relative, over %d\n"
           "normals and %d Owen-scrambled sets of N points. (*) as published: Ergun, Kurt, Ozturk\n"
           "2012.\n", ROUND_COUNT, IRRADIANCE_NORMALS, SCRAMBLINGS);
    return EXIT_SUCCESS;
}
