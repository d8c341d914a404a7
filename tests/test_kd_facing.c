/* test_kd_facing.c: samples of light x cosine. Estimates with them are unbiased, and their
 * densities are those of the weights that the table holds, computed in double; faults that the
 * statistics must reject; normals that are none; maps with nothing in front of a normal; memory,
 * builds in steps and from rows; damaged tables.
 *
 *     test_kd_facing [quick]     quick: without the long ones, for slow tools
 */
#include "check.h"

#include "../envsamp.h"

#include "kd_fixture.h"
#include "statistics.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"

#include <float.h>

#define UNIT 16777216.0         /* 2^24: how many values a float u has */
#define PARTS 4096              /* more than the nodes of any table here name */

static const char *const mappings[] = { "lat-long", "hemisphere", "octahedral" };

/* ---- normals ---- */

static double dot(const float a[3], const float b[3])
{
    return (double)a[0] * (double)b[0] + (double)a[1] * (double)b[1] + (double)a[2] * (double)b[2];
}

/* Poles, both sides of the seam and of the map's middle, then a spiral over the sphere. */
#define FIXED_NORMALS 8

static void make_normal(int index, int count, float normal[3])
{
    static const float fixed[FIXED_NORMALS][3] = {
        { 0, 0, 1 }, { 0, 0, -1 }, { 1, 0, 0 }, { -1, 0, 0 }, { 0.8f, 1e-7f, 0.6f },
        { 0.8f, -1e-7f, 0.6f }, { -0.8f, 1e-7f, -0.6f }, { -0.8f, -1e-7f, -0.6f }
    };
    const double z = 1.0 - 2.0 * ((double)index + 0.5) / (double)count;
    const double phi = 2.39996322972865332 * (double)index, r = sqrt(1.0 - z * z);

    normal[0] = (float)(r * cos(phi));
    normal[1] = (float)(r * sin(phi));
    normal[2] = (float)z;
    if (index < FIXED_NORMALS)
        memcpy(normal, fixed[index], sizeof fixed[index]);
}

/* ---- maps and tables ---- */

typedef struct subject {
    kd_fixture f;
    image map;
    envsamp_image view;
} subject;

static envsamp_kd_desc facing_desc(int blocks, int nearest)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();

    desc.block_count = blocks;
    desc.nearest = nearest;
    desc.facing = 1;
    return desc;
}

/* Builds from s->map. Free it in either case. */
static int subject_build(subject *s, envsamp_mapping mapping, const envsamp_kd_desc *desc)
{
    s->view = kd_image(s->map.rgb, s->map.width, s->map.height, 3);
    s->view.mapping = mapping;
    if (!kd_fixture_build(&s->f, &s->view, desc))
        CHECK(0, "%dx%d, %d blocks build: %s", s->map.width, s->map.height, desc->block_count,
              envsamp_result_string(s->f.result));
    return s->f.kd != NULL;
}

/* A map of maps.h, taken for one of any mapping, bilinear. */
static int subject_make(subject *s, const char *name, envsamp_mapping mapping, int blocks)
{
    const envsamp_kd_desc desc = facing_desc(blocks, 0);

    map_make(name, 64, mapping == ENVSAMP_LATLONG ? 32 : 64, &s->map);
    return subject_build(s, mapping, &desc);
}

static void subject_free(subject *s)
{
    kd_fixture_free(&s->f);
    image_free(&s->map);
}

static void worst(double *so_far, double value)
{
    if (!(value <= *so_far))
        *so_far = value;
}

static double radiance(const subject *s, const float dir[3])
{
    float rgb[3];

    envsamp_lookup(&s->view, s->f.desc.nearest, dir, rgb);
    return (double)envsamp_luminance(rgb);
}

/* Whether a sample of a table that is whole is one: a unit direction, with a density. */
static int is_sound(const envsamp_sample *s)
{
    return fabs(dot(s->dir, s->dir) - 1.0) < 3e-6 && s->pdf > 0.0f && s->pdf <= FLT_MAX
        && s->uv[0] >= 0.0f && s->uv[0] <= 1.0f && s->uv[1] >= 0.0f && s->uv[1] <= 1.0f;
}

static int is_number(const float u[2])
{
    return u[0] >= 0.0f && u[0] < 1.0f && u[1] >= 0.0f && u[1] < 1.0f;
}

static int same_sample(const envsamp_sample *a, const envsamp_sample *b)
{
    return kd_bits_equal(a->dir, b->dir, sizeof a->dir) && kd_bits_equal(&a->pdf, &b->pdf, 4)
        && kd_bits_equal(a->uv, b->uv, sizeof a->uv);
}

/* ---- unbiased ---- */

/* Solid angle of a point of the map, per u and v. */
static double stretch_of(envsamp_mapping mapping, double v)
{
    if (mapping == ENVSAMP_OCTAHEDRAL)
        return 4.0 * KD_PI;
    return mapping == ENVSAMP_LATLONG ? 2.0 * KD_PI * KD_PI * sin(KD_PI * v)
                                      : KD_PI * KD_PI * sin(0.5 * KD_PI * v);
}

/* Irradiance at each normal, by Gauss's three points each way in quarters of texels: within them
   bilinear radiance is smooth. The last is the integral over the sphere. */
static void sum_map(const subject *s, int count, float (*normals)[3], double *sums)
{
    static const double place[3] = { 0.1127016653792583, 0.5, 0.8872983346207417 };
    static const double weight[3] = { 5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0 };
    const int width = 6 * s->view.width, height = 6 * s->view.height;
    int x, y, i;

    for (i = 0; i <= count; i++)
        sums[i] = 0.0;
    for (y = 0; y < height; y++)
        for (x = 0; x < width; x++) {
            const double u = 3.0 * ((double)(x / 3) + place[x % 3]) / (double)width;
            const double v = 3.0 * ((double)(y / 3) + place[y % 3]) / (double)height;
            double part = 9.0 * weight[x % 3] * weight[y % 3] / (double)width / (double)height
                        * stretch_of(s->view.mapping, v);
            float dir[3];

            envsamp_uv_to_dir(s->view.mapping, (float)u, (float)v, dir);
            part *= radiance(s, dir);
            for (i = 0; i < count; i++)
                sums[i] += part * fmax(dot(dir, normals[i]), 0.0);
            sums[count] += part;
        }
}

/* One estimate: of irradiance, or, without a cosine, of the integral. */
static double estimate(const subject *s, const float normal[3], int cosine, float u0, float u1)
{
    const envsamp_sample p = envsamp_kd_sample_facing(s->f.kd, normal, u0, u1);
    const double value = radiance(s, p.dir) / (double)p.pdf;

    return cosine ? value * fmax(dot(p.dir, normal), 0.0) : value;
}

enum { NORMALS = 32 };

static void test_unbiased(const char *name, envsamp_mapping mapping, int samples)
{
    float normals[NORMALS][3];
    double known[NORMALS + 1], least = 1.0;
    int i, k, judged = 0, wrong = 0;
    subject s;

    if (subject_make(&s, name, mapping, 6144)) {
        for (i = 0; i < NORMALS; i++)
            make_normal(i, NORMALS, normals[i]);
        sum_map(&s, NORMALS, normals, known);
        for (i = 0; i < NORMALS; i++) {
            pcg32 random = pcg32_make(1, (uint64_t)i);
            stat_moments moments = { 0.0, 0.0, 0.0 };

            for (k = 0; k < samples; k++) {
                const float u0 = pcg32_float(&random);

                stat_moments_add(&moments, estimate(&s, normals[i], 1, u0, pcg32_float(&random)));
            }
            if (known[i] > 1e-6 * known[NORMALS]) {
                least = fmin(least, stat_mean_test(&moments, known[i], 3e-5 * known[i]));
                judged++;
            } else {
                wrong += !(moments.mean >= 0.0 && moments.mean <= 1e-5 * known[NORMALS]);
            }
        }
        CHECK(least > stat_sidak(STAT_ALPHA, NORMALS) && !wrong && judged >= NORMALS - 1,
              "%s, %s: irradiance at %d normals is unbiased, p from %.2g", name, mappings[mapping],
              judged, least);
    }
    subject_free(&s);
}

/* ---- densities ---- */

