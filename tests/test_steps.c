/* test_steps.c: builds in steps and from rows that a function makes give the bits of a build in one
 * call, stop where they are told to, and refuse what makes no sense. */
#include "check.h"

#include "../envsamp.h"

#include "sampler.h"

#include <float.h>
#include <limits.h>

/* ---- maps ---- */

/* Noise, a few black texels, and a sun. */
static envsamp_image noise_map(int width, int height, int channels, int padding,
                               envsamp_mapping mapping)
{
    const size_t stride = (size_t)width * (size_t)channels + (size_t)padding;
    float *pixels = (float *)kd_allocate(stride * (size_t)height * sizeof *pixels);
    pcg32 random = pcg32_make(71, (uint64_t)width);
    envsamp_image map;
    int x, y, c;

    for (y = 0; y < height; y++)
        for (x = 0; x < width; x++)
            for (c = 0; c < channels; c++) {
                const float value = pcg32_float(&random);

                pixels[(size_t)y * stride + (size_t)(x * channels + c)] =
                    value < 0.02f ? 0.0f : value * value * value * 8.0f;
            }
    pixels[(size_t)(height / 3) * stride + (size_t)(width / 2 * channels)] = 3000.0f;
    for (y = 0; y < height; y++)                /* what lies between rows is not read */
        for (x = 0; x < padding; x++)
            pixels[(size_t)y * stride + (size_t)(width * channels + x)] = NAN;
    map = kd_image(pixels, width, height, channels);
    map.row_stride_bytes = padding ? stride * sizeof *pixels : 0;
    map.mapping = mapping;
    return map;
}

static void free_map(envsamp_image *map)
{
    union { const float *read; void *whole; } pixels;

    pixels.read = map->pixels;
    free(pixels.whole);
    map->pixels = NULL;
}

/* Every combination of what makes a build take another path, one after the other. */
#define COMBINATIONS (SAMPLER_KINDS * 3 * 2 * 3)

static sampler_request combination(int index, const envsamp_image *map, int blocks)
{
    sampler_request request = sampler_ask(index % SAMPLER_KINDS, map, blocks);

    index /= SAMPLER_KINDS;
    request.image.mapping = (envsamp_mapping)(index % 3);
    request.bilinear = index / 3 % 2;
    request.compensation = index / 6 ? 0.75f : 0.0f;
    request.exponent = index / 12 ? 1.5f : 0.0f;
    return request;
}

static void print_request(char *text, size_t size, const sampler_request *r)
{
    snprintf(text, size, "%s, %s, bilinear %d, compensation %g, exponent %g, %d blocks",
             sampler_names[r->kind], sampler_mappings[r->image.mapping], r->bilinear,
             (double)r->compensation, (double)r->exponent,
             r->kind == SAMPLER_CDF ? 0 : r->blocks);
}

/* ---- schedules ---- */

#define SCHEDULES 7

static int next_count(int schedule, pcg32 *random)
{
    switch (schedule) {
    case 1: return 1;
    case 2: return 7;
    case 3: return 1000;
    case 4: return (int)(pcg32_next(random) % 200u);
    case 5: return (int)(pcg32_next(random) % 31u) - 5;     /* some are 0 or negative */
    default: return INT_MAX;
    }
}

/* Builds by a schedule. Returns what was wrong on the way. */
static int run_schedule(sampler *s, int schedule)
{
    pcg32 random = pcg32_make(5, (uint64_t)schedule);
    int done = 0, faults = 0, calls;

    faults += sampler_begin(s) != ENVSAMP_OK || !sampler_has_job(s);
    for (calls = 0; schedule > 0 && !done && !(schedule == 6 && calls == 1); calls++) {
        const int count = schedule == 6 ? 30 : next_count(schedule, &random);

        done = -1;
        faults += sampler_step(s, count, calls % 5 == 4 ? NULL : &done) != ENVSAMP_OK;
        if (calls % 5 == 4)
            done = 0;
        faults += done < 0;
        if (!done && calls % 5 != 4)
            faults += sampler_opens(s);         /* what is not finished is no table */
    }
    faults += sampler_finish(s) != ENVSAMP_OK;
    return faults;
}

