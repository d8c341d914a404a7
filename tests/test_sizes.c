/* test_sizes.c: sizes of buffers for the largest maps, and counts that no memory holds. Where size_t
 * has 32 bits a size is right or it is ENVSAMP_ERR_SIZE, never the low half of the right one.
 * With an argument it prints the sizes instead: test_sizes.sh compares those of two machines.
 */
#include <setjmp.h>
#include <stdlib.h>
#include <string.h>

static jmp_buf asserted;
#define ENVSAMP_ASSERT(x) ((x) ? (void)0 : longjmp(asserted, 1))
#define ENVSAMP_STATIC          /* with asserts of its own */
#define ENVSAMP_IMPLEMENTATION
#include "envsamp.h"
#include "check.h"

#define SIDES 9
#define BITS_32 4294967296.0

static const int sides[SIDES][2] = {
    { 65535, 65535 }, { 65535, 1 }, { 1, 65535 }, { 32768, 32766 }, { 32768, 32768 },
    { 30000, 30000 }, { 23170, 23170 }, { 16384, 8192 }, { 1, 1 }
};
static int printing;
static int asked, good;         /* sizes, and how many of them are right or refused */

/* What one _sizes says: `least` and `most` are bounds of the bytes of the larger of its buffers. */
static void judge(const char *family, int kind, const envsamp_image *image, envsamp_result result,
                  envsamp_sizes sizes, double least, double most)
{
    double bytes = (double)(sizes.table_bytes > sizes.scratch_bytes ? sizes.table_bytes
                                                                    : sizes.scratch_bytes);
    double pixels = strcmp(family, "halftone")      /* which is not asked about its map's bytes */
                  ? 4.0 * image->width * image->height * image->channels : 0.0;
    int right = result == ENVSAMP_OK ? bytes >= least && bytes <= most
              : result == ENVSAMP_ERR_SIZE && sizeof(size_t) == 4 && bytes == 0.0
                && (pixels >= BITS_32 || most > BITS_32 / 2);

    asked++;
    good += right;
    if (printing)
        printf("%s-%d-%dx%dx%d-%d %d %.0f %.0f %.0f\n", family, kind, image->width, image->height,
               image->channels, (int)image->mapping, (int)result, (double)sizes.table_bytes,
               (double)sizes.scratch_bytes, pixels);
    else if (!right)
        printf("# %s %d, %d x %d x %d: %s, %.0f bytes, not %.0f to %.0f\n", family, kind,
               image->width, image->height, image->channels, envsamp_result_string(result), bytes,
               least, most);
}

static void ask_kd(const envsamp_image *image, double texels)
{
    envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_sizes sizes = { 1, 1 };
    double rows = (double)image->height + 2, side = (double)image->width + rows;
    envsamp_result result;
    int i;

    for (i = 0; i < 6; i++) {
        desc.select = (envsamp_kd_select)(i % 3);
        desc.block_count = i < 3 ? 6144 : 1048576;
        result = envsamp_kd_sizes(image, &desc, &sizes);
        judge("kd", i, image, result, sizes, 4 * texels,
              5.1 * texels + 240.0 * desc.block_count + 140 * rows + 64 * side + 300000);
    }
}

/* Scratch of kd is what the header says: 5 bytes a texel, 168 a block, ALIAS 12, FIT 48 and
   `facing` 112 more, 30 a column, 100 a row, and 14 KB. The control takes the columns away. */