/* Sum over blocks of density times solid angle: densities are constant in a block. */
static double integral_of_pdf(const kd_fixture *f, const float normal[3])
{
    envsamp_kd_block block;
    double sum = 0.0;
    float dir[3];
    int i;

    for (i = 0; i < f->info.block_count; i++) {
        envsamp_kd_get_block(f->kd, i, &block);
        envsamp_uv_to_dir(f->image.mapping, 0.5f * block.uv_min[0] + 0.5f * block.uv_max[0],
                          0.5f * block.uv_min[1] + 0.5f * block.uv_max[1], dir);
        sum += (double)envsamp_kd_pdf_facing(f->kd, normal, dir) * (double)block.solid_angle;
    }
    return sum;
}

static void test_integral(const char *name, envsamp_mapping mapping, int blocks)
{
    double most = 0.0;
    float normal[3];
    subject s;
    int i;

    if (subject_make(&s, name, mapping, blocks)) {
        for (i = 0; i < 100; i++) {
            make_normal(i, 100, normal);
            worst(&most, fabs(integral_of_pdf(&s.f, normal) - 1.0));
        }
        CHECK(most < 1e-4, "%s, %s, %d blocks: densities integrate to 1, to %.1e", name,
              mappings[mapping], s.f.info.block_count, most);
    }
    subject_free(&s);
}

/* ---- sample, density and inverse agree ---- */

typedef struct agreement {
    long points, other_pdf, refused, outside, far;
    double error[2];            /* in units of 2^-24 */
} agreement;

/* Numbers come back within so many times 2^-24: directions in between are floats, and a sun fills
   much of the unit square. */
#define SLACK 512.0

static void agree(const kd_fixture *f, const float normal[3], float u0, float u1, agreement *out)
{
    const envsamp_sample p = envsamp_kd_sample_facing(f->kd, normal, u0, u1);
    const double pdf = (double)envsamp_kd_pdf_facing(f->kd, normal, p.dir);
    const float before[2] = { u0, u1 };
    int axis, far = 0;
    float u[2];

    out->points++;
    if (!(fabs(pdf / (double)p.pdf - 1.0) < 1e-5)) {
        out->other_pdf++;
        return;
    }
    if (!envsamp_kd_invert_facing(f->kd, normal, p.dir, u)) {
        out->refused++;
        return;
    }
    out->outside += !is_number(u);
    for (axis = 0; axis < 2; axis++) {
        const double error = fabs((double)u[axis] - (double)before[axis]) * UNIT;

        far |= error > SLACK;
        if (error <= SLACK)
            worst(&out->error[axis], error);
    }
    out->far += far;
}

static void test_agreement(const char *name, envsamp_mapping mapping, int blocks, int count)
{
    agreement out = { 0, 0, 0, 0, 0, { 0.0, 0.0 } };
    pcg32 random = pcg32_make(2, (uint64_t)mapping);
    float normal[3];
    subject s;
    int i;

    if (subject_make(&s, name, mapping, blocks)) {
        for (i = 0; i < count; i++) {
            const float u0 = pcg32_float(&random);

            make_normal(i % 100, 100, normal);
            agree(&s.f, normal, u0, pcg32_float(&random), &out);
        }
        CHECK(out.other_pdf * 2000 < out.points, "%s, %s: pdf(sample) differs in %ld of %ld", name,
              mappings[mapping], out.other_pdf, out.points);
        CHECK(!out.refused && !out.outside, "samples invert to numbers, but %ld and %ld",
              out.refused, out.outside);
        CHECK(out.far * 1000 < out.points, "to those that drew them, within %.0f and %.0f of 2^-24,"
              " but %ld", out.error[0], out.error[1], out.far);
    }
    subject_free(&s);
}

/* Zeros of both signs have the same numbers, at the seam too; what is no direction has none. */
static void test_directions(void)
{
    const float list[][3] = { { 1, 0, 0 }, { -1, 0, 0 }, { 0, 1, 0 }, { 0, -1, 0 },
                              { 0.6f, 0.8f, 0 }, { -0.6f, 0, 0.8f }, { 0.6f, 0, -0.8f },
                              { 0, -0.6f, -0.8f } };
    const float none[][3] = { { 0, 0, 0 }, { NAN, 0, 1 }, { 0, 0, INFINITY }, { 0, -INFINITY, 1 } };
    int i, signs, c, mapping, differ = 0, far = 0, wrong = 0;
    float normal[3];
    subject s;

    for (mapping = 0; mapping < 3; mapping++) {
        subject_make(&s, "foliage", (envsamp_mapping)mapping, 1500);
        for (i = 0; s.f.kd && i < 8 * 8; i++) {
            const float *plain = list[i / 8];
            float dir[3], u[2] = { 7, 7 }, w[2] = { 7, 7 };

            signs = i % 8;
            make_normal(i % 20, 20, normal);
            for (c = 0; c < 3; c++)
                dir[c] = signs >> c & 1 && !(plain[c] < 0.0f || plain[c] > 0.0f) ? -0.0f : plain[c];
            wrong += envsamp_kd_invert_facing(s.f.kd, normal, dir, u)
                  != envsamp_kd_invert_facing(s.f.kd, normal, plain, w);
            differ += !kd_bits_equal(u, w, sizeof u);
            if (envsamp_kd_pdf_facing(s.f.kd, normal, dir) > 0.0f) {
                const envsamp_sample p = envsamp_kd_sample_facing(s.f.kd, normal, u[0], u[1]);

                far += dot(p.dir, dir) < 1.0 - 1e-6;
            }
        }
        for (i = 0; s.f.kd && i < 4; i++) {
            float u[2] = { 7, 7 };

            make_normal(i, 4, normal);
            wrong += envsamp_kd_invert_facing(s.f.kd, normal, none[i], u) || !is_number(u)
                  || envsamp_kd_pdf_facing(s.f.kd, normal, none[i]) != 0.0f;
        }
        subject_free(&s);
    }
    CHECK(!differ, "zeros of both signs have the same numbers, but for %d", differ);
    CHECK(!far && !wrong, "axes and the seam are drawn again, but %d and %d", far, wrong);
}

/* ---- what the table holds, in double ---- */

/* Shares of light of each block, in order. */
static kd_warp_block *blocks_of(const kd_fixture *f)
{
    kd_warp_block *blocks = (kd_warp_block *)kd_allocate((size_t)f->info.block_count
                                                         * sizeof *blocks);

    kd_warp_blocks(f->kd, blocks, f->info.block_count);
    return blocks;
}

static int parts_of(const kd_fixture *f, const float normal[3], int plain, inside_part *parts)
{
    const double n[3] = { (double)normal[0], (double)normal[1], (double)normal[2] };

    return inside_facing(f->kd, n, plain, parts, PARTS);
}

/* Whether a block lies in a part. */
static int part_has(const inside_part *part, const kd_warp_block *b)
{
    const double u0 = 0.5 * (b->low[0] + b->high[0]) / UNIT;
    const double u1 = 0.5 * (b->low[1] + b->high[1]) / UNIT;

    return u0 > part->low[0] && u0 < part->high[0] && u1 > part->low[1] && u1 < part->high[1];
}

static double part_area(const inside_part *part)
{
    return (part->high[0] - part->low[0]) * (part->high[1] - part->low[1]);
}

/* Light, mean cosine and mean square of it in a block, by what light alone draws from it. */
static void add_block(const kd_fixture *f, const kd_warp_block *b, const float normal[3],
                      double sums[3])
{
    const double area = (b->high[0] - b->low[0]) * (b->high[1] - b->low[1]) / UNIT / UNIT;
    int i;

    for (i = 0; i < 64 && area > 0.0; i++) {
        const double f0 = ((double)(i % 8) + 0.5) / 8.0, f1 = ((double)(i / 8) + 0.5) / 8.0;
        const envsamp_sample p = envsamp_kd_sample(
            f->kd, (float)((b->low[0] + f0 * (b->high[0] - b->low[0])) / UNIT),
            (float)((b->low[1] + f1 * (b->high[1] - b->low[1])) / UNIT));
        const double cosine = dot(p.dir, normal);

        sums[0] += area / 64.0;
        sums[1] += area / 64.0 * cosine;
        sums[2] += area / 64.0 * cosine * cosine;
    }
}