static void test_schedules(int width, int height, int blocks)
{
    envsamp_image map = noise_map(width, height, 3, 0, ENVSAMP_LATLONG);
    int i, k;

    for (i = 0; i < COMBINATIONS; i++) {
        const sampler_request request = combination(i, &map, blocks);
        int faults = 0, different = 0, overrun = 0;
        sampler whole, s;
        char text[120];

        if (request.kind == SAMPLER_CDF && blocks != 64)
            continue;
        sampler_make(&whole, &request);
        for (k = 0; k < SCHEDULES; k++) {
            sampler_prepare(&s, &request, 17 * k);
            faults += run_schedule(&s, k);
            different += !sampler_equal(&whole, &s);
            overrun += !sampler_intact(&s);
            sampler_free(&s);
        }
        print_request(text, sizeof text, &request);
        CHECK(sampler_opens(&whole) && !faults && !different && !overrun,
              "%s: %d of %d schedules give other bits, %d faults, %d write outside", text,
              different, SCHEDULES, faults, overrun);
        sampler_free(&whole);
    }
    free_map(&map);
}

/* Every combination at once, each a few items at a time, in no order. */
static void test_interleaved(void)
{
    envsamp_image map = noise_map(61, 47, 4, 5, ENVSAMP_LATLONG);
    sampler jobs[COMBINATIONS];
    int done[COMBINATIONS] = { 0 }, left = COMBINATIONS, faults = 0, different = 0, i;
    pcg32 random = pcg32_make(6, 0);

    for (i = 0; i < COMBINATIONS; i++) {
        const sampler_request request = combination(i, &map, 300);

        sampler_prepare(&jobs[i], &request, i);
        faults += sampler_begin(&jobs[i]) != ENVSAMP_OK;
    }
    while (left > 0) {
        i = (int)(pcg32_next(&random) % COMBINATIONS);
        if (done[i])
            continue;
        faults += sampler_step(&jobs[i], (int)(pcg32_next(&random) % 20u), &done[i])
               != ENVSAMP_OK;
        left -= done[i] != 0;
    }
    for (i = 0; i < COMBINATIONS; i++) {
        const sampler_request request = combination(i, &map, 300);
        sampler whole;

        sampler_make(&whole, &request);
        faults += sampler_finish(&jobs[i]) != ENVSAMP_OK;
        different += !sampler_equal(&whole, &jobs[i]) || !sampler_intact(&jobs[i]);
        sampler_free(&whole);
        sampler_free(&jobs[i]);
    }
    CHECK(!faults && !different, "%d jobs at once: %d faults, %d with other bits", COMBINATIONS,
          faults, different);
    free_map(&map);
}

/* ---- done ---- */

/* How many items a build is. */
static int count_items(const sampler_request *request)
{
    int done = 0, items = 0;
    sampler s;

    sampler_prepare(&s, request, 1);
    sampler_begin(&s);
    for (; !done && items < 1000000; items++)
        sampler_step(&s, 1, &done);
    sampler_free(&s);
    return items;
}

static void test_done(const sampler_request *request)
{
    const int items = count_items(request);
    int done = -1, faults = 0;
    unsigned char *copy;
    const void *data;
    sampler s;
    char text[120];

    sampler_prepare(&s, request, 2);
    faults += sampler_begin(&s) != ENVSAMP_OK;
    faults += sampler_step(&s, 0, &done) != ENVSAMP_OK || done;
    done = -1;
    faults += sampler_step(&s, -1, &done) != ENVSAMP_OK || done;
    done = -1;
    faults += sampler_step(&s, INT_MIN, &done) != ENVSAMP_OK || done;
    done = -1;
    faults += sampler_step(&s, items - 1, &done) != ENVSAMP_OK || done || sampler_opens(&s);
    faults += sampler_step(&s, 0, &done) != ENVSAMP_OK || done;
    faults += sampler_step(&s, 1, &done) != ENVSAMP_OK || !done;
    faults += sampler_finish(&s) != ENVSAMP_OK || !sampler_opens(&s);
    data = sampler_data(&s);
    copy = (unsigned char *)kd_allocate(s.table.buffer.bytes);
    memcpy(copy, s.table.buffer.data, s.table.buffer.bytes);
    done = 0;
    faults += sampler_step(&s, 1, &done) != ENVSAMP_OK || !done;
    done = 0;
    faults += sampler_step(&s, INT_MAX, &done) != ENVSAMP_OK || !done;
    done = 0;
    faults += sampler_step(&s, 0, &done) != ENVSAMP_OK || !done;
    faults += sampler_step(&s, 5, NULL) != ENVSAMP_OK;
    faults += sampler_finish(&s) != ENVSAMP_OK || sampler_data(&s) != data;
    faults += memcmp(copy, s.table.buffer.data, s.table.buffer.bytes) != 0;
    print_request(text, sizeof text, request);
    CHECK(!faults && sampler_intact(&s), "%s: done after the last of %d items, %d faults", text,
          items, faults);
    free(copy);
    sampler_free(&s);
}

