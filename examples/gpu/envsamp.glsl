/* envsamp.glsl: directions and densities from a table of envsamp.h, in a shader. The table is the
 * one that the CPU built, uploaded as it is. GLSL 4.3 or ES 3.1; copy it into your engine.
 *
 *     #version 430
 *     #include "envsamp.glsl"                    // or its text, as a second string
 *
 *     envsamp_sample s = envsamp_kd_sample(u0, u1);           // s.dir, s.pdf per steradian
 *     float pdf = envsamp_kd_pdf(bsdf_dir);
 *     envsamp_sample t = envsamp_kd_sample_facing(normal, u0, u1);
 *     float pdf_t = envsamp_kd_pdf_facing(normal, bsdf_dir);
 *     envsamp_sample c = envsamp_cdf_sample(u0, u1);          // of a table of envsamp_cdf
 *     float pdf_c = envsamp_cdf_pdf(bsdf_dir);
 *
 * Upload envsamp_kd_bytes(kd) bytes from kd, of a cdf envsamp_cdf_bytes, into a storage buffer at
 * ENVSAMP_BINDING, default 0. The CPU must be little-endian. Open a table from a file with
 * envsamp_kd_open or envsamp_cdf_open first. Directions are in the map's space, as in envsamp.h. In
 * ES, put `precision highp float; precision highp int;` before this file.
 *
 * To read words from elsewhere, define ENVSAMP_WORD before this file; it then declares no buffer.
 *
 *     #define ENVSAMP_WORD(at) texelFetch(table, int(at)).r           // usamplerBuffer
 *     #define ENVSAMP_WORD(at) table[(at) >> 2u][(at) & 3u]           // uvec4 table[], uniform
 *     #define ENVSAMP_WORD(at) words[table_at + (at)]                 // one of several tables
 *
 * and ENVSAMP_CDF_WORD(at) where kd and cdf are in use both. ENVSAMP_MAPPING as 0u, 1u or 2u, as in
 * envsamp_mapping, leaves the code of the others out; envsamp_kd_problem says whether it is that of
 * the table.
 *
 * The result is that of the C code: @kd-table, @kd-sampling and @cdf in envsamp.h say how it works.
 * Blocks of WARP, ALIAS and cdf are chosen by integers and exact products: the same everywhere.
 * Those of densities and of light x cosine depend on quotients and roots, which a GPU may round
 * otherwise, and those of FIT on a power: there a point at the very edge of a block can fall into
 * the next one, and within a tiny block a direction move. "make gpu" shows how often.
 * envsamp.hlsl and envsamp.wgsl are made from this file by translate.pl.
 */
#ifndef ENVSAMP_BINDING
#define ENVSAMP_BINDING 0
#endif
#ifndef ENVSAMP_WORD
layout(std430, binding = ENVSAMP_BINDING) readonly buffer envsamp_table { uint envsamp_words[]; };
#define ENVSAMP_WORD(at) envsamp_words[at]
#endif
#ifndef ENVSAMP_CDF_WORD
#define ENVSAMP_CDF_WORD(at) ENVSAMP_WORD(at)
#endif
#ifndef ENVSAMP_MAPPING
#define ENVSAMP_MAPPING 3u              /* as the table says */
#endif
#ifdef ENVSAMP_PRECISE
#elif !defined(GL_ES) || __VERSION__ >= 320
#define ENVSAMP_PRECISE precise         /* not contracted: the same bits as in C */
#else
#define ENVSAMP_PRECISE                 /* or precise, with extension GL_EXT_gpu_shader5 */
#endif

uint envsamp_word(uint at)
{
    return ENVSAMP_WORD(at);
}

uint envsamp_cdf_word(uint at)
{
    return ENVSAMP_CDF_WORD(at);
}

/* ---- translated from here on ---- */

const uint ENVSAMP_OCTAHEDRAL = 2u;
const uint ENVSAMP_HEMISPHERE = 1u;
const uint ENVSAMP_ALIAS = 1u;
const uint ENVSAMP_FIT = 2u;
const uint ENVSAMP_INNER = 0x80000000u;         /* of a link: not a density */
const uint ENVSAMP_SIZE = 0x7fffffffu;          /* bits of a float without its sign */
const float ENVSAMP_UNIT = 16777216.0;          /* 2^24 */
const float ENVSAMP_TINY = 1.17549435e-38;      /* the least normal float, */
const float ENVSAMP_MOST = 3.40282346e+38;      /* and the largest */

/* dir: unit. pdf: per steradian. uv: where in the map. block: what was drawn, as the place of its
   density in words; of cdf, of its texel's edge. */
struct envsamp_sample {
    vec3 dir;
    float pdf;
    vec2 uv;
    uint block;
};

/* Azimuth in turns, 1 - cos theta, 1 + cos theta; of octahedral maps u and v. */
struct envsamp_point {
    float x;
    float north;
    float south;
};

/* A block, and where in it a sample lies, [0, 1]. */
struct envsamp_choice {
    uint block;
    float fx;
    float fy;
};

/* ---- small math ---- */

float envsamp_sign(float size, uint negative)
{
    return uintBitsToFloat((floatBitsToUint(size) & ENVSAMP_SIZE) | (negative << 31u));
}

float envsamp_copy_sign(float size, float other)
{
    return envsamp_sign(size, floatBitsToUint(other) >> 31u);
}

/* |x|, but no more than `most`: that for a NaN. */
float envsamp_at_most(float x, float most)
{
    return uintBitsToFloat(min(floatBitsToUint(x) & ENVSAMP_SIZE, floatBitsToUint(most)));
}

/* To [0, 1), whatever it is. */
float envsamp_clamp_unit(float u)
{
    return uintBitsToFloat(min(floatBitsToUint(u) & ENVSAMP_SIZE, 0x3f7fffffu));
}

/* To [0, 1]; negative numbers and NaN count as 0. */
float envsamp_saturate(float x)
{
    uint bits = floatBitsToUint(x);
    uint most = min(bits, 0x3f800000u);

    return bits <= 0x7f800000u ? uintBitsToFloat(most) : 0.0;
}

