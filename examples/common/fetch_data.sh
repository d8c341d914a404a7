#!/bin/sh
# Fetches real environment maps for tests and measurements, as EXR and as PFM.
#
#     fetch_data.sh FOLDER CONVERTER
#
# CONVERTER is the program made from exr_to_pfm.c. The maps are the CC0 ones of Poly Haven in the
# npm package @pmndrs/assets; ENVSAMP_ASSETS=PACKAGE.tgz takes them from a copy on disk instead.
# Maps that are there already are kept, and nothing is fetched when none is missing.
set -u

package=@pmndrs/assets@1.7.0
names='apartment bridge city dawn esplanade forest hall lab lobby night park sky studio sunrise
sunset venice warehouse workshop'

fail() {
    echo "fetch_data: $1" >&2
    exit 1
}

missing() {
    for name in $names; do
        [ -s "$folder/$name.exr" ] && [ -s "$folder/$name.pfm" ] || echo "$name"
    done
}

list() {
    echo "$folder:"
    for name in $names; do
        echo "  $name.exr  $name.pfm"
    done
}

# The tarball's path, copied or fetched into the temporary folder.
fetch() {
    if [ -n "${ENVSAMP_ASSETS:-}" ]; then
        cp "$ENVSAMP_ASSETS" "$temporary/package.tgz" 2>/dev/null ||
            fail "cannot read the package $ENVSAMP_ASSETS"
        return
    fi
    command -v npm >/dev/null 2>&1 || fail "npm is not installed, and it is what fetches the maps"
    (cd "$temporary" && npm pack --silent "$package" >/dev/null 2>npm.log) ||
        fail "npm cannot fetch $package (is there a network?)"
    mv "$temporary"/*.tgz "$temporary/package.tgz" 2>/dev/null ||
        fail "npm brought no package for $package"
}

# A module is one line of JavaScript around a data URL: the text between the comma and the quote.
convert() {
    module=$temporary/package/hdri/$1.exr.js
    [ -f "$module" ] || fail "the package holds no map named $1"
    sed -e 's/^[^,]*,//' -e "s/['\"\`].*\$//" "$module" | tr -d '\n' |
        base64 -d >"$temporary/$1.exr" 2>/dev/null || fail "the map $1 is not valid base64"
    "$converter" "$temporary/$1.exr" "$temporary/$1.pfm" >/dev/null 2>"$temporary/converter.log" ||
        fail "the map $1 cannot be converted: $(head -n 1 "$temporary/converter.log")"
    mv "$temporary/$1.pfm" "$temporary/$1.exr" "$folder/" || fail "cannot write to $folder"
}

[ $# -eq 2 ] || fail "usage: fetch_data.sh FOLDER CONVERTER"
folder=$1
converter=$2

if [ -n "$(missing)" ]; then
    for tool in tar sed tr base64 mktemp; do
        command -v $tool >/dev/null 2>&1 || fail "$tool is not installed"
    done
    command -v "$converter" >/dev/null 2>&1 ||
        fail "there is no converter $converter (it is built where OpenEXR is installed)"
    made_folder=
    [ -d "$folder" ] || made_folder=yes
    mkdir -p "$folder" 2>/dev/null || fail "cannot make the folder $folder"
    # Inside the target folder, so that a finished map moves into place in one step.
    temporary=$(mktemp -d "$folder/.fetch.XXXXXX" 2>/dev/null) || fail "cannot write to $folder"
    trap 'rm -rf "$temporary"; [ -z "$made_folder" ] || rmdir "$folder" 2>/dev/null' EXIT
    trap 'exit 1' HUP INT TERM
    fetch
    tar -xzf "$temporary/package.tgz" -C "$temporary" 2>/dev/null ||
        fail "the package is not a readable archive"
    for name in $(missing); do
        convert "$name"
    done
fi
list
