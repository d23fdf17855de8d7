#include "waam_gcode.h"

#define INCH_MM 25.4
#define FEED_MAX_MM_MIN 60000.0
#define DWELL_MAX_S 3600.0
#define VALUE_LETTERS 7

static const char value_letters[VALUE_LETTERS + 1] = "XYZFPWS";
enum { X, Y, Z, F, P, W, S };

typedef struct {
    waam_cursor_t cursor;
    waam_command_t *command;
    waam_error_t *error;
    bool has[VALUE_LETTERS];
    double value[VALUE_LETTERS];
    size_t column[VALUE_LETTERS];
    bool has_units, has_distance, has_motion;
    size_t action_column;
} parser_t;

bool waam_fail(waam_error_t *error, waam_code_t code, size_t column, const char *text)
{
    error->code = code;
    error->column = column;
    waam_text_clear(&error->text);
    waam_text_add(&error->text, text);
    return false;
}

static bool fail_word(parser_t *p, waam_code_t code, size_t column, char letter, const char *text)
{
    waam_fail(p->error, code, column, "");
    waam_text_char(&p->error->text, letter);
    waam_text_add(&p->error->text, text);
    return false;
}

static bool fail_number(parser_t *p, waam_code_t code, size_t column, char letter, double number, const char *text)
{
    waam_fail(p->error, code, column, "");
    waam_text_char(&p->error->text, letter);
    waam_text_fixed(&p->error->text, number, 3);
    waam_text_add(&p->error->text, text);
    return false;
}

static bool set_action(parser_t *p, waam_action_t action, size_t column)
{
    if (p->command->action != WAAM_DO_NOTHING)
        return waam_fail(p->error, WAAM_E_CONTRADICTION, column, "two actions in one line");
    p->command->action = action;
    p->action_column = column;
    return true;
}

static bool set_once(parser_t *p, bool *seen, size_t column, const char *text)
{
    if (*seen)
        return waam_fail(p->error, WAAM_E_CONTRADICTION, column, text);
    *seen = true;
    return true;
}

static bool word_g(parser_t *p, double number, size_t column)
{
    waam_modal_t *modal = &p->command->modal;
    int code = (int)number;
    if (number != code)
        return fail_number(p, WAAM_E_UNKNOWN_WORD, column, 'G', number, " is not known");
    switch (code) {
    case 0:
    case 1:
        modal->motion = code ? WAAM_MOTION_LINE : WAAM_MOTION_RAPID;
        return set_once(p, &p->has_motion, column, "G0 or G1 given twice");
    case 4: return set_action(p, WAAM_DO_DWELL, column);
    case 20:
    case 21:
        modal->inch = code == 20;
        return set_once(p, &p->has_units, column, "G20 or G21 given twice");
    case 28: return set_action(p, WAAM_DO_HOME, column);
    case 53: p->command->machine_frame = true; return true;
    case 54: return true;
    case 90:
    case 91:
        modal->relative = code == 91;
        return set_once(p, &p->has_distance, column, "G90 or G91 given twice");
    case 92: return set_action(p, WAAM_DO_SET_POSITION, column);
    default: return fail_number(p, WAAM_E_UNKNOWN_WORD, column, 'G', number, " is not known");
    }
}

static bool word_m(parser_t *p, double number, size_t column)
{
    int code = (int)number;
    if (number == code)
        switch (code) {
        case 0: return set_action(p, WAAM_DO_PAUSE, column);
        case 2:
        case 30: return set_action(p, WAAM_DO_FINISH, column);
        case 3: return set_action(p, WAAM_DO_ARC_START, column);
        case 5: return set_action(p, WAAM_DO_ARC_END, column);
        case 7:
        case 8: return set_action(p, WAAM_DO_GAS_ON, column);
        case 9: return set_action(p, WAAM_DO_GAS_OFF, column);
        default: break;
        }
    return fail_number(p, WAAM_E_UNKNOWN_WORD, column, 'M', number, " is not known");
}

static bool word(parser_t *p)
{
    size_t column = p->cursor.at + 1;
    char letter = p->cursor.text[p->cursor.at++];
    if (letter >= 'a' && letter <= 'z')
        letter = (char)(letter - 'a' + 'A');
    if (letter < 'A' || letter > 'Z')
        return waam_fail(p->error, WAAM_E_SYNTAX, column, "a letter was expected here");
    double number;
    bool numbered = waam_read_number(&p->cursor, &number);
    if (letter == 'G' || letter == 'M') {
        if (!numbered || number < 0)
            return fail_word(p, WAAM_E_NUMBER, column, letter, " needs a number");
        return letter == 'G' ? word_g(p, number, column) : word_m(p, number, column);
    }
    for (size_t i = 0; i < VALUE_LETTERS; i++) {
        if (value_letters[i] != letter)
            continue;
        if (!numbered)
            return fail_word(p, WAAM_E_NUMBER, column, letter, " needs a number");
        p->value[i] = number;
        p->column[i] = column;
        return set_once(p, &p->has[i], column, "the same word twice");
    }
    return fail_word(p, WAAM_E_UNKNOWN_WORD, column, letter, " is not a word of this controller");
}