/* 0 for -0; a compiler may drop an added 0. */
float envsamp_plus_zero(float x)
{
    return floatBitsToUint(x) == ENVSAMP_INNER ? 0.0 : x;
}

/* The next float below a number above 0. */
float envsamp_below(float x)
{
    return uintBitsToFloat(floatBitsToUint(x) - 1u);
}

float envsamp_power_of_2(uint exponent)
{
    return uintBitsToFloat((exponent + 127u) << 23u);
}

uint envsamp_index(float x, uint count)
{
    return min(uint(max(x, 0.0)), count - 1u);
}

/* 1 for positive numbers and 0, 0 for negative ones and -0. */
float envsamp_positive(float t)
{
    return 0.5 + envsamp_copy_sign(0.5, t);
}

/* The quotients and roots that blocks depend on, but for those of FIT. */
float envsamp_quotient(float a, float b)
{
    return a / b;
}

float envsamp_root(float square)
{
    return sqrt(square);
}

/* Cosine and sine of u turns. */
vec2 envsamp_cos_sin_turn(float u)
{
    ENVSAMP_PRECISE float h = u - 0.5;
    ENVSAMP_PRECISE float t = h * h;
    ENVSAMP_PRECISE float t2 = t * t;
    ENVSAMP_PRECISE float s = h * (3.14159258 - t * 5.16770690 + t2 * (2.55003164 - t * 0.598046450
                                 + t2 * 0.0772222480));
    ENVSAMP_PRECISE float c = (1.0 - 4.0 * t) * (0.999999945 - t * 0.934791803 + t2 * (0.319215031
                                 - t * 0.0548052368));
    ENVSAMP_PRECISE float cosine = s * s - c * c;
    ENVSAMP_PRECISE float sine = -2.0 * s * c;

    return vec2(cosine, sine);
}

/* Arc tangent of t in turns, 0 <= t <= 1. */
float envsamp_octant_turn(float t)
{
    ENVSAMP_PRECISE float s = t * t;
    ENVSAMP_PRECISE float turn = t * (0.159154941 + s * (-0.0530512667 + s * (0.0318199339
            + s * (-0.0226113556 + s * (0.0169574464 + s * (-0.0119902194
            + s * (0.00684993014 + s * (-0.00259152250 + s * 0.000462115071))))))));

    return turn;
}

/* Angle of (x, y) in turns, [0, 1]. */
float envsamp_turn(float y, float x)
{
    float ax = abs(x);
    float ay = abs(y);
    float big = max(ax, ay);
    float ratio = envsamp_quotient(min(ax, ay), max(big, ENVSAMP_TINY));
    float turn = envsamp_octant_turn(ratio);

    if (ay > ax) {
        turn = 0.25 - turn;
    }
    if (x < 0.0) {
        turn = 0.5 - turn;
    }
    return y < 0.0 ? 1.0 - turn : turn;
}

/* Polar angle over pi from 1 - cos and 1 + cos of it. */
float envsamp_polar_fraction(float north, float south)
{
    float t = abs(min(north, south));
    float q = sqrt(t);
    ENVSAMP_PRECISE float t2 = t * t;
    ENVSAMP_PRECISE float low = 0.450158207 + t * 0.0375087059 + t2 * (0.00850684985
                                   + t * 0.00214716597);
    ENVSAMP_PRECISE float v = q * (low + t2 * t2 * (0.00178524512 - t * 0.000837066695
                                   + t2 * 0.000730843713));

    return 0.5 - envsamp_copy_sign(0.5 - v, south - north);
}

/* Sine of t quarter turns, 0 <= t <= 1. */
float envsamp_sin_quarter(float t)
{
    ENVSAMP_PRECISE float s = t * t;
    ENVSAMP_PRECISE float s2 = s * s;
    ENVSAMP_PRECISE float sine = t * ((1.57079625 - s * 0.645963371)
                                    + s2 * (0.0796884820 - s * 0.00467222789
                                    + s2 * 0.000150820561));

    return sine;
}

vec3 envsamp_octahedral_dir(float u, float v)
{
    float a = 2.0 * u - 1.0;
    float b = 2.0 * v - 1.0;
    float rest_a = 1.0 - abs(a);
    float rest_b = 1.0 - abs(b);
    float p = min(abs(a), rest_b);
    float q = min(abs(b), rest_a);
    float r = p + q;
    float inverse = 1.0 / (r + ENVSAMP_TINY);
    ENVSAMP_PRECISE float s = r * r;
    ENVSAMP_PRECISE float s2 = s * s;
    ENVSAMP_PRECISE float ring = r * ((1.41421378 - s * 0.353563577)
                                    - s2 * (0.0440602601 + s * 0.0118305748)
                                    - s2 * s2 * ((0.00107195461 + s * 0.00519226724)
                                               - s2 * (0.00310698547 - s * 0.00160211383)));

    return vec3(envsamp_copy_sign(ring * envsamp_sin_quarter(p * inverse), a),
                envsamp_copy_sign(ring * envsamp_sin_quarter(q * inverse), b),
                envsamp_copy_sign(1.0 - s, rest_b - abs(a)));
}

/* u and v in a direction of any length; r is |(x, y)|. */
vec2 envsamp_octahedral_uv(vec3 dir, float r)
{
    vec3 size = abs(dir);
    float across = envsamp_quotient(min(size.x, size.y), max(size.x, size.y) + ENVSAMP_TINY);
    float down = envsamp_quotient(min(r, size.z), max(r, size.z) + ENVSAMP_TINY);
    float turn = min(4.0 * envsamp_octant_turn(down), 0.5);
    float w = abs(1.0 - envsamp_positive(size.z - r) - turn);
    float s = w * w;
    ENVSAMP_PRECISE float p = w * ((0.555360375 - s * 0.0570955985)
                                 + s * s * (0.00176060538 - s * 2.53690523e-05));
    float q = min(4.0 * envsamp_octant_turn(across), 0.5);

    w = min(p, 0.5);
    q = w * abs(envsamp_positive(size.y - size.x) - q);
    s = envsamp_positive(envsamp_plus_zero(dir.z));
    p = abs(s * w - q);
    q = w - p;
    return vec2(abs(envsamp_positive(dir.x) - abs(0.5 * s - p)),
                abs(envsamp_positive(dir.y) - abs(0.5 * s - q)));
}

