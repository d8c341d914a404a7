/* test_hdr.c: Radiance files, made here in all orientations and kinds of runs, read back texel by
 * texel; files of other kinds and damaged ones, which must fail in one line.
 *
 *     test_hdr [PREFIX]            scratch files are PREFIX.*, by default build/test_hdr.*
 *     test_hdr fuzz SECONDS SEED   damaged files only, for so long; no TAP
 */
#define _POSIX_C_SOURCE 200809L
#include "check.h"

#include "../examples/common/hdr.h"
#include "../examples/common/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#ifndef _WIN32
#include <sys/stat.h>
#include <unistd.h>
#endif

#define DAMAGED_FILES 8000

static const char *prefix = "build/test_hdr";
static char scratch_path[512], error_line[512];

static const char *scratch(const char *suffix)
{
    snprintf(scratch_path, sizeof scratch_path, "%s.%s", prefix, suffix);
    return scratch_path;
}

/* ---- files in memory ---- */

typedef struct file_bytes { unsigned char *bytes; size_t count, room; } file_bytes;

static void put(file_bytes *f, const void *bytes, size_t count)
{
    if (f->count + count > f->room) {
        f->room = 2 * (f->count + count);
        f->bytes = (unsigned char *)realloc(f->bytes, f->room);
        if (!f->bytes) {
            printf("Bail out! no memory\n");
            exit(1);
        }
    }
    memcpy(f->bytes + f->count, bytes, count);
    f->count += count;
}

static void put_text(file_bytes *f, const char *text)
{
    put(f, text, strlen(text));
}

static void put_byte(file_bytes *f, int byte)
{
    const unsigned char value = (unsigned char)byte;

    put(f, &value, 1);
}

static void file_free(file_bytes *f)
{
    free(f->bytes);
    memset(f, 0, sizeof *f);
}

/* The four bytes of a texel: in some rows with stretches of equal texels, in others all differ. */
static void texel_bytes(int x, int y, unsigned char rgbe[4])
{
    const uint32_t draw = hash_combine((uint32_t)(y % 3 ? x : x / 300), (uint32_t)y);
    int c;

    for (c = 0; c < 4; c++)
        rgbe[c] = (unsigned char)(draw >> 8 * c);
    rgbe[0] |= 4;                   /* neither 1 1 1 of an old run nor 2 2 of new ones */
    if (draw % 11 == 0)
        rgbe[3] = (unsigned char)(draw % 3);    /* 0: black; 1, 2: the least radiance */
}

static float texel_value(int x, int y, int c)
{
    unsigned char rgbe[4];

    texel_bytes(x, y, rgbe);
    return rgbe[3] ? ldexpf((float)rgbe[c], rgbe[3] - 136) : 0.0f;
}

enum runs { FLAT, OLD, NEW, RUNS };

/* How many texels, or bytes of them `stride` apart, are the same from here. */
static int run_length(const unsigned char *at, size_t stride, size_t size, int most)
{
    int n = 1;

    while (n < most && memcmp(at, at + stride * (size_t)n, size) == 0)
        n++;
    return n;
}

static void put_old_runs(file_bytes *f, const unsigned char *row, int length)
{
    int i, n;

    for (i = 0; i < length; i += n) {
        int repeats;
        n = run_length(row + 4 * i, 4, 4, length - i);
        put(f, row + 4 * i, 4);
        for (repeats = n - 1; repeats > 0; repeats >>= 8) {
            put_text(f, "\1\1\1");
            put_byte(f, repeats & 255);
        }
    }
}

static void put_new_runs(file_bytes *f, const unsigned char *row, int length)
{
    const unsigned char head[4] = { 2, 2, (unsigned char)(length >> 8), (unsigned char)length };
    int c, i, n, j;

    put(f, head, 4);
    for (c = 0; c < 4; c++)
        for (i = 0; i < length; i += n) {
            const unsigned char *at = row + 4 * i + c;
            n = run_length(at, 4, 1, length - i < 127 ? length - i : 127);
            if (n > 2) {
                put_byte(f, 128 + n);
                put_byte(f, *at);
                continue;
            }
            for (n = 1; n < 128 && n < length - i &&
                        run_length(at + 4 * n, 4, 1, length - i - n < 3 ? length - i - n : 3) < 3; )
                n++;
            put_byte(f, n);
            for (j = 0; j < n; j++)
                put_byte(f, at[4 * j]);
        }
}

