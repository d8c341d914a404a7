#!/usr/bin/perl
# Puts faults back, one at a time, into copies of the library, and shows which test fails.
#
#     tests/mutants.pl [-j JOBS] [-k] [WORD...]
#
# tests/mutants.txt lists them; with WORDs only those that have one in their name or fault are put
# back. The copies are in build/mutants/; what is in there may be deleted. First, as a control, the
# tests must pass without a fault; with -k the rest goes on if one does not. The exit status is 0 if
# all pass and every fault is caught: by a test point that fails, a crash, or a test without end.
use strict;
use warnings;
use Cwd qw(abs_path);
use File::Basename qw(dirname);
use File::Copy qw(copy);
use File::Path qw(make_path remove_tree);
use Getopt::Std;
use POSIX qw(setpgid);

chdir dirname(abs_path($0)) . '/..' or die;

my $time_limit = 300;                       # seconds a test may take
my $work       = 'build/mutants';
my $compiler   = $ENV{CC} || 'cc';
my $flags      = '-std=c99 -O1 -w -I. -Iexamples/common';
my @aids       = glob '{tests,examples/common}/*.c';
my @files      = (qw(envsamp.h README.md examples/quickstart.c), glob('tests/{,portability/}*.{c,h,sh}'),
                  glob('examples/common/*.{c,h}'), glob('bench/*.h'));
my @library    = qw(envsamp inside);        # what the header is compiled in, besides tests
my %extra      = (test_work => '-finstrument-functions');
my %options;
getopts('j:k', \%options) or exit 2;
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

# Returns the command of a test, compiled in the folder; or an empty list.
sub prepare {
    my ($folder, $test) = @_;
    my $objects = join ' ', map { "../control/build/$_" } object_names();

    return ("tests/$test") if $test =~ /\.sh$/;
    my $more = $extra{$test} // '';
    for (@library) {
        next if -e "$folder/build/$_.o";
        system("cd '$folder' && $compiler $flags -c tests/$_.c -o build/$_.o "
               . ">build/$_.log 2>&1") == 0 or return ();
    }
    $objects .= join '', map { " build/$_.o" } @library;
    system("cd '$folder' && $compiler $flags $more tests/$test.c $objects -lm -o build/$test "
           . ">build/$test.log 2>&1") == 0 or return ();
    return ("build/$test");
}

sub object_names { map { m{([^/]+)\.c$} ? "$1.o" : () } helpers() }
sub helpers { grep { !m{/test_|/exr|/picture|/envsamp|/inside} } @aids }

# Runs a test until the first point that fails. Returns what failed, or nothing.
sub run {
    my ($folder, @command) = @_;
    my ($failure, $last) = (undef, '');

    my $child = open(my $out, '-|') // fail "fork: $!";
    if (!$child) {
        setpgid(0, 0);
        open STDERR, '>&', \*STDOUT;
        chdir $folder && exec @command;
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
    return $failure if defined $failure;
    return 'crashes: signal ' . ($? & 127) . ($last ne '' ? ", $last" : '') if $? & 127;
    return "ends with status " . ($? >> 8) . ($last ne '' ? ", $last" : '') if $?;
    return;
}

# ---- the work ----

# A job is a control test or a mutant; its outcome, one line, is "KIND\tTEST\tTEXT".
sub do_job {
    my ($job) = @_;

    if (my $test = $job->{control}) {
        my @command = prepare("$work/control", $test) or return "broken\t$test\tdoes not compile";
        my $failure = run("$work/control", @command);
        return defined $failure ? "broken\t$test\t$failure" : "passed\t$test\t";
    }
    my $folder = "$work/$job->{number}";
    copy_tree("$work/control", $folder);
    my $why = mutate($folder, $job);
    return "broken\t\t$why" if defined $why;
    for my $test (@{ $job->{tests} }) {
        my @command = prepare($folder, $test) or return "broken\t$test\tdoes not compile";
        my $failure = run($folder, @command);
        if (defined $failure) {
            remove_tree($folder);
            return "caught\t$test\t$failure";
        }
    }
    return "SURVIVED\t\t" . join ' ', @{ $job->{tests} };
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
# once a report says 0. Returns whether one did.
sub do_all {
    my ($report, @queue) = @_;
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
        while (@order && $ended{ $order[0]{number} }) {
            $stop = 1 if !$report->($order[0], @{ $ended{ $order[0]{number} } });
            shift @order;
        }
        @queue = @order = () if $stop;
    }
    return $stop;
}

$| = 1;
my $started = time;
my @mutants = read_list('tests/mutants.txt');
my $number = 0;
$_->{number} = sprintf '%03d', ++$number for @mutants;
if (@ARGV) {
    my $words = join '|', map { quotemeta } @ARGV;
    @mutants = grep { "$_->{name} $_->{fault}" =~ /$words/i } @mutants or fail "none of that name";
}
my (%seen, %failing, @controls, %count);
for my $test (map { @{ $_->{tests} } } @mutants) {
    push @controls, { number => "control-$test", control => $test } if !$seen{$test}++;
}
@controls = sort { $b->{control} =~ /sh$/ <=> $a->{control} =~ /sh$/ } @controls;  # slow ones first

make_path($work);
unlink glob "$work/*.outcome";
copy_tree('.', "$work/control");
my $bad = 0;
for my $mutant (@mutants) {             # at once, not after minutes
    for (@{ $mutant->{edits} }) {
        my $times = () = (slurp("$work/control/$_->[0]") // '') =~ /\Q$_->[1]\E/g;
        next if $times == 1;
        print "mutant \"$mutant->{name}\" no longer applies: $_->[0] has $times times: $_->[1]\n";
        $bad++;
    }
}
exit 1 if $bad;
for (helpers(), map { "tests/$_.c" } @library) {
    my ($name) = m{([^/]+)\.c$};
    system("cd '$work/control' && $compiler $flags -c $_ -o build/$name.o") == 0 or fail "$_ fails";
}

print "control, without a fault\n";
my $fault = '';
my $fails = do_all(sub {
    my ($job, $kind, $test, $text) = @_;

    if ($job->{control}) {
        printf "    %-8s  %-18s  %s\n", $kind, $test, $text // '';
        $failing{$test}++ if $kind ne 'passed';
        return $kind eq 'passed' || $options{k};
    }
    if ($failing{$test}) {
        ($kind, $text) = ('broken', 'fails without a fault, too');
    }
    print "\n$job->{fault}\n" if $fault ne $job->{fault};
    $fault = $job->{fault};
    printf "    %-8s  %s\n%14s%s%s\n", $kind, $job->{name}, '', $test ? "$test: " : '',
        substr $text // '', 0, 160;
    $count{$kind}++;
    return 1;
}, @controls, @mutants);
fail 'the tests must pass without a fault first' if $fails;
printf "\n%d mutants, %d caught, %d survived, %d broken; %d s\n", scalar @mutants,
    map({ $count{$_} || 0 } qw(caught SURVIVED broken)), time - $started;
exit(($count{caught} || 0) != @mutants || %failing ? 1 : 0);
