/* test_placement.c: an environment in the worlds of engines, turned, exposed and tinted, by the
 * functions of examples/common/placement.h: presets against each engine's formula from direction to
 * u and v; irradiance of a tilted plane against sums over texels that are placed by angles here, in
 * double; each kind of check beside the mistakes that it must reject.
 */
#include "check.h"

#include "../envsamp.h"

#include "statistics.h"
#include "../examples/common/maps.h"
#include "../examples/common/placement.h"
#include "../examples/common/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PI 3.14159265358979323846
#define WIDTH 256
#define HEIGHT 128
#define TEXEL_COUNT (WIDTH * HEIGHT)
#define SPLIT 4                 /* parts of a texel, each way, for the sake of the horizon */
#define SAMPLES (1 << 18)
#define ROUNDING 1e-5           /* relative, of floats and of the sum over parts */
#define STRAYS 0.001            /* of all draws: directions rounded over an edge */

static const double normal[3] = { 0.48, 0.6, 0.64 };

/* ---- the map and its table ---- */

typedef struct fixture {
    image map;
    envsamp_image view;
    void *table;
    const envsamp_kd *kd;
} fixture;

static void fixture_build_for(fixture *f, int nearest)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_buffer table, scratch;
    envsamp_result result;
    envsamp_sizes sizes;

    memset(&f->view, 0, sizeof f->view);
    f->view.pixels = f->map.rgb;
    f->view.width = f->map.width;
    f->view.height = f->map.height;
    f->view.channels = 3;
    desc.nearest = nearest;
    envsamp_kd_sizes(&f->view, &desc, &sizes);
    free(f->table);
    f->table = table.data = malloc(table.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    result = envsamp_kd_build(&f->view, &desc, table, scratch, &f->kd);
    free(scratch.data);
    if (result != ENVSAMP_OK) {
        printf("Bail out! %s\n", envsamp_result_string(result));
        exit(1);
    }
}

/* Of the nearest texel, so that a sum over texels is exact. */
static void fixture_build(fixture *f)
{
    fixture_build_for(f, 1);
}

static void fixture_make(fixture *f, const char *name)
{
    memset(f, 0, sizeof *f);
    if (!map_make(name, WIDTH, HEIGHT, &f->map)) {
        printf("Bail out! out of memory\n");
        exit(1);
    }
    fixture_build(f);
}

static void fixture_free(fixture *f)
{
    image_free(&f->map);
    free(f->table);
}

/* ---- places: as the functions make them, and where the map's axes must then be ---- */

typedef struct place {
    environment e;
    double axes[3][3];          /* of the map, in the world */
    double factor[3];           /* of the light */
} place;

enum { Z_UP, TURNED, Y_UP, LEFT_HANDED, Y_UP_TURNED, EXPOSED, TINTED, ALL, PLACE_COUNT };

static const char *const place_names[PLACE_COUNT] = {
    "as it is", "turned", "three.js", "Unity", "three.js, turned", "exposure", "tint",
    "Unity, turned, exposure and tint"
};

static const float axis_tilted[3] = { 0.6f, 0, 0.8f };

/* Turns the axes about axis k of the world. */
static void turn(place *p, int k, double angle)
{
    const int a = (k + 1) % 3, b = (k + 2) % 3;
    int i;

    for (i = 0; i < 3; i++) {
        const double va = p->axes[i][a], vb = p->axes[i][b];

        p->axes[i][a] = cos(angle) * va - sin(angle) * vb;
        p->axes[i][b] = sin(angle) * va + cos(angle) * vb;
    }
}

/* About axis_tilted, by way of the z axis. */
static void turn_tilted(place *p, double angle)
{
    const double tilt = asin(0.6);

    turn(p, 1, -tilt);
    turn(p, 2, angle);
    turn(p, 1, tilt);
}

/* y of the map is that times z of an engine with y up, or y of the map where it is 0. */
static void place_axes(place *p, double y_of_map)
{
    memset(p->axes, 0, sizeof p->axes);
    p->axes[0][0] = y_of_map == 0.0 ? 1.0 : -1.0;
    p->axes[1][y_of_map == 0.0 ? 1 : 2] = y_of_map == 0.0 ? 1.0 : y_of_map;
    p->axes[2][y_of_map == 0.0 ? 2 : 1] = 1.0;
}

