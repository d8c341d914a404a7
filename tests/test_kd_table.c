/* test_kd_table.c: the table as bytes: its exact size, copies, files, damage.
 *
 *     test_kd_table [PATH]       the scratch file, by default build/test_kd_table.bin
 */
#include "check.h"

#include "../envsamp.h"

#include "kd_fixture.h"
#include "../examples/common/maps.h"
#include "../examples/common/random.h"

#include <float.h>

/* Those from BILINEAR on are, with compensation, and the last two are of other mappings. */
enum { ALIAS, FIT_LOG, FIT_POWER, ONE_ALIAS, WARP, ONE_WARP, BILINEAR, HEMISPHERE, OCTAHEDRAL,
       KINDS };

static const char *const kind_names[KINDS] = { "ALIAS", "FIT LOG", "FIT POWER", "ALIAS, 1 block",
                                               "WARP", "WARP, 1 block", "WARP, bilinear",
                                               "ALIAS, hemisphere", "WARP, octahedral" };

static envsamp_kd_desc kind_desc(int kind, int blocks)
{
    static const envsamp_kd_select selects[KINDS] = { ENVSAMP_KD_ALIAS, ENVSAMP_KD_FIT,
        ENVSAMP_KD_FIT, ENVSAMP_KD_ALIAS, ENVSAMP_KD_WARP, ENVSAMP_KD_WARP, ENVSAMP_KD_WARP,
        ENVSAMP_KD_ALIAS, ENVSAMP_KD_WARP };
    envsamp_kd_desc desc = kd_desc(kind == ONE_ALIAS || kind == ONE_WARP ? 1 : blocks,
                                   selects[kind]);

    desc.model = kind == FIT_POWER ? ENVSAMP_KD_POWER : ENVSAMP_KD_LOG;
    desc.nearest = kind < BILINEAR;
    desc.mis_compensation = kind >= BILINEAR ? 0.25f : 0.0f;
    return desc;
}

static envsamp_image kind_image(int kind, const image *map)
{
    envsamp_image view = kd_image(map->rgb, map->width, map->height, 3);

    view.mapping = kind == HEMISPHERE ? ENVSAMP_HEMISPHERE
                 : kind == OCTAHEDRAL ? ENVSAMP_OCTAHEDRAL : ENVSAMP_LATLONG;
    return view;
}

static void build_kind(kd_fixture *f, int kind, const char *name, int width, int height, int blocks)
{
    const envsamp_kd_desc desc = kind_desc(kind, blocks);
    envsamp_image view;
    image map;

    map_make(name, width, height, &map);
    view = kind_image(kind, &map);
    kd_fixture_build(f, &view, &desc);
    CHECK(f->kd && kd_fixture_intact(f), "%s: %s, %dx%d, %d blocks, %lu bytes", kind_names[kind],
          name, width, height, f->info.block_count,
          (unsigned long)(f->kd ? envsamp_kd_bytes(f->kd) : 0));
    image_free(&map);
}

/* What `count` samples, their densities and inverses come to: any bit that differs changes it. */
static uint32_t fingerprint(const envsamp_kd *kd, int count)
{
    pcg32 random = pcg32_make(61, 0);
    uint32_t print = 0, words[sizeof(envsamp_sample) / 4];
    int i, w;

    for (i = 0; i < count; i++) {
        const float u0 = pcg32_float(&random), u1 = pcg32_float(&random);
        envsamp_sample s = envsamp_kd_sample(kd, u0, u1);

        memcpy(words, &s, sizeof words);
        for (w = 0; w < (int)(sizeof words / 4); w++)
            print = hash_combine(print, words[w]);
        s.pdf = envsamp_kd_pdf(kd, s.dir);
        envsamp_kd_invert(kd, s.dir, s.uv);
        memcpy(words, &s, sizeof words);
        for (w = 3; w < (int)(sizeof words / 4); w++)
            print = hash_combine(print, words[w]);
    }
    return print;
}

/* Blocks and facts too. */
static uint32_t whole_fingerprint(const envsamp_kd *kd)
{
    uint32_t print = fingerprint(kd, 5000), word;
    envsamp_kd_block block;
    envsamp_kd_info info;
    int i;

    memset(&info, 0, sizeof info);
    envsamp_kd_get_info(kd, &info);
    for (i = 0; i < info.block_count; i++) {
        envsamp_kd_get_block(kd, i, &block);
        memcpy(&word, &block.probability, sizeof word);
        print = hash_combine(print, word);
    }
    memcpy(&word, &info.integral, sizeof word);
    return hash_combine(print, word);
}

/* ---- sizes ---- */

