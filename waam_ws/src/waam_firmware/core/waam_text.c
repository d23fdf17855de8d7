#include "waam_text.h"

void waam_text_clear(waam_text_t *t) { t->length = 0; }

void waam_text_char(waam_text_t *t, char c)
{
    if (t->length < sizeof t->text - 8) /* room for the check is always kept */
        t->text[t->length++] = c;
}

void waam_text_bytes(waam_text_t *t, const char *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++)
        waam_text_char(t, bytes[i]);
}

void waam_text_add(waam_text_t *t, const char *string)
{
    while (*string)
        waam_text_char(t, *string++);
}

void waam_text_uint(waam_text_t *t, uint64_t value)
{
    char digits[20];
    unsigned n = 0;
    do {
        digits[n++] = (char)('0' + value % 10);
        value /= 10;
    } while (value);
    while (n)
        waam_text_char(t, digits[--n]);
}

void waam_text_int(waam_text_t *t, int64_t value)
{
    if (value < 0)
        waam_text_char(t, '-');
    waam_text_uint(t, value < 0 ? 0 - (uint64_t)value : (uint64_t)value);
}

void waam_text_fixed(waam_text_t *t, double value, unsigned decimals)
{
    uint64_t scale = 1;
    for (unsigned i = 0; i < decimals; i++)
        scale *= 10;
    uint64_t scaled = (uint64_t)((value < 0 ? -value : value) * (double)scale + 0.5);
    if (value < 0 && scaled)
        waam_text_char(t, '-');
    waam_text_uint(t, scaled / scale);
    uint64_t fraction = scaled % scale;
    if (!fraction)
        return;
    waam_text_char(t, '.');
    while (fraction) {
        scale /= 10;
        waam_text_char(t, (char)('0' + fraction / scale));
        fraction %= scale;
    }
}

void waam_text_seal(waam_text_t *t)
{
    uint16_t crc = waam_crc16(t->text, t->length);
    char *end = t->text + t->length;
    *end++ = '*';
    for (uint16_t place = 10000; place; place /= 10)
        *end++ = (char)('0' + crc / place % 10);
    *end++ = '\n';
    t->length = (size_t)(end - t->text);
}

uint16_t waam_crc16(const char *bytes, size_t count)
{
    uint16_t crc = 0xFFFF;
    for (size_t i = 0; i < count; i++) {
        uint8_t x = (uint8_t)((crc >> 8) ^ (uint8_t)bytes[i]);
        x ^= x >> 4;
        crc = (uint16_t)((crc << 8) ^ ((uint16_t)x << 12) ^ ((uint16_t)x << 5) ^ x);
    }
    return crc;
}

bool waam_check_line(const char *line, size_t count, size_t *content)
{
    size_t digits = 0;
    uint32_t given = 0;
    while (digits < count && digits < 6 && line[count - 1 - digits] >= '0' && line[count - 1 - digits] <= '9')
        digits++;
    if (digits == 0 || digits >= count || line[count - 1 - digits] != '*')
        return false;
    *content = count - 1 - digits;
    for (size_t i = *content + 1; i < count; i++)
        given = given * 10 + (uint32_t)(line[i] - '0');
    if (digits == 5)
        return given == waam_crc16(line, *content);
    if (digits > 3)
        return false;
    uint8_t parity = 0;
    for (size_t i = 0; i < *content; i++)
        parity ^= (uint8_t)line[i];
    return given == parity;
}

void waam_skip_spaces(waam_cursor_t *c)
{
    while (c->at < c->length && (c->text[c->at] == ' ' || c->text[c->at] == '\t'))
        c->at++;
}

bool waam_at_end(waam_cursor_t *c)
{
    waam_skip_spaces(c);
    return c->at >= c->length;
}

static bool is_digit(const waam_cursor_t *c, size_t at)
{
    return at < c->length && c->text[at] >= '0' && c->text[at] <= '9';
}

bool waam_read_number(waam_cursor_t *c, double *value)
{
    waam_skip_spaces(c);
    size_t at = c->at;
    bool negative = at < c->length && c->text[at] == '-';
    if (at < c->length && (c->text[at] == '-' || c->text[at] == '+'))
        at++;
    double mantissa = 0.0, scale = 1.0;
    size_t digits = 0;
    for (; is_digit(c, at); at++, digits++)
        mantissa = mantissa * 10.0 + (c->text[at] - '0');
    if (at < c->length && c->text[at] == '.')
        for (at++; is_digit(c, at); at++, digits++) {
            mantissa = mantissa * 10.0 + (c->text[at] - '0');
            scale *= 10.0;
        }
    if (digits == 0 || digits > 17 || mantissa / scale >= 1e9)
        return false;
    *value = negative ? -mantissa / scale : mantissa / scale;
    c->at = at;
    return true;
}

bool waam_read_uint(waam_cursor_t *c, uint64_t *value)
{
    waam_skip_spaces(c);
    size_t at = c->at;
    uint64_t result = 0;
    for (; is_digit(c, at); at++) {
        uint64_t digit = (uint64_t)(c->text[at] - '0');
        if (result > (UINT64_MAX - digit) / 10)
            return false;
        result = result * 10 + digit;
    }
    if (at == c->at)
        return false;
    *value = result;
    c->at = at;
    return true;
}
