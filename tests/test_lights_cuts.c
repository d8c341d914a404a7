/* test_lights_cuts.c: lights that are centroids of parts of a map: MEDIAN_CUT, VARIANCE_CUT and
 * RELAXED, and their interleaved sets. Cuts are made again by brute force over the texels; weights
 * of RELAXED must be the minimum of the energy distance that the header names.
 *
 *     test_lights_cuts [quick]       quick: without the long one, for slow tools
 */
#include "check.h"
#include "inside.h"

#include "../envsamp.h"

#include "lights_judge.h"
#include "../examples/common/irradiance.h"
#include "../examples/common/maps.h"

#include <limits.h>

/* ---- methods ---- */

enum { MEDIAN, VARIANCE, RELAXED, METHODS };

static const char *const method_names[METHODS] = { "MEDIAN_CUT", "VARIANCE_CUT", "RELAXED" };

static envsamp_lights_desc ask(int method, int count)
{
    static const envsamp_lights_method ids[METHODS] = {
        ENVSAMP_LIGHTS_MEDIAN_CUT, ENVSAMP_LIGHTS_VARIANCE_CUT, ENVSAMP_LIGHTS_RELAXED
    };
    envsamp_lights_desc desc = envsamp_lights_defaults();

    desc.method = ids[method];
    desc.count = count;
    return desc;
}

static envsamp_lights_desc ask_other(envsamp_lights_method method, int count, uint32_t seed)
{
    envsamp_lights_desc desc = envsamp_lights_defaults();

    desc.method = method;
    desc.count = count;
    desc.seed = seed;
    return desc;
}

/* Between unit vectors, small ones too. */
static double angle_between(const double a[3], const double b[3])
{
    return 2.0 * asin(fmin(0.5 * distance(a, b), 1.0));
}

static double light_luminance(const envsamp_light *l)
{
    const double rgb[3] = { (double)l->irradiance[0], (double)l->irradiance[1],
                            (double)l->irradiance[2] };

    return luminance_of(rgb);
}

/* ---- sums of the map ---- */

static cell grid_sum(const grid *g, int x0, int y0, int x1, int y1)
{
    cell sum;
    int x, y;

    memset(&sum, 0, sizeof sum);
    for (y = y0; y < y1; y++)
        for (x = x0; x < x1; x++)
            add_cell(&sum, &g->cells[(size_t)y * (size_t)g->view.width + (size_t)x]);
    return sum;
}

/* Luminance times squared distance from the centroid. */
static double spread_of(const cell *sum)
{
    return sum->luminance > 0.0 ? fmax(sum->luminance - dot(sum->v, sum->v) / sum->luminance, 0.0)
                                : 0.0;
}

/* ---- what every set is to be ---- */

/* Whether the set is that of HALFTONE. */
static int fell_back(const light_set *s, const envsamp_image *view)
{
    const envsamp_lights_desc desc = ask_other(ENVSAMP_LIGHTS_HALFTONE, s->desc.count,
                                               s->desc.seed);
    light_set plain;
    int same;

    set_make(&plain, view, &desc);
    same = sets_equal(&plain, s);
    set_free(&plain);
    return same;
}

/* Cuts fill the whole map; parts of RELAXED at least what is lit of it. */
static int fills(const light_set *s, const grid *g)
{
    double sum = 0.0;
    int i;

    for (i = 0; i < s->desc.count; i++)
        sum += (double)s->lights[i].solid_angle;
    if (s->desc.method == ENVSAMP_LIGHTS_RELAXED)
        return sum <= g->total.sr * 1.001 && sum >= g->lit_sr * 0.999;
    return fabs(sum / g->total.sr - 1.0) <= 1e-3;
}

/* No light is direct, and all of the map is in the lights' parts. */
static void judge_parts(const light_set *s, const grid *g, verdict *v)
{
    const int unfilled = v->unfilled;

    judge_set(s, g, v);
    v->failed += s->info.direct_count || s->info.threshold != 0.0f;
    if (s->result == ENVSAMP_OK)
        v->unfilled = unfilled + !fills(s, g);
}

static void judge_view(const envsamp_image *view, int method, int count, verdict *v)
{
    const envsamp_lights_desc desc = ask(method, count);
    grid g = grid_make(view);
    light_set s;

    set_make(&s, view, &desc);
    judge_parts(&s, &g, v);
    set_free(&s);
    free(g.cells);
}

static void check_verdict(const char *name, int method, const verdict *v)
{
    CHECK(verdict_good(v), "%s, %s: %d of %d calls wrong, energy %.1e and integral %.1e off, %d "
          "of %d lights wrong, flags %d, %d sets with other solid angles", name,
          method_names[method], v->failed, v->sets, v->energy, v->integral, v->wrong, v->lights,
          v->flags, v->unfilled);
}

/* ---- energy: maps x mappings x layouts x counts x methods ---- */

enum { COUNTS = 12 };

static const int counts[COUNTS] = { 1, 2, 3, 16, 32, 64, 127, 128, 129, 256, 1000, 1024 };

/* RELAXED, which takes longer, by one mapping for each count. */
static void judge_canvas(canvas *c, int layout, verdict verdicts[METHODS])
{
    int mapping, method, k;

    for (mapping = 0; mapping < 3; mapping++) {
        grid g;

        c->view.mapping = (envsamp_mapping)mapping;
        g = grid_make(&c->view);
        for (method = 0; method < METHODS; method++)
            for (k = 0; k < COUNTS; k++) {
                const envsamp_lights_desc desc = ask(method, counts[k]);
                light_set s;

                if ((k + mapping) % LAYOUTS != layout
                    || (method == RELAXED && (k + k / 3) % 3 != mapping))
                    continue;
                set_make(&s, &c->view, &desc);
                judge_parts(&s, &g, &verdicts[method]);
                set_free(&s);
            }
        free(g.cells);
    }
}

static void test_map(const char *name, const image *map)
{
    verdict verdicts[METHODS];
    int layout, method;

    memset(verdicts, 0, sizeof verdicts);
    for (layout = 0; layout < LAYOUTS; layout++) {
        canvas c = canvas_of(map, layout);

        judge_canvas(&c, layout, verdicts);
        free(c.pixels);
    }
    for (method = 0; method < METHODS; method++)
        check_verdict(name, method, &verdicts[method]);
}

static void test_maps(void)
{
    int i, real = 0;
    image map;

    for (i = 0; map_names[i]; i++)
        if (map_make(map_names[i], 256, 128, &map)) {
            test_map(map_names[i], &map);
            image_free(&map);
        }
    for (i = 0; i < REAL_MAP_COUNT; i += 6)
        if (real_map(i, 3, &map)) {
            test_map(real_map_name(i), &map);
            image_free(&map);
            real++;
        }
    if (!real)
        CHECK_SKIP("no real maps in data/");
}

/* Sides that are no powers of two, or 1, or the longest. */
static void test_shapes(void)
{
    static const int shapes[][2] = {
        { 1, 1 }, { 1, 2 }, { 2, 1 }, { 1, 77 }, { 300, 1 }, { 33, 17 }, { 257, 3 }, { 129, 65 },
        { 515, 130 }, { 65535, 1 }, { 1, 65535 }
    };
    int i, method, k;

    for (method = 0; method < METHODS; method++) {
        verdict v;

        memset(&v, 0, sizeof v);
        for (i = 0; i < (int)(sizeof shapes / sizeof *shapes); i++) {
            canvas c = noise_map(shapes[i][0], shapes[i][1], 7, 1.0f);

            for (k = 0; k < COUNTS; k += shapes[i][0] * shapes[i][1] > 5000 ? 4 : 1) {
                c.view.mapping = (envsamp_mapping)((i + k) % 3);
                judge_view(&c.view, method, counts[k], &v);
            }
            free(c.pixels);
        }
        check_verdict("odd shapes", method, &v);
    }
}

/* 1000 lights of RELAXED want more pieces than there is room for. */
static void test_many_pieces(void)
{
    canvas c = noise_map(256, 256, 12, 1.0f);
    verdict v;

    memset(&v, 0, sizeof v);
    judge_view(&c.view, RELAXED, 1000, &v);
    check_verdict("more pieces than there is room for", RELAXED, &v);
    free(c.pixels);
}

/* Two texels opposite one another have no centroid: their one light stands in the middle of the
   map; with RELAXED at one of them. */
static void test_opposite(void)
{
    canvas c = canvas_make(2, 1, 3, 0);
    int method;

    canvas_fill(&c, 0, 0, 2, 1, 0.5f);
    for (method = 0; method < METHODS; method++) {
        const envsamp_lights_desc desc = ask(method, 1);
        light_set s;

        set_make(&s, &c.view, &desc);
        CHECK(s.result == ENVSAMP_OK
              && fabsf(method == RELAXED ? fabsf(s.lights[0].dir[1]) - 1.0f
                       : s.lights[0].dir[0] + 1.0f) < 1e-6f
              && fabs((double)s.lights[0].irradiance[1] / (0.5 * 4.0 * KD_PI) - 1.0) < 1e-6
              && s.lights[0].cos_extent <= -1.0f, "%s: a light of two opposite texels is at %g, "
              "%g, %g", method_names[method], (double)s.lights[0].dir[0], (double)s.lights[0].dir[1],
              (double)s.lights[0].dir[2]);
        set_free(&s);
    }
    free(c.pixels);
}

/* Maps from the least floats to the largest, with one of the largest, and with bad pixels. */
static void test_values(void)
{
    static const struct { const char *name; float value, one; } kinds[] = {
        { "the largest floats", FLT_MAX, FLT_MAX }, { "one of the largest", 1.0f, FLT_MAX },
        { "denormals", 1e-40f, 1e-39f }, { "the least floats", 1e-42f, 1e-42f },
        { "NaN", 1.0f, NAN }, { "infinity", 1.0f, INFINITY }, { "negative", 1.0f, -3.0f }
    };
    int i, method, k;

    for (i = 0; i < (int)(sizeof kinds / sizeof *kinds); i++)
        for (method = 0; method < METHODS; method++) {
            canvas c = canvas_make(40, 20, 3, 0);
            verdict v;

            memset(&v, 0, sizeof v);
            canvas_fill(&c, 0, 0, 40, 20, kinds[i].value);
            canvas_at(&c, 11, 7)[1] = kinds[i].one;
            for (k = 3; k < COUNTS; k++) {
                c.view.mapping = (envsamp_mapping)(k % 3);
                judge_view(&c.view, method, counts[k], &v);
            }
            check_verdict(kinds[i].name, method, &v);
            free(c.pixels);
        }
}

/* What judge_set must reject. */
static void test_judge(void)
{
    enum { SOUND, TWICE, LONG, NO_CONE, NO_SIZE, LARGE, DIRECT, NO_SINE, SPOILS };
    static const char *const names[SPOILS] = {
        "as they are", "a light counts twice", "longer by 2e-6", "no cone", "no solid angle",
        "larger by half", "a direct light", "of a map without sine"
    };
    canvas c = noise_map(64, 32, 1, 1.0f);
    const envsamp_lights_desc desc = ask(MEDIAN, 16);
    int how, i;

    for (how = 0; how < SPOILS; how++) {
        envsamp_image view = c.view;
        light_set s;
        verdict v;
        grid g;

        memset(&v, 0, sizeof v);
        view.mapping = how == NO_SINE ? ENVSAMP_OCTAHEDRAL : ENVSAMP_LATLONG;
        g = grid_make(&view);
        set_make(&s, &c.view, &desc);
        for (i = 0; i < 3; i++) {
            s.lights->irradiance[i] *= how == TWICE ? 2.0f : 1.0f;
            s.lights->dir[i] *= how == LONG ? 1.000002f : 1.0f;
        }
        s.lights->cos_extent = how == NO_CONE ? NAN : s.lights->cos_extent;
        s.lights->solid_angle *= how == NO_SIZE ? 0.0f : how == LARGE ? 1.5f : 1.0f;
        s.lights->direct = how == DIRECT;
        judge_parts(&s, &g, &v);
        CHECK(verdict_good(&v) == (how == SOUND), "%s: %s", how == SOUND ? "lights" : "control",
              names[how]);
        set_free(&s);
        free(g.cells);
    }
    free(c.pixels);
}

