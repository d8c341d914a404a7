/* facing_gallery.c: spheres on a plane, with shadows, lit by a map: light x cosine from one table,
 * beside light alone and multiple importance sampling.
 *
 *     facing_gallery [-q] [-o FOLDER] [MAP]
 *
 * MAP is a lat-long HDR or PFM file or a name of maps.h; the default is studio. All is diffuse,
 * but one sphere has a wide glossy lobe. The point of every pixel is lit by 4, 16 and 64 samples:
 *
 *     LIGHT          from the light: envsamp_kd_sample
 *     LIGHT, MIS     half of them so, half from the BSDF, weighed by the power heuristic
 *     FACING         from light x cosine: envsamp_kd_sample_facing
 *     FACING, MIS    half of them so, half from the BSDF
 *
 * Prints RMSE relative to the mean of a reference, with Owen-Sobol and with independent numbers,
 * times, and RMSE at equal time, and draws FOLDER/facing_MAP.png (build/pictures). -q is a test: a
 * coarser reference, no file, and status 1 unless FACING has at most 0.6 of the error of the best
 * of the first two from 4 and 16 samples. No packages are needed.
 *
 * To copy: make_table, lobe_axis, draw, density and light_point. What differs from light alone:
 *
 * - One field of the description, `facing`.
 * - The normal is one more argument. It goes into the map's space, as directions do.
 * - For MIS the density of a BSDF's sample is that of the function which drew the others, with the
 *   same normal.
 * - A glossy lobe is faced along the mirrored view, about which its light comes in.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "../examples/common/folder.h"
#include "../examples/common/maps.h"
#include "../examples/common/progress.h"

#define SCENE_GLOSS 8.0f
#define SCENE_SPHERES                                                                       \
    {{1.6f, 0.5f, 0.9f}, 0.9f, 1},                                                          \
    {{-1.55f, 0.6f, 0.9f}, 0.9f, 0}, {{0.0f, 2.2f, 1.1f}, 1.1f, 0},                         \
    {{-2.9f, 2.4f, 1.0f}, 1.0f, 0}, {{2.9f, 2.4f, 1.0f}, 1.0f, 0},                          \
    {{0.0f, -0.1f, 0.5f}, 0.5f, 0}, {{-0.55f, -0.9f, 0.45f}, 0.45f, 0},                     \
    {{0.6f, -1.0f, 0.4f}, 0.4f, 0}, {{-2.2f, -1.1f, 0.35f}, 0.35f, 0},                      \
    {{2.35f, -1.0f, 0.45f}, 0.45f, 0}, {{0.0f, -1.9f, 0.25f}, 0.25f, 0},                    \
    {{1.3f, -1.7f, 0.3f}, 0.3f, 0}, {{-1.35f, -1.6f, 0.3f}, 0.3f, 0}
#include "../examples/common/mis_scene.h"

#include <stdlib.h>
#include <time.h>

#define MADE_WIDTH 512
#define MADE_HEIGHT 256
#define PIXELS (SCENE_WIDTH * SCENE_HEIGHT)
#define COUNTS 3
#define MIDDLE 1                     /* the count that is timed */
#define ROUNDS 5                     /* of which the fastest counts */
#define WORK 2700.0                  /* samples a point of all that is shaded, about */
#define ROWS 2                       /* of the picture: as many of the counts */
#define ROW_HEIGHT (SCENE_HEIGHT + SCENE_LABEL)
#define SLOW_RAY 500.0               /* ns, of a shadow ray through a scene of many triangles */

typedef struct way { const char *name; int facing, mis; } way;

enum { LIGHT, LIGHT_MIS, FACING, FACING_MIS, WAYS };
enum { SOBOL, INDEPENDENT, NUMBERS };

static const way ways[WAYS] = {
    {"LIGHT", 0, 0}, {"LIGHT, MIS", 0, 1}, {"FACING", 1, 0}, {"FACING, MIS", 1, 1}
};
static const char *const number_names[NUMBERS] = {"Owen-Sobol", "independent"};
static const uint32_t counts[COUNTS] = {4, 16, 64};

/* A pixel that shows the scene. */
typedef struct lit {
    int pixel;
    mis_point point;
    float axis[3];                   /* what samples face, in the map's space */
} lit;

