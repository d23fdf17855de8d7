/* Sequence of the arc: gas, strike, burning, crater fill, burn-back, stick check, post-flow; and what can go wrong. */
#ifndef WAAM_ARC_H
#define WAAM_ARC_H

#include "waam_types.h"

typedef enum {
    WAAM_ARC_OFF,
    WAAM_ARC_PURGE,
    WAAM_ARC_STRIKE,
    WAAM_ARC_RETRY,     /* pause before the next strike */
    WAAM_ARC_BURNING,
    WAAM_ARC_CRATER,
    WAAM_ARC_BURN_BACK,
    WAAM_ARC_SENSE,     /* source off: is the wire frozen in the bead? */
    WAAM_ARC_PULSE      /* it was: burn it off */
} waam_arc_phase_t;

typedef struct {
    waam_arc_phase_t phase;
    uint64_t phase_us;     /* time spent in this phase */
    uint32_t tries;
    uint64_t above_us, below_us; /* current above and below the threshold */
    uint64_t slow_wire_us, no_gas_us, free_us;
    uint64_t stalled_us;   /* wire below what was ordered and below the setpoint of the block */
    uint32_t pulses;       /* given in this stick check */
    bool may_pulse;        /* armed, homed, with a lease that lasts long enough */
    bool unchecked;        /* the arc went off without a stick check: no move before one */
    bool established;
    bool gas_asked;        /* M8 */
    bool gas;
    uint64_t gas_us;       /* gas has flowed for this long */
    uint64_t post_flow_us; /* left */
    double wire_mm_s, voltage_v; /* setpoints of the running block */
} waam_arc_t;

/* Purge, then strike, with all its tries ahead of it. */
void waam_arc_start(waam_arc_t *arc);
/* Proper end. `quick` leaves the crater fill out. Nothing happens when the arc is off or ending. */
void waam_arc_end(waam_arc_t *arc, bool quick, const waam_arc_config_t *config);
/* Output off now. */
void waam_arc_cut(waam_arc_t *arc, const waam_arc_config_t *config);
/* The source is on. */
bool waam_arc_output(const waam_arc_t *arc);
/* Between the purge and the end of the burn-back: more than a look at the wire. */
bool waam_arc_active(const waam_arc_t *arc);
/* Looks whether the wire is free; nothing happens unless the arc is off. */
void waam_arc_check(waam_arc_t *arc);
/* The wire speed that the phase asks for. */
double waam_arc_wire(const waam_arc_t *arc, double override, const waam_arc_config_t *config);
/* One tick; returns the fault that ended the arc, or WAAM_FAULT_NONE. `wire_command_mm_s` is what the feeder was told. */
waam_fault_t waam_arc_tick(waam_arc_t *arc, uint32_t dt_us, const waam_inputs_t *inputs, double wire_command_mm_s,
                          const waam_arc_config_t *config);

#endif
