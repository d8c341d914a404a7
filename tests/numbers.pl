#!/usr/bin/perl
# Prints again the numbers of README.md, bench/README.md and tests/README.md, and compares.
#
#     perl tests/numbers.pl         the short commands
#     perl tests/numbers.pl -l      the long ones too: hours; -l WORD: those with this word
#     perl tests/numbers.pl -m      a control: each number that is checked, changed by one digit in
#                                   turn, must be reported
#     perl tests/numbers.pl DIR     with documents and list of another folder
#
# tests/numbers.txt names a command for each number. A line that begins with @ names a document. A
# line at the margin is a piece of its text, in which each # stands for a number, or the heading of
# a table. The lines below it, indented, say where its numbers come from:
#
#     check COMMAND     they are printed by it, in this order; of a table: each row by a line of
#                       its own
#     data COMMAND      the same, where `make data` has fetched the real maps
#     long COMMAND      the same, but it takes more than some 20 s
#     look COMMAND      it takes long, and they follow from what it prints; they are not compared
#     time COMMAND      it prints them, other ones each time and on each machine
#     given WHY         no measurement
#
# {a, b} before the command names columns of a table; without it all others are meant. Its first
# column and its heading are labels. $NAME in a command is a file with what a command prints that
# the list names so: "= NAME COMMAND". Numbers in code, in [references] and behind letters do not
# count. A number without a line, a line without a number and a command that fails are errors.
use strict;
use warnings;
use File::Temp 'tempdir';

my $number = qr/(?:(?<![\w.])|(?<=\dx))\d+(?:\.\d+)?(?:e-?\d+)?/;
my ($errors, %tally, %output, %said, %named) = (0);
my ($long, $mutate, $root, $folder) = (undef, 0, '.', tempdir(CLEANUP => 1));
while (@ARGV) {
    my $word = shift;
    if ($word eq '-l') { $long = @ARGV ? shift : '' }
    elsif ($word eq '-m') { $mutate = 1 }
    else { $root = $word }
}

sub fault {
    print "not right: $_[0]\n";
    $errors++;
}

sub slurp {
    my ($path) = @_;
    open my $in, '<', $path or die "$path: $!\n";
    local $/;
    return scalar <$in>;
}

# ---- documents ----

