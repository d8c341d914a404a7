#!/bin/sh
# Installs the packages that the tests and examples use, where they are missing. The header itself
# needs none of them.
missing=
pkg-config --exists OpenEXR 2>/dev/null || missing="$missing libopenexr-dev pkg-config"
[ -f /usr/include/embree3/rtcore.h ] || [ -f /usr/include/embree4/rtcore.h ] \
    || missing="$missing libembree-dev"
[ -n "$missing" ] || exit 0

install="apt-get install -y$missing"
if command -v apt-get >/dev/null 2>&1 && [ "$(id -u)" = 0 ]; then
    echo "installing$missing"
    export DEBIAN_FRONTEND=noninteractive
    if { $install || { apt-get update && $install; }; } >/dev/null 2>&1; then
        exit 0
    fi
    echo "could not install; run: apt-get update && $install" >&2
    exit 1
fi
echo "missing packages; run: sudo apt-get update && sudo $install" >&2
exit 1
