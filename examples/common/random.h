/* random.h: random numbers and low-discrepancy points for examples, tests and measurements.
 *
 *     pcg32 random = pcg32_make(42, 0);
 *     float x = pcg32_float(&random);        in [0, 1), 24 bits
 *     float u[2];
 *     pcg32_dir(&random, dir);               evenly over the sphere
 *     sobol_owen(index, seed, u);            point `index` of the sequence that `seed` picks
 *
 * The same numbers on every machine and compiler.
 */
#ifndef RANDOM_H
#define RANDOM_H

#include <math.h>
#include <stdint.h>

/* PCG32: a 64-bit linear congruential generator with a permuted output. [O'Neill, PCG: A family
 * of simple fast space-efficient statistically good algorithms, 2014] */
typedef struct pcg32 {
    uint64_t state, increment;
} pcg32;

static inline uint32_t pcg32_next(pcg32 *random)
{
    const uint64_t old = random->state;
    const uint32_t mixed = (uint32_t)(((old >> 18) ^ old) >> 27);
    const uint32_t turn = (uint32_t)(old >> 59);

    random->state = old * 6364136223846793005u + random->increment;
    return (mixed >> turn) | (mixed << ((32u - turn) & 31u));
}

/* Different streams give unrelated sequences, whatever their seeds. */
static inline pcg32 pcg32_make(uint64_t seed, uint64_t stream)
{
    pcg32 random;

    random.state = 0;
    random.increment = (stream << 1) | 1u;
    pcg32_next(&random);
    random.state += seed;
    pcg32_next(&random);
    return random;
}

/* The top 24 bits as a fraction: every value is exact in a float, and none rounds up to 1. */
static inline float unit_float(uint32_t bits)
{
    return (float)(bits >> 8) * (1.0f / 16777216.0f);
}

static inline float pcg32_float(pcg32 *random)
{
    return unit_float(pcg32_next(random));
}

static inline void pcg32_dir(pcg32 *random, float dir[3])
{
    const float z = 1.0f - 2.0f * pcg32_float(random), r = sqrtf(fmaxf(1.0f - z * z, 0.0f));
    const float phi = 6.2831853f * pcg32_float(random);

    dir[0] = r * cosf(phi);
    dir[1] = r * sinf(phi);
    dir[2] = z;
}

/* A bijection of 32 bits in which each input bit flips about half of the output bits.
 * Constants: Wellons, Prospecting for hash functions, 2018. */
static inline uint32_t hash_u32(uint32_t x)
{
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    x ^= x >> 16;
    return x;
}

static inline uint32_t hash_combine(uint32_t seed, uint32_t value)
{
    return hash_u32(seed * 0x9e3779b9u + hash_u32(value));
}

static inline uint32_t reverse_bits(uint32_t x)
{
    x = (x << 16) | (x >> 16);
    x = ((x & 0x00ff00ffu) << 8) | ((x >> 8) & 0x00ff00ffu);
    x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
    x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
    return ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
}

/* Owen's nested uniform scramble, with a hash in place of a random tree: in the reversed number
 * each step lets a bit depend only on the bits below it, so in `x` only on the bits above it.
 * [Burley, Practical hash-based Owen scrambling, JCGT 2020; multipliers by Vegdahl, 2021] */
static inline uint32_t owen_scramble(uint32_t x, uint32_t seed)
{
    x = reverse_bits(x);
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return reverse_bits(x);
}

/* Second coordinate of Sobol's sequence: Pascal's triangle modulo 2 times the index's bits. */
static inline uint32_t sobol_second(uint32_t index)
{
    uint32_t column = 0x80000000u, result = 0;

    for (; index; index >>= 1, column ^= column >> 1)
        result ^= column & (0u - (index & 1u));
    return result;
}

/* The order of the points is scrambled as well, so that the points of two seeds can be paired
 * into four dimensions. Every aligned run of 2^k points still hits each box of area 2^-k once. */
static inline void sobol_owen(uint32_t index, uint32_t seed, float u[2])
{
    const uint32_t shuffled = owen_scramble(index, hash_combine(seed, 0));

    u[0] = unit_float(owen_scramble(reverse_bits(shuffled), hash_combine(seed, 1)));
    u[1] = unit_float(owen_scramble(sobol_second(shuffled), hash_combine(seed, 2)));
}

#endif
