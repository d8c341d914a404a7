/* check.h: the tests' harness. Each test file is a program that prints TAP for `prove`:
 *
 *     CHECK(x == 3, "x is %d", x);      one test point; a failure prints file and line
 *     CHECK_SKIP("no real maps");       a test point that could not be run, and why
 *     return check_done();              prints the plan; the exit status
 */
#ifndef CHECK_H
#define CHECK_H

#include <stdarg.h>
#include <stdio.h>

static int check_count, check_failures;

#if defined(__GNUC__)
__attribute__((format(printf, 4, 5)))
#endif
static void check_report(int pass, const char *file, int line, const char *format, ...)
{
    va_list arguments;

    printf("%sok %d - ", pass ? "" : "not ", ++check_count);
    va_start(arguments, format);
    vprintf(format, arguments);
    va_end(arguments);
    printf("\n");
    if (!pass) {
        check_failures++;
        printf("#   failed at %s:%d\n", file, line);
    }
    fflush(stdout);
}

#define CHECK(condition, ...) check_report((condition) ? 1 : 0, __FILE__, __LINE__, __VA_ARGS__)
#define CHECK_SKIP(reason) (printf("ok %d # SKIP %s\n", ++check_count, reason), fflush(stdout))

static int check_done(void)
{
    printf("1..%d\n", check_count);
    return check_failures != 0;
}

#endif
