/* test_lm_scales.c: 400 problems whose answer is known, with parameters and residuals from 1e-300
 * to 1e300. envsamp_lm ends each of them with the right answer or not converged, and most of them
 * with the right answer. With the argument `table` it prints them.
 *
 * A problem is written in numbers near 1: params = scale x u, residuals = size x g(u, offset). */
#ifndef HEADER      /* another version, to compare with */
#define HEADER "../envsamp.h"
#endif
#include HEADER

#include "check.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define MAX_PARAMS 5
#define MAX_RESIDUALS 12
#define ROWS 400
#define FAMILIES 25

typedef struct family family;

typedef struct row {
    const family *kind;
    double scale, size;         /* of parameters and of residuals */
    double offset;              /* what it means is the family's own matter */
    double start;               /* of all u, or the family's own where it is NAN */
} row;

struct family {
    const char *name;
    void (*fn)(const row *r, const double *u, double *g);
    int n, m;
    int least;                  /* of its rows must be solved: right and called converged */
    int never;                  /* what it ends at is no minimum: never called converged */
    double start[MAX_PARAMS], answer[MAX_PARAMS];
    double within[MAX_PARAMS];  /* of the answer, relative to it, absolute where it is 0 */
};

/* ---- families ---- */

static void shift(const row *r, const double *u, double *g)
{
    g[0] = u[0] - r->offset;
}

static void cube(const row *r, const double *u, double *g)
{
    (void)r;
    g[0] = u[0] * u[0] * u[0] - 1.0;
}

static void inverse(const row *r, const double *u, double *g)
{
    (void)r;
    g[0] = 1.0 / u[0] - 1.0;
}

static void root(const row *r, const double *u, double *g)
{
    (void)r;
    g[0] = sqrt(u[0]) - 1.0;            /* NaN below 0 */
}

static void kink(const row *r, const double *u, double *g)
{
    (void)r;
    g[0] = 1.0 + fabs(u[0] - 1.0);
}

static void bowl(const row *r, const double *u, double *g)
{
    (void)r;
    g[0] = 1.0 + (u[0] - 1.0) * (u[0] - 1.0);
}

static void unused(const row *r, const double *u, double *g)
{
    shift(r, u, g);
    g[1] = 0.5 * g[0];
}

static void line(const row *r, const double *u, double *g)
{
    int i;

    for (i = 0; i < 10; i++)
        g[i] = (u[0] - r->offset) + (u[1] - 3.0) * i;
}

/* As a user writes it: what a sum and a datum round to is all that is left of a residual. The
   pattern is at right angles to lines, so that the answer is that without it. */
static void noisy_line(const row *r, const double *u, double *g)
{
    static const double pattern[3] = { 1.0, -2.0, 1.0 };
    int i;

    for (i = 0; i < 9; i++)
        g[i] = (u[0] + u[1] * i) - (r->offset + 3.0 * i + pattern[i % 3]);
}

/* A constant that neither params nor residuals show: cancelled, it leaves its rounding. */
static void hidden(const row *r, const double *u, double *g)
{
    volatile double sum = u[0] + r->offset;

    g[0] = sum - (3.0 + r->offset);
}

static void exponential(const row *r, const double *u, double *g)
{
    (void)r;
    g[0] = exp(u[0] / 2.0) - 1.0;
    g[1] = 1e-3 * u[0];
}

static void logistic(const row *r, const double *u, double *g)
{
    (void)r;
    g[0] = 1.0 / (1.0 + exp(-u[0])) - 0.75;
}

static void decay(const row *r, const double *u, double *g)
{
    int i;

    (void)r;
    for (i = 0; i < 10; i++)
        g[i] = u[0] * exp(-u[1] * 0.3 * i) - exp(-0.3 * i);
}

static void power(const row *r, const double *u, double *g)
{
    int i;

    (void)r;
    for (i = 0; i < 8; i++)
        g[i] = u[0] * pow(1.0 + i, u[1]) - pow(1.0 + i, 1.5);
}

static void product(const row *r, const double *u, double *g)
{
    (void)r;
    g[0] = u[0] - 1.0;
    g[1] = u[1] - 2.0;
    g[2] = u[0] * u[1] - 2.0;
}

