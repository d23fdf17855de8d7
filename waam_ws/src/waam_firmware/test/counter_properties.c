/* Counters that run as long as the controller is powered: each is set shortly before the end of its range, and nothing may
 * happen when it gets there. The counters of the board's own loop: test_target.py with the image waam_qemu_wrap. */

#include "core_bench.h"

static unsigned alarms;

static void hear(void *context, const char *line, size_t bytes, waam_tx_kind_t kind)
{
    (void)kind;
    on_line(context, line, bytes, WAAM_TX_ASSURED); /* telemetry, too */
    alarms += strncmp(line, "! ALARM", 7) == 0;
}

static void start(uint64_t start_us)
{
    config = waam_config_default();
    config.starts_in_alarm = false;
    config.start_us = start_us;
    power_up(hear);
    core.arc.unchecked = false;
    alarms = 0;
}

static void run(unsigned ms)
{
    for (unsigned i = 0; i < ms; i++) {
        core.heard_us = core.now_us;
        waam_core_tick(&core, 1000, &in, &out);
    }
}

static void jog(double x_mm, double speed_mm_min)
{
    char line[80];
    snprintf(line, sizeof line, "$J %.3f 0 0 %.0f", x_mm, speed_mm_min);
    say(line);
    CHECK(strstr(LAST, "$J ok"));
}

/* 6.7 km of one axis at 320 steps/mm. */
static void test_pulses_beyond_32_bits(void)
{
    start(1000000);
    core.motion.datum_steps[0] = -(int64_t)INT32_MAX + 100; /* as after many homings with a slipping axis */
    run(1);
    int64_t before = out.pulses[0];
    CHECK(before == (int64_t)INT32_MAX - 100);
    jog(10.0, 1200.0);
    for (int64_t last = before; core.state != WAAM_IDLE || core.planner.count; last = out.pulses[0]) {
        run(1);
        CHECK(out.pulses[0] >= last && out.pulses[0] - last <= 8);
    }
    CHECK(out.pulses[0] - before == 3200 && !alarms);
}

/* Homing that fails again and again in the same direction. */
static void test_positions_do_not_leave_32_bits_by_homing(void)
{
    start(1000000);
    static const int32_t ends[] = {-INT32_MAX + 1000, INT32_MAX - 1000};
    for (int i = 0; i < 2; i++) {
        core.motion.steps[2] = ends[i];
        core.motion.datum_steps[2] = 0;
        run(1);
        int64_t before = out.pulses[2];
        core.link.blocked = false;
        char line[40];
        snprintf(line, sizeof line, "N%u G28", (unsigned)core.link.accepted + 1);
        say(line);
        for (int64_t last = before; alarms == 0; last = out.pulses[2]) {
            run(1);
            CHECK(llabs(out.pulses[2] - last) <= 32);
        }
        CHECK(out.pulses[2] - before > 320 * 200 && core.fault == WAAM_E_NOT_HOMED);
        say("$X");
        alarms = 0;
    }
}

/* Microseconds in 32 bits end after 71.6 minutes, milliseconds after 49.7 days, 53 bits of a double after 285 years. */
static void test_time(void)
{
    static const uint64_t ends[] = {1ull << 31, 1ull << 32, (1ull << 32) * 1000, 1ull << 53};
    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
        start(ends[i] - 300000);
        jog(10.0, 1200.0);
        run(1000);
        CHECK(core.state == WAAM_IDLE && core.motion.steps[0] == 3200 && !alarms);
        CHECK(core.now_us == ends[i] + 700000 && core.telemetry_sequence == 100);
    }
}

static void test_telemetry_counts_modulo_2_to_the_32(void)
{
    start(1000000);
    core.telemetry_sequence = UINT32_MAX;
    run(10);
    CHECK(strncmp(LAST, "T 4294967295,", 13) == 0);
    run(10);
    CHECK(strncmp(LAST, "T 0,", 4) == 0);
}

/* Line numbers end; they do not begin again by themselves. */
static void test_the_last_line_number(void)
{
    start(1000000);
    core.homed = core.plan_homed = true;
    say("$L 4294967294");
    say("N4294967294 G1 X1 F600");
    CHECK(strncmp(LAST, "ok N4294967294 ", 15) == 0);
    say("N4294967295 G1 X2 F600");
    CHECK(strstr(LAST, "E102"));
    run(1000);
    CHECK(core.motion.steps[0] == 320 && core.executed == 4294967294u);
    say("$I");
    say("N1 G1 X2 F600");
    CHECK(strncmp(LAST, "ok N1 ", 6) == 0);
}

/* A line that comes again is not done again, however many came before. */
static void test_remembered_tokens(void)
{
    start(1000000);
    core.recent_count = WAAM_RECENT;
    for (unsigned i = 0; i < 100; i++) {
        char line[40];
        snprintf(line, sizeof line, "$J@%u 1 0 0 6000", i + 1);
        size_t queued = core.planner.count;
        say(line);
        CHECK(core.planner.count == queued + 1);
        say(line);
        CHECK(core.planner.count == queued + 1 && core.recent_count <= 2 * WAAM_RECENT);
        run(1000);
    }
}

int main(void)
{
    test_pulses_beyond_32_bits();
    test_positions_do_not_leave_32_bits_by_homing();
    test_time();
    test_telemetry_counts_modulo_2_to_the_32();
    test_the_last_line_number();
    test_remembered_tokens();
    puts("counters: all properties hold");
    return 0;
}
