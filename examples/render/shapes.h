/* shapes.h: triangle meshes made in code: a lathe vase, a knot, rounded boxes, a disc.
 *
 *     mesh vase = {0};
 *     if (!mesh_vase(&vase, 96, 128)) ...               out of memory
 *     mesh_place(&vase, 0, 1.0f, 0.0f, at);
 *     mesh_free(&vase);
 *
 * Every function appends to the mesh, and returns 0 if memory is short. Shapes stand on z = 0 or
 * are about the origin; mesh_place moves what was appended from a vertex on.
 */
#ifndef RENDER_SHAPES_H
#define RENDER_SHAPES_H

typedef struct vertex { float at[3], normal[3], tangent[3]; } vertex;

typedef struct mesh {
    int vertex_count, triangle_count;
    int vertex_capacity, triangle_capacity;
    vertex *vertices;
    unsigned (*triangles)[3];
} mesh;

void mesh_free(mesh *m);

/* A profile of 1 unit of height turned about z; open on top, with an inside. */
int mesh_vase(mesh *m, int along, int around);

/* A (p, q) torus knot about the z axis, about 1 unit in radius. */
int mesh_knot(mesh *m, int p, int q, float tube, int along, int around);

/* A box of half sides `half` about `centre`, whose edges are round by `round`. */
int mesh_box(mesh *m, const float centre[3], const float half[3], float round);

/* A disc on z = 0, facing up, with a side that goes `depth` down. */
int mesh_disc(mesh *m, float radius, float depth, int around);

/* Vertices from `first` on: turned about z by `turn` radians, enlarged, moved. */
void mesh_place(mesh *m, int first, float scale, float turn, const float at[3]);

#endif
