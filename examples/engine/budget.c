/* budget.c: see budget.h. */
#include "budget.h"

#include <stdlib.h>
#include <string.h>

int budget_make(budget *b, double limit)
{
    memset(b, 0, sizeof *b);
    b->limit = limit;
    b->cost = calloc(BUDGET_STEPS, sizeof *b->cost);
    return b->cost != NULL;
}

void budget_free(budget *b)
{
    free(b->cost);
    b->cost = NULL;
}

void budget_begin(budget *b)
{
    if (b->at > 0 && (b->last == 0 || b->build < b->least))
        b->least = b->build;
    b->last = b->at;
    b->at = 0;
    b->build = 0.0;
}

void budget_frame(budget *b, double spent)
{
    b->spent = spent;
    b->made = 0;
}

void budget_add(budget *b, double milliseconds)
{
    b->cost[b->at] += (b->at < b->last ? 0.5 : 1.0) * (milliseconds - b->cost[b->at]);
    b->at += b->at + 1 < BUDGET_STEPS;
    b->spent += milliseconds;
    b->build += milliseconds;
    b->worst = milliseconds > b->worst ? milliseconds : b->worst;
    b->made++;
}

int budget_fits(const budget *b)
{
    double longest = 0.0;
    int i;

    for (i = b->at - BUDGET_NEAR; i <= b->at + BUDGET_NEAR; i++)
        if (i >= 0 && i < b->last && b->cost[i] > longest)
            longest = b->cost[i];
    longest = 1.5 * longest < BUDGET_MOST * b->limit ? 1.5 * longest : BUDGET_MOST * b->limit;
    return b->made == 0 || b->spent + longest <= (1.0 - BUDGET_SPARE) * b->limit;
}
