#!/bin/sh
# test_gpu.sh: tables sampled by the shaders of examples/gpu give what C does: a short run of what
# `make gpu` does in full. The shaders compile, with words read from every kind of buffer, and those
# with a fault are rejected; what cannot be sampled is refused before it is uploaded. Parts whose
# driver or compiler is not installed are skipped by name; `make gpu` installs them.
cd "$(dirname "$0")/.." || exit 1
root=$(pwd)
gpu=examples/gpu
. tests/report.sh

# ---- one source ----

for language in hlsl wgsl; do
    perl $gpu/translate.pl $language <$gpu/envsamp.glsl >"$tmp/envsamp.$language" 2>"$tmp/err"
    cmp "$tmp/envsamp.$language" $gpu/envsamp.$language >"$tmp/out" 2>&1
    report $? "envsamp.$language is what translate.pl makes of envsamp.glsl"
    perl $gpu/translate.pl $language <$gpu/check.glsl >"$tmp/check.$language"
done

# ---- glslang ----

# glsl VERSION LINES: envsamp.glsl and a shader that calls it, behind lines of one's own.
# A third word is another envsamp.glsl, a fourth that it is for Vulkan.
glsl()
{
    { echo "#version $1"
      case $1 in *es) printf '%s\n' '#extension GL_EXT_texture_buffer : enable' \
          'precision highp float;' 'precision highp int;' 'precision highp usamplerBuffer;';; esac
      printf '%b\n' "$2" "#define CHECK_MODE 3u"
      cat "${3:-$gpu/envsamp.glsl}" $gpu/check.glsl; } >"$tmp/all.comp"
    glslangValidator ${4:+-V -o "$tmp/all.spv"} "$tmp/all.comp" >"$tmp/out" 2>"$tmp/err"
}

hlsl()
{
    { printf '%b\n' "$1" "#define CHECK_MODE 3u"; cat $gpu/envsamp.hlsl "$tmp/check.hlsl"; } \
        >"$tmp/all.hlsl"
    glslangValidator -D -V -S comp -e main "$tmp/all.hlsl" -o "$tmp/all.spv" >"$tmp/out" \
        2>"$tmp/err"
}

texel='uniform usamplerBuffer table;\n#define ENVSAMP_WORD(at) texelFetch(table, int(at)).r'
uniform='layout(std140, binding = 0) uniform block { uvec4 table[1024]; };
#define ENVSAMP_WORD(at) table[(at) >> 2u][(at) & 3u]'
several='layout(std430, binding = 0) readonly buffer tables { uint words[]; };
const uint table_at = 64u;\n#define ENVSAMP_WORD(at) words[table_at + (at)]
#define ENVSAMP_CDF_WORD(at) words[at]'
if command -v glslangValidator >/dev/null; then
    for version in 430 450 "310 es" "320 es"; do
        glsl "$version" ""
        report $? "GLSL $version compiles: a storage buffer"
    done
    for version in 430 "310 es"; do
        glsl "$version" "$texel"
        report $? "GLSL $version compiles: a texel buffer"
        glsl "$version" "$uniform"
        report $? "GLSL $version compiles: a uniform buffer"
        glsl "$version" "$several"
        report $? "GLSL $version compiles: one of several tables"
        glsl "$version" "#define ENVSAMP_MAPPING 0u"
        report $? "GLSL $version compiles: for one mapping"
    done
    glsl 450 "" "" yes
    report $? "GLSL 450 compiles for Vulkan"
    sed 's/envsamp_ring(dir)/envsamp_rong(dir)/' $gpu/envsamp.glsl >"$tmp/wrong.glsl"
    ! glsl 430 "" "$tmp/wrong.glsl" && grep -q envsamp_rong "$tmp/out"
    report $? "GLSL with an unknown name is refused"
    hlsl ""
    report $? "HLSL compiles: a structured buffer"
    hlsl 'ByteAddressBuffer table : register(t0);\n#define ENVSAMP_WORD(at) table.Load(4u * (at))'
    report $? "HLSL compiles: a byte address buffer"
    hlsl 'cbuffer block : register(b0) { uint4 table[1024]; };
#define ENVSAMP_WORD(at) table[(at) >> 2u][(at) & 3u]\n#define ENVSAMP_MAPPING 2u'
    report $? "HLSL compiles: a constant buffer, for one mapping"
    ! hlsl '#define ENVSAMP_WORD(at) nothing[at]' && grep -q nothing "$tmp/out"
    report $? "HLSL with an unknown name is refused"
else
    skip "GLSL and HLSL: no glslangValidator (glslang-tools)"
fi

# ---- Dawn ----