static const char *const orientations[8] = {
    "-Y %d +X %d\n", "+Y %d +X %d\n", "-Y %d -X %d\n", "+Y %d -X %d\n",
    "+X %d -Y %d\n", "+X %d +Y %d\n", "-X %d -Y %d\n", "-X %d +Y %d\n"
};

/* Where texel i of scanline s lies in the picture, by the words of the resolution line. */
static void place(const char *orientation, int width, int height, int s, int i, int *x, int *y)
{
    const int along_x = orientation[7] == 'X' ? i : s, along_y = orientation[7] == 'X' ? s : i;

    *x = strstr(orientation, "+X") ? along_x : width - 1 - along_x;
    *y = strstr(orientation, "-Y") ? along_y : height - 1 - along_y;
}

static file_bytes make_file(const char *header, int width, int height, const char *orientation,
                            enum runs kind)
{
    const int columns = orientation[1] == 'X';
    const int scanlines = columns ? width : height, length = columns ? height : width;
    unsigned char *row = (unsigned char *)malloc(4 * (size_t)length);
    file_bytes f = { NULL, 0, 0 };
    char text[64];
    int s, i, x, y;

    put_text(&f, header);
    snprintf(text, sizeof text, orientation, scanlines, length);
    put_text(&f, text);
    for (s = 0; row && s < scanlines; s++) {
        for (i = 0; i < length; i++) {
            place(orientation, width, height, s, i, &x, &y);
            texel_bytes(x, y, row + 4 * i);
        }
        if (kind == OLD)
            put_old_runs(&f, row, length);
        else if (kind == NEW)
            put_new_runs(&f, row, length);
        else
            put(&f, row, 4 * (size_t)length);
    }
    free(row);
    return f;
}

#define HEADER "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n"

static void write_file(const char *path, const void *bytes, size_t count)
{
    FILE *stream = fopen(path, "wb");

    if (!stream || fwrite(bytes, 1, count, stream) != count || fclose(stream) != 0) {
        printf("Bail out! cannot write %s\n", path);
        exit(1);
    }
}

/* ---- good files ---- */

/* Texels that differ from those of the file, each divided by the factor of its channel. */
static int count_wrong(const image *map, int width, int height, const float factor[3])
{
    int x, y, c, wrong = map->width != width || map->height != height;

    for (y = 0; y < height && !wrong; y++)
        for (x = 0; x < width; x++)
            for (c = 0; c < 3; c++)
                wrong += map->rgb[3 * (y * width + x) + c] != texel_value(x, y, c) * factor[c];
    return wrong;
}

static void check_file(const char *title, file_bytes f, int width, int height,
                       const float factor[3])
{
    static const float one[3] = { 1.0f, 1.0f, 1.0f };
    const char *path = scratch("hdr");
    image map;
    int done, wrong;

    error_line[0] = '\0';
    write_file(path, f.bytes, f.count);
    done = image_read(path, &map, error_line, sizeof error_line);
    wrong = done ? count_wrong(&map, width, height, factor ? factor : one) : -1;
    CHECK(done && IS(wrong, 0), "%s, %d x %d, %lu bytes%s", title, width, height,
          (unsigned long)f.count, error_line);
    image_free(&map);
    file_free(&f);
    remove(path);
}

static void test_orientations(void)
{
    static const char *const kinds[RUNS] = { "flat", "old runs", "new runs" };
    char title[80];
    int o, kind;

    for (kind = 0; kind < RUNS; kind++)
        for (o = 0; o < 8; o++) {
            snprintf(title, sizeof title, "%s, %.2s, %.2s", kinds[kind], orientations[o],
                     orientations[o] + 6);
            check_file(title, make_file(HEADER, 24, 12, orientations[o], (enum runs)kind), 24, 12,
                       NULL);
        }
    for (kind = 0; kind < RUNS; kind++) {
        const enum runs of = (enum runs)kind;
        check_file(kinds[kind], make_file(HEADER, 1400, 7, orientations[0], of), 1400, 7, NULL);
        check_file(kinds[kind], make_file(HEADER, 8, 4, orientations[2], of), 8, 4, NULL);
        check_file(kinds[kind], make_file(HEADER, 32767, 3, orientations[0], of), 32767, 3, NULL);
    }
    for (kind = 0; kind < NEW; kind++) {
        const enum runs of = (enum runs)kind;
        check_file(kinds[kind], make_file(HEADER, 1, 1, orientations[0], of), 1, 1, NULL);
        check_file(kinds[kind], make_file(HEADER, 7, 3, orientations[1], of), 7, 3, NULL);
        check_file(kinds[kind], make_file(HEADER, 32768, 2, orientations[0], of), 32768, 2, NULL);
    }
}

