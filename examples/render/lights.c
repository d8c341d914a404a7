/* lights.c: see lights.h. */
#include "lights.h"
#include "vector.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define DEFAULT_EXTENT 0.1f          /* [Wu 2024, section 3.5] */

const light_method light_methods[] = {
    {"relaxed", "relaxed on the sphere, moved and weighed", ENVSAMP_LIGHTS_RELAXED},
    {"decomposed", "EnvDirects and EnvIndirects", ENVSAMP_LIGHTS_DECOMPOSED},
    {"median-cut", "rectangles of equal luminance", ENVSAMP_LIGHTS_MEDIAN_CUT},
    {"variance-cut", "rectangles of little spread", ENVSAMP_LIGHTS_VARIANCE_CUT},
    {"halftone", "error diffusion", ENVSAMP_LIGHTS_HALFTONE},
    {"random", "independent importance samples", ENVSAMP_LIGHTS_RANDOM},
    {NULL, NULL, ENVSAMP_LIGHTS_RELAXED}
};

/* ---- lists ---- */

static envsamp_result fill_list(light_list *list, const envsamp_lights_desc *desc,
                                const environment *e)
{
    envsamp_buffer scratch;
    envsamp_result result;
    envsamp_sizes sizes;

    result = envsamp_lights_sizes(&e->view, desc, &sizes);
    if (result != ENVSAMP_OK)
        return result;
    list->count = desc->count;
    list->lights = calloc((size_t)desc->count, sizeof *list->lights);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    result = list->lights && scratch.data
           ? envsamp_lights(&e->view, desc, list->lights, list->count, scratch, NULL)
           : ENVSAMP_ERR_MEMORY;
    free(scratch.data);
    return result;
}

int lights_build(light_list *list, const envsamp_lights_desc *desc, const environment *e,
                 char *error, size_t error_size)
{
    envsamp_result result;

    memset(list, 0, sizeof *list);
    result = fill_list(list, desc, e);
    if (result == ENVSAMP_OK)
        return 1;
    lights_free(list);
    snprintf(error, error_size, "the library refuses the lights: %s",
             envsamp_result_string(result));
    return 0;
}

int lights_make(light_list *list, const char *name, int count, uint32_t seed,
                const environment *e, char *error, size_t error_size)
{
    envsamp_lights_desc desc = envsamp_lights_defaults();
    int i = 0;

    memset(list, 0, sizeof *list);
    while (light_methods[i].name && strcmp(light_methods[i].name, name))
        i++;
    if (!light_methods[i].name) {
        snprintf(error, error_size, "%s: no such method of lights; --list shows them", name);
        return 0;
    }
    desc.count = count;
    desc.method = light_methods[i].number;
    desc.seed = seed;
    return lights_build(list, &desc, e, error, error_size);
}

void lights_free(light_list *list)
{
    free(list->lights);
    list->lights = NULL;
    list->count = 0;
}

void lights_mark(light_list *list, float times)
{
    float light = 0.0f, solid_angle = 0.0f;
    int i;

    for (i = 0; i < list->count; i++) {
        light += envsamp_luminance(list->lights[i].irradiance);
        solid_angle += list->lights[i].solid_angle;
    }
    for (i = 0; i < list->count; i++) {
        envsamp_light *l = &list->lights[i];

        l->direct = envsamp_luminance(l->irradiance) * solid_angle > times * light * l->solid_angle;
    }
}

/* All sets, one after another, in directions of the world; NULL if memory is short. */
static envsamp_light *make_sets(const lights_job *job)
{
    const int count = job->list->count;
    envsamp_light *sets = malloc((size_t)job->sets * (size_t)count * sizeof *sets);
    int set, i;

    for (set = 0; set < job->sets && sets; set++) {
        envsamp_light *lights = sets + set * count;

        if (job->sets == 1)
            memcpy(lights, job->list->lights, (size_t)count * sizeof *lights);
        else
            envsamp_lights_interleave(job->list->lights, count, set, job->sets,
                                      job->extent > 0.0f ? job->extent : DEFAULT_EXTENT, job->seed,
                                      lights);
        for (i = 0; i < count; i++)
            environment_out_of(job->environment, lights[i].dir, lights[i].dir);
    }
    return sets;
}

/* ---- shading ---- */

enum { ALL_LIGHTS, DIRECT_LIGHTS, OTHER_LIGHTS };

/* A picture of some of the lights. */
typedef struct lights_pass {
    const lights_job *job;
    const envsamp_light *sets;
    float aspect;
    int which;
    features *features;
    image *rgb;
} lights_pass;

/* Neighbours in a row, in a column and across have sets that are far apart; 4 x 2 have all. */
static int pattern_set(int x, int y, int sets)
{
    static const int order[2][4] = {{0, 5, 2, 7}, {4, 1, 6, 3}};

    return order[y & 1][(x + (y & 2)) & 3] % sets;
}

static int taken(const envsamp_light *light, int which)
{
    return which == ALL_LIGHTS || (which == DIRECT_LIGHTS) == (light->direct != 0);
}

