/* Geometry of one move: a straight line or a circular arc (helix), as a function of the share of its length. The arc is
 * evaluated as such at every tick, never as chords. Machine coordinates, mm. */
#ifndef WAAM_PATH_H
#define WAAM_PATH_H

#include "waam_types.h"

#define WAAM_OVERRIDE_MAX 2.0 /* of the travel speed */
#define WAAM_PI 3.14159265358979323846

typedef struct {
    double start_mm[WAAM_AXES], end_mm[WAAM_AXES];
    double length_mm;           /* of a helix along the curve */
    bool arc;                   /* in X and Y; Z is a straight function of the length */
    double centre_mm[2];
    double radius_mm, spiral_mm;/* at the start; its change until the end (what the rounding of the program leaves) */
    double angle, sweep;        /* rad; at the start; signed, counter-clockwise positive */
} waam_path_t;

typedef struct {
    double steps_per_mm[WAAM_AXES];
    double max_speed_mm_s[WAAM_AXES], accel_mm_s2[WAAM_AXES];
    double junction_deviation_mm;
} waam_kinematics_t;

/* What the planner needs of the settings. */
waam_kinematics_t waam_kinematics(const waam_config_t *config);
/* A straight line, mm. */
waam_path_t waam_path_line(const double start_mm[WAAM_AXES], const double end_mm[WAAM_AXES]);
/* Where the path is after `share` of it (0 to 1), mm (eq 2.10, 2.11). */
void waam_path_point(const waam_path_t *path, double share, double at_mm[WAAM_AXES]);
/* Unit vector along the path. */
void waam_path_direction(const waam_path_t *path, double share, double unit[WAAM_AXES]);
/* Least and greatest coordinate that the path reaches on an axis. */
void waam_path_reach(const waam_path_t *path, int axis, double *lowest_mm, double *highest_mm);
/* Greatest speed and acceleration along the path at which no axis exceeds its own limit. On an arc the limit of
 * X and Y is shared by the centripetal part, v^2 / R, and what is left for changes of speed:
 * a_path = sqrt(A^2 - a_c^2); `wanted_mm_s` (before the override) decides how much each gets. */
void waam_path_limits(const waam_path_t *path, double wanted_mm_s, const waam_kinematics_t *kinematics,
                      double *speed_mm_s, double *accel_mm_s2);

#endif
