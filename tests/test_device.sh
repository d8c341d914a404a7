#!/bin/sh
# test_device.sh: the functions that sample compile as device code, from the same text: in CUDA by
# nvcc and clang, in HIP by clang, which needs no headers of either for that, and with qualifiers of
# the user's own. In each a function of the host alone must be refused. Skipped by name where a
# compiler is not.
set -u
cd "$(dirname "$0")/.." || exit 1
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
count=0

cat > "$scratch/device.cu" << 'END_OF_FILE'
#define ENVSAMP_IMPLEMENTATION
#define ENVSAMP_STATIC
#include "envsamp.h"

__global__ void draw(const envsamp_kd *kd, const float *u, envsamp_sample *s, float *pdf,
                     float *back)
{
    *s = envsamp_kd_sample(kd, u[0], u[1]);
    *pdf = envsamp_kd_pdf(kd, s->dir);
    *s = envsamp_kd_sample_facing(kd, s->dir, u[2], u[3]);
    *pdf += envsamp_kd_pdf_facing(kd, u, s->dir);
    envsamp_kd_invert_facing(kd, u, s->dir, back);
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
END_OF_FILE
# The control: a function of the host alone, which a kernel must not call.
sed 's/envsamp_kd_invert(kd, s->dir, back)/envsamp_kd_get_block(kd, 0, 0)/' "$scratch/device.cu" \
    > "$scratch/host.cu"
# A user's own qualifiers, under which the compiler's are not known.
{
    echo '#define ENVSAMP_DEVICE __attribute__((host)) __attribute__((device))'
    echo '#undef __host__'
    echo '#undef __device__'
} > "$scratch/own.h"

# What the headers of CUDA and HIP declare for both sides.
cat > "$scratch/stubs.h" << 'END_OF_FILE'
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
END_OF_FILE

nvcc=$(command -v nvcc || command -v /usr/local/cuda/bin/nvcc)
with_nvcc() { "$nvcc" -I. "$@" -c -o "$scratch/out.o"; }
with_cuda() {
    clang -x cuda --cuda-device-only -nocudainc -nocudalib -Wno-unknown-cuda-version \
        -D__CUDACC__ -include "$scratch/stubs.h" -I. -fsyntax-only "$@"
}
with_hip() {
    clang -x hip --cuda-device-only --offload-arch=gfx90a -nogpuinc -nogpulib \
        -include "$scratch/stubs.h" -I. -fsyntax-only "$@"
}
with_own() { with_hip -include "$scratch/own.h" "$@"; }

# both COMPILE WORDS: what samples compiles, and what does not is refused for that.
both()
{
    count=$((count + 1))
    if "$1" "$scratch/device.cu" > "$scratch/log" 2>&1; then
        echo "ok $count - the functions that sample compile as device code: $2"
    else
        echo "not ok $count - the functions that sample compile as device code: $2"
        sed 's/^/#   /' "$scratch/log" | head -20
        failed=1
    fi
    count=$((count + 1))
    if ! "$1" "$scratch/host.cu" > "$scratch/log" 2>&1 \
        && grep -q "envsamp_kd_get_block" "$scratch/log" \
        && grep -q "__host__ function" "$scratch/log"; then
        echo "ok $count - a function of the host alone is refused: $2"
    else
        echo "not ok $count - a function of the host alone is refused: $2"
        sed 's/^/#   /' "$scratch/log" | head -20
        failed=1
    fi
}

skip()
{
    count=$((count + 1))
    echo "ok $count # SKIP $1"
}

if [ -n "$nvcc" ]; then
    both with_nvcc "CUDA, nvcc"
else
    skip "no nvcc"
fi
if command -v clang > /dev/null; then
    both with_cuda "CUDA, clang"
    both with_hip "HIP, clang"
    both with_own "qualifiers of one's own, clang"
else
    skip "no clang"
fi
echo "1..$count"
exit "${failed:-0}"
