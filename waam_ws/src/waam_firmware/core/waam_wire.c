#include "waam_wire.h"

#include <math.h>

#define SETTLED 0.005 /* share of the speed within which the lead ends, so that the command stands still */

void waam_wire_jog(waam_wire_t *wire, double length_mm, double speed_mm_s)
{
    wire->jog_left_mm = length_mm;
    wire->jog_speed_mm_s = speed_mm_s;
}

bool waam_wire_jogging(const waam_wire_t *wire) { return wire->jog_left_mm != 0.0; }

void waam_wire_stop_jog(waam_wire_t *wire) { wire->jog_left_mm = 0.0; }

static double jog_target(const waam_wire_t *wire, double accel_mm_s2)
{
    double left = fabs(wire->jog_left_mm);
    return copysign(fmin(wire->jog_speed_mm_s, sqrt(2.0 * accel_mm_s2 * left)), wire->jog_left_mm);
}

static void jog(waam_wire_t *wire, double before_mm_s, double dt_s)
{
    double moved = 0.5 * (before_mm_s + wire->speed_mm_s) * dt_s;
    if (fabs(wire->jog_left_mm) <= fabs(moved) + 1e-6 && moved * wire->jog_left_mm >= 0.0)
        waam_wire_stop_jog(wire);
    else
        wire->jog_left_mm -= moved;
}

/* The lead never turns the wire round and never exceeds what the feeder can do. */
static double lead(const waam_wire_t *wire, double wanted, const waam_config_t *config)
{
    double missing = wanted - wire->motor_mm_s;
    if (config->wire_lag_s <= config->wire_response_s || fabs(missing) <= SETTLED * fabs(wanted))
        return wanted;
    double command = wire->motor_mm_s + config->wire_lag_s / config->wire_response_s * missing;
    double lowest = wanted < 0.0 ? -config->wire_max_mm_s : 0.0, highest = wanted > 0.0 ? config->wire_max_mm_s : 0.0;
    return fmax(lowest, fmin(highest, command));
}

void waam_wire_tick(waam_wire_t *wire, double wanted_mm_s, const waam_config_t *config, double dt_s)
{
    bool jogging = waam_wire_jogging(wire);
    double change = config->wire_accel_mm_s2 * dt_s, before = wire->speed_mm_s;
    double target = jogging ? jog_target(wire, config->wire_accel_mm_s2) : lead(wire, wanted_mm_s + wire->free_mm_s, config);
    wire->speed_mm_s = fmax(before - change, fmin(before + change, target));
    double mean = 0.5 * (before + wire->speed_mm_s);
    wire->fed_mm += mean * dt_s / fmax(wire->override, 0.1);
    wire->motor_mm_s += (mean - wire->motor_mm_s) * fmin(1.0, dt_s / fmax(config->wire_lag_s, dt_s));
    if (jogging)
        jog(wire, before, dt_s);
}