static int build_with(const kd_fixture *f, envsamp_buffer table, envsamp_buffer scratch,
                      envsamp_result expected)
{
    const envsamp_kd *kd = f->kd;
    const envsamp_result result = envsamp_kd_build(&f->image, &f->desc, table, scratch, &kd);

    return IS(result, expected) && !kd == (expected != ENVSAMP_OK) && kd_fixture_intact(f);
}

static void test_exact_sizes(int kind, int width, int height, int blocks)
{
    envsamp_kd_desc desc = kind_desc(kind, blocks);
    envsamp_image view;
    envsamp_buffer table, scratch;
    const envsamp_kd *kd;
    image map;
    kd_fixture f;

    map_make("foliage", width, height, &map);
    view = kind_image(kind, &map);
    kd_fixture_build(&f, &view, &desc);
    CHECK(f.kd && kd_fixture_intact(&f), "%s, %dx%d, %d blocks: %lu and %lu bytes are enough",
          kind_names[kind], width, height, f.info.block_count,
          (unsigned long)f.sizes.table_bytes, (unsigned long)f.sizes.scratch_bytes);
    CHECK(f.kd && envsamp_kd_bytes(f.kd) <= f.sizes.table_bytes, "the table is no larger");
    table = f.table.buffer;
    scratch = f.scratch.buffer;
    memset(table.data, 0x3c, table.bytes);
    table.bytes--;
    CHECK(build_with(&f, table, scratch, ENVSAMP_ERR_MEMORY), "one byte of table less is refused");
    CHECK(IS(envsamp_kd_open(table.data, f.table.buffer.bytes, &kd), ENVSAMP_ERR_FORMAT) && !kd,
          "and leaves no table");
    scratch.bytes--;
    table.bytes++;
    CHECK(build_with(&f, table, scratch, ENVSAMP_ERR_MEMORY), "one byte of scratch less too");
    table.bytes = 0;
    CHECK(build_with(&f, table, f.scratch.buffer, ENVSAMP_ERR_MEMORY), "no bytes at all");
    CHECK(build_with(&f, f.table.buffer, f.scratch.buffer, ENVSAMP_OK), "and all bytes build");
    kd_fixture_free(&f);
    image_free(&map);
}

/* ---- copies ---- */

static void test_copies(int kind)
{
    kd_fixture f;
    kd_guarded copy;
    const envsamp_kd *kd = NULL;
    uint32_t print;
    size_t bytes;

    build_kind(&f, kind, "sky", 256, 128, 900);
    print = whole_fingerprint(f.kd);
    bytes = envsamp_kd_bytes(f.kd);
    memset(f.scratch.buffer.data, 0xee, f.scratch.buffer.bytes);
    CHECK(whole_fingerprint(f.kd) == print, "scratch may be overwritten");
    copy = kd_guarded_make(bytes + 16, 0x11);
    memcpy(copy.buffer.data, f.kd, bytes);
    CHECK(IS(envsamp_kd_open(copy.buffer.data, bytes, &kd), ENVSAMP_OK) && kd, "a copy opens");
    CHECK(IS(envsamp_kd_open(copy.buffer.data, bytes + 16, &kd), ENVSAMP_OK) && kd,
          "in a larger buffer too");
    memset(f.table.buffer.data, 0, f.table.buffer.bytes);
    CHECK(kd && IS(envsamp_kd_bytes(kd), bytes) && whole_fingerprint(kd) == print,
          "and samples the same bits when the first is gone");
    memmove((char *)copy.buffer.data + 16, copy.buffer.data, bytes);
    CHECK(IS(envsamp_kd_open((char *)copy.buffer.data + 16, bytes, &kd), ENVSAMP_OK) && kd
          && whole_fingerprint(kd) == print, "so it does 16 bytes further on");
    CHECK(kd_guarded_intact(&copy), "opening and sampling write nothing");
    free(copy.block);
    kd_fixture_free(&f);
}

static int write_file(const char *path, const void *bytes, size_t count)
{
    FILE *stream = fopen(path, "wb");
    const int wrote = stream && fwrite(bytes, 1, count, stream) == count;

    return stream && fclose(stream) == 0 && wrote;
}

static int read_file(const char *path, void *bytes, size_t count)
{
    FILE *stream = fopen(path, "rb");
    const int got = stream && fread(bytes, 1, count, stream) == count;

    return stream && fclose(stream) == 0 && got;
}

static void test_file(const char *path, int kind)
{
    kd_fixture f;
    kd_guarded copy;
    const envsamp_kd *kd = NULL;
    size_t bytes;

    build_kind(&f, kind, "night", 128, 64, 400);
    bytes = envsamp_kd_bytes(f.kd);
    copy = kd_guarded_make(bytes, 0);
    CHECK(write_file(path, f.kd, bytes) && read_file(path, copy.buffer.data, bytes),
          "a table goes through %s", path);
    CHECK(IS(envsamp_kd_open(copy.buffer.data, bytes, &kd), ENVSAMP_OK) && kd
          && whole_fingerprint(kd) == whole_fingerprint(f.kd), "and is the same");
    remove(path);
    free(copy.block);
    kd_fixture_free(&f);
}

