#!/bin/sh
# Every piece of code in the comments of envsamp.h and in README.md is compiled, as C99 and C++11,
# and run: as it is, with a black map, without pixels, without memory, and with memory that is
# aligned to 8 bytes only. It must end by itself, clean under the sanitizers, and print the error.
# What a piece needs around it is here, under its name; one without a name fails. README: a draft
# in the place of README.md.
cd "$(dirname "$0")/.." || exit 1
cc=${CC:-cc}
cxx=${CXX:-c++}
tmp=$(mktemp -d) || exit 1
trap 'rm -rf "$tmp"' EXIT
strict="-Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Wdouble-promotion"
strict="$strict -Wcast-qual -Werror -I$PWD -I$PWD/examples/common -I$tmp"
count=0
failures=0

# check NAME COMMAND...: a test point; a failure says what was run and what came of it.
check() {
    count=$((count + 1))
    point=$1
    shift
    if "$@" >"$tmp/log" 2>&1; then
        echo "ok $count - $point"
    else
        echo "not ok $count - $point"
        { echo "tests/test_snippets.sh: $point: $*"; head -n 20 "$tmp/log"; } | sed 's/^/#   /' >&2
        failures=$((failures + 1))
    fi
}

skip() {
    count=$((count + 1))
    echo "ok $count # SKIP $1"
}

# ---- the pieces ----

# Of the header: what is indented by 4 or more within a comment, if its first line ends as code does,
# and one has an = or a ( and ends in a semicolon, or begins with #. Of the README: blocks that begin with ```c.
awk -v out="$tmp" '
    function flush() { if (first && code) { close(file = out "/header_" ++n); printf "%s", text > file }
                       text = ""; first = code = 0 }
    { line = $0; within = comment || line ~ /^\/\*/ }
    /^\/\*/ { comment = 1 }
    /\*\/[ \t]*$/ { comment = 0 }
    !within { flush(); next }
    { sub(/^ \* ?/, "", line); sub(/^\/\*/, "", line); sub(/[ \t]*\*\/[ \t]*$/, "", line)
      if ($0 !~ /^ \*/) sub(/^   /, "", line) }
    line ~ /^    / { bare = line; sub(/ *\/\/.*/, "", bare)
                     if (text == "" && bare ~ /[;{)]$|^ *#/) first = 1
                     text = text line "\n"
                     if (bare ~ /[=(].*;$/ || bare ~ /^ *#/) code = 1; next }
    line == "" && text != "" { text = text "\n"; next }
    { flush() }
    END { flush() }' envsamp.h
awk -v out="$tmp" '
    /^```/ { if (inside) { inside = 0; close(file) }
             else if ($0 == "```c") { inside = 1; file = out "/readme_" ++n; printf "" > file }
             else other = !other
             next }
    inside { print > file }' "${README:-README.md}"

# name FILE: by what is in it.
name_of() {
    case $(cat "$1") in
        *'int main(void)'*) echo quickstart ;;
        *scene_occluded*) echo shading ;;
        *environment_sample*) echo placing ;;
        *envsamp_lights_defaults*) echo lights ;;
        *half_to_float*) echo half ;;
        *envsamp_halftone*) echo halftone ;;
        *fwrite*) echo save ;;
        *mmap*) echo map ;;
        *envsamp_kd_build*) echo table ;;
        *'#define ENVSAMP_IMPLEMENTATION'*) echo include ;;
        *) echo unknown ;;
    esac
}

# ---- what is around them ----

# Memory as MODE has it: none, or at 8 more than a multiple of 16. A map that is black, or missing.
cat >"$tmp/provoke.h" <<'END'
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static inline int mode_is(const char *name)
{
    const char *mode = getenv("MODE");

    return mode && !strcmp(mode, name);
}

static inline void *test_malloc(size_t bytes)
{
    char *block;

    if (mode_is("memory"))
        return NULL;
    if (!mode_is("offset"))
        return malloc(bytes);
    block = (char *)malloc(bytes + 8);      /* of a malloc that aligns to 16 */
    return block ? block + 8 : NULL;
}

static inline void test_free(void *block)
{
    free(block && mode_is("offset") ? (char *)block - 8 : (char *)block);
}

#define malloc test_malloc
#define free test_free

#define WIDTH 16
#define HEIGHT 8
static float test_map[WIDTH * HEIGHT * 3];

static inline float *make_map(void)
{
    int i;

    for (i = 0; i < WIDTH * HEIGHT * 3; i++)
        test_map[i] = mode_is("black") ? 0.0f : 1.0f + 0.01f * (float)i;
    return mode_is("pixels") ? NULL : test_map;
}
END

cat >"$tmp/include.c" <<'END'
#include "snippet.c"
int main(void)
{
    return envsamp_result_string(ENVSAMP_OK)[0] == 0;
}
END

