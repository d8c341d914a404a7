/* gpu.cu: samples a second on a GPU: envsamp.h as device code beside inversion by binary search
 * and an alias table over texels, as [Ergun et al. 2012] compare them.
 *
 *     gpu_bench                made-up sky, 2048x1024 and 8192x4096
 *     gpu_bench city.hdr       a map of yours, as large as it is
 *
 * All contenders draw direction and density from the same numbers. Coherent: the 32 threads of a
 * warp draw neighbouring points of the unit square, as pixels of one tile do in a renderer with
 * stratified numbers. Incoherent: hashed, anywhere. Contenders take turns; the median of the rounds
 * is reported. Before that, at 512x256: the inversion and the alias table of this file draw on the
 * CPU what baselines.c does, and all contenders draw on the GPU what they do on the CPU, but
 * for rounding. Without a GPU the first is all, and times are "not measured".
 *
 * Compile by nvcc; link image.c, hdr.c, maps.c and bench/baselines.c: "make gpu-bench".
 */
#define ENVSAMP_STATIC
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

extern "C" {
#include "../examples/common/image.h"
#include "../examples/common/maps.h"
#include "baselines.h"
}

#include <algorithm>
#include <cuda_runtime.h>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

#define ROUNDS 7
#define THREADS 256
#define SAMPLES (1u << 26)          /* a launch */
#define CHECKED 200000u             /* points of the check */
#define ERROR_SIZE 512
#define DEVICE __host__ __device__

/* ---- numbers ---- */

DEVICE static uint32_t hash(uint32_t x)
{
    x = (x ^ x >> 16) * 0x7feb352du;
    x = (x ^ x >> 15) * 0x846ca68bu;
    return x ^ x >> 16;
}

DEVICE static float unit(uint32_t bits)
{
    return (float)(bits >> 8) * (1.0f / 16777216.0f);
}

/* Coherent: point i of a square of 8192 by 8192, by tiles of 8 by 4 points, jittered. */
DEVICE static void make_numbers(uint32_t i, int coherent, float u[2])
{
    const uint32_t tile = i >> 5, x = (tile & 1023) * 8 + (i & 7);
    const uint32_t y = (tile >> 10) * 4 + (i >> 3 & 3);

    u[0] = unit(hash(2 * i));
    u[1] = unit(hash(2 * i + 1));
    if (coherent) {
        u[0] = ((float)(x & 8191) + u[0]) * (1.0f / 8192.0f);
        u[1] = ((float)(y & 8191) + u[1]) * (1.0f / 8192.0f);
    }
}

/* ---- contenders: each draws by operator() (u0, u1, point) ---- */

struct nothing {
    DEVICE envsamp_sample operator()(float u0, float u1, uint32_t) const
    {
        envsamp_sample s = { { u0, u1, 0.0f }, 1.0f, { u0, u1 } };

        return s;
    }
};

struct kd_sampler {
    const envsamp_kd *kd;

    DEVICE envsamp_sample operator()(float u0, float u1, uint32_t) const
    {
        return envsamp_kd_sample(kd, u0, u1);
    }
};

/* One normal a warp, or one a point. */
struct facing_sampler {
    const envsamp_kd *kd;
    int coherent;

    DEVICE envsamp_sample operator()(float u0, float u1, uint32_t i) const
    {
        const uint32_t seed = coherent ? i >> 5 : i;
        const float normal[3] = { unit(hash(3 * seed)) - 0.5f, unit(hash(3 * seed + 1)) - 0.5f,
                                  unit(hash(3 * seed + 2)) - 0.5f };

        return envsamp_kd_sample_facing(kd, normal, u0, u1);
    }
};

struct cdf_sampler {
    const envsamp_cdf *cdf;

    DEVICE envsamp_sample operator()(float u0, float u1, uint32_t) const
    {
        return envsamp_cdf_sample(cdf, u0, u1);
    }
};

DEVICE static envsamp_sample texel_sample(float u, float v, float density)
{
    const float pi = 3.14159265358979f;
    const float sine = sinf(pi * v);
    envsamp_sample s;

    s.dir[0] = cosf(2.0f * pi * u) * sine;
    s.dir[1] = sinf(2.0f * pi * u) * sine;
    s.dir[2] = cosf(pi * v);
    s.pdf = sine > 0.0f ? density / (2.0f * pi * pi * sine) : 0.0f;
    s.uv[0] = u;
    s.uv[1] = v;
    return s;
}

