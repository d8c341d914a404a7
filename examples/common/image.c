/* image.c: memory, PFM and PNG for image.h; PNG through a deflate encoder of its own. */
#include "image.h"
#include "load.h"

#include "hdr.h"
#ifdef HAVE_OPENEXR
#include "exr.h"
#endif

#include <float.h>
#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#ifndef S_ISREG /* Windows */
#define S_ISREG(mode) (((mode) & _S_IFMT) == _S_IFREG)
#define S_ISDIR(mode) (((mode) & _S_IFMT) == _S_IFDIR)
#endif

/* ---- memory and errors ---- */

int image_size_valid(long long width, long long height)
{
    return width >= 1 && width <= IMAGE_SIDE_MAX && height >= 1 && height <= IMAGE_SIDE_MAX &&
           width * height <= IMAGE_TEXELS_MAX;
}

int image_alloc(image *out, int width, int height)
{
    out->width = out->height = 0;
    out->rgb = NULL;
    if (!image_size_valid(width, height))
        return 0;
    out->rgb = (float *)calloc((size_t)width * (size_t)height, 3 * sizeof(float));
    if (!out->rgb)
        return 0;
    out->width = width;
    out->height = height;
    return 1;
}

void image_free(image *map)
{
    free(map->rgb);
    map->rgb = NULL;
    map->width = map->height = 0;
}

void image_clean(image *map)
{
    const size_t count = (size_t)map->width * (size_t)map->height * 3;
    size_t i;

    for (i = 0; i < count; i++)
        if (!(map->rgb[i] > 0.0f && map->rgb[i] <= FLT_MAX))
            map->rgb[i] = 0.0f;
}

int image_fail(char *error, size_t error_size, const char *path, const char *format, ...)
{
    va_list arguments;
    size_t used;

    if (!error || error_size == 0)
        return 0;
    snprintf(error, error_size, "%s: ", path);
    used = strlen(error);
    va_start(arguments, format);
    vsnprintf(error + used, error_size - used, format, arguments);
    va_end(arguments);
    for (; *error; error++)
        if ((*error >= 0 && *error < ' ') || *error == 127)
            *error = ' ';
    return 0;
}

int image_temporary_path(const char *path, char temporary[IMAGE_PATH_MAX],
                         char *error, size_t error_size)
{
    static const char suffix[] = ".part";

    if (strlen(path) + sizeof suffix > IMAGE_PATH_MAX)
        return image_fail(error, error_size, path, "the path is too long");
    strcpy(temporary, path);
    strcat(temporary, suffix);
    return 1;
}

int image_publish(const char *temporary, const char *path, char *error, size_t error_size)
{
    int reason;

    if (rename(temporary, path) == 0)
        return 1;
    reason = errno;
    remove(temporary);
    return image_fail(error, error_size, path, "cannot be put in place: %s", strerror(reason));
}

/* A folder, or something that one may wait for forever; it is checked before it is opened. */
static const char *no_file(const char *path)
{
    struct stat status;

    if (stat(path, &status) != 0 || S_ISREG(status.st_mode))
        return NULL;
    return S_ISDIR(status.st_mode) ? "it is a folder" : "it is a pipe or a device, not a file";
}

FILE *image_open(const char *path, char *error, size_t error_size)
{
    const char *reason = no_file(path);
    FILE *stream = reason ? NULL : fopen(path, "rb");

    if (reason)
        image_fail(error, error_size, path, "cannot be read: %s", reason);
    else if (!stream)
        image_fail(error, error_size, path, "cannot be opened: %s", strerror(errno));
    return stream;
}

/* Bytes from here to the end, or -1 where the stream cannot tell. */
static long bytes_left(FILE *stream)
{
    long here = ftell(stream), end;

    if (here < 0 || fseek(stream, 0, SEEK_END) != 0)
        return -1;
    end = ftell(stream);
    if (end < 0 || fseek(stream, here, SEEK_SET) != 0)
        return -1;
    return end - here;
}

unsigned char *image_read_bytes(const char *path, size_t *count, char *error, size_t error_size)
{
    FILE *stream = image_open(path, error, error_size);
    unsigned char *bytes = NULL;
    long size;

    *count = 0;
    if (!stream)
        return NULL;
    size = bytes_left(stream);
    if (size >= 0)
        bytes = (unsigned char *)malloc((size_t)size + 1);
    if (bytes)
        *count = fread(bytes, 1, (size_t)size, stream);
    if (!bytes || *count != (size_t)size) {
        image_fail(error, error_size, path, size >= 0 && !bytes ? "does not fit in memory"
                                                                : "cannot be read in full");
        free(bytes);
        bytes = NULL;
    }
    fclose(stream);
    return bytes;
}