/* Weights are E[c] + sqrt(3/4 E[c^2] + 1/4 E[c]^2 + 4e-3) times the light of the part, and, for what
   is all below the horizon, some thousandths of that light more. An octahedral block that is folded
   is further off, by its few points. */
static void test_weights(const char *name, envsamp_mapping mapping, double slack)
{
    static inside_part parts[PARTS];
    double most = 0.0, least = 0.0, area = 0.0;
    kd_warp_block *blocks;
    int i, k, m, count = 0;
    float normal[3];
    subject s;

    if (subject_make(&s, name, mapping, 600)) {
        blocks = blocks_of(&s.f);
        for (m = 0; m < 6; m++) {
            make_normal(5 * m, 30, normal);
            count = parts_of(&s.f, normal, -1, parts);
            for (i = 0; i < count; i++) {
                double sums[3] = { 0.0, 0.0, 0.0 }, off;

                for (k = 0; k < s.f.info.block_count; k++)
                    if (part_has(&parts[i], &blocks[k]))
                        add_block(&s.f, &blocks[k], normal, sums);
                off = parts[i].weight - sums[1] - sqrt(0.75 * sums[2] * sums[0]
                                                       + 0.25 * sums[1] * sums[1]
                                                       + 4e-3 * sums[0] * sums[0]);
                worst(&most, off / sums[0]);
                worst(&least, -off / sums[0]);
                worst(&area, fabs(sums[0] / part_area(&parts[i]) - 1.0));
            }
        }
        CHECK(count > 20 && area < 1e-5, "%s, %s: %d parts are of whole blocks, to %.1e", name,
              mappings[mapping], count, area);
        CHECK(most < slack && least < slack, "weights are what the cosine is over them, %.1e more "
              "and %.1e less", most, least);
        free(blocks);
    }
    subject_free(&s);
}

/* What a sample should be: where the numbers lie among parts, stretched to that part's place.
   Returns whether it is elsewhere. */
static int compare_sample(const kd_fixture *f, const float normal[3], const inside_part *part,
                          float u0, float u1, double *pdf)
{
    const envsamp_sample p = envsamp_kd_sample_facing(f->kd, normal, u0, u1);
    const double share = part->size[0] * part->size[1] / part_area(part);
    const double f0 = ((double)u0 - part->start[0]) / part->size[0];
    const double f1 = ((double)u1 - part->start[1]) / part->size[1];
    const envsamp_sample q = envsamp_kd_sample(
        f->kd, (float)(part->low[0] + f0 * (part->high[0] - part->low[0])),
        (float)(part->low[1] + f1 * (part->high[1] - part->low[1])));

    const double off = fabs((double)p.pdf / (double)q.pdf / share - 1.0);

    if (!(off < 2e-3) || dot(p.dir, q.dir) < 1.0 - 1e-6)
        return 1;
    worst(pdf, off);
    return 0;
}

/* Samples of numbers that are well inside of a part which floats leave some place for. Weights far
   below the horizon are what is left of two floats. */
static void test_places(const char *name, envsamp_mapping mapping)
{
    static inside_part parts[PARTS];
    pcg32 random = pcg32_make(3, 0);
    double pdf = 0.0, area = 0.0;
    float normal[3], density = 0.0f;
    int i, k, m, count, leaves = 0, samples = 0, astray = 0;
    subject s;

    if (subject_make(&s, name, mapping, 1500)) {
        for (m = 0; m < 20; m++) {
            make_normal(m, 20, normal);
            count = parts_of(&s.f, normal, -1, parts);
            for (i = 0; i < count; i++) {
                if (parts[i].link & KD_LINK)
                    continue;
                leaves++;
                area += parts[i].size[0] * parts[i].size[1];
                memcpy(&density, &parts[i].link, sizeof density);
                worst(&pdf, fabs((double)density * part_area(&parts[i]) - 1.0));
                for (k = 0; k < 4 && fmin(parts[i].size[0], parts[i].size[1]) > 1e-3; k++) {
                    const double f0 = 0.1 + 0.8 * (double)pcg32_float(&random);
                    const double f1 = 0.1 + 0.8 * (double)pcg32_float(&random);

                    samples++;
                    astray += compare_sample(&s.f, normal, &parts[i],
                                             (float)(parts[i].start[0] + f0 * parts[i].size[0]),
                                             (float)(parts[i].start[1] + f1 * parts[i].size[1]),
                                             &pdf);
                }
            }
        }
        CHECK(leaves > 2000 && fabs(area / 20.0 - 1.0) < 1e-9, "%s, %s: %d parts fill the unit "
              "square", name, mappings[mapping], leaves);
        CHECK(astray * 500 < samples, "samples are where weights put them, with densities to %.1e; "
              "but %d of %d", pdf, astray, samples);
    }
    subject_free(&s);
}

/* ---- chi-square ---- */

typedef enum fault { HONEST = 0, TURNED, SWAPPED, FAULTS } fault;

/* How often blocks should be drawn. `plain`: see inside.h; LIGHT_ALONE: all levels are. */
#define LIGHT_ALONE 99

static void expect_blocks(const kd_fixture *f, const float normal[3], int plain, double *expected)
{
    static inside_part parts[PARTS];
    kd_warp_block *blocks = blocks_of(f);
    const int count = parts_of(f, normal, plain, parts);
    int i, k;

    for (k = 0; k < f->info.block_count; k++) {
        const double area = (blocks[k].high[0] - blocks[k].low[0])
                          * (blocks[k].high[1] - blocks[k].low[1]) / UNIT / UNIT;

        expected[k] = plain == LIGHT_ALONE ? area : 0.0;
        for (i = 0; i < count && plain != LIGHT_ALONE; i++)
            if (!(parts[i].link & KD_LINK) && part_has(&parts[i], &blocks[k]))
                expected[k] = area * parts[i].size[0] * parts[i].size[1] / part_area(&parts[i]);
    }
    free(blocks);
}

static void draw_blocks(const kd_fixture *f, const kd_cover *cover, const float normal[3],
                        fault kind, int count, double *hits)
{
    pcg32 random = pcg32_make(4, (uint64_t)kind);
    const double turn = kind == TURNED ? KD_PI / 18.0 : 0.0;
    float n[3];
    int i;

    n[0] = (float)(cos(turn) * (double)normal[0] - sin(turn) * (double)normal[1]);
    n[1] = (float)(sin(turn) * (double)normal[0] + cos(turn) * (double)normal[1]);
    n[2] = normal[2];
    for (i = 0; i < f->info.block_count; i++)
        hits[i] = 0.0;
    for (i = 0; i < count; i++) {
        const float u0 = pcg32_float(&random);
        envsamp_sample p = envsamp_kd_sample_facing(f->kd, n, u0, pcg32_float(&random));
        double u, v;

        if (kind == SWAPPED) {
            const float keep = p.dir[0];

            p.dir[0] = p.dir[1];
            p.dir[1] = keep;
        }
        kd_point(p.dir, &u, &v);
        hits[kd_cover_owner(cover, u, v)] += 1.0;
    }
}

static void must_reject(const char *what, const double *expected, const double *hits, int count)
{
    const stat_result result = stat_chi2_test(expected, hits, (size_t)count, NULL);

    CHECK(result.verdict == STAT_REJECTED, "rejected: %s, chi2 %.0f of %.0f, %s", what, result.chi2,
          result.dof, stat_verdict_string(result.verdict));
}

