/* product.c: see product.h. */
#include "product.h"
#include "vector.h"

#include <stdlib.h>
#include <string.h>

#define SIDE 32                      /* of an importance map; then 64, 128 and 256 */
#define TEXELS (SIDE * SIDE)
#define LEVELS 4
#define FINE (SIDE << (LEVELS - 1))
#define SCRATCH_DOUBLES 2048

#define LIGHT_SHARE 0.01f            /* of the mean of the map, added to all of it */
#define BRDF_SHARE 0.02f             /* of a white diffuse surface */
#define VISIBLE_SHARE 0.03f          /* that proxies always leave */

/* A part of the sphere: its mean luminance, where that comes from on average, and how far from
   there its corners are. */
typedef struct node { float luminance, dir[3], reach; } node;

/* Nodes of a level are blocks of 2 x 2 of the next; equal-area octahedral. */
struct product {
    node *levels[LEVELS];
    int hilbert[TEXELS];             /* texel y * SIDE + x of each step of the curve */
    float middles[TEXELS][3];        /* of the first level */
    float reach;                     /* radians from these to the farthest of all corners */
};

/* ---- the light ---- */

static void part_dir(float x, float y, int side, float dir[3])
{
    envsamp_uv_to_dir(ENVSAMP_OCTAHEDRAL, x / (float)side, y / (float)side, dir);
}

static float part_reach(int x, int y, int side, const float from[3])
{
    float reach = 0.0f;
    int i;

    for (i = 0; i < 4; i++) {
        float corner[3], chord[3];

        part_dir((float)(x + i % 2), (float)(y + i / 2), side, corner);
        vec_sub(corner, from, chord);
        reach = fmaxf(reach, sqrtf(vec_dot(chord, chord)));
    }
    return reach;
}

/* The mean of lookups that are closer together than texels. */
static void fill_finest(node *to, const environment *e, int x, int y)
{
    const int parts = 2 + (int)(0.009f * (float)e->map->height);
    float sum[3] = {0.0f, 0.0f, 0.0f};
    int i;

    for (i = 0; i < parts * parts; i++) {
        float dir[3], rgb[3], luminance;

        part_dir((float)x + ((float)(i % parts) + 0.5f) / (float)parts,
                 (float)y + ((float)(i / parts) + 0.5f) / (float)parts, FINE, dir);
        environment_radiance(e, dir, rgb);
        luminance = envsamp_luminance(rgb);
        vec_along(sum, luminance, dir, sum);
        to->luminance += luminance / (float)(parts * parts);
    }
    vec_copy(sum, to->dir);
}

static void fill_from(node *to, const node *parts, int x, int y, int side)
{
    int i;

    for (i = 0; i < 4; i++) {
        const node *from = &parts[(2 * y + i / 2) * 2 * side + 2 * x + i % 2];

        to->luminance += 0.25f * from->luminance;
        vec_along(to->dir, from->luminance, from->dir, to->dir);
    }
}

static void finish_node(node *to, int x, int y, int side)
{
    if (vec_dot(to->dir, to->dir) > 0.0f)
        vec_normalize(to->dir);
    else
        part_dir((float)x + 0.5f, (float)y + 0.5f, side, to->dir);
    to->reach = part_reach(x, y, side, to->dir);
}

static void fill_levels(product *p, const environment *e)
{
    float least = 0.0f;
    int level, i, side;

    for (level = LEVELS - 1; level >= 0; level--) {
        side = SIDE << level;
        for (i = 0; i < side * side; i++) {
            if (level == LEVELS - 1)
                fill_finest(&p->levels[level][i], e, i % side, i / side);
            else
                fill_from(&p->levels[level][i], p->levels[level + 1], i % side, i / side, side);
            finish_node(&p->levels[level][i], i % side, i / side, side);
        }
    }
    for (i = 0; i < TEXELS; i++)
        least += LIGHT_SHARE * p->levels[0][i].luminance / TEXELS;
    for (level = 0; level < LEVELS; level++)
        for (i = 0; i < TEXELS << (2 * level); i++)
            p->levels[level][i].luminance += least;
}

/* Hilbert's curve through a square whose side is a power of two: neighbours of the row in which
   error is diffused are neighbours in the map. */
static int hilbert_texel(int step)
{
    int x = 0, y = 0, side;

    for (side = 1; side < SIDE; side *= 2, step /= 4) {
        const int right = step / 2 % 2, below = (step ^ right) % 2, old = x;

        if (!below) {
            x = right ? side - 1 - y : y;
            y = right ? side - 1 - old : old;
        }
        x += side * right;
        y += side * below;
    }
    return y * SIDE + x;
}

