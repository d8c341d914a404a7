/* test_statistics.c: the statistical tests, tested: known values, and that each accepts what
 * is right and rejects what is wrong. Seeds are fixed, so a run gives the same answer always.
 */
#include "check.h"
#include "statistics.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#define CELL_MAX 400
#define PI       3.14159265358979323846

static uint64_t random_state;

/* splitmix64, the upper 53 bits as a number in [0,1). */
static double random_unit(void)
{
    uint64_t z = random_state += UINT64_C(0x9e3779b97f4a7c15);

    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return (double)((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

static double relative_error(double value, double reference)
{
    return fabs(value - reference) / fabs(reference);
}

/* ---- distributions ---- */

/* Q(n, h) for whole n, h > 0: e^-h sum of h^k / k!, each term through its logarithm. */
static double even_survival(double chi2, int dof)
{
    double h = 0.5 * chi2, sum = 0.0;
    int k;

    for (k = 0; k < dof / 2; k++)
        sum += exp(k * log(h) - h - lgamma(k + 1.0));
    return sum;
}

static void test_chi2_closed_forms(void)
{
    static const double chi2[] = { 1e-6, 0.1, 1.0, 2.9, 3.1, 7.5, 24.0, 40.0, 55.2, 200.0 };
    double worst[4] = { 0.0, 0.0, 0.0, 0.0 };
    size_t i;

    for (i = 0; i < sizeof chi2 / sizeof chi2[0]; i++) {
        double x = chi2[i], one = erfc(sqrt(0.5 * x));
        double three = one + sqrt(2.0 * x / PI) * exp(-0.5 * x);

        worst[0] = fmax(worst[0], relative_error(stat_chi2_survival(x, 1.0), one));
        worst[1] = fmax(worst[1], relative_error(stat_chi2_survival(x, 2.0), exp(-0.5 * x)));
        worst[2] = fmax(worst[2], relative_error(stat_chi2_survival(x, 3.0), three));
        worst[3] = fmax(worst[3], relative_error(stat_chi2_survival(x, 10.0),
                                                 even_survival(x, 10)));
    }
    CHECK(worst[0] < 1e-10, "dof 1 is erfc, relative error %.1e", worst[0]);
    CHECK(worst[1] < 1e-10, "dof 2 is exp(-x/2), relative error %.1e", worst[1]);
    CHECK(worst[2] < 1e-10, "dof 3 in closed form, relative error %.1e", worst[2]);
    CHECK(worst[3] < 1e-10, "dof 10 in closed form, relative error %.1e", worst[3]);
}

static void test_chi2_large_dof(void)
{
    static const int dofs[] = { 30, 34, 400, 12000 };
    static const double steps[] = { -4.0, -1.0, 0.0, 0.05, 1.0, 4.0, 7.0 };
    double worst = 0.0, tail = 1.0;
    size_t i, j;

    for (i = 0; i < sizeof dofs / sizeof dofs[0]; i++)
        for (j = 0; j < sizeof steps / sizeof steps[0]; j++) {
            double dof = dofs[i], x = fmax(1.0, dof + steps[j] * sqrt(2.0 * dof));
            double reference = even_survival(x, dofs[i]);

            worst = fmax(worst, relative_error(stat_chi2_survival(x, dof), reference));
            tail = fmin(tail, reference);
        }
    CHECK(worst < 1e-9, "dof 30 to 12000, relative error %.1e", worst);
    CHECK(tail < 1e-10, "those reach a tail of %.1e", tail);
}

static void test_chi2_table(void)
{
    double p05 = stat_chi2_survival(11.070497693516351, 5.0);
    double p01 = stat_chi2_survival(135.80672317102676, 100.0);
    double fraction = stat_chi2_survival(1.0 + 1e-9, 0.5) - stat_chi2_survival(1.0, 0.5);

    CHECK(fabs(p05 - 0.05) < 1e-9, "5 %% point of dof 5: %.12f", p05);
    CHECK(fabs(p01 - 0.01) < 1e-9, "1 %% point of dof 100: %.12f", p01);
    CHECK(fraction < 0.0 && fraction > -1e-9, "a fractional dof falls, by %.2e", fraction);
    CHECK(IS(stat_chi2_survival(0.0, 7.0), 1.0), "all mass lies above 0");
    CHECK(IS(stat_chi2_survival((double)INFINITY, 7.0), 0.0), "none lies above infinity");
    CHECK(isnan(stat_chi2_survival(1.0, 0.0)), "dof 0 is NaN");
    CHECK(isnan(stat_chi2_survival((double)NAN, 7.0)), "a NaN stays one");
}

static void test_normal(void)
{
    double p = stat_normal_survival(1.959963984540054);
    double tail = stat_normal_survival(7.034483825301131);

    CHECK(IS(stat_normal_survival(0.0), 0.5), "half lies above 0");
    CHECK(fabs(p - 0.025) < 1e-12, "2.5 %% lie above 1.96: %.15f", p);
    CHECK(relative_error(tail, 1e-12) < 1e-9, "1e-12 lie above 7.03: %.12e", tail);
    CHECK(relative_error(2.0 * stat_normal_survival(3.0), stat_chi2_survival(9.0, 1.0)) < 1e-10,
          "z squared is chi-square of dof 1");
}

/* ---- chi-square test ---- */

static void fill(double *values, size_t count, double value)
{
    size_t i;

    for (i = 0; i < count; i++)
        values[i] = value;
}

/* Throws `n` uniform samples into `count` equal cells; of those in cell `victim`, a share
   `moved` goes to its neighbour. */
static void throw_samples(double *observed, size_t count, size_t n, size_t victim, double moved)
{
    size_t i;

    fill(observed, count, 0.0);
    for (i = 0; i < n; i++) {
        size_t cell = (size_t)(random_unit() * (double)count);

        if (cell == victim && moved > 0.0 && random_unit() < moved)
            cell = (cell + 1) % count;
        observed[cell] += 1.0;
    }
}

static void test_chi2_arithmetic(void)
{
    static const double expected[] = { 1.0, 2.0, 3.0 }, observed[] = { 110.0, 190.0, 300.0 };
    stat_result result = stat_chi2_test(expected, observed, 3, NULL);

    CHECK(fabs(result.chi2 - 1.5) < 1e-12, "10^2/100 + 10^2/200 is %g", result.chi2);
    CHECK(result.dof == 2.0 && result.cells == 3, "3 cells, dof %g", result.dof);
    CHECK(fabs(result.p - exp(-0.75)) < 1e-12, "p is exp(-3/4): %.12f", result.p);
    CHECK(result.pass && IS(result.pooled_mass, 0.0), "it passes, nothing pooled");
}

static void test_chi2_accepts_and_rejects(void)
{
    enum { COUNT = 64, SAMPLES = 10000000 };
    double expected[COUNT], observed[COUNT];
    stat_result result;

    random_state = 1;
    fill(expected, COUNT, 1.0 / COUNT);
    throw_samples(observed, COUNT, SAMPLES, 0, 0.0);
    result = stat_chi2_test(expected, observed, COUNT, NULL);
    CHECK(result.pass, "uniform samples are accepted, p = %.3f", result.p);
    throw_samples(observed, COUNT, SAMPLES, 17, 0.02);
    result = stat_chi2_test(expected, observed, COUNT, NULL);
    CHECK(result.verdict == STAT_REJECTED && !result.pass,
          "a cell 2 %% too dark is rejected, p = %.1e", result.p);
    throw_samples(observed, COUNT, SAMPLES / 10000, 17, 0.02);
    result = stat_chi2_test(expected, observed, COUNT, NULL);
    CHECK(result.verdict == STAT_TOO_FEW_SAMPLES && !result.pass,
          "the same with 1000 samples: %s", stat_verdict_string(result.verdict));
}

static void test_chi2_zero_cell(void)
{
    double expected[] = { 1.0, 0.0, 1.0 }, observed[] = { 500000.0, 0.0, 500000.0 };
    stat_result result = stat_chi2_test(expected, observed, 3, NULL);

    CHECK(result.pass && IS(result.cells, 2), "a dark cell without hits is left out");
    observed[1] = 1.0;
    result = stat_chi2_test(expected, observed, 3, NULL);
    CHECK(result.verdict == STAT_ZERO_CELL_HIT && !result.pass, "one hit in a million there: %s",
          stat_verdict_string(result.verdict));
}

/* One bright cell and `CELL_MAX - 1` dark ones of 5 hits each: `pooled` of the mass. */
static stat_result pooled_test(double pooled, double observed_shift, const stat_options *options)
{
    static double expected[CELL_MAX], observed[CELL_MAX];
    double dark = 5.0 * (CELL_MAX - 1);
    size_t i;

    fill(expected, CELL_MAX, 5.0);
    fill(observed, CELL_MAX, 5.0);
    expected[0] = observed[0] = dark / pooled - dark;
    for (i = 1; i < CELL_MAX; i++)
        observed[i] += i < CELL_MAX / 2 ? observed_shift : 0.0;
    observed[0] -= observed_shift * (CELL_MAX / 2 - 1);
    return stat_chi2_test(expected, observed, CELL_MAX, options);
}

static void test_chi2_pooling(void)
{
    stat_options options = stat_defaults();
    stat_result result = pooled_test(0.049, 0.0, NULL);

    CHECK(result.pass && IS_NEAR(result.pooled_mass, 0.049, 1e-12), "4.9 %% may be pooled");
    CHECK(result.cells == 1 + 39, "399 dark cells make 39 beside the bright one: %d",
          (int)result.cells);
    result = pooled_test(0.051, 0.0, NULL);
    CHECK(result.verdict == STAT_TOO_FEW_SAMPLES && !result.pass, "5.1 %% may not: %s",
          stat_verdict_string(result.verdict));
    options.max_pooled = 0.06;
    result = pooled_test(0.051, 0.0, &options);
    CHECK(result.pass, "unless the options say so");
    result = pooled_test(0.049, 2.0, NULL);
    CHECK(result.verdict == STAT_REJECTED, "dark cells 40 %% too bright are seen, p = %.1e",
          result.p);
}

/* What is left in the pool joins a judged cell; it is neither dropped nor judged alone. */
static void test_chi2_leftover(void)
{
    static const double expected[] = { 600.0, 390.0, 10.0 }, observed[] = { 600.0, 370.0, 30.0 };
    stat_result result = stat_chi2_test(expected, observed, 3, NULL);

    CHECK(IS(result.cells, 2) && IS_NEAR(result.chi2, 0.0, 1e-12),
          "the leftover joins its neighbour");
    result = stat_chi2_test(expected + 1, observed + 1, 2, NULL);
    CHECK(result.verdict == STAT_TOO_FEW_SAMPLES, "one cell after pooling: %s",
          stat_verdict_string(result.verdict));
}

static void test_chi2_one_lit_cell(void)
{
    double expected[] = { 0.0, 3.0, 0.0 }, observed[] = { 0.0, 1000.0, 0.0 };
    stat_result result = stat_chi2_test(expected, observed, 3, NULL);

    CHECK(result.pass && IS(result.dof, 0.0) && IS(result.p, 1.0), "a lone lit cell passes");
    observed[1] = 49.0;
    result = stat_chi2_test(expected, observed, 3, NULL);
    CHECK(IS(result.verdict, STAT_TOO_FEW_SAMPLES), "not with 49 samples");
    observed[1] = 0.0;
    result = stat_chi2_test(expected, observed, 3, NULL);
    CHECK(IS(result.verdict, STAT_TOO_FEW_SAMPLES), "not with none");
    observed[2] = 1.0;
    result = stat_chi2_test(expected, observed, 3, NULL);
    CHECK(IS(result.verdict, STAT_ZERO_CELL_HIT), "and not with one elsewhere");
}

static void test_chi2_bad_input(void)
{
    static const double good[] = { 100.0, 100.0 }, zero[] = { 0.0, 0.0 };
    static const double negative[] = { 300.0, -100.0 };
    double broken[] = { 100.0, 0.0 };

    CHECK(IS(stat_chi2_test(zero, zero, 2, NULL).verdict, STAT_BAD_INPUT), "no mass");
    CHECK(IS(stat_chi2_test(good, negative, 2, NULL).verdict, STAT_BAD_INPUT), "negative hits");
    CHECK(IS(stat_chi2_test(negative, good, 2, NULL).verdict, STAT_BAD_INPUT), "negative mass");
    CHECK(IS(stat_chi2_test(good, good, 0, NULL).verdict, STAT_BAD_INPUT), "no cells");
    broken[1] = (double)NAN;
    CHECK(IS(stat_chi2_test(broken, good, 2, NULL).verdict, STAT_BAD_INPUT), "a NaN mass");
    CHECK(IS(stat_chi2_test(good, broken, 2, NULL).verdict, STAT_BAD_INPUT), "a NaN count");
    broken[1] = (double)INFINITY;
    CHECK(IS(stat_chi2_test(broken, good, 2, NULL).verdict, STAT_BAD_INPUT), "an infinite mass");
}

static int ascending(const void *a, const void *b)
{
    double left = *(const double *)a, right = *(const double *)b;

    return (left > right) - (left < right);
}

/* KS distance to uniform of the p-values of repeated tests, cell 0 short by `moved`. */
static double p_value_distance(size_t repeats, double moved)
{
    enum { COUNT = 20, SAMPLES = 4000, REPEAT_MAX = 2000 };
    static double p_values[REPEAT_MAX];
    double expected[COUNT], observed[COUNT];
    size_t i;

    fill(expected, COUNT, 1.0);
    for (i = 0; i < repeats; i++) {
        throw_samples(observed, COUNT, SAMPLES, 0, moved);
        p_values[i] = stat_chi2_test(expected, observed, COUNT, NULL).p;
    }
    qsort(p_values, repeats, sizeof p_values[0], ascending);
    return stat_ks_distance(p_values, repeats);
}

static void test_p_values_uniform(void)
{
    double bound = stat_ks_bound(2000, STAT_ALPHA), distance;

    random_state = 7;
    distance = p_value_distance(2000, 0.0);
    CHECK(distance < bound, "2000 p-values are uniform: %.4f < %.4f", distance, bound);
    distance = p_value_distance(2000, 0.1);
    CHECK(distance > bound, "with a cell 10 %% short they are not: %.4f", distance);
}

static void test_sidak(void)
{
    double each = stat_sidak(0.05, 10);

    CHECK(IS_NEAR(stat_sidak(0.05, 1), 0.05, 1e-16), "one test");
    CHECK(IS_NEAR(1.0 - pow(1.0 - each, 10.0), 0.05, 1e-14), "ten together reject at 5 %%");
    CHECK(each > 0.05 / 10.0 && each < 0.0052, "each at a little above 0.5 %%: %.6f", each);
    CHECK(relative_error(stat_sidak(1e-15, 1000000), 1e-21) < 1e-12, "tiny levels survive");
}

/* ---- means and distances ---- */

static void test_moments(void)
{
    static const double values[] = { 2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0 };
    stat_moments small = { 0.0, 0.0, 0.0 }, shifted = { 0.0, 0.0, 0.0 };
    size_t i;

    for (i = 0; i < 8; i++) {
        stat_moments_add(&small, values[i]);
        stat_moments_add(&shifted, values[i] + 1e9);
        if (i == 0)
            CHECK(IS(stat_moments_variance(&small), 0.0), "one value has variance 0");
    }
    CHECK(fabs(small.mean - 5.0) < 1e-14, "mean %.15f", small.mean);
    CHECK(IS_NEAR(stat_moments_variance(&small), 32.0 / 7.0, 1e-14), "variance 32/7");
    CHECK(relative_error(stat_moments_variance(&shifted), 32.0 / 7.0) < 1e-6,
          "an offset of 1e9 keeps it: %.9f", stat_moments_variance(&shifted));
}

static void test_mean(void)
{
    enum { SAMPLES = 1000000 };
    stat_moments moments = { 0.0, 0.0, 0.0 }, constant = { 0.0, 0.0, 0.0 };
    double p;
    int i;

    random_state = 3;
    CHECK(IS(stat_mean_test(&moments, 0.0, 0.0), 0.0), "no values are no pass");
    for (i = 0; i < SAMPLES; i++) {
        double x = random_unit();

        stat_moments_add(&moments, x * x);
    }
    p = stat_mean_test(&moments, 1.0 / 3.0, 0.0);
    CHECK(p > STAT_ALPHA, "the mean of x^2 is 1/3, p = %.3f", p);
    p = stat_mean_test(&moments, 1.0 / 3.0 * 1.01, 0.0);
    CHECK(p < STAT_ALPHA, "and not 1 %% more, p = %.1e", p);
    p = stat_mean_test(&moments, moments.mean + 2e-4, 0.0);
    CHECK(fabs(p - erfc(2e-4 / sqrt(2.0 * stat_moments_variance(&moments) / SAMPLES))) < 1e-9,
          "the p-value is two-sided: %.3f", p);
    CHECK(IS(stat_mean_test(&moments, (double)NAN, 0.0), 0.0), "a NaN is no pass");
    for (i = 0; i < 10; i++)
        stat_moments_add(&constant, 2.0);
    CHECK(IS(stat_mean_test(&constant, 2.0, 0.0), 1.0), "a constant has its own mean");
    CHECK(IS(stat_mean_test(&constant, 2.0 + 1e-9, 0.0), 0.0), "and no other");
    CHECK(IS(stat_mean_test(&constant, 2.0 + 1e-9, 1e-8), 1.0), "but for the tolerance");
}

static void test_total_variation(void)
{
    static const double a[] = { 1.0, 1.0, 0.0, 0.0 }, b[] = { 0.0, 0.0, 3.0, 3.0 };
    static const double c[] = { 2.0, 4.0, 2.0, 0.0 }, zero[] = { 0.0, 0.0, 0.0, 0.0 };

    CHECK(IS(stat_total_variation(a, a, 4), 0.0), "nothing lies between a vector and itself");
    CHECK(IS(stat_total_variation(a, b, 4), 1.0), "disjoint vectors are 1 apart");
    CHECK(IS_NEAR(stat_total_variation(a, c, 4), 0.25, 1e-15), "and those a quarter");
    CHECK(isnan(stat_total_variation(a, zero, 4)), "a vector without mass is NaN");
}

static void test_ks(void)
{
    static const double even[] = { 0.125, 0.375, 0.625, 0.875 }, low[] = { 0.0, 0.1, 0.2, 0.3 };
    static const double high[] = { 0.7, 0.8, 0.9, 1.0 };

    CHECK(IS_NEAR(stat_ks_distance(even, 4), 0.125, 1e-15), "even spacing is half a step off");
    CHECK(IS_NEAR(stat_ks_distance(low, 4), 0.7, 1e-15), "low values are seen");
    CHECK(IS_NEAR(stat_ks_distance(high, 4), 0.7, 1e-15), "high values are seen");
    CHECK(IS_NEAR(stat_ks_bound(200, 2.0 * exp(-4.0)), 0.1, 1e-12), "the bound of 200 values");
}

int main(void)
{
    test_chi2_closed_forms();
    test_chi2_large_dof();
    test_chi2_table();
    test_normal();
    test_chi2_arithmetic();
    test_chi2_accepts_and_rejects();
    test_chi2_zero_cell();
    test_chi2_pooling();
    test_chi2_leftover();
    test_chi2_one_lit_cell();
    test_chi2_bad_input();
    test_p_values_uniform();
    test_sidak();
    test_moments();
    test_mean();
    test_total_variation();
    test_ks();
    return check_done();
}
