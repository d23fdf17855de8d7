/* Immediate lines: "$<letter> <args>", answered at once with the same letter. */
#include <math.h>

#include "waam_internal.h"

typedef struct {
    waam_core_t *core;
    waam_cursor_t args;
    char letter;
    waam_text_t answer;
} request_t;

static void begin(request_t *r)
{
    waam_text_clear(&r->answer);
    waam_text_char(&r->answer, '$');
    waam_text_char(&r->answer, r->letter);
    waam_text_char(&r->answer, ' ');
}

static void refuse(request_t *r, waam_code_t code, const char *text)
{
    begin(r);
    waam_text_add(&r->answer, "error E");
    waam_text_uint(&r->answer, code);
    waam_text_char(&r->answer, ' ');
    waam_text_add(&r->answer, text);
}

static void ok(request_t *r) { waam_text_add(&r->answer, "ok"); }

/* Exactly `count` numbers and nothing more. */
static bool numbers(request_t *r, double *values, int count)
{
    for (int i = 0; i < count; i++)
        if (!waam_read_number(&r->args, &values[i]))
            return refuse(r, WAAM_E_MISSING_WORD, "a number is missing or malformed"), false;
    if (!waam_at_end(&r->args))
        return refuse(r, WAAM_E_SYNTAX, "too many arguments"), false;
    return true;
}

static bool idle(request_t *r)
{
    if (r->core->state == WAAM_IDLE)
        return true;
    return refuse(r, WAAM_E_NOT_NOW, "only in IDLE"), false;
}

static void limits(request_t *r)
{
    const waam_config_t *c = &r->core->config;
    for (int i = 0; i < 2 * WAAM_AXES; i++) {
        if (i)
            waam_text_char(&r->answer, ',');
        waam_text_fixed(&r->answer, i < WAAM_AXES ? c->limit_min_mm[i] : c->limit_max_mm[i - WAAM_AXES], 3);
    }
}

/* Zero of the work frame in machine coordinates. */
static void offset(request_t *r)
{
    const waam_core_t *core = r->core;
    for (int i = 0; i < WAAM_AXES; i++) {
        if (i)
            waam_text_char(&r->answer, ',');
        waam_text_fixed(&r->answer, core->work_mm[i] + core->g92_mm[i], 4);
    }
}

static void identify(request_t *r)
{
    waam_core_t *core = r->core;
    if (core->state == WAAM_IDLE && core->planner.count == 0) {
        waam_link_resync(&core->link, 1);
        core->executed = 0;
        core->modal = (waam_modal_t){0};
        for (int i = 0; i < WAAM_AXES; i++)
            core->g92_mm[i] = 0.0;
    }
    waam_text_add(&r->answer, "WAAM_CONTROLLER_V1 fw=" WAAM_FIRMWARE_VERSION " boot=");
    waam_text_uint(&r->answer, core->config.boot_id);
    waam_text_add(&r->answer, core->config.clock_is_ros_time ? " clk=sync" : " clk=free");
    waam_text_add(&r->answer, " blocks=");
    waam_text_uint(&r->answer, WAAM_BLOCKS);
    waam_text_add(&r->answer, " rx=");
    waam_text_uint(&r->answer, WAAM_RING_BYTES);
    waam_text_add(&r->answer, " lim=");
    limits(r);
    waam_text_add(&r->answer, " spmm=");
    waam_text_uint(&r->answer, (uint64_t)core->config.steps_per_mm);
    waam_text_add(&r->answer, " off=");
    offset(r);
    waam_text_add(&r->answer, " cap=WIRE,LEASE,OVR,CRC16,XOR8,G54,G92");
}

/* The lease is what a node has seen of this clock, so it cannot lie in the future. */
static void heartbeat(request_t *r)
{
    waam_core_t *core = r->core;
    waam_skip_spaces(&r->args);
    size_t start = r->args.at;
    while (r->args.at < r->args.length && r->args.text[r->args.at] != ' ')
        r->args.at++;
    size_t end = r->args.at;
    uint64_t lease;
    if (end == start || end - start > 32 || !waam_read_uint(&r->args, &lease) || !waam_at_end(&r->args)) {
        refuse(r, WAAM_E_MISSING_WORD, "use $H <token> <lease_us>");
        return;
    }
    core->beat_us = core->now_us;
    core->lease_us = lease < core->now_us ? lease : core->now_us;
    waam_text_bytes(&r->answer, r->args.text + start, end - start);
    waam_text_char(&r->answer, ' ');
    waam_text_uint(&r->answer, core->now_us);
}

static void arm(request_t *r)
{
    if (r->core->state == WAAM_ALARM) {
        refuse(r, WAAM_E_NOT_NOW, "not in ALARM");
        return;
    }
    r->core->armed = true;
    ok(r);
}

static void disarm(request_t *r)
{
    r->core->armed = false;
    ok(r);
}

