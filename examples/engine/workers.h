/* workers.h: threads that sample the table of a frame, and check that it is one whole table.
 *
 *     workers w;
 *     if (!workers_make(&w, 2, 4096)) return 1;
 *     each frame:
 *         workers_start(&w, &job);
 *         ...                                      something else meanwhile
 *         workers_wait(&w);                        nobody samples any more
 *     workers_free(&w);
 *
 * A worker opens the table before and after it samples, which checks every byte of it by its
 * checksum, and compares the density of each sample with that of its direction.
 */
#ifndef ENGINE_WORKERS_H
#define ENGINE_WORKERS_H

#include "envsamp.h"

#include <pthread.h>

#define WORKERS_MAX 64

/* Four pairs of densities and more than this share of them differ: they are of two tables. Within
   one table only those do whose direction lies on the edge of a block; see envsamp_kd_pdf. */
#define WORKERS_ACROSS 0.02

/* What a frame samples. Densities are asked of `pdf_of`: of the same table, but in a control. */
typedef struct worker_job {
    const envsamp_kd *kd, *pdf_of;
    size_t bytes;               /* of their buffers */
    int frame;
} worker_job;

struct workers;
typedef struct worker {
    struct workers *all;
    pthread_t thread;
    int number;
    long samples;
    double across;              /* the largest share of a frame's pairs that differ */
    int half_built, mixed;      /* frames of a table that did not open, and of two tables */
} worker;

typedef struct workers {
    pthread_mutex_t lock;
    pthread_cond_t started, ended;
    int count, samples, busy, quit;
    worker_job job;
    worker each[WORKERS_MAX];
} workers;

int workers_make(workers *w, int count, int samples);
void workers_free(workers *w);

/* Sets all to work. Frames have numbers from 0 on, each another one. */
void workers_start(workers *w, const worker_job *job);
void workers_wait(workers *w);

#endif
