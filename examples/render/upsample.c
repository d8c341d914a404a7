/* upsample.c: see upsample.h. */
#include "upsample.h"
#include "vector.h"

#include <stdlib.h>

#define REACH 2                      /* small pixels to each side */
#define KERNEL (2 * REACH + 1)

const upsample_sigmas upsample_published = {1.0f, 0.005f, 0.005f, 0.005f};

int features_make(features *f, int width, int height)
{
    f->width = width;
    f->height = height;
    f->pixels = calloc((size_t)width * (size_t)height, sizeof *f->pixels);
    return f->pixels != NULL;
}

void features_free(features *f)
{
    free(f->pixels);
    f->pixels = NULL;
}

static float gauss_exponent(float square, float sigma)
{
    return 0.5f * square / (sigma * sigma);
}

/* Minus the logarithm of the weight of a small pixel, at that distance in small pixels. */
static float exponent(const feature *large, const feature *small, float dx, float dy,
                      const upsample_sigmas *s)
{
    float normal[3], albedo[3], to[3], plane;

    vec_sub(small->normal, large->normal, normal);
    vec_sub(small->albedo, large->albedo, albedo);
    vec_sub(small->at, large->at, to);
    plane = vec_dot(to, large->normal) / large->depth;
    return gauss_exponent(dx * dx + dy * dy, s->spatial)
         + gauss_exponent(vec_dot(normal, normal), s->normal)
         + gauss_exponent(vec_dot(albedo, albedo), s->albedo)
         + gauss_exponent(plane * plane, s->depth);
}

static void upsample_pixel(const features *small, const image *small_rgb, const feature *large,
                           const float at[2], const upsample_sigmas *sigmas, float rgb[3])
{
    const int left = (int)floorf(at[0]) - REACH, top = (int)floorf(at[1]) - REACH;
    float exponents[KERNEL * KERNEL], least = INFINITY, weights = 0.0f, sum[3] = {0, 0, 0};
    int i, k;

    for (i = 0; i < KERNEL * KERNEL; i++) {
        const int x = left + i % KERNEL, y = top + i / KERNEL;
        const feature *f = &small->pixels[y * small->width + x];

        exponents[i] = INFINITY;
        if (x < 0 || y < 0 || x >= small->width || y >= small->height || !(f->depth > 0.0f))
            continue;
        exponents[i] = exponent(large, f, (float)x + 0.5f - at[0], (float)y + 0.5f - at[1], sigmas);
        least = fminf(least, exponents[i]);
    }
    for (i = 0; i < KERNEL * KERNEL && least < INFINITY; i++) {
        const int pixel = (top + i / KERNEL) * small->width + left + i % KERNEL;
        const float weight = exponents[i] < INFINITY ? expf(least - exponents[i]) : 0.0f;

        for (k = 0; k < 3 && weight > 0.0f; k++)
            sum[k] += weight * small_rgb->rgb[3 * pixel + k];
        weights += weight;
    }
    for (k = 0; k < 3 && weights > 0.0f; k++)
        rgb[k] += large->share * sum[k] / weights;
}

void upsample_add(const features *small, const image *small_rgb, const features *large,
                  const upsample_sigmas *sigmas, image *rgb)
{
    const float across = (float)small->width / (float)large->width;
    const float down = (float)small->height / (float)large->height;
    int x, y;

    for (y = 0; y < large->height; y++)
        for (x = 0; x < large->width; x++) {
            const int pixel = y * large->width + x;
            float at[2];

            at[0] = ((float)x + 0.5f) * across;
            at[1] = ((float)y + 0.5f) * down;
            if (large->pixels[pixel].depth > 0.0f)
                upsample_pixel(small, small_rgb, &large->pixels[pixel], at,
                               sigmas ? sigmas : &upsample_published, rgb->rgb + 3 * pixel);
        }
}
