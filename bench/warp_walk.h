/* warp_walk.h: the way down a WARP table, by its format alone (@kd-table of envsamp.h).
 *
 * Include it after the implementation of envsamp.h.
 */
#ifndef WARP_WALK_H
#define WARP_WALK_H

/* A block as a walk reaches it. Places in the unit square are those of the block's own tile. */
typedef struct warp_leaf {
    uint32_t tile;
    uint64_t path;          /* one bit a cut, and a leading 1: names the block within the tile */
    int cuts;
    float cut[4], edge[4];  /* x0, x1, y0, y1: in the tile's unit square, in the map */
} warp_leaf;

typedef struct warp_cuts {
    double expected;        /* cuts below a tile that a sample meets */
    int deepest;
} warp_cuts;

static inline uint32_t warp_tile_count(const envsamp_kd *kd)
{
    return 1u << (kd->tile_bits_x + kd->tile_bits_y);
}

static inline void warp_take(const envsamp__sample_node *node, int high, warp_leaf *leaf)
{
    const int axis = envsamp__sign(node->cut), side = 2 * axis + 1 - high;

    leaf->cut[side] = ENVSAMP_FABSF(node->cut);
    leaf->edge[side] = node->edge;
    leaf->path = 2 * leaf->path + (uint64_t)high;
    leaf->cuts++;
}

static inline warp_leaf warp_enter(const envsamp_kd *kd, uint32_t tile)
{
    warp_leaf leaf = { 0, 1, 0, { 0.0f, 1.0f, 0.0f, 1.0f }, { 0.0f, 0.0f, 0.0f, 0.0f } };

    leaf.tile = tile;
    memcpy(leaf.edge, ENVSAMP__RECORDS(kd)[tile].edge, sizeof leaf.edge);
    return leaf;
}

/* The tile of (u0, u1), both in [0, 1), and the place in it. */
static inline uint32_t warp_tile_of(const envsamp_kd *kd, const float u[2], float f[2])
{
    const float across = u[0] * (float)(1 << kd->tile_bits_x);
    const float down = u[1] * (float)(1 << kd->tile_bits_y);

    f[0] = across - (float)(uint32_t)across;
    f[1] = down - (float)(uint32_t)down;
    return ((uint32_t)down << kd->tile_bits_x) + (uint32_t)across;
}

static inline int warp_is_high(const envsamp__sample_node *node, const float f[2])
{
    return f[envsamp__sign(node->cut)] >= ENVSAMP_FABSF(node->cut);
}

/* The block that (u0, u1) draws. */
static inline warp_leaf warp_locate(const envsamp_kd *kd, const float u[2])
{
    float f[2];
    warp_leaf leaf = warp_enter(kd, warp_tile_of(kd, u, f));
    uint32_t link = ENVSAMP__RECORDS(kd)[leaf.tile].link;

    while (link & ENVSAMP__INNER) {
        const envsamp__sample_node *node = ENVSAMP__LINKED(envsamp__sample_node, kd, link);
        const int high = warp_is_high(node, f);

        warp_take(node, high, &leaf);
        link = node->child[high];
    }
    return leaf;
}

/* What a sample of (u0, u1) reads besides the header, in turn. Returns how often, 64 at most. */
static inline int warp_reads(const envsamp_kd *kd, const float u[2], const void *read[64],
                             size_t bytes[64])
{
    float f[2];
    const uint32_t tile = warp_tile_of(kd, u, f);
    uint32_t link = ENVSAMP__RECORDS(kd)[tile].link;
    int count = 1;

    read[0] = ENVSAMP__RECORDS(kd) + tile;
    bytes[0] = sizeof(envsamp__record);
    while (link & ENVSAMP__INNER && count < 64) {
        const envsamp__sample_node *node = ENVSAMP__LINKED(envsamp__sample_node, kd, link);

        read[count] = node;
        bytes[count++] = sizeof *node;
        link = node->child[warp_is_high(node, f)];
    }
    return count;
}

static inline void warp_count_below(const envsamp_kd *kd, uint32_t link, const warp_leaf *at,
                                    warp_cuts *cuts)
{
    int high;

    if (!(link & ENVSAMP__INNER)) {
        cuts->expected += at->cuts * ((double)at->cut[1] - (double)at->cut[0])
                        * ((double)at->cut[3] - (double)at->cut[2]);
        cuts->deepest = at->cuts > cuts->deepest ? at->cuts : cuts->deepest;
        return;
    }
    for (high = 0; high < 2; high++) {
        const envsamp__sample_node *node = ENVSAMP__LINKED(envsamp__sample_node, kd, link);
        warp_leaf child = *at;

        warp_take(node, high, &child);
        warp_count_below(kd, node->child[high], &child, cuts);
    }
}

static inline warp_cuts warp_count_cuts(const envsamp_kd *kd)
{
    warp_cuts cuts = { 0.0, 0 };
    uint32_t tile;

    for (tile = 0; tile < warp_tile_count(kd); tile++) {
        const warp_leaf top = warp_enter(kd, tile);

        warp_count_below(kd, ENVSAMP__RECORDS(kd)[tile].link, &top, &cuts);
    }
    cuts.expected /= (double)warp_tile_count(kd);
    return cuts;
}

#endif
