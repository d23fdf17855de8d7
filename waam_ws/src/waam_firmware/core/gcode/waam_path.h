/* Geometry of one move: a straight line or a circular arc (helix), as a function of the share of its length. The arc is
 * evaluated as such at every tick, never as chords. Machine coordinates, mm. */
#ifndef WAAM_PATH_H
#define WAAM_PATH_H

#include "waam_types.h"

#define WAAM_OVERRIDE_MAX 2.0 /* of the travel speed */
#define WAAM_PI 3.14159265358979323846

typedef enum { WAAM_PLANE_XY, WAAM_PLANE_ZX, WAAM_PLANE_YZ } waam_plane_t; /* G17, G18, G19 */

/* The axes of a plane, right-handed: first, second, and the one along which a helix rises. */
extern const uint8_t waam_plane_axes[3][WAAM_AXES];

typedef struct {
    double start_mm[WAAM_AXES], end_mm[WAAM_AXES];
    double length_mm;           /* of a helix along the curve; of a block that only feeds wire, that length of wire */
    bool arc;
    waam_plane_t plane;
    double centre_mm[2];        /* in the plane's first and second axis */
    double radius_mm, spiral_mm;/* at the start; its change until the end (what the rounding of the program leaves) */
    double angle, sweep;        /* rad; at the start; signed, counter-clockwise positive */
} waam_path_t;

typedef struct {
    double steps_per_mm[WAAM_AXES];
    double max_speed_mm_s[WAAM_AXES], accel_mm_s2[WAAM_AXES];
    double junction_deviation_mm;
    double wire_max_mm_s, wire_accel_mm_s2, wire_jump_mm_s;
} waam_kinematics_t;

/* What the planner needs of the settings. */
waam_kinematics_t waam_kinematics(const waam_config_t *config);
/* A straight line, mm. */
waam_path_t waam_path_line(const double start_mm[WAAM_AXES], const double end_mm[WAAM_AXES]);
/* Where the path is after `share` of it (0 to 1), mm (eq 2.10, 2.11). */
void waam_path_point(const waam_path_t *path, double share, double at_mm[WAAM_AXES]);
/* Unit vector along the path; zero for a block that only feeds wire. */
void waam_path_direction(const waam_path_t *path, double share, double unit[WAAM_AXES]);
/* Least and greatest coordinate that the path reaches on an axis. */
void waam_path_reach(const waam_path_t *path, int axis, double *lowest_mm, double *highest_mm);
/* Greatest speed and acceleration along the path at which no axis exceeds its own limit. On an arc the limit of the
 * plane's axes is shared by the centripetal part, v^2 / R, and what is left for changes of speed:
 * a_path = sqrt(A^2 - a_c^2); `wanted_mm_s` (before the override) decides how much each gets. */
void waam_path_limits(const waam_path_t *path, double wanted_mm_s, const waam_kinematics_t *kinematics,
                      double *speed_mm_s, double *accel_mm_s2);

#endif
