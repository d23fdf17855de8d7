#include "waam_wire.h"

#include <math.h>

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

void waam_wire_tick(waam_wire_t *wire, double arc_mm_s, double accel_mm_s2, double dt_s)
{
    bool jog = waam_wire_jogging(wire);
    double target = jog ? jog_target(wire, accel_mm_s2) : arc_mm_s;
    double change = accel_mm_s2 * dt_s, before = wire->speed_mm_s;
    wire->speed_mm_s = fmax(before - change, fmin(before + change, target));
    if (!jog)
        return;
    double moved = 0.5 * (before + wire->speed_mm_s) * dt_s;
    if (fabs(wire->jog_left_mm) <= fabs(moved) + 1e-6 && moved * wire->jog_left_mm >= 0.0)
        waam_wire_stop_jog(wire);
    else
        wire->jog_left_mm -= moved;
}