product *product_make(const environment *e)
{
    const size_t nodes = (size_t)FINE * FINE * 4 / 3;
    product *p = calloc(1, sizeof *p + nodes * sizeof(node));
    node *next;
    int i;

    if (!p)
        return NULL;
    next = (node *)(void *)(p + 1);
    for (i = 0; i < LEVELS; i++) {
        p->levels[i] = next;
        next += TEXELS << (2 * i);
    }
    fill_levels(p, e);
    for (i = 0; i < TEXELS; i++) {
        p->hilbert[i] = hilbert_texel(i);
        part_dir((float)(i % SIDE) + 0.5f, (float)(i / SIDE) + 0.5f, SIDE, p->middles[i]);
        p->reach = fmaxf(p->reach, part_reach(i % SIDE, i / SIDE, SIDE, p->middles[i]));
    }
    p->reach = 2.0f * asinf(0.5f * p->reach);
    return p;
}

void product_free(product *p)
{
    free(p);
}

/* ---- importance of a point ---- */

typedef struct product_point {
    scene_hit hit;
    float eye[3];                    /* in the frame of the point */
    material rough[LEVELS];          /* of the point, as rough as parts of a level are wide */
} product_point;

static void make_point(product_point *p, const float dir[3])
{
    float back[3];
    int level, k;

    vec_negate(dir, back);
    vec_into(&p->hit.basis, back, p->eye);
    for (level = 0; level < LEVELS; level++) {
        const float width = sqrtf(4.0f * VEC_PI) / (float)(SIDE << level);

        p->rough[level] = *p->hit.material;
        for (k = 0; k < 2; k++) {
            float *alpha = &p->rough[level].alpha[k];

            *alpha = sqrtf(*alpha * *alpha + 0.25f * width * width);
        }
    }
}

/* BRDF x cosine of a part. One that the horizon passes through must not be lost when its middle is
   below: the cosine is the mean of max(0, c + t), with t even in [-reach, reach], and zero only if
   all corners are below. */
static float reflected(const product_point *p, const node *part, int level)
{
    float local[3], f[3], cosine, above;

    vec_into(&p->hit.basis, part->dir, local);
    above = local[2] + part->reach;
    if (above <= 0.0f)
        return 0.0f;
    cosine = local[2] >= part->reach ? local[2] : 0.25f * above * above / part->reach;
    local[2] = fmaxf(local[2], 0.25f * above);
    vec_normalize(local);
    material_eval(&p->rough[level], p->eye, local, f);
    return cosine * (envsamp_luminance(f) / local[2] + BRDF_SHARE / VEC_PI);
}

static float importance(const product_point *p, const node *part, int level)
{
    return part->luminance * reflected(p, part, level);
}

/* A proxy as a point sees it: between two cosines of the angle to its middle, a part passes from
   hidden to free. */
typedef struct shield { float dir[3], hidden, free; } shield;

static int make_shields(const product_job *job, const float at[3], shield shields[PROXIES_MAX])
{
    const scene_proxy *proxies;
    const int all = scene_proxies(job->scene, &proxies);
    const float reach = job->product->reach;
    int i, count = 0;

    for (i = 0; i < all; i++) {
        shield *s = &shields[count];
        float distance, angle;

        vec_sub(proxies[i].centre, at, s->dir);
        distance = sqrtf(vec_dot(s->dir, s->dir));
        if (distance <= proxies[i].radius)
            continue;
        angle = asinf(proxies[i].radius / distance);
        if (angle <= reach)
            continue;                /* too small to hide a part */
        vec_normalize(s->dir);
        s->hidden = cosf(angle - reach);
        s->free = cosf(angle + reach);
        count++;
    }
    return count;
}

static float visible_share(const shield *shields, int count, const float dir[3])
{
    float share = 1.0f;
    int i;

    for (i = 0; i < count; i++) {
        const float cosine = vec_dot(shields[i].dir, dir);

        if (cosine >= shields[i].hidden)
            return VISIBLE_SHARE;
        if (cosine > shields[i].free)
            share *= (shields[i].hidden - cosine) / (shields[i].hidden - shields[i].free);
    }
    return fmaxf(share, VISIBLE_SHARE);
}

