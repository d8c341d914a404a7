#!/bin/sh
# portability.sh: the same bits with every compiler, machine and standard, in one table.
#
#     sh tests/portability.sh             all rows
#     sh tests/portability.sh 'arm|wasm'  those that grep -E finds
#
# Every row compiles a program with one compiler for one machine and runs it, under qemu, wine or
# node where it has to:
#
#     bits        tests/portability/bits.c hashes tables, samples, densities, inverses, lights and
#                 halftones twice: as they are in memory, equal on all machines of one byte order,
#                 and as values, equal on all machines. Warnings are errors.
#     own bits    the same where FLT_EVAL_METHOD is not 0, which has bits of its own: it has to run
#     test_lm     tests/test_lm.c
#     quickstart  examples/quickstart.c
#     device      bits.c compiled by nvcc, not run
#
# What is missing is skipped by name; `make portability-setup` installs it. Programs for other
# machines are linked statically, those for wasm32 freestanding, without a libc; the table does not
# repeat that. What has no -ffp-contract=off contracts nothing anyway: gcc's -std=c99 to c17, tcc.
# The exit status is 1 if a row failed. JOBS=2: rows at a time; the default is one a core.
cd "$(dirname "$0")/.." || exit 1

strict="-Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Wdouble-promotion
        -Wcast-qual -Werror"

# ---- one row: compiles and runs it, and says what came of it on one line ----

# Fields of a row: machine|byte order|runner|compiler|standard|flags|program
read_row() {
    IFS='|' read -r machine order runner compiler standard flags program <<END
$(sed -n "$2p" "$1/rows")
END
}

# The files and flags of a program.
sources_of() {
    language="-x c"
    case $standard in *c++* | *gnu++*) language="-x c++" ;; esac
    case $compiler in nvcc) language="-x cu" ;; tcc) language= ;; esac
    warnings=-w
    case $program,$compiler in bits,tcc) ;; bits,*) warnings=$strict ;; esac
    case $program,$language in
    bits,"-x c") warnings="$warnings -Wstrict-prototypes -Wmissing-prototypes" ;;
    esac
    case $program in
    *bits | device) source=tests/portability/bits.c ;;
    test_lm) source="tests/test_lm.c tests/envsamp.c" ;;
    quickstart)
        source="examples/quickstart.c examples/common/image.c examples/common/hdr.c" ;;
    esac
    link=-lm
    case $machine in
    wasm32)
        source=tests/portability/wasm.c
        link="-ffreestanding -nostdlib -Wl,--no-entry" ;;
    cuda) link=-c ;;
    "$(uname -m)") ;;
    *) link="-static -lm" ;;
    esac
}

# Compiles $1 to $2 with the warnings $3.
compile() {
    # shellcheck disable=SC2086
    $compiler -std=$standard $flags $3 -I. $language $1 $link -o "$2"
}

run_row() {
    base=$1/$2
    read_row "$1" "$2"
    sources_of
    for tool in ${compiler%% *} ${runner%% *} $(case $machine in wasm32) echo wasm-ld ;; esac); do
        if ! command -v "$tool" >/dev/null; then
            echo "skip no $tool here"
            return
        fi
    done
    cat >"$base.probe.c" <<'END'
#ifdef __wasm__
#define puts(text) (void)(text)
#else
#include <stdio.h>
#endif

static double product(float x, float y) { return (double)x * (double)y; }
static double (*volatile multiply)(float, float) = product;

int main(void)
{
    const double p = multiply(3.0f, 5.0f);

    puts(p > 15.0 || p < 15.0 ? "wrong" : "able");
    return 0;
}
END
    if ! compile "$base.probe.c" "$base.exe" -w >/dev/null 2>&1; then
        echo "skip ${compiler%% *} has no $machine here"
        return
    fi
    # Whether what runs programs of the machine is able to; not asked of node. qemu-s390x before 8.1
    # takes one of the factors of MDEB and MDEBR, which clang uses, for 64 bits.
    able=able
    case $runner in node*) ;; *) able=$($runner "$base.exe" 2>/dev/null | tr -d '\r') ;; esac
    if ! compile "$source" "$base.exe" "$warnings" >"$base.log" 2>&1; then
        echo "fail does not compile"
    elif [ "$program" = device ]; then
        echo "compiled"
    elif [ "$able" = wrong ]; then
        echo "linked $runner multiplies 3 by 5 wrong"
    elif [ "$able" != able ]; then
        echo "linked nothing here runs it"
    elif ! timeout 1200 $runner "$base.exe" >"$base.out" 2>>"$base.log"; then
        cat "$base.out" >>"$base.log"
        echo "fail an error, or longer than 20 minutes"
    else
        case $program in
        *bits) echo "ran $(tr -d '\r' <"$base.out")" ;;
        *) echo "passed" ;;
        esac
    fi
}

