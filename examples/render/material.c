/* material.c: see material.h. */
#include "material.h"
#include "vector.h"

#include <string.h>

#define BELOW_ONE 0.99999994f

static float material_luminance(const float rgb[3])
{
    return 0.2126f * rgb[0] + 0.7152f * rgb[1] + 0.0722f * rgb[2];
}

/* ---- Fresnel ---- */

/* Reflectance of a dielectric whose index of refraction is `ior` over that of the outside. */
static float fresnel_dielectric(float cosine, float ior)
{
    const float rest = ior * ior - 1.0f + cosine * cosine;
    float root, parallel, perpendicular;

    if (rest <= 0.0f)
        return 1.0f;
    root = sqrtf(rest);
    perpendicular = (cosine - root) / (cosine + root);
    parallel = (ior * ior * cosine - root) / (ior * ior * cosine + root);
    return 0.5f * (perpendicular * perpendicular + parallel * parallel);
}

/* What of even light from inside a dielectric is reflected back, 1 - (1 - outside) / ior^2. From
   outside it is the mean of the reflectance over cos^2, by the midpoint rule. */
static float fresnel_inside(float ior)
{
    const int steps = 512;
    float outside = 0.0f;
    int i;

    for (i = 0; i < steps; i++)
        outside += fresnel_dielectric(sqrtf(((float)i + 0.5f) / (float)steps), ior);
    return 1.0f - (1.0f - outside / (float)steps) / (ior * ior);
}

/* Schlick's approximation. */
static float fresnel_conductor(float reflectance, float cosine)
{
    const float x = 1.0f - cosine, x2 = x * x;

    return reflectance + (1.0f - reflectance) * x2 * x2 * x;
}

/* ---- GGX ---- */

static void half_vector(const float eye[3], const float light[3], float half[3])
{
    vec_along(eye, 1.0f, light, half);
    vec_normalize(half);
}

static float ggx_normals(const float alpha[2], const float h[3])
{
    const float x = h[0] / alpha[0], y = h[1] / alpha[1], sum = x * x + y * y + h[2] * h[2];

    return 1.0f / (VEC_PI * alpha[0] * alpha[1] * sum * sum);
}

/* Smith's Lambda: G1 = 1 / (1 + Lambda), G2 = 1 / (1 + Lambda(eye) + Lambda(light)). */
static float ggx_lambda(const float alpha[2], const float dir[3])
{
    const float x = alpha[0] * dir[0], y = alpha[1] * dir[1];

    return 0.5f * (sqrtf(1.0f + (x * x + y * y) / (dir[2] * dir[2])) - 1.0f);
}

/* BRDF x cosine, without Fresnel reflectance. */
static float ggx_reflected(const material *m, const float eye[3], const float light[3],
                           const float h[3])
{
    const float shadowing = 1.0f / (1.0f + ggx_lambda(m->alpha, eye) + ggx_lambda(m->alpha, light));

    return ggx_normals(m->alpha, h) * shadowing / (4.0f * eye[2]);
}

/* Visible normals have the density G1 (eye.h) D / eye_z, and directions that over 4 (eye.h). */
static float ggx_pdf(const material *m, const float eye[3], const float h[3])
{
    return ggx_normals(m->alpha, h) / (4.0f * eye[2] * (1.0f + ggx_lambda(m->alpha, eye)));
}

/* A visible normal: in the space where the surface is a half sphere, a point of the spherical cap
   that the eye's reflections fill, halfway to the eye. */
static void ggx_draw(const material *m, const float eye[3], const float u[2], float h[3])
{
    float v[3], z, sine;

    vec_set(v, m->alpha[0] * eye[0], m->alpha[1] * eye[1], eye[2]);
    vec_normalize(v);
    z = (1.0f - u[1]) * (1.0f + v[2]) - v[2];
    sine = sqrtf(fmaxf(1.0f - z * z, 0.0f));
    vec_set(h, m->alpha[0] * (v[0] + sine * cosf(2.0f * VEC_PI * u[0])),
            m->alpha[1] * (v[1] + sine * sinf(2.0f * VEC_PI * u[0])), fmaxf(v[2] + z, 1e-9f));
    vec_normalize(h);
}