static void place_light(place *p, double exposure, double green, double blue)
{
    p->e.exposure = (float)exposure;
    p->e.tint[1] = (float)green;
    p->e.tint[2] = (float)blue;
    p->factor[0] = exposure;
    p->factor[1] = exposure * green;
    p->factor[2] = exposure * blue;
}

static place place_make(const fixture *f, int which)
{
    place p;

    p.e = environment_make(f->kd, &f->view);
    place_axes(&p, which == Y_UP || which == Y_UP_TURNED ? -1.0
                   : which == LEFT_HANDED || which == ALL ? 1.0 : 0.0);
    if (which == Y_UP || which == Y_UP_TURNED || which == LEFT_HANDED || which == ALL)
        environment_place(&p.e, which == LEFT_HANDED || which == ALL ? "Unity" : "three.js");
    if (which == TURNED || which == ALL) {
        environment_turn(&p.e, axis_tilted, 2.0f);
        turn_tilted(&p, 2.0);
    }
    if (which == Y_UP_TURNED) {
        environment_rotate(&p.e, 0.7f);
        turn(&p, 1, 0.7);
    }
    place_light(&p, which == EXPOSED || which == ALL ? 4.0 : 1.0,
                which == TINTED || which == ALL ? 0.25 : 1.0,
                which == TINTED || which == ALL ? 0.0625 : 1.0);
    return p;
}

/* ---- presets: formulas of the engines, and where the picture lies ---- */

/* What an engine does with a direction of its world: u and v of the picture, v from its top. */
typedef void (*engine_uv)(const double d[3], double uv[2]);

static double turns(double y, double x)
{
    return atan2(y, x) / (2.0 * PI);
}

/* three.js equirectUv, v from the bottom 1/2 + asin(y)/pi; the glTF Sample Viewer's way through a
   cube map, and Tungsten's InfiniteSphere, come to the same. */
static void uv_three(const double d[3], double uv[2])
{
    uv[0] = turns(d[2], d[0]) + 0.5;
    uv[1] = 0.5 - asin(d[1]) / PI;
}

/* Cycles' direction_to_equirectangular, v from the bottom. */
static void uv_cycles(const double d[3], double uv[2])
{
    uv[0] = 0.5 - turns(d[1], d[0]);
    uv[1] = acos(d[2]) / PI;
}

/* Mitsuba's envmap: azimuth from -z towards x, and the angle from y. */
static void uv_mitsuba(const double d[3], double uv[2])
{
    uv[0] = turns(d[0], -d[2]);
    uv[1] = acos(d[1]) / PI;
}

/* Unity's Skybox/Panoramic: (1/2, 1) less longitude and latitude, v from the bottom. */
static void uv_unity(const double d[3], double uv[2])
{
    uv[0] = 0.5 - turns(d[2], d[0]);
    uv[1] = 1.0 - (1.0 - acos(d[1]) / PI);
}

/* Unreal's importer: texels of a Direct3D cube map, y and z exchanged, then looked up with azimuth
   from -z towards x and the angle from y; shaders look the cube map up in the world's direction. */
static void uv_unreal(const double d[3], double uv[2])
{
    const double exchanged[3] = { d[0], d[2], d[1] };

    uv[0] = (1.0 + atan2(exchanged[0], -exchanged[2]) / PI) / 2.0;
    uv[1] = acos(exchanged[1]) / PI;
}

/* Godot's SKY_COORDS: atan(x, -z), below 0 plus a turn, and acos(y). */
static void uv_godot(const double d[3], double uv[2])
{
    uv[0] = turns(d[0], -d[2]);
    uv[1] = acos(d[1]) / PI;
}

/* Filament: azimuth from z towards x, of a direction whose x is mirrored before. */
static void uv_filament(const double d[3], double uv[2])
{
    uv[0] = (atan2(-d[0], d[2]) / PI + 1.0) * 0.5;
    uv[1] = (1.0 - asin(d[1]) * 2.0 / PI) * 0.5;
}

