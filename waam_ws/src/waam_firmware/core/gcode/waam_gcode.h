/* One line of G-code to one command. Pure: the modal state goes in by value and comes out with the command. */
#ifndef WAAM_GCODE_H
#define WAAM_GCODE_H

#include "waam_path.h"
#include "waam_text.h"

#define WAAM_FRAMES 6 /* G54 .. G59 */

typedef enum {
    WAAM_MOTION_NONE,
    WAAM_MOTION_RAPID,   /* G0 */
    WAAM_MOTION_LINE,    /* G1 */
    WAAM_MOTION_ARC_CW,  /* G2 */
    WAAM_MOTION_ARC_CCW  /* G3 */
} waam_motion_mode_t;

/* Who says how fast the wire runs: W alone (a velocity, the default), or E, a length coupled to the path. */
typedef enum { WAAM_WIRE_VELOCITY, WAAM_WIRE_E_ABSOLUTE /* M82 */, WAAM_WIRE_E_RELATIVE /* M83 */ } waam_wire_mode_t;

/* What stays in force from line to line; all zero is the state after identification (G17 G21 G54 G90 G91.1 G94).
 * Lengths are always mm and speeds mm/s, whatever G20/G21 says. */
typedef struct {
    waam_motion_mode_t motion;
    waam_plane_t plane;
    waam_wire_mode_t wire_mode;
    bool relative, arc_absolute, inverse_time, inch;
    uint8_t frame;              /* 0 = G54 */
    double feed_mm_s;           /* 0 = none given */
    double wire_mm_s, voltage_v;
    double wire_end_mm;         /* E, the length of wire programmed so far */
    double g92_mm[WAAM_AXES];   /* further shift of every frame */
} waam_modal_t;

typedef enum {
    WAAM_DO_NOTHING, /* modal words or a comment only */
    WAAM_DO_MOVE,
    WAAM_DO_DWELL,
    WAAM_DO_HOME,
    WAAM_DO_SET_POSITION,   /* G92 */
    WAAM_DO_CLEAR_POSITION, /* G92.1 */
    WAAM_DO_SET_FRAME,      /* G10 L2, L20 */
    WAAM_DO_ARC_START,
    WAAM_DO_ARC_END,
    WAAM_DO_GAS,
    WAAM_DO_PAUSE, /* M0 */
    WAAM_DO_FINISH /* M2, M30 */
} waam_action_t;

typedef enum { WAAM_GAS_KEEP, WAAM_GAS_ON, WAAM_GAS_OFF } waam_gas_t;

typedef struct {
    waam_action_t action;
    waam_gas_t gas;     /* M7 M8 M9, before the action; a line without any other has DO_GAS */
    bool machine_frame; /* G53 */
    bool has[WAAM_AXES];
    double axis_mm[WAAM_AXES];
    double offset_mm[WAAM_AXES]; /* I J K */
    bool travels;                /* false for a move that only feeds wire */
    bool has_radius, has_wire;
    double radius_mm;
    double wire_mm;              /* length of wire to feed along the move; with G92 E: the new reading */
    double per_s;                /* G93: moves per second */
    double dwell_s;
    uint8_t frame;               /* of G10 */
    bool from_here;              /* G10 L20: so that the axis reads this value where it is */
    size_t axis_column[WAAM_AXES], arc_column, wire_column, action_column; /* for errors found later; 1 when the word is not there */
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

/* `line` starts at its 'N'; parsing starts at `start`. A '/' before the block is passed over and the block is read: the
 * block delete switch is off. A '%' alone says nothing. False: `error` says what is wrong and where. */
bool waam_gcode_parse(const char *line, size_t length, size_t start, const waam_modal_t *before,
                      const waam_gcode_limits_t *limits, waam_command_t *command, waam_error_t *error);
/* Fills an error; always returns false. */
bool waam_fail(waam_error_t *error, waam_code_t code, size_t column, const char *text);

#endif