/* ---- cuts, made again ---- */

/* A rectangle of texels. */
typedef struct box { int x0, y0, x1, y1; cell sum; } box;

static box box_of(const grid *g, int x0, int y0, int x1, int y1)
{
    box b;

    b.x0 = x0;
    b.y0 = y0;
    b.x1 = x1;
    b.y1 = y1;
    b.sum = grid_sum(g, x0, y0, x1, y1);
    return b;
}

/* Cuts a box in two across one axis at the best place; the cost, or -1. */
static double best_cut(const grid *g, const box *b, int vertical, int by_variance, box parts[2])
{
    const int from = vertical ? b->x0 : b->y0, to = vertical ? b->x1 : b->y1;
    double best = -1.0;
    int cut;

    for (cut = from + 1; cut < to; cut++) {
        const box low = box_of(g, b->x0, b->y0, vertical ? cut : b->x1, vertical ? b->y1 : cut);
        const box high = box_of(g, vertical ? cut : b->x0, vertical ? b->y0 : cut, b->x1, b->y1);
        const double cost = by_variance ? spread_of(&low.sum) + spread_of(&high.sum)
                                        : fabs(low.sum.luminance - high.sum.luminance);

        if (low.sum.luminance > 0.0 && high.sum.luminance > 0.0 && (best < 0.0 || cost < best)) {
            best = cost;
            parts[0] = low;
            parts[1] = high;
        }
    }
    return best;
}

/* Whether a box is at least as long across as down, on the sphere. */
static int box_wide(const grid *g, const box *b)
{
    const double polar = g->view.mapping == ENVSAMP_LATLONG ? KD_PI : 0.5 * KD_PI;
    const double across = (double)(b->x1 - b->x0) / (double)g->view.width;
    const double down = (double)(b->y1 - b->y0) / (double)g->view.height;
    const double middle = 0.5 * (double)(b->y0 + b->y1) / (double)g->view.height;

    if (g->view.mapping == ENVSAMP_OCTAHEDRAL)
        return across >= down;
    return 2.0 * KD_PI * across * sin(polar * middle) >= polar * down;
}

/* Returns how many boxes there are. */
static int reference_cuts(const grid *g, int by_variance, int wanted, box *boxes)
{
    int made = 1, i;

    boxes[0] = box_of(g, 0, 0, g->view.width, g->view.height);
    while (made < wanted) {
        box columns[2], rows[2];
        double most = -1.0, across, down;
        int at = 0;

        for (i = 0; i < made; i++) {
            const double key = by_variance ? spread_of(&boxes[i].sum) : boxes[i].sum.luminance;

            at = key > most ? i : at;
            most = fmax(most, key);
        }
        across = best_cut(g, &boxes[at], 1, by_variance, columns);
        down = best_cut(g, &boxes[at], 0, by_variance, rows);
        if (across < 0.0 && down < 0.0)
            break;
        i = down < 0.0 || (across >= 0.0 && (by_variance ? across <= down
                                                         : box_wide(g, &boxes[at])));
        boxes[at] = i ? columns[0] : rows[0];
        boxes[made++] = i ? columns[1] : rows[1];
    }
    return made;
}

/* How far a light is from what it must be for a sum over texels. */
static double off_cell(const envsamp_light *l, const cell *sum)
{
    double middle[3], dir[3], length, off;
    int c;

    memcpy(middle, sum->v, sizeof middle);
    length = normalise(middle);
    dir_of(l, dir);
    off = 1e-1 * distance(middle, dir);
    worst(&off, 1e-1 * fabs((double)l->cos_extent
                            - fmax(2.0 * length / sum->luminance - 1.0, -1.0)));
    worst(&off, fabs((double)l->solid_angle / sum->sr - 1.0));
    for (c = 0; c < 3; c++)
        worst(&off, fabs((double)l->irradiance[c] / sum->rgb[c] - 1.0));
    return off;
}

/* Every box must have its light. */
static double off_boxes(const light_set *s, const box *boxes)
{
    double off = 0.0;
    int i, k;

    for (i = 0; i < s->desc.count; i++) {
        double least = 1e300;

        for (k = 0; k < s->desc.count; k++)
            least = fmin(least, off_cell(&s->lights[k], &boxes[i].sum));
        worst(&off, least);
    }
    return off;
}

/* Noise, so that no two ways to cut are as good. */
static void test_cuts(void)
{
    static const int wanted[5] = { 1, 2, 7, 32, 100 };
    int method, mapping, k;

    for (method = MEDIAN; method <= VARIANCE; method++)
        for (mapping = 0; mapping < 3; mapping++) {
            canvas c = noise_map(40, 26, (uint64_t)(3 + mapping), 1.0f);
            double off = 0.0;
            grid g;

            c.view.mapping = (envsamp_mapping)mapping;
            g = grid_make(&c.view);
            for (k = 0; k < 5; k++) {
                const envsamp_lights_desc desc = ask(method, wanted[k]);
                box boxes[100];
                light_set s;

                worst(&off, reference_cuts(&g, method == VARIANCE, wanted[k], boxes) == wanted[k]
                            && set_make(&s, &c.view, &desc) ? off_boxes(&s, boxes) : 1e300);
                set_free(&s);
            }
            CHECK(off <= 2e-6, "%s, mapping %d: cuts by brute force, %.1e off",
                  method_names[method], mapping, off);
            free(g.cells);
            free(c.pixels);
        }
}

/* Black everywhere but for some texels. Where in the black a cut lies is left to rounding, so only
   VARIANCE_CUT, which does not ask how long a rectangle is, has the same lights; not as large. */
static void test_sparse_cuts(void)
{
    int mapping;

    for (mapping = 0; mapping < 3; mapping++) {
        const envsamp_lights_desc desc = ask(VARIANCE, 32);
        canvas c = noise_map(40, 26, (uint64_t)(9 + mapping), 0.06f);
        box boxes[32];
        light_set s;
        grid g;
        int made, i;

        c.view.mapping = (envsamp_mapping)mapping;
        g = grid_make(&c.view);
        made = reference_cuts(&g, 1, 32, boxes);
        set_make(&s, &c.view, &desc);
        for (i = 0; i < 32; i++)
            s.lights[i].solid_angle = (float)(boxes[i].sum.sr = 1.0);
        CHECK(made == 32 && off_boxes(&s, boxes) <= 2e-6, "VARIANCE_CUT, mapping %d: %d lit "
              "texels cut by brute force", mapping, g.lit);
        set_free(&s);
        free(g.cells);
        free(c.pixels);
    }
}

/* The spread of a light follows from its cone: cos_extent is 2 r - 1, spread 1 - r^2. */
static double lights_spread(const light_set *s)
{
    double sum = 0.0;
    int i;

    for (i = 0; i < s->desc.count; i++) {
        const double r = 0.5 * (1.0 + (double)s->lights[i].cos_extent);

        sum += light_luminance(&s->lights[i]) * (1.0 - r * r);
    }
    return sum;
}

/* The spread of all lights falls from MEDIAN_CUT to VARIANCE_CUT to RELAXED. */
static void test_spread(void)
{
    int i, k;
    image map;

    for (i = 0; map_names[i]; i++)
        for (k = 16; k <= 64 && map_make(map_names[i], 128, 64, &map); k *= 2) {
            const envsamp_image view = kd_image(map.rgb, 128, 64, 3);
            double spread[METHODS];
            int method;

            for (method = 0; method < METHODS; method++) {
                const envsamp_lights_desc desc = ask(method, k);
                light_set s;

                spread[method] = set_make(&s, &view, &desc) ? lights_spread(&s) : 1e300;
                set_free(&s);
            }
            CHECK(spread[VARIANCE] < spread[MEDIAN] && spread[RELAXED] < spread[MEDIAN],
                  "%s, %d lights: spread %.3g, %.3g, %.3g", map_names[i], k, spread[MEDIAN],
                  spread[VARIANCE], spread[RELAXED]);
            image_free(&map);
        }
}

/* 2^n lights of a smooth map: each cut is off by at most half of a row or column, which for 16 of
   256 x 128 is some percent. */
static void test_equal(void)
{
    canvas c = canvas_make(256, 128, 3, 0);
    int x, y, i, n, mapping;

    for (y = 0; y < 128; y++)
        for (x = 0; x < 256; x++)
            for (i = 0; i < 3; i++)
                canvas_at(&c, x, y)[i] = 2.0f + sinf(0.05f * (float)x) * cosf(0.03f * (float)y);
    for (mapping = 0; mapping < 3; mapping++)
        for (n = 2; n <= 16; n *= 2) {
            const envsamp_lights_desc desc = ask(MEDIAN, n);
            double least = 1e300, most = 0.0;
            light_set s;

            c.view.mapping = (envsamp_mapping)mapping;
            for (i = set_make(&s, &c.view, &desc) ? 0 : n; i < n; i++) {
                least = fmin(least, light_luminance(&s.lights[i]));
                most = fmax(most, light_luminance(&s.lights[i]));
            }
            CHECK(most > 0.0 && most <= least * (1.0 + 0.015 * n), "MEDIAN_CUT, mapping %d, %d "
                  "lights: the brightest is %.4f of the faintest", mapping, n, most / least);
            set_free(&s);
        }
    free(c.pixels);
}

/* ---- where the light is ---- */

static double off_middle(const envsamp_light *l, const cell *sum)
{
    double middle[3], dir[3];

    memcpy(middle, sum->v, sizeof middle);
    normalise(middle);
    dir_of(l, dir);
    return angle_between(middle, dir);
}

/* Lamps of several texels on black: x, y, width, height, and what of light each gives. */
enum { LAMPS = 6 };

static const struct { int x, y, w, h; double share; } lamps[LAMPS] = {
    { 5, 20, 3, 2, 1.0 }, { 33, 25, 2, 4, 0.9 }, { 60, 15, 4, 2, 1.15 }, { 82, 30, 3, 3, 0.85 },
    { 20, 38, 4, 2, 1.1 }, { 50, 5, 5, 2, 0.95 }
};

/* The first few lamps, each turned by `turn` columns. */
static canvas lamp_map(int count, int turn, envsamp_mapping mapping, cell sums[LAMPS])
{
    canvas c = canvas_make(96, 48, 3, 0);
    int i, x, y;
    grid g;

    c.view.mapping = mapping;
    for (i = 0; i < count; i++) {
        double sr = 0.0;

        for (y = 0; y < lamps[i].h; y++)
            sr += row_sr(&c.view, lamps[i].y + y) * (double)lamps[i].w;
        for (x = 0; x < lamps[i].w; x++) {
            const int column = (lamps[i].x + x + turn) % 96;

            canvas_fill(&c, column, lamps[i].y, column + 1, lamps[i].y + lamps[i].h,
                        (float)(lamps[i].share / sr));
        }
    }
    g = grid_make(&c.view);
    for (i = 0; i < count; i++) {
        memset(&sums[i], 0, sizeof sums[i]);
        for (x = 0; x < lamps[i].w; x++) {
            const int column = (lamps[i].x + x + turn) % 96;
            const cell strip = grid_sum(&g, column, lamps[i].y, column + 1,
                                        lamps[i].y + lamps[i].h);

            add_cell(&sums[i], &strip);
        }
    }
    free(g.cells);
    return c;
}

/* Every lamp must have its light. The weights of RELAXED answer for the size of a lamp too, and its
   light is a tenth of a texel from the middle at most. */
