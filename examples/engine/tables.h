/* tables.h: two tables, of which one is sampled while the other is built in steps.
 *
 *     tables t;
 *     if (tables_make(&t, &sky.view, sky_row, &sky, &desc) != ENVSAMP_OK) return 1;
 *     each frame, while others sample t.shown:
 *         if (!t.job) tables_begin(&t, frame);
 *         tables_step(&t, 8, &done);               as often as there is time
 *     at its end, when nobody samples:
 *         if (done) tables_swap(&t);
 *
 * Two are enough where all samplers stop at a frame's end. Where a sampler may keep a table for
 * longer, such as a GPU with frames in flight, give each of them a table, and one more to build.
 */
#ifndef ENGINE_TABLES_H
#define ENGINE_TABLES_H

#include "envsamp.h"

typedef struct tables {
    envsamp_image image;
    envsamp_row_fn row;
    void *user;
    envsamp_kd_desc desc;
    envsamp_buffer table[2], scratch;
    const envsamp_kd *shown;        /* whole, for all to sample; NULL before the first swap */
    int shown_frame;                /* whose sky it has */
    envsamp_kd_job *job;            /* the build that goes on, or NULL */
    int job_frame;
    int back;                       /* the table that is built */
} tables;

/* Needs the image's size, not its pixels. */
envsamp_result tables_make(tables *t, const envsamp_image *image, envsamp_row_fn row, void *user,
                           const envsamp_kd_desc *desc);
void tables_free(tables *t);

/* Begins a build of the sky as it is in this frame. It must not change before `done`. */
envsamp_result tables_begin(tables *t, int frame);
envsamp_result tables_step(tables *t, int count, int *done);

/* Shows the table that was built, and ends its job. */
envsamp_result tables_swap(tables *t);

#endif
