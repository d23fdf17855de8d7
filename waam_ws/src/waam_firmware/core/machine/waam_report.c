/* Telemetry. */
#include <math.h>

#include "waam_internal.h"

enum { FLAG_ARC = 1, FLAG_ESTABLISHED = 2, FLAG_GAS = 4, FLAG_HOMED = 8, FLAG_ARMED = 16, FLAG_EMPTY = 32,
       FLAG_ESTOP = 64, FLAG_WIRE_JOG = 128, FLAG_UNDERFEED = 256 };

/* The wheel on the wire turns slower than the feeder is told; without a wheel nothing can be said. */
static bool underfeed(const waam_core_t *core)
{
    return core->inputs.process == WAAM_PROCESS_OK && core->arc.slow_wire_us >= core->config.arc.wire_underfeed_us;
}

static uint32_t flags(const waam_core_t *core)
{
    return (waam_arc_output(&core->arc) ? FLAG_ARC : 0) | (core->arc.established ? FLAG_ESTABLISHED : 0) |
           (core->arc.gas ? FLAG_GAS : 0) | (core->homed ? FLAG_HOMED : 0) | (core->armed ? FLAG_ARMED : 0) |
           (core->planner.count == 0 ? FLAG_EMPTY : 0) | (core->inputs.estop ? FLAG_ESTOP : 0) |
           (waam_wire_jogging(&core->wire) ? FLAG_WIRE_JOG : 0) | (underfeed(core) ? FLAG_UNDERFEED : 0);
}

static int64_t work_um(const waam_core_t *core, int axis)
{
    double machine_mm = (double)waam_core_steps(core, axis) / core->config.steps_per_mm[axis];
    return llround((machine_mm - core->work_mm[axis]) * 1000.0);
}

static double speed(const waam_core_t *core)
{
    return core->home.active ? fabs(core->home.speed_mm_s) : waam_core_speed(core);
}

static void send_fields(waam_core_t *core, const char *name, const int64_t *fields, size_t count)
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, name);
    for (size_t i = 0; i < count; i++) {
        if (i)
            waam_text_char(&text, ',');
        waam_text_int(&text, fields[i]);
    }
    waam_core_send(core, &text, WAAM_TX_TELEMETRY);
}

void waam_core_standoff_telemetry(waam_core_t *core)
{
    const waam_standoff_t *s = &core->standoff;
    const waam_standoff_config_t *c = &core->config.standoff;
    const int64_t fields[] = {
        (int64_t)core->now_us, c->source, s->known, s->alarm, (int64_t)lroundf(c->set_mm * 1000.0f),
        (int64_t)lroundf(s->measured_mm * 1000.0f), (int64_t)lroundf(s->correction_mm * 1000.0f),
    };
    core->standoff_due = false;
    send_fields(core, "D ", fields, sizeof fields / sizeof fields[0]);
}

static bool feels(const waam_core_t *core)
{
    return core->config.temperature.input != WAAM_TEMPERATURE_OFF && core->link.known;
}

void waam_core_temperature_read(waam_core_t *core)
{
    if (feels(core))
        waam_temperature_read(&core->temperature, &core->config.temperature, core->inputs.part_v);
    else
        core->temperature = (waam_temperature_t){0};
}

bool waam_core_temperature_telemetry(waam_core_t *core)
{
    waam_text_t line = {.length = 0};
    if (!feels(core) || !waam_temperature_line(&core->temperature, &core->config.temperature, core->now_us, &line))
        return false;
    waam_core_send(core, &line, WAAM_TX_TELEMETRY);
    return true;
}

void waam_core_telemetry(waam_core_t *core)
{
    const waam_inputs_t *in = &core->inputs;
    bool measured = in->process == WAAM_PROCESS_OK && waam_guard_plausible(core);
    const int64_t fields[] = {
        core->telemetry_sequence++, (int64_t)core->now_us, core->state, flags(core),
        work_um(core, 0), work_um(core, 1), work_um(core, 2), llround(speed(core) * 1000.0),
        llround(core->wire.speed_mm_s * 1000.0), measured ? llround(in->wire_mm_s * 1000.0) : 0,
        measured ? llround(in->current_a * 1000.0) : 0, measured ? llround(in->voltage_v * 1000.0) : 0,
        core->link.accepted, core->executed, (int64_t)waam_planner_free(&core->planner),
        llround(core->planner.override * 1000.0), llround(core->wire_override * 1000.0),
        (int64_t)(waam_core_lease_left_us(core) / 1000), core->underruns, core->fault,
    };
    send_fields(core, "T ", fields, sizeof fields / sizeof fields[0]);
    core->standoff_due = core->config.standoff.source != WAAM_STANDOFF_OFF;
}
