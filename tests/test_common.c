/* test_common.c: mappings and lookup, and the images, random numbers and made-up maps that examples
 * and tests share.
 *
 *     test_common [PREFIX]       scratch files are PREFIX.*, by default build/test_common.*
 */
#include "check.h"

#include "inside.h"

#include "../examples/common/image.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"

#ifdef HAVE_OPENEXR
#include "../examples/common/exr.h"
#include <ImfCRgbaFile.h>
#endif

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- scratch files ---- */

static const char *prefix = "build/test_common";
static char scratch_path[512], error_line[512];

static const char *scratch(const char *suffix)
{
    snprintf(scratch_path, sizeof scratch_path, "%s.%s", prefix, suffix);
    return scratch_path;
}

static void write_bytes(const char *path, const void *bytes, size_t count)
{
    FILE *stream = fopen(path, "wb");

    if (!stream || fwrite(bytes, 1, count, stream) != count || fclose(stream) != 0) {
        printf("Bail out! cannot write %s\n", path);
        exit(1);
    }
}

/* The file's bytes, to be freed; NULL where there is no such file. */
static unsigned char *read_bytes(const char *path, size_t *count)
{
    FILE *stream = fopen(path, "rb");
    unsigned char *bytes;
    long size;

    *count = 0;
    if (!stream)
        return NULL;
    fseek(stream, 0, SEEK_END);
    size = ftell(stream);
    rewind(stream);
    bytes = (unsigned char *)malloc((size_t)size + 1);
    if (bytes)
        *count = fread(bytes, 1, (size_t)size, stream);
    fclose(stream);
    return bytes;
}

static int file_exists(const char *path)
{
    FILE *stream = fopen(path, "rb");

    if (stream)
        fclose(stream);
    return stream != NULL;
}

static int part_exists(const char *path)
{
    char part[600];

    snprintf(part, sizeof part, "%s.part", path);
    return file_exists(part);
}

/* One line that names the file and holds the reason. */
static int error_says(const char *path, const char *reason)
{
    return strncmp(error_line, path, strlen(path)) == 0 && strstr(error_line, reason) &&
           !strchr(error_line, '\n');
}

/* ---- a small inflate, so that what was written is read by other code ---- */

typedef struct inflater {
    const unsigned char *in;
    size_t in_count, in_at;
    unsigned bits;
    int bit_count, failed;
    unsigned char *out;
    size_t out_count, out_at;
} inflater;

typedef struct decode_table {
    int counts[16], symbols[320];
} decode_table;

static unsigned take_bits(inflater *state, int count)
{
    unsigned value;

    while (state->bit_count < count && !state->failed) {
        if (state->in_at == state->in_count) {
            state->failed = 1;
            return 0;
        }
        state->bits |= (unsigned)state->in[state->in_at++] << state->bit_count;
        state->bit_count += 8;
    }
    value = state->bits & ((1u << count) - 1u);
    state->bits >>= count;
    state->bit_count -= count;
    return value;
}

static void make_table(decode_table *table, const int *lengths, int count)
{
    int length, i, at = 0;

    memset(table, 0, sizeof *table);
    for (length = 1; length < 16; length++)
        for (i = 0; i < count; i++)
            if (lengths[i] == length) {
                table->counts[length]++;
                table->symbols[at++] = i;
            }
}

static int take_symbol(inflater *state, const decode_table *table)
{
    int length, code = 0, first = 0, index = 0;

    for (length = 1; length < 16 && !state->failed; length++) {
        code |= (int)take_bits(state, 1);
        if (code - first < table->counts[length])
            return table->symbols[index + code - first];
        index += table->counts[length];
        first = (first + table->counts[length]) << 1;
        code <<= 1;
    }
    state->failed = 1;
    return 0;
}

static void put_out(inflater *state, unsigned byte)
{
    if (state->out_at == state->out_count)
        state->failed = 1;
    else
        state->out[state->out_at++] = (unsigned char)byte;
}

static void copy_match(inflater *state, int symbol, const decode_table *distances)
{
    static const int length_bases[29] = {3,  4,  5,  6,  7,  8,  9,  10, 11,  13,
                                         15, 17, 19, 23, 27, 31, 35, 43, 51,  59,
                                         67, 83, 99, 115, 131, 163, 195, 227, 258};
    static const int distance_bases[30] = {1,    2,    3,    4,    5,    7,    9,    13,
                                           17,   25,   33,   49,   65,   97,   129,  193,
                                           257,  385,  513,  769,  1025, 1537, 2049, 3073,
                                           4097, 6145, 8193, 12289, 16385, 24577};
    const int i = symbol - 257;
    int length, distance, code;

    if (i > 28) {
        state->failed = 1;
        return;
    }
    length = length_bases[i] + (int)take_bits(state, i < 8 || i == 28 ? 0 : i / 4 - 1);
    code = take_symbol(state, distances);
    if (code > 29) {
        state->failed = 1;
        return;
    }
    distance = distance_bases[code] + (int)take_bits(state, code < 4 ? 0 : code / 2 - 1);
    if ((size_t)distance > state->out_at)
        state->failed = 1;
    for (; length > 0 && !state->failed; length--)
        put_out(state, state->out[state->out_at - (size_t)distance]);
}

/* The fixed codes. */
static void make_tables(decode_table *literals, decode_table *distances)
{
    int lengths[288], i;

    for (i = 0; i < 288; i++)
        lengths[i] = i < 144 ? 8 : i < 256 ? 9 : i < 280 ? 7 : 8;
    make_table(literals, lengths, 288);
    for (i = 0; i < 30; i++)
        lengths[i] = 5;
    make_table(distances, lengths, 30);
}

/* Blocks with fixed codes only, which is all that the encoder writes. Returns success. */
static int inflate_all(inflater *state)
{
    decode_table literals, distances;
    int last = 0, symbol;

    make_tables(&literals, &distances);
    while (!last && !state->failed) {
        last = (int)take_bits(state, 1);
        if (take_bits(state, 2) != 1)
            return 0;
        while (!state->failed && (symbol = take_symbol(state, &literals)) != 256) {
            if (symbol < 256)
                put_out(state, (unsigned)symbol);
            else
                copy_match(state, symbol, &distances);
        }
    }
    return !state->failed && state->out_at == state->out_count;
}

/* ---- a small PNG reader ---- */

