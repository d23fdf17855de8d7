/* Settings of the lead of the wire that `$C` changes: what the feeder does between the command and the arc. */
#ifndef WAAM_WIRE_SETTINGS_H
#define WAAM_WIRE_SETTINGS_H

#include "waam_request.h"

typedef struct {
    const char *name;
    double lowest, highest; /* s */
    size_t at;              /* in waam_config_t */
} waam_wire_setting_t;

/* wire_delay_s, wire_lag_s, wire_response_s; NULL = no such setting. */
const waam_wire_setting_t *waam_wire_setting(const char *name, uint32_t length);
/* Answers the request. The shaper in force must still fit into the lead. */
void waam_configure_wire(waam_request_t *request, const waam_wire_setting_t *setting, double value);

#endif