/* Blocks of a map that is constant over texels, drawn as the weights in the table say. */
static void test_blocks(const char *name, int faults)
{
    static const char *const what[FAULTS] = { "", "a normal that is turned by 10 degrees",
                                              "x and y swapped" };
    const envsamp_kd_desc desc = facing_desc(600, 1);
    const float oblique[3] = { 0.48f, 0.6f, 0.64f };
    double *expected, *hits;
    kd_cover cover;
    int i, k, count;
    float normal[3];
    char level[64];
    subject s;

    map_make(name, 128, 64, &s.map);
    if (subject_build(&s, ENVSAMP_LATLONG, &desc)) {
        count = s.f.info.block_count;
        cover = kd_cover_make(&s.f);
        expected = (double *)kd_allocate((size_t)count * sizeof *expected);
        hits = (double *)kd_allocate((size_t)count * sizeof *hits);
        for (i = 0; i < 4; i++) {
            stat_result result;

            memcpy(normal, oblique, sizeof normal);
            if (i)
                make_normal(i - 1, 3, normal);
            expect_blocks(&s.f, normal, -1, expected);
            draw_blocks(&s.f, &cover, normal, HONEST, 1 << 19, hits);
            result = stat_chi2_test(expected, hits, (size_t)count, NULL);
            CHECK(result.pass, "%s: %d blocks at normal %d: %s, p = %.3g", name, count, i,
                  stat_verdict_string(result.verdict), result.p);
        }
        for (k = TURNED; k < FAULTS && faults; k++) {
            expect_blocks(&s.f, oblique, -1, expected);
            draw_blocks(&s.f, &cover, oblique, (fault)k, 1 << 19, hits);
            must_reject(what[k], expected, hits, count);
        }
        draw_blocks(&s.f, &cover, oblique, HONEST, 1 << 19, hits);
        for (k = 0; k < 7 && faults; k++) {
            expect_blocks(&s.f, oblique, k < 6 ? k : LIGHT_ALONE, expected);
            snprintf(level, sizeof level, "weights left out at level %d", k);
            must_reject(k < 6 ? level : "light alone", expected, hits, count);
        }
        kd_cover_free(&cover);
        free(expected);
        free(hits);
    }
    subject_free(&s);
}

/* ---- what it is good for ---- */

/* Root of the mean square of the relative error of irradiance, over normals and seeds. `facing`: by
   light x cosine. `sobol`: by Owen-Sobol points. */
static double error_of(const subject *s, int count, int facing, int sobol, int seeds)
{
    const float none[3] = { 0, 0, 0 };
    float normals[NORMALS][3];
    double known[NORMALS + 1], sum = 0.0;
    int i, k, seed;

    for (i = 0; i < NORMALS; i++)
        make_normal(i, NORMALS, normals[i]);
    sum_map(s, NORMALS, normals, known);
    for (i = 0; i < NORMALS; i++)
        for (seed = 0; seed < seeds; seed++) {
            pcg32 random = pcg32_make((uint64_t)seed, (uint64_t)i);
            const uint32_t scramble = hash_combine((uint32_t)seed, (uint32_t)i);
            double mean = 0.0;

            for (k = 0; k < count; k++) {
                float u[2];
                envsamp_sample p;

                u[0] = pcg32_float(&random);
                u[1] = pcg32_float(&random);
                if (sobol)
                    sobol_owen((uint32_t)k, scramble, u);
                p = envsamp_kd_sample_facing(s->f.kd, facing ? normals[i] : none, u[0], u[1]);
                mean += radiance(s, p.dir) / (double)p.pdf * fmax(dot(p.dir, normals[i]), 0.0);
            }
            mean = mean / (double)count / known[i] - 1.0;
            sum += mean * mean;
        }
    return sqrt(sum / (double)NORMALS / (double)seeds);
}

/* Irradiance needs far fewer samples than of light alone. */
static void test_errors(const char *name, double most, double most_of_points)
{
    double facing, alone;
    subject s;

    if (subject_make(&s, name, ENVSAMP_LATLONG, 6144)) {
        facing = error_of(&s, 16, 1, 0, 32);
        alone = error_of(&s, 16, 0, 0, 32);
        CHECK(facing < most * alone, "%s: 16 independent numbers err by %.4f facing, by %.4f of "
              "light alone", name, facing, alone);
        facing = error_of(&s, 16, 1, 1, 32);
        alone = error_of(&s, 16, 0, 1, 32);
        CHECK(facing < most_of_points * alone, "%s: 16 Owen-Sobol points err by %.4f facing, "
              "by %.4f of light alone", name, facing, alone);
    }
    subject_free(&s);
}

/* Strata of the unit square stay together on the sphere, so what is smooth converges faster. */
static void test_strata(const char *name)
{
    double points, numbers;
    int count;
    subject s;

    if (subject_make(&s, name, ENVSAMP_LATLONG, 6144))
        for (count = 256; count <= 1024; count *= 4) {
            points = error_of(&s, count, 1, 1, 8);
            numbers = error_of(&s, count, 1, 0, 8);
            CHECK(points * points < 0.6 * numbers * numbers, "%s: %d Owen-Sobol points err by "
                  "%.5f, independent numbers by %.5f", name, count, points, numbers);
        }
    subject_free(&s);
}

/* ---- normals that are none ---- */

/* How many results differ from those of light alone. */
static int differences_from_light(const envsamp_kd *kd, const float normal[3])
{
    enum { COUNT = 130 };
    static float u[2][COUNT], facing[4][COUNT], alone[4][COUNT];
    pcg32 random = pcg32_make(5, 0);
    int i, differ = 0;

    for (i = 0; i < COUNT; i++) {
        envsamp_sample p, q;
        float a[2], b[2], pdf, expected;

        u[0][i] = pcg32_float(&random);
        u[1][i] = pcg32_float(&random);
        p = envsamp_kd_sample_facing(kd, normal, u[0][i], u[1][i]);
        q = envsamp_kd_sample(kd, u[0][i], u[1][i]);
        differ += !same_sample(&p, &q);
        kd_random_direction(&random, p.dir);
        pdf = envsamp_kd_pdf_facing(kd, normal, p.dir);
        expected = envsamp_kd_pdf(kd, p.dir);
        differ += !kd_bits_equal(&pdf, &expected, sizeof pdf);
        differ += envsamp_kd_invert_facing(kd, normal, p.dir, a) != envsamp_kd_invert(kd, p.dir, b)
               || !kd_bits_equal(a, b, sizeof a);
    }
    envsamp_kd_sample_facing_n(kd, normal, COUNT, u[0], u[1], facing[0], facing[1], facing[2],
                               facing[3]);
    envsamp_kd_sample_n(kd, COUNT, u[0], u[1], alone[0], alone[1], alone[2], alone[3]);
    differ += !kd_bits_equal(facing, alone, sizeof facing);
    envsamp_kd_pdf_facing_n(kd, normal, COUNT, alone[0], alone[1], alone[2], facing[3]);
    envsamp_kd_pdf_n(kd, COUNT, alone[0], alone[1], alone[2], alone[3]);
    return differ + !kd_bits_equal(facing, alone, sizeof facing);
}

static void test_no_normals(void)
{
    const float tiny = FLT_MIN / 2;
    const float none[][3] = { { 0, 0, 0 }, { -0.0f, -0.0f, 0 }, { NAN, 0, 1 }, { 0, -NAN, 1 },
                              { 1, 0, NAN }, { INFINITY, 0, 0 }, { 0, -INFINITY, 1 },
                              { 1, 0, INFINITY }, { 1e-45f, 0, 0 }, { 0, -1e-40f, 1e-41f },
                              { FLT_MIN / 2, FLT_MIN / 4, -FLT_MIN / 2 } };
    const float up[3] = { 0, 0, 1 }, slanted[3] = { 1, tiny, -tiny };
    int i, differ = 0;
    subject s;

    if (subject_make(&s, "foliage", ENVSAMP_LATLONG, 1500)) {
        for (i = 0; i < (int)(sizeof none / sizeof none[0]); i++)
            differ += differences_from_light(s.f.kd, none[i]);
        CHECK(!differ, "with what is no normal all is light alone, but for %d", differ);
        CHECK(differences_from_light(s.f.kd, up) && differences_from_light(s.f.kd, slanted),
              "which normals are not");
        CHECK(s.f.info.facing != 0, "info says that a table has the data");
    }
    subject_free(&s);
}

