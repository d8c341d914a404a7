/* test_material.c: the renderer's materials: sampling, densities and values fit one another, pairs
 * of directions may be exchanged, and no material reflects more than it gets. Needs no Embree.
 */
#include "../examples/render/material.h"
#include "../examples/render/vector.h"
#include "check.h"
#include "random.h"
#include "statistics.h"

#include <math.h>
#include <string.h>

#define ROWS 16                      /* cells of the hemisphere, in polar angle */
#define COLUMNS 32
#define CELLS (ROWS * COLUMNS)
#define PARTS 12                     /* points of a cell, each way, for sums over it */
#define DRAWS 300000
#define EYES 4

typedef struct subject { const char *name; material m; } subject;

#define SUBJECTS 8

static void make_subjects(subject list[SUBJECTS])
{
    static const float grey[3] = {0.4f, 0.5f, 0.3f}, dim[3] = {0.1f, 0.2f, 0.3f};
    static const float gold[3] = {1.0f, 0.78f, 0.34f};
    const subject all[SUBJECTS] = {
        {"Lambert", material_lambert(grey)},
        {"Ward 0.3", material_ward(dim, grey, 0.3f, 0.3f)},
        {"Ward 0.4, 0.12", material_ward(dim, dim, 0.4f, 0.12f)},
        {"Ward 0.1", material_ward(dim, grey, 0.1f, 0.1f)},
        {"conductor 0.5", material_conductor(gold, 0.5f, 0.5f)},
        {"conductor 0.1, 0.35", material_conductor(gold, 0.1f, 0.35f)},
        {"plastic 0.15", material_plastic(grey, 1.5f, 0.15f)},
        {"plastic 0.6", material_plastic(grey, 1.8f, 0.6f)}
    };

    memcpy(list, all, sizeof all);
}

/* From the normal to near the horizon, at any azimuth. */
static void make_eye(int number, float eye[3])
{
    static const float cosines[EYES] = {0.98f, 0.7f, 0.4f, 0.15f};
    const float z = cosines[number], level = sqrtf(1.0f - z * z);

    vec_set(eye, level * cosf(1.0f + (float)number), level * sinf(1.0f + (float)number), z);
}

static void dir_of(double theta, double phi, float dir[3])
{
    vec_set(dir, (float)(sin(theta) * cos(phi)), (float)(sin(theta) * sin(phi)),
            (float)cos(theta));
}

/* ---- sums over the hemisphere ---- */

/* The integral of the density over each cell, and of BRDF x cosine (green) over all. */
static void sum_cells(const material *m, const float eye[3], double masses[CELLS], double *f_sum)
{
    const double high = 0.5 * 3.14159265358979 / (ROWS * PARTS);
    const double wide = 2.0 * 3.14159265358979 / (COLUMNS * PARTS);
    int i, row, column;

    for (i = 0; i < CELLS; i++)
        masses[i] = 0.0;
    *f_sum = 0.0;
    for (row = 0; row < ROWS * PARTS; row++)
        for (column = 0; column < COLUMNS * PARTS; column++) {
            const double theta = (row + 0.5) * high, sr = sin(theta) * high * wide;
            float light[3], f[3];

            dir_of(theta, (column + 0.5) * wide, light);
            material_eval(m, eye, light, f);
            masses[row / PARTS * COLUMNS + column / PARTS]
                += sr * (double)material_pdf(m, eye, light);
            *f_sum += sr * (double)f[1];
        }
}

static int cell_of(const float dir[3])
{
    const double theta = acos((double)fminf(dir[2], 1.0f));
    const double turn = atan2((double)dir[1], (double)dir[0]) / (2.0 * 3.14159265358979);
    const int row = (int)(theta * 2.0 / 3.14159265358979 * ROWS);
    const int column = (int)((turn < 0.0 ? turn + 1.0 : turn) * COLUMNS);

    return (row < ROWS ? row : ROWS - 1) * COLUMNS + (column < COLUMNS ? column : COLUMNS - 1);
}

/* ---- samples ---- */

typedef struct draws {
    double hits[CELLS + 1];          /* the last: below the surface */
    stat_moments weight;             /* of BRDF x cosine / density, green */
    double largest;                  /* difference to the density of material_pdf, relative */
} draws;

