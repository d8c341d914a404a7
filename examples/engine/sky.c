/* sky.c: see sky.h. */
#include "sky.h"
#include "random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LATITUDE 0.96f          /* how high the sun rises, in radians */
#define DISC_RADIUS 0.0087f     /* half a degree */

/* ---- clouds ---- */

static float lattice(int x, int y, int period, uint32_t seed)
{
    return unit_float(hash_combine(hash_combine(seed, (uint32_t)(x % period)), (uint32_t)y));
}

/* Smooth noise of `period` cells round the horizon. */
static float noise(float u, float v, int period)
{
    const float x = u * (float)period, y = 0.5f * v * (float)period;
    const int x0 = (int)x, y0 = (int)y;
    float s = x - (float)x0, t = y - (float)y0, a, b;

    s *= s * (3.0f - 2.0f * s);
    t *= t * (3.0f - 2.0f * t);
    a = lattice(x0, y0, period, (uint32_t)period);
    a += s * (lattice(x0 + 1, y0, period, (uint32_t)period) - a);
    b = lattice(x0, y0 + 1, period, (uint32_t)period);
    b += s * (lattice(x0 + 1, y0 + 1, period, (uint32_t)period) - b);
    return a + t * (b - a);
}

static float cover(float u, float v)
{
    float sum = 0.0f, size = 0.5f;
    int octave;

    for (octave = 0; octave < 5; octave++, size *= 0.5f)
        sum += size * noise(u, v, 6 << octave);
    return fminf(fmaxf(4.0f * (sum - 0.48f), 0.0f), 1.0f);
}

int sky_make(sky *s, int width, int height, int channels)
{
    int x, y;

    memset(s, 0, sizeof *s);
    s->view.width = width;
    s->view.height = height;
    s->view.channels = channels;
    s->view.mapping = ENVSAMP_LATLONG;
    s->clouds = malloc((size_t)width * (size_t)height * sizeof *s->clouds);
    s->across = malloc((size_t)width * sizeof *s->across);
    if (!s->clouds || !s->across) {
        sky_free(s);
        return 0;
    }
    for (y = 0; y < height; y++)
        for (x = 0; x < width; x++)
            s->clouds[(size_t)y * (size_t)width + (size_t)x] =
                cover(((float)x + 0.5f) / (float)width, ((float)y + 0.5f) / (float)height);
    return 1;
}

void sky_free(sky *s)
{
    free(s->clouds);
    free(s->across);
    s->clouds = s->across = NULL;
}

/* ---- the sun ---- */

static float texel_sr(const sky *s, int y)
{
    const float tall = SKY_PI / (float)s->view.height;

    return 4.0f * SKY_PI / (float)s->view.width * sinf(0.5f * tall)
         * sinf(((float)y + 0.5f) * tall);
}

/* Shares a part of the light among the four texels round a point, by nearness. */
static void add_part(sky *s, const float dir[3], float part)
{
    float uv[2], x, y;
    int i;

    envsamp_dir_to_uv(ENVSAMP_LATLONG, dir, uv);
    x = uv[0] * (float)s->view.width - 0.5f - (float)s->left;
    x += x < 0.0f ? (float)s->view.width : 0.0f;        /* across the seam */
    y = uv[1] * (float)s->view.height - 0.5f - (float)s->top;
    for (i = 0; i < 4; i++) {
        const int column = (int)x + i % 2, row = (int)y + i / 2;
        const float across = 1.0f - fabsf(x - (float)column);
        const float down = 1.0f - fabsf(y - (float)row);

        if (column < SKY_DISC && row < SKY_DISC)
            s->disc[row][column] += part * across * down / texel_sr(s, s->top + row);
    }
}

/* The disc as a square of points, brightest in its middle and fading towards its edge. */
static void draw_disc(sky *s)
{
    const float height = (float)s->view.height, width = (float)s->view.width;
    const float level = sqrtf(fmaxf(1.0f - s->sun[2] * s->sun[2], 1e-6f));
    const float tall = DISC_RADIUS / SKY_PI * height;           /* radius in rows and columns */
    const float wide = DISC_RADIUS / (2.0f * SKY_PI * level) * width;
    const int side = 8 + (int)(8.0f * fmaxf(tall, wide));       /* points from middle to edge */
    float uv[2], total = 0.0f;
    int x, y, pass;

    envsamp_dir_to_uv(ENVSAMP_LATLONG, s->sun, uv);
    s->left = (int)floorf(uv[0] * width - wide) - 2;
    s->left += s->left < 0 ? s->view.width : 0;
    s->top = (int)(uv[1] * height - tall) - 2;
    memset(s->disc, 0, sizeof s->disc);
    for (pass = 0; pass < 2; pass++)
        for (y = -side; y <= side; y++)
            for (x = -side; x <= side; x++) {
                const float a = DISC_RADIUS * (float)x / (float)side;
                const float b = DISC_RADIUS * (float)y / (float)side;
                const float away = (float)(x * x + y * y) / (float)(side * side);
                const float rest = fmaxf(1.0f - away, 0.0f);
                const float dir[3] = {
                    s->sun[0] - (a * s->sun[1] + b * s->sun[0] * s->sun[2]) / level,
                    s->sun[1] + (a * s->sun[0] - b * s->sun[1] * s->sun[2]) / level,
                    s->sun[2] + b * level
                };

                if (pass == 0)
                    total += rest * rest;
                else if (rest > 0.0f)
                    add_part(s, dir, rest * rest / total);
            }
}

