/* test_lm.c: the least-squares solver on the problems of More, Garbow and Hillstrom, "Testing
 * unconstrained optimization software", ACM TOMS 7 (1981), and on bad input. Their numbering is
 * given as [MGH n]. Minima are those of that paper, with the further digits that NIST certifies
 * where a problem is also in its StRD collection (Meyer, Kowalik-Osborne, Osborne 1). */
#include "envsamp.h"
#include "check.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define MAX_PARAMS 8
#define MAX_RESIDUALS 64
#define SCRATCH_DOUBLES (MAX_RESIDUALS * (MAX_PARAMS + 2))
#define GUARD_DOUBLES 8
#define PI 3.14159265358979323846

static double memory[SCRATCH_DOUBLES + 2 * GUARD_DOUBLES];

/* The place in `memory` where the scratch begins: aligned, with at least four doubles before it. */
static double *scratch_start(void)
{
    double *start = memory + GUARD_DOUBLES / 2;

    while ((uintptr_t)start % ENVSAMP_ALIGN != 0) ++start;
    return start;
}

static envsamp_buffer scratch_of(size_t bytes)
{
    envsamp_buffer buffer;

    buffer.data = scratch_start();
    buffer.bytes = bytes;
    return buffer;
}

static envsamp_lm_desc desc_of(int param_count, int residual_count, int max_iterations)
{
    envsamp_lm_desc desc;

    desc.param_count = param_count;
    desc.residual_count = residual_count;
    desc.max_iterations = max_iterations;
    desc.ftol = desc.xtol = desc.gtol = 0.0;
    return desc;
}

/* ---- problems ---- */

static void rosenbrock(const double *x, double *f, void *user)  /* [MGH 1] */
{
    (void)user;
    f[0] = 10.0 * (x[1] - x[0] * x[0]);
    f[1] = 1.0 - x[0];
}

static void freudenstein_roth(const double *x, double *f, void *user)  /* [MGH 2] */
{
    (void)user;
    f[0] = -13.0 + x[0] + ((5.0 - x[1]) * x[1] - 2.0) * x[1];
    f[1] = -29.0 + x[0] + ((x[1] + 1.0) * x[1] - 14.0) * x[1];
}

static void powell_badly_scaled(const double *x, double *f, void *user)  /* [MGH 3] */
{
    (void)user;
    f[0] = 1e4 * x[0] * x[1] - 1.0;
    f[1] = exp(-x[0]) + exp(-x[1]) - 1.0001;
}

static void brown_badly_scaled(const double *x, double *f, void *user)  /* [MGH 4] */
{
    (void)user;
    f[0] = x[0] - 1e6;
    f[1] = x[1] - 2e-6;
    f[2] = x[0] * x[1] - 2.0;
}

static void beale(const double *x, double *f, void *user)  /* [MGH 5] */
{
    static const double y[3] = {1.5, 2.25, 2.625};
    double power = 1.0;
    int i;

    (void)user;
    for (i = 0; i < 3; ++i) {
        power *= x[1];
        f[i] = y[i] - x[0] * (1.0 - power);
    }
}

static void jennrich_sampson(const double *x, double *f, void *user)  /* [MGH 6] */
{
    int i;

    (void)user;
    for (i = 1; i <= 10; ++i) f[i - 1] = 2.0 + 2.0 * i - (exp(i * x[0]) + exp(i * x[1]));
}

static void helical_valley(const double *x, double *f, void *user)  /* [MGH 7] */
{
    double turn = x[0] > 0.0 ? atan(x[1] / x[0]) / (2.0 * PI)
                : x[0] < 0.0 ? atan(x[1] / x[0]) / (2.0 * PI) + 0.5
                : x[1] < 0.0 ? -0.25 : 0.25;

    (void)user;
    f[0] = 10.0 * (x[2] - 10.0 * turn);
    f[1] = 10.0 * (sqrt(x[0] * x[0] + x[1] * x[1]) - 1.0);
    f[2] = x[2];
}

static void bard(const double *x, double *f, void *user)  /* [MGH 8] */
{
    static const double y[15] = {0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39,
                                 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39};
    int i;

    (void)user;
    for (i = 0; i < 15; ++i) {
        double u = i + 1.0, v = 15.0 - i, w = u < v ? u : v;

        f[i] = y[i] - (x[0] + u / (v * x[1] + w * x[2]));
    }
}

static void gaussian(const double *x, double *f, void *user)  /* [MGH 9] */
{
    static const double y[8] = {0.0009, 0.0044, 0.0175, 0.0540, 0.1295, 0.2420, 0.3521, 0.3989};
    int i;

    (void)user;
    for (i = 0; i < 15; ++i) {
        double away = (7.0 - i) / 2.0 - x[2];

        f[i] = x[0] * exp(-x[1] * away * away / 2.0) - y[i < 8 ? i : 14 - i];
    }
}

static void meyer(const double *x, double *f, void *user)  /* [MGH 10] */
{
    static const double y[16] = {34780, 28610, 23650, 19630, 16370, 13720, 11540, 9744,
                                 8261, 7030, 6005, 5147, 4427, 3820, 3307, 2872};
    int i;

    (void)user;
    for (i = 0; i < 16; ++i) f[i] = x[0] * exp(x[1] / (50.0 + 5.0 * i + x[2])) - y[i];
}

