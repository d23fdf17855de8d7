#include "waam_arcs.h"

#include <math.h>

/* Tolerances in mm. A program is written with so many digits; what is beyond that is a mistake. */
#define RADIUS_LEAST 1e-3
#define CLOSED 5e-5       /* start and end closer than this: a full circle */
#define MISMATCH 0.005    /* start and end radius may always differ by this ... */
#define MISMATCH_SHARE 1e-3 /* ... and by this share of the radius, ... */
#define MISMATCH_MOST 0.5 /* ... but by no more than this */

static void add_mm(waam_text_t *text, const char *before, double value)
{
    waam_text_add(text, before);
    waam_text_fixed(text, value, 4);
    waam_text_add(text, " mm");
}

static bool matching_radii(double first, double last, size_t column, waam_error_t *error)
{
    double off = fabs(last - first), larger = fmax(first, last);
    if (off <= MISMATCH || (off <= MISMATCH_SHARE * larger && off <= MISMATCH_MOST))
        return true;
    waam_fail(error, WAAM_E_CONTRADICTION, column, "the start is ");
    add_mm(&error->text, "", first);
    add_mm(&error->text, " from the centre and the end ", last);
    return false;
}

static double sweep_of(const double from[2], const double to[2], const double centre[2], bool clockwise)
{
    double sweep = atan2(to[1] - centre[1], to[0] - centre[0]) - atan2(from[1] - centre[1], from[0] - centre[0]);
    bool closed = hypot(to[0] - from[0], to[1] - from[1]) < CLOSED;
    if (closed)
        sweep = 0.0;
    if (clockwise && sweep >= 0.0)
        return sweep - 2.0 * WAAM_PI;
    return !clockwise && sweep <= 0.0 ? sweep + 2.0 * WAAM_PI : sweep;
}

bool waam_arc_path(const double start_mm[WAAM_AXES], const double end_mm[WAAM_AXES], const waam_command_t *command,
                   waam_path_t *path, waam_error_t *error)
{
    *path = waam_path_line(start_mm, end_mm);
    path->arc = true;
    for (int i = 0; i < 2; i++)
        path->centre_mm[i] = start_mm[i] + command->centre_mm[i];
    double last = hypot(end_mm[0] - path->centre_mm[0], end_mm[1] - path->centre_mm[1]);
    path->radius_mm = hypot(command->centre_mm[0], command->centre_mm[1]);
    path->spiral_mm = last - path->radius_mm;
    if (fmin(path->radius_mm, last) < RADIUS_LEAST)
        return waam_fail(error, WAAM_E_CONTRADICTION, command->arc_column, "the arc has no radius");
    if (!matching_radii(path->radius_mm, last, command->arc_column, error))
        return false;
    path->angle = atan2(-command->centre_mm[1], -command->centre_mm[0]);
    path->sweep = sweep_of(start_mm, end_mm, path->centre_mm, command->modal.motion == WAAM_MOTION_ARC_CW);
    double around = path->sweep * (path->radius_mm + 0.5 * path->spiral_mm);
    path->length_mm = hypot(around, end_mm[2] - start_mm[2]);
    return true;
}
