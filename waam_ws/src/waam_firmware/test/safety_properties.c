/* What only the core's own interface can show: other reactions than the usual ones, the fast tick's own cut, the signs of
 * life that an independent watchdog is fed by, temperature as a number. A burning arc on a small plant, tick by tick. */

#include "converter.h"
#include "core_bench.h"

static waam_fast_outputs_t fast_out;
static float voltage_v, current_a; /* of a burning arc */

static void fast(void)
{
    bool burns = out.arc;
    const waam_fast_inputs_t sample = {true, out.sense ? 12.0f : burns ? voltage_v : 0.0f, burns ? current_a : 0.0f};
    waam_core_fast(&core, &sample, &fast_out);
}

static void run(unsigned ms)
{
    for (unsigned i = 0; i < ms; i++) {
        for (int k = 0; k < 10; k++)
            fast();
        in.gas_ok = out.gas;
        in.wire_mm_s = out.wire_mm_s;
        core.heard_us = core.now_us;
        core.lease_us = core.now_us;
        waam_core_tick(&core, 1000, &in, &out);
    }
}

/* An arc that burns in the middle of a long move. */
static void weld(void)
{
    config.starts_in_alarm = false;
    config.monitor.stuck_us = 0;
    config.start_us = 1000000;
    power_up(on_line);
    voltage_v = 22.0f;
    current_a = 120.0f;
    core.homed = core.plan_homed = core.armed = true;
    run(10);
    send_line("M3 W5000 S22");
    send_line("G1 X300 F600");
    run(1000);
    CHECK(core.state == WAAM_RUN && core.arc.phase == WAAM_ARC_BURNING && core.motion.speed_mm_s > 0.0);
}

static void test_a_lost_arc_is_struck_again_where_that_is_configured(void)
{
    config = waam_config_default();
    config.policy[WAAM_FAULT_ARC_LOST] = (waam_policy_t){WAAM_REACT_RETRY, 1};
    weld();
    current_a = 0.0f;
    run(250);
    CHECK(core.state == WAAM_RUN && core.fault == WAAM_E_ARC_LOST && heard("try 1 of 1"));
    current_a = 120.0f;
    run(2000);
    CHECK(core.state == WAAM_RUN && core.fault == WAAM_OK && core.motion.speed_mm_s > 0.0);
    current_a = 0.0f;
    run(300);
    CHECK(core.state == WAAM_HOLD && core.fault == WAAM_E_ARC_LOST);
}

static void test_any_fault_can_be_an_alarm(void)
{
    config = waam_config_default();
    config.policy[WAAM_FAULT_STUBBING].reaction = WAAM_REACT_ALARM;
    weld();
    voltage_v = 2.0f;
    run(200);
    CHECK(core.state == WAAM_ALARM && core.fault == WAAM_E_STUBBING && !core.homed && !core.armed && !out.arc);
}

static void test_the_fast_tick_cuts_the_source_itself(void)
{
    config = waam_config_default();
    weld();
    voltage_v = 2.0f;
    unsigned i;
    for (i = 0; i < 1100 && fast_out.arc; i++) {
        fast();
        core.fast.age_us = 0; /* a tick has come, and not looked yet */
    }
    CHECK(!fast_out.arc && fast_out.voltage_v == 0.0f && core.fast.trip == WAAM_TRIP_SHORT && i < 1010);
}

/* 60 s of fast ticks; then the tick comes back and says what was. */
static void test_orders_that_no_tick_renews_end_after_20_ms(void)
{
    config = waam_config_default();
    weld();
    for (unsigned i = 1; i < 200; i++) {
        fast();
        CHECK(fast_out.arc && !fast_out.late);
    }
    for (unsigned i = 0; i < 600000; i++) {
        fast();
        CHECK(!fast_out.arc && fast_out.late && fast_out.voltage_v == 0.0f);
    }
    waam_core_tick(&core, 1000, &in, &out);
    CHECK(core.state == WAAM_ALARM && core.fault == WAAM_E_LATE && heard("E309 the controller's tick stood still"));
    CHECK(!out.arc && out.wire_mm_s == 0.0);
    fast();
    CHECK(!fast_out.arc && !fast_out.late);
    run(100);
    CHECK(core.state == WAAM_ALARM && core.fast.trip == WAAM_TRIP_NONE && !fast_out.late);
}

/* A tick may be late by all but 20 ms, again and again. */
static void test_a_healthy_tick_loses_no_arc(void)
{
    config = waam_config_default();
    weld();
    srand(7);
    for (int i = 0; i < 2000; i++) {
        for (int k = i % 3 ? rand() % 25 : rand() % 190; k > 0; k--) /* run: ten more */
            fast();
        run(1);
        CHECK(fast_out.arc && core.state == WAAM_RUN);
    }
}

