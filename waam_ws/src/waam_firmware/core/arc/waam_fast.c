/* The fast tick and its mailbox. */
#include "waam_fast.h"

#include <stdatomic.h>

#define FAST_S 1e-4f

void waam_fast_command(waam_fast_t *fast, const waam_fast_order_t *order)
{
    uint8_t next = (uint8_t)!fast->current;
    fast->order[next] = *order;
    atomic_signal_fence(memory_order_release); /* the interrupt runs on the same core */
    fast->current = next;
    fast->age_us = 0;
}

bool waam_fast_mean(waam_fast_t *fast, float *voltage_v, float *current_a)
{
    uint8_t full = fast->filling;
    fast->filling = (uint8_t)!full;
    atomic_signal_fence(memory_order_acquire);
    waam_fast_sum_t sum = fast->sum[full];
    fast->sum[full] = (waam_fast_sum_t){0};
    if (sum.count == 0)
        return false;
    *voltage_v = sum.voltage_v / (float)sum.count;
    *current_a = sum.current_a / (float)sum.count;
    return true;
}

static void collect(waam_fast_t *fast)
{
    waam_fast_sum_t *sum = &fast->sum[fast->filling];
    sum->voltage_v += fast->monitor.voltage_v;
    sum->current_a += fast->monitor.current_a;
    sum->count++;
}

static void watch(waam_fast_t *fast, const waam_config_t *config, const waam_fast_order_t *order,
                  const waam_fast_inputs_t *in)
{
    waam_trip_t trip = waam_monitor_step(&fast->monitor, &config->monitor, order->arc, order->burning,
                                         order->setpoint_v, in->voltage_v, in->current_a, WAAM_FAST_US);
    if (trip != WAAM_TRIP_NONE && fast->trip == WAAM_TRIP_NONE)
        fast->trip = (uint8_t)trip;
    if (fast->monitor.bad_us == 0)
        collect(fast);
}

static void regulate(waam_fast_t *fast, const waam_config_t *config, const waam_fast_order_t *order)
{
    float measured = fast->monitor.voltage_v;
    bool arc = fast->monitor.current_a > config->monitor.short_a;
    if (!order->regulate) {
        fast->regulator.on = false;
    } else if (!arc) {
        return; /* no arc, no arc voltage: the output waits where it is */
    } else if (!fast->regulator.on) {
        waam_regulator_start(&fast->regulator, &config->regulator, &order->tuning, FAST_S, order->base,
                             order->setpoint_v, measured);
        fast->output = order->base;
    } else {
        fast->output = waam_regulator_step(&fast->regulator, &order->tuning, order->setpoint_v, measured);
    }
    fast->regulating = fast->regulator.on;
}

/* What gives the orders may hang; what it asked for last must not go on for ever. */
static bool late(waam_fast_t *fast)
{
    if (fast->age_us < WAAM_ORDERS_US)
        fast->age_us += WAAM_FAST_US;
    bool is = fast->age_us >= WAAM_ORDERS_US;
    if (is && fast->trip == WAAM_TRIP_NONE)
        fast->trip = WAAM_TRIP_LATE;
    return is;
}

void waam_fast_tick(waam_fast_t *fast, const waam_config_t *config, const waam_fast_inputs_t *inputs,
                    waam_fast_outputs_t *outputs)
{
    const waam_fast_order_t *order = &fast->order[fast->current];
    bool by_source = config->regulator.actuator == WAAM_REGULATOR_SOURCE;
    if (inputs->valid) {
        watch(fast, config, order, inputs);
        regulate(fast, config, order);
    }
    outputs->late = late(fast);
    outputs->arc = order->arc && !outputs->late && fast->trip == WAAM_TRIP_NONE;
    outputs->voltage_v = !outputs->arc ? 0.0f : by_source && fast->regulating ? fast->output : order->setpoint_v;
    fast->fasted = true;
}