# The text on one line, without code, references and addresses; and its tables, row by row.
sub document {
    my ($path) = @_;
    my ($text, @tables, $rows) = ('');
    my $whole = slurp($path);
    $whole =~ s/^```.*?^```$//msg;
    $whole =~ s/`([^`]*)`/my $code = $1; $code =~ tr{0-9}{}d; "`$code`"/ge;
    $whole =~ s/\]\([^)]*\)/]/g;
    $whole =~ s/\[\d+\]|\[[^\]]*\b(?:19|20)\d\d\]//g;
    for (split /\n/, $whole) {
        if (!/^\|/) { undef $rows; $text .= "$_ "; next }
        push @tables, { heading => $_, rows => $rows = [] } if !$rows;
        push @$rows, [map { s/^\s+|\s+$//gr } split /\|/, substr($_, 1)] if !/^\|[-| ]*$/;
    }
    $text =~ s/\s+/ /g;
    return { path => $path, text => $text, tables => \@tables, seen => {} };
}

# ---- the list ----

sub list {
    my ($path) = @_;
    my ($file, @entries);
    for (split /\n/, slurp($path)) {
        next if /^\s*$|^;/;
        if (/^@ (.*)/) { $file = $1 }
        elsif (/^= (\w+) (.*)/) { $named{$1} = $2 }
        elsif (/^\s+(check|data|long|look|time|given) (?:\{(.*?)\} )?(.*)/) {
            push @{$entries[-1]{sources}},
                { kind => $1, columns => defined $2 ? [split /, */, $2] : undef, command => $3 };
        }
        elsif (/^\S/) { push @entries, { file => $file, piece => $_, sources => [] } }
        else { die "$path: $_\n" }
    }
    return @entries;
}

# ---- comparing ----

sub runs {
    my ($source) = @_;
    return 0 if $source->{kind} =~ /^(?:look|time|given)$/;
    return 0 if $source->{kind} eq 'data' && !-e 'data/city.pfm';
    return $source->{kind} ne 'long' || defined $long && index($source->{command}, $long) >= 0;
}

# Runs what the commands name by $NAME, two at a time.
sub run_named {
    my %needed = map { $_ => 1 } map { $_->{command} =~ /\$(\w+)/g } grep { runs($_) } @_;
    my @left = grep { $named{$_} } sort keys %needed;
    my %running;
    while (@left || %running) {
        if (@left && keys %running < 2) {
            my $name = shift @left;
            my $child = fork // die "fork: $!\n";
            exec 'sh', '-c', "{ $named{$name}; } >$folder/$name 2>/dev/null" if !$child;
            $running{$child} = $name;
        } else {
            my $name = delete $running{wait()};
            fault("`$named{$name}` fails: status " . ($? >> 8)) if $?;
        }
    }
    $ENV{$_} = "$folder/$_" for keys %needed;
}

# Lines of numbers that a command prints; undef where it is not run.
sub printed {
    my ($source) = @_;
    my $command = $source->{command};
    return undef if !runs($source);
    if (!$output{$command}) {
        my $text = `$command`;
        fault("`$command` fails: status " . ($? >> 8)) if $?;
        $output{$command} = [map { [/\d+(?:\.\d+)?(?:e[-+]?\d+)?/g] } split /\n/, $text];
    }
    return $output{$command};
}

# A number of a document has been rounded; a whole one has not.
sub same {
    my ($said, $printed) = @_;
    return $said == $printed if $said !~ /\./ || $said =~ /e/;
    my $places = length(($said =~ /\.(\d+)/)[0]);
    return 0 if $printed !~ /\./ || $printed =~ /e/ || length(($printed =~ /\.(\d+)/)[0]) < $places;
    return sprintf("%.*f", $places, $printed) eq $said;
}

# Whether all are there in this order.
sub within {
    my ($said, $printed) = @_;
    my $at = 0;
    for my $one (@$said) {
        $at++ while $at < @$printed && !same($one, $printed->[$at]);
        return 0 if $at++ >= @$printed;
    }
    return 1;
}

# $used: lines that other rows of the table have taken; undef: all numbers are one line.
sub right {
    my ($said, $lines, $used) = @_;
    return within($said, [map { @$_ } @$lines]) ? 'all' : undef if !$used;
    my ($line) = grep { !$used->{$_} && within($said, $lines->[$_]) } 0 .. $#$lines;
    return $line;
}

# Compares numbers that stand together. With -m each of them is wrong in turn.
sub compare {
    my ($where, $source, $said, $used) = @_;
    my $lines = printed($source);
    $tally{defined $lines ? 'check' : $source->{kind}} += @$said;
    if (!defined $lines) {
        $said{$source->{kind}}{$source->{command}} += @$said;
        return;
    }
    for my $i ($mutate ? 0 .. $#$said : ()) {
        my @wrong = @$said;
        $wrong[$i] =~ s/(\d)(?=\D*$)/($1 + 1) % 10/e;
        fault("$where: $wrong[$i] for $said->[$i] is not reported")
            if defined right(\@wrong, $lines, $used);
    }
    my $line = right($said, $lines, $used);
    fault("$where: `$source->{command}` does not print @$said") if !defined $line;
    $used->{$line} = 1 if $used && defined $line;
}

sub compare_text {
    my ($document, $entry) = @_;
    my $pattern = quotemeta $entry->{piece};
    my $matches = 0;
    $pattern =~ s/\\ /\\s+/g;
    $pattern =~ s/\\#/($number)/g;
    while ($document->{text} =~ /$pattern/g) {
        my @said;
        for (1 .. $#+) {
            push @said, substr($document->{text}, $-[$_], $+[$_] - $-[$_]);
            $document->{seen}{$-[$_]} = 1;
        }
        $matches++;
        compare("$document->{path}: $&", $_, \@said) for @{$entry->{sources}};
    }
    fault("$document->{path} has no \"$entry->{piece}\"") if !$matches;
}

# Tables with the same heading are taken in the order of the list.
sub compare_table {
    my ($document, $entry) = @_;
    my ($table) = grep { !$_->{done} && $_->{heading} eq $entry->{piece} } @{$document->{tables}};
    return fault("$document->{path} has no table $entry->{piece}") if !$table;
    my ($head, @rows) = @{$table->{rows}};
    my %left = map { my $at = $_; (grep { ($_->[$at] // '') =~ $number } @rows) ? ($at => 1) : () }
        1 .. $#$head;
    $table->{done} = 1;
    for my $source (sort { !$a->{columns} <=> !$b->{columns} } @{$entry->{sources}}) {
        my @columns = sort { $a <=> $b } keys %left;
        if ($source->{columns}) {
            my %named = map { $_ => 1 } @{$source->{columns}};
            @columns = grep { $named{$head->[$_]} } @columns;
            fault("$document->{path}: no such columns in $entry->{piece}: @{$source->{columns}}")
                if @columns < keys %named;
        }
        my %used;
        delete @left{@columns};
        for my $row (@rows) {
            my @said = map { ($row->[$_] // '') =~ /$number/g } @columns;
            compare("$document->{path}: $row->[0]", $source, \@said, \%used) if @said;
        }
    }
    fault("$document->{path}: columns without a command in $entry->{piece}")
        if %left;
}

# What no line of the list names.
sub find_left_out {
    my ($document) = @_;
    while ($document->{text} =~ /$number/g) {
        next if $document->{seen}{$-[0]};
        my $from = $-[0] > 40 ? $-[0] - 40 : 0;
        fault("$document->{path} has a number without a command: $& in \"..."
              . substr($document->{text}, $from, 80) . '..."');
    }
    for my $table (grep { !$_->{done} } @{$document->{tables}}) {
        fault("$document->{path} has a table without a command: $table->{heading}")
            if grep { my @cells = @$_; grep { /$number/ } @cells[1 .. $#cells] } @{$table->{rows}};
    }
}

# ---- all ----

my (%documents, @order);
my @entries = list("$root/tests/numbers.txt");
run_named(map { @{$_->{sources}} } @entries);
for my $entry (@entries) {
    my $file = $entry->{file};
    push @order, $file if !$documents{$file};
    $documents{$file} //= document("$root/$file");
    if ($entry->{piece} =~ /^\|/) { compare_table($documents{$file}, $entry) }
    else { compare_text($documents{$file}, $entry) }
}
find_left_out($documents{$_}) for @order;
my %why = (time => 'time', long => 'takes long', look => 'takes long, by eye',
           data => 'no real maps: make data', given => 'no measurement');
for my $kind (qw(time long look data given)) {
    printf "not checked: %s: %s (%d)\n", $why{$kind}, $_, $said{$kind}{$_}
        for sort keys %{$said{$kind} // {}};
}
printf "%d numbers are printed again, %d are times, %d of long commands, %d by eye, %d of real "
       . "maps, %d given; %d errors\n",
       map({ $tally{$_} // 0 } qw(check time long look data given)), $errors;
exit($errors != 0);
