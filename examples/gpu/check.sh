#!/bin/sh
# check.sh: all shaders beside C, by gpu_check and check_wgsl.mjs: what `make gpu` runs.
#
#     sh examples/gpu/check.sh BUILD POINTS MAP...
#
# BUILD has gpu_check, and node_modules/webgpu or no WGSL. GLSL of OpenGL ES runs over all maps, the
# made-up ones in all mappings; with quotients and roots as a GPU may round them over two made-up
# and the real ones; GLSL of OpenGL, HLSL and WGSL over the two. Exits with 1 if a part fails. What
# is not installed is skipped by name.
set -u
build=$1
points=$2
shift 2
few=$((points < 100000 ? points : 100000))      # they go through files
gpu=$(cd "$(dirname "$0")" && pwd)
failed=0
mkdir -p "$build/gpu" && work=$(cd "$build/gpu" && pwd) || exit 1

part() { echo; echo "== $1"; }

part "GLSL, OpenGL ES 3.1"
"$build/gpu_check" -n "$points" sky studio constant night foliage "$@" || failed=1

part "GLSL, OpenGL 4.3"
"$build/gpu_check" --gl -n "$points" sky night || failed=1

# Shown, not judged: what a GPU may draw that is not as exact as Mesa.
part "GLSL, quotients and roots off by about a unit in the last place"
mkdir -p "$work/rough"
cp "$gpu/check.glsl" "$work/rough"
sed -e 's,return a / b;,return a * (1.0 / b);,' \
    -e 's,return sqrt(square);,return sqrt(square) * 1.0000001;,' "$gpu/envsamp.glsl" \
    > "$work/rough/envsamp.glsl"
"$build/gpu_check" -n "$points" -m latlong -s "$work/rough" sky night "$@"

# spirv FOLDER: check_0.spv to check_7.spv.
spirv()
{
    perl "$gpu/translate.pl" hlsl < "$gpu/check.glsl" > "$1/check.hlsl" || return 1
    for mode in 0 1 2 3 4 5 6 7; do
        { echo "#define CHECK_MODE ${mode}u"; cat "$gpu/envsamp.hlsl" "$1/check.hlsl"; } \
            > "$1/mode.hlsl"
        glslangValidator -D -V -S comp -e main "$1/mode.hlsl" -o "$1/check_$mode.spv" || return 1
    done > "$1/log" || { cat "$1/log"; return 1; }
}

part "HLSL, as SPIR-V in OpenGL"
if ! command -v glslangValidator >/dev/null; then
    echo "skipped: no glslangValidator"
elif spirv "$work"; then
    "$build/gpu_check" --gl -v "$work" -n "$points" sky night || failed=1
else
    failed=1
fi

part "WGSL, by Dawn"
if [ ! -d "$build/node_modules/webgpu" ] || ! command -v node >/dev/null; then
    echo "skipped: no webgpu in $build/node_modules"
else
    rm -f "$work"/*.case
    if perl "$gpu/translate.pl" wgsl < "$gpu/check.glsl" > "$work/check.wgsl" \
        && "$build/gpu_check" -n "$few" -d "$work" sky night >/dev/null; then
        (cd "$build" && EGL_PLATFORM=surfaceless node "$gpu/check_wgsl.mjs" "$work/check.wgsl" \
            "$work")
        status=$?
        [ $status = 2 ] || [ $status = 0 ] || failed=1      # 2: no device
    else
        failed=1
    fi
fi
exit $failed