static void test_dones(void)
{
    envsamp_image map = noise_map(40, 21, 1, 0, ENVSAMP_LATLONG);
    int i;

    for (i = 0; i < COMBINATIONS; i++) {
        const sampler_request request = combination(i, &map, 50);

        test_done(&request);
    }
    free_map(&map);
}

static void test_null_jobs(void)
{
    envsamp_image map = noise_map(8, 4, 1, 0, ENVSAMP_LATLONG);
    int done = 0, kind;

    for (kind = SAMPLER_WARP; kind <= SAMPLER_CDF; kind += SAMPLER_CDF - SAMPLER_WARP) {
        const sampler_request request = sampler_ask(kind, &map, 8);
        const envsamp_kd_desc kd = sampler_kd_desc(&request);
        const envsamp_cdf_desc cdf = sampler_cdf_desc(&request);
        const int is_cdf = kind == SAMPLER_CDF;
        sampler s;

        sampler_make(&s, &request);
        CHECK(sampler_step(&s, 1, &done) == ENVSAMP_ERR_NULL
              && sampler_step(&s, 0, NULL) == ENVSAMP_ERR_NULL, "%s: a step of no job",
              sampler_names[kind]);
        CHECK(sampler_finish(&s) == ENVSAMP_ERR_NULL && !sampler_data(&s), "%s: the end of no job",
              sampler_names[kind]);
        CHECK((is_cdf ? envsamp_cdf_begin(&map, NULL, NULL, &cdf, s.table.buffer,
                                          s.scratch.buffer, NULL)
                      : envsamp_kd_begin(&map, NULL, NULL, &kd, s.table.buffer,
                                         s.scratch.buffer, NULL)) == ENVSAMP_ERR_NULL,
              "%s: a job nowhere", sampler_names[kind]);
        sampler_begin(&s);
        CHECK((is_cdf ? envsamp_cdf_finish(s.cdf_job, NULL) : envsamp_kd_finish(s.kd_job, NULL))
              == ENVSAMP_ERR_NULL && sampler_finish(&s) == ENVSAMP_OK && sampler_opens(&s),
              "%s: a table nowhere, and then somewhere", sampler_names[kind]);
        sampler_free(&s);
    }
    free_map(&map);
}

/* ---- rows from a function ---- */

#define MOST_ROWS 400

typedef struct row_giver {
    const envsamp_image *image;
    const sampler *job;                 /* whose scratch holds the rows */
    int rows[MOST_ROWS], count;         /* what was asked for */
    int fail_at;                        /* the call, from 0 on, that fails; -1 none */
    envsamp_result failure;
    int stray;                          /* rows that are not within scratch */
} row_giver;

static envsamp_result give_row(int y, float *row, void *user)
{
    row_giver *giver = (row_giver *)user;
    const envsamp_image *image = giver->image;
    const size_t packed = (size_t)image->width * (size_t)image->channels * sizeof(float);
    const size_t stride = image->row_stride_bytes ? image->row_stride_bytes : packed;
    const envsamp_buffer *scratch = &giver->job->scratch.buffer;
    const size_t at = (size_t)((const char *)row - (const char *)scratch->data);

    giver->stray += at > scratch->bytes || packed > scratch->bytes - at || at % sizeof(float);
    if (giver->count < MOST_ROWS)
        giver->rows[giver->count] = y;
    if (giver->count++ == giver->fail_at)
        return giver->failure;
    memcpy(row, (const char *)image->pixels + (size_t)y * stride, packed);
    return ENVSAMP_OK;
}

static row_giver make_giver(const envsamp_image *image)
{
    row_giver giver;

    memset(&giver, 0, sizeof giver);
    giver.image = image;
    giver.fail_at = -1;
    return giver;
}

