/* fuzz.c: fuzz targets, each a function that makes one case of its input and checks what comes out:
 *
 *     build      tables of both kinds from any image and description, and lookups in the map
 *     steps      builds in steps from rows that a function makes, that fails, and that are given up
 *     open       tables that were damaged
 *     lights     lights of every method, interleaved sets, and masks of emissive texels
 *     halftone   error diffusion
 *     lm         least squares of functions with walls, kinks, noise and overflow
 *
 * With libFuzzer (see fuzz.sh), FUZZ_TARGET=name in the environment chooses the target:
 *
 *     FUZZ_TARGET=open build/fuzz crash-...
 *
 * test_fuzz.c runs them without it.
 */
#include "fuzz.h"
#include "sampler.h"

/* Memory beyond this is not tried, sizes are. */
#define MOST_BYTES ((size_t)8 << 20)

static void check_named(envsamp_result result)
{
    FUZZ_CHECK((uint32_t)result <= ENVSAMP_ERR_FORMAT);
    FUZZ_CHECK(envsamp_result_string(result) && envsamp_result_string(result)[0]);
}

static int within(double value, double low, double high) { return value >= low && value <= high; }

static int close_to(double value, double expected, double relative)
{
    return fabs(value - expected) <= relative * fabs(expected);
}

static void check_unit(const float dir[3])
{
    const double x = (double)dir[0], y = (double)dir[1], z = (double)dir[2];

    FUZZ_CHECK(within(sqrt(x * x + y * y + z * z), 1.0 - 1e-6, 1.0 + 1e-6));
}

static void check_density(float pdf) { FUZZ_CHECK(pdf >= 0.0f && pdf <= FLT_MAX); }

/* ---- samples, densities, inverses, blocks of a table ---- */

enum { BATCH = 140 };           /* more than two batches of the library */

/* `whole`: the table is as it was built. */
static envsamp_sample check_draw(const sampler *s, float u0, float u1, int whole)
{
    const envsamp_sample drawn = sampler_draw(s, u0, u1);

    check_unit(drawn.dir);
    check_density(drawn.pdf);
    FUZZ_CHECK(!whole || drawn.pdf > 0.0f);
    FUZZ_CHECK(drawn.uv[0] >= 0.0f && drawn.uv[0] <= 1.0f);
    FUZZ_CHECK(drawn.uv[1] >= 0.0f && drawn.uv[1] <= 1.0f);
    return drawn;
}

static float check_pdf(const sampler *s, const float dir[3])
{
    const float pdf = sampler_pdf(s, dir);
    float u[2] = { -1.0f, -1.0f };
    const int inverted = sampler_invert(s, dir, u);

    check_density(pdf);
    FUZZ_CHECK(inverted == 0 || inverted == 1);
    FUZZ_CHECK(u[0] >= 0.0f && u[0] < 1.0f && u[1] >= 0.0f && u[1] < 1.0f);
    if (!inverted)
        FUZZ_CHECK(u[0] == 0.0f && u[1] == 0.0f);
    if (s->request.kind == SAMPLER_CDF)     /* WARP may take another block for the edge of one */
        FUZZ_CHECK(inverted == (pdf > 0.0f));
    if (!sampler_inverts(s))
        FUZZ_CHECK(!inverted);
    return pdf;
}

static int same_bits(const float *a, const float *b, size_t count)
{
    return count == 0 || !memcmp(a, b, count * sizeof *a);
}

/* Batches, in memory that ends where they do, against one at a time. `in_place`: over the
   inputs. */
static void check_batches(const sampler *s, fuzz_input *in, int n, int in_place, int whole)
{
    const size_t count = (size_t)n, bytes = 2 * count * sizeof(float);
    fuzz_guard inputs = fuzz_guard_make(bytes, 4, 0), outputs = fuzz_guard_make(2 * bytes, 4, 0xff);
    float *u = (float *)(void *)inputs.data, *out = (float *)(void *)outputs.data;
    float one[4 * BATCH], density[BATCH];
    int i, c;

    for (i = 0; i < 2 * n; i++)
        u[i] = i % 16 ? pcg32_float(&in->random) : fuzz_float(in);
    for (i = 0; i < n; i++) {
        const envsamp_sample drawn = check_draw(s, u[i], u[n + i], whole);

        for (c = 0; c < 3; c++)
            one[c * n + i] = drawn.dir[c];
        one[3 * n + i] = drawn.pdf;
        density[i] = check_pdf(s, drawn.dir);
    }
    if (in_place) {
        memcpy(out, u, bytes);
        sampler_draw_n(s, count, out, out);
    } else {
        sampler_draw_n(s, count, u, out);
    }
    FUZZ_CHECK(same_bits(out, one, 4 * count));
    sampler_pdf_n(s, count, out, in_place ? out : out + 3 * n);
    FUZZ_CHECK(same_bits(in_place ? out : out + 3 * n, density, count));
    fuzz_guard_free(&inputs);
    fuzz_guard_free(&outputs);
}

/* As check_draw and check_pdf, of samples that face a normal. */
static envsamp_sample check_facing(const envsamp_kd *kd, const float normal[3], float u0, float u1,
                                   int whole)
{
    const envsamp_sample drawn = envsamp_kd_sample_facing(kd, normal, u0, u1);
    const float pdf = envsamp_kd_pdf_facing(kd, normal, drawn.dir);
    float u[2] = { -1.0f, -1.0f };

    check_unit(drawn.dir);
    check_density(drawn.pdf);
    check_density(pdf);
    FUZZ_CHECK(!whole || drawn.pdf > 0.0f);
    FUZZ_CHECK(drawn.uv[0] >= 0.0f && drawn.uv[0] <= 1.0f);
    FUZZ_CHECK(drawn.uv[1] >= 0.0f && drawn.uv[1] <= 1.0f);
    if (!envsamp_kd_invert_facing(kd, normal, drawn.dir, u))
        FUZZ_CHECK(u[0] == 0.0f && u[1] == 0.0f);
    FUZZ_CHECK(u[0] >= 0.0f && u[0] < 1.0f && u[1] >= 0.0f && u[1] < 1.0f);
    return drawn;
}

/* One normal, which may be none, and one batch, in memory that ends where it does. */
static void check_normal(const envsamp_kd *kd, fuzz_input *in, int n, int whole)
{
    const size_t count = (size_t)n;
    fuzz_guard inputs = fuzz_guard_make(2 * count * sizeof(float), 4, 0);
    fuzz_guard outputs = fuzz_guard_make(4 * count * sizeof(float), 4, 0xff);
    float *u = (float *)(void *)inputs.data, *out = (float *)(void *)outputs.data;
    float normal[3], one[4 * BATCH] = { 0.0f };
    int i, c;

    fuzz_dir(in, normal);
    for (i = 0; i < 2 * n; i++)
        u[i] = i % 16 ? pcg32_float(&in->random) : fuzz_float(in);
    for (i = 0; i < n; i++) {
        const envsamp_sample drawn = check_facing(kd, normal, u[i], u[n + i], whole);

        for (c = 0; c < 3; c++)
            one[c * n + i] = drawn.dir[c];
        one[3 * n + i] = drawn.pdf;
    }
    envsamp_kd_sample_facing_n(kd, normal, count, u, u + n, out, out + n, out + 2 * n, out + 3 * n);
    FUZZ_CHECK(same_bits(out, one, 4 * count));
    for (i = 0; i < n; i++) {
        const float dir[3] = { out[i], out[n + i], out[2 * n + i] };

        one[i] = envsamp_kd_pdf_facing(kd, normal, dir);
    }
    envsamp_kd_pdf_facing_n(kd, normal, count, out, out + n, out + 2 * n, u);
    FUZZ_CHECK(same_bits(u, one, count));
    fuzz_guard_free(&inputs);
    fuzz_guard_free(&outputs);
}

