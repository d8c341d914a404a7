/* scene.c: see scene.h. */
#include "scene.h"
#include "shapes.h"
#include "vector.h"

#if defined(__has_include)
#if __has_include(<embree3/rtcore.h>)
#include <embree3/rtcore.h>
#else
#include <embree4/rtcore.h>
#endif
#else
#include <embree3/rtcore.h>
#endif

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define OFFSET 2e-4f                 /* from the surface to where further rays begin */
#define OBJECTS_MAX 24
#define KNOT_TUBE 0.17f              /* radius */
#define KNOT_ALONG 400               /* vertices */
#define KNOT_AROUND 48
#define KNOT_PROXIES 40

/* A mesh, or a sphere where `radius` is above 0. */
typedef struct object {
    mesh shape;
    float centre[3], radius;
    material material, other;        /* other: of every second field of a checkered ground */
    float field;                     /* side of a field; 0: no fields */
} object;

struct scene {
    RTCDevice device;
    RTCScene rays;
    float eye[3], axes[3][3], height;    /* axes: right, up, forward; height of the picture at 1 */
    int object_count, proxy_count;
    object objects[OBJECTS_MAX];
    scene_proxy proxies[PROXIES_MAX];
};

/* ---- materials ---- */

static material lambert(float r, float g, float b)
{
    const float albedo[3] = {r, g, b};

    return material_lambert(albedo);
}

static material plastic(float r, float g, float b, float alpha)
{
    const float base[3] = {r, g, b};

    return material_plastic(base, 1.5f, alpha);
}

static material conductor(float r, float g, float b, float alpha_x, float alpha_y)
{
    const float reflectance[3] = {r, g, b};

    return material_conductor(reflectance, alpha_x, alpha_y);
}

/* ---- objects ---- */

static object *add_object(scene *s, material m)
{
    object *o = &s->objects[s->object_count++];

    o->material = m;
    return o;
}

static void add_proxy(scene *s, float x, float y, float z, float radius)
{
    scene_proxy *p = &s->proxies[s->proxy_count];

    if (s->proxy_count == PROXIES_MAX)
        return;
    vec_set(p->centre, x, y, z);
    p->radius = radius;
    s->proxy_count++;
}

static int add_ground(scene *s, material m, material other, float field)
{
    object *o = add_object(s, m);

    o->other = other;
    o->field = field;
    return mesh_disc(&o->shape, 60.0f, 0.01f, 96);
}

/* A round table; beyond it the map is seen also below the horizon. */
static int add_table(scene *s, material m, material other, float field)
{
    object *o = add_object(s, m);

    o->other = other;
    o->field = field;
    return mesh_disc(&o->shape, 2.1f, 0.25f, 160);
}

static int add_sphere(scene *s, material m, float x, float y, float radius)
{
    object *o = add_object(s, m);

    vec_set(o->centre, x, y, radius);
    o->radius = radius;
    add_proxy(s, x, y, radius, 0.98f * radius);
    return 1;
}

static int add_vase(scene *s, material m, float x, float y, float scale)
{
    const float at[3] = {x, y, 0.0f};
    object *o = add_object(s, m);

    if (!mesh_vase(&o->shape, 160, 128))
        return 0;
    mesh_place(&o->shape, 0, scale, 0.0f, at);
    add_proxy(s, x, y, 0.44f * scale, 0.33f * scale);
    add_proxy(s, x, y, 0.24f * scale, 0.2f * scale);
    add_proxy(s, x, y, 0.68f * scale, 0.2f * scale);
    add_proxy(s, x, y, 0.83f * scale, 0.12f * scale);
    return 1;
}

/* The knot stands on its side: x and z are exchanged for that. */
static int add_knot(scene *s, material m, const float at[3], float scale, float turn)
{
    object *o = add_object(s, m);
    int i;

    if (!mesh_knot(&o->shape, 2, 3, KNOT_TUBE, KNOT_ALONG, KNOT_AROUND))
        return 0;
    for (i = 0; i < o->shape.vertex_count; i++) {
        vertex *v = &o->shape.vertices[i];

        vec_set(v->at, v->at[2], v->at[1], -v->at[0]);
        vec_set(v->normal, v->normal[2], v->normal[1], -v->normal[0]);
        vec_set(v->tangent, v->tangent[2], v->tangent[1], -v->tangent[0]);
    }
    mesh_place(&o->shape, 0, scale, turn, at);
    for (i = 0; i < KNOT_PROXIES; i++) {     /* the middle of a ring is that of two of its points */
        const vertex *ring = &o->shape.vertices[(i * KNOT_ALONG / KNOT_PROXIES)
                                                * (KNOT_AROUND + 1)];
        const float *a = ring[0].at, *b = ring[KNOT_AROUND / 2].at;

        add_proxy(s, 0.5f * (a[0] + b[0]), 0.5f * (a[1] + b[1]), 0.5f * (a[2] + b[2]),
                  0.98f * KNOT_TUBE * scale);
    }
    return 1;
}

