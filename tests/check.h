/* check.h: the tests' harness. Each test file is a program that prints TAP for `prove`:
 *
 *     CHECK(x == 3, "x is %d", x);      one test point
 *     CHECK(IS(f(), 3) && IS_NEAR(y, 0.5, 1e-9), "f and y");
 *     CHECK_SKIP("no real maps");       a test point that could not be run, and why
 *     return check_done();              prints the plan; the exit status
 *
 * A point that fails prints where it is, its message and its condition; and, where the condition
 * is of IS and IS_NEAR, what came and what was expected. Functions that conditions call may use
 * these too, or check_note. It goes to stderr, in one piece: prove shows that as it comes.
 */
#ifndef CHECK_H
#define CHECK_H

#include <stdarg.h>
#include <stdio.h>

#if defined(__GNUC__)
#define CHECK_PRINTS(text, first) __attribute__((format(printf, text, first)))
#else
#define CHECK_PRINTS(text, first)
#endif

static int check_count, check_failures;
static char check_notes[2000];          /* since the last point */
static size_t check_noted;

/* Appends to a text, as far as it fits. */
static inline size_t check_append(char *text, size_t size, size_t used, const char *format,
                                  va_list arguments)
{
    const int more = vsnprintf(text + used, size - used, format, arguments);

    return more < 0 ? used : (size_t)more < size - used ? used + (size_t)more : size - 1;
}

CHECK_PRINTS(1, 2) static inline void check_note(const char *format, ...)
{
    va_list arguments;

    va_start(arguments, format);
    check_noted = check_append(check_notes, sizeof check_notes, check_noted, format, arguments);
    va_end(arguments);
}

CHECK_PRINTS(5, 6) static inline void check_report(int pass, const char *file, int line,
                                                   const char *condition, const char *format, ...)
{
    char message[1000];
    va_list arguments;

    va_start(arguments, format);
    check_append(message, sizeof message, 0, format, arguments);
    va_end(arguments);
    printf("%sok %d - %s\n", pass ? "" : "not ", ++check_count, message);
    fflush(stdout);
    if (!pass) {
        check_failures++;
        fprintf(stderr, "#   %s:%d: test %d: %s\n#     expected: %.1000s\n%s", file, line,
                check_count, message, condition, check_notes);
    }
    check_notes[check_noted = 0] = '\0';
}

/* Whether numbers are equal, or less than `most` apart: numbers that a double holds. */
static inline int check_is(double got, double expected, const char *what, const char *as,
                           const char *file, int line)
{
    if (got == expected)
        return 1;
    check_note("#     %s:%d: %s is %.9g, expected %.9g, %s\n", file, line, what, got, expected, as);
    return 0;
}

static inline int check_within(double got, double expected, double most, const char *what,
                               const char *file, int line)
{
    if (got == expected || (got - expected < most && expected - got < most))
        return 1;
    check_note("#     %s:%d: %s is %.17g, expected %.17g, give or take %.3g\n", file, line, what,
               got, expected, most);
    return 0;
}

#define CHECK(condition, ...) \
    check_report((condition) ? 1 : 0, __FILE__, __LINE__, #condition, __VA_ARGS__)
#define IS(got, expected) \
    check_is((double)(got), (double)(expected), #got, #expected, __FILE__, __LINE__)
#define IS_NEAR(got, expected, most) \
    check_within((double)(got), (double)(expected), (double)(most), #got, __FILE__, __LINE__)
#define CHECK_SKIP(reason) (printf("ok %d # SKIP %s\n", ++check_count, reason), fflush(stdout))

static int check_done(void)
{
    printf("1..%d\n", check_count);
    return check_failures != 0;
}

#endif
