/* test_cube.c: lat-long and octahedral maps of six faces, by examples/common/cube.h. Lookups are
 * held against a reference that knows only where OpenGL puts each face, integrals and first moments
 * of the maps against those of the faces by quadrature; a table is made of the rows and drawn from.
 * Faces that are exchanged, flipped or of equal weights must be rejected.
 */
#include "check.h"

#include "../envsamp.h"

#include "../examples/common/cube.h"
#include "../examples/common/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PI 3.14159265358979323846
#define SIZE 16
#define FACE_FLOATS (SIZE * SIZE * 3)
#define SPLIT 16                /* parts of a face's texel, each way, of the quadrature */

/* ---- faces, and what they show ---- */

/* The middle of each face, and where its columns and rows go, y up. */
static const double middle[6][3] = { { 1, 0, 0 }, { -1, 0, 0 }, { 0, 1, 0 },
                                     { 0, -1, 0 }, { 0, 0, 1 }, { 0, 0, -1 } };
static const double column_step[6][3] = { { 0, 0, -1 }, { 0, 0, 1 }, { 1, 0, 0 },
                                          { 1, 0, 0 }, { 1, 0, 0 }, { -1, 0, 0 } };
static const double row_step[6][3] = { { 0, -1, 0 }, { 0, -1, 0 }, { 0, 0, 1 },
                                       { 0, 0, -1 }, { 0, -1, 0 }, { 0, -1, 0 } };

typedef struct faces {
    float rgb[6][FACE_FLOATS];
    cube as;
} faces;

/* A point of the cube, whose half side is 1. Places are in texels. */
static void point_of(int face, double x, double y, double point[3])
{
    const double across = 2.0 * x / SIZE - 1.0, down = 2.0 * y / SIZE - 1.0;
    int k;

    for (k = 0; k < 3; k++)
        point[k] = middle[face][k] + across * column_step[face][k] + down * row_step[face][k];
}

static float *texel_of(faces *f, int face, int x, int y)
{
    return f->rgb[face] + 3 * (y * SIZE + x);
}

static void set_texel(faces *f, int face, int x, int y, double light)
{
    float *rgb = texel_of(f, face, x, y);

    rgb[0] = (float)light;
    rgb[1] = (float)(2.0 * light);
    rgb[2] = (float)(0.5 * light);
}

enum { CONSTANT, LINEAR, FACE, EDGE, CORNER, NOISE, SCENE_COUNT };

static const char *const scene_names[SCENE_COUNT] = {
    "constant", "linear", "a bright face", "a lamp at an edge", "a lamp at a corner", "noise"
};

static void faces_make(faces *f, int scene)
{
    pcg32 random = pcg32_make(3, 3);
    int face, x, y;

    for (face = 0; face < 6; face++) {
        f->as.faces[face] = f->rgb[face];
        for (y = 0; y < SIZE; y++)
            for (x = 0; x < SIZE; x++) {
                double p[3], light = scene == CONSTANT || scene == LINEAR ? 1.0 : 0.0;

                point_of(face, x + 0.5, y + 0.5, p);
                if (scene == LINEAR)
                    light += (0.5 * p[0] - 0.3 * p[1] + 0.2 * p[2])
                             / sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
                if (scene == FACE)
                    light = face == 2 ? 3.0 : 0.1;
                if (scene == NOISE)
                    light = (double)pcg32_float(&random);
                set_texel(f, face, x, y, light);
            }
    }
    if (scene == EDGE)
        set_texel(f, 4, SIZE - 1, 3, 50.0);
    if (scene == CORNER)
        set_texel(f, 1, 0, SIZE - 1, 50.0);
    f->as.size = SIZE;
    f->as.channels = 3;
}

/* ---- the reference ---- */

/* The texel that touches this one across the edge that the step leads over: of those at the edges
   of other faces the nearest in space. */
static const float *across_edge(faces *f, int face, int x, int y, int step_x, int step_y)
{
    double edge[3], best = 1e9;
    const float *found = NULL;
    int other, i, k;

    point_of(face, x + 0.5 + 0.5 * step_x, y + 0.5 + 0.5 * step_y, edge);
    for (other = 0; other < 6; other++)
        for (i = 0; i < SIZE * SIZE && other != face; i++) {
            double p[3], distance = 0.0;

            point_of(other, i % SIZE + 0.5, i / SIZE + 0.5, p);
            for (k = 0; k < 3; k++)
                distance += (p[k] - edge[k]) * (p[k] - edge[k]);
            if (distance < best - 1e-9) {
                best = distance;
                found = texel_of(f, other, i % SIZE, i / SIZE);
            }
        }
    return found;
}

