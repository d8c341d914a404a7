#!/bin/sh
# Every public function uses less than 8 KiB of stack: measured by tests/stack.c with gcc and clang,
# at every optimisation level, as C or C++. With `all`: as both, tuned for this machine, and for
# i686 and AArch64 where there are cross compilers and qemu.
cd "$(dirname "$0")/.." || exit 1
tmp=$(mktemp -d) || exit 1
trap 'rm -rf "$tmp"' EXIT
count=0

{
    echo "#define ENVSAMP_IMPLEMENTATION"
    echo "#define ENVSAMP_ALLOC"
    echo '#include "envsamp.h"'
} >"$tmp/library.c"
cp "$tmp/library.c" "$tmp/library.cpp"

point() {  # result, text
    count=$((count + 1))
    echo "$1 $count - $2"
}

# Prints what is said on stdin of the test points of a program, numbered anew.
points() {
    while IFS= read -r line; do
        case $line in
        1..*) ;;
        ok*) point ok "$what: ${line#*- }" ;;
        not*) point "not ok" "$what: ${line#*- }" ;;
        *) echo "$line" ;;
        esac
    done
}

run=        # what runs programs of another machine

# Neither a frame above the allowance in what no test reaches, nor one whose size depends on data.
bounded() {
    [ -s "$tmp/library.su" ] &&
        ! awk -F '\t' '$2 > 8192 || $3 ~ /^dynamic$/ { print "# " $0; bad = 1 } END { exit !bad }' \
            "$tmp/library.su"
}

measured() {  # compiler of the calls, compiler and flags of the library
    driver=$1
    shift
    what=$*
    case $1 in *++) file=library.cpp ;; *) file=library.c ;; esac
    for tool in "$1" ${run:+"$run"}; do
        if ! command -v "$tool" >/dev/null 2>&1; then
            count=$((count + 1))
            echo "ok $count # SKIP no $tool here"
            return
        fi
    done
    rm -f "$tmp/library.su"
    if ! { $driver -std=c99 -D_POSIX_C_SOURCE=200112L -O1 -I. -c tests/stack.c \
                -o "$tmp/stack.o" &&
            "$@" -w -I. -fstack-usage -c "$tmp/$file" -o "$tmp/library.o" &&
            "$@" "$tmp/stack.o" "$tmp/library.o" -pthread -lm -o "$tmp/stack"; } >"$tmp/log" 2>&1
    then
        point "not ok" "$what compiles"
        sed 's/^/# /' "$tmp/log" | head -20
        return
    fi
    # The linker's search for a function at its first call would count.
    LD_BIND_NOW=1 $run "$tmp/stack" >"$tmp/out"
    points <"$tmp/out"
    grep -q '^1\.\.' "$tmp/out" || point "not ok" "$what: all was measured"
    if bounded; then
        point ok "$what: no frame has more, or depends on data"
    else
        point "not ok" "$what: no frame has more, or depends on data"
    fi
}

# Functions that the header declares and the program does not call.
unmeasured() {
    sed -n 's/.*ENVSAMP_DEF .*\(envsamp_[a-z][a-z_0-9]*\)(.*/\1/p' envsamp.h | sort -u >"$tmp/names"
    [ "$(wc -l <"$tmp/names")" -gt 40 ] || echo "few names"
    while read -r name; do
        grep -q "[^a-z_]$name(" tests/stack.c || echo "# $name"
    done <"$tmp/names"
}

missing=$(unmeasured)
if [ -z "$missing" ]; then
    point ok "every public function is measured"
else
    point "not ok" "every public function is measured"
    echo "$missing"
fi

measured gcc gcc -std=c99 -O0
measured gcc g++ -std=c++11 -O1
measured gcc gcc -std=c99 -O2
measured gcc g++ -std=c++11 -O3
measured gcc gcc -std=c99 -Os
measured clang clang++ -std=c++11 -O0
measured clang clang -std=c99 -O1
measured clang clang++ -std=c++11 -O2
measured clang clang -std=c99 -O3
measured clang clang++ -std=c++11 -Os
if [ "$1" = all ]; then
    measured gcc g++ -std=c++11 -O0
    measured gcc gcc -std=c99 -O1
    measured gcc g++ -std=c++11 -O2
    measured gcc gcc -std=c99 -O3
    measured gcc g++ -std=c++11 -Os
    measured clang clang -std=c99 -O0
    measured clang clang++ -std=c++11 -O1
    measured clang clang -std=c99 -O2
    measured clang clang++ -std=c++11 -O3
    measured clang clang -std=c99 -Os
    measured gcc gcc -std=c99 -O3 -march=native
    measured clang clang -std=c99 -O3 -march=native
    for level in -O0 -O1 -O2 -O3 -Os; do
        measured i686-linux-gnu-gcc i686-linux-gnu-gcc -static -std=c99 $level
    done
    run=qemu-aarch64
    for level in -O0 -O1 -O2 -O3 -Os; do
        measured aarch64-linux-gnu-gcc aarch64-linux-gnu-gcc -static -std=c99 $level
    done
fi
echo "1..$count"
