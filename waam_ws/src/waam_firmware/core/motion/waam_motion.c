#include "waam_motion.h"

#include <math.h>

void waam_motion_declare(waam_motion_t *motion, int axis, int32_t steps)
{
    motion->datum_steps[axis] += (int64_t)steps - motion->steps[axis];
    motion->steps[axis] = steps;
    motion->part[axis] = 0;
}

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

/* The limit, less where the stretches beside the corners ask for it. */
static double beside_corners(const waam_motion_t *motion, const waam_block_t *block, double limit, double dt)
{
    double slow = (double)block->last.speed_mm_s;
    if ((double)block->first.length_mm > motion->done_mm)
        limit = fmin(limit, (double)block->first.speed_mm_s);
    if (block->last.length_mm <= 0.0f || limit <= slow)
        return limit;
    double before = block->path.length_mm - motion->done_mm - (double)block->last.length_mm;
    if (before > 0.0)
        slow = fmax(slow, braking_speed(motion->speed_mm_s, before, slow, block->accel_mm_s2, dt));
    return fmin(limit, slow);
}

static void place(waam_motion_t *motion, const waam_block_t *block)
{
    double at_mm[WAAM_AXES];
    waam_path_point(&block->path, motion->done_mm / block->path.length_mm, at_mm);
    for (int i = 0; i < WAAM_AXES; i++) {
        double at = at_mm[i] * motion->steps_per_mm[i];
        motion->steps[i] = (int32_t)lround(at);
        motion->part[i] = (int32_t)lround((at - motion->steps[i]) * (WAAM_PARTS - 2)); /* below a half on either side */
    }
}

static double finish(waam_motion_t *motion, const waam_block_t *block, double speed, double time_s, bool *finished)
{
    for (int i = 0; i < WAAM_AXES; i++) {
        motion->steps[i] = block->end[i];
        motion->part[i] = 0;
    }
    motion->done_mm = 0.0;
    motion->speed_mm_s = speed;
    *finished = true;
    return time_s;
}

double waam_motion_advance(waam_motion_t *motion, const waam_block_t *block, double limit_mm_s, double exit_mm_s,
                           double dt_s, bool *finished)
{
    double v0 = motion->speed_mm_s, left = block->path.length_mm - motion->done_mm, change = block->accel_mm_s2 * dt_s;
    *finished = false;
    if (limit_mm_s > 0.0 && arrives_braking(v0, left, exit_mm_s, block->accel_mm_s2, dt_s))
        return finish(motion, block, exit_mm_s, 2.0 * left / (v0 + exit_mm_s), finished);
    limit_mm_s = beside_corners(motion, block, limit_mm_s, dt_s);
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

/* ---- looking ahead ---- */

/* Time (s) of the trapezoid from v0 over at most `cruise` to `exit` that fills `left` mm. *exit becomes what can be reached
 * of it. */
static double trapezoid(double v0, double cruise, double *exit, double accel, double left)
{
    *exit = fmin(*exit, sqrt(v0 * v0 + 2.0 * accel * left));
    double reach = sqrt(fmax(0.0, 0.5 * (v0 * v0 + *exit * *exit) + accel * left));
    double peak = fmax(fmin(cruise, reach), 1e-3), down = fmax(0.0, peak - *exit);
    double squares = fabs(peak * peak - v0 * v0) + fmax(0.0, peak * peak - *exit * *exit);
    return (fabs(peak - v0) + down) / accel + fmax(0.0, left - 0.5 * squares / accel) / peak;
}

#define AHEAD_PIECES 16 /* the most that is looked through */

/* A move in up to three pieces: beside the corner before it, between, beside the corner after it. */
typedef struct {
    double length[3], cruise[3], exit[3];
} pieces_t;

static bool matters(const waam_slow_t *slow, double cruise)
{
    return slow->length_mm > 0.0f && (double)slow->speed_mm_s < cruise;
}

/* The piece in the middle takes what is left; a piece without length is none. */
static pieces_t pieces(const waam_block_t *block, double done, double cruise, double exit)
{
    double all = block->path.length_mm, first = 0.0, last = 0.0, slow = cruise;
    pieces_t p = {{0.0, all - done, 0.0}, {cruise, cruise, cruise}, {cruise, exit, exit}};
    if (matters(&block->first, cruise)) {
        first = fmax(0.0, fmin(all, (double)block->first.length_mm) - done);
        p.cruise[0] = (double)block->first.speed_mm_s;
    }
    if (matters(&block->last, cruise)) {
        last = fmin(all - done - first, (double)block->last.length_mm);
        p.cruise[2] = p.exit[1] = slow = (double)block->last.speed_mm_s;
    }
    p.length[0] = first, p.length[2] = last, p.length[1] = all - done - first - last;
    p.exit[0] = p.length[1] > 0.0 ? p.cruise[0] : last > 0.0 ? fmin(p.cruise[0], slow) : fmin(p.cruise[0], exit);
    return p;
}

const waam_block_t *waam_motion_ahead(const waam_motion_t *motion, const waam_planner_t *planner, double ahead_s)
{
    const waam_block_t *block = waam_planner_block(planner, 0);
    double v0 = motion->speed_mm_s, done = motion->done_mm;
    if (!block || block->kind != WAAM_BLOCK_MOVE)
        return block && block->kind == WAAM_BLOCK_DWELL ? block : NULL;
    for (size_t i = 0, looked = 0; looked < AHEAD_PIECES; i++) {
        pieces_t piece = pieces(block, done, waam_block_cruise(block, planner->override), waam_planner_exit(planner, i));
        for (int k = 0; k < 3; k++) {
            double exit = piece.exit[k];
            if (piece.length[k] <= 0.0)
                continue;
            looked++;
            ahead_s -= trapezoid(v0, piece.cruise[k], &exit, block->accel_mm_s2, piece.length[k]);
            if (ahead_s <= 0.0)
                return block;
            v0 = exit;
        }
        const waam_block_t *next = waam_planner_block(planner, i + 1);
        if (!next || (next->kind != WAAM_BLOCK_MOVE && next->kind != WAAM_BLOCK_DWELL))
            return block;
        block = next;
        if (block->kind == WAAM_BLOCK_DWELL)
            return block;
        done = 0.0;
    }
    return block;
}
