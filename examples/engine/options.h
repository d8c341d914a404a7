/* options.h: what the command line of the frame loop says. */
#ifndef ENGINE_OPTIONS_H
#define ENGINE_OPTIONS_H

#include "envsamp.h"

typedef enum control {
    CONTROL_NONE,
    CONTROL_EARLY,              /* tables are swapped before they are whole */
    CONTROL_MIXED               /* densities come from a table of another frame */
} control;

typedef struct options {
    int width, height, half;    /* of the map; half: tables are of one half as wide and high */
    int frames, threads, lights, samples, items, sizes;
    double budget_ms, speed;    /* of the sun, degrees a frame */
    control control;
    envsamp_kd_desc desc;
} options;

/* Returns 1, or 0 with one line in `error`, or -1 where help is asked for. */
int options_read(options *o, int argc, char **argv, char *error, size_t error_size);

extern const char options_help[];

#endif
