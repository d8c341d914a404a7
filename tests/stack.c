/* stack.c: how much stack every public function needs. Each call runs in a thread of its own, whose
 * stack was filled with a pattern before: what is no longer the pattern was used.
 * tests/test_stack.sh links it with implementations, so that nothing is inlined into the calls.
 */
#include "check.h"
#define ENVSAMP_ALLOC
#include "envsamp.h"
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#define PROMISE 8192            /* bytes: GUARANTEES */
#define STACK (256 * 1024)
#define PATTERN 0xa5c39e71u
#define N 200                   /* samples of a batch: some whole chunks and a rest */

/* What the calls are given, and what they make. */
static envsamp_image map;
static envsamp_kd_desc kd_desc;
static envsamp_cdf_desc cdf_desc;
static envsamp_halftone_desc halftone_desc;
static envsamp_lights_desc lights_desc;
static envsamp_sizes sizes;
static envsamp_buffer table, scratch;
static const envsamp_kd *kd;
static const envsamp_cdf *cdf;
static envsamp_texel texels[N];
static envsamp_light lights[N];
static uint8_t *mask;
static float u0[N], u1[N], x[N], y[N], z[N], pdf[N];
static int failures;

/* A stack, what is to run on it, and how far down it then was used. */
typedef struct trial { uint32_t *stack; void (*call)(void); size_t bytes; } trial;

static void *in_thread(void *data)
{
    trial *t = (trial *)data;
    char *volatile here;
    char top;
    size_t i = 0;

    here = &top;
    t->call();
    while (i < STACK / 4 && t->stack[i] == PATTERN)
        i++;
    t->bytes = (size_t)(here - (char *)&t->stack[i]);
    return NULL;
}

/* Bytes of stack that a call uses, with some for the call itself. */
static size_t stack_used(void (*call)(void))
{
    static trial t;
    pthread_attr_t attributes;
    pthread_t thread;
    void *stack = t.stack;
    size_t i;

    if (!stack && posix_memalign(&stack, 4096, STACK))
        abort();
    t.stack = (uint32_t *)stack;
    t.call = call;
    for (i = 0; i < STACK / 4; i++)
        t.stack[i] = PATTERN;
    if (pthread_attr_init(&attributes) || pthread_attr_setstack(&attributes, stack, STACK)
        || pthread_create(&thread, &attributes, in_thread, &t) || pthread_join(thread, NULL))
        abort();
    pthread_attr_destroy(&attributes);
    return t.bytes;
}

static void nine_kib(void)
{
    volatile char block[9 * 1024];
    size_t i;

    for (i = 0; i < sizeof block; i++)
        block[i] = (char)i;
}

static void fails(int condition) { failures += condition != 0; }

/* ---- one function, or some small ones, of a family ---- */

static envsamp_result give_row(int row, float *to, void *user)
{
    const envsamp_image *from = (const envsamp_image *)user;
    size_t floats = (size_t)from->width * (size_t)from->channels;

    memcpy(to, from->pixels + (size_t)row * floats, floats * sizeof(float));
    return ENVSAMP_OK;
}

static void call_mapping(void)
{
    float dir[3], uv[2], rgb[3];
    int i;

    for (i = 0; i < N; i++) {
        envsamp_uv_to_dir(map.mapping, u0[i], u1[i], dir);
        envsamp_dir_to_uv(map.mapping, dir, uv);
        envsamp_lookup(&map, i & 1, dir, rgb);
        fails(!(envsamp_luminance(rgb) >= 0.0f) || !(envsamp_mis_power(uv[0], uv[1]) >= 0.0f)
              || !envsamp_result_string((envsamp_result)i));
    }
}

static void call_kd_sizes(void)
{
    envsamp_kd_desc filled = envsamp_kd_defaults();

    fails(filled.block_count < 1 || envsamp_kd_sizes(&map, &kd_desc, &sizes));
}

static void call_kd_build(void)
{
    envsamp_kd *own = envsamp_kd_new(&map, &kd_desc, NULL);

    fails(!own);
    envsamp_kd_free(own);
    fails(envsamp_kd_build(&map, &kd_desc, table, scratch, &kd)
          || envsamp_kd_build_rows(&map, give_row, &map, &kd_desc, table, scratch, &kd));
}