/* Turns the vertices of a layer about z. */
static void turn_layer(mesh *m, int first, float z, float turn)
{
    static const float here[3] = {0.0f, 0.0f, 0.0f};
    int i;

    for (i = first; i < m->vertex_count; i++)
        if (m->vertices[i].at[2] > z) {
            mesh one = *m;

            one.vertex_count = i + 1;
            mesh_place(&one, i, 1.0f, turn, here);
        }
}

/* Stickers of one face of a 3 x 3 x 3 cube of half side 1.5. */
static int add_stickers(mesh *m, int face)
{
    const int out = face / 2;
    int i, k;

    for (i = 0; i < 9; i++) {
        float centre[3], half[3];

        for (k = 0; k < 3; k++)
            half[k] = k == out ? 0.045f : 0.405f;
        centre[out] = face % 2 ? -1.5f : 1.5f;
        centre[(out + 1) % 3] = (float)(i % 3 - 1);
        centre[(out + 2) % 3] = (float)(i / 3 - 1);
        if (!mesh_box(m, centre, half, 0.035f))
            return 0;
    }
    return 1;
}

/* A puzzle cube of side 1 whose upper layer is turned half the way. */
static int add_cube(scene *s, float alpha, const float at[3], float scale, float turn)
{
    static const float colours[6][3] = {{0.55f, 0.03f, 0.03f}, {0.75f, 0.22f, 0.02f},
                                        {0.02f, 0.11f, 0.48f}, {0.02f, 0.36f, 0.10f},
                                        {0.74f, 0.74f, 0.70f}, {0.80f, 0.62f, 0.03f}};
    const float up[3] = {at[0], at[1], at[2] + 0.5f * scale};
    static const float half[3] = {0.49f, 0.49f, 0.49f};
    object *o = add_object(s, plastic(0.02f, 0.02f, 0.02f, alpha));
    int face, i;

    for (i = 0; i < 27; i++) {
        const float centre[3] = {(float)(i % 3 - 1), (float)(i / 3 % 3 - 1), (float)(i / 9 - 1)};

        if (i != 13 && !mesh_box(&o->shape, centre, half, 0.07f))
            return 0;
    }
    add_proxy(s, up[0], up[1], up[2], 0.49f * scale);
    for (face = 0; face <= 6; face++) {
        if (face) {
            const float *c = colours[face - 1];

            o = add_object(s, plastic(c[0], c[1], c[2], alpha));
            if (!add_stickers(&o->shape, face - 1))
                return 0;
        }
        turn_layer(&o->shape, 0, 0.505f, 0.62f);
        mesh_place(&o->shape, 0, scale / 3.0f, turn, up);
    }
    return 1;
}

/* ---- scenes ---- */

static void look(scene *s, const float eye[3], const float target[3], float degrees)
{
    static const float up[3] = {0.0f, 0.0f, 1.0f};

    vec_copy(eye, s->eye);
    vec_sub(target, eye, s->axes[2]);
    vec_normalize(s->axes[2]);
    vec_cross(s->axes[2], up, s->axes[0]);
    vec_normalize(s->axes[0]);
    vec_cross(s->axes[0], s->axes[2], s->axes[1]);
    s->height = 2.0f * tanf(degrees * VEC_PI / 360.0f);
}

