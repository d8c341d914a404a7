/* change.c: see change.h. */
#include "change.h"
#include "light_sums.h"

#include <math.h>
#include <string.h>

static void make_normals(double normals[CHANGE_NORMALS][3])
{
    int k;

    for (k = 0; k < CHANGE_NORMALS; k++)
        light_sums_normal(k * (LIGHT_SUMS_NORMALS / CHANGE_NORMALS), normals[k]);
}

static void add(double normals[CHANGE_NORMALS][3], const double dir[3], double light,
                double irradiance[CHANGE_NORMALS])
{
    int k;

    for (k = 0; k < CHANGE_NORMALS; k++)
        irradiance[k] += light * fmax(light_sums_dot(normals[k], dir), 0.0);
}

void change_of_map(const envsamp_image *map, double irradiance[CHANGE_NORMALS])
{
    double normals[CHANGE_NORMALS][3], dir[3], rgb[3];
    int x, y;

    make_normals(normals);
    memset(irradiance, 0, CHANGE_NORMALS * sizeof *irradiance);
    for (y = 0; y < map->height; y++)
        for (x = 0; x < map->width; x++) {
            light_sums_texel(map, x, y, dir, rgb);
            add(normals, dir, 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2], irradiance);
        }
}

void change_of_lights(const envsamp_light *lights, int count, double irradiance[CHANGE_NORMALS])
{
    double normals[CHANGE_NORMALS][3];
    int i;

    make_normals(normals);
    memset(irradiance, 0, CHANGE_NORMALS * sizeof *irradiance);
    for (i = 0; i < count; i++) {
        const double dir[3] = { (double)lights[i].dir[0], (double)lights[i].dir[1],
                                (double)lights[i].dir[2] };

        add(normals, dir, (double)envsamp_luminance(lights[i].irradiance), irradiance);
    }
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
