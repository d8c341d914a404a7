/* check.c: tables of envsamp.h sampled by envsamp.glsl on a GPU, beside the C code on the CPU.
 *
 *     gpu_check                       five made-up maps, 10^6 points a map and way of sampling
 *     gpu_check sky data/city.pfm     these maps, by name or file
 *     gpu_check -t sky.table          a stored table, checked before it is uploaded
 *     gpu_check -n 10000 --gl         fewer points; OpenGL 4.3 where ES 3.1 is the default
 *     gpu_check -b 256 --kd           smaller tables; without those of cdf
 *     gpu_check -m octahedral         by a shader that is built for one mapping
 *     gpu_check -s shaders            where envsamp.glsl and check.glsl are: examples/gpu
 *     gpu_check --gl -v spirv         check_0.spv to check_7.spv of a folder: HLSL, compiled
 *     gpu_check -d cases              also writes what check_wgsl.mjs reads
 *
 * Both sides make the same numbers, directions and normals. A line a table and way of sampling says
 * how many points differ: in their block; of those of the same block, in direction by more than
 * 1e-5, in density by more than 1e-5 relative; how many of all these rounding explains: C does the
 * same, or as much, when the point is moved by 1e-6 (for light x cosine see pdf_excess); and how
 * many of the same block differ in any bit. Then one word of the table is damaged on its way to the
 * GPU, and the comparison must see it. Exits with 1 if a point differs that rounding does not
 * explain, or a damage is not seen.
 *
 * For the block that a point is in it reads the inside of the library, which users need not.
 */
#define ENVSAMP_STATIC
#define ENVSAMP_IMPLEMENTATION
#include "../../envsamp.h"

#include "../common/image.h"
#include "../common/maps.h"
#include "../common/random.h"
#include "gpu.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ERROR_SIZE 512
#define POINTS_MAX 4000000
#define RESULT_WORDS 8
#define UNIFORM_WORDS 4096              /* 16 KB */
#define DAMAGED_POINTS 100000           /* of each damaged table */
#define HAIR 1e-6f
#define TOLERANCE 1e-5
#define FACING_TOLERANCE 1e-3           /* of the density of light alone, where roots are rounded */
#define SEED 1u

/* ---- ways of sampling ---- */

/* As CHECK_MODE in check.glsl. */
enum { KD_PROBLEM, KD_SAMPLE, KD_PDF, FACING_SAMPLE, FACING_PDF, CDF_SAMPLE, CDF_PDF, CDF_PROBLEM,
       MODE_COUNT };

static const char *const mode_names[MODE_COUNT] = {
    "", "sample", "density", "facing sample", "facing density", "sample", "density", ""
};

static const char *const mapping_names[] = { "latlong", "hemisphere", "octahedral" };

/* A table on this side: kd or cdf, and its bytes. */
typedef struct table {
    const envsamp_kd *kd;
    const envsamp_cdf *cdf;
    void *data;
    size_t bytes;
    const char *select;
    envsamp_mapping mapping;
} table;

typedef struct options {
    int points, desktop, mapping;       /* mapping -1: the shader takes that of the table */
    int blocks, kd_only;                /* blocks 0: the default */
    const char *shaders, *table, *spirv, *cases;
} options;

/* What is drawn at a point, and the block that it is from. */
typedef struct drawn { envsamp_sample s; uint32_t block; } drawn;

typedef struct checker {
    gpu device;
    options wanted;
    GLuint programs[MODE_COUNT], settings;
    uint32_t *results;
    float *directions;
    drawn *expected;                    /* by C */
    long failures;
} checker;

/* ---- the same numbers as check.glsl ---- */

static float number(uint32_t i, uint32_t axis)
{
    const uint32_t bits = hash_combine(SEED, 8 * i + axis);

    return i % 512 == 0 ? envsamp__bits_float(bits) : unit_float(bits);
}

/* ---- blocks, by the place of their density in words ---- */

