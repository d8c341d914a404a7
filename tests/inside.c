/* Copies of the library's functions for this file alone: of the same header, by the same flags. */
#define ENVSAMP_STATIC
#define ENVSAMP_IMPLEMENTATION
#include "inside.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* ---- fields ---- */

typedef struct field { const char *name; size_t at; } field;

static size_t find(const field *fields, size_t count, const char *name)
{
    size_t i;

    for (i = 0; i < count; i++)
        if (!strcmp(fields[i].name, name))
            return fields[i].at;
    printf("Bail out! inside.c: no field %s\n", name);
    exit(1);
}

size_t inside_kd_at(const char *name)
{
#define FIELD(name) { #name, offsetof(envsamp_kd, name) }
    static const field fields[] = {
        FIELD(version), FIELD(bytes), FIELD(checksum), FIELD(select), FIELD(mapping),
        FIELD(width), FIELD(height), FIELD(block_count), FIELD(alias_shift), FIELD(grid_bits_x),
        FIELD(grid_bits_y), FIELD(tile_bits_x), FIELD(tile_bits_y), FIELD(bilinear),
        FIELD(fit_end), FIELD(alias_at), FIELD(nodes_at), FIELD(grid_at),
        FIELD(integral), FIELD(alpha), FIELD(fit_alpha), FIELD(mis_compensation), FIELD(spare),
        FIELD(criterion), FIELD(facing_count), FIELD(facing_at), { "end", sizeof(envsamp_kd) }
    };
#undef FIELD

    return find(fields, sizeof fields / sizeof fields[0], name);
}

size_t inside_cdf_at(const char *name)
{
#define FIELD(name) { #name, offsetof(envsamp_cdf, name) }
    static const field fields[] = {
        FIELD(bytes), FIELD(checksum), FIELD(mapping), FIELD(width), FIELD(height), FIELD(rows_at),
        FIELD(guide_at), FIELD(edges_at), FIELD(integral), FIELD(mis_compensation),
        FIELD(bilinear), FIELD(spare), { "end", sizeof(envsamp_cdf) }
    };
#undef FIELD

    return find(fields, sizeof fields / sizeof fields[0], name);
}

uint32_t inside_word(const void *table, size_t at)
{
    uint32_t word;

    memcpy(&word, (const char *)table + at, sizeof word);
    return word;
}

size_t inside_place(const void *table, size_t at)
{
    uint64_t place;

    memcpy(&place, (const char *)table + at, sizeof place);
    return (size_t)place;
}

void inside_seal(void *table, size_t bytes)
{
    envsamp__table head;

    memcpy(&head, table, sizeof head);
    head.checksum = head.bytes <= bytes ? envsamp__checksum(table) : 0;
    memcpy(table, &head, sizeof head);
}

/* ---- blocks of WARP ---- */

size_t inside_kd_cuts(const envsamp_kd *kd)
{
    return KD_RECORD_AT(kd_tile_count(kd));
}

int kd_tile_count(const envsamp_kd *kd)
{
    return 1 << (kd->tile_bits_x + kd->tile_bits_y);
}

kd_warp_block kd_tile(const envsamp_kd *kd, int tile)
{
    const char *base = (const char *)kd;
    const int column = tile & ((1 << kd->tile_bits_x) - 1), row = tile >> kd->tile_bits_x;
    kd_warp_block b;
    int axis;

    memcpy(b.edge, base + KD_RECORD_AT(tile), sizeof b.edge);
    memcpy(&b.link, base + KD_RECORD_AT(tile) + sizeof b.edge, sizeof b.link);
    b.tile = b.number = tile;
    b.depth = 0;
    for (axis = 0; axis < 2; axis++) {
        const double side = (double)(1 << (24 - (axis ? kd->tile_bits_y : kd->tile_bits_x)));

        b.low[axis] = (double)(axis ? row : column) * side;
        b.high[axis] = b.low[axis] + side;
    }
    return b;
}

/* One side of the cut that a link leads to. */
static kd_warp_block kd_side(const envsamp_kd *kd, const kd_warp_block *whole, int high)
{
    kd_warp_block b = *whole;
    envsamp__sample_node node;
    double at;
    int axis;

    memcpy(&node, (const char *)kd + (size_t)4 * (whole->link & ~KD_LINK), sizeof node);
    axis = signbit(node.cut) ? 1 : 0;
    at = fabs((double)node.cut) * (double)(1 << (24 - (axis ? kd->tile_bits_y : kd->tile_bits_x)));
    at += (double)(axis ? b.tile >> kd->tile_bits_x : b.tile & ((1 << kd->tile_bits_x) - 1))
        * (double)(1 << (24 - (axis ? kd->tile_bits_y : kd->tile_bits_x)));
    *(high ? &b.low[axis] : &b.high[axis]) = at;
    b.edge[2 * axis + (high ? 0 : 1)] = node.edge;
    b.link = node.child[high];
    b.depth++;
    if (high)
        b.number = kd_tile_count(kd)
                 + (int)((4 * (size_t)(whole->link & ~KD_LINK) - inside_kd_cuts(kd)) / sizeof node);
    return b;
}