/* Faces with a border of one texel. */
typedef struct padded {
    float rgb[6][SIZE + 2][SIZE + 2][3];
} padded;

static void pad(faces *f, padded *out)
{
    int face, x, y, k;

    for (face = 0; face < 6; face++) {
        for (y = 0; y < SIZE; y++)
            for (x = 0; x < SIZE; x++)
                memcpy(out->rgb[face][y + 1][x + 1], texel_of(f, face, x, y), 3 * sizeof(float));
        for (x = 0; x < SIZE; x++) {
            const float *above = across_edge(f, face, x, 0, 0, -1);
            const float *below = across_edge(f, face, x, SIZE - 1, 0, 1);
            const float *left = across_edge(f, face, 0, x, -1, 0);
            const float *right = across_edge(f, face, SIZE - 1, x, 1, 0);

            memcpy(out->rgb[face][0][x + 1], above, 3 * sizeof(float));
            memcpy(out->rgb[face][SIZE + 1][x + 1], below, 3 * sizeof(float));
            memcpy(out->rgb[face][x + 1][0], left, 3 * sizeof(float));
            memcpy(out->rgb[face][x + 1][SIZE + 1], right, 3 * sizeof(float));
        }
        for (x = 0; x < 4; x++) {
            const int cx = x & 1 ? SIZE + 1 : 0, cy = x & 2 ? SIZE + 1 : 0;
            const int ix = x & 1 ? SIZE : 1, iy = x & 2 ? SIZE : 1;

            for (k = 0; k < 3; k++)
                out->rgb[face][cy][cx][k] = (out->rgb[face][iy][ix][k] + out->rgb[face][cy][ix][k]
                                             + out->rgb[face][iy][cx][k]) / 3.0f;
        }
    }
}

/* Green at a place of a face, in texels. */
static double reference(const padded *p, int face, double x, double y)
{
    const int x0 = (int)floor(x - 0.5), y0 = (int)floor(y - 0.5);
    const double fx = x - 0.5 - x0, fy = y - 0.5 - y0;

    return (1.0 - fy) * ((1.0 - fx) * (double)p->rgb[face][y0 + 1][x0 + 1][1]
                         + fx * (double)p->rgb[face][y0 + 1][x0 + 2][1])
         + fy * ((1.0 - fx) * (double)p->rgb[face][y0 + 2][x0 + 1][1]
                 + fx * (double)p->rgb[face][y0 + 2][x0 + 2][1]);
}

/* Green over the sphere, and the same times the direction, by the map's axes. */
typedef struct moments {
    double sum, first[3];
} moments;

static void moments_add(moments *m, double light, const double map_dir[3])
{
    int k;

    m->sum += light;
    for (k = 0; k < 3; k++)
        m->first[k] += light * map_dir[k];
}

enum { ALL, EQUAL_WEIGHTS, UPPER_HALF };

/* Of the faces. By equal weights every texel has a sixth of the sphere over their number. */
static moments moments_of_faces(const padded *p, int what)
{
    const int side = SIZE * SPLIT;
    moments m = { 0.0, { 0.0, 0.0, 0.0 } };
    int face, i;

    for (face = 0; face < 6; face++)
        for (i = 0; i < side * side; i++) {
            const double x = (i % side + 0.5) / SPLIT, y = (i / side + 0.5) / SPLIT;
            double point[3], dir[3], square, sr;

            point_of(face, x, y, point);
            square = point[0] * point[0] + point[1] * point[1] + point[2] * point[2];
            sr = what == EQUAL_WEIGHTS ? 4.0 * PI / 6.0 : 4.0 / (square * sqrt(square));
            sr = what == UPPER_HALF && point[1] < 0.0 ? 0.0 : sr;
            dir[0] = point[0] / sqrt(square);
            dir[1] = -point[2] / sqrt(square);
            dir[2] = point[1] / sqrt(square);
            moments_add(&m, reference(p, face, x, y) * sr / side / side, dir);
        }
    return m;
}

