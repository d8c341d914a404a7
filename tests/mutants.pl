#!/usr/bin/perl
# Puts faults into copies of the library, one at a time, and shows which test fails.
#
#     tests/mutants.pl [-j JOBS] [-k] [-n] [WORD...]
#     tests/mutants.pl -a COUNT [-s SEED] [-j JOBS] [-k] [-n] [WORD...]
#
# The first puts back those of tests/mutants.txt; with WORDs only those that have one in their name
# or fault. -n only checks that each one still applies.
#
# The second draws COUNT faults of one token or one statement from SEED, 1 by default, spread over
# the sections of the header by their size, or over those that WORDs name, and runs the tests that
# tests/mutants_sections.txt lists for the section of each. What does not compile, compiles to the
# same code, or is shown to be equivalent in tests/mutants_equivalent.txt is drawn again. It says
# which share of the COUNT is caught. -n only lists what is drawn first.
#
# The copies are in build/mutants/; what is in there may be deleted. First, as a control, the tests
# must pass without a fault; with -k the rest goes on if one does not. A fault is caught by a test
# point that fails, a crash, or a test without end: five times the processor time of the control.
# The exit status is 0 if all controls pass and every fault of the list, or 90 % of those drawn, is
# caught.
use strict;
use warnings;
use Cwd qw(abs_path);
use File::Basename qw(dirname);
use File::Copy qw(copy);
use File::Path qw(make_path remove_tree);
use Getopt::Std;
use POSIX qw(setpgid);

chdir dirname(abs_path($0)) . '/..' or die;
require './tests/mutants_draw.pm';

my $time_limit = 600;                       # seconds a test may take by the clock
my $least      = 0.9;                       # share of drawn mutants that must be caught
my $work       = 'build/mutants';
my $compiler   = $ENV{CC} || 'cc';
my $flags      = '-std=c99 -O1 -w -I. -Iexamples/common';
my @files      = (qw(envsamp.h README.md examples/quickstart.c), glob('tests/{,portability/}*.{c,h,sh}'),
                  glob('examples/{common,render}/*.{c,h}'), glob('bench/*.h'));
my @aids       = (map({ "tests/$_.c" } qw(envsamp inside statistics)),    # linked to each test
                  map({ "examples/common/$_.c" } qw(image hdr maps errors filtered)),
                  'examples/render/rivals.c');
my $library    = 'tests/envsamp.c';        # the header alone
my %extra      = (test_work => '-finstrument-functions');
my $own        = qr/^#define ENVSAMP_IMPLEMENTATION/m;  # in sources that a fault changes
my $limits     = 'ulimit -v 8000000; ulimit -f 4000000; ulimit -c 0';
my (%seconds, %options);                    # of processor time of each control
getopts('a:j:kns:', \%options) or exit 2;
my $jobs = $options{j} || (`getconf _NPROCESSORS_ONLN 2>/dev/null` || 1) + 0;

# ---- the list ----

sub fail { die "mutants: @_\n" }

