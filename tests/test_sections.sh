#!/bin/sh
# The sections of envsamp.h are in the order that data flows, and each uses only what is defined
# above: functions, types and macros. Folders too: examples take nothing from bench/ or tests/, and
# bench/ nothing from tests/.
cd "$(dirname "$0")/.." || exit 1
tmp=$(mktemp -d) || exit 1
trap 'rm -rf "$tmp"' EXIT
count=0

point() {  # status of the command before, text
    count=$((count + 1))
    [ "$1" -eq 0 ] && echo "ok $count - $2" || echo "not ok $count - $2"
}

# Prints every use of a name above its definition, and what a section calls of one below it. FIT is
# the one exception: it calls the solver as a user does, by its declaration.
backwards() {
    awk '
    function scan(line, name) {
        while (match(line, /(envsamp_|ENVSAMP__)[A-Za-z0-9_]+/)) {
            name = substr(line, RSTART, RLENGTH)
            line = substr(line, RSTART + RLENGTH)
            uses++
            use_name[uses] = name
            use_line[uses] = NR
            use_section[uses] = section
        }
    }
    /\[search: @/ { match($0, /@[a-z-]+/); section = substr($0, RSTART, RLENGTH) }
    /\/\* ===/ { in_head = 1 }
    /Stop here/ { implementation = 1 }
    {
        line = $0
        while (match(line, /\/\*[^*]*\*+([^\/*][^*]*\*+)*\//))
            line = substr(line, 1, RSTART - 1) " " substr(line, RSTART + RLENGTH)
        if (in_comment) {
            if (!match(line, /\*\//)) next
            line = substr(line, RSTART + 2)
            in_comment = 0
        }
        if (match(line, /\/\*/)) {
            line = substr(line, 1, RSTART - 1)
            in_comment = 1
        }
        if (!implementation) next
    }
    line ~ /^#[ ]*define ENVSAMP__/ {
        match(line, /ENVSAMP__[A-Za-z0-9_]+/)
        name = substr(line, RSTART, RLENGTH)
        if (!(name in defined)) { defined[name] = NR; home[name] = section }
    }
    line ~ /^(static|ENVSAMP)/ && match(line, /envsamp_[a-z0-9_]+\(/) {
        name = substr(line, RSTART, RLENGTH - 1)
        if (!(name in defined)) { defined[name] = NR; home[name] = section }
    }
    match(line, /^(typedef )?struct envsamp_[a-z0-9_]+/) && line ~ /{/ {
        name = substr(line, RSTART, RLENGTH)
        sub(/.*struct /, "", name)
        if (!(name in defined)) { defined[name] = NR; home[name] = section }
    }
    { scan(line) }
    END {
        for (i = 1; i <= uses; i++) {
            name = use_name[i]
            if (!(name in defined) || use_line[i] >= defined[name]) continue
            if (use_section[i] == home[name] || name ~ /^envsamp_lm($|_scratch|_desc|_info)/) continue
            print use_section[i] " uses " name " of " home[name] " in line " use_line[i]
        }
    }' "$1"
}

# Lines from the first of its declaration to the brace that ends it, and name, of each function.
functions() {
    awk '
    /Stop here/ { implementation = 1 }
    !implementation { next }
    /^(static|ENVSAMP)[A-Za-z_ ]* .*\(/ {
        first = NR
        name = $0
        sub(/\(.*/, "", name)
        sub(/.*[ *]/, "", name)
    }
    /^(static|ENVSAMP).*\{.*\}$/ { print 1, name; next }
    /^\{/ { body = 1 }
    /^\}/ && body { print NR - first + 1, name; body = 0 }' "$1"
}

tags=$(sed -n 's/.*\[search: @\([a-z-]*\)\].*/\1/p' envsamp.h | tr '\n' ' ')
[ "$tags" = "math images coordinates importance kd-build kd-crown kd-probabilities kd-table \
kd-sampling cdf halftone lights lm " ]
point $? "the sections are those of the house, in order"

backwards envsamp.h >"$tmp/found"
[ ! -s "$tmp/found" ]
point $? "a section uses only what is defined above"
sed 's/^/# /' "$tmp/found"

# The same check with a call that goes down: from images to lights, and of a type and a macro.
for fault in 'envsamp__random(1, 2)' 'sizeof(envsamp__tree)' 'ENVSAMP__WALK'; do
    awk -v fault="$fault" '{ print }
        /Stop here/ { implementation = 1 }
        implementation && /^ENVSAMP_DEVICE ENVSAMP_DEF float envsamp_luminance/ { inside = 1 }
        inside && /^{/ { print "    (void)" fault ";"; inside = 0 }' envsamp.h >"$tmp/fault.h"
    [ "$(backwards "$tmp/fault.h" | wc -l)" -eq 1 ]
    point $? "$fault in a section far above is found"
done

functions envsamp.h >"$tmp/functions"
[ "$(awk '$1 > 80' "$tmp/functions" | wc -l)" -eq 0 ]
point $? "no function is longer than 80 lines"
awk '$1 > 80 { print "# " $0 }' "$tmp/functions"

# includes FOLDER: what files below FOLDER/examples and FOLDER/bench include of a folder above
# theirs in that order.
includes() {
    grep -rnE '^[[:space:]]*#[[:space:]]*include.*"([^"]*/)?(bench|tests)/' "$1/examples"
    grep -rnE '^[[:space:]]*#[[:space:]]*include.*"([^"]*/)?tests/' "$1/bench"
}

includes . >"$tmp/found"
[ ! -s "$tmp/found" ]
point $? "examples include nothing of bench/ or tests/, bench/ nothing of tests/"
sed 's/^/# /' "$tmp/found"
mkdir "$tmp/examples" "$tmp/bench"
cp examples/common/light.h "$tmp/examples"
cp bench/table.h "$tmp/bench"
[ "$(includes "$tmp" | wc -l)" -eq 0 ]
point $? "of two files as they are none is found"
for fault in examples:../../bench/baselines.h examples:../tests/check.h bench:../tests/inside.h; do
    folder=${fault%%:*}
    echo "#  include \"${fault#*:}\"" >"$tmp/$folder/fault.c"
    [ "$(includes "$tmp" | wc -l)" -eq 1 ]
    point $? "${fault#*:} in $folder is found"
    rm "$tmp/$folder/fault.c"
done
echo "1..$count"
