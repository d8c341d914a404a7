/* table_file.c: a table is made once, kept in a file, and opened without copying a byte of it.
 *
 *     table_file MAP TABLE     makes the table of a map, and writes it
 *     table_file TABLE         opens it, and draws a few directions
 *
 * MAP is a file, or a made-up map by name (see common/maps.h). The file is the table's bytes and
 * nothing else. It is mapped into memory where there is mmap, so that programs share one copy, and
 * read elsewhere. envsamp_kd_open checks all of it, so a damaged file is an error and no crash. A
 * file of a machine with the other byte order is one, too.
 */
#if !defined(_POSIX_C_SOURCE) && (defined(__unix__) || defined(__APPLE__))
#define _POSIX_C_SOURCE 200112L
#endif
#define ENVSAMP_IMPLEMENTATION
#include "../envsamp.h"

#include "common/image.h"
#include "common/maps.h"

#include <stdio.h>
#include <stdlib.h>

#if defined(__unix__) || defined(__APPLE__)
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#endif

/* ---- making and writing ---- */

static int write_table(const char *path, const envsamp_kd *kd, char *error)
{
    char temporary[IMAGE_PATH_MAX];
    size_t written;
    FILE *file;

    if (!image_temporary_path(path, temporary, error, 512))
        return 0;
    if (!(file = fopen(temporary, "wb")))
        return image_fail(error, 512, path, "cannot be created");
    written = fwrite(kd, 1, envsamp_kd_bytes(kd), file);
    if (fclose(file) == 0 && written == envsamp_kd_bytes(kd))
        return image_publish(temporary, path, error, 512);
    remove(temporary);
    return image_fail(error, 512, path, "cannot be written in full");
}

static int save(const char *map_path, const char *path, char *error)
{
    envsamp_buffer table = { NULL, 0 }, scratch;
    const envsamp_kd *kd = NULL;
    envsamp_result result;
    envsamp_sizes sizes;
    int good = 0;
    image map;

    if (!map_make(map_path, 512, 256, &map) && !image_read(map_path, &map, error, 512))
        return 0;
    const envsamp_image view = { map.rgb, map.width, map.height, 3, 0, ENVSAMP_LATLONG };

    envsamp_kd_sizes(&view, NULL, &sizes);      /* the build repeats what fails here */
    table.data = malloc(table.bytes = sizes.table_bytes);
    scratch.data = malloc(scratch.bytes = sizes.scratch_bytes);
    result = envsamp_kd_build(&view, NULL, table, scratch, &kd);
    free(scratch.data);
    image_free(&map);
    if (result == ENVSAMP_OK)
        good = write_table(path, kd, error);
    else
        image_fail(error, 512, map_path, "%s", envsamp_result_string(result));
    free(table.data);
    return good;
}

/* ---- opening ---- */

#if defined(__unix__) || defined(__APPLE__)
static void *map_file(const char *path, size_t *bytes, char *error)
{
    const int file = open(path, O_RDONLY | O_NONBLOCK);     /* a pipe ends at once */
    struct stat status;
    void *data = MAP_FAILED;

    if (file >= 0 && fstat(file, &status) == 0 && S_ISREG(status.st_mode) && status.st_size > 0) {
        *bytes = (size_t)status.st_size;
        data = mmap(NULL, *bytes, PROT_READ, MAP_PRIVATE, file, 0);
    }
    if (file >= 0)
        close(file);                            /* the mapping stays */
    if (data != MAP_FAILED)
        return data;
    image_fail(error, 512, path, "cannot be mapped");
    return NULL;
}

static void unmap_file(void *data, size_t bytes)
{
    munmap(data, bytes);
}
#else
static void *map_file(const char *path, size_t *bytes, char *error)
{
    return image_read_bytes(path, bytes, error, 512);
}

static void unmap_file(void *data, size_t bytes)
{
    (void)bytes;
    free(data);
}
#endif

static int load(const char *path, char *error)
{
    size_t bytes = 0;
    void *data = map_file(path, &bytes, error);
    const envsamp_kd *kd;
    envsamp_result result;
    envsamp_kd_info info;

    if (!data)
        return 0;
    result = envsamp_kd_open(data, bytes, &kd);
    if (result == ENVSAMP_OK) {
        envsamp_kd_get_info(kd, &info);
        printf("%d blocks in %zu bytes, integral %.6g\n", info.block_count, bytes, info.integral);
        for (int i = 0; i < 4; i++) {
            const envsamp_sample s = envsamp_kd_sample(kd, 0.2f + 0.2f * (float)i, 0.5f);

            printf("%9.6f %9.6f %9.6f, %.6g per steradian\n", (double)s.dir[0], (double)s.dir[1],
                   (double)s.dir[2], (double)s.pdf);
        }
    } else {
        image_fail(error, 512, path, "%s", envsamp_result_string(result));
    }
    unmap_file(data, bytes);
    return result == ENVSAMP_OK;
}

int main(int argc, char **argv)
{
    char error[512] = "usage: table_file MAP TABLE, or table_file TABLE";
    const int good = argc == 3 ? save(argv[1], argv[2], error) : argc == 2 && load(argv[1], error);

    if (!good)
        fprintf(stderr, "%s\n", error);
    return !good;
}
