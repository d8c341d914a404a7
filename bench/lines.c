/* lines.c: how many cache lines of its table a sample and a density touch, counted from a trace of
 * all loads and stores.
 *
 *     lines [--width N] [MAP]         as bench; needs valgrind
 *
 * Tables are built and written to a file. Then the program runs itself under valgrind's lackey,
 * which prints every access: this second run maps the file and calls each method CALLS times, with a
 * store to a place of `marks` around each call. The first one reads the trace: distinct 64-byte
 * lines between two marks that lie in the call's table. Nothing of the library is changed for it,
 * and nothing is assumed about how a table is laid out.
 */
#define _POSIX_C_SOURCE 200809L

#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "baselines.h"
#include "input.h"
#include "../examples/common/folder.h"
#include "../examples/common/random.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define CALLS 2000
#define LINE ((size_t)64)
#define PAGE ((size_t)4096)
#define LINES_MAX 512                   /* of a call */
#define TABLES "build/lines.tables"

enum { SAMPLE, PDF, KINDS };
enum { WARP, ALIAS, FIT, FACING, CDF, INVERSION };

static const struct { const char *name; int method, blocks; } rows[] = {
    { "WARP", WARP, 6144 }, { "WARP", WARP, 16384 }, { "ALIAS", ALIAS, 6144 },
    { "ALIAS", ALIAS, 16384 }, { "FIT", FIT, 6144 }, { "FIT", FIT, 16384 },
    { "light x cosine", FACING, 6144 }, { "light x cosine", FACING, 16384 }, { "cdf", CDF, 0 },
    { "inversion", INVERSION, 0 }
};
#define ROWS ((int)(sizeof rows / sizeof rows[0]))
#define END (ROWS * KINDS)              /* the mark behind a call */

/* The file's first page; tables begin at pages. */
typedef struct directory { size_t at[ROWS], bytes[ROWS]; } directory;

/* ---- tables ---- */

static void *allocate(size_t bytes)
{
    void *memory = NULL;

    if (posix_memalign(&memory, PAGE, bytes ? bytes : 1))
        input_fail("set-up", "out of memory");
    return memory;
}

/* Returns the table, at the start of a block. */
static void *build_ours(int row, const envsamp_image *view, size_t *bytes)
{
    static const envsamp_kd_select select[] = { ENVSAMP_KD_WARP, ENVSAMP_KD_ALIAS, ENVSAMP_KD_FIT,
                                                ENVSAMP_KD_WARP };
    envsamp_kd_desc desc = envsamp_kd_defaults();
    envsamp_buffer table, scratch;
    const envsamp_cdf *cdf = NULL;
    const envsamp_kd *kd = NULL;
    envsamp_sizes sizes;

    if (rows[row].method == CDF) {
        envsamp_cdf_sizes(view, NULL, &sizes);
    } else {
        desc.select = select[rows[row].method];
        desc.block_count = rows[row].blocks;
        desc.facing = rows[row].method == FACING;
        envsamp_kd_sizes(view, &desc, &sizes);
    }
    table.data = allocate(table.bytes = sizes.table_bytes);
    scratch.data = allocate(scratch.bytes = sizes.scratch_bytes);
    if (rows[row].method == CDF)
        envsamp_cdf_build(view, NULL, table, scratch, &cdf);
    else
        envsamp_kd_build(view, &desc, table, scratch, &kd);
    free(scratch.data);
    if ((const void *)cdf != table.data && (const void *)kd != table.data)
        input_fail(rows[row].name, "the build failed");
    *bytes = cdf ? envsamp_cdf_bytes(cdf) : envsamp_kd_bytes(kd);
    return table.data;
}

/* The arrays of inversion, one behind another, behind its struct. */
static void place_inversion(baseline_cdf *cdf)
{
    const size_t width = (size_t)cdf->width, height = (size_t)cdf->height;

    cdf->marginal = (float *)(void *)((char *)cdf + LINE);
    cdf->conditional = cdf->marginal + height + 1;
    cdf->density = cdf->conditional + height * (width + 1);
}