/* All diffuse. */
static int build_vase(scene *s)
{
    static const float eye[3] = {0.1f, -4.6f, 1.9f}, target[3] = {0.05f, 0.0f, 0.52f};
    static const float knot[3] = {1.12f, 0.25f, 0.65f};

    look(s, eye, target, 30.0f);
    return add_ground(s, lambert(0.52f, 0.51f, 0.49f), lambert(0.36f, 0.35f, 0.34f), 0.8f)
        && add_vase(s, lambert(0.70f, 0.68f, 0.64f), -0.95f, 0.25f, 1.4f)
        && add_knot(s, lambert(0.13f, 0.40f, 0.33f), knot, 0.55f, 0.9f)
        && add_sphere(s, lambert(0.72f, 0.24f, 0.10f), 0.12f, -0.55f, 0.4f)
        && add_sphere(s, lambert(0.75f, 0.56f, 0.14f), 0.35f, 1.2f, 0.5f);
}

/* Rough plastic on a diffuse ground. */
static int build_cube(scene *s)
{
    static const float eye[3] = {-0.3f, -4.2f, 2.0f}, target[3] = {0.05f, 0.0f, 0.5f};
    static const float cube[3] = {-0.5f, -0.05f, 0.0f};

    look(s, eye, target, 28.0f);
    return add_ground(s, lambert(0.58f, 0.56f, 0.53f), lambert(0.58f, 0.56f, 0.53f), 0.0f)
        && add_cube(s, 0.25f, cube, 1.0f, 0.5f)
        && add_vase(s, plastic(0.10f, 0.36f, 0.52f, 0.3f), 0.85f, 0.35f, 1.3f)
        && add_sphere(s, plastic(0.65f, 0.50f, 0.18f, 0.2f), 0.42f, -0.8f, 0.28f);
}

/* Metallic paint, fabric and plastic on a table. */
static int build_knot(scene *s)
{
    static const float eye[3] = {0.2f, -4.7f, 1.85f}, target[3] = {0.0f, 0.0f, 0.5f};
    static const float knot[3] = {0.05f, 0.25f, 0.80f};

    look(s, eye, target, 30.0f);
    return add_table(s, lambert(0.52f, 0.50f, 0.47f), lambert(0.38f, 0.36f, 0.34f), 0.5f)
        && add_knot(s, material_metallic_paint(), knot, 0.68f, 1.25f)
        && add_sphere(s, material_fabric(), -1.12f, -0.15f, 0.46f)
        && add_vase(s, plastic(0.66f, 0.60f, 0.48f, 0.15f), 1.15f, 0.1f, 1.1f)
        && add_sphere(s, material_metallic_paint(), 0.62f, -0.9f, 0.24f);
}

/* Semi-glossy metal on a table. */
static int build_metal(scene *s)
{
    static const float eye[3] = {0.0f, -4.6f, 1.8f}, target[3] = {0.0f, 0.0f, 0.5f};
    static const float cube[3] = {0.95f, 0.3f, 0.0f};
    const material wood = plastic(0.30f, 0.19f, 0.11f, 0.35f);

    look(s, eye, target, 30.0f);
    return add_table(s, wood, wood, 0.0f)
        && add_vase(s, conductor(0.95f, 0.64f, 0.54f, 0.28f, 0.10f), -0.9f, 0.35f, 1.4f)
        && add_sphere(s, conductor(1.00f, 0.78f, 0.34f, 0.20f, 0.20f), 0.05f, -0.35f, 0.45f)
        && add_cube(s, 0.15f, cube, 0.8f, 0.35f)
        && add_sphere(s, conductor(0.91f, 0.92f, 0.92f, 0.30f, 0.30f), -0.25f, 1.1f, 0.5f);
}

/* Highly glossy: chrome steel, polished metal and lacquer. */
static int build_chrome(scene *s)
{
    static const float eye[3] = {0.1f, -4.6f, 1.7f}, target[3] = {0.0f, 0.0f, 0.52f};
    static const float knot[3] = {-0.98f, 0.35f, 0.69f};
    const material lacquer = plastic(0.10f, 0.10f, 0.11f, 0.12f);

    look(s, eye, target, 30.0f);
    return add_table(s, lacquer, lacquer, 0.0f)
        && add_knot(s, conductor(1.00f, 0.77f, 0.35f, 0.06f, 0.06f), knot, 0.58f, 0.8f)
        && add_sphere(s, material_chrome_steel(), 0.15f, -0.2f, 0.5f)
        && add_vase(s, plastic(0.48f, 0.03f, 0.03f, 0.04f), 1.15f, 0.3f, 1.25f)
        && add_sphere(s, conductor(0.95f, 0.64f, 0.54f, 0.10f, 0.10f), 0.72f, -0.95f, 0.24f);
}

