/* product_gallery.c: product sampling: 32 rays for every pixel, chosen for it by error diffusion
 * over light x BRDF x cosine, beside BRDF sampling and sampling-importance resampling at as many
 * rays.
 *
 *     product_gallery [-q] [-o FOLDER] [MAP]
 *
 * MAP is a lat-long HDR or PFM file or a name of maps.h; the default is sky, whose sun fills 14 of
 * 65536 texels with 84 % of the light: what BRDFs hardly ever hit, of another colour than the rest.
 * Prints errors, biases and times, and draws FOLDER/product.png (build/pictures). -q is a test: a
 * small picture without the file, and status 1 unless, where nothing is in the way of the light,
 * halftoned samples have at most a third of the error of BRDF sampling, half of that of resampling.
 *
 * How it is done [Szirmay-Kalos, Szecsi, Penzov: Environment Mapping with Floyd-Steinberg
 * Halftoning, 2010, section 1.3.3]. What a point reflects of the map, and its estimate, are
 *
 *     L = integral of L_env(w) f_r(w) cos(w) V(w) dw  =~  1/M sum of L_env f_r cos V (w_i) / p(w_i)
 *
 * with a ray traced for each V. For every point an importance map I of 32 x 32 texels is made:
 * light x BRDF x cosine, the double product, or also x V~, a cheap visibility by spheres inside of
 * the objects, the triple product. envsamp_halftone chooses M = 32 of its texels, and in each a
 * direction is drawn: p is the texel's probability I / sum I, over its solid angle, times the
 * density within it. What makes it work:
 *
 * - Texels of the map are blocks of a mip chain of the light, the dome of product_scene.h, so that
 *   no sun slips through between them; and within a texel the chain is walked down by light x BRDF
 *   x cosine. With even draws there the errors are 11 and 12 times as large.
 * - I is above zero wherever the integrand is: node_reflected.
 * - The map is handed over as one row, in the order of Hilbert's curve, with a random error at the
 *   start, and texels may repeat: shade_product, choose.
 *
 * Errors are of red, green and blue. I follows luminance; where all of the light is visible nothing
 * is left to err about but colours, and halftoning deals these out evenly. Where some is blocked it
 * does the same for visibility.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "../examples/common/folder.h"
#include "../examples/common/maps.h"
#include "../examples/common/picture.h"
#include "../examples/common/product_scene.h"
#include "../examples/common/progress.h"
#include "../examples/common/random.h"

#include <float.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define RAYS 32                      /* M: traced for a pixel, by every method */
#define SIDE DOME_SIDE               /* of an importance map */
#define TEXELS DOME_TEXELS

/* ---- importance ------------------------------------------------------------------------------ */

/* BRDF x cosine of a texel. What a diffuse surface shows of light from many directions it shows of
   their mean, weighted by the light: that is where the texel is looked at. Texels that the point's
   horizon passes through must not be lost when just their middle is below it, or their light is: so
   the cosine is the mean of max(0, c + t), with t even in [-reach, reach]. It is zero only if all
   corners are below. */
static float node_reflected(const node *t, const scene_point *p)
{
    const float c = dot3(p->normal, t->dir), above = c + t->reach;
    const float cosine = c >= t->reach ? c : 0.25f * above * above / t->reach;

    return above > 0.0f ? cosine * scene_brdf(p, t->dir) : 0.0f;
}

static float node_importance(const node *t, const scene_point *p)
{
    return t->luminance > 0.0f ? t->luminance * node_reflected(t, p) : 0.0f;
}

/* The map of a point, row by row: the double product, or with proxies the triple product. */
static void importance_map(const dome *d, const scene_point *p, int triple, float map[TEXELS])
{
    scene_proxy proxies[SCENE_SPHERES];
    const int count = triple ? scene_proxies(p, d->reach, proxies) : 0;
    int i;

    for (i = 0; i < TEXELS; i++) {
        map[i] = node_importance(&d->level[0][i], p);
        if (count > 0 && map[i] > 0.0f)
            map[i] *= scene_free_share(proxies, count, d->middle[i]);
    }
}

/* Takes the first part of two or the second, with the share of the first, and makes a new random
   number of what is left of u. Returns the probability of what was taken. */