/* As Brown badly scaled: the offset is the size of one parameter and the inverse of the other's. */
static void unequal(const row *r, const double *u, double *g)
{
    g[0] = u[0] / r->offset - 1.0;
    g[1] = u[1] * r->offset - 2.0;
    g[2] = u[0] * u[1] - 2.0;
}

static void rosenbrock(const row *r, const double *u, double *g)
{
    (void)r;
    g[0] = 10.0 * (u[1] - u[0] * u[0]);
    g[1] = 1.0 - u[0];
}

static void freudenstein(const row *r, const double *u, double *g)
{
    (void)r;
    g[0] = -13.0 + u[0] + ((5.0 - u[1]) * u[1] - 2.0) * u[1];
    g[1] = -29.0 + u[0] + ((u[1] + 1.0) * u[1] - 14.0) * u[1];
}

/* A curve as in Misra 1a of NIST's StRD. */
static void saturation(const row *r, const double *u, double *g)
{
    int i;

    (void)r;
    for (i = 0; i < 12; i++)
        g[i] = u[0] * (1.0 - exp(-u[1] * 0.2 * (1 + i))) - (1.0 - exp(-0.2 * (1 + i)));
}

/* As Eckerle 4: height, place and width of a peak; the offset is added to its place. */
static void peak(const row *r, const double *u, double *g)
{
    int i;

    for (i = 0; i < 11; i++) {
        const double t = r->offset + 0.4 * (i - 5), at = (t - u[1]) / u[2];

        g[i] = u[0] * exp(-0.5 * at * at) - exp(-0.5 * (0.4 * (i - 5)) * (0.4 * (i - 5)));
    }
}

/* As Kowalik and Osborne (MGH 09). */
static void rational(const row *r, const double *u, double *g)
{
    int i;

    (void)r;
    for (i = 0; i < 10; i++) {
        const double t = 0.3 * (1 + i);

        g[i] = u[0] * t * (t + u[1]) / (t * (t + u[2]) + 1.0);
        g[i] -= t * (t + 1.0) / (t * (t + 1.0) + 1.0);
    }
}

/* Powers of t in 0..1: the condition number of the columns is 1e4. */
static void polynomial(const row *r, const double *u, double *g)
{
    int i, j;

    (void)r;
    for (i = 0; i < 12; i++) {
        double sum = 0.0;

        for (j = 4; j >= 0; j--)
            sum = sum * (i / 11.0) + (u[j] - 1.0);
        g[i] = sum;
    }
}

/* The first column is 1e8 times the second, and they are nearly parallel. */
static void parallel(const row *r, const double *u, double *g)
{
    (void)r;
    g[0] = 1e8 * (u[0] - 1.0) + (u[1] - 1.0);
    g[1] = 1e8 * (u[0] - 1.0) + 1.001 * (u[1] - 1.0);
}

static void wall(const row *r, const double *u, double *g)
{
    (void)r;
    g[0] = u[0] > 0.75 ? (double)NAN : u[0] - 1.0;
}

static void plateau(const row *r, const double *u, double *g)
{
    (void)r;
    g[0] = exp(-0.5 * (u[0] - 1e4) * (u[0] - 1e4)) - 1.0;
}

enum { CUBE, INVERSE, ROOT, KINK, BOWL, EXPONENTIAL, LOGISTIC, DECAY, POWER, PRODUCT, ROSENBROCK,
       FREUDENSTEIN, SATURATION, RATIONAL, POLYNOMIAL, PARALLEL, WALL, PLATEAU, PLAIN };