/* ---- points of a block ---- */

/* 1 - cos theta and 1 + cos theta of an edge as a table stores it. */
vec2 envsamp_edge_pair(uint edge)
{
    float cap = uintBitsToFloat(edge & ENVSAMP_SIZE);
    float rest = 2.0 - cap;
    bool south = edge >= ENVSAMP_INNER;

    return south ? vec2(rest, cap) : vec2(cap, rest);
}

/* edge: x0, x1, y0, y1 as stored. */
envsamp_point envsamp_between(uvec4 edge, float fx, float fy)
{
    vec2 top = envsamp_edge_pair(edge.z);
    vec2 end = envsamp_edge_pair(edge.w);
    float x0 = uintBitsToFloat(edge.x);
    ENVSAMP_PRECISE float x = x0 + fx * (uintBitsToFloat(edge.y) - x0);
    ENVSAMP_PRECISE float north = top.x + fy * (end.x - top.x);
    ENVSAMP_PRECISE float south = top.y + fy * (end.y - top.y);

    return envsamp_point(x, north, south);
}

uint envsamp_mapping(uint stored)
{
    return ENVSAMP_MAPPING < 3u ? ENVSAMP_MAPPING : stored;
}

envsamp_sample envsamp_point_sample(uint mapping, envsamp_point p, float pdf, uint block)
{
    float x = envsamp_clamp_unit(p.x);
    vec2 uv = vec2(x, p.north);
    vec2 around = envsamp_cos_sin_turn(x);
    float sine = sqrt(abs(p.north * p.south));
    vec3 dir = vec3(around.x * sine, around.y * sine, 0.5 * (p.south - p.north));

    if (mapping == ENVSAMP_OCTAHEDRAL) {
        dir = envsamp_octahedral_dir(x, p.north);
    } else {
        uv.y = envsamp_polar_fraction(p.north, p.south);
        if (mapping == ENVSAMP_HEMISPHERE) {
            uv.y = min(2.0 * uv.y, 1.0);
        }
    }
    return envsamp_sample(dir, pdf, uv, block);
}

/* ---- directions in coordinates of density ---- */

/* Azimuth in [0, 4] and polar in [0, 2], and 1 in z for a direction, 0 for none. */
vec3 envsamp_grid_coords(uint mapping, vec3 dir, float r)
{
    float side = abs(dir.x) + abs(dir.y);
    float sum = r + abs(dir.z);
    bool valid = floatBitsToUint(side) < 0x7f800000u && floatBitsToUint(sum) - 1u < 0x7f7fffffu;
    float t = envsamp_quotient(abs(dir.y), max(side, ENVSAMP_TINY));
    float q = envsamp_quotient(r, max(sum, ENVSAMP_TINY));

    if (!valid) {
        return vec3(0.0, 0.0, 0.0);
    }
    if (mapping == ENVSAMP_OCTAHEDRAL) {
        vec3 plain = vec3(envsamp_plus_zero(dir.x), envsamp_plus_zero(dir.y), dir.z);
        vec2 uv = envsamp_octahedral_uv(plain, r);

        return vec3(4.0 * uv.x, 2.0 * uv.y, 1.0);
    }
    t = 2.0 - envsamp_copy_sign(1.0 + envsamp_copy_sign(1.0, dir.x)
                                - envsamp_copy_sign(t, dir.x), dir.y);
    q = 1.0 - envsamp_copy_sign(1.0 - q, dir.z);
    if (!(side > 0.0)) {
        t = 0.0;
    }
    if (mapping == ENVSAMP_HEMISPHERE && q > 1.0) {
        return vec3(0.0, 0.0, 0.0);
    }
    return vec3(t, q, 1.0);
}

/* |(x, y)| */
float envsamp_ring(vec3 dir)
{
    ENVSAMP_PRECISE float square = dir.x * dir.x + dir.y * dir.y;

    return envsamp_root(square);
}

/* ---- kd: header, in words ---- */

const uint ENVSAMP_KD_MAGIC = 0x444b5345u;
const uint ENVSAMP_KD_VERSION = 6u;
const uint ENVSAMP_KD_SELECT = 6u;
const uint ENVSAMP_KD_TILE_BITS = 7u;           /* x, then y */
const uint ENVSAMP_KD_ALIAS_SHIFT = 9u;
const uint ENVSAMP_KD_ALIAS_AT = 10u;
const uint ENVSAMP_KD_GRID = 11u;               /* bits of x, of y, place */
const uint ENVSAMP_KD_MODEL = 14u;
const uint ENVSAMP_KD_FIT_ALPHA = 15u;
const uint ENVSAMP_KD_FIT_END = 16u;
const uint ENVSAMP_KD_FIT_TOTAL = 26u;          /* a double */
const uint ENVSAMP_KD_FACING_COUNT = 42u;
const uint ENVSAMP_KD_FACING_AT = 43u;
const uint ENVSAMP_KD_RECORDS = 48u;

/* What keeps this shader from sampling the table: 0 nothing, 1 no table of envsamp_kd, 2 another
   version, 3 another mapping than it is built for, 4 FIT with POWER, which it has no code for. */
uint envsamp_kd_problem()
{
    uint mapping = envsamp_word(3u);

    if (envsamp_word(0u) != ENVSAMP_KD_MAGIC) {
        return 1u;
    }
    if (envsamp_word(1u) != ENVSAMP_KD_VERSION) {
        return 2u;
    }
    if (mapping != envsamp_mapping(mapping)) {
        return 3u;
    }
    if (envsamp_word(ENVSAMP_KD_SELECT) == ENVSAMP_FIT && envsamp_word(ENVSAMP_KD_MODEL) != 0u) {
        return 4u;
    }
    return 0u;
}

uvec4 envsamp_edges(uint at)
{
    return uvec4(envsamp_word(at), envsamp_word(at + 1u), envsamp_word(at + 2u),
                 envsamp_word(at + 3u));
}

