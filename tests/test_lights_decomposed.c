/* test_lights_decomposed.c: lights of DECOMPOSED, and the mask of emissive texels. Thresholds,
 * numbers of lights, masking, k-means and the cuts of the rest are made again by brute force over
 * the texels.
 */
#include "check.h"

#include "../envsamp.h"

#include "decomposed_reference.h"
#include "statistics.h"
#include "../examples/common/maps.h"

#include <limits.h>

static const char *const mapping_names[3] = { "lat-long", "hemisphere", "octahedral" };

/* Only texels brighter than a share of the brightest are emissive. */
static envsamp_lights_desc ask_above(int count, float gamma)
{
    envsamp_lights_desc desc = ask(count);

    desc.percentile = desc.lambda = -1.0f;
    desc.gamma = gamma;
    return desc;
}

enum { FIELDS = 7 };

static float *field_of(envsamp_lights_desc *desc, int field)
{
    float *const fields[FIELDS] = { &desc->percentile, &desc->lambda, &desc->gamma,
                                    &desc->mask_scale, &desc->weight_variance,
                                    &desc->weight_extent, &desc->weight_energy };

    return fields[field];
}

/* Faint noise and lamps of up to 2 x 2 texels, none near a pole: brighter than 17. */
static canvas lamp_map(int lamps, uint64_t seed, float faint, envsamp_mapping mapping)
{
    canvas c = noise_map(64, 32, seed, 1.0f);
    pcg32 random = pcg32_make(seed, 11);
    int i, k, x, y;

    c.view.mapping = mapping;
    for (i = 0; i < 64 * 32 * 3; i++)
        c.pixels[i] *= faint;
    for (i = 0; i < lamps; i++) {
        const int left = (int)(62.0f * pcg32_float(&random));
        const int top = 8 + (int)(16.0f * pcg32_float(&random));
        const int right = left + 1 + (pcg32_float(&random) < 0.5f);
        const int end = top + 1 + (pcg32_float(&random) < 0.5f);

        for (y = top; y < end; y++)
            for (x = left; x < right; x++)
                for (k = 0; k < 3; k++)
                    canvas_at(&c, x, y)[k] = 100.0f + 100.0f * pcg32_float(&random);
    }
    return c;
}

/* ---- masks ---- */

/* How many masks are wrong, or left to rounding. */
typedef struct mask_tally { int calls, thresholds, masks, left; } mask_tally;

static int mask_right(const envsamp_image *view, const uint8_t *mask, float threshold)
{
    int x, y, right = 1;

    for (y = 0; y < view->height; y++)
        for (x = 0; x < view->width; x++)
            right &= mask[(size_t)y * (size_t)view->width + (size_t)x]
                  == (texel_luminance(view, x, y) > threshold);
    return right;
}

static void tally_mask(const envsamp_image *view, const ranking *r,
                       const envsamp_lights_desc *desc, mask_tally *t)
{
    const float low = ranked_threshold(r, desc, -1e-12), high = ranked_threshold(r, desc, 1e-12);
    const kd_guarded block = kd_guarded_make((size_t)r->count, 0x5a);
    uint8_t *mask = (uint8_t *)block.buffer.data;
    float threshold = -1.0f;
    const envsamp_result result = mask_make(view, desc, RUBBISH, mask, &threshold);

    t->calls++;
    t->left += low < high;
    t->thresholds += result || (memcmp(&threshold, &low, sizeof low)
                                && memcmp(&threshold, &high, sizeof high));
    t->masks += result || !kd_guarded_intact(&block) || !mask_right(view, mask, threshold);
    free(block.block);
}

static const float knobs[][3] = {       /* percentile, lambda, gamma; -1 is 0 */
    { -1.0f, -1.0f, -1.0f }, { 0.02f, -1.0f, -1.0f }, { 0.5f, -1.0f, -1.0f },
    { 0.98f, -1.0f, -1.0f },
    { 0.999999f, -1.0f, -1.0f }, { 1.0f, -1.0f, -1.0f }, { 0.98f, 3.0f, 0.001f },
    { -1.0f, 3.0f, -1.0f }, { -1.0f, -1.0f, 0.5f }, { 0.3f, 1.5f, 0.01f }, { 0.98f, 1e9f, -1.0f },
    { 0.5f, -1.0f, 2.0f }, { 0.5f, FLT_MAX, FLT_MAX }
};

enum { KNOBS = (int)(sizeof knobs / sizeof *knobs) };

static envsamp_lights_desc ask_knobs(int count, int k)
{
    envsamp_lights_desc desc = ask(count);

    desc.percentile = knobs[k][0];
    desc.lambda = knobs[k][1];
    desc.gamma = knobs[k][2];
    return desc;
}

static void tally_knobs(const envsamp_image *view, mask_tally *t)
{
    ranking r = ranking_make(view);
    int k;

    for (k = 0; k < KNOBS; k++) {
        const envsamp_lights_desc desc = ask_knobs(7, k);

        tally_mask(view, &r, &desc, t);
    }
    free(r.texels);
}

static void check_masks(const char *name, const mask_tally *t)
{
    CHECK(t->calls > 0 && t->thresholds == 0 && t->masks == 0 && t->left * 10 <= t->calls,
          "%s: of %d masks %d have another threshold than a sort, %d are no masks of it, %d are "
          "left to rounding", name, t->calls, t->thresholds, t->masks, t->left);
}

static void test_masks(void)
{
    int i, layout, mapping;
    image map;

    for (i = 0; map_names[i]; i++) {
        mask_tally t = { 0, 0, 0, 0 };

        if (!strcmp(map_names[i], "constant") || !map_make(map_names[i], 96, 48, &map))
            continue;
        for (layout = 0; layout < LAYOUTS; layout++)
            for (mapping = 0; mapping < 3; mapping++) {
                canvas c = canvas_of(&map, layout);

                c.view.mapping = (envsamp_mapping)mapping;
                tally_knobs(&c.view, &t);
                free(c.pixels);
            }
        check_masks(map_names[i], &t);
        image_free(&map);
    }
}

static void test_real_masks(void)
{
    int i, real = 0;
    image map;

    for (i = 0; i < REAL_MAP_COUNT; i++)
        if (real_map(i, 1, &map)) {
            canvas c = canvas_of(&map, i % LAYOUTS);
            mask_tally t = { 0, 0, 0, 0 };

            c.view.mapping = (envsamp_mapping)(i % 3);
            tally_knobs(&c.view, &t);
            check_masks(real_map_name(i), &t);
            free(c.pixels);
            image_free(&map);
            real++;
        }
    if (!real)
        CHECK_SKIP("no real maps in data/");
}

/* Noise times a value, with one texel of another. */
typedef struct odd_map { const char *name; float value, one; } odd_map;

static const odd_map odd_maps[] = {
    { "the largest floats", FLT_MAX, FLT_MAX }, { "large floats", FLT_MAX / 16, FLT_MAX },
    { "one of the largest", 1.0f, FLT_MAX },
    { "denormals", 1e-40f, 1e-39f }, { "the least floats", 1e-42f, 1e-42f },
    { "NaN", 1.0f, NAN }, { "infinity", 1.0f, INFINITY }, { "negative", 1.0f, -3.0f },
    { "one lit texel", 0.0f, 5.0f }, { "a sun of 1e9", 1.0f, 1e9f }
};

enum { ODD_MAPS = (int)(sizeof odd_maps / sizeof *odd_maps) };

static canvas odd_make(const odd_map *odd, int channels)
{
    canvas c = canvas_make(40, 20, channels, 0);
    pcg32 random = pcg32_make(5, 6);
    int i;

    for (i = 0; i < 40 * 20 * channels; i++)
        c.pixels[i] = odd->value * (0.5f + 0.5f * pcg32_float(&random));
    canvas_at(&c, 11, 7)[channels / 2] = odd->one;
    return c;
}

