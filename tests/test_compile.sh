#!/bin/sh
# How envsamp.h compiles, links and exports, in C and C++, and that the examples to copy from do.
# Prints TAP. CC and CXX name the compilers to try besides gcc and clang.
cd "$(dirname "$0")/.." || exit 1
root=$(pwd)
header=$root/envsamp.h
cc=${CC:-cc}
cxx=${CXX:-c++}
work=$(mktemp -d) || exit 1
trap 'rm -rf "$work"' EXIT
trap 'exit 1' HUP INT TERM

strict="-Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Wdouble-promotion"
strict="$strict -Wcast-qual -fstrict-aliasing -Wstrict-aliasing=1 -Werror -I$root"
strict_c="$strict -Wstrict-prototypes -Wmissing-prototypes"
count=0
failures=0

# check NAME COMMAND...: a test point; a failure says which command it was, and what it printed.
check()
{
    count=$((count + 1))
    name=$1
    shift
    if "$@" >"$work/log" 2>&1; then
        echo "ok $count - $name"
    else
        echo "not ok $count - $name"
        { echo "$0: $name: $*"; head -n 20 "$work/log"; } | sed 's/^/#   /' >&2
        failures=$((failures + 1))
    fi
}

skip()
{
    count=$((count + 1))
    echo "ok $count # SKIP $1"
}

have()
{
    command -v "$1" >/dev/null 2>&1
}

# ---- sources ----

cat >"$work/implementation.c" <<'END'
#define ENVSAMP_IMPLEMENTATION
#include "envsamp.h"
END
cat >"$work/declarations.c" <<'END'
#include "envsamp.h"
#include "envsamp.h"
int main(void);
int main(void) { return envsamp_result_string(ENVSAMP_OK)[0] == 0; }
END
cat >"$work/other.c" <<'END'
#include "envsamp.h"
extern float other(const float dir[3]);
float other(const float dir[3])
{
    float uv[2];

    envsamp_dir_to_uv(ENVSAMP_LATLONG, dir, uv);
    return uv[0];
}
END
cat >"$work/twice.c" <<'END'
#include "envsamp.h"
#define ENVSAMP_IMPLEMENTATION
#include "envsamp.h"
#include "envsamp.h"
END
cat >"$work/static.c" <<'END'
#define ENVSAMP_STATIC
#define ENVSAMP_IMPLEMENTATION
#include "envsamp.h"
int main(void);
int main(void) { return envsamp_result_string(ENVSAMP_OK)[0] == 0; }
END
cat >"$work/own_all.c" <<'END'
#include <stddef.h>
#ifdef __cplusplus
extern "C" {
#endif
extern double own_sqrt(double x);
extern float own_sqrtf(float x);
extern float own_fabsf(float x);
extern float own_copysignf(float x, float y);
extern void own_assert(int holds);
extern void *own_memcpy(void *to, const void *from, size_t bytes);
extern void *own_memset(void *to, int byte, size_t bytes);
extern int own_memcmp(const void *a, const void *b, size_t bytes);
#ifdef __cplusplus
}
#endif
#define ENVSAMP_SQRT(x) own_sqrt(x)
#define ENVSAMP_SQRTF(x) own_sqrtf(x)
#define ENVSAMP_FABSF(x) own_fabsf(x)
#define ENVSAMP_COPYSIGNF(x, y) own_copysignf(x, y)
#define ENVSAMP_ASSERT(x) own_assert(!!(x))
#define ENVSAMP_MEMCPY(to, from, bytes) own_memcpy(to, from, bytes)
#define ENVSAMP_MEMSET(to, byte, bytes) own_memset(to, byte, bytes)
#define ENVSAMP_MEMCMP(a, b, bytes) own_memcmp(a, b, bytes)
#define ENVSAMP_IMPLEMENTATION
#include "envsamp.h"
#if defined(assert) || defined(HUGE_VAL) || defined(FP_NAN)
#error "math.h or assert.h came along"
#endif
END
cat >"$work/no_stdio.c" <<'END'
#define ENVSAMP_IMPLEMENTATION
#include "envsamp.h"
#ifdef BUFSIZ
#error "stdio.h came along"
#endif
END

# ---- compilers and standards ----

