/* States and their changes; the tick that calls everything else. */
#include "waam_internal.h"

const char waam_axis_names[WAAM_AXES + 1] = "XYZ";

const char *waam_state_name(waam_state_t state)
{
    static const char *const names[] = {"IDLE", "RUN", "HOLD", "ALARM"};
    return names[state];
}

void waam_core_send(waam_core_t *core, waam_text_t *text, waam_tx_kind_t kind)
{
    if (core->link.dialect == WAAM_DIALECT_STOCK) {
        waam_marlin_send(core, text, kind);
        return;
    }
    if (kind == WAAM_TX_ASSURED)
        waam_core_stamp(core, text);
    waam_text_seal(text, core->link.strong);
    core->send(core->context, text->text, text->length, kind);
}

void waam_core_init(waam_core_t *core, const waam_config_t *config, waam_tx_t send_line, void *context)
{
    *core = (waam_core_t){.config = *config, .send = send_line, .context = context, .now_us = config->start_us};
    core->kinematics = waam_kinematics(config);
    core->motion.steps_per_mm = config->steps_per_mm;
    waam_link_init(&core->link);
    waam_planner_init(&core->planner);
    core->wire_override = 1.0;
    if (waam_regulator_check(&config->regulator))
        core->config.regulator.actuator = WAAM_REGULATOR_OFF; /* a tuning that makes no sense is not used */
    waam_scheduler_start(&core->scheduler);
    core->arc.unchecked = true; /* the power may have gone with the wire in the pool */
    if (config->starts_in_alarm) {
        core->state = WAAM_ALARM;
        core->fault = config->watchdog_reset ? WAAM_E_WATCHDOG : WAAM_E_POWER_UP;
    }
    core->heard_us = core->now_us;
    core->telemetry_us = config->telemetry_us;
    core->telemetry_due_us = core->now_us + config->telemetry_us;
}

/* ---- states ---- */

void waam_core_state(waam_core_t *core, waam_state_t state, waam_code_t code, const char *reason)
{
    waam_text_t text = {.length = 0};
    core->state = state;
    core->fault = code;
    waam_text_add(&text, "! ");
    waam_text_add(&text, waam_state_name(state));
    waam_text_add(&text, code ? " E" : " E00");
    waam_text_uint(&text, code);
    waam_text_char(&text, ' ');
    waam_text_add(&text, reason);
    waam_core_send(core, &text, WAAM_TX_ASSURED);
}

/* The end of what is planned is where the machine stands, in the modes of what it has done. */
static void plan_from_here(waam_core_t *core)
{
    for (int i = 0; i < WAAM_AXES; i++)
        core->plan_mm[i] = core->path_mm[i] = (double)core->motion.steps[i] / core->config.steps_per_mm;
    core->modal = core->executed_modal;
    core->plan_homed = core->homed;
    core->plan_arc = core->arc_wanted = false;
}

static void forget_queue(waam_core_t *core)
{
    waam_planner_clear(&core->planner);
    core->motion.done_mm = 0.0;
    core->block_started = core->stopping = core->resume_asked = core->retrying = false;
    core->home.active = false;
    plan_from_here(core);
}

void waam_core_hold(waam_core_t *core, waam_code_t code, const char *reason, bool quick)
{
    waam_wire_stop_jog(&core->wire);
    core->resume_asked = core->retrying = false;
    if (core->state == WAAM_ALARM || core->stopping)
        return;
    waam_arc_end(&core->arc, quick, &core->config.arc);
    if (core->state != WAAM_HOLD || (core->fault == WAAM_E_HOLD && code != WAAM_E_HOLD))
        waam_core_state(core, WAAM_HOLD, code, reason);
}

void waam_core_alarm(waam_core_t *core, waam_code_t code, const char *reason)
{
    waam_arc_cut(&core->arc, &core->config.arc);
    core->arc.gas_asked = false;
    core->arc.post_flow_us = 0;
    waam_wire_stop_jog(&core->wire);
    core->wire.speed_mm_s = core->motion.speed_mm_s = 0.0;
    core->homed = core->armed = false;
    forget_queue(core);
    waam_link_block(&core->link, false);
    waam_core_state(core, WAAM_ALARM, code, reason);
}

bool waam_core_resume(waam_core_t *core)
{
    if (core->state == WAAM_HOLD)
        core->resume_asked = true;
    return core->state == WAAM_HOLD || core->state == WAAM_RUN;
}

bool waam_core_stands(const waam_core_t *core)
{
    return core->motion.speed_mm_s == 0.0 && (!core->home.active || core->home.speed_mm_s == 0.0);
}

int64_t waam_core_pulses(const waam_core_t *core, int axis)
{
    return core->motion.steps[axis] - core->motion.datum_steps[axis];
}

void waam_core_finish_stopping(waam_core_t *core)
{
    if (!core->stopping || !waam_core_stands(core))
        return;
    forget_queue(core);
    waam_core_state(core, WAAM_IDLE, WAAM_OK, "stopped; the queue was emptied");
}

void waam_core_stop(waam_core_t *core)
{
    waam_arc_cut(&core->arc, &core->config.arc);
    waam_wire_stop_jog(&core->wire);
    waam_link_block(&core->link, false);
    core->arc.gas_asked = false;
    core->stopping = core->state == WAAM_RUN || core->state == WAAM_HOLD || core->planner.count > 0;
    waam_core_finish_stopping(core);
}

bool waam_core_jogging(const waam_core_t *core)
{
    if (core->state != WAAM_RUN || core->planner.count == 0)
        return false;
    for (size_t i = 0; i < core->planner.count; i++)
        if (!core->planner.block[(core->planner.head + i) % WAAM_BLOCKS].jog)
            return false;
    return true;
}

/* ---- the tick ---- */

void waam_core_tick(waam_core_t *core, uint32_t dt_us, const waam_inputs_t *inputs, waam_outputs_t *outputs)
{
    core->now_us += dt_us;
    core->since_tick_us = 0;
    waam_guard_inputs(core, inputs, dt_us);
    waam_core_take_lines(core);
    waam_guard_link(core);
    waam_guard_armed(core);
    waam_core_run(core, dt_us);
    waam_guard_limit(core, dt_us);
    waam_guard_arc(core, dt_us);
    waam_guard_lease(core);
    for (int i = 0; i < WAAM_AXES; i++)
        outputs->pulses[i] = waam_core_pulses(core, i);
    outputs->arc = waam_arc_output(&core->arc);
    outputs->gas = core->arc.gas;
    outputs->wire_mm_s = core->wire.speed_mm_s;
    outputs->drives = waam_guard_drives(core);
    outputs->sense = core->arc.phase == WAAM_ARC_SENSE;
    outputs->voltage_v = waam_guard_source(core);
    waam_guard_orders(core, dt_us);
    if (core->now_us >= core->telemetry_due_us) {
        core->telemetry_due_us += core->telemetry_us;
        waam_core_telemetry(core);
    }
}