static void test_odd_masks(void)
{
    int i, channels;

    for (i = 0; i < ODD_MAPS; i++) {
        mask_tally t = { 0, 0, 0, 0 };

        for (channels = 1; channels <= 4; channels += channels == 1 ? 2 : 1) {
            canvas c = odd_make(&odd_maps[i], channels);

            c.view.mapping = (envsamp_mapping)(channels % 3);
            tally_knobs(&c.view, &t);
            free(c.pixels);
        }
        check_masks(odd_maps[i].name, &t);
    }
}

/* All texels are as bright as L_b, if that is asked for, else brighter than 0. */
static void test_constant_mask(void)
{
    canvas c = canvas_make(16, 8, 1, 0);
    int k, i, right = 0;

    canvas_fill(&c, 0, 0, 16, 8, 2.0f);
    for (k = 0; k < KNOBS; k++) {
        const envsamp_lights_desc desc = ask_knobs(1, k);
        const int all = knobs[k][0] <= 0.0f && knobs[k][1] < 1.0f && knobs[k][2] < 1.0f;
        uint8_t mask[128];
        float threshold;
        int set = 0;

        right += mask_make(&c.view, &desc, RUBBISH, mask, &threshold) == ENVSAMP_OK;
        for (i = 0; i < 128; i++)
            set += mask[i] == 1;
        right += set == (all ? 128 : 0) && (threshold < 2.0f) == all;
    }
    CHECK(right == 2 * KNOBS, "constant map: %d of %d masks are full or empty", right, 2 * KNOBS);
    free(c.pixels);
}

/* ---- energy: maps x mappings x layouts x counts ---- */

enum { COUNTS = 11 };

static const int counts[COUNTS] = { 1, 2, 3, 16, 32, 64, 127, 129, 256, 1000, 1024 };

static void test_map(const char *name, const image *map, int most)
{
    direct_tally t;
    int layout, mapping, k;

    memset(&t, 0, sizeof t);
    for (layout = 0; layout < LAYOUTS; layout++)
        for (mapping = 0; mapping < 3; mapping++) {
            const envsamp_lights_desc any = ask(1);
            canvas c = canvas_of(map, layout);
            emission e;

            c.view.mapping = (envsamp_mapping)mapping;
            e = emission_make(&c.view, &any);
            for (k = 0; k < COUNTS && counts[k] <= most; k++) {
                const envsamp_lights_desc desc = ask(counts[k]);

                if ((k + mapping) % LAYOUTS == layout)
                    judge(&e, &desc, &t);
            }
            emission_free(&e);
            free(c.pixels);
        }
    check_tally(name, &t);
}

static void test_maps(void)
{
    int i;
    image map;

    for (i = 0; map_names[i]; i++)
        if (map_make(map_names[i], 128, 64, &map)) {
            test_map(map_names[i], &map, 1024);
            image_free(&map);
        }
    for (i = 0; i < REAL_MAP_COUNT; i++)
        if (real_map(i, 4, &map)) {
            test_map(real_map_name(i), &map, i % 6 ? 256 : 1024);
            image_free(&map);
        }
}

/* Real maps at full size, with other seeds. */
static void test_real(void)
{
    int i, k, seed, real = 0;
    image map;

    for (i = 0; i < REAL_MAP_COUNT; i++)
        if (real_map(i, 1, &map)) {
            const envsamp_image view = kd_image(map.rgb, map.width, map.height, 3);
            envsamp_lights_desc desc = ask(1);
            emission e = emission_make(&view, &desc);
            direct_tally t;

            memset(&t, 0, sizeof t);
            for (k = 16; k <= 64; k *= 2)
                for (seed = 0; seed < 3; seed++) {
                    desc = ask(k);
                    desc.seed = (uint32_t)(seed * 977);
                    judge(&e, &desc, &t);
                }
            check_tally(real_map_name(i), &t);
            emission_free(&e);
            image_free(&map);
            real++;
        }
    if (!real)
        CHECK_SKIP("no real maps in data/");
}

static void judge_view(const envsamp_image *view, const envsamp_lights_desc *desc,
                       direct_tally *t)
{
    emission e = emission_make(view, desc);

    judge(&e, desc, t);
    emission_free(&e);
}

static void test_shapes(void)
{
    static const int shapes[][2] = {
        { 1, 1 }, { 1, 2 }, { 2, 1 }, { 1, 77 }, { 300, 1 }, { 3, 5 }, { 33, 17 }, { 257, 3 },
        { 515, 13 }, { 65535, 1 }, { 1, 65535 }
    };
    direct_tally t;
    int i, k;

    memset(&t, 0, sizeof t);
    for (i = 0; i < (int)(sizeof shapes / sizeof *shapes); i++) {
        canvas c = noise_map(shapes[i][0], shapes[i][1], 7, 1.0f);
        const int texels = shapes[i][0] * shapes[i][1];

        canvas_at(&c, shapes[i][0] / 2, shapes[i][1] / 2)[1] = 100.0f;
        for (k = 0; k < COUNTS; k += texels > 5000 ? 5 : 1) {
            const envsamp_lights_desc desc = ask_knobs(counts[k], k % 3 ? 6 : texels > 999 ? 8 : 0);

            c.view.mapping = (envsamp_mapping)((i + k) % 3);
            judge_view(&c.view, &desc, &t);
        }
        free(c.pixels);
    }
    check_tally("odd shapes", &t);
}

static void test_values(void)
{
    int i, k;

    for (i = 1; i < ODD_MAPS; i++) {    /* a light of FLT_MAX times 4 pi is none */
        canvas c = odd_make(&odd_maps[i], 3);
        direct_tally t;

        memset(&t, 0, sizeof t);
        for (k = 0; k < COUNTS; k++) {
            const envsamp_lights_desc desc = ask_knobs(counts[k], (k + i) % 10);

            c.view.mapping = (envsamp_mapping)(k % 3);
            judge_view(&c.view, &desc, &t);
        }
        check_tally(odd_maps[i].name, &t);
        free(c.pixels);
    }
}

/* ---- what the judges must reject ---- */

enum { SOUND, BRIGHT, ASIDE, SHARED, DIM, OTHER_THRESHOLD, ONE_LESS, SPOILS };

static const char *const spoil_names[SPOILS] = {
    "as they are", "an EnvDirect takes of another", "half a texel aside", "two on one texel",
    "an EnvDirect called none", "another threshold", "one EnvDirect less"
};

static void spoil(light_set *s, const emission *e, int how)
{
    envsamp_light *l = s->lights;
    int c;

    for (c = 0; c < 3 && how == BRIGHT; c++) {
        l[0].irradiance[c] += 0.9f * l[1].irradiance[c];
        l[1].irradiance[c] *= 0.1f;
    }
    if (how == ASIDE) {
        const int at = texel_under(e, l), width = e->g.view.width;
        double dir[3];

        point_dir(&e->g.view, (double)(at % width) + 1.0, (double)(at / width) + 0.5, dir);
        for (c = 0; c < 3; c++)
            l[0].dir[c] = (float)dir[c];
    }
    if (how == SHARED)
        memcpy(l[1].dir, l[0].dir, sizeof l[0].dir);
    l[0].direct = how != DIM;
    s->info.threshold *= how == OTHER_THRESHOLD ? 1.000001f : 1.0f;
    s->info.direct_count -= how == ONE_LESS ? 2 : 0;
}

static void test_judge(void)
{
    const envsamp_lights_desc desc = ask_above(16, 0.1f);
    canvas c = lamp_map(30, 1, 0.01f, ENVSAMP_LATLONG);
    emission e = emission_make(&c.view, &desc);
    int how;

    for (how = 0; how < SPOILS; how++) {
        direct_tally t;
        light_set s;

        memset(&t, 0, sizeof t);
        set_make(&s, &c.view, &desc);
        spoil(&s, &e, how);
        judge_made(&s, &e, &t);
        CHECK(tally_good(&t) == (how == SOUND), "%s: %s", how == SOUND ? "lights" : "control",
              spoil_names[how]);
        set_free(&s);
    }
    emission_free(&e);
    free(c.pixels);
}

