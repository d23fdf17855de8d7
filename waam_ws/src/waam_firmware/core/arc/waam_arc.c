#include "waam_arc.h"

#include <math.h>

#define GAS_WAIT_US 1000000u /* longest wait for the flow switch after the purge */
#define NONE WAAM_FAULT_NONE

static void enter(waam_arc_t *arc, waam_arc_phase_t phase)
{
    arc->phase = phase;
    arc->phase_us = arc->above_us = arc->below_us = arc->slow_wire_us = arc->stalled_us = arc->free_us = 0;
}

void waam_arc_start(waam_arc_t *arc)
{
    arc->tries = 0;
    enter(arc, WAAM_ARC_PURGE);
}

bool waam_arc_output(const waam_arc_t *arc)
{
    switch (arc->phase) {
    case WAAM_ARC_STRIKE:
    case WAAM_ARC_BURNING:
    case WAAM_ARC_CRATER:
    case WAAM_ARC_BURN_BACK:
    case WAAM_ARC_PULSE: return true;
    default: return false;
    }
}

bool waam_arc_active(const waam_arc_t *arc) { return arc->phase != WAAM_ARC_OFF && arc->phase != WAAM_ARC_SENSE; }

static void source_off(waam_arc_t *arc, waam_arc_phase_t next, const waam_arc_config_t *config)
{
    arc->post_flow_us = config->post_flow_us;
    arc->established = false;
    enter(arc, next);
}

void waam_arc_cut(waam_arc_t *arc, const waam_arc_config_t *config)
{
    if (arc->phase == WAAM_ARC_OFF)
        return;
    arc->unchecked = arc->unchecked || waam_arc_output(arc);
    if (arc->phase == WAAM_ARC_SENSE)
        enter(arc, WAAM_ARC_OFF);
    else
        source_off(arc, WAAM_ARC_OFF, config);
}

void waam_arc_check(waam_arc_t *arc)
{
    if (arc->phase != WAAM_ARC_OFF)
        return;
    arc->unchecked = true;
    arc->pulses = 0;
    enter(arc, WAAM_ARC_SENSE);
}

void waam_arc_end(waam_arc_t *arc, bool quick, const waam_arc_config_t *config)
{
    if (arc->phase == WAAM_ARC_BURNING)
        enter(arc, quick ? WAAM_ARC_BURN_BACK : WAAM_ARC_CRATER);
    else if (arc->phase == WAAM_ARC_CRATER && quick)
        enter(arc, WAAM_ARC_BURN_BACK);
    else if (arc->phase < WAAM_ARC_BURNING || arc->phase == WAAM_ARC_PULSE)
        waam_arc_cut(arc, config);
}

double waam_arc_wire(const waam_arc_t *arc, double override, const waam_arc_config_t *config)
{
    switch (arc->phase) {
    case WAAM_ARC_STRIKE: return arc->wire_mm_s * override * config->strike_wire_factor;
    case WAAM_ARC_BURNING: return arc->wire_mm_s * override;
    case WAAM_ARC_CRATER: return arc->wire_mm_s * override * config->crater_wire_factor;
    default: return 0.0;
    }
}

static void count(uint64_t *timer, bool running, uint32_t dt_us) { *timer = running ? *timer + dt_us : 0; }

static void gas_tick(waam_arc_t *arc, uint32_t dt_us, bool flow)
{
    if (!waam_arc_output(arc))
        arc->post_flow_us -= arc->post_flow_us < dt_us ? arc->post_flow_us : dt_us;
    arc->gas = arc->gas_asked || waam_arc_active(arc) || arc->post_flow_us > 0;
    count(&arc->gas_us, arc->gas, dt_us);
    count(&arc->no_gas_us, arc->gas && !flow, dt_us);
}

static waam_fault_t fault(waam_arc_t *arc, waam_fault_t fault, const waam_arc_config_t *config)
{
    waam_arc_cut(arc, config);
    return fault;
}

static waam_fault_t purge(waam_arc_t *arc, bool flow, const waam_arc_config_t *config)
{
    if (arc->gas_us >= config->purge_us && flow)
        enter(arc, WAAM_ARC_STRIKE);
    else if (arc->phase_us >= config->purge_us + GAS_WAIT_US)
        return fault(arc, WAAM_FAULT_GAS, config);
    return NONE;
}

