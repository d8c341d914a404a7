/* convergence.c: how the error of diffuse irradiance falls with the number of samples, map by map,
 * beside inverting the full CDF.
 *
 *     convergence [-o FILE.png] [-r SCRAMBLINGS]     tables on stdout, a plot into the file
 *
 * Every sampler gets the same Owen-scrambled Sobol points; the last column inverts the CDF
 * with independent random numbers. RMSE is relative, over 64 normals spread over the sphere
 * and all scramblings. Radiance is constant over a texel, looked up in the direction of a sample,
 * as a renderer would.
 *
 * baseline_cdf draws a texel by luminance x sin(theta) of its centre, a point of it uniformly in
 * (u, v), and its pdf is that density over the sine of the point itself. So it is unbiased for
 * constant texels, if not free of variance within one, but for the rounding of a float CDF, which
 * moves less than 1e-5 of the probability. A pdf constant over solid angle within each texel gives
 * the same errors within 2 %.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "../examples/common/random.h"
#include "baselines.h"
#include "map_set.h"
#include "plot.h"
#include "promise.h"

#include <math.h>

#define PI 3.14159265358979323846
#define NORMAL_COUNT 64
#define N_FIRST 4
#define N_COUNT 11                  /* 4, 8 .. 4096 */
#define N_TABLE 6                   /* 256: of the table map by map */
#define CELLS 32                    /* of a texel's side, where a horizon crosses it */

enum { WARP, WARP_FINE, ALIAS, FIT, INVERSION, INDEPENDENT, SAMPLER_COUNT };

static const char *const names[SAMPLER_COUNT] = {
    "WARP 6144", "WARP 16384", "ALIAS 6144", "FIT 6144", "INVERSION", "INV., RANDOM"
};

static const unsigned char colours[SAMPLER_COUNT][3] = {
    { 0, 110, 200 }, { 0, 160, 120 }, { 220, 120, 0 }, { 150, 80, 170 }, { 200, 30, 40 },
    { 100, 100, 100 }
};

typedef struct options { const char *path; int scramblings; } options;

/* A map and what samples it. */
typedef struct scene {
    image map;
    envsamp_image view;
    bench_table tables[FIT + 1];
    baseline_cdf cdf;
    double irradiance[NORMAL_COUNT];
} scene;

/* Of one map: the relative RMSE of each sampler after 4, 8.. samples. */
typedef struct errors { double rmse[SAMPLER_COUNT][N_COUNT]; } errors;

static double normals[NORMAL_COUNT][3];

static void make_normals(void)
{
    const double golden = PI * (3.0 - sqrt(5.0));
    int i;

    for (i = 0; i < NORMAL_COUNT; i++) {
        const double z = 1.0 - (2.0 * i + 1.0) / NORMAL_COUNT, r = sqrt(1.0 - z * z);

        normals[i][0] = r * cos(golden * i);
        normals[i][1] = r * sin(golden * i);
        normals[i][2] = z;
    }
}

/* ---- the reference ---- */

/* Antiderivatives at the edges of columns and rows of cells, for the integral of the direction
   over a rectangle of azimuth and polar angle, which is exact. */
typedef struct lattice {
    double (*x)[2];                 /* of (cos, sin) azimuth */
    double (*y)[2];                 /* of sin^2 and of sin cos of the polar angle */
    double step;                    /* azimuth of a cell */
} lattice;

static lattice lattice_create(int width, int height)
{
    const int columns = width * CELLS, rows = height * CELLS;
    lattice l;
    int i;

    l.x = bench_allocate(((size_t)columns + 1) * sizeof *l.x);
    l.y = bench_allocate(((size_t)rows + 1) * sizeof *l.y);
    l.step = 2.0 * PI / columns;
    for (i = 0; i <= columns; i++) {
        l.x[i][0] = sin(l.step * i);
        l.x[i][1] = -cos(l.step * i);
    }
    for (i = 0; i <= rows; i++) {
        const double theta = PI * i / rows;

        l.y[i][0] = 0.5 * theta - 0.25 * sin(2.0 * theta);
        l.y[i][1] = -0.25 * cos(2.0 * theta);
    }
    return l;
}

