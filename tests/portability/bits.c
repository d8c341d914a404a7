/* bits.c: prints two hashes of tables, samples, densities, inverses, lights and halftones.
 *
 * The first is of memory: equal on all machines of one byte order. The second is of the same
 * numbers with the lowest byte first, without the checksums, which are of memory: equal on all
 * machines.
 *
 * Nothing but envsamp.h is needed where BITS_NO_MAIN is defined: no heap, no stdio. */
#define ENVSAMP_IMPLEMENTATION
#include "envsamp.h"

#define BITS_ARENA_BYTES (24u << 20)
#define BITS_SAMPLES 1000

typedef struct bits_hashes { uint32_t memory, values; int failed; } bits_hashes;

static bits_hashes bits;
static unsigned char bits_arena[BITS_ARENA_BYTES];
static size_t bits_arena_used;

/* Memory that lasts until bits_arena_used is set back. */
static envsamp_buffer allot(size_t bytes)
{
    const uintptr_t address = (uintptr_t)(bits_arena + bits_arena_used);
    envsamp_buffer buffer = { NULL, 0 };

    bits_arena_used += (ENVSAMP_ALIGN - address % ENVSAMP_ALIGN) % ENVSAMP_ALIGN;
    if (bytes > BITS_ARENA_BYTES - bits_arena_used) {
        bits.failed = 1;
        return buffer;
    }
    buffer.data = bits_arena + bits_arena_used;
    buffer.bytes = bytes;
    bits_arena_used += bytes;
    return buffer;
}

static void add_memory(const void *data, size_t bytes)
{
    const unsigned char *byte = (const unsigned char *)data;
    size_t i;

    for (i = 0; i < bytes; i++)
        bits.memory = (bits.memory ^ byte[i]) * 16777619u;
}

/* Numbers of `size` bytes each, with the lowest byte first. */
static void add_values(const void *data, size_t bytes, size_t size)
{
    const uint16_t one = 1;
    const unsigned char *byte = (const unsigned char *)data;
    const size_t flip = *(const unsigned char *)&one ? 0 : size - 1;
    size_t i;

    for (i = 0; i < bytes; i++)
        bits.values = (bits.values ^ byte[i / size * size + (i % size ^ flip)]) * 16777619u;
}

/* Floats and ints. */
static void add_words(const void *data, size_t bytes)
{
    add_memory(data, bytes);
    add_values(data, bytes, 4);
}

static void add_double(double value)
{
    add_memory(&value, sizeof value);
    add_values(&value, sizeof value, sizeof value);
}

static void add_float(float value) { add_words(&value, sizeof value); }

/* Parts of a table, each from where the one before ends. */
typedef struct bits_part { size_t end, size; } bits_part;

static void add_table(const void *table, const bits_part *parts, int count)
{
    size_t at = 0;
    int i;

    add_memory(table, parts[count - 1].end);
    for (i = 0; i < count; at = parts[i++].end)
        if (parts[i].size)
            add_values((const unsigned char *)table + at, parts[i].end - at, parts[i].size);
}

static void add_kd_table(const envsamp_kd *kd)
{
    bits_part parts[7];

    parts[0].end = offsetof(envsamp_kd, checksum);
    parts[0].size = 4;
    parts[1].end = parts[0].end + 4;
    parts[1].size = 0;              /* the checksum */
    parts[2].end = offsetof(envsamp_kd, bytes);
    parts[2].size = 4;
    parts[3].end = offsetof(envsamp_kd, select);
    parts[3].size = 8;
    parts[4].end = offsetof(envsamp_kd, fit_total);
    parts[4].size = 4;
    parts[5].end = offsetof(envsamp_kd, facing_count);
    parts[5].size = 8;
    parts[6].end = envsamp_kd_bytes(kd);
    parts[6].size = 4;
    add_table(kd, parts, 7);
}

static void add_cdf_table(const envsamp_cdf *cdf)
{
    bits_part parts[8];

    parts[0].end = offsetof(envsamp_cdf, checksum);
    parts[0].size = 4;
    parts[1].end = parts[0].end + 4;
    parts[1].size = 0;              /* the checksum */
    parts[2].end = offsetof(envsamp_cdf, bytes);
    parts[2].size = 4;
    parts[3].end = parts[2].end + 8;
    parts[3].size = 8;
    parts[4].end = offsetof(envsamp_cdf, rows_at);
    parts[4].size = 4;
    parts[5].end = offsetof(envsamp_cdf, mis_compensation);
    parts[5].size = 8;
    parts[6].end = (size_t)cdf->row_guide_at;
    parts[6].size = 4;
    parts[7].end = envsamp_cdf_bytes(cdf);
    parts[7].size = 2;
    add_table(cdf, parts, 8);
}

static float u0_of(int i) { return (float)((uint32_t)i * 2654435761u >> 8) / 16777216.0f; }
static float u1_of(int i) { return (float)((uint32_t)i * 40503u % 65536u) / 65536.0f; }

