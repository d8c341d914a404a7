/* map_set.h: the maps that figures are made from: the real ones that `make data` fetches, or,
 * where one of them is missing, made-up ones of the same size.
 *
 * Include it after envsamp.h.
 */
#ifndef MAP_SET_H
#define MAP_SET_H

#include "../examples/common/maps.h"
#include "../examples/common/progress.h"
#include "../examples/common/real_maps.h"
#include "table.h"

#define MAP_SET_MAX REAL_MAP_COUNT
#define MAP_SET_MADE_COUNT 4

typedef struct map_set {
    int count, real;
    progress shown;             /* by map_set_load */
} map_set;

/* `program` begins the lines that a log has of its progress. */
static inline map_set map_set_find(const char *program)
{
    map_set set;
    image map;
    int i;

    set.count = REAL_MAP_COUNT;
    set.real = 1;
    set.shown = progress_start(program);
    for (i = 0; i < REAL_MAP_COUNT && set.real; i++)
        if (real_map_read(i, &map)) {
            image_free(&map);
        } else {
            set.count = MAP_SET_MADE_COUNT;
            set.real = 0;
        }
    return set;
}

static inline const char *map_set_name(const map_set *set, int index)
{
    static const char *const made[MAP_SET_MADE_COUNT] = { "sky", "studio", "night", "foliage" };

    return set->real ? real_map_name(index) : made[index];
}

/* Shows how many maps are done, in one pass over them; 0 where one cannot be made or read. */
static inline int map_set_load(map_set *set, int index, image *map)
{
    const char *name = map_set_name(set, index);

    progress_show(&set->shown, (double)index / set->count, name);
    if (set->real ? real_map_read(index, map) : map_make(name, 512, 256, map))
        return 1;
    fprintf(stderr, "%s: cannot be made or read\n", name);
    return 0;
}

/* After the last map, before anything is printed. */
static inline void map_set_done(map_set *set)
{
    progress_end(&set->shown);
}

static inline const char *map_set_kind(const map_set *set)
{
    return set->real ? "real" : "made-up (for the real ones: make data)";
}

#endif