static void box_3d(const double *x, double *f, void *user)  /* [MGH 12] */
{
    int i;

    (void)user;
    for (i = 0; i < 10; ++i) {
        double t = 0.1 * (i + 1.0);

        f[i] = exp(-t * x[0]) - exp(-t * x[1]) - x[2] * (exp(-t) - exp(-10.0 * t));
    }
}

static void powell_singular(const double *x, double *f, void *user)  /* [MGH 13] */
{
    (void)user;
    f[0] = x[0] + 10.0 * x[1];
    f[1] = sqrt(5.0) * (x[2] - x[3]);
    f[2] = (x[1] - 2.0 * x[2]) * (x[1] - 2.0 * x[2]);
    f[3] = sqrt(10.0) * (x[0] - x[3]) * (x[0] - x[3]);
}

static void wood(const double *x, double *f, void *user)  /* [MGH 14] */
{
    (void)user;
    f[0] = 10.0 * (x[1] - x[0] * x[0]);
    f[1] = 1.0 - x[0];
    f[2] = sqrt(90.0) * (x[3] - x[2] * x[2]);
    f[3] = 1.0 - x[2];
    f[4] = sqrt(10.0) * (x[1] + x[3] - 2.0);
    f[5] = (x[1] - x[3]) / sqrt(10.0);
}

static void kowalik_osborne(const double *x, double *f, void *user)  /* [MGH 15] */
{
    static const double y[11] = {0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627,
                                 0.0456, 0.0342, 0.0323, 0.0235, 0.0246};
    static const double u[11] = {4.0, 2.0, 1.0, 0.5, 0.25, 0.167,
                                 0.125, 0.1, 0.0833, 0.0714, 0.0625};
    int i;

    (void)user;
    for (i = 0; i < 11; ++i) {
        f[i] = y[i] - x[0] * u[i] * (u[i] + x[1]) / (u[i] * (u[i] + x[2]) + x[3]);
    }
}

static void brown_dennis(const double *x, double *f, void *user)  /* [MGH 16] */
{
    int i;

    (void)user;
    for (i = 0; i < 20; ++i) {
        double t = (i + 1.0) / 5.0;
        double a = x[0] + t * x[1] - exp(t), b = x[2] + x[3] * sin(t) - cos(t);

        f[i] = a * a + b * b;
    }
}

static void osborne_1(const double *x, double *f, void *user)  /* [MGH 17] */
{
    static const double y[33] = {0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.850, 0.818,
                                 0.784, 0.751, 0.718, 0.685, 0.658, 0.628, 0.603, 0.580, 0.558,
                                 0.538, 0.522, 0.506, 0.490, 0.478, 0.467, 0.457, 0.448, 0.438,
                                 0.431, 0.424, 0.420, 0.414, 0.411, 0.406};
    int i;

    (void)user;
    for (i = 0; i < 33; ++i) {
        double t = 10.0 * i;

        f[i] = y[i] - (x[0] + x[1] * exp(-t * x[3]) + x[2] * exp(-t * x[4]));
    }
}

static void biggs_exp6(const double *x, double *f, void *user)  /* [MGH 18] */
{
    int i;

    (void)user;
    for (i = 0; i < 13; ++i) {
        double t = 0.1 * (i + 1.0);
        double y = exp(-t) - 5.0 * exp(-10.0 * t) + 3.0 * exp(-4.0 * t);

        f[i] = x[2] * exp(-t * x[0]) - x[3] * exp(-t * x[1]) + x[5] * exp(-t * x[4]) - y;
    }
}

static void watson_6(const double *x, double *f, void *user)  /* [MGH 20] */
{
    int i, j;

    (void)user;
    for (i = 0; i < 29; ++i) {
        double t = (i + 1.0) / 29.0, power = 1.0, slope = 0.0, sum = x[0];

        for (j = 1; j < 6; ++j) {
            slope += j * x[j] * power;
            power *= t;
            sum += x[j] * power;
        }
        f[i] = slope - sum * sum - 1.0;
    }
    f[29] = x[0];
    f[30] = x[1] - x[0] * x[0] - 1.0;
}

static void penalty_1(const double *x, double *f, void *user)  /* [MGH 23] */
{
    double sum = 0.0;
    int i;

    (void)user;
    for (i = 0; i < 4; ++i) {
        f[i] = sqrt(1e-5) * (x[i] - 1.0);
        sum += x[i] * x[i];
    }
    f[4] = sum - 0.25;
}

static void linear_full_rank(const double *x, double *f, void *user)  /* [MGH 32] */
{
    double sum = 0.0;
    int i;

    (void)user;
    for (i = 0; i < 5; ++i) sum += x[i];
    for (i = 0; i < 10; ++i) f[i] = (i < 5 ? x[i] : 0.0) - 2.0 / 10.0 * sum - 1.0;
}

static void linear_rank_1(const double *x, double *f, void *user)  /* [MGH 33] */
{
    double sum = 0.0;
    int i;

    (void)user;
    for (i = 0; i < 5; ++i) sum += (i + 1.0) * x[i];
    for (i = 0; i < 10; ++i) f[i] = (i + 1.0) * sum - 1.0;
}

static void linear_rank_1_zeros(const double *x, double *f, void *user)  /* [MGH 34] */
{
    double sum = 0.0;
    int i;

    (void)user;
    for (i = 1; i < 4; ++i) sum += (i + 1.0) * x[i];
    for (i = 0; i < 10; ++i) f[i] = (i < 9 ? i * sum : 0.0) - 1.0;
}