# standards STANDARD...: all checks in the first one, the two that matter in the others. What the
# optimiser warns of depends on its level, not on the standard or the language, so it works once.
standards()
{
    level=-O2
    for standard in "$@"; do
        for source in implementation declarations; do
            check "$compiler $standard: $source" compile "$source" $level
        done
        level=-fsyntax-only
    done
    standard=$1
    check "$compiler $standard: without assert" compile implementation $release -DNDEBUG
    check "$compiler $standard: ENVSAMP_STATIC, and most of it unused" compile static -O1
    check "$compiler $standard: a function of one's own for each of libc" compile own_all -O0
    check "$compiler $standard: without stdio.h" compile no_stdio -O0
}

# compile SOURCE FLAG...
compile()
{
    source=$1
    shift
    $compiler -x "$language" "-std=$standard" $flags "$@" -c "$work/$source.c" -o "$work/a.o"
}

# Nothing of a libc is included where all that the header calls is the user's.
includes_no_libc()
{
    $cc -std=c99 -I"$root" -M "$work/own_all.c" >"$work/included" &&
        grep -q 'envsamp\.h' "$work/included" &&
        ! tr ' ' '\n' <"$work/included" | grep -E '/(string|math|assert|std(lib|io)|errno)\.h'
}

# freestanding FLAG...: own_all.c, with no more headers than those of the compiler itself.
freestanding()
{
    clang --target=wasm32 "$@" -ffreestanding -nostdlib -nostdinc -isystem "$own_headers" $flags -O2 \
        -c "$work/own_all.c" -o "$work/a.o"
}

# Without a libc, in C and C++. What a compiler calls of its own accord are mem functions.
try_freestanding()
{
    own_headers=$(clang -print-resource-dir 2>/dev/null)/include
    if [ -f "$own_headers/stddef.h" ] && clang --target=wasm32 -x c -c /dev/null -o "$work/a.o" \
            2>/dev/null; then
        flags=$strict_c
        check "wasm32 without a libc, as C" freestanding -x c -std=c99
        if have llvm-nm; then
            llvm-nm -u "$work/a.o" >"$work/calls"
            check "which calls but what is the user's, and mem functions" only_own_calls
        fi
        flags=$strict
        check "wasm32 without a libc, as C++" freestanding -x c++ -std=c++11
    else
        skip "no clang that makes wasm32"
    fi
}

only_own_calls()
{
    [ -s "$work/calls" ] && ! awk '{ print $2 }' "$work/calls" |
        grep -Ev '^(own_(sqrtf?|fabsf|copysignf|assert|mem(cpy|set|cmp))|mem(cpy|set|move)|__.*)$'
}

# untried COMPILER: whether it is not one that was tried under another name.
untried()
{
    banner=$(${1%% *} --version 2>/dev/null | sed '1s/^[^ ]* //; q')
    case $tried in *"<$banner>"*) return 1 ;; esac
    tried="$tried<$banner>"
}

# try_compilers LANGUAGE FLAGS "STANDARDS" COMPILER...
try_compilers()
{
    language=$1 flags=$2 wanted=$3
    [ $language = c ] && release=-O3 || release=-fsyntax-only
    tried=
    shift 3
    for compiler in "$@"; do
        if ! have "${compiler%% *}"; then
            skip "no $compiler"
        elif untried "$compiler"; then
            standards $wanted
        fi
    done
}

try_compilers c "$strict_c" "c99 c11 c17" "$cc" gcc clang
try_compilers c++ "$strict" "c++11 c++17 c++20" "$cxx" g++ clang++

check "no header of libc with functions of one's own" includes_no_libc
try_freestanding

# ---- linking ----

link_two()
{
    $cc -std=c99 -I"$root" -c "$work/declarations.c" -o "$work/declarations.o" &&
        $cc -std=c99 -I"$root" -c "$work/other.c" -o "$work/other.o" &&
        $cc -std=c99 -I"$root" -c "$1" -o "$work/linked.o" &&
        $cc "$work/declarations.o" "$work/other.o" "$work/linked.o" -lm -o "$work/linked" &&
        "$work/linked"
}

link_mixed()
{
    $cc -std=c99 -I"$root" -c "$work/implementation.c" -o "$work/linked.o" &&
        $cxx -x c++ -std=c++11 -I"$root" -c "$work/declarations.c" -o "$work/mixed.o" &&
        $cxx "$work/mixed.o" "$work/linked.o" -lm -o "$work/mixed" && "$work/mixed"
}

