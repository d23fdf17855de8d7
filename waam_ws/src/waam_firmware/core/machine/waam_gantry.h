/* The gantry that the controller moves, as a host tells it: envelope, greatest speeds, acceleration of Z, what those of X and
 * Y may be set to at most, and how X and Y home: `$C envelope_x 3000`. Z always homes upwards: the torch leaves the part. */
#ifndef WAAM_GANTRY_H
#define WAAM_GANTRY_H

#include "waam_core.h"
#include "waam_setting.h"

#define WAAM_ENVELOPE_LEAST 50.0 /* mm */
#define WAAM_ENVELOPE_MOST 3500.0
#define WAAM_SPEED_LEAST 10.0    /* mm/s: slower than it homing never approaches its switch */
#define WAAM_SPEED_MOST 500.0
#define WAAM_ACCEL_HIGHEST 5000.0 /* mm/s^2: stiff axes of belts have 3000 */

/* Places in waam_config_t: names and ranges. */
extern const waam_setting_t waam_gantry_settings[];

/* Rounded to a thousandth. In IDLE or ALARM with an empty queue, not armed. The position in mm stays; another envelope or
 * way of homing loses homing. A lower limit of acceleration lowers the acceleration with it. False: `error` says why, nothing is changed. */
bool waam_core_set_gantry(waam_core_t *core, const waam_setting_t *setting, double value, waam_error_t *error);

#endif