static void test_open_errors(void)
{
    kd_fixture f;
    kd_guarded copy;
    const envsamp_kd *kd;
    size_t bytes;
    int i, refused = 0;

    build_kind(&f, ALIAS, "studio", 32, 16, 20);
    bytes = envsamp_kd_bytes(f.kd);
    kd = f.kd;
    CHECK(IS(envsamp_kd_open(NULL, bytes, &kd), ENVSAMP_ERR_NULL) && !kd, "nothing to open");
    CHECK(IS(envsamp_kd_open(f.kd, bytes, NULL), ENVSAMP_ERR_NULL), "nowhere to put it");
    copy = kd_guarded_make(bytes + 16, 0);
    for (i = 1; i < ENVSAMP_ALIGN; i++) {
        memcpy((char *)copy.buffer.data + i, f.kd, bytes);
        kd = f.kd;
        refused += envsamp_kd_open((char *)copy.buffer.data + i, bytes, &kd) == ENVSAMP_ERR_ALIGN
                && !kd;
    }
    CHECK(refused == ENVSAMP_ALIGN - 1, "a copy out of alignment is refused: %d of 7", refused);
    memset(copy.buffer.data, 0, bytes);
    CHECK(IS(envsamp_kd_open(copy.buffer.data, bytes, &kd), ENVSAMP_ERR_FORMAT) && !kd, "zeros");
    memset(copy.buffer.data, 0xff, bytes);
    CHECK(IS(envsamp_kd_open(copy.buffer.data, bytes, &kd), ENVSAMP_ERR_FORMAT) && !kd, "ones");
    free(copy.block);
    kd_fixture_free(&f);
}

/* ---- damage ---- */

static void test_bit_flips(const kd_fixture *f)
{
    const size_t bytes = envsamp_kd_bytes(f->kd);
    unsigned char *copy = (unsigned char *)kd_allocate(bytes);
    const envsamp_kd *kd;
    size_t bit;
    int opened = 0;

    memcpy(copy, f->kd, bytes);
    for (bit = 0; bit < bytes * 8; bit++) {
        copy[bit / 8] = (unsigned char)(copy[bit / 8] ^ 1u << bit % 8);
        kd = f->kd;
        opened += envsamp_kd_open(copy, bytes, &kd) != ENVSAMP_ERR_FORMAT || kd;
        copy[bit / 8] = (unsigned char)(copy[bit / 8] ^ 1u << bit % 8);
    }
    CHECK(!opened, "any of %lu bits flipped is noticed, but %d", (unsigned long)bit, opened);
    free(copy);
}

/* Each length in a block of its own, so that tools see a read past its end. */
static void test_truncations(const kd_fixture *f)
{
    const size_t bytes = envsamp_kd_bytes(f->kd);
    const envsamp_kd *kd;
    size_t length;
    int opened = 0;

    for (length = 0; length < bytes; length++) {
        void *copy = kd_allocate(length);

        memcpy(copy, f->kd, length);
        kd = f->kd;
        opened += envsamp_kd_open(copy, length, &kd) != ENVSAMP_ERR_FORMAT || kd;
        free(copy);
    }
    CHECK(!opened, "any of %lu lengths too short is noticed, but %d", (unsigned long)bytes, opened);
}

/* ---- damage with a right checksum ---- */

static uint32_t word_at(const unsigned char *table, size_t at)
{
    uint32_t word;

    memcpy(&word, table + at, sizeof word);
    return word;
}

static uint64_t add_word(uint64_t sum, uint64_t word)
{
    sum = (sum ^ word) * (uint64_t)0x9e3779b97f4a7c15;
    return sum ^ sum >> 32;
}

/* Four sums, each of every fourth 64-bit word after the mapping, and then one over the four. Zeros
   complete the last four words. */
static uint32_t checksum(const unsigned char *table, size_t bytes)
{
    uint64_t lane[4] = { word_at(table, KD_AT(mapping)), 0, 0, 0 }, word, sum = 0;
    size_t at, k;

    for (at = KD_AT(bytes), k = 0; at < bytes || k; at += sizeof word, k = (k + 1) % 4) {
        word = 0;
        if (at < bytes)
            memcpy(&word, table + at, bytes - at < sizeof word ? bytes - at : sizeof word);
        lane[k] = add_word(lane[k], word);
    }
    for (k = 0; k < 4; k++)
        sum = add_word(sum, lane[k]);
    return (uint32_t)sum;
}

