/* From a parsed command to blocks of the queue, with everything that can be refused. */
#include <math.h>

#include "waam_arcs.h"
#include "waam_internal.h"

#define SHORTEST_MM 5e-4 /* a move below this makes no block of its own but becomes part of the next */

/* ---- soft limits ---- */

static bool outside(const waam_core_t *core, int axis, double at_mm)
{
    double half_step = 0.5 / core->config.steps_per_mm[axis];
    return !(at_mm > core->config.limit_min_mm[axis] - half_step && at_mm < core->config.limit_max_mm[axis] + half_step);
}

/* The whole path, not only its end, stays inside the machine. */
static bool soft_limit(const waam_core_t *core, const waam_path_t *path, const size_t column[WAAM_AXES],
                       waam_error_t *error)
{
    for (int i = 0; i < WAAM_AXES; i++) {
        double low, high;
        waam_path_reach(path, i, &low, &high);
        if (!outside(core, i, low) && !outside(core, i, high))
            continue;
        bool on_the_way = !outside(core, i, path->end_mm[i]);
        waam_fail(error, WAAM_E_SOFT_LIMIT, column ? column[i] : 1, on_the_way ? "the arc reaches " : "");
        waam_text_char(&error->text, waam_axis_names[i]);
        waam_text_char(&error->text, ' ');
        waam_text_fixed(&error->text, !on_the_way ? path->end_mm[i] : outside(core, i, high) ? high : low, 3);
        waam_text_add(&error->text, " mm (machine) is outside ");
        waam_text_fixed(&error->text, core->config.limit_min_mm[i], 3);
        waam_text_add(&error->text, "..");
        waam_text_fixed(&error->text, core->config.limit_max_mm[i], 3);
        return false;
    }
    return true;
}

/* ---- blocks ---- */

static waam_block_t block_of(const waam_core_t *core, waam_block_kind_t kind, uint32_t line)
{
    return (waam_block_t){.kind = kind, .line = line, .wire_mm_s = core->modal.wire_mm_s,
                          .voltage_v = core->modal.voltage_v};
}

/* A line that needs no time is done together with what comes before it. */
static void attach(waam_core_t *core, uint32_t line)
{
    waam_block_t *tail = waam_planner_tail(&core->planner);
    if (!line)
        return;
    if (tail)
        tail->line = line;
    else
        waam_core_done(core, line);
}

static void push(waam_core_t *core, waam_block_kind_t kind, uint32_t line, double dwell_s)
{
    waam_block_t block = block_of(core, kind, line);
    block.dwell_s = dwell_s;
    waam_planner_push(&core->planner, &block, &core->kinematics);
}

/* Appends a block along `path`, which was found to be inside the machine. */
static void push_move(waam_core_t *core, waam_block_t *block)
{
    waam_block_complete(block, &core->kinematics);
    waam_planner_push(&core->planner, block, &core->kinematics);
    if (core->planner.count == 1 && waam_shaper_settled(&core->shaper))
        waam_planner_tail(&core->planner)->first = (waam_slow_t){.length_mm = 0.0f}; /* nothing before it is under way */
    for (int i = 0; i < WAAM_AXES; i++)
        core->plan_mm[i] = core->path_mm[i] = block->path.end_mm[i];
}

bool waam_core_plan_jog(waam_core_t *core, const double delta_mm[WAAM_AXES], double speed_mm_s, waam_error_t *error)
{
    waam_block_t block = block_of(core, WAAM_BLOCK_MOVE, 0);
    double target[WAAM_AXES];
    for (int i = 0; i < WAAM_AXES; i++) {
        target[i] = core->plan_mm[i] + delta_mm[i];
        if (fabs(target[i]) > 1e6)
            return waam_fail(error, WAAM_E_NUMBER, 1, "a coordinate is out of range");
    }
    block.jog = true;
    block.nominal_mm_s = speed_mm_s;
    block.path = waam_path_line(core->path_mm, target);
    if (core->plan_homed && !soft_limit(core, &block.path, NULL, error))
        return false;
    if (block.path.length_mm >= SHORTEST_MM)
        push_move(core, &block);
    return true;
}

/* ---- moves of the program ---- */

static bool path_of(const waam_core_t *core, const waam_command_t *command, waam_path_t *path, waam_error_t *error)
{
    double target[WAAM_AXES];
    for (int i = 0; i < WAAM_AXES; i++) {
        double base = command->modal.relative ? core->plan_mm[i] : core->work_mm[i];
        target[i] = command->has[i] ? base + command->axis_mm[i] : core->plan_mm[i];
        if (fabs(target[i]) > 1e6)
            return waam_fail(error, WAAM_E_NUMBER, command->axis_column[i], "a coordinate is out of range");
    }
    if (command->modal.motion >= WAAM_MOTION_ARC_CW)
        return waam_arc_path(core->plan_mm, target, command, path, error);
    *path = waam_path_line(core->path_mm, target);
    return true;
}

