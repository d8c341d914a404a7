/* sizes.h: what tables of all kinds take of a frame loop. */
#ifndef ENGINE_SIZES_H
#define ENGINE_SIZES_H

#include "options.h"

/* Prints a table over both ways to select, block counts, and maps of full and of half size. Returns
   0 where memory is short. */
int sizes_print(const options *o);

#endif
