/* lights_fixture.h: sets of lights for tests, in buffers of just the size asked for, with canaries.
 *
 *     light_set s;
 *     if (set_make(&s, &view, &desc)) ... s.lights, s.info ...
 *     set_free(&s);
 *
 * Include it after the implementation of envsamp.h.
 */
#ifndef LIGHTS_FIXTURE_H
#define LIGHTS_FIXTURE_H

#include "kd_fixture.h"

#define RUBBISH 0xc3

typedef struct light_set {
    envsamp_image view;
    envsamp_lights_desc desc;
    envsamp_sizes sizes;
    kd_guarded scratch, block;
    envsamp_light *lights;
    envsamp_lights_info info;
    envsamp_result result;
} light_set;

/* Whether there are lights; s->result says why not. Free the set in either case. */
static inline int set_make_over(light_set *s, const envsamp_image *view,
                         const envsamp_lights_desc *desc, int rubbish)
{
    memset(s, 0, sizeof *s);
    s->view = *view;
    s->desc = *desc;
    s->result = envsamp_lights_sizes(view, desc, &s->sizes);
    s->scratch = kd_guarded_make(s->sizes.scratch_bytes, rubbish);
    s->block = kd_guarded_make(s->result ? 0 : (size_t)desc->count * sizeof *s->lights, 0x5a);
    s->lights = (envsamp_light *)s->block.buffer.data;
    if (s->result == ENVSAMP_OK)
        s->result = envsamp_lights(view, desc, s->lights, desc->count, s->scratch.buffer,
                                   &s->info);
    return s->result == ENVSAMP_OK;
}

static inline int set_make(light_set *s, const envsamp_image *view, const envsamp_lights_desc *desc)
{
    return set_make_over(s, view, desc, RUBBISH);
}

static inline int set_intact(const light_set *s)
{
    return kd_guarded_intact(&s->scratch) && kd_guarded_intact(&s->block);
}

static inline void set_free(light_set *s)
{
    free(s->scratch.block);
    free(s->block.block);
}

static inline int sets_equal(const light_set *a, const light_set *b)
{
    return a->desc.count == b->desc.count && a->result == b->result
        && !memcmp(a->lights, b->lights, (size_t)a->desc.count * sizeof *a->lights);
}

#endif
