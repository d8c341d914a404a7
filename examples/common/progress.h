/* progress.h: how much of a program is done, and the time that is left, on stderr.
 *
 *     progress p = progress_start("bench");
 *     for (i = 0; i < count; i++) {
 *         progress_show(&p, (double)i / count, name[i]);
 *         ...
 *     }
 *     progress_end(&p);
 *
 * On a terminal one line overwrites itself; in a log a line comes every 15 seconds, so none of a
 * program that takes less. Before anything is printed call progress_end: what is shown later comes
 * anew.
 */
#ifndef PROGRESS_H
#define PROGRESS_H

#include <stdio.h>
#include <time.h>

#ifdef _WIN32
#include <io.h>
#define PROGRESS_TERMINAL() _isatty(2)
#else
#include <unistd.h>
#define PROGRESS_TERMINAL() isatty(2)
#endif

#define PROGRESS_LOG_SECONDS 15
#define PROGRESS_WIDTH 24           /* of the bar */

typedef struct progress {
    const char *name;               /* of the program: it begins the lines of a log */
    time_t start, said;
    int terminal, percent;          /* shown last; -1: nothing is on the line */
} progress;

static inline progress progress_start(const char *name)
{
    progress p;

    p.name = name;
    p.start = p.said = time(NULL);
    p.terminal = PROGRESS_TERMINAL();
    p.percent = -1;
    return p;
}

/* The time that is left, once a guess is worth something. */
static inline void progress_left(const progress *p, time_t now, double share, char text[32])
{
    const double spent = difftime(now, p->start);

    text[0] = '\0';
    if (spent >= 2.0 && share > 0.0)
        snprintf(text, 32, ", %.0f s left", spent * (1.0 - share) / share);
}

/* `share`: what is done, from 0 to 1; `what`: what comes now, or NULL. */
static inline void progress_show(progress *p, double share, const char *what)
{
    const time_t now = time(NULL);
    const int percent = (int)(100.0 * share), full = percent * PROGRESS_WIDTH / 100;
    char left[32];

    if (now == p->said && (!p->terminal || percent == p->percent))
        return;
    progress_left(p, now, share, left);
    if (p->terminal) {
        fprintf(stderr, "\r[%.*s%*s] %3d %%%s  %-24.24s", full, "########################",
                PROGRESS_WIDTH - full, "", percent, left, what ? what : "");
    } else if (difftime(now, p->said) >= PROGRESS_LOG_SECONDS) {
        fprintf(stderr, "%s: %s%s%d %%%s\n", p->name, what ? what : "", what ? ", " : "", percent,
                left);
    } else {
        return;
    }
    fflush(stderr);
    p->said = now;
    p->percent = percent;
}

/* Leaves the line empty, for what is printed next. */
static inline void progress_end(progress *p)
{
    if (p->terminal && p->percent >= 0)
        fprintf(stderr, "\r%76s\r", "");
    p->percent = -1;
}

#endif
