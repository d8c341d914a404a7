/* tiles.c: see tiles.h. */
#include "tiles.h"

#include <pthread.h>

#define THREADS_MAX 256

typedef struct tile_queue {
    pthread_mutex_t lock;
    int width, height, across, count, next, done;
    void (*shade)(void *user, const tile *t);
    void *user;
    const tile_progress *progress;
} tile_queue;

static int least(int a, int b)
{
    return a < b ? a : b;
}

static void *work(void *shared)
{
    tile_queue *q = shared;
    int number;
    tile t;

    for (;;) {
        pthread_mutex_lock(&q->lock);
        number = q->next < q->count ? q->next++ : -1;
        pthread_mutex_unlock(&q->lock);
        if (number < 0)
            return NULL;
        t.left = number % q->across * TILE_SIDE;
        t.top = number / q->across * TILE_SIDE;
        t.right = least(t.left + TILE_SIDE, q->width);
        t.bottom = least(t.top + TILE_SIDE, q->height);
        q->shade(q->user, &t);
        pthread_mutex_lock(&q->lock);
        q->done++;
        if (q->progress)
            q->progress->report((double)q->done / q->count, q->progress->user);
        pthread_mutex_unlock(&q->lock);
    }
}

/* The calling thread is one of them. */
void tiles_run(int width, int height, int threads, void (*shade)(void *user, const tile *t),
               void *user, const tile_progress *progress)
{
    pthread_t started[THREADS_MAX];
    tile_queue q;
    int i, count = 0;

    q.width = width;
    q.height = height;
    q.across = (width + TILE_SIDE - 1) / TILE_SIDE;
    q.count = q.across * ((height + TILE_SIDE - 1) / TILE_SIDE);
    q.next = q.done = 0;
    q.shade = shade;
    q.user = user;
    q.progress = progress;
    pthread_mutex_init(&q.lock, NULL);
    threads = least(least(threads, THREADS_MAX), q.count);
    while (count < threads - 1 && !pthread_create(&started[count], NULL, work, &q))
        count++;
    work(&q);
    for (i = 0; i < count; i++)
        pthread_join(started[i], NULL);
    pthread_mutex_destroy(&q.lock);
}
