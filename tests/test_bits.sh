#!/bin/sh
# The same map gives the same tables, samples, halftones and lights, bit for bit, with gcc and clang,
# C and C++, at every optimisation level, as long as arithmetic is not contracted; and, where there
# are cross compilers and qemu, on other machines. `make portability` asks more of them.
cd "$(dirname "$0")/.." || exit 1
tmp=$(mktemp -d) || exit 1
trap 'rm -rf "$tmp"' EXIT
count=0
want=
run=        # what runs programs of another machine

agrees() {  # compiler and flags
    count=$((count + 1))
    for tool in "$1" ${run:+"$run"}; do
        if ! command -v "$tool" >/dev/null 2>&1; then
            echo "ok $count # SKIP no $tool here"
            return
        fi
    done
    got=$("$@" -w -I. tests/portability/bits.c -o "$tmp/bits" -lm && $run "$tmp/bits" 2>"$tmp/log")
    if [ $? -eq 126 ]; then
        echo "ok $count # SKIP nothing here runs what $1 makes"
        return
    fi
    cat "$tmp/log" 2>/dev/null
    want=${want:-$got}
    [ -n "$got" ] && [ "$got" = "$want" ] && result=ok || result="not ok"
    echo "$result $count - $* gives $got, wanted $want"
}

agrees gcc -std=c99 -O0
agrees gcc -std=c99 -O2
agrees gcc -std=c99 -O3 -march=native
agrees gcc -std=c99 -Os -DENVSAMP_STATIC
agrees clang -std=c99 -ffp-contract=off -O0
agrees clang -std=c99 -ffp-contract=off -O2
agrees clang -std=c99 -ffp-contract=off -O3 -march=native
agrees g++ -x c++ -std=c++11 -ffp-contract=off -O3 -march=native
agrees clang++ -x c++ -std=c++11 -ffp-contract=off -O3
agrees i686-linux-gnu-gcc -static -std=c99 -O2 -msse2 -mfpmath=sse
run=qemu-aarch64
agrees aarch64-linux-gnu-gcc -static -std=c99 -O2
echo "1..$count"
