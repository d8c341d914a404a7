/* lights_gallery.c: a map as a few directional lights, by every method, in pictures.
 *
 *     lights_gallery [-o FOLDER] [-k COUNT] [MAP]
 *
 * MAP is an HDR or PFM file or the name of a made-up map (see maps.h); without: sky, studio. Prints
 * how far the irradiance of each set of lights is off, and draws it into FOLDER/lights_MAP.png
 * (default: build/pictures): every light as a circle of its energy on the map, and a diffuse and a
 * glossy sphere in their light. No packages are needed.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

enum { RANDOM, PUBLISHED, HALFTONE, MEDIAN_CUT, VARIANCE_CUT, DECOMPOSED, RELAXED, METHOD_COUNT };

#include "../examples/common/folder.h"
#include "../examples/common/irradiance.h"
#include "../examples/common/map_pictures.h"
#include "../examples/common/maps.h"

#define SPHERE_SAMPLERS METHOD_COUNT
#include "../examples/common/spheres.h"

#define MADE_WIDTH 512
#define MADE_HEIGHT 256
#define COUNT_MAX 1024
#define ROW_HEIGHT 256
#define TITLE_HEIGHT 26
#define BALLS_AT (2 * ROW_HEIGHT + 8)

#define ROW_WIDTH (BALLS_AT + SURFACE_COUNT * SPHERE_SIDE + 16)

/* The published scan of error diffusion has no method of its own. */
static const struct { const char *name; envsamp_lights_method id; } methods[METHOD_COUNT] = {
    {"RANDOM", ENVSAMP_LIGHTS_RANDOM}, {"PUBLISHED HALFTONE", ENVSAMP_LIGHTS_HALFTONE},
    {"HALFTONE", ENVSAMP_LIGHTS_HALFTONE}, {"MEDIAN CUT", ENVSAMP_LIGHTS_MEDIAN_CUT},
    {"VARIANCE CUT", ENVSAMP_LIGHTS_VARIANCE_CUT}, {"DECOMPOSED", ENVSAMP_LIGHTS_DECOMPOSED},
    {"RELAXED", ENVSAMP_LIGHTS_RELAXED}
};

typedef struct gallery {
    const char *folder, *name;
    int count;
    image map;
    envsamp_image view;
    envsamp_buffer scratch;
    irradiance exact;
    envsamp_light lights[METHOD_COUNT][COUNT_MAX];
    double luminance;               /* integral of it */
    double rmse[METHOD_COUNT];
    spheres balls;
} gallery;

static int fail(const char *subject, const char *what)
{
    fprintf(stderr, "lights_gallery: %s: %s\n", subject, what);
    return 0;
}

/* ---- lights ---- */

/* What an engine does: memory, one call, and a light is a direction and an irradiance. */
static envsamp_result make_lights(gallery *g, envsamp_lights_method method, envsamp_light *lights)
{
    envsamp_lights_desc desc = envsamp_lights_defaults();
    envsamp_lights_info info = {0, 0, 0.0f, {0.0, 0.0, 0.0}, 0};
    envsamp_sizes sizes;
    envsamp_result result;

    desc.count = g->count;
    desc.method = method;
    desc.seed = method == ENVSAMP_LIGHTS_RANDOM;
    result = envsamp_lights_sizes(&g->view, &desc, &sizes);
    if (result != ENVSAMP_OK || sizes.scratch_bytes > g->scratch.bytes)
        return result != ENVSAMP_OK ? result : ENVSAMP_ERR_MEMORY;
    result = envsamp_lights(&g->view, &desc, lights, COUNT_MAX, g->scratch, &info);
    g->luminance = 0.2126 * info.integral[0] + 0.7152 * info.integral[1]
                 + 0.0722 * info.integral[2];
    return result;
}