static bool plan_motion(waam_core_t *core, const waam_command_t *command, uint32_t line, waam_error_t *error)
{
    waam_block_t block = block_of(core, WAAM_BLOCK_MOVE, line);
    if (!core->plan_homed)
        return waam_fail(error, WAAM_E_NOT_HOMED, command->axis_column[0], "not homed: send G28 first");
    if (!path_of(core, command, &block.path, error) || !soft_limit(core, &block.path, command->axis_column, error))
        return false;
    if (block.path.length_mm < SHORTEST_MM) {
        for (int i = 0; i < WAAM_AXES; i++)
            core->plan_mm[i] = block.path.end_mm[i];
        attach(core, line);
        return true;
    }
    block.nominal_mm_s = command->modal.motion == WAAM_MOTION_RAPID ? core->config.rapid_mm_s : command->modal.feed_mm_s;
    push_move(core, &block);
    return true;
}

/* ---- actions ---- */

static bool plan_home(waam_core_t *core, const waam_command_t *command, uint32_t line, waam_error_t *error)
{
    const waam_config_t *c = &core->config;
    if (core->plan_arc)
        return waam_fail(error, WAAM_E_CONTRADICTION, command->action_column, "G28: end the arc first");
    push(core, WAAM_BLOCK_HOME, line, 0.0);
    for (int i = 0; i < WAAM_AXES; i++)
        core->plan_mm[i] = core->path_mm[i] = c->home_direction[i] < 0 ? c->limit_min_mm[i] : c->limit_max_mm[i];
    core->plan_homed = true;
    return true;
}

static bool plan_arc_start(waam_core_t *core, const waam_command_t *command, uint32_t line, waam_error_t *error)
{
    size_t column = command->action_column;
    if (!core->plan_homed)
        return waam_fail(error, WAAM_E_NOT_HOMED, column, "M3: not homed");
    if (!core->armed)
        return waam_fail(error, WAAM_E_NOT_ARMED, column, "M3: not armed for a job");
    if (core->inputs.process != WAAM_PROCESS_OK)
        return waam_fail(error, WAAM_E_INPUTS, column, "M3: no arc and wire measurements are connected");
    if (core->plan_arc)
        return waam_fail(error, WAAM_E_CONTRADICTION, column, "M3: the arc is on already");
    push(core, WAAM_BLOCK_ARC_START, line, 0.0);
    core->plan_arc = true;
    return true;
}

static bool plan_arc_end(waam_core_t *core, waam_block_kind_t kind, uint32_t line)
{
    if (core->plan_arc || kind == WAAM_BLOCK_FINISH)
        push(core, kind, line, 0.0);
    else
        attach(core, line);
    core->plan_arc = false;
    return true;
}

static bool plan(waam_core_t *core, const waam_command_t *command, uint32_t line, waam_error_t *error)
{
    switch (command->action) {
    case WAAM_DO_MOVE: return plan_motion(core, command, line, error);
    case WAAM_DO_HOME: return plan_home(core, command, line, error);
    case WAAM_DO_ARC_START: return plan_arc_start(core, command, line, error);
    case WAAM_DO_ARC_END: return plan_arc_end(core, WAAM_BLOCK_ARC_END, line);
    case WAAM_DO_FINISH: return plan_arc_end(core, WAAM_BLOCK_FINISH, line);
    case WAAM_DO_DWELL: push(core, WAAM_BLOCK_DWELL, line, command->dwell_s); return true;
    case WAAM_DO_GAS: return true; /* plan_gas */
    default: attach(core, line); return true;
    }
}

/* With the block that the line made; a line that made none gets one. */
static void plan_gas(waam_core_t *core, waam_gas_t gas, size_t blocks_before, uint32_t line)
{
    if (gas == WAAM_GAS_KEEP)
        return;
    if (core->planner.count == blocks_before)
        push(core, WAAM_BLOCK_GAS, line, 0.0);
    waam_planner_tail(&core->planner)->gas = gas;
}

/* Modal words take effect for the line that carries them, so they are in force before its block is made. */
bool waam_core_plan(waam_core_t *core, const waam_command_t *command, uint32_t line, waam_error_t *error)
{
    waam_modal_t before = core->modal;
    core->modal = command->modal;
    size_t blocks = core->planner.count;
    if (plan(core, command, line, error)) {
        plan_gas(core, command->gas, blocks, line);
        return true;
    }
    core->modal = before;
    return false;
}
