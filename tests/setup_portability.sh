#!/bin/sh
# Installs the compilers and emulators that `make portability` uses and Debian has, where they are
# missing. 32 bits are compiled by gcc-i686-linux-gnu: gcc-multilib conflicts with the cross
# compilers. CUDA's nvcc comes from elsewhere.
missing=

# Package $2 has command $1.
wants() { command -v "$1" >/dev/null || missing="$missing $2"; }

wants gcc gcc
wants g++ g++
wants clang clang
wants wasm-ld lld
wants tcc tcc
wants musl-gcc musl-tools
wants node nodejs
wants wine wine
wants x86_64-w64-mingw32-g++ g++-mingw-w64-x86-64
wants i686-w64-mingw32-g++ g++-mingw-w64-i686
wants qemu-s390x qemu-user
for machine in i686 aarch64 riscv64 s390x; do
    wants $machine-linux-gnu-g++ g++-$machine-linux-gnu
done
wants arm-linux-gnueabihf-g++ g++-arm-linux-gnueabihf
wants powerpc64-linux-gnu-g++ g++-powerpc64-linux-gnu
[ -n "$missing" ] || exit 0

install="apt-get install -y --no-install-recommends$missing"
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
