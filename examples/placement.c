/* placement.c: one table in several worlds: turned, y up, left-handed, exposed and tinted.
 *
 * The functions to take over are in common/placement.h. Here they estimate the irradiance of a
 * tilted plane, by draws of the environment and by MIS with draws of the plane's cosine, beside a
 * sum over the texels where they lie in that world. The excess variance shows that all is free but
 * a tint, what a strong one costs, and that a rebuild gets it back. Exits with 1 where an estimate
 * is off by more than chance.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "common/maps.h"
#include "common/placement.h"
#include "common/random.h"

#include <stdio.h>
#include <stdlib.h>

#define WIDTH 256
#define HEIGHT 128
#define SPLIT 4                      /* parts of a texel, each way, for the sake of the horizon */
#define SAMPLE_COUNT (1 << 17)
#define SIGMAS 5.0                   /* 1 in 10^6 of right estimates are further off */
#define STRAYS 0.001                 /* of all draws: directions rounded over the edge of a block */

enum { DRAWN, WITH_MIS, WAY_COUNT };

static const float pi = 3.14159265f;
static const float normal[3] = { 0.48f, 0.6f, 0.64f };      /* of the plane, in the world */

static float plane_cosine(const float dir[3])
{
    const float cosine = normal[0] * dir[0] + normal[1] * dir[1] + normal[2] * dir[2];

    return cosine > 0.0f ? cosine : 0.0f;
}

/* The table of a map as it is; NULL if it fails. *memory is to be freed. */
static const envsamp_kd *build(const envsamp_image *map, void **memory)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    const envsamp_kd *kd = NULL;
    envsamp_buffer table, scratch;
    envsamp_sizes sizes;
    envsamp_result result;

    desc.nearest = NEAREST;
    envsamp_kd_sizes(map, &desc, &sizes);      /* the build repeats what fails here */
    *memory = table.data = malloc(table.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    result = envsamp_kd_build(map, &desc, table, scratch, &kd);
    free(scratch.data);
    if (result != ENVSAMP_OK)
        fprintf(stderr, "placement: %s\n", envsamp_result_string(result));
    return kd;
}

/* ---- irradiance of the plane ---- */

/* Sums over parts of texels. Returns the excess variance, E[(L/pdf)^2] / E[L/pdf]^2 - 1, of the
   luminance in the world. */
static double quadrature(const environment *e, double irradiance[3])
{
    const int columns = WIDTH * SPLIT, rows = HEIGHT * SPLIT;
    double power = 0.0, squares = 0.0;
    int i, k;

    irradiance[0] = irradiance[1] = irradiance[2] = 0.0;
    for (i = 0; i < columns * rows; i++) {
        const double u = (i % columns + 0.5) / columns, v = (i / columns + 0.5) / rows;
        const double sr = 4.0 * (double)pi / columns * sin(0.5 * (double)pi / rows)
                          * sin((double)pi * v);
        float map_dir[3], dir[3], light[3];
        double luminance;

        envsamp_uv_to_dir(ENVSAMP_LATLONG, (float)u, (float)v, map_dir);
        environment_to_world(e, map_dir, dir);
        environment_lookup(e, map_dir, light);
        luminance = (double)envsamp_luminance(light);
        power += luminance * sr;
        if (luminance > 0.0)
            squares += luminance * luminance / (double)environment_pdf(e, dir) * sr;
        for (k = 0; k < 3; k++)
            irradiance[k] += (double)(light[k] * plane_cosine(dir)) * sr;
    }
    return squares / (power * power) - 1.0;
}

/* A direction in proportion to the cosine: the normal plus a point of the unit sphere. */
static void draw_cosine(const float u[2], float dir[3])
{
    float length;
    int k;

    envsamp_uv_to_dir(ENVSAMP_LATLONG, u[0], acosf(1.0f - 2.0f * u[1]) / pi, dir);
    for (k = 0; k < 3; k++)
        dir[k] += normal[k];
    length = sqrtf(dir[0] * dir[0] + dir[1] * dir[1] + dir[2] * dir[2]);
    for (k = 0; k < 3; k++)
        dir[k] = length > 0.0f ? dir[k] / length : normal[k];
}

/* Irradiance by a draw of the environment, and by that and one of the cosine, whose own density
   cancels all but pi. Returns whether pdf and light of the draw are those of its direction. */