/* The interval that u is in, of `count`, and how far. */
DEVICE static int invert(const float *cdf, int count, float u, float *fraction)
{
    int low = 0, high = count;

    while (high - low > 1) {
        const int middle = (low + high) / 2;

        if (cdf[middle] <= u)
            low = middle;
        else
            high = middle;
    }
    *fraction = (u - cdf[low]) / (cdf[low + 1] - cdf[low]);
    return low;
}

struct inversion {
    baseline_cdf cdf;

    DEVICE envsamp_sample operator()(float u0, float u1, uint32_t) const
    {
        const size_t width = (size_t)cdf.width;
        float down, across;
        const int y = invert(cdf.marginal, cdf.height, u1, &down);
        const int x = invert(cdf.conditional + (size_t)y * (width + 1), cdf.width, u0, &across);

        return texel_sample(fminf(((float)x + across) / (float)cdf.width, 0.99999994f),
                            fminf(((float)y + down) / (float)cdf.height, 0.99999994f),
                            cdf.density[(size_t)y * width + (size_t)x]);
    }
};

struct texel_alias {
    baseline_texel_alias table;

    DEVICE envsamp_sample operator()(float u0, float u1, uint32_t) const
    {
        const uint32_t width = (uint32_t)table.width, count = width * (uint32_t)table.height;
        const float scaled = u0 * (float)count;
        const uint32_t bin = scaled < (float)count ? (uint32_t)scaled : count - 1;
        const baseline_alias_entry entry = table.entries[bin];
        const float rest = scaled - (float)bin;
        const int own = rest < entry.threshold;
        const uint32_t texel = own ? bin : entry.alias, y = texel / width;
        const float f = own ? rest / entry.threshold
                            : (rest - entry.threshold) / (1.0f - entry.threshold);

        return texel_sample(fminf(((float)(texel - y * width) + f) / (float)width, 0.99999994f),
                            fminf(((float)y + u1) / (float)table.height, 0.99999994f),
                            table.density[texel]);
    }
};

/* ---- the GPU ---- */

template <class sampler>
__global__ void time_samples(sampler draw, int coherent, float *sums)
{
    float sum = 0.0f, u[2];

    for (uint32_t i = blockIdx.x * blockDim.x + threadIdx.x; i < SAMPLES;
         i += gridDim.x * blockDim.x) {
        make_numbers(i, coherent, u);
        const envsamp_sample s = draw(u[0], u[1], i);

        sum += s.dir[0] + s.dir[1] + s.dir[2] + s.pdf;
    }
    sums[blockIdx.x * blockDim.x + threadIdx.x] = sum;
}

template <class sampler>
__global__ void write_samples(sampler draw, uint32_t count, envsamp_sample *samples)
{
    const uint32_t i = blockIdx.x * blockDim.x + threadIdx.x;
    float u[2];

    if (i < count) {
        make_numbers(i, 0, u);
        samples[i] = draw(u[0], u[1], i);
    }
}

static int has_gpu()
{
    int count = 0;

    return cudaGetDeviceCount(&count) == cudaSuccess && count > 0;
}

static void require(cudaError_t error)
{
    if (error != cudaSuccess) {
        fprintf(stderr, "gpu_bench: %s\n", cudaGetErrorString(error));
        exit(1);
    }
}

static std::vector<void *> uploads;

template <class type> static type *upload(const type *from, size_t bytes)
{
    void *to = NULL;

    require(cudaMalloc(&to, bytes));
    uploads.push_back(to);
    require(cudaMemcpy(to, from, bytes, cudaMemcpyHostToDevice));
    return (type *)to;
}

/* ---- tables ---- */

struct tables {
    image map;
    std::vector<std::vector<double> > memory;       /* aligned for tables */
    const envsamp_kd *warp, *alias, *fit;
    const envsamp_cdf *cdf;
    baseline_cdf inversion;
    baseline_texel_alias texels;
};

