/* test_lights_lamps.c: RELAXED on maps of strong lamps, against both cuts and DECOMPOSED. Maps are
 * made up: one to six lamps of 1 to 20 texels with 5 to 99.9 % of the light or all of it, by the
 * three mappings; and, where `make data` was run, 18 real ones. With the argument `table` it prints
 * what it finds by number of lights.
 *
 * Energies are energy distances between lights and map over all texels, the map's luminance being
 * 1, in 1e-6. Directions of floats are 6e-8 off: that is 0.1.
 */
#ifndef HEADER      /* another version, to compare with */
#define HEADER "../envsamp.h"
#endif
#include HEADER

#include "check.h"
#include "kd_reference.h"
#include "../examples/common/progress.h"
#include "../examples/common/random.h"

#include <math.h>
#include <string.h>

enum { MAPS = 240, SETS = 2, LAMPS = 6, MOST = 200, NORMALS = 256, METHODS = 4, KINDS = 6 };

#define NOISE 0.15      /* of an energy, and a thousandth of it: pieces stand for texels */

static const envsamp_lights_method methods[METHODS] = {
    ENVSAMP_LIGHTS_RELAXED, ENVSAMP_LIGHTS_MEDIAN_CUT, ENVSAMP_LIGHTS_VARIANCE_CUT,
    ENVSAMP_LIGHTS_DECOMPOSED
};

/* ---- maps ---- */

typedef struct lamp {
    int x, y, width, height;    /* texels */
    double share;               /* of the light, of what shines in its texels */
} lamp;

typedef struct subject {
    envsamp_image image;
    float *pixels;
    int lamps;
    lamp lamp[LAMPS];
    float *dir;                 /* of all texels */
    double *share;              /* of luminance */
    double self;                /* mean chord of the map to itself */
} subject;

static double chord(const float *a, const float *b)
{
    const float x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];

    return (double)sqrtf(x * x + y * y + z * z);
}

static double luminance_of(const float *rgb)
{
    return 0.2126 * (double)rgb[0] + 0.7152 * (double)rgb[1] + 0.0722 * (double)rgb[2];
}

static double row_sr(const envsamp_image *view, int y)
{
    const double height = view->height, part = view->mapping == ENVSAMP_LATLONG ? 1.0 : 0.5;

    if (view->mapping == ENVSAMP_OCTAHEDRAL)
        return 4.0 * KD_PI / (double)(view->width * view->height);
    return 2.0 * KD_PI / (double)view->width
         * (cos(KD_PI * part * y / height) - cos(KD_PI * part * (y + 1) / height));
}

static int is_within(const lamp *l, double x, double y)
{
    return x > l->x - 0.02 && x < l->x + l->width + 0.02 && y > l->y - 0.02
        && y < l->y + l->height + 0.02;
}

/* Directions and shares of all texels; the pixels are there. */
static void subject_measure(subject *s)
{
    const int width = s->image.width, height = s->image.height, count = width * height;
    double total = 0.0;
    int i, k;

    s->dir = (float *)kd_allocate((size_t)count * 3 * sizeof *s->dir);
    s->share = (double *)kd_allocate((size_t)count * sizeof *s->share);
    for (i = 0; i < count; i++) {
        envsamp_uv_to_dir(s->image.mapping, ((float)(i % width) + 0.5f) / (float)width,
                          ((float)(i / width) + 0.5f) / (float)height, s->dir + 3 * i);
        s->share[i] = luminance_of(s->pixels + 3 * i) * row_sr(&s->image, i / width);
        total += s->share[i];
    }
    for (s->self = 0.0, i = 0; i < count; i++) {
        double sum = 0.0;

        s->share[i] /= total;
        for (k = 0; k < i && s->share[i] > 0.0; k++)
            sum += s->share[k] * chord(s->dir + 3 * i, s->dir + 3 * k);
        s->self += 2.0 * s->share[i] * sum;
    }
    for (k = 0; k < s->lamps; k++)
        for (s->lamp[k].share = 0.0, i = 0; i < count; i++)
            if (is_within(&s->lamp[k], i % width + 0.5, i / width + 0.5))
                s->lamp[k].share += s->share[i];
}

