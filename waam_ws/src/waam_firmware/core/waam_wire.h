/* The wire feeder: a velocity with its own acceleration, independent of the path; and jogging a length of wire. */
#ifndef WAAM_WIRE_H
#define WAAM_WIRE_H

#include "waam_types.h"

typedef struct {
    double speed_mm_s;      /* commanded now */
    double jog_left_mm;     /* signed; 0 = no jog */
    double jog_speed_mm_s;
} waam_wire_t;

void waam_wire_jog(waam_wire_t *wire, double length_mm, double speed_mm_s);
bool waam_wire_jogging(const waam_wire_t *wire);
void waam_wire_stop_jog(waam_wire_t *wire);
/* Ramps towards `arc_mm_s`, or along the jog when there is one. */
void waam_wire_tick(waam_wire_t *wire, double arc_mm_s, double accel_mm_s2, double dt_s);

#endif
