/* test_coarse.c: numbers of few bits draw a sky as bright as it is: N values of one number beside
 * random ones of the other, random numbers of few bits, and point sets that are not scrambled; and
 * the way in which ALIAS once chose, which must be seen to fail.
 */
#include "check.h"

#include "../envsamp.h"

#include "coarse.h"

#define BOUND 0.01
#define SAMPLES (1 << 19)       /* noise of 0.0004; with a sun 8 times as many, and 0.002 */

static const int counts[2] = { 6144, 16384 };

static void test_set(const sampler *s, const coarse_sky *sky, coarse_set set, int bits)
{
    const int samples = set > COARSE_BOTH ? 1 << bits : sky->sun ? 8 * SAMPLES : SAMPLES;
    const double mean = coarse_mean(s, sky, set, bits, samples);

    CHECK(fabs(mean - 1.0) <= BOUND, "%s, %d blocks, %s, 2^%d: the sky is %.4f of what it is",
          sampler_names[s->request.kind], s->request.blocks, coarse_names[set], bits, mean);
}

/* ALIAS, of whose point sets those of 2^16 points have too little noise to hide a fault. */
static void test_alias(const coarse_sky *sky, int blocks)
{
    const sampler_request request = coarse_ask(SAMPLER_ALIAS, sky, blocks);
    int set, bits;
    sampler s;

    CHECK(sampler_make(&s, &request) && (int)KD_WORD(s.kd, block_count) == blocks,
          "%s sun, %d blocks", sky->sun ? "a" : "no", blocks);
    for (set = 0; s.result == ENVSAMP_OK && set < COARSE_SETS; set++)
        for (bits = set <= COARSE_BOTH ? 8 : sky->sun ? 16 : 12; bits <= 16; bits += 2)
            test_set(&s, sky, (coarse_set)set, bits);
    sampler_free(&s);
}

/* The others, with as many bits as the header says. */
static void test_other(const coarse_sky *sky, int kind, int blocks, int bits)
{
    const sampler_request request = coarse_ask(kind, sky, blocks);
    int set;
    sampler s;

    if (sampler_make(&s, &request))
        for (set = 0; set <= COARSE_BOTH; set++)
            test_set(&s, sky, (coarse_set)set, bits);
    sampler_free(&s);
}

/* ---- rules that must be rejected ---- */

static uint32_t table_word(const envsamp_kd *kd, uint32_t at, uint32_t index)
{
    uint32_t value;

    memcpy(&value, (const char *)kd + at + 4 * index, sizeof value);
    return value;
}

/* The bin from u0, and what is left of it for the choice; or, `by_u1`, u1. Without an order. */
static double mean_by_rule(const sampler *s, int by_u1, int bits)
{
    const uint32_t shift = (uint32_t)KD_WORD(s->kd, alias_shift), room = 1u << shift;
    pcg32 random = pcg32_make(93, (uint64_t)bits);
    double sum = 0.0;
    int i;

    for (i = 0; i < SAMPLES; i++) {
        uint32_t draw, at, entry, own, pdf_bits;
        float u[2], pdf;

        coarse_numbers(COARSE_BOTH, bits, (uint32_t)i, &random, u);
        draw = (uint32_t)(u[0] * 16777216.0f);
        entry = table_word(s->kd, (uint32_t)KD_WORD(s->kd, alias_at), draw >> shift);
        own = entry >> (24 - shift);
        at = by_u1 ? (uint32_t)(u[1] * (float)room) : draw & (room - 1);
        at = at < own ? draw >> shift : entry & ((1u << (24 - shift)) - 1);
        pdf_bits = table_word(s->kd, (uint32_t)KD_RECORD_AT(at) + 16, 0);
        memcpy(&pdf, &pdf_bits, sizeof pdf);
        sum += 1.0 / (double)pdf;
    }
    return sum / (double)SAMPLES / (4.0 * KD_PI);
}

static void test_rules(const coarse_sky *sky, int blocks)
{
    const sampler_request request = coarse_ask(SAMPLER_ALIAS, sky, blocks);
    double by_u0 = 1.0, by_u1 = 1.0, fine = 0.0;
    sampler s;

    if (sampler_make(&s, &request)) {
        by_u0 = mean_by_rule(&s, 0, 12);
        by_u1 = mean_by_rule(&s, 1, 8);
        fine = mean_by_rule(&s, 0, 24);
    }
    CHECK(fabs(by_u0 - 1.0) > 5.0 * BOUND, "rejected: %d blocks, %s sun, bins and choice from u0, "
          "12 bits: %.4f", blocks, sky->sun ? "a" : "no", by_u0);
    if (blocks == 16384)
        CHECK(fabs(by_u1 - 1.0) > BOUND, "rejected: %d blocks, %s sun, bins from u0, "
              "choice from u1, 8 bits: %.4f", blocks, sky->sun ? "a" : "no", by_u1);
    CHECK(fabs(fine - 1.0) <= BOUND, "but 24 bits draw %.4f of what it is", fine);
    sampler_free(&s);
}

int main(void)
{
    int i;

    for (i = 0; i < 4; i++) {
        coarse_sky sky = coarse_sky_make(i / 2);

        test_alias(&sky, counts[i % 2]);
        test_rules(&sky, counts[i % 2]);
        test_other(&sky, SAMPLER_WARP, counts[i % 2], 10);
        test_other(&sky, SAMPLER_FIT, counts[i % 2], 12);
        if (i % 2)
            test_other(&sky, SAMPLER_CDF, 0, 10);
        coarse_sky_free(&sky);
    }
    return check_done();
}
