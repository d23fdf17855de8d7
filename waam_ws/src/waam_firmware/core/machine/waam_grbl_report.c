/* What GRBL senders are told: status, settings, modes, frames, build. In the forms of GRBL 1.1. */
#include <math.h>

#include "waam_grbl_dialect.h"
#include "waam_internal.h"

static void add_axes(waam_text_t *text, const double mm[WAAM_AXES])
{
    for (int i = 0; i < WAAM_AXES; i++) {
        if (i)
            waam_text_char(text, ',');
        waam_text_places(text, mm[i], 3);
    }
}

/* ---- status ---- */

bool waam_grbl_locked(const waam_core_t *core) { return core->state == WAAM_ALARM || core->link.blocked; }

static const char *state_of(const waam_core_t *core)
{
    if (waam_grbl_locked(core))
        return "<Alarm";
    if (core->state == WAAM_HOLD)
        return waam_core_stands(core) ? "<Hold:0" : "<Hold:1";
    if (core->home.active)
        return "<Home";
    return core->state == WAAM_IDLE ? "<Idle" : waam_core_jogging(core) ? "<Jog" : "<Run";
}

static void add_switches(waam_text_t *text, const waam_core_t *core)
{
    const bool *pressed = core->inputs.home_switch;
    if (pressed[0] || pressed[1] || pressed[2])
        waam_text_add(text, "|Pn:");
    for (int i = 0; i < WAAM_AXES; i++)
        if (pressed[i])
            waam_text_char(text, waam_axis_names[i]);
}

void waam_grbl_status(waam_core_t *core)
{
    waam_text_t text = {.length = 0};
    double machine_mm[WAAM_AXES], zero_mm[WAAM_AXES];
    if (!core->status_asked)
        return;
    core->status_asked = false;
    for (int i = 0; i < WAAM_AXES; i++) {
        machine_mm[i] = (double)waam_core_steps(core, i) / core->config.steps_per_mm[i];
        zero_mm[i] = waam_core_zero_mm(core, &core->executed_modal, i);
    }
    waam_text_add(&text, state_of(core));
    waam_text_add(&text, "|MPos:");
    add_axes(&text, machine_mm);
    waam_text_add(&text, "|FS:");
    waam_text_uint(&text, (uint64_t)llround((core->home.active ? fabs(core->home.speed_mm_s) : waam_core_speed(core)) * 60.0));
    waam_text_add(&text, ",0");
    add_switches(&text, core);
    waam_text_add(&text, "|WCO:");
    add_axes(&text, zero_mm);
    waam_text_add(&text, "|Ov:");
    waam_text_uint(&text, (uint64_t)llround(core->planner.override * 100.0));
    waam_text_add(&text, ",100,100>");
    waam_grbl_say(core, &text);
}

/* ---- settings ---- */

/* Numbers of GRBL 1.1; those above 100 are of three axes each. */
static const uint8_t numbers[] = {0,  1,  2,  3,  4,  5,  6,   10,  11,  12,  13,  20,  21,  22,  23,  24, 25,
                                  26, 27, 30, 31, 32, 100, 101, 102, 110, 111, 112, 120, 121, 122, 130, 131, 132};

static unsigned home_mask(const waam_config_t *c)
{
    unsigned mask = 0; /* axes that home downwards */
    for (int i = 0; i < WAAM_AXES; i++)
        mask |= c->home_direction[i] < 0 ? 1u << i : 0;
    return mask;
}

static bool axis_setting(const waam_config_t *c, unsigned number, double *value)
{
    unsigned axis = number % 10;
    if (axis >= WAAM_AXES)
        return false;
    switch (number - axis) {
    case 100: *value = c->steps_per_mm[axis]; return true;
    case 110: *value = c->max_speed_mm_s[axis] * 60.0; return true;
    case 120: *value = c->accel_mm_s2[axis]; return true;
    case 130: *value = c->limit_max_mm[axis] - c->limit_min_mm[axis]; return true;
    default: return false;
    }
}