/* Any directions, of which some are none. */
static void check_densities(const sampler *s, fuzz_input *in, int n)
{
    float dirs[3 * BATCH], density[BATCH], one;
    int i, c;

    for (i = 0; i < n; i++) {
        float dir[3];

        fuzz_dir(in, dir);
        for (c = 0; c < 3; c++)
            dirs[c * n + i] = dir[c];
    }
    sampler_pdf_n(s, (size_t)n, dirs, density);
    for (i = 0; i < n; i++) {
        const float dir[3] = { dirs[i], dirs[n + i], dirs[2 * n + i] };

        one = check_pdf(s, dir);
        FUZZ_CHECK(same_bits(&one, density + i, 1));
    }
}

/* Blocks of a table that is whole tile the map, and are drawn with probabilities that sum to 1. */
static void check_blocks(const sampler *s, fuzz_input *in, int whole)
{
    double sr = 0.0, probability = 0.0;
    envsamp_kd_block block;
    envsamp_kd_info info;
    int i, wrong;

    FUZZ_CHECK(envsamp_kd_get_info(s->kd, &info) == ENVSAMP_OK && info.block_count >= 1);
    for (i = 0; i < info.block_count; i += whole ? 1 : 1 + info.block_count / 64) {
        FUZZ_CHECK(envsamp_kd_get_block(s->kd, i, &block) == ENVSAMP_OK);
        FUZZ_CHECK(block.uv_min[0] >= 0.0f && block.uv_max[0] <= 1.0f);
        FUZZ_CHECK(block.uv_min[1] >= 0.0f && block.uv_max[1] <= 1.0f);
        FUZZ_CHECK(block.solid_angle >= 0.0f && block.solid_angle <= 12.6f);
        FUZZ_CHECK(block.probability >= 0.0f);
        FUZZ_CHECK(!whole || (block.probability <= 1.0f && block.solid_angle > 0.0f));
        FUZZ_CHECK(!whole || (block.uv_min[0] < block.uv_max[0]
                              && block.uv_min[1] < block.uv_max[1]));
        sr += (double)block.solid_angle;
        probability += (double)block.probability;
    }
    if (whole) {
        FUZZ_CHECK(close_to(sr, info.mapping == ENVSAMP_HEMISPHERE ? 2.0 * KD_PI : 4.0 * KD_PI,
                            1e-5));
        FUZZ_CHECK(close_to(probability, 1.0, 1e-5));
    }
    wrong = fuzz_any_int(in);
    if (wrong < 0 || wrong >= info.block_count)
        FUZZ_CHECK(envsamp_kd_get_block(s->kd, wrong, &block) == ENVSAMP_ERR_PARAM);
}

/* No samples at all, of which the pointers may be NULL. */
static void check_nothing(const sampler *s)
{
    if (s->request.kind == SAMPLER_CDF) {
        envsamp_cdf_sample_n(s->cdf, 0, NULL, NULL, NULL, NULL, NULL, NULL);
        envsamp_cdf_pdf_n(s->cdf, 0, NULL, NULL, NULL, NULL);
    } else {
        envsamp_kd_sample_n(s->kd, 0, NULL, NULL, NULL, NULL, NULL, NULL);
        envsamp_kd_pdf_n(s->kd, 0, NULL, NULL, NULL, NULL);
        envsamp_kd_sample_facing_n(s->kd, NULL, 0, NULL, NULL, NULL, NULL, NULL, NULL);
        envsamp_kd_pdf_facing_n(s->kd, NULL, 0, NULL, NULL, NULL, NULL);
    }
}

static void check_table(const sampler *s, fuzz_input *in, int whole)
{
    static const float special[] = { 0.0f, 1.0f, NAN, INFINITY, 0.99999994f, -0.0f, 1e-45f };
    const int n = fuzz_rarely(in, 8) ? (int)fuzz_below(in, BATCH + 1) : (int)fuzz_below(in, 10);
    int i;

    for (i = 0; i < 7; i++) {
        const envsamp_sample drawn = check_draw(s, special[i], special[(i * 3 + n) % 7], whole);

        check_pdf(s, drawn.dir);
    }
    check_batches(s, in, n, n % 2, whole);
    check_nothing(s);
    check_densities(s, in, n);
    if (s->request.kind != SAMPLER_CDF) {
        check_blocks(s, in, whole);
        check_normal(s->kd, in, n, whole);
        check_normal(s->kd, in, 1 + n / 8, whole);
    }
}

/* ---- requests for tables ---- */

typedef struct request {
    int cdf;
    envsamp_kd_desc kd_desc;
    envsamp_cdf_desc cdf_desc;
    int defaults;               /* NULL is given for the description */
    int nowhere;                /* and for the image */
    fuzz_map map;
    envsamp_sizes sizes;
    envsamp_result sized;       /* what _sizes returned */
} request;

static void request_kd(fuzz_input *in, envsamp_kd_desc *desc)
{
    if (fuzz_rarely(in, 2))
        *desc = envsamp_kd_defaults();
    desc->block_count = fuzz_int(in, 0, fuzz_rarely(in, 4) ? 300 : 24, 32);
    desc->select = (envsamp_kd_select)fuzz_int(in, 0, 2, 64);
    desc->criterion = (envsamp_kd_criterion)fuzz_int(in, 0, 3, 64);
    desc->model = (envsamp_kd_model)fuzz_int(in, 0, 1, 64);
    desc->objective = (envsamp_kd_objective)fuzz_int(in, 0, 1, 64);
    desc->nearest = fuzz_int(in, 0, 1, 64);
    desc->strict = fuzz_rarely(in, 8);
    if (fuzz_rarely(in, 3))
        desc->mis_compensation = fuzz_rarely(in, 4) ? fuzz_float(in) : fuzz_unit(in);
    desc->facing = desc->select == ENVSAMP_KD_WARP && fuzz_rarely(in, 2);
    if (fuzz_rarely(in, 16)) {
        desc->facing = (int)fuzz_below(in, 2);
        desc->excess_target = fuzz_rarely(in, 2) ? fuzz_float(in) : 0.0f;
        desc->importance_exponent = fuzz_rarely(in, 4) ? fuzz_float(in)
                                                       : 0.5f + 1.5f * fuzz_unit(in);
    }
}

static request request_make(fuzz_input *in, int most)
{
    const envsamp_image *image;
    request r;

    memset(&r, 0, sizeof r);
    r.cdf = fuzz_rarely(in, 3);
    request_kd(in, &r.kd_desc);
    r.cdf_desc = envsamp_cdf_defaults();
    r.cdf_desc.nearest = r.kd_desc.nearest;
    r.cdf_desc.strict = r.kd_desc.strict;
    r.cdf_desc.mis_compensation = r.kd_desc.mis_compensation;
    r.cdf_desc.importance_exponent = r.kd_desc.importance_exponent;
    r.defaults = fuzz_rarely(in, 64);
    r.nowhere = fuzz_rarely(in, 128);
    r.map = fuzz_map_make(in, most);
    image = r.nowhere ? NULL : &r.map.image;
    r.sized = r.cdf ? envsamp_cdf_sizes(image, r.defaults ? NULL : &r.cdf_desc, &r.sizes)
                    : envsamp_kd_sizes(image, r.defaults ? NULL : &r.kd_desc, &r.sizes);
    check_named(r.sized);
    FUZZ_CHECK(r.sized != ENVSAMP_OK || (!r.nowhere && fuzz_image_good(image)));
    if (r.sized != ENVSAMP_OK)
        FUZZ_CHECK(r.sizes.table_bytes == 0 && r.sizes.scratch_bytes == 0);
    else
        FUZZ_CHECK(r.sizes.table_bytes > 0 && r.sizes.scratch_bytes > 0);
    return r;
}

/* Whether the buffers are of a size that is worth trying. */
static int request_small(const request *r)
{
    return (r->map.made || r->sized != ENVSAMP_OK) && r->sizes.table_bytes <= MOST_BYTES
        && r->sizes.scratch_bytes <= MOST_BYTES;
}

