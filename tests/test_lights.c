/* test_lights.c: maps as K directional lights: energy, places, sizes and colours of the lights
 * against sums over the texels that know nothing of the library; how fast irradiance converges; the
 * statistics of random lights; bad input. A new method is a line of `methods`.
 */
#include "check.h"

#include "../envsamp.h"

#include "lights_map.h"
#include "statistics.h"
#include "../examples/common/irradiance.h"
#include "../examples/common/maps.h"

#include <limits.h>

#define ENERGY 1e-6             /* relative: what the lights sum to; each is rounded to floats */
#define INTEGRAL 1e-10          /* relative: a sum of doubles */
#define ROUNDING 1e-6           /* relative, of a figure of one light */
#define WITHIN 4e-7             /* of a direction, each component */

static const char *const mapping_names[3] = { "lat-long", "hemisphere", "octahedral" };

/* ---- methods: what is promised of each ---- */

typedef struct method {
    envsamp_lights_method id;
    const char *name;
    int of_texels;      /* lights have places and colours of lit texels, and equal luminance */
    int seeded;         /* with another seed the lights are others */
    double spread;      /* a texel worth n lights has n within so many; 0: it is random */
    double error;       /* of irradiance of 32 lights, over RANDOM's, at most; with more it falls
                           as the root of their number. 0: it is RANDOM */
} method;

static const method methods[] = {
    { ENVSAMP_LIGHTS_RANDOM, "RANDOM", 1, 1, 0.0, 0.0 },
    { ENVSAMP_LIGHTS_HALFTONE, "HALFTONE", 1, 1, 1.5, 0.5 }
};

enum { RANDOM = 0, HALFTONE = 1, METHOD_COUNT = sizeof methods / sizeof *methods };

static envsamp_lights_desc ask(const method *by, int count, uint32_t seed)
{
    envsamp_lights_desc desc = envsamp_lights_defaults();

    desc.method = by->id;
    desc.count = count;
    desc.seed = seed;
    return desc;
}

static double set_sum(const light_set *s, int channel)
{
    double sum = 0.0;
    int i;

    for (i = 0; i < s->desc.count; i++)
        sum += (double)s->lights[i].irradiance[channel];
    return sum;
}

/* ---- the map, by brute force ---- */

/* The double integral of the map over the sphere. */
static void map_total(const envsamp_image *map, double total[3])
{
    int x, y, c;

    total[0] = total[1] = total[2] = 0.0;
    for (y = 0; y < map->height; y++) {
        const double sr = row_sr(map, y);

        for (x = 0; x < map->width; x++) {
            double rgb[3];

            texel_rgb(map, x, y, rgb);
            for (c = 0; c < 3; c++)
                total[c] += rgb[c] * sr;
        }
    }
}

/* The point of the map in a direction, in texels. Octahedral [Clarberg]: r is the distance from
   the centre, a and b its parts; the lower half is folded out over the diagonals. */
static void point_of(const envsamp_image *map, const double dir[3], double *px, double *py)
{
    const double ring = sqrt(dir[0] * dir[0] + dir[1] * dir[1]);
    const double turn = atan2(dir[1], dir[0]) / (2.0 * KD_PI);
    double u = turn - floor(turn);
    double v = atan2(ring, dir[2]) / (map->mapping == ENVSAMP_LATLONG ? KD_PI : 0.5 * KD_PI);

    if (map->mapping == ENVSAMP_OCTAHEDRAL) {
        const double r = sqrt(2.0) * sin(0.5 * atan2(ring, fabs(dir[2])));
        const double b = r * atan2(fabs(dir[1]), fabs(dir[0])) / (0.5 * KD_PI), a = r - b;

        u = 0.5 + 0.5 * copysign(dir[2] < 0.0 ? 1.0 - b : a, dir[0]);
        v = 0.5 + 0.5 * copysign(dir[2] < 0.0 ? 1.0 - a : b, dir[1]);
    }
    *px = u * (double)map->width;
    *py = v * (double)map->height;
}

/* ---- what a light stands for ---- */

/* Where a light lies in its texel, whose colour it has; sr: of what it stands for, unclamped. */
typedef struct place { int x, y; double in_x, in_y, rgb[3], sr; } place;

enum {
    BAD_LENGTH = 1, BAD_IRRADIANCE = 2, BAD_CONE = 4, BAD_KIND = 8, UNLIT = 16, BAD_SHARE = 32,
    BAD_COLOUR = 64
};

static int equal(double a, double b, double tolerance)
{
    return fabs(a - b) <= tolerance * fabs(b);
}

/* What is wrong with a light by itself. */
static int judge_light(const envsamp_light *l)
{
    const double x = (double)l->dir[0], y = (double)l->dir[1], z = (double)l->dir[2];
    const double sr = (double)l->solid_angle, cosine = 1.0 - sr / (2.0 * KD_PI);
    int flags = 0, c;

    if (!(fabs(sqrt(x * x + y * y + z * z) - 1.0) <= 1e-6))
        flags |= BAD_LENGTH;
    for (c = 0; c < 3; c++)
        if (!(l->irradiance[c] >= 0.0f && l->irradiance[c] <= FLT_MAX))
            flags |= BAD_IRRADIANCE;
    if (!(sr > 0.0 && sr <= 4.0 * KD_PI * (1.0 + 1e-7)
          && fabs((double)l->cos_extent - cosine) <= 3e-7))
        flags |= BAD_CONE;
    return flags;
}

/* The texel that a light lies in; `nudge` 1..8: one that it lies in with some rounding. */
static place place_of(const envsamp_image *map, const envsamp_light *l, int nudge, double share)
{
    double dir[3], px, py;
    place at;
    int i;

    for (i = 0; i < 3; i++)
        dir[i] = (double)l->dir[i] + (nudge ? (nudge - 1) >> i & 1 ? WITHIN : -WITHIN : 0.0);
    point_of(map, dir, &px, &py);
    at.x = px < (double)map->width ? (int)px : map->width - 1;
    at.y = py < (double)map->height ? (int)py : map->height - 1;
    at.in_x = px - (double)at.x;
    at.in_y = py - (double)at.y;
    texel_rgb(map, at.x, at.y, at.rgb);
    at.sr = share / luminance_of(at.rgb);
    return at;
}

/* Finds a light's texel, one that is as bright as the light says, each being worth `share`. */
static int find_place(const envsamp_image *map, const envsamp_light *l, double share, place *at)
{
    int nudge, flags = 0;

    for (nudge = 0; nudge <= 8; nudge++) {
        const place near = place_of(map, l, nudge, share);
        const int wrong = !(luminance_of(near.rgb) > 0.0) ? UNLIT
                        : equal((double)l->solid_angle, fmin(near.sr, 4.0 * KD_PI), ROUNDING)
                        ? 0 : BAD_SHARE;

        if (nudge == 0 || !wrong) {
            *at = near;
            flags = wrong;
        }
        if (!wrong)
            break;
    }
    return flags;
}

/* ---- what a set is to be ---- */

typedef struct verdict {
    double energy, integral;    /* off, relative, in the worst channel */
    int flags, wrong, lights;   /* what is wrong with how many of so many lights */
    int sets, failed;           /* calls; those that failed, wrote too far, or say odd things */
} verdict;

static double off(double value, double known)
{
    return known > 0.0 ? fabs(value / known - 1.0) : fabs(value);
}

/* Lights have the colours of their texels, times one tint for all; a channel that no chosen texel
   has is shared out evenly. Marks those for which that is not so. */
