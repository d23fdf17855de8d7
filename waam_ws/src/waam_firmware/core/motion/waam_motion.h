/* Moves along the head block: bounded acceleration, exact braking, exact steps. */
#ifndef WAAM_MOTION_H
#define WAAM_MOTION_H

#include "waam_planner.h"

typedef struct {
    double steps_per_mm[WAAM_AXES];
    int32_t steps[WAAM_AXES]; /* where the machine is */
    int32_t part[WAAM_AXES];  /* place between two steps, 1 / WAAM_PARTS; 0 at the end of a block */
    int64_t datum_steps[WAAM_AXES]; /* steps less pulses given out; homing shifts it */
    double speed_mm_s;        /* along the path */
    double done_mm;           /* of the head block */
} waam_motion_t;

/* The axis stands at `steps` from now on; nothing moves. */
void waam_motion_declare(waam_motion_t *motion, int axis, int32_t steps);
/* Moves for at most dt_s towards `limit_mm_s` (0 = slow down and stand), so that the block can be left at `exit_mm_s`.
 * Returns the time used; *finished when the end of the block was reached. */
double waam_motion_advance(waam_motion_t *motion, const waam_block_t *block, double limit_mm_s, double exit_mm_s,
                           double dt_s, bool *finished);

/* The block that the path will be in `ahead_s` from now, if nothing intervenes: a move or a dwell; NULL = nothing moves.
 * Looks through the profiles of the blocks that follow; 16 at most, fewer where corners are passed slowly. */
const waam_block_t *waam_motion_ahead(const waam_motion_t *motion, const waam_planner_t *planner, double ahead_s);

#endif