typedef struct trial {
    const char *name, *folder;
    int quick, counts;
    image map;
    envsamp_image view;
    void *memory;                    /* of the table */
    const envsamp_kd *kd;
    mis_scene scene;                 /* how the map is turned, and the reference */
    int lit_count;
    lit lit[PIXELS];
    mis_panel panels[NUMBERS][COUNTS][WAYS], equal;
    double ns[NUMBERS][WAYS], rays[WAYS];       /* of a sample */
    progress shown;
    double done;                     /* samples a point */
} trial;

static int fail(const char *subject, const char *what)
{
    fprintf(stderr, "facing: %s: %s\n", subject, what);
    return 0;
}

/* ---- lighting a point: to copy ---- */

/* One table does both: with `facing` it takes 75 KiB more. */
static envsamp_result make_table(const envsamp_image *view, void **memory, const envsamp_kd **kd)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_buffer table, scratch;
    envsamp_result result;
    envsamp_sizes sizes;

    desc.facing = 1;
    result = envsamp_kd_sizes(view, &desc, &sizes);
    *memory = table.data = malloc(table.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    if (result == ENVSAMP_OK)
        result = !table.data || !scratch.data ? ENVSAMP_ERR_MEMORY
                                              : envsamp_kd_build(view, &desc, table, scratch, kd);
    free(scratch.data);
    return result;
}

/* What samples of a point are to face, in the map's space: once for every point. */
static void lobe_axis(const mis_scene *s, const mis_point *p, float axis[3])
{
    mis_to_map(s, p->glossy ? p->mirror : p->normal, axis);
}

/* A direction of the map. */
static envsamp_sample draw(const envsamp_kd *kd, const way *by, const float axis[3],
                           const float u[2])
{
    return by->facing ? envsamp_kd_sample_facing(kd, axis, u[0], u[1])
                      : envsamp_kd_sample(kd, u[0], u[1]);
}

/* Of `draw`, in a direction of the map. */
static float density(const envsamp_kd *kd, const way *by, const float axis[3], const float dir[3])
{
    return by->facing ? envsamp_kd_pdf_facing(kd, axis, dir) : envsamp_kd_pdf(kd, dir);
}

static void make_numbers(int numbers, uint32_t i, uint32_t seed, float u[2])
{
    if (numbers == SOBOL) {
        sobol_owen(i, seed, u);
    } else {
        u[0] = unit_float(hash_combine(seed, 2 * i));
        u[1] = unit_float(hash_combine(seed, 2 * i + 1));
    }
}

/* What a point shows of the light of `count` samples. mis_lobe is BSDF x cosine over the albedo,
   and also the BSDF's density. A ray goes out only where that is above zero, and the map is read
   only where nothing is in the way. Returns the number of rays. */
static int light_point(const trial *t, const way *by, const lit *at, int numbers, uint32_t count,
                       uint32_t seed, float rgb[3])
{
    const uint32_t from_bsdf = by->mis ? count / 2 : 0, from_light = count - from_bsdf;
    const mis_point *p = &at->point;
    int rays = 0, c;
    uint32_t i;

    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    for (i = 0; i < count; i++) {
        const int bsdf = i >= from_light;
        float u[2], dir[3], map_dir[3], radiance[3], lobe, pdf = 0.0f, weight;

        make_numbers(numbers, bsdf ? i - from_light : i, hash_combine(seed, (uint32_t)bsdf), u);
        if (bsdf) {
            mis_draw_lobe(p, u, dir);
            mis_to_map(&t->scene, dir, map_dir);
        } else {
            const envsamp_sample s = draw(t->kd, by, at->axis, u);

            pdf = s.pdf;
            memcpy(map_dir, s.dir, sizeof map_dir);
            mis_from_map(&t->scene, map_dir, dir);
        }
        lobe = mis_lobe(p, dir);
        if (!(lobe > 0.0f) || dot3(p->normal, dir) <= 0.0f)
            continue;
        rays++;
        if (mis_shadowed(p, dir))
            continue;
        if (bsdf)
            weight = envsamp_mis_power(lobe, density(t->kd, by, at->axis, map_dir))
                   / (lobe * (float)from_bsdf);
        else
            weight = (by->mis ? envsamp_mis_power(pdf, lobe) : 1.0f) / (pdf * (float)from_light);
        envsamp_lookup(&t->view, 0, map_dir, radiance);
        for (c = 0; c < 3; c++)
            rgb[c] += p->albedo * lobe * weight * radiance[c];
    }
    return rays;
}