static float split(float share, float *u, int *second)
{
    *second = *u >= share;
    *u = *second ? (*u - share) / (1.0f - share) : *u / share;
    *u = fminf(*u, DOME_BELOW_ONE);
    return *second ? 1.0f - share : share;
}

/* Draws a direction within texel (x, y) of an importance map: down the mip chain, at each level one
   of four parts by light x BRDF x cosine. Returns its density over that of the whole texel, or 0
   where there is nothing after all, and its finest texel. */
static float draw_within(const dome *d, const scene_point *p, int x, int y, const float jitter[2],
                         float dir[3], int *texel)
{
    float u = jitter[0], v = jitter[1], density = 1.0f;
    int level, right, below;

    for (level = 1; level < DOME_LEVELS; level++) {
        const int side = SIDE << level;
        const node *part = &d->level[level][2 * y * side + 2 * x];
        const float w[4] = {node_importance(part, p), node_importance(part + 1, p),
                            node_importance(part + side, p), node_importance(part + side + 1, p)};
        const float upper = w[0] + w[1], lower = w[2] + w[3];

        if (!(upper + lower > 0.0f)) {
            memcpy(dir, part->dir, sizeof part->dir);
            return 0.0f;
        }
        density *= 4.0f * split(upper / (upper + lower), &v, &below);
        density *= split(w[2 * below] / (below ? lower : upper), &u, &right);
        x = 2 * x + right;
        y = 2 * y + below;
    }
    *texel = y * DOME_FINE + x;
    dome_dir(((float)x + u) / DOME_FINE, ((float)y + v) / DOME_FINE, dir);
    return density;
}

/* ---- choosing rays --------------------------------------------------------------------------- */

enum { BRDF, SIR_BRDF, SIR_LIGHT, SIR_MAP, DOUBLE, TRIPLE, WAYS };

static const char *const way_names[WAYS] = {
    "BRDF sampling", "SIR of 1024 by the BRDF", "SIR of 1024 by the light",
    "SIR of the importance map", "double product, halftoned", "triple product, halftoned"
};

static const envsamp_halftone_desc halftone_desc = {
    RAYS, ENVSAMP_KERNEL_SZIRMAY, 0, ENVSAMP_SCAN_CELLS, 0
};

/* What it takes to shade. */
typedef struct shading {
    dome *dome;
    double cdf[DOME_FINE * DOME_FINE];         /* of the light, for candidates of SIR */
    int hilbert[TEXELS];             /* texel y * SIDE + x of each step of the curve */
    envsamp_buffer scratch;
    envsamp_texel chosen[RAYS];
    float rays[RAYS][3];             /* of the last point, for the picture */
    int ray_count;
} shading;

/* Hilbert's curve through the texels of a square whose side is a power of two: the bits of a step
   name quarters, and each quarter is mirrored or turned so that ends meet. */
static int hilbert_texel(int step)
{
    int x = 0, y = 0, side;

    for (side = 1; side < SIDE; side *= 2, step /= 4) {
        const int right = step / 2 % 2, below = (step ^ right) % 2;

        if (!below) {
            const int old = x;

            x = right ? side - 1 - y : y;
            y = right ? side - 1 - old : old;
        }
        x += side * right;
        y += side * below;
    }
    return y * SIDE + x;
}

/* Chooses RAYS entries of a row of importance. Any may be chosen more than once: with `once` a
   sun leaves to its neighbours what it has beyond an M-th of all, and samples over M p are biased.
   A seed of its own for every pixel makes errors noise; one for all makes bands. */
static int choose(shading *s, const float row[TEXELS], envsamp_kernel kernel, uint32_t seed)
{
    envsamp_halftone_desc desc = halftone_desc;
    int count;

    desc.kernel = kernel;
    desc.seed = seed | 1u;           /* 0 would be no error at the start */
    envsamp_halftone(row, TEXELS, 1, 0, &desc, s->chosen, RAYS, &count, s->scratch);
    return count;                    /* 0 if all is black */
}

/* Traces a ray and adds what it brings, at density `pdf` per steradian. */
static void add_ray(shading *s, const scene_point *p, const float dir[3], int texel, float pdf,
                    float rgb[3])
{
    const float reflected = scene_reflected(p, dir);
    int i;

    memcpy(s->rays[s->ray_count++], dir, sizeof s->rays[0]);
    if (reflected > 0.0f && pdf > 0.0f && scene_visible(p, dir))
        for (i = 0; i < 3; i++)
            rgb[i] += s->dome->fine[texel].rgb[i] * reflected / (RAYS * pdf);
}

