/* statistics.c: see statistics.h. */
#include "statistics.h"

#include <math.h>

#define STAT_TWO_PI     6.283185307179586476925
#define STAT_EPSILON    1e-16   /* where a series or fraction has settled */
#define STAT_ITERATIONS 10000000

/* ---- distributions ---- */

/* x^a e^-x / Gamma(a). For large a the three factors overflow and their logarithms cancel, so
   Stirling's series takes the place of lgamma. */
static double gamma_kernel(double a, double x)
{
    double t, i, stirling;

    if (a < 16.0)
        return exp(a * log(x) - x - lgamma(a));
    t = (x - a) / a;
    i = 1.0 / (a * a);
    stirling = (1.0 / 12.0 - i * (1.0 / 360.0 - i * (1.0 / 1260.0 - i / 1680.0))) / a;
    return sqrt(a / STAT_TWO_PI) * exp(a * (log1p(t) - t) - stirling);
}

/* P(a,x) / kernel = sum of x^n / (a (a+1) ... (a+n)); quick for x < a + 1. */
static double gamma_series(double a, double x)
{
    double term = 1.0 / a, sum = term;
    int n;

    for (n = 1; n < STAT_ITERATIONS && term > sum * STAT_EPSILON; n++) {
        term *= x / (a + n);
        sum += term;
    }
    return sum;
}

/* Q(a,x) / kernel by its continued fraction, evaluated forward (Lentz's method); quick for
   x >= a + 1, where no denominator comes near zero. */
static double gamma_fraction(double a, double x)
{
    double b = x + 1.0 - a, c = 1e300, d = 1.0 / b, value = d;
    int i;

    for (i = 1; i < STAT_ITERATIONS; i++) {
        double numerator = i * (a - i), factor;

        b += 2.0;
        d = 1.0 / (b + numerator * d);
        c = b + numerator / c;
        factor = c * d;
        value *= factor;
        if (fabs(factor - 1.0) <= STAT_EPSILON)
            break;
    }
    return value;
}

double stat_chi2_survival(double chi2, double dof)
{
    double a = 0.5 * dof, x = 0.5 * chi2;

    if (isnan(chi2) || !(dof > 0.0))
        return (double)NAN;
    if (x <= 0.0)
        return 1.0;
    if (isinf(x))
        return 0.0;
    if (x < a + 1.0)
        return 1.0 - gamma_kernel(a, x) * gamma_series(a, x);
    return gamma_kernel(a, x) * gamma_fraction(a, x);
}

double stat_normal_survival(double z)
{
    return 0.5 * erfc(z / sqrt(2.0));
}

/* ---- chi-square test ---- */

typedef struct stat_cell {
    double expected, observed;
} stat_cell;

/* The last cell is held back, so that what is left in the pool at the end can join it. */
typedef struct stat_tally {
    double chi2;
    size_t cells;
    stat_cell last, pool;
    double pooled;
} stat_tally;

static double cell_chi2(stat_cell cell)
{
    double difference = cell.observed - cell.expected;

    return cell.expected > 0.0 ? difference * difference / cell.expected : 0.0;
}

static void tally_cell(stat_tally *tally, stat_cell cell)
{
    tally->chi2 += cell_chi2(tally->last);
    tally->last = cell;
    tally->cells++;
}

static void tally_small_cell(stat_tally *tally, stat_cell cell, double min_expected)
{
    tally->pooled += cell.expected;
    tally->pool.expected += cell.expected;
    tally->pool.observed += cell.observed;
    if (tally->pool.expected >= min_expected) {
        tally_cell(tally, tally->pool);
        tally->pool.expected = tally->pool.observed = 0.0;
    }
}

static void tally_finish(stat_tally *tally)
{
    tally->last.expected += tally->pool.expected;
    tally->last.observed += tally->pool.observed;
    tally->chi2 += cell_chi2(tally->last);
}

/* Sums both vectors and counts the cells that can be hit; says what alone decides the test. */
static stat_verdict survey(const double *expected, const double *observed, size_t count,
                           stat_cell *sum, size_t *lit)
{
    stat_verdict verdict = STAT_PASS;
    size_t i;

    sum->expected = sum->observed = 0.0;
    *lit = 0;
    for (i = 0; i < count; i++) {
        if (!(expected[i] >= 0.0) || !(observed[i] >= 0.0))
            return STAT_BAD_INPUT;
        sum->expected += expected[i];
        sum->observed += observed[i];
        *lit += expected[i] > 0.0;
        if (expected[i] <= 0.0 && observed[i] > 0.0)
            verdict = STAT_ZERO_CELL_HIT;
    }
    if (!(sum->expected > 0.0) || isinf(sum->expected) || isinf(sum->observed))
        return STAT_BAD_INPUT;
    return verdict;
}