/* ---- pictures of the scene ---- */

/* Meets the scene, once for all ways; pixels that show the map are the same by all. */
static void find_points(trial *t)
{
    mis_panel *reference = &t->scene.panels[MIS_REFERENCE];
    int i, numbers, row, by;
    float dir[3];

    for (i = 0; i < PIXELS; i++) {
        lit *at = &t->lit[t->lit_count];

        if (mis_pixel(i % SCENE_WIDTH, i / SCENE_WIDTH, &at->point, dir)) {
            at->pixel = i;
            lobe_axis(&t->scene, &at->point, at->axis);
            t->lit_count++;
        } else {
            mis_to_map(&t->scene, dir, dir);
            envsamp_lookup(&t->view, 0, dir, reference->rgb + 3 * i);
        }
    }
    t->equal = *reference;
    for (numbers = 0; numbers < NUMBERS; numbers++)
        for (row = 0; row < COUNTS; row++)
            for (by = 0; by < WAYS; by++)
                t->panels[numbers][row][by] = *reference;
}

/* Returns the rays of a sample. */
static double shade(trial *t, int by, int numbers, uint32_t count, uint32_t run,
                    mis_panel *panel)
{
    double rays = 0.0;
    int i;

    progress_show(&t->shown, fmin(t->done / WORK, 0.99), ways[by].name);
    for (i = 0; i < t->lit_count; i++) {
        const int pixel = t->lit[i].pixel;

        rays += light_point(t, &ways[by], &t->lit[i], numbers, count,
                            hash_combine(run, (uint32_t)pixel), panel->rgb + 3 * pixel);
    }
    t->done += count;
    panel->rmse = mis_rmse(panel, &t->scene.panels[MIS_REFERENCE]);
    return rays / ((double)t->lit_count * count);
}

static void shade_all(trial *t)
{
    int numbers, row, by;

    shade(t, FACING, SOBOL, t->quick ? 256 : 1024, 17, &t->scene.panels[MIS_REFERENCE]);
    t->scene.panels[MIS_REFERENCE].rmse = 0.0;
    for (numbers = 0; numbers < NUMBERS; numbers++)
        for (row = 0; row < t->counts; row++)
            for (by = 0; by < WAYS; by++)
                t->rays[by] = shade(t, by, numbers, counts[row], 13, &t->panels[numbers][row][by]);
}

/* Ways take turns, so that a busy machine meets all alike. */
static void time_all(trial *t)
{
    const double samples = (double)t->lit_count * counts[MIDDLE];
    int round, numbers, by;

    for (round = 0; round < (t->quick ? 1 : ROUNDS); round++)
        for (numbers = 0; numbers < NUMBERS; numbers++)
            for (by = 0; by < WAYS; by++) {
                const clock_t start = clock();
                double ns;

                shade(t, by, numbers, counts[MIDDLE], 13, &t->equal);
                ns = 1e9 * (double)(clock() - start) / CLOCKS_PER_SEC / samples;
                t->ns[numbers][by] = round ? fmin(t->ns[numbers][by], ns) : ns;
            }
}

/* ---- figures ---- */

/* Of luminance over the glossy points or the others. */
static double surface_rmse(const trial *t, const mis_panel *panel, int glossy)
{
    double squares = 0.0, sum = 0.0, points = 0.0;
    int i;

    for (i = 0; i < t->lit_count; i++) {
        const int at = 3 * t->lit[i].pixel;
        const float right = envsamp_luminance(t->scene.panels[MIS_REFERENCE].rgb + at);
        const double error = (double)(envsamp_luminance(panel->rgb + at) - right);

        if (t->lit[i].point.glossy != glossy)
            continue;
        squares += error * error;
        sum += (double)right;
        points += 1.0;
    }
    return sum > 0.0 ? sqrt(squares * points) / sum : 0.0;
}

