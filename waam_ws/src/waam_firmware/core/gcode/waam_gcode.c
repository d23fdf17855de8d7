/* Reading: comments, words, the modal group of each G and M word. What the words say together is checked in waam_words.c. */
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

typedef struct {
    uint16_t tenths; /* 10 times the number, so that G91.1 is 911 */
    waam_group_t group;
    uint8_t choice;  /* within the group: what the word means */
} meaning_t;

static const meaning_t g_words[] = {
    {0, WAAM_GROUP_MOTION, WAAM_MOTION_RAPID}, {10, WAAM_GROUP_MOTION, WAAM_MOTION_LINE},
    {20, WAAM_GROUP_MOTION, WAAM_MOTION_ARC_CW}, {30, WAAM_GROUP_MOTION, WAAM_MOTION_ARC_CCW},
    {170, WAAM_GROUP_PLANE, WAAM_PLANE_XY}, {180, WAAM_GROUP_PLANE, WAAM_PLANE_ZX},
    {190, WAAM_GROUP_PLANE, WAAM_PLANE_YZ}, {200, WAAM_GROUP_UNITS, 1}, {210, WAAM_GROUP_UNITS, 0},
    {530, WAAM_GROUP_MACHINE, 0}, {540, WAAM_GROUP_FRAME, 0}, {550, WAAM_GROUP_FRAME, 1}, {560, WAAM_GROUP_FRAME, 2},
    {570, WAAM_GROUP_FRAME, 3}, {580, WAAM_GROUP_FRAME, 4}, {590, WAAM_GROUP_FRAME, 5},
    {900, WAAM_GROUP_DISTANCE, 0}, {910, WAAM_GROUP_DISTANCE, 1}, {901, WAAM_GROUP_CENTRE, 1},
    {911, WAAM_GROUP_CENTRE, 0}, {930, WAAM_GROUP_FEED, 1}, {940, WAAM_GROUP_FEED, 0},
    {40, WAAM_GROUP_ACTION, WAAM_DO_DWELL}, {100, WAAM_GROUP_ACTION, WAAM_DO_SET_FRAME},
    {280, WAAM_GROUP_ACTION, WAAM_DO_HOME}, {920, WAAM_GROUP_ACTION, WAAM_DO_SET_POSITION},
    {921, WAAM_GROUP_ACTION, WAAM_DO_CLEAR_POSITION},
    {800, WAAM_GROUP_MOTION, WAAM_MOTION_NONE},
    /* what this machine always does: no compensation, exact path (a blend within P of G64 is the path itself) */
    {400, WAAM_GROUP_CUTTER, 0}, {490, WAAM_GROUP_LENGTH, 0}, {610, WAAM_GROUP_PATH, 0}, {640, WAAM_GROUP_PATH, 1},
};

static const meaning_t m_words[] = {
    {0, WAAM_GROUP_ACTION, WAAM_DO_PAUSE}, {20, WAAM_GROUP_ACTION, WAAM_DO_FINISH},
    {300, WAAM_GROUP_ACTION, WAAM_DO_FINISH}, {30, WAAM_GROUP_ACTION, WAAM_DO_ARC_START},
    {50, WAAM_GROUP_ACTION, WAAM_DO_ARC_END}, {70, WAAM_GROUP_GAS, WAAM_GAS_ON},
    {80, WAAM_GROUP_GAS, WAAM_GAS_ON}, {90, WAAM_GROUP_GAS, WAAM_GAS_OFF},
    {820, WAAM_GROUP_WIRE, WAAM_WIRE_E_ABSOLUTE}, {830, WAAM_GROUP_WIRE, WAAM_WIRE_E_RELATIVE},
};

static void choose(waam_words_t *w, const meaning_t *m)
{
    waam_modal_t *modal = &w->command->modal;
    switch (m->group) {
    case WAAM_GROUP_MOTION: modal->motion = (waam_motion_mode_t)m->choice; break;
    case WAAM_GROUP_PLANE: modal->plane = (waam_plane_t)m->choice; break;
    case WAAM_GROUP_DISTANCE: modal->relative = m->choice; break;
    case WAAM_GROUP_CENTRE: modal->arc_absolute = m->choice; break;
    case WAAM_GROUP_FEED: modal->inverse_time = m->choice; break;
    case WAAM_GROUP_UNITS: modal->inch = m->choice; break;
    case WAAM_GROUP_FRAME: modal->frame = m->choice; break;
    case WAAM_GROUP_WIRE: modal->wire_mode = (waam_wire_mode_t)m->choice; break;
    case WAAM_GROUP_MACHINE: w->command->machine_frame = true; break;
    case WAAM_GROUP_GAS: w->command->gas = (waam_gas_t)m->choice; break;
    case WAAM_GROUP_PATH: w->tolerance = m->choice; break;
    case WAAM_GROUP_CUTTER:
    case WAAM_GROUP_LENGTH: break;
    default: w->command->action = (waam_action_t)m->choice; break;
    }
}