/* Of a map, in parts of texels, at equal steps of the cosine. */
static moments moments_of_map(const cube_map *map)
{
    const int width = map->image.width, height = map->image.height;
    const int octahedral = map->image.mapping == ENVSAMP_OCTAHEDRAL;
    const double angle = map->image.mapping == ENVSAMP_HEMISPHERE ? 0.5 * PI : PI;
    float *row = (float *)malloc((size_t)width * 3 * sizeof *row);
    moments m = { 0.0, { 0.0, 0.0, 0.0 } };
    int x, y, i;

    for (y = 0; y < height && row; y++) {
        const double north = cos(angle * y / height), south = cos(angle * (y + 1) / height);
        const double sr = octahedral ? 4.0 * PI / ((double)width * height)
                        : 2.0 * PI / width * (north - south);

        cube_row(y, row, (void *)(size_t)map);
        for (x = 0; x < width; x++)
            for (i = 0; i < 16; i++) {
                const double u = (x + (i % 4 + 0.5) / 4.0) / width, in = (i / 4 + 0.5) / 4.0;
                const double v = octahedral ? (y + in) / height
                               : acos(north * (1.0 - in) + south * in) / angle;
                float dir[3];
                double d[3];

                envsamp_uv_to_dir(map->image.mapping, (float)u, (float)v, dir);
                d[0] = (double)dir[0];
                d[1] = (double)dir[1];
                d[2] = (double)dir[2];
                moments_add(&m, (double)row[3 * x + 1] * sr / 16.0, d);
            }
    }
    free(row);
    return m;
}

/* How far the first moments are apart, over the sum. */
static double moved(const moments *a, const moments *b)
{
    double most = 0.0;
    int k;

    for (k = 0; k < 3; k++)
        most = fmax(most, fabs(a->first[k] - b->first[k]));
    return most / fabs(b->sum);
}

/* ---- tests ---- */

/* At random directions, and at points on edges and beside corners. */
static void test_lookup(faces *f, padded *p, int scene)
{
    pcg32 random = pcg32_make(9, 2);
    double worst = 0.0, most = 0.0;
    int i;

    faces_make(f, scene);
    pad(f, p);
    for (i = 0; i < 20000; i++) {
        const int face = i % 6;
        double x = SIZE * (double)pcg32_float(&random), y = SIZE * (double)pcg32_float(&random);
        double point[3], expected;
        float dir[3], rgb[3];

        x = i % 5 == 1 ? 1e-4 : i % 5 == 2 ? SIZE - 1e-4 : x;
        y = i % 7 == 1 ? 1e-4 : i % 7 == 2 ? SIZE - 1e-4 : y;
        point_of(face, x, y, point);
        dir[0] = (float)(0.7 * point[0]);
        dir[1] = (float)(0.7 * point[1]);
        dir[2] = (float)(0.7 * point[2]);
        cube_lookup(&f->as, dir, rgb);
        expected = reference(p, face, x, y);
        worst = fmax(worst, fabs((double)rgb[1] - expected));
        most = fmax(most, expected);
    }
    CHECK(most > 0.0 && worst <= 1e-4 * most, "%s: lookups at most %.2g of %.2g off",
          scene_names[scene], worst, most);
}

static const char *const mapping_names[3] = { "lat-long", "hemisphere", "octahedral" };

#define SUM_OFF 0.002           /* relative; no texel of a face is left out, or counts twice */
#define MOVED   0.007           /* a texel of a map, 5.6 degrees wide, spreads what is in it */

static void test_map(faces *f, padded *p, int scene, envsamp_mapping mapping)
{
    moments exact, got;
    cube_map map;

    faces_make(f, scene);
    pad(f, p);
    exact = moments_of_faces(p, mapping == ENVSAMP_HEMISPHERE ? UPPER_HALF : ALL);
    map = cube_map_make(&f->as, mapping);
    got = moments_of_map(&map);
    CHECK(exact.sum > 0.0 && IS_NEAR(got.sum / exact.sum, 1.0, SUM_OFF)
          && IS_NEAR(moved(&got, &exact), 0.0, MOVED),
          "%s, %s: integral %.5f of %.5f, moved by %.5f", scene_names[scene],
          mapping_names[mapping], got.sum, exact.sum, moved(&got, &exact));
}

static void exchange(faces *f, int a, int b)
{
    const float *face = f->as.faces[a];

    f->as.faces[a] = f->as.faces[b];
    f->as.faces[b] = face;
}

static void flip(faces *f, int columns)
{
    int face, x, y, k;

    for (face = 0; face < 6; face++)
        for (y = 0; y < (columns ? SIZE : SIZE / 2); y++)
            for (x = 0; x < (columns ? SIZE / 2 : SIZE); x++)
                for (k = 0; k < 3; k++) {
                    float *a = texel_of(f, face, x, y) + k;
                    float *b = texel_of(f, face, columns ? SIZE - 1 - x : x,
                                        columns ? y : SIZE - 1 - y) + k;
                    const float kept = *a;

                    *a = *b;
                    *b = kept;
                }
}

enum { SIDES, POLES, ENDS, ROWS, COLUMNS, CONTROL_COUNT };