cat >"$tmp/table.c" <<'END'
#include "envsamp.h"
#include "provoke.h"
static const float *f(const float dir[3])
{
    static const float grey[3] = { 0.5f, 0.5f, 0.5f };

    return dir[0] > 2.0f ? NULL : grey;
}
static float visible(const float dir[3])
{
    return dir[0] > 2.0f ? 0.0f : 1.0f;
}
int main(void)
{
    const float *pixels = make_map(), bsdf_dir[3] = { 0.0f, 0.0f, 1.0f }, u0 = 0.3f, u1 = 0.6f;
    const int width = WIDTH, height = HEIGHT;
    float rgb[3], radiance[3] = { 0.0f, 0.0f, 0.0f };

#include "snippet.c"
    free(table.data);
    /* f is 1/2, and the map over its density about its integral, 4 pi times 2.9. */
    return !(pdf > 0.0f && radiance[0] > 12.0f && radiance[0] < 24.0f);
}
END

cat >"$tmp/lights.c" <<'END'
#include "envsamp.h"
#include "provoke.h"
int main(void)
{
    const envsamp_image image = { make_map(), WIDTH, HEIGHT, 3, 0, ENVSAMP_LATLONG };
    envsamp_light lights[32];
    envsamp_sizes sizes;
    envsamp_buffer scratch;
    float sum = 0.0f;
    int i;

#include "snippet.c"
    for (i = 0; i < desc.count; i++)
        sum += lights[i].irradiance[1];
    return !(desc.count == 32 && sum > 32.0f && sum < 42.0f);   /* 4 pi times 2.9 */
}
END

