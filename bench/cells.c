/* cells.c: see cells.h. */
#include "cells.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define LINE 512

/* Where a key is, or would be put. */
static size_t *slot_of(const cells *all, const char *key)
{
    uint32_t hash = 2166136261u;            /* FNV-1a */
    size_t at, i;

    for (i = 0; key[i]; i++)
        hash = (hash ^ (unsigned char)key[i]) * 16777619u;
    at = hash % (2 * all->room);
    while (all->slots[at] && strcmp(all->list[all->slots[at] - 1].key, key))
        at = (at + 1) % (2 * all->room);
    return all->slots + at;
}

/* Makes room for twice as many. Returns 0 where memory is short. */
static int grow(cells *all)
{
    const size_t room = all->room ? 2 * all->room : 1024;
    cell *list = (cell *)realloc(all->list, room * sizeof *list);
    size_t *slots = (size_t *)calloc(2 * room, sizeof *slots), i;

    if (list)
        all->list = list;
    if (!list || !slots) {
        free(slots);
        return 0;
    }
    free(all->slots);
    all->slots = slots;
    all->room = room;
    for (i = 0; i < all->count; i++)
        *slot_of(all, all->list[i].key) = i + 1;
    return 1;
}

static int put(cells *all, const char *key, const double value[CELL_VALUES])
{
    if (all->count == all->room && !grow(all))
        return 0;
    *slot_of(all, key) = all->count + 1;
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
    const size_t found = all->count ? *slot_of(all, key) : 0;

    return found ? &all->list[found - 1] : NULL;
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
    free(all->slots);
    memset(all, 0, sizeof *all);
}