static void draw_all(const material *m, const float eye[3], draws *d)
{
    pcg32 random = pcg32_make(7, 3);
    int i;

    memset(d, 0, sizeof *d);
    for (i = 0; i < DRAWS; i++) {
        float u[2], light[3], f[3], pdf;

        u[0] = pcg32_float(&random);
        u[1] = pcg32_float(&random);
        if (!material_sample(m, eye, u, light, &pdf)) {
            d->hits[CELLS] += 1.0;
            stat_moments_add(&d->weight, 0.0);
            continue;
        }
        material_eval(m, eye, light, f);
        d->hits[cell_of(light)] += 1.0;
        d->largest = fmax(d->largest,
                          fabs((double)(material_pdf(m, eye, light) / pdf) - 1.0));
        stat_moments_add(&d->weight, (double)(f[1] / pdf));
    }
}

/* The share below the surface is what the density leaves of 1; where that is rounding, or the error
   of the sum over cells, none. */
static stat_result compare(const double masses[CELLS], const draws *d)
{
    double all[CELLS + 1], left = 1.0;
    int i;

    for (i = 0; i < CELLS; i++) {
        all[i] = masses[i];
        left -= masses[i];
    }
    all[CELLS] = d->hits[CELLS] > 0.0 && left > 0.0 ? left : 0.0;
    return stat_chi2_test(all, d->hits, CELLS + 1, NULL);
}

static void test_sampling(const subject *s)
{
    double masses[CELLS], f_sum, sum;
    stat_result result;
    float eye[3];
    draws d;
    int k, i;

    for (k = 0; k < EYES; k++) {
        make_eye(k, eye);
        sum_cells(&s->m, eye, masses, &f_sum);
        draw_all(&s->m, eye, &d);
        result = compare(masses, &d);
        for (i = 0, sum = d.hits[CELLS] / DRAWS; i < CELLS; i++)
            sum += masses[i];
        CHECK(result.pass, "%s, eye %d: samples have the density: %s, p = %.3g, %.4f below",
              s->name, k, stat_verdict_string(result.verdict), result.p, d.hits[CELLS] / DRAWS);
        CHECK(IS_NEAR(sum, 1.0, 5e-3), "%s, eye %d: density and samples below come to %.4f",
              s->name, k, sum);
        CHECK(d.largest < 1e-6, "%s, eye %d: a sample's density is that of its direction",
              s->name, k);
        CHECK(stat_mean_test(&d.weight, f_sum, 1e-3 * f_sum) > STAT_ALPHA,
              "%s, eye %d: samples reflect %.4f, the sum over directions %.4f", s->name, k,
              d.weight.mean, f_sum);
        CHECK(stat_mean_test(&d.weight, 1.02 * f_sum, 1e-3 * f_sum) < STAT_ALPHA,
              "%s, eye %d: of 2 %% more that is rejected", s->name, k);
    }
}

/* ---- controls ---- */

static void test_controls(const subject *s)
{
    double masses[CELLS], f_sum;
    material other = s->m;
    stat_result result;
    float eye[3], turned[3];
    draws d;

    make_eye(1, eye);
    draw_all(&s->m, eye, &d);
    if (s->m.kind != MATERIAL_LAMBERT) {
        const float more = s->m.kind == MATERIAL_PLASTIC ? 0.25f : 0.05f;  /* few of its samples */

        other.alpha[0] *= 1.0f + more;
        sum_cells(&other, eye, masses, &f_sum);
        result = compare(masses, &d);
        CHECK(result.verdict == STAT_REJECTED, "%s: the density of %.0f %% more roughness: %s",
              s->name, 100.0 * (double)more, stat_verdict_string(result.verdict));
        vec_set(turned, eye[1], eye[0], eye[2]);
        sum_cells(&s->m, turned, masses, &f_sum);
        result = compare(masses, &d);
        CHECK(result.verdict == STAT_REJECTED, "%s: the density of another eye: %s", s->name,
              stat_verdict_string(result.verdict));
    }
    sum_cells(&s->m, eye, masses, &f_sum);
    masses[3 * COLUMNS] += 0.01;
    result = compare(masses, &d);
    CHECK(!result.pass, "%s: 1 %% more in one cell: %s", s->name,
          stat_verdict_string(result.verdict));
}

