/* importance.c: exponent of importance x MIS compensation x light x cosine, in a scene lit by
 * multiple importance sampling.
 *
 *     importance    tables on stdout; four minutes
 *
 * A diffuse and a glossy sphere on a plane, with shadows; 16 samples a point, half of them from the
 * table and half from the BSDF, by the power heuristic, Owen-Sobol. RMSE of luminance over that of
 * WARP with exponent 1 and no compensation: geometric mean over all maps, and the worst map.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#define SCENE_GLOSS 64.0f
#include "../examples/common/mis_scene.h"
#include "map_set.h"

#define PIXELS (SCENE_WIDTH * SCENE_HEIGHT)
#define COUNT 16                /* samples a point */
#define TRUTH 512               /* of the reference */

enum { ALL, DIFFUSE, GLOSSY, SURFACES };

static const char *const surface_names[SURFACES] = { "all points", "diffuse", "glossy" };
static const float exponents[] = { 0.7f, 0.85f, 1.0f, 1.15f, 1.3f, 1.5f, 2.0f };
static const float amounts[] = { 0.0f, 0.5f, 1.0f };

#define EXPONENTS ((int)(sizeof exponents / sizeof exponents[0]))
#define AMOUNTS ((int)(sizeof amounts / sizeof amounts[0]))
#define PLAIN 2                 /* exponent 1 */

/* A point that is seen, what samples of it face in the map's space, and its light. */
typedef struct lit { mis_point point; float axis[3]; double truth; } lit;

static lit points[PIXELS];
static int point_count;
static mis_scene scene;
static double errors[SURFACES][2][AMOUNTS][EXPONENTS][MAP_SET_MAX];    /* [facing] */

static void fail(const char *what)
{
    fprintf(stderr, "importance: %s\n", what);
    exit(1);
}

/* ---- tables ---- */

static void *build(const envsamp_image *view, int facing, float amount, float exponent,
                   const envsamp_kd **kd)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_buffer table, scratch;
    envsamp_sizes sizes;

    desc.facing = facing;
    desc.mis_compensation = amount;
    desc.importance_exponent = exponent;
    if (envsamp_kd_sizes(view, &desc, &sizes) != ENVSAMP_OK)
        fail("sizes");
    table.data = bench_allocate(table.bytes = sizes.table_bytes);
    scratch.data = bench_allocate(scratch.bytes = sizes.scratch_bytes);
    if (envsamp_kd_build(view, &desc, table, scratch, kd) != ENVSAMP_OK)
        fail("a build");
    free(scratch.data);
    return table.data;
}

/* ---- the scene ---- */

/* What a point shows of one sample, by `density` of whom it was drawn and `other` of the other. */
static double shown(const mis_point *p, const float dir[3], const float map_dir[3], float density,
                    float other)
{
    const float lobe = mis_lobe(p, dir);
    float radiance[3];

    if (!(lobe > 0.0f && density > 0.0f) || mis_shadowed(p, dir))
        return 0.0;
    envsamp_lookup(scene.view, 0, map_dir, radiance);
    return (double)(p->albedo * lobe * envsamp_luminance(radiance)
                    * envsamp_mis_power(density, other) / density);
}

static double light_point(const envsamp_kd *kd, int facing, const lit *at, uint32_t count,
                          uint32_t seed)
{
    double sum = 0.0;
    uint32_t i;

    for (i = 0; i < count / 2; i++) {
        float u[2], dir[3], map_dir[3], pdf;
        envsamp_sample s;

        sobol_owen(i, seed, u);
        s = facing ? envsamp_kd_sample_facing(kd, at->axis, u[0], u[1])
                   : envsamp_kd_sample(kd, u[0], u[1]);
        mis_from_map(&scene, s.dir, dir);
        sum += shown(&at->point, dir, s.dir, s.pdf, mis_lobe(&at->point, dir));
        sobol_owen(i, hash_combine(seed, 1), u);
        mis_draw_lobe(&at->point, u, dir);
        mis_to_map(&scene, dir, map_dir);
        pdf = facing ? envsamp_kd_pdf_facing(kd, at->axis, map_dir) : envsamp_kd_pdf(kd, map_dir);
        sum += shown(&at->point, dir, map_dir, mis_lobe(&at->point, dir), pdf);
    }
    return 2.0 * sum / (double)count;
}