/* pbrt-v3: spherical phi over 2 pi and theta over pi. */
static void uv_pbrt3(const double d[3], double uv[2])
{
    uv[0] = turns(d[1], d[0]);
    uv[1] = acos(d[2]) / PI;
}

/* pbrt-v4: Clarberg's equal-area square. */
static void uv_pbrt4(const double d[3], double uv[2])
{
    const double r = sqrt(1.0 - fabs(d[2])), part = r * 4.0 * turns(fabs(d[1]), fabs(d[0]));
    const double a = d[2] < 0.0 ? 1.0 - part : r - part, b = d[2] < 0.0 ? 1.0 - r + part : part;

    uv[0] = (1.0 + (d[0] < 0.0 ? -a : a)) / 2.0;
    uv[1] = (1.0 + (d[1] < 0.0 ? -b : b)) / 2.0;
}

/* Beside the formula: the hand of the world, and where it shows the centre of a lat-long picture,
   and what is a quarter turn left of it, on the horizon. */
static const struct engine_world {
    const char *name;
    engine_uv uv;
    int left_handed;
    float centre[3], left[3];
} engines[] = {
    { "three.js",           uv_three,    0, { 1, 0, 0 },  { 0, 0, -1 } },
    { "Blender Cycles",     uv_cycles,   0, { 1, 0, 0 },  { 0, 1, 0 } },
    { "Mitsuba 3",          uv_mitsuba,  0, { 0, 0, 1 },  { 1, 0, 0 } },
    { "Unity",              uv_unity,    1, { 1, 0, 0 },  { 0, 0, 1 } },
    { "Unreal",             uv_unreal,   1, { 0, -1, 0 }, { -1, 0, 0 } },
    { "Godot 4",            uv_godot,    0, { 0, 0, 1 },  { 1, 0, 0 } },
    { "Filament",           uv_filament, 0, { 0, 0, 1 },  { 1, 0, 0 } },
    { "glTF Sample Viewer", uv_three,    0, { 1, 0, 0 },  { 0, 0, -1 } },
    { "Tungsten",           uv_three,    0, { 1, 0, 0 },  { 0, 0, -1 } },
    { "pbrt-v3",            uv_pbrt3,    1, { -1, 0, 0 }, { 0, 1, 0 } },
    { "pbrt-v4",            uv_pbrt4,    1, { 0, 0, 0 },  { 0, 0, 0 } }
};

#define ENGINE_COUNT (sizeof engines / sizeof *engines)
#define DIRECTIONS 2000

/* How many random directions have another u or v in the map, by that matrix, than in the engine. */
static int directions_off(const struct engine_world *engine, const environment *e)
{
    pcg32 random = pcg32_make(18, 1);
    int i, off = 0;

    for (i = 0; i < DIRECTIONS; i++) {
        const double z = 2.0 * (double)pcg32_float(&random) - 1.0, level = sqrt(1.0 - z * z);
        const double phi = 2.0 * PI * (double)pcg32_float(&random);
        const double d[3] = { level * cos(phi), level * sin(phi), z };
        const float world[3] = { (float)d[0], (float)d[1], (float)d[2] };
        float map[3], uv[2];
        double expected[2], du;

        engine->uv(d, expected);
        environment_to_map(e, world, map);
        envsamp_dir_to_uv(e->image->mapping, map, uv);
        du = (double)uv[0] - expected[0];
        du -= e->image->mapping == ENVSAMP_LATLONG ? floor(du + 0.5) : 0.0;
        off += !(fabs(du) * fmax(level, 1e-3) < 1e-5 && fabs((double)uv[1] - expected[1]) < 1e-5);
    }
    return off;
}

/* One of the 48 matrices that take axes to axes. */
static void axes_matrix(int which, float m[3][3])
{
    static const int orders[6][3] = { { 0, 1, 2 }, { 1, 2, 0 }, { 2, 0, 1 },
                                      { 0, 2, 1 }, { 2, 1, 0 }, { 1, 0, 2 } };
    int i;

    memset(m, 0, 9 * sizeof(float));
    for (i = 0; i < 3; i++)
        m[i][orders[which / 8][i]] = which >> i & 1 ? -1.0f : 1.0f;
}

