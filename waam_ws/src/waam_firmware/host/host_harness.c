#include "host_harness.h"

#include <math.h>
#include <string.h>

#define NULL_STRIKE_US 50000u
#define SENSE_FREE_V 12.0
#define SENSE_CONTACT_V 0.3
#define STANDARD_GRAVITY 9.80665

void host_harness_source(host_harness_t *harness, uint32_t exchange_us)
{
    waam_regulator_config_t *r = &harness->config.regulator;
    const waam_pid_gains_t integral = {.ki = 10.0f, .weight = 1.0f};
    r->lag_s = 0.0f;
    r->delay_s = 1.5e-6f * (float)exchange_us; /* half of it until the output is sampled, all of it until the answer */
    r->fixed = r->scheduled = integral;
    r->scheduling = false;
    r->trim = 5.0f;
    if (harness->null_plant)
        harness->config.monitor.stuck_us = 0; /* its arc burns too quietly for a real one */
}

void host_harness_accelerometer(host_harness_t *harness)
{
    harness->config.accelerometer = true;
    adxl345_device_start(&harness->accelerometer);
}

void host_harness_shake(host_harness_t *harness, const host_shaken_t *shaken)
{
    harness->shaken = *shaken;
    harness->shaken_from = harness->accelerometer.taken;
    harness->accelerometer.torn_off = !shaken->fitted;
}

void host_harness_steps(const host_harness_t *harness, int64_t at[WAAM_AXES])
{
    for (int i = 0; i < WAAM_AXES; i++)
        at[i] = llround(harness->start_mm[i] * harness->config.steps_per_mm[i]) + harness->outputs.pulses[i];
}

/* The machine is as large as its controller is told; an axis that would stand beyond its end stands there. */
static void resize(host_harness_t *harness)
{
    const waam_config_t *told = &harness->core.config;
    waam_config_t *c = &harness->config;
    if (memcmp(c->limit_max_mm, told->limit_max_mm, sizeof c->limit_max_mm) == 0)
        return;
    memcpy(c->limit_max_mm, told->limit_max_mm, sizeof c->limit_max_mm);
    for (int i = 0; i < WAAM_AXES; i++) {
        double moved = (double)harness->outputs.pulses[i] / c->steps_per_mm[i];
        harness->start_mm[i] = fmin(harness->start_mm[i] + moved, c->limit_max_mm[i]) - moved;
    }
}

static void press_home_switches(host_harness_t *harness)
{
    resize(harness);
    memcpy(harness->config.home_direction, harness->core.config.home_direction, sizeof harness->config.home_direction);
    const waam_config_t *c = &harness->config;
    int64_t at[WAAM_AXES];
    host_harness_steps(harness, at);
    for (int i = 0; i < WAAM_AXES; i++)
        harness->inputs.home_switch[i] = c->home_direction[i] < 0
                                         ? at[i] <= llround(c->limit_min_mm[i] * c->steps_per_mm[i])
                                         : at[i] >= llround(c->limit_max_mm[i] * c->steps_per_mm[i]);
}

static void null_plant(host_harness_t *harness)
{
    harness->null_arc_us = harness->outputs.arc ? harness->null_arc_us + TICK_US : 0;
    bool burns = harness->null_arc_us >= NULL_STRIKE_US;
    harness->inputs.process = WAAM_PROCESS_OK;
    harness->inputs.gas_ok = harness->outputs.gas;
    harness->inputs.wire_mm_s = harness->outputs.wire_mm_s;
    harness->inputs.current_a = burns ? 180.0 : 0.0;
    harness->inputs.voltage_v = burns ? harness->outputs.voltage_v : harness->outputs.arc ? 65.0 : 0.0;
}

/* While the controller senses, it sees the sense supply of the source. */
static void sense(const host_harness_t *harness, waam_inputs_t *inputs)
{
    if (harness->outputs.sense && inputs->process == WAAM_PROCESS_OK)
        inputs->voltage_v = harness->contact ? SENSE_CONTACT_V : SENSE_FREE_V;
}

/* 1 g downwards, with some counts of noise. */
static void at_rest(host_harness_t *harness, int16_t value[3])
{
    for (unsigned i = 0; i < 3; i++) {
        harness->noise = harness->noise * 1664525u + 1013904223u;
        value[i] = (int16_t)((int)(harness->noise >> 29) - 4 + (i == 2 ? WAAM_ADXL345_PER_G : 0));
    }
}

static int16_t counts(float m_s2)
{
    double value = round((double)m_s2 * WAAM_ADXL345_PER_G / STANDARD_GRAVITY);
    return (int16_t)fmin(fmax(value, -WAAM_ADXL345_TOP), WAAM_ADXL345_TOP - 1);
}

/* The next sample takes the next value of the cell; the sensor is of 3200/s exactly, so that in a step it takes them all. */
static void shaken(const host_harness_t *harness, int16_t value[3])
{
    const host_shaken_t *s = &harness->shaken;
    uint32_t at = harness->accelerometer.taken - harness->shaken_from;
    const float *felt = s->value[at < s->count ? at : s->count - 1];
    for (unsigned i = 0; i < 3; i++)
        value[i] = counts(felt[i]);
}

static void accelerometer(host_harness_t *harness)
{
    int16_t value[3];
    if (!harness->config.accelerometer)
        return;
    if (harness->shaken.count)
        shaken(harness, value);
    else
        at_rest(harness, value);
    adxl345_device_run(&harness->accelerometer, WAAM_FAST_US, value);
    harness->bus_bytes = waam_core_accelerometer(&harness->core, harness->bus, harness->bus_bytes, harness->bus);
    if (harness->bus_bytes)
        adxl345_device_exchange(&harness->accelerometer, harness->bus, harness->bus, harness->bus_bytes);
}

static void fast_ticks(host_harness_t *harness, const waam_inputs_t *inputs)
{
    const waam_fast_inputs_t in = {.valid = inputs->process == WAAM_PROCESS_OK,
                                   .voltage_v = (float)inputs->voltage_v,
                                   .current_a = (float)inputs->current_a};
    waam_fast_outputs_t out;
    for (unsigned i = 0; i < TICK_US / WAAM_FAST_US; i++) {
        waam_core_fast(&harness->core, &in, &out);
        accelerometer(harness);
    }
}

void host_harness_tick(host_harness_t *harness)
{
    press_home_switches(harness);
    if (harness->null_plant)
        null_plant(harness);
    waam_inputs_t inputs = harness->inputs;
    sense(harness, &inputs);
    fast_ticks(harness, &inputs);
    waam_core_tick(&harness->core, TICK_US, &inputs, &harness->outputs);
}

_Static_assert(sizeof(host_sample_t) == 48, "the layout of the plant port");

host_sample_t host_harness_sample(const host_harness_t *harness)
{
    const waam_outputs_t *out = &harness->outputs;
    int64_t pulses[WAAM_AXES];
    double m[WAAM_AXES];
    host_harness_steps(harness, pulses);
    for (int i = 0; i < WAAM_AXES; i++)
        m[i] = ((double)pulses[i] + (double)out->part[i] / WAAM_PARTS) / (harness->config.steps_per_mm[i] * 1e3);
    return (host_sample_t){
        .table_x = -m[0], .table_y = -m[1], .tool_z = m[2],
        .wire_cmd = out->wire_mm_s * 1e-3, .voltage_set = out->voltage_v,
        .outputs = (out->arc ? 1u : 0u) | (out->gas ? 2u : 0u) |
                   (harness->core.acceleration.wanted ? 4u : 0u),
    };
}
