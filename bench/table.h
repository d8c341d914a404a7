/* table.h: a map as the library takes it, and a kd table of it, for bench programs.
 *
 *     envsamp_image view = bench_view(&map);
 *     bench_table t;
 *     if (bench_table_build(&t, &view, &desc)) ... t.kd, t.info ...
 *     bench_table_free(&t);
 *
 * A program that is out of memory ends. Include it after envsamp.h.
 */
#ifndef BENCH_TABLE_H
#define BENCH_TABLE_H

#include "../examples/common/image.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Zeroed bytes. */
static inline void *bench_allocate(size_t bytes)
{
    void *block = calloc(bytes ? bytes : 1, 1);

    if (!block) {
        fprintf(stderr, "not enough memory\n");
        exit(1);
    }
    return block;
}

/* A lat-long map of three channels. */
static inline envsamp_image bench_view(const image *map)
{
    const envsamp_image view = { map->rgb, map->width, map->height, 3, 0, ENVSAMP_LATLONG };

    return view;
}

typedef struct bench_table {
    envsamp_buffer memory, scratch;
    envsamp_result result;
    const envsamp_kd *kd;
    envsamp_kd_info info;
} bench_table;

/* Whether it was built; t->result says why not. To be freed in either case. */
static inline int bench_table_build(bench_table *t, const envsamp_image *view,
                                    const envsamp_kd_desc *desc)
{
    envsamp_sizes sizes;

    memset(t, 0, sizeof *t);
    t->result = envsamp_kd_sizes(view, desc, &sizes);
    if (t->result != ENVSAMP_OK)
        return 0;
    t->memory.data = bench_allocate(t->memory.bytes = sizes.table_bytes);
    t->scratch.data = bench_allocate(t->scratch.bytes = sizes.scratch_bytes);
    t->result = envsamp_kd_build(view, desc, t->memory, t->scratch, &t->kd);
    if (t->result == ENVSAMP_OK)
        envsamp_kd_get_info(t->kd, &t->info);
    return t->result == ENVSAMP_OK;
}

static inline void bench_table_free(bench_table *t)
{
    free(t->memory.data);
    free(t->scratch.data);
    memset(t, 0, sizeof *t);
}

#endif
