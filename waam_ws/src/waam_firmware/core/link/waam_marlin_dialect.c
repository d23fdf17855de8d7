#include "waam_marlin_dialect.h"

bool waam_marlin_number(const char *line, size_t length, int64_t *number)
{
    bool negative = length > 1 && line[1] == '-';
    waam_cursor_t cursor = {line, length, negative ? 2 : 1};
    uint64_t value;
    if (length <= cursor.at || (line[0] != 'N' && line[0] != 'n') || line[cursor.at] == ' ' ||
        !waam_read_uint(&cursor, &value) || value > UINT32_MAX)
        return false;
    *number = negative ? -(int64_t)value : (int64_t)value;
    return true;
}

int waam_marlin_m_word(const char *text, size_t length, size_t at)
{
    waam_cursor_t cursor = {text, length, at};
    uint64_t value;
    waam_skip_spaces(&cursor);
    if (cursor.at >= length || (text[cursor.at] != 'M' && text[cursor.at] != 'm'))
        return -1;
    cursor.at++;
    return waam_read_uint(&cursor, &value) && value < 1000 ? (int)value : -1;
}

size_t waam_marlin_after_number(const char *line, size_t length)
{
    size_t at = 1;
    while (at < length && ((line[at] >= '0' && line[at] <= '9') || line[at] == '-'))
        at++;
    return at;
}

bool waam_marlin_renumbers(const char *line, size_t length)
{
    return waam_marlin_m_word(line, length, waam_marlin_after_number(line, length)) == 110;
}

bool waam_marlin_unnumbered(const char *line, size_t length, bool any)
{
    for (size_t i = 0; i < length; i++)
        if (line[i] == '*' || line[i] < ' ' || line[i] > '~')
            return false;
    int code = waam_marlin_m_word(line, length, 0);
    return any ? line[0] != 'N' && line[0] != 'n' && line[0] != '$' : code == 105 || code == 110 || code == 115;
}

void waam_marlin_frame(const waam_text_t *said, waam_text_t *line)
{
    waam_text_clear(line);
    waam_text_add(line, said->length > 1 && said->text[0] == '!' && said->text[1] == ' ' ? "echo:" : "");
    waam_text_bytes(line, said->text, said->length);
    waam_text_char(line, '\n');
}