static void judge_colours(const light_set *s, const double total[3], const place *at, int *flags)
{
    const int count = s->desc.count;
    int c, i;

    for (c = 0; c < 3; c++) {
        double sum = 0.0;

        for (i = 0; i < count; i++)
            sum += at[i].rgb[c] * at[i].sr;
        for (i = 0; i < count; i++) {
            const double wanted = sum > 0.0 ? at[i].rgb[c] * at[i].sr / sum * total[c]
                                            : total[c] / (double)count;

            if (!(fabs((double)s->lights[i].irradiance[c] - wanted)
                  <= ROUNDING * wanted + LEAST))
                flags[i] |= BAD_COLOUR;
        }
    }
}

static void judge_lights(const light_set *s, const method *by, const double total[3], verdict *v)
{
    const int count = s->desc.count;
    const double share = luminance_of(total) / (double)count;
    place *at = (place *)kd_allocate((size_t)count * sizeof *at);
    int *flags = (int *)kd_allocate((size_t)count * sizeof *flags);
    int i;

    for (i = 0; i < count; i++) {
        flags[i] = judge_light(&s->lights[i]);
        if (by->of_texels) {
            flags[i] |= s->lights[i].direct ? BAD_KIND : 0;
            flags[i] |= find_place(&s->view, &s->lights[i], share, &at[i]);
        }
    }
    if (by->of_texels)
        judge_colours(s, total, at, flags);
    for (i = 0; i < count; i++) {
        v->flags |= flags[i];
        v->wrong += flags[i] != 0;
        v->lights++;
    }
    free(at);
    free(flags);
}

/* Adds what there is to say about a set. total: of its map. */
static void judge_set(const light_set *s, const method *by, const double total[3], verdict *v)
{
    int c;

    v->sets++;
    v->failed += s->result != ENVSAMP_OK || !set_intact(s) || s->info.count != s->desc.count
              || (by->of_texels && (s->info.direct_count || s->info.threshold != 0.0f));
    if (s->result != ENVSAMP_OK)
        return;
    for (c = 0; c < 3; c++) {
        worst(&v->energy, off(set_sum(s, c), total[c]));
        worst(&v->integral, off(s->info.integral[c], total[c]));
    }
    judge_lights(s, by, total, v);
}

static void judge_count(const envsamp_image *map, const method *by, int count, verdict *v)
{
    const envsamp_lights_desc desc = ask(by, count, 0);
    double total[3];
    light_set s;

    map_total(map, total);
    set_make(&s, map, &desc);
    judge_set(&s, by, total, v);
    set_free(&s);
}

static int verdict_good(const verdict *v)
{
    return v->sets > 0 && v->failed == 0 && v->wrong == 0 && v->energy <= ENERGY
        && v->integral <= INTEGRAL;
}

static void check_verdict(const char *name, const method *by, const verdict *v)
{
    CHECK(v->sets > 0 && v->failed == 0 && v->energy <= ENERGY && v->integral <= INTEGRAL,
          "%s, %s: %d of %d calls wrong, energy %.1e and integral %.1e off", name, by->name,
          v->failed, v->sets, v->energy, v->integral);
    CHECK(v->lights > 0 && v->wrong == 0, "%s, %s: %d of %d lights wrong, flags %d", name,
          by->name, v->wrong, v->lights, v->flags);
}

/* ---- maps ---- */

static canvas canvas_filled(int width, int height, int channels, float value)
{
    canvas c = canvas_make(width, height, channels, 0);
    int i;

    for (i = 0; i < width * height * channels; i++)
        c.pixels[i] = value;
    return c;
}

/* ---- energy, and every light: maps x mappings x layouts x counts x methods ---- */

static void judge_view(const envsamp_image *view, verdict verdicts[METHOD_COUNT])
{
    static const int counts[] = { 1, 2, 3, 16, 31, 32, 64, 256, 1000, 1024 };
    const int number = (int)(sizeof counts / sizeof *counts);
    double total[3];
    int m, k;

    map_total(view, total);
    for (m = 0; m < METHOD_COUNT; m++)
        for (k = 0; k < number; k++) {
            const envsamp_lights_desc desc = ask(&methods[m], counts[k], (uint32_t)(k % 4));
            light_set s;

            set_make(&s, view, &desc);
            judge_set(&s, &methods[m], total, &verdicts[m]);
            set_free(&s);
        }
}

static void test_map(const char *name, const image *map)
{
    verdict verdicts[METHOD_COUNT];
    int layout, mapping, m;

    memset(verdicts, 0, sizeof verdicts);
    for (layout = 0; layout < LAYOUTS; layout++) {
        canvas c = canvas_of(map, layout);

        for (mapping = 0; mapping < 3; mapping++) {
            c.view.mapping = (envsamp_mapping)mapping;
            judge_view(&c.view, verdicts);
        }
        free(c.pixels);
    }
    for (m = 0; m < METHOD_COUNT; m++)
        check_verdict(name, &methods[m], &verdicts[m]);
}

/* Red carries all luminance that matters. Blue is in one faint texel that nobody chooses; or in one
   that a light stands for, which then has all of it. Green is nowhere, or in no texel chosen. */
static void test_rare_channels(void)
{
    int chosen;
    image map;

    for (chosen = 0; chosen < 2; chosen++) {
        int i;

        if (!image_alloc(&map, 40, 20))
            return;
        for (i = 0; i < 40 * 20; i++)
            map.rgb[3 * i] = 1.0f + 0.01f * (float)(i % 7);
        map.rgb[3 * 410 + 2] = chosen ? 1000.0f : 1e-7f;
        if (!chosen) {
            map.rgb[3 * 410] = 0.0f;
            map.rgb[3 * 433 + 1] = 1e-12f;
            map.rgb[3 * 433] = 0.0f;
        }
        test_map(chosen ? "blue in a chosen texel" : "blue and green in no chosen texel", &map);
        image_free(&map);
    }
}

static void test_maps(void)
{
    int i, real = 0;
    image map;

    for (i = 0; map_names[i]; i++)
        if (map_make(map_names[i], 200, 100, &map)) {
            test_map(map_names[i], &map);
            image_free(&map);
        }
    test_rare_channels();
    for (i = 0; i < REAL_MAP_COUNT; i++)
        if (real_map_read(i, &map)) {
            test_map(real_map_name(i), &map);
            image_free(&map);
            real++;
        }
    if (!real)
        CHECK_SKIP("no real maps in data/");
}

static void test_many(void)
{
    int m;
    image map;

    if (!map_make("night", 200, 100, &map))
        return;
    for (m = 0; m < METHOD_COUNT; m++) {
        const envsamp_image view = kd_image(map.rgb, map.width, map.height, 3);
        verdict v;

        memset(&v, 0, sizeof v);
        judge_count(&view, &methods[m], 65536, &v);
        check_verdict("65536 lights", &methods[m], &v);
    }
    image_free(&map);
}

/* ---- controls: what judge_set must reject ---- */

enum {
    SOUND, A_LIGHT_TWICE, COLOURS_EXCHANGED, TURNED_A_TEXEL, LONG, ANOTHER_CONE, ANOTHER_SIZE,
    DIRECT, NO_SINE, SPOILS
};

static const char *const spoil_names[SPOILS] = {
    "as they are", "a light counts twice", "red and blue exchanged", "turned by a texel",
    "longer by 2e-6", "another cone", "another solid angle", "a direct light",
    "of a map without sine"
};

static void turn_light(envsamp_light *l, double angle)
{
    const double x = (double)l->dir[0], y = (double)l->dir[1];

    l->dir[0] = (float)(cos(angle) * x - sin(angle) * y);
    l->dir[1] = (float)(sin(angle) * x + cos(angle) * y);
}

