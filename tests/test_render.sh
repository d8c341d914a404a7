#!/bin/sh
# The renderer: the same picture for any number of threads, every method beside a reference, and
# what it says of bad input: one line, exit status 1, nothing written. Needs build/render and
# build/render_unbiased, which need Embree; skipped where that is not.
cd "$(dirname "$0")/.." || exit 1
render=$PWD/build/render
if [ ! -f /usr/include/embree3/rtcore.h ] && [ ! -f /usr/include/embree4/rtcore.h ]; then
    echo "1..0 # SKIP no Embree"
    exit 0
fi
. tests/report.sh
trap 'chmod -R u+w "$tmp"; rm -rf "$tmp"' EXIT

# ---- pictures ----

small="--width 50 --height 34 --spp 4"
render() { "$render" $small "$@" >"$tmp/stdout" 2>"$tmp/stderr"; }

# A picture of 2:1 is a map too: a small one, and quickly read.
"$render" --env sky --scene vase --width 64 --height 32 --spp 4 --out "$tmp/map.pfm" \
    >"$tmp/stdout" 2>"$tmp/stderr"
report $? "a picture to be the map of others"
small="$small --env $tmp/map.pfm"

same() {  # what, options: 1, 2 and 5 threads give the same file
    what=$1
    shift
    render --threads 1 --out "$tmp/1.pfm" "$@" && render --threads 2 --out "$tmp/2.pfm" "$@" \
        && render --threads 5 --out "$tmp/5.pfm" "$@" && cmp "$tmp/1.pfm" "$tmp/2.pfm" \
        && cmp "$tmp/1.pfm" "$tmp/5.pfm" >"$tmp/stdout" 2>&1
    report $? "the same for 1, 2 and 5 threads: $what"
}

same "paths, Sobol" --scene chrome --bounces 6
same "paths, fixed places of a pixel" --side 2 --method inversion+mis
same "paths, independent numbers" --independent --scene cube --method cdf+mis --bounces 3
same "products" --scene metal --method triple
same "lights, interleaved, reduced" --scene vase --lights 9 --method decomposed --interleave \
    --reduce 2
render --threads 2 --seed 2 --out "$tmp/2.pfm" --scene chrome --bounces 6 \
    && render --threads 2 --out "$tmp/1.pfm" --scene chrome --bounces 6 \
    && ! cmp -s "$tmp/1.pfm" "$tmp/2.pfm"
report $? "another seed gives another picture"
render --rotate 90 --out "$tmp/2.pfm" --scene chrome --bounces 6 \
    && ! cmp -s "$tmp/1.pfm" "$tmp/2.pfm"
report $? "a map that is turned gives another picture"
for method in kd-warp+mis double relaxed; do
    lights=
    [ $method = relaxed ] && lights="--lights 8"
    for kind in png pfm exr; do
        render --method $method $lights --out "$tmp/a.$kind" && [ -s "$tmp/a.$kind" ] \
            && [ ! -s "$tmp/stderr" ]
        report $? "$method writes a .$kind, and nothing to stderr"
    done
done
render --seconds 0.2 --out "$tmp/a.png" && grep -q "samples a pixel" "$tmp/stdout"
report $? "as many samples as 0.2 s allow: $(sed 's/.*: //' "$tmp/stdout")"
render --env "$tmp/1.pfm" --out "$tmp/b.png"
[ $? = 1 ] && [ ! -e "$tmp/b.png" ]
report $? "a picture is no map"
"$render" --list >"$tmp/stdout" && [ "$(grep -c 'mis\]' "$tmp/stdout")" -ge 7 ] \
    && "$render" --help >"$tmp/stdout" && grep -q -- --rotate "$tmp/stdout"
report $? "--list and --help"
[ "$(find "$tmp" -name '*.tmp*' | wc -l)" = 0 ]
report $? "no temporary file is left"

# ---- bad input ----