static uint32_t warp_block(const envsamp_kd *kd, float f[2])
{
    const int row = (int)(f[1] * (float)(1 << kd->tile_bits_y));
    const int column = (int)(f[0] * (float)(1 << kd->tile_bits_x));
    uint32_t place = (uint32_t)(sizeof *kd / 4)
                   + 5 * (uint32_t)((row << kd->tile_bits_x) + column) + 4;
    float cut[4], edge[4];
    uint32_t link = envsamp__warp_start(kd, f, cut, edge, 1);

    while (link & ENVSAMP__INNER) {
        const envsamp__sample_node *node = ENVSAMP__LINKED(envsamp__sample_node, kd, link);
        const float at = f[envsamp__sign(node->cut)];

        place = (link & ~ENVSAMP__INNER) + 2 + (at >= ENVSAMP_FABSF(node->cut));
        link = envsamp__warp_step(kd, link, f, cut, edge, 1);
    }
    return place;
}

static uint32_t kd_block(const envsamp_kd *kd, float u0, float u1)
{
    envsamp__choice choice;
    float f[2];

    f[0] = envsamp__clamp_unit(u0);
    f[1] = envsamp__clamp_unit(u1);
    if (kd->select == ENVSAMP_KD_WARP)
        return warp_block(kd, f);
    choice = kd->select == ENVSAMP_KD_ALIAS ? envsamp__alias_choose(kd, f[0], f[1])
                                            : envsamp__fit_choose(kd, f[0], f[1]);
    return (uint32_t)(sizeof *kd / 4) + 5 * (uint32_t)choice.block + 4;
}

static uint32_t facing_block(const envsamp_kd *kd, const float normal[3], float u0, float u1)
{
    float n[9], f[2];

    f[0] = envsamp__clamp_unit(u0);
    f[1] = envsamp__clamp_unit(u1);
    if (envsamp__facing_normal(kd, normal, n))
        envsamp__facing_warp(kd, n, f);
    return kd_block(kd, f[0], f[1]);
}

static uint32_t cdf_block(const envsamp_cdf *cdf, float u0, float u1)
{
    const uint32_t y = envsamp__cdf_find_row(cdf, envsamp__draw(u1));
    const uint32_t *edges = ENVSAMP__CDF_EDGES(ENVSAMP__ARRAY, cdf, y);
    const uint32_t x = envsamp__cdf_find(edges, ENVSAMP__CDF_GUIDE(ENVSAMP__ARRAY, cdf, y),
                                         cdf->guide_bits, envsamp__draw(u0));

    return (uint32_t)(edges + x - (const uint32_t *)(const void *)cdf);
}

/* What one point is made from. */
typedef struct point { float u[2], normal[3], dir[3]; } point;

static point make_point(const checker *c, uint32_t i)
{
    point p;

    for (uint32_t k = 0; k < 2; k++)
        p.u[k] = number(i, k);
    for (uint32_t k = 0; k < 3; k++)
        p.normal[k] = i % 64 == 5 ? 0.0f : unit_float(hash_combine(SEED, 8 * i + 2 + k)) - 0.5f;
    memcpy(p.dir, &c->directions[3 * (size_t)i], sizeof p.dir);
    return p;
}

/* What C draws. Of a density only that, and that of light alone as the block. */
static drawn draw_in_c(const table *t, int mode, const point *p)
{
    drawn d;

    memset(&d, 0, sizeof d);
    if (mode == KD_SAMPLE) {
        d.s = envsamp_kd_sample(t->kd, p->u[0], p->u[1]);
        d.block = kd_block(t->kd, p->u[0], p->u[1]);
    } else if (mode == FACING_SAMPLE) {
        d.s = envsamp_kd_sample_facing(t->kd, p->normal, p->u[0], p->u[1]);
        d.block = facing_block(t->kd, p->normal, p->u[0], p->u[1]);
    } else if (mode == CDF_SAMPLE) {
        d.s = envsamp_cdf_sample(t->cdf, p->u[0], p->u[1]);
        d.block = cdf_block(t->cdf, p->u[0], p->u[1]);
    } else if (mode == CDF_PDF) {
        d.s.pdf = envsamp_cdf_pdf(t->cdf, p->dir);
        d.block = envsamp__float_bits(d.s.pdf);
    } else {
        d.s.pdf = mode == KD_PDF ? envsamp_kd_pdf(t->kd, p->dir)
                                 : envsamp_kd_pdf_facing(t->kd, p->normal, p->dir);
        d.block = envsamp__float_bits(envsamp_kd_pdf(t->kd, p->dir));
    }
    return d;
}

