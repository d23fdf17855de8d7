/* What arrives over the link: lines are taken while there are free blocks, answered, refused or asked for again. */
#include "waam_internal.h"

static void acknowledge(waam_core_t *core)
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, "ok N");
    waam_text_uint(&text, core->link.accepted);
    waam_text_add(&text, " P");
    waam_text_uint(&text, waam_planner_free(&core->planner));
    waam_text_add(&text, " B");
    waam_text_uint(&text, waam_link_free_bytes(&core->link));
    waam_core_send(core, &text, WAAM_TX_ASSURED);
}

static void report_error(waam_core_t *core, const waam_error_t *error)
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, "er N");
    waam_text_uint(&text, core->link.accepted + 1);
    waam_text_add(&text, " E");
    waam_text_uint(&text, error->code);
    waam_text_add(&text, " C");
    waam_text_uint(&text, error->column);
    waam_text_char(&text, ' ');
    waam_text_bytes(&text, error->text.text, error->text.length);
    waam_core_send(core, &text, WAAM_TX_ASSURED);
    waam_link_block(&core->link, true);
}

/* The first line after a stop or an alarm; more of what was under way is dropped in silence. */
static void report_blocked(waam_core_t *core)
{
    waam_error_t error;
    waam_fail(&error, WAAM_E_NOT_NOW, 1,
              core->state == WAAM_ALARM ? "ALARM: reset first" : "stopped: say which line comes next ($L) first");
    report_error(core, &error);
}

static size_t after_number(const char *line, size_t length)
{
    size_t at = 1;
    while (at < length && line[at] >= '0' && line[at] <= '9')
        at++;
    return at;
}

static bool take_line(waam_core_t *core)
{
    char line[WAAM_LINE_MAX];
    size_t length = waam_link_next(&core->link, line);
    waam_gcode_limits_t limits = {core->config.wire_max_mm_s, core->config.voltage_max_v};
    waam_command_t command;
    waam_error_t error;
    if (length == 0)
        return false;
    bool good = core->state == WAAM_ALARM
                    ? waam_fail(&error, WAAM_E_NOT_NOW, 1, "ALARM: reset first")
                    : waam_gcode_parse(line, length, after_number(line, length), &core->modal, &limits, &command, &error);
    if (!good || !waam_core_plan(core, &command, core->link.accepted + 1, &error)) {
        report_error(core, &error);
        return false;
    }
    waam_link_accept(&core->link);
    acknowledge(core);
    return true;
}

void waam_core_take_lines(waam_core_t *core)
{
    while (!core->stopping && waam_planner_free(&core->planner) > 0 && take_line(core)) {
    }
}

static void ask_resend(waam_core_t *core)
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, "rs N");
    waam_text_uint(&text, core->link.received + 1);
    waam_text_add(&text, " E");
    waam_text_uint(&text, core->link.resend_code);
    waam_core_send(core, &text, WAAM_TX_ASSURED);
}

/* A fault is not resumed by a byte: only HOLD 200 is. */
static void real_time(waam_core_t *core, uint8_t byte)
{
    switch (byte) {
    case WAAM_BYTE_HOLD: waam_core_hold(core, WAAM_E_HOLD, "hold by host", false); break;
    case WAAM_BYTE_RESUME:
        if (core->fault == WAAM_E_HOLD)
            waam_core_resume(core);
        break;
    default: waam_core_stop(core); break;
    }
}

static void line_byte(waam_core_t *core, uint8_t byte)
{
    waam_link_t *link = &core->link;
    waam_rx_t result = waam_link_byte(link, byte);
    if (result == WAAM_RX_NONE)
        return;
    if (result == WAAM_RX_RESEND) {
        ask_resend(core);
        return;
    }
    core->heard_us = core->now_us;
    switch (result) {
    case WAAM_RX_IMMEDIATE: waam_core_immediate(core, link->line, link->length); break;
    case WAAM_RX_DUPLICATE: acknowledge(core); break;
    case WAAM_RX_BLOCKED: report_blocked(core); break;
    default: waam_core_take_lines(core); break;
    }
    if (result == WAAM_RX_IMMEDIATE)
        link->length = 0;
}

/* A real-time byte acts when it comes twice in a row, for noise makes single ones; more of the same are a burst. A
 * single one belongs to its line and spoils it. */
void waam_core_rx(waam_core_t *core, uint8_t byte)
{
    bool special = byte >= WAAM_BYTE_HOLD && byte <= WAAM_BYTE_STOP;
    if (core->burst && byte == core->burst_byte) {
        core->burst = core->burst < 3 ? core->burst + 1 : 3;
        if (core->burst == 2)
            real_time(core, byte);
        return;
    }
    if (core->burst == 1)
        line_byte(core, core->burst_byte);
    core->burst = special ? 1 : 0;
    core->burst_byte = byte;
    if (!special)
        line_byte(core, byte);
}

void waam_core_hang_up(waam_core_t *core)
{
    waam_link_t *link = &core->link;
    link->length = 0;
    link->overlong = link->strong = false;
    core->burst = 0;
    link->known = false;
}