if [ "$1" = --row ]; then
    run_row "$2" "$3" >"$2/$3.result"
    exit 0
fi

# ---- the rows ----

tmp=$(mktemp -d) || exit 1
trap 'WINEPREFIX=$tmp/wine wineserver -k >/dev/null 2>&1; rm -rf "$tmp"' EXIT
export WINEPREFIX="$tmp/wine" WINEDEBUG=-all

row() {
    echo "$1|$2|$3|$4|$5|$6|$7" >>"$tmp/rows"
}

# Rows of gcc: machine, byte order, runner, flags of the machine, prefix of its commands.
gcc_rows() {
    row "$1" "$2" "$3" "${5}gcc" c99 "-O2${4:+ $4}" bits
    row "$1" "$2" "$3" "${5}gcc" gnu17 "-O3${4:+ $4} -ffp-contract=off" bits
    row "$1" "$2" "$3" "${5}g++" c++11 "-O2${4:+ $4} -ffp-contract=off" bits
    row "$1" "$2" "$3" "${5}gcc" c99 "-O1${4:+ $4}" test_lm
    row "$1" "$2" "$3" "${5}gcc" c99 "-O1${4:+ $4}" quickstart
}

clang_row() {
    row "$1" "$2" "$3" "clang --target=$5" c99 "-O2${4:+ $4} -ffp-contract=off" bits
}

here=$(uname -m)
order=big
[ "$(printf '\1\0' | od -An -tu2 | tr -d ' ')" = 1 ] && order=little

for level in "-O0" "-O1" "-O2" "-O3 -march=native" "-Os -DENVSAMP_STATIC"; do
    row "$here" $order "" gcc c99 "$level" bits
    row "$here" $order "" clang c99 "$level -ffp-contract=off" bits
done
for standard in c11 c17; do
    row "$here" $order "" gcc $standard -O2 bits
    row "$here" $order "" clang $standard "-O2 -ffp-contract=off" bits
done
row "$here" $order "" gcc gnu17 "-O3 -march=native -ffp-contract=off" bits
for compiler in g++ clang++; do
    row "$here" $order "" $compiler c++11 "-O0 -ffp-contract=off" bits
    row "$here" $order "" $compiler c++11 "-O3 -march=native -ffp-contract=off" bits
    for standard in c++11 c++14 c++17 c++20; do
        row "$here" $order "" $compiler $standard "-O2 -ffp-contract=off" bits
    done
done
row "$here" $order "" gcc c99 -O1 test_lm
row "$here" $order "" gcc c99 -O1 quickstart
row "$here" $order "" tcc c99 "" bits
row "$here" $order "" tcc c99 "" test_lm
row "$here" $order "" tcc c99 "" quickstart
row "$here" $order "" musl-gcc c99 "-O2 -static" bits
row "$here" $order "" musl-gcc c99 "-O1 -static" test_lm
row "$here" $order "" musl-gcc c99 "-O1 -static" quickstart

