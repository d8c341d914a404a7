/* timing.h: a clock, medians over rounds, and the machine and compiler that a report names.
 *
 * The includer defines _POSIX_C_SOURCE 200809L, and ROUND_COUNT, odd, so that a median is a
 * measurement.
 */
#ifndef TIMING_H
#define TIMING_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static inline double seconds(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static inline int ascending(const void *a, const void *b)
{
    double left = *(const double *)a, right = *(const double *)b;

    return (left > right) - (left < right);
}

static inline double median(const double *values)
{
    double sorted[ROUND_COUNT];

    memcpy(sorted, values, sizeof sorted);
    qsort(sorted, ROUND_COUNT, sizeof sorted[0], ascending);
    return sorted[ROUND_COUNT / 2];
}

/* Of two measurements of the same rounds: a change of clock frequency meets both. */
static inline double median_ratio(const double *times, const double *yardstick)
{
    double ratios[ROUND_COUNT];
    int i;

    for (i = 0; i < ROUND_COUNT; i++)
        ratios[i] = times[i] / yardstick[i];
    return median(ratios);
}

static inline void print_cpu(void)
{
    char line[256];
    FILE *file = fopen("/proc/cpuinfo", "r");

    while (file && fgets(line, sizeof line, file))
        if (strncmp(line, "model name", 10) == 0 && strchr(line, ':')) {
            printf("cpu       %s", strchr(line, ':') + 2);
            break;
        }
    if (file)
        fclose(file);
}

#ifndef BENCH_FLAGS
#define BENCH_FLAGS "not given"
#endif

static inline void print_compiler(const char *flags)
{
#if defined(__clang__)
    printf("compiler  clang %s\n", __clang_version__);
#elif defined(__GNUC__)
    printf("compiler  gcc %s\n", __VERSION__);
#endif
    printf("flags     %s\n", flags);
}

#endif