/* Skips "( )"; a ';' ends the line. */
static bool comment(parser_t *p)
{
    waam_cursor_t *c = &p->cursor;
    if (c->text[c->at] == ';') {
        c->at = c->length;
        return true;
    }
    size_t open = c->at;
    while (c->at < c->length && c->text[c->at] != ')')
        c->at++;
    if (c->at == c->length)
        return waam_fail(p->error, WAAM_E_SYNTAX, open + 1, "comment is not closed");
    c->at++;
    return true;
}

static bool read_words(parser_t *p)
{
    while (!waam_at_end(&p->cursor)) {
        char c = p->cursor.text[p->cursor.at];
        if (!(c == '(' || c == ';' ? comment(p) : word(p)))
            return false;
    }
    return true;
}

static bool in_range(parser_t *p, int word_index, double lowest, double highest, const char *unit)
{
    double value = p->value[word_index];
    if (value >= lowest && value <= highest)
        return true;
    waam_text_t *text = &p->error->text;
    fail_number(p, WAAM_E_NUMBER, p->column[word_index], value_letters[word_index], value, " is outside ");
    waam_text_fixed(text, lowest, 3);
    waam_text_add(text, "..");
    waam_text_fixed(text, highest, 3);
    waam_text_add(text, unit);
    return false;
}

static bool apply_values(parser_t *p, const waam_gcode_limits_t *limits)
{
    waam_modal_t *modal = &p->command->modal;
    double unit = modal->inch ? INCH_MM : 1.0;
    p->value[F] *= unit;
    p->value[W] *= unit;
    if (p->has[F]) {
        if (!in_range(p, F, 0.001, FEED_MAX_MM_MIN, " mm/min"))
            return false;
        modal->feed_mm_s = p->value[F] / 60.0;
    }
    if (p->has[W]) {
        if (!in_range(p, W, 0.0, limits->wire_max_mm_s * 60.0, " mm/min"))
            return false;
        modal->wire_mm_s = p->value[W] / 60.0;
    }
    if (p->has[S]) {
        if (!in_range(p, S, 0.0, limits->voltage_max_v, " V"))
            return false;
        modal->voltage_v = p->value[S];
    }
    for (int i = 0; i < WAAM_AXES; i++) {
        p->command->has[i] = p->has[i];
        p->command->axis_mm[i] = p->value[i] * unit;
    }
    return true;
}

static bool check_axes(parser_t *p)
{
    waam_command_t *command = p->command;
    bool axes = p->has[X] || p->has[Y] || p->has[Z];
    size_t first = p->has[X] ? p->column[X] : p->has[Y] ? p->column[Y] : p->column[Z];
    if (command->action == WAAM_DO_SET_POSITION)
        return axes || waam_fail(p->error, WAAM_E_MISSING_WORD, p->action_column, "G92 needs X, Y or Z");
    if (!axes)
        return true;
    if (command->action != WAAM_DO_NOTHING)
        return waam_fail(p->error, WAAM_E_CONTRADICTION, first, "X, Y, Z do not go with this action");
    if (command->modal.motion == WAAM_MOTION_NONE)
        return waam_fail(p->error, WAAM_E_MISSING_WORD, first, "X, Y, Z need G0 or G1 first");
    if (command->modal.motion == WAAM_MOTION_LINE && command->modal.feed_mm_s <= 0)
        return waam_fail(p->error, WAAM_E_MISSING_WORD, first, "G1 needs a feed F");
    command->action = WAAM_DO_MOVE;
    return true;
}

static bool check_other(parser_t *p)
{
    waam_command_t *command = p->command;
    bool dwell = command->action == WAAM_DO_DWELL;
    if (p->has[P] != dwell)
        return dwell ? waam_fail(p->error, WAAM_E_MISSING_WORD, p->action_column, "G4 needs P, seconds")
                     : waam_fail(p->error, WAAM_E_CONTRADICTION, p->column[P], "P goes with G4 only");
    if (dwell && !in_range(p, P, 0.0, DWELL_MAX_S, " s"))
        return false;
    command->dwell_s = p->value[P];
    if (command->machine_frame && command->action != WAAM_DO_MOVE)
        return waam_fail(p->error, WAAM_E_CONTRADICTION, 1, "G53 goes with a move only");
    if (command->machine_frame && command->modal.relative)
        return waam_fail(p->error, WAAM_E_CONTRADICTION, 1, "G53 needs G90");
    if (command->action != WAAM_DO_ARC_START)
        return true;
    if (command->modal.wire_mm_s <= 0)
        return waam_fail(p->error, WAAM_E_MISSING_WORD, p->action_column, "M3 needs a wire feed speed W");
    return command->modal.voltage_v > 0 ||
           waam_fail(p->error, WAAM_E_MISSING_WORD, p->action_column, "M3 needs a voltage S");
}

bool waam_gcode_parse(const char *line, size_t length, size_t start, const waam_modal_t *before,
                      const waam_gcode_limits_t *limits, waam_command_t *command, waam_error_t *error)
{
    *command = (waam_command_t){.modal = *before};
    parser_t p = {.cursor = {line, length, start}, .command = command, .error = error};
    return read_words(&p) && apply_values(&p, limits) && check_axes(&p) && check_other(&p);
}
