/* test_rounding.c: directed rounding modes are not supported. In them a sample of an octahedral map
 * may be NaN, and tables may fail to open. But every build ends without an error, and every sample
 * ends. An alarm ends what does not. */
#include "envsamp.h"
#include "check.h"

#include <fenv.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

#define WIDTH 48
#define HEIGHT 24
#define PATIENCE 60             /* seconds for a subject, which takes some milliseconds */
#define ARENA_BYTES (2u << 20)

static const struct { int mode; const char *name; } modes[] = {
    { FE_TONEAREST, "to nearest" },
#ifdef FE_UPWARD
    { FE_UPWARD, "upward" },
#endif
#ifdef FE_DOWNWARD
    { FE_DOWNWARD, "downward" },
#endif
#ifdef FE_TOWARDZERO
    { FE_TOWARDZERO, "toward zero" },
#endif
};

#define MODES ((int)(sizeof modes / sizeof modes[0]))

typedef enum content { ROW, TEXEL, HALF, CHECKERED, CONSTANT, CONTENTS } content;

static const char *const content_names[CONTENTS] = {
    "one lit row", "one lit texel", "a dark half", "a checkerboard", "a constant"
};

static float pixels[WIDTH * HEIGHT];

static void draw_map(int what)
{
    int x, y;

    for (y = 0; y < HEIGHT; y++)
        for (x = 0; x < WIDTH; x++) {
            float *pixel = &pixels[y * WIDTH + x];

            switch (what) {
            case ROW: *pixel = y == HEIGHT / 3 ? 1.0f : 0.0f; break;
            case TEXEL: *pixel = x == WIDTH / 2 && y == HEIGHT / 2 ? 1.0f : 0.0f; break;
            case HALF: *pixel = x < WIDTH / 2 ? (float)(1 + x * y % 7) : 0.0f; break;
            case CHECKERED: *pixel = (float)((x ^ y) & 1); break;
            default: *pixel = 1.0f; break;
            }
        }
}

/* One of two buffers of an arena that every build uses again. */
static envsamp_buffer buffer_of(int which, size_t bytes)
{
    static unsigned char arena[2][ARENA_BYTES + ENVSAMP_ALIGN];
    const uintptr_t end = (uintptr_t)arena[which] + ENVSAMP_ALIGN;
    envsamp_buffer buffer;

    buffer.data = arena[which] + (ENVSAMP_ALIGN - end % ENVSAMP_ALIGN);
    buffer.bytes = bytes <= ARENA_BYTES ? bytes : 0;
    return buffer;
}

/* ---- subjects: each builds one variant, uses what it built, and gives the result ---- */

static volatile float used;     /* so that no compiler leaves densities out */

static float u_of(int i, int axis) { return (float)((axis ? i * 37 : i) % 64) / 64.0f; }

static envsamp_result build_kd(const envsamp_image *map, int variant)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_sizes sizes;
    const envsamp_kd *kd;
    envsamp_result result;
    int i;

    desc.block_count = 200;
    desc.nearest = variant & 1;
    desc.select = (envsamp_kd_select)(variant / 2 % 3);
    desc.model = (envsamp_kd_model)(variant / 6 % 2);
    desc.objective = (envsamp_kd_objective)(variant / 12 % 2);
    result = envsamp_kd_sizes(map, &desc, &sizes);
    if (result == ENVSAMP_OK)
        result = envsamp_kd_build(map, &desc, buffer_of(0, sizes.table_bytes),
                                  buffer_of(1, sizes.scratch_bytes), &kd);
    for (i = 0; i < 64 && result == ENVSAMP_OK; i++) {
        const envsamp_sample s = envsamp_kd_sample(kd, u_of(i, 0), u_of(i, 1));
        float u[2];

        used += envsamp_kd_pdf(kd, s.dir);
        envsamp_kd_invert(kd, s.dir, u);
    }
    return result;
}