static void chebyquad_8(const double *x, double *f, void *user)  /* [MGH 35] */
{
    int i, j;

    (void)user;
    for (i = 0; i < 8; ++i) f[i] = i % 2 ? 1.0 / ((i + 1.0) * (i + 1.0) - 1.0) : 0.0;
    for (j = 0; j < 8; ++j) {
        double before = 1.0, now = 2.0 * x[j] - 1.0, next;

        for (i = 0; i < 8; ++i) {
            f[i] += now / 8.0;
            next = 2.0 * (2.0 * x[j] - 1.0) * now - before;
            before = now;
            now = next;
        }
    }
}

/* ---- the published minima ---- */

enum {
    UNIQUE = 1,   /* the minimiser given is the only one of the standard start's cost */
    OR_ROOT = 2,  /* the paper gives a root beside the local minimum: either will do */
    /* J is singular at the root: the error of its differences outweighs what is left of f, and the
     * last steps creep. Only the cost is asked for. */
    CREEPS = 4
};

typedef struct problem {
    const char *name;
    envsamp_lm_fn fn;
    int n, m;
    double start[MAX_PARAMS];
    double minimum;                  /* of the cost, from the standard start */
    double minimum_far;              /* from ten times it; negative: not run */
    double tolerance, tolerance_far; /* relative to them: the digits published */
    int flags;
    double minimiser[MAX_PARAMS];
} problem;

/* Ten times the start is left out where the published runs fail from it or there is none. */
static const problem problems[] = {
    {"Rosenbrock", rosenbrock, 2, 2, {-1.2, 1}, 0, 0, 0, 0, UNIQUE, {1, 1}},
    {"Freudenstein and Roth", freudenstein_roth, 2, 2, {0.5, -2},
     48.98425367924, 48.98425367924, 1e-11, 1e-11, UNIQUE, {11.41277900, -0.8968052533}},
    {"Powell badly scaled", powell_badly_scaled, 2, 2, {0, 1},
     0, -1, 0, 0, UNIQUE, {1.098159330e-5, 9.106146740}},
    {"Brown badly scaled", brown_badly_scaled, 2, 3, {1, 1}, 0, 0, 0, 0, UNIQUE, {1e6, 2e-6}},
    {"Beale", beale, 2, 3, {1, 1}, 0, -1, 0, 0, UNIQUE, {3, 0.5}},
    {"Jennrich and Sampson", jennrich_sampson, 2, 10, {0.3, 0.4},
     124.3621823556, -1, 1e-11, 0, UNIQUE, {0.2578252, 0.2578252}},
    {"helical valley", helical_valley, 3, 3, {-1, 0, 0}, 0, 0, 0, 0, UNIQUE, {1, 0, 0}},
    {"Bard", bard, 3, 15, {1, 1, 1}, 8.214877306578e-3, 17.42869333, 1e-9, 1e-7, 0, {0}},
    {"Gaussian", gaussian, 3, 15, {0.4, 1, 0},
     1.1279327696e-8, -1, 1e-9, 0, UNIQUE, {0.3989561, 1.0000191, 0}},
    {"Meyer", meyer, 3, 16, {0.02, 4000, 250},
     87.945855171, -1, 1e-9, 0, UNIQUE, {5.6096364710e-3, 6181.3463463, 345.22363462}},
    {"Box", box_3d, 3, 10, {0, 10, 20}, 0, -1, 0, 0, 0, {0}},
    {"Powell singular", powell_singular, 4, 4, {3, -1, 0, 1}, 0, 0, 0, 0, UNIQUE | CREEPS, {0}},
    {"Wood", wood, 4, 6, {-3, -1, -3, -1}, 0, 0, 0, 0, UNIQUE, {1, 1, 1, 1}},
    {"Kowalik and Osborne", kowalik_osborne, 4, 11, {0.25, 0.39, 0.415, 0.39},
     3.0750560385e-4, 1.02734e-3, 1e-9, 1e-5, UNIQUE,
     {0.19280693458, 0.19128232873, 0.12305650693, 0.13606233068}},
    {"Brown and Dennis", brown_dennis, 4, 20, {25, 5, -5, -1},
     85822.2016263563, 85822.2016263563, 1e-10, 1e-10, UNIQUE,
     {-11.594439, 13.203630, -0.40343949, 0.23677877}},
    {"Osborne 1", osborne_1, 5, 33, {0.5, 1.5, -1, 0.01, 0.02},
     5.4648946975e-5, -1, 1e-9, 0, UNIQUE,
     {0.37541005211, 1.9358469127, -1.4646871366, 0.012867534640, 0.022122699662}},
    {"Biggs EXP6", biggs_exp6, 6, 13, {1, 2, 1, 1, 1, 1},
     5.655649925e-3, -1, 1e-8, 0, OR_ROOT, {0}},
    {"Watson", watson_6, 6, 31, {0},
     2.28767005355e-3, -1, 1e-10, 0, UNIQUE,
     {-0.01572509, 1.0124349, -0.2329916, 1.2604301, -1.5137289, 0.9929964}},
    {"penalty I", penalty_1, 4, 5, {1, 2, 3, 4},
     2.2499775008e-5, 2.2499775008e-5, 1e-9, 1e-9, 0, {0}},
    {"linear, full rank", linear_full_rank, 5, 10, {1, 1, 1, 1, 1},
     5, 5, 1e-13, 1e-13, UNIQUE, {-1, -1, -1, -1, -1}},
    {"linear, rank 1", linear_rank_1, 5, 10, {1, 1, 1, 1, 1},
     15.0 / 7.0, 15.0 / 7.0, 1e-12, 1e-12, 0, {0}},
    {"linear, rank 1, zeros", linear_rank_1_zeros, 5, 10, {1, 1, 1, 1, 1},
     62.0 / 17.0, 62.0 / 17.0, 1e-12, 1e-12, 0, {0}},
    {"Chebyquad", chebyquad_8, 8, 8,
     {1.0 / 9, 2.0 / 9, 3.0 / 9, 4.0 / 9, 5.0 / 9, 6.0 / 9, 7.0 / 9, 8.0 / 9},
     3.51687372568e-3, -1, 1e-9, 0, 0, {0}},
};

