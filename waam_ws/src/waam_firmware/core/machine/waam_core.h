/* The controller core: everything between the bytes of the link and the pins, without operating system, heap or clock.
 *
 *     waam_core_t core;                              (static; about 26 kB)
 *     waam_core_init(&core, &config, send, context);
 *     every tick (1 ms or finer):
 *         waam_core_rx(&core, byte)  for what has arrived, from the same thread as the tick
 *         waam_core_tick(&core, dt_us, &inputs, &outputs)
 *     every 100 us, from an interrupt that may preempt the tick (single precision only):
 *         waam_core_fast(&core, &fast_inputs, &fast_outputs)   arc voltage and source
 *     in the loop that serves the link:  waam_core_linked(&core)
 *     before the hardware watchdog is fed: waam_core_alive(&core)
 *
 * The shell samples the inputs, spreads the new steps over the tick as pulses, sets the outputs and sends what `send` hands over.
 */
#ifndef WAAM_CORE_H
#define WAAM_CORE_H

#include "waam_acceleration.h"
#include "waam_arc.h"
#include "waam_fast.h"
#include "waam_gcode.h"
#include "waam_home.h"
#include "waam_limit.h"
#include "waam_link.h"
#include "waam_motion.h"
#include "waam_planner.h"
#include "waam_shaper.h"
#include "waam_standoff.h"
#include "waam_temperature.h"
#include "waam_wire.h"

/* An immediate line that was done, so that its repetition is answered and not done again. */
typedef struct {
    uint32_t token;
    char letter;
    waam_code_t code;
} waam_recent_t;

#define WAAM_TICK_US 1000u /* that the input shaper is tuned for until ticks of another length come */
#define WAAM_DONE 32 /* lines whose motion is still under way in the shaper; more are told together */

/* A line that is done when the shaped motion gets to its end. */
typedef struct {
    uint32_t line, due;         /* due: tick of the shaper */
} waam_done_t;

typedef struct {
    waam_config_t config;
    waam_kinematics_t kinematics;
    waam_tx_t send;
    void *context;

    uint64_t now_us;
    waam_state_t state;
    waam_code_t fault;          /* why HOLD or ALARM */
    bool homed, armed;
    bool estopped;              /* emergency stop or a drive's fault since the last reset: safe torque off */
    bool stopping;              /* slowing down to forget the queue */
    bool resume_asked;          /* continue as soon as motion and arc have ended */
    bool arc_wanted;            /* between M3 and M5 of the executed program */
    bool retrying;              /* slowing down to strike again, still in RUN */
    uint32_t retries;           /* since M3 */

    waam_link_t link;
    waam_recent_t recent[WAAM_RECENT]; /* immediate lines with a token that were done */
    uint32_t recent_count;
    uint8_t burst_byte;         /* last byte from the host, and how many of it in a row, when it is a real-time byte */
    unsigned burst;
    waam_modal_t modal;         /* of what is planned; a stop and ALARM forget it */
    waam_planner_t planner;
    waam_motion_t motion;       /* the planned one: where the machine is without lag and z_correction */
    waam_shaper_t shaper;
    uint32_t shaper_tick_us;    /* that it is tuned for */
    int32_t lag[WAAM_AXES];     /* shaped less planned steps */
    int32_t part[WAAM_AXES];    /* of the shaped place, between two steps, 1 / WAAM_PARTS */
    int32_t shaped_um_s;        /* speed along the shaped path */
    waam_done_t done[WAAM_DONE];
    uint32_t done_first, done_count, shaper_ticks;
    bool jogged;                /* the last block that was left was a jog */
    waam_arc_t arc;
    waam_fast_t fast;           /* shared with the fast tick */
    waam_trip_t trip;           /* of the fast tick, as this tick has seen it */
    waam_scheduler_t scheduler; /* of the arc regulator's gains */
    waam_home_t home;
    waam_limit_t limit;
    waam_wire_t wire;
    waam_inputs_t inputs;       /* of the last tick */
    waam_standoff_t standoff;   /* the torch at its distance */
    int32_t z_correction;       /* steps of Z by it, on top of motion.steps */
    int32_t z_before;           /* motion.steps of Z in the last tick */
    float tracked_mm;           /* path since the arc */
    float chord_mm[2], heading[2]; /* where the last millimetre of path began, and its direction */
    bool approaching, approach_asked; /* a strike waits for the distance */
    bool standoff_due;          /* its line of telemetry */
    waam_acceleration_t acceleration; /* shared with the fast tick */
    waam_temperature_t temperature; /* of the part */

    /* the end of what is planned */
    double plan_mm[WAAM_AXES];  /* machine coordinates, as commanded */
    double path_mm[WAAM_AXES];  /* end of the last block; differs from plan_mm while moves too short for one add up */
    bool plan_homed, plan_arc;
    double work_mm[WAAM_AXES];  /* zero of the program in machine coordinates; $Z sets it */

    bool block_started;
    uint64_t dwell_us;
    double wire_override;
    bool replanned;             /* by an override, in this tick */
    uint64_t dry_us;            /* queue empty with the arc on */
    uint64_t heard_us;          /* last valid line */
    uint64_t beat_us;           /* last heartbeat; 0 = none yet */
    uint64_t lease_us;          /* controller time that the slowest node has seen; 0 = no lease */
    uint32_t since_tick_us;     /* time since the last tick, for stamps (waam_core_clock) */
    uint32_t telemetry_us;      /* between frames */
    uint64_t telemetry_due_us;
    uint32_t telemetry_sequence, executed, underruns;
    uint32_t planned;           /* last line that the planned motion has left; executed follows it */
} waam_core_t;

waam_config_t waam_config_default(void);
/* `send` is called with whole lines and `context`; `config` is copied. */
void waam_core_init(waam_core_t *core, const waam_config_t *config, waam_tx_t send, void *context);
/* One byte from the host; never while waam_core_tick runs. */
void waam_core_rx(waam_core_t *core, uint8_t byte);
/* Optional, before waam_core_rx: the microseconds since the last tick, so that answers carry a finer clock. */
void waam_core_clock(waam_core_t *core, uint32_t since_tick_us);
/* The other end is gone (terminal closed, USB unplugged): ends a cut line; nobody is known. */
void waam_core_hang_up(waam_core_t *core);
/* Moves everything on by `dt_us`: readings in, outputs out. */
void waam_core_tick(waam_core_t *core, uint32_t dt_us, const waam_inputs_t *inputs, waam_outputs_t *outputs);
/* Exactly every WAAM_FAST_US. Where it is never called, the source gets its setpoint unregulated (outputs of the tick). */
void waam_core_fast(waam_core_t *core, const waam_fast_inputs_t *inputs, waam_fast_outputs_t *outputs);
/* After waam_core_fast, where the board has an accelerometer (config.accelerometer): what came back of the last exchange
 * with it, `count` bytes, and the next one into `out`; returns its bytes, 0 = none. */
size_t waam_core_accelerometer(waam_core_t *core, const uint8_t *in, size_t count, uint8_t out[WAAM_ADXL345_BYTES]);
/* The loop that serves the link has come round. */
void waam_core_linked(waam_core_t *core);
/* Feed the independent watchdog now? True once tick, fast tick and link loop have all run since the last true answer. */
bool waam_core_alive(waam_core_t *core);
const char *waam_state_name(waam_state_t state);

#endif
