#!/bin/sh
# test_macros.sh: the header compiles after headers that define macros of any name. Each name below
# becomes rubbish before the implementation is included, in C and C++; so does whatever the headers
# of Windows, X11, BSD and curses define that are installed. What the header itself includes comes
# first, so that only its own text meets them.
set -u
cd "$(dirname "$0")/.." || exit 1
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
cc=${CC:-cc}
cxx=${CXX:-c++}
count=0

cat > "$scratch/own.h" << 'END'
#include <assert.h>
#include <float.h>
#include <limits.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#if defined(__SSE__)
#include <xmmintrin.h>
#endif
END

# By where they are known from. Fields of public structures are not among them, though select and
# direct are macros in places: there they become another name, everywhere alike.
names='
windows.h: near far NEAR FAR small hyper interface min max IN OUT OPTIONAL CONST VOID ERROR DELETE
    TRUE FALSE BOOL STRICT PASCAL cdecl CALLBACK RGB DIFFERENCE ABSOLUTE RELATIVE OPAQUE TRANSPARENT
    NO_ERROR NO_DATA GetObject GetMessage SendMessage CreateWindow DrawText LoadImage FindText
    PlaySound Yield GetFreeSpace s_addr h_addr grp1 rad1 edt1 lst1 stc1 psh1 cmb1 ico1 frm1 scr1
    pascal huge _near _far uuid far_ptr THIS PURE EXTERN_C TEXT
X11: None Always Never Bool Status True False Success Above Below TopIf BottomIf Opposite Complex
    Convex Nonconvex Unsorted YSorted YXSorted CurrentTime NoSymbol KeyPress KeyRelease ButtonPress
    MotionNotify EnterNotify FocusIn FocusOut Expose ControlMask ShiftMask LockMask Mod1Mask
    Button1 Button2 Button3 Button4 Button5 Absolute GrayScale StaticColor PseudoColor TrueColor
    DirectColor LSBFirst MSBFirst InputOnly InputOutput ParentRelative CopyFromParent GrabModeSync
    RevertToNone XYBitmap ZPixmap AllocNone Bitmap Unmap When index rindex
sys/param.h: MIN MAX major minor makedev howmany roundup rounddown powerof2 nitems isset isclr
    setbit clrbit NBBY btodb dbtob ctob btoc trunc_page round_page PAGE_SIZE PAGE_MASK NODEV MAXPATHLEN
    hz PZERO CMASK NGROUPS DEV_BSIZE fldoff member2struct bcopy bzero bcmp abs
compilers: unix linux i386 mips sparc sun vax pdp11 m68k arm hpux sgi NeXT PPC vector pixel asm
    typeof fortran
complex.h: I complex imaginary
math.h: PI M_PI HUGE DOMAIN SING OVERFLOW UNDERFLOW PLOSS TLOSS X_TLOSS
Carbon: check verify require nil Nil YES NO check_string ensure
curses.h: box border clear erase move refresh scroll filter echo timeout beep flash getch addch
    standout attron OK ERR
Arduino: PI HALF_PI TWO_PI DEG_TO_RAD EULER F B0 B1 B00000001 bit word round radians degrees sq
    constrain lowByte highByte bitRead bitSet interrupts noInterrupts INPUT OUTPUT HIGH LOW DEFAULT
    EXTERNAL INTERNAL
Qt: slots signals emit forever foreach Q_OBJECT
others: bool true false noreturn thread_local alignas alignof static_assert swap SWAP ASSERT assert_
    countof ARRAY_SIZE COUNT EPS EPSILON INFINITY_ NAN_ CLAMP clamp_ SIGN SQR ABS DEBUG Debug INFO
    likely unlikely unused UNUSED inline_ force_inline restrict_ private public export internal
    local_persist global foreach_ each loop until unless repeat u8 u16 u32 u64 s8 s16 s32 s64 f32
    f64 i8 i16 i32 i64 uint ushort uchar ulong byte_t L N T X Y Z W H R G B D S E C K P Q V U M F J
'

report()
{
    count=$((count + 1))
    if [ "$1" -eq 0 ]; then
        echo "ok $count - $2"
    else
        echo "not ok $count - $2"
        sed 's/^/#   /' "$scratch/log" | grep -E 'error|note: in def|not' | head -20
        failed=1
    fi
}

skip()
{
    count=$((count + 1))
    echo "ok $count # SKIP $1"
}