/* Of all 48 the preset's alone agrees: no mirror image, no half turn, no other axis up. */
static void test_preset(const struct engine_world *engine, environment *e)
{
    int i, placed, off, least = DIRECTIONS, same = 0;
    float preset[3][3];

    placed = environment_place(e, engine->name);
    off = directions_off(engine, e);
    memcpy(preset, e->to_map, sizeof preset);
    for (i = 0; i < 48; i++) {
        int other;

        axes_matrix(i, e->to_map);
        if (!memcmp(preset, e->to_map, sizeof preset)) {
            same++;
            continue;
        }
        other = directions_off(engine, e);
        least = other < least ? other : least;
    }
    CHECK(placed && IS(off, 0) && IS(same, 1) && least > DIRECTIONS / 4,
          "%s: directions off %d of %d, by the other matrices at least %d", engine->name, off,
          DIRECTIONS, least);
}

static void test_presets(void)
{
    const envsamp_image maps[] = { { NULL, 64, 32, 3, 0, ENVSAMP_LATLONG },
                                   { NULL, 64, 64, 3, 0, ENVSAMP_OCTAHEDRAL } };
    const environment_preset *preset = environment_presets();
    size_t i, count = 0;

    for (i = 0; i < ENGINE_COUNT; i++) {
        environment e = environment_make(NULL, &maps[engines[i].uv == uv_pbrt4]);

        test_preset(&engines[i], &e);
    }
    for (; preset->name; preset++)
        for (i = 0; i < ENGINE_COUNT; i++)
            count += !strcmp(preset->name, engines[i].name);
    CHECK(count == ENGINE_COUNT && preset - environment_presets() == (int)ENGINE_COUNT,
          "every preset has its formula");
}

static void test_refused(void)
{
    const envsamp_image map = { NULL, 64, 32, 3, 0, ENVSAMP_LATLONG };
    environment e = environment_make(NULL, &map), before;

    environment_place(&e, "Unity");
    before = e;
    CHECK(!environment_place(&e, "no such engine") && !environment_place(&e, "")
          && !environment_place(&e, "pbrt-v4") && !memcmp(&e, &before, sizeof e),
          "another name, and an octahedral engine for a lat-long map, change nothing");
}

static double dot_of(const float a[3], const float b[3])
{
    return (double)a[0] * (double)b[0] + (double)a[1] * (double)b[1] + (double)a[2] * (double)b[2];
}

