/* coarse.h: numbers of few bits, and how bright samplers draw a sky with them.
 *
 *     coarse_sky sky = coarse_sky_make(1);
 *     sampler_request request = coarse_ask(SAMPLER_ALIAS, &sky, 6144);
 *     ... coarse_mean(&s, &sky, COARSE_U0, 12, 1 << 20) is 1, but for noise ...
 *     coarse_sky_free(&sky);
 */
#ifndef COARSE_H
#define COARSE_H

#include "sampler.h"
#include "../examples/common/maps.h"

/* Of `bits` bits, or as many points. */
typedef enum coarse_set {
    COARSE_U0 = 0,              /* u0 = i/N, again and again, u1 random */
    COARSE_U1,                  /* u1 = i/N, u0 random */
    COARSE_BOTH,                /* both random, of so many bits */
    COARSE_HAMMERSLEY,          /* i/N and van der Corput's sequence */
    COARSE_TURNED,              /* the other way round */
    COARSE_SOBOL,               /* Sobol's first two, not scrambled */
    COARSE_SETS
} coarse_set;

static const char *const coarse_names[COARSE_SETS] = {
    "u0 = i/N", "u1 = i/N", "both", "Hammersley", "turned", "Sobol"
};

static inline void coarse_numbers(coarse_set set, int bits, uint32_t i, pcg32 *random, float u[2])
{
    const uint32_t count = 1u << bits;
    const float steps = (float)(i % count) / (float)count, corput = unit_float(reverse_bits(i));
    const float a = pcg32_float(random), b = pcg32_float(random);

    u[0] = set == COARSE_U1 ? a : steps;
    u[1] = set == COARSE_U0 ? b : set == COARSE_HAMMERSLEY ? corput : steps;
    if (set == COARSE_BOTH) {
        u[0] = (float)(int)(a * (float)count) / (float)count;
        u[1] = (float)(int)(b * (float)count) / (float)count;
    } else if (set == COARSE_TURNED || set == COARSE_SOBOL) {
        u[0] = corput;
        u[1] = set == COARSE_SOBOL ? unit_float(sobol_second(i)) : steps;
    }
}

/* A sky that is brighter above; or one with noise in it, so that all texels differ, and a sun,
   which has most of the light and is hidden. The first is for bilinear lookups. */
typedef struct coarse_sky {
    image map;
    envsamp_image view;
    int sun;
    double truth;               /* with a sun: the integral of the rest; else of 1 */
} coarse_sky;

static inline int coarse_in_sun(const coarse_sky *sky, int x, int y)
{
    return sky->sun && x / 2 == sky->map.width / 6 && y / 2 == sky->map.height / 6;
}

static inline coarse_sky coarse_sky_make(int sun)
{
    pcg32 random = pcg32_make(92, 0);
    coarse_sky sky;
    int x, y, c;

    memset(&sky, 0, sizeof sky);
    sky.sun = sun;
    if (!map_make("constant", 512, 256, &sky.map))
        return sky;
    for (y = 0; y < sky.map.height; y++)
        for (x = 0; x < sky.map.width; x++) {
            const int hidden = coarse_in_sun(&sky, x, y);
            const float noise = sun ? 0.8f + 0.4f * pcg32_float(&random) : 1.0f;
            const float value = (1.0f - 0.7f * (float)y / (float)sky.map.height) * noise;

            for (c = 0; c < 3; c++)
                sky.map.rgb[3 * (y * sky.map.width + x) + c] = hidden ? 1e5f : value;
            sky.truth += (hidden ? 0.0 : sun ? (double)value : 1.0)
                       * kd_solid_angle(sky.map.width, sky.map.height, 0, y, 1, y + 1);
        }
    sky.view = kd_image(sky.map.rgb, sky.map.width, sky.map.height, 3);
    return sky;
}

static inline sampler_request coarse_ask(int kind, const coarse_sky *sky, int blocks)
{
    sampler_request request = sampler_ask(kind, &sky->view, blocks);

    request.bilinear = !sky->sun;
    return request;
}

static inline void coarse_sky_free(coarse_sky *sky)
{
    image_free(&sky->map);
}

/* What a sample sees: 1, or, with a sun, the sky but for the sun. */
static inline double coarse_value(const coarse_sky *sky, const envsamp_sample *s)
{
    const int x = (int)(s->uv[0] * (float)sky->map.width);
    const int y = (int)fminf(s->uv[1] * (float)sky->map.height, (float)(sky->map.height - 1));

    if (!sky->sun)
        return 1.0;
    return coarse_in_sun(sky, x, y) ? 0.0
                                    : (double)sky->map.rgb[3 * (y * sky->map.width + x)];
}

/* How bright the sky is drawn, of what it is: the mean of value/pdf over so many samples. */
static inline double coarse_mean(const sampler *s, const coarse_sky *sky, coarse_set set, int bits,
                                 int samples)
{
    pcg32 random = pcg32_make(91, (uint64_t)(8 * bits + (int)set));
    double sum = 0.0;
    int i;

    for (i = 0; i < samples; i++) {
        envsamp_sample sample;
        float u[2];

        coarse_numbers(set, bits, (uint32_t)i, &random, u);
        sample = sampler_draw(s, u[0], u[1]);
        sum += coarse_value(sky, &sample) / (double)sample.pdf;
    }
    return sum / (double)samples / sky->truth;
}

#endif