gcc_rows i686 little "" "-msse2 -mfpmath=sse" i686-linux-gnu-
clang_row i686 little "" "-msse2" i686-linux-gnu
row i686 little "" i686-linux-gnu-gcc c99 "-O2 -mfpmath=387" "own bits"
gcc_rows win64 little wine "" x86_64-w64-mingw32-
gcc_rows win32 little wine "-msse2 -mfpmath=sse" i686-w64-mingw32-
gcc_rows aarch64 little qemu-aarch64 "" aarch64-linux-gnu-
clang_row aarch64 little qemu-aarch64 "" aarch64-linux-gnu
gcc_rows armv7 little qemu-arm "" arm-linux-gnueabihf-
row armv7 little qemu-arm arm-linux-gnueabihf-gcc c99 "-O3 -mfpu=neon-vfpv4" bits
clang_row armv7 little qemu-arm "" arm-linux-gnueabihf
gcc_rows riscv64 little qemu-riscv64 "" riscv64-linux-gnu-
clang_row riscv64 little qemu-riscv64 "" riscv64-linux-gnu
gcc_rows s390x big qemu-s390x "-fexcess-precision=fast" s390x-linux-gnu-
row s390x big qemu-s390x s390x-linux-gnu-gcc c99 "-O2" "own bits"
row s390x big qemu-s390x "clang --target=s390x-linux-gnu" c99 "-O0 -ffp-contract=off" bits
clang_row s390x big qemu-s390x "" s390x-linux-gnu
gcc_rows ppc64 big qemu-ppc64 "" powerpc64-linux-gnu-
clang_row ppc64 big qemu-ppc64 "" powerpc64-linux-gnu
for standard in c99 c++11; do
    row wasm32 little "node tests/portability/wasm.js" "clang --target=wasm32" $standard \
        "-O2 -ffp-contract=off" bits
done
row cuda - "" nvcc c++17 "" device

if [ -n "$1" ]; then
    grep -E -e "$1" "$tmp/rows" >"$tmp/chosen"
    mv "$tmp/chosen" "$tmp/rows"
fi
count=$(wc -l <"$tmp/rows" | tr -d ' ')
[ "$count" = 0 ] && echo "no such row" && exit 1

# ---- all rows, the slow ones, which are the last, first ----

jobs=${JOBS:-$(getconf _NPROCESSORS_ONLN 2>/dev/null || echo 1)}
echo "$count rows, $jobs at a time, some minutes" >&2
command -v wine >/dev/null && wine cmd /c exit >/dev/null 2>&1     # makes its folders, once
i=$count
while [ "$i" -gt 0 ]; do
    echo "$i"
    i=$((i - 1))
done | xargs -P "$jobs" -I '{}' sh tests/portability.sh --row "$tmp" '{}'

# ---- the table ----

line="%-8s %-24s %-6s %-46s %-10s %-38s %-8s %s\n"
# shellcheck disable=SC2059
printf "$line" machine compiler std flags program result memory values
want_little= want_big= want_values=
same=0 passed=0 linked=0 skipped=0 failed=0
i=0
while [ "$i" -lt "$count" ]; do
    i=$((i + 1))
    read_row "$tmp" $i
    read -r status first second rest <"$tmp/$i.result" || status=fail first="no result"
    memory= values=
    case $status,$program in
    ran,bits)
        memory=$first values=$second
        eval "want_$order=\${want_$order:-$memory} want=\$want_$order"
        want_values=${want_values:-$values}
        if [ "$memory $values" = "$want $want_values" ] && [ -n "$values" ]; then
            result="pass: same bits"
            same=$((same + 1))
        else
            result="FAIL: want $want $want_values"
            failed=$((failed + 1))
        fi ;;
    ran,*)
        memory=$first values=$second
        result="pass: runs, FLT_EVAL_METHOD is not 0"
        passed=$((passed + 1)) ;;
    passed,*)
        result="pass"
        passed=$((passed + 1)) ;;
    compiled,*)
        result="compiled"
        linked=$((linked + 1)) ;;
    linked,*)
        result="linked: $first $second $rest"
        linked=$((linked + 1)) ;;
    skip,*)
        result="skip: $first $second $rest"
        skipped=$((skipped + 1)) ;;
    *)
        result="FAIL: $first $second $rest"
        failed=$((failed + 1)) ;;
    esac
    # shellcheck disable=SC2059
    printf "$line" "$machine" "${compiler%% *}" "$standard" "$flags" "$program" "$result" \
        "$memory" "$values"
    case $result in FAIL*) head -n 5 "$tmp/$i.log" 2>/dev/null | sed 's/^/#   /' ;; esac
done
echo "$same rows have the same bits, $passed pass otherwise, $linked are compiled or linked only," \
    "$skipped are skipped, $failed fail"
[ "$failed" = 0 ]
