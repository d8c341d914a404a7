/* shapes.c: see shapes.h. */
#include "shapes.h"
#include "vector.h"

#include <stdlib.h>

#define TAU (2.0f * VEC_PI)

/* ---- meshes ---- */

void mesh_free(mesh *m)
{
    free(m->vertices);
    free(m->triangles);
    m->vertices = NULL;
    m->triangles = NULL;
    m->vertex_count = m->triangle_count = m->vertex_capacity = m->triangle_capacity = 0;
}

/* Makes room for that many more. */
static int mesh_reserve(mesh *m, int vertices, int triangles)
{
    const int vertex_need = m->vertex_count + vertices;
    const int triangle_need = m->triangle_count + triangles;

    if (vertex_need > m->vertex_capacity) {
        const int capacity = 2 * vertex_need;
        vertex *grown = realloc(m->vertices, (size_t)capacity * sizeof *grown);

        if (!grown)
            return 0;
        m->vertices = grown;
        m->vertex_capacity = capacity;
    }
    if (triangle_need > m->triangle_capacity) {
        const int capacity = 2 * triangle_need;
        void *grown = realloc(m->triangles, (size_t)capacity * sizeof *m->triangles);

        if (!grown)
            return 0;
        m->triangles = grown;
        m->triangle_capacity = capacity;
    }
    return 1;
}

static void mesh_triangle(mesh *m, int a, int b, int c)
{
    unsigned *t = m->triangles[m->triangle_count++];

    t[0] = (unsigned)a;
    t[1] = (unsigned)b;
    t[2] = (unsigned)c;
}

/* Triangles of a grid of columns x rows vertices that starts at `first`. */
static void mesh_grid(mesh *m, int first, int columns, int rows)
{
    int x, y;

    for (y = 0; y + 1 < rows; y++)
        for (x = 0; x + 1 < columns; x++) {
            const int a = first + y * columns + x, b = a + columns;

            mesh_triangle(m, a, a + 1, b + 1);
            mesh_triangle(m, a, b + 1, b);
        }
}

static vertex *mesh_vertex(mesh *m)
{
    return &m->vertices[m->vertex_count++];
}

void mesh_place(mesh *m, int first, float scale, float turn, const float at[3])
{
    const float c = cosf(turn), s = sinf(turn);
    int i, k;

    for (i = first; i < m->vertex_count; i++) {
        vertex *v = &m->vertices[i];
        float *part[3];

        part[0] = v->at;
        part[1] = v->normal;
        part[2] = v->tangent;
        for (k = 0; k < 3; k++)
            vec_set(part[k], c * part[k][0] - s * part[k][1], s * part[k][0] + c * part[k][1],
                    part[k][2]);
        vec_along(at, scale, v->at, v->at);
    }
}

/* ---- vase ---- */

/* Radius and height, from the middle of the bottom over the outside, round the lip, to the middle
   of the bottom inside. */
static const float vase_profile[][2] = {
    {0.00f, 0.000f}, {0.17f, 0.000f}, {0.20f, 0.015f}, {0.19f, 0.060f}, {0.24f, 0.150f},
    {0.35f, 0.320f}, {0.375f, 0.450f}, {0.32f, 0.600f}, {0.20f, 0.745f}, {0.155f, 0.830f},
    {0.17f, 0.920f}, {0.225f, 0.985f}, {0.235f, 1.000f}, {0.215f, 0.995f}, {0.145f, 0.920f},
    {0.13f, 0.830f}, {0.175f, 0.745f}, {0.29f, 0.600f}, {0.345f, 0.450f}, {0.32f, 0.320f},
    {0.20f, 0.150f}, {0.00f, 0.100f}
};

#define VASE_POINTS ((int)(sizeof vase_profile / sizeof vase_profile[0]))

/* A point of the curve through the profile's points, and its slope [Catmull, Rom 1974]. */
static void vase_curve(float t, float point[2], float slope[2])
{
    const int last = VASE_POINTS - 1, i = t < (float)last ? (int)t : last - 1;
    const float x = t - (float)i;
    int k;

    for (k = 0; k < 2; k++) {
        const float b = vase_profile[i][k], c = vase_profile[i + 1][k];
        const float a = i ? vase_profile[i - 1][k] : b;
        const float d = i + 2 <= last ? vase_profile[i + 2][k] : c;
        const float s = 0.5f * (c - a), e = 0.5f * (d - b);
        const float p2 = 3.0f * (c - b) - 2.0f * s - e, p3 = 2.0f * (b - c) + s + e;

        point[k] = b + x * (s + x * (p2 + x * p3));
        slope[k] = s + x * (2.0f * p2 + x * 3.0f * p3);
    }
    point[0] = point[0] > 0.0f ? point[0] : 0.0f;
}

int mesh_vase(mesh *m, int along, int around)
{
    const int first = m->vertex_count;
    int x, y;

    if (!mesh_reserve(m, (along + 1) * (around + 1), 2 * along * around))
        return 0;
    for (y = 0; y <= along; y++) {
        float point[2], slope[2];

        vase_curve((float)((VASE_POINTS - 1) * y) / (float)along, point, slope);
        for (x = 0; x <= around; x++) {
            const float c = cosf(TAU * (float)x / (float)around);
            const float s = sinf(TAU * (float)x / (float)around);
            vertex *v = mesh_vertex(m);

            vec_set(v->at, point[0] * c, point[0] * s, point[1]);
            vec_set(v->normal, slope[1] * c, slope[1] * s, -slope[0]);
            vec_normalize(v->normal);
            vec_set(v->tangent, -s, c, 0.0f);
        }
    }
    mesh_grid(m, first, around + 1, along + 1);
    return 1;
}

