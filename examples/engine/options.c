/* options.c: see options.h. */
#include "options.h"
#include "workers.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char options_help[] =
    "engine [OPTION...]\n"
    "  --size WxH       the sky, 2048x1024; up to 16384x8192\n"
    "  --half           tables are of a map half as wide and high\n"
    "  --frames N       300\n"
    "  --blocks N       of a table, 512\n"
    "  --select NAME    warp, or alias\n"
    "  --budget-ms X    in envsamp.h, of a frame, 2\n"
    "  --items N        of a build in a frame, whatever time they take; 0: the budget decides\n"
    "  --threads N      that sample, 2; up to 64\n"
    "  --samples N      of each thread in a frame, 4096\n"
    "  --lights K       16; 0: none\n"
    "  --speed X        of the sun, degrees a frame, 0.05\n"
    "  --control NAME   early: tables are swapped too early; mixed: two tables at once\n"
    "  --sizes          a table of what tables of all kinds take, and no frames\n"
    "  --help\n";

static int read_count(const char *text, int least, int most, int *value)
{
    char *end;
    const long number = strtol(text, &end, 10);

    *value = (int)number;
    return end != text && *end == '\0' && number >= least && number <= most;
}

static int read_number(const char *text, double least, double most, double *value)
{
    char *end;

    *value = strtod(text, &end);
    return end != text && *end == '\0' && *value >= least && *value <= most;
}

static int read_size(const char *text, options *o)
{
    char end;

    return sscanf(text, "%dx%d%c", &o->width, &o->height, &end) == 2 && o->width >= 16
        && o->width <= 16384 && o->height >= 8 && o->height <= 8192;
}

/* One of the words of a list, by its number. */
static int read_word(const char *text, const char *first, const char *second, int *value)
{
    *value = !strcmp(text, second);
    return *value || !strcmp(text, first);
}

static int read_value(options *o, const char *name, const char *text)
{
    int word = 0, good;

    if (!strcmp(name, "--size"))
        return read_size(text, o);
    if (!strcmp(name, "--frames"))
        return read_count(text, 2, 1000000, &o->frames);
    if (!strcmp(name, "--blocks"))
        return read_count(text, 1, 65536, &o->desc.block_count);
    if (!strcmp(name, "--budget-ms"))
        return read_number(text, 0.01, 1e6, &o->budget_ms);
    if (!strcmp(name, "--items"))
        return read_count(text, 0, 1000000, &o->items);
    if (!strcmp(name, "--threads"))
        return read_count(text, 1, WORKERS_MAX, &o->threads);
    if (!strcmp(name, "--samples"))
        return read_count(text, 1, 1000000, &o->samples);
    if (!strcmp(name, "--lights"))
        return read_count(text, 0, 256, &o->lights);
    if (!strcmp(name, "--speed"))
        return read_number(text, -10.0, 10.0, &o->speed);
    if (!strcmp(name, "--select")) {
        good = read_word(text, "warp", "alias", &word);
        o->desc.select = word ? ENVSAMP_KD_ALIAS : ENVSAMP_KD_WARP;
        return good;
    }
    good = read_word(text, "early", "mixed", &word) && !strcmp(name, "--control");
    o->control = word ? CONTROL_MIXED : CONTROL_EARLY;
    return good;
}

int options_read(options *o, int argc, char **argv, char *error, size_t error_size)
{
    int i;

    memset(o, 0, sizeof *o);
    o->width = 2048;
    o->height = 1024;
    o->frames = 300;
    o->threads = 2;
    o->samples = 4096;
    o->lights = 16;
    o->budget_ms = 2.0;
    o->speed = 0.05;
    o->desc.block_count = 512;
    for (i = 1; i < argc; i++) {
        if (!strcmp(argv[i], "--help"))
            return -1;
        if (!strcmp(argv[i], "--half"))
            o->half = 1;
        else if (!strcmp(argv[i], "--sizes"))
            o->sizes = 1;
        else if (i + 1 == argc || !read_value(o, argv[i], argv[i + 1])) {
            snprintf(error, error_size, "%s: not an option with such a value; see --help", argv[i]);
            return 0;
        } else {
            i++;
        }
    }
    return 1;
}