/* The sum of as many bytes as the header claims, as far as there are that many. */
static void mend_checksum(unsigned char *table, size_t bytes)
{
    const size_t claimed = word_at(table, KD_AT(bytes));
    const uint32_t sum = checksum(table, claimed < bytes ? claimed : bytes);

    memcpy(table + KD_AT(checksum), &sum, sizeof sum);
}

static uint32_t nasty_word(pcg32 *random, uint32_t word)
{
    const uint32_t words[] = { 0, 1, 2, 0xffffffffu, 0x7f800000u, 0xff800000u, 0x7fc00000u,
                               0x80000000u, 0x7fffffffu, 0x7fefffffu, 0xffff0000u, 0x0000ffffu,
                               0x00010000u, 1u << 20, 1u << 24, 0x7f7fffffu };
    const uint32_t kind = pcg32_next(random) % 8;

    if (kind < 2)
        return words[pcg32_next(random) % 16];
    if (kind < 4)
        return word ^ 1u << pcg32_next(random) % 32;
    if (kind < 5)
        return word + 1u;
    if (kind < 6)
        return word - 1u;
    if (kind < 7)
        return pcg32_next(random);
    return pcg32_next(random) % 64;
}

/* Damages one to three words, header and arrays alike. */
static void mutate(unsigned char *table, size_t bytes, pcg32 *random)
{
    const size_t words = bytes / 4, header = KD_AT(end) / 4;
    int count = 1 + (int)(pcg32_next(random) % 3);

    while (count-- > 0) {
        const size_t among = pcg32_next(random) % 3 ? words : header;
        const size_t at = pcg32_next(random) % among * 4;
        const uint32_t word = nasty_word(random, word_at(table, at));

        memcpy(table + at, &word, sizeof word);
    }
}

/* Draws and looks up; whether all is finite. Tools see what lies out of bounds. */
static int survives(const envsamp_kd *kd, int samples, pcg32 *random)
{
    const float special[] = { 0.0f, 1.0f, NAN, INFINITY, 0.99999994f };
    int i, c, finite = 1;

    for (i = 0; i < samples; i++) {
        const float u0 = i < 5 ? special[i] : pcg32_float(random);
        const float u1 = i < 5 ? special[4 - i] : pcg32_float(random);
        const envsamp_sample s = envsamp_kd_sample(kd, u0, u1);
        const float dir[3] = { u0 - 0.5f, u1 - 0.5f, pcg32_float(random) - 0.5f };

        for (c = 0; c < 3; c++)
            finite &= s.dir[c] >= -4.0f && s.dir[c] <= 4.0f;
        finite &= s.pdf >= 0.0f && s.pdf <= FLT_MAX;
        finite &= envsamp_kd_pdf(kd, s.dir) >= 0.0f;
        finite &= !(envsamp_kd_pdf(kd, dir) > FLT_MAX);
    }
    return finite;
}

#define BATCH 130               /* more than two batches of the library */

/* The same in batches, and inverses. */
static int batches_survive(const envsamp_kd *kd, pcg32 *random)
{
    float u0[BATCH], u1[BATCH], x[BATCH], y[BATCH], z[BATCH], pdf[BATCH], u[2];
    int i, inverted, finite = 1;

    for (i = 0; i < BATCH; i++) {
        u0[i] = pcg32_float(random);
        u1[i] = i % 7 ? pcg32_float(random) : 0.99999994f;
    }
    envsamp_kd_sample_n(kd, BATCH, u0, u1, x, y, z, pdf);
    for (i = 0; i < BATCH; i++) {
        const float sampled[3] = { x[i], y[i], z[i] };
        const float any[3] = { u0[i] - 0.5f, u1[i] - 0.5f, pcg32_float(random) - 0.5f };

        finite &= fabsf(x[i]) <= 4.0f && fabsf(y[i]) <= 4.0f && fabsf(z[i]) <= 4.0f
               && pdf[i] >= 0.0f && pdf[i] <= FLT_MAX;
        inverted = envsamp_kd_invert(kd, i % 2 ? sampled : any, u);
        finite &= inverted == 0 || inverted == 1;
        finite &= u[0] >= 0.0f && u[0] < 1.0f && u[1] >= 0.0f && u[1] < 1.0f;
    }
    envsamp_kd_pdf_n(kd, BATCH, x, y, z, pdf);
    envsamp_kd_pdf_n(kd, BATCH, u0, u1, u0, x);
    for (i = 0; i < BATCH; i++)
        finite &= pdf[i] >= 0.0f && pdf[i] <= FLT_MAX && x[i] >= 0.0f && x[i] <= FLT_MAX;
    return finite;
}

