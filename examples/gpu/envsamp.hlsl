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

static const uint ENVSAMP_OCTAHEDRAL = 2u;
static const uint ENVSAMP_HEMISPHERE = 1u;
static const uint ENVSAMP_ALIAS = 1u;
static const uint ENVSAMP_FIT = 2u;
static const uint ENVSAMP_INNER = 0x80000000u;         /* of a link: not a density */
static const uint ENVSAMP_SIZE = 0x7fffffffu;          /* bits of a float without its sign */
static const float ENVSAMP_UNIT = 16777216.0;          /* 2^24 */
static const float ENVSAMP_TINY = 1.17549435e-38;      /* the least normal float, */
static const float ENVSAMP_MOST = 3.40282346e+38;      /* and the largest */

/* dir: unit. pdf: per steradian. uv: where in the map. block: what was drawn, as the place of its
   density in words; of cdf, of its texel's edge. */
struct envsamp_sample {
    float3 dir;
    float pdf;
    float2 uv;
    uint block;
};

envsamp_sample envsamp_sample_of(float3 dir, float pdf, float2 uv, uint block)
{
    envsamp_sample made;

    made.dir = dir;
    made.pdf = pdf;
    made.uv = uv;
    made.block = block;
    return made;
}

/* Azimuth in turns, 1 - cos theta, 1 + cos theta; of octahedral maps u and v. */
struct envsamp_point {
    float x;
    float north;
    float south;
};

envsamp_point envsamp_point_of(float x, float north, float south)
{
    envsamp_point made;

    made.x = x;
    made.north = north;
    made.south = south;
    return made;
}

/* A block, and where in it a sample lies, [0, 1]. */
struct envsamp_choice {
    uint block;
    float fx;
    float fy;
};

envsamp_choice envsamp_choice_of(uint block, float fx, float fy)
{
    envsamp_choice made;

    made.block = block;
    made.fx = fx;
    made.fy = fy;
    return made;
}

/* ---- small math ---- */

float envsamp_sign(float size, uint negative)
{
    return asfloat((asuint(size) & ENVSAMP_SIZE) | (negative << 31u));
}

float envsamp_copy_sign(float size, float other)
{
    return envsamp_sign(size, asuint(other) >> 31u);
}

/* |x|, but no more than `most`: that for a NaN. */
float envsamp_at_most(float x, float most)
{
    return asfloat(min(asuint(x) & ENVSAMP_SIZE, asuint(most)));
}

/* To [0, 1), whatever it is. */
float envsamp_clamp_unit(float u)
{
    return asfloat(min(asuint(u) & ENVSAMP_SIZE, 0x3f7fffffu));
}

/* To [0, 1]; negative numbers and NaN count as 0. */
float envsamp_saturate(float x)
{
    uint bits = asuint(x);
    uint most = min(bits, 0x3f800000u);

    return bits <= 0x7f800000u ? asfloat(most) : 0.0;
}

/* 0 for -0; a compiler may drop an added 0. */
float envsamp_plus_zero(float x)
{
    return asuint(x) == ENVSAMP_INNER ? 0.0 : x;
}

/* The next float below a number above 0. */
float envsamp_below(float x)
{
    return asfloat(asuint(x) - 1u);
}

