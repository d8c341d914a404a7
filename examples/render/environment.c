/* environment.c: see environment.h. */
#include "environment.h"
#include "inversion.h"
#include "vector.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- the map in the world ---- */

void environment_make(environment *e, const image *map, float degrees)
{
    const envsamp_image view = {map->rgb, map->width, map->height, 3, 0, ENVSAMP_LATLONG};

    e->map = map;
    e->view = view;
    e->cosine = cosf(degrees * VEC_PI / 180.0f);
    e->sine = sinf(degrees * VEC_PI / 180.0f);
}

void environment_into(const environment *e, const float world[3], float map[3])
{
    const float x = world[0], y = world[1];

    vec_set(map, e->cosine * x + e->sine * y, e->cosine * y - e->sine * x, world[2]);
}

void environment_out_of(const environment *e, const float map[3], float world[3])
{
    const float x = map[0], y = map[1];

    vec_set(world, e->cosine * x - e->sine * y, e->sine * x + e->cosine * y, map[2]);
}

void environment_radiance(const environment *e, const float dir[3], float rgb[3])
{
    float map_dir[3];

    environment_into(e, dir, map_dir);
    envsamp_lookup(&e->view, 0, map_dir, rgb);
}

/* ---- samplers ---- */

/* For what has no table of the library. */
static int has_no_options(const sampler_options *options, char *error, size_t error_size)
{
    if (!(options->mis_compensation > 0.0f || options->importance_exponent > 0.0f))
        return 1;
    snprintf(error, error_size, "this method has neither compensation nor an exponent");
    return 0;
}

static int prepare_nothing(const environment *e, const sampler_options *options, void **table,
                           char *error, size_t error_size)
{
    (void)e;
    *table = NULL;
    return has_no_options(options, error, error_size);
}

static envsamp_sample sample_uniform(const void *table, const float axis[3], float u0, float u1)
{
    const float z = 1.0f - 2.0f * u1, level = sqrtf(fmaxf(1.0f - z * z, 0.0f));
    envsamp_sample s = {{0.0f, 0.0f, 0.0f}, 0.25f / VEC_PI, {0.0f, 0.0f}};

    (void)table, (void)axis;
    vec_set(s.dir, level * cosf(2.0f * VEC_PI * u0), level * sinf(2.0f * VEC_PI * u0), z);
    return s;
}

static float pdf_uniform(const void *table, const float axis[3], const float dir[3])
{
    (void)table, (void)axis, (void)dir;
    return 0.25f / VEC_PI;
}

static int refused(envsamp_result result, char *error, size_t error_size)
{
    snprintf(error, error_size, "the library refuses the table: %s",
             envsamp_result_string(result));
    return 0;
}

/* The table is at the start of what it returns. */
static int prepare_kd(const environment *e, const sampler_options *options,
                      envsamp_kd_select select, int facing, void **table, char *error,
                      size_t error_size)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_buffer memory, scratch;
    envsamp_result result;
    envsamp_sizes sizes;
    const envsamp_kd *kd;

    desc.select = select;
    desc.facing = facing;
    desc.mis_compensation = options->mis_compensation;
    desc.importance_exponent = options->importance_exponent;
    if (options->block_count)
        desc.block_count = options->block_count;
    result = envsamp_kd_sizes(&e->view, &desc, &sizes);
    if (result != ENVSAMP_OK)
        return refused(result, error, error_size);
    memory.data = malloc(memory.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    result = memory.data && scratch.data ? envsamp_kd_build(&e->view, &desc, memory, scratch, &kd)
                                         : ENVSAMP_ERR_MEMORY;
    free(scratch.data);
    if (result != ENVSAMP_OK) {
        free(memory.data);
        return refused(result, error, error_size);
    }
    *table = memory.data;
    return 1;
}

static int prepare_fit(const environment *e, const sampler_options *options, void **table,
                       char *error, size_t error_size)
{
    return prepare_kd(e, options, ENVSAMP_KD_FIT, 0, table, error, error_size);
}

static int prepare_alias(const environment *e, const sampler_options *options, void **table,
                         char *error, size_t error_size)
{
    return prepare_kd(e, options, ENVSAMP_KD_ALIAS, 0, table, error, error_size);
}

static int prepare_warp(const environment *e, const sampler_options *options, void **table,
                        char *error, size_t error_size)
{
    return prepare_kd(e, options, ENVSAMP_KD_WARP, 0, table, error, error_size);
}

static int prepare_facing(const environment *e, const sampler_options *options, void **table,
                          char *error, size_t error_size)
{
    return prepare_kd(e, options, ENVSAMP_KD_WARP, 1, table, error, error_size);
}

static envsamp_sample sample_kd(const void *table, const float axis[3], float u0, float u1)
{
    (void)axis;
    return envsamp_kd_sample(table, u0, u1);
}

static float pdf_kd(const void *table, const float axis[3], const float dir[3])
{
    (void)axis;
    return envsamp_kd_pdf(table, dir);
}

static envsamp_sample sample_facing(const void *table, const float axis[3], float u0, float u1)
{
    return envsamp_kd_sample_facing(table, axis, u0, u1);
}