static int blocks_survive(const envsamp_kd *kd)
{
    envsamp_kd_info info;
    envsamp_kd_block block;
    int i, good = envsamp_kd_get_info(kd, &info) == ENVSAMP_OK;

    for (i = 0; good && i < info.block_count; i += 1 + info.block_count / 200)
        good = envsamp_kd_get_block(kd, i, &block) == ENVSAMP_OK && block.solid_angle >= 0.0f
            && block.uv_max[0] <= 1.0f && block.uv_max[1] <= 1.0f;
    return good;
}

static void test_mutations(const kd_fixture *f, int count, int samples)
{
    const size_t bytes = envsamp_kd_bytes(f->kd);
    unsigned char *copy = (unsigned char *)kd_allocate(bytes);
    pcg32 random = pcg32_make(67, (uint64_t)bytes);
    const envsamp_kd *kd;
    int i, opened = 0, failed = 0, kept = 0;

    CHECK(checksum((const unsigned char *)f->kd, bytes)
          == word_at((const unsigned char *)f->kd, KD_AT(checksum)),
          "the checksum is the one that is documented");
    for (i = 0; i < count; i++) {
        memcpy(copy, f->kd, bytes);
        mutate(copy, bytes, &random);
        mend_checksum(copy, bytes);
        if (envsamp_kd_open(copy, bytes, &kd) != ENVSAMP_OK) {
            kept += kd != NULL;
            continue;
        }
        opened++;
        failed += !survives(kd, samples, &random) || !batches_survive(kd, &random)
               || !blocks_survive(kd);
    }
    CHECK(IS(kept, 0), "a refused table is not handed out");
    CHECK(!failed, "of %d damaged tables %d open, and all but %d of those sample", count, opened,
          failed);
    free(copy);
}

/* Cells of the grid lie after all else that a descent reads, so a cell set to each word in turn
   must be refused, or be a density. */
static void test_every_link(const kd_fixture *f)
{
    const size_t bytes = envsamp_kd_bytes(f->kd);
    const uint32_t blocks = (uint32_t)f->info.block_count;
    const uint32_t good[] = { 0, 0x3f800000u, 0x7f7fffffu };    /* 0, 1 and the largest float */
    const uint32_t bad[] = { 0x80000000u + blocks - 1, 0xffffffffu, 0x7f800000u, 0x7fffffffu };
    unsigned char *copy = (unsigned char *)kd_allocate(bytes);
    const envsamp_kd *kd;
    int i, wrong = 0;

    for (i = 0; i < 7; i++) {
        const uint32_t word = i < 3 ? good[i] : bad[i - 3];

        memcpy(copy, f->kd, bytes);
        memcpy(copy + bytes - 4, &word, sizeof word);
        mend_checksum(copy, bytes);
        wrong += (envsamp_kd_open(copy, bytes, &kd) == ENVSAMP_OK) != (i < 3);
    }
    CHECK(!wrong, "links out of the table are refused, others are not: %d wrong", wrong);
    free(copy);
}

static void test_damage(int kind)
{
    const int warp = kind == WARP;
    kd_fixture f;

    build_kind(&f, kind, "foliage", 16, 8, 21);
    test_bit_flips(&f);
    test_truncations(&f);
    test_mutations(&f, warp ? 100000 : 25000, warp ? 400 : 1000);
    test_every_link(&f);
    kd_fixture_free(&f);
}

/* ---- what a table must not hold ---- */

/* A copy of a table to be changed and tried. */
typedef struct trial {
    unsigned char *table;
    const kd_fixture *f;
    size_t bytes;
    int unsafe;                 /* of those that opened: how many gave what is not finite */
} trial;

static trial trial_make(const kd_fixture *f)
{
    trial t;

    t.f = f;
    t.unsafe = 0;
    t.bytes = envsamp_kd_bytes(f->kd);
    t.table = (unsigned char *)kd_allocate(t.bytes);
    memcpy(t.table, f->kd, t.bytes);
    return t;
}

/* Opens the copy, uses it if it opened, mends it again, and says whether it did. */
static int trial_opens(trial *t)
{
    pcg32 random = pcg32_make(68, (uint64_t)t->bytes);
    const envsamp_kd *kd;
    int opened;

    mend_checksum(t->table, t->bytes);
    opened = envsamp_kd_open(t->table, t->bytes, &kd) == ENVSAMP_OK && kd;
    t->unsafe += opened && (!survives(kd, 100, &random) || !batches_survive(kd, &random)
                            || !blocks_survive(kd));
    memcpy(t->table, t->f->kd, t->bytes);
    return opened;
}

