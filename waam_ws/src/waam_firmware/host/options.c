#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "host.h"
#include "waam_scale.h"

static const char help[] =
    "virtual_controller: the WAAM controller core behind a pseudo-terminal\n"
    "\n"
    "It is no safety device, here or on a board: emergency stop, doors and interlocks belong into hardware that cuts power\n"
    "without asking a program.\n"
    "\n"
    "It speaks exactly what the board speaks over USB (docs/link_protocol.md): open the terminal,\n"
    "identify with $I, reset with $X, home with G28, arm with $A, stream numbered G-code.\n"
    "\n"
    "usage: virtual_controller [options]\n"
    "\n"
    "  --pty-link PATH   symbolic link to the terminal, so that its name is known beforehand.\n"
    "                    A link that an earlier run left there is replaced.\n"
    "  --plant PATH      listen on this Unix socket for the simulated cell (one client, lock-step of 10 ms).\n"
    "  --null-plant      instead of a cell: a plant that does nothing wrong. The arc burns 50 ms after the output is on\n"
    "                    with 180 A and 22 V, the encoder equals the command, gas flows when it is on, and there is\n"
    "                    an accelerometer that stands still.\n"
    "  --rate R          at most R simulated seconds per second; 1 = real time (default), 0 = no limit.\n"
    "                    Time runs faster than real time only while the host keeps up: the heartbeat and, while one is given\n"
    "                    or the arc is on, the lease are younger than 250 ms of controller time, and the host reads.\n"
    "                    A host that is later than that gets a fifth of real time until it reports or a watchdog acts;\n"
    "                    with R of 1 or less time never waits for the host.\n"
    "  --rest            at most real time while no job is armed, nothing moves and the arc is off: a graph that waits\n"
    "                    for its next job leaves the computer to others.\n"
    "  --epoch-us T      start the controller clock at T microseconds and declare that it is the time of ROS (clk=sync).\n"
    "                    Without it the clock starts at 0 (clk=free).\n"
    "  --events FILE     write every change of state, arc and gas with its controller time, for tests.\n"
    "  --start X,Y,Z     where the axes stand at first, machine mm (default 60,50,150). The controller does not know\n"
    "                    it: it must home. Home switches are at X 0, Y 0 and Z 200 (torch up), or where the controller\n"
    "                    is told that its axes end ($C envelope_z, home_direction_x).\n"
    "  --machine-steps X,Y,Z\n"
    "                    how many steps a mm of the machine really takes (default 320,320,320). The controller does not\n"
    "                    know it: it goes by its own steps per mm ($C steps_per_mm_x), and moves wrong until they agree.\n"
    "  --start-idle      start in IDLE, as if an operator had just acknowledged. Without it the controller starts as a board\n"
    "                    does: in ALARM (306) until a host resets it ($X) with the emergency stop released.\n"
    "  --help            this text\n"
    "\n"
    "Without --null-plant, and as long as no cell has connected to --plant, there are no arc and wire measurements:\n"
    "the machine homes and moves, but M3 is refused (E303). Once a cell was connected, losing it is an ALARM (303).\n"
    "\n"
    "examples:\n"
    "  virtual_controller --null-plant --pty-link /tmp/waam_tty\n"
    "      then, from another shell:  printf '$I*00\\n' is refused (its check is wrong) and asked for again;\n"
    "      a host such as the waam_bridge node computes the checks.\n"
    "  virtual_controller --plant /tmp/cell.sock --pty-link /tmp/waam_tty --rate 15 --epoch-us 1700000000000000\n"
    "\n"
    "It prints 'ready PATH-OF-TERMINAL' once it can be opened, and ends on SIGTERM or SIGINT, removing link and socket.\n";

static void usage(const char *what, const char *value)
{
    fprintf(stderr, "virtual_controller: %s%s%s (see --help)\n", what, value ? " " : "", value ? value : "");
    exit(2);
}

