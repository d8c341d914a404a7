/* test_kd_target.c: tables of as many blocks as a target of excess variance needs. What they leave
 * beside the target, and that fewer blocks leave more; that a target changes nothing else: the
 * limit, compensation, light x cosine, steps, memory; targets that are refused.
 */
#include "check.h"

#include "../envsamp.h"

#include "kd_fixture.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"

#include <float.h>

#define TARGETS 3
#define LIMIT 8000              /* blocks: more than a target needs here, but for noise */

/* Splitting stops by the search's estimates, in which a part of a cell counts by its solid angle:
   3.2 % off here, 1.3 % on real maps. */
#define ALIAS_MOST 1.05

/* WARP draws its tiles equally often, while the estimate is of the best probabilities: 1 + excess
   grows by a factor of 1 + the variance of the tiles' Q over its squared mean. Halving the light
   within a few percent makes that 0.0002 on real maps; here tiles differ more. */
#define WARP_MOST 1.12

static const float targets[TARGETS] = { 0.05f, 0.02f, 0.01f };
static const char *const select_names[] = { "WARP", "ALIAS", "FIT" };
static const char *const criterion_names[] = { "EXCESS", "SSE", "VARIANCE", "RANGE" };

static double most_over(envsamp_kd_select select)
{
    return select == ENVSAMP_KD_WARP ? WARP_MOST : ALIAS_MOST;
}

/* ---- maps ---- */

#define MAPS 6

static image maps[MAPS];
static envsamp_image views[MAPS];

/* The same pixels are a lat-long map and, of another size, an octahedral one. */
static void make_maps(void)
{
    static const char *const names[] = { "sky", "studio", "night" };
    int i;

    for (i = 0; i < MAPS; i++) {
        if (!map_make(names[i / 2], i % 2 ? 72 : 96, i % 2 ? 72 : 48, &maps[i])) {
            printf("Bail out! no map\n");
            exit(1);
        }
        views[i] = kd_image(maps[i].rgb, maps[i].width, maps[i].height, 3);
        views[i].mapping = i % 2 ? ENVSAMP_OCTAHEDRAL : ENVSAMP_LATLONG;
    }
}

static envsamp_kd_desc target_desc(envsamp_kd_select select, envsamp_kd_criterion criterion,
                                   int nearest, float target)
{
    envsamp_kd_desc desc = kd_desc(LIMIT, select);

    desc.criterion = criterion;
    desc.nearest = nearest;
    desc.excess_target = target;
    return desc;
}

/* What a build tells of its table. */
static envsamp_kd_info info_of(const envsamp_image *map, const envsamp_kd_desc *desc)
{
    kd_fixture f;
    envsamp_kd_info info;

    if (!kd_fixture_build(&f, map, desc)) {
        memset(&f.info, 0, sizeof f.info);
        f.info.excess_variance = HUGE_VAL;
    }
    info = f.info;
    if (!kd_fixture_intact(&f))
        info.block_count = -1;
    kd_fixture_free(&f);
    return info;
}

/* Blocks that a description may give: no more than cells. */
static int block_limit(const envsamp_image *map, const envsamp_kd_desc *desc)
{
    const int border = !desc->nearest;
    const int cells = (map->width + border) * (map->height + border);

    return cells < desc->block_count ? cells : desc->block_count;
}

/* Whether two descriptions give the same table, byte for byte. */
static int same_table(const envsamp_image *map, const envsamp_kd_desc *a, const envsamp_kd_desc *b)
{
    kd_fixture f, g;
    int same;

    kd_fixture_build(&f, map, a);
    kd_fixture_build(&g, map, b);
    same = f.kd && g.kd && envsamp_kd_bytes(f.kd) == envsamp_kd_bytes(g.kd)
        && memcmp(f.kd, g.kd, envsamp_kd_bytes(f.kd)) == 0;
    kd_fixture_free(&f);
    kd_fixture_free(&g);
    return same;
}

/* ---- what is left ---- */

typedef struct outcome {
    int builds, reached, fewer;
    double most, least_before;      /* over the target: excess, and that of a fifth less blocks */
} outcome;

/* A fifth less blocks leave more than the target, but where WARP's other crown is luckier. */
static void judge(const envsamp_image *map, const envsamp_kd_desc *desc, int *blocks, outcome *o)
{
    const envsamp_kd_info info = info_of(map, desc);
    const double target = (double)desc->excess_target;
    envsamp_kd_desc less = *desc;

    o->builds++;
    o->fewer += info.block_count < *blocks;
    *blocks = info.block_count;
    if (info.block_count >= block_limit(map, desc))
        return;
    o->reached++;
    o->most = fmax(o->most, info.excess_variance / target);
    less.block_count = (int)(0.8 * (double)info.block_count);
    less.excess_target = 0.0f;
    o->least_before = fmin(o->least_before, info_of(map, &less).excess_variance / target);
}

