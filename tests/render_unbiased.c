/* render_unbiased.c: whether every sampling method of the renderer shows what a scene looks like.
 *
 *     render_unbiased [-t THREADS] [SAMPLES [WIDTH HEIGHT]]     64 samples of 48 x 32 pixels
 *
 * Every scene is rendered under two maps by every method, and compared with a reference of four
 * times as many samples by `inversion+mis`, which calls nothing of the library but the lookup. Each
 * is 8 pictures of Owen-Sobol points with different seeds, whose spread tells the standard error. A
 * method passes where no tile of 16 x 16 pixels, no picture, and not the mean of all pictures, is
 * off by 4 standard errors of the difference. Of more than a thousand tiles one or the other is, by
 * chance: then that picture and its reference are rendered again, of four times as many samples and
 * other seeds, which doubles what an error comes to, and the result of that counts. By the mean of
 * all pictures alone two samplers must be rejected whose densities are half a percent too low.
 *
 * Where a method hardly ever finds the light, such as a lamp in chrome without samples of the BSDF,
 * spread among what it found tells nothing. So what the spread must be is known beforehand: the
 * second moment of its samples is summed with samples of the reference. A tile is judged where by
 * that the error is below a seventh of the mean, a picture likewise; how many are is printed, and
 * at least a tenth has to be.
 *
 * Many directional lights come close to the reference too, at full size, and interleaved and
 * reduced; those of a map that is turned otherwise do not. Prints TAP.
 */
#include "../envsamp.h"

#include "../examples/common/maps.h"
#include "../examples/render/environment.h"
#include "../examples/render/integrator.h"
#include "../examples/render/lights.h"
#include "../examples/render/numbers.h"
#include "../examples/render/product.h"
#include "../examples/render/scene.h"
#include "../examples/render/vector.h"
#include "check.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MOST 4.0                     /* standard errors */
#define REPLICATES 8
#define REFERENCE_TIMES 4
#define AGAIN_TIMES 4                /* as many samples at a second try */
#define WORST_ERROR (1.0 / 7.0)      /* of a mean that is judged: as of 49 hits */
#define LEAST_JUDGED 0.1             /* of tiles */
#define ROTATE 70.0f
#define MAPS 2
#define METHODS_MAX 24

typedef struct made_map { const char *name; int width; } made_map;

/* Small ones, whose sun of one degree has grown to a texel: so that also `uniform` finds it often
   enough for its error to be known. */
static const made_map maps[MAPS] = {{"studio", 128}, {"sky", 64}};

/* A method, and how far it was off so far. */
typedef struct subject {
    char name[64];
    const light_sampler *by;
    int mis, wrong, product;
    float compensation;
    double worst_tile, worst_picture;    /* standard errors */
    double sum, weight;                  /* of relative errors of pictures */
    int pictures, tiles, judged, again;
    double *moments;                     /* a pixel: second moment of a sample; see add_moments */
} subject;

typedef struct trial {
    int width, height, threads;
    uint32_t samples;
    int count;
    subject subjects[METHODS_MAX];
    light_sampler wrong[2];
} trial;

/* A picture's luminance over the replicates. */
typedef struct measured {
    int width, height;
    double *sum, *squares;
} measured;

/* ---- samplers that are wrong ---- */

static const light_sampler *find_sampler(const char *name)
{
    int i = 0;

    while (strcmp(light_samplers[i].name, name))
        i++;
    return &light_samplers[i];
}

static envsamp_sample sample_wrong(const void *table, const float axis[3], float u0, float u1)
{
    envsamp_sample s = envsamp_kd_sample(table, u0, u1);

    (void)axis;
    s.pdf /= 1.005f;
    return s;
}

static float pdf_wrong(const void *table, const float axis[3], const float dir[3])
{
    (void)axis;
    return envsamp_kd_pdf(table, dir) / 1.005f;
}

static envsamp_sample sample_facing_wrong(const void *table, const float axis[3], float u0,
                                          float u1)
{
    envsamp_sample s = envsamp_kd_sample_facing(table, axis, u0, u1);

    s.pdf /= 1.005f;
    return s;
}

static void make_wrong(trial *t)
{
    t->wrong[0] = *find_sampler("kd-warp");
    t->wrong[0].sample = sample_wrong;
    t->wrong[0].pdf = pdf_wrong;
    t->wrong[1] = *find_sampler("facing");
    t->wrong[1].sample = sample_facing_wrong;
}

