/* The standoff control in the whole controller: what it may move, when, and that every pulse of it is accounted for. A laser
 * over metal of a given height, a burning arc, tick by tick. */
#include <math.h>

#include "core_bench.h"

#define SPMM 320.0

static waam_fast_outputs_t fast_out;
static unsigned frames;
static float current_a;
static double metal_mm; /* below the torch: height over where the program takes it to be */
static bool sensor_dead;

static void hear(void *context, const char *line, size_t bytes, waam_tx_kind_t kind)
{
    frames += line[0] == 'D';
    on_line(context, line, bytes, kind);
}

/* Z of the machine by its pulses alone. */
static double pulses_mm(void) { return (double)out.pulses[2] / SPMM; }
static double z_start_mm;

static void run(unsigned ms)
{
    for (unsigned i = 0; i < ms; i++) {
        bool burns = out.arc;
        current_a = (float)(120.0 * (1.0 - 0.024 * (z_start_mm + pulses_mm() - 20.0 - metal_mm))); /* falls with the distance */
        const waam_fast_inputs_t sample = {true, out.sense ? 12.0f : burns ? 22.0f : 0.0f, burns ? current_a : 0.0f};
        for (int k = 0; k < 10; k++)
            waam_core_fast(&core, &sample, &fast_out);
        in.gas_ok = out.gas;
        in.wire_mm_s = out.wire_mm_s;
        if (!sensor_dead) {
            in.distance_reading++;
            in.distance = (float)(100.0 + z_start_mm + pulses_mm() - 20.0 - metal_mm + 0.01 * (double)(in.distance_reading % 3));
        }
        core.heard_us = core.lease_us = core.now_us;
        int64_t before[WAAM_AXES];
        memcpy(before, out.pulses, sizeof before);
        waam_state_t was = core.state;
        waam_core_tick(&core, 1000, &in, &out);
        double step_mm = (double)llabs(out.pulses[2] - before[2]) / SPMM;
        CHECK(step_mm <= config.max_speed_mm_s[2] * 1e-3 + 1.0 / SPMM);
        CHECK(was != WAAM_ALARM || core.state != WAAM_ALARM || step_mm == 0.0);
    }
}

static void switch_on(uint32_t source)
{
    config = waam_config_default();
    config.starts_in_alarm = false;
    config.monitor.stuck_us = 0;
    config.start_us = 1000000;
    config.standoff.source = source;
    power_up(hear);
    frames = 0;
    metal_mm = 0.0;
    sensor_dead = false;
    core.homed = core.plan_homed = core.armed = true;
    core.motion.steps[2] = (int32_t)(20.0 * SPMM);
    core.motion.datum_steps[2] = core.motion.steps[2];
    core.plan_mm[2] = core.path_mm[2] = z_start_mm = 20.0;
    run(10);
}

/* An arc that burns in the middle of a long move at z = 20. */
static void weld(uint32_t source)
{
    switch_on(source);
    send_line("M3 W5000 S22");
    send_line("G1 X300 F600");
    run(2500);
    CHECK(core.state == WAAM_RUN && core.arc.phase == WAAM_ARC_BURNING && core.motion.speed_mm_s > 0.0);
}

static void test_off_by_default_nothing_moves_z(void)
{
    CHECK(waam_config_default().standoff.source == WAAM_STANDOFF_OFF);
    weld(WAAM_STANDOFF_OFF);
    metal_mm = 3.0;
    run(3000);
    CHECK(out.pulses[2] == 0 && frames == 0 && !heard("E212"));
}

static void test_a_step_of_the_metal_is_followed_and_the_program_ends_where_it_says(void)
{
    weld(WAAM_STANDOFF_LASER);
    CHECK(fabs(pulses_mm()) < 0.1 && frames > 100);
    for (double step = 3.0; step >= -3.0; step -= 6.0) {
        metal_mm = step;
        run(4000);
        CHECK(fabs(pulses_mm() - step) < 0.1);
        CHECK(core.motion.steps[2] == (int32_t)(20.0 * SPMM)); /* the program knows nothing of it */
    }
    send_line("M5");
    send_line("G1 Z25 F3000");
    run(30000);
    CHECK(core.state == WAAM_IDLE && core.z_correction == 0);
    CHECK(out.pulses[2] == (int64_t)(5.0 * SPMM)); /* to the pulse */
    CHECK(!heard("E212"));
}