#define PROBLEM_COUNT ((int)(sizeof problems / sizeof problems[0]))
#define ZERO_COST 1e-20       /* a zero-residual problem is solved below this */
#define SAME_PARAMS 1e-5      /* relative, absolute at 0: forward differences, flat valleys */

static int is_near_cost(double cost, double minimum, double tolerance)
{
    if (minimum > 0.0) return fabs(cost - minimum) <= tolerance * minimum;
    return cost >= 0.0 && cost <= ZERO_COST;
}

static int is_near_point(const double *params, const double *minimiser, int n)
{
    int j;

    for (j = 0; j < n; ++j) {
        double scale = fabs(minimiser[j]) > 0.0 ? fabs(minimiser[j]) : 1.0;

        if (!(fabs(params[j] - minimiser[j]) <= SAME_PARAMS * scale)) return 0;
    }
    return 1;
}

static envsamp_lm_info solve(const problem *p, double factor, double *params)
{
    envsamp_lm_desc desc = desc_of(p->n, p->m, 1000);
    envsamp_lm_info info;
    envsamp_result result;
    int j;

    for (j = 0; j < p->n; ++j) params[j] = factor * p->start[j];
    memset(&info, 0, sizeof info);
    result = envsamp_lm(&desc, p->fn, NULL, params, scratch_of(envsamp_lm_scratch_bytes(&desc)),
                        &info);
    CHECK(result == ENVSAMP_OK, "%s: result %d", p->name, (int)result);
    return info;
}

static void check_problem(const problem *p, double factor, double minimum, double tolerance)
{
    double params[MAX_PARAMS], again[MAX_RESIDUALS], cost = 0.0;
    envsamp_lm_info info = solve(p, factor, params);
    int i, found = is_near_cost(info.cost, minimum, tolerance);

    if (p->flags & OR_ROOT) found |= is_near_cost(info.cost, 0.0, 0.0);
    CHECK(found && (info.converged || (p->flags & CREEPS)),
          "%s from %g times the start: cost %.13g (known %.13g) by %d calls, %d steps", p->name,
          factor, info.cost, minimum, info.evaluations, info.iterations);
    p->fn(params, again, NULL);
    for (i = 0; i < p->m; ++i) cost += again[i] * again[i];
    CHECK(fabs(cost - info.cost) <= 1e-12 * cost, "%s: params are those of the cost", p->name);
    if ((p->flags & UNIQUE) && is_near_cost(info.cost, p->minimum, p->tolerance)) {
        CHECK(is_near_point(params, p->minimiser, p->n), "%s: minimiser %.10g %.10g ...", p->name,
              params[0], params[1]);
    }
}

static void test_published_minima(void)
{
    int i;

    for (i = 0; i < PROBLEM_COUNT; ++i) {
        const problem *p = &problems[i];

        check_problem(p, 1.0, p->minimum, p->tolerance);
        if (p->minimum_far < 0.0) continue;
        check_problem(p, 10.0, p->minimum_far, p->tolerance_far);
    }
}

/* ---- controls: the comparisons above can fail ---- */

static void bard_one_datum_off(const double *x, double *f, void *user)
{
    bard(x, f, user);
    f[7] += 1e-6;
}

static void test_controls(void)
{
    problem wrong = problems[7];
    double params[MAX_PARAMS], nudged[2] = {1.0, 1.0 + 3e-5};
    envsamp_lm_info info;

    wrong.fn = bard_one_datum_off;
    info = solve(&wrong, 1.0, params);
    CHECK(!is_near_cost(info.cost, wrong.minimum, wrong.tolerance),
          "control: a datum off by 1e-6 is told apart (cost %.13g)", info.cost);
    CHECK(!is_near_cost(2e-20, 0.0, 0.0) && !is_near_cost(-1.0, 0.0, 0.0),
          "control: zero means zero");
    CHECK(!is_near_cost((double)NAN, 1.0, 1e-9), "control: NaN is near nothing");
    CHECK(!is_near_point(nudged, problems[0].minimiser, 2), "control: a nudged point is seen");
}

/* ---- results for bad input ---- */

static envsamp_result run_rosenbrock(envsamp_lm_desc desc, double x0)
{
    double params[MAX_PARAMS] = {0};

    params[0] = x0;
    return envsamp_lm(&desc, rosenbrock, NULL, params, scratch_of(sizeof(double) * 64), NULL);
}