/* ---- methods ---- */

static void add_subject(trial *t, const light_sampler *by, int mis, float compensation,
                        const char *more)
{
    subject *s = &t->subjects[t->count++];

    snprintf(s->name, sizeof s->name, "%s%s%s", by->name, mis ? "+mis" : "", more);
    s->by = by;
    s->mis = mis;
    s->compensation = compensation;
}

static void add_subjects(trial *t)
{
    int i;

    for (i = 0; light_samplers[i].name; i++) {
        add_subject(t, &light_samplers[i], 0, 0.0f, "");
        if (light_samplers[i].sample)
            add_subject(t, &light_samplers[i], 1, 0.0f, "");
    }
    add_subject(t, find_sampler("kd-warp"), 1, 1.0f, ", compensated");
    add_subject(t, find_sampler("facing"), 1, 1.0f, ", compensated");
    for (i = 1; i <= 2; i++) {
        add_subject(t, find_sampler("bsdf"), 0, 0.0f, "");
        t->subjects[t->count - 1].product = i;
        strcpy(t->subjects[t->count - 1].name, i == 1 ? "double product" : "triple product");
    }
    for (i = 0; i < 2; i++) {
        add_subject(t, &t->wrong[i], 0, 0.0f, ", 0.5 % too bright");
        t->subjects[t->count - 1].wrong = 1;
    }
}

/* ---- pictures ---- */

static int measured_make(measured *m, int width, int height)
{
    m->width = width;
    m->height = height;
    m->sum = calloc(2 * (size_t)width * (size_t)height, sizeof *m->sum);
    m->squares = m->sum ? m->sum + width * height : NULL;
    return m->sum != NULL;
}

static void measured_clear(measured *m)
{
    memset(m->sum, 0, 2 * (size_t)m->width * (size_t)m->height * sizeof *m->sum);
}

static void measured_add(measured *m, const film *f)
{
    int i;

    for (i = 0; i < f->width * f->height; i++) {
        const double *rgb = f->rgb + 3 * i;
        const double one = (0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]) / f->samples;

        m->sum[i] += one;
        m->squares[i] += one * one;
    }
}

static int open_method(method *m, const subject *by, const environment *e)
{
    const sampler_options options = {by->compensation, 0.0f, 0};
    char error[256];

    if (method_make(m, by->by, by->mis, e, &options, error, sizeof error))
        return 1;
    check_note("#     %s: %s\n", by->name, error);
    return 0;
}

static void clear_film(film *f)
{
    f->samples = 0;
    memset(f->rgb, 0, 4 * (size_t)f->width * (size_t)f->height * sizeof *f->rgb);
}

static int render_product(const trial *t, const scene *s, const environment *e, const subject *by,
                          uint32_t samples, uint32_t seed, film *f, measured *out)
{
    const uint32_t all = samples / REPLICATES, rays = all < PRODUCT_RAYS ? all : PRODUCT_RAYS;
    product *light = product_make(e);
    product_job job;
    int i;

    memset(&job, 0, sizeof job);
    job.scene = s;
    job.environment = e;
    job.product = light;
    job.triple = by->product == 2;
    job.rays = (int)rays;
    job.threads = t->threads;
    for (i = 0; i < REPLICATES && light; i++) {
        clear_film(f);
        job.seed = REPLICATES * seed + (uint32_t)i;
        product_samples(&job, f, all / rays);
        measured_add(out, f);
    }
    product_free(light);
    return light != NULL;
}

static int render_paths(const trial *t, const scene *s, const environment *e, const subject *by,
                        int bounces, uint32_t samples, uint32_t seed, film *f, measured *out)
{
    render_job job;
    method m;
    int i;

    if (!open_method(&m, by, e))
        return 0;
    memset(&job, 0, sizeof job);
    job.scene = s;
    job.environment = e;
    job.method = &m;
    job.bounces = bounces;
    job.threads = t->threads;
    for (i = 0; i < REPLICATES; i++) {
        clear_film(f);
        job.seed = REPLICATES * seed + (uint32_t)i;
        render_samples(&job, f, samples / REPLICATES);
        measured_add(out, f);
    }
    method_close(&m);
    return 1;
}