/* A file under its temporary name; file_close publishes it or leaves nothing. */
typedef struct output_file {
    FILE *stream;
    char temporary[IMAGE_PATH_MAX];
} output_file;

static int file_create(output_file *file, const char *path, char *error, size_t error_size)
{
    if (!image_temporary_path(path, file->temporary, error, error_size))
        return 0;
    file->stream = fopen(file->temporary, "wb");
    if (!file->stream)
        return image_fail(error, error_size, path, "cannot be created: %s", strerror(errno));
    return 1;
}

static int file_close(output_file *file, const char *path, char *error, size_t error_size)
{
    int failed = ferror(file->stream);

    failed |= fclose(file->stream);
    if (failed) {
        remove(file->temporary);
        return image_fail(error, error_size, path, "cannot be written in full");
    }
    return image_publish(file->temporary, path, error, error_size);
}

/* ---- PFM ---- */

static int host_is_little_endian(void)
{
    const uint16_t one = 1;
    unsigned char first;

    memcpy(&first, &one, 1);
    return first == 1;
}

static void swap_bytes(float *values, size_t count)
{
    size_t i;

    for (i = 0; i < count; i++) {
        unsigned char in[4], out[4];
        memcpy(in, values + i, 4);
        out[0] = in[3];
        out[1] = in[2];
        out[2] = in[1];
        out[3] = in[0];
        memcpy(values + i, out, 4);
    }
}

/* One word and the single white-space byte behind it, which is all that may precede texels. */
static int read_word(FILE *stream, char *word, size_t size)
{
    size_t count = 0;
    int c = fgetc(stream);

    while (c != EOF && c != ' ' && c != '\n' && c != '\t' && c != '\r') {
        if (count + 1 >= size)
            return 0;
        word[count++] = (char)c;
        c = fgetc(stream);
    }
    word[count] = '\0';
    return count > 0 && c != EOF;
}

static int read_side(FILE *stream, long *side)
{
    char word[16], *end;

    if (!read_word(stream, word, sizeof word))
        return 0;
    *side = strtol(word, &end, 10);
    return *end == '\0';
}

static int read_scale(FILE *stream, float *scale)
{
    char word[32], *end;

    if (!read_word(stream, word, sizeof word))
        return 0;
    *scale = strtof(word, &end);
    return *end == '\0' && isfinite(*scale) && *scale != 0.0f;
}

/* From a grey in the last third of the row to three channels of it. */
static void spread_greys(float *values, size_t width)
{
    size_t i;

    for (i = 0; i < width; i++)
        values[3 * i] = values[3 * i + 1] = values[3 * i + 2] = values[2 * width + i];
}

/* The rows of a PFM run from the bottom of the picture to its top. */
static int read_rows(FILE *stream, image *map, float scale, int grey)
{
    const size_t width = (size_t)map->width, row_count = (grey ? 1 : 3) * width;
    const int swap = (scale < 0.0f) != host_is_little_endian();
    const float factor = fabsf(scale);
    size_t i;
    int row;

    for (row = map->height - 1; row >= 0; row--) {
        float *values = map->rgb + 3 * width * (size_t)row + (grey ? 2 * width : 0);
        if (fread(values, sizeof(float), row_count, stream) != row_count)
            return 0;
        if (swap)
            swap_bytes(values, row_count);
        if (factor != 1.0f)
            for (i = 0; i < row_count; i++)
                values[i] *= factor;
        if (grey)
            spread_greys(values - 2 * width, width);
    }
    return 1;
}