/* ---- values ---- */

static void draw_dir(pcg32 *random, float dir[3])
{
    const float z = 0.02f + 0.98f * pcg32_float(random), level = sqrtf(fmaxf(1.0f - z * z, 0.0f));
    const float turn = 2.0f * VEC_PI * pcg32_float(random);

    vec_set(dir, level * cosf(turn), level * sinf(turn), z);
}

static void test_reciprocity(const subject *s)
{
    pcg32 random = pcg32_make(11, 5);
    float a[3], b[3], there[3], back[3], low[3];
    double worst = 0.0, least = 0.0;
    int i, c;

    for (i = 0; i < 20000; i++) {
        draw_dir(&random, a);
        draw_dir(&random, b);
        material_eval(&s->m, a, b, there);
        material_eval(&s->m, b, a, back);
        for (c = 0; c < 3; c++) {
            const double x = (double)(there[c] / b[2]), y = (double)(back[c] / a[2]);

            worst = fmax(worst, fabs(x - y) / fmax(fmax(x, y), 1e-3));
            least = fmin(least, x);
        }
    }
    CHECK(worst < 2e-3 && least >= 0.0, "%s: directions may be exchanged, within %.2g", s->name,
          worst);
    draw_dir(&random, a);
    vec_set(low, a[0], a[1], -a[2]);
    material_eval(&s->m, a, low, there);
    material_eval(&s->m, low, a, back);
    CHECK(IS(there[0] + there[1] + there[2] + back[0] + back[1] + back[2], 0)
          && IS(material_pdf(&s->m, a, low), 0) && IS(material_pdf(&s->m, low, a), 0),
          "%s: nothing from below the surface, or to there", s->name);
}

/* The largest share that is reflected, seen from any of 12 angles. */
static double largest_albedo(const material *m)
{
    double masses[CELLS], sum, largest = 0.0;
    int i;

    for (i = 0; i < 12; i++) {
        const float z = ((float)i + 0.5f) / 12.0f, level = sqrtf(1.0f - z * z);
        const float eye[3] = {level * 0.6f, level * 0.8f, z};

        sum_cells(m, eye, masses, &sum);
        largest = fmax(largest, sum);
    }
    return largest;
}

static void test_energy(void)
{
    static const float white[3] = {1.0f, 1.0f, 1.0f}, black[3] = {0.0f, 0.0f, 0.0f};
    static const float half[3] = {0.5f, 0.5f, 0.5f};
    const subject all[] = {
        {"Lambert", material_lambert(white)},
        {"Ward 0.15", material_ward(black, white, 0.15f, 0.15f)},
        {"Ward 0.5, 0.2", material_ward(half, half, 0.5f, 0.2f)},
        {"conductor 0.2", material_conductor(white, 0.2f, 0.2f)},
        {"conductor 0.7, 0.3", material_conductor(white, 0.7f, 0.3f)},
        {"plastic 0.1", material_plastic(white, 1.5f, 0.1f)},
        {"plastic 0.5", material_plastic(white, 1.5f, 0.5f)},
        {"plastic 0.3, dense", material_plastic(white, 2.4f, 0.3f)}
    };
    const material more = material_ward(half, white, 0.3f, 0.3f);
    double albedo;
    size_t i;

    for (i = 0; i < sizeof all / sizeof all[0]; i++) {
        albedo = largest_albedo(&all[i].m);
        CHECK(albedo < 1.003 && albedo > 0.7, "%s, white: reflects at most %.4f", all[i].name,
              albedo);
    }
    albedo = largest_albedo(&more);
    CHECK(albedo > 1.2, "a material made to reflect more reflects %.3f", albedo);
}

int main(void)
{
    subject list[SUBJECTS];
    int i;

    make_subjects(list);
    for (i = 0; i < SUBJECTS; i++) {
        test_sampling(&list[i]);
        test_controls(&list[i]);
        test_reciprocity(&list[i]);
    }
    test_energy();
    return check_done();
}
