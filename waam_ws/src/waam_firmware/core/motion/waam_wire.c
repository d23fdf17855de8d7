#include "waam_wire.h"

#include <math.h>

#define SETTLED 0.005 /* share of the speed within which the lead ends, so that the command stands still */
#define JOG_DONE_MM 1e-6 /* what is left of a jog when it ends */

void waam_wire_jog(waam_wire_t *wire, double length_mm, double speed_mm_s)
{
    wire->jog_left_mm = length_mm;
    wire->jog_speed_mm_s = speed_mm_s;
}

bool waam_wire_jogging(const waam_wire_t *wire) { return wire->jog_left_mm != 0.0; }

void waam_wire_stop_jog(waam_wire_t *wire) { wire->jog_left_mm = 0.0; }

/* Speed at the end of this tick, along the jog, from which the feeder can still stand at its end: root of
 * left - (v0 + v) dt / 2 = v^2 / (2 a). */
static double jog_target(const waam_wire_t *wire, double accel_mm_s2, double dt_s)
{
    double left = fabs(wire->jog_left_mm), before = copysign(wire->speed_mm_s, wire->speed_mm_s * wire->jog_left_mm);
    double half = 0.5 * accel_mm_s2 * dt_s;
    double root = half * half + accel_mm_s2 * (2.0 * left - before * dt_s);
    return copysign(fmin(wire->jog_speed_mm_s, fmax(0.0, sqrt(fmax(0.0, root)) - half)), wire->jog_left_mm);
}

static void jog(waam_wire_t *wire, double moved_mm)
{
    double left = wire->jog_left_mm - moved_mm;
    wire->jog_left_mm = copysign(1.0, wire->jog_left_mm) * left > JOG_DONE_MM ? left : 0.0;
}

/* How far the command may be beyond the speed wanted, so that it is back, at the feeder's acceleration a, when the motor gets
 * there and not later: exp(z) - 1 - z = missing / (a lag) with z = excess / (a lag); solved to 1 %, on the safe side. */
static double excess(double missing_mm_s, const waam_config_t *config)
{
    double unit = config->wire_accel_mm_s2 * config->wire_lag_s, s = sqrt(2.0 * fabs(missing_mm_s) / unit);
    return unit * s / (1.0 + s / 6.0);
}

/* The lead never turns the wire round and never exceeds what the feeder can do. */
static double lead(const waam_wire_t *wire, double wanted, const waam_config_t *config)
{
    double missing = wanted - wire->motor_mm_s;
    if (config->wire_lag_s <= config->wire_response_s || fabs(missing) <= SETTLED * fabs(wanted))
        return wanted;
    double ahead = fabs(missing) * (config->wire_lag_s / config->wire_response_s - 1.0);
    double command = wanted + copysign(fmin(ahead, excess(missing, config)), missing);
    double lowest = wanted < 0.0 ? -config->wire_max_mm_s : 0.0, highest = wanted > 0.0 ? config->wire_max_mm_s : 0.0;
    return fmax(lowest, fmin(highest, command));
}

void waam_wire_tick(waam_wire_t *wire, double wanted_mm_s, const waam_config_t *config, double dt_s)
{
    bool jogging = waam_wire_jogging(wire);
    double change = config->wire_accel_mm_s2 * dt_s, before = wire->speed_mm_s;
    double target = jogging ? jog_target(wire, config->wire_accel_mm_s2, dt_s)
                            : lead(wire, wanted_mm_s, config);
    wire->speed_mm_s = fmax(before - change, fmin(before + change, target));
    double mean = 0.5 * (before + wire->speed_mm_s);
    wire->motor_mm_s += (mean - wire->motor_mm_s) * fmin(1.0, dt_s / fmax(config->wire_lag_s, dt_s));
    if (jogging)
        jog(wire, mean * dt_s);
}
