/* What the words of one line say together: ranges, units, what goes with what, what is missing. */
#include "waam_words.h"

const char waam_value_letters[WAAM_VALUE_LETTERS + 1] = "XYZIJKREFPLWSQN";

#define INCH_MM 25.4
#define FEED_MAX_MM_MIN 60000.0
#define MOVES_MAX_PER_MIN 1e6
#define DWELL_MAX_S 3600.0
#define LENGTH_MAX_MM 1e5

static bool fail(const waam_words_t *w, waam_code_t code, size_t column, const char *text)
{
    return waam_fail(w->error, code, column, text);
}

static bool in_range(waam_words_t *w, int i, double value, double lowest, double highest, const char *unit)
{
    if (value >= lowest && value <= highest)
        return true;
    waam_text_t *text = &w->error->text;
    waam_fail_word(w->error, WAAM_E_NUMBER, w->column[i], waam_value_letters[i], value, " is outside ");
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

static double unit_of(const waam_words_t *w) { return w->command->modal.inch ? INCH_MM : 1.0; }

static bool apply_feed(waam_words_t *w)
{
    waam_modal_t *modal = &w->command->modal;
    double value = w->value[WAAM_F];
    if (modal->inverse_time != w->before->inverse_time)
        modal->feed_mm_s = 0.0; /* the number meant something else */
    if (!w->has[WAAM_F])
        return true;
    if (modal->inverse_time) {
        w->command->per_s = value / 60.0;
        return in_range(w, WAAM_F, value, 0.001, MOVES_MAX_PER_MIN, " moves/min");
    }
    modal->feed_mm_s = value * unit_of(w) / 60.0;
    return in_range(w, WAAM_F, value * unit_of(w), 0.001, FEED_MAX_MM_MIN, " mm/min");
}

/* W is a velocity of its own; a W above 0 takes the wire back from E, for one of them at a time moves it. */
static bool apply_wire(waam_words_t *w)
{
    waam_modal_t *modal = &w->command->modal;
    double value = w->value[WAAM_W] * unit_of(w);
    if (w->has[WAAM_W]) {
        if (!in_range(w, WAAM_W, value, 0.0, w->limits->wire_max_mm_s * 60.0, " mm/min"))
            return false;
        modal->wire_mm_s = value / 60.0;
    }
    bool chosen = w->group_column[WAAM_GROUP_WIRE] != 0;
    if (chosen && modal->wire_mm_s > 0.0)
        return fail(w, WAAM_E_CONTRADICTION, w->group_column[WAAM_GROUP_WIRE],
                    "M82 and M83 couple the wire to the path: send W0 first");
    if (modal->wire_mm_s > 0.0)
        modal->wire_mode = WAAM_WIRE_VELOCITY;
    if (w->has[WAAM_E] && modal->wire_mm_s > 0.0)
        return fail(w, WAAM_E_CONTRADICTION, w->column[WAAM_E], "E does not go with a wire speed W above 0");
    return true;
}

static bool apply_lengths(waam_words_t *w)
{
    waam_command_t *command = w->command;
    double unit = unit_of(w);
    for (int i = WAAM_X; i <= WAAM_E; i++)
        if (w->has[i] && !in_range(w, i, w->value[i] * unit, -LENGTH_MAX_MM, LENGTH_MAX_MM, " mm"))
            return false;
    for (int i = 0; i < WAAM_AXES; i++) {
        command->has[i] = w->has[WAAM_X + i];
        command->axis_mm[i] = w->value[WAAM_X + i] * unit;
        command->axis_column[i] = command->has[i] ? w->column[WAAM_X + i] : column_of(w, WAAM_X, WAAM_R);
        command->offset_mm[i] = w->value[WAAM_I + i] * unit;
    }
    command->has_radius = w->has[WAAM_R];
    command->radius_mm = w->value[WAAM_R] * unit;
    command->arc_column = any(w, WAAM_I, WAAM_R) ? column_of(w, WAAM_I, WAAM_R) : 1;
    command->action_column = w->group_column[WAAM_GROUP_ACTION] ? w->group_column[WAAM_GROUP_ACTION] : 1;
    return true;
}

static bool apply_voltage(waam_words_t *w)
{
    if (!w->has[WAAM_S])
        return true;
    w->command->modal.voltage_v = w->value[WAAM_S];
    return in_range(w, WAAM_S, w->value[WAAM_S], 0.0, w->limits->voltage_max_v, " V");
}

/* ---- moves ---- */

static bool check_arc_words(waam_words_t *w)
{
    const uint8_t *axes = waam_plane_axes[w->command->modal.plane];
    size_t motion = w->group_column[WAAM_GROUP_MOTION], column = motion ? motion : column_of(w, WAAM_X, WAAM_R);
    bool first = w->has[WAAM_I + axes[0]], second = w->has[WAAM_I + axes[1]], radius = w->has[WAAM_R];
    int across = WAAM_I + axes[2];
    if (w->command->machine_frame)
        return fail(w, WAAM_E_CONTRADICTION, w->group_column[WAAM_GROUP_MACHINE], "G53 goes with G0 and G1 only");
    if (!refuse(w, across, across, " is not in the plane of the arc (G17 G18 G19)"))
        return false;
    if (radius)
        return refuse(w, WAAM_I, WAAM_K, " contradicts R");
    if (!first && !second)
        return fail(w, WAAM_E_MISSING_WORD, column, "an arc needs R, or its centre: two of I J K");
    if (w->command->modal.arc_absolute && !(first && second))
        return fail(w, WAAM_E_MISSING_WORD, column, "G90.1 needs both coordinates of the centre");
    return true;
}

static bool check_radius_end(waam_words_t *w)
{
    const uint8_t *axes = waam_plane_axes[w->command->modal.plane];
    if (!w->has[WAAM_R] || w->has[WAAM_X + axes[0]] || w->has[WAAM_X + axes[1]])
        return true;
    return fail(w, WAAM_E_MISSING_WORD, w->column[WAAM_R], "R needs an end in the plane of the arc");
}

static bool check_move_feed(waam_words_t *w)
{
    const waam_modal_t *modal = &w->command->modal;
    if (modal->motion == WAAM_MOTION_RAPID)
        return true;
    if (modal->inverse_time ? w->has[WAAM_F] : modal->feed_mm_s > 0.0)
        return true;
    return fail(w, WAAM_E_MISSING_WORD, column_of(w, WAAM_X, WAAM_E),
                modal->inverse_time ? "with G93 every move needs its F" : "a move needs a feed F");
}

static bool check_wire_word(waam_words_t *w)
{
    waam_command_t *command = w->command;
    waam_modal_t *modal = &command->modal;
    if (!w->has[WAAM_E])
        return true;
    if (modal->wire_mode == WAAM_WIRE_VELOCITY)
        return fail(w, WAAM_E_MISSING_WORD, w->column[WAAM_E], "E needs M82 (absolute) or M83 (relative) first");
    if (modal->motion == WAAM_MOTION_RAPID)
        return fail(w, WAAM_E_CONTRADICTION, w->column[WAAM_E], "E does not go with G0");
    double end = w->value[WAAM_E] * unit_of(w);
    if (modal->wire_mode == WAAM_WIRE_E_RELATIVE)
        end += modal->wire_end_mm;
    command->has_wire = true;
    command->wire_column = w->column[WAAM_E];
    command->wire_mm = end - modal->wire_end_mm;
    modal->wire_end_mm = end;
    return true;
}

static bool check_move(waam_words_t *w)
{
    waam_command_t *command = w->command;
    waam_motion_mode_t motion = command->modal.motion;
    bool geometry = any(w, WAAM_X, WAAM_R);
    size_t first = column_of(w, WAAM_X, WAAM_E);
    if (motion == WAAM_MOTION_NONE)
        return fail(w, WAAM_E_MISSING_WORD, first, "a move needs G0, G1, G2 or G3 first");
    if (motion >= WAAM_MOTION_ARC_CW ? geometry && !(check_arc_words(w) && check_radius_end(w))
                                     : !refuse(w, WAAM_I, WAAM_R, " goes with G2 and G3 only"))
        return false;
    if (command->machine_frame && command->modal.relative)
        return fail(w, WAAM_E_CONTRADICTION, w->group_column[WAAM_GROUP_MACHINE], "G53 needs G90");
    command->action = WAAM_DO_MOVE;
    command->travels = geometry;
    return check_move_feed(w) && check_wire_word(w);
}

/* ---- actions ---- */

/* The value of a word is wrong, or the word is not there. */
static bool fail_value(const waam_words_t *w, int i, const char *text)
{
    return w->has[i] ? fail(w, WAAM_E_NUMBER, w->column[i], text)
                     : fail(w, WAAM_E_MISSING_WORD, w->command->action_column, text);
}

static bool check_set_frame(waam_words_t *w)
{
    waam_command_t *command = w->command;
    double p = w->value[WAAM_P], l = w->value[WAAM_L];
    if (l != 2.0 && l != 20.0)
        return fail_value(w, WAAM_L, "G10 needs L2 (zero of a frame) or L20 (reading of a frame)");
    if (!w->has[WAAM_P] || p != (int)p || p < 0.0 || p > WAAM_FRAMES)
        return fail_value(w, WAAM_P, "G10 needs P1..P6 for G54..G59, or P0 for the one in force");
    if (!any(w, WAAM_X, WAAM_Z))
        return fail(w, WAAM_E_MISSING_WORD, command->action_column, "G10 needs X, Y or Z");
    command->frame = p == 0.0 ? command->modal.frame : (uint8_t)(p - 1.0);
    command->from_here = l == 20.0;
    return refuse(w, WAAM_I, WAAM_E, " does not go with G10");
}

static bool check_set_position(waam_words_t *w)
{
    waam_command_t *command = w->command;
    if (!any(w, WAAM_X, WAAM_Z) && !w->has[WAAM_E])
        return fail(w, WAAM_E_MISSING_WORD, command->action_column, "G92 needs X, Y, Z or E");
    if (w->has[WAAM_E])
        command->modal.wire_end_mm = w->value[WAAM_E] * unit_of(w);
    return refuse(w, WAAM_I, WAAM_R, " does not go with G92");
}

static bool check_dwell(waam_words_t *w)
{
    if (!w->has[WAAM_P])
        return fail(w, WAAM_E_MISSING_WORD, w->command->action_column, "G4 needs P, seconds");
    w->command->dwell_s = w->value[WAAM_P];
    return in_range(w, WAAM_P, w->value[WAAM_P], 0.0, DWELL_MAX_S, " s");
}

static bool check_arc_start(waam_words_t *w)
{
    const waam_modal_t *modal = &w->command->modal;
    if (modal->wire_mm_s <= 0.0 && modal->wire_mode == WAAM_WIRE_VELOCITY)
        return fail(w, WAAM_E_MISSING_WORD, w->command->action_column,
                    "M3 needs a wire feed speed W, or the wire coupled to the path (M82, M83)");
    return modal->voltage_v > 0.0 || fail(w, WAAM_E_MISSING_WORD, w->command->action_column, "M3 needs a voltage S");
}

static bool check_action(waam_words_t *w)
{
    static const char text[] = " does not go with this action";
    size_t motion = w->group_column[WAAM_GROUP_MOTION];
    switch (w->command->action) {
    case WAAM_DO_SET_FRAME:
    case WAAM_DO_SET_POSITION:
        if (motion && w->command->modal.motion != WAAM_MOTION_NONE)
            return fail(w, WAAM_E_CONTRADICTION, motion, "two words of this line want the coordinates");
        return w->command->action == WAAM_DO_SET_FRAME ? check_set_frame(w) : check_set_position(w);
    case WAAM_DO_DWELL: return refuse(w, WAAM_X, WAAM_E, text) && check_dwell(w);
    case WAAM_DO_ARC_START: return refuse(w, WAAM_X, WAAM_E, text) && check_arc_start(w);
    default: return refuse(w, WAAM_X, WAAM_E, text);
    }
}

/* P and Q of G64: how far a controller may leave the path, in units of the program. This one never does. */
static bool check_tolerance(waam_words_t *w)
{
    waam_action_t action = w->command->action;
    if (!w->tolerance)
        return refuse(w, WAAM_Q, WAAM_Q, " goes with G64 only");
    if (w->has[WAAM_P] && (action == WAAM_DO_DWELL || action == WAAM_DO_SET_FRAME))
        return fail(w, WAAM_E_CONTRADICTION, w->group_column[WAAM_GROUP_PATH], "two words of this line want P");
    for (int i = WAAM_P; i <= WAAM_Q; i += WAAM_Q - WAAM_P)
        if (w->has[i] && !in_range(w, i, w->value[i] * unit_of(w), 0.0, LENGTH_MAX_MM, " mm"))
            return false;
    return true;
}

static bool check_parameters(waam_words_t *w)
{
    waam_action_t action = w->command->action;
    bool set_frame = action == WAAM_DO_SET_FRAME;
    if (action != WAAM_DO_DWELL && !set_frame && !w->tolerance &&
        !refuse(w, WAAM_P, WAAM_P, " goes with G4, G10 and G64 only"))
        return false;
    return (set_frame || refuse(w, WAAM_L, WAAM_L, " goes with G10 only")) && check_tolerance(w);
}

/* The gas is a group of its own, for it goes with a move. */
static bool apply_gas(waam_words_t *w, bool moves)
{
    waam_command_t *command = w->command;
    if (command->gas == WAAM_GAS_OFF && command->action == WAAM_DO_ARC_START)
        return fail(w, WAAM_E_CONTRADICTION, w->group_column[WAAM_GROUP_GAS], "M9 does not go with M3: an arc needs gas");
    if (command->gas != WAAM_GAS_KEEP && command->action == WAAM_DO_NOTHING && !moves)
        command->action = WAAM_DO_GAS;
    return true;
}

/* M2 and M30 leave the machine in a known mode, as RS274 has it. */
static void restore(waam_modal_t *modal)
{
    modal->motion = WAAM_MOTION_LINE;
    modal->plane = WAAM_PLANE_XY;
    modal->relative = modal->inverse_time = false;
    modal->frame = 0;
}

bool waam_words_apply(waam_words_t *w)
{
    waam_action_t action = w->command->action;
    if (!apply_feed(w) || !apply_wire(w) || !apply_voltage(w) || !apply_lengths(w))
        return false;
    bool acts = action != WAAM_DO_NOTHING, moves = !acts && any(w, WAAM_X, WAAM_E);
    if (!check_parameters(w) || !apply_gas(w, moves))
        return false;
    if (w->command->machine_frame && !moves)
        return fail(w, WAAM_E_CONTRADICTION, w->group_column[WAAM_GROUP_MACHINE], "G53 goes with a move only");
    if (acts ? !check_action(w) : moves && !check_move(w))
        return false;
    if (action == WAAM_DO_FINISH)
        restore(&w->command->modal);
    return true;
}