static envsamp_buffer take(tables *t, size_t bytes)
{
    t->memory.push_back(std::vector<double>(bytes / 8 + 1));
    const envsamp_buffer buffer = { t->memory.back().data(), 8 * t->memory.back().size() };

    return buffer;
}

static const envsamp_kd *make_kd(tables *t, const envsamp_image *view, envsamp_kd_select select)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    const envsamp_kd *kd = NULL;
    envsamp_sizes sizes;

    desc.select = select;
    desc.facing = select == ENVSAMP_KD_WARP;
    if (envsamp_kd_sizes(view, &desc, &sizes) != ENVSAMP_OK)
        return NULL;
    const envsamp_buffer table = take(t, sizes.table_bytes);
    std::vector<double> scratch(sizes.scratch_bytes / 8 + 1);
    const envsamp_buffer room = { scratch.data(), 8 * scratch.size() };

    envsamp_kd_build(view, &desc, table, room, &kd);
    return kd;
}

static int make_tables(const char *name, int width, int height, tables *t)
{
    char error[ERROR_SIZE] = "";
    envsamp_sizes sizes;

    if (!map_make(name, width, height, &t->map)
        && !image_read(name, &t->map, error, sizeof error)) {
        fprintf(stderr, "%s\n", error);
        return 0;
    }
    const envsamp_image view = { t->map.rgb, t->map.width, t->map.height, 3, 0, ENVSAMP_LATLONG };

    t->warp = make_kd(t, &view, ENVSAMP_KD_WARP);
    t->alias = make_kd(t, &view, ENVSAMP_KD_ALIAS);
    t->fit = make_kd(t, &view, ENVSAMP_KD_FIT);
    t->cdf = NULL;
    if (envsamp_cdf_sizes(&view, NULL, &sizes) == ENVSAMP_OK) {
        const envsamp_buffer table = take(t, sizes.table_bytes);
        std::vector<double> scratch(sizes.scratch_bytes / 8 + 1);
        const envsamp_buffer room = { scratch.data(), 8 * scratch.size() };

        envsamp_cdf_build(&view, NULL, table, room, &t->cdf);
    }
    if (t->warp && t->alias && t->fit && t->cdf
        && baseline_cdf_create(t->map.rgb, t->map.width, t->map.height, &t->inversion)
        && baseline_texel_alias_create(t->map.rgb, t->map.width, t->map.height, &t->texels))
        return 1;
    fprintf(stderr, "%s: no light, or not enough memory\n", name);
    return 0;
}

static void free_tables(tables *t)
{
    baseline_cdf_destroy(&t->inversion);
    baseline_texel_alias_destroy(&t->texels);
    image_free(&t->map);
    t->memory.clear();
    for (size_t i = 0; i < uploads.size(); i++)
        cudaFree(uploads[i]);
    uploads.clear();
}

/* ---- the check ---- */

/* How many points differ by more than 1e-5 of the unit sphere, or 1e-4 of the density. */
static long count_different(const std::vector<envsamp_sample> &a,
                            const std::vector<envsamp_sample> &b)
{
    long differ = 0;

    for (size_t i = 0; i < a.size(); i++) {
        int same = fabsf(a[i].pdf - b[i].pdf) <= 1e-4f * fmaxf(a[i].pdf, b[i].pdf);

        for (int k = 0; k < 3; k++)
            same &= fabsf(a[i].dir[k] - b[i].dir[k]) <= 1e-5f;
        differ += !same;
    }
    return differ;
}

template <class sampler> static std::vector<envsamp_sample> draw_here(const sampler &draw)
{
    std::vector<envsamp_sample> samples(CHECKED);
    float u[2];

    for (uint32_t i = 0; i < CHECKED; i++) {
        make_numbers(i, 0, u);
        samples[i] = draw(u[0], u[1], i);
    }
    return samples;
}

template <class sampler> static std::vector<envsamp_sample> draw_there(const sampler &draw)
{
    std::vector<envsamp_sample> samples(CHECKED);
    envsamp_sample *out = upload(samples.data(), CHECKED * sizeof samples[0]);

    write_samples<<<(CHECKED + THREADS - 1) / THREADS, THREADS>>>(draw, CHECKED, out);
    require(cudaGetLastError());
    require(cudaMemcpy(samples.data(), out, CHECKED * sizeof samples[0], cudaMemcpyDeviceToHost));
    return samples;
}