int kd_warp_blocks(const envsamp_kd *kd, kd_warp_block *blocks, int room)
{
    int tile, count = 0;

    for (tile = 0; tile < kd_tile_count(kd); tile++) {
        kd_warp_block stack[KD_DEEPEST + 2];
        int top = 0;

        stack[top++] = kd_tile(kd, tile);
        while (top > 0) {
            const kd_warp_block b = stack[--top];

            if (!(b.link & KD_LINK)) {
                if (b.number < room)
                    blocks[b.number] = b;
                count++;
            } else if (top < KD_DEEPEST + 1) {
                stack[top++] = kd_side(kd, &b, 1);
                stack[top++] = kd_side(kd, &b, 0);
            }
        }
    }
    return count;
}

kd_warp_block kd_warp_at(const envsamp_kd *kd, double u0, double u1)
{
    const int column = (int)(u0 * (double)(1 << kd->tile_bits_x));
    const int row = (int)(u1 * (double)(1 << kd->tile_bits_y));
    kd_warp_block b = kd_tile(kd, (row << kd->tile_bits_x) + column);

    while (b.link & KD_LINK) {
        const kd_warp_block low = kd_side(kd, &b, 0), high = kd_side(kd, &b, 1);
        const int above = u0 * 16777216.0 >= high.low[0] && u1 * 16777216.0 >= high.low[1];

        b = above ? high : low;
    }
    return b;
}

/* ---- light x cosine ---- */

/* Weights of a node's 8 parts at [7], and above them the sums of pairs. */
static void facing_weights(const envsamp__facing_node *node, const double n[3], double sum[15])
{
    int i, k;

    for (i = 0; i < 8; i++) {
        const int side = i % 2, at = i / 2;
        double mean = 0.0, square = 0.0;

        for (k = 0; k < 3; k++) {
            mean += n[k] * (double)node->moment[k][side][at];
            square += n[k] * n[k] * (double)node->moment[3 + k][side][at];
            square += n[k == 2] * n[k == 0 ? 1 : 2] * (double)node->moment[6 + k][side][at];
        }
        sum[7 + i] = mean + sqrt(square);
    }
    for (i = 6; i >= 0; i--)
        sum[i] = sum[2 * i + 1] + sum[2 * i + 2];
}

/* One side of a cut, which has `share` of the whole. */
static inside_part facing_side(const inside_part *whole, float cut, int high, double share)
{
    const int axis = signbit(cut) ? 1 : 0;
    inside_part part = *whole;

    *(high ? &part.low[axis] : &part.high[axis]) = fabs((double)cut);
    part.start[axis] += high ? (1.0 - share) * part.size[axis] : 0.0;
    part.size[axis] *= share;
    part.depth++;
    return part;
}

int inside_facing(const envsamp_kd *kd, const double normal[3], int plain, inside_part *parts,
                  int room)
{
    const inside_part all = { { 0.0, 0.0 }, { 1.0, 1.0 }, { 0.0, 0.0 }, { 1.0, 1.0 }, 1.0, 0, 0 };
    int count = 0, next = 0, at, high;
    inside_part tree[15];

    memset(tree, 0, sizeof tree);
    tree[0] = all;
    tree[0].link = KD_LINK | kd->facing_at / 4;
    while (kd->facing_count > 0) {
        const envsamp__facing_node *node = ENVSAMP__LINKED(envsamp__facing_node, kd, tree[0].link);
        double sum[15];

        facing_weights(node, normal, sum);
        for (at = 0; at < 7; at++) {
            const int axis = signbit(node->cut[at]) ? 1 : 0;
            double whole = sum[at], side = sum[2 * at + 2];

            if (tree[at].depth == plain) {
                whole = tree[at].high[axis] - tree[at].low[axis];
                side = tree[at].high[axis] - fabs((double)node->cut[at]);
            }
            side = whole > 0.0 ? side / whole : 0.0;        /* of the higher one */
            for (high = 0; high < 2; high++)
                tree[2 * at + 1 + high] = facing_side(&tree[at], node->cut[at], high,
                                                      high ? side : 1.0 - side);
        }
        for (at = 7; at < 15 && count < room; at++) {
            tree[at].link = node->child[(at - 7) % 2][(at - 7) / 2];
            tree[at].weight = sum[at];
            if (tree[at].size[0] * tree[at].size[1] > 0.0)
                parts[count++] = tree[at];
        }
        while (next < count && !(parts[next].link & KD_LINK))
            next++;
        if (next == count)
            break;
        tree[0] = parts[next++];
    }
    return count;
}

