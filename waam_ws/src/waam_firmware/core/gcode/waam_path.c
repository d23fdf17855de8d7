#include "waam_path.h"

#include <math.h>

#define CENTRIPETAL_SHARE 0.8 /* of the acceleration limit at most; leaves 0.6 of it to change the speed */

waam_kinematics_t waam_kinematics(const waam_config_t *config)
{
    waam_kinematics_t k = {.junction_deviation_mm = config->junction_deviation_mm};
    for (int i = 0; i < WAAM_AXES; i++) {
        k.steps_per_mm[i] = config->steps_per_mm[i];
        k.max_speed_mm_s[i] = config->max_speed_mm_s[i];
        k.accel_mm_s2[i] = config->accel_mm_s2[i];
    }
    return k;
}

waam_path_t waam_path_line(const double start_mm[WAAM_AXES], const double end_mm[WAAM_AXES])
{
    waam_path_t path = {.arc = false};
    double squares = 0.0;
    for (int i = 0; i < WAAM_AXES; i++) {
        double delta = end_mm[i] - start_mm[i];
        path.start_mm[i] = start_mm[i];
        path.end_mm[i] = end_mm[i];
        squares += delta * delta;
    }
    path.length_mm = sqrt(squares);
    return path;
}

void waam_path_point(const waam_path_t *path, double share, double at_mm[WAAM_AXES])
{
    for (int i = 0; i < WAAM_AXES; i++)
        at_mm[i] = path->start_mm[i] + share * (path->end_mm[i] - path->start_mm[i]);
    if (!path->arc)
        return;
    double angle = path->angle + share * path->sweep, radius = path->radius_mm + share * path->spiral_mm;
    at_mm[0] = path->centre_mm[0] + radius * cos(angle);
    at_mm[1] = path->centre_mm[1] + radius * sin(angle);
}

void waam_path_direction(const waam_path_t *path, double share, double unit[WAAM_AXES])
{
    for (int i = 0; i < WAAM_AXES; i++)
        unit[i] = (path->end_mm[i] - path->start_mm[i]) / path->length_mm;
    if (!path->arc)
        return;
    double angle = path->angle + share * path->sweep;
    double tangential = path->radius_mm * path->sweep / path->length_mm;
    unit[0] = -tangential * sin(angle);
    unit[1] = tangential * cos(angle);
}

/* Does the arc pass `angle` (any multiple of a turn away)? */
static bool passes(const waam_path_t *path, double angle)
{
    double low = fmin(path->angle, path->angle + path->sweep), turns = ceil((low - angle) / (2.0 * WAAM_PI));
    return angle + turns * 2.0 * WAAM_PI <= low + fabs(path->sweep);
}

void waam_path_reach(const waam_path_t *path, int axis, double *lowest_mm, double *highest_mm)
{
    *lowest_mm = fmin(path->start_mm[axis], path->end_mm[axis]);
    *highest_mm = fmax(path->start_mm[axis], path->end_mm[axis]);
    if (!path->arc || axis == 2)
        return;
    double radius = path->radius_mm + fmax(0.0, path->spiral_mm), forward = axis * 0.5 * WAAM_PI;
    if (passes(path, forward))
        *highest_mm = path->centre_mm[axis] + radius;
    if (passes(path, forward + WAAM_PI))
        *lowest_mm = path->centre_mm[axis] - radius;
}

/* Greatest value along `unit` so that no axis exceeds its own limit. */
static double along(const double unit[WAAM_AXES], const double limit[WAAM_AXES])
{
    double result = INFINITY;
    for (int i = 0; i < WAAM_AXES; i++) {
        double share = fabs(unit[i]);
        if (share > 1e-9 && limit[i] / share < result)
            result = limit[i] / share;
    }
    return result;
}

static double over(double limit, double share) { return share > 1e-9 ? limit / share : INFINITY; }

static void arc_limits(const waam_path_t *path, double wanted, const waam_kinematics_t *k, double *speed, double *accel)
{
    double radius = fmin(path->radius_mm, path->radius_mm + path->spiral_mm);
    double rise = fabs(path->end_mm[2] - path->start_mm[2]) / path->length_mm;
    double flat = sqrt(fmax(0.0, 1.0 - rise * rise)), limit = fmin(k->accel_mm_s2[0], k->accel_mm_s2[1]);
    *speed = fmin(over(fmin(k->max_speed_mm_s[0], k->max_speed_mm_s[1]), flat), over(k->max_speed_mm_s[2], rise));
    *speed = fmin(*speed, over(sqrt(CENTRIPETAL_SHARE * limit * radius), flat));
    double top = fmin(*speed, WAAM_OVERRIDE_MAX * wanted) * flat, centripetal = top * top / radius;
    *speed = fmin(*speed, WAAM_OVERRIDE_MAX * wanted);
    *accel = fmin(over(sqrt(limit * limit - centripetal * centripetal), flat), over(k->accel_mm_s2[2], rise));
}

void waam_path_limits(const waam_path_t *path, double wanted_mm_s, const waam_kinematics_t *kinematics,
                      double *speed_mm_s, double *accel_mm_s2)
{
    double unit[WAAM_AXES];
    if (path->arc) {
        arc_limits(path, wanted_mm_s, kinematics, speed_mm_s, accel_mm_s2);
        return;
    }
    waam_path_direction(path, 0.0, unit);
    *speed_mm_s = along(unit, kinematics->max_speed_mm_s);
    *accel_mm_s2 = along(unit, kinematics->accel_mm_s2);
}