/* Tables without the data: not asked for, one block, other selections. */
static void test_no_data(void)
{
    const float normal[3] = { 0.6f, 0, 0.8f };
    int i, wrong = 0, refused = 0;
    envsamp_kd_job *job;
    envsamp_sizes sizes;
    subject s;

    for (i = 0; i < 4; i++) {
        envsamp_kd_desc desc = facing_desc(i == 1 ? 1 : 500, 0);

        desc.facing = i == 1;
        desc.select = i < 2 ? ENVSAMP_KD_WARP : i == 2 ? ENVSAMP_KD_ALIAS : ENVSAMP_KD_FIT;
        map_make("foliage", 64, 32, &s.map);
        if (subject_build(&s, ENVSAMP_LATLONG, &desc))
            wrong += s.f.info.facing != 0 || differences_from_light(s.f.kd, normal);
        if (s.f.kd && i > 1) {
            desc.facing = 1;
            refused += envsamp_kd_sizes(&s.view, &desc, &sizes) == ENVSAMP_ERR_PARAM
                    && sizes.table_bytes == 0 && sizes.scratch_bytes == 0;
            refused += envsamp_kd_build(&s.view, &desc, s.f.table.buffer, s.f.scratch.buffer,
                                        &s.f.kd) == ENVSAMP_ERR_PARAM && !s.f.kd;
            refused += envsamp_kd_build_rows(&s.view, NULL, NULL, &desc, s.f.table.buffer,
                                             s.f.scratch.buffer, &s.f.kd) == ENVSAMP_ERR_PARAM;
            refused += envsamp_kd_begin(&s.view, NULL, NULL, &desc, s.f.table.buffer,
                                        s.f.scratch.buffer, &job) == ENVSAMP_ERR_PARAM && !job;
        }
        subject_free(&s);
    }
    CHECK(!wrong, "tables without the data say so, and are light alone, but for %d", wrong);
    CHECK(refused == 8, "ALIAS and FIT cannot have them: %d of 8 calls say so", refused);
}

/* The length of a normal does not matter: powers of two change no bit. */
static void test_lengths(void)
{
    const float lengths[] = { 0x1p-100f, 0x1p40f, 0x1p120f, 1e30f, 1e-30f, 1e37f, 2e-37f, 3.0f };
    pcg32 random = pcg32_make(6, 0);
    int i, k, c, differ = 0, far = 0;
    subject s;

    if (subject_make(&s, "foliage", ENVSAMP_LATLONG, 1500))
        for (i = 0; i < 400; i++) {
            float normal[3], longer[3], u[2], pdf, other;
            envsamp_sample p, q;

            make_normal(i % 50, 50, normal);
            u[0] = pcg32_float(&random);
            u[1] = pcg32_float(&random);
            p = envsamp_kd_sample_facing(s.f.kd, normal, u[0], u[1]);
            pdf = envsamp_kd_pdf_facing(s.f.kd, normal, p.dir);
            for (k = 0; k < 8; k++) {
                for (c = 0; c < 3; c++)
                    longer[c] = normal[c] * lengths[k];
                q = envsamp_kd_sample_facing(s.f.kd, longer, u[0], u[1]);
                other = envsamp_kd_pdf_facing(s.f.kd, longer, p.dir);
                if (k < 3)
                    differ += !same_sample(&p, &q) && fabs((double)normal[1]) > 1e-6;
                far += dot(p.dir, q.dir) < 1.0 - 1e-5
                    || !(fabs((double)other / (double)pdf - 1.0) < 1e-3);
            }
        }
    CHECK(!differ, "powers of two of a normal are the same, but for %d", differ);
    CHECK(far < 3, "and other lengths nearly so, but for %d of 3200", far);
    subject_free(&s);
}

/* ---- batches ---- */

enum { MOST = 1000 };

typedef struct batch { float x[MOST], y[MOST], z[MOST], w[MOST]; } batch;

static const float nasty[] = { 0.0f, -0.0f, 1.0f, -1.0f, 0.99999994f, NAN, -NAN, INFINITY,
                               -INFINITY, FLT_MAX, FLT_MIN / 4, -0.25f, 1.5f };
enum { NASTIES = sizeof nasty / sizeof nasty[0] };

static void batch_fill(batch *b, pcg32 *random)
{
    int i;

    for (i = 0; i < MOST; i++) {
        b->x[i] = i % 7 ? pcg32_float(random) : nasty[pcg32_next(random) % NASTIES];
        b->y[i] = i % 5 ? pcg32_float(random) : nasty[pcg32_next(random) % NASTIES];
        b->z[i] = i % 9 ? pcg32_float(random) - 0.5f : nasty[pcg32_next(random) % NASTIES];
        b->w[i] = 7.0f;
    }
}

/* How many results of batches differ from calls one at a time, or were written beyond the end. */
static int batch_differences(const envsamp_kd *kd, const float normal[3], int n, int way)
{
    static batch in, out, dirs;
    pcg32 random = pcg32_make(7, (uint64_t)way);
    float *pdf = way == 0 ? dirs.w : way == 1 ? dirs.x : way == 2 ? dirs.y : dirs.z;
    const float *u0 = way % 2 ? out.x : in.x, *u1 = way % 2 ? out.y : in.y;
    int i, differ = 0;

    batch_fill(&in, &random);
    out = in;
    envsamp_kd_sample_facing_n(kd, normal, (size_t)n, u0, u1, out.x, out.y, out.z, out.w);
    for (i = 0; i < n; i++) {
        const envsamp_sample s = envsamp_kd_sample_facing(kd, normal, in.x[i], in.y[i]);
        const float got[4] = { out.x[i], out.y[i], out.z[i], out.w[i] };

        differ += !is_sound(&s) || !kd_bits_equal(got, s.dir, sizeof s.dir)
               || !kd_bits_equal(&got[3], &s.pdf, sizeof(float));
    }
    for (i = n; i < MOST; i++)
        differ += !kd_bits_equal(&out.x[i], &in.x[i], 4) || !kd_bits_equal(&out.y[i], &in.y[i], 4)
               || !kd_bits_equal(&out.z[i], &in.z[i], 4) || !kd_bits_equal(&out.w[i], &in.w[i], 4);
    batch_fill(&in, &random);
    dirs = in;
    envsamp_kd_pdf_facing_n(kd, normal, (size_t)n, dirs.x, dirs.y, dirs.z, pdf);
    for (i = 0; i < MOST; i++) {
        const float dir[3] = { in.x[i], in.y[i], in.z[i] };
        const float one = i < n ? envsamp_kd_pdf_facing(kd, normal, dir)
                        : way == 0 ? in.w[i] : dir[way - 1];

        differ += !kd_bits_equal(&pdf[i], &one, sizeof one) || (i < n && !(one >= 0.0f));
    }
    return differ;
}

static void test_batches(void)
{
    const int sizes[] = { 0, 1, 63, 64, 65, 1000 };
    int mapping, k, way, differ = 0;
    float normal[3];
    subject s;

    for (mapping = 0; mapping < 3; mapping++) {
        if (subject_make(&s, "night", (envsamp_mapping)mapping, 1500)) {
            for (k = 0; k < 6; k++)
                for (way = 0; way < 4; way++) {
                    make_normal(k + 6 * way, 24, normal);
                    differ += batch_differences(s.f.kd, normal, sizes[k], way);
                }
            envsamp_kd_sample_facing_n(s.f.kd, normal, 0, NULL, NULL, NULL, NULL, NULL, NULL);
            envsamp_kd_pdf_facing_n(s.f.kd, normal, 0, NULL, NULL, NULL, NULL);
        }
        subject_free(&s);
    }
    CHECK(!differ, "batches are calls one at a time, in place too, but for %d", differ);
}

/* ---- maps of extremes ---- */

static const float corners[] = { 0.0f, 0.99999994f, 1.0f, -1.0f, NAN, INFINITY, -INFINITY, -0.0f,
                                 0.5f, 1e-45f, 0.99999988f };
enum { CORNERS = sizeof corners / sizeof corners[0], TRIALS = CORNERS * CORNERS + 200 };

/* Whether a texel that a direction may be looked up in is lit. */
static int is_lit(const subject *s, const float dir[3])
{
    float rgb[3], moved[3];
    int i, lit = 0;

    for (i = 0; i < 27; i++) {
        moved[0] = dir[0] + 1e-6f * (float)(i % 3 - 1);
        moved[1] = dir[1] + 1e-6f * (float)(i / 3 % 3 - 1);
        moved[2] = dir[2] + 1e-6f * (float)(i / 9 - 1);
        envsamp_lookup(&s->view, s->f.desc.nearest, moved, rgb);
        lit |= rgb[0] > 0.0f;
    }
    return lit;
}

/* Faults of samples, densities and inverses of all kinds of numbers. `lit`: there are blocks enough
   that none has both light and nothing. */
