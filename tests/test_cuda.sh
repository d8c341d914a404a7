#!/bin/sh
# test_cuda.sh: the functions that sample compile as CUDA device code, from the same text. Asks
# nvcc, or else clang, which needs no CUDA headers for that; skipped where neither is.
set -u
cd "$(dirname "$0")/.." || exit 1
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT

cat > "$scratch/device.cu" << 'END'
#define ENVSAMP_IMPLEMENTATION
#define ENVSAMP_STATIC
#include "envsamp.h"

__global__ void draw(const envsamp_kd *kd, const float *u, envsamp_sample *s, float *pdf, float *back)
{
    *s = envsamp_kd_sample(kd, u[0], u[1]);
    *pdf = envsamp_kd_pdf(kd, s->dir);
    envsamp_kd_invert(kd, s->dir, back);
    envsamp_dir_to_uv(ENVSAMP_OCTAHEDRAL, s->dir, back + 2);
    envsamp_uv_to_dir(ENVSAMP_OCTAHEDRAL, back[2], back[3], back + 4);
    back[7] = envsamp_mis_power(*pdf, envsamp_luminance(back + 4));
}

__global__ void invert(const envsamp_cdf *cdf, const float *u, envsamp_sample *s, float *pdf,
                       float *back)
{
    *s = envsamp_cdf_sample(cdf, u[0], u[1]);
    *pdf = envsamp_cdf_pdf(cdf, s->dir);
    envsamp_cdf_invert(cdf, s->dir, back);
}
END
# The control: a function of the host alone, which a kernel must not call.
sed 's/envsamp_kd_invert(kd, s->dir, back)/envsamp_kd_get_block(kd, 0, 0)/' "$scratch/device.cu" \
    > "$scratch/host.cu"

with_nvcc()  { nvcc -I. -c "$1" -o "$scratch/out.o"; }
# What the headers of CUDA declare for both sides, and nvcc by itself.
cat > "$scratch/cuda.h" << 'END'
#define __CUDACC__
#define __global__ __attribute__((global))
#define __device__ __attribute__((device))
#define __host__ __attribute__((host))
#define __forceinline__ inline
#include <string.h>
#define memcpy __builtin_memcpy
#define ENVSAMP_SQRT __builtin_sqrt
#define ENVSAMP_SQRTF __builtin_sqrtf
#define ENVSAMP_FABSF __builtin_fabsf
#define ENVSAMP_COPYSIGNF __builtin_copysignf
#define ENVSAMP_ASSERT(x) ((void)(x))
END
with_clang() {
    clang -x cuda --cuda-device-only -nocudainc -nocudalib -Wno-unknown-cuda-version \
        -include "$scratch/cuda.h" -I. -fsyntax-only "$1"
}
if command -v nvcc > /dev/null; then
    compile=with_nvcc
elif command -v clang > /dev/null; then
    compile=with_clang
else
    echo "1..0 # SKIP neither nvcc nor clang is installed"
    exit 0
fi
echo 1..2
if $compile "$scratch/device.cu" > "$scratch/log" 2>&1; then
    echo "ok 1 - the functions that sample compile as device code ($compile)"
else
    echo "not ok 1 - the functions that sample compile as device code ($compile)"
    sed 's/^/#   /' "$scratch/log"
    failed=1
fi
if $compile "$scratch/host.cu" > "$scratch/log" 2>&1; then
    echo "not ok 2 - control: a function of the host alone is refused"
    failed=1
else
    echo "ok 2 - control: a function of the host alone is refused"
fi
exit "${failed:-0}"