/* The same request with the rows from a function, and no pixels. */
static void prepare_rows(sampler *s, const sampler_request *request, row_giver *giver, int rubbish)
{
    sampler_request rows = *request;

    rows.image.pixels = NULL;
    rows.fn = give_row;
    rows.user = giver;
    sampler_prepare(s, &rows, rubbish);
    giver->job = s;
}

/* With an exponent ahead of the build, for it, and for figures. */
static int expected_passes(const sampler_request *request)
{
    return request->exponent > 0.0f ? 3 : request->compensation > 0.0f
        || (request->bilinear && request->image.mapping == ENVSAMP_OCTAHEDRAL) ? 2 : 1;
}

/* Rows in order, as often as expected. */
static int asked_in_order(const row_giver *giver, int height, int passes)
{
    int i, good = giver->count == passes * height && !giver->stray;

    for (i = 0; good && i < giver->count; i++)
        good = giver->rows[i] == i % height;
    return good;
}

/* Whether the table from rows is that from pixels. `count` items at a time; 0: all. */
static int rows_agree(const sampler_request *request, const sampler *whole, int count)
{
    row_giver giver = make_giver(&request->image);
    int done = 0, good;
    sampler s;

    prepare_rows(&s, request, &giver, 100 + count);
    good = sampler_build(&s) == ENVSAMP_OK && sampler_equal(whole, &s) && sampler_intact(&s);
    giver.count = 0;
    good &= sampler_begin(&s) == ENVSAMP_OK;
    while (count && good && !done)
        good = sampler_step(&s, count, &done) == ENVSAMP_OK;
    good &= sampler_finish(&s) == ENVSAMP_OK && sampler_equal(whole, &s) && sampler_intact(&s);
    good &= asked_in_order(&giver, request->image.height, expected_passes(request));
    sampler_finish(&s);
    good &= giver.count == expected_passes(request) * request->image.height;
    sampler_free(&s);
    return good;
}

static void test_rows(int width, int height, int channels, int padding)
{
    envsamp_image map = noise_map(width, height, channels, padding, ENVSAMP_LATLONG);
    int i, wrong = 0;

    for (i = 0; i < COMBINATIONS; i++) {
        const sampler_request request = combination(i, &map, 120);
        sampler whole;
        char text[120];

        sampler_make(&whole, &request);
        if (!rows_agree(&request, &whole, 0) || !rows_agree(&request, &whole, 1)
            || !rows_agree(&request, &whole, 50)) {
            print_request(text, sizeof text, &request);
            printf("# differs: %s\n", text);
            wrong++;
        }
        sampler_free(&whole);
    }
    CHECK(!wrong, "%d by %d, %d channels, padded by %d: %d of %d tables from rows differ", width,
          height, channels, padding, wrong, COMBINATIONS);
    free_map(&map);
}

/* ---- rows that fail ---- */

/* Builds over a good table, with the giver failing at a call. Returns what was wrong. */
static int faults_of_failure(const sampler_request *request, int call, envsamp_result failure,
                             int count)
{
    row_giver giver = make_giver(&request->image);
    int done = 0, faults = 0, asked;
    sampler s;

    prepare_rows(&s, request, &giver, 3);
    faults += sampler_begin(&s) != ENVSAMP_OK || sampler_finish(&s) != ENVSAMP_OK;
    faults += !sampler_opens(&s);
    giver.count = 0;
    giver.fail_at = call;
    giver.failure = failure;
    sampler_begin(&s);
    while (count && s.result == ENVSAMP_OK && !done)
        sampler_step(&s, count, &done);
    faults += count && (s.result != failure || !done);
    asked = giver.count;
    if (count) {                                /* it stays so, and asks for nothing more */
        done = 0;
        faults += sampler_step(&s, 1000, &done) != failure || !done;
        faults += sampler_step(&s, 0, NULL) != failure;
    }
    faults += sampler_finish(&s) != failure || sampler_data(&s) != NULL;
    faults += sampler_finish(&s) != failure || sampler_data(&s) != NULL;
    faults += giver.count != call + 1 || (count && asked != giver.count) || giver.stray;
    faults += sampler_opens(&s) || !sampler_intact(&s);
    sampler_free(&s);
    return faults;
}

