/* Between the modules of the core. Not for shells. */
#ifndef WAAM_INTERNAL_H
#define WAAM_INTERNAL_H

#include "waam_core.h"

extern const char waam_axis_names[WAAM_AXES + 1];

/* states (waam_machine.c) */
void waam_core_send(waam_core_t *core, waam_text_t *text, waam_tx_kind_t kind); /* adds the check */
void waam_core_state(waam_core_t *core, waam_state_t state, waam_code_t code, const char *reason);
/* Slows down, ends the arc, keeps the queue. `quick` leaves the crater fill out. */
void waam_core_hold(waam_core_t *core, waam_code_t code, const char *reason, bool quick);
void waam_core_alarm(waam_core_t *core, waam_code_t code, const char *reason);
/* False: there is nothing to resume. */
bool waam_core_resume(waam_core_t *core);
void waam_core_stop(waam_core_t *core);
void waam_core_finish_stopping(waam_core_t *core); /* once it stands: forgets the queue, IDLE */
bool waam_core_stands(const waam_core_t *core);
bool waam_core_jogging(const waam_core_t *core);

/* immediate lines (waam_command.c) and queued ones (waam_intake.c) */
void waam_core_immediate(waam_core_t *core, const char *line, size_t length);
void waam_core_take_lines(waam_core_t *core);

/* planning (waam_blocks.c); false = refused, `error` says why */
bool waam_core_plan(waam_core_t *core, const waam_command_t *command, uint32_t line, waam_error_t *error);
/* A straight move to machine coordinates. */
bool waam_core_plan_move(waam_core_t *core, const double target_mm[WAAM_AXES], double speed_mm_s, uint32_t line,
                         bool jog, waam_error_t *error);

/* execution (waam_run.c) */
void waam_core_run(waam_core_t *core, uint32_t dt_us);

/* supervision (waam_guard.c) */
void waam_guard_inputs(waam_core_t *core, const waam_inputs_t *inputs);
void waam_guard_link(waam_core_t *core);
void waam_guard_armed(waam_core_t *core);
void waam_guard_lease(waam_core_t *core);
void waam_guard_arc(waam_core_t *core, uint32_t dt_us); /* arc sequence and wire */
uint64_t waam_core_lease_left_us(const waam_core_t *core);
bool waam_inputs_plausible(const waam_inputs_t *inputs);

/* telemetry (waam_report.c) */
void waam_core_telemetry(waam_core_t *core);

#endif