static int count_faults(const subject *s, const float normal[3], int lit)
{
    pcg32 random = pcg32_make(8, 0);
    int i, faults = 0;

    for (i = 0; i < TRIALS; i++) {
        const int known = i < CORNERS * CORNERS;
        const float u0 = known ? corners[i % CORNERS] : pcg32_float(&random);
        const float u1 = known ? corners[i / CORNERS] : pcg32_float(&random);
        const envsamp_sample p = envsamp_kd_sample_facing(s->f.kd, normal, u0, u1);
        float pdf = envsamp_kd_pdf_facing(s->f.kd, normal, p.dir), u[2] = { 7, 7 }, dir[3];

        faults += !is_sound(&p) || !(pdf >= 0.0f && pdf <= FLT_MAX)
               || (lit && !is_lit(s, p.dir));
        faults += envsamp_kd_invert_facing(s->f.kd, normal, p.dir, u) != (pdf > 0.0f)
               || !is_number(u);
        kd_random_direction(&random, dir);
        pdf = envsamp_kd_pdf_facing(s->f.kd, normal, dir);
        faults += (pdf > 0.0f) != (envsamp_kd_pdf(s->f.kd, dir) > 0.0f) || !(pdf <= FLT_MAX);
    }
    return faults;
}

/* Checks a map at normals all round. */
static void check_map(const char *what, const subject *s, int blocks)
{
    double most = 0.0;
    float normal[3];
    int i, faults = 0;

    for (i = 0; i < 16; i++) {
        make_normal(i, 16, normal);
        faults += count_faults(s, normal, blocks > 1000);
        worst(&most, fabs(integral_of_pdf(&s->f, normal) - 1.0));
    }
    CHECK(!faults, "%s, %d blocks: samples are sound, and hit light, but for %d", what, blocks,
          faults);
    CHECK(most < 1e-4, "%s, %d blocks: densities integrate to 1, to %.1e", what, blocks, most);
}

/* Leaves light in some of the rows and columns only, and nothing else, which is checked. */
static void test_lit(const char *what, const char *name, int x0, int x1, int y0, int y1)
{
    const int counts[] = { 2, 100, 6144 };
    int i, x, y;
    subject s;

    for (i = 0; i < 3; i++) {
        const envsamp_kd_desc desc = facing_desc(counts[i], 1);

        map_make(name, 64, 32, &s.map);
        for (y = 0; y < 32; y++)
            for (x = 0; x < 64; x++)
                if (x < x0 || x >= x1 || y < y0 || y >= y1)
                    memset(s.map.rgb + 3 * (64 * y + x), 0, 3 * sizeof(float));
        if (subject_build(&s, ENVSAMP_LATLONG, &desc))
            check_map(what, &s, counts[i]);
        subject_free(&s);
    }
}

/* All light is below the horizon of the normal, but the integral is found with it. */
static void test_below(void)
{
    const envsamp_kd_desc desc = facing_desc(1500, 1);
    const float up[3] = { 0, 0, 1 }, side[3] = { 0.6f, 0, 0.8f };
    stat_moments moments[2] = { { 0.0, 0.0, 0.0 }, { 0.0, 0.0, 0.0 } };
    pcg32 random = pcg32_make(9, 0);
    double known[1] = { 0.0 };
    int i, k;
    subject s;

    map_make("foliage", 64, 32, &s.map);
    memset(s.map.rgb, 0, 3 * 64 * 20 * sizeof(float));
    if (subject_build(&s, ENVSAMP_LATLONG, &desc)) {
        sum_map(&s, 0, NULL, known);
        for (i = 0; i < 2; i++)
            for (k = 0; k < 40000; k++) {
                const float u0 = pcg32_float(&random);

                stat_moments_add(&moments[i], estimate(&s, i ? side : up, 0, u0,
                                                       pcg32_float(&random)));
            }
        CHECK(stat_mean_test(&moments[0], known[0], 1e-4 * known[0]) > STAT_ALPHA
              && stat_mean_test(&moments[1], known[0], 1e-4 * known[0]) > STAT_ALPHA,
              "light below the horizon is found: %.6g and %.6g of %.6g", moments[0].mean,
              moments[1].mean, known[0]);
    }
    subject_free(&s);
}

static void test_small(int width, int height, envsamp_mapping mapping, int blocks)
{
    const envsamp_kd_desc desc = facing_desc(blocks, blocks % 2);
    pcg32 random = pcg32_make(10, (uint64_t)width);
    char what[64];
    subject s;
    int i;

    image_alloc(&s.map, width, height);
    for (i = 0; i < 3 * width * height; i++)
        s.map.rgb[i] = 0.01f + pcg32_float(&random);
    snprintf(what, sizeof what, "%dx%d, %s", width, height, mappings[mapping]);
    if (subject_build(&s, mapping, &desc))
        check_map(what, &s, blocks);
    CHECK(kd_fixture_intact(&s.f) && (blocks > 1 || !s.f.info.facing),
          "and nothing is written beside the buffers");
    subject_free(&s);
}

static void test_small_maps(void)
{
    const int sizes[][2] = { { 1, 1 }, { 1, 40 }, { 40, 1 }, { 3, 2 } };
    const int counts[] = { 1, 2, 3, 500, 16384 };
    int i, k;

    for (i = 0; i < 4; i++)
        for (k = 0; k < 5; k++)
            test_small(sizes[i][0], sizes[i][1], (envsamp_mapping)((i + k) % 3), counts[k]);
    test_small(96, 48, ENVSAMP_LATLONG, 16384);
}

/* ---- memory, steps, rows ---- */

/* A number of what samples, densities and inverses are. */
static uint32_t fingerprint(const envsamp_kd *kd)
{
    pcg32 random = pcg32_make(11, 0);
    uint32_t sum = 0;
    int i, c;

    for (i = 0; i < 500; i++) {
        float normal[3], values[7] = { 0 };
        const float u0 = pcg32_float(&random);
        envsamp_sample s;

        kd_random_direction(&random, normal);
        s = envsamp_kd_sample_facing(kd, normal, u0, pcg32_float(&random));
        memcpy(values, s.dir, sizeof s.dir);
        values[3] = s.pdf;
        values[4] = envsamp_kd_pdf_facing(kd, normal, s.dir);
        envsamp_kd_invert_facing(kd, normal, s.dir, values + 5);
        for (c = 0; c < 7; c++)
            sum = hash_combine(sum, inside_word(values, sizeof(float) * (size_t)c));
    }
    return sum;
}

static void test_memory(envsamp_mapping mapping)
{
    envsamp_buffer table, scratch;
    const envsamp_kd *kd;
    uint32_t before;
    kd_guarded copy;
    size_t bytes;
    subject s;
    int i;

    if (subject_make(&s, "foliage", mapping, 1500)) {
        CHECK(kd_fixture_intact(&s.f), "%s: sizes are enough", mappings[mapping]);
        before = fingerprint(s.f.kd);
        memset(s.f.scratch.buffer.data, 0x5a, s.f.scratch.buffer.bytes);
        bytes = envsamp_kd_bytes(s.f.kd);
        CHECK(fingerprint(s.f.kd) == before && bytes <= s.f.sizes.table_bytes,
              "a table does not need the scratch memory");
        copy = kd_guarded_make(bytes, 0);
        memcpy(copy.buffer.data, s.f.kd, bytes);
        memset(s.f.table.buffer.data, 0x5a, s.f.table.buffer.bytes);
        CHECK(envsamp_kd_open(copy.buffer.data, bytes, &kd) == ENVSAMP_OK && kd
              && fingerprint(kd) == before, "a copy samples the same");
        CHECK(envsamp_kd_open(copy.buffer.data, bytes - 1, &kd) == ENVSAMP_ERR_FORMAT,
              "but not all but one byte of it");
        free(copy.block);
        for (i = 0; i < 2; i++) {
            table = s.f.table.buffer;
            scratch = s.f.scratch.buffer;
            *(i ? &table.bytes : &scratch.bytes) -= 1;
            CHECK(envsamp_kd_build(&s.view, &s.f.desc, table, scratch, &kd) == ENVSAMP_ERR_MEMORY
                  && !kd, "a byte less of %s is refused", i ? "table" : "scratch");
        }
    }
    subject_free(&s);
}

/* Rows of an image, of which one fails. */
typedef struct rows { const envsamp_image *image; int calls, fail_at; } rows;

static envsamp_result give_row(int y, float *row, void *user)
{
    rows *r = (rows *)user;
    const size_t floats = (size_t)r->image->width * (size_t)r->image->channels;

    if (r->calls++ == r->fail_at)
        return ENVSAMP_ERR_PARAM;
    memcpy(row, r->image->pixels + (size_t)y * floats, floats * sizeof *row);
    return ENVSAMP_OK;
}

