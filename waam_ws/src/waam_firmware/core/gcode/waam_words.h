/* Between the reader of words (waam_gcode.c) and the check of what they say together (waam_words.c). */
#ifndef WAAM_WORDS_H
#define WAAM_WORDS_H

#include "waam_gcode.h"

#define WAAM_VALUE_LETTERS 9

/* Words that carry a value, in the order of waam_value_letters. */
enum { WAAM_X, WAAM_Y, WAAM_Z, WAAM_I, WAAM_J, WAAM_F, WAAM_P, WAAM_W, WAAM_S };
extern const char waam_value_letters[WAAM_VALUE_LETTERS + 1];

/* Modal groups of G and M words; one word of each per line. */
typedef enum {
    WAAM_GROUP_MOTION,
    WAAM_GROUP_DISTANCE,
    WAAM_GROUP_PLANE,   /* G17: of arcs, always XY */
    WAAM_GROUP_UNITS,   /* G21: always mm */
    WAAM_GROUP_FRAME,   /* G54: there is one */
    WAAM_GROUP_GAS,     /* M7, M9 */
    WAAM_GROUP_ACTION,
    WAAM_GROUPS
} waam_group_t;

typedef struct {
    waam_cursor_t cursor;
    waam_command_t *command;
    waam_error_t *error;
    const waam_gcode_limits_t *limits;
    bool has[WAAM_VALUE_LETTERS];
    double value[WAAM_VALUE_LETTERS];
    size_t column[WAAM_VALUE_LETTERS];
    size_t group_column[WAAM_GROUPS]; /* 0 = no word of this group in the line */
    char group_letter[WAAM_GROUPS];
    double group_number[WAAM_GROUPS];
} waam_words_t;

/* Completes the command from all words of the line; false = they contradict each other, or one is missing or out of range. */
bool waam_words_apply(waam_words_t *words);
/* "<letter><number><text>" as an error; always false. */
bool waam_fail_word(waam_error_t *error, waam_code_t code, size_t column, char letter, double number, const char *text);

#endif