/* The double or the triple product; or SIR, whose choice is independent of what it has chosen. In
   Hilbert's order neighbours of the row are neighbours in the map. All of an error goes ahead, the
   extreme case of section 1.3.1 and the best one for so few samples; with a random start a texel is
   then chosen M p times in expectation, exactly. Scanned as published (ENVSAMP_SCAN_TEXELS) it is
   not: a texel that is all but black may be the first one after an error from above, of which its
   weight, 1 / (M p), knows nothing. */
static void shade_product(shading *s, const scene_point *p, int way, uint32_t seed, float rgb[3])
{
    const envsamp_kernel kernel = way == SIR_MAP ? ENVSAMP_KERNEL_RANDOM : halftone_desc.kernel;
    float map[TEXELS], row[TEXELS], jitter[2], dir[3], density;
    int i, count, texel = 0;

    importance_map(s->dome, p, way == TRIPLE, map);
    for (i = 0; i < TEXELS; i++)
        row[i] = map[s->hilbert[i]];
    count = choose(s, row, kernel, seed);
    for (i = 0; i < count; i++) {
        const int at = s->hilbert[s->chosen[i].x];

        sobol_owen((uint32_t)i, hash_combine(seed, 1), jitter);
        density = draw_within(s->dome, p, at % SIDE, at / SIDE, jitter, dir, &texel);
        density *= s->chosen[i].probability * TEXELS / (2.0f * LIGHT_PI);
        add_ray(s, p, dir, texel, density, rgb);
    }
}

/* ---- the competitors ------------------------------------------------------------------------- */

static void shade_brdf(shading *s, const scene_point *p, uint32_t seed, float rgb[3])
{
    float u[2], dir[3];
    uint32_t i;

    for (i = 0; i < RAYS; i++) {
        sobol_owen(i, seed, u);
        scene_draw(p, u, dir);
        if (dir[2] > 0.0f)
            add_ray(s, p, dir, dome_texel(dir), scene_pdf(p, dir), rgb);
    }
}

typedef struct candidate { float dir[3], pdf; int texel; } candidate;

/* Draws from the dome's light, exactly. */
static void draw_light(const shading *s, double u, const float jitter[2], candidate *c)
{
    int low = 0, high = DOME_FINE * DOME_FINE - 1;

    while (low < high) {
        const int middle = (low + high) / 2;

        if (s->cdf[middle] > u)
            high = middle;
        else
            low = middle + 1;
    }
    c->texel = low;
    c->pdf = (float)(s->cdf[low] - (low ? s->cdf[low - 1] : 0.0)) / DOME_FINE_SR;
    dome_dir(((float)(low % DOME_FINE) + jitter[0]) / DOME_FINE,
             ((float)(low / DOME_FINE) + jitter[1]) / DOME_FINE, c->dir);
}

/* Sampling-importance resampling as in [Burke, Ghosh, Heidrich 2004; Talbot, Cline, Egbert 2005]:
   of 1024 stratified candidates by the BRDF or by the light, 32 are drawn by what they have of the
   integrand without V, over their pdf. The sum of these weights stands in for the integral. The
   draws are independent: steps of equal weight through the candidates would be error diffusion. */
static void shade_sir(shading *s, const scene_point *p, int way, uint32_t seed, float rgb[3])
{
    static candidate all[TEXELS];
    float weight[TEXELS], sum = 0.0f, u[2];
    pcg32 random = pcg32_make(seed, 1);
    int i, count;

    for (i = 0; i < TEXELS; i++) {
        candidate *c = &all[i];

        u[0] = ((float)(i % SIDE) + pcg32_float(&random)) / SIDE;
        u[1] = ((float)(i / SIDE) + pcg32_float(&random)) / SIDE;
        if (way == SIR_BRDF) {
            scene_draw(p, u, c->dir);
            c->pdf = scene_pdf(p, c->dir);
            c->texel = c->dir[2] > 0.0f ? dome_texel(c->dir) : 0;
        } else {
            const float jitter[2] = {pcg32_float(&random), pcg32_float(&random)};

            draw_light(s, ((double)i + (double)pcg32_float(&random)) / TEXELS, jitter, c);
        }
        weight[i] = c->pdf > 0.0f && c->dir[2] > 0.0f
                  ? s->dome->fine[c->texel].luminance * scene_reflected(p, c->dir) / c->pdf
                  : 0.0f;
        sum += weight[i];
    }
    count = sum > 0.0f ? choose(s, weight, ENVSAMP_KERNEL_RANDOM, seed) : 0;
    for (i = 0; i < count; i++) {
        const candidate *c = &all[s->chosen[i].x];

        add_ray(s, p, c->dir, c->texel, c->pdf * s->chosen[i].probability * TEXELS, rgb);
    }
}

