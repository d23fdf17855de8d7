/* Immediate lines: "$<letter>[@<token>] <args>", answered at once with the same letter and token. */
#include <math.h>

#include "waam_internal.h"

typedef struct {
    waam_core_t *core;
    waam_cursor_t args;
    char letter;
    bool has_token;
    uint32_t token;
    waam_code_t code; /* of the refusal */
    waam_text_t answer;
} request_t;

static void begin(request_t *r)
{
    waam_text_clear(&r->answer);
    waam_text_char(&r->answer, '$');
    waam_text_char(&r->answer, r->letter);
    if (r->has_token) {
        waam_text_char(&r->answer, '@');
        waam_text_uint(&r->answer, r->token);
    }
    waam_text_char(&r->answer, ' ');
}

static void refuse(request_t *r, waam_code_t code, const char *text)
{
    begin(r);
    r->code = code;
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
        waam_text_fixed(&r->answer, waam_core_zero_mm(core, &core->executed_modal, i), 4);
    }
}

void waam_core_new_program(waam_core_t *core) { core->modal = core->executed_modal = (waam_modal_t){0}; }

static void field(request_t *r, const char *name, uint64_t value)
{
    waam_text_add(&r->answer, name);
    waam_text_uint(&r->answer, value);
}

static void describe(request_t *r)
{
    waam_core_t *core = r->core;
    field(r, "WAAM_CONTROLLER_V1 fw=" WAAM_FIRMWARE_VERSION " boot=", core->config.boot_id);
    waam_text_add(&r->answer, core->config.clock_is_ros_time ? " clk=sync" : " clk=free");
    field(r, " blocks=", WAAM_BLOCKS);
    field(r, " rx=", WAAM_RING_BYTES);
    waam_text_add(&r->answer, " lim=");
    limits(r);
    field(r, " spmm=", (uint64_t)core->config.steps_per_mm);
    waam_text_add(&r->answer, " off=");
    offset(r);
    field(r, " acc=", core->link.accepted);
    field(r, " exe=", core->executed);
    waam_text_add(&r->answer, " cap=WIRE,LEASE,OVR,CRC16,CRC32,XOR8,G2,G54,G59,G92,E,TOKEN,RATE,STOCK");
}

/* "$I keep": the host will say by $L which line comes next; until then the last accepted line cannot change.
 * "$I" alone: an idle controller starts to count at 1. */
static void identify(request_t *r)
{
    waam_core_t *core = r->core;
    waam_skip_spaces(&r->args);
    bool keep = r->args.length - r->args.at >= 4 && r->args.text[r->args.at] == 'k';
    core->link.dialect = WAAM_DIALECT_NATIVE;
    core->link.strong = core->link.check_digits == 10;
    core->link.base = 0;
    core->telemetry_us = core->config.telemetry_us;
    core->recent_count = 0;
    if (keep) {
        waam_link_block(&core->link, false);
    } else if (core->state == WAAM_IDLE && core->planner.count == 0) {
        waam_link_resync(&core->link, 1);
        core->executed = 0;
        waam_core_new_program(core);
    }
    describe(r);
}