static void call_kd_steps(void)
{
    envsamp_kd_job *job;
    int done = 0;

    if (envsamp_kd_begin(&map, give_row, &map, &kd_desc, table, scratch, &job) != ENVSAMP_OK) {
        failures++;
        return;
    }
    while (!done && envsamp_kd_step(job, 5, &done) == ENVSAMP_OK) {}
    fails(envsamp_kd_finish(job, &kd) != ENVSAMP_OK
          || envsamp_kd_rebuild_begin(&map, give_row, &map, &kd_desc, 1, 2, table, scratch, &job)
             != ENVSAMP_OK || envsamp_kd_finish(job, &kd) != ENVSAMP_OK);
}

static void call_kd_facts(void)
{
    envsamp_kd_info info;
    envsamp_kd_block block;
    int i;

    fails(envsamp_kd_open(kd, envsamp_kd_bytes(kd), &kd) || envsamp_kd_get_info(kd, &info));
    for (i = 0; i < info.block_count; i++)
        fails(envsamp_kd_get_block(kd, i, &block) != ENVSAMP_OK);
}

static void call_kd_one(void)
{
    int i;

    for (i = 0; i < N; i++) {
        envsamp_sample s = envsamp_kd_sample(kd, u0[i], u1[i]);
        float u[2];

        fails(!(s.pdf > 0.0f) || !(envsamp_kd_pdf(kd, s.dir) >= 0.0f)
              || envsamp_kd_invert(kd, s.dir, u) > 1);
    }
}

static void call_kd_many(void)
{
    envsamp_kd_sample_n(kd, N, u0, u1, x, y, z, pdf);
    envsamp_kd_pdf_n(kd, N, x, y, z, pdf);
}

static void call_kd_facing(void)
{
    const float normal[3] = { 0.6f, 0.0f, 0.8f };
    int i;

    for (i = 0; i < N; i++) {
        envsamp_sample s = envsamp_kd_sample_facing(kd, normal, u0[i], u1[i]);
        float u[2];

        fails(!(s.pdf > 0.0f) || !(envsamp_kd_pdf_facing(kd, normal, s.dir) >= 0.0f)
              || envsamp_kd_invert_facing(kd, normal, s.dir, u) > 1);
    }
    envsamp_kd_sample_facing_n(kd, normal, N, u0, u1, x, y, z, pdf);
    envsamp_kd_pdf_facing_n(kd, normal, N, x, y, z, pdf);
}

static void call_cdf_sizes(void)
{
    envsamp_cdf_desc filled = envsamp_cdf_defaults();

    fails(filled.nearest || envsamp_cdf_sizes(&map, &cdf_desc, &sizes));
}

static void call_cdf_build(void)
{
    envsamp_cdf *own = envsamp_cdf_new(&map, &cdf_desc, NULL);

    fails(!own);
    envsamp_cdf_free(own);
    fails(envsamp_cdf_build(&map, &cdf_desc, table, scratch, &cdf)
          || envsamp_cdf_build_rows(&map, give_row, &map, &cdf_desc, table, scratch, &cdf));
}

static void call_cdf_steps(void)
{
    envsamp_cdf_job *job;
    int done = 0;

    if (envsamp_cdf_begin(&map, give_row, &map, &cdf_desc, table, scratch, &job) != ENVSAMP_OK) {
        failures++;
        return;
    }
    while (!done && envsamp_cdf_step(job, 5, &done) == ENVSAMP_OK) {}
    fails(envsamp_cdf_finish(job, &cdf) != ENVSAMP_OK);
}

static void call_cdf_facts(void)
{
    envsamp_cdf_info info;

    fails(envsamp_cdf_open(cdf, envsamp_cdf_bytes(cdf), &cdf) || envsamp_cdf_get_info(cdf, &info));
}

static void call_cdf_one(void)
{
    int i;

    for (i = 0; i < N; i++) {
        envsamp_sample s = envsamp_cdf_sample(cdf, u0[i], u1[i]);
        float u[2];

        fails(!(s.pdf > 0.0f) || !(envsamp_cdf_pdf(cdf, s.dir) >= 0.0f)
              || envsamp_cdf_invert(cdf, s.dir, u) > 1);
    }
}

static void call_cdf_many(void)
{
    envsamp_cdf_sample_n(cdf, N, u0, u1, x, y, z, pdf);
    envsamp_cdf_pdf_n(cdf, N, x, y, z, pdf);
}

