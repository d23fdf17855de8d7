#include "waam_planner.h"

#include <math.h>

void waam_planner_init(waam_planner_t *planner)
{
    waam_planner_clear(planner);
    planner->override = 1.0;
}

void waam_planner_clear(waam_planner_t *planner) { planner->head = planner->count = 0; }

size_t waam_planner_free(const waam_planner_t *planner) { return WAAM_BLOCKS - planner->count; }

static waam_block_t *at(waam_planner_t *planner, size_t i) { return &planner->block[(planner->head + i) % WAAM_BLOCKS]; }

const waam_block_t *waam_planner_block(const waam_planner_t *planner, size_t i)
{
    return i < planner->count ? &planner->block[(planner->head + i) % WAAM_BLOCKS] : NULL;
}

waam_block_t *waam_planner_head(waam_planner_t *planner) { return planner->count ? at(planner, 0) : NULL; }

waam_block_t *waam_planner_tail(waam_planner_t *planner)
{
    return planner->count ? at(planner, planner->count - 1) : NULL;
}

void waam_planner_pop(waam_planner_t *planner)
{
    planner->head = (planner->head + 1) % WAAM_BLOCKS;
    planner->count--;
}

void waam_block_complete(waam_block_t *block, const waam_kinematics_t *kinematics)
{
    for (int i = 0; i < WAAM_AXES; i++)
        block->end[i] = (int32_t)lround(block->path.end_mm[i] * kinematics->steps_per_mm[i]);
    waam_path_limits(&block->path, block->nominal_mm_s, kinematics, &block->ceiling_mm_s, &block->accel_mm_s2);
}

/* Speed limit of the corner between two moves.
 * Junction deviation: the corner is taken as a circle that stays within `deviation` of it; its centripetal acceleration
 * is the smaller of the two blocks'. v^2 = a d s / (1 - s), s = sin(half the angle between the blocks).
 * Moves shorter than that circle leave less room: half of each, v^2 = a l / 2 tan(half the angle), so that a curve made
 * of very short moves is not run faster than the same curve as an arc.
 * `half`: sine of half the turn. */
static double junction(const waam_block_t *before, const waam_block_t *after, const waam_kinematics_t *k, double *half)
{
    double cosine = 0.0, in[WAAM_AXES], out[WAAM_AXES], limit = INFINITY;
    double accel = fmin(before->accel_mm_s2, after->accel_mm_s2);
    double shorter = fmin(before->path.length_mm, after->path.length_mm);
    waam_path_direction(&before->path, 1.0, in);
    waam_path_direction(&after->path, 0.0, out);
    for (int i = 0; i < WAAM_AXES; i++)
        cosine -= in[i] * out[i];
    double sine = sqrt(fmax(0.0, 0.5 * (1.0 - cosine)));
    *half = sqrt(fmax(0.0, 0.5 * (1.0 + cosine)));
    if (sine <= 0.9999999) {
        double room = 0.5 * shorter * sine / sqrt(1.0 - sine * sine);
        limit = sqrt(accel * fmin(k->junction_deviation_mm * sine / (1.0 - sine), room));
    }
    return limit;
}

double waam_block_cruise(const waam_block_t *block, double override)
{
    double wanted = block->nominal_mm_s * override;
    return wanted < block->ceiling_mm_s ? wanted : block->ceiling_mm_s;
}

double waam_planner_exit(const waam_planner_t *planner, size_t i)
{
    const waam_block_t *next = waam_planner_block(planner, i + 1);
    return next && next->kind == WAAM_BLOCK_MOVE ? next->entry_mm_s : 0.0;
}

/* Greatest speed from which a move can slow down to that of its last stretch. */
static double reached_before(const waam_slow_t *last, const waam_block_t *block)
{
    float left = fmaxf(0.0f, (float)block->path.length_mm - last->length_mm);
    return (double)sqrtf(last->speed_mm_s * last->speed_mm_s + 2.0f * (float)block->accel_mm_s2 * left);
}

/* By the speeds wanted in a block and in the one before it. */
static double limited_entry(const waam_block_t *block, double before_mm_s, double cruise_mm_s)
{
    double limit = before_mm_s < cruise_mm_s ? before_mm_s : cruise_mm_s;
    limit = block->junction_mm_s < limit ? block->junction_mm_s : limit;
    if (block->last.length_mm <= 0.0f)
        return limit;
    double reached = reached_before(&block->last, block);
    return reached < limit ? reached : limit;
}