/* ---- kd: WARP ---- */

/* A region on the way down: edges x0, x1, y0, y1 in its tile's unit square and in the map, its
   link, and the word that has it. */
struct envsamp_region {
    vec4 cut;
    uvec4 edge;
    uint link;
    uint place;
};

/* The side of its next cut that f is on. */
envsamp_region envsamp_take_side(envsamp_region r, vec2 f)
{
    envsamp_region side = r;
    uint at = r.link & ENVSAMP_SIZE;
    uint bits = envsamp_word(at);
    uint edge = envsamp_word(at + 1u);
    float cut = uintBitsToFloat(bits & ENVSAMP_SIZE);
    bool down = bits >= ENVSAMP_INNER;
    float number = down ? f.y : f.x;
    bool high = number >= cut;

    if (down) {
        side.cut.z = high ? cut : r.cut.z;
        side.cut.w = high ? r.cut.w : cut;
        side.edge.z = high ? edge : r.edge.z;
        side.edge.w = high ? r.edge.w : edge;
    } else {
        side.cut.x = high ? cut : r.cut.x;
        side.cut.y = high ? r.cut.y : cut;
        side.edge.x = high ? edge : r.edge.x;
        side.edge.y = high ? r.edge.y : edge;
    }
    side.place = high ? at + 3u : at + 2u;
    side.link = envsamp_word(side.place);
    return side;
}

envsamp_sample envsamp_warp_sample(float u0, float u1)
{
    uint bits_x = envsamp_word(ENVSAMP_KD_TILE_BITS);
    uint bits_y = envsamp_word(ENVSAMP_KD_TILE_BITS + 1u);
    float across = u0 * envsamp_power_of_2(bits_x);
    float down = u1 * envsamp_power_of_2(bits_y);
    uint column = uint(across);
    uint row = uint(down);
    vec2 f = vec2(across - float(column), down - float(row));
    uint at = ENVSAMP_KD_RECORDS + 5u * ((row << bits_x) + column);
    envsamp_region r = envsamp_region(vec4(0.0, 1.0, 0.0, 1.0), envsamp_edges(at),
                                      envsamp_word(at + 4u), at + 4u);

    while (r.link >= ENVSAMP_INNER) {
        r = envsamp_take_side(r, f);
    }
    float fx = (f.x - r.cut.x) / (r.cut.y - r.cut.x);
    float fy = (f.y - r.cut.z) / (r.cut.w - r.cut.z);
    envsamp_point p = envsamp_between(r.edge, fx, fy);

    return envsamp_point_sample(envsamp_mapping(envsamp_word(3u)), p, uintBitsToFloat(r.link),
                                r.place);
}

/* ---- kd: ALIAS and FIT ---- */

envsamp_choice envsamp_alias_choose(float u0, float u1)
{
    uint shift = envsamp_word(ENVSAMP_KD_ALIAS_SHIFT);
    uint bits_x = 12u - (shift >> 1u);
    float across = u0 * envsamp_power_of_2(bits_x);
    uint column = uint(across);
    uint y = uint(u1 * ENVSAMP_UNIT);
    uint bin = ((y >> shift) & (0xffffffffu << bits_x)) | column;
    uint entry = envsamp_word((envsamp_word(ENVSAMP_KD_ALIAS_AT) >> 2u) + bin);
    uint block = entry & (0xffffffu >> shift);
    uint own = entry ^ block;                       /* of 2^24 */
    uint mixed = (y << (32u - (shift + bits_x))) ^ (~bin * 0x9e3779b9u);
    uint place = mixed >> 8u;
    float fy = float(place - own) / float(0x1000000u - own);

    if (place < own) {
        fy = float(own - place) / float(own);
        block = bin;
    }
    return envsamp_choice(block, across - float(column), fy);
}

/* a * b, the upper 32 bits first, by halves: not every language has the whole product. */
uvec2 envsamp_product(uint a, uint b)
{
    uint low = (a & 0xffffu) * (b & 0xffffu);
    uint middle = (a >> 16u) * (b & 0xffffu) + (low >> 16u);
    uint other = (a & 0xffffu) * (b >> 16u) + (middle & 0xffffu);

    return uvec2((a >> 16u) * (b >> 16u) + (middle >> 16u) + (other >> 16u),
                 (other << 16u) | (low & 0xffffu));
}

/* A double from 2^-10 to 2^7 in units of 2^-56, the upper 32 bits first. */
uvec2 envsamp_fixed(uint at)
{
    uint low = envsamp_word(at);
    uint bits = envsamp_word(at + 1u);
    uint high = (bits & 0xfffffu) | 0x100000u;
    uint exponent = (bits >> 20u) & 0x7ffu;

    if (exponent >= 1019u) {
        uint up = min(exponent - 1019u, 11u);

        return uvec2((high << up) | ((low >> 1u) >> (31u - up)), low << up);
    }
    uint down = min(1019u - exponent, 20u);

    return uvec2(high >> down, (low >> down) | (high << (32u - down)));
}

/* u0, continued by what u1 holds beyond its leading 12 bits, times a number, both in fixed point:
   C has doubles here. In units of 2^-48, the upper 32 bits first. */
uvec2 envsamp_fit_product(float u0, float u1, uvec2 total)
{
    float low = u1 * 4096.0 + 0.5;
    float whole = floor(u0 * ENVSAMP_UNIT);
    float more = (u0 * ENVSAMP_UNIT - whole) + (low - floor(low));
    uint upper = uint(whole) + uint(more);
    uint lower = uint((more - floor(more)) * ENVSAMP_UNIT);
    uvec2 g = envsamp_product(upper, total.x);
    uint second = envsamp_product(upper, total.y).x;
    uvec2 third = envsamp_product(lower, total.x);
    uint rest = (third.x << 8u) | (third.y >> 24u);
    uint sum = g.y + second;
    uint all = sum + rest;

    return uvec2(g.x + uint(sum < second) + uint(all < rest), all);
}

