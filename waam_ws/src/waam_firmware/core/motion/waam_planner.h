/* Queue of blocks with look-ahead: gives each move the greatest speed at which it may be entered. */
#ifndef WAAM_PLANNER_H
#define WAAM_PLANNER_H

#include "waam_gcode.h"
#include "waam_rounding.h"

typedef enum {
    WAAM_BLOCK_MOVE,
    WAAM_BLOCK_DWELL,
    WAAM_BLOCK_HOME,
    WAAM_BLOCK_ARC_START,
    WAAM_BLOCK_ARC_END,
    WAAM_BLOCK_GAS,
    WAAM_BLOCK_FINISH
} waam_block_kind_t;

typedef struct {
    waam_block_kind_t kind;
    bool jog;
    uint32_t line;              /* last line that is done when this block is; 0 = none */
    double wire_mm_s, voltage_v;/* in force from the start of this block */
    waam_gas_t gas;             /* from the start of this block; of an arc end, from its end */
    double dwell_s;
    /* moves */
    waam_path_t path;
    int32_t end[WAAM_AXES];     /* steps */
    double nominal_mm_s;        /* before the override */
    double ceiling_mm_s;        /* the axes allow no more, whatever the override */
    double accel_mm_s2;
    double junction_mm_s;       /* entry limit from the corner before; 0 = starts from rest */
    double entry_max_mm_s;      /* the corner and the speeds of both blocks allow no more, whatever comes after */
    double gain_mm2_s2;         /* by how much the square of the speed can change along the block: 2 a l */
    double entry_mm_s;          /* planned greatest entry speed */
    waam_slow_t first, last;    /* beside the corners, while the motion is shaped */
} waam_block_t;

typedef struct {
    waam_block_t block[WAAM_BLOCKS];
    size_t head, count;
    double override;            /* factor on nominal speeds */
    waam_rounding_t rounding;   /* of corners, by the shaper */
} waam_planner_t;

void waam_planner_init(waam_planner_t *planner);
/* Forgets all blocks; the override stays. */
void waam_planner_clear(waam_planner_t *planner);
/* Blocks that can be pushed. */
size_t waam_planner_free(const waam_planner_t *planner);
/* The i-th block from the head; NULL beyond the last. */
const waam_block_t *waam_planner_block(const waam_planner_t *planner, size_t i);
/* The block that runs, NULL = none. */
waam_block_t *waam_planner_head(waam_planner_t *planner);
/* The newest block, NULL = none. */
waam_block_t *waam_planner_tail(waam_planner_t *planner);
/* The head is done. */
void waam_planner_pop(waam_planner_t *planner);
/* Completes a move from its path and nominal speed: end in steps and limits. */
void waam_block_complete(waam_block_t *block, const waam_kinematics_t *kinematics);
/* Appends a block (there must be a free one), works out its corner and plans again. */
void waam_planner_push(waam_planner_t *planner, const waam_block_t *block, const waam_kinematics_t *kinematics);
/* Takes effect inside the running block: all entry speeds are planned again. */
void waam_planner_set_override(waam_planner_t *planner, double factor);
/* Speed at which the i-th block may be left. */
double waam_planner_exit(const waam_planner_t *planner, size_t i);
/* Speed wanted inside a block, with override. */
double waam_block_cruise(const waam_block_t *block, double override);

#endif