static void cross_of(const float a[3], const float b[3], float product[3])
{
    int i;

    for (i = 0; i < 3; i++)
        product[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

/* The mean direction of draws, weighted with light over density: where the lamp is. */
static void lamp_direction(const environment *e, float dir[3])
{
    pcg32 random = pcg32_make(5, 5);
    double sum[3] = { 0.0, 0.0, 0.0 }, length;
    int i, k;

    for (i = 0; i < 4096; i++) {
        const float u0 = pcg32_float(&random);
        const environment_light light = environment_sample(e, u0, pcg32_float(&random));

        for (k = 0; k < 3; k++)
            sum[k] += (double)(light.dir[k] * light.radiance[1] / light.pdf);
    }
    length = sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    for (k = 0; k < 3; k++)
        dir[k] = (float)(sum[k] / length);
}

/* A lamp of four texels round u = 1/4, v = 1/2: on the horizon, a quarter turn left of the centre,
   for a viewer who faces the centre. Then the map turns by a quarter about the up axis. */
static void test_lamp(const struct engine_world *engine, environment *e)
{
    const float *left = engine->left, behind[3] = { -left[0], -left[1], -left[2] };
    float up[3], found[3], turned[3], quarter[3], side[3], light[3], dark[3];
    double hand;

    environment_place(e, engine->name);
    memcpy(up, e->to_map[2], sizeof up);
    cross_of(up, engine->centre, side);
    hand = engine->left_handed ? -dot_of(side, left) : dot_of(side, left);
    lamp_direction(e, found);
    environment_radiance(e, left, light);
    environment_radiance(e, behind, dark);
    environment_rotate(e, 0.5f * (float)PI);
    lamp_direction(e, turned);
    cross_of(up, left, quarter);
    CHECK(IS_NEAR(hand, 1.0, 1e-6) && dot_of(found, left) > 0.999 && light[1] > 50.0f
          && dark[1] < 50.0f && dot_of(turned, quarter) > 0.999,
          "%s: what is left of the picture's centre is seen at %.2f %.2f %.2f, turned by a quarter"
          " at %.2f %.2f %.2f", engine->name, (double)found[0], (double)found[1],
          (double)found[2], (double)turned[0], (double)turned[1], (double)turned[2]);
}

static void test_lamps(void)
{
    fixture f;
    environment e;
    size_t i;

    memset(&f, 0, sizeof f);
    if (!image_alloc(&f.map, 64, 32))
        return;
    for (i = 0; i < 64 * 32 * 3; i++) {
        const size_t x = i / 3 % 64, y = i / 3 / 64;

        f.map.rgb[i] = (x == 15 || x == 16) && (y == 15 || y == 16) ? 100.0f : 0.001f;
    }
    fixture_build(&f);
    e = environment_make(f.kd, &f.view);
    for (i = 0; i < ENGINE_COUNT; i++)
        if (engines[i].uv != uv_pbrt4)
            test_lamp(&engines[i], &e);
    fixture_free(&f);
}

/* Lookups follow the table. */
static void test_lookup(fixture *f)
{
    const float dir[3] = { 0.36f, 0.48f, 0.8f };
    float expected[2][3], rgb[2][3];
    environment e;
    int nearest, same[2];

    for (nearest = 0; nearest < 2; nearest++) {
        fixture_build_for(f, nearest);
        e = environment_make(f->kd, &f->view);
        environment_radiance(&e, dir, rgb[nearest]);
        envsamp_lookup(&f->view, nearest, dir, expected[nearest]);
        same[nearest] = !memcmp(rgb[nearest], expected[nearest], sizeof *rgb);
    }
    CHECK(same[0] && same[1] && memcmp(rgb[0], rgb[1], sizeof *rgb),
          "lookups are bilinear, or of the nearest texel, as the table is");
}

/* ---- irradiance, by the texels where they lie in the world ---- */

static void add_part(const place *p, double u, double v, double sr, double sum[3])
{
    const double d[3] = { cos(2.0 * PI * u) * sin(PI * v), sin(2.0 * PI * u) * sin(PI * v),
                          cos(PI * v) };
    const float dir[3] = { (float)d[0], (float)d[1], (float)d[2] };
    double cosine = 0.0;
    float rgb[3];
    int i, k;

    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++)
            cosine += normal[k] * d[i] * p->axes[i][k];
    envsamp_lookup(p->e.image, 1, dir, rgb);
    for (i = 0; i < 3 && cosine > 0.0; i++)
        sum[i] += (double)rgb[i] * p->factor[i] * cosine * sr;
}

static void irradiance_of_texels(const place *p, double sum[3])
{
    const int columns = WIDTH * SPLIT, rows = HEIGHT * SPLIT;
    int x, y;

    sum[0] = sum[1] = sum[2] = 0.0;
    for (y = 0; y < rows; y++) {
        const double sr = 2.0 * PI / columns * (cos(PI * y / rows) - cos(PI * (y + 1) / rows));

        for (x = 0; x < columns; x++)
            add_part(p, (x + 0.5) / columns, (y + 0.5) / rows, sr, sum);
    }
}

/* ---- irradiance, by draws ---- */

/* What an engine calls: the functions of placement.h, or some of them with a mistake. */
typedef struct engine {
    const char *name;
    environment_light (*sample)(const environment *e, float u0, float u1);
    float (*pdf)(const environment *e, const float dir[3]);
    void (*radiance)(const environment *e, const float dir[3], float rgb[3]);
} engine;

/* What can be off: irradiance by draws, and by MIS; the pdf, or the light, of a drawn direction. */
enum { DRAWN = 1, MIS = 2, PDF = 4, LIGHT = 8 };

typedef struct verdict {
    int off;
    double p_drawn, p_mis;      /* of the worst channel */
    int pdf_count, light_count; /* draws with another pdf, or other light, than their direction */
} verdict;

static double plane_cosine(const float dir[3])
{
    return fmax(normal[0] * (double)dir[0] + normal[1] * (double)dir[1]
                + normal[2] * (double)dir[2], 0.0);
}

/* In proportion to the cosine: the normal plus a point of the unit sphere. */
static void draw_cosine(pcg32 *random, float dir[3])
{
    const double z = 1.0 - 2.0 * (double)pcg32_float(random), level = sqrt(1.0 - z * z);
    const double phi = 2.0 * PI * (double)pcg32_float(random);
    const double d[3] = { normal[0] + level * cos(phi), normal[1] + level * sin(phi),
                          normal[2] + z };
    const double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    int i;

    for (i = 0; i < 3; i++)
        dir[i] = (float)(length > 0.0 ? d[i] / length : normal[i]);
}

static int differ(float a, float b)
{
    return !(fabsf(a - b) <= 1e-4f * fabsf(b));
}

static void draw(const engine *by, const environment *e, pcg32 *random, verdict *v,
                 stat_moments drawn[3], stat_moments mis[3])
{
    const float u0 = pcg32_float(random), u1 = pcg32_float(random);
    const environment_light light = by->sample(e, u0, u1);
    const double cosine = plane_cosine(light.dir);
    const double weight = (double)envsamp_mis_power(light.pdf, (float)(cosine / PI));
    float dir[3], here[3], seen[3], other;
    int i, differs = 0;

    draw_cosine(random, dir);
    by->radiance(e, dir, seen);
    other = envsamp_mis_power((float)(plane_cosine(dir) / PI), by->pdf(e, dir));
    by->radiance(e, light.dir, here);
    for (i = 0; i < 3; i++) {
        const double value = (double)light.radiance[i] * cosine / (double)light.pdf;

        stat_moments_add(&drawn[i], value);
        stat_moments_add(&mis[i], value * weight + (double)seen[i] * PI * (double)other);
        differs |= differ(here[i], light.radiance[i]);
    }
    v->light_count += differs;
    v->pdf_count += differ(by->pdf(e, light.dir), light.pdf);
}

static verdict judge(const engine *by, const place *p)
{
    stat_moments drawn[3], mis[3];
    pcg32 random = pcg32_make(2024, 0);
    double exact[3];
    verdict v = { 0, 1.0, 1.0, 0, 0 };
    int i;

    memset(drawn, 0, sizeof drawn);
    memset(mis, 0, sizeof mis);
    irradiance_of_texels(p, exact);
    for (i = 0; i < SAMPLES; i++)
        draw(by, &p->e, &random, &v, drawn, mis);
    for (i = 0; i < 3; i++) {
        v.p_drawn = fmin(v.p_drawn, stat_mean_test(&drawn[i], exact[i], ROUNDING * exact[i]));
        v.p_mis = fmin(v.p_mis, stat_mean_test(&mis[i], exact[i], ROUNDING * exact[i]));
    }
    v.off = (v.p_drawn < STAT_ALPHA ? DRAWN : 0) | (v.p_mis < STAT_ALPHA ? MIS : 0)
          | (v.pdf_count > STRAYS * SAMPLES ? PDF : 0)
          | (v.light_count > STRAYS * SAMPLES ? LIGHT : 0);
    return v;
}

static const engine right = {
    "", environment_sample, environment_pdf, environment_radiance
};

static void test_places(const fixture *f, const char *map)
{
    int i;

    for (i = 0; i < PLACE_COUNT; i++) {
        const place p = place_make(f, i);
        const verdict v = judge(&right, &p);

        CHECK(v.off == 0, "%s, %s: p = %.2g drawn, %.2g with MIS; another pdf in %d, other light in"
              " %d", map, place_names[i], v.p_drawn, v.p_mis, v.pdf_count, v.light_count);
    }
}

/* ---- mistakes ---- */

static float pdf_not_turned(const environment *e, const float dir[3])
{
    return envsamp_kd_pdf(e->kd, dir);
}

static void radiance_not_turned(const environment *e, const float dir[3], float rgb[3])
{
    environment_lookup(e, dir, rgb);
}

static environment inverse(const environment *e)
{
    environment out = *e;
    int i, k;

    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++)
            out.to_map[i][k] = e->to_map[k][i];
    return out;
}