static uint32_t big_endian(const unsigned char *p)
{
    return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

static uint32_t crc_of(const unsigned char *p, size_t count)
{
    uint32_t crc = ~0u;
    int bit;

    for (; count > 0; count--, p++)
        for (crc ^= *p, bit = 0; bit < 8; bit++)
            crc = crc & 1u ? crc >> 1 ^ 0xedb88320u : crc >> 1;
    return ~crc;
}

static uint32_t adler_of(const unsigned char *p, size_t count)
{
    uint32_t a = 1, b = 0;

    for (; count > 0; count--, p++) {
        a = (a + *p) % 65521u;
        b = (b + a) % 65521u;
    }
    return b << 16 | a;
}

static void unfilter(unsigned char *rows, size_t stride, int height)
{
    size_t i;
    int row;

    for (row = 0; row < height; row++) {
        unsigned char *line = rows + (stride + 1) * (size_t)row + 1;
        for (i = 0; i < stride; i++) {
            const int a = i >= 3 ? line[i - 3] : 0;
            const int b = row > 0 ? (line - stride - 1)[i] : 0;
            const int c = row > 0 && i >= 3 ? (line - stride - 1)[i - 3] : 0;
            const int pa = abs(b - c), pb = abs(a - c), pc = abs(a + b - 2 * c);
            const int guesses[5] = {0, a, b, (a + b) / 2,
                                    pa <= pb && pa <= pc ? a : pb <= pc ? b : c};
            line[i] = (unsigned char)(line[i] + guesses[line[-1] % 5]);
        }
    }
}

/* Finds the single IDAT chunk; 0 where a CRC, the order or a length is wrong. */
static size_t find_data(const unsigned char *png, size_t count, size_t *length)
{
    size_t at = 8, data = 0;
    int ended = 0;

    while (at + 12 <= count && !ended) {
        const size_t size = big_endian(png + at);
        if (size > count - at - 12 ||
            crc_of(png + at + 4, size + 4) != big_endian(png + at + 8 + size))
            return 0;
        if (memcmp(png + at + 4, "IDAT", 4) == 0) {
            data = at + 8;
            *length = size;
        }
        ended = memcmp(png + at + 4, "IEND", 4) == 0;
        at += 12 + size;
    }
    return ended && at == count ? data : 0;
}

/* Rows as decoded, each behind its filter byte; NULL where anything in the file is wrong. */
static unsigned char *decode_png(const char *path, int width, int height, size_t *file_size)
{
    static const unsigned char head[16] = {0x89, 'P', 'N', 'G', 13, 10, 26, 10,
                                           0,    0,   0,   13,  'I', 'H', 'D', 'R'};
    const size_t stride = 3 * (size_t)width, out_count = (stride + 1) * (size_t)height;
    unsigned char *png = read_bytes(path, file_size), *out = (unsigned char *)malloc(out_count);
    size_t length = 0, data = png ? find_data(png, *file_size, &length) : 0;
    inflater state;
    int good = 0;

    if (out && data && memcmp(png, head, sizeof head) == 0 && length > 6 &&
        big_endian(png + 16) == (uint32_t)width && big_endian(png + 20) == (uint32_t)height) {
        memset(&state, 0, sizeof state);
        state.in = png + data + 2;
        state.in_count = length - 6;
        state.out = out;
        state.out_count = out_count;
        good = inflate_all(&state) && state.in_at == state.in_count &&
               big_endian(png + data) >> 16 == 0x789c &&
               adler_of(out, out_count) == big_endian(png + data + length - 4);
        unfilter(out, stride, height);
    }
    free(png);
    if (good)
        return out;
    free(out);
    return NULL;
}

/* ---- PNG ---- */

enum pattern { FLAT, NOISE, SMOOTH, TILES, PATTERN_COUNT };

static unsigned char pattern_byte(enum pattern kind, int x, int y, pcg32 *random)
{
    const uint32_t draw = pcg32_next(random);

    switch (kind) {
    case NOISE: return (unsigned char)(draw >> 24);
    case SMOOTH: return (unsigned char)((x * x / 40 + 3 * y + (int)(draw >> 31)) & 255);
    case TILES: return (unsigned char)(hash_combine((uint32_t)(x % 401), (uint32_t)(y % 23)));
    default: return 77;
    }
}

static unsigned char *make_pattern(enum pattern kind, int width, int height)
{
    unsigned char *rgb = (unsigned char *)malloc(3 * (size_t)width * (size_t)height);
    pcg32 random = pcg32_make(5, (uint64_t)kind);
    int x, y;

    for (y = 0; rgb && y < height; y++)
        for (x = 0; x < 3 * width; x++)
            rgb[(size_t)y * 3 * (size_t)width + (size_t)x] = pattern_byte(kind, x, y, &random);
    return rgb;
}

static int rows_equal(const unsigned char *decoded, const unsigned char *rgb, int width, int height)
{
    const size_t stride = 3 * (size_t)width;
    int row;

    for (row = 0; row < height; row++)
        if (memcmp(decoded + (stride + 1) * (size_t)row + 1, rgb + stride * (size_t)row, stride))
            return 0;
    return 1;
}

static void check_png(enum pattern kind, int width, int height, double most_bytes_a_texel)
{
    const char *path = scratch("png");
    unsigned char *rgb = make_pattern(kind, width, height);
    const int wrote = image_write_png(path, width, height, rgb, error_line, sizeof error_line);
    size_t size = 0;
    unsigned char *decoded = decode_png(path, width, height, &size);
    const double room = 400.0 + most_bytes_a_texel * width * height;

    CHECK(wrote && decoded && rows_equal(decoded, rgb, width, height) && !part_exists(path),
          "PNG pattern %d of %d x %d decodes to what was written", (int)kind, width, height);
    CHECK((double)size <= room, "and takes %lu bytes, at most %.0f", (unsigned long)size, room);
    free(decoded);
    free(rgb);
    remove(path);
}

static void test_png(void)
{
    /* Room in bytes a texel, of 3: noise grows by 1/16, as half of the literals take 9 bits. */
    static const double room[PATTERN_COUNT] = {0.03, 3.2, 1.8, 0.6};
    int kind;

    for (kind = 0; kind < PATTERN_COUNT; kind++) {
        check_png((enum pattern)kind, 1, 1, 0.0);
        check_png((enum pattern)kind, 401, 301, room[kind]);
    }
}

static void test_failed_writes(void)
{
    const unsigned char rgb[3] = {1, 2, 3};
    const char *path = scratch("no-such-folder/picture.png");
    image map;
    int done;

    done = image_write_png(path, 1, 1, rgb, error_line, sizeof error_line);
    CHECK(!done && error_says(path, "cannot be created"), "no folder: %s", error_line);
    image_alloc(&map, 2, 2);
    done = image_write_pfm(path, &map, error_line, sizeof error_line);
    CHECK(!done && error_says(path, "cannot be created"), "no folder: %s", error_line);
    image_free(&map);
    done = image_write_png(scratch("png"), 0, 1, rgb, error_line, sizeof error_line);
    CHECK(!done && error_says(scratch_path, "no size") && !file_exists(scratch_path),
          "no texels: %s", error_line);
    done = image_write_png(".", 1, 1, rgb, error_line, sizeof error_line);
    CHECK(!done && error_says(".", "cannot be") && !part_exists("."), "folder: %s", error_line);
}

static void test_tonemap(void)
{
    const double inputs[9] = {0.0, -1.0, 0.001, 0.25, 0.5, 2.0, (double)NAN, (double)INFINITY, 0.1};
    const int expected[9] = {0, 0, 7, 188, 255, 255, 0, 255, 124};
    unsigned char rgb[9];
    image map;
    int i, wrong = 0;

    image_alloc(&map, 3, 1);
    for (i = 0; i < 9; i++)
        map.rgb[i] = (float)inputs[i];
    image_tonemap(&map, 2.0f, rgb);
    for (i = 0; i < 9; i++)
        wrong += rgb[i] != expected[i];
    CHECK(wrong == 0, "tone mapping clips and encodes sRGB: %d of 9 wrong", wrong);
    image_free(&map);
}

/* ---- PFM ---- */

static void test_pfm_round_trip(void)
{
    const char *path = scratch("pfm");
    pcg32 random = pcg32_make(9, 0);
    image map, back;
    int i, done;

    /* Any bit pattern survives, infinities and NaN among them. */
    image_alloc(&map, 7, 5);
    for (i = 0; i < 3 * 7 * 5; i++) {
        const uint32_t bits = pcg32_next(&random);
        memcpy(map.rgb + i, &bits, 4);
    }
    map.rgb[0] = (float)INFINITY;
    map.rgb[1] = (float)NAN;
    done = image_write_pfm(path, &map, error_line, sizeof error_line) &&
           image_read(path, &back, error_line, sizeof error_line);
    CHECK(done && IS(back.width, 7) && IS(back.height, 5) && !part_exists(path) &&
          IS(memcmp(back.rgb, map.rgb, 3 * 7 * 5 * sizeof(float)), 0), "PFM round trip is exact");
    image_free(&map);
    if (done)
        image_free(&back);
    remove(path);
}

/* 1 x 2 texels, 1.0 to 6.0 in file order, so the file's first row is the image's last. */
static size_t make_pfm(unsigned char *bytes, const char *header, int big)
{
    const size_t start = strlen(header);
    size_t i, j;

    memcpy(bytes, header, start);
    for (i = 0; i < 6; i++) {
        static const uint32_t values[6] = {0x3f800000u, 0x40000000u, 0x40400000u,
                                           0x40800000u, 0x40a00000u, 0x40c00000u};
        for (j = 0; j < 4; j++)
            bytes[start + 4 * i + j] = (unsigned char)(values[i] >> (big ? 24 - 8 * j : 8 * j));
    }
    return start + 24;
}

static void check_pfm(const char *header, int big, double factor)
{
    static const double expected[6] = {4, 5, 6, 1, 2, 3};
    const char *path = scratch("pfm");
    unsigned char bytes[128];
    image map;
    int i, wrong = 0, done;

    write_bytes(path, bytes, make_pfm(bytes, header, big));
    done = image_read_pfm(path, &map, error_line, sizeof error_line);
    for (i = 0; done && i < 6; i++)
        wrong += (double)map.rgb[i] != expected[i] * factor;
    CHECK(done && wrong == 0 && map.width == 1 && map.height == 2,
          "PFM, %s-endian, scale %g: %d wrong", big ? "big" : "little", factor, wrong);
    image_free(&map);
    remove(path);
}

/* 2 x 3 texels, the file's first row the image's last. */
static void check_grey_pfm(const char *header, int big, double factor)
{
    static const double expected[6] = {5, 6, 3, 4, 1, 2};
    const char *path = scratch("pfm");
    unsigned char bytes[128];
    image map;
    int i, wrong = 0, done;

    write_bytes(path, bytes, make_pfm(bytes, header, big));
    done = image_read(path, &map, error_line, sizeof error_line);
    for (i = 0; done && i < 18; i++)
        wrong += (double)map.rgb[i] != expected[i / 3] * factor;
    CHECK(done && wrong == 0 && map.width == 2 && map.height == 3,
          "grey PFM, %s-endian, scale %g: %d wrong", big ? "big" : "little", factor, wrong);
    image_free(&map);
    remove(path);
}

static void check_bad_file(const char *title, const void *bytes, size_t count, const char *reason)
{
    const char *path = scratch("bad");
    image map = {1, 1, NULL};
    int done;

    write_bytes(path, bytes, count);
    error_line[0] = '\0';
    done = image_read(path, &map, error_line, sizeof error_line);
    CHECK(!done && !map.rgb && map.width == 0 && error_says(path, reason), "%s: %s", title,
          error_line);
    image_free(&map);
    remove(path);
}

static void check_bad_pfm(const char *title, const char *header, int more, const char *reason)
{
    unsigned char bytes[160] = {0};
    const size_t count = make_pfm(bytes, header, 0);

    check_bad_file(title, bytes, (size_t)((int)count + more), reason);
}

static void test_bad_files(void)
{
    static const unsigned char exr_start[8] = {0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0};
    image map;
    int done;

    check_bad_pfm("one byte short", "PF\n1 2\n-1.0\n", -1, "holds 23 bytes");
    check_bad_pfm("one byte long", "PF\n1 2\n-1.0\n", 1, "holds 25 bytes");
    check_bad_pfm("carriage return", "PF\n1 2\n-1.0\r\n", 0, "holds 25 bytes");
    check_bad_pfm("grey, of colour's length", "Pf\n1 2\n-1.0\n", 0, "need 8");
    check_bad_pfm("grey, short", "Pf\n1 6\n-1.0\n", -1, "holds 23 bytes");
    check_bad_pfm("other magic", "PF4\n1 2\n-1.0\n", 0, "not a PFM");
    check_bad_pfm("no width", "PF\n0 2\n-1.0\n", 0, "0 x 2");
    check_bad_pfm("negative width", "PF\n-1 -2\n-1.0\n", 0, "-1 x -2");
    check_bad_pfm("absurd size", "PF\n60000 60000\n-1.0\n", 0, "60000 x 60000");
    check_bad_pfm("overflowing size", "PF\n99999999999999 2\n-1.0\n", 0, "outside");
    check_bad_pfm("endless number", "PF\n0000000000000000000001 2\n-1.0\n", 0, "size");
    check_bad_pfm("size in words", "PF\n1 two\n-1.0\n", 0, "size");
    check_bad_pfm("zero scale", "PF\n1 2\n0\n", 0, "scale");
    check_bad_pfm("infinite scale", "PF\n1 2\ninf\n", 0, "scale");
    check_bad_file("header only", "PF\n1 2\n-1.0", 11, "scale");
    check_bad_file("empty file", "", 0, "empty");
    check_bad_file("text file", "hello\n", 6, "neither");
#ifdef HAVE_OPENEXR
    check_bad_file("start of an EXR file", exr_start, sizeof exr_start, "not a readable EXR");
#else
    check_bad_file("EXR without OpenEXR", exr_start, sizeof exr_start, "no EXR support");
#endif
    done = image_read(scratch("missing.pfm"), &map, error_line, sizeof error_line);
    CHECK(!done && error_says(scratch_path, "cannot be opened"), "missing: %s", error_line);
    done = image_read(".", &map, error_line, sizeof error_line);
    CHECK(!done && error_says(".", "cannot be"), "a folder: %s", error_line);
    CHECK(!image_read(scratch("missing.pfm"), &map, NULL, 0), "no room for a message is fine");
}

/* ---- EXR ---- */

#ifdef HAVE_OPENEXR

static const float half_values[6] = {0.0f,  1.0f,     0.333251953125f,
                                     -2.5f, 65504.0f, 6.103515625e-05f};

static void fill_halves(image *map)
{
    int i;

    for (i = 0; i < 3 * map->width * map->height; i++)
        map->rgb[i] = half_values[i * 7 % 6];
}

static void test_exr_round_trip(void)
{
    const char *path = scratch("exr");
    const float sun = 1e9f;
    image map, back;
    int done;

    image_alloc(&map, 19, 11);
    fill_halves(&map);
    done = exr_write(path, &map, error_line, sizeof error_line) &&
           image_read(path, &back, error_line, sizeof error_line);
    CHECK(done && IS(back.width, 19) && IS(back.height, 11) && !part_exists(path) &&
          IS(memcmp(back.rgb, map.rgb, 3 * 19 * 11 * sizeof(float)), 0),
          "EXR round trip of halves is exact");
    if (done)
        image_free(&back);
    map.rgb[4] = sun;
    done = exr_write(path, &map, error_line, sizeof error_line) &&
           exr_read(path, &back, error_line, sizeof error_line);
    CHECK(done && IS(back.rgb[4], 65504.0f), "radiance above the largest half is clipped to it");
    if (done)
        image_free(&back);
    done = exr_write(scratch("no-such-folder/a.exr"), &map, error_line, sizeof error_line);
    CHECK(!done && error_says(scratch_path, "No such file"), "EXR: %s", error_line);
    image_free(&map);
}

/* A file whose data window starts at (x_min, y_min), texel i holding red i. */
static int write_offset_exr(const char *path, int x_min, int y_min)
{
    ImfHeader *header = ImfNewHeader();
    ImfRgba plane[64]; /* rows of 4, with room on both sides of the window */
    ImfRgba *origin = plane + 20;
    ImfOutputFile *file;
    int i, done;

    memset(plane, 0, sizeof plane);
    for (i = 0; i < 12; i++)
        ImfFloatToHalf((float)i, &origin[x_min + 4 * y_min + i].r);
    ImfHeaderSetDisplayWindow(header, 0, 0, 99, 99);
    ImfHeaderSetDataWindow(header, x_min, y_min, x_min + 3, y_min + 2);
    file = ImfOpenOutputFile(path, header, IMF_WRITE_RGBA);
    ImfDeleteHeader(header);
    if (!file)
        return 0;
    done = ImfOutputSetFrameBuffer(file, origin, 1, 4) &&
           ImfOutputWritePixels(file, 3);
    return ImfCloseOutputFile(file) && done;
}

static void check_exr_offset(int x_min, int y_min)
{
    const char *path = scratch("exr");
    image map;
    int i, wrong = 0, done;

    done = write_offset_exr(path, x_min, y_min) &&
           exr_read(path, &map, error_line, sizeof error_line);
    for (i = 0; done && i < 12; i++)
        wrong += map.rgb[3 * i] != (float)i;
    CHECK(done && wrong == 0 && map.width == 4 && map.height == 3,
          "EXR data window at (%d, %d): %d wrong", x_min, y_min, wrong);
    if (done)
        image_free(&map);
}

static void test_bad_exr(void)
{
    unsigned char *bytes;
    size_t count, at;
    image map;

    image_alloc(&map, 64, 64);
    fill_halves(&map);
    exr_write(scratch("exr"), &map, error_line, sizeof error_line);
    image_free(&map);
    bytes = read_bytes(scratch("exr"), &count);
    check_bad_file("EXR cut in its texels", bytes, count - 40, "cannot be read");
    check_bad_file("EXR cut in its header", bytes, 100, "not a readable EXR");
    for (at = 0; at + 40 < count && memcmp(bytes + at, "dataWindow", 11) != 0; at++)
        ;
    /* Name, type and size take 11 + 6 + 4 bytes; xMax is the third number behind them. */
    memcpy(bytes + at + 21 + 8, "\xff\xff\xff\x00", 4);
    check_bad_file("EXR with an absurd data window", bytes, count, "");
    free(bytes);
    remove(scratch("exr"));
}

static void test_exr(void)
{
    test_exr_round_trip();
    check_exr_offset(0, 0);
    check_exr_offset(-2, -1);
    check_exr_offset(3, 2);
    test_bad_exr();
}

#else

static void test_exr(void)
{
    CHECK_SKIP("EXR: this build has no OpenEXR");
}

#endif

/* ---- random numbers ---- */

static void test_pcg32(void)
{
    /* What O'Neill's reference implementation prints for seed 42 and stream 54. */
    static const uint32_t reference[6] = {0xa15c02b7u, 0x7b47f409u, 0xba1d3330u,
                                          0x83d2f293u, 0xbfa4784bu, 0xcbed606eu};
    enum { CELLS = 256, DRAWS = 1 << 18 };
    int counts[CELLS] = {0}, i, wrong = 0;
    pcg32 random = pcg32_make(42, 54);
    double chi_square = 0.0, sum = 0.0, product = 0.0, before = 0.5;

    for (i = 0; i < 6; i++)
        wrong += pcg32_next(&random) != reference[i];
    CHECK(wrong == 0, "PCG32 gives the reference numbers: %d of 6 wrong", wrong);
    for (i = 0; i < DRAWS; i++) {
        const double x = (double)pcg32_float(&random);
        counts[(int)(x * CELLS) % CELLS]++;
        sum += x - 0.5;
        product += (x - 0.5) * (before - 0.5);
        before = x;
    }
    for (i = 0; i < CELLS; i++) {
        const double off = counts[i] - (double)DRAWS / CELLS;
        chi_square += off * off * CELLS / DRAWS;
    }
    /* Five standard deviations each way: 255 degrees of freedom have deviation 22.6. */
    CHECK(chi_square > 142.0 && chi_square < 368.0, "256 cells: chi-square %.1f", chi_square);
    CHECK(fabs(sum) < 5.0 * sqrt(DRAWS / 12.0), "mean is off by %.5f", sum / DRAWS);
    CHECK(IS_NEAR(product, 0.0, 5.0 * sqrt((double)DRAWS) / 12.0), "neighbours are uncorrelated");
    CHECK(unit_float(0xffffffffu) == 1.0f - 1.0f / 16777216.0f && unit_float(0x1ffu) > 0.0f &&
          IS(unit_float(0xffu), 0.0f), "the float range is 0 to 1 - 2^-24 in steps of 2^-24");
}

static void test_hash(void)
{
    int flips = 0, i, bit;

    for (i = 0; i < 1024; i++)
        for (bit = 0; bit < 32; bit++) {
            uint32_t change = hash_u32((uint32_t)i) ^ hash_u32((uint32_t)i ^ (1u << bit));
            for (; change; change &= change - 1)
                flips++;
        }
    CHECK(abs(flips - 1024 * 32 * 16) < 1024 * 32 / 4, "a flipped bit flips %.3f bits of the hash",
          flips / (1024.0 * 32.0));
}

/* How many of the boxes of 2^across by 2^(log2_count - across) cells hold other than one point. */
static int wrong_boxes(float (*points)[2], int log2_count, int across)
{
    static unsigned char hits[1 << 12];
    const int count = 1 << log2_count, down = log2_count - across;
    int i, wrong = 0;

    memset(hits, 0, sizeof hits);
    for (i = 0; i < count; i++) {
        const int x = (int)(points[i][0] * (float)(1 << across));
        const int y = (int)(points[i][1] * (float)(1 << down));
        if (x < 0 || x >= 1 << across || y < 0 || y >= 1 << down)
            return count;
        hits[x << down | y]++;
    }
    for (i = 0; i < count; i++)
        wrong += hits[i] != 1;
    return wrong;
}

static int wrong_in_run(uint32_t first, int log2_count, uint32_t seed)
{
    static float points[1 << 12][2];
    int i, across, wrong = 0;

    for (i = 0; i < 1 << log2_count; i++)
        sobol_owen(first + (uint32_t)i, seed, points[i]);
    for (across = 0; across <= log2_count; across++)
        wrong += wrong_boxes(points, log2_count, across);
    return wrong;
}

static void test_sobol_boxes(void)
{
    static float independent[256][2];
    pcg32 random = pcg32_make(1, 1);
    int log2_count, i, wrong;
    uint32_t seed;

    for (log2_count = 0; log2_count <= 12; log2_count++) {
        for (wrong = 0, seed = 0; seed < 8; seed++) {
            wrong += wrong_in_run(0, log2_count, seed * 0x9e3779b9u);
            wrong += wrong_in_run(5u << log2_count, log2_count, seed);
        }
        CHECK(wrong == 0, "2^%d Sobol points: %d boxes of area 2^-%d without exactly one point",
              log2_count, wrong, log2_count);
    }
    for (i = 0; i < 256; i++) {
        independent[i][0] = pcg32_float(&random);
        independent[i][1] = pcg32_float(&random);
    }
    wrong = wrong_boxes(independent, 8, 4);
    CHECK(wrong > 100, "the same count finds %d of 256 boxes wrong for independent points", wrong);
}

/* Over seeds a point is uniform, and the points of two seeds are unrelated. */
static void test_sobol_seeds(void)
{
    enum { COUNT = 4096 };
    double sum = 0.0, squares = 0.0, paired = 0.0;
    float a[2], b[2];
    uint32_t i;

    for (i = 0; i < COUNT; i++) {
        sobol_owen(3, i, a);
        sum += (double)a[0] - 0.5;
        squares += ((double)a[1] - 0.5) * ((double)a[1] - 0.5) - 1.0 / 12.0;
        sobol_owen(i, 1, a);
        sobol_owen(i, 2, b);
        paired += ((double)a[0] - 0.5) * ((double)b[0] - 0.5);
    }
    CHECK(fabs(sum) < 5.0 * sqrt(COUNT / 12.0), "one point over seeds: mean off by %.4f",
          sum / COUNT);
    CHECK(fabs(squares) < 5.0 * sqrt(COUNT / 180.0), "and its variance by %.4f", squares / COUNT);
    CHECK(fabs(paired) < 5.0 * sqrt((double)COUNT) / 12.0, "two seeds: correlation %.4f",
          12.0 * paired / COUNT);
}

/* ---- maps ---- */

static double luminance(const image *map, int column, int row)
{
    const float *rgb = map->rgb + 3 * ((size_t)row * (size_t)map->width + (size_t)column);

    return 0.2126 * (double)rgb[0] + 0.7152 * (double)rgb[1] + 0.0722 * (double)rgb[2];
}

static int bad_texels(const image *map)
{
    int i, bad = 0;

    for (i = 0; i < 3 * map->width * map->height; i++)
        bad += !(map->rgb[i] >= 0.0f && map->rgb[i] < 1e8f);
    return bad;
}

static void check_map(const char *name, int width, int height)
{
    image map, again;
    const int done = map_make(name, width, height, &map) && map_make(name, width, height, &again);

    CHECK(done && bad_texels(&map) == 0, "%s, %d x %d: finite and not negative", name, width,
          height);
    CHECK(done && memcmp(map.rgb, again.rgb,
                         3 * sizeof(float) * (size_t)width * (size_t)height) == 0,
          "%s, %d x %d: the same again", name, width, height);
    image_free(&map);
    image_free(&again);
}

static double brightest(const image *map)
{
    double most = 0.0;
    int row, column;

    for (row = 0; row < map->height; row++)
        for (column = 0; column < map->width; column++)
            most = fmax(most, luminance(map, column, row));
    return most;
}

/* Irradiance at normal incidence of the texels brighter than `threshold`. */
static double bright_power(const image *map, double threshold)
{
    const double step = 3.14159265358979 / map->height;
    double sum = 0.0;
    int row, column;

    for (row = 0; row < map->height; row++)
        for (column = 0; column < map->width; column++)
            if (luminance(map, column, row) > threshold)
                sum += luminance(map, column, row) * sin(step * (row + 0.5)) * 2.0 *
                       sin(0.5 * step) * 2.0 * 3.14159265358979 / map->width;
    return sum;
}

/* Texels above `end_row` at least ten times as bright as the mean of their neighbours. */
static int lone_lights(const image *map, int end_row)
{
    int row, column, count = 0;

    for (row = 1; row + 1 < end_row; row++)
        for (column = 1; column + 1 < map->width; column++)
            count += luminance(map, column, row) >
                     2.5 * (luminance(map, column - 1, row) + luminance(map, column + 1, row) +
                            luminance(map, column, row - 1) + luminance(map, column, row + 1));
    return count;
}

/* Mean size of the step between neighbours in a row, in natural logarithms. */
static double mean_log_step(const image *map)
{
    double sum = 0.0;
    int row, column;

    for (row = 0; row < map->height; row++)
        for (column = 1; column < map->width; column++)
            sum += fabs(log((1e-6 + luminance(map, column, row)) /
                            (1e-6 + luminance(map, column - 1, row))));
    return sum / ((map->width - 1.0) * map->height);
}

/* The step across the seam, as a multiple of the ordinary one. */
static double seam_step(const image *map)
{
    double sum = 0.0;
    int row;

    for (row = 0; row < map->height; row++)
        sum += fabs(log(luminance(map, 0, row) / luminance(map, map->width - 1, row)));
    return sum / map->height / mean_log_step(map);
}

static void test_sky(void)
{
    image coarse, fine;
    double low, high;

    map_make("sky", 128, 64, &coarse);
    map_make("sky", 1024, 512, &fine);
    low = bright_power(&coarse, 100.0);
    high = bright_power(&fine, 100.0);
    CHECK(brightest(&fine) > 0.95e5 * 0.4, "the sun is 10^5 times 0.4: %.0f", brightest(&fine));
    CHECK(fabs(low / high - 1.0) < 0.02, "and as strong on a coarse map: %.3f, %.3f", low, high);
    CHECK(fine.rgb[2] > 2.0f * fine.rgb[0], "the top of the sky is blue");
    CHECK(luminance(&fine, 9, 511) < luminance(&fine, 9, 240), "the ground is below the sky");
    CHECK(seam_step(&fine) < 3.0, "no seam: %.2f of an ordinary step", seam_step(&fine));
    image_free(&coarse);
    image_free(&fine);
}

static void test_map_looks(void)
{
    image map;
    int i, other = 0;

    map_make("constant", 64, 32, &map);
    for (i = 0; i < 3 * 64 * 32; i++)
        other += map.rgb[i] != 1.0f;
    CHECK(other == 0, "constant is 1: %d others", other);
    image_free(&map);
    map_make("night", 512, 256, &map);
    CHECK(lone_lights(&map, 64) > 50, "night has %d stars above 45 degrees",
          lone_lights(&map, 64));
    CHECK(lone_lights(&map, 256) > lone_lights(&map, 64) + 100, "and %d lights of a texel",
          lone_lights(&map, 256));
    CHECK(brightest(&map) > 100.0, "and a brightest one of %.0f", brightest(&map));
    image_free(&map);
    map_make("studio", 256, 128, &map);
    CHECK(lone_lights(&map, 128) < 20 && brightest(&map) > 50.0 && luminance(&map, 100, 30) < 0.5,
          "studio is dark with broad lights");
    image_free(&map);
    map_make("foliage", 256, 128, &map);
    CHECK(mean_log_step(&map) > 1.1, "foliage: neighbours differ by a factor of %.2f",
          exp(mean_log_step(&map)));
    image_free(&map);
}

static void test_maps(void)
{
    image map;
    int i;

    for (i = 0; map_names[i]; i++) {
        check_map(map_names[i], 128, 64);
        check_map(map_names[i], 33, 7);
        check_map(map_names[i], 1, 1);
    }
    CHECK(i == 5, "there are %d maps", i);
    CHECK(!map_make("nothing", 4, 4, &map) && !map.rgb, "an unknown name is refused");
    CHECK(!map_make("sky", 0, 4, &map) && !map.rgb, "an empty map is refused");
    CHECK(!map_make("sky", 65536, 65536, &map) && !map.rgb, "an absurd map is refused");
    test_sky();
    test_map_looks();
}

/* ---- mappings ---- */

static const double pi = 3.14159265358979323846;

/* What [Clarberg 2008] says, as it stands there. */
static void octahedral_dir(double u, double v, double dir[3])
{
    const double a = 2.0 * u - 1.0, b = 2.0 * v - 1.0, side = 1.0 - (fabs(a) + fabs(b));
    const double r = 1.0 - fabs(side);
    const double phi = (r == 0.0 ? 1.0 : (fabs(b) - fabs(a)) / r + 1.0) * pi / 4.0;

    dir[0] = copysign(cos(phi), a) * r * sqrt(2.0 - r * r);
    dir[1] = copysign(sin(phi), b) * r * sqrt(2.0 - r * r);
    dir[2] = copysign(1.0 - r * r, side);
}

static void octahedral_point(const float dir[3], double uv[2])
{
    const double x = (double)dir[0], y = (double)dir[1], z = (double)dir[2];
    const double flat = hypot(x, y), length = hypot(flat, z);
    const double r = flat / sqrt(length * (length + fabs(z)));
    const double q = r * atan2(fabs(y), fabs(x)) * 2.0 / pi, p = r - q;

    uv[0] = 0.5 + copysign(0.5, x) * (z < 0.0 ? 1.0 - q : p);
    uv[1] = 0.5 + copysign(0.5, y) * (z < 0.0 ? 1.0 - p : q);
}

/* How far apart two points of the square are, the shortest way, across edges and corners too. */
static double octahedral_distance(double u, double v, double to_u, double to_v)
{
    double least = fmax(fabs(u - to_u), fabs(v - to_v));
    int i;

    for (i = 0; i < 2; i++) {
        const double far = 2.0 * i;
        least = fmin(least, fmax(fabs(far - u - to_u), fabs(1.0 - v - to_v)));
        least = fmin(least, fmax(fabs(1.0 - u - to_u), fabs(far - v - to_v)));
        least = fmin(least, fmax(fabs(u + far - 1.0 - to_u), fabs(v - 1.0 - to_v)));
        least = fmin(least, fmax(fabs(u + far - 1.0 - to_u), fabs(v + 1.0 - to_v)));
    }
    return least;
}

/* Poles, axes, edges, borders of octants, and the floats next to them: u and v of point i. */
enum { NUMBERS = 21, SPECIAL_POINTS = NUMBERS * NUMBERS, POINTS = 400000 };

static void square_point(int i, pcg32 *random, float uv[2])
{
    static const float numbers[7] = {0.0f, 1e-30f, 0.25f, 0.5f, 0.75f, 0.625f, 1.0f};
    const int special[2] = {i % NUMBERS, i / NUMBERS % NUMBERS};
    int c;

    for (c = 0; c < 2; c++) {
        const float number = numbers[special[c] / 3];
        const float next = nextafterf(number, special[c] % 3 == 1 ? 0.0f : 1.0f);
        const float step = 1e-6f * (pcg32_float(random) - 0.5f);

        uv[c] = special[c] % 3 ? next : number;
        if (i >= SPECIAL_POINTS)
            uv[c] = i % 3 ? pcg32_float(random) : fminf(fmaxf(number + step, 0.0f), 1.0f);
    }
    if (i >= SPECIAL_POINTS && i % 5 == 0) /* near the edges of the octahedron: |a| + |b| = 1 */
        uv[1] = fabsf(0.5f - uv[0] + (i % 2 ? 1e-7f * (uv[1] - 0.5f) : 0.0f));
    if (i % 5 == 0 && i % 4 > 1)
        uv[1] = 1.0f - uv[1];
}

typedef struct mapping_errors {
    double dir, length, fast_dir, fast_length, uv, fast_uv, round_trip;
    int outside;
} mapping_errors;

/* A NaN is the worst of all, and stays. */
static void worst(double *most, double error)
{
    if (!isnan(*most) && !(error <= *most))
        *most = error;
}

static void compare_dir(const float dir[3], const double expected[3], double *error, double *length)
{
    const double x = (double)dir[0], y = (double)dir[1], z = (double)dir[2];

    worst(error, fabs(x - expected[0]));
    worst(error, fabs(y - expected[1]));
    worst(error, fabs(z - expected[2]));
    worst(length, fabs(sqrt(x * x + y * y + z * z) - 1.0));
}

static void compare_uv(const float dir[3], const float uv[2], double *error, mapping_errors *errors)
{
    double expected[2];

    octahedral_point(dir, expected);
    worst(error, octahedral_distance((double)uv[0], (double)uv[1], expected[0], expected[1]));
    errors->outside += !(uv[0] >= 0.0f && uv[0] <= 1.0f && uv[1] >= 0.0f && uv[1] <= 1.0f);
}

/* From a point and back, and both ways by the functions for sampling. */
static void add_point(const float uv[2], float scale, mapping_errors *errors)
{
    double expected[3];
    float dir[3], fast[3], back[2];
    int c;

    octahedral_dir((double)uv[0], (double)uv[1], expected);
    envsamp_uv_to_dir(ENVSAMP_OCTAHEDRAL, uv[0], uv[1], dir);
    compare_dir(dir, expected, &errors->dir, &errors->length);
    inside_octahedral_dir(uv, fast);
    compare_dir(fast, expected, &errors->fast_dir, &errors->fast_length);
    for (c = 0; c < 3; c++)
        dir[c] *= scale;
    envsamp_dir_to_uv(ENVSAMP_OCTAHEDRAL, dir, back);
    compare_uv(dir, back, &errors->uv, errors);
    worst(&errors->round_trip, octahedral_distance((double)back[0], (double)back[1],
                                                   (double)uv[0], (double)uv[1]));
    inside_octahedral_uv(dir, back);
    compare_uv(dir, back, &errors->fast_uv, errors);
}

static void test_octahedral_points(void)
{
    static const float scales[5] = {1.0f, 1e-15f, 1e18f, 3.0f, 1e-4f};
    pcg32 random = pcg32_make(11, 0);
    mapping_errors most;
    float uv[2];
    int i;

    memset(&most, 0, sizeof most);
    for (i = 0; i < POINTS; i++) {
        square_point(i, &random, uv);
        add_point(uv, scales[i % 5], &most);
    }
    CHECK(most.dir <= 2e-7, "octahedral: directions are within 2e-7: %.1e", most.dir);
    CHECK(most.length <= 2e-7, "and 1 long within 2e-7: %.1e", most.length);
    CHECK(most.fast_dir <= 5e-7, "for sampling within 5e-7: %.1e", most.fast_dir);
    CHECK(most.fast_length <= 5e-7, "and 1 long within 5e-7: %.1e", most.fast_length);
    CHECK(most.uv <= 3e-7, "points are within 3e-7: %.1e", most.uv);
    CHECK(most.fast_uv <= 2e-7, "for sampling within 2e-7: %.1e", most.fast_uv);
    CHECK(most.round_trip <= 3e-7, "there and back is %.1e off", most.round_trip);
    CHECK(!most.outside, "all in the square, but for %d", most.outside);
}

/* Directions that are special in the other way round: components that are 0, tiny or equal. */
static void test_octahedral_directions(void)
{
    static const float parts[9] = {0.0f, -0.0f, 1.0f, -1.0f, 1e-4f, -1e-4f, 1e-12f, 0.9999999f,
                                   -1.0000001f};
    static const float scales[3] = {1.0f, 1e-15f, 1e18f};
    mapping_errors most;
    double back_and_there = 0.0, length = 0.0;
    int i;

    memset(&most, 0, sizeof most);
    for (i = 0; i < 3 * 729; i++) {
        const float scale = scales[i % 3];
        const float dir[3] = {scale * parts[i / 3 % 9], scale * parts[i / 27 % 9],
                              scale * parts[i / 243]};
        const double x = (double)dir[0], y = (double)dir[1], z = (double)dir[2];
        const double size = sqrt(x * x + y * y + z * z);
        double unit[3];
        float uv[2], again[3];

        if (size < 0.9e-15)
            continue;
        envsamp_dir_to_uv(ENVSAMP_OCTAHEDRAL, dir, uv);
        compare_uv(dir, uv, &most.uv, &most);
        unit[0] = x / size;
        unit[1] = y / size;
        unit[2] = z / size;
        envsamp_uv_to_dir(ENVSAMP_OCTAHEDRAL, uv[0], uv[1], again);
        compare_dir(again, unit, &back_and_there, &length);
    }
    CHECK(most.uv <= 3e-7 && !most.outside, "octahedral: special directions: %.1e", most.uv);
    CHECK(back_and_there <= 1e-6, "and back again: %.1e", back_and_there);
}

/* ---- small math ---- */

/* Of libm too, where a long double is a double. */
#define ROUNDING (LDBL_MANT_DIG > DBL_MANT_DIG ? 0.0 : 3e-16)

/* What stands above each function in the header, against libm. */
static void test_double_math(void)
{
    const long double half_turn = 3.14159265358979323846264338327950288L;
    double sines = 0.0, logs = 0.0, powers = 0.0;
    pcg32 random = pcg32_make(12, 0);
    int i;

    for (i = 0; i < 200000; i++) {
        const double unit = (double)pcg32_float(&random);
        const double x = i % 3 ? 2.0 * unit : 0.125 * (i % 17);
        const double number = ldexp(1.0 + unit, i % 2001 - 1000);
        const double power = i % 2 ? 2000.0 * unit - 1000.0 : 4.0 * unit - 2.0;
        double sine, cosine;

        inside_sincos_pi(x, &sine, &cosine);
        worst(&sines, (double)fabsl((long double)sine - sinl(half_turn * (long double)x)));
        worst(&sines, (double)fabsl((long double)cosine - cosl(half_turn * (long double)x)));
        worst(&logs, (double)fabsl((long double)inside_log2(number) - log2l((long double)number))
                     / (1.0 + fabs(log2(number))));
        worst(&powers, (double)fabsl((long double)inside_exp2(power)
                                     / exp2l((long double)power) - 1.0L));
    }
    CHECK(sines <= 2e-16 + ROUNDING, "sine and cosine are within 2e-16: %.2e", sines);
    CHECK(logs <= 1e-15, "logarithms within 1e-15: %.2e", logs);
    CHECK(powers <= 1e-15, "powers of 2 within 1e-15: %.2e", powers);
}

static void test_float_math(void)
{
    double power = 0.0, less_one = 0.0, circle = 0.0, turn = 0.0, polar = 0.0;
    pcg32 random = pcg32_make(13, 0);
    int i;

    for (i = 0; i < 200000; i++) {
        const float u = i % 5 ? pcg32_float(&random) : (float)(i % 9) / 8.0f;
        const double x = i % 2 ? 126.0 * (double)u : (double)u;
        const double e = expm1(x * log(2.0)), got = (double)inside_exp2m1(x);
        float a = 2.0f * u - 1.0f, b = i % 7 ? 2.0f * pcg32_float(&random) - 1.0f : a;
        float cosine, sine;
        double expected;

        if (i % 126 < 125)
            worst(&power, fabs(got - e) / (e + 1.0));
        if (x < 1.0)
            worst(&less_one, fabs(got - e) / fmax(e, 1e-30));
        inside_cos_sin_turn(u, &cosine, &sine);
        worst(&circle, fabs((double)cosine - cos(2.0 * pi * (double)u)));
        worst(&circle, fabs((double)sine - sin(2.0 * pi * (double)u)));
        b = i % 11 ? i % 13 ? b : -b : 0.0f;
        b = i % 17 ? b : 1e-3f * b;
        expected = atan2((double)a, (double)b) / (2.0 * pi);
        expected += expected < 0.0 ? 1.0 : 0.0;
        if (a != 0.0f || b != 0.0f)
            worst(&turn, fabs((double)inside_turn(a, b) - expected));
        a = i % 4 < 2 ? a : 1.0f - 1e-4f * u;
        a = i % 2 ? a : -a;
        worst(&polar, fabs((double)inside_polar_fraction(1.0f - a, 1.0f + a)
                           - 2.0 / pi * atan2(sqrt(1.0 - (double)a), sqrt(1.0 + (double)a))));
    }
    CHECK(power <= 1e-7, "floats: 2^x - 1 is within 1e-7 of 2^x: %.2e", power);
    CHECK(less_one <= 2.5e-7, "below x = 1 within 2.5e-7 of itself: %.2e", less_one);
    CHECK(circle <= 5e-7, "cosine and sine are within 5e-7: %.2e", circle);
    CHECK(turn <= 1.5e-7, "angles within 1.5e-7 turns: %.2e", turn);
    CHECK(polar <= 1.5e-7, "polar angles within 1.5e-7 of a half turn: %.2e", polar);
    CHECK(inside_turn(0.0f, 0.0f) == 0.0f, "the angle of the origin is 0");
}

/* Neither 0 nor 1: the middles of 2^31 equal parts. Bits of one number say nothing of another. */
static void test_random_numbers(void)
{
    enum { NUMBERS_DRAWN = 1 << 16 };
    int i, astray = 0, bit, ones[31] = {0}, flips[32] = {0}, uneven = 0;

    for (i = 0; i < NUMBERS_DRAWN; i++) {
        const double number = inside_random(1234, (uint32_t)i), parts = number * 4294967296.0;
        const uint32_t bits = (uint32_t)parts;

        astray += !(number > 0.0 && number < 1.0 && (double)bits == parts && bits % 2 == 1);
        for (bit = 0; bit < 31; bit++) {
            ones[bit] += (int)(bits >> (bit + 1) & 1);
            flips[bit] += inside_random(1234u ^ 1u << bit, (uint32_t)i) != number;
        }
    }
    for (bit = 0; bit < 31; bit++)
        uneven += abs(2 * ones[bit] - NUMBERS_DRAWN) > 5 * 256 || flips[bit] < NUMBERS_DRAWN - 1;
    CHECK(inside_random(0x0ba1bc42u, 0) == 1.0 / 4294967296.0
          && inside_random(0x20c9e3eeu, 0) == 1.0 - 1.0 / 4294967296.0,
          "the least and the greatest, which these seeds give, are 2^-32 and 1 - 2^-32");
    CHECK(!astray, "random numbers are odd multiples of 2^-32 in (0, 1), but %d", astray);
    CHECK(!uneven, "each bit is set in half of them, and all of a seed counts, but for %d", uneven);
}


static int dir_is(envsamp_mapping mapping, float u, float v, double x, double y, double z)
{
    const double expected[3] = {x, y, z};
    double error = 0.0, length = 0.0;
    float dir[3];

    envsamp_uv_to_dir(mapping, u, v, dir);
    compare_dir(dir, expected, &error, &length);
    if (!(error <= 2e-7))
        check_note("#     direction (%g, %g, %g), expected (%g, %g, %g)\n", (double)dir[0],
                   (double)dir[1], (double)dir[2], x, y, z);
    return error <= 2e-7;
}

static void test_octahedral_layout(void)
{
    const envsamp_mapping square = ENVSAMP_OCTAHEDRAL;
    const double half = sqrt(0.5);

    CHECK(dir_is(square, 0.5f, 0.5f, 0, 0, 1), "octahedral: the centre is +z");
    CHECK(dir_is(square, 0, 0, 0, 0, -1) && dir_is(square, 1, 0, 0, 0, -1) &&
          dir_is(square, 0, 1, 0, 0, -1) && dir_is(square, 1, 1, 0, 0, -1), "the corners are -z");
    CHECK(dir_is(square, 1, 0.5f, 1, 0, 0) && dir_is(square, 0, 0.5f, -1, 0, 0) &&
          dir_is(square, 0.5f, 1, 0, 1, 0) && dir_is(square, 0.5f, 0, 0, -1, 0),
          "u goes along +x and v along +y");
    CHECK(dir_is(square, 0.75f, 0.75f, half, half, 0) &&
          dir_is(square, 0.25f, 0.75f, -half, half, 0), "halfway to the corners is the horizon");
    CHECK(dir_is(square, -3, 0.5f, -1, 0, 0) && dir_is(square, 7, 0.5f, 1, 0, 0) &&
          dir_is(square, 0.5f, -3, 0, -1, 0) && dir_is(square, 0.5f, 7, 0, 1, 0) &&
          dir_is(square, INFINITY, -INFINITY, 0, 0, -1), "u and v are clamped");
    CHECK(dir_is(square, NAN, 0.5f, -1, 0, 0) && dir_is(square, 0.5f, NAN, 0, -1, 0),
          "NaN counts as 0");
}

/* Any float gives a point of the map. */
static void test_odd_directions(void)
{
    static const float parts[9] = {0.0f, -0.0f, 1.0f, -1e-40f, 1e-30f, -3e38f, NAN, INFINITY,
                                   -INFINITY};
    int mapping, i, outside = 0, moved = 0;

    for (mapping = 0; mapping < 3; mapping++)
        for (i = 0; i < 729; i++) {
            const float dir[3] = {parts[i % 9], parts[i / 9 % 9], parts[i / 81]};
            const float most = mapping == ENVSAMP_HEMISPHERE ? 2.0f : 1.0f;
            const float centre = mapping == ENVSAMP_OCTAHEDRAL ? 0.5f : 0.0f;
            float uv[2];

            envsamp_dir_to_uv((envsamp_mapping)mapping, dir, uv);
            outside += !(uv[0] >= 0.0f && uv[0] <= 1.0f && uv[1] >= 0.0f && uv[1] <= most);
            if (i == 0 || (i == 1 + 9 + 81 && mapping == ENVSAMP_OCTAHEDRAL))
                moved += !(uv[0] == centre && uv[1] == centre);
        }
    CHECK(!outside, "any floats give a point of the map, but for %d", outside);
    CHECK(IS(moved, 0), "the zero vector gives that of +z");
}

/* Solid angle of a triangle of unit vectors, with its sign. */
static double triangle_sr(const double a[3], const double b[3], const double c[3])
{
    const double volume = a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
                          a[2] * (b[0] * c[1] - b[1] * c[0]);
    const double ab = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const double bc = b[0] * c[0] + b[1] * c[1] + b[2] * c[2];
    const double ca = c[0] * a[0] + c[1] * a[1] + c[2] * a[2];

    return 2.0 * atan2(volume, 1.0 + ab + bc + ca);
}

/* Solid angle of [u0, u1] x [v0, v1], by triangles. */
static double cell_sr(double u0, double v0, double u1, double v1)
{
    enum { STEPS = 128 };
    static double corners[STEPS + 1][STEPS + 1][3];
    const double step_u = (u1 - u0) / (double)STEPS, step_v = (v1 - v0) / (double)STEPS;
    double sum = 0.0;
    int x, y, c;

    for (y = 0; y <= STEPS; y++)
        for (x = 0; x <= STEPS; x++) {
            const float u = (float)(u0 + step_u * x), v = (float)(v0 + step_v * y);
            float dir[3];

            envsamp_uv_to_dir(ENVSAMP_OCTAHEDRAL, u, v, dir);
            for (c = 0; c < 3; c++)
                corners[y][x][c] = (double)dir[c];
        }
    for (y = 0; y < STEPS; y++)
        for (x = 0; x < STEPS; x++)
            sum += triangle_sr(corners[y][x], corners[y][x + 1], corners[y + 1][x + 1]) +
                   triangle_sr(corners[y][x], corners[y + 1][x + 1], corners[y + 1][x]);
    return sum;
}

static void test_equal_area(void)
{
    pcg32 random = pcg32_make(12, 0);
    double most = 0.0, whole = cell_sr(0.0, 0.0, 1.0, 1.0);
    int i;

    for (i = 0; i < 40; i++) {
        const double u = 0.9 * (double)pcg32_float(&random), v = 0.9 * (double)pcg32_float(&random);
        const double wide = 0.05 + (0.95 - u) * (double)pcg32_float(&random);
        const double high = 0.05 + (0.95 - v) * (double)pcg32_float(&random);

        worst(&most, fabs(cell_sr(u, v, u + wide, v + high) / (4.0 * pi * wide * high) - 1.0));
    }
    CHECK(fabs(whole - 4.0 * pi) < 1e-5, "octahedral: the square is 4 pi but for %.1e",
          whole - 4.0 * pi);
    CHECK(most < 3e-4, "a cell's solid angle is its share of 4 pi, within %.1e", most);
}

static void test_hemisphere(void)
{
    const float down[3] = {0.0f, 0.0f, -3.0f}, low[3] = {0.3f, -0.2f, -1e-3f};
    pcg32 random = pcg32_make(13, 0);
    double error = 0.0;
    float uv[2], dir[3], back[2];
    int i, below = 0;

    for (i = 0; i < 20000; i++) {
        uv[0] = pcg32_float(&random);
        uv[1] = 1e-3f + 0.999f * pcg32_float(&random);
        envsamp_uv_to_dir(ENVSAMP_HEMISPHERE, uv[0], uv[1], dir);
        envsamp_dir_to_uv(ENVSAMP_HEMISPHERE, dir, back);
        below += dir[2] < 0.0f;
        worst(&error, fabs((double)back[1] - (double)uv[1]));
        worst(&error, fabs(remainder((double)back[0] - (double)uv[0], 1.0)) *
                      sin(0.5 * pi * (double)uv[1]));
    }
    CHECK(error <= 5e-7 && !below, "hemisphere: there and back is %.1e off", error);
    envsamp_dir_to_uv(ENVSAMP_HEMISPHERE, down, back);
    envsamp_dir_to_uv(ENVSAMP_HEMISPHERE, low, uv);
    CHECK(IS(back[1], 2.0f) && uv[1] > 1.0f && uv[1] < 1.01f, "v is above 1 below the horizon");
}

/* ---- lookup ---- */

enum { MOST_TEXELS = 64 };
static float texels[MOST_TEXELS];

static envsamp_image random_map(envsamp_mapping mapping, int width, int height, uint32_t seed)
{
    pcg32 random = pcg32_make(seed, 3);
    envsamp_image map;
    int i;

    for (i = 0; i < MOST_TEXELS; i++)
        texels[i] = pcg32_float(&random);
    memset(&map, 0, sizeof map);
    map.pixels = texels;
    map.width = width;
    map.height = height;
    map.channels = 1;
    map.mapping = mapping;
    return map;
}

static double look(const envsamp_image *map, int bilinear, double u, double v)
{
    float dir[3], rgb[3];

    envsamp_uv_to_dir(map->mapping, (float)u, (float)v, dir);
    envsamp_lookup(map, !bilinear, dir, rgb);
    return (double)rgb[0];
}

static int wraps(envsamp_mapping mapping, int width, int height, int x, int y, int to_x, int to_y)
{
    inside_wrap(mapping, width, height, &x, &y);
    return IS(x, to_x) && IS(y, to_y);
}

static void test_wrap(void)
{
    const envsamp_mapping whole = ENVSAMP_LATLONG, half = ENVSAMP_HEMISPHERE;
    const envsamp_mapping square = ENVSAMP_OCTAHEDRAL;
    int mapping, x, y, moved = 0;

    CHECK(wraps(square, 3, 4, -1, 1, 0, 2) && wraps(square, 3, 4, -1, 0, 0, 3) &&
          wraps(square, 3, 4, 3, 0, 2, 3) && wraps(square, 3, 4, 3, 2, 2, 1), "beyond a side");
    CHECK(wraps(square, 3, 4, 0, -1, 2, 0) && wraps(square, 3, 4, 1, -1, 1, 0) &&
          wraps(square, 3, 4, 0, 4, 2, 3) && wraps(square, 3, 4, 2, 4, 0, 3),
          "beyond top and bottom");
    CHECK(wraps(square, 3, 4, -1, -1, 2, 3) && wraps(square, 3, 4, 3, -1, 0, 3) &&
          wraps(square, 3, 4, -1, 4, 2, 0) && wraps(square, 3, 4, 3, 4, 0, 0), "beyond a corner");
    CHECK(wraps(whole, 4, 2, -1, 0, 3, 0) && wraps(whole, 4, 2, 4, 1, 0, 1), "beyond the seam");
    CHECK(wraps(whole, 4, 2, 0, -1, 2, 0) && wraps(whole, 4, 2, 3, 2, 1, 1) &&
          wraps(whole, 4, 2, -1, -1, 1, 0) && wraps(whole, 4, 2, 4, 2, 2, 1), "over a pole");
    CHECK(wraps(half, 4, 2, 0, -1, 2, 0) && wraps(half, 4, 2, -1, -1, 1, 0) &&
          wraps(half, 4, 2, 0, 2, 0, 1) && wraps(half, 4, 2, -1, 2, 3, 1) &&
          wraps(half, 4, 2, 4, 1, 0, 1), "hemisphere: half a turn at the zenith alone");
    for (mapping = 0; mapping < 3; mapping++) {
        for (y = 0; y < 4; y++)
            for (x = 0; x < 3; x++)
                moved += !wraps((envsamp_mapping)mapping, 3, 4, x, y, x, y);
        for (y = -1; y <= 1; y++)
            for (x = -1; x <= 1; x++)
                moved += !wraps((envsamp_mapping)mapping, 1, 1, x, y, 0, 0);
    }
    CHECK(!moved, "inside nothing moves, and 1 x 1 has one texel, but for %d", moved);
}

/* Points all over each texel, and its middle. */
static void check_texels(envsamp_mapping mapping, int width, int height)
{
    const envsamp_image map = random_map(mapping, width, height, 21);
    pcg32 random = pcg32_make(22, 0);
    int i, nearest = 0, middles = 0;

    for (i = 0; i < 20 * width * height; i++) {
        const int x = i % width, y = i / width % height;
        const double u = 0.01 + 0.98 * (double)pcg32_float(&random);
        const double v = 0.01 + 0.98 * (double)pcg32_float(&random);
        const double texel = (double)texels[y * width + x];

        nearest += look(&map, 0, (x + u) / width, (y + v) / height) != texel;
        middles += fabs(look(&map, 1, (x + 0.5) / width, (y + 0.5) / height) - texel) > 1e-5;
    }
    CHECK(!nearest && !middles, "mapping %d, %d x %d: the texel that holds a point: %d, %d wrong",
          (int)mapping, width, height, nearest, middles);
}

/* The step between two points that lie next to each other on the sphere. */
enum border { LEFT, RIGHT, TOP, BOTTOM, SEAM, NORTH, SOUTH };

static double step_across(const envsamp_image *map, enum border border, double along)
{
    const double low = 1e-6, high = 1.0 - 1e-6;
    const double end = border == RIGHT || border == BOTTOM || border == SOUTH ? high : low;

    if (border == LEFT || border == RIGHT)
        return look(map, 1, end, along) - look(map, 1, end, 1.0 - along);
    if (border == TOP || border == BOTTOM)
        return look(map, 1, along, end) - look(map, 1, 1.0 - along, end);
    if (border == SEAM)
        return look(map, 1, low, along) - look(map, 1, high, along);
    return look(map, 1, along, end) - look(map, 1, along + 0.5, end);
}

static void check_border(envsamp_mapping mapping, int width, int height, enum border border)
{
    const envsamp_image map = random_map(mapping, width, height, 23);
    double most = 0.0;
    int i;

    for (i = 0; i <= 200; i++)
        worst(&most, fabs(step_across(&map, border, i / 200.0)));
    CHECK(most < 1e-4, "mapping %d, %d x %d: bilinear is continuous over border %d: %.1e",
          (int)mapping, width, height, (int)border, most);
}

/* Whether bilinear is the mean of the four texels in the corners, where -z is. */
static void check_corners(int width, int height)
{
    const envsamp_image map = random_map(ENVSAMP_OCTAHEDRAL, width, height, 24);
    const float *last = texels + (height - 1) * width;
    const double mean = 0.25 * ((double)texels[0] + (double)texels[width - 1] + (double)last[0] +
                                (double)last[width - 1]);
    double most = 0.0;
    int i;

    for (i = 0; i < 4; i++)
        worst(&most, fabs(look(&map, 1, i & 1, i >> 1) - mean));
    CHECK(most < 1e-6, "octahedral, %d x %d: corners are the mean of four texels: %.1e", width,
          height, most);
}

/* Points on the last edges belong to the last texels, as a sampler has it. */
static void check_last_texels(envsamp_mapping mapping)
{
    const envsamp_image map = random_map(mapping, 4, 6, 28);
    int i, wrong = 0;

    for (i = 0; i < 6 && mapping == ENVSAMP_OCTAHEDRAL; i++)
        wrong += look(&map, 0, 1.0, (i + 0.5) / 6.0) != (double)texels[4 * i + 3];
    for (i = 0; i < 4 && mapping != ENVSAMP_LATLONG; i++)
        wrong += look(&map, 0, (i + 0.5) / 4.0, 1.0) != (double)texels[20 + i];
    wrong += mapping == ENVSAMP_LATLONG && look(&map, 0, 0.0, 1.0) != (double)texels[20];
    CHECK(!wrong, "mapping %d: the last edges, %d wrong", (int)mapping, wrong);
}

static void test_lookup(void)
{
    static const int sizes[7][2] = {{1, 1}, {1, 5}, {5, 1}, {4, 3}, {3, 4}, {8, 8}, {7, 7}};
    int mapping, i, border;

    for (mapping = 0; mapping < 3; mapping++)
        check_last_texels((envsamp_mapping)mapping);
    for (i = 0; i < 7; i++) {
        const int width = sizes[i][0], height = sizes[i][1];
        for (mapping = 0; mapping < 3; mapping++)
            check_texels((envsamp_mapping)mapping, width, height);
        for (border = LEFT; border <= BOTTOM; border++)
            check_border(ENVSAMP_OCTAHEDRAL, width, height, (enum border)border);
        check_corners(width, height);
        check_border(ENVSAMP_LATLONG, width, height, SEAM);
        check_border(ENVSAMP_HEMISPHERE, width, height, SEAM);
        if (width % 2) /* which is not half a turn */
            continue;
        check_border(ENVSAMP_LATLONG, width, height, NORTH);
        check_border(ENVSAMP_LATLONG, width, height, SOUTH);
        check_border(ENVSAMP_HEMISPHERE, width, height, NORTH);
    }
}

static void test_horizon(void)
{
    const envsamp_image map = random_map(ENVSAMP_HEMISPHERE, 6, 4, 25);
    const float below[3] = {0.6f, 0.8f, -1e-7f}, on[3] = {0.6f, 0.8f, -0.0f};
    const float down[3] = {0.0f, 0.0f, -1.0f};
    float rgb[3] = {9.0f, 9.0f, 9.0f};
    double most = 0.0;
    int bilinear, i, lit = 0;

    for (bilinear = 0; bilinear < 2; bilinear++) {
        envsamp_lookup(&map, !bilinear, below, rgb);
        lit += rgb[0] != 0.0f || rgb[1] != 0.0f || rgb[2] != 0.0f;
        envsamp_lookup(&map, !bilinear, down, rgb);
        lit += rgb[0] != 0.0f;
        envsamp_lookup(&map, !bilinear, on, rgb);
        lit += !(rgb[0] > 0.0f);
    }
    CHECK(IS(lit, 0), "hemisphere: black below the horizon, not on it");
    for (i = 0; i < 100; i++)
        worst(&most, fabs(look(&map, 1, i / 100.0, 1.0) - look(&map, 1, i / 100.0, 0.875)));
    CHECK(most < 1e-5, "its last row goes on to the horizon: %.1e", most);
}

/* Weights that are negative by a rounding would show beside so bright a texel. */
static void test_bright_texel(void)
{
    envsamp_image map = random_map(ENVSAMP_OCTAHEDRAL, 8, 8, 26);
    pcg32 random = pcg32_make(27, 0);
    int i, negative = 0;

    for (i = 0; i < MOST_TEXELS; i++)
        texels[i] = i % 3 ? 0.0f : 1e30f;
    for (i = 0; i < 100000; i++) {
        const float number = ((float)(int)(8.0f * pcg32_float(&random)) + 0.5f) / 8.0f;
        const float near = nextafterf(number, i % 2 ? 0.0f : 1.0f);

        negative += look(&map, 1, (double)near, (double)pcg32_float(&random)) < 0.0;
        negative += look(&map, 1, (double)pcg32_float(&random), (double)near) < 0.0;
    }
    CHECK(!negative, "bilinear is never negative, but for %d", negative);
}

/* ---- sizes ---- */

/* The largest that a buffer may be, and a byte more in one of two. */
static void test_largest_sizes(void)
{
    const uint64_t most = SIZE_MAX / 2;
    envsamp_sizes sizes = { 0, 0 };

    CHECK(inside_set_sizes(&sizes, most, most) == ENVSAMP_OK && sizes.table_bytes == SIZE_MAX / 2
          && sizes.scratch_bytes == SIZE_MAX / 2, "buffers of half of the memory that can be");
    CHECK(inside_set_sizes(&sizes, most + 1, 16) == ENVSAMP_ERR_SIZE
          && inside_set_sizes(&sizes, 16, most + 1) == ENVSAMP_ERR_SIZE
          && sizes.table_bytes == SIZE_MAX / 2, "and of a byte more");
}

int main(int argument_count, char **arguments)
{
    if (argument_count > 1)
        prefix = arguments[1];
    test_png();
    test_failed_writes();
    test_tonemap();
    test_pfm_round_trip();
    check_pfm("PF\n1 2\n-1.0\n", 0, 1.0);
    check_pfm("PF\n1 2\n1.0\n", 1, 1.0);
    check_pfm("PF 1 2 -0.5\n", 0, 0.5);
    check_grey_pfm("Pf\n2 3\n-1.0\n", 0, 1.0);
    check_grey_pfm("Pf\n2 3\n4.0\n", 1, 4.0);
    test_bad_files();
    test_exr();
    test_pcg32();
    test_hash();
    test_sobol_boxes();
    test_sobol_seeds();
    test_maps();
    test_double_math();
    test_float_math();
    test_random_numbers();
    test_octahedral_points();
    test_octahedral_directions();
    test_octahedral_layout();
    test_odd_directions();
    test_equal_area();
    test_hemisphere();
    test_wrap();
    test_lookup();
    test_horizon();
    test_bright_texel();
    test_largest_sizes();
    return check_done();
}
