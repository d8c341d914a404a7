/* test_work.c: how much work a build is, counted instead of timed, and that no result depends on
 * a libm: each call of the library's functions, each square root that a build takes, each call of
 * libm.
 *
 * Functions are counted where the compiler reports them, by -finstrument-functions, inlined ones
 * too: the loops over cells, knots and blocks call some for each of them, so a build that reads
 * the map again and again shows. Bounds are about twice what was measured, with gcc and clang.
 */
#include "check.h"

#include <math.h>
#include <stdint.h>

#if defined(__GNUC__)
#define UNCOUNTED __attribute__((no_instrument_function))
#else
#define UNCOUNTED
#endif

/* ---- counters ---- */

static double call_count, root_count, libm_count;

extern void __cyg_profile_func_enter(void *function, void *caller) UNCOUNTED;
extern void __cyg_profile_func_exit(void *function, void *caller) UNCOUNTED;

void __cyg_profile_func_enter(void *function, void *caller)
{
    (void)function;
    (void)caller;
    call_count += 1.0;
}

void __cyg_profile_func_exit(void *function, void *caller)
{
    (void)function;
    (void)caller;
}

static UNCOUNTED double counted_sqrt(double x)
{
    root_count += 1.0;
    return sqrt(x);
}

#define ENVSAMP_SQRT(x) counted_sqrt(x)

/* What differs between one libm and the next; square roots, rounding and signs do not. */
#define COUNTED(call) (libm_count += 1.0, (call))
#define sin(x) COUNTED((sin)(x))
#define cos(x) COUNTED((cos)(x))
#define tan(x) COUNTED((tan)(x))
#define asin(x) COUNTED((asin)(x))
#define acos(x) COUNTED((acos)(x))
#define atan(x) COUNTED((atan)(x))
#define exp(x) COUNTED((exp)(x))
#define exp2(x) COUNTED((exp2)(x))
#define log(x) COUNTED((log)(x))
#define log2(x) COUNTED((log2)(x))
#define log10(x) COUNTED((log10)(x))
#define cbrt(x) COUNTED((cbrt)(x))
#define sinf(x) COUNTED((sinf)(x))
#define cosf(x) COUNTED((cosf)(x))
#define tanf(x) COUNTED((tanf)(x))
#define asinf(x) COUNTED((asinf)(x))
#define acosf(x) COUNTED((acosf)(x))
#define atanf(x) COUNTED((atanf)(x))
#define expf(x) COUNTED((expf)(x))
#define exp2f(x) COUNTED((exp2f)(x))
#define logf(x) COUNTED((logf)(x))
#define log2f(x) COUNTED((log2f)(x))
#define log10f(x) COUNTED((log10f)(x))
#define cbrtf(x) COUNTED((cbrtf)(x))
#define atan2(x, y) COUNTED((atan2)(x, y))
#define atan2f(x, y) COUNTED((atan2f)(x, y))
#define pow(x, y) COUNTED((pow)(x, y))
#define powf(x, y) COUNTED((powf)(x, y))
#define hypot(x, y) COUNTED((hypot)(x, y))
#define hypotf(x, y) COUNTED((hypotf)(x, y))

#define ENVSAMP_STATIC
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "sampler.h"
#include "../examples/common/random.h"

#define BLOCKS 6144

/* ---- maps ---- */

/* A gradient with a sun of four texels, or noise of a texel's size, as leaves make it: what is
   split down to its texels all over. */
static envsamp_image make_map(int noise, int width, int height)
{
    float *pixels = (float *)kd_allocate((size_t)width * (size_t)height * 3 * sizeof *pixels);
    pcg32 random = pcg32_make(11, 0);
    int x, y, c;

    for (y = 0; y < height; y++)
        for (x = 0; x < width; x++) {
            const float u = pcg32_float(&random), down = (float)y / (float)height;
            const int sun = x / 2 == width / 6 && y / 2 == height / 6;
            const float value = noise ? 4.0f * u * u * u : sun ? 1e5f : 1.0f - 0.7f * down;

            for (c = 0; c < 3; c++)
                pixels[3 * (y * width + x) + c] = value * (1.0f + 0.1f * (float)c);
        }
    return kd_image(pixels, width, height, 3);
}

static void free_map(envsamp_image *map)
{
    free((void *)(uintptr_t)map->pixels);
    memset(map, 0, sizeof *map);
}

/* ---- the work of a build ---- */

/* What one build may take: so many for each texel, and, kd, for each block. Measured over the
   maps below: functions 5.1 and 2500 (kd), 15.2 (cdf), roots 0.09 and 72
   (kd), 1.02 (cdf). */