/* ---- knot ---- */

static void knot_curve(int p, int q, float t, float to[3])
{
    const float radius = 0.68f + 0.32f * cosf((float)q * t);

    vec_set(to, radius * cosf((float)p * t), radius * sinf((float)p * t),
            0.32f * sinf((float)q * t));
}

int mesh_knot(mesh *m, int p, int q, float tube, int along, int around)
{
    const int first = m->vertex_count;
    int x, y;

    if (!mesh_reserve(m, (along + 1) * (around + 1), 2 * along * around))
        return 0;
    for (y = 0; y <= along; y++) {
        const float t = TAU * (float)y / (float)along;
        float at[3], before[3], after[3], tangent[3], side[3], up[3];

        knot_curve(p, q, t, at);
        knot_curve(p, q, t - 1e-2f, before);
        knot_curve(p, q, t + 1e-2f, after);
        vec_sub(after, before, tangent);
        vec_normalize(tangent);
        vec_set(up, at[0] * 0.4f, at[1] * 0.4f, at[2] + 2.0f);
        vec_cross(tangent, up, side);
        vec_normalize(side);
        vec_cross(side, tangent, up);
        for (x = 0; x <= around; x++) {
            const float angle = TAU * (float)x / (float)around;
            vertex *v = mesh_vertex(m);

            vec_set(v->normal, cosf(angle) * side[0], cosf(angle) * side[1],
                    cosf(angle) * side[2]);
            vec_along(v->normal, sinf(angle), up, v->normal);
            vec_along(at, tube, v->normal, v->at);
            vec_copy(tangent, v->tangent);
        }
    }
    mesh_grid(m, first, around + 1, along + 1);
    return 1;
}

/* ---- box ---- */

#define BOX_STEPS 4                          /* of a round edge */
#define BOX_SIDE (2 * (BOX_STEPS + 1))       /* vertices along a side of a face */

/* Where vertex i of a side is on the box with sharp edges: close together where it is round. */
static float box_step(int i, float half, float round)
{
    return i <= BOX_STEPS ? -half + round * (float)i / BOX_STEPS
                          : half - round * (float)(BOX_SIDE - 1 - i) / BOX_STEPS;
}

static float box_clamp(float x, float most)
{
    return x < -most ? -most : x > most ? most : x;
}

/* Points of the sharp box go out from the inner box, which is smaller by `round`, by that much. */
static void box_vertex(vertex *v, const float centre[3], const float half[3], float round,
                       const float sharp[3], int across)
{
    float inner[3];
    int k;

    for (k = 0; k < 3; k++) {
        inner[k] = box_clamp(sharp[k], half[k] - round);
        v->normal[k] = sharp[k] - inner[k];
        v->tangent[k] = k == across ? 1.0f : 0.0f;
    }
    vec_normalize(v->normal);
    vec_along(inner, round, v->normal, v->at);
    vec_along(v->at, 1.0f, centre, v->at);
}

int mesh_box(mesh *m, const float centre[3], const float half[3], float round)
{
    const int count = BOX_SIDE * BOX_SIDE;
    int face, i;

    if (!mesh_reserve(m, 6 * count, 12 * (BOX_SIDE - 1) * (BOX_SIDE - 1)))
        return 0;
    for (face = 0; face < 6; face++) {
        const int out = face / 2, first = m->vertex_count;
        const int across = (out + 1 + face % 2) % 3, up = (out + 2 - face % 2) % 3;

        for (i = 0; i < count; i++) {
            float sharp[3];

            sharp[out] = face % 2 ? -half[out] : half[out];
            sharp[across] = box_step(i % BOX_SIDE, half[across], round);
            sharp[up] = box_step(i / BOX_SIDE, half[up], round);
            box_vertex(mesh_vertex(m), centre, half, round, sharp, across);
        }
        mesh_grid(m, first, BOX_SIDE, BOX_SIDE);
    }
    return 1;
}

/* ---- disc ---- */

int mesh_disc(mesh *m, float radius, float depth, int around)
{
    int first, x, y;

    if (!mesh_reserve(m, 3 * (around + 1), 3 * around))
        return 0;
    for (y = 0; y < 3; y++)                  /* the rim of the top, then both of the side */
        for (x = 0; x <= around; x++) {
            const float c = cosf(TAU * (float)x / (float)around);
            const float s = sinf(TAU * (float)x / (float)around);
            vertex *v = mesh_vertex(m);

            vec_set(v->at, radius * c, radius * s, y == 2 ? 0.0f : y ? -depth : 0.0f);
            vec_set(v->normal, y ? c : 0.0f, y ? s : 0.0f, y ? 0.0f : 1.0f);
            vec_set(v->tangent, y ? -s : 1.0f, y ? c : 0.0f, 0.0f);
        }
    first = m->vertex_count - 3 * (around + 1);
    for (x = 1; x + 1 < around; x++)
        mesh_triangle(m, first, first + x, first + x + 1);
    mesh_grid(m, first + around + 1, around + 1, 2);
    return 1;
}