static void test_null(void)
{
    envsamp_lm_desc desc = desc_of(2, 2, 0);
    envsamp_buffer scratch = scratch_of(64), none = {NULL, 64};
    double params[2] = {-1.2, 1.0};

    CHECK(IS(envsamp_lm(NULL, rosenbrock, NULL, params, scratch, NULL), ENVSAMP_ERR_NULL), "desc");
    CHECK(IS(envsamp_lm(&desc, NULL, NULL, params, scratch, NULL), ENVSAMP_ERR_NULL), "fn");
    CHECK(IS(envsamp_lm(&desc, rosenbrock, NULL, NULL, scratch, NULL), ENVSAMP_ERR_NULL), "params");
    CHECK(IS(envsamp_lm(&desc, rosenbrock, NULL, params, none, NULL), ENVSAMP_ERR_NULL), "scratch");
    CHECK(IS(envsamp_lm_scratch_bytes(NULL), 0), "no bytes for a NULL desc");
    CHECK(IS(envsamp_lm(&desc, rosenbrock, NULL, params, scratch, NULL), ENVSAMP_OK), "NULL info");
}

static void check_param_error(envsamp_lm_desc desc, const char *what)
{
    CHECK(run_rosenbrock(desc, -1.2) == ENVSAMP_ERR_PARAM, "%s is ENVSAMP_ERR_PARAM", what);
    CHECK(envsamp_lm_scratch_bytes(&desc) == 0, "%s wants no bytes", what);
}

static void test_bad_counts(void)
{
    check_param_error(desc_of(0, 2, 0), "no parameter");
    check_param_error(desc_of(-1, 2, 0), "param_count -1");
    check_param_error(desc_of(9, 20, 0), "param_count 9");
    check_param_error(desc_of(2, 1, 0), "fewer residuals than parameters");
    check_param_error(desc_of(2, -2, 0), "residual_count -2");
    check_param_error(desc_of(2, 2, -1), "max_iterations -1");
}

static void test_bad_tolerances(void)
{
    double bad[2] = {-1e-9, 0.0};
    int i, k;

    bad[1] = (double)NAN;
    for (i = 0; i < 2; ++i) {
        for (k = 0; k < 3; ++k) {
            envsamp_lm_desc desc = desc_of(2, 2, 0);

            *(k == 0 ? &desc.ftol : k == 1 ? &desc.xtol : &desc.gtol) = bad[i];
            check_param_error(desc, i ? "a NaN tolerance" : "a negative tolerance");
        }
    }
}

static void huge(const double *x, double *f, void *user)
{
    const double size = *(const double *)user;

    f[0] = size * x[0];
    f[1] = size * (x[1] - 3.0);
}

static void test_bad_values(void)
{
    envsamp_lm_desc desc = desc_of(2, 2, 0);
    envsamp_lm_info info = {-7, -7, -7, -7.0};
    double params[2] = {1.0, 2.0}, size = 1e302;
    envsamp_result result;

    CHECK(IS(run_rosenbrock(desc, (double)NAN), ENVSAMP_ERR_VALUE), "a NaN start");
    CHECK(IS(run_rosenbrock(desc, (double)INFINITY), ENVSAMP_ERR_VALUE), "an infinite start");
    CHECK(IS(run_rosenbrock(desc, 1e300), ENVSAMP_ERR_VALUE), "infinite residuals at the start");
    result = envsamp_lm(&desc, huge, &size, params, scratch_of(64), &info);
    CHECK(IS(result, ENVSAMP_ERR_VALUE), "a residual above 1e301");
    CHECK(params[0] >= 1.0 && params[0] <= 1.0 && IS(info.iterations, -7) && info.cost <= -7.0,
          "an error leaves params and info alone");
    size = 1e300;
    desc.max_iterations = 1;
    params[0] = 1e-2;
    params[1] = 1.0;
    result = envsamp_lm(&desc, huge, &size, params, scratch_of(64), &info);
    CHECK(result == ENVSAMP_OK && fabs(params[1] - 3.0) < 1e-6, "a sum of squares that overflows "
          "is none: %g from the answer", params[1] - 3.0);
    params[1] = 1.0;
    desc.gtol = 2.0;
    result = envsamp_lm(&desc, huge, &size, params, scratch_of(64), &info);
    CHECK(result == ENVSAMP_OK && info.converged && info.cost > DBL_MAX,
          "but that is what its cost says");
}

/* ---- memory ---- */

static void test_scratch_size(void)
{
    envsamp_lm_desc desc = desc_of(3, 15, 0), huge = desc_of(8, 65536, 0);
    size_t bytes = envsamp_lm_scratch_bytes(&desc);
    envsamp_buffer scratch = scratch_of(bytes);
    double params[3] = {1.0, 1.0, 1.0};

    CHECK(envsamp_lm_scratch_bytes(&huge) == 65536u * 10u * sizeof(double), "8 m (n + 2) bytes");
    CHECK(IS(envsamp_lm(&desc, bard, NULL, params, scratch, NULL), ENVSAMP_OK), "exact size");
    scratch.bytes = bytes - 1;
    CHECK(IS(envsamp_lm(&desc, bard, NULL, params, scratch, NULL), ENVSAMP_ERR_MEMORY),
          "one byte less");
    scratch.bytes = bytes;
    scratch.data = (char *)scratch_start() + 4;
    CHECK(IS(envsamp_lm(&desc, bard, NULL, params, scratch, NULL), ENVSAMP_ERR_ALIGN),
          "4 bytes off alignment");
}