/* Each tick takes longer than it may: none is missing, and all are late. */
static void test_ticks_that_fall_behind_are_an_alarm(void)
{
    config = waam_config_default();
    weld();
    in.late = true;
    run(1);
    CHECK(core.state == WAAM_ALARM && core.fault == WAAM_E_LATE && !out.arc && heard("20 ms behind"));
}

/* In ALARM nothing is hidden by a late tick. */
static void test_a_late_tick_does_not_hide_the_alarm_before_it(void)
{
    config = waam_config_default();
    waam_core_init(&core, &config, on_line, NULL);
    in = (waam_inputs_t){.late = true};
    for (int i = 0; i < 300; i++)
        fast();
    run(3);
    CHECK(core.state == WAAM_ALARM && core.fault == WAAM_E_POWER_UP);
}

static void test_a_sample_that_is_no_number_is_bridged_and_a_row_of_them_is_a_fault(void)
{
    config = waam_config_default();
    weld();
    float nan = strtof("nan", NULL);
    for (int k = 0; k < 15; k++) {
        waam_core_fast(&core, &(waam_fast_inputs_t){true, nan, 120.0f}, &fast_out);
        CHECK(fast_out.arc && fast_out.voltage_v > 20.0f && fast_out.voltage_v < 24.0f);
    }
    run(10);
    CHECK(core.state == WAAM_RUN);
    voltage_v = nan;
    run(5);
    CHECK(core.state == WAAM_ALARM && core.fault == WAAM_E_INPUTS && !fast_out.arc);
}

/* What the board's converter gives when a sensor is torn off or beyond its range. */
static void test_a_reading_at_the_end_of_the_converters_range_is_implausible(void)
{
    const float ends[][2] = {{22.0f, converter_current_a(CONVERTER_TOP)},
                             {22.0f, converter_current_a(0)},
                             {converter_voltage_v(CONVERTER_TOP), 120.0f}};
    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
        config = waam_config_default();
        converter_ranges(&config.monitor);
        weld();
        voltage_v = converter_voltage_v(CONVERTER_TOP - 1); /* just inside: a long arc, but a reading */
        current_a = converter_current_a(CONVERTER_TOP - 1);
        run(50);
        CHECK(core.state == WAAM_RUN);
        voltage_v = ends[i][0];
        current_a = ends[i][1];
        run(5);
        CHECK(core.state == WAAM_ALARM && core.fault == WAAM_E_INPUTS && !fast_out.arc);
    }
    CHECK(converter_voltage_v(0) >= config.monitor.voltage_min_v); /* no arc, no voltage: a good reading */
}

/* The fast tick interrupts the tick between its look at the trip and its orders. */
static void test_a_trip_that_comes_late_is_not_forgotten(void)
{
    config = waam_config_default();
    weld();
    waam_guard_arc(&core, 1000);
    voltage_v = 2.0f;
    for (unsigned i = 0; i < 1100 && fast_out.arc; i++, core.fast.age_us = 0)
        fast();
    CHECK(!fast_out.arc);
    waam_guard_orders(&core, 1000);
    voltage_v = 22.0f; /* and the short is gone at once */
    fast();
    CHECK(!fast_out.arc);
    run(1);
    CHECK(core.fault == WAAM_E_STUBBING && heard("try 1 of 2"));
}

static void test_torque_in_alarm(void)
{
    for (int off = 0; off < 2; off++) {
        config = waam_config_default();
        CHECK(config.drives_off_in_estop && !config.drives_off_in_alarm);
        config.drives_off_in_alarm = off;
        weld();
        CHECK(out.drives);
        in.process = WAAM_PROCESS_LOST;
        run(1);
        CHECK(core.state == WAAM_ALARM && out.drives == !off);
        in.estop = true; /* pressed during another alarm */
        run(1);
        CHECK(!out.drives);
        in = (waam_inputs_t){.process = WAAM_PROCESS_OK};
        run(100);
        CHECK(!out.drives);
        const char *text;
        CHECK(waam_core_reset(&core, &text) == WAAM_OK);
        run(1);
        CHECK(out.drives);
        in.estop = true;
        run(1);
        in.estop = false;
        run(100);
        CHECK(core.state == WAAM_ALARM && core.fault == WAAM_E_ESTOP && !out.drives); /* until the reset */
        CHECK(waam_core_reset(&core, &text) == WAAM_OK);
        in.drive_fault = true;
        run(1);
        CHECK(core.state == WAAM_ALARM && core.fault == WAAM_E_DRIVE && !out.drives && !out.arc);
        CHECK(waam_core_reset(&core, &text) == WAAM_E_DRIVE);
        in.drive_fault = false;
        run(100);
        CHECK(!out.drives); /* safe torque off until the reset */
        config.drives_off_in_estop = false;
        weld();
        in.estop = true;
        run(1);
        CHECK(core.state == WAAM_ALARM && out.drives);
    }
}

