#include "rig.h"

#include <math.h>

#define NULL_STRIKE_US 50000u
#define SENSE_FREE_V 12.0
#define SENSE_CONTACT_V 0.3

void rig_source(rig_t *rig, uint32_t exchange_us)
{
    waam_regulator_config_t *r = &rig->config.regulator;
    const waam_pid_gains_t integral = {.ki = 10.0f, .weight = 1.0f};
    r->lag_s = 0.0f;
    r->delay_s = 1.5e-6f * (float)exchange_us; /* half of it until the output is sampled, all of it until the answer */
    r->fixed = r->scheduled = integral;
    r->scheduling = false;
    r->trim = 5.0f;
    if (rig->null_plant)
        rig->config.monitor.stuck_us = 0; /* its arc burns too quietly for a real one */
}

void rig_steps(const rig_t *rig, int64_t at[WAAM_AXES])
{
    for (int i = 0; i < WAAM_AXES; i++)
        at[i] = llround(rig->start_mm[i] * rig->config.steps_per_mm) + rig->outputs.pulses[i];
}

static void press_home_switches(rig_t *rig)
{
    const waam_config_t *c = &rig->config;
    int64_t at[WAAM_AXES];
    rig_steps(rig, at);
    for (int i = 0; i < WAAM_AXES; i++)
        rig->inputs.home_switch[i] = c->home_direction[i] < 0
                                         ? at[i] <= llround(c->limit_min_mm[i] * c->steps_per_mm)
                                         : at[i] >= llround(c->limit_max_mm[i] * c->steps_per_mm);
}

static void null_plant(rig_t *rig)
{
    rig->null_arc_us = rig->outputs.arc ? rig->null_arc_us + TICK_US : 0;
    bool burns = rig->null_arc_us >= NULL_STRIKE_US;
    rig->inputs.process = WAAM_PROCESS_OK;
    rig->inputs.gas_ok = rig->outputs.gas;
    rig->inputs.wire_mm_s = rig->outputs.wire_mm_s;
    rig->inputs.current_a = burns ? 180.0 : 0.0;
    rig->inputs.voltage_v = burns ? rig->outputs.voltage_v : rig->outputs.arc ? 65.0 : 0.0;
}

/* While the controller senses, it sees the sense supply of the source. */
static void sense(const rig_t *rig, waam_inputs_t *inputs)
{
    if (rig->outputs.sense && inputs->process == WAAM_PROCESS_OK)
        inputs->voltage_v = rig->contact ? SENSE_CONTACT_V : SENSE_FREE_V;
}

static void fast_ticks(rig_t *rig, const waam_inputs_t *inputs)
{
    const waam_fast_inputs_t in = {.valid = inputs->process == WAAM_PROCESS_OK,
                                   .voltage_v = (float)inputs->voltage_v,
                                   .current_a = (float)inputs->current_a};
    waam_fast_outputs_t out;
    for (unsigned i = 0; i < TICK_US / WAAM_FAST_US; i++)
        waam_core_fast(&rig->core, &in, &out);
}

void rig_tick(rig_t *rig)
{
    press_home_switches(rig);
    if (rig->null_plant)
        null_plant(rig);
    waam_inputs_t inputs = rig->inputs;
    sense(rig, &inputs);
    fast_ticks(rig, &inputs);
    waam_core_tick(&rig->core, TICK_US, &inputs, &rig->outputs);
}