static environment_light sample_inverse(const environment *e, float u0, float u1)
{
    const environment turned_back = inverse(e);

    return environment_sample(&turned_back, u0, u1);
}

static float pdf_inverse(const environment *e, const float dir[3])
{
    const environment turned_back = inverse(e);

    return environment_pdf(&turned_back, dir);
}

static void radiance_inverse(const environment *e, const float dir[3], float rgb[3])
{
    const environment turned_back = inverse(e);

    environment_radiance(&turned_back, dir, rgb);
}

static environment_light sample_exposed_pdf(const environment *e, float u0, float u1)
{
    environment_light light = environment_sample(e, u0, u1);

    light.pdf *= e->exposure;
    return light;
}

static float pdf_exposed(const environment *e, const float dir[3])
{
    return environment_pdf(e, dir) * e->exposure;
}

static environment_light sample_tinted_pdf(const environment *e, float u0, float u1)
{
    environment_light light = environment_sample(e, u0, u1);

    light.pdf *= envsamp_luminance(e->tint);
    return light;
}

static float pdf_tinted(const environment *e, const float dir[3])
{
    return environment_pdf(e, dir) * envsamp_luminance(e->tint);
}

static environment_light sample_unexposed(const environment *e, float u0, float u1)
{
    environment_light light = environment_sample(e, u0, u1);
    int i;

    for (i = 0; i < 3; i++)
        light.radiance[i] /= e->exposure;
    return light;
}