static void test_kd_scratch(void)
{
    static const int shapes[6][2] = { { 65535, 4 }, { 65535, 1 }, { 4, 65535 }, { 2048, 1024 },
                                      { 512, 256 }, { 3, 3 } };
    static const double more[3] = { 0.0, 12.0, 48.0 };
    int i, count = 0, right = 0, narrow = 0;

    for (i = 0; i < 6 * 16; i++) {
        envsamp_image image = { NULL, shapes[i % 6][0], shapes[i % 6][1], 4, 0, ENVSAMP_LATLONG };
        envsamp_kd_desc desc = envsamp_kd_defaults();
        envsamp_sizes sizes = { 0, 0 };
        double cells, said;

        desc.select = (envsamp_kd_select)(i / 6 % 4 % 3);
        desc.facing = i / 6 % 4 == 3;
        desc.nearest = i / 24 % 2;
        image.mapping = i / 48 ? ENVSAMP_OCTAHEDRAL : ENVSAMP_LATLONG;
        cells = ((double)image.width + 1.0) * ((double)image.height + 1.0);
        said = 5.0 * (double)image.width * (double)image.height + 30.0 * (double)image.width
             + 100.0 * (double)image.height + 14.0 * 1024.0
             + (168.0 + more[desc.select] + (desc.facing ? 112.0 : 0.0))
               * (cells < 6144.0 ? cells : 6144.0);
        count += envsamp_kd_sizes(&image, &desc, &sizes) == ENVSAMP_OK;
        right += (double)sizes.scratch_bytes <= said;
        narrow += (double)sizes.scratch_bytes <= said - 30.0 * (double)image.width;
    }
    CHECK(count == 96 && right == 96, "%d of %d scratch sizes of kd are as said", right, count);
    CHECK(narrow < 96, "control: without what columns take %d are", narrow);
}

static void ask_cdf(const envsamp_image *image, double texels)
{
    envsamp_sizes sizes = { 1, 1 };
    double side = (double)image->width + (double)image->height;
    envsamp_result result = envsamp_cdf_sizes(image, NULL, &sizes);

    judge("cdf", 0, image, result, sizes, 4 * texels, 5.1 * texels + 100 * side + 10000);
}

static void ask_lights(const envsamp_image *image, double texels)
{
    envsamp_lights_desc desc = envsamp_lights_defaults();
    envsamp_sizes sizes = { 1, 1 };
    double side = (double)image->width + (double)image->height;
    envsamp_result result;
    int i;

    for (i = 0; i < 12; i++) {
        desc.method = (envsamp_lights_method)(i % 6);
        desc.count = i < 6 ? 32 : 65536;
        result = envsamp_lights_sizes(image, &desc, &sizes);
        judge("lights", i, image, result, sizes,
              desc.method == ENVSAMP_LIGHTS_DECOMPOSED ? 5 * texels : 1,
              (desc.method == ENVSAMP_LIGHTS_DECOMPOSED ? 5 * texels : 0) + 60 * side + 15e6
              + 300.0 * desc.count);
    }
}

static void ask_halftone(const envsamp_image *image, double texels)
{
    envsamp_halftone_desc desc;
    envsamp_sizes sizes = { 1, 1 };
    envsamp_result result;
    int i;

    (void)texels;
    memset(&desc, 0, sizeof desc);
    for (i = 0; i < 12; i++) {
        desc.kernel = (envsamp_kernel)(i % 6);
        desc.scan = i < 6 ? ENVSAMP_SCAN_CELLS : ENVSAMP_SCAN_TEXELS;
        desc.count = i % 2 ? 1 : 2147483647;
        result = envsamp_halftone_sizes(image->width, image->height, &desc, &sizes);
        judge("halftone", i, image, result, sizes, 12.0 * image->width,
              36.0 * image->width + 100);
    }
}

/* Every family, at the largest sides, without pixels. */
static void ask_all(const char *name, void (*ask)(const envsamp_image *, double))
{
    envsamp_image image = { NULL, 1, 1, 1, 0, ENVSAMP_LATLONG };
    int i, mapping;

    asked = good = 0;
    for (i = 0; i < SIDES; i++)
        for (image.channels = 1; image.channels <= 4; image.channels++)
            for (mapping = 0; mapping < 3 && image.channels != 2; mapping++) {
                image.width = sides[i][0];
                image.height = sides[i][1];
                image.mapping = (envsamp_mapping)mapping;
                ask(&image, (double)image.width * image.height);
            }
    if (!printing)
        CHECK(good == asked, "%s: %d of %d sizes are right, or refused with 32 bits", name, good,
              asked);
}

static void test_lm(void)
{
    envsamp_lm_desc desc;
    int right = 0, n;

    memset(&desc, 0, sizeof desc);
    desc.residual_count = 2147483647;
    for (n = 1; n <= 8; n++) {
        double bytes = 8.0 * (n + 2) * desc.residual_count;
        size_t said;

        desc.param_count = n;
        said = envsamp_lm_scratch_bytes(&desc);
        right += said ? (double)said == bytes : sizeof said == 4 && bytes >= BITS_32;
    }
    CHECK(right == 8, "lm: %d of 8 sizes for 2^31 - 1 residuals are right, or 0 with 32 bits",
          right);
}