/* The lease is what a node has seen of this clock, so it cannot lie in the future. */
static void heartbeat(request_t *r)
{
    waam_core_t *core = r->core;
    waam_skip_spaces(&r->args);
    size_t start = r->args.at;
    while (r->args.at < r->args.length && r->args.text[r->args.at] > ' ' && r->args.text[r->args.at] <= '~')
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
    waam_text_uint(&r->answer, core->now_us + core->since_tick_us);
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
    double v[4];
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
    if (waam_core_plan_jog(core, v, v[3] / 60.0, &error)) {
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
        core->work_mm[0][i] = v[i], core->modal.g92_mm[i] = core->executed_modal.g92_mm[i] = 0.0;
    ok(r);
}

waam_code_t waam_core_reset(waam_core_t *core, const char **text)
{
    if (core->state != WAAM_ALARM && core->state != WAAM_IDLE) {
        *text = "only in ALARM or IDLE: stop first";
        return WAAM_E_NOT_NOW;
    }
    if (core->inputs.estop) {
        *text = "the emergency stop is still active";
        return WAAM_E_ESTOP;
    }
    if (core->inputs.process == WAAM_PROCESS_LOST) {
        *text = "the process inputs are still lost";
        return WAAM_E_INPUTS;
    }
    core->homed = core->plan_homed = core->armed = false;
    if (core->state == WAAM_ALARM)
        waam_core_state(core, WAAM_IDLE, WAAM_OK, "reset; homing is lost");
    return WAAM_OK;
}

static void reset(request_t *r)
{
    const char *text = "";
    waam_code_t code = waam_core_reset(r->core, &text);
    if (code)
        refuse(r, code, text);
    else
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
    if (next <= core->link.accepted) {
        refuse(r, WAAM_E_NUMBER, "that line was accepted already");
        return;
    }
    waam_link_resync(&core->link, (uint32_t)next);
    if (core->executed > core->link.accepted)
        core->executed = core->link.accepted;
    ok(r);
}

static void telemetry_rate(request_t *r)
{
    waam_core_t *core = r->core;
    double hz;
    if (!numbers(r, &hz, 1))
        return;
    if (hz < 1.0 || hz > 1000.0) {
        refuse(r, WAAM_E_NUMBER, "telemetry rate: 1..1000 Hz");
        return;
    }
    core->telemetry_us = (uint32_t)(1e6 / hz + 0.5);
    core->telemetry_due_us = core->now_us + core->telemetry_us;
    ok(r);
}

static const struct {
    char letter;
    void (*handle)(request_t *);
} table[] = {
    {'I', identify}, {'H', heartbeat}, {'A', arm},      {'D', disarm},      {'J', jog},
    {'W', jog_wire}, {'P', hold},      {'R', resume},   {'S', stop},        {'V', override},
    {'Z', work_offset}, {'X', reset},  {'L', resync},   {'T', telemetry_rate},
};

/* ---- tokens ---- */

/* "@<token>" after the letter; false when there is something else than a blank. */
static bool read_token(request_t *r)
{
    uint64_t token;
    if (r->args.length <= 2 || r->args.text[2] == ' ')
        return true;
    if (r->args.text[2] != '@' || r->args.length < 4 || r->args.text[3] == ' ')
        return false;
    r->args.at = 3;
    if (!waam_read_uint(&r->args, &token) || token > UINT32_MAX)
        return false;
    r->token = (uint32_t)token;
    r->has_token = true;
    return r->args.at >= r->args.length || r->args.text[r->args.at] == ' ';
}

/* What was done is answered again and not done again; a heartbeat and an identification may be done twice. */
static bool repeated(request_t *r)
{
    waam_core_t *core = r->core;
    uint32_t kept = core->recent_count < WAAM_RECENT ? core->recent_count : WAAM_RECENT;
    for (uint32_t i = 0; r->has_token && i < kept; i++) {
        const waam_recent_t *done = &core->recent[i];
        if (done->token != r->token || done->letter != r->letter)
            continue;
        if (done->code)
            refuse(r, done->code, "refused already");
        else
            ok(r);
        return true;
    }
    return false;
}

static void remember(const request_t *r)
{
    waam_core_t *core = r->core;
    if (r->has_token && r->letter != 'I')
        core->recent[core->recent_count++ % WAAM_RECENT] = (waam_recent_t){r->token, r->letter, r->code};
}

void waam_core_clock(waam_core_t *core, uint32_t since_tick_us) { core->since_tick_us = since_tick_us; }

void waam_core_stamp(const waam_core_t *core, waam_text_t *text)
{
    waam_text_add(text, " @");
    waam_text_uint(text, core->now_us + core->since_tick_us);
}

static void answer(request_t *r)
{
    waam_core_t *core = r->core;
    size_t i = 0, count = sizeof table / sizeof table[0];
    bool token_good = read_token(r);
    while (i < count && table[i].letter != r->letter)
        i++;
    begin(r);
    if (i == count || !token_good) {
        r->letter = '?';
        refuse(r, WAAM_E_UNKNOWN_WORD, "not a command of this controller");
    } else if (core->link.dialect == WAAM_DIALECT_STOCK && r->letter != 'I') {
        refuse(r, WAAM_E_NOT_NOW, "a stock sender is connected: identify first");
    } else if (!repeated(r)) {
        table[i].handle(r);
        remember(r);
    }
}

void waam_core_immediate(waam_core_t *core, const char *line, size_t length)
{
    request_t r = {.core = core, .args = {line, length, 2}, .letter = length > 1 ? line[1] : '?'};
    answer(&r);
    if (r.letter != 'H')
        waam_core_stamp(core, &r.answer);
    waam_text_seal(&r.answer, core->link.strong);
    core->send(core->context, r.answer.text, r.answer.length, WAAM_TX_ASSURED);
}