static int read_pfm_stream(FILE *stream, const char *path, image *out,
                           char *error, size_t error_size)
{
    char magic[4] = "";
    long width, height, left;
    long long need;
    float scale;
    int grey;

    if (!read_word(stream, magic, sizeof magic) ||
        (strcmp(magic, "PF") != 0 && strcmp(magic, "Pf") != 0))
        return image_fail(error, error_size, path, "is not a PFM file");
    grey = magic[1] == 'f';
    if (!read_side(stream, &width) || !read_side(stream, &height))
        return image_fail(error, error_size, path, "has no readable size in its PFM header");
    if (!read_scale(stream, &scale))
        return image_fail(error, error_size, path, "has no readable scale in its PFM header");
    if (!image_size_valid(width, height))
        return image_fail(error, error_size, path, "has a size of %ld x %ld texels, which is "
                          "outside what can be read", width, height);
    /* A wrong length is a truncated file, or texels that do not start where they should. */
    left = bytes_left(stream);
    need = (grey ? 4LL : 12LL) * width * height;
    if (left != need)
        return image_fail(error, error_size, path, "holds %ld bytes of texels where %ld x %ld "
                          "need %lld", left, width, height, need);
    if (!image_alloc(out, (int)width, (int)height))
        return image_fail(error, error_size, path, "does not fit in memory");
    if (read_rows(stream, out, scale, grey))
        return 1;
    image_free(out);
    return image_fail(error, error_size, path, "cannot be read in full");
}

int image_read_pfm(const char *path, image *out, char *error, size_t error_size)
{
    FILE *stream = image_open(path, error, error_size);
    int done;

    memset(out, 0, sizeof *out);
    if (!stream)
        return 0;
    done = read_pfm_stream(stream, path, out, error, error_size);
    fclose(stream);
    return done;
}

int image_write_pfm(const char *path, const image *map, char *error, size_t error_size)
{
    const size_t row_count = 3 * (size_t)map->width;
    output_file file;
    int row;

    if (!file_create(&file, path, error, error_size))
        return 0;
    fprintf(file.stream, "PF\n%d %d\n%s\n", map->width, map->height,
            host_is_little_endian() ? "-1.0" : "1.0");
    for (row = map->height - 1; row >= 0; row--)
        if (fwrite(map->rgb + row_count * (size_t)row, sizeof(float), row_count, file.stream) !=
            row_count)
            break;
    return file_close(&file, path, error, error_size);
}

/* ---- any format ---- */

static int read_exr_file(const char *path, image *out, char *error, size_t error_size)
{
#ifdef HAVE_OPENEXR
    return exr_read(path, out, error, error_size);
#else
    (void)out;
    return image_fail(error, error_size, path, "is an EXR file, and this build has no EXR "
                      "support (it was compiled without OpenEXR)");
#endif
}

/* Files of other kinds, and what makes one that is read of them. */
#define CONVERTS "which is not read; oiiotool IN -o OUT.hdr converts it"
#define DECODES  "which is not read, and seldom holds radiance; " \
                 "oiiotool IN --tocolorspace linear -o OUT.hdr converts it"
#define UNPACKS  "which has to be unpacked first"

static const struct { size_t at, length; const char *magic, *name, *advice; } other_kinds[] = {
    { 0, 4, "\x89PNG", "a PNG", DECODES }, { 0, 3, "\xff\xd8\xff", "a JPEG", DECODES },
    { 0, 4, "GIF8", "a GIF", DECODES }, { 0, 2, "BM", "a BMP", DECODES },
    { 8, 4, "WEBP", "a WebP", DECODES }, { 4, 8, "ftypavif", "an AVIF", DECODES },
    { 4, 7, "ftyphei", "a HEIF", DECODES }, { 4, 4, "JXL ", "a JPEG XL", DECODES },
    { 0, 2, "\xff\x0a", "a JPEG XL", DECODES }, { 4, 4, "jP  ", "a JPEG 2000", DECODES },
    { 0, 2, "P5", "a PGM", DECODES }, { 0, 2, "P6", "a PPM", DECODES },
    { 0, 4, "II*\0", "a TIFF", CONVERTS }, { 0, 4, "MM\0*", "a TIFF", CONVERTS },
    { 0, 3, "II+", "a TIFF", CONVERTS }, { 0, 3, "II\xbc", "a JPEG XR", CONVERTS },
    { 0, 4, "DDS ", "a DDS", CONVERTS }, { 1, 3, "KTX", "a KTX", CONVERTS },
    { 0, 4, "8BPS", "a Photoshop", CONVERTS }, { 0, 4, "SDPX", "a DPX", CONVERTS },
    { 0, 4, "PK\x03\x04", "a ZIP", UNPACKS }, { 0, 2, "\x1f\x8b", "a gzip", UNPACKS },
    { 0, 4, "7z\xbc\xaf", "a 7-Zip", UNPACKS }, { 0, 4, "Rar!", "a RAR", UNPACKS }
};

