#include "waam_grbl_dialect.h"

bool waam_grbl_asks(const char *line, size_t length)
{
    static const char questions[] = "$#GIN";
    if (length == 0 || length > 2 || line[0] != '$')
        return false;
    for (const char *q = questions; *q && length == 2; q++)
        if (line[1] == *q)
            return true;
    return length == 1;
}

static bool is_letter(char c, char capital) { return c == capital || c == capital - 'A' + 'a'; }

static bool arc_code(const char *line, size_t length, size_t at)
{
    waam_cursor_t cursor = {line, length, at};
    double code;
    return waam_read_number(&cursor, &code) && (code == 3.0 || code == 4.0 || code == 82.0 || code == 83.0);
}

size_t waam_grbl_arc_word(const char *line, size_t length)
{
    bool comment = false;
    for (size_t i = 0; i < length && (comment || line[i] != ';'); i++) {
        comment = comment ? line[i] != ')' : line[i] == '(';
        if (comment)
            continue;
        if (is_letter(line[i], 'W') || is_letter(line[i], 'E') || (is_letter(line[i], 'M') && arc_code(line, length, i + 1)))
            return i + 1;
    }
    return 0;
}

unsigned waam_grbl_error(waam_code_t code)
{
    switch (code) {
    case WAAM_E_SYNTAX: return 1;
    case WAAM_E_NUMBER: return 2;
    case WAAM_E_UNKNOWN_WORD: return 20;
    case WAAM_E_CONTRADICTION: return 21;
    case WAAM_E_TOO_LONG: return 11;
    case WAAM_E_MISSING_WORD: return 28;
    case WAAM_E_NOT_NOW: return 8;
    case WAAM_E_SOFT_LIMIT: return 15;
    case WAAM_E_NOT_ARMED: return 20;
    default: return 9;
    }
}

unsigned waam_grbl_alarm(waam_code_t code)
{
    switch (code) {
    case WAAM_E_LIMIT_SWITCH: return 1;
    case WAAM_E_SOFT_LIMIT: return 2;
    case WAAM_E_NOT_HOMED: return 9; /* a home switch was not found */
    default: return 3;
    }
}