static void test_headers(void)
{
    static const float exposed[3] = { 0.125f, 0.125f, 0.125f };
    static const float corrected[3] = { 0.25f, 0.5f, 2.0f };
    char header[2000] = "#?RGBE\nEXPOSURE=4\nVIEW= -vta\n\tEXPOSURE=7\nEXPOSURE= 2.0\n\n";
    size_t used;

    check_file("EXPOSURE, twice; what a tab begins is of another picture",
               make_file(header, 16, 8, orientations[0], NEW), 16, 8, exposed);
    strcpy(header, "#?RADIANCE\nCOLORCORR= 2 1 .25\nEXPOSURE=2\nFORMAT=32-bit_rle_rgbe\n\n");
    check_file("COLORCORR", make_file(header, 16, 8, orientations[3], FLAT), 16, 8, corrected);
    strcpy(header, "#?\n\n");
    check_file("the shortest header", make_file(header, 16, 8, orientations[0], OLD), 16, 8, NULL);
    strcpy(header, "#?RADIANCE\noconv");
    for (used = strlen(header); used < 1900; used += 3)
        strcpy(header + used, " a ");
    strcpy(header + used, "\n# made by hand\n\n");
    check_file("a long line", make_file(header, 16, 8, orientations[0], NEW), 16, 8, NULL);
}

/* Runs that are right, but that the encoder above does not make. */
static void test_rare_runs(void)
{
    static const unsigned char row[8] = { 9, 9, 9, 130, 2, 2, 5, 128 };
    const float six[3] = { 9.0f / 64.0f, 9.0f / 64.0f, 9.0f / 64.0f };
    file_bytes f = { NULL, 0, 0 };
    image map;
    int done, i, same = 1;

    put_text(&f, HEADER "-Y 1 +X 8\n");
    put(&f, row, 4);
    put_text(&f, "\1\1\1");
    put_byte(&f, 0);                    /* no repetition, but the next one counts in 256 */
    put(&f, row, 4);
    put_text(&f, "\1\1\1\3\1\1\1");
    put_byte(&f, 0);
    put(&f, row, 4);
    put_text(&f, "\1\1\1\2");
    done = hdr_decode(f.bytes, f.count, "-", &map, error_line, sizeof error_line);
    for (i = 0; done && i < 24; i++)
        same &= map.rgb[i] == six[i % 3];
    CHECK(done && same, "old runs of no length");
    image_free(&map);
    file_free(&f);
    /* 2 2 at the start, but no count below 128 behind: flat, as any row below 8 texels. */
    put_text(&f, HEADER "-Y 1 +X 1\n");
    put(&f, row + 4, 4);
    put_text(&f, "and more");
    done = hdr_decode(f.bytes, f.count, "-", &map, error_line, sizeof error_line);
    CHECK(done && IS(map.rgb[0], 2.0f / 256.0f) && IS(map.rgb[2], 5.0f / 256.0f),
          "a flat texel that looks like new runs; bytes behind the last row");
    image_free(&map);
    file_free(&f);
}

/* ---- bad files ---- */

static int says(const char *path, const char *reason)
{
    return strncmp(error_line, path, strlen(path)) == 0 && strstr(error_line, reason) &&
           !strchr(error_line, '\n') && !strchr(error_line, '\r');
}

static void check_bad(const char *title, const void *bytes, size_t count, const char *reason)
{
    const char *path = scratch("bad");
    image map = { 1, 1, NULL };
    int done;

    write_file(path, bytes, count);
    error_line[0] = '\0';
    done = image_read(path, &map, error_line, sizeof error_line);
    CHECK(!done && !map.rgb && map.width == 0 && says(path, reason), "%s: %s", title, error_line);
    image_free(&map);
    remove(path);
}

static void check_bad_text(const char *title, const char *text, const char *reason)
{
    check_bad(title, text, strlen(text), reason);
}

