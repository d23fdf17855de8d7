/* Steps per mm of the axes, as a host sets them: `$C steps_per_mm_x 319.873`. */
#ifndef WAAM_SCALE_H
#define WAAM_SCALE_H

#include "waam_core.h"
#include "waam_setting.h"

#define WAAM_STEPS_LEAST 10.0
#define WAAM_STEPS_MOST 2000.0     /* a position within 1e6 mm stays within 32 bits */
#define WAAM_STEP_RATE_MOST 77000.0 /* per second; a board gives out 79 pulses in a tick of 1 ms, rounding takes two */

/* Places in waam_config_t, one for each axis: their names and ranges. */
extern const waam_setting_t waam_scale_settings[];

/* The value is rounded to a thousandth of a step per mm. In IDLE or ALARM with an empty queue, not armed. The position in mm
 * stays; a change loses homing. False: `error` says why, nothing is changed. */
bool waam_core_scale(waam_core_t *core, const waam_setting_t *setting, double steps_per_mm, waam_error_t *error);

#endif