/* Every other direction is one that the table draws, the others are even over the sphere; some are
   longer, and one in 64 has a zero, an infinity or a NaN in it. */
static void make_directions(const checker *c, const table *t)
{
    static const float odd[] = { 0.0f, -0.0f, 1e-15f, 1e17f, INFINITY, -INFINITY, NAN };

    for (uint32_t i = 0; i < (uint32_t)c->wanted.points; i++) {
        const float u0 = number(i, 5), u1 = number(i, 6);
        const float scale = i % 8 < 2 ? 1.0f + 1000.0f * unit_float(hash_u32(i)) : 1.0f;
        float *dir = &c->directions[3 * i];
        envsamp_sample s;

        if (i % 2) {
            s = t->kd ? envsamp_kd_sample(t->kd, u0, u1) : envsamp_cdf_sample(t->cdf, u0, u1);
            memcpy(dir, s.dir, sizeof s.dir);
        } else {
            envsamp_uv_to_dir(ENVSAMP_OCTAHEDRAL, u0, u1, dir);
        }
        for (int k = 0; k < 3; k++)
            dir[k] *= scale;
        if (i % 64 == 9)
            dir[i / 64 % 3] = odd[i / 192 % (sizeof odd / sizeof odd[0])];
    }
}

/* ---- comparing ---- */

/* Points that differ: in their block; of the same block, in direction, density, or any bit.
   differ: in one of the first three; rounded: of these, those of which C says the same, or does as
   much, when the point is moved by HAIR. */
typedef struct tally {
    long points, blocks, dirs, pdfs, bits, differ, rounded;
    double worst_dir, worst_pdf;        /* of the same block */
} tally;

static double pdf_gap(float a, float b)
{
    const double most = fmax((double)a, (double)b);
    const double gap = a == b ? 0.0 : fabs((double)a - (double)b) / most;

    return gap <= 1.0 ? gap : 1.0;      /* a NaN, too */
}

static double dir_gap(const float a[3], const float b[3])
{
    double most = 0.0;

    for (int k = 0; k < 3; k++) {
        const double gap = fabs((double)a[k] - (double)b[k]);

        most = gap <= most ? most : gap <= 2.0 ? gap : 2.0;
    }
    return most;
}

/* How far densities are apart. Of light x cosine a part of the density of light alone is rounding:
   below the horizon a weight is what is left of two numbers of nearly the same size, and a unit in
   the last place of a root changes it by up to a part in 100. */
static double pdf_excess(const table *t, int mode, const point *at, const drawn *by_c, float pdf)
{
    const double gap = pdf_gap(by_c->s.pdf, pdf);
    const float *dir = mode == FACING_PDF ? at->dir : by_c->s.dir;

    if ((mode == FACING_PDF || mode == FACING_SAMPLE)
        && fabs((double)by_c->s.pdf - (double)pdf)
           <= FACING_TOLERANCE * (double)envsamp_kd_pdf(t->kd, dir))
        return 0.0;
    return gap;
}

/* Whether C comes to what the shader does, or as far, for a point moved by HAIR each way. */
static int is_rounding(const table *t, int mode, const point *at, const drawn *by_c,
                       const drawn *by_gpu)
{
    const float most = fmaxf(fmaxf(fabsf(at->dir[0]), fabsf(at->dir[1])), fabsf(at->dir[2]));
    const double dir = dir_gap(by_c->s.dir, by_gpu->s.dir);
    const double pdf = pdf_excess(t, mode, at, by_c, by_gpu->s.pdf);

    for (int i = 0; i < 27; i++) {
        const float way[3] = { HAIR * (float)(i % 3 - 1), HAIR * (float)(i / 3 % 3 - 1),
                               HAIR * (float)(i / 9 - 1) };
        point p = *at;
        drawn d;

        for (int k = 0; k < 3; k++)
            p.dir[k] += way[k] * most;
        for (int k = 0; k < 2; k++)
            p.u[k] = envsamp__clamp_unit(p.u[k]) + way[k];
        d = draw_in_c(t, mode, &p);
        if ((d.block == by_gpu->block || by_c->block == by_gpu->block)
            && dir <= dir_gap(d.s.dir, by_c->s.dir) + TOLERANCE
            && pdf <= pdf_gap(d.s.pdf, by_c->s.pdf) + TOLERANCE)
            return 1;
    }
    return 0;
}

