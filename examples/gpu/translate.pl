#!/usr/bin/perl
# translate.pl: makes HLSL or WGSL of envsamp.glsl, or of check.glsl.
#
#     perl translate.pl hlsl < envsamp.glsl > envsamp.hlsl
#     perl translate.pl wgsl < envsamp.glsl > envsamp.wgsl
#
# It is no compiler: it knows the plain style of these two files. A function begins in column 0, a
# statement on its own line, and ends with a semicolon at the end of one; choices (? :) are whole
# right sides; parameters are not assigned to; braces are never left out. What lies above the line
# "translated from here on" is replaced by HEADS below.
use strict;
use warnings;

my %wgsl = (uint => 'u32', float => 'f32', bool => 'bool', vec2 => 'vec2f', vec3 => 'vec3f',
            vec4 => 'vec4f', uvec2 => 'vec2u', uvec3 => 'vec3u', uvec4 => 'vec4u');
my %hlsl = (vec2 => 'float2', vec3 => 'float3', vec4 => 'float4', uvec2 => 'uint2',
            uvec3 => 'uint3', uvec4 => 'uint4');

my %heads;
$heads{'envsamp.glsl'}{hlsl} = <<'END';
/* envsamp.hlsl: directions and densities from a table of envsamp.h, in a shader. Made of
 * envsamp.glsl, which says how to use it, by translate.pl: change that.
 *
 *     #include "envsamp.hlsl"
 *
 *     envsamp_sample s = envsamp_kd_sample(u0, u1);           // s.dir, s.pdf per steradian
 *     float pdf = envsamp_kd_pdf(bsdf_dir);
 *
 * The table is a StructuredBuffer<uint> at ENVSAMP_REGISTER, default t0. Words elsewhere:
 *
 *     #define ENVSAMP_WORD(at) table.Load(4u * (at))          // ByteAddressBuffer
 *     #define ENVSAMP_WORD(at) table[at]                      // Buffer<uint>
 *     #define ENVSAMP_WORD(at) table[(at) >> 2u][(at) & 3u]   // uint4 table[], in a cbuffer
 */
#ifndef ENVSAMP_REGISTER
#define ENVSAMP_REGISTER t0
#endif
#ifndef ENVSAMP_WORD
StructuredBuffer<uint> envsamp_words : register(ENVSAMP_REGISTER);
#define ENVSAMP_WORD(at) envsamp_words[at]
#endif
#ifndef ENVSAMP_CDF_WORD
#define ENVSAMP_CDF_WORD(at) ENVSAMP_WORD(at)
#endif
#ifndef ENVSAMP_MAPPING
#define ENVSAMP_MAPPING 3u              /* as the table says */
#endif

uint envsamp_word(uint at)
{
    return ENVSAMP_WORD(at);
}

uint envsamp_cdf_word(uint at)
{
    return ENVSAMP_CDF_WORD(at);
}
END
$heads{'envsamp.glsl'}{wgsl} = <<'END';
/* envsamp.wgsl: directions and densities from a table of envsamp.h, in a shader. Made of
 * envsamp.glsl, which says how to use it, by translate.pl: change that.
 *
 *     let s = envsamp_kd_sample(u0, u1);                      // s.dir, s.pdf per steradian
 *     let pdf = envsamp_kd_pdf(bsdf_dir);
 *
 * Join it with your own text. Change the four declarations that follow to read the words elsewhere,
 * as from a uniform buffer of vec4u, to have kd and cdf both, or to build for one mapping: 0, 1, 2.
 * WGSL has no `precise`: what a compiler contracts moves a point at an edge into the next block.
 */
@group(0) @binding(0) var<storage, read> envsamp_words: array<u32>;

const ENVSAMP_MAPPING: u32 = 3u;        /* as the table says */

fn envsamp_word(at: u32) -> u32 {
    return envsamp_words[at];
}

fn envsamp_cdf_word(at: u32) -> u32 {
    return envsamp_words[at];
}
END
$heads{'check.glsl'}{hlsl} = <<'END';
StructuredBuffer<float> check_directions : register(t1);
RWStructuredBuffer<uint> check_results : register(u2);
StructuredBuffer<uint> check_settings : register(t3);

void check_point(uint i);