static int guards_stand(const unsigned char *bytes, size_t count)
{
    size_t i;

    for (i = 0; i < count; ++i) {
        if (bytes[i] != 0xA5) return 0;
    }
    return 1;
}

static void test_nothing_beyond_the_buffer(void)
{
    const unsigned char *bytes = (const unsigned char *)memory;
    const size_t guard = (size_t)(scratch_start() - memory) * sizeof(double);
    double params[MAX_PARAMS];
    int i;

    for (i = 0; i < PROBLEM_COUNT; ++i) {
        envsamp_lm_desc desc = desc_of(problems[i].n, problems[i].m, 0);
        size_t end = guard + envsamp_lm_scratch_bytes(&desc);

        memset(memory, 0xA5, sizeof memory);
        (void)solve(&problems[i], 1.0, params);
        CHECK(guards_stand(bytes, guard) && guards_stand(bytes + end, sizeof memory - end),
              "%s: bytes around the scratch are untouched", problems[i].name);
        CHECK(!guards_stand(bytes + guard, end - guard), "control: the scratch itself is not");
    }
}

/* ---- regions where the model is not defined ---- */

static void walled_line(const double *x, double *f, void *user)
{
    double wall = *(const double *)user;

    f[0] = x[0] > wall ? (double)NAN : exp(x[0]) - exp(2.0);
    f[1] = x[1] > wall ? (double)INFINITY : x[1] - 1.0;
}

static void nowhere_but_here(const double *x, double *f, void *user)
{
    double here = *(const double *)user;

    f[0] = x[0] >= here && x[0] <= here ? 3.0 : (double)NAN;
}

static void test_walls(void)
{
    envsamp_lm_desc desc = desc_of(2, 2, 0);
    envsamp_lm_info info;
    double params[2] = {-1.0, -30.0}, wall = 2.5;
    envsamp_result result;

    result = envsamp_lm(&desc, walled_line, &wall, params, scratch_of(64), &info);
    CHECK(result == ENVSAMP_OK && info.cost <= ZERO_COST && info.converged,
          "a minimum before a wall is reached: cost %g by %d calls", info.cost, info.evaluations);
    CHECK(IS_NEAR(params[0], 2.0, 1e-9) && IS_NEAR(params[1], 1.0, 1e-9),
          "and it is the right one");

    params[0] = wall = 3.0;  /* forward differences land in the wall: backward ones serve */
    params[1] = -30.0;
    result = envsamp_lm(&desc, walled_line, &wall, params, scratch_of(64), &info);
    CHECK(result == ENVSAMP_OK && info.cost <= ZERO_COST, "a start on the wall: cost %g",
          info.cost);

    params[0] = params[1] = wall = 1.0;  /* the minimum lies behind the wall */
    result = envsamp_lm(&desc, walled_line, &wall, params, scratch_of(64), &info);
    CHECK(result == ENVSAMP_OK && params[0] <= 1.0 && params[0] > 1.0 - 1e-6,
          "a minimum behind a wall: stays finite, at %.12g", params[0]);
    CHECK(!info.converged, "and is not called converged");
}

static void test_no_derivative(void)
{
    envsamp_lm_desc desc = desc_of(1, 1, 0);
    envsamp_lm_info info;
    double params[1] = {0.5}, here = 0.5;
    envsamp_result result;

    result = envsamp_lm(&desc, nowhere_but_here, &here, params, scratch_of(64), &info);
    CHECK(IS(result, ENVSAMP_OK) && !info.converged && info.cost >= 9.0 && info.cost <= 9.0,
          "no finite neighbour: not called converged");
    CHECK(params[0] >= 0.5 && params[0] <= 0.5, "and params are as given");
}

static void nothing_but_here(const double *x, double *f, void *user)
{
    nowhere_but_here(x, f, user);
    f[0] -= 3.0;
}

/* f[0] is so steep that its column of the Jacobian would overflow. */
static void cliff(const double *x, double *f, void *user)
{
    (void)user;
    f[0] = 1e150 * sin(1e7 * x[0]);
    f[1] = 1e150 * (x[1] - 2.0);
}

static void test_rest(void)
{
    envsamp_lm_desc desc = desc_of(1, 1, 0);
    envsamp_lm_info info;
    double params[2] = {0.5, 0.5}, here = 0.5;
    envsamp_result result;

    result = envsamp_lm(&desc, nothing_but_here, &here, params, scratch_of(64), &info);
    CHECK(result == ENVSAMP_OK && info.converged && info.cost <= 0.0, "no finite neighbour of a "
          "root: called converged");
    desc = desc_of(2, 2, 0);
    params[0] = 0.0;
    result = envsamp_lm(&desc, cliff, NULL, params, scratch_of(64), &info);
    CHECK(result == ENVSAMP_OK && params[0] <= 0.0 && params[0] >= 0.0
          && fabs(params[1] - 2.0) < 1e-9, "where a slope overflows its parameter rests, the other "
          "moves to %.12g", params[1]);
}

/* Beyond x = 1 two planes and a constant; before it, y is only defined where it starts. */
static void freed_by_x(const double *x, double *f, void *user)
{
    double start = *(const double *)user;

    f[0] = x[0] - 2.0;
    f[1] = x[0] > 1.0 || (x[1] >= start && x[1] <= start) ? x[1] - 3.0 : (double)NAN;
    f[2] = 1.0;
}