/* ---- Ward ---- */

/* The exponential over pi alpha_x alpha_y, of a half vector of any length. */
static float ward_gauss(const material *m, const float h[3])
{
    const float x = h[0] / m->alpha[0], y = h[1] / m->alpha[1];

    return expf(-(x * x + y * y) / (h[2] * h[2])) / (VEC_PI * m->alpha[0] * m->alpha[1]);
}

/* 1 / (4 (eye.h)^2 cos^4) times the exponential, and the cosine of the light; over rho_s. */
static float ward_reflected(const material *m, const float eye[3], const float light[3])
{
    float h[3], gauss, z2;

    vec_along(eye, 1.0f, light, h);
    gauss = ward_gauss(m, h);
    z2 = h[2] * h[2];
    return gauss > 0.0f ? gauss * vec_dot(h, h) / (z2 * z2) * light[2] : 0.0f;
}

/* Half vectors have the density of the exponential over cos^3. */
static float ward_pdf(const material *m, const float eye[3], const float h[3])
{
    const float gauss = ward_gauss(m, h);

    return gauss > 0.0f ? gauss / (4.0f * vec_dot(eye, h) * h[2] * h[2] * h[2]) : 0.0f;
}

static void ward_draw(const material *m, const float u[2], float h[3])
{
    const float radius = sqrtf(-logf(1.0f - u[1]));

    vec_set(h, m->alpha[0] * radius * cosf(2.0f * VEC_PI * u[0]),
            m->alpha[1] * radius * sinf(2.0f * VEC_PI * u[0]), 1.0f);
    vec_normalize(h);
}

/* ---- materials ---- */

material material_lambert(const float albedo[3])
{
    material m;

    memset(&m, 0, sizeof m);
    m.kind = MATERIAL_LAMBERT;
    m.alpha[0] = m.alpha[1] = 1.0f;
    vec_copy(albedo, m.diffuse);
    vec_copy(albedo, m.albedo);
    return m;
}

material material_ward(const float diffuse[3], const float specular[3], float alpha_x,
                       float alpha_y)
{
    material m = material_lambert(diffuse);

    m.kind = MATERIAL_WARD;
    m.alpha[0] = alpha_x;
    m.alpha[1] = alpha_y;
    vec_copy(specular, m.specular);
    vec_along(diffuse, 1.0f, specular, m.albedo);
    return m;
}

material material_conductor(const float reflectance[3], float alpha_x, float alpha_y)
{
    static const float black[3] = {0.0f, 0.0f, 0.0f};
    material m = material_ward(black, reflectance, alpha_x, alpha_y);

    m.kind = MATERIAL_CONDUCTOR;
    return m;
}

/* Light that enters is reflected by the base, and by the surface back to it, any number of times:
   base / (1 - base inside), of which 1 / ior^2 per steradian leaves. */
material material_plastic(const float base[3], float ior, float alpha)
{
    const float inside = fresnel_inside(ior);
    material m = material_lambert(base);
    int i;

    m.kind = MATERIAL_PLASTIC;
    m.ior = ior;
    m.alpha[0] = m.alpha[1] = alpha;
    for (i = 0; i < 3; i++)
        m.diffuse[i] = base[i] / (1.0f - base[i] * inside) / (ior * ior);
    return m;
}

material material_fabric(void)
{
    static const float diffuse[3] = {0.42f, 0.14f, 0.15f}, specular[3] = {0.06f, 0.05f, 0.05f};

    return material_ward(diffuse, specular, 0.32f, 0.22f);
}

material material_metallic_paint(void)
{
    static const float diffuse[3] = {0.02f, 0.05f, 0.16f}, specular[3] = {0.12f, 0.20f, 0.36f};

    return material_ward(diffuse, specular, 0.19f, 0.19f);
}

material material_chrome_steel(void)
{
    static const float diffuse[3] = {0.010f, 0.009f, 0.009f}, specular[3] = {0.58f, 0.57f, 0.56f};

    return material_ward(diffuse, specular, 0.022f, 0.022f);
}

