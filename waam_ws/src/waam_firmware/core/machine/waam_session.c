/* Immediate lines about the session: who is there, is he alive, which line comes next, how often he wants to hear. */
#include "waam_accel.h"
#include "waam_request.h"
#include "waam_scale.h"
#include "waam_wire_settings.h"

static void limits(waam_request_t *r)
{
    const waam_config_t *c = &r->core->config;
    for (int i = 0; i < 2 * WAAM_AXES; i++) {
        if (i)
            waam_text_char(&r->answer, ',');
        waam_text_fixed(&r->answer, i < WAAM_AXES ? c->limit_min_mm[i] : c->limit_max_mm[i - WAAM_AXES], 3);
    }
}

/* Zero of the work frame in machine coordinates. */
static void offset(waam_request_t *r)
{
    const waam_core_t *core = r->core;
    for (int i = 0; i < WAAM_AXES; i++) {
        if (i)
            waam_text_char(&r->answer, ',');
        waam_text_fixed(&r->answer, core->work_mm[i], 4);
    }
}

void waam_core_new_program(waam_core_t *core) { core->modal = (waam_modal_t){0}; }

static void field(waam_request_t *r, const char *name, uint64_t value)
{
    waam_text_add(&r->answer, name);
    waam_text_uint(&r->answer, value);
}

static void shaper(waam_request_t *r)
{
    const waam_shaper_config_t *c = &r->core->config.shaper;
    waam_text_add(&r->answer, "shape=");
    for (int i = 0; i < WAAM_SHAPED_AXES; i++) {
        if (i)
            waam_text_char(&r->answer, ',');
        waam_text_add(&r->answer, waam_shaper_name(c->axis[i].type));
        if (c->axis[i].type == WAAM_SHAPER_NONE)
            continue;
        waam_text_char(&r->answer, ':');
        waam_text_fixed(&r->answer, (double)c->axis[i].hz, 2);
        waam_text_char(&r->answer, ':');
        waam_text_fixed(&r->answer, (double)c->axis[i].damping, 3);
    }
    waam_text_add(&r->answer, " corner_mm=");
    waam_text_fixed(&r->answer, (double)c->corner_mm, 3);
}

static void describe(waam_request_t *r)
{
    waam_core_t *core = r->core;
    field(r, "WAAM_CONTROLLER_V1 fw=" WAAM_FIRMWARE_VERSION " boot=", core->config.boot_id);
    waam_text_add(&r->answer, core->config.clock_is_ros_time ? " clk=sync" : " clk=free");
    field(r, " blocks=", WAAM_BLOCKS);
    field(r, " rx=", WAAM_RING_BYTES);
    waam_text_add(&r->answer, " lim=");
    limits(r);
    for (int i = 0; i < WAAM_AXES; i++) {
        waam_text_add(&r->answer, i ? "," : " spmm=");
        waam_text_fixed(&r->answer, core->config.steps_per_mm[i], 3);
    }
    for (int i = 0; i < WAAM_SHAPED_AXES; i++) {
        waam_text_add(&r->answer, i ? "," : " accel=");
        waam_text_fixed(&r->answer, core->config.accel_mm_s2[i], 3);
    }
    waam_text_add(&r->answer, " off=");
    offset(r);
    field(r, " acc=", core->link.accepted);
    field(r, " exe=", core->executed);
    waam_text_add(&r->answer, " cap=WIRE,LEASE,OVR,CRC16,CRC32,G2,TOKEN,RATE,STANDOFF,SHAPE");
    if (core->config.accelerometer)
        waam_text_add(&r->answer, ",ACCEL");
    if (core->config.part_temperature)
        waam_text_add(&r->answer, ",TEMPERATURE");
    if (core->shaper.on) {
        waam_text_char(&r->answer, ' ');
        shaper(r);
    }
}

/* "$I keep": the host will say by $L which line comes next; until then the last accepted line cannot change.
 * "$I" alone: an idle controller starts to count at 1. */