/* Luminance x solid angle, which error diffusion works on. */
static float *make_importance(const image *map)
{
    const size_t count = (size_t)map->width * (size_t)map->height;
    float *importance = malloc(count * sizeof *importance);
    size_t i;

    for (i = 0; i < count && importance; i++) {
        const float *rgb = map->rgb + 3 * i;
        const int y = (int)(i / (size_t)map->width);

        importance[i] = fmaxf(envsamp_luminance(rgb), 0.0f) * texel_sr(map->width, map->height, y);
    }
    return importance;
}

/* The same from the published scan: texel by texel, every sample worth S/M. */
static envsamp_result make_published(gallery *g, envsamp_light *lights)
{
    const int width = g->map.width, height = g->map.height;
    envsamp_texel texels[COUNT_MAX];
    envsamp_halftone_desc desc = {1, ENVSAMP_KERNEL_SZIRMAY, 0, ENVSAMP_SCAN_TEXELS, 1};
    float *importance = make_importance(&g->map);
    envsamp_result result = ENVSAMP_ERR_MEMORY;
    int count = 0, i, c;

    desc.count = g->count;
    if (importance)
        result = envsamp_halftone(importance, width, height, 0, &desc, texels, COUNT_MAX, &count,
                                  g->scratch);
    for (i = 0; i < count; i++) {
        const size_t texel = (size_t)texels[i].y * (size_t)width + (size_t)texels[i].x;
        const float sr = texel_sr(width, height, texels[i].y)
                       / (texels[i].probability * (float)count);

        envsamp_uv_to_dir(ENVSAMP_LATLONG, ((float)texels[i].x + 0.5f) / (float)width,
                          ((float)texels[i].y + 0.5f) / (float)height, lights[i].dir);
        for (c = 0; c < 3; c++)
            lights[i].irradiance[c] = g->map.rgb[3 * texel + (size_t)c] * sr;
        lights[i].direct = 0;
    }
    free(importance);
    return count == g->count ? result : ENVSAMP_ERR_MEMORY;
}

/* ---- what they light ---- */

/* RMS relative error of irradiance over the normals that see light. */
static double lights_rmse(const gallery *g, const envsamp_light *lights)
{
    double squares = 0.0, seen = 0.0;
    int i, k;

    for (k = 0; k < IRRADIANCE_NORMALS; k++) {
        double sum = 0.0, error;

        for (i = 0; i < g->count; i++)
            sum += (double)(envsamp_luminance(lights[i].irradiance)
                            * fmaxf(dot3(g->exact.normals[k], lights[i].dir), 0.0f));
        error = g->exact.exact[k] > 0.0 ? sum / g->exact.exact[k] - 1.0 : 0.0;
        squares += error * error;
        seen += g->exact.exact[k] > 0.0 ? 1.0 : 0.0;
    }
    return seen > 0.0 ? sqrt(squares / seen) : 0.0;
}

static void shade_by_lights(gallery *g, int surface, int method)
{
    float *rgb = g->balls.panels[surface][method].rgb, normal[3], mirror[3];
    int pixel, i, c;

    for (pixel = 0; pixel < SPHERE_SIDE * SPHERE_SIDE; pixel++, rgb += 3) {
        if (!sphere_at(&g->balls, pixel % SPHERE_SIDE, pixel / SPHERE_SIDE, normal, mirror))
            continue;
        for (i = 0; i < g->count; i++) {
            const envsamp_light *light = &g->lights[method][i];
            const float shown = response(surface, normal, mirror, light->dir);

            for (c = 0; c < 3; c++)
                rgb[c] += shown * light->irradiance[c];
        }
    }
}

static void shade_balls(gallery *g)
{
    int surface, method;

    memset(&g->balls, 0, sizeof g->balls);
    g->balls.map = &g->map;
    gather_cells(&g->balls);
    place_eye(&g->balls);
    for (surface = 0; surface < SURFACE_COUNT; surface++) {
        panel *panels = g->balls.panels[surface];

        shade_panel(&g->balls, surface, REFERENCE);
        for (method = 0; method < METHOD_COUNT; method++) {
            shade_by_lights(g, surface, method);
            panels[method].rmse = panel_rmse(&panels[method], &panels[REFERENCE]);
        }
    }
}