static void spoil(light_set *s, int how)
{
    envsamp_light *const l = s->lights;
    const float red = l->irradiance[0];
    int c;

    for (c = 0; c < 3; c++) {
        l->irradiance[c] *= how == A_LIGHT_TWICE ? 2.0f : 1.0f;
        l->dir[c] *= how == LONG ? 1.000002f : 1.0f;
    }
    if (how == COLOURS_EXCHANGED) {
        l->irradiance[0] = l->irradiance[2];
        l->irradiance[2] = red;
    }
    if (how == TURNED_A_TEXEL)
        turn_light(l, 2.0 * KD_PI / (double)s->view.width);
    l->cos_extent -= how == ANOTHER_CONE ? 1e-6f : 0.0f;
    l->solid_angle *= how == ANOTHER_SIZE ? 1.00001f : 1.0f;
    l->direct = how == DIRECT;
}

/* One light of a night map is spoiled; or the brute force sum is. */
static void test_judge(int how)
{
    const envsamp_lights_desc desc = ask(&methods[HALFTONE], 64, 0);
    double total[3];
    envsamp_image view;
    light_set s;
    image map;
    verdict v;

    if (!map_make("night", 64, 32, &map))
        return;
    memset(&v, 0, sizeof v);
    view = kd_image(map.rgb, map.width, map.height, 3);
    set_make(&s, &view, &desc);
    spoil(&s, how);
    view.mapping = how == NO_SINE ? ENVSAMP_OCTAHEDRAL : ENVSAMP_LATLONG;
    map_total(&view, total);
    judge_set(&s, &methods[HALFTONE], total, &v);
    CHECK(verdict_good(&v) == (how == SOUND), "%s: %s", how == SOUND ? "lights" : "control",
          spoil_names[how]);
    set_free(&s);
    image_free(&map);
}

/* ---- convergence of irradiance ---- */

enum { RANDOM_SEEDS = 8, COUNT_LEVELS = 4, WRONG_KINDS = 3, VARIANTS = METHOD_COUNT + WRONG_KINDS };

static const int levels[COUNT_LEVELS] = { 16, 32, 64, 256 };
static const char *const wrong_names[WRONG_KINDS] = {
    "rows upside down", "a lat-long map taken for an octahedral one", "no sine"
};

typedef struct scene {
    image map;
    double total[3];
    irradiance exact;
} scene;

/* As the library counts pixels: the reference does not look. Whether the scene was made. */
static int scene_finish(scene *s)
{
    envsamp_image view = kd_image(s->map.rgb, s->map.width, s->map.height, 3);
    int x, y, c;

    for (y = 0; y < s->map.height; y++)
        for (x = 0; x < s->map.width; x++) {
            double rgb[3];

            texel_rgb(&view, x, y, rgb);
            for (c = 0; c < 3; c++)
                s->map.rgb[3 * (y * s->map.width + x) + c] = (float)rgb[c];
        }
    map_total(&view, s->total);
    return irradiance_make(&s->exact, &s->map);
}

/* Mean square over the normals of the relative error of irradiance. */
static double square_error(const scene *s, const envsamp_light *lights, int count)
{
    double squares = 0.0;
    int k, i;

    for (k = 0; k < IRRADIANCE_NORMALS; k++) {
        double sum = 0.0, error;

        for (i = 0; i < count; i++)
            sum += (double)(envsamp_luminance(lights[i].irradiance)
                            * fmaxf(dot3(s->exact.normals[k], lights[i].dir), 0.0f));
        error = sum / s->exact.exact[k] - 1.0;
        squares += error * error;
    }
    return squares / IRRADIANCE_NORMALS;
}

static double method_error(const scene *s, const method *by, int count)
{
    const envsamp_image view = kd_image(s->map.rgb, s->map.width, s->map.height, 3);
    const int seeds = by->error > 0.0 ? 1 : RANDOM_SEEDS;
    double squares = 0.0;
    int seed;

    for (seed = 0; seed < seeds; seed++) {
        const envsamp_lights_desc desc = ask(by, count, (uint32_t)seed);
        light_set set;

        squares += set_make(&set, &view, &desc) ? square_error(s, set.lights, count) : 1e300;
        set_free(&set);
    }
    return sqrt(squares / seeds);
}

/* The map as it must not be taken: its rows the other way round, or such that weighed by solid
   angle it has the weights of the map that was not. */
static canvas spoiled_map(const scene *s, int kind)
{
    const int w = s->map.width, h = s->map.height;
    canvas c = canvas_make(w, h, 3, 0);
    int y, i;

    for (y = 0; y < h; y++) {
        const float *from = s->map.rgb + (size_t)(kind == 0 ? h - 1 - y : y) * (size_t)(3 * w);
        const double scale = kind == 2 ? 1e-3 / row_sr(&c.view, y) : 1.0;

        for (i = 0; i < 3 * w; i++)
            c.pixels[y * 3 * w + i] = (float)((double)from[i] * scale);
    }
    if (kind == 1)
        c.view.mapping = ENVSAMP_OCTAHEDRAL;
    return c;
}

/* Of lights with the energy of the map, so that only their places are wrong. */
static double wrong_error(const scene *s, int kind, int count)
{
    const envsamp_lights_desc desc = ask(&methods[HALFTONE], count, 0);
    canvas c = spoiled_map(s, kind);
    double error = 0.0, sum = 0.0;
    light_set set;
    int i, k;

    if (set_make(&set, &c.view, &desc)) {
        for (i = 0; i < count; i++)
            sum += (double)envsamp_luminance(set.lights[i].irradiance);
        for (i = 0; i < count; i++)
            for (k = 0; k < 3; k++)
                set.lights[i].irradiance[k] *= (float)(luminance_of(s->total) / sum);
        error = sqrt(square_error(s, set.lights, count));
    }
    set_free(&set);
    free(c.pixels);
    return error;
}

static void add_scene(const scene *s, double logs[VARIANTS][COUNT_LEVELS])
{
    int i, level;

    for (i = 0; i < VARIANTS; i++)
        for (level = 0; level < COUNT_LEVELS; level++)
            logs[i][level] += log(i < METHOD_COUNT
                                  ? method_error(s, &methods[i], levels[level])
                                  : wrong_error(s, i - METHOD_COUNT, levels[level]));
}

static int load_scene(scene *s, int index)
{
    int made_up = 0;

    memset(s, 0, sizeof *s);
    while (map_names[made_up])
        made_up++;
    if (index < made_up)
        return map_make(map_names[index], 256, 128, &s->map);
    return index - made_up < REAL_MAP_COUNT && real_map_read(index - made_up, &s->map);
}

/* RMSE over that of RANDOM, geometric mean over maps. The wrong ones fail HALFTONE's test. */
static void check_errors(double logs[VARIANTS][COUNT_LEVELS], int maps)
{
    int i, level;

    for (i = 0; i < VARIANTS; i++)
        for (level = 0; level < COUNT_LEVELS; level++) {
            const double error = exp(logs[i][level] / maps);
            const double ratio = exp((logs[i][level] - logs[RANDOM][level]) / maps);
            const double most = methods[i < METHOD_COUNT ? i : HALFTONE].error
                              * sqrt(32.0 / levels[level]);

            if (i < METHOD_COUNT && most > 0.0 && levels[level] >= 32)
                CHECK(ratio <= most, "%s, %d lights: RMSE of irradiance %.4f, %.3f of that of "
                      "RANDOM, %d maps", methods[i].name, levels[level], error, ratio, maps);
            else if (i >= METHOD_COUNT && levels[level] >= 32)
                CHECK(ratio > most, "control: %s, %d lights: RMSE of irradiance %.4f, %.3f of "
                      "that of RANDOM", wrong_names[i - METHOD_COUNT], levels[level], error, ratio);
            else
                printf("# %s, %d lights: RMSE of irradiance %.4f\n", i < METHOD_COUNT
                       ? methods[i].name : wrong_names[i - METHOD_COUNT], levels[level], error);
        }
}