static const family plain[PLAIN] = {
    { "cube", cube, 1, 1, 11, 0, { 2 }, { 1 }, { 1e-9 } },
    { "inverse", inverse, 1, 1, 11, 0, { 0.25 }, { 1 }, { 1e-9 } },
    { "square root", root, 1, 1, 11, 0, { 9 }, { 1 }, { 1e-9 } },
    { "kink", kink, 1, 1, 0, 0, { 3 }, { 1 }, { 1e-6 } },
    { "bowl", bowl, 1, 1, 0, 0, { 3 }, { 1 }, { 1e-3 } },
    { "exp(p/2) - 1, 1e-3 p", exponential, 1, 2, 11, 0, { 1 }, { 0 }, { 1e-9 } },
    { "logistic", logistic, 1, 1, 5, 0, { 0 }, { 1.0986122886681098 }, { 1e-9 } },
    { "decay", decay, 2, 10, 12, 0, { 3, 0.2 }, { 1, 1 }, { 1e-7, 1e-7 } },
    { "power", power, 2, 8, 11, 0, { 2, 1 }, { 1, 1.5 }, { 1e-7, 1e-7 } },
    { "product", product, 2, 3, 12, 0, { 3, 3 }, { 1, 2 }, { 1e-9, 1e-9 } },
    { "Rosenbrock", rosenbrock, 2, 2, 16, 0, { -1.2, 1 }, { 1, 1 }, { 1e-7, 1e-7 } },
    { "Freudenstein, Roth", freudenstein, 2, 2, 11, 0, { 6, 5 }, { 5, 4 }, { 1e-7, 1e-7 } },
    { "saturation", saturation, 2, 12, 13, 0, { 2, 0.3 }, { 1, 1 }, { 1e-7, 1e-7 } },
    { "rational", rational, 3, 10, 11, 0, { 0.7, 0.5, 2 }, { 1, 1, 1 }, { 1e-5, 1e-5, 1e-5 } },
    { "polynomial", polynomial, 5, 12, 11, 0, { 0, 3, -2, 5, 0 }, { 1, 1, 1, 1, 1 },
      { 1e-6, 1e-6, 1e-6, 1e-6, 1e-6 } },
    { "parallel", parallel, 2, 2, 11, 0, { 0, 0 }, { 1, 1 }, { 1e-9, 1e-3 } },
    { "behind a wall", wall, 1, 1, 0, 1, { 0.5 }, { 1 }, { 1e-9 } },
    { "plateau", plateau, 1, 1, 0, 1, { 0 }, { 1e4 }, { 1e-9 } },
};
static const family shifted = { "shift", shift, 1, 1, 100, 0, { 0 }, { 0 }, { 1e-9 } };
static const family with_unused = { "unused parameter", unused, 2, 2, 16, 0, { 0 }, { 0 },
                                    { 1e-9, HUGE_VAL } };
static const family lines = { "line", line, 2, 10, 26, 0, { 0 }, { 0, 3 }, { 1e-9, 1e-6 } };
static const family noisy_lines = { "noisy line", noisy_line, 2, 9, 14, 0, { 0 }, { 0, 3 },
                                    { 1e-3, 1e-3 } };
static const family hiding = { "hidden constant", hidden, 1, 1, 14, 0, { 0 }, { 3 }, { 1e-9 } };
static const family unequals = { "unequal parameters", unequal, 2, 3, 10, 0, { 1, 1 }, { 0, 0 },
                                 { 1e-9, 1e-9 } };
static const family peaks = { "peak", peak, 3, 11, 7, 0, { 0.7, 0.6, 1.5 }, { 1, 0, 1 },
                              { 1e-5, 1e-6, 1e-5 } };

/* ---- the table ---- */

static row rows[ROWS + 1];
static int row_count;

typedef struct tally { const family *kind; int solved; } tally;

static tally tallies[FAMILIES];

static tally *tally_of(const family *kind)
{
    int i = 0;

    while (tallies[i].kind && tallies[i].kind != kind)
        i++;
    tallies[i].kind = kind;
    return &tallies[i];
}

static void add(const family *kind, double scale, double size, double offset, double start)
{
    if (row_count <= ROWS)
        rows[row_count++] = (row){ kind, scale, size, offset, start };
}

static void add_shifts(void)
{
    static const double targets[] = { 1e-300, 1e-100, 1e-12, 1e-3, 1, 700, 1e5, 1e8, 2e8, 1.7e9,
                                      1e12, 1e16, 1e30, 1e100, 1e200, 1e300 };
    static const double sizes[] = { 1e-300, 1e-162, 1e-30, 1, 1e150 };
    static const double starts[] = { 0, 1, -1, 700 };
    static const double ratios[] = { 30, 1e-3, 1e6, 1e-6, 1e9, 1e30, 1e-30, 1e60, 1e100, 1e-140 };
    size_t i, k;

    for (i = 0; i < 10; i++)
        add(&unequals, 1, 1, ratios[i], (double)NAN);
    for (i = 0; i < sizeof targets / sizeof *targets; i++) {
        for (k = 0; k < 5; k++)
            if (targets[i] * sizes[k] < 1e300 && targets[i] * sizes[k] > 1e-300)
                add(&shifted, 1, sizes[k], k % 2 ? -targets[i] : targets[i], starts[(i + k) % 4]);
        add(&shifted, 1, 1, targets[i], 0);
        add(&shifted, 1, 1, targets[i], 1);
        add(&with_unused, 1, 1, targets[i], starts[i % 4]);
        add(&lines, 1, 1, targets[i], 0);
        if (targets[i] <= 2e9) {
            add(&lines, 1, 1e-150, targets[i], 1);
            add(&noisy_lines, 1, 1, targets[i], i % 2 ? 1 : 0);
        }
        if (targets[i] > 1e-12 && targets[i] <= 2e9) {
            add(&hiding, 1, 1, targets[i], 0);
            add(&hiding, 1, 1, targets[i], 1);
            add(&peaks, 1, 1, targets[i], (double)NAN);
        }
    }
}