static void test_failures(void)
{
    envsamp_image map = noise_map(29, 18, 3, 0, ENVSAMP_LATLONG);
    const int at[] = { 0, 1, 9, 17, 18, 19, 27, 35 };
    int i, k, result;

    for (i = 0; i < COMBINATIONS; i++) {
        const sampler_request request = combination(i, &map, 40);
        const int calls = expected_passes(&request) * map.height;
        int faults = 0;
        char text[120];

        for (k = 0; k < 8 && at[k] < calls; k++)
            for (result = ENVSAMP_ERR_NULL; result <= ENVSAMP_ERR_FORMAT; result++) {
                faults += faults_of_failure(&request, at[k], (envsamp_result)result, 0);
                faults += faults_of_failure(&request, at[k], (envsamp_result)result, 1);
                faults += faults_of_failure(&request, at[k], (envsamp_result)result, 13);
            }
        print_request(text, sizeof text, &request);
        CHECK(!faults, "%s: rows that fail: %d faults", text, faults);
    }
    free_map(&map);
}

/* ---- bad values ---- */

/* Spoils `count` pixels, all over the map; at least one in the last row. */
static void spoil(envsamp_image *map, float *pixels, int count)
{
    const float values[] = { NAN, INFINITY, -INFINITY, -1.0f, -1e-30f, -FLT_MAX };
    int i;

    for (i = 0; i < count; i++) {
        const int texel = map->width * map->height - 1 - i * 37;

        pixels[texel * map->channels + i % (map->channels == 1 ? 1 : 3)] = values[i % 6];
    }
}

/* A build from rows; whether it ends as it should, with so many bad pixels. */
static int bad_rows_good(const sampler_request *request, envsamp_result expected, size_t bad)
{
    row_giver giver = make_giver(&request->image);
    envsamp_result result;
    sampler s;
    int good;

    prepare_rows(&s, request, &giver, 9);
    result = sampler_begin(&s);
    if (result == ENVSAMP_OK)
        result = sampler_finish(&s);
    good = result == expected && sampler_intact(&s) && !giver.stray;
    good &= sampler_opens(&s) == (expected == ENVSAMP_OK);
    good &= (sampler_data(&s) != NULL) == (expected == ENVSAMP_OK);
    if (sampler_data(&s))
        good &= sampler_get_info(&s).bad_pixel_count == bad;
    sampler_free(&s);
    return good;
}

static void test_bad_rows(int channels)
{
    envsamp_image map = noise_map(31, 17, channels, 0, ENVSAMP_LATLONG);
    float *pixels = (float *)kd_allocate(31 * 17 * 4 * sizeof *pixels);
    int i, wrong = 0, strict = 0, different = 0, black = 0;
    envsamp_image spoiled = map, night = map;

    memcpy(pixels, map.pixels, (size_t)(31 * 17 * channels) * sizeof *pixels);
    spoil(&map, pixels, 12);
    spoiled.pixels = pixels;
    night.pixels = (const float *)kd_allocate(31 * 17 * 4 * sizeof *pixels);
    for (i = 0; i < COMBINATIONS; i++) {
        sampler_request request = combination(i, &spoiled, 40);
        sampler whole;

        wrong += !bad_rows_good(&request, ENVSAMP_OK, 12);
        sampler_make(&whole, &request);
        different += !rows_agree(&request, &whole, 0) || sampler_get_info(&whole).bad_pixel_count
                                                      != 12;
        sampler_free(&whole);
        request.strict = 1;
        strict += !bad_rows_good(&request, ENVSAMP_ERR_VALUE, 0);
        request.image.pixels = map.pixels;
        strict += !bad_rows_good(&request, ENVSAMP_OK, 0);
        request.image.pixels = night.pixels;
        black += !bad_rows_good(&request, ENVSAMP_ERR_BLACK, 0);
    }
    CHECK(!wrong && !different, "%d channels: bad pixels in rows are counted: %d, %d not",
          channels, wrong, different);
    CHECK(!strict, "%d channels: strict refuses them: %d do not", channels, strict);
    CHECK(!black, "%d channels: black rows are refused: %d are not", channels, black);
    free(pixels);
    free_map(&map);
    free_map(&night);
}

/* Rows that differ each time they are asked for: what comes of it is a table or an error. */
static envsamp_result give_noise(int y, float *row, void *user)
{
    pcg32 *random = (pcg32 *)user;
    int x;

    for (x = 0; x < 33; x++) {
        const uint32_t bits = pcg32_next(random) << (y % 3 ? 0 : 1);

        memcpy(&row[x], &bits, sizeof bits);
    }
    if (pcg32_next(random) % 64u == 0)
        memset(row, 0, 33 * sizeof *row);
    return ENVSAMP_OK;
}