/* The natural logarithm of 1 + f / a, within 2e-7 of itself. */
float envsamp_log_ratio(float f, float a)
{
    float w = f / (2.0 * a + f);
    float k = 0.0;

    if (w > 0.17) {                     /* 1 + f / a = m 2^k, m from sqrt(1/2) to sqrt(2) */
        uint bits = floatBitsToUint(1.0 + f / a);
        uint exponent = (bits - 0x3f3504f3u) >> 23u;
        float m = uintBitsToFloat(bits - (exponent << 23u));

        w = (m - 1.0) / (m + 1.0);
        k = float(exponent);
    }
    float t = w * w;

    return k * 0.693147181 + 2.0 * w * (1.0 + t * (0.333333333 + t * (0.2 + t * (0.142857143
         + t * 0.111111111))));
}

/* How far into a bin the model's mass has come at the fraction f of it; a: alpha plus its index. */
float envsamp_fit_position(float f, float a)
{
    ENVSAMP_PRECISE float w = f / (2.0 * a + f);
    ENVSAMP_PRECISE float v = 1.0 / (2.0 * a + 1.0);
    ENVSAMP_PRECISE float t = w * w;
    ENVSAMP_PRECISE float s = v * v;
    ENVSAMP_PRECISE float up = 1.0 + t * (0.333333333 + t * (0.2 + t * (0.142857143
                                   + t * 0.111111111)));
    ENVSAMP_PRECISE float down = 1.0 - s * (0.333333333 + s * (0.0888888889 + s * (0.0465608466
                                     + s * 0.0301940035)));
    ENVSAMP_PRECISE float place = (2.0 * a + 1.0) * w * up * down;

    if (a < 1.0) {
        place = envsamp_log_ratio(f, a) / envsamp_log_ratio(1.0, a);
    }
    return place;
}

envsamp_choice envsamp_fit_choose(float u0, float u1)
{
    float alpha = uintBitsToFloat(envsamp_word(ENVSAMP_KD_FIT_ALPHA));
    float end = uintBitsToFloat(envsamp_word(ENVSAMP_KD_FIT_END));
    uvec2 g = envsamp_fit_product(u0, u1, envsamp_fixed(ENVSAMP_KD_FIT_TOTAL));
    ENVSAMP_PRECISE float f = float(((g.x & 0xffffu) << 8u) | (g.y >> 24u)) / ENVSAMP_UNIT
                            + float(g.y & 0xffffffu) / (ENVSAMP_UNIT * ENVSAMP_UNIT);
    ENVSAMP_PRECISE float f2 = f * f;
    ENVSAMP_PRECISE float rest = f * (0.693147170 + f * 0.240227226 + f2 * (0.0554958479
                                    + f * 0.00965268772 + f2 * (0.00126865296
                                    + f * 0.000208404800)));
    float power = envsamp_power_of_2(g.x >> 16u);
    ENVSAMP_PRECISE float x = alpha * ((power - 1.0) + power * rest);

    x = envsamp_at_most(max(x, 0.0), end);
    uint block = uint(x);
    float fx = envsamp_fit_position(x - float(block), alpha + float(block));

    return envsamp_choice(block, fx, u1);
}

/* ---- kd ---- */

envsamp_sample envsamp_kd_sample(float u0, float u1)
{
    uint select = envsamp_word(ENVSAMP_KD_SELECT);
    float f0 = envsamp_clamp_unit(u0);
    float f1 = envsamp_clamp_unit(u1);

    if (select != ENVSAMP_ALIAS && select != ENVSAMP_FIT) {
        return envsamp_warp_sample(f0, f1);
    }
    envsamp_choice choice;

    if (select == ENVSAMP_FIT) {
        choice = envsamp_fit_choose(f0, f1);
    } else {
        choice = envsamp_alias_choose(f0, f1);
    }
    uint at = ENVSAMP_KD_RECORDS + 5u * choice.block;
    envsamp_point p = envsamp_between(envsamp_edges(at), choice.fx, choice.fy);

    return envsamp_point_sample(envsamp_mapping(envsamp_word(3u)), p,
                                uintBitsToFloat(envsamp_word(at + 4u)), at + 4u);
}

/* 1 where a place, its coordinates as bits, is on the higher side of a cut. */
uint envsamp_is_high(uint cut, uvec2 place)
{
    uint coordinate = cut >= ENVSAMP_INNER ? place.y : place.x;

    return coordinate >= (cut & ENVSAMP_SIZE) ? 1u : 0u;
}

/* The density in a direction as bits, in z, and its place in x and y. */
uvec3 envsamp_kd_density(vec3 dir)
{
    uint mapping = envsamp_mapping(envsamp_word(3u));
    vec3 d = envsamp_grid_coords(mapping, dir, envsamp_ring(dir));
    uint bits_x = envsamp_word(ENVSAMP_KD_GRID);
    uint bits_y = envsamp_word(ENVSAMP_KD_GRID + 1u);
    float scale_x = 0.25 * envsamp_power_of_2(bits_x);
    float scale_y = envsamp_power_of_2(bits_y);
    uvec2 place = uvec2(floatBitsToUint(d.x), floatBitsToUint(d.y));

    if (mapping != ENVSAMP_HEMISPHERE) {
        scale_y = 0.5 * scale_y;
    }
    uint column = envsamp_index(d.x * scale_x, 1u << bits_x);
    uint row = envsamp_index(d.y * scale_y, 1u << bits_y);
    uint cell = (row << bits_x) + column;
    uint link = 0u;

    if (d.z > 0.0) {
        link = envsamp_word((envsamp_word(ENVSAMP_KD_GRID + 2u) >> 2u) + cell);
    }
    while (link >= ENVSAMP_INNER) {
        uint at = link & ENVSAMP_SIZE;
        uint top = envsamp_is_high(envsamp_word(at), place);
        uint side = envsamp_is_high(envsamp_word(at + 1u + top), place);

        link = envsamp_word(at + 3u + 2u * top + side);
    }
    return uvec3(place.x, place.y, link);
}

float envsamp_kd_pdf(vec3 dir)
{
    return uintBitsToFloat(envsamp_kd_density(dir).z);
}

/* ---- kd: light x cosine ---- */