/* The results of the device beside those of C, of the first `count` points. */
static tally compare(const checker *c, const table *t, int mode, int count)
{
    tally sum;

    memset(&sum, 0, sizeof sum);
    for (; sum.points < count; sum.points++) {
        const uint32_t *result = &c->results[RESULT_WORDS * sum.points];
        const drawn *expected = &c->expected[sum.points];
        drawn d;
        double dir, pdf;

        memcpy(d.s.dir, result, sizeof d.s.dir);
        memcpy(&d.s.pdf, result + 3, sizeof d.s.pdf);
        memcpy(d.s.uv, result + 4, sizeof d.s.uv);
        d.block = result[6];
        dir = dir_gap(d.s.dir, expected->s.dir);
        pdf = pdf_gap(d.s.pdf, expected->s.pdf);
        sum.bits += d.block == expected->block && memcmp(&d.s, &expected->s, sizeof d.s) != 0;
        sum.blocks += d.block != expected->block;
        sum.dirs += d.block == expected->block && dir > TOLERANCE;
        sum.pdfs += d.block == expected->block && pdf > TOLERANCE;
        if (d.block == expected->block) {
            sum.worst_dir = fmax(sum.worst_dir, dir);
            sum.worst_pdf = fmax(sum.worst_pdf, pdf);
        }
        if (d.block != expected->block || dir > TOLERANCE || pdf > TOLERANCE) {
            const point p = make_point(c, (uint32_t)sum.points);

            sum.differ++;
            sum.rounded += is_rounding(t, mode, &p, expected, &d);
        }
    }
    return sum;
}

/* Runs a program over the first `count` points. */
static int run(const checker *c, int mode, GLuint table_buffer, GLuint result_buffer, int count)
{
    const size_t bytes = (size_t)count * RESULT_WORDS * 4;
    const uint32_t settings[2] = { SEED, (uint32_t)count };

    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, table_buffer);
    glBindBufferBase(GL_UNIFORM_BUFFER, 0, table_buffer);   /* of shaders that read it there */
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, c->settings);
    glBufferSubData(GL_SHADER_STORAGE_BUFFER, 0, sizeof settings, settings);
    glUseProgram(c->programs[mode]);
    glDispatchCompute(((GLuint)count + 63) / 64, 1, 1);
    return gpu_read(result_buffer, c->results, bytes) && glGetError() == GL_NO_ERROR;
}

/* ---- checks of one table ---- */

/* The word that is damaged: what the way of sampling cannot do without. */
static size_t damaged_word(const table *t, int mode, uint32_t *flip)
{
    *flip = 1;
    if (mode == CDF_SAMPLE || mode == CDF_PDF) {
        *flip = 4;                      /* edges one word off */
        return offsetof(envsamp_cdf, edges_at) / 4;
    }
    if (mode == KD_PDF && t->kd->block_count > 1)
        return offsetof(envsamp_kd, grid_bits_x) / 4;
    if (mode == KD_PDF) {
        *flip = 0x400000;               /* the density in half of the map */
        return t->kd->grid_at / 4;
    }
    *flip = 0x80000000u;
    if (mode == FACING_PDF || mode == FACING_SAMPLE)
        return t->kd->facing_at / 4 + 22;               /* the sign of a moment */
    if (t->kd->select == ENVSAMP_KD_WARP)
        return sizeof *t->kd / 4 + 4;                   /* what a tile leads to */
    if (t->kd->select == ENVSAMP_KD_FIT) {
        *flip = 0x4000;                                 /* the total, by 1 in 64 */
        return offsetof(envsamp_kd, fit_total) / 4 + 1;
    }
    *flip = 4;                                          /* bins one word off */
    return offsetof(envsamp_kd, alias_at) / 4;
}

/* A buffer for a table; as large as a uniform block of every driver may be. */
static GLuint upload(const void *data, size_t bytes)
{
    const size_t words = (bytes + 3) / 4;
    GLuint buffer = gpu_buffer(0, NULL, words > UNIFORM_WORDS ? 4 * words : 4 * UNIFORM_WORDS);

    if (buffer)
        glBufferSubData(GL_SHADER_STORAGE_BUFFER, 0, (GLsizeiptr)bytes, data);
    return buffer;
}

