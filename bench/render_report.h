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
    int sets, reduce;
} table_lights;

/* DECOMPOSED without a part of it; and what is published of that, or zeros. */
typedef struct table_ablation {
    const char *label;
    float mask_scale;                /* as in envsamp_lights_desc, and the next two */
    int refine_rounds;
    float weights[3];
    int sets, reduce;
    double rmse, flip;
} table_ablation;

#define TABLE_METHODS 15
#define TABLE_SAFE 6
#define TABLE_LIGHTS 20
#define TABLE_SINGLE 9                      /* of these, the first: without interleaved sets */
#define TABLE_ABLATIONS 8
#define TABLE_FILTERED 4
#define TABLE_ERGUN 5
#define TABLE_PRODUCT 5
#define TABLE_CALLS 7
#define FILTERED_LABEL "filtered"
#define FILTERED_EQUAL 16                   /* samples of it, whose time is given to all */
#define REPORT_REAL 18
#define REPORT_MAPS (REPORT_REAL + 1)       /* the last is made-up, for Ergun's figures */

/* Scenes of a table; NULL at the end. */
extern const char *const table_scenes[];            /* the four of most tables */
extern const char *const table_all_scenes[];
extern const char *const table_soft_scenes[];       /* without the highly glossy one, as Wu's */
extern const char *const table_glossy_scene[];
extern const char *const table_metal_scene[];       /* of `table_safe` alone */
extern const char *const table_ward_scene[];

extern const char *const report_maps[REPORT_MAPS];
extern const table_method table_methods[TABLE_METHODS];    /* the first: what renderers ship */
extern const table_method table_safe[TABLE_SAFE];          /* the first: the same */
extern const table_lights table_lights_all[TABLE_LIGHTS];
extern const table_ablation table_ablations[TABLE_ABLATIONS];
extern const table_method table_filtered[TABLE_FILTERED];  /* beside FILTERED_LABEL */
extern const table_method table_ergun[TABLE_ERGUN];
extern const table_method table_product[TABLE_PRODUCT];
extern const table_method table_calls[TABLE_CALLS];

/* With what is measured, in lines that begin with #. */
void report_header(char *header, size_t size, const char *flags, const char *commit,
                   const stage_config *direct, const stage_config *bounced);

/* Writes the tables of which there are cells. Returns 0, with one line in `error`. */
int report_write(const cells *all, const char *path, char *error, size_t error_size);

#endif