static void test_lamps(int method, int count, int turn, envsamp_mapping mapping)
{
    const envsamp_lights_desc desc = ask(method, count);
    double middle = 0.0, energy = 0.0;
    cell sums[LAMPS];
    canvas c = lamp_map(count, turn, mapping, sums);
    light_set s;
    int i, k;

    set_make(&s, &c.view, &desc);
    for (i = 0; i < count; i++) {
        int nearest = 0;

        for (k = 1; k < count; k++)
            nearest = off_middle(&s.lights[k], &sums[i]) < off_middle(&s.lights[nearest], &sums[i])
                    ? k : nearest;
        worst(&middle, off_middle(&s.lights[nearest], &sums[i]));
        worst(&energy, fabs(light_luminance(&s.lights[nearest]) / sums[i].luminance - 1.0));
    }
    CHECK(middle <= (method == RELAXED ? 0.1 * KD_PI / 48.0 : 1e-6)
          && energy <= (method == RELAXED ? 0.05 : 1e-6), "%s, mapping %d: %d "
          "lamps turned by %d columns have their lights, %.1e rad and %.1e of energy off",
          method_names[method], (int)mapping, count, turn, middle, energy);
    set_free(&s);
    free(c.pixels);
}

/* One light stands at the centroid of the map; of RELAXED without rounds. */
static void test_one(void)
{
    int mapping, method;

    for (method = 0; method < METHODS; method++)
        for (mapping = 0; mapping < 3; mapping++) {
            envsamp_lights_desc desc = ask(method, 1);
            canvas c = noise_map(40, 26, 8, 0.3f);
            light_set s;
            double off;
            grid g;

            desc.refine_rounds = -1;
            c.view.mapping = (envsamp_mapping)mapping;
            g = grid_make(&c.view);
            set_make(&s, &c.view, &desc);
            off = off_middle(s.lights, &g.total);
            CHECK(off <= 2e-6, "%s, mapping %d: one light is %.1e "
                  "rad from the centroid", method_names[method], mapping, off);
            set_free(&s);
            free(g.cells);
            free(c.pixels);
        }
}

/* Two lamps of the same energy that end within squares, which shine from their middles: lights are
   within half a square of the centroids, and have the energy. RELAXED looks into bright squares. Of
   an odd number of texels each way, for of an even one all between the middle two are as good. */
static void test_squares(int method, int width)
{
    static const int at[2][4] = { { 101, 77, 104, 84 }, { 422, 177, 429, 180 } };
    const envsamp_lights_desc desc = ask(method, 2);
    const double texel = 2.0 * KD_PI / (double)width;
    canvas c = canvas_make(width, width / 2, 1, 0);
    double middle = 0.0, energy = 0.0;
    cell sums[2];
    light_set s;
    grid g;
    int i, side, swapped;

    for (side = 1; width > 256 * side; )
        side *= 2;
    for (i = 0; i < 2; i++)
        canvas_fill(&c, at[i][0], at[i][1], at[i][2], at[i][3],
                    1.0f / 21.0f / (float)row_sr(&c.view, at[i][1] + 1));
    g = grid_make(&c.view);
    set_make(&s, &c.view, &desc);
    for (i = 0; i < 2; i++)
        sums[i] = grid_sum(&g, at[i][0], at[i][1], at[i][2], at[i][3]);
    swapped = off_middle(s.lights, &sums[1]) < off_middle(s.lights, &sums[0]);
    for (i = 0; i < 2; i++) {
        const envsamp_light *l = &s.lights[i ^ swapped];

        worst(&middle, off_middle(l, &sums[i]) / texel);
        worst(&energy, fabs(light_luminance(l) / sums[i].luminance - 1.0));
    }
    CHECK(middle <= (method == RELAXED ? 0.1 : 0.71 * side) && energy <= (method == RELAXED ? 0.02
          : 1e-6), "%s, %d columns, squares of %d: lights are %.2f texels and %.1e of energy off",
          method_names[method], width, side, middle, energy);
    set_free(&s);
    free(g.cells);
    free(c.pixels);
}

/* One light of a quarter of a map that has squares, of RELAXED without rounds: errors of their
   middles cancel. Those of an octahedral map shine from a texel next to their middles. */
static void test_even_squares(int method, int width, envsamp_mapping mapping)
{
    envsamp_lights_desc desc = ask(method, 1);
    const double texel = 2.0 * KD_PI / (double)width;
    canvas c = canvas_make(width, width / 2, 1, 0);
    light_set s;
    double off;
    grid g;

    desc.refine_rounds = -1;
    c.view.mapping = mapping;
    canvas_fill(&c, width / 7, width / 6, width / 3, width / 4, 1.0f);
    g = grid_make(&c.view);
    set_make(&s, &c.view, &desc);
    off = off_middle(s.lights, &g.total) / texel;
    CHECK(off <= (mapping == ENVSAMP_OCTAHEDRAL ? 1.0 : 0.2), "%s, mapping %d, %d columns: the "
          "middle of many squares is %.3f texels off", method_names[method], (int)mapping, width,
          off);
    set_free(&s);
    free(g.cells);
    free(c.pixels);
}

/* Columns the other way round: the lights of cuts are those of the map in a mirror. */
static void test_mirror(int method, envsamp_mapping mapping)
{
    const envsamp_lights_desc desc = ask(method, 50);
    const int axis = mapping == ENVSAMP_OCTAHEDRAL ? 0 : 1;
    canvas c = noise_map(51, 27, 12, 1.0f), mirrored = canvas_make(51, 27, 3, 0);
    light_set s, other;
    double off = 0.0;
    int x, y, i, k;

    for (y = 0; y < 27; y++)
        for (x = 0; x < 51; x++)
            memcpy(canvas_at(&mirrored, x, y), canvas_at(&c, 50 - x, y), 3 * sizeof(float));
    c.view.mapping = mirrored.view.mapping = mapping;
    set_make(&s, &c.view, &desc);
    set_make(&other, &mirrored.view, &desc);
    for (i = 0; i < 50; i++) {
        double dir[3], least = 4.0;

        dir_of(&s.lights[i], dir);
        dir[axis] = -dir[axis];
        for (k = 0; k < 50; k++) {
            double at[3];

            dir_of(&other.lights[k], at);
            least = fmin(least, distance(dir, at) + fabs(light_luminance(&other.lights[k])
                                                        / light_luminance(&s.lights[i]) - 1.0));
        }
        worst(&off, least);
    }
    CHECK(off <= 2e-6, "%s, mapping %d: a mirrored map has mirrored lights, %.1e off",
          method_names[method], (int)mapping, off);
    set_free(&s);
    set_free(&other);
    free(c.pixels);
    free(mirrored.pixels);
}

/* ---- RELAXED: nearest texels, and weights that are a minimum ---- */

/* Lit texels of nearly the same energy, as few as to be pieces of their own. */
static canvas stars_map(envsamp_mapping mapping, uint64_t seed, int grey)
{
    canvas c = noise_map(40, 26, seed, 0.12f);
    pcg32 random = pcg32_make(seed, 9);
    int x, y, i;

    c.view.mapping = mapping;
    for (y = 0; y < 26; y++)
        for (x = 0; x < 40; x++) {
            float *pixel = canvas_at(&c, x, y);

            for (i = 0; i < 3 && *pixel > 0.0f; i++)
                pixel[i] = grey && i ? *pixel : (0.8f + 0.4f * pcg32_float(&random))
                                                / (float)row_sr(&c.view, y);
        }
    return c;
}

/* What of a map is nearest to each light. */
static void voronoi(const grid *g, const light_set *s, cell *parts)
{
    const int texels = g->view.width * g->view.height;
    int i, k;

    memset(parts, 0, (size_t)s->desc.count * sizeof *parts);
    for (i = 0; i < texels; i++) {
        double best = -2.0, dir[3];
        int at = 0;

        for (k = 0; k < s->desc.count && g->cells[i].luminance > 0.0; k++) {
            dir_of(&s->lights[k], dir);
            if (dot(dir, g->cells[i].v) / g->cells[i].luminance > best) {
                best = dot(dir, g->cells[i].v) / g->cells[i].luminance;
                at = k;
            }
        }
        if (g->cells[i].luminance > 0.0)
            add_cell(&parts[at], &g->cells[i]);
    }
}

/* Gives lights what is nearest to them. */
static void take_sums(light_set *s, const cell *parts)
{
    int i, c;

    for (i = 0; i < s->desc.count; i++)
        for (c = 0; c < 3; c++)
            s->lights[i].irradiance[c] = (float)parts[i].rgb[c];
}

/* Chords from a direction to all of a channel of the map. */
static double chords_to_map(const grid *g, const double dir[3], int channel)
{
    const int texels = g->view.width * g->view.height;
    double sum = 0.0;
    int i, c;

    for (i = 0; i < texels; i++)
        if (g->cells[i].luminance > 0.0) {
            double at[3];

            for (c = 0; c < 3; c++)
                at[c] = g->cells[i].v[c] / g->cells[i].luminance;
            sum += g->cells[i].rgb[channel] * distance(dir, at);
        }
    return sum;
}

static double chords_to_lights(const light_set *s, const double dir[3], int channel)
{
    double sum = 0.0, at[3];
    int k;

    for (k = 0; k < s->desc.count; k++) {
        dir_of(&s->lights[k], at);
        sum += (double)s->lights[k].irradiance[channel] * distance(dir, at);
    }
    return sum;
}

/* How far weights are from the least energy distance for their sum, with none below 0: slopes of
   lights that have light are the lowest of all. */
static double off_minimum(const grid *g, const light_set *s)
{
    double off = 0.0;
    int i, c;

    for (c = 0; c < 3; c++) {
        double low = 1e300, high = -1e300;

        for (i = 0; i < s->desc.count; i++) {
            double dir[3], slope;

            dir_of(&s->lights[i], dir);
            slope = (chords_to_map(g, dir, c) - chords_to_lights(s, dir, c)) / g->total.rgb[c];
            low = fmin(low, slope);
            high = s->lights[i].irradiance[c] > 0.0f ? fmax(high, slope) : high;
            off = s->lights[i].irradiance[c] < 0.0f ? 1.0 : off;
        }
        worst(&off, high - low);
    }
    return off;
}

/* Adds what a light is pulled by something at `at`, or pushed if its weight is below zero; returns
   the weight of what is where the light stands. */
static double add_pull(const double dir[3], const double at[3], double weight, double pull[3])
{
    const double away = distance(dir, at);
    int c;

    for (c = 0; c < 3 && away > 1e-4; c++)
        pull[c] += weight * (at[c] - dir[c]) / away;
    return away > 1e-4 ? 0.0 : weight;
}

/* How far a light is from where the map's pull and the push of the other lights are one, along the
   sphere, relative to the pull of all light at one place. A texel where it stands holds it. */
static double off_rest(const grid *g, const light_set *s, int k)
{
    const int texels = g->view.width * g->view.height;
    double dir[3], at[3], pull[3] = { 0.0, 0.0, 0.0 }, held = 0.0, along;
    int i, c;

    dir_of(&s->lights[k], dir);
    for (i = 0; i < texels; i++) {
        for (c = 0; c < 3 && g->cells[i].luminance > 0.0; c++)
            at[c] = g->cells[i].v[c] / g->cells[i].luminance;
        if (g->cells[i].luminance > 0.0)
            held += add_pull(dir, at, g->cells[i].luminance, pull);
    }
    for (i = 0; i < s->desc.count; i++) {
        dir_of(&s->lights[i], at);
        add_pull(dir, at, -light_luminance(&s->lights[i]), pull);
    }
    along = dot(pull, dir);
    for (c = 0; c < 3; c++)
        pull[c] -= along * dir[c];
    return fmax(sqrt(dot(pull, pull)) - held, 0.0) / g->total.luminance;
}

