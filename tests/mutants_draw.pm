# Finds all places of the implementation in envsamp.h where a small fault fits, and draws some.
#
# A site: { section, function, class, line, key, from, length, text, was, now }: `text` takes the
# place of `length` characters at `from`; lines stay where they are. `key` tells it from all others
# by what the source says there, not by numbers of lines: function, source line, line after the
# change. Classes: operator, constant, bound (off by one), statement (one that is missing).
#
# Not a site: comments, strings, preprocessor lines, declarations of types and the sizes of arrays,
# sizeof, assertions, prefetches, and a ++ or -- in the head of a loop, which only costs time.
package mutants_draw;
use strict;
use warnings;
use Digest::MD5 qw(md5_hex);

sub classes { qw(operator constant bound statement) }

my %flipped = qw(+ - - + * / / * % / & | | & ^ & << >> >> << && || || && == != != == < >= <= >
                 > <= >= < += -= -= += *= /= /= *= |= &= &= |= ^= |= <<= >>= >>= <<=
                 ++ -- -- ++);
my %shifted = qw(< <= <= < > >= >= >);
my $types   = 'void|char|short|int|long|float|double|signed|unsigned|const|static|inline|struct'
            . '|enum|size_t|u?int(?:8|16|32|64|ptr)_t|__m128';
my $skipped = 'sizeof|offsetof|ENVSAMP_ASSERT|ENVSAMP__PREFETCH|envsamp__prefetch'
            . '|__builtin_prefetch|__attribute__';

