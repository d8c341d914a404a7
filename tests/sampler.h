/* sampler.h: all four samplers behind one face, for tests that ask the same of each.
 *
 *     sampler_request request = sampler_ask(SAMPLER_CDF, &map, 64);
 *     sampler s;
 *     if (sampler_make(&s, &request)) ... sampler_draw(&s, u0, u1) ...
 *     sampler_free(&s);
 *
 * Buffers are of exactly the size asked for, between canaries, and full of rubbish.
 */
#ifndef SAMPLER_H
#define SAMPLER_H

#include "kd_fixture.h"

/* The first three are numbered as envsamp_kd_select. */
typedef enum sampler_kind {
    SAMPLER_WARP = 0, SAMPLER_ALIAS, SAMPLER_FIT, SAMPLER_CDF, SAMPLER_KINDS
} sampler_kind;

static const char *const sampler_names[SAMPLER_KINDS] = { "WARP", "ALIAS", "FIT", "cdf" };
static const char *const sampler_mappings[3] = { "lat-long", "hemisphere", "octahedral" };

/* What to build. */
typedef struct sampler_request {
    int kind;
    envsamp_image image;
    envsamp_row_fn fn;
    void *user;
    int blocks;                 /* kd only */
    int bilinear, strict;
    float compensation, exponent;
} sampler_request;

typedef struct sampler {
    sampler_request request;
    envsamp_sizes sizes;
    kd_guarded table, scratch;
    envsamp_kd_job *kd_job;     /* of the two jobs and of the two tables one is used */
    envsamp_cdf_job *cdf_job;
    const envsamp_kd *kd;
    const envsamp_cdf *cdf;
    envsamp_result result;
} sampler;

/* What both kinds of info hold. */
typedef struct sampler_info {
    double integral, excess_variance, max_ratio;
    size_t bad_pixel_count;
    float mis_compensation;
    int bilinear;
    envsamp_mapping mapping;
} sampler_info;

static inline sampler_request sampler_ask(int kind, const envsamp_image *image, int blocks)
{
    sampler_request request;

    memset(&request, 0, sizeof request);
    request.kind = kind;
    request.image = *image;
    request.blocks = blocks;
    return request;
}

static inline envsamp_kd_desc sampler_kd_desc(const sampler_request *request)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();

    desc.block_count = request->blocks;
    desc.select = (envsamp_kd_select)request->kind;
    desc.nearest = !request->bilinear;
    desc.strict = request->strict;
    desc.mis_compensation = request->compensation;
    desc.importance_exponent = request->exponent;
    return desc;
}

static inline envsamp_cdf_desc sampler_cdf_desc(const sampler_request *request)
{
    envsamp_cdf_desc desc = envsamp_cdf_defaults();

    desc.nearest = !request->bilinear;
    desc.strict = request->strict;
    desc.mis_compensation = request->compensation;
    desc.importance_exponent = request->exponent;
    return desc;
}

static inline envsamp_result sampler_sizes(const sampler_request *request, envsamp_sizes *sizes)
{
    const envsamp_kd_desc kd = sampler_kd_desc(request);
    const envsamp_cdf_desc cdf = sampler_cdf_desc(request);

    return request->kind == SAMPLER_CDF ? envsamp_cdf_sizes(&request->image, &cdf, sizes)
                                        : envsamp_kd_sizes(&request->image, &kd, sizes);
}

/* The buffers alone, with rubbish of different kinds in them. */
static inline void sampler_prepare(sampler *s, const sampler_request *request, int rubbish)
{
    memset(s, 0, sizeof *s);
    s->request = *request;
    s->result = sampler_sizes(request, &s->sizes);
    s->table = kd_guarded_make(s->sizes.table_bytes, rubbish);
    s->scratch = kd_guarded_make(s->sizes.scratch_bytes, 255 - rubbish);
}

/* The build in one call, into buffers that are there. */
static inline envsamp_result sampler_build(sampler *s)
{
    const sampler_request *r = &s->request;
    const envsamp_kd_desc kd = sampler_kd_desc(r);
    const envsamp_cdf_desc cdf = sampler_cdf_desc(r);

    if (r->fn && r->kind == SAMPLER_CDF)
        s->result = envsamp_cdf_build_rows(&r->image, r->fn, r->user, &cdf, s->table.buffer,
                                           s->scratch.buffer, &s->cdf);
    else if (r->fn)
        s->result = envsamp_kd_build_rows(&r->image, r->fn, r->user, &kd, s->table.buffer,
                                          s->scratch.buffer, &s->kd);
    else if (r->kind == SAMPLER_CDF)
        s->result = envsamp_cdf_build(&r->image, &cdf, s->table.buffer, s->scratch.buffer,
                                      &s->cdf);
    else
        s->result = envsamp_kd_build(&r->image, &kd, s->table.buffer, s->scratch.buffer, &s->kd);
    return s->result;
}

/* The build in steps. Neither the image nor the description outlives _begin. */
static inline envsamp_result sampler_begin(sampler *s)
{
    static envsamp_image image;
    static envsamp_kd_desc kd;
    static envsamp_cdf_desc cdf;
    const sampler_request *r = &s->request;

    image = r->image;
    kd = sampler_kd_desc(r);
    cdf = sampler_cdf_desc(r);
    if (r->kind == SAMPLER_CDF)
        s->result = envsamp_cdf_begin(&image, r->fn, r->user, &cdf, s->table.buffer,
                                      s->scratch.buffer, &s->cdf_job);
    else
        s->result = envsamp_kd_begin(&image, r->fn, r->user, &kd, s->table.buffer,
                                     s->scratch.buffer, &s->kd_job);
    memset(&image, 0xee, sizeof image);
    memset(&kd, 0xee, sizeof kd);
    memset(&cdf, 0xee, sizeof cdf);
    return s->result;
}

