/* The wire feeder: a velocity with its own acceleration, independent of the path; and jogging a length of wire.
 *
 * Between the command and the wire at the arc there are a transport delay and the motor's lag (time constant). The delay is
 * made up for by asking for the speed of a moment later (waam_motion_ahead), the lag by a lead: the command is
 *     u = x + lag / response (w - x),  x' = (u - x) / lag,
 * with w the speed wanted and x what the motor is taken to do, so that x approaches w with the time constant `response`
 * instead of `lag`. As long as no limit is met this is the pressure-advance law u = w + K dw/dt of a filtered w
 * (K = lag). x follows the command as limited, and the command goes only so far beyond w that it can be back in time, so
 * limits of speed and acceleration leave no overshoot behind. */
#ifndef WAAM_WIRE_H
#define WAAM_WIRE_H

#include "waam_types.h"

typedef struct {
    double speed_mm_s;      /* commanded now */
    double motor_mm_s;      /* what the motor is taken to do */
    double jog_left_mm;     /* signed; 0 = no jog */
    double jog_speed_mm_s;
} waam_wire_t;

/* length_mm is signed, negative = back. */
void waam_wire_jog(waam_wire_t *wire, double length_mm, double speed_mm_s);
bool waam_wire_jogging(const waam_wire_t *wire);
/* Forgets what is left; the wire ramps down. */
void waam_wire_stop_jog(waam_wire_t *wire);
/* Leads towards `wanted_mm_s`, or ramps along the jog when there is one. */
void waam_wire_tick(waam_wire_t *wire, double wanted_mm_s, const waam_config_t *config, double dt_s);

#endif
