/* No axis ever moves further into a limit switch, and there is always a way out. A machine with a switch at both ends of each
 * axis, all in one chain, with contacts that bounce; jogs, homing, resets, power cuts and pushes by hand at random. */
#include <math.h>

#include "core_bench.h"

#define BEYOND_MM 2.0 /* from the end of the range to the limit switch */

static double start_mm[WAAM_AXES]; /* where the axes really stood when the pulses were 0 */
static unsigned bounce_ms, presses, ways_out, refused;
static bool was_pressed;
static uint64_t seed = 1;

static unsigned dice(unsigned sides)
{
    seed = seed * 6364136223846793005ull + 1442695040888963407ull;
    return (unsigned)(seed >> 33) % sides;
}

static double between(double low, double high) { return low + (high - low) * dice(100000) / 1e5; }

static double at_mm(int axis) { return start_mm[axis] + (double)out.pulses[axis] / config.steps_per_mm[axis]; }

/* How far an axis is beyond its switch; below 0: not at all. */
static double depth(int axis)
{
    double low = config.limit_min_mm[axis] - BEYOND_MM, high = config.limit_max_mm[axis] + BEYOND_MM;
    return fmax(low - at_mm(axis), at_mm(axis) - high);
}

static bool chain_open(void) { return depth(0) >= 0.0 || depth(1) >= 0.0 || depth(2) >= 0.0; }

static void switches(void)
{
    bool pressed = chain_open();
    bounce_ms = pressed != was_pressed ? (dice(3) ? 5 : 60) : bounce_ms ? bounce_ms - 1 : 0;
    if (pressed && !was_pressed)
        presses++;
    in.limit_switch = bounce_ms && pressed == was_pressed ? dice(2) : pressed;
    was_pressed = pressed;
    for (int i = 0; i < WAAM_AXES; i++)
        in.home_switch[i] = config.home_direction[i] < 0 ? at_mm(i) <= config.limit_min_mm[i]
                                                         : at_mm(i) >= config.limit_max_mm[i];
}

static void run(unsigned ms)
{
    while (ms--) {
        double before[WAAM_AXES];
        for (int i = 0; i < WAAM_AXES; i++)
            before[i] = depth(i);
        bool open = chain_open();
        switches();
        core.heard_us = core.now_us;
        waam_core_tick(&core, 1000, &in, &out);
        for (int i = 0; i < WAAM_AXES && open; i++)
            CHECK(depth(i) <= fmax(before[i], -1e-9)); /* no deeper, and no other axis goes in */
    }
}

static void jog(const double delta[WAAM_AXES], double speed_mm_min)
{
    char line[100];
    snprintf(line, sizeof line, "$J %.3f %.3f %.3f %.0f", delta[0], delta[1], delta[2], speed_mm_min);
    say(line);
    refused += strstr(LAST, "error E301") != NULL;
}

static void random_jog(void)
{
    double delta[WAAM_AXES] = {0};
    for (unsigned n = dice(3); n < 3; n++)
        delta[dice(3)] = between(-80.0, 80.0);
    jog(delta, dice(4) ? between(60.0, 6000.0) : 20.0);
}

static void home(void)
{
    char line[40];
    snprintf(line, sizeof line, "$L %u", (unsigned)core.link.accepted + 1);
    say(line);
    snprintf(line, sizeof line, "N%u G28", (unsigned)core.link.accepted + 1);
    say(line);
}

/* Power cut: the axes stay where they are, the controller forgets everything. */
static void switch_on(void)
{
    for (int i = 0; i < WAAM_AXES; i++)
        start_mm[i] = at_mm(i);
    config = waam_config_default();
    power_up(on_line);
    core.arc.unchecked = false;
    was_pressed = chain_open();
    run(5);
}

