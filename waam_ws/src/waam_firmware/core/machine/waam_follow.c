/* The wire that goes with what is executed: W of the block that the path will be in when the wire gets to the arc, or, where
 * the wire is coupled to the path (M82, M83), the length of wire that the path asks for. */
#include <math.h>

#include "waam_internal.h"

#define CATCH_UP_S 0.1 /* wire that is owed is fed over this time */

/* Speed for striking and for the end crater, while the path stands. */
static double resting_speed(const waam_core_t *core)
{
    for (size_t i = 0; i < 2; i++) {
        const waam_block_t *block = waam_planner_block(&core->planner, i);
        if (block && block->kind == WAAM_BLOCK_MOVE && block->wire_per_mm > 0.0)
            return block->wire_per_mm * waam_block_cruise(block, 1.0);
    }
    return core->wire.resting_mm_s > 0.0 ? core->wire.resting_mm_s : core->config.wire_strike_mm_s;
}

/* How far ahead to look: what is fed now gets to the arc after the delay, and half of a change then still takes the
 * response of the motor; so the change is centred on the place where it belongs. The shaped motion is where the planned one
 * was the mean delay of the shaper ago. */
static waam_ahead_t look_ahead(const waam_core_t *core)
{
    double ahead = core->config.wire_delay_s + core->config.wire_response_s;
    return waam_motion_ahead(&core->motion, &core->planner, core->shaper.on ? ahead - (double)core->shaper.delay_s : ahead);
}

/* The path is `owed` ahead of the wire when both have got to where they will be a moment later. */
static double coupled_speed(const waam_core_t *core, const waam_ahead_t *ahead)
{
    double owed = core->motion.wire_mm + ahead->wire_mm - core->wire.fed_mm;
    return ahead->block->wire_per_mm * ahead->speed_mm_s + owed / CATCH_UP_S;
}

static void follow_path(waam_core_t *core, const waam_block_t *head, bool burning)
{
    waam_ahead_t ahead = look_ahead(core);
    double speed = coupled_speed(core, &ahead);
    if (burning)
        core->arc.wire_mm_s = fmax(0.0, speed);
    else if (head->wire_only)
        core->wire.free_mm_s = speed;
    if (head->wire_per_mm > 0.0)
        core->wire.resting_mm_s = head->wire_per_mm * waam_block_cruise(head, 1.0);
}

void waam_core_follow(waam_core_t *core)
{
    const waam_block_t *head = waam_planner_block(&core->planner, 0);
    bool burning = core->arc.phase == WAAM_ARC_BURNING, arrives = !waam_shaper_settled(&core->shaper);
    bool runs = core->state == WAAM_RUN && (core->block_started || arrives);
    bool moves = head && runs && core->block_started && head->kind == WAAM_BLOCK_MOVE;
    bool coupled = head ? head->coupled : core->executed_modal.wire_mode != WAAM_WIRE_VELOCITY;
    core->wire.free_mm_s = 0.0;
    core->wire.override = burning ? core->wire_override : 1.0;
    if (coupled && moves && (burning || core->arc.phase == WAAM_ARC_OFF)) {
        follow_path(core, head, burning);
        return;
    }
    core->wire.fed_mm = core->motion.wire_mm;
    if (coupled)
        core->arc.wire_mm_s = burning && runs ? 0.0 : resting_speed(core);
    else if (moves && burning)
        core->arc.wire_mm_s = look_ahead(core).block->wire_mm_s;
}
