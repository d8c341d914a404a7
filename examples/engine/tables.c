/* tables.c: see tables.h. */
#include "tables.h"

#include <stdlib.h>
#include <string.h>

envsamp_result tables_make(tables *t, const envsamp_image *image, envsamp_row_fn row, void *user,
                           const envsamp_kd_desc *desc)
{
    envsamp_sizes sizes;
    envsamp_result result = envsamp_kd_sizes(image, desc, &sizes);
    int i;

    memset(t, 0, sizeof *t);
    t->image = *image;
    t->row = row;
    t->user = user;
    t->desc = *desc;
    for (i = 0; i < 2; i++) {
        t->table[i].data = malloc(t->table[i].bytes = sizes.table_bytes);
        if (t->table[i].data)           /* the first touch of memory takes time */
            memset(t->table[i].data, 0, sizes.table_bytes);
    }
    t->scratch.data = malloc(t->scratch.bytes = sizes.scratch_bytes);
    if (result == ENVSAMP_OK && !(t->table[0].data && t->table[1].data && t->scratch.data))
        result = ENVSAMP_ERR_MEMORY;
    if (result != ENVSAMP_OK)
        tables_free(t);
    return result;
}

void tables_free(tables *t)
{
    free(t->table[0].data);
    free(t->table[1].data);
    free(t->scratch.data);
    memset(t, 0, sizeof *t);
}

envsamp_result tables_begin(tables *t, int frame)
{
    t->job_frame = frame;
    return envsamp_kd_begin(&t->image, t->row, t->user, &t->desc, t->table[t->back], t->scratch,
                            &t->job);
}

envsamp_result tables_step(tables *t, int count, int *done)
{
    return envsamp_kd_step(t->job, count, done);
}

envsamp_result tables_swap(tables *t)
{
    const envsamp_kd *kd;
    envsamp_result result = envsamp_kd_finish(t->job, &kd);

    t->job = NULL;
    if (result != ENVSAMP_OK)
        return result;
    t->shown = kd;
    t->shown_frame = t->job_frame;
    t->back = !t->back;
    return ENVSAMP_OK;
}
