/* cells.h: measured cells of tables in a CSV file: each is kept as soon as it is done, so that a
 * run which was interrupted goes on where it stopped.
 *
 *     cells all;
 *     if (!cells_open(&all, "bench/results/render.csv", header, error, sizeof error)) ...
 *     if (!cells_find(&all, key)) { measure...; cells_add(&all, key, values); }
 *     cells_close(&all);
 *
 * A line is a key, which has no quotes and a fixed number of commas, and CELL_VALUES numbers. Lines
 * that begin with # say with what the cells below them were measured.
 */
#ifndef CELLS_H
#define CELLS_H

#include <stddef.h>
#include <stdio.h>

#define CELL_VALUES 7
#define CELL_KEY 128

typedef struct cell {
    char key[CELL_KEY];
    double value[CELL_VALUES];
} cell;

typedef struct cells {
    FILE *file;
    cell *list;
    size_t count, room;
    size_t *slots;                   /* hash table of 2 x room: places in the list from 1, or 0 */
    char header[512];                /* of the file: with what its cells were measured */
    char more[128];                  /* to be added to that before the next cell; or empty */
} cells;

/* Reads what is there; a new file begins with `header`; where an old one has another, the first line
   of `header` comes before the next cell. A last line that was cut off is dropped.
   Returns 0, with one line in `error`, for a file that cannot be read or written. */
int cells_open(cells *all, const char *path, const char *header, char *error, size_t error_size);

/* NULL where it was not measured; good until the next cells_add. */
const cell *cells_find(const cells *all, const char *key);

/* Writes it at once. Returns 0 where the file cannot be written or memory is short. */
int cells_add(cells *all, const char *key, const double value[CELL_VALUES]);

void cells_close(cells *all);

#endif