static void test_targets(envsamp_kd_select select, envsamp_kd_criterion criterion)
{
    outcome o = { 0, 0, 0, 0.0, HUGE_VAL };
    int i, t;

    for (i = 0; i < 2 * MAPS; i++) {
        int blocks = 0;

        for (t = 0; t < TARGETS; t++) {
            const envsamp_kd_desc desc = target_desc(select, criterion, i % 2, targets[t]);

            judge(&views[i / 2], &desc, &blocks, &o);
        }
    }
    CHECK(o.most <= most_over(select), "%s, %s: the excess is at most %.4f of the target",
          select_names[select], criterion_names[criterion], o.most);
    CHECK(o.least_before >= 0.9, "with a fifth less blocks it is %.4f at least", o.least_before);
    CHECK(IS(o.fewer, 0), "a smaller target has no fewer blocks");
    CHECK(o.reached >= 30 && o.reached <= o.builds, "%d of %d reach it below the limit", o.reached,
          o.builds);
}

/* Tiles of a table of so many blocks. */
static int tiles_for(int blocks)
{
    int tiles = 1;

    while (3 * 2 * tiles <= blocks)
        tiles *= 2;
    return tiles;
}

/* The crown of WARP is that of as many blocks as it takes without one, which is ALIAS's number. */
static void test_crown(void)
{
    int i, right = 0, more = 0;

    for (i = 0; i < 2 * MAPS; i++) {
        envsamp_kd_desc desc = target_desc(ENVSAMP_KD_ALIAS, ENVSAMP_KD_EXCESS, i % 2, 0.02f);
        const int blocks = info_of(&views[i / 2], &desc).block_count;
        kd_fixture f;

        desc.select = ENVSAMP_KD_WARP;
        kd_fixture_build(&f, &views[i / 2], &desc);
        right += f.kd && kd_tile_count(f.kd) == tiles_for(blocks);
        more += f.info.block_count > blocks;
        kd_fixture_free(&f);
    }
    CHECK(IS(right, 2 * MAPS), "WARP: as many tiles as for the blocks that ALIAS needs");
    CHECK(IS(more, 2 * MAPS), "and more blocks");
}

/* ALIAS splits as it does without a target, and stops. */
static void test_same_splits(void)
{
    int i, same = 0;

    for (i = 0; i < 2 * MAPS; i++) {
        envsamp_kd_desc desc = target_desc(ENVSAMP_KD_ALIAS, ENVSAMP_KD_EXCESS, i % 2, 0.05f);
        envsamp_kd_desc as_many = desc;

        as_many.block_count = info_of(&views[i / 2], &desc).block_count;
        as_many.excess_target = 0.0f;
        same += same_table(&views[i / 2], &desc, &as_many);
    }
    CHECK(IS(same, 2 * MAPS), "ALIAS: the table is that of as many blocks without a target");
}

/* ---- few blocks, and many ---- */

/* One block leaves what a table of one block says. */
static void test_one_block(envsamp_kd_select select)
{
    int i, one = 0, none = 0, more = 0;

    for (i = 0; i < 2 * MAPS; i++) {
        envsamp_kd_desc desc = target_desc(select, ENVSAMP_KD_EXCESS, i % 2, 0.0f);
        double left;

        desc.block_count = 1;
        left = info_of(&views[i / 2], &desc).excess_variance;
        desc.block_count = LIMIT;
        desc.excess_target = (float)(1.01 * left);
        one += info_of(&views[i / 2], &desc).block_count == 1;
        desc.excess_target = FLT_MAX;
        none += info_of(&views[i / 2], &desc).block_count == 1;
        desc.excess_target = (float)(0.9 * left);
        more += info_of(&views[i / 2], &desc).block_count > 1;
    }
    CHECK(IS(one, 2 * MAPS) && IS(none, 2 * MAPS),
          "%s: one block where a target is above what it leaves", select_names[select]);
    CHECK(IS(more, 2 * MAPS), "%s: more where it is below", select_names[select]);
}