static void call_halftone(void)
{
    int count;

    fails(envsamp_halftone_sizes(map.width, map.height, &halftone_desc, &sizes)
          || envsamp_halftone(map.pixels, map.width, map.height, 0, &halftone_desc, texels, N,
                              &count, scratch));
}

static void call_lights(void)
{
    envsamp_lights_info info;

    fails(envsamp_lights_sizes(&map, &lights_desc, &sizes) || sizes.scratch_bytes > scratch.bytes
          || envsamp_lights(&map, &lights_desc, lights, N, scratch, &info));
}

static void call_lights_more(void)
{
    envsamp_lights_desc filled = envsamp_lights_defaults();

    fails(filled.count < 1
          || envsamp_lights_interleave(lights, lights_desc.count, 1, 4, 0.5f, 1, lights)
          || envsamp_emissive_mask(&map, &lights_desc, mask, scratch, NULL));
}

static void residuals_of(const double *params, double *residuals, void *user)
{
    int i;

    (void)user;
    for (i = 0; i < 12; i++)
        residuals[i] = params[i % 8] * params[(i + 1) % 8] + params[i % 5] - (double)i;
}

static void call_lm(void)
{
    envsamp_lm_desc desc;
    envsamp_lm_info info;
    double params[8] = { 1, 2, 3, 4, 5, 6, 7, 8 };

    memset(&desc, 0, sizeof desc);
    desc.param_count = 8;
    desc.residual_count = 12;
    fails(envsamp_lm_scratch_bytes(&desc) > scratch.bytes
          || envsamp_lm(&desc, residuals_of, NULL, params, scratch, &info));
}

/* ---- all of them ---- */

enum {
    MAPPING, KD_SIZES, KD_BUILD, KD_STEPS, KD_FACTS, KD_ONE, KD_MANY, KD_FACING, CDF_SIZES,
    CDF_BUILD, CDF_STEPS, CDF_FACTS, CDF_ONE, CDF_MANY, HALFTONE, LIGHTS, LIGHTS_MORE, LM, FAMILIES
};

/* Functions, the most that one of them needed, and for what. */
static struct family {
    const char *name;
    void (*call)(void);
    size_t bytes;
    int failures;
    char where[80];
} families[FAMILIES] = {
    { "mapping and lookup", call_mapping, 0, 0, "" },
    { "kd: defaults, sizes", call_kd_sizes, 0, 0, "" },
    { "kd: build, build_rows", call_kd_build, 0, 0, "" },
    { "kd: begin, step, finish", call_kd_steps, 0, 0, "" },
    { "kd: open, bytes, info, block", call_kd_facts, 0, 0, "" },
    { "kd: sample, pdf, invert", call_kd_one, 0, 0, "" },
    { "kd: sample_n, pdf_n", call_kd_many, 0, 0, "" },
    { "kd: functions of facing", call_kd_facing, 0, 0, "" },
    { "cdf: defaults, sizes", call_cdf_sizes, 0, 0, "" },
    { "cdf: build, build_rows", call_cdf_build, 0, 0, "" },
    { "cdf: begin, step, finish", call_cdf_steps, 0, 0, "" },
    { "cdf: open, bytes, info", call_cdf_facts, 0, 0, "" },
    { "cdf: sample, pdf, invert", call_cdf_one, 0, 0, "" },
    { "cdf: sample_n, pdf_n", call_cdf_many, 0, 0, "" },
    { "halftone", call_halftone, 0, 0, "" },
    { "lights", call_lights, 0, 0, "" },
    { "lights: interleave, mask", call_lights_more, 0, 0, "" },
    { "lm", call_lm, 0, 0, "" }
};

static void use(int first, int last)
{
    int i;

    for (i = first; i <= last; i++) {
        struct family *f = &families[i];
        size_t bytes;

        failures = 0;
        bytes = stack_used(f->call);
        f->failures += failures;
        if (bytes <= f->bytes)
            continue;
        f->bytes = bytes;
        snprintf(f->where, sizeof f->where, "%d x %d, mapping %d, select %d, nearest %d, method %d",
                 map.width, map.height, (int)map.mapping, (int)kd_desc.select, kd_desc.nearest,
                 (int)lights_desc.method);
    }
}

/* Tables for one mapping, one lookup, and compensation with an exponent or without: `all` selects,
   criteria, models and objectives, or the selects alone. */
