/* render_report.h: what bench/render_tables.c measures, and its cells as tables in Markdown. */
#ifndef RENDER_REPORT_H
#define RENDER_REPORT_H

#include "cells.h"
#include "stage.h"

/* The numbers of a cell. */
enum { CELL_COUNT, CELL_SECONDS, CELL_RELATIVE, CELL_TRIMMED, CELL_PSNR, CELL_FLIP, CELL_OWN };

/* A sampler: a name of the renderer, and the options of its table. */
typedef struct table_method {
    const char *label, *name;
    float compensation, exponent;
    int blocks;
} table_method;

/* A list of lights, of the library or of a rival, and how it is rendered. */
typedef struct table_lights {
    const char *label, *method;
    int interleaved, reduce;
} table_lights;

#define TABLE_SCENES 4
#define TABLE_METHODS 15
#define TABLE_LIGHTS 12
#define TABLE_ERGUN 5
#define TABLE_PRODUCT 5
#define TABLE_CALLS 7
#define REPORT_REAL 18
#define REPORT_MAPS (REPORT_REAL + 1)       /* the last is made-up, for Ergun's figures */

extern const char *const table_scenes[TABLE_SCENES];
extern const char *const report_maps[REPORT_MAPS];
extern const table_method table_methods[TABLE_METHODS];    /* the first: what renderers ship */
extern const table_lights table_lights_all[TABLE_LIGHTS];
extern const table_method table_ergun[TABLE_ERGUN];
extern const table_method table_product[TABLE_PRODUCT];
extern const table_method table_calls[TABLE_CALLS];

/* With what is measured, in lines that begin with #. */
void report_header(char *header, size_t size, const char *flags, const char *commit,
                   const stage_config *direct, const stage_config *bounced);

/* Writes the tables of which there are cells. Returns 0, with one line in `error`. */
int report_write(const cells *all, const char *path, char *error, size_t error_size);

#endif
