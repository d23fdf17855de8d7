/* From a parsed command to blocks of the queue, with everything that can be refused. */
#include <math.h>

#include "waam_internal.h"

static bool soft_limit(const waam_core_t *core, const double target_mm[WAAM_AXES], waam_error_t *error)
{
    const waam_config_t *c = &core->config;
    double half_step = 0.5 / c->steps_per_mm;
    for (int i = 0; i < WAAM_AXES; i++) {
        double low = c->limit_min_mm[i], high = c->limit_max_mm[i], at = target_mm[i];
        if (at > low - half_step && at < high + half_step)
            continue;
        waam_fail(error, WAAM_E_SOFT_LIMIT, 1, "");
        waam_text_char(&error->text, waam_axis_names[i]);
        waam_text_char(&error->text, ' ');
        waam_text_fixed(&error->text, at, 3);
        waam_text_add(&error->text, " mm (machine) is outside ");
        waam_text_fixed(&error->text, low, 3);
        waam_text_add(&error->text, "..");
        waam_text_fixed(&error->text, high, 3);
        return false;
    }
    return true;
}

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
        core->executed = line;
}

bool waam_core_plan_move(waam_core_t *core, const double target_mm[WAAM_AXES], double speed_mm_s, uint32_t line,
                         bool jog, waam_error_t *error)
{
    waam_block_t block = block_of(core, WAAM_BLOCK_MOVE, line);
    double delta[WAAM_AXES];
    bool moves = false;
    for (int i = 0; i < WAAM_AXES; i++) {
        if (fabs(target_mm[i]) > 1e6)
            return waam_fail(error, WAAM_E_NUMBER, 1, "a coordinate is out of range");
        block.start[i] = core->plan_steps[i];
        block.end[i] = (int32_t)lround(target_mm[i] * core->config.steps_per_mm);
        delta[i] = target_mm[i] - core->plan_mm[i];
        moves = moves || block.end[i] != block.start[i];
    }
    if (core->plan_homed && !soft_limit(core, target_mm, error))
        return false;
    if (!moves) {
        attach(core, line);
        return true;
    }
    block.jog = jog;
    block.nominal_mm_s = speed_mm_s;
    waam_block_geometry(&block, delta, &core->kinematics);
    waam_planner_push(&core->planner, &block, &core->kinematics);
    for (int i = 0; i < WAAM_AXES; i++) {
        core->plan_mm[i] = target_mm[i];
        core->plan_steps[i] = block.end[i];
    }
    return true;
}

static bool plan_motion(waam_core_t *core, const waam_command_t *command, uint32_t line, waam_error_t *error)
{
    double target[WAAM_AXES];
    bool rapid = command->modal.motion == WAAM_MOTION_RAPID;
    if (!core->plan_homed)
        return waam_fail(error, WAAM_E_NOT_HOMED, 1, "not homed: send G28 first");
    for (int i = 0; i < WAAM_AXES; i++) {
        double shift = command->machine_frame ? 0.0 : core->work_mm[i] + core->g92_mm[i];
        if (!command->has[i])
            target[i] = core->plan_mm[i];
        else
            target[i] = command->axis_mm[i] + (command->modal.relative ? core->plan_mm[i] : shift);
    }
    return waam_core_plan_move(core, target, rapid ? core->config.rapid_mm_s : command->modal.feed_mm_s, line, false,
                               error);
}

static bool plan_arc_start(const waam_core_t *core, waam_error_t *error)
{
    if (!core->plan_homed)
        return waam_fail(error, WAAM_E_NOT_HOMED, 1, "M3: not homed");
    if (!core->armed)
        return waam_fail(error, WAAM_E_NOT_ARMED, 1, "M3: not armed for a job");
    if (core->inputs.process != WAAM_PROCESS_OK)
        return waam_fail(error, WAAM_E_INPUTS, 1, "M3: no arc and wire measurements are connected");
    return core->plan_arc ? waam_fail(error, WAAM_E_CONTRADICTION, 1, "M3: the arc is on already") : true;
}

static void push(waam_core_t *core, waam_block_kind_t kind, uint32_t line, double dwell_s)
{
    waam_block_t block = block_of(core, kind, line);
    block.dwell_s = dwell_s;
    waam_planner_push(&core->planner, &block, &core->kinematics);
}

static void set_position(waam_core_t *core, const waam_command_t *command, uint32_t line)
{
    for (int i = 0; i < WAAM_AXES; i++)
        if (command->has[i])
            core->g92_mm[i] = core->plan_mm[i] - core->work_mm[i] - command->axis_mm[i];
    attach(core, line);
}

static bool plan_home(waam_core_t *core, uint32_t line, waam_error_t *error)
{
    const waam_config_t *c = &core->config;
    if (core->plan_arc)
        return waam_fail(error, WAAM_E_CONTRADICTION, 1, "G28: end the arc first");
    push(core, WAAM_BLOCK_HOME, line, 0.0);
    for (int i = 0; i < WAAM_AXES; i++) {
        core->plan_mm[i] = c->home_direction[i] < 0 ? c->limit_min_mm[i] : c->limit_max_mm[i];
        core->plan_steps[i] = (int32_t)lround(core->plan_mm[i] * c->steps_per_mm);
    }
    core->plan_homed = true;
    return true;
}

static void plan_arc_end(waam_core_t *core, waam_block_kind_t kind, uint32_t line)
{
    if (core->plan_arc || kind == WAAM_BLOCK_FINISH)
        push(core, kind, line, 0.0);
    else
        attach(core, line);
    core->plan_arc = false;
}

/* Modal words take effect for the line that carries them, so they are in force before its block is made. */
bool waam_core_plan(waam_core_t *core, const waam_command_t *command, uint32_t line, waam_error_t *error)
{
    waam_modal_t before = core->modal;
    core->modal = command->modal;
    bool good = true;
    switch (command->action) {
    case WAAM_DO_NOTHING: attach(core, line); break;
    case WAAM_DO_MOVE: good = plan_motion(core, command, line, error); break;
    case WAAM_DO_DWELL: push(core, WAAM_BLOCK_DWELL, line, command->dwell_s); break;
    case WAAM_DO_HOME: good = plan_home(core, line, error); break;
    case WAAM_DO_SET_POSITION: set_position(core, command, line); break;
    case WAAM_DO_ARC_START:
        good = plan_arc_start(core, error);
        if (good) {
            push(core, WAAM_BLOCK_ARC_START, line, 0.0);
            core->plan_arc = true;
        }
        break;
    case WAAM_DO_ARC_END: plan_arc_end(core, WAAM_BLOCK_ARC_END, line); break;
    case WAAM_DO_FINISH: plan_arc_end(core, WAAM_BLOCK_FINISH, line); break;
    case WAAM_DO_GAS_ON: push(core, WAAM_BLOCK_GAS_ON, line, 0.0); break;
    case WAAM_DO_GAS_OFF: push(core, WAAM_BLOCK_GAS_OFF, line, 0.0); break;
    case WAAM_DO_PAUSE: push(core, WAAM_BLOCK_PAUSE, line, 0.0); break;
    }
    if (!good)
        core->modal = before;
    return good;
}