/* ---- lights made again ---- */

static const float cut_weights[][3] = {
    { 1.0f, 5.0f, 1.0f }, { 1.0f, 0.0f, 0.0f }, { 0.0f, 0.0f, 1.0f }, { 0.0f, 1.0f, 2.0f }
};

static void set_weights(envsamp_lights_desc *desc, int k)
{
    desc->weight_variance = cut_weights[k][0];
    desc->weight_extent = cut_weights[k][1];
    desc->weight_energy = cut_weights[k][2];
}

/* Emissive texels are taken out, above a share of the brightest: 1 takes none. */
static void remake_view(const envsamp_image *view, float gamma, remake *r)
{
    static const int wanted[6] = { 1, 2, 3, 7, 32, 65 };
    envsamp_lights_desc desc = ask_above(1, gamma);
    emission e = emission_make(view, &desc);
    int k, i;

    for (k = 0; k < 6; k++)
        for (i = 0; i < 4; i++) {
            light_set s;

            desc.count = wanted[k];
            desc.mask_scale = -1.0f;
            set_weights(&desc, i);
            set_make(&s, view, &desc);
            if (s.info.direct_count == 0)
                memset(e.mask, 0, (size_t)view->width * (size_t)view->height);
            remake_indirects(&s, &e, e.mask, r);
            set_free(&s);
            mask_make(view, &desc, RUBBISH, e.mask, NULL);
        }
    emission_free(&e);
}

static void test_halves(void)
{
    static const int sides[5][2] = { { 64, 32 }, { 40, 26 }, { 33, 17 }, { 1, 90 }, { 50, 2 } };
    static const float lit[3] = { 1.0f, 0.3f, 0.02f };
    int mapping, i, k;

    for (mapping = 0; mapping < 3; mapping++)
        for (k = 0; k < 3; k++) {
            remake r;

            memset(&r, 0, sizeof r);
            for (i = 0; i < 5; i++) {
                canvas c = noise_map(sides[i][0], sides[i][1], (uint64_t)(50 + i), lit[k]);

                c.view.mapping = (envsamp_mapping)mapping;
                canvas_fill(&c, 0, 0, 1, 1, 1.4f);
                remake_view(&c.view, 1.0f, &r);
                remake_view(&c.view, 0.9f, &r);
                free(c.pixels);
            }
            CHECK(r.sets > 0 && r.indirects == 0 && r.left * 10 <= r.sets, "%s, %g of 1 lit: %d "
                  "of %d EnvIndirects are not halves by brute force, %d of %d sets left to "
                  "rounding", mapping_names[mapping], (double)lit[k], r.indirects, r.lights,
                  r.left, r.sets);
        }
}

/* The largest map whose squares are single texels. */
static void test_large_halves(void)
{
    canvas c = noise_map(256, 256, 8, 1.0f);
    envsamp_lights_desc desc = ask_above(40, 1.0f);
    emission e;
    light_set s;
    remake r;

    memset(&r, 0, sizeof r);
    c.view.mapping = ENVSAMP_OCTAHEDRAL;
    e = emission_make(&c.view, &desc);
    set_make(&s, &c.view, &desc);
    remake_indirects(&s, &e, e.mask, &r);
    CHECK(r.indirects == 0 && r.left == 0, "256 x 256: %d of %d lights are not halves by brute "
          "force", r.indirects, r.lights);
    set_free(&s);
    emission_free(&e);
    free(c.pixels);
}

/* Every emissive texel is a piece of its own. */
static void test_swarm(int rounds)
{
    static const int wanted[3] = { 12, 24, 48 };
    static const float scales[3] = { 0.15f, 0.05f, -1.0f };
    int given_back = 0, mapping, seed, k;
    remake r;

    memset(&r, 0, sizeof r);
    for (mapping = 0; mapping < 3; mapping++)
        for (seed = 0; seed < 12; seed++) {
            canvas c = lamp_map(20 + 2 * seed, (uint64_t)seed, seed % 2 ? 3.0f : 0.01f,
                                (envsamp_mapping)mapping);
            envsamp_lights_desc desc = ask_above(1, 0.1f);
            emission e = emission_make(&c.view, &desc);

            for (k = 0; k < 3; k++) {
                desc.count = wanted[k];
                desc.seed = (uint32_t)(3 * seed + k);
                desc.mask_scale = scales[(seed + k) % 3];
                desc.refine_rounds = rounds;
                remake_set(&e, &desc, &r);
            }
            given_back += r.given_back > 0;
            emission_free(&e);
            free(c.pixels);
        }
    CHECK(r.directs == 0 && r.indirects == 0 && r.left * 4 <= r.sets && given_back > 0, "%d rounds "
          "of k-means: of %d lights %d EnvDirects and %d EnvIndirects are not those by brute "
          "force; %d of %d sets left to rounding, %d texels given back", rounds, r.lights,
          r.directs, r.indirects, r.left, r.sets, r.given_back);
}

/* ---- masking ---- */

/* Whether the lights of a set without rounds, in the order in which they were drawn, are apart
   until all emissive texels are near one of them. */
static int apart(const light_set *s, const emission *e, double near, int *ended)
{
    int at[MOST_LIGHTS], i, j, k;

    *ended = 0;
    for (k = 0; k < s->info.direct_count && k < MOST_LIGHTS; k++) {
        int close = 0, left = 0;

        at[k] = texel_under(e, &s->lights[k]);
        for (j = 0; at[k] >= 0 && j < k; j++)
            close |= dot(e->dir[at[k]], e->dir[at[j]]) >= near;
        if (!close)
            continue;
        for (i = 0; i < e->count; i++) {
            int covered = 0;

            for (j = 0; j < k; j++)
                covered |= dot(e->dir[e->texel[i]], e->dir[at[j]]) >= near;
            left += !covered;
        }
        *ended = left == 0;
        return left == 0;
    }
    return 1;
}

/* A map eight times as wide and high, each texel of the first one of 64, the others faint: the
   library looks at squares of such maps. */
static canvas enlarged(canvas c)
{
    const int width = c.view.width, height = c.view.height;
    canvas large = canvas_make(8 * width, 8 * height, 3, 0);
    int x, y;

    canvas_fill(&large, 0, 0, 8 * width, 8 * height, 0.01f);
    for (y = 0; y < height; y++)
        for (x = 0; x < width; x++)
            memcpy(canvas_at(&large, 8 * x + 7 * (x % 2), 8 * y + 7 * (y % 2)),
                   canvas_at(&c, x, y), 3 * sizeof *c.pixels);
    large.view.mapping = c.view.mapping;
    free(c.pixels);
    return large;
}

/* Controls: a cone of twice the angle, and sets without masking. */
static void test_masking(void)
{
    int sets = 0, kept = 0, ended = 0, wider = 0, unmasked = 0, seed, end;

    for (seed = 0; seed < 60; seed++) {
        canvas c = lamp_map(40, (uint64_t)(seed / 6), 0.01f, (envsamp_mapping)(seed % 3));
        envsamp_lights_desc desc = ask_above(16 + seed % 24, 0.1f);
        double near;
        emission e;
        light_set s;

        c = seed % 5 == 2 ? enlarged(c) : c;
        e = emission_make(&c.view, &desc);
        desc.refine_rounds = -1;
        desc.seed = (uint32_t)seed;
        desc.mask_scale = seed % 4 == 3 ? 0.6f : 0.15f;
        near = near_cosine(&desc);
        set_make(&s, &c.view, &desc);
        kept += apart(&s, &e, near, &end);
        ended += end;
        wider += apart(&s, &e, 2.0 * near * near - 1.0, &end);
        sets++;
        set_free(&s);
        desc.mask_scale = -1.0f;
        set_make(&s, &c.view, &desc);
        unmasked += apart(&s, &e, near, &end);
        set_free(&s);
        emission_free(&e);
        free(c.pixels);
    }
    CHECK(kept == sets && ended > 5 && ended < sets - 5, "EnvDirects are apart in %d of %d sets, "
          "in %d till all is masked", kept, sets, ended);
    CHECK(wider < sets / 2 && unmasked < sets / 2, "control: twice as far apart in %d, apart "
          "without masking in %d", wider, unmasked);
}