link_static()
{
    $cc -std=c99 -I"$root" -c "$work/static.c" -o "$work/static.o" &&
        ! nm -g --defined-only "$work/static.o" | awk '$3 != "main"' | grep .
}

# ENVSAMP_STATIC that comes too late, or goes, in a file of its own for each order of includes. Each
# is compiled, so that what is refused is the order.
static_orders()
{
    late='#define ENVSAMP_STATIC
#define ENVSAMP_IMPLEMENTATION'
    early='#define ENVSAMP_STATIC'
    include='#include "envsamp.h"'
    plain='#define ENVSAMP_IMPLEMENTATION'
    gone='#undef ENVSAMP_STATIC'
    refused "$include" "$late" "$include" && refused "$include" "$early" "$include" &&
        refused "$plain" "$include" "$early" "$include" &&
        refused "$early" "$include" "$gone" "$plain" "$include" &&
        accepted "$late" "$include" "$include" &&
        accepted "$late" "$include" "$gone" '#undef ENVSAMP_IMPLEMENTATION' "$include" &&
        accepted "$early" "$include" "$plain" "$include" &&
        accepted "$include" "$plain" "$include"
}

# accepted LINE...: whether a file of these lines compiles.
accepted()
{
    printf '%s\n' "$@" >"$work/order.c"
    $cc -std=c99 -I"$root" -fsyntax-only "$work/order.c" >"$work/order.log" 2>&1 || {
        echo "does not compile:"
        cat "$work/order.c" "$work/order.log"
        return 1
    }
}

# refused LINE...: whether a file of these lines is refused, for ENVSAMP_STATIC.
refused()
{
    if accepted "$@" >/dev/null; then
        echo "compiles:"
        cat "$work/order.c"
        return 1
    fi
    grep -q 'error.*ENVSAMP_STATIC must be defined before' "$work/order.log"
}

check "ENVSAMP_STATIC after another include is an error" static_orders
check "the implementation and two users link" link_two "$work/implementation.c"
check "so they do where it was included before and after" link_two "$work/twice.c"
if have "${cxx%% *}"; then
    check "C++ calls what C compiled" link_mixed
else
    skip "no $cxx"
fi

# ---- symbols ----

$cc -std=c99 -O2 -I"$root" -c "$work/implementation.c" -o "$work/implementation.o"
$cc -std=c99 -O2 -DNDEBUG -I"$root" -c "$work/implementation.c" -o "$work/release.o"
$cc -std=c99 -O2 -I"$root" -c "$work/own_all.c" -o "$work/own_all.o"

only_own_exports()
{
    [ -s "$work/implementation.o" ] &&
        ! nm -g --defined-only "$work/implementation.o" | awk '{ print $3 }' |
            grep -v '^envsamp_[a-z]'
}

# Nothing writable, so no globals.
no_writable_data()
{
    [ -s "$work/implementation.o" ] &&
        ! nm "$work/implementation.o" | grep -i ' [bcdgs] '
}

# undefined_only OBJECT EXTENDED-REGEXP
undefined_only()
{
    [ -s "$1" ] && ! nm -u "$1" | awk '{ print $2 }' |
        grep -Ev "^(__)?mem(cpy|set|move|cmp)(_chk)?\$|^_GLOBAL_OFFSET_TABLE_\$|^($2)\$"
}

if have nm; then
    check "only envsamp_ names are exported" only_own_exports
    check "there is no writable data" no_writable_data
    check "mem functions, sqrt and assert are all that is linked" \
        undefined_only "$work/implementation.o" 'sqrtf?|__assert_fail|__assert_rtn|__stack_chk_fail'
    check "no assert with NDEBUG" undefined_only "$work/release.o" 'sqrtf?|__stack_chk_fail'
    check "functions of one's own replace those of libc" undefined_only "$work/own_all.o" \
        'own_(sqrtf?|fabsf|copysignf|assert|mem(cpy|set|cmp))|__stack_chk_fail'
    check "ENVSAMP_STATIC exports nothing" link_static
else
    skip "no nm"
fi

# ---- the text ----

no_long_lines()
{
    ! awk 'length($0) > 100 { print FILENAME ": " FNR ": " length($0) " columns" }' "$header" |
        grep .
}

no_tabs()
{
    ! grep -n "$(printf '\t')\|[[:space:]]\$" "$header"
}