typedef struct allowance { double calls_texel, calls_block, roots_texel, roots_block; } allowance;

static void test_build(const char *name, const envsamp_image *map, int kind, int bilinear)
{
    const allowance kd = { 10.0, 5000.0, 0.18, 145.0 }, cdf = { 30.0, 0.0, 2.04, 0.0 };
    const allowance a = kind == SAMPLER_CDF ? cdf : kd;
    const double texels = (double)map->width * (double)map->height;
    const double most_calls = a.calls_texel * texels + a.calls_block * BLOCKS;
    const double most_roots = a.roots_texel * texels + a.roots_block * BLOCKS;
    sampler_request request = sampler_ask(kind, map, BLOCKS);
    int built;
    sampler s;

    request.bilinear = bilinear;
    call_count = root_count = 0.0;
    built = sampler_make(&s, &request);
    CHECK(built && root_count > 0.0 && root_count <= most_roots, "%s of %s, %dx%d, bilinear %d: "
          "%.0f square roots, at most %.0f", sampler_names[kind], name, map->width, map->height,
          bilinear, root_count, most_roots);
    if (call_count > 0.0)
        CHECK(call_count <= most_calls, "and %.0f calls of functions, at most %.0f", call_count,
              most_calls);
    else
        CHECK_SKIP("calls of functions: not compiled with -finstrument-functions");
    sampler_free(&s);
}

/* cdf has work for rows, too, which are most of a long map. */
static void test_builds(int noise, int width, int height)
{
    const int count = width > 8 * height || height > 8 * width ? 4 : 6;
    const int kinds[] = { SAMPLER_WARP, SAMPLER_ALIAS, SAMPLER_CDF };
    envsamp_image map = make_map(noise, width, height);
    int i;

    for (i = 0; i < count; i++)
        test_build(noise ? "leaves" : "a sun", &map, kinds[i / 2], i % 2);
    free_map(&map);
}

/* ---- libm ---- */

/* Everything that a table is asked for. */
static void use(const sampler *s, envsamp_mapping mapping)
{
    pcg32 random = pcg32_make(3, (uint64_t)mapping);
    float u[2 * 256], out[4 * 256], pdf[256];
    int i;

    for (i = 0; i < 256; i++) {
        envsamp_sample sample;
        float back[2];

        u[i] = pcg32_float(&random);
        u[256 + i] = pcg32_float(&random);
        sample = sampler_draw(s, u[i], u[256 + i]);
        sampler_pdf(s, sample.dir);
        sampler_invert(s, sample.dir, back);
        envsamp_dir_to_uv(mapping, sample.dir, back);
        envsamp_uv_to_dir(mapping, back[0], back[1], sample.dir);
        envsamp_lookup(&s->request.image, i % 2, sample.dir, sample.dir);
    }
    sampler_draw_n(s, 256, u, out);
    sampler_pdf_n(s, 256, out, pdf);
}

static void test_libm(int kind, envsamp_mapping mapping, int bilinear)
{
    envsamp_image map = make_map(0, 64, 32);
    sampler_request request;
    const double before = root_count;
    int built, i;
    sampler s;

    map.mapping = mapping;
    request = sampler_ask(kind, &map, 200);
    request.bilinear = bilinear;
    request.compensation = 0.5f;
    libm_count = 0.0;
    built = sampler_make(&s, &request);
    if (built)
        use(&s, mapping);
    for (i = 0; built && kind != SAMPLER_CDF && i < (int)KD_WORD(s.kd, block_count); i++) {
        envsamp_kd_block block;

        envsamp_kd_get_block(s.kd, i, &block);
    }
    CHECK(built && libm_count <= 0.0 && root_count > before, "%s, %s, bilinear %d: of libm only "
          "square roots, but %.0f calls", sampler_names[kind], sampler_mappings[mapping], bilinear,
          libm_count);
    sampler_free(&s);
    free_map(&map);
}

int main(void)
{
    int i;

    test_builds(0, 2048, 1024);
    test_builds(1, 2048, 1024);
    test_builds(1, 640, 320);
    test_builds(0, 256, 128);
    test_builds(0, 128, 16384);
    test_builds(0, 16384, 128);
    test_builds(1, 8, 65535);
    test_builds(1, 65535, 8);
    test_builds(0, 1, 65535);
    test_builds(0, 65535, 1);
    for (i = 0; i < 6 * SAMPLER_KINDS; i++)
        test_libm(i / 6, (envsamp_mapping)(i % 3), i % 6 / 3);
    return check_done();
}