/* Mean luminance over that of the reference: bias, if it differs from 1 by more than noise does. */
static double mean_ratio(const trial *t, const mis_panel *panel)
{
    double sum = 0.0, right = 0.0;
    int i;

    for (i = 0; i < t->lit_count; i++) {
        const int at = 3 * t->lit[i].pixel;

        sum += (double)envsamp_luminance(panel->rgb + at);
        right += (double)envsamp_luminance(t->scene.panels[MIS_REFERENCE].rgb + at);
    }
    return right > 0.0 ? sum / right : 0.0;
}

static void print_errors(const trial *t)
{
    int numbers, row, by;

    printf("%s: RMSE relative to the mean, %d points; mean: of the last column, over that of the\n"
           "reference; ns and shadow rays a sample; diffuse and glossy points from %u\n\n",
           t->name, t->lit_count, (unsigned)counts[MIDDLE]);
    for (numbers = 0; numbers < NUMBERS; numbers++) {
        printf("%-15s", number_names[numbers]);
        for (row = 0; row < t->counts; row++)
            printf("%8u", (unsigned)counts[row]);
        printf("%8s%8s%6s%9s%8s\n", "mean", "ns", "rays", "diffuse", "glossy");
        for (by = 0; by < WAYS; by++) {
            printf("%-15s", ways[by].name);
            for (row = 0; row < t->counts; row++)
                printf("%8.4f", t->panels[numbers][row][by].rmse);
            printf("%8.4f%8.0f%6.2f%9.4f%8.4f\n",
                   mean_ratio(t, &t->panels[numbers][t->counts - 1][by]), t->ns[numbers][by],
                   t->rays[by], surface_rmse(t, &t->panels[numbers][MIDDLE][by], 0),
                   surface_rmse(t, &t->panels[numbers][MIDDLE][by], 1));
        }
        printf("\n");
    }
}

/* As many samples by every way as it takes in the time of FACING, where a ray takes `ray_ns` more
   than it does here. */
static void print_equal_time(trial *t, int numbers, double ray_ns)
{
    const double time = counts[MIDDLE] * (t->ns[numbers][FACING] + t->rays[FACING] * ray_ns);
    double rmse[WAYS], best;
    int by;

    printf("%-12s%5.0f", number_names[numbers], ray_ns);
    for (by = 0; by < WAYS; by++) {
        const double count = time / (t->ns[numbers][by] + t->rays[by] * ray_ns);
        const uint32_t whole = count < 2.0 ? 2 : (uint32_t)(count + 0.5);

        shade(t, by, numbers, whole, 13, &t->equal);
        rmse[by] = t->equal.rmse;
        printf("%6u%8.4f", (unsigned)whole, rmse[by]);
    }
    progress_end(&t->shown);
    best = fmin(rmse[LIGHT], rmse[LIGHT_MIS]);
    printf("%8.2f%6.2f\n", rmse[FACING] / best, rmse[FACING_MIS] / best);
}

static void print_equal_times(trial *t)
{
    int numbers, by;

    printf("At equal time, where rays take so many ns more: samples a pixel and RMSE; the last\n"
           "two over the best of the first two\n\n%-17s", "");
    for (by = 0; by < WAYS; by++)
        printf("%14s", ways[by].name);
    printf("%8s%6s\n", "FACING", "MIS");
    for (numbers = 0; numbers < NUMBERS; numbers++) {
        print_equal_time(t, numbers, 0.0);
        print_equal_time(t, numbers, SLOW_RAY);
    }
    printf("\n");
}

static int print_verdict(const trial *t)
{
    int row, good = 1;

    printf("At equal numbers of Owen-Sobol points FACING has");
    for (row = 0; row < t->counts; row++) {
        const mis_panel *p = t->panels[SOBOL][row];
        const double ratio = p[FACING].rmse / fmin(p[LIGHT].rmse, p[LIGHT_MIS].rmse);

        printf("%s %.2f", row ? "," : "", ratio);
        good = good && ratio <= 0.6;
    }
    printf(" of the error\nof the best of LIGHT and LIGHT, MIS.\n");
    return good;
}

/* ---- the picture ---- */

