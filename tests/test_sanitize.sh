#!/bin/sh
# The tests that damage tables and feed bad input once more, under the address and undefined
# behaviour sanitizers: reads outside a table that happen to be harmless fail here. Those
# of halftones and lights without the real maps, which are not where they run. It is the library,
# and what the examples share, that is watched, so that alone is compiled for them, once; the tests
# run at their usual speed.
cd "$(dirname "$0")/.." || exit 1
cc=${CC:-cc}
tmp=$(mktemp -d) || exit 1
mkdir "$tmp/build"                          # for scratch files
trap 'rm -rf "$tmp"' EXIT
kinds=address,undefined,float-divide-by-zero,float-cast-overflow
subjects="kd_faults kd_table kd_layout kd_warp kd_facing kd_target cdf lm halftone lights
          lights_cuts lights_decomposed fuzz errors hdr filtered rivals"
common=examples/common
count=0

printf 'int main(void) { return 0; }\n' >"$tmp/probe.c"
if $cc -fsanitize=$kinds "$tmp/probe.c" -o "$tmp/probe" 2>/dev/null && "$tmp/probe"; then
    able=1
else
    able=0
fi

# compile FLAGS FILE...: objects that all subjects link.
objects=
compile() {
    flags=$1
    shift
    for file in "$@"; do
        object=$tmp/$(basename "$file" .c).o
        objects="$objects $object"
        $cc -std=c99 -g $flags -I. -Iexamples/common -c "$file" -o "$object" || exit 1
    done
}

watch="-fsanitize=$kinds -fno-sanitize-recover=all"
if [ $able = 1 ]; then
    compile "-O2 $watch" tests/envsamp.c
    compile "-O1 $watch" tests/inside.c $common/errors.c $common/image.c $common/hdr.c \
            $common/filtered.c examples/render/rivals.c
    compile -O2 tests/statistics.c $common/maps.c
fi
for subject in $subjects; do
    count=$((count + 1))
    case $subject in kd_warp | kd_facing | cdf | halftone | lights_cuts) quick=quick ;; *) quick= ;; esac
    case $subject in halftone | lights* | hdr) folder=$tmp ;; *) folder=. ;; esac
    if [ $able = 0 ]; then
        echo "ok $count # SKIP $subject: $cc has no address sanitizer here"
    elif $cc -std=c99 -O2 -g -I. -Iexamples/common -c "tests/test_$subject.c" -o "$tmp/subject.o" \
                2>"$tmp/log" \
            && $cc $watch "$tmp/subject.o" $objects -lm -o "$tmp/$subject" 2>>"$tmp/log" \
            && (cd "$folder" && "$tmp/$subject" $quick) >"$tmp/out" 2>>"$tmp/log"; then
        echo "ok $count - $subject is clean under the sanitizers"
    else
        echo "not ok $count - $subject is clean under the sanitizers"
        { echo "$0: test_$subject $quick with $watch:"; grep '^not ok' "$tmp/out"
          head -n 20 "$tmp/log"; } 2>/dev/null | sed 's/^/#   /' >&2
    fi
done
echo "1..$count"
