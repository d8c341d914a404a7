#!/usr/bin/perl
# Which lines and branches of envsamp.h the tests in C reach: a table by function.
#
#     tests/coverage.pl [-j JOBS] [-a] [-r] [TEST...]
#
# The library is compiled by clang with counters, its assertions left out, and the tests, or those
# named, are run with it, as many at a time as there are cores, or JOBS. Copies of the library in
# several programs count as one, but for those with assertions of their own. The table has the
# functions of which something is missing; -a: all functions; -r: only the report, from what the
# last run counted. Everything is in build/coverage/.
#
# A line is one with code in it. A branch is one way that a condition, or a case, can go: clang
# counts each operand of && and || by itself. tests/coverage_exceptions.txt says of each branch that
# is never taken why not. The exit status is 0 if all lines are run, 90 % of the branches are taken,
# the others are listed, and none is listed that is taken.
use strict;
use warnings;
use Cwd qw(abs_path);
use File::Basename qw(dirname);
use Getopt::Std;
use JSON::PP;

chdir dirname(abs_path($0)) . '/..' or die;

my $least  = 0.9;                           # share of branches that must be taken
my $work   = 'build/coverage';
my $header = 'envsamp.h';
my $list   = 'tests/coverage_exceptions.txt';
my %options;
getopts('j:ar', \%options) or exit 2;
my $jobs  = $options{j} || (`getconf _NPROCESSORS_ONLN 2>/dev/null` || 1) + 0;
my @tests = @ARGV ? @ARGV : map { m{([^/]+)\.c$} } glob 'tests/test_*.c';

sub fail { print STDERR "coverage: @_\n"; exit 1 }

sub slurp {
    my ($path) = @_;

    open my $in, '<', $path or fail("$path: $!");
    local $/;
    return scalar <$in>;
}

# ---- tools: clang, and llvm's of the same version ----

sub tool {
    my ($name) = @_;

    for (split /:/, $ENV{PATH}) {
        return "$_/$name" if -x "$_/$name" && !-d "$_/$name";
    }
    return;
}

sub tools {
    my $clang = $ENV{CLANG} || 'clang';
    my ($version) = `$clang --version 2>/dev/null` =~ /version (\d+)/;
    my @found = ($clang);

    for my $name (qw(llvm-profdata llvm-cov)) {
        my $path = defined $version ? tool("$name-$version") || tool($name) : undef;

        if (!$path) {
            print 'coverage: skipped: no ', defined $version ? $name : $clang, "\n";
            exit 0;
        }
        push @found, $path;
    }
    return @found;
}

# ---- tests ----

sub build {
    my ($clang) = @_;
    my $flags = "-O1 -w -fprofile-instr-generate -fcoverage-mapping -fprofile-list=$work/only"
              . " '-DENVSAMP_ASSERT(x)=((void)0)'";

    mkdir for 'build', $work;
    open my $only, '>', "$work/only" or fail("$work/only: $!");
    print $only "[clang]\nsrc:*$header\n";
    close $only;
    my $targets = join ' ', map { "$work/$_" } @tests;
    system("make -s -j$jobs BUILD=$work CC='$clang' CFLAGS=\"$flags\" $targets") == 0
        or fail('the tests do not compile');
}

# Runs all, the largest sources first, for they take longest.
sub run {
    my @waiting = sort { -s "tests/$b.c" <=> -s "tests/$a.c" } @tests;
    my (%running, @failed);

    unlink glob "$work/*.profraw";
    while (@waiting || %running) {
        while (@waiting && keys %running < $jobs) {
            my $test  = shift @waiting;
            my $child = fork // fail("fork: $!");

            if (!$child) {
                $ENV{LLVM_PROFILE_FILE} = "$work/$test.profraw";
                open STDOUT, '>', "$work/$test.tap" or exit 127;
                open STDERR, '>&', \*STDOUT;
                exec "$work/$test" or exit 127;
            }
            $running{$child} = $test;
        }
        my $test = delete $running{ wait() };
        push @failed, $test if $?;
    }
    print "coverage: $_ fails: see $work/$_.tap\n" for sort @failed;
    return !@failed;
}

