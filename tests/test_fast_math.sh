#!/bin/sh
# tests/fast_math.c with -ffast-math, of gcc and clang, with AVX2 and without; and, with IEEE
# arithmetic, under the undefined behaviour sanitizer. ALL=1: -O0 and -O1 with clang and AVX2, too.
# HEADER names the folder of another envsamp.h.
cd "$(dirname "$0")/.." || exit 1
cc=${CC:-cc}
header=${HEADER:-.}
tmp=$(mktemp -d) || exit 1
trap 'rm -rf "$tmp"' EXIT
count=0

printf 'int main(void) { return !__builtin_cpu_supports("avx2"); }\n' >"$tmp/avx2.c"
printf 'int main(void) { return 0; }\n' >"$tmp/probe.c"

# able COMPILER FLAGS...: whether it is here, knows the flags, and what it makes runs.
able()
{
    probe=probe
    case " $* " in *" -mavx2 "*) probe=avx2 ;; esac
    command -v "$1" >/dev/null 2>&1 && "$@" "$tmp/$probe.c" -o "$tmp/probe" 2>/dev/null \
        && "$tmp/probe" 2>/dev/null
}

# holds COMPILER FLAGS...: a test point; failures become comments.
holds()
{
    count=$((count + 1))
    if ! able "$@"; then
        echo "ok $count # SKIP no $* here"
    elif ! "$@" -std=c99 -w -DUNDER_TEST -I"$header" -c tests/fast_math.c -o "$tmp/tested.o" \
            || ! "$@" "$tmp/tested.o" "$tmp/checks.o" -lm -o "$tmp/fast_math"; then
        echo "not ok $count - $* compiles"
    elif "$tmp/fast_math" >"$tmp/out" 2>"$tmp/log"; then
        echo "ok $count - $*: $(grep -c '^ok' "$tmp/out") checks"
    else
        echo "not ok $count - $*"
        { grep -A 1 '^not ok' "$tmp/out"; tail -n 1 "$tmp/out"; head -n 5 "$tmp/log"; } \
            | sed 's/^/#   /'
    fi
}

if ! $cc -std=c99 -O1 -g -Wall -Wextra -I"$header" -Itests -c tests/fast_math.c \
        -o "$tmp/checks.o"; then
    echo "1..1"
    echo "not ok 1 - the checks compile"
    exit 1
fi
for compiler in gcc clang; do
    holds $compiler -O2 -ffast-math
    holds $compiler -O2 -ffast-math -mavx2
    holds $compiler -O3 -ffast-math
    holds $compiler -O3 -ffast-math -mavx2
    holds $compiler -O1 -fsanitize=undefined,float-cast-overflow -fno-sanitize-recover=all
done
holds gcc -O0 -ffast-math
holds gcc -O1 -ffast-math
if [ -n "$ALL" ]; then
    for compiler in gcc clang; do
        for level in 0 1; do
            holds $compiler -O$level -ffast-math
            holds $compiler -O$level -ffast-math -mavx2
        done
    done
fi
echo "1..$count"
