/* What common 3-D printing senders may do and what they are answered, in Marlin's form. They can move the machine, but nothing
 * that they say can strike an arc: they hold no lease. */
#include "waam_internal.h"
#include "waam_marlin_dialect.h"

/* ---- answers ---- */

static void say(waam_core_t *core, const char *words)
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, words);
    waam_core_send(core, &text, WAAM_TX_ASSURED);
}

static int64_t number_of(const waam_core_t *core, uint32_t line) { return (int64_t)line - core->link.base; }

void waam_marlin_ok(waam_core_t *core)
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, "ok N");
    waam_text_int(&text, number_of(core, core->link.accepted));
    waam_text_add(&text, " P");
    waam_text_uint(&text, waam_planner_free(&core->planner));
    waam_text_add(&text, " B");
    waam_text_uint(&text, waam_link_free_bytes(&core->link));
    waam_core_send(core, &text, WAAM_TX_ASSURED);
}

void waam_marlin_resend(waam_core_t *core)
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, "Error:E");
    waam_text_uint(&text, core->link.resend_code);
    waam_text_add(&text, " Last Line: ");
    waam_text_int(&text, number_of(core, core->link.received));
    waam_core_send(core, &text, WAAM_TX_ASSURED);
    text.length = 0;
    waam_text_add(&text, "Resend: ");
    waam_text_int(&text, number_of(core, core->link.received) + 1);
    waam_core_send(core, &text, WAAM_TX_ASSURED);
    waam_marlin_ok(core);
}

/* No `ok` follows, so that the sender stops; M110 makes a new start. */
void waam_marlin_error(waam_core_t *core, const waam_error_t *error)
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, "Error:E");
    waam_text_uint(&text, error->code);
    waam_text_add(&text, " line ");
    waam_text_int(&text, number_of(core, core->link.accepted) + 1);
    waam_text_add(&text, " column ");
    waam_text_uint(&text, error->column);
    waam_text_add(&text, ": ");
    waam_text_bytes(&text, error->text.text, error->text.length);
    waam_core_send(core, &text, WAAM_TX_ASSURED);
    say(core, "!! nothing more is taken until M110");
}

static void position(waam_core_t *core)
{
    static const char *const names[] = {"ok X:", " Y:", " Z:"};
    waam_text_t text = {.length = 0};
    for (int i = 0; i < WAAM_AXES; i++) {
        double machine_mm = (double)waam_core_steps(core, i) / core->config.steps_per_mm[i];
        waam_text_add(&text, names[i]);
        waam_text_fixed(&text, machine_mm - waam_core_zero_mm(core, &core->executed_modal, i), 3);
    }
    waam_text_add(&text, " E:0");
    waam_core_send(core, &text, WAAM_TX_ASSURED);
}

bool waam_marlin_query(waam_core_t *core, const char *line, size_t length, size_t at)
{
    switch (waam_marlin_m_word(line, length, at)) {
    case 105: say(core, "ok T:0.0 /0.0"); return true;
    case 114: position(core); return true;
    case 115:
        say(core, "ok FIRMWARE_NAME:WAAM_CONTROLLER_V1 " WAAM_FIRMWARE_VERSION
                  " PROTOCOL_VERSION:1.0 MACHINE_TYPE:WAAM EXTRUDER_COUNT:0");
        return true;
    default: return false;
    }
}

/* ---- what it may do ---- */

static bool enter(waam_core_t *core)
{
    bool entered = core->link.dialect == WAAM_DIALECT_MARLIN;
    if (!waam_core_hand_over(core, WAAM_DIALECT_MARLIN))
        return false;
    if (!entered)
        say(core, "start");
    return true;
}

/* M110 [N<n>]: the next line is n + 1. Numbers inside the core keep on growing. */
static void renumber(waam_core_t *core, const char *line, size_t length)
{
    int64_t number = 0;
    size_t at = length;
    while (at > 0 && line[at - 1] != 'N' && line[at - 1] != 'n')
        at--;
    if (at == 0 || !waam_marlin_number(line + at - 1, length - at + 1, &number) || number < -1)
        number = 0;
    core->link.base = (int64_t)core->link.accepted - number;
    waam_link_resync(&core->link, core->link.accepted + 1);
    waam_marlin_ok(core);
}

/* M999: leaves ALARM, or forgets what is held. */
static void restart(waam_core_t *core)
{
    const char *text = "";
    waam_code_t code = WAAM_OK;
    if (core->state == WAAM_ALARM)
        code = waam_core_reset(core, &text);
    else if (core->state == WAAM_HOLD)
        waam_core_stop(core);
    if (code) {
        waam_error_t error;
        waam_fail(&error, code, 1, text);
        waam_marlin_error(core, &error);
        return;
    }
    waam_link_resync(&core->link, core->link.accepted + 1);
    waam_marlin_ok(core);
}

/* Without number and check, so its answer says what is in force. */
static bool set(waam_core_t *core, const char *line, size_t length)
{
    waam_error_t error;
    waam_marlin_done_t done = waam_marlin_setting(core, line, length, 0, false, &error);
    if (done == WAAM_MARLIN_OTHER)
        return false;
    if (done == WAAM_MARLIN_REFUSED) {
        waam_text_t text = {.length = 0};
        waam_text_add(&text, "echo:E");
        waam_text_uint(&text, error.code);
        waam_text_char(&text, ' ');
        waam_text_bytes(&text, error.text.text, error.text.length);
        waam_core_send(core, &text, WAAM_TX_ASSURED);
    }
    waam_marlin_ok(core);
    return true;
}

void waam_marlin_line(waam_core_t *core, const char *line, size_t length)
{
    bool numbered = line[0] == 'N' || line[0] == 'n';
    int code = waam_marlin_m_word(line, length, numbered ? waam_marlin_after_number(line, length) : 0);
    if (!enter(core))
        return;
    switch (code) {
    case 110: renumber(core, line, length); break;
    case 112: waam_core_stop(core); break;
    case 108:
        waam_core_resume(core);
        waam_marlin_ok(core);
        break;
    case 999: restart(core); break;
    default:
        if (waam_marlin_query(core, line, length, 0) || set(core, line, length))
            break;
        say(core, "echo:E108 not done: what moves needs a line number and a checksum");
        waam_marlin_ok(core);
    }
}