/* The mean of all lights. */
static double off_rest_after(const grid *g, int rounds)
{
    envsamp_lights_desc desc = ask(RELAXED, 8);
    double off = 0.0;
    light_set s;
    int k;

    desc.refine_rounds = rounds;
    set_make(&s, &g->view, &desc);
    for (k = 0; k < desc.count; k++)
        off += off_rest(g, &s, k) / desc.count;
    set_free(&s);
    return off;
}

static void test_rest(envsamp_mapping mapping, uint64_t seed)
{
    canvas c = stars_map(mapping, seed, 1);
    grid g = grid_make(&c.view);
    const double start = off_rest_after(&g, -1), end = off_rest_after(&g, 1000);

    CHECK(start >= 5e-3 && end <= 3e-5, "RELAXED, mapping %d, %d grey stars: pulls with 1000 "
          "rounds %.1e; control: without %.1e", (int)mapping, g.lit, end, start);
    free(g.cells);
    free(c.pixels);
}

static void test_stars(envsamp_mapping mapping, uint64_t seed)
{
    enum { COUNT = 8 };
    const envsamp_lights_desc desc = ask(RELAXED, COUNT);
    canvas c = stars_map(mapping, seed, 0);
    grid g = grid_make(&c.view);
    double cone = 0.0, minimum, moved;
    cell parts[COUNT];
    light_set s;
    int i, small = 0;

    set_make(&s, &c.view, &desc);
    voronoi(&g, &s, parts);
    for (i = 0; i < COUNT; i++) {
        const double r = sqrt(dot(parts[i].v, parts[i].v)) / parts[i].luminance;

        worst(&cone, fabs((double)s.lights[i].cos_extent - (2.0 * r - 1.0)));
        small += (double)s.lights[i].solid_angle < parts[i].sr * (1.0 - 1e-5);
    }
    CHECK(cone <= 1e-6 && small == 0, "RELAXED, mapping %d, %d stars: cones are %.1e from those of "
          "the nearest, %d are small", (int)mapping, g.lit, cone, small);
    minimum = off_minimum(&g, &s);
    take_sums(&s, parts);
    moved = off_minimum(&g, &s);
    CHECK(minimum <= 1e-6 && moved >= 1e-4, "RELAXED, mapping %d: weights are least, slopes differ "
          "by %.1e; control: sums of the nearest, %.1e", (int)mapping, minimum, moved);
    set_free(&s);
    free(g.cells);
    free(c.pixels);
}

/* A few stars have most blue, so that many lights have none of it. */
static void test_least_weight(envsamp_mapping mapping)
{
    enum { COUNT = 40, MAPS = 4 };
    const envsamp_lights_desc desc = ask(RELAXED, COUNT);
    double minimum = 0.0, control = 1e300, off = 0.0;
    int seed, i, k, none = 0;

    for (seed = 0; seed < MAPS; seed++) {
        canvas c = stars_map(mapping, (uint64_t)(20 + seed), 0);
        pcg32 random = pcg32_make((uint64_t)seed, 11);
        double blue = 0.0;
        light_set s;
        grid g;

        for (i = 0; i < 40 * 26; i++)
            c.pixels[3 * i + 2] *= 2.0f * powf(pcg32_float(&random), 12.0f);
        g = grid_make(&c.view);
        set_make(&s, &c.view, &desc);
        for (k = 0; k < COUNT; k++) {
            none += !(s.lights[k].irradiance[2] > 0.0f);
            blue += (double)s.lights[k].irradiance[2];
        }
        worst(&off, fabs(blue / g.total.rgb[2] - 1.0));
        worst(&minimum, off_minimum(&g, &s));
        for (k = 0; k < COUNT; k++)     /* as if a twentieth of the mean were left to each */
            s.lights[k].irradiance[2] = fmaxf(s.lights[k].irradiance[2],
                                              (float)(0.05 * blue / COUNT));
        control = fmin(control, off_minimum(&g, &s));
        set_free(&s);
        free(g.cells);
        free(c.pixels);
    }
    CHECK(minimum <= 1e-5 && control > 1e-4 && none >= MAPS * 2 && off <= 1e-6, "RELAXED, mapping "
          "%d: %d lights have no blue, slopes differ by %.1e; control: no less than a twentieth of "
          "the mean, %.1e", (int)mapping, none, minimum, control);
}

/* ---- RELAXED: its start ---- */

/* Makes a set that stands at stars. First at the brightest; then always at the one with the most
   share x chord of those nearest to the light for which these sum to most. Control: at the
   brightest. */
static void start_of(const grid *g, light_set *s, int brightest)
{
    const int texels = g->view.width * g->view.height, count = s->desc.count;
    double *work = (double *)kd_allocate((size_t)texels * sizeof *work);
    double *sums = (double *)kd_allocate((size_t)count * sizeof *sums);
    int *near = (int *)kd_allocate((size_t)texels * sizeof *near), i, k, c;

    for (i = 0; i < texels; i++) {
        work[i] = 3.0 * g->cells[i].luminance;
        near[i] = 0;
    }
    for (k = 0; k < count; k++) {
        double at[3], to[3];
        int busy = 0, star = -1;

        memset(sums, 0, (size_t)count * sizeof *sums);
        for (i = 0; i < texels; i++)
            sums[near[i]] += work[i];
        for (i = 0; i < k; i++)
            busy = sums[i] > sums[busy] ? i : busy;
        for (i = 0; i < texels; i++)
            if ((near[i] == busy || brightest) && (star < 0 || work[i] > work[star]))
                star = i;
        memcpy(at, g->cells[star].v, sizeof at);
        normalise(at);
        for (c = 0; c < 3; c++)
            s->lights[k].dir[c] = (float)at[c];
        work[star] = 0.0;
        for (i = 0; i < texels && !brightest; i++) {
            memcpy(to, g->cells[i].v, sizeof to);
            normalise(to);
            if (g->cells[i].luminance * distance(at, to) < work[i]) {
                work[i] = g->cells[i].luminance * distance(at, to);
                near[i] = k;
            }
        }
        near[star] = k;
    }
    free(work);
    free(sums);
    free(near);
}

/* How far lights are from the centroids of what is nearest to such a start, in order. */
static double off_start(const grid *g, const light_set *s, int brightest)
{
    cell *parts = (cell *)kd_allocate((size_t)s->desc.count * sizeof *parts);
    double off = 0.0;
    light_set start;
    int i;

    set_make(&start, &g->view, &s->desc);
    start_of(g, &start, brightest);
    voronoi(g, &start, parts);
    for (i = 0; i < s->desc.count; i++)
        worst(&off, off_middle(&s->lights[i], &parts[i]));
    set_free(&start);
    free(parts);
    return off;
}

static void test_no_rounds(envsamp_mapping mapping, uint64_t seed)
{
    envsamp_lights_desc desc = ask(RELAXED, 8);
    canvas c = stars_map(mapping, seed, 0);
    grid g = grid_make(&c.view);
    double off, control, minimum;
    light_set s, again;

    desc.refine_rounds = -1;
    set_make_over(&s, &c.view, &desc, 0xff);
    set_make_over(&again, &c.view, &desc, 0x11);
    off = off_start(&g, &s, 0);
    control = off_start(&g, &s, 1);
    minimum = off_minimum(&g, &s);
    CHECK(off <= 2e-6 && control > 0.1 && minimum <= 1e-6 && sets_equal(&s, &again), "RELAXED, "
          "mapping %d, no rounds: lights are %.1e rad from the centroids of what is nearest to the "
          "start, slopes differ by %.1e; control: a start at the brightest, %.1e", (int)mapping,
          off, minimum, control);
    set_free(&s);
    set_free(&again);
    free(g.cells);
    free(c.pixels);
}

/* ---- the energy distance ---- */

/* Of a map to itself: it makes the distance 0 where lights are the map. */
static double chords_of_map(const grid *g, int channel)
{
    const int texels = g->view.width * g->view.height;
    double sum = 0.0;
    int i, c;

    for (i = 0; i < texels; i++)
        if (g->cells[i].luminance > 0.0) {
            double at[3];

            for (c = 0; c < 3; c++)
                at[c] = g->cells[i].v[c] / g->cells[i].luminance;
            sum += g->cells[i].rgb[channel] * chords_to_map(g, at, channel);
        }
    return sum;
}

/* Of green, relative to its square; `own`: chords_of_map. */
static double energy_distance(const grid *g, const light_set *s, double own)
{
    double sum = -own, dir[3];
    int i;

    for (i = 0; i < s->desc.count; i++) {
        dir_of(&s->lights[i], dir);
        sum += (double)s->lights[i].irradiance[1] * (2.0 * chords_to_map(g, dir, 1)
                                                     - chords_to_lights(s, dir, 1));
    }
    return sum / (g->total.rgb[1] * g->total.rgb[1]);
}

enum { AS_IT_IS, NO_ROUNDS, NEAREST_SUMS, FROM_HALFTONE, FROM_MEDIAN, FROM_VARIANCE, RIVALS };

static const char *const rival_names[RIVALS] = {
    "itself", "no rounds", "the sums of its nearest texels", "HALFTONE", "MEDIAN_CUT",
    "VARIANCE_CUT"
};

static double rival_distance(const grid *g, int rival, int count, double own)
{
    envsamp_lights_desc desc = ask(RELAXED, count);
    cell *parts = (cell *)kd_allocate((size_t)count * sizeof *parts);
    double found;
    light_set s;

    desc.refine_rounds = rival == NO_ROUNDS ? -1 : 64;
    if (rival >= FROM_HALFTONE)
        desc.method = rival == FROM_HALFTONE ? ENVSAMP_LIGHTS_HALFTONE
                    : rival == FROM_MEDIAN ? ENVSAMP_LIGHTS_MEDIAN_CUT
                    : ENVSAMP_LIGHTS_VARIANCE_CUT;
    set_make(&s, &g->view, &desc);
    voronoi(g, &s, parts);
    if (rival == NEAREST_SUMS)
        take_sums(&s, parts);
    found = energy_distance(g, &s, own);
    free(parts);
    set_free(&s);
    return found;
}

static void test_distance(void)
{
    static const double most[RIVALS] = { 1.0, 0.93, 0.97, 0.5, 0.7, 0.9 };
    static const int least[RIVALS] = { 15, 13, 15, 15, 15, 12 };
    double logs[RIVALS] = { 0.0 };
    int lower[RIVALS] = { 0 }, sets = 0, i, k, rival;
    image map;

    for (i = 0; map_names[i]; i++)
        for (k = 8; k <= 32 && map_make(map_names[i], 48, 24, &map); k *= 2, sets++) {
            const envsamp_image view = kd_image(map.rgb, 48, 24, 3);
            grid g = grid_make(&view);
            const double own = chords_of_map(&g, 1);
            double found[RIVALS];

            for (rival = 0; rival < RIVALS; rival++) {
                found[rival] = rival_distance(&g, rival, k, own);
                logs[rival] += log(found[AS_IT_IS] / found[rival]);
                lower[rival] += found[AS_IT_IS] <= found[rival];
            }
            free(g.cells);
            image_free(&map);
        }
    for (rival = 1; rival < RIVALS; rival++)
        CHECK(exp(logs[rival] / sets) <= most[rival] && lower[rival] >= least[rival],
              "RELAXED: energy distance %.3f of that of %s, lower in %d of %d sets",
              exp(logs[rival] / sets), rival_names[rival], lower[rival], sets);
}

/* ---- RELAXED: round for round ---- */

enum { ROUNDS = 14 };

/* Of the lights of so many rounds. */
static double distance_after(const grid *g, int count, int rounds, double own)
{
    envsamp_lights_desc desc = ask(RELAXED, count);
    double found;
    light_set s;

    desc.refine_rounds = rounds;
    set_make(&s, &g->view, &desc);
    found = energy_distance(g, &s, own);
    set_free(&s);
    return found;
}

