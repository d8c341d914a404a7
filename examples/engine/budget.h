/* budget.h: how many steps of a build fit into a frame.
 *
 *     budget b;
 *     if (!budget_make(&b, 2.0)) return 1;         milliseconds a frame
 *     a build begins:  budget_begin(&b);
 *     each frame:      budget_frame(&b, spent);    what the frame has spent on other things
 *         while (!done && budget_fits(&b)) { ...; budget_add(&b, milliseconds of the step); }
 *
 * Steps do not take the same time. What they took in the builds before tells what they take in
 * this: a step is made if half as much again as the longest of those near it would fit. A step that
 * once was slow for another reason does not hold up all of a frame.
 */
#ifndef ENGINE_BUDGET_H
#define ENGINE_BUDGET_H

#define BUDGET_STEPS 65536      /* later ones are taken for as long as the last */
#define BUDGET_MOST  0.6        /* of the limit: no step is expected to take more */
#define BUDGET_SPARE 0.05       /* of the limit, for what cannot be known */
#define BUDGET_NEAR  4          /* steps before and after */

typedef struct budget {
    double limit;               /* of a frame */
    double spent;               /* in this frame */
    double worst;               /* of a single step, ever */
    double build, least;        /* all steps of this build; of the fastest one */
    int made;                   /* steps in this frame */
    int at, last;               /* the next step of this build, and how many the last one had */
    double *cost;               /* of each step, a mean in which the last builds count most */
} budget;

int budget_make(budget *b, double limit);
void budget_free(budget *b);
void budget_begin(budget *b);
void budget_frame(budget *b, double spent);
void budget_add(budget *b, double milliseconds);

/* At least one step of each frame does. */
int budget_fits(const budget *b);

#endif
