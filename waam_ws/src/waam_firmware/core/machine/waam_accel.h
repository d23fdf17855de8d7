/* Greatest acceleration of X and Y, as a host sets it: `$C max_accel_x 350`. */
#ifndef WAAM_ACCEL_H
#define WAAM_ACCEL_H

#include "waam_core.h"
#include "waam_setting.h"

#define WAAM_ACCEL_LEAST 50.0 /* mm/s^2: from 50 mm/s to rest in 1 s and 25 mm */

/* Places in waam_config_t, one for each axis: their names and ranges. */
extern const waam_setting_t waam_accel_settings[];
/* What the machine allows them, by the names under which a host reads it; it cannot be set. */
extern const waam_setting_t waam_accel_limits[];

/* Rounded to a thousandth of a mm/s^2. In IDLE or ALARM with an empty queue, so that no queued move has been planned with
 * another one. Position and homing stay. False: `error` says why, nothing is changed. */
bool waam_core_accelerate(waam_core_t *core, const waam_setting_t *setting, double accel_mm_s2, waam_error_t *error);

#endif
