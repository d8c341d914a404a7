# report.sh: the harness of tests that are scripts; each prints TAP for prove.
#
#     . tests/report.sh              at the root; makes a folder, $tmp, that is removed at the end
#     program >"$tmp/out" 2>"$tmp/err"
#     report $? "it works"           a point; 0 passes; a failure shows what is in $tmp/out, err,
#                                    stdout and stderr
#     skip "no program"              a point that cannot be run, and why
#     echo "1..$count"
#
# $failed is 1 after a failure.
tmp=$(mktemp -d) || exit 1
trap 'rm -rf "$tmp"' EXIT
count=0
failed=0

report() {
    count=$((count + 1))
    [ "$1" = 0 ] && echo "ok $count - $2" && return
    echo "not ok $count - $2"
    failed=1
    {
        echo "$0: $2"
        for file in out err stdout stderr; do
            [ ! -f "$tmp/$file" ] || head -n 20 "$tmp/$file"
        done
    } | sed 's/^/#   /' >&2
}

skip() {
    count=$((count + 1))
    echo "ok $count # SKIP $1"
}
