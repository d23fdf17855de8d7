/* Steps per mm of the axes, as a host sets them: `$C steps_per_mm_x 319.873`, `M92 X319.873`, `$100=319.873`. */
#ifndef WAAM_SCALE_H
#define WAAM_SCALE_H

#include "waam_core.h"
#include "waam_setting.h"

#define WAAM_STEPS_LEAST 10.0
#define WAAM_STEPS_MOST 2000.0     /* a position within 1e6 mm stays within 32 bits */
#define WAAM_STEP_RATE_MOST 77000.0 /* per second; a board gives out 79 pulses in a tick of 1 ms, rounding takes two */

/* Places in waam_config_t, one for each axis: their names and ranges. */
extern const waam_setting_t waam_scale_settings[WAAM_AXES];
/* NULL = no such setting. */
const waam_setting_t *waam_scale_setting(const char *name, size_t length);

/* All axes at once; the values are rounded to a thousandth of a step per mm. In IDLE or ALARM with an empty queue, not
 * armed. The position in mm stays; where a value changes, homing is lost. False: `error` says why, nothing is changed. */
bool waam_core_scale(waam_core_t *core, const double steps_per_mm[WAAM_AXES], waam_error_t *error);
/* One axis; the others keep theirs. */
bool waam_core_scale_axis(waam_core_t *core, int axis, double steps_per_mm, waam_error_t *error);

#endif
