/* wasm.c: bits.c for WebAssembly without a libc. The compiler itself asks for memcpy, memset and
 * memcmp; square roots are instructions. Compile it as freestanding, or the loops below may become
 * calls of themselves. */
#include <stddef.h>

#ifdef __cplusplus
#define EXPORT(name) extern "C" __attribute__((export_name(#name)))
extern "C" {
#else
#define EXPORT(name) __attribute__((export_name(#name)))
#endif

void *memcpy(void *to, const void *from, size_t bytes);
void *memset(void *to, int value, size_t bytes);
int memcmp(const void *a, const void *b, size_t bytes);

void *memcpy(void *to, const void *from, size_t bytes)
{
    size_t i;

    for (i = 0; i < bytes; i++)
        ((unsigned char *)to)[i] = ((const unsigned char *)from)[i];
    return to;
}

void *memset(void *to, int value, size_t bytes)
{
    size_t i;

    for (i = 0; i < bytes; i++)
        ((unsigned char *)to)[i] = (unsigned char)value;
    return to;
}

int memcmp(const void *a, const void *b, size_t bytes)
{
    const unsigned char *x = (const unsigned char *)a, *y = (const unsigned char *)b;
    size_t i;

    for (i = 0; i < bytes; i++)
        if (x[i] != y[i])
            return x[i] < y[i] ? -1 : 1;
    return 0;
}

#ifdef __cplusplus
}
#endif

#define ENVSAMP_ASSERT(x) ((x) ? (void)0 : __builtin_trap())
#define ENVSAMP_SQRT(x) __builtin_sqrt(x)
#define ENVSAMP_SQRTF(x) __builtin_sqrtf(x)
#define ENVSAMP_FABSF(x) __builtin_fabsf(x)
#define ENVSAMP_COPYSIGNF(x, y) __builtin_copysignf(x, y)
#define ENVSAMP_MEMCPY memcpy
#define ENVSAMP_MEMSET memset
#define ENVSAMP_MEMCMP memcmp
#define BITS_NO_MAIN
#include "bits.c"

EXPORT(bits_failed) int bits_failed(void);
EXPORT(bits_memory) uint32_t bits_memory(void);
EXPORT(bits_values) uint32_t bits_values(void);

/* To be called first. Nonzero if a build failed. */
EXPORT(bits_failed) int bits_failed(void) { return bits_run().failed; }
EXPORT(bits_memory) uint32_t bits_memory(void) { return bits.memory; }
EXPORT(bits_values) uint32_t bits_values(void) { return bits.values; }