/* Two bright lamps of a texel, one at the edge of the other's cone, in a square of 4 x 4 whose
   middle is outside; a faint one far away, which must be the second of two EnvDirects. */
static void test_edge(void)
{
    static const int other[4][2] = { { 136, 128 }, { 67, 128 }, { 100, 164 }, { 100, 95 } };
    envsamp_lights_desc desc = ask_above(3, 0.01f);
    int i, seed, right = 0;

    desc.refine_rounds = -1;
    for (i = 0; i < 4; i++) {
        canvas c = canvas_make(512, 256, 1, 0);
        const int x = i == 1 ? 103 : 100, y = i == 3 ? 131 : 128;

        canvas_fill(&c, 0, 0, 512, 256, 1e-5f);
        *canvas_at(&c, x, y) = *canvas_at(&c, i < 2 ? other[i][0] : x, other[i][1]) = 100.0f;
        *canvas_at(&c, 400, 128) = 10.0f;
        for (seed = 0; seed < 8; seed++) {
            light_set s;

            desc.seed = (uint32_t)seed;
            set_make(&s, &c.view, &desc);
            right += s.info.direct_count == 2
                  && (s.lights[0].dir[1] < -0.9f) + (s.lights[1].dir[1] < -0.9f) == 1;
            set_free(&s);
        }
        free(c.pixels);
    }
    CHECK(right == 32, "lamps at the edge of a masked cone: %d of 32 sets have but one", right);
}

/* ---- draws ---- */

enum { DRAWS = 20000, SPOTS = 8 };

/* Eight lamps of one texel, some of them near one another. On the wide map the library looks at
   squares of 4 by 4 texels: three lamps are in one, and two in another. */
static canvas spot_map(int wide)
{
    static const int at[2][SPOTS][2] = {
        { { 1, 2 }, { 2, 2 }, { 4, 3 }, { 6, 4 }, { 7, 3 }, { 10, 5 }, { 13, 3 }, { 13, 4 } },
        { { 40, 1 }, { 43, 2 }, { 41, 3 }, { 200, 4 }, { 202, 6 }, { 300, 3 }, { 304, 3 },
          { 450, 5 } }
    };
    canvas c = canvas_make(wide ? 512 : 16, 8, 1, 0);
    int i;

    canvas_fill(&c, 0, 0, c.view.width, 8, 0.01f);
    for (i = 0; i < SPOTS; i++)
        *canvas_at(&c, at[wide][i][0], at[wide][i][1]) = (float)(60 + 13 * (i * 5 % 8));
    return c;
}

/* How often each pair of lamps has the first two lights of K = 3, or each lamp the one of K = 2. */
static int count_draws(const emission *e, int count, double *hits)
{
    envsamp_lights_desc desc = ask_above(count, 0.1f);
    envsamp_light lights[3];
    envsamp_lights_info info;
    envsamp_sizes sizes;
    kd_guarded scratch;
    int i, k, wrong = 0;

    desc.refine_rounds = -1;
    envsamp_lights_sizes(&e->g.view, &desc, &sizes);
    scratch = kd_guarded_make(sizes.scratch_bytes, RUBBISH);
    for (i = 0; i < DRAWS; i++) {
        int at[2] = { 0, 0 };

        desc.seed = (uint32_t)i;
        wrong += envsamp_lights(&e->g.view, &desc, lights, 3, scratch.buffer, &info) != ENVSAMP_OK
              || info.direct_count != count - 1;
        for (k = 0; k < count - 1; k++) {
            const int texel = texel_under(e, &lights[k]);

            while (at[k] < SPOTS - 1 && e->texel[at[k]] != texel)
                at[k]++;
        }
        hits[at[0] * SPOTS + at[1]] += 1.0;
    }
    free(scratch.block);
    return wrong;
}

enum { BY_LIGHT, BY_LUMINANCE, EVEN, NO_MASK, WIDE_MASK, DRAW_KINDS };

static const char *const draw_names[DRAW_KINDS] = {
    "by light", "control: by luminance", "control: evenly", "control: nothing masked",
    "control: twice the angle masked"
};

static double spot_mass(const emission *e, int i, int kind)
{
    const int texel = e->texel[i];

    return kind == EVEN ? 1.0 : kind == BY_LUMINANCE ? (double)e->luminance[texel]
                                                     : e->g.cells[texel].luminance;
}

/* Shares of all pairs. */
static void expect_pairs(const emission *e, int kind, double *expected)
{
    const double near = 1.0 - 2.0 * 0.15 / 3.0;
    const double bound = kind == NO_MASK ? 1.0 - 1e-9
                                         : kind == WIDE_MASK ? 2.0 * near * near - 1.0 : near;
    int a, b;

    for (a = 0; a < SPOTS; a++) {
        double total = 0.0;

        for (b = 0; b < SPOTS; b++) {
            const int free_still = dot(e->dir[e->texel[a]], e->dir[e->texel[b]]) < bound;

            expected[a * SPOTS + b] = free_still ? spot_mass(e, b, kind) : 0.0;
            total += expected[a * SPOTS + b];
        }
        for (b = 0; b < SPOTS; b++)
            expected[a * SPOTS + b] *= spot_mass(e, a, kind) / total;
    }
}

static void test_draws(int wide)
{
    const envsamp_lights_desc desc = ask_above(3, 0.1f);
    const char *where = wide ? "in squares" : "on texels";
    double first[SPOTS * SPOTS], pairs[SPOTS * SPOTS], expected[SPOTS * SPOTS];
    canvas c = spot_map(wide);
    emission e = emission_make(&c.view, &desc);
    int kind, i;

    memset(first, 0, sizeof first);
    memset(pairs, 0, sizeof pairs);
    CHECK(e.count == SPOTS && count_draws(&e, 2, first) == 0 && count_draws(&e, 3, pairs) == 0,
          "one and two EnvDirects %s for %d seeds", where, DRAWS);
    for (kind = BY_LIGHT; kind <= EVEN; kind++) {
        stat_result result;

        memset(expected, 0, sizeof expected);
        for (i = 0; i < SPOTS; i++)
            expected[i * SPOTS] = spot_mass(&e, i, kind);
        result = stat_chi2_test(expected, first, SPOTS * SPOTS, NULL);
        CHECK(result.pass == (kind == BY_LIGHT), "one EnvDirect %s, %s: %s, p = %.2g", where,
              draw_names[kind], stat_verdict_string(result.verdict), result.p);
    }
    for (kind = BY_LIGHT; kind < DRAW_KINDS; kind++) {
        stat_result result;

        expect_pairs(&e, kind, expected);
        result = stat_chi2_test(expected, pairs, SPOTS * SPOTS, NULL);
        CHECK(result.pass == (kind == BY_LIGHT), "two EnvDirects %s, %s: %s, p = %.2g", where,
              draw_names[kind], stat_verdict_string(result.verdict), result.p);
    }
    emission_free(&e);
    free(c.pixels);
}

/* Three equal lamps on either side of the map: after one of each all are masked, two each are left,
   and the next two are of one side in a third of the cases, as nothing is masked any more. */