const scene_entry scene_list[] = {
    {"vase", "diffuse: vase, knot and spheres on a checkered ground"},
    {"cube", "rough plastic: puzzle cube, vase and sphere on a diffuse ground"},
    {"knot", "Ward: metallic paint, fabric, and a plastic vase"},
    {"metal", "semi-glossy: brushed and rough metal and a puzzle cube on a table"},
    {"chrome", "highly glossy: chrome steel, polished metal and lacquer on a table"},
    {NULL, NULL}
};

static int (*const scene_builds[])(scene *) = {
    build_vase, build_cube, build_knot, build_metal, build_chrome
};

/* ---- Embree ---- */

/* Copies a mesh, or a sphere, to Embree. The number of a geometry is that of its object. */
static int attach(scene *s, int number)
{
    const object *o = &s->objects[number];
    const mesh *m = &o->shape;
    RTCGeometry geometry = rtcNewGeometry(s->device, o->radius > 0.0f
                                          ? RTC_GEOMETRY_TYPE_SPHERE_POINT
                                          : RTC_GEOMETRY_TYPE_TRIANGLE);
    int i;

    if (o->radius > 0.0f) {
        float *sphere = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0,
                                                RTC_FORMAT_FLOAT4, 4 * sizeof *sphere, 1);

        if (!sphere)
            return 0;
        vec_copy(o->centre, sphere);
        sphere[3] = o->radius;
    } else {
        float *at = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                            3 * sizeof *at, (size_t)m->vertex_count);
        void *index = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                              sizeof *m->triangles, (size_t)m->triangle_count);

        if (!at || !index)
            return 0;
        for (i = 0; i < m->vertex_count; i++)
            vec_copy(m->vertices[i].at, at + 3 * i);
        memcpy(index, m->triangles, (size_t)m->triangle_count * sizeof *m->triangles);
    }
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(s->rays, geometry, (unsigned)number);
    rtcReleaseGeometry(geometry);
    return 1;
}

/* One thread builds, so that the tree is the same every time. */
static int attach_all(scene *s)
{
    int i;

    s->device = rtcNewDevice("threads=1");
    if (!s->device)
        return 0;
    s->rays = rtcNewScene(s->device);
    if (!s->rays)
        return 0;
    rtcSetSceneFlags(s->rays, RTC_SCENE_FLAG_ROBUST);
    for (i = 0; i < s->object_count; i++)
        if (!attach(s, i))
            return 0;
    rtcCommitScene(s->rays);
    return rtcGetDeviceError(s->device) == RTC_ERROR_NONE;
}

/* Hands what was built to Embree. */
static scene *scene_finish(scene *s, int built)
{
    if (built && attach_all(s))
        return s;
    scene_close(s);
    return NULL;
}

scene *scene_open(const char *name, char *error, size_t error_size)
{
    int i = 0;
    scene *s;

    while (scene_list[i].name && strcmp(scene_list[i].name, name))
        i++;
    if (!scene_list[i].name) {
        snprintf(error, error_size, "%s: no such scene; --list shows them", name);
        return NULL;
    }
    s = calloc(1, sizeof *s);
    s = scene_finish(s, s && scene_builds[i](s));
    if (!s)
        snprintf(error, error_size, "%s: not enough memory for the scene", name);
    return s;
}

scene *scene_sphere(const material *m)
{
    static const float eye[3] = {0.0f, -4.2f, 1.3f}, target[3] = {0.0f, 0.0f, 1.0f};
    scene *s = calloc(1, sizeof *s);

    if (s)
        look(s, eye, target, 30.0f);
    return scene_finish(s, s && add_sphere(s, *m, 0.0f, 0.0f, 1.0f));
}

void scene_close(scene *s)
{
    int i;

    if (!s)
        return;
    for (i = 0; i < s->object_count; i++)
        mesh_free(&s->objects[i].shape);
    if (s->rays)
        rtcReleaseScene(s->rays);
    if (s->device)
        rtcReleaseDevice(s->device);
    free(s);
}

/* ---- rays ---- */

void scene_ray(const scene *s, float x, float y, float aspect, float from[3], float dir[3])
{
    vec_copy(s->eye, from);
    vec_along(s->axes[2], s->height * aspect * (x - 0.5f), s->axes[0], dir);
    vec_along(dir, s->height * (0.5f - y), s->axes[1], dir);
    vec_normalize(dir);
}