cat >"$tmp/shading.c" <<'END'
#include "envsamp.h"
#include "provoke.h"
static const float *brdf(const float *point, const float dir[3], const float view[3])
{
    static const float white[3] = { 0.318310f, 0.318310f, 0.318310f };

    return point && dir && view ? white : NULL;
}
static int scene_occluded(const float *point, const float dir[3])
{
    return point[2] < 0.0f && dir[2] > 0.0f;
}
/* Of a white ground under a sky of which nothing is hidden, or all. */
static float shade(const envsamp_light *lights, int count, const float point[3])
{
    const float n[3] = { 0.0f, 0.0f, 1.0f }, *view = n;
    float radiance[3] = { 0.0f, 0.0f, 0.0f }, cosine;
    int i, c;

    for (i = 0; i < count; i++) {
        const envsamp_light light = lights[i];

#include "snippet.c"
    }
    return radiance[0];
}
int main(void)
{
    const envsamp_image image = { make_map(), WIDTH, HEIGHT, 3, 0, ENVSAMP_LATLONG };
    const float open[3] = { 0.0f, 0.0f, 0.0f }, cellar[3] = { 0.0f, 0.0f, -1.0f };
    envsamp_light lights[32];
    envsamp_sizes sizes;
    envsamp_buffer scratch;
    envsamp_result result;

    envsamp_lights_sizes(&image, NULL, &sizes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    result = envsamp_lights(&image, NULL, lights, 32, scratch, NULL);
    free(scratch.data);
    if (result != ENVSAMP_OK) {
        printf("%s\n", envsamp_result_string(result));
        return 1;
    }
    /* The upper half of the map is 1 to 2.9, brighter near the horizon. */
    return !(shade(lights, 32, open) > 1.0f && shade(lights, 32, open) < 2.9f
             && shade(lights, 32, cellar) <= 0.0f);
}
END

cat >"$tmp/placing.c" <<'END'
#define environment_sample placement_sample
#include "placement.h"
#undef environment_sample
#include "provoke.h"
#include "snippet.c"
/* Beside the function that the comment names, of a map that is turned. */
int main(void)
{
    const envsamp_image image = { make_map(), WIDTH, HEIGHT, 3, 0, ENVSAMP_LATLONG };
    const float axis[3] = { 0.6f, 0.0f, 0.8f };
    envsamp_sizes sizes;
    envsamp_buffer table, scratch;
    const envsamp_kd *kd;
    envsamp_result result;
    int wrong = 0, i;

    envsamp_kd_sizes(&image, NULL, &sizes);
    table.data = malloc(table.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    result = envsamp_kd_build(&image, NULL, table, scratch, &kd);
    if (result == ENVSAMP_OK) {
        environment e = environment_make(kd, &image);

        environment_turn(&e, axis, 1.0f);
        for (i = 0; i < 100; i++) {
            const float u0 = 0.01f * (float)i, u1 = 0.99f - u0;
            const environment_light a = environment_sample(&e, u0, u1);
            const environment_light b = placement_sample(&e, u0, u1);

            wrong += memcmp(&a, &b, sizeof a) != 0 || !(a.pdf > 0.0f);
        }
    } else {
        printf("%s\n", envsamp_result_string(result));
    }
    free(table.data);
    free(scratch.data);
    return wrong != 0 || result != ENVSAMP_OK;
}
END

# A map of halves that are whole numbers, and its table.
cat >"$tmp/half.c" <<'END'
#include "envsamp.h"
#include "provoke.h"
typedef struct half_map {
    const uint16_t *half;
    int width;
} half_map;
static float half_to_float(uint16_t half)
{
    return (float)half;
}
#include "snippet.c"
int main(void)
{
    const float *floats = make_map();
    envsamp_image image = { NULL, WIDTH, HEIGHT, 3, 0, ENVSAMP_LATLONG };
    uint16_t pixels[WIDTH * HEIGHT * 3];
    const half_map whole = { floats ? pixels : NULL, WIDTH };
    envsamp_sizes sizes;
    envsamp_buffer table, scratch;
    const envsamp_kd *kd;
    envsamp_kd_info info;
    envsamp_result result = ENVSAMP_ERR_NULL;
    int i;

    for (i = 0; i < WIDTH * HEIGHT * 3; i++)
        pixels[i] = (uint16_t)(floats ? 10.0f * floats[i] : 0.0f);
    envsamp_kd_sizes(&image, NULL, &sizes);
    table.data = malloc(table.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    if (floats)
        result = envsamp_kd_build_rows(&image, half_row, (void *)(size_t)&whole, NULL, table,
                                       scratch, &kd);
    free(scratch.data);
    if (result != ENVSAMP_OK)
        printf("%s\n", envsamp_result_string(result));
    else
        envsamp_kd_get_info(kd, &info);
    free(table.data);
    return !(result == ENVSAMP_OK && info.integral > 320.0 && info.integral < 400.0);
}
END

# The sum of value, which is the importance, is got exactly.
cat >"$tmp/halftone.c" <<'END'
#include "envsamp.h"
#include "provoke.h"
int main(void)
{
    static float product[32 * 32];
    const float *importance = mode_is("pixels") ? NULL : product, *value = product;
    envsamp_texel texels[32];
    envsamp_sizes sizes;
    envsamp_buffer scratch;
    int count = 0, j;
    float sum = 0.0f, exact = 0.0f;

    for (j = 0; j < 32 * 32; j++)
        exact += product[j] = mode_is("black") ? 0.0f : 1.0f + 0.01f * (float)(j % 32);
#include "snippet.c"
    if (result != ENVSAMP_OK)
        printf("%s\n", envsamp_result_string(result));
    return !(result == ENVSAMP_OK && count == 32 && sum > 0.999f * exact && sum < 1.001f * exact);
}
END

# A table, its bytes in a file, and the file's in memory: fwrite and mmap are stood in for.
cat >"$tmp/save.c" <<'END'
#include "envsamp.h"
#include "provoke.h"
#define SAVES
#include "table_bytes.h"
END
sed 's/#define SAVES/#define OPENS/' "$tmp/save.c" >"$tmp/map.c"
cat >"$tmp/table_bytes.h" <<'END'
static char kept[1 << 20];
static size_t kept_bytes;
static inline size_t test_fwrite(const void *from, size_t size, size_t count, int file)
{
    if (size * count > sizeof kept || file != 3)
        return 0;
    memcpy(kept, from, kept_bytes = size * count);
    return count;
}
static inline void *test_mmap(void *at, size_t size, int protection, int flags, int file, int from)
{
    return at || size != kept_bytes || protection != 1 || flags != 2 || file != 3 || from ? NULL
         : kept;
}
#define fwrite test_fwrite
#define mmap test_mmap
#define PROT_READ 1
#define MAP_PRIVATE 2
static envsamp_result save(const envsamp_kd *kd, int file)
{
#ifdef SAVES
#include "snippet.c"
#else
    test_fwrite(kd, 1, envsamp_kd_bytes(kd), file);
#endif
    return ENVSAMP_OK;
}
static envsamp_result reopen(size_t size, int descriptor)
{
#ifdef OPENS
#include "snippet.c"
#else
    const envsamp_kd *kd;
    const envsamp_result result = envsamp_kd_open(test_mmap(NULL, size, 1, 2, descriptor, 0), size,
                                                  &kd);
#endif
    return result == ENVSAMP_OK && !(envsamp_kd_sample(kd, 0.5f, 0.5f).pdf > 0.0f)
         ? ENVSAMP_ERR_FORMAT : result;
}
int main(void)
{
    const envsamp_image image = { make_map(), WIDTH, HEIGHT, 3, 0, ENVSAMP_LATLONG };
    envsamp_sizes sizes;
    envsamp_buffer table, scratch;
    const envsamp_kd *built;
    envsamp_result result;

    envsamp_kd_sizes(&image, NULL, &sizes);
    table.data = malloc(table.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    result = envsamp_kd_build(&image, NULL, table, scratch, &built);
    free(scratch.data);
    if (result == ENVSAMP_OK)
        result = save(built, 3);
    if (result == ENVSAMP_OK)
        result = reopen(envsamp_kd_bytes(built), 3);
    if (result == ENVSAMP_OK)
        kept[kept_bytes / 2] ^= 1;
    if (result != ENVSAMP_OK)
        printf("%s\n", envsamp_result_string(result));
    else if (reopen(kept_bytes, 3) != ENVSAMP_ERR_FORMAT)
        result = ENVSAMP_ERR_FORMAT;
    free(table.data);
    return result != ENVSAMP_OK;
}
END

# Whole by itself, so its map is made black, or missing, in a copy.
cat >"$tmp/quickstart.c" <<'END'
#include "snippet.c"
END

# ---- running them ----

printf 'int main(void) { return 0; }\n' >"$tmp/probe.c"
sanitize=-fsanitize=address,undefined
if ! { $cc $sanitize "$tmp/probe.c" -o "$tmp/probe" && "$tmp/probe"; } >/dev/null 2>&1; then
    sanitize=
fi
objects=$tmp/envsamp.o
check "the library compiles${sanitize:+, $sanitize}" $cc -std=c99 -g $sanitize -I. \
    -c tests/envsamp.c -o "$objects"

# compile NAME LANGUAGE: as $tmp/program. The piece about including has the implementation in it.
compile() {
    rm -f "$tmp/program"
    library="-DENVSAMP_IMPLEMENTED $objects"
    [ "$1" != include ] || library=
    case $2 in
        C) $cc -std=c99 -Wstrict-prototypes -Wmissing-prototypes $strict -g $sanitize \
               "$tmp/$1.c" $library -lm -o "$tmp/program" ;;
        C++) $cxx -x c++ -std=c++11 $strict -g $sanitize -c "$tmp/$1.c" -DENVSAMP_IMPLEMENTED \
                 -o "$tmp/program.o" && $cxx -g $sanitize "$tmp/program.o" $objects -lm \
                 -o "$tmp/program" ;;
    esac
}

# ends STATUS TEXT: the program has that exit status and prints that text, and no sanitizer speaks.
ends() {
    "$tmp/program" >"$tmp/out" 2>"$tmp/err"
    status=$?
    head -n 20 "$tmp/out" "$tmp/err"
    echo "expected status $1 and '$2'; status $status came"
    [ "$status" = "$1" ] && [ ! -s "$tmp/err" ] && { [ -z "$2" ] || grep -qF "$2" "$tmp/out"; }
}

# try NAME FILE LANGUAGE
try() {
    tr -d '\r' <"$2" >"$tmp/snippet.c"
    what="$3: $1 of $(basename "$2")"
    if [ "$1" = quickstart ]; then
        { echo '#include "provoke.h"'; echo '#undef WIDTH'; echo '#undef HEIGHT'
          sed 's/\(sky\[i\] = \)\(.*\);/\1mode_is("black") ? 0.0f : \2;/
               s/= { sky,/= { mode_is("pixels") ? NULL : sky,/' "$2"; } >"$tmp/snippet.c"
    fi
    check "$what compiles" compile "$1" "$3"
    export MODE
    case $1 in quickstart) good="no error" ;; *) good= ;; esac
    MODE= && check "$what runs" ends 0 "$good"
    case $1 in include) return ;; esac
    MODE=black && check "$what says of a black map" ends 1 "the total importance is zero"
    MODE=pixels && check "$what says of no pixels" ends 1 "a required pointer is NULL"
    MODE=memory && check "$what says of no memory" ends 1 "a required pointer is NULL"
    MODE=offset && check "$what takes memory aligned to 8" ends 0 "$good"
}

languages=C
if command -v "${cxx%% *}" >/dev/null; then
    languages="C C++"
else
    skip "no $cxx"
fi
seen=
tried=$languages
for file in "$tmp"/header_* "$tmp"/readme_*; do
    name=$(name_of "$file")
    seen="$seen $name"
    if [ "$name" = unknown ]; then
        check "$(basename "$file") has a name here" cat "$file" false
        continue
    fi
    case $name,$(cat "$file") in
        halftone,*'= { .'*) languages=C ;;      # designated initialisers are of C++20
        *) languages=$tried ;;
    esac
    for language in $languages; do
        try "$name" "$file" "$language"
    done
done
sorted=$(echo $seen | tr ' ' '\n' | sort | tr '\n' ' ')
case $seen in
    *quickstart*) all="include lights placing quickstart shading table " ;;
    *) all="half halftone include lights map save shading table table " ;;
esac
check "all are there: $sorted" test "$sorted" = "$all"

echo "1..$count"
[ "$failures" -eq 0 ]