static void test_convergence(void)
{
    static scene s;
    double logs[VARIANTS][COUNT_LEVELS];
    int index, maps = 0;

    memset(logs, 0, sizeof logs);
    for (index = 0; load_scene(&s, index); index++) {
        if (scene_finish(&s)) {
            add_scene(&s, logs);
            maps++;
        }
        image_free(&s.map);
    }
    check_errors(logs, maps);
}

/* ---- RANDOM: as many in each part of the map as its light says ---- */

enum { DRAWN, DRAWN_NO_SINE, DRAWN_SHIFTED, DRAWN_SWAPPED, DRAWN_KINDS };

static const char *const drawn_names[DRAWN_KINDS] = {
    "RANDOM", "control: no sine", "control: half a texel off", "control: axes exchanged"
};

enum { DRAWN_WIDTH = 64, DRAWN_HEIGHT = 32, BLOCK = 4, ACROSS = DRAWN_WIDTH / BLOCK,
       BLOCKS = ACROSS * (DRAWN_HEIGHT / BLOCK) };

/* A map, and what is expected of its blocks. */
typedef struct drawn {
    image map;
    envsamp_image view;
    double masses[BLOCKS], total;
} drawn;

static int drawn_make(drawn *d, const char *name, envsamp_mapping mapping, int kind)
{
    int x, y;

    memset(d, 0, sizeof *d);
    if (!map_make(name, DRAWN_WIDTH, DRAWN_HEIGHT, &d->map))
        return 0;
    d->view = kd_image(d->map.rgb, DRAWN_WIDTH, DRAWN_HEIGHT, 3);
    d->view.mapping = mapping;
    for (y = 0; y < DRAWN_HEIGHT; y++)
        for (x = 0; x < DRAWN_WIDTH; x++) {
            double rgb[3], mass;

            texel_rgb(&d->view, x, y, rgb);
            mass = luminance_of(rgb) * (kind == DRAWN_NO_SINE ? 1.0 : row_sr(&d->view, y));
            d->masses[y / BLOCK * ACROSS + x / BLOCK] += mass;
            d->total += mass;
        }
    return 1;
}

static int block_of(const envsamp_image *map, const envsamp_light *l, int kind)
{
    const double dir[3] = { (double)l->dir[0], (double)l->dir[1], (double)l->dir[2] };
    double px, py;
    int x, y;

    point_of(map, dir, &px, &py);
    px += kind == DRAWN_SHIFTED ? 0.5 + 1e-3 : 0.0;
    x = (int)px % DRAWN_WIDTH;
    y = (int)py < DRAWN_HEIGHT ? (int)py : DRAWN_HEIGHT - 1;
    if (kind == DRAWN_SWAPPED) {
        x = (int)(py / DRAWN_HEIGHT * DRAWN_WIDTH) % DRAWN_WIDTH;
        y = (int)(px / DRAWN_WIDTH * DRAWN_HEIGHT) % DRAWN_HEIGHT;
    }
    return y / BLOCK * ACROSS + x / BLOCK;
}

/* Adds the lights of one seed to the blocks that they lie in. */
static void add_hits(const drawn *d, const method *by, int count, uint32_t seed, int kind,
                     double hits[BLOCKS])
{
    const envsamp_lights_desc desc = ask(by, count, seed);
    light_set s;
    int i;

    if (set_make(&s, &d->view, &desc))
        for (i = 0; i < count; i++)
            hits[block_of(&d->view, &s.lights[i], kind)] += 1.0;
    set_free(&s);
}

static void test_draws(envsamp_mapping mapping, int kind)
{
    enum { COUNT = 61, SEEDS = 4000 };
    double hits[BLOCKS], sum = 0.0;
    stat_result result;
    drawn d;
    int i;

    if (!drawn_make(&d, "studio", mapping, kind))
        return;
    memset(hits, 0, sizeof hits);
    for (i = 0; i < SEEDS; i++)
        add_hits(&d, &methods[RANDOM], COUNT, (uint32_t)i, kind, hits);
    for (i = 0; i < BLOCKS; i++)
        sum += hits[i];
    result = stat_chi2_test(d.masses, hits, BLOCKS, NULL);
    CHECK(result.pass == (kind == DRAWN) && equal(sum, COUNT * SEEDS, 0.0),
          "%s, %s: %s, chi2 %.0f of %.0f, p = %.2g", mapping_names[mapping], drawn_names[kind],
          stat_verdict_string(result.verdict), result.chi2, result.dof, result.p);
    image_free(&d.map);
}

/* Chi-square of independent draws is the degrees of freedom on average, however few they are; of
   even ones it is less. */
static void test_independence(const method *by)
{
    stat_moments moments = { 0.0, 0.0, 0.0 };
    drawn d;
    double p;
    int seed, i;

    if (!drawn_make(&d, "sky", ENVSAMP_LATLONG, DRAWN))
        return;
    for (seed = 0; seed < 2000; seed++) {
        double hits[BLOCKS] = { 0.0 }, chi2 = 0.0;

        add_hits(&d, by, 200, (uint32_t)seed, DRAWN, hits);
        for (i = 0; i < BLOCKS; i++) {
            const double expected = 200.0 * d.masses[i] / d.total;

            chi2 += (hits[i] - expected) * (hits[i] - expected) / expected;
        }
        stat_moments_add(&moments, chi2);
    }
    p = stat_mean_test(&moments, BLOCKS - 1.0, 0.0);
    CHECK((p > STAT_ALPHA) == (by == &methods[RANDOM]), "%s%s: chi2 of a set is %.2f of %d on "
          "average, p = %.2g", by == &methods[RANDOM] ? "" : "control: ", by->name, moments.mean,
          BLOCKS - 1, p);
    image_free(&d.map);
}

/* ---- several lights of one texel ---- */

/* A light in its texel. */
typedef struct spot { int texel; double x, y; } spot;

static int by_texel(const void *a, const void *b)
{
    const spot *p = (const spot *)a, *q = (const spot *)b;

    return (p->texel > q->texel) - (p->texel < q->texel);
}

/* Whether points lie evenly in the unit square: none nearer to another than 0.6 of the spacing of a
   grid, and their centre near the square's. */
static int spots_even(const spot *spots, int count)
{
    const double spacing = 1.0 / sqrt((double)count);
    double nearest = 2.0, x = 0.0, y = 0.0;
    int i, k;

    for (i = 0; i < count; i++) {
        for (k = 0; k < i; k++)
            nearest = fmin(nearest, hypot(spots[i].x - spots[k].x, spots[i].y - spots[k].y));
        x += (spots[i].x - 0.5) / count;
        y += (spots[i].y - 0.5) / count;
    }
    return (count == 1 || nearest >= 0.6 * spacing) && fabs(x) <= 0.5 * spacing
        && fabs(y) <= 0.5 * spacing;
}

typedef struct crowd {
    int texels, most;           /* with several lights; the most of them */
    int uneven;                 /* texels whose lights are not spread evenly */
    double off;                 /* lights more or fewer than a texel is worth */
} crowd;

static void add_texel_of_spots(const light_set *s, double share, const spot *spots, int count,
                               crowd *c)
{
    const int x = spots->texel % s->view.width, y = spots->texel / s->view.width;
    double rgb[3];

    texel_rgb(&s->view, x, y, rgb);
    worst(&c->off, fabs((double)count - luminance_of(rgb) * row_sr(&s->view, y) / share));
    c->texels += count > 1;
    c->most = count > c->most ? count : c->most;
    c->uneven += !spots_even(spots, count);
}

