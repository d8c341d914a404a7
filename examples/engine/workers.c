/* workers.c: see workers.h. */
#include "workers.h"
#include "random.h"

#include <math.h>
#include <string.h>

static int is_whole(const envsamp_kd *kd, size_t bytes)
{
    const envsamp_kd *opened;

    return envsamp_kd_open(kd, bytes, &opened) == ENVSAMP_OK;
}

/* A frame's work. A table that does not open is not safe to sample. */
static void sample(worker *me, const worker_job *job)
{
    pcg32 random = pcg32_make((uint64_t)job->frame, (uint64_t)me->number);
    const int count = me->all->samples;
    int differ = 0, i;

    if (!is_whole(job->kd, job->bytes) || !is_whole(job->pdf_of, job->bytes)) {
        me->half_built++;
        return;
    }
    for (i = 0; i < count; i++) {
        const float u0 = pcg32_float(&random);
        const envsamp_sample s = envsamp_kd_sample(job->kd, u0, pcg32_float(&random));

        differ += !(fabsf(envsamp_kd_pdf(job->pdf_of, s.dir) - s.pdf) <= 1e-5f * s.pdf);
    }
    me->samples += count;
    me->across = fmax(me->across, (double)differ / count);
    me->mixed += differ > 4 + WORKERS_ACROSS * count;
    me->half_built += !is_whole(job->kd, job->bytes);
}

static void *work(void *self)
{
    worker *me = self;
    workers *w = me->all;
    worker_job job;

    job.frame = -1;
    pthread_mutex_lock(&w->lock);
    for (;;) {
        while (w->job.frame == job.frame && !w->quit)
            pthread_cond_wait(&w->started, &w->lock);
        if (w->quit)
            break;
        job = w->job;
        pthread_mutex_unlock(&w->lock);
        sample(me, &job);
        pthread_mutex_lock(&w->lock);
        if (--w->busy == 0)
            pthread_cond_signal(&w->ended);
    }
    pthread_mutex_unlock(&w->lock);
    return NULL;
}

int workers_make(workers *w, int count, int samples)
{
    memset(w, 0, sizeof *w);
    pthread_mutex_init(&w->lock, NULL);
    pthread_cond_init(&w->started, NULL);
    pthread_cond_init(&w->ended, NULL);
    w->samples = samples;
    w->job.frame = -1;
    for (; w->count < count; w->count++) {
        worker *each = &w->each[w->count];

        each->all = w;
        each->number = w->count;
        if (pthread_create(&each->thread, NULL, work, each))
            break;
    }
    if (w->count == count)
        return 1;
    workers_free(w);
    return 0;
}

void workers_free(workers *w)
{
    int i;

    pthread_mutex_lock(&w->lock);
    w->quit = 1;
    pthread_cond_broadcast(&w->started);
    pthread_mutex_unlock(&w->lock);
    for (i = 0; i < w->count; i++)
        pthread_join(w->each[i].thread, NULL);
    pthread_cond_destroy(&w->started);
    pthread_cond_destroy(&w->ended);
    pthread_mutex_destroy(&w->lock);
    w->count = 0;
}

void workers_start(workers *w, const worker_job *job)
{
    pthread_mutex_lock(&w->lock);
    w->job = *job;
    w->busy = w->count;
    pthread_cond_broadcast(&w->started);
    pthread_mutex_unlock(&w->lock);
}

void workers_wait(workers *w)
{
    pthread_mutex_lock(&w->lock);
    while (w->busy > 0)
        pthread_cond_wait(&w->ended, &w->lock);
    pthread_mutex_unlock(&w->lock);
}
