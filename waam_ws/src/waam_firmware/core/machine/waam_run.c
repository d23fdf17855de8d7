/* Execution of the queue: moves, dwells, homing, arc start and end; hold and stop. */
#include <math.h>

#include "waam_internal.h"

static void set_gas(waam_core_t *core, waam_gas_t gas)
{
    if (gas != WAAM_GAS_KEEP)
        core->arc.gas_asked = gas == WAAM_GAS_ON;
}

/* Homing finds out where the axes are, so until then their count may begin anywhere: half way of 32 bits is never left. */
static void start_homing(waam_core_t *core)
{
    waam_core_absorb(core);
    for (int i = 0; i < WAAM_AXES; i++)
        if (core->motion.steps[i] > INT32_MAX / 2 || core->motion.steps[i] < -INT32_MAX / 2)
            waam_motion_declare(&core->motion, i, 0);
    core->homed = false;
    waam_home_start(&core->home);
}

static void start_block(waam_core_t *core, const waam_block_t *block)
{
    core->block_started = true;
    core->dwell_us = 0;
    core->arc.wire_mm_s = block->wire_mm_s;
    core->arc.voltage_v = block->voltage_v;
    if (block->kind != WAAM_BLOCK_ARC_END)
        set_gas(core, block->gas);
    switch (block->kind) {
    case WAAM_BLOCK_HOME: start_homing(core); break;
    case WAAM_BLOCK_ARC_END: waam_arc_end(&core->arc, false, &core->config.arc); break;
    case WAAM_BLOCK_FINISH:
        core->arc.gas_asked = false;
        waam_arc_end(&core->arc, false, &core->config.arc);
        break;
    default: break;
    }
}

static void finish_block(waam_core_t *core, const waam_block_t *block)
{
    if (block->kind == WAAM_BLOCK_ARC_END)
        set_gas(core, block->gas);
    if (block->line)
        waam_core_done(core, block->line);
    core->jogged = block->jog;
    waam_planner_pop(&core->planner);
    core->block_started = false;
}

static bool may_strike(waam_core_t *core)
{
    if (!core->armed)
        waam_core_hold(core, WAAM_E_NOT_ARMED, "not armed", false);
    else if (!core->homed)
        waam_core_hold(core, WAAM_E_NOT_HOMED, "not homed", false);
    else if (core->inputs.limit_switch)
        waam_core_alarm(core, WAAM_E_LIMIT_SWITCH, "limit switch");
    else if (waam_core_too_hot(core))
        waam_core_fault(core, WAAM_FAULT_OVER_TEMPERATURE, NULL);
    else
        return true;
    return false;
}

/* Switches the arc on; true when it burns. */
static bool arc_burns(waam_core_t *core)
{
    if (core->arc.phase == WAAM_ARC_OFF && may_strike(core) && waam_core_at_distance(core))
        waam_arc_start(&core->arc);
    return core->arc.phase == WAAM_ARC_BURNING;
}

static bool home_step(waam_core_t *core, bool hold, double dt_s)
{
    waam_home_result_t result = waam_home_tick(&core->home, &core->motion, core->inputs.home_switch, hold,
                                               &core->config, dt_s);
    if (result == WAAM_HOME_FAILED) {
        waam_text_t text = {.length = 0};
        waam_text_char(&text, waam_axis_names[waam_home_axis(&core->home)]);
        waam_text_add(&text, ": home switch not found");
        text.text[text.length] = '\0';
        waam_core_alarm(core, WAAM_E_NOT_HOMED, text.text);
    }
    core->homed = core->homed || result == WAAM_HOME_DONE;
    return result == WAAM_HOME_DONE;
}

/* Along the block, to be shaped. */
static double advance(waam_core_t *core, const waam_block_t *block, double limit_mm_s, double dt_s, bool *done)
{
    waam_shaper_wake(&core->shaper);
    return waam_motion_advance(&core->motion, block, limit_mm_s, waam_planner_exit(&core->planner, 0), dt_s, done);
}

/* Works on the head block for at most dt; returns the time used and whether the block is done. */
static double work(waam_core_t *core, const waam_block_t *block, double dt_s, bool *done)
{
    *done = true;
    switch (block->kind) {
    case WAAM_BLOCK_MOVE:
        return advance(core, block, waam_block_cruise(block, core->planner.override), dt_s, done);
    case WAAM_BLOCK_DWELL: {
        double left = block->dwell_s - (double)core->dwell_us * 1e-6;
        *done = left <= dt_s;
        core->dwell_us += (uint64_t)(dt_s * 1e6 + 0.5);
        return *done ? fmax(0.0, left) : dt_s;
    }
    case WAAM_BLOCK_HOME: *done = home_step(core, false, dt_s); return dt_s;
    case WAAM_BLOCK_ARC_START: core->arc_wanted = *done = arc_burns(core); return dt_s;
    case WAAM_BLOCK_ARC_END:
    case WAAM_BLOCK_FINISH:
        *done = core->arc.phase == WAAM_ARC_OFF;
        core->arc_wanted = core->arc_wanted && !*done;
        return *done ? 0.0 : dt_s;
    default: return 0.0;
    }
}