static void shade(shading *s, const scene_point *p, int way, uint32_t seed, float rgb[3])
{
    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    s->ray_count = 0;
    if (way == BRDF)
        shade_brdf(s, p, seed, rgb);
    else if (way == SIR_BRDF || way == SIR_LIGHT)
        shade_sir(s, p, way, seed, rgb);
    else
        shade_product(s, p, way, seed, rgb);
}

/* Returns what is wrong, or NULL. */
static const char *shading_make(shading *s, const image *map)
{
    envsamp_halftone_desc independent = halftone_desc;
    envsamp_sizes sizes, other;
    double sum = 0.0;
    int i;

    independent.kernel = ENVSAMP_KERNEL_RANDOM;
    envsamp_halftone_sizes(TEXELS, 1, &halftone_desc, &sizes);
    envsamp_halftone_sizes(TEXELS, 1, &independent, &other);
    s->scratch.bytes = sizes.scratch_bytes > other.scratch_bytes ? sizes.scratch_bytes
                                                                 : other.scratch_bytes;
    s->scratch.data = malloc(s->scratch.bytes);
    s->dome = dome_make(map);
    if (!s->dome || !s->scratch.data)
        return "not enough memory";
    for (i = 0; i < TEXELS; i++)
        s->hilbert[i] = hilbert_texel(i);
    for (i = 0; i < DOME_FINE * DOME_FINE; i++)
        sum += (double)s->dome->fine[i].luminance;
    for (i = 0; i < DOME_FINE * DOME_FINE; i++)
        s->cdf[i] = (i ? s->cdf[i - 1] : 0.0) + (double)s->dome->fine[i].luminance / sum;
    return sum > 0.0 ? NULL : "has no light above the horizon";
}

/* ---- figures --------------------------------------------------------------------------------- */

enum { VISIBLE, OCCLUDED, KINDS };

#define NOTHING_BLOCKED 1e-6f        /* of the light that a point would reflect */

/* Over points and runs: squared errors, and sums of estimates and of references, all of means over
   red, green and blue. */
typedef struct tally { double squares, mean_squares, estimate, reference; long count; } tally;

typedef struct seen { scene_point point; float reference[3]; int there, kind; } seen;

typedef struct trial {
    const char *map_name;
    int width, height, runs;         /* of a picture; how often each pixel is shaded */
    seen *seen[SCENE_SURFACES];      /* of each pixel */
    float *rgb[WAYS][SCENE_SURFACES];
    tally tallies[WAYS][SCENE_SURFACES][KINDS];
    double us[WAYS];                 /* microseconds a pixel */
    progress shown;
} trial;

#define SEE_SHARE 0.65               /* of the time: the reference */

static void see(trial *t, const dome_part *parts, int part_count, int surface, int pixel)
{
    seen *s = &t->seen[surface][pixel];
    float blocked;

    s->there = scene_pixel(pixel % t->width, pixel / t->width, t->width, t->height, surface,
                           &s->point);
    if (!s->there)
        return;
    blocked = dome_reflected(parts, part_count, &s->point, s->reference);
    s->kind = blocked > NOTHING_BLOCKED ? OCCLUDED : VISIBLE;
}

static void count_error(tally *t, const float estimate[3], const float right[3])
{
    double error = 0.0;
    int i;

    for (i = 0; i < 3; i++) {
        const double e = (double)estimate[i] - (double)right[i];

        t->squares += e * e / 3.0;
        error += e / 3.0;
        t->estimate += (double)estimate[i] / 3.0;
        t->reference += (double)right[i] / 3.0;
    }
    t->mean_squares += error * error;
    t->count++;
}

/* Shades all pixels by one method, the first time for the picture; by those that are slow and not
   in the picture a quarter of them. */