const float ENVSAMP_LEAST_WEIGHT = 1e-30;
const uint ENVSAMP_FACING_EDGES = 7u;           /* words of a node, behind its cuts */
const uint ENVSAMP_FACING_CHILDREN = 14u;
const uint ENVSAMP_FACING_MOMENTS = 22u;

/* A normal, its squares, and xy, xz, yz. */
struct envsamp_normal {
    vec3 first;
    vec3 square;
    vec3 product;
    bool valid;
};

/* Weights of the parts of a node, lower and higher ones, and of pairs of them. */
struct envsamp_weights {
    vec4 low;
    vec4 high;
    vec4 pair;
};

/* Two numbers on the way down, the part of the unit square so far, x0, x1, y0, y1, and the side
   that was taken last. */
struct envsamp_walk {
    vec2 f;
    vec4 bound;
    uint side;
};

envsamp_normal envsamp_prepare_normal(vec3 normal)
{
    uint x = floatBitsToUint(normal.x) & ENVSAMP_SIZE;
    uint y = floatBitsToUint(normal.y) & ENVSAMP_SIZE;
    uint z = floatBitsToUint(normal.z) & ENVSAMP_SIZE;
    uint most = max(max(x, y), z);
    bool valid = most >= 0x00800000u && most < 0x7f800000u
              && envsamp_word(ENVSAMP_KD_FACING_COUNT) > 0u;
    float size = uintBitsToFloat(most);
    vec3 n = vec3(0.0, 0.0, 0.0);

    if (valid) {
        n = vec3(envsamp_quotient(normal.x, size), envsamp_quotient(normal.y, size),
                 envsamp_quotient(normal.z, size));
    }
    vec3 square = vec3(n.x * n.x, n.y * n.y, n.z * n.z);
    vec3 product = vec3(n.x * n.y, n.x * n.z, n.y * n.z);

    return envsamp_normal(n, square, product, valid);
}

vec4 envsamp_floats(uint at)
{
    return vec4(uintBitsToFloat(envsamp_word(at)), uintBitsToFloat(envsamp_word(at + 1u)),
                uintBitsToFloat(envsamp_word(at + 2u)), uintBitsToFloat(envsamp_word(at + 3u)));
}

float envsamp_weight(float mean, float square)
{
    float weight = mean + envsamp_root(max(square, 0.0));

    return weight > ENVSAMP_LEAST_WEIGHT ? weight : 0.0;
}

vec4 envsamp_weigh_side(uint at, envsamp_normal n)
{
    ENVSAMP_PRECISE vec4 mean = envsamp_floats(at) * n.first.x
                              + envsamp_floats(at + 8u) * n.first.y
                              + envsamp_floats(at + 16u) * n.first.z;
    ENVSAMP_PRECISE vec4 even = envsamp_floats(at + 24u) * n.square.x
                              + envsamp_floats(at + 32u) * n.square.y
                              + envsamp_floats(at + 40u) * n.square.z;
    ENVSAMP_PRECISE vec4 mixed = envsamp_floats(at + 48u) * n.product.x
                               + envsamp_floats(at + 56u) * n.product.y
                               + envsamp_floats(at + 64u) * n.product.z;
    ENVSAMP_PRECISE vec4 square = even + mixed;

    return vec4(envsamp_weight(mean.x, square.x), envsamp_weight(mean.y, square.y),
                envsamp_weight(mean.z, square.z), envsamp_weight(mean.w, square.w));
}

envsamp_weights envsamp_weigh(uint node, envsamp_normal n)
{
    vec4 low = envsamp_weigh_side(node + ENVSAMP_FACING_MOMENTS, n);
    vec4 high = envsamp_weigh_side(node + ENVSAMP_FACING_MOMENTS + 4u, n);

    high.w = high.w + ENVSAMP_LEAST_WEIGHT;
    return envsamp_weights(low, high, low + high);
}

envsamp_walk envsamp_facing_side(uint cut, float low, float high, envsamp_walk walk)
{
    envsamp_walk next = walk;
    bool down = cut >= ENVSAMP_INNER;
    float number = down ? walk.f.y : walk.f.x;
    ENVSAMP_PRECISE float place = number * (low + high);
    bool upper = place >= low;
    float start = upper ? low : 0.0;
    float size = upper ? high : low;
    float stretched = envsamp_quotient(place - start, size);
    float at = uintBitsToFloat(cut & ENVSAMP_SIZE);

    if (down) {
        next.f.y = envsamp_clamp_unit(stretched);
        next.bound.z = upper ? at : walk.bound.z;
        next.bound.w = upper ? walk.bound.w : at;
    } else {
        next.f.x = envsamp_clamp_unit(stretched);
        next.bound.x = upper ? at : walk.bound.x;
        next.bound.y = upper ? walk.bound.y : at;
    }
    next.side = upper ? 1u : 0u;
    return next;
}

/* Back in the whole unit square, below the higher bound. */
float envsamp_facing_number(float low, float high, float f)
{
    ENVSAMP_PRECISE float u = low + f * (high - low);

    return envsamp_clamp_unit(envsamp_at_most(u, envsamp_below(high)));
}

/* Numbers with which light alone draws what light x cosine should, and in z what that multiplies
   the density by. */
vec3 envsamp_facing_warp(envsamp_normal n, float u0, float u1)
{
    envsamp_walk walk = envsamp_walk(vec2(u0, u1), vec4(0.0, 1.0, 0.0, 1.0), 0u);
    uint node = envsamp_word(ENVSAMP_KD_FACING_AT) >> 2u;
    uint link = ENVSAMP_INNER;
    float ratio = 1.0;

    while (link >= ENVSAMP_INNER) {
        envsamp_weights w = envsamp_weigh(node, n);
        float low = w.pair.x + w.pair.y;
        float high = w.pair.z + w.pair.w;

        walk = envsamp_facing_side(envsamp_word(node), low, high, walk);
        uint at = walk.side;

        walk = envsamp_facing_side(envsamp_word(node + 1u + at), w.pair[2u * at],
                                   w.pair[2u * at + 1u], walk);
        at = 2u * at + walk.side;
        walk = envsamp_facing_side(envsamp_word(node + 3u + at), w.low[at], w.high[at], walk);
        float weight = w.low[at];

        if (walk.side == 1u) {
            weight = w.high[at];
        }
        ratio = ratio * (weight / (low + high));
        link = envsamp_word(node + ENVSAMP_FACING_CHILDREN + 4u * walk.side + at);
        node = link & ENVSAMP_SIZE;
    }
    ratio = envsamp_saturate(ratio) * uintBitsToFloat(link);
    return vec3(envsamp_facing_number(walk.bound.x, walk.bound.y, walk.f.x),
                envsamp_facing_number(walk.bound.z, walk.bound.w, walk.f.y), ratio);
}