static void test_inconsistent_rows(void)
{
    pcg32 random = pcg32_make(8, 0), points = pcg32_make(9, 0);
    envsamp_image map = kd_image(NULL, 33, 20, 1);
    int i, k, faults = 0, built = 0;

    for (i = 0; i < 3 * COMBINATIONS; i++) {
        sampler_request request = combination(i % COMBINATIONS, &map, 60);
        sampler s;

        request.fn = give_noise;
        request.user = &random;
        sampler_make(&s, &request);
        faults += !sampler_intact(&s) || (s.result != ENVSAMP_OK && sampler_opens(&s));
        faults += s.result == ENVSAMP_OK && !sampler_opens(&s);
        built += s.result == ENVSAMP_OK;
        for (k = 0; k < 100 && s.result == ENVSAMP_OK; k++) {
            const envsamp_sample sample = sampler_draw(&s, pcg32_float(&points),
                                                       pcg32_float(&points));
            const float *d = sample.dir;

            faults += !(fabsf(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - 1.0f) < 1e-5f);
            faults += !(sample.pdf > 0.0f && sample.pdf <= FLT_MAX);
        }
        sampler_free(&s);
    }
    CHECK(!faults && built > 0, "rows that never are the same: %d tables, %d faults", built,
          faults);
}

/* ---- bad input ---- */

/* Sizes, _build and _begin all refuse, and leave no table and no job. With `fn` the rows are from a
   function. */
static int refused(const sampler_request *request, envsamp_result expected)
{
    kd_guarded table = kd_guarded_make(1 << 16, 0x3c), scratch = kd_guarded_make(1 << 17, 0x3c);
    envsamp_image image = request->image;
    int with_rows, good = 1;
    sampler s;

    for (with_rows = 0; with_rows < 2; with_rows++) {
        memset(&s, 0, sizeof s);
        s.request = *request;
        s.table = table;
        s.scratch = scratch;
        s.sizes.table_bytes = s.sizes.scratch_bytes = 1;
        good &= sampler_sizes(request, &s.sizes) == expected;
        good &= s.sizes.table_bytes == 0 && s.sizes.scratch_bytes == 0;
        s.kd = (const envsamp_kd *)table.buffer.data;
        s.cdf = (const envsamp_cdf *)table.buffer.data;
        good &= sampler_build(&s) == expected && !sampler_data(&s);
        s.request.fn = with_rows ? give_row : NULL;     /* is not called */
        s.request.image.pixels = with_rows ? NULL : image.pixels;
        s.kd_job = (envsamp_kd_job *)scratch.buffer.data;
        s.cdf_job = (envsamp_cdf_job *)scratch.buffer.data;
        good &= sampler_begin(&s) == expected && !sampler_has_job(&s);
        good &= !sampler_opens(&s) && sampler_intact(&s);
    }
    free(table.block);
    free(scratch.block);
    return good;
}

static float some_pixels[16 * 8 * 4];

static sampler_request good_request(int kind)
{
    envsamp_image map;
    int i;

    for (i = 0; i < 16 * 8 * 4; i++)
        some_pixels[i] = (float)(1 + i % 13);
    map = kd_image(some_pixels, 16, 8, 3);
    return sampler_ask(kind, &map, 8);
}