static int draw(const environment *e, const float u[4], float value[WAY_COUNT][3])
{
    const environment_light light = environment_sample(e, u[0], u[1]);
    const float cosine = plane_cosine(light.dir);
    const float weight = envsamp_mis_power(light.pdf, cosine / pi);
    float dir[3], radiance[3], here[3], plane_weight;
    int k;

    environment_radiance(e, light.dir, here);
    draw_cosine(u + 2, dir);
    environment_radiance(e, dir, radiance);
    plane_weight = envsamp_mis_power(plane_cosine(dir) / pi, environment_pdf(e, dir));
    for (k = 0; k < 3; k++) {
        value[DRAWN][k] = light.radiance[k] * cosine / light.pdf;
        value[WITH_MIS][k] = value[DRAWN][k] * weight + radiance[k] * pi * plane_weight;
    }
    return fabsf(environment_pdf(e, light.dir) / light.pdf - 1.0f) <= 1e-4f
           && fabsf(envsamp_luminance(here) / envsamp_luminance(light.radiance) - 1.0f) <= 1e-4f;
}

/* Means and standard errors, a channel. Returns how many draws did not agree. */
static int estimate(const environment *e, double mean[WAY_COUNT][3], double error[WAY_COUNT][3])
{
    double sum[WAY_COUNT][3] = { { 0.0 } }, squares[WAY_COUNT][3] = { { 0.0 } };
    pcg32 random = pcg32_make(7, 0);
    int i, k, way, strays = 0;

    for (i = 0; i < SAMPLE_COUNT; i++) {
        float u[4], value[WAY_COUNT][3];

        for (k = 0; k < 4; k++)
            u[k] = pcg32_float(&random);
        strays += !draw(e, u, value);
        for (way = 0; way < WAY_COUNT; way++)
            for (k = 0; k < 3; k++) {
                sum[way][k] += (double)value[way][k];
                squares[way][k] += (double)value[way][k] * (double)value[way][k];
            }
    }
    for (way = 0; way < WAY_COUNT; way++)
        for (k = 0; k < 3; k++) {
            const double m = mean[way][k] = sum[way][k] / SAMPLE_COUNT;

            error[way][k] = sqrt((squares[way][k] / SAMPLE_COUNT - m * m) / SAMPLE_COUNT);
        }
    return strays;
}

/* Prints a placement and returns whether all of it agrees. */
static int check(const char *name, const environment *e)
{
    static const char *const ways[WAY_COUNT] = { "drawn", "MIS" };
    double exact[3], mean[WAY_COUNT][3], error[WAY_COUNT][3];
    const double excess = quadrature(e, exact);
    const int strays = estimate(e, mean, error);
    int k, way, good = strays <= STRAYS * SAMPLE_COUNT;

    printf("%-22s texels %9.3f %9.3f %9.3f   excess variance %.4f, %d stray\n", name, exact[0],
           exact[1], exact[2], excess, strays);
    for (way = 0; way < WAY_COUNT; way++) {
        printf("%22s %-6s %9.3f %9.3f %9.3f   standard errors off:", "", ways[way], mean[way][0],
               mean[way][1], mean[way][2]);
        for (k = 0; k < 3; k++) {
            const double off = (mean[way][k] - exact[k]) / error[way][k];

            good = good && fabs(off) <= SIGMAS;
            printf(" %.1f", off);
        }
        printf("\n");
    }
    return good;
}

/* ---- one table, many worlds ---- */

static int check_placements(environment *e)
{
    static const float tilted[3] = { 0.6f, 0.0f, 0.8f }, up[3] = { 0.0f, 1.0f, 0.0f };
    int good = check("z up", e);

    environment_turn(e, tilted, 2.0f);
    good = check("z up, turned", e) && good;
    environment_y_up(e, 1);
    good = check("y up, left-handed", e) && good;
    environment_y_up(e, 0);
    good = check("y up, right-handed", e) && good;
    environment_turn(e, up, 0.7f);
    good = check("  turned about y", e) && good;
    e->exposure = 4.0f;              /* 2 EV */
    good = check("  exposure 4", e) && good;
    e->tint[0] = 0.05f;              /* moonlight out of a day */
    e->tint[1] = 0.2f;
    return check("  tint 0.05, 0.2, 1", e) && good;
}

int main(void)
{
    envsamp_image view = { NULL, WIDTH, HEIGHT, 3, 0, ENVSAMP_LATLONG };
    void *first = NULL, *second = NULL;
    environment e = environment_make(NULL, &view);
    image map;
    int i, good = 0;

    if (map_make("sky", WIDTH, HEIGHT, &map)) {
        view.pixels = map.rgb;
        e.kd = build(&view, &first);
        good = e.kd && check_placements(&e);
        for (i = 0; i < WIDTH * HEIGHT * 3; i++)     /* the tint goes into the pixels */
            map.rgb[i] *= e.tint[i % 3];
        e.tint[0] = e.tint[1] = e.tint[2] = 1.0f;
        e.kd = build(&view, &second);
        good = e.kd && check("  the same, rebuilt", &e) && good;
    }
    free(first);
    free(second);
    image_free(&map);
    puts(good ? "all agree" : "WRONG");
    return !good;
}