/* Samples and densities in batches: bits of their own, if a compiler does them otherwise. */
typedef struct bits_batch {
    float u0[BITS_SAMPLES], u1[BITS_SAMPLES];
    float x[BITS_SAMPLES], y[BITS_SAMPLES], z[BITS_SAMPLES], pdf[BITS_SAMPLES];
} bits_batch;

static bits_batch batch;

static void start_batch(void)
{
    int i;

    for (i = 0; i < BITS_SAMPLES; i++) {
        batch.u0[i] = u0_of(i);
        batch.u1[i] = u1_of(i);
    }
}

static void add_batch(void)
{
    add_words(batch.x, sizeof batch.x);
    add_words(batch.y, sizeof batch.y);
    add_words(batch.z, sizeof batch.z);
    add_words(batch.pdf, sizeof batch.pdf);
}

/* Blocks, and the facts of a table. */
static void add_kd_facts(const envsamp_kd *kd)
{
    envsamp_kd_info info;
    envsamp_kd_block block;
    int i;

    envsamp_kd_get_info(kd, &info);
    add_double(info.excess_variance);
    add_double(info.max_ratio);
    for (i = 0; i < info.block_count; i++) {
        envsamp_kd_get_block(kd, i, &block);
        add_words(&block, sizeof block);
    }
}

static void add_kd(const envsamp_image *map, const envsamp_kd_desc *desc)
{
    envsamp_sizes sizes;
    envsamp_buffer table, scratch;
    const envsamp_kd *kd;
    float uv[2], u[2];
    int i, inverts;

    bits_arena_used = 0;
    if (envsamp_kd_sizes(map, desc, &sizes)) {
        bits.failed = 1;
        return;
    }
    table = allot(sizes.table_bytes);
    scratch = allot(sizes.scratch_bytes);
    if (envsamp_kd_build(map, desc, table, scratch, &kd)) {
        bits.failed = 1;
        return;
    }
    add_kd_table(kd);
    for (i = 0; i < 4096; i++) {
        envsamp_sample s = envsamp_kd_sample(kd, u0_of(i), u1_of(i));

        envsamp_dir_to_uv(map->mapping, s.dir, uv);
        add_words(&s, sizeof s);
        add_float(envsamp_kd_pdf(kd, s.dir));
        add_words(uv, sizeof uv);
        inverts = envsamp_kd_invert(kd, s.dir, u) != 0;
        add_words(&inverts, sizeof inverts);
        if (inverts)
            add_words(u, sizeof u);
    }
    start_batch();
    envsamp_kd_sample_n(kd, BITS_SAMPLES, batch.u0, batch.u1, batch.x, batch.y, batch.z, batch.pdf);
    add_batch();
    envsamp_kd_pdf_n(kd, BITS_SAMPLES, batch.x, batch.y, batch.z, batch.pdf);
    add_words(batch.pdf, sizeof batch.pdf);
    add_kd_facts(kd);
}

static void add_cdf(const envsamp_image *map, const envsamp_cdf_desc *desc)
{
    envsamp_sizes sizes;
    envsamp_buffer table, scratch;
    envsamp_cdf_info info;
    const envsamp_cdf *cdf;
    float u[2];
    int i;

    bits_arena_used = 0;
    if (envsamp_cdf_sizes(map, desc, &sizes)) {
        bits.failed = 1;
        return;
    }
    table = allot(sizes.table_bytes);
    scratch = allot(sizes.scratch_bytes);
    if (envsamp_cdf_build(map, desc, table, scratch, &cdf)) {
        bits.failed = 1;
        return;
    }
    add_cdf_table(cdf);
    envsamp_cdf_get_info(cdf, &info);
    add_double(info.integral);
    add_double(info.excess_variance);
    start_batch();
    for (i = 0; i < BITS_SAMPLES; i++) {
        envsamp_sample s = envsamp_cdf_sample(cdf, batch.u0[i], batch.u1[i]);

        add_words(&s, sizeof s);
        add_float(envsamp_cdf_pdf(cdf, s.dir));
        envsamp_cdf_invert(cdf, s.dir, u);
        add_words(u, sizeof u);
    }
    envsamp_cdf_sample_n(cdf, BITS_SAMPLES, batch.u0, batch.u1, batch.x, batch.y, batch.z,
                         batch.pdf);
    add_batch();
    envsamp_cdf_pdf_n(cdf, BITS_SAMPLES, batch.x, batch.y, batch.z, batch.pdf);
    add_words(batch.pdf, sizeof batch.pdf);
}

