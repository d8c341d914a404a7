/* builds_version.c: one version of the library for builds.c. VERSION names it; HEADER, where it is
 * defined, is its file.
 */
#ifndef HEADER
#define HEADER "../envsamp.h"
#endif
#define ENVSAMP_STATIC
#define ENVSAMP_IMPLEMENTATION
#include HEADER

#include "builds.h"

static envsamp_image view(const build *b)
{
    const envsamp_image image = { b->rgb, b->width, b->height, 3, 0, ENVSAMP_LATLONG };

    return image;
}

static envsamp_kd_desc kd_desc(const build *b)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();

    desc.block_count = b->block_count;
    desc.select = b->kind == BUILD_ALIAS ? ENVSAMP_KD_ALIAS : ENVSAMP_KD_WARP;
    return desc;
}

static int sizes(build *b)
{
    const envsamp_image image = view(b);
    const envsamp_kd_desc desc = kd_desc(b);
    envsamp_sizes bytes;
    envsamp_result result = b->kind == BUILD_CDF ? envsamp_cdf_sizes(&image, NULL, &bytes)
                                                 : envsamp_kd_sizes(&image, &desc, &bytes);

    b->table_bytes = bytes.table_bytes;
    b->scratch_bytes = bytes.scratch_bytes;
    return result == ENVSAMP_OK;
}

static int run(build *b)
{
    const envsamp_image image = view(b);
    const envsamp_kd_desc desc = kd_desc(b);
    envsamp_buffer table, scratch;
    envsamp_cdf_info cdf_info;
    envsamp_kd_info kd_info;
    const envsamp_cdf *cdf;
    const envsamp_kd *kd;

    table.data = b->table;
    table.bytes = b->table_bytes;
    scratch.data = b->scratch;
    scratch.bytes = b->scratch_bytes;
    if (b->kind == BUILD_CDF) {
        if (envsamp_cdf_build(&image, NULL, table, scratch, &cdf) != ENVSAMP_OK)
            return 0;
        envsamp_cdf_get_info(cdf, &cdf_info);
        b->excess = cdf_info.excess_variance;
        return 1;
    }
    if (envsamp_kd_build(&image, &desc, table, scratch, &kd) != ENVSAMP_OK)
        return 0;
    envsamp_kd_get_info(kd, &kd_info);
    b->excess = kd_info.excess_variance;
    return 1;
}

extern const builds_version VERSION;
const builds_version VERSION = { sizes, run };