bool waam_grbl_setting(const waam_core_t *core, unsigned number, double *value)
{
    const waam_config_t *c = &core->config;
    *value = 0.0;
    switch (number) {
    case 0: *value = 6.0; return true;   /* step pulse, us: half a slot of 80 kHz */
    case 1: *value = 255.0; return true; /* the drives keep their torque */
    case 10:                             /* status: machine position */
    case 20:                             /* soft limits */
    case 21:                             /* hard limits */
    case 22: *value = 1.0; return true;  /* homing */
    case 11: *value = c->junction_deviation_mm; return true;
    case 23: *value = home_mask(c); return true;
    case 24: *value = c->home_latch_mm_s * 60.0; return true;
    case 25: *value = c->home_seek_mm_s * 60.0; return true;
    case 27: *value = c->home_backoff_mm; return true;
    case 2: /* inversions of pulses, directions, enable and inputs: none */
    case 3:
    case 4:
    case 5:
    case 6:
    case 12: /* arcs are exact */
    case 13: /* reports are in mm */
    case 26:
    case 30: /* no spindle, no laser */
    case 31:
    case 32: return true;
    default: return number >= 100 && axis_setting(c, number, value);
    }
}

/* Whole numbers are written so; GRBL has three decimals for all others. */
static bool whole(unsigned number) { return number != 11 && number != 12 && (number < 24 || number == 26 || number == 32); }

static void settings(waam_core_t *core)
{
    for (size_t i = 0; i < sizeof numbers; i++) {
        waam_text_t text = {.length = 0};
        double value;
        waam_grbl_setting(core, numbers[i], &value);
        waam_text_char(&text, '$');
        waam_text_uint(&text, numbers[i]);
        waam_text_char(&text, '=');
        waam_text_places(&text, value, whole(numbers[i]) ? 0 : 3);
        waam_grbl_say(core, &text);
    }
}

/* ---- modes, frames, build ---- */

static void modes(waam_core_t *core)
{
    static const char *const motions[] = {"G80", "G0", "G1", "G2", "G3"};
    const waam_modal_t *m = &core->modal;
    waam_text_t text = {.length = 0};
    waam_text_add(&text, "[GC:");
    waam_text_add(&text, motions[m->motion]);
    waam_text_add(&text, " G");
    waam_text_uint(&text, 54u + m->frame);
    waam_text_add(&text, " G");
    waam_text_uint(&text, 17u + (unsigned)m->plane);
    waam_text_add(&text, m->inch ? " G20" : " G21");
    waam_text_add(&text, m->relative ? " G91" : " G90");
    waam_text_add(&text, m->inverse_time ? " G93" : " G94");
    waam_text_add(&text, core->arc.gas_asked ? " M5 M8 T0 F" : " M5 M9 T0 F");
    waam_text_fixed(&text, m->feed_mm_s * 60.0 / (m->inch ? 25.4 : 1.0), 3);
    waam_text_add(&text, " S0]");
    waam_grbl_say(core, &text);
}

static void frame(waam_core_t *core, const char *name, unsigned number, const double mm[WAAM_AXES])
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, name);
    if (number)
        waam_text_uint(&text, number);
    waam_text_char(&text, ':');
    add_axes(&text, mm);
    waam_text_char(&text, ']');
    waam_grbl_say(core, &text);
}

static void frames(waam_core_t *core)
{
    static const double zero[WAAM_AXES] = {0.0};
    for (unsigned i = 0; i < WAAM_FRAMES; i++)
        frame(core, "[G", 54u + i, core->work_mm[i]);
    frame(core, "[G28", 0, zero);
    frame(core, "[G30", 0, zero);
    frame(core, "[G92", 0, core->modal.g92_mm);
    waam_grbl_tell(core, "[TLO:0.000]");
    waam_grbl_tell(core, "[PRB:0.000,0.000,0.000:0]");
}

/* The version is that of the protocol. Options: coolant mist, zero where it homes, no resets of settings, no build line. */
static void build(waam_core_t *core)
{
    waam_text_t text = {.length = 0};
    waam_grbl_tell(core, "[VER:1.1h.20190830:WAAM_CONTROLLER_V1 " WAAM_FIRMWARE_VERSION "]");
    waam_text_add(&text, "[OPT:MZ*$#I,");
    waam_text_uint(&text, WAAM_BLOCKS);
    waam_text_char(&text, ',');
    waam_text_uint(&text, WAAM_GRBL_RX);
    waam_text_char(&text, ']');
    waam_grbl_say(core, &text);
}

bool waam_grbl_report(waam_core_t *core, char question)
{
    switch (question) {
    case '\0': waam_grbl_tell(core, "[HLP:$$ $# $G $I $N $x=val $J=line $X $H ~ ! ? ctrl-x]"); return true;
    case '$': settings(core); return true;
    case '#': frames(core); return true;
    case 'G': modes(core); return true;
    case 'I': build(core); return true;
    case 'N':
        waam_grbl_tell(core, "$N0=");
        waam_grbl_tell(core, "$N1=");
        return true;
    default: return false;
    }
}