/* Every mapping, both lookups, as they are, with compensation, and with an exponent. */
static void add_mappings(envsamp_image map, envsamp_kd_desc desc)
{
    envsamp_cdf_desc cdf = envsamp_cdf_defaults();
    int i, select;

    for (i = 0; i < 18; i++) {
        map.mapping = (envsamp_mapping)(i / 6);
        cdf.nearest = desc.nearest = !(i % 2);
        cdf.mis_compensation = desc.mis_compensation = i % 6 / 2 == 1 ? 0.02f : 0.0f;
        cdf.importance_exponent = desc.importance_exponent = i % 6 / 2 == 2 ? 1.5f : 0.0f;
        for (select = ENVSAMP_KD_WARP; select <= ENVSAMP_KD_FIT; select++) {
            desc.select = (envsamp_kd_select)select;
            add_kd(&map, &desc);
        }
        add_cdf(&map, &cdf);
    }
}

/* Every kernel and scan of halftones. */
static void add_halftones(const envsamp_image *map)
{
    static envsamp_texel texels[200];
    envsamp_halftone_desc desc;
    envsamp_sizes sizes;
    int i, count;

    for (i = 0; i < 48; i++) {
        desc.count = 1 + 4 * i;
        desc.kernel = (envsamp_kernel)(i % 6);
        desc.scan = (envsamp_scan)(i / 6 % 2);
        desc.once = !(i / 12 % 2);
        desc.seed = (uint32_t)(i / 24);
        bits_arena_used = 0;
        if (envsamp_halftone_sizes(map->width, map->height, &desc, &sizes)
            || envsamp_halftone(map->pixels, map->width, map->height, 0, &desc, texels, 200, &count,
                                allot(sizes.scratch_bytes))) {
            bits.failed = 1;
            return;
        }
        add_words(texels, (size_t)count * sizeof *texels);
    }
}

/* Every method of lights, of every mapping and number of channels, two sets of them interleaved. */
static void add_lights(envsamp_image map)
{
    static envsamp_light lights[200], turned[200];
    static uint8_t mask[96 * 48];
    envsamp_lights_desc desc = envsamp_lights_defaults();
    envsamp_lights_info info;
    envsamp_sizes sizes;
    envsamp_buffer scratch;
    float threshold;
    int i, k;

    for (i = 0; i < 54; i++) {
        map.mapping = (envsamp_mapping)(i % 3);
        map.channels = i / 3 % 3 + 1 + (i / 3 % 3 > 0);
        map.width = 96 / map.channels;
        desc.method = (envsamp_lights_method)(i / 9);
        desc.count = 3 + 22 * (i % 9);
        desc.percentile = i % 2 ? 0.5f : 0.98f;
        desc.lambda = i % 2 ? 0.5f : 3.0f;
        desc.seed = (uint32_t)i;
        bits_arena_used = 0;
        scratch = allot(4u << 20);      /* for any method, and for the mask */
        if (envsamp_lights_sizes(&map, &desc, &sizes) || sizes.scratch_bytes > scratch.bytes
            || envsamp_lights(&map, &desc, lights, 200, scratch, &info)
            || envsamp_lights_interleave(lights, desc.count, i % 4, 4, 0.1f, 7, turned)
            || envsamp_emissive_mask(&map, &desc, mask, scratch, &threshold)) {
            bits.failed = 1;
            return;
        }
        add_memory(mask, (size_t)map.width * (size_t)map.height);
        add_values(mask, (size_t)map.width * (size_t)map.height, 1);
        add_float(threshold);
        add_words(lights, (size_t)desc.count * sizeof *lights);
        add_words(turned, (size_t)desc.count * sizeof *turned);
        for (k = 0; k < 3; k++)
            add_double(info.integral[k]);
    }
}

static bits_hashes bits_run(void)
{
    static float pixels[96 * 48];
    envsamp_image map = { pixels, 96, 48, 1, 0, ENVSAMP_LATLONG };
    envsamp_kd_desc desc = envsamp_kd_defaults();
    uint32_t state = 1;
    int i, select, criterion, model;

    bits.memory = bits.values = 2166136261u;
    bits.failed = 0;
    for (i = 0; i < 96 * 48; i++) {
        state = state * 1664525u + 1013904223u;
        pixels[i] = (float)(state >> 8) / 16777216.0f + (i == 1234 ? 1e5f : 0.0f);
    }
    add_halftones(&map);
    add_lights(map);
    desc.block_count = 500;
    add_mappings(map, desc);
    desc.nearest = 1;
    for (select = ENVSAMP_KD_WARP; select <= ENVSAMP_KD_FIT; select++)
        for (criterion = 0; criterion <= ENVSAMP_KD_RANGE; criterion++)
            for (model = 0; model <= ENVSAMP_KD_POWER; model++) {
                desc.select = (envsamp_kd_select)select;
                desc.criterion = (envsamp_kd_criterion)criterion;
                desc.model = (envsamp_kd_model)model;
                add_kd(&map, &desc);
            }
    return bits;
}

#ifndef BITS_NO_MAIN
#include <stdio.h>

int main(void)
{
    const bits_hashes got = bits_run();

    if (got.failed) {
        printf("a build failed\n");
        return 1;
    }
    printf("%08lx %08lx\n", (unsigned long)got.memory, (unsigned long)got.values);
    return 0;
}
#endif
