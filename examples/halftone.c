/* halftone.c: all directions of a point at once, by error diffusion over light x cosine, and how
 * not to lose the sun.
 *
 * The sphere is cut into 32 x 32 parts, of which envsamp_halftone chooses 32, evenly and as often
 * as each is worth. A part is 6 degrees wide, the sun of this sky 1. What stands for a part?
 *
 *   middle   one lookup in the middle of it: the sun is missed, or all of the part is sun
 *   mean     the mean light of it, seen in the middle: good where all of the part is seen; where a
 *            wall hides half of the sun, all of it is there or nothing
 *   within   the mean chooses the part, and light chooses a direction within it
 *
 * Prints the relative error of the ground's irradiance over 32 suns, all seen and half hidden.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"
#include "common/random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define PI 3.14159265f
#define SIDE 32
#define FINE 16                      /* cells of a part, each way */
#define SAMPLES 32
#define SUNS 32
#define SUN_RADIUS 0.0087f           /* half a degree */
#define SUN_RADIANCE 20000.0f        /* over that of the sky */

enum { MIDDLE, MEAN, WITHIN, WAY_COUNT };

typedef struct sky { float sun[3]; int half_hidden; } sky;

/* A place on a square of equal area, in parts. */
static void direction(int part, float x, float y, float dir[3])
{
    envsamp_uv_to_dir(ENVSAMP_OCTAHEDRAL, ((float)(part % SIDE) + x) / SIDE,
                      ((float)(part / SIDE) + y) / SIDE, dir);
}

static float light(const sky *s, const float dir[3])
{
    const float cosine = s->sun[0] * dir[0] + s->sun[1] * dir[1] + s->sun[2] * dir[2];

    return 1.0f + SUN_RADIANCE * expf(2.0f * (cosine - 1.0f) / (SUN_RADIUS * SUN_RADIUS));
}

/* Cosine of the ground, where no wall is in the way: one that hides half of the sky, up to the
   middle of the sun. */
static float seen(const sky *s, const float dir[3])
{
    const int hidden = s->half_hidden && s->sun[0] * dir[1] < s->sun[1] * dir[0];

    return hidden ? 0.0f : fmaxf(dir[2], 0.0f);
}

static double exact(const sky *s)
{
    const float sun = SUN_RADIANCE * PI * SUN_RADIUS * SUN_RADIUS * s->sun[2];

    return (double)((PI + sun) * (s->half_hidden ? 0.5f : 1.0f));
}

/* The mean light of a part, by cells. */
static float look_into(const sky *s, int part, float cells[FINE * FINE])
{
    float sum = 0.0f, dir[3];

    for (int k = 0; k < FINE * FINE; k++) {
        direction(part, ((float)(k % FINE) + 0.5f) / FINE, ((float)(k / FINE) + 0.5f) / FINE, dir);
        sum += cells[k] = light(s, dir);
    }
    return sum / (FINE * FINE);
}

/* What a part gives: light x cosine x solid angle, of a cell drawn in proportion to light. */
static float draw_within(const sky *s, int part, pcg32 *random)
{
    float cells[FINE * FINE], dir[3], x, y;
    const float mean = look_into(s, part, cells);
    float left = pcg32_float(random) * mean * (FINE * FINE);
    int k = 0;

    while (k < FINE * FINE - 1 && left >= cells[k])
        left -= cells[k++];
    x = ((float)(k % FINE) + pcg32_float(random)) / FINE;
    y = ((float)(k / FINE) + pcg32_float(random)) / FINE;
    direction(part, x, y, dir);
    return light(s, dir) * seen(s, dir) * mean / cells[k] * 4.0f * PI / (SIDE * SIDE);
}

static double estimate(const sky *s, int way, pcg32 *random, envsamp_buffer scratch)
{
    envsamp_halftone_desc desc = { SAMPLES, ENVSAMP_KERNEL_SZIRMAY, 1, ENVSAMP_SCAN_CELLS, 0 };
    float importance[SIDE * SIDE], value[SIDE * SIDE], cells[FINE * FINE], dir[3];
    envsamp_texel texels[SAMPLES];
    int count = 0;
    double sum = 0.0;

    for (int i = 0; i < SIDE * SIDE; i++) {
        direction(i, 0.5f, 0.5f, dir);
        value[i] = (way == MIDDLE ? light(s, dir) : look_into(s, i, cells)) * 4.0f * PI
                 / (SIDE * SIDE);
        importance[i] = value[i] * fmaxf(dir[2] + 0.05f, 0.0f);     /* above 0 where light is */
        value[i] *= seen(s, dir);
    }
    desc.seed = pcg32_next(random) | 1u;                            /* the use begins here */
    envsamp_halftone(importance, SIDE, SIDE, 0, &desc, texels, SAMPLES, &count, scratch);
    for (int i = 0; i < count; i++) {
        const int part = SIDE * texels[i].y + texels[i].x;
        const float worth = way == WITHIN ? draw_within(s, part, random) : value[part];

        sum += (double)worth / ((double)count * (double)texels[i].probability);
    }
    return sum;
}

static double error_of(int way, int half_hidden, envsamp_buffer scratch)
{
    pcg32 random = pcg32_make(7, 0);
    double squares = 0.0;

    for (int i = 0; i < SUNS; i++) {
        const float phi = 2.0f * PI * pcg32_float(&random), z = 0.3f + 0.6f * pcg32_float(&random);
        const float level = sqrtf(1.0f - z * z);
        const sky s = { { level * cosf(phi), level * sinf(phi), z }, half_hidden };
        const double off = estimate(&s, way, &random, scratch) / exact(&s) - 1.0;

        squares += off * off / SUNS;
    }
    return sqrt(squares);
}

int main(void)
{
    static const char *const names[WAY_COUNT] = { "middle", "mean", "within" };
    envsamp_halftone_desc desc = { SAMPLES, ENVSAMP_KERNEL_SZIRMAY, 1, ENVSAMP_SCAN_CELLS, 0 };
    envsamp_buffer scratch;
    envsamp_sizes sizes;

    envsamp_halftone_sizes(SIDE, SIDE, &desc, &sizes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    printf("32 samples   sun seen   half of it\n");
    for (int way = 0; way < WAY_COUNT && scratch.data; way++)
        printf("%-10s %10.4f %12.4f\n", names[way], error_of(way, 0, scratch),
               error_of(way, 1, scratch));
    free(scratch.data);
    return 0;
}