static envsamp_sample as_sample(const baseline_sample &b)
{
    return { { b.dir[0], b.dir[1], b.dir[2] }, b.pdf, { b.uv[0], b.uv[1] } };
}

struct baseline_inversion {
    const baseline_cdf *cdf;

    envsamp_sample operator()(float u0, float u1, uint32_t) const
    {
        return as_sample(baseline_cdf_sample(cdf, u0, u1));
    }
};

struct baseline_alias {
    const baseline_texel_alias *table;

    envsamp_sample operator()(float u0, float u1, uint32_t) const
    {
        return as_sample(baseline_texel_alias_sample(table, u0, u1));
    }
};

/* ---- contenders with their tables on either side ---- */

struct contenders {
    kd_sampler warp, alias, fit;
    facing_sampler facing;
    cdf_sampler cdf;
    inversion inverse;
    texel_alias texels;
};

static contenders here(const tables *t)
{
    const contenders c = { { t->warp }, { t->alias }, { t->fit }, { t->warp, 0 }, { t->cdf },
                           { t->inversion }, { t->texels } };

    return c;
}

static contenders there(const tables *t)
{
    const size_t width = (size_t)t->map.width, height = (size_t)t->map.height;
    contenders c = here(t);

    c.warp.kd = c.facing.kd = (const envsamp_kd *)upload((const char *)t->warp,
                                                         envsamp_kd_bytes(t->warp));
    c.alias.kd = (const envsamp_kd *)upload((const char *)t->alias, envsamp_kd_bytes(t->alias));
    c.fit.kd = (const envsamp_kd *)upload((const char *)t->fit, envsamp_kd_bytes(t->fit));
    c.cdf.cdf = (const envsamp_cdf *)upload((const char *)t->cdf, envsamp_cdf_bytes(t->cdf));
    c.inverse.cdf.marginal = upload(t->inversion.marginal, (height + 1) * sizeof(float));
    c.inverse.cdf.conditional = upload(t->inversion.conditional,
                                       height * (width + 1) * sizeof(float));
    c.inverse.cdf.density = upload(t->inversion.density, height * width * sizeof(float));
    c.texels.table.entries = upload(t->texels.entries,
                                    height * width * sizeof *t->texels.entries);
    c.texels.table.density = upload(t->texels.density, height * width * sizeof(float));
    return c;
}

/* Differences between this text on the CPU, the baselines and the GPU. 0: fewer than 1 in 1000
   differ, of points at the edge of a texel or a block. */
static int check(const char *name, int width, int height)
{
    const long most = CHECKED / 1000;
    tables t;
    long differ[7];
    int failed = 0;

    if (!make_tables(name, width, height, &t))
        return 1;
    const contenders c = here(&t);
    const baseline_inversion inverse = { &t.inversion };
    const baseline_alias texels = { &t.texels };

    differ[0] = count_different(draw_here(c.inverse), draw_here(inverse));
    differ[1] = count_different(draw_here(c.texels), draw_here(texels));
    printf("%u points on the CPU: inversion %ld, texel alias %ld differ from bench/baselines.c\n",
           CHECKED, differ[0], differ[1]);
    failed |= differ[0] > most || differ[1] > most;
    differ[0] = count_different(draw_here(c.warp), draw_here(c.alias));
    printf("control: WARP and ALIAS, %ld differ\n", differ[0]);
    failed |= differ[0] < (long)CHECKED / 2;
    if (has_gpu()) {
        const contenders g = there(&t);

        differ[0] = count_different(draw_here(c.warp), draw_there(g.warp));
        differ[1] = count_different(draw_here(c.alias), draw_there(g.alias));
        differ[2] = count_different(draw_here(c.fit), draw_there(g.fit));
        differ[3] = count_different(draw_here(c.facing), draw_there(g.facing));
        differ[4] = count_different(draw_here(c.cdf), draw_there(g.cdf));
        differ[5] = count_different(draw_here(c.inverse), draw_there(g.inverse));
        differ[6] = count_different(draw_here(c.texels), draw_there(g.texels));
        printf("on the GPU differ: WARP %ld, ALIAS %ld, FIT %ld, facing %ld, cdf %ld, inversion "
               "%ld, texel alias %ld\n", differ[0], differ[1], differ[2], differ[3], differ[4],
               differ[5], differ[6]);
        for (int i = 0; i < 7; i++)
            failed |= differ[i] > most;
    } else {
        printf("on the GPU: not measured, no CUDA device\n");
    }
    free_tables(&t);
    return failed;
}