static double entry_max(const waam_planner_t *planner, const waam_block_t *before, const waam_block_t *block)
{
    return limited_entry(block, waam_block_cruise(before, planner->override), waam_block_cruise(block, planner->override));
}

/* The square root to a part in 1e14: a processor without doubles has that of a float in hardware, and one step of Newton
 * is three times as fast as its sqrt. */
static double root(double x)
{
    double near = (double)sqrtf((float)x);
    return near > 0.0 ? 0.5 * (near + x / near) : 0.0;
}

/* From the last block to the first: no block is entered faster than it can slow down to its own exit. A forward pass is
 * not needed, for motion accelerates step by step within the limit and these speeds are only upper bounds. A processor
 * without doubles spends its longest tick here: what does not depend on the blocks after is worked out beforehand. */
static void replan(waam_planner_t *planner, bool all)
{
    double exit = 0.0;
    for (size_t i = planner->count; i-- > 1;) {
        waam_block_t *block = at(planner, i);
        double entry = 0.0; /* also of blocks that do not move, and of those after them */
        if (block->entry_max_mm_s > 0.0) {
            double most = block->entry_max_mm_s, square = exit * exit + block->gain_mm2_s2;
            entry = square < most * most ? root(square) : most;
        }
        if (!all && i + 1 < planner->count && entry == block->entry_mm_s)
            return;
        block->entry_mm_s = exit = entry;
    }
}

/* What comes after the block is not known yet: it may turn back, however soon; and what was before it, where the queue is
 * empty, may still be under way in the shaper. Nothing is cut off before and after a block that waits for the motion. */
static void add_stretches(waam_planner_t *planner, waam_block_t *added)
{
    const waam_rounding_t *r = &planner->rounding;
    waam_slow_t slow = waam_rounding_slow(r, waam_rounding_corner(r, 1.0f, 0.0f)), none = {.length_mm = 0.0f};
    added->first = added->last = none;
    if (added->kind == WAAM_BLOCK_MOVE) {
        added->last = slow;
        added->first = planner->count == 1 ? slow : none;
        if (added->path.arc)
            added->ceiling_mm_s = fmin(added->ceiling_mm_s, (double)waam_rounding_curve(r, (float)added->path.radius_mm));
    } else if (planner->count > 1) {
        at(planner, planner->count - 2)->last = none;
    }
}

/* The newest move and the one before it, once their corner is known. */
static void join(waam_planner_t *planner, waam_block_t *added, double half)
{
    const waam_rounding_t *r = &planner->rounding;
    size_t i = planner->count - 2;
    waam_block_t *before = at(planner, i);
    float shorter = (float)fmin(before->path.length_mm, added->path.length_mm);
    float corner = waam_rounding_corner(r, (float)half, shorter);
    waam_slow_t slow = waam_rounding_slow(r, corner);
    if (r->allowed_mm <= 0.0f)
        return;
    added->first = before->last = slow;
    added->junction_mm_s = fmin(added->junction_mm_s, (double)corner);
    if (i > 0 && before->junction_mm_s > 0.0)
        before->entry_max_mm_s = entry_max(planner, at(planner, i - 1), before);
}

void waam_planner_push(waam_planner_t *planner, const waam_block_t *block, const waam_kinematics_t *kinematics)
{
    const waam_block_t *before = waam_planner_tail(planner);
    waam_block_t *added = at(planner, planner->count++);
    *added = *block;
    added->entry_mm_s = added->entry_max_mm_s = added->junction_mm_s = 0.0;
    add_stretches(planner, added);
    if (block->kind != WAAM_BLOCK_MOVE || !before || before->kind != WAAM_BLOCK_MOVE)
        return;
    double half;
    added->junction_mm_s = junction(before, added, kinematics, &half);
    join(planner, added, half);
    added->entry_max_mm_s = entry_max(planner, before, added);
    added->gain_mm2_s2 = 2.0 * added->accel_mm_s2 * added->path.length_mm;
    replan(planner, false);
}

void waam_planner_set_override(waam_planner_t *planner, double factor)
{
    double before = planner->count ? waam_block_cruise(at(planner, 0), factor) : 0.0;
    planner->override = factor;
    for (size_t i = 1; i < planner->count; i++) {
        waam_block_t *block = at(planner, i);
        double cruise = waam_block_cruise(block, factor);
        if (block->junction_mm_s > 0.0)
            block->entry_max_mm_s = limited_entry(block, before, cruise);
        before = cruise;
    }
    replan(planner, true);
}