static void shade_all(trial *t, shading *s, int way)
{
    const clock_t start = clock();
    const int pixels = t->width * t->height, some = way == SIR_BRDF || way == SIR_LIGHT;
    long count = 0;
    int surface, i, run;

    for (surface = 0; surface < SCENE_SURFACES; surface++)
        for (i = 0; i < pixels * t->runs; i++) {
            const int pixel = i % pixels;
            const seen *at = &t->seen[surface][pixel];
            float rgb[3];

            run = i / pixels;
            if (!at->there || (some && (pixel + pixel / t->width + run) % 4 != 0))
                continue;
            shade(s, &at->point, way, hash_combine(hash_combine(29, (uint32_t)run),
                                                   (uint32_t)pixel), rgb);
            count_error(&t->tallies[way][surface][at->kind], rgb, at->reference);
            count++;
            if (run == 0)
                memcpy(t->rgb[way][surface] + 3 * pixel, rgb, sizeof rgb);
        }
    t->us[way] = 1e6 * (double)(clock() - start) / (double)CLOCKS_PER_SEC / (double)count;
}

/* Root mean square error relative to the mean of the reference. */
static double rmse(const tally *t)
{
    return t->reference > 0.0 ? sqrt(t->squares * (double)t->count) / t->reference : 0.0;
}

static void print_errors(const trial *t)
{
    int way, surface, kind;

    printf("%s: RMSE of red, green and blue relative to the mean of the reference, %d rays\n\n"
           "%-28s%22s%24s%12s\n%-28s%11s%11s%13s%11s%12s\n", t->map_name, RAYS, "", "diffuse",
           "Ward glossy", "us a pixel", "", "visible", "occluded", "visible", "occluded", "");
    for (way = 0; way < WAYS; way++) {
        printf("%-28s", way_names[way]);
        for (surface = 0; surface < SCENE_SURFACES; surface++)
            for (kind = 0; kind < KINDS; kind++)
                printf("%*.4f", surface && !kind ? 13 : 11, rmse(&t->tallies[way][surface][kind]));
        printf("%12.1f\n", t->us[way]);
    }
    printf("%-28s", "points");
    for (surface = 0; surface < SCENE_SURFACES; surface++)
        for (kind = 0; kind < KINDS; kind++)
            printf("%*ld", surface && !kind ? 13 : 11,
                   t->tallies[0][surface][kind].count / t->runs);
    printf("\n\nvisible: nothing is in the way of any light that the point would reflect\n");
}

/* What a whole picture is off by, and by how much chance lets it. */
static void print_bias(const trial *t)
{
    int way, surface, kind;

    printf("\nmean of all pixels over that of the reference, +- its standard error\n");
    for (way = 0; way < WAYS; way++) {
        printf("%-28s", way_names[way]);
        for (surface = 0; surface < SCENE_SURFACES; surface++) {
            double squares = 0.0, estimate = 0.0, right = 0.0;

            for (kind = 0; kind < KINDS; kind++) {
                squares += t->tallies[way][surface][kind].mean_squares;
                estimate += t->tallies[way][surface][kind].estimate;
                right += t->tallies[way][surface][kind].reference;
            }
            printf("%*.4f +- %.4f", surface ? 14 : 12, estimate / right, sqrt(squares) / right);
        }
        printf("\n");
    }
}

/* Prints how the double product compares where all is visible. Returns whether it is well ahead. */
static int print_verdict(const trial *t)
{
    static const char *const names[SCENE_SURFACES] = {"diffuse", "Ward glossy"};
    int surface, way, good = 1;

    printf("\n");
    for (surface = 0; surface < SCENE_SURFACES; surface++) {
        const double error = rmse(&t->tallies[DOUBLE][surface][VISIBLE]);
        const double brdf = rmse(&t->tallies[BRDF][surface][VISIBLE]);
        double sir = rmse(&t->tallies[SIR_BRDF][surface][VISIBLE]);

        for (way = SIR_LIGHT; way <= SIR_MAP; way++)
            sir = fmin(sir, rmse(&t->tallies[way][surface][VISIBLE]));
        good = good && error <= brdf / 3.0 && error <= sir / 2.0;
        printf("%s, visible: the double product has %.4f of the error of BRDF sampling,"
               " %.2f of that of the best SIR\n", names[surface], error / brdf, error / sir);
    }
    return good;
}

