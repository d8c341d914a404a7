/* lights.c: a map as K directional lights, as text or as a glTF scene (KHR_lights_punctual).
 *
 *     lights MAP K OUTPUT
 *
 * MAP is a file, or a made-up map by name (see common/maps.h). OUTPUT is glTF if it ends in .gltf,
 * else text: of each light the direction towards it, and the irradiance of a surface that faces it.
 * Both are in the world of three.js, with y up. A light of glTF shines along -z of its node, with
 * its irradiance as intensity. "-" is standard output.
 */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"
#include "common/image.h"
#include "common/maps.h"
#include "common/placement.h"

#include <stdio.h>
#include <stdlib.h>

/* ---- the lights ---- */

static envsamp_result make_lights(const envsamp_image *map, int count, envsamp_light *lights)
{
    envsamp_lights_desc desc = envsamp_lights_defaults();
    envsamp_buffer scratch;
    envsamp_sizes sizes;
    envsamp_result result;

    desc.count = count;
    result = envsamp_lights_sizes(map, &desc, &sizes);
    if (result != ENVSAMP_OK)
        return result;
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    result = envsamp_lights(map, &desc, lights, count, scratch, NULL);
    free(scratch.data);
    return result;
}

/* From the map's world to that of the engine. */
static void place_lights(const envsamp_image *map, envsamp_light *lights, int count)
{
    environment e = environment_make(NULL, map);
    float dir[3];

    environment_place(&e, "three.js");
    for (int i = 0; i < count; i++) {
        memcpy(dir, lights[i].dir, sizeof dir);
        environment_to_world(&e, dir, lights[i].dir);
    }
}

/* ---- files ---- */

static void write_text(FILE *file, const envsamp_light *lights, int count)
{
    fprintf(file, "# direction towards the light, irradiance: red, green, blue\n");
    for (int i = 0; i < count; i++)
        for (int k = 0; k < 6; k++)
            fprintf(file, "%.7g%c", k < 3 ? (double)lights[i].dir[k]
                                          : (double)lights[i].irradiance[k - 3], " \n"[k == 5]);
}

/* The turn that takes -z to where a light shines, as x y z w: half way between both. */
static void quaternion(const float dir[3], double q[4])
{
    const double length = sqrt(2.0 + 2.0 * (double)dir[2]);

    q[0] = length > 1e-6 ? -(double)dir[1] / length : 1.0;
    q[1] = length > 1e-6 ? (double)dir[0] / length : 0.0;
    q[2] = 0.0;
    q[3] = 0.5 * length;
}

static void write_gltf(FILE *file, const envsamp_light *lights, int count)
{
    fprintf(file, "{\"asset\": {\"version\": \"2.0\"},\n\"extensionsUsed\": "
                  "[\"KHR_lights_punctual\"],\n\"scene\": 0,\n\"scenes\": [{\"nodes\": [");
    for (int i = 0; i < count; i++)
        fprintf(file, "%s%d", i ? ", " : "", i);
    fprintf(file, "]}],\n\"extensions\": {\"KHR_lights_punctual\": {\"lights\": [\n");
    for (int i = 0; i < count; i++) {
        const float *rgb = lights[i].irradiance;
        const double most = fmax((double)fmaxf(fmaxf(rgb[0], rgb[1]), rgb[2]), 1e-30);

        fprintf(file, "{\"type\": \"directional\", \"intensity\": %.6g, \"color\": "
                      "[%.6g, %.6g, %.6g]}%s\n", most, (double)rgb[0] / most,
                (double)rgb[1] / most, (double)rgb[2] / most, i + 1 < count ? "," : "");
    }
    fprintf(file, "]}},\n\"nodes\": [\n");
    for (int i = 0; i < count; i++) {
        double q[4];

        quaternion(lights[i].dir, q);
        fprintf(file, "{\"rotation\": [%.7f, %.7f, %.7f, %.7f], \"extensions\": "
                      "{\"KHR_lights_punctual\": {\"light\": %d}}}%s\n",
                q[0], q[1], q[2], q[3], i, i + 1 < count ? "," : "");
    }
    fprintf(file, "]}\n");
}

static int write_lights(const char *path, const envsamp_light *lights, int count, char *error)
{
    const size_t length = strlen(path);
    char temporary[IMAGE_PATH_MAX];
    const int standard = !strcmp(path, "-");
    FILE *file = stdout;

    if (!standard && !image_temporary_path(path, temporary, error, 512))
        return 0;
    if (!standard && !(file = fopen(temporary, "w")))
        return image_fail(error, 512, path, "cannot be created");
    if (length > 5 && !strcmp(path + length - 5, ".gltf"))
        write_gltf(file, lights, count);
    else
        write_text(file, lights, count);
    if (standard || (!ferror(file) && fclose(file) == 0))
        return standard || image_publish(temporary, path, error, 512);
    remove(temporary);
    return image_fail(error, 512, path, "cannot be written in full");
}

int main(int argc, char **argv)
{
    const int count = argc == 4 ? atoi(argv[2]) : 0;
    char error[512] = "usage: lights MAP K OUTPUT";
    image map = { 0, 0, NULL };
    envsamp_light *lights = NULL;
    int good = 0;

    if (count > 0 && count <= 65536 && (map_make(argv[1], 512, 256, &map)
                                        || image_read(argv[1], &map, error, sizeof error))) {
        const envsamp_image view = { map.rgb, map.width, map.height, 3, 0, ENVSAMP_LATLONG };
        envsamp_result result = ENVSAMP_ERR_NULL;

        lights = (envsamp_light *)malloc((size_t)count * sizeof *lights);
        if (lights)
            result = make_lights(&view, count, lights);
        image_fail(error, sizeof error, argv[1], "%s", envsamp_result_string(result));
        if (result == ENVSAMP_OK) {
            place_lights(&view, lights, count);
            good = write_lights(argv[3], lights, count, error);
        }
    }
    if (!good)
        fprintf(stderr, "%s\n", error);
    free(lights);
    image_free(&map);
    return !good;
}