static void *build_inversion(const image *map, size_t *bytes)
{
    const size_t width = (size_t)map->width, height = (size_t)map->height;
    baseline_cdf built, *placed;

    if (!baseline_cdf_create(map->rgb, map->width, map->height, &built))
        input_fail("inversion", "out of memory, or a black map");
    *bytes = LINE + sizeof(float) * (height + 1 + height * (2 * width + 1));
    placed = allocate(*bytes);
    memset(placed, 0, LINE);
    placed->width = map->width;
    placed->height = map->height;
    place_inversion(placed);
    memcpy(placed->marginal, built.marginal, (height + 1) * sizeof(float));
    memcpy(placed->conditional, built.conditional, height * (width + 1) * sizeof(float));
    memcpy(placed->density, built.density, height * width * sizeof(float));
    baseline_cdf_destroy(&built);
    return placed;
}

static void write_tables(const image *map, directory *d)
{
    const envsamp_image view = { map->rgb, map->width, map->height, 3, 0, ENVSAMP_LATLONG };
    FILE *file;
    int i;

    MAKE_FOLDER("build");
    file = fopen(TABLES, "wb");
    memset(d, 0, sizeof *d);
    for (i = 0; i < ROWS && file; i++) {
        void *table = rows[i].method == INVERSION ? build_inversion(map, &d->bytes[i])
                                                  : build_ours(i, &view, &d->bytes[i]);

        d->at[i] = i ? (d->at[i - 1] + d->bytes[i - 1] + PAGE - 1) / PAGE * PAGE : PAGE;
        fseek(file, (long)d->at[i], SEEK_SET);
        fwrite(table, 1, d->bytes[i], file);
        free(table);
    }
    if (file) {
        fseek(file, 0, SEEK_SET);
        fwrite(d, sizeof *d, 1, file);
    }
    if (!file || ferror(file) || fclose(file))
        input_fail(TABLES, "cannot be written");
}

/* ---- the run that is traced ---- */

static volatile char marks[END + 1];
static volatile float kept;             /* so that no call is left out */

static float call_sample(int method, const void *table, const float axis[3], const float u[2])
{
    if (method == INVERSION)
        return baseline_cdf_sample(table, u[0], u[1]).pdf;
    if (method == CDF)
        return envsamp_cdf_sample(table, u[0], u[1]).pdf;
    if (method == FACING)
        return envsamp_kd_sample_facing(table, axis, u[0], u[1]).pdf;
    return envsamp_kd_sample(table, u[0], u[1]).pdf;
}

static float call_pdf(int method, const void *table, const float axis[3], const float dir[3])
{
    if (method == INVERSION)
        return baseline_cdf_pdf(table, dir);
    if (method == CDF)
        return envsamp_cdf_pdf(table, dir);
    if (method == FACING)
        return envsamp_kd_pdf_facing(table, axis, dir);
    return envsamp_kd_pdf(table, dir);
}

static int walk(void)
{
    const int file = open(TABLES, O_RDONLY);
    const size_t bytes = file < 0 ? 0 : (size_t)lseek(file, 0, SEEK_END);
    char *base = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE, file, 0);
    const directory *d = (const void *)base;
    pcg32 random = pcg32_make(3, 3);
    int i, k;

    if (bytes == 0 || base == MAP_FAILED)
        input_fail(TABLES, "cannot be read");
    printf("base %p\nmarks %p\n", (void *)base, (void *)(uintptr_t)marks);
    fflush(stdout);
    place_inversion((baseline_cdf *)(void *)(base + d->at[ROWS - 1]));
    for (k = 0; k < CALLS; k++) {
        float u[2], axis[3], dir[3];

        u[0] = pcg32_float(&random);
        u[1] = pcg32_float(&random);
        pcg32_dir(&random, axis);
        pcg32_dir(&random, dir);
        for (i = 0; i < ROWS; i++) {
            marks[KINDS * i + SAMPLE] = 1;
            kept = call_sample(rows[i].method, base + d->at[i], axis, u);
            marks[END] = 1;
            marks[KINDS * i + PDF] = 1;
            kept = call_pdf(rows[i].method, base + d->at[i], axis, dir);
            marks[END] = 1;
        }
    }
    return 0;
}

/* ---- the trace ---- */

