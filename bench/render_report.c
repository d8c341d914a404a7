/* render_report.c: see render_report.h. */
#include "render_report.h"

#include "../examples/common/image.h"
#include "../examples/render/lights.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

const char *const table_scenes[] = {"vase", "cube", "knot", "chrome", NULL};
const char *const table_all_scenes[] = {"vase", "cube", "knot", "metal", "chrome", NULL};
const char *const table_soft_scenes[] = {"vase", "cube", "knot", "metal", NULL};
const char *const table_glossy_scene[] = {"chrome", NULL};
const char *const table_metal_scene[] = {"metal", NULL};
const char *const table_ward_scene[] = {STAGE_WARD, NULL};

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

const table_method table_safe[TABLE_SAFE] = {
    {"inversion+mis", "inversion+mis", 0.0f, 0.0f, 0},
    {"inversion+mis c 1", "inversion+mis", 1.0f, 0.0f, 0},
    {"kd-warp+mis", "kd-warp+mis", 0.0f, 0.0f, 0},
    {"kd-warp+mis e 1.15", "kd-warp+mis", 0.0f, 1.15f, 0},
    {"kd-warp+mis c 1", "kd-warp+mis", 1.0f, 0.0f, 0},
    {"facing+mis c 1", "facing+mis", 1.0f, 0.0f, 0}
};

const table_lights table_lights_all[TABLE_LIGHTS] = {
    {"RELAXED", "relaxed", 1, 1}, {"DECOMPOSED", "decomposed", 1, 1},
    {"MEDIAN_CUT", "median-cut", 1, 1}, {"VARIANCE_CUT", "variance-cut", 1, 1},
    {"HALFTONE", "halftone", 1, 1}, {"RANDOM", "random", 1, 1},
    {"structured", "structured", 1, 1}, {"after TMMS", "TMMS", 1, 1}, {"after FHIS", "FHIS", 1, 1},
    {"RELAXED, 8 sets", "relaxed", LIGHTS_SETS, 1},
    {"RELAXED, 8 sets, upsampled", "relaxed", LIGHTS_SETS, 2},
    {"DECOMPOSED, 8 sets", "decomposed", LIGHTS_SETS, 1},
    {"DECOMPOSED, 8 sets, upsampled", "decomposed", LIGHTS_SETS, 2},
    {"MEDIAN_CUT, 8 sets", "median-cut", LIGHTS_SETS, 1},
    {"VARIANCE_CUT, 8 sets", "variance-cut", LIGHTS_SETS, 1},
    {"HALFTONE, 8 sets", "halftone", LIGHTS_SETS, 1},
    {"RANDOM, 8 sets", "random", LIGHTS_SETS, 1},
    {"structured, 8 sets", "structured", LIGHTS_SETS, 1},
    {"after TMMS, 8 sets", "TMMS", LIGHTS_SETS, 1}, {"after FHIS, 8 sets", "FHIS", LIGHTS_SETS, 1}
};

const table_ablation table_ablations[TABLE_ABLATIONS] = {
    {"IS+masking+kmeans", 0.0f, 0, {0.0f, 0.0f, 0.0f}, LIGHTS_SETS, 2, 0.0438, 0.0865},
    {"IS+kmeans", -1.0f, 0, {0.0f, 0.0f, 0.0f}, LIGHTS_SETS, 2, 0.0466, 0.0877},
    {"IS+masking", 0.0f, -1, {0.0f, 0.0f, 0.0f}, LIGHTS_SETS, 2, 0.0560, 0.0958},
    {"IS-only", -1.0f, -1, {0.0f, 0.0f, 0.0f}, LIGHTS_SETS, 2, 0.0599, 0.0988},
    {"all at full size", 0.0f, 0, {0.0f, 0.0f, 0.0f}, LIGHTS_SETS, 1, 0.0579, 0.1191},
    {"a single set", 0.0f, 0, {0.0f, 0.0f, 0.0f}, 1, 2, 0.0, 0.0},
    {"weights 1 0 0", 0.0f, 0, {1.0f, 0.0f, 0.0f}, LIGHTS_SETS, 2, 0.0, 0.0},
    {"weights 0 1 2", 0.0f, 0, {0.0f, 1.0f, 2.0f}, LIGHTS_SETS, 2, 0.0, 0.0}
};