/* In force, where the description is NULL too. */
static int request_nearest(const request *r) { return !r->defaults && r->kd_desc.nearest != 0; }

static void request_free(request *r) { fuzz_map_free(&r->map); }

/* A sampler of one request, in buffers of its own. */
typedef struct table {
    sampler s;
    fuzz_guard table, scratch;
    envsamp_result result;
} table;

/* Buffers of exactly the sizes asked for. */
static table table_make(const request *r, int fill)
{
    table t;

    memset(&t, 0, sizeof t);
    t.s.request.kind = r->cdf ? SAMPLER_CDF
                     : r->defaults ? SAMPLER_WARP : (int)r->kd_desc.select;
    t.table = fuzz_buffer_make(r->sizes.table_bytes, fill);
    t.scratch = fuzz_buffer_make(r->sizes.scratch_bytes, 255 - fill);
    return t;
}

static void table_free(table *t)
{
    fuzz_guard_free(&t->table);
    fuzz_guard_free(&t->scratch);
}

/* A build that fails hands nothing out, and leaves nothing that opens; one that does not leaves a
   table that opens. */
static void check_built(table *t)
{
    sampler opened = t->s;
    envsamp_result result;

    check_named(t->result);
    FUZZ_CHECK(t->result != ENVSAMP_ERR_FORMAT);
    FUZZ_CHECK((t->result == ENVSAMP_OK) == (sampler_data(&t->s) != NULL));
    opened.kd = NULL;
    opened.cdf = NULL;
    result = sampler_open(&opened, t->table.data, t->table.bytes);
    FUZZ_CHECK(result == (t->result == ENVSAMP_OK ? ENVSAMP_OK : ENVSAMP_ERR_FORMAT));
    FUZZ_CHECK(sampler_data(&opened) == sampler_data(&t->s));
    FUZZ_CHECK(sampler_bytes(&t->s) <= t->table.bytes);
}

static envsamp_result build_into(const request *r, table *t, envsamp_buffer to,
                                 envsamp_buffer scratch)
{
    const envsamp_image *image = r->nowhere ? NULL : &r->map.image;
    sampler *s = &t->s;

    s->kd = (const envsamp_kd *)(const void *)"not a table";
    s->cdf = (const envsamp_cdf *)(const void *)"not a table";
    return t->result = r->cdf
        ? envsamp_cdf_build(image, r->defaults ? NULL : &r->cdf_desc, to, scratch, &s->cdf)
        : envsamp_kd_build(image, r->defaults ? NULL : &r->kd_desc, to, scratch, &s->kd);
}

static table table_build(const request *r, int fill)
{
    table t = table_make(r, fill);

    build_into(r, &t, fuzz_buffer(&t.table), fuzz_buffer(&t.scratch));
    check_built(&t);
    return t;
}

/* What must come of a request whose buffers are right. */
static envsamp_result request_result(const request *r, const fuzz_facts *facts)
{
    if (r->sized != ENVSAMP_OK)
        return r->nowhere ? ENVSAMP_ERR_NULL : r->sized;
    if (!r->map.image.pixels)
        return ENVSAMP_ERR_NULL;
    if (r->map.skew)
        return ENVSAMP_ERR_ALIGN;
    if (!r->defaults && r->kd_desc.strict && facts->bad)
        return ENVSAMP_ERR_VALUE;
    return facts->lit ? ENVSAMP_OK : ENVSAMP_ERR_BLACK;
}

static void check_info(const request *r, const table *t, const fuzz_facts *facts)
{
    const sampler_info info = sampler_get_info(&t->s);

    FUZZ_CHECK(info.bad_pixel_count == facts->bad);
    FUZZ_CHECK(info.mapping == r->map.image.mapping);
    FUZZ_CHECK(within((double)info.mis_compensation, 0.0, 1.0));
    FUZZ_CHECK(within(info.integral, 0.0, DBL_MAX));
    FUZZ_CHECK(within(info.excess_variance, 0.0, DBL_MAX));
    FUZZ_CHECK(within(info.max_ratio, 0.0, DBL_MAX));
    if (facts->brightest > 1e-30 && request_nearest(r))
        FUZZ_CHECK(close_to(info.integral, facts->luminance, 1e-5));
}

static void check_equal(const table *a, const table *b)
{
    FUZZ_CHECK(a->result == b->result);
    FUZZ_CHECK(a->result != ENVSAMP_OK || sampler_equal(&a->s, &b->s));
}

/* ---- target: build ---- */

/* Buffers that are too small, missing or out of alignment. */
static void check_bad_buffers(const request *r, fuzz_input *in)
{
    table t = table_make(r, 0x3c);
    envsamp_buffer buffers[2];
    envsamp_result expected = r->sized;
    const uint32_t which = fuzz_below(in, 2), wrong = fuzz_below(in, 3);
    envsamp_buffer *buffer = &buffers[which];

    buffers[0] = fuzz_buffer(&t.table);
    buffers[1] = fuzz_buffer(&t.scratch);
    if (wrong == 0)
        buffer->data = NULL;
    else if (wrong == 1 && buffer->bytes)
        buffer->bytes -= 1 + fuzz_below(in, (uint32_t)buffer->bytes);
    else
        buffer->data = (uint8_t *)buffer->data + 1 + fuzz_below(in, ENVSAMP_ALIGN - 1);
    if (expected == ENVSAMP_OK)
        expected = wrong == 0 || !r->map.image.pixels ? ENVSAMP_ERR_NULL
                 : wrong == 1 ? ENVSAMP_ERR_MEMORY : ENVSAMP_ERR_ALIGN;
    build_into(r, &t, buffers[0], buffers[1]);
    FUZZ_CHECK(t.result == expected || (r->map.skew && t.result == ENVSAMP_ERR_ALIGN));
    FUZZ_CHECK(!sampler_data(&t.s));
    table_free(&t);
}

static void check_mapping(fuzz_input *in)
{
    const envsamp_mapping mapping = (envsamp_mapping)fuzz_int(in, 0, 2, 16);
    const float u = fuzz_float(in), v = fuzz_float(in), other = fuzz_float(in);
    float dir[3], uv[2], weight;

    envsamp_uv_to_dir(mapping, u, v, dir);
    if ((uint32_t)mapping <= ENVSAMP_OCTAHEDRAL)
        check_unit(dir);
    else
        FUZZ_CHECK(dir[0] == 0.0f && dir[1] == 0.0f && dir[2] == 0.0f);
    fuzz_dir(in, dir);
    envsamp_dir_to_uv(mapping, dir, uv);
    FUZZ_CHECK(uv[0] >= 0.0f && uv[0] <= 1.0f && uv[1] >= 0.0f && uv[1] <= 2.0f);
    weight = envsamp_mis_power(u, other);
    if (u >= 0.0f && other >= 0.0f)
        FUZZ_CHECK(weight >= 0.0f && weight <= 1.0f);
}

static void check_lookups(const fuzz_map *map, fuzz_input *in, const fuzz_facts *facts)
{
    int i, c;

    for (i = 0; i < 6; i++) {
        float dir[3], rgb[3] = { -1.0f, -1.0f, -1.0f };

        fuzz_dir(in, dir);
        envsamp_lookup(&map->image, i % 2, dir, rgb);
        for (c = 0; c < 3; c++)
            FUZZ_CHECK(rgb[c] >= 0.0f);
        if (facts->brightest < 0.999 * (double)FLT_MAX)     /* above it weights round to infinity */
            FUZZ_CHECK((double)envsamp_luminance(rgb) <= 1.00001 * facts->brightest + 1e-40);
    }
}