static void test_bad_headers(void)
{
    check_bad_text("nothing but #?", "#?", "ends within its header");
    check_bad_text("no end of the header", "#?RADIANCE\nEXPOSURE=1\n", "ends within its header");
    check_bad_text("no resolution", HEADER, "ends within its header");
    check_bad_text("CR LF", "#?RADIANCE\r\nFORMAT=32-bit_rle_rgbe\r\n\r\n-Y 1 +X 1\r\nabcd",
                   "carriage return");
    check_bad_text("CR LF in the resolution", HEADER "-Y 1 +X 1\r\nabcd", "carriage return");
    check_bad_text("XYZE", "#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\nabcd", "ra_xyze -r");
    check_bad_text("another format", "#?RADIANCE\nFORMAT=ascii\n\n-Y 1 +X 1\nabcd", "'ascii'");
    check_bad_text("EXPOSURE 0", "#?R\nEXPOSURE=0\n\n-Y 1 +X 1\nabcd", "EXPOSURE");
    check_bad_text("EXPOSURE -1", "#?R\nEXPOSURE=-1\n\n-Y 1 +X 1\nabcd", "EXPOSURE");
    check_bad_text("EXPOSURE nan", "#?R\nEXPOSURE=nan\n\n-Y 1 +X 1\nabcd", "EXPOSURE");
    check_bad_text("EXPOSURE inf", "#?R\nEXPOSURE=inf\n\n-Y 1 +X 1\nabcd", "EXPOSURE");
    check_bad_text("EXPOSURE of words", "#?R\nEXPOSURE=high\n\n-Y 1 +X 1\nabcd", "EXPOSURE");
    check_bad_text("EXPOSURES too large", "#?R\nEXPOSURE=1e30\nEXPOSURE=1e30\n\n-Y 1 +X 1\nabcd",
                   "beyond");
    check_bad_text("EXPOSURES too small",
                   "#?R\nEXPOSURE=1e-300\nEXPOSURE=1e-300\n\n-Y 1 +X 1\nabcd", "beyond");
    check_bad_text("COLORCORR of two", "#?R\nCOLORCORR=1 2\n\n-Y 1 +X 1\nabcd", "COLORCORR");
    check_bad_text("a resolution of words", HEADER "-Y one +X one\nabcd", "'-Y one +X one'");
    check_bad_text("both along Y", HEADER "-Y 1 +Y 1\nabcd", "no resolution line");
    check_bad_text("no sign", HEADER "Y 1 X 1\nabcd", "no resolution line");
    check_bad_text("more behind", HEADER "-Y 1 +X 1 +Z 1\nabcd", "no resolution line");
    check_bad_text("only one side", HEADER "-Y 1\nabcd", "no resolution line");
    check_bad_text("no rows", HEADER "-Y 0 +X 1\nabcd", "1 x 0 texels");
    check_bad_text("a negative side", HEADER "-Y 1 +X -1\nabcd", "no resolution line");
    check_bad_text("a huge side", HEADER "-Y 1 +X 99999999999999999999\nabcd", "outside");
    check_bad_text("huge sides", HEADER "-Y 65536 +X 65536\nabcd", "outside");
    check_bad_text("a large map without texels", HEADER "-Y 16384 +X 16384\nabcd",
                   "ends after 4 bytes");
    CHECK(!hdr_decode((const unsigned char *)"P?\n\n", 4, "-", &(image){ 0, 0, NULL }, error_line,
                      sizeof error_line) && says("-", "does not begin with #?"), "%s", error_line);
}

static void test_bad_scanlines(void)
{
    file_bytes f = make_file(HEADER, 24, 12, orientations[0], NEW);

    check_bad("a byte short", f.bytes, f.count - 1, "ends within scanline 12 of 12");
    check_bad("half of it", f.bytes, f.count / 2, "ends within scanline");
    f.bytes[strlen(HEADER "-Y 12 +X 24\n") + 3]++;
    check_bad("a row of another length", f.bytes, f.count, "damaged in scanline 1 of 12");
    file_free(&f);
    f = make_file(HEADER, 24, 12, orientations[0], FLAT);
    check_bad("flat, a byte short", f.bytes, f.count - 1, "ends within scanline 12 of 12");
    file_free(&f);
#define ROW "\2\2\0\10"
    check_bad("a run too long", HEADER "-Y 1 +X 8\n" ROW "\211a", sizeof HEADER + 15,
              "damaged in scanline 1");
    check_bad("a literal too long", HEADER "-Y 1 +X 8\n" ROW "\11aaaaaaaaa", sizeof HEADER + 23,
              "damaged in scanline 1");
    check_bad("a literal of no length", HEADER "-Y 1 +X 8\n" ROW "\0aaaa", sizeof HEADER + 18,
              "damaged in scanline 1");
    check_bad("a run without its byte", HEADER "-Y 1 +X 8\n" ROW "\210", sizeof HEADER + 14,
              "ends within scanline 1");
    check_bad_text("an old run of nothing", HEADER "-Y 1 +X 3\n\1\1\1\1abcdabcd", "damaged");
    check_bad_text("an old run too long", HEADER "-Y 1 +X 3\nabcd\1\1\1\3", "damaged");
    check_bad_text("an old run far too long", HEADER "-Y 1 +X 4\nabcd\1\1\1\1\1\1\1\1\1\1\1\1",
                   "damaged");
}

