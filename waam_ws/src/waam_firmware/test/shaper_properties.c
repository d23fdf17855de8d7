/* Invariants of the input shaper in the whole controller, on random programs with dwells, arcs, overrides, holds, stops and
 * emergency stops, with random shapers: the machine ends exactly where it was told, and nowhere leaves the range of where the
 * planned motion has just been; nothing but a move begins before the shaped motion stands; no line is told as done early; an
 * alarm stops in its tick. A failed property prints the program's number. */
#include <math.h>

#include "random_programs.h"

#define PAST 512
#define LINES 1024

static uint32_t stops, holds, alarms, arcs, rounded;
static int32_t planned[PAST][WAAM_AXES];
static uint32_t ticks = 0, left_at[LINES];   /* tick in which the planned motion left a line */
static int64_t pulses[WAAM_AXES];
static int64_t passed[WAAM_AXES]; /* steps that homing went beyond the switches */
static bool arc_before;

static bool chance(double share) { return uniform(0.0, 1.0) < share; }

static void require(bool condition, const char *what, double got, double limit)
{
    if (condition)
        return;
    fprintf(stderr, "program %u, %.3f s, line %u: %s: %.9g, limit %.9g\n", (unsigned)number,
            (double)core->now_us * 1e-6, (unsigned)core->executed, what, got, limit);
    exit(1);
}

/* ---- what must hold after every tick ---- */

static void within_the_past(void)
{
    uint32_t span = core->shaper.on ? core->shaper.span : 0;
    for (int i = 0; i < WAAM_AXES; i++) {
        int32_t low = INT32_MAX, high = INT32_MIN, at = core->motion.steps[i] + core->lag[i];
        for (uint32_t k = 0; k <= span; k++) {
            int32_t then = planned[(ticks - k) % PAST][i];
            low = then < low ? then : low;
            high = then > high ? then : high;
        }
        require(at >= low && at <= high, "range of the planned motion (steps)", at, at < low ? low : high);
    }
}

/* The machine stood when the tick began in which this line was left. */
static bool stood(uint32_t left)
{
    for (uint32_t k = 1; k <= core->shaper.span + 1; k++)
        if (memcmp(planned[(left - k) % PAST], planned[(left - 1) % PAST], sizeof planned[0]) != 0)
            return false;
    return true;
}

static void no_line_early(uint32_t executed_before)
{
    for (uint32_t line = executed_before + 1; line <= core->executed; line++) {
        uint32_t left = left_at[line % LINES], since = ticks - left;
        require(left != UINT32_MAX, "a line is told that was never left", line, 0.0);
        if (!waam_shaper_settled(&core->shaper) && !stood(left))
            require(since >= core->shaper.span, "a line is told early (ticks)", since, core->shaper.span);
    }
}

static bool moved(void)
{
    bool any = false; /* an unshaped move may end and the next block begin in one tick */
    for (int i = 0; i < WAAM_AXES; i++)
        any = any || machine.outputs.pulses[i] != pulses[i];
    return any && core->shaper.on;
}

static void check_tick(uint32_t planned_before, uint32_t executed_before)
{
    const waam_config_t *c = &machine.config;
    for (uint32_t line = planned_before + 1; line <= core->planned; line++)
        left_at[line % LINES] = ticks;
    for (int i = 0; i < WAAM_AXES; i++) {
        double change = fabs((double)(machine.outputs.pulses[i] - pulses[i]));
        double most = c->max_speed_mm_s[i] * 1e-3 * c->steps_per_mm[i] + 1.0, at = waam_core_steps(core, i);
        require(change <= most, "steps in one tick", change, most);
        if (core->homed)
            require(at >= c->limit_min_mm[i] * c->steps_per_mm[i] - 0.5 && at <= c->limit_max_mm[i] * c->steps_per_mm[i] + 0.5, "soft limit",
                    at, 0.0);
        rounded += abs(core->lag[i]) > 1;
    }
    if (core->homed && !core->home.active)
        within_the_past();
    no_line_early(executed_before);
    bool stands = core->lag[0] == 0 && core->lag[1] == 0 && core->lag[2] == 0;
    require(core->state != WAAM_IDLE || (stands && core->done_count == 0), "IDLE before the motion is over", 0.0, 0.0);
    if (machine.outputs.arc && !arc_before)
        require(stands && !moved(), "an arc is struck on the way", 0.0, 0.0);
    if (core->state == WAAM_RUN && machine.outputs.arc && core->arc.phase != WAAM_ARC_BURNING && !core->retrying)
        require(!moved(), "an arc is struck or ended on the way", 0.0, 0.0);
    if (core->dwell_us > 1000)
        require(stands, "a dwell begins on the way", core->lag[0], core->lag[1]);
    arcs += machine.outputs.arc && !arc_before;
    arc_before = machine.outputs.arc;
    memcpy(pulses, machine.outputs.pulses, sizeof pulses);
}

