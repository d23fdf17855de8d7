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
    waam_link_block(&core->link);
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

/* A byte made by noise may slow the machine down but never start it again after a fault. */
static bool real_time_byte(waam_core_t *core, uint8_t byte)
{
    switch (byte) {
    case 0x80: waam_core_hold(core, WAAM_E_HOLD, "hold by host", false); return true;
    case 0x81:
        if (core->fault == WAAM_E_HOLD)
            waam_core_resume(core);
        return true;
    case 0x82: waam_core_stop(core); return true;
    default: return false;
    }
}

void waam_core_rx(waam_core_t *core, uint8_t byte)
{
    if (real_time_byte(core, byte))
        return;
    waam_rx_t result = waam_link_byte(&core->link, byte);
    if (result == WAAM_RX_NONE)
        return;
    if (result == WAAM_RX_RESEND) {
        ask_resend(core);
        return;
    }
    core->heard_us = core->now_us;
    if (result == WAAM_RX_IMMEDIATE) {
        waam_core_immediate(core, core->link.line, core->link.length);
        core->link.length = 0;
    } else if (result == WAAM_RX_DUPLICATE) {
        acknowledge(core);
    } else {
        waam_core_take_lines(core);
    }
}