# ---- counts ----

# What llvm-cov says of the header: { lines => { line => count }, branches => [...], functions =>
# [...] }. A branch is { at => [line, column, line, column], count => { true, false } }.
sub counts {
    my ($profdata, $cov) = @_;
    my @own = grep { my $test = slurp("tests/$_.c");
                     $test =~ /^#define ENVSAMP_IMPLEMENTATION/m && $test !~ /define ENVSAMP_ASSERT/
              } @tests;
    my ($first) = grep { my $test = $_; !grep { $_ eq $test } @own } @tests;
    my $objects = join ' -object ', map { "$work/$_" } grep { defined } $first, @own;

    system("$profdata merge -o $work/all.profdata $work/*.profraw") == 0 or fail('no counts');
    my $json = `$cov export -instr-profile=$work/all.profdata $objects`;
    fail('llvm-cov fails') if $?;
    my $data  = decode_json($json)->{data}[0];
    my ($file) = grep { $_->{filename} =~ m{(^|/)\Q$header\E$} } @{ $data->{files} };
    my %counts = (lines => line_counts($file->{segments}));

    for (@{ $file->{branches} }) {
        my $key = join ' ', @$_[0 .. 3];

        $counts{branches}{$key}{true}  += $_->[4];
        $counts{branches}{$key}{false} += $_->[5];
    }
    for (@{ $data->{functions} }) {
        my ($name) = $_->{name} =~ /([^:]+)$/;

        next if $_->{filenames}[0] !~ m{(^|/)\Q$header\E$};
        $counts{functions}{$name} = [ @{ $_->{regions}[0] }[0, 2] ];
    }
    return \%counts;
}

# Of each line the largest count of what begins on it, or of what was begun before.
sub line_counts {
    my ($segments) = @_;
    my (%starting, %counts, $wrapped);

    push @{ $starting{ $_->[0] } }, $_ for @$segments;
    for my $line ($segments->[0][0] .. $segments->[-1][0]) {
        my @here    = @{ $starting{$line} || [] };
        my @entries = grep { $_->[3] && $_->[4] && !$_->[5] } @here;    # count, entry, no gap
        my $skipped = @here && !$here[0][3] && $here[0][4];

        if (!$skipped && (@entries || ($wrapped && $wrapped->[3]))) {
            my @values = map { $_->[2] } @entries, $wrapped ? $wrapped : ();

            $counts{$line} = (sort { $b <=> $a } @values)[0];
        }
        $wrapped = $here[-1] if @here;
    }
    return \%counts;
}

# ---- the report ----

my $source = slurp($header);
$source =~ s{/\*.*?\*/}{ my $comment = $&; $comment =~ s/[^\n]/ /g; $comment }gse;
my @source = ('', split /\n/, $source);

# What stands between two places, without comments, on one line.
sub text_of {
    my ($line, $column, $last, $end) = @_;
    my $text = join ' ', map { $_ == $last ? substr $source[$_], 0, $end - 1 : $source[$_] }
                         $line .. $last;

    $text = substr $text, $column - 1;
    $text =~ s/\s+/ /g;
    $text =~ s/^ | $//g;
    return $text;
}