static inline int sampler_has_job(const sampler *s)
{
    return s->request.kind == SAMPLER_CDF ? s->cdf_job != NULL : s->kd_job != NULL;
}

static inline envsamp_result sampler_step(sampler *s, int count, int *done)
{
    return s->result = s->request.kind == SAMPLER_CDF ? envsamp_cdf_step(s->cdf_job, count, done)
                                                      : envsamp_kd_step(s->kd_job, count, done);
}

static inline envsamp_result sampler_finish(sampler *s)
{
    return s->result = s->request.kind == SAMPLER_CDF ? envsamp_cdf_finish(s->cdf_job, &s->cdf)
                                                      : envsamp_kd_finish(s->kd_job, &s->kd);
}

/* Buffers and a table, by one call. Free it in either case. */
static inline int sampler_make(sampler *s, const sampler_request *request)
{
    sampler_prepare(s, request, 0x3c);
    if (s->result == ENVSAMP_OK)
        sampler_build(s);
    return s->result == ENVSAMP_OK;
}

static inline int sampler_intact(const sampler *s)
{
    return kd_guarded_intact(&s->table) && kd_guarded_intact(&s->scratch);
}

static inline void sampler_free(sampler *s)
{
    free(s->table.block);
    free(s->scratch.block);
    memset(s, 0, sizeof *s);
}

/* ---- tables ---- */

static inline const void *sampler_data(const sampler *s)
{
    return s->request.kind == SAMPLER_CDF ? (const void *)s->cdf : (const void *)s->kd;
}

static inline size_t sampler_bytes(const sampler *s)
{
    if (!sampler_data(s))
        return 0;
    return s->request.kind == SAMPLER_CDF ? envsamp_cdf_bytes(s->cdf) : envsamp_kd_bytes(s->kd);
}

static inline int sampler_equal(const sampler *a, const sampler *b)
{
    return sampler_data(a) && sampler_data(b) && sampler_bytes(a) == sampler_bytes(b)
        && !memcmp(sampler_data(a), sampler_data(b), sampler_bytes(a));
}

/* Opens bytes as a table of the kind that s is, into s. */
static inline envsamp_result sampler_open(sampler *s, const void *bytes, size_t count)
{
    return s->request.kind == SAMPLER_CDF ? envsamp_cdf_open(bytes, count, &s->cdf)
                                          : envsamp_kd_open(bytes, count, &s->kd);
}

/* Whether what is in the table's buffer passes for a table. */
static inline int sampler_opens(const sampler *s)
{
    sampler other = *s;

    return sampler_open(&other, s->table.buffer.data, s->table.buffer.bytes) == ENVSAMP_OK;
}

static inline sampler_info sampler_get_info(const sampler *s)
{
    envsamp_cdf_info cdf;
    envsamp_kd_info kd;
    sampler_info info;

    memset(&cdf, 0, sizeof cdf);
    memset(&kd, 0, sizeof kd);
    if (s->request.kind == SAMPLER_CDF)
        envsamp_cdf_get_info(s->cdf, &cdf);
    else
        envsamp_kd_get_info(s->kd, &kd);
    info.integral = kd.integral + cdf.integral;
    info.excess_variance = kd.excess_variance + cdf.excess_variance;
    info.max_ratio = kd.max_ratio + cdf.max_ratio;
    info.bad_pixel_count = kd.bad_pixel_count + cdf.bad_pixel_count;
    info.mis_compensation = kd.mis_compensation + cdf.mis_compensation;
    info.bilinear = s->request.kind == SAMPLER_CDF ? !cdf.nearest : !kd.nearest;
    info.mapping = s->request.kind == SAMPLER_CDF ? cdf.mapping : kd.mapping;
    return info;
}

static inline envsamp_sample sampler_draw(const sampler *s, float u0, float u1)
{
    return s->request.kind == SAMPLER_CDF ? envsamp_cdf_sample(s->cdf, u0, u1)
                                          : envsamp_kd_sample(s->kd, u0, u1);
}

static inline float sampler_pdf(const sampler *s, const float dir[3])
{
    return s->request.kind == SAMPLER_CDF ? envsamp_cdf_pdf(s->cdf, dir)
                                          : envsamp_kd_pdf(s->kd, dir);
}

static inline int sampler_invert(const sampler *s, const float dir[3], float u[2])
{
    return s->request.kind == SAMPLER_CDF ? envsamp_cdf_invert(s->cdf, dir, u)
                                          : envsamp_kd_invert(s->kd, dir, u);
}

static inline int sampler_inverts(const sampler *s)
{
    return s->request.kind == SAMPLER_CDF || s->request.kind == SAMPLER_WARP;
}

/* u: 2 rows of n; out: 4 rows of n: x, y, z, pdf. */
static inline void sampler_draw_n(const sampler *s, size_t n, const float *u, float *out)
{
    if (s->request.kind == SAMPLER_CDF)
        envsamp_cdf_sample_n(s->cdf, n, u, u + n, out, out + n, out + 2 * n, out + 3 * n);
    else
        envsamp_kd_sample_n(s->kd, n, u, u + n, out, out + n, out + 2 * n, out + 3 * n);
}

/* dirs: 3 rows of n. */
static inline void sampler_pdf_n(const sampler *s, size_t n, const float *dirs, float *pdf)
{
    if (s->request.kind == SAMPLER_CDF)
        envsamp_cdf_pdf_n(s->cdf, n, dirs, dirs + n, dirs + 2 * n, pdf);
    else
        envsamp_kd_pdf_n(s->kd, n, dirs, dirs + n, dirs + 2 * n, pdf);
}

#endif