static crowd crowd_of(const light_set *s)
{
    const int count = s->desc.count;
    spot *spots = (spot *)kd_allocate((size_t)count * sizeof *spots);
    double total[3], share;
    crowd c = { 0, 0, 0, 0.0 };
    int i, first;

    map_total(&s->view, total);
    share = luminance_of(total) / (double)count;
    for (i = 0; i < count; i++) {
        place at;

        find_place(&s->view, &s->lights[i], share, &at);
        spots[i].texel = at.y * s->view.width + at.x;
        spots[i].x = at.in_x;
        spots[i].y = at.in_y;
    }
    qsort(spots, (size_t)count, sizeof *spots, by_texel);
    for (first = 0, i = 1; i <= count; i++)
        if (i == count || spots[i].texel != spots[first].texel) {
            add_texel_of_spots(s, share, spots + first, i - first, &c);
            first = i;
        }
    free(spots);
    return c;
}

/* Suns from a few lights to hundreds, one of them in a corner, over noise. */
static canvas sun_map(void)
{
    static const int suns[6][3] = { { 0, 0, 3000 }, { 23, 5, 500 }, { 7, 6, 4000 }, { 8, 6, 40 },
                                    { 12, 11, 900 }, { 15, 3, 120 } };
    canvas c = canvas_make(24, 12, 3, 0);
    pcg32 random = pcg32_make(6, 1);
    int i, k;

    for (i = 0; i < 24 * 12 * 3; i++)
        c.pixels[i] = 0.5f + pcg32_float(&random);
    for (i = 0; i < 6; i++)
        for (k = 0; k < 3; k++)
            canvas_at(&c, suns[i][0], suns[i][1])[k] = (float)suns[i][2];
    return c;
}

static void test_suns(const method *by, envsamp_mapping mapping)
{
    canvas c = sun_map();
    int seed;

    c.view.mapping = mapping;
    for (seed = 0; seed < 3; seed++) {
        const envsamp_lights_desc desc = ask(by, 1024, (uint32_t)seed);
        light_set s;
        crowd suns = { 0, 0, 1, HUGE_VAL };

        if (set_make(&s, &c.view, &desc))
            suns = crowd_of(&s);
        CHECK(suns.texels >= 5 && suns.most > 100 && suns.uneven == 0
              && (!(by->spread > 0.0) || suns.off <= by->spread),
              "%s, %s, seed %d: up to %d lights of a texel, unevenly in %d of %d, %.2f from what "
              "it is worth", by->name, mapping_names[mapping], seed, suns.most, suns.uneven,
              suns.texels, suns.off);
        set_free(&s);
    }
    free(c.pixels);
}

/* Controls: random places, all in one row, a good lattice in the upper half only. */
static void test_evenness(void)
{
    enum { COUNT = 64 };
    spot random[COUNT], line[COUNT], half[COUNT], lattice[COUNT];
    pcg32 numbers = pcg32_make(9, 9);
    int i;

    for (i = 0; i < COUNT; i++) {
        lattice[i].texel = line[i].texel = half[i].texel = random[i].texel = 0;
        lattice[i].x = half[i].x = (i % 8 + 0.5) / 8.0;
        lattice[i].y = (i / 8 + 0.5) / 8.0;
        half[i].y = 0.5 * lattice[i].y + (i % 2) / 16.0;
        line[i].x = (i + 0.5) / COUNT;
        line[i].y = 0.5;
        random[i].x = (double)pcg32_float(&numbers);
        random[i].y = (double)pcg32_float(&numbers);
    }
    CHECK(spots_even(lattice, COUNT) && !spots_even(random, COUNT) && !spots_even(line, COUNT)
          && !spots_even(half, COUNT),
          "control: a lattice is even, random points, a row and half of a texel are not");
}

/* ---- seeds, turns, what must make no difference ---- */

static void test_turned(const method *by)
{
    enum { COLUMNS = 37 };
    const envsamp_lights_desc desc = ask(by, 100, 0);
    light_set s, t;
    canvas c;
    image map;
    double energy = 0.0, integral = 0.0;
    int x, y, k;

    if (!map_make("studio", 200, 100, &map))
        return;
    c = canvas_of(&map, PACKED);
    set_make(&s, &c.view, &desc);
    for (y = 0; y < map.height; y++)
        for (x = 0; x < map.width; x++)
            memcpy(canvas_at(&c, (x + COLUMNS) % map.width, y),
                   map.rgb + 3 * (y * map.width + x), 3 * sizeof(float));
    set_make(&t, &c.view, &desc);
    for (k = 0; k < 3; k++) {
        worst(&energy, off(set_sum(&t, k), set_sum(&s, k)));
        worst(&integral, off(t.info.integral[k], s.info.integral[k]));
    }
    CHECK(!s.result && !t.result && energy <= ENERGY && integral <= 1e-12 && !sets_equal(&s, &t),
          "%s: of the map turned by %d columns, energy is %.1e and integral %.1e off", by->name,
          COLUMNS, energy, integral);
    set_free(&s);
    set_free(&t);
    free(c.pixels);
    image_free(&map);
}

/* Every two of a few seeds, 0 among them, give other lights, each the same ones again, whatever
   scratch holds. */
static void test_seeds(const method *by, const envsamp_image *view)
{
    static const uint32_t seeds[5] = { 0u, 1u, 2u, 0x80000000u, 0xffffffffu };
    light_set sets[5], again;
    int i, k, same = 0, repeated = 0;

    for (i = 0; i < 5; i++) {
        const envsamp_lights_desc desc = ask(by, 50, seeds[i]);

        set_make(&sets[i], view, &desc);
        set_make_over(&again, view, &desc, 0xff);
        repeated += !again.result && sets_equal(&sets[i], &again);
        set_free(&again);
        set_make_over(&again, view, &desc, 0);
        repeated += !again.result && sets_equal(&sets[i], &again);
        set_free(&again);
        for (k = 0; k < i; k++)
            same += sets_equal(&sets[i], &sets[k]);
    }
    CHECK(repeated == 10, "%s: a seed gives the same bytes, whatever was in scratch: %d of 10",
          by->name, repeated);
    if (by->seeded)
        CHECK(same == 0, "%s: other seeds give other lights: %d of 10 are the same", by->name,
              same);
    for (i = 0; i < 5; i++)
        set_free(&sets[i]);
}

static void test_optional(const envsamp_image *view)
{
    const envsamp_lights_desc defaults = envsamp_lights_defaults();
    light_set s, t;
    envsamp_sizes sizes;

    set_make(&s, view, &defaults);
    set_make(&t, view, &defaults);
    memset(t.lights, 0, (size_t)defaults.count * sizeof *t.lights);
    t.result = envsamp_lights(view, NULL, t.lights, 32, t.scratch.buffer, NULL);
    CHECK(!s.result && !t.result && sets_equal(&s, &t) && set_intact(&t)
          && IS(envsamp_lights_sizes(view, NULL, &sizes), ENVSAMP_OK)
          && !memcmp(&sizes, &s.sizes, sizeof sizes),
          "no description is the defaults, and no info is fine");
    t.result = envsamp_lights(view, NULL, t.lights, INT_MAX, t.scratch.buffer, &t.info);
    CHECK(!t.result && sets_equal(&s, &t) && IS(t.info.count, 32) && set_intact(&t),
          "more capacity than lights makes no more of them");
    set_free(&s);
    set_free(&t);
}

