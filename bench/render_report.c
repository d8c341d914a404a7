/* render_report.c: see render_report.h. */
#include "render_report.h"

#include "../examples/common/image.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

const char *const table_scenes[TABLE_SCENES] = {"vase", "cube", "knot", "chrome"};

const char *const report_maps[REPORT_MAPS] = {
    "apartment", "bridge", "city", "dawn", "esplanade", "forest", "hall", "lab", "lobby", "night",
    "park", "sky", "studio", "sunrise", "sunset", "venice", "warehouse", "workshop", "constant"
};

const table_method table_methods[TABLE_METHODS] = {
    {"inversion+mis", "inversion+mis", 0.0f, 0.0f, 0},
    {"inversion+mis c 1", "inversion+mis", 1.0f, 0.0f, 0},
    {"cdf+mis", "cdf+mis", 0.0f, 0.0f, 0},
    {"kd-alias+mis", "kd-alias+mis", 0.0f, 0.0f, 0},
    {"kd-warp+mis", "kd-warp+mis", 0.0f, 0.0f, 0},
    {"kd-warp+mis e 1.15", "kd-warp+mis", 0.0f, 1.15f, 0},
    {"kd-warp+mis c 1", "kd-warp+mis", 1.0f, 0.0f, 0},
    {"facing+mis", "facing+mis", 0.0f, 0.0f, 0},
    {"facing+mis e 1.15", "facing+mis", 0.0f, 1.15f, 0},
    {"facing+mis c 1", "facing+mis", 1.0f, 0.0f, 0},
    {"inversion", "inversion", 0.0f, 0.0f, 0},
    {"kd-fit", "kd-fit", 0.0f, 0.0f, 0},
    {"kd-warp", "kd-warp", 0.0f, 0.0f, 0},
    {"facing", "facing", 0.0f, 0.0f, 0},
    {"bsdf", "bsdf", 0.0f, 0.0f, 0}
};

const table_lights table_lights_all[TABLE_LIGHTS] = {
    {"RELAXED", "relaxed", 0, 1}, {"DECOMPOSED", "decomposed", 0, 1},
    {"MEDIAN_CUT", "median-cut", 0, 1}, {"VARIANCE_CUT", "variance-cut", 0, 1},
    {"HALFTONE", "halftone", 0, 1}, {"RANDOM", "random", 0, 1},
    {"structured", "structured", 0, 1}, {"after TMMS", "TMMS", 0, 1}, {"after FHIS", "FHIS", 0, 1},
    {"DECOMPOSED, 8 sets, upsampled", "decomposed", 1, 2},
    {"RELAXED, 8 sets", "relaxed", 1, 1}, {"RELAXED, 8 sets, upsampled", "relaxed", 1, 2}
};

const table_method table_ergun[TABLE_ERGUN] = {
    {"inversion", "inversion", 0.0f, 0.0f, 0}, {"kd-fit", "kd-fit", 0.0f, 0.0f, 0},
    {"kd-alias", "kd-alias", 0.0f, 0.0f, 0}, {"kd-warp", "kd-warp", 0.0f, 0.0f, 0},
    {"facing", "facing", 0.0f, 0.0f, 0}
};

const table_method table_product[TABLE_PRODUCT] = {
    {"bsdf", "bsdf", 0.0f, 0.0f, 0}, {"kd-warp", "kd-warp", 0.0f, 0.0f, 0},
    {"kd-warp+mis", "kd-warp+mis", 0.0f, 0.0f, 0}, {"facing", "facing", 0.0f, 0.0f, 0},
    {"facing+mis", "facing+mis", 0.0f, 0.0f, 0}
};

const table_method table_calls[TABLE_CALLS] = {
    {"inversion", "inversion+mis", 0.0f, 0.0f, 0}, {"cdf", "cdf+mis", 0.0f, 0.0f, 0},
    {"kd-fit", "kd-fit+mis", 0.0f, 0.0f, 0}, {"kd-alias", "kd-alias+mis", 0.0f, 0.0f, 0},
    {"kd-warp", "kd-warp+mis", 0.0f, 0.0f, 0},
    {"kd-warp, 16384 blocks", "kd-warp+mis", 0.0f, 0.0f, 16384},
    {"facing", "facing+mis", 0.0f, 0.0f, 0}
};

/* ---- where it was measured ---- */

