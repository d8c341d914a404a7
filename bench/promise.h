/* promise.h: what is promised of a figure, beside it; only where CHECK=1 is in the environment, as
 * by `make bench CHECK=1`.
 *
 *     printf("%-20s %8.2f%s", name, ratio, promise("<=", 2.5, ratio <= 2.5));
 */
#ifndef PROMISE_H
#define PROMISE_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static inline int promises_shown(void)
{
    const char *check = getenv("CHECK");

    return check && !strcmp(check, "1");
}

/* A heading above promises, or nothing. */
static inline const char *promise_heading(void)
{
    return promises_shown() ? "   promised" : "";
}

/* The end of a line, good until the next call. */
static inline const char *promise(const char *relation, double bound, int kept)
{
    static char text[64];

    text[0] = '\0';
    if (promises_shown())
        snprintf(text, sizeof text, "   %s %-5g %s", relation, bound, kept ? "kept" : "MISSED");
    return text;
}

#endif
