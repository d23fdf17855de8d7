/* What GRBL senders may do. They can move the machine, but nothing that they say can strike an arc: they hold no lease. */
#include <math.h>

#include "waam_accel.h"
#include "waam_grbl_dialect.h"
#include "waam_internal.h"
#include "waam_scale.h"

#define PERCENT 0.01

/* ---- answers ---- */

static void say_number(waam_core_t *core, const char *words, unsigned number)
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, words);
    waam_text_uint(&text, number);
    waam_grbl_say(core, &text);
}

static void answer(waam_core_t *core, unsigned error)
{
    if (error)
        say_number(core, "error:", error);
    else
        waam_grbl_tell(core, "ok");
}

/* In words before the number that GRBL has for it. */
static void refuse(waam_core_t *core, const waam_error_t *error)
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, "[MSG:E");
    waam_text_uint(&text, error->code);
    waam_text_add(&text, " column ");
    waam_text_uint(&text, error->column);
    waam_text_add(&text, ": ");
    waam_text_bytes(&text, error->text.text, error->text.length);
    waam_text_char(&text, ']');
    waam_grbl_say(core, &text);
    answer(core, waam_grbl_error(error->code));
}

static void refuse_because(waam_core_t *core, waam_code_t code, const char *why)
{
    waam_error_t error;
    waam_fail(&error, code, 1, why);
    refuse(core, &error);
}

static void greet(waam_core_t *core)
{
    waam_grbl_tell(core, "Grbl 1.1h ['$' for help]");
    if (waam_grbl_locked(core))
        waam_grbl_tell(core, "[MSG:'$H'|'$X' to unlock]");
}

/* ---- real-time bytes ---- */

static bool enter(waam_core_t *core)
{
    bool entered = core->link.dialect == WAAM_DIALECT_GRBL;
    if (!waam_core_hand_over(core, WAAM_DIALECT_GRBL))
        return false;
    if (!entered)
        greet(core);
    return true;
}

/* What was under way when it moved must not move it again: it is locked until $X. */
static void soft_reset(waam_core_t *core)
{
    bool moves = core->state == WAAM_RUN || core->planner.count > 0 || core->stopping;
    core->link.length = 0;
    core->link.overlong = false;
    if (core->state == WAAM_ALARM) {
        waam_link_block(&core->link, true);
    } else {
        waam_core_stop(core);
        if (moves)
            say_number(core, "ALARM:", waam_grbl_alarm(WAAM_OK));
        else
            waam_link_resync(&core->link, core->link.accepted + 1);
        waam_core_new_program(core);
        waam_planner_set_override(&core->planner, 1.0);
    }
    greet(core);
}

static void cancel_jog(waam_core_t *core)
{
    if (waam_core_jogging(core))
        waam_core_halt(core);
}

static void hold(waam_core_t *core)
{
    if (waam_core_jogging(core))
        waam_core_halt(core);
    else if (!waam_grbl_locked(core))
        waam_core_hold(core, WAAM_E_HOLD, "hold by host", false);
}

static void override(waam_core_t *core, uint8_t byte)
{
    double percent = core->planner.override / PERCENT;
    switch (byte) {
    case WAAM_GRBL_FEED_100: percent = 100.0; break;
    case WAAM_GRBL_FEED_UP_10: percent += 10.0; break;
    case WAAM_GRBL_FEED_DOWN_10: percent -= 10.0; break;
    case WAAM_GRBL_FEED_UP_1: percent += 1.0; break;
    case WAAM_GRBL_FEED_DOWN_1: percent -= 1.0; break;
    default: return;
    }
    waam_planner_set_override(&core->planner, fmin(fmax(round(percent), 10.0), 200.0) * PERCENT);
    core->replanned = true;
}

/* A connection that nobody has spoken on is opened by a reset, or by asking for the status before anything else. */
static bool says_hello(const waam_core_t *core, uint8_t byte)
{
    return core->link.dialect == WAAM_DIALECT_OPEN &&
           (byte == WAAM_GRBL_RESET || (byte == WAAM_GRBL_STATUS && core->link.length == 0 && core->burst == 0));
}

static bool act(waam_core_t *core, uint8_t byte)
{
    switch (byte) {
    case WAAM_GRBL_STATUS: core->status_asked = true; return true;
    case WAAM_GRBL_HOLD:
    case WAAM_GRBL_DOOR: hold(core); return true;
    case WAAM_GRBL_RESUME: waam_core_resume(core); return true;
    case WAAM_GRBL_RESET: soft_reset(core); return true;
    case WAAM_GRBL_JOG_CANCEL: cancel_jog(core); return true;
    default: break;
    }
    if (byte < WAAM_GRBL_FEED_100 || byte > WAAM_GRBL_OVERRIDE_LAST)
        return false;
    override(core, byte);
    return true;
}