static void tick(void)
{
    uint32_t planned_before = core->planned, executed_before = core->executed;
    beat();
    ticks++;
    host_harness_tick(&machine);
    memcpy(planned[ticks % PAST], core->motion.steps, sizeof planned[0]);
    check_tick(planned_before, executed_before);
}

/* Homing is not shaped: what comes after must not see it in the past. */
/* A home switch is passed by at most the way of a tick. */
static void look_for_switches(void)
{
    int64_t at[WAAM_AXES];
    host_harness_steps(&machine, at);
    for (int i = 0; i < WAAM_AXES; i++) {
        double most = ceil(machine.config.home_latch_mm_s * TICK_US * 1e-6 * machine.config.steps_per_mm[i]);
        passed[i] = at[i] - waam_core_steps(core, i);
        require(fabs((double)passed[i]) <= most, "steps beyond a home switch", (double)passed[i], most);
    }
}

static void home(void)
{
    send("G28");
    for (uint32_t i = 0, rests = 0; rests < WAAM_SHAPER_PAST; i++) {
        tick();
        rests = core->state == WAAM_IDLE ? rests + 1 : 0;
        require(i < 40000, "homes (ms)", i, 40000);
    }
    require(core->homed, "homed", 0.0, 1.0);
    look_for_switches();
}

static void run_until(waam_state_t state, uint32_t most)
{
    for (uint32_t i = 0; core->state != state || (state == WAAM_IDLE && core->planner.count); i++) {
        tick();
        require(i < most, "does not get there (ms)", i, most);
    }
}

/* ---- programs ---- */

static void configure(void)
{
    char text[60];
    for (int axis = 0; axis < WAAM_SHAPED_AXES; axis++) {
        char name = (char)('x' + axis);
        snprintf(text, sizeof text, "$C shape_%c_hz %.3f", name, uniform(5.0, 100.0));
        feed(text);
        snprintf(text, sizeof text, "$C shape_%c_damping %.4f", name, uniform(0.0, 0.2));
        feed(text);
        snprintf(text, sizeof text, "$C shape_%c %d", name, number % 7 ? (int)uniform(0.0, 6.999) : 0);
        feed(text); /* one that is too slow is refused: the axis stays unshaped */
    }
}

static void start(void)
{
    machine = (host_harness_t){.config = waam_config_default(), .null_plant = true, .start_mm = {1.0, 1.0, 199.0}};
    machine.config.starts_in_alarm = false;
    for (int i = 0; i < WAAM_AXES && number % 3; i++) /* in steps that differ from axis to axis */
        machine.config.steps_per_mm[i] = round(uniform(40.0, 77e3 / machine.config.max_speed_mm_s[i]) * 1e3) / 1e3;
    host_harness_source(&machine, TICK_US);
    waam_core_init(core, &machine.config, on_line, NULL);
    memset(left_at, 0xFF, sizeof left_at);
    memset(pulses, 0, sizeof pulses);
    memset(&machine.outputs, 0, sizeof machine.outputs);
    ticks = PAST;
    memset(planned, 0, sizeof planned);
    next_line = 1;
    arc_before = false;
    feed("$I");
    configure();
    feed("$A test");
    home();
    if (chance(0.8)) /* else at the limits */
        send("G0 X100 Y100 Z150");
}

static void random_line(double scale_mm, bool *lit)
{
    char text[100];
    double x = core->plan_mm[0] + uniform(-scale_mm, scale_mm), y = core->plan_mm[1] + uniform(-scale_mm, scale_mm);
    double z = core->plan_mm[2] + (chance(0.2) ? uniform(-scale_mm, scale_mm) : 0.0);
    x = fmin(360.0, fmax(0.0, x)), y = fmin(260.0, fmax(0.0, y)), z = fmin(200.0, fmax(0.0, z));
    double dice = uniform(0.0, 1.0), dx = x - core->plan_mm[0], dy = y - core->plan_mm[1];
    if (dice < 0.02)
        snprintf(text, sizeof text, "G4 P%.3f", uniform(0.0, 0.1));
    else if (dice < 0.04)
        snprintf(text, sizeof text, *lit ? "M5" : "M3 W6000 S22"), *lit = !*lit;
    else if (dice < 0.06)
        snprintf(text, sizeof text, "M7");
    else if (dice < 0.15 && hypot(dx, dy) > 0.01 && core->plan_mm[0] > 40.0 && core->plan_mm[1] > 40.0)
        /* its centre is on the perpendicular of the chord, 0.6 of it away */
        snprintf(text, sizeof text, "G2 X%.4f Y%.4f I%.4f J%.4f F%.1f", x, y, 0.5 * dx + 0.6 * dy, 0.5 * dy - 0.6 * dx,
                 uniform(100.0, 6000.0));
    else
        snprintf(text, sizeof text, "G1 X%.4f Y%.4f Z%.4f F%.1f", x, y, z, uniform(100.0, 6000.0));
    send(text);
}

