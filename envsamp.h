/* envsamp.h - v0.2 - importance sampling of environment maps - MIT or public domain
 *
 * HOW TO USE IT. In one C or C++ file:
 *
 *     #define ENVSAMP_IMPLEMENTATION
 *     #include "envsamp.h"
 *
 * and in every other file that needs it, include it as it is. Link libm.
 *
 * QUICK START
 *
 *     envsamp_image image = { pixels, width, height, 3, 0, ENVSAMP_LATLONG };
 *     envsamp_sizes sizes;
 *     envsamp_buffer table, scratch;
 *     const envsamp_kd *kd;
 *
 *     envsamp_kd_sizes(&image, NULL, &sizes);             // the build repeats what fails here
 *     table.data = malloc(table.bytes = sizes.table_bytes);
 *     scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
 *     envsamp_result result = envsamp_kd_build(&image, NULL, table, scratch, &kd);
 *     free(scratch.data);
 *     if (result != ENVSAMP_OK) {
 *         printf("%s\n", envsamp_result_string(result));
 *         free(table.data);
 *         return 1;
 *     }
 *     envsamp_sample s = envsamp_kd_sample(kd, u0, u1);   // s.dir, s.pdf per steradian
 *     float pdf = envsamp_kd_pdf(kd, bsdf_dir);           // for multiple importance sampling
 *     envsamp_lookup(&image, 0, s.dir, rgb);              // bilinear, or as your engine does
 *     for (int c = 0; c < 3; c++)
 *         radiance[c] += f(s.dir)[c] * rgb[c] * visible(s.dir) / s.pdf;
 *
 * WHICH SAMPLER
 *
 *     select            blocks are drawn     points  time  bits  invert  take it when
 *     ENVSAMP_KD_WARP   by inversion, exact  stay    1.5   10    yes     the default: strata of
 *                                            strata                      Sobol points or pixels are
 *                                                                        kept, at N = 256 a third
 *                                                                        or less of ALIAS's error
 *     ENVSAMP_KD_ALIAS  by alias, exact and  become  1     8     no      numbers are random anyway:
 *                       of least variance    random                      least variance; fastest,
 *                                                                        in a renderer hardly so
 *     ENVSAMP_KD_FIT    by an analytic pdf   become  1.7   12    no      to compare with [1]: 11 %
 *                       [1]                  random                      smaller, 5 to 60 % more
 *                                                                        variance, up to 140 %
 *     envsamp_cdf       by inversion over    stay    3     10    yes     lookups take the nearest
 *                       texels               strata                      texel: no excess variance,
 *                                                                        4.5 bytes a texel
 *
 * bits: with that many bits in both u0 and u1, 16384 blocks or all texels render a sky whose sun is
 * hidden within 1 % of its brightness.
 *
 * With `facing` a table of WARP also draws light x cosine about a normal: over 18 real maps the
 * error of diffuse irradiance from 16 points is 0.30 of that of light alone, or of MIS with the
 * cosine. See envsamp_kd_sample_facing.
 *
 * Two functions need no table. envsamp_halftone draws all samples of a map at once by error
 * diffusion, for a map that is used once, such as light x BRDF x cosine at one point.
 * envsamp_lights turns a map into K directional lights.
 *
 * A table of 6144 blocks, the default, replaces the CDF of a map of any resolution. The variance
 * that it adds to that of a perfect sampler is `excess_variance` in envsamp_kd_info.
 *
 * CONVENTIONS. Lat-long maps, +z up, row 0 first:
 *
 *        u = 0                    u = 1/2                   u -> 1
 *      v = 0 +-------------------------+-------------------------+  theta = 0: +z
 *            |                                                   |
 *            |  texel (x, y) is u in [x, x+1)/width,             |  direction =
 *            |                  v in [y, y+1)/height             |  (cos phi sin theta,
 *      v=1/2 +-> +x        ^ +y (u = 1/4)    -x        -y        +   sin phi sin theta,
 *            |                                                   |   cos theta)
 *            |  phi = 2 pi u, theta = pi v                       |
 *      v -> 1+-------------------------+-------------------------+  theta = pi: -z
 *
 * Hemisphere maps are the same with theta = (pi/2) v, octahedral ones the equal-area square [7].
 * Pixels are linear radiance. pdf is per steradian. u0 and u1 are uniform in [0, 1).
 *
 * LOOKUPS. A table is made for one way to look the map up. The default is bilinear: between texel
 * centres, as most renderers and every GPU do. Density is then above zero wherever such a lookup
 * is, but for rounding, and all figures are those of the interpolated map. A table with `nearest`
 * needs lookups of the nearest texel: bilinear lookups would miss 4 to 40 % of the light of a lamp.
 * A bilinear table with nearest lookups misses nothing, but has more noise. envsamp_lookup does
 * both.
 *
 * DESCRIPTIONS. Zero is the default of every field. Set the fields that differ, in a description of
 * zeros (memset, or = { .block_count = 16384 }) or in that of _defaults(). A negative number says
 * what 0 would mean. Fields may be added at the end.
 *
 * MIS COMPENSATION [8]. `mis_compensation` times the mean luminance of the map is subtracted from
 * every texel before a table is made, so that more samples go to the lamps. Valid only in multiple
 * importance sampling with a sampler that reaches every direction, such as the BSDF's: density is
 * zero where the map is dimmer than what was subtracted. The table stores the amount. Its integral
 * stays that of the map; its other figures are of what is left.
 *
 * IMPORTANCE FOR MIS. With `importance_exponent` e, directions are drawn in proportion to luminance
 * to the power e, after any compensation. Density stays above zero wherever there is light. Under
 * MIS with the BSDF, 16 samples a point, 18 maps, RMSE is 0.86 of that without at 1.15, 0.75 with
 * full compensation, 0.73 with both; with light x cosine 0.77, at 1.15 0.69, compensated 0.63. In a
 * path tracer, where that takes longer, light alone with full compensation is best at equal time.
 * - Every use is a sum of MIS: compensation 1, exponent 1.
 * - Some are not, as in light tracing: exponent 1.15, better on all 18; 1.5 is worse on some.
 * - No MIS: exponent 1. excess_variance says what another costs.
 * integral, excess_variance and max_ratio stay those of luminance; excess_target is of what blocks
 * leave of importance. Rows are read three times, and a build takes a third longer.
 *
 * PLACING IT IN A SCENE. Build the table of the map as it is, once; turn directions, not pixels.
 * With a matrix whose rows are the map's axes in the world:
 *
 *     sample    s = envsamp_kd_sample(kd, u0, u1); world = transpose(matrix) s.dir; pdf = s.pdf
 *     pdf       envsamp_kd_pdf(kd, matrix world): into the map first, or MIS is wrong where the map
 *               is turned, though sampling alone looks right
 *     radiance  exposure * tint * envsamp_lookup(matrix world)
 *
 * - Rotations and mirrors keep solid angle, and pdf with it. Scales and shears do not.
 * - A picture is mirrored in most engines. The same way round as they show it, map (x, y, z) is,
 *   of the engine's axes: Cycles (-x, y, z); three.js (-x, -z, y); Mitsuba 3, Godot 4, Filament
 *   (-z, x, y); Unity (-x, z, y); Unreal (y, -x, z); pbrt (x, y, z). The wrong hand is unbiased,
 *   but left and right are exchanged.
 * - Exposure multiplies radiance, never pdf.
 * - So does a tint. The result is unbiased, but samples follow the luminance before the tint. Where
 *   its largest factor is k times the smallest, this adds at most (k - 1)^2 / 4k of excess variance
 *   (2 at k = 10), nothing in a grey map. Where that is too much, multiply the pixels and rebuild.
 *
 * examples/common/placement.h has these functions to copy, examples/placement.c checks them.
 *
 * GUARANTEES
 * - No heap, no stdio, no globals, no recursion. Only memcpy, memset, memcmp, square roots and
 *   assert are linked, unless overridden.
 * - One call uses less than 8 KiB of stack, your functions and sanitizers not counted: "make test"
 *   measures every function with gcc and clang, -O0 to -O3 and -Os.
 * - All memory is yours: ask _sizes, give two buffers to _build, aligned to ENVSAMP_ALIGN, 8 bytes,
 *   as any malloc does. Scratch is free again after the build. The table holds no pointers: copy
 *   it, map it, store it, send it to a GPU, and _open it there.
 * - A table is read-only after the build; any number of threads may sample it.
 * - A build validates everything that it is given and returns a named result. One that fails leaves
 *   the table buffer as it was, or as bytes that _open refuses.
 * - Sampling is safe for any float, NaN included, and gives a finite direction, 1 long within 1e-6.
 *   So it is with -ffast-math, and descriptions, pixels and tables are checked as without. But then
 *   _n differs from one at a time in the last digits, and in the block of a point at an edge.
 * - Sums over a map are doubles that only add positive numbers. Blocks of WARP have edges at whole
 *   multiples of 2^-24 in the unit square, blocks of ALIAS such probabilities: what 24-bit numbers
 *   draw is exactly what is claimed. pdf is the density that is really sampled.
 * - IEEE arithmetic with FLT_EVAL_METHOD 0, not contracted (-ffp-contract=off, which gcc's -std=c99
 *   implies), gives the same bits with any compiler, optimisation level and libm, on any processor
 *   of the same byte order, and the same numbers on those of the other. gcc's -std=c99 on s390x
 *   needs -fexcess-precision=fast for that, 32-bit x86 -msse2 -mfpmath=sse.
 *
 * CONFIGURATION, by macros defined before the include
 *   ENVSAMP_ALLOC            envsamp_kd_new and _free, envsamp_cdf_new and _free, by ENVSAMP_MALLOC
 *                            and ENVSAMP_FREE, default malloc and free. All else allocates nothing
 *   ENVSAMP_NO_LIGHTS        without lights and halftones, ENVSAMP_NO_CDF without cdf,
 *                            ENVSAMP_NO_FIT without KD_FIT, which is then refused, and lm
 *   ENVSAMP_IMPLEMENTATION   in one file: compile the functions
 *   ENVSAMP_STATIC           with it, before the first include: functions are static, for that file
 *                            alone
 *   ENVSAMP_DEVICE           qualifiers of the functions that sample one at a time, and of all that
 *                            they call; builds call those too. Default none, in CUDA and HIP
 *                            __host__ __device__
 *   ENVSAMP_ASSERT(x)        default assert(x) from assert.h
 *   ENVSAMP_SQRT(x)          double and float square root, exact to the last bit as in IEEE 754;
 *   ENVSAMP_SQRTF(x)         default sqrt and sqrtf from math.h, or an instruction that is the same
 *   ENVSAMP_FABSF(x)         default fabsf and copysignf from math.h, which every compiler makes
 *   ENVSAMP_COPYSIGNF(x, y)  an instruction or two
 *   ENVSAMP_MEMCPY, _MEMSET  default memcpy, memset and memcmp from string.h, with their results.
 *   and _MEMCMP              Compilers may call those of their own accord too
 * A header all of whose macros are defined is not included. float.h, limits.h, stddef.h and
 * stdint.h always are; a freestanding compiler has them.
 *
 * LIMITS. Directions may be 1e-15 to 1e18 long. Tables are in the byte order of the machine that
 * built them; one from a machine of the other order fails to open. Directed rounding modes are not
 * supported: in them calls end, but results may be wrong. clang, unless told
 * -ffp-exception-behavior=maytrap, raises floating-point exceptions that no line of C asks for.
 * A map with nothing brighter than 1e-36 is sampled right, but its info has lost digits.
 * Where size_t has 32 bits, _sizes refuses maps of 4 GB and buffers of 2 GB: ENVSAMP_ERR_SIZE.
 *
 * REFERENCES
 *  [1] Ergun, Kurt, Ozturk: Real-time Kd-tree Based Importance Sampling of Environment Maps. 2012
 *  [2] Vose: A linear algorithm for generating random numbers with a given distribution. 1991
 *  [3] Levenberg: A method for the solution of certain non-linear problems in least squares. 1944.
 *      Marquardt: An algorithm for least-squares estimation of nonlinear parameters. 1963
 *  [4] Veach: Robust Monte Carlo Methods for Light Transport Simulation. 1997
 *  [5] More: The Levenberg-Marquardt algorithm: implementation and theory. 1978
 *  [6] Chen, Asau: On generating random variates from an empirical distribution. 1974
 *  [7] Clarberg: Fast Equal-Area Mapping of the (Hemi)Sphere using SIMD. 2008
 *  [8] Karlik, Sik, Vevoda, Skrivan, Krivanek: MIS Compensation: Optimizing Sampling Techniques in
 *      Multiple Importance Sampling. 2019
 *  [9] Szirmay-Kalos, Szecsi, Penzov: Environment Mapping with Floyd-Steinberg Halftoning. 2010
 * [10] Floyd, Steinberg: An adaptive algorithm for spatial grayscale. 1976
 * [11] Jarvis, Judice, Ninke: A survey of techniques for the display of continuous tone pictures on
 *      bilevel displays. 1976
 * [12] Stucki: MECCA, a multiple-error correction computation algorithm for bi-level image hardcopy
 *      reproduction. 1981
 * [13] Ostromoukhov: A simple and efficient error-diffusion algorithm. 2001
 * [14] Devroye: Non-Uniform Random Variate Generation. 1986
 * [15] Stolarsky: Sums of distances between points on a sphere II. 1973
 * [16] Debevec: A median cut algorithm for light probe sampling. 2005
 * [17] Viriyothai, Debevec: Variance minimization light probe sampling. 2009
 * [18] Wu: Efficient Environment Map Rendering based on Decomposition. 2024
 * [19] Agarwal, Ramamoorthi, Belongie, Jensen: Structured importance sampling of environment maps.
 *      2003
 * [20] Nesterov: A method for solving the convex programming problem with convergence rate
 *      O(1/k^2). 1983
 * [21] Conty Estevez, Lecocq: Fast product importance sampling of environment maps. 2018
 */
#ifndef ENVSAMP_H
#define ENVSAMP_H

#include <stddef.h>
#include <stdint.h>

#ifdef ENVSAMP_STATIC
#define ENVSAMP__STATIC
#endif
#if defined(ENVSAMP__STATIC) && defined(__GNUC__)
#define ENVSAMP_DEF __attribute__((__unused__)) static
#elif defined(ENVSAMP__STATIC)
#define ENVSAMP_DEF static
#else
#define ENVSAMP_DEF extern
#endif

#ifdef ENVSAMP_DEVICE
#elif defined(__CUDACC__) || defined(__HIPCC__) || defined(__HIP__)
#define ENVSAMP_DEVICE __host__ __device__
#else
#define ENVSAMP_DEVICE
#define ENVSAMP__HOST_ONLY
#endif

#define ENVSAMP_VERSION 200     /* 0.2.0: 10000 major + 100 minor + patch */
#define ENVSAMP_ALIGN 8         /* bytes: alignment of both buffers of a build, as any malloc has */

#ifdef __cplusplus
extern "C" {
#endif

/* ---- common types ------------------------------------------------------------------------ */

typedef enum envsamp_result {
    ENVSAMP_OK = 0,
    ENVSAMP_ERR_NULL,    /* a required pointer is NULL */
    ENVSAMP_ERR_SIZE,    /* width, height, channels or stride out of range */
    ENVSAMP_ERR_PARAM,   /* a field of the description is out of range */
    ENVSAMP_ERR_VALUE,   /* strict: a pixel is NaN, infinite or negative */
    ENVSAMP_ERR_BLACK,   /* the total importance is zero: nothing to sample */
    ENVSAMP_ERR_MEMORY,  /* a buffer is smaller than _sizes said */
    ENVSAMP_ERR_ALIGN,   /* a buffer is not aligned to ENVSAMP_ALIGN, or floats not to 4 bytes */
    ENVSAMP_ERR_FORMAT   /* the bytes are not a valid table, or scratch, of this kind */
} envsamp_result;

/* A result in words: one lower-case phrase, never NULL, also for numbers that are no result. */
ENVSAMP_DEF const char *envsamp_result_string(envsamp_result result);

/* How a map covers the sphere. LATLONG: theta = pi v, as in the picture above. HEMISPHERE: the same
   with theta = (pi/2) v; row height - 1 ends at the horizon, and below it is black. OCTAHEDRAL: the
   equal-area square [7]; +z in the centre, -z in all four corners, u grows along +x, v along +y. */
typedef enum envsamp_mapping {
    ENVSAMP_LATLONG = 0, ENVSAMP_HEMISPHERE, ENVSAMP_OCTAHEDRAL
} envsamp_mapping;

/* A map, read during a build only. A NaN or infinite channel makes its pixel black, a negative
   channel counts as 0; each such pixel is counted. */
typedef struct envsamp_image {
    const float *pixels;      /* linear radiance, row 0 first; at a multiple of 4 bytes */
    int width, height;        /* 1..65535 each */
    int channels;             /* 1 luminance, 3 RGB, 4 RGB and one ignored */
    size_t row_stride_bytes;  /* 0: rows are packed; otherwise a multiple of 4, a row or more */
    envsamp_mapping mapping;
} envsamp_image;

/* Fills row y of an image, as `pixels` would hold it: width times channels floats, in aligned
   memory of the build. For maps that are not aligned floats in memory: half, RGBE, tiled,
   procedural, out of core. Returns ENVSAMP_OK, or the result that ends the build. Rows are asked
   for from 0 on, each once; twice, in two passes, with MIS compensation and for an octahedral map
   that is looked up bilinearly; three times with an exponent of importance. */
typedef envsamp_result (*envsamp_row_fn)(int y, float *row, void *user);

typedef struct envsamp_buffer { void *data; size_t bytes; } envsamp_buffer;
typedef struct envsamp_sizes  { size_t table_bytes, scratch_bytes; } envsamp_sizes;

/* A direction, its density per steradian, and where it lies in the map. */
typedef struct envsamp_sample { float dir[3]; float pdf; float uv[2]; } envsamp_sample;

/* The direction of a point of the map, each component and the length within 2e-7. u wraps round, up
   to a million turns, and is clamped to [0, 1] for OCTAHEDRAL; v is clamped to [0, 1]; a NaN counts
   as 0. A mapping that is none of the three gives zero. */
ENVSAMP_DEVICE ENVSAMP_DEF void envsamp_uv_to_dir(envsamp_mapping mapping, float u, float v,
                                                  float dir[3]);

/* The point of the map in a direction, of unit length or not: u in [0, 1), for OCTAHEDRAL [0, 1],
   and v in [0, 1], each within 3e-7. HEMISPHERE: directions below the horizon have v above 1, up
   to 2. The zero vector gives the point of +z: (0, 0), for OCTAHEDRAL (1/2, 1/2); NaN and infinity
   give some point. A direction on the seam, or on an edge of the octahedral square, has several
   points; the result is one of them. */
ENVSAMP_DEVICE ENVSAMP_DEF void envsamp_dir_to_uv(envsamp_mapping mapping, const float dir[3],
                                                  float uv[2]);

/* Rec. 709 luminance of linear RGB: what importance is made of. */
ENVSAMP_DEVICE ENVSAMP_DEF float envsamp_luminance(const float rgb[3]);

/* Weight of a sample taken with one density where another sampler could have made it too: the
   power heuristic with exponent 2 [4]. Two zeros give 0; infinities are fine. */
ENVSAMP_DEVICE ENVSAMP_DEF float envsamp_mis_power(float pdf_taken, float pdf_other);

/* Radiance of the map in a direction: interpolated between texel centres, round the seam, half a
   turn round over the poles, and across the edges of the octahedral square; or, if `nearest` is
   nonzero, of the nearest texel. Over a pole of an odd width interpolation is half a texel short.
   HEMISPHERE: its last row reaches down to the horizon; below, where z < 0, it is black. Pixels
   count as in a build. One channel gives three equal values. The zero vector looks at +z. */
ENVSAMP_DEF void envsamp_lookup(const envsamp_image *image, int nearest, const float dir[3],
                                float rgb[3]);

/* ---- kd: blocks of a kd-tree -------------------------------------------------------------- */

typedef enum envsamp_kd_select {
    ENVSAMP_KD_WARP = 0,  /* the unit square warped down the tree: keeps strata, invertible */
    ENVSAMP_KD_ALIAS,     /* exact block probabilities by the alias method [2]: fastest */
    ENVSAMP_KD_FIT        /* fitted analytic pdf over sorted blocks [1] */
} envsamp_kd_select;

/* Which block to split next, and where. EXCESS makes the split that lowers the variance of L/pdf
   most: with ALIAS 20 to 40 % less of it than SSE from as many blocks. For FIT, where the model
   decides, SSE is often better. The last three choose by their name and split where the means of
   the parts explain most squares [1]. */
typedef enum envsamp_kd_criterion {
    ENVSAMP_KD_EXCESS = 0, ENVSAMP_KD_SSE, ENVSAMP_KD_VARIANCE, ENVSAMP_KD_RANGE
} envsamp_kd_criterion;

typedef enum envsamp_kd_model {
    ENVSAMP_KD_LOG = 0,   /* p(x) = 1 / (log(1 + n/alpha) (alpha + x)) [1, equation 4] */
    ENVSAMP_KD_POWER      /* p(x) ~ (alpha + x)^-beta */
} envsamp_kd_model;

/* What a fit minimises: L1, the distance of the probabilities [1, equation 7], or CHI2, the
   variance of L/pdf, which is the better one. */
typedef enum envsamp_kd_objective { ENVSAMP_KD_L1 = 0, ENVSAMP_KD_CHI2 } envsamp_kd_objective;

typedef struct envsamp_kd_desc {
    int block_count;                 /* 1..1048576, 0: 6144 */
    envsamp_kd_select select;
    envsamp_kd_criterion criterion;
    envsamp_kd_model model;          /* FIT only */
    envsamp_kd_objective objective;  /* FIT only */
    float mis_compensation;          /* 0 none .. 1 full: see MIS COMPENSATION */
    int nearest;                     /* 0: radiance is looked up bilinearly; else nearest texel */
    int strict;                      /* nonzero: a bad pixel is ENVSAMP_ERR_VALUE */
    int facing;                      /* WARP: nonzero stores what _facing functions need */
    float excess_target;             /* above 0: no more blocks than bring the excess variance of
                                        ALIAS down to this, of WARP to a tenth above at most;
                                        block_count stays the limit. WARP splits twice for it */
    float importance_exponent;       /* 0.5..2, 0: 1; see IMPORTANCE FOR MIS */
} envsamp_kd_desc;

typedef struct envsamp_kd envsamp_kd;

ENVSAMP_DEF envsamp_kd_desc envsamp_kd_defaults(void);

/* How large the two buffers of a build must be. `desc` NULL: the defaults. Needs the image's
   sizes, not its pixels, which may be NULL here. The table may turn out smaller:
   envsamp_kd_bytes. Scratch holds the luminance of the map as floats, a pyramid over it, and the
   blocks: 5 bytes a texel, 168 a block, ALIAS 12, FIT 48 and `facing` 112 more, 30 a column, 100 a
   row, and 14 KB. Returns ENVSAMP_ERR_NULL, _SIZE, _PARAM or _ALIGN, and then zero sizes. */
ENVSAMP_DEF envsamp_result envsamp_kd_sizes(const envsamp_image *image,
                                            const envsamp_kd_desc *desc, envsamp_sizes *sizes);

/* Builds the table of a map. *kd points into table.data, and is NULL after a failure. Stops early,
   with fewer blocks, when every block is flat. table, scratch and pixels must not overlap.
   Time: some passes over the pixels, and log(blocks) per block; WARP takes two to three times as
   long as ALIAS. RANGE reads the texels of each block once more; FIT makes some hundred passes over
   the blocks, POWER some thousand.
   Returns ENVSAMP_ERR_NULL, _SIZE, _PARAM, _VALUE, _BLACK, _MEMORY or _ALIGN.
   Source: [1, algorithms 1 to 3], with importance weighed by solid angle, which [1] leaves out,
   and uniform sampling of solid angle within a block. WARP is ours; where the unit square has no
   room for a block of its tree, two blocks become one. */
ENVSAMP_DEF envsamp_result envsamp_kd_build(const envsamp_image *image,
                                            const envsamp_kd_desc *desc, envsamp_buffer table,
                                            envsamp_buffer scratch, const envsamp_kd **kd);

/* The same from rows that `fn` makes, which gets `user`; the pixels of the image are not read. If
   fn is NULL they are, as by _build. Returns what _build would, or what fn returned. */
ENVSAMP_DEF envsamp_result envsamp_kd_build_rows(const envsamp_image *image, envsamp_row_fn fn,
                                                 void *user, const envsamp_kd_desc *desc,
                                                 envsamp_buffer table, envsamp_buffer scratch,
                                                 const envsamp_kd **kd);

#ifdef ENVSAMP_ALLOC
/* The build into memory of its own, to be freed by _free; NULL after a failure. *result, which may
   be NULL, becomes what _build would return. In C++, for std::unique_ptr<envsamp_kd, kd_free>:
   struct kd_free { void operator()(envsamp_kd *kd) const { envsamp_kd_free(kd); } }; */
ENVSAMP_DEF envsamp_kd *envsamp_kd_new(const envsamp_image *image, const envsamp_kd_desc *desc,
                                       envsamp_result *result);
ENVSAMP_DEF void envsamp_kd_free(envsamp_kd *kd);
#endif

/* The same build in steps, to spread it over frames.
 * _begin: as _build; `fn` gives the rows, and gets `user`; if it is NULL, image->pixels do. *job
 *   lies in scratch, and is NULL after a failure.
 * _step: does `count` items: rows of texels, then blocks. At 2048 by 1024 an item takes 1 to 15
 *   microseconds, a few of them up to half a millisecond, and there are 25000. *done, which may be
 *   NULL, becomes nonzero when nothing is left to do. FIT: the fit is one item, of 20 milliseconds.
 * _finish: does what is left. *kd points into the table, and is NULL after a failure.
 * table, scratch and what image->pixels or `user` points to stay in place; the image itself need
 * not. To abandon a build, stop calling _step; nothing needs freeing. The table is the same, bit
 * for bit, as that of _build. All return what _build would, or what fn returned. */
typedef struct envsamp_kd_job envsamp_kd_job;
ENVSAMP_DEF envsamp_result envsamp_kd_begin(const envsamp_image *image, envsamp_row_fn fn,
                                            void *user, const envsamp_kd_desc *desc,
                                            envsamp_buffer table, envsamp_buffer scratch,
                                            envsamp_kd_job **job);
ENVSAMP_DEF envsamp_result envsamp_kd_step(envsamp_kd_job *job, int count, int *done);
ENVSAMP_DEF envsamp_result envsamp_kd_finish(envsamp_kd_job *job, const envsamp_kd **kd);

/* As envsamp_kd_begin, for a map of which only row_count rows from first_row on have changed since
   the last build in this scratch: only these are read. The new table has the bits of a build from
   all rows. The description may differ from the last one, but for `nearest`.
   table: the last one or another. scratch: as the last build left it, finished or not, once it has
     read all rows; or a copy of that.
   With compensation, an exponent, or an octahedral map that is looked up bilinearly, all rows are
     read, and scratch need not be that of a build.
   Returns what _begin would; ENVSAMP_ERR_PARAM if first_row or row_count is negative (rows beyond
     the map are ignored); ENVSAMP_ERR_FORMAT, with scratch as it was, if that is not of a map of
     the same size, channels and mapping, with the same `nearest`, without compensation and
     exponent.
   Time: with few rows a quarter of a WARP build is saved at 2048 by 1024, two thirds at 8192 by
     4096. */
ENVSAMP_DEF envsamp_result envsamp_kd_rebuild_begin(const envsamp_image *image, envsamp_row_fn fn,
                                                    void *user, const envsamp_kd_desc *desc,
                                                    int first_row, int row_count,
                                                    envsamp_buffer table, envsamp_buffer scratch,
                                                    envsamp_kd_job **job);

/* Opens a table that was stored, mapped or copied: checks in linear time that it is whole, and
   that no sample and no pdf can read outside of it. `table` must stay in place while *kd is used,
   and be aligned to ENVSAMP_ALIGN. Returns ENVSAMP_ERR_NULL, _ALIGN or _FORMAT. */
ENVSAMP_DEF envsamp_result envsamp_kd_open(const void *table, size_t bytes,
                                           const envsamp_kd **kd);

/* Bytes of the table, to store or upload from the address of kd. */
ENVSAMP_DEF size_t envsamp_kd_bytes(const envsamp_kd *kd);

/* Draws a direction with density s.pdf per steradian, in expected constant time.
   WARP: every block is a rectangle of the unit square, in which u0 goes round in azimuth and u1
   down in polar angle, both evenly. The leading bits name one of 2^k equally bright parts of the
   map, 6144 blocks: 2048; then fewer than 2 cuts are expected, and never more than 32.
   ALIAS: the leading bits of both choose two blocks, what is left of u1 one of the two and the
   polar angle, of u0 the azimuth. FIT: the leading bits of u0 choose the block, what is left of it,
   and then the 12 low bits of u1, the azimuth, u1 the polar angle. */
ENVSAMP_DEVICE ENVSAMP_DEF envsamp_sample envsamp_kd_sample(const envsamp_kd *kd, float u0,
                                                            float u1);

/* Density per steradian of envsamp_kd_sample in a direction, which need not be of unit length. 0
   for the zero vector and for one with NaN or infinity. Equals the pdf of a sample, but where its
   direction, rounded to floats, lies across the edge of its block: fewer than 1 in 2000 at 6144
   blocks of a map twice as wide as high, up to 1 in 100 where a lamp of a few texels, and so its
   small blocks, has most of the light. */
ENVSAMP_DEVICE ENVSAMP_DEF float envsamp_kd_pdf(const envsamp_kd *kd, const float dir[3]);

/* The numbers that make envsamp_kd_sample draw a direction, which need not be of unit length: for
   mutations, path guiding and tests. Round-trip error of u: at most 4 x 2^-24 times du/d(azimuth in
   turns), or du/d((1 - cos theta) / 2); sampling u again is 1e-6 rad off, plus what 2^-24 in u is
   there. Across the edge of a block, as for envsamp_kd_pdf, u jumps while the direction does not.
   WARP only. Returns 0, and u of 0, where density is 0: in black blocks, for what is no direction,
   and for ALIAS and FIT. */
ENVSAMP_DEVICE ENVSAMP_DEF int envsamp_kd_invert(const envsamp_kd *kd, const float dir[3],
                                                 float u[2]);

/* n samples, or densities, at once; the same bits as one at a time, but for -ffast-math, in a half
   to a third of the time. In-place calls are allowed: x may alias u0, y may alias u1, pdf x; else
   outputs and inputs must not overlap. n: SIZE_MAX / 8 at most, which is asserted. */
ENVSAMP_DEF void envsamp_kd_sample_n(const envsamp_kd *kd, size_t n, const float *u0,
                                     const float *u1, float *x, float *y, float *z, float *pdf);
ENVSAMP_DEF void envsamp_kd_pdf_n(const envsamp_kd *kd, size_t n, const float *x, const float *y,
                                  const float *z, float *pdf);

/* Light x cosine: as envsamp_kd_sample, _pdf, _invert, _sample_n and _pdf_n, but directions are
   drawn in proportion to light times how far they face a normal, so that few samples of a diffuse
   or rough surface are spent below its horizon or at grazing angles. Every direction that
   envsamp_kd_sample can draw keeps a density above zero: results are unbiased for any integrand,
   and strata of u are kept. The table has to be built with `facing`, which takes 80 KB more.
   normal: in the map's space, as directions are; of any length from 1e-37 to 1e38. For a broad
     glossy lobe give the mirrored view: half the error that the normal leaves. A sharp lobe needs
     MIS with the BSDF's samples. For a normal of zero, NaN or infinity, and for a table without the
     data (info: facing), these are the functions of light alone, densities too.
   Time: a sample takes five to six times as long as of light alone, a density two to three times.
   Source: ours, after the idea of [21]: w of a part of the map is half the mean of the cosine over
   its light plus half the root of its mean square, with a quarter of the variance left out. */
ENVSAMP_DEVICE ENVSAMP_DEF envsamp_sample envsamp_kd_sample_facing(const envsamp_kd *kd,
                                                                   const float normal[3],
                                                                   float u0, float u1);
ENVSAMP_DEVICE ENVSAMP_DEF float envsamp_kd_pdf_facing(const envsamp_kd *kd,
                                                       const float normal[3],
                                                       const float dir[3]);
ENVSAMP_DEVICE ENVSAMP_DEF int envsamp_kd_invert_facing(const envsamp_kd *kd,
                                                        const float normal[3],
                                                        const float dir[3], float u[2]);
ENVSAMP_DEF void envsamp_kd_sample_facing_n(const envsamp_kd *kd, const float normal[3], size_t n,
                                            const float *u0, const float *u1, float *x, float *y,
                                            float *z, float *pdf);
ENVSAMP_DEF void envsamp_kd_pdf_facing_n(const envsamp_kd *kd, const float normal[3], size_t n,
                                         const float *x, const float *y, const float *z,
                                         float *pdf);

typedef struct envsamp_kd_info {
    int block_count;         /* blocks made; fewer than asked where the map is flat */
    double integral;         /* of luminance over the sphere: units of luminance x sr */
    double excess_variance;  /* E[(L/pdf)^2] / integral^2 - 1, exact over the map */
    double max_ratio;        /* largest L / (pdf * integral) over the map: the firefly bound */
    double alpha, beta;      /* FIT: parameters; LOG has beta 1 */
    double l1;               /* FIT: sum |empirical - fitted| over blocks */
    size_t bad_pixel_count;  /* NaN, infinite or negative pixels taken as zero */
    float mis_compensation;  /* in force: 0 where nothing would have been left */
    int nearest;             /* how lookups have to be: as in the description */
    envsamp_mapping mapping;
    int facing;              /* nonzero: the table has what _facing functions need */
} envsamp_kd_info;

/* One block: where it lies, and how often it is drawn. Blocks tile the map. uv_min is below uv_max,
   also where polar angle in floats is coarser than the block is high. */
typedef struct envsamp_kd_block {
    float uv_min[2], uv_max[2];
    float solid_angle;       /* sr */
    float probability;
} envsamp_kd_block;

/* Facts about a table. Returns ENVSAMP_ERR_NULL. */
ENVSAMP_DEF envsamp_result envsamp_kd_get_info(const envsamp_kd *kd, envsamp_kd_info *info);

/* Block `number`, 0 .. block_count - 1; for FIT, the most probable first. Returns
   ENVSAMP_ERR_NULL, or ENVSAMP_ERR_PARAM for a number out of range. */
ENVSAMP_DEF envsamp_result envsamp_kd_get_block(const envsamp_kd *kd, int number,
                                                envsamp_kd_block *block);

#ifndef ENVSAMP_NO_CDF

/* ---- cdf: inversion over texels ------------------------------------------------------------ */

/* The map at full resolution, at some 4.5 bytes a texel where kd needs 100 to 400 KB in all. With
   `nearest` there is no excess variance. Without it there is that within cells between texel
   centres, which are drawn evenly: 0.003 to 0.2 for real maps, 0.8 for a lone texel. What is not
   said here is as for kd. */
typedef struct envsamp_cdf_desc {
    float mis_compensation;          /* 0 none .. 1 full: see MIS COMPENSATION */
    int nearest;                     /* 0: radiance is looked up bilinearly; else nearest texel */
    int strict;                      /* nonzero: a bad pixel is ENVSAMP_ERR_VALUE */
    float importance_exponent;       /* 0.5..2, 0: 1; see IMPORTANCE FOR MIS */
} envsamp_cdf_desc;

typedef struct envsamp_cdf envsamp_cdf;

ENVSAMP_DEF envsamp_cdf_desc envsamp_cdf_defaults(void);

/* As envsamp_kd_sizes; exactly. The table is 4.5 to 5 bytes a texel, 4.5 at a width of 2^k, and
   some 40 a row; scratch is 40 bytes a column, 80 a row, and 4 KB. */
ENVSAMP_DEF envsamp_result envsamp_cdf_sizes(const envsamp_image *image,
                                             const envsamp_cdf_desc *desc, envsamp_sizes *sizes);

/* Builds the table of a map in one pass over its pixels: as envsamp_kd_build.
   Numeric: every lit row, and every lit texel of a row, gets one of 2^24 parts, and the rest is
   divided in proportion, rounded down: a texel is drawn at least 1 - (width + height) / 2^24
   times as often as its light asks for. With `nearest`, max_ratio hardly exceeds 1 and
   excess_variance is below (width + height) / 2^24.
   Source: inversion by rows, then columns, as everywhere; found by guide tables [6]. */
ENVSAMP_DEF envsamp_result envsamp_cdf_build(const envsamp_image *image,
                                             const envsamp_cdf_desc *desc, envsamp_buffer table,
                                             envsamp_buffer scratch, const envsamp_cdf **cdf);

/* As envsamp_kd_build_rows. */
ENVSAMP_DEF envsamp_result envsamp_cdf_build_rows(const envsamp_image *image, envsamp_row_fn fn,
                                                  void *user, const envsamp_cdf_desc *desc,
                                                  envsamp_buffer table, envsamp_buffer scratch,
                                                  const envsamp_cdf **cdf);

#ifdef ENVSAMP_ALLOC
/* As envsamp_kd_new and envsamp_kd_free. */
ENVSAMP_DEF envsamp_cdf *envsamp_cdf_new(const envsamp_image *image, const envsamp_cdf_desc *desc,
                                         envsamp_result *result);
ENVSAMP_DEF void envsamp_cdf_free(envsamp_cdf *cdf);
#endif

/* The same build in steps, of rows of texels: as envsamp_kd_begin, _step and _finish. A row of 2048
   texels takes 30 microseconds. */
typedef struct envsamp_cdf_job envsamp_cdf_job;
ENVSAMP_DEF envsamp_result envsamp_cdf_begin(const envsamp_image *image, envsamp_row_fn fn,
                                             void *user, const envsamp_cdf_desc *desc,
                                             envsamp_buffer table, envsamp_buffer scratch,
                                             envsamp_cdf_job **job);
ENVSAMP_DEF envsamp_result envsamp_cdf_step(envsamp_cdf_job *job, int count, int *done);
ENVSAMP_DEF envsamp_result envsamp_cdf_finish(envsamp_cdf_job *job, const envsamp_cdf **cdf);

/* As envsamp_kd_open and envsamp_kd_bytes. */
ENVSAMP_DEF envsamp_result envsamp_cdf_open(const void *table, size_t bytes,
                                            const envsamp_cdf **cdf);
ENVSAMP_DEF size_t envsamp_cdf_bytes(const envsamp_cdf *cdf);

/* Draws a direction with density s.pdf per steradian, in expected constant time, at most
   log2(width height) + 8 steps. u1 chooses the row and goes down in polar angle, u0 the texel of
   the row and round in azimuth, both evenly within a texel. The leading 24 bits of a number count;
   those below are dropped. */
ENVSAMP_DEVICE ENVSAMP_DEF envsamp_sample envsamp_cdf_sample(const envsamp_cdf *cdf, float u0,
                                                             float u1);

/* As envsamp_kd_pdf. A sample's direction, rounded to floats, lies across the edge of its texel for
   1 in 6000 at 2048 by 1024. */
ENVSAMP_DEVICE ENVSAMP_DEF float envsamp_cdf_pdf(const envsamp_cdf *cdf, const float dir[3]);

/* As envsamp_kd_invert, with the same error; u are whole multiples of 2^-24. */
ENVSAMP_DEVICE ENVSAMP_DEF int envsamp_cdf_invert(const envsamp_cdf *cdf, const float dir[3],
                                                  float u[2]);

/* As envsamp_kd_sample_n and envsamp_kd_pdf_n. Of a large map two to five times as fast as one at a
   time, as waits for memory overlap. */
ENVSAMP_DEF void envsamp_cdf_sample_n(const envsamp_cdf *cdf, size_t n, const float *u0,
                                      const float *u1, float *x, float *y, float *z, float *pdf);
ENVSAMP_DEF void envsamp_cdf_pdf_n(const envsamp_cdf *cdf, size_t n, const float *x,
                                   const float *y, const float *z, float *pdf);

/* See envsamp_kd_info. */
typedef struct envsamp_cdf_info {
    double integral;
    double excess_variance;
    double max_ratio;
    size_t bad_pixel_count;
    float mis_compensation;
    int nearest;
    envsamp_mapping mapping;
} envsamp_cdf_info;

/* Facts about a table. Returns ENVSAMP_ERR_NULL. */
ENVSAMP_DEF envsamp_result envsamp_cdf_get_info(const envsamp_cdf *cdf, envsamp_cdf_info *info);

#endif  /* ENVSAMP_NO_CDF */

#ifndef ENVSAMP_NO_LIGHTS

/* ---- halftone: error diffusion over any importance map -------------------------------------- */

/* How the error of a texel goes on to those that come after it, in parts: those ahead in its row
   after the dash, then the rows below. For TEXELS only, but for RANDOM. */
typedef enum envsamp_kernel {
    ENVSAMP_KERNEL_SZIRMAY = 0,      /* - 3, 0 3 2: of 8 [9] */
    ENVSAMP_KERNEL_FLOYD_STEINBERG,  /* - 7, 3 5 1: of 16 [10] */
    ENVSAMP_KERNEL_JARVIS,           /* - 7 5, 3 5 7 5 3, 1 3 5 3 1: of 48 [11] */
    ENVSAMP_KERNEL_STUCKI,           /* - 8 4, 2 4 8 4 2, 1 2 4 2 1: of 42 [12] */
    ENVSAMP_KERNEL_OSTROMOUKHOV,     /* ahead, behind below and below, by importance [13] */
    ENVSAMP_KERNEL_RANDOM            /* no error: independent draws, the baseline */
} envsamp_kernel;

/* TEXELS is as published: it chooses nothing before a whole row of errors has grown, so that a few
   hundred samples of a large map miss its upper part, and are worse than random ones. CELLS, ours,
   has the density right from the first texel on, at any count. */
typedef enum envsamp_scan {
    ENVSAMP_SCAN_CELLS = 0,  /* in cells of about half a sample; all of an error goes ahead, what
                                [9] calls the extreme case, so the kernel does not matter */
    ENVSAMP_SCAN_TEXELS      /* texel by texel, row by row, as the kernel says [9] */
} envsamp_scan;

typedef struct envsamp_halftone_desc {
    int count;                /* samples wanted, M: 1 or more */
    envsamp_kernel kernel;
    uint32_t seed;            /* error at the start, and RANDOM's draws; 0: no error at the start */
    envsamp_scan scan;
    int once;                 /* 0: a texel of more than S/M may be chosen more than once, in a
                                 row; nonzero: its error goes on to its neighbours. RANDOM
                                 repeats. */
} envsamp_halftone_desc;

/* A chosen texel. probability is its importance over S, the sum of the map's: what a sample is
   divided by. Each of M stands for S/M of the importance. */
typedef struct envsamp_texel { int x, y; float probability; } envsamp_texel;

/* Scratch of envsamp_halftone: 12 bytes a column; with TEXELS 28, with JARVIS and STUCKI 36.
   table_bytes is 0. width and height are 1..65535.
   Returns ENVSAMP_ERR_NULL, _SIZE or _PARAM, and then zero sizes. */
ENVSAMP_DEF envsamp_result envsamp_halftone_sizes(int width, int height,
                                                  const envsamp_halftone_desc *desc,
                                                  envsamp_sizes *sizes);

/* Chooses M texels with a density in proportion to their importance, evenly spread, as a halftone
   of the map: M samples at once, where a table that is sampled one by one would not pay, such as a
   32 by 32 map of light x BRDF x cosine for one shaded point.
   importance: height rows of width floats, row_stride_bytes apart, 0 for packed; 0 or above, of any
     scale. Weigh a lat-long map by solid angle first; envsamp_lights does so.
   texels: `capacity` of them, M or more; *count becomes how many were chosen: M, or, with
     `once`, as many as texels are above zero if those are fewer. None is chosen that is zero; with
     `once` none twice, but by RANDOM. They come in the order of the scan.
   Evenness: with CELLS, without `once`, the number of samples in a rectangle of mass m was within
     2.5 sqrt(perimeter in cells) of M m in every map tried, for 64 to 1024 samples; 0.6
     sqrt(perimeter in texels) at 512 by 256.
     With a random seed above 0 every texel is chosen M probability times on average, so the mean
     of f / (M probability) is the sum of f; TEXELS chooses dim ones too often, and has fireflies.
   Returns ENVSAMP_ERR_NULL, _SIZE, _PARAM, _VALUE for a NaN, infinite or negative importance,
     _BLACK if all are zero, _MEMORY if `capacity` or scratch is too small, or _ALIGN; then *count
     is 0.
   Time: two passes over the map. Numeric: sums and errors are doubles.
   Source: [9], whose listing skips columns on the way back, may choose texels of zero, and gives
     about M samples. */
ENVSAMP_DEF envsamp_result envsamp_halftone(const float *importance, int width, int height,
                                            size_t row_stride_bytes,
                                            const envsamp_halftone_desc *desc,
                                            envsamp_texel *texels, int capacity, int *count,
                                            envsamp_buffer scratch);

/* ---- lights: a map as K directional lights --------------------------------------------------- */

/* RELAXED is the best at 16 to 64 lights. DECOMPOSED tells lamps, which make shadows, from the
   rest, which may be shaded in a smaller picture. */
typedef enum envsamp_lights_method {
    ENVSAMP_LIGHTS_RELAXED = 0,     /* relaxed on the sphere, moved and weighed: see @lights */
    ENVSAMP_LIGHTS_DECOMPOSED,      /* EnvDirects on bright, emissive texels, and EnvIndirects for
                                       rectangles of the rest [18] */
    ENVSAMP_LIGHTS_MEDIAN_CUT,      /* rectangles of equal luminance [16] */
    ENVSAMP_LIGHTS_VARIANCE_CUT,    /* rectangles of little spread [17] */
    ENVSAMP_LIGHTS_HALFTONE,        /* error diffusion of the solid-angle-weighted map [9] */
    ENVSAMP_LIGHTS_RANDOM           /* independent importance samples: the baseline */
} envsamp_lights_method;

/* A light as an engine takes it: radiance leaving a surface is BRDF x irradiance x cosine, summed
   over the lights that it sees. */
typedef struct envsamp_light {
    float dir[3];            /* unit, toward the light */
    float irradiance[3];     /* RGB radiance x solid angle of what the light stands for */
    float solid_angle;       /* sr, of what it stands for; of HALFTONE and RANDOM, which choose
                                texels, the sum need not be that of the map */
    float cos_extent;        /* cosine of the half angle of a cone about dir, -1..1: of that solid
                                angle with HALFTONE and RANDOM, else of an even disc with the
                                centroid of what the light stands for, 1 if that is a texel */
    int   direct;            /* 1: EnvDirect, on an emissive texel; 0: all others */
} envsamp_light;

typedef struct envsamp_lights_desc {
    int count;                       /* K, 1..65536, 0: 32 */
    envsamp_lights_method method;
    float percentile, lambda, gamma; /* DECOMPOSED: a texel is emissive above the largest of: the
                                        luminance that `percentile` of the solid angle does not
                                        exceed, at most 1; lambda x mean; gamma x maximum; 0: 0.98,
                                        3, 0.001; negative: 0 */
    float mask_scale;                /* DECOMPOSED, s: an EnvDirect keeps others out of a cone of
                                        s 4 pi / K steradians, and stands for twice that angle at
                                        most; 0: 0.15; negative: without bounds */
    float weight_variance;           /* DECOMPOSED: what decides which EnvIndirect to cut in two, */
    float weight_extent;             /* 0 or more; all 0: 1, 5, 1; the illumination cut before */
    float weight_energy;             /* [18] is 1, 0, 0, the best measured 0, 1, 2 */
    int   refine_rounds;             /* most rounds: of k-means in DECOMPOSED; of moves in
                                        RELAXED, less above 100 lights and none above 1024; 0: 64;
                                        negative: none, RELAXED goes to centroids */
    uint32_t seed;                   /* of RANDOM, DECOMPOSED, start of HALFTONE */
    int strict;                      /* nonzero: a bad pixel is ENVSAMP_ERR_VALUE */
} envsamp_lights_desc;

typedef struct envsamp_lights_info {
    int count, direct_count;         /* K, and how many of these are EnvDirects, the first */
    float threshold;                 /* L_T of DECOMPOSED, else 0 */
    double integral[3];              /* of the map, RGB, over the sphere: the lights sum to it */
    size_t bad_pixel_count;          /* NaN, infinite or negative pixels taken as zero */
} envsamp_lights_info;

/* The description of zeros with the numbers that its zeros mean: to change fields of. */
ENVSAMP_DEF envsamp_lights_desc envsamp_lights_defaults(void);

/* Scratch of envsamp_lights. HALFTONE and RANDOM: 8 bytes a row, 12 a column, 12 a light.
   Cuts: up to 4 MB, 2 for a map twice as wide as high, and 104 bytes a light. RELAXED: up to
   1.25 MB, 8 KB a light, no more than 4 MB of these, and 200 bytes a light. Both 32 bytes a column
   and 40 a row. DECOMPOSED: as cuts and RELAXED, 2 MB and 5 bytes a texel. table_bytes is 0.
   `desc` NULL: the defaults. Needs the image's sizes, not its pixels.
   Returns ENVSAMP_ERR_NULL, _SIZE, _PARAM or _ALIGN, and then zero sizes. */
ENVSAMP_DEF envsamp_result envsamp_lights_sizes(const envsamp_image *image,
                                                const envsamp_lights_desc *desc,
                                                envsamp_sizes *sizes);

/* Turns a map of any mapping into K directional lights, which sum to the map's integral in every
   channel. HALFTONE, RANDOM: colours are those of the texels, all of one luminance, then tinted
   alike. Where one texel has several lights, they stand evenly in it, one alone in its middle.
   Cuts: where a rectangle cannot be cut into two that have light, lights share its centroid.
   RELAXED: more rounds never raise the error that @lights defines. Where lights are more than the
   lit texels, they share these. Above 16384 it gives those of HALFTONE. DECOMPOSED: EnvDirects come
   first, each on an emissive texel of those that it stands for, and no two on one unless all that
   is lit is emissive and there are more lights than texels, or than 32768. Lights brighter than
   FLT_MAX are clamped, those of a map with nothing brighter than 1e-36 lose digits.
   lights: `capacity` of them, K or more. info may be NULL.
   Returns ENVSAMP_ERR_NULL, _SIZE, _PARAM, _VALUE, _BLACK, _MEMORY if `capacity` or scratch is too
     small, or _ALIGN; nothing is said of `lights` then.
   Time, in passes over the map that write luminance: HALFTONE 4, cuts 5, for 32 lights DECOMPOSED
     20 and RELAXED 55; what these take more grows with the square of the number of lights, up to
     some hundred. The same bits with any compiler, as for tables.

   A light with its shadow, for every lit point of normal n:

       if (scene_occluded(point, light.dir))               // a shadow ray, or a shadow map
           continue;
       cosine = n[0] * light.dir[0] + n[1] * light.dir[1] + n[2] * light.dir[2];
       for (c = 0; c < 3 && cosine > 0.0f; c++)
           radiance[c] += brdf(point, light.dir, view)[c] * light.irradiance[c] * cosine; */
ENVSAMP_DEF envsamp_result envsamp_lights(const envsamp_image *image,
                                          const envsamp_lights_desc *desc,
                                          envsamp_light *lights, int capacity,
                                          envsamp_buffer scratch, envsamp_lights_info *info);

/* Set `set` of `set_count` matched sets, of which every pixel of a small tile takes another
   (interleaved sampling): edges of shadows become a fine pattern that a filter removes. Each light
   is turned within `extent`, 0..1, of the angle of its own cone, 0.1 in [18]; the places that it
   takes in all sets cover that disc evenly, on a spiral, and its energy is the same in all.
   count: 0 or more. set: 0..set_count - 1. A single set is turned too, by 0.71 of `extent`. A cone
   of no size, cos_extent 1 or more or a NaN, turns nothing. out: `count` lights, may be `lights`.
   Returns ENVSAMP_ERR_NULL or _PARAM. */
ENVSAMP_DEF envsamp_result envsamp_lights_interleave(const envsamp_light *lights, int count,
                                                     int set, int set_count, float extent,
                                                     uint32_t seed, envsamp_light *out);

/* 1 where a texel is emissive (luminance > L_T), else 0: what DECOMPOSED puts EnvDirects on.
   mask: width x height bytes, row after row. threshold: becomes L_T; may be NULL.
   desc: percentile, lambda, gamma and strict count; NULL: the defaults.
   scratch: 4 bytes a texel, 8 a row and 512 KiB, and some for alignment; what envsamp_lights_sizes
     says of DECOMPOSED is enough.
   Returns as envsamp_lights; nothing is said of mask and threshold if there is an error. */
ENVSAMP_DEF envsamp_result envsamp_emissive_mask(const envsamp_image *image,
                                                 const envsamp_lights_desc *desc, uint8_t *mask,
                                                 envsamp_buffer scratch, float *threshold);

#endif  /* ENVSAMP_NO_LIGHTS */

#ifndef ENVSAMP_NO_FIT

/* ---- lm: nonlinear least squares ----------------------------------------------------------- */

/* Residuals of a model: write `residual_count` values at `params`, whose pointer is not to be kept.
 * Where the model is not defined write a NaN or an infinity: the solver turns back. */
typedef void (*envsamp_lm_fn)(const double *params, double *residuals, void *user);

typedef struct envsamp_lm_desc {
    int param_count;     /* n, 1..8 */
    int residual_count;  /* m, param_count or more */
    int max_iterations;  /* trial steps, taken or turned down, at most; 0: 200 */
    double ftol;         /* stop: a step changes the cost relatively by no more; 0: 1e-12 */
    double xtol;         /* stop: the trust radius is no more, relative to params; 0: 1e-12 */
    double gtol;         /* stop: cosine of residuals and Jacobian's columns; 0: 1e-12 */
} envsamp_lm_desc;       /* a tolerance below DBL_EPSILON counts as DBL_EPSILON */

typedef struct envsamp_lm_info {
    int iterations;   /* trial steps, taken or turned down */
    int evaluations;  /* calls of fn, those for derivatives included */
    int converged;    /* nonzero: a tolerance was met where derivatives stand out from rounding */
    double cost;      /* sum of squared residuals at the params returned; it may be infinite */
} envsamp_lm_info;

/* Bytes of scratch that envsamp_lm needs: 8 m (n + 2). 0 if `desc` is NULL or out of range. */
ENVSAMP_DEF size_t envsamp_lm_scratch_bytes(const envsamp_lm_desc *desc);

/* Nonlinear least squares: moves `params` to a local minimum of the sum of squared residuals.
 *
 * params: n finite values; the start on entry, the best point found on return. They are written
 *   only when a step lowers the cost, so they stay as given if there is an error.
 * info: may be NULL; written only on ENVSAMP_OK. Not converged is ENVSAMP_OK too: ask `converged`.
 * scratch: envsamp_lm_scratch_bytes(desc) bytes, aligned to ENVSAMP_ALIGN; free again afterwards.
 * Returns ENVSAMP_ERR_NULL for a NULL desc, fn, params or scratch.data; ENVSAMP_ERR_PARAM for a
 *   count out of range, a negative max_iterations, a negative or NaN tolerance; _MEMORY or _ALIGN
 *   for the scratch; _VALUE if the start or its residuals are not finite.
 * Cost: about n + 1 calls of fn and 2 m n^2 operations for a step taken, one call for one turned
 *   down; up to 26 for a derivative that rounding hides. At most 60 n (max_iterations + 2) calls.
 * Numeric: derivatives are forward differences, good to about half the digits of a residual; the
 *   cost at a minimum is far more exact than the params. Params and residuals may be of any size
 *   from 1e-290 to 1e300; residuals below 1e-314 are 0 and above 1e301 not finite. A difference
 *   that rounding hides is taken again over longer steps. A parameter that no step up to 1e300
 *   moves the residuals by does not keep the others from converging. Not converged is what ends at
 *   a wall, behind which fn is not finite, at a kink, on a plateau, or where a derivative stays
 *   hidden. Where J is singular at a root the last steps creep, and may use up max_iterations.
 * Source: [3]; trust region, scaling and stopping tests [5]. */
ENVSAMP_DEF envsamp_result envsamp_lm(const envsamp_lm_desc *desc, envsamp_lm_fn fn, void *user,
                                      double *params, envsamp_buffer scratch,
                                      envsamp_lm_info *info);

#endif  /* ENVSAMP_NO_FIT */

#ifdef __cplusplus
}
#endif

#endif /* ENVSAMP_H */

#if (defined(ENVSAMP_STATIC) && !defined(ENVSAMP__STATIC)) \
    || (defined(ENVSAMP_IMPLEMENTATION) && !defined(ENVSAMP_STATIC) && defined(ENVSAMP__STATIC))
#error "ENVSAMP_STATIC must be defined before the first include of envsamp.h in a file, and stay"
#endif

/* ============================================================================================
 * Stop here if you only want to use the library. Below: how it works, in reading order. Each
 * section calls only sections above it. Search for
 *
 *     @math         own sines and logarithms     @kd-probabilities  alias table, fit
 *     @images       memory, pixels, rows         @kd-table          layout, the build, open
 *     @coordinates  edges, directions, u and v   @kd-sampling       samples, densities, inverse
 *     @importance   cells and their pyramid      @cdf               inversion over texels
 *     @kd-build     best splits, a heap          @halftone          error diffusion
 *     @kd-crown     WARP's upper levels          @lights            directional lights
 *                                                @lm                least squares
 * ========================================================================================== */

#if defined(ENVSAMP_IMPLEMENTATION) && !defined(ENVSAMP_IMPLEMENTED)
#define ENVSAMP_IMPLEMENTED

#include <float.h>
#include <limits.h>

#if defined(ENVSAMP_ALLOC) && !defined(ENVSAMP_MALLOC)
#include <stdlib.h>
#define ENVSAMP_MALLOC(bytes) malloc(bytes)
#define ENVSAMP_FREE(block) free(block)
#endif
#if !defined(ENVSAMP_MEMCPY) || !defined(ENVSAMP_MEMSET) || !defined(ENVSAMP_MEMCMP)
#include <string.h>
#endif
#ifndef ENVSAMP_MEMCPY
#define ENVSAMP_MEMCPY(to, from, bytes) memcpy(to, from, bytes)
#endif
#ifndef ENVSAMP_MEMSET
#define ENVSAMP_MEMSET(to, byte, bytes) memset(to, byte, bytes)
#endif
#ifndef ENVSAMP_MEMCMP
#define ENVSAMP_MEMCMP(a, b, bytes) memcmp(a, b, bytes)
#endif
#ifndef ENVSAMP_ASSERT
#include <assert.h>
#define ENVSAMP_ASSERT(x) assert(x)
#endif
#if defined(__SSE2__) && !defined(ENVSAMP_SQRT) && !defined(ENVSAMP_SQRTF) \
    && defined(ENVSAMP__HOST_ONLY)
#include <xmmintrin.h>          /* sqrtf is a call where errno counts, this never is */
#define ENVSAMP_SQRTF(x) _mm_cvtss_f32(_mm_sqrt_ss(_mm_set1_ps(x)))
#define ENVSAMP__SSE
#endif
#if !defined(ENVSAMP_SQRT) || !defined(ENVSAMP_SQRTF) || !defined(ENVSAMP_FABSF) \
    || !defined(ENVSAMP_COPYSIGNF)
#include <math.h>
#endif
#ifndef ENVSAMP_SQRT
#define ENVSAMP_SQRT(x) sqrt(x)
#endif
#ifndef ENVSAMP_SQRTF
#define ENVSAMP_SQRTF(x) sqrtf(x)
#endif
#ifndef ENVSAMP_FABSF
#define ENVSAMP_FABSF(x) fabsf(x)
#endif
#ifndef ENVSAMP_COPYSIGNF
#define ENVSAMP_COPYSIGNF(x, y) copysignf(x, y)
#endif
#define ENVSAMP__FABS(x) ((x) < 0 ? -(x) : (x))

#ifdef __cplusplus
extern "C" {
#endif

/* ============================================================================================
 * SMALL MATH                                                                   [search: @math]
 *
 * Own sines, arc tangents and logarithms, so that tables and samples are the same bits with every
 * libm. Float for sampling, double for builds.
 * ========================================================================================== */

/* Force-inlined, so that outputs that are not used are eliminated. Not at -O0, where each copy
   would take stack of its own. */
#if defined(__GNUC__) && defined(__OPTIMIZE__)
#define ENVSAMP__HOT ENVSAMP_DEVICE static inline __attribute__((__always_inline__))
#elif defined(__CUDACC__)
#define ENVSAMP__HOT ENVSAMP_DEVICE static __forceinline__
#else
#define ENVSAMP__HOT ENVSAMP_DEVICE static inline
#endif
#define ENVSAMP__MATH ENVSAMP_DEVICE static inline
#if defined(__GNUC__) && defined(ENVSAMP__HOST_ONLY)    /* many calls, none of them hot: one copy */
#define ENVSAMP__COLD static __attribute__((__noinline__, __unused__))
#else
#define ENVSAMP__COLD static inline
#endif

#define ENVSAMP__PI 3.14159265358979323846
#define ENVSAMP__UNIT 16777216.0f                   /* 2^24: a float u has that many values */
#define ENVSAMP__BELOW_ONE 0.999999940395355224609375f  /* 1 - 2^-24 */

ENVSAMP__MATH int envsamp__min(int a, int b) { return a < b ? a : b; }
ENVSAMP__MATH int envsamp__max_int(int a, int b) { return a > b ? a : b; }
ENVSAMP__MATH double envsamp__max(double a, double b) { return a > b ? a : b; }
ENVSAMP__MATH double envsamp__min_double(double a, double b) { return a < b ? a : b; }
ENVSAMP__MATH double envsamp__clamp(double x, double low, double high)
{
    return x < low ? low : x < high ? x : high;
}

ENVSAMP__MATH uint32_t envsamp__float_bits(float value)
{
    uint32_t bits;

    ENVSAMP_MEMCPY(&bits, &value, sizeof bits);
    return bits;
}

/* 1 for a negative number and for -0. */
ENVSAMP__MATH int envsamp__sign(float value)
{
    return (int)(envsamp__float_bits(value) >> 31);
}

ENVSAMP__MATH float envsamp__bits_float(uint32_t bits)
{
    float value;

    ENVSAMP_MEMCPY(&value, &bits, sizeof value);
    return value;
}

/* ---- floats that may be anything ----
 *
 * With -ffast-math compilers take for granted that no float is a NaN or an infinity, and drop tests
 * for them. What the caller gives is therefore tested and clamped by its bits, as integers; where
 * that costs time, only then.
 */

#if (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) || defined(_M_FP_FAST)
#define ENVSAMP__FINITE_ONLY
#endif

/* An integer that rises with the number: infinities are beyond FLT_MAX, NaNs beyond these. */
ENVSAMP__MATH int32_t envsamp__order(float value)
{
    int32_t size = (int32_t)(envsamp__float_bits(value) & 0x7fffffffu);

    return envsamp__sign(value) ? -size : size;
}

ENVSAMP__MATH int envsamp__in_range(float value, float least, float most)
{
    return envsamp__order(value) >= envsamp__order(least)
        && envsamp__order(value) <= envsamp__order(most);
}

/* What stands for 0 and -0 in a description. */
static float envsamp__or(float value, float otherwise)
{
    return envsamp__in_range(value, 0.0f, 0.0f) ? otherwise : value;
}

/* |x|, but no more than `most`: that for a NaN. Without a branch. */
ENVSAMP__HOT float envsamp__at_most(float x, float most)
{
#ifdef ENVSAMP__FINITE_ONLY
    int32_t bits = (int32_t)(envsamp__float_bits(x) & 0x7fffffffu);
    int32_t end = (int32_t)envsamp__float_bits(most);

    return envsamp__bits_float((uint32_t)(bits < end ? bits : end));
#else
    x = ENVSAMP_FABSF(x);
    return x < most ? x : most;
#endif
}

/* The bits of a double, by a volatile read: -ffast-math cannot take it for finite. */
static uint64_t envsamp__double_bits(const double *value)
{
    double read = *(const volatile double *)value;
    uint64_t bits;

    ENVSAMP_MEMCPY(&bits, &read, sizeof bits);
    return bits;
}

/* The largest exponent; 0x7ff: a number is not finite. */
static int envsamp__exponent(const double *values, int count)
{
    int largest = 0;

    for (int i = 0; i < count; i++)
        largest = envsamp__max_int(largest, (int)(envsamp__double_bits(&values[i]) >> 52 & 0x7ff));
    return largest;
}

/* Any float to [0, 1): NaN, infinities and 1 and above to the end, a negative number by its
   size. */
ENVSAMP__HOT float envsamp__clamp_unit(float u)
{
    return envsamp__at_most(u, ENVSAMP__BELOW_ONE);
}

/* [0, 1]; negative numbers and NaN count as 0. */
ENVSAMP__MATH float envsamp__saturate(float x)
{
    return envsamp__float_bits(x) <= 0x7f800000u ? envsamp__at_most(x, 1.0f) : 0.0f;
}

/* The whole part of a number of 0 or more as an index below `count`, whatever it is. */
ENVSAMP__HOT uint32_t envsamp__index(float x, uint32_t count)
{
    uint32_t whole = (uint32_t)(int)x;

    return whole < count ? whole : count - 1;
}

/* A number of 0 or more with a sign, which a zero keeps. */
ENVSAMP__MATH float envsamp__with_sign(float size, int negative)
{
    return envsamp__bits_float(envsamp__float_bits(size) | (uint32_t)negative << 31);
}

/* Half of a number by its exponent. Compilers cannot make a sum of halves half of a sum, which may
   overflow. */
ENVSAMP__COLD float envsamp__half(float x)
{
    uint32_t bits = envsamp__float_bits(x);

    return bits >= 0x01000000u ? envsamp__bits_float(bits - 0x00800000u) : 0.5f * x;
}

/* Sine and cosine of pi x, 0 <= x <= 2, to 2e-16: Taylor series about the nearest half. */
ENVSAMP_DEVICE static void envsamp__sincos_pi(double x, double *sine, double *cosine)
{
    int quarter = (int)(2.0 * x + 0.5);
    double a = ENVSAMP__PI * (x - 0.5 * (double)quarter), t = a * a;
    double s = a * (1 - t * (1.0 / 6) * (1 - t * (1.0 / 20) * (1 - t * (1.0 / 42)
             * (1 - t * (1.0 / 72) * (1 - t * (1.0 / 110) * (1 - t * (1.0 / 156)
             * (1 - t * (1.0 / 210) * (1 - t * (1.0 / 272)))))))));
    double c = 1 - t * (1.0 / 2) * (1 - t * (1.0 / 12) * (1 - t * (1.0 / 30)
             * (1 - t * (1.0 / 56) * (1 - t * (1.0 / 90) * (1 - t * (1.0 / 132)
             * (1 - t * (1.0 / 182) * (1 - t * (1.0 / 240))))))));

    *sine = quarter & 1 ? c : s;
    *cosine = quarter & 1 ? s : c;
    if (quarter & 2)
        *sine = -*sine;
    if ((quarter + 1) & 2)
        *cosine = -*cosine;
}

/* Cosine and sine of u turns, 0 <= u <= 1, each within 5e-7: the half angle, then doubled, so
   there is no choice of quadrant. */
ENVSAMP__HOT void envsamp__cos_sin_turn(float u, float *cosine, float *sine)
{
    float h = u - 0.5f, t = h * h;
    float t2 = t * t, s = h * (3.14159258f - t * 5.16770690f + t2 * (2.55003164f - t * 0.598046450f
                             + t2 * 0.0772222480f));
    float c = (1.0f - 4.0f * t) * (0.999999945f - t * 0.934791803f + t2 * (0.319215031f
            - t * 0.0548052368f));      /* the zero at u = 0 and u = 1 is exact */

    *cosine = s * s - c * c;    /* one of length (s * s + c * c), whatever their errors */
    *sine = -2.0f * s * c;
}

/* Arc tangent of t in turns, 0 <= t <= 1, within 3e-8. */
ENVSAMP__HOT float envsamp__octant_turn(float t)
{
    float s = t * t;

    return t * (0.159154941f + s * (-0.0530512667f + s * (0.0318199339f
         + s * (-0.0226113556f + s * (0.0169574464f + s * (-0.0119902194f
         + s * (0.00684993014f + s * (-0.00259152250f + s * 0.000462115071f))))))));
}

/* Angle of (x, y) in turns, [0, 1], within 1.5e-7; 0 at the origin. */
ENVSAMP__MATH float envsamp__turn(float y, float x)
{
    float ax = x < 0.0f ? -x : x, ay = y < 0.0f ? -y : y;
    float big = ax > ay ? ax : ay, lesser = ax > ay ? ay : ax;
    float turn = envsamp__octant_turn(big > 0.0f ? lesser / big : 0.0f);

    turn = ay > ax ? 0.25f - turn : turn;
    turn = x < 0.0f ? 0.5f - turn : turn;
    return y < 0.0f ? 1.0f - turn : turn;
}

/* Polar angle over pi, [0, 1], within 1.5e-7, from 1 - cos and 1 + cos of it, with -ffast-math
   also from one rounded below 0. The arc cosine over the square root of the smaller one is a
   polynomial in it. */
ENVSAMP__HOT float envsamp__polar_fraction(float north, float south)
{
    float t = ENVSAMP_FABSF(north < south ? north : south), q = ENVSAMP_SQRTF(t);
    float t2 = t * t, low = 0.450158207f + t * 0.0375087059f + t2 * (0.00850684985f
                            + t * 0.00214716597f);
    float v = q * (low + t2 * t2 * (0.00178524512f - t * 0.000837066695f + t2 * 0.000730843713f));

    return 0.5f - ENVSAMP_COPYSIGNF(0.5f - v, south - north);
}

/* Sine of t quarter turns, 0 <= t <= 1, within 2.5e-7; 0 is exact. */
ENVSAMP__HOT float envsamp__sin_quarter(float t)
{
    float s = t * t, s2 = s * s;

    return t * ((1.57079625f - s * 0.645963371f)
         + s2 * (0.0796884820f - s * 0.00467222789f + s2 * 0.000150820561f));
}

/* Direction of a point of the octahedral square [7], u, v in [0, 1]: components and length within
   5e-7. p and q are the distances from the axes, with the corners, the lower half, folded in; r is
   their sum, z = 1 - r^2, and q / r says how far round its quadrant the direction is. x and y are
   exactly 0 where they change sign. The polynomial is r sqrt(2 - r^2). A square root would keep
   gcc from vectorising loops, and so would a choice between sums, which become its branches. */
ENVSAMP__HOT void envsamp__octahedral_dir(float u, float v, float *x, float *y, float *z)
{
    float a = 2.0f * u - 1.0f, abs_a = ENVSAMP_FABSF(a), rest_a = 1.0f - abs_a;
    float b = 2.0f * v - 1.0f, abs_b = ENVSAMP_FABSF(b), rest_b = 1.0f - abs_b;
    float p = abs_a < rest_b ? abs_a : rest_b, q = abs_b < rest_a ? abs_b : rest_a;
    float r = p + q, inverse = 1.0f / (r + FLT_MIN), s = r * r, s2 = s * s;
    float ring = r * ((1.41421378f - s * 0.353563577f) - s2 * (0.0440602601f + s * 0.0118305748f)
               - s2 * s2 * ((0.00107195461f + s * 0.00519226724f)
                            - s2 * (0.00310698547f - s * 0.00160211383f)));

    *x = ENVSAMP_COPYSIGNF(ring * envsamp__sin_quarter(p * inverse), a);
    *y = ENVSAMP_COPYSIGNF(ring * envsamp__sin_quarter(q * inverse), b);
    *z = ENVSAMP_COPYSIGNF(1.0f - s, rest_b - abs_a);
}

/* 1 for positive numbers and 0, 0 for negative ones and -0: a choice that is no branch. */
ENVSAMP__HOT float envsamp__positive(float t)
{
    return 0.5f + ENVSAMP_COPYSIGNF(0.5f, t);
}

/* Point of the octahedral square in a direction of any length, u and v in [0, 1] and within 2e-7,
   from r = |(x, y)|. The zero vector is in the centre, as +z is; a NaN gives some point. The angle
   from the nearer pole comes from r / |z|, so nothing cancels near the poles and no square
   overflows; w becomes sqrt(1/2) times the sine of half of it. |c - t| is t where c is 0. */
ENVSAMP__MATH void envsamp__octahedral_uv(float x, float y, float z, float r, float *u, float *v)
{
    float abs_x = ENVSAMP_FABSF(x), abs_y = ENVSAMP_FABSF(y), abs_z = ENVSAMP_FABSF(z);
    float big = abs_x > abs_y ? abs_x : abs_y, lesser = abs_x > abs_y ? abs_y : abs_x;
    float high = r > abs_z ? r : abs_z, low = r > abs_z ? abs_z : r;
    float across = lesser / (big + FLT_MIN);
    float down = low / (high + FLT_MIN);

    float turn = 4.0f * envsamp__octant_turn(down);
    turn = turn < 0.5f ? turn : 0.5f;
    float w = ENVSAMP_FABSF(1.0f - envsamp__positive(abs_z - r) - turn);
    float s = w * w;
    w = w * ((0.555360375f - s * 0.0570955985f) + s * s * (0.00176060538f - s * 2.53690523e-05f));
    w = w < 0.5f ? w : 0.5f;
    turn = 4.0f * envsamp__octant_turn(across);
    turn = turn < 0.5f ? turn : 0.5f;
    float q = w * ENVSAMP_FABSF(envsamp__positive(abs_y - abs_x) - turn);
    s = envsamp__positive(z + 0.0f);    /* 1 for the zero vector, whatever its signs */
    float p = ENVSAMP_FABSF(s * w - q);    /* south: p and q change places */
    q = w - p;
    *u = ENVSAMP_FABSF(envsamp__positive(x) - ENVSAMP_FABSF(0.5f * s - p));
    *v = ENVSAMP_FABSF(envsamp__positive(y) - ENVSAMP_FABSF(0.5f * s - q));
}

/* 2^x - 1 for 0 <= x < 126, within 1e-7 of 2^x, and within 2.5e-7 of itself below x = 1. */
ENVSAMP__HOT float envsamp__exp2m1(double x)
{
    int whole = (int)x;
    float f = (float)(x - (double)whole);
    float power = envsamp__bits_float((uint32_t)(whole + 127) << 23);
    float f2 = f * f, rest = f * (0.693147170f + f * 0.240227226f + f2 * (0.0554958479f
                           + f * 0.00965268772f + f2 * (0.00126865296f + f * 0.000208404800f)));

    return (power - 1.0f) + power * rest;
}

/* Base-2 logarithm of a positive normal double, to 1e-15 (1 + |result|): m in [sqrt(1/2),
   sqrt(2)) by its exponent, then the series of 2 atanh((m-1)/(m+1)). */
ENVSAMP_DEVICE static double envsamp__log2(double x)
{
    uint64_t bits;
    double m;

    ENVSAMP_MEMCPY(&bits, &x, sizeof bits);
    int exponent = (int)((bits - (uint64_t)0x3fe6a09e667f3bcd) >> 52 & 0xfffu);
    exponent = exponent >= 0x800 ? exponent - 0x1000 : exponent;
    bits -= (uint64_t)(int64_t)exponent << 52;
    ENVSAMP_MEMCPY(&m, &bits, sizeof m);
    double w = (m - 1.0) / (m + 1.0);
    double t = w * w;
    return (double)exponent + 2.88539008177792681472 * w * (1.0 + t * (1.0 / 3 + t * (1.0 / 5
         + t * (1.0 / 7 + t * (1.0 / 9 + t * (1.0 / 11 + t * (1.0 / 13 + t * (1.0 / 15
         + t * (1.0 / 17)))))))));
}

/* 2^x to 1e-15 relative, -1000 <= x <= 1000. */
ENVSAMP_DEVICE static double envsamp__exp2(double x)
{
    int whole = (int)(x + (x < 0.0 ? -0.5 : 0.5));
    double f = (x - (double)whole) * 0.69314718055994530942, power;
    uint64_t bits = (uint64_t)(whole + 1023) << 52;

    ENVSAMP_MEMCPY(&power, &bits, sizeof power);
    return power * (1.0 + f * (1.0 + f * (1.0 / 2 + f * (1.0 / 6 + f * (1.0 / 24 + f * (1.0 / 120
         + f * (1.0 / 720 + f * (1.0 / 5040 + f * (1.0 / 40320 + f * (1.0 / 362880
         + f * (1.0 / 3628800 + f * (1.0 / 39916800 + f * (1.0 / 479001600)))))))))))));
}

ENVSAMP__COLD double envsamp__dot(const double *a, const double *b, int count)
{
    double sum = 0.0;

    for (int i = 0; i < count; i++)
        sum += a[i] * b[i];
    return sum;
}

/* Points of a batch. Every stage is a loop over all of them, which compilers vectorise. */
#define ENVSAMP__BATCH 64

ENVSAMP__HOT void envsamp__sqrt_n(float *x, int n)
{
#ifdef ENVSAMP__SSE
    for (; n >= 4; n -= 4, x += 4)
        _mm_storeu_ps(x, _mm_sqrt_ps(_mm_loadu_ps(x)));
#endif
    for (int i = 0; i < n; i++)
        x[i] = ENVSAMP_SQRTF(x[i]);
}

#if defined(__GNUC__) && defined(ENVSAMP__HOST_ONLY)
#define ENVSAMP__PREFETCH(p) __builtin_prefetch(p)
#elif defined(ENVSAMP__SSE)
#define ENVSAMP__PREFETCH(p) _mm_prefetch((const char *)(p), _MM_HINT_T0)
#else
#define ENVSAMP__PREFETCH(p) ((void)(p))
#endif

/* ============================================================================================
 * IMAGES AND ROWS OF LUMINANCE                                               [search: @images]
 *
 * Memory, checks of what callers give, and the one reader of pixels, which mends and counts bad
 * ones. kd and cdf read rows of luminance, from an image or a callback; halftone and lights read
 * runs of a row and single texels.
 * ========================================================================================== */

ENVSAMP_DEF const char *envsamp_result_string(envsamp_result result)
{
    switch (result) {
    case ENVSAMP_OK: return "no error";
    case ENVSAMP_ERR_NULL: return "a required pointer is NULL";
    case ENVSAMP_ERR_SIZE: return "width, height, channels or stride out of range";
    case ENVSAMP_ERR_PARAM: return "a field of the description is out of range";
    case ENVSAMP_ERR_VALUE: return "a pixel is NaN, infinite or negative";
    case ENVSAMP_ERR_BLACK: return "the total importance is zero: nothing to sample";
    case ENVSAMP_ERR_MEMORY: return "a buffer is too small";
    case ENVSAMP_ERR_ALIGN: return "a buffer, pixels or a row stride is not aligned";
    case ENVSAMP_ERR_FORMAT: return "not a valid table, or scratch, of this kind";
    }
    return "unknown result";
}

ENVSAMP_DEVICE ENVSAMP_DEF float envsamp_luminance(const float rgb[3])
{
    return 0.2126f * rgb[0] + 0.7152f * rgb[1] + 0.0722f * rgb[2];
}

ENVSAMP_DEVICE ENVSAMP_DEF float envsamp_mis_power(float pdf_taken, float pdf_other)
{
    if (!(pdf_taken > 0.0f))
        return 0.0f;
    if (envsamp__order(pdf_taken) > envsamp__order(FLT_MAX))
        return envsamp__order(pdf_other) > envsamp__order(FLT_MAX) ? 0.5f : 1.0f;
    float ratio = pdf_other / pdf_taken;    /* squares of large densities would overflow */
    return 1.0f / (1.0f + ratio * ratio);
}

/* ---- memory ---- */

/* Where arrays begin in a buffer: at multiples of this many bytes from its start. */
#define ENVSAMP__GRANULE 16

/* Hands out pieces of a buffer, or, without one, only counts their bytes. */
typedef struct envsamp__arena { char *base; uint64_t used; } envsamp__arena;

ENVSAMP__COLD void *envsamp__take(envsamp__arena *arena, uint64_t count, size_t size)
{
    uint64_t at = arena->used;

    arena->used += (count * size + ENVSAMP__GRANULE - 1) / ENVSAMP__GRANULE * ENVSAMP__GRANULE;
    return arena->base ? arena->base + at : NULL;
}
#define ENVSAMP__TAKE(type, arena, count) \
    ((type *)envsamp__take(arena, (uint64_t)(count), sizeof(type)))

/* Bytes of two buffers. No object is larger than half of what a size_t counts to: where that has 32
   bits, the sizes of large maps are refused. */
static envsamp_result envsamp__set_sizes(envsamp_sizes *sizes, uint64_t table, uint64_t scratch)
{
    if (table > SIZE_MAX / 2 || scratch > SIZE_MAX / 2)
        return ENVSAMP_ERR_SIZE;
    sizes->table_bytes = (size_t)table;
    sizes->scratch_bytes = (size_t)scratch;
    return ENVSAMP_OK;
}

static envsamp_result envsamp__buffers_check(const envsamp_sizes *sizes, envsamp_buffer table,
                                             envsamp_buffer scratch)
{
    if (!table.data || !scratch.data)
        return ENVSAMP_ERR_NULL;
    if (table.bytes < sizes->table_bytes || scratch.bytes < sizes->scratch_bytes)
        return ENVSAMP_ERR_MEMORY;
    if ((uintptr_t)table.data % ENVSAMP_ALIGN || (uintptr_t)scratch.data % ENVSAMP_ALIGN)
        return ENVSAMP_ERR_ALIGN;
    return ENVSAMP_OK;
}

/* ---- tables ---- */

/* How every table begins. The checksum is of all that follows it. */
typedef struct envsamp__table {
    uint32_t magic, version, checksum, mapping;
    uint64_t bytes;
} envsamp__table;

/* Four sums, each of every fourth 64-bit word, so that their multiplications overlap. */
typedef struct envsamp__check { uint64_t a, b, c, d, at; } envsamp__check;

static inline uint64_t envsamp__mix(uint64_t sum, uint64_t bits)
{
    sum = (sum ^ bits) * (uint64_t)0x9e3779b97f4a7c15;
    return sum ^ sum >> 32;
}

/* Adds at most `most` bytes of a table, a multiple of 32, to sums that begin as zeros. Returns 0
   when all of it is in, and its checksum. Zeros complete the last four words. */
static int envsamp__check_add(const void *table, uint64_t most, envsamp__check *s,
                              uint32_t *checksum)
{
    envsamp__check sums = *s;
    envsamp__table head;
    uint64_t bits[4], end;

    ENVSAMP_MEMCPY(&head, table, sizeof head);
    if (sums.at == 0) {
        sums.a = head.mapping;
        sums.at = offsetof(envsamp__table, bytes);
    }
    for (end = sums.at + most; sums.at < end && sums.at < head.bytes; sums.at += sizeof bits) {
        if (head.bytes - sums.at >= sizeof bits) {
            ENVSAMP_MEMCPY(bits, (const char *)table + sums.at, sizeof bits);
        } else {
            ENVSAMP_MEMSET(bits, 0, sizeof bits);
            ENVSAMP_MEMCPY(bits, (const char *)table + sums.at, (size_t)(head.bytes - sums.at));
        }
        sums.a = envsamp__mix(sums.a, bits[0]);
        sums.b = envsamp__mix(sums.b, bits[1]);
        sums.c = envsamp__mix(sums.c, bits[2]);
        sums.d = envsamp__mix(sums.d, bits[3]);
    }
    *checksum = (uint32_t)envsamp__mix(envsamp__mix(envsamp__mix(envsamp__mix(0, sums.a), sums.b),
                                                    sums.c), sums.d);
    *s = sums;
    return sums.at < head.bytes;
}

static uint32_t envsamp__checksum(const void *table)
{
    envsamp__check sums = { 0, 0, 0, 0, 0 };
    uint32_t checksum;

    envsamp__check_add(table, UINT64_MAX / 2, &sums, &checksum);
    return checksum;
}

/* Whether `bytes` from `table` may be a table with such a header: what all kinds have in common. */
static envsamp_result envsamp__table_check(const void *table, size_t bytes, size_t header_bytes,
                                           uint32_t magic, uint32_t version)
{
    envsamp__table head;

    if (!table)
        return ENVSAMP_ERR_NULL;
    if ((uintptr_t)table % ENVSAMP_ALIGN)
        return ENVSAMP_ERR_ALIGN;
    if (bytes < header_bytes)
        return ENVSAMP_ERR_FORMAT;
    ENVSAMP_MEMCPY(&head, table, sizeof head);
    return head.magic == magic && head.version == version && head.mapping <= ENVSAMP_OCTAHEDRAL
        && head.bytes >= header_bytes && head.bytes <= bytes
        && head.checksum == envsamp__checksum(table) ? ENVSAMP_OK : ENVSAMP_ERR_FORMAT;
}

/* ---- images ---- */

static size_t envsamp__row_stride(const envsamp_image *image)
{
    return image->row_stride_bytes ? image->row_stride_bytes
                                   : (size_t)image->width * (size_t)image->channels * 4;
}

ENVSAMP__COLD const float *envsamp__pixel_at(const envsamp_image *image, int x, int y)
{
    return (const float *)(const void *)((const char *)image->pixels
                                         + (size_t)y * envsamp__row_stride(image))
         + (size_t)x * (size_t)image->channels;
}

static envsamp_result envsamp__image_check(const envsamp_image *image)
{
    if (image->width < 1 || image->width > 65535 || image->height < 1 || image->height > 65535
        || (image->channels != 1 && image->channels != 3 && image->channels != 4))
        return ENVSAMP_ERR_SIZE;
    size_t stride = envsamp__row_stride(image);
    if (stride / 4 / (size_t)image->channels < (size_t)image->width
        || stride > SIZE_MAX / (size_t)image->height)
        return ENVSAMP_ERR_SIZE;
    if (stride % 4)
        return ENVSAMP_ERR_ALIGN;
    return (uint32_t)image->mapping <= ENVSAMP_OCTAHEDRAL ? ENVSAMP_OK : ENVSAMP_ERR_PARAM;
}

static envsamp_result envsamp__floats_check(const float *floats)
{
    if (!floats)
        return ENVSAMP_ERR_NULL;
    return (uintptr_t)floats % 4 ? ENVSAMP_ERR_ALIGN : ENVSAMP_OK;
}

/* Sets sizes to 0, and checks the image that they are asked for. */
ENVSAMP__COLD envsamp_result envsamp__begin_sizes(const envsamp_image *image, envsamp_sizes *sizes)
{
    if (!sizes)
        return ENVSAMP_ERR_NULL;
    sizes->table_bytes = sizes->scratch_bytes = 0;
    return image ? envsamp__image_check(image) : ENVSAMP_ERR_NULL;
}

/* Where the texel (x, y) lies, if it is one beyond an edge: -1 <= x <= width, -1 <= y <= height.
   Beyond an edge of the octahedral square is the other half of the same edge, mirrored. */
static void envsamp__wrap_texel(envsamp_mapping mapping, int width, int height, int *x, int *y)
{
    int in_x = *x < 0 ? 0 : envsamp__min(*x, width - 1), past_x = in_x != *x;
    int in_y = *y < 0 ? 0 : envsamp__min(*y, height - 1), past_y = in_y != *y;

    if (mapping == ENVSAMP_OCTAHEDRAL) {
        *x = past_y ? width - 1 - in_x : in_x;
        *y = past_x ? height - 1 - in_y : in_y;
        return;
    }
    if (past_y && (*y < 0 || mapping != ENVSAMP_HEMISPHERE))    /* over a pole, half a turn round */
        *x += width / 2;
    *x = (*x + width) % width;
    *y = in_y;
}

/* ---- pixels ---- */

#define ENVSAMP__LEVELS 16      /* cells of 2^16 texels cover the widest map */
#define ENVSAMP__CHUNK 64       /* columns that are worked on together */
#define ENVSAMP__TOP 128        /* cells of the coarsest level, at most: one split reads as many */
#define ENVSAMP__BEYOND 17      /* knots that are read, but do not count, after the last */

/* A pixel as importance sees it: black for NaN or infinite channels, negative ones 0. Returns
   whether a channel was bad. */
static int envsamp__mend_pixel(const float *from, int channels, float rgb[3])
{
    int black = 0, negative = 0;

    for (int c = 0; c < 3; c++) {
        float value = from[channels == 1 ? 0 : c];
        uint32_t bits = envsamp__float_bits(value);

        black |= (bits & 0x7f800000u) == 0x7f800000u;
        negative |= bits > 0x80000000u;
        rgb[c] = bits < 0x7f800000u ? value : 0.0f;
    }
    if (black)
        rgb[0] = rgb[1] = rgb[2] = 0.0f;
    return black || negative;
}

/* Sets the top bit for infinities, NaN and negative numbers, which may be bad, and for -0. */
static inline uint32_t envsamp__suspect(float value)
{
    return (envsamp__float_bits(value) >> 1) + 0x40400000u;
}

/* Reads `count` pixels of a row, at most ENVSAMP__CHUNK: returns them as they lie where all are
   good, else a copy in `mended`. Adds how many are bad. */
static const float *envsamp__read_pixels(const float *from, int channels, int count,
                                         float *mended, size_t *bad)
{
    int floats = channels * count, at = 0, i;
    uint32_t top = 0;

    for (; at + ENVSAMP__CHUNK <= floats; at += ENVSAMP__CHUNK)
        for (i = 0; i < ENVSAMP__CHUNK; i++)
            top |= envsamp__suspect(from[at + i]);
    for (; at < floats; at++)
        top |= envsamp__suspect(from[at]);
    if (top >> 31 && channels == 4)         /* not by what is ignored */
        for (i = 0, top = 0; i < count; i++)
            top |= envsamp__suspect(from[4 * i]) | envsamp__suspect(from[4 * i + 1])
                 | envsamp__suspect(from[4 * i + 2]);
    if (!(top >> 31))
        return from;
    for (i = 0; i < count; i++) {
        float rgba[4] = { 0.0f };

        *bad += (size_t)envsamp__mend_pixel(from + i * channels, channels, rgba);
        for (int c = 0; c < channels; c++)
            mended[i * channels + c] = rgba[c];
    }
    return mended;
}

/* Luminance of pixels of a row; returns how many are bad. The weights sum to 1 in floats: that of
   finite pixels is finite. */
static size_t envsamp__read_luminance(const float *from, int channels, int count, float *luminance)
{
    float mended[4 * ENVSAMP__CHUNK];
    size_t bad = 0;

    for (int x = 0; x < count; x += ENVSAMP__CHUNK) {
        int run = envsamp__min(ENVSAMP__CHUNK, count - x);
        const float *pixels = envsamp__read_pixels(from + x * channels, channels, run, mended,
                                                   &bad);

        if (channels == 1)
            ENVSAMP_MEMCPY(luminance + x, pixels, (size_t)run * sizeof(float));
        for (int i = 0; i < run && channels > 1; i++)
            luminance[x + i] = envsamp_luminance(pixels + i * channels);
    }
    return bad;
}

/* The sum of a row, and its maximum, if that is above *peak. In fours, so that an addition need not
   wait for the one before. */
static double envsamp__sum_row(const float *luminance, int width, float *peak)
{
    double sum[4] = { 0.0 };
    float most[4] = { *peak, *peak, *peak, *peak };
    int x;

    for (x = 0; x + 4 <= width; x += 4) {
        for (int i = 0; i < 4; i++)
            sum[i] += (double)luminance[x + i];
        for (int i = 0; i < 4; i++)
            most[i] = luminance[x + i] > most[i] ? luminance[x + i] : most[i];
    }
    for (; x < width; x++) {
        sum[0] += (double)luminance[x];
        most[0] = luminance[x] > most[0] ? luminance[x] : most[0];
    }
    for (int i = 0; i < 4; i++)
        *peak = most[i] > *peak ? most[i] : *peak;
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

/* ---- the map and its rows ---- */

/* Part of the map, in cells. */
typedef struct envsamp__rect { double x0, y0, x1, y1; } envsamp__rect;

/* A row of cells, or a slice of it. sr: solid angle of a column of it one cell wide. Between values
   a and c above and below the row, the mean over the slice is a + at (c - a) and the variance
   spread (c - a)^2: radiance is linear in theta, solid angle is not. */
typedef struct envsamp__row_slice { double sr, at, spread; } envsamp__row_slice;

typedef struct envsamp__level {
    float *mean, *deviation;    /* of each cell; level 0 has neither these, */
    double *row_sr;             /* nor this: solid angle of a column one cell of level 0 wide */
    int width, height, shift;
} envsamp__level;

/* What was read of a row of texels, and the scale of floats after it. */
typedef struct envsamp__texel_row { double sum; float peak, scale; size_t bad; } envsamp__texel_row;

#define ENVSAMP__WHOLE 0x4c4f4857u      /* "WHOL": marks scratch all of whose rows were read */

/* A map as builds read it, row by row, and as cells: see @importance. */
typedef struct envsamp__map {
    envsamp_image image;
    envsamp_kd_desc desc;       /* cdf: the fields that it shares */
    envsamp_row_fn fn;          /* NULL: image.pixels */
    void *user;
    float *row;                 /* what fn fills */
    float *side[2];             /* octahedral, bilinear: first and last texel of every row */
    float compensation, dim;    /* in force: MIS compensation, what is subtracted for it, */
    float power;                /* and the exponent of importance; 0: none */
    double full_integral;       /* of all luminance, and its maximum, if the map was surveyed */
    float brightest;
    size_t bad_pixel_count;

    int bilinear;
    envsamp__rect bounds;       /* the whole map, in cells; it begins at the offset */
    int width, height;          /* of level 0, in cells */
    float *knots;               /* bilinear: width + 1 by height + 1; else the cells' luminance */
    float *highest;             /* maxima of cells of level 1 */
    size_t stride, knot_count;
    envsamp__row_slice *rows;   /* height */
    envsamp__level levels[ENVSAMP__LEVELS];
    int level_count;
    double integral;            /* of what was read, */
    float peak;                 /* and its maximum */
    float scale;                /* of floats that are squared; unit is 1 / scale */
    double unit;
    envsamp__texel_row *texel_rows;     /* kd: of each row of texels */
    int read_from, read_to;     /* rows of texels that a rebuild reads, the last not included */
    int cells_from, cells_to;   /* rows of level 0 that change with them */
    uint32_t whole;             /* ENVSAMP__WHOLE once all rows were read */
} envsamp__map;

/* Whether all rows are read once before a build begins. */
static int envsamp__is_surveyed(const envsamp_image *image, const envsamp_kd_desc *desc)
{
    return (!desc->nearest && image->mapping == ENVSAMP_OCTAHEDRAL)
        || desc->mis_compensation > 0.0f || desc->importance_exponent != 1.0f;
}

/* Makes importance of luminance: what compensation leaves of it, to the power in force. The maximum
   stays the same, and nothing lit becomes black. */
static void envsamp__make_importance(const envsamp__map *map, float *luminance, int count)
{
    double most = (double)map->brightest - (double)map->dim;
    float dim = map->dim;

    for (int x = 0; x < count; x++) {
        uint32_t bits = envsamp__float_bits(luminance[x] - dim);

        luminance[x] = envsamp__bits_float(bits & ((bits >> 31) - 1));      /* 0 if negative */
    }
    for (int x = 0; x < count && map->power > 0.0f; x++)
        if (luminance[x] > 0.0f && (double)luminance[x] < most) {
            float least = luminance[x] < FLT_MIN ? luminance[x] : FLT_MIN;
            float raised = (float)(most * envsamp__exp2((double)map->power * envsamp__log2(
                (double)luminance[x] / most)));

            luminance[x] = raised > least ? raised : least;
        }
}

/* Luminance of a row of texels, or their importance. */
static envsamp_result envsamp__read_row(envsamp__map *map, int y, float *luminance)
{
    const envsamp_image *image = &map->image;
    const float *row = map->fn ? map->row : envsamp__pixel_at(image, 0, y);
    envsamp_result result = map->fn ? map->fn(y, map->row, map->user) : ENVSAMP_OK;

    if (result != ENVSAMP_OK)
        return result;
    map->bad_pixel_count = (y > 0 ? map->bad_pixel_count : 0)
                            + envsamp__read_luminance(row, image->channels, image->width,
                                                      luminance);
    if (map->dim > 0.0f || map->power > 0.0f)
        envsamp__make_importance(map, luminance, image->width);
    return map->desc.strict && map->bad_pixel_count ? ENVSAMP_ERR_VALUE : ENVSAMP_OK;
}

/* The line of knots at the upper or lower border, next to the line `inner`. The four corners of an
   octahedral map are one point; `fold` has the ends of the mirrored row. */
static void envsamp__border_line(const envsamp__map *map, int outside, const float *inner,
                                 const float fold[2], float *line)
{
    const envsamp_image *image = &map->image;
    int width = image->width;

    for (int x = 0; x < width; x++) {
        int wrapped_x = x, wrapped_y = outside;     /* becomes the row of `inner` */

        envsamp__wrap_texel(image->mapping, width, image->height, &wrapped_x, &wrapped_y);
        line[x + 1] = envsamp__half(inner[x + 1]) + envsamp__half(inner[wrapped_x + 1]);
    }
    float corner = image->mapping != ENVSAMP_OCTAHEDRAL ? line[width]
                 : envsamp__half(fold[0]) + envsamp__half(fold[1]);
    line[0] = line[width + 1] = envsamp__half(line[1]) + envsamp__half(corner);
}

/* ============================================================================================
 * EDGES AND COORDINATES                                                 [search: @coordinates]
 *
 * What turns edges, directions, u and v into one another.
 * ========================================================================================== */

/* In double. A 0 of an octahedral map has the sign of its side, so that points on an edge come back
   on the same half of it. */
ENVSAMP_DEVICE ENVSAMP_DEF void envsamp_uv_to_dir(envsamp_mapping mapping, float u, float v,
                                                  float dir[3])
{
    double sine, cosine, sine_phi, cosine_phi;

    dir[0] = dir[1] = dir[2] = 0.0f;
    v = envsamp__saturate(v);
    if (mapping == ENVSAMP_OCTAHEDRAL) {
        double a = 2.0 * (double)envsamp__saturate(u) - 1.0;
        double b = 2.0 * (double)v - 1.0;
        double p = ENVSAMP__FABS(a);
        double q = ENVSAMP__FABS(b);
        double r = p + q > 1.0 ? 2.0 - (p + q) : p + q;
        double z = p + q > 1.0 ? r * r - 1.0 : 1.0 - r * r;
        q = p + q > 1.0 ? 1.0 - p : q;
        double ring = r * ENVSAMP_SQRT(2.0 - r * r);
        envsamp__sincos_pi(r > 0.0 ? 0.5 * q / r : 0.0, &sine_phi, &cosine_phi);
        dir[0] = ENVSAMP_COPYSIGNF((float)(cosine_phi * ring), (float)a);
        dir[1] = ENVSAMP_COPYSIGNF((float)(sine_phi * ring), (float)b);
        dir[2] = (float)z;
    } else if (mapping == ENVSAMP_LATLONG || mapping == ENVSAMP_HEMISPHERE) {
        u = envsamp__in_range(u, -1e6f, 1e6f) ? u : 0.0f;
        u -= (float)(int)u;
        envsamp__sincos_pi(2.0 * (double)(u < 0.0f ? u + 1.0f : u), &sine_phi, &cosine_phi);
        envsamp__sincos_pi((mapping == ENVSAMP_LATLONG ? 1.0 : 0.5) * (double)v, &sine, &cosine);
        dir[0] = (float)(cosine_phi * sine);
        dir[1] = (float)(sine_phi * sine);
        dir[2] = (float)cosine;
    }
}

ENVSAMP_DEVICE ENVSAMP_DEF void envsamp_dir_to_uv(envsamp_mapping mapping, const float dir[3],
                                                  float uv[2])
{
    double x = (double)dir[0], y = (double)dir[1];      /* whose squares cannot underflow */
    float r = (float)ENVSAMP_SQRT(x * x + y * y);

    if (mapping == ENVSAMP_OCTAHEDRAL) {
        envsamp__octahedral_uv(dir[0], dir[1], dir[2], r, &uv[0], &uv[1]);
        uv[0] = envsamp__saturate(uv[0]);
        uv[1] = envsamp__saturate(uv[1]);
        return;
    }
    float turn = envsamp__turn(dir[1], dir[0]);
    uv[0] = envsamp__float_bits(turn) < 0x3f800000u ? turn : 0.0f;      /* a NaN is 0, too */
    turn = envsamp__saturate(envsamp__turn(r, dir[2]));
    uv[1] = mapping == ENVSAMP_HEMISPHERE ? 4.0f * turn : 2.0f * turn;
}

ENVSAMP_DEF void envsamp_lookup(const envsamp_image *image, int nearest, const float dir[3],
                                float rgb[3])
{
    float uv[2], texel[3], half = nearest ? 0.0f : 0.5f;

    ENVSAMP_ASSERT(image && dir && rgb && envsamp__floats_check(image->pixels) == ENVSAMP_OK);
    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    if (image->mapping == ENVSAMP_HEMISPHERE && dir[2] < 0.0f)
        return;
    envsamp_dir_to_uv(image->mapping, dir, uv);
    float fx = uv[0] * (float)image->width;
    float fy = uv[1] * (float)image->height;
    int x0 = fx < half ? -1 : (int)envsamp__index(fx - half, (uint32_t)image->width);
    int y0 = fy < half ? -1 : (int)envsamp__index(fy - half, (uint32_t)image->height);
    fx = nearest ? 0.0f : fx - (0.5f + (float)x0);
    fy = nearest ? 0.0f : fy - (0.5f + (float)y0);
    for (int i = 0; i < (nearest ? 1 : 4); i++) {
        float weight = (i & 1 ? fx : 1.0f - fx) * (i & 2 ? fy : 1.0f - fy);
        int x = x0 + (i & 1), y = y0 + (i >> 1);

        envsamp__wrap_texel(image->mapping, image->width, image->height, &x, &y);
        envsamp__mend_pixel(envsamp__pixel_at(image, x, y), image->channels, texel);
        for (int c = 0; c < 3; c++)
            rgb[c] += weight * texel[c];
    }
}

/* ---- coordinates and solid angles ---- */

/* Where cells begin and end, along axis 0 or 1: those of the border are half as wide. */
static inline double envsamp__cell_edge(const envsamp__map *map, int i, int axis)
{
    return axis ? envsamp__clamp((double)i, map->bounds.y0, map->bounds.y1)
                : envsamp__clamp((double)i, map->bounds.x0, map->bounds.x1);
}

/* Polar angle by the nearer pole, as 1 - cos theta or, `south`, 1 + cos theta: each is exact at its
   pole. Of an octahedral map: v, which measures solid angle as cos theta does. */
typedef struct envsamp__polar { double cap; int south; } envsamp__polar;

static envsamp__polar envsamp__polar_at(const envsamp__map *map, double y)
{
    double down = y - map->bounds.y0, height = (double)map->image.height, sine, cosine;
    envsamp__polar p;

    p.south = map->image.mapping == ENVSAMP_LATLONG && down > 0.5 * height;
    p.cap = p.south ? 1.0 - down / height : down / height;
    if (map->image.mapping != ENVSAMP_OCTAHEDRAL) {
        envsamp__sincos_pi(map->image.mapping == ENVSAMP_LATLONG ? 0.5 * p.cap : 0.25 * p.cap,
                           &sine, &cosine);
        p.cap = 2.0 * sine * sine;
    }
    return p;
}

/* Difference of two polar angles in 1 - cos theta. Each is a distance from its nearer pole, so
   nothing cancels. */
ENVSAMP__HOT double envsamp__cap_between(double near0, int south0, double near1, int south1)
{
    if (south0 == south1)
        return south0 ? near0 - near1 : near1 - near0;
    return (1.0 - near0) + (1.0 - near1);
}

/* Solid angle of a band, once round, by a unit of 1 - cos theta, or of v. */
ENVSAMP__MATH double envsamp__unit_sr(uint32_t mapping)
{
    return mapping == ENVSAMP_OCTAHEDRAL ? 4.0 * ENVSAMP__PI : 2.0 * ENVSAMP__PI;
}

/* Solid angle of a column one cell wide between two heights, in cells. */
static double envsamp__rows_sr(const envsamp__map *map, double y0, double y1)
{
    envsamp__polar a = envsamp__polar_at(map, y0), b = envsamp__polar_at(map, y1);

    return envsamp__unit_sr((uint32_t)map->image.mapping) / (double)map->image.width
         * envsamp__cap_between(a.cap, a.south, b.cap, b.south);
}

/* The slice of row y between y0 and y1. About the middle of the slice, at distances of up to h in
   theta, solid angle goes with the sine: with t = 1 - h cot h the mean distance is t cot theta and
   the mean of its square h^2 - 2 t. `rough`: away from the poles as if solid angle were even within
   the row. */
static envsamp__row_slice envsamp__slice_of_row(const envsamp__map *map, int y, double y0,
                                                double y1, int rough)
{
    double edge = envsamp__cell_edge(map, y, 1), high = envsamp__cell_edge(map, y + 1, 1) - edge;
    double top = (y0 - edge) / high, end = (y1 - edge) / high;
    double half = 0.5 * (y1 - y0) / high, shift = 0.0, second = 1.0 / 3.0;
    envsamp__row_slice slice;

    if (rough && map->rows[y].at >= 0.49 && map->rows[y].at <= 0.51) {
        slice.sr = map->rows[y].sr * (end - top);
        slice.at = 0.5 * (top + end);
        slice.spread = (end - top) * (end - top) / 12.0;
        return slice;
    }
    slice.sr = envsamp__rows_sr(map, y0, y1);
    if (map->image.mapping != ENVSAMP_OCTAHEDRAL) {
        double turn = (map->image.mapping == ENVSAMP_LATLONG ? 1.0 : 0.5)
                    / (double)map->image.height;
        double h = ENVSAMP__PI * 0.5 * (y1 - y0) * turn, t = h * h, sine, cosine, fraction;

        if (h < 0.1) {                  /* (1 - h cot h) / h^2 */
            fraction = 1.0 / 3 + t * (1.0 / 45 + t * (2.0 / 945 + t * (1.0 / 4725)));
        } else {
            envsamp__sincos_pi(0.5 * (y1 - y0) * turn, &sine, &cosine);
            fraction = (1.0 - h * cosine / sine) / t;
        }
        envsamp__sincos_pi((0.5 * (y0 + y1) - map->bounds.y0) * turn, &sine, &cosine);
        shift = sine > 0.0 ? fraction * h * cosine / sine : 0.0;
        second = 1.0 - 2.0 * fraction;
    }
    slice.at = 0.5 * (top + end) + shift * half;
    slice.spread = (second - shift * shift) * half * half;
    return slice;
}

/* Solid angle by which a texel of row y counts in the integral. Where the map is bilinear: that of
   its knot, and of its part in knots of the border. */
static double envsamp__texel_sr(const envsamp__map *map, int y)
{
    const envsamp__row_slice *above = &map->rows[y], *below = above + 1;

    if (!map->bilinear)
        return above->sr;
    double sr = above->sr * above->at + below->sr * (1.0 - below->at);
    if (y == 0)
        sr += above->sr * (1.0 - above->at);
    if (y + 1 == map->image.height)
        sr += below->sr * below->at;
    return sr;
}

/* ---- edges as tables store them ---- */

/* An edge as a table stores it: azimuth in turns, or u; along axis 1 1 - cos theta above the
   equator, minus (1 + cos theta) below, so that each is exact at its pole, or v. */
ENVSAMP__COLD float envsamp__stored_edge(const envsamp__map *map, double at, int axis)
{
    if (axis == 0)
        return (float)((at - map->bounds.x0) / (double)map->image.width);
    envsamp__polar p = envsamp__polar_at(map, at);
    return envsamp__with_sign((float)p.cap, p.south);
}

/* Stored edges in rising order, as integers. */
ENVSAMP__MATH uint32_t envsamp__edge_key(float y)
{
    uint32_t bits = envsamp__float_bits(y);

    return bits >> 31 ? 0xff000000u - bits : bits;      /* 1 and -1 are the same: the equator */
}

/* Moves a cut of a rectangle to where a table can store it exactly: to a whole row or column, if
   that is stored as the same edge, since cuts below the crown lie there. Returns whether it is also
   stored between the edges of the rectangle. */
static int envsamp__store_cut(const envsamp__map *map, const envsamp__rect *rect, int axis,
                              double *at)
{
    double whole = (double)(int)(*at + 0.5);
    float stored = envsamp__stored_edge(map, *at, axis);
    uint32_t key = envsamp__edge_key(stored);

    double edge = (double)ENVSAMP_FABSF(stored);
    if (envsamp__edge_key(envsamp__stored_edge(map, whole, axis)) == key) {
        *at = whole;
    } else if (axis == 0) {
        *at = edge * (double)map->image.width + map->bounds.x0;
    } else if (map->image.mapping == ENVSAMP_OCTAHEDRAL) {
        *at = edge * (double)map->image.height + map->bounds.y0;
    } else {                                /* a step of Newton's */
        envsamp__polar p = envsamp__polar_at(map, *at);

        double range = ENVSAMP__PI * (map->image.mapping == ENVSAMP_LATLONG ? 1.0 : 0.5);
        double sine = ENVSAMP_SQRT(p.cap * (2.0 - p.cap));
        if (sine > 0.0)
            *at += (p.south ? p.cap - edge : edge - p.cap)
                 / (sine * range / (double)map->image.height);
        *at = envsamp__clamp(*at, map->bounds.y0, map->bounds.y1);
    }
    key = envsamp__edge_key(envsamp__stored_edge(map, *at, axis));
    return envsamp__edge_key(envsamp__stored_edge(map, axis ? rect->y0 : rect->x0, axis)) < key
        && key < envsamp__edge_key(envsamp__stored_edge(map, axis ? rect->y1 : rect->x1, axis));
}

/* Solid angle between the stored edges x0, x1, y0, y1: what samples of the block really fill. */
static double envsamp__edges_sr(uint32_t mapping, const float edge[4])
{
    return envsamp__unit_sr(mapping) * ((double)edge[1] - (double)edge[0])
         * envsamp__cap_between((double)ENVSAMP_FABSF(edge[2]), envsamp__sign(edge[2]),
                                (double)ENVSAMP_FABSF(edge[3]), envsamp__sign(edge[3]));
}

/* Inside the map. */
ENVSAMP__MATH int envsamp__edge_valid(uint32_t mapping, float edge, int axis)
{
    return envsamp__in_range(edge, -1.0f, 1.0f)
        && (!envsamp__sign(edge) || (axis && mapping == ENVSAMP_LATLONG));
}

/* Edges x0, x1, y0, y1 that rise. */
ENVSAMP__MATH int envsamp__edges_valid(uint32_t mapping, const float edge[4])
{
    int valid = edge[0] < edge[1] && envsamp__edge_key(edge[2]) < envsamp__edge_key(edge[3]);

    for (int i = 0; i < 4; i++)
        valid &= envsamp__edge_valid(mapping, edge[i], i > 1);
    return valid;
}

/* ---- points of a block ---- */

/* Where a sample lies: azimuth in turns, 1 - cos theta, 1 + cos theta. */
typedef struct envsamp__point { float x, north, south; } envsamp__point;

/* 1 - cos theta and 1 + cos theta of an edge as a table stores it. */
typedef struct envsamp__polar_pair { float north, south; } envsamp__polar_pair;

ENVSAMP__HOT envsamp__polar_pair envsamp__edge_pair(float y)
{
    float cap = ENVSAMP_FABSF(y), rest = 2.0f - cap;
    int south = envsamp__sign(y);
    const envsamp__polar_pair pair = { south ? rest : cap, south ? cap : rest };

    return pair;
}

/* v of 1 - cos theta and 1 + cos theta; of an octahedral map v is the first of them. */
ENVSAMP__HOT float envsamp__polar_v(uint32_t mapping, float north, float south)
{
    float v = mapping == ENVSAMP_OCTAHEDRAL ? north : envsamp__polar_fraction(north, south);

    return mapping != ENVSAMP_HEMISPHERE ? v : v < 0.5f ? v + v : 1.0f;
}

/* Fractions of the way between two edges in azimuth, and in solid angle between two rows. */
ENVSAMP__HOT envsamp__point envsamp__between(float x0, float x1, float fx, float y0, float y1,
                                             float fy)
{
    envsamp__polar_pair top = envsamp__edge_pair(y0), end = envsamp__edge_pair(y1);
    const envsamp__point p = { x0 + fx * (x1 - x0), top.north + fy * (end.north - top.north),
                               top.south + fy * (end.south - top.south) };

    return p;
}

/* The direction of a point whose sine of theta is known; lat-long and hemisphere. */
ENVSAMP__HOT void envsamp__point_dir(envsamp__point p, float sine, float *x, float *y, float *z)
{
    float cosine_phi, sine_phi;

    envsamp__cos_sin_turn(p.x, &cosine_phi, &sine_phi);
    *x = cosine_phi * sine;
    *y = sine_phi * sine;
    *z = 0.5f * (p.south - p.north);
}

/* A sample at a point. */
ENVSAMP__HOT envsamp_sample envsamp__point_sample(uint32_t mapping, envsamp__point p, float pdf)
{
    envsamp_sample s;

    s.pdf = pdf;
    s.uv[0] = p.x = envsamp__clamp_unit(p.x);
    s.uv[1] = envsamp__polar_v(mapping, p.north, p.south);
    if (mapping == ENVSAMP_OCTAHEDRAL)
        envsamp__octahedral_dir(p.x, p.north, &s.dir[0], &s.dir[1], &s.dir[2]);
    else
        envsamp__point_dir(p, ENVSAMP_SQRTF(ENVSAMP_FABSF(p.north * p.south)), &s.dir[0],
                           &s.dir[1], &s.dir[2]);
    return s;
}

/* Points and densities of a batch are all x, all north, all south, all densities; before, of WARP,
   the cuts that bound their blocks. */
ENVSAMP__HOT void envsamp__batch_put(float *batch, int i, envsamp__point p, float pdf)
{
    batch[i] = p.x;
    batch[ENVSAMP__BATCH + i] = p.north;
    batch[2 * ENVSAMP__BATCH + i] = p.south;
    batch[3 * ENVSAMP__BATCH + i] = pdf;
}

/* Directions and densities of the first `count` of a batch. A multiple of 16 is computed, so that
   compilers vectorise. */
static void envsamp__batch_out(uint32_t mapping, int count, const float *batch, float *x, float *y,
                               float *z, float *pdf)
{
    const float *north = batch + ENVSAMP__BATCH, *south = batch + 2 * ENVSAMP__BATCH;
    float turn[ENVSAMP__BATCH], sine[ENVSAMP__BATCH], dir[3][ENVSAMP__BATCH];
    size_t bytes = (size_t)count * sizeof(float);
    int n = (count + 15) & 0x70;

    for (int i = 0; i < n; i++) {
        turn[i] = envsamp__clamp_unit(batch[i]);
        sine[i] = ENVSAMP_FABSF(north[i] * south[i]);   /* below 0 by rounding with -ffast-math */
    }
    if (mapping == ENVSAMP_OCTAHEDRAL) {
        for (int i = 0; i < n; i++)
            envsamp__octahedral_dir(turn[i], north[i], &dir[0][i], &dir[1][i], &dir[2][i]);
    } else {
        envsamp__sqrt_n(sine, n);
        for (int i = 0; i < n; i++) {
            envsamp__point p = { turn[i], north[i], south[i] };

            envsamp__point_dir(p, sine[i], &dir[0][i], &dir[1][i], &dir[2][i]);
        }
    }
    ENVSAMP_MEMCPY(x, dir[0], bytes);
    ENVSAMP_MEMCPY(y, dir[1], bytes);
    ENVSAMP_MEMCPY(z, dir[2], bytes);
    ENVSAMP_MEMCPY(pdf, batch + 3 * ENVSAMP__BATCH, bytes);
}

/* ---- coordinates of density ---- */

/* The cut of a node at an edge: azimuth, 0..4, or minus the polar angle, 0..2. */
static float envsamp__node_cut(const envsamp__map *map, double at, int axis)
{
    float edge = envsamp__stored_edge(map, at, axis);
    double size = (double)ENVSAMP_FABSF(edge), rest = 2.0 - size, sine, cosine, q;

    if (map->image.mapping == ENVSAMP_OCTAHEDRAL)
        return axis ? -2.0f * edge : 4.0f * edge;
    if (axis == 0) {
        envsamp__sincos_pi(2.0 * size, &sine, &cosine);
        q = sine / (ENVSAMP__FABS(sine) + ENVSAMP__FABS(cosine));
        return (float)(size > 0.5 ? (size < 0.75 ? 2.0 - q : 4.0 + q)
                                  : (size < 0.25 ? q : 2.0 - q));
    }
    sine = ENVSAMP_SQRT(rest * size);
    q = sine / (sine + 0.5 * ENVSAMP__FABS(rest - size));
    return -(float)((envsamp__sign(edge) ? rest > size : size > rest) ? 2.0 - q : q);
}

/* The coordinates of nodes and grid, of an octahedral map 4 u and 2 v. Where `valid` is 0 they are
   some place. */
typedef struct envsamp__l1_coords { float azimuth, polar; int valid; } envsamp__l1_coords;

/* Whether a vector is a direction: r + |z| is above zero and finite. So is then |x| + |y|, but with
   -ffast-math r, a root by estimates, may be 0 for a NaN. */
ENVSAMP__HOT int envsamp__is_direction(float side, float sum)
{
#ifdef ENVSAMP__FINITE_ONLY
    int is_finite = envsamp__float_bits(side) < 0x7f800000u;

    return is_finite & (envsamp__float_bits(sum) - 1 < 0x7f7fffffu);
#else
    (void)side;
    return sum > 0.0f && sum <= FLT_MAX;
#endif
}

/* r is |(x, y)|. What is no direction gets 0, 0. */
ENVSAMP__HOT envsamp__l1_coords envsamp__to_l1_coords(float x, float y, float z, float r)
{
    float side = ENVSAMP_FABSF(x) + ENVSAMP_FABSF(y), sum = r + ENVSAMP_FABSF(z);
    envsamp__l1_coords d;

    /* with t = |y|/(|x|+|y|): t for x above 0, 2 - t for x below, and 4 less that for y below 0 */
    float t = side > 0.0f ? ENVSAMP_FABSF(y) / side : 0.0f;
    t = 2.0f - ENVSAMP_COPYSIGNF(1.0f + ENVSAMP_COPYSIGNF(1.0f, x) - ENVSAMP_COPYSIGNF(t, x), y);
    d.valid = envsamp__is_direction(side, sum);
    float q = 1.0f - ENVSAMP_COPYSIGNF(1.0f - r / (d.valid ? sum : 1.0f), z);
    d.azimuth = d.valid && side > 0.0f ? t : 0.0f;      /* at a pole whatever the signs of zeros */
    d.polar = d.valid ? q : 0.0f;
    return d;
}

/* Where a map ends in these coordinates. */
ENVSAMP__HOT float envsamp__polar_end(uint32_t mapping)
{
    return mapping == ENVSAMP_HEMISPHERE ? 1.0f : 2.0f;
}

/* A direction in the coordinates of a map. */
ENVSAMP__HOT envsamp__l1_coords envsamp__dir_to_grid(uint32_t mapping, float x, float y, float z,
                                                     float r)
{
    envsamp__l1_coords d;

    if (mapping != ENVSAMP_OCTAHEDRAL) {
        d = envsamp__to_l1_coords(x, y, z, r);
        if (mapping == ENVSAMP_HEMISPHERE)
            d.valid &= d.polar <= envsamp__polar_end(mapping);
        return d;
    }
    d.valid = envsamp__is_direction(ENVSAMP_FABSF(x) + ENVSAMP_FABSF(y), r + ENVSAMP_FABSF(z));
    envsamp__octahedral_uv(d.valid ? x + 0.0f : 0.0f, d.valid ? y + 0.0f : 0.0f, d.valid ? z : 1.0f,
                           d.valid ? r : 0.0f, &d.azimuth, &d.polar);
    d.azimuth *= 4.0f;
    d.polar *= 2.0f;
    return d;
}

/* ---- directions in double ---- */

/* A direction as edges are stored, in double: u, within 1e-12 and 1 just below the seam, and the
   polar angle by its nearer pole. */
typedef struct envsamp__exact { double x, cap; int south; } envsamp__exact;

ENVSAMP__MATH envsamp__exact envsamp__dir_exact(uint32_t mapping, const float dir[3])
{
    int octahedral = mapping == ENVSAMP_OCTAHEDRAL;
    double x = (double)dir[0], y = (double)dir[1], z = (double)dir[2], side = x * x + y * y;
    double length = ENVSAMP_SQRT(side + z * z), sine, cosine;
    double turn_x = octahedral ? ENVSAMP__FABS(x) : x, turn_y = octahedral ? ENVSAMP__FABS(y) : y;
    envsamp__exact e;

    e.cap = side / (length * (length + ENVSAMP__FABS(z)));
    e.south = z < 0.0;
    double turn = (double)envsamp__turn((float)turn_y, (float)turn_x);
    envsamp__sincos_pi(2.0 * turn, &sine, &cosine);     /* a float and one step of Newton's */
    if (side > 0.0)
        turn += (turn_y * cosine - turn_x * sine) / (ENVSAMP_SQRT(side) * 2.0 * ENVSAMP__PI);
    e.x = side > 0.0 ? envsamp__clamp(turn, 0.0, 1.0) : 0.0;
    if (!octahedral)
        return e;
    double r = ENVSAMP_SQRT(e.cap);    /* |2 u - 1| + |2 v - 1| above the equator */
    double b = 4.0 * e.x * r;
    e.x = e.south ? 1.0 - b : r - b;
    e.cap = e.south ? 1.0 - (r - b) : b;
    e.x = 0.5 * (x < 0.0 ? 1.0 - e.x : 1.0 + e.x);
    e.cap = 0.5 * (y < 0.0 ? 1.0 - e.cap : 1.0 + e.cap);
    e.south = 0;
    return e;
}

/* How far, in solid angle, a direction is from one stored edge to another. */
ENVSAMP__MATH double envsamp__exact_between(envsamp__exact e, float y0, float y1)
{
    double top = (double)ENVSAMP_FABSF(y0), end = (double)ENVSAMP_FABSF(y1);

    return envsamp__cap_between(top, envsamp__sign(y0), e.cap, e.south)
         / envsamp__cap_between(top, envsamp__sign(y0), end, envsamp__sign(y1));
}

/* ============================================================================================
 * IMPORTANCE                                                             [search: @importance]
 *
 * The map as the builders see it: cells of luminance, the solid angle of their rows, and a pyramid
 * over them. Cells are the texels, where radiance is constant, or, where it is looked up
 * bilinearly, the rectangles between texel centres and the map's border:
 *
 *            0 1/2     1 1/2     2 1/2   3       a map of 3 by 2 texels: 4 by 3 cells between
 *          0 +--+---------+---------+--+         5 by 4 knots. Knots at texel centres have the
 *        1/2 +--o---------o---------o--+         value of the texel, knots of the border the mean
 *            |  |         |         |  |         of the texels that meet there, across the seam,
 *      1 1/2 +--o---------o---------o--+         the pole or the fold of the octahedron. So
 *          2 +--+---------+---------+--+         radiance is bilinear in every cell.
 *
 * Cell (x, y) lies where x <= x_texel + offset <= x + 1, with an offset of 0 or 1/2: the units of
 * all rectangles and edges below.
 *
 * Level 0 of the pyramid is the cells, level 1 has 4x4 of them, each further level cells twice as
 * wide. Each holds mean and standard deviation in floats. Every sum over a block adds
 * positive numbers, in double: nothing cancels, unlike in differences of summed-area tables.
 * ========================================================================================== */

/* Begins to read: makes rows, and solid angles of the rows of every level. */
static void envsamp__map_begin(envsamp__map *map, envsamp_row_fn fn, void *user)
{
    map->fn = fn;
    map->user = user;
    ENVSAMP_MEMSET(map->knots + map->knot_count, 0, ENVSAMP__BEYOND * sizeof(float));
    for (int y = 0; y < map->height; y++)
        map->rows[y] = envsamp__slice_of_row(map, y, envsamp__cell_edge(map, y, 1),
                                            envsamp__cell_edge(map, y + 1, 1), 0);
    for (int k = 1; k < map->level_count; k++) {
        envsamp__level *level = &map->levels[k];
        size_t cells = (size_t)level->width * (size_t)level->height;

        for (int y = 0; y < level->height; y++)
            level->row_sr[y] = envsamp__rows_sr(map, envsamp__cell_edge(map, y << level->shift, 1),
                                                envsamp__cell_edge(map, (y + 1) << level->shift,
                                                                   1));
        ENVSAMP_MEMSET(level->mean + cells, 0, 4 * sizeof(float));
        ENVSAMP_MEMSET(level->deviation + cells, 0, 4 * sizeof(float));
    }
}

/* Reads a row ahead of the build, into the first line of knots. After the last one it puts
   compensation and exponent in force. Compensation [8] that would leave nothing or only rounding
   noise is off. */
static envsamp_result envsamp__survey_row(envsamp__map *map, int y)
{
    float *luminance = map->knots;
    envsamp_result result = envsamp__read_row(map, y, luminance);
    int folds = map->bilinear && map->image.mapping == ENVSAMP_OCTAHEDRAL;
    double whole_sr = (map->image.mapping == ENVSAMP_LATLONG ? 2.0 : 1.0)
                    * envsamp__unit_sr((uint32_t)map->image.mapping);

    if (result != ENVSAMP_OK)
        return result;
    map->full_integral += envsamp__sum_row(luminance, map->image.width, &map->brightest)
                        * envsamp__texel_sr(map, y);
    for (int i = 0; i < 2 && folds; i++)
        map->side[i][y] = luminance[i ? map->image.width - 1 : 0];
    if (y + 1 < map->image.height)
        return ENVSAMP_OK;
    float dim = (float)((double)map->desc.mis_compensation * map->full_integral / whole_sr);
    if ((double)map->brightest > 1.0001 * (double)dim) {
        map->compensation = map->desc.mis_compensation;
        map->dim = dim;
    }
    map->power = map->desc.importance_exponent != 1.0f ? map->desc.importance_exponent : 0.0f;
    return ENVSAMP_OK;
}

/* ---- sums over cells ---- */

/* The knots above row y of cells, or its texels. */
static inline const float *envsamp__line(const envsamp__map *map, int y)
{
    return map->knots + (size_t)y * map->stride;
}

/* Mean and variance of a cell between knots a above and c below it, or of a part of it: `down` and
   `tall` are mean and variance of the part along its height, `at` and `spread` along its width. The
   mean over the height, and the rise, are linear along u. */
static inline void envsamp__cell(float a0, float a1, float c0, float c1, float down, float tall,
                                 float at, float spread, float *mean, float *variance)
{
    float r0 = c0 - a0, r1 = c1 - a1, m0 = a0 + down * r0, m1 = a1 + down * r1, dm = m1 - m0;
    float dr = r1 - r0, rest = 1.0f - at, rise = rest * r0 + at * r1;

    *mean = rest * m0 + at * m1;
    *variance = spread * (dm * dm) + tall * (rise * rise + spread * (dr * dr));
}

/* Scaled means and variances of `count` cells between knots `a` and `c` above and below a row; they
   are whole along u if `at` is NULL. Where the map is not bilinear, a[x] is cell x. */
static inline void envsamp__cells(const envsamp__map *map, int count, const float *a,
                                  const float *c, float down, float tall, const float *at,
                                  const float *spread, float *mean, float *variance)
{
    float scale = map->scale;

    if (map->bilinear)
        for (int x = 0; x < count; x++)
            envsamp__cell(scale * a[x], scale * a[x + 1], scale * c[x], scale * c[x + 1], down,
                          tall, at ? at[x] : 0.5f, at ? spread[x] : 1.0f / 12.0f, &mean[x],
                          &variance[x]);
    else
        for (int x = 0; x < count; x++) {
            mean[x] = scale * a[x];
            variance[x] = 0.0f;
        }
}

#define ENVSAMP__SPLIT_CELLS ENVSAMP__TOP   /* read for one split; others: bench/experiments.md */

typedef struct envsamp__moments { double sum, square; } envsamp__moments;

/* Sums along one axis of a block, in bins. */
typedef struct envsamp__profile {
    double sum[ENVSAMP__SPLIT_CELLS + 4], square[ENVSAMP__SPLIT_CELLS + 4];
    double weight[ENVSAMP__SPLIT_CELLS + 4];    /* width of a column; solid angle of a row's slice
                                                   one cell of level 0 wide */
} envsamp__profile;

/* The value at a point. */
static double envsamp__value_at(const envsamp__map *map, double x, double y)
{
    const float *a = envsamp__line(map, (int)y) + (int)x, *c = a + map->stride;
    double left = envsamp__cell_edge(map, (int)x, 0), top = envsamp__cell_edge(map, (int)y, 1);

    if (!map->bilinear)
        return (double)a[0];
    double across = (x - left) / (envsamp__cell_edge(map, (int)x + 1, 0) - left);
    double down = (y - top) / (envsamp__cell_edge(map, (int)y + 1, 1) - top);
    double upper = (double)a[0] + across * ((double)a[1] - (double)a[0]);
    double lower = (double)c[0] + across * ((double)c[1] - (double)c[0]);
    return upper + down * (lower - upper);
}

/* ---- the pyramid ---- */

/* How many cells of level 0 wide column x of a level is: less at the border. */
static inline double envsamp__columns(const envsamp__map *map, const envsamp__level *level, int x)
{
    return envsamp__cell_edge(map, (x + 1) << level->shift, 0)
         - envsamp__cell_edge(map, x << level->shift, 0);
}

/* One row of level-1 cells, from sums in floats. Even cells keep none of the variance that rounding
   gives them, so that flat parts of a map are found to be flat. */
static void envsamp__cell_row(envsamp__map *map, int cell_y)
{
    envsamp__level *level = &map->levels[1];
    size_t cell = (size_t)cell_y * (size_t)level->width;
    int y0 = cell_y * 4, rows = envsamp__min(4, map->height - y0), b = map->bilinear;
    float weight[4];

    for (int y = 0; y < rows; y++)
        weight[y] = (float)(map->rows[y0 + y].sr / level->row_sr[cell_y]);
    for (int x0 = 0; x0 < map->width; x0 += 16) {
        float sum[16] = { 0.0f }, square[16] = { 0.0f }, peak[17] = { 0.0f };
        int count = envsamp__min(16, map->width - x0);

        for (int y = 0; y < rows; y++) {
            const envsamp__row_slice *slice = &map->rows[y0 + y];
            const float *a = envsamp__line(map, y0 + y) + x0;
            const float *c = envsamp__line(map, y0 + y + b) + x0;
            float mean[16], variance[16];

            envsamp__cells(map, 16, a, c, (float)slice->at, (float)slice->spread, NULL, NULL, mean,
                           variance);
            for (int i = 0; i < 16; i++) {
                peak[i] = a[i] > peak[i] ? a[i] : peak[i];
                peak[i] = c[i] > peak[i] ? c[i] : peak[i];
                sum[i] += weight[y] * mean[i];
                square[i] += weight[y] * (mean[i] * mean[i] + variance[i]);
            }
            peak[16] = a[16] > peak[16] ? a[16] : peak[16];
            peak[16] = c[16] > peak[16] ? c[16] : peak[16];
        }
        for (int x = 0; x < count; x += 4, cell++) {
            float *s = sum + x, *q = square + x, inverse = 0.25f, most = peak[x];

            if (x0 + x == 0 || x0 + x + 4 >= map->width) {
                inverse = (float)(1.0 / envsamp__columns(map, level, (x0 + x) / 4));
                for (int i = 0; i < 4; i++) {
                    float width = (float)envsamp__columns(map, &map->levels[0], x0 + x + i);

                    s[i] = width > 0.0f ? width * s[i] : 0.0f;
                    q[i] = width > 0.0f ? width * q[i] : 0.0f;
                }
            }
            float mean = inverse * ((s[0] + s[1]) + (s[2] + s[3]));
            float variance = inverse * ((q[0] + q[1]) + (q[2] + q[3])) - mean * mean;
            mean *= (float)map->unit;
            for (int i = 1; i < envsamp__min(4, count - x) + b; i++)
                most = peak[x + i] > most ? peak[x + i] : most;
            int even = mean > most * (1.0f - 5e-7f);
            map->highest[cell] = most;
            level->mean[cell] = even ? most : mean;
            level->deviation[cell] = even || variance < 0.0f ? 0.0f
                                   : (float)map->unit * ENVSAMP_SQRTF(variance);
        }
    }
}

/* One cell from the four below it; at the right and lower edge a part may be narrower, or not be
   there, and then weighs nothing. */
static void envsamp__merge_cells(const envsamp__map *map, int k, int x, int y)
{
    const envsamp__level *below = &map->levels[k - 1], *level = below + 1;
    size_t cell = (size_t)y * (size_t)level->width + (size_t)x;
    double weight = 0.0, sum = 0.0, square = 0.0;

    for (int i = 0; i < 4; i++) {
        int from_x = 2 * x + (i & 1), from_y = 2 * y + (i >> 1);
        size_t from = (size_t)from_y * (size_t)below->width + (size_t)from_x;

        if (from_x >= below->width || from_y >= below->height)
            continue;
        double sr = below->row_sr[from_y] * envsamp__columns(map, below, from_x);
        double mean = (double)below->mean[from], deviation = (double)below->deviation[from];
        weight += sr;
        sum += sr * mean;
        square += sr * (mean * mean + deviation * deviation);
    }
    sum /= weight;
    level->mean[cell] = (float)sum;
    level->deviation[cell] = (float)ENVSAMP_SQRT(envsamp__max(square / weight - sum * sum, 0.0));
}

/* Adds the light of a row of texels. The scale of floats that are squared makes the maximum of what
   was read about 2^60, so that squares neither overflow nor, of what counts beside it, vanish. */
static void envsamp__add_row(envsamp__map *map, int y, envsamp__texel_row *row)
{
    map->peak = row->peak > map->peak ? row->peak : map->peak;
    map->integral += row->sum * envsamp__texel_sr(map, y);
    uint32_t exponent = 314 - (envsamp__float_bits(map->peak) >> 23);
    map->scale = row->scale = envsamp__bits_float((exponent < 227 ? exponent : 227) << 23);
    map->unit = 1.0 / (double)map->scale;
}

/* Reads a row of texels, adds its light, and completes its line of knots, and with the first and
   the last row those of the borders beside it. `row` gets what was read. */
static envsamp_result envsamp__map_line(envsamp__map *map, int y, float *line,
                                        envsamp__texel_row *row)
{
    float *luminance = line + map->bilinear;
    size_t bad = y > 0 ? map->bad_pixel_count : 0;
    envsamp_result result = envsamp__read_row(map, y, luminance);

    if (result != ENVSAMP_OK)
        return result;
    row->peak = y > 0 ? 0.0f : map->brightest;      /* a fold mixes rows */
    row->sum = envsamp__sum_row(luminance, map->image.width, &row->peak);
    row->bad = map->bad_pixel_count - bad;
    envsamp__add_row(map, y, row);
    if (map->bilinear) {    /* knots on the seam, or between a texel and that of the mirrored row */
        int width = map->image.width, height = map->image.height;
        float fold[2] = { line[width], line[1] };

        if (map->image.mapping == ENVSAMP_OCTAHEDRAL) {
            fold[0] = map->side[0][height - 1 - y];
            fold[1] = map->side[1][height - 1 - y];
            envsamp__make_importance(map, fold, 2);
        }
        line[0] = envsamp__half(line[1]) + envsamp__half(fold[0]);
        line[width + 1] = envsamp__half(line[width]) + envsamp__half(fold[1]);
        if (y == 0)
            envsamp__border_line(map, -1, line, fold, line - map->stride);
        if (y + 1 == height)
            envsamp__border_line(map, height, line, fold, line + map->stride);
    }
    return ENVSAMP_OK;
}

/* Whether a row of cells of a level is to be made again. */
static int envsamp__is_stale(const envsamp__map *map, int k, int y)
{
    int shift = map->levels[k].shift;

    return (y + 1) << shift > map->cells_from && y << shift < map->cells_to;
}

/* Reads a row of texels, or, in a rebuild, takes what was read of it before, and makes the cells of
   level 1 that are complete with it. With another scale cells differ in what underflows. */
static envsamp_result envsamp__map_row(envsamp__map *map, int y)
{
    int last = y + 1 == map->image.height, rows = last ? map->height : y + 1, cell_y = y / 4;
    float *line = map->knots + (size_t)(y + map->bilinear) * map->stride;
    envsamp__texel_row *row = &map->texel_rows[y];
    envsamp_result result = ENVSAMP_OK;

    if (y >= map->read_from && y < map->read_to) {
        result = envsamp__map_line(map, y, line, row);
    } else {
        float scale = row->scale;

        map->bad_pixel_count += row->bad;
        envsamp__add_row(map, y, row);
        if (row->scale != scale) {
            map->cells_from = envsamp__min(map->cells_from, y);
            map->cells_to = map->height;
        }
        result = map->desc.strict && map->bad_pixel_count ? ENVSAMP_ERR_VALUE : ENVSAMP_OK;
    }
    if (result != ENVSAMP_OK)
        return result;
    for (; cell_y * 4 < rows && (cell_y * 4 + 4 <= rows || last); cell_y++)
        if (envsamp__is_stale(map, 1, cell_y))
            envsamp__cell_row(map, cell_y);
    map->whole = last ? ENVSAMP__WHOLE : 0;
    return ENVSAMP_OK;
}

/* With `lines` 0 there is memory for all knots and the pyramid, else for `lines` lines of knots.
   The coarsest level has ENVSAMP__TOP cells at most. */
static void envsamp__map_carve(envsamp__map *map, const envsamp_image *image,
                               const envsamp_kd_desc *desc, uint64_t lines, envsamp__arena *arena)
{
    int bilinear = !desc->nearest;
    int folds = bilinear && image->mapping == ENVSAMP_OCTAHEDRAL ? image->height : 0;
    double offset = bilinear ? 0.5 : 0.0;
    int k = 0;

    map->image = *image;
    map->desc = *desc;
    map->row = ENVSAMP__TAKE(float, arena, (uint64_t)image->width * (uint64_t)image->channels);
    map->side[0] = ENVSAMP__TAKE(float, arena, folds);
    map->side[1] = ENVSAMP__TAKE(float, arena, folds);
    map->bilinear = bilinear;
    map->bounds.x0 = map->bounds.y0 = offset;
    map->bounds.x1 = (double)image->width + offset;
    map->bounds.y1 = (double)image->height + offset;
    map->width = image->width + bilinear;
    map->height = image->height + bilinear;
    map->stride = (size_t)(map->width + bilinear);
    map->rows = ENVSAMP__TAKE(envsamp__row_slice, arena, map->height);
    map->texel_rows = ENVSAMP__TAKE(envsamp__texel_row, arena, lines ? 0 : map->image.height);
    for (map->level_count = 0; !lines; k++) {
        envsamp__level *level = &map->levels[k];

        level->shift = k ? k + 1 : 0;
        level->width = (map->width + (1 << level->shift) - 1) >> level->shift;
        level->height = (map->height + (1 << level->shift) - 1) >> level->shift;
        level->row_sr = k ? ENVSAMP__TAKE(double, arena, level->height) : NULL;
        uint64_t cells = k ? (uint64_t)level->width * (uint64_t)level->height : 0;
        level->mean = ENVSAMP__TAKE(float, arena, cells + 4);
        level->deviation = ENVSAMP__TAKE(float, arena, cells + 4);
        map->highest = k == 1 ? ENVSAMP__TAKE(float, arena, cells) : map->highest;
        map->level_count = k + 1;
        if (k > 0 && (int64_t)level->width * level->height <= ENVSAMP__TOP)
            break;
    }
    lines = lines ? lines : (uint64_t)map->height + (uint64_t)bilinear;
    map->knot_count = (size_t)lines * map->stride;
    map->knots = ENVSAMP__TAKE(float, arena, lines * map->stride + ENVSAMP__BEYOND);
}

/* ============================================================================================
 * KD BUILD                                                                 [search: @kd-build]
 *
 * The phases of a build, each in steps of its own:
 *
 *     rows, levels    reads the map into cells, and makes the pyramid over them (@importance)
 *     crown           WARP: halves the light again and again, down to the tiles (@kd-crown)
 *     tiles           searches the best split of every tile; all but WARP have one, the map
 *     splits          best first [1, algorithms 1-3]: makes the split that gains most, and
 *                     searches the splits of the two parts when they come to the top of the heap
 *     moments         sums blocks again whose sums were approximate
 *
 * A split is searched in sums by column and by row, read at the finest level at which the block has
 * at most ENVSAMP__SPLIT_CELLS cells. In a bilinear map that may be below 0, of fractions of cells:
 * lamps of a few texels need blocks within cells. The light of a cell of a coarse level that the
 * block cuts is taken for even until all blocks stand.
 * ========================================================================================== */

#define ENVSAMP__CUT_CELLS 512      /* most that are read at level 0 where coarser cells are cut */
#define ENVSAMP__FLAT 1e-12         /* relative: below it a block is flat */
#define ENVSAMP__GAIN_FLOOR 0.15    /* of its bound: least priority of a searched block, since two
                                       cuts may gain what one cannot */
#define ENVSAMP__WARP_DEPTH 32      /* cuts below a tile, one inside the other */
#define ENVSAMP__FINE_BITS 6        /* bilinear: the finest cells are 2^-6 of those of level 0 */

/* ---- a heap ---- */

/* The entry of the largest key comes first. Each has four children. */
typedef struct envsamp__heap_entry { double key; uint32_t item; int searched; }
    envsamp__heap_entry;
typedef struct envsamp__heap { envsamp__heap_entry *entries; int count; } envsamp__heap;

/* Moves the first entry, whose key may have fallen, down to its place. */
static void envsamp__heap_settle(envsamp__heap *heap)
{
    envsamp__heap_entry *entries = heap->entries, entry = entries[0];
    int hole = 0, child = 1;

    while (child < heap->count) {
        int last = envsamp__min(child + 4, heap->count), best = child;

        for (child++; child < last; child++)
            best = entries[child].key > entries[best].key ? child : best;
        if (entries[best].key <= entry.key)
            break;
        entries[hole] = entries[best];
        hole = best;
        child = 4 * hole + 1;
    }
    entries[hole] = entry;
}

static void envsamp__heap_push(envsamp__heap *heap, double key, uint32_t item, int searched)
{
    const envsamp__heap_entry entry = { key, item, searched };
    int hole = heap->count++;

    for (; hole > 0 && heap->entries[(hole - 1) / 4].key < key; hole = (hole - 1) / 4)
        heap->entries[hole] = heap->entries[(hole - 1) / 4];
    heap->entries[hole] = entry;
}

/* ---- the tree ---- */

typedef struct envsamp__block {
    envsamp__rect rect;
    double column_sr;                   /* solid angle of a column one cell wide */
    envsamp__moments whole, low, high;  /* of the block; of the two parts of its best split */
    double at;                          /* best split: the column or row of cells */
    double weight;                      /* what it is drawn by */
    uint32_t slot;                      /* 2 x cut + side of the link to it; ENVSAMP__LEAF: root */
    unsigned short depth;               /* cuts above it, those of the crown not counted: WARP */
    signed char axis;                   /* of the best split: 0 at a column, 1 at a row; -1 none */
    unsigned char rough;                /* whether the moments are approximate */
} envsamp__block;

/* An inner node: cuts at column (axis 0) or row (axis 1) `at`. A child is a node's index, or
   ENVSAMP__LEAF and a block's. Children come after their parents. */
#define ENVSAMP__LEAF 0x80000000u
typedef struct envsamp__cut { double at; int axis; uint32_t child[2]; } envsamp__cut;

typedef struct envsamp__tree {
    const envsamp__map *map;
    envsamp__block *blocks;
    envsamp__cut *cuts;
    envsamp__heap heap;
    envsamp__profile *columns, *rows;
    int block_count;
    double q, q_wanted;                 /* sum of Q of all blocks; splitting stops below */
    uint32_t root;                      /* as a child of a cut */
    int tile_bits;                      /* the first 2^tile_bits blocks were the tiles */
    int crown_at;                       /* the block of the crown to be halved next; -1 none */
    int alternate;                      /* nonzero: half of its cuts are at columns */
} envsamp__tree;

static inline double envsamp__block_sr(const envsamp__block *b)
{
    return b->column_sr * (b->rect.x1 - b->rect.x0);
}

/* Root mean square of the block times its solid angle: what the best block probabilities are
   proportional to, and of which the excess variance is (sum Q)^2 / I^2 - 1. */
ENVSAMP__COLD double envsamp__whole_q(const envsamp__block *b)
{
    return ENVSAMP_SQRT(envsamp__block_sr(b) * b->whole.square);
}

/* ---- sums over a rectangle ---- */

/* Cells of a level: columns x0 to x1 of rows y0 to y1, the ends not included. */
typedef struct envsamp__window { int x0, y0, x1, y1; } envsamp__window;

/* Width of a cell of level k; those of level -k < 0 are 2^-k of a cell of level 0. */
static double envsamp__cell_size(const envsamp__map *map, int k)
{
    return k < 0 ? 1.0 / (double)(1 << -k) : (double)(1 << map->levels[k].shift);
}

/* The cells of level k that a rectangle touches, or only those that lie `within` it. */
static envsamp__window envsamp__touched(const envsamp__map *map, int k, const envsamp__rect *rect,
                                        int within)
{
    double size = envsamp__cell_size(map, k), scale = 1.0 / size;
    envsamp__window w = { (int)(rect->x0 * scale), (int)(rect->y0 * scale),
                          (int)(rect->x1 * scale), (int)(rect->y1 * scale) };

    if (within) {
        w.x0 += (double)w.x0 * size < rect->x0 && rect->x0 > map->bounds.x0;
        w.y0 += (double)w.y0 * size < rect->y0 && rect->y0 > map->bounds.y0;
    }
    if (!within || rect->x1 >= map->bounds.x1)
        w.x1 += (double)w.x1 * size < rect->x1;
    if (!within || rect->y1 >= map->bounds.y1)
        w.y1 += (double)w.y1 * size < rect->y1;
    return w;
}

/* The slice of row y of level k that lies in a rectangle; above level 0 only its solid angle. */
static envsamp__row_slice envsamp__level_row(const envsamp__map *map, int k, int y,
                                             const envsamp__rect *rect)
{
    double size = envsamp__cell_size(map, k);
    double top = envsamp__max((double)y * size, rect->y0);
    double end = envsamp__min_double((double)(y + 1) * size, rect->y1);
    envsamp__row_slice slice = { 0.0, 0.0, 0.0 };

    if (k == 0 && top <= envsamp__cell_edge(map, y, 1) && end >= envsamp__cell_edge(map, y + 1, 1))
        return map->rows[y];
    if (k <= 0)
        return envsamp__slice_of_row(map, y >> -k, top, end, k < 0);
    slice.sr = end - top < size ? envsamp__rows_sr(map, top, end) : map->levels[k].row_sr[y];
    return slice;
}

/* What sums are added to. Either profile may be NULL; they begin at column x0 and row y0. */
typedef struct envsamp__sums {
    envsamp__profile *columns, *rows;
    int x0, y0;
    envsamp__moments total;
} envsamp__sums;

/* Some columns of cells of a level. Of those of a level k <= 0 that are cut, and of all below level
   0: the column of level 0, and mean and variance of the part of it along u. */
typedef struct envsamp__strip {
    int k, x0, count, column[ENVSAMP__CHUNK + 4];
    float at[ENVSAMP__CHUNK + 4], spread[ENVSAMP__CHUNK + 4];
    double width[ENVSAMP__CHUNK + 4];   /* 0 beyond the last */
} envsamp__strip;

static void envsamp__strip_begin(const envsamp__map *map, int k, int x0, int count,
                                 const envsamp__rect *rect, envsamp__strip *strip)
{
    double size = envsamp__cell_size(map, k);

    strip->k = k;
    strip->x0 = x0;
    strip->count = count;
    for (int i = 0; i < ((count + 3) & ~3); i++) {
        double low = envsamp__max((double)(x0 + i) * size, rect->x0);
        double high = envsamp__min_double((double)(x0 + i + 1) * size, rect->x1);

        strip->width[i] = i < count ? high - low : 0.0;
        strip->column[i] = i < count ? (int)low : 0;
        strip->at[i] = 0.5f;
        strip->spread[i] = 1.0f / 12.0f;
        if (k > 0 || i >= count || high - low >= 1.0)
            continue;
        double from = envsamp__cell_edge(map, strip->column[i], 0);
        double gap = envsamp__cell_edge(map, strip->column[i] + 1, 0) - from;
        strip->at[i] = (float)((0.5 * (low + high) - from) / gap);
        strip->spread[i] = (float)((high - low) / gap * (high - low) / gap / 12.0);
    }
}

/* Scaled means and variances of four cells of row y of a strip, the first its column i. */
static inline void envsamp__strip_cells(const envsamp__map *map, const envsamp__strip *strip, int y,
                                        int i, float down, float tall, float *mean,
                                        float *variance)
{
    const envsamp__level *level = &map->levels[strip->k > 0 ? strip->k : 0];
    size_t at = (size_t)y * (size_t)level->width + (size_t)(strip->x0 + i);
    const float *a = envsamp__line(map, strip->k < 0 ? y >> -strip->k : y);
    const float *c = a + (map->bilinear ? map->stride : 0);
    float scale = map->scale;

    if (strip->k == 0) {
        envsamp__cells(map, 4, a + strip->x0 + i, c + strip->x0 + i, down, tall, strip->at + i,
                       strip->spread + i, mean, variance);
    } else if (strip->k > 0) {
        for (int x = 0; x < 4; x++)
            mean[x] = scale * level->mean[at + (size_t)x];
        for (int x = 0; x < 4; x++)
            variance[x] = scale * level->deviation[at + (size_t)x];
        for (int x = 0; x < 4; x++)
            variance[x] *= variance[x];
    } else {
        for (int x = i; x < i + 4; x++, mean++, variance++) {
            const float *above = a + strip->column[x], *below = c + strip->column[x];

            envsamp__cell(scale * above[0], scale * above[1], scale * below[0], scale * below[1],
                          down, tall, strip->at[x], strip->spread[x], mean, variance);
        }
    }
}

/* The moments of what of row y of a strip lies in `slice`, which are also added at bin `bin` and on
   of the columns, if they count. */
static envsamp__moments envsamp__strip_row(const envsamp__map *map, const envsamp__strip *strip,
                                           int y, const envsamp__row_slice *slice,
                                           envsamp__profile *columns, int bin)
{
    double scaled = slice->sr * map->unit, unit = map->unit, sum[4] = { 0.0 }, square[4] = { 0.0 };
    float down = (float)slice->at, tall = (float)slice->spread;
    envsamp__moments row;

    for (int i = 0; i < strip->count; i += 4) {
        float mean[4], variance[4];
        double m[4], v[4];

        envsamp__strip_cells(map, strip, y, i, down, tall, mean, variance);
        for (int x = 0; x < 4; x++) {
            double weight = scaled * strip->width[i + x];

            m[x] = (double)mean[x];
            v[x] = unit * weight * (m[x] * m[x] + (double)variance[x]);
            m[x] *= weight;
            sum[x] += m[x];
            square[x] += v[x];
        }
        if (columns) {
            double *s = columns->sum + bin + i, *q = columns->square + bin + i;

            for (int x = 0; x < 4; x++)
                s[x] += m[x];
            for (int x = 0; x < 4; x++)
                q[x] += v[x];
        }
    }
    row.sum = (sum[0] + sum[1]) + (sum[2] + sum[3]);
    row.square = (square[0] + square[1]) + (square[2] + square[3]);
    return row;
}

/* Adds what of a window of cells of level k lies in a rectangle. */
static void envsamp__add_cells(const envsamp__map *map, int k, const envsamp__window *w,
                               const envsamp__rect *rect, envsamp__sums *sums)
{
    envsamp__strip strip;

    for (int x = w->x0; x < w->x1; x += ENVSAMP__CHUNK) {
        envsamp__strip_begin(map, k, x, envsamp__min(ENVSAMP__CHUNK, w->x1 - x), rect, &strip);
        if (sums->columns)
            ENVSAMP_MEMCPY(sums->columns->weight + (x - sums->x0), strip.width,
                           (size_t)strip.count * sizeof *strip.width);
        for (int y = w->y0; y < w->y1; y++) {
            envsamp__row_slice slice = k == 0 && y > w->y0 && y + 1 < w->y1
                                     ? map->rows[y] : envsamp__level_row(map, k, y, rect);
            envsamp__moments row = envsamp__strip_row(map, &strip, y, &slice, sums->columns,
                                                      x - sums->x0);

            sums->total.sum += row.sum;
            sums->total.square += row.square;
            if (sums->rows) {
                sums->rows->sum[y - sums->y0] += row.sum;
                sums->rows->square[y - sums->y0] += row.square;
                sums->rows->weight[y - sums->y0] = slice.sr;
            }
        }
    }
}

/* Moments of a rectangle: of cells as coarse as lie in it, and along its edges of parts of cells of
   level 0. */
static envsamp__moments envsamp__rect_moments(const envsamp__map *map, const envsamp__rect *rect)
{
    envsamp__window done = { 0, 0, 0, 0 };      /* in cells of level 0 */
    envsamp__sums sums = { NULL, NULL, 0, 0, { 0.0, 0.0 } };

    for (int k = map->level_count - 1; k >= 0; k--) {
        int shift = map->levels[k].shift;
        envsamp__window w = envsamp__touched(map, k, rect, k > 0), in = w;

        if (w.x0 >= w.x1 || w.y0 >= w.y1)
            continue;
        in.x1 = w.x0;                   /* what is done of it: nothing, or */
        in.y1 = w.y0;
        if (done.x0 < done.x1) {
            in.x0 = done.x0 >> shift;
            in.y0 = done.y0 >> shift;
            in.x1 = envsamp__min(done.x1 >> shift, w.x1);
            in.y1 = envsamp__min(done.y1 >> shift, w.y1);
        }
        for (int i = 0; i < 4; i++) {        /* above, left and right of it, and below */
            const envsamp__window rest = {
                i == 2 ? in.x1 : w.x0, i == 0 ? w.y0 : i < 3 ? in.y0 : in.y1,
                i == 1 ? in.x0 : w.x1, i == 0 ? in.y0 : i < 3 ? in.y1 : w.y1
            };

            if (rest.x0 < rest.x1 && rest.y0 < rest.y1)
                envsamp__add_cells(map, k, &rest, rect, &sums);
        }
        done.x0 = w.x0 << shift;
        done.y0 = w.y0 << shift;
        done.x1 = w.x1 << shift;
        done.y1 = w.y1 << shift;
    }
    return sums.total;
}

/* The maximum in a rectangle, at knots and where its edges lie between them, but no less than
   `least`. */
static double envsamp__rect_peak(const envsamp__map *map, const envsamp__rect *rect, double least)
{
    envsamp__window w = envsamp__touched(map, 0, rect, 0);

    for (int cell_y = w.y0 / 4; 4 * cell_y < w.y1; cell_y++)
        for (int cell_x = w.x0 / 4; 4 * cell_x < w.x1; cell_x++) {
            int end_x = envsamp__min(4 * cell_x + 4, w.x1) + map->bilinear;
            int end_y = envsamp__min(4 * cell_y + 4, w.y1) + map->bilinear;

            if ((double)map->highest[(size_t)cell_y * (size_t)map->levels[1].width
                                     + (size_t)cell_x] <= least)
                continue;
            for (int y = envsamp__max_int(4 * cell_y, w.y0); y < end_y; y++)
                for (int x = envsamp__max_int(4 * cell_x, w.x0); x < end_x; x++) {
                    double at_x = envsamp__clamp((double)x, rect->x0, rect->x1);
                    double at_y = envsamp__clamp((double)y, rect->y0, rect->y1);

                    least = envsamp__max(least, envsamp__value_at(map, at_x, at_y));
                }
        }
    return least;
}

/* Sums of the cells of level k in a rectangle by column and by row, and of all. Either profile may
   be NULL, and what is not has ENVSAMP__SPLIT_CELLS bins at most. Of a cell above level 0 that is
   cut, a part counts in proportion to its solid angle. */
static envsamp__moments envsamp__profile_rect(const envsamp__map *map, int k,
                                              const envsamp__rect *rect,
                                              envsamp__profile *columns, envsamp__profile *rows)
{
    const envsamp__window w = envsamp__touched(map, k, rect, 0);
    envsamp__sums sums = { columns, rows, w.x0, w.y0, { 0.0, 0.0 } };

    for (int i = 0; columns && i < ((w.x1 - w.x0 + 3) & ~3); i++)
        columns->sum[i] = columns->square[i] = 0.0;
    for (int i = 0; rows && i < w.y1 - w.y0; i++)
        rows->sum[i] = rows->square[i] = 0.0;
    envsamp__add_cells(map, k, &w, rect, &sums);
    return sums.total;
}

/* Corrects such sums by column, or along axis 1 by row, for the cut cells that may make them wrong
   by more than `least`. */
static void envsamp__correct_profile(const envsamp__map *map, int k, const envsamp__rect *rect,
                                     double least, int axis, envsamp__profile *profile)
{
    const envsamp__window w = envsamp__touched(map, k, rect, 0);
    const envsamp__window inner = envsamp__touched(map, k, rect, 1);
    const envsamp__level *level = &map->levels[k];
    double size = envsamp__cell_size(map, k);

    for (int y = w.y0; y < w.y1; y++)
        for (int x = w.x0; x < w.x1; x++) {
            size_t cell = (size_t)y * (size_t)level->width + (size_t)x;
            double mean = (double)level->mean[cell], deviation = (double)level->deviation[cell];
            int bin = axis ? y - w.y0 : x - w.x0;
            envsamp__rect r;

            if ((x >= inner.x0 && x < inner.x1 && y >= inner.y0 && y < inner.y1)
                || level->row_sr[y] * size * deviation <= least)
                continue;
            r.x0 = envsamp__max((double)x * size, rect->x0);
            r.y0 = envsamp__max((double)y * size, rect->y0);
            r.x1 = envsamp__min_double((double)(x + 1) * size, rect->x1);
            r.y1 = envsamp__min_double((double)(y + 1) * size, rect->y1);
            envsamp__moments m = envsamp__rect_moments(map, &r);
            double sr = envsamp__rows_sr(map, r.y0, r.y1) * (r.x1 - r.x0);
            profile->sum[bin] += m.sum - sr * mean;
            profile->square[bin] += m.square - sr * (mean * mean + deviation * deviation);
        }
}

static envsamp__moments envsamp__profile_moments(const envsamp__profile *p, int from, int to)
{
    envsamp__moments m = { 0.0, 0.0 };

    for (int i = from; i < to; i++) {
        m.sum += p->sum[i];
        m.square += p->square[i];
    }
    return m;
}

/* ---- searching splits ---- */

/* The priority of a block whose split was not yet searched. For EXCESS a bound: no split gains more
   than what the block's own variance costs. */
static double envsamp__priority(const envsamp__map *map, const envsamp__block *b)
{
    double sr = envsamp__block_sr(b), q = envsamp__whole_q(b);
    double sse = b->whole.square - b->whole.sum * b->whole.sum / sr;
    float low = FLT_MAX, high = 0.0f;

    sse = sse > ENVSAMP__FLAT * b->whole.square ? sse : 0.0;
    if (map->desc.select == ENVSAMP_KD_WARP && b->depth >= ENVSAMP__WARP_DEPTH)
        return 0.0;
    switch (map->desc.criterion) {
    case ENVSAMP_KD_SSE: return sse;    /* [1, equation 2], weighted by solid angle */
    case ENVSAMP_KD_VARIANCE: return sse / sr;
    case ENVSAMP_KD_RANGE:
        for (int y = (int)b->rect.y0; (double)(y - map->bilinear) < b->rect.y1; y++)
            for (int x = (int)b->rect.x0; (double)(x - map->bilinear) < b->rect.x1; x++) {
                float knot = envsamp__line(map, y)[x];

                low = knot < low ? knot : low;
                high = knot > high ? knot : high;
            }
        return (double)high - (double)low;
    default: return q - b->whole.sum > ENVSAMP__FLAT * q ? q - b->whole.sum : 0.0;
    }
}

/* The level at which a block's split is searched; says whether sums there are approximate. */
static int envsamp__split_level(const envsamp__map *map, envsamp__block *b)
{
    envsamp__window fine = envsamp__touched(map, 0, &b->rect, 0), w, within;
    int width = fine.x1 - fine.x0, height = fine.y1 - fine.y0;
    int k = (int64_t)width * height > ENVSAMP__SPLIT_CELLS ? 1
          : -ENVSAMP__FINE_BITS * map->bilinear;

    for (;; k++) {
        w = envsamp__touched(map, k, &b->rect, 0);
        if (k + 1 == map->level_count
            || (int64_t)(w.x1 - w.x0) * (w.y1 - w.y0) <= ENVSAMP__SPLIT_CELLS)
            break;
    }
    within = envsamp__touched(map, k > 0 ? k : 0, &b->rect, 1);
    b->rough = k < 0 || (k > 0 && ENVSAMP_MEMCMP(&within, &w, sizeof w));
    if (k > 0 && b->rough && envsamp__max_int(width, height) <= ENVSAMP__SPLIT_CELLS
        && (int64_t)width * height <= ENVSAMP__CUT_CELLS)
        k = b->rough = 0;
    return k;
}

/* The best place to cut along one axis. */
typedef struct envsamp__search { double best; int axis, at; } envsamp__search;

/* Tries every cut along one axis and keeps the best. A part of solid angle A, sum S and square
   sum T counts S^2/A, the squares its mean explains [1, equation 3], or, for EXCESS, costs
   sqrt(A T): the sum of two such roots is compared by its square, which needs one root. */
static void envsamp__try_cuts(const envsamp__profile *p, int count, double cross, double sr,
                              const envsamp__moments *whole, int excess, int axis,
                              envsamp__search *search)
{
    double sum = 0.0, square = 0.0, weight = 0.0;

    for (int i = 0; i + 1 < count; i++) {
        double value;

        sum += p->sum[i];
        square += p->square[i];
        weight += p->weight[i];
        double low_sr = weight * cross;
        double high_sr = sr - low_sr;
        if (excess) {
            double low = low_sr * square, high = high_sr * (whole->square - square);

            high = high > 0.0 ? high : 0.0;
            value = -(low + high);
            if (value > search->best)       /* else the root only makes it worse */
                value -= 2.0 * ENVSAMP_SQRT(low * high);
        } else {
            double rest = whole->sum - sum;

            value = (sum * sum * high_sr + rest * rest * low_sr) / (low_sr * high_sr);
        }
        if (value > search->best) {
            search->best = value;
            search->axis = axis;
            search->at = i + 1;
        }
    }
}

/* Finds the block's best split and the moments of both parts. Returns its priority from then on, 0
   where nothing can be cut. Where no cut gains anything yet the block is not flat (a checkerboard),
   cuts it in the middle of its longer side, so that its parts may. */
static double envsamp__search_block(envsamp__tree *tree, envsamp__block *b)
{
    const envsamp__map *map = tree->map;
    int k = envsamp__split_level(map, b), excess = map->desc.criterion == ENVSAMP_KD_EXCESS;
    envsamp__window w = envsamp__touched(map, k, &b->rect, 0);
    int width = w.x1 - w.x0, height = w.y1 - w.y0;
    double columns = b->rect.x1 - b->rect.x0, sr = envsamp__block_sr(b);
    envsamp__search search = { -DBL_MAX, -1, 0 };

    envsamp__moments whole = envsamp__profile_rect(map, k, &b->rect, tree->columns, tree->rows);
    envsamp__try_cuts(tree->columns, width, b->column_sr, sr, &whole, excess, 0, &search);
    envsamp__try_cuts(tree->rows, height, columns, sr, &whole, excess, 1, &search);
    b->whole = whole;
    b->axis = (signed char)search.axis;
    if (search.axis < 0)
        return 0.0;
    double gain = excess ? envsamp__whole_q(b) - ENVSAMP_SQRT(-search.best)
                         : search.best - whole.sum * whole.sum / sr;
    if (gain <= ENVSAMP__FLAT * (excess ? whole.sum : search.best)) {
        gain = 0.0;
        search.axis = width < height;
        b->axis = (signed char)search.axis;
        search.at = (search.axis ? height : width) / 2;
    }
    const envsamp__profile *profile = search.axis ? tree->rows : tree->columns;
    b->low = envsamp__profile_moments(profile, 0, search.at);
    b->high = envsamp__profile_moments(profile, search.at, search.axis ? height : width);
    b->at = (double)((search.axis ? w.y0 : w.x0) + search.at) * envsamp__cell_size(map, k);
    if (k < 0 && !envsamp__store_cut(map, &b->rect, b->axis, &b->at))
        b->axis = -1;
    double bound = envsamp__priority(map, b);
    return b->axis < 0 ? 0.0 : excess ? envsamp__max(gain, ENVSAMP__GAIN_FLOOR * bound) : bound;
}

/* One step of the splitting: searches the split of the block at the top of the heap, or makes it.
   The heap holds every block once; one whose split was not yet searched has a bound as its
   priority. Returns 0 when `wanted` blocks stand or all are flat. */
static int envsamp__split_step(envsamp__tree *tree, int wanted)
{
    envsamp__heap_entry *top = &tree->heap.entries[0];
    uint32_t number = (uint32_t)tree->block_count;
    envsamp__block *b = &tree->blocks[top->item], *high = &tree->blocks[number];
    envsamp__cut *cut = &tree->cuts[number - 1];

    if (tree->block_count >= wanted || !(top->key > 0.0) || tree->q <= tree->q_wanted)
        return 0;
    if (!top->searched) {
        tree->q -= envsamp__whole_q(b);
        top->key = envsamp__search_block(tree, b);
        tree->q += envsamp__whole_q(b);
        top->searched = 1;
        envsamp__heap_settle(&tree->heap);
        return 1;
    }
    cut->axis = b->axis;                /* the low part takes the place of the block */
    cut->at = b->at;
    cut->child[0] = ENVSAMP__LEAF | top->item;
    cut->child[1] = ENVSAMP__LEAF | number;
    *(b->slot == ENVSAMP__LEAF ? &tree->root : &tree->cuts[b->slot >> 1].child[b->slot & 1])
        = number - 1;
    b->slot = (number - 1) * 2;
    b->depth++;
    tree->q -= envsamp__whole_q(b);
    *high = *b;
    high->slot++;
    high->whole = b->high;
    b->whole = b->low;
    if (b->axis == 0) {
        b->rect.x1 = high->rect.x0 = b->at;
    } else {
        b->rect.y1 = high->rect.y0 = b->at;
        b->column_sr = envsamp__rows_sr(tree->map, b->rect.y0, b->rect.y1);
        high->column_sr = envsamp__rows_sr(tree->map, high->rect.y0, high->rect.y1);
    }
    tree->q += envsamp__whole_q(b) + envsamp__whole_q(high);
    top->key = envsamp__priority(tree->map, b);
    top->searched = 0;
    envsamp__heap_settle(&tree->heap);
    envsamp__heap_push(&tree->heap, envsamp__priority(tree->map, high), number, 0);
    tree->block_count++;
    return 1;
}

/* ============================================================================================
 * KD CROWN                                                                 [search: @kd-crown]
 *
 * WARP's tree begins with tile_bits levels of cuts that halve the light, within a few percent,
 * across azimuth and polar angle in turns, but a long map first shorter, through texels where need
 * be. The 2^tile_bits tiles that they make are drawn equally often, their images in the unit square
 * form a regular grid, and the leading bits of u0 and u1 name the tile. Each is then split like a
 * map of its own. bench/experiments.md has other crowns.
 * ========================================================================================== */

#define ENVSAMP__BLOCKS_PER_TILE 3      /* 2 at least: the crown has as many cuts as tiles */
#define ENVSAMP__MEDIAN_CELLS 512       /* read at once for a median */
#define ENVSAMP__MEDIAN_SHARE (1.0 / 256)   /* of the light: error a cell may make */

/* Where the light of a rectangle within a row or column of cells of level 0, or one of `even`
   light, has come to a share: at a root of the parabola through the light of its halves, exact
   along u, then by a step of Newton's. */
static double envsamp__median_in_cell(const envsamp__map *map, const envsamp__rect *rect, int axis,
                                      double light, double share, int even)
{
    envsamp__rect low = *rect;
    double from = axis ? rect->y0 : rect->x0, size = (axis ? rect->y1 : rect->x1) - from;
    double *end = axis ? &low.y1 : &low.x1, half;

    *end = from + 0.5 * size;
    if (even)
        half = axis ? light * envsamp__rows_sr(map, low.y0, low.y1)
                    / envsamp__rows_sr(map, rect->y0, rect->y1) : 0.5 * light;
    else
        half = envsamp__rect_moments(map, &low).sum;
    double slope = 4.0 * half - light;
    double bend = 2.0 * (light - 2.0 * half);
    double at = slope + ENVSAMP_SQRT(envsamp__max(slope * slope + 4.0 * bend * share * light, 0.0));
    at = at > 0.0 ? envsamp__clamp(2.0 * share * light / at, 0.0, 1.0) : share;
    *end = from + at * size;
    if (axis && !even && *end > from) {
        double over = envsamp__rect_moments(map, &low).sum - share * light;
        slope += 2.0 * bend * at;
        at = slope > 0.0 ? envsamp__clamp(at - over / slope, 0.0, 1.0) : at;
    }
    return from + at * size;
}

/* Where the light of a rectangle left of, or above, a place is half of the whole: narrowed down to
   a column or row of cells, at levels of at most ENVSAMP__MEDIAN_CELLS cells and more than one
   along the axis, down to level 0 or until their light is even. How uneven it may be is estimated
   from its variance, as if the cells of the column or row differed independently. */
static double envsamp__median(envsamp__tree *tree, const envsamp__rect *rect, int axis,
                              double light)
{
    const envsamp__map *map = tree->map;
    envsamp__profile *profile = axis ? tree->rows : tree->columns;
    envsamp__rect r = *rect;
    double *low = axis ? &r.y0 : &r.x0, *high = axis ? &r.y1 : &r.x1, share = 0.5;
    double error = ENVSAMP__MEDIAN_SHARE * light;
    int k, even;

    do {
        envsamp__window w, next = envsamp__touched(map, 0, &r, 0);
        int bins, first, i;

        for (k = 0;; k++) {
            w = next;
            first = axis ? w.y0 : w.x0;
            bins = (axis ? w.y1 : w.x1) - first;
            if (k + 1 == map->level_count)
                break;
            next = envsamp__touched(map, k + 1, &r, 0);
            if (bins <= ENVSAMP__SPLIT_CELLS
                && ((int64_t)(w.x1 - w.x0) * (w.y1 - w.y0) <= ENVSAMP__MEDIAN_CELLS
                    || (axis ? next.y1 - next.y0 : next.x1 - next.x0) == 1))
                break;
        }
        double size = envsamp__cell_size(map, k);
        envsamp__profile_rect(map, k, &r, axis ? NULL : profile, axis ? profile : NULL);
        if (k > 0)
            envsamp__correct_profile(map, k, &r, error, axis, profile);
        double wanted = share * envsamp__profile_moments(profile, 0, bins).sum;
        for (i = 0; i + 1 < bins && profile->sum[i] < wanted; i++)
            wanted -= profile->sum[i];
        double from = (double)(first + i) * size;
        light = profile->sum[i];
        share = light > 0.0 ? envsamp__clamp(wanted / light, 0.0, 1.0) : 0.5;
        *high = envsamp__min_double(from + size, *high);
        *low = envsamp__max(from, *low);
        double variance = envsamp__rows_sr(map, r.y0, r.y1) * (r.x1 - r.x0) * profile->square[i]
                        - light * light;
        double across = (double)(axis ? w.x1 - w.x0 : w.y1 - w.y0);
        even = k > 0 && variance <= 4.0 * across * error * error;
    } while (k > 0 && !even);
    return envsamp__median_in_cell(map, &r, axis, light, share, even);
}

/* Moves the tiles, the last blocks of the crown, to the front of `blocks`, which has room for all
   2^(bits + 1) - 1, and links the cuts. */
static void envsamp__crown_end(envsamp__tree *tree)
{
    envsamp__block *blocks = tree->blocks;
    int bits = tree->tile_bits;

    for (int i = 0; i < (1 << bits) - 1; i++) {
        uint32_t child = (uint32_t)(2 * i + 1), tiles = (1u << bits) - 1;

        tree->cuts[i].child[0] = child < tiles ? child : ENVSAMP__LEAF | (child - tiles);
        tree->cuts[i].child[1] = tree->cuts[i].child[0] + 1;
    }
    for (int i = 0; i < 1 << bits; i++) {
        blocks[i].rect = blocks[(1 << bits) - 1 + i].rect;
        blocks[i].column_sr = envsamp__rows_sr(tree->map, blocks[i].rect.y0, blocks[i].rect.y1);
        blocks[i].whole.sum = tree->map->integral / (double)(1 << bits);
        blocks[i].whole.square = 0.0;
        blocks[i].depth = 0;
        blocks[i].slot = bits ? (uint32_t)(i + (1 << bits) - 2) : ENVSAMP__LEAF;
    }
    tree->root = bits ? 0 : ENVSAMP__LEAF;
    tree->block_count = 1 << bits;
    tree->q = 0.0;
    tree->heap.count = 0;
}

/* How many of the first cuts are at columns: half, but a long map is first made as wide as high
   within 8 times, in texels, since tiles that are longer are slow to read. */
static int envsamp__crown_columns(const envsamp__tree *tree, int cuts)
{
    int64_t across = tree->map->image.width, down = tree->map->image.height;
    int x = (cuts + 1) / 2;

    while (!tree->alternate && x > 0 && cuts - x < 10 && down << x > across << (cuts - x + 3))
        x--;
    while (!tree->alternate && x < cuts && x < 10 && across << (cuts - x) > down << (x + 3))
        x++;
    return x;
}

static int envsamp__most_tile_bits(int block_limit)
{
    int bits = 0;

    while (ENVSAMP__BLOCKS_PER_TILE << (bits + 1) <= block_limit)
        bits++;
    return bits;
}

/* Begins a crown of 2^bits tiles, but, where `facing` does not need them, of one for a flat map. */
static void envsamp__crown_begin(envsamp__tree *tree, int bits)
{
    tree->tile_bits = 0;
    tree->blocks[0].rect = tree->map->bounds;
    envsamp__crown_end(tree);
    if (bits > 0) {
        envsamp__search_block(tree, &tree->blocks[0]);
        if (tree->map->desc.facing || envsamp__priority(tree->map, &tree->blocks[0]) > 0.0)
            tree->tile_bits = bits;
    }
    tree->crown_at = tree->tile_bits > 0 ? 0 : -1;
}

/* Halves the light of one more block of the crown, depth first, for the cache: the halves of block
   i are blocks 2 i + 1 and 2 i + 2. Where floats are too coarse for a cut, begins again: first with
   half of the cuts at columns, then with fewer tiles. Returns 0 when it is done. */
static int envsamp__crown_step(envsamp__tree *tree)
{
    int level = 0, i = tree->crown_at;
    envsamp__rect low, high;
    envsamp__cut *cut = &tree->cuts[i < 0 ? 0 : i];

    if (i < 0)
        return 0;
    while ((2 << level) - 1 <= i)
        level++;
    low = high = tree->blocks[i].rect;
    cut->axis = envsamp__crown_columns(tree, level) == envsamp__crown_columns(tree, level + 1);
    cut->at = envsamp__median(tree, &low, cut->axis, tree->map->integral / (double)(1 << level));
    if (!envsamp__store_cut(tree->map, &low, cut->axis, &cut->at)) {
        tree->tile_bits -= tree->alternate;
        tree->alternate = 1;
        tree->crown_at = tree->tile_bits > 0 ? 0 : -1;
    } else {
        *(cut->axis ? &low.y1 : &low.x1) = *(cut->axis ? &high.y0 : &high.x0) = cut->at;
        tree->blocks[2 * i + 1].rect = low;
        tree->blocks[2 * i + 2].rect = high;
        if (level + 1 < tree->tile_bits) {
            tree->crown_at = 2 * i + 1;
        } else {
            while (i > 0 && i % 2 == 0)
                i = (i - 1) / 2;
            tree->crown_at = i > 0 ? i + 1 : -1;
        }
    }
    if (tree->crown_at < 0)
        envsamp__crown_end(tree);
    return tree->crown_at >= 0;
}

/* ============================================================================================
 * KD PROBABILITIES                                                 [search: @kd-probabilities]
 *
 * How often each block is drawn. ALIAS: in proportion to Q, as whole multiples of 2^-24. FIT: a
 * model over the blocks sorted by probability, of which a table holds two numbers.
 *
 * The model is P(x) = G(x)/G(n) with L = log2(1 + x/alpha) and G = L [1, equation 6] or, for
 * POWER, G = (2^(gamma L) - 1)/gamma with gamma = 1 - beta, whose limit at gamma = 0 is L times
 * log 2. Block k has the probability of bin k, P(k+1) - P(k). The point value p(k) of [1] is not
 * that: p varies inside a bin, 100-fold in the first at alpha = 0.01.
 * ========================================================================================== */

#ifdef ENVSAMP_NO_FIT
#define ENVSAMP__KD_SELECT_MAX ENVSAMP_KD_ALIAS
#else
#define ENVSAMP__KD_SELECT_MAX ENVSAMP_KD_FIT
#endif
#define ENVSAMP__LOG2_ALPHA_MIN (-24.0)     /* the first block takes nearly all */
#define ENVSAMP__BETA_MIN (-4.0)
#define ENVSAMP__BETA_MAX 8.0
#define ENVSAMP__FIT_STARTS 4               /* local minima of the scan that are polished */

typedef struct envsamp__fit {
    envsamp_kd_model model;
    envsamp_kd_objective objective;
    int count;                      /* blocks above zero */
    const double *target;           /* shares, L1: of luminance, CHI2: of Q; in falling order */
    double *weight;                 /* L1: of the residuals */
    envsamp_buffer lm_scratch;
} envsamp__fit;

typedef struct envsamp__fit_point { double cost, param[2]; } envsamp__fit_point;

/* gamma of beta, exactly 0 where the power would only be a worse computed logarithm. */
ENVSAMP__MATH double envsamp__model_gamma(double beta)
{
    double gamma = 1.0 - beta;

    return gamma < 1e-6 && gamma > -1e-6 ? 0.0 : gamma;
}

/* G at x plus a constant: bins are differences of this, which does not cancel where the power
   falls steeply. */
ENVSAMP__MATH double envsamp__model_g(double gamma, double x_over_alpha)
{
    double log_ratio = envsamp__log2(1.0 + x_over_alpha);

    return gamma == 0.0 ? log_ratio : envsamp__exp2(gamma * log_ratio) / gamma;
}

/* G(x) - G(0). */
ENVSAMP__MATH double envsamp__model_mass(double gamma, double x_over_alpha)
{
    return envsamp__model_g(gamma, x_over_alpha) - (gamma == 0.0 ? 0.0 : 1.0 / gamma);
}

#ifndef ENVSAMP_NO_FIT

/* The objective at parameters (log2 alpha, beta), with its residuals unless those are NULL. DBL_MAX
   where the model does not compute: alpha = 1000 n is flat. */
static double envsamp__fit_cost(const envsamp__fit *fit, const double *param, double *residual)
{
    int power = fit->model == ENVSAMP_KD_POWER, chi2 = fit->objective == ENVSAMP_KD_CHI2;
    double gamma = power ? envsamp__model_gamma(param[1]) : 0.0;
    double low = envsamp__model_g(gamma, 0.0), cost = 0.0;

    if (param[0] < ENVSAMP__LOG2_ALPHA_MIN || param[0] > 10.0 + envsamp__log2((double)fit->count)
        || (power && (param[1] < ENVSAMP__BETA_MIN || param[1] > ENVSAMP__BETA_MAX)))
        return DBL_MAX;
    double inverse_alpha = envsamp__exp2(-param[0]);
    double scale = 1.0 / envsamp__model_mass(gamma, (double)fit->count * inverse_alpha);
    for (int k = 0; k < fit->count; k++) {
        double high = envsamp__model_g(gamma, (double)(k + 1) * inverse_alpha);
        double bin = (high - low) * scale, target = fit->target[k], error = target - bin;

        low = high;
        bin = bin > 1e-30 ? bin : 1e-30;
        cost += chi2 ? target * target / bin : ENVSAMP__FABS(error);
        if (residual)
            residual[k] = chi2 ? target / ENVSAMP_SQRT(bin) : error * fit->weight[k];
    }
    return cost;
}

static void envsamp__fit_residuals(const double *param, double *residual, void *user)
{
    const envsamp__fit *fit = (const envsamp__fit *)user;

    if (fit->count == 1)
        residual[1] = 0.0;          /* two parameters need two residuals */
    if (envsamp__fit_cost(fit, param, residual) == DBL_MAX)
        residual[0] = DBL_MAX;      /* its square is infinite: the solver turns back */
}

/* Levenberg-Marquardt from a point. CHI2 is a sum of squares as it stands. L1 becomes one by
   weights of 1/sqrt(|residual|) from the point before, again and again. */
static void envsamp__fit_polish(envsamp__fit *fit, envsamp__fit_point *best)
{
    int params = fit->model == ENVSAMP_KD_LOG ? 1 : 2;
    envsamp_lm_desc desc = { params, envsamp__max_int(fit->count, params), 30, 1e-10, 1e-10,
                             1e-10 };
    int rounds = fit->objective == ENVSAMP_KD_CHI2 ? 1 : 3;
    envsamp__fit_point next = *best;

    for (; rounds > 0; rounds--) {
        if (fit->objective == ENVSAMP_KD_L1) {
            for (int k = 0; k < fit->count; k++)
                fit->weight[k] = 1.0;
            envsamp__fit_cost(fit, next.param, fit->weight);
            for (int k = 0; k < fit->count; k++)
                fit->weight[k] = 1.0 / ENVSAMP_SQRT(ENVSAMP__FABS(fit->weight[k]) + 1e-9);
        }
        envsamp_lm(&desc, envsamp__fit_residuals, fit, next.param, fit->lm_scratch, NULL);
        next.cost = envsamp__fit_cost(fit, next.param, NULL);
        *best = next.cost < best->cost ? next : *best;
    }
}

/* Steps in log2 alpha that grow while they lower the cost and shrink where neither way does: finds
   the kink that a minimum of L1 is, which no sum of squares has. */
static void envsamp__fit_line(const envsamp__fit *fit, envsamp__fit_point *best, double step)
{
    for (int i = 0; i < 60 && ENVSAMP__FABS(step) > 1e-5; i++) {
        envsamp__fit_point probe = *best;

        probe.param[0] += step;
        probe.cost = envsamp__fit_cost(fit, probe.param, NULL);
        step *= probe.cost < best->cost ? 1.5 : step > 0.0 ? -1.0 : -0.4;
        *best = probe.cost < best->cost ? probe : *best;
    }
}

/* As steps along the valley that POWER has: alpha and beta grow together, towards an exponential
   of alpha / beta. Steps in beta, each with the best alpha near the one that keeps that ratio. */
static void envsamp__fit_climb(const envsamp__fit *fit, envsamp__fit_point *best)
{
    double step = 0.5;

    for (int i = 0; i < 40 && ENVSAMP__FABS(step) > 1e-3; i++) {
        envsamp__fit_point probe = *best;

        probe.param[1] += step;
        if (probe.param[1] > 0.1 && best->param[1] > 0.1)
            probe.param[0] += envsamp__log2(probe.param[1] / best->param[1]);
        probe.cost = envsamp__fit_cost(fit, probe.param, NULL);
        envsamp__fit_line(fit, &probe, 0.25);
        step *= probe.cost < best->cost ? 1.5 : step > 0.0 ? -1.0 : -0.4;
        *best = probe.cost < best->cost ? probe : *best;
    }
}

/* The global minimum: the objective has several local ones in alpha, and a wrong one costs up to
   50 in excess variance. Scans log2 alpha at some betas and starts from the best local minima. */
static envsamp__fit_point envsamp__fit_solve(envsamp__fit *fit)
{
    const double betas[] = { 1.0, 0.25, 0.5, 0.75, 1.25, 1.5, 2.0, 3.0 };
    const envsamp__fit_point worst = { DBL_MAX, { 0.0, 0.0 } };
    int scans = fit->model == ENVSAMP_KD_LOG ? 1 : (int)(sizeof betas / sizeof betas[0]), k;
    double step = fit->model == ENVSAMP_KD_LOG ? 0.25 : 1.0;
    envsamp__fit_point starts[ENVSAMP__FIT_STARTS + 1];     /* and one that is not kept */

    for (int i = 0; i < ENVSAMP__FIT_STARTS; i++)
        starts[i] = worst;
    for (int scan = 0; scan < scans; scan++) {
        envsamp__fit_point before = worst, last = worst, next = { 0.0, { 0.0, betas[scan] } };

        for (int i = 0; next.cost < DBL_MAX; i++) {
            next.param[0] = ENVSAMP__LOG2_ALPHA_MIN + step * (double)i;
            next.cost = envsamp__fit_cost(fit, next.param, NULL);
            if (i > 0 && last.cost <= before.cost && last.cost <= next.cost) {
                for (k = ENVSAMP__FIT_STARTS; k > 0 && starts[k - 1].cost > last.cost; k--)
                    starts[k] = starts[k - 1];
                starts[k] = last;
            }
            before = last;
            last = next;
        }
    }
    envsamp__fit_point best = starts[0];
    for (int i = 0; i < ENVSAMP__FIT_STARTS && starts[i].cost < DBL_MAX; i++) {
        envsamp__fit_polish(fit, &starts[i]);
        if (fit->objective == ENVSAMP_KD_L1)
            envsamp__fit_line(fit, &starts[i], 0.5 * step);
        best = starts[i].cost < best.cost ? starts[i] : best;
    }
    if (fit->model == ENVSAMP_KD_POWER)
        envsamp__fit_climb(fit, &best);
    return best;
}

/* Sorts indices by falling key, equal keys by rising index: Shell's method. */
static void envsamp__sort_descending(const double *key, uint32_t *order, int count)
{
    int gap = 1, hole;

    while (gap < count / 3)
        gap = 3 * gap + 1;
    for (; gap > 0; gap /= 3)
        for (int i = gap; i < count; i++) {
            const uint32_t item = order[i];

            for (hole = i; hole >= gap; hole -= gap) {
                const uint32_t above = order[hole - gap];

                if (key[above] > key[item] || (key[above] == key[item] && above < item))
                    break;
                order[hole] = above;
            }
            order[hole] = item;
        }
}

#endif  /* ENVSAMP_NO_FIT */

/* Rounds weights to whole draws out of 2^24: at least 1 for a weight above zero. Those below 1
   are lifted, what that costs is taken from the rest in proportion, and the rest is rounded by
   its running sum, so that the total is exact. */
static void envsamp__round_draws(const double *weight, int count, uint32_t *draws)
{
    const uint32_t all = 1u << 24;
    uint32_t lifted = 0, given = 0, was_lifted;
    double rest = 0.0, running = 0.0;

    for (int i = 0; i < count; i++) {
        rest += weight[i];
        draws[i] = 0;
    }
    do {                            /* lifting some may push the next below 1; few rounds do */
        was_lifted = lifted;
        double scale = (double)(all - lifted) / rest;
        rest = 0.0;
        for (int i = 0; i < count; i++)
            if (weight[i] > 0.0 && !draws[i]) {
                draws[i] = weight[i] * scale < 1.0001;  /* so that rounding cannot give it none */
                lifted += draws[i];
                rest += draws[i] ? 0.0 : weight[i];
            }
    } while (lifted != was_lifted);
    for (int i = 0; i < count; i++)
        if (weight[i] > 0.0 && !draws[i]) {
            running += weight[i];
            draws[i] = (uint32_t)(running / rest * (double)(all - lifted) + 0.5) - given;
            given += draws[i];
        }
}

/* The alias method [2] on whole numbers, so nothing rounds and no weight turns negative. Uses up
   `draws`. Of the 2^24 draws bin i has 2^shift. The first `own` are of block i, the others of block
   `alias`: together always 25 bits. */
static void envsamp__alias_build(uint32_t *draws, int count, int shift, uint32_t *bins,
                                 uint32_t *stack)
{
    uint32_t bin_count = 1u << (24 - shift), room = 1u << shift, light = 0, heavy = bin_count;

    for (uint32_t i = 0; i < bin_count; i++)
        stack[i >= (uint32_t)count || draws[i] < room ? light++ : --heavy] = i;
    while (light > 0) {
        uint32_t bin = stack[--light], donor = stack[heavy];
        uint32_t own = bin < (uint32_t)count ? draws[bin] : 0;

        bins[bin] = own << (24 - shift) | donor;
        draws[donor] -= room - own;
        if (draws[donor] < room) {
            stack[light++] = donor;
            heavy++;
        }
    }
    for (; heavy < bin_count; heavy++)
        bins[stack[heavy]] = room << (24 - shift) | stack[heavy];
}

/* ============================================================================================
 * KD TABLE                                                                 [search: @kd-table]
 *
 * One block of 32-bit words in the byte order of the machine, without pointers: the header below (a
 * double is two words), then the arrays that the selection needs. `bits` is log2 of block_count,
 * rounded up; tiles is 2^(tile_bits_x + tile_bits_y), 1 without WARP. A sample of WARP
 * or ALIAS and a density, of light alone, read the first 64 bytes of the header: one cache line, if
 * the table begins with one.
 *
 *     records  WARP        tiles x { float x0, x1, y0, y1; link }: edges in the map. Tile
 *                          j 2^tile_bits_x + i is cell (i, j) of a grid over the unit square, u0
 *                          across.
 *              ALIAS, FIT  block_count x { float x0, x1, y0, y1; link }: blocks and densities
 *     cuts     WARP        block_count - tiles x { float cut, edge; link child[2] }: the cuts
 *                          below the tiles, tile by tile, each before the lower child's, those
 *                          before the higher child's. `cut` divides the tile's own unit square,
 *                          [0, 1], across u0, or, with a minus sign, -0 included, across u1;
 *                          from the cut on is the higher side. `edge` is its image in the map.
 *     alias    ALIAS       2^bits x uint32: own << bits | alias. Leading bits of u1, then of u0 (of
 *                          it one more if `bits` is odd) are the bin; where the others of u1, xor
 *                          the leading bits of ~bin 0x9e3779b9, are below own, it draws the block
 *                          of its number, else block `alias`.
 *     nodes    all         node_count x { float cut[3]; link child[4] }: the tree, for pdf(dir),
 *                          two levels a node: cut[0], below it cut[1] and cut[2], below these the
 *                          children in this order. A cut is an azimuth, or, with a minus sign, a
 *                          polar angle, in the coordinates below; 0 where there is none. The first
 *                          node has the root; the first levels are the crown, down to the tiles.
 *     facing   WARP        facing_count x { float cut[7], edge[7]; link child[8];
 *                          float moment[9][8] }: the top of the tree again, three levels a node,
 *                          below cut i cuts 2 i + 1 and 2 i + 2. cut: in the whole unit square,
 *                          across u0, or, with a minus sign, u1; edge: as the cuts of nodes. Of
 *                          eight parts first come the lower sides of cuts 3 to 6, then the higher
 *                          ones. A link that is no place is 1 over the area of its part in the unit
 *                          square. moment: sums of x, y, z, then products: see @kd-sampling.
 *     grid     all         2^(grid_bits_x + grid_bits_y) x link: the deepest whose region holds the
 *                          cell (i, j), i along azimuth, at j 2^grid_bits_x + i
 *
 * A link is a density per steradian, a float of 0 or more, where a block is reached; otherwise,
 * with its top bit set, it leads to a cut (in records and cuts) or a node (in nodes and grid), as
 * its place in the table in words.
 *
 * An edge in azimuth is a float in turns. An edge in polar angle is 1 - cos theta above the
 * equator, and, with a minus sign, -0 included, 1 + cos theta below it: each is exact at its pole.
 * They add up to 2, sin theta is the root of their product, and both interpolate linearly, which is
 * uniform in solid angle. A hemisphere ends at 1. Edges in an octahedral map are u and v.
 *
 * Nodes and grid are in coordinates that grow with the angles and need no arc tangent: azimuth in
 * [0, 4] is y/(|x|+|y|) unrolled round the four quadrants, polar in [0, 2] is r/(r+|z|), r =
 * |(x, y)|, unrolled over the equator; a hemisphere ends at 1. In an octahedral map: 4 u and 2 v.
 * ========================================================================================== */

#define ENVSAMP__KD_MAGIC 0x444b5345u   /* "ESKD" in memory */
#define ENVSAMP__KD_VERSION 6u
#define ENVSAMP__INNER 0x80000000u      /* of a link: not a density */

typedef struct envsamp__record { float edge[4]; uint32_t link; } envsamp__record;
typedef struct envsamp__sample_node { float cut, edge; uint32_t child[2]; } envsamp__sample_node;
typedef struct envsamp__pdf_node { float cut[3]; uint32_t child[4]; } envsamp__pdf_node;
typedef struct envsamp__facing_node {
    float cut[7], edge[7];
    uint32_t child[2][4];
    float moment[9][2][4];
} envsamp__facing_node;

struct envsamp_kd {
    uint32_t magic, version, checksum, mapping; /* as every table: see envsamp__table */
    uint64_t bytes;                             /* 16 */
    uint32_t select;                            /* 24: as numbered in its enum */
    uint32_t tile_bits_x, tile_bits_y;          /* 28 */
    uint32_t alias_shift;                       /* 36: 24 - log2 of the bins */
    uint32_t alias_at;                          /* 40: in bytes, like the other places */
    uint32_t grid_bits_x, grid_bits_y, grid_at; /* 44 */
    uint32_t model;                             /* 56: as numbered in its enum */
    float fit_alpha, fit_end;                   /* 60: FIT: alpha; the largest x of a block */
    uint32_t node_count;                        /* 68 */
    uint32_t criterion, bilinear, width, height;    /* 72: of the build; of these only bilinear
                                                       is read again */
    uint32_t block_count;                       /* 88 */
    uint32_t drawn_count;                       /* 92: blocks that can be drawn: FIT, the first */
    uint32_t nodes_at;                          /* 96 */
    float mis_compensation;                     /* 100 */
    double fit_total;                           /* 104: FIT: G(n) */
    double integral, excess_variance, max_ratio, alpha, beta, l1;       /* 112: see info */
    uint64_t bad_pixel_count;                   /* 160 */
    uint32_t facing_count, facing_at;           /* 168 */
    uint32_t spare[4];                          /* 176 */
};

typedef char envsamp__kd_is_packed[sizeof(envsamp_kd) == 192 ? 1 : -1];

/* An array of the table. */
#define ENVSAMP__ARRAY(type, table, name) \
    ((const type *)(const void *)((const char *)(table) + (table)->name##_at))
#define ENVSAMP__ARRAY_OUT(type, table, name) \
    ((type *)(void *)((char *)(table) + (table)->name##_at))

/* The records, which follow the header, and what a link leads to. */
#define ENVSAMP__RECORDS(kd) \
    ((const envsamp__record *)(const void *)((const char *)(kd) + sizeof(envsamp_kd)))
#define ENVSAMP__RECORDS_OUT(kd) ((envsamp__record *)(void *)((char *)(kd) + sizeof(envsamp_kd)))
#define ENVSAMP__LINKED(type, kd, link) ((const type *)(const void *) \
    ((const char *)(kd) + 4 * (size_t)((link) & ~ENVSAMP__INNER)))

/* Bits of a power of two that is at least count. */
static uint32_t envsamp__bits(uint32_t count)
{
    uint32_t bits = 0;

    while ((1u << bits) < count)
        bits++;
    return bits;
}

ENVSAMP__MATH uint32_t envsamp__tile_count(const envsamp_kd *kd)
{
    return 1u << (kd->tile_bits_x + kd->tile_bits_y);
}

/* What a table has a record of: WARP: tiles, else blocks. */
ENVSAMP__MATH uint32_t envsamp__record_count(const envsamp_kd *kd)
{
    return kd->select == ENVSAMP_KD_WARP ? envsamp__tile_count(kd) : kd->block_count;
}

/* The link to a cut of WARP. */
ENVSAMP__MATH uint32_t envsamp__cut_link(const envsamp_kd *kd, uint32_t number)
{
    return ENVSAMP__INNER
         | (uint32_t)(sizeof *kd + envsamp__record_count(kd) * sizeof(envsamp__record)
                      + number * sizeof(envsamp__sample_node)) / 4;
}

/* Puts the arrays in their places, and sets whatever else follows from the other fields. */
static void envsamp__kd_layout(envsamp_kd *kd)
{
    uint32_t bits = envsamp__bits(kd->block_count), records = envsamp__record_count(kd);

    kd->alias_shift = 24 - bits;
    kd->grid_bits_x = bits / 2 + 1;             /* up to four cells a block */
    kd->grid_bits_y = (bits + 1) / 2;
    kd->fit_alpha = (float)kd->alpha;
    kd->fit_end = envsamp__bits_float(envsamp__float_bits((float)kd->drawn_count) - 1);
    kd->alias_at = (uint32_t)(sizeof *kd + records * sizeof(envsamp__record)
                              + (kd->block_count - records) * sizeof(envsamp__sample_node));
    kd->nodes_at = kd->alias_at + (kd->select == ENVSAMP_KD_ALIAS ? 4u << bits : 0);
    kd->grid_at = kd->nodes_at + kd->node_count * (uint32_t)sizeof(envsamp__pdf_node);
    kd->facing_at = kd->grid_at + (4u << (kd->grid_bits_x + kd->grid_bits_y));
    kd->bytes = kd->facing_at + kd->facing_count * sizeof(envsamp__facing_node);
}

/* ---- jobs ---- */

/* A build is a job that does one item of work after the other, so that it can be spread over
   frames: the same items in the same order, however many at a time. What an item of work is: */
typedef enum envsamp__phase {
    ENVSAMP__SURVEY,            /* a row of texels, ahead of the build */
    ENVSAMP__ROWS,              /* a row of texels */
    ENVSAMP__PYRAMID,           /* kd: a row of cells of a coarser level */
    ENVSAMP__CROWN,             /* kd: a block of the crown halved */
    ENVSAMP__TILES,             /* kd: the first split of a tile searched */
    ENVSAMP__SPLITS,            /* kd: a split searched, or made */
    ENVSAMP__MOMENTS,           /* kd: a block, where sums were not exact */
    ENVSAMP__PROBABILITIES,     /* kd: all blocks; FIT: the fit */
    ENVSAMP__WRITE,             /* kd: a tile of WARP, or a block; with the last, its trees */
    ENVSAMP__GRID,              /* kd: a row of cells */
    ENVSAMP__CHECKSUM,          /* some bytes of the table */
    ENVSAMP__DONE
} envsamp__phase;

#define ENVSAMP__SUMMED 131072  /* bytes of the checksum in one step */

/* What the jobs of kd and cdf begin with. */
typedef struct envsamp__job {
    envsamp__map map;
    void *table;
    envsamp_result result;
    envsamp__phase phase;
    int next;                       /* the item of the phase */
    int is_reread;                  /* draws are chosen; rows are read again, for figures */
    uint32_t magic;                 /* of a finished table */
    envsamp__check sums;
    int (*work)(void *job, int item);   /* of the other phases; 0 at the end of one */
} envsamp__job;

static envsamp_result envsamp__job_check(const envsamp_image *image, envsamp_row_fn fn,
                                         const envsamp_sizes *sizes, envsamp_buffer table,
                                         envsamp_buffer scratch)
{
    envsamp_result result = fn ? ENVSAMP_OK : envsamp__floats_check(image->pixels);

    return result == ENVSAMP_OK ? envsamp__buffers_check(sizes, table, scratch) : result;
}

static void envsamp__job_start(envsamp__job *job, void *table, uint32_t magic,
                               int (*work)(void *, int), envsamp_row_fn fn, void *user)
{
    job->table = table;
    job->magic = magic;
    job->work = work;
    job->phase = envsamp__is_surveyed(&job->map.image, &job->map.desc)
               ? ENVSAMP__SURVEY : ENVSAMP__ROWS;
    envsamp__map_begin(&job->map, fn, user);
}

/* Once draws are chosen by a power of luminance, starts to read the rows again, without the power,
   for the figures of the table. Returns 0, and does nothing, where no power is in force. */
static int envsamp__job_reread(envsamp__job *job)
{
    if (!(job->map.power > 0.0f))
        return 0;
    job->map.power = 0.0f;
    job->map.integral = 0.0;
    job->is_reread = 1;
    job->phase = ENVSAMP__SURVEY;       /* ROWS is next */
    return 1;
}

static envsamp_result envsamp__job_step(envsamp__job *job, int count, int *done)
{
    envsamp__table head;
    int more;

    for (; count > 0 && job->result == ENVSAMP_OK && job->phase != ENVSAMP__DONE; count--) {
        int item = job->next++;

        if (job->phase == ENVSAMP__SURVEY) {
            job->result = envsamp__survey_row(&job->map, item);
            more = item + 1 < job->map.image.height;
        } else if (job->phase == ENVSAMP__CHECKSUM) {
            ENVSAMP_MEMCPY(&head, job->table, sizeof head);
            more = envsamp__check_add(job->table, ENVSAMP__SUMMED, &job->sums, &head.checksum);
            head.magic = more ? 0 : job->magic;
            ENVSAMP_MEMCPY(job->table, &head, sizeof head);
        } else {
            more = job->work(job, item);
        }
        if (!more) {
            job->phase = (envsamp__phase)(job->phase + 1);
            job->next = 0;
        }
    }
    if (done)
        *done = job->result != ENVSAMP_OK || job->phase == ENVSAMP__DONE;
    return job->result;
}

/* A subtree of a tile that is to be written: its link in the tree, its edges x0, x1, y0, y1 in the
   tile's own unit square and in the map, and where its link in the table goes. A merged one is part
   of a block that the unit square had no room to cut, and has the edges of this block. */
typedef struct envsamp__subtree {
    float cut[4], edge[4];
    uint32_t link, *child;
    int is_merged;
} envsamp__subtree;

/* What a part of the tree is to `facing`: its edges x0, x1, y0, y1 in the unit square, its area
   there, and sums over what it draws of directions and of products xx, yy, zz, xy, xz, yz of their
   components. */
typedef struct envsamp__facing_sum { float cut[4], area, moment[9]; } envsamp__facing_sum;

struct envsamp_kd_job {
    envsamp__job base;
    envsamp__tree tree;
    int level;                      /* PYRAMID: that is made */
    int block_limit;                /* of the description, or of the cells */
    int crown_blocks;               /* that the crown is made for; 0: not known yet */
    double *probability;            /* of each block of the tree; WARP: Q of each cut */
    double *target, *weight;        /* FIT, sorted */
    uint32_t *order;                /* blocks of the tree as the table has them; then, by cut,
                                       numbers of nodes; then places of links to it in `facing` */
    float *density;                 /* of each block of the tree */
    uint32_t *draws, *stack;        /* ALIAS */
    envsamp_buffer lm_scratch;
    double second;                  /* moment of L / pdf of what is written */
    envsamp__subtree *subtrees;     /* WARP: a stack of ENVSAMP__WARP_DEPTH + 2 */
    uint32_t cut_count;             /* WARP: written */
    envsamp__facing_sum *facing;    /* of each cut, at even places, and each block; or NULL */
};

/* Puts a job's arrays into a buffer that begins with the job. */
static void envsamp__kd_carve(envsamp_kd_job *job, const envsamp_image *image,
                              const envsamp_kd_desc *desc, envsamp__arena *arena)
{
    const envsamp__map *map = &job->base.map;
    envsamp__tree *tree = &job->tree;

    ENVSAMP_MEMSET(job, 0, sizeof *job);
    envsamp__take(arena, 1, sizeof *job);
    envsamp__map_carve(&job->base.map, image, desc, 0, arena);
    uint64_t count = (uint64_t)map->width * (uint64_t)map->height;
    count = count < (uint64_t)desc->block_count ? count : (uint64_t)desc->block_count;
    job->block_limit = (int)count;
    tree->map = map;
    tree->blocks = ENVSAMP__TAKE(envsamp__block, arena, count);
    tree->cuts = ENVSAMP__TAKE(envsamp__cut, arena, count);
    tree->heap.entries = ENVSAMP__TAKE(envsamp__heap_entry, arena, count);
    tree->columns = ENVSAMP__TAKE(envsamp__profile, arena, 1);
    tree->rows = ENVSAMP__TAKE(envsamp__profile, arena, 1);
    job->subtrees = ENVSAMP__TAKE(envsamp__subtree, arena, ENVSAMP__WARP_DEPTH + 2);
    job->probability = ENVSAMP__TAKE(double, arena, count);
    job->order = ENVSAMP__TAKE(uint32_t, arena, count);
    job->density = ENVSAMP__TAKE(float, arena, count);
    if (desc->facing)
        job->facing = ENVSAMP__TAKE(envsamp__facing_sum, arena, 2 * count);
    if (desc->select == ENVSAMP_KD_ALIAS) {
        job->draws = ENVSAMP__TAKE(uint32_t, arena, count);
        job->stack = ENVSAMP__TAKE(uint32_t, arena, 1u << envsamp__bits((uint32_t)count));
    }
#ifndef ENVSAMP_NO_FIT
    if (desc->select == ENVSAMP_KD_FIT) {
        envsamp_lm_desc lm = { 2, envsamp__max_int((int)count, 2), 0, 0.0, 0.0, 0.0 };

        job->target = ENVSAMP__TAKE(double, arena, count);
        job->weight = ENVSAMP__TAKE(double, arena, count);
        job->lm_scratch.bytes = envsamp_lm_scratch_bytes(&lm);
        job->lm_scratch.data = ENVSAMP__TAKE(char, arena, job->lm_scratch.bytes);
    }
#endif
}

/* ---- writing the density ---- */

/* Numbers nodes from 1 in order[cut], by the cuts at even depths that they begin with. Where these
   are more than half, by those at odd depths, and the root is below a node that has no other cut.
   Returns how many. */
static uint32_t envsamp__number_nodes(envsamp_kd_job *job)
{
    uint32_t *number = job->order, blocks = (uint32_t)job->tree.block_count, count, even = 1;

    do {
        number[0] = even;
        count = !even;
        for (uint32_t c = 0; c + 1 < blocks; c++) {        /* children come after their parents */
            for (uint32_t i = 0; i < 2; i++)
                if (!(job->tree.cuts[c].child[i] & ENVSAMP__LEAF))
                    number[job->tree.cuts[c].child[i]] = !number[c];
            if (number[c])
                number[c] = ++count;
        }
    } while (even-- && (count < 1 || 2 * count > blocks));
    return count;
}

static void envsamp__write_pdf_nodes(const envsamp_kd_job *job, envsamp_kd *kd)
{
    const envsamp__tree *tree = &job->tree;
    envsamp__pdf_node *node = ENVSAMP__ARRAY_OUT(envsamp__pdf_node, kd, nodes);
    const uint32_t *number = job->order, size = sizeof *node / 4;
    uint32_t part[7];

    for (int c = number[0] ? 0 : -1; c + 1 < tree->block_count; c++) {
        if (c >= 0 && !number[c])
            continue;
        part[0] = c < 0 ? tree->root : (uint32_t)c;
        for (uint32_t at = 0; at < 3; at++) {
            part[2 * at + 1] = part[2 * at + 2] = part[at];
            if (part[at] & ENVSAMP__LEAF || (at == 0) != (number[part[at]] > 0))
                continue;           /* a block, or below another node */
            const envsamp__cut *cut = &tree->cuts[part[at]];
            node->cut[at] = envsamp__node_cut(tree->map, cut->at, cut->axis);
            part[2 * at + 1] = cut->child[0];
            part[2 * at + 2] = cut->child[1];
        }
        for (int i = 0; i < 4; i++)
            node->child[i] = part[3 + i] & ENVSAMP__LEAF
                           ? envsamp__float_bits(job->density[part[3 + i] & ~ENVSAMP__LEAF])
                           : ENVSAMP__INNER | (kd->nodes_at / 4 + size * (number[part[3 + i]] - 1));
        node++;
    }
}

/* Row y of the grid: the deepest link whose region holds a cell. Cells have exact edges: so it is
   right for every point that falls in one. Runs of cells, each half as long as the last, go on from
   the link of the run that they are half of. */
static void envsamp__write_grid(envsamp_kd *kd, uint32_t y)
{
    uint32_t *cell = ENVSAMP__ARRAY_OUT(uint32_t, kd, grid) + (y << kd->grid_bits_x);
    uint32_t columns = 1u << kd->grid_bits_x;
    float across = 4.0f / (float)columns;
    float down = envsamp__polar_end(kd->mapping) / (float)(1u << kd->grid_bits_y);

    cell[0] = ENVSAMP__INNER | kd->nodes_at / 4;
    for (uint32_t run = columns; run > 0; run /= 2)
        for (uint32_t x = columns; x > 0;) {    /* downwards: an even one is its odd one's start */
            x -= run;
            const float low[2] = { across * (float)x, down * (float)y };
            const float high[2] = { across * (float)(x + run), down * (float)(y + 1) };
            uint32_t at = 3, link = cell[x & ~run];

            while (at > 2 && link & ENVSAMP__INNER) {
                const envsamp__pdf_node *node = ENVSAMP__LINKED(envsamp__pdf_node, kd, link);

                for (at = 0; at < 3;) {
                    int axis = envsamp__sign(node->cut[at]);
                    float cut = ENVSAMP_FABSF(node->cut[at]);

                    if (cut > low[axis] && cut < high[axis])
                        break;
                    at = 2 * at + 1 + (cut <= low[axis]);
                }
                link = at > 2 ? node->child[at - 3] : link;
            }
            cell[x] = link;
        }
}

/* ---- blocks of WARP ---- */

/* The way down from a tile: a region's edges x0, x1, y0, y1 in the tile's own unit square, `cut`,
   and in the map, `edge`, both `stride` apart. Both functions return a link. */
ENVSAMP__HOT uint32_t envsamp__enter_tile(const envsamp_kd *kd, int tile, float *cut, float *edge,
                                          size_t stride)
{
    const envsamp__record *record = ENVSAMP__RECORDS(kd) + tile;

    edge[0] = record->edge[0];
    edge[stride] = record->edge[1];
    edge[2 * stride] = record->edge[2];
    edge[3 * stride] = record->edge[3];
    for (int k = 0; k < 4; k++)
        cut[(size_t)k * stride] = (float)(k & 1);
    return record->link;
}

/* Makes a region the lower or the higher side of its cut. */
ENVSAMP__HOT uint32_t envsamp__take_side(const envsamp__sample_node *node, uint32_t high,
                                         float *cut, float *edge, size_t stride)
{
    uint32_t side = 2 * (envsamp__float_bits(node->cut) >> 31) + 1 - high;

    cut[side * stride] = ENVSAMP_FABSF(node->cut);
    edge[side * stride] = node->edge;
    return node->child[high];
}

/* A region's share of the whole unit square: the probability of what is below it. */
static double envsamp__region_area(const envsamp_kd *kd, const float cut[4])
{
    return ((double)cut[1] - (double)cut[0]) * ((double)cut[3] - (double)cut[2])
         / (double)envsamp__tile_count(kd);
}

/* ---- writing WARP ---- */

/* Q of what a link of the tree leads to. */
static double envsamp__link_q(const envsamp__tree *tree, const double *q, uint32_t link)
{
    return link & ENVSAMP__LEAF ? tree->blocks[link & ~ENVSAMP__LEAF].weight : q[link];
}

/* Adds a block drawn with density `pdf` to the second moment and to max_ratio. */
static void envsamp__add_cost(envsamp_kd_job *job, const envsamp__block *b, double pdf)
{
    envsamp_kd *kd = (envsamp_kd *)job->base.table;
    double mean = pdf * job->base.map.integral;

    if (pdf > 0.0) {
        job->second += b->whole.square / pdf;
        kd->max_ratio = envsamp__rect_peak(&job->base.map, &b->rect, kd->max_ratio * mean) / mean;
    }
}

/* Writes the cut of a subtree and sets its two sides. It divides the units of 2^-24 in
   proportion to Q but for rounding: a lit side gets one at least, a black one none. Where there are
   too few, it becomes one block, and both sides are the subtree itself. */
static void envsamp__write_cut(envsamp_kd_job *job, envsamp_kd *kd, const envsamp__subtree *p,
                               envsamp__subtree *low, envsamp__subtree *high)
{
    const envsamp__cut *cut = &job->tree.cuts[p->link];
    uint32_t link = envsamp__cut_link(kd, job->cut_count);
    envsamp__sample_node *node = (envsamp__sample_node *)(void *)
                                 ((char *)kd + 4 * (size_t)(link & ~ENVSAMP__INNER));
    int axis = cut->axis;
    float side = (float)(1u << (24 - (axis ? kd->tile_bits_y : kd->tile_bits_x)));
    uint32_t units = (uint32_t)((p->cut[2 * axis + 1] - p->cut[2 * axis]) * side);
    double low_q = envsamp__link_q(&job->tree, job->probability, cut->child[0]);
    double high_q = envsamp__link_q(&job->tree, job->probability, cut->child[1]);

    *low = *high = *p;
    low->link = cut->child[0];
    high->link = cut->child[1];
    if (p->is_merged || (low_q > 0.0 && high_q > 0.0 && units < 2)) {
        low->is_merged = high->is_merged = 1;
        return;
    }
    double share = low_q + high_q > 0.0 ? low_q / (low_q + high_q) : 0.5;
    uint32_t cut_at = (uint32_t)(share * (double)units + 0.5);
    cut_at += low_q > 0.0 && cut_at < 1;
    cut_at -= high_q > 0.0 && cut_at > units - 1;
    node->cut = envsamp__with_sign(p->cut[2 * axis] + (float)cut_at / side, axis);
    node->edge = envsamp__stored_edge(job->tree.map, cut->at, axis);
    envsamp__take_side(node, 0, low->cut, low->edge, 1);
    envsamp__take_side(node, 1, high->cut, high->edge, 1);
    *p->child = link;
    job->cut_count++;
    low->child = &node->child[0];
    high->child = &node->child[1];
}

/* ---- writing `facing` ---- */

#define ENVSAMP__BLOCKS_PER_FACING 30   /* blocks a node: 6144 make 205 nodes, 77 KB */
#define ENVSAMP__NO_PART 0xffffffffu
#define ENVSAMP__FACING_VARIANCE 0.75f  /* of the variance that counts, as of an even spread */
#define ENVSAMP__FACING_FLOOR 4e-3f     /* added under the root, over the square of the light */

ENVSAMP__COLD envsamp__facing_sum *envsamp__facing_of(const envsamp_kd_job *job, uint32_t link)
{
    return &job->facing[link << 1 | link >> 31];
}

/* Sums of a block of a tile: by three points each way, Gauss's. */
static void envsamp__facing_block(const envsamp_kd *kd, const envsamp__subtree *block,
                                  uint32_t tile, envsamp__facing_sum *sum)
{
    static const float place[3] = { 0.112701665f, 0.5f, 0.887298335f };
    static const float weight[3] = { 0.277777778f, 0.444444444f, 0.277777778f };
    const uint32_t bits[2] = { kd->tile_bits_x, kd->tile_bits_y };
    const uint32_t at[2] = { tile & ((1u << bits[0]) - 1), tile >> bits[0] };
    const float *edge = block->edge;
    float batch[4 * ENVSAMP__BATCH] = { 0.0f }, dir[3][9], w[9];

    ENVSAMP_MEMSET(sum, 0, sizeof *sum);
    for (int i = 0; i < 4; i++)
        sum->cut[i] = ((float)at[i / 2] + block->cut[i]) / (float)(1u << bits[i / 2]);
    sum->area = (sum->cut[1] - sum->cut[0]) * (sum->cut[3] - sum->cut[2]);
    if (!(sum->area > 0.0f))
        return;
    for (int i = 0; i < 9; i++)
        envsamp__batch_put(batch, i, envsamp__between(edge[0], edge[1], place[i % 3], edge[2],
                                                      edge[3], place[i / 3]),
                           sum->area * weight[i % 3] * weight[i / 3]);
    envsamp__batch_out(kd->mapping, 9, batch, dir[0], dir[1], dir[2], w);
    for (int i = 0; i < 9; i++)
        for (int k = 0; k < 3; k++) {
            sum->moment[k] += w[i] * dir[k][i];
            sum->moment[3 + k] += w[i] * dir[k][i] * dir[k][i];
            sum->moment[6 + k] += w[i] * dir[k == 2][i] * dir[k == 0 ? 1 : 2][i];
        }
}

/* The cut that a link leads to; NULL for a block, and where the table has one block for both sides,
   each of which is then the whole. */
static const envsamp__cut *envsamp__facing_cut(const envsamp_kd_job *job, uint32_t link)
{
    const envsamp__cut *cut = link & ENVSAMP__LEAF ? NULL : &job->tree.cuts[link];

    return cut && ENVSAMP_MEMCMP(envsamp__facing_of(job, cut->child[0])->cut,
                                 envsamp__facing_of(job, cut->child[1])->cut, 4 * sizeof(float))
         ? cut : NULL;
}

/* One of the parts of a node. In the heap, while it can become a node, parts that spread over the
   sphere and have much light come first. */
static void envsamp__facing_part(envsamp_kd_job *job, envsamp__facing_node *node, int number,
                                 uint32_t link)
{
    const envsamp__facing_sum *sum = envsamp__facing_of(job, link);
    const float *v = sum->moment, share = ENVSAMP__FACING_VARIANCE, rest = 1.0f - share;
    float area = sum->area, bright = area * area;
    int side = number % 2, i = number / 2;
    uint32_t *child = &node->child[side][i];

    for (int k = 0; k < 3; k++) {
        node->moment[k][side][i] = v[k];
        node->moment[3 + k][side][i] = 1.002f * (share * area * v[3 + k] + rest * v[k] * v[k])
                                     + ENVSAMP__FACING_FLOOR * bright;
        node->moment[6 + k][side][i] = 2.004f * (share * area * v[6 + k]
                                                 + rest * v[k == 2] * v[k == 0 ? 1 : 2]);
    }
    float spread = bright - (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    *child = envsamp__float_bits(area > 0.0f ? 1.0f / area : 0.0f);
    if (envsamp__facing_cut(job, link) && spread > 0.0f) {
        job->order[link] = (uint32_t)(child - (uint32_t *)job->base.table);
        envsamp__heap_push(&job->tree.heap, (double)(spread / bright * ENVSAMP_SQRTF(area)), link,
                           0);
    }
}

/* The cuts and parts below one link of the tree. Where a part is not cut, all of it is on the
   higher side. */
static void envsamp__facing_fill(envsamp_kd_job *job, envsamp__facing_node *node, uint32_t link)
{
    uint32_t part[15] = { link };

    for (int at = 0; at < 7; at++) {
        const envsamp__cut *cut = envsamp__facing_cut(job, part[at]);

        part[2 * at + 1] = cut ? cut->child[0] : ENVSAMP__NO_PART;
        part[2 * at + 2] = cut ? cut->child[1] : part[at];
        if (cut) {
            node->edge[at] = envsamp__node_cut(job->tree.map, cut->at, cut->axis);
            node->cut[at] = envsamp__with_sign(envsamp__facing_of(job, cut->child[1])
                                               ->cut[2 * cut->axis], cut->axis);
        } else if (part[at] != ENVSAMP__NO_PART) {
            node->cut[at] = envsamp__facing_of(job, part[at])->cut[0];
        }
    }
    for (int i = 0; i < 8; i++)
        if (part[7 + i] != ENVSAMP__NO_PART)
            envsamp__facing_part(job, node, i, part[7 + i]);
}

/* Sums all cuts; then opens the part of the largest key until there are as many nodes as memory for
   them. */
static void envsamp__write_facing(envsamp_kd_job *job, envsamp_kd *kd)
{
    envsamp__facing_node *node = ENVSAMP__ARRAY_OUT(envsamp__facing_node, kd, facing);
    envsamp__heap *heap = &job->tree.heap;
    uint32_t limit = 1 + (uint32_t)job->tree.block_count / ENVSAMP__BLOCKS_PER_FACING;
    uint32_t *words = (uint32_t *)job->base.table, size = sizeof *node / 4, link = job->tree.root;

    for (int i = job->tree.block_count - 2; i >= 0; i--) {      /* children come after parents */
        const envsamp__facing_sum *high = envsamp__facing_of(job, job->tree.cuts[i].child[1]);
        envsamp__facing_sum *sum = envsamp__facing_of(job, (uint32_t)i);

        *sum = *envsamp__facing_of(job, job->tree.cuts[i].child[0]);
        if (!envsamp__facing_cut(job, (uint32_t)i))
            continue;
        sum->cut[1] = high->cut[1];
        sum->cut[3] = high->cut[3];
        sum->area += high->area;
        for (int k = 0; k < 9; k++)
            sum->moment[k] += high->moment[k];
    }
    for (heap->count = 0; envsamp__facing_cut(job, link); node++) {
        envsamp__facing_fill(job, node, link);
        if (++kd->facing_count == limit || heap->count == 0)
            break;
        link = heap->entries[0].item;
        heap->entries[0] = heap->entries[--heap->count];
        envsamp__heap_settle(heap);
        words[job->order[link]] = ENVSAMP__INNER | (kd->facing_at / 4 + size * kd->facing_count);
    }
    envsamp__kd_layout(kd);
}

/* Tile i, and all below it. The density of a block is the area of its place in the unit square over
   its solid angle. */
static void envsamp__write_tile(envsamp_kd_job *job, envsamp_kd *kd, uint32_t i)
{
    const envsamp__tree *tree = &job->tree;
    envsamp__record *tile = ENVSAMP__RECORDS_OUT(kd) + i;
    envsamp__subtree *stack = job->subtrees;
    envsamp__subtree p = { { 0.0f, 1.0f, 0.0f, 1.0f }, { 0.0f, 1.0f, 0.0f, 1.0f }, tree->root,
                           &tile->link, 0 };
    uint32_t bits[2] = { kd->tile_bits_x, kd->tile_bits_y };
    const uint32_t at[2] = { i & ((1u << bits[0]) - 1), i >> bits[0] };

    if (kd->mapping == ENVSAMP_LATLONG)
        p.edge[3] = -0.0f;
    for (int level = 0; level < tree->tile_bits; level++) {     /* down the crown */
        const envsamp__cut *cut = &tree->cuts[p.link];
        uint32_t high = at[cut->axis] >> --bits[cut->axis] & 1;

        p.edge[2 * cut->axis + !high] = envsamp__stored_edge(tree->map, cut->at, cut->axis);
        p.link = cut->child[high];
    }
    ENVSAMP_MEMCPY(tile->edge, p.edge, sizeof tile->edge);
    stack[0] = p;
    for (int top = 0; top >= 0;) {
        p = stack[top--];
        if (!(p.link & ENVSAMP__LEAF)) {
            envsamp__write_cut(job, kd, &p, &stack[top + 2], &stack[top + 1]);
            top += 2;
            continue;
        }
        uint32_t block = p.link & ~ENVSAMP__LEAF;
        double sr = envsamp__edges_sr(kd->mapping, p.edge);
        float pdf = (float)envsamp__max(envsamp__region_area(kd, p.cut) / sr, 0.0);
        *p.child = envsamp__float_bits(pdf);
        job->density[block] = pdf;
        envsamp__add_cost(job, &tree->blocks[block], (double)pdf);
        if (job->facing)
            envsamp__facing_block(kd, &p, i, envsamp__facing_of(job, p.link));
    }
}

/* ---- the build ---- */

#ifndef ENVSAMP_NO_FIT

/* Sorts blocks by their weights, fits the model, and takes their probabilities from it. */
static void envsamp__choose_fit(envsamp_kd_job *job, envsamp_kd *kd)
{
    const envsamp__map *map = &job->base.map;
    const envsamp__tree *tree = &job->tree;
    envsamp__fit fit = { map->desc.model, map->desc.objective, 0, job->target, job->weight,
                         job->lm_scratch };
    double *key = job->probability, total = 0.0;

    for (int i = 0; i < tree->block_count; i++) {
        total += key[i];
        fit.count += key[i] > 0.0;
    }
    envsamp__sort_descending(key, job->order, tree->block_count);
    for (int i = 0; i < tree->block_count; i++)
        job->target[i] = key[job->order[i]] / total;
    envsamp__fit_point best = envsamp__fit_solve(&fit);
    double gamma = envsamp__model_gamma(best.param[1]);
    kd->alpha = envsamp__exp2(best.param[0]);
    kd->beta = best.param[1];
    kd->drawn_count = (uint32_t)fit.count;
    kd->fit_total = envsamp__model_mass(gamma, (double)fit.count / kd->alpha);
    double low = envsamp__model_g(gamma, 0.0);
    for (int i = 0; i < tree->block_count; i++) {
        double high = i < fit.count ? envsamp__model_g(gamma, (double)(i + 1) / kd->alpha) : low;

        key[job->order[i]] = (high - low) / kd->fit_total;
        double error = tree->blocks[job->order[i]].whole.sum / tree->map->integral
                     - key[job->order[i]];
        kd->l1 += ENVSAMP__FABS(error);
        low = high;
    }
}

#endif  /* ENVSAMP_NO_FIT */

/* ALIAS and FIT: edges and density of a block, by its place in the table. */
static void envsamp__write_block(envsamp_kd_job *job, envsamp_kd *kd, uint32_t item)
{
    envsamp__record *record = ENVSAMP__RECORDS_OUT(kd) + item;
    uint32_t number = job->order[item];
    const envsamp__block *b = &job->tree.blocks[number];
    const double at[4] = { b->rect.x0, b->rect.x1, b->rect.y0, b->rect.y1 };
    double probability = job->probability[number], pdf = 0.0;

    for (int i = 0; i < 4; i++)
        record->edge[i] = envsamp__stored_edge(&job->base.map, at[i], i / 2);
    if (probability > 0.0)              /* lit, though a steep fit gives it next to nothing */
        pdf = envsamp__max(probability / envsamp__edges_sr(kd->mapping, record->edge),
                           (double)FLT_MIN);
    job->density[number] = (float)pdf;
    record->link = envsamp__float_bits((float)pdf);
    envsamp__add_cost(job, b, pdf);
}

/* One more tile of WARP, or block; after the last all arrays but the grid. Returns 0 at the end. */
static int envsamp__write_arrays(envsamp_kd_job *job, envsamp_kd *kd, uint32_t item)
{
    const envsamp__map *map = &job->base.map;

    if (kd->select == ENVSAMP_KD_WARP)
        envsamp__write_tile(job, kd, item);
    else
        envsamp__write_block(job, kd, item);
    if (item + 1 < envsamp__record_count(kd))
        return 1;
    if (kd->select == ENVSAMP_KD_WARP)
        kd->block_count = kd->drawn_count = envsamp__tile_count(kd) + job->cut_count;
    kd->integral = map->compensation > 0.0f ? map->full_integral : map->integral;
    kd->excess_variance = envsamp__max(job->second / map->integral / map->integral - 1.0, 0.0);
    kd->mis_compensation = map->compensation;
    kd->bad_pixel_count = map->bad_pixel_count;
    kd->node_count = envsamp__number_nodes(job);
    envsamp__kd_layout(kd);
    if (kd->select == ENVSAMP_KD_ALIAS)
        envsamp__alias_build(job->draws, job->tree.block_count, (int)kd->alias_shift,
                             ENVSAMP__ARRAY_OUT(uint32_t, kd, alias), job->stack);
    envsamp__write_pdf_nodes(job, kd);
    if (job->facing)
        envsamp__write_facing(job, kd);
    return 0;
}

/* What the header says of the build, and how often blocks are drawn. */
static void envsamp__choose(envsamp_kd_job *job, envsamp_kd *kd)
{
    const envsamp__map *map = &job->base.map;
    const envsamp_kd_desc *desc = &map->desc;
    envsamp__tree *tree = &job->tree;
    double *q = job->probability;
    int fit_l1 = desc->select == ENVSAMP_KD_FIT && desc->objective != ENVSAMP_KD_CHI2;

    kd->version = ENVSAMP__KD_VERSION;
    kd->select = desc->select;
    kd->model = desc->model;
    kd->criterion = desc->criterion;
    kd->mapping = map->image.mapping;
    kd->width = (uint32_t)map->image.width;
    kd->height = (uint32_t)map->image.height;
    kd->bilinear = !desc->nearest;
    kd->block_count = kd->drawn_count = (uint32_t)tree->block_count;
    for (int i = 0; i < tree->block_count; i++) {
        envsamp__block *b = &tree->blocks[i];

        b->weight = fit_l1 ? b->whole.sum : envsamp__whole_q(b);
        if (b->weight < DBL_MIN && envsamp__rect_peak(tree->map, &b->rect, 0.0) > 0.0)
            b->weight = DBL_MIN;        /* zero would leave its light unsampled */
        q[i] = b->weight;
        job->order[i] = (uint32_t)i;
    }
    if (kd->select == ENVSAMP_KD_WARP) {
        for (int i = tree->block_count - 2; i >= 0; i--)    /* children come after their parents */
            q[i] = envsamp__link_q(tree, q, tree->cuts[i].child[0])
                 + envsamp__link_q(tree, q, tree->cuts[i].child[1]);
        kd->tile_bits_x = (uint32_t)envsamp__crown_columns(tree, tree->tile_bits);
        kd->tile_bits_y = (uint32_t)tree->tile_bits - kd->tile_bits_x;
        return;
    }
#ifndef ENVSAMP_NO_FIT
    if (kd->select == ENVSAMP_KD_FIT) {
        envsamp__choose_fit(job, kd);
        return;
    }
#endif
    envsamp__round_draws(q, tree->block_count, job->draws);
    for (int i = 0; i < tree->block_count; i++)
        q[i] = (double)job->draws[i] / (double)ENVSAMP__UNIT;
}

/* A description with the numbers that its zeros mean. */
static envsamp_kd_desc envsamp__kd_filled(const envsamp_kd_desc *desc)
{
    envsamp_kd_desc filled;

    ENVSAMP_MEMSET(&filled, 0, sizeof filled);
    if (desc)
        filled = *desc;
    if (filled.block_count == 0)
        filled.block_count = 6144;
    filled.importance_exponent = envsamp__or(filled.importance_exponent, 1.0f);
    return filled;
}

/* Whether the fields that cdf has, too, are in range. */
static int envsamp__reading_valid(const envsamp_kd_desc *filled)
{
    return envsamp__in_range(filled->mis_compensation, 0.0f, 1.0f)
        && envsamp__in_range(filled->importance_exponent, 0.5f, 2.0f);
}

ENVSAMP_DEF envsamp_kd_desc envsamp_kd_defaults(void) { return envsamp__kd_filled(NULL); }

ENVSAMP_DEF envsamp_result envsamp_kd_sizes(const envsamp_image *image,
                                            const envsamp_kd_desc *desc, envsamp_sizes *sizes)
{
    envsamp_kd_desc filled = envsamp__kd_filled(desc);
    envsamp__arena arena = { NULL, 0 };
    envsamp_kd_job job;
    envsamp_kd layout;
    envsamp_result result = envsamp__begin_sizes(image, sizes);

    if (result != ENVSAMP_OK)
        return result;
    if (filled.block_count < 1 || filled.block_count > 1048576
        || (uint32_t)filled.select > ENVSAMP__KD_SELECT_MAX
        || (uint32_t)filled.criterion > ENVSAMP_KD_RANGE
        || (uint32_t)filled.model > ENVSAMP_KD_POWER
        || (uint32_t)filled.objective > ENVSAMP_KD_CHI2
        || !envsamp__reading_valid(&filled)
        || (filled.facing && filled.select != ENVSAMP_KD_WARP)
        || !envsamp__in_range(filled.excess_target, 0.0f, FLT_MAX))
        return ENVSAMP_ERR_PARAM;
    envsamp__kd_carve(&job, image, &filled, &arena);
    ENVSAMP_MEMSET(&layout, 0, sizeof layout);
    layout.select = filled.select;
    layout.block_count = (uint32_t)job.block_limit;
    layout.node_count = layout.block_count / 2 + 1;
    if (filled.select == ENVSAMP_KD_WARP)
        layout.tile_bits_x = (uint32_t)envsamp__most_tile_bits(job.block_limit);
    if (filled.facing)
        layout.facing_count = 1 + (uint32_t)job.block_limit / ENVSAMP__BLOCKS_PER_FACING;
    envsamp__kd_layout(&layout);
    return envsamp__set_sizes(sizes, layout.bytes, arena.used);
}

/* All phases of kd. Returns 0 at the end of one. */
static int envsamp__kd_work(void *work, int item)
{
    envsamp_kd_job *job = (envsamp_kd_job *)work;
    envsamp__job *base = &job->base;
    envsamp_kd *kd = (envsamp_kd *)base->table;
    envsamp__map *map = &base->map;
    envsamp__tree *tree = &job->tree;
    const envsamp_kd_desc *desc = &map->desc;
    double target = (double)desc->excess_target;
    envsamp__level *level;

    switch (base->phase) {
    case ENVSAMP__ROWS:
        base->result = envsamp__map_row(map, item);
        if (item + 1 < map->image.height)
            return 1;
        if (base->result == ENVSAMP_OK && !(map->integral > 0.0))
            base->result = ENVSAMP_ERR_BLACK;
        job->level = 2;
        tree->q_wanted = target > 0.0 ? map->integral * ENVSAMP_SQRT(1.0 + target) : -1.0;
        job->crown_blocks = desc->select != ENVSAMP_KD_WARP ? 1
                          : target > 0.0 && !desc->facing ? 0 : job->block_limit;
        return 0;
    case ENVSAMP__PYRAMID:
        if (job->level >= map->level_count) {
            base->phase = base->is_reread ? (envsamp__phase)(ENVSAMP__MOMENTS - 1) : base->phase;
            return 0;
        }
        level = &map->levels[job->level];
        for (int x = 0; x < level->width && envsamp__is_stale(map, job->level, item); x++)
            envsamp__merge_cells(map, job->level, x, item);
        if (item + 1 == level->height) {
            job->level++;
            base->next = 0;
        }
        return 1;
    case ENVSAMP__CROWN:
        if (item == 0)
            envsamp__crown_begin(tree, envsamp__most_tile_bits(job->crown_blocks));
        return envsamp__crown_step(tree);
    case ENVSAMP__TILES:
        envsamp__heap_push(&tree->heap, envsamp__search_block(tree, &tree->blocks[item]),
                           (uint32_t)item, 1);
        tree->q += envsamp__whole_q(&tree->blocks[item]);
        return item + 1 < tree->block_count;
    case ENVSAMP__SPLITS:
        if (envsamp__split_step(tree, job->block_limit))
            return 1;
        if (job->crown_blocks == 0) {   /* WARP: again, with a crown for as many blocks */
            job->crown_blocks = tree->block_count;
            base->phase = ENVSAMP__PYRAMID;
        }
        return 0;
    case ENVSAMP__MOMENTS:
        if (tree->blocks[item].rough || base->is_reread)
            tree->blocks[item].whole = envsamp__rect_moments(map, &tree->blocks[item].rect);
        return item + 1 < tree->block_count;
    case ENVSAMP__PROBABILITIES:
        if (!base->is_reread)
            envsamp__choose(job, kd);
        envsamp__job_reread(base);
        return 0;
    case ENVSAMP__WRITE:
        return envsamp__write_arrays(job, kd, (uint32_t)item);
    default:
        envsamp__write_grid(kd, (uint32_t)item);
        return item + 1 < 1 << kd->grid_bits_y;
    }
}

ENVSAMP_DEF envsamp_result envsamp_kd_rebuild_begin(const envsamp_image *image, envsamp_row_fn fn,
                                                    void *user, const envsamp_kd_desc *desc,
                                                    int first_row, int row_count,
                                                    envsamp_buffer table, envsamp_buffer scratch,
                                                    envsamp_kd_job **job)
{
    envsamp_kd_desc filled = envsamp__kd_filled(desc);
    envsamp__arena arena = { (char *)scratch.data, 0 };
    envsamp_kd_job *begun = (envsamp_kd_job *)scratch.data;
    envsamp_sizes sizes;

    if (!job)
        return ENVSAMP_ERR_NULL;
    *job = NULL;
    envsamp_result result = envsamp_kd_sizes(image, &filled, &sizes);
    if (result == ENVSAMP_OK)
        result = envsamp__job_check(image, fn, &sizes, table, scratch);
    if (result == ENVSAMP_OK && (first_row < 0 || row_count < 0))
        result = ENVSAMP_ERR_PARAM;
    if (result != ENVSAMP_OK)
        return result;
    if (envsamp__is_surveyed(image, &filled)) {     /* all rows are read */
        first_row = 0;
        row_count = INT_MAX;
    }
    const envsamp__map *last = &begun->base.map;
    if ((first_row > 0 || row_count < image->height)    /* the same map, and all of it as it is */
        && (last->whole != ENVSAMP__WHOLE || last->bilinear != !filled.nearest
            || last->image.width != image->width || last->image.height != image->height
            || last->image.channels != image->channels || last->image.mapping != image->mapping
            || envsamp__is_surveyed(&last->image, &last->desc)))
        return ENVSAMP_ERR_FORMAT;
    envsamp__kd_carve(begun, image, &filled, &arena);
    envsamp__map *map = &begun->base.map;
    map->read_from = map->cells_from = envsamp__min(first_row, image->height);
    map->read_to = map->read_from + envsamp__min(row_count, image->height);
    map->cells_to = map->read_to + map->bilinear;
    ENVSAMP_MEMSET(table.data, 0, sizes.table_bytes);
    envsamp__job_start(&begun->base, table.data, ENVSAMP__KD_MAGIC, envsamp__kd_work, fn, user);
    *job = begun;
    return ENVSAMP_OK;
}

ENVSAMP_DEF envsamp_result envsamp_kd_begin(const envsamp_image *image, envsamp_row_fn fn,
                                            void *user, const envsamp_kd_desc *desc,
                                            envsamp_buffer table, envsamp_buffer scratch,
                                            envsamp_kd_job **job)
{
    return envsamp_kd_rebuild_begin(image, fn, user, desc, 0, INT_MAX, table, scratch, job);
}

ENVSAMP_DEF envsamp_result envsamp_kd_step(envsamp_kd_job *job, int count, int *done)
{
    return job ? envsamp__job_step(&job->base, count, done) : ENVSAMP_ERR_NULL;
}

ENVSAMP_DEF envsamp_result envsamp_kd_finish(envsamp_kd_job *job, const envsamp_kd **kd)
{
    envsamp_result result = kd ? envsamp_kd_step(job, INT_MAX, NULL) : ENVSAMP_ERR_NULL;

    if (kd)
        *kd = result == ENVSAMP_OK ? (const envsamp_kd *)job->base.table : NULL;
    return result;
}

ENVSAMP_DEF envsamp_result envsamp_kd_build_rows(const envsamp_image *image, envsamp_row_fn fn,
                                                 void *user, const envsamp_kd_desc *desc,
                                                 envsamp_buffer table, envsamp_buffer scratch,
                                                 const envsamp_kd **kd)
{
    envsamp_kd_job *job = NULL;
    envsamp_result begun = envsamp_kd_begin(image, fn, user, desc, table, scratch,
                                            kd ? &job : NULL);
    envsamp_result finished = envsamp_kd_finish(job, kd);   /* *kd is NULL without a job */

    return begun == ENVSAMP_OK ? finished : begun;
}

ENVSAMP_DEF envsamp_result envsamp_kd_build(const envsamp_image *image,
                                            const envsamp_kd_desc *desc, envsamp_buffer table,
                                            envsamp_buffer scratch, const envsamp_kd **kd)
{
    return envsamp_kd_build_rows(image, NULL, NULL, desc, table, scratch, kd);
}

#ifdef ENVSAMP_ALLOC

/* Both buffers of a build. Returns ENVSAMP_ERR_MEMORY where one of them cannot be got. */
static envsamp_result envsamp__allocate(const envsamp_sizes *sizes, envsamp_buffer *table,
                                        envsamp_buffer *scratch)
{
    table->data = ENVSAMP_MALLOC(table->bytes = sizes->table_bytes);
    scratch->data = ENVSAMP_MALLOC(scratch->bytes = sizes->scratch_bytes);
    return table->data && scratch->data ? ENVSAMP_OK : ENVSAMP_ERR_MEMORY;
}

/* Frees scratch and, after a failure, the table, which else is returned. */
static void *envsamp__keep_table(envsamp_result got, envsamp_buffer table, envsamp_buffer scratch,
                                 envsamp_result *result)
{
    ENVSAMP_FREE(scratch.data);
    if (got != ENVSAMP_OK)
        ENVSAMP_FREE(table.data);
    if (result)
        *result = got;
    return got == ENVSAMP_OK ? table.data : NULL;
}

ENVSAMP_DEF envsamp_kd *envsamp_kd_new(const envsamp_image *image, const envsamp_kd_desc *desc,
                                       envsamp_result *result)
{
    envsamp_buffer table = { NULL, 0 }, scratch = { NULL, 0 };
    envsamp_sizes sizes;
    envsamp_result got = envsamp_kd_sizes(image, desc, &sizes);
    const envsamp_kd *kd;

    got = got == ENVSAMP_OK ? envsamp__allocate(&sizes, &table, &scratch) : got;
    got = got == ENVSAMP_OK ? envsamp_kd_build(image, desc, table, scratch, &kd) : got;
    return (envsamp_kd *)envsamp__keep_table(got, table, scratch, result);
}

ENVSAMP_DEF void envsamp_kd_free(envsamp_kd *kd) { ENVSAMP_FREE(kd); }

#endif

/* ---- opening ---- */

/* Whether a header describes a table with its arrays where they belong, and a model whose numbers
   agree: then every u0 inverts to a block. */
static int envsamp__kd_header_valid(const envsamp_kd *kd)
{
    envsamp_kd layout;

    if (kd->select > ENVSAMP__KD_SELECT_MAX || kd->tile_bits_x > 10 || kd->tile_bits_y > 10
        || (kd->select != ENVSAMP_KD_WARP && kd->tile_bits_x + kd->tile_bits_y > 0)
        || kd->block_count >> (kd->tile_bits_x + kd->tile_bits_y) < 1
        || kd->model > ENVSAMP_KD_POWER || kd->criterion > ENVSAMP_KD_RANGE
        || kd->bilinear > 1 || !envsamp__in_range(kd->mis_compensation, 0.0f, 1.0f)
        || kd->width < 1 || kd->width > 65535 || kd->height < 1 || kd->height > 65535
        || kd->block_count > 1048576 || kd->node_count < 1 || kd->node_count > 1048576
        || kd->facing_count > (kd->select == ENVSAMP_KD_WARP ? kd->block_count : 0)
        || kd->drawn_count < 1 || kd->drawn_count > kd->block_count)
        return 0;
    ENVSAMP_MEMCPY(&layout, kd, sizeof layout);
    envsamp__kd_layout(&layout);
    if (ENVSAMP_MEMCMP(&layout, kd, sizeof layout))
        return 0;
    if (kd->select != ENVSAMP_KD_FIT)
        return 1;
    if (envsamp__exponent(&kd->alpha, 1) == 0x7ff || envsamp__exponent(&kd->beta, 1) == 0x7ff
        || envsamp__exponent(&kd->fit_total, 1) == 0x7ff
        || !(kd->alpha > 1e-9 && kd->alpha < 1025.0 * (double)kd->drawn_count
             && kd->beta >= ENVSAMP__BETA_MIN && kd->beta <= ENVSAMP__BETA_MAX
             && (kd->model == ENVSAMP_KD_POWER || kd->beta == 1.0)))
        return 0;
    double total = envsamp__model_mass(envsamp__model_gamma(kd->beta), kd->drawn_count / kd->alpha);
    return kd->fit_total >= total * (1.0 - 1e-9) && kd->fit_total <= total * (1.0 + 1e-9);
}

static int envsamp__floats_valid(const float *value, int count, float least, float most)
{
    int valid = 1;

    for (int i = 0; i < count; i++)
        valid &= envsamp__in_range(value[i], least, most);
    return valid;
}

/* Each a float that is finite and not negative, or a place from `low` on and before `end`, some
   whole nodes of `size` words further. */
static int envsamp__links_valid(const uint32_t *link, uint32_t count, uint32_t low, uint32_t end,
                                uint32_t size)
{
    int valid = 1;

    for (uint32_t i = 0; i < count; i++) {
        uint32_t at = link[i] & ~ENVSAMP__INNER;

        valid &= link[i] & ENVSAMP__INNER ? at >= low && at < end && (at - low) % size == 0
                                          : link[i] < 0x7f800000u;
    }
    return valid;
}

/* Children come after their parents, so every descent ends. The cuts of nodes may be anything;
   those of samples are multiples of 2^-24 of the unit square, so that a descent ends with a cut
   below the sample and one above it: their order does not matter. */
static int envsamp__kd_arrays_valid(const envsamp_kd *kd)
{
    const envsamp__record *record = ENVSAMP__RECORDS(kd);
    const envsamp__pdf_node *node = ENVSAMP__ARRAY(envsamp__pdf_node, kd, nodes);
    const envsamp__facing_node *top = ENVSAMP__ARRAY(envsamp__facing_node, kd, facing);
    const uint32_t *bins = ENVSAMP__ARRAY(uint32_t, kd, alias);
    uint32_t at = envsamp__cut_link(kd, 0) & ~ENVSAMP__INNER, cuts_end = kd->alias_at / 4;
    uint32_t nodes = kd->nodes_at / 4, end = kd->grid_at / 4, bits = 24 - kd->alias_shift;
    int valid = envsamp__links_valid(ENVSAMP__ARRAY(uint32_t, kd, grid),
                                     1u << (kd->grid_bits_x + kd->grid_bits_y), nodes, end, 7);

    for (uint32_t i = 0; i < envsamp__record_count(kd); i++)
        valid &= envsamp__edges_valid(kd->mapping, record[i].edge)
              && envsamp__links_valid(&record[i].link, 1, at, cuts_end, 4);
    for (; at < cuts_end; at += 4) {
        const envsamp__sample_node *cut = ENVSAMP__LINKED(envsamp__sample_node, kd, at);
        int axis = envsamp__sign(cut->cut);
        float place = ENVSAMP_FABSF(cut->cut);
        float units = place * (float)(1u << (24 - (axis ? kd->tile_bits_y : kd->tile_bits_x)));

        valid &= envsamp__in_range(place, 0.0f, 1.0f) && (float)(int)units == units
              && envsamp__edge_valid(kd->mapping, cut->edge, axis)
              && envsamp__links_valid(cut->child, 2, at + 4, cuts_end, 4);
    }
    for (uint32_t i = 0; i < 1u << bits && kd->select == ENVSAMP_KD_ALIAS; i++) {
        uint32_t own = bins[i] >> bits, alias = bins[i] & ((1u << bits) - 1);

        valid &= own <= 1u << kd->alias_shift && alias < kd->block_count
              && (own == 0 || i < kd->block_count);
    }
    for (uint32_t i = 0; i < kd->node_count; i++)
        valid &= envsamp__links_valid(node[i].child, 4, nodes + 7 * (i + 1), end, 7);
    at = kd->facing_at / 4;
    end = (uint32_t)kd->bytes / 4;
    for (uint32_t size = sizeof *top / 4; at < end; at += size, top++)
        valid &= envsamp__floats_valid(top->cut, 7, -1.0f, 1.0f)
              && envsamp__floats_valid(top->edge, 7, -2.0f, 4.0f)
              && envsamp__links_valid((const uint32_t *)(const void *)top->child, 8, at + size, end,
                                      size)
              && envsamp__floats_valid((const float *)(const void *)top->moment, 72, -4.0f, 4.0f);
    return valid;
}

ENVSAMP_DEF envsamp_result envsamp_kd_open(const void *table, size_t bytes, const envsamp_kd **kd)
{
    const envsamp_kd *header = (const envsamp_kd *)table;

    if (!kd)
        return ENVSAMP_ERR_NULL;
    envsamp_result result = envsamp__table_check(table, bytes, sizeof *header, ENVSAMP__KD_MAGIC,
                                                 ENVSAMP__KD_VERSION);
    if (result == ENVSAMP_OK
        && !(envsamp__kd_header_valid(header) && envsamp__kd_arrays_valid(header)))
        result = ENVSAMP_ERR_FORMAT;
    *kd = result == ENVSAMP_OK ? header : NULL;
    return result;
}

ENVSAMP_DEF size_t envsamp_kd_bytes(const envsamp_kd *kd)
{
    ENVSAMP_ASSERT(kd);
    return (size_t)kd->bytes;
}

/* ============================================================================================
 * KD SAMPLING AND DENSITY                                               [search: @kd-sampling]
 * ========================================================================================== */

/* ---- sampling ---- */

/* A block, and where a sample lies in it: azimuth and solid angle from its upper edge, [0, 1]. */
typedef struct envsamp__choice { int block; float fx, fy; } envsamp__choice;

/* See KD TABLE. What is left of u0 is the azimuth, and where the draw lies among those of the block
   the polar angle. Each bin has its draws in an order of its own, by a multiple of the golden
   ratio: those of a coarse u1 would all be low ones, and dim blocks drawn too often. */
ENVSAMP__HOT envsamp__choice envsamp__alias_choose(const envsamp_kd *kd, float u0, float u1)
{
    int shift = (int)kd->alias_shift, bits_x = 12 - (shift >> 1), shift_y = shift + bits_x;
    float across = u0 * (float)(1 << bits_x);
    int column = (int)across, y = (int)(u1 * ENVSAMP__UNIT);
    int bin = (y >> shift & -(1 << bits_x)) | column;
    int entry = (int)ENVSAMP__ARRAY(uint32_t, kd, alias)[bin];
    int alias = entry & (((1 << 24) - 1) >> shift), own = entry ^ alias;    /* of 2^24 */
    uint32_t mixed = (uint32_t)y << (32 - shift_y) ^ ~(uint32_t)bin * 0x9e3779b9u;
    int past = (int)(mixed >> 8) - own, chosen = -(past < 0);   /* all ones for its own */
    envsamp__choice choice;

    choice.block = alias ^ ((bin ^ alias) & chosen);
    choice.fx = across - (float)column;
    choice.fy = (float)past / (float)((~chosen & (1 << 24)) - own);
    return choice;
}

/* How far into a bin the model's mass has come at the fraction f of it: the density falls inside a
   bin, so this is not f. a is alpha plus the bin's index. */
ENVSAMP__HOT float envsamp__fit_position(const envsamp_kd *kd, float f, float a)
{
    float w = f / (2.0f * a + f), v = 1.0f / (2.0f * a + 1.0f), t = w * w, s = v * v;

    if (kd->model == ENVSAMP_KD_POWER || a < 1.0f) {
        double gamma = envsamp__model_gamma(kd->beta), step = 1.0 / (double)a;

        return (float)(envsamp__model_mass(gamma, (double)f * step)
                       / envsamp__model_mass(gamma, step));
    }
    /* log(1 + f/a) / log(1 + 1/a) = atanh w / atanh v, both series within 2e-6 */
    return (2.0f * a + 1.0f) * w
         * (1.0f + t * (1.0f / 3 + t * (1.0f / 5 + t * (1.0f / 7 + t * (1.0f / 9)))))
         * (1.0f - s * (1.0f / 3 + s * (4.0f / 45 + s * (44.0f / 945 + s * (428.0f / 14175)))));
}

/* x = P^-1(u0) [1, equation 8]; the block is its whole part. What u1 holds beyond its leading 12
   bits continues u0: half a turn on, so that it is 1/2, not 0, for points of a coarse lattice. */
ENVSAMP__HOT envsamp__choice envsamp__fit_choose(const envsamp_kd *kd, float u0, float u1)
{
    float low = u1 * 4096.0f + 0.5f;
    envsamp__choice choice;

    low -= (float)(int)low;
    double g = ((double)u0 + (double)(low / ENVSAMP__UNIT)) * kd->fit_total;
    if (kd->model == ENVSAMP_KD_POWER) {
        double gamma = envsamp__model_gamma(kd->beta);

        g = gamma == 0.0 ? g : envsamp__log2(1.0 + gamma * g) / gamma;
    }
    float x = kd->fit_alpha * envsamp__exp2m1(g);
    x = envsamp__at_most(x > 0.0f ? x : 0.0f, kd->fit_end);
    choice.block = (int)x;
    choice.fx = envsamp__fit_position(kd, x - (float)choice.block,
                                      kd->fit_alpha + (float)choice.block);
    choice.fy = u1;
    return choice;
}

/* ALIAS and FIT: a point and its density. Indices are written so that compilers make them
   gathers. */
ENVSAMP__HOT envsamp__point envsamp__indexed_sample(const envsamp_kd *kd, int alias, float u0,
                                                    float u1, float *pdf)
{
    const float *block = (const float *)(const void *)ENVSAMP__RECORDS(kd);
    envsamp__choice choice = alias || ENVSAMP__KD_SELECT_MAX < ENVSAMP_KD_FIT
                           ? envsamp__alias_choose(kd, u0, u1) : envsamp__fit_choose(kd, u0, u1);
    int at = 5 * choice.block;

    *pdf = block[at + 4];
    return envsamp__between(block[at], block[at + 1], choice.fx, block[at + 2], block[at + 3],
                            choice.fy);
}

/* The tile of two numbers, f, which become the place in it. cut and edge: see enter_tile. */
ENVSAMP__HOT uint32_t envsamp__warp_start(const envsamp_kd *kd, float *f, float *cut, float *edge,
                                          size_t stride)
{
    float across = f[0] * (float)(1 << kd->tile_bits_x);
    float down = f[stride] * (float)(1 << kd->tile_bits_y);
    int column = (int)across, row = (int)down;

    f[0] = across - (float)column;
    f[stride] = down - (float)row;
    return envsamp__enter_tile(kd, (row << kd->tile_bits_x) + column, cut, edge, stride);
}

ENVSAMP__HOT uint32_t envsamp__warp_step(const envsamp_kd *kd, uint32_t link, const float *f,
                                         float *cut, float *edge, size_t stride)
{
    const envsamp__sample_node *node = ENVSAMP__LINKED(envsamp__sample_node, kd, link);
    float at = f[(envsamp__float_bits(node->cut) >> 31) * stride];

    return envsamp__take_side(node, at >= ENVSAMP_FABSF(node->cut), cut, edge, stride);
}

ENVSAMP__HOT envsamp__point envsamp__warp_point(const float *f, const float *cut,
                                                const float *edge, size_t stride)
{
    return envsamp__between(edge[0], edge[stride], (f[0] - cut[0]) / (cut[stride] - cut[0]),
                            edge[2 * stride], edge[3 * stride],
                            (f[stride] - cut[2 * stride]) / (cut[3 * stride] - cut[2 * stride]));
}

ENVSAMP_DEVICE ENVSAMP_DEF envsamp_sample envsamp_kd_sample(const envsamp_kd *kd, float u0,
                                                            float u1)
{
    float f[2], cut[4], edge[4], pdf;
    envsamp__point p;

    ENVSAMP_ASSERT(kd);
    f[0] = envsamp__clamp_unit(u0);
    f[1] = envsamp__clamp_unit(u1);
    if (kd->select != ENVSAMP_KD_WARP) {
        p = envsamp__indexed_sample(kd, kd->select == ENVSAMP_KD_ALIAS, f[0], f[1], &pdf);
    } else {
        uint32_t link = envsamp__warp_start(kd, f, cut, edge, 1);
        while (link & ENVSAMP__INNER)
            link = envsamp__warp_step(kd, link, f, cut, edge, 1);
        pdf = envsamp__bits_float(link);
        p = envsamp__warp_point(f, cut, edge, 1);
    }
    return envsamp__point_sample(kd->mapping, p, pdf);
}

/* ---- density ---- */

/* A place as the bits of its coordinates, and the link of the grid there. */
ENVSAMP__HOT uint32_t envsamp__grid_link(const envsamp_kd *kd, envsamp__l1_coords d,
                                         uint64_t *place)
{
    float columns = (float)(1 << kd->grid_bits_x), rows = (float)(1 << kd->grid_bits_y);
    float scale = kd->mapping == ENVSAMP_HEMISPHERE ? rows : 0.5f * rows;
    uint32_t column = envsamp__index(d.azimuth * (0.25f * columns), 1u << kd->grid_bits_x);
    uint32_t row = envsamp__index(d.polar * scale, 1u << kd->grid_bits_y);
    int cell = (int)((row << kd->grid_bits_x) + column);

    *place = envsamp__float_bits(d.azimuth) | (uint64_t)envsamp__float_bits(d.polar) << 32;
    return ENVSAMP__ARRAY(uint32_t, kd, grid)[cell] & (0u - (uint32_t)d.valid);
}

#define ENVSAMP__STRIDES 2      /* nodes before a density asks whether it has arrived: each question
                                   may be guessed wrong, each node too many costs a little */

/* Whether a place is on the higher side of a cut, without a branch: of its two coordinates the sign
   of the cut picks one. Floats of 0 and more compare as integers, which keeps the chain from link
   to link short; that chain is what a density costs. */
ENVSAMP__HOT uint32_t envsamp__is_high(float cut, uint64_t place)
{
    uint32_t bits = envsamp__float_bits(cut);

    return (uint32_t)(place >> (bits >> 26 & 32)) >= (bits & 0x7fffffffu);
}

/* Two cuts on the way down. Given a density it reads the header, and callers drop the result. */
ENVSAMP__HOT uint32_t envsamp__node_step(const envsamp_kd *kd, uint32_t link, uint64_t place)
{
    const envsamp__pdf_node *node = ENVSAMP__LINKED(envsamp__pdf_node, kd,
                                                    link & (0u - (link >> 31)));
    uint32_t top = envsamp__is_high(node->cut[0], place);

    return node->child[2 * top + envsamp__is_high(node->cut[1 + top], place)];
}

/* The density in a direction, and its place. */
ENVSAMP_DEVICE static float envsamp__density(const envsamp_kd *kd, const float dir[3],
                                             uint64_t *place)
{
    float r = ENVSAMP_SQRTF(dir[0] * dir[0] + dir[1] * dir[1]);
    uint32_t link = envsamp__grid_link(kd, envsamp__dir_to_grid(kd->mapping, dir[0], dir[1],
                                                                dir[2], r), place);

    do {
        for (int i = 0; i < ENVSAMP__STRIDES; i++)
            link ^= (link ^ envsamp__node_step(kd, link, *place)) & (0u - (link >> 31));
    } while (link & ENVSAMP__INNER);
    return envsamp__bits_float(link);
}

ENVSAMP_DEVICE ENVSAMP_DEF float envsamp_kd_pdf(const envsamp_kd *kd, const float dir[3])
{
    uint64_t place;

    ENVSAMP_ASSERT(kd && dir);
    return envsamp__density(kd, dir, &place);
}

/* ---- light x cosine ----
 *
 * A walk down the top of the tree, before the sample of light alone. Each node has eight parts. A
 * part is taken in proportion to its weight w, and at every cut the number of its axis is stretched
 * to [0, 1].
 *
 * c is the cosine between the normal and a direction that a part draws. The mean of max(c, 0) is
 * (E[c] + E[|c|]) / 2. E[|c|] is taken as the root of E[c]^2 + 3/4 of the variance of c: exact
 * where c spreads evenly about 0. So w, twice the mean, is a sum of three products plus the root of
 * a sum of six. A factor of 1.002 keeps it above what rounding takes. FACING_FLOOR keeps it at 1/32
 * of the most that it can be at the horizon, 1/670 opposite the normal: a lamp at grazing angle may
 * be what a glossy surface shows. What else was tried: bench/experiments.md.
 */

/* A normal, scaled so that nothing overflows, and its products as facing_sum has them; 0 for what
   is none. Shares of weights do not depend on its length. */
ENVSAMP__HOT int envsamp__facing_normal(const envsamp_kd *kd, const float normal[3], float n[9])
{
    float most = 0.0f;
    int valid = kd->facing_count > 0;

    for (int i = 0; i < 3; i++) {
        float size = envsamp__bits_float(envsamp__float_bits(normal[i]) & 0x7fffffffu);

        valid &= envsamp__float_bits(size) < 0x7f800000u;
        most = size > most ? size : most;
    }
    if (!valid || !(most >= FLT_MIN))
        return 0;
    for (int i = 0; i < 3; i++) {
        n[i] = normal[i] / most;
        n[3 + i] = n[i] * n[i];
    }
    n[6] = n[0] * n[1];
    n[7] = n[0] * n[2];
    n[8] = n[1] * n[2];
    return 1;
}

#define ENVSAMP__LEAST_WEIGHT 1e-30f    /* less than the rounding of what a lit part weighs */

/* Weights of the parts of a node, lower and higher ones, and of pairs of them; 0 or more, and not
   all 0, also in a damaged table. */
typedef struct envsamp__weights { float part[2][4], pair[4]; } envsamp__weights;

ENVSAMP__HOT void envsamp__facing_weigh(const envsamp__facing_node *node, const float n[9],
                                        envsamp__weights *w)
{
    const float (*m)[2][4] = node->moment;

    for (int k = 0; k < 2; k++) {
        float mean[4], square[4];

        for (int i = 0; i < 4; i++) {
            mean[i] = m[0][k][i] * n[0] + m[1][k][i] * n[1] + m[2][k][i] * n[2];
            square[i] = (m[3][k][i] * n[3] + m[4][k][i] * n[4] + m[5][k][i] * n[5])
                      + (m[6][k][i] * n[6] + m[7][k][i] * n[7] + m[8][k][i] * n[8]);
        }
        envsamp__sqrt_n(square, 4);
        for (int i = 0; i < 4; i++)
            w->part[k][i] = mean[i] + square[i] > ENVSAMP__LEAST_WEIGHT ? mean[i] + square[i]
                                                                        : 0.0f;
    }
    w->part[1][3] += ENVSAMP__LEAST_WEIGHT;     /* the last: no number reaches it by that */
    for (int i = 0; i < 4; i++)
        w->pair[i] = w->part[0][i] + w->part[1][i];
}

#define ENVSAMP__CACHED 32      /* the first nodes, which are the top of the tree */

/* A normal, and, where many numbers share it, the weights that are known of the first nodes. */
typedef struct envsamp__facing_cache {
    envsamp__weights w[ENVSAMP__CACHED];
    float n[9];
    uint32_t known;
} envsamp__facing_cache;

ENVSAMP__HOT const envsamp__weights *envsamp__facing_weights(const envsamp_kd *kd,
                                                             const envsamp__facing_node *node,
                                                             const float n[9],
                                                             envsamp__facing_cache *cache,
                                                             envsamp__weights *own)
{
    size_t number = (size_t)(node - ENVSAMP__ARRAY(envsamp__facing_node, kd, facing));

    if (cache && number < ENVSAMP__CACHED) {
        own = &cache->w[number];
        if (cache->known >> number & 1)
            return own;
        cache->known |= 1u << number;
    }
    envsamp__facing_weigh(node, n, own);
    return own;
}

/* Takes the side of a cut that a number is on, by the weights of both, and stretches it. bound: the
   part of the unit square so far, in the order x0, x1, y0, y1. */
ENVSAMP__HOT uint32_t envsamp__facing_side(float cut, float low, float high, float f[2],
                                           float bound[4])
{
    uint32_t axis = envsamp__float_bits(cut) >> 31;
    float start[2] = { 0.0f, 0.0f }, size[2], place = f[axis] * (low + high);

    start[1] = size[0] = low;
    size[1] = high;
    uint32_t side = place >= low;
    f[axis] = envsamp__clamp_unit((place - start[side]) / size[side]);
    bound[2 * axis + 1 - side] = ENVSAMP_FABSF(cut);
    return side;
}

/* The way down of two numbers: what is left of them, the part of the unit square so far, its weight
   among all, and the link to its node or to one over its area. */
typedef struct envsamp__facing_walk { float f[2], bound[4], ratio; uint32_t link; }
    envsamp__facing_walk;

ENVSAMP__HOT envsamp__facing_walk envsamp__facing_start(const envsamp_kd *kd, float u0, float u1)
{
    envsamp__facing_walk walk = { { u0, u1 }, { 0.0f, 1.0f, 0.0f, 1.0f }, 1.0f,
                                  ENVSAMP__INNER | kd->facing_at / 4 };

    return walk;
}

ENVSAMP__HOT void envsamp__facing_step(const envsamp_kd *kd, const float n[9],
                                       envsamp__facing_cache *cache, envsamp__facing_walk *walk)
{
    const envsamp__facing_node *node = ENVSAMP__LINKED(envsamp__facing_node, kd, walk->link);
    envsamp__weights own;
    const envsamp__weights *w = envsamp__facing_weights(kd, node, n, cache, &own);
    float low = w->pair[0] + w->pair[1], high = w->pair[2] + w->pair[3];
    uint32_t at = envsamp__facing_side(node->cut[0], low, high, walk->f, walk->bound);

    at = 2 * at + envsamp__facing_side(node->cut[1 + at], w->pair[2 * at], w->pair[2 * at + 1],
                                       walk->f, walk->bound);
    uint32_t side = envsamp__facing_side(node->cut[3 + at], w->part[0][at], w->part[1][at], walk->f,
                                         walk->bound);
    walk->ratio *= w->part[side][at] / (low + high);
    walk->link = node->child[side][at];
}

/* The numbers with which light alone draws there. Returns what multiplies its density. */
ENVSAMP__HOT float envsamp__facing_end(const envsamp__facing_walk *walk, float *f, size_t stride)
{
    for (size_t axis = 0; axis < 2; axis++) {
        float low = walk->bound[2 * axis], high = walk->bound[2 * axis + 1];
        float at = envsamp__at_most(low + walk->f[axis] * (high - low),
                                    envsamp__bits_float(envsamp__float_bits(high) - 1));

        f[axis * stride] = envsamp__clamp_unit(at);     /* of a damaged table, anything */
    }
    return envsamp__saturate(walk->ratio) * envsamp__bits_float(walk->link);
}

/* Changes two numbers such that light alone draws what light x cosine should. Returns what that
   multiplies the density by. */
ENVSAMP__HOT float envsamp__facing_warp(const envsamp_kd *kd, const float n[9], float f[2])
{
    envsamp__facing_walk walk = envsamp__facing_start(kd, f[0], f[1]);

    do {
        envsamp__facing_step(kd, n, NULL, &walk);
    } while (walk.link & ENVSAMP__INNER);
    return envsamp__facing_end(&walk, f, 1);
}

/* The density at a place where that of light alone is `pdf`. */
ENVSAMP__HOT float envsamp__facing_density(const envsamp_kd *kd, const float n[9],
                                           envsamp__facing_cache *cache, uint64_t place,
                                           float pdf)
{
    const envsamp__facing_node *node = ENVSAMP__ARRAY(envsamp__facing_node, kd, facing);
    float ratio = 1.0f;
    envsamp__weights own;
    uint32_t link;

    do {
        const envsamp__weights *w = envsamp__facing_weights(kd, node, n, cache, &own);
        uint32_t at = envsamp__is_high(node->edge[0], place);
        at = 2 * at + envsamp__is_high(node->edge[1 + at], place);
        uint32_t side = envsamp__is_high(node->edge[3 + at], place);
        ratio *= w->part[side][at] / ((w->pair[0] + w->pair[1]) + (w->pair[2] + w->pair[3]));
        link = node->child[side][at];
        node = ENVSAMP__LINKED(envsamp__facing_node, kd, link);
    } while (link & ENVSAMP__INNER);
    return envsamp__at_most(pdf * envsamp__saturate(ratio) * envsamp__bits_float(link), FLT_MAX);
}

ENVSAMP_DEVICE ENVSAMP_DEF envsamp_sample envsamp_kd_sample_facing(const envsamp_kd *kd,
                                                                   const float normal[3],
                                                                   float u0, float u1)
{
    float n[9], f[2], ratio = 1.0f;

    ENVSAMP_ASSERT(kd && normal);
    f[0] = envsamp__clamp_unit(u0);
    f[1] = envsamp__clamp_unit(u1);
    if (envsamp__facing_normal(kd, normal, n))
        ratio = envsamp__facing_warp(kd, n, f);
    envsamp_sample s = envsamp_kd_sample(kd, f[0], f[1]);
    s.pdf = envsamp__at_most(s.pdf * ratio, FLT_MAX);
    return s;
}

ENVSAMP_DEVICE ENVSAMP_DEF float envsamp_kd_pdf_facing(const envsamp_kd *kd,
                                                       const float normal[3],
                                                       const float dir[3])
{
    uint64_t place;
    float n[9];

    ENVSAMP_ASSERT(kd && normal && dir);
    float pdf = envsamp__density(kd, dir, &place);
    if (!(pdf > 0.0f) || !envsamp__facing_normal(kd, normal, n))
        return pdf;
    return envsamp__facing_density(kd, n, NULL, place, pdf);
}

/* ---- many at a time ---- */

/* Follows the links of a batch to their densities, one step of each that is still under way at a
   time: down the nodes at its place, or, if `place` is NULL, down the cuts, as warp_step. */
ENVSAMP__HOT void envsamp__batch_walk(const envsamp_kd *kd, uint32_t *link, const uint64_t *place,
                                      const float *f, float *cut, float *edge)
{
    uint32_t list[ENVSAMP__BATCH], count = 0, left, i;

    for (i = 0; i < ENVSAMP__BATCH; i++) {
        list[count] = i;
        count += link[i] >> 31;
    }
    for (; count > 0; count = left)
        for (uint32_t k = left = 0; k < count; k++) {
            i = list[k];
            link[i] = place ? envsamp__node_step(kd, link[i], place[i])
                    : envsamp__warp_step(kd, link[i], f + i, cut + i, edge + i, ENVSAMP__BATCH);
            list[left] = i;
            left += link[i] >> 31;
        }
}

ENVSAMP__HOT void envsamp__indexed_batch(const envsamp_kd *kd, int alias, const float *u,
                                         float *batch)
{
    for (int i = 0; i < ENVSAMP__BATCH; i++) {
        float pdf;
        envsamp__point p = envsamp__indexed_sample(kd, alias, u[i], u[ENVSAMP__BATCH + i], &pdf);

        envsamp__batch_put(batch, i, p, pdf);
    }
}

/* f: the numbers, which become fractions of blocks. */
ENVSAMP__HOT void envsamp__warp_batch(const envsamp_kd *kd, float *f, float *batch)
{
    float *cut = batch, edge[4 * ENVSAMP__BATCH];
    uint32_t link[ENVSAMP__BATCH];

    for (int i = 0; i < ENVSAMP__BATCH; i++)
        link[i] = envsamp__warp_start(kd, f + i, cut + i, edge + i, ENVSAMP__BATCH);
    envsamp__batch_walk(kd, link, NULL, f, cut, edge);
    for (int i = 0; i < ENVSAMP__BATCH; i++) {
        envsamp__point p = envsamp__warp_point(f + i, cut + i, edge + i, ENVSAMP__BATCH);

        envsamp__batch_put(batch, i, p, envsamp__bits_float(link[i]));
    }
}

/* Changes numbers as facing_warp, one node at a time of all that are still under way. */
static void envsamp__facing_batch(const envsamp_kd *kd, envsamp__facing_cache *cache,
                                  uint32_t count, float *f, float *ratio)
{
    envsamp__facing_walk walk[ENVSAMP__BATCH];
    uint32_t link = ENVSAMP__INNER;

    for (uint32_t i = 0; i < count; i++)
        walk[i] = envsamp__facing_start(kd, f[i], f[ENVSAMP__BATCH + i]);
    while (link & ENVSAMP__INNER)
        for (uint32_t i = link = 0; i < count; i++)
            if (walk[i].link & ENVSAMP__INNER) {
                envsamp__facing_step(kd, cache->n, cache, &walk[i]);
                link |= walk[i].link;
            }
    for (uint32_t i = 0; i < count; i++)
        ratio[i] = envsamp__facing_end(&walk[i], f + i, ENVSAMP__BATCH);
}

/* Loops are over a whole batch, filled up with whatever there is: compilers vectorise them. */
ENVSAMP_DEF void envsamp_kd_sample_facing_n(const envsamp_kd *kd, const float normal[3], size_t n,
                                            const float *u0, const float *u1, float *x, float *y,
                                            float *z, float *pdf)
{
    float f[2 * ENVSAMP__BATCH], ratio[ENVSAMP__BATCH], batch[4 * ENVSAMP__BATCH] = { 0.0f };
    float *density = batch + 3 * ENVSAMP__BATCH;
    envsamp__facing_cache cache;

    ENVSAMP_ASSERT(kd && n <= SIZE_MAX / 8 && ((u0 && u1 && x && y && z && pdf) || !n));
    int facing = normal && envsamp__facing_normal(kd, normal, cache.n);
    cache.known = 0;
    for (size_t start = 0; start < n; start += ENVSAMP__BATCH) {
        int count = n - start < ENVSAMP__BATCH ? (int)(n - start) : ENVSAMP__BATCH;
        const float *u[2] = { u0 + start, u1 + start };

        for (int k = 0; k < 2 && count < ENVSAMP__BATCH; k++)
            u[k] = (const float *)ENVSAMP_MEMCPY(batch + k * ENVSAMP__BATCH, u[k],
                                                 (size_t)count * sizeof **u);
        for (int i = 0; i < ENVSAMP__BATCH; i++) {
            f[i] = envsamp__clamp_unit(u[0][i]);
            f[ENVSAMP__BATCH + i] = envsamp__clamp_unit(u[1][i]);
        }
        if (facing)
            envsamp__facing_batch(kd, &cache, (uint32_t)count, f, ratio);
        if (kd->select == ENVSAMP_KD_WARP)
            envsamp__warp_batch(kd, f, batch);
        else if (kd->select == ENVSAMP_KD_ALIAS)
            envsamp__indexed_batch(kd, 1, f, batch);
        else
            envsamp__indexed_batch(kd, 0, f, batch);
        for (int i = 0; i < count && facing; i++)
            density[i] = envsamp__at_most(density[i] * ratio[i], FLT_MAX);
        envsamp__batch_out(kd->mapping, count, batch, x + start, y + start, z + start,
                           pdf + start);
    }
}

ENVSAMP_DEF void envsamp_kd_sample_n(const envsamp_kd *kd, size_t n, const float *u0,
                                     const float *u1, float *x, float *y, float *z, float *pdf)
{
    envsamp_kd_sample_facing_n(kd, NULL, n, u0, u1, x, y, z, pdf);
}

ENVSAMP_DEF void envsamp_kd_pdf_facing_n(const envsamp_kd *kd, const float normal[3], size_t n,
                                         const float *x, const float *y, const float *z,
                                         float *pdf)
{
    float d[3][ENVSAMP__BATCH] = { { 0.0f } }, r[ENVSAMP__BATCH];
    uint64_t place[ENVSAMP__BATCH];
    uint32_t link[ENVSAMP__BATCH];
    envsamp__facing_cache cache;

    ENVSAMP_ASSERT(kd && n <= SIZE_MAX / 8 && ((x && y && z && pdf) || !n));
    float end = envsamp__polar_end(kd->mapping);
    int octahedral = kd->mapping == ENVSAMP_OCTAHEDRAL;
    int facing = normal && envsamp__facing_normal(kd, normal, cache.n);
    cache.known = 0;
    for (size_t start = 0; start < n; start += ENVSAMP__BATCH) {
        int count = n - start < ENVSAMP__BATCH ? (int)(n - start) : ENVSAMP__BATCH;
        size_t bytes = (size_t)count * sizeof(float);

        ENVSAMP_MEMCPY(d[0], x + start, bytes);
        ENVSAMP_MEMCPY(d[1], y + start, bytes);
        ENVSAMP_MEMCPY(d[2], z + start, bytes);
        for (int i = 0; i < ENVSAMP__BATCH; i++)
            r[i] = d[0][i] * d[0][i] + d[1][i] * d[1][i];
        envsamp__sqrt_n(r, ENVSAMP__BATCH);
        for (int i = 0; i < ENVSAMP__BATCH && octahedral; i++)
            link[i] = envsamp__grid_link(kd, envsamp__dir_to_grid(ENVSAMP_OCTAHEDRAL, d[0][i],
                                                                  d[1][i], d[2][i], r[i]),
                                         &place[i]);
        for (int i = 0; i < ENVSAMP__BATCH && !octahedral; i++) {
            envsamp__l1_coords at = envsamp__to_l1_coords(d[0][i], d[1][i], d[2][i], r[i]);

            at.valid &= at.polar <= end;
            link[i] = envsamp__grid_link(kd, at, &place[i]);
        }
        envsamp__batch_walk(kd, link, place, NULL, NULL, NULL);
        for (int i = 0; i < count && facing; i++)
            if (link[i])
                link[i] = envsamp__float_bits(envsamp__facing_density(
                    kd, cache.n, &cache, place[i], envsamp__bits_float(link[i])));
        ENVSAMP_MEMCPY(pdf + start, link, bytes);
    }
}

ENVSAMP_DEF void envsamp_kd_pdf_n(const envsamp_kd *kd, size_t n, const float *x, const float *y,
                                  const float *z, float *pdf)
{
    envsamp_kd_pdf_facing_n(kd, NULL, n, x, y, z, pdf);
}

/* ---- inverse ---- */

/* The way down the nodes, one cut at a time: a link to a node, and which of its cuts. */
typedef struct envsamp__descent { uint32_t link, cut; } envsamp__descent;

/* Which side of the next cut a place is on: 2 x its axis + whether it is the higher one. */
ENVSAMP__MATH uint32_t envsamp__descend(const envsamp_kd *kd, uint64_t place, envsamp__descent *d)
{
    if (!(d->link & ENVSAMP__INNER))        /* of a damaged table */
        return 0;
    const envsamp__pdf_node *node = ENVSAMP__LINKED(envsamp__pdf_node, kd, d->link);
    float cut = node->cut[d->cut];
    uint32_t high = envsamp__is_high(cut, place);
    d->cut = 2 * d->cut + 1 + high;
    if (d->cut > 2) {
        d->link = node->child[d->cut - 3];
        d->cut = 0;
    }
    return 2 * (uint32_t)envsamp__sign(cut) + high;
}

/* envsamp_kd_invert, and the place of the direction. Both trees of the table divide the map alike:
   that of densities tells the side of each cut. */
ENVSAMP_DEVICE static int envsamp__invert(const envsamp_kd *kd, const float dir[3], float u[2],
                                          uint64_t *place)
{
    const uint32_t bits[2] = { kd->tile_bits_x, kd->tile_bits_y };
    uint32_t tile[2] = { 0, 0 }, link;
    envsamp__descent down;
    float cut[4], edge[4];

    u[0] = u[1] = 0.0f;
    envsamp__l1_coords d = envsamp__dir_to_grid(kd->mapping, dir[0], dir[1] + 0.0f, dir[2],
                                                ENVSAMP_SQRTF(dir[0] * dir[0] + dir[1] * dir[1]));
    if (kd->select != ENVSAMP_KD_WARP || !d.valid)
        return 0;
    envsamp__grid_link(kd, d, place);
    down.link = ENVSAMP__INNER | kd->nodes_at / 4;
    down.cut = envsamp__float_bits(ENVSAMP__ARRAY(envsamp__pdf_node, kd, nodes)->cut[0]) ? 0 : 2;
    for (uint32_t level = bits[0] + bits[1]; level > 0; level--) {
        uint32_t side = envsamp__descend(kd, *place, &down);

        tile[side >> 1] = 2 * tile[side >> 1] + (side & 1);
    }
    tile[0] &= (1u << bits[0]) - 1;                     /* of a damaged table, anything */
    tile[1] &= (1u << bits[1]) - 1;
    link = envsamp__enter_tile(kd, (int)((tile[1] << bits[0]) + tile[0]), cut, edge, 1);
    while (link & ENVSAMP__INNER)
        link = envsamp__take_side(ENVSAMP__LINKED(envsamp__sample_node, kd, link),
                                  envsamp__descend(kd, *place, &down) & 1, cut, edge, 1);
    if (!link || !envsamp__edges_valid(kd->mapping, edge))     /* not so in a damaged table */
        return 0;
    envsamp__exact e = envsamp__dir_exact(kd->mapping, dir);
    const double f[2] = { (e.x - (double)edge[0]) / ((double)edge[1] - (double)edge[0]),
                          envsamp__exact_between(e, edge[2], edge[3]) };
    for (int i = 0; i < 2; i++) {
        double scale = 1.0 / (double)(1u << bits[i]), low = (double)tile[i] + (double)cut[2 * i];
        double high = (double)tile[i] + (double)cut[2 * i + 1];
        uint32_t end = envsamp__float_bits((float)(high * scale));      /* is of the next block */

        u[i] = envsamp__at_most((float)((low + envsamp__clamp(f[i], 0.0, 1.0) * (high - low))
                                        * scale), envsamp__bits_float(end - (end > 0)));
    }
    return 1;
}

ENVSAMP_DEVICE ENVSAMP_DEF int envsamp_kd_invert(const envsamp_kd *kd, const float dir[3],
                                                 float u[2])
{
    uint64_t place;

    ENVSAMP_ASSERT(kd && dir && u);
    return envsamp__invert(kd, dir, u, &place);
}

/* The numbers of which facing_warp makes those of light alone. */
ENVSAMP_DEVICE ENVSAMP_DEF int envsamp_kd_invert_facing(const envsamp_kd *kd,
                                                        const float normal[3],
                                                        const float dir[3], float u[2])
{
    float n[9], bound[4] = { 0.0f, 1.0f, 0.0f, 1.0f }, sum[15];
    double start[2] = { 0.0, 0.0 }, size[2] = { 1.0, 1.0 };
    envsamp__weights w;
    uint32_t link, high, at;
    uint64_t place;
    int axis;

    ENVSAMP_ASSERT(kd && normal && dir && u);
    if (!envsamp__invert(kd, dir, u, &place))
        return 0;
    if (!envsamp__facing_normal(kd, normal, n))
        return 1;
    const envsamp__facing_node *node = ENVSAMP__ARRAY(envsamp__facing_node, kd, facing);
    do {
        envsamp__facing_weigh(node, n, &w);
        for (int i = 14; i >= 0; i--)
            sum[i] = i < 7 ? sum[2 * i + 1] + sum[2 * i + 2] : w.part[(i - 7) % 2][(i - 7) / 2];
        for (at = 0; at < 7; at = 2 * at + 1 + high) {
            double whole = envsamp__max((double)sum[at], (double)ENVSAMP__LEAST_WEIGHT);
            double low = (double)sum[2 * at + 1] / whole;

            high = envsamp__is_high(node->edge[at], place);
            axis = envsamp__sign(node->cut[at]);
            start[axis] += high ? size[axis] * low : 0.0;
            size[axis] *= high ? (double)sum[2 * at + 2] / whole : low;
            bound[2 * axis + 1 - (int)high] = ENVSAMP_FABSF(node->cut[at]);
        }
        link = node->child[(at - 7) % 2][(at - 7) / 2];
        node = ENVSAMP__LINKED(envsamp__facing_node, kd, link);
    } while (link & ENVSAMP__INNER);
    for (axis = 0; axis < 2; axis++) {
        double low = (double)bound[2 * axis];
        double wide = envsamp__max((double)bound[2 * axis + 1] - low,
                                     1.0 / (double)ENVSAMP__UNIT);
        float end = (float)(start[axis] + size[axis]);
        double f = ((double)u[axis] - low) / wide;

        u[axis] = envsamp__at_most((float)(start[axis] + size[axis] * f),
                                   envsamp__bits_float(envsamp__float_bits(end) - 1));
        u[axis] = envsamp__clamp_unit(u[axis]);
    }
    return 1;
}

/* ---- blocks ---- */

ENVSAMP_DEF envsamp_result envsamp_kd_get_info(const envsamp_kd *kd, envsamp_kd_info *info)
{
    if (!kd || !info)
        return ENVSAMP_ERR_NULL;
    info->block_count = (int)kd->block_count;
    info->integral = kd->integral;
    info->excess_variance = kd->excess_variance;
    info->max_ratio = kd->max_ratio;
    info->alpha = kd->alpha;
    info->beta = kd->beta;
    info->l1 = kd->l1;
    info->bad_pixel_count = (size_t)kd->bad_pixel_count;
    info->mis_compensation = kd->mis_compensation;
    info->nearest = !kd->bilinear;
    info->mapping = (envsamp_mapping)kd->mapping;
    info->facing = kd->facing_count > 0;
    return ENVSAMP_OK;
}

/* Block `number` of WARP. As many as there are tiles are the first blocks of these; each other one
   is the first on the higher side of a cut. */
static void envsamp__warp_block(const envsamp_kd *kd, uint32_t number, float *cut, float *edge)
{
    const envsamp__record *record = ENVSAMP__RECORDS(kd);
    uint32_t tiles = envsamp__tile_count(kd), tile = number < tiles ? number : 0, target = 0;

    if (number >= tiles) {              /* the last tile with a link to the cut or one before */
        target = envsamp__cut_link(kd, number - tiles);
        for (uint32_t step = tiles / 2; step > 0; step /= 2) {
            uint32_t next = tile + step;

            while (next < tiles && !(record[next].link & ENVSAMP__INNER))
                next++;
            tile += next < tiles && record[next].link <= target ? step : 0;
        }
    }
    uint32_t link = envsamp__enter_tile(kd, (int)tile, cut, edge, 1);
    while (link & ENVSAMP__INNER) {
        const envsamp__sample_node *node = ENVSAMP__LINKED(envsamp__sample_node, kd, link);
        int high = link == target || (link < target && node->child[1] & ENVSAMP__INNER
                                      && node->child[1] <= target);

        link = envsamp__take_side(node, (uint32_t)high, cut, edge, 1);
    }
}

ENVSAMP_DEF envsamp_result envsamp_kd_get_block(const envsamp_kd *kd, int number,
                                                envsamp_kd_block *block)
{
    float cut[4], edge[4], pdf = 0.0f;

    if (!kd || !block)
        return ENVSAMP_ERR_NULL;
    if (number < 0 || number >= (int)kd->block_count)
        return ENVSAMP_ERR_PARAM;
    if (kd->select == ENVSAMP_KD_WARP)
        envsamp__warp_block(kd, (uint32_t)number, cut, edge);
    else
        pdf = envsamp__bits_float(envsamp__enter_tile(kd, number, cut, edge, 1));
    double sr = envsamp__max(envsamp__edges_sr(kd->mapping, edge), 0.0);    /* of a damaged table */
    for (int i = 0; i < 2; i++) {
        float *uv = i ? block->uv_max : block->uv_min;
        envsamp__polar_pair row = envsamp__edge_pair(edge[2 + i]);

        uv[0] = edge[i];
        uv[1] = envsamp__polar_v(kd->mapping, row.north, row.south);
    }
    if (block->uv_min[1] >= block->uv_max[1]) {     /* thinner than v in floats tells */
        block->uv_min[1] = envsamp__clamp_unit(block->uv_min[1]);
        block->uv_max[1] = envsamp__bits_float(envsamp__float_bits(block->uv_min[1]) + 1);
    }
    block->solid_angle = (float)sr;
    block->probability = (float)(kd->select != ENVSAMP_KD_WARP ? (double)pdf * sr
                                 : envsamp__max(envsamp__region_area(kd, cut), 0.0));
    return ENVSAMP_OK;
}

#ifndef ENVSAMP_NO_CDF

/* ============================================================================================
 * CDF                                                                           [search: @cdf]
 *
 * u1 chooses a row by its share of the light, u0 a texel of the row by its share of the row's.
 * Both are kept as whole parts of 2^24, the values of a float u: what is drawn is exactly what the
 * table says. Edges in units of 2^-32 would follow the light more closely, but claim other chances
 * than those of 24-bit numbers: bias, where here is a little variance.
 *
 * One block of memory, as for kd: the header below, then, without gaps,
 *
 *     rows        height + 1 x { float north, south, density }: 1 - cos and 1 + cos of the row's
 *                 upper edge; density of a part of 2^24 of the row
 *     row_edges   height + WALK x uint32: row y is drawn where row_edges[y] <= 2^24 u1
 *                 < row_edges[y + 1]; 0 first, 2^24 at `height` and after it
 *     edges       height x (width + WALK) x uint32: the same of the texels of each row. A black row
 *                 has all of itself in its first texel, and is not drawn.
 *     row_guide   2^row_bits + 1 x uint16: the row that is drawn where cell i of as many equal
 *                 parts of [0, 1) begins; the last row at the end
 *     guide       height x (2^guide_bits + 1) x uint16: the same of the texels of each row
 *
 * From the texel where its cell begins, a draw is compared with WALK edges at once [6]; a cell
 * holds two to four texels on average. Where that does not reach, as beside a lamp, the texels up
 * to the one where the next cell begins are halved.
 *
 * A fresh point waits for memory twice, for guide and edges. So a batch prefetches all guides, then
 * all edges, before it reads the first: 1.5 to 3.3 times as fast (bench/experiments.md).
 * ========================================================================================== */

#define ENVSAMP__CDF_MAGIC 0x434b5345u      /* "ESKC" in memory */
#define ENVSAMP__CDF_VERSION 5u
#define ENVSAMP__PARTS 0x1000000u           /* 2^24, */
#define ENVSAMP__PARTS_2 281474976710656.0  /* and its square */
#define ENVSAMP__WALK 4                     /* edges compared without a branch */

typedef struct envsamp__cdf_row { envsamp__polar_pair top; float density; } envsamp__cdf_row;

struct envsamp_cdf {
    uint32_t magic, version, checksum, mapping;     /* as every table: see envsamp__table */
    uint64_t bytes;                         /* 16 */
    uint32_t width, height;                 /* 24: of the cells: 1 more each if bilinear */
    uint32_t image_width, image_height;     /* 32 */
    uint32_t row_bits, guide_bits;          /* 40 */
    float inverse_width;                    /* 48: of the image */
    float row_scale;                        /* 52: its rows per pi of polar angle */
    float offset;                           /* 56: of cell edges, in texels: 0 or 1/2 */
    uint32_t bilinear;
    uint64_t rows_at, row_edges_at, edges_at, row_guide_at, guide_at;       /* 64 */
    double integral, excess_variance, max_ratio;    /* 104: see info */
    uint64_t bad_pixel_count;               /* 128 */
    float mis_compensation;
    uint32_t spare;
};

typedef char envsamp__cdf_is_packed[sizeof(envsamp_cdf) == 144 ? 1 : -1];

/* The edges and the guide of a row. */
#define ENVSAMP__CDF_EDGES(array, cdf, row) \
    (array(uint32_t, cdf, edges) + (size_t)(row) * ((size_t)(cdf)->width + ENVSAMP__WALK))
#define ENVSAMP__CDF_GUIDE(array, cdf, row) \
    (array(uint16_t, cdf, guide) + (size_t)(row) * (((size_t)1 << (cdf)->guide_bits) + 1))

/* The upper edge of a row as kd tables have it. */
ENVSAMP__MATH float envsamp__cdf_row_edge(const envsamp__cdf_row *row)
{
    return row->top.north <= row->top.south ? row->top.north
                                            : envsamp__with_sign(row->top.south, 1);
}

/* Puts the arrays in their places, and sets whatever else follows from width and height. */
static void envsamp__cdf_layout(envsamp_cdf *cdf)
{
    uint64_t width, height;

    width = cdf->width = cdf->image_width + cdf->bilinear;
    height = cdf->height = cdf->image_height + cdf->bilinear;
    cdf->row_bits = envsamp__bits(cdf->height) + 1;
    cdf->guide_bits = cdf->width > 4 ? envsamp__bits(cdf->width) - 2 : 0;
    cdf->inverse_width = 1.0f / (float)cdf->image_width;
    cdf->row_scale = (cdf->mapping == ENVSAMP_HEMISPHERE ? 2.0f : 1.0f) * (float)cdf->image_height;
    cdf->offset = 0.5f * (float)cdf->bilinear;
    cdf->rows_at = sizeof *cdf;
    cdf->row_edges_at = cdf->rows_at + (height + 1) * sizeof(envsamp__cdf_row);
    cdf->edges_at = cdf->row_edges_at + (height + ENVSAMP__WALK) * 4;
    cdf->row_guide_at = cdf->edges_at + height * (width + ENVSAMP__WALK) * 4;
    cdf->guide_at = cdf->row_guide_at + (((uint64_t)1 << cdf->row_bits) + 1) * 2;
    cdf->bytes = cdf->guide_at + height * (((uint64_t)1 << cdf->guide_bits) + 1) * 2;
}

/* ---- building ---- */

struct envsamp_cdf_job {
    envsamp__job base;          /* its map: no pyramid; three lines of knots, or one of texels */
    double *weight;                 /* of each cell of a row: root mean square */
    float *peak;                    /* and maximum */
    double *row_mass;
    double *row_square, *row_peak;  /* of each row: sum of L L / parts, largest L / parts */
};

/* Lays a build out: its scratch memory, the job first, and the header of its table. */
static void envsamp__cdf_plan(const envsamp_image *image, const envsamp_kd_desc *desc,
                              envsamp__arena *arena, envsamp_cdf_job *job, envsamp_cdf *cdf)
{
    ENVSAMP_MEMSET(cdf, 0, sizeof *cdf);
    cdf->version = ENVSAMP__CDF_VERSION;
    cdf->mapping = image->mapping;
    cdf->bilinear = !desc->nearest;
    cdf->image_width = (uint32_t)image->width;
    cdf->image_height = (uint32_t)image->height;
    envsamp__cdf_layout(cdf);
    ENVSAMP_MEMSET(job, 0, sizeof *job);
    envsamp__take(arena, 1, sizeof *job);
    envsamp__map_carve(&job->base.map, image, desc, 1 + 2 * cdf->bilinear, arena);
    job->weight = ENVSAMP__TAKE(double, arena, cdf->width + 7);
    job->peak = ENVSAMP__TAKE(float, arena, cdf->width + 7);
    job->row_mass = ENVSAMP__TAKE(double, arena, cdf->height + 3);
    job->row_square = ENVSAMP__TAKE(double, arena, cdf->height);
    job->row_peak = ENVSAMP__TAKE(double, arena, cdf->height);
}

/* Shares 2^24 parts out by weights: one for each that is above zero, then the rest in proportion,
   the running sum rounded down; the last has what is left. And the guide: the last index that
   begins where each of its cells begins, or before. Returns the sum of the weights, whose array is
   filled with zeros up to a multiple of four, so that compilers vectorise. */
static double envsamp__cdf_share(double *weight, uint32_t count, uint32_t *edges, uint32_t bits,
                                 uint16_t *guide)
{
    double total[4] = { 0.0 }, above[4] = { 0.0 }, sum = 0.0;
    uint32_t shift = 24 - bits, cells = 1u << bits, edge = 0, met = 0;

    for (uint32_t i = count; i % 4; i++)
        weight[i] = 0.0;
    for (uint32_t i = 0; i < count; i += 4)
        for (uint32_t k = 0; k < 4; k++) {
            total[k] += weight[i + k];
            above[k] += weight[i + k] > 0.0 ? 1.0 : 0.0;
        }
    total[0] = (total[0] + total[1]) + (total[2] + total[3]);
    uint32_t lit = (uint32_t)((above[0] + above[1]) + (above[2] + above[3]));
    double scale = lit ? (double)(ENVSAMP__PARTS - lit) / total[0] : 0.0;
    ENVSAMP_MEMSET(guide, 0, (cells + 1) * sizeof *guide);
    for (uint32_t i = 0; i < count; i++) {
        edges[i] = edge;
        guide[(edge + (1u << shift) - 1) >> shift] = (uint16_t)i;
        sum += weight[i];
        met += weight[i] > 0.0;
        edge = met == lit ? ENVSAMP__PARTS : met + (uint32_t)(int)(sum * scale);
    }
    for (uint32_t i = count; i < count + ENVSAMP__WALK; i++)
        edges[i] = ENVSAMP__PARTS;
    for (uint32_t cell = 1; cell <= cells; cell++)
        guide[cell] = guide[cell] < guide[cell - 1] ? guide[cell - 1] : guide[cell];
    return total[0];
}

/* Weights and maxima of the cells of row y, below `line`. Loops of eight are those that compilers
   vectorise. */
static void envsamp__cdf_weigh_row(envsamp_cdf_job *job, int y, const float *line)
{
    const envsamp__map *map = &job->base.map;
    double at = map->rows[y].at, spread = map->rows[y].spread, weight[8];
    int width = map->width, next = map->bilinear, x0;
    float peak[8];

    for (x0 = 0; x0 < width; x0 += 8) {
        const float *a = line + x0, *c = a + (next ? map->stride : 0);

        for (int x = 0; x < 8; x++) {
            double a0 = (double)a[x], a1 = (double)a[x + next];
            double r0 = (double)c[x] - a0, r1 = (double)c[x + next] - a1;
            double m0 = a0 + at * r0, m1 = a1 + at * r1, m = m0 + m1, r = r0 + r1;

            weight[x] = 1.0 / 3.0 * ((m * m - m0 * m1) + spread * (r * r - r0 * r1));
        }
        for (int x = 0; x < 8; x++) {
            float left = a[x] > c[x] ? a[x] : c[x];
            float right = a[x + next] > c[x + next] ? a[x + next] : c[x + next];

            peak[x] = left > right ? left : right;
        }
#ifdef ENVSAMP__SSE
        for (int x = 0; x < 8; x += 2)
            _mm_storeu_pd(weight + x, _mm_sqrt_pd(_mm_loadu_pd(weight + x)));
#else
        for (int x = 0; x < 8; x++)
            weight[x] = ENVSAMP_SQRT(weight[x]);
#endif
        ENVSAMP_MEMCPY(job->weight + x0, weight, sizeof weight);
        ENVSAMP_MEMCPY(job->peak + x0, peak, sizeof peak);
    }
    for (int x = width; x < x0; x++) {
        job->weight[x] = 0.0;
        job->peak[x] = 0.0f;
    }
    for (int x = 0; x < 2 && next; x++) {        /* cells that are half as wide */
        job->weight[x * (width - 1)] *= 0.5;
        job->peak[x * (width - 1)] *= 0.5f;
    }
}

/* Row y of cells, and what it will cost. */
static void envsamp__cdf_write_row(envsamp_cdf_job *job, int y, const float *line)
{
    envsamp_cdf *cdf = (envsamp_cdf *)job->base.table;
    uint32_t *edges = ENVSAMP__CDF_EDGES(ENVSAMP__ARRAY_OUT, cdf, y);
    double square[4] = { 0.0 }, peak[4] = { 0.0 }, inverse[4], sr = job->base.map.rows[y].sr;

    envsamp__cdf_weigh_row(job, y, line);
    if (!job->base.is_reread)
        job->row_mass[y] = sr * envsamp__cdf_share(job->weight, cdf->width, edges, cdf->guide_bits,
                                                   ENVSAMP__CDF_GUIDE(ENVSAMP__ARRAY_OUT, cdf, y));
    for (uint32_t x = 0; x < cdf->width; x += 4) {
        const uint32_t *edge = edges + x;
        const double *weight = job->weight + x;
        const float *most = job->peak + x;

        for (uint32_t i = 0; i < 4; i++)        /* a cell without parts costs nothing */
            inverse[i] = 1.0 / (double)(int)(edge[i + 1] - edge[i] + (edge[i + 1] == edge[i]));
        for (uint32_t i = 0; i < 4; i++) {
            square[i] += weight[i] * weight[i] * inverse[i];
            peak[i] = envsamp__max(peak[i], (double)most[i] * inverse[i]);
        }
    }
    job->row_square[y] = sr * ((square[0] + square[1]) + (square[2] + square[3]));
    job->row_peak[y] = envsamp__max(envsamp__max(peak[0], peak[1]),
                                    envsamp__max(peak[2], peak[3]));
}

/* The rows, by their masses, and what all of it costs. Densities are by the solid angle of the map,
   not that between the edges as rounded to floats: so E[L / pdf] is the integral, however low the
   row. */
static void envsamp__cdf_write_rows(const envsamp_cdf_job *job, envsamp_cdf *cdf)
{
    const envsamp__map *map = &job->base.map;
    envsamp__cdf_row *rows = ENVSAMP__ARRAY_OUT(envsamp__cdf_row, cdf, rows);
    uint32_t *edges = ENVSAMP__ARRAY_OUT(uint32_t, cdf, row_edges);
    double second = 0.0, peak = 0.0;

    envsamp__cdf_share(job->row_mass, cdf->height, edges, cdf->row_bits,
                       ENVSAMP__ARRAY_OUT(uint16_t, cdf, row_guide));
    for (uint32_t y = 0; y <= cdf->height; y++) {
        rows[y].top = envsamp__edge_pair(envsamp__stored_edge(
            map, envsamp__cell_edge(map, (int)y, 1), 1));
        rows[y].density = 0.0f;
        if (y == cdf->height || !(job->row_mass[y] > 0.0))
            continue;
        rows[y].density = (float)((double)(edges[y + 1] - edges[y])
                                  / ENVSAMP__PARTS_2 / map->rows[y].sr);
        second += job->row_square[y] / (double)rows[y].density;
        peak = envsamp__max(peak, job->row_peak[y] / (double)rows[y].density);
    }
    cdf->excess_variance = envsamp__max(second / map->integral / map->integral - 1.0, 0.0);
    cdf->max_ratio = peak / map->integral;
}

/* Reads a row of texels and writes the rows of cells that are complete with it. After the last
   writes the rest of the table, but for its checksum, and returns 0. */
static int envsamp__cdf_work(void *work, int item)
{
    envsamp_cdf_job *job = (envsamp_cdf_job *)work;
    envsamp__job *base = &job->base;
    envsamp_cdf *cdf = (envsamp_cdf *)base->table;
    envsamp__map *map = &base->map;
    float *above = map->knots, *line = above + (map->bilinear ? map->stride : 0);
    envsamp__texel_row row;

    base->result = envsamp__map_line(map, item, line, &row);
    if (base->result != ENVSAMP_OK)
        return 1;
    envsamp__cdf_write_row(job, item, above);
    if (item + 1 < map->image.height) {
        if (map->bilinear)
            ENVSAMP_MEMCPY(above, line, map->stride * sizeof(float));
        return 1;
    }
    if (map->bilinear)
        envsamp__cdf_write_row(job, item + 1, line);
    if (!(map->integral > 0.0)) {
        base->result = ENVSAMP_ERR_BLACK;
        return 1;
    }
    if (envsamp__job_reread(base))
        return 0;
    envsamp__cdf_write_rows(job, cdf);
    cdf->integral = map->compensation > 0.0f ? map->full_integral : map->integral;
    cdf->mis_compensation = map->compensation;
    cdf->bad_pixel_count = map->bad_pixel_count;
    base->phase = (envsamp__phase)(ENVSAMP__CHECKSUM - 1);
    return 0;
}

/* As envsamp__kd_filled, by what kd calls the same. */
static envsamp_kd_desc envsamp__cdf_filled(const envsamp_cdf_desc *desc)
{
    envsamp_kd_desc common;

    ENVSAMP_MEMSET(&common, 0, sizeof common);
    if (desc) {
        common.mis_compensation = desc->mis_compensation;
        common.nearest = desc->nearest;
        common.strict = desc->strict;
        common.importance_exponent = desc->importance_exponent;
    }
    return envsamp__kd_filled(&common);
}

ENVSAMP_DEF envsamp_cdf_desc envsamp_cdf_defaults(void)
{
    const envsamp_cdf_desc desc = { 0.0f, 0, 0, 1.0f };

    return desc;
}

ENVSAMP_DEF envsamp_result envsamp_cdf_sizes(const envsamp_image *image,
                                             const envsamp_cdf_desc *desc, envsamp_sizes *sizes)
{
    envsamp_kd_desc filled = envsamp__cdf_filled(desc);
    envsamp__arena arena = { NULL, 0 };
    envsamp_cdf_job job;
    envsamp_cdf layout;
    envsamp_result result = envsamp__begin_sizes(image, sizes);

    if (result != ENVSAMP_OK)
        return result;
    if (!envsamp__reading_valid(&filled))
        return ENVSAMP_ERR_PARAM;
    envsamp__cdf_plan(image, &filled, &arena, &job, &layout);
    return envsamp__set_sizes(sizes, layout.bytes, arena.used);
}

ENVSAMP_DEF envsamp_result envsamp_cdf_begin(const envsamp_image *image, envsamp_row_fn fn,
                                             void *user, const envsamp_cdf_desc *desc,
                                             envsamp_buffer table, envsamp_buffer scratch,
                                             envsamp_cdf_job **job)
{
    envsamp_kd_desc filled = envsamp__cdf_filled(desc);
    envsamp__arena arena = { (char *)scratch.data, 0 };
    envsamp_cdf *cdf = (envsamp_cdf *)table.data;
    envsamp_sizes sizes;

    if (!job)
        return ENVSAMP_ERR_NULL;
    *job = NULL;
    envsamp_result result = envsamp_cdf_sizes(image, desc, &sizes);
    if (result == ENVSAMP_OK)
        result = envsamp__job_check(image, fn, &sizes, table, scratch);
    if (result != ENVSAMP_OK)
        return result;
    *job = (envsamp_cdf_job *)scratch.data;
    envsamp__cdf_plan(image, &filled, &arena, *job, cdf);
    envsamp__job_start(&(*job)->base, cdf, ENVSAMP__CDF_MAGIC, envsamp__cdf_work, fn, user);
    return ENVSAMP_OK;
}

ENVSAMP_DEF envsamp_result envsamp_cdf_step(envsamp_cdf_job *job, int count, int *done)
{
    return job ? envsamp__job_step(&job->base, count, done) : ENVSAMP_ERR_NULL;
}

ENVSAMP_DEF envsamp_result envsamp_cdf_finish(envsamp_cdf_job *job, const envsamp_cdf **cdf)
{
    envsamp_result result = cdf ? envsamp_cdf_step(job, INT_MAX, NULL) : ENVSAMP_ERR_NULL;

    if (cdf)
        *cdf = result == ENVSAMP_OK ? (const envsamp_cdf *)job->base.table : NULL;
    return result;
}

ENVSAMP_DEF envsamp_result envsamp_cdf_build_rows(const envsamp_image *image, envsamp_row_fn fn,
                                                  void *user, const envsamp_cdf_desc *desc,
                                                  envsamp_buffer table, envsamp_buffer scratch,
                                                  const envsamp_cdf **cdf)
{
    envsamp_cdf_job *job = NULL;
    envsamp_result begun = envsamp_cdf_begin(image, fn, user, desc, table, scratch,
                                             cdf ? &job : NULL);
    envsamp_result finished = envsamp_cdf_finish(job, cdf);   /* *cdf is NULL without a job */

    return begun == ENVSAMP_OK ? finished : begun;
}

ENVSAMP_DEF envsamp_result envsamp_cdf_build(const envsamp_image *image,
                                             const envsamp_cdf_desc *desc, envsamp_buffer table,
                                             envsamp_buffer scratch, const envsamp_cdf **cdf)
{
    return envsamp_cdf_build_rows(image, NULL, NULL, desc, table, scratch, cdf);
}

#ifdef ENVSAMP_ALLOC

ENVSAMP_DEF envsamp_cdf *envsamp_cdf_new(const envsamp_image *image, const envsamp_cdf_desc *desc,
                                         envsamp_result *result)
{
    envsamp_buffer table = { NULL, 0 }, scratch = { NULL, 0 };
    envsamp_sizes sizes;
    envsamp_result got = envsamp_cdf_sizes(image, desc, &sizes);
    const envsamp_cdf *cdf;

    got = got == ENVSAMP_OK ? envsamp__allocate(&sizes, &table, &scratch) : got;
    got = got == ENVSAMP_OK ? envsamp_cdf_build(image, desc, table, scratch, &cdf) : got;
    return (envsamp_cdf *)envsamp__keep_table(got, table, scratch, result);
}

ENVSAMP_DEF void envsamp_cdf_free(envsamp_cdf *cdf) { ENVSAMP_FREE(cdf); }

#endif

/* ---- opening ---- */

/* Edges that rise from 0 to 2^24, and a guide that leads to them. */
static int envsamp__cdf_edges_valid(const uint32_t *edges, uint32_t count, const uint16_t *guide,
                                    uint32_t bits)
{
    uint32_t i;

    if (edges[0] != 0 || edges[count] != ENVSAMP__PARTS)
        return 0;
    for (i = 0; i + 1 < count + ENVSAMP__WALK; i++)
        if (edges[i] > edges[i + 1] || edges[i + 1] > ENVSAMP__PARTS)
            return 0;
    for (uint32_t cell = i = 0; cell <= 1u << bits; cell++) {
        while (i + 1 < count && edges[i + 1] <= cell << (24 - bits))
            i++;
        if (guide[cell] != i)
            return 0;
    }
    return 1;
}

/* Rows that follow one another, with the densities of their edges, but for the rounding of low
   rows, and edges of texels. */
static int envsamp__cdf_rows_valid(const envsamp_cdf *cdf)
{
    const envsamp__cdf_row *row = ENVSAMP__ARRAY(envsamp__cdf_row, cdf, rows);
    const uint32_t *edge = ENVSAMP__ARRAY(uint32_t, cdf, row_edges);

    for (uint32_t y = 0; y < cdf->height; y++, edge++, row++) {
        const float e[4] = { 0.0f, 1.0f, envsamp__cdf_row_edge(row),
                             envsamp__cdf_row_edge(row + 1) };
        const envsamp__polar_pair top = envsamp__edge_pair(e[2]), end = envsamp__edge_pair(e[3]);
        double draws = (double)(edge[1] - edge[0]) / ENVSAMP__PARTS_2;
        double claimed = (double)row->density * envsamp__edges_sr(cdf->mapping, e)
                       / (double)cdf->image_width;

        if (ENVSAMP_MEMCMP(&top, row, sizeof top) || ENVSAMP_MEMCMP(&end, row + 1, sizeof end)
            || !envsamp__edges_valid(cdf->mapping, e)
            || !envsamp__in_range(row->density, 0.0f, FLT_MAX / (2.0f * ENVSAMP__UNIT))
            || !(ENVSAMP__FABS(claimed - draws) <= 0.01 * draws)
            || !envsamp__cdf_edges_valid(ENVSAMP__CDF_EDGES(ENVSAMP__ARRAY, cdf, y), cdf->width,
                                         ENVSAMP__CDF_GUIDE(ENVSAMP__ARRAY, cdf, y),
                                         cdf->guide_bits))
            return 0;
    }
    return 1;
}

ENVSAMP_DEF envsamp_result envsamp_cdf_open(const void *table, size_t bytes,
                                            const envsamp_cdf **cdf)
{
    const envsamp_cdf *header = (const envsamp_cdf *)table;
    envsamp_cdf layout;

    if (!cdf)
        return ENVSAMP_ERR_NULL;
    *cdf = NULL;
    envsamp_result result = envsamp__table_check(table, bytes, sizeof *header, ENVSAMP__CDF_MAGIC,
                                                 ENVSAMP__CDF_VERSION);
    if (result != ENVSAMP_OK)
        return result;
    if (header->bilinear > 1 || !envsamp__in_range(header->mis_compensation, 0.0f, 1.0f)
        || header->image_width < 1 || header->image_width > 65535
        || header->image_height < 1 || header->image_height > 65535)
        return ENVSAMP_ERR_FORMAT;
    ENVSAMP_MEMCPY(&layout, header, sizeof layout);
    envsamp__cdf_layout(&layout);
    if (ENVSAMP_MEMCMP(&layout, header, sizeof layout)
        || !envsamp__cdf_edges_valid(ENVSAMP__ARRAY(uint32_t, header, row_edges), header->height,
                                     ENVSAMP__ARRAY(uint16_t, header, row_guide), header->row_bits)
        || !envsamp__cdf_rows_valid(header))
        return ENVSAMP_ERR_FORMAT;
    *cdf = header;
    return ENVSAMP_OK;
}

ENVSAMP_DEF size_t envsamp_cdf_bytes(const envsamp_cdf *cdf)
{
    ENVSAMP_ASSERT(cdf);
    return (size_t)cdf->bytes;
}

ENVSAMP_DEF envsamp_result envsamp_cdf_get_info(const envsamp_cdf *cdf, envsamp_cdf_info *info)
{
    if (!cdf || !info)
        return ENVSAMP_ERR_NULL;
    info->integral = cdf->integral;
    info->excess_variance = cdf->excess_variance;
    info->max_ratio = cdf->max_ratio;
    info->bad_pixel_count = (size_t)cdf->bad_pixel_count;
    info->mis_compensation = cdf->mis_compensation;
    info->nearest = !cdf->bilinear;
    info->mapping = (envsamp_mapping)cdf->mapping;
    return ENVSAMP_OK;
}

/* ---- sampling ---- */

/* The index i with edges[i] <= draw < edges[i + 1]. The first steps are without a branch: a
   mispredict costs more than they do. */
ENVSAMP__HOT uint32_t envsamp__cdf_find(const uint32_t *edges, const uint16_t *guide,
                                        uint32_t bits, uint32_t draw)
{
    uint32_t cell = draw >> (24 - bits), low = guide[cell], i;
    const uint32_t *edge = edges + low;

    i = low + (edge[1] <= draw) + (edge[2] <= draw) + (edge[3] <= draw) + (edge[4] <= draw);
    if (edges[i + 1] > draw)
        return i;
    uint32_t last = guide[cell + 1];
    for (low = i + 1; low < last;) {
        uint32_t middle = low + (last - low) / 2;

        if (edges[middle + 1] > draw)
            last = middle;
        else
            low = middle + 1;
    }
    return low;
}

ENVSAMP__HOT uint32_t envsamp__cdf_find_row(const envsamp_cdf *cdf, uint32_t draw)
{
    return envsamp__cdf_find(ENVSAMP__ARRAY(uint32_t, cdf, row_edges),
                             ENVSAMP__ARRAY(uint16_t, cdf, row_guide), cdf->row_bits, draw);
}

/* Which of its 2^24 values a number is. */
ENVSAMP__HOT uint32_t envsamp__draw(float u)
{
    return (uint32_t)(int)(envsamp__clamp_unit(u) * ENVSAMP__UNIT);
}

/* A texel; `valid` is 0 for some texel in place of none. */
typedef struct envsamp__cdf_texel { uint32_t column, row; int valid; } envsamp__cdf_texel;

/* Those at the sides of a bilinear map are half as wide. */
ENVSAMP__HOT float envsamp__cdf_density(const envsamp_cdf *cdf, envsamp__cdf_texel at)
{
    const uint32_t *edge = ENVSAMP__CDF_EDGES(ENVSAMP__ARRAY, cdf, at.row) + at.column;
    uint32_t half = cdf->bilinear & (uint32_t)((at.column == 0) | (at.column + 1 == cdf->width));
    float density = ENVSAMP__ARRAY(envsamp__cdf_row, cdf, rows)[at.row].density;

    return at.valid ? (float)(int)((edge[1] - edge[0]) << half) * density : 0.0f;
}

/* Where in its row a sample lies, and its density. Half a part is added to draws: without it the
   first draw of a cell would lie on the edge, where rounding decides which cell it belongs to. */
ENVSAMP__HOT envsamp__point envsamp__cdf_point(const envsamp_cdf *cdf, uint32_t y, uint32_t down,
                                               uint32_t across, float *pdf)
{
    const envsamp__cdf_row *row = ENVSAMP__ARRAY(envsamp__cdf_row, cdf, rows) + y;
    const uint32_t *row_edge = ENVSAMP__ARRAY(uint32_t, cdf, row_edges) + y;
    const uint32_t *edges = ENVSAMP__CDF_EDGES(ENVSAMP__ARRAY, cdf, y);
    uint32_t x = envsamp__cdf_find(edges, ENVSAMP__CDF_GUIDE(ENVSAMP__ARRAY, cdf, y),
                                   cdf->guide_bits, across);
    const envsamp__cdf_texel at = { x, y, 1 };
    float fx = ((float)(int)(across - edges[x]) + 0.5f) / (float)(int)(edges[x + 1] - edges[x]);
    float fy = ((float)(int)(down - row_edge[0]) + 0.5f) / (float)(int)(row_edge[1] - row_edge[0]);
    float x0 = (float)(int)x - cdf->offset, x1 = x0 + 1.0f, end = (float)(int)cdf->image_width;
    envsamp__point p;

    x0 = x0 > 0.0f ? x0 : 0.0f;
    x1 = x1 < end ? x1 : end;
    p.x = (x0 + fx * (x1 - x0)) * cdf->inverse_width;
    p.north = row[0].top.north + fy * (row[1].top.north - row[0].top.north);
    p.south = row[0].top.south + fy * (row[1].top.south - row[0].top.south);
    *pdf = envsamp__cdf_density(cdf, at);
    return p;
}

ENVSAMP_DEVICE ENVSAMP_DEF envsamp_sample envsamp_cdf_sample(const envsamp_cdf *cdf, float u0,
                                                             float u1)
{
    uint32_t down = envsamp__draw(u1);
    float pdf;

    ENVSAMP_ASSERT(cdf);
    uint32_t row = envsamp__cdf_find_row(cdf, down);
    envsamp__point p = envsamp__cdf_point(cdf, row, down, envsamp__draw(u0), &pdf);
    return envsamp__point_sample(cdf->mapping, p, pdf);
}

/* ---- density ---- */

/* The texel in a direction. `octahedral`: whether the map is, a constant in loops that compilers
   vectorise. r is |(x, y)|. v is half a turn of the arc tangent of r / |z|, which is an eighth of a
   turn and that of t: the sum of envsamp__octant_turn, but in pairs, as it waits for r. */
ENVSAMP__HOT envsamp__cdf_texel envsamp__cdf_at(const envsamp_cdf *cdf, int octahedral, float x,
                                                float y, float z, float r)
{
    float high = ENVSAMP_FABSF(z), sum = r + high, u, v;
    envsamp__cdf_texel at;

    at.valid = envsamp__is_direction(ENVSAMP_FABSF(x) + ENVSAMP_FABSF(y), sum);
    if (octahedral) {
        envsamp__l1_coords d = envsamp__dir_to_grid(ENVSAMP_OCTAHEDRAL, x, y, z, r);

        u = 0.25f * d.azimuth;
        v = 0.5f * d.polar;
    } else {
        u = envsamp__turn(at.valid ? y : 0.0f, at.valid ? x : 0.0f);
        float t = 1.0f - 2.0f * ((at.valid ? high : 1.0f) / (at.valid ? sum : 1.0f));
        float s = t * t;
        float s2 = s * s;
        t *= ((0.318309882f - s * 0.106102533f) + s2 * (0.0636398678f - s * 0.0452227112f))
           + s2 * s2 * (((0.0339148928f - s * 0.0239804388f)
                         + s2 * (0.0136998603f - s * 0.005183045f)) + s2 * s2 * 0.000924230142f);
        v = 0.5f - ENVSAMP_COPYSIGNF(0.25f - t, z);
        at.valid &= cdf->mapping == ENVSAMP_LATLONG || v <= 0.5f;
    }
    at.column = envsamp__index(u * (float)(int)cdf->image_width + cdf->offset, cdf->width);
    at.row = envsamp__index(v * cdf->row_scale + cdf->offset, cdf->height);
    return at;
}

ENVSAMP_DEVICE ENVSAMP_DEF float envsamp_cdf_pdf(const envsamp_cdf *cdf, const float dir[3])
{
    ENVSAMP_ASSERT(cdf && dir);
    float r = ENVSAMP_SQRTF(dir[0] * dir[0] + dir[1] * dir[1]);
    return envsamp__cdf_density(cdf, envsamp__cdf_at(cdf, cdf->mapping == ENVSAMP_OCTAHEDRAL,
                                                     dir[0], dir[1], dir[2], r));
}

/* The number that draws the fraction f of the way from one edge to the next. */
ENVSAMP__MATH float envsamp__cdf_number(const uint32_t *edge, double f)
{
    double parts = (double)(int)(edge[1] - edge[0]);

    f = f > 0.0 ? f * parts : 0.0;
    f = f < parts ? f : parts - 1.0;
    return ((float)(int)edge[0] + (float)(int)f) * (1.0f / ENVSAMP__UNIT);
}

ENVSAMP_DEVICE ENVSAMP_DEF int envsamp_cdf_invert(const envsamp_cdf *cdf, const float dir[3],
                                                  float u[2])
{
    ENVSAMP_ASSERT(cdf && dir && u);
    u[0] = u[1] = 0.0f;
    envsamp__cdf_texel at = envsamp__cdf_at(cdf, cdf->mapping == ENVSAMP_OCTAHEDRAL, dir[0],
                                            dir[1], dir[2],
                                            ENVSAMP_SQRTF(dir[0] * dir[0] + dir[1] * dir[1]));
    if (!(envsamp__cdf_density(cdf, at) > 0.0f))
        return 0;
    envsamp__exact e = envsamp__dir_exact(cdf->mapping, dir);
    double x0 = (double)at.column - (double)cdf->offset;
    double x1 = envsamp__min_double(x0 + 1.0, (double)cdf->image_width);
    x0 = envsamp__max(x0, 0.0);
    const envsamp__cdf_row *row = ENVSAMP__ARRAY(envsamp__cdf_row, cdf, rows) + at.row;
    double fy = envsamp__exact_between(e, envsamp__cdf_row_edge(row),
                                       envsamp__cdf_row_edge(row + 1));
    u[0] = envsamp__cdf_number(ENVSAMP__CDF_EDGES(ENVSAMP__ARRAY, cdf, at.row) + at.column,
                               (e.x * (double)cdf->image_width - x0) / (x1 - x0));
    u[1] = envsamp__cdf_number(ENVSAMP__ARRAY(uint32_t, cdf, row_edges) + at.row, fy);
    return 1;
}

/* ---- many at a time ---- */

/* Cells of all guides, then all edges, of a batch are fetched into the cache before the first is
   read. */
ENVSAMP_DEF void envsamp_cdf_sample_n(const envsamp_cdf *cdf, size_t n, const float *u0,
                                      const float *u1, float *x, float *y, float *z, float *pdf)
{
    uint32_t row[ENVSAMP__BATCH], across[ENVSAMP__BATCH], down[ENVSAMP__BATCH];
    const uint16_t *guide[ENVSAMP__BATCH];
    float batch[4 * ENVSAMP__BATCH] = { 0.0f }, density;

    ENVSAMP_ASSERT(cdf && n <= SIZE_MAX / 8 && ((u0 && u1 && x && y && z && pdf) || !n));
    for (size_t start = 0; start < n; start += ENVSAMP__BATCH) {
        int count = n - start < ENVSAMP__BATCH ? (int)(n - start) : ENVSAMP__BATCH;

        for (int i = 0; i < count; i++) {
            across[i] = envsamp__draw(u0[start + (size_t)i]);
            down[i] = envsamp__draw(u1[start + (size_t)i]);
            row[i] = envsamp__cdf_find_row(cdf, down[i]);
            guide[i] = ENVSAMP__CDF_GUIDE(ENVSAMP__ARRAY, cdf, row[i])
                     + (across[i] >> (24 - cdf->guide_bits));
            ENVSAMP__PREFETCH(guide[i]);
        }
        for (int i = 0; i < count; i++) {
            const uint32_t *edge = ENVSAMP__CDF_EDGES(ENVSAMP__ARRAY, cdf, row[i]) + *guide[i];

            ENVSAMP__PREFETCH(edge);
            ENVSAMP__PREFETCH(edge + ENVSAMP__WALK);
        }
        for (int i = 0; i < count; i++) {
            envsamp__point p = envsamp__cdf_point(cdf, row[i], down[i], across[i], &density);

            envsamp__batch_put(batch, i, p, density);
        }
        envsamp__batch_out(cdf->mapping, count, batch, x + start, y + start, z + start,
                           pdf + start);
    }
}

ENVSAMP_DEF void envsamp_cdf_pdf_n(const envsamp_cdf *cdf, size_t n, const float *x,
                                   const float *y, const float *z, float *pdf)
{
    envsamp__cdf_texel at[ENVSAMP__BATCH];
    float r[ENVSAMP__BATCH];

    ENVSAMP_ASSERT(cdf && n <= SIZE_MAX / 8 && ((x && y && z && pdf) || !n));
    int octahedral = cdf->mapping == ENVSAMP_OCTAHEDRAL;
    for (size_t start = 0; start < n; start += ENVSAMP__BATCH) {
        size_t count = n - start < ENVSAMP__BATCH ? n - start : ENVSAMP__BATCH;

        for (size_t i = 0; i < count; i++)
            r[i] = x[start + i] * x[start + i] + y[start + i] * y[start + i];
        envsamp__sqrt_n(r, (int)count);
        for (size_t i = 0; i < count && octahedral; i++) {
            at[i] = envsamp__cdf_at(cdf, 1, x[start + i], y[start + i], z[start + i], r[i]);
            ENVSAMP__PREFETCH(ENVSAMP__CDF_EDGES(ENVSAMP__ARRAY, cdf, at[i].row) + at[i].column);
        }
        for (size_t i = 0; i < count && !octahedral; i++) {
            at[i] = envsamp__cdf_at(cdf, 0, x[start + i], y[start + i], z[start + i], r[i]);
            ENVSAMP__PREFETCH(ENVSAMP__CDF_EDGES(ENVSAMP__ARRAY, cdf, at[i].row) + at[i].column);
        }
        for (size_t i = 0; i < count; i++)
            pdf[start + i] = envsamp__cdf_density(cdf, at[i]);
    }
}

#endif  /* ENVSAMP_NO_CDF */

#ifndef ENVSAMP_NO_LIGHTS

/* ============================================================================================
 * HALFTONE                                                                 [search: @halftone]
 *
 * Error diffusion [9]: importance is summed along a path over the map. Where the sum passes half
 * of S/M, the texel there is chosen and S/M is taken off the sum: what is left is the error.
 *
 *       +-----------+-----------+-----------+    CELLS: a cell holds half a sample on average. Rows
 *       | 1 4 5 8 ->| 1 4 5 8 ->| 1 4 5 8   |    of cells are walked to and fro, a cell column by
 *       | 2 3 6 7   | 2 3 6 7   | 2 3 6 7 | |    column, down and up, in every second row of cells
 *       +-----------+-----------+---------|-+    up and down. A cell of n >= 2 samples is walked in
 *       |   7 6 3 2 |   7 6 3 2 |   7 6 3 v |    2 floor(sqrt(n / 2)) + 1 bands, each as a low cell
 *       |   8 5 4 1 |<- 8 5 4 1 |<- 8 5 4 1 |    of that row. All of the error goes on along the
 *       +-----------+-----------+-----------+    path.
 *
 * TEXELS: a cell is one texel. A kernel splits its error between the next texels and those below;
 * shares outside of the map go to those inside, so nothing is lost.
 *
 * The errors at the end sum to what the samples miss of S, so M samples come out by themselves, but
 * for rounding and for texels that are black or brighter than S/M. With `once`, all lit texels are
 * chosen that are left when as many samples are missing.
 *
 * A kernel of a few texels cannot spread a handful of samples over thousands: no column chooses
 * before it has gathered half a sample, then a dozen choose in one row. And an error from above may
 * choose a texel of hardly any importance: divided by its probability, that sample is a firefly.
 * With all of the error ahead, regions of equal light are compact along rows of cells, and a random
 * start makes the expected count of every texel proportional to its importance (other ways:
 * bench/experiments.md). Columns are summed first: texels are read only where the sum of one
 * crosses the threshold.
 * ========================================================================================== */

#define ENVSAMP__TAPS 12

/* Where a kernel sends `parts` of an error: `across` texels on in the direction of the scan, and
   `below` rows below. */
typedef struct envsamp__tap { signed char across, below, parts; } envsamp__tap;

typedef struct envsamp__halftone {
    const envsamp_image *image;
    const double *row_sr;       /* solid angle of a texel of each row; NULL: 1 */
    envsamp_halftone_desc desc; /* count: no more than can be chosen; once: not with RANDOM */
    envsamp_texel *texels;
    int chosen;
    int64_t lit;                /* with `once`: texels above zero that are still to come */
    double total;               /* S */
    double error;               /* importance that was passed and not yet chosen */
    double threshold, quantum;  /* choose where error is above the one, and take off the other */
    double log_unit;            /* RANDOM: importance to the next draw by log2 of a random number */
    int across, down;           /* cells */
    int cell, strip, step;      /* where the scan is in which row of cells, and its direction */
    int x0, x1, y0, y1;         /* texels of the cell */
    double *sum;                /* importance of every column of the strip, */
    int *lit_count;             /* and how many of its texels are above zero */
    double *waiting;            /* errors for cells of this row of them and the next, in turns */
    int rows;                   /* of these, by the kernel; 0: all of an error goes ahead */
    const envsamp__tap *tap;    /* one of 0 parts after the last */
} envsamp__halftone;

/* Entry `number` of a sequence of random numbers in (0, 1): a bijection of 32 bits twice, which
   flips about half of them for each that changes. */
ENVSAMP__COLD double envsamp__random(uint32_t seed, uint32_t number)
{
    uint32_t x = seed;

    for (int pass = 0; pass < 2; pass++) {
        x = (x ^ 0x9e3779b9u) + number;
        x ^= x >> 16;
        x *= 0x7feb352du;
        x ^= x >> 15;
        x *= 0x846ca68bu;
        x ^= x >> 16;
    }
    return ((double)(x >> 1) + 0.5) / 2147483648.0;
}

/* As envsamp_luminance, in double, of sums of pixels. */
static double envsamp__luminance(const double *rgb, int channels)
{
    return channels == 1 ? rgb[0] : 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
}

/* The luminance of a texel, in double, and its channels. */
static double envsamp__texel_value(const envsamp_image *image, int x, int y, double rgb[3])
{
    float mended[3];

    envsamp__mend_pixel(envsamp__pixel_at(image, x, y), image->channels, mended);
    for (int c = 0; c < 3; c++)
        rgb[c] = (double)mended[c];
    return envsamp__luminance(rgb, image->channels);
}

/* Sums of columns between two rows; returns how many pixels are bad. */
static size_t envsamp__sum_columns(envsamp__halftone *h, int y0, int y1)
{
    const envsamp_image *image = h->image;
    float luminance[ENVSAMP__CHUNK];
    size_t bad = 0;

    ENVSAMP_MEMSET(h->sum, 0, (size_t)image->width * sizeof *h->sum);
    ENVSAMP_MEMSET(h->lit_count, 0, (size_t)image->width * sizeof *h->lit_count);
    for (int y = y0; y < y1; y++)
        for (int x = 0; x < image->width; x += ENVSAMP__CHUNK) {
            int count = envsamp__min(ENVSAMP__CHUNK, image->width - x);
            double sr = h->row_sr ? h->row_sr[y] : 1.0;

            bad += envsamp__read_luminance(envsamp__pixel_at(image, x, y), image->channels, count,
                                           luminance);
            for (int i = 0; i < count; i++) {
                h->sum[x + i] += sr * (double)luminance[i];
                h->lit_count[x + i] += luminance[i] > 0.0f;
            }
        }
    return bad;
}

/* A texel. With `once` it is chosen, too, if those that are still to come are too few. */
static void envsamp__walk_texel(envsamp__halftone *h, int x, int y)
{
    double rgb[3], value = envsamp__texel_value(h->image, x, y, rgb);

    if (!(value > 0.0))
        return;
    value *= h->row_sr ? h->row_sr[y] : 1.0;
    h->error += value;
    h->lit--;
    while (h->chosen < h->desc.count
           && (h->error > h->threshold || (h->desc.once && h->lit < h->desc.count - h->chosen))) {
        envsamp_texel texel = { x, y, (float)envsamp__max(value / h->total, (double)FLT_MIN) };

        h->texels[h->chosen++] = texel;
        h->error -= h->quantum;
        if (h->log_unit < 0.0)
            h->quantum = h->threshold = h->log_unit * envsamp__log2(
                envsamp__random(h->desc.seed, (uint32_t)h->chosen));
        if (h->desc.once)
            break;
    }
}

/* Columns of the cell between two rows, in the direction of `step`. Every second row of cells
   begins upwards: else the texels chosen of an even map may all be low in their cells. */
static void envsamp__walk_band(envsamp__halftone *h, int step, int y0, int y1)
{
    int width = h->x1 - h->x0;

    for (int i = 0; i < width; i++) {
        int x = step > 0 ? h->x0 + i : h->x1 - 1 - i;

        if (y1 - y0 < h->y1 - h->y0 || h->error + h->sum[x] > h->threshold
            || (h->desc.once && h->lit - h->lit_count[x] < h->desc.count - h->chosen)) {
            for (int y = y0; y < y1; y++)
                envsamp__walk_texel(h, x, (i + h->strip) & 1 ? y0 + y1 - 1 - y : y);
        } else {                /* a whole column of which none is chosen */
            h->error += h->sum[x];
            h->lit -= h->lit_count[x];
        }
    }
}

/* Where share `share` of `count` begins, into which `length` texels are divided. */
ENVSAMP__COLD int envsamp__share_edge(int share, int count, int length)
{
    return (int)((int64_t)share * length / count);
}

/* The shares of [13]: his table gives them for some levels of 0..255, between which they change
   evenly. Above the middle they are those of 255 less the level. */
static void envsamp__ostromoukhov_shares(double level, double share[3])
{
    static const unsigned char key[][4] = {
        { 0, 13, 0, 5 }, { 1, 13, 0, 5 }, { 2, 21, 0, 10 }, { 3, 7, 0, 4 }, { 4, 8, 0, 5 },
        { 10, 7, 3, 3 }, { 22, 3, 2, 1 }, { 32, 20, 10, 19 }, { 64, 11, 10, 0 }, { 72, 5, 7, 1 },
        { 77, 4, 1, 1 }, { 85, 4, 1, 1 }, { 95, 5, 3, 2 }, { 107, 5, 3, 2 }, { 127, 4, 1, 1 },
        { 128, 4, 1, 1 }
    };
    double at = 255.0 * envsamp__clamp(level, 0.0, 1.0);
    int i = 0;

    at = at < 127.5 ? at : 255.0 - at;
    while (at > (double)key[i + 1][0])
        i++;
    const unsigned char *a = key[i], *b = key[i + 1];
    double t = (at - (double)a[0]) / (double)(b[0] - a[0]);
    for (int k = 1; k < 4; k++)
        share[k - 1] = (1.0 - t) * (double)a[k] / (double)(a[1] + a[2] + a[3])
                     + t * (double)b[k] / (double)(b[1] + b[2] + b[3]);
}

/* The errors that wait in the row of cells so many below this one. */
ENVSAMP__COLD double *envsamp__waiting(const envsamp__halftone *h, int below)
{
    return h->waiting + (h->strip + below) % h->rows * h->across;
}

/* Sends the error of a texel on. Shares that would leave the map go to the others. */
static void envsamp__diffuse(envsamp__halftone *h, double importance)
{
    double share[ENVSAMP__TAPS], *to[ENVSAMP__TAPS], sum = 0.0;
    int count = 0;

    if (h->desc.kernel == ENVSAMP_KERNEL_OSTROMOUKHOV)
        envsamp__ostromoukhov_shares(importance / h->quantum, share);
    for (; h->tap[count].parts; count++) {
        int x = h->cell + h->step * h->tap[count].across, below = h->tap[count].below;

        if (h->desc.kernel != ENVSAMP_KERNEL_OSTROMOUKHOV)
            share[count] = (double)h->tap[count].parts;
        to[count] = x >= 0 && x < h->across && h->strip + below < h->down
                  ? envsamp__waiting(h, below) + x : NULL;
        sum += to[count] ? share[count] : 0.0;
    }
    double scale = sum > 0.0 ? h->error / sum : 0.0;    /* after the last one none is left */
    for (int i = 0; i < count; i++)
        if (to[i])
            *to[i] += scale * share[i];
    h->error = 0.0;
}

/* A row of cells in the direction of the scan. Bands keep dense samples from standing in lines.
   Their number is odd, so that the last one ends where the next cell begins. RANDOM does not need
   them. */
static void envsamp__walk_strip(envsamp__halftone *h)
{
    const envsamp_image *image = h->image;

    h->y0 = envsamp__share_edge(h->strip, h->down, image->height);
    h->y1 = envsamp__share_edge(h->strip + 1, h->down, image->height);
    int height = h->y1 - h->y0;
    envsamp__sum_columns(h, h->y0, h->y1);
    for (int i = 0; i < h->across; i++) {
        double mass = 0.0;
        int bands = 1;

        h->cell = h->step > 0 ? i : h->across - 1 - i;
        h->x0 = envsamp__share_edge(h->cell, h->across, image->width);
        h->x1 = envsamp__share_edge(h->cell + 1, h->across, image->width);
        for (int x = h->x0; x < h->x1; x++)
            mass += h->sum[x];
        if (mass >= 2.0 * h->quantum && !(h->log_unit < 0.0)) {
            bands = 2 * (int)envsamp__min_double(ENVSAMP_SQRT(0.5 * mass / h->quantum),
                                                 (double)height) + 1;
            bands = envsamp__min(bands, height - !(height & 1));
        }
        if (h->rows)
            h->error += envsamp__waiting(h, 0)[h->cell];
        for (int band = 0; band < bands; band++)
            envsamp__walk_band(h, band & 1 ? -h->step : h->step,
                               h->y0 + envsamp__share_edge(band, bands, height),
                               h->y0 + envsamp__share_edge(band + 1, bands, height));
        if (h->rows)
            envsamp__diffuse(h, mass);
    }
    if (h->rows)
        ENVSAMP_MEMSET(envsamp__waiting(h, 0), 0, (size_t)h->across * sizeof(double));
}

/* Lays cells out, which with CELLS are about square in texels. RANDOM has one a strip. Neither has
   taps. */
static void envsamp__halftone_carve(envsamp__halftone *h, const envsamp_halftone_desc *desc,
                                    const envsamp_image *image, const double *row_sr,
                                    envsamp__arena *arena)
{
    static const envsamp__tap taps[][ENVSAMP__TAPS + 1] = {
        { { 1, 0, 3 }, { 0, 1, 3 }, { 1, 1, 2 } },
        { { 1, 0, 7 }, { -1, 1, 3 }, { 0, 1, 5 }, { 1, 1, 1 } },
        { { 1, 0, 7 }, { 2, 0, 5 },
          { -2, 1, 3 }, { -1, 1, 5 }, { 0, 1, 7 }, { 1, 1, 5 }, { 2, 1, 3 },
          { -2, 2, 1 }, { -1, 2, 3 }, { 0, 2, 5 }, { 1, 2, 3 }, { 2, 2, 1 } },
        { { 1, 0, 8 }, { 2, 0, 4 },
          { -2, 1, 2 }, { -1, 1, 4 }, { 0, 1, 8 }, { 1, 1, 4 }, { 2, 1, 2 },
          { -2, 2, 1 }, { -1, 2, 2 }, { 0, 2, 4 }, { 1, 2, 2 }, { 2, 2, 1 } },
        { { 1, 0, 1 }, { -1, 1, 1 }, { 0, 1, 1 } }      /* by importance: see above */
    };
    double width = (double)image->width, height = (double)image->height, side = 1.0;
    int random = desc->kernel == ENVSAMP_KERNEL_RANDOM;

    ENVSAMP_MEMSET(h, 0, sizeof *h);
    h->image = image;
    h->row_sr = row_sr;
    h->desc = *desc;
    h->desc.once = desc->once && !random;
    if (random) {
        side = 16.0;
    } else if (desc->scan == ENVSAMP_SCAN_CELLS) {
        side = envsamp__max(ENVSAMP_SQRT(width * height / (2.0 * (double)desc->count)), 1.0);
    } else {
        h->tap = taps[desc->kernel];
        for (int i = 0; h->tap[i].parts; i++)
            h->rows = 1 + h->tap[i].below;
    }
    h->across = random ? 1 : envsamp__max_int((int)(width / side), 1);
    h->down = envsamp__max_int((int)(height / side), 1);
    h->waiting = ENVSAMP__TAKE(double, arena, h->rows * h->across);
    h->sum = ENVSAMP__TAKE(double, arena, image->width);
    h->lit_count = ENVSAMP__TAKE(int, arena, image->width);
}

/* Chooses `wanted` texels. Without `once`, error that ends in black cells leaves some out, and
   rounding, in a map of denormals, may leave all out: then the last texel chosen, or the first lit
   one of the last row, repeats. RANDOM: its draws, in their order, are as the sums of exponential
   spacings over the sum of one more [14]. */
static void envsamp__halftone_scan(envsamp__halftone *h)
{
    double start = envsamp__random(h->desc.seed, 0);

    ENVSAMP_MEMSET(h->waiting, 0, (size_t)(h->rows * h->across) * sizeof(double));
    h->quantum = h->total / (double)h->desc.count;
    h->threshold = 0.5 * h->quantum;
    if (h->desc.kernel == ENVSAMP_KERNEL_RANDOM) {
        double sum = 0.0;

        for (int i = 0; i <= h->desc.count; i++)
            sum += envsamp__log2(envsamp__random(h->desc.seed, (uint32_t)i));
        h->log_unit = h->total / sum;
        h->quantum = h->threshold = h->log_unit * envsamp__log2(start);
    } else if (h->desc.seed) {
        h->error = (start - 0.5) * h->quantum;
    }
    for (h->strip = 0; h->strip < h->down && h->chosen < h->desc.count; h->strip++) {
        h->step = h->strip % 2 ? -1 : 1;
        envsamp__walk_strip(h);
    }
    h->threshold = -DBL_MAX;
    for (int y = h->image->height - 1; y >= 0 && h->chosen == 0; y--)
        for (int x = 0; x < h->image->width && h->chosen == 0; x++)
            envsamp__walk_texel(h, x, y);
    for (; h->chosen < h->desc.count; h->chosen++)
        h->texels[h->chosen] = h->texels[h->chosen - 1];
}

ENVSAMP_DEF envsamp_result envsamp_halftone_sizes(int width, int height,
                                                  const envsamp_halftone_desc *desc,
                                                  envsamp_sizes *sizes)
{
    const envsamp_image image = { NULL, width, height, 1, 0, ENVSAMP_LATLONG };
    envsamp__arena arena = { NULL, 0 };
    envsamp__halftone h;

    if (!sizes)
        return ENVSAMP_ERR_NULL;
    sizes->table_bytes = sizes->scratch_bytes = 0;
    if (!desc)
        return ENVSAMP_ERR_NULL;
    if (width < 1 || width > 65535 || height < 1 || height > 65535)     /* bytes do not matter */
        return ENVSAMP_ERR_SIZE;
    if (desc->count < 1 || (uint32_t)desc->kernel > ENVSAMP_KERNEL_RANDOM
        || (uint32_t)desc->scan > ENVSAMP_SCAN_TEXELS)
        return ENVSAMP_ERR_PARAM;
    envsamp__halftone_carve(&h, desc, &image, NULL, &arena);
    return envsamp__set_sizes(sizes, 0, arena.used);
}

ENVSAMP_DEF envsamp_result envsamp_halftone(const float *importance, int width, int height,
                                            size_t row_stride_bytes,
                                            const envsamp_halftone_desc *desc,
                                            envsamp_texel *texels, int capacity, int *count,
                                            envsamp_buffer scratch)
{
    const envsamp_image image = { importance, width, height, 1, row_stride_bytes, ENVSAMP_LATLONG };
    envsamp__arena arena = { (char *)scratch.data, 0 };
    envsamp__halftone h;
    envsamp_sizes sizes;
    envsamp_result result;

    if (!count)
        return ENVSAMP_ERR_NULL;
    *count = 0;
    result = importance && texels ? envsamp_halftone_sizes(width, height, desc, &sizes)
                                  : ENVSAMP_ERR_NULL;
    if (result == ENVSAMP_OK)
        result = envsamp__image_check(&image);
    if (result == ENVSAMP_OK)
        result = envsamp__floats_check(importance);
    if (result == ENVSAMP_OK)
        result = capacity < desc->count ? ENVSAMP_ERR_MEMORY
                                        : envsamp__buffers_check(&sizes, scratch, scratch);
    if (result != ENVSAMP_OK)
        return result;
    envsamp__halftone_carve(&h, desc, &image, NULL, &arena);
    if (envsamp__sum_columns(&h, 0, height))
        return ENVSAMP_ERR_VALUE;
    for (int x = 0; x < width; x++) {
        h.total += h.sum[x];
        h.lit += h.lit_count[x];
    }
    if (!(h.total > 0.0))
        return ENVSAMP_ERR_BLACK;
    if (desc->once && h.lit < desc->count)
        h.desc.count = (int)h.lit;
    h.texels = texels;
    envsamp__halftone_scan(&h);
    *count = h.desc.count;
    return ENVSAMP_OK;
}

/* ============================================================================================
 * LIGHTS                                                                     [search: @lights]
 *
 * HALFTONE and RANDOM choose texels of the map weighed by solid angle. Each of K lights has I/K of
 * the integral I of luminance: it stands for a solid angle of I/K over its luminance, and that
 * times its radiance is its irradiance. A texel with several times I/K is chosen several times; on
 * other texels, as in a halftone for print, these lights would shine from beside a sun.
 *
 * The other methods cut the map into regions: a light is the sum of one, or of the nearest of many.
 * ========================================================================================== */

static float envsamp__to_float(double value)
{
    return value < (double)FLT_MAX ? (float)value : FLT_MAX;
}

#define ENVSAMP__PATCHES_MAX 256    /* each way; a patch is of some texels */
#define ENVSAMP__PIECE_PATCHES 128  /* the same with RELAXED */
#define ENVSAMP__LINES_MAX 512      /* rows or columns of patches, or of texels of one patch */
#define ENVSAMP__BINS 65536         /* of luminance */

/* Sums over texels by solid angle: luminance, luminance x direction, channels; and solid angle. */
typedef struct envsamp__patch { double luminance, v[3], rgb[3], sr; } envsamp__patch;

/* A rectangle of texels: whole patches, or within one. */
typedef struct envsamp__region {
    uint16_t x0, y0, x1, y1;
    int copies;                 /* lights that share it, where it cannot be cut */
    int light;                  /* of a piece: the nearest light */
    double deviation;           /* DECOMPOSED: standard deviation x solid angle; below 0: not yet
                                   known */
    envsamp__patch sum;
} envsamp__region;

#define ENVSAMP__POINTS 8       /* pieces that are looked at together: a constant, so that compilers
                                   vectorise at -O2 too */
#define ENVSAMP__POINT_GROUPS(points) (((size_t)(points) + ENVSAMP__POINTS - 1) / ENVSAMP__POINTS)

/* Directions and shares of pieces or lights; after the last the shares are 0. */
typedef struct envsamp__points {
    float x[ENVSAMP__POINTS], y[ENVSAMP__POINTS], z[ENVSAMP__POINTS], weight[ENVSAMP__POINTS];
} envsamp__points;

/* A light while it moves. */
typedef struct envsamp__mover {
    float axis[3];              /* its direction, */
    float next[3];              /* the same after a step, without momentum, or on a texel, */
    float best[3];              /* and where the energy was least */
    envsamp__patch sum;         /* of the pieces that are nearest to it, */
    int held;                   /* and their number when a light was last sent; */
    int piece;                  /* that of them with most work, */
    double most;                /* and how much that is; also cosine of its nearest texel */
    double weight, best_weight; /* now, and where the energy was least */
    double toward[3];           /* sum of share x direction / chord over the pieces, */
    double chord, lights_chord; /* and of share x chord, over the pieces and over the lights; also
                                   work */
    int tried;                  /* another was sent to it in vain */
} envsamp__mover;

typedef struct envsamp__lights {
    const envsamp_image *image;
    const envsamp_lights_desc *desc;
    double *row_sr;             /* solid angle of a texel of each row */
    envsamp_lights_info info;

    envsamp__halftone halftone; /* HALFTONE and RANDOM */

    int wide, tall;             /* of a patch, in texels; */
    int across, down;           /* how many there are */
    double *azimuth, *polar;    /* see envsamp__fill_angles; NULL: no tables */
    envsamp__patch *patches;
    envsamp__patch total;       /* of all texels of the lights so far */
    envsamp__patch *line;       /* 2 x ENVSAMP__LINES_MAX */
    envsamp_lights_method rule; /* how regions are cut */
    envsamp__heap heap;         /* of regions, by key */
    envsamp__region *regions;
    int count;
    int most;                   /* pieces at most */
    double weight[3];           /* DECOMPOSED: of terms in a key */

    int made;                   /* lights that are all different: movers, EnvDirects */
    envsamp__mover *movers;
    envsamp__points *points;    /* the pieces again, for loops over many of them, */
    envsamp__points *places;    /* and the lights */
    float *reach;               /* squared chord of each piece to its light */
    double energy;              /* the least found */

    int label;                  /* the texels that count; ENVSAMP__ANY: all */
    uint8_t *labels;            /* DECOMPOSED: of all texels */
    float *map;                 /* their luminance, row after row */
    double *bins;               /* solid angle by luminance */
    double light[2], sr[2];     /* luminance and solid angle of all texels of a label */
} envsamp__lights;

enum { ENVSAMP__DIM, ENVSAMP__EMISSIVE, ENVSAMP__ANY };     /* labels: 0, 1 as in a mask */

/* ---- sums ---- */

/* Scales a vector to length 1; leaves dir alone if it has none. */
static void envsamp__normalise(const double v[3], float dir[3])
{
    double length = ENVSAMP_SQRT(envsamp__dot(v, v, 3));

    for (int c = 0; c < 3 && length > 0.0; c++)
        dir[c] = (float)(v[c] / length);
}

/* Solid angle of a texel of each row, a difference of cosines as a product: nothing cancels. And
   where there are tables, sine and cosine of the azimuth after every half of a column of texels,
   and of the polar angle after every half of a row. */
static void envsamp__fill_angles(envsamp__lights *l)
{
    double turn = l->image->mapping == ENVSAMP_HEMISPHERE ? 0.5 : 1.0, sine, half, cosine;
    double width = (double)l->image->width, height = (double)l->image->height;

    envsamp__sincos_pi(turn * 0.5 / height, &half, &cosine);
    for (int y = 0; y < l->image->height; y++) {
        envsamp__sincos_pi(turn * ((double)y + 0.5) / height, &sine, &cosine);
        l->row_sr[y] = l->image->mapping == ENVSAMP_OCTAHEDRAL
                     ? 4.0 * ENVSAMP__PI / (width * height)
                     : 4.0 * ENVSAMP__PI / width * half * sine;
    }
    for (int i = 0; l->azimuth && i <= 2 * l->image->width; i++)
        envsamp__sincos_pi((double)i / width, &l->azimuth[2 * i], &l->azimuth[2 * i + 1]);
    for (int i = 0; l->azimuth && i <= 2 * l->image->height; i++)
        envsamp__sincos_pi(0.5 * turn * (double)i / height, &l->polar[2 * i],
                           &l->polar[2 * i + 1]);
}

/* Direction of a point of the map, in halves of texels. */
static void envsamp__map_dir(const envsamp__lights *l, int x, int y, double dir[3])
{
    float at[3];

    if (l->azimuth) {
        dir[0] = l->azimuth[2 * x + 1] * l->polar[2 * y];
        dir[1] = l->azimuth[2 * x] * l->polar[2 * y];
        dir[2] = l->polar[2 * y + 1];
    } else {
        envsamp_uv_to_dir(l->image->mapping, (float)(0.5 * (double)x / (double)l->image->width),
                          (float)(0.5 * (double)y / (double)l->image->height), at);
        for (int c = 0; c < 3; c++)
            dir[c] = (double)at[c];
    }
}

/* Lets the channels of a patch, which are sums by solid angle, shine from a point of the map. */
static void envsamp__aim_patch(const envsamp__lights *l, int x, int y, envsamp__patch *patch)
{
    envsamp__map_dir(l, x, y, patch->v);
    patch->luminance = envsamp__luminance(patch->rgb, l->image->channels);
    for (int c = 0; c < 3; c++)
        patch->v[c] *= patch->luminance;
}

static void envsamp__add_patch(const envsamp__patch *patch, envsamp__patch *sum)
{
    sum->luminance += patch->luminance;
    sum->sr += patch->sr;
    for (int c = 0; c < 3; c++) {
        sum->v[c] += patch->v[c];
        sum->rgb[c] += patch->rgb[c];
    }
}

static void envsamp__add_texel(const envsamp__lights *l, int x, int y, envsamp__patch *sum)
{
    envsamp__patch texel;

    texel.sr = l->row_sr[y];
    envsamp__texel_value(l->image, x, y, texel.rgb);
    for (int c = 0; c < 3; c++)
        texel.rgb[c] *= texel.sr;
    envsamp__aim_patch(l, 2 * x + 1, 2 * y + 1, &texel);
    envsamp__add_patch(&texel, sum);
}

/* Whether a texel counts. */
static inline int envsamp__counts(const envsamp__lights *l, int x, int y)
{
    return l->label == ENVSAMP__ANY
        || l->labels[(size_t)y * (size_t)l->image->width + (size_t)x] == l->label;
}

/* ---- regions ----
 *
 * A rectangle is cut in two, again and again: that with the largest key first. MEDIAN_CUT: that of
 * most luminance, across its longer side, into equal halves [16]. VARIANCE_CUT: that of the largest
 * spread, luminance x squared distance from the centroid, where the spreads of the halves are least
 * [17]. DECOMPOSED, RELAXED: see there; across the longer side in its middle. Sums are never
 * differences, so nothing cancels.
 */

/* How long a rectangle is on the sphere, across or down, in half turns. */
ENVSAMP__COLD double envsamp__extent(const envsamp_image *image, const envsamp__region *r, int down)
{
    double polar = image->mapping == ENVSAMP_HEMISPHERE ? 0.5 : 1.0, sine = 0.5, cosine;
    double height = (double)image->height;

    if (down)
        return polar * (double)(r->y1 - r->y0) / height;
    if (image->mapping != ENVSAMP_OCTAHEDRAL)
        envsamp__sincos_pi(polar * 0.5 * (double)(r->y0 + r->y1) / height, &sine, &cosine);
    return 2.0 * sine * (double)(r->x1 - r->x0) / (double)image->width;
}

static double envsamp__spread(const envsamp__patch *sum)
{
    double light = sum->luminance;

    return light > 0.0 ? envsamp__max(light - envsamp__dot(sum->v, sum->v, 3) / light, 0.0) : 0.0;
}

/* DECOMPOSED: V, standard deviation x solid angle; D, longer side; E, luminance. */
static void envsamp__region_terms(const envsamp__lights *l, envsamp__region *r, double term[3])
{
    if (r->deviation < 0.0) {
        double square = 0.0;

        for (int y = r->y0 / l->tall; y * l->tall < r->y1; y++)
            for (int x = r->x0 / l->wide; x * l->wide < r->x1; x++) {
                const envsamp__patch *patch = &l->patches[y * l->across + x];

                if (patch->sr > 0.0)
                    square += patch->luminance * patch->luminance / patch->sr;
            }
        square = square * r->sum.sr - r->sum.luminance * r->sum.luminance;
        r->deviation = ENVSAMP_SQRT(envsamp__max(square, 0.0));
    }
    term[0] = r->deviation;
    term[1] = envsamp__max(envsamp__extent(l->image, r, 0), envsamp__extent(l->image, r, 1));
    term[2] = r->sum.luminance;
}

/* The region to be cut next has the largest; below 0: it cannot be cut, but shared. */
static double envsamp__region_key(const envsamp__lights *l, envsamp__region *r)
{
    double share = r->sum.luminance / (double)r->copies, term[3];
    int width = r->x1 - r->x0, height = r->y1 - r->y0;

    if (l->rule == ENVSAMP_LIGHTS_VARIANCE_CUT)
        return 1e-9 * share + envsamp__spread(&r->sum) / (double)r->copies;
    if (l->rule == ENVSAMP_LIGHTS_RELAXED && (width > 8 * l->wide || height > 8 * l->tall))
        return DBL_MAX;
    if (l->rule == ENVSAMP_LIGHTS_RELAXED)
        return width > 1 || height > 1 ? share : -1.0;
    if (l->rule != ENVSAMP_LIGHTS_DECOMPOSED)
        return share;
    envsamp__region_terms(l, r, term);
    return width > l->wide || height > l->tall ? envsamp__dot(l->weight, term, 3)
                                               : -1.0 / (share + DBL_MIN);
}

/* Makes the heap of regions. */
static void envsamp__sort_regions(envsamp__lights *l)
{
    l->heap.count = 0;
    for (int i = 0; i < l->count; i++)
        envsamp__heap_push(&l->heap, envsamp__region_key(l, &l->regions[i]), (uint32_t)i, 0);
}

/* Sums of `count` rows or columns of a region: of patches, or of texels. */
static void envsamp__sum_lines(const envsamp__lights *l, const envsamp__region *r, int texels,
                               int down, int count, envsamp__patch *line)
{
    int x0 = r->x0 / l->wide, y0 = r->y0 / l->tall;

    ENVSAMP_MEMSET(line, 0, (size_t)count * sizeof *line);
    for (int y = r->y0; texels && y < r->y1; y++)
        for (int x = r->x0; x < r->x1; x++)
            if (envsamp__counts(l, x, y))
                envsamp__add_texel(l, x, y, &line[down ? y - r->y0 : x - r->x0]);
    for (int y = y0; !texels && y * l->tall < r->y1; y++)
        for (int x = x0; x * l->wide < r->x1; x++)
            envsamp__add_patch(&l->patches[y * l->across + x], &line[down ? y - y0 : x - x0]);
}

/* Cuts a region where the cost is least: how far the parts are from equal in luminance or number of
   lines, or the sum of their spreads. But for halves, both parts need 1e-9 of its luminance;
   without a cut the other axis is tried. VARIANCE_CUT tries both. Halves within a patch are of
   texels; where one is black the region shrinks to the other. Returns 0 if there is nothing left to
   cut. */
static int envsamp__cut_region(envsamp__lights *l, envsamp__region *r, envsamp__region *rest)
{
    int variance = l->rule == ENVSAMP_LIGHTS_VARIANCE_CUT;
    int halves = !variance && l->rule != ENVSAMP_LIGHTS_MEDIAN_CUT;
    envsamp__patch *line = l->line, *after = line + ENVSAMP__LINES_MAX;
    envsamp__region parts[2];

    do {
        int width = r->x1 - r->x0, height = r->y1 - r->y0;
        int texels = l->rule == ENVSAMP_LIGHTS_RELAXED && width <= l->wide && height <= l->tall;
        int wide = texels ? 1 : l->wide, tall = texels ? 1 : l->tall;
        int first = !variance && envsamp__extent(l->image, r, 0) < envsamp__extent(l->image, r, 1);
        double best = -1.0, least = 1e-9 * r->sum.luminance;

        for (int pass = 0; pass < 2 && (variance || best < 0.0); pass++) {
            int down = first ^ pass, side = down ? tall : wide;
            int count = ((down ? height : width) + side - 1) / side;

            envsamp__sum_lines(l, r, texels, down, count, line);
            ENVSAMP_MEMCPY(after, line, (size_t)count * sizeof *line);
            for (int i = count - 1; i-- > 0; )
                envsamp__add_patch(&after[i + 1], &after[i]);
            envsamp__patch before = line[0];
            for (int i = 1; i < count; envsamp__add_patch(&line[i++], &before)) {
                double cost = halves ? ENVSAMP__FABS((double)(2 * i - count))
                            : variance ? envsamp__spread(&before) + envsamp__spread(&after[i])
                            : ENVSAMP__FABS(before.luminance - after[i].luminance);

                if ((best >= 0.0 && cost >= best)
                    || (!halves && !(before.luminance > least && after[i].luminance > least)))
                    continue;
                best = cost;
                parts[0] = parts[1] = *r;
                parts[0].sum = before;
                parts[1].sum = after[i];
                if (down)
                    parts[0].y1 = parts[1].y0 = (uint16_t)(r->y0 + i * side);
                else
                    parts[0].x1 = parts[1].x0 = (uint16_t)(r->x0 + i * side);
            }
        }
        if (best < 0.0)
            return 0;
        *rest = parts[1];
        *r = parts[0].sum.luminance > 0.0 ? parts[0] : parts[1];
        r->deviation = rest->deviation = -1.0;
    } while (!(parts[0].sum.luminance > 0.0 && parts[1].sum.luminance > 0.0));
    return 1;
}

/* Cuts the region of the largest key; one that cannot be cut is shared by one more light. */
static void envsamp__cut_top(envsamp__lights *l)
{
    int halves = l->rule == ENVSAMP_LIGHTS_DECOMPOSED || l->rule == ENVSAMP_LIGHTS_RELAXED;
    envsamp__region *top = &l->regions[l->heap.entries->item], *rest = &l->regions[l->count];
    int shared = l->heap.entries->key < 0.0;
    int cut = !shared && top->copies == 1 && envsamp__cut_region(l, top, rest);

    top->copies += shared || (!halves && !cut);
    l->heap.entries->key = envsamp__region_key(l, top);
    envsamp__heap_settle(&l->heap);
    if (cut)
        envsamp__heap_push(&l->heap, envsamp__region_key(l, rest), (uint32_t)l->count++, 0);
}

/* Adds texels x to `end` of row y that count to a patch: their channels, not yet aimed. */
static void envsamp__add_run(const envsamp__lights *l, const float *from, int x, int end, int y,
                             envsamp__patch *patch)
{
    double sr = l->row_sr[y], sum[3] = { 0.0, 0.0, 0.0 };
    int channels = l->image->channels, green = channels > 1, count = 0;

    for (; x < end; x++, from += channels)
        if (envsamp__counts(l, x, y)) {
            sum[0] += (double)from[0];
            sum[1] += (double)from[green];
            sum[2] += (double)from[2 * green];
            count++;
        }
    for (int c = 0; c < 3; c++)
        patch->rgb[c] += sr * sum[c];
    patch->sr += sr * (double)count;
}

/* Sums the texels of a label over patches, and all of them into one region, which is cut by the
   method's rule, of emissive texels by RELAXED's. Returns how many pixels are bad. */
static size_t envsamp__begin_regions(envsamp__lights *l, int label)
{
    const envsamp_image *image = l->image;
    float mended[4 * ENVSAMP__CHUNK];
    envsamp__patch sum;
    size_t bad = 0;

    l->label = label;
    l->rule = label == ENVSAMP__EMISSIVE ? ENVSAMP_LIGHTS_RELAXED : l->desc->method;
    ENVSAMP_MEMSET(l->patches, 0, (size_t)(l->across * l->down) * sizeof *l->patches);
    ENVSAMP_MEMSET(&sum, 0, sizeof sum);
    for (int y = 0; y < image->height; y++)
        for (int x = 0, last; x < image->width; x = last) {
            int counted = 0;

            last = envsamp__min(x + ENVSAMP__CHUNK, image->width);
            for (int k = x; k < last && !counted; k++)
                counted = envsamp__counts(l, k, y);
            if (!counted)
                continue;
            const float *from = envsamp__read_pixels(envsamp__pixel_at(image, x, y),
                                                     image->channels, last - x, mended, &bad);

            for (int k = x, end; k < last; k = end) {
                end = envsamp__min((k / l->wide + 1) * l->wide, last);
                envsamp__add_run(l, from + (k - x) * image->channels, k, end, y,
                                 &l->patches[y / l->tall * l->across + k / l->wide]);
            }
        }
    for (int k = 0; k < l->across * l->down; k++) {
        int x = k % l->across * l->wide, y = k / l->across * l->tall;

        envsamp__aim_patch(l, x + envsamp__min(x + l->wide, image->width),
                           y + envsamp__min(y + l->tall, image->height), &l->patches[k]);
        envsamp__add_patch(&l->patches[k], &sum);
    }
    envsamp__add_patch(&sum, &l->total);
    if (l->regions) {
        envsamp__region whole = { 0, 0, (uint16_t)image->width, (uint16_t)image->height, 1, 0, -1.0,
                                  sum };

        l->regions[0] = whole;
        l->count = 1;
        envsamp__sort_regions(l);
    }
    return bad;
}

/* One of `copies` lights that stand for a sum: with the cone of an even disc whose centroid is as
   far from the middle of the sphere. */
static void envsamp__set_light(const envsamp__patch *sum, const float dir[3], int copies,
                               envsamp_light *light)
{
    double r = sum->luminance > 0.0 ? ENVSAMP_SQRT(envsamp__dot(sum->v, sum->v, 3)) / sum->luminance
                                    : 1.0;

    ENVSAMP_MEMSET(light, 0, sizeof *light);
    ENVSAMP_MEMCPY(light->dir, dir, sizeof light->dir);
    for (int c = 0; c < 3; c++)
        light->irradiance[c] = envsamp__to_float(sum->rgb[c] / (double)copies);
    light->solid_angle = (float)(sum->sr / (double)copies);
    light->cos_extent = (float)envsamp__clamp(2.0 * r - 1.0, -1.0, 1.0);
}

/* Direction of the centroid of a region, or of its middle. */
ENVSAMP__COLD void envsamp__region_dir(const envsamp__lights *l, const envsamp__region *r,
                                     float dir[3])
{
    double middle[3];

    envsamp__map_dir(l, r->x0 + r->x1, r->y0 + r->y1, middle);
    envsamp__normalise(middle, dir);
    envsamp__normalise(r->sum.v, dir);
}

/* Cuts until there are `count` lights. */
static void envsamp__cut_lights(envsamp__lights *l, int count, envsamp_light *lights)
{
    float dir[3];

    for (int i = l->count; i < count; i++)
        envsamp__cut_top(l);
    for (int i = 0; i < l->count; i++) {
        envsamp__region_dir(l, &l->regions[i], dir);
        for (int k = 0; k < l->regions[i].copies; k++)
            envsamp__set_light(&l->regions[i].sum, dir, l->regions[i].copies, lights++);
    }
}

/* ---- relaxed ----
 *
 * The map is halved into pieces of at most 1/32 of a light's luminance or single texels, each a
 * direction with a weight. Lights start one by one where the others have most to do, luminance x
 * distance, and Lloyd's relaxation moves them to centroids. Then directions and weights are sought
 * that minimise
 *
 *     2 sum_ij w_i m_j |x_i - p_j| - sum_ik w_i w_k |x_i - x_k|    with    sum w = sum m, w >= 0,
 *
 * where x, w are the lights and p, m the pieces: but for a constant, the squared error of the light
 * in a spherical cap, averaged over all caps [15], as a horizon and the shadow of a ball cut out of
 * the map. Lights exchange weight in pairs until it is least, at last channel by channel; with
 * momentum [20] they step to where x_i solves
 *
 *     sum_j m_j (x - p_j) / |x_i - p_j| = sum_k w_k (x_i - x_k) / |x_i - x_k|
 *
 * (chords to the pieces lie below parabolas that touch them where x_i was, those to other lights
 * above their tangents). Again and again the light of least weight goes to where another has most
 * to do; the lights go back if that does not lower the sum. bench/experiments.md has other ways.
 */

#define ENVSAMP__PIECES_PER_LIGHT 32        /* a piece has at most 1/32 of a light's luminance */
#define ENVSAMP__PIECES_MAX 32768
#define ENVSAMP__RELAXED_MAX (ENVSAMP__PIECES_MAX / 2)      /* lights */
#define ENVSAMP__DISTANCES_MAX (1 << 25)    /* in all rounds */
#define ENVSAMP__RELAX_ROUNDS 8             /* of Lloyd's, before the moves */
#define ENVSAMP__MOVE_ROUNDS 24             /* before a light is sent elsewhere, */
#define ENVSAMP__TRIAL_ROUNDS 8             /* and after it */
#define ENVSAMP__WEIGH_SWEEPS 64            /* of the weights, at last */

/* Sets one of some points. */
static void envsamp__set_point(envsamp__points *points, int i, const float dir[3], double weight)
{
    envsamp__points *group = &points[i / ENVSAMP__POINTS];

    group->x[i % ENVSAMP__POINTS] = dir[0];
    group->y[i % ENVSAMP__POINTS] = dir[1];
    group->z[i % ENVSAMP__POINTS] = dir[2];
    group->weight[i % ENVSAMP__POINTS] = (float)weight;
}

/* Writes points of the pieces, with shares of luminance or of a channel, 0 to 2. */
static void envsamp__fill_points(envsamp__lights *l, int channel, double total)
{
    float dir[3] = { 0.0f, 0.0f, 0.0f };

    for (int i = 0; i < l->count; i++) {
        const envsamp__patch *sum = &l->regions[i].sum;
        double weight = channel < 0 ? sum->luminance : sum->rgb[channel];

        envsamp__region_dir(l, &l->regions[i], dir);
        envsamp__set_point(l->points, i, dir, total > 0.0 ? weight / total : 0.0);
    }
}

/* Makes pieces: halves those that are large, then the brightest, until all have little luminance
   and half of the room is used. */
static void envsamp__make_pieces(envsamp__lights *l)
{
    double bright = l->total.luminance / (double)(ENVSAMP__PIECES_PER_LIGHT * l->made);

    while (l->count < l->most && l->heap.entries->key >= 0.0
           && (l->heap.entries->key > bright || l->count < l->most / 2))
        envsamp__cut_top(l);
    ENVSAMP_MEMSET(l->points, 0, ENVSAMP__POINT_GROUPS(l->count) * sizeof *l->points);
    envsamp__fill_points(l, -1, l->total.luminance);
}

/* Squared chords between some points and a direction. */
static void envsamp__square_chords(const envsamp__points *p, const float *axis,
                                   float square[ENVSAMP__POINTS])
{
    for (int i = 0; i < ENVSAMP__POINTS; i++) {
        float x = p->x[i] - axis[0], y = p->y[i] - axis[1], z = p->z[i] - axis[2];

        square[i] = x * x + y * y + z * z;
    }
}

/* Gives a light the pieces that are nearer to it than to theirs. */
static void envsamp__take_pieces(envsamp__lights *l, int k)
{
    float square[ENVSAMP__POINTS];

    for (int i = 0; i < l->count; i += ENVSAMP__POINTS) {
        envsamp__square_chords(&l->points[i / ENVSAMP__POINTS], l->movers[k].axis, square);
        for (int c = 0; c < ENVSAMP__POINTS && i + c < l->count; c++)
            if (square[c] < l->reach[i + c]) {
                l->reach[i + c] = square[c];
                l->regions[i + c].light = k;
            }
    }
}

/* Gives every piece to the nearest of the first lights; without any they are the first one's, and
   farther away than they can be. */
ENVSAMP__COLD void envsamp__assign_pieces(envsamp__lights *l, int lights)
{
    for (int i = 0; i < l->count; i++) {
        l->regions[i].light = 0;
        l->reach[i] = 5.0f;
    }
    for (int k = 0; k < lights; k++)
        envsamp__take_pieces(l, k);
}

/* Puts a light on a piece, and gives it that and those that it is nearest to. */
static void envsamp__put_light(envsamp__lights *l, int k, int piece)
{
    envsamp__region_dir(l, &l->regions[piece], l->movers[k].axis);
    l->reach[piece] = 5.0f;     /* as no piece is, so it is taken */
    envsamp__take_pieces(l, k);
}

/* Sends a light to the piece with most work, luminance x chord to its light, of the light with most
   weight x work of those that hold several; on trial that is another, which was not tried. Returns
   0 if there is none. */
static int envsamp__send_light(envsamp__lights *l, int sent, int trial)
{
    envsamp__mover *m = l->movers, *busy = NULL;

    for (int k = 0; k < l->made; k++) {
        m[k].held = 0;
        m[k].chord = 0.0;
        m[k].most = -1.0;
    }
    for (int i = 0; i < l->count; i++) {
        envsamp__mover *holder = &m[l->regions[i].light];
        double work = l->regions[i].sum.luminance * (double)ENVSAMP_SQRTF(l->reach[i]);

        holder->held++;
        holder->chord += work;
        holder->piece = work > holder->most ? i : holder->piece;
        holder->most = envsamp__max(work, holder->most);
    }
    for (int k = 0; k < l->made; k++)
        if (!(trial && (k == sent || m[k].tried)) && m[k].held > 1
            && (!busy || m[k].weight * m[k].chord > busy->weight * busy->chord))
            busy = &m[k];
    if (!busy)
        return 0;
    if (trial)
        busy->tried = 1;
    envsamp__put_light(l, sent, busy->piece);
    return 1;
}

/* Sums the pieces of every light, and makes its weight their share. A light that holds none first
   goes to where another has most to do, which may leave another none. */
static void envsamp__sum_pieces(envsamp__lights *l)
{
    envsamp__mover *m = l->movers;
    int k;

    do {
        for (k = 0; k < l->made; k++)
            ENVSAMP_MEMSET(&m[k].sum, 0, sizeof m[k].sum);
        for (int i = 0; i < l->count; i++)
            envsamp__add_patch(&l->regions[i].sum, &m[l->regions[i].light].sum);
        for (k = 0; k < l->made && m[k].sum.luminance > 0.0; k++)
            continue;
    } while (k < l->made && envsamp__send_light(l, k, 0));
    for (k = 0; k < l->made; k++)
        m[k].weight = m[k].sum.luminance / l->total.luminance;
}

/* Lloyd's relaxation, from lights to which the pieces are assigned, until no light moves. */
static void envsamp__relax(envsamp__lights *l, int rounds)
{
    int moved = 1;

    rounds = envsamp__min(rounds, 1 + ENVSAMP__DISTANCES_MAX / (l->count * l->made));
    for (int i = 0; i < rounds && moved; i++) {
        envsamp__sum_pieces(l);
        moved = 0;
        for (int k = 0; k < l->made; k++) {
            float was[3];

            ENVSAMP_MEMCPY(was, l->movers[k].axis, sizeof was);
            envsamp__normalise(l->movers[k].sum.v, l->movers[k].axis);
            moved |= ENVSAMP_MEMCMP(was, l->movers[k].axis, sizeof was) != 0;
        }
        envsamp__assign_pieces(l, l->made);
    }
    envsamp__sum_pieces(l);
}

/* ---- energy of relaxed lights ---- */

static double envsamp__chord(const float a[3], const float b[3])
{
    float x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];

    return (double)ENVSAMP_SQRTF(x * x + y * y + z * z);
}

/* Sums over pieces, or the other lights, from where a light stands: share x direction / chord,
   share / chord, and share x chord. Floats over 16 groups, doubles over these. */
static void envsamp__sum_field(const envsamp__lights *l, int k, const envsamp__points *p, int count,
                               double all[5])
{
    float *own = &l->places[k / ENVSAMP__POINTS].weight[k % ENVSAMP__POINTS], kept = *own;
    size_t groups = ENVSAMP__POINT_GROUPS(count), g;

    *own = 0.0f;
    for (int c = 0; c < 5; c++)
        all[c] = 0.0;
    for (; groups > 0; groups -= g) {
        float sum[5][ENVSAMP__POINTS], chord[ENVSAMP__POINTS];

        ENVSAMP_MEMSET(sum, 0, sizeof sum);
        for (g = 0; g < 2 * ENVSAMP__POINTS && g < groups; g++, p++) {
            envsamp__square_chords(p, l->movers[k].axis, chord);
            for (int i = 0; i < ENVSAMP__POINTS; i++)
                chord[i] += 1e-12f;         /* of a light that stands on a piece */
            envsamp__sqrt_n(chord, ENVSAMP__POINTS);
            for (int i = 0; i < ENVSAMP__POINTS; i++) {
                float share = p->weight[i] / chord[i];

                sum[0][i] += share * p->x[i];
                sum[1][i] += share * p->y[i];
                sum[2][i] += share * p->z[i];
                sum[3][i] += share;
                sum[4][i] += p->weight[i] * chord[i];
            }
        }
        for (int c = 0; c < 5; c++)
            for (int i = 0; i < ENVSAMP__POINTS; i++)
                all[c] += (double)sum[c][i];
    }
    *own = kept;
}

/* Sums where the lights are now; then lets each light exchange weight with that with which the
   energy falls most, in turns. Returns the energy. */
static double envsamp__weigh_lights(envsamp__lights *l, int sweeps)
{
    double most = 1.0, energy = 0.0, all[5];
    envsamp__mover *m = l->movers;

    for (int k = 0; k < l->made; k++)
        envsamp__set_point(l->places, k, m[k].axis, m[k].weight);
    for (int k = 0; k < l->made; k++) {
        envsamp__sum_field(l, k, l->places, l->made, all);
        m[k].lights_chord = all[4];
        envsamp__sum_field(l, k, l->points, l->count, all);
        m[k].chord = all[4];
        ENVSAMP_MEMCPY(m[k].toward, all, sizeof m[k].toward);
    }
    for (; sweeps > 0 && most > 1e-7; sweeps--) {
        most = 0.0;
        for (int k = 0; k < l->made; k++) {
            double gain = 0.0, given = 0.0;
            int with = k;

            for (int i = 0; i < l->made; i++) {
                double chord = envsamp__chord(m[k].axis, m[i].axis), step = 0.0;
                double fall = m[k].chord - m[k].lights_chord - m[i].chord + m[i].lights_chord;

                if (chord > 1e-9)
                    step = envsamp__clamp(fall / (2.0 * chord), -m[i].weight, m[k].weight);
                if (step * (fall - step * chord) > gain) {
                    gain = step * (fall - step * chord);
                    given = step;
                    with = i;
                }
            }
            most = envsamp__max(most, ENVSAMP__FABS(given));
            m[k].weight -= given;
            m[with].weight += given;
            for (int i = 0; i < l->made && with != k; i++)
                m[i].lights_chord += given * (envsamp__chord(m[with].axis, m[i].axis)
                                              - envsamp__chord(m[k].axis, m[i].axis));
        }
    }
    for (int k = 0; k < l->made; k++)
        energy += m[k].weight * (2.0 * m[k].chord - m[k].lights_chord);
    return energy;
}

/* Takes a step with a light: the other lights push it off, the pieces pull. A light that turns back
   loses its momentum. */
static void envsamp__step_light(envsamp__lights *l, int k, double momentum)
{
    envsamp__mover *m = &l->movers[k];
    double push[5], v[3], along = 0.0;
    float to[3];

    envsamp__sum_field(l, k, l->places, l->made, push);
    for (int c = 0; c < 3; c++)
        v[c] = m->toward[c] + push[3] * (double)m->axis[c] - push[c];
    ENVSAMP_MEMCPY(to, m->axis, sizeof to);
    envsamp__normalise(v, to);
    for (int c = 0; c < 3; c++) {
        v[c] = (double)to[c] - (double)m->next[c];
        along += v[c] * ((double)to[c] - (double)m->axis[c]);
    }
    for (int c = 0; c < 3; c++)
        v[c] = (double)to[c] + (along < 0.0 ? 0.0 : momentum * v[c]);
    ENVSAMP_MEMCPY(m->next, to, sizeof to);
    envsamp__normalise(v, m->axis);
}

/* Some rounds of moves, and weights after each and before; then the lights go to where the energy
   was least, now or before. */
static void envsamp__move_lights(envsamp__lights *l, int rounds)
{
    envsamp__mover *m = l->movers;

    for (int k = 0; k < l->made; k++)
        ENVSAMP_MEMCPY(m[k].next, m[k].axis, sizeof m[k].next);
    for (int i = 0; i <= rounds; i++) {
        double energy = envsamp__weigh_lights(l, 2);
        int better = energy < l->energy - 1e-9;

        for (int k = 0; k < l->made && better; k++) {
            ENVSAMP_MEMCPY(m[k].best, m[k].axis, sizeof m[k].best);
            m[k].best_weight = m[k].weight;
            m[k].tried = 0;
        }
        l->energy = better ? energy : l->energy;
        for (int k = 0; k < l->made; k++)
            envsamp__set_point(l->places, k, m[k].axis, m[k].weight);
        for (int k = 0; k < l->made && i < rounds; k++)
            envsamp__step_light(l, k, (double)i / (double)(i + 3));
    }
    for (int k = 0; k < l->made; k++) {
        ENVSAMP_MEMCPY(m[k].axis, m[k].best, sizeof m[k].best);
        m[k].weight = m[k].best_weight;
    }
}

/* Makes relaxed lights. They start where the others have most to do, one after the other, and move
   to where their energy is least of all that is tried, at first where Lloyd's relaxation leads. */
static void envsamp__relax_lights(envsamp__lights *l, envsamp_light *lights)
{
    envsamp__make_pieces(l);
    int made = envsamp__min(l->desc->count, l->count);
    int most = made < l->count ? ENVSAMP__DISTANCES_MAX / (l->count * made) : 0;
    int rounds = envsamp__min(l->desc->refine_rounds, most), now = ENVSAMP__MOVE_ROUNDS;
    ENVSAMP_MEMSET(l->places, 0, ENVSAMP__POINT_GROUPS(made) * sizeof *l->places);
    envsamp__assign_pieces(l, 0);
    for (int k = 0; k < made; k++) {
        l->made = envsamp__max_int(k, 1);
        l->movers[k].weight = 1.0;
        if (!envsamp__send_light(l, k, 0))      /* there is one piece */
            envsamp__put_light(l, k, 0);
    }
    l->made = made;
    envsamp__relax(l, 1);
    l->energy = DBL_MAX;
    if (most > 0)
        envsamp__move_lights(l, 0);
    if (rounds > 0)
        envsamp__relax(l, ENVSAMP__RELAX_ROUNDS);
    while (rounds > 0) {
        int idle = 0;

        envsamp__move_lights(l, envsamp__min(now, rounds));
        rounds -= now;
        for (int k = 1; k < made; k++)
            idle = l->movers[k].weight < l->movers[idle].weight ? k : idle;
        envsamp__assign_pieces(l, made);
        now = rounds > 0 && envsamp__send_light(l, idle, 1) ? ENVSAMP__TRIAL_ROUNDS : rounds;
    }
    envsamp__sum_pieces(l);
    for (int k = 0; k < made; k++)
        envsamp__set_light(&l->movers[k].sum, l->movers[k].axis, 1, &lights[k]);
    for (int c = 0; c < 3 && most > 0; c++) {
        double integral = l->total.rgb[c];

        envsamp__fill_points(l, c, integral);
        envsamp__weigh_lights(l, envsamp__min(ENVSAMP__WEIGH_SWEEPS,
                                              ENVSAMP__DISTANCES_MAX / (made * made)));
        for (int k = 0; k < made; k++)
            lights[k].irradiance[c] = envsamp__to_float(l->movers[k].weight * integral);
    }
}

/* ---- decomposed ----
 *
 * [18]. Texels brighter than L_T = max(L_b, lambda L_avg, gamma L_max) are emissive. Of K lights
 * their share of L Omega^(1/4), flux and solid angle [19], are EnvDirects: drawn from pieces of the
 * emissive texels by light, each keeping others out of a cone about it, then k-means over the
 * pieces, each put on the nearest texel that it stands for. Texels more than two such angles away
 * go back to the rest of the map. EnvIndirects stand for that: rectangles, that with the largest
 * w_V V + w_D D + w_E E halved first.
 *
 * What the text leaves open was measured in a scene with shadows, each choice against the other
 * (bench/experiments.md): L_b by solid angle, s 4 pi / K as a solid angle, lights on texels, shares
 * by flux, V = standard deviation x solid angle, D = longer side, halves of equal angle.
 */

/* ---- emissive texels ---- */

/* The luminance that `target` of solid angle does not exceed: by bins of the upper half of its
   bits, then of the lower half. */
static float envsamp__percentile(const envsamp__lights *l, double target)
{
    int width = l->image->width;
    double before = 0.0;
    uint32_t found = 0;

    for (int shift = 16; shift >= 0; shift -= 16) {
        const float *row = l->map;
        double sum = before;
        uint32_t last = 0;

        ENVSAMP_MEMSET(l->bins, 0, ENVSAMP__BINS * sizeof *l->bins);
        for (int y = 0; y < l->image->height; y++, row += width)
            for (int x = 0; x < width; x++) {
                uint32_t bits = envsamp__float_bits(row[x]) >> shift;

                if (bits >> 16 == found)
                    l->bins[bits & 0xffffu] += l->row_sr[y];
            }
        for (uint32_t bin = 0; bin < ENVSAMP__BINS && sum < target; bin++)
            if (l->bins[bin] > 0.0) {
                last = bin;
                before = sum;
                sum += l->bins[bin];
            }
        found = found << 16 | last;
    }
    return envsamp__bits_float(found);
}

/* Finds L_T, labels texels that are brighter, and sums light and solid angle of these and of the
   others: the light is 0 only if all of them are black. Returns how many pixels are bad. */
static size_t envsamp__find_emission(envsamp__lights *l)
{
    double total = 0.0, sr = 0.0;
    float *row = l->map, brightest = 0.0f;
    uint8_t *label = l->labels;
    int width = l->image->width;
    size_t bad = 0;

    for (int y = 0; y < l->image->height; y++, row += width) {
        bad += envsamp__read_luminance(envsamp__pixel_at(l->image, 0, y), l->image->channels, width,
                                       row);
        total += envsamp__sum_row(row, width, &brightest) * l->row_sr[y];
        sr += (double)width * l->row_sr[y];
    }
    double limit = envsamp__max((double)l->desc->lambda * total / sr,
                                (double)l->desc->gamma * (double)brightest);
    limit = envsamp__max(limit, (double)envsamp__percentile(l, (double)l->desc->percentile * sr));
    l->info.threshold = envsamp__to_float(limit);
    row = l->map;
    for (int y = 0; y < l->image->height; y++, row += width, label += width) {
        double sum[2] = { 0.0, 0.0 };
        int count[2] = { 0, 0 };

        for (int x = 0; x < width; x++) {
            int bright = row[x] > l->info.threshold;

            label[x] = (uint8_t)bright;
            sum[bright] += (double)row[x];
            count[bright]++;
        }
        for (int k = 0; k < 2; k++) {
            l->light[k] += l->row_sr[y] * sum[k];
            l->sr[k] += l->row_sr[y] * (double)count[k];
        }
    }
    return bad;
}

/* ---- EnvDirects ---- */

/* Puts lights on pieces that are drawn by luminance: none twice, and outside of the cones of all
   before while any is. Returns how many there are. */
static int envsamp__draw_directs(envsamp__lights *l, int wanted)
{
    double scale = (double)l->desc->mask_scale / (double)l->desc->count;
    float masked = (float)envsamp__clamp(4.0 * scale, 0.0, 4.5);    /* squared chord */
    int made = 0;

    envsamp__assign_pieces(l, 0);
    while (made < wanted) {
        double target = 0.0, sum = 0.0;
        int at = -1;

        for (int i = 0; i < l->count; i++)
            target += l->reach[i] > masked ? l->regions[i].sum.luminance : 0.0;
        target *= envsamp__random(l->desc->seed, (uint32_t)made);
        for (int i = 0; i < l->count && sum <= target; i++)
            if (l->reach[i] > masked) {
                sum += l->regions[i].sum.luminance;
                at = i;
            }
        if (at >= 0) {
            l->movers[made].weight = 1.0;
            envsamp__put_light(l, made++, at);
        } else if (masked > 0.0f) {
            masked = 0.0f;
        } else {
            break;
        }
    }
    return made;
}

/* Puts every light on the emissive texel of its pieces that is nearest to it, then gives it those
   that are not far from there. The others go back to the rest of the map. */
static void envsamp__place_directs(envsamp__lights *l)
{
    double scale = (double)l->desc->mask_scale / (double)l->desc->count, farthest = -2.0;
    double cosine = 1.0 - 2.0 * scale, dir[3];

    if (cosine > 0.0 && scale > 0.0 && l->light[ENVSAMP__DIM] > 0.0)
        farthest = envsamp__clamp(2.0 * cosine * cosine - 1.0, -1.0,
                                  1.0 - 1e-6);      /* a texel is not far from itself */
    for (int k = 0; k < l->made; k++) {
        l->movers[k].most = -2.0;
        ENVSAMP_MEMSET(&l->movers[k].sum, 0, sizeof l->movers[k].sum);
    }
    for (int pass = 0; pass < 2; pass++)
        for (int i = 0; i < l->count; i++) {
            const envsamp__region *piece = &l->regions[i];
            envsamp__mover *m = &l->movers[piece->light];
            const float *from = pass ? m->next : m->axis;
            double axis[3] = { (double)from[0], (double)from[1], (double)from[2] };

            for (int y = piece->y0; y < piece->y1; y++)
                for (int x = piece->x0; x < piece->x1; x++) {
                    if (!envsamp__counts(l, x, y))
                        continue;
                    envsamp__map_dir(l, 2 * x + 1, 2 * y + 1, dir);
                    cosine = envsamp__dot(dir, axis, 3);
                    if (pass == 0 && cosine > m->most) {
                        m->most = cosine;
                        envsamp__normalise(dir, m->next);
                    } else if (pass == 1 && cosine < farthest) {
                        l->labels[(size_t)y * (size_t)l->image->width + (size_t)x] = ENVSAMP__DIM;
                    } else if (pass == 1) {
                        envsamp__add_texel(l, x, y, &m->sum);
                    }
                }
        }
}

/* ---- EnvIndirects ---- */

/* Cuts what is not emissive into `count` lights. Terms are divided by the largest of regions that
   can be cut, anew after every cut, after 64 ever more seldom. More lights share the brightest. */
static void envsamp__make_indirects(envsamp__lights *l, int count, envsamp_light *lights)
{
    double weight[3] = { (double)l->desc->weight_variance, (double)l->desc->weight_extent,
                         (double)l->desc->weight_energy };
    int due = 1;

    envsamp__begin_regions(l, l->made > 0 ? ENVSAMP__DIM : ENVSAMP__ANY);
    while (l->count < count && l->heap.entries->key >= 0.0) {
        if (l->count >= due) {
            double most[3] = { 0.0, 0.0, 0.0 }, term[3];

            for (int i = 0; i < l->count; i++) {
                envsamp__region_terms(l, &l->regions[l->heap.entries[i].item], term);
                for (int k = 0; k < 3 && l->heap.entries[i].key >= 0.0; k++)
                    most[k] = envsamp__max(most[k], term[k]);
            }
            for (int k = 0; k < 3; k++)
                l->weight[k] = weight[k] / (most[k] > 0.0 ? most[k] : 1.0);
            envsamp__sort_regions(l);
            due = l->count + 1 + l->count / 64;
        }
        envsamp__cut_top(l);
    }
    envsamp__cut_lights(l, count, lights);
}

/* Makes EnvDirects of emissive texels, as many as is the share of these in luminance x solid
   angle^(1/4), then EnvIndirects. */
static void envsamp__decompose(envsamp__lights *l, envsamp_light *lights)
{
    double share[2];
    int count = l->desc->count, lit = l->light[ENVSAMP__DIM] > 0.0;

    for (int k = 0; k < 2; k++)
        share[k] = l->light[k] * ENVSAMP_SQRT(ENVSAMP_SQRT(l->sr[k]));
    if (lit) {
        l->made = (int)((double)count * share[ENVSAMP__EMISSIVE] / (share[0] + share[1]) + 0.5);
        l->made = envsamp__max_int(l->made, share[ENVSAMP__EMISSIVE] > 0.0);
        l->made = envsamp__min(l->made, count - 1);
    }
    if (l->made > 0) {
        envsamp__begin_regions(l, ENVSAMP__EMISSIVE);
        envsamp__make_pieces(l);
        l->made = envsamp__draw_directs(l, envsamp__min(l->made, l->count));
        envsamp__relax(l, l->desc->refine_rounds);
        envsamp__place_directs(l);
    }
    for (int k = 0; k < l->made; k++) {
        envsamp__set_light(&l->movers[k].sum, l->movers[k].next, 1, &lights[k]);
        lights[k].direct = 1;
    }
    l->info.direct_count = lit ? l->made : count;
    if (!lit)
        return;
    ENVSAMP_MEMSET(&l->total, 0, sizeof l->total);
    for (int k = 0; k < l->made; k++)
        envsamp__add_patch(&l->movers[k].sum, &l->total);
    envsamp__make_indirects(l, count - l->made, lights + l->made);
    l->made = count;
}

/* ---- lights of any method ---- */

/* Lays out what lights need, or a mask. */
static void envsamp__lights_carve(envsamp__lights *l, const envsamp_image *image,
                                  const envsamp_lights_desc *desc, uint8_t *mask,
                                  envsamp__arena *arena)
{
    uint64_t texels = (uint64_t)image->width * (uint64_t)image->height;
    int longer = envsamp__max_int(image->width, image->height), count = desc->count;
    int decomposes = mask || desc->method == ENVSAMP_LIGHTS_DECOMPOSED;
    int chooses = desc->method == ENVSAMP_LIGHTS_HALFTONE || desc->method == ENVSAMP_LIGHTS_RANDOM;
    int relaxes = desc->method == ENVSAMP_LIGHTS_RELAXED;
    int patches = chooses ? 1 : relaxes ? ENVSAMP__PIECE_PATCHES : ENVSAMP__PATCHES_MAX;

    ENVSAMP_MEMSET(l, 0, sizeof *l);
    l->image = image;
    l->desc = desc;
    l->made = count;
    l->row_sr = ENVSAMP__TAKE(double, arena, image->height);
    if (decomposes) {
        l->map = ENVSAMP__TAKE(float, arena, texels);
        l->bins = ENVSAMP__TAKE(double, arena, ENVSAMP__BINS);
        l->labels = mask ? mask : ENVSAMP__TAKE(uint8_t, arena, texels);
    }
    if (mask)
        return;
    if (!chooses && image->mapping != ENVSAMP_OCTAHEDRAL && longer <= 4096) {   /* memory */
        l->azimuth = ENVSAMP__TAKE(double, arena, 4 * image->width + 2);
        l->polar = ENVSAMP__TAKE(double, arena, 4 * image->height + 2);
    }

    /* A patch has as few texels as the largest number of patches each way allows; it is narrower
       where that leaves few. */
    for (l->wide = 1; longer > patches * l->wide; )
        l->wide *= 2;
    for (l->tall = l->wide; l->tall > 1 && image->height <= patches / 4 * l->tall; )
        l->tall /= 2;
    while (l->wide > 1 && image->width <= patches / 4 * l->wide)
        l->wide /= 2;
    l->across = (image->width + l->wide - 1) / l->wide;
    l->down = (image->height + l->tall - 1) / l->tall;
    l->patches = ENVSAMP__TAKE(envsamp__patch, arena, l->across * l->down);
    if (chooses) {
        int random = desc->method == ENVSAMP_LIGHTS_RANDOM;
        envsamp_halftone_desc halftone = { count, random ? ENVSAMP_KERNEL_RANDOM
                                                         : ENVSAMP_KERNEL_SZIRMAY,
                                           desc->seed, ENVSAMP_SCAN_CELLS, 0 };

        envsamp__halftone_carve(&l->halftone, &halftone, image, l->row_sr, arena);
        l->halftone.texels = ENVSAMP__TAKE(envsamp_texel, arena, count);
        return;
    }
    l->line = ENVSAMP__TAKE(envsamp__patch, arena, 2 * ENVSAMP__LINES_MAX);
    int regions = count;
    if (decomposes || relaxes) {
        l->most = envsamp__min(1024 + 2 * ENVSAMP__PIECES_PER_LIGHT * count, ENVSAMP__PIECES_MAX);
        l->movers = ENVSAMP__TAKE(envsamp__mover, arena, count);
        l->points = ENVSAMP__TAKE(envsamp__points, arena, ENVSAMP__POINT_GROUPS(l->most));
        l->places = ENVSAMP__TAKE(envsamp__points, arena,
                                  relaxes ? ENVSAMP__POINT_GROUPS(count) : 0);
        l->reach = ENVSAMP__TAKE(float, arena, l->most);
        regions = envsamp__max_int(l->most, count);
    }
    l->regions = ENVSAMP__TAKE(envsamp__region, arena, regions);
    l->heap.entries = ENVSAMP__TAKE(envsamp__heap_entry, arena, regions);
}

/* Lights of chosen texels: where `same` are one texel, steps of a golden ratio put them in it. */
static void envsamp__texel_lights(const envsamp__lights *l, envsamp_light *lights)
{
    const envsamp_texel *texels = l->halftone.texels;
    int count = l->desc->count;

    for (int i = 0, same; i < count; i += same) {
        envsamp_texel texel = texels[i];
        double rgb[3], sr = l->total.luminance / (double)count
                          / envsamp__texel_value(l->image, texel.x, texel.y, rgb);
        double size = envsamp__min_double(sr, 4.0 * ENVSAMP__PI);

        for (same = 1; i + same < count && texels[i + same].x == texel.x
                       && texels[i + same].y == texel.y; same++)
            continue;
        for (int k = 0; k < same; k++) {
            double down = 0.5 + 0.61803398874989485 * (double)k;
            double across = ((double)k + 0.5) / (double)same;
            envsamp_light *light = &lights[i + k];

            down -= (double)(int)down;
            envsamp_uv_to_dir(l->image->mapping,
                              (float)(((double)texel.x + across) / (double)l->image->width),
                              (float)(((double)texel.y + down) / (double)l->image->height),
                              light->dir);
            for (int c = 0; c < 3; c++)
                light->irradiance[c] = envsamp__to_float(rgb[c] * sr);
            light->solid_angle = (float)size;
            light->cos_extent = (float)(1.0 - size / (2.0 * ENVSAMP__PI));
            light->direct = 0;
        }
    }
}

/* Where fewer were made, duplicates them up to the count and divides their energy. Then tints all
   lights alike, so that they sum to the map's integral in each channel. One that no light has is
   shared out evenly. */
static void envsamp__balance_lights(const envsamp__lights *l, envsamp_light *lights)
{
    int count = l->desc->count;

    for (int k = count; k-- > 0 && l->made < count; ) {
        float copies = (float)((count - 1 - k % l->made) / l->made + 1);

        lights[k] = lights[k % l->made];
        lights[k].solid_angle /= copies;
        for (int c = 0; c < 3; c++)
            lights[k].irradiance[c] /= copies;
    }
    for (int c = 0; c < 3; c++) {
        double sum = 0.0, integral = l->total.rgb[c];

        for (int i = 0; i < count; i++)
            sum += (double)lights[i].irradiance[c];
        double scale = integral / (sum > 0.0 ? sum : (double)count);
        for (int i = 0; i < count; i++)
            lights[i].irradiance[c] = envsamp__to_float(
                scale * (sum > 0.0 ? (double)lights[i].irradiance[c] : 1.0));
    }
}

/* A description with the numbers that its zeros mean. */
static envsamp_lights_desc envsamp__lights_filled(const envsamp_lights_desc *desc)
{
    envsamp_lights_desc filled;

    ENVSAMP_MEMSET(&filled, 0, sizeof filled);
    if (desc)
        filled = *desc;
    filled.count = filled.count ? filled.count : 32;
    filled.percentile = envsamp__or(filled.percentile, 0.98f);
    filled.lambda = envsamp__or(filled.lambda, 3.0f);
    filled.gamma = envsamp__or(filled.gamma, 0.001f);
    filled.mask_scale = envsamp__or(filled.mask_scale, 0.15f);
    filled.refine_rounds = filled.refine_rounds ? filled.refine_rounds : 64;
    if (filled.method == ENVSAMP_LIGHTS_RELAXED && filled.count > ENVSAMP__RELAXED_MAX)
        filled.method = ENVSAMP_LIGHTS_HALFTONE;
    if (envsamp__in_range(filled.weight_variance, 0.0f, 0.0f)
        && envsamp__in_range(filled.weight_extent, 0.0f, 0.0f)
        && envsamp__in_range(filled.weight_energy, 0.0f, 0.0f)) {
        filled.weight_variance = filled.weight_energy = 1.0f;
        filled.weight_extent = 5.0f;
    }
    return filled;
}

ENVSAMP_DEF envsamp_lights_desc envsamp_lights_defaults(void)
{
    return envsamp__lights_filled(NULL);
}

/* Checks a description and asks for its scratch; with a `mask` only percentile, lambda and gamma
   count. */
static envsamp_result envsamp__lights_check(const envsamp_image *image,
                                            const envsamp_lights_desc *desc, uint8_t *mask,
                                            envsamp_sizes *sizes)
{
    envsamp__arena arena = { NULL, 0 };
    envsamp__lights l;
    envsamp_result result = envsamp__begin_sizes(image, sizes);

    if (result != ENVSAMP_OK)
        return result;
    if (!envsamp__in_range(desc->percentile, -FLT_MAX, 1.0f)
        || !envsamp__in_range(desc->lambda, -FLT_MAX, FLT_MAX)
        || !envsamp__in_range(desc->gamma, -FLT_MAX, FLT_MAX)
        || (!mask && (desc->count < 1 || desc->count > 65536
                      || (uint32_t)desc->method > ENVSAMP_LIGHTS_RANDOM
                      || !envsamp__in_range(desc->mask_scale, -FLT_MAX, FLT_MAX)
                      || !envsamp__in_range(desc->weight_variance, 0.0f, FLT_MAX)
                      || !envsamp__in_range(desc->weight_extent, 0.0f, FLT_MAX)
                      || !envsamp__in_range(desc->weight_energy, 0.0f, FLT_MAX))))
        return ENVSAMP_ERR_PARAM;
    envsamp__lights_carve(&l, image, desc, mask, &arena);
    return envsamp__set_sizes(sizes, 0, arena.used);
}

/* Checks all that is given, and reads the map. */
static envsamp_result envsamp__lights_begin(envsamp__lights *l, const envsamp_image *image,
                                            const envsamp_lights_desc *desc, uint8_t *mask,
                                            int capacity, envsamp_buffer scratch)
{
    envsamp__arena arena = { (char *)scratch.data, 0 };
    envsamp_sizes sizes;
    envsamp_result result = envsamp__lights_check(image, desc, mask, &sizes);

    if (result == ENVSAMP_OK)
        result = envsamp__floats_check(image->pixels);
    if (result == ENVSAMP_OK)
        result = !mask && capacity < desc->count ? ENVSAMP_ERR_MEMORY
                                                 : envsamp__buffers_check(&sizes, scratch, scratch);
    if (result != ENVSAMP_OK)
        return result;
    envsamp__lights_carve(l, image, desc, mask, &arena);
    envsamp__fill_angles(l);
    l->info.count = desc->count;
    l->info.bad_pixel_count = l->labels ? envsamp__find_emission(l)
                                        : envsamp__begin_regions(l, ENVSAMP__ANY);
    if (desc->strict && l->info.bad_pixel_count)
        return ENVSAMP_ERR_VALUE;
    return l->total.luminance + l->light[0] + l->light[1] > 0.0 ? ENVSAMP_OK : ENVSAMP_ERR_BLACK;
}

ENVSAMP_DEF envsamp_result envsamp_lights_sizes(const envsamp_image *image,
                                                const envsamp_lights_desc *desc,
                                                envsamp_sizes *sizes)
{
    envsamp_lights_desc filled = envsamp__lights_filled(desc);

    return envsamp__lights_check(image, &filled, NULL, sizes);
}

ENVSAMP_DEF envsamp_result envsamp_lights(const envsamp_image *image,
                                          const envsamp_lights_desc *desc,
                                          envsamp_light *lights, int capacity,
                                          envsamp_buffer scratch, envsamp_lights_info *info)
{
    envsamp_lights_desc filled = envsamp__lights_filled(desc);
    envsamp__lights l;

    if (!lights)
        return ENVSAMP_ERR_NULL;
    envsamp_result result = envsamp__lights_begin(&l, image, &filled, NULL, capacity, scratch);
    if (result != ENVSAMP_OK)
        return result;
    if (l.labels) {
        envsamp__decompose(&l, lights);
    } else if (l.movers) {
        envsamp__relax_lights(&l, lights);
    } else if (l.regions) {
        envsamp__cut_lights(&l, filled.count, lights);
    } else {
        l.halftone.total = l.total.luminance;
        envsamp__halftone_scan(&l.halftone);
        envsamp__texel_lights(&l, lights);
    }
    envsamp__balance_lights(&l, lights);
    ENVSAMP_MEMCPY(l.info.integral, l.total.rgb, sizeof l.info.integral);
    if (info)
        *info = l.info;
    return ENVSAMP_OK;
}

ENVSAMP_DEF envsamp_result envsamp_emissive_mask(const envsamp_image *image,
                                                 const envsamp_lights_desc *desc, uint8_t *mask,
                                                 envsamp_buffer scratch, float *threshold)
{
    envsamp_lights_desc filled = envsamp__lights_filled(desc);
    envsamp__lights l;

    if (!mask)
        return ENVSAMP_ERR_NULL;
    envsamp_result result = envsamp__lights_begin(&l, image, &filled, mask, 0, scratch);
    if (result == ENVSAMP_OK && threshold)
        *threshold = l.info.threshold;
    return result;
}

/* ---- interleaved sets ---- */

ENVSAMP_DEF envsamp_result envsamp_lights_interleave(const envsamp_light *lights, int count,
                                                     int set, int set_count, float extent,
                                                     uint32_t seed, envsamp_light *out)
{
    if (!lights || !out)
        return ENVSAMP_ERR_NULL;
    if (count < 0 || set_count < 1 || set < 0 || set >= set_count
        || !envsamp__in_range(extent, 0.0f, 1.0f))
        return ENVSAMP_ERR_PARAM;
    for (int i = 0; i < count; i++) {
        double x = (double)lights[i].dir[0], y = (double)lights[i].dir[1];
        double z = (double)lights[i].dir[2], sign = z < 0.0 ? -1.0 : 1.0;
        double a = -1.0 / (sign + z), b = x * y * a, sine, cosine, s, c, v[3];
        double turn = envsamp__random(seed, 2 * (uint32_t)i);
        double first = envsamp__random(seed, 2 * (uint32_t)i + 1) * (double)set_count;
        uint32_t rank = ((uint32_t)set + (uint32_t)first) % (uint32_t)set_count;
        float cone = lights[i].cos_extent;

        if (!envsamp__in_range(cone, envsamp__bits_float(0xff800000u), 1.0f))   /* -infinity */
            cone = 1.0f;                        /* a NaN, too: no cone */
        cone = cone > -1.0f ? cone : -1.0f;
        double angle = (double)envsamp__polar_fraction(1.0f - cone, 1.0f + cone) * (double)extent;
        angle *= ENVSAMP_SQRT(((double)rank + 0.5) / (double)set_count);
        envsamp__sincos_pi(angle, &sine, &cosine);
        turn += 0.61803398874989485 * (double)rank;
        envsamp__sincos_pi(2.0 * (turn - (double)(int64_t)turn), &s, &c);
        v[0] = cosine * x + sine * (c * (1.0 + sign * x * x * a) + s * b);
        v[1] = cosine * y + sine * (c * sign * b + s * (sign + y * y * a));
        v[2] = cosine * z - sine * (c * sign * x + s * y);
        out[i] = lights[i];
        envsamp__normalise(v, out[i].dir);
    }
    return ENVSAMP_OK;
}

#endif  /* ENVSAMP_NO_LIGHTS */

#ifndef ENVSAMP_NO_FIT

/* ============================================================================================
 * NONLINEAR LEAST SQUARES                                                        [search: @lm]
 *
 * Minimises |f(x)|^2 over n <= 8 parameters by Levenberg's damped least squares [3]: a step z = D p
 * minimises |J D^-1 z + f|^2 + damping |z|^2, where D holds the largest norm seen of each column of
 * J [5, section 6], and the damping keeps |z| within a trust radius. Householder QR leaves an n by
 * n triangle of J D^-1, and that of the triangle above sqrt(damping) I solves for any damping.
 * ========================================================================================== */

#define ENVSAMP__LM_MAX_PARAMS 8
#define ENVSAMP__LM_LEAST_DAMPING 1e-20

typedef struct envsamp__lm {
    envsamp_lm_fn fn;
    void *user;
    int n, m, iterations, evaluations, converged, stopped;
    int stale;                  /* the Jacobian belongs to an earlier point */
    int fine;                   /* steps of differences are shorter than usual */
    int hidden;                 /* rounding hides the effect of a parameter */
    double ftol, xtol, gtol;
    double *params;             /* the best point so far */
    double *residuals, *trial;  /* unit f at params and at the point being tried */
    double unit, cost;          /* see envsamp__lm_evaluate; |unit f|^2 */
    double cosine;              /* the largest of f and a column of J */
    double delta, damping;      /* trust radius in |D p|; Levenberg's lambda of the step */
    double *column[ENVSAMP__LM_MAX_PARAMS];     /* of J D^-1, then of its triangle: m each */
    double scale[ENVSAMP__LM_MAX_PARAMS];       /* D */
    double slope[ENVSAMP__LM_MAX_PARAMS];       /* the first n of Q^T f */
    double step[ENVSAMP__LM_MAX_PARAMS];        /* z */
} envsamp__lm;

/* The power of two, from 2^-1000 to 2^1000, that brings the largest of the numbers to 1 to 2;
   0 where that is 2^1001 or more. */
static double envsamp__lm_unit(const double *values, int count)
{
    int exponent = envsamp__max_int(envsamp__exponent(values, count), 23);
    uint64_t bits = exponent > 2023 ? 0 : (uint64_t)(2046 - exponent) << 52;
    double unit;

    ENVSAMP_MEMCPY(&unit, &bits, sizeof unit);
    return unit;
}

/* |D x|, against which xtol and the rounding of x count; 0 where that is not finite. */
static double envsamp__lm_scaled_norm(const envsamp__lm *lm)
{
    double norm2 = 0.0;

    for (int j = 0; j < lm->n; j++) {
        double scaled = lm->scale[j] * lm->params[j];

        norm2 += scaled * scaled;
    }
    return envsamp__exponent(&norm2, 1) < 0x7ff ? ENVSAMP_SQRT(norm2) : 0.0;
}

/* The residuals at a point times `unit`, and their cost, or -1 where it is not finite. A unit of 0
   becomes 1, or what they need for squares that neither overflow nor underflow. */
static double envsamp__lm_evaluate(envsamp__lm *lm, const double *point, double *residuals,
                                   double *unit)
{
    if (envsamp__exponent(point, lm->n) == 0x7ff)
        return -1.0;
    lm->evaluations++;
    lm->fn(point, residuals, lm->user);
    double cost = envsamp__dot(residuals, residuals, lm->m);
    int exponent = envsamp__exponent(&cost, 1);
    if (*unit <= 0.0)
        *unit = exponent > 423 && exponent < 1623 ? 1.0 : envsamp__lm_unit(residuals, lm->m);
    for (int i = 0; i < lm->m; i++)
        residuals[i] *= *unit;
    cost = envsamp__dot(residuals, residuals, lm->m);
    return *unit > 0.0 && envsamp__exponent(&cost, 1) < 0x7ff ? cost : -1.0;
}

/* Column j of J D^-1 by a difference over about h, with D raised to its norm where that is above
   `scale`, D before, or lowered to 2^20 times it. By how much the residuals changed, relative to
   the least change that stands out from their rounding. -1 where that is not finite, or far too
   much for a step that is not short beside its parameter. */
static double envsamp__lm_difference(envsamp__lm *lm, int j, double scale, double h)
{
    double point[ENVSAMP__LM_MAX_PARAMS] = { 0.0 }, *column = lm->column[j];

    ENVSAMP_MEMCPY(point, lm->params, (size_t)lm->n * sizeof(double));
    point[j] += h;
    if (envsamp__lm_evaluate(lm, point, column, &lm->unit) < 0.0)
        return -1.0;
    h = point[j] - lm->params[j];  /* what rounding left of it */
    double unit = envsamp__lm_unit(&h, 1);
    h *= unit;
    for (int i = 0; i < lm->m; i++)
        column[i] = (column[i] - lm->residuals[i]) / h;
    double norm = ENVSAMP_SQRT(envsamp__dot(column, column, lm->m));
    scale = envsamp__clamp(scale / unit, norm, norm * 1048576.0);
    lm->scale[j] = scale * unit;
    if (envsamp__exponent(&lm->scale[j], 1) == 0x7ff)
        return -1.0;
    for (int i = 0; i < lm->m && scale > 0.0; i++)
        column[i] /= scale;
    double noise = DBL_EPSILON * (1024.0 * ENVSAMP_SQRT(lm->cost)
                                  + 4.0 * envsamp__lm_scaled_norm(lm));
    double change = norm * ENVSAMP__FABS(h) / noise;
    unit *= 1e-7 * ENVSAMP__FABS(lm->params[j]);
    return change > 4294967296.0 && ENVSAMP__FABS(h) > unit ? -1.0 : change;
}

/* Column j of J D^-1. A step of sqrt(epsilon) of a parameter's size balances truncation against
   rounding; but one near zero must still move the residuals by sqrt(epsilon) of their norm, or
   rounding in them swamps the difference. Steps ahead and back grow until one stands out from
   rounding, and close in on what is not finite or far too much. If none does the parameter
   rests. */
static void envsamp__lm_column(envsamp__lm *lm, int j)
{
    const double root = ENVSAMP_SQRT(DBL_EPSILON), fnorm = ENVSAMP_SQRT(lm->cost);
    const double scale = lm->scale[j], size = ENVSAMP__FABS(lm->params[j]);
    double h = size, low = DBL_MIN * root + DBL_EPSILON * size, wall = 0.0, factor = 65536.0;
    int moved = 0;

    if (scale > 0.0 && h < 1.0)
        h = envsamp__max(h, fnorm < scale ? fnorm / scale : 1.0);
    h *= lm->fine ? root / 8192.0 : root;
    h = h > 0.0 ? envsamp__max(h, DBL_MIN) : root;
    for (int pass = 0; pass < 26 && h > 1.001 * low; pass++) {
        double change = envsamp__lm_difference(lm, j, scale, pass & 1 ? -h : h);

        if (change > 1.0)
            return;
        moved |= change != 0.0;
        wall = change < 0.0 ? h : wall;
        if (!(pass & 1))
            continue;
        low = change < 0.0 ? low : h;
        h = 2.0 * h < root ? root : h < 1e300 / factor ? h * factor : 1e300;
        if (wall > 0.0)
            h = ENVSAMP_SQRT(low) * ENVSAMP_SQRT(wall);
        factor *= pass > 2 && factor < 1e150 ? factor : 1.0;
    }
    ENVSAMP_MEMSET(lm->column[j], 0, (size_t)lm->m * sizeof(double));
    lm->scale[j] = scale;
    lm->hidden |= moved;
}

/* QR in place: the triangle on and above the diagonal, and Q^T rhs. A Householder reflection clears
   v below its first element and becomes I - beta v v^T. */
static void envsamp__lm_triangle(double *const *column, int n, int m, double *rhs)
{
    for (int k = 0; k < n; k++) {
        double *v = column[k] + k, norm2 = envsamp__dot(v, v, m - k);

        if (norm2 < DBL_MIN)    /* its reciprocal would overflow */
            continue;
        double norm = ENVSAMP_SQRT(norm2);
        double head = v[0] > 0.0 ? -norm : norm;
        v[0] -= head;
        for (int j = k + 1; j <= n; j++) {
            double *target = (j < n ? column[j] : rhs) + k;
            double weight = envsamp__dot(v, target, m - k) / (norm * ENVSAMP__FABS(v[0]));

            for (int i = 0; i < m - k; i++)
                target[i] -= weight * v[i];
        }
        v[0] = head;
    }
}

/* All about f at params that a step needs. Stops at a root and where f is at right angles to J. The
   first trust radius is generous beside params, but wide enough to change f by its own size. */
static void envsamp__lm_linearise(envsamp__lm *lm)
{
    double fnorm = ENVSAMP_SQRT(lm->cost);
    int moving = 0;

    lm->stale = lm->hidden = 0;
    lm->cosine = 0.0;
    lm->converged = lm->stopped = fnorm <= DBL_MIN / 1048576.0 * lm->unit;
    for (int j = 0; j < lm->n && !lm->stopped; j++)
        envsamp__lm_column(lm, j);
    if (lm->stopped)
        return;
    ENVSAMP_MEMCPY(lm->trial, lm->residuals, (size_t)lm->m * sizeof(double));
    envsamp__lm_triangle(lm->column, lm->n, lm->m, lm->trial);
    ENVSAMP_MEMCPY(lm->slope, lm->trial, (size_t)lm->n * sizeof(double));
    for (int j = 0; j < lm->n; j++) {
        double norm = ENVSAMP_SQRT(envsamp__dot(lm->column[j], lm->column[j], j + 1));
        double along = ENVSAMP__FABS(envsamp__dot(lm->column[j], lm->slope, j + 1));

        lm->cosine = envsamp__max(lm->cosine, norm > 0.0 ? along / norm / fnorm : 0.0);
        moving |= norm > 0.0;
    }
    lm->stopped = lm->cosine <= lm->gtol;
    lm->converged = lm->stopped && moving && !lm->hidden;
    if (lm->iterations == 0)
        lm->delta = envsamp__max(100.0 * envsamp__lm_scaled_norm(lm), fnorm);
}

/* The step z that minimises |J D^-1 z + f|^2 + damping |z|^2; returns its length. A parameter that
   rests has no part in it. */
static double envsamp__lm_solve(envsamp__lm *lm, double damping)
{
    double memory[ENVSAMP__LM_MAX_PARAMS][2 * ENVSAMP__LM_MAX_PARAMS] = { { 0.0 } };
    double rhs[2 * ENVSAMP__LM_MAX_PARAMS] = { 0.0 }, *column[ENVSAMP__LM_MAX_PARAMS] = { NULL };

    for (int k = 0; k < lm->n; k++) {
        column[k] = memory[k];
        ENVSAMP_MEMCPY(memory[k], lm->column[k], ((size_t)k + 1) * sizeof(double));
        if (envsamp__dot(memory[k], memory[k], k + 1) > 0.0)
            memory[k][lm->n + k] = ENVSAMP_SQRT(damping);
        rhs[k] = -lm->slope[k];
    }
    envsamp__lm_triangle(column, lm->n, 2 * lm->n, rhs);
    for (int k = lm->n - 1; k >= 0; k--) {
        for (int j = k + 1; j < lm->n; j++)
            rhs[k] -= memory[j][k] * lm->step[j];
        lm->step[k] = memory[k][k] != 0.0 ? rhs[k] / memory[k][k] : 0.0;
    }
    lm->damping = damping;
    return ENVSAMP_SQRT(envsamp__dot(lm->step, lm->step, lm->n));
}

/* One trial step: with the least damping or, where that leaves the trust radius, with what a
   bisection of the exponent finds (no column of J D^-1 is longer than 1). It is taken if it brings
   a ten-thousandth of the decrease that J promised. If ever shorter steps bring none, though J
   promises more than rounding and tolerances, J is taken again over shorter differences, and if
   that fails too the search ends. */
static void envsamp__lm_iterate(envsamp__lm *lm)
{
    double point[ENVSAMP__LM_MAX_PARAMS], *spent = lm->residuals, fnorm = ENVSAMP_SQRT(lm->cost);
    double low = ENVSAMP__LM_LEAST_DAMPING, high = lm->n * fnorm / lm->delta;
    double length = envsamp__lm_solve(lm, low), size = envsamp__lm_scaled_norm(lm);
    double unit = 0.0, actual = -99.0;
    int pass = length > 1.1 * lm->delta ? 60 : 0;

    for (; pass && ENVSAMP__FABS(length - lm->delta) > 0.001 * lm->delta; pass--) {
        length = envsamp__lm_solve(lm, ENVSAMP_SQRT(low) * ENVSAMP_SQRT(high));
        *(length > lm->delta ? &low : &high) = lm->damping;
    }
    double predicted = 2.0 * lm->damping * (length / fnorm) * (length / fnorm);
    for (int i = 0; i < lm->n; i++) {
        double sum = 0.0;

        for (int j = i; j < lm->n; j++)
            sum += lm->column[j][i] * lm->step[j];
        predicted += sum * sum / lm->cost;
        point[i] = lm->params[i] + (lm->scale[i] > 0.0 ? lm->step[i] / lm->scale[i] : 0.0);
    }
    lm->iterations++;
    double cost = envsamp__lm_evaluate(lm, point, lm->trial, &unit);
    if (cost >= 0.0)    /* ten times the residuals or more fail like what is not finite */
        actual = envsamp__max(1.0 - cost * (lm->unit / unit) * (lm->unit / unit) / lm->cost, -99.0);
    if (actual <= 0.25 * predicted)
        lm->delta = 0.6 * envsamp__min_double(lm->delta, length);
    else if (actual >= 0.75 * predicted || lm->damping <= ENVSAMP__LM_LEAST_DAMPING)
        lm->delta = 3.0 * length;
    if (actual > 0.0 && actual >= 1e-4 * predicted) {
        lm->residuals = lm->trial;
        lm->trial = spent;
        for (int i = 0; i < lm->n; i++) {
            lm->params[i] = point[i];
            lm->scale[i] *= unit / lm->unit;
        }
        lm->delta *= unit / lm->unit;
        lm->unit = unit;
        lm->cost = cost;
        lm->stale = 1;
    }

    if (!(ENVSAMP__FABS(actual) <= lm->ftol && predicted <= lm->ftol && actual <= 2.0 * predicted)
        && !(lm->delta <= lm->xtol * envsamp__lm_scaled_norm(lm)))
        return;
    if (lm->damping <= ENVSAMP__LM_LEAST_DAMPING
        || lm->cosine <= 1e-6 + lm->xtol + ENVSAMP_SQRT(lm->ftol)
                         + 64.0 * DBL_EPSILON * size / fnorm) {
        lm->stopped = 1;
        lm->converged = !lm->hidden;
    } else if (!lm->stale) {
        lm->stopped = lm->fine;
        lm->stale = lm->fine = 1;
        lm->delta = ENVSAMP_SQRT(lm->cost);
    }
}

ENVSAMP_DEF size_t envsamp_lm_scratch_bytes(const envsamp_lm_desc *desc)
{
    if (!desc || desc->param_count < 1 || desc->param_count > ENVSAMP__LM_MAX_PARAMS
        || desc->residual_count < desc->param_count || desc->max_iterations < 0)
        return 0;
    for (int i = 0; i < 3; i++) {        /* tolerances: 0 or more, or infinite, but no NaN */
        uint64_t bits = envsamp__double_bits(i == 0 ? &desc->ftol : i == 1 ? &desc->xtol
                                                                           : &desc->gtol);

        if (bits > (uint64_t)0x7ff << 52 && bits != (uint64_t)1 << 63)
            return 0;
    }
    size_t row_bytes = ((size_t)desc->param_count + 2) * sizeof(double);
    return (size_t)desc->residual_count > SIZE_MAX / row_bytes
        ? 0 : row_bytes * (size_t)desc->residual_count;
}

ENVSAMP_DEF envsamp_result envsamp_lm(const envsamp_lm_desc *desc, envsamp_lm_fn fn, void *user,
                                      double *params, envsamp_buffer scratch,
                                      envsamp_lm_info *info)
{
    envsamp_sizes sizes = { 0, envsamp_lm_scratch_bytes(desc) };
    envsamp__lm lm;

    if (!desc || !fn || !params || !scratch.data)
        return ENVSAMP_ERR_NULL;
    if (sizes.scratch_bytes == 0)
        return ENVSAMP_ERR_PARAM;
    envsamp_result result = envsamp__buffers_check(&sizes, scratch, scratch);
    if (result != ENVSAMP_OK)
        return result;

    ENVSAMP_MEMSET(&lm, 0, sizeof lm);
    lm.fn = fn;
    lm.user = user;
    lm.n = desc->param_count;
    lm.m = desc->residual_count;
    lm.stale = 1;
    lm.ftol = desc->ftol > 0.0 ? envsamp__max(desc->ftol, DBL_EPSILON) : 1e-12;
    lm.xtol = desc->xtol > 0.0 ? envsamp__max(desc->xtol, DBL_EPSILON) : 1e-12;
    lm.gtol = desc->gtol > 0.0 ? envsamp__max(desc->gtol, DBL_EPSILON) : 1e-12;
    lm.params = params;
    for (int i = 0; i < lm.n; i++)
        lm.column[i] = (double *)scratch.data + (size_t)i * (size_t)lm.m;
    lm.residuals = lm.column[lm.n - 1] + lm.m;
    lm.trial = lm.residuals + lm.m;
    lm.cost = envsamp__lm_evaluate(&lm, params, lm.residuals, &lm.unit);
    if (lm.cost < 0.0)
        return ENVSAMP_ERR_VALUE;
    int limit = desc->max_iterations ? desc->max_iterations : 200;
    while (!lm.stopped && lm.iterations < limit) {
        if (lm.stale)
            envsamp__lm_linearise(&lm);
        if (!lm.stopped)
            envsamp__lm_iterate(&lm);
    }
    if (info) {
        info->iterations = lm.iterations;
        info->evaluations = lm.evaluations;
        info->converged = lm.converged;
        info->cost = lm.cost / lm.unit / lm.unit;
    }
    return ENVSAMP_OK;
}

#endif  /* ENVSAMP_NO_FIT */

#ifdef __cplusplus
}
#endif

#endif /* ENVSAMP_IMPLEMENTATION */

/* CHANGES
 * 0.2  Zero is the default in every description: `bilinear` became `nearest`, `repeat` became
 *      `once`, EXCESS and RELAXED are the first of their enums. Light x cosine (`facing`),
 *      excess_target, importance_exponent, _build_rows, _rebuild_begin, ENVSAMP_ALLOC and _NO_FIT,
 *      _NO_CDF, _NO_LIGHTS. Tables of 0.1 do not open.
 * 0.1  kd, cdf, halftone, lights, lm.
 */

/*
This software is available under two licences: choose the one you prefer.

------------------------------------------------------------------------------
ALTERNATIVE A - MIT License

Copyright (c) 2026 the envsamp.h authors

Permission is hereby granted, free of charge, to any person obtaining a copy of
this software and associated documentation files (the "Software"), to deal in
the Software without restriction, including without limitation the rights to
use, copy, modify, merge, publish, distribute, sublicense, and/or sell copies of
the Software, and to permit persons to whom the Software is furnished to do so,
subject to the following conditions:

The above copyright notice and this permission notice shall be included in all
copies or substantial portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR
IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS
FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR
COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER
IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM, OUT OF OR IN
CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.

------------------------------------------------------------------------------
ALTERNATIVE B - Public Domain

Anyone is free to copy, modify, publish, use, compile, sell, or distribute this
software, in source or binary form, for any purpose, commercial or
non-commercial, and by any means. The authors dedicate all copyright interest in
it to the public domain, for the benefit of the public at large and to the
detriment of their heirs and successors, as a permanent relinquishment of all
present and future rights under copyright law. No warranty of any kind is given.
*/