static void test_temperature_as_a_number(void)
{
    config = waam_config_default();
    weld();
    in.temperature_c = config.temperature_max_c - 1.0;
    run(100);
    CHECK(core.state == WAAM_RUN);
    in.temperature_c = config.temperature_max_c + 1.0;
    run(2);
    CHECK(core.state == WAAM_HOLD && core.fault == WAAM_E_OVER_TEMPERATURE && !out.arc);
}

static void test_running_dry_with_the_arc_on_ends_it_and_holds(void)
{
    config = waam_config_default();
    weld();
    while (core.planner.count > 0)
        run(1);
    run(600);
    CHECK(core.state == WAAM_HOLD && core.fault == WAAM_E_UNDERRUN && !out.arc && core.motion.speed_mm_s == 0.0);
}

static void test_the_watchdog_is_fed_only_while_all_three_loops_run(void)
{
    config = waam_config_default();
    weld();
    waam_core_linked(&core);
    CHECK(waam_core_alive(&core));
    CHECK(!waam_core_alive(&core)); /* nothing has run since */
    for (int missing = 0; missing < 3; missing++) {
        for (int i = 0; i < 50; i++) {
            if (missing != 0)
                fast();
            if (missing != 1)
                waam_core_tick(&core, 1000, &in, &out);
            if (missing != 2)
                waam_core_linked(&core);
            CHECK(!waam_core_alive(&core));
        }
        fast();
        waam_core_tick(&core, 1000, &in, &out);
        waam_core_linked(&core);
        CHECK(waam_core_alive(&core));
    }
}

static void test_a_board_starts_in_alarm_and_says_why(void)
{
    config = waam_config_default();
    waam_core_init(&core, &config, on_line, NULL);
    CHECK(core.state == WAAM_ALARM && core.fault == WAAM_E_POWER_UP);
    config.watchdog_reset = true;
    waam_core_init(&core, &config, on_line, NULL);
    CHECK(core.state == WAAM_ALARM && core.fault == WAAM_E_WATCHDOG);
    config.reset_reason = "undefined instruction: pc 08001234";
    waam_core_init(&core, &config, on_line, NULL);
    say("$I");
    CHECK(heard("! ALARM E307 undefined instruction: pc 08001234"));
    in = (waam_inputs_t){.process = WAAM_PROCESS_OK};
    out = (waam_outputs_t){0};
    run(1000);
    CHECK(core.state == WAAM_ALARM && !out.arc && !out.gas && !out.sense && out.wire_mm_s == 0.0);
}

static void test_voltage_by_wire(void)
{
    config = waam_config_default();
    config.regulator.actuator = WAAM_REGULATOR_WIRE;
    CHECK(waam_regulator_check(&config.regulator) != NULL); /* more wire lowers the voltage: the gain must say so */
    config.regulator.gain = -0.2f; /* V per mm/s */
    CHECK(waam_regulator_check(&config.regulator) == NULL);
    weld();
    double before = out.wire_mm_s;
    voltage_v = 22.5f; /* a long arc */
    run(50);
    CHECK(out.wire_mm_s > before + 1.0 && out.voltage_v == 22.0);
    run(2000);
    CHECK(out.wire_mm_s <= before + config.regulator.trim + 0.5 && core.state == WAAM_RUN);
}

int main(void)
{
    test_a_lost_arc_is_struck_again_where_that_is_configured();
    test_any_fault_can_be_an_alarm();
    test_the_fast_tick_cuts_the_source_itself();
    test_orders_that_no_tick_renews_end_after_20_ms();
    test_a_healthy_tick_loses_no_arc();
    test_ticks_that_fall_behind_are_an_alarm();
    test_a_late_tick_does_not_hide_the_alarm_before_it();
    test_a_sample_that_is_no_number_is_bridged_and_a_row_of_them_is_a_fault();
    test_a_reading_at_the_end_of_the_converters_range_is_implausible();
    test_a_trip_that_comes_late_is_not_forgotten();
    test_torque_in_alarm();
    test_temperature_as_a_number();
    test_running_dry_with_the_arc_on_ends_it_and_holds();
    test_the_watchdog_is_fed_only_while_all_three_loops_run();
    test_a_board_starts_in_alarm_and_says_why();
    test_voltage_by_wire();
    puts("safety: all properties hold");
    return 0;
}
