/* cube.h: a lat-long or octahedral map of the six faces of a cube map, row by row.
 *
 *     cube faces = { { px, nx, py, ny, pz, nz }, 512, 3 };      pixels, side, channels
 *     cube_map rows = cube_map_make(&faces, ENVSAMP_LATLONG);   and its image, without pixels
 *     envsamp_kd_sizes(&rows.image, NULL, &sizes);
 *     ...
 *     result = envsamp_kd_build_rows(&rows.image, cube_row, &rows, NULL, table, scratch, &kd);
 *
 *     cube_from_map(s.dir, dir);                 to look a drawn direction up in the cube map
 *     cube_lookup(&faces, dir, rgb);             or as your engine does
 *     cube_to_map(bsdf_dir, dir);                before envsamp_kd_pdf
 *
 * Faces are in the order and orientation of OpenGL: +x -x +y -y +z -z, row 0 of each the first
 * row that is uploaded, y up. The map has z up: its axes are the cube's x, -z and y, which is a turn
 * and no mirror. Directions go into the map and back by the two functions, or by a matrix of these
 * rows.
 *
 * A texel of the map is the mean of CUBE_PARTS^2 lookups, which share its solid angle evenly. So the
 * map has the integral of the cube map, whose own texels do not weigh the same: one at a corner has
 * a fifth of the solid angle of one in the middle of a face. A row is asked for once, as a rule.
 * Faces of 512 take some seconds; with CUBE_PARTS 2, which is enough where no lamp is as small as a
 * texel, half a second.
 *
 * Valid C and C++. Needs envsamp.h and -lm.
 */
#ifndef CUBE_H
#define CUBE_H

#include "../../envsamp.h"

#include <math.h>

#ifndef CUBE_PARTS
#define CUBE_PARTS 8                 /* of a texel of the map, each way */
#endif
#define CUBE_SIDE_MAX 16383          /* of a face, so that the map's sides are below 65536 */

typedef struct cube {
    const float *faces[6];           /* linear radiance, rows packed */
    int size;                        /* texels along a side, 1 to CUBE_SIDE_MAX */
    int channels;                    /* 3, or 4 of which the last is ignored */
} cube;

/* What cube_row is given: faces, and the map that they become. */
typedef struct cube_map {
    const cube *faces;
    envsamp_image image;             /* 3 channels, no pixels */
} cube_map;

/* ---- the world of the cube map, and that of the map ---- */

static inline void cube_to_map(const float dir[3], float map_dir[3])
{
    const float y = dir[1];

    map_dir[0] = dir[0];
    map_dir[1] = -dir[2];
    map_dir[2] = y;
}

static inline void cube_from_map(const float map_dir[3], float dir[3])
{
    const float y = map_dir[1];

    dir[0] = map_dir[0];
    dir[1] = map_dir[2];
    dir[2] = -y;
}

/* ---- lookups in the faces ---- */

/* The face that a direction meets, and where, -1 to 1 across and down [OpenGL 4.6, table 8.19]. */
static inline int cube_face(const float dir[3], float *across, float *down)
{
    const float x = fabsf(dir[0]), y = fabsf(dir[1]), z = fabsf(dir[2]);
    const int axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2, minus = dir[axis] < 0.0f;
    const float sign = minus ? -1.0f : 1.0f, length = dir[axis] * sign;

    *across = (axis == 0 ? -sign * dir[2] : axis == 1 ? dir[0] : sign * dir[0]) / length;
    *down = (axis == 1 ? sign * dir[2] : -dir[1]) / length;
    return 2 * axis + minus;
}

/* The direction, not of unit length, of a point in the plane of a face: the inverse. */
static inline void cube_direction(int face, float across, float down, float dir[3])
{
    const int axis = face / 2;
    const float sign = face % 2 ? -1.0f : 1.0f;

    dir[0] = axis == 0 ? sign : axis == 1 ? across : sign * across;
    dir[1] = axis == 1 ? sign : -down;
    dir[2] = axis == 0 ? -sign * across : axis == 1 ? sign * down : sign;
}

static inline int cube_index(float place, int size)
{
    const int i = (int)floorf(0.5f * (place + 1.0f) * (float)size);

    return i < 0 ? 0 : i < size ? i : size - 1;
}

/* A texel, which may be one step off the face at one side: that of the neighbour there. */
static inline const float *cube_texel(const cube *c, int face, int x, int y)
{
    const int size = c->size;

    if (x < 0 || x >= size || y < 0 || y >= size) {
        float across = ((float)x + 0.5f) * 2.0f / (float)size - 1.0f;
        float down = ((float)y + 0.5f) * 2.0f / (float)size - 1.0f, dir[3];

        cube_direction(face, across, down, dir);
        face = cube_face(dir, &across, &down);
        x = cube_index(across, size);
        y = cube_index(down, size);
    }
    return c->faces[face] + (size_t)c->channels * ((size_t)y * (size_t)size + (size_t)x);
}

