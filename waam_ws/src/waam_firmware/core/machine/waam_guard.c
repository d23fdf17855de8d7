/* Supervision: inputs, link, lease, arming, arc; faults and what is done about them; orders for the fast tick. */
#include <math.h>

#include "waam_internal.h"

uint64_t waam_core_lease_left_us(const waam_core_t *core)
{
    uint64_t end = core->lease_us + core->config.lease_us;
    return core->lease_us && end > core->now_us ? end - core->now_us : 0;
}

bool waam_guard_plausible(const waam_core_t *core)
{
    const waam_inputs_t *in = &core->inputs;
    return waam_monitor_plausible(&core->config.monitor, (float)in->voltage_v, (float)in->current_a) &&
           in->wire_mm_s > -2000.0 && in->wire_mm_s < 2000.0;
}

bool waam_guard_drives(const waam_core_t *core)
{
    return core->state != WAAM_ALARM || !(core->estopped ? core->config.drives_off_in_estop : core->config.drives_off_in_alarm);
}

void waam_guard_inputs(waam_core_t *core, const waam_inputs_t *inputs, uint32_t dt_us)
{
    bool limit = waam_limit_look(&core->limit, inputs->limit_switch, inputs->home_switch, &core->config, dt_us);
    float voltage, current;
    core->inputs = *inputs;
    core->estopped = core->estopped || inputs->estop || inputs->drive_fault;
    if (waam_fast_mean(&core->fast, &voltage, &current)) {
        core->inputs.voltage_v = (double)voltage;
        core->inputs.current_a = (double)current;
    }
    if (core->state == WAAM_ALARM)
        return;
    if (inputs->estop)
        waam_core_alarm(core, WAAM_E_ESTOP, "emergency stop");
    else if (inputs->drive_fault)
        waam_core_alarm(core, WAAM_E_DRIVE, "fault of a drive");
    else if (limit)
        waam_core_alarm(core, WAAM_E_LIMIT_SWITCH, "limit switch");
    else if (inputs->late)
        waam_core_alarm(core, WAAM_E_LATE, "the controller's ticks are 20 ms behind");
    else if (inputs->process == WAAM_PROCESS_LOST)
        waam_core_alarm(core, WAAM_E_INPUTS, "process inputs lost");
    else if (inputs->process == WAAM_PROCESS_OK && !waam_guard_plausible(core))
        waam_core_alarm(core, WAAM_E_INPUTS, "process inputs implausible");
}

void waam_guard_limit(waam_core_t *core, uint32_t dt_us)
{
    int64_t pulses[WAAM_AXES];
    for (int i = 0; i < WAAM_AXES; i++)
        pulses[i] = waam_core_pulses(core, i);
    const char *why = waam_limit_step(&core->limit, pulses, &core->config, dt_us);
    if (!why)
        return;
    for (int i = 0; i < WAAM_AXES; i++)
        core->motion.steps[i] = (int32_t)(core->limit.pulses[i] + core->motion.datum_steps[i]) - core->lag[i] -
                                (i == 2 ? core->z_correction : 0);
    waam_core_alarm(core, WAAM_E_LIMIT_SWITCH, why);
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
    if (waam_arc_active(&core->arc) && !core->armed)
        waam_core_hold(core, WAAM_E_NOT_ARMED, "disarmed with the arc on", false);
}

static const struct {
    waam_code_t code;
    const char *text;
} faults[WAAM_FAULTS] = {
    [WAAM_FAULT_NO_ARC] = {WAAM_E_NO_ARC, "no arc after the last try"},
    [WAAM_FAULT_ARC_LOST] = {WAAM_E_ARC_LOST, "the arc was lost"},
    [WAAM_FAULT_STUBBING] = {WAAM_E_STUBBING, "stubbing: the wire stays short-circuited"},
    [WAAM_FAULT_BURN_BACK] = {WAAM_E_BURN_BACK, "burn-back: the arc climbs to the contact tip"},
    [WAAM_FAULT_WIRE] = {WAAM_E_WIRE, "the wire is slower than commanded"},
    [WAAM_FAULT_GAS] = {WAAM_E_GAS, "no gas flow"},
    [WAAM_FAULT_OVER_TEMPERATURE] = {WAAM_E_OVER_TEMPERATURE, "over-temperature"},
    [WAAM_FAULT_SENSOR] = {WAAM_E_INPUTS, "arc sensor implausible"},
    [WAAM_FAULT_WIRE_STUCK] = {WAAM_E_WIRE_STUCK, "the wire is frozen in the bead: cut it, then resume"},
};

/* Stops in RUN, strikes again and goes on; false: no try is left. */
static bool retry(waam_core_t *core, waam_fault_t fault, const char *text)
{
    const waam_policy_t *policy = &core->config.policy[fault];
    waam_text_t said = {.length = 0};
    if (policy->reaction != WAAM_REACT_RETRY || core->state != WAAM_RUN || core->stopping ||
        core->retries >= policy->tries)
        return false;
    core->retrying = true;
    waam_text_add(&said, text);
    waam_text_add(&said, "; try ");
    waam_text_uint(&said, ++core->retries);
    waam_text_add(&said, " of ");
    waam_text_uint(&said, policy->tries);
    said.text[said.length] = '\0';
    waam_core_state(core, WAAM_RUN, faults[fault].code, said.text);
    return true;
}