static void test_unmasked(void)
{
    enum { SEEDS = 3000 };
    const double known[2] = { 1.0, 2.0 }, wrong[2] = { 1.0, 1.0 };
    envsamp_lights_desc desc = ask_above(5, 0.1f);
    double hits[2] = { 0.0, 0.0 };
    canvas c = canvas_make(16, 8, 1, 0);
    stat_result result, control;
    int i, apart_first = 0;

    canvas_fill(&c, 0, 0, 16, 8, 0.01f);
    canvas_fill(&c, 1, 3, 4, 4, 100.0f);
    canvas_fill(&c, 9, 3, 12, 4, 100.0f);
    desc.mask_scale = 1.25f;
    desc.refine_rounds = -1;
    for (i = 0; i < SEEDS; i++) {
        light_set s;

        desc.seed = (uint32_t)i;
        set_make(&s, &c.view, &desc);
        apart_first += s.info.direct_count == 4 && s.lights[0].dir[1] * s.lights[1].dir[1] < 0.0f;
        hits[s.lights[2].dir[1] * s.lights[3].dir[1] < 0.0f] += 1.0;
        set_free(&s);
    }
    result = stat_chi2_test(known, hits, 2, NULL);
    control = stat_chi2_test(wrong, hits, 2, NULL);
    CHECK(apart_first == SEEDS && result.pass && !control.pass, "two sides: first one of each in "
          "%d of %d; then twice one in %g: %s, p = %.2g; control p = %.2g", apart_first,
          (int)SEEDS, hits[0], stat_verdict_string(result.verdict), result.p, control.p);
    free(c.pixels);
}

/* ---- k-means on larger lamps ---- */

/* Sum over emissive texels of light x squared distance to the nearest EnvDirect. */
static double scatter(const light_set *s, const emission *e)
{
    double sum = 0.0;
    int i, k;

    for (i = 0; i < e->count; i++) {
        double least = 4.0, dir[3];

        for (k = 0; k < s->info.direct_count; k++) {
            dir_of(&s->lights[k], dir);
            least = fmin(least, 2.0 - 2.0 * dot(dir, e->dir[e->texel[i]]));
        }
        sum += least * e->g.cells[e->texel[i]].luminance;
    }
    return sum;
}

static void test_scatter(void)
{
    static const int rounds[4] = { -1, 1, 64, INT_MAX };
    double sum[4] = { 0.0, 0.0, 0.0, 0.0 };
    int i, k, seed;
    image map;

    for (i = 0; map_names[i]; i++)
        for (seed = 0; seed < 6 && map_make(map_names[i], 128, 64, &map); seed++) {
            const envsamp_image view = kd_image(map.rgb, 128, 64, 3);
            envsamp_lights_desc desc = ask(48);
            emission e = emission_make(&view, &desc);
            double unit = 0.0;

            for (k = 0; k < 4; k++) {
                light_set s;

                desc.refine_rounds = rounds[k];
                desc.seed = (uint32_t)seed;
                set_make(&s, &view, &desc);
                unit = k ? unit : fmax(scatter(&s, &e), 1e-300);
                sum[k] += scatter(&s, &e) / unit;
                set_free(&s);
            }
            emission_free(&e);
            image_free(&map);
        }
    CHECK(sum[1] < 0.98 * sum[0] && sum[2] < 0.92 * sum[0] && sum[2] < sum[1]
          && sum[3] <= sum[2] * 1.001, "k-means brings emissive texels nearer to EnvDirects: %.3f "
          "after one round, %.3f after 64, %.3f after no end of them", sum[1] / sum[0],
          sum[2] / sum[0], sum[3] / sum[0]);
}

/* ---- turns ---- */

enum { MIRRORED, TURNED, UPSIDE_DOWN, AS_IT_IS, TURNS };

static const char *const turn_names[TURNS] = { "mirrored", "by half a turn", "upside down",
                                               "control: not at all" };

/* Whether b holds the light of a, turned. */
static int has_turned(const light_set *b, const envsamp_light *l, int turn)
{
    const float signs[TURNS][3] = { { 1.0f, -1.0f, 1.0f }, { -1.0f, -1.0f, 1.0f },
                                    { 1.0f, 1.0f, -1.0f }, { 1.0f, 1.0f, 1.0f } };
    int i, c;

    for (i = b->info.direct_count; i < b->desc.count; i++) {
        const envsamp_light *m = &b->lights[i];
        int same = fabs((double)(l->cos_extent - m->cos_extent)) <= 1e-6
                && fabs((double)(l->solid_angle / m->solid_angle) - 1.0) <= 1e-5;

        for (c = 0; c < 3; c++)
            same &= fabs((double)(l->dir[c] - signs[turn][c] * m->dir[c])) <= 1e-6
                 && fabs((double)(l->irradiance[c] / m->irradiance[c]) - 1.0) <= 1e-5;
        if (same)
            return 1;
    }
    return 0;
}

static canvas turn_map(const canvas *from, int turn)
{
    const int width = from->view.width, height = from->view.height;
    canvas c = canvas_make(width, height, 3, 0);
    int x, y;

    for (y = 0; y < height; y++)
        for (x = 0; x < width; x++) {
            const int column = turn == MIRRORED ? width - 1 - x : (x + width / 2) % width;
            const int row = turn == UPSIDE_DOWN ? height - 1 - y : y;

            memcpy(canvas_at(&c, turn == UPSIDE_DOWN ? x : column, row), canvas_at(from, x, y),
                   3 * sizeof *c.pixels);
        }
    return c;
}

/* Without masking no texel is given back, so that the rest of the map is the same. */
static void test_turns(void)
{
    envsamp_lights_desc desc = ask_above(64, 0.1f);
    canvas c = lamp_map(20, 3, 3.0f, ENVSAMP_LATLONG);
    int turn, i;

    desc.mask_scale = -1.0f;
    for (turn = 0; turn < TURNS; turn++) {
        canvas turned = turn_map(&c, turn == AS_IT_IS ? TURNED : turn);
        int found = 0, wanted;
        light_set a, b;

        set_make(&a, &c.view, &desc);
        set_make(&b, &turned.view, &desc);
        wanted = desc.count - a.info.direct_count;
        for (i = a.info.direct_count; i < desc.count; i++)
            found += has_turned(&b, &a.lights[i], turn);
        CHECK(wanted > 10 && b.info.direct_count == a.info.direct_count
              && (found == wanted) == (turn != AS_IT_IS), "%s: %d of %d EnvIndirects are turned "
              "too", turn_names[turn], found, wanted);
        set_free(&a);
        set_free(&b);
        free(turned.pixels);
    }
    free(c.pixels);
}

/* ---- what makes a difference, and what must not ---- */

enum { SAME_ALL, SAME_INDIRECTS = 1, SAME_DIRECTS = 2, SAME_NONE = 3 };

/* Which lights two descriptions do not share: bits of the above, EnvDirects first. */
static int differences(const envsamp_image *view, const envsamp_lights_desc *a,
                       const envsamp_lights_desc *b)
{
    light_set s, t;
    int directs, differ;

    set_make(&s, view, a);
    set_make(&t, view, b);
    directs = s.info.direct_count;
    differ = memcmp(s.lights, t.lights, (size_t)directs * sizeof *s.lights) ? SAME_INDIRECTS : 0;
    if (memcmp(s.lights + directs, t.lights + directs,
               (size_t)(a->count - directs) * sizeof *s.lights))
        differ |= SAME_DIRECTS;
    if (s.result || t.result || t.info.direct_count != directs)
        differ = -1;
    set_free(&s);
    set_free(&t);
    return differ;
}

static void check_difference(const char *name, const envsamp_lights_desc *changed, int expected)
{
    canvas c = lamp_map(40, 5, 3.0f, ENVSAMP_LATLONG);
    const envsamp_lights_desc desc = ask_above(48, 0.1f);
    const int differ = differences(&c.view, &desc, changed);

    CHECK((differ | (expected & SAME_DIRECTS)) == expected && differ >= 0, "%s: EnvDirects %s, "
          "EnvIndirects %s", name, differ & 1 ? "differ" : "stay", differ & 2 ? "differ" : "stay");
    free(c.pixels);
}