/* Another build into buffers of its own: in steps, or from rows. */
typedef struct build {
    kd_guarded table, scratch;
    const envsamp_kd *kd;
    envsamp_result result;
} build;

static build build_make(const subject *s)
{
    build b;

    b.table = kd_guarded_make(s->f.sizes.table_bytes, 0xee);
    b.scratch = kd_guarded_make(s->f.sizes.scratch_bytes, 0x11);
    b.kd = (const envsamp_kd *)(const void *)"not a table";
    b.result = ENVSAMP_OK;
    return b;
}

static int build_same(const build *b, const subject *s)
{
    return b->result == ENVSAMP_OK && b->kd
        && envsamp_kd_bytes(b->kd) == envsamp_kd_bytes(s->f.kd)
        && kd_bits_equal(b->kd, s->f.kd, envsamp_kd_bytes(s->f.kd))
        && kd_guarded_intact(&b->table) && kd_guarded_intact(&b->scratch);
}

static void build_free(build *b)
{
    free(b->table.block);
    free(b->scratch.block);
}

static void test_steps(const subject *s, int count)
{
    build b = build_make(s);
    envsamp_kd_job *job;
    int done = 0, steps = 0;

    b.result = envsamp_kd_begin(&s->view, NULL, NULL, &s->f.desc, b.table.buffer, b.scratch.buffer,
                                &job);
    for (; b.result == ENVSAMP_OK && !done; steps++)
        b.result = envsamp_kd_step(job, count, &done);
    if (b.result == ENVSAMP_OK)
        b.result = envsamp_kd_finish(job, &b.kd);
    CHECK(build_same(&b, s) && steps > 20, "%d steps of %d items build the same", steps, count);
    build_free(&b);
}

static void test_rows(const subject *s)
{
    const int places[] = { -1, 0, 5, s->view.height - 1 };
    const envsamp_kd *kd;
    envsamp_image view = s->view;
    int i;

    for (i = 0; i < 4; i++) {
        build b = build_make(s);
        rows r = { &s->view, 0, 0 };

        r.fail_at = places[i];
        view.pixels = NULL;             /* not read */
        b.result = envsamp_kd_build_rows(&view, give_row, &r, &s->f.desc, b.table.buffer,
                                         b.scratch.buffer, &b.kd);
        if (i == 0)
            CHECK(build_same(&b, s) && r.calls == view.height, "rows of a function build the same");
        else
            CHECK(b.result == ENVSAMP_ERR_PARAM && !b.kd && r.calls == places[i] + 1,
                  "what it returns at row %d ends the build", places[i]);
        if (i == 1) {
            b.result = envsamp_kd_build_rows(&s->view, NULL, NULL, &s->f.desc, b.table.buffer,
                                             b.scratch.buffer, &b.kd);
            CHECK(build_same(&b, s), "so do pixels, where there is no function");
        }
        if (i == 2) {
            envsamp_buffer none = { NULL, 0 };

            CHECK(envsamp_kd_build_rows(&view, NULL, NULL, &s->f.desc, b.table.buffer,
                                        b.scratch.buffer, &kd) == ENVSAMP_ERR_NULL && !kd
                  && envsamp_kd_build_rows(NULL, give_row, &r, &s->f.desc, b.table.buffer,
                                           b.scratch.buffer, &kd) == ENVSAMP_ERR_NULL && !kd
                  && envsamp_kd_build_rows(&view, give_row, &r, &s->f.desc, none, b.scratch.buffer,
                                           &kd) == ENVSAMP_ERR_NULL && !kd
                  && envsamp_kd_build_rows(&view, give_row, &r, &s->f.desc, b.table.buffer, none,
                                           &kd) == ENVSAMP_ERR_NULL && !kd
                  && envsamp_kd_build_rows(&view, give_row, &r, &s->f.desc, b.table.buffer,
                                           b.scratch.buffer, NULL) == ENVSAMP_ERR_NULL,
                  "NULL is refused");
        }
        build_free(&b);
    }
}

static void test_builds(void)
{
    subject s;

    if (subject_make(&s, "foliage", ENVSAMP_LATLONG, 1500)) {
        test_steps(&s, 1);
        test_steps(&s, 7);
        test_rows(&s);
    }
    subject_free(&s);
}

/* ---- damage ---- */

/* Whether all that a table of any numbers gives is in its range. */
static int survives(const envsamp_kd *kd, pcg32 *random)
{
    enum { COUNT = 6 };
    float u[2][COUNT], out[4][COUNT], pdf[COUNT], normal[3], inverse[2];
    int i, ok = 1;

    kd_random_direction(random, normal);
    if (pcg32_next(random) % 4 == 0)
        make_normal((int)(pcg32_next(random) % 4), 4, normal);
    for (i = 0; i < COUNT; i++) {
        u[0][i] = i == 0 ? 0.0f : i == 1 ? 0.99999994f : pcg32_float(random);
        u[1][i] = i == 0 ? 0.0f : pcg32_float(random);
    }
    envsamp_kd_sample_facing_n(kd, normal, COUNT, u[0], u[1], out[0], out[1], out[2], out[3]);
    envsamp_kd_pdf_facing_n(kd, normal, COUNT, out[0], out[1], out[2], pdf);
    for (i = 0; i < COUNT; i++) {
        const envsamp_sample s = envsamp_kd_sample_facing(kd, normal, u[0][i], u[1][i]);
        const float got[4] = { out[0][i], out[1][i], out[2][i], out[3][i] };
        const float one = envsamp_kd_pdf_facing(kd, normal, s.dir);

        ok &= fabs(dot(s.dir, s.dir) - 1.0) < 3e-6 && s.pdf >= 0.0f && s.pdf <= FLT_MAX;
        ok &= kd_bits_equal(got, s.dir, sizeof s.dir) && kd_bits_equal(&got[3], &s.pdf, 4);
        ok &= one >= 0.0f && one <= FLT_MAX && kd_bits_equal(&one, &pdf[i], sizeof one);
        envsamp_kd_invert_facing(kd, normal, s.dir, inverse);
        ok &= is_number(inverse);
    }
    return ok;
}

/* Damages the word at a place of a copy, seals it, and has it sampled if it opens. */
static void damage_word(const kd_fixture *f, envsamp_buffer copy, size_t at, uint32_t word,
                        pcg32 *random, int counts[3])
{
    const envsamp_kd *kd;
    envsamp_result result;

    memcpy((char *)copy.data + at, &word, sizeof word);
    inside_seal(copy.data, copy.bytes);
    result = envsamp_kd_open(copy.data, copy.bytes, &kd);
    counts[0]++;
    if (result == ENVSAMP_OK) {
        counts[1]++;
        counts[2] += !survives(kd, random) || !survives(kd, random);
    } else {
        counts[2] += result != ENVSAMP_ERR_FORMAT || kd;
    }
    memcpy((char *)copy.data + at, (const char *)f->kd + at, sizeof word);
}

/* Every word of `facing`, and where it is: each a bit flipped, some bits, and numbers that are
   none. */
static void test_damage(envsamp_mapping mapping)
{
    static const uint32_t words[] = { 0, 0x80000000u, 0x7f800000u, 0xff800000u, 0x7fc00000u,
                                      0x3f800000u, 0xbf800000u, 0x40800000u, 0xc0800000u,
                                      0x00000001u, 0xffffffffu };
    pcg32 random = pcg32_make(12, 0);
    int counts[3] = { 0, 0, 0 }, facing[3] = { 0, 0, 0 }, bit, i;
    const size_t fields[] = { KD_AT(facing_count), KD_AT(facing_at) };
    kd_guarded copy;
    size_t bytes, at;
    subject s;

    if (subject_make(&s, "foliage", mapping, 100)) {
        bytes = envsamp_kd_bytes(s.f.kd);
        copy = kd_guarded_make(bytes, 0);
        memcpy(copy.buffer.data, s.f.kd, bytes);
        for (i = 0; i < 2; i++)
            for (bit = 0; bit < 32; bit++)
                damage_word(&s.f, copy.buffer, fields[i],
                            inside_word(s.f.kd, fields[i]) ^ 1u << bit, &random, counts);
        CHECK(counts[0] == 64 && !counts[1] && !counts[2], "facing_count and facing_at: of %d that "
              "are damaged %d open", counts[0], counts[1]);
        for (at = KD_WORD(s.f.kd, facing_at); at < bytes; at += 4) {
            const uint32_t word = inside_word(s.f.kd, at);

            for (i = 0; i < 11; i++)
                damage_word(&s.f, copy.buffer, at, words[i], &random, facing);
            for (bit = (int)(at / 4 % 3); bit < 32; bit += 3)
                damage_word(&s.f, copy.buffer, at, word ^ 1u << bit, &random, facing);
        }
        CHECK(facing[0] > 2000 && facing[1] > 100 && !facing[2], "%s: of %d tables with damaged "
              "weights %d open, of which %d do not sample", mappings[mapping], facing[0],
              facing[1], facing[2]);
        free(copy.block);
    }
    subject_free(&s);
}