/* ---- the trial ------------------------------------------------------------------------------- */

static void trial_free(trial *t)
{
    int way, surface;

    for (surface = 0; surface < SCENE_SURFACES; surface++) {
        free(t->seen[surface]);
        for (way = 0; way < WAYS; way++)
            free(t->rgb[way][surface]);
    }
}

static int trial_alloc(trial *t)
{
    const size_t pixels = (size_t)t->width * (size_t)t->height;
    int way, surface, good = 1;

    for (surface = 0; surface < SCENE_SURFACES; surface++) {
        t->seen[surface] = calloc(pixels, sizeof *t->seen[surface]);
        good = good && t->seen[surface];
        for (way = 0; way < WAYS; way++) {
            t->rgb[way][surface] = calloc(pixels, 3 * sizeof(float));
            good = good && t->rgb[way][surface];
        }
    }
    return good;
}

static int trial_run(trial *t, shading *s)
{
    dome_part *parts = malloc(DOME_PARTS * sizeof *parts);
    int surface, way, count, i;

    if (!parts)
        return 0;
    t->shown = progress_start("product_gallery");
    count = dome_parts(s->dome, parts);
    for (surface = 0; surface < SCENE_SURFACES; surface++)
        for (i = 0; i < t->width * t->height; i++) {
            progress_show(&t->shown, SEE_SHARE * (surface + (double)i / (t->width * t->height))
                                     / SCENE_SURFACES, "reference");
            see(t, parts, count, surface, i);
        }
    free(parts);
    for (way = 0; way < WAYS; way++) {
        progress_show(&t->shown, SEE_SHARE + (1.0 - SEE_SHARE) * way / WAYS, way_names[way]);
        shade_all(t, s, way);
    }
    progress_end(&t->shown);
    return 1;
}

/* ---- the picture ----------------------------------------------------------------------------- */

#define COLUMNS 5
#define GAP 6
#define LINE 20                      /* of text of scale 2 */
#define CHART 160                    /* pixels: 5 a texel */

static const int column_ways[COLUMNS] = {BRDF, SIR_MAP, DOUBLE, TRIPLE, WAYS};

static const unsigned char white[3] = {255, 255, 255}, ground[3] = {38, 40, 44};
static const unsigned char free_ray[3] = {255, 170, 0}, blocked_ray[3] = {235, 30, 70};

/* The mean of what is seen at a middle grey. */
static float exposure_of(const trial *t, int surface)
{
    const tally *tallies = t->tallies[DOUBLE][surface];
    const double sum = tallies[VISIBLE].reference + tallies[OCCLUDED].reference;
    const double count = (double)(tallies[VISIBLE].count + tallies[OCCLUDED].count);

    return sum > 0.0 ? (float)(0.3 * count / sum) : 1.0f;
}

/* Way WAYS is the reference. */
static void draw_shot(picture *canvas, int left, int top, const trial *t, int surface, int way)
{
    const float exposure = exposure_of(t, surface);
    unsigned char colour[3];
    image one = {1, 1, NULL};
    float rgb[3];
    int i;

    one.rgb = rgb;
    for (i = 0; i < t->width * t->height; i++) {
        memcpy(rgb, way == WAYS ? t->seen[surface][i].reference : t->rgb[way][surface] + 3 * i,
               sizeof rgb);
        image_tonemap(&one, exposure, colour);
        picture_blend(canvas, left + i % t->width, top + i / t->width, colour, 1.0f);
    }
}

static void draw_shots(picture *canvas, int top, const trial *t, int surface)
{
    static const char *const names[COLUMNS] = {"BRDF sampling", "SIR", "double product",
                                               "triple product", "reference"};
    static const char *const rows[SCENE_SURFACES] = {"diffuse", "Ward glossy"};
    char text[96];
    int column;

    snprintf(text, sizeof text, "%s, %d rays. RMSE: all light visible / some of it blocked",
             rows[surface], RAYS);
    picture_text(canvas, GAP, top, 2, white, text);
    for (column = 0; column < COLUMNS; column++) {
        const int way = column_ways[column], left = GAP + column * (t->width + GAP);
        const int below = top + 2 * LINE + t->height + 4;

        picture_text(canvas, left, top + LINE, 2, white, names[column]);
        draw_shot(canvas, left, top + 2 * LINE, t, surface, way);
        if (way == WAYS)
            continue;
        snprintf(text, sizeof text, way == BRDF ? "%.1f / %.1f" : "%.3f / %.3f",
                 rmse(&t->tallies[way][surface][VISIBLE]),
                 rmse(&t->tallies[way][surface][OCCLUDED]));
        picture_text(canvas, left, below, 2, white, text);
    }
}