static void target_build(fuzz_input *in)
{
    request r = request_make(in, fuzz_rarely(in, 8) ? 40 : 9);

    check_mapping(in);
    if (request_small(&r)) {
        table first = table_build(&r, 0), second = table_build(&r, 0xff);

        if (r.map.made && r.map.image.pixels) {
            const fuzz_facts facts = fuzz_map_facts(&r.map);

            if (!r.map.skew)
                check_lookups(&r.map, in, &facts);
            FUZZ_CHECK(first.result == request_result(&r, &facts));
            if (first.result == ENVSAMP_OK)
                check_info(&r, &first, &facts);
        }
        if (first.result == ENVSAMP_OK)
            check_table(&first.s, in, 1);
        check_equal(&first, &second);
        if (fuzz_rarely(in, 8))
            check_bad_buffers(&r, in);
        table_free(&first);
        table_free(&second);
    }
    request_free(&r);
}

/* ---- target: steps ---- */

/* Rows of a map, up to one that fails. */
typedef struct row_source {
    const fuzz_map *map;
    const fuzz_guard *scratch;
    int calls, fail_at;         /* fail_at: the number of a call, or -1 */
    envsamp_result failure;
} row_source;

static envsamp_result give_row(int y, float *row, void *user)
{
    row_source *source = (row_source *)user;
    const size_t bytes = fuzz_row_bytes(&source->map->image);
    const uint8_t *at = (const uint8_t *)row;

    FUZZ_CHECK(y == source->calls % source->map->image.height);
    FUZZ_CHECK(source->calls < 3 * source->map->image.height);
    FUZZ_CHECK(source->fail_at < 0 || source->calls <= source->fail_at);
    FUZZ_CHECK(at >= source->scratch->data
               && at + bytes <= source->scratch->data + source->scratch->bytes);
    if (source->calls++ == source->fail_at) {
        memset(row, 0x7f, bytes);
        return source->failure;
    }
    memcpy(row, fuzz_row(source->map, y), bytes);
    return ENVSAMP_OK;
}

/* Neither image nor description outlives this. */
static void begin(const request *r, table *t, row_source *source)
{
    const envsamp_row_fn fn = source ? give_row : NULL;
    envsamp_image image = r->map.image;
    const envsamp_image *at = r->nowhere ? NULL : &image;
    envsamp_kd_desc kd = r->kd_desc;
    envsamp_cdf_desc cdf = r->cdf_desc;

    t->s.kd_job = (envsamp_kd_job *)(void *)t->table.data;      /* which it is not */
    t->s.cdf_job = (envsamp_cdf_job *)(void *)t->table.data;
    if (r->cdf)
        t->result = envsamp_cdf_begin(at, fn, source, r->defaults ? NULL : &cdf,
                                      fuzz_buffer(&t->table), fuzz_buffer(&t->scratch),
                                      &t->s.cdf_job);
    else
        t->result = envsamp_kd_begin(at, fn, source, r->defaults ? NULL : &kd,
                                     fuzz_buffer(&t->table), fuzz_buffer(&t->scratch),
                                     &t->s.kd_job);
    check_named(t->result);
    FUZZ_CHECK(sampler_has_job(&t->s) == (t->result == ENVSAMP_OK));
    memset(&image, 0xee, sizeof image);
    memset(&kd, 0xee, sizeof kd);
    memset(&cdf, 0xee, sizeof cdf);
}

/* Some steps. Returns whether all is done, or has failed. */
static int take_steps(table *t, fuzz_input *in)
{
    static const int counts[] = { 1, 1, 3, 17, 1000, INT_MAX, 0, -1, INT_MIN };
    int calls, done = 0;

    for (calls = (int)fuzz_below(in, 64); calls > 0 && !done; calls--) {
        const int count = counts[fuzz_below(in, 9)];

        done = -1;
        t->result = sampler_step(&t->s, count, fuzz_rarely(in, 8) ? NULL : &done);
        FUZZ_CHECK(done >= -1 && done <= 1);
        FUZZ_CHECK(t->result == ENVSAMP_OK || done);
        if (done == 0)
            FUZZ_CHECK(!sampler_opens(&t->s));  /* what is not finished is no table */
        done = done > 0;
    }
    return done || t->result != ENVSAMP_OK;
}

/* What has failed stays so, and calls nothing. */
static void check_failed(table *t, const row_source *source)
{
    const int calls = source->calls;
    const envsamp_result result = t->result;
    int done = 0;

    FUZZ_CHECK(sampler_step(&t->s, 5, &done) == result && done == 1);
    FUZZ_CHECK(sampler_finish(&t->s) == result && !sampler_data(&t->s));
    FUZZ_CHECK(source->calls == calls);
    FUZZ_CHECK(!sampler_opens(&t->s));
}

static row_source source_make(const request *r, const table *t, fuzz_input *in)
{
    const int height = r->map.image.height;
    row_source source;

    memset(&source, 0, sizeof source);
    source.map = &r->map;
    source.scratch = &t->scratch;
    source.fail_at = -1;
    if (fuzz_rarely(in, 2)) {
        const int pass = r->map.made ? height : 1;
        const int places[] = { 0, pass / 2, pass - 1, pass, pass + pass / 2, 2 * pass - 1 };

        source.fail_at = places[fuzz_below(in, 6)];
        source.failure = (envsamp_result)(fuzz_rarely(in, 4) ? 1000 + (int)fuzz_byte(in)
                                                             : fuzz_range(in, 1, 8));
    }
    return source;
}

static void run_steps(const request *r, fuzz_input *in, const table *whole)
{
    table t = table_make(r, (int)fuzz_below(in, 256));
    row_source source = source_make(r, &t, in);
    const int pixels = fuzz_rarely(in, 4) && r->map.image.pixels;
    int done, failed;

    begin(r, &t, pixels ? NULL : &source);
    FUZZ_CHECK(t.result == r->sized);
    if (t.result == ENVSAMP_OK) {
        t.s.table.buffer = fuzz_buffer(&t.table);
        done = take_steps(&t, in);
        if (done || !fuzz_rarely(in, 4)) {      /* else it is given up */
            t.result = sampler_finish(&t.s);
            failed = source.fail_at >= 0 && source.calls > source.fail_at;
            if (failed)
                FUZZ_CHECK(t.result == source.failure);
            if (t.result != ENVSAMP_OK)
                check_failed(&t, &source);
            else
                check_built(&t);
            if (!failed && whole)
                check_equal(&t, whole);
        }
    }
    table_free(&t);
}

static void target_steps(fuzz_input *in)
{
    request r = request_make(in, fuzz_rarely(in, 8) ? 24 : 7);
    table whole;

    if (r.map.skew) {           /* which does not matter where a function gives rows */
        r.map.image.pixels = (const float *)(const void *)r.map.pixels.data;
        r.map.skew = 0;
    }
    if (request_small(&r) && (r.map.made || r.sized != ENVSAMP_OK)) {
        if (r.map.image.pixels) {
            whole = table_build(&r, 0x3c);
            run_steps(&r, in, &whole);
            table_free(&whole);
        } else {
            run_steps(&r, in, NULL);
        }
        FUZZ_CHECK(envsamp_kd_step(NULL, 1, NULL) == ENVSAMP_ERR_NULL);
        FUZZ_CHECK(envsamp_cdf_step(NULL, 1, NULL) == ENVSAMP_ERR_NULL);
    }
    request_free(&r);
}

/* ---- target: open ---- */

/* A table to damage, made when it is first asked for. */
typedef struct base { int kind; uint8_t *bytes; size_t size; } base;

/* Sides, blocks; the last are of the default size, and cdf has 64 by 32. */
static const int base_sizes[][3] = { { 1, 1, 1 }, { 2, 3, 5 }, { 8, 4, 21 }, { 13, 7, 64 },
                                     { 24, 16, 300 }, { 512, 256, 6144 } };

enum { BASE_SHAPES = 4 * 3 * 2, BASE_SIZES = sizeof base_sizes / sizeof base_sizes[0],
       BASES = BASE_SHAPES * BASE_SIZES };

