/* What the words of one line say together: ranges, what goes with what, what is missing. */
#include "waam_words.h"

const char waam_value_letters[WAAM_VALUE_LETTERS + 1] = "XYZIJFPWS";

#define FEED_MAX_MM_MIN 60000.0
#define DWELL_MAX_S 3600.0
#define LENGTH_MAX_MM 1e5

static bool fail(const waam_words_t *w, waam_code_t code, size_t column, const char *text)
{
    return waam_fail(w->error, code, column, text);
}

static bool in_range(waam_words_t *w, int i, double lowest, double highest, const char *unit)
{
    if (w->value[i] >= lowest && w->value[i] <= highest)
        return true;
    waam_text_t *text = &w->error->text;
    waam_fail_word(w->error, WAAM_E_NUMBER, w->column[i], waam_value_letters[i], w->value[i], " is outside ");
    waam_text_fixed(text, lowest, 3);
    waam_text_add(text, "..");
    waam_text_fixed(text, highest, 3);
    waam_text_add(text, unit);
    return false;
}

/* The first word of the line among those from `first` to `last` that is not allowed. */
static bool refuse(waam_words_t *w, int first, int last, const char *text)
{
    for (int i = first; i <= last; i++) {
        if (!w->has[i])
            continue;
        fail(w, WAAM_E_CONTRADICTION, w->column[i], "");
        waam_text_char(&w->error->text, waam_value_letters[i]);
        waam_text_add(&w->error->text, text);
        return false;
    }
    return true;
}

static bool any(const waam_words_t *w, int first, int last)
{
    for (int i = first; i <= last; i++)
        if (w->has[i])
            return true;
    return false;
}

static size_t column_of(const waam_words_t *w, int first, int last)
{
    for (int i = first; i <= last; i++)
        if (w->has[i])
            return w->column[i];
    return 1;
}

static bool apply_setpoints(waam_words_t *w)
{
    waam_modal_t *modal = &w->command->modal;
    if ((w->has[WAAM_F] && !in_range(w, WAAM_F, 0.001, FEED_MAX_MM_MIN, " mm/min")) ||
        (w->has[WAAM_W] && !in_range(w, WAAM_W, 0.0, w->limits->wire_max_mm_s * 60.0, " mm/min")) ||
        (w->has[WAAM_S] && !in_range(w, WAAM_S, 0.0, w->limits->voltage_max_v, " V")))
        return false;
    modal->feed_mm_s = w->has[WAAM_F] ? w->value[WAAM_F] / 60.0 : modal->feed_mm_s;
    modal->wire_mm_s = w->has[WAAM_W] ? w->value[WAAM_W] / 60.0 : modal->wire_mm_s;
    modal->voltage_v = w->has[WAAM_S] ? w->value[WAAM_S] : modal->voltage_v;
    return true;
}

static bool apply_lengths(waam_words_t *w)
{
    waam_command_t *command = w->command;
    for (int i = WAAM_X; i <= WAAM_J; i++)
        if (w->has[i] && !in_range(w, i, -LENGTH_MAX_MM, LENGTH_MAX_MM, " mm"))
            return false;
    for (int i = 0; i < WAAM_AXES; i++) {
        command->has[i] = w->has[WAAM_X + i];
        command->axis_mm[i] = w->value[WAAM_X + i];
        command->axis_column[i] = command->has[i] ? w->column[WAAM_X + i] : column_of(w, WAAM_X, WAAM_J);
    }
    command->centre_mm[0] = w->value[WAAM_I];
    command->centre_mm[1] = w->value[WAAM_J];
    command->arc_column = column_of(w, WAAM_I, WAAM_J);
    command->action_column = w->group_column[WAAM_GROUP_ACTION] ? w->group_column[WAAM_GROUP_ACTION] : 1;
    return true;
}

static bool check_move(waam_words_t *w)
{
    waam_command_t *command = w->command;
    waam_motion_mode_t motion = command->modal.motion;
    size_t column = w->group_column[WAAM_GROUP_MOTION];
    size_t first = column_of(w, WAAM_X, WAAM_J);
    if (motion == WAAM_MOTION_NONE)
        return fail(w, WAAM_E_MISSING_WORD, first, "a move needs G0, G1, G2 or G3 first");
    if (motion >= WAAM_MOTION_ARC_CW && !any(w, WAAM_I, WAAM_J))
        return fail(w, WAAM_E_MISSING_WORD, column ? column : first, "an arc needs its centre: I, J or both");
    if (motion < WAAM_MOTION_ARC_CW && !refuse(w, WAAM_I, WAAM_J, " goes with G2 and G3 only"))
        return false;
    if (motion != WAAM_MOTION_RAPID && command->modal.feed_mm_s <= 0.0)
        return fail(w, WAAM_E_MISSING_WORD, first, "a move needs a feed F");
    command->action = WAAM_DO_MOVE;
    return true;
}

static bool check_dwell(waam_words_t *w)
{
    if (!w->has[WAAM_P])
        return fail(w, WAAM_E_MISSING_WORD, w->command->action_column, "G4 needs P, seconds");
    w->command->dwell_s = w->value[WAAM_P];
    return in_range(w, WAAM_P, 0.0, DWELL_MAX_S, " s");
}

static bool check_arc_start(waam_words_t *w)
{
    size_t column = w->command->action_column;
    if (w->command->gas == WAAM_GAS_OFF)
        return fail(w, WAAM_E_CONTRADICTION, w->group_column[WAAM_GROUP_GAS], "M9 does not go with M3: an arc needs gas");
    if (w->command->modal.wire_mm_s <= 0.0)
        return fail(w, WAAM_E_MISSING_WORD, column, "M3 needs a wire feed speed W");
    return w->command->modal.voltage_v > 0.0 || fail(w, WAAM_E_MISSING_WORD, column, "M3 needs a voltage S");
}

static bool check_action(waam_words_t *w)
{
    if (!refuse(w, WAAM_X, WAAM_J, " does not go with this action"))
        return false;
    switch (w->command->action) {
    case WAAM_DO_DWELL: return check_dwell(w);
    case WAAM_DO_ARC_START: return check_arc_start(w);
    default: return true;
    }
}

bool waam_words_apply(waam_words_t *w)
{
    waam_command_t *command = w->command;
    if (!apply_setpoints(w) || !apply_lengths(w))
        return false;
    if (command->action != WAAM_DO_DWELL && !refuse(w, WAAM_P, WAAM_P, " goes with G4 only"))
        return false;
    if (command->action != WAAM_DO_NOTHING)
        return check_action(w);
    if (any(w, WAAM_X, WAAM_J))
        return check_move(w);
    if (command->gas != WAAM_GAS_KEEP)
        command->action = WAAM_DO_GAS; /* a group of its own, for it goes with a move */
    return true;
}