/* Low light is dimmer and redder. Below the horizon there is no sun, and soon hardly a sky. */
void sky_set(sky *s, float angle)
{
    static const float thickness[3] = { 0.08f, 0.14f, 0.28f };
    float rise, azimuth;
    int c, x;

    s->sun[0] = cosf(angle);
    s->sun[1] = sinf(angle) * cosf(LATITUDE);
    s->sun[2] = sinf(angle) * sinf(LATITUDE);
    rise = fminf(fmaxf(10.0f * s->sun[2] + 0.5f, 0.0f), 1.0f);
    for (c = 0; c < 3; c++)
        s->irradiance[c] = 25.0f * rise * expf(-thickness[c] / (fmaxf(s->sun[2], 0.0f) + 0.05f));
    s->day = 0.002f + fminf(fmaxf(s->sun[2] + 0.1f, 0.0f), 0.998f);
    azimuth = atan2f(s->sun[1], s->sun[0]);
    for (x = 0; x < s->view.width; x++)
        s->across[x] = cosf(2.0f * SKY_PI * ((float)x + 0.5f) / (float)s->view.width - azimuth);
    draw_disc(s);
}

/* ---- rows ---- */

static void add_disc(const sky *s, int y, float *row)
{
    const int width = s->view.width;
    const float luminance = envsamp_luminance(s->irradiance);
    int x, c;

    if (y < s->top || y >= s->top + SKY_DISC)
        return;
    for (x = 0; x < SKY_DISC; x++) {
        const float part = s->disc[y - s->top][x];
        float *texel = row + s->view.channels * ((s->left + x) % width);

        for (c = 0; c < s->view.channels && part > 0.0f; c++)
            texel[c] += part * (s->view.channels == 1 ? luminance : s->irradiance[c]);
    }
}

/* Colours of a row: of clear air, or of the ground, and of the glow round the sun. */
static void row_colours(const sky *s, float up, float air[3], float glow[3])
{
    static const float zenith[3] = { 0.25f, 0.5f, 1.0f }, horizon[3] = { 0.9f, 1.0f, 1.1f };
    static const float ground[3] = { 0.06f, 0.05f, 0.04f };
    const float low = powf(1.0f - fabsf(up), 4.0f), sun = 0.3f * fmaxf(s->sun[2], 0.0f);
    int c;

    for (c = 0; c < 3; c++) {
        air[c] = up > 0.0f ? s->day * (zenith[c] + low * (horizon[c] - zenith[c]))
                           : ground[c] * (s->day + sun * s->irradiance[c]);
        glow[c] = up > 0.0f ? 4e-4f * s->irradiance[c] : 0.0f;
    }
    if (s->view.channels == 1) {
        air[0] = envsamp_luminance(air);
        glow[0] = envsamp_luminance(glow);
    }
}

envsamp_result sky_row(int y, float *row, void *user)
{
    const sky *s = user;
    const float theta = SKY_PI * ((float)y + 0.5f) / (float)s->view.height, up = cosf(theta);
    const float level = sinf(theta) * sqrtf(fmaxf(1.0f - s->sun[2] * s->sun[2], 0.0f));
    const float *clouds = s->clouds + (size_t)y * (size_t)s->view.width;
    const int channels = s->view.channels;
    float air[3], glow[3];
    int x, c;

    row_colours(s, up, air, glow);
    for (x = 0; x < s->view.width; x++) {
        const float cloud = up > 0.0f ? clouds[x] : 0.0f;
        const float away = 1.02f - (s->across[x] * level + up * s->sun[2]);
        const float near = (1.0f + cloud) / (away * away);

        for (c = 0; c < channels; c++)
            row[channels * x + c] = (1.0f - 0.5f * cloud) * air[c] + 0.8f * s->day * cloud
                                  + glow[c] * near;
    }
    add_disc(s, y, row);
    return ENVSAMP_OK;
}
