/* The parser alone: each line of the input is one block of G-code, parsed with the modal state that the lines before left.
 * Whatever comes in, the answer is a command made of finite numbers within the limits, or an error with code, column and
 * a printable text. The bytes also go through the check of sealed lines, and what follows each letter through the reader of
 * numbers, which must say what the C library says. */
#include <math.h>
#include <string.h>

#include "fuzz.h"
#include "waam_gcode.h"

static const waam_gcode_limits_t limits = {.wire_max_mm_s = 300.0, .voltage_max_v = 60.0};

static void require_command(const waam_command_t *c)
{
    for (int i = 0; i < WAAM_AXES; i++)
        REQUIRE(!c->has[i] || (isfinite(c->axis_mm[i]) && fabs(c->axis_mm[i]) < 1e11), "coordinate");
    REQUIRE(c->action != WAAM_DO_DWELL || (c->dwell_s >= 0.0 && c->dwell_s <= 3600.0), "dwell");
    REQUIRE(c->action != WAAM_DO_GAS || c->gas != WAAM_GAS_KEEP, "gas");
    REQUIRE(c->action != WAAM_DO_ARC_START || c->gas != WAAM_GAS_OFF, "an arc has gas");
    REQUIRE(isfinite(c->modal.feed_mm_s) && c->modal.feed_mm_s >= 0.0, "feed");
    REQUIRE(c->modal.wire_mm_s >= 0.0 && c->modal.wire_mm_s <= limits.wire_max_mm_s, "wire speed");
    REQUIRE(c->modal.voltage_v >= 0.0 && c->modal.voltage_v <= limits.voltage_max_v, "voltage");
}

static void require_error(const waam_error_t *e, size_t length)
{
    REQUIRE(e->code >= WAAM_E_CHECK && e->code <= WAAM_E_NOT_ARMED, "code");
    REQUIRE(e->column >= 1 && e->column <= length + 1, "column");
    REQUIRE(e->text.length < sizeof e->text.text, "length of the text");
    for (size_t i = 0; i < e->text.length; i++)
        REQUIRE(e->text.text[i] >= ' ' && e->text.text[i] <= '~', "printable text");
}

static void require_numbers(const char *line, size_t length)
{
    for (size_t i = 1; i < length; i++) {
        waam_cursor_t cursor = {line, length, i};
        double value, expected;
        char text[WAAM_LINE_MAX + 1];
        if (line[i] == ' ' || line[i] == '\t' || (line[i - 1] | 32) < 'a' || (line[i - 1] | 32) > 'z' ||
            !waam_read_number(&cursor, &value))
            continue;
        REQUIRE(cursor.at > i && cursor.at <= length, "end of a number");
        memcpy(text, line + i, cursor.at - i);
        text[cursor.at - i] = '\0';
        expected = strtod(text, NULL);
        REQUIRE(fabs(value - expected) < 1.1e-9 + 1e-15 * fabs(expected), "value of a number");
    }
}

static void parse(const char *line, size_t length, waam_modal_t *modal)
{
    waam_command_t command;
    waam_error_t error = {0};
    memset(&command, 0xA5, sizeof command.axis_mm); /* nothing may be read that the parser did not write */
    if (waam_gcode_parse(line, length, 0, modal, &limits, &command, &error)) {
        require_command(&command);
        *modal = command.modal;
    } else {
        require_error(&error, length);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    waam_modal_t modal = {0};
    while (size) {
        const uint8_t *end = memchr(data, '\n', size);
        size_t length = end ? (size_t)(end - data) : size, used = end ? length + 1 : size, content;
        length = length < WAAM_LINE_MAX ? length : WAAM_LINE_MAX;
        char *line = malloc(length ? length : 1); /* exactly as long as the line, so that reading past its end is found */
        REQUIRE(line, "memory");
        memcpy(line, data, length);
        if (waam_check_line(line, length, &content))
            REQUIRE(content < length, "content of a checked line");
        require_numbers(line, length);
        parse(line, length, &modal);
        free(line);
        data += used;
        size -= used;
    }
    return 0;
}
