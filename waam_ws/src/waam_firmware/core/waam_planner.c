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

/* Greatest value along `unit` so that no axis exceeds its own limit. */
static double along(const double unit[WAAM_AXES], const double limit[WAAM_AXES])
{
    double result = INFINITY;
    for (int i = 0; i < WAAM_AXES; i++) {
        double share = fabs(unit[i]);
        if (share > 1e-9 && limit[i] / share < result)
            result = limit[i] / share;
    }
    return result;
}

void waam_block_geometry(waam_block_t *block, const double delta_mm[WAAM_AXES], const waam_kinematics_t *kinematics)
{
    double squares = 0.0;
    for (int i = 0; i < WAAM_AXES; i++)
        squares += delta_mm[i] * delta_mm[i];
    block->length_mm = sqrt(squares);
    for (int i = 0; i < WAAM_AXES; i++)
        block->unit[i] = delta_mm[i] / block->length_mm;
    block->ceiling_mm_s = along(block->unit, kinematics->max_speed_mm_s);
    block->accel_mm_s2 = along(block->unit, kinematics->accel_mm_s2);
}

/* Junction deviation: the corner is taken as a circle that stays within `deviation` of it; its centripetal acceleration
 * is the smaller of the two blocks'. v^2 = a d s / (1 - s), s = sin(half the angle between the blocks). */
static double junction(const waam_block_t *before, const waam_block_t *after, double deviation_mm)
{
    double cosine = 0.0;
    for (int i = 0; i < WAAM_AXES; i++)
        cosine -= before->unit[i] * after->unit[i];
    double half_sine = sqrt(fmax(0.0, 0.5 * (1.0 - cosine)));
    if (half_sine > 0.9999999)
        return INFINITY;
    double accel = fmin(before->accel_mm_s2, after->accel_mm_s2);
    return sqrt(accel * deviation_mm * half_sine / (1.0 - half_sine));
}

double waam_block_cruise(const waam_block_t *block, double override)
{
    return fmin(block->nominal_mm_s * override, block->ceiling_mm_s);
}

static double exit_of(const waam_planner_t *planner, size_t i)
{
    if (i + 1 >= planner->count)
        return 0.0;
    const waam_block_t *next = &planner->block[(planner->head + i + 1) % WAAM_BLOCKS];
    return next->kind == WAAM_BLOCK_MOVE ? next->entry_mm_s : 0.0;
}

double waam_planner_exit(const waam_planner_t *planner) { return exit_of(planner, 0); }

/* From the last block to the first: no block is entered faster than it can slow down to its own exit. A forward pass is
 * not needed, for motion accelerates step by step within the limit and these speeds are only upper bounds. */
static void replan(waam_planner_t *planner, bool all)
{
    for (size_t i = planner->count; i-- > 1;) {
        waam_block_t *block = at(planner, i);
        if (block->kind != WAAM_BLOCK_MOVE)
            continue;
        const waam_block_t *before = at(planner, i - 1);
        double entry = 0.0;
        if (before->kind == WAAM_BLOCK_MOVE) {
            double exit = exit_of(planner, i);
            entry = sqrt(exit * exit + 2.0 * block->accel_mm_s2 * block->length_mm);
            entry = fmin(entry, block->junction_mm_s);
            entry = fmin(entry, waam_block_cruise(before, planner->override));
            entry = fmin(entry, waam_block_cruise(block, planner->override));
        }
        if (!all && i + 1 < planner->count && entry == block->entry_mm_s)
            return;
        block->entry_mm_s = entry;
    }
}

void waam_planner_push(waam_planner_t *planner, const waam_block_t *block, const waam_kinematics_t *kinematics)
{
    const waam_block_t *before = waam_planner_tail(planner);
    waam_block_t *added = at(planner, planner->count++);
    *added = *block;
    added->entry_mm_s = added->junction_mm_s = 0.0;
    if (block->kind != WAAM_BLOCK_MOVE || !before || before->kind != WAAM_BLOCK_MOVE)
        return;
    added->junction_mm_s = junction(before, added, kinematics->junction_deviation_mm);
    replan(planner, false);
}

void waam_planner_set_override(waam_planner_t *planner, double factor)
{
    planner->override = factor;
    replan(planner, true);
}