static int fail_kind(const unsigned char *start, size_t count, const char *path,
                     char *error, size_t error_size)
{
    size_t i;

    for (i = 0; i < sizeof other_kinds / sizeof other_kinds[0]; i++) {
        const size_t at = other_kinds[i].at, length = other_kinds[i].length;
        if (at + length <= count && memcmp(start + at, other_kinds[i].magic, length) == 0)
            return image_fail(error, error_size, path, "is %s file, %s", other_kinds[i].name,
                              other_kinds[i].advice);
    }
    return image_fail(error, error_size, path, "is neither an EXR, a Radiance HDR nor a PFM file");
}

int image_read(const char *path, image *out, char *error, size_t error_size)
{
    static const unsigned char exr_magic[4] = {0x76, 0x2f, 0x31, 0x01};
    unsigned char start[16] = {0};
    FILE *stream = image_open(path, error, error_size);
    size_t count;
    int reason;

    memset(out, 0, sizeof *out);
    if (!stream)
        return 0;
    errno = 0;
    count = fread(start, 1, sizeof start, stream);
    reason = ferror(stream) ? errno : 0;
    fclose(stream);
    if (reason)
        return image_fail(error, error_size, path, "cannot be read: %s", strerror(reason));
    if (count == 0)
        return image_fail(error, error_size, path, "is empty");
    if (memcmp(start, exr_magic, sizeof exr_magic) == 0)
        return read_exr_file(path, out, error, error_size);
    if (start[0] == '#' && start[1] == '?')
        return hdr_read(path, out, error, error_size);
    if (start[0] == 'P' && (start[1] == 'F' || start[1] == 'f'))
        return image_read_pfm(path, out, error, error_size);
    return fail_kind(start, count, path, error, error_size);
}

/* ---- tone mapping ---- */

static unsigned char encode_srgb(float linear)
{
    float encoded;

    if (!(linear > 0.0f))
        return 0;
    if (linear >= 1.0f)
        return 255;
    encoded = linear <= 0.0031308f ? 12.92f * linear
                                   : 1.055f * powf(linear, 1.0f / 2.4f) - 0.055f;
    return (unsigned char)(encoded * 255.0f + 0.5f);
}

void image_tonemap(const image *map, float exposure, unsigned char *rgb)
{
    const size_t count = 3 * (size_t)map->width * (size_t)map->height;
    size_t i;

    for (i = 0; i < count; i++)
        rgb[i] = encode_srgb(map->rgb[i] * exposure);
}

/* ---- bytes and bits ---- */

/* Grows as needed; once memory runs out it swallows everything and `failed` stays set. */
typedef struct byte_buffer {
    unsigned char *bytes;
    size_t count, capacity;
    uint32_t bits;
    int bit_count, failed;
} byte_buffer;

static void put_byte(byte_buffer *out, unsigned value)
{
    if (out->count == out->capacity && !out->failed) {
        size_t capacity = out->capacity ? 2 * out->capacity : 65536;
        unsigned char *bytes = (unsigned char *)realloc(out->bytes, capacity);
        if (bytes) {
            out->bytes = bytes;
            out->capacity = capacity;
        } else {
            out->failed = 1;
        }
    }
    if (!out->failed)
        out->bytes[out->count++] = (unsigned char)(value & 255u);
}

static void put_big_endian(byte_buffer *out, uint32_t value)
{
    put_byte(out, value >> 24);
    put_byte(out, value >> 16);
    put_byte(out, value >> 8);
    put_byte(out, value);
}

/* At most 16 bits, lowest first, as deflate packs everything but Huffman codes. */
static void put_bits(byte_buffer *out, uint32_t value, int count)
{
    out->bits |= value << out->bit_count;
    out->bit_count += count;
    while (out->bit_count >= 8) {
        put_byte(out, out->bits);
        out->bits >>= 8;
        out->bit_count -= 8;
    }
}

static void flush_bits(byte_buffer *out)
{
    if (out->bit_count > 0)
        put_byte(out, out->bits);
    out->bits = 0;
    out->bit_count = 0;
}

/* ---- Huffman codes ---- */

#define LITERAL_CODES 286
#define DISTANCE_CODES 30
#define LENGTH_CODES 19 /* symbols of the code that transmits the other codes' lengths */