/* A line is sent only where it fits, so that plan_mm is where the next one begins. */
static bool room(void) { return waam_planner_free(&core->planner) > 40 && core->link.ring_used == 0; }

static void restart(bool *lit)
{
    char text[40];
    snprintf(text, sizeof text, "$L %u", (unsigned)next_line);
    feed(text);
    *lit = false;
}

static void stop(bool *lit)
{
    stops++;
    feed("$S");
    run_until(WAAM_IDLE, 5000);
    restart(lit);
}

static void hold(void)
{
    holds++;
    feed("$P");
    for (int i = 0; i < 2000 && !(waam_core_stands(core) && core->arc.phase == WAAM_ARC_OFF); i++)
        tick();
    tick();
    int64_t stood[WAAM_AXES];
    memcpy(stood, pulses, sizeof stood);
    for (int i = 0; i < 20; i++)
        tick();
    require(memcmp(stood, pulses, sizeof stood) == 0 && core->lag[0] == 0 && core->lag[1] == 0, "HOLD stands", 0.0, 0.0);
    feed("$R");
    for (int i = 0; i < 5 && core->state == WAAM_HOLD; i++)
        tick();
}

/* An emergency stop in full motion: not a single pulse more. */
static void emergency(bool *lit)
{
    int64_t stood[WAAM_AXES];
    alarms++;
    memcpy(stood, pulses, sizeof stood);
    machine.inputs.estop = true;
    for (int i = 0; i < 50; i++)
        tick();
    require(core->state == WAAM_ALARM && memcmp(stood, pulses, sizeof stood) == 0, "ALARM moves", 0.0, 0.0);
    machine.inputs.estop = false;
    tick();
    feed("$X");
    feed("$A test");
    restart(lit);
    home();
}

static void run_program(void)
{
    bool lit = false;
    double scale_mm = exp(uniform(log(0.01), log(10.0)));
    seed = number * 1000003u;
    start();
    for (int left = 120; left > 0;) {
        while (left > 0 && room() && !core->stopping && core->state <= WAAM_RUN && chance(0.95)) {
            random_line(scale_mm, &lit);
            left--;
        }
        tick();
        if (chance(0.01)) {
            char text[40];
            snprintf(text, sizeof text, "$V %.0f 1000", uniform(100.0, 2000.0));
            feed(text);
        }
        if (chance(0.002) && core->state == WAAM_RUN)
            hold();
        else if (chance(0.0008))
            stop(&lit);
        else if (chance(0.0004))
            emergency(&lit);
        else if (core->state == WAAM_HOLD) /* the queue ran dry with the arc on */
            feed("$R");
    }
    if (core->state == WAAM_HOLD)
        feed("$R");
    send("M5");
    send("G90 G1 X12.3456 Y23.4567 Z150.0021 F3000");
    run_until(WAAM_IDLE, 600000);
    const double end_mm[WAAM_AXES] = {12.3456, 23.4567, 150.0021};
    int64_t at[WAAM_AXES];
    host_harness_steps(&machine, at);
    for (int i = 0; i < WAAM_AXES; i++)
        require(at[i] - passed[i] == llround(end_mm[i] * machine.config.steps_per_mm[i]), "steps at the end",
                (double)(at[i] - passed[i]), end_mm[i] * machine.config.steps_per_mm[i]);
    require(core->executed == next_line - 1, "last line", core->executed, next_line - 1);
}

int main(int argc, char **argv)
{
    uint32_t programs = argc > 1 ? (uint32_t)strtoul(argv[1], NULL, 10) : 150;
    for (number = argc > 2 ? (uint32_t)atoi(argv[2]) : 1; number <= programs; number++)
        run_program();
    require(stops && holds && alarms && arcs && rounded, "something was never tried", stops, holds);
    printf("%u random programs with %u holds, %u stops, %u emergency stops, %u arcs: all properties hold\n", (unsigned)programs,
           (unsigned)holds, (unsigned)stops, (unsigned)alarms, (unsigned)arcs);
    return 0;
}