/* Turns the map over the scene, meets the scene, and lights its points for the reference. */
static void find_points(const envsamp_kd *kd)
{
    int i;

    scene.plain = mis_light_of_kd(kd);
    mis_turn_map(&scene);
    point_count = 0;
    for (i = 0; i < PIXELS; i++) {
        lit *at = &points[point_count];
        float dir[3];

        if (!mis_pixel(i % SCENE_WIDTH, i / SCENE_WIDTH, &at->point, dir))
            continue;
        mis_to_map(&scene, at->point.glossy ? at->point.mirror : at->point.normal, at->axis);
        at->truth = light_point(kd, 1, at, TRUTH, hash_combine(17, (uint32_t)i));
        point_count++;
    }
}

static void measure(const envsamp_kd *kd, int facing, int amount, int exponent, int index)
{
    double square[SURFACES] = { 0.0 };
    int i, surface;

    for (i = 0; i < point_count; i++) {
        const double off = light_point(kd, facing, &points[i], COUNT, hash_combine(13, (uint32_t)i))
                         - points[i].truth;

        square[ALL] += off * off;
        square[points[i].point.glossy ? GLOSSY : DIFFUSE] += off * off;
    }
    for (surface = 0; surface < SURFACES; surface++)
        errors[surface][facing][amount][exponent][index] = sqrt(square[surface]);
}

static void measure_map(const image *map, int index)
{
    const envsamp_image view = bench_view(map);
    int facing, amount, exponent;
    const envsamp_kd *kd;
    void *memory;

    scene.view = &view;
    memory = build(&view, 1, 0.5f, 1.0f, &kd);
    find_points(kd);
    free(memory);
    for (facing = 0; facing < 2; facing++)
        for (amount = 0; amount < AMOUNTS; amount++)
            for (exponent = 0; exponent < EXPONENTS; exponent++) {
                memory = build(&view, facing, amounts[amount], exponents[exponent], &kd);
                measure(kd, facing, amount, exponent, index);
                free(memory);
            }
}

/* ---- tables of errors ---- */

static void print_cell(int surface, int facing, int amount, int exponent, int count)
{
    double sum = 0.0, worst = 0.0;
    int i;

    for (i = 0; i < count; i++) {
        const double ratio = errors[surface][facing][amount][exponent][i]
                           / errors[surface][0][0][PLAIN][i];

        sum += log(ratio);
        worst = fmax(worst, ratio);
    }
    printf("%7.2f%6.2f", exp(sum / (double)count), worst);
}

static void print_table(int surface, int count)
{
    int exponent, facing, amount;

    printf("\n%-11s%39s%39s\nexponent   ", surface_names[surface], "light alone", "light x cosine");
    for (facing = 0; facing < 2; facing++)
        for (amount = 0; amount < AMOUNTS; amount++)
            printf("  comp %.1f    ", (double)amounts[amount]);
    printf("\n");
    for (exponent = 0; exponent < EXPONENTS; exponent++) {
        printf("%-11.3g", (double)exponents[exponent]);
        for (facing = 0; facing < 2; facing++)
            for (amount = 0; amount < AMOUNTS; amount++)
                print_cell(surface, facing, amount, exponent, count);
        printf("\n");
    }
}

int main(void)
{
    map_set set = map_set_find("importance");
    int i, surface;
    image map;

    printf("maps %d, %s, bilinear; %d samples a point, half by the table, half by the BSDF\n",
           set.count, map_set_kind(&set), COUNT);
    printf("RMSE over that of WARP alone: geometric mean and worst map\n");
    for (i = 0; i < set.count; i++) {
        if (!map_set_load(&set, i, &map))
            return 1;
        measure_map(&map, i);
        image_free(&map);
    }
    map_set_done(&set);
    for (surface = 0; surface < SURFACES; surface++)
        print_table(surface, set.count);
    return 0;
}