/* How often the energy distance rises by more than chords in floats may be off. */
static int rises(const double *found, int count)
{
    int i, times = 0;

    for (i = 1; i < count; i++)
        times += found[i] > found[i - 1] + 1e-7;
    return times;
}

/* Lights sent elsewhere after 24 rounds lower it by more than moves alone. Control: in the other
   order. */
static void test_rounds(envsamp_mapping mapping, int count)
{
    static const int rounds[ROUNDS] = { -1, 1, 2, 3, 4, 8, 16, 24, 28, 32, 40, 64, 128, 256 };
    int seed, i, up = 0, down = 0, sets = 0;
    double lower = 0.0, sent = 0.0;

    for (seed = 0; seed < 5; seed++, sets++) {
        canvas c = stars_map(mapping, (uint64_t)(60 + seed), 1);
        grid g = grid_make(&c.view);
        const double own = chords_of_map(&g, 1);
        double found[ROUNDS], back[ROUNDS];

        for (i = 0; i < ROUNDS; i++)
            back[ROUNDS - 1 - i] = found[i] = distance_after(&g, count, rounds[i], own);
        up += rises(found, ROUNDS);
        down += rises(back, ROUNDS);
        lower += log(found[ROUNDS - 1] / found[0]) / 5.0;
        sent += log(found[ROUNDS - 1] / found[7]) / 5.0;
        free(g.cells);
        free(c.pixels);
    }
    CHECK(up == 0 && down >= 6 * sets && exp(lower) <= 0.95
          && (count != 16 || exp(sent) <= 0.98), "RELAXED, mapping %d, %d lights: the "
          "energy distance rises %d times from round to round in %d sets, ends at %.3f of the "
          "start, %.3f of 24 rounds; control: backward, %d", (int)mapping, count, up, sets,
          exp(lower), exp(sent), down);
}

/* ---- irradiance ---- */

enum { RANDOM_SEEDS = 8, LEVELS = 3, RANDOM = METHODS, UPSIDE_DOWN, WITHOUT_SINE, VARIANTS };

static const char *const variant_names[VARIANTS] = {
    "MEDIAN_CUT", "VARIANCE_CUT", "RELAXED", "RANDOM", "control: rows upside down",
    "control: no sine"
};

/* Mean square over the normals of the relative error of irradiance. */
static double square_error(const irradiance *exact, const light_set *s)
{
    double squares = 0.0;
    int k, i;

    for (k = 0; k < IRRADIANCE_NORMALS; k++) {
        double sum = 0.0, error;

        for (i = 0; i < s->desc.count; i++)
            sum += (double)(envsamp_luminance(s->lights[i].irradiance)
                            * fmaxf(dot3(exact->normals[k], s->lights[i].dir), 0.0f));
        error = sum / exact->exact[k] - 1.0;
        squares += error * error;
    }
    return squares / IRRADIANCE_NORMALS;
}

/* The map as it must not be taken, with the energy that it has. */
static canvas spoiled_map(const image *map, int variant)
{
    canvas c = canvas_make(map->width, map->height, 3, 0);
    const envsamp_image view = kd_image(map->rgb, map->width, map->height, 3);
    grid right = grid_make(&view), wrong;
    int x, y, i;

    for (y = 0; y < map->height; y++)
        for (x = 0; x < map->width; x++)
            for (i = 0; i < 3; i++) {
                const int from = variant == UPSIDE_DOWN ? map->height - 1 - y : y;

                canvas_at(&c, x, y)[i] = map->rgb[3 * (from * map->width + x) + i]
                                       / (variant == WITHOUT_SINE ? (float)row_sr(&view, y) : 1.0f);
            }
    wrong = grid_make(&c.view);
    for (i = 0; i < 3 * map->width * map->height; i++)
        c.pixels[i] *= (float)(right.total.luminance / wrong.total.luminance);
    free(right.cells);
    free(wrong.cells);
    return c;
}

static double variant_error(const image *map, const irradiance *exact, int variant, int count)
{
    const int seeds = variant == RANDOM ? RANDOM_SEEDS : 1;
    canvas c = variant > RANDOM ? spoiled_map(map, variant) : canvas_make(1, 1, 1, 0);
    const envsamp_image view = variant > RANDOM ? c.view
                             : kd_image(map->rgb, map->width, map->height, 3);
    double squares = 0.0;
    int seed;

    for (seed = 0; seed < seeds; seed++) {
        envsamp_lights_desc desc = ask(variant < METHODS ? variant : VARIANCE, count);
        light_set s;

        if (variant == RANDOM)
            desc = ask_other(ENVSAMP_LIGHTS_RANDOM, count, (uint32_t)seed);
        squares += set_make(&s, &view, &desc) ? square_error(exact, &s) : 1e300;
        set_free(&s);
    }
    free(c.pixels);
    return sqrt(squares / seeds);
}

/* Made-up maps and some real ones, without bad pixels. */
static int load_scene(int index, image *map)
{
    int made_up = 0, i;

    while (map_names[made_up])
        made_up++;
    if (index < made_up ? !map_make(map_names[index], 256, 128, map)
                        : index >= made_up + 6 || !real_map(3 * (index - made_up), 2, map))
        return 0;
    for (i = 0; i < 3 * map->width * map->height; i++)
        map->rgb[i] = map->rgb[i] > 0.0f && map->rgb[i] <= FLT_MAX ? map->rgb[i] : 0.0f;
    return 1;
}

/* RMSE, geometric mean over maps: cuts over RANDOM's, RELAXED over MEDIAN_CUT's. */
static void check_errors(double logs[VARIANTS][LEVELS], int maps)
{
    static const double most[VARIANTS] = { 0.3, 0.17, 0.45, 0.0, 0.3, 0.3 };
    int i, level;

    for (i = 0; i < VARIANTS; i++)
        for (level = 0; level < LEVELS && i != RANDOM; level++) {
            const int over = i == RELAXED ? MEDIAN : RANDOM;
            const double ratio = exp((logs[i][level] - logs[over][level]) / maps);

            CHECK((ratio <= most[i]) == (i < METHODS), "%s, %d lights: RMSE of irradiance %.4f, "
                  "%.3f of that of %s", variant_names[i], 16 << level,
                  exp(logs[i][level] / maps), ratio, variant_names[over]);
        }
}

static void test_irradiance(void)
{
    static irradiance exact;
    double logs[VARIANTS][LEVELS] = { { 0.0 } };
    int index, i, level, maps = 0;
    image map;

    for (index = 0; load_scene(index, &map); index++) {
        for (i = 0; i < VARIANTS * LEVELS && (i || irradiance_make(&exact, &map)); i++)
            logs[i / LEVELS][i % LEVELS] += log(variant_error(&map, &exact, i / LEVELS,
                                                              16 << i % LEVELS));
        maps++;
        image_free(&map);
    }
    for (level = 0; level < LEVELS; level++)
        printf("# RANDOM, %d lights: RMSE of irradiance %.4f, %d maps\n", 16 << level,
               exp(logs[RANDOM][level] / maps), maps);
    check_errors(logs, maps);
}

/* ---- turned maps ---- */

static int rising(const void *a, const void *b)
{
    double x, y;

    memcpy(&x, a, sizeof x);
    memcpy(&y, b, sizeof y);
    return (x > y) - (x < y);
}

/* How far the lights of a map, turned, are from the nearest of the turned map, in half angles of
   their cones: the median. */
static double turned_median(const light_set *s, const light_set *turned, double angle)
{
    const int count = s->desc.count;
    double *off = (double *)kd_allocate((size_t)count * sizeof *off), median;
    int i, k;

    for (i = 0; i < count; i++) {
        double dir[3], at[3], x;

        dir_of(&s->lights[i], dir);
        x = cos(angle) * dir[0] - sin(angle) * dir[1];
        dir[1] = sin(angle) * dir[0] + cos(angle) * dir[1];
        dir[0] = x;
        off[i] = 4.0;
        for (k = 0; k < count; k++) {
            dir_of(&turned->lights[k], at);
            off[i] = fmin(off[i], angle_between(dir, at));
        }
        off[i] /= acos(fmin((double)s->lights[i].cos_extent, 1.0 - 1e-9));
    }
    qsort(off, (size_t)count, sizeof *off, rising);
    median = off[count / 2];
    free(off);
    return median;
}

/* A map of separate lights turned by 37 columns: lights turn with it, but only nearly, for cuts see
   the map's edge, and so do the halves that are pieces of RELAXED. Of even maps, such as foliage,
   not even that holds. */
static void test_turned(int method, const char *name)
{
    const envsamp_lights_desc desc = ask(method, 32);
    double found, control;
    light_set s, turned;
    envsamp_image view;
    int x, y;
    image map;
    canvas c;

    if (!map_make(name, 256, 128, &map))
        return;
    view = kd_image(map.rgb, 256, 128, 3);
    c = canvas_make(256, 128, 3, 0);
    for (y = 0; y < 128; y++)
        for (x = 0; x < 256; x++)
            memcpy(canvas_at(&c, (x + 37) % 256, y), map.rgb + 3 * (y * 256 + x),
                   3 * sizeof(float));
    set_make(&s, &view, &desc);
    set_make(&turned, &c.view, &desc);
    found = turned_median(&s, &turned, 37.0 / 128.0 * KD_PI);
    control = turned_median(&s, &turned, 0.0);
    CHECK(found <= 0.6 && control > 0.6, "%s, %s: lights turn with the map, within %.3f of their "
          "cones; control: they do not, %.3f", method_names[method], name, found, control);
    set_free(&s);
    set_free(&turned);
    free(c.pixels);
    image_free(&map);
}

/* ---- interleaved sets ---- */

/* A light toward z, if it is 1 or -1 exactly at a pole, of a cone of `half` radians. */
static envsamp_light light_toward(double z, double azimuth, double half)
{
    const double level = sqrt(fmax(1.0 - z * z, 0.0));
    envsamp_light l;

    memset(&l, 0, sizeof l);
    l.dir[0] = (float)(level * cos(azimuth));
    l.dir[1] = (float)(level * sin(azimuth));
    l.dir[2] = (float)z;
    l.irradiance[0] = 1.0f;
    l.irradiance[1] = 0.25f;
    l.irradiance[2] = 3.0f;
    l.solid_angle = 0.1f;
    l.cos_extent = (float)cos(half);
    l.direct = 5;
    return l;
}

enum { TURNED_LIGHTS = 64 };

/* Over the whole sphere, some near both poles and at them. */
static void lights_about(envsamp_light *lights, double half)
{
    static const double near[6] = { 1.0, -1.0, 1.0 - 1e-12, 1e-12 - 1.0, 0.999999, -0.999999 };
    int i;

    for (i = 0; i < TURNED_LIGHTS; i++)
        lights[i] = light_toward(i < 6 ? near[i] : 1.0 - 2.0 * (i + 0.5) / TURNED_LIGHTS,
                                 2.4 * i, half);
}

/* Where a light lies in the disc about another, on axes of the disc. */
static void place_in_disc(const envsamp_light *about, const envsamp_light *l, double place[2])
{
    double axis[3], dir[3], across[3] = { 0.0, 0.0, 0.0 }, up[3], angle, length;
    int c;

    dir_of(about, axis);
    dir_of(l, dir);
    across[fabs(axis[0]) < 0.5 ? 0 : 1] = 1.0;
    length = dot(across, axis);
    for (c = 0; c < 3; c++)
        across[c] -= length * axis[c];
    normalise(across);
    for (c = 0; c < 3; c++)
        up[c] = axis[(c + 1) % 3] * across[(c + 2) % 3] - axis[(c + 2) % 3] * across[(c + 1) % 3];
    angle = angle_between(axis, dir);
    length = hypot(dot(dir, across), dot(dir, up));
    place[0] = length > 0.0 ? dot(dir, across) / length * angle : 0.0;
    place[1] = length > 0.0 ? dot(dir, up) / length * angle : 0.0;
}

