#!/bin/sh
# The same map gives the same tables, samples, halftones and lights, bit for bit, with every compiler
# here, C and C++, at every optimisation level, as long as arithmetic is not contracted; and, where
# there are cross compilers and qemu, on other machines.
cd "$(dirname "$0")/.." || exit 1
tmp=$(mktemp -d) || exit 1
trap 'rm -rf "$tmp"' EXIT
count=0
want=

cat >"$tmp/bits.c" <<'PROGRAM'
#define ENVSAMP_IMPLEMENTATION
#include "envsamp.h"
#include <stdio.h>
#include <stdlib.h>

static uint32_t hash = 2166136261u;

static void add(const void *data, size_t bytes)
{
    const unsigned char *byte = (const unsigned char *)data;
    size_t i;

    for (i = 0; i < bytes; i++)
        hash = (hash ^ byte[i]) * 16777619u;
}

/* Samples and densities in batches: bits of their own, if a compiler does them otherwise. */
static void add_batch(const envsamp_kd *kd)
{
    static float u0[1000], u1[1000], x[1000], y[1000], z[1000], pdf[1000];
    int i;

    for (i = 0; i < 1000; i++) {
        u0[i] = (float)(i * 2654435761u >> 8) / 16777216.0f;
        u1[i] = (float)(i * 40503u % 65536u) / 65536.0f;
    }
    envsamp_kd_sample_n(kd, 1000, u0, u1, x, y, z, pdf);
    add(x, sizeof x);
    add(y, sizeof y);
    add(z, sizeof z);
    add(pdf, sizeof pdf);
    envsamp_kd_pdf_n(kd, 1000, x, y, z, pdf);
    add(pdf, sizeof pdf);
}

/* Blocks, and the facts of a table. */
static void add_blocks(const envsamp_kd *kd)
{
    envsamp_kd_info info;
    envsamp_kd_block block;
    int i;

    envsamp_kd_get_info(kd, &info);
    add(&info.excess_variance, sizeof info.excess_variance);
    add(&info.max_ratio, sizeof info.max_ratio);
    for (i = 0; i < info.block_count; i++) {
        envsamp_kd_get_block(kd, i, &block);
        add(&block, sizeof block);
    }
}

