#!/bin/sh
# test_sizes.sh: test_sizes.c where size_t has 32 bits, and the sizes of both machines side by side:
# those of tables are equal, those of scratch smaller by pointers at most, and none is refused that
# fits. Skipped where no compiler for 32 bits is.
set -u
cd "$(dirname "$0")/.." || exit 1
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
flags="-std=c99 -O1 -I. tests/test_sizes.c -lm"

narrow=
for compiler in "i686-linux-gnu-gcc -static -msse2 -mfpmath=sse" "gcc -m32 -msse2 -mfpmath=sse"; do
    if $compiler $flags -o "$scratch/narrow" 2>/dev/null && "$scratch/narrow" -p \
        > "$scratch/narrow.txt" 2>/dev/null; then
        narrow=${compiler%% -*}
        break
    fi
done
if [ -z "$narrow" ]; then
    echo "1..0 # SKIP no compiler here makes 32-bit programs that run"
    exit 0
fi

echo 1..2
if "$scratch/narrow" > "$scratch/log" 2>&1; then
    echo "ok 1 - sizes with 32 bits ($narrow)"
else
    echo "not ok 1 - sizes with 32 bits ($narrow)"
    failed=1
    grep -v '^ok' "$scratch/log" | sed 's/^/#   /' | head -20
fi

# Fields: name, result, bytes of table and scratch, and of the pixels.
compare()
{
    ${CC:-cc} $flags -o "$scratch/wide" && "$scratch/wide" -p > "$scratch/wide.txt" || return 1
    [ -s "$scratch/wide.txt" ] && join "$scratch/wide.txt" "$scratch/narrow.txt" | awk '
        BEGIN { limit = 2147483648 }
        { fits = $3 < limit && $4 < limit && $5 < 2 * limit; seen++ }
        $6 == 0 && (!fits || $7 != $3 || $8 > $4 || $8 < 0.8 * $4 - 1000) { print; bad++ }
        $6 == 2 && fits { print; bad++ }
        $2 != 0 || ($6 != 0 && $6 != 2) { print; bad++ }
        END { print seen + 0, "sizes"; exit bad || seen < 2000 }'
}

if compare > "$scratch/log" 2>&1; then
    echo "ok 2 - the same as with 64 bits, or refused: $(tail -n 1 "$scratch/log")"
else
    echo "not ok 2 - the same as with 64 bits, or refused"
    sed 's/^/#   /' "$scratch/log" | head -20
    failed=1
fi
exit "${failed:-0}"