# spoil NAMES: a source in which they are rubbish.
spoil()
{
    cat "$scratch/own.h"
    awk '{ print "#undef " $1; print "#define " $1 " @" $1 "@" }' "$1"
    echo '#define ENVSAMP_IMPLEMENTATION'
    echo '#include "envsamp.h"'
}

# compile LANGUAGE STANDARD COMPILER...: spoilt.c, for its syntax.
compile()
{
    language=$1 standard=$2
    shift 2
    "$@" -x "$language" "-std=$standard" -I. -fsyntax-only "$scratch/spoilt.c" > "$scratch/log" 2>&1
}

# Names that are words of the language cannot be macros in C++.
echo "$names" | tr ' ' '\n' | grep -E '^[A-Za-z_][A-Za-z_0-9]*$' | sort -u > "$scratch/names"
grep -vxE 'asm|bool|true|false|private|public|export|thread_local|alignas|alignof|static_assert' \
    "$scratch/names" > "$scratch/names_cxx"

spoil "$scratch/names" > "$scratch/spoilt.c"
compile c c99 $cc
report $? "$(wc -l < "$scratch/names" | tr -d ' ') names that others define, as C"
spoil "$scratch/names_cxx" > "$scratch/spoilt.c"
compile c++ c++11 $cxx
report $? "and as C++"
# The control: a name that the header does use.
{ cat "$scratch/names"; echo luminance; } > "$scratch/one_more"
spoil "$scratch/one_more" > "$scratch/spoilt.c"
if ! compile c c99 $cc && grep -q luminance "$scratch/log"; then
    report 0 "a name that is used makes that fail"
else
    report 1 "a name that is used makes that fail"
fi

# defined_by COMPILER HEADER...: all that these headers define, and those of the library do not.
defined_by()
{
    compiler=$1
    shift
    $compiler -E -dM "$scratch/own.h" 2>/dev/null | awk '{ sub(/\(.*/, "", $2); print $2 }' |
        sort -u > "$scratch/base"
    { cat "$scratch/own.h"; for each in "$@"; do echo "#include <$each>"; done; } > "$scratch/all.h"
    $compiler -E -dM "$scratch/all.h" 2>/dev/null | awk '{ sub(/\(.*/, "", $2); print $2 }' |
        sort -u | comm -23 - "$scratch/base" | grep -v '^_' |
        grep -vxE 'select|direct' > "$scratch/names"
    [ -s "$scratch/names" ]
}

# try_headers COMPILER C++-COMPILER HEADER...: those of them that are installed.
try_headers()
{
    c=$1 cplusplus=$2 found=
    shift 2
    for each in "$@"; do
        for name in $found $each; do echo "#include <$name>"; done > "$scratch/probe.c"
        $c -fsyntax-only "$scratch/probe.c" > /dev/null 2>&1 && found="$found $each"
    done
    if [ -z "$found" ] || ! defined_by "$c" $found; then
        skip "$c has none of $*"
        return
    fi
    many=$(wc -l < "$scratch/names" | tr -d ' ')
    spoil "$scratch/names" > "$scratch/spoilt.c"
    compile c c99 "$c"
    report $? "$many names of$found, as C"
    if command -v "$cplusplus" > /dev/null; then
        grep -vxE 'and|or|not|xor|bitand|bitor|compl|(and|or|not|xor)_eq|bool|true|false|asm' \
            "$scratch/names" > "$scratch/names_cxx"
        spoil "$scratch/names_cxx" > "$scratch/spoilt.c"
        compile c++ c++11 "$cplusplus"
        report $? "$many names of$found, as C++"
    fi
}

try_headers "$cc" "$cxx" X11/Xlib.h X11/Xutil.h X11/Xos.h X11/keysym.h
try_headers "$cc" "$cxx" sys/param.h sys/sysmacros.h complex.h iso646.h stdbool.h curses.h

# windows.h itself, as it is, and what it defines as rubbish.
windows='winsock2.h windows.h windowsx.h rpcndr.h ole2.h commctrl.h commdlg.h dlgs.h shlobj.h'
for target in x86_64-w64-mingw32 i686-w64-mingw32; do
    if ! command -v $target-gcc > /dev/null; then
        skip "no $target-gcc"
        continue
    fi
    for each in $windows; do echo "#include <$each>"; done > "$scratch/spoilt.c"
    printf '#define ENVSAMP_IMPLEMENTATION\n#include "envsamp.h"\n' >> "$scratch/spoilt.c"
    compile c c99 $target-gcc
    report $? "after windows.h, $target"
    try_headers $target-gcc $target-g++ $windows
done

echo "1..$count"
exit "${failed:-0}"
