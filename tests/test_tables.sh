#!/bin/sh
# bench/render_tables measures a little of all, keeps what is done, and refuses what is wrong.
# Needs build/render_tables, which needs Embree; skipped where that is not.
cd "$(dirname "$0")/.." || exit 1
if [ ! -f /usr/include/embree3/rtcore.h ] && [ ! -f /usr/include/embree4/rtcore.h ]; then
    echo "1..0 # SKIP no Embree here"
    exit 0
fi
. tests/report.sh

tables=build/render_tables
csv=$tmp/render.csv
$tables -q -o "$tmp" >"$tmp/out" 2>"$tmp/err"
report $? "a little of every table: $(grep -vc '^#' "$csv") cells"
[ "$(grep -c '^## ' "$tmp/render.md")" = 9 ]
report $? "nine tables: $(grep -c '^## ' "$tmp/render.md")"
[ "$(grep -cE '^#.* commit .*|^# direct light' "$csv")" = 2 ]
report $? "the file says with what it was measured"
number='-?[0-9.]+(e[-+][0-9]+)?|inf'
cell="^[a-z0-9-]+,constant,(vase|metal|ward),[^,]+(, [^,]+)*(,($number)){7}\$"
[ -s "$csv" ] && ! grep -v '^#' "$csv" | grep -vqE "$cell"
report $? "cells have a key and seven numbers"
[ -s "$tmp/render.md" ] && ! grep -q 'nan' "$tmp/render.md"
report $? "no table lacks a number"

# ---- under a constant map all samplers of light are alike, and light x cosine is better ----

ratio() {   # METHOD: column of Sobol points in the first table
    sed -n '/direct light/,/^$/p;/^| method/,/^$/p' "$tmp/render.md" \
        | awk -F'|' -v name="$1" '{ gsub(/^ +| +$/, "", $2) } $2 == name { print $4 + 0; exit }'
}
[ "$(ratio cdf+mis)" = 1 ] && [ "$(ratio kd-warp+mis)" = 1 ]
report $? "of a constant map cdf and WARP draw what inversion does"
awk "BEGIN { exit !($(ratio facing+mis) < 0.9 && $(ratio kd-warp) > 1.5) }"
report $? "light x cosine is better, light alone worse: $(ratio facing+mis), $(ratio kd-warp)"

# ---- kept, and gone on with ----

cp "$csv" "$tmp/before"
$tables -q -o "$tmp" >"$tmp/out" 2>"$tmp/err"
[ $? -eq 0 ] && cmp -s "$csv" "$tmp/before"
report $? "what is done is not measured again"
head -c $(($(wc -c <"$tmp/before") - 20)) "$tmp/before" >"$csv"
$tables -q -o "$tmp" >"$tmp/out" 2>"$tmp/err"
[ $? -eq 0 ] && [ "$(wc -l <"$csv")" = "$(wc -l <"$tmp/before")" ] \
    && [ "$(sed '$d' "$csv" | cksum)" = "$(sed '$d' "$tmp/before" | cksum)" ]
report $? "a line that was cut off is measured again, and only that"

sed '$d' "$tmp/before" | sed 's/commit .*/commit before/' >"$csv"
$tables -q -o "$tmp" >"$tmp/out" 2>"$tmp/err"
[ $? -eq 0 ] && [ "$(tail -2 "$csv" | grep -c '^#.* commit ')" = 1 ] \
    && [ "$(grep -c '^#.* commit ' "$tmp/render.md")" = 2 ]
report $? "what another commit adds is marked as such"

# ---- bad input ----

for words in "nonsense" "-t 0" "-t" "-x"; do
    $tables $words >"$tmp/out" 2>"$tmp/err"
    [ $? -eq 1 ] && [ -s "$tmp/err" ]
    report $? "refused: $words"
done
$tables -q -o "$tmp/no/such/folder" >"$tmp/out" 2>"$tmp/err"
[ $? -eq 1 ] && [ "$(wc -l <"$tmp/err")" = 1 ]
report $? "a folder that cannot be made: $(sed "s#$tmp/##g" "$tmp/err")"
echo "1..$count"
[ "$failed" -eq 0 ]
