/* States and their changes: hold, alarm, resume, stop. Everything else in this room may call these; they call none of it. */
#include "waam_internal.h"

const char waam_axis_names[WAAM_AXES + 1] = "XYZ";

const char *waam_state_name(waam_state_t state)
{
    static const char *const names[] = {"IDLE", "RUN", "HOLD", "ALARM"};
    return names[state];
}

void waam_core_stamp(const waam_core_t *core, waam_text_t *text)
{
    waam_text_add(text, " @");
    waam_text_uint(text, core->now_us + core->since_tick_us);
}

void waam_core_send(waam_core_t *core, waam_text_t *text, waam_tx_kind_t kind)
{
    if (kind == WAAM_TX_ASSURED)
        waam_core_stamp(core, text);
    waam_text_seal(text, core->link.strong);
    core->send(core->context, text->text, text->length, kind);
}

void waam_core_tell(waam_core_t *core, waam_code_t code, const char *reason)
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, "! ");
    waam_text_add(&text, waam_state_name(core->state));
    waam_text_add(&text, code ? " E" : " E00");
    waam_text_uint(&text, code);
    waam_text_char(&text, ' ');
    waam_text_add(&text, reason);
    waam_core_send(core, &text, WAAM_TX_ASSURED);
}

void waam_core_state(waam_core_t *core, waam_state_t state, waam_code_t code, const char *reason)
{
    core->state = state;
    core->fault = code;
    waam_core_tell(core, code, reason);
}

waam_place_t waam_core_place(const waam_core_t *core)
{
    return (waam_place_t){core->motion.steps, core->motion.part};
}

void waam_core_absorb(waam_core_t *core)
{
    core->motion.steps[2] += core->z_correction;
    core->z_correction = 0;
    for (int i = 0; i < WAAM_AXES; i++) {
        core->motion.steps[i] += core->lag[i];
        core->lag[i] = core->motion.part[i] = core->part[i] = 0;
    }
    core->shaped_um_s = 0;
    waam_shaper_rest(&core->shaper, waam_core_place(core));
    core->standoff.correction_mm = core->standoff.speed_mm_s = 0.0f;
}

/* The end of what is planned is where the machine stands; the modes are forgotten. */
static void plan_from_here(waam_core_t *core)
{
    for (int i = 0; i < WAAM_AXES; i++)
        core->plan_mm[i] = core->path_mm[i] = (double)core->motion.steps[i] / core->config.steps_per_mm[i];
    core->modal = (waam_modal_t){0};
    core->plan_homed = core->homed;
    core->plan_arc = core->arc_wanted = false;
}

static void forget_queue(waam_core_t *core)
{
    waam_core_absorb(core);
    waam_planner_clear(&core->planner);
    core->motion.done_mm = 0.0;
    core->done_count = 0;
    core->planned = core->executed;
    core->block_started = core->jogged = core->stopping = core->resume_asked = core->retrying = false;
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
    return core->motion.speed_mm_s == 0.0 && waam_shaper_settled(&core->shaper) && core->standoff.speed_mm_s == 0.0f &&
           (!core->home.active || core->home.speed_mm_s == 0.0);
}

bool waam_core_settable(const waam_core_t *core, waam_error_t *error)
{
    if ((core->state == WAAM_IDLE || core->state == WAAM_ALARM) && core->planner.count == 0)
        return true;
    return waam_fail(error, WAAM_E_NOT_NOW, 1, "settings only in IDLE or ALARM");
}

int32_t waam_core_steps(const waam_core_t *core, int axis)
{
    return core->motion.steps[axis] + core->lag[axis] + (axis == 2 ? core->z_correction : 0);
}

int64_t waam_core_pulses(const waam_core_t *core, int axis)
{
    return waam_core_steps(core, axis) - core->motion.datum_steps[axis];
}

double waam_core_speed(const waam_core_t *core)
{
    return core->shaper.on ? core->shaped_um_s * 1e-3 : core->motion.speed_mm_s;
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
    waam_link_block(&core->link, false);
    waam_arc_cut(&core->arc, &core->config.arc);
    waam_wire_stop_jog(&core->wire);
    core->arc.gas_asked = false;
    core->stopping = core->state == WAAM_RUN || core->state == WAAM_HOLD || core->planner.count > 0;
    waam_core_finish_stopping(core);
}

bool waam_core_jogging(const waam_core_t *core)
{
    if (core->state != WAAM_RUN || (core->planner.count == 0 && (!core->jogged || waam_shaper_settled(&core->shaper))))
        return false;
    for (size_t i = 0; i < core->planner.count; i++)
        if (!core->planner.block[(core->planner.head + i) % WAAM_BLOCKS].jog)
            return false;
    return true;
}