static void build(const envsamp_image *map, const envsamp_kd_desc *desc)
{
    envsamp_sizes sizes;
    envsamp_buffer table, scratch;
    const envsamp_kd *kd;
    float uv[2], u[2];
    int i, inverts;

    if (envsamp_kd_sizes(map, desc, &sizes))
        exit(1);
    table.data = malloc(table.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    if (envsamp_kd_build(map, desc, table, scratch, &kd))
        exit(1);
    add(kd, envsamp_kd_bytes(kd));
    for (i = 0; i < 4096; i++) {
        envsamp_sample s = envsamp_kd_sample(kd, (float)(i * 2654435761u >> 8) / 16777216.0f,
                                             (float)(i * 40503u % 65536u) / 65536.0f);
        float pdf = envsamp_kd_pdf(kd, s.dir);

        envsamp_dir_to_uv(map->mapping, s.dir, uv);
        add(&s, sizeof s);
        add(&pdf, sizeof pdf);
        add(uv, sizeof uv);
        inverts = envsamp_kd_invert(kd, s.dir, u);
        add(&inverts, sizeof inverts);
        if (inverts)
            add(u, sizeof u);
    }
    add_batch(kd);
    add_blocks(kd);
    free(table.data);
    free(scratch.data);
}

static void build_cdf(const envsamp_image *map, const envsamp_cdf_desc *desc)
{
    static float u0[1000], u1[1000], x[1000], y[1000], z[1000], pdf[1000];
    envsamp_sizes sizes;
    envsamp_buffer table, scratch;
    envsamp_cdf_info info;
    const envsamp_cdf *cdf;
    float u[2];
    int i;

    if (envsamp_cdf_sizes(map, desc, &sizes))
        exit(1);
    table.data = malloc(table.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    if (envsamp_cdf_build(map, desc, table, scratch, &cdf))
        exit(1);
    add(cdf, envsamp_cdf_bytes(cdf));
    envsamp_cdf_get_info(cdf, &info);
    add(&info.integral, sizeof info.integral);
    add(&info.excess_variance, sizeof info.excess_variance);
    for (i = 0; i < 1000; i++) {
        envsamp_sample s;

        u0[i] = (float)(i * 2654435761u >> 8) / 16777216.0f;
        u1[i] = (float)(i * 40503u % 65536u) / 65536.0f;
        s = envsamp_cdf_sample(cdf, u0[i], u1[i]);
        add(&s, sizeof s);
        pdf[0] = envsamp_cdf_pdf(cdf, s.dir);
        add(pdf, sizeof pdf[0]);
        envsamp_cdf_invert(cdf, s.dir, u);
        add(u, sizeof u);
    }
    envsamp_cdf_sample_n(cdf, 1000, u0, u1, x, y, z, pdf);
    add(x, sizeof x);
    add(y, sizeof y);
    add(z, sizeof z);
    add(pdf, sizeof pdf);
    envsamp_cdf_pdf_n(cdf, 1000, x, y, z, pdf);
    add(pdf, sizeof pdf);
    free(table.data);
    free(scratch.data);
}

/* Every mapping, bilinear or not, with and without compensation. */
static void build_mappings(envsamp_image map, envsamp_kd_desc desc)
{
    envsamp_cdf_desc cdf = envsamp_cdf_defaults();
    int i, select;

    for (i = 0; i < 12; i++) {
        map.mapping = (envsamp_mapping)(i / 4);
        cdf.nearest = desc.nearest = !(i % 2);
        cdf.mis_compensation = desc.mis_compensation = i % 4 / 2 ? 0.5f : 0.0f;
        for (select = ENVSAMP_KD_WARP; select <= ENVSAMP_KD_FIT; select++) {
            desc.select = (envsamp_kd_select)select;
            build(&map, &desc);
        }
        build_cdf(&map, &cdf);
    }
}

/* Every kernel, scan and method of lights; lights of every mapping and number of channels, two sets
   of them interleaved. */
static void choose(envsamp_image map)
{
    static envsamp_texel texels[200];
    static envsamp_light lights[200], turned[200];
    static uint8_t mask[96 * 48];
    envsamp_halftone_desc halftone;
    envsamp_lights_desc desc = envsamp_lights_defaults();
    envsamp_lights_info info;
    envsamp_sizes sizes;
    envsamp_buffer scratch;
    float threshold;
    int i, count;

    scratch.data = malloc(scratch.bytes = 16 << 20);
    for (i = 0; i < 48; i++) {
        halftone.count = 1 + 4 * i;
        halftone.kernel = (envsamp_kernel)(i % 6);
        halftone.scan = (envsamp_scan)(i / 6 % 2);
        halftone.once = !(i / 12 % 2);
        halftone.seed = (uint32_t)(i / 24);
        if (envsamp_halftone(map.pixels, map.width, map.height, 0, &halftone, texels, 200, &count,
                             scratch))
            exit(1);
        add(texels, (size_t)count * sizeof *texels);
    }
    for (i = 0; i < 54; i++) {
        map.mapping = (envsamp_mapping)(i % 3);
        map.channels = i / 3 % 3 + 1 + (i / 3 % 3 > 0);
        map.width = 96 / map.channels;
        desc.method = (envsamp_lights_method)(i / 9);
        desc.count = 3 + 22 * (i % 9);
        desc.percentile = i % 2 ? 0.5f : 0.98f;
        desc.lambda = i % 2 ? 0.5f : 3.0f;
        desc.seed = (uint32_t)i;
        if (envsamp_lights_sizes(&map, &desc, &sizes)
            || envsamp_lights(&map, &desc, lights, 200, scratch, &info)
            || envsamp_lights_interleave(lights, desc.count, i % 4, 4, 0.1f, 7, turned)
            || envsamp_emissive_mask(&map, &desc, mask, scratch, &threshold))
            exit(1);
        add(mask, (size_t)map.width * (size_t)map.height);
        add(&threshold, sizeof threshold);
        add(lights, (size_t)desc.count * sizeof *lights);
        add(turned, (size_t)desc.count * sizeof *turned);
        add(info.integral, sizeof info.integral);
    }
    free(scratch.data);
}

int main(void)
{
    static float pixels[96 * 48];
    envsamp_image map = { pixels, 96, 48, 1, 0, ENVSAMP_LATLONG };
    envsamp_kd_desc desc = envsamp_kd_defaults();
    uint32_t state = 1;
    int i, select, criterion, model;

    for (i = 0; i < 96 * 48; i++) {
        state = state * 1664525u + 1013904223u;
        pixels[i] = (float)(state >> 8) / 16777216.0f + (i == 1234 ? 1e5f : 0.0f);
    }
    choose(map);
    desc.block_count = 500;
    build_mappings(map, desc);
    desc.nearest = 1;
    for (select = ENVSAMP_KD_WARP; select <= ENVSAMP_KD_FIT; select++)
        for (criterion = 0; criterion <= ENVSAMP_KD_RANGE; criterion++)
            for (model = 0; model <= ENVSAMP_KD_POWER; model++) {
                desc.select = (envsamp_kd_select)select;
                desc.criterion = (envsamp_kd_criterion)criterion;
                desc.model = (envsamp_kd_model)model;
                build(&map, &desc);
            }
    printf("%08x\n", hash);
    return 0;
}
PROGRAM
cp "$tmp/bits.c" "$tmp/bits.cpp"

run=        # what runs programs of another machine

agrees() {  # file, compiler and flags
    file=$1
    shift
    count=$((count + 1))
    for tool in "$1" ${run:+"$run"}; do
        if ! command -v "$tool" >/dev/null 2>&1; then
            echo "ok $count # SKIP no $tool here"
            return
        fi
    done
    got=$("$@" -w -I. "$tmp/$file" -o "$tmp/bits" -lm && $run "$tmp/bits")
    want=${want:-$got}
    [ -n "$got" ] && [ "$got" = "$want" ] && result=ok || result="not ok"
    echo "$result $count - $* gives $got, wanted $want"
}

agrees bits.c gcc -std=c99 -O0
agrees bits.c gcc -std=c99 -O1
agrees bits.c gcc -std=c99 -O2
agrees bits.c gcc -std=c99 -O3 -march=native
agrees bits.c gcc -std=c99 -Os -DENVSAMP_STATIC
agrees bits.c clang -std=c99 -ffp-contract=off -O0
agrees bits.c clang -std=c99 -ffp-contract=off -O2
agrees bits.c clang -std=c99 -ffp-contract=off -O3 -march=native
agrees bits.cpp g++ -std=c++11 -ffp-contract=off -O2
agrees bits.cpp g++ -std=c++11 -ffp-contract=off -O3 -march=native
agrees bits.cpp clang++ -std=c++11 -ffp-contract=off -O3
agrees bits.c i686-linux-gnu-gcc -static -std=c99 -O2 -msse2 -mfpmath=sse
run=qemu-aarch64
agrees bits.c aarch64-linux-gnu-gcc -static -std=c99 -O2
echo "1..$count"