static void subject_size(subject *s, envsamp_mapping mapping, int width, int height)
{
    memset(s, 0, sizeof *s);
    s->pixels = (float *)kd_allocate((size_t)(width * height) * 3 * sizeof *s->pixels);
    memset(s->pixels, 0, (size_t)(width * height) * 3 * sizeof *s->pixels);
    s->image = kd_image(s->pixels, width, height, 3);
    s->image.mapping = mapping;
}

static void subject_free(subject *s)
{
    free(s->pixels);
    free(s->dir);
    free(s->share);
}

static double draw(pcg32 *random, double from, double to)
{
    return from + (to - from) * (double)pcg32_float(random);
}

/* Light of the sky by the solid angle: none, even, brighter upward, or noise. */
static double fill_sky(subject *s, int kind, int grey, pcg32 *random)
{
    double sum = 0.0;
    int i;

    for (i = 0; i < s->image.width * s->image.height; i++) {
        float dir[3], level = kind > 0 ? 1.0f : 0.0f, *pixel = s->pixels + 3 * i;
        const int x = i % s->image.width, y = i / s->image.width;

        envsamp_uv_to_dir(s->image.mapping, ((float)x + 0.5f) / (float)s->image.width,
                          ((float)y + 0.5f) / (float)s->image.height, dir);
        if (kind == 2)
            level = 0.05f + fmaxf(dir[2], 0.0f);
        if (kind == 3)
            level = pcg32_float(random) * pcg32_float(random);
        pixel[0] = grey ? level : 0.8f * level;
        pixel[1] = level;
        pixel[2] = grey ? level : 1.3f * level;
        sum += luminance_of(pixel) * row_sr(&s->image, y);
    }
    return sum;
}

/* Where a lamp is, often four texels beside the first. */
static void place_lamp(subject *s, int k, pcg32 *random)
{
    lamp *l = &s->lamp[k];
    const int small = draw(random, 0.0, 1.0) < 0.4, beside = k > 0 && draw(random, 0.0, 1.0) < 0.3;

    l->width = small ? 1 : (int)draw(random, 1.0, 6.0);
    l->height = small ? 1 : (int)draw(random, 1.0, 5.0);
    l->x = beside ? s->lamp[0].x + 4 : (int)draw(random, 0.0, s->image.width);
    l->y = beside ? s->lamp[0].y : (int)draw(random, 0.0, s->image.height);
    l->x = l->x + l->width > s->image.width ? s->image.width - l->width : l->x;
    l->y = l->y + l->height > s->image.height ? s->image.height - l->height : l->y;
}

/* Map `number`; odd ones are grey. */
static void subject_make(subject *s, int number)
{
    static const double shares[] = { 0.05, 0.2, 0.5, 0.75, 0.9, 0.95, 0.99, 0.999 };
    pcg32 random = pcg32_make(14, (uint64_t)number);
    const int scale = number % 8 == 0 ? 2 : 1, flat = number % 3 == 0;
    double share[LAMPS], sum = 0.0, sky, light;
    int k, x, y;

    subject_size(s, (envsamp_mapping)(number % 3), scale * (flat ? 64 : 48),
                 scale * (flat ? 32 : 48));
    light = shares[(int)draw(&random, 0.0, 8.0)];
    sky = fill_sky(s, (int)draw(&random, 0.0, 4.0), number % 2, &random);
    light = sky > 0.0 ? light / (1.0 - light) * sky : 1.0;
    s->lamps = 1 + (int)draw(&random, 0.0, LAMPS);
    for (k = 0; k < s->lamps; k++) {
        place_lamp(s, k, &random);
        sum += share[k] = draw(&random, 0.1, 1.1);
    }
    for (k = 0; k < s->lamps; k++) {
        const lamp *l = &s->lamp[k];
        double area = 0.0;

        for (y = l->y; y < l->y + l->height; y++)
            area += row_sr(&s->image, y) * l->width;
        for (y = l->y; y < l->y + l->height; y++)
            for (x = 3 * l->x; x < 3 * (l->x + l->width); x++)
                s->pixels[3 * y * s->image.width + x] += (float)(light * share[k] / sum / area);
    }
    subject_measure(s);
}