static void cpu_name(char *name, size_t size)
{
    FILE *file = fopen("/proc/cpuinfo", "r");
    char line[256];

    snprintf(name, size, "unknown processor");
    while (file && fgets(line, sizeof line, file))
        if (!strncmp(line, "model name", 10) && strchr(line, ':')) {
            snprintf(name, size, "%s", strchr(line, ':') + 2);
            name[strcspn(name, "\n")] = 0;
            break;
        }
    if (file)
        fclose(file);
}

void report_header(char *header, size_t size, const char *flags, const char *commit,
                   const stage_config *direct, const stage_config *bounced)
{
    char cpu[128];

    cpu_name(cpu, sizeof cpu);
    snprintf(header, size,
             "# %s, %d threads, flags %s, commit %s\n"
             "# direct light %d x %d, 5 bounces %d x %d, two references of %u samples each",
             cpu, direct->threads, flags, commit, direct->width, direct->height, bounced->width,
             bounced->height, (unsigned)direct->reference_samples);
}

/* ---- means ---- */

static double value_at(const cells *all, const char *table, const char *map, const char *where,
                       const char *label, int which)
{
    char key[CELL_KEY];
    const cell *found;

    snprintf(key, sizeof key, "%s,%s,%s,%s", table, map, where, label);
    found = cells_find(all, key);
    return found ? found->value[which] : (double)NAN;
}

/* A number over that of another method, of all cells that both have. */
typedef struct ratios {
    double mean, worst;              /* geometric mean; of the worst map, over its scenes */
    const char *worst_map;
    int count;
} ratios;

static ratios compare(const cells *all, const char *table, const char *label,
                      const char *base_table, const char *base, int which)
{
    ratios r = {0.0, 0.0, "", 0};
    int m, s;

    for (m = 0; m < REPORT_MAPS; m++) {
        double sum = 0.0;
        int scenes = 0;

        for (s = 0; s < TABLE_SCENES; s++) {
            const double ratio = value_at(all, table, report_maps[m], table_scenes[s], label, which)
                               / value_at(all, base_table, report_maps[m], table_scenes[s], base,
                                          which);

            if (ratio > 0.0 && ratio < HUGE_VAL) {
                sum += log(ratio);
                scenes++;
            }
        }
        r.mean += sum;
        r.count += scenes;
        if (scenes && exp(sum / scenes) > r.worst) {
            r.worst = exp(sum / scenes);
            r.worst_map = report_maps[m];
        }
    }
    r.mean = r.count ? exp(r.mean / r.count) : (double)NAN;
    return r;
}

/* Arithmetic mean over all cells of a method. */
static double mean_of(const cells *all, const char *table, const char *label, int which)
{
    double sum = 0.0;
    int m, s, count = 0;

    for (m = 0; m < REPORT_MAPS; m++)
        for (s = 0; s < TABLE_SCENES; s++) {
            const double value = value_at(all, table, report_maps[m], table_scenes[s], label,
                                          which);

            if (value == value) {
                sum += value;
                count++;
            }
        }
    return count ? sum / count : (double)NAN;
}

/* Mean rank among methods, 1 the best, by a number that is better where it is smaller. */
static double rank_of(const cells *all, const char *table, int number, int which)
{
    double sum = 0.0;
    int m, s, i, count = 0;

    for (m = 0; m < REPORT_MAPS; m++)
        for (s = 0; s < TABLE_SCENES; s++) {
            const double value = value_at(all, table, report_maps[m], table_scenes[s],
                                          table_lights_all[number].label, which);

            if (!(value == value))
                continue;
            sum += 1.0;
            for (i = 0; i < TABLE_LIGHTS; i++)
                sum += value_at(all, table, report_maps[m], table_scenes[s],
                                table_lights_all[i].label, which) < value;
            count++;
        }
    return count ? sum / count : (double)NAN;
}

/* ---- tables ---- */

static void print_ratio(FILE *out, const ratios *r)
{
    if (r->count)
        fprintf(out, " %.2f | %.2f %s |", r->mean, r->worst, r->worst_map);
    else
        fprintf(out, " | |");
}

/* A column; empty where it was not measured. */
static void print_number(FILE *out, double value)
{
    if (value == value)
        fprintf(out, " %.2f |", value);
    else
        fprintf(out, " |");
}

