/* Invariants of planner, interpolator and motion on random paths of lines and arcs: exact steps, arcs on their circle,
 * bounded speed and acceleration of every axis, rest at the end, a look ahead that comes true.
 * Each path is executed in ticks of 1 ms with the override changing at random; a failed property prints the path's number. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "waam_arcs.h"
#include "waam_core.h"

#define DT 1e-3
#define AHEAD 30
#define SLACK 4 /* ticks by which what was predicted may come later: only ticks quantise it */

static uint64_t seed;

static double uniform(double low, double high) /* SplitMix64 */
{
    uint64_t z = (seed += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return low + (high - low) * (double)((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

static void require(bool condition, const char *what, uint64_t path, double got, double limit)
{
    if (condition)
        return;
    fprintf(stderr, "path %llu: %s: %.9g, limit %.9g\n", (unsigned long long)path, what, got, limit);
    exit(1);
}

typedef struct {
    waam_planner_t planner;
    waam_kinematics_t kinematics;
    waam_motion_t motion;
    double at_mm[WAAM_AXES], velocity[WAAM_AXES];
    double scale_mm, turn, arcs;
    bool steady;                 /* the override stays: what was looked ahead must come true */
    uint32_t blocks;             /* so many were pushed; each has its number as its line */
    uint32_t ahead[AHEAD], ran[SLACK]; /* lines predicted for the ticks to come, and those of the last ticks */
} path_t;

/* A line in about the old direction (turn small) or any direction (turn large). */
static waam_path_t random_line(path_t *p, double direction[WAAM_AXES])
{
    double end[WAAM_AXES], length = p->scale_mm * uniform(0.2, 1.8);
    for (int i = 0; i < WAAM_AXES; i++) {
        direction[i] = (1.0 - p->turn) * direction[i] + p->turn * uniform(-1.0, 1.0);
        end[i] = p->at_mm[i] + direction[i] * length;
    }
    return waam_path_line(p->at_mm, end);
}

/* An arc or helix of any sweep, through the same code as G2 and G3. */
static waam_path_t random_arc(path_t *p, uint64_t number)
{
    waam_command_t command = {.action = WAAM_DO_MOVE};
    double radius = p->scale_mm * uniform(0.1, 3.0), angle = uniform(-WAAM_PI, WAAM_PI), sweep = uniform(-6.28, 6.28);
    double end[WAAM_AXES];
    waam_path_t path;
    waam_error_t error;
    command.modal.motion = sweep < 0.0 ? WAAM_MOTION_ARC_CW : WAAM_MOTION_ARC_CCW;
    command.centre_mm[0] = -radius * cos(angle);
    command.centre_mm[1] = -radius * sin(angle);
    end[0] = p->at_mm[0] + radius * (cos(angle + sweep) - cos(angle));
    end[1] = p->at_mm[1] + radius * (sin(angle + sweep) - sin(angle));
    end[2] = p->at_mm[2] + (uniform(0.0, 1.0) < 0.5 ? 0.0 : p->scale_mm * uniform(-1.0, 1.0));
    bool good = waam_arc_path(p->at_mm, end, &command, &path, &error);
    require(good || radius < 2e-3, "a good arc is refused", number, radius, 0.0);
    if (good && 2.0 * radius * fabs(sin(0.5 * sweep)) > 1e-4) /* below, it is a full circle */
        require(fabs(path.sweep - sweep) < 1e-6 / radius + 1e-9, "sweep", number, path.sweep, sweep);
    return good ? path : waam_path_line(p->at_mm, end);
}

static void append(path_t *p, double direction[WAAM_AXES], uint64_t number)
{
    waam_block_t block = {.kind = WAAM_BLOCK_MOVE, .nominal_mm_s = uniform(1.0, 60.0)};
    block.path = uniform(0.0, 1.0) < p->arcs ? random_arc(p, number) : random_line(p, direction);
    if (block.path.length_mm < 5e-4)
        return;
    block.line = ++p->blocks;
    waam_block_complete(&block, &p->kinematics);
    waam_planner_push(&p->planner, &block, &p->kinematics);
    for (int i = 0; i < WAAM_AXES; i++)
        p->at_mm[i] = block.path.end_mm[i];
}

static void check_plan(path_t *p, uint64_t number)
{
    for (size_t i = 1; i < p->planner.count; i++) {
        const waam_block_t *b = waam_planner_block(&p->planner, i);
        double exit = waam_planner_exit(&p->planner, i);
        double slowest = b->entry_mm_s * b->entry_mm_s - 2.0 * b->accel_mm_s2 * b->path.length_mm;
        require(slowest <= exit * exit + 1e-6, "exit cannot be reached by braking", number, slowest, exit * exit);
        require(b->entry_mm_s <= b->junction_mm_s, "corner too fast", number, b->entry_mm_s, b->junction_mm_s);
        require(b->entry_mm_s <= waam_block_cruise(b, p->planner.override) + 1e-9, "entry above cruise", number,
                b->entry_mm_s, waam_block_cruise(b, p->planner.override));
    }
}

/* Steps are whole, so the machine may stand half a step off in each of the two axes. */
static void check_circle(const path_t *p, const waam_block_t *block, uint64_t number)
{
    if (!block->path.arc)
        return;
    double half_mm[2], at[2];
    for (int i = 0; i < 2; i++) {
        half_mm[i] = 0.5 / p->motion.steps_per_mm[i];
        at[i] = (double)p->motion.steps[i] / p->motion.steps_per_mm[i] - block->path.centre_mm[i];
    }
    double off = fabs(hypot(at[0], at[1]) - block->path.radius_mm), most = hypot(half_mm[0], half_mm[1]);
    require(off <= most + 1e-8, "distance from the circle (mm)", number, off, most);
}

/* Within a block no axis changes its speed faster than allowed; 2 % is what braking onto the end of a block may add.
 * At a corner the direction changes at once; junction deviation bounds the jump: with v^2 = a d s / (1 - s) and a turn
 * whose half has the cosine s, |dv|^2 = 4 v^2 (1 - s^2) = 4 a d s (1 + s) <= 8 a d. */
static void check_axes(path_t *p, const waam_block_t *block, double speed, double jumps, uint64_t number)
{
    double unit[WAAM_AXES];
    waam_path_direction(&block->path, speed > 0.0 ? p->motion.done_mm / block->path.length_mm : 1.0, unit);
    for (int i = 0; i < WAAM_AXES; i++) {
        double velocity = unit[i] * speed, most = p->kinematics.max_speed_mm_s[i];
        double change = fabs(velocity - p->velocity[i]), limit = 1.02 * p->kinematics.accel_mm_s2[i] * DT + 1e-3 + jumps;
        require(fabs(velocity) <= most + 1e-6, "axis speed", number, velocity, most);
        require(change <= limit, "axis acceleration (mm/s per ms)", number, change, limit);
        p->velocity[i] = velocity;
    }
}

/* The block that was predicted 30 ms ago is the one that runs now, or ran a moment ago. */
static void check_ahead(path_t *p, int tick, uint64_t number)
{
    const waam_block_t *head = waam_planner_block(&p->planner, 0);
    const waam_block_t *ahead = waam_motion_ahead(&p->motion, &p->planner, AHEAD * DT);
    uint32_t now = head ? head->line : p->blocks, before = p->ran[tick % SLACK], told = p->ahead[tick % AHEAD];
    if (p->steady && tick >= AHEAD && told)
        require(told >= before && told <= now + 1, "predicted block", number, told, now);
    p->ahead[tick % AHEAD] = ahead && ahead->line < now + 15 ? ahead->line : 0; /* 16 blocks are looked through */
    p->ran[tick % SLACK] = now;
}

static void tick(path_t *p, uint64_t number)
{
    double dt = DT, jumps = 0.0;
    waam_block_t copy = {.kind = WAAM_BLOCK_DWELL}, *block;
    while (dt > 1e-9 && (block = waam_planner_head(&p->planner)) != NULL) {
        bool done = false;
        copy = *block;
        dt -= waam_motion_advance(&p->motion, block, waam_block_cruise(block, p->planner.override),
                                  waam_planner_exit(&p->planner, 0), dt, &done);
        if (!done)
            break;
        for (int i = 0; i < WAAM_AXES; i++)
            require(p->motion.steps[i] == copy.end[i], "steps of a block", number, p->motion.steps[i], copy.end[i]);
        waam_planner_pop(&p->planner);
        jumps += sqrt(8.0 * copy.accel_mm_s2 * p->kinematics.junction_deviation_mm);
    }
    if (copy.kind != WAAM_BLOCK_MOVE)
        return;
    if (p->motion.done_mm > 0.0)
        check_circle(p, &copy, number);
    check_axes(p, &copy, p->motion.speed_mm_s, jumps, number);
}

static void start(path_t *p, uint64_t number)
{
    waam_config_t config = waam_config_default();
    seed = number * 1000003u;
    for (int i = 0; i < WAAM_AXES && number % 4; i++)
        config.steps_per_mm[i] = round(exp(uniform(log(10.0), log(2000.0))) * 1e3) / 1e3;
    for (int i = 0; i < WAAM_SHAPED_AXES && number % 5 < 2; i++)
        config.accel_mm_s2[i] = uniform(50.0, 500.0);
    *p = (path_t){.kinematics = waam_kinematics(&config),
                  .scale_mm = exp(uniform(log(0.01), log(30.0))), .turn = uniform(0.0, 1.0),
                  .arcs = number % 3 ? uniform(0.0, 1.0) : 0.0, .steady = number % 2};
    memcpy(p->motion.steps_per_mm, config.steps_per_mm, sizeof config.steps_per_mm);
    waam_planner_init(&p->planner);
}

static void run_path(uint64_t number)
{
    static path_t p;
    double direction[WAAM_AXES] = {1.0, 0.0, 0.0};
    start(&p, number);
    int left = 150;
    for (int ticks = 0; left > 0 || p.planner.count; ticks++) {
        while (left > 0 && waam_planner_free(&p.planner) > 0 && (p.steady || uniform(0.0, 1.0) < 0.95)) {
            append(&p, direction, number);
            left--;
        }
        if (!p.steady && uniform(0.0, 1.0) < 0.01)
            waam_planner_set_override(&p.planner, uniform(0.1, 2.0));
        if (ticks % 8 == 0)
            check_plan(&p, number);
        check_ahead(&p, ticks, number);
        tick(&p, number);
        require(ticks < 10000000, "the path does not end", number, ticks, 1e7);
    }
    require(p.motion.speed_mm_s == 0.0, "speed at the end", number, p.motion.speed_mm_s, 0.0);
    for (int i = 0; i < WAAM_AXES; i++)
        require(p.motion.steps[i] == lround(p.at_mm[i] * p.kinematics.steps_per_mm[i]), "position at the end", number,
                p.motion.steps[i], p.at_mm[i] * p.kinematics.steps_per_mm[i]);
}

int main(int argc, char **argv)
{
    uint64_t paths = argc > 1 ? strtoull(argv[1], NULL, 10) : 50;
    for (uint64_t number = 1; number <= paths; number++)
        run_path(number);
    printf("%llu random paths: exact steps, arcs on their circle, bounded speed and acceleration\n", (unsigned long long)paths);
    return 0;
}