static int render(const trial *t, const scene *s, const environment *e, const subject *by,
                  int bounces, uint32_t samples, uint32_t seed, measured *out)
{
    film f;
    int ok;

    if (!film_make(&f, t->width, t->height))
        return 0;
    measured_clear(out);
    ok = by->product ? render_product(t, s, e, by, samples, seed, &f, out)
                     : render_paths(t, s, e, by, bounces, samples, seed, &f, out);
    film_free(&f);
    return ok;
}

/* ---- what the spread has to be ---- */

typedef struct moments_job {
    const scene *scene;
    const environment *environment;
    const method *reference, *methods;   /* methods: one for each subject */
    trial *trial;
} moments_job;

/* Whether second moments are known. Where samples of the light and of the BSDF are weighed, or
   drawn by both, they are bounded, and the spread of what is found will do. */
static int has_moments(const subject *by)
{
    return !by->mis && !by->product;
}

/* Adds to the second moments in a pixel: one direction of the light or of the BSDF, as either is
   drawn half of the time. A sample of density p has the second moment of value^2 / p^2, so a
   direction of density q adds value^2 / (p q). */
static void add_point(const moments_job *job, int pixel, scene_hit *hit, const float eye[3],
                      const float axis[3], const float u[2], const float choice)
{
    float dir[3], local[3], f[3], radiance[3], by_bsdf, q;
    double value;
    int i, c;

    if (choice < 0.5f) {
        const envsamp_sample s = method_sample(job->reference, job->environment, axis, u);

        vec_copy(s.dir, dir);
        vec_into(&hit->basis, dir, local);
    } else {
        if (!material_sample(hit->material, eye, u, local, &q))
            return;
        vec_out_of(&hit->basis, local, dir);
    }
    if (vec_dot(hit->flat, dir) <= 0.0f || scene_occluded(job->scene, hit->at, dir))
        return;
    material_eval(hit->material, eye, local, f);
    by_bsdf = material_pdf(hit->material, eye, local);
    q = 0.5f * (by_bsdf + method_pdf(job->reference, job->environment, axis, dir));
    environment_radiance(job->environment, dir, radiance);
    for (c = 0; c < 3; c++)
        f[c] *= radiance[c];
    value = (double)envsamp_luminance(f);
    for (i = 0; i < job->trial->count && q > 0.0f; i++) {
        subject *by = &job->trial->subjects[i];
        float p = by_bsdf;

        if (!has_moments(by))
            continue;
        if (by->by->sample)
            p = method_pdf(&job->methods[i], job->environment, axis, dir);
        if (p > 0.0f)
            by->moments[pixel] += value * value / (double)p / (double)q;
    }
}

static void add_moments(void *user, const tile *t)
{
    const moments_job *job = user;
    const int width = job->trial->width, height = job->trial->height;
    const uint32_t samples = job->trial->samples;
    uint32_t i;
    int x, y;

    for (y = t->top; y < t->bottom; y++)
        for (x = t->left; x < t->right; x++)
            for (i = 0; i < samples; i++) {
                const numbers n = numbers_make(1, hash_combine(99, (uint32_t)(y * width + x)), i);
                float u[2], choice[2], from[3], dir[3], eye[3], axis[3];
                scene_hit hit;

                numbers_pair(&n, NUMBERS_PIXEL, 0, u);
                scene_ray(job->scene, ((float)x + u[0]) / (float)width,
                          ((float)y + u[1]) / (float)height, (float)width / (float)height, from,
                          dir);
                if (!scene_closest(job->scene, from, dir, &hit))
                    continue;
                vec_negate(dir, dir);
                vec_into(&hit.basis, dir, eye);
                material_axis(hit.material, eye, dir);
                vec_out_of(&hit.basis, dir, axis);
                numbers_pair(&n, NUMBERS_LIGHT, 1, u);
                numbers_pair(&n, NUMBERS_ROULETTE, 1, choice);
                add_point(job, y * width + x, &hit, eye, axis, u, choice[0]);
            }
}

/* Into subjects' moments, of a sample. */
static int find_moments(trial *t, const scene *s, const environment *e, const subject *reference)
{
    const size_t pixels = (size_t)t->width * (size_t)t->height;
    method methods[METHODS_MAX], known;
    moments_job job;
    size_t k;
    int i, ok = open_method(&known, reference, e), count = 0;

    for (i = 0; i < t->count && ok; i++, count++) {
        memset(t->subjects[i].moments, 0, pixels * sizeof(double));
        ok = open_method(&methods[i], &t->subjects[i], e);
    }
    job.scene = s;
    job.environment = e;
    job.reference = &known;
    job.methods = methods;
    job.trial = t;
    if (ok)
        tiles_run(t->width, t->height, t->threads, add_moments, &job, NULL);
    for (i = 0; i < count; i++) {
        for (k = 0; k < pixels; k++)
            t->subjects[i].moments[k] /= t->samples;
        method_close(&methods[i]);
    }
    method_close(&known);
    return ok;
}