/* What a method takes for important at a pixel of a chart: the BRDF x cosine, its importance map,
   or, for the reference, all that there is. */
static float chart_value(const shading *s, const scene_point *p, const float map[TEXELS], int way,
                         int x, int y)
{
    float dir[3];

    dome_dir(((float)x + 0.5f) / CHART, ((float)y + 0.5f) / CHART, dir);
    if (way == BRDF)
        return scene_reflected(p, dir);
    if (way == WAYS)
        return scene_visible(p, dir) ? scene_reflected(p, dir)
                                       * s->dome->fine[dome_texel(dir)].luminance : 0.0f;
    return map[y * SIDE / CHART * SIDE + x * SIDE / CHART];
}

/* In greys of its own: the cube root of what is there, over that of eight times the mean. */
static void draw_chart(picture *canvas, int left, int top, const shading *s, const scene_point *p,
                       int way)
{
    float map[TEXELS], sum = 0.0f;
    int i;

    importance_map(s->dome, p, way == TRIPLE, map);
    for (i = 0; i < CHART * CHART; i++)
        sum += chart_value(s, p, map, way, i % CHART, i / CHART);
    for (i = 0; i < CHART * CHART; i++) {
        const float value = chart_value(s, p, map, way, i % CHART, i / CHART);
        const float grey = cbrtf(value / sum * CHART * CHART / 8.0f);
        const unsigned char level = (unsigned char)(230.0f * fminf(grey, 1.0f));
        unsigned char colour[3];

        memset(colour, level, sizeof colour);
        picture_blend(canvas, left + i % CHART, top + i / CHART, colour, 1.0f);
    }
}

/* How many rays lie in the same texel of an importance map as a ray. */
static int rays_beside(const shading *s, int ray)
{
    float a[2], b[2];
    int i, count = 0;

    dome_uv(s->rays[ray], a);
    for (i = 0; i < s->ray_count; i++) {
        dome_uv(s->rays[i], b);
        count += (int)(a[0] * SIDE) == (int)(b[0] * SIDE)
              && (int)(a[1] * SIDE) == (int)(b[1] * SIDE);
    }
    return count;
}

/* Dots whose area grows with the rays in a texel. Returns how many rays are blocked. */
static int draw_rays(picture *canvas, int left, int top, const shading *s, const scene_point *p)
{
    static const unsigned char black[3] = {0, 0, 0};
    int i, blocked = 0;

    for (i = 0; i < s->ray_count; i++) {
        const int visible = scene_visible(p, s->rays[i]);
        const double width = 4.0 * sqrt((double)rays_beside(s, i));
        float uv[2];
        double at[2];

        dome_uv(s->rays[i], uv);
        at[0] = (double)((float)left + uv[0] * CHART);
        at[1] = (double)((float)top + uv[1] * CHART);
        picture_line(canvas, at, at, width + 2.5, black);
        picture_line(canvas, at, at, width, visible ? free_ray : blocked_ray);
        blocked += !visible;
    }
    return blocked;
}

static void draw_charts(picture *canvas, int top, const trial *t, shading *s, int pixel)
{
    static const char *const names[COLUMNS] = {"cosine", "light x cosine", "light x cosine",
                                               "x proxies", "x visibility"};
    const scene_point *p = &t->seen[SCENE_DIFFUSE][pixel].point;
    int column;

    picture_text(canvas, GAP, top, 2, white,
                 "the rays of +, over the dome: zenith in the middle, horizon at the edge");
    for (column = 0; column < COLUMNS; column++) {
        const int way = column_ways[column];
        const int left = GAP + column * (t->width + GAP);
        char text[32];
        float rgb[3];

        draw_chart(canvas, left, top + LINE, s, p, way);
        picture_text(canvas, left, top + LINE + CHART + 4, 2, white, names[column]);
        if (way == WAYS)
            continue;
        shade(s, p, way, hash_u32((uint32_t)pixel), rgb);
        snprintf(text, sizeof text, "%d blocked", draw_rays(canvas, left, top + LINE, s, p));
        picture_text(canvas, left, top + 2 * LINE + CHART + 4, 2, white, text);
    }
}