/* Where EnvDirects differ, EnvIndirects may: they get what is given back. */
static void test_differences(void)
{
    enum { STRICT, SCALED, CUT, SEED, ROUNDS, UNMASKED, MASKED, ENDLESS, KINDS };
    static const struct { const char *name; int expected; } kinds[KINDS] = {
        { "strict", SAME_ALL }, { "weights twice as large", SAME_ALL },
        { "other weights", SAME_DIRECTS }, { "another seed", SAME_NONE },
        { "no rounds", SAME_NONE }, { "nothing masked", SAME_NONE }, { "more masked", SAME_NONE },
        { "no end of rounds", SAME_ALL }
    };
    int k, i;

    for (k = 0; k < KINDS; k++) {
        envsamp_lights_desc desc = ask_above(48, 0.1f);

        desc.strict = k == STRICT;
        desc.seed = k == SEED;
        desc.refine_rounds = k == ROUNDS ? -1 : k == ENDLESS ? INT_MAX : desc.refine_rounds;
        desc.mask_scale = k == UNMASKED ? -1.0f : k == MASKED ? 0.3f : desc.mask_scale;
        for (i = 4; i < 7 && k == SCALED; i++)
            *field_of(&desc, i) *= 2.0f;
        for (i = 1; i < 4 && k == CUT; i++) {
            set_weights(&desc, i);
            check_difference(kinds[k].name, &desc, kinds[k].expected);
        }
        check_difference(kinds[k].name, &desc, kinds[k].expected);
    }
}

/* The same bytes, whatever was in scratch. */
static void test_same(void)
{
    static const int rubbish[4] = { 0x00, 0xff, 0x7f, 0xc3 };
    int i, k, same = 0, sets = 0;
    image map;

    for (i = 0; map_names[i]; i++)
        for (k = 0; k < 4 && map_make(map_names[i], 96, 48, &map); k++) {
            const envsamp_image view = kd_image(map.rgb, 96, 48, 3);
            const envsamp_lights_desc desc = ask(k % 2 ? 32 : 200);
            uint8_t masks[2][96 * 48];
            float thresholds[2];
            light_set a, b;

            set_make(&a, &view, &desc);
            set_make_over(&b, &view, &desc, rubbish[k]);
            mask_make(&view, &desc, 0x11, masks[0], &thresholds[0]);
            mask_make(&view, &desc, rubbish[k], masks[1], &thresholds[1]);
            same += a.result == ENVSAMP_OK && sets_equal(&a, &b)
                 && !memcmp(&a.info, &b.info, sizeof a.info)
                 && !memcmp(masks[0], masks[1], sizeof masks[0])
                 && !memcmp(&thresholds[0], &thresholds[1], sizeof thresholds[0]);
            sets++;
            set_free(&a);
            set_free(&b);
            image_free(&map);
        }
    CHECK(same == sets && sets > 0, "%d of %d sets and masks are the same over other rubbish",
          same, sets);
}

/* ---- odd maps ---- */

static void test_no_emissive(void)
{
    canvas c = canvas_make(64, 32, 3, 0);
    direct_tally t;
    int k;

    memset(&t, 0, sizeof t);
    canvas_fill(&c, 0, 0, 64, 32, 0.7f);
    for (k = 0; k < COUNTS; k++) {
        const envsamp_lights_desc desc = ask(counts[k]);

        c.view.mapping = (envsamp_mapping)(k % 3);
        judge_view(&c.view, &desc, &t);
    }
    CHECK(tally_good(&t) && IS(t.directs, 0), "constant map: no EnvDirects");
    check_tally("constant map", &t);
    free(c.pixels);
}

/* All that is lit is emissive: more texels than lights, and fewer. */
static void test_all_emissive(void)
{
    static const int wanted[8] = { 1, 2, 30, 60, 200, 1000, 4000, 65536 };
    int lit, k;

    for (lit = 0; lit < 3; lit++) {
        canvas c = noise_map(40, 26, 3, lit == 0 ? 0.0f : lit == 1 ? 0.05f : 1.0f);
        direct_tally t;
        int directs = 0;

        canvas_at(&c, 9, 9)[1] = 1.0f;
        memset(&t, 0, sizeof t);
        for (k = 0; k < 8; k++) {
            const envsamp_lights_desc desc = ask_above(wanted[k], 0.0f);

            c.view.mapping = (envsamp_mapping)(k % 3);
            judge_view(&c.view, &desc, &t);
            directs += wanted[k];
        }
        check_tally("only emissive texels", &t);
        CHECK(t.directs == directs, "all of %d lights are EnvDirects", directs);
        free(c.pixels);
    }
}

/* Lights that share a texel share its energy as evenly as may be. */
static void test_shared(void)
{
    const envsamp_lights_desc desc = ask_above(64, 0.0f);
    const int at[3] = { 20, 23, 41 };
    canvas c = canvas_make(8, 6, 1, 0);
    int copies[3] = { 0, 0, 0 }, wrong = 0, i, k;
    light_set s;
    grid g;

    for (i = 0; i < 3; i++)
        c.pixels[at[i]] = 1.0f + (float)i;
    g = grid_make(&c.view);
    set_make(&s, &c.view, &desc);
    for (i = 0; i < 64; i++)
        for (k = 0; k < 3; k++) {
            const cell *texel = &g.cells[at[k]];
            double dir[3] = { 0.0, 0.0, 0.0 }, light;

            dir_of(&s.lights[i], dir);
            if (dot(dir, texel->v) < texel->luminance * 0.9999)
                continue;
            light = texel->luminance / (double)s.lights[i].irradiance[0];
            copies[k]++;
            wrong += (fabs(light / 21.0 - 1.0) > 1e-5 && fabs(light / 22.0 - 1.0) > 1e-5)
                  || fabs(light * (double)s.lights[i].solid_angle / texel->sr - 1.0) > 1e-5;
        }
    CHECK(s.result == ENVSAMP_OK && wrong == 0 && copies[0] + copies[1] + copies[2] == 64
          && abs(copies[0] - copies[1]) <= 1 && abs(copies[1] - copies[2]) <= 1
          && abs(copies[0] - copies[2]) <= 1, "64 lights on three texels: %d, %d and %d, %d of "
          "them wrong", copies[0], copies[1], copies[2], wrong);
    set_free(&s);
    free(g.cells);
    free(c.pixels);
}

/* A lamp about the pole, where texels are as near to one another as roundings of float. */
static void test_pole(void)
{
    static const int sizes[3][3] = { { 256, 1, 200 }, { 512, 2, 900 }, { 512, 1, 64 } };
    int i, x, y;

    for (i = 0; i < 3; i++) {
        const envsamp_lights_desc desc = ask(sizes[i][2]);
        canvas c = noise_map(sizes[i][0], sizes[i][0] / 2, 4, 1.0f);
        direct_tally t;

        memset(&t, 0, sizeof t);
        for (y = 0; y < sizes[i][1]; y++)
            for (x = 0; x < sizes[i][0]; x++)
                canvas_at(&c, x, y)[1] *= 1e6f;
        judge_view(&c.view, &desc, &t);
        check_tally("a lamp about the pole", &t);
        free(c.pixels);
    }
}

/* Many lights end soon. */
static void test_many(void)
{
    static const int wanted[4] = { 65536, 5000, 65536, 20000 };
    static const int sides[4][2] = { { 32, 16 }, { 64, 32 }, { 128, 64 }, { 512, 256 } };
    int i;

    for (i = 0; i < 4; i++) {
        const envsamp_lights_desc desc = ask(wanted[i]);
        direct_tally t;
        image map;

        memset(&t, 0, sizeof t);
        if (!map_make("night", sides[i][0], sides[i][1], &map))
            continue;
        {
            const envsamp_image view = kd_image(map.rgb, map.width, map.height, 3);

            judge_view(&view, &desc, &t);
        }
        check_tally("many lights", &t);
        image_free(&map);
    }
}