static void test_kinds(void)
{
    static const struct { const char *magic; size_t count; const char *says[2]; } kinds[] = {
        { "\x89PNG\r\n\x1a\n....", 12, { "is a PNG file", "oiiotool" } },
        { "\xff\xd8\xff\xe0....", 8, { "is a JPEG file", "--tocolorspace linear" } },
        { "GIF89a..", 8, { "is a GIF file", "oiiotool" } },
        { "BM..", 4, { "is a BMP file", "oiiotool" } },
        { "RIFF....WEBPVP8 ", 16, { "is a WebP file", "oiiotool" } },
        { "....ftypavif", 12, { "is an AVIF file", "oiiotool" } },
        { "....ftypheic", 12, { "is a HEIF file", "oiiotool" } },
        { "\0\0\0\x0cJXL \r\n\x87\n", 12, { "is a JPEG XL file", "oiiotool" } },
        { "\xff\x0a....", 6, { "is a JPEG XL file", "oiiotool" } },
        { "\0\0\0\x0cjP  \r\n\x87\n", 12, { "is a JPEG 2000 file", "oiiotool" } },
        { "P6\n1 1\n255\nabc", 14, { "is a PPM file", "oiiotool" } },
        { "P5\n1 1\n255\na", 12, { "is a PGM file", "oiiotool" } },
        { "II*\0....", 8, { "is a TIFF file", "oiiotool IN -o OUT.hdr" } },
        { "MM\0*....", 8, { "is a TIFF file", "oiiotool IN -o OUT.hdr" } },
        { "II\xbc\1", 4, { "is a JPEG XR file", "oiiotool" } },
        { "DDS |...", 8, { "is a DDS file", "oiiotool" } },
        { "\xabKTX 20\xbb\r\n\x1a\n", 12, { "is a KTX file", "oiiotool" } },
        { "8BPS\0\1", 6, { "is a Photoshop file", "oiiotool" } },
        { "SDPX", 4, { "is a DPX file", "oiiotool" } },
        { "PK\3\4....", 8, { "is a ZIP file", "unpacked" } },
        { "\x1f\x8b\x08.", 4, { "is a gzip file", "unpacked" } },
        { "RIFF....WEB", 11, { "is neither", "HDR" } },
        { "#!radiance\n", 11, { "is neither", "HDR" } },
        { "#", 1, { "is neither", "HDR" } }
    };
    int i;

    for (i = 0; i < (int)(sizeof kinds / sizeof kinds[0]); i++) {
        check_bad("another kind", kinds[i].magic, kinds[i].count, kinds[i].says[0]);
        CHECK(strstr(error_line, kinds[i].says[1]), "with advice: %s", kinds[i].says[1]);
    }
    check_bad("an empty file", "", 0, "is empty");
}

static void test_no_files(void)
{
    image map;

    CHECK(!image_read(".", &map, error_line, sizeof error_line) && says(".", "it is a folder"),
          "a folder: %s", error_line);
    CHECK(!hdr_read(".", &map, error_line, sizeof error_line) && says(".", "it is a folder") &&
          !image_read_pfm(".", &map, error_line, sizeof error_line) && says(".", "folder"),
          "by each reader");
    CHECK(!hdr_read(scratch("missing"), &map, error_line, sizeof error_line) &&
          says(scratch_path, "cannot be opened"), "missing: %s", error_line);
#ifndef _WIN32
    remove(scratch("fifo"));
    if (mkfifo(scratch("fifo"), 0600) != 0) {
        CHECK_SKIP("no FIFO can be made");
        return;
    }
    alarm(20);
    CHECK(!image_read(scratch_path, &map, error_line, sizeof error_line) &&
          says(scratch_path, "pipe or a device"), "a FIFO, without waiting: %s", error_line);
    alarm(0);
    remove(scratch_path);
#endif
}

