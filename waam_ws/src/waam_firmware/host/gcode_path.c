/* Runs a G-code file through the controller's own parser, planner and interpolator, without link, arc or real time, and
 * prints the path: what the machine would do, or why it would refuse. */
#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "host_harness.h"
#include "waam_internal.h"

static const char help[] =
    "gcode_path: the path that the controller makes of a G-code file\n"
    "\n"
    "The same parser, planner and interpolator as on the board, without link and real time. A line that the controller\n"
    "would refuse ends the run: FILE:LINE:COLUMN: E<code> <text>, exit status 1. The words: README of waam_firmware.\n"
    "\n"
    "usage: gcode_path [options] FILE        ('-' reads standard input)\n"
    "\n"
    "  --start X,Y,Z   where the machine stands, homed, machine mm (default 0,0,0)\n"
    "  --no-limits     no soft limits, to look at a program that was written for another machine\n"
    "  --every MM      distance between the points of an arc (default 0.5; an arc has at least 16 intervals)\n"
    "  --ticks         execute it in simulated time instead: a row for each millisecond\n"
    "  --override R    factor on the travel speed with --ticks, 0.1..2 (default 1)\n"
    "  --help          this text\n"
    "\n"
    "Without --ticks a row is a move, in machine coordinates and mm/s, before the override:\n"
    "  LINE rapid|line|arc SPEED X Y Z X Y Z ...\n"
    "With --ticks a row is\n"
    "  T_MS X_STEPS Y_STEPS Z_STEPS SPEED_MM_S WIRE_MM_S LINE_EXECUTED STATE\n"
    "and the last one, on standard error, sums up: time, length of the path, pulses of each axis.\n"
    "\n"
    "examples:\n"
    "  gcode_path part.nc\n"
    "  printf 'G1 F600 X75 Y50\\nG2 I-25\\n' | gcode_path --start 75,50,10 --ticks - | tail -1\n";

typedef struct {
    const char *name;
    double every_mm, override;
    bool no_limits, ticks;
    FILE *file;
    host_harness_t harness;
    double length_mm;
    uint64_t pulses[WAAM_AXES];
} run_t;

static run_t run;

static void fail(const char *what, const char *value)
{
    fprintf(stderr, "gcode_path: %s%s%s (see --help)\n", what, value ? " " : "", value ? value : "");
    exit(2);
}

static double number(const char *what, const char *text, const char **end)
{
    char *stop;
    double value = strtod(text, &stop);
    if (stop == text || !isfinite(value) || (!end && *stop))
        fail(what, text);
    if (end)
        *end = stop;
    return value;
}

static void start_at(const char *text)
{
    const char *at = text;
    for (int i = 0; i < WAAM_AXES; i++) {
        run.harness.start_mm[i] = number("--start needs X,Y,Z in mm, not", at, &at);
        if (*at != (i < 2 ? ',' : '\0') || fabs(run.harness.start_mm[i]) > 1e5)
            fail("--start needs X,Y,Z in mm, not", text);
        at++;
    }
}

static void options(int argc, char **argv)
{
    static const struct option names[] = {
        {"start", required_argument, NULL, 's'}, {"no-limits", no_argument, NULL, 'n'},
        {"every", required_argument, NULL, 'e'}, {"ticks", no_argument, NULL, 't'},
        {"override", required_argument, NULL, 'o'}, {"help", no_argument, NULL, 'h'}, {NULL, 0, NULL, 0}};
    int option;
    run.every_mm = 0.5;
    run.override = 1.0;
    opterr = 0;
    while ((option = getopt_long(argc, argv, ":h", names, NULL)) != -1) {
        switch (option) {
        case 's': start_at(optarg); break;
        case 'n': run.no_limits = true; break;
        case 'e': run.every_mm = number("--every needs mm, not", optarg, NULL); break;
        case 't': run.ticks = true; break;
        case 'o': run.override = number("--override needs a factor, not", optarg, NULL); break;
        case 'h': fputs(help, stdout); exit(0);
        case ':': fail("a value is missing after", argv[optind - 1]); break;
        default: fail("unknown option", argv[optind - 1]);
        }
    }
    if (optind + 1 != argc)
        fail("one FILE is needed", NULL);
    if (!(run.every_mm > 1e-4) || !(run.override >= 0.1 && run.override <= WAAM_OVERRIDE_MAX))
        fail("--every or --override is out of range", NULL);
    run.name = argv[optind];
    run.file = strcmp(run.name, "-") ? fopen(run.name, "r") : stdin;
    if (!run.file) {
        fprintf(stderr, "gcode_path: cannot read %s: %s\n", run.name, strerror(errno));
        exit(1);
    }
}

static void nothing(void *context, const char *line, size_t bytes, waam_tx_kind_t kind)
{
    (void)context, (void)line, (void)bytes, (void)kind;
}