static void test_constant_map(void)
{
    image map;
    int i, one = 0;

    map_make("constant", 32, 32, &map);
    for (i = 0; i < 3 * 2 * 3; i++) {
        envsamp_image view = kd_image(map.rgb, 32, 32, 3);
        envsamp_kd_desc desc = target_desc((envsamp_kd_select)(i / 6), ENVSAMP_KD_EXCESS, i % 2,
                                           0.01f);
        envsamp_kd_info info;

        view.mapping = (envsamp_mapping)(i / 2 % 3);
        info = info_of(&view, &desc);
        one += info.block_count == 1 && info.excess_variance < 1e-6;
    }
    CHECK(IS(one, 18), "a constant map is one block");
    image_free(&map);
}

/* A target out of reach changes nothing, and one that is next to 0 leaves next to nothing. */
static void test_limit(envsamp_kd_select select)
{
    int i, k, count = 0, same = 0, flat = 0;

    for (i = 0; i < 2 * MAPS; i++)
        for (k = 0; k < 2; k++) {
            envsamp_kd_desc desc = target_desc(select, ENVSAMP_KD_EXCESS, i % 2,
                                               k ? FLT_MIN : 1e-4f);
            envsamp_kd_desc plain;
            int blocks;

            desc.block_count = 60;
            plain = desc;
            plain.excess_target = 0.0f;
            blocks = info_of(&views[i / 2], &desc).block_count;
            count += blocks == info_of(&views[i / 2], &plain).block_count && blocks <= 60;
            same += same_table(&views[i / 2], &desc, &plain);
            desc.block_count = 16384;
            if (k && i % 2)             /* the nearest texel: all blocks become flat */
                flat += info_of(&views[i / 2], &desc).excess_variance < 1e-3;
        }
    CHECK(IS(count, 4 * MAPS), "%s: block_count stays the limit", select_names[select]);
    CHECK(IS(same, 4 * MAPS), "%s: with the table of no target", select_names[select]);
    CHECK(IS(flat, MAPS), "%s: FLT_MIN is a target, and leaves nothing", select_names[select]);
}

/* ---- what else a description asks for ---- */

/* The target is of what is left after compensation, which is in force. */
static void test_compensation(envsamp_kd_select select)
{
    int i, reached = 0, in_force = 0;

    for (i = 0; i < 2 * MAPS; i++) {
        envsamp_kd_desc desc = target_desc(select, ENVSAMP_KD_EXCESS, i % 2, 0.05f);
        envsamp_kd_info info;

        desc.mis_compensation = 0.75f;
        info = info_of(&views[i / 2], &desc);
        reached += info.excess_variance <= most_over(select) * 0.05;
        in_force += IS(info.mis_compensation, 0.75f) && info.block_count > 1
                 && info.block_count < block_limit(&views[i / 2], &desc);
    }
    CHECK(IS(reached, 2 * MAPS) && IS(in_force, 2 * MAPS),
          "%s: the target is of what compensation leaves", select_names[select]);
}

/* VARIANCE and RANGE do not split what has the most excess, but stop all the same. */
static void test_criteria(envsamp_kd_select select, envsamp_kd_criterion criterion)
{
    double most = 0.0;
    int i, reached = 0;

    for (i = 0; i < MAPS; i++) {
        const envsamp_kd_desc desc = target_desc(select, criterion, 1, 0.05f);
        const envsamp_kd_info info = info_of(&views[i], &desc);

        if (info.block_count < block_limit(&views[i], &desc)) {
            reached++;
            most = fmax(most, info.excess_variance / 0.05);
        }
    }
    CHECK(IS(reached, MAPS) && most <= most_over(select), "%s, %s: %.4f of the target at most",
          select_names[select], criterion_names[criterion], most);
}

/* FIT stops at the same blocks as ALIAS; how much its model leaves is another matter. */
static void test_fit(envsamp_kd_model model)
{
    int i, same = 0, sane = 0;

    for (i = 0; i < 2 * MAPS; i++) {
        envsamp_kd_desc desc = target_desc(ENVSAMP_KD_FIT, ENVSAMP_KD_SSE, i % 2, 0.05f);
        envsamp_kd_info fit, alias;

        desc.model = model;
        fit = info_of(&views[i / 2], &desc);
        desc.select = ENVSAMP_KD_ALIAS;
        alias = info_of(&views[i / 2], &desc);
        same += fit.block_count == alias.block_count;
        sane += fit.excess_variance >= 0.999 * alias.excess_variance && fit.excess_variance < 100.0;
    }
    CHECK(IS(same, 2 * MAPS), "FIT, %s: as many blocks as ALIAS", model ? "POWER" : "LOG");
    CHECK(IS(sane, 2 * MAPS), "FIT, %s: its model leaves more", model ? "POWER" : "LOG");
}