/* ---- damaged files ---- */

/* Damages a copy: bytes changed, taken out, put in, or the end cut off. */
static void damage(file_bytes *f, pcg32 *random)
{
    int times = 1 + (int)(pcg32_next(random) % 4);

    while (times-- > 0 && f->count > 1) {
        const size_t header = f->count < 60 ? f->count : 60;
        const size_t at = pcg32_next(random) % (pcg32_next(random) % 2 ? header : f->count);

        switch (pcg32_next(random) % 5) {
        case 0: f->bytes[at] ^= (unsigned char)(1u << pcg32_next(random) % 8); break;
        case 1: f->bytes[at] = (unsigned char)pcg32_next(random); break;
        case 2: f->bytes[at] = (unsigned char)("0123456789+-XY \n\r\1\2="[pcg32_next(random) % 21]);
            break;
        case 3: memmove(f->bytes + at, f->bytes + at + 1, --f->count - at); break;
        default: f->count = at + 1; break;
        }
    }
}

/* Returns whether it is read; 2 where what comes back is not as it should be. */
static int read_damaged(const file_bytes *f)
{
    image map;
    float sum = 0.0f;
    size_t i;
    int done;

    /* An exact copy, so that a sanitizer sees each byte that is read behind the end. */
    unsigned char *exact = (unsigned char *)malloc(f->count ? f->count : 1);

    if (!exact)
        return 2;
    memcpy(exact, f->bytes, f->count);
    error_line[0] = '\0';
    done = hdr_decode(exact, f->count, "damaged", &map, error_line, sizeof error_line);
    free(exact);
    if (!done)
        return map.rgb || map.width || !says("damaged", ": ") ? 2 : 0;
    for (i = 0; i < 3 * (size_t)map.width * (size_t)map.height; i += 997)
        sum += map.rgb[i];
    done = image_size_valid(map.width, map.height) && map.rgb && sum >= 0.0f && !error_line[0]
         ? 1 : 2;
    image_free(&map);
    return done;
}

static void damage_files(long files, double seconds, uint64_t seed, long outcomes[3])
{
    pcg32 random = pcg32_make(seed, 3);
    const time_t start = time(NULL);
    long i;

    for (i = 0; i < files && (seconds <= 0.0 || difftime(time(NULL), start) < seconds); i++) {
        const int width = 1 + (int)(pcg32_next(&random) % 40);
        const int height = 1 + (int)(pcg32_next(&random) % 12);
        const int kind = (int)(pcg32_next(&random) % (uint32_t)(width < 8 || height < 8 ? 2 : 3));
        const char *header = pcg32_next(&random) % 2 ? HEADER
                                                     : "#?R\nEXPOSURE=3\nCOLORCORR=1 2 3\n\n";
        file_bytes f = make_file(header, width, height, orientations[pcg32_next(&random) % 8],
                                 (enum runs)kind);
        damage(&f, &random);
        outcomes[read_damaged(&f)]++;
        file_free(&f);
    }
}

static void test_damaged(void)
{
    long outcomes[3] = { 0, 0, 0 };

    damage_files(DAMAGED_FILES, 0.0, 1, outcomes);
    CHECK(IS(outcomes[2], 0), "%d damaged files are refused in one line, or read",
          DAMAGED_FILES);
    CHECK(outcomes[0] > DAMAGED_FILES / 4 && outcomes[1] > DAMAGED_FILES / 10,
          "%ld refused, %ld read", outcomes[0], outcomes[1]);
}

int main(int count, char **arguments)
{
    if (count == 4 && strcmp(arguments[1], "fuzz") == 0) {
        long outcomes[3] = { 0, 0, 0 };
        damage_files(2000000000L, atof(arguments[2]), (uint64_t)atol(arguments[3]), outcomes);
        printf("%ld refused, %ld read, %ld wrong\n", outcomes[0], outcomes[1], outcomes[2]);
        return outcomes[2] != 0;
    }
    if (count > 1)
        prefix = arguments[1];
    test_orientations();
    test_headers();
    test_rare_runs();
    test_bad_headers();
    test_bad_scanlines();
    test_kinds();
    test_no_files();
    test_damaged();
    return check_done();
}
