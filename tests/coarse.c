/* coarse.c: how bright a sky is drawn with numbers of few bits; 1 is right.
 *
 *     coarse     tables on stdout; some seconds
 *
 * N values of one number, the other one random, and random numbers of few bits: 2^22 samples, which
 * leave 0.0002 of noise without and 0.002 with a sun. Then single sets of N points, whose noise is
 * that of the set.
 *
 * -DHEADER='"path"' takes another envsamp.h, of which version 0.2 is asked.
 */
#ifndef HEADER
#define HEADER "../envsamp.h"
#endif
#define ENVSAMP_IMPLEMENTATION
#include HEADER

#include "coarse.h"

#include <stdio.h>

static const struct column { coarse_set set; int bits; } columns[] = {
    { COARSE_U0, 8 }, { COARSE_U0, 10 }, { COARSE_U0, 12 }, { COARSE_U0, 14 }, { COARSE_U0, 16 },
    { COARSE_U0, 20 }, { COARSE_U0, 24 }, { COARSE_U1, 8 }, { COARSE_U1, 10 }, { COARSE_U1, 12 },
    { COARSE_U1, 16 }, { COARSE_BOTH, 8 }, { COARSE_BOTH, 10 }, { COARSE_BOTH, 12 },
    { COARSE_BOTH, 16 }, { COARSE_HAMMERSLEY, 12 }, { COARSE_HAMMERSLEY, 16 },
    { COARSE_TURNED, 12 }, { COARSE_TURNED, 16 }, { COARSE_SOBOL, 12 }, { COARSE_SOBOL, 16 }
};

#define COLUMNS ((int)(sizeof columns / sizeof columns[0]))
#define ROWS 7

static double cells[COLUMNS][ROWS];

static void fill(int row, int kind, const coarse_sky *sky, int blocks)
{
    sampler_request request = coarse_ask(kind, sky, blocks);
    sampler s;
    int i;

    if (!sampler_make(&s, &request)) {
        fprintf(stderr, "coarse: %s: %s\n", sampler_names[kind], envsamp_result_string(s.result));
        exit(1);
    }
    for (i = 0; i < COLUMNS; i++) {
        const int random = columns[i].set <= COARSE_BOTH;

        cells[i][row] = coarse_mean(&s, sky, columns[i].set, columns[i].bits,
                                    random && columns[i].bits < 22 ? 1 << 22
                                                                   : 1 << columns[i].bits);
    }
    sampler_free(&s);
}

int main(void)
{
    int sun, i, k;

    for (sun = 0; sun < 2; sun++) {
        coarse_sky sky = coarse_sky_make(sun);

        for (k = 0; k < ROWS; k++)
            fill(k, k / 2, &sky, k % 2 ? 16384 : 6144);
        printf("%s\n\n%-16s %-24s %-24s %-24s %s\n%16s", sun ? "\nA sky with a sun that is hidden"
                                                             : "A sky without a sun",
               "", "WARP", "ALIAS", "FIT", "cdf", "");
        for (k = 0; k + 1 < ROWS; k++)
            printf("%12d", k % 2 ? 16384 : 6144);
        printf("\n");
        for (i = 0; i < COLUMNS; i++) {
            printf("%-11s 2^%-2d", coarse_names[columns[i].set], columns[i].bits);
            for (k = 0; k < ROWS; k++)
                printf("%12.4f", cells[i][k]);
            printf("\n");
        }
        coarse_sky_free(&sky);
    }
    return 0;
}
