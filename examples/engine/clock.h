/* clock.h: milliseconds of this thread's CPU, which a busy neighbour hardly changes, and of the
 * wall. Define _POSIX_C_SOURCE 200809L first. */
#ifndef ENGINE_CLOCK_H
#define ENGINE_CLOCK_H

#include <time.h>

static inline double clock_ms(clockid_t id)
{
    struct timespec t;

    clock_gettime(id, &t);
    return 1e3 * (double)t.tv_sec + 1e-6 * (double)t.tv_nsec;
}

static inline double thread_ms(void)
{
    return clock_ms(CLOCK_THREAD_CPUTIME_ID);
}

static inline double wall_ms(void)
{
    return clock_ms(CLOCK_MONOTONIC);
}

#endif
