/* Reading: words, the modal group of each G and M word. What the words say together is checked in waam_words.c. */
#include "waam_words.h"

static bool fail_letter(waam_words_t *w, waam_code_t code, size_t column, char letter, const char *text)
{
    waam_fail(w->error, code, column, "");
    waam_text_char(&w->error->text, letter);
    waam_text_add(&w->error->text, text);
    return false;
}

/* Books a word into its modal group; two words of one group contradict each other, two actions too. */
static bool group(waam_words_t *w, waam_group_t group, char letter, double number, size_t column)
{
    if (w->group_column[group]) {
        waam_fail_word(w->error, WAAM_E_CONTRADICTION, column, letter, number, " does not go with ");
        waam_text_char(&w->error->text, w->group_letter[group]);
        waam_text_fixed(&w->error->text, w->group_number[group], 3);
        waam_text_add(&w->error->text, " in the same line");
        return false;
    }
    w->group_column[group] = column;
    w->group_letter[group] = letter;
    w->group_number[group] = number;
    return true;
}

static const struct {
    char letter;
    uint8_t number;
    waam_group_t group;
    uint8_t choice; /* within the group: what the word means */
} meanings[] = {
    {'G', 0, WAAM_GROUP_MOTION, WAAM_MOTION_RAPID}, {'G', 1, WAAM_GROUP_MOTION, WAAM_MOTION_LINE},
    {'G', 2, WAAM_GROUP_MOTION, WAAM_MOTION_ARC_CW}, {'G', 3, WAAM_GROUP_MOTION, WAAM_MOTION_ARC_CCW},
    {'G', 90, WAAM_GROUP_DISTANCE, 0}, {'G', 91, WAAM_GROUP_DISTANCE, 1},
    {'G', 17, WAAM_GROUP_PLANE, 0}, {'G', 21, WAAM_GROUP_UNITS, 0}, {'G', 54, WAAM_GROUP_FRAME, 0},
    {'G', 4, WAAM_GROUP_ACTION, WAAM_DO_DWELL}, {'G', 28, WAAM_GROUP_ACTION, WAAM_DO_HOME},
    {'M', 3, WAAM_GROUP_ACTION, WAAM_DO_ARC_START}, {'M', 5, WAAM_GROUP_ACTION, WAAM_DO_ARC_END},
    {'M', 30, WAAM_GROUP_ACTION, WAAM_DO_FINISH},
    {'M', 7, WAAM_GROUP_GAS, WAAM_GAS_ON}, {'M', 9, WAAM_GROUP_GAS, WAAM_GAS_OFF},
};

static void choose(waam_words_t *w, waam_group_t group, uint8_t choice)
{
    waam_modal_t *modal = &w->command->modal;
    switch (group) {
    case WAAM_GROUP_MOTION: modal->motion = (waam_motion_mode_t)choice; break;
    case WAAM_GROUP_DISTANCE: modal->relative = choice; break;
    case WAAM_GROUP_GAS: w->command->gas = (waam_gas_t)choice; break;
    case WAAM_GROUP_ACTION: w->command->action = (waam_action_t)choice; break;
    default: break; /* always so here */
    }
}

static bool coded_word(waam_words_t *w, char letter, double number, size_t column)
{
    for (size_t i = 0; i < sizeof meanings / sizeof meanings[0]; i++) {
        double off = number - meanings[i].number;
        if (letter != meanings[i].letter || off > 1e-6 || off < -1e-6)
            continue;
        if (!group(w, meanings[i].group, letter, number, column))
            return false;
        choose(w, meanings[i].group, meanings[i].choice);
        return true;
    }
    return waam_fail_word(w->error, WAAM_E_UNKNOWN_WORD, column, letter, number, " is not known");
}

static bool value_word(waam_words_t *w, char letter, double number, size_t column)
{
    int i = 0;
    while (i < WAAM_VALUE_LETTERS && waam_value_letters[i] != letter)
        i++;
    if (i == WAAM_VALUE_LETTERS)
        return fail_letter(w, WAAM_E_UNKNOWN_WORD, column, letter, " is not a word of this controller");
    if (w->has[i])
        return fail_letter(w, WAAM_E_CONTRADICTION, column, letter, " is given twice");
    w->has[i] = true;
    w->value[i] = number;
    w->column[i] = column;
    return true;
}

static bool known_letter(char letter)
{
    bool known = letter == 'G' || letter == 'M';
    for (int i = 0; i < WAAM_VALUE_LETTERS; i++)
        known = known || waam_value_letters[i] == letter;
    return known;
}

static bool fail_number(waam_words_t *w, size_t column, char letter)
{
    if (!known_letter(letter))
        return fail_letter(w, WAAM_E_UNKNOWN_WORD, column, letter, " is not a word of this controller");
    return fail_letter(w, WAAM_E_NUMBER, column, letter,
                       waam_digits_follow(&w->cursor) ? " is too large: numbers are below 1000000000" : " needs a number");
}

static bool word(waam_words_t *w)
{
    size_t column = w->cursor.at + 1;
    char letter = w->cursor.text[w->cursor.at++];
    if (letter >= 'a' && letter <= 'z')
        letter = (char)(letter - 'a' + 'A');
    if (letter < 'A' || letter > 'Z')
        return waam_fail(w->error, WAAM_E_SYNTAX, column, "a letter was expected here");
    bool coded = letter == 'G' || letter == 'M';
    double number;
    if (!waam_read_number(&w->cursor, &number))
        return fail_number(w, column, letter);
    return coded ? coded_word(w, letter, number, column) : value_word(w, letter, number, column);
}

/* A ';' ends the line. */
static bool read_words(waam_words_t *w)
{
    while (!waam_at_end(&w->cursor) && w->cursor.text[w->cursor.at] != ';')
        if (!word(w))
            return false;
    return true;
}

bool waam_gcode_parse(const char *line, size_t length, size_t start, const waam_modal_t *before,
                      const waam_gcode_limits_t *limits, waam_command_t *command, waam_error_t *error)
{
    *command = (waam_command_t){.modal = *before};
    waam_words_t words = {.cursor = {line, length, start}, .command = command, .error = error, .limits = limits};
    return read_words(&words) && waam_words_apply(&words);
}