static bool coded_word(waam_words_t *w, char letter, double number, size_t column)
{
    const meaning_t *words = letter == 'G' ? g_words : m_words;
    size_t count = letter == 'G' ? sizeof g_words / sizeof g_words[0] : sizeof m_words / sizeof m_words[0];
    for (size_t i = 0; i < count; i++) {
        double off = number * 10.0 - words[i].tenths;
        if (off > 1e-6 || off < -1e-6)
            continue;
        if (!group(w, words[i].group, letter, number, column))
            return false;
        choose(w, &words[i]);
        return true;
    }
    return waam_fail_word(w->error, WAAM_E_UNKNOWN_WORD, column, letter, number, " is not known");
}

static bool first_word(const waam_words_t *w)
{
    for (int i = 0; i < WAAM_VALUE_LETTERS; i++)
        if (w->has[i])
            return false;
    for (int i = 0; i < WAAM_GROUPS; i++)
        if (w->group_column[i])
            return false;
    return true;
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
    if (i == WAAM_N && (!first_word(w) || number < 0))
        return waam_fail(w->error, WAAM_E_SYNTAX, column, "N, the number of a line, comes first and is not negative");
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

/* "X1e-05": RS274 knows no exponents, and E is a word here. A small 'e' behind a word in capitals is none. */
static bool exponent_follows(const waam_words_t *w, char written)
{
    waam_cursor_t after = w->cursor;
    if (written > 'Z' || after.at >= after.length || after.text[after.at] != 'e')
        return false;
    after.at++;
    return waam_digits_follow(&after);
}

static bool word(waam_words_t *w)
{
    size_t column = w->cursor.at + 1;
    char letter = w->cursor.text[w->cursor.at++], written = letter;
    if (letter >= 'a' && letter <= 'z')
        letter = (char)(letter - 'a' + 'A');
    if (letter < 'A' || letter > 'Z')
        return waam_fail(w->error, WAAM_E_SYNTAX, column, "a letter was expected here");
    bool coded = letter == 'G' || letter == 'M';
    double number;
    if (!waam_read_number(&w->cursor, &number))
        return fail_number(w, column, letter);
    if (exponent_follows(w, written))
        return fail_letter(w, WAAM_E_NUMBER, column, letter, ": an exponent is not read, write the number out");
    return coded ? coded_word(w, letter, number, column) : value_word(w, letter, number, column);
}

/* Skips "( )"; a ';' ends the line. */
static bool comment(waam_words_t *w)
{
    waam_cursor_t *c = &w->cursor;
    if (c->text[c->at] == ';') {
        c->at = c->length;
        return true;
    }
    size_t open = c->at;
    while (c->at < c->length && c->text[c->at] != ')')
        c->at++;
    if (c->at == c->length)
        return waam_fail(w->error, WAAM_E_SYNTAX, open + 1, "comment is not closed");
    c->at++;
    return true;
}

/* '%' alone marks the begin and end of a tape. */
static bool tape_mark(waam_words_t *w)
{
    size_t column = ++w->cursor.at;
    return waam_at_end(&w->cursor) ||
           waam_fail(w->error, WAAM_E_SYNTAX, column, "% marks begin or end of a program and stands alone");
}

static bool read_words(waam_words_t *w)
{
    bool starts = !waam_at_end(&w->cursor);
    if (starts && w->cursor.text[w->cursor.at] == '%')
        return tape_mark(w);
    if (starts && w->cursor.text[w->cursor.at] == '/')
        w->cursor.at++;
    while (!waam_at_end(&w->cursor)) {
        char c = w->cursor.text[w->cursor.at];
        if (!(c == '(' || c == ';' ? comment(w) : word(w)))
            return false;
    }
    return true;
}

bool waam_gcode_parse(const char *line, size_t length, size_t start, const waam_modal_t *before,
                      const waam_gcode_limits_t *limits, waam_command_t *command, waam_error_t *error)
{
    *command = (waam_command_t){.modal = *before};
    waam_words_t words = {.cursor = {line, length, start}, .command = command, .error = error, .before = before,
                          .limits = limits};
    return read_words(&words) && waam_words_apply(&words);
}