static int opens_with_word(trial *t, size_t at, uint32_t word)
{
    memcpy(t->table + at, &word, sizeof word);
    return trial_opens(t);
}

static int opens_with_float(trial *t, size_t at, float value)
{
    memcpy(t->table + at, &value, sizeof value);
    return trial_opens(t);
}

static float float_at(const trial *t, size_t at)
{
    float value;

    memcpy(&value, t->table + at, sizeof value);
    return value;
}

/* Edges of `count` tiles or blocks. Of the polar angle only those of a lat-long map may have a
   sign. */
static void test_wrong_edges(trial *t, int count, const char *what)
{
    const float bad[] = { NAN, INFINITY, -INFINITY, 1.5f, -1.5f };
    const int signs = t->f->image.mapping == ENVSAMP_LATLONG;
    int i, k, v, opened = 0;

    for (i = 0; i < count; i++) {
        const size_t at = KD_RECORD_AT(i);

        for (k = 0; k < 4; k++) {
            const size_t edge = at + 4 * (size_t)k, other = at + 4 * (size_t)(k ^ 1);

            for (v = 0; v < 5; v++)
                opened += opens_with_float(t, edge, bad[v]);
            opened += opens_with_float(t, edge, float_at(t, other));
            opened += (k < 2 || !signs) && float_at(t, edge) > 0.0f
                   && opens_with_float(t, edge, -float_at(t, edge));
        }
        opened += opens_with_float(t, at, -1e-3f);
        opened += opens_with_float(t, at + 4, 0.0f);
        opened += opens_with_float(t, at + 8, -0.0f);
        opened += opens_with_float(t, at + 12, 0.0f);
    }
    CHECK(count > 0 && trial_opens(t), "%d %s as they are", count, what);
    CHECK(!opened, "edges of %s that do not rise, or leave the map, are refused, but %d", what,
          opened);
}

/* A density that is none. */
static void test_wrong_densities(trial *t)
{
    const float bad[] = { NAN, INFINITY, -INFINITY, -1.0f, -1e-40f };
    int i, v, opened = 0;

    for (i = 0; i < t->f->info.block_count; i++)
        for (v = 0; v < 5; v++)
            opened += opens_with_float(t, KD_RECORD_AT(i) + 16, bad[v]);
    CHECK(!opened, "densities below 0 or not finite are refused, but %d", opened);
}

/* What says of which map the table is. */
static void test_wrong_source(trial *t)
{
    const float compensations[] = { NAN, INFINITY, -INFINITY, -0.5f, 1.5f, 1.0000001f };
    const uint32_t words[] = { 3, 4, 0x10000u, 0x80000000u, 0xffffffffu };
    const int latlong = t->f->image.mapping == ENVSAMP_LATLONG;
    int i, opened = 0;

    for (i = 0; i < 6; i++)
        opened += opens_with_float(t, KD_AT(mis_compensation), compensations[i]);
    for (i = 0; i < 5; i++) {
        opened += opens_with_word(t, KD_AT(mapping), words[i]);
        opened += opens_with_word(t, KD_AT(bilinear), words[i]);
    }
    opened += opens_with_word(t, KD_AT(bilinear), 2);
    opened += latlong && opens_with_word(t, KD_AT(mapping), ENVSAMP_HEMISPHERE);
    opened += latlong && opens_with_word(t, KD_AT(mapping), ENVSAMP_OCTAHEDRAL);
    for (i = 2; i < 5; i++) {
        opened += opens_with_word(t, KD_AT(width), words[i]);
        opened += opens_with_word(t, KD_AT(height), words[i]);
    }
    opened += opens_with_word(t, KD_AT(width), 0);
    opened += opens_with_word(t, KD_AT(height), 0);
    opened += opens_with_word(t, KD_AT(version), 5);
    opened += opens_with_word(t, KD_AT(version), 7);
    CHECK(!opened, "of another map, mapping or version: refused, but %d", opened);
}

/* Places of arrays, and what else follows from the rest of the header. */
static void test_wrong_places(trial *t)
{
    const size_t at[] = { KD_AT(alias_at), KD_AT(nodes_at), KD_AT(grid_at),
                          KD_AT(bytes), KD_AT(bytes) + 4, KD_AT(alias_shift),
                          KD_AT(grid_bits_x), KD_AT(grid_bits_y),
                          KD_AT(fit_end) };
    int i, opened = 0;

    for (i = 0; i < 9; i++) {
        const uint32_t word = word_at(t->table, at[i]);

        opened += opens_with_word(t, at[i], word + 4) + opens_with_word(t, at[i], word - 4)
                + opens_with_word(t, at[i], word + 1) + opens_with_word(t, at[i], word ^ KD_LINK)
                + opens_with_word(t, at[i], 0xffffffffu);
    }
    CHECK(!opened, "arrays elsewhere are refused, but %d", opened);
}