/* Light x cosine about a normal, of any length from 1e-37 to 1e38; light alone for what is none
   and of a table without `facing`. */
envsamp_sample envsamp_kd_sample_facing(vec3 normal, float u0, float u1)
{
    envsamp_normal n = envsamp_prepare_normal(normal);
    vec3 f = vec3(envsamp_clamp_unit(u0), envsamp_clamp_unit(u1), 1.0);

    if (n.valid) {
        f = envsamp_facing_warp(n, f.x, f.y);
    }
    envsamp_sample s = envsamp_kd_sample(f.x, f.y);

    s.pdf = envsamp_at_most(s.pdf * f.z, ENVSAMP_MOST);
    return s;
}

float envsamp_kd_pdf_facing(vec3 normal, vec3 dir)
{
    envsamp_normal n = envsamp_prepare_normal(normal);
    uvec3 density = envsamp_kd_density(dir);
    uvec2 place = density.xy;
    float pdf = uintBitsToFloat(density.z);
    uint node = envsamp_word(ENVSAMP_KD_FACING_AT) >> 2u;
    uint link = ENVSAMP_INNER;
    float ratio = 1.0;

    if (!n.valid || density.z == 0u) {
        return pdf;
    }
    while (link >= ENVSAMP_INNER) {
        envsamp_weights w = envsamp_weigh(node, n);
        uint edges = node + ENVSAMP_FACING_EDGES;
        uint at = envsamp_is_high(envsamp_word(edges), place);

        at = 2u * at + envsamp_is_high(envsamp_word(edges + 1u + at), place);
        uint side = envsamp_is_high(envsamp_word(edges + 3u + at), place);
        float weight = w.low[at];

        if (side == 1u) {
            weight = w.high[at];
        }
        ratio = ratio * (weight / ((w.pair.x + w.pair.y) + (w.pair.z + w.pair.w)));
        link = envsamp_word(node + ENVSAMP_FACING_CHILDREN + 4u * side + at);
        node = link & ENVSAMP_SIZE;
    }
    ratio = pdf * envsamp_saturate(ratio) * uintBitsToFloat(link);
    return envsamp_at_most(ratio, ENVSAMP_MOST);
}

/* ---- cdf: header, in words; a place is a number of bytes in two words ---- */

const uint ENVSAMP_CDF_MAGIC = 0x434b5345u;
const uint ENVSAMP_CDF_VERSION = 5u;
const uint ENVSAMP_CDF_WIDTH = 6u;
const uint ENVSAMP_CDF_HEIGHT = 7u;
const uint ENVSAMP_CDF_IMAGE_WIDTH = 8u;
const uint ENVSAMP_CDF_ROW_BITS = 10u;
const uint ENVSAMP_CDF_GUIDE_BITS = 11u;
const uint ENVSAMP_CDF_INVERSE_WIDTH = 12u;
const uint ENVSAMP_CDF_ROW_SCALE = 13u;
const uint ENVSAMP_CDF_OFFSET = 14u;
const uint ENVSAMP_CDF_BILINEAR = 15u;
const uint ENVSAMP_CDF_ROWS_AT = 16u;
const uint ENVSAMP_CDF_ROW_EDGES_AT = 18u;
const uint ENVSAMP_CDF_EDGES_AT = 20u;
const uint ENVSAMP_CDF_ROW_GUIDE_AT = 22u;
const uint ENVSAMP_CDF_GUIDE_AT = 24u;
const uint ENVSAMP_CDF_WALK = 4u;

/* As envsamp_kd_problem. */
uint envsamp_cdf_problem()
{
    uint mapping = envsamp_cdf_word(3u);

    if (envsamp_cdf_word(0u) != ENVSAMP_CDF_MAGIC) {
        return 1u;
    }
    if (envsamp_cdf_word(1u) != ENVSAMP_CDF_VERSION) {
        return 2u;
    }
    return mapping != envsamp_mapping(mapping) ? 3u : 0u;
}

/* Where an array begins, in words, or in half words. */
uint envsamp_cdf_words_at(uint field)
{
    return (envsamp_cdf_word(field) >> 2u) | (envsamp_cdf_word(field + 1u) << 30u);
}

uint envsamp_cdf_halves_at(uint field)
{
    return (envsamp_cdf_word(field) >> 1u) | (envsamp_cdf_word(field + 1u) << 31u);
}

uint envsamp_cdf_half(uint at)
{
    return (envsamp_cdf_word(at >> 1u) >> ((at & 1u) << 4u)) & 0xffffu;
}

/* ---- cdf ---- */

/* The index i with edges[i] <= draw < edges[i + 1]. */
uint envsamp_cdf_find(uint edges, uint guide, uint bits, uint draw)
{
    uint cell = draw >> (24u - bits);
    uint low = envsamp_cdf_half(guide + cell);
    uint edge = edges + low;

    low = low + uint(envsamp_cdf_word(edge + 1u) <= draw)
        + uint(envsamp_cdf_word(edge + 2u) <= draw)
        + uint(envsamp_cdf_word(edge + 3u) <= draw) + uint(envsamp_cdf_word(edge + 4u) <= draw);
    if (envsamp_cdf_word(edges + low + 1u) > draw) {
        return low;
    }
    uint last = envsamp_cdf_half(guide + cell + 1u);

    low = low + 1u;
    while (low < last) {
        uint middle = low + ((last - low) >> 1u);

        if (envsamp_cdf_word(edges + middle + 1u) > draw) {
            last = middle;
        } else {
            low = middle + 1u;
        }
    }
    return low;
}