/* Irradiance of a normal along an axis: a sum over texels, and by samples in strata. */
static double irradiance(const envsamp_image *map, const float normal[3])
{
    double sum = 0.0;
    int x, y;

    for (y = 0; y < map->height; y++)
        for (x = 0; x < map->width; x++) {
            const double sr = kd_solid_angle(map->width, map->height, x, y, x + 1, y + 1);
            double cosine;
            float dir[3];

            kd_direction(((double)x + 0.5) / (double)map->width,
                         ((double)y + 0.5) / (double)map->height, dir);
            cosine = (double)(dir[0] * normal[0] + dir[1] * normal[1] + dir[2] * normal[2]);
            sum += fmax(cosine, 0.0) * sr * kd_texel(map, x, y);
        }
    return sum;
}

static double facing_estimate(const kd_fixture *f, const float normal[3], int *faults)
{
    const int side = 64;
    pcg32 random = pcg32_make(17, 1);
    double sum = 0.0;
    int i;

    for (i = 0; i < side * side; i++) {
        const float u0 = ((float)(i % side) + pcg32_float(&random)) / (float)side;
        const float u1 = ((float)(i / side) + pcg32_float(&random)) / (float)side;
        const envsamp_sample s = envsamp_kd_sample_facing(f->kd, normal, u0, u1);
        const float cosine = s.dir[0] * normal[0] + s.dir[1] * normal[1] + s.dir[2] * normal[2];
        float rgb[3];

        envsamp_lookup(&f->image, f->desc.nearest, s.dir, rgb);
        *faults += !(s.pdf > 0.0f && s.pdf <= FLT_MAX)
                || fabsf(envsamp_kd_pdf_facing(f->kd, normal, s.dir) / s.pdf - 1.0f) > 1e-4f;
        sum += (double)(fmaxf(cosine, 0.0f) * envsamp_luminance(rgb) / s.pdf);
    }
    return sum / (double)(side * side);
}

/* Light x cosine has the crown of the limit, and splits its tiles until the target is reached. */
static void test_facing(void)
{
    static const float normals[3][3] = { { 0, 0, 1 }, { 1, 0, 0 }, { 0, -1, 0 } };
    double most = 0.0, worst = 0.0;
    int i, k, faults = 0, facing = 0, fewer = 0;

    for (i = 0; i < MAPS; i += 2) {
        envsamp_kd_desc desc = target_desc(ENVSAMP_KD_WARP, ENVSAMP_KD_EXCESS, 1, 0.02f);
        kd_fixture f;

        desc.facing = 1;
        desc.block_count = 3000;
        kd_fixture_build(&f, &views[i], &desc);
        facing += f.info.facing && kd_fixture_intact(&f) && kd_tile_count(f.kd) == tiles_for(3000);
        fewer += f.info.block_count < 3000;
        most = fmax(most, f.info.excess_variance / 0.02);
        for (k = 0; k < 3 && f.kd; k++)
            worst = fmax(worst, fabs(facing_estimate(&f, normals[k], &faults)
                                     / irradiance(&views[i], normals[k]) - 1.0));
        kd_fixture_free(&f);
    }
    CHECK(IS(facing, 3) && IS(fewer, 3) && most <= WARP_MOST,
          "light x cosine: fewer blocks than the limit, and %.4f of the target", most);
    CHECK(faults <= 3 * 3 * 64 * 64 / 100, "samples have their densities: %d have not", faults);
    CHECK(worst <= 0.02, "and the light of normals is %.4f off", worst);
}

/* ---- steps and memory ---- */

static int same_in_steps(const kd_fixture *f, int count)
{
    kd_guarded table = kd_guarded_make(f->sizes.table_bytes, 0x77);
    kd_guarded scratch = kd_guarded_make(f->sizes.scratch_bytes, 0x78);
    const envsamp_kd *kd = NULL;
    envsamp_kd_job *job;
    int done = 0, same;

    same = envsamp_kd_begin(&f->image, NULL, NULL, &f->desc, table.buffer, scratch.buffer, &job)
        == ENVSAMP_OK;
    while (same && !done && count > 0)
        same = envsamp_kd_step(job, count, &done) == ENVSAMP_OK;
    same = same && envsamp_kd_finish(job, &kd) == ENVSAMP_OK
        && envsamp_kd_bytes(kd) == envsamp_kd_bytes(f->kd)
        && memcmp(kd, f->kd, envsamp_kd_bytes(kd)) == 0
        && kd_guarded_intact(&table) && kd_guarded_intact(&scratch);
    free(table.block);
    free(scratch.block);
    return same;
}