my $number  = qr/(?:0[xX][\da-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)[uUlLfF]*/;

# Tokens of the implementation: [kind, text, offset]; kinds: name, number, operator, section.
sub tokens {
    my ($text) = @_;
    my @tokens;

    my $at = index $text, "\n#if defined(ENVSAMP_IMPLEMENTATION)";
    my $end = rindex $text, '#endif /* ENVSAMP_IMPLEMENTATION */';
    die "mutants: no implementation in envsamp.h\n" if $at < 0 || $end < $at;
    # What only C++ sees is no site. A comment with a search tag begins a section.
    substr($text, $at, $end - $at) =~
        s/^#ifdef __cplusplus\n\K(.*?)(?=^#endif)/$1 =~ s,[^\n], ,gr/msge;
    pos($text) = $at + 1;
    while (pos($text) < $end) {
        my $from = pos $text;
        if ($text =~ /\G\s+/gc || $text =~ m{\G//[^\n]*}gc) {
            next;
        } elsif ($text =~ m{\G/\*(.*?)\*/}gcs) {
            my $comment = $1;
            push @tokens, ['section', $1, $from] if $comment =~ /\[search: \@([\w-]+)\]/;
        } elsif ($text =~ /\G(?<![^\n])#(?:[^\n\\]|\\.)*/gcs) {
            next;
        } elsif ($text =~ /\G[A-Za-z_]\w*/gc) {
            push @tokens, ['name', $&, $from];
        } elsif ($text =~ /\G$number/gc) {
            push @tokens, ['number', $&, $from];
        } elsif ($text =~ /\G(?:"(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*')/gcs) {
            push @tokens, ['string', $&, $from];
        } elsif ($text =~ /\G(?:<<=|>>=|->|\+\+|--|<<|>>|&&|\|\||[-+*\/%&|^<>=!]=|.)/gcs) {
            push @tokens, ['operator', $&, $from];
        }
    }
    return @tokens;
}

# Marks what tokens are: in a function's body or a table of constants, or in what is skipped; the
# start and end of statements; casts.
sub sites {
    my ($text) = @_;
    my @t = tokens($text);
    my (%type, @sites);

    $type{$1}++ while $text =~ /\}\s*(envsamp_\w+)\s*;/g;
    $type{$1}++ while $text =~ /^\s*typedef[^;{]*?\b(envsamp_\w+)\s*;/mg;
    $type{$1}++ while $text =~ /typedef\s+\w+\s*\(\*(envsamp_\w+)\)/g;
    my $is_type = sub { $_[0] =~ /^(?:$types)$/ || $type{$_[0]} };

    my ($section, $function, $called) = ('', '', '');
    my (@braces, @parens);                  # kinds of open braces; indexes of open parentheses
    my ($start, $declares, $valued, $head, $skip) = (undef, 0, 0, 0, 0);
    my $add = sub {
        my ($class, $from, $length, $new) = @_;
        push @sites, { section => $section, function => $function, class => $class, from => $from,
                       length => $length, text => $new };
    };
    my (%close, @open);                     # matching parentheses and brackets
    for my $i (0 .. $#t) {
        push @open, $i if $t[$i][1] =~ /^[(\[]$/ && $t[$i][0] eq 'operator';
        $close{pop @open} = $i if $t[$i][1] =~ /^[)\]]$/ && $t[$i][0] eq 'operator' && @open;
    }
    my (%cast, %ends_head);
    for my $i (keys %close) {
        next if $t[$i][1] ne '(';
        my @inner = map { $t[$_][1] } $i + 1 .. $close{$i} - 1;
        $cast{$close{$i}} = $cast{$i} = 1
            if @inner && !grep { !($_ eq '*' || $is_type->($_)) } @inner;
        $ends_head{$close{$i}} = $1 if $i && $t[$i - 1][1] =~ /^(if|for|while|switch)$/;
    }

    my $fresh = 0;                          # whether a statement may begin at the next token
    for (my $i = 0; $i < @t; $i++) {
        my ($kind, $token, $from) = @{ $t[$i] };
        my ($before, $after) = ($i ? $t[$i - 1] : ['', ''], $t[$i + 1] || ['', '']);
        my $code = grep { $_ eq 'body' } @braces;
        my $table = @braces && $braces[-1] eq 'values';
        if ($kind eq 'section') {
            $section = $token;
            next;
        }
        if ($token =~ /^(?:$skipped)$/ && $after->[1] eq '(') {
            $i = $close{$i + 1};            # no site within
            $fresh = 0;
            next;
        }
        if ($kind eq 'operator' && $token eq '{') {
            my $values = $before->[1] =~ /^[=,(\]]$/
                || ($before->[1] eq '{' && @braces && $braces[-1] eq 'values');
            push @braces, $values ? 'values' : $code ? 'block'
                : $before->[1] eq ')' ? 'body' : 'type';
            $function = $called if $braces[-1] eq 'body';
            $fresh = $braces[-1] =~ /^(?:body|block)$/ if $braces[-1] ne 'values';
            next;
        }
        if ($kind eq 'operator' && $token eq '}') {
            my $was = pop @braces // '';
            $fresh = 1 if $was eq 'block';
            if ($was eq 'body') {
                $function = '';
                $fresh = $declares = 0;
            }
            next;
        }
        if (!$code && !@braces) {           # between functions
            $called = $token if $kind eq 'name' && $after->[1] eq '(';
            if ($kind eq 'name' && $after->[1] eq '[') {
                $function = $token;         # a table of constants
                $i = $close{$i + 1};
            }
            next;
        }
        next if (!$code && !$table) || $function eq 'envsamp__prefetch';

        # ---- statements ----
        if ($code && $fresh && $kind eq 'name' && $token =~ /^(?:case|default)$/) {
            $i++ while $t[$i][1] ne ':';
            next;
        }
        if ($code && $fresh) {
            $fresh = 0;
            next if $token =~ /^(?:else|do)$/ and $fresh = 1;
            if ($token !~ /^(?:if|for|while|switch|;)$/) {
                my ($end, $depth) = ($i, 0);
                $declares = $is_type->($token) || ($kind eq 'name' && $after->[0] eq 'name'
                                                   && $token !~ /^(?:return|goto)$/);
                $valued = 0;
                while ($t[$end][1] ne ';' || $depth) {
                    $depth++ if $t[$end][1] =~ /^[({\[]$/;
                    $depth-- if $t[$end][1] =~ /^[)}\]]$/;
                    $end++;
                }
                my $voids = $token eq '(' && $after->[1] eq 'void';
                my $last = $token eq 'return' && ($t[$end + 1][1] // '') eq '}' && @braces == 1;
                if (!$declares && !$voids && !$last) {
                    my $length = $t[$end][2] + 1 - $from;
                    my $lines = substr($text, $from, $length) =~ tr/\n//;
                    $add->('statement', $from, $length, ';' . "\n" x $lines);
                }
            } else {
                $declares = 0;
            }
        }
        if ($token eq ';' && !@parens) {
            $fresh = $code;
            $declares = 0;
            next;
        }
        if ($token eq '(') {
            push @parens, $i;
            $head = 1 if $before->[1] eq 'for';
        } elsif ($token eq ')') {
            my $opened = pop @parens;
            $head = 0 if ($ends_head{$i} // '') eq 'for';
            $fresh = 1 if $ends_head{$i} && !@parens;
        }

        # ---- declarators: sizes of arrays and pointers are no sites ----
        if ($declares && !@parens) {
            $valued = 1 if $token eq '=';
            $valued = 0 if $token eq ',' && !$table;
            if (!$valued) {
                $i = $close{$i} if $token eq '[';
                next;
            }
        }

        # ---- constants ----
        if ($kind eq 'number') {
            if ($token =~ /^(?:0[xX][\da-fA-F]+|\d+)([uUlL]*)$/) {
                my $suffix = $1;
                if ($token =~ /^0[xX]/) {
                    $add->('constant', $from, length $token, "($token + 1)");
                } else {
                    my ($n) = $token =~ /^(\d+)/;
                    $add->('constant', $from, length $token, $n + 1 . $suffix);
                    $add->('constant', $from, length $token, $n - 1 . $suffix) if $n > 0;
                }
            } elsif ($token =~ /^0*\.?0*f?$/) {
                $add->('constant', $from, length $token, $token =~ /f/ ? '1.0f' : '1.0');
            } else {
                $add->('constant', $from, length $token, "(2 * $token)");
                $add->('constant', $from, length $token, $token =~ /f/ ? '0.0f' : '0.0')
                    if $token =~ /^1\.0*f?$/;
            }
            next;
        }
        next if $kind ne 'operator';

        # ---- subscripts ----
        if ($token eq '[' && !($close{$i} == $i + 2 && $t[$i + 1][0] eq 'number')) {
            my $to = $t[$close{$i}][2];
            $add->('bound', $to, 1, ' + 1]');
            $add->('bound', $to, 1, ' - 1]');
        }

        # ---- operators ----
        my $operand =
            $before->[0] =~ /^(?:name|number)$/ && $before->[1] !~ /^(?:return|case|else)$/
            || $before->[1] =~ /^[)\]]$/ && !$cast{$i - 1};
        if ($token =~ /^[-+*&]$/ && !$operand) {
            $add->('operator', $from, 1, ' ') if $token eq '-';
            next;
        }
        next if $token eq '*' && $is_type->($before->[1]);
        if ($token eq '!') {
            $add->('operator', $from, 1, ' ');
            next;
        }
        next if $token =~ /^(?:\+\+|--)$/ && $head;
        $add->('operator', $from, length $token, $flipped{$token}) if $flipped{$token};
        $add->('bound', $from, length $token, $shifted{$token}) if $shifted{$token};
    }
    die "mutants: braces of envsamp.h do not match\n" if @braces;

    # ---- what the source says there ----
    my (%seen, @starts);
    push @starts, pos $text while $text =~ /^/mg;
    for my $site (@sites) {
        my ($low, $high) = (0, $#starts);
        while ($low < $high) {
            my $middle = int(($low + $high + 1) / 2);
            ($low, $high) = ($middle, $high), next if $starts[$middle] <= $site->{from};
            $high = $middle - 1;
        }
        $site->{line} = $low + 1;
        my $begin = $starts[$low];
        my $end = index $text, "\n", $site->{from} + $site->{length} - 1;
        my $now = substr $text, $begin, $end - $begin;
        $site->{was} = squeeze($now);
        substr($now, $site->{from} - $begin, $site->{length}) = $site->{text};
        $site->{now} = squeeze($now);
        my @what = @$site{qw(function was now)};
        $site->{key} = key(@what, ++$seen{ key(@what, 1) });
    }
    return @sites;
}

# The key of a change of a line of a function, or of the nth of such lines.
sub key {
    my ($function, $was, $now, $nth) = @_;

    return $function . ($nth > 1 ? " #$nth" : '') . ": $was -> $now";
}

sub squeeze {
    my ($line) = @_;

    $line =~ s{/\*.*?(?:\*/|$)}{}gs;
    $line =~ s/\s+/ /g;
    $line =~ s/^ | $//g;
    return $line;
}

# Sites of each section in the order in which they are drawn: classes by turns, and within a class
# by a hash of seed and key, so that an edit elsewhere leaves the rest of a draw as it was. Returns
# ({ section => [sites] }, { section => how many of `count` }), shares by numbers of sites.
sub draw {
    my ($seed, $count, @sites) = @_;
    my (%queue, %quota, %sum);

    for my $site (@sites) {
        $site->{rank} = md5_hex("$seed $site->{key}");
        push @{ $sum{$site->{section}}{$site->{class}} }, $site;
    }
    my $total = @sites or return ({}, {});
    my %rest;
    for my $section (keys %sum) {
        my @lists = map {
            [sort { $a->{rank} cmp $b->{rank} } @{ $sum{$section}{$_} || [] }]
        } classes();
        my $size = 0;
        $size += @$_ for @lists;
        my (%taken, @order);
        while (grep { @$_ } @lists) {
            for (@lists) {
                shift @$_ while @$_ && $taken{$_->[0]{from}};   # one mutant a place
                next if !@$_;
                push @order, shift @$_;
                $taken{$order[-1]{from}} = 1;
            }
        }
        $queue{$section} = \@order;
        $quota{$section} = int($count * $size / $total);
        $rest{$section} = $count * $size / $total - $quota{$section};
    }
    my $left = $count;
    $left -= $_ for values %quota;
    $quota{$_}++ for (sort { $rest{$b} <=> $rest{$a} || $a cmp $b } keys %rest)[0 .. $left - 1];
    return (\%queue, \%quota);
}

1;