/* Which of its 2^24 values a number is. */
uint envsamp_draw(float u)
{
    return uint(envsamp_clamp_unit(u) * ENVSAMP_UNIT);
}

uint envsamp_cdf_edges(uint row)
{
    return envsamp_cdf_words_at(ENVSAMP_CDF_EDGES_AT)
         + row * (envsamp_cdf_word(ENVSAMP_CDF_WIDTH) + ENVSAMP_CDF_WALK);
}

/* The density of texel (column, row), whose edges are the words from `edge` on. */
float envsamp_cdf_density(uint column, uint row, uint edge)
{
    uint width = envsamp_cdf_word(ENVSAMP_CDF_WIDTH);
    uint parts = envsamp_cdf_word(edge + 1u) - envsamp_cdf_word(edge);
    float density = uintBitsToFloat(envsamp_cdf_word(envsamp_cdf_words_at(ENVSAMP_CDF_ROWS_AT)
                                                     + 3u * row + 2u));

    if ((column == 0u || column + 1u == width) && envsamp_cdf_word(ENVSAMP_CDF_BILINEAR) == 1u) {
        parts = parts << 1u;
    }
    return float(parts) * density;
}

/* How far from one edge to the next a draw is, from its middle. */
float envsamp_cdf_fraction(uint edge, uint draw)
{
    uint first = envsamp_cdf_word(edge);
    uint parts = envsamp_cdf_word(edge + 1u) - first;
    float f = (float(draw - first) + 0.5) / float(parts);

    return f;
}

envsamp_sample envsamp_cdf_sample(float u0, float u1)
{
    uint down = envsamp_draw(u1);
    uint across = envsamp_draw(u0);
    uint row_edges = envsamp_cdf_words_at(ENVSAMP_CDF_ROW_EDGES_AT);
    uint row = envsamp_cdf_find(row_edges, envsamp_cdf_halves_at(ENVSAMP_CDF_ROW_GUIDE_AT),
                                envsamp_cdf_word(ENVSAMP_CDF_ROW_BITS), down);
    uint edges = envsamp_cdf_edges(row);
    uint bits = envsamp_cdf_word(ENVSAMP_CDF_GUIDE_BITS);
    uint guide = envsamp_cdf_halves_at(ENVSAMP_CDF_GUIDE_AT) + row * ((1u << bits) + 1u);
    uint column = envsamp_cdf_find(edges, guide, bits, across);
    uint rows = envsamp_cdf_words_at(ENVSAMP_CDF_ROWS_AT) + 3u * row;
    float fx = envsamp_cdf_fraction(edges + column, across);
    float fy = envsamp_cdf_fraction(row_edges + row, down);
    float offset = uintBitsToFloat(envsamp_cdf_word(ENVSAMP_CDF_OFFSET));
    float inverse = uintBitsToFloat(envsamp_cdf_word(ENVSAMP_CDF_INVERSE_WIDTH));
    float x0 = max(float(column) - offset, 0.0);
    float x1 = min(float(column) - offset + 1.0, float(envsamp_cdf_word(ENVSAMP_CDF_IMAGE_WIDTH)));
    float north = uintBitsToFloat(envsamp_cdf_word(rows));
    float south = uintBitsToFloat(envsamp_cdf_word(rows + 1u));
    ENVSAMP_PRECISE float x = (x0 + fx * (x1 - x0)) * inverse;
    ENVSAMP_PRECISE float cap = north
                              + fy * (uintBitsToFloat(envsamp_cdf_word(rows + 3u)) - north);
    ENVSAMP_PRECISE float rest = south
                               + fy * (uintBitsToFloat(envsamp_cdf_word(rows + 4u)) - south);

    return envsamp_point_sample(envsamp_mapping(envsamp_cdf_word(3u)),
                                envsamp_point(x, cap, rest),
                                envsamp_cdf_density(column, row, edges + column), edges + column);
}

float envsamp_cdf_pdf(vec3 dir)
{
    uint mapping = envsamp_mapping(envsamp_cdf_word(3u));
    float r = envsamp_ring(dir);
    vec3 d = envsamp_grid_coords(mapping, dir, r);
    float offset = uintBitsToFloat(envsamp_cdf_word(ENVSAMP_CDF_OFFSET));
    float scale = uintBitsToFloat(envsamp_cdf_word(ENVSAMP_CDF_ROW_SCALE));
    float width = float(envsamp_cdf_word(ENVSAMP_CDF_IMAGE_WIDTH));
    float u = 0.25 * d.x;
    float v = 0.5 * d.y;

    if (d.z == 0.0) {
        return 0.0;
    }
    if (mapping != ENVSAMP_OCTAHEDRAL) {
        ENVSAMP_PRECISE float t = 1.0 - 2.0 * envsamp_quotient(abs(dir.z), r + abs(dir.z));
        ENVSAMP_PRECISE float s = t * t;
        ENVSAMP_PRECISE float s2 = s * s;

        t = t * (((0.318309882 - s * 0.106102533) + s2 * (0.0636398678 - s * 0.0452227112))
               + s2 * s2 * (((0.0339148928 - s * 0.0239804388)
                           + s2 * (0.0136998603 - s * 0.005183045)) + s2 * s2 * 0.000924230142));
        u = envsamp_turn(dir.y, dir.x);
        v = 0.5 - envsamp_copy_sign(0.25 - t, dir.z);
        if (mapping == ENVSAMP_HEMISPHERE && v > 0.5) {
            return 0.0;
        }
    }
    ENVSAMP_PRECISE float x = u * width + offset;
    ENVSAMP_PRECISE float y = v * scale + offset;
    uint column = envsamp_index(x, envsamp_cdf_word(ENVSAMP_CDF_WIDTH));
    uint row = envsamp_index(y, envsamp_cdf_word(ENVSAMP_CDF_HEIGHT));

    return envsamp_cdf_density(column, row, envsamp_cdf_edges(row) + column);
}