typedef struct huffman {
    uint32_t counts[LITERAL_CODES];
    unsigned char lengths[LITERAL_CODES];
    uint16_t codes[LITERAL_CODES];
} huffman;

/* Index of the lightest node that has no parent yet and is not `except`, or -1. */
static int lightest(const uint32_t *weights, const int *parents, int count, int except)
{
    int i, best = -1;

    for (i = 0; i < count; i++)
        if (weights[i] > 0 && parents[i] < 0 && i != except &&
            (best < 0 || weights[i] < weights[best]))
            best = i;
    return best;
}

/* Code lengths of the Huffman tree over `weights`; returns the longest. */
static int tree_lengths(const uint32_t *weights, int symbols, unsigned char *lengths)
{
    uint32_t all[2 * LITERAL_CODES];
    int parents[2 * LITERAL_CODES], depths[2 * LITERAL_CODES];
    int i, count = symbols, deepest = 0;

    for (i = 0; i < 2 * symbols; i++)
        parents[i] = -1;
    memcpy(all, weights, (size_t)symbols * sizeof *weights);
    for (;;) {
        int a = lightest(all, parents, count, -1);
        int b = lightest(all, parents, count, a);
        if (b < 0)
            break;
        all[count] = all[a] + all[b];
        parents[a] = parents[b] = count++;
    }
    for (i = count - 1; i >= 0; i--)
        depths[i] = parents[i] < 0 ? 0 : depths[parents[i]] + 1;
    for (i = 0; i < symbols; i++) {
        /* A lone symbol is its own root, yet needs a bit. */
        lengths[i] = (unsigned char)(weights[i] > 0 && depths[i] == 0 ? 1 : depths[i]);
        deepest = lengths[i] > deepest ? lengths[i] : deepest;
    }
    return deepest;
}

/* Canonical codes, bit-reversed because put_bits writes the lowest bit first. */
static void assign_codes(huffman *code, int symbols)
{
    unsigned next = 0;
    int length, i, bit;

    for (length = 1; length <= 15; length++, next <<= 1)
        for (i = 0; i < symbols; i++) {
            unsigned reversed = 0;
            if (code->lengths[i] != length)
                continue;
            for (bit = 0; bit < length; bit++)
                reversed |= ((next >> bit) & 1u) << (length - 1 - bit);
            code->codes[i] = (uint16_t)reversed;
            next++;
        }
}

/* Flattens the counts until the tree is as shallow as the format allows. */
static void make_code(huffman *code, int symbols, int longest)
{
    uint32_t weights[LITERAL_CODES];
    int i;

    memcpy(weights, code->counts, sizeof weights);
    while (tree_lengths(weights, symbols, code->lengths) > longest)
        for (i = 0; i < symbols; i++)
            weights[i] = (weights[i] + 1) / 2;
    assign_codes(code, symbols);
}

static void put_symbol(byte_buffer *out, const huffman *code, int symbol)
{
    put_bits(out, code->codes[symbol], code->lengths[symbol]);
}

/* ---- deflate ---- */

#define WINDOW 32768
#define HASH_SIZE 32768
#define CHAIN_MAX 96
#define MATCH_MIN 3
#define MATCH_MAX 258
#define MATCH_NEAR 4096 /* from farther, three bytes cost less as literals */
#define MATCH_LAZY 32 /* matches this long are taken without a look at the next position */
#define BLOCK_TOKENS 32768
#define BLOCK_END 256

typedef struct deflater {
    byte_buffer *out;
    const unsigned char *data;
    int32_t size;
    int32_t head[HASH_SIZE];   /* latest position with this hash, or -1 */
    int32_t previous[WINDOW];  /* the position before it with the same hash */
    uint32_t tokens[BLOCK_TOKENS]; /* a literal, or length << 16 | (distance - 1) */
    int token_count;
    huffman literals, distances, lengths;
} deflater;

/* Lengths and distances share one scheme: 2^steps_log2 codes an octave, the rest as extra bits. */
typedef struct slot {
    int code, extra_bits;
    uint32_t extra;
} slot;

static slot find_slot(uint32_t value, int steps_log2)
{
    slot result = {(int)value, 0, 0};

    while ((value >> result.extra_bits) >= (2u << steps_log2))
        result.extra_bits++;
    result.code = (result.extra_bits << steps_log2) + (int)(value >> result.extra_bits);
    result.extra = value & ((1u << result.extra_bits) - 1u);
    return result;
}