/* ---- comparison ---- */

/* The mean of a rectangle, and the variance of that mean. */
static void measure(const measured *m, const tile *at, double *mean, double *variance)
{
    const double n = REPLICATES;
    double sum = 0.0, squares = 0.0, pixels = 0.0;
    int x, y;

    for (y = at->top; y < at->bottom; y++)
        for (x = at->left; x < at->right; x++) {
            const int i = y * m->width + x;
            const double one = m->sum[i] / n;

            sum += one;
            squares += fmax(m->squares[i] / n - one * one, 0.0) / (n - 1.0);
            pixels += 1.0;
        }
    *mean = sum / pixels;
    *variance = squares / (pixels * pixels);
}

/* Whether the error that independent numbers would have is small enough. */
static int is_judged(const trial *t, const subject *by, const tile *at, double known)
{
    double moments = 0.0, pixels = 0.0;
    int x, y;

    for (y = at->top; y < at->bottom; y++)
        for (x = at->left; x < at->right; x++) {
            moments += by->moments[y * t->width + x];
            pixels += 1.0;
        }
    return sqrt(moments / t->samples) / pixels <= WORST_ERROR * known;
}

/* The difference of two means in standard errors of it; rounding is not one. */
static double compare(const measured *m, const measured *reference, const tile *at,
                      double *relative, double *error)
{
    double mean, variance, known, known_variance, most;

    measure(m, at, &mean, &variance);
    measure(reference, at, &known, &known_variance);
    most = sqrt(variance + known_variance) + 1e-5 * known;
    *relative = known > 0.0 ? mean / known - 1.0 : 0.0;
    *error = known > 0.0 ? most / known : 1.0;
    return most > 0.0 ? (mean - known) / most : 0.0;
}

/* How far a picture and its tiles are off. */
typedef struct verdict {
    double worst_tile, picture, relative, error;
    int tiles, judged, picture_judged;
} verdict;

static verdict judge(const trial *t, const subject *by, const measured *m,
                     const measured *reference)
{
    verdict v = {0.0, 0.0, 0.0, 1.0, 0, 0, 0};
    tile at = {0, 0, 0, 0};
    double mean, variance;

    for (at.top = 0; at.top < m->height; at.top += TILE_SIDE)
        for (at.left = 0; at.left < m->width; at.left += TILE_SIDE) {
            at.right = at.left + TILE_SIDE < m->width ? at.left + TILE_SIDE : m->width;
            at.bottom = at.top + TILE_SIDE < m->height ? at.top + TILE_SIDE : m->height;
            measure(reference, &at, &mean, &variance);
            v.tiles++;
            if (!is_judged(t, by, &at, mean))
                continue;
            v.judged++;
            v.worst_tile = fmax(v.worst_tile,
                                fabs(compare(m, reference, &at, &v.relative, &v.error)));
        }
    at.left = at.top = 0;
    at.right = m->width;
    at.bottom = m->height;
    measure(reference, &at, &mean, &variance);
    v.picture_judged = is_judged(t, by, &at, mean);
    if (v.picture_judged)
        v.picture = fabs(compare(m, reference, &at, &v.relative, &v.error));
    return v;
}

/* The mean of all pictures is of the first tries, whatever the second ones give. */
static void count_picture(subject *by, const verdict *v)
{
    by->tiles += v->tiles;
    by->judged += v->judged;
    if (!v->picture_judged)
        return;
    by->sum += v->relative / (v->error * v->error);
    by->weight += 1.0 / (v->error * v->error);
    by->pictures++;
}

/* ---- all ---- */

/* What a trial of one scene and map works with. */
typedef struct corner {
    const scene *scene;
    const environment *environment;
    int bounces;
    uint32_t seed;
    subject reference;
    measured known, found;           /* of the reference, and of a method */
} corner;

static int render_known(const trial *t, corner *c, uint32_t times, uint32_t seed)
{
    return render(t, c->scene, c->environment, &c->reference, c->bounces,
                  times * REFERENCE_TIMES * t->samples, seed, &c->known);
}

