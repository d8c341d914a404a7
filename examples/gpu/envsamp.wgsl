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

const ENVSAMP_OCTAHEDRAL: u32 = 2u;
const ENVSAMP_HEMISPHERE: u32 = 1u;
const ENVSAMP_ALIAS: u32 = 1u;
const ENVSAMP_FIT: u32 = 2u;
const ENVSAMP_INNER: u32 = 0x80000000u;         /* of a link: not a density */
const ENVSAMP_SIZE: u32 = 0x7fffffffu;          /* bits of a float without its sign */
const ENVSAMP_UNIT: f32 = 16777216.0;          /* 2^24 */
const ENVSAMP_TINY: f32 = 1.17549435e-38;      /* the least normal float, */
const ENVSAMP_MOST: f32 = 3.40282346e+38;      /* and the largest */

/* dir: unit. pdf: per steradian. uv: where in the map. block: what was drawn, as the place of its
   density in words; of cdf, of its texel's edge. */
struct envsamp_sample {
    dir: vec3f,
    pdf: f32,
    uv: vec2f,
    block: u32,
}

/* Azimuth in turns, 1 - cos theta, 1 + cos theta; of octahedral maps u and v. */
struct envsamp_point {
    x: f32,
    north: f32,
    south: f32,
}

/* A block, and where in it a sample lies, [0, 1]. */
struct envsamp_choice {
    block: u32,
    fx: f32,
    fy: f32,
}

/* ---- small math ---- */

fn envsamp_sign(size: f32, negative: u32) -> f32 {
    return bitcast<f32>((bitcast<u32>(size) & ENVSAMP_SIZE) | (negative << 31u));
}

fn envsamp_copy_sign(size: f32, other: f32) -> f32 {
    return envsamp_sign(size, bitcast<u32>(other) >> 31u);
}

/* |x|, but no more than `most`: that for a NaN. */
fn envsamp_at_most(x: f32, most: f32) -> f32 {
    return bitcast<f32>(min(bitcast<u32>(x) & ENVSAMP_SIZE, bitcast<u32>(most)));
}

/* To [0, 1), whatever it is. */
fn envsamp_clamp_unit(u: f32) -> f32 {
    return bitcast<f32>(min(bitcast<u32>(u) & ENVSAMP_SIZE, 0x3f7fffffu));
}

/* To [0, 1]; negative numbers and NaN count as 0. */
fn envsamp_saturate(x: f32) -> f32 {
    let bits: u32 = bitcast<u32>(x);
    let most: u32 = min(bits, 0x3f800000u);

    return select(0.0, bitcast<f32>(most), bits <= 0x7f800000u);
}

/* 0 for -0; a compiler may drop an added 0. */
fn envsamp_plus_zero(x: f32) -> f32 {
    return select(x, 0.0, bitcast<u32>(x) == ENVSAMP_INNER);
}

/* The next float below a number above 0. */
fn envsamp_below(x: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) - 1u);
}

fn envsamp_power_of_2(exponent: u32) -> f32 {
    return bitcast<f32>((exponent + 127u) << 23u);
}

fn envsamp_index(x: f32, count: u32) -> u32 {
    return min(u32(max(x, 0.0)), count - 1u);
}

/* 1 for positive numbers and 0, 0 for negative ones and -0. */
fn envsamp_positive(t: f32) -> f32 {
    return 0.5 + envsamp_copy_sign(0.5, t);
}

/* The quotients and roots that blocks depend on, but for those of FIT. */
fn envsamp_quotient(a: f32, b: f32) -> f32 {
    return a / b;
}

fn envsamp_root(square: f32) -> f32 {
    return sqrt(square);
}

/* Cosine and sine of u turns. */
fn envsamp_cos_sin_turn(u: f32) -> vec2f {
    let h: f32 = u - 0.5;
    let t: f32 = h * h;
    let t2: f32 = t * t;
    let s: f32 = h * (3.14159258 - t * 5.16770690 + t2 * (2.55003164 - t * 0.598046450
                                 + t2 * 0.0772222480));
    let c: f32 = (1.0 - 4.0 * t) * (0.999999945 - t * 0.934791803 + t2 * (0.319215031
                                 - t * 0.0548052368));
    let cosine: f32 = s * s - c * c;
    let sine: f32 = -2.0 * s * c;

    return vec2f(cosine, sine);
}

/* Arc tangent of t in turns, 0 <= t <= 1. */
fn envsamp_octant_turn(t: f32) -> f32 {
    let s: f32 = t * t;
    let turn: f32 = t * (0.159154941 + s * (-0.0530512667 + s * (0.0318199339
            + s * (-0.0226113556 + s * (0.0169574464 + s * (-0.0119902194
            + s * (0.00684993014 + s * (-0.00259152250 + s * 0.000462115071))))))));

    return turn;
}

/* Angle of (x, y) in turns, [0, 1]. */
fn envsamp_turn(y: f32, x: f32) -> f32 {
    let ax: f32 = abs(x);
    let ay: f32 = abs(y);
    let big: f32 = max(ax, ay);
    let ratio: f32 = envsamp_quotient(min(ax, ay), max(big, ENVSAMP_TINY));
    var turn: f32 = envsamp_octant_turn(ratio);

    if (ay > ax) {
        turn = 0.25 - turn;
    }
    if (x < 0.0) {
        turn = 0.5 - turn;
    }
    return select(turn, 1.0 - turn, y < 0.0);
}

