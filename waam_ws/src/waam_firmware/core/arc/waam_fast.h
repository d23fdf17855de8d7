/* The fast tick: what must happen within 100 us of an arc sample. Single precision and integers only, no library calls.
 *
 * It runs in an interrupt above the tick. The tick hands its orders over in one of two buffers and then names it, so the
 * fast tick never sees half an order; what it reports are single words, written whole, or sums in a second pair of buffers.
 * Orders have an age: where no tick renews them for WAAM_ORDERS_US, the fast tick takes the arc off.
 */
#ifndef WAAM_FAST_H
#define WAAM_FAST_H

#include "waam_monitor.h"
#include "waam_regulator.h"
#include "waam_types.h"

#define WAAM_FAST_US 100u
#define WAAM_ORDERS_US 20000u /* orders of this age hold no more */

typedef struct {
    bool valid;                 /* the two values are connected (else the fast tick only passes orders on) */
    float voltage_v, current_a; /* of the arc, sampled now */
} waam_fast_inputs_t;

typedef struct {
    bool arc;                   /* enable the source; never more than the last tick allowed, less after a trip */
    float voltage_v;            /* setpoint of the source */
    bool late;                  /* the tick stands still: the wire stops as well, whatever the tick has asked for */
} waam_fast_outputs_t;

typedef struct {
    bool arc;                   /* source enabled */
    bool burning;               /* arc established: watched for shorts and long arcs */
    bool regulate;
    float setpoint_v;           /* of the arc */
    float base;                 /* output of the regulator when it starts */
    waam_tuning_t tuning;
} waam_fast_order_t;

typedef struct {
    float voltage_v, current_a;
    uint32_t count;
} waam_fast_sum_t;

typedef struct {
    waam_fast_order_t order[2];
    volatile uint8_t current;   /* which of the two holds */
    volatile uint32_t age_us;   /* of the orders; stops at WAAM_ORDERS_US */
    waam_fast_sum_t sum[2];     /* good samples since the tick looked last */
    volatile uint8_t filling;
    volatile bool ticked, fasted, linked; /* signs of life, all three since the watchdog was fed last */
    volatile uint8_t trip;      /* waam_trip_t; the first one stands until the tick has seen it */
    volatile float output;      /* of the regulator: V of the source, or mm/s of wire */
    volatile bool regulating;
    waam_monitor_t monitor;
    waam_regulator_t regulator;
} waam_fast_t;

/* Tick: the orders from now on. */
void waam_fast_command(waam_fast_t *fast, const waam_fast_order_t *order);
/* Tick: mean of the good samples since the last call; false when there were none. */
bool waam_fast_mean(waam_fast_t *fast, float *voltage_v, float *current_a);
/* Every WAAM_FAST_US, from the interrupt. */
void waam_fast_tick(waam_fast_t *fast, const waam_config_t *config, const waam_fast_inputs_t *inputs,
                    waam_fast_outputs_t *outputs);

#endif
