/* Settings for 3-D printing senders: M92 tells or sets steps per mm, M503 tells them. */
#include "waam_internal.h"
#include "waam_marlin_dialect.h"
#include "waam_scale.h"

static void tell(waam_core_t *core, const char *words)
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, words);
    for (int i = 0; i < WAAM_AXES; i++) {
        waam_text_char(&text, ' ');
        waam_text_char(&text, waam_axis_names[i]);
        waam_text_places(&text, core->config.steps_per_mm[i], 3);
    }
    waam_core_send(core, &text, WAAM_TX_ASSURED);
}

static int axis_of(char letter)
{
    for (int i = 0; i < WAAM_AXES; i++)
        if (letter == waam_axis_names[i] || letter == waam_axis_names[i] - 'A' + 'a')
            return i;
    return -1;
}

/* "X319.873 Y320" after the M word, up to a comment. */
static bool read_axes(waam_cursor_t *cursor, double steps_per_mm[WAAM_AXES], waam_error_t *error)
{
    while (!waam_at_end(cursor) && cursor->text[cursor->at] != ';') {
        size_t column = cursor->at + 1;
        int axis = axis_of(cursor->text[cursor->at++]);
        if (axis < 0)
            return waam_fail(error, WAAM_E_UNKNOWN_WORD, column, "M92 takes X, Y and Z");
        if (!waam_read_number(cursor, &steps_per_mm[axis]))
            return waam_fail(error, WAAM_E_NUMBER, column, "a number is missing or malformed");
    }
    return true;
}

static bool scale(waam_core_t *core, waam_cursor_t *cursor, waam_error_t *error)
{
    double steps_per_mm[WAAM_AXES];
    bool homed = core->homed;
    for (int i = 0; i < WAAM_AXES; i++)
        steps_per_mm[i] = core->config.steps_per_mm[i];
    if (!read_axes(cursor, steps_per_mm, error) || !waam_core_scale(core, steps_per_mm, error))
        return false;
    tell(core, homed && !core->homed ? "echo:homing is lost, send G28; M92" : "echo:M92");
    return true;
}

waam_marlin_done_t waam_marlin_setting(waam_core_t *core, const char *line, size_t length, size_t at, bool waits,
                                       waam_error_t *error)
{
    int code = waam_marlin_m_word(line, length, at);
    waam_cursor_t cursor = {line, length, at};
    if (code == 503) {
        waam_text_t text = {.length = 0};
        waam_text_add(&text, "echo:; Steps per unit:");
        waam_core_send(core, &text, WAAM_TX_ASSURED);
        tell(core, "echo: M92");
        return WAAM_MARLIN_DONE;
    }
    if (code != 92)
        return WAAM_MARLIN_OTHER;
    waam_skip_spaces(&cursor);
    uint64_t number;
    cursor.at++; /* M */
    waam_read_uint(&cursor, &number);
    bool busy = core->state == WAAM_RUN || core->planner.count > 0;
    if (waits && busy && !waam_at_end(&cursor))
        return WAAM_MARLIN_LATER;
    return scale(core, &cursor, error) ? WAAM_MARLIN_DONE : WAAM_MARLIN_REFUSED;
}