static int draw(const trial *t, shading *s, picture *out)
{
    const int row = 3 * LINE + t->height + 10;
    const int x = t->width * 53 / 100, y = t->height * 53 / 100;
    const int left = GAP + (COLUMNS - 1) * (t->width + GAP);

    if (!picture_alloc(out, COLUMNS * (t->width + GAP) + GAP, 2 * row + 3 * LINE + CHART + 12))
        return 0;
    picture_fill(out, 0, 0, out->width, out->height, ground);
    draw_shots(out, GAP, t, SCENE_DIFFUSE);
    draw_shots(out, GAP + row, t, SCENE_GLOSSY);
    draw_charts(out, GAP + 2 * row, t, s, y * t->width + x);
    picture_text(out, left + x - 5, GAP + 2 * LINE + y - 7, 2, blocked_ray, "+");
    return 1;
}

/* ---- the program ----------------------------------------------------------------------------- */

#define USAGE "usage: product_gallery [-q] [-o FOLDER] [MAP]\n"

typedef struct options { const char *folder, *map; int quick; } options;

static int parse(int argc, char **argv, options *o)
{
    int i;

    for (i = 1; i < argc; i++) {
        if (!strcmp(argv[i], "-q"))
            o->quick = 1;
        else if (!strcmp(argv[i], "-o") && i + 1 < argc)
            o->folder = argv[++i];
        else if (argv[i][0] == '-' || o->map)
            return 0;
        else
            o->map = argv[i];
    }
    o->map = o->map ? o->map : "sky";
    return 1;
}

static int write_picture(const trial *t, shading *s, const char *folder, char *error, size_t size)
{
    char path[IMAGE_PATH_MAX];
    picture canvas;
    int good;

    if (snprintf(path, sizeof path, "%s/product.png", folder) >= (int)sizeof path)
        return image_fail(error, size, folder, "is too long a name");
    if (!draw(t, s, &canvas))
        return image_fail(error, size, path, "not enough memory");
    MAKE_FOLDER(folder);             /* where it fails, so does the picture */
    good = picture_write(&canvas, path, error, size);
    picture_free(&canvas);
    return good;
}

/* Returns 0, with the reason in `error`, where there is nothing to tell; *well becomes whether the
   bounds of -q are met. */
static int try_map(const options *o, image *map, int *well, char *error, size_t size)
{
    static shading s;
    static trial t;
    const char *wrong = "is not twice as wide as high, as lat-long maps are";

    t.map_name = o->map;
    t.width = o->quick ? 48 : 176;
    t.height = o->quick ? 28 : 102;
    t.runs = o->quick ? 4 : 1;
    image_clean(map);
    if (map->width == 2 * map->height)
        wrong = shading_make(&s, map);
    if (!wrong && !(trial_alloc(&t) && trial_run(&t, &s)))
        wrong = "not enough memory";
    if (wrong) {
        image_fail(error, size, o->map, "%s", wrong);
    } else {
        print_errors(&t);
        print_bias(&t);
        *well = print_verdict(&t);
        if (!o->quick && !write_picture(&t, &s, o->folder, error, size))
            wrong = error;
    }
    trial_free(&t);
    free(s.dome);
    free(s.scratch.data);
    return !wrong;
}

int main(int argc, char **argv)
{
    static char error[IMAGE_PATH_MAX + 256];
    options o = {"build/pictures", NULL, 0};
    int good, well = 1;
    image map;

    if (!parse(argc, argv, &o)) {
        fprintf(stderr, USAGE);
        return EXIT_FAILURE;
    }
    good = (map_make(o.map, 512, 256, &map) || image_read(o.map, &map, error, sizeof error))
        && try_map(&o, &map, &well, error, sizeof error);
    image_free(&map);
    fflush(stdout);
    if (!good)
        fprintf(stderr, "product_gallery: %s\n", error);
    else if (o.quick && !well)
        fprintf(stderr, "product_gallery: the double product has too large an error\n");
    return good && (well || !o.quick) ? EXIT_SUCCESS : EXIT_FAILURE;
}
