/* builder.c: see builder.h. */
#define _POSIX_C_SOURCE 200809L
#include "builder.h"
#include "clock.h"

#include <string.h>

static envsamp_result timed_row(int y, float *row, void *user)
{
    builder *b = user;
    const double start = thread_ms();
    const envsamp_result result = sky_row(y, row, b->sky);

    b->rows_ms += thread_ms() - start;
    return result;
}

/* Without the rows of the sky. */
static envsamp_result timed_step(builder *b, int count, int *done)
{
    const double start = thread_ms(), rows = b->rows_ms;
    const envsamp_result result = tables_step(&b->tables, count, done);

    budget_add(&b->budget, thread_ms() - start - (b->rows_ms - rows));
    return result;
}

envsamp_result builder_make(builder *b, sky *s, const envsamp_kd_desc *desc, double limit_ms,
                            int items)
{
    envsamp_result result;
    int done = 0;

    memset(b, 0, sizeof *b);
    b->sky = s;
    b->items = items;
    result = tables_make(&b->tables, &s->view, timed_row, b, desc);
    if (result == ENVSAMP_OK && !budget_make(&b->budget, limit_ms))
        result = ENVSAMP_ERR_MEMORY;
    if (result == ENVSAMP_OK)
        result = tables_begin(&b->tables, 0);
    while (result == ENVSAMP_OK && !done)
        result = timed_step(b, BUILDER_ITEMS, &done);
    if (result == ENVSAMP_OK)
        result = tables_swap(&b->tables);
    if (result != ENVSAMP_OK)
        builder_free(b);
    return result;
}

void builder_free(builder *b)
{
    tables_free(&b->tables);
    budget_free(&b->budget);
}

envsamp_result builder_frame(builder *b, int frame, double spent_ms, int *done)
{
    envsamp_result result = ENVSAMP_OK;
    const double start = thread_ms();

    *done = 0;
    b->rows_ms = 0.0;
    budget_frame(&b->budget, spent_ms);
    if (!b->tables.job) {
        budget_begin(&b->budget);
        result = tables_begin(&b->tables, frame);
        b->budget.spent += thread_ms() - start;
    }
    if (b->items)
        return result == ENVSAMP_OK ? timed_step(b, b->items, done) : result;
    while (result == ENVSAMP_OK && !*done && budget_fits(&b->budget))
        result = timed_step(b, BUILDER_ITEMS, done);
    return result;
}
