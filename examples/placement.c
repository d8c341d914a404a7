/* placement.c: a map the right way round in eleven engines, by one table, turned and exposed.
 *
 * The functions to take over are in common/placement.h. This prints where each engine shows the
 * centre of a picture and what is left of it. Then it checks in each that a drawn direction has the
 * density and the light of that direction, and that the draws give the map's integral. Exits with 1
 * where they do not.
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
#define SAMPLE_COUNT 4096
#define TURN 0.5f                /* radians about the engine's up axis */
#define EXPOSURE 4.0f            /* 2 EV */

/* The table of a map as it is; NULL if it fails. *memory is to be freed. */
static const envsamp_kd *build(const envsamp_image *map, void **memory)
{
    const envsamp_kd *kd = NULL;
    envsamp_buffer table, scratch;
    envsamp_sizes sizes;
    envsamp_result result;

    envsamp_kd_sizes(map, NULL, &sizes);       /* the build repeats what fails here */
    *memory = table.data = malloc(table.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    result = envsamp_kd_build(map, NULL, table, scratch, &kd);
    free(scratch.data);
    if (result != ENVSAMP_OK)
        fprintf(stderr, "placement: %s\n", envsamp_result_string(result));
    return kd;
}

/* "+x", "-z": the axis of the world that a point on the map's horizon lies on. */
static const char *axis_of(const environment *e, float u)
{
    static const char *const names[6] = { "+x", "-x", "+y", "-y", "+z", "-z" };
    float map_dir[3], world[3];
    int i, longest = 0;

    envsamp_uv_to_dir(ENVSAMP_LATLONG, u, 0.5f, map_dir);
    environment_to_world(e, map_dir, world);
    for (i = 1; i < 3; i++)
        if (fabsf(world[i]) > fabsf(world[longest]))
            longest = i;
    return names[2 * longest + (world[longest] < 0.0f)];
}

static int close_to(float a, float b)
{
    return fabsf(a - b) <= 1e-3f * fabsf(b);
}

/* The luminance over the sphere by draws, and how many draws do not have the density and the light
   of their direction: those that rounding puts over the edge of a block. */
static double integrate(const environment *e, int *strays)
{
    double sum = 0.0;
    int i;

    *strays = 0;
    for (i = 0; i < SAMPLE_COUNT; i++) {
        float u[2], here[3];
        environment_light light;

        sobol_owen((uint32_t)i, 1, u);
        light = environment_sample(e, u[0], u[1]);
        sum += (double)(envsamp_luminance(light.radiance) / light.pdf);
        environment_radiance(e, light.dir, here);
        *strays += !close_to(environment_pdf(e, light.dir), light.pdf)
                   || !close_to(envsamp_luminance(here), envsamp_luminance(light.radiance));
    }
    return sum / SAMPLE_COUNT;
}

static int check(environment *e, const char *name, double integral)
{
    const char *centre, *left;
    double sum;
    int strays, good;

    if (!environment_place(e, name)) {
        printf("%-20s reads octahedral maps\n", name);
        return 1;
    }
    centre = axis_of(e, 0.5f);
    left = axis_of(e, 0.25f);
    environment_rotate(e, TURN);
    sum = integrate(e, &strays);
    good = fabs(sum / (integral * (double)e->exposure) - 1.0) < 0.01 && strays < SAMPLE_COUNT / 200;
    printf("%-20s %6s %6s %13.3f %7d%s\n", name, centre, left, sum, strays, good ? "" : " WRONG");
    return good;
}

int main(void)
{
    const environment_preset *preset = environment_presets();
    envsamp_image view = { NULL, WIDTH, HEIGHT, 3, 0, ENVSAMP_LATLONG };
    const envsamp_kd *kd = NULL;
    void *memory = NULL;
    int good = 0;
    image map;

    if (map_make("sky", WIDTH, HEIGHT, &map)) {
        view.pixels = map.rgb;
        kd = build(&view, &memory);
    }
    if (kd) {
        environment e = environment_make(kd, &view);
        envsamp_kd_info info;

        envsamp_kd_get_info(kd, &info);
        e.exposure = EXPOSURE;
        printf("a sky with an integral of %.3f, exposed by %g, turned by %g\n\n", info.integral,
               (double)EXPOSURE, (double)TURN);
        printf("%-20s %6s %6s %13s %7s\n", "engine", "centre", "left", "integral", "strays");
        for (good = 1; preset->name; preset++)
            good = check(&e, preset->name, info.integral) && good;
    }
    free(memory);
    image_free(&map);
    puts(good ? "\nall agree" : "\nWRONG");
    return !good;
}
