/* Settings of the wire that `$C` changes: what the feeder does between the command and the arc, and from where on the
 * wheel on the wire tells underfeed. */
#ifndef WAAM_WIRE_SETTINGS_H
#define WAAM_WIRE_SETTINGS_H

#include "waam_setting.h"
#include "waam_types.h"

/* Places in waam_config_t. */
extern const waam_setting_t waam_wire_settings[];


#endif