static void test_bad_sizes(int kind)
{
    const int sides[] = { 0, -1, 65536, INT_MAX, INT_MIN }, channels[] = { 0, 2, 5, -1, INT_MAX };
    const size_t most = (size_t)-1;
    const size_t strides[] = { 16 * 12 - 4, 4, 1, 3, most, most / 4 * 4, most / 8 / 4 * 4 + 4,
                               most / 16 * 4, most / 2 + 1 };
    const char *name = sampler_names[kind];
    sampler_request r;
    sampler s;
    int i;

    for (i = 0; i < 5; i++) {
        r = good_request(kind);
        r.image.width = sides[i];
        CHECK(refused(&r, ENVSAMP_ERR_SIZE), "%s: width %d", name, sides[i]);
        r = good_request(kind);
        r.image.height = sides[i];
        CHECK(refused(&r, ENVSAMP_ERR_SIZE), "%s: height %d", name, sides[i]);
        r = good_request(kind);
        r.image.channels = channels[i];
        CHECK(refused(&r, ENVSAMP_ERR_SIZE), "%s: %d channels", name, channels[i]);
    }
    for (i = 0; i < (int)(sizeof strides / sizeof strides[0]); i++) {
        r = good_request(kind);
        r.image.row_stride_bytes = strides[i];
        CHECK(refused(&r, ENVSAMP_ERR_SIZE), "%s: stride %lu of rows of %d bytes", name,
              (unsigned long)strides[i], 16 * 12);
    }
    for (i = 1; i < 4; i++) {
        r = good_request(kind);
        r.image.row_stride_bytes = 16 * 12 + (size_t)i;
        CHECK(refused(&r, ENVSAMP_ERR_ALIGN), "%s: stride %d", name, 16 * 12 + i);
        r = good_request(kind);
        r.image.pixels = (const float *)((uintptr_t)some_pixels + (uintptr_t)i);
        sampler_make(&s, &r);
        CHECK(s.result == ENVSAMP_ERR_ALIGN && !sampler_opens(&s) && sampler_intact(&s),
              "%s: pixels %d bytes after a multiple of 4", name, i);
        sampler_free(&s);
    }
}

static void test_bad_descriptions(int kind)
{
    const float amounts[] = { NAN, -0.1f, 1.1f, INFINITY, -INFINITY, -FLT_MIN, 1.0000001f,
                              FLT_MAX };
    const float exponents[] = { NAN, 0.4999999f, 2.0000002f, INFINITY, -INFINITY, -1.0f, FLT_MIN,
                                FLT_MAX };
    const int mappings[] = { 3, -1, INT_MAX, INT_MIN, 256 };
    const char *name = sampler_names[kind];
    sampler_request r;
    int i;

    for (i = 0; i < 8; i++) {
        r = good_request(kind);
        r.compensation = amounts[i];
        CHECK(refused(&r, ENVSAMP_ERR_PARAM), "%s: compensation %g", name, (double)amounts[i]);
        r = good_request(kind);
        r.exponent = exponents[i];
        CHECK(refused(&r, ENVSAMP_ERR_PARAM), "%s: exponent %g", name, (double)exponents[i]);
    }
    for (i = 0; i < 5; i++) {
        r = good_request(kind);
        memcpy(&r.image.mapping, &mappings[i], sizeof mappings[i]);
        CHECK(refused(&r, ENVSAMP_ERR_PARAM), "%s: mapping %d", name, mappings[i]);
        r.bilinear = 1;
        r.compensation = 1.0f;
        CHECK(refused(&r, ENVSAMP_ERR_PARAM), "%s: mapping %d, bilinear", name, mappings[i]);
    }
    for (i = 0; i < 2; i++) {
        sampler s;

        r = good_request(kind);
        r.compensation = i ? 1.0f : -0.0f;
        r.exponent = i ? 2.0f : -0.0f;
        r.bilinear = i ? 99 : INT_MIN;
        CHECK(sampler_make(&s, &r) && sampler_opens(&s) && sampler_get_info(&s).bilinear == 1,
              "%s: compensation %g and bilinear %d are allowed", name, (double)r.compensation,
              r.bilinear);
        sampler_free(&s);
    }
}

/* No pixels and no function is an error; no pixels with a function is not, and neither is wrong
   pixels, which are not read. */
static void test_no_pixels(int kind)
{
    sampler_request r = good_request(kind);
    row_giver giver = make_giver(&r.image);
    envsamp_image map = r.image;
    sampler s, other;
    int good;

    sampler_make(&other, &r);
    giver.image = &map;
    prepare_rows(&s, &r, &giver, 7);
    s.request.fn = NULL;
    s.kd_job = (envsamp_kd_job *)s.scratch.buffer.data;
    s.cdf_job = (envsamp_cdf_job *)s.scratch.buffer.data;
    good = sampler_begin(&s) == ENVSAMP_ERR_NULL && !sampler_has_job(&s) && !sampler_opens(&s);
    good &= sampler_build(&s) == ENVSAMP_ERR_NULL && !sampler_data(&s);
    CHECK(good && !giver.count && sampler_intact(&s), "%s: no pixels", sampler_names[kind]);
    s.request.fn = give_row;
    good = sampler_begin(&s) == ENVSAMP_OK && sampler_finish(&s) == ENVSAMP_OK;
    CHECK(good && sampler_equal(&s, &other), "%s: rows, no pixels", sampler_names[kind]);
    s.request.image.pixels = (const float *)(const void *)some_pixels + 7;
    good = sampler_begin(&s) == ENVSAMP_OK && sampler_finish(&s) == ENVSAMP_OK;
    CHECK(good && sampler_equal(&s, &other), "%s: rows, and pixels not read",
          sampler_names[kind]);
    sampler_free(&s);
    sampler_free(&other);
}

