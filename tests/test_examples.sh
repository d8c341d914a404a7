#!/bin/sh
# The examples to copy from give what they should, and one line for what they cannot read. The
# galleries judge themselves or draw: product sampling and light x cosine keep their errors, lights
# are drawn. Needs what EXAMPLES of the Makefile names.
cd "$(dirname "$0")/.." || exit 1
. tests/report.sh

build/product_gallery -q >"$tmp/out" 2>"$tmp/err"
report $? "halftoned products have a third of the error of BRDF sampling, half of SIR's"
build/product_gallery "$tmp/missing.pfm" >"$tmp/out" 2>"$tmp/err"
[ $? = 1 ] && grep -qF missing.pfm "$tmp/err"
report $? "product: a missing map: $(head -n 1 "$tmp/err" | sed "s#$tmp/##g")"
build/lights_gallery -o "$tmp" -k 16 studio >"$tmp/out" && [ -s "$tmp/lights_studio.png" ]
report $? "lights are drawn"
[ "$(grep -cE '^studio +16 lights, .* RMSE [0-9.]+$' "$tmp/out")" = 7 ]
report $? "with an error for each of six sets"
build/lights_gallery -o "$tmp" "$tmp/missing.pfm" >"$tmp/out" 2>"$tmp/err"
[ $? = 1 ] && grep -qF missing.pfm "$tmp/err"
report $? "lights: a missing map: $(head -n 1 "$tmp/err" | sed "s#$tmp/##g")"
build/lights_gallery -k 0 >"$tmp/out" 2>"$tmp/err"
[ $? = 1 ] && grep -q usage "$tmp/err"
report $? "lights: no lights"
build/facing_gallery -q >"$tmp/out" 2>"$tmp/err"
report $? "light x cosine has 0.6 of the error of light alone and of MIS"
[ "$(grep -cE '^(LIGHT|FACING)(, MIS)? +[0-9.]+ +[0-9.]+ +(0\.99|1\.00)[0-9]* ' "$tmp/out")" = 8 ]
report $? "with the mean of the reference, by each of four ways"
build/facing_gallery -q "$tmp/missing.pfm" >"$tmp/out" 2>"$tmp/err"
[ $? = 1 ] && grep -qF missing.pfm "$tmp/err"
report $? "facing: a missing map: $(head -n 1 "$tmp/err" | sed "s#$tmp/##g")"

# ---- those to copy from ----

# within A B PART: whether A is B, above 0, give or take that part of it.
within() {
    awk -v a="$1" -v b="$2" -v part="$3" \
        'BEGIN { exit !(b > 0 && a >= b * (1 - part) && a <= b * (1 + part)) }'
}

# field NAME: the number behind a word of $tmp/out.
field() {
    sed -n "s/.*$1 \([0-9.]*\).*/\1/p" "$tmp/out" | head -n 1
}

# fails WHAT WORD COMMAND...: exit status 1, one line on stderr that has the word, nothing written.
fails() {
    what=$1 word=$2
    shift 2
    "$@" >"$tmp/out" 2>"$tmp/err"
    [ $? = 1 ] && [ "$(wc -l <"$tmp/err")" = 1 ] && grep -qF "$word" "$tmp/err" \
        && [ ! -e "$tmp/none" ] && [ ! -e "$tmp/none.part" ]
    report $? "$what: $(head -n 1 "$tmp/err" | sed "s#$tmp/##g")"
}

hdr() {  # width height: a flat Radiance file of texels of 1/2
    printf '#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n' "$2" "$1"
    head -c $((4 * $1 * $2)) /dev/zero | tr '\000' '\200'
}

hdr 32 16 >"$tmp/grey map.hdr"
printf 'PF\n4 2\n-1.0\n' >"$tmp/black.pfm"
head -c 96 /dev/zero >>"$tmp/black.pfm"

for map in "" "$tmp/grey map.hdr"; do
    build/quickstart ${map:+"$map"} >"$tmp/out" 2>"$tmp/err"
    [ $? = 0 ] && exact=$(field 'sum over the map') && within "$(field 'samples of the map')" \
        "$exact" 0.005 && within "$(field 'with MIS')" "$exact" 0.005
    report $? "quickstart: ${map:+a file: }$(cat "$tmp/out")"
done
fails "quickstart: a missing map" missing.hdr build/quickstart "$tmp/missing.hdr"
build/quickstart "$tmp/black.pfm" >"$tmp/out" 2>"$tmp/err"
[ $? = 1 ] && grep -q importance "$tmp/out"
report $? "quickstart: a black map: $(cat "$tmp/out")"

build/path_tracer constant "$tmp/white.png" 16 1 >"$tmp/out" 2>"$tmp/err"
[ $? = 0 ] && within "$(field picture)" 1 0.002 && [ -s "$tmp/white.png" ]
report $? "path_tracer: a white scene under a white map: $(cat "$tmp/out")"
build/path_tracer sky "$tmp/sky.png" 4 >"$tmp/out" 2>"$tmp/err" && few=$(field picture) &&
    build/path_tracer sky "$tmp/sky.png" 64 >"$tmp/out" 2>"$tmp/err" &&
    within "$few" "$(field picture)" 0.01
