/* Queue of blocks with look-ahead: gives each move the greatest speed at which it may be entered. */
#ifndef WAAM_PLANNER_H
#define WAAM_PLANNER_H

#include "waam_types.h"

typedef enum {
    WAAM_BLOCK_MOVE,
    WAAM_BLOCK_DWELL,
    WAAM_BLOCK_HOME,
    WAAM_BLOCK_ARC_START,
    WAAM_BLOCK_ARC_END,
    WAAM_BLOCK_GAS_ON,
    WAAM_BLOCK_GAS_OFF,
    WAAM_BLOCK_PAUSE,
    WAAM_BLOCK_FINISH
} waam_block_kind_t;

typedef struct {
    waam_block_kind_t kind;
    bool jog;
    uint32_t line;              /* last line that is done when this block is; 0 = none */
    double wire_mm_s, voltage_v;/* in force from the start of this block */
    double dwell_s;
    /* moves */
    int32_t start[WAAM_AXES], end[WAAM_AXES]; /* steps */
    double unit[WAAM_AXES];     /* direction */
    double length_mm;
    double nominal_mm_s;        /* before the override */
    double ceiling_mm_s;        /* the axes allow no more, whatever the override */
    double accel_mm_s2;
    double junction_mm_s;       /* entry limit from the corner before; 0 = starts from rest */
    double entry_mm_s;          /* planned greatest entry speed */
} waam_block_t;

typedef struct {
    waam_block_t block[WAAM_BLOCKS];
    size_t head, count;
    double override;            /* factor on nominal speeds */
} waam_planner_t;

typedef struct {
    int32_t steps_per_mm;
    double max_speed_mm_s[WAAM_AXES], accel_mm_s2[WAAM_AXES];
    double junction_deviation_mm;
} waam_kinematics_t;

void waam_planner_init(waam_planner_t *planner);
void waam_planner_clear(waam_planner_t *planner);
size_t waam_planner_free(const waam_planner_t *planner);
waam_block_t *waam_planner_head(waam_planner_t *planner);
waam_block_t *waam_planner_tail(waam_planner_t *planner);
void waam_planner_pop(waam_planner_t *planner);
/* Completes a move from `delta_mm`, its start, end and nominal speed. */
void waam_block_geometry(waam_block_t *block, const double delta_mm[WAAM_AXES], const waam_kinematics_t *kinematics);
/* Appends a block (there must be a free one), works out its corner and plans again. */
void waam_planner_push(waam_planner_t *planner, const waam_block_t *block, const waam_kinematics_t *kinematics);
void waam_planner_set_override(waam_planner_t *planner, double factor);
/* Speed at which the head block may be left. */
double waam_planner_exit(const waam_planner_t *planner);
/* Speed wanted inside a block, with override. */
double waam_block_cruise(const waam_block_t *block, double override);

#endif