check "no line has more than 100 columns" no_long_lines
check "no tabs and no blanks at the ends of lines" no_tabs

# ---- the contract ----

# Each function as a pointer of its documented type, taken where only declarations are seen.
while read -r name type; do
    [ -n "$name" ] || continue
    {
        echo "#include \"envsamp.h\""
        echo "typedef envsamp_kd kd; typedef envsamp_image im; typedef envsamp_kd_desc de;"
        echo "typedef envsamp_result re; typedef const float cf;"
        echo "typedef envsamp_buffer bu; typedef envsamp_mapping ma;"
        echo "typedef envsamp_halftone_desc hd; typedef envsamp_lights_desc ld;"
        echo "typedef envsamp_light li; typedef envsamp_lights_info in; typedef envsamp_sizes si;"
        echo "extern int use(void);"
        echo "int use(void) { $type = $name; return p != 0; }"
    } >"$work/contract.c"
    check "$name is declared as promised" $cc -std=c99 -Wall -Werror -Wno-address \
        -I"$root" -c "$work/contract.c" -o "$work/a.o"
done <<'END'
envsamp_result_string const char *(*p)(re)
envsamp_uv_to_dir void (*p)(ma, float, float, float *)
envsamp_dir_to_uv void (*p)(ma, cf *, float *)
envsamp_luminance float (*p)(cf *)
envsamp_mis_power float (*p)(float, float)
envsamp_lookup void (*p)(const im *, int, cf *, float *)
envsamp_kd_defaults de (*p)(void)
envsamp_kd_sizes re (*p)(const im *, const de *, envsamp_sizes *)
envsamp_kd_build re (*p)(const im *, const de *, bu, bu, const kd **)
envsamp_kd_open re (*p)(const void *, size_t, const kd **)
envsamp_kd_bytes size_t (*p)(const kd *)
envsamp_kd_sample envsamp_sample (*p)(const kd *, float, float)
envsamp_kd_pdf float (*p)(const kd *, cf *)
envsamp_kd_invert int (*p)(const kd *, cf *, float *)
envsamp_kd_sample_n void (*p)(const kd *, size_t, cf *, cf *, float *, float *, float *, float *)
envsamp_kd_pdf_n void (*p)(const kd *, size_t, cf *, cf *, cf *, float *)
envsamp_kd_get_info re (*p)(const kd *, envsamp_kd_info *)
envsamp_kd_get_block re (*p)(const kd *, int, envsamp_kd_block *)
envsamp_halftone_sizes re (*p)(int, int, const hd *, si *)
envsamp_halftone re (*p)(cf *, int, int, size_t, const hd *, envsamp_texel *, int, int *, bu)
envsamp_lights_defaults ld (*p)(void)
envsamp_lights_sizes re (*p)(const im *, const ld *, si *)
envsamp_lights re (*p)(const im *, const ld *, li *, int, bu, in *)
envsamp_lights_interleave re (*p)(const li *, int, int, int, float, uint32_t, li *)
envsamp_emissive_mask re (*p)(const im *, const ld *, uint8_t *, bu, float *)
envsamp_lm_scratch_bytes size_t (*p)(const envsamp_lm_desc *)
envsamp_lm re (*p)(const envsamp_lm_desc *, envsamp_lm_fn, void *, double *, bu, envsamp_lm_info *)
END

# Numbers that tables, files and other languages may hold.
cat >"$work/values.c" <<'END'
#include "envsamp.h"
#define SAME(name, condition) extern int name[(condition) ? 1 : -1]
SAME(results, ENVSAMP_OK == 0 && ENVSAMP_ERR_NULL == 1 && ENVSAMP_ERR_SIZE == 2
     && ENVSAMP_ERR_PARAM == 3 && ENVSAMP_ERR_VALUE == 4 && ENVSAMP_ERR_BLACK == 5
     && ENVSAMP_ERR_MEMORY == 6 && ENVSAMP_ERR_ALIGN == 7 && ENVSAMP_ERR_FORMAT == 8);
SAME(mappings, ENVSAMP_LATLONG == 0 && ENVSAMP_HEMISPHERE == 1 && ENVSAMP_OCTAHEDRAL == 2);
SAME(selects, ENVSAMP_KD_WARP == 0 && ENVSAMP_KD_ALIAS == 1 && ENVSAMP_KD_FIT == 2);
SAME(criteria, ENVSAMP_KD_EXCESS == 0 && ENVSAMP_KD_SSE == 1 && ENVSAMP_KD_VARIANCE == 2
     && ENVSAMP_KD_RANGE == 3);