wgsl() {    # a folder of cases, or none
    (cd build && EGL_PLATFORM=surfaceless XDG_RUNTIME_DIR="$tmp" \
        node "${3:-$root/$gpu}/check_wgsl.mjs" "$tmp/check.wgsl" $1) >"$tmp/out" 2>"$tmp/err"
}

with_dawn=
if [ -d build/node_modules/webgpu ] && command -v node >/dev/null; then
    with_dawn=yes
    wgsl
    report $? "WGSL compiles"
    mkdir "$tmp/wrong"
    cp $gpu/check_wgsl.mjs "$tmp/wrong"
    sed 's/envsamp_ring(dir)/envsamp_rong(dir)/' $gpu/envsamp.wgsl >"$tmp/wrong/envsamp.wgsl"
    ! wgsl "" "" "$tmp/wrong" && grep -q envsamp_rong "$tmp/out"
    report $? "WGSL with an unknown name is refused"
else
    skip "WGSL: no Dawn (npm install --prefix build webgpu)"
fi

# ---- CUDA ----

if command -v nvcc >/dev/null || [ -x /usr/local/cuda/bin/nvcc ]; then
    make -s build/gpu_bench >"$tmp/out" 2>"$tmp/err" \
        && build/gpu_bench constant >"$tmp/out" 2>"$tmp/err" \
        && grep -q "^control: .* differ" "$tmp/out" \
        && grep -qE "not measured|^WARP +[0-9.]+ +[0-9.]+$" "$tmp/out"
    report $? "samplers compiled for CUDA: $(tail -n 1 "$tmp/out")"
else
    skip "samplers compiled for CUDA: no nvcc"
fi

# ---- on the device ----

finish() {
    echo "1..$count"
    exit "${failed:-0}"
}

if [ ! -x build/gpu_check ]; then
    skip "shaders beside C: no EGL and OpenGL ES (libegl-dev libgles-dev)"
    finish
fi
build/gpu_check -n 1 constant >"$tmp/out" 2>"$tmp/err"
if grep -q "no compute shaders" "$tmp/err"; then
    skip "shaders beside C: no driver has compute shaders (libegl-mesa0 libgl1-mesa-dri)"
    finish
fi

# same WAYS COMMAND...: no block, direction or density differs in any of these ways of sampling, and
# all damages are seen.
same() {
    ways=$1
    shift
    "$@" >"$tmp/out" 2>"$tmp/err" && [ "$(grep -c '[0-9]  seen$' "$tmp/out")" = "$ways" ]
}
same 30 build/gpu_check -n 20000 sky
report $? "GLSL of OpenGL ES draws what C does: $(tail -n 1 "$tmp/out")"
same 30 build/gpu_check -n 20000 night
report $? "and of a map of lamps: $(tail -n 1 "$tmp/out")"
if build/gpu_check --gl -n 1 -t /dev/null 2>&1 | grep -q "no compute"; then
    skip "no OpenGL 4.3"
else
    same 30 build/gpu_check --gl -n 5000 sky
    report $? "GLSL of OpenGL draws what C does: $(tail -n 1 "$tmp/out")"
    if command -v glslangValidator >/dev/null; then
        for mode in 0 1 2 3 4 5 6 7; do
            { echo "#define CHECK_MODE ${mode}u"; cat $gpu/envsamp.hlsl "$tmp/check.hlsl"; } \
                >"$tmp/mode.hlsl"
            glslangValidator -D -V -S comp -e main "$tmp/mode.hlsl" -o "$tmp/check_$mode.spv" \
                >"$tmp/log" || break
        done
        same 30 build/gpu_check --gl -v "$tmp" -n 5000 sky
        report $? "HLSL draws what C does: $(tail -n 1 "$tmp/out")"
    fi
fi

# The table in a uniform buffer: of 256 blocks it fits into 16 KB, which every driver has.
mkdir "$tmp/uniform"
cp $gpu/check.glsl "$tmp/uniform"
{ printf '%b\n' "$uniform"; cat $gpu/envsamp.glsl; } >"$tmp/uniform/envsamp.glsl"
same 24 build/gpu_check -n 5000 -b 256 --kd -s "$tmp/uniform" sky
report $? "from a uniform buffer: $(tail -n 1 "$tmp/out")"

# ---- controls ----

