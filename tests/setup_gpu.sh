#!/bin/sh
# Installs what `make gpu` uses, where it is missing: EGL and OpenGL ES with Mesa's driver for
# machines without a GPU, glslang, and Dawn, the WGSL compiler, from npm into the folder given.
# Without Dawn, WGSL alone is skipped.
folder=${1:?usage: setup_gpu.sh FOLDER}
missing=
[ -f /usr/include/EGL/egl.h ] || missing="$missing libegl-dev libegl-mesa0 libgl1-mesa-dri"
[ -f /usr/include/GLES3/gl31.h ] || missing="$missing libgles-dev"
command -v glslangValidator >/dev/null || missing="$missing glslang-tools"

if [ -n "$missing" ]; then
    install="apt-get install -y --no-install-recommends$missing"
    if ! command -v apt-get >/dev/null 2>&1 || [ "$(id -u)" != 0 ]; then
        echo "missing packages; run: sudo apt-get update && sudo $install" >&2
        exit 1
    fi
    echo "installing$missing"
    export DEBIAN_FRONTEND=noninteractive
    if ! { $install || { apt-get update && $install; }; } >/dev/null 2>&1; then
        echo "could not install; run: apt-get update && $install" >&2
        exit 1
    fi
fi
if [ ! -d "$folder/node_modules/webgpu" ] && command -v npm >/dev/null; then
    echo "installing webgpu, from npm"
    npm install --silent --ignore-scripts --no-save --prefix "$folder" webgpu >/dev/null 2>&1 \
        || echo "could not install webgpu; run: npm install --prefix $folder webgpu" >&2
fi
exit 0