/* In the order of the curve. */
static void importance_row(const product_job *job, const product_point *p, float row[TEXELS])
{
    shield shields[PROXIES_MAX];
    const int count = job->triple ? make_shields(job, p->hit.at, shields) : 0;
    int i;

    for (i = 0; i < TEXELS; i++) {
        const int texel = job->product->hilbert[i];

        row[i] = importance(p, &job->product->levels[0][texel], 0);
        if (count && row[i] > 0.0f)
            row[i] *= visible_share(shields, count, job->product->middles[texel]);
    }
}

/* ---- rays of a point ---- */

/* Takes the first part of two or the second, with the share of the first, and makes a new random
   number of what is left of u. Returns the probability of what was taken. */
static float split(float share, float *u, int *second)
{
    *second = *u >= share;
    *u = fminf(*second ? (*u - share) / (1.0f - share) : *u / share, 0.99999994f);
    return *second ? 1.0f - share : share;
}

/* Draws a direction within a texel of the importance map: down the chain, at each level one of four
   parts. Returns its density over that of the whole texel; 0 where there is nothing. */
static float draw_within(const product *light, const product_point *p, int texel,
                         const float jitter[2], float dir[3])
{
    float u = jitter[0], v = jitter[1], density = 1.0f;
    int level, right, below, x = texel % SIDE, y = texel / SIDE;

    for (level = 1; level < LEVELS; level++) {
        const int side = SIDE << level;
        const node *part = &light->levels[level][2 * y * side + 2 * x];
        const float w[4] = {importance(p, part, level), importance(p, part + 1, level),
                            importance(p, part + side, level),
                            importance(p, part + side + 1, level)};
        const float upper = w[0] + w[1], lower = w[2] + w[3];

        if (!(upper + lower > 0.0f))
            return 0.0f;
        density *= 4.0f * split(upper / (upper + lower), &v, &below);
        density *= split(w[2 * below] / (below ? lower : upper), &u, &right);
        x = 2 * x + right;
        y = 2 * y + below;
    }
    part_dir((float)x + u, (float)y + v, FINE, dir);
    return density;
}

static void add_ray(const product_job *job, product_point *p, const float dir[3], float pdf,
                    float rgb[3])
{
    float local[3], f[3], radiance[3];
    int i;

    vec_into(&p->hit.basis, dir, local);
    if (!(pdf > 0.0f) || vec_dot(p->hit.flat, dir) <= 0.0f)
        return;
    material_eval(p->hit.material, p->eye, local, f);
    if (!(f[0] + f[1] + f[2] > 0.0f) || scene_occluded(job->scene, p->hit.at, dir))
        return;
    environment_radiance(job->environment, dir, radiance);
    for (i = 0; i < 3; i++)
        rgb[i] += f[i] * radiance[i] / ((float)job->rays * pdf);
}

/* With a random error at the start, a texel of probability P is chosen M P times on average; it may
   be chosen more than once. */
static void shade_point(const product_job *job, product_point *p, uint32_t seed, float rgb[3])
{
    const envsamp_halftone_desc desc = {job->rays, ENVSAMP_KERNEL_SZIRMAY, seed | 1u,
                                        ENVSAMP_SCAN_CELLS, 0};
    double scratch[SCRATCH_DOUBLES];
    envsamp_texel chosen[PRODUCT_RAYS_MAX];
    envsamp_buffer memory;
    float row[TEXELS];
    int i, count = 0;

    memory.data = scratch;
    memory.bytes = sizeof scratch;
    importance_row(job, p, row);
    envsamp_halftone(row, TEXELS, 1, 0, &desc, chosen, job->rays, &count, memory);
    for (i = 0; i < count; i++) {
        float jitter[2], dir[3], density;

        sobol_owen((uint32_t)i, hash_combine(seed, 1), jitter);
        density = draw_within(job->product, p, job->product->hilbert[chosen[i].x], jitter, dir);
        if (density > 0.0f)
            add_ray(job, p, dir, density * chosen[i].probability * TEXELS / (4.0f * VEC_PI), rgb);
    }
}

/* ---- pictures ---- */

static void shade_sample(const void *user, const film *f, int x, int y, uint32_t sample,
                         float rgb[3])
{
    const product_job *job = user;
    float from[3], dir[3];
    const numbers n = pixel_ray(job->scene, f, x, y, job->side, 0, job->seed, sample, from, dir);
    product_point p;

    if (scene_closest(job->scene, from, dir, &p.hit)) {
        make_point(&p, dir);
        shade_point(job, &p, hash_combine(n.seed, 0x10000u + n.sample), rgb);
    } else {
        environment_radiance(job->environment, dir, rgb);
    }
}

void product_samples(const product_job *job, film *f, uint32_t count)
{
    film_run(f, count, job->threads, shade_sample, job, job->progress);
}