/* ---- times ---- */

/* 10^9 samples a second of one launch. */
template <class sampler> static double time_once(const sampler &draw, int coherent, float *sums,
                                                 int blocks)
{
    cudaEvent_t start, end;
    float ms = 0.0f;

    require(cudaEventCreate(&start));
    require(cudaEventCreate(&end));
    require(cudaEventRecord(start));
    time_samples<<<blocks, THREADS>>>(draw, coherent, sums);
    require(cudaGetLastError());
    require(cudaEventRecord(end));
    require(cudaEventSynchronize(end));
    require(cudaEventElapsedTime(&ms, start, end));
    cudaEventDestroy(start);
    cudaEventDestroy(end);
    return SAMPLES / (1e6 * (double)ms);
}

#define CONTENDERS 8
static const char *const names[CONTENDERS] = {
    "numbers alone", "WARP", "ALIAS", "FIT", "WARP, light x cosine", "envsamp_cdf",
    "inversion, binary search", "texel alias table"
};

static void time_round(const contenders &c, int coherent, float *sums, int blocks,
                       std::vector<double> rates[CONTENDERS])
{
    const nothing numbers = {};
    facing_sampler facing = c.facing;

    facing.coherent = coherent;
    rates[0].push_back(time_once(numbers, coherent, sums, blocks));
    rates[1].push_back(time_once(c.warp, coherent, sums, blocks));
    rates[2].push_back(time_once(c.alias, coherent, sums, blocks));
    rates[3].push_back(time_once(c.fit, coherent, sums, blocks));
    rates[4].push_back(time_once(facing, coherent, sums, blocks));
    rates[5].push_back(time_once(c.cdf, coherent, sums, blocks));
    rates[6].push_back(time_once(c.inverse, coherent, sums, blocks));
    rates[7].push_back(time_once(c.texels, coherent, sums, blocks));
}

static double median(std::vector<double> values)
{
    std::sort(values.begin(), values.end());
    return values.empty() ? 0.0 : values[values.size() / 2];
}

static int measure(const char *name, int width, int height)
{
    std::vector<double> rates[2][CONTENDERS];
    cudaDeviceProp device;
    tables t;

    if (!make_tables(name, width, height, &t))
        return 1;
    require(cudaGetDeviceProperties(&device, 0));
    const int blocks = 16 * device.multiProcessorCount;
    const contenders c = there(&t);
    float *sums = NULL;

    require(cudaMalloc((void **)&sums, (size_t)blocks * THREADS * sizeof *sums));
    for (int round = -1; round < ROUNDS; round++)       /* the first only warms up */
        for (int coherent = 0; coherent < 2; coherent++) {
            std::vector<double> unused[CONTENDERS];

            time_round(c, coherent, sums, blocks, round < 0 ? unused : rates[coherent]);
        }
    cudaFree(sums);
    printf("\n%s, %d x %d, %s, %u samples a launch, median of %d\n", name, t.map.width,
           t.map.height, device.name, SAMPLES, ROUNDS);
    printf("%-26s %12s %12s   10^9 samples a second\n", "", "coherent", "incoherent");
    for (int i = 0; i < CONTENDERS; i++)
        printf("%-26s %12.2f %12.2f\n", names[i], median(rates[1][i]), median(rates[0][i]));
    free_tables(&t);
    return 0;
}

int main(int argc, char **argv)
{
    const char *name = argc > 1 ? argv[1] : "sky";
    int failed = check("sky", 512, 256);

    if (failed)
        fprintf(stderr, "gpu_bench: what is compiled here does not draw what the library does\n");
    else if (!has_gpu())
        printf("samples a second: not measured, no CUDA device\n");
    else if (argc > 1)
        failed = measure(name, 2048, 1024);
    else
        failed = measure(name, 2048, 1024) || measure(name, 8192, 4096);
    return failed;
}