const table_method table_filtered[TABLE_FILTERED] = {
    {"bsdf", "bsdf", 0.0f, 0.0f, 0}, {"kd-fit+mis", "kd-fit+mis", 0.0f, 0.0f, 0},
    {"kd-warp+mis c 1", "kd-warp+mis", 1.0f, 0.0f, 0},
    {"facing+mis c 1", "facing+mis", 1.0f, 0.0f, 0}
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

/* Of a map: geometric mean over its scenes of a number over that of another method; NaN where no
   scene has both. */
static double ratio_at(const cells *all, const char *const *scenes, const char *map,
                       const char *table, const char *label, const char *base_table,
                       const char *base, int which, int *count)
{
    double sum = 0.0;
    int s, found = 0;

    for (s = 0; scenes[s]; s++) {
        const double ratio = value_at(all, table, map, scenes[s], label, which)
                           / value_at(all, base_table, map, scenes[s], base, which);

        if (ratio > 0.0 && ratio < HUGE_VAL) {
            sum += log(ratio);
            found++;
        }
    }
    *count += found;
    return found ? exp(sum / found) : (double)NAN;
}

/* A number over that of another method, of all cells that both have. */
typedef struct ratios {
    double mean, worst;              /* geometric mean over maps; of the worst, over its scenes */
    const char *worst_map;
    int count;
} ratios;

static ratios compare_in(const cells *all, const char *const *scenes, const char *table,
                         const char *label, const char *base_table, const char *base, int which)
{
    ratios r = {0.0, 0.0, "", 0};
    int m;

    for (m = 0; m < REPORT_MAPS; m++) {
        const int before = r.count;
        const double ratio = ratio_at(all, scenes, report_maps[m], table, label, base_table, base,
                                      which, &r.count);

        if (r.count == before)
            continue;
        r.mean += log(ratio) * (r.count - before);
        if (ratio > r.worst) {
            r.worst = ratio;
            r.worst_map = report_maps[m];
        }
    }
    r.mean = r.count ? exp(r.mean / r.count) : (double)NAN;
    return r;
}

static ratios compare(const cells *all, const char *table, const char *label,
                      const char *base_table, const char *base, int which)
{
    return compare_in(all, table_scenes, table, label, base_table, base, which);
}

/* Rows of lights were added one after another: a picture that lacks the last of them counts in
   none, so that means are of the same pictures. */
static int is_whole(const cells *all, const char *table, const char *map, const char *where)
{
    return strcmp(table, "lights")
        || value_at(all, table, map, where, table_lights_all[TABLE_LIGHTS - 1].label, CELL_COUNT)
           > 0.0;
}

/* Arithmetic mean over all cells of a method; of logarithms, where `geometric`. */
static double mean_in(const cells *all, const char *const *scenes, const char *table,
                      const char *label, int which, int geometric)
{
    double sum = 0.0;
    int m, s, count = 0;

    for (m = 0; m < REPORT_MAPS; m++)
        for (s = 0; scenes[s]; s++) {
            const double value = value_at(all, table, report_maps[m], scenes[s], label, which);

            if (value == value && is_whole(all, table, report_maps[m], scenes[s])) {
                sum += geometric ? log(fmax(value, 1e-9)) : value;
                count++;
            }
        }
    if (!count)
        return (double)NAN;
    return geometric ? exp(sum / count) : sum / count;
}

static double mean_of(const cells *all, const char *table, const char *label, int which)
{
    return mean_in(all, table_all_scenes, table, label, which, 0);
}

/* Mean rank of a row among those from `first` to before `end`, 1 the best, by a number that is
   better where it is smaller. */
static double rank_of(const cells *all, const char *const *scenes, int number, int first, int end,
                      int which)
{
    double sum = 0.0;
    int m, s, i, count = 0;

    for (m = 0; m < REPORT_MAPS; m++)
        for (s = 0; scenes[s]; s++) {
            const double value = value_at(all, "lights", report_maps[m], scenes[s],
                                          table_lights_all[number].label, which);

            if (!(value == value) || !is_whole(all, "lights", report_maps[m], scenes[s]))
                continue;
            sum += 1.0;
            for (i = first; i < end; i++)
                sum += value_at(all, "lights", report_maps[m], scenes[s],
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
static void print_places(FILE *out, int places, double value)
{
    if (value == value)
        fprintf(out, " %.*f |", places, value);
    else
        fprintf(out, " |");
}

static void print_number(FILE *out, double value) { print_places(out, 2, value); }

/* Mean RMSE and FLIP of the softer scenes, and of the highly glossy one. */
static void print_errors(FILE *out, const cells *all, const char *table, const char *label)
{
    print_places(out, 4, mean_in(all, table_soft_scenes, table, label, CELL_RELATIVE, 0));
    print_places(out, 4, mean_in(all, table_soft_scenes, table, label, CELL_FLIP, 0));
    print_places(out, 4, mean_in(all, table_glossy_scene, table, label, CELL_RELATIVE, 0));
    print_places(out, 4, mean_in(all, table_glossy_scene, table, label, CELL_FLIP, 0));
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

/* A picture is one scene under one map. */
typedef struct pictures { int all, above; double worst; const char *map, *scene; } pictures;

/* Those of a method at equal time, by an error over that of inversion. */
static pictures count_pictures(const cells *all, const char *label, int which)
{
    pictures p = {0, 0, 0.0, "", ""};
    int m, s;

    for (m = 0; m < REPORT_MAPS; m++)
        for (s = 0; table_all_scenes[s]; s++) {
            const double ratio = value_at(all, "samplers-time", report_maps[m],
                                          table_all_scenes[s], label, which)
                               / value_at(all, "samplers", report_maps[m], table_all_scenes[s],
                                          table_safe[0].label, which);

            if (!(ratio > 0.0 && ratio < HUGE_VAL))
                continue;
            p.all++;
            p.above += ratio > 1.0;
            if (ratio > p.worst) {
                p.worst = ratio;
                p.map = report_maps[m];
                p.scene = table_all_scenes[s];
            }
        }
    return p;
}

static void print_pictures(FILE *out, const pictures *p)
{
    fprintf(out, " %d of %d | %.2f %s, %s |", p->above, p->all, p->worst, p->map, p->scene);
}

static void print_safe(FILE *out, const cells *all)
{
    const char *base = table_safe[0].label, *safest = "";
    double least = HUGE_VAL;
    int i, s;

    if (!(mean_in(all, table_metal_scene, "samplers", base, CELL_RELATIVE, 0) > 0.0))
        return;
    fprintf(out, "\n## Where the safe default is\n\nRelative RMSE in the time of %s with 16 "
            "samples, over its own, direct light, Sobol points, by scene:\ngeometric mean of the "
            "maps, and the worst map. Above 1: pictures of all; and the worst one. The last two "
            "are\nwithout the worst 0.2 %% of pixels, where fireflies are.\n\n| method |", base);
    for (s = 0; table_all_scenes[s]; s++)
        fprintf(out, " %s | worst |", table_all_scenes[s]);
    fprintf(out, " above 1 | worst picture | above 1 | worst picture |\n"
            "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
    for (i = 1; i < TABLE_SAFE; i++) {
        const char *label = table_safe[i].label;
        const pictures p = count_pictures(all, label, CELL_RELATIVE);
        const pictures trimmed = count_pictures(all, label, CELL_TRIMMED);

        fprintf(out, "| %s |", label);
        for (s = 0; table_all_scenes[s]; s++) {
            const char *const one[] = {table_all_scenes[s], NULL};
            const ratios r = compare_in(all, one, "samplers-time", label, "samplers", base,
                                        CELL_RELATIVE);

            print_ratio(out, &r);
        }
        print_pictures(out, &p);
        print_pictures(out, &trimmed);
        fprintf(out, "\n");
        if (p.worst < least) {
            least = p.worst;
            safest = label;
        }
    }
    fprintf(out, "\nThe safest is %s: no picture is above %.2f of inversion's error.\n", safest,
            least);
}

/* On how many maps filtered samples err less than the method. */
static int filtered_wins(const cells *all, const char *table, const char *label)
{
    int m, wins = 0;

    for (m = 0; m < REPORT_MAPS; m++)
        wins += value_at(all, table, report_maps[m], STAGE_WARD, FILTERED_LABEL, CELL_RELATIVE)
              < value_at(all, table, report_maps[m], STAGE_WARD, label, CELL_RELATIVE);
    return wins;
}

static void print_filtered(FILE *out, const cells *all)
{
    const char *rival = table_filtered[2].label;
    int i, count;
    char table[32];

    if (!(mean_in(all, table_ward_scene, "ward-time", FILTERED_LABEL, CELL_FLIP, 0) >= 0.0))
        return;
    fprintf(out, "\n## [Ergun et al. 2012], figure 7\n\nA sphere of Ward (0.5, 0.001), beside "
            "filtered importance sampling [Krivanek, Colbert 2008]: relative\nRMSE by samples a "
            "pixel, Sobol points, geometric mean of the maps; then how many samples go into the\n"
            "time of %d filtered ones, and RMSE, the worst ratio to the filtered RMSE, and mean "
            "FLIP there.\n\n| method | 4 | 16 | 64 | 256 | samples | RMSE | worst | FLIP |\n"
            "|---|---|---|---|---|---|---|---|---|\n", FILTERED_EQUAL);
    for (i = -1; i < TABLE_FILTERED; i++) {
        const char *label = i < 0 ? FILTERED_LABEL : table_filtered[i].label;
        const ratios r = compare_in(all, table_ward_scene, "ward-time", label, "ward-time",
                                    FILTERED_LABEL, CELL_RELATIVE);

        fprintf(out, "| %s |", label);
        for (count = 4; count <= 256; count *= 4) {
            snprintf(table, sizeof table, "ward-%d", count);
            print_places(out, 4, mean_in(all, table_ward_scene, table, label, CELL_RELATIVE, 1));
        }
        fprintf(out, " %.0f | %.4f | %.2f %s | %.4f |\n",
                mean_in(all, table_ward_scene, "ward-time", label, CELL_COUNT, 0),
                mean_in(all, table_ward_scene, "ward-time", label, CELL_RELATIVE, 1), r.worst,
                r.worst_map, mean_in(all, table_ward_scene, "ward-time", label, CELL_FLIP, 0));
    }
    fprintf(out, "\nMaps on which filtered samples err less than %s:", rival);
    for (count = 4; count <= 256; count *= 4) {
        snprintf(table, sizeof table, "ward-%d", count);
        fprintf(out, " %d at %d%s", filtered_wins(all, table, rival), count,
                count < 256 ? "," : ".\n");
    }
}

/* Rows of light methods, ranked among themselves. */
static void print_light_rows(FILE *out, const cells *all, int first, int end)
{
    int i;

    fprintf(out, "\n| lights | time | RMSE | rank | FLIP | rank | chrome, RMSE | FLIP |\n"
            "|---|---|---|---|---|---|---|---|\n");
    for (i = first; i < end; i++) {
        const char *label = table_lights_all[i].label;
        const ratios time = compare_in(all, table_all_scenes, "lights", label, "lights",
                                       table_lights_all[0].label, CELL_SECONDS);

        fprintf(out, "| %s | %.2f | %.4f | %.1f | %.4f | %.1f |", label, time.mean,
                mean_in(all, table_soft_scenes, "lights", label, CELL_RELATIVE, 0),
                rank_of(all, table_soft_scenes, i, first, end, CELL_RELATIVE),
                mean_in(all, table_soft_scenes, "lights", label, CELL_FLIP, 0),
                rank_of(all, table_soft_scenes, i, first, end, CELL_FLIP));
        print_places(out, 4, mean_in(all, table_glossy_scene, "lights", label, CELL_RELATIVE, 0));
        print_places(out, 4, mean_in(all, table_glossy_scene, "lights", label, CELL_FLIP, 0));
        fprintf(out, "\n");
    }
}

static void print_lights(FILE *out, const cells *all)
{
    static const char *const mis[] = {"kd-warp+mis", "facing+mis"};
    int i;

    if (!(mean_of(all, "lights", table_lights_all[0].label, CELL_FLIP) >= 0.0))
        return;
    fprintf(out, "\n## Lights, [Wu 2024] table 1\n\n32 lights: mean relative RMSE and mean FLIP "
            "over vase, cube, knot and metal, and mean ranks of both;\nthen those of the highly "
            "glossy scene. Time over that of RELAXED. A single set of lights:\n");
    print_light_rows(out, all, 0, TABLE_SINGLE);
    fprintf(out, "\nInterleaved, as Wu compares all of them. Upsampled: lights that are not "
            "EnvDirects at half the size.\n");
    print_light_rows(out, all, TABLE_SINGLE, TABLE_LIGHTS);
    fprintf(out, "\nIn the time that RELAXED takes:\n\n| lights or samples | how many | RMSE | "
            "FLIP | chrome, RMSE | FLIP |\n|---|---|---|---|---|---|\n");
    for (i = 0; i < TABLE_LIGHTS + 2; i++) {
        const char *label = i < TABLE_LIGHTS ? table_lights_all[i].label : mis[i - TABLE_LIGHTS];
        const double count = mean_of(all, "lights-time", label, CELL_COUNT);

        if (!(count >= 0.0))
            continue;
        fprintf(out, "| %s | %.0f |", label, count);
        print_errors(out, all, "lights-time", label);
        fprintf(out, "\n");
    }
}

static void print_ablation(FILE *out, const cells *all)
{
    const char *base = table_ablations[0].label;
    int i;

    if (!(mean_of(all, "ablation", base, CELL_FLIP) >= 0.0))
        return;
    fprintf(out, "\n## Lights, [Wu 2024] table 2\n\nDECOMPOSED in 8 sets, upsampled, without a "
            "part of it: mean relative RMSE and mean FLIP over maps,\nthe four scenes of table 1 "
            "and four seeds; RMSE over that of all, geometric mean and worst map; what is\n"
            "published; and the highly glossy scene. weights: of variance, extent and energy in "
            "EnvIndirects.\n\n| EnvDirects | RMSE | FLIP | chrome, RMSE | FLIP | over all | worst "
            "| published RMSE | FLIP |\n|---|---|---|---|---|---|---|---|---|\n");
    for (i = 0; i < TABLE_ABLATIONS; i++) {
        const table_ablation *a = &table_ablations[i];
        const ratios r = compare_in(all, table_soft_scenes, "ablation", a->label, "ablation", base,
                                    CELL_RELATIVE);

        fprintf(out, "| %s |", a->label);
        print_errors(out, all, "ablation", a->label);
        print_ratio(out, &r);
        print_places(out, 4, a->rmse > 0.0 ? a->rmse : (double)NAN);
        print_places(out, 4, a->flip > 0.0 ? a->flip : (double)NAN);
        fprintf(out, "\n");
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
        for (s = 0; table_scenes[s]; s++)
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
    const double first = mean_of(all, "calls-sample", table_calls[0].label, CELL_OWN);
    int i;

    if (!(first == first))              /* noise can make it negative */
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
            "render.csv. Maps: 18 real ones at 512x256; scenes, but where "
            "it is\nsaid: vase, cube, knot, chrome.\n",
            all->header, all->count);
    print_samplers(out, all, "samplers", "direct light");
    print_samplers(out, all, "bounces", "5 bounces");
    print_safe(out, all);
    print_calls(out, all);
    print_lights(out, all);
    print_ablation(out, all);
    print_ergun(out, all);
    print_filtered(out, all);
    print_product(out, all);
    good = !ferror(out);
    good &= fclose(out) == 0;
    if (!good) {
        remove(temporary);
        return image_fail(error, error_size, path, "cannot be written");
    }
    return image_publish(temporary, path, error, error_size);
}