/* Adds what a point shows of the lights that it sees. */
static void shade_point(const lights_pass *pass, scene_hit *hit, const float dir[3], int set,
                        float rgb[3])
{
    const lights_job *job = pass->job;
    const envsamp_light *lights = pass->sets + set * job->list->count;
    float back[3], eye[3], local[3], f[3];
    int i, c;

    vec_negate(dir, back);
    vec_into(&hit->basis, back, eye);
    for (i = 0; i < job->list->count; i++) {
        if (!taken(&lights[i], pass->which) || vec_dot(hit->flat, lights[i].dir) <= 0.0f)
            continue;
        vec_into(&hit->basis, lights[i].dir, local);
        material_eval(hit->material, eye, local, f);
        if (!(f[0] + f[1] + f[2] > 0.0f)
            || scene_occluded(job->scene, hit->at, lights[i].dir))
            continue;
        for (c = 0; c < 3; c++)
            rgb[c] += f[c] * lights[i].irradiance[c];
    }
}

static void add_feature(feature *f, const scene_hit *hit)
{
    vec_along(f->at, 1.0f, hit->at, f->at);
    vec_along(f->normal, 1.0f, hit->basis.z, f->normal);
    vec_along(f->albedo, 1.0f, hit->material->albedo, f->albedo);
    f->depth += hit->distance;
}

static void scale_feature(feature *f, float scale)
{
    int i;

    for (i = 0; i < 3; i++) {
        f->at[i] *= scale;
        f->normal[i] *= scale;
        f->albedo[i] *= scale;
    }
    f->depth *= scale;
}

/* Rays through the middles of side x side parts of a pixel. Features are means over those that meet
   the scene, and so is light of the reduced picture, which is not to be mixed with the map; it is
   brought up times the share of them, which is that of the large pixel. */
static void shade_pixel(const lights_pass *pass, int x, int y)
{
    const lights_job *job = pass->job;
    const image *to = pass->rgb;
    const int side = job->side, rays = side * side, pixel = y * to->width + x;
    feature *f = &pass->features->pixels[pixel];
    float sum[3] = {0.0f, 0.0f, 0.0f};
    int i, met = 0, share;

    for (i = 0; i < rays; i++) {
        const int column = x * side + i % side, row = y * side + i / side;
        float from[3], dir[3], radiance[3];
        scene_hit hit;

        scene_ray(job->scene, ((float)column + 0.5f) / (float)(to->width * side),
                  ((float)row + 0.5f) / (float)(to->height * side), pass->aspect, from, dir);
        if (scene_closest(job->scene, from, dir, &hit)) {
            shade_point(pass, &hit, dir, pattern_set(column, row, job->sets), sum);
            add_feature(f, &hit);
            met++;
        } else if (pass->which != OTHER_LIGHTS) {
            environment_radiance(job->environment, dir, radiance);
            vec_along(sum, 1.0f, radiance, sum);
        }
    }
    share = pass->which == OTHER_LIGHTS ? met : rays;
    if (met)
        scale_feature(f, 1.0f / (float)met);
    f->share = (float)met / (float)rays;
    for (i = 0; i < 3; i++)
        to->rgb[3 * pixel + i] = share ? sum[i] / (float)share : 0.0f;
}

static void shade_tile(void *user, const tile *t)
{
    const lights_pass *pass = user;
    int x, y;

    for (y = t->top; y < t->bottom; y++)
        for (x = t->left; x < t->right; x++)
            shade_pixel(pass, x, y);
}

/* ---- pictures ---- */

static void run(lights_pass *pass, int which, features *f, image *rgb)
{
    pass->which = which;
    pass->features = f;
    pass->rgb = rgb;
    tiles_run(rgb->width, rgb->height, pass->job->threads, shade_tile, pass, pass->job->progress);
}

int lights_render(const lights_job *job, image *out)
{
    const int reduce = job->reduce > 1 ? job->reduce : 1;
    const int width = (out->width + reduce - 1) / reduce;
    const int height = (out->height + reduce - 1) / reduce;
    envsamp_light *sets = make_sets(job);
    features large = {0, 0, NULL}, small = {0, 0, NULL};
    image small_rgb = {0, 0, NULL};
    lights_pass pass;
    int made;

    pass.job = job;
    pass.sets = sets;
    pass.aspect = (float)out->width / (float)out->height;
    made = sets && features_make(&large, out->width, out->height)
        && (reduce == 1
            || (features_make(&small, width, height) && image_alloc(&small_rgb, width, height)));
    if (made)
        run(&pass, reduce == 1 ? ALL_LIGHTS : DIRECT_LIGHTS, &large, out);
    if (made && reduce > 1) {
        run(&pass, OTHER_LIGHTS, &small, &small_rgb);
        upsample_add(&small, &small_rgb, &large, job->sigmas, out);
    }
    features_free(&large);
    features_free(&small);
    image_free(&small_rgb);
    free(sets);
    return made;
}
