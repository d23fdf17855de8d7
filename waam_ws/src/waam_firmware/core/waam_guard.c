/* Supervision: inputs, link, lease, arming, arc. */
#include <math.h>

#include "waam_internal.h"

uint64_t waam_core_lease_left_us(const waam_core_t *core)
{
    uint64_t end = core->lease_us + core->config.lease_us;
    return core->lease_us && end > core->now_us ? end - core->now_us : 0;
}

bool waam_inputs_plausible(const waam_inputs_t *in)
{
    return in->current_a > -100.0 && in->current_a < 2000.0 && in->voltage_v > -20.0 && in->voltage_v < 200.0 &&
           in->wire_mm_s > -2000.0 && in->wire_mm_s < 2000.0;
}

void waam_guard_inputs(waam_core_t *core, const waam_inputs_t *inputs)
{
    bool limit_edge = inputs->limit_switch && !core->inputs.limit_switch;
    core->inputs = *inputs;
    if (core->state == WAAM_ALARM)
        return;
    if (inputs->estop)
        waam_core_alarm(core, WAAM_E_ESTOP, "emergency stop");
    else if (limit_edge)
        waam_core_alarm(core, WAAM_E_LIMIT_SWITCH, "limit switch");
    else if (inputs->process == WAAM_PROCESS_LOST)
        waam_core_alarm(core, WAAM_E_INPUTS, "process inputs lost");
    else if (inputs->process == WAAM_PROCESS_OK && !waam_inputs_plausible(inputs))
        waam_core_alarm(core, WAAM_E_INPUTS, "process inputs implausible");
}

/* The lease: the end is started so early that the output is off in time, and the output is cut in any case. */
void waam_guard_lease(waam_core_t *core)
{
    uint64_t left = waam_core_lease_left_us(core);
    if (!waam_arc_output(&core->arc))
        return;
    if (left <= core->config.arc.burn_back_us + core->config.lease_margin_us)
        waam_core_hold(core, WAAM_E_LEASE, "the arc lease expired", true);
    if (left == 0)
        waam_arc_cut(&core->arc, &core->config.arc);
}

void waam_guard_link(waam_core_t *core)
{
    bool silent = core->now_us - core->heard_us > core->config.link_timeout_us;
    if (!silent)
        return;
    waam_wire_stop_jog(&core->wire);
    if (core->state == WAAM_RUN)
        waam_core_hold(core, WAAM_E_LINK, "nothing heard from the host for 500 ms", false);
}

void waam_guard_armed(waam_core_t *core)
{
    if (core->arc.phase != WAAM_ARC_OFF && !core->armed)
        waam_core_hold(core, WAAM_E_NOT_ARMED, "disarmed with the arc on", false);
}

static const char *arc_fault_text(waam_code_t code)
{
    switch (code) {
    case WAAM_E_NO_ARC: return "no arc after the last try";
    case WAAM_E_ARC_LOST: return "the arc was lost";
    case WAAM_E_WIRE: return "the wire is slower than commanded";
    default: return "no gas flow";
    }
}

void waam_guard_arc(waam_core_t *core, uint32_t dt_us)
{
    waam_code_t fault = waam_arc_tick(&core->arc, dt_us, &core->inputs, core->wire.speed_mm_s, &core->config.arc);
    if (fault)
        waam_core_hold(core, fault, arc_fault_text(fault), false);
    double wire = fmin(waam_arc_wire(&core->arc, core->wire_override, &core->config.arc), core->config.wire_max_mm_s);
    waam_wire_tick(&core->wire, wire, core->config.wire_accel_mm_s2, dt_us * 1e-6);
}
