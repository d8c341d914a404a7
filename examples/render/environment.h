/* environment.h: a map placed in the world, and every way to draw light from it.
 *
 *     environment e;
 *     environment_make(&e, &map, 90.0f);                    turned by degrees about +z
 *     method by;
 *     if (!method_open(&by, "kd-warp+mis", &e, &options, error, sizeof error)) ...
 *     s = method_sample(&by, &e, axis, u);                  all directions are the world's
 *     pdf = method_pdf(&by, &e, axis, dir);
 *     environment_radiance(&e, dir, rgb);
 *     method_close(&by);
 *
 * A sampler is one row of light_samplers: a program that measures others makes rows of its own, and
 * a method of one with method_make.
 */
#ifndef RENDER_ENVIRONMENT_H
#define RENDER_ENVIRONMENT_H

#include "../../envsamp.h"
#include "../common/image.h"

/* The map is not copied. */
typedef struct environment {
    const image *map;
    envsamp_image view;
    float cosine, sine;              /* of the angle that the map is turned by */
} environment;

void environment_make(environment *e, const image *map, float degrees);

/* Directions of the world in the map, and back. In-place calls are allowed. */
void environment_into(const environment *e, const float world[3], float map[3]);
void environment_out_of(const environment *e, const float map[3], float world[3]);

/* Looked up bilinearly, as all tables here are made for. */
void environment_radiance(const environment *e, const float dir[3], float rgb[3]);

/* Of the tables. */
typedef struct sampler_options {
    float mis_compensation, importance_exponent;    /* as in envsamp_kd_desc and envsamp_cdf_desc */
    int block_count;                                /* of kd; 0: the default */
} sampler_options;

/* A way to draw directions of the map. Functions get what `prepare` made. axis: what the surface
   faces, in the map's space; only "facing" looks at it. */
typedef struct light_sampler {
    const char *name, *what;
    int (*prepare)(const environment *e, const sampler_options *options, void **table,
                   char *error, size_t error_size);
    envsamp_sample (*sample)(const void *table, const float axis[3], float u0, float u1);
    float (*pdf)(const void *table, const float axis[3], const float dir[3]);
    void (*release)(void *table);
} light_sampler;

/* A name of NULL at the end. "bsdf" has no functions: nothing is drawn from the map. */
extern const light_sampler light_samplers[];

/* A sampler with its table, alone or with MIS. */
typedef struct method {
    const light_sampler *by;
    int mis;                         /* each light sample has a BSDF sample beside it */
    void *table;
} method;

/* A name of light_samplers, or one with "+mis" behind it. Returns 0, with one line in `error`, for
   an unknown name and for what the library refuses. */
int method_open(method *m, const char *name, const environment *e, const sampler_options *options,
                char *error, size_t error_size);

/* The same for a sampler that is not in the list. */
int method_make(method *m, const light_sampler *by, int mis, const environment *e,
                const sampler_options *options, char *error, size_t error_size);
void method_close(method *m);

/* In directions of the world. */
envsamp_sample method_sample(const method *m, const environment *e, const float axis[3],
                             const float u[2]);
float method_pdf(const method *m, const environment *e, const float axis[3], const float dir[3]);

#endif