/* Noise, and a lamp, by a generator of its own. */
static request base_request(int index)
{
    const int *size = base_sizes[index / BASE_SHAPES];
    const int kind = index % 4, large = size[0] == 512;
    fuzz_input in = fuzz_begin(NULL, 0);
    float *pixels;
    request r;
    int x;

    memset(&r, 0, sizeof r);
    r.cdf = kind == SAMPLER_CDF;
    r.kd_desc = envsamp_kd_defaults();
    r.kd_desc.block_count = size[2];
    r.kd_desc.select = r.cdf ? ENVSAMP_KD_WARP : (envsamp_kd_select)kind;
    r.kd_desc.nearest = r.cdf_desc.nearest = index / 12 % 2;
    r.kd_desc.model = (envsamp_kd_model)(index / 4 % 2);
    r.kd_desc.facing = kind == SAMPLER_WARP && index / 4 % 2;
    r.map.image.width = large && r.cdf ? 64 : size[0];
    r.map.image.height = large && r.cdf ? 32 : size[1];
    r.map.image.channels = 1;
    r.map.image.mapping = (envsamp_mapping)(index / 4 % 3);
    r.map.made = 1;
    r.map.pixels = fuzz_guard_make(fuzz_row_bytes(&r.map.image) * (size_t)r.map.image.height, 4, 0);
    pixels = (float *)(void *)r.map.pixels.data;
    r.map.image.pixels = pixels;
    for (x = 0; x < r.map.image.width * r.map.image.height; x++)
        pixels[x] = fuzz_radiance(&in, FUZZ_WIDE);
    pixels[x / 3] = 3000.0f;
    r.sized = r.cdf ? envsamp_cdf_sizes(&r.map.image, &r.cdf_desc, &r.sizes)
                    : envsamp_kd_sizes(&r.map.image, &r.kd_desc, &r.sizes);
    return r;
}

static const base *base_at(int index)
{
    static base bases[BASES];
    base *b = &bases[index];

    if (!b->bytes) {
        request r = base_request(index);
        table t = table_build(&r, 0);

        FUZZ_CHECK(t.result == ENVSAMP_OK);
        b->kind = index % 4;
        b->size = sampler_bytes(&t.s);
        b->bytes = (uint8_t *)kd_allocate(b->size);
        memcpy(b->bytes, sampler_data(&t.s), b->size);
        table_free(&t);
        request_free(&r);
    }
    return b;
}

static uint32_t damaged_word(fuzz_input *in, const uint8_t *bytes, size_t words, uint32_t word)
{
    static const uint32_t nasty[] = { 0, 1, 2, 0xffffffffu, 0x7f800000u, 0xff800000u, 0x7fc00000u,
        0x80000000u, 0x7fffffffu, 0x7fefffffu, 0xffff0000u, 0x0000ffffu, 0x00010000u, 1u << 20,
        1u << 24, 0x7f7fffffu, 0x3f800000u, 0x3f7fffffu, 0xbf800000u, 0x00ffffffu };

    switch (fuzz_below(in, 9)) {
    case 0: case 1: return nasty[fuzz_below(in, 20)];
    case 2: case 3: return word ^ 1u << fuzz_below(in, 32);
    case 4: return word + 1u;
    case 5: return word - 1u;
    case 6: return fuzz_word(in);
    case 7: return inside_word(bytes, 4 * (fuzz_word(in) % words));  /* right elsewhere */
    default: return fuzz_below(in, 64);
    }
}

/* Some words, of header and arrays alike, and then mostly the checksum, so that more than it is
   tried. */
static void damage(fuzz_input *in, int cdf, uint8_t *bytes, size_t size)
{
    const size_t words = size / 4, header = (cdf ? CDF_AT(end) : KD_AT(end)) / 4;
    int count = (int)fuzz_below(in, 7);

    if (size < 4 * header)
        return;
    while (count-- > 0) {
        const size_t among = fuzz_rarely(in, 3) ? header : words;
        const size_t at = 4 * (fuzz_word(in) % among);
        const uint32_t word = damaged_word(in, bytes, words, inside_word(bytes, at));

        memcpy(bytes + at, &word, sizeof word);
    }
    if (fuzz_rarely(in, 32))
        return;
    inside_seal(bytes, size);
}

static void target_open(fuzz_input *in)
{
    const int index = (int)(fuzz_rarely(in, 64) ? fuzz_below(in, BASES)
                                                : fuzz_below(in, BASES - BASE_SHAPES));
    const base *b = base_at(index);
    const int cdf = b->kind == SAMPLER_CDF;
    size_t size = b->size, lag = ENVSAMP_ALIGN;
    fuzz_guard copy;
    envsamp_result result;
    sampler s;

    memset(&s, 0, sizeof s);
    if (fuzz_rarely(in, 32))            /* cut off, or with something behind it */
        size = fuzz_rarely(in, 2) ? size + fuzz_below(in, 64) : fuzz_word(in) % size;
    if (fuzz_rarely(in, 64))
        lag += fuzz_below(in, ENVSAMP_ALIGN);
    copy = fuzz_guard_make(size, lag, 0x3c);
    memcpy(copy.data, b->bytes, size < b->size ? size : b->size);
    if (lag % ENVSAMP_ALIGN == 0)
        damage(in, cdf, copy.data, size);
    s.request.kind = b->kind;
    s.kd = (const envsamp_kd *)(const void *)"not a table";
    s.cdf = (const envsamp_cdf *)(const void *)"not a table";
    result = sampler_open(&s, copy.data, size);
    FUZZ_CHECK(result == ENVSAMP_OK || result == ENVSAMP_ERR_FORMAT || result == ENVSAMP_ERR_ALIGN);
    FUZZ_CHECK((result == ENVSAMP_ERR_ALIGN) == (lag % ENVSAMP_ALIGN != 0));
    FUZZ_CHECK((result == ENVSAMP_OK) == (sampler_data(&s) != NULL));
    if (result == ENVSAMP_OK) {
        FUZZ_CHECK(sampler_bytes(&s) <= size);
        s.request.kind = cdf ? SAMPLER_CDF : (int)KD_WORD(s.kd, select);    /* damaged, too */
        sampler_get_info(&s);
        check_table(&s, in, 0);
    }
    fuzz_guard_free(&copy);
}

/* ---- target: lights ---- */

static int lights_count(const envsamp_lights_desc *desc) { return desc->count ? desc->count : 32; }

static envsamp_lights_desc lights_desc(fuzz_input *in)
{
    envsamp_lights_desc desc = envsamp_lights_defaults();
    float *fields[7];
    int i;

    fields[0] = &desc.percentile;
    fields[1] = &desc.lambda;
    fields[2] = &desc.gamma;
    fields[3] = &desc.mask_scale;
    fields[4] = &desc.weight_variance;
    fields[5] = &desc.weight_extent;
    fields[6] = &desc.weight_energy;
    if (fuzz_rarely(in, 8))
        memset(&desc, 0, sizeof desc);
    desc.count = fuzz_int(in, 0, fuzz_rarely(in, 8) ? 200 : 12, 64);
    desc.method = (envsamp_lights_method)fuzz_int(in, 0, 5, 64);
    desc.refine_rounds = fuzz_int(in, -1, 4, 64);
    if (desc.refine_rounds > 500)
        desc.refine_rounds = 500;               /* any number ends, but some take seconds */
    desc.seed = fuzz_byte(in);
    desc.strict = fuzz_rarely(in, 8);
    for (i = 0; i < 7; i++)
        if (fuzz_rarely(in, 4))
            *fields[i] = fuzz_rarely(in, 4) ? fuzz_float(in) : fuzz_unit(in) - 0.125f;
    return desc;
}

