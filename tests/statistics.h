/* statistics.h: the statistical tests that the samplers' tests are built on.
 *
 *     stat_result result = stat_chi2_test(masses, hits, cell_count, NULL);
 *     CHECK(result.pass, "sky: %s, p = %g", stat_verdict_string(result.verdict), result.p);
 *
 * Every test here says "pass" only where it had the samples to say otherwise.
 */
#ifndef STATISTICS_H
#define STATISTICS_H

#include <stddef.h>

#define STAT_ALPHA        1e-6  /* chance that a correct sampler is rejected, per test */
#define STAT_MIN_EXPECTED 50.0  /* hits expected of a cell that is judged on its own */
#define STAT_MAX_POOLED   0.05  /* share of the mass that may lie in smaller cells */

typedef enum stat_verdict {
    STAT_PASS = 0,
    STAT_REJECTED,          /* p is below alpha */
    STAT_ZERO_CELL_HIT,     /* a hit where the expectation is zero: wrong at any p */
    STAT_TOO_FEW_SAMPLES,   /* too much of the mass is in cells too small to judge */
    STAT_BAD_INPUT          /* a negative or non-finite number, or no mass at all */
} stat_verdict;

typedef struct stat_options {
    double alpha;           /* STAT_ALPHA */
    double min_expected;    /* STAT_MIN_EXPECTED */
    double max_pooled;      /* STAT_MAX_POOLED */
} stat_options;

typedef struct stat_result {
    double chi2, dof;
    double p;               /* chance of a larger chi2 from a correct sampler; 0 if not computed */
    size_t cells;           /* cells compared, after pooling */
    double pooled_mass;     /* share of the mass in pooled cells, 0..1 */
    stat_verdict verdict;
    int pass;               /* nonzero only for STAT_PASS */
} stat_result;

/* Upper tail of the chi-square distribution with `dof` > 0 degrees of freedom (need not be
   whole): the regularised upper incomplete gamma function Q(dof/2, chi2/2). Relative error
   below 1e-10 for tails down to 1e-12; NaN for NaN or dof <= 0. */
double stat_chi2_survival(double chi2, double dof);

/* Upper tail of the standard normal distribution. */
double stat_normal_survival(double z);

/* Pearson's chi-square test of `count` cells. `expected` are masses of any scale, taken times
   sum(observed) / sum(expected); `observed` are hit counts. A sample that lies in no cell must
   be counted by the caller. Cells that expect fewer than min_expected hits are pooled, in
   index order, into groups that reach it, so that dark cells are still compared with one
   another; the share that may be pooled is bounded. One lit cell alone passes with dof 0:
   all there is to test is that nothing else was hit. `options` NULL: the constants above. */
stat_result stat_chi2_test(const double *expected, const double *observed, size_t count,
                           const stat_options *options);
stat_options stat_defaults(void);
const char *stat_verdict_string(stat_verdict verdict);

/* Sidak: the level for each of `test_count` independent tests so that all together reject a
   correct sampler with probability `alpha`. */
double stat_sidak(double alpha, size_t test_count);

/* Running mean and variance by Welford's update; start from {0}. */
typedef struct stat_moments {
    double count, mean;
    double squares;         /* sum of squared distances to the mean */
} stat_moments;
void   stat_moments_add(stat_moments *moments, double value);
double stat_moments_variance(const stat_moments *moments);  /* unbiased; 0 below two values */

/* Two-sided p-value of a z-test that the mean of the values is `known`. `tolerance` is an
   absolute error that is forgiven before the test: float rounding in an estimator whose
   variance is nearly zero. 0 (a failure) for fewer than two values or a NaN. */
double stat_mean_test(const stat_moments *moments, double known, double tolerance);

/* Total variation distance of two vectors, each scaled to sum 1: 0 the same, 1 disjoint.
   NaN (fails every comparison) if a vector has no positive finite sum. */
double stat_total_variation(const double *a, const double *b, size_t count);

/* Kolmogorov-Smirnov distance of ascending values to the uniform distribution on [0,1], and
   the distance that `count` uniform values exceed with probability at most `alpha`
   [Dvoretzky, Kiefer, Wolfowitz; Massart's constant]. */
double stat_ks_distance(const double *sorted, size_t count);
double stat_ks_bound(size_t count, double alpha);

#endif
