/* integrator.c: see integrator.h. */
#include "integrator.h"
#include "vector.h"

#include <stdlib.h>
#include <string.h>

#define ROULETTE_DEPTH 3             /* bounces that no path ends before */
#define ROULETTE_MOST 0.95f          /* probability to go on, at most */

/* ---- film ---- */

int film_make(film *f, int width, int height)
{
    const size_t pixels = (size_t)width * (size_t)height;

    f->width = width;
    f->height = height;
    f->samples = 0;
    f->rgb = calloc(4 * pixels, sizeof *f->rgb);
    f->squares = f->rgb ? f->rgb + 3 * pixels : NULL;
    return f->rgb != NULL;
}

void film_free(film *f)
{
    free(f->rgb);
    f->rgb = f->squares = NULL;
}

void film_add(film *f, int x, int y, const float rgb[3])
{
    const size_t pixel = (size_t)y * (size_t)f->width + (size_t)x;
    const double luminance = (double)envsamp_luminance(rgb);
    size_t c;

    for (c = 0; c < 3; c++)
        f->rgb[3 * pixel + c] += (double)rgb[c];
    f->squares[pixel] += luminance * luminance;
}

void film_image(const film *f, image *out)
{
    const size_t count = 3 * (size_t)f->width * (size_t)f->height;
    size_t i;

    for (i = 0; i < count; i++)
        out->rgb[i] = (float)(f->rgb[i] / f->samples);
}

/* ---- a point of a path ---- */

typedef struct path_point {
    scene_hit hit;
    float eye[3];                    /* in the frame of the point */
    float axis[3];                   /* what light is best looked for about, in the world */
    float throughput[3];
} path_point;

static void make_point(path_point *p, const float dir[3])
{
    float back[3], axis[3];

    vec_negate(dir, back);
    vec_into(&p->hit.basis, back, p->eye);
    material_axis(p->hit.material, p->eye, axis);
    vec_out_of(&p->hit.basis, axis, p->axis);
}

static void add_light(const float throughput[3], const float f[3], const float radiance[3],
                      float scale, float rgb[3])
{
    int i;

    for (i = 0; i < 3; i++)
        rgb[i] += throughput[i] * f[i] * radiance[i] * scale;
}

/* One direction drawn from the light. */
static void add_light_sample(const render_job *job, path_point *p, const float u[2], float rgb[3])
{
    const envsamp_sample s = method_sample(job->method, job->environment, p->axis, u);
    float local[3], f[3], radiance[3], weight = 1.0f;

    vec_into(&p->hit.basis, s.dir, local);
    if (!(s.pdf > 0.0f) || local[2] <= 0.0f || vec_dot(p->hit.flat, s.dir) <= 0.0f)
        return;
    material_eval(p->hit.material, p->eye, local, f);
    if (!(f[0] + f[1] + f[2] > 0.0f) || scene_occluded(job->scene, p->hit.at, s.dir))
        return;
    if (job->method->mis)
        weight = envsamp_mis_power(s.pdf, material_pdf(p->hit.material, p->eye, local));
    environment_radiance(job->environment, s.dir, radiance);
    add_light(p->throughput, f, radiance, weight / s.pdf, rgb);
}

/* A direction drawn by the BSDF that meets nothing but the map. p->throughput includes f / pdf. */
static void add_escaped(const render_job *job, const path_point *p, const float dir[3], float pdf,
                        float rgb[3])
{
    static const float one[3] = {1.0f, 1.0f, 1.0f};
    float radiance[3], weight = 1.0f;

    if (job->method->mis)
        weight = envsamp_mis_power(pdf, method_pdf(job->method, job->environment, p->axis, dir));
    environment_radiance(job->environment, dir, radiance);
    add_light(p->throughput, one, radiance, weight, rgb);
}

/* Draws by the BSDF, and multiplies the throughput. Returns 0 where the path ends. */
static int scatter(path_point *p, const float u[2], float dir[3], float *pdf)
{
    float local[3], f[3];
    int i;

    if (!material_sample(p->hit.material, p->eye, u, local, pdf))
        return 0;
    vec_out_of(&p->hit.basis, local, dir);
    if (vec_dot(p->hit.flat, dir) <= 0.0f)
        return 0;
    material_eval(p->hit.material, p->eye, local, f);
    for (i = 0; i < 3; i++)
        p->throughput[i] *= f[i] / *pdf;
    return 1;
}