/* One byte less, an address off, or no buffer. Rows are not asked for. */
static void test_bad_buffers(int kind)
{
    const envsamp_result expected[] = { ENVSAMP_ERR_MEMORY, ENVSAMP_ERR_MEMORY, ENVSAMP_ERR_ALIGN,
                                        ENVSAMP_ERR_ALIGN, ENVSAMP_ERR_NULL, ENVSAMP_ERR_NULL };
    sampler_request r = good_request(kind);
    row_giver giver = make_giver(&r.image);
    sampler s;
    int i;

    for (i = 0; i < 6; i++) {
        envsamp_buffer *buffer = i % 2 ? &s.scratch.buffer : &s.table.buffer, kept;
        int good;

        prepare_rows(&s, &r, &giver, 7);
        sampler_begin(&s);
        kept = *buffer;
        buffer->bytes -= i < 2;
        buffer->data = i < 2 ? buffer->data : i < 4 ? (void *)((char *)buffer->data + 4) : NULL;
        giver.count = 0;
        good = sampler_begin(&s) == expected[i] && !sampler_has_job(&s) && !giver.count;
        *buffer = kept;
        CHECK(good && sampler_intact(&s) && !sampler_opens(&s), "%s: %s, %s", sampler_names[kind],
              i % 2 ? "scratch" : "table", envsamp_result_string(expected[i]));
        sampler_free(&s);
    }
}

/* ---- sums over many texels ---- */

static envsamp_result give_constant(int y, float *row, void *user)
{
    const float value = *(const float *)user;
    int x;

    (void)y;
    for (x = 0; x < 4096; x++)
        row[x] = value;
    return ENVSAMP_OK;
}

static void test_float_sums(int kind)
{
    float value = 0.7f;
    envsamp_image map = kd_image(NULL, 4096, 2048, 1);
    int i;

    for (i = 0; i < 6; i++) {
        sampler_request request = sampler_ask(kind, &map, 16);
        double expected = 4.0 * KD_PI * (double)value, off;
        sampler s;

        request.image.mapping = (envsamp_mapping)(i % 3);
        request.bilinear = i / 3;
        request.fn = give_constant;
        request.user = &value;
        expected *= i % 3 == ENVSAMP_HEMISPHERE ? 0.5 : 1.0;
        sampler_make(&s, &request);
        off = s.result == ENVSAMP_OK ? sampler_get_info(&s).integral / expected - 1.0 : 1.0;
        CHECK(fabs(off) < 1e-12, "%s, %s, bilinear %d: a constant map of 4096 by 2048 is %.1e off",
              sampler_names[kind], sampler_mappings[i % 3], request.bilinear, off);
        sampler_free(&s);
    }
}

int main(void)
{
    int kind;

    test_schedules(96, 80, 1);
    test_schedules(37, 23, 64);
    test_schedules(96, 80, 6144);
    test_interleaved();
    test_dones();
    test_null_jobs();
    test_rows(1, 1, 1, 0);
    test_rows(1, 9, 3, 2);
    test_rows(70, 1, 4, 1);
    test_rows(67, 34, 1, 3);
    test_rows(67, 34, 3, 0);
    test_rows(130, 65, 4, 6);
    test_failures();
    test_bad_rows(1);
    test_bad_rows(3);
    test_bad_rows(4);
    test_inconsistent_rows();
    for (kind = 0; kind < SAMPLER_KINDS; kind++) {
        test_bad_sizes(kind);
        test_bad_descriptions(kind);
        test_no_pixels(kind);
        test_bad_buffers(kind);
    }
    test_float_sums(SAMPLER_WARP);
    test_float_sums(SAMPLER_CDF);
    return check_done();
}
