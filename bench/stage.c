/* stage.c: see stage.h. */
#include "stage.h"

#include "../examples/common/errors.h"
#include "../examples/render/vector.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#define PATH 512
#define MIDDLE_GREY 0.3f             /* what the mean luminance is shown as */

double stage_render(const stage *s, const method *by, uint32_t count, int independent,
                    uint32_t seed, image *out)
{
    const clock_t start = clock();
    render_job job;
    film f;

    memset(&job, 0, sizeof job);
    job.scene = s->scene;
    job.environment = &s->environment;
    job.method = by;
    job.bounces = s->bounces;
    job.side = 1;
    job.independent = independent;
    job.seed = seed;
    job.threads = s->config->threads;
    if (!film_make(&f, out->width, out->height))
        return -1.0;
    render_samples(&job, &f, count);
    film_image(&f, out);
    film_free(&f);
    return (double)(clock() - start) / CLOCKS_PER_SEC;
}

typedef struct filtered_job {
    const stage *stage;
    const filtered *levels;
    float bias;
    uint32_t count, seed;
} filtered_job;

/* One of `count` samples of a pixel. */
static void shade_filtered(const void *user, const film *f, int x, int y, uint32_t sample,
                           float rgb[3])
{
    const filtered_job *job = user;
    const scene *shown = job->stage->scene;
    const environment *e = &job->stage->environment;
    float from[3], dir[3], eye[3], local[3], weight[3], radiance[3], u[2], pdf;
    const numbers n = pixel_ray(shown, f, x, y, 1, 0, job->seed, sample, from, dir);
    scene_hit hit;
    int i;

    if (!scene_closest(shown, from, dir, &hit)) {
        environment_radiance(e, dir, rgb);
        return;
    }
    vec_negate(dir, dir);
    vec_into(&hit.basis, dir, eye);
    numbers_pair(&n, NUMBERS_BSDF, 1, u);
    if (!material_sample(hit.material, eye, u, local, &pdf))
        return;
    vec_out_of(&hit.basis, local, dir);
    if (vec_dot(hit.flat, dir) <= 0.0f || scene_occluded(shown, hit.at, dir))
        return;
    material_eval(hit.material, eye, local, weight);
    environment_into(e, dir, dir);
    filtered_lookup(job->levels, dir, pdf, (int)job->count, job->bias, radiance);
    for (i = 0; i < 3; i++)
        rgb[i] += weight[i] * radiance[i] / pdf;
}

double stage_render_filtered(const stage *s, const filtered *levels, float bias, uint32_t count,
                             uint32_t seed, image *out)
{
    const filtered_job job = {s, levels, bias, count, seed};
    const clock_t start = clock();
    film f;

    if (!film_make(&f, out->width, out->height))
        return -1.0;
    film_run(&f, count, s->config->threads, shade_filtered, &job, NULL);
    film_image(&f, out);
    film_free(&f);
    return (double)(clock() - start) / CLOCKS_PER_SEC;
}

static scene *open_ward(void)
{
    static const float black[3] = {0.0f, 0.0f, 0.0f}, white[3] = {0.9f, 0.9f, 0.9f};
    const material m = material_ward(black, white, 0.5f, 0.001f);

    return scene_sphere(&m);
}

/* Read from the folder, or rendered into it. */
static int make_reference(const stage *s, const char *path, uint32_t seed, image *out,
                          char *error, size_t error_size)
{
    const stage_config *config = s->config;
    const sampler_options plain = {0.0f, 0.0f, 0};
    method by;
    int good;

    if (image_read_pfm(path, out, NULL, 0)) {
        if (out->width == config->width && out->height == config->height)
            return 1;
        image_free(out);
    }
    if (!image_alloc(out, config->width, config->height)) {
        snprintf(error, error_size, "%s: out of memory", path);
        return 0;
    }
    if (!method_open(&by, "facing+mis", &s->environment, &plain, error, error_size))
        return 0;
    good = stage_render(s, &by, config->reference_samples, 0, seed, out) >= 0.0;
    method_close(&by);
    if (!good)
        snprintf(error, error_size, "%s: out of memory", path);
    return good && image_write_pfm(path, out, error, error_size);
}

static int make_mean(stage *s)
{
    const size_t count = 3 * (size_t)s->config->width * (size_t)s->config->height;
    double sum = 0.0, luminance = 0.0;
    size_t i;

    if (!image_alloc(&s->mean, s->config->width, s->config->height))
        return 0;
    for (i = 0; i < count; i++) {
        s->mean.rgb[i] = 0.5f * (s->a.rgb[i] + s->b.rgb[i]);
        sum += (double)s->mean.rgb[i];
    }
    for (i = 0; i < count; i += 3)
        luminance += (double)fminf(envsamp_luminance(s->mean.rgb + i), (float)(9.0 * sum
                                                                      / (double)count));
    s->level = sum / (double)count;
    s->exposure = luminance > 0.0 ? MIDDLE_GREY * (float)((double)count / 3.0 / luminance) : 1.0f;
    return 1;
}

int stage_open(stage *s, const stage_config *config, const char *map_name, const image *map,
               const char *scene_name, int bounces, char *error, size_t error_size)
{
    char path[PATH];
    image *references[2];
    int i;

    memset(s, 0, sizeof *s);
    s->config = config;
    s->bounces = bounces;
    environment_make(&s->environment, map, 0.0f);
    s->scene = strcmp(scene_name, STAGE_WARD) ? scene_open(scene_name, error, error_size)
                                              : open_ward();
    references[0] = &s->a;
    references[1] = &s->b;
    for (i = 0; s->scene && i < 2; i++) {
        snprintf(path, sizeof path, "%s/%s_%s_%d_%dx%d_%u_%c.pfm", config->folder, map_name,
                 scene_name, bounces, config->width, config->height,
                 (unsigned)config->reference_samples, "ab"[i]);
        if (!make_reference(s, path, 101 * (uint32_t)(i + 1), references[i], error, error_size))
            break;
    }
    if (i == 2 && make_mean(s))
        return 1;
    if (i == 2 || (!s->scene && !strcmp(scene_name, STAGE_WARD)))
        snprintf(error, error_size, "%s: out of memory", map_name);
    stage_close(s);
    return 0;
}

void stage_close(stage *s)
{
    if (s->scene)
        scene_close(s->scene);
    image_free(&s->a);
    image_free(&s->b);
    image_free(&s->mean);
    memset(s, 0, sizeof *s);
}

void stage_judge(const stage *s, const image *picture, double error[STAGE_ERRORS])
{
    error[STAGE_RELATIVE] = sqrt(fmax(error_mse_two(picture, &s->a, &s->b), 0.0)) / s->level;
    error[STAGE_TRIMMED] = sqrt(error_relative_mse(picture, &s->mean));
    error[STAGE_PSNR] = error_psnr(picture, &s->mean, s->exposure);
    error[STAGE_FLIP] = error_flip(picture, &s->mean, s->exposure, ERROR_FLIP_PPD, NULL);
}