static void test_defaults(void)
{
    const envsamp_lights_desc d = envsamp_lights_defaults();

    CHECK(IS(d.count, 32) && IS(d.method, ENVSAMP_LIGHTS_RELAXED) && IS(d.seed, 0)
          && IS(d.strict, 0),
          "defaults: 32, RELAXED, seed 0, not strict");
    CHECK(IS(d.percentile, 0.98f) && IS(d.lambda, 3.0f) && IS(d.gamma, 0.001f)
          && IS(d.mask_scale, 0.15f)
          && IS(d.weight_variance, 1.0f) && IS(d.weight_extent, 5.0f) && IS(d.weight_energy, 1.0f)
          && IS(d.refine_rounds, 64), "and those of DECOMPOSED");
}

static void test_same(void)
{
    envsamp_image view;
    image map;
    int m;

    if (!map_make("sky", 97, 41, &map))
        return;
    view = kd_image(map.rgb, map.width, map.height, 3);
    for (m = 0; m < METHOD_COUNT; m++) {
        test_turned(&methods[m]);
        test_seeds(&methods[m], &view);
    }
    test_optional(&view);
    test_defaults();
    image_free(&map);
}

/* ---- odd maps ---- */

/* All methods, mappings, and counts from one to more than there are texels. */
static void test_odd(const char *name, canvas *c)
{
    static const int counts[] = { 1, 2, 7, 64, 1000 };
    int m, mapping, k;

    for (m = 0; m < METHOD_COUNT; m++) {
        verdict v;

        memset(&v, 0, sizeof v);
        for (mapping = 0; mapping < 3; mapping++)
            for (k = 0; k < 5; k++) {
                c->view.mapping = (envsamp_mapping)mapping;
                judge_count(&c->view, &methods[m], counts[k], &v);
            }
        check_verdict(name, &methods[m], &v);
    }
}

static void test_shapes(void)
{
    static const int shapes[][2] = {
        { 1, 1 }, { 1, 2 }, { 2, 1 }, { 2, 2 }, { 3, 5 }, { 1, 300 }, { 300, 1 }, { 31, 3 },
        { 32, 3 }, { 33, 3 }, { 1, 65535 }, { 65535, 1 }
    };
    size_t i;

    for (i = 0; i < sizeof shapes / sizeof *shapes; i++) {
        canvas c = canvas_filled(shapes[i][0], shapes[i][1], i % 2 ? 3 : 1, 2.0f);
        char name[40];

        snprintf(name, sizeof name, "constant, %d by %d", shapes[i][0], shapes[i][1]);
        test_odd(name, &c);
        free(c.pixels);
    }
}

static void test_lone_texels(void)
{
    static const int lone[][4] = { { 8, 4, 0, 0 }, { 8, 4, 7, 0 }, { 8, 4, 0, 3 }, { 8, 4, 7, 3 },
                                   { 80, 40, 79, 39 }, { 80, 40, 33, 17 }, { 1, 90, 0, 89 } };
    size_t i;

    for (i = 0; i < sizeof lone / sizeof *lone; i++) {
        canvas c = canvas_make(lone[i][0], lone[i][1], 3, 0);
        char name[40];

        canvas_at(&c, lone[i][2], lone[i][3])[0] = 0.25f;
        canvas_at(&c, lone[i][2], lone[i][3])[2] = 7.0f;
        snprintf(name, sizeof name, "%d by %d, texel %d, %d lit", lone[i][0], lone[i][1],
                 lone[i][2], lone[i][3]);
        test_odd(name, &c);
        free(c.pixels);
    }
}

/* Dark gaps between lamps of very different light. */
static void test_lamps(void)
{
    canvas c = canvas_make(70, 9, 1, 0);
    int i;

    for (i = 0; i < 70 * 9; i += 13)
        c.pixels[i] = i % 5 ? 1e-3f : 1e6f;
    test_odd("lamps in the dark", &c);
    c.pixels[300] = FLT_MAX;
    c.pixels[301] = 1e-45f;
    test_odd("a lamp of FLT_MAX", &c);
    free(c.pixels);
}

/* Noise of which most is black: importance that is passed on must not choose a black texel. */
static void test_sparse(const method *by)
{
    pcg32 random = pcg32_make(12, 5);
    verdict v;
    int round, i;

    memset(&v, 0, sizeof v);
    for (round = 0; round < 500; round++) {
        canvas c = canvas_make(24 + round % 13, 12 + round % 7, 3, 0);

        for (i = 0; i < c.view.width * c.view.height; i++)
            if (pcg32_next(&random) % 8u == 0)
                c.pixels[3 * i + i % 3] = 0.1f + pcg32_float(&random);
        c.view.mapping = (envsamp_mapping)(round % 3);
        judge_count(&c.view, by, 5 + round % 200, &v);
        free(c.pixels);
    }
    check_verdict("mostly black", by, &v);
}

/* Whether a constant map gives finite lights with its energy, but for what no float can hold. */
static int range_good(const envsamp_image *view, const envsamp_lights_desc *desc)
{
    const double count = (double)desc->count;
    double total[3];
    int i, good;
    light_set s;

    map_total(view, total);
    good = set_make(&s, view, desc) && set_intact(&s);
    for (i = 0; i < desc->count && good; i++)
        good = !judge_light(&s.lights[i]);
    for (i = 0; i < 3 && good; i++)
        good = fabs(set_sum(&s, i) - fmin(total[i], count * (double)FLT_MAX))
            <= LEAST * count + ENERGY * total[i] && off(s.info.integral[i], total[i]) <= INTEGRAL;
    set_free(&s);
    return good;
}

/* Numbers at the ends of the range. */
static void test_range(const char *name, float value, int channels)
{
    static const int counts[] = { 1, 3, 100 };
    canvas c = canvas_filled(5, 3, channels, value);
    int m, mapping, k;

    for (m = 0; m < METHOD_COUNT; m++) {
        int good = 0;

        for (mapping = 0; mapping < 3; mapping++)
            for (k = 0; k < 3; k++) {
                const envsamp_lights_desc desc = ask(&methods[m], counts[k], 0);

                c.view.mapping = (envsamp_mapping)mapping;
                good += range_good(&c.view, &desc);
            }
        CHECK(good == 9, "%s, %s, %d channels: %d of 9 sets are finite and have its energy", name,
              methods[m].name, channels, good);
    }
    free(c.pixels);
}

static void test_ranges(void)
{
    canvas c = canvas_filled(4, 3, 3, 1e37f);

    test_odd("1e37", &c);
    free(c.pixels);
    test_range("FLT_MAX", FLT_MAX, 1);
    test_range("FLT_MAX", FLT_MAX, 3);
    test_range("FLT_MIN", FLT_MIN, 3);
    test_range("denormals", 1e-40f, 1);
    test_range("denormals", 1e-40f, 4);
    test_range("the least denormal", 1e-45f, 1);
    test_range("the least denormal", 1e-45f, 3);
}

/* ---- bad pixels ---- */

/* A wide map with bad pixels here and there; zeros of either sign and denormals are not bad. */
static canvas bad_map(int channels, int *bad)
{
    static const float odd[8] = { NAN, INFINITY, -INFINITY, -1.0f, -1e-45f, -0.0f, 1e-45f, 0.0f };
    canvas c = canvas_make(70, 6, channels, 0);
    int i;

    *bad = 0;
    for (i = 0; i < 70 * 6 * channels; i++)
        c.pixels[i] = 1.0f + 0.1f * (float)(i % 11);
    for (i = 0; i < 70 * 6; i += 9) {
        const int kind = i / 9 % 8;

        c.pixels[i * channels + i % (channels == 1 ? 1 : 3)] = odd[kind];
        *bad += kind < 5;
    }
    for (i = 0; i < 70 * 6 && channels == 4; i++)
        c.pixels[4 * i + 3] = odd[i % 5];
    return c;
}

