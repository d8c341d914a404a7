/* image.c: memory, PFM and PNG for image.h; PNG through a small deflate encoder of its own. */
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

/* A folder, or something that one may wait for forever; it is checked before it is opened,
   and before a file would take its place. */
static const char *no_file(const char *path)
{
    struct stat status;

    if (stat(path, &status) != 0 || S_ISREG(status.st_mode))
        return NULL;
    return S_ISDIR(status.st_mode) ? "it is a folder" : "it is a pipe or a device, not a file";
}

int image_temporary_path(const char *path, char temporary[IMAGE_PATH_MAX],
                         char *error, size_t error_size)
{
    static const char suffix[] = ".part";
    const char *reason = no_file(path);

    if (reason)
        return image_fail(error, error_size, path, "cannot be written: %s", reason);
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

/* ---- deflate: LZ77 with the fixed code ---- */

#define WINDOW 32768
#define MATCH_MAX 258
#define CHAIN_MAX 32                     /* places looked at for a match */
#define LAZY_MAX 32                      /* longer matches are taken without a look ahead */

typedef struct deflater {
    const unsigned char *data;
    unsigned char *out;                  /* with room for 9 bits of each byte of data */
    size_t size, out_count;
    uint32_t bits;
    int bit_count;
    int32_t head[WINDOW];                /* latest place with this hash, or -1 */
    int32_t previous[WINDOW];            /* the place before it with the same hash */
} deflater;

/* Lowest bit first. */
static void put_bits(deflater *state, uint32_t value, int count)
{
    state->bits |= value << state->bit_count;
    for (state->bit_count += count; state->bit_count >= 8; state->bit_count -= 8) {
        state->out[state->out_count++] = (unsigned char)(state->bits & 255u);
        state->bits >>= 8;
    }
}

/* Highest bit first, as codes are. */
static void put_code(deflater *state, int code, int count)
{
    while (count-- > 0)
        put_bits(state, (uint32_t)code >> count & 1u, 1);
}

/* A literal, the end of the block, 256, or a length. */
static void put_symbol(deflater *state, int symbol)
{
    if (symbol < 144)
        put_code(state, symbol + 0x30, 8);
    else if (symbol < 256)
        put_code(state, symbol - 144 + 0x190, 9);
    else if (symbol < 280)
        put_code(state, symbol - 256, 7);
    else
        put_code(state, symbol - 280 + 0xc0, 8);
}

/* The code of a length or a distance, and its extra bits: 2^steps_log2 codes an octave. */
static int find_slot(uint32_t value, int steps_log2, int *extra_bits)
{
    *extra_bits = 0;
    while ((value >> *extra_bits) >= (2u << steps_log2))
        ++*extra_bits;
    return (*extra_bits << steps_log2) + (int)(value >> *extra_bits);
}

static void put_match(deflater *state, uint32_t length, uint32_t distance)
{
    int bits, symbol = 257 + find_slot(length - 3, 2, &bits);

    if (length == MATCH_MAX) {
        symbol = 285;
        bits = 0;
    }
    put_symbol(state, symbol);
    put_bits(state, (length - 3) & ((1u << bits) - 1u), bits);
    put_code(state, find_slot(distance - 1, 1, &bits), 5);
    put_bits(state, (distance - 1) & ((1u << bits) - 1u), bits);
}

static int32_t *bucket(deflater *state, size_t at)
{
    const unsigned char *p = state->data + at;

    return &state->head[((uint32_t)p[0] << 10 ^ (uint32_t)p[1] << 5 ^ p[2]) % WINDOW];
}

static void remember(deflater *state, size_t at)
{
    if (at + 3 > state->size)
        return;
    state->previous[at % WINDOW] = *bucket(state, at);
    *bucket(state, at) = (int32_t)at;
}

/* The length of the longest match for what is at `at`, or 0. */
static uint32_t find_match(deflater *state, size_t at, uint32_t *distance)
{
    const size_t left = state->size - at;
    const uint32_t most = left < MATCH_MAX ? (uint32_t)left : MATCH_MAX;
    uint32_t length, best = 2;
    int32_t from = most > 2 ? *bucket(state, at) : -1;
    int steps;

    for (steps = 0; steps < CHAIN_MAX && from >= 0 && at - (size_t)from < WINDOW && best < most;
         steps++, from = state->previous[from % WINDOW]) {
        const unsigned char *old = state->data + from;

        for (length = 0; length < most && old[length] == old[at - (size_t)from + length];)
            length++;
        if (length > best) {
            best = length;
            *distance = (uint32_t)(at - (size_t)from);
        }
    }
    return best > 2 ? best : 0;
}

static void deflate_all(deflater *state)
{
    uint32_t length, distance = 0, unused;
    size_t at = 0;

    memset(state->head, 0xff, sizeof state->head);
    put_bits(state, 1u | 1u << 1, 3);    /* the last block, of the fixed code */
    while (at < state->size) {
        length = find_match(state, at, &distance);
        remember(state, at);
        /* A longer match one byte on is worth a literal here. */
        if (length == 0 || (length < LAZY_MAX && find_match(state, at + 1, &unused) > length)) {
            put_symbol(state, state->data[at++]);
            continue;
        }
        put_match(state, length, distance);
        for (at++; length > 1; length--, at++)
            remember(state, at);
    }
    put_symbol(state, 256);
    put_bits(state, 0, 7);               /* up to the next byte */
}

static void set_big_endian(unsigned char *bytes, uint32_t value)
{
    int i;

    for (i = 0; i < 4; i++)
        bytes[i] = (unsigned char)(value >> (24 - 8 * i) & 255u);
}

/* A zlib stream, to be freed; NULL without memory. */
static unsigned char *compress_bytes(const unsigned char *data, size_t count, size_t *out_count)
{
    deflater *state = (deflater *)calloc(1, sizeof *state);
    unsigned char *out = (unsigned char *)malloc(count + count / 8 + 64);
    uint32_t a = 1, b = 0;
    size_t i;

    if (state && out) {
        out[0] = 0x78;
        out[1] = 0x9c;
        state->out = out;
        state->out_count = 2;
        state->data = data;
        state->size = count;
        deflate_all(state);
        for (i = 0; i < count; i++) { /* Adler-32 */
            a = (a + data[i]) % 65521u;
            b = (b + a) % 65521u;
        }
        set_big_endian(out + state->out_count, b << 16 | a);
        *out_count = state->out_count + 4;
    } else {
        free(out);
        out = NULL;
    }
    free(state);
    return out;
}

/* ---- PNG ---- */

/* All rows under filter 1, which leaves the difference to the pixel on the left; to be freed, and
   NULL without memory. A choice among all five filters makes files no smaller with this deflate. */
static unsigned char *filter_rows(int width, int height, const unsigned char *rgb)
{
    const size_t stride = 3 * (size_t)width;
    unsigned char *out = (unsigned char *)malloc((stride + 1) * (size_t)height), *to = out;
    size_t y, x;

    for (y = 0; out && y < (size_t)height; y++, rgb += stride)
        for (*to++ = 1, x = 0; x < stride; x++)
            *to++ = (unsigned char)((rgb[x] - (x < 3 ? 0 : rgb[x - 3])) & 255);
    return out;
}

static uint32_t crc32(uint32_t crc, const unsigned char *data, size_t count)
{
    size_t i;
    int bit;

    for (i = 0; i < count; i++)
        for (crc ^= data[i], bit = 0; bit < 8; bit++)
            crc = (crc >> 1) ^ (0xedb88320u & (0u - (crc & 1u)));
    return crc;
}

static void write_chunk(FILE *stream, const char *type, const unsigned char *data, size_t count)
{
    unsigned char head[8], tail[4];

    set_big_endian(head, (uint32_t)count);
    memcpy(head + 4, type, 4);
    set_big_endian(tail, ~crc32(crc32(~(uint32_t)0, head + 4, 4), data, count));
    fwrite(head, 1, sizeof head, stream);
    fwrite(data, 1, count, stream);
    fwrite(tail, 1, sizeof tail, stream);
}

int image_write_png(const char *path, int width, int height, const unsigned char *rgb,
                    char *error, size_t error_size)
{
    static const unsigned char signature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
    unsigned char format[13] = {0, 0, 0, 0, 0, 0, 0, 0, 8, 2, 0, 0, 0}; /* 8 bits, RGB */
    unsigned char *filtered, *data = NULL;
    output_file file;
    size_t count;
    int done = 0;

    if (!image_size_valid(width, height))
        return image_fail(error, error_size, path, "%d x %d is no size for a picture",
                          width, height);
    filtered = filter_rows(width, height, rgb);
    if (filtered)
        data = compress_bytes(filtered, (3 * (size_t)width + 1) * (size_t)height, &count);
    if (!data) {
        image_fail(error, error_size, path, "not enough memory to compress the picture");
    } else if (file_create(&file, path, error, error_size)) {
        fwrite(signature, 1, sizeof signature, file.stream);
        set_big_endian(format, (uint32_t)width);
        set_big_endian(format + 4, (uint32_t)height);
        write_chunk(file.stream, "IHDR", format, sizeof format);
        write_chunk(file.stream, "sRGB", (const unsigned char *)"", 1);
        write_chunk(file.stream, "IDAT", data, count);
        write_chunk(file.stream, "IEND", data, 0);
        done = file_close(&file, path, error, error_size);
    }
    free(filtered);
    free(data);
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