static void set_ray(struct RTCRay *ray, const float from[3], const float dir[3])
{
    memset(ray, 0, sizeof *ray);
    ray->org_x = from[0];
    ray->org_y = from[1];
    ray->org_z = from[2];
    ray->dir_x = dir[0];
    ray->dir_y = dir[1];
    ray->dir_z = dir[2];
    ray->tfar = INFINITY;
    ray->mask = 0xffffffffu;
}

/* Shading normal and tangent of a mesh, interpolated. */
static void mesh_shading(const mesh *m, unsigned number, float u, float v, float normal[3],
                         float tangent[3])
{
    const unsigned *t = m->triangles[number];
    const vertex *a = &m->vertices[t[0]], *b = &m->vertices[t[1]], *c = &m->vertices[t[2]];
    int i;

    for (i = 0; i < 3; i++) {
        normal[i] = (1.0f - u - v) * a->normal[i] + u * b->normal[i] + v * c->normal[i];
        tangent[i] = (1.0f - u - v) * a->tangent[i] + u * b->tangent[i] + v * c->tangent[i];
    }
}

/* Turns the normals to where the ray came from. A shading normal that the eye sees the back of,
   near a silhouette, becomes that of the triangle. */
static void face_ray(const float dir[3], float flat[3], float normal[3])
{
    if (vec_dot(flat, dir) > 0.0f) {
        vec_negate(flat, flat);
        vec_negate(normal, normal);
    }
    vec_normalize(normal);
    if (vec_dot(normal, dir) >= -1e-3f || vec_dot(normal, flat) <= 0.0f)
        vec_copy(flat, normal);
}

static const material *object_material(const object *o, const float at[3])
{
    int odd;

    if (!(o->field > 0.0f))
        return &o->material;
    odd = (int)floorf(at[0] / o->field) + (int)floorf(at[1] / o->field);
    return odd & 1 ? &o->other : &o->material;
}

int scene_closest(const scene *s, const float from[3], const float dir[3], scene_hit *hit)
{
    static const float up[3] = {0.0f, 0.0f, 1.0f};
    struct RTCRayHit ray;
    float normal[3], tangent[3];
    const object *o;
#if RTC_VERSION_MAJOR < 4
    struct RTCIntersectContext context;
#endif

    set_ray(&ray.ray, from, dir);
    memset(&ray.hit, 0, sizeof ray.hit);
    ray.hit.geomID = ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
#if RTC_VERSION_MAJOR < 4
    rtcInitIntersectContext(&context);
    rtcIntersect1(s->rays, &context, &ray);
#else
    rtcIntersect1(s->rays, &ray, NULL);
#endif
    if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return 0;
    o = &s->objects[ray.hit.geomID];
    hit->distance = ray.ray.tfar;
    vec_along(from, hit->distance, dir, hit->at);
    vec_set(hit->flat, ray.hit.Ng_x, ray.hit.Ng_y, ray.hit.Ng_z);
    if (o->radius > 0.0f) {
        vec_sub(hit->at, o->centre, hit->flat);
        vec_copy(hit->flat, normal);
        vec_cross(up, normal, tangent);
    } else {
        mesh_shading(&o->shape, ray.hit.primID, ray.hit.u, ray.hit.v, normal, tangent);
        if (vec_dot(normal, hit->flat) < 0.0f)
            vec_negate(hit->flat, hit->flat);
    }
    vec_normalize(hit->flat);
    face_ray(dir, hit->flat, normal);
    vec_make_basis(normal, tangent, &hit->basis);
    hit->material = object_material(o, hit->at);
    vec_along(hit->at, OFFSET, hit->flat, hit->at);
    return 1;
}

int scene_proxies(const scene *s, const scene_proxy **proxies)
{
    *proxies = s->proxies;
    return s->proxy_count;
}

int scene_occluded(const scene *s, const float from[3], const float dir[3])
{
    struct RTCRay ray;
#if RTC_VERSION_MAJOR < 4
    struct RTCIntersectContext context;
#endif

    set_ray(&ray, from, dir);
#if RTC_VERSION_MAJOR < 4
    rtcInitIntersectContext(&context);
    rtcOccluded1(s->rays, &context, &ray);
#else
    rtcOccluded1(s->rays, &ray, NULL);
#endif
    return ray.tfar < 0.0f;
}
