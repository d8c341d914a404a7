#!/bin/sh
# The numbers of the documents are those that their commands print, as far as these are short: see
# numbers.pl. Needs build/samplers, build/facing_gallery and build/product_gallery.
cd "$(dirname "$0")/.." || exit 1
. tests/report.sh

# Each number that is checked is also changed by one digit in turn, which must be reported.
perl tests/numbers.pl -m >"$tmp/out" 2>&1
report $? "$(tail -n 1 "$tmp/out")"

# ---- a small document, right and wrong ----

document() {
    cat >"$tmp/README.md" <<END
# Numbers

A sample takes 31 ns, and errs by 0.0125 at 16 points, of 2 and 0.25 (x) [3] C99 \`a = 7\`.

| method | ns | error |
|---|---|---|
| WARP 6144 | 31 | 0.013 |
| ALIAS 6144 | 25 | 0.21 |
END
    mkdir -p "$tmp/tests"
    cat >"$tmp/tests/numbers.txt" <<END
; Of test_numbers.sh.
= table printf 'WARP 0.01251\nALIAS 0.2099\n'
@ README.md
takes # ns
    time bench
errs by # at # points
    check printf '0.01250 at 16\n'
of # and #
    given parameters
| method | ns | error |
    time {ns} bench
    check cat \$table
END
}

# says WORDS: numbers.pl finds an error, and says so with these words.
says() {
    perl tests/numbers.pl "$tmp" >"$tmp/out" 2>&1
    [ $? = 1 ] && grep 'not right' "$tmp/out" | grep -qF "$1"
    report $? "$2"
}

# change FILE FROM TO
change() {
    document
    sed "s/$2/$3/" "$tmp/$1" >"$tmp/changed"
    mv "$tmp/changed" "$tmp/$1"
}

document
perl tests/numbers.pl "$tmp" >"$tmp/out" 2>&1
report $? "a document that is right: $(tail -n 1 "$tmp/out")"
change README.md 0.0125 0.0126
says "does not print 0.0126 16" "a digit in the text"
change README.md "16 points" "17 points"
says "does not print 0.0125 17" "a whole number"
change README.md 0.013 0.014
says "WARP 6144: " "a digit in a table"
change README.md "| 0.21 |" "| 0.013 |"
says "ALIAS 6144: " "a number of another row"
change README.md "(x)" "4.5 times"
says "without a command: 4.5" "a number without a command"
change README.md "| method | ns" "| method | us"
says "no table | method" "a table without a command"
change tests/numbers.txt "errs by" "differs by"
says "has no \"differs by" "a piece that the document lacks"
change tests/numbers.txt "{ns}" "{us}"
says "no such columns" "a column that the table lacks"
change tests/numbers.txt "printf '0.01250 at 16.n'" "false"
says "fails: status 1" "a command that fails"
change tests/numbers.txt "{ns} bench" "{ns, error} bench"
perl tests/numbers.pl "$tmp" >"$tmp/out" 2>&1
report $? "times are not compared: $(tail -n 1 "$tmp/out")"
echo "1..$count"