/* Each cut is tried outside of the unit square and of the map, and between multiples of 2^-24. Out
   of its block, or turned, it may open, but does no harm. */
static void test_wrong_cuts(trial *t)
{
    const int cuts = t->f->info.block_count - kd_tile_count(t->f->kd);
    const float bad[] = { NAN, INFINITY, -INFINITY, 1.5f, -1.5f };
    int i, v, opened = 0, moved = 0;

    for (i = 0; i < cuts; i++) {
        const size_t at = inside_kd_cuts(t->f->kd) + 16 * (size_t)i;
        const float cut = float_at(t, at), edge = float_at(t, at + 4);

        for (v = 0; v < 5; v++)
            opened += opens_with_float(t, at, bad[v]) + opens_with_float(t, at + 4, bad[v]);
        opened += opens_with_float(t, at, cut * 0.9999999f);
        opened += opens_with_float(t, at, 1e-40f) + opens_with_float(t, at, 1e-10f);
        if (!signbit(cut))
            opened += opens_with_float(t, at + 4, -edge);
        moved += opens_with_float(t, at + 4, 0.0f);
        moved += opens_with_float(t, at + 4, signbit(cut) ? -0.0f : 1.0f);
        moved += opens_with_float(t, at, 0.0f) + opens_with_float(t, at, 1.0f);
        moved += opens_with_float(t, at, -0.0f) + opens_with_float(t, at, -1.0f);
        moved += opens_with_float(t, at, -cut);
    }
    CHECK(cuts > 20 && !opened, "%d cuts that are none are refused, but %d", cuts, opened);
    CHECK(!t->unsafe, "of cuts out of their blocks %d open, and all but %d sample", moved,
          t->unsafe);
}

/* Links to themselves, back, into the middle of a cut, out of the array. */
static void test_wrong_order(trial *t)
{
    const uint32_t tiles = (uint32_t)kd_tile_count(t->f->kd);
    const uint32_t cuts = (uint32_t)t->f->info.block_count - tiles;
    const size_t sites = tiles + 2 * cuts;
    const size_t cut = inside_kd_cuts(t->f->kd);
    const uint32_t first = KD_LINK | (uint32_t)(cut / 4);
    size_t i, k;
    int opened = 0, others = 0, links = 0;

    for (i = 0; i < sites; i++) {
        const size_t at = i < tiles ? KD_RECORD_AT(i) + 16
                        : cut + 16 * ((i - tiles) / 2) + 8 + 4 * ((i - tiles) % 2);
        const uint32_t link = word_at(t->table, at);
        const uint32_t own = first + 4 * (uint32_t)((i - tiles) / 2);
        const uint32_t wrong[7] = { i < tiles ? first - 4 : own, i < tiles ? first - 5 : first,
                                    first + 4 * cuts, KD_LINK | 0x7fffffffu, 0x7f800000u,
                                    first + 4 * (cuts - 1) + 1, first + 4 * (cuts - 1) - 2 };

        links += link >> 31 ? 1 : 0;
        for (k = 0; k < 7; k++)
            opened += opens_with_word(t, at, wrong[k]);
        if (link >> 31)                         /* the one before or after, and a lost subtree */
            others += opens_with_word(t, at, link - 4) + opens_with_word(t, at, link + 4)
                    + opens_with_word(t, at, 0x3f800000u);
    }
    CHECK(links == (int)cuts, "every cut has one link to it: %d of %d", links, (int)cuts);
    CHECK(!opened, "links backwards or out of range are refused, but %d", opened);
    CHECK(!t->unsafe, "of links to other cuts %d open, and all but %d sample", others, t->unsafe);
}

/* A chain of cuts below a tile, each nearer to the low edge, with its first at entry `first`. */
static void write_chain(trial *t, int tile, int first, int count)
{
    const size_t tile_at = KD_RECORD_AT(tile), cuts_at = inside_kd_cuts(t->f->kd);
    const float x0 = float_at(t, tile_at), x1 = float_at(t, tile_at + 4);
    uint32_t root = KD_LINK | (uint32_t)(cuts_at / 4 + 4 * (size_t)first);
    int i;

    if (!count)
        root = 0x3f800000u;
    memcpy(t->table + tile_at + 16, &root, sizeof root);
    for (i = 0; i < count; i++) {
        struct { float cut, edge; uint32_t child[2]; } node;

        node.cut = (float)(count - i) / 256.0f;
        node.edge = x0 + (x1 - x0) * node.cut;
        node.child[0] = i + 1 < count ? root + 4 * (uint32_t)(i + 1) : 0x3f800000u;
        node.child[1] = 0x3f800000u;
        memcpy(t->table + cuts_at + sizeof node * (size_t)(first + i), &node, sizeof node);
    }
}