/* Noise on three faces that meet, and nothing elsewhere, is moved by all of them. */
static void test_controls(faces *f, padded *p)
{
    static const char *const names[CONTROL_COUNT] = {
        "+x and -x exchanged", "+y and -y exchanged", "+z and -z exchanged", "rows upside down",
        "columns reversed"
    };
    int control, i;

    for (control = 0; control < CONTROL_COUNT; control++) {
        moments exact, got;
        cube_map map;

        faces_make(f, NOISE);
        for (i = 0; i < FACE_FLOATS; i++) {
            const int x = i / 3 % SIZE, y = i / 3 / SIZE;

            f->rgb[1][i] = f->rgb[3][i] = f->rgb[5][i] = 0.0f;
            f->rgb[0][i] *= x < 4 && y < 4 ? 10.0f : 1.0f;
        }
        pad(f, p);
        exact = moments_of_faces(p, ALL);
        if (control == SIDES || control == POLES || control == ENDS)
            exchange(f, 2 * (control - SIDES), 2 * (control - SIDES) + 1);
        else
            flip(f, control == COLUMNS);
        map = cube_map_make(&f->as, ENVSAMP_LATLONG);
        got = moments_of_map(&map);
        CHECK(moved(&got, &exact) > 5.0 * MOVED, "rejected: %s: moved by %.4f", names[control],
              moved(&got, &exact));
    }
}

/* What a sum over texels of equal weight says of a lamp. */
static void test_weights(faces *f, padded *p, int scene)
{
    moments exact, equal;

    faces_make(f, scene);
    pad(f, p);
    exact = moments_of_faces(p, ALL);
    equal = moments_of_faces(p, EQUAL_WEIGHTS);
    CHECK(fabs(equal.sum / exact.sum - 1.0) > 20.0 * SUM_OFF,
          "rejected: %s, every texel of the same weight: %.3f of the light", scene_names[scene],
          equal.sum / exact.sum);
}

/* Draws of a table of the rows, with light looked up in the faces: the mean is the integral, and no
   light is where nothing is drawn. */
static void test_table(faces *f, padded *p, int scene, envsamp_mapping mapping)
{
    envsamp_sizes sizes = { 0, 0 };
    envsamp_buffer table, scratch;
    const envsamp_kd *kd = NULL;
    envsamp_result result;
    moments exact;
    cube_map map;
    double sum = 0.0;
    int i, missed = 0;

    faces_make(f, scene);
    pad(f, p);
    exact = moments_of_faces(p, ALL);
    map = cube_map_make(&f->as, mapping);
    envsamp_kd_sizes(&map.image, NULL, &sizes);
    table.data = malloc(table.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    result = envsamp_kd_build_rows(&map.image, cube_row, &map, NULL, table, scratch, &kd);
    free(scratch.data);
    for (i = 0; i < 65536 && result == ENVSAMP_OK; i++) {
        float u[2], dir[3], rgb[3];
        envsamp_sample s;

        sobol_owen((uint32_t)i, 1, u);
        s = envsamp_kd_sample(kd, u[0], u[1]);
        cube_from_map(s.dir, dir);
        cube_lookup(&f->as, dir, rgb);
        sum += (double)(rgb[1] / s.pdf) / 65536.0;
        envsamp_uv_to_dir(ENVSAMP_OCTAHEDRAL, u[0], u[1], dir);
        cube_lookup(&f->as, dir, rgb);
        cube_to_map(dir, dir);
        missed += rgb[1] > 0.0f && !(envsamp_kd_pdf(kd, dir) > 0.0f);
    }
    CHECK(IS(result, ENVSAMP_OK) && IS(missed, 0) && IS_NEAR(sum / exact.sum, 1.0, 0.005),
          "%s, %s: by draws %.5f of %.5f; without density %d", scene_names[scene],
          mapping_names[mapping], sum, exact.sum, missed);
    free(table.data);
}

int main(void)
{
    static faces f;
    static padded p;
    int scene;

    for (scene = 0; scene < SCENE_COUNT; scene++) {
        test_lookup(&f, &p, scene);
        test_map(&f, &p, scene, ENVSAMP_LATLONG);
        test_map(&f, &p, scene, ENVSAMP_OCTAHEDRAL);
        if (scene != EDGE && scene != CORNER)   /* whose upper half is dark, or nearly */
            test_map(&f, &p, scene, ENVSAMP_HEMISPHERE);
        test_table(&f, &p, scene, ENVSAMP_LATLONG);
        test_table(&f, &p, scene, ENVSAMP_OCTAHEDRAL);
    }
    test_controls(&f, &p);
    test_weights(&f, &p, EDGE);
    test_weights(&f, &p, CORNER);
    return check_done();
}