/* Polar angle over pi from 1 - cos and 1 + cos of it. */
fn envsamp_polar_fraction(north: f32, south: f32) -> f32 {
    let t: f32 = abs(min(north, south));
    let q: f32 = sqrt(t);
    let t2: f32 = t * t;
    let low: f32 = 0.450158207 + t * 0.0375087059 + t2 * (0.00850684985
                                   + t * 0.00214716597);
    let v: f32 = q * (low + t2 * t2 * (0.00178524512 - t * 0.000837066695
                                   + t2 * 0.000730843713));

    return 0.5 - envsamp_copy_sign(0.5 - v, south - north);
}

/* Sine of t quarter turns, 0 <= t <= 1. */
fn envsamp_sin_quarter(t: f32) -> f32 {
    let s: f32 = t * t;
    let s2: f32 = s * s;
    let sine: f32 = t * ((1.57079625 - s * 0.645963371)
                                    + s2 * (0.0796884820 - s * 0.00467222789
                                    + s2 * 0.000150820561));

    return sine;
}

fn envsamp_octahedral_dir(u: f32, v: f32) -> vec3f {
    let a: f32 = 2.0 * u - 1.0;
    let b: f32 = 2.0 * v - 1.0;
    let rest_a: f32 = 1.0 - abs(a);
    let rest_b: f32 = 1.0 - abs(b);
    let p: f32 = min(abs(a), rest_b);
    let q: f32 = min(abs(b), rest_a);
    let r: f32 = p + q;
    let inverse: f32 = 1.0 / (r + ENVSAMP_TINY);
    let s: f32 = r * r;
    let s2: f32 = s * s;
    let ring: f32 = r * ((1.41421378 - s * 0.353563577)
                                    - s2 * (0.0440602601 + s * 0.0118305748)
                                    - s2 * s2 * ((0.00107195461 + s * 0.00519226724)
                                               - s2 * (0.00310698547 - s * 0.00160211383)));

    return vec3f(envsamp_copy_sign(ring * envsamp_sin_quarter(p * inverse), a),
                envsamp_copy_sign(ring * envsamp_sin_quarter(q * inverse), b),
                envsamp_copy_sign(1.0 - s, rest_b - abs(a)));
}

/* u and v in a direction of any length; r is |(x, y)|. */
fn envsamp_octahedral_uv(dir: vec3f, r: f32) -> vec2f {
    let size: vec3f = abs(dir);
    let across: f32 = envsamp_quotient(min(size.x, size.y), max(size.x, size.y) + ENVSAMP_TINY);
    let down: f32 = envsamp_quotient(min(r, size.z), max(r, size.z) + ENVSAMP_TINY);
    let turn: f32 = min(4.0 * envsamp_octant_turn(down), 0.5);
    var w: f32 = abs(1.0 - envsamp_positive(size.z - r) - turn);
    var s: f32 = w * w;
    var p: f32 = w * ((0.555360375 - s * 0.0570955985)
                                 + s * s * (0.00176060538 - s * 2.53690523e-05));
    var q: f32 = min(4.0 * envsamp_octant_turn(across), 0.5);

    w = min(p, 0.5);
    q = w * abs(envsamp_positive(size.y - size.x) - q);
    s = envsamp_positive(envsamp_plus_zero(dir.z));
    p = abs(s * w - q);
    q = w - p;
    return vec2f(abs(envsamp_positive(dir.x) - abs(0.5 * s - p)),
                abs(envsamp_positive(dir.y) - abs(0.5 * s - q)));
}

/* ---- points of a block ---- */

/* 1 - cos theta and 1 + cos theta of an edge as a table stores it. */
fn envsamp_edge_pair(edge: u32) -> vec2f {
    let cap: f32 = bitcast<f32>(edge & ENVSAMP_SIZE);
    let rest: f32 = 2.0 - cap;
    let south: bool = edge >= ENVSAMP_INNER;

    return select(vec2f(cap, rest), vec2f(rest, cap), south);
}

/* edge: x0, x1, y0, y1 as stored. */
fn envsamp_between(edge: vec4u, fx: f32, fy: f32) -> envsamp_point {
    let top: vec2f = envsamp_edge_pair(edge.z);
    let end: vec2f = envsamp_edge_pair(edge.w);
    let x0: f32 = bitcast<f32>(edge.x);
    let x: f32 = x0 + fx * (bitcast<f32>(edge.y) - x0);
    let north: f32 = top.x + fy * (end.x - top.x);
    let south: f32 = top.y + fy * (end.y - top.y);

    return envsamp_point(x, north, south);
}

fn envsamp_mapping(stored: u32) -> u32 {
    return select(stored, ENVSAMP_MAPPING, ENVSAMP_MAPPING < 3u);
}