/* How evenly places lie in the unit disc: their mean, the least distance of two of them over the
   spacing, and how far squared radii are from (i + 1/2) / count. */
typedef struct evenness { double mean, nearest, radii; } evenness;

static evenness evenness_of(double (*places)[2], int count)
{
    double *squares = (double *)kd_allocate((size_t)count * sizeof *squares);
    double x = 0.0, y = 0.0;
    evenness e = { 0.0, 9.0, 0.0 };
    int i, k;

    for (i = 0; i < count; i++) {
        x += places[i][0] / count;
        y += places[i][1] / count;
        squares[i] = places[i][0] * places[i][0] + places[i][1] * places[i][1];
        for (k = 0; k < i; k++)
            e.nearest = fmin(e.nearest, hypot(places[i][0] - places[k][0],
                                              places[i][1] - places[k][1]) * sqrt(count));
    }
    e.mean = hypot(x, y) * sqrt(count);
    qsort(squares, (size_t)count, sizeof *squares, rising);
    for (i = 0; i < count; i++)
        worst(&e.radii, fabs(squares[i] - (i + 0.5) / count));
    free(squares);
    return e;
}

static int evenness_good(const evenness *e, int count)
{
    return (count < 5 || e->mean <= 0.5) && (count == 1 || e->nearest >= 1.0) && e->radii <= 2e-3;
}

enum { SPIRAL, SAME_ANGLE, RANDOM_ANGLES, RANDOM_RADII, ONE_SIDE, SPREADS };

static const char *const spread_names[SPREADS] = {
    "sets on a spiral", "control: one azimuth", "control: random azimuths",
    "control: random radii", "control: half of the disc"
};

static void spoil_places(double (*places)[2], int count, int how)
{
    pcg32 random = pcg32_make(3, 5);
    int i;

    for (i = 0; i < count; i++) {
        const double r = hypot(places[i][0], places[i][1]);
        const double u = (double)pcg32_float(&random);
        const double turn = how == SAME_ANGLE ? 1.0 : how == RANDOM_ANGLES ? 2.0 * KD_PI * u
                          : atan2(places[i][1], places[i][0]) * (how == ONE_SIDE ? 0.5 : 1.0);
        const double far = how == RANDOM_RADII ? sqrt(u) : r;

        places[i][0] = far * cos(turn);
        places[i][1] = far * sin(turn);
    }
}

/* All sets of a light together fill its disc evenly. */
static void test_places(double half, float extent, int set_count, int how)
{
    double (*places)[2] = (double (*)[2])kd_allocate((size_t)set_count * sizeof *places);
    envsamp_light lights[TURNED_LIGHTS], out[TURNED_LIGHTS];
    int i, set, good = 0;
    evenness worst_of = { 0.0, 9.0, 0.0 };

    lights_about(lights, half);
    for (i = 0; i < TURNED_LIGHTS; i++) {
        const double radius = acos((double)lights[i].cos_extent) * (double)extent;
        evenness e;

        for (set = 0; set < set_count; set++) {
            envsamp_lights_interleave(lights, TURNED_LIGHTS, set, set_count, extent, 7, out);
            place_in_disc(&lights[i], &out[i], places[set]);
            places[set][0] /= radius;
            places[set][1] /= radius;
        }
        if (how != SPIRAL)
            spoil_places(places, set_count, how);
        e = evenness_of(places, set_count);
        good += evenness_good(&e, set_count);
        worst(&worst_of.mean, e.mean);
        worst(&worst_of.radii, e.radii);
        worst_of.nearest = fmin(worst_of.nearest, e.nearest);
    }
    CHECK((good == TURNED_LIGHTS) == (how == SPIRAL), "%s: %d places within %.2f of %.2f rad, %d "
          "lights of %d even: mean %.2f, nearest %.2f of the spacing, radii %.1e",
          spread_names[how], set_count, (double)extent, half, good, TURNED_LIGHTS, worst_of.mean,
          worst_of.nearest, worst_of.radii);
    free(places);
}

/* Lights of a set take unlike places of their discs; if there is but one set, unlike azimuths. */
static void test_unlike(int set_count)
{
    envsamp_light lights[TURNED_LIGHTS], out[TURNED_LIGHTS];
    double x = 0.0, y = 0.0, square = 0.0;
    int i;

    lights_about(lights, 0.2);
    for (i = 0; i < TURNED_LIGHTS; i++)
        lights[i] = lights[20];
    envsamp_lights_interleave(lights, TURNED_LIGHTS, set_count / 4, set_count, 0.5f, 1, out);
    for (i = 0; i < TURNED_LIGHTS; i++) {
        double place[2];

        place_in_disc(&lights[i], &out[i], place);
        x += place[0] / 0.1 / TURNED_LIGHTS;
        y += place[1] / 0.1 / TURNED_LIGHTS;
        square += (place[0] * place[0] + place[1] * place[1]) / 0.01 / TURNED_LIGHTS;
    }
    CHECK(hypot(x, y) <= 0.25 && fabs(square - 0.5) <= 0.12, "lights of one of %d sets are turned "
          "each its way: mean %.3f, squares %.3f", set_count, hypot(x, y), square);
}

/* Whether nothing but the direction differs, which is a unit vector within the disc. */
static int turned_right(const envsamp_light *l, const envsamp_light *out, double extent)
{
    envsamp_light back = *out;
    double a[3], b[3];
    const double half = acos(fmax(fmin((double)l->cos_extent, 1.0), -1.0));

    memcpy(back.dir, l->dir, sizeof back.dir);
    dir_of(l, a);
    dir_of(out, b);
    return !memcmp(&back, l, sizeof back) && !(judge_light(out, out->direct) & BAD_LENGTH)
        && angle_between(a, b) <= extent * half + 1e-6;
}

/* Lights of a map, in all sets. */
static void test_copies(void)
{
    const envsamp_lights_desc desc = ask(RELAXED, 64);
    const float extents[4] = { 0.0f, 0.1f, 0.7f, 1.0f };
    envsamp_light out[64], again[64];
    light_set s;
    image map;
    int i, set, e, wrong = 0, unmoved = 0, still = 0, aliased = 0;

    if (!map_make("studio", 128, 64, &map))
        return;
    {
        const envsamp_image view = kd_image(map.rgb, 128, 64, 3);

        set_make(&s, &view, &desc);
    }
    for (e = 0; e < 4; e++)
        for (set = 0; set < 9; set++) {
            wrong += envsamp_lights_interleave(s.lights, 64, set, 9, extents[e], 5, out)
                  != ENVSAMP_OK;
            memcpy(again, s.lights, sizeof again);
            envsamp_lights_interleave(again, 64, set, 9, extents[e], 5, again);
            aliased += !memcmp(again, out, sizeof out);
            for (i = 0; i < 64; i++) {
                double a[3], b[3];

                dir_of(&s.lights[i], a);
                dir_of(&out[i], b);
                wrong += !turned_right(&s.lights[i], &out[i], (double)extents[e]);
                unmoved += e > 0 && angle_between(a, b) < 1e-6;
                still += e == 0 && angle_between(a, b) <= 2e-7;
            }
        }
    CHECK(wrong == 0 && unmoved == 0, "sets: %d wrong, %d not turned", wrong, unmoved);
    CHECK(still == 9 * 64, "no extent: %d of %d lights stay", still, 9 * 64);
    CHECK(aliased == 36, "in place: %d of 36 sets are the same", aliased);
    set_free(&s);
    image_free(&map);
}

static int interleaved_differ(int set_a, int set_b, int set_count, uint32_t seed_a,
                              uint32_t seed_b)
{
    envsamp_light lights[TURNED_LIGHTS], a[TURNED_LIGHTS], b[TURNED_LIGHTS];
    int i, differ = 0;

    lights_about(lights, 0.4);
    envsamp_lights_interleave(lights, TURNED_LIGHTS, set_a, set_count, 0.5f, seed_a, a);
    envsamp_lights_interleave(lights, TURNED_LIGHTS, set_b, set_count, 0.5f, seed_b, b);
    for (i = 0; i < TURNED_LIGHTS; i++)
        differ += memcmp(a[i].dir, b[i].dir, sizeof a->dir) != 0;
    return differ;
}

/* Lights at all places with the same cone, turned at most; how many are right. */
static int turn_cones(float cone, envsamp_light *out)
{
    envsamp_light lights[TURNED_LIGHTS];
    int i, right = 0;

    lights_about(lights, 0.1);
    for (i = 0; i < TURNED_LIGHTS; i++)
        lights[i].cos_extent = cone;
    envsamp_lights_interleave(lights, TURNED_LIGHTS, 2, 4, 1.0f, 1, out);
    for (i = 0; i < TURNED_LIGHTS; i++) {
        right += turned_right(&lights[i], &out[i], 1.0);
        out[i].cos_extent = 0.0f;
    }
    return right;
}

/* Any cone, and numbers of sets to the last. Cosines out of range are taken for the nearest. */
static void test_turn_ranges(void)
{
    static const float cones[4] = { -1.0f, 1.0f, 0.0f, 0.99999994f };
    envsamp_light lights[TURNED_LIGHTS], out[TURNED_LIGHTS], ends[2][TURNED_LIGHTS];
    int i, k, right = 0;

    for (k = 0; k < 4; k++)
        right += turn_cones(cones[k], out);
    CHECK(right == 4 * TURNED_LIGHTS, "%d of %d lights of odd cones", right, 4 * TURNED_LIGHTS);
    turn_cones(-1.0f, ends[0]);
    turn_cones(1.0f, ends[1]);
    for (right = 0, k = 0; k < 2; k++) {
        turn_cones(k ? 1.5f : -1.5f, out);
        right += !memcmp(out, ends[k], sizeof out);
        turn_cones(k ? INFINITY : -INFINITY, out);
        right += !memcmp(out, ends[k], sizeof out);
    }
    turn_cones(NAN, out);
    right += !memcmp(out, ends[1], sizeof out);
    CHECK(right == 5, "%d of 5 cosines out of range are taken for the nearest, NaN for 1", right);
    lights_about(lights, 0.4);
    for (right = 0, k = 1; k <= 2; k++) {
        envsamp_lights_interleave(lights, TURNED_LIGHTS, INT_MAX - k, INT_MAX, 0.5f, 9, out);
        for (i = 0; i < TURNED_LIGHTS; i++)
            right += turned_right(&lights[i], &out[i], 0.5);
    }
    CHECK(right == 2 * TURNED_LIGHTS, "%d of %d lights of the most sets", right, 2 * TURNED_LIGHTS);
}

static void test_interleave_arguments(void)
{
    static const struct { int count, set, set_count; float extent; envsamp_result expected; }
    calls[] = {
        { 2, 0, 1, 0.1f, ENVSAMP_OK }, { 0, 0, 1, 0.1f, ENVSAMP_OK }, { 2, 4, 5, 1.0f, ENVSAMP_OK },
        { 2, 0, 5, 0.0f, ENVSAMP_OK }, { -1, 0, 1, 0.1f, ENVSAMP_ERR_PARAM },
        { INT_MIN, 0, 1, 0.1f, ENVSAMP_ERR_PARAM }, { 2, -1, 5, 0.1f, ENVSAMP_ERR_PARAM },
        { 2, 5, 5, 0.1f, ENVSAMP_ERR_PARAM }, { 2, 0, 0, 0.1f, ENVSAMP_ERR_PARAM },
        { 2, 0, -3, 0.1f, ENVSAMP_ERR_PARAM }, { 2, -2, -1, 0.1f, ENVSAMP_ERR_PARAM },
        { 2, 0, 5, -0.1f, ENVSAMP_ERR_PARAM }, { 2, 0, 5, 1.0001f, ENVSAMP_ERR_PARAM },
        { 2, 0, 5, NAN, ENVSAMP_ERR_PARAM }, { 2, 0, 5, INFINITY, ENVSAMP_ERR_PARAM }
    };
    const int number = (int)(sizeof calls / sizeof *calls);
    envsamp_light lights[2], out[2];
    int i, right = 0;

    lights[0] = lights[1] = light_toward(0.3, 1.0, 0.2);
    for (i = 0; i < number; i++)
        right += envsamp_lights_interleave(lights, calls[i].count, calls[i].set,
                                           calls[i].set_count, calls[i].extent, 0, out)
              == calls[i].expected;
    CHECK(right == number, "%d of %d calls are refused or taken rightly", right, number);
    CHECK(IS(envsamp_lights_interleave(NULL, 2, 0, 1, 0.1f, 0, out), ENVSAMP_ERR_NULL)
          && IS(envsamp_lights_interleave(lights, 2, 0, 1, 0.1f, 0, NULL), ENVSAMP_ERR_NULL),
          "no lights, or nowhere to put them");
}