SAME(models, ENVSAMP_KD_LOG == 0 && ENVSAMP_KD_POWER == 1);
SAME(objectives, ENVSAMP_KD_L1 == 0 && ENVSAMP_KD_CHI2 == 1 && ENVSAMP_ALIGN == 8);
SAME(kernels, ENVSAMP_KERNEL_SZIRMAY == 0 && ENVSAMP_KERNEL_FLOYD_STEINBERG == 1
     && ENVSAMP_KERNEL_JARVIS == 2 && ENVSAMP_KERNEL_STUCKI == 3
     && ENVSAMP_KERNEL_OSTROMOUKHOV == 4 && ENVSAMP_KERNEL_RANDOM == 5);
SAME(scans, ENVSAMP_SCAN_CELLS == 0 && ENVSAMP_SCAN_TEXELS == 1);
SAME(methods, ENVSAMP_LIGHTS_RELAXED == 0 && ENVSAMP_LIGHTS_DECOMPOSED == 1
     && ENVSAMP_LIGHTS_MEDIAN_CUT == 2 && ENVSAMP_LIGHTS_VARIANCE_CUT == 3
     && ENVSAMP_LIGHTS_HALFTONE == 4 && ENVSAMP_LIGHTS_RANDOM == 5);
SAME(texel, sizeof(envsamp_texel) == 12 && offsetof(envsamp_texel, probability) == 8);
SAME(light, sizeof(envsamp_light) == 36 && offsetof(envsamp_light, direct) == 32);
SAME(sample, sizeof(envsamp_sample) == 24 && offsetof(envsamp_sample, pdf) == 12);
SAME(block, sizeof(envsamp_kd_block) == 24 && offsetof(envsamp_kd_block, probability) == 20);
END
check "enumerators and structures have their values" $cc -std=c99 -Wall -Werror -I"$root" \
    -c "$work/values.c" -o "$work/a.o"

# ---- what may be left out, and what is there when asked for ----

for out in -DENVSAMP_NO_FIT -DENVSAMP_NO_LIGHTS -DENVSAMP_NO_CDF -DENVSAMP_ALLOC \
    "-DENVSAMP_NO_FIT -DENVSAMP_NO_LIGHTS -DENVSAMP_NO_CDF -DENVSAMP_ALLOC"; do
    check "$out compiles as C" $cc -std=c99 -O1 $strict_c $out -c "$work/implementation.c" \
        -o "$work/a.o"
    check "and is static" $cc -std=c99 -O1 $strict_c $out -c "$work/static.c" -o "$work/a.o"
    have "${cxx%% *}" && check "and as C++" $cxx -x c++ -std=c++11 -O1 $strict $out \
        -c "$work/implementation.c" -o "$work/a.o"
done

