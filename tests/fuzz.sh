#!/bin/sh
# fuzz.sh [seconds [target...]]: runs the fuzz targets of fuzz.c and fuzz_hdr.c, or those named, by
# libFuzzer under the address and undefined behaviour sanitizers, each for so many seconds, two at a
# time, and prints a table. It starts with tests/corpus/ and keeps what it finds in build/fuzz_corpus/.
# An input that fails is left in build/fuzz_crash/, and the command that runs it again is printed.
cd "$(dirname "$0")/.." || exit 1
seconds=${1:-60}
[ $# -gt 0 ] && shift
targets=${*:-build steps open lights halftone lm hdr}
clang=${CLANG:-clang}
kinds=fuzzer,address,undefined,float-divide-by-zero,float-cast-overflow
fuzzer=build/fuzz
mkdir -p build/fuzz_crash

echo 'int LLVMFuzzerTestOneInput(const char *d, unsigned long n) { return d && n > 9 ? 0 : 0; }' \
    >build/fuzz_probe.c
if ! command -v "$clang" >/dev/null 2>&1; then
    echo "skipped: no $clang; build/test_fuzz runs the targets without it"
    exit 0
fi
if ! $clang -fsanitize=$kinds build/fuzz_probe.c -o build/fuzz_probe 2>/dev/null \
        || ! build/fuzz_probe -runs=1 >/dev/null 2>&1; then
    echo "skipped: $clang has no libFuzzer here; build/test_fuzz runs the targets without it"
    exit 0
fi
echo "compiling"
$clang -std=c99 -O2 -g -fsanitize=$kinds -fno-sanitize-recover=all \
    -fno-sanitize-coverage=trace-cmp -I. tests/fuzz.c tests/envsamp.c tests/inside.c -lm \
    -o $fuzzer || exit 1
$clang -std=c99 -O2 -g -fsanitize=$kinds -fno-sanitize-recover=all -I. -Iexamples/common \
    tests/fuzz_hdr.c examples/common/hdr.c examples/common/image.c -lm -o ${fuzzer}_hdr || exit 1

# Files of two rows: flat, in new runs, and turned.
mkdir -p build/fuzz_corpus/hdr
head='#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n'
rows='\002\002\000\010\210\100\010abcdefgh\204\001\204\002\210\200'
printf "$head-Y 2 +X 2\n0123456789abcdef" >build/fuzz_corpus/hdr/flat
printf "$head-Y 2 +X 8\n$rows$rows" >build/fuzz_corpus/hdr/runs
printf "$head+X 2 -Y 8\n$rows$rows" >build/fuzz_corpus/hdr/turned

run() {         # one target; what it came to goes to build/fuzz_TARGET.txt
    log=build/fuzz_$1.log
    crash=build/fuzz_crash/$1-
    program=$fuzzer
    [ "$1" != hdr ] || program=${fuzzer}_hdr
    mkdir -p "build/fuzz_corpus/$1"
    FUZZ_TARGET=$1 $program -max_total_time="$seconds" -max_len=512 -timeout=25 -rss_limit_mb=2048 \
        -print_final_stats=1 -artifact_prefix="$crash" "build/fuzz_corpus/$1" $(ls -d "tests/corpus/$1" 2>/dev/null) \
        >"$log" 2>&1
    status=$?
    runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    rate=$(sed -n 's/^stat::average_exec_per_sec: *//p' "$log")
    edges=$(sed -n 's/.* cov: \([0-9]*\) .*/\1/p' "$log" | tail -n 1)
    corpus=$(sed -n 's,.* corp: \([0-9]*\)/.*,\1,p' "$log" | tail -n 1)
    {
        printf '%-10s %10s %8s %7s %7s  ' "$1" "${runs:--}" "${rate:--}" "${edges:--}" \
            "${corpus:--}"
        if [ $status = 0 ]; then
            echo "nothing found"
        else
            echo "FAILED"
            grep -E 'does not hold|runtime error|ERROR|SUMMARY' "$log" | head -n 4 | sed 's/^/    /'
            sed -n "s,.*Test unit written to \(.*\),    FUZZ_TARGET=$1 $program \1,p" "$log"
        fi
    } >"build/fuzz_$1.txt"
    return $status
}

printf '%-10s %10s %8s %7s %7s\n' target runs runs/s edges corpus
failed=0
set -- $targets
while [ $# -gt 0 ]; do
    run "$1" &
    first=$!
    if [ $# -gt 1 ]; then
        run "$2" || failed=1
    fi
    wait $first || failed=1
    cat "build/fuzz_$1.txt"
    [ $# -gt 1 ] && cat "build/fuzz_$2.txt" && shift
    shift
done
exit $failed
