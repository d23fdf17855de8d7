/* One line of G-code to one command. Pure: the modal state goes in by value and comes out with the command. */
#ifndef WAAM_GCODE_H
#define WAAM_GCODE_H

#include "waam_text.h"

typedef enum { WAAM_MOTION_NONE, WAAM_MOTION_RAPID, WAAM_MOTION_LINE } waam_motion_mode_t;

/* What stays in force from line to line. Speeds are always mm/s, whatever G20/G21 says. */
typedef struct {
    waam_motion_mode_t motion;
    bool relative, inch;
    double feed_mm_s, wire_mm_s, voltage_v;
} waam_modal_t;

typedef enum {
    WAAM_DO_NOTHING, /* modal words or a comment only */
    WAAM_DO_MOVE,
    WAAM_DO_DWELL,
    WAAM_DO_HOME,
    WAAM_DO_SET_POSITION, /* G92 */
    WAAM_DO_ARC_START,
    WAAM_DO_ARC_END,
    WAAM_DO_GAS_ON,
    WAAM_DO_GAS_OFF,
    WAAM_DO_PAUSE, /* M0 */
    WAAM_DO_FINISH /* M2, M30 */
} waam_action_t;

typedef struct {
    waam_action_t action;
    bool machine_frame; /* G53 */
    bool has[WAAM_AXES];
    double axis_mm[WAAM_AXES];
    double dwell_s;
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

#endif