static void print_samplers(FILE *out, const cells *all, const char *table, const char *title)
{
    const char *base = table_methods[0].label;
    char alone[32], equal[32], cost[32];
    int i;

    snprintf(alone, sizeof alone, "%s-independent", table);
    snprintf(equal, sizeof equal, "%s-time", table);
    snprintf(cost, sizeof cost, "%s-cost", table);
    if (!compare(all, table, base, table, base, CELL_RELATIVE).count)
        return;
    fprintf(out, "\n## Samplers, %s\n\nRelative RMSE over that of %s with 16 samples a pixel: "
            "geometric mean, and the worst map.\nTime: of a sample. c: compensation, e: exponent.\n"
            "\n| method | time | Sobol | worst | independent | worst | equal time, Sobol | worst | "
            "without the worst pixels | worst | FLIP | worst |\n"
            "|---|---|---|---|---|---|---|---|---|---|---|---|\n", title, base);
    for (i = 0; i < TABLE_METHODS; i++) {
        const char *label = table_methods[i].label;
        const ratios time = compare(all, cost, label, cost, base, CELL_SECONDS);
        const ratios sobol = compare(all, table, label, table, base, CELL_RELATIVE);
        const ratios random = compare(all, alone, label, alone, base, CELL_RELATIVE);
        const ratios fair = compare(all, equal, label, table, base, CELL_RELATIVE);
        const ratios trimmed = compare(all, equal, label, table, base, CELL_TRIMMED);
        const ratios flip = compare(all, equal, label, table, base, CELL_FLIP);

        fprintf(out, "| %s | %.2f |", label, time.mean);
        print_ratio(out, &sobol);
        print_ratio(out, &random);
        print_ratio(out, &fair);
        print_ratio(out, &trimmed);
        print_ratio(out, &flip);
        fprintf(out, "\n");
    }
}

static void print_lights(FILE *out, const cells *all)
{
    static const char *const mis[] = {"kd-warp+mis", "facing+mis"};
    int i;

    if (!(mean_of(all, "lights", table_lights_all[0].label, CELL_FLIP) >= 0.0))
        return;
    fprintf(out, "\n## Lights, [Wu 2024] table 1\n\n32 lights: mean relative RMSE and mean FLIP, "
            "and mean ranks of both. Time over that of\nRELAXED. Upsampled: lights that are not "
            "EnvDirects at half the size.\n\n| lights | time | RMSE | rank | FLIP | rank |\n"
            "|---|---|---|---|---|---|\n");
    for (i = 0; i < TABLE_LIGHTS; i++) {
        const char *label = table_lights_all[i].label;
        const ratios time = compare(all, "lights", label, "lights", table_lights_all[0].label,
                                    CELL_SECONDS);

        fprintf(out, "| %s | %.2f | %.4f | %.1f | %.4f | %.1f |\n", label, time.mean,
                mean_of(all, "lights", label, CELL_RELATIVE),
                rank_of(all, "lights", i, CELL_RELATIVE),
                mean_of(all, "lights", label, CELL_FLIP), rank_of(all, "lights", i, CELL_FLIP));
    }
    fprintf(out, "\nIn the time that RELAXED takes:\n\n| lights or samples | how many | RMSE | "
            "FLIP |\n|---|---|---|---|\n");
    for (i = 0; i < TABLE_LIGHTS + 2; i++) {
        const char *label = i < TABLE_LIGHTS ? table_lights_all[i].label : mis[i - TABLE_LIGHTS];
        const double count = mean_of(all, "lights-time", label, CELL_COUNT);

        if (count >= 0.0)
            fprintf(out, "| %s | %.0f | %.4f | %.4f |\n", label, count,
                    mean_of(all, "lights-time", label, CELL_RELATIVE),
                    mean_of(all, "lights-time", label, CELL_FLIP));
    }
}

