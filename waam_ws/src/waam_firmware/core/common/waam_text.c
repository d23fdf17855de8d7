#include "waam_text.h"

void waam_text_clear(waam_text_t *t) { t->length = 0; }

void waam_text_char(waam_text_t *t, char c)
{
    if (t->length < sizeof t->text - 13) /* room for the check is always kept */
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

/* Sign and whole part; what is left is the fraction, in 1 / scale. */
static uint64_t whole_part(waam_text_t *t, double value, unsigned decimals, uint64_t *scale)
{
    *scale = 1;
    for (unsigned i = 0; i < decimals; i++)
        *scale *= 10;
    uint64_t scaled = (uint64_t)((value < 0 ? -value : value) * (double)*scale + 0.5);
    if (value < 0 && scaled)
        waam_text_char(t, '-');
    waam_text_uint(t, scaled / *scale);
    return scaled % *scale;
}

void waam_text_fixed(waam_text_t *t, double value, unsigned decimals)
{
    uint64_t scale, fraction = whole_part(t, value, decimals, &scale);
    if (!fraction)
        return;
    waam_text_char(t, '.');
    for (uint64_t unit = scale / 10; unit > 0 && fraction % (unit * 10) > 0; unit /= 10)
        waam_text_char(t, (char)('0' + fraction / unit % 10));
}

void waam_text_seal(waam_text_t *t, bool strong)
{
    uint32_t check = strong ? waam_crc32(t->text, t->length) : waam_crc16(t->text, t->length);
    char *end = t->text + t->length;
    *end++ = '*';
    for (uint32_t place = strong ? 1000000000 : 10000; place; place /= 10)
        *end++ = (char)('0' + check / place % 10);
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

/* By half bytes: 16 entries instead of 256. */
uint32_t waam_crc32(const char *bytes, size_t count)
{
    static const uint32_t table[16] = {
        0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC, 0x76DC4190, 0x6B6B51F4, 0x4DB26158, 0x5005713C,
        0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C, 0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C};
    uint32_t crc = 0xFFFFFFFF;
    for (size_t i = 0; i < count; i++) {
        crc ^= (uint8_t)bytes[i];
        crc = (crc >> 4) ^ table[crc & 15];
        crc = (crc >> 4) ^ table[crc & 15];
    }
    return ~crc;
}

unsigned waam_check_line(const char *line, size_t count, size_t *content)
{
    unsigned digits = 0;
    uint64_t given = 0;
    while (digits < count && digits < 11 && line[count - 1 - digits] >= '0' && line[count - 1 - digits] <= '9')
        digits++;
    if (digits == 0 || digits >= count || line[count - 1 - digits] != '*')
        return 0;
    *content = count - 1 - digits;
    for (size_t i = *content + 1; i < count; i++)
        given = given * 10 + (uint64_t)(line[i] - '0');
    switch (digits) {
    case 5: return given == waam_crc16(line, *content) ? digits : 0;
    case 10: return given == waam_crc32(line, *content) ? digits : 0;
    default: return 0;
    }
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
    size_t at = c->at, digits = 0;
    bool negative = at < c->length && c->text[at] == '-';
    if (at < c->length && (c->text[at] == '-' || c->text[at] == '+'))
        at++;
    uint64_t size = 0, scale = 1; /* size < 1e18: nine places before the point and nine after it */
    for (; is_digit(c, at); at++, digits++)
        if ((size = size * 10 + (uint64_t)(c->text[at] - '0')) >= 1000000000)
            return false;
    if (at < c->length && c->text[at] == '.') {
        for (at++; is_digit(c, at); at++, digits++) {
            if (scale == 1000000000)
                continue;
            size = size * 10 + (uint64_t)(c->text[at] - '0');
            scale *= 10;
        }
    }
    if (digits == 0)
        return false;
    *value = (negative ? -1.0 : 1.0) * (double)size / (double)scale;
    c->at = at;
    return true;
}

bool waam_digits_follow(const waam_cursor_t *c)
{
    size_t at = c->at;
    while (at < c->length && (c->text[at] == ' ' || c->text[at] == '\t'))
        at++;
    if (at < c->length && (c->text[at] == '-' || c->text[at] == '+'))
        at++;
    if (at < c->length && c->text[at] == '.')
        at++;
    return is_digit(c, at);
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