static void judge(stat_result *result, const stat_tally *tally, double total, size_t lit,
                  const stat_options *options)
{
    int lone = lit == 1 && tally->cells == 1;

    result->chi2 = tally->chi2;
    result->cells = tally->cells;
    result->dof = tally->cells > 1 ? (double)(tally->cells - 1) : 0.0;
    result->pooled_mass = total > 0.0 ? tally->pooled / total : 1.0;
    if (result->pooled_mass > options->max_pooled || (tally->cells < 2 && !lone)) {
        result->verdict = STAT_TOO_FEW_SAMPLES;
        return;
    }
    result->p = lone ? 1.0 : stat_chi2_survival(result->chi2, result->dof);
    result->verdict = result->p >= options->alpha ? STAT_PASS : STAT_REJECTED;
    result->pass = result->verdict == STAT_PASS;
}

stat_result stat_chi2_test(const double *expected, const double *observed, size_t count,
                           const stat_options *options)
{
    static const stat_tally empty_tally;
    static const stat_result empty_result;
    stat_options defaults = stat_defaults();
    stat_result result = empty_result;
    stat_tally tally = empty_tally;
    stat_cell sum, cell;
    size_t i, lit;

    if (!options)
        options = &defaults;
    result.verdict = survey(expected, observed, count, &sum, &lit);
    if (result.verdict != STAT_PASS)
        return result;
    for (i = 0; i < count; i++) {
        cell.expected = expected[i] / sum.expected * sum.observed;
        cell.observed = observed[i];
        if (cell.expected >= options->min_expected)
            tally_cell(&tally, cell);
        else
            tally_small_cell(&tally, cell, options->min_expected);
    }
    tally_finish(&tally);
    judge(&result, &tally, sum.observed, lit, options);
    return result;
}

stat_options stat_defaults(void)
{
    stat_options options = { STAT_ALPHA, STAT_MIN_EXPECTED, STAT_MAX_POOLED };

    return options;
}

const char *stat_verdict_string(stat_verdict verdict)
{
    switch (verdict) {
    case STAT_PASS: return "pass";
    case STAT_REJECTED: return "rejected";
    case STAT_ZERO_CELL_HIT: return "a cell of zero expectation was hit";
    case STAT_TOO_FEW_SAMPLES: return "not enough samples";
    case STAT_BAD_INPUT: return "bad input";
    }
    return "unknown verdict";
}

double stat_sidak(double alpha, size_t test_count)
{
    return -expm1(log1p(-alpha) / (double)test_count);
}

/* ---- means ---- */

void stat_moments_add(stat_moments *moments, double value)
{
    double difference = value - moments->mean;

    moments->count += 1.0;
    moments->mean += difference / moments->count;
    moments->squares += difference * (value - moments->mean);
}

double stat_moments_variance(const stat_moments *moments)
{
    return moments->count > 1.0 ? moments->squares / (moments->count - 1.0) : 0.0;
}

double stat_mean_test(const stat_moments *moments, double known, double tolerance)
{
    double deviation = fabs(moments->mean - known) - tolerance;
    double error = sqrt(stat_moments_variance(moments) / moments->count);

    if (moments->count < 2.0 || isnan(deviation) || isnan(error))
        return 0.0;
    if (deviation <= 0.0)
        return 1.0;
    return error > 0.0 ? 2.0 * stat_normal_survival(deviation / error) : 0.0;
}

/* ---- distances ---- */

static double vector_sum(const double *values, size_t count)
{
    double sum = 0.0;
    size_t i;

    for (i = 0; i < count; i++)
        sum += values[i];
    return sum;
}

double stat_total_variation(const double *a, const double *b, size_t count)
{
    double a_sum = vector_sum(a, count), b_sum = vector_sum(b, count), distance = 0.0;
    size_t i;

    if (!(a_sum > 0.0) || !(b_sum > 0.0) || isinf(a_sum) || isinf(b_sum))
        return (double)NAN;
    for (i = 0; i < count; i++)
        distance += fabs(a[i] / a_sum - b[i] / b_sum);
    return 0.5 * distance;
}

double stat_ks_distance(const double *sorted, size_t count)
{
    double n = (double)count, distance = 0.0;
    size_t i;

    for (i = 0; i < count; i++) {
        distance = fmax(distance, (double)(i + 1) / n - sorted[i]);
        distance = fmax(distance, sorted[i] - (double)i / n);
    }
    return distance;
}

double stat_ks_bound(size_t count, double alpha)
{
    return sqrt(log(2.0 / alpha) / (2.0 * (double)count));
}
