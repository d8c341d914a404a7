/* check.glsl: the compute shader of check.c, behind envsamp.glsl. CHECK_MODE says what is drawn.
 * translate.pl makes it HLSL and WGSL.
 */
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer check_in { float check_directions[]; };
layout(std430, binding = 2) writeonly buffer check_out { uint check_results[]; };
layout(std430, binding = 3) readonly buffer check_how { uint check_settings[]; };

void check_point(uint i);

void main()
{
    if (gl_GlobalInvocationID.x < check_settings[1]) {
        check_point(gl_GlobalInvocationID.x);
    }
}

/* ---- translated from here on ---- */

uint check_hash(uint x)
{
    uint a = (x ^ (x >> 16u)) * 0x7feb352du;
    uint b = (a ^ (a >> 15u)) * 0x846ca68bu;

    return b ^ (b >> 16u);
}

uint check_bits(uint index)
{
    return check_hash(check_settings[0] * 0x9e3779b9u + check_hash(index));
}

float check_unit(uint index)
{
    return float(check_bits(index) >> 8u) / 16777216.0;
}

/* One in 512 is any float. */
float check_number(uint i, uint axis)
{
    float any = uintBitsToFloat(check_bits(8u * i + axis));

    return i % 512u == 0u ? any : check_unit(8u * i + axis);
}

/* One in 64 is no normal. */
vec3 check_normal(uint i)
{
    vec3 n = vec3(check_unit(8u * i + 2u) - 0.5, check_unit(8u * i + 3u) - 0.5,
                  check_unit(8u * i + 4u) - 0.5);

    return i % 64u == 5u ? vec3(0.0, 0.0, 0.0) : n;
}

/* What point i gives: a problem, a sample of kd, facing or cdf, or a density, which comes with that
   of light alone in place of the block. */
envsamp_sample check_draw(uint i)
{
    float u0 = check_number(i, 0u);
    float u1 = check_number(i, 1u);
    vec3 dir = vec3(check_directions[3u * i], check_directions[3u * i + 1u],
                    check_directions[3u * i + 2u]);
    envsamp_sample s = envsamp_sample(vec3(0.0, 0.0, 0.0), 0.0, vec2(0.0, 0.0), 0u);

    if (CHECK_MODE == 0u) {
        s.block = envsamp_kd_problem();
    } else if (CHECK_MODE == 1u) {
        s = envsamp_kd_sample(u0, u1);
    } else if (CHECK_MODE == 2u) {
        s.pdf = envsamp_kd_pdf(dir);
        s.block = floatBitsToUint(s.pdf);
    } else if (CHECK_MODE == 3u) {
        s = envsamp_kd_sample_facing(check_normal(i), u0, u1);
    } else if (CHECK_MODE == 4u) {
        s.pdf = envsamp_kd_pdf_facing(check_normal(i), dir);
        s.block = floatBitsToUint(envsamp_kd_pdf(dir));
    } else if (CHECK_MODE == 5u) {
        s = envsamp_cdf_sample(u0, u1);
    } else if (CHECK_MODE == 6u) {
        s.pdf = envsamp_cdf_pdf(dir);
        s.block = floatBitsToUint(s.pdf);
    } else {
        s.block = envsamp_cdf_problem();
    }
    return s;
}

void check_point(uint i)
{
    envsamp_sample s = check_draw(i);

    check_results[8u * i] = floatBitsToUint(s.dir.x);
    check_results[8u * i + 1u] = floatBitsToUint(s.dir.y);
    check_results[8u * i + 2u] = floatBitsToUint(s.dir.z);
    check_results[8u * i + 3u] = floatBitsToUint(s.pdf);
    check_results[8u * i + 4u] = floatBitsToUint(s.uv.x);
    check_results[8u * i + 5u] = floatBitsToUint(s.uv.y);
    check_results[8u * i + 6u] = s.block;
}