static float pdf_facing(const void *table, const float axis[3], const float dir[3])
{
    return envsamp_kd_pdf_facing(table, axis, dir);
}

static int prepare_cdf(const environment *e, const sampler_options *options, void **table,
                       char *error, size_t error_size)
{
    envsamp_cdf_desc desc = envsamp_cdf_defaults();
    envsamp_buffer memory, scratch;
    envsamp_result result;
    envsamp_sizes sizes;
    const envsamp_cdf *cdf;

    desc.mis_compensation = options->mis_compensation;
    desc.importance_exponent = options->importance_exponent;
    result = envsamp_cdf_sizes(&e->view, &desc, &sizes);
    if (result != ENVSAMP_OK)
        return refused(result, error, error_size);
    memory.data = malloc(memory.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    result = memory.data && scratch.data
           ? envsamp_cdf_build(&e->view, &desc, memory, scratch, &cdf) : ENVSAMP_ERR_MEMORY;
    free(scratch.data);
    if (result != ENVSAMP_OK) {
        free(memory.data);
        return refused(result, error, error_size);
    }
    *table = memory.data;
    return 1;
}

static envsamp_sample sample_cdf(const void *table, const float axis[3], float u0, float u1)
{
    (void)axis;
    return envsamp_cdf_sample(table, u0, u1);
}

static float pdf_cdf(const void *table, const float axis[3], const float dir[3])
{
    (void)axis;
    return envsamp_cdf_pdf(table, dir);
}

static int prepare_inversion(const environment *e, const sampler_options *options, void **table,
                             char *error, size_t error_size)
{
    if (options->importance_exponent > 0.0f) {
        snprintf(error, error_size, "this method has no exponent");
        return 0;
    }
    *table = inversion_make(e->map, options->mis_compensation);
    return *table ? 1 : refused(ENVSAMP_ERR_BLACK, error, error_size);
}

static envsamp_sample draw_inversion(const void *table, const float axis[3], float u0, float u1)
{
    (void)axis;
    return inversion_sample(table, u0, u1);
}

static float pdf_inversion(const void *table, const float axis[3], const float dir[3])
{
    (void)axis;
    return inversion_pdf(table, dir);
}

const light_sampler light_samplers[] = {
    {"uniform", "every direction alike", prepare_nothing, sample_uniform, pdf_uniform, NULL},
    {"bsdf", "no light sample: directions by the BSDF", prepare_nothing, NULL, NULL, NULL},
    {"kd-fit", "blocks by a fitted analytic pdf", prepare_fit, sample_kd, pdf_kd, free},
    {"kd-alias", "blocks by the alias method", prepare_alias, sample_kd, pdf_kd, free},
    {"kd-warp", "blocks by a warp that keeps strata", prepare_warp, sample_kd, pdf_kd, free},
    {"facing", "kd-warp, light x cosine about the normal or the mirrored view", prepare_facing,
     sample_facing, pdf_facing, free},
    {"cdf", "texels by inversion with guide tables", prepare_cdf, sample_cdf, pdf_cdf, free},
    {"inversion", "dilated texels by binary search, as renderers ship it; not the library's",
     prepare_inversion, draw_inversion, pdf_inversion, free},
    {NULL, NULL, NULL, NULL, NULL, NULL}
};

/* ---- methods ---- */

int method_make(method *m, const light_sampler *by, int mis, const environment *e,
                const sampler_options *options, char *error, size_t error_size)
{
    memset(m, 0, sizeof *m);
    m->by = by;
    m->mis = mis;
    if (options->mis_compensation > 0.0f && !mis) {
        snprintf(error, error_size, "%s: compensation needs +mis, or light is lost", by->name);
        return 0;
    }
    return by->prepare(e, options, &m->table, error, error_size);
}

int method_open(method *m, const char *name, const environment *e, const sampler_options *options,
                char *error, size_t error_size)
{
    const size_t length = strlen(name);
    const int mis = length > 4 && !strcmp(name + length - 4, "+mis");
    const size_t stem = mis ? length - 4 : length;
    int i;

    for (i = 0; light_samplers[i].name; i++)
        if (strlen(light_samplers[i].name) == stem && !strncmp(light_samplers[i].name, name, stem)
            && !(mis && !light_samplers[i].sample))
            return method_make(m, &light_samplers[i], mis, e, options, error, error_size);
    snprintf(error, error_size, "%s: no such method; --list shows them", name);
    return 0;
}

void method_close(method *m)
{
    if (m->table && m->by->release)
        m->by->release(m->table);
    m->table = NULL;
}

envsamp_sample method_sample(const method *m, const environment *e, const float axis[3],
                             const float u[2])
{
    float map_axis[3];
    envsamp_sample s;

    environment_into(e, axis, map_axis);
    s = m->by->sample(m->table, map_axis, u[0], u[1]);
    environment_out_of(e, s.dir, s.dir);
    return s;
}

float method_pdf(const method *m, const environment *e, const float axis[3], const float dir[3])
{
    float map_axis[3], map_dir[3];

    environment_into(e, axis, map_axis);
    environment_into(e, dir, map_dir);
    return m->by->pdf(m->table, map_axis, map_dir);
}