static void test_bad_pixels(const method *by, int channels)
{
    envsamp_lights_desc desc = ask(by, 100, 0);
    int bad;
    canvas c = bad_map(channels, &bad);
    double total[3];
    light_set s;
    verdict v;

    memset(&v, 0, sizeof v);
    map_total(&c.view, total);
    set_make(&s, &c.view, &desc);
    judge_set(&s, by, total, &v);
    CHECK(verdict_good(&v) && s.info.bad_pixel_count == (size_t)bad, "%s, %d channels: NaN, "
          "infinity and negative are black or 0, and %d of %d counted; flags %d", by->name,
          channels, (int)s.info.bad_pixel_count, bad, v.flags);
    set_free(&s);
    desc.strict = 1;
    CHECK(!set_make(&s, &c.view, &desc) && s.result == ENVSAMP_ERR_VALUE && set_intact(&s),
          "%s, %d channels: strict refuses them", by->name, channels);
    set_free(&s);
    free(c.pixels);
    c = canvas_filled(40, 3, channels, 0.5f);
    CHECK(set_make(&s, &c.view, &desc) && s.info.bad_pixel_count == 0,
          "%s, %d channels: but takes good ones", by->name, channels);
    set_free(&s);
    free(c.pixels);
}

static void test_black(const method *by)
{
    static const float values[] = { 0.0f, -0.0f, -3.0f, NAN, INFINITY, -INFINITY };
    envsamp_lights_desc desc = ask(by, 5, 0);
    int i, black = 0, refused = 0;

    for (i = 0; i < 6; i++) {
        canvas c = canvas_filled(i % 2 ? 40 : 3, 3, i % 3 ? 3 : 1, values[i]);
        light_set s;

        desc.strict = 0;
        black += !set_make(&s, &c.view, &desc) && s.result == ENVSAMP_ERR_BLACK && set_intact(&s);
        set_free(&s);
        desc.strict = 1;
        set_make(&s, &c.view, &desc);
        refused += s.result == (i < 2 ? ENVSAMP_ERR_BLACK : ENVSAMP_ERR_VALUE);
        set_free(&s);
        free(c.pixels);
    }
    CHECK(black == 6 && refused == 6, "%s: %d of 6 maps are black, strict says why of %d",
          by->name, black, refused);
}

/* ---- arguments ---- */

static canvas small_map(void)
{
    canvas c = canvas_make(6, 3, 3, 0);
    int i;

    for (i = 0; i < 6 * 3 * 3; i++)
        c.pixels[i] = 1.0f + (float)(i % 5);
    return c;
}

/* Whether both functions say so, and no sizes are given where it is an error. */
static int both_say(const envsamp_image *view, const envsamp_lights_desc *desc,
                    envsamp_result expected)
{
    envsamp_light lights[4];
    envsamp_sizes sizes = { 77, 77 };
    kd_guarded scratch = kd_guarded_make(1 << 20, RUBBISH);
    const envsamp_result first = envsamp_lights_sizes(view, desc, &sizes);
    const envsamp_result result = envsamp_lights(view, desc, lights, 4, scratch.buffer, NULL);
    const int intact = kd_guarded_intact(&scratch);

    free(scratch.block);
    return first == expected && result == expected && intact && sizes.table_bytes == 0
        && (sizes.scratch_bytes > 0) == (expected == ENVSAMP_OK);
}

static void test_missing(const method *by)
{
    const envsamp_lights_desc desc = ask(by, 4, 0);
    canvas c = small_map();
    envsamp_image view = c.view;
    envsamp_sizes sizes;
    envsamp_buffer none = { NULL, 1 << 20 };
    light_set s;

    set_make(&s, &view, &desc);
    CHECK(envsamp_lights_sizes(NULL, &desc, &sizes) == ENVSAMP_ERR_NULL
          && sizes.scratch_bytes == 0 && sizes.table_bytes == 0
          && envsamp_lights_sizes(&view, &desc, NULL) == ENVSAMP_ERR_NULL, "%s: sizes of nothing, "
          "or into nothing", by->name);
    CHECK(envsamp_lights(NULL, &desc, s.lights, 4, s.scratch.buffer, NULL) == ENVSAMP_ERR_NULL,
          "%s: no image", by->name);
    CHECK(envsamp_lights(&view, &desc, NULL, 4, s.scratch.buffer, NULL) == ENVSAMP_ERR_NULL,
          "%s: no lights", by->name);
    CHECK(envsamp_lights(&view, &desc, s.lights, 4, none, NULL) == ENVSAMP_ERR_NULL,
          "%s: no scratch", by->name);
    view.pixels = NULL;
    CHECK(envsamp_lights(&view, &desc, s.lights, 4, s.scratch.buffer, NULL) == ENVSAMP_ERR_NULL
          && envsamp_lights_sizes(&view, &desc, &sizes) == ENVSAMP_OK
          && sizes.scratch_bytes == s.sizes.scratch_bytes, "%s: no pixels, but sizes", by->name);
    set_free(&s);
    free(c.pixels);
}

static void test_images(const method *by)
{
    static const struct { int width, height, channels; size_t stride; int mapping, expected; }
    bad[] = {
        { 0, 3, 3, 0, 0, ENVSAMP_ERR_SIZE }, { -1, 3, 3, 0, 0, ENVSAMP_ERR_SIZE },
        { 65536, 3, 3, 0, 0, ENVSAMP_ERR_SIZE }, { 6, 0, 3, 0, 0, ENVSAMP_ERR_SIZE },
        { 6, -7, 3, 0, 0, ENVSAMP_ERR_SIZE }, { 6, 65536, 3, 0, 0, ENVSAMP_ERR_SIZE },
        { 6, 3, 2, 0, 0, ENVSAMP_ERR_SIZE }, { 6, 3, 0, 0, 0, ENVSAMP_ERR_SIZE },
        { 6, 3, 5, 0, 0, ENVSAMP_ERR_SIZE }, { 6, 3, -3, 0, 0, ENVSAMP_ERR_SIZE },
        { 6, 3, 3, 68, 0, ENVSAMP_ERR_SIZE }, { 6, 3, 3, 74, 0, ENVSAMP_ERR_ALIGN },
        { 6, 3, 3, SIZE_MAX / 4 * 4, 0, ENVSAMP_ERR_SIZE }, { 6, 3, 3, 0, 3, ENVSAMP_ERR_PARAM },
        { 6, 3, 3, 0, -1, ENVSAMP_ERR_PARAM }, { 6, 3, 3, 72, 0, ENVSAMP_OK },
        { 5, 2, 3, 72, 2, ENVSAMP_OK }, { 6, 3, 1, 0, 1, ENVSAMP_OK }
    };
    const int count = (int)(sizeof bad / sizeof *bad);
    const envsamp_lights_desc desc = ask(by, 4, 0);
    canvas c = small_map();
    int i, right = 0;

    for (i = 0; i < count; i++) {
        envsamp_image view = c.view;

        view.width = bad[i].width;
        view.height = bad[i].height;
        view.channels = bad[i].channels;
        view.row_stride_bytes = bad[i].stride;
        view.mapping = (envsamp_mapping)bad[i].mapping;
        right += both_say(&view, &desc, (envsamp_result)bad[i].expected);
    }
    CHECK(right == count, "%s: %d of %d images are refused or taken rightly", by->name, right,
          count);
    for (i = 1, right = 0; i < 4; i++) {
        envsamp_image view = c.view;
        envsamp_light lights[4];
        kd_guarded scratch = kd_guarded_make(1 << 20, RUBBISH);

        view.pixels = (const float *)((uintptr_t)c.view.pixels + (uintptr_t)i);
        right += envsamp_lights(&view, &desc, lights, 4, scratch.buffer, NULL)
              == ENVSAMP_ERR_ALIGN && kd_guarded_intact(&scratch);
        free(scratch.block);
    }
    CHECK(right == 3, "%s: pixels beside a multiple of 4 are refused %d of 3 times", by->name,
          right);
    free(c.pixels);
}