/* A mask whose scratch is a little more than 2^32 bytes. A scratch that is large enough for what is
   above that is not aligned, so that no memory is touched. */
static void test_mask(void)
{
    static float pixel;
    envsamp_image image = { &pixel, 32768, 32766, 1, 0, ENVSAMP_LATLONG };
    size_t bytes = 1u << 20;
    char *memory = (char *)malloc(bytes + 16);
    envsamp_buffer scratch = { memory + 1, bytes };
    uint8_t mask;
    envsamp_result result = envsamp_emissive_mask(&image, NULL, &mask, scratch, NULL);

    CHECK(result == (sizeof(size_t) == 4 ? ENVSAMP_ERR_SIZE : ENVSAMP_ERR_MEMORY),
          "scratch of a mask beyond 32 bits: %s", envsamp_result_string(result));
    free(memory);
}

/* Rows so far apart that the last of them is beyond all memory. */
static void test_strides(void)
{
    envsamp_image image = { NULL, 4, 4, 1, 0, ENVSAMP_LATLONG };
    const size_t strides[] = { SIZE_MAX / 4 / 4 * 4 + 4, SIZE_MAX / 2 / 4 * 4 + 4, SIZE_MAX - 3 };
    envsamp_sizes sizes;
    int refused = 0, i;

    for (i = 0; i < 3; i++) {
        image.row_stride_bytes = strides[i];
        refused += envsamp_kd_sizes(&image, NULL, &sizes) == ENVSAMP_ERR_SIZE
                && envsamp_cdf_sizes(&image, NULL, &sizes) == ENVSAMP_ERR_SIZE
                && envsamp_lights_sizes(&image, NULL, &sizes) == ENVSAMP_ERR_SIZE;
    }
    CHECK(refused == 3, "%d of 3 strides beyond all memory are refused", refused);
}

/* Whether a batch of more samples than an array of floats holds is asserted. */
static int is_asserted(const envsamp_kd *kd, const envsamp_cdf *cdf, int batch)
{
    static float one[6];

    if (setjmp(asserted))
        return 1;
    if (batch == 0)
        envsamp_kd_sample_n(kd, SIZE_MAX / 4, one, one, one, one, one, one);
    else if (batch == 1)
        envsamp_kd_pdf_n(kd, SIZE_MAX / 4, one, one, one, one);
    else if (batch == 2)
        envsamp_cdf_sample_n(cdf, SIZE_MAX / 4, one, one, one, one, one, one);
    else
        envsamp_cdf_pdf_n(cdf, SIZE_MAX / 4, one, one, one, one);
    return 0;
}

static void test_counts(void)
{
    static double memory[4][16384];
    static const float pixels[6] = { 1, 2, 3, 4, 5, 6 };
    envsamp_image image = { pixels, 3, 2, 1, 0, ENVSAMP_LATLONG };
    envsamp_buffer buffers[4];
    const envsamp_kd *kd = NULL;
    const envsamp_cdf *cdf = NULL;
    int caught = 0, i;

    for (i = 0; i < 4; i++) {
        buffers[i].data = memory[i];
        buffers[i].bytes = sizeof memory[i];
    }
    if (envsamp_kd_build(&image, NULL, buffers[0], buffers[1], &kd) == ENVSAMP_OK
        && envsamp_cdf_build(&image, NULL, buffers[2], buffers[3], &cdf) == ENVSAMP_OK)
        for (i = 0; i < 4; i++)
            caught += is_asserted(kd, cdf, i);
    CHECK(caught == 4, "%d of 4 batches of SIZE_MAX / 4 are asserted", caught);
}

int main(int argc, char **argv)
{
    (void)argv;
    printing = argc > 1;
    ask_all("kd", ask_kd);
    ask_all("cdf", ask_cdf);
    ask_all("lights", ask_lights);
    ask_all("halftone", ask_halftone);
    if (printing)
        return 0;
    test_kd_scratch();
    test_lm();
    test_mask();
    test_strides();
    test_counts();
    return check_done();
}