fn envsamp_point_sample(mapping: u32, p: envsamp_point, pdf: f32, block: u32) -> envsamp_sample {
    let x: f32 = envsamp_clamp_unit(p.x);
    var uv: vec2f = vec2f(x, p.north);
    let around: vec2f = envsamp_cos_sin_turn(x);
    let sine: f32 = sqrt(abs(p.north * p.south));
    var dir: vec3f = vec3f(around.x * sine, around.y * sine, 0.5 * (p.south - p.north));

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
fn envsamp_grid_coords(mapping: u32, dir: vec3f, r: f32) -> vec3f {
    let side: f32 = abs(dir.x) + abs(dir.y);
    let sum: f32 = r + abs(dir.z);
    let valid: bool = bitcast<u32>(side) < 0x7f800000u && bitcast<u32>(sum) - 1u < 0x7f7fffffu;
    var t: f32 = envsamp_quotient(abs(dir.y), max(side, ENVSAMP_TINY));
    var q: f32 = envsamp_quotient(r, max(sum, ENVSAMP_TINY));

    if (!valid) {
        return vec3f(0.0, 0.0, 0.0);
    }
    if (mapping == ENVSAMP_OCTAHEDRAL) {
        let plain: vec3f = vec3f(envsamp_plus_zero(dir.x), envsamp_plus_zero(dir.y), dir.z);
        let uv: vec2f = envsamp_octahedral_uv(plain, r);

        return vec3f(4.0 * uv.x, 2.0 * uv.y, 1.0);
    }
    t = 2.0 - envsamp_copy_sign(1.0 + envsamp_copy_sign(1.0, dir.x)
                                - envsamp_copy_sign(t, dir.x), dir.y);
    q = 1.0 - envsamp_copy_sign(1.0 - q, dir.z);
    if (!(side > 0.0)) {
        t = 0.0;
    }
    if (mapping == ENVSAMP_HEMISPHERE && q > 1.0) {
        return vec3f(0.0, 0.0, 0.0);
    }
    return vec3f(t, q, 1.0);
}

/* |(x, y)| */
fn envsamp_ring(dir: vec3f) -> f32 {
    let square: f32 = dir.x * dir.x + dir.y * dir.y;

    return envsamp_root(square);
}

/* ---- kd: header, in words ---- */

const ENVSAMP_KD_MAGIC: u32 = 0x444b5345u;
const ENVSAMP_KD_VERSION: u32 = 6u;
const ENVSAMP_KD_SELECT: u32 = 6u;
const ENVSAMP_KD_TILE_BITS: u32 = 7u;           /* x, then y */
const ENVSAMP_KD_ALIAS_SHIFT: u32 = 9u;
const ENVSAMP_KD_ALIAS_AT: u32 = 10u;
const ENVSAMP_KD_GRID: u32 = 11u;               /* bits of x, of y, place */
const ENVSAMP_KD_MODEL: u32 = 14u;
const ENVSAMP_KD_FIT_ALPHA: u32 = 15u;
const ENVSAMP_KD_FIT_END: u32 = 16u;
const ENVSAMP_KD_FIT_TOTAL: u32 = 26u;          /* a double */
const ENVSAMP_KD_FACING_COUNT: u32 = 42u;
const ENVSAMP_KD_FACING_AT: u32 = 43u;
const ENVSAMP_KD_RECORDS: u32 = 48u;

/* What keeps this shader from sampling the table: 0 nothing, 1 no table of envsamp_kd, 2 another
   version, 3 another mapping than it is built for, 4 FIT with POWER, which it has no code for. */
fn envsamp_kd_problem() -> u32 {
    let mapping: u32 = envsamp_word(3u);

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

fn envsamp_edges(at: u32) -> vec4u {
    return vec4u(envsamp_word(at), envsamp_word(at + 1u), envsamp_word(at + 2u),
                 envsamp_word(at + 3u));
}

/* ---- kd: WARP ---- */

/* A region on the way down: edges x0, x1, y0, y1 in its tile's unit square and in the map, its
   link, and the word that has it. */
struct envsamp_region {
    cut: vec4f,
    edge: vec4u,
    link: u32,
    place: u32,
}

/* The side of its next cut that f is on. */
fn envsamp_take_side(r: envsamp_region, f: vec2f) -> envsamp_region {
    var side: envsamp_region = r;
    let at: u32 = r.link & ENVSAMP_SIZE;
    let bits: u32 = envsamp_word(at);
    let edge: u32 = envsamp_word(at + 1u);
    let cut: f32 = bitcast<f32>(bits & ENVSAMP_SIZE);
    let down: bool = bits >= ENVSAMP_INNER;
    let number: f32 = select(f.x, f.y, down);
    let high: bool = number >= cut;

    if (down) {
        side.cut.z = select(r.cut.z, cut, high);
        side.cut.w = select(cut, r.cut.w, high);
        side.edge.z = select(r.edge.z, edge, high);
        side.edge.w = select(edge, r.edge.w, high);
    } else {
        side.cut.x = select(r.cut.x, cut, high);
        side.cut.y = select(cut, r.cut.y, high);
        side.edge.x = select(r.edge.x, edge, high);
        side.edge.y = select(edge, r.edge.y, high);
    }
    side.place = select(at + 2u, at + 3u, high);
    side.link = envsamp_word(side.place);
    return side;
}

fn envsamp_warp_sample(u0: f32, u1: f32) -> envsamp_sample {
    let bits_x: u32 = envsamp_word(ENVSAMP_KD_TILE_BITS);
    let bits_y: u32 = envsamp_word(ENVSAMP_KD_TILE_BITS + 1u);
    let across: f32 = u0 * envsamp_power_of_2(bits_x);
    let down: f32 = u1 * envsamp_power_of_2(bits_y);
    let column: u32 = u32(across);
    let row: u32 = u32(down);
    let f: vec2f = vec2f(across - f32(column), down - f32(row));
    let at: u32 = ENVSAMP_KD_RECORDS + 5u * ((row << bits_x) + column);
    var r: envsamp_region = envsamp_region(vec4f(0.0, 1.0, 0.0, 1.0), envsamp_edges(at),
                                      envsamp_word(at + 4u), at + 4u);

    while (r.link >= ENVSAMP_INNER) {
        r = envsamp_take_side(r, f);
    }
    let fx: f32 = (f.x - r.cut.x) / (r.cut.y - r.cut.x);
    let fy: f32 = (f.y - r.cut.z) / (r.cut.w - r.cut.z);
    let p: envsamp_point = envsamp_between(r.edge, fx, fy);

    return envsamp_point_sample(envsamp_mapping(envsamp_word(3u)), p, bitcast<f32>(r.link),
                                r.place);
}

/* ---- kd: ALIAS and FIT ---- */

fn envsamp_alias_choose(u0: f32, u1: f32) -> envsamp_choice {
    let shift: u32 = envsamp_word(ENVSAMP_KD_ALIAS_SHIFT);
    let bits_x: u32 = 12u - (shift >> 1u);
    let across: f32 = u0 * envsamp_power_of_2(bits_x);
    let column: u32 = u32(across);
    let y: u32 = u32(u1 * ENVSAMP_UNIT);
    let bin: u32 = ((y >> shift) & (0xffffffffu << bits_x)) | column;
    let entry: u32 = envsamp_word((envsamp_word(ENVSAMP_KD_ALIAS_AT) >> 2u) + bin);
    var block: u32 = entry & (0xffffffu >> shift);
    let own: u32 = entry ^ block;                       /* of 2^24 */
    let mixed: u32 = (y << (32u - (shift + bits_x))) ^ (~bin * 0x9e3779b9u);
    let place: u32 = mixed >> 8u;
    var fy: f32 = f32(place - own) / f32(0x1000000u - own);

    if (place < own) {
        fy = f32(own - place) / f32(own);
        block = bin;
    }
    return envsamp_choice(block, across - f32(column), fy);
}

/* a * b, the upper 32 bits first, by halves: not every language has the whole product. */
fn envsamp_product(a: u32, b: u32) -> vec2u {
    let low: u32 = (a & 0xffffu) * (b & 0xffffu);
    let middle: u32 = (a >> 16u) * (b & 0xffffu) + (low >> 16u);
    let other: u32 = (a & 0xffffu) * (b >> 16u) + (middle & 0xffffu);

    return vec2u((a >> 16u) * (b >> 16u) + (middle >> 16u) + (other >> 16u),
                 (other << 16u) | (low & 0xffffu));
}

/* A double from 2^-10 to 2^7 in units of 2^-56, the upper 32 bits first. */
fn envsamp_fixed(at: u32) -> vec2u {
    let low: u32 = envsamp_word(at);
    let bits: u32 = envsamp_word(at + 1u);
    let high: u32 = (bits & 0xfffffu) | 0x100000u;
    let exponent: u32 = (bits >> 20u) & 0x7ffu;

    if (exponent >= 1019u) {
        let up: u32 = min(exponent - 1019u, 11u);

        return vec2u((high << up) | ((low >> 1u) >> (31u - up)), low << up);
    }
    let down: u32 = min(1019u - exponent, 20u);

    return vec2u(high >> down, (low >> down) | (high << (32u - down)));
}

/* u0, continued by what u1 holds beyond its leading 12 bits, times a number, both in fixed point:
   C has doubles here. In units of 2^-48, the upper 32 bits first. */
fn envsamp_fit_product(u0: f32, u1: f32, total: vec2u) -> vec2u {
    let low: f32 = u1 * 4096.0 + 0.5;
    let whole: f32 = floor(u0 * ENVSAMP_UNIT);
    let more: f32 = (u0 * ENVSAMP_UNIT - whole) + (low - floor(low));
    let upper: u32 = u32(whole) + u32(more);
    let lower: u32 = u32((more - floor(more)) * ENVSAMP_UNIT);
    let g: vec2u = envsamp_product(upper, total.x);
    let second: u32 = envsamp_product(upper, total.y).x;
    let third: vec2u = envsamp_product(lower, total.x);
    let rest: u32 = (third.x << 8u) | (third.y >> 24u);
    let sum: u32 = g.y + second;
    let all: u32 = sum + rest;

    return vec2u(g.x + u32(sum < second) + u32(all < rest), all);
}

/* The natural logarithm of 1 + f / a, within 2e-7 of itself. */
fn envsamp_log_ratio(f: f32, a: f32) -> f32 {
    var w: f32 = f / (2.0 * a + f);
    var k: f32 = 0.0;

    if (w > 0.17) {                     /* 1 + f / a = m 2^k, m from sqrt(1/2) to sqrt(2) */
        let bits: u32 = bitcast<u32>(1.0 + f / a);
        let exponent: u32 = (bits - 0x3f3504f3u) >> 23u;
        let m: f32 = bitcast<f32>(bits - (exponent << 23u));

        w = (m - 1.0) / (m + 1.0);
        k = f32(exponent);
    }
    let t: f32 = w * w;

    return k * 0.693147181 + 2.0 * w * (1.0 + t * (0.333333333 + t * (0.2 + t * (0.142857143
         + t * 0.111111111))));
}

/* How far into a bin the model's mass has come at the fraction f of it; a: alpha plus its index. */
fn envsamp_fit_position(f: f32, a: f32) -> f32 {
    let w: f32 = f / (2.0 * a + f);
    let v: f32 = 1.0 / (2.0 * a + 1.0);
    let t: f32 = w * w;
    let s: f32 = v * v;
    let up: f32 = 1.0 + t * (0.333333333 + t * (0.2 + t * (0.142857143
                                   + t * 0.111111111)));
    let down: f32 = 1.0 - s * (0.333333333 + s * (0.0888888889 + s * (0.0465608466
                                     + s * 0.0301940035)));
    var place: f32 = (2.0 * a + 1.0) * w * up * down;

    if (a < 1.0) {
        place = envsamp_log_ratio(f, a) / envsamp_log_ratio(1.0, a);
    }
    return place;
}

fn envsamp_fit_choose(u0: f32, u1: f32) -> envsamp_choice {
    let alpha: f32 = bitcast<f32>(envsamp_word(ENVSAMP_KD_FIT_ALPHA));
    let end: f32 = bitcast<f32>(envsamp_word(ENVSAMP_KD_FIT_END));
    let g: vec2u = envsamp_fit_product(u0, u1, envsamp_fixed(ENVSAMP_KD_FIT_TOTAL));
    let f: f32 = f32(((g.x & 0xffffu) << 8u) | (g.y >> 24u)) / ENVSAMP_UNIT
                            + f32(g.y & 0xffffffu) / (ENVSAMP_UNIT * ENVSAMP_UNIT);
    let f2: f32 = f * f;
    let rest: f32 = f * (0.693147170 + f * 0.240227226 + f2 * (0.0554958479
                                    + f * 0.00965268772 + f2 * (0.00126865296
                                    + f * 0.000208404800)));
    let power: f32 = envsamp_power_of_2(g.x >> 16u);
    var x: f32 = alpha * ((power - 1.0) + power * rest);

    x = envsamp_at_most(max(x, 0.0), end);
    let block: u32 = u32(x);
    let fx: f32 = envsamp_fit_position(x - f32(block), alpha + f32(block));

    return envsamp_choice(block, fx, u1);
}

/* ---- kd ---- */

fn envsamp_kd_sample(u0: f32, u1: f32) -> envsamp_sample {
    let select: u32 = envsamp_word(ENVSAMP_KD_SELECT);
    let f0: f32 = envsamp_clamp_unit(u0);
    let f1: f32 = envsamp_clamp_unit(u1);

    if (select != ENVSAMP_ALIAS && select != ENVSAMP_FIT) {
        return envsamp_warp_sample(f0, f1);
    }
    var choice: envsamp_choice;

    if (select == ENVSAMP_FIT) {
        choice = envsamp_fit_choose(f0, f1);
    } else {
        choice = envsamp_alias_choose(f0, f1);
    }
    let at: u32 = ENVSAMP_KD_RECORDS + 5u * choice.block;
    let p: envsamp_point = envsamp_between(envsamp_edges(at), choice.fx, choice.fy);

    return envsamp_point_sample(envsamp_mapping(envsamp_word(3u)), p,
                                bitcast<f32>(envsamp_word(at + 4u)), at + 4u);
}

/* 1 where a place, its coordinates as bits, is on the higher side of a cut. */
fn envsamp_is_high(cut: u32, place: vec2u) -> u32 {
    let coordinate: u32 = select(place.x, place.y, cut >= ENVSAMP_INNER);

    return select(0u, 1u, coordinate >= (cut & ENVSAMP_SIZE));
}

/* The density in a direction as bits, in z, and its place in x and y. */
fn envsamp_kd_density(dir: vec3f) -> vec3u {
    let mapping: u32 = envsamp_mapping(envsamp_word(3u));
    let d: vec3f = envsamp_grid_coords(mapping, dir, envsamp_ring(dir));
    let bits_x: u32 = envsamp_word(ENVSAMP_KD_GRID);
    let bits_y: u32 = envsamp_word(ENVSAMP_KD_GRID + 1u);
    let scale_x: f32 = 0.25 * envsamp_power_of_2(bits_x);
    var scale_y: f32 = envsamp_power_of_2(bits_y);
    let place: vec2u = vec2u(bitcast<u32>(d.x), bitcast<u32>(d.y));

    if (mapping != ENVSAMP_HEMISPHERE) {
        scale_y = 0.5 * scale_y;
    }
    let column: u32 = envsamp_index(d.x * scale_x, 1u << bits_x);
    let row: u32 = envsamp_index(d.y * scale_y, 1u << bits_y);
    let cell: u32 = (row << bits_x) + column;
    var link: u32 = 0u;

    if (d.z > 0.0) {
        link = envsamp_word((envsamp_word(ENVSAMP_KD_GRID + 2u) >> 2u) + cell);
    }
    while (link >= ENVSAMP_INNER) {
        let at: u32 = link & ENVSAMP_SIZE;
        let top: u32 = envsamp_is_high(envsamp_word(at), place);
        let side: u32 = envsamp_is_high(envsamp_word(at + 1u + top), place);

        link = envsamp_word(at + 3u + 2u * top + side);
    }
    return vec3u(place.x, place.y, link);
}

fn envsamp_kd_pdf(dir: vec3f) -> f32 {
    return bitcast<f32>(envsamp_kd_density(dir).z);
}

/* ---- kd: light x cosine ---- */

const ENVSAMP_LEAST_WEIGHT: f32 = 1e-30;
const ENVSAMP_FACING_EDGES: u32 = 7u;           /* words of a node, behind its cuts */
const ENVSAMP_FACING_CHILDREN: u32 = 14u;
const ENVSAMP_FACING_MOMENTS: u32 = 22u;

/* A normal, its squares, and xy, xz, yz. */
struct envsamp_normal {
    first: vec3f,
    square: vec3f,
    product: vec3f,
    valid: bool,
}

/* Weights of the parts of a node, lower and higher ones, and of pairs of them. */
struct envsamp_weights {
    low: vec4f,
    high: vec4f,
    pair: vec4f,
}

/* Two numbers on the way down, the part of the unit square so far, x0, x1, y0, y1, and the side
   that was taken last. */
struct envsamp_walk {
    f: vec2f,
    bound: vec4f,
    side: u32,
}

fn envsamp_prepare_normal(normal: vec3f) -> envsamp_normal {
    let x: u32 = bitcast<u32>(normal.x) & ENVSAMP_SIZE;
    let y: u32 = bitcast<u32>(normal.y) & ENVSAMP_SIZE;
    let z: u32 = bitcast<u32>(normal.z) & ENVSAMP_SIZE;
    let most: u32 = max(max(x, y), z);
    let valid: bool = most >= 0x00800000u && most < 0x7f800000u
              && envsamp_word(ENVSAMP_KD_FACING_COUNT) > 0u;
    let size: f32 = bitcast<f32>(most);
    var n: vec3f = vec3f(0.0, 0.0, 0.0);

    if (valid) {
        n = vec3f(envsamp_quotient(normal.x, size), envsamp_quotient(normal.y, size),
                 envsamp_quotient(normal.z, size));
    }
    let square: vec3f = vec3f(n.x * n.x, n.y * n.y, n.z * n.z);
    let product: vec3f = vec3f(n.x * n.y, n.x * n.z, n.y * n.z);

    return envsamp_normal(n, square, product, valid);
}

fn envsamp_floats(at: u32) -> vec4f {
    return vec4f(bitcast<f32>(envsamp_word(at)), bitcast<f32>(envsamp_word(at + 1u)),
                bitcast<f32>(envsamp_word(at + 2u)), bitcast<f32>(envsamp_word(at + 3u)));
}

fn envsamp_weight(mean: f32, square: f32) -> f32 {
    let weight: f32 = mean + envsamp_root(max(square, 0.0));

    return select(0.0, weight, weight > ENVSAMP_LEAST_WEIGHT);
}

fn envsamp_weigh_side(at: u32, n: envsamp_normal) -> vec4f {
    let mean: vec4f = envsamp_floats(at) * n.first.x
                              + envsamp_floats(at + 8u) * n.first.y
                              + envsamp_floats(at + 16u) * n.first.z;
    let even: vec4f = envsamp_floats(at + 24u) * n.square.x
                              + envsamp_floats(at + 32u) * n.square.y
                              + envsamp_floats(at + 40u) * n.square.z;
    let mixed: vec4f = envsamp_floats(at + 48u) * n.product.x
                               + envsamp_floats(at + 56u) * n.product.y
                               + envsamp_floats(at + 64u) * n.product.z;
    let square: vec4f = even + mixed;

    return vec4f(envsamp_weight(mean.x, square.x), envsamp_weight(mean.y, square.y),
                envsamp_weight(mean.z, square.z), envsamp_weight(mean.w, square.w));
}

fn envsamp_weigh(node: u32, n: envsamp_normal) -> envsamp_weights {
    let low: vec4f = envsamp_weigh_side(node + ENVSAMP_FACING_MOMENTS, n);
    var high: vec4f = envsamp_weigh_side(node + ENVSAMP_FACING_MOMENTS + 4u, n);

    high.w = high.w + ENVSAMP_LEAST_WEIGHT;
    return envsamp_weights(low, high, low + high);
}

fn envsamp_facing_side(cut: u32, low: f32, high: f32, walk: envsamp_walk) -> envsamp_walk {
    var next: envsamp_walk = walk;
    let down: bool = cut >= ENVSAMP_INNER;
    let number: f32 = select(walk.f.x, walk.f.y, down);
    let place: f32 = number * (low + high);
    let upper: bool = place >= low;
    let start: f32 = select(0.0, low, upper);
    let size: f32 = select(low, high, upper);
    let stretched: f32 = envsamp_quotient(place - start, size);
    let at: f32 = bitcast<f32>(cut & ENVSAMP_SIZE);

    if (down) {
        next.f.y = envsamp_clamp_unit(stretched);
        next.bound.z = select(walk.bound.z, at, upper);
        next.bound.w = select(at, walk.bound.w, upper);
    } else {
        next.f.x = envsamp_clamp_unit(stretched);
        next.bound.x = select(walk.bound.x, at, upper);
        next.bound.y = select(at, walk.bound.y, upper);
    }
    next.side = select(0u, 1u, upper);
    return next;
}

/* Back in the whole unit square, below the higher bound. */
fn envsamp_facing_number(low: f32, high: f32, f: f32) -> f32 {
    let u: f32 = low + f * (high - low);

    return envsamp_clamp_unit(envsamp_at_most(u, envsamp_below(high)));
}

/* Numbers with which light alone draws what light x cosine should, and in z what that multiplies
   the density by. */
fn envsamp_facing_warp(n: envsamp_normal, u0: f32, u1: f32) -> vec3f {
    var walk: envsamp_walk = envsamp_walk(vec2f(u0, u1), vec4f(0.0, 1.0, 0.0, 1.0), 0u);
    var node: u32 = envsamp_word(ENVSAMP_KD_FACING_AT) >> 2u;
    var link: u32 = ENVSAMP_INNER;
    var ratio: f32 = 1.0;

    while (link >= ENVSAMP_INNER) {
        let w: envsamp_weights = envsamp_weigh(node, n);
        let low: f32 = w.pair.x + w.pair.y;
        let high: f32 = w.pair.z + w.pair.w;

        walk = envsamp_facing_side(envsamp_word(node), low, high, walk);
        var at: u32 = walk.side;

        walk = envsamp_facing_side(envsamp_word(node + 1u + at), w.pair[2u * at],
                                   w.pair[2u * at + 1u], walk);
        at = 2u * at + walk.side;
        walk = envsamp_facing_side(envsamp_word(node + 3u + at), w.low[at], w.high[at], walk);
        var weight: f32 = w.low[at];

        if (walk.side == 1u) {
            weight = w.high[at];
        }
        ratio = ratio * (weight / (low + high));
        link = envsamp_word(node + ENVSAMP_FACING_CHILDREN + 4u * walk.side + at);
        node = link & ENVSAMP_SIZE;
    }
    ratio = envsamp_saturate(ratio) * bitcast<f32>(link);
    return vec3f(envsamp_facing_number(walk.bound.x, walk.bound.y, walk.f.x),
                envsamp_facing_number(walk.bound.z, walk.bound.w, walk.f.y), ratio);
}

/* Light x cosine about a normal, of any length from 1e-37 to 1e38; light alone for what is none
   and of a table without `facing`. */
fn envsamp_kd_sample_facing(normal: vec3f, u0: f32, u1: f32) -> envsamp_sample {
    let n: envsamp_normal = envsamp_prepare_normal(normal);
    var f: vec3f = vec3f(envsamp_clamp_unit(u0), envsamp_clamp_unit(u1), 1.0);

    if (n.valid) {
        f = envsamp_facing_warp(n, f.x, f.y);
    }
    var s: envsamp_sample = envsamp_kd_sample(f.x, f.y);

    s.pdf = envsamp_at_most(s.pdf * f.z, ENVSAMP_MOST);
    return s;
}

fn envsamp_kd_pdf_facing(normal: vec3f, dir: vec3f) -> f32 {
    let n: envsamp_normal = envsamp_prepare_normal(normal);
    let density: vec3u = envsamp_kd_density(dir);
    let place: vec2u = density.xy;
    let pdf: f32 = bitcast<f32>(density.z);
    var node: u32 = envsamp_word(ENVSAMP_KD_FACING_AT) >> 2u;
    var link: u32 = ENVSAMP_INNER;
    var ratio: f32 = 1.0;

    if (!n.valid || density.z == 0u) {
        return pdf;
    }
    while (link >= ENVSAMP_INNER) {
        let w: envsamp_weights = envsamp_weigh(node, n);
        let edges: u32 = node + ENVSAMP_FACING_EDGES;
        var at: u32 = envsamp_is_high(envsamp_word(edges), place);

        at = 2u * at + envsamp_is_high(envsamp_word(edges + 1u + at), place);
        let side: u32 = envsamp_is_high(envsamp_word(edges + 3u + at), place);
        var weight: f32 = w.low[at];

        if (side == 1u) {
            weight = w.high[at];
        }
        ratio = ratio * (weight / ((w.pair.x + w.pair.y) + (w.pair.z + w.pair.w)));
        link = envsamp_word(node + ENVSAMP_FACING_CHILDREN + 4u * side + at);
        node = link & ENVSAMP_SIZE;
    }
    ratio = pdf * envsamp_saturate(ratio) * bitcast<f32>(link);
    return envsamp_at_most(ratio, ENVSAMP_MOST);
}

/* ---- cdf: header, in words; a place is a number of bytes in two words ---- */

const ENVSAMP_CDF_MAGIC: u32 = 0x434b5345u;
const ENVSAMP_CDF_VERSION: u32 = 5u;
const ENVSAMP_CDF_WIDTH: u32 = 6u;
const ENVSAMP_CDF_HEIGHT: u32 = 7u;
const ENVSAMP_CDF_IMAGE_WIDTH: u32 = 8u;
const ENVSAMP_CDF_ROW_BITS: u32 = 10u;
const ENVSAMP_CDF_GUIDE_BITS: u32 = 11u;
const ENVSAMP_CDF_INVERSE_WIDTH: u32 = 12u;
const ENVSAMP_CDF_ROW_SCALE: u32 = 13u;
const ENVSAMP_CDF_OFFSET: u32 = 14u;
const ENVSAMP_CDF_BILINEAR: u32 = 15u;
const ENVSAMP_CDF_ROWS_AT: u32 = 16u;
const ENVSAMP_CDF_ROW_EDGES_AT: u32 = 18u;
const ENVSAMP_CDF_EDGES_AT: u32 = 20u;
const ENVSAMP_CDF_ROW_GUIDE_AT: u32 = 22u;
const ENVSAMP_CDF_GUIDE_AT: u32 = 24u;
const ENVSAMP_CDF_WALK: u32 = 4u;

/* As envsamp_kd_problem. */
fn envsamp_cdf_problem() -> u32 {
    let mapping: u32 = envsamp_cdf_word(3u);

    if (envsamp_cdf_word(0u) != ENVSAMP_CDF_MAGIC) {
        return 1u;
    }
    if (envsamp_cdf_word(1u) != ENVSAMP_CDF_VERSION) {
        return 2u;
    }
    return select(0u, 3u, mapping != envsamp_mapping(mapping));
}

/* Where an array begins, in words, or in half words. */
fn envsamp_cdf_words_at(field: u32) -> u32 {
    return (envsamp_cdf_word(field) >> 2u) | (envsamp_cdf_word(field + 1u) << 30u);
}

fn envsamp_cdf_halves_at(field: u32) -> u32 {
    return (envsamp_cdf_word(field) >> 1u) | (envsamp_cdf_word(field + 1u) << 31u);
}

fn envsamp_cdf_half(at: u32) -> u32 {
    return (envsamp_cdf_word(at >> 1u) >> ((at & 1u) << 4u)) & 0xffffu;
}

/* ---- cdf ---- */

/* The index i with edges[i] <= draw < edges[i + 1]. */
fn envsamp_cdf_find(edges: u32, guide: u32, bits: u32, draw: u32) -> u32 {
    let cell: u32 = draw >> (24u - bits);
    var low: u32 = envsamp_cdf_half(guide + cell);
    let edge: u32 = edges + low;

    low = low + u32(envsamp_cdf_word(edge + 1u) <= draw)
        + u32(envsamp_cdf_word(edge + 2u) <= draw)
        + u32(envsamp_cdf_word(edge + 3u) <= draw) + u32(envsamp_cdf_word(edge + 4u) <= draw);
    if (envsamp_cdf_word(edges + low + 1u) > draw) {
        return low;
    }
    var last: u32 = envsamp_cdf_half(guide + cell + 1u);

    low = low + 1u;
    while (low < last) {
        let middle: u32 = low + ((last - low) >> 1u);

        if (envsamp_cdf_word(edges + middle + 1u) > draw) {
            last = middle;
        } else {
            low = middle + 1u;
        }
    }
    return low;
}

/* Which of its 2^24 values a number is. */
fn envsamp_draw(u: f32) -> u32 {
    return u32(envsamp_clamp_unit(u) * ENVSAMP_UNIT);
}

fn envsamp_cdf_edges(row: u32) -> u32 {
    return envsamp_cdf_words_at(ENVSAMP_CDF_EDGES_AT)
         + row * (envsamp_cdf_word(ENVSAMP_CDF_WIDTH) + ENVSAMP_CDF_WALK);
}

/* The density of texel (column, row), whose edges are the words from `edge` on. */
fn envsamp_cdf_density(column: u32, row: u32, edge: u32) -> f32 {
    let width: u32 = envsamp_cdf_word(ENVSAMP_CDF_WIDTH);
    var parts: u32 = envsamp_cdf_word(edge + 1u) - envsamp_cdf_word(edge);
    let density: f32 = bitcast<f32>(envsamp_cdf_word(envsamp_cdf_words_at(ENVSAMP_CDF_ROWS_AT)
                                                     + 3u * row + 2u));

    if ((column == 0u || column + 1u == width) && envsamp_cdf_word(ENVSAMP_CDF_BILINEAR) == 1u) {
        parts = parts << 1u;
    }
    return f32(parts) * density;
}

/* How far from one edge to the next a draw is, from its middle. */
fn envsamp_cdf_fraction(edge: u32, draw: u32) -> f32 {
    let first: u32 = envsamp_cdf_word(edge);
    let parts: u32 = envsamp_cdf_word(edge + 1u) - first;
    let f: f32 = (f32(draw - first) + 0.5) / f32(parts);

    return f;
}

fn envsamp_cdf_sample(u0: f32, u1: f32) -> envsamp_sample {
    let down: u32 = envsamp_draw(u1);
    let across: u32 = envsamp_draw(u0);
    let row_edges: u32 = envsamp_cdf_words_at(ENVSAMP_CDF_ROW_EDGES_AT);
    let row: u32 = envsamp_cdf_find(row_edges, envsamp_cdf_halves_at(ENVSAMP_CDF_ROW_GUIDE_AT),
                                envsamp_cdf_word(ENVSAMP_CDF_ROW_BITS), down);
    let edges: u32 = envsamp_cdf_edges(row);
    let bits: u32 = envsamp_cdf_word(ENVSAMP_CDF_GUIDE_BITS);
    let guide: u32 = envsamp_cdf_halves_at(ENVSAMP_CDF_GUIDE_AT) + row * ((1u << bits) + 1u);
    let column: u32 = envsamp_cdf_find(edges, guide, bits, across);
    let rows: u32 = envsamp_cdf_words_at(ENVSAMP_CDF_ROWS_AT) + 3u * row;
    let fx: f32 = envsamp_cdf_fraction(edges + column, across);
    let fy: f32 = envsamp_cdf_fraction(row_edges + row, down);
    let offset: f32 = bitcast<f32>(envsamp_cdf_word(ENVSAMP_CDF_OFFSET));
    let inverse: f32 = bitcast<f32>(envsamp_cdf_word(ENVSAMP_CDF_INVERSE_WIDTH));
    let x0: f32 = max(f32(column) - offset, 0.0);
    let x1: f32 = min(f32(column) - offset + 1.0, f32(envsamp_cdf_word(ENVSAMP_CDF_IMAGE_WIDTH)));
    let north: f32 = bitcast<f32>(envsamp_cdf_word(rows));
    let south: f32 = bitcast<f32>(envsamp_cdf_word(rows + 1u));
    let x: f32 = (x0 + fx * (x1 - x0)) * inverse;
    let cap: f32 = north
                              + fy * (bitcast<f32>(envsamp_cdf_word(rows + 3u)) - north);
    let rest: f32 = south
                               + fy * (bitcast<f32>(envsamp_cdf_word(rows + 4u)) - south);

    return envsamp_point_sample(envsamp_mapping(envsamp_cdf_word(3u)),
                                envsamp_point(x, cap, rest),
                                envsamp_cdf_density(column, row, edges + column), edges + column);
}

fn envsamp_cdf_pdf(dir: vec3f) -> f32 {
    let mapping: u32 = envsamp_mapping(envsamp_cdf_word(3u));
    let r: f32 = envsamp_ring(dir);
    let d: vec3f = envsamp_grid_coords(mapping, dir, r);
    let offset: f32 = bitcast<f32>(envsamp_cdf_word(ENVSAMP_CDF_OFFSET));
    let scale: f32 = bitcast<f32>(envsamp_cdf_word(ENVSAMP_CDF_ROW_SCALE));
    let width: f32 = f32(envsamp_cdf_word(ENVSAMP_CDF_IMAGE_WIDTH));
    var u: f32 = 0.25 * d.x;
    var v: f32 = 0.5 * d.y;

    if (d.z == 0.0) {
        return 0.0;
    }
    if (mapping != ENVSAMP_OCTAHEDRAL) {
        var t: f32 = 1.0 - 2.0 * envsamp_quotient(abs(dir.z), r + abs(dir.z));
        let s: f32 = t * t;
        let s2: f32 = s * s;

        t = t * (((0.318309882 - s * 0.106102533) + s2 * (0.0636398678 - s * 0.0452227112))
               + s2 * s2 * (((0.0339148928 - s * 0.0239804388)
                           + s2 * (0.0136998603 - s * 0.005183045)) + s2 * s2 * 0.000924230142));
        u = envsamp_turn(dir.y, dir.x);
        v = 0.5 - envsamp_copy_sign(0.25 - t, dir.z);
        if (mapping == ENVSAMP_HEMISPHERE && v > 0.5) {
            return 0.0;
        }
    }
    let x: f32 = u * width + offset;
    let y: f32 = v * scale + offset;
    let column: u32 = envsamp_index(x, envsamp_cdf_word(ENVSAMP_CDF_WIDTH));
    let row: u32 = envsamp_index(y, envsamp_cdf_word(ENVSAMP_CDF_HEIGHT));

    return envsamp_cdf_density(column, row, envsamp_cdf_edges(row) + column);
}
