/* figures.c: what kd tables cost in variance, map by map, beside brute-force minima of the fits.
 *
 *     figures            prints tables on stdout, progress on stderr; takes a few minutes
 *
 * Reads the real maps that `make data` fetches, or, where one is missing, takes made-up maps.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "../examples/common/maps.h"
#include "../tests/kd_reference.h"

#define BLOCKS 6144
#define MADE_COUNT 4
#define MAPS_MAX REFERENCE_REAL_COUNT
#define SIZES 4                 /* block counts at which L1 is compared with a scan */

static const int sizes[SIZES] = { 16, 256, 6144, 65536 };

enum {
    SSE = 0, VARIANCE, RANGE, EXCESS,               /* excess variance of ALIAS */
    LOG_L1, LOG_CHI2, POWER_L1, POWER_CHI2,         /* and of FIT */
    ALPHA, BETA, L1,                                /* LOG L1; beta of POWER CHI2 */
    RATIO, RATIO_FIT,                               /* largest L / (pdf integral) */
    DRAWN, DRAWN_FIT,                               /* total variation over all u0 */
    LEAST, GAP = LEAST + SIZES,                     /* least L1 of a scan; worst gap above it */
    COLUMNS
};

static const char *const headings[COLUMNS] = {
    "SSE", "VARIANCE", "RANGE", "EXCESS", "LOG L1", "LOG CHI2", "POW L1", "POW CHI2",
    "alpha", "beta", "l1", "ratio", "fit ratio", "drawn", "fit drawn",
    "l1 16", "l1 256", "l1 6144", "l1 65536", "worst gap"
};

typedef struct row { double value[COLUMNS]; } row;

static const char *made_name(int index)
{
    static const char *const names[MADE_COUNT] = { "sky", "studio", "night", "foliage" };

    return names[index];
}

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

/* ---- printing ---- */

static void print_value(int column, double value)
{
    if (column == ALPHA || column == BETA || column == RATIO || column == RATIO_FIT)
        printf(" %9.3g", value);
    else if (column == DRAWN || column == DRAWN_FIT || column == GAP)
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
    double sorted[MAPS_MAX];
    int i, k;

    for (k = 0; k < COLUMNS; k++) {
        for (i = 0; i < count; i++)
            sorted[i] = rows[i].value[k];
        qsort(sorted, (size_t)count, sizeof *sorted, reference_falling);
        maximum->value[k] = sorted[0];
        median->value[k] = 0.5 * (sorted[(count - 1) / 2] + sorted[count / 2]);
    }
}

static void print_table(const char *title, const char *const *names, const row *rows, int count,
                        int from, int to)
{
    row median, maximum;
    int i;

    printf("\n%s\n\n%-10s", title, "map");
    for (i = from; i < to; i++)
        printf(" %9s", headings[i]);
    printf("\n");
    for (i = 0; i < count; i++)
        print_row(names[i], &rows[i], from, to);
    summarise(rows, count, &median, &maximum);
    print_row("median", &median, from, to);
    print_row("maximum", &maximum, from, to);
}

static int real_maps_present(void)
{
    image map;
    int i;

    for (i = 0; i < REFERENCE_REAL_COUNT; i++) {
        if (!reference_real_map(i, &map))
            return 0;
        image_free(&map);
    }
    return 1;
}

static int fill(int index, int real, const char **name, row *out)
{
    image map;

    memset(out, 0, sizeof *out);
    *name = real ? reference_real_name(index) : made_name(index);
    fprintf(stderr, "%s\n", *name);
    if (!(real ? reference_real_map(index, &map) : map_make(*name, 512, 256, &map)))
        return 0;
    fill_alias(&map, out);
    fill_fits(&map, out);
    fill_gaps(&map, out);
    image_free(&map);
    return 1;
}

int main(void)
{
    const int real = real_maps_present(), count = real ? REFERENCE_REAL_COUNT : MADE_COUNT;
    const char *names[MAPS_MAX];
    row rows[MAPS_MAX];
    int i;

    for (i = 0; i < count; i++)
        if (!fill(i, real, &names[i], &rows[i])) {
            fprintf(stderr, "figures: %s: cannot be made or read\n", names[i]);
            return 1;
        }
    printf("%d %s maps of 512x256, %d blocks\n", count,
           real ? "real" : "made-up (for the real ones: make data)", BLOCKS);
    print_table("Excess variance of ALIAS by criterion, and of FIT by model and objective "
                "(LOG L1: as published)", names, rows, count, SSE, ALPHA);
    print_table("LOG L1: alpha and l1; POWER CHI2: beta; largest L/(pdf integral), and total\n"
                "variation of the blocks that all 2^24 values of u0 draw, ALIAS and LOG L1",
                names, rows, count, ALPHA, LEAST);
    print_table("LOG L1: least l1 of a scan of alpha, by block count, and the worst relative gap "
                "of the fit", names, rows, count, LEAST, COLUMNS);
    return 0;
}