static void test_interleave(void)
{
    int how;

    test_places(0.3, 0.1f, 64, SPIRAL);
    test_places(0.3, 1.0f, 16, SPIRAL);
    test_places(1.5, 0.5f, 9, SPIRAL);
    test_places(0.1, 0.2f, 4, SPIRAL);
    test_places(0.5, 1.0f, 1, SPIRAL);
    test_places(0.5, 0.3f, 200, SPIRAL);
    for (how = SAME_ANGLE; how < SPREADS; how++)
        test_places(0.3, 0.5f, 64, how);
    test_unlike(16);
    test_unlike(1);
    test_copies();
    CHECK(IS(interleaved_differ(0, 1, 4, 5, 5), TURNED_LIGHTS)
          && IS(interleaved_differ(1, 1, 4, 5, 6), TURNED_LIGHTS)
          && IS(interleaved_differ(0, 0, 1, 5, 6), TURNED_LIGHTS)
          && IS(interleaved_differ(2, 2, 4, 5, 5), 0), "sets and seeds differ, a set does not");
    test_turn_ranges();
    test_interleave_arguments();
}

/* ---- few lit texels, many lights ---- */

/* Lit texels of one map, of many colours. */
enum { FEW = 3, CORNERS = 5 };

typedef struct few { int count, at[FEW][2]; double rgb[FEW][3], sr; envsamp_image view; } few;

/* Whether every lit texel has its lights, at its middle, of its colours in all, copies of the same
   and as many as those of others, but one; `texel` becomes that of each light. */
static int shares_evenly(const light_set *s, const few *f)
{
    int made[FEW] = { 0 }, i, k, c, good = 1;
    double sums[FEW][3] = { { 0.0 } }, sr[FEW] = { 0.0 };

    for (k = 0; k < s->desc.count; k++) {
        const envsamp_light *l = &s->lights[k];
        int at = 0;

        for (i = 0; i < f->count; i++) {
            double dir[3], middle[3];

            dir_of(l, dir);
            point_dir(&f->view, f->at[i][0] + 0.5, f->at[i][1] + 0.5, middle);
            at = angle_between(dir, middle) <= 1e-5 ? i + 1 : at;
        }
        if (at == 0)
            return 0;
        made[--at]++;
        sr[at] += (double)l->solid_angle;
        for (c = 0; c < 3; c++)
            sums[at][c] += (double)l->irradiance[c];
    }
    for (i = 0; i < f->count; i++) {
        good &= made[i] >= s->desc.count / f->count && made[i] <= s->desc.count / f->count + 1;
        good &= fabs(sr[i] / row_sr(&f->view, f->at[i][1]) - 1.0) <= 1e-6;
        for (c = 0; c < 3; c++)
            good &= fabs(sums[i][c] - f->rgb[i][c]) <= 1e-6 * f->rgb[i][c];
    }
    for (k = f->count; k < s->desc.count; k++)      /* copies */
        for (i = 0; i < k; i++)
            if (!memcmp(s->lights[i].dir, s->lights[k].dir, sizeof s->lights[k].dir))
                good &= !memcmp(&s->lights[i], &s->lights[k], sizeof s->lights[k]);
    return good;
}

enum { EVEN, TWICE_AS_MUCH, ELSEWHERE, OTHER_COLOURS, SHARE_SPOILS };

/* Few texels of many colours, the third faint, from `first` of those at the corners, at the poles
   and on the seam. */
static canvas few_map(envsamp_mapping mapping, int first, int count, few *f)
{
    static const int at[CORNERS][2] = { { 0, 0 }, { 31, 0 }, { 0, 7 }, { 31, 15 }, { 0, 15 } };
    static const float rgb[FEW][3] = { { 3.0f, 1.0f, 0.0f }, { 0.5f, 0.5f, 9.0f },
                                       { 0.0f, 2e-12f, 4e-11f } };
    canvas c = canvas_make(32, 16, 3, 0);
    int i, k;

    c.view.mapping = mapping;
    f->view = c.view;
    f->count = count;
    canvas_fill(&c, 0, 0, 32, 16, 0.0f);
    for (i = 0; i < count; i++) {
        const int *texel = at[(first + i) % CORNERS];

        memcpy(f->at[i], texel, sizeof f->at[i]);
        memcpy(canvas_at(&c, texel[0], texel[1]), rgb[i], sizeof rgb[i]);
        for (k = 0; k < 3; k++)
            f->rgb[i][k] = (double)rgb[i][k] * row_sr(&c.view, texel[1]);
    }
    return c;
}

/* One, two and three lit texels, 1 to 10 lights. Controls: the last light has twice as much, or
   stands where the next does, or the first has the colours of the second. */
static void test_shares(envsamp_mapping mapping, int how)
{
    static const char *const names[SHARE_SPOILS] = {
        "lit texels share lights", "control: one has twice as much", "control: one is elsewhere",
        "control: other colours"
    };
    int first, texels, count, right = 0, sets = 0;
    verdict v;

    memset(&v, 0, sizeof v);
    for (first = 0; first < CORNERS; first++)
        for (texels = how == EVEN ? 1 : FEW; texels <= FEW; texels++)
            for (count = how == EVEN ? 1 : FEW; count <= 10; count++) {
                const envsamp_lights_desc desc = ask(RELAXED, count);
                few f;
                canvas c = few_map(mapping, first, texels, &f);
                grid g = grid_make(&c.view);
                light_set s;
                int i;

                set_make(&s, &c.view, &desc);
                judge_parts(&s, &g, &v);
                for (i = 0; i < 3; i++) {
                    s.lights[count - 1].irradiance[i] *= how == TWICE_AS_MUCH ? 2.0f : 1.0f;
                    if (how == ELSEWHERE)
                        s.lights[count - 1].dir[i] = s.lights[count % texels].dir[i];
                }
                if (how == OTHER_COLOURS)
                    memcpy(s.lights[0].irradiance, s.lights[1].irradiance,
                           sizeof s.lights[0].irradiance);
                if (count >= texels) {
                    right += shares_evenly(&s, &f);
                    sets++;
                }
                set_free(&s);
                free(g.cells);
                free(c.pixels);
            }
    CHECK(verdict_good(&v) && right == (how == EVEN ? sets : 0), "RELAXED, mapping %d: %s, %d of "
          "%d sets", (int)mapping, names[how], right, sets);
}

/* Lights near a texel, within its half diagonal and some rounding: their luminance. */
static double luminance_near(const light_set *s, int x, int y, const envsamp_image *view)
{
    double middle[3], corner[3], dir[3], sum = 0.0;
    int i;

    point_dir(view, x + 0.5, y + 0.5, middle);
    point_dir(view, x, y + 1.0, corner);
    for (i = 0; i < s->desc.count; i++) {
        dir_of(&s->lights[i], dir);
        if (angle_between(dir, middle) <= angle_between(middle, corner) + 1e-5)
            sum += light_luminance(&s->lights[i]);
    }
    return sum;
}

/* Lights of a few lit texels stand at them, however many there are, and have their energy. `floor`:
   what shines elsewhere, which has lights of its own with RELAXED, by sums of floats. */
static void test_few(int method, int texels, int count, float floor)
{
    static const int at[3][2] = { { 10, 5 }, { 40, 20 }, { 25, 16 } };
    const envsamp_lights_desc desc = ask(method, count);
    canvas c = canvas_make(64, 32, 3, 0);
    double off = 0.0;
    light_set s;
    verdict v;
    grid g;
    int i, dark = 0;

    memset(&v, 0, sizeof v);
    canvas_fill(&c, 0, 0, 64, 32, floor);
    for (i = 0; i < texels; i++)
        canvas_fill(&c, at[i][0], at[i][1], at[i][0] + 1, at[i][1] + 1, 3.0f + (float)i);
    g = grid_make(&c.view);
    set_make(&s, &c.view, &desc);
    judge_parts(&s, &g, &v);
    for (i = 0; i < texels; i++) {
        const cell lit = grid_sum(&g, at[i][0], at[i][1], at[i][0] + 1, at[i][1] + 1);

        worst(&off, fabs(luminance_near(&s, at[i][0], at[i][1], &c.view) - lit.luminance)
                    / g.total.luminance);
    }
    for (i = 0; i < count; i++)
        dark += !(light_luminance(&s.lights[i]) > 1e-6 * g.total.luminance / count);
    CHECK(verdict_good(&v) && off <= (method == RELAXED && floor > 0.0f ? 2e-7 * count : 1e-6)
          && (dark == 0 || (method == RELAXED && floor > 0.0f)), "%s, %d lights of "
          "%d texels, %g elsewhere: %.1e of the energy is elsewhere, %d lights are dark",
          method_names[method], count, texels, (double)floor, off, dark);
    set_free(&s);
    free(g.cells);
    free(c.pixels);
}

/* RELAXED gives the lights of HALFTONE beyond 16384 lights. */
static void test_most_lights(void)
{
    int i, right = 0;

    for (i = 0; i < 2; i++) {
        canvas c = noise_map(512, 256, 6, 1.0f);
        const envsamp_lights_desc desc = ask(RELAXED, 16384 + i);
        light_set s;

        set_make(&s, &c.view, &desc);
        right += s.result == ENVSAMP_OK && fell_back(&s, &c.view) == i;
        set_free(&s);
        free(c.pixels);
    }
    CHECK(IS(right, 2), "RELAXED makes 16384 lights, and not one more");
}

/* Patterns that leave much to chance: ties everywhere. */
static void test_patterns(void)
{
    int method, i, k, x;

    for (method = 0; method < METHODS; method++) {
        verdict v;

        memset(&v, 0, sizeof v);
        for (i = 0; i < 3; i++) {
            canvas c = canvas_make(64, 32, 1, 0);

            for (x = 0; x < 64 * 32; x++)
                c.pixels[x] = i == 0 ? 2.0f : i == 1 ? (float)((x + x / 64) & 1)
                            : (float)(x % 64 == 0 || x % 64 == 63);
            for (k = 0; k < COUNTS; k++) {
                c.view.mapping = (envsamp_mapping)((i + k) % 3);
                judge_view(&c.view, method, counts[k], &v);
            }
            free(c.pixels);
        }
        check_verdict("constant, checkerboard, two columns", method, &v);
    }
}

/* ---- the same again, and what does not matter ---- */

static void test_same(int method)
{
    const envsamp_lights_desc desc = ask(method, 40);
    envsamp_lights_desc other = desc;
    light_set a, b, c, d;
    envsamp_image view;
    image map;

    if (!map_make("foliage", 100, 50, &map))
        return;
    view = kd_image(map.rgb, 100, 50, 3);
    set_make_over(&a, &view, &desc, 0);
    set_make_over(&b, &view, &desc, 0xff);
    other.percentile = other.lambda = other.gamma = other.mask_scale = -1e3f;
    other.weight_variance = other.weight_extent = other.weight_energy = 1e3f;
    other.strict = 1;
    set_make(&c, &view, &other);
    other.seed = 1;
    set_make(&d, &view, &other);
    CHECK(sets_equal(&a, &b) && sets_equal(&a, &c), "%s: the same bytes, whatever was in scratch "
          "and in the fields for DECOMPOSED", method_names[method]);
    CHECK(sets_equal(&a, &d), "%s: a seed is ignored", method_names[method]);
    set_free(&a);
    set_free(&b);
    set_free(&c);
    set_free(&d);
    image_free(&map);
}

