/* cells.c: see cells.h. */
#include "cells.h"

#include <stdlib.h>
#include <string.h>

#define LINE 512

static int put(cells *all, const char *key, const double value[CELL_VALUES])
{
    if (all->count == all->room) {
        const size_t room = all->room ? 2 * all->room : 1024;
        cell *grown = (cell *)realloc(all->list, room * sizeof *grown);

        if (!grown)
            return 0;
        all->list = grown;
        all->room = room;
    }
    snprintf(all->list[all->count].key, CELL_KEY, "%s", key);
    memcpy(all->list[all->count].value, value, CELL_VALUES * sizeof *value);
    all->count++;
    return 1;
}

/* The values are the last CELL_VALUES fields. Returns 0 for what is no cell. */
static int parse(char *line, double value[CELL_VALUES])
{
    int i;

    for (i = CELL_VALUES - 1; i >= 0; i--) {
        char *comma = strrchr(line, ','), *end;

        if (!comma)
            return 0;
        value[i] = strtod(comma + 1, &end);
        if (end == comma + 1 || (*end && *end != '\n'))
            return 0;
        *comma = 0;
    }
    return strlen(line) < CELL_KEY;
}

/* Reads a file, and returns where its last whole line ends; -1 where memory is short. */
static long read_all(cells *all, FILE *file)
{
    char line[LINE];
    long end = 0;

    while (fgets(line, sizeof line, file) && strchr(line, '\n')) {
        double value[CELL_VALUES];

        end = ftell(file);
        if (line[0] == '#' && strlen(all->header) + strlen(line) < sizeof all->header)
            strcat(all->header, line);
        if (line[0] != '#' && parse(line, value) && !put(all, line, value))
            return -1;
    }
    return end;
}

int cells_open(cells *all, const char *path, const char *header, char *error, size_t error_size)
{
    FILE *old = fopen(path, "r");
    long end = 0;

    memset(all, 0, sizeof *all);
    if (old) {
        end = read_all(all, old);
        fclose(old);
    }
    all->file = fopen(path, end > 0 ? "r+" : "w");
    if (!all->file || end < 0) {
        snprintf(error, error_size, "%s: cannot be %s", path, end < 0 ? "kept" : "written");
        cells_close(all);
        return 0;
    }
    fseek(all->file, end, SEEK_SET);        /* over what was cut off */
    if (end == 0) {
        snprintf(all->header, sizeof all->header, "%s\n", header);
        fprintf(all->file, "%s\n", header);
    }
    snprintf(all->more, sizeof all->more, "%.*s\n", (int)strcspn(header, "\n"), header);
    if (strstr(all->header, all->more))
        all->more[0] = 0;
    fflush(all->file);
    return 1;
}

const cell *cells_find(const cells *all, const char *key)
{
    size_t i;

    for (i = all->count; i-- > 0;)
        if (!strcmp(all->list[i].key, key))
            return &all->list[i];
    return NULL;
}

int cells_add(cells *all, const char *key, const double value[CELL_VALUES])
{
    int i;

    if (all->more[0] && strlen(all->header) + strlen(all->more) < sizeof all->header)
        strcat(all->header, all->more);
    fprintf(all->file, "%s%s", all->more, key);
    all->more[0] = 0;
    for (i = 0; i < CELL_VALUES; i++)
        fprintf(all->file, ",%.6g", value[i]);
    fprintf(all->file, "\n");
    return fflush(all->file) == 0 && put(all, key, value);
}

void cells_close(cells *all)
{
    if (all->file)
        fclose(all->file);
    free(all->list);
    memset(all, 0, sizeof *all);
}