[numthreads(64, 1, 1)]
void main(uint3 id : SV_DispatchThreadID)
{
    if (id.x < check_settings[1]) {
        check_point(id.x);
    }
}
END
$heads{'check.glsl'}{wgsl} = <<'END';
@group(0) @binding(1) var<storage, read> check_directions: array<f32>;
@group(0) @binding(2) var<storage, read_write> check_results: array<u32>;
@group(0) @binding(3) var<storage, read> check_settings: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (id.x < check_settings[1]) {
        check_point(id.x);
    }
}
END

# ---- HLSL: other names, and functions in place of constructors ----

sub make_function
{
    my ($name, $fields) = @_;
    my @fields = $fields =~ /(\w+ \w+);/g;
    my $text = "$name ${name}_of(" . join(', ', @fields) . ")\n{\n    $name made;\n\n";

    $text .= "    made.$_ = $_;\n" for map { (split ' ')[1] } @fields;
    return "$text    return made;\n}\n";
}

sub to_hlsl
{
    my ($text) = @_;
    my @structs = $text =~ /^struct (\w+)/mg;

    $text =~ s/^(struct (\w+) \{\n(.*?)\};\n)/$1 . "\n" . make_function($2, $3)/smge;
    $text =~ s/\b$_\(/${_}_of(/g for @structs, 'envsamp_sample';
    $text =~ s/\b(u?vec[234])\b/$hlsl{$1}/g;
    $text =~ s/\bfloatBitsToUint\b/asuint/g;
    $text =~ s/\buintBitsToFloat\b/asfloat/g;
    $text =~ s/\bENVSAMP_PRECISE\b/precise/g;
    $text =~ s/^const /static const /mg;
    return $text;
}

# ---- WGSL: types behind names, select for choices ----

sub wgsl_type { return $wgsl{$_[0]} // $_[0] }

sub wgsl_parameters
{
    return join ', ', map { /(\w+)\s+(\w+)/ ? "$2: " . wgsl_type($1) : () } split /,/, $_[0];
}

# One function: its declarations, variables where they are assigned to again, and its choices.
sub wgsl_body
{
    my ($body) = @_;

    $body =~ s/^(\s+)(?:ENVSAMP_PRECISE )?([a-z]\w*) (\w+)( =|;)/
               my ($space, $type, $name, $end) = ($1, $2, $3, $4);
               my $count = () = $body =~ m{(?<![\w.])$name(?:\.\w+)*\s=\s}g;
               $type eq 'return' ? "$space$type $name$end"
               : "$space" . ($count > 1 ? 'var' : 'let') . " $name: " . wgsl_type($type) . $end/mge;
    $body =~ s/(= |return )([^;?]+?) \? ([^;?]+?) : ([^;?]+);/$1select($4, $3, $2);/g;
    return $body;
}

sub to_wgsl
{
    my ($text) = @_;

    $text =~ s/^const (\w+) (\w+) =/"const $2: " . wgsl_type($1) . ' ='/mge;
    $text =~ s/^struct (\w+) \{\n(.*?)\};\n/
               my ($name, $fields) = ($1, $2);
               $fields =~ s{(\w+) (\w+);}{"$2: " . wgsl_type($1) . ','}ge;
               "struct $name {\n$fields}\n"/smge;
    $text =~ s/^(\w+) (\w+)\(([^)]*)\)\n\{\n(.*?)^\}\n/
               my ($type, $name, $parameters, $body) = ($1, $2, $3, $4);
               "fn $name(" . wgsl_parameters($parameters) . ')'
               . ($type eq 'void' ? '' : ' -> ' . wgsl_type($type))
               . " {\n" . wgsl_body($body) . "}\n"/smge;
    $text =~ s/\bfloatBitsToUint\(/bitcast<u32>(/g;
    $text =~ s/\buintBitsToFloat\(/bitcast<f32>(/g;
    $text =~ s/\b(uint|float|u?vec[234])\(/$wgsl{$1}(/g;
    return $text;
}

my $language = $ARGV[0] // '';
die "usage: translate.pl hlsl|wgsl < FILE\n" unless $language =~ /^(hlsl|wgsl)$/;
undef $/;
my ($head, $text) = split m{/\* ---- translated from here on ---- \*/\n}, <STDIN>;
my ($name) = $head =~ m{^/\* (\w+\.glsl)};
die "translate.pl: no file of examples/gpu\n" unless $text && $heads{$name // ''};
print $heads{$name}{$language}, $language eq 'hlsl' ? to_hlsl($text) : to_wgsl($text);