bool waam_grbl_real_time(waam_core_t *core, uint8_t byte)
{
    if (says_hello(core, byte)) {
        if (!enter(core))
            return false;
        core->link.length = 0;
        core->status_asked = byte == WAAM_GRBL_STATUS;
        return true;
    }
    return core->link.dialect == WAAM_DIALECT_GRBL && act(core, byte);
}

void waam_grbl_overrun(waam_core_t *core)
{
    waam_core_stop(core);
    say_number(core, "ALARM:", waam_grbl_alarm(WAAM_OK));
    waam_grbl_tell(core, "[MSG:more bytes were under way than $I says there is room for]");
}

/* ---- unlocking and homing ---- */

/* Leaves ALARM, or the lock of a reset. False: it was refused and told. */
static bool unlock(waam_core_t *core)
{
    const char *why = "";
    waam_code_t code = core->state == WAAM_ALARM ? waam_core_reset(core, &why) : WAAM_OK;
    if (!code && core->stopping) {
        code = WAAM_E_NOT_NOW;
        why = "not before it stands";
    }
    if (code) {
        refuse_because(core, code, why);
        return false;
    }
    if (core->link.blocked) {
        waam_core_new_program(core);
        waam_link_resync(&core->link, core->link.accepted + 1);
    }
    return true;
}

static void unlock_only(waam_core_t *core)
{
    bool locked = waam_grbl_locked(core);
    if (!unlock(core))
        return;
    if (locked)
        waam_grbl_tell(core, "[MSG:Caution: Unlocked]");
    answer(core, 0);
}

/* Answered by waam_grbl_homed. */
static void home(waam_core_t *core)
{
    waam_command_t command = {.action = WAAM_DO_HOME, .action_column = 1};
    waam_error_t error;
    if (waam_grbl_locked(core) && !unlock(core))
        return;
    command.modal = core->modal;
    if (core->state != WAAM_IDLE || core->planner.count > 0) {
        refuse_because(core, WAAM_E_NOT_NOW, "only in IDLE");
    } else if (waam_core_plan(core, &command, 0, &error)) {
        core->homing_asked = true;
    } else {
        refuse(core, &error);
    }
}

void waam_grbl_homed(waam_core_t *core)
{
    if (!core->homing_asked || core->planner.count > 0 || core->state != WAAM_IDLE)
        return;
    core->homing_asked = false;
    answer(core, 0);
}

/* ---- jogs ---- */

/* As of a line of a program, but it changes none of its modes. False: something else than a straight travel. */
static bool is_jog(const waam_core_t *core, const waam_command_t *c)
{
    const waam_modal_t *modal = &c->modal;
    return c->action == WAAM_DO_MOVE && c->travels && !c->has_wire && c->gas == WAAM_GAS_KEEP &&
           modal->motion == WAAM_MOTION_LINE && !modal->inverse_time && modal->frame == core->modal.frame;
}

static void jog(waam_core_t *core, const char *line, size_t length, size_t start)
{
    waam_gcode_limits_t limits = {core->config.wire_max_mm_s, core->config.voltage_max_v};
    waam_modal_t before = core->modal;
    waam_command_t command;
    waam_error_t error;
    double delta_mm[WAAM_AXES] = {0.0};
    if (waam_grbl_locked(core)) {
        refuse_because(core, WAAM_E_NOT_NOW, "locked: $X or $H first");
        return;
    }
    if (waam_grbl_arc_word(line, length)) {
        answer(core, 16);
        return;
    }
    before.motion = WAAM_MOTION_LINE;
    before.feed_mm_s = 0.0;
    before.inverse_time = false;
    if (!waam_gcode_parse(line, length, start, &before, &limits, &command, &error)) {
        refuse(core, &error);
        return;
    }
    if (!is_jog(core, &command)) {
        answer(core, 16);
        return;
    }
    if (!command.modal.relative && !core->plan_homed) {
        refuse_because(core, WAAM_E_NOT_HOMED, "not homed: jog with G91, or home by $H");
        return;
    }
    for (int i = 0; i < WAAM_AXES; i++) {
        double base = command.machine_frame ? 0.0 : waam_core_zero_mm(core, &core->modal, i);
        if (command.has[i])
            delta_mm[i] = command.axis_mm[i] + (command.modal.relative ? 0.0 : base - core->plan_mm[i]);
    }
    if (waam_core_jog(core, delta_mm, command.modal.feed_mm_s, &error))
        answer(core, 0);
    else
        refuse(core, &error);
}

/* ---- lines ---- */

static void write_scale(waam_core_t *core, int axis, double wanted)
{
    bool homed = core->homed;
    waam_error_t error;
    if (!waam_core_scale_axis(core, axis, wanted, &error)) {
        refuse(core, &error);
        return;
    }
    if (homed && !core->homed)
        waam_grbl_tell(core, "[MSG:homing is lost: $H]");
    answer(core, 0);
}

