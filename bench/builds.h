/* builds.h: a version of the library as builds.c sees it, so that two can be timed in one run.
 */
#ifndef BUILDS_H
#define BUILDS_H

#include <stddef.h>

enum { BUILD_WARP, BUILD_ALIAS, BUILD_CDF, BUILD_KINDS };

typedef struct build {
    int kind, block_count;
    const float *rgb;           /* lat-long, packed */
    int width, height;
    size_t table_bytes, scratch_bytes;
    void *table, *scratch;
    double excess;              /* of the last run */
} build;

/* Both return 0 on failure. */
typedef struct builds_version {
    int (*sizes)(build *b);     /* fills in the sizes, whose memory the caller gets */
    int (*run)(build *b);
} builds_version;

extern const builds_version builds_now;
#ifdef WITH_BEFORE
extern const builds_version builds_before;
#endif

#endif