/* Ends dim paths at random, and makes up for it in the others. */
static int survives(path_point *p, float u)
{
    const float *t = p->throughput;
    const float go_on = fminf(fmaxf(fmaxf(t[0], t[1]), t[2]), ROULETTE_MOST);
    int i;

    if (u >= go_on)
        return 0;
    for (i = 0; i < 3; i++)
        p->throughput[i] /= go_on;
    return 1;
}

static void trace(const render_job *job, const numbers *n, const float from[3], float dir[3],
                  float rgb[3])
{
    const int draws = job->method->by->sample != NULL, counts = job->method->mis || !draws;
    path_point p;
    float u[2], pdf;
    int depth;

    if (!scene_closest(job->scene, from, dir, &p.hit)) {
        environment_radiance(job->environment, dir, rgb);
        return;
    }
    vec_set(p.throughput, 1.0f, 1.0f, 1.0f);
    for (depth = 1; ; depth++) {
        const int last = depth == job->bounces;

        make_point(&p, dir);
        if (draws) {
            numbers_pair(n, NUMBERS_LIGHT, depth, u);
            add_light_sample(job, &p, u, rgb);
        }
        if (last && !counts)
            return;
        numbers_pair(n, NUMBERS_BSDF, depth, u);
        if (!scatter(&p, u, dir, &pdf))
            return;
        if (last ? !scene_occluded(job->scene, p.hit.at, dir)
                 : !scene_closest(job->scene, p.hit.at, dir, &p.hit)) {
            if (counts)
                add_escaped(job, &p, dir, pdf, rgb);
            return;
        }
        if (last)
            return;
        numbers_pair(n, NUMBERS_ROULETTE, depth, u);
        if (depth >= ROULETTE_DEPTH && !survives(&p, u[0]))
            return;
    }
}

/* ---- pictures ---- */

/* Every part of a pixel has a sequence of its own. */
numbers pixel_ray(const scene *s, const film *f, int x, int y, int side, int independent,
                  uint32_t seed, uint32_t sample, float from[3], float dir[3])
{
    const uint32_t parts = side > 0 ? (uint32_t)(side * side) : 1, part = sample % parts;
    const uint32_t pixel = hash_combine(seed, (uint32_t)(y * f->width + x));
    const numbers n = numbers_make(independent, part ? hash_combine(pixel, part) : pixel,
                                   sample / parts);
    float u[2];

    numbers_pair(&n, NUMBERS_PIXEL, 0, u);
    if (side > 0) {
        u[0] = ((float)((int)part % side) + 0.5f) / (float)side;
        u[1] = ((float)((int)part / side) + 0.5f) / (float)side;
    }
    scene_ray(s, ((float)x + u[0]) / (float)f->width, ((float)y + u[1]) / (float)f->height,
              (float)f->width / (float)f->height, from, dir);
    return n;
}

typedef struct film_pass {
    film *film;
    uint32_t first, count;
    film_shade shade;
    const void *job;
} film_pass;

static void shade_tile(void *user, const tile *t)
{
    const film_pass *pass = user;
    uint32_t i;
    int x, y;

    for (y = t->top; y < t->bottom; y++)
        for (x = t->left; x < t->right; x++)
            for (i = pass->first; i < pass->first + pass->count; i++) {
                float rgb[3] = {0.0f, 0.0f, 0.0f};

                pass->shade(pass->job, pass->film, x, y, i, rgb);
                film_add(pass->film, x, y, rgb);
            }
}

void film_run(film *f, uint32_t count, int threads, film_shade shade, const void *job,
              const tile_progress *progress)
{
    film_pass pass;

    pass.film = f;
    pass.first = f->samples;
    pass.count = count;
    pass.shade = shade;
    pass.job = job;
    tiles_run(f->width, f->height, threads, shade_tile, &pass, progress);
    f->samples += count;
}

static void shade_sample(const void *user, const film *f, int x, int y, uint32_t sample,
                         float rgb[3])
{
    const render_job *job = user;
    float from[3], dir[3];
    const numbers n = pixel_ray(job->scene, f, x, y, job->side, job->independent, job->seed,
                                sample, from, dir);

    trace(job, &n, from, dir, rgb);
}

void render_samples(const render_job *job, film *f, uint32_t count)
{
    film_run(f, count, job->threads, shade_sample, job, job->progress);
}
