/* Immediate lines to the machine: arm, jog, hold, resume, stop, override, work offset, reset. */
#include <math.h>

#include "waam_request.h"

static bool idle(waam_request_t *r)
{
    if (r->core->state == WAAM_IDLE)
        return true;
    return waam_request_refuse(r, WAAM_E_NOT_NOW, "only in IDLE"), false;
}

void waam_order_arm(waam_request_t *r)
{
    if (r->core->state == WAAM_ALARM) {
        waam_request_refuse(r, WAAM_E_NOT_NOW, "not in ALARM");
        return;
    }
    if (!r->core->armed)
        waam_standoff_forget(&r->core->standoff);
    r->core->armed = true;
    waam_request_ok(r);
}

void waam_order_disarm(waam_request_t *r)
{
    r->core->armed = false;
    waam_request_ok(r);
}

static bool fail_limit(const waam_core_t *core, int axis, waam_error_t *error)
{
    int way = core->limit.out[axis];
    waam_fail(error, WAAM_E_LIMIT_SWITCH, 1, "the limit switch is pressed: ");
    waam_text_char(&error->text, waam_axis_names[axis]);
    waam_text_add(&error->text, way > 0 ? " may only go up" : way < 0 ? " may only go down" : " may not move");
    return false;
}

bool waam_core_jog(waam_core_t *core, const double delta_mm[WAAM_AXES], double speed_mm_s, waam_error_t *error)
{
    if (core->state != WAAM_IDLE && !waam_core_jogging(core))
        return waam_fail(error, WAAM_E_NOT_NOW, 1, "jog only in IDLE");
    if (waam_planner_free(&core->planner) == 0)
        return waam_fail(error, WAAM_E_NOT_NOW, 1, "the queue is full");
    for (int i = 0; i < WAAM_AXES; i++)
        if (!waam_limit_allows(&core->limit, i, delta_mm[i]))
            return fail_limit(core, i, error);
    return waam_core_plan_jog(core, delta_mm, speed_mm_s, error);
}

void waam_order_jog(waam_request_t *r)
{
    double v[4];
    waam_error_t error;
    if (!waam_request_numbers(r, v, 4))
        return;
    if (v[3] <= 0.0) {
        waam_request_refuse(r, WAAM_E_NUMBER, "the jog speed must be above 0 mm/min");
        return;
    }
    if (waam_core_jog(r->core, v, v[3] / 60.0, &error)) {
        waam_request_ok(r);
        return;
    }
    waam_request_refuse(r, error.code, "");
    waam_text_bytes(&r->answer, error.text.text, error.text.length);
}

void waam_order_jog_wire(waam_request_t *r)
{
    waam_core_t *core = r->core;
    double v[2];
    if (!idle(r) || !waam_request_numbers(r, v, 2))
        return;
    if (v[1] <= 0.0 || v[1] > core->config.wire_max_mm_s * 60.0 || fabs(v[0]) > 10000.0) {
        waam_request_refuse(r, WAAM_E_NUMBER,
                            "wire jog: at most 10000 mm, speed above 0 and within the feeder's limit");
        return;
    }
    waam_wire_jog(&core->wire, v[0], v[1] / 60.0);
    waam_request_ok(r);
}

void waam_order_hold(waam_request_t *r)
{
    if (r->core->state == WAAM_ALARM) {
        waam_request_refuse(r, WAAM_E_NOT_NOW, "not in ALARM");
        return;
    }
    waam_core_hold(r->core, WAAM_E_HOLD, "hold by host", false);
    waam_request_ok(r);
}

void waam_order_resume(waam_request_t *r)
{
    if (waam_core_resume(r->core))
        waam_request_ok(r);
    else
        waam_request_refuse(r, WAAM_E_NOT_NOW, "not in HOLD");
}

void waam_order_stop(waam_request_t *r)
{
    waam_core_stop(r->core);
    waam_request_ok(r);
}

void waam_order_override(waam_request_t *r)
{
    waam_core_t *core = r->core;
    double v[2];
    if (!waam_request_numbers(r, v, 2))
        return;
    if (v[0] < 100 || v[0] > 2000 || v[1] < 500 || v[1] > 1500) {
        waam_request_refuse(r, WAAM_E_NUMBER, "override: speed 100..2000, wire 500..1500 permille");
        return;
    }
    waam_planner_set_override(&core->planner, v[0] / 1000.0);
    core->replanned = true;
    core->wire_override = v[1] / 1000.0;
    waam_request_ok(r);
}

void waam_order_work_offset(waam_request_t *r)
{
    waam_core_t *core = r->core;
    double v[WAAM_AXES];
    if (!idle(r) || !waam_request_numbers(r, v, WAAM_AXES))
        return;
    for (int i = 0; i < WAAM_AXES; i++) {
        if (fabs(v[i]) > 1e5) {
            waam_request_refuse(r, WAAM_E_NUMBER, "the work offset is out of range");
            return;
        }
    }
    for (int i = 0; i < WAAM_AXES; i++)
        core->work_mm[i] = v[i];
    waam_request_ok(r);
}

/* Not with a homing that waits: what is planned behind it knows the limits, and this makes it forget them. */
waam_code_t waam_core_reset(waam_core_t *core, const char **text)
{
    bool idle = core->state == WAAM_IDLE && core->planner.count == 0;
    if (core->state != WAAM_ALARM && !idle) {
        *text = "only in ALARM or IDLE: stop first";
        return WAAM_E_NOT_NOW;
    }
    if (core->inputs.estop) {
        *text = "the emergency stop is still active";
        return WAAM_E_ESTOP;
    }
    if (core->inputs.drive_fault) {
        *text = "a drive still reports a fault";
        return WAAM_E_DRIVE;
    }
    if (core->inputs.process == WAAM_PROCESS_LOST) {
        *text = "the process inputs are still lost";
        return WAAM_E_INPUTS;
    }
    core->homed = core->plan_homed = core->armed = false;
    core->estopped = false;
    waam_limit_acknowledge(&core->limit, &core->config);
    if (core->state == WAAM_ALARM)
        waam_core_state(core, WAAM_IDLE, WAAM_OK, "reset; homing is lost");
    return WAAM_OK;
}

void waam_order_reset(waam_request_t *r)
{
    const char *text = "";
    waam_code_t code = waam_core_reset(r->core, &text);
    if (code)
        waam_request_refuse(r, code, text);
    else
        waam_request_ok(r);
}