typedef struct trace {
    const directory *directory;
    size_t base, marks;                 /* addresses in the traced run */
    int at;                             /* the call that goes on: KINDS row + kind; or END */
    size_t lines[LINES_MAX];            /* that it has touched */
    int line_count;
    int counts[ROWS * KINDS][CALLS], calls[ROWS * KINDS];
} trace;

static void end_call(trace *t)
{
    if (t->at != END && t->calls[t->at] < CALLS)
        t->counts[t->at][t->calls[t->at]++] = t->line_count;
    t->at = END;
}

static void touch(trace *t, size_t address, size_t bytes)
{
    const directory *d = t->directory;
    const int row = t->at / KINDS;
    size_t line;
    int i;

    if (t->at == END || address < t->base + d->at[row]
        || address >= t->base + d->at[row] + d->bytes[row])
        return;
    for (line = address / LINE; line <= (address + bytes - 1) / LINE; line++) {
        for (i = 0; i < t->line_count && t->lines[i] != line; i++)
            continue;
        if (i == t->line_count && i < LINES_MAX)
            t->lines[t->line_count++] = line;
    }
}

/* " L 04222cac,4": a load, a store or both of so many bytes; "I " lines are of instructions. */
static void read_line(trace *t, const char *line)
{
    unsigned long long address, bytes;

    if (sscanf(line, "base 0x%llx", &address) == 1)
        t->base = (size_t)address;
    if (sscanf(line, "marks 0x%llx", &address) == 1)
        t->marks = (size_t)address;
    if (line[0] != ' ' || !strchr("LSM", line[1])
        || sscanf(line + 2, "%llx,%llu", &address, &bytes) != 2)
        return;
    if (t->marks && address >= t->marks && address <= t->marks + END) {
        end_call(t);
        t->at = (int)(address - t->marks);
        t->line_count = 0;
    } else {
        touch(t, (size_t)address, (size_t)bytes);
    }
}

static void read_trace(trace *t, const char *program)
{
    char command[512], line[256];
    FILE *from;

    snprintf(command, sizeof command, "command -v valgrind >/dev/null && valgrind --tool=lackey "
             "--basic-counts=no --trace-mem=yes --log-fd=1 '%s' walk", program);
    from = popen(command, "r");
    if (!from)
        input_fail("valgrind", "cannot be started");
    while (fgets(line, sizeof line, from))
        read_line(t, line);
    if (pclose(from) != 0)
        input_fail("valgrind", "failed; is it installed? apt-get install valgrind");
}

/* ---- reporting ---- */

static int ascending(const void *a, const void *b)
{
    return *(const int *)a - *(const int *)b;
}

static void print_counts(trace *t, int which)
{
    int *counts = t->counts[which], i;
    double sum = 0.0;

    if (t->calls[which] != CALLS)
        input_fail("valgrind", "the trace lacks calls");
    for (i = 0; i < CALLS; i++)
        sum += counts[i];
    qsort(counts, CALLS, sizeof *counts, ascending);
    printf(" %.2f | %d | %d |", sum / CALLS, counts[CALLS / 2], counts[CALLS - 1]);
}

static void print_table(trace *t)
{
    int i, k;

    printf("| method | table kB | sample: mean | median | most | pdf: mean | median | most |\n"
           "|---|---|---|---|---|---|---|---|\n");
    for (i = 0; i < ROWS; i++) {
        if (rows[i].blocks)
            printf("| %s, %d blocks |", rows[i].name, rows[i].blocks);
        else
            printf("| %s |", rows[i].name);
        printf(" %.0f |", (double)t->directory->bytes[i] / 1000.0);
        for (k = 0; k < KINDS; k++)
            print_counts(t, KINDS * i + k);
        printf("\n");
    }
}

int main(int argc, char **argv)
{
    static directory d;
    static trace t;
    bench_input input;

    if (argc > 1 && !strcmp(argv[1], "walk"))
        return walk();
    input_create(argc, argv, &input);
    write_tables(&input.map, &d);
    t.directory = &d;
    t.at = END;
    read_trace(&t, argv[0]);
    printf("%s, %d x %d: distinct 64-byte lines of its table that a call touches, of %d calls\n\n",
           input.options.map_path, input.map.width, input.map.height, CALLS);
    print_table(&t);
    input_destroy(&input);
    return 0;
}