static void start(void)
{
    waam_core_t *core = &run.harness.core;
    run.harness.config = waam_config_default();
    run.harness.config.starts_in_alarm = false;
    run.harness.null_plant = true;
    host_harness_source(&run.harness, TICK_US);
    for (int i = 0; i < WAAM_AXES && run.no_limits; i++) {
        run.harness.config.limit_min_mm[i] = -1e6;
        run.harness.config.limit_max_mm[i] = 1e6;
    }
    waam_core_init(core, &run.harness.config, nothing, NULL);
    for (int i = 0; i < WAAM_AXES; i++) {
        core->plan_mm[i] = core->path_mm[i] = run.harness.start_mm[i];
        core->motion.steps[i] = (int32_t)lround(run.harness.start_mm[i] * run.harness.config.steps_per_mm[i]);
        core->motion.datum_steps[i] = core->motion.steps[i];
    }
    core->homed = core->plan_homed = core->armed = true;
    core->inputs.process = WAAM_PROCESS_OK;
    waam_planner_set_override(&core->planner, run.override);
}

/* ---- geometry ---- */

static const char *kind_of(const waam_block_t *block)
{
    if (block->path.arc)
        return "arc";
    return run.harness.core.modal.motion == WAAM_MOTION_RAPID ? "rapid" : "line";
}

static void print_block(const waam_block_t *block)
{
    const waam_path_t *path = &block->path;
    double intervals = path->arc ? fmax(16.0, fmin(ceil(path->length_mm / run.every_mm), 1e5)) : 1.0;
    printf("%u %s %.6f", (unsigned)block->line, kind_of(block), block->nominal_mm_s);
    for (double i = 0.0; i <= intervals; i++) {
        double at_mm[WAAM_AXES];
        waam_path_point(path, i / intervals, at_mm);
        printf(" %.6f %.6f %.6f", at_mm[0], at_mm[1], at_mm[2]);
    }
    putchar('\n');
}

static void print_blocks(void)
{
    waam_planner_t *planner = &run.harness.core.planner;
    for (waam_block_t *block; (block = waam_planner_head(planner)) != NULL; waam_planner_pop(planner))
        if (block->kind == WAAM_BLOCK_MOVE)
            print_block(block);
}

/* ---- simulated time ---- */

static void tick(void)
{
    waam_core_t *core = &run.harness.core;
    int64_t before[WAAM_AXES];
    memcpy(before, run.harness.outputs.pulses, sizeof before);
    core->heard_us = core->beat_us = core->lease_us = core->now_us;
    host_harness_tick(&run.harness);
    for (int i = 0; i < WAAM_AXES; i++)
        run.pulses[i] += (uint64_t)llabs(run.harness.outputs.pulses[i] - before[i]);
    run.length_mm += core->motion.speed_mm_s * TICK_US * 1e-6;
    printf("%.0f %d %d %d %.6f %.6f %u %s\n", (double)core->now_us * 1e-3, core->motion.steps[0], core->motion.steps[1],
           core->motion.steps[2], core->motion.speed_mm_s, core->wire.speed_mm_s, (unsigned)core->executed,
           waam_state_name(core->state));
}

static void drain(size_t most)
{
    while (run.harness.core.planner.count > most && run.harness.core.state != WAAM_ALARM)
        tick();
}

/* ---- the file ---- */

static bool good_line(const char *text, size_t length, uint32_t number_of_line)
{
    waam_gcode_limits_t limits = {run.harness.config.wire_max_mm_s, run.harness.config.voltage_max_v};
    waam_command_t command;
    waam_error_t error;
    bool good = length <= WAAM_LINE_MAX
                    ? waam_gcode_parse(text, length, 0, &run.harness.core.modal, &limits, &command, &error)
                    : waam_fail(&error, WAAM_E_TOO_LONG, WAAM_LINE_MAX + 1, "the line is longer than 160 bytes");
    if (good && run.ticks)
        drain(WAAM_BLOCKS - 1);
    if (good && waam_core_plan(&run.harness.core, &command, number_of_line, &error))
        return true;
    fflush(stdout);
    fprintf(stderr, "%s:%u:%zu: E%03d %.*s\n", run.name, (unsigned)number_of_line, error.column, error.code,
            (int)error.text.length, error.text.text);
    return false;
}

static bool read_file(void)
{
    char text[1024];
    for (uint32_t line = 1; fgets(text, sizeof text, run.file); line++) {
        size_t length = strcspn(text, "\r\n");
        if (!good_line(text, length, line))
            return false;
        if (!run.ticks)
            print_blocks();
    }
    return true;
}

static void finish(void)
{
    drain(0);
    while (run.harness.core.state == WAAM_RUN && !run.harness.core.arc_wanted)
        tick();
    fprintf(stderr, "%.3f s, %.3f mm, pulses %llu %llu %llu\n", (double)run.harness.core.now_us * 1e-6, run.length_mm,
            (unsigned long long)run.pulses[0], (unsigned long long)run.pulses[1], (unsigned long long)run.pulses[2]);
}

int main(int argc, char **argv)
{
    options(argc, argv);
    start();
    bool good = read_file();
    if (good && run.ticks)
        finish();
    if (run.file != stdin)
        fclose(run.file);
    return good ? 0 : 1;
}