static void test_it_stays_where_it_is_in_a_hold_and_goes_on_after_it(void)
{
    weld(WAAM_STANDOFF_LASER);
    metal_mm = 2.0;
    run(3000);
    say("$P@1");
    run(1500);
    CHECK(core.state == WAAM_HOLD && waam_core_stands(&core));
    int64_t held = out.pulses[2];
    metal_mm = -2.0;
    run(1500);
    CHECK(out.pulses[2] == held);
    say("$R@2");
    run(5000);
    CHECK(core.state == WAAM_RUN && core.arc.phase == WAAM_ARC_BURNING && fabs(pulses_mm() + 2.0) < 0.1);
}

static void test_after_a_stop_or_an_alarm_the_position_is_where_the_pulses_are(void)
{
    for (int alarm = 0; alarm < 2; alarm++) {
        weld(WAAM_STANDOFF_LASER);
        metal_mm = 2.0;
        run(3000);
        if (alarm)
            in.estop = true;
        else
            say("$S@1");
        run(alarm ? 1 : 500);
        int64_t there = out.pulses[2];
        run(2000);
        CHECK(core.state == (alarm ? WAAM_ALARM : WAAM_IDLE) && out.pulses[2] == there && core.z_correction == 0);
        CHECK(core.motion.steps[2] - core.motion.datum_steps[2] == out.pulses[2]);
        CHECK(fabs(core.plan_mm[2] - (20.0 + pulses_mm())) < 1e-9);
    }
}

static void test_a_strike_waits_for_the_distance(void)
{
    switch_on(WAAM_STANDOFF_LASER);
    metal_mm = 3.0;
    send_line("M3 W5000 S22");
    send_line("G1 X300 F600");
    unsigned ms = 0;
    while (!out.arc && ms++ < 5000)
        run(1);
    CHECK(ms > 500 && ms < 2500 && fabs(pulses_mm() - 3.0) < 0.3);
}

/* 7 mm of metal more than the map knows, 6 mm of correction: the program lies in the metal. */
static void test_above_metal_that_is_too_high_the_torch_stays_above(void)
{
    weld(WAAM_STANDOFF_LASER);
    metal_mm = 5.0;
    run(4000);
    metal_mm = 7.0;
    for (int i = 0; i < 6000; i++) {
        run(1);
        CHECK(i < 2000 || fabs(pulses_mm() - 6.0) < 0.05);
    }
    CHECK(heard("! RUN E212 the correction stays at its limit: the metal is too high, the torch stays above it") && core.arc.phase == WAAM_ARC_BURNING);
    metal_mm = 2.0; /* and follows the metal when that falls again */
    run(5000);
    CHECK(fabs(pulses_mm() - 2.0) < 0.1 && core.standoff.alarms == 1);
    send_line("M5");
    send_line("G1 Z25 F3000");
    run(30000);
    CHECK(core.state == WAAM_IDLE && core.z_correction == 0 && out.pulses[2] == (int64_t)(5.0 * SPMM));
}

static void test_no_sensor_means_the_programmed_z_and_an_alarm_and_the_bead_goes_on(void)
{
    weld(WAAM_STANDOFF_LASER);
    metal_mm = 2.0;
    run(3000);
    sensor_dead = true;
    run(3000);
    CHECK(core.state == WAAM_RUN && core.arc.phase == WAAM_ARC_BURNING && core.motion.speed_mm_s > 0.0);
    CHECK(out.pulses[2] == 0 && heard("! RUN E212 no reading of the distance that can be believed; back to the programmed z") && core.fault == WAAM_OK);
    switch_on(WAAM_STANDOFF_LASER);
    sensor_dead = true;
    send_line("M3 W5000 S22");
    send_line("G1 X300 F600");
    run(6000);
    CHECK(core.arc.phase == WAAM_ARC_BURNING && out.pulses[2] == 0 && heard("! RUN E212"));
}

static void test_the_correction_stays_inside_the_soft_limits(void)
{
    switch_on(WAAM_STANDOFF_LASER);
    send_line("G1 Z1 F3000");
    send_line("M3 W5000 S22");
    send_line("G1 X300 F600");
    metal_mm = -22.0;
    for (int i = 0; i < 8000; i++) {
        run(1);
        CHECK(20.0 + pulses_mm() > -0.01);
    }
}

static void strike_by_the_arc(const char *setting)
{
    weld(WAAM_STANDOFF_OFF);
    switch_on(WAAM_STANDOFF_OFF);
    say("$C@1 set_mm 15");
    say("$C@2 kp 2");
    say(setting);
    say("$C@4 source 3");
    CHECK(core.config.standoff.source == WAAM_STANDOFF_ARC);
    send_line("M3 W5000 S22");
}