static envsamp_result build_cdf(const envsamp_image *map, int variant)
{
    envsamp_cdf_desc desc = envsamp_cdf_defaults();
    envsamp_sizes sizes;
    const envsamp_cdf *cdf;
    envsamp_result result;
    int i;

    desc.nearest = variant & 1;
    result = envsamp_cdf_sizes(map, &desc, &sizes);
    if (result == ENVSAMP_OK)
        result = envsamp_cdf_build(map, &desc, buffer_of(0, sizes.table_bytes),
                                   buffer_of(1, sizes.scratch_bytes), &cdf);
    for (i = 0; i < 64 && result == ENVSAMP_OK; i++) {
        const envsamp_sample s = envsamp_cdf_sample(cdf, u_of(i, 0), u_of(i, 1));
        float u[2];

        used += envsamp_cdf_pdf(cdf, s.dir);
        envsamp_cdf_invert(cdf, s.dir, u);
    }
    return result;
}

static envsamp_result build_lights(const envsamp_image *map, int variant)
{
    static envsamp_light lights[50];
    envsamp_lights_desc desc = envsamp_lights_defaults();
    envsamp_sizes sizes;
    envsamp_result result;

    desc.count = 50;
    desc.method = (envsamp_lights_method)variant;
    result = envsamp_lights_sizes(map, &desc, &sizes);
    return result ? result : envsamp_lights(map, &desc, lights, 50,
                                            buffer_of(1, sizes.scratch_bytes), NULL);
}

static envsamp_result build_halftone(const envsamp_image *map, int variant)
{
    static envsamp_texel texels[100];
    envsamp_halftone_desc desc;
    envsamp_sizes sizes;
    envsamp_result result;
    int count;

    memset(&desc, 0, sizeof desc);
    desc.count = 100;
    desc.kernel = (envsamp_kernel)(variant % 6);
    desc.scan = (envsamp_scan)(variant / 6 % 2);
    desc.once = variant / 12 % 2;
    result = envsamp_halftone_sizes(map->width, map->height, &desc, &sizes);
    return result ? result : envsamp_halftone(map->pixels, map->width, map->height, 0, &desc,
                                              texels, 100, &count,
                                              buffer_of(1, sizes.scratch_bytes));
}

static const struct {
    const char *name;
    int variants;
    envsamp_result (*build)(const envsamp_image *map, int variant);
} subjects[] = {
    { "kd", 24, build_kd }, { "cdf", 2, build_cdf }, { "lights", 6, build_lights },
    { "halftone", 24, build_halftone }
};

/* ---- the test ---- */

static void give_up(int number)
{
    static const char said[] = "not ok - what was to come next does not end\n";

    (void)number;
    if (write(1, said, sizeof said - 1) < 0)
        _exit(2);
    _exit(1);
}

static void test_subject(int subject, int mode)
{
    envsamp_image map = { pixels, WIDTH, HEIGHT, 1, 0, ENVSAMP_LATLONG };
    int what, mapping, variant;

    for (what = 0; what < CONTENTS; what++) {
        int failed = 0;

        draw_map(what);
        alarm(PATIENCE);
        fesetround(modes[mode].mode);
        for (mapping = 0; mapping < 3; mapping++)
            for (variant = 0; variant < subjects[subject].variants; variant++) {
                map.mapping = (envsamp_mapping)mapping;
                failed += subjects[subject].build(&map, variant) != ENVSAMP_OK;
            }
        fesetround(FE_TONEAREST);
        alarm(0);
        CHECK(failed == 0, "%s of %s, rounded %s: %d builds fail", subjects[subject].name,
              content_names[what], modes[mode].name, failed);
    }
}

int main(void)
{
    int subject, mode;

    signal(SIGALRM, give_up);
    for (mode = 0; mode < MODES; mode++)
        for (subject = 0; subject < (int)(sizeof subjects / sizeof subjects[0]); subject++)
            test_subject(subject, mode);
    return check_done();
}