# wrong NAME SED MAPPING: a shader with this fault is rejected by what it draws.
wrong() {
    mkdir -p "$tmp/shaders"
    cp $gpu/check.glsl "$tmp/shaders"
    sed "$2" $gpu/envsamp.glsl >"$tmp/shaders/envsamp.glsl"
    build/gpu_check -n 5000 -s "$tmp/shaders" ${3:--m latlong} sky >"$tmp/out" 2>"$tmp/err"
    [ $? = 1 ] && ! cmp -s $gpu/envsamp.glsl "$tmp/shaders/envsamp.glsl" \
        && ! grep -q '^0 points' "$tmp/out" && grep -q '^[0-9]* points differ' "$tmp/out"
    report $? "rejected: $1: $(tail -n 1 "$tmp/out")"
}
wrong "a cut's sides exchanged" 's/bool high = number >= cut/bool high = number < cut/'
wrong "draws of a bin in order" 's/ ^ (~bin \* 0x9e3779b9u)//'
wrong "a power of 2 of four digits" 's/0.240227226/0.2402/'
wrong "a moment of another side" 's/ENVSAMP_FACING_MOMENTS + 4u/ENVSAMP_FACING_MOMENTS/'
wrong "a guide half a word off" 's/((at \& 1u) << 4u)/0u/'
wrong "the other half of the octahedron" 's/abs(s \* w - q)/abs((1.0 - s) * w - q)/' "-n 2000"

# ---- what is refused ----

# refused WHAT MESSAGE COMMAND...: exit 1 and one line.
refused() {
    what=$1
    message=$2
    shift 2
    "$@" >"$tmp/out" 2>"$tmp/err"
    [ $? = 1 ] && [ "$(wc -l <"$tmp/err")" = 1 ] && grep -q "$message" "$tmp/err"
    report $? "refused: $what: $(sed "s#$tmp/##g" "$tmp/err")"
}

# A table by name, and copies of it with a byte changed.
damage() { perl -0777 -pe "substr(\$_, $1, 1) ^= \"\\x01\"" "$tmp/sky.table" >"$tmp/$2"; }
if [ -x build/table_file ] && build/table_file sky "$tmp/sky.table" >/dev/null; then
    build/gpu_check -n 5000 -t "$tmp/sky.table" >"$tmp/out" 2>"$tmp/err"
    report $? "a table from a file: $(tail -n 1 "$tmp/out")"
    damage 5000 damaged.table
    damage 4 version.table
    head -c 5000 "$tmp/sky.table" >"$tmp/short.table"
    refused "a damaged table" "is damaged" build/gpu_check -t "$tmp/damaged.table"
    refused "another version" "another version" build/gpu_check -t "$tmp/version.table"
    refused "half a table" "is damaged" build/gpu_check -t "$tmp/short.table"
    refused "another mapping" "built for octahedral" build/gpu_check -m octahedral \
        -t "$tmp/sky.table"
    build/gpu_check -n 5000 -m latlong -t "$tmp/sky.table" >"$tmp/out" 2>"$tmp/err"
    report $? "a shader for the table's mapping alone: $(tail -n 1 "$tmp/out")"
else
    skip "stored tables: no build/table_file"
fi
refused "no shader" "envsamp.glsl" build/gpu_check -s "$tmp/nowhere" sky
refused "no map" "missing.pfm" build/gpu_check -n 1 "$tmp/missing.pfm"
refused "no option" "usage" build/gpu_check -x
if build/gpu_check -n 1 -t /dev/null 2>/dev/null | grep -q Mesa; then
    refused "a driver without compute, ES" "no compute shaders" \
        env MESA_GLES_VERSION_OVERRIDE=3.0 build/gpu_check sky
    refused "a driver without compute, GL" "no compute shaders" \
        env MESA_GL_VERSION_OVERRIDE=3.3 build/gpu_check --gl sky
else
    skip "a driver without compute: not Mesa's"
fi

# ---- WGSL on the device ----

if [ -n "$with_dawn" ]; then
    mkdir "$tmp/cases"
    build/gpu_check -n 5000 -d "$tmp/cases" sky >/dev/null 2>&1
    wgsl "$tmp/cases"
    status=$?
    if [ $status = 2 ]; then
        skip "WGSL beside C: Dawn finds no device"
    else
        [ $status = 0 ] && [ "$(grep -c ' 0 blocks, 0 dirs, 0 pdfs' "$tmp/out")" = 30 ]
        report $? "WGSL draws what C does: $(grep -c points "$tmp/out") cases"
        rm "$tmp/cases"/*[2-6].case
        for case in "$tmp"/cases/*fit*; do         # the table's total, another one
            perl -0777 -pi -e 'substr($_, 16 + 4 * 27 + 1, 1) ^= "\x40"' "$case"
        done
        ! wgsl "$tmp/cases"
        report $? "a table that is damaged on its way to WGSL is seen"
    fi
fi
finish
