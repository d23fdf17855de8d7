/* Invariants of planner and motion on random paths: exact steps, bounded acceleration and speed, rest at the end.
 * Each path is executed in ticks of 1 ms with the override changing at random; a failed property prints the seed. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "waam_core.h"

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

static waam_kinematics_t kinematics(void)
{
    waam_config_t c = waam_config_default();
    waam_kinematics_t k = {.steps_per_mm = c.steps_per_mm, .junction_deviation_mm = c.junction_deviation_mm};
    for (int i = 0; i < WAAM_AXES; i++) {
        k.max_speed_mm_s[i] = c.max_speed_mm_s[i];
        k.accel_mm_s2[i] = c.accel_mm_s2[i];
    }
    return k;
}

typedef struct {
    waam_planner_t planner;
    waam_kinematics_t kinematics;
    waam_motion_t motion;
    double at_mm[WAAM_AXES];
    int32_t at_steps[WAAM_AXES];
    double scale_mm, turn;
} path_t;

/* Appends a move in about the old direction (turn small) or any direction (turn large). */
static void append(path_t *p, double direction[WAAM_AXES])
{
    waam_block_t block = {.kind = WAAM_BLOCK_MOVE, .nominal_mm_s = uniform(1.0, 60.0)};
    double delta[WAAM_AXES], length = p->scale_mm * uniform(0.2, 1.8);
    bool moves = false;
    for (int i = 0; i < WAAM_AXES; i++) {
        direction[i] = (1.0 - p->turn) * direction[i] + p->turn * uniform(-1.0, 1.0);
        delta[i] = direction[i] * length;
        block.start[i] = p->at_steps[i];
        block.end[i] = (int32_t)lround((p->at_mm[i] + delta[i]) * p->kinematics.steps_per_mm);
        moves = moves || block.end[i] != block.start[i];
    }
    if (!moves)
        return;
    waam_block_geometry(&block, delta, &p->kinematics);
    waam_planner_push(&p->planner, &block, &p->kinematics);
    for (int i = 0; i < WAAM_AXES; i++) {
        p->at_mm[i] += delta[i];
        p->at_steps[i] = block.end[i];
    }
}

static void check_plan(path_t *p, uint64_t number)
{
    for (size_t i = 1; i < p->planner.count; i++) {
        const waam_block_t *b = &p->planner.block[(p->planner.head + i) % WAAM_BLOCKS];
        bool last = i + 1 == p->planner.count;
        double exit = last ? 0.0 : p->planner.block[(p->planner.head + i + 1) % WAAM_BLOCKS].entry_mm_s;
        double slowest = b->entry_mm_s * b->entry_mm_s - 2.0 * b->accel_mm_s2 * b->length_mm;
        require(slowest <= exit * exit + 1e-6, "exit cannot be reached by braking", number, slowest, exit * exit);
        require(b->entry_mm_s <= b->junction_mm_s, "corner too fast", number, b->entry_mm_s, b->junction_mm_s);
        require(b->entry_mm_s <= waam_block_cruise(b, p->planner.override) + 1e-9, "entry above cruise", number,
                b->entry_mm_s, waam_block_cruise(b, p->planner.override));
    }
}

static void tick(path_t *p, uint64_t number)
{
    double dt = 1e-3, before = p->motion.speed_mm_s, accel = 0.0;
    int32_t from[WAAM_AXES];
    for (int i = 0; i < WAAM_AXES; i++)
        from[i] = p->motion.steps[i];
    waam_block_t *block;
    while (dt > 1e-9 && (block = waam_planner_head(&p->planner)) != NULL) {
        bool done = false;
        waam_block_t copy = *block;
        accel = fmax(accel, copy.accel_mm_s2);
        dt -= waam_motion_advance(&p->motion, block, waam_block_cruise(block, p->planner.override),
                                  waam_planner_exit(&p->planner), dt, &done);
        if (!done)
            break;
        for (int i = 0; i < WAAM_AXES; i++)
            require(p->motion.steps[i] == copy.end[i], "steps of a block", number, p->motion.steps[i], copy.end[i]);
        waam_planner_pop(&p->planner);
    }
    double change = fabs(p->motion.speed_mm_s - before);
    require(change <= accel * 1e-3 * 1.02 + 1e-3, "acceleration (mm/s per ms)", number, change, accel * 1e-3);
    for (int i = 0; i < WAAM_AXES; i++) {
        double speed = abs(p->motion.steps[i] - from[i]) / (p->kinematics.steps_per_mm * 1e-3);
        require(speed <= p->kinematics.max_speed_mm_s[i] + 2e3 / p->kinematics.steps_per_mm, "axis speed", number, speed,
                p->kinematics.max_speed_mm_s[i]);
    }
}

static void run_path(uint64_t number)
{
    static path_t p;
    double direction[WAAM_AXES] = {1.0, 0.0, 0.0};
    seed = number * 1000003u;
    p = (path_t){.kinematics = kinematics(), .scale_mm = exp(uniform(log(0.01), log(30.0))), .turn = uniform(0.0, 1.0)};
    waam_planner_init(&p.planner);
    for (int left = 200, ticks = 0; left > 0 || p.planner.count; ticks++) {
        while (left > 0 && waam_planner_free(&p.planner) > 0 && uniform(0.0, 1.0) < 0.95) {
            append(&p, direction);
            left--;
        }
        if (uniform(0.0, 1.0) < 0.01)
            waam_planner_set_override(&p.planner, uniform(0.1, 2.0));
        check_plan(&p, number);
        tick(&p, number);
        require(ticks < 10000000, "the path does not end", number, ticks, 1e7);
    }
    require(p.motion.speed_mm_s == 0.0, "speed at the end", number, p.motion.speed_mm_s, 0.0);
    for (int i = 0; i < WAAM_AXES; i++)
        require(p.motion.steps[i] == lround(p.at_mm[i] * p.kinematics.steps_per_mm), "position at the end", number,
                p.motion.steps[i], p.at_mm[i] * p.kinematics.steps_per_mm);
}

int main(void)
{
    for (uint64_t number = 1; number <= 60; number++)
        run_path(number);
    printf("60 random paths: exact steps, bounded acceleration and speed\n");
    return 0;
}
