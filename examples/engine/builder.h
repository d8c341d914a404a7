/* builder.h: tables of a sky, built in steps that keep to so many milliseconds a frame.
 *
 *     builder b;
 *     if (builder_make(&b, &sky, &desc, 2.0, 0) != ENVSAMP_OK) return 1;
 *     each frame:
 *         if (!b.tables.job) sky_set(&sky, ...);
 *         builder_frame(&b, frame, spent, &done);      spent: by other things, of the budget
 *         ...                                          all who sample come to an end
 *         if (done) tables_swap(&b.tables);
 *
 * Time is that of this thread's CPU in envsamp.h: b.budget.spent. The rows of the sky, which a
 * build asks for, are b.rows_ms.
 */
#ifndef ENGINE_BUILDER_H
#define ENGINE_BUILDER_H

#include "budget.h"
#include "sky.h"
#include "tables.h"

#define BUILDER_ITEMS 4         /* of one step */

typedef struct builder {
    tables tables;
    budget budget;
    sky *sky;
    double rows_ms;             /* in this frame */
    int items;                  /* of a frame; 0: as many as the budget allows */
} builder;

/* Builds the first table at once, as that of frame 0. */
envsamp_result builder_make(builder *b, sky *s, const envsamp_kd_desc *desc, double limit_ms,
                            int items);
void builder_free(builder *b);

/* A frame's part of a build. Begins one if none goes on. */
envsamp_result builder_frame(builder *b, int frame, double spent_ms, int *done);

#endif