/* Words of a node: cuts, edges, children, weights, and its end. */
enum { CUT = 0, EDGE = 7, CHILD = 14, WEIGHT = 22, NODE = 94 };

static uint32_t bits_of(float value)
{
    return inside_word(&value, 0);
}

/* What each field of a node must not be, in the second node. */
static void test_refusals(void)
{
    const struct { int at, end; float least, most; } ranges[] = {
        { CUT, EDGE, -1.0f, 1.0f }, { EDGE, CHILD, -2.0f, 4.0f }, { WEIGHT, NODE, -4.0f, 4.0f }
    };
    pcg32 random = pcg32_make(14, 0);
    int right[3] = { 0, 0, 0 }, wrong[3] = { 0, 0, 0 }, i, k;
    kd_guarded copy;
    size_t bytes, node;
    subject s;

    if (subject_make(&s, "foliage", ENVSAMP_LATLONG, 100)) {
        const uint32_t first = KD_WORD(s.f.kd, facing_at) / 4, second = first + NODE;
        const uint32_t links[] = { first, second, second + 1, second + NODE - 1, second + NODE + 1,
                                   first + NODE * KD_WORD(s.f.kd, facing_count), 0, 0x7fffffffu };

        bytes = envsamp_kd_bytes(s.f.kd);
        node = 4 * (size_t)second;
        copy = kd_guarded_make(bytes, 0);
        memcpy(copy.buffer.data, s.f.kd, bytes);
        for (i = 0; i < 3; i++)
            for (k = ranges[i].at; k < ranges[i].end; k++) {
                const float bad[] = { nextafterf(ranges[i].least, -9.0f), INFINITY, -INFINITY, NAN,
                                      nextafterf(ranges[i].most, 9.0f), -NAN, FLT_MAX };
                const size_t at = node + 4 * (size_t)k;
                int b;

                for (b = 0; b < 7; b++)
                    damage_word(&s.f, copy.buffer, at, bits_of(bad[b]), &random, wrong);
                damage_word(&s.f, copy.buffer, at, bits_of(ranges[i].least), &random, right);
                damage_word(&s.f, copy.buffer, at, bits_of(ranges[i].most), &random, right);
            }
        for (k = CHILD; k < WEIGHT; k++) {
            const size_t at = node + 4 * (size_t)k;

            for (i = 0; i < 8; i++)
                damage_word(&s.f, copy.buffer, at, KD_LINK | links[i], &random, wrong);
            damage_word(&s.f, copy.buffer, at, bits_of(INFINITY), &random, wrong);
            damage_word(&s.f, copy.buffer, at, bits_of(NAN), &random, wrong);
            damage_word(&s.f, copy.buffer, at, KD_LINK | (second + NODE), &random, right);
            damage_word(&s.f, copy.buffer, at, bits_of(FLT_MAX), &random, right);
        }
        CHECK(!wrong[1] && !wrong[2], "nodes with what they must not have: of %d %d open", wrong[0],
              wrong[1]);
        CHECK(right[1] == right[0] && !right[2], "at the ends of ranges: %d of %d open, and %d do "
              "not sample", right[1], right[0], right[2]);
        free(copy.block);
    }
    subject_free(&s);
}

/* Many words at once. */
static void test_more_damage(int count)
{
    static const int places[] = { CUT, EDGE, CHILD, WEIGHT, NODE };
    static const float special[] = { 0.0f, -0.0f, 1.0f, -1.0f };
    pcg32 random = pcg32_make(13, 0);
    int opened = 0, failed = 0, i, k;
    size_t bytes, first, words;
    const envsamp_kd *kd;
    kd_guarded copy;
    subject s;

    if (subject_make(&s, "foliage", ENVSAMP_LATLONG, 300)) {
        bytes = envsamp_kd_bytes(s.f.kd);
        first = KD_WORD(s.f.kd, facing_at);
        words = (bytes - first) / 4;
        copy = kd_guarded_make(bytes, 0);
        for (i = 0; i < count; i++) {
            memcpy(copy.buffer.data, s.f.kd, bytes);
            for (k = (int)(pcg32_next(&random) % 40); k >= 0; k--) {
                const uint32_t kind = pcg32_next(&random) % 3;
                const size_t node = pcg32_next(&random) % (words / NODE);
                const uint32_t low = (uint32_t)places[kind < 2 ? kind : 3];
                const uint32_t high = (uint32_t)places[kind < 2 ? kind + 1 : 4];
                float value = special[pcg32_next(&random) % 4];

                if (pcg32_next(&random) % 2)
                    value = 2.0f * pcg32_float(&random) - 1.0f;
                memcpy((char *)copy.buffer.data + first
                       + 4 * (NODE * node + low + pcg32_next(&random) % (high - low)),
                       &value, sizeof value);
            }
            inside_seal(copy.buffer.data, bytes);
            if (envsamp_kd_open(copy.buffer.data, bytes, &kd) == ENVSAMP_OK) {
                opened++;
                for (k = 0; k < 4; k++)
                    failed += !survives(kd, &random);
            }
        }
        CHECK(opened > count / 2 && !failed, "of %d tables with other weights and cuts %d open, of "
              "which %d do not sample", count, opened, failed);
        free(copy.block);
    }
    subject_free(&s);
}

static void test_all_quickly(void)
{
    static const int lit[][4] = { { 0, 64, 20, 32 }, { 0, 64, 0, 16 }, { 0, 64, 16, 32 },
                                  { 0, 32, 0, 32 }, { 20, 21, 25, 26 }, { 63, 64, 1, 2 } };
    static const char *const what[] = { "lit below", "lower half black", "upper half black",
                                        "a side black", "one lit texel", "one at the seam" };
    int i;

    test_directions();
    test_no_normals();
    test_no_data();
    test_lengths();
    test_batches();
    test_below();
    for (i = 0; i < 6; i++)
        test_lit(what[i], "foliage", lit[i][0], lit[i][1], lit[i][2], lit[i][3]);
    test_small_maps();
    test_builds();
    for (i = 0; i < 3; i++) {
        test_memory((envsamp_mapping)i);
        test_damage((envsamp_mapping)i);
    }
    test_refusals();
    test_more_damage(4000);
}

int main(int argc, char **argv)
{
    static const char *const names[] = { "foliage", "sky", "night" };
    const int quick = argc > 1 && !strcmp(argv[1], "quick");
    int m, i;

    test_all_quickly();
    for (m = 0; m < 3; m++) {
        const envsamp_mapping mapping = (envsamp_mapping)m;

        test_integral("foliage", mapping, 1500);
        test_integral("sky", mapping, 6144);
        test_weights("foliage", mapping, m == 2 ? 0.03 : 5e-3);
        test_weights("night", mapping, m == 2 ? 0.03 : 5e-3);
        for (i = 0; i < 3; i++)
            test_agreement(names[i], mapping, i == 1 ? 6144 : 1500, quick ? 10000 : 60000);
        test_places("foliage", mapping);
        test_places("sky", mapping);
        for (i = 0; i < 3 && !quick; i++)
            test_unbiased(names[i], mapping, 8192);
    }
    test_errors("foliage", 0.4, 0.6);
    test_errors("constant", 0.3, 0.6);
    test_errors("studio", 0.3, 0.5);
    if (!quick) {
        test_strata("constant");
        test_strata("studio");
    }
    test_blocks("foliage", !quick);
    test_blocks("night", 0);
    return check_done();
}