# Exceptions by function, text and way: "a reason". In the list:
#
#     function: envsamp_kd_sizes
#     never true: arena.used > SIZE_MAX
#     why: a size_t of 64 bits holds every size
sub exceptions {
    my (%listed, $function, @open);

    for (split /\n/, slurp($list)) {
        next if /^\s*(#|$)/;
        if (/^function:\s*(\w+)/) {
            $function = $1;
        } elsif (/^never (true|false):\s*(.*?)\s*$/) {
            push @open, [$function, $2, $1];
        } elsif (/^why:\s*(.*\S)/) {
            $listed{ join "\t", @$_ } = $1 for @open;
            @open = ();
        } elsif (/^\s+(.*\S)/) {                # the reason goes on
            next;
        } else {
            fail("$list: what is this: $_");
        }
    }
    fail("$list: no reason for $open[0][1]") if @open;
    return %listed;
}

sub percent { return sprintf '%.2f %%', $_[1] ? 100 * $_[0] / $_[1] : 100 }

# Sums by function, and what is missing of each.
sub by_function {
    my ($counts) = @_;
    my (%owner, %sums);

    for my $name (keys %{ $counts->{functions} }) {
        my ($from, $to) = @{ $counts->{functions}{$name} };

        $owner{$_} = $name for $from .. $to;
        $sums{$name} = { lines => 0, run => 0, branches => 0, taken => 0, missing => [] };
    }
    for my $line (sort { $a <=> $b } keys %{ $counts->{lines} }) {
        my $sum = $sums{ $owner{$line} // next };

        next if $source[$line] !~ /\w/ || $source[$line] =~ /^#/;    # braces, preprocessor
        $sum->{lines}++;
        $sum->{run}++ if $counts->{lines}{$line};
        push @{ $sum->{missing} }, [$line, 'not run', text_of($line, 1, $line, 999)]
            if !$counts->{lines}{$line};
    }
    for my $key (keys %{ $counts->{branches} }) {
        my @at = split / /, $key;
        my $sum = $sums{ $owner{ $at[0] } // 'macros' } //=
            { lines => 0, run => 0, branches => 0, taken => 0, missing => [] };

        for my $way (qw(true false)) {
            my $taken = $counts->{branches}{$key}{$way} > 0;

            $sum->{branches}++;
            $sum->{taken}++ if $taken;
            push @{ $sum->{missing} }, [$at[0], "never $way", text_of(@at), $way] if !$taken;
        }
    }
    return \%sums;
}

sub report {
    my ($sums) = @_;
    my %listed = exceptions();
    my ($good, %used, %total) = (1);
    my $gap = sub { my $s = $sums->{ $_[0] }; 1000 * ($s->{lines} - $s->{run})
                                              + $s->{branches} - $s->{taken} };
    my @names = sort { $gap->($b) <=> $gap->($a) || $a cmp $b } keys %$sums;
    my $whole = grep { !$gap->($_) } @names;

    printf "%-36s %6s %6s %9s %6s %7s\n", 'function', 'lines', 'run', 'branches', 'taken', 'listed';
    for my $name (@names) {
        my $sum = $sums->{$name};

        for (@{ $sum->{missing} }) {
            my $key = join "\t", $name, $_->[2], $_->[3] // next;

            $used{$key} = $_->[4] = 1 if exists $listed{$key};
        }
        $sum->{listed} = grep { $_->[4] } @{ $sum->{missing} };
        $total{$_} += $sum->{$_} for qw(lines run branches taken listed);
        printf "%-36s %6d %6d %9d %6d %7d\n", $name, @$sum{qw(lines run branches taken listed)}
            if $options{a} || $gap->($name);
    }
    print "$whole functions of which nothing is missing\n" if !$options{a};
    printf "%-36s %6d %6d %9d %6d %7d\n", 'all', @total{qw(lines run branches taken listed)};
    for my $name (@names) {
        for (sort { $a->[0] <=> $b->[0] } grep { !$_->[4] } @{ $sums->{$name}{missing} }) {
            print "$header:$_->[0]: $name: $_->[1]: $_->[2]\n";
            $good = 0;
        }
    }
    for (sort grep { !$used{$_} } keys %listed) {
        print "$list: taken, or not there: ", join(': ', split /\t/), "\n";
        $good = 0;
    }
    print 'lines ', percent(@total{qw(run lines)}), ', branches ',
          percent(@total{qw(taken branches)}), ", $total{listed} branches listed with the reason\n";
    return $good && $total{taken} >= $least * $total{branches};
}

my ($clang, $profdata, $cov) = tools();
my $good = 1;
if (!$options{r}) {
    build($clang);
    $good = run();
}
exit !(report(by_function(counts($profdata, $cov))) && $good);