/* A real map of 512x256 at a quarter of its size; 0 if it is not there. */
static int subject_real(subject *s, int index)
{
    image map;
    int x, y, c;

    if (!real_map_read(index, &map))
        return 0;
    subject_size(s, ENVSAMP_LATLONG, map.width / 4, map.height / 4);
    for (y = 0; y < map.height / 4 * 4; y++)
        for (x = 0; x < map.width / 4 * 4; x++)
            for (c = 0; c < 3; c++)
                s->pixels[3 * ((y / 4) * (map.width / 4) + x / 4) + c]
                    += map.rgb[3 * (y * map.width + x) + c] / 16.0f;
    image_free(&map);
    subject_measure(s);
    return 1;
}

/* ---- lights ---- */

static void make(const subject *s, envsamp_lights_method method, int count, int rounds,
                 envsamp_light *lights)
{
    envsamp_lights_desc desc = envsamp_lights_defaults();
    envsamp_buffer scratch;
    envsamp_sizes sizes;
    int failed;

    desc.method = method;
    desc.count = count;
    desc.refine_rounds = rounds;
    failed = envsamp_lights_sizes(&s->image, &desc, &sizes) != ENVSAMP_OK;
    scratch.data = kd_allocate(sizes.scratch_bytes);
    scratch.bytes = sizes.scratch_bytes;
    failed |= envsamp_lights(&s->image, &desc, lights, count, scratch, NULL) != ENVSAMP_OK;
    if (failed) {
        printf("Bail out! no lights\n");
        exit(1);
    }
    free(scratch.data);
}

static double energy(const subject *s, const envsamp_light *lights, int count)
{
    const int texels = s->image.width * s->image.height;
    double weight[MOST], total = 0.0, sum = -s->self;
    int i, k;

    for (k = 0; k < count; k++)
        total += weight[k] = luminance_of(lights[k].irradiance);
    for (k = 0; k < count; k++) {
        double mean = 0.0;

        weight[k] /= total;
        for (i = 0; i < texels; i++)
            mean += s->share[i] > 0.0 ? s->share[i] * chord(lights[k].dir, s->dir + 3 * i) : 0.0;
        for (i = 0; i < k; i++)
            mean -= weight[i] * chord(lights[k].dir, lights[i].dir);
        sum += 2.0 * weight[k] * mean;
    }
    return 1e6 * sum;
}

static double cosine(const double *n, const float *dir)
{
    return fmax(n[0] * (double)dir[0] + n[1] * (double)dir[1] + n[2] * (double)dir[2], 0.0);
}

/* Worst relative error of the irradiance. */
static double irradiance_error(const subject *s, const envsamp_light *lights, int count)
{
    double worst = 0.0, total = 0.0;
    int n, i;

    for (i = 0; i < count; i++)
        total += luminance_of(lights[i].irradiance);
    for (n = 0; n < NORMALS; n++) {
        const double z = 1.0 - 2.0 * (n + 0.5) / NORMALS, r = sqrt(1.0 - z * z);
        const double at[3] = { r * cos(2.399963229728653 * n), r * sin(2.399963229728653 * n), z };
        double right = 0.0, got = 0.0;

        for (i = 0; i < s->image.width * s->image.height; i++)
            right += s->share[i] > 0.0 ? s->share[i] * cosine(at, s->dir + 3 * i) : 0.0;
        for (i = 0; i < count; i++)
            got += luminance_of(lights[i].irradiance) / total * cosine(at, lights[i].dir);
        if (right > 1e-9)
            worst = fmax(worst, fabs(got - right) / right);
    }
    return worst;
}

/* Lamps of more than a light's share that have no light. */
static int lamps_missed(const subject *s, const envsamp_light *lights, int count)
{
    int missed = 0, i, k;

    for (i = 0; i < s->lamps; i++) {
        int found = s->lamp[i].share * count <= 1.0;

        for (k = 0; k < count && !found; k++) {
            float uv[2];

            envsamp_dir_to_uv(s->image.mapping, lights[k].dir, uv);
            found = luminance_of(lights[k].irradiance) > 0.0
                 && is_within(&s->lamp[i], (double)uv[0] * s->image.width,
                              (double)uv[1] * s->image.height);
        }
        missed += !found;
    }
    return missed;
}