static void check_light(const envsamp_light *light)
{
    int c;

    check_unit(light->dir);
    for (c = 0; c < 3; c++)
        check_density(light->irradiance[c]);
    check_density(light->solid_angle);
    FUZZ_CHECK(light->cos_extent >= -1.0f && light->cos_extent <= 1.0f);
    FUZZ_CHECK(light->direct == 0 || light->direct == 1);
}

/* Lights sum to the map in every channel, but where one is clamped. */
static void check_lights(const envsamp_lights_desc *desc, const envsamp_light *lights,
                         const envsamp_lights_info *info, const fuzz_facts *facts)
{
    double sum[3] = { 0.0, 0.0, 0.0 };
    int i, c, clamped = 0;

    FUZZ_CHECK(info->count == lights_count(desc) && info->bad_pixel_count == facts->bad);
    FUZZ_CHECK(info->direct_count >= 0 && info->direct_count <= info->count);
    check_density(info->threshold);
    for (i = 0; i < info->count; i++) {
        check_light(lights + i);
        FUZZ_CHECK(lights[i].direct == (i < info->direct_count));
        for (c = 0; c < 3; c++) {
            sum[c] += (double)lights[i].irradiance[c];
            clamped |= lights[i].irradiance[c] >= FLT_MAX;
        }
    }
    for (c = 0; c < 3 && facts->brightest > 1e-30; c++) {
        FUZZ_CHECK(close_to(info->integral[c], facts->integral[c], 1e-5));
        FUZZ_CHECK(clamped || fabs(sum[c] - info->integral[c])
                              <= 1e-4 * info->integral[c] + 1e-6 * facts->luminance);
    }
}

/* Other directions, nothing else; in place too, and of lights that are none. */
static void check_interleave(const envsamp_light *lights, int count, fuzz_input *in)
{
    const int set_count = fuzz_int(in, 1, 16, 16), set = fuzz_int(in, 0, 15, 16);
    const float extent = fuzz_rarely(in, 4) ? fuzz_float(in) : fuzz_unit(in);
    const size_t bytes = (size_t)count * sizeof *lights;
    const int damaged = fuzz_rarely(in, 4);
    fuzz_guard given = fuzz_guard_make(bytes, 4, 0), out = fuzz_guard_make(bytes, 4, 0x3c);
    envsamp_light *from = (envsamp_light *)(void *)given.data;
    envsamp_light *to = (envsamp_light *)(void *)out.data;
    envsamp_result result;
    int i, place = (int)fuzz_below(in, (uint32_t)count);

    memcpy(from, lights, bytes);
    if (damaged) {
        fuzz_dir(in, from[place].dir);
        from[place].cos_extent = fuzz_float(in);
    }
    result = envsamp_lights_interleave(from, count, set, set_count, extent, fuzz_byte(in), to);
    FUZZ_CHECK(result == (set_count >= 1 && set >= 0 && set < set_count && extent >= 0.0f
                          && extent <= 1.0f ? ENVSAMP_OK : ENVSAMP_ERR_PARAM));
    for (i = 0; i < count && result == ENVSAMP_OK; i++) {
        if (!damaged || i != place)
            check_unit(to[i].dir);
        memcpy(to[i].dir, from[i].dir, sizeof to[i].dir);
        FUZZ_CHECK(!memcmp(from + i, to + i, sizeof *to));
    }
    result = envsamp_lights_interleave(from, count, 0, 1, 0.5f, 7, from);
    FUZZ_CHECK(result == ENVSAMP_OK);
    fuzz_guard_free(&given);
    fuzz_guard_free(&out);
}

static void check_mask(const fuzz_map *map, const envsamp_lights_desc *desc, int fill, float *limit)
{
    const size_t texels = (size_t)map->image.width * (size_t)map->image.height;
    envsamp_lights_desc sized = envsamp_lights_defaults();
    fuzz_guard mask = fuzz_guard_make(texels, 1, 0x3c), scratch;
    envsamp_sizes sizes;
    envsamp_result result;
    size_t i;

    sized.method = ENVSAMP_LIGHTS_DECOMPOSED;
    sized.count = 1;
    FUZZ_CHECK(envsamp_lights_sizes(&map->image, &sized, &sizes) == ENVSAMP_OK);
    scratch = fuzz_buffer_make(sizes.scratch_bytes, fill);
    *limit = -1.0f;
    result = envsamp_emissive_mask(&map->image, desc, mask.data, fuzz_buffer(&scratch), limit);
    check_named(result);
    for (i = 0; i < texels && result == ENVSAMP_OK; i++) {
        float rgb[3], luminance;

        fuzz_texel(map, (int)(i % (size_t)map->image.width), (int)(i / (size_t)map->image.width),
                   rgb);
        luminance = map->image.channels == 1 ? rgb[0] : envsamp_luminance(rgb);
        FUZZ_CHECK(mask.data[i] == (luminance > *limit));
    }
    if (result == ENVSAMP_OK)
        check_density(*limit);
    fuzz_guard_free(&mask);
    fuzz_guard_free(&scratch);
}

static envsamp_result make_lights(const fuzz_map *map, const envsamp_lights_desc *desc,
                                  const envsamp_sizes *sizes, int fill, const fuzz_guard *out,
                                  envsamp_lights_info *info)
{
    fuzz_guard scratch = fuzz_buffer_make(sizes->scratch_bytes, fill);
    const envsamp_result result = envsamp_lights(&map->image, desc,
        (envsamp_light *)(void *)out->data, lights_count(desc), fuzz_buffer(&scratch), info);

    check_named(result);
    fuzz_guard_free(&scratch);
    return result;
}

static void run_lights(const fuzz_map *map, const envsamp_lights_desc *desc,
                       const envsamp_sizes *sizes, fuzz_input *in)
{
    const fuzz_facts facts = fuzz_map_facts(map);
    const size_t bytes = (size_t)lights_count(desc) * sizeof(envsamp_light);
    fuzz_guard first = fuzz_guard_make(bytes, 4, 0x11), second = fuzz_guard_make(bytes, 4, 0x11);
    const envsamp_light *lights = (const envsamp_light *)(const void *)first.data;
    envsamp_lights_info info;
    envsamp_result result = make_lights(map, desc, sizes, 0, &first, &info);

    FUZZ_CHECK(result == make_lights(map, desc, sizes, 0xff, &second, NULL));
    if (!map->image.pixels)
        FUZZ_CHECK(result == ENVSAMP_ERR_NULL);
    else if (map->skew)
        FUZZ_CHECK(result == ENVSAMP_ERR_ALIGN);
    else if (desc->strict && facts.bad)
        FUZZ_CHECK(result == ENVSAMP_ERR_VALUE);
    else if (facts.lit || facts.brightest == 0.0)   /* else only a double is above zero */
        FUZZ_CHECK(result == (facts.lit ? ENVSAMP_OK : ENVSAMP_ERR_BLACK));
    else
        FUZZ_CHECK(result == ENVSAMP_OK || result == ENVSAMP_ERR_BLACK);
    if (result == ENVSAMP_OK) {
        check_lights(desc, lights, &info, &facts);
        FUZZ_CHECK(!memcmp(first.data, second.data, bytes));
        check_interleave(lights, info.count, in);
        if (fuzz_rarely(in, 8)) {
            float limits[2];

            check_mask(map, desc, 0, limits);
            check_mask(map, desc, 0xff, limits + 1);
            FUZZ_CHECK(same_bits(limits, limits + 1, 1));
            if (desc->method == ENVSAMP_LIGHTS_DECOMPOSED)
                FUZZ_CHECK(same_bits(limits, &info.threshold, 1));
        }
    }
    fuzz_guard_free(&first);
    fuzz_guard_free(&second);
}

