/* check.glsl: the compute shader of check.c, behind envsamp.glsl. CHECK_MODE says what is drawn. */
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer check_directions { float directions[]; };
layout(std430, binding = 2) writeonly buffer check_results { uint results[]; };
uniform uint seed;
uniform uint count;

uint hash_u32(uint x)
{
    x ^= x >> 16u;
    x *= 0x7feb352du;
    x ^= x >> 15u;
    x *= 0x846ca68bu;
    return x ^ (x >> 16u);
}

uint check_bits(uint index)
{
    return hash_u32(seed * 0x9e3779b9u + hash_u32(index));
}

float unit_float(uint index)
{
    return float(check_bits(index) >> 8u) / 16777216.0;
}

/* One in 512 is any float. */
float number(uint i, uint axis)
{
    float any = uintBitsToFloat(check_bits(8u * i + axis));

    return i % 512u == 0u ? any : unit_float(8u * i + axis);
}

/* One in 64 is no normal. */
vec3 normal(uint i)
{
    vec3 n = vec3(unit_float(8u * i + 2u), unit_float(8u * i + 3u), unit_float(8u * i + 4u)) - 0.5;

    return i % 64u == 5u ? vec3(0.0) : n;
}

void write_sample(uint i, envsamp_sample s)
{
    results[8u * i] = floatBitsToUint(s.dir.x);
    results[8u * i + 1u] = floatBitsToUint(s.dir.y);
    results[8u * i + 2u] = floatBitsToUint(s.dir.z);
    results[8u * i + 3u] = floatBitsToUint(s.pdf);
    results[8u * i + 4u] = floatBitsToUint(s.uv.x);
    results[8u * i + 5u] = floatBitsToUint(s.uv.y);
    results[8u * i + 6u] = s.block;
}

void write_pdf(uint i, float pdf, float light_alone)
{
    write_sample(i, envsamp_sample(vec3(0.0), pdf, vec2(0.0), floatBitsToUint(light_alone)));
}

void main()
{
    uint i = gl_GlobalInvocationID.x;
    float u0 = number(i, 0u);
    float u1 = number(i, 1u);

    if (i >= count) {
        return;
    }
#if CHECK_MODE == 0
    results[0] = envsamp_kd_problem();
#elif CHECK_MODE == 1
    write_sample(i, envsamp_kd_sample(u0, u1));
#elif CHECK_MODE == 3
    write_sample(i, envsamp_kd_sample_facing(normal(i), u0, u1));
#elif CHECK_MODE == 5
    write_sample(i, envsamp_cdf_sample(u0, u1));
#elif CHECK_MODE == 7
    results[0] = envsamp_cdf_problem();
#else
    vec3 dir = vec3(directions[3u * i], directions[3u * i + 1u], directions[3u * i + 2u]);
#if CHECK_MODE == 2
    write_pdf(i, envsamp_kd_pdf(dir), envsamp_kd_pdf(dir));
#elif CHECK_MODE == 4
    write_pdf(i, envsamp_kd_pdf_facing(normal(i), dir), envsamp_kd_pdf(dir));
#else
    write_pdf(i, envsamp_cdf_pdf(dir), envsamp_cdf_pdf(dir));
#endif
#endif
}