float envsamp_power_of_2(uint exponent)
{
    return asfloat((exponent + 127u) << 23u);
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
float2 envsamp_cos_sin_turn(float u)
{
    precise float h = u - 0.5;
    precise float t = h * h;
    precise float t2 = t * t;
    precise float s = h * (3.14159258 - t * 5.16770690 + t2 * (2.55003164 - t * 0.598046450
                                 + t2 * 0.0772222480));
    precise float c = (1.0 - 4.0 * t) * (0.999999945 - t * 0.934791803 + t2 * (0.319215031
                                 - t * 0.0548052368));
    precise float cosine = s * s - c * c;
    precise float sine = -2.0 * s * c;

    return float2(cosine, sine);
}

/* Arc tangent of t in turns, 0 <= t <= 1. */
float envsamp_octant_turn(float t)
{
    precise float s = t * t;
    precise float turn = t * (0.159154941 + s * (-0.0530512667 + s * (0.0318199339
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
    precise float t2 = t * t;
    precise float low = 0.450158207 + t * 0.0375087059 + t2 * (0.00850684985
                                   + t * 0.00214716597);
    precise float v = q * (low + t2 * t2 * (0.00178524512 - t * 0.000837066695
                                   + t2 * 0.000730843713));

    return 0.5 - envsamp_copy_sign(0.5 - v, south - north);
}

/* Sine of t quarter turns, 0 <= t <= 1. */
float envsamp_sin_quarter(float t)
{
    precise float s = t * t;
    precise float s2 = s * s;
    precise float sine = t * ((1.57079625 - s * 0.645963371)
                                    + s2 * (0.0796884820 - s * 0.00467222789
                                    + s2 * 0.000150820561));

    return sine;
}

float3 envsamp_octahedral_dir(float u, float v)
{
    float a = 2.0 * u - 1.0;
    float b = 2.0 * v - 1.0;
    float rest_a = 1.0 - abs(a);
    float rest_b = 1.0 - abs(b);
    float p = min(abs(a), rest_b);
    float q = min(abs(b), rest_a);
    float r = p + q;
    float inverse = 1.0 / (r + ENVSAMP_TINY);
    precise float s = r * r;
    precise float s2 = s * s;
    precise float ring = r * ((1.41421378 - s * 0.353563577)
                                    - s2 * (0.0440602601 + s * 0.0118305748)
                                    - s2 * s2 * ((0.00107195461 + s * 0.00519226724)
                                               - s2 * (0.00310698547 - s * 0.00160211383)));

    return float3(envsamp_copy_sign(ring * envsamp_sin_quarter(p * inverse), a),
                envsamp_copy_sign(ring * envsamp_sin_quarter(q * inverse), b),
                envsamp_copy_sign(1.0 - s, rest_b - abs(a)));
}

/* u and v in a direction of any length; r is |(x, y)|. */
float2 envsamp_octahedral_uv(float3 dir, float r)
{
    float3 size = abs(dir);
    float across = envsamp_quotient(min(size.x, size.y), max(size.x, size.y) + ENVSAMP_TINY);
    float down = envsamp_quotient(min(r, size.z), max(r, size.z) + ENVSAMP_TINY);
    float turn = min(4.0 * envsamp_octant_turn(down), 0.5);
    float w = abs(1.0 - envsamp_positive(size.z - r) - turn);
    float s = w * w;
    precise float p = w * ((0.555360375 - s * 0.0570955985)
                                 + s * s * (0.00176060538 - s * 2.53690523e-05));
    float q = min(4.0 * envsamp_octant_turn(across), 0.5);

    w = min(p, 0.5);
    q = w * abs(envsamp_positive(size.y - size.x) - q);
    s = envsamp_positive(envsamp_plus_zero(dir.z));
    p = abs(s * w - q);
    q = w - p;
    return float2(abs(envsamp_positive(dir.x) - abs(0.5 * s - p)),
                abs(envsamp_positive(dir.y) - abs(0.5 * s - q)));
}

/* ---- points of a block ---- */

/* 1 - cos theta and 1 + cos theta of an edge as a table stores it. */
float2 envsamp_edge_pair(uint edge)
{
    float cap = asfloat(edge & ENVSAMP_SIZE);
    float rest = 2.0 - cap;
    bool south = edge >= ENVSAMP_INNER;

    return south ? float2(rest, cap) : float2(cap, rest);
}

/* edge: x0, x1, y0, y1 as stored. */
envsamp_point envsamp_between(uint4 edge, float fx, float fy)
{
    float2 top = envsamp_edge_pair(edge.z);
    float2 end = envsamp_edge_pair(edge.w);
    float x0 = asfloat(edge.x);
    precise float x = x0 + fx * (asfloat(edge.y) - x0);
    precise float north = top.x + fy * (end.x - top.x);
    precise float south = top.y + fy * (end.y - top.y);

    return envsamp_point_of(x, north, south);
}

uint envsamp_mapping(uint stored)
{
    return ENVSAMP_MAPPING < 3u ? ENVSAMP_MAPPING : stored;
}

envsamp_sample envsamp_point_sample(uint mapping, envsamp_point p, float pdf, uint block)
{
    float x = envsamp_clamp_unit(p.x);
    float2 uv = float2(x, p.north);
    float2 around = envsamp_cos_sin_turn(x);
    float sine = sqrt(abs(p.north * p.south));
    float3 dir = float3(around.x * sine, around.y * sine, 0.5 * (p.south - p.north));

    if (mapping == ENVSAMP_OCTAHEDRAL) {
        dir = envsamp_octahedral_dir(x, p.north);
    } else {
        uv.y = envsamp_polar_fraction(p.north, p.south);
        if (mapping == ENVSAMP_HEMISPHERE) {
            uv.y = min(2.0 * uv.y, 1.0);
        }
    }
    return envsamp_sample_of(dir, pdf, uv, block);
}

/* ---- directions in coordinates of density ---- */

/* Azimuth in [0, 4] and polar in [0, 2], and 1 in z for a direction, 0 for none. */
float3 envsamp_grid_coords(uint mapping, float3 dir, float r)
{
    float side = abs(dir.x) + abs(dir.y);
    float sum = r + abs(dir.z);
    bool valid = asuint(side) < 0x7f800000u && asuint(sum) - 1u < 0x7f7fffffu;
    float t = envsamp_quotient(abs(dir.y), max(side, ENVSAMP_TINY));
    float q = envsamp_quotient(r, max(sum, ENVSAMP_TINY));

    if (!valid) {
        return float3(0.0, 0.0, 0.0);
    }
    if (mapping == ENVSAMP_OCTAHEDRAL) {
        float3 plain = float3(envsamp_plus_zero(dir.x), envsamp_plus_zero(dir.y), dir.z);
        float2 uv = envsamp_octahedral_uv(plain, r);

        return float3(4.0 * uv.x, 2.0 * uv.y, 1.0);
    }
    t = 2.0 - envsamp_copy_sign(1.0 + envsamp_copy_sign(1.0, dir.x)
                                - envsamp_copy_sign(t, dir.x), dir.y);
    q = 1.0 - envsamp_copy_sign(1.0 - q, dir.z);
    if (!(side > 0.0)) {
        t = 0.0;
    }
    if (mapping == ENVSAMP_HEMISPHERE && q > 1.0) {
        return float3(0.0, 0.0, 0.0);
    }
    return float3(t, q, 1.0);
}

/* |(x, y)| */
float envsamp_ring(float3 dir)
{
    precise float square = dir.x * dir.x + dir.y * dir.y;

    return envsamp_root(square);
}

/* ---- kd: header, in words ---- */

static const uint ENVSAMP_KD_MAGIC = 0x444b5345u;
static const uint ENVSAMP_KD_VERSION = 6u;
static const uint ENVSAMP_KD_SELECT = 6u;
static const uint ENVSAMP_KD_TILE_BITS = 7u;           /* x, then y */
static const uint ENVSAMP_KD_ALIAS_SHIFT = 9u;
static const uint ENVSAMP_KD_ALIAS_AT = 10u;
static const uint ENVSAMP_KD_GRID = 11u;               /* bits of x, of y, place */
static const uint ENVSAMP_KD_MODEL = 14u;
static const uint ENVSAMP_KD_FIT_ALPHA = 15u;
static const uint ENVSAMP_KD_FIT_END = 16u;
static const uint ENVSAMP_KD_FIT_TOTAL = 26u;          /* a double */
static const uint ENVSAMP_KD_FACING_COUNT = 42u;
static const uint ENVSAMP_KD_FACING_AT = 43u;
static const uint ENVSAMP_KD_RECORDS = 48u;

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

uint4 envsamp_edges(uint at)
{
    return uint4(envsamp_word(at), envsamp_word(at + 1u), envsamp_word(at + 2u),
                 envsamp_word(at + 3u));
}

/* ---- kd: WARP ---- */

/* A region on the way down: edges x0, x1, y0, y1 in its tile's unit square and in the map, its
   link, and the word that has it. */
struct envsamp_region {
    float4 cut;
    uint4 edge;
    uint link;
    uint place;
};

envsamp_region envsamp_region_of(float4 cut, uint4 edge, uint link, uint place)
{
    envsamp_region made;

    made.cut = cut;
    made.edge = edge;
    made.link = link;
    made.place = place;
    return made;
}

/* The side of its next cut that f is on. */
envsamp_region envsamp_take_side(envsamp_region r, float2 f)
{
    envsamp_region side = r;
    uint at = r.link & ENVSAMP_SIZE;
    uint bits = envsamp_word(at);
    uint edge = envsamp_word(at + 1u);
    float cut = asfloat(bits & ENVSAMP_SIZE);
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
    float2 f = float2(across - float(column), down - float(row));
    uint at = ENVSAMP_KD_RECORDS + 5u * ((row << bits_x) + column);
    envsamp_region r = envsamp_region_of(float4(0.0, 1.0, 0.0, 1.0), envsamp_edges(at),
                                      envsamp_word(at + 4u), at + 4u);

    while (r.link >= ENVSAMP_INNER) {
        r = envsamp_take_side(r, f);
    }
    float fx = (f.x - r.cut.x) / (r.cut.y - r.cut.x);
    float fy = (f.y - r.cut.z) / (r.cut.w - r.cut.z);
    envsamp_point p = envsamp_between(r.edge, fx, fy);

    return envsamp_point_sample(envsamp_mapping(envsamp_word(3u)), p, asfloat(r.link),
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
    return envsamp_choice_of(block, across - float(column), fy);
}

/* a * b, the upper 32 bits first, by halves: not every language has the whole product. */
uint2 envsamp_product(uint a, uint b)
{
    uint low = (a & 0xffffu) * (b & 0xffffu);
    uint middle = (a >> 16u) * (b & 0xffffu) + (low >> 16u);
    uint other = (a & 0xffffu) * (b >> 16u) + (middle & 0xffffu);

    return uint2((a >> 16u) * (b >> 16u) + (middle >> 16u) + (other >> 16u),
                 (other << 16u) | (low & 0xffffu));
}

/* A double from 2^-10 to 2^7 in units of 2^-56, the upper 32 bits first. */
uint2 envsamp_fixed(uint at)
{
    uint low = envsamp_word(at);
    uint bits = envsamp_word(at + 1u);
    uint high = (bits & 0xfffffu) | 0x100000u;
    uint exponent = (bits >> 20u) & 0x7ffu;

    if (exponent >= 1019u) {
        uint up = min(exponent - 1019u, 11u);

        return uint2((high << up) | ((low >> 1u) >> (31u - up)), low << up);
    }
    uint down = min(1019u - exponent, 20u);

    return uint2(high >> down, (low >> down) | (high << (32u - down)));
}

/* u0, continued by what u1 holds beyond its leading 12 bits, times a number, both in fixed point:
   C has doubles here. In units of 2^-48, the upper 32 bits first. */
uint2 envsamp_fit_product(float u0, float u1, uint2 total)
{
    float low = u1 * 4096.0 + 0.5;
    float whole = floor(u0 * ENVSAMP_UNIT);
    float more = (u0 * ENVSAMP_UNIT - whole) + (low - floor(low));
    uint upper = uint(whole) + uint(more);
    uint lower = uint((more - floor(more)) * ENVSAMP_UNIT);
    uint2 g = envsamp_product(upper, total.x);
    uint second = envsamp_product(upper, total.y).x;
    uint2 third = envsamp_product(lower, total.x);
    uint rest = (third.x << 8u) | (third.y >> 24u);
    uint sum = g.y + second;
    uint all = sum + rest;

    return uint2(g.x + uint(sum < second) + uint(all < rest), all);
}

/* The natural logarithm of 1 + f / a, within 2e-7 of itself. */
float envsamp_log_ratio(float f, float a)
{
    float w = f / (2.0 * a + f);
    float k = 0.0;

    if (w > 0.17) {                     /* 1 + f / a = m 2^k, m from sqrt(1/2) to sqrt(2) */
        uint bits = asuint(1.0 + f / a);
        uint exponent = (bits - 0x3f3504f3u) >> 23u;
        float m = asfloat(bits - (exponent << 23u));

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
    precise float w = f / (2.0 * a + f);
    precise float v = 1.0 / (2.0 * a + 1.0);
    precise float t = w * w;
    precise float s = v * v;
    precise float up = 1.0 + t * (0.333333333 + t * (0.2 + t * (0.142857143
                                   + t * 0.111111111)));
    precise float down = 1.0 - s * (0.333333333 + s * (0.0888888889 + s * (0.0465608466
                                     + s * 0.0301940035)));
    precise float place = (2.0 * a + 1.0) * w * up * down;

    if (a < 1.0) {
        place = envsamp_log_ratio(f, a) / envsamp_log_ratio(1.0, a);
    }
    return place;
}

envsamp_choice envsamp_fit_choose(float u0, float u1)
{
    float alpha = asfloat(envsamp_word(ENVSAMP_KD_FIT_ALPHA));
    float end = asfloat(envsamp_word(ENVSAMP_KD_FIT_END));
    uint2 g = envsamp_fit_product(u0, u1, envsamp_fixed(ENVSAMP_KD_FIT_TOTAL));
    precise float f = float(((g.x & 0xffffu) << 8u) | (g.y >> 24u)) / ENVSAMP_UNIT
                            + float(g.y & 0xffffffu) / (ENVSAMP_UNIT * ENVSAMP_UNIT);
    precise float f2 = f * f;
    precise float rest = f * (0.693147170 + f * 0.240227226 + f2 * (0.0554958479
                                    + f * 0.00965268772 + f2 * (0.00126865296
                                    + f * 0.000208404800)));
    float power = envsamp_power_of_2(g.x >> 16u);
    precise float x = alpha * ((power - 1.0) + power * rest);

    x = envsamp_at_most(max(x, 0.0), end);
    uint block = uint(x);
    float fx = envsamp_fit_position(x - float(block), alpha + float(block));

    return envsamp_choice_of(block, fx, u1);
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
                                asfloat(envsamp_word(at + 4u)), at + 4u);
}

/* 1 where a place, its coordinates as bits, is on the higher side of a cut. */
uint envsamp_is_high(uint cut, uint2 place)
{
    uint coordinate = cut >= ENVSAMP_INNER ? place.y : place.x;

    return coordinate >= (cut & ENVSAMP_SIZE) ? 1u : 0u;
}

/* The density in a direction as bits, in z, and its place in x and y. */
uint3 envsamp_kd_density(float3 dir)
{
    uint mapping = envsamp_mapping(envsamp_word(3u));
    float3 d = envsamp_grid_coords(mapping, dir, envsamp_ring(dir));
    uint bits_x = envsamp_word(ENVSAMP_KD_GRID);
    uint bits_y = envsamp_word(ENVSAMP_KD_GRID + 1u);
    float scale_x = 0.25 * envsamp_power_of_2(bits_x);
    float scale_y = envsamp_power_of_2(bits_y);
    uint2 place = uint2(asuint(d.x), asuint(d.y));

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
    return uint3(place.x, place.y, link);
}

float envsamp_kd_pdf(float3 dir)
{
    return asfloat(envsamp_kd_density(dir).z);
}

/* ---- kd: light x cosine ---- */

static const float ENVSAMP_LEAST_WEIGHT = 1e-30;
static const uint ENVSAMP_FACING_EDGES = 7u;           /* words of a node, behind its cuts */
static const uint ENVSAMP_FACING_CHILDREN = 14u;
static const uint ENVSAMP_FACING_MOMENTS = 22u;

/* A normal, its squares, and xy, xz, yz. */
struct envsamp_normal {
    float3 first;
    float3 square;
    float3 product;
    bool valid;
};

envsamp_normal envsamp_normal_of(float3 first, float3 square, float3 product, bool valid)
{
    envsamp_normal made;

    made.first = first;
    made.square = square;
    made.product = product;
    made.valid = valid;
    return made;
}

/* Weights of the parts of a node, lower and higher ones, and of pairs of them. */
struct envsamp_weights {
    float4 low;
    float4 high;
    float4 pair;
};

envsamp_weights envsamp_weights_of(float4 low, float4 high, float4 pair)
{
    envsamp_weights made;

    made.low = low;
    made.high = high;
    made.pair = pair;
    return made;
}

/* Two numbers on the way down, the part of the unit square so far, x0, x1, y0, y1, and the side
   that was taken last. */
struct envsamp_walk {
    float2 f;
    float4 bound;
    uint side;
};

envsamp_walk envsamp_walk_of(float2 f, float4 bound, uint side)
{
    envsamp_walk made;

    made.f = f;
    made.bound = bound;
    made.side = side;
    return made;
}

envsamp_normal envsamp_prepare_normal(float3 normal)
{
    uint x = asuint(normal.x) & ENVSAMP_SIZE;
    uint y = asuint(normal.y) & ENVSAMP_SIZE;
    uint z = asuint(normal.z) & ENVSAMP_SIZE;
    uint most = max(max(x, y), z);
    bool valid = most >= 0x00800000u && most < 0x7f800000u
              && envsamp_word(ENVSAMP_KD_FACING_COUNT) > 0u;
    float size = asfloat(most);
    float3 n = float3(0.0, 0.0, 0.0);

    if (valid) {
        n = float3(envsamp_quotient(normal.x, size), envsamp_quotient(normal.y, size),
                 envsamp_quotient(normal.z, size));
    }
    float3 square = float3(n.x * n.x, n.y * n.y, n.z * n.z);
    float3 product = float3(n.x * n.y, n.x * n.z, n.y * n.z);

    return envsamp_normal_of(n, square, product, valid);
}

float4 envsamp_floats(uint at)
{
    return float4(asfloat(envsamp_word(at)), asfloat(envsamp_word(at + 1u)),
                asfloat(envsamp_word(at + 2u)), asfloat(envsamp_word(at + 3u)));
}

float envsamp_weight(float mean, float square)
{
    float weight = mean + envsamp_root(max(square, 0.0));

    return weight > ENVSAMP_LEAST_WEIGHT ? weight : 0.0;
}

float4 envsamp_weigh_side(uint at, envsamp_normal n)
{
    precise float4 mean = envsamp_floats(at) * n.first.x
                              + envsamp_floats(at + 8u) * n.first.y
                              + envsamp_floats(at + 16u) * n.first.z;
    precise float4 even = envsamp_floats(at + 24u) * n.square.x
                              + envsamp_floats(at + 32u) * n.square.y
                              + envsamp_floats(at + 40u) * n.square.z;
    precise float4 mixed = envsamp_floats(at + 48u) * n.product.x
                               + envsamp_floats(at + 56u) * n.product.y
                               + envsamp_floats(at + 64u) * n.product.z;
    precise float4 square = even + mixed;

    return float4(envsamp_weight(mean.x, square.x), envsamp_weight(mean.y, square.y),
                envsamp_weight(mean.z, square.z), envsamp_weight(mean.w, square.w));
}

envsamp_weights envsamp_weigh(uint node, envsamp_normal n)
{
    float4 low = envsamp_weigh_side(node + ENVSAMP_FACING_MOMENTS, n);
    float4 high = envsamp_weigh_side(node + ENVSAMP_FACING_MOMENTS + 4u, n);

    high.w = high.w + ENVSAMP_LEAST_WEIGHT;
    return envsamp_weights_of(low, high, low + high);
}

envsamp_walk envsamp_facing_side(uint cut, float low, float high, envsamp_walk walk)
{
    envsamp_walk next = walk;
    bool down = cut >= ENVSAMP_INNER;
    float number = down ? walk.f.y : walk.f.x;
    precise float place = number * (low + high);
    bool upper = place >= low;
    float start = upper ? low : 0.0;
    float size = upper ? high : low;
    float stretched = envsamp_quotient(place - start, size);
    float at = asfloat(cut & ENVSAMP_SIZE);

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
    precise float u = low + f * (high - low);

    return envsamp_clamp_unit(envsamp_at_most(u, envsamp_below(high)));
}

/* Numbers with which light alone draws what light x cosine should, and in z what that multiplies
   the density by. */
float3 envsamp_facing_warp(envsamp_normal n, float u0, float u1)
{
    envsamp_walk walk = envsamp_walk_of(float2(u0, u1), float4(0.0, 1.0, 0.0, 1.0), 0u);
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
    ratio = envsamp_saturate(ratio) * asfloat(link);
    return float3(envsamp_facing_number(walk.bound.x, walk.bound.y, walk.f.x),
                envsamp_facing_number(walk.bound.z, walk.bound.w, walk.f.y), ratio);
}

/* Light x cosine about a normal, of any length from 1e-37 to 1e38; light alone for what is none
   and of a table without `facing`. */
envsamp_sample envsamp_kd_sample_facing(float3 normal, float u0, float u1)
{
    envsamp_normal n = envsamp_prepare_normal(normal);
    float3 f = float3(envsamp_clamp_unit(u0), envsamp_clamp_unit(u1), 1.0);

    if (n.valid) {
        f = envsamp_facing_warp(n, f.x, f.y);
    }
    envsamp_sample s = envsamp_kd_sample(f.x, f.y);

    s.pdf = envsamp_at_most(s.pdf * f.z, ENVSAMP_MOST);
    return s;
}

float envsamp_kd_pdf_facing(float3 normal, float3 dir)
{
    envsamp_normal n = envsamp_prepare_normal(normal);
    uint3 density = envsamp_kd_density(dir);
    uint2 place = density.xy;
    float pdf = asfloat(density.z);
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
    ratio = pdf * envsamp_saturate(ratio) * asfloat(link);
    return envsamp_at_most(ratio, ENVSAMP_MOST);
}

/* ---- cdf: header, in words; a place is a number of bytes in two words ---- */

static const uint ENVSAMP_CDF_MAGIC = 0x434b5345u;
static const uint ENVSAMP_CDF_VERSION = 5u;
static const uint ENVSAMP_CDF_WIDTH = 6u;
static const uint ENVSAMP_CDF_HEIGHT = 7u;
static const uint ENVSAMP_CDF_IMAGE_WIDTH = 8u;
static const uint ENVSAMP_CDF_ROW_BITS = 10u;
static const uint ENVSAMP_CDF_GUIDE_BITS = 11u;
static const uint ENVSAMP_CDF_INVERSE_WIDTH = 12u;
static const uint ENVSAMP_CDF_ROW_SCALE = 13u;
static const uint ENVSAMP_CDF_OFFSET = 14u;
static const uint ENVSAMP_CDF_BILINEAR = 15u;
static const uint ENVSAMP_CDF_ROWS_AT = 16u;
static const uint ENVSAMP_CDF_ROW_EDGES_AT = 18u;
static const uint ENVSAMP_CDF_EDGES_AT = 20u;
static const uint ENVSAMP_CDF_ROW_GUIDE_AT = 22u;
static const uint ENVSAMP_CDF_GUIDE_AT = 24u;
static const uint ENVSAMP_CDF_WALK = 4u;

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
    float density = asfloat(envsamp_cdf_word(envsamp_cdf_words_at(ENVSAMP_CDF_ROWS_AT)
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
    float offset = asfloat(envsamp_cdf_word(ENVSAMP_CDF_OFFSET));
    float inverse = asfloat(envsamp_cdf_word(ENVSAMP_CDF_INVERSE_WIDTH));
    float x0 = max(float(column) - offset, 0.0);
    float x1 = min(float(column) - offset + 1.0, float(envsamp_cdf_word(ENVSAMP_CDF_IMAGE_WIDTH)));
    float north = asfloat(envsamp_cdf_word(rows));
    float south = asfloat(envsamp_cdf_word(rows + 1u));
    precise float x = (x0 + fx * (x1 - x0)) * inverse;
    precise float cap = north
                              + fy * (asfloat(envsamp_cdf_word(rows + 3u)) - north);
    precise float rest = south
                               + fy * (asfloat(envsamp_cdf_word(rows + 4u)) - south);

    return envsamp_point_sample(envsamp_mapping(envsamp_cdf_word(3u)),
                                envsamp_point_of(x, cap, rest),
                                envsamp_cdf_density(column, row, edges + column), edges + column);
}

float envsamp_cdf_pdf(float3 dir)
{
    uint mapping = envsamp_mapping(envsamp_cdf_word(3u));
    float r = envsamp_ring(dir);
    float3 d = envsamp_grid_coords(mapping, dir, r);
    float offset = asfloat(envsamp_cdf_word(ENVSAMP_CDF_OFFSET));
    float scale = asfloat(envsamp_cdf_word(ENVSAMP_CDF_ROW_SCALE));
    float width = float(envsamp_cdf_word(ENVSAMP_CDF_IMAGE_WIDTH));
    float u = 0.25 * d.x;
    float v = 0.5 * d.y;

    if (d.z == 0.0) {
        return 0.0;
    }
    if (mapping != ENVSAMP_OCTAHEDRAL) {
        precise float t = 1.0 - 2.0 * envsamp_quotient(abs(dir.z), r + abs(dir.z));
        precise float s = t * t;
        precise float s2 = s * s;

        t = t * (((0.318309882 - s * 0.106102533) + s2 * (0.0636398678 - s * 0.0452227112))
               + s2 * s2 * (((0.0339148928 - s * 0.0239804388)
                           + s2 * (0.0136998603 - s * 0.005183045)) + s2 * s2 * 0.000924230142));
        u = envsamp_turn(dir.y, dir.x);
        v = 0.5 - envsamp_copy_sign(0.25 - t, dir.z);
        if (mapping == ENVSAMP_HEMISPHERE && v > 0.5) {
            return 0.0;
        }
    }
    precise float x = u * width + offset;
    precise float y = v * scale + offset;
    uint column = envsamp_index(x, envsamp_cdf_word(ENVSAMP_CDF_WIDTH));
    uint row = envsamp_index(y, envsamp_cdf_word(ENVSAMP_CDF_HEIGHT));

    return envsamp_cdf_density(column, row, envsamp_cdf_edges(row) + column);
}