cat >"$work/left_out.c" <<'END'
#define ENVSAMP_NO_FIT
#define ENVSAMP_NO_LIGHTS
#define ENVSAMP_ALLOC
#define ENVSAMP_MALLOC(bytes) give(bytes)
#define ENVSAMP_FREE(block) take(block)
#define ENVSAMP_IMPLEMENTATION
#include <stdlib.h>
static int given, fail_at;
static void *give(size_t bytes) { return given + 1 == fail_at ? NULL : (given++, malloc(bytes)); }
static void take(void *block) { given -= block != NULL; free(block); }
#include "envsamp.h"
int main(void)
{
    static const float pixels[8] = { 1, 2, 3, 4, 5, 6, 7, 8 }, black[8] = { 0 };
    envsamp_image map = { pixels, 4, 2, 1, 0, ENVSAMP_LATLONG };
    envsamp_kd_desc desc = { 0 };
    envsamp_result result = ENVSAMP_ERR_NULL;
    envsamp_kd *kd = envsamp_kd_new(&map, NULL, &result);
    envsamp_cdf *cdf = envsamp_cdf_new(&map, NULL, NULL);
    const envsamp_kd *again;
    int wrong = !kd || !cdf || result != ENVSAMP_OK || given != 2;

    wrong += envsamp_kd_open(kd, envsamp_kd_bytes(kd), &again) != ENVSAMP_OK;
    wrong += !(envsamp_kd_sample(kd, 0.2f, 0.3f).pdf > 0.0f);
    wrong += !(envsamp_cdf_sample(cdf, 0.2f, 0.3f).pdf > 0.0f);
    envsamp_kd_free(kd);
    envsamp_cdf_free(cdf);
    envsamp_kd_free(NULL);
    wrong += given != 0;
    desc.select = ENVSAMP_KD_FIT;
    wrong += envsamp_kd_new(&map, &desc, &result) || result != ENVSAMP_ERR_PARAM;
    map.pixels = black;
    wrong += envsamp_kd_new(&map, NULL, &result) || result != ENVSAMP_ERR_BLACK;
    wrong += envsamp_cdf_new(&map, NULL, &result) || result != ENVSAMP_ERR_BLACK || given != 0;
    for (fail_at = 1; fail_at < 3; fail_at++) {
        wrong += envsamp_kd_new(&map, NULL, &result) || result != ENVSAMP_ERR_MEMORY;
        wrong += envsamp_cdf_new(&map, NULL, &result) || result != ENVSAMP_ERR_MEMORY;
        wrong += given != 0;
    }
    return wrong;
}
END
left_out_runs()
{
    $cc -std=c99 -O1 -g -w -fsanitize=address,undefined -I"$root" "$work/left_out.c" -lm \
        -o "$work/left_out" && "$work/left_out"
}
check "_new and _free own all that they take, also when memory runs out" left_out_runs

# ---- the README's program, and the examples in C++ ----

first_block()
{
    awk '/^```/ { if (inside) exit; if ($0 == "```c") { inside = 1; next } } inside' "$1"
}

# in_order A B: every line of A stands in B, in that order; comments, blanks at the ends and empty
# lines aside.
in_order()
{
    awk 'function bare(line) {
             gsub(/\/\*[^*]*\*\//, "", line)
             gsub(/^[ \t]+|[ \t]+$/, "", line)
             return line
         }
         NR == FNR { if (bare($0) != "") wanted[++count] = bare($0); next }
         found < count && bare($0) == wanted[found + 1] { found++ }
         END { if (!count || found < count) { print "not there: " wanted[found + 1]; exit 1 } }' \
        "$1" "$2"
}

# README: another file than README.md, such as a draft.
readme_block()
{
    first_block "${README:-$root/README.md}" >"$work/block.c"
    if grep -q 'int main' "$work/block.c"; then
        echo "the block is a whole program, which test_snippets.sh compiles"
        return 0
    fi
    in_order "$work/block.c" "$root/examples/quickstart.c"
}

# What in_order must reject: a line that differs, and two that are exchanged.
order_controls()
{
    printf 'one;\n\n    two; /* second */\nthree;\n' >"$work/text.c"
    printf 'one;   /* first */\ntwo;\nthree;\n' >"$work/same.c"
    printf 'two;\none;\n' >"$work/exchanged.c"
    printf 'one;\ntwo_of;\n' >"$work/other.c"
    : >"$work/empty.c"
    in_order "$work/same.c" "$work/text.c" && ! in_order "$work/exchanged.c" "$work/text.c" &&
        ! in_order "$work/other.c" "$work/text.c" && ! in_order "$work/empty.c" "$work/text.c"
}

# Alone, as a user has it: no flags but -lm.
quickstart_runs()
{
    $cc -std=c99 -O2 $strict_c "$root/examples/quickstart.c" "$root/examples/common/image.c" \
        "$root/examples/common/hdr.c" -lm -o "$work/quickstart" && "$work/quickstart"
}

check "quickstart compiles and runs as C" quickstart_runs
if have "${cxx%% *}"; then
    for example in quickstart path_tracer lights halftone table_file placement; do
        check "$example compiles as C++" $cxx -x c++ -std=c++11 $strict \
            -c "$root/examples/$example.c" -o "$work/a.o"
    done
    echo '#include "examples/common/cube.h"' >"$work/cube.c"
    check "cube.h compiles as C++" $cxx -x c++ -std=c++11 $strict -c "$work/cube.c" -o "$work/a.o"
else
    skip "no $cxx"
fi
check "the README's first block stands in quickstart, line by line" readme_block
check "lines that differ, or are exchanged, are seen" order_controls

echo "1..$count"
[ "$failures" -eq 0 ]