static void add_plain(void)
{
    static const double scales[] = { 1, 1, 1, 1, 1e-300, 1e-154, 1e-30, 1e9, 1e100, 1e290, 1e-200,
                                     1e250 };
    static const double sizes[] = { 1, 1e-300, 1e-162, 1e280, 1, 1e-20, 1e155, 1e-280, 1, 1e200,
                                    1e250, 1e-100 };
    /* What starts far off, where steps of the usual length tell nothing or too much. */
    static const row far_off[] = {
        { &plain[ROSENBROCK], 4e59, 1e-8, 0, 0 }, { &plain[ROSENBROCK], 1e-16, 6e-16, 0, 0 },
        { &plain[ROSENBROCK], 2e191, 0.1, 0, 0 }, { &plain[ROSENBROCK], 1e-20, 1, 0, 0 },
        { &plain[DECAY], 4.5e6, 2e110, 0, -7.5 }, { &plain[DECAY], 1e265, 1e-4, 0, -5.6 },
        { &plain[DECAY], 1e-8, 16, 0, -6 }, { &plain[POWER], 4e10, 3e226, 0, -0.46 },
        { &plain[POWER], 3.6e144, 4e261, 0, -0.66 }, { &plain[POWER], 1.2e15, 1.2e16, 0, -2.3 },
        { &plain[LOGISTIC], 6.2e-13, 1.5e3, 0, -4.57 }, { &plain[LOGISTIC], 4e257, 2e4, 0, -7.87 },
        { &noisy_lines, 1, 1, 5.623e6, 0 }, { &noisy_lines, 1, 1, 1.8e6, 0 },
        { &noisy_lines, 1, 1, 3e7, 0 }, { &noisy_lines, 1, 1e20, 1.1e7, 1 },
        { &plain[SATURATION], 1, 1, 0, 400 }, { &plain[SATURATION], 1e9, 1e-9, 0, 60 },
    };
    static const double starts[] = { 600, 690, 695, 699, 700, 701, 705, 1000, 1300, -700, 30, -1 };
    int kind, k;

    for (k = 0; k < (int)(sizeof far_off / sizeof *far_off); k++)
        rows[row_count++] = far_off[k];
    for (kind = 0; kind < PLAIN; kind++)
        for (k = 0; k < (kind == KINK || kind == BOWL || kind == PLATEAU ? 6 : 12); k++) {
            if (kind == EXPONENTIAL)
                add(&plain[kind], k % 4 == 3 ? 1e200 : 1, k % 4 == 2 ? 1e-150 : 1, 0, starts[k]);
            else
                add(&plain[kind], scales[k], sizes[k], 0,
                    kind == LOGISTIC && k % 3 ? starts[11 - k % 6] : (double)NAN);
        }
}

static void residuals_of(const double *params, double *residuals, void *user)
{
    const row *r = (const row *)user;
    double u[MAX_PARAMS];
    int i;

    for (i = 0; i < r->kind->n; i++)
        u[i] = params[i] / r->scale;
    r->kind->fn(r, u, residuals);
    for (i = 0; i < r->kind->m; i++)
        residuals[i] *= r->size;
}

static double answer_of(const row *r, int j)
{
    const family *kind = r->kind;
    const int first = kind == &shifted || kind == &with_unused || kind == &lines
                    || kind == &noisy_lines || kind == &unequals;

    if (kind == &unequals && j == 1)
        return 2.0 / r->offset;
    return (first && j == 0) || (kind == &peaks && j == 1) ? r->offset : kind->answer[j];
}

