/* test_fuzz.c: the fuzz targets of fuzz.c without a fuzzer.
 *
 *     test_fuzz                          tests/corpus/ and some inputs of fixed seeds, every target
 *     test_fuzz TARGET COUNT [FILE...]   files, and so many inputs of fixed seeds
 *     test_fuzz corpus DIRECTORY         writes DIRECTORY/TARGET/00 and so on, of fixed seeds
 *
 * A check that fails ends the program with the input that it is about.
 */
#include "check.h"

#include "fuzz.c"

#include <signal.h>

/* The first files of a corpus are of fixed seeds; what a fuzzer has found comes after them. */
enum { MOST_INPUT = 4096, SEEDED = 12 };

static char running[256];       /* a file, or the number of an input */

static void name_input(void) { fprintf(stderr, "on input %s\n", running); }

/* What the runtime of the undefined behaviour sanitizer calls before it ends the program. */
extern void __ubsan_on_report(void);

void __ubsan_on_report(void) { name_input(); }

static void on_abort(int number)
{
    (void)number;
    name_input();
}

/* Input `index` of a target: up to 255 random bytes. */
static size_t seeded_input(int target, int index, uint8_t data[MOST_INPUT])
{
    pcg32 random = pcg32_make((uint64_t)index, (uint64_t)target);
    const size_t size = pcg32_next(&random) % 256;
    size_t i;

    for (i = 0; i < size; i++)
        data[i] = (uint8_t)(pcg32_next(&random) >> 24);
    return size;
}

static void run_seeded(int target, int index)
{
    uint8_t data[MOST_INPUT];

    snprintf(running, sizeof running, "%d of fixed seeds", index);
    run_one(target, data, seeded_input(target, index, data));
}

/* Runs a file; its size, or -1 where there is none. */
static long run_file(int target, const char *path, uint8_t data[MOST_INPUT])
{
    FILE *stream = fopen(path, "rb");
    size_t size;

    if (!stream)
        return -1;
    size = fread(data, 1, MOST_INPUT, stream);
    fclose(stream);
    snprintf(running, sizeof running, "%s", path);
    run_one(target, data, size);
    return (long)size;
}

/* The path of file `index` of a target's corpus. */
static const char *corpus_path(const char *directory, int target, int index)
{
    static char path[512];

    snprintf(path, sizeof path, "%s/%s/%02d", directory, targets[target].name, index);
    return path;
}

static int write_corpus(const char *directory)
{
    uint8_t data[MOST_INPUT];
    int target, i;

    for (target = 0; target < TARGETS; target++)
        for (i = 0; i < SEEDED; i++) {
            const size_t size = seeded_input(target, i, data);
            const char *path = corpus_path(directory, target, i);
            FILE *stream = fopen(path, "wb");

            if (!stream || fwrite(data, 1, size, stream) != size || fclose(stream)) {
                fprintf(stderr, "cannot write %s\n", path);
                return 1;
            }
        }
    return 0;
}

static void test_target(int target, int count)
{
    uint8_t data[MOST_INPUT], seeded[MOST_INPUT];
    int i, same = 0, files = 0;
    long size;

    for (;; files++) {
        size = run_file(target, corpus_path("tests/corpus", target, files), data);
        if (size < 0)
            break;
        same += files < SEEDED && (size_t)size == seeded_input(target, files, seeded)
             && !memcmp(data, seeded, (size_t)size);
    }
    for (i = SEEDED; i < SEEDED + count; i++)
        run_seeded(target, i);
    CHECK(same == SEEDED, "%s: %d files, %d inputs of fixed seeds; %d files are what `make corpus` "
          "writes", targets[target].name, files, count, same);
}

static int run_named(int argc, char **argv)
{
    const int target = target_named(argv[1]);
    uint8_t data[MOST_INPUT];
    int i;

    for (i = 3; i < argc; i++)
        if (run_file(target, argv[i], data) < 0) {
            fprintf(stderr, "cannot read %s\n", argv[i]);
            return 1;
        }
    for (i = SEEDED; i < SEEDED + atoi(argv[2]); i++)
        run_seeded(target, i);
    return 0;
}

int main(int argc, char **argv)
{
    static const int counts[TARGETS] = { 3000, 3000, 5000, 800, 5000, 5000 };
    int target;

    if (argc == 3 && !strcmp(argv[1], "corpus"))
        return write_corpus(argv[2]);
    signal(SIGABRT, on_abort);
#ifdef FUZZ_ASAN
    __sanitizer_set_death_callback(name_input);
#endif
    if (argc > 2)
        return run_named(argc, argv);
    for (target = 0; target < TARGETS; target++)
        test_target(target, counts[target]);
    return check_done();
}
