/* One line of G-code to one command. Pure: the modal state goes in by value and comes out with the command. */
#ifndef WAAM_GCODE_H
#define WAAM_GCODE_H

#include "waam_path.h"
#include "waam_setting.h"
#include "waam_text.h"

typedef enum {
    WAAM_MOTION_NONE,
    WAAM_MOTION_RAPID,   /* G0 */
    WAAM_MOTION_LINE,    /* G1 */
    WAAM_MOTION_ARC_CW,  /* G2 */
    WAAM_MOTION_ARC_CCW  /* G3 */
} waam_motion_mode_t;

/* What stays in force from line to line; all zero is the state after identification (G90). */
typedef struct {
    waam_motion_mode_t motion;
    bool relative;
    double feed_mm_s;           /* 0 = none given */
    double wire_mm_s, voltage_v;
} waam_modal_t;

typedef enum {
    WAAM_DO_NOTHING, /* modal words or a comment only */
    WAAM_DO_MOVE,
    WAAM_DO_DWELL,
    WAAM_DO_HOME,
    WAAM_DO_ARC_START,
    WAAM_DO_ARC_END,
    WAAM_DO_GAS,
    WAAM_DO_FINISH /* M30 */
} waam_action_t;

typedef enum { WAAM_GAS_KEEP, WAAM_GAS_ON, WAAM_GAS_OFF } waam_gas_t;

typedef struct {
    waam_action_t action;
    waam_gas_t gas;     /* M7 M9, before the action; a line without any other has DO_GAS */
    bool has[WAAM_AXES];
    double axis_mm[WAAM_AXES];
    double centre_mm[2]; /* I J, from the start of the arc */
    double dwell_s;
    size_t axis_column[WAAM_AXES], arc_column, action_column; /* for errors found later; 1 when the word is not there */
    waam_modal_t modal; /* in force after this line */
} waam_command_t;

typedef struct {
    waam_code_t code;
    size_t column; /* from 1, in the whole line */
    waam_text_t text;
} waam_error_t;

typedef struct {
    double wire_max_mm_s, voltage_max_v;
} waam_gcode_limits_t;

/* `line` starts at its 'N'; parsing starts at `start`. False: `error` says what is wrong and where. */
bool waam_gcode_parse(const char *line, size_t length, size_t start, const waam_modal_t *before,
                      const waam_gcode_limits_t *limits, waam_command_t *command, waam_error_t *error);
/* Fills an error; always returns false. */
bool waam_fail(waam_error_t *error, waam_code_t code, size_t column, const char *text);
/* "<name> must lie within ...", of a setting; always false. */
bool waam_fail_range(waam_error_t *error, const waam_setting_t *setting);

#endif