/* Why there is no current: a wire that stalls is the cause, at the end of the spool for one. The wheel needs a while to
 * run down. */
static waam_fault_t cause(const waam_arc_t *arc, waam_fault_t otherwise, const waam_arc_config_t *config)
{
    return arc->stalled_us >= config->lost_us / 2 ? WAAM_FAULT_WIRE : otherwise;
}

static waam_fault_t strike(waam_arc_t *arc, const waam_arc_config_t *config)
{
    if (arc->above_us >= config->established_us) {
        arc->established = true;
        enter(arc, WAAM_ARC_BURNING);
    } else if (arc->phase_us >= config->strike_us) {
        if (++arc->tries >= config->tries)
            return fault(arc, cause(arc, WAAM_FAULT_NO_ARC, config), config);
        enter(arc, WAAM_ARC_RETRY);
    }
    return NONE;
}

static waam_fault_t burning(waam_arc_t *arc, const waam_arc_config_t *config)
{
    if (arc->below_us >= config->lost_us)
        return fault(arc, cause(arc, WAAM_FAULT_ARC_LOST, config), config);
    if (arc->slow_wire_us >= config->wire_fault_us)
        return fault(arc, WAAM_FAULT_WIRE, config);
    if (arc->no_gas_us >= config->gas_missing_us)
        return fault(arc, WAAM_FAULT_GAS, config);
    return NONE;
}

/* Sense voltage between wire and work: it breaks down when they touch. Without measurements nothing can be told. */
static waam_fault_t sense(waam_arc_t *arc, uint32_t dt_us, const waam_inputs_t *inputs, const waam_arc_config_t *config)
{
    count(&arc->free_us, inputs->voltage_v > config->free_v, dt_us);
    if (arc->free_us >= config->free_us || inputs->process != WAAM_PROCESS_OK) {
        arc->unchecked = false;
        enter(arc, WAAM_ARC_OFF);
    } else if (arc->phase_us >= config->sense_us) {
        if (!arc->may_pulse || arc->pulses >= config->pulses)
            return fault(arc, WAAM_FAULT_WIRE_STUCK, config);
        arc->pulses++;
        enter(arc, WAAM_ARC_PULSE);
    }
    return NONE;
}

static void after(waam_arc_t *arc, uint32_t limit_us, waam_arc_phase_t next)
{
    if (arc->phase_us >= limit_us)
        enter(arc, next);
}

waam_fault_t waam_arc_tick(waam_arc_t *arc, uint32_t dt_us, const waam_inputs_t *inputs, double wire_command_mm_s,
                           const waam_arc_config_t *config)
{
    bool current = waam_arc_output(arc) && inputs->current_a > config->established_a;
    gas_tick(arc, dt_us, inputs->gas_ok);
    arc->phase_us += dt_us;
    count(&arc->above_us, current && inputs->voltage_v > config->free_v, dt_us);
    count(&arc->below_us, !current, dt_us);
    count(&arc->slow_wire_us, inputs->wire_mm_s < config->wire_fault_ratio * wire_command_mm_s, dt_us);
    count(&arc->stalled_us, inputs->wire_mm_s < config->wire_fault_ratio * fmin(wire_command_mm_s, arc->wire_mm_s), dt_us);
    switch (arc->phase) {
    case WAAM_ARC_PURGE: return purge(arc, inputs->gas_ok, config);
    case WAAM_ARC_STRIKE: return strike(arc, config);
    case WAAM_ARC_RETRY: after(arc, config->retry_pause_us, WAAM_ARC_STRIKE); return NONE;
    case WAAM_ARC_BURNING: return burning(arc, config);
    case WAAM_ARC_CRATER: after(arc, config->crater_us, WAAM_ARC_BURN_BACK); return NONE;
    case WAAM_ARC_BURN_BACK:
        arc->pulses = 0;
        arc->unchecked = true;
        if (arc->phase_us >= config->burn_back_us)
            source_off(arc, WAAM_ARC_SENSE, config);
        return NONE;
    case WAAM_ARC_SENSE: return sense(arc, dt_us, inputs, config);
    case WAAM_ARC_PULSE:
        if (arc->phase_us >= config->pulse_us)
            source_off(arc, WAAM_ARC_SENSE, config);
        return NONE;
    default: return NONE;
    }
}
