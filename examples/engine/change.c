/* change.c: see change.h. */
#include "change.h"

#include <math.h>
#include <string.h>

#define PI 3.14159265358979

/* Spread over the sphere along a spiral. */
static void make_normals(double normals[CHANGE_NORMALS][3])
{
    int k;

    for (k = 0; k < CHANGE_NORMALS; k++) {
        const double z = 1.0 - (2.0 * k + 1.0) / CHANGE_NORMALS, level = sqrt(1.0 - z * z);
        const double turn = PI * (3.0 - sqrt(5.0)) * k;

        normals[k][0] = level * cos(turn);
        normals[k][1] = level * sin(turn);
        normals[k][2] = z;
    }
}

static void add(double normals[CHANGE_NORMALS][3], const float dir[3], double light,
                double irradiance[CHANGE_NORMALS])
{
    int k;

    for (k = 0; k < CHANGE_NORMALS; k++) {
        const double cosine = normals[k][0] * (double)dir[0] + normals[k][1] * (double)dir[1]
                            + normals[k][2] * (double)dir[2];

        irradiance[k] += cosine > 0.0 ? light * cosine : 0.0;
    }
}

void change_of_map(const envsamp_image *map, double irradiance[CHANGE_NORMALS])
{
    double normals[CHANGE_NORMALS][3];
    float dir[3];
    int x, y;

    make_normals(normals);
    memset(irradiance, 0, CHANGE_NORMALS * sizeof *irradiance);
    for (y = 0; y < map->height; y++) {
        const double sr = 4.0 * PI / map->width * sin(0.5 * PI / map->height)
                        * sin(PI * (y + 0.5) / map->height);

        for (x = 0; x < map->width; x++) {
            envsamp_uv_to_dir(ENVSAMP_LATLONG, ((float)x + 0.5f) / (float)map->width,
                              ((float)y + 0.5f) / (float)map->height, dir);
            add(normals, dir, sr * (double)envsamp_luminance(map->pixels
                                                             + 3 * (y * map->width + x)),
                irradiance);
        }
    }
}

void change_of_lights(const envsamp_light *lights, int count, double irradiance[CHANGE_NORMALS])
{
    double normals[CHANGE_NORMALS][3];
    int i;

    make_normals(normals);
    memset(irradiance, 0, CHANGE_NORMALS * sizeof *irradiance);
    for (i = 0; i < count; i++)
        add(normals, lights[i].dir, (double)envsamp_luminance(lights[i].irradiance), irradiance);
}

void change_add(change *c, const double irradiance[CHANGE_NORMALS])
{
    double most = 0.0, step = 0.0;
    int k;

    for (k = 0; k < CHANGE_NORMALS; k++) {
        most = fmax(most, irradiance[k]);
        step = fmax(step, fabs(irradiance[k] - c->before[k]));
        c->before[k] = irradiance[k];
    }
    if (c->frames++ > 0 && most > 0.0)
        c->worst = fmax(c->worst, step / most);
}