static slot length_slot(uint32_t length)
{
    slot longest = {LITERAL_CODES - 1, 0, 0}, result;

    if (length == MATCH_MAX)
        return longest;
    result = find_slot(length - MATCH_MIN, 2);
    result.code += BLOCK_END + 1;
    return result;
}

static slot distance_slot(uint32_t token)
{
    return find_slot(token & 0xffffu, 1);
}

static uint32_t hash_at(const deflater *state, int32_t at)
{
    const unsigned char *p = state->data + at;

    return (((uint32_t)p[0] << 10) ^ ((uint32_t)p[1] << 5) ^ p[2]) & (HASH_SIZE - 1);
}

static void remember(deflater *state, int32_t at)
{
    uint32_t hash;

    if (at + MATCH_MIN > state->size)
        return;
    hash = hash_at(state, at);
    state->previous[at & (WINDOW - 1)] = state->head[hash];
    state->head[hash] = at;
}

static int32_t match_length(const deflater *state, int32_t a, int32_t b)
{
    int32_t length = 0, most = state->size - b;

    if (most > MATCH_MAX)
        most = MATCH_MAX;
    while (length < most && state->data[a + length] == state->data[b + length])
        length++;
    return length;
}

/* The longest match for the bytes at `at` as a token, or 0 where none is worth taking. */
static uint32_t find_match(const deflater *state, int32_t at)
{
    int32_t candidate, best_length = MATCH_MIN - 1, best_distance = 0;
    int steps;

    if (at + MATCH_MIN > state->size)
        return 0;
    candidate = state->head[hash_at(state, at)];
    for (steps = 0; steps < CHAIN_MAX && candidate >= 0 && at - candidate < WINDOW; steps++) {
        int32_t length = match_length(state, candidate, at);
        if (length > best_length) {
            best_length = length;
            best_distance = at - candidate;
        }
        if (best_length == MATCH_MAX)
            break;
        candidate = state->previous[candidate & (WINDOW - 1)];
    }
    if (best_distance == 0 || (best_length == MATCH_MIN && best_distance > MATCH_NEAR))
        return 0;
    return (uint32_t)best_length << 16 | (uint32_t)(best_distance - 1);
}

/* Runs of code lengths: 16 repeats the one before, 17 and 18 are short and long runs of zero. */
static void put_run(deflater *state, int symbol, int bits, int value, int counting)
{
    if (counting) {
        state->lengths.counts[symbol]++;
        return;
    }
    put_symbol(state->out, &state->lengths, symbol);
    put_bits(state->out, (uint32_t)value, bits);
}

static void put_lengths(deflater *state, const unsigned char *lengths, int count, int counting)
{
    int i = 0, run;

    while (i < count) {
        for (run = 1; i + run < count && lengths[i + run] == lengths[i] && run < 138; run++)
            ;
        if (lengths[i] == 0 && run >= 11) {
            put_run(state, 18, 7, run - 11, counting);
        } else if (lengths[i] == 0 && run >= 3) {
            put_run(state, 17, 3, run - 3, counting);
        } else {
            int repeats = run - 1 > 6 ? 6 : run - 1;
            put_run(state, lengths[i], 0, 0, counting);
            if (repeats >= 3)
                put_run(state, 16, 2, repeats - 3, counting);
            run = repeats >= 3 ? repeats + 1 : 1;
        }
        i += run;
    }
}

static void put_code_lengths(deflater *state)
{
    static const unsigned char order[LENGTH_CODES] = {16, 17, 18, 0, 8,  7, 9,  6, 10, 5,
                                                      11, 4,  12, 3, 13, 2, 14, 1, 15};
    int counting, i;

    put_bits(state->out, LITERAL_CODES - 257, 5);
    put_bits(state->out, DISTANCE_CODES - 1, 5);
    put_bits(state->out, LENGTH_CODES - 4, 4);
    memset(&state->lengths, 0, sizeof state->lengths);
    for (counting = 1; counting >= 0; counting--) {
        if (!counting) {
            make_code(&state->lengths, LENGTH_CODES, 7);
            for (i = 0; i < LENGTH_CODES; i++)
                put_bits(state->out, state->lengths.lengths[order[i]], 3);
        }
        put_lengths(state, state->literals.lengths, LITERAL_CODES, counting);
        put_lengths(state, state->distances.lengths, DISTANCE_CODES, counting);
    }
}