static bool needs_arc(const waam_core_t *core, const waam_block_t *block)
{
    return core->arc_wanted && block->kind != WAAM_BLOCK_ARC_END && block->kind != WAAM_BLOCK_FINISH;
}

/* No move with a wire that may be frozen in the bead. True: wait. */
static bool wire_check(waam_core_t *core, const waam_block_t *block)
{
    bool moves = block->kind == WAAM_BLOCK_MOVE || block->kind == WAAM_BLOCK_HOME;
    if (!moves || core->arc_wanted || !core->arc.unchecked || core->motion.speed_mm_s > 0.0)
        return false;
    waam_arc_check(&core->arc);
    return true;
}

static void run_queue(waam_core_t *core, double dt_s)
{
    waam_block_t *block;
    while (dt_s > 1e-9 && core->state == WAAM_RUN && (block = waam_planner_head(&core->planner)) != NULL) {
        bool done = false;
        if (!core->block_started && block->kind != WAAM_BLOCK_MOVE && !waam_shaper_settled(&core->shaper))
            return; /* the motion before it is not at its end yet */
        if (needs_arc(core, block) && !arc_burns(core))
            return; /* after a hold: strikes again before motion goes on */
        if (!core->block_started && wire_check(core, block))
            return;
        if (!core->block_started)
            start_block(core, block);
        dt_s -= work(core, block, dt_s, &done);
        if (!done)
            return;
        finish_block(core, block);
    }
}

/* Running dry with the arc on. */
static void check_underrun(waam_core_t *core, uint32_t dt_us)
{
    bool dry = core->state == WAAM_RUN && core->planner.count == 0 && core->arc_wanted &&
               waam_shaper_settled(&core->shaper);
    core->dry_us = dry ? core->dry_us + dt_us : 0;
    if (core->dry_us <= core->config.underrun_grace_us)
        return;
    core->dry_us = 0;
    core->underruns++;
    waam_core_hold(core, WAAM_E_UNDERRUN, "the queue ran dry with the arc on", false);
}

static void slow_down(waam_core_t *core, double dt_s)
{
    waam_block_t *block;
    if (core->home.active)
        home_step(core, true, dt_s);
    while (dt_s > 1e-9 && core->motion.speed_mm_s > 0.0 && (block = waam_planner_head(&core->planner)) != NULL) {
        bool done = false;
        if (!core->block_started)
            start_block(core, block);
        dt_s -= advance(core, block, 0.0, dt_s, &done);
        if (done)
            finish_block(core, block);
    }
}

static void tick_hold(waam_core_t *core, double dt_s)
{
    slow_down(core, dt_s);
    if (!core->resume_asked || !waam_core_stands(core) || core->arc.phase != WAAM_ARC_OFF)
        return;
    core->resume_asked = false;
    waam_core_state(core, WAAM_RUN, WAAM_OK, "resumed");
}

static void tick_stopping(waam_core_t *core, double dt_s)
{
    slow_down(core, dt_s);
    waam_core_finish_stopping(core);
}

static void tick_running(waam_core_t *core, uint32_t dt_us)
{
    if (core->state == WAAM_IDLE && core->planner.count > 0) {
        waam_wire_stop_jog(&core->wire);
        waam_core_state(core, WAAM_RUN, WAAM_OK, "running");
    }
    if (core->retrying) {
        slow_down(core, dt_us * 1e-6);
        core->retrying = !waam_core_stands(core) || core->arc.phase != WAAM_ARC_OFF;
        return;
    }
    run_queue(core, dt_us * 1e-6);
    check_underrun(core, dt_us);
    if (core->state == WAAM_RUN && core->planner.count == 0 && !core->arc_wanted &&
        waam_shaper_settled(&core->shaper) && waam_core_back_on_path(core))
        waam_core_state(core, WAAM_IDLE, WAAM_OK, "the queue is empty");
}

void waam_core_run(waam_core_t *core, uint32_t dt_us)
{
    if (core->stopping)
        tick_stopping(core, dt_us * 1e-6);
    else if (core->state == WAAM_HOLD)
        tick_hold(core, dt_us * 1e-6);
    else if (core->state != WAAM_ALARM)
        tick_running(core, dt_us);
    waam_core_follow(core);
}