/* A parameter that rested until a step freed it no longer keeps a minimum from being one. The cost
   there is not 0, and gtol is what ends the search. */
static void test_freed(void)
{
    envsamp_lm_desc desc = desc_of(2, 3, 0);
    envsamp_lm_info info = {0, 0, -1, -1.0};
    double params[2] = {0.5, 0.5}, start = 0.5, off;
    envsamp_result result;

    desc.gtol = 1e-4;
    result = envsamp_lm(&desc, freed_by_x, &start, params, scratch_of(96), &info);
    off = fmax(fabs(params[0] - 2.0), fabs(params[1] - 3.0));
    CHECK(result == ENVSAMP_OK && off < 1e-4, "a parameter that rests at first gets to the "
          "minimum too, but for %.1e", off);
    CHECK(info.converged == 1, "and that is called converged: %d", info.converged);
}

/* Before x = 1 nothing depends on y; beyond it, too little for a step of the usual length. */
static void woken_by_x(const double *x, double *f, void *user)
{
    (void)user;
    f[0] = x[0] - 2.0;
    f[1] = x[0] > 1.0 ? x[1] - 1.7e9 : 3e9;
}

/* What moves nothing is tried again before a search ends. */
static void test_idle(void)
{
    envsamp_lm_desc desc = desc_of(2, 2, 0);
    envsamp_lm_info info = {0, 0, -1, -1.0};
    double params[2] = {0.0, 0.0};
    envsamp_result result;

    result = envsamp_lm(&desc, woken_by_x, NULL, params, scratch_of(64), &info);
    CHECK(result == ENVSAMP_OK && info.converged == 1 && IS_NEAR(params[0], 2.0, 1e-9)
          && IS_NEAR(params[1], 1.7e9, 1.0), "a parameter that moves nothing at first is tried "
          "again: %g", params[1]);
}

/* ---- limits, flags, scale ---- */

typedef struct call_log { int calls; double lowest; } call_log;

static void logged_wood(const double *x, double *f, void *user)
{
    call_log *log = (call_log *)user;
    double cost = 0.0;
    int i;

    wood(x, f, NULL);
    log->calls++;
    for (i = 0; i < 6; ++i) cost += f[i] * f[i];
    if (cost < log->lowest) log->lowest = cost;
}

static void test_max_iterations(void)
{
    double start_cost = 19192.0;
    int limit;

    for (limit = 1; limit <= 5; ++limit) {
        envsamp_lm_desc desc = desc_of(4, 6, limit);
        envsamp_lm_info info;
        double params[4] = {-3.0, -1.0, -3.0, -1.0};
        call_log log = {0, DBL_MAX};

        (void)envsamp_lm(&desc, logged_wood, &log, params, scratch_of(1024), &info);
        CHECK(info.iterations == limit && !info.converged, "stopped after %d, not converged",
              limit);
        CHECK(info.evaluations == log.calls && log.calls <= 1 + limit * (3 * 4 + 1),
              "%d calls are counted and bounded", log.calls);
        CHECK(info.cost <= start_cost * (1.0 + 1e-12), "the cost never rises: %g", info.cost);
        CHECK(info.cost <= log.lowest * 1.001, "the best point is kept: %g", log.lowest);
        start_cost = info.cost;
    }
}

/* Only the first step sets the trust radius to its length; later ones move it by what they gain.
   Bounds are twice what was measured. Where the residuals are 0 already no step is tried. */
static void test_steps_taken(void)
{
    problem solved = problems[0];
    double params[MAX_PARAMS];
    envsamp_lm_info info = solve(&problems[0], 10.0, params);

    CHECK(info.evaluations <= 36, "Rosenbrock from 10 times the start: %d calls, at most 36",
          info.evaluations);
    info = solve(&problems[2], 1.0, params);
    CHECK(info.evaluations <= 106, "%s: %d calls, at most 106", problems[2].name,
          info.evaluations);
    memcpy(solved.start, solved.minimiser, sizeof solved.start);
    info = solve(&solved, 1.0, params);
    CHECK(info.converged && IS(info.iterations, 0) && IS(info.cost, 0.0),
          "from the minimum of Rosenbrock: no step");
}

/* A tolerance below DBL_EPSILON counts as that. */
static void test_least_tolerance(void)
{
    const double least[2] = {DBL_EPSILON, 1e-30};
    double cost[2];
    int evaluations[2], i;

    for (i = 0; i < 2; ++i) {
        envsamp_lm_desc desc = desc_of(4, 20, 1000);
        envsamp_lm_info info;
        double params[4] = {25.0, 5.0, -5.0, -1.0};

        desc.ftol = desc.xtol = desc.gtol = least[i];
        (void)envsamp_lm(&desc, brown_dennis, NULL, params, scratch_of(4096), &info);
        evaluations[i] = info.converged ? info.evaluations : -1;
        cost[i] = info.cost;
    }
    CHECK(evaluations[0] > 0 && evaluations[0] == evaluations[1]
          && memcmp(&cost[0], &cost[1], sizeof cost[0]) == 0, "tolerances of 1e-30 are those of "
          "DBL_EPSILON: %d and %d calls", evaluations[0], evaluations[1]);
}