/* ---- judges ---- */

enum { START, ROUNDS, BEFORE, BEST, IRRADIANCE, MISSED };

static const char *const kinds[KINDS] = {
    "energy above that of the start", "energy higher after more rounds",
    "energy above 1.02 of that of one light less", "energy above the least of the others",
    "irradiance 1.5 times as far off as of that method", "a lamp without a light"
};

typedef struct verdict {
    int sets, failed[KINDS];
    double worst[KINDS];        /* ratio to what it must not exceed */
    double logs;                /* of energies over the least of the others, where these are above
                                   NOISE */
    int counted;
} verdict;

static void judge(verdict *v, int kind, double got, double most, double noise)
{
    if (got > most * 1.001 + noise) {
        v->failed[kind]++;
        v->worst[kind] = fmax(v->worst[kind], got / fmax(most, noise));
    }
}

/* Judges lights by those of the other methods and of one light less. */
static void judge_lights(const subject *s, const envsamp_light *lights, int count, verdict *v)
{
    envsamp_light others[MOST];
    double least = 1e300, off = 0.0, got = energy(s, lights, count);
    int m;

    v->sets++;
    for (m = 1; m < METHODS; m++) {
        double other;

        make(s, methods[m], count, 0, others);
        other = energy(s, others, count);
        if (other < least) {
            least = other;
            off = irradiance_error(s, others, count);
        }
    }
    judge(v, BEST, got, least, NOISE);
    judge(v, IRRADIANCE, irradiance_error(s, lights, count), 1.5 * off, 0.005);
    if (count > 1) {
        make(s, methods[0], count - 1, 0, others);
        judge(v, BEFORE, got, 1.02 * energy(s, others, count - 1), NOISE);
    }
    v->failed[MISSED] += lamps_missed(s, lights, count);
    if (got > NOISE && least > NOISE) {
        v->logs += log(got / least);
        v->counted++;
    }
}

/* The start, and a number of rounds and more of them. */
static void judge_rounds(const subject *s, int count, int rounds, int more, verdict *v)
{
    envsamp_light lights[MOST];
    double start, some, final;

    make(s, methods[0], count, -1, lights);
    start = energy(s, lights, count);
    make(s, methods[0], count, rounds, lights);
    some = energy(s, lights, count);
    make(s, methods[0], count, rounds + more, lights);
    final = energy(s, lights, count);
    judge(v, START, fmax(some, final), start, NOISE);
    judge(v, ROUNDS, final, some, NOISE);
}

/* Takes a tenth of the brightest light 20 degrees away: a ghost. */
static void add_ghost(envsamp_light *lights, int count)
{
    int brightest = 0, k, c;
    double v[3], length;

    for (k = 0; k < count; k++)
        if (luminance_of(lights[k].irradiance) > luminance_of(lights[brightest].irradiance))
            brightest = k;
    for (c = 0; c < 3; c++)
        v[c] = (double)lights[brightest].dir[c];
    v[fabs(v[0]) < 0.6 ? 0 : 1] += 0.364;
    length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    k = (brightest + 1) % count;
    for (c = 0; c < 3; c++) {
        lights[k].dir[c] = (float)(v[c] / length);
        lights[k].irradiance[c] += 0.1f * lights[brightest].irradiance[c];
        lights[brightest].irradiance[c] *= 0.9f;
    }
}

/* ---- the tests ---- */

/* 1 to 200, as often from 1 to 2 as from 100 to 200. */
static int draw_count(pcg32 *random)
{
    return (int)exp(draw(random, 0.0, log(MOST + 0.999)));
}

/* Of lights, of more rounds, and of lights with a ghost. */
typedef struct verdicts { verdict lights, rounds, ghost; } verdicts;