void waam_core_fault(waam_core_t *core, waam_fault_t fault, const char *text)
{
    if (!text)
        text = faults[fault].text;
    if (core->state == WAAM_ALARM)
        return;
    waam_arc_cut(&core->arc, &core->config.arc);
    if (core->config.policy[fault].reaction == WAAM_REACT_ALARM)
        waam_core_alarm(core, faults[fault].code, text);
    else if (!retry(core, fault, text))
        waam_core_hold(core, faults[fault].code, text, false);
}

bool waam_core_too_hot(const waam_core_t *core)
{
    return core->inputs.over_temperature || core->inputs.temperature_c > core->config.temperature_max_c;
}

static void temperature(waam_core_t *core)
{
    if (core->state == WAAM_RUN && waam_arc_active(&core->arc) && waam_core_too_hot(core))
        waam_core_fault(core, WAAM_FAULT_OVER_TEMPERATURE, NULL);
}

/* What the fast tick found. It stays tripped, with the source off, until this tick has given its orders. */
static void trip(waam_core_t *core)
{
    core->trip = (waam_trip_t)core->fast.trip;
    switch (core->trip) {
    case WAAM_TRIP_NONE: break;
    case WAAM_TRIP_SHORT: waam_core_fault(core, WAAM_FAULT_STUBBING, NULL); break;
    case WAAM_TRIP_LONG_ARC: waam_core_fault(core, WAAM_FAULT_BURN_BACK, NULL); break;
    case WAAM_TRIP_LATE:
        if (core->state != WAAM_ALARM)
            waam_core_alarm(core, WAAM_E_LATE, waam_trip_text(core->trip));
        break;
    default: waam_core_fault(core, WAAM_FAULT_SENSOR, waam_trip_text(core->trip)); break;
    }
}

static void recovered(waam_core_t *core)
{
    if (!core->arc_wanted)
        core->retries = 0;
    if (core->state == WAAM_RUN && core->fault && core->arc.phase == WAAM_ARC_BURNING)
        waam_core_state(core, WAAM_RUN, WAAM_OK, "the arc burns again");
}

/* The wire speed: of the arc's phase, or of the regulator where that works by wire. */
static double wire_speed(const waam_core_t *core)
{
    double wire = waam_arc_wire(&core->arc, core->wire_override, &core->config.arc);
    if (core->config.regulator.actuator == WAAM_REGULATOR_WIRE && core->fast.regulating &&
        core->arc.phase == WAAM_ARC_BURNING)
        wire = (double)core->fast.output;
    return fmin(wire, core->config.wire_max_mm_s);
}

void waam_guard_arc(waam_core_t *core, uint32_t dt_us)
{
    core->arc.may_pulse = core->armed && core->homed && core->state == WAAM_RUN &&
                          waam_core_lease_left_us(core) > core->config.arc.pulse_us + core->config.lease_margin_us;
    waam_fault_t fault = waam_arc_tick(&core->arc, dt_us, &core->inputs, core->wire.speed_mm_s, &core->config.arc);
    if (fault != WAAM_FAULT_NONE)
        waam_core_fault(core, fault, NULL);
    trip(core);
    temperature(core);
    recovered(core);
    waam_wire_tick(&core->wire, wire_speed(core), &core->config, dt_us * 1e-6);
}

/* ---- orders for the fast tick ---- */

static void limits(const waam_core_t *core, waam_fast_order_t *order)
{
    const waam_regulator_config_t *c = &core->config.regulator;
    float base = order->base, top = (float)core->config.voltage_max_v;
    if (c->actuator == WAAM_REGULATOR_WIRE)
        top = (float)core->config.wire_max_mm_s;
    order->tuning.low = base > c->trim ? base - c->trim : 0.0f;
    order->tuning.high = base + c->trim < top ? base + c->trim : top;
}

void waam_guard_orders(waam_core_t *core, uint32_t dt_us)
{
    const waam_config_t *config = &core->config;
    const waam_arc_t *arc = &core->arc;
    bool burning = arc->phase == WAAM_ARC_BURNING;
    bool regulate = burning && config->regulator.actuator != WAAM_REGULATOR_OFF;
    bool by_wire = config->regulator.actuator == WAAM_REGULATOR_WIRE;
    if (!regulate)
        waam_scheduler_start(&core->scheduler);
    waam_scheduler_tick(&core->scheduler, &config->regulator, (float)dt_us * 1e-6f,
                        core->inputs.process == WAAM_PROCESS_OK, (float)core->inputs.current_a,
                        (float)core->inputs.wire_mm_s);
    waam_fast_order_t order = {
        .arc = waam_arc_output(arc),
        .burning = burning,
        .regulate = regulate,
        .setpoint_v = (float)arc->voltage_v,
        .base = (float)(by_wire ? waam_arc_wire(arc, core->wire_override, &config->arc) : arc->voltage_v),
        .tuning = waam_scheduler_tuning(&core->scheduler, &config->regulator, WAAM_FAST_US * 1e-6f),
    };
    limits(core, &order);
    waam_fast_command(&core->fast, &order);
    if (core->trip != WAAM_TRIP_NONE)
        core->fast.trip = WAAM_TRIP_NONE; /* one that came after trip() had looked stays for the next tick */
    core->fast.ticked = true;
}

double waam_guard_source(const waam_core_t *core)
{
    bool regulated = core->fast.regulating && core->config.regulator.actuator == WAAM_REGULATOR_SOURCE &&
                     core->arc.phase == WAAM_ARC_BURNING;
    return !waam_arc_output(&core->arc) ? 0.0 : regulated ? (double)core->fast.output : core->arc.voltage_v;
}
