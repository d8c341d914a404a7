#!/bin/sh
# The demo with files that are not maps: one line on stderr that names the file, exit status 1,
# and nothing written. And with small maps: their pictures. Needs build/demo_exr, build/samplers.
cd "$(dirname "$0")/.." || exit 1
demo=$PWD/build/demo_exr
. tests/report.sh

rejects() {  # file, what
    "$demo" -o "$tmp/out" "$1" >"$tmp/stdout" 2>"$tmp/stderr"
    status=$?
    [ $status = 1 ] && [ "$(wc -l <"$tmp/stderr")" = 1 ] && [ ! -e "$tmp/out" ] \
        && grep -qF "$(basename "$1")" "$tmp/stderr"
    report $? "$2: exit status $status, $(head -n 1 "$tmp/stderr" | sed "s#$tmp/##g")"
}

pfm() {  # width height byte: a PFM of one byte repeated
    printf 'PF\n%d %d\n-1.0\n' "$1" "$2"
    head -c $((12 * $1 * $2)) /dev/zero | tr '\000' "$3"
}

hdr() {  # width height: a flat Radiance file of texels whose four bytes are the letter p
    printf '#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n' "$2" "$1"
    head -c $((4 * $1 * $2)) /dev/zero | tr '\000' p
}

rejects "$tmp/missing.exr" "a missing file"
: >"$tmp/empty.exr"
rejects "$tmp/empty.exr" "an empty file"
echo "this is not a map" >"$tmp/text.exr"
rejects "$tmp/text.exr" "not an EXR"
printf '\166\057\061\001\002\000\000\000channels' >"$tmp/stub.exr"
rejects "$tmp/stub.exr" "a truncated EXR"
pfm 8 8 '\077' >"$tmp/square.pfm"
rejects "$tmp/square.pfm" "not 2:1"
pfm 16 8 '\077' | head -c 300 >"$tmp/short.pfm"
rejects "$tmp/short.pfm" "a truncated PFM"
hdr 16 8 | head -c 300 >"$tmp/short.hdr"
rejects "$tmp/short.hdr" "a truncated HDR"
cp examples/pictures/strip.png "$tmp/picture.hdr"
rejects "$tmp/picture.hdr" "a PNG"
rejects "$tmp" "a folder"
pfm 16 8 '\000' >"$tmp/black.pfm"
rejects "$tmp/black.pfm" "a black map"
for exr in data/*.exr; do
    if [ -e "$exr" ]; then
        head -c 50000 "$exr" >"$tmp/cut.exr"
        rejects "$tmp/cut.exr" "a real map cut off"
    else
        count=$((count + 1))
        echo "ok $count # SKIP no real map to cut off: run make data"
    fi
    break
done
hdr 32 16 >"$tmp/grey.hdr"
"$demo" -o "$tmp/out" "$tmp/grey.hdr" >"$tmp/stdout" 2>"$tmp/stderr"
report $? "a small map is drawn"
pictures=$(find "$tmp/out" -name '*.png' 2>/dev/null | wc -l)
[ "$pictures" = 4 ]
report $? "as 4 pictures ($pictures)"
grep -q "The map is flat" "$tmp/stdout"
report $? "and said to be flat"
"$demo" -o "$tmp/out" night >"$tmp/stdout" 2>"$tmp/stderr"
[ $? = 0 ] && [ -s "$tmp/out/night_blocks.png" ] && ! grep -q flat "$tmp/stdout"
report $? "a made-up map by its name is not"
build/samplers -q "$tmp/grey.hdr" >"$tmp/stdout" 2>"$tmp/stderr"
report $? "all kinds of tables"
[ ! -s "$tmp/stderr" ]
report $? "whose log has no progress, as they take no time"
if script -qec true /dev/null >/dev/null 2>&1; then
    script -qec "build/samplers -q '$tmp/grey.hdr'" /dev/null </dev/null | tr '\r' '\n' \
        | grep -qE '^\[#* *\] +[0-9]+ %'
    report $? "on a terminal a line shows what is done"
else
    count=$((count + 1))
    echo "ok $count # SKIP no terminal: script is not installed"
fi
[ "$(grep -cE 'grey.hdr, (kd, WARP|cdf) +([0-9.]+ +){4}[0-9.]+$' "$tmp/stdout")" = 2 ]
report $? "with the gain of MIS compensation"
echo "1..$count"