static int draw_picture(const trial *t)
{
    static const unsigned char ground[3] = {38, 40, 44}, white[3] = {255, 255, 255};
    const mis_panel *reference = &t->scene.panels[MIS_REFERENCE];
    const float exposure = mis_exposure(reference);
    const int last = WAYS * SCENE_WIDTH;
    char name[64], path[512], error[600];
    picture canvas;
    int row, by, ok;

    if (!picture_alloc(&canvas, last + SCENE_WIDTH, SCENE_TITLE + ROWS * ROW_HEIGHT))
        return fail(t->name, "not enough memory for a picture");
    picture_fill(&canvas, 0, 0, canvas.width, canvas.height, ground);
    picture_text(&canvas, 6, 6, 2, white, "Rays a pixel, Owen-Sobol points. RMSE over the mean");
    for (row = 0; row < ROWS; row++)
        for (by = 0; by < WAYS; by++) {
            snprintf(name, sizeof name, "%s: %u", ways[by].name, (unsigned)counts[row]);
            mis_draw_panel(&canvas, by * SCENE_WIDTH, SCENE_TITLE + row * ROW_HEIGHT,
                           &t->panels[SOBOL][row][by], exposure, name);
        }
    mis_draw_panel(&canvas, last, SCENE_TITLE, reference, exposure, "REFERENCE");
    picture_map(&canvas, last, SCENE_TITLE + ROW_HEIGHT, SCENE_WIDTH, SCENE_HEIGHT, &t->map,
                exposure);
    picture_text(&canvas, last + 6, SCENE_TITLE + ROW_HEIGHT + SCENE_HEIGHT + 4, 2, white,
                 "THE MAP");
    MAKE_FOLDER(t->folder);          /* where it fails, so does the picture */
    snprintf(path, sizeof path, "%s/facing_%s.png", t->folder, t->name);
    ok = picture_write(&canvas, path, error, sizeof error);
    picture_free(&canvas);
    if (!ok)
        fprintf(stderr, "facing: %s\n", error);
    return ok;
}

/* ---- one map ---- */

static int do_map(trial *t)
{
    envsamp_result result;
    int good;

    image_clean(&t->map);
    memset(&t->view, 0, sizeof t->view);
    t->view.pixels = t->map.rgb;
    t->view.width = t->map.width;
    t->view.height = t->map.height;
    t->view.channels = 3;
    result = make_table(&t->view, &t->memory, &t->kd);
    if (result != ENVSAMP_OK)
        return fail(t->name, envsamp_result_string(result));
    t->scene.view = &t->view;
    t->scene.plain = mis_light_of_kd(t->kd);
    mis_turn_map(&t->scene);
    find_points(t);
    t->shown = progress_start("facing");
    t->done = 0.0;
    shade_all(t);
    if (!(mean_ratio(t, &t->scene.panels[MIS_REFERENCE]) > 0.0))
        return fail(t->name, "has no light above the horizon");
    time_all(t);
    progress_end(&t->shown);
    print_errors(t);
    if (!t->quick)
        print_equal_times(t);
    good = print_verdict(t);
    return t->quick ? good : draw_picture(t);
}

static int do_name(trial *t, const char *name)
{
    char error[600];
    const char *slash = strrchr(name, '/');
    int ok;

    t->name = slash ? slash + 1 : name;
    if (!map_make(name, MADE_WIDTH, MADE_HEIGHT, &t->map)
        && !image_read(name, &t->map, error, sizeof error)) {
        fprintf(stderr, "facing: %s\n", error);
        return 0;
    }
    ok = do_map(t);
    free(t->memory);
    image_free(&t->map);
    return ok;
}

int main(int argc, char **argv)
{
    static trial t;
    const char *name = NULL;
    int i;

    t.folder = "build/pictures";
    t.counts = COUNTS;
    for (i = 1; i < argc; i++) {
        if (!strcmp(argv[i], "-q")) {
            t.quick = 1;
            t.counts = COUNTS - 1;
        } else if (!strcmp(argv[i], "-o") && i + 1 < argc) {
            t.folder = argv[++i];
        } else if (argv[i][0] != '-' && !name) {
            name = argv[i];
        } else {
            fprintf(stderr, "usage: facing [-q] [-o FOLDER] [MAP]\n");
            return EXIT_FAILURE;
        }
    }
    return do_name(&t, name ? name : "studio") ? EXIT_SUCCESS : EXIT_FAILURE;
}