/* Whether the comparison sees a damaged word. The shader stays within the buffer all the same. */
static int damage_is_seen(checker *c, const table *t, int mode, GLuint result_buffer)
{
    uint32_t *words = malloc(t->bytes), flip;
    const size_t at = damaged_word(t, mode, &flip);
    GLuint buffer = 0;
    const int count = envsamp__min(c->wanted.points, DAMAGED_POINTS);
    tally sum;
    int seen = 0;

    if (!words)
        return 0;
    memcpy(words, t->data, t->bytes);
    words[at] ^= flip;
    buffer = upload(words, t->bytes);
    free(words);
    if (buffer && run(c, mode, buffer, result_buffer, count)) {
        sum = compare(c, t, mode, count);
        seen = sum.differ > sum.rounded;
    }
    glDeleteBuffers(1, &buffer);
    return seen;
}

/* What check_wgsl.mjs reads. */
static int write_case(const checker *c, const char *name, const table *t, int mode, char *error)
{
    const uint32_t points = (uint32_t)c->wanted.points, spare = 0;
    const uint32_t head[4] = { (uint32_t)mode, points, (uint32_t)((t->bytes + 3) / 4), SEED };
    char path[IMAGE_PATH_MAX];
    FILE *file;
    int good;

    snprintf(path, sizeof path, "%s/%s_%s_%s_%d.case", c->wanted.cases, name,
             mapping_names[t->mapping], t->select, mode);
    if (!(file = fopen(path, "wb")))
        return image_fail(error, ERROR_SIZE, path, "cannot be created");
    fwrite(head, sizeof head, 1, file);
    fwrite(t->data, t->bytes, 1, file);
    fwrite(&spare, 4 * head[2] - t->bytes, 1, file);
    fwrite(c->directions, 12, points, file);
    for (uint32_t i = 0; i < points; i++) {
        uint32_t result[RESULT_WORDS] = { 0 };

        memcpy(result, c->expected[i].s.dir, 12);
        memcpy(result + 3, &c->expected[i].s.pdf, 4);
        memcpy(result + 4, c->expected[i].s.uv, 8);
        result[6] = c->expected[i].block;
        fwrite(result, sizeof result, 1, file);
    }
    good = !ferror(file);
    good &= fclose(file) == 0;
    return good || image_fail(error, ERROR_SIZE, path, "cannot be written in full");
}

static int check_mode(checker *c, const char *name, const table *t, int mode, GLuint table_buffer,
                      GLuint result_buffer, char *error)
{
    tally sum;
    int seen;

    if (!run(c, mode, table_buffer, result_buffer, c->wanted.points))
        return image_fail(error, ERROR_SIZE, name, "the device fails to run the shader");
    for (int i = 0; i < c->wanted.points; i++) {
        const point p = make_point(c, (uint32_t)i);

        c->expected[i] = draw_in_c(t, mode, &p);
    }
    sum = compare(c, t, mode, c->wanted.points);
    seen = damage_is_seen(c, t, mode, result_buffer);
    printf("%-12.12s %-10s %-5s %-14s %8ld %6ld %6ld %6ld %6ld %8ld %8.1e %8.1e  %s\n", name,
           mapping_names[t->mapping], t->select, mode_names[mode], sum.points, sum.blocks,
           sum.dirs, sum.pdfs, sum.rounded, sum.bits, sum.worst_dir, sum.worst_pdf,
           seen ? "seen" : "NOT SEEN");
    fflush(stdout);
    c->failures += sum.differ - sum.rounded + !seen;
    return !c->wanted.cases || write_case(c, name, t, mode, error);
}

/* Whether the shader can sample the table, by what it says itself. */
static int table_fits(checker *c, const char *name, const table *t, GLuint table_buffer,
                      GLuint result_buffer, char *error)
{
    static const char *const problems[] = {
        "is no table of envsamp.h", "is of another version than the shader",
        NULL, "has the model POWER, which the shader has no code for"
    };
    uint32_t problem;

    if (!run(c, t->kd ? KD_PROBLEM : CDF_PROBLEM, table_buffer, result_buffer, 1))
        return image_fail(error, ERROR_SIZE, name, "the device fails to run the shader");
    problem = c->results[6];
    if (problem == 0)
        return 1;
    if (problem == 3)
        return image_fail(error, ERROR_SIZE, name, "the table is %s, the shader is built for %s",
                          mapping_names[t->mapping], c->wanted.mapping < 0 ? "something else"
                                                     : mapping_names[c->wanted.mapping]);
    return image_fail(error, ERROR_SIZE, name, "%s", problems[(problem - 1) % 4]);
}