/* How far from the answer, over how far is right: above 1 is wrong. A parameter beside a larger one
   is only as exact as that one's rounding leaves it. */
static double error_of(const row *r, const double *params)
{
    double worst = 0.0, largest = r->kind == &unequals ? 0.0 : fabs(r->offset);
    int j;

    for (j = 0; j < r->kind->n && r->kind != &unequals; j++)
        largest = fmax(largest, fabs(answer_of(r, j)));
    for (j = 0; j < r->kind->n; j++) {
        const double answer = answer_of(r, j), noise = r->kind == &noisy_lines ? 1.0 : 0.0;
        const double size = fabs(answer) > noise ? fabs(answer) : 1.0;
        const double most = r->kind->within[j] * size + 8.0 * DBL_EPSILON * largest;

        worst = fmax(worst, fabs(params[j] / r->scale - answer) / most);
        if (!(fabs(params[j]) <= DBL_MAX))
            worst = HUGE_VAL;
    }
    return worst;
}

typedef struct ending {
    envsamp_result result;
    envsamp_lm_info info;
    double error, params[MAX_PARAMS];
} ending;

static ending solve(row *r)
{
    static double memory[MAX_RESIDUALS * (MAX_PARAMS + 2) + 2];
    envsamp_lm_desc desc;
    envsamp_buffer scratch;
    ending end;
    int j;

    memset(&desc, 0, sizeof desc);
    memset(&end, 0, sizeof end);
    desc.param_count = r->kind->n;
    desc.residual_count = r->kind->m;
    desc.max_iterations = 1000;
    for (j = 0; j < r->kind->n; j++) {
        const double own = r->kind->start[j] + (r->kind == &peaks && j == 1 ? r->offset : 0.0);

        end.params[j] = r->scale * (r->start <= DBL_MAX ? r->start : own);
    }
    scratch.data = (uintptr_t)memory % ENVSAMP_ALIGN == 0 ? memory : memory + 1;
    scratch.bytes = envsamp_lm_scratch_bytes(&desc);
    end.result = envsamp_lm(&desc, residuals_of, r, end.params, scratch, &end.info);
    end.error = error_of(r, end.params);
    return end;
}

int main(int argc, char **argv)
{
    const int table = argc > 1 && strcmp(argv[1], "table") == 0;
    int i, wrong = 0, solved = 0, refused = 0, possible = 0, calls = 0;

    add_shifts();
    add_plain();
    if (table)
        printf("%-22s %8s %8s %9s %6s %6s %6s  %s\n", "problem", "params", "size", "offset",
               "start", "steps", "calls", "ends");
    for (i = 0; i < row_count; i++) {
        row *r = &rows[i];
        const ending end = solve(r);
        const int right = end.error <= 1.0, bad = end.info.converged && (!right || r->kind->never);
        const char *word = end.result != ENVSAMP_OK ? "REFUSED" : bad ? "WRONG, called converged"
                         : end.info.converged ? "right" : right ? "right, not called converged"
                                                               : "not converged";

        wrong += bad;
        refused += end.result != ENVSAMP_OK;
        possible += !r->kind->never;
        solved += end.info.converged && right && !r->kind->never;
        tally_of(r->kind)->solved += end.info.converged && right;
        calls += end.info.evaluations;
        if (table)
            printf("%-22s %8.0e %8.0e %9.2g %6.4g %6d %6d  %s\n", r->kind->name, r->scale, r->size,
                   r->offset, r->start, end.info.iterations, end.info.evaluations, word);
        else if (bad || end.result != ENVSAMP_OK)
            CHECK(0, "%s, params %g, size %g, offset %g, start %g: %s", r->kind->name, r->scale,
                  r->size, r->offset, r->start, word);
    }
    if (table) {
        printf("%d problems: %d wrong, %d refused, %d of %d solved, %d calls\n", row_count, wrong,
               refused, solved, possible, calls);
        return 0;
    }
    CHECK(IS(row_count, ROWS), "%d problems", row_count);
    CHECK(IS(wrong, 0) && IS(refused, 0), "none is called converged where it is not");
    for (i = 0; i < FAMILIES; i++)
        CHECK(tallies[i].kind && tallies[i].solved >= tallies[i].kind->least,
              "%s: %d are solved, at least %d", tallies[i].kind->name, tallies[i].solved,
              tallies[i].kind->least);
    return check_done();
}