static void test_bad_pixels(void)
{
    static const float bad[4] = { NAN, INFINITY, -INFINITY, -2.0f };
    envsamp_lights_desc desc = ask(9);
    canvas c = lamp_map(9, 2, 0.1f, ENVSAMP_LATLONG);
    uint8_t mask[64 * 32];
    direct_tally t;
    light_set s;
    int i;

    memset(&t, 0, sizeof t);
    for (i = 0; i < 4; i++)
        canvas_at(&c, 7 * i, 5 * i)[i % 3] = bad[i];
    judge_view(&c.view, &desc, &t);
    check_tally("bad pixels", &t);
    set_make(&s, &c.view, &desc);
    CHECK(s.info.bad_pixel_count == 4, "%d bad pixels of 4", (int)s.info.bad_pixel_count);
    set_free(&s);
    desc.strict = 1;
    set_make(&s, &c.view, &desc);
    CHECK(IS(s.result, ENVSAMP_ERR_VALUE) && set_intact(&s)
          && IS(mask_make(&c.view, &desc, RUBBISH, mask, NULL), ENVSAMP_ERR_VALUE),
          "bad pixels are refused");
    set_free(&s);
    canvas_fill(&c, 0, 0, 64, 32, -1.0f);
    desc.strict = 0;
    set_make(&s, &c.view, &desc);
    CHECK(IS(s.result, ENVSAMP_ERR_BLACK)
          && IS(mask_make(&c.view, &desc, RUBBISH, mask, NULL), ENVSAMP_ERR_BLACK), "black map");
    set_free(&s);
    free(c.pixels);
}

/* ---- arguments ---- */

/* What all functions say: percentile, lambda and gamma are of the mask too. */
static int all_say(const envsamp_image *view, const envsamp_lights_desc *desc,
                   envsamp_result lights, envsamp_result mask)
{
    uint8_t labels[64 * 32];
    light_set s;
    int right;

    set_make(&s, view, desc);
    right = IS(s.result, lights) && (s.sizes.scratch_bytes > 0) == (lights == ENVSAMP_OK)
         && IS(s.sizes.table_bytes, 0) && IS(mask_make(view, desc, RUBBISH, labels, NULL), mask);
    set_free(&s);
    return right;
}

static void test_fields(void)
{
    static const float values[] = { NAN, INFINITY, -INFINITY, -0.1f, -1e-30f, 1.1f, 1.0f, 0.0f,
                                    FLT_MAX };
    const envsamp_result no = ENVSAMP_ERR_PARAM;
    canvas c = lamp_map(9, 2, 0.1f, ENVSAMP_LATLONG);
    int field, i, calls = 0, right = 0, ignored = 0;

    for (field = 0; field < FIELDS; field++)
        for (i = 0; i < 9; i++) {
            envsamp_lights_desc desc = ask(12), cut = ask(12), plain;
            const int bad = i < (field < 4 ? 3 : 5) || (field == 0 && (i == 5 || i == 8));
            const envsamp_result good = bad ? no : ENVSAMP_OK;

            *field_of(&desc, field) = values[i];
            right += all_say(&c.view, &desc, good, field < 3 ? good : ENVSAMP_OK);
            cut.method = i % 2 ? ENVSAMP_LIGHTS_MEDIAN_CUT : ENVSAMP_LIGHTS_RELAXED;
            plain = cut;
            *field_of(&cut, field) = values[i];
            ignored += bad ? all_say(&c.view, &cut, no, field < 3 ? no : ENVSAMP_OK)
                           : differences(&c.view, &cut, &plain) == SAME_ALL;
            calls++;
        }
    CHECK(right == calls, "%d of %d fields are refused or taken rightly", right, calls);
    CHECK(ignored == calls,
          "%d of %d fields are refused or do not matter with other methods", ignored, calls);
    free(c.pixels);
}

static void test_weights(void)
{
    canvas c = lamp_map(9, 2, 0.1f, ENVSAMP_LATLONG);
    envsamp_lights_desc desc = ask(12);
    int i, right = 0;

    for (i = 0; i < 8; i++) {
        desc.weight_variance = i & 1 ? 1e-30f : 0.0f;
        desc.weight_extent = i & 2 ? 1e-45f : 0.0f;
        desc.weight_energy = i & 4 ? FLT_MAX : 0.0f;
        right += all_say(&c.view, &desc, ENVSAMP_OK, ENVSAMP_OK);
    }
    CHECK(right == 8, "%d of 8 sets of weights are taken", right);
    desc = ask(-1);
    CHECK(all_say(&c.view, &desc, ENVSAMP_ERR_PARAM, ENVSAMP_OK), "-1 lights");
    desc = ask(65537);
    CHECK(all_say(&c.view, &desc, ENVSAMP_ERR_PARAM, ENVSAMP_OK), "65537 lights");
    free(c.pixels);
}

/* As much scratch as the header says of a mask, of 64 x 32 texels. */
static void test_mask_memory(void)
{
    enum { BYTES = 4 * 64 * 32 + 8 * 32 + (512 << 10) };
    const envsamp_lights_desc desc = ask(32);
    kd_guarded scratch = kd_guarded_make(BYTES, RUBBISH);
    envsamp_buffer buffer = scratch.buffer;
    canvas c = lamp_map(9, 2, 0.1f, ENVSAMP_LATLONG);
    uint8_t masks[2][64 * 32];
    float threshold = 0.0f;
    int i, right = 0;

    CHECK(!envsamp_emissive_mask(&c.view, NULL, masks[0], buffer, NULL)
          && !envsamp_emissive_mask(&c.view, &desc, masks[1], buffer, &threshold)
          && !memcmp(masks[0], masks[1], sizeof masks[0]) && threshold > 0.0f
          && kd_guarded_intact(&scratch), "a mask in the scratch that the header says, by default");
    buffer.bytes--;
    CHECK(IS(envsamp_emissive_mask(&c.view, &desc, masks[0], buffer, NULL), ENVSAMP_ERR_MEMORY),
          "a mask in a byte less");
    for (i = 1; i < ENVSAMP_ALIGN; i++) {
        buffer.data = (char *)scratch.buffer.data + i;
        buffer.bytes = BYTES;
        right += envsamp_emissive_mask(&c.view, &desc, masks[0], buffer, NULL) == ENVSAMP_ERR_ALIGN;
    }
    CHECK(right == ENVSAMP_ALIGN - 1 && kd_guarded_intact(&scratch), "a mask in scratch that is "
          "not aligned: %d of 7 refused", right);
    for (i = 1, right = 0; i < 4; i++) {
        envsamp_image view = c.view;

        view.pixels = (const float *)((uintptr_t)c.view.pixels + (uintptr_t)i);
        right += envsamp_emissive_mask(&view, &desc, masks[0], scratch.buffer, NULL)
              == ENVSAMP_ERR_ALIGN;
        view.pixels = c.view.pixels;
        view.row_stride_bytes = (size_t)(view.width * view.channels * 4 + i);
        right += envsamp_emissive_mask(&view, &desc, masks[0], scratch.buffer, NULL)
              == ENVSAMP_ERR_ALIGN;
    }
    CHECK(right == 6, "pixels and strides beside a multiple of 4: %d of 6 refused", right);
    free(scratch.block);
    free(c.pixels);
}

static void test_mask_missing(void)
{
    const envsamp_buffer none = { NULL, 1 << 20 };
    kd_guarded scratch = kd_guarded_make(1 << 20, RUBBISH);
    canvas c = lamp_map(9, 2, 0.1f, ENVSAMP_LATLONG);
    envsamp_image view = c.view;
    uint8_t mask[64 * 32];

    CHECK(IS(envsamp_emissive_mask(NULL, NULL, mask, scratch.buffer, NULL), ENVSAMP_ERR_NULL)
          && IS(envsamp_emissive_mask(&view, NULL, NULL, scratch.buffer, NULL), ENVSAMP_ERR_NULL)
          && IS(envsamp_emissive_mask(&view, NULL, mask, none, NULL), ENVSAMP_ERR_NULL),
          "a mask of nothing, into nothing, without scratch");
    view.pixels = NULL;
    CHECK(IS(envsamp_emissive_mask(&view, NULL, mask, scratch.buffer, NULL), ENVSAMP_ERR_NULL),
          "a mask of no pixels");
    view = c.view;
    view.width = 0;
    CHECK(IS(envsamp_emissive_mask(&view, NULL, mask, scratch.buffer, NULL), ENVSAMP_ERR_SIZE),
          "a mask of no columns");
    view = c.view;
    view.mapping = (envsamp_mapping)3;
    CHECK(IS(envsamp_emissive_mask(&view, NULL, mask, scratch.buffer, NULL), ENVSAMP_ERR_PARAM),
          "a mask of no mapping");
    free(scratch.block);
    free(c.pixels);
}