/* name: of the map or the file. */
static int check_table(checker *c, const char *name, const table *t, char *error)
{
    const size_t result_bytes = (size_t)c->wanted.points * RESULT_WORDS * 4;
    const size_t direction_bytes = (size_t)c->wanted.points * 12;
    const char *base = strrchr(name, '/') ? strrchr(name, '/') + 1 : name;
    GLuint buffers[3];
    int good = 0, facing = t->kd && t->kd->facing_count > 0;

    make_directions(c, t);
    memset(c->results, 0xff, result_bytes);
    buffers[0] = upload(t->data, t->bytes);
    buffers[1] = gpu_buffer(1, c->directions, direction_bytes);
    buffers[2] = gpu_buffer(2, c->results, result_bytes);
    if (!buffers[0] || !buffers[1] || !buffers[2])
        image_fail(error, ERROR_SIZE, name, "%lu bytes do not fit into the device's buffers",
                   (unsigned long)(t->bytes + direction_bytes + result_bytes));
    else if (table_fits(c, name, t, buffers[0], buffers[2], error))
        good = t->cdf ? check_mode(c, base, t, CDF_SAMPLE, buffers[0], buffers[2], error)
                        && check_mode(c, base, t, CDF_PDF, buffers[0], buffers[2], error)
                      : check_mode(c, base, t, KD_SAMPLE, buffers[0], buffers[2], error)
                        && check_mode(c, base, t, KD_PDF, buffers[0], buffers[2], error);
    if (good && facing)
        good = check_mode(c, base, t, FACING_SAMPLE, buffers[0], buffers[2], error)
            && check_mode(c, base, t, FACING_PDF, buffers[0], buffers[2], error);
    glDeleteBuffers(3, buffers);
    return good;
}

/* ---- tables ---- */

static int is_cdf(int kind)
{
    return kind == ENVSAMP_KD_FIT + 1;
}