static inline void cube_add(const float *texel, float weight, float rgb[3])
{
    rgb[0] += weight * texel[0];
    rgb[1] += weight * texel[1];
    rgb[2] += weight * texel[2];
}

/* Adds a texel that may be past a corner, where there is none: the mean of the three round it. */
static inline void cube_add_texel(const cube *c, int face, int x, int y, float weight,
                                  float rgb[3])
{
    const int inner_x = x < 0 ? 0 : x < c->size ? x : c->size - 1;
    const int inner_y = y < 0 ? 0 : y < c->size ? y : c->size - 1;

    if (inner_x == x || inner_y == y) {
        cube_add(cube_texel(c, face, x, y), weight, rgb);
        return;
    }
    cube_add(cube_texel(c, face, inner_x, y), weight / 3.0f, rgb);
    cube_add(cube_texel(c, face, x, inner_y), weight / 3.0f, rgb);
    cube_add(cube_texel(c, face, inner_x, inner_y), weight / 3.0f, rgb);
}

/* Radiance in a direction of the cube map, of any length above 0: bilinear across the edges. */
static inline void cube_lookup(const cube *c, const float dir[3], float rgb[3])
{
    float across, down, fx, fy;
    int face = cube_face(dir, &across, &down), x, y, i;

    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    fx = 0.5f * (across + 1.0f) * (float)c->size - 0.5f;
    fy = 0.5f * (down + 1.0f) * (float)c->size - 0.5f;
    x = (int)floorf(fx);
    y = (int)floorf(fy);
    fx -= (float)x;
    fy -= (float)y;
    for (i = 0; i < 4; i++)
        cube_add_texel(c, face, x + (i & 1), y + (i >> 1),
                       (i & 1 ? fx : 1.0f - fx) * (i >> 1 ? fy : 1.0f - fy), rgb);
}

/* ---- the map ---- */

/* A map of 4 size x 2 size texels, of 4 size x size for ENVSAMP_HEMISPHERE, and of 3 size x 3 size
   for ENVSAMP_OCTAHEDRAL: about as many to a steradian as the faces have. Other sides may be set in
   `image`. */
static inline cube_map cube_map_make(const cube *c, envsamp_mapping mapping)
{
    cube_map map = { c, { NULL, 0, 0, 3, 0, ENVSAMP_LATLONG } };

    map.image.width = (mapping == ENVSAMP_OCTAHEDRAL ? 3 : 4) * c->size;
    map.image.height = mapping == ENVSAMP_LATLONG ? 2 * c->size
                     : mapping == ENVSAMP_OCTAHEDRAL ? 3 * c->size : c->size;
    map.image.mapping = mapping;
    return map;
}

/* z of a fraction of a ring, from its upper edge: by solid angle. */
static inline float cube_z(const envsamp_image *image, int y, float fraction)
{
    const float pi = 3.14159265f, angle = image->mapping == ENVSAMP_HEMISPHERE ? 0.5f * pi : pi;
    const float step = angle / (float)image->height, north = cosf(step * (float)y);

    return north + (cosf(step * (float)(y + 1)) - north) * fraction;
}

/* Adds points of a row, in the middle of CUBE_PARTS parts of each texel, a fraction below its upper
   edge. The octahedral map is of equal area as it is. */
static inline void cube_add_points(const cube_map *map, int y, float fraction, float *row)
{
    const envsamp_image *image = &map->image;
    const float z = cube_z(image, y, fraction), level = sqrtf(fmaxf(1.0f - z * z, 0.0f));
    const float v = ((float)y + fraction) / (float)image->height;
    const int points = image->width * CUBE_PARTS;
    int i, k;

    for (i = 0; i < points; i++) {
        const float u = ((float)i + 0.5f) / (float)points;
        float dir[3], rgb[3];

        if (image->mapping == ENVSAMP_OCTAHEDRAL) {
            envsamp_uv_to_dir(image->mapping, u, v, dir);
        } else {
            dir[0] = level * cosf(6.28318531f * u);
            dir[1] = level * sinf(6.28318531f * u);
            dir[2] = z;
        }
        cube_from_map(dir, dir);
        cube_lookup(map->faces, dir, rgb);
        for (k = 0; k < 3; k++)
            row[3 * (i / CUBE_PARTS) + k] += rgb[k] * (1.0f / (CUBE_PARTS * CUBE_PARTS));
    }
}

/* An envsamp_row_fn; `user` is a cube_map. */
static inline envsamp_result cube_row(int y, float *row, void *user)
{
    const cube_map *map = (const cube_map *)user;
    int i;

    for (i = 0; i < 3 * map->image.width; i++)
        row[i] = 0.0f;
    for (i = 0; i < CUBE_PARTS; i++)
        cube_add_points(map, y, ((float)i + 0.5f) / CUBE_PARTS, row);
    return ENVSAMP_OK;
}

#endif