void waam_order_identify(waam_request_t *r)
{
    waam_core_t *core = r->core;
    waam_skip_spaces(&r->args);
    bool keep = r->args.length - r->args.at >= 4 && r->args.text[r->args.at] == 'k';
    core->link.strong = core->link.check_digits == 10;
    core->telemetry_us = core->config.telemetry_us;
    core->recent_count = 0;
    waam_acceleration_want(&core->acceleration, false); /* of another host */
    if (keep) {
        waam_link_block(&core->link, false);
    } else if (core->state == WAAM_IDLE && core->planner.count == 0) {
        waam_link_resync(&core->link, 1);
        core->executed = 0;
        waam_core_new_program(core);
    }
    if (core->fault == WAAM_E_WATCHDOG && core->config.reset_reason)
        waam_core_tell(core, WAAM_E_WATCHDOG, core->config.reset_reason);
    describe(r);
}

/* The lease is what a node has seen of this clock, so it cannot lie in the future. */
void waam_order_heartbeat(waam_request_t *r)
{
    waam_core_t *core = r->core;
    waam_skip_spaces(&r->args);
    size_t start = r->args.at;
    while (r->args.at < r->args.length && r->args.text[r->args.at] > ' ' && r->args.text[r->args.at] <= '~')
        r->args.at++;
    size_t end = r->args.at;
    uint64_t lease;
    if (end == start || end - start > 32 || !waam_read_uint(&r->args, &lease) || !waam_at_end(&r->args)) {
        waam_request_refuse(r, WAAM_E_MISSING_WORD, "use $H <token> <lease_us>");
        return;
    }
    core->beat_us = core->now_us;
    core->lease_us = lease < core->now_us ? lease : core->now_us;
    waam_text_bytes(&r->answer, r->args.text + start, end - start);
    waam_text_char(&r->answer, ' ');
    waam_text_uint(&r->answer, core->now_us + core->since_tick_us);
}

/* "$L" alone: the settings of shaper, wire, axes and temperature, whatever the state; nothing is changed. */
static void tell_settings(waam_request_t *r)
{
    const waam_config_t *c = &r->core->config;
    shaper(r);
    waam_request_settings(r, waam_wire_settings, c);
    waam_request_settings(r, waam_scale_settings, c);
    waam_request_settings(r, waam_accel_settings, c);
    waam_request_settings(r, waam_accel_limits, c);
    if (c->part_temperature)
        waam_request_settings(r, waam_temperature_settings, &c->temperature);
}

void waam_order_resync(waam_request_t *r)
{
    waam_core_t *core = r->core;
    uint64_t next;
    if (waam_at_end(&r->args)) {
        tell_settings(r);
        return;
    }
    if (!waam_read_uint(&r->args, &next) || !waam_at_end(&r->args) || next == 0 || next > UINT32_MAX - 1) {
        waam_request_refuse(r, WAAM_E_NUMBER, "use $L <next line number>");
        return;
    }
    if (next <= core->link.accepted) {
        waam_request_refuse(r, WAAM_E_NUMBER, "that line was accepted already");
        return;
    }
    waam_link_resync(&core->link, (uint32_t)next);
    if (core->executed > core->link.accepted)
        core->executed = core->link.accepted;
    waam_request_ok(r);
}

void waam_order_telemetry_rate(waam_request_t *r)
{
    waam_core_t *core = r->core;
    double hz;
    if (!waam_request_numbers(r, &hz, 1))
        return;
    if (hz < 1.0 || hz > 1000.0) {
        waam_request_refuse(r, WAAM_E_NUMBER, "telemetry rate: 1..1000 Hz");
        return;
    }
    core->telemetry_us = (uint32_t)(1e6 / hz + 0.5);
    core->telemetry_due_us = core->now_us + core->telemetry_us;
    waam_request_ok(r);
}