static void test_arc_sensing_follows_and_goes_home(void)
{
    strike_by_the_arc("$C@3 arc_wander_mm 0");
    send_line("G1 X300 F600");
    run(4000);
    metal_mm = 2.0;
    run(5000);
    CHECK(fabs(pulses_mm() - 2.0) < 0.3 && !heard("E212"));
}

/* Contact tip and wire wander. Metal that rose in one bead is still there under the next one; after a rest there is a new map,
 * and the torch begins on it. */
static void test_by_an_arc_that_wanders_the_map_is_the_reference_after_a_rest(void)
{
    strike_by_the_arc("$C@3 arc_wander_mm 0.5");
    send_line("G1 X280 F300");
    run(12000);
    metal_mm = 2.0;
    run(30000);
    double followed = pulses_mm();
    CHECK(followed > 1.0 && !heard("E212"));
    send_line("M5");
    send_line("G0 X10");
    send_line("M3 W5000 S22");
    send_line("G1 X60 F300");
    unsigned ms = 0;
    for (bool was_out = false; ms < 60000 && !(was_out && core.arc.phase == WAAM_ARC_BURNING); ms++) {
        was_out = was_out || core.arc.phase == WAAM_ARC_OFF;
        run(1);
    }
    CHECK(ms < 60000);
    run(3000);
    CHECK(pulses_mm() > 0.7 * followed);
    send_line("M5");
    for (ms = 0; ms < 60000 && core.state != WAAM_IDLE; ms++)
        run(1);
    CHECK(core.state == WAAM_IDLE && fabs(pulses_mm()) < 0.01);
    metal_mm = 0.0;
    send_line("M3 W5000 S22");
    send_line("G1 X200 F300");
    run(5000);
    CHECK(core.arc.phase == WAAM_ARC_BURNING && fabs(pulses_mm()) < 0.3 && !heard("E212"));
}

static void test_settings_are_checked(void)
{
    static const struct {
        const char *line, *answer;
    } cases[] = {
        {"$C@1 kp 4.5", "$C@1 ok"},
        {"$C@2 kp 99", "kp must lie within 0 .. 50"},
        {"$C@3 average 2.5", "average must be a whole number"},
        {"$C@4 average 9", "average must be a whole number within 1 .. 8"},
        {"$C@5 colour 1", "no setting has this name"},
        {"$C@6 kp", "a number is missing"},
        {"$C@7 kp 1 2", "too many"},
        {"$C@8 source 3", "$C@8 ok"},
        {"$C@9 down_mm 18", "$C@9 ok"},
        {"$C@10 source 4", "source must be a whole number"},
        {"$C@11", "$C@11 envelope_x=400"},
        {"$C@12 set_mm 20", "down_mm does not fit the source"},
        {"$C@13 source 0", "$C@13 ok"},
    };
    switch_on(WAAM_STANDOFF_OFF);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        say(cases[i].line);
        if (!strstr(LAST, cases[i].answer)) {
            fprintf(stderr, "%s: %s, expected %s\n", cases[i].line, LAST, cases[i].answer);
            exit(1);
        }
    }
    CHECK(core.config.standoff.kp == 4.5f && core.config.standoff.source == WAAM_STANDOFF_OFF);
    weld(WAAM_STANDOFF_LASER);
    say("$C@20 kp 1");
    CHECK(heard("only in IDLE"));
}

static void test_a_configuration_that_makes_no_sense_is_switched_off(void)
{
    config = waam_config_default();
    config.standoff.source = WAAM_STANDOFF_LASER;
    config.standoff.kp = strtof("nan", NULL);
    waam_core_init(&core, &config, on_line, NULL);
    CHECK(core.config.standoff.source == WAAM_STANDOFF_OFF);
}

int main(void)
{
    test_off_by_default_nothing_moves_z();
    test_a_step_of_the_metal_is_followed_and_the_program_ends_where_it_says();
    test_it_stays_where_it_is_in_a_hold_and_goes_on_after_it();
    test_after_a_stop_or_an_alarm_the_position_is_where_the_pulses_are();
    test_a_strike_waits_for_the_distance();
    test_above_metal_that_is_too_high_the_torch_stays_above();
    test_no_sensor_means_the_programmed_z_and_an_alarm_and_the_bead_goes_on();
    test_the_correction_stays_inside_the_soft_limits();
    test_arc_sensing_follows_and_goes_home();
    test_by_an_arc_that_wanders_the_map_is_the_reference_after_a_rest();
    test_settings_are_checked();
    test_a_configuration_that_makes_no_sense_is_switched_off();
    printf("standoff: all properties hold\n");
    return 0;
}
