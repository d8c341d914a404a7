/* The library, compiled once for all tests and examples. */
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"