static void write_accel(waam_core_t *core, int axis, double wanted)
{
    waam_error_t error;
    if (waam_core_accelerate(core, axis, wanted, &error))
        answer(core, 0);
    else
        refuse(core, &error);
}

/* "$<n>=<value>": steps per mm, accelerations of X and Y; of the others a value that is there may be written again. */
static void write_setting(waam_core_t *core, const char *line, size_t length)
{
    waam_cursor_t cursor = {line, length, 1};
    uint64_t number;
    double wanted, value;
    bool known = waam_read_uint(&cursor, &number) && number < 1000 && cursor.at < length && line[cursor.at++] == '=' &&
                 waam_read_number(&cursor, &wanted) && waam_at_end(&cursor) &&
                 waam_grbl_setting(core, (unsigned)number, &value);
    if (known && number >= 100 && number < 100 + WAAM_AXES) {
        write_scale(core, (int)number - 100, wanted);
        return;
    }
    if (known && number >= 120 && number < 120 + WAAM_SHAPED_AXES) {
        write_accel(core, (int)number - 120, wanted);
        return;
    }
    if (known && fabs(wanted - value) < 5e-4) {
        answer(core, 0);
        return;
    }
    if (known)
        waam_grbl_tell(core, "[MSG:of the settings of this controller only $100 to $102, $120 and $121 can be changed]");
    answer(core, 3);
}

static void system_line(waam_core_t *core, const char *line, size_t length)
{
    char what = length > 1 ? line[1] : '\0';
    if (what >= 'a' && what <= 'z')
        what = (char)(what - 'a' + 'A');
    if (what == 'J' && length > 2 && line[2] == '=')
        jog(core, line, length, 3);
    else if (what == 'X' && length == 2)
        unlock_only(core);
    else if (what == 'H' && length == 2)
        home(core);
    else if (length <= 2 && waam_grbl_report(core, what))
        answer(core, 0);
    else
        write_setting(core, line, length);
}

/* What a program may not say here, though the controller knows it. */
static bool foreign(const waam_command_t *command, const char *line, size_t length, waam_error_t *error)
{
    size_t column = waam_grbl_arc_word(line, length);
    if (column)
        waam_fail(error, WAAM_E_NOT_ARMED, column, "no arc and no wire for a GRBL sender");
    else if (command->modal.voltage_v > 0.0)
        waam_fail(error, WAAM_E_NOT_ARMED, 1, "S is the voltage of the arc: only S0 for a GRBL sender");
    else if (command->action == WAAM_DO_HOME)
        waam_fail(error, WAAM_E_UNKNOWN_WORD, command->action_column, "G28 would home: use $H");
    else
        return false;
    return true;
}

static bool program_line(waam_core_t *core, const char *line, size_t length)
{
    waam_gcode_limits_t limits = {core->config.wire_max_mm_s, core->config.voltage_max_v};
    waam_command_t command;
    waam_error_t error;
    if (waam_grbl_locked(core) || waam_core_jogging(core)) {
        answer(core, 9);
        return true;
    }
    bool good = waam_gcode_parse(line, length, 0, &core->modal, &limits, &command, &error);
    if (waam_grbl_arc_word(line, length) || good)
        good = !foreign(&command, line, length, &error);
    if (good && waam_core_waits(core, &command))
        return false;
    if (good && waam_core_plan(core, &command, core->link.accepted + 1, &error))
        answer(core, 0);
    else
        refuse(core, &error);
    return true;
}

/* One listing for each period of telemetry, so that the line back is never full of them. */
static bool too_soon(waam_core_t *core)
{
    if (core->now_us < core->listing_us)
        return true;
    core->listing_us = core->now_us + core->telemetry_us;
    return false;
}

static size_t without_blanks(const char **line, size_t length)
{
    while (length && (*line)[length - 1] == ' ')
        length--;
    while (length && **line == ' ')
        ++*line, length--;
    return length;
}

static bool take(waam_core_t *core, const char *line, size_t length)
{
    if (length == 0)
        answer(core, 0);
    else if (line[0] == WAAM_GRBL_TOO_LONG)
        answer(core, 11);
    else if (line[0] == '$')
        system_line(core, line, length);
    else
        return program_line(core, line, length);
    return true;
}

bool waam_grbl_line(waam_core_t *core, const char *line, size_t length)
{
    const char *begin = line;
    size_t content = without_blanks(&begin, length);
    if (core->homing_asked || (content && waam_grbl_asks(begin, content) && too_soon(core)))
        return false;
    return take(core, begin, content);
}

void waam_grbl_hello(waam_core_t *core, const char *line, size_t length)
{
    const char *begin = line;
    size_t content = without_blanks(&begin, length);
    if (enter(core))
        take(core, begin, content);
}