/* Only while it has stood for a while: who is quicker than that is not found out. */
static void push_by_hand(void)
{
    say("$S");
    run(2000);
    if (chain_open())
        return;
    int axis = (int)dice(WAAM_AXES);
    start_mm[axis] += between(0.0, 1.0) - at_mm(axis) +
                      (dice(2) ? config.limit_max_mm[axis] + BEYOND_MM : config.limit_min_mm[axis] - BEYOND_MM - 1.0);
    run(30);
}

static void something(void)
{
    switch (dice(12)) {
    case 0: home(); break;
    case 1: switch_on(); break;
    case 2: push_by_hand(); break;
    case 3: say("$S"); break;
    case 4:
    case 5:
    case 6: say("$X"); break;
    default: random_jog(); break;
    }
    run(dice(3) ? dice(300) : dice(20000));
}

/* A person who looks at the machine moves each axis off its switch. */
static void leave(void)
{
    say("$S");
    run(1000);
    for (int axis = 0; axis < WAAM_AXES; axis++) {
        for (int tries = 0; depth(axis) >= 0.0; tries++) {
            double delta[WAAM_AXES] = {0};
            CHECK(tries < 3);
            delta[axis] = at_mm(axis) > 0.0 ? -BEYOND_MM : BEYOND_MM;
            say("$X");
            run(5);
            jog(delta, 1200.0);
            CHECK(strstr(LAST, "$J ok"));
            run(1000);
            ways_out += depth(axis) < 0.0;
        }
    }
    run(100);
    say("$X");
    run(1);
    CHECK(!chain_open() && !core.limit.pressed);
}

static void test_no_axis_goes_further_into_a_switch(void)
{
    config = waam_config_default();
    for (int i = 0; i < WAAM_AXES; i++)
        start_mm[i] = between(config.limit_min_mm[i], config.limit_max_mm[i]);
    switch_on();
    for (unsigned round = 0; round < 150; round++) {
        for (unsigned i = 0; i < 12; i++)
            something();
        if (chain_open())
            leave();
    }
    CHECK(presses > 100 && ways_out > 50 && refused > 20);
}

/* A switch that does not let go: the way out ends. */
static void test_a_stuck_switch_ends_the_way_out(void)
{
    double way[WAAM_AXES] = {-50.0, 0.0, 0.0};
    for (int i = 0; i < WAAM_AXES; i++)
        start_mm[i] = 150.0;
    out = (waam_outputs_t){0};
    switch_on();
    say("$X");
    jog((double[]){50.0, 0.0, 0.0}, 1200.0);
    for (unsigned i = 0; i < 1000 || core.state == WAAM_RUN; i++) {
        in.limit_switch = i >= 200;
        waam_core_tick(&core, 1000, &in, &out);
        core.heard_us = core.now_us;
        if (core.state == WAAM_ALARM && i > 200 && i < 300) {
            CHECK(core.fault == WAAM_E_LIMIT_SWITCH);
            say("$X");
            jog((double[]){1.0, 0.0, 0.0}, 1200.0);
            CHECK(strstr(LAST, "error E301") && strstr(LAST, "X may only go down"));
            jog((double[]){0.0, -1.0, 0.0}, 1200.0);
            CHECK(strstr(LAST, "error E301") && strstr(LAST, "Y may not move"));
            start_mm[0] = at_mm(0) - (double)out.pulses[0] / config.steps_per_mm[0];
            way[0] = (double)out.pulses[0];
            jog((double[]){-50.0, 0.0, 0.0}, 1200.0);
        }
    }
    double moved = ((double)out.pulses[0] - way[0]) / config.steps_per_mm[0];
    CHECK(core.state == WAAM_ALARM && moved < -9.9 && moved > -10.1 && strstr(LAST, "still pressed"));
}

int main(void)
{
    test_no_axis_goes_further_into_a_switch();
    test_a_stuck_switch_ends_the_way_out();
    printf("limits: all properties hold (%u presses, %u ways out, %u refused)\n", presses, ways_out, refused);
    return 0;
}