/* Each where it matters, and all that it puts off. What is wrong everywhere alike agrees with
   itself, so that only the sum over texels tells. On the studio map: against the sun of the sky,
   drawn by chance with MIS, mistakes are hard to see. */
static const struct mistake {
    engine by;
    int place, off;
} mistakes[] = {
    { { "the pdf of the direction as it is in the world", environment_sample, pdf_not_turned,
        environment_radiance }, TURNED, MIS | PDF },
    { { "the same", environment_sample, pdf_not_turned, environment_radiance }, Y_UP, MIS | PDF },
    { { "the same", environment_sample, pdf_not_turned, environment_radiance }, LEFT_HANDED,
      MIS | PDF },
    { { "the light of the direction as it is in the world", environment_sample, environment_pdf,
        radiance_not_turned }, TURNED, MIS | LIGHT },
    { { "the inverse turn", sample_inverse, pdf_inverse, radiance_inverse }, TURNED, DRAWN | MIS },
    { { "the inverse turn", sample_inverse, pdf_inverse, radiance_inverse }, Y_UP, DRAWN | MIS },
    { { "the inverse turn of draws", sample_inverse, environment_pdf, environment_radiance },
      TURNED, DRAWN | MIS | PDF | LIGHT },
    { { "exposure in the pdf", sample_exposed_pdf, pdf_exposed, environment_radiance }, EXPOSED,
      DRAWN | MIS },
    { { "exposure in the pdf for MIS", environment_sample, pdf_exposed, environment_radiance },
      EXPOSED, MIS | PDF },
    { { "no exposure of draws", sample_unexposed, environment_pdf, environment_radiance }, EXPOSED,
      DRAWN | MIS | LIGHT },
    { { "tint in the pdf", sample_tinted_pdf, pdf_tinted, environment_radiance }, TINTED,
      DRAWN | MIS }
};

static void test_mistakes(const fixture *f)
{
    size_t i;

    for (i = 0; i < sizeof mistakes / sizeof *mistakes; i++) {
        const struct mistake *m = &mistakes[i];
        const place p = place_make(f, m->place);
        const verdict v = judge(&m->by, &p);

        CHECK(v.off == m->off, "rejected: %s, %s: p = %.2g drawn, %.2g with MIS; another pdf in %d,"
              " other light in %d", m->by.name, place_names[m->place], v.p_drawn, v.p_mis,
              v.pdf_count, v.light_count);
    }
}

/* The other hand agrees with itself, and only the place of the light tells. */
static void test_wrong_hand(const fixture *f)
{
    place p = place_make(f, LEFT_HANDED);
    verdict v;

    environment_place(&p.e, "three.js");
    v = judge(&right, &p);
    CHECK(v.off == (DRAWN | MIS), "rejected: a right-handed matrix in a left-handed engine: p = "
          "%.2g drawn, %.2g with MIS", v.p_drawn, v.p_mis);
}

