/* stage.h: a scene under a map, with two references, to judge pictures of it by.
 *
 *     stage s;
 *     if (!stage_open(&s, &config, "city", &map, "vase", 1, error, sizeof error)) ...
 *     seconds = stage_render(&s, &method, 16, 0, seed, &picture);
 *     stage_judge(&s, &picture, value);
 *     stage_close(&s);
 *
 * References are by light x cosine with MIS; both are kept in a folder, so that they are rendered
 * once. Errors are against both, so that their own noise cancels.
 */
#ifndef STAGE_H
#define STAGE_H

#include "../examples/common/filtered.h"
#include "../examples/render/integrator.h"

#include <stddef.h>

/* The name of a scene that is not the renderer's: a sphere of anisotropic Ward (0.5, 0.001), that
   of [Ergun et al. 2012], figure 7. */
#define STAGE_WARD "ward"

/* What is rendered, and how much of it. */
typedef struct stage_config {
    const char *folder;              /* of the references */
    int width, height, threads;
    uint32_t reference_samples;
} stage_config;

typedef struct stage {
    const stage_config *config;
    environment environment;
    scene *scene;
    int bounces;
    image a, b, mean;                /* the references, and the mean of them */
    double level;                    /* mean of all channels of the mean */
    float exposure;
} stage;

enum { STAGE_RELATIVE, STAGE_TRIMMED, STAGE_PSNR, STAGE_FLIP, STAGE_ERRORS };

int stage_open(stage *s, const stage_config *config, const char *map_name, const image *map,
               const char *scene_name, int bounces, char *error, size_t error_size);
void stage_close(stage *s);

/* Renders `count` samples a pixel. Returns seconds of processor time, or -1 if memory is short. */
double stage_render(const stage *s, const method *by, uint32_t count, int independent,
                    uint32_t seed, image *out);

/* The same by filtered importance sampling: `count` samples of the BSDF, each with a lookup in the
   map's level that its density calls for, and a shadow ray. Direct light, biased. */
double stage_render_filtered(const stage *s, const filtered *levels, float bias, uint32_t count,
                             uint32_t seed, image *out);

/* Relative RMSE; root of the relative MSE without the worst 0.2 % of pixels; PSNR in dB; FLIP. */
void stage_judge(const stage *s, const image *picture, double error[STAGE_ERRORS]);

#endif
