/* maps.c: the made-up environment maps of maps.h. */
#include "maps.h"
#include "random.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#define PI 3.14159265358979f

typedef struct vec3 {
    float x, y, z;
} vec3;

/* ---- small math ---- */

static vec3 vec3_make(float x, float y, float z)
{
    vec3 v;

    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static vec3 add(vec3 a, vec3 b)
{
    return vec3_make(a.x + b.x, a.y + b.y, a.z + b.z);
}

static vec3 subtract(vec3 a, vec3 b)
{
    return vec3_make(a.x - b.x, a.y - b.y, a.z - b.z);
}

static vec3 scale(vec3 a, float s)
{
    return vec3_make(a.x * s, a.y * s, a.z * s);
}

static vec3 mix(vec3 a, vec3 b, float t)
{
    return add(scale(a, 1.0f - t), scale(b, t));
}

static float dot(vec3 a, vec3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static vec3 cross(vec3 a, vec3 b)
{
    return vec3_make(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static vec3 normalize(vec3 a)
{
    return scale(a, 1.0f / sqrtf(dot(a, a)));
}

static float clamp01(float x)
{
    return x < 0.0f ? 0.0f : x > 1.0f ? 1.0f : x;
}

static float smoothstep(float low, float high, float x)
{
    const float t = clamp01((x - low) / (high - low));

    return t * t * (3.0f - 2.0f * t);
}

/* ---- noise ---- */

static float hash_unit(int a, int b, int c)
{
    return unit_float(hash_combine(hash_combine((uint32_t)a, (uint32_t)b), (uint32_t)c));
}

/* Random values on the integer lattice, blended smoothly between its corners. */
static float value_noise(vec3 p)
{
    const float x = floorf(p.x), y = floorf(p.y), z = floorf(p.z);
    const float tx = smoothstep(0.0f, 1.0f, p.x - x);
    const float ty = smoothstep(0.0f, 1.0f, p.y - y);
    const float tz = smoothstep(0.0f, 1.0f, p.z - z);
    float sum = 0.0f;
    int corner;

    for (corner = 0; corner < 8; corner++) {
        const int i = corner & 1, j = (corner >> 1) & 1, k = corner >> 2;
        const float weight = (i ? tx : 1.0f - tx) * (j ? ty : 1.0f - ty) * (k ? tz : 1.0f - tz);
        sum += weight * hash_unit((int)x + i, (int)y + j, (int)z + k);
    }
    return sum;
}

/* Octaves of noise in [0, 1), each half as strong and about twice as fine as the one before. */
static float fractal_noise(vec3 p, int octaves)
{
    float sum = 0.0f, total = 0.0f, weight = 1.0f;
    int i;

    for (i = 0; i < octaves; i++) {
        sum += weight * value_noise(p);
        total += weight;
        weight *= 0.5f;
        /* The offset keeps the octaves' lattices from meeting at the origin. */
        p = add(scale(p, 2.03f), vec3_make(17.3f, 5.9f, 31.7f));
    }
    return sum / total;
}

/* ---- filling a map ---- */

/* What a shader may know about its texel. */
typedef struct texel {
    vec3 direction;
    float u, elevation; /* azimuth as a fraction of a turn; radians above the horizon */
    float step_rad;     /* angle between neighbouring rows */
    int column, row;
} texel;

static vec3 direction_of(float phi, float elevation)
{
    const float level = cosf(elevation);

    return vec3_make(level * cosf(phi), level * sinf(phi), sinf(elevation));
}

static texel texel_at(const image *map, int column, int row)
{
    texel t;

    t.column = column;
    t.row = row;
    t.step_rad = PI / (float)map->height;
    t.u = ((float)column + 0.5f) / (float)map->width;
    t.elevation = 0.5f * PI - t.step_rad * ((float)row + 0.5f);
    t.direction = direction_of(2.0f * PI * t.u, t.elevation);
    return t;
}

static void fill(image *map, vec3 (*shade)(const texel *t))
{
    int row, column;

    for (row = 0; row < map->height; row++)
        for (column = 0; column < map->width; column++) {
            float *rgb = map->rgb + 3 * ((size_t)row * (size_t)map->width + (size_t)column);
            const texel t = texel_at(map, column, row);
            const vec3 radiance = shade(&t);
            rgb[0] = radiance.x;
            rgb[1] = radiance.y;
            rgb[2] = radiance.z;
        }
}

static float texel_sr(const image *map, int row)
{
    const float step = PI / (float)map->height;

    return 2.0f * PI / (float)map->width * 2.0f * sinf(0.5f * step) *
           sinf(step * ((float)row + 0.5f));
}

/* Adds a light that is smaller than a texel: the texel gets its irradiance at normal incidence
 * over the texel's solid angle, so the light keeps its power at every resolution. */
static void splat(image *map, vec3 direction, vec3 irradiance)
{
    const float theta = atan2f(sqrtf(direction.x * direction.x + direction.y * direction.y),
                               direction.z);
    float u = atan2f(direction.y, direction.x) / (2.0f * PI);
    int row = (int)(theta / PI * (float)map->height);
    int column;
    float *rgb, factor;

    u = u < 0.0f ? u + 1.0f : u;
    column = (int)(u * (float)map->width);
    column = column < map->width ? column : map->width - 1;
    row = row < map->height ? row : map->height - 1;
    rgb = map->rgb + 3 * ((size_t)row * (size_t)map->width + (size_t)column);
    factor = 1.0f / texel_sr(map, row);
    rgb[0] += irradiance.x * factor;
    rgb[1] += irradiance.y * factor;
    rgb[2] += irradiance.z * factor;
}

/* Adds a disc of even radiance as many splats along a sunflower spiral, which is even to well
 * below a texel and covers exactly the disc's power however coarse the map. */
static void splat_disc(image *map, vec3 centre, float radius_rad, vec3 radiance)
{
    const int count = 1 << 16;
    const float turn = 2.39996323f;
    const vec3 aside = normalize(cross(centre, vec3_make(0.0f, 0.0f, 1.0f)));
    const vec3 above = cross(aside, centre);
    const vec3 part = scale(radiance, PI * radius_rad * radius_rad / (float)count);
    int i;

    for (i = 0; i < count; i++) {
        const float r = radius_rad * sqrtf(((float)i + 0.5f) / (float)count);
        const float angle = fmodf(turn * (float)i, 2.0f * PI);
        const vec3 offset = add(scale(aside, r * cosf(angle)), scale(above, r * sinf(angle)));
        splat(map, normalize(add(centre, offset)), part);
    }
}

/* ---- sky ---- */

#define SUN_PHI 2.1f
#define SUN_ELEVATION 0.62f
#define SUN_RADIUS_RAD 0.00873f
#define SKY_RADIANCE 0.4f
#define SUN_RADIANCE (1e5f * SKY_RADIANCE)

static vec3 clear_sky(vec3 d, vec3 sun)
{
    const vec3 zenith = {0.05f, 0.14f, 0.44f}, horizon = {0.62f, 0.74f, 0.90f};
    const float up = d.z > 0.0f ? d.z : 0.0f;
    const float to_sun = clamp01(dot(d, sun));
    const float glow = 0.30f * powf(to_sun, 12.0f) + 1.1f * powf(to_sun, 220.0f) +
                       6.0f * powf(to_sun, 4000.0f);
    const vec3 base = mix(zenith, horizon, powf(1.0f - up, 3.5f));

    return add(base, scale(vec3_make(1.0f, 0.92f, 0.78f), glow));
}

/* Density of the cloud layer above the point of the plane z = 1. */
static float cloud_density(float x, float y)
{
    const float noise = fractal_noise(vec3_make(1.1f * x + 40.0f, 1.1f * y + 7.0f, 3.5f), 6);

    return smoothstep(0.47f, 0.68f, noise);
}

static vec3 add_clouds(vec3 background, vec3 d, vec3 sun)
{
    const float reach = 1.0f / (d.z + 0.10f);
    const float x = d.x * reach, y = d.y * reach;
    const float density = cloud_density(x, y);
    const float towards = cloud_density(x + 0.22f * sun.x, y + 0.22f * sun.y);
    /* Thinner cloud on the sun's side lets light in: the rim towards the sun is bright. */
    const float light = 0.62f + 0.38f * clamp01(0.8f + 0.9f * (density - towards) - 0.5f * density);
    const float near_sun = 1.0f + 0.9f * powf(clamp01(dot(d, sun)), 24.0f);
    const vec3 shade = {0.50f, 0.55f, 0.64f}, lit = {1.05f, 1.02f, 0.97f};
    const vec3 cloud = scale(mix(shade, lit, (light - 0.62f) / 0.38f), near_sun);
    const float clear = expf(-70.0f * expf(2.0f * logf(reach * 0.1f)));

    return mix(background, cloud, 0.92f * density * clamp01(clear));
}

static vec3 plain(vec3 d, vec3 haze)
{
    const float reach = 1.0f / (0.02f - d.z);
    const vec3 p = {d.x * reach, d.y * reach, 0.0f};
    const float fields = fractal_noise(scale(p, 0.35f), 4);
    const float grain = fractal_noise(scale(p, 6.0f), 4);
    const vec3 grass = {0.085f, 0.110f, 0.035f}, soil = {0.200f, 0.150f, 0.090f};
    const vec3 ground = scale(mix(grass, soil, smoothstep(0.40f, 0.62f, fields)),
                              0.55f + 0.9f * grain);

    return mix(haze, ground, 1.0f - expf(14.0f * d.z));
}

static vec3 sky_shade(const texel *t)
{
    const vec3 sun = direction_of(SUN_PHI, SUN_ELEVATION), d = t->direction;
    const vec3 level = {d.x, d.y, 0.0f};
    const float ridge = 0.012f + 0.06f * fractal_noise(scale(normalize(level), 5.0f), 5);
    const vec3 haze = clear_sky(normalize(level), sun);
    const vec3 hills = mix(vec3_make(0.10f, 0.14f, 0.13f), haze, 0.45f);
    const float above = smoothstep(ridge - t->step_rad, ridge + t->step_rad, t->elevation);
    const float below = smoothstep(-0.5f * t->step_rad, 0.5f * t->step_rad, -t->elevation);
    vec3 result = hills;

    if (above > 0.0f)
        result = mix(hills, add_clouds(clear_sky(d, sun), d, sun), above);
    if (below > 0.0f)
        result = mix(result, plain(d, hills), below);
    return result;
}

static void make_sky(image *map)
{
    fill(map, sky_shade);
    splat_disc(map, direction_of(SUN_PHI, SUN_ELEVATION), SUN_RADIUS_RAD,
               scale(vec3_make(1.05f, 1.0f, 0.86f), SUN_RADIANCE));
}

/* ---- studio ---- */

#define FLOOR_Z (-1.2f)
#define CEILING_Z 2.6f
#define WALL_DISTANCE 3.6f
#define FRAME 1.05f /* a softbox's dark rim, as a multiple of its half side */

/* A rectangle facing the camera at the origin: half sides a and b about its centre, metres. */
typedef struct softbox {
    vec3 centre, a, b, radiance;
} softbox;

static const softbox softboxes[] = {
    {{2.3f, 1.6f, 1.1f}, {-0.50f, 0.72f, 0.0f}, {-0.20f, -0.14f, 0.58f}, {26.0f, 25.0f, 23.5f}},
    {{-1.0f, 2.9f, 0.3f}, {-0.34f, -0.12f, 0.0f}, {0.0f, 0.0f, 1.05f}, {7.0f, 8.2f, 10.0f}},
    {{-2.6f, -1.1f, 0.9f}, {0.28f, -0.66f, 0.0f}, {0.12f, 0.05f, 0.42f}, {15.0f, 12.2f, 8.6f}},
    {{-0.5f, 0.4f, 2.2f}, {0.42f, 0.0f, 0.08f}, {0.0f, 0.42f, 0.0f}, {9.0f, 9.0f, 9.0f}},
    {{1.2f, -2.9f, 1.5f}, {1.25f, 0.45f, 0.0f}, {0.0f, 0.0f, 0.035f}, {90.0f, 92.0f, 100.0f}}
};

enum { SOFTBOX_COUNT = sizeof softboxes / sizeof softboxes[0] };

/* Where the ray from the origin meets the rectangle: -1 for a miss, 0 for its rim, else how
 * bright the cloth is there, a little less towards the corners. */
static float softbox_hit(const softbox *box, vec3 d)
{
    const vec3 normal = cross(box->a, box->b);
    const float facing = dot(normal, d);
    const float distance = facing != 0.0f ? dot(normal, box->centre) / facing : -1.0f;
    const vec3 p = subtract(scale(d, distance), box->centre);
    const float a = dot(p, box->a) / dot(box->a, box->a);
    const float b = dot(p, box->b) / dot(box->b, box->b);

    if (distance <= 0.0f || fabsf(a) > FRAME || fabsf(b) > FRAME)
        return -1.0f;
    if (fabsf(a) > 1.0f || fabsf(b) > 1.0f)
        return 0.0f;
    return 1.0f - 0.22f * (a * a + b * b) * 0.5f;
}

/* Irradiance of a wall from the softboxes, each cut into 3 x 3 points. Their light is emitted to
 * the camera's side only. */
static vec3 wall_irradiance(vec3 p, vec3 normal)
{
    vec3 sum = {0.0f, 0.0f, 0.0f};
    int i, j;

    for (i = 0; i < SOFTBOX_COUNT; i++) {
        const softbox *box = softboxes + i;
        const vec3 area = cross(box->a, box->b); /* a quarter of the rectangle's */
        const float sign = dot(area, box->centre) > 0.0f ? -4.0f / 9.0f : 4.0f / 9.0f;
        for (j = 0; j < 9; j++) {
            const vec3 on_box = add(box->centre, add(scale(box->a, (float)(j % 3 - 1) * 0.667f),
                                                     scale(box->b, (float)(j / 3 - 1) * 0.667f)));
            const vec3 to_box = subtract(on_box, p);
            const float square = dot(to_box, to_box) + 0.02f;
            const float received = dot(to_box, normal), sent = -dot(to_box, area) * sign;
            if (received > 0.0f && sent > 0.0f)
                sum = add(sum, scale(box->radiance, received * sent / (square * square)));
        }
    }
    return sum;
}

/* The inside of the room's box: where the ray leaves it, and the inward normal there. */
static vec3 wall_point(vec3 d, vec3 *normal)
{
    const float x = WALL_DISTANCE / fmaxf(fabsf(d.x), 1e-6f);
    const float y = WALL_DISTANCE / fmaxf(fabsf(d.y), 1e-6f);
    const float z = d.z > 0.0f ? CEILING_Z / fmaxf(d.z, 1e-6f) : FLOOR_Z / fminf(d.z, -1e-6f);
    const float nearest = fminf(x, fminf(y, z));

    if (nearest == z)
        *normal = vec3_make(0.0f, 0.0f, d.z > 0.0f ? -1.0f : 1.0f);
    else if (nearest == x)
        *normal = vec3_make(d.x > 0.0f ? -1.0f : 1.0f, 0.0f, 0.0f);
    else
        *normal = vec3_make(0.0f, d.y > 0.0f ? -1.0f : 1.0f, 0.0f);
    return scale(d, nearest);
}

static vec3 room(vec3 d)
{
    const vec3 bounce = {0.030f, 0.029f, 0.028f};
    vec3 normal, p = wall_point(d, &normal), light;
    vec3 albedo = {0.115f, 0.115f, 0.120f};

    if (normal.z > 0.0f)
        albedo = scale(vec3_make(0.30f, 0.285f, 0.265f),
                       0.85f + 0.3f * fractal_noise(scale(p, 9.0f), 3));
    else if (normal.z < 0.0f)
        albedo = scale(albedo, 0.5f);
    light = add(scale(wall_irradiance(p, normal), 1.0f / PI), bounce);
    return vec3_make(albedo.x * light.x, albedo.y * light.y, albedo.z * light.z);
}

/* Lights are sampled 4 x 4 times a texel for smooth edges; the room is smooth already. */
static vec3 studio_shade(const texel *t)
{
    const vec3 behind = room(t->direction), rim = {0.008f, 0.008f, 0.009f};
    vec3 sum = {0.0f, 0.0f, 0.0f};
    int i, j;

    for (i = 0; i < 16; i++) {
        const float right = ((float)(i % 4) - 1.5f) * 0.25f, up = ((float)(i / 4) - 1.5f) * 0.25f;
        const vec3 d = direction_of(2.0f * PI * t->u + right * t->step_rad,
                                    t->elevation + up * t->step_rad);
        vec3 seen = behind;
        for (j = 0; j < SOFTBOX_COUNT; j++) {
            const float hit = softbox_hit(softboxes + j, d);
            if (hit >= 0.0f)
                seen = hit > 0.0f ? scale(softboxes[j].radiance, hit) : rim;
        }
        sum = add(sum, scale(seen, 1.0f / 16.0f));
    }
    return sum;
}

/* ---- night ---- */

#define LAMP_COUNT 56
#define STAR_COUNT 700
#define EYE_HEIGHT 1.7f
#define LAMP_HEIGHT 5.5f

typedef struct lamp {
    vec3 position, intensity; /* metres from the eye; watts a steradian */
} lamp;

/* Two rows of lamps along a street, and others scattered behind, with powers over three decades. */
static lamp lamp_at(int index)
{
    const float a = hash_unit(index, 1, 11), b = hash_unit(index, 2, 11);
    const float c = hash_unit(index, 3, 11);
    const int in_street = index < 20;
    const float along = (float)(index / 2 - 5) * 13.0f + 4.0f;
    const float radius = 14.0f + 70.0f * b;
    const vec3 sodium = {1.0f, 0.56f, 0.18f}, white = {0.85f, 0.93f, 1.0f};
    lamp result;

    result.position = in_street
        ? vec3_make(along, index % 2 ? 6.0f : -6.0f, LAMP_HEIGHT - EYE_HEIGHT)
        : vec3_make(radius * cosf(2.0f * PI * a), radius * sinf(2.0f * PI * a), 1.0f + 2.0f * c);
    result.intensity = scale(mix(sodium, white, in_street ? 0.1f * c : smoothstep(0.5f, 0.7f, c)),
                             in_street ? 22.0f + 16.0f * c : 0.3f * powf(10.0f, 2.5f * c * b));
    return result;
}

static vec3 skyline_window(float x, float elevation, int building, float floor_rad)
{
    const float columns = 7.0f;
    const float across = x * columns, up = elevation / floor_rad;
    const float inside_x = across - floorf(across), inside_y = up - floorf(up);
    const int column = (int)floorf(across), storey = (int)floorf(up);
    const float lit = hash_unit(building * 31 + column, storey, 5);
    const vec3 warm = {1.0f, 0.70f, 0.36f}, cold = {0.70f, 0.85f, 1.0f};
    const int is_pane = inside_x > 0.25f && inside_x < 0.75f && inside_y > 0.3f && inside_y < 0.8f;

    if (!is_pane || column < 1 || column > 5 || lit > 0.22f)
        return vec3_make(0.0f, 0.0f, 0.0f);
    return scale(mix(warm, cold, smoothstep(0.15f, 0.19f, lit)), 0.15f + 9.0f * (0.22f - lit));
}

/* One ring of buildings in front of `behind`. */
static vec3 skyline(vec3 behind, const texel *t, int count, float low, float high, vec3 wall)
{
    const float x = t->u * (float)count;
    const int building = (int)x + 1000 * count;
    const float tall = hash_unit(building, count, 3);
    const float roof = low + (high - low) * tall * tall;

    if (t->elevation > roof || t->elevation < -0.02f)
        return behind;
    return add(wall, skyline_window(x - floorf(x), t->elevation + 0.02f, building, high * 0.075f));
}

/* Rough water mirrors a light as a streak: sharp in azimuth, long towards the viewer. */
static float wet_gleam(vec3 d, vec3 position)
{
    const float level = sqrtf(d.x * d.x + d.y * d.y);
    const float away = sqrtf(position.x * position.x + position.y * position.y);
    const float aligned = (d.x * position.x + d.y * position.y) / fmaxf(level * away, 1e-6f);
    const float tall = position.z / away;
    const float drop = fabsf(-d.z / fmaxf(level, 1e-3f) - tall) / (0.05f + tall);

    return powf(clamp01(aligned), 1500.0f) * expf(-1.4f * drop * drop);
}

static vec3 night_ground(vec3 d)
{
    const float reach = EYE_HEIGHT / fmaxf(-d.z, 0.004f);
    const vec3 p = {d.x * reach, d.y * reach, -EYE_HEIGHT};
    const float grain = 0.7f + 0.6f * fractal_noise(scale(p, 3.0f), 4);
    const float wet = smoothstep(0.45f, 0.60f, fractal_noise(scale(p, 0.5f), 3));
    vec3 sum = {0.010f, 0.011f, 0.016f};
    int i;

    for (i = 0; i < LAMP_COUNT; i++) {
        const lamp light = lamp_at(i);
        const vec3 to_lamp = subtract(light.position, p);
        const float square = dot(to_lamp, to_lamp);
        const float gleam = wet_gleam(d, light.position);
        const float diffuse = 0.10f / PI * to_lamp.z / (square * sqrtf(square)) * grain;
        sum = add(sum, scale(light.intensity, diffuse + (0.15f + wet) * 0.35f * gleam / square));
    }
    return sum;
}

static vec3 night_shade(const texel *t)
{
    const float up = clamp01(t->direction.z);
    const float cloud = fractal_noise(scale(t->direction, 3.0f), 5);
    const vec3 zenith = {0.0025f, 0.0035f, 0.0090f}, city_glow = {0.075f, 0.045f, 0.030f};
    vec3 result = mix(zenith, city_glow, powf(1.0f - up, 5.0f) * (0.4f + 1.1f * cloud));

    if (t->elevation < -0.02f)
        return night_ground(t->direction);
    result = skyline(result, t, 61, 0.05f, 0.40f, vec3_make(0.020f, 0.017f, 0.020f));
    return skyline(result, t, 37, 0.02f, 0.24f, vec3_make(0.008f, 0.007f, 0.009f));
}

static void splat_stars(image *map)
{
    int i;

    for (i = 0; i < STAR_COUNT; i++) {
        const float z = 0.42f + 0.58f * hash_unit(i, 1, 77), phi = 2.0f * PI * hash_unit(i, 2, 77);
        const float power = 1e-6f / (0.004f + hash_unit(i, 3, 77));
        const vec3 tint = mix(vec3_make(1.0f, 0.85f, 0.7f), vec3_make(0.75f, 0.87f, 1.0f),
                              hash_unit(i, 4, 77));
        splat(map, direction_of(phi, asinf(z)), scale(tint, power));
    }
}

static void make_night(image *map)
{
    int i;

    fill(map, night_shade);
    splat_stars(map);
    for (i = 0; i < LAMP_COUNT; i++) {
        const lamp light = lamp_at(i);
        const float square = dot(light.position, light.position);
        const float radius_rad = 0.16f / sqrtf(square); /* a lamp head 32 cm wide */
        if (i < 20)
            splat_disc(map, normalize(light.position), radius_rad,
                       scale(light.intensity, 1.0f / (PI * 0.16f * 0.16f)));
        else
            splat(map, normalize(light.position), scale(light.intensity, 1.0f / square));
    }
}

/* ---- foliage ---- */

/* About a normal deviate, from the sum of three uniform numbers of variance 1/12. */
static float texel_deviate(const texel *t, int stream)
{
    const float sum = hash_unit(t->column, t->row, stream) +
                      hash_unit(t->column, t->row, stream + 1) +
                      hash_unit(t->column, t->row, stream + 2);

    return 2.0f * (sum - 1.5f);
}

/* Trunks stand on the horizon, thinner and paler with the distance. */
static float trunk_cover(const texel *t, int count, float width)
{
    const float x = t->u * (float)count + 0.12f * sinf(3.0f * t->elevation + (float)count);
    const int index = ((int)floorf(x) + count) % count;
    const float middle = 0.3f + 0.4f * hash_unit(index, count, 41);
    const float half = width * (0.5f + hash_unit(index, count, 42)) *
                       (1.0f + 0.8f * smoothstep(0.0f, -0.14f, t->elevation));
    const float off = fabsf(x - floorf(x) - middle);
    const float foot = -0.06f - 0.10f * hash_unit(index, count, 43);

    /* Leaves hide the upper part, texel by texel. */
    const float crown = 0.45f + 0.35f * hash_unit(index, count, 45) + 0.15f * texel_deviate(t, 60);

    if (t->elevation < foot || t->elevation > crown || hash_unit(index, count, 44) > 0.7f)
        return 0.0f;
    return 1.0f - smoothstep(half * 0.85f, half, off);
}

static vec3 leaves(const texel *t)
{
    const vec3 d = t->direction;
    const float clumps = fractal_noise(scale(d, 5.0f), 4);
    const float sprays = fractal_noise(scale(d, 26.0f), 3);
    const float hue = hash_unit(t->column, t->row, 7);
    const vec3 dark = {0.030f, 0.060f, 0.018f}, bright = {0.42f, 0.56f, 0.10f};
    const float light = expf(1.1f * texel_deviate(t, 10) + 5.0f * (sprays - 0.5f) - 0.3f);
    /* Gaps show the sky, mostly overhead and where clumps are thin. */
    const float gap = smoothstep(0.62f, 0.72f, 0.62f * clumps + 0.38f * sprays +
                                 0.05f * texel_deviate(t, 20) + 0.04f * d.z);
    const vec3 leaf = scale(mix(dark, bright, hue * smoothstep(0.3f, 0.7f, sprays)), light);
    const vec3 sky = scale(vec3_make(6.0f, 7.2f, 8.5f), 0.6f + 0.8f * clumps);

    return mix(leaf, sky, gap);
}

static vec3 forest_floor(const texel *t)
{
    const vec3 d = t->direction;
    const float reach = 1.0f / (0.06f - d.z);
    const vec3 p = {d.x * reach, d.y * reach, 0.0f};
    const float patches = fractal_noise(scale(p, 1.3f), 4);
    const float sunlit = smoothstep(0.60f, 0.70f, fractal_noise(scale(p, 2.6f), 4));
    const vec3 moss = {0.050f, 0.070f, 0.020f}, litter = {0.110f, 0.070f, 0.036f};
    const float speckle = expf(0.7f * texel_deviate(t, 30));

    return scale(mix(moss, litter, smoothstep(0.4f, 0.6f, patches)),
                 speckle * (1.0f + 12.0f * sunlit));
}

static vec3 foliage_shade(const texel *t)
{
    const float edge = -0.10f + 0.05f * texel_deviate(t, 50);
    const vec3 bark = scale(vec3_make(0.055f, 0.044f, 0.032f), expf(0.5f * texel_deviate(t, 40)));
    vec3 result = t->elevation > edge ? leaves(t) : forest_floor(t);

    result = mix(result, scale(bark, 1.8f), trunk_cover(t, 43, 0.06f));
    return mix(result, bark, trunk_cover(t, 17, 0.09f));
}

/* ---- by name ---- */

static vec3 constant_shade(const texel *t)
{
    (void)t;
    return vec3_make(1.0f, 1.0f, 1.0f);
}

static void make_studio(image *map)
{
    fill(map, studio_shade);
}

static void make_constant(image *map)
{
    fill(map, constant_shade);
}

static void make_foliage(image *map)
{
    fill(map, foliage_shade);
}

const char *const map_names[] = {"sky", "studio", "constant", "night", "foliage", NULL};

int map_make(const char *name, int width, int height, image *out)
{
    static void (*const makers[])(image *map) = {make_sky, make_studio, make_constant, make_night,
                                                 make_foliage};
    int i;

    memset(out, 0, sizeof *out);
    for (i = 0; map_names[i]; i++)
        if (strcmp(name, map_names[i]) == 0) {
            if (!image_alloc(out, width, height))
                return 0;
            makers[i](out);
            return 1;
        }
    return 0;
}