/* kind: of envsamp_kd_select, WARP with `facing`, or one more: cdf. To be freed: data. */
static envsamp_result build(const image *map, envsamp_mapping mapping, int kind, int blocks,
                            table *t)
{
    static const char *const names[] = { "warp", "alias", "fit", "cdf" };
    const envsamp_image view = { map->rgb, map->width, map->height, 3, 0, mapping };
    envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_buffer out, scratch;
    envsamp_sizes sizes;
    envsamp_result result;

    memset(t, 0, sizeof *t);
    desc.select = is_cdf(kind) ? ENVSAMP_KD_WARP : (envsamp_kd_select)kind;
    desc.facing = kind == ENVSAMP_KD_WARP;
    desc.block_count = blocks;
    if (is_cdf(kind))
        envsamp_cdf_sizes(&view, NULL, &sizes);
    else
        envsamp_kd_sizes(&view, &desc, &sizes);
    out.data = t->data = malloc(out.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    result = is_cdf(kind) ? envsamp_cdf_build(&view, NULL, out, scratch, &t->cdf)
                          : envsamp_kd_build(&view, &desc, out, scratch, &t->kd);
    free(scratch.data);
    if (result == ENVSAMP_OK)
        t->bytes = t->cdf ? envsamp_cdf_bytes(t->cdf) : envsamp_kd_bytes(t->kd);
    t->select = names[kind];
    t->mapping = mapping;
    return result;
}

static int check_map(checker *c, const char *name, char *error)
{
    image map;
    const int made = map_make(name, 512, 256, &map);
    int good = 1;

    if (!made && !image_read(name, &map, error, ERROR_SIZE))
        return 0;
    for (int mapping = 0; mapping < 3 && good; mapping++) {
        if (c->wanted.mapping >= 0 ? mapping != (made ? c->wanted.mapping : 0)
                                   : mapping > 0 && !made)
            continue;                   /* real maps are of one mapping, made-up ones of all */
        for (int kind = 0; kind < (c->wanted.kd_only ? 3 : 4) && good; kind++) {
            table t;
            const envsamp_result result = build(&map, (envsamp_mapping)mapping, kind,
                                                c->wanted.blocks, &t);

            good = result == ENVSAMP_OK ? check_table(c, name, &t, error)
                 : image_fail(error, ERROR_SIZE, name, "%s", envsamp_result_string(result));
            free(t.data);
        }
    }
    image_free(&map);
    return good;
}

/* Of another version where all else could be right. */
static int is_other_version(const void *bytes, size_t count)
{
    envsamp__table head;

    if (count < sizeof head)
        return 0;
    memcpy(&head, bytes, sizeof head);
    return (head.magic == ENVSAMP__KD_MAGIC && head.version != ENVSAMP__KD_VERSION)
        || (head.magic == ENVSAMP__CDF_MAGIC && head.version != ENVSAMP__CDF_VERSION);
}

/* What an engine does with a table from a file: nothing goes to the GPU that _open refuses. */
static int check_file(checker *c, const char *path, char *error)
{
    table t;
    int good = 0;

    memset(&t, 0, sizeof t);
    t.data = image_read_bytes(path, &t.bytes, error, ERROR_SIZE);
    if (!t.data)
        return 0;
    if (envsamp_kd_open(t.data, t.bytes, &t.kd) == ENVSAMP_OK) {
        t.mapping = (envsamp_mapping)t.kd->mapping;
        t.bytes = envsamp_kd_bytes(t.kd);
        t.select = "kd";
        good = check_table(c, path, &t, error);
    } else if (envsamp_cdf_open(t.data, t.bytes, &t.cdf) == ENVSAMP_OK) {
        t.mapping = (envsamp_mapping)t.cdf->mapping;
        t.bytes = envsamp_cdf_bytes(t.cdf);
        t.select = "cdf";
        good = check_table(c, path, &t, error);
    } else {
        image_fail(error, ERROR_SIZE, path, is_other_version(t.data, t.bytes)
                   ? "is a table of another version" : "is damaged, or no table of envsamp.h");
    }
    free(t.data);
    return good;
}

/* ---- the program ---- */

static char *read_text(const char *folder, const char *name, char *error)
{
    char path[IMAGE_PATH_MAX];
    size_t count = 0;
    char *bytes, *text;

    if ((size_t)snprintf(path, sizeof path, "%s/%s", folder, name) >= sizeof path) {
        image_fail(error, ERROR_SIZE, folder, "is too long a path");
        return NULL;
    }
    bytes = (char *)image_read_bytes(path, &count, error, ERROR_SIZE);
    text = bytes ? malloc(count + 1) : NULL;
    if (text) {
        memcpy(text, bytes, count);
        text[count] = '\0';
    } else if (bytes) {
        image_fail(error, ERROR_SIZE, path, "does not fit into memory");
    }
    free(bytes);
    return text;
}

static int load_spirv(checker *c, char *error)
{
    int mode, good = 1;

    for (mode = 0; mode < MODE_COUNT && good; mode++) {
        char path[IMAGE_PATH_MAX];
        size_t bytes = 0;
        unsigned char *words;

        snprintf(path, sizeof path, "%s/check_%d.spv", c->wanted.spirv, mode);
        words = image_read_bytes(path, &bytes, error, ERROR_SIZE);
        c->programs[mode] = words ? gpu_program_spirv(words, bytes, path, error, ERROR_SIZE) : 0;
        good = c->programs[mode] != 0;
        free(words);
    }
    return good;
}

static int compile(checker *c, char *error)
{
    char *library = read_text(c->wanted.shaders, "envsamp.glsl", error);
    char *body = library ? read_text(c->wanted.shaders, "check.glsl", error) : NULL;
    char defines[128], mapping[64] = "";
    const char *texts[3];
    int mode, good = body != NULL;

    if (c->wanted.mapping >= 0)
        snprintf(mapping, sizeof mapping, "#define ENVSAMP_MAPPING %du\n", c->wanted.mapping);
    for (mode = 0; mode < MODE_COUNT && good; mode++) {
        snprintf(defines, sizeof defines, "%s#define CHECK_MODE %du\n#line 1\n", mapping, mode);
        texts[0] = defines;
        texts[1] = library;
        texts[2] = body;
        c->programs[mode] = gpu_program(&c->device, texts, 3, c->wanted.shaders, error,
                                        ERROR_SIZE);
        good = c->programs[mode] != 0;
    }
    free(library);
    free(body);
    return good;
}

static int read_options(int argc, char **argv, options *o, int *first, char *error)
{
    int i;

    for (i = 1; i < argc && argv[i][0] == '-'; i++) {
        const char *value = i + 1 < argc ? argv[i + 1] : NULL;
        const char letter = argv[i][1];

        o->desktop |= !strcmp(argv[i], "--gl");
        o->kd_only |= !strcmp(argv[i], "--kd");
        if (!strcmp(argv[i], "--gl") || !strcmp(argv[i], "--kd"))
            continue;
        if (!letter || argv[i][2] || !strchr("nbmstvd", letter) || !value)
            return image_fail(error, ERROR_SIZE, argv[i], "usage: gpu_check [-n POINTS] "
                              "[-b BLOCKS] [--gl] [--kd] [-m MAPPING] [-s SHADERS] [-t TABLE] "
                              "[-v SPIRV] [-d CASES] [MAP ...]");
        i++;
        if (letter == 'n' && ((o->points = atoi(value)) < 1 || o->points > POINTS_MAX))
            return image_fail(error, ERROR_SIZE, value, "points: 1 to %d", POINTS_MAX);
        if (letter == 'b' && ((o->blocks = atoi(value)) < 1 || o->blocks > 1048576))
            return image_fail(error, ERROR_SIZE, value, "blocks: 1 to 1048576");
        if (letter == 's')
            o->shaders = value;
        if (letter == 't')
            o->table = value;
        if (letter == 'd')
            o->cases = value;
        if (letter == 'v')
            o->spirv = value;
        if (letter == 'm') {
            for (o->mapping = 2; o->mapping >= 0; o->mapping--)
                if (!strcmp(value, mapping_names[o->mapping]))
                    break;
            if (o->mapping < 0)
                return image_fail(error, ERROR_SIZE, value,
                                  "mapping: latlong, hemisphere or octahedral");
        }
    }
    *first = i;
    return 1;
}

static int check_all(checker *c, int count, char **names, char *error)
{
    int i, good = 1;

    printf("%s\n%-12s %-10s %-5s %-14s %8s %6s %6s %6s %6s %8s %8s %8s  %s\n", c->device.name,
           "map", "mapping", "table", "", "points", "blocks", "dirs", "pdfs", "hair", "bits",
           "dir", "pdf", "damage");
    if (c->wanted.table)
        return check_file(c, c->wanted.table, error);
    for (i = 0; i < count && good; i++)
        good = check_map(c, names[i], error);
    return good;
}

int main(int argc, char **argv)
{
    checker c;
    char error[ERROR_SIZE], *made[8];
    int first = argc, good, count;

    memset(&c, 0, sizeof c);
    c.wanted.points = 1000000;
    c.wanted.mapping = -1;
    c.wanted.shaders = "examples/gpu";
    for (count = 0; map_names[count]; count++)
        made[count] = (char *)(uintptr_t)map_names[count];
    if (!read_options(argc, argv, &c.wanted, &first, error)
        || !gpu_open(&c.device, c.wanted.desktop, error, sizeof error)) {
        fprintf(stderr, "%s\n", error);
        return 1;
    }
    c.results = malloc((size_t)c.wanted.points * RESULT_WORDS * 4);
    c.directions = malloc((size_t)c.wanted.points * 12);
    c.expected = malloc((size_t)c.wanted.points * sizeof *c.expected);
    c.settings = gpu_buffer(3, NULL, 8);
    if (!c.results || !c.directions || !c.expected || !c.settings)
        good = image_fail(error, sizeof error, argv[0], "not enough memory");
    else
        good = c.wanted.spirv ? load_spirv(&c, error) : compile(&c, error);
    if (good && first < argc)
        good = check_all(&c, argc - first, argv + first, error);
    else if (good)
        good = check_all(&c, count, made, error);
    if (!good)
        fprintf(stderr, "%s\n", error);
    else
        printf("%ld points differ or damages are not seen\n", c.failures);
    free(c.results);
    free(c.directions);
    free(c.expected);
    gpu_close(&c.device);
    return !good || c.failures > 0;
}