static void target_lights(fuzz_input *in)
{
    const envsamp_lights_desc desc = lights_desc(in);
    fuzz_map map = fuzz_map_make(in, fuzz_rarely(in, 8) ? 40 : 9);
    envsamp_sizes sizes;
    const envsamp_result result = envsamp_lights_sizes(&map.image, &desc, &sizes);

    check_named(result);
    FUZZ_CHECK(result != ENVSAMP_OK || fuzz_image_good(&map.image));
    if (result != ENVSAMP_OK)
        FUZZ_CHECK(sizes.table_bytes == 0 && sizes.scratch_bytes == 0);
    else if (map.made && sizes.scratch_bytes <= MOST_BYTES)
        run_lights(&map, &desc, &sizes, in);
    fuzz_map_free(&map);
}

/* ---- target: halftone ---- */

typedef struct tones {
    fuzz_map map;               /* of one channel */
    envsamp_halftone_desc desc;
    double sum;
    int lit, bad;
} tones;

static tones tones_make(fuzz_input *in)
{
    const int most = fuzz_rarely(in, 8) ? 60 : 12;
    tones t;
    int x, y;

    memset(&t, 0, sizeof t);
    t.desc.count = fuzz_int(in, 1, fuzz_rarely(in, 4) ? 400 : 20, 64);
    t.desc.kernel = (envsamp_kernel)fuzz_int(in, 0, 5, 64);
    t.desc.scan = (envsamp_scan)fuzz_int(in, 0, 1, 64);
    t.desc.seed = fuzz_byte(in);
    t.desc.once = (int)fuzz_below(in, 2);
    t.map = fuzz_map_make(in, most);
    if (t.map.image.channels != 1) {        /* the same floats, as a wider map */
        t.map.image.width *= t.map.made ? t.map.image.channels : 1;
        t.map.image.channels = 1;
    }
    for (y = 0; y < t.map.image.height && t.map.made; y++)
        for (x = 0; x < t.map.image.width; x++) {
            float *value = fuzz_row(&t.map, y) + x;

            if (!fuzz_rarely(in, 64) && !(*value >= 0.0f && *value <= FLT_MAX))
                *value = 0.0f;
            t.bad |= !(*value >= 0.0f && *value <= FLT_MAX);
            t.lit += *value > 0.0f;
            t.sum += (double)*value;
        }
    return t;
}

static envsamp_result make_texels(const tones *t, const envsamp_sizes *sizes, int fill,
                                  const fuzz_guard *out, int *count)
{
    fuzz_guard scratch = fuzz_buffer_make(sizes->scratch_bytes, fill);
    const envsamp_image *image = &t->map.image;
    envsamp_result result;

    *count = -1;
    result = envsamp_halftone(image->pixels, image->width, image->height, image->row_stride_bytes,
                              &t->desc, (envsamp_texel *)(void *)out->data,
                              (int)(out->bytes / sizeof(envsamp_texel)), count,
                              fuzz_buffer(&scratch));
    check_named(result);
    FUZZ_CHECK(result == ENVSAMP_OK || *count == 0);
    fuzz_guard_free(&scratch);
    return result;
}

static void check_texels(const tones *t, const envsamp_texel *texels, int count)
{
    const int width = t->map.image.width, repeats = !t->desc.once
                                                 || t->desc.kernel == ENVSAMP_KERNEL_RANDOM;
    uint8_t *seen = (uint8_t *)kd_allocate((size_t)width * (size_t)t->map.image.height);
    int i;

    FUZZ_CHECK(count == (t->desc.once && t->lit < t->desc.count ? t->lit : t->desc.count));
    for (i = 0; i < count; i++) {
        const envsamp_texel *texel = texels + i;
        double value;

        FUZZ_CHECK(texel->x >= 0 && texel->x < width);
        FUZZ_CHECK(texel->y >= 0 && texel->y < t->map.image.height);
        value = (double)fuzz_row(&t->map, texel->y)[texel->x];
        FUZZ_CHECK(value > 0.0);
        FUZZ_CHECK(close_to((double)texel->probability, fmax(value / t->sum, (double)FLT_MIN),
                            1e-5));
        FUZZ_CHECK(repeats || !seen[texel->y * width + texel->x]);
        seen[texel->y * width + texel->x] = 1;
    }
    free(seen);
}

static void run_halftone(const tones *t, const envsamp_sizes *sizes, int capacity)
{
    const size_t bytes = (size_t)capacity * sizeof(envsamp_texel);
    fuzz_guard first = fuzz_guard_make(bytes, 4, 0x11), second = fuzz_guard_make(bytes, 4, 0x11);
    const envsamp_texel *texels = (const envsamp_texel *)(const void *)first.data;
    int count, again;
    const envsamp_result result = make_texels(t, sizes, 0, &first, &count);

    FUZZ_CHECK(result == make_texels(t, sizes, 0xff, &second, &again) && count == again);
    if (!t->map.image.pixels)
        FUZZ_CHECK(result == ENVSAMP_ERR_NULL);
    else if (capacity < t->desc.count)
        FUZZ_CHECK(result == ENVSAMP_ERR_MEMORY || (t->map.skew && result == ENVSAMP_ERR_ALIGN));
    else if (t->map.skew)
        FUZZ_CHECK(result == ENVSAMP_ERR_ALIGN);
    else if (t->bad)
        FUZZ_CHECK(result == ENVSAMP_ERR_VALUE);
    else
        FUZZ_CHECK(result == (t->lit ? ENVSAMP_OK : ENVSAMP_ERR_BLACK));
    if (result == ENVSAMP_OK) {
        check_texels(t, texels, count);
        FUZZ_CHECK(!memcmp(first.data, second.data, (size_t)count * sizeof *texels));
    }
    fuzz_guard_free(&first);
    fuzz_guard_free(&second);
}

static void target_halftone(fuzz_input *in)
{
    tones t = tones_make(in);
    envsamp_sizes sizes;
    const envsamp_result result = envsamp_halftone_sizes(t.map.image.width, t.map.image.height,
                                                         &t.desc, &sizes);

    check_named(result);
    FUZZ_CHECK(sizes.table_bytes == 0);
    if (result != ENVSAMP_OK)
        FUZZ_CHECK(sizes.scratch_bytes == 0);
    else if (t.map.made && sizes.scratch_bytes <= MOST_BYTES)
        run_halftone(&t, &sizes, t.desc.count > 1000 || fuzz_rarely(in, 32)
                                 ? t.desc.count > 1000 ? 1000 : t.desc.count - 1 : t.desc.count);
    fuzz_map_free(&t.map);
}

/* ---- target: lm ---- */

enum { LM_RESIDUALS = 20 };

enum { LM_LINEAR, LM_EXPONENTIAL, LM_RATIONAL, LM_KINK, LM_NOISE, LM_PRODUCT, LM_ONE, LM_LARGE,
       LM_KINDS };

typedef struct lm_case {
    int n, m, calls;
    uint32_t kind;
    int wall_at;                /* a parameter, or -1 */
    double wall, beyond;        /* what residuals are where that is above `wall` */
    double slope[LM_RESIDUALS][8], offset[LM_RESIDUALS];
    const fuzz_guard *scratch;
} lm_case;

/* Residuals that are the same whenever params are. */
static void lm_residuals(const lm_case *c, const double *params, double *residuals)
{
    int i, j;

    for (i = 0; i < c->m; i++) {
        double sum = 0.0, product = 1.0, scale = c->kind == LM_LARGE ? 1e152 : 1.0;
        uint32_t hash = (uint32_t)i;

        for (j = 0; j < (c->kind == LM_ONE ? 1 : c->n); j++) {
            const float rounded = (float)(params[j] > 1e30 ? 1e30 : params[j] < -1e30 ? -1e30
                                                                                : params[j]);

            sum += c->slope[i][j] * params[j];
            product *= c->slope[i][j] + params[j];
            hash = hash_combine(hash, fuzz_bits_of(rounded));
        }
        sum = c->kind == LM_EXPONENTIAL ? exp(sum)
            : c->kind == LM_RATIONAL    ? 1.0 / (1.0 + sum)
            : c->kind == LM_KINK        ? fabs(sum)
            : c->kind == LM_NOISE       ? (double)unit_float(hash)
            : c->kind == LM_PRODUCT     ? product : sum;
        residuals[i] = scale * (sum - c->offset[i]);
        if (c->wall_at >= 0 && params[c->wall_at] > c->wall)
            residuals[i] = c->beyond;
    }
}