static void test_tolerances_stop(void)
{
    envsamp_lm_desc tight = desc_of(4, 20, 1000), loose = tight;
    envsamp_lm_info exact, early;
    double params[4] = {25.0, 5.0, -5.0, -1.0}, other[4] = {25.0, 5.0, -5.0, -1.0};

    loose.ftol = 1e-3;
    (void)envsamp_lm(&tight, brown_dennis, NULL, params, scratch_of(4096), &exact);
    (void)envsamp_lm(&loose, brown_dennis, NULL, other, scratch_of(4096), &early);
    CHECK(early.converged && early.evaluations < exact.evaluations,
          "a loose ftol stops early: %d %d",
          early.evaluations, exact.evaluations);
    CHECK(early.cost < exact.cost * 1.01, "and not far off: %g", early.cost);
    early.evaluations = 0;
    (void)envsamp_lm(&tight, brown_dennis, NULL, params, scratch_of(4096), &early);
    CHECK(early.converged && early.cost <= exact.cost, "a restart at the minimum stays there");
}

static void unused_parameter(const double *x, double *f, void *user)
{
    (void)user;
    f[0] = x[0] - 3.0;
    f[1] = x[0] * x[0] - 9.0;
    f[2] = 0.0;
}

static void tiny_units(const double *x, double *f, void *user)
{
    (void)user;
    f[0] = 1e9 * x[0] - 2.0;
    f[1] = 1e-9 * x[1] - 5.0;
}

static void test_scale(void)
{
    envsamp_lm_desc unused = desc_of(3, 3, 0), tiny = desc_of(2, 2, 0);
    envsamp_lm_info info;
    double params[3] = {1.0, 0.25, 0.0}, x[2] = {1e-12, 1e8};

    (void)envsamp_lm(&unused, unused_parameter, NULL, params, scratch_of(1024), &info);
    CHECK(info.converged && fabs(params[0] - 3.0) < 1e-9, "two dead parameters: %g", info.cost);
    CHECK(params[1] >= 0.25 && params[1] <= 0.25 && fabs(params[2]) <= 0.0, "they stay put");
    params[0] = 1e-30;  /* a difference relative to this is lost in the residuals */
    (void)envsamp_lm(&unused, unused_parameter, NULL, params, scratch_of(1024), &info);
    CHECK(info.converged && fabs(params[0] - 3.0) < 1e-9, "a start next to zero: %g", info.cost);
    params[1] = (double)NAN;
    CHECK(IS(envsamp_lm(&unused, unused_parameter, NULL, params, scratch_of(1024), &info),
             ENVSAMP_ERR_VALUE), "a dead parameter that starts as NaN");
    (void)envsamp_lm(&tiny, tiny_units, NULL, x, scratch_of(1024), &info);
    CHECK(info.converged && fabs(x[0] * 1e9 - 2.0) < 1e-9 && fabs(x[1] * 1e-9 - 5.0) < 1e-9,
          "units 18 decades apart: %g %g", x[0], x[1]);
}

#define MANY 65536

static void many_decay(const double *x, double *f, void *user)
{
    int i;

    (void)user;
    for (i = 0; i < MANY; ++i) {
        double t = i / (double)MANY;

        f[i] = x[0] * exp(-x[1] * t) - 7.0 * exp(-3.0 * t) - (i % 2 ? 0.5 : -0.5);
    }
}

/* The alternating error is nearly orthogonal to the model: it leaves a quarter each in the cost. */
static void test_many_residuals(void)
{
    static double many[MANY * 4 + 2];
    envsamp_lm_desc desc = desc_of(2, MANY, 0);
    envsamp_lm_info info;
    envsamp_buffer scratch;
    double params[2] = {1.0, 0.0};

    scratch.data = (uintptr_t)many % ENVSAMP_ALIGN == 0 ? many : many + 1;
    scratch.bytes = envsamp_lm_scratch_bytes(&desc);
    CHECK(envsamp_lm(&desc, many_decay, NULL, params, scratch, &info) == ENVSAMP_OK
          && info.converged, "65536 residuals: %d calls", info.evaluations);
    CHECK(is_near_cost(info.cost, MANY / 4.0, 1e-8), "their cost is %.12g", info.cost);
    CHECK(fabs(params[0] - 7.0) < 1e-3 && fabs(params[1] - 3.0) < 1e-3, "the model is found: %g %g",
          params[0], params[1]);
}

static void test_determinism(void)
{
    int i;

    for (i = 0; i < PROBLEM_COUNT; ++i) {
        double first[MAX_PARAMS] = {0}, second[MAX_PARAMS] = {0};
        envsamp_lm_info a, b;

        memset(memory, 0x00, sizeof memory);
        a = solve(&problems[i], 1.0, first);
        memset(memory, 0xFF, sizeof memory);
        b = solve(&problems[i], 1.0, second);
        CHECK(memcmp(first, second, sizeof first) == 0 && a.evaluations == b.evaluations
              && memcmp(&a.cost, &b.cost, sizeof a.cost) == 0,
              "%s: same bits from a scratch of zeros and one of NaNs", problems[i].name);
    }
}

int main(void)
{
    test_published_minima();
    test_controls();
    test_null();
    test_bad_counts();
    test_bad_tolerances();
    test_bad_values();
    test_scratch_size();
    test_nothing_beyond_the_buffer();
    test_walls();
    test_no_derivative();
    test_rest();
    test_freed();
    test_idle();
    test_max_iterations();
    test_steps_taken();
    test_tolerances_stop();
    test_least_tolerance();
    test_scale();
    test_many_residuals();
    test_determinism();
    return check_done();
}
