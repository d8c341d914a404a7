/* vector.h: vectors of three floats, and a basis of three such vectors, for the renderer.
 *
 *     vec_basis basis;
 *     vec_make_basis(normal, tangent, &basis);
 *     vec_into(&basis, dir, local);             local[2] is the cosine to the normal
 */
#ifndef RENDER_VECTOR_H
#define RENDER_VECTOR_H

#include <math.h>

#define VEC_PI 3.14159265358979f

static inline float vec_dot(const float a[3], const float b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void vec_copy(const float a[3], float to[3])
{
    to[0] = a[0];
    to[1] = a[1];
    to[2] = a[2];
}

static inline void vec_set(float to[3], float x, float y, float z)
{
    to[0] = x;
    to[1] = y;
    to[2] = z;
}

static inline void vec_sub(const float a[3], const float b[3], float to[3])
{
    vec_set(to, a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/* a + t b */
static inline void vec_along(const float a[3], float t, const float b[3], float to[3])
{
    vec_set(to, a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]);
}

static inline void vec_cross(const float a[3], const float b[3], float to[3])
{
    const float x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2];
    const float z = a[0] * b[1] - a[1] * b[0];

    vec_set(to, x, y, z);
}

static inline void vec_negate(const float a[3], float to[3])
{
    vec_set(to, -a[0], -a[1], -a[2]);
}

/* Leaves the zero vector as it is. */
static inline void vec_normalize(float a[3])
{
    const float square = vec_dot(a, a), scale = square > 0.0f ? 1.0f / sqrtf(square) : 0.0f;

    vec_set(a, a[0] * scale, a[1] * scale, a[2] * scale);
}

/* Unit vectors, each perpendicular to the others: tangent, bitangent, normal. */
typedef struct vec_basis { float x[3], y[3], z[3]; } vec_basis;

/* The tangent is as close to the given one as it can be; any where that is zero or along the
   normal. */
static inline void vec_make_basis(const float normal[3], const float tangent[3], vec_basis *to)
{
    const float sign = normal[2] < 0.0f ? -1.0f : 1.0f, a = -1.0f / (sign + normal[2]);

    vec_along(tangent, -vec_dot(normal, tangent), normal, to->x);
    if (!(vec_dot(to->x, to->x) > 1e-8f))   /* [Duff et al., Building an orthonormal basis, 2017] */
        vec_set(to->x, 1.0f + sign * normal[0] * normal[0] * a, sign * normal[0] * normal[1] * a,
                -sign * normal[0]);
    vec_normalize(to->x);
    vec_cross(normal, to->x, to->y);
    vec_copy(normal, to->z);
}

static inline void vec_into(const vec_basis *basis, const float world[3], float local[3])
{
    const float x = vec_dot(basis->x, world), y = vec_dot(basis->y, world);
    const float z = vec_dot(basis->z, world);

    vec_set(local, x, y, z);
}

static inline void vec_out_of(const vec_basis *basis, const float local[3], float world[3])
{
    const float x = local[0], y = local[1], z = local[2];
    int i;

    for (i = 0; i < 3; i++)
        world[i] = x * basis->x[i] + y * basis->y[i] + z * basis->z[i];
}

#endif