static void use_tables(int variant, int all)
{
    int i, count = all ? 3 * 4 * 2 * 2 : 3;

    kd_desc.nearest = cdf_desc.nearest = variant & 1;
    kd_desc.mis_compensation = cdf_desc.mis_compensation = variant & 2 ? 0.5f : 0.0f;
    kd_desc.importance_exponent = cdf_desc.importance_exponent = variant & 2 ? 1.5f : 0.0f;
    map.mapping = (envsamp_mapping)(variant >> 2);
    for (i = 0; i < count; i++) {
        kd_desc.select = (envsamp_kd_select)(i % 3);
        kd_desc.facing = kd_desc.select == ENVSAMP_KD_WARP;
        kd_desc.criterion = (envsamp_kd_criterion)(i / 3 % 4);
        kd_desc.model = (envsamp_kd_model)(i / 12 % 2);
        kd_desc.objective = (envsamp_kd_objective)(i / 24);
        if (i < 12 || kd_desc.select == ENVSAMP_KD_FIT)
            use(KD_SIZES, KD_FACING);
    }
    use(CDF_SIZES, CDF_MANY);
    use(MAPPING, MAPPING);
}

static void use_lists(void)
{
    int i;

    for (i = 0; i < 24 && map.channels == 1; i++) {
        halftone_desc.count = 150;
        halftone_desc.kernel = (envsamp_kernel)(i % 6);
        halftone_desc.scan = (envsamp_scan)(i / 6 % 2);
        halftone_desc.once = i / 12;
        halftone_desc.seed = 1;
        use(HALFTONE, HALFTONE);
    }
    for (i = 0; i < 18; i++) {
        map.mapping = (envsamp_mapping)(i % 3);
        lights_desc.method = (envsamp_lights_method)(i / 3);
        lights_desc.count = i % 2 ? 16 : 140;
        use(LIGHTS, LIGHTS_MORE);
    }
}

/* A map of noise with a lamp in the middle. */
static void make_map(int width, int height, int channels)
{
    static float pixels[1024 * 512 * 3];
    uint32_t state = 1;
    int i, count = width * height * channels;

    for (i = 0; i < count; i++) {
        state = state * 1664525u + 1013904223u;
        pixels[i] = (float)(state >> 8) / 16777216.0f + (i == count / 2 ? 1e4f : 0.0f);
    }
    map.pixels = pixels;
    map.width = width;
    map.height = height;
    map.channels = channels;
    map.mapping = ENVSAMP_LATLONG;
}

static void use_all(void)
{
    int i;

    kd_desc.block_count = 60;
    for (i = 0; i < 12; i++) {
        make_map(48, 24, 3);
        use_tables(i, 1);
        make_map(1, 1, 3);
        use_tables(i, 0);
        make_map(5, 3, 1);
        use_tables(i, 0);
    }
    use_lists();
    make_map(96, 48, 1);
    use_lists();
    make_map(48, 24, 3);
    use_lists();
    make_map(1024, 512, 3);
    kd_desc.block_count = 0;
    for (i = 0; i < 3; i++) {
        use_tables(5 * i, 0);
        lights_desc.method = (envsamp_lights_method)i;
        lights_desc.count = 32;
        use(LIGHTS, LIGHTS_MORE);
    }
    use(LM, LM);
}

int main(void)
{
    const size_t most = 64u << 20;
    size_t control, i;

    table.data = malloc(table.bytes = most);
    scratch.data = malloc(scratch.bytes = most);
    mask = (uint8_t *)malloc(1024 * 512);
    for (i = 0; i < N; i++) {
        u0[i] = (float)(i * 10368889u % 16777216u) / 16777216.0f;
        u1[i] = (float)(i * 40503u % 65536u) / 65536.0f;
    }
    control = stack_used(nine_kib);
    CHECK(control >= PROMISE && control >= 9216 && control < 9216 + 1024,
          "a function of 9 KiB would fail: %u bytes", (unsigned)control);
    use_all();
    for (i = 0; i < FAMILIES; i++)
        CHECK(families[i].bytes > 0 && families[i].bytes < PROMISE && !families[i].failures,
              "%s: %u bytes (%s)%s", families[i].name, (unsigned)families[i].bytes,
              families[i].where, families[i].failures ? ", and calls failed" : "");
    free(table.data);
    free(scratch.data);
    free(mask);
    return check_done();
}