/* Chains below the tiles of the first column: of `depth` cuts, and what is left. */
static int opens_with_depth(trial *t, int depth)
{
    const int tiles = kd_tile_count(t->f->kd), cuts = t->f->info.block_count - tiles;
    const int second = 1 << KD_WORD(t->f->kd, tile_bits_x);
    int i;

    for (i = 0; i < tiles; i++)
        write_chain(t, i, 0, 0);
    write_chain(t, 0, 0, depth);
    write_chain(t, second, depth, cuts - depth);
    return trial_opens(t);
}

static void test_too_deep(trial *t)
{
    int depth, opened = 0;

    for (depth = 20; depth <= 40; depth++)
        opened += opens_with_depth(t, depth);
    CHECK(opened == 21 && !t->unsafe, "chains of 20 to 40 cuts open, and all but %d sample",
          t->unsafe);
}

/* The header of a table of WARP and its sizes. */
static void test_wrong_bits(trial *t)
{
    const size_t at[] = { KD_AT(tile_bits_x), KD_AT(tile_bits_y),
                          KD_AT(grid_bits_x), KD_AT(grid_bits_y),
                          KD_AT(block_count), KD_AT(select) };
    const uint32_t words[] = { 0, 1, 9, 11, 12, 31, 32, 63, 0xffffffffu };
    int i, k, opened = 0;

    for (i = 0; i < 6; i++)
        for (k = 0; k < 9; k++)
            opened += words[k] != word_at(t->table, at[i]) && opens_with_word(t, at[i], words[k]);
    CHECK(!opened, "other counts of bits, blocks and kinds are refused, but %d", opened);
}

/* A model of FIT with another alpha, which the header holds as a float too. */
static int opens_with_alpha(trial *t, double alpha)
{
    const float rounded = (float)alpha;

    memcpy(t->table + KD_AT(alpha), &alpha, sizeof alpha);
    return opens_with_float(t, KD_AT(fit_alpha), rounded);
}

static void test_wrong_alpha(trial *t)
{
    const double bad[] = { (double)NAN, (double)INFINITY, -1.0, 0.0, 1e-10, 1e5, 1e30 };
    const double own = t->f->info.alpha;
    int i, opened = 0;

    for (i = 0; i < (int)(sizeof bad / sizeof bad[0]); i++)
        opened += opens_with_alpha(t, bad[i]);
    CHECK(opens_with_alpha(t, own), "the model's alpha, %.3g, is fine", own);
    CHECK(!opened && !opens_with_alpha(t, own * 1.001), "others are refused, but %d", opened);
}

static void test_refusals(int kind)
{
    kd_fixture f;
    trial t;

    build_kind(&f, kind, "foliage", 64, 32, 60);
    t = trial_make(&f);
    if (f.desc.select == ENVSAMP_KD_WARP) {
        test_wrong_edges(&t, kd_tile_count(f.kd), "tiles");
    } else {
        test_wrong_edges(&t, f.info.block_count, "blocks");
        test_wrong_densities(&t);
    }
    if (f.desc.select == ENVSAMP_KD_FIT)
        test_wrong_alpha(&t);
    test_wrong_source(&t);
    test_wrong_places(&t);
    CHECK(!t.unsafe, "all that open sample, but %d", t.unsafe);
    free(t.table);
    kd_fixture_free(&f);
}

static void test_warp_refusals(void)
{
    kd_fixture f;
    trial t;

    build_kind(&f, WARP, "foliage", 64, 32, 60);
    t = trial_make(&f);
    CHECK(IS(kd_tile_count(f.kd), 16) && IS(f.info.block_count, 60),
          "16 tiles, 44 cuts below them");
    test_wrong_cuts(&t);
    test_wrong_order(&t);
    test_too_deep(&t);
    test_wrong_bits(&t);
    free(t.table);
    kd_fixture_free(&f);
}

int main(int argc, char **argv)
{
    const char *path = argc > 1 ? argv[1] : "build/test_kd_table.bin";
    int kind;

    for (kind = 0; kind < KINDS; kind++) {
        test_exact_sizes(kind, 100, 51, 300);
        test_exact_sizes(kind, 3, 5, 1000);
        test_exact_sizes(kind, 1, 1, 1);
        test_exact_sizes(kind, 333, 257, 1025);
        test_copies(kind);
        test_file(path, kind);
        test_damage(kind);
        if (kind != ONE_ALIAS && kind != ONE_WARP)
            test_refusals(kind);
    }
    test_open_errors();
    test_warp_refusals();
    return check_done();
}