static void lm_fn(const double *params, double *residuals, void *user)
{
    lm_case *c = (lm_case *)user;
    const uint8_t *at = (const uint8_t *)residuals;
    int j;

    for (j = 0; j < c->n; j++)
        FUZZ_CHECK(fabs(params[j]) <= DBL_MAX);
    FUZZ_CHECK(at >= c->scratch->data
               && at + (size_t)c->m * sizeof *residuals <= c->scratch->data + c->scratch->bytes);
    c->calls++;
    lm_residuals(c, params, residuals);
}

/* The sum of squares, and whether all residuals are those of a point where the model is defined. */
static double lm_cost(const lm_case *c, const double *params, int *defined)
{
    double residuals[LM_RESIDUALS], cost = 0.0;
    int i;

    *defined = 1;
    lm_residuals(c, params, residuals);
    for (i = 0; i < c->m; i++) {
        cost += residuals[i] * residuals[i];
        *defined &= fabs(residuals[i]) < 0x1p1001;
    }
    return cost;
}

static lm_case lm_make(fuzz_input *in, const envsamp_lm_desc *desc)
{
    lm_case c;
    int i, j;

    memset(&c, 0, sizeof c);
    c.n = desc->param_count;
    c.m = desc->residual_count;
    c.kind = fuzz_below(in, LM_KINDS);
    c.wall_at = fuzz_rarely(in, 2) && c.n > 0 && c.n <= 8 ? (int)fuzz_below(in, (uint32_t)c.n) : -1;
    c.wall = (double)fuzz_float(in);
    c.beyond = fuzz_rarely(in, 2) ? (double)INFINITY : (double)NAN;
    for (i = 0; i < LM_RESIDUALS; i++) {
        for (j = 0; j < 8; j++)
            c.slope[i][j] = (double)(2.0f * pcg32_float(&in->random) - 1.0f);
        c.offset[i] = (double)(fuzz_rarely(in, 16) ? fuzz_float(in) : fuzz_unit(in));
    }
    if (fuzz_rarely(in, 4))
        for (i = 0; i < LM_RESIDUALS; i++)      /* a singular Jacobian */
            c.slope[i][1] = c.slope[i][0];
    return c;
}

static double lm_tolerance(fuzz_input *in)
{
    return fuzz_rarely(in, 2) ? 0.0 : fuzz_rarely(in, 8) ? (double)fuzz_float(in)
                                                         : (double)fuzz_scaled(in, -60, 60);
}

static int lm_desc_good(const envsamp_lm_desc *desc)
{
    return desc->param_count >= 1 && desc->param_count <= 8
        && desc->residual_count >= desc->param_count && desc->max_iterations >= 0
        && desc->ftol >= 0.0 && desc->xtol >= 0.0 && desc->gtol >= 0.0;
}

/* From params, whose result they become. */
static envsamp_result run_lm(const envsamp_lm_desc *desc, lm_case *c, double *params, int fill,
                             envsamp_lm_info *info)
{
    int defined;
    const double start = lm_cost(c, params, &defined);
    double given[8];
    const size_t bytes = envsamp_lm_scratch_bytes(desc);
    fuzz_guard scratch = fuzz_buffer_make(bytes, fill);
    envsamp_result result;
    int j, finite = 1;

    FUZZ_CHECK(bytes == (size_t)c->m * ((size_t)c->n + 2) * sizeof(double));
    memcpy(given, params, sizeof given);
    c->calls = 0;
    c->scratch = &scratch;
    result = envsamp_lm(desc, lm_fn, c, params, fuzz_buffer(&scratch), info);
    check_named(result);
    for (j = 0; j < c->n; j++)
        finite &= fabs(given[j]) <= DBL_MAX;
    FUZZ_CHECK(result == (finite && defined ? ENVSAMP_OK : ENVSAMP_ERR_VALUE));
    if (result != ENVSAMP_OK) {
        FUZZ_CHECK(!memcmp(given, params, sizeof given));
    } else {
        const int most = desc->max_iterations ? desc->max_iterations : 200;
        const double cost = lm_cost(c, params, &defined);

        FUZZ_CHECK(defined);
        FUZZ_CHECK(info->evaluations == c->calls);
        FUZZ_CHECK(info->iterations >= 0 && info->iterations <= most);
        FUZZ_CHECK((double)c->calls <= 60.0 * c->n * ((double)most + 2.0));
        FUZZ_CHECK(info->converged == 0 || info->converged == 1);
        FUZZ_CHECK(info->cost <= start * (1.0 + 1e-12));
        FUZZ_CHECK(cost > DBL_MAX ? info->cost > DBL_MAX
                                  : fabs(info->cost - cost) <= 1e-12 * cost + 1e-290);
        FUZZ_CHECK(!memcmp(given + c->n, params + c->n, (size_t)(8 - c->n) * sizeof *given));
    }
    fuzz_guard_free(&scratch);
    return result;
}

static void target_lm(fuzz_input *in)
{
    envsamp_lm_desc desc;
    envsamp_lm_info info[2];
    double params[2][8];
    lm_case c;
    int j;

    memset(&desc, 0, sizeof desc);
    memset(info, 0, sizeof info);
    desc.param_count = fuzz_int(in, 1, 8, 64);
    desc.residual_count = fuzz_rarely(in, 64) || desc.param_count > 8
                        ? fuzz_any_int(in) : desc.param_count + (int)fuzz_below(in, 12);
    desc.max_iterations = fuzz_rarely(in, 2) ? fuzz_range(in, 0, 60) : fuzz_int(in, 0, 20, 64);
    desc.max_iterations = desc.max_iterations > 1000 ? 1000 : desc.max_iterations;
    desc.ftol = lm_tolerance(in);
    desc.xtol = lm_tolerance(in);
    desc.gtol = lm_tolerance(in);
    c = lm_make(in, &desc);
    for (j = 0; j < 8; j++)
        params[0][j] = params[1][j] = (double)(fuzz_rarely(in, 4) ? fuzz_float(in) : fuzz_unit(in));
    FUZZ_CHECK((envsamp_lm_scratch_bytes(&desc) > 0) == lm_desc_good(&desc));
    if (lm_desc_good(&desc) && desc.residual_count <= LM_RESIDUALS) {
        const envsamp_result result = run_lm(&desc, &c, params[0], 0, &info[0]);

        FUZZ_CHECK(result == run_lm(&desc, &c, params[1], 0xff, &info[1]));
        FUZZ_CHECK(!memcmp(params[0], params[1], sizeof params[0]));
        FUZZ_CHECK(!memcmp(&info[0], &info[1], sizeof info[0]));
    }
}

/* ---- running them ---- */

static const struct { const char *name; void (*run)(fuzz_input *in); } targets[] = {
    { "build", target_build }, { "steps", target_steps }, { "open", target_open },
    { "lights", target_lights }, { "halftone", target_halftone }, { "lm", target_lm },
};

enum { TARGETS = sizeof targets / sizeof targets[0] };

static int target_named(const char *name)
{
    int i;

    for (i = 0; i < TARGETS; i++)
        if (name && !strcmp(name, targets[i].name))
            return i;
    fprintf(stderr, "no target of this name: %s\n", name ? name : "FUZZ_TARGET is not set");
    exit(2);
}

static void run_one(int target, const uint8_t *data, size_t size)
{
    fuzz_input in = fuzz_begin(data, size);

    targets[target].run(&in);
}

/* What libFuzzer calls. */
extern int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static int target = -1;

    if (target < 0)
        target = target_named(getenv("FUZZ_TARGET"));
    run_one(target, data, size);
    return 0;
}