static void print_ergun(FILE *out, const cells *all)
{
    static const char *const maps[] = {"sunset", "city", "constant"};
    int m, s, i, count;
    char table[32];

    if (!(mean_of(all, "ergun-8", table_ergun[0].label, CELL_PSNR) >= 0.0))
        return;
    fprintf(out, "\n## [Ergun et al. 2012], figures 3 to 6\n\nFrames a second over those of "
            "inversion at 8, 16, 32 and 64 samples a pixel, without MIS, independent\nnumbers; and "
            "PSNR in dB in the time that inversion takes for 8. Published: 72 : 19 frames on a GPU."
            "\n\n| map | scene | method | 8 | 16 | 32 | 64 | PSNR | of inversion |\n"
            "|---|---|---|---|---|---|---|---|---|\n");
    for (m = 0; m < 3; m++)
        for (s = 0; s < TABLE_SCENES; s++)
            for (i = 1; i < TABLE_ERGUN; i++) {
                const char *label = table_ergun[i].label, *base = table_ergun[0].label;

                if (!(value_at(all, "ergun-8", maps[m], table_scenes[s], label, CELL_PSNR) >= 0.0))
                    continue;
                fprintf(out, "| %s | %s | %s |", maps[m], table_scenes[s], label);
                for (count = 8; count <= 64; count *= 2) {
                    snprintf(table, sizeof table, "ergun-%d", count);
                    print_number(out, value_at(all, table, maps[m], table_scenes[s], base,
                                               CELL_SECONDS)
                                      / value_at(all, table, maps[m], table_scenes[s], label,
                                                 CELL_SECONDS));
                }
                print_number(out, value_at(all, "ergun-time", maps[m], table_scenes[s], label,
                                           CELL_PSNR));
                print_number(out, value_at(all, "ergun-8", maps[m], table_scenes[s], base,
                                           CELL_PSNR));
                fprintf(out, "\n");
            }
}

static void print_product(FILE *out, const cells *all)
{
    static const char *const methods[] = {"double", "triple", "bsdf", "kd-warp", "kd-warp+mis",
                                          "facing", "facing+mis"};
    int i;

    if (!compare(all, "product", "double", "product", "bsdf", CELL_RELATIVE).count)
        return;
    fprintf(out, "\n## Product sampling, [Szirmay-Kalos et al.] figures 1.6 and 1.7\n\n32 samples "
            "a pixel: relative RMSE and time over those of BSDF samples.\n\n| method | RMSE | "
            "worst map | time |\n|---|---|---|---|\n");
    for (i = 0; i < (int)(sizeof methods / sizeof methods[0]); i++) {
        const ratios error = compare(all, "product", methods[i], "product", "bsdf", CELL_RELATIVE);

        fprintf(out, "| %s |", methods[i]);
        print_ratio(out, &error);
        fprintf(out, " %.2f |\n", compare(all, "product", methods[i], "product", "bsdf",
                                          CELL_SECONDS).mean);
    }
}

static void print_calls(FILE *out, const cells *all)
{
    int i;

    if (!(mean_of(all, "calls-sample", table_calls[0].label, CELL_OWN) >= 0.0))
        return;
    fprintf(out, "\n## Calls in a renderer\n\nNanoseconds of a call while a frame of direct light "
            "is rendered by one thread: rays evict tables\nbetween calls. Mean over maps and "
            "scenes, methods by turns; what reading the clock costs is taken off.\n\n| method | "
            "sample | pdf |\n|---|---|---|\n");
    for (i = 0; i < TABLE_CALLS; i++)
        fprintf(out, "| %s | %.0f | %.0f |\n", table_calls[i].label,
                mean_of(all, "calls-sample", table_calls[i].label, CELL_OWN),
                mean_of(all, "calls-pdf", table_calls[i].label, CELL_OWN));
}

int report_write(const cells *all, const char *path, char *error, size_t error_size)
{
    char temporary[IMAGE_PATH_MAX];
    FILE *out;
    int good;

    if (!image_temporary_path(path, temporary, error, error_size))
        return 0;
    out = fopen(temporary, "w");
    if (!out)
        return image_fail(error, error_size, path, "cannot be written");
    fprintf(out, "# The renderer's tables (make tables)\n\n```\n%s```\n\n%zu cells in "
            "render.csv. Maps: 18 real ones at 512x256; scenes: vase, cube, knot, chrome.\n",
            all->header, all->count);
    print_samplers(out, all, "samplers", "direct light");
    print_samplers(out, all, "bounces", "5 bounces");
    print_calls(out, all);
    print_lights(out, all);
    print_ergun(out, all);
    print_product(out, all);
    good = !ferror(out);
    good &= fclose(out) == 0;
    if (!good) {
        remove(temporary);
        return image_fail(error, error_size, path, "cannot be written");
    }
    return image_publish(temporary, path, error, error_size);
}