/* ---- what a tint costs ---- */

/* E[(L/pdf)^2] / E[L/pdf]^2 - 1 of the luminance in the world, by parts of texels: nearly, since
   blocks of WARP have edges within texels. */
static double excess_variance(const environment *e)
{
    const int columns = WIDTH * SPLIT, rows = HEIGHT * SPLIT;
    double sum = 0.0, squares = 0.0;
    int i;

    for (i = 0; i < columns * rows; i++) {
        const int y = i / columns;
        const double sr = 2.0 * PI / columns * (cos(PI * y / rows) - cos(PI * (y + 1) / rows));
        float map_dir[3], dir[3], rgb[3];
        double luminance;

        envsamp_uv_to_dir(ENVSAMP_LATLONG, ((float)(i % columns) + 0.5f) / (float)columns,
                          ((float)y + 0.5f) / (float)rows, map_dir);
        environment_to_world(e, map_dir, dir);
        environment_radiance(e, dir, rgb);
        luminance = (double)envsamp_luminance(rgb);
        sum += luminance * sr;
        if (luminance > 0.0)
            squares += luminance * luminance * sr / (double)environment_pdf(e, dir);
    }
    return squares / (sum * sum) - 1.0;
}

/* Moonlight out of a day. */
static void test_rebuild(fixture *f)
{
    static const float tint[3] = { 0.05f, 0.2f, 1.0f };
    environment e = environment_make(f->kd, &f->view);
    double plain, placed, tinted, rebuilt;
    int i;

    plain = excess_variance(&e);
    e.exposure = 4.0f;
    environment_place(&e, "Unity");
    environment_turn(&e, axis_tilted, 2.0f);
    placed = excess_variance(&e);
    CHECK(fabs(placed - plain) < 1e-5 + 1e-3 * plain,
          "excess variance %.6f, placed and exposed %.6f", plain, placed);
    memcpy(e.tint, tint, sizeof tint);
    tinted = excess_variance(&e);
    for (i = 0; i < TEXEL_COUNT * 3; i++)
        f->map.rgb[i] *= tint[i % 3];
    fixture_build(f);
    e = environment_make(f->kd, &f->view);
    rebuilt = excess_variance(&e);
    CHECK(tinted > 0.01 && rebuilt < 0.1 * tinted, "a strong tint makes it %.6f, a rebuild %.6f",
          tinted, rebuilt);
}

/* Red texels and blue ones, of the same luminance and in the proportion that a tint hurts most:
   what placement.h says that a tint costs at most is reached. */
static void test_worst_tint(fixture *f)
{
    const double k = 15.0, most = (k - 1.0) * (k - 1.0) / (4.0 * k);
    environment e;
    double found;
    int i;

    for (i = 0; i < TEXEL_COUNT; i++) {
        const int red = i % WIDTH < WIDTH / 16;

        f->map.rgb[3 * i] = red ? 1.0f / 0.2126f : 0.0f;
        f->map.rgb[3 * i + 1] = 0.0f;
        f->map.rgb[3 * i + 2] = red ? 0.0f : 1.0f / 0.0722f;
    }
    fixture_build(f);
    e = environment_make(f->kd, &f->view);
    e.tint[2] = (float)(1.0 / k);
    found = excess_variance(&e);
    CHECK(found > 0.999 * most && found < 1.001 * most,
          "the worst map for a tint of 1 to %g: %.4f, at most %.4f", k, found, most);
}

int main(void)
{
    fixture sky, studio;

    fixture_make(&sky, "sky");
    fixture_make(&studio, "studio");
    test_presets();
    test_refused();
    test_lamps();
    test_lookup(&studio);
    fixture_build(&studio);
    test_places(&sky, "sky");
    test_places(&studio, "studio");
    test_mistakes(&studio);
    test_wrong_hand(&studio);
    test_rebuild(&sky);
    test_worst_tint(&sky);
    fixture_free(&sky);
    fixture_free(&studio);
    return check_done();
}
