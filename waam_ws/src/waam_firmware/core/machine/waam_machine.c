/* The whole controller: its start and the tick that calls everything else. */
#include "waam_internal.h"

void waam_core_init(waam_core_t *core, const waam_config_t *config, waam_tx_t send_line, void *context)
{
    *core = (waam_core_t){.config = *config, .send = send_line, .context = context, .now_us = config->start_us};
    waam_core_rescale(core);
    waam_link_init(&core->link);
    waam_planner_init(&core->planner);
    core->wire_override = 1.0;
    if (waam_regulator_check(&config->regulator))
        core->config.regulator.actuator = WAAM_REGULATOR_OFF; /* a tuning that makes no sense is not used */
    if (waam_standoff_check(&config->standoff))
        core->config.standoff.source = WAAM_STANDOFF_OFF;
    waam_standoff_init(&core->standoff);
    core->shaper_tick_us = WAAM_TICK_US;
    if (waam_core_tune(core, &config->shaper)) {
        const waam_shaper_config_t none = {.axis = {{.type = WAAM_SHAPER_NONE}}, .corner_mm = config->shaper.corner_mm};
        waam_core_tune(core, &none);
    }
    waam_scheduler_start(&core->scheduler);
    core->arc.unchecked = true; /* the power may have gone with the wire in the pool */
    if (config->starts_in_alarm) {
        core->state = WAAM_ALARM;
        core->fault = config->watchdog_reset ? WAAM_E_WATCHDOG : WAAM_E_POWER_UP;
    }
    core->heard_us = core->now_us;
    core->telemetry_us = config->telemetry_us;
    core->telemetry_due_us = core->now_us + config->telemetry_us;
}

void waam_core_clock(waam_core_t *core, uint32_t since_tick_us) { core->since_tick_us = since_tick_us; }

/* ---- the tick ---- */

void waam_core_tick(waam_core_t *core, uint32_t dt_us, const waam_inputs_t *inputs, waam_outputs_t *outputs)
{
    core->now_us += dt_us;
    core->since_tick_us = 0;
    waam_guard_inputs(core, inputs, dt_us);
    waam_core_temperature_read(core);
    if (!core->replanned) /* both in one tick would make it the longest one */
        waam_core_take_lines(core);
    core->replanned = false;
    waam_guard_link(core);
    waam_guard_armed(core);
    waam_core_run(core, dt_us);
    waam_core_shape(core, dt_us);
    waam_core_track(core, dt_us);
    waam_guard_limit(core, dt_us);
    waam_guard_arc(core, dt_us);
    waam_guard_lease(core);
    for (int i = 0; i < WAAM_AXES; i++) {
        outputs->pulses[i] = waam_core_pulses(core, i);
        outputs->part[i] = core->part[i];
    }
    outputs->arc = waam_arc_output(&core->arc);
    outputs->gas = core->arc.gas;
    outputs->wire_mm_s = core->wire.speed_mm_s;
    outputs->drives = waam_guard_drives(core);
    outputs->sense = core->arc.phase == WAAM_ARC_SENSE;
    outputs->voltage_v = waam_guard_source(core);
    waam_guard_orders(core, dt_us);
    if (core->standoff_due)
        waam_core_standoff_telemetry(core);
    if (core->now_us >= core->telemetry_due_us) {
        core->telemetry_due_us += core->telemetry_us;
        waam_core_telemetry(core);
        if (core->telemetry_us > dt_us)
            return;
    }
    if (!waam_core_temperature_telemetry(core))
        waam_core_accelerations(core);
}

/* ---- the fast tick and the signs of life ---- */

void waam_core_fast(waam_core_t *core, const waam_fast_inputs_t *inputs, waam_fast_outputs_t *outputs)
{
    waam_fast_tick(&core->fast, &core->config, inputs, outputs);
}

void waam_core_linked(waam_core_t *core) { core->fast.linked = true; }

bool waam_core_alive(waam_core_t *core)
{
    waam_fast_t *fast = &core->fast;
    if (!fast->ticked || !fast->fasted || !fast->linked)
        return false;
    fast->ticked = fast->fasted = fast->linked = false;
    return true;
}