static void judge_map(const subject *s, int number, verdicts *v)
{
    pcg32 random = pcg32_make(15, (uint64_t)number);
    envsamp_light lights[MOST];
    int i, count;

    for (i = 0; i < SETS; i++) {
        count = draw_count(&random);
        make(s, methods[0], count, 0, lights);
        judge_lights(s, lights, count, &v->lights);
        if (i == 0 && count > 1) {
            add_ghost(lights, count);
            judge_lights(s, lights, count, &v->ghost);
        }
    }
    if (number % 4 == 1) {
        v->rounds.sets++;
        count = draw_count(&random);
        i = 1 + (int)draw(&random, 0.0, 40.0);
        judge_rounds(s, count, i, 1 + (int)draw(&random, 0.0, 40.0), &v->rounds);
    }
}

static void check_verdict(const char *name, const verdict *v, int kind, int most)
{
    CHECK(v->sets > 0 && v->failed[kind] <= most, "%s, %d sets: %s: %d, by up to %.3g", name,
          v->sets, kinds[kind], v->failed[kind], v->worst[kind]);
}

static void test_made_up(void)
{
    verdicts v;
    subject s;
    int i;

    memset(&v, 0, sizeof v);
    for (i = 0; i < MAPS; i++) {
        subject_make(&s, i);
        judge_map(&s, i, &v);
        subject_free(&s);
    }
    check_verdict("made-up maps", &v.rounds, START, 0);
    check_verdict("made-up maps", &v.rounds, ROUNDS, 0);
    for (i = BEFORE; i <= MISSED; i++)      /* where moves end beside the least energy */
        check_verdict("made-up maps", &v.lights, i, v.lights.sets / (i == IRRADIANCE ? 40 : 100));
    CHECK(exp(v.lights.logs / v.lights.counted) < 0.7, "made-up maps: energy %.3f of the least of "
          "the others", exp(v.lights.logs / v.lights.counted));
    CHECK(v.ghost.failed[BEST] > v.ghost.sets / 2 && v.ghost.failed[BEFORE] > v.ghost.sets / 2,
          "control: of %d sets with a ghost %d and %d are told by their energy, %d by irradiance",
          v.ghost.sets, v.ghost.failed[BEST], v.ghost.failed[BEFORE], v.ghost.failed[IRRADIANCE]);
}

static void test_real(void)
{
    verdicts v;
    subject s;
    int i;

    memset(&v, 0, sizeof v);
    for (i = 0; i < REAL_MAP_COUNT; i++)
        if (subject_real(&s, i)) {
            judge_map(&s, 2 * i, &v);
            subject_free(&s);
        }
    for (i = BEFORE; i <= IRRADIANCE; i++)
        if (v.lights.sets == 0)
            CHECK_SKIP("no real maps: make data");
        else
            check_verdict("real maps", &v.lights, i, i == BEFORE ? 0 : 1);
}

/* What lights of all counts are like, on every fourth map. */
static int print_table(void)
{
    static const int counts[] = { 1, 2, 4, 8, 12, 16, 24, 32, 48, 64, 96, 128, 129, 200 };
    const int columns = (int)(sizeof counts / sizeof counts[0]);
    envsamp_light lights[MOST];
    progress shown = progress_start("lamps");
    verdict v;
    subject s;
    int i, k;

    printf("lights  sets  energy / least of others  above that  above 1.02 of one less  "
           "irradiance  no light\n");
    for (k = 0; k < columns; k++) {
        memset(&v, 0, sizeof v);
        for (i = 0; i < MAPS; i += 4) {
            progress_show(&shown, (k + (double)i / MAPS) / columns, NULL);
            subject_make(&s, i);
            make(&s, methods[0], counts[k], 0, lights);
            judge_lights(&s, lights, counts[k], &v);
            subject_free(&s);
        }
        progress_end(&shown);
        printf("%6d  %4d  %24.3f  %4d %5.3g  %15d %6.3g  %10d  %8d\n", counts[k], v.sets,
               exp(v.logs / (v.counted > 0 ? v.counted : 1)), v.failed[BEST], v.worst[BEST],
               v.failed[BEFORE], v.worst[BEFORE], v.failed[IRRADIANCE], v.failed[MISSED]);
        fflush(stdout);
    }
    return 0;
}

int main(int argc, char **argv)
{
    if (argc > 1 && !strcmp(argv[1], "table"))
        return print_table();
    test_made_up();
    test_real();
    return check_done();
}
