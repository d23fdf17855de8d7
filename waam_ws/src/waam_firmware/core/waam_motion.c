#include "waam_motion.h"

#include <math.h>

static double between(double value, double lowest, double highest)
{
    return fmax(lowest, fmin(highest, value));
}

/* Greatest speed at the end of this tick from which `exit` can still be reached at the end of the block: root of
 * left - (v0 + v) dt / 2 = (v^2 - exit^2) / (2 a). */
static double braking_speed(double v0, double left_mm, double exit, double accel, double dt)
{
    double half = 0.5 * accel * dt;
    double root = half * half - accel * dt * v0 + 2.0 * accel * left_mm + exit * exit;
    return root > 0.0 ? sqrt(root) - half : 0.0;
}

/* The end is reached within this tick while slowing down to the exit speed at no more than the allowed rate. */
static bool arrives_braking(double v0, double left_mm, double exit, double accel, double dt)
{
    return v0 > exit && 2.0 * left_mm <= (v0 + exit) * dt && v0 * v0 - exit * exit <= 2.02 * accel * left_mm + 1e-6;
}

static void place(waam_motion_t *motion, const waam_block_t *block)
{
    double share = motion->done_mm / block->length_mm;
    for (int i = 0; i < WAAM_AXES; i++)
        motion->steps[i] = block->start[i] + (int32_t)lround(share * (block->end[i] - block->start[i]));
}

static double finish(waam_motion_t *motion, const waam_block_t *block, double speed, double time_s, bool *finished)
{
    for (int i = 0; i < WAAM_AXES; i++)
        motion->steps[i] = block->end[i];
    motion->done_mm = 0.0;
    motion->speed_mm_s = speed;
    *finished = true;
    return time_s;
}

double waam_motion_advance(waam_motion_t *motion, const waam_block_t *block, double limit_mm_s, double exit_mm_s,
                           double dt_s, bool *finished)
{
    double v0 = motion->speed_mm_s, left = block->length_mm - motion->done_mm, change = block->accel_mm_s2 * dt_s;
    *finished = false;
    if (limit_mm_s > 0.0 && arrives_braking(v0, left, exit_mm_s, block->accel_mm_s2, dt_s))
        return finish(motion, block, exit_mm_s, 2.0 * left / (v0 + exit_mm_s), finished);
    double v1 = fmin(limit_mm_s, braking_speed(v0, left, exit_mm_s, block->accel_mm_s2, dt_s));
    v1 = fmax(0.0, between(v1, v0 - change, v0 + change));
    double distance = 0.5 * (v0 + v1) * dt_s;
    if (distance < left - 1e-9) {
        motion->done_mm += distance;
        motion->speed_mm_s = v1;
        place(motion, block);
        return dt_s;
    }
    double rate = (v1 - v0) / dt_s;
    double v_end = sqrt(fmax(0.0, v0 * v0 + 2.0 * rate * left));
    double mean = 0.5 * (v0 + v_end);
    double time = mean > 0.0 ? fmin(dt_s, left / mean) : dt_s;
    /* A sync point is left at rest; a lower limit of the next move (override) is approached inside that move. */
    return finish(motion, block, exit_mm_s > 0.0 ? v_end : 0.0, time, finished);
}