static double number(const char *option, const char *text, const char **end)
{
    char *stop;
    errno = 0;
    double value = strtod(text, &stop);
    if (stop == text || errno || !isfinite(value))
        usage(option, text);
    *end = stop;
    return value;
}

static double rate(const char *text)
{
    const char *end;
    double value = number("--rate needs a number, not", text, &end);
    if (*end || value < 0.0 || (value > 0.0 && value < 0.01) || value > 1e6)
        usage("--rate must be 0 or 0.01..1e6, not", text);
    return value;
}

static uint64_t epoch(const char *text)
{
    char *end;
    errno = 0;
    unsigned long long value = strtoull(text, &end, 10);
    if (end == text || *end || errno || text[0] == '-' || value > INT64_MAX)
        usage("--epoch-us needs a whole number of microseconds, not", text);
    return value;
}

static void triple(const char *text, const char *problem, double value[WAAM_AXES])
{
    const char *at = text;
    for (int i = 0; i < WAAM_AXES; i++) {
        value[i] = number(problem, at, &at);
        if (*at != (i < 2 ? ',' : '\0'))
            usage(problem, text);
        at++;
    }
}

static void machine_steps(const char *text, double steps_per_mm[WAAM_AXES])
{
    triple(text, "--machine-steps needs X,Y,Z, not", steps_per_mm);
    for (int i = 0; i < WAAM_AXES; i++)
        if (!(steps_per_mm[i] >= WAAM_STEPS_LEAST && steps_per_mm[i] <= WAAM_STEPS_MOST))
            usage("--machine-steps must be 10..2000, not", text);
}

static void start(const char *text, const waam_config_t *config, double start_mm[WAAM_AXES])
{
    triple(text, "--start needs X,Y,Z in mm, not", start_mm);
    for (int i = 0; i < WAAM_AXES; i++)
        if (start_mm[i] < config->limit_min_mm[i] || start_mm[i] > config->limit_max_mm[i])
            usage("--start is outside the machine:", text);
}

options_t options_parse(int argc, char **argv)
{
    static const struct option names[] = {
        {"pty-link", required_argument, NULL, 'l'}, {"plant", required_argument, NULL, 'p'},
        {"null-plant", no_argument, NULL, 'n'},     {"rate", required_argument, NULL, 'r'},
        {"epoch-us", required_argument, NULL, 't'}, {"events", required_argument, NULL, 'e'},
        {"start", required_argument, NULL, 's'},    {"start-idle", no_argument, NULL, 'i'},
        {"machine-steps", required_argument, NULL, 'm'},
        {"rest", no_argument, NULL, 'q'},           {"help", no_argument, NULL, 'h'},
        {NULL, 0, NULL, 0}};
    options_t o = {.rate = 1.0, .start_mm = {60.0, 50.0, 150.0}};
    waam_config_t config = waam_config_default();
    int option;
    memcpy(o.machine_steps, config.steps_per_mm, sizeof o.machine_steps);
    opterr = 0;
    while ((option = getopt_long(argc, argv, ":h", names, NULL)) != -1) {
        switch (option) {
        case 'l': o.pty_link = optarg; break;
        case 'p': o.plant = optarg; break;
        case 'n': o.null_plant = true; break;
        case 'i': o.start_idle = true; break;
        case 'q': o.rests = true; break;
        case 'r': o.rate = rate(optarg); break;
        case 't': o.epoch_us = epoch(optarg); o.clock_is_ros_time = true; break;
        case 'e': o.events = optarg; break;
        case 'm': machine_steps(optarg, o.machine_steps); break;
        case 's': start(optarg, &config, o.start_mm); break;
        case 'h': fputs(help, stdout); exit(0);
        case ':': usage("a value is missing after", argv[optind - 1]); break;
        default: usage("unknown option", argv[optind - 1]);
        }
    }
    if (optind < argc)
        usage("unknown argument", argv[optind]);
    if (o.plant && o.null_plant)
        usage("--plant and --null-plant exclude each other", NULL);
    return o;
}