static int render_found(const trial *t, corner *c, const subject *by, uint32_t times,
                        uint32_t seed)
{
    return render(t, c->scene, c->environment, by, c->bounces, times * t->samples, seed,
                  &c->found);
}

/* Methods that were off; their references are rendered once for all of them. */
static int try_again(trial *t, corner *c, const int *off)
{
    const uint32_t seed = c->seed + 500u;
    int i, ok = render_known(t, c, AGAIN_TIMES, seed);

    for (i = 0; i < t->count && ok; i++) {
        subject *by = &t->subjects[i];
        verdict v;

        if (!off[i])
            continue;
        ok = render_found(t, c, by, AGAIN_TIMES, seed + 1u + (uint32_t)i);
        if (!ok)
            break;
        v = judge(t, by, &c->found, &c->known);
        by->again++;
        by->worst_tile = fmax(by->worst_tile, v.worst_tile);
        by->worst_picture = fmax(by->worst_picture, v.picture);
    }
    return ok;
}

/* Every method; at more than one bounce those whose spread will do. */
static int try_methods(trial *t, corner *c)
{
    int i, ok = render_known(t, c, 1, c->seed), off[METHODS_MAX] = {0}, any = 0;

    for (i = 0; i < t->count && ok; i++) {
        subject *by = &t->subjects[i];
        verdict v;

        if (c->bounces > 1 && (has_moments(by) || by->product))
            continue;
        ok = render_found(t, c, by, 1, c->seed + 1u + (uint32_t)i);
        if (!ok)
            break;
        v = judge(t, by, &c->found, &c->known);
        count_picture(by, &v);
        off[i] = !by->wrong && (v.worst_tile >= MOST || v.picture >= MOST);
        any = any || off[i];
        if (off[i])
            continue;
        by->worst_tile = fmax(by->worst_tile, v.worst_tile);
        by->worst_picture = fmax(by->worst_picture, v.picture);
    }
    return ok && (!any || try_again(t, c, off));
}

static int try_scene(trial *t, const char *name, const environment *e, int bounces, uint32_t seed)
{
    char error[256];
    scene *s = scene_open(name, error, sizeof error);
    corner c;
    int ok;

    memset(&c, 0, sizeof c);
    c.scene = s;
    c.environment = e;
    c.bounces = bounces;
    c.seed = seed;
    c.reference.by = find_sampler("inversion");
    c.reference.mis = 1;
    ok = s && measured_make(&c.known, t->width, t->height)
      && measured_make(&c.found, t->width, t->height) && find_moments(t, s, e, &c.reference)
      && try_methods(t, &c);
    free(c.known.sum);
    free(c.found.sum);
    scene_close(s);
    return ok;
}

static void report(const subject *by)
{
    const double error = sqrt(1.0 / by->weight), mean = by->sum / by->weight;
    const int enough = by->judged >= LEAST_JUDGED * by->tiles && by->pictures;
    const int all = fabs(mean) < MOST * error;

    if (by->wrong)
        CHECK(enough && !all, "%s is rejected: all %+.3f %%, error %.3f %%", by->name,
              100.0 * mean, 100.0 * error);
    else
        CHECK(enough && all && by->worst_tile < MOST && by->worst_picture < MOST,
              "%s: %d pictures, %d of %d tiles judged, worst tile %.2f, worst picture %.2f "
              "standard errors, %d tried again; all %+.3f %%, error %.3f %%", by->name,
              by->pictures, by->judged, by->tiles, by->worst_tile, by->worst_picture, by->again,
              100.0 * mean, 100.0 * error);
}

static int try_maps(trial *t)
{
    int i, k, ok = 1;

    for (k = 0; k < MAPS && ok; k++) {
        environment e;
        image map;

        ok = map_make(maps[k].name, maps[k].width, maps[k].width / 2, &map);
        if (!ok)
            break;
        environment_make(&e, &map, ROTATE);
        for (i = 0; scene_list[i].name && ok; i++)
            ok = try_scene(t, scene_list[i].name, &e, 1, 1000u * (uint32_t)(10 * k + i));
        ok = ok && try_scene(t, "metal", &e, 5, 1000u * (uint32_t)(10 * k + 9));
        image_free(&map);
    }
    return ok;
}

/* ---- directional lights ---- */

#define LIGHTS 128
#define LIGHTS_MOST 0.03             /* relative error of a tile */