static void count_tokens(deflater *state)
{
    int i;

    memset(&state->literals, 0, sizeof state->literals);
    memset(&state->distances, 0, sizeof state->distances);
    for (i = 0; i < state->token_count; i++) {
        uint32_t token = state->tokens[i];
        if (token < 256) {
            state->literals.counts[token]++;
        } else {
            state->literals.counts[length_slot(token >> 16).code]++;
            state->distances.counts[distance_slot(token).code]++;
        }
    }
    state->literals.counts[BLOCK_END] = 1;
}

static void put_token(deflater *state, uint32_t token)
{
    slot length, distance;

    if (token < 256) {
        put_symbol(state->out, &state->literals, (int)token);
        return;
    }
    length = length_slot(token >> 16);
    distance = distance_slot(token);
    put_symbol(state->out, &state->literals, length.code);
    put_bits(state->out, length.extra, length.extra_bits);
    put_symbol(state->out, &state->distances, distance.code);
    put_bits(state->out, distance.extra, distance.extra_bits);
}

/* One block with codes of its own over the tokens so far. */
static void put_block(deflater *state, int last)
{
    int i;

    count_tokens(state);
    make_code(&state->literals, LITERAL_CODES, 15);
    make_code(&state->distances, DISTANCE_CODES, 15);
    put_bits(state->out, last ? 1 : 0, 1);
    put_bits(state->out, 2, 2);
    put_code_lengths(state);
    for (i = 0; i < state->token_count; i++)
        put_token(state, state->tokens[i]);
    put_symbol(state->out, &state->literals, BLOCK_END);
    state->token_count = 0;
}

static void deflate_all(deflater *state)
{
    int32_t at = 0, step;

    memset(state->head, 0xff, sizeof state->head);
    while (at < state->size) {
        uint32_t match = find_match(state, at);
        remember(state, at);
        /* A longer match one byte on is worth a literal here. */
        if (match >> 16 < MATCH_LAZY && (find_match(state, at + 1) >> 16) > (match >> 16))
            match = 0;
        state->tokens[state->token_count++] = match ? match : state->data[at];
        step = match ? (int32_t)(match >> 16) : 1;
        for (at++; step > 1; step--, at++)
            remember(state, at);
        if (state->token_count == BLOCK_TOKENS)
            put_block(state, 0);
    }
    put_block(state, 1);
    flush_bits(state->out);
}

static uint32_t adler32(const unsigned char *data, size_t count)
{
    uint32_t a = 1, b = 0;
    size_t i;

    for (i = 0; i < count; i++) {
        a = (a + data[i]) % 65521u;
        b = (b + a) % 65521u;
    }
    return b << 16 | a;
}

static void put_zlib(byte_buffer *out, const unsigned char *data, size_t count)
{
    deflater *state = (deflater *)calloc(1, sizeof *state);

    if (!state) {
        out->failed = 1;
        return;
    }
    state->out = out;
    state->data = data;
    state->size = (int32_t)count;
    put_byte(out, 0x78);
    put_byte(out, 0x9c);
    deflate_all(state);
    put_big_endian(out, adler32(data, count));
    free(state);
}

/* ---- PNG ---- */

#define PNG_FILTERS 5

static int paeth(int left, int up, int corner)
{
    int base = left + up - corner;
    int to_left = abs(base - left), to_up = abs(base - up), to_corner = abs(base - corner);

    if (to_left <= to_up && to_left <= to_corner)
        return left;
    return to_up <= to_corner ? up : corner;
}

static int predict(int filter, int left, int up, int corner)
{
    switch (filter) {
    case 1: return left;
    case 2: return up;
    case 3: return (left + up) / 2;
    case 4: return paeth(left, up, corner);
    default: return 0;
    }
}

/* Writes the filter's number and the filtered row; returns the sum of sizes of the residuals,
 * which is a good guess at how well the row will compress. */
static long filter_row(int filter, const unsigned char *row, const unsigned char *above,
                       size_t count, unsigned char *out)
{
    long cost = 0;
    size_t i;

    *out++ = (unsigned char)filter;
    for (i = 0; i < count; i++) {
        int left = i >= 3 ? row[i - 3] : 0;
        int up = above ? above[i] : 0;
        int corner = above && i >= 3 ? above[i - 3] : 0;
        int residual = (row[i] - predict(filter, left, up, corner)) & 255;
        out[i] = (unsigned char)residual;
        cost += residual < 128 ? residual : 256 - residual;
    }
    return cost;
}

