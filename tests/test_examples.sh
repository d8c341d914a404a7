#!/bin/sh
# The examples that judge themselves or draw: product sampling and light x cosine keep their errors,
# lights are drawn. Needs build/product, build/lights and build/facing.
cd "$(dirname "$0")/.." || exit 1
tmp=$(mktemp -d) || exit 1
trap 'rm -rf "$tmp"' EXIT
count=0

report() {  # pass (0 is yes), what; a failure shows what the example printed
    count=$((count + 1))
    [ "$1" = 0 ] && echo "ok $count - $2" && return
    echo "not ok $count - $2"
    { echo "$0: $2"; head -n 20 "$tmp/out" "$tmp/err"; } | sed 's/^/#   /' >&2
}

build/product -q >"$tmp/out" 2>"$tmp/err"
report $? "halftoned products have a third of the error of BRDF sampling, half of SIR's"
build/product "$tmp/missing.pfm" >"$tmp/out" 2>"$tmp/err"
[ $? = 1 ] && grep -qF missing.pfm "$tmp/err"
report $? "product: a missing map: $(head -n 1 "$tmp/err" | sed "s#$tmp/##g")"
build/lights -o "$tmp" -k 16 studio >"$tmp/out" && [ -s "$tmp/lights_studio.png" ]
report $? "lights are drawn"
[ "$(grep -cE '^studio +16 lights, .* RMSE [0-9.]+$' "$tmp/out")" = 7 ]
report $? "with an error for each of six sets"
build/lights -o "$tmp" "$tmp/missing.pfm" >"$tmp/out" 2>"$tmp/err"
[ $? = 1 ] && grep -qF missing.pfm "$tmp/err"
report $? "lights: a missing map: $(head -n 1 "$tmp/err" | sed "s#$tmp/##g")"
build/lights -k 0 >"$tmp/out" 2>"$tmp/err"
[ $? = 1 ] && grep -q usage "$tmp/err"
report $? "lights: no lights"
build/facing -q >"$tmp/out" 2>"$tmp/err"
report $? "light x cosine has 0.6 of the error of light alone and of MIS"
[ "$(grep -cE '^(LIGHT|FACING)(, MIS)? +[0-9.]+ +[0-9.]+ +(0\.99|1\.00)[0-9]* ' "$tmp/out")" = 8 ]
report $? "with the mean of the reference, by each of four ways"
build/facing -q "$tmp/missing.pfm" >"$tmp/out" 2>"$tmp/err"
[ $? = 1 ] && grep -qF missing.pfm "$tmp/err"
report $? "facing: a missing map: $(head -n 1 "$tmp/err" | sed "s#$tmp/##g")"
echo "1..$count"