/* Integral of the cosine over a square of cells with the corner (x, y). */
static double cosine_over(const lattice *l, const double normal[3], int x, int y, int side)
{
    const double across = l->y[y + side][0] - l->y[y][0], up = l->y[y + side][1] - l->y[y][1];

    return (normal[0] * (l->x[x + side][0] - l->x[x][0])
            + normal[1] * (l->x[x + side][1] - l->x[x][1])) * across
         + normal[2] * l->step * side * up;
}

/* The same above the horizon, of a texel that the horizon may cross: cell by cell. */
static double cosine_above(const lattice *l, const double normal[3], int x, int y)
{
    double sum = 0.0;
    int i, j;

    for (j = 0; j < CELLS; j++)
        for (i = 0; i < CELLS; i++) {
            const double cosine = cosine_over(l, normal, x + i, y + j, 1);

            sum += cosine > 0.0 ? cosine : 0.0;
        }
    return sum;
}

/* A texel's centre is no further from its corners than `reach`: the sine of an angle. */
static double texel_irradiance(const lattice *l, const double normal[3], int x, int y,
                               double height, double reach)
{
    const double phi = l->step * (x + 0.5) * CELLS, theta = PI * (y + 0.5) / height;
    const double cosine = (normal[0] * cos(phi) + normal[1] * sin(phi)) * sin(theta)
                        + normal[2] * cos(theta);

    if (cosine < -reach)
        return 0.0;
    return cosine > reach ? cosine_over(l, normal, x * CELLS, y * CELLS, CELLS)
                          : cosine_above(l, normal, x * CELLS, y * CELLS);
}

/* By brute force over the texels, within 2e-6 as finer cells show. */
static void find_irradiance(scene *s)
{
    const int width = s->map.width, height = s->map.height;
    const double reach = hypot(PI / width, 0.5 * PI / height);
    lattice l = lattice_create(width, height);
    int x, y, k;

    for (y = 0; y < height; y++)
        for (x = 0; x < width; x++) {
            const float *rgb = s->map.rgb + 3 * ((size_t)y * (size_t)width + (size_t)x);
            const double light = 0.2126 * (double)rgb[0] + 0.7152 * (double)rgb[1]
                               + 0.0722 * (double)rgb[2];

            for (k = 0; k < NORMAL_COUNT; k++)
                s->irradiance[k] += light * texel_irradiance(&l, normals[k], x, y, height, reach);
        }
    free(l.x);
    free(l.y);
}

/* ---- a scene ---- */

/* As the library counts pixels: the baseline does not look. */
static void mend(image *map)
{
    const size_t count = (size_t)map->width * (size_t)map->height;
    size_t i;
    int c;

    for (i = 0; i < count; i++) {
        float *rgb = map->rgb + 3 * i;
        const int finite = isfinite(rgb[0]) && isfinite(rgb[1]) && isfinite(rgb[2]);

        for (c = 0; c < 3; c++)
            rgb[c] = finite && rgb[c] > 0.0f ? rgb[c] : 0.0f;
    }
}

static int build(scene *s)
{
    static const int blocks[FIT + 1] = { 6144, 16384, 6144, 6144 };
    static const envsamp_kd_select selects[FIT + 1] = {
        ENVSAMP_KD_WARP, ENVSAMP_KD_WARP, ENVSAMP_KD_ALIAS, ENVSAMP_KD_FIT
    };
    int i, built = 1;

    for (i = 0; i <= FIT; i++) {
        envsamp_kd_desc desc = envsamp_kd_defaults();

        desc.block_count = blocks[i];
        desc.select = selects[i];
        desc.nearest = 1;
        built &= bench_table_build(&s->tables[i], &s->view, &desc);
    }
    return built & baseline_cdf_create(s->map.rgb, s->map.width, s->map.height, &s->cdf);
}

static int scene_create(scene *s, map_set *set, int index)
{
    memset(s, 0, sizeof *s);
    if (!map_set_load(set, index, &s->map))
        return 0;
    mend(&s->map);
    s->view = bench_view(&s->map);
    find_irradiance(s);
    return build(s);
}

static void scene_destroy(scene *s)
{
    int i;

    for (i = 0; i <= FIT; i++)
        bench_table_free(&s->tables[i]);
    baseline_cdf_destroy(&s->cdf);
    image_free(&s->map);
}

