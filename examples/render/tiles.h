/* tiles.h: a picture in tiles, over which threads go.
 *
 *     static void shade(void *user, const tile *t) { ... every pixel of t ... }
 *     tiles_run(width, height, 4, shade, &user, NULL);
 *
 * Tiles are handed out in order, each to one thread. Where a pixel depends on nothing but itself,
 * the picture is the same for any number of threads.
 */
#ifndef RENDER_TILES_H
#define RENDER_TILES_H

#define TILE_SIDE 16

typedef struct tile { int left, top, right, bottom; } tile;      /* right and bottom: exclusive */

/* Called after every tile, by one thread at a time, with the share that is done. */
typedef struct tile_progress {
    void (*report)(double share, void *user);
    void *user;
} tile_progress;

/* progress may be NULL. Where fewer threads can be started than asked for, these do all. */
void tiles_run(int width, int height, int threads, void (*shade)(void *user, const tile *t),
               void *user, const tile_progress *progress);

#endif