/* ---- the picture ---- */

/* A circle whose area is the light's energy: red for a direct light, blue for the others, as in
   figure 5 of [Wu 2024]. */
static void draw_light(picture *shown, const gallery *g, const envsamp_light *light)
{
    static const unsigned char direct[3] = {230, 40, 40}, indirect[3] = {40, 120, 255};
    const double share = (double)envsamp_luminance(light->irradiance) / g->luminance;
    const double width = fmin(fmax(72.0 * sqrt(share), 4.0), 26.0);
    float uv[2];
    double at[2];

    envsamp_dir_to_uv(ENVSAMP_LATLONG, light->dir, uv);
    at[0] = (double)uv[0] * 2.0 * ROW_HEIGHT;
    at[1] = (double)uv[1] * ROW_HEIGHT;
    picture_line(shown, at, at, width + 2.5, map_white);
    picture_line(shown, at, at, width, light->direct ? direct : indirect);
}

/* The map with its lights, cut off at its edges. Returns 0 if memory is short. */
static int draw_map(picture *canvas, int left, int top, const gallery *g, int method)
{
    picture shown;
    int i;

    if (!picture_alloc(&shown, 2 * ROW_HEIGHT, ROW_HEIGHT))
        return 0;
    picture_map(&shown, 0, 0, shown.width, shown.height, &g->map,
                map_exposure(&g->map, g->luminance));
    for (i = 0; i < g->count && method != REFERENCE; i++)
        draw_light(&shown, g, &g->lights[method][i]);
    picture_paste(canvas, left, top, &shown);
    picture_free(&shown);
    return 1;
}

static void draw_ball_with_error(picture *canvas, int x, int y, const gallery *g, int surface,
                                 int method)
{
    const double rmse = g->balls.panels[surface][method].rmse;
    char text[32];

    draw_ball(canvas, x, y, &g->balls, surface, method);
    snprintf(text, sizeof text, "%s", surface == DIFFUSE ? "DIFFUSE" : "GLOSSY");
    centred_text(canvas, x, y + SPHERE_SIDE + 6, method == REFERENCE ? "REFERENCE" : text);
    snprintf(text, sizeof text, "RMSE %.3f", rmse);
    if (method != REFERENCE)
        centred_text(canvas, x, y + SPHERE_SIDE + 26, text);
}

/* `method` REFERENCE: the map alone, and the spheres in all of its light. */
static int draw_row(picture *canvas, const gallery *g, int row, int method)
{
    const int top = row / 2 * (ROW_HEIGHT + TITLE_HEIGHT) + TITLE_HEIGHT;
    const int left = row % 2 * ROW_WIDTH;
    char title[96];
    int surface;

    snprintf(title, sizeof title, "%s: ALL OF THE MAP. RMSE OVER THE MEAN", g->name);
    if (method != REFERENCE)
        snprintf(title, sizeof title, "%s, %d LIGHTS: IRRADIANCE RMSE %.3f", methods[method].name,
                 g->count, g->rmse[method]);
    if (!draw_map(canvas, left, top, g, method))
        return 0;
    picture_text(canvas, left + 6, top - TITLE_HEIGHT + 6, 2, map_white, title);
    for (surface = 0; surface < SURFACE_COUNT; surface++)
        draw_ball_with_error(canvas, left + BALLS_AT + surface * SPHERE_SIDE, top + 34, g, surface,
                             method);
    return 1;
}