/* The share of samples that go to the specular lobe. */
static float specular_share(const material *m, const float eye[3])
{
    const float diffuse = material_luminance(m->diffuse);
    float reflected;

    switch (m->kind) {
    case MATERIAL_LAMBERT:
        return 0.0f;
    case MATERIAL_WARD:
        reflected = material_luminance(m->specular);
        return reflected > 0.0f ? reflected / (reflected + diffuse) : 0.0f;
    case MATERIAL_CONDUCTOR:
        return 1.0f;
    case MATERIAL_PLASTIC:
        reflected = fresnel_dielectric(eye[2], m->ior);
        return reflected / (reflected + (1.0f - reflected) * diffuse);
    }
    return 0.0f;
}

void material_eval(const material *m, const float eye[3], const float light[3], float f[3])
{
    float h[3], lobe = 0.0f, base = light[2] / VEC_PI, cosine;
    int i;

    f[0] = f[1] = f[2] = 0.0f;
    if (eye[2] <= 0.0f || light[2] <= 0.0f)
        return;
    half_vector(eye, light, h);
    cosine = vec_dot(eye, h);
    if (m->kind == MATERIAL_WARD) {
        lobe = ward_reflected(m, eye, light);
    } else if (m->kind != MATERIAL_LAMBERT) {
        lobe = ggx_reflected(m, eye, light, h);
    }
    if (m->kind == MATERIAL_PLASTIC) {
        lobe *= fresnel_dielectric(cosine, m->ior);
        base *= (1.0f - fresnel_dielectric(eye[2], m->ior))
              * (1.0f - fresnel_dielectric(light[2], m->ior));
    }
    for (i = 0; i < 3; i++) {
        f[i] = m->diffuse[i] * base;
        if (m->kind == MATERIAL_WARD)
            f[i] += m->specular[i] * lobe;
        else if (m->kind == MATERIAL_CONDUCTOR)
            f[i] += fresnel_conductor(m->specular[i], cosine) * lobe;
        else
            f[i] += lobe;
    }
}

float material_pdf(const material *m, const float eye[3], const float light[3])
{
    float h[3], share, lobe;

    if (eye[2] <= 0.0f || light[2] <= 0.0f)
        return 0.0f;
    share = specular_share(m, eye);
    if (share <= 0.0f)
        return light[2] / VEC_PI;
    half_vector(eye, light, h);
    lobe = m->kind == MATERIAL_WARD ? ward_pdf(m, eye, h) : ggx_pdf(m, eye, h);
    return share * lobe + (1.0f - share) * light[2] / VEC_PI;
}

/* What is left of u[0] after the choice of a lobe places the direction within it. */
int material_sample(const material *m, const float eye[3], const float u[2], float light[3],
                    float *pdf)
{
    const float share = eye[2] > 0.0f ? specular_share(m, eye) : 0.0f;
    float rest[2], h[3];

    rest[1] = u[1];
    if (u[0] < share) {
        rest[0] = fminf(u[0] / share, BELOW_ONE);
        if (m->kind == MATERIAL_WARD)
            ward_draw(m, rest, h);
        else
            ggx_draw(m, eye, rest, h);
        vec_along(eye, -2.0f * vec_dot(eye, h), h, light);
        vec_negate(light, light);
        vec_normalize(light);
    } else {
        rest[0] = fminf((u[0] - share) / (1.0f - share), BELOW_ONE);
        vec_set(light, sqrtf(rest[1]) * cosf(2.0f * VEC_PI * rest[0]),
                sqrtf(rest[1]) * sinf(2.0f * VEC_PI * rest[0]), sqrtf(1.0f - rest[1]));
    }
    *pdf = material_pdf(m, eye, light);
    return *pdf > 0.0f;
}

void material_axis(const material *m, const float eye[3], float axis[3])
{
    const int glossy = specular_share(m, eye) > 0.7f;

    vec_set(axis, glossy ? -eye[0] : 0.0f, glossy ? -eye[1] : 0.0f, glossy ? eye[2] : 1.0f);
}