/* ---- arguments ---- */

static void test_bad_pixels(int method)
{
    envsamp_lights_desc desc = ask(method, 5);
    canvas c = noise_map(20, 10, 2, 1.0f);
    light_set s;

    canvas_at(&c, 3, 3)[0] = NAN;
    canvas_at(&c, 4, 7)[1] = -1.0f;
    canvas_at(&c, 19, 9)[2] = INFINITY;
    set_make(&s, &c.view, &desc);
    CHECK(s.result == ENVSAMP_OK && s.info.bad_pixel_count == 3, "%s: three bad pixels",
          method_names[method]);
    set_free(&s);
    desc.strict = 1;
    set_make(&s, &c.view, &desc);
    CHECK(s.result == ENVSAMP_ERR_VALUE && set_intact(&s), "%s: strict", method_names[method]);
    set_free(&s);
    canvas_fill(&c, 0, 0, 20, 10, -2.0f);
    desc.strict = 0;
    set_make(&s, &c.view, &desc);
    CHECK(s.result == ENVSAMP_ERR_BLACK && set_intact(&s), "%s: negative everywhere",
          method_names[method]);
    set_free(&s);
    canvas_fill(&c, 0, 0, 20, 10, 0.0f);
    set_make(&s, &c.view, &desc);
    CHECK(s.result == ENVSAMP_ERR_BLACK && set_intact(&s), "%s: black", method_names[method]);
    set_free(&s);
    free(c.pixels);
}

/* What sizes and lights say of a count and of rounds. */
static envsamp_result said(int method, int count, int rounds)
{
    envsamp_lights_desc desc = ask(method, count);
    envsamp_sizes sizes = { 77, 77 };
    canvas c = noise_map(6, 3, 1, 1.0f);
    kd_guarded scratch = kd_guarded_make(1 << 18, RUBBISH);
    envsamp_light lights[4];
    envsamp_result first, result;
    int agree;

    desc.refine_rounds = rounds;
    first = envsamp_lights_sizes(&c.view, &desc, &sizes);
    result = envsamp_lights(&c.view, &desc, lights, 4, scratch.buffer, NULL);
    agree = (first == result || (count == 0 && result == ENVSAMP_ERR_MEMORY))
         && kd_guarded_intact(&scratch) && sizes.table_bytes == 0
         && (sizes.scratch_bytes > 0) == (first == ENVSAMP_OK);
    free(scratch.block);
    free(c.pixels);
    return agree ? result : ENVSAMP_ERR_SIZE;
}

static void test_numbers(int method)
{
    static const int counts_wrong[3] = { -1, INT_MIN, 65537 };
    int i, refused = 0;

    CHECK(said(method, 4, 64) == ENVSAMP_OK && said(method, 1, 0) == ENVSAMP_OK
          && said(method, 4, INT_MAX) == ENVSAMP_OK && said(method, 4, -1) == ENVSAMP_OK
          && said(method, 4, INT_MIN) == ENVSAMP_OK && said(method, 0, 0) == ENVSAMP_ERR_MEMORY,
          "%s: counts and rounds that are right", method_names[method]);
    for (i = 0; i < 3; i++)
        refused += said(method, counts_wrong[i], 64) == ENVSAMP_ERR_PARAM;
    CHECK(refused == 3, "%s: %d of 3 counts are refused", method_names[method], refused);
}

/* set_make gives just the bytes and the capacity asked for: here, what happens with less. */
static void test_memory(int method)
{
    const envsamp_lights_desc desc = ask(method, 9);
    canvas c = noise_map(33, 17, 1, 1.0f);
    envsamp_buffer less, none = { NULL, 1 << 20 };
    envsamp_image view = c.view;
    light_set s;
    int i, right = 0;

    set_make(&s, &c.view, &desc);
    less = s.scratch.buffer;
    less.bytes--;
    CHECK(s.result == ENVSAMP_OK && set_intact(&s)
          && envsamp_lights(&view, &desc, s.lights, 9, less, NULL) == ENVSAMP_ERR_MEMORY,
          "%s: enough scratch, and a byte less", method_names[method]);
    for (i = 1; i < ENVSAMP_ALIGN; i++) {
        less.data = (char *)s.scratch.buffer.data + i;
        less.bytes = s.scratch.buffer.bytes;
        right += envsamp_lights(&view, &desc, s.lights, 9, less, NULL) == ENVSAMP_ERR_ALIGN;
    }
    CHECK(right == ENVSAMP_ALIGN - 1
          && envsamp_lights(&view, &desc, s.lights, 8, s.scratch.buffer, NULL)
          == ENVSAMP_ERR_MEMORY && envsamp_lights(&view, &desc, s.lights, INT_MIN,
                                                  s.scratch.buffer, NULL) == ENVSAMP_ERR_MEMORY
          && set_intact(&s), "%s: %d of 7 shifts not aligned; too little capacity",
          method_names[method], right);
    view.pixels = NULL;
    CHECK(envsamp_lights(&view, &desc, s.lights, 9, s.scratch.buffer, NULL) == ENVSAMP_ERR_NULL
          && envsamp_lights(&c.view, &desc, NULL, 9, s.scratch.buffer, NULL) == ENVSAMP_ERR_NULL
          && envsamp_lights(&c.view, &desc, s.lights, 9, none, NULL) == ENVSAMP_ERR_NULL
          && envsamp_lights(NULL, &desc, s.lights, 9, s.scratch.buffer, NULL) == ENVSAMP_ERR_NULL,
          "%s: no pixels, lights, scratch or image", method_names[method]);
    set_free(&s);
    free(c.pixels);
}

/* Bytes, or infinitely many if sizes fail. */
static double scratch_of(const envsamp_image *view, envsamp_lights_method method, int count)
{
    const envsamp_lights_desc desc = ask_other(method, count, 0);
    envsamp_sizes sizes;

    return envsamp_lights_sizes(view, &desc, &sizes) ? HUGE_VAL : (double)sizes.scratch_bytes;
}

/* Tighter than the header says: cuts 4 MB, 2 for maps twice as wide as high, and 104 bytes a light,
   but no more than 6 or 3 MB and 56 bytes a light; RELAXED 1 MB, 7 KB a light, of these 4 MB at
   most, and 200 bytes a light, beside what HALFTONE takes. Both 16 bytes a column and 24 a row.
   DECOMPOSED: these, 2 MB and 5 bytes a texel. A tenth more is allowed. */
static void test_scratch(void)
{
    static const int shapes[6][3] = { { 1, 1, 1 }, { 2048, 1024, 32 }, { 8192, 4096, 64 },
                                      { 4096, 4096, 1024 }, { 1024, 512, 128 },
                                      { 65535, 65535, 65536 } };
    int i, right = 0;

    for (i = 0; i < 6; i++) {
        const envsamp_image view = kd_image(NULL, shapes[i][0], shapes[i][1], 3);
        const double count = (double)shapes[i][2], mega = 1048576.0;
        const double texels = (double)shapes[i][0] * (double)shapes[i][1];
        const double sides = 16.0 * shapes[i][0] + 24.0 * shapes[i][1];
        const double part = shapes[i][0] > shapes[i][1] ? 0.5 : 1.0;
        const double cuts = fmin(part * 4.0 * mega + 104.0 * count,
                                 part * 6.0 * mega + 56.0 * count) + sides;
        const double relaxed = fmin(7168.0 * count, 4.0 * mega) + mega + 200.0 * count + sides
                             + scratch_of(&view, ENVSAMP_LIGHTS_HALFTONE, shapes[i][2]);

        right += scratch_of(&view, ENVSAMP_LIGHTS_VARIANCE_CUT, shapes[i][2]) <= 1.1 * cuts;
        right += scratch_of(&view, ENVSAMP_LIGHTS_RELAXED, shapes[i][2]) <= 1.1 * relaxed;
        right += scratch_of(&view, ENVSAMP_LIGHTS_DECOMPOSED, shapes[i][2])
              <= 1.1 * (cuts + relaxed + 2.0 * mega + 5.0 * texels);
    }
    CHECK(right == 18, "%d of 18 scratch sizes are as small as said", right);
    for (i = right = 0; i <= ENVSAMP_LIGHTS_RANDOM; i++) {
        const envsamp_image view = kd_image(NULL, 1024, 512, 3);

        right += scratch_of(&view, (envsamp_lights_method)i, 32) <= 24.0 * 1024.0 * 512.0;
    }
    CHECK(right == 6, "%d of 6 methods take 24 bytes a texel at most, at 1024x512", right);
}

static void test_arguments(void)
{
    int method;

    for (method = 0; method < METHODS; method++) {
        test_same(method);
        test_bad_pixels(method);
        test_numbers(method);
        test_memory(method);
    }
    test_scratch();
}

static void test_where(void)
{
    int method, i;

    test_one();
    for (i = 0; i < 3; i++)
        for (method = 0; method < METHODS; method++) {
            const envsamp_mapping mapping = (envsamp_mapping)i;

            test_lamps(method, 2, 0, mapping);
            if (method != MEDIAN)
                test_lamps(method, LAMPS, 0, mapping);
            if (method != MEDIAN && mapping == ENVSAMP_LATLONG) {
                test_lamps(method, LAMPS, 10, mapping);
                test_lamps(method, LAMPS, 29, mapping);
            }
            if (method != RELAXED)
                test_mirror(method, mapping);
        }
    for (method = 0; method < METHODS; method++) {
        test_squares(method, 512);
        test_squares(method, 699);
        test_squares(method, 1024);
        test_squares(method, 3001);
        for (i = 0; i < 3; i++)
            test_even_squares(method, 1000, (envsamp_mapping)i);
    }
    for (i = 0; i < 9; i++) {
        test_stars((envsamp_mapping)(i % 3), (uint64_t)(20 + i));
        test_rest((envsamp_mapping)(i % 3), (uint64_t)(20 + i));
        test_no_rounds((envsamp_mapping)(i % 3), (uint64_t)(20 + i));
    }
    for (i = 0; i < 3; i++)
        test_least_weight((envsamp_mapping)i);
}

static void test_few_texels(void)
{
    int method, texels, count, i, how;

    for (method = 0; method < METHODS; method++) {
        for (texels = 1; texels <= 3; texels += 2)
            for (count = 5; count <= 64; count += 59)
                test_few(method, texels, count, 0.0f);
        test_few(method, 1, 1, 0.0f);
        test_few(method, 1, 16, 1e-12f);
    }
    for (i = 0; i < 3; i++)
        for (how = 0; how < SHARE_SPOILS; how++)
            test_shares((envsamp_mapping)i, how);
    test_patterns();
}

int main(int argc, char **argv)
{
    int method, count;

    if (argc < 2 || strcmp(argv[1], "quick") != 0)
        test_most_lights();
    test_maps();
    test_shapes();
    test_many_pieces();
    test_opposite();
    test_values();
    test_judge();
    test_cuts();
    test_sparse_cuts();
    test_spread();
    test_equal();
    test_where();
    test_distance();
    for (method = 0; method < 3; method++)
        for (count = 4; count <= 64; count *= 4)
            test_rounds((envsamp_mapping)method, count);
    test_irradiance();
    for (method = 0; method < METHODS; method++) {
        test_turned(method, "studio");
        test_turned(method, "night");
    }
    test_interleave();
    test_few_texels();
    test_arguments();
    return check_done();
}
