/* Building and checking lines of text without printf. */
#ifndef WAAM_TEXT_H
#define WAAM_TEXT_H

#include "waam_types.h"

typedef struct {
    char text[480];
    size_t length;
} waam_text_t;

/* The functions below append; what does not fit is left out. */
void waam_text_clear(waam_text_t *t);
void waam_text_bytes(waam_text_t *t, const char *bytes, size_t count);
void waam_text_add(waam_text_t *t, const char *string);
void waam_text_char(waam_text_t *t, char c);
void waam_text_uint(waam_text_t *t, uint64_t value);
void waam_text_int(waam_text_t *t, int64_t value);
/* Rounded to `decimals` digits, trailing zeros removed. */
void waam_text_fixed(waam_text_t *t, double value, unsigned decimals);
/* The same with the zeros: always so many decimals. */
/* Appends "*", the CRC-16 in five digits (`strong`: the CRC-32 in ten) and a line feed. */
void waam_text_seal(waam_text_t *t, bool strong);

/* CRC-16/CCITT-FALSE: polynomial 0x1021, initial value 0xFFFF. */
uint16_t waam_crc16(const char *bytes, size_t count);
/* CRC-32 (IEEE 802.3, reflected, as in Ethernet and zip). */
uint32_t waam_crc32(const char *bytes, size_t count);
/* Digits of the check (1-3 XOR-8, 5 CRC-16, 10 CRC-32) when the line ends in '*' and a right one, else 0;
 * *content is then the number of bytes before the '*'. */
unsigned waam_check_line(const char *line, size_t count, size_t *content);

/* Reading: a cursor over the words of a line. */
typedef struct {
    const char *text;
    size_t length, at;
} waam_cursor_t;

/* Blanks and tabs. */
void waam_skip_spaces(waam_cursor_t *c);
bool waam_at_end(waam_cursor_t *c);
/* Decimal number: sign, digits, point, digits, as many as there are, correctly rounded; no exponent; |value| < 1e9. The
 * cursor stays when there is none. */
bool waam_read_number(waam_cursor_t *c, double *value);
/* Do digits follow, so that a number that could not be read is too large? */
bool waam_digits_follow(const waam_cursor_t *c);
/* Digits after blanks. False, with the cursor where it was, when there are none or the number is too large. */
bool waam_read_uint(waam_cursor_t *c, uint64_t *value);

#endif