report $? "path_tracer: 4 paths a pixel have the light of 64: $few, $(cat "$tmp/out")"
fails "path_tracer: a missing map" missing.hdr build/path_tracer "$tmp/missing.hdr" "$tmp/none"
fails "path_tracer: a black map" black.pfm build/path_tracer "$tmp/black.pfm" "$tmp/none"
fails "path_tracer: no samples" usage build/path_tracer sky "$tmp/none" 0

build/lights sky 16 "$tmp/lights.txt" && build/lights sky 16 "$tmp/lights.gltf"
report $? "lights: as text and as glTF"
# Each light of the glTF against that of the text: where its node turns -z to, and its energy.
awk 'BEGIN { n = m = i = 0 }
     function off(a, b) { return (a - b) ^ 2 > 1e-10 * (1 + b * b) }
     NR == FNR { if ($1 != "#") for (k = 1; k <= 6; k++) text[n, k] = $k; n += $1 != "#"; next }
     { gsub(/[][{}",:]/, " ") }
     $1 == "type" { for (k = 0; k < 3; k++) energy[m, k] = $4 * $(6 + k); m++ }
     $1 == "rotation" { x = $2; y = $3; z = $4; w = $5
         wrong += off(2 * (x * z + w * y), text[i, 1]) || off(2 * (y * z - w * x), text[i, 2]) ||
                  off(1 - 2 * (x * x + y * y), text[i, 3])
         for (k = 0; k < 3; k++) wrong += off(energy[i, k], text[i, 4 + k]); i++ }
     END { print n, m, i, wrong + 0; exit !(n == 16 && m == 16 && i == 16 && !wrong) }' \
    "$tmp/lights.txt" "$tmp/lights.gltf" >"$tmp/out"
report $? "lights: the same ones: $(cat "$tmp/out")"
fails "lights: a missing map" missing.hdr build/lights "$tmp/missing.hdr" 8 "$tmp/none"
fails "lights: a black map" black.pfm build/lights "$tmp/black.pfm" 8 "$tmp/none"
fails "lights: no folder" nowhere build/lights sky 8 "$tmp/nowhere/lights.txt"
fails "lights: no lights" usage build/lights sky 0 "$tmp/none"
mkfifo "$tmp/pipe"
fails "lights: a pipe to write to" pipe build/lights sky 8 "$tmp/pipe"
fails "path_tracer: a pipe to write to" pipe build/path_tracer sky "$tmp/pipe" 1
fails "table_file: a pipe to write to" pipe build/table_file sky "$tmp/pipe"
fails "table_file: a pipe to read" mapped build/table_file "$tmp/pipe"
[ -p "$tmp/pipe" ]
report $? "which is still there"

build/halftone >"$tmp/out" 2>"$tmp/err" &&
    awk '{ seen[$1] = $2; half[$1] = $3 }
         END { exit !(seen["middle"] > 1 && half["middle"] > 1 && seen["mean"] < 0.2 &&
                      seen["within"] < 0.2 && half["within"] < 0.6 * half["mean"]) }' "$tmp/out"
report $? "halftone: the mean of a part keeps the sun, a direction within it the shadow"

build/table_file sky "$tmp/sky.table" >"$tmp/out" 2>"$tmp/err" &&
    build/table_file "$tmp/sky.table" >"$tmp/out" 2>"$tmp/err" &&
    [ "$(grep -c steradian "$tmp/out")" = 4 ]
report $? "table_file: $(head -n 1 "$tmp/out")"
head -c 1000 "$tmp/sky.table" >"$tmp/short.table"
fails "table_file: a table cut off" short.table build/table_file "$tmp/short.table"
: >"$tmp/empty.table"
fails "table_file: an empty one" empty.table build/table_file "$tmp/empty.table"
fails "table_file: a folder" mapped build/table_file "$tmp"
fails "table_file: a black map" black.pfm build/table_file "$tmp/black.pfm" "$tmp/none"

build/placement >"$tmp/out" 2>"$tmp/err" && [ "$(grep -c ' +\| -' "$tmp/out")" = 10 ]
report $? "placement: every engine agrees: $(tail -n 1 "$tmp/out")"
for example in quickstart path_tracer lights halftone table_file placement; do
    [ "$(wc -l <examples/$example.c)" -lt 150 ]
    report $? "$example.c has fewer than 150 lines"
done

# ---- benches ----

cat >"$tmp/promise.c" <<END
#include "bench/promise.h"
int main(void) { return puts(promise("<=", 2.5, 0)) < 0; }
END
${CC:-cc} -std=c99 -I. "$tmp/promise.c" -o "$tmp/promise" && [ -z "$(CHECK= "$tmp/promise")" ] &&
    [ -z "$(CHECK=0 "$tmp/promise")" ] && CHECK=1 "$tmp/promise" | grep -q '<= 2.5 *MISSED'
report $? "what is promised is shown with CHECK=1 only"
echo "1..$count"
