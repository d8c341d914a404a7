#!/bin/sh
# The frame loop shows whole tables only, of the age that its steps allow, and lights that do not
# pop; suns and the rest of a map add up to the map. Each has controls, which have to fail. No
# verdict depends on time. Needs build/engine and build/sun_and_sky.
cd "$(dirname "$0")/.." || exit 1
. tests/report.sh

run() {  # program, arguments...
    "$@" >"$tmp/out" 2>"$tmp/err"
}

# number WORDS: the number behind them.
number() {
    sed -n "s/.*$1 \([0-9.e+-]*[0-9]\).*/\1/p" "$tmp/out" | head -n 1
}

untimed() {  # what is printed but times
    sed 's/; the fastest.*//; / ms/d' "$tmp/out"
}

holds() {  # an expression of awk
    awk "BEGIN { exit !($1) }"
}

# ---- the frame loop: so many items of a build in each frame ----

small="build/engine --size 128x64 --blocks 64 --samples 512 --frames 60"
for select in warp alias; do
    run $small --select $select --items 100 && grep -q 'every frame saw one whole table' "$tmp/out"
    report $? "$select: $(tail -n 1 "$tmp/out")"
    shown=$(number 'tables:') worst=$(number 'age mean [0-9.]*, worst')
    # Tables that take n frames are at most 2 n - 1 frames old; some take a frame more than others.
    holds "$shown > 5 && $worst + 1 >= 2 * 60 / ($shown + 1) && $worst - 1 <= 2 * 60 / $shown"
    report $? "$select: $shown tables in 60 frames, at most $worst frames old"
    before=$(untimed)
    run $small --select $select --items 100 && [ "$(untimed)" = "$before" ]
    report $? "$select: the same again"
    run $small --select $select --items 1000000 &&
        [ "$(number 'tables:')" = 60 ] && [ "$(number 'age mean [0-9.]*, worst')" = 1 ]
    report $? "$select, builds of one frame: a table a frame, at most one frame old"
done
run $small --items 100 --threads 8 && [ "$(number 'samples:')" = $((8 * 512 * 60)) ]
report $? "eight threads: $(number 'samples:') samples"
run $small --items 100 --control early
[ $? = 1 ] && grep -q 'saw a half-built table: [1-9]' "$tmp/out"
report $? "tables that are swapped too early are seen: $(tail -n 1 "$tmp/out")"
run $small --items 100 --control mixed
[ $? = 1 ] && grep -q 'half-built table: 0, two tables: [1-9]' "$tmp/out"
report $? "so are two tables at once: $(tail -n 1 "$tmp/out")"
run $small --half && run build/engine --size 64x32 --blocks 1 --frames 5 --lights 0
report $? "maps of half the size, a single block, and no lights"

# ---- its lights ----

run build/engine --size 64x32 --blocks 16 --samples 16 --items 100000 --frames 240
report $? "240 frames: $(sed -n '/^  sky/p' "$tmp/out")"
sky=$(number '  sky') raw=$(number 'as they come') ours=$(number 'that follow')
one=$(number 'over all light,')
holds "$sky > 0 && $ours < 2 * $sky && $one < 2 * $sky"
report $? "neither irradiance nor a light changes by twice what the sky does: $ours, $one of $sky"
holds "!($raw < 2 * $sky)"
report $? "but lights as they come do: $raw"
run build/engine --size 64x32 --blocks 16 --samples 16 --items 100000 --frames 240 --lights 256
report $? "256 lights: $(sed -n '/^lights/p' "$tmp/out" | cut -d ';' -f 1)"

# ---- what it cannot do ----

for bad in "--size 2048" "--size 8x8" "--size 20000x10" "--blocks 0" "--budget-ms x" \
    "--select fit" "--threads 65" "--control late" "--frames" "--speed nan" "--unknown 1"; do
    run build/engine $bad
    [ $? = 1 ] && [ "$(wc -l <"$tmp/err")" = 1 ] && [ ! -s "$tmp/out" ] &&
        grep -qF -e "${bad%% *}" "$tmp/err"
    report $? "engine $bad: $(cat "$tmp/err")"
done
run build/engine --help && grep -q -e --budget-ms "$tmp/out"
report $? "engine --help"

# ---- sun and sky ----

for map in sky night studio; do
    run build/sun_and_sky $map && holds "$(number 'prefiltered') < 1e-4" &&
        [ "$(grep -c '^sun' "$tmp/out")" -gt 0 ] && [ "$(grep -c '^rest' "$tmp/out")" = 9 ]
    report $? "$map: $(grep -c '^sun' "$tmp/out") suns, $(tail -n 1 "$tmp/out")"
    run build/sun_and_sky $map twice
    [ $? = 1 ] && ! holds "$(number 'prefiltered') < 1e-4"
    report $? "$map: suns that stay in the rest are seen: $(number 'prefiltered')"
done
# Nine coefficients of a sky with its sun in them are off by more than its irradiance.
run build/sun_and_sky sky && holds "$(number 'as coefficients') < 0.2"
report $? "sky: nine coefficients of the rest are off by $(number 'as coefficients')"
run build/sun_and_sky constant && [ "$(grep -c '^sun' "$tmp/out")" = 0 ] &&
    awk '/^rest/ { c[n++] = $2 }
         END { for (i = 0; i < 9; i++) bad += (c[i] - (i ? 0 : 3.5449077)) ^ 2 > 1e-8
               exit n != 9 || bad > 0 }' "$tmp/out"
report $? "constant: no sun, and sqrt(4 pi) and eight zeros as coefficients"
printf 'PF\n4 2\n-1.0\n' >"$tmp/black.pfm"
head -c 96 /dev/zero >>"$tmp/black.pfm"
for map in "$tmp/missing.hdr" "$tmp/black.pfm"; do
    run build/sun_and_sky "$map"
    [ $? = 1 ] && [ "$(wc -l <"$tmp/err")" = 1 ] && [ ! -s "$tmp/out" ] &&
        grep -qF "$map: " "$tmp/err"
    report $? "sun_and_sky: $(sed "s#$tmp/##g" "$tmp/err")"
done
[ "$(wc -l <examples/sun_and_sky.c)" -lt 150 ]
report $? "sun_and_sky.c has fewer than 150 lines"
echo "1..$count"