/* ---- ALIAS ---- */

void inside_kd_edges(const envsamp_kd *kd, int block, float edge[4])
{
    memcpy(edge, (const char *)kd + KD_RECORD_AT(block), 4 * sizeof *edge);
}

int inside_alias_block(const envsamp_kd *kd, float u0, float u1)
{
    return envsamp__alias_choose(kd, u0, u1).block;
}

/* ---- cdf ---- */

const uint32_t *inside_row_edges(const envsamp_cdf *cdf)
{
    return ENVSAMP__ARRAY(uint32_t, cdf, row_edges);
}

const uint32_t *inside_edges(const envsamp_cdf *cdf, uint32_t row)
{
    return ENVSAMP__CDF_EDGES(ENVSAMP__ARRAY, cdf, row);
}

float inside_row_edge(const envsamp_cdf *cdf, uint32_t row)
{
    return envsamp__cdf_row_edge(ENVSAMP__ARRAY(envsamp__cdf_row, cdf, rows) + row);
}

inside_texel inside_draw(const envsamp_cdf *cdf, float u0, float u1)
{
    const uint32_t down = envsamp__draw(u1);
    const uint32_t row = envsamp__cdf_find_row(cdf, down);
    const inside_texel texel = { inside_search(cdf, row, row, envsamp__draw(u0)), row };

    return texel;
}

inside_texel inside_find(const envsamp_cdf *cdf, const float dir[3])
{
    const float r = ENVSAMP_SQRTF(dir[0] * dir[0] + dir[1] * dir[1]);
    const envsamp__cdf_texel at = envsamp__cdf_at(cdf, cdf->mapping == ENVSAMP_OCTAHEDRAL, dir[0],
                                                  dir[1], dir[2], r);
    const inside_texel texel = { at.column, at.row };

    return texel;
}

float inside_texel_pdf(const envsamp_cdf *cdf, uint32_t column, uint32_t row)
{
    const envsamp__cdf_texel at = { column, row, 1 };

    return envsamp__cdf_density(cdf, at);
}

uint32_t inside_search(const envsamp_cdf *cdf, uint32_t row, uint32_t guide, uint32_t draw)
{
    return envsamp__cdf_find(ENVSAMP__CDF_EDGES(ENVSAMP__ARRAY, cdf, row),
                             ENVSAMP__CDF_GUIDE(ENVSAMP__ARRAY, cdf, guide), cdf->guide_bits, draw);
}

/* ---- small math ---- */

void inside_sincos_pi(double x, double *sine, double *cosine)
{
    envsamp__sincos_pi(x, sine, cosine);
}

double inside_log2(double x)
{
    return envsamp__log2(x);
}

double inside_exp2(double x)
{
    return envsamp__exp2(x);
}

float inside_exp2m1(double x)
{
    return envsamp__exp2m1(x);
}

void inside_cos_sin_turn(float u, float *cosine, float *sine)
{
    envsamp__cos_sin_turn(u, cosine, sine);
}

float inside_turn(float y, float x)
{
    return envsamp__turn(y, x);
}

float inside_polar_fraction(float north, float south)
{
    return envsamp__polar_fraction(north, south);
}

double inside_random(uint32_t seed, uint32_t index)
{
    return envsamp__random(seed, index);
}

/* ---- mappings ---- */

void inside_octahedral_dir(const float uv[2], float dir[3])
{
    envsamp__octahedral_dir(uv[0], uv[1], &dir[0], &dir[1], &dir[2]);
}

void inside_octahedral_uv(const float dir[3], float uv[2])
{
    envsamp__octahedral_uv(dir[0], dir[1], dir[2], hypotf(dir[0], dir[1]), &uv[0], &uv[1]);
}

void inside_wrap(envsamp_mapping mapping, int width, int height, int *x, int *y)
{
    envsamp__wrap_texel(mapping, width, height, x, y);
}

/* ---- what a map brings about on small machines, or hardly ever ---- */

envsamp_result inside_set_sizes(envsamp_sizes *sizes, uint64_t table, uint64_t scratch)
{
    return envsamp__set_sizes(sizes, table, scratch);
}