static int draw_gallery(const gallery *g)
{
    char path[512], error[600];
    picture canvas;
    int method, ok = 1;

    if (!picture_alloc(&canvas, 2 * ROW_WIDTH,
                       (METHOD_COUNT + 2) / 2 * (ROW_HEIGHT + TITLE_HEIGHT) + 12))
        return fail(g->name, "not enough memory");
    picture_fill(&canvas, 0, 0, canvas.width, canvas.height, map_ground);
    for (method = 0; method < METHOD_COUNT; method++)
        ok = ok && draw_row(&canvas, g, method, method);
    ok = ok && draw_row(&canvas, g, METHOD_COUNT, REFERENCE);
    snprintf(error, sizeof error, "%s: not enough memory", g->name);
    snprintf(path, sizeof path, "%s/lights_%s.png", g->folder, g->name);
    ok = ok && picture_write(&canvas, path, error, sizeof error);
    picture_free(&canvas);
    if (!ok)
        fprintf(stderr, "lights_gallery: %s\n", error);
    return ok;
}

/* ---- one map ---- */

static int make_all(gallery *g)
{
    envsamp_result result = ENVSAMP_OK;
    int method;

    for (method = 0; method < METHOD_COUNT && result == ENVSAMP_OK; method++)
        result = method == PUBLISHED ? make_published(g, g->lights[method])
                                     : make_lights(g, methods[method].id, g->lights[method]);
    if (result != ENVSAMP_OK)
        return fail(g->name, envsamp_result_string(result));
    if (!irradiance_make(&g->exact, &g->map))
        return fail(g->name, "not enough memory");
    for (method = 0; method < METHOD_COUNT; method++)
        g->rmse[method] = lights_rmse(g, g->lights[method]);
    return 1;
}

static int do_map(gallery *g)
{
    int method, ok;

    image_clean(&g->map);
    memset(&g->view, 0, sizeof g->view);
    g->view.pixels = g->map.rgb;
    g->view.width = g->map.width;
    g->view.height = g->map.height;
    g->view.channels = 3;
    ok = make_all(g);
    if (ok) {
        for (method = 0; method < METHOD_COUNT; method++)
            printf("%-10s %4d lights, %-18s irradiance RMSE %.4f\n", g->name, g->count,
                   methods[method].name, g->rmse[method]);
        shade_balls(g);
        MAKE_FOLDER(g->folder);         /* where it fails, so does the picture */
        ok = draw_gallery(g);
    }
    image_free(&g->map);
    return ok;
}

static int do_name(gallery *g, const char *name)
{
    char error[600];
    const char *slash = strrchr(name, '/');

    g->name = slash ? slash + 1 : name;
    if (map_make(name, MADE_WIDTH, MADE_HEIGHT, &g->map)
        || image_read(name, &g->map, error, sizeof error))
        return do_map(g);
    fprintf(stderr, "lights_gallery: %s\n", error);
    return 0;
}

#define USAGE "usage: lights_gallery [-o FOLDER] [-k COUNT, 1..1024] [MAP]\n"

int main(int argc, char **argv)
{
    static gallery g;
    const char *name = NULL;
    int i, ok;

    g.folder = "build/pictures";
    g.count = 64;
    for (i = 1; i < argc; i++) {
        if (!strcmp(argv[i], "-o") && i + 1 < argc)
            g.folder = argv[++i];
        else if (!strcmp(argv[i], "-k") && i + 1 < argc)
            g.count = atoi(argv[++i]);
        else if (argv[i][0] != '-' && !name)
            name = argv[i];
        else
            g.count = 0;
    }
    if (g.count < 1 || g.count > COUNT_MAX) {
        fprintf(stderr, USAGE);
        return EXIT_FAILURE;
    }
    g.scratch.bytes = (size_t)16 << 20;
    g.scratch.data = malloc(g.scratch.bytes);
    ok = g.scratch.data ? 1 : fail("scratch", "not enough memory");
    if (name && ok)
        ok = do_name(&g, name);
    else if (ok)
        ok = do_name(&g, "sky") && do_name(&g, "studio");
    free(g.scratch.data);
    return ok ? EXIT_SUCCESS : EXIT_FAILURE;
}