static void test_memory(void)
{
    const envsamp_lights_desc desc = ask(9);
    canvas c = lamp_map(9, 2, 0.1f, ENVSAMP_LATLONG);
    const envsamp_buffer none = { NULL, 1 << 20 };
    envsamp_buffer less;
    light_set s;
    int i, right = 0;

    set_make(&s, &c.view, &desc);
    less = s.scratch.buffer;
    less.bytes--;
    CHECK(IS(s.result, ENVSAMP_OK) && set_intact(&s)
          && IS(envsamp_lights(&c.view, &desc, s.lights, 9, less, NULL), ENVSAMP_ERR_MEMORY)
          && IS(envsamp_lights(&c.view, &desc, s.lights, 8, s.scratch.buffer, NULL),
             ENVSAMP_ERR_MEMORY), "just enough scratch, a byte less, a light less");
    for (i = 1; i < ENVSAMP_ALIGN; i++) {
        less.data = (char *)s.scratch.buffer.data + i;
        less.bytes = s.scratch.buffer.bytes;
        right += envsamp_lights(&c.view, &desc, s.lights, 9, less, NULL) == ENVSAMP_ERR_ALIGN;
    }
    CHECK(right == ENVSAMP_ALIGN - 1 && set_intact(&s), "scratch not aligned: %d of 7 refused",
          right);
    CHECK(IS(envsamp_lights(NULL, &desc, s.lights, 9, s.scratch.buffer, NULL), ENVSAMP_ERR_NULL)
          && IS(envsamp_lights(&c.view, &desc, NULL, 9, s.scratch.buffer, NULL), ENVSAMP_ERR_NULL)
          && IS(envsamp_lights(&c.view, &desc, s.lights, 9, none, NULL), ENVSAMP_ERR_NULL),
          "no image, no lights, no scratch");
    set_free(&s);
    free(c.pixels);
}

/* Tighter than the header says: cuts take up to 6 MB and 64 bytes a light, RELAXED 1 MB and 7 KB a
   light up to 4 MB and 200 bytes, both 16 bytes a column and 24 a row; 2.2 MB and 5 bytes a
   texel. */
static void test_scratch(void)
{
    static const int shapes[5][3] = { { 1, 1, 1 }, { 1024, 512, 32 }, { 4000, 3000, 65536 },
                                      { 65535, 1, 65536 }, { 512, 512, 600 } };
    int i, right = 0;

    for (i = 0; i < 5; i++) {
        const double w = (double)shapes[i][0], h = (double)shapes[i][1], n = (double)shapes[i][2];
        const envsamp_image view = kd_image(NULL, shapes[i][0], shapes[i][1], 3);
        const envsamp_lights_desc desc = ask(shapes[i][2]);
        envsamp_sizes sizes;

        right += envsamp_lights_sizes(&view, &desc, &sizes) == ENVSAMP_OK && !sizes.table_bytes
              && (double)sizes.scratch_bytes
                 <= 6e6 + 64.0 * n + 1e6 + fmin(7000.0 * n, 4e6) + 200.0 * n + 2.2e6 + 5.0 * w * h
                  + 2.0 * (16.0 * w + 24.0 * h) + 16.0 * 16;
    }
    CHECK(right == 5, "%d of 5 scratch sizes are as small as said", right);
}

static void test_arguments(void)
{
    test_bad_pixels();
    test_fields();
    test_weights();
    test_mask_memory();
    test_mask_missing();
    test_memory();
    test_scratch();
}

/* ---- anything ---- */

/* A map of a random kind: sparse, even, steep, a lamp in the dark, bad pixels; of any scale. */
static canvas any_map(pcg32 *random)
{
    const int most = pcg32_float(random) < 0.2f ? 3 : 40;
    const int width = 1 + (int)(pcg32_float(random) * (float)most);
    const int height = 1 + (int)(pcg32_float(random) * (float)most);
    const int kind = (int)(5.0f * pcg32_float(random));
    const float scale = powf(10.0f, 60.0f * (pcg32_float(random) - 0.5f));
    canvas c = canvas_make(width, height, pcg32_float(random) < 0.5f ? 1 : 3, 0);
    int i;

    c.view.mapping = (envsamp_mapping)(3.0f * pcg32_float(random));
    for (i = 0; i < width * height * c.view.channels; i++) {
        const float u = pcg32_float(random);

        c.pixels[i] = kind == 0 ? fmaxf(u - 0.9f, 0.0f) : kind == 1 ? 1.0f
                    : kind == 2 ? powf(u, 20.0f) : kind == 3 ? (u < 0.995f ? 1e-9f : 1.0f)
                    : u < 0.02f ? NAN : u < 0.04f ? -1.0f : u;
        c.pixels[i] *= scale;
    }
    return c;
}

static envsamp_lights_desc any_desc(pcg32 *random)
{
    envsamp_lights_desc desc = ask(1 + (int)(pcg32_float(random)
                                             * (pcg32_float(random) < 0.3f ? 300.0f : 40.0f)));
    int i;

    for (i = 0; i < FIELDS; i++)
        if (pcg32_float(random) < 0.3f)
            *field_of(&desc, i) = pcg32_float(random) >= 0.3f || i == FIELDS - 1
                                ? 1e-6f + pcg32_float(random) : i < 4 ? -1.0f : 0.0f;
    if (pcg32_float(random) < 0.3f)
        desc.mask_scale = powf(10.0f, 8.0f * (pcg32_float(random) - 0.8f));
    if (pcg32_float(random) < 0.3f)
        desc.refine_rounds = (int)(100.0f * pcg32_float(random));
    desc.seed = (uint32_t)(65536.0f * pcg32_float(random));
    return desc;
}

/* Any map with any description gives a set as it must be, or is black. */
static void test_anything(void)
{
    enum { SETS = 3000 };
    pcg32 random = pcg32_make(17, 1);
    int i, black = 0, right = 0;

    for (i = 0; i < SETS; i++) {
        canvas c = any_map(&random);
        const envsamp_lights_desc desc = any_desc(&random);
        grid g = grid_make(&c.view);
        light_set s;
        verdict v;

        memset(&v, 0, sizeof v);
        set_make(&s, &c.view, &desc);
        if (s.result == ENVSAMP_ERR_BLACK) {
            black += g.lit == 0;
        } else {
            judge_set(&s, &g, &v);
            right += verdict_good(&v);
        }
        set_free(&s);
        free(g.cells);
        free(c.pixels);
    }
    CHECK(right + black == SETS && right > SETS * 9 / 10, "any maps and descriptions: %d sets of "
          "%d are right, %d maps are black", right, (int)SETS, black);
}

int main(void)
{
    test_masks();
    test_real_masks();
    test_odd_masks();
    test_constant_mask();
    test_judge();
    test_maps();
    test_real();
    test_shapes();
    test_values();
    test_halves();
    test_large_halves();
    test_swarm(-1);
    test_swarm(1);
    test_swarm(2);
    test_swarm(64);
    test_swarm(INT_MAX);
    test_masking();
    test_edge();
    test_draws(0);
    test_draws(1);
    test_unmasked();
    test_scatter();
    test_turns();
    test_differences();
    test_same();
    test_no_emissive();
    test_all_emissive();
    test_shared();
    test_pole();
    test_many();
    test_arguments();
    test_anything();
    return check_done();
}
