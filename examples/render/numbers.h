/* numbers.h: the random numbers of one path: pairs, each for a purpose of its own.
 *
 *     numbers n = numbers_make(independent, pixel_seed, sample);
 *     numbers_pair(&n, NUMBERS_LIGHT, depth, u);
 *
 * Owen-scrambled Sobol points in two dimensions, padded: every pair has a scramble of its own, and
 * over the samples of a pixel every pair is well spread. Or numbers of a hash, all independent.
 */
#ifndef RENDER_NUMBERS_H
#define RENDER_NUMBERS_H

#include "../common/random.h"

enum { NUMBERS_PIXEL, NUMBERS_LIGHT, NUMBERS_BSDF, NUMBERS_ROULETTE, NUMBERS_PURPOSES };

typedef struct numbers {
    int independent;
    uint32_t seed, sample;           /* seed: of the pixel */
} numbers;

static inline numbers numbers_make(int independent, uint32_t seed, uint32_t sample)
{
    numbers n;

    n.independent = independent;
    n.seed = seed;
    n.sample = sample;
    return n;
}

static inline void numbers_pair(const numbers *n, int purpose, int depth, float u[2])
{
    const uint32_t pair = (uint32_t)(depth * NUMBERS_PURPOSES + purpose);
    uint32_t bits;

    if (!n->independent) {
        sobol_owen(n->sample, hash_combine(n->seed, pair), u);
        return;
    }
    bits = hash_combine(hash_combine(n->seed, n->sample), pair);
    u[0] = unit_float(hash_u32(bits ^ 0x5bd1e995u));
    u[1] = unit_float(hash_u32(bits + 0x9e3779b9u));
}

#endif