/* The largest relative error of a tile. */
static double lights_error(const trial *t, lights_job *job, const environment *e,
                           const measured *known, image *out)
{
    measured found = {0, 0, NULL, NULL};
    double worst = 0.0, relative, error;
    tile at = {0, 0, 0, 0};
    int i;

    job->environment = e;
    if (!lights_render(job, out) || !measured_make(&found, t->width, t->height))
        return -1.0;
    for (i = 0; i < t->width * t->height; i++)
        found.sum[i] = REPLICATES * (double)envsamp_luminance(out->rgb + 3 * i);
    for (at.top = 0; at.top < t->height; at.top += TILE_SIDE)
        for (at.left = 0; at.left < t->width; at.left += TILE_SIDE) {
            at.right = at.left + TILE_SIDE < t->width ? at.left + TILE_SIDE : t->width;
            at.bottom = at.top + TILE_SIDE < t->height ? at.top + TILE_SIDE : t->height;
            compare(&found, known, &at, &relative, &error);
            worst = fmax(worst, fabs(relative));
        }
    free(found.sum);
    return worst;
}

static void report_lights(const trial *t, lights_job *job, const environment *e,
                          const measured *known, image *out)
{
    environment other;
    double error;

    error = lights_error(t, job, e, known, out);
    CHECK(error >= 0.0 && error < LIGHTS_MOST, "%d lights: worst tile off by %.2f %%", LIGHTS,
          100.0 * error);
    job->sets = LIGHTS_SETS;
    job->reduce = 2;
    error = lights_error(t, job, e, known, out);
    CHECK(error >= 0.0 && error < LIGHTS_MOST, "interleaved and reduced: by %.2f %%",
          100.0 * error);
    environment_make(&other, e->map, ROTATE + 180.0f);
    error = lights_error(t, job, &other, known, out);
    CHECK(error > LIGHTS_MOST, "of a map that is turned otherwise: by %.2f %%", 100.0 * error);
}

static void test_lights(const trial *t)
{
    image map = {0, 0, NULL}, out = {0, 0, NULL};
    light_list list = {NULL, 0};
    char error[256] = "";
    environment e;
    lights_job job;
    corner c;
    scene *s = scene_open("vase", error, sizeof error);
    int ok;

    memset(&c, 0, sizeof c);
    memset(&job, 0, sizeof job);
    ok = s && map_make("sky", 128, 64, &map) && image_alloc(&out, t->width, t->height)
      && measured_make(&c.known, t->width, t->height);
    if (ok) {
        environment_make(&e, &map, ROTATE);
        c.scene = job.scene = s;
        c.environment = &e;
        c.bounces = 1;
        c.reference.by = find_sampler("inversion");
        c.reference.mis = 1;
        ok = render_known(t, &c, 1, 77)
          && lights_make(&list, "relaxed", LIGHTS, 1, &e, error, sizeof error);
    }
    CHECK(ok, "lights are made%s", error);
    if (ok) {
        lights_mark(&list, LIGHTS_LAMP);
        job.list = &list;
        job.sets = job.reduce = 1;
        job.side = 2;
        job.threads = t->threads;
        report_lights(t, &job, &e, &c.known, &out);
    }
    lights_free(&list);
    scene_close(s);
    free(c.known.sum);
    image_free(&out);
    image_free(&map);
}

int main(int argc, char **argv)
{
    static trial t;
    int i = 1, ok = 1;

    t.threads = 2;
    t.samples = 64;
    t.width = 48;
    t.height = 32;
    if (argc > 2 && !strcmp(argv[1], "-t")) {
        t.threads = atoi(argv[2]);
        i = 3;
    }
    if (i < argc)
        t.samples = (uint32_t)atoi(argv[i]);
    if (i + 2 < argc) {
        t.width = atoi(argv[i + 1]);
        t.height = atoi(argv[i + 2]);
    }
    make_wrong(&t);
    add_subjects(&t);
    for (i = 0; i < t.count; i++) {
        t.subjects[i].moments = calloc((size_t)t.width * (size_t)t.height, sizeof(double));
        ok = ok && t.subjects[i].moments;
    }
    ok = ok && try_maps(&t);
    CHECK(ok, "all pictures are rendered, %u samples a pixel", (unsigned)t.samples);
    for (i = 0; i < t.count; i++) {
        if (ok)
            report(&t.subjects[i]);
        free(t.subjects[i].moments);
    }
    test_lights(&t);
    return check_done();
}
