/* The controller core: everything between the bytes of the link and the pins, without operating system, heap or clock.
 *
 *     waam_core_t core;                              (static; about 12 kB)
 *     waam_core_init(&core, &config, send, context);
 *     every tick (1 ms or finer):
 *         waam_core_rx(&core, byte)  for what has arrived, from the same thread as the tick
 *         waam_core_tick(&core, dt_us, &inputs, &outputs)
 *
 * The shell samples the inputs, spreads the new steps over the tick as pulses, sets the outputs and sends what `send` hands over.
 */
#ifndef WAAM_CORE_H
#define WAAM_CORE_H

#include "waam_arc.h"
#include "waam_gcode.h"
#include "waam_home.h"
#include "waam_link.h"
#include "waam_motion.h"
#include "waam_planner.h"
#include "waam_wire.h"

typedef struct {
    waam_config_t config;
    waam_kinematics_t kinematics;
    waam_tx_t send;
    void *context;

    uint64_t now_us;
    waam_state_t state;
    waam_code_t fault;          /* why HOLD or ALARM */
    bool homed, armed;
    bool stopping;              /* slowing down to forget the queue */
    bool resume_asked;          /* continue as soon as motion and arc have ended */
    bool arc_wanted;            /* between M3 and M5 of the executed program */

    waam_link_t link;
    waam_modal_t modal;
    waam_planner_t planner;
    waam_motion_t motion;
    waam_arc_t arc;
    waam_home_t home;
    waam_wire_t wire;
    waam_inputs_t inputs;       /* of the last tick */

    /* the end of what is planned */
    double plan_mm[WAAM_AXES];  /* machine coordinates, as commanded */
    int32_t plan_steps[WAAM_AXES];
    bool plan_homed, plan_arc;
    double work_mm[WAAM_AXES];  /* G54 in machine coordinates */
    double g92_mm[WAAM_AXES];   /* further shift by G92, of the program and of what has been executed alike */

    bool block_started;
    uint64_t dwell_us;
    double wire_override;
    uint64_t dry_us;            /* queue empty with the arc on */
    uint64_t heard_us;          /* last valid line */
    uint64_t beat_us;           /* last heartbeat; 0 = none yet */
    uint64_t lease_us;          /* controller time that the slowest node has seen; 0 = no lease */
    uint64_t telemetry_due_us;
    uint32_t telemetry_sequence, executed, underruns;
} waam_core_t;

waam_config_t waam_config_default(void);
void waam_core_init(waam_core_t *core, const waam_config_t *config, waam_tx_t send, void *context);
void waam_core_rx(waam_core_t *core, uint8_t byte);
void waam_core_tick(waam_core_t *core, uint32_t dt_us, const waam_inputs_t *inputs, waam_outputs_t *outputs);
const char *waam_state_name(waam_state_t state);

#endif
