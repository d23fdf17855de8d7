/* Between the modules of the core. Not for shells. */
#ifndef WAAM_INTERNAL_H
#define WAAM_INTERNAL_H

#include "waam_core.h"

extern const char waam_axis_names[WAAM_AXES + 1];

/* states (waam_state.c) */
void waam_core_send(waam_core_t *core, waam_text_t *text, waam_tx_kind_t kind); /* adds the check */
void waam_core_state(waam_core_t *core, waam_state_t state, waam_code_t code, const char *reason);
/* Slows down, ends the arc, keeps the queue. `quick` leaves the crater fill out. */
void waam_core_hold(waam_core_t *core, waam_code_t code, const char *reason, bool quick);
void waam_core_alarm(waam_core_t *core, waam_code_t code, const char *reason);
/* False: there is nothing to resume. */
bool waam_core_resume(waam_core_t *core);
void waam_core_stop(waam_core_t *core);
void waam_core_finish_stopping(waam_core_t *core); /* once it stands: forgets the queue, IDLE */
/* Says it in a line of the present state, which stays. */
void waam_core_tell(waam_core_t *core, waam_code_t code, const char *text);
/* The correction of z becomes a part of the position: nothing moves, and it is 0 again. */
void waam_core_absorb(waam_core_t *core);
waam_place_t waam_core_place(const waam_core_t *core); /* the planned one */
bool waam_core_stands(const waam_core_t *core);
/* May settings change now? False: `error` says why not. */
bool waam_core_settable(const waam_core_t *core, waam_error_t *error);
int32_t waam_core_steps(const waam_core_t *core, int axis); /* where the machine is, shaped and corrected */
int64_t waam_core_pulses(const waam_core_t *core, int axis); /* since the start */
double waam_core_speed(const waam_core_t *core); /* along the path, as shaped; mm/s */
bool waam_core_jogging(const waam_core_t *core);

/* immediate lines (waam_command.c) and queued ones (waam_intake.c) */
void waam_core_immediate(waam_core_t *core, const char *line, size_t length);
void waam_core_take_lines(waam_core_t *core);
/* Leaves ALARM; WAAM_OK, or the code and text of the refusal. */
waam_code_t waam_core_reset(waam_core_t *core, const char **text);
void waam_core_new_program(waam_core_t *core); /* modal state as after a start */
void waam_core_stamp(const waam_core_t *core, waam_text_t *text); /* appends " @<microseconds>" */

/* planning (waam_blocks.c); false = refused, `error` says why */
bool waam_core_plan(waam_core_t *core, const waam_command_t *command, uint32_t line, waam_error_t *error);
/* A jog, if it may be now (waam_orders.c). */
bool waam_core_jog(waam_core_t *core, const double delta_mm[WAAM_AXES], double speed_mm_s, waam_error_t *error);
/* A straight move by so much. */
bool waam_core_plan_jog(waam_core_t *core, const double delta_mm[WAAM_AXES], double speed_mm_s, waam_error_t *error);

/* Takes config.steps_per_mm over (waam_scale.c). */
void waam_core_rescale(waam_core_t *core);

/* execution (waam_run.c) and the wire that goes with it (waam_follow.c) */
void waam_core_run(waam_core_t *core, uint32_t dt_us);
void waam_core_follow(waam_core_t *core);

/* input shaping (waam_shape.c) */
void waam_core_done(waam_core_t *core, uint32_t line); /* told when the motion is there */
void waam_core_shape(waam_core_t *core, uint32_t dt_us);
/* Takes the settings over; NULL, or why not. The machine stands. */
const char *waam_core_tune(waam_core_t *core, const waam_shaper_config_t *settings);

/* standoff (waam_track.c) */
bool waam_core_at_distance(waam_core_t *core); /* asked by a strike: may it begin? */
void waam_core_track(waam_core_t *core, uint32_t dt_us);
bool waam_core_back_on_path(waam_core_t *core); /* nothing is queued: no correction is left */

/* supervision (waam_guard.c) */
void waam_guard_inputs(waam_core_t *core, const waam_inputs_t *inputs, uint32_t dt_us);
void waam_guard_limit(waam_core_t *core, uint32_t dt_us); /* what this tick moved must not lead into a limit switch */
void waam_guard_link(waam_core_t *core);
void waam_guard_armed(waam_core_t *core);
void waam_guard_lease(waam_core_t *core);
void waam_guard_arc(waam_core_t *core, uint32_t dt_us); /* arc sequence and wire */
void waam_guard_orders(waam_core_t *core, uint32_t dt_us); /* to the fast tick */
double waam_guard_source(const waam_core_t *core); /* setpoint of the source, V */
bool waam_core_too_hot(const waam_core_t *core);
/* The configured reaction. `text` NULL: the usual one. */
void waam_core_fault(waam_core_t *core, waam_fault_t fault, const char *text);
uint64_t waam_core_lease_left_us(const waam_core_t *core);
bool waam_guard_plausible(const waam_core_t *core); /* the measured values of this tick */
bool waam_guard_drives(const waam_core_t *core); /* enabled? */

/* telemetry (waam_report.c) */
void waam_core_telemetry(waam_core_t *core);
/* What the standoff control does: in the tick after the frame, for two lines are much for one tick. */
void waam_core_standoff_telemetry(waam_core_t *core);
/* Every tick: the converter for the temperature of the part. */
void waam_core_temperature_read(waam_core_t *core);
bool waam_core_temperature_telemetry(waam_core_t *core); /* false: no line of it is due */

/* accelerometer (waam_accelerometer.c) */
void waam_core_accelerations(waam_core_t *core);

#endif
