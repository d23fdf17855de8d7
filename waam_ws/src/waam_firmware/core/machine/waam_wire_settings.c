#include "waam_wire_settings.h"

#define NUMBER(name, field, low, high) {name, low, high, WAAM_SETTING_DOUBLE, offsetof(waam_config_t, field)}

const waam_setting_t waam_wire_settings[] = {
    NUMBER("wire_delay_s", wire_delay_s, 0.0f, 0.25f),
    NUMBER("wire_lag_s", wire_lag_s, 0.0f, 0.5f),
    NUMBER("wire_response_s", wire_response_s, 0.005f, 0.25f),
    NUMBER("wire_underfeed_ratio", arc.wire_fault_ratio, 0.5f, 0.99f),
    {0}, /* ends the list */
};