/* All rows under their best filter; the caller frees the result. NULL without memory. */
static unsigned char *filter_rows(int width, int height, const unsigned char *rgb)
{
    const size_t stride = 3 * (size_t)width;
    unsigned char *out = (unsigned char *)malloc((stride + 1) * (size_t)height);
    int row, filter;

    for (row = 0; out && row < height; row++) {
        const unsigned char *from = rgb + stride * (size_t)row;
        const unsigned char *above = row > 0 ? from - stride : NULL;
        unsigned char *to = out + (stride + 1) * (size_t)row;
        long cost, best_cost = -1;
        int best = 0;
        for (filter = 0; filter < PNG_FILTERS; filter++) {
            cost = filter_row(filter, from, above, stride, to);
            if (best_cost < 0 || cost < best_cost) {
                best_cost = cost;
                best = filter;
            }
        }
        filter_row(best, from, above, stride, to);
    }
    return out;
}

static uint32_t crc32(const unsigned char *data, size_t count)
{
    uint32_t crc = 0xffffffffu;
    size_t i;
    int bit;

    for (i = 0; i < count; i++) {
        crc ^= data[i];
        for (bit = 0; bit < 8; bit++)
            crc = (crc >> 1) ^ (0xedb88320u & (0u - (crc & 1u)));
    }
    return crc ^ 0xffffffffu;
}

/* Returns where the chunk starts, for end_chunk to fill in its length. */
static size_t begin_chunk(byte_buffer *out, const char *type)
{
    size_t start = out->count, i;

    put_big_endian(out, 0);
    for (i = 0; i < 4; i++)
        put_byte(out, (unsigned char)type[i]);
    return start;
}

static void end_chunk(byte_buffer *out, size_t start)
{
    size_t length, i;

    if (out->failed)
        return;
    length = out->count - start - 8;
    for (i = 0; i < 4; i++)
        out->bytes[start + i] = (unsigned char)(length >> (24 - 8 * i));
    put_big_endian(out, crc32(out->bytes + start + 4, length + 4));
}

static void put_png(byte_buffer *out, int width, int height, const unsigned char *filtered)
{
    static const unsigned char signature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
    static const unsigned char format[5] = {8, 2, 0, 0, 0}; /* 8 bits, RGB, not interlaced */
    size_t start, i;

    for (i = 0; i < sizeof signature; i++)
        put_byte(out, signature[i]);
    start = begin_chunk(out, "IHDR");
    put_big_endian(out, (uint32_t)width);
    put_big_endian(out, (uint32_t)height);
    for (i = 0; i < sizeof format; i++)
        put_byte(out, format[i]);
    end_chunk(out, start);
    start = begin_chunk(out, "sRGB");
    put_byte(out, 0);
    end_chunk(out, start);
    start = begin_chunk(out, "IDAT");
    put_zlib(out, filtered, (3 * (size_t)width + 1) * (size_t)height);
    end_chunk(out, start);
    end_chunk(out, begin_chunk(out, "IEND"));
}

int image_write_png(const char *path, int width, int height, const unsigned char *rgb,
                    char *error, size_t error_size)
{
    byte_buffer png = {NULL, 0, 0, 0, 0, 0};
    unsigned char *filtered;
    output_file file;
    int done = 0;

    if (!image_size_valid(width, height))
        return image_fail(error, error_size, path, "%d x %d is no size for a picture",
                          width, height);
    filtered = filter_rows(width, height, rgb);
    if (filtered)
        put_png(&png, width, height, filtered);
    if (!filtered || png.failed) {
        image_fail(error, error_size, path, "not enough memory to compress the picture");
    } else if (file_create(&file, path, error, error_size)) {
        fwrite(png.bytes, 1, png.count, file.stream);
        done = file_close(&file, path, error, error_size);
    }
    free(filtered);
    free(png.bytes);
    return done;
}

/* ---- load.h ---- */

float *load_map(const char *path, int *width, int *height)
{
    char error[512];
    image map;

    if (!image_read(path, &map, error, sizeof error)) {
        fprintf(stderr, "%s\n", error);
        return NULL;
    }
    *width = map.width;
    *height = map.height;
    return map.rgb;
}
