/* The arc regulator as a shared library: a burning arc around the real fast tick and the real scheduler, without motion
 * and link. Whoever calls it brings the plant (tests, bench_arc). One loop at a time. */
#include "waam_internal.h"

#define FAST_PER_TICK 10

static waam_core_t core;
static unsigned count;
static float output;

static void nothing(void *context, const char *line, size_t bytes, waam_tx_kind_t kind)
{
    (void)context, (void)line, (void)bytes, (void)kind;
}

/* The shipped configuration; `scheduling` and `predictor` may be switched off. Gains kp, ki, kd, filter_s above 0 in kp
 * replace the fixed ones, a trim above 0 the shipped one. Returns null or what is wrong with it. */
const char *arc_loop_start(bool scheduling, bool predictor, const float gains[4], float trim);
/* One sample of 100 us: arc voltage, current, wire speed in; source setpoint out. */
float arc_loop_step(float setpoint_v, float voltage_v, float current_a, float wire_mm_s);
/* Coefficients in force: p, i, d, smooth, weight, plant gain, predictor (0 or 1), lag in s, delay in s. */
void arc_loop_tuning(float values[9]);

const char *arc_loop_start(bool scheduling, bool predictor, const float gains[4], float trim)
{
    waam_config_t config = waam_config_default();
    config.regulator.scheduling = scheduling;
    config.regulator.predictor = predictor;
    if (trim > 0.0f)
        config.regulator.trim = trim;
    config.monitor.stuck_us = 0;
    if (gains[0] > 0.0f)
        config.regulator.fixed = (waam_pid_gains_t){gains[0], gains[1], gains[2], gains[3], 1.0f};
    waam_core_init(&core, &config, nothing, NULL);
    core.inputs.process = WAAM_PROCESS_OK;
    core.arc.phase = WAAM_ARC_BURNING;
    count = 0;
    output = 0.0f;
    return waam_regulator_check(&config.regulator);
}

float arc_loop_step(float setpoint_v, float voltage_v, float current_a, float wire_mm_s)
{
    const waam_fast_inputs_t in = {true, voltage_v, current_a};
    waam_fast_outputs_t out;
    if (count++ % FAST_PER_TICK == 0) {
        float mean_v, mean_a;
        if (waam_fast_mean(&core.fast, &mean_v, &mean_a))
            core.inputs.current_a = (double)mean_a;
        else
            core.inputs.current_a = (double)current_a;
        core.inputs.wire_mm_s = (double)wire_mm_s;
        core.arc.voltage_v = (double)setpoint_v;
        core.arc.wire_mm_s = (double)wire_mm_s;
        waam_guard_orders(&core, FAST_PER_TICK * WAAM_FAST_US);
    }
    waam_core_fast(&core, &in, &out);
    if (out.arc)
        output = out.voltage_v;
    return output;
}

void arc_loop_tuning(float values[9])
{
    const waam_tuning_t *t = &core.fast.order[core.fast.current].tuning;
    const float all[9] = {t->pid.p, t->pid.i, t->pid.d, t->pid.smooth, t->pid.weight, t->plant_gain,
                          t->predict ? 1.0f : 0.0f, core.config.regulator.lag_s, core.config.regulator.delay_s};
    for (int i = 0; i < 9; i++)
        values[i] = all[i];
}