static void test_counts(const method *by)
{
    static const int counts[] = { INT_MIN + 1, -1, INT_MIN, 65537, INT_MAX, 1, 4 };
    canvas c = small_map();
    envsamp_sizes sizes;
    envsamp_lights_desc desc = ask(by, 65536, 0);
    int i, right = 0;

    CHECK(envsamp_lights_sizes(&c.view, &desc, &sizes) == ENVSAMP_OK
          && sizes.scratch_bytes >= 12u * 65536u, "%s: 65536 lights are not too many", by->name);
    for (i = 0; i < 7; i++) {
        desc = ask(by, counts[i], 0);
        right += both_say(&c.view, &desc, i < 5 ? ENVSAMP_ERR_PARAM : ENVSAMP_OK);
    }
    CHECK(right == 7, "%s: %d of 7 counts are refused or taken rightly", by->name, right);
    free(c.pixels);
}

/* Those of `methods` are there, those of tests/test_lights_cuts.c, and no others. */
static void test_method_numbers(void)
{
    static const int numbers[] = { -1, 0, 1, 2, 3, 4, 5, 6, 7, 255, 256, INT_MAX, INT_MIN };
    const int count = (int)(sizeof numbers / sizeof *numbers);
    canvas c = small_map();
    int i, right = 0;

    for (i = 0; i < count; i++) {
        envsamp_lights_desc desc = ask(&methods[RANDOM], 4, 0);
        const int there = numbers[i] >= ENVSAMP_LIGHTS_RELAXED
                       && numbers[i] <= ENVSAMP_LIGHTS_RANDOM;

        desc.method = (envsamp_lights_method)numbers[i];
        right += both_say(&c.view, &desc, there ? ENVSAMP_OK : ENVSAMP_ERR_PARAM);
    }
    CHECK(right == count, "%d of %d numbers of methods are refused or taken rightly", right, count);
    free(c.pixels);
}

/* As the header says: 8 bytes a row, up to 28 a column, 12 a light, and some for alignment. */
static void test_scratch(const method *by)
{
    static const int shapes[5][3] = { { 1, 1, 1 }, { 1000, 500, 9 }, { 65535, 1, 65536 },
                                      { 1, 65535, 32 }, { 65535, 65535, 65536 } };
    int i, right = 0;

    for (i = 0; i < 5; i++) {
        const envsamp_image view = kd_image(NULL, shapes[i][0], shapes[i][1], 3);
        const envsamp_lights_desc desc = ask(by, shapes[i][2], 0);
        envsamp_sizes sizes;

        right += envsamp_lights_sizes(&view, &desc, &sizes) == ENVSAMP_OK
              && sizes.table_bytes == 0 && sizes.scratch_bytes > 0
              && sizes.scratch_bytes <= (size_t)(8 * shapes[i][1] + 28 * shapes[i][0]
                                                 + 12 * shapes[i][2] + 8 * 16);
    }
    CHECK(right == 5, "%s: %d of 5 scratch sizes are as small as said", by->name, right);
}

/* set_make gives just the bytes and the capacity asked for, and everything above works with that:
   here, what happens with less. */
static void test_memory(const method *by)
{
    static const int capacities[4] = { 8, 0, -1, INT_MIN };
    const envsamp_lights_desc desc = ask(by, 9, 0);
    canvas c = small_map();
    envsamp_buffer less;
    light_set s;
    int i, right = 0;

    set_make(&s, &c.view, &desc);
    CHECK(s.result == ENVSAMP_OK && set_intact(&s) && s.sizes.table_bytes == 0,
          "%s: just enough of it", by->name);
    for (i = 0; i < 4; i++)
        right += envsamp_lights(&c.view, &desc, s.lights, capacities[i], s.scratch.buffer, NULL)
              == ENVSAMP_ERR_MEMORY;
    CHECK(right == 4, "%s: too little capacity: %d of 4 refused", by->name, right);
    less = s.scratch.buffer;
    less.bytes--;
    CHECK(envsamp_lights(&c.view, &desc, s.lights, 9, less, NULL) == ENVSAMP_ERR_MEMORY,
          "%s: a byte of scratch less", by->name);
    for (right = 0, i = 1; i < ENVSAMP_ALIGN; i++) {
        less.data = (char *)s.scratch.buffer.data + i;
        less.bytes = s.scratch.buffer.bytes;
        right += envsamp_lights(&c.view, &desc, s.lights, 9, less, NULL) == ENVSAMP_ERR_ALIGN;
    }
    CHECK(right == ENVSAMP_ALIGN - 1 && set_intact(&s), "%s: %d of 7 shifts not aligned",
          by->name, right);
    set_free(&s);
    free(c.pixels);
}

/* ---- nothing left to choose by rounding ---- */

/* A texel whose luminance as a float is less than it is, or 0. A light must be found even if a sum
   of floats never gets to what it waits for. The seeds are those whose numbers are nearest to the
   end of their range. */
static void test_last_light(void)
{
    static const float faint[3] = { 0.0f, 0.0f, 1e-45f }, tinted[3] = { 0.103f, 0.3f, 0.7f };
    static const uint32_t seeds[METHOD_COUNT] = { 146559516u, 195148866u };
    const envsamp_image dim = kd_image(faint, 1, 1, 3), lit = kd_image(tinted, 1, 1, 3);
    double total[3];
    light_set s;
    verdict v;
    int m;

    map_total(&lit, total);
    for (m = 0; m < METHOD_COUNT; m++) {
        const envsamp_lights_desc desc = ask(&methods[m], 1, seeds[m % 2]);

        memset(&v, 0, sizeof v);
        set_make(&s, &lit, &desc);
        judge_set(&s, &methods[m], total, &v);
        check_verdict("the last light", &methods[m], &v);
        set_free(&s);
        set_make(&s, &dim, &desc);
        CHECK(s.result == ENVSAMP_ERR_BLACK || (!s.result && !judge_light(s.lights)),
              "%s: the least blue is a light, or black", methods[m].name);
        set_free(&s);
    }
}

static void test_arguments(void)
{
    int m;

    for (m = 0; m < METHOD_COUNT; m++) {
        test_bad_pixels(&methods[m], 1);
        test_bad_pixels(&methods[m], 3);
        test_bad_pixels(&methods[m], 4);
        test_black(&methods[m]);
        test_missing(&methods[m]);
        test_images(&methods[m]);
        test_counts(&methods[m]);
        test_memory(&methods[m]);
        if (methods[m].of_texels)
            test_scratch(&methods[m]);
    }
    test_method_numbers();
}

int main(void)
{
    int i, m;

    test_maps();
    test_many();
    for (i = 0; i < SPOILS; i++)
        test_judge(i);
    test_convergence();
    for (i = 0; i < DRAWN_KINDS; i++)
        test_draws(ENVSAMP_LATLONG, i);
    test_draws(ENVSAMP_HEMISPHERE, DRAWN);
    test_draws(ENVSAMP_OCTAHEDRAL, DRAWN);
    test_independence(&methods[RANDOM]);
    test_independence(&methods[HALFTONE]);
    for (m = 0; m < METHOD_COUNT; m++)
        for (i = 0; i < 3; i++)
            test_suns(&methods[m], (envsamp_mapping)i);
    test_evenness();
    test_same();
    test_shapes();
    test_lone_texels();
    test_lamps();
    for (m = 0; m < METHOD_COUNT; m++)
        test_sparse(&methods[m]);
    test_ranges();
    test_arguments();
    test_last_light();
    return check_done();
}