/* ---- estimates ---- */

/* Draws a direction; returns luminance / pdf in it. A pole that has pdf 0 counts as 0. */
static double draw(const scene *s, int sampler, const float u[2], double dir[3])
{
    float direction[3], rgb[3], pdf;
    int c;

    if (sampler <= FIT) {
        const envsamp_sample drawn = envsamp_kd_sample(s->tables[sampler].kd, u[0], u[1]);

        memcpy(direction, drawn.dir, sizeof direction);
        pdf = drawn.pdf;
    } else {
        const baseline_sample drawn = baseline_cdf_sample(&s->cdf, u[0], u[1]);

        memcpy(direction, drawn.dir, sizeof direction);
        pdf = drawn.pdf;
    }
    for (c = 0; c < 3; c++)
        dir[c] = (double)direction[c];
    if (!(pdf > 0.0f))
        return 0.0;
    envsamp_lookup(&s->view, 1, direction, rgb);
    return (0.2126 * (double)rgb[0] + 0.7152 * (double)rgb[1] + 0.0722 * (double)rgb[2])
         / (double)pdf;
}

/* Mean square over the normals of the relative error of `sums` over n samples. */
static double square_error(const scene *s, const double *sums, int n)
{
    double square = 0.0;
    int k;

    for (k = 0; k < NORMAL_COUNT; k++) {
        const double error = sums[k] / n / s->irradiance[k] - 1.0;

        square += error * error;
    }
    return square / NORMAL_COUNT;
}

/* Adds the square errors of one scrambling, whose first 4, 8.. points are nets themselves. */
static void add_scrambling(const scene *s, int sampler, uint32_t seed, double *squares)
{
    pcg32 random = pcg32_make(seed, 1);
    double sums[NORMAL_COUNT] = { 0.0 }, dir[3];
    int i, k, at = 0;

    for (i = 0; at < N_COUNT; i++) {
        float u[2];
        double weight;

        sobol_owen((uint32_t)i, seed, u);
        if (sampler == INDEPENDENT) {
            u[0] = pcg32_float(&random);
            u[1] = pcg32_float(&random);
        }
        weight = draw(s, sampler, u, dir);
        for (k = 0; k < NORMAL_COUNT; k++) {
            const double cosine = normals[k][0] * dir[0] + normals[k][1] * dir[1]
                                + normals[k][2] * dir[2];

            sums[k] += cosine > 0.0 ? weight * cosine : 0.0;
        }
        if (i + 1 == N_FIRST << at)
            squares[at++] += square_error(s, sums, i + 1);
    }
}

/* Every map has scramblings of its own, so that their chances average out in the means. */
static void measure(const scene *s, int map, int scramblings, errors *out)
{
    int sampler, i;

    memset(out, 0, sizeof *out);
    for (sampler = 0; sampler < SAMPLER_COUNT; sampler++) {
        double *rmse = out->rmse[sampler];

        for (i = 0; i < scramblings; i++)
            add_scrambling(s, sampler, hash_combine((uint32_t)map, (uint32_t)i), rmse);
        for (i = 0; i < N_COUNT; i++)
            rmse[i] = sqrt(rmse[i] / scramblings);
    }
}

/* ---- printing ---- */

/* Geometric means over the maps. */
static errors mean_errors(const errors *maps, int count)
{
    errors mean;
    int sampler, i, m;

    for (sampler = 0; sampler < SAMPLER_COUNT; sampler++)
        for (i = 0; i < N_COUNT; i++) {
            double sum = 0.0;

            for (m = 0; m < count; m++)
                sum += log(maps[m].rmse[sampler][i]);
            mean.rmse[sampler][i] = exp(sum / count);
        }
    return mean;
}

/* RMSE, or, where `ratio`, that over the RMSE of inversion. */
static void print_means(const char *title, const errors *mean, int ratio)
{
    int sampler, i;

    printf("\n%s\n\n%6s", title, "N");
    for (sampler = 0; sampler < SAMPLER_COUNT; sampler++)
        printf(" %12s", names[sampler]);
    printf("\n");
    for (i = 0; i < N_COUNT; i++) {
        printf("%6d", N_FIRST << i);
        for (sampler = 0; sampler < SAMPLER_COUNT; sampler++)
            if (ratio)
                printf(" %12.3f", mean->rmse[sampler][i] / mean->rmse[INVERSION][i]);
            else
                printf(" %12.5f", mean->rmse[sampler][i]);
        printf("\n");
    }
}