rejects() {  # what, text of the line, options
    what=$1
    text=$2
    shift 2
    rm -f "$tmp/bad.png"
    render --out "$tmp/bad.png" "$@"
    status=$?
    [ $status = 1 ] && [ "$(wc -l <"$tmp/stderr")" = 1 ] && grep -qF -- "$text" "$tmp/stderr" \
        && [ ! -e "$tmp/bad.png" ] && [ "$(find "$tmp" -name '*bad*' | wc -l)" = 0 ]
    report $? "$what: exit status $status, $(head -n 1 "$tmp/stderr" | sed "s#$tmp/##g")"
}

pfm() {  # width height byte: a PFM of one byte repeated
    printf 'PF\n%d %d\n-1.0\n' "$1" "$2"
    head -c $((12 * $1 * $2)) /dev/zero | tr '\000' "$3"
}

pfm 8 8 '\077' >"$tmp/square.pfm"
pfm 16 8 '\077' | head -c 300 >"$tmp/short.pfm"
pfm 16 8 '\000' >"$tmp/black.pfm"
echo "this is not a map" >"$tmp/text.exr"
rejects "a missing map" missing.exr --env "$tmp/missing.exr"
rejects "a name that is no map" nowhere --env nowhere
rejects "a folder as map" "$tmp" --env "$tmp"
rejects "no map at all" text.exr --env "$tmp/text.exr"
rejects "a truncated map" short.pfm --env "$tmp/short.pfm"
rejects "a map that is not 2:1" square.pfm --env "$tmp/square.pfm"
for method in kd-warp uniform bsdf inversion+mis; do
    rejects "a black map, $method" "black" --env "$tmp/black.pfm" --method $method
done
rejects "a black map, lights" "black" --env "$tmp/black.pfm" --lights 4
rejects "an unknown scene" teapot --scene teapot
rejects "an unknown method" magic --method magic
rejects "MIS of nothing" bsdf+mis --method bsdf+mis
rejects "an unknown method of lights" kd-warp --lights 4 --method kd-warp
rejects "compensation without MIS" compensation --method cdf --compensation 1
rejects "compensation of what has none" compensation --method uniform+mis --compensation 1
rejects "an exponent of what has none" exponent --method inversion --exponent 2
rejects "bounces of products" bounces --method double --bounces 2
rejects "bounces of lights" bounces --lights 4 --bounces 2
rejects "lights for a time" seconds --lights 4 --seconds 1
for pair in "--spp 0" "--spp -3" "--spp 2.5" "--spp 1e9" "--spp many" "--spp 8x" "--lights 0" \
    "--lights 70000" "--seconds 0" "--seconds nan" "--seconds inf" "--threads 0" "--seed -1" \
    "--bounces 0" "--rotate north" "--width 0" "--height 100000" "--compensation 2" \
    "--exponent -1" "--reduce 0" "--exposure 0"; do
    rejects "nonsense: $pair" "${pair%% *}" $pair
done
rejects "a missing value" "--spp" --spp
rejects "an unknown option" "--fast" --fast
rejects "a word" "city" city
rejects "a picture of no kind" "picture.jpg" --out "$tmp/picture.jpg"
rejects "a folder that is missing" "missing/a.png" --out "$tmp/missing/a.png"
rejects "a picture that is a folder" "$tmp" --out "$tmp"
if [ "$(id -u)" = 0 ]; then
    count=$((count + 1))
    echo "ok $count # SKIP root may write everywhere"
else
    mkdir "$tmp/locked" && chmod a-w "$tmp/locked"
    rejects "a folder that cannot be written" "locked/a.png" --out "$tmp/locked/a.png"
fi

# ---- every method beside a reference ----

build/render_unbiased 64 >"$tmp/stdout" 2>"$tmp/stderr"
status=$?
while read -r line; do
    case $line in
    ok*) report 0 "${line#*- }" ;;
    not*) report 1 "${line#*- }" ;;
    esac
done <"$tmp/stdout"
grep -q '^1\.\.' "$tmp/stdout" && [ $status = 0 ]
report $? "every method is unbiased"
echo "1..$count"
