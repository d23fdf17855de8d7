/* The wire that goes with what is executed: W of the block that the path will be in when the wire gets to the arc. */
#include "waam_internal.h"

/* How far ahead to look: what is fed now gets to the arc after the delay, and half of a change then still takes the
 * response of the motor; so the change is centred on the place where it belongs. The shaped motion is where the planned one
 * was the mean delay of the shaper ago. */
void waam_core_follow(waam_core_t *core)
{
    const waam_block_t *head = waam_planner_block(&core->planner, 0);
    bool moves = head && core->state == WAAM_RUN && core->block_started && head->kind == WAAM_BLOCK_MOVE;
    double ahead = core->config.wire_delay_s + core->config.wire_response_s;
    if (moves && core->arc.phase == WAAM_ARC_BURNING)
        core->arc.wire_mm_s = waam_motion_ahead(&core->motion, &core->planner,
                                                core->shaper.on ? ahead - (double)core->shaper.delay_s : ahead)->wire_mm_s;
}