static void print_map(const char *name, const errors *e)
{
    const double warp = e->rmse[WARP][N_TABLE], fine = e->rmse[WARP_FINE][N_TABLE];
    const double alias = e->rmse[ALIAS][N_TABLE], inversion = e->rmse[INVERSION][N_TABLE];

    printf("%-10s %10.5f %10.5f %10.5f %10.5f %10.3f %10.3f %10.2f\n", name, warp, fine, alias,
           inversion, warp / inversion, fine / inversion, alias / warp);
}

static void print_maps(const map_set *set, const errors *maps, const errors *mean)
{
    const double *warp = mean->rmse[WARP], *fine = mean->rmse[WARP_FINE];
    const double *inversion = mean->rmse[INVERSION];
    int m;

    printf("\nRMSE at N = %d, and ratios\n\n%-10s %10s %10s %10s %10s %10s %10s %10s\n",
           N_FIRST << N_TABLE, "map", "W 6144", "W 16384", "ALIAS", "INVERSION", "W 6/INV",
           "W 16/INV", "ALIAS/W 6");
    for (m = 0; m < set->count; m++)
        print_map(map_set_name(set, m), &maps[m]);
    print_map("geo. mean", mean);
    if (!promises_shown())
        return;
    printf("W 6/INV%s\n", promise("<=", 1.1, warp[N_TABLE] <= 1.1 * inversion[N_TABLE]));
    printf("W 16/INV%s\n", promise("<=", 0.95, fine[N_TABLE] <= 0.95 * inversion[N_TABLE]));
}

static int draw_plot(const errors *mean, const char *path)
{
    plot_series series[SAMPLER_COUNT];
    plot p = { "RELATIVE RMSE OF IRRADIANCE, GEOMETRIC MEAN OVER MAPS", "SAMPLES N", N_FIRST,
               N_COUNT, NULL, SAMPLER_COUNT };
    char error[512];
    int i;

    for (i = 0; i < SAMPLER_COUNT; i++) {
        series[i].name = names[i];
        memcpy(series[i].colour, colours[i], sizeof series[i].colour);
        series[i].values = mean->rmse[i];
    }
    p.series = series;
    if (plot_write(&p, path, error, sizeof error)) {
        printf("\nplot: %s\n", path);
        return 1;
    }
    fprintf(stderr, "convergence: %s\n", error);
    return 0;
}

static int parse(int argc, char **argv, options *out)
{
    int i;

    out->path = NULL;
    out->scramblings = 64;
    for (i = 1; i + 1 < argc; i += 2)
        if (strcmp(argv[i], "-o") == 0)
            out->path = argv[i + 1];
        else if (strcmp(argv[i], "-r") == 0)
            out->scramblings = atoi(argv[i + 1]);
        else
            break;
    return i == argc && out->scramblings > 0;
}

int main(int argc, char **argv)
{
    static errors maps[MAP_SET_MAX];
    map_set set = map_set_find("convergence");
    static scene s;
    options chosen;
    errors mean;
    int m, made = 1;

    if (!parse(argc, argv, &chosen)) {
        fprintf(stderr, "usage: convergence [-o FILE.png] [-r SCRAMBLINGS]\n");
        return 1;
    }
    make_normals();
    for (m = 0; m < set.count && made; m++) {
        made = scene_create(&s, &set, m);
        if (made)
            measure(&s, m, chosen.scramblings, &maps[m]);
        scene_destroy(&s);
    }
    map_set_done(&set);
    if (!made)
        return 1;
    mean = mean_errors(maps, set.count);
    printf("%d %s maps of 512x256; relative RMSE of irradiance over %d normals, %d scramblings\n",
           set.count, map_set_kind(&set), NORMAL_COUNT, chosen.scramblings);
    print_means("Geometric mean over the maps", &mean, 0);
    print_means("The same over that of INVERSION", &mean, 1);
    print_maps(&set, maps, &mean);
    return chosen.path && !draw_plot(&mean, chosen.path);
}
