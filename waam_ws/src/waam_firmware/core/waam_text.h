/* Building and checking lines of text without printf. */
#ifndef WAAM_TEXT_H
#define WAAM_TEXT_H

#include "waam_types.h"

typedef struct {
    char text[224];
    size_t length;
} waam_text_t;

void waam_text_clear(waam_text_t *t);
void waam_text_bytes(waam_text_t *t, const char *bytes, size_t count);
void waam_text_add(waam_text_t *t, const char *string);
void waam_text_char(waam_text_t *t, char c);
void waam_text_uint(waam_text_t *t, uint64_t value);
void waam_text_int(waam_text_t *t, int64_t value);
/* Rounded to `decimals` digits, trailing zeros removed. */
void waam_text_fixed(waam_text_t *t, double value, unsigned decimals);
/* Appends "*", the five digits of the CRC and a line feed. */
void waam_text_seal(waam_text_t *t);

/* CRC-16/CCITT-FALSE: polynomial 0x1021, initial value 0xFFFF. */
uint16_t waam_crc16(const char *bytes, size_t count);
/* True when the line ends in '*' and a right check; *content is then the number of bytes before the '*'. */
bool waam_check_line(const char *line, size_t count, size_t *content);

/* Reading: a cursor over the words of a line. */
typedef struct {
    const char *text;
    size_t length, at;
} waam_cursor_t;

void waam_skip_spaces(waam_cursor_t *c);
bool waam_at_end(waam_cursor_t *c);
/* Decimal number: sign, digits, point, digits; no exponent; |value| < 1e9. The cursor stays when there is none. */
bool waam_read_number(waam_cursor_t *c, double *value);
bool waam_read_uint(waam_cursor_t *c, uint64_t *value);

#endif