/* Rubbish in the buffers does not matter; sizes are those of the limit, and exact. */
static void test_steps(envsamp_kd_select select)
{
    static const int counts[4] = { 1, 7, 1000, 0 };     /* 0: all by _finish */
    int i, k, same = 0, as_before = 0, opens = 0;

    for (i = 0; i < MAPS; i++) {
        envsamp_kd_desc desc = target_desc(select, ENVSAMP_KD_EXCESS, i / 2 % 2, 0.05f);
        const envsamp_kd *kd;
        envsamp_sizes sizes;
        kd_fixture f;

        kd_fixture_build(&f, &views[i], &desc);
        for (k = 0; k < 4 && f.kd; k++)
            same += same_in_steps(&f, counts[k]);
        opens += f.kd && kd_fixture_intact(&f)
              && envsamp_kd_open(f.kd, envsamp_kd_bytes(f.kd), &kd) == ENVSAMP_OK;
        desc.excess_target = 0.0f;
        as_before += envsamp_kd_sizes(&views[i], &desc, &sizes) == ENVSAMP_OK
                  && sizes.table_bytes == f.sizes.table_bytes
                  && sizes.scratch_bytes == f.sizes.scratch_bytes;
        kd_fixture_free(&f);
    }
    CHECK(IS(same, 4 * MAPS), "%s: the same bytes in steps", select_names[select]);
    CHECK(IS(opens, MAPS), "%s: exact sizes suffice, and the table opens", select_names[select]);
    CHECK(IS(as_before, MAPS), "%s: a target needs no more memory", select_names[select]);
}

/* ---- what is refused ---- */

static int refused(envsamp_kd_select select, float target)
{
    envsamp_kd_desc desc = target_desc(select, ENVSAMP_KD_EXCESS, 1, 0.05f);
    const envsamp_kd *kd;
    envsamp_kd_job *job;
    envsamp_sizes sizes;
    int times = 0;
    kd_fixture f;

    desc.block_count = 100;
    kd_fixture_build(&f, &views[0], &desc);     /* for its buffers */
    kd = f.kd;
    job = (envsamp_kd_job *)f.scratch.buffer.data;
    desc.excess_target = target;
    times += envsamp_kd_sizes(&views[0], &desc, &sizes) == ENVSAMP_ERR_PARAM
          && sizes.table_bytes == 0 && sizes.scratch_bytes == 0;
    times += envsamp_kd_build(&views[0], &desc, f.table.buffer, f.scratch.buffer, &kd)
          == ENVSAMP_ERR_PARAM && !kd;
    times += envsamp_kd_begin(&views[0], NULL, NULL, &desc, f.table.buffer, f.scratch.buffer, &job)
          == ENVSAMP_ERR_PARAM && !job;
    kd_fixture_free(&f);
    return times;
}

static void test_refused(void)
{
    static const float bad[] = { -1.0f, -0.02f, -FLT_MIN, -FLT_MAX, NAN, INFINITY, -INFINITY };
    const int count = (int)(sizeof bad / sizeof bad[0]);
    int select, i, times = 0, accepted = 0;

    for (select = 0; select < 3; select++) {
        for (i = 0; i < count; i++)
            times += refused((envsamp_kd_select)select, bad[i]);
        accepted += refused((envsamp_kd_select)select, -0.0f) == 0
                 && refused((envsamp_kd_select)select, FLT_MAX) == 0;
    }
    CHECK(IS(times, 3 * 3 * count), "negative targets, NaN and infinity are refused");
    CHECK(IS(accepted, 3), "0 of either sign and FLT_MAX are not");
}

int main(void)
{
    int select, i;

    make_maps();
    for (select = 0; select < 2; select++) {
        test_targets((envsamp_kd_select)select, ENVSAMP_KD_EXCESS);
        test_targets((envsamp_kd_select)select, ENVSAMP_KD_SSE);
        test_one_block((envsamp_kd_select)select);
        test_limit((envsamp_kd_select)select);
        test_compensation((envsamp_kd_select)select);
        test_criteria((envsamp_kd_select)select, ENVSAMP_KD_VARIANCE);
        test_criteria((envsamp_kd_select)select, ENVSAMP_KD_RANGE);
    }
    test_crown();
    test_same_splits();
    test_constant_map();
    test_fit(ENVSAMP_KD_LOG);
    test_fit(ENVSAMP_KD_POWER);
    test_facing();
    for (select = 0; select < 3; select++)
        test_steps((envsamp_kd_select)select);
    test_refused();
    for (i = 0; i < MAPS; i++)
        image_free(&maps[i]);
    return check_done();
}