static void jog(request_t *r)
{
    waam_core_t *core = r->core;
    double v[4], target[WAAM_AXES];
    waam_error_t error;
    if (core->state != WAAM_IDLE && !waam_core_jogging(core)) {
        refuse(r, WAAM_E_NOT_NOW, "jog only in IDLE");
        return;
    }
    if (!numbers(r, v, 4))
        return;
    if (v[3] <= 0.0) {
        refuse(r, WAAM_E_NUMBER, "the jog speed must be above 0 mm/min");
        return;
    }
    if (waam_planner_free(&core->planner) == 0) {
        refuse(r, WAAM_E_NOT_NOW, "the queue is full");
        return;
    }
    for (int i = 0; i < WAAM_AXES; i++)
        target[i] = core->plan_mm[i] + v[i];
    if (waam_core_plan_move(core, target, v[3] / 60.0, 0, true, &error)) {
        ok(r);
        return;
    }
    refuse(r, error.code, "");
    waam_text_bytes(&r->answer, error.text.text, error.text.length);
}

static void jog_wire(request_t *r)
{
    waam_core_t *core = r->core;
    double v[2];
    if (!idle(r) || !numbers(r, v, 2))
        return;
    if (v[1] <= 0.0 || v[1] > core->config.wire_max_mm_s * 60.0 || fabs(v[0]) > 10000.0) {
        refuse(r, WAAM_E_NUMBER, "wire jog: at most 10000 mm, speed above 0 and within the feeder's limit");
        return;
    }
    waam_wire_jog(&core->wire, v[0], v[1] / 60.0);
    ok(r);
}

static void hold(request_t *r)
{
    if (r->core->state == WAAM_ALARM) {
        refuse(r, WAAM_E_NOT_NOW, "not in ALARM");
        return;
    }
    waam_core_hold(r->core, WAAM_E_HOLD, "hold by host", false);
    ok(r);
}

static void resume(request_t *r)
{
    if (waam_core_resume(r->core))
        ok(r);
    else
        refuse(r, WAAM_E_NOT_NOW, "not in HOLD");
}

static void stop(request_t *r)
{
    waam_core_stop(r->core);
    ok(r);
}

static void override(request_t *r)
{
    waam_core_t *core = r->core;
    double v[2];
    if (!numbers(r, v, 2))
        return;
    if (v[0] < 100 || v[0] > 2000 || v[1] < 500 || v[1] > 1500) {
        refuse(r, WAAM_E_NUMBER, "override: speed 100..2000, wire 500..1500 permille");
        return;
    }
    waam_planner_set_override(&core->planner, v[0] / 1000.0);
    core->wire_override = v[1] / 1000.0;
    ok(r);
}

static void work_offset(request_t *r)
{
    waam_core_t *core = r->core;
    double v[WAAM_AXES];
    if (!idle(r) || !numbers(r, v, WAAM_AXES))
        return;
    for (int i = 0; i < WAAM_AXES; i++) {
        if (fabs(v[i]) > 1e5) {
            refuse(r, WAAM_E_NUMBER, "the work offset is out of range");
            return;
        }
    }
    for (int i = 0; i < WAAM_AXES; i++)
        core->work_mm[i] = v[i], core->g92_mm[i] = 0.0;
    ok(r);
}

static void reset(request_t *r)
{
    waam_core_t *core = r->core;
    if (core->state != WAAM_ALARM && core->state != WAAM_IDLE) {
        refuse(r, WAAM_E_NOT_NOW, "only in ALARM or IDLE: stop first");
        return;
    }
    if (core->inputs.estop) {
        refuse(r, WAAM_E_ESTOP, "the emergency stop is still active");
        return;
    }
    if (core->inputs.process == WAAM_PROCESS_LOST) {
        refuse(r, WAAM_E_INPUTS, "the process inputs are still lost");
        return;
    }
    core->homed = core->plan_homed = core->armed = false;
    if (core->state == WAAM_ALARM)
        waam_core_state(core, WAAM_IDLE, WAAM_OK, "reset; homing is lost");
    ok(r);
}

static void resync(request_t *r)
{
    waam_core_t *core = r->core;
    uint64_t next;
    if (!waam_read_uint(&r->args, &next) || !waam_at_end(&r->args) || next == 0 || next > UINT32_MAX - 1) {
        refuse(r, WAAM_E_NUMBER, "use $L <next line number>");
        return;
    }
    if (core->planner.count && next <= core->link.accepted) {
        refuse(r, WAAM_E_NUMBER, "that line is in the queue already");
        return;
    }
    waam_link_resync(&core->link, (uint32_t)next);
    if (core->executed > core->link.accepted)
        core->executed = core->link.accepted;
    ok(r);
}

static const struct {
    char letter;
    void (*handle)(request_t *);
} table[] = {
    {'I', identify}, {'H', heartbeat}, {'A', arm},   {'D', disarm},   {'J', jog},         {'W', jog_wire}, {'P', hold},
    {'R', resume},   {'S', stop},      {'V', override}, {'Z', work_offset}, {'X', reset}, {'L', resync},
};

void waam_core_immediate(waam_core_t *core, const char *line, size_t length)
{
    request_t r = {.core = core, .args = {line, length, 2}, .letter = length > 1 ? line[1] : '?'};
    begin(&r);
    bool separated = length <= 2 || line[2] == ' ';
    size_t i = 0;
    while (i < sizeof table / sizeof table[0] && table[i].letter != r.letter)
        i++;
    if (i < sizeof table / sizeof table[0] && separated) {
        table[i].handle(&r);
    } else {
        r.letter = '?';
        refuse(&r, WAAM_E_UNKNOWN_WORD, "not a command of this controller");
    }
    waam_text_seal(&r.answer);
    core->send(core->context, r.answer.text, r.answer.length, WAAM_TX_ASSURED);
}