# A mutant: { fault, name, edits => [[file, search, replacement]...], tests => [...] }.
sub read_list {
    my ($path) = @_;
    my (@mutants, $fault, $file);

    open my $in, '<', $path or fail "$path: $!";
    while (<$in>) {
        chomp;
        next if /^\s*(#(\s|$)|$)/;
        if (/^\s/) {
            $mutants[-1]{edits}[-1][2] .= "\n$_";
            next;
        }
        my ($key, $value) = /^(\w+):\s*(.*?)\s*$/ or fail "$path:$.: what is this: $_";
        if ($key eq 'fault') {
            $fault = $value;
        } elsif ($key eq 'mutant') {
            push @mutants, { fault => $fault, name => $value, edits => [], tests => [] };
            $file = 'envsamp.h';
        } elsif ($key eq 'file') {
            $file = $value;
        } elsif ($key eq 'find') {
            push @{ $mutants[-1]{edits} }, [$file, $value, undef];
        } elsif ($key eq 'with') {
            $mutants[-1]{edits}[-1][2] = $value;
        } elsif ($key eq 'tests') {
            $mutants[-1]{tests} = [split ' ', $value];
        } else {
            fail "$path:$.: what is $key";
        }
    }
    for (@mutants) {
        fail "$_->{name}: no edit" if !@{ $_->{edits} };
        fail "$_->{name}: find, but not with" if grep { !defined $_->[2] } @{ $_->{edits} };
        fail "$_->{name}: no test" if !@{ $_->{tests} };
    }
    return @mutants;
}

# ---- copies ----

sub slurp {
    my ($path) = @_;

    open my $in, '<', $path or return undef;
    local $/;
    return scalar <$in>;
}

sub spew {
    my ($path, $text) = @_;

    open my $out, '>', $path or fail "$path: $!";
    print $out $text;
    close $out or fail "$path: $!";
}

sub copy_tree {
    my ($from, $to) = @_;

    remove_tree($to);
    for (@files) {
        next if !-e "$from/$_";
        make_path(dirname("$to/$_"));
        copy("$from/$_", "$to/$_") or fail "$from/$_: $!";
        chmod +(stat "$from/$_")[2] & 0777, "$to/$_";
    }
    make_path("$to/build");
}

# Edits a copy. Returns why it cannot be, or nothing.
sub mutate {
    my ($folder, $mutant) = @_;

    for (@{ $mutant->{edits} }) {
        my ($file, $search, $replacement) = @$_;
        my $text = slurp("$folder/$file");
        return "no longer applies: there is no $file" if !defined $text;
        my $count = () = $text =~ /\Q$search\E/g;
        return "no longer applies: $file has $count times: $search" if $count != 1;
        $text =~ s/\Q$search\E/$replacement/;
        spew("$folder/$file", $text);
    }
    return;
}

# ---- tests ----

# Whether the objects of the control serve a mutant: nothing that they can see is changed.
sub only_inside {
    my ($job) = @_;
    my $text = slurp("$work/control/envsamp.h");
    my $border = index $text, "\n#if defined(ENVSAMP_IMPLEMENTATION)";

    return !grep { $_->[0] ne 'envsamp.h' || index($text, $_->[1]) < $border } @{ $job->{edits} };
}

# Compiles a source in a folder, if that is not done. Returns the object's path there, or nothing.
sub object {
    my ($folder, $source) = @_;
    my ($name) = $source =~ m{([^/]+)\.c$};
    my $more = slurp("$folder/$source") =~ $own ? $extra{$name} // '' : '-O2';  # compiled once

    return "build/$name.o" if -e "$folder/build/$name.o";
    system("cd '$folder' && $compiler $flags $more -c $source -o build/$name.new.o "
           . ">build/$name.log 2>&1") == 0 or return;
    rename "$folder/build/$name.new.o", "$folder/build/$name.o" or return;
    return "build/$name.o";
}

# Returns the command of a test, compiled in the folder; or an empty list. Objects without the
# library in them are those of the control, if they may be shared.
sub prepare {
    my ($folder, $test, $shared) = @_;
    my ($name, @words) = split /:/, $test;

    return ("tests/$name") if $name =~ /\.sh$/;
    my $source = slurp("$folder/tests/$name.c");
    my $alone = $source =~ $own && $source !~ /^#define ENVSAMP_STATIC/m;
    for my $others (0, 1) {                 # most tests need no look inside the library
        my @objects;
        for my $source ("tests/$name.c", @aids) {
            my $changed = slurp("$folder/$source") =~ $own;
            next if $changed && @objects && ($alone || (!$others && $source ne $library));
            my $there = $shared && !$changed;
            my $object = object($there ? "$work/control" : $folder, $source) // return ();
            push @objects, $there ? "../control/$object" : $object;
        }
        my $link = "$compiler @objects -lm -o build/$name >build/$name.log 2>&1";
        return ("build/$name", @words) if system("cd '$folder' && $link") == 0;
    }
    return ();
}

# Runs a test until the first point that fails. Returns what failed, or nothing.
sub run {
    my ($folder, $test, @command) = @_;
    my ($failure, $last) = (undef, '');
    my $seconds = $seconds{$test} ? int(5 * $seconds{$test} + 10) : $time_limit;

    my $child = open(my $out, '-|') // fail "fork: $!";
    if (!$child) {
        setpgid(0, 0);
        open STDERR, '>&', \*STDOUT;
        my $script = "$limits; ulimit -t $seconds; exec \"\$@\"";
        chdir $folder && exec 'sh', '-c', $script, 'sh', @command;
        exit 127;
    }
    local $SIG{ALRM} = sub {
        $failure = "does not end: killed after $time_limit s";
        kill KILL => -$child;
    };
    alarm $time_limit;
    while (<$out>) {
        chomp;
        if (/^not ok \d+ - (.*)/) {
            $failure = $1;
            kill KILL => -$child;
            last;
        }
        $last = $_ if !/^ok|^1\.\.|^#/;
    }
    close $out;
    alarm 0;
    my $signal = $? & 127;
    return $failure if defined $failure;
    return "does not end: killed after $seconds s" if $signal == POSIX::SIGXCPU() || $signal == 9;
    return "crashes: signal $signal" . ($last ne '' ? ", $last" : '') if $signal;
    return "ends with status " . ($? >> 8) . ($last ne '' ? ", $last" : '') if $?;
    return;
}

# ---- the work ----

# A job compiles an object of the control, runs a test of it, or is a mutant; its outcome, one line,
# is "KIND\tTEST\tTEXT".
sub do_job {
    my ($job) = @_;

    if ($job->{source}) {
        return object("$work/control", $job->{source}) ? "passed\t\t"
            : "broken\t$job->{source}\tdoes not compile";
    }
    if (my $test = $job->{control}) {
        my @command = prepare("$work/control", $test) or return "broken\t$test\tdoes not compile";
        my $failure = run("$work/control", $test, @command);
        return "broken\t$test\t$failure" if defined $failure;
        my @times = times;
        return "passed\t$test\t" . ($times[2] + $times[3]);
    }
    my $folder = "$work/$job->{number}";
    copy_tree("$work/control", $folder);
    my $outcome = $job->{edits} ? do_listed($folder, $job) : do_drawn($folder, $job);
    remove_tree($folder) if $outcome !~ /^(?:SURVIVED|broken)/;
    return $outcome;
}

sub do_listed {
    my ($folder, $job) = @_;

    my $why = mutate($folder, $job);
    return "broken\t\t$why" if defined $why;
    return do_tests($folder, $job, only_inside($job)) // "SURVIVED\t\t@{ $job->{tests} }";
}

# A mutant that is "void" is drawn again.
sub do_drawn {
    my ($folder, $job) = @_;

    my $text = slurp("$folder/envsamp.h");
    substr($text, $job->{from}, $job->{length}) = $job->{text};
    spew("$folder/envsamp.h", $text);
    my $object = object($folder, $library) or return "void\t\tdoes not compile";
    return "void\t\tsame code" if slurp("$folder/$object") eq slurp("$work/control/$object");
    my $outcome = do_tests($folder, $job, 1);
    return $outcome if defined $outcome;
    return "void\t\tsame code" if optimised($folder) eq optimised("$work/control");
    return "SURVIVED\t\t@{ $job->{tests} }";
}

# The library in a folder, compiled by -O2: what gcc and clang then find to be the same is the same.
sub optimised {
    my ($folder) = @_;

    system("cd '$folder' && $compiler $flags -O2 -c $library -o build/optimised.$$.o") == 0
        or fail "$folder: $library does not compile";
    my $object = slurp("$folder/build/optimised.$$.o");
    unlink "$folder/build/optimised.$$.o";
    return $object;
}

# Returns the outcome of the first test that fails or cannot be run, or nothing.
sub do_tests {
    my ($folder, $job, $shared) = @_;

    for my $test (@{ $job->{tests} }) {
        my @command = prepare($folder, $test, $shared) or return "broken\t$test\tdoes not compile";
        my $failure = run($folder, $test, @command);
        return "caught\t$test\t$failure" if defined $failure;
    }
    return;
}

sub start {
    my ($job) = @_;

    my $child = fork // fail "fork: $!";
    return $child if $child;
    $SIG{INT} = $SIG{TERM} = 'DEFAULT';
    spew("$work/$job->{number}.outcome", do_job($job) . "\n");
    POSIX::_exit(0);
}

# Does all jobs, as many at a time as there are cores, and reports each in its turn; begins no more
# once a report says 0. Returns whether one did. `more` says at the end of a job what else to do.
sub do_all {
    my ($report, $more, @queue) = @_;
    my (%running, %ended, $stop);
    my @order = @queue;

    while (@queue || %running) {
        while (@queue && keys %running < $jobs) {
            my $job = shift @queue;
            $running{ start($job) } = $job;
        }
        my $child = wait;
        my $job = delete $running{$child} // next;
        my $line = slurp("$work/$job->{number}.outcome") // "broken\t\tno outcome";
        chomp $line;
        $ended{ $job->{number} } = [split /\t/, $line, 3];
        my @others = $more ? $more->($job, @{ $ended{ $job->{number} } }) : ();
        push @queue, @others;
        push @order, @others;
        while (@order && $ended{ $order[0]{number} }) {
            $stop = 1 if !$report->($order[0], @{ $ended{ $order[0]{number} } });
            shift @order;
        }
        @queue = @order = () if $stop;
    }
    return $stop;
}

# Makes the control and runs these tests of it. Returns those that fail.
sub control {
    my (@tests) = @_;
    my (%seen, %failing);
    my @controls = map { { number => "control-$_", control => $_ } } grep { !$seen{$_}++ } @tests;
    @controls = sort { $b->{control} =~ /sh$/ <=> $a->{control} =~ /sh$/ } @controls;  # the slow
    my @sources = map { { number => s{.*/}{object-}r, source => $_ } } @aids,
        grep { -e } map { /^(\w+)(?::|$)/ ? "tests/$1.c" : () } keys %seen;
    my %once;

    do_all(sub { $_[1] eq 'passed' or fail "$_[2]: $_[3]" }, undef,
           grep { !$once{ $_->{source} }++ } @sources);
    print "control, without a fault\n";
    my $fails = do_all(sub {
        my ($job, $kind, $test, $text) = @_;

        $seconds{$test} = $text if $kind eq 'passed';
        printf "    %-8s  %-24s  %s\n", $kind, $test, $kind eq 'passed' ? "$text s" : $text;
        $failing{$test}++ if $kind ne 'passed';
        return $kind eq 'passed' || $options{k};
    }, undef, @controls);
    fail 'the tests must pass without a fault first' if $fails;
    return %failing;
}

# ---- those of the list ----

sub listed {
    my @mutants = read_list('tests/mutants.txt');
    my ($number, $bad, $fault, %count) = (0, 0, '');

    $_->{number} = sprintf '%03d', ++$number for @mutants;
    if (@ARGV) {
        my $words = join '|', map { quotemeta } @ARGV;
        @mutants = grep { "$_->{name} $_->{fault}" =~ /$words/i } @mutants or fail 'no such mutant';
    }
    for my $mutant (@mutants) {             # at once, not after minutes
        for (@{ $mutant->{edits} }) {
            my $times = () = (slurp($_->[0]) // '') =~ /\Q$_->[1]\E/g;
            next if $times == 1;
            print "mutant \"$mutant->{name}\" no longer applies: ",
                "$_->[0] has $times times: $_->[1]\n";
            $bad++;
        }
        for (grep { /\.sh$/ ? !-e "tests/$_" : !-e 'tests/' . (split /:/)[0] . '.c' }
             @{ $mutant->{tests} }) {
            print "mutant \"$mutant->{name}\": there is no $_\n";
            $bad++;
        }
    }
    if ($bad || $options{n}) {
        printf "%d mutants, %d errors\n", scalar @mutants, $bad;
        return $bad == 0;
    }
    my %failing = control(map { @{ $_->{tests} } } @mutants);
    do_all(sub {
        my ($job, $kind, $test, $text) = @_;

        ($kind, $text) = ('broken', 'fails without a fault, too') if $failing{$test};
        print "\n$job->{fault}\n" if $fault ne $job->{fault};
        $fault = $job->{fault};
        printf "    %-8s  %s\n%14s%s%s\n", $kind, $job->{name}, '', $test ? "$test: " : '',
            substr $text // '', 0, 160;
        $count{$kind}++;
        return 1;
    }, undef, @mutants);
    printf "\n%d mutants, %d caught, %d survived, %d broken; %d s\n", scalar @mutants,
        map({ $count{$_} || 0 } qw(caught SURVIVED broken)), time - $^T;
    return ($count{caught} || 0) == @mutants && !%failing;
}

# ---- those that are drawn ----

# { section => [tests] }
sub read_sections {
    my ($path) = @_;
    my %tests;

    for (grep { /^\s*[^#\s]/ } split /\n/, slurp($path) // fail "$path: $!") {
        my ($section, @tests) = /^([\w-]+):/ ? split /:?\s+/ : fail "$path: what is this: $_";
        $tests{$section} = \@tests;
    }
    return %tests;
}

# { key of a site => reason }
sub read_equivalent {
    my ($path) = @_;
    my (%why, %entry);

    for (split /\n/, (slurp($path) // '') . "\n", -1) {        # with the empty line at the end
        next if /^#/;
        if (/^(in|line|with|why):\s*(.*?)\s*$/) {
            $entry{$1} = $2;
        } elsif (/^\s+(\S.*)$/ && $entry{why}) {
            $entry{why} .= " $1";
        } elsif (/^\s*$/ && %entry) {
            my ($in, $nth) = ($entry{in} // '') =~ /^(\w+)(?: #(\d+))?$/;
            fail "$path: incomplete: $entry{line}"
                if !$in || grep { !defined $entry{$_} } qw(line with why);
            my $key = mutants_draw::key($in, @entry{qw(line with)}, $nth // 1);
            fail "$path: twice: $key" if $why{$key};
            $why{$key} = $entry{why};
            %entry = ();
        } elsif (/\S/) {
            fail "$path: what is this: $_";
        }
    }
    return %why;
}

sub place { sprintf '%s, line %d, %s', @{ $_[0] }{qw(section line function)} }

sub drawn {
    my ($count, $seed) = ($options{a}, $options{s} // 1);
    my @sites = mutants_draw::sites(slurp('envsamp.h'));
    my %tests = read_sections('tests/mutants_sections.txt');
    my %equivalent = read_equivalent('tests/mutants_equivalent.txt');
    my (%known, %void, %drawn, %kinds, $number);

    $known{ $_->{key} } = 1 for @sites;
    my @lost = grep { !$known{$_} } sort keys %equivalent;
    print "tests/mutants_equivalent.txt no longer applies: $_\n" for @lost;
    for my $section (sort map { $_->{section} } @sites) {
        fail "tests/mutants_sections.txt has no $section" if !$tests{$section};
    }
    if (@ARGV) {
        my $words = join '|', map { quotemeta } @ARGV;
        @sites = grep { $_->{section} =~ /$words/ } @sites or fail 'no section of that name';
    }
    my ($queue, $quota) = mutants_draw::draw($seed, $count, @sites);
    my $next = sub {
        my ($section) = @_;
        while (my $site = shift @{ $queue->{$section} }) {
            if ($equivalent{ $site->{key} }) {
                $void{equivalent}++;
                next;
            }
            $site->{tests} = $tests{$section};
            $site->{number} = sprintf 'drawn-%03d', ++$number;
            return $site;
        }
        return;
    };
    my %turn;                               # sections by turns, each spread over all
    for my $section (sort keys %$quota) {
        push @{ $turn{ sprintf '%.6f', ($_ - 0.5) / $quota->{$section} } }, $section
            for 1 .. $quota->{$section};
    }
    my @mutants = map { map { $next->($_) } @{ $turn{$_} } } sort keys %turn;
    if ($options{n}) {
        printf "%s, %s\n    %s\n    %s\n", place($_), @$_{qw(class was now)} for @mutants;
        printf "%d mutants of %d places\n", scalar @mutants, scalar @sites;
        return !@lost;
    }
    my %failing = control(map { @{ $tests{$_} } } grep { $quota->{$_} } keys %$quota);
    print "\nmutants, seed $seed\n";
    do_all(sub {
        my ($job, $kind, $test, $text) = @_;

        ($kind, $text) = ('broken', 'fails without a fault, too') if $failing{$test};
        if ($kind eq 'void') {
            $void{$text}++;
            return 1;
        }
        printf "    %-8s  %s%s\n", $kind, place($job), $kind eq 'caught' ? ": $test" : ", $text";
        printf "%14s%s\n%14s%s\n", '', $job->{was}, '', $job->{now} if $kind ne 'caught';
        $kinds{ $job->{section} }{$kind}++;
        $kinds{ $job->{class} }{$kind}++;
        $kinds{all}{$kind}++;
        return 1;
    }, sub { $_[1] eq 'void' ? $next->($_[0]{section}) : () }, @mutants);

    printf "\n%-20s %6s %6s %8s\n", '', 'drawn', 'caught', 'share';
    my ($all, $caught) = (0, 0);
    for (sort(keys %$quota), mutants_draw::classes(), 'all') {
        next if !$kinds{$_};
        $all = 0;
        $all += $_ for values %{ $kinds{$_} };
        $caught = $kinds{$_}{caught} || 0;
        printf "%-20s %6d %6d %6.1f %%\n", $_, $all, $caught, 100.0 * $caught / $all;
    }
    printf "drawn again: %d do not compile, %d compile to the same code, %d are shown to be "
        . "equivalent; %d s\n",
        map({ $void{$_} || 0 } 'does not compile', 'same code', 'equivalent'), time - $^T;
    return $caught >= $least * $all && !%failing && !@lost;
}

$| = 1;
make_path($work);
unlink glob "$work/*.outcome";
copy_tree('.', "$work/control") if !$options{n};
exit !($options{a} ? drawn() : listed());
