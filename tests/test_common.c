/* test_common.c: the images, random numbers and made-up maps that examples and tests share.
 *
 *     test_common [PREFIX]       scratch files are PREFIX.*, by default build/test_common.*
 */
#include "check.h"

#include "../examples/common/image.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"

#ifdef HAVE_OPENEXR
#include "../examples/common/exr.h"
#include <ImfCRgbaFile.h>
#endif

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

/* Returns 0 where the lengths claim more codes than there are. */
static int make_table(decode_table *table, const int *lengths, int count)
{
    int length, i, at = 0, room = 1;

    memset(table, 0, sizeof *table);
    for (length = 1; length < 16; length++) {
        for (i = 0; i < count; i++)
            if (lengths[i] == length) {
                table->counts[length]++;
                table->symbols[at++] = i;
            }
        room = 2 * room - table->counts[length];
        if (room < 0)
            return 0;
    }
    return 1;
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

static void read_tables(inflater *state, decode_table *literals, decode_table *distances)
{
    static const int order[19] = {16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15};
    const int literal_count = (int)take_bits(state, 5) + 257;
    const int distance_count = (int)take_bits(state, 5) + 1;
    const int code_count = (int)take_bits(state, 4) + 4;
    int lengths[320] = {0}, i, at = 0;
    decode_table codes;

    for (i = 0; i < code_count; i++)
        lengths[order[i]] = (int)take_bits(state, 3);
    if (!make_table(&codes, lengths, 19))
        state->failed = 1;
    while (at < literal_count + distance_count && !state->failed) {
        const int symbol = take_symbol(state, &codes);
        int value = symbol < 16 ? symbol : 0, times = 1;
        if (symbol == 16) {
            value = at > 0 ? lengths[at - 1] : 0;
            times = 3 + (int)take_bits(state, 2);
        } else if (symbol > 16) {
            times = symbol == 17 ? 3 + (int)take_bits(state, 3) : 11 + (int)take_bits(state, 7);
        }
        for (; times > 0 && at < 320; times--)
            lengths[at++] = value;
    }
    if (at != literal_count + distance_count || !make_table(literals, lengths, literal_count) ||
        !make_table(distances, lengths + literal_count, distance_count))
        state->failed = 1;
}

/* Blocks with dynamic codes only, which is all that the encoder writes. Returns success. */
static int inflate_all(inflater *state)
{
    decode_table literals, distances;
    int last = 0, symbol;

    while (!last && !state->failed) {
        last = (int)take_bits(state, 1);
        if (take_bits(state, 2) != 2)
            return 0;
        read_tables(state, &literals, &distances);
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

enum pattern { FLAT, NOISE, SMOOTH, TILES, RARE, PATTERN_COUNT };

/* Each value is 0.62 times as frequent as the one before, like Fibonacci numbers, which make the
 * deepest of Huffman trees: the plain codes would be longer than the format allows. */
static unsigned char rare_byte(uint32_t draw)
{
    const double u = ((double)draw + 0.5) / 4294967296.0;

    return (unsigned char)(log(u) / log(0.61803));
}

static unsigned char pattern_byte(enum pattern kind, int x, int y, pcg32 *random)
{
    const uint32_t draw = pcg32_next(random);

    switch (kind) {
    case NOISE: return (unsigned char)(draw >> 24);
    case SMOOTH: return (unsigned char)((x * x / 40 + 3 * y + (int)(draw >> 31)) & 255);
    case TILES: return (unsigned char)(hash_combine((uint32_t)(x % 401), (uint32_t)(y % 23)));
    case RARE: return rare_byte(draw);
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
    /* Room in bytes a texel: noise does not compress, all others do. */
    static const double room[PATTERN_COUNT] = {0.01, 3.1, 1.0, 0.6, 1.3};
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
    CHECK(done && back.width == 7 && back.height == 5 && !part_exists(path) &&
          memcmp(back.rgb, map.rgb, 3 * 7 * 5 * sizeof(float)) == 0, "PFM round trip is exact");
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
    check_bad_pfm("grey", "Pf\n1 2\n-1.0\n", 0, "neither");
    check_bad_pfm("other magic", "PF4\n1 2\n-1.0\n", 0, "not a colour PFM");
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
    CHECK(done && back.width == 19 && back.height == 11 && !part_exists(path) &&
          memcmp(back.rgb, map.rgb, 3 * 19 * 11 * sizeof(float)) == 0,
          "EXR round trip of halves is exact");
    if (done)
        image_free(&back);
    map.rgb[4] = sun;
    done = exr_write(path, &map, error_line, sizeof error_line) &&
           exr_read(path, &back, error_line, sizeof error_line);
    CHECK(done && back.rgb[4] == 65504.0f, "radiance above the largest half is clipped to it");
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
    CHECK(fabs(product) < 5.0 * sqrt((double)DRAWS) / 12.0, "neighbours are uncorrelated");
    CHECK(unit_float(0xffffffffu) == 1.0f - 1.0f / 16777216.0f && unit_float(0x1ffu) > 0.0f &&
          unit_float(0xffu) == 0.0f, "the float range is 0 to 1 - 2^-24 in steps of 2^-24");
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
    test_bad_files();
    test_exr();
    test_pcg32();
    test_hash();
    test_sobol_boxes();
    test_sobol_seeds();
    test_maps();
    return check_done();
}
