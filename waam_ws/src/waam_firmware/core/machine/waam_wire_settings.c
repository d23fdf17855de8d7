#include "waam_wire_settings.h"

#define NUMBER(name, field, low, high) {name, low, high, WAAM_SETTING_DOUBLE, offsetof(waam_config_t, field)}

static const waam_setting_t list[] = {
    NUMBER("wire_delay_s", wire_delay_s, 0.0f, 0.25f),
    NUMBER("wire_lag_s", wire_lag_s, 0.0f, 0.5f),
    NUMBER("wire_response_s", wire_response_s, 0.005f, 0.25f),
    NUMBER("wire_underfeed_ratio", arc.wire_fault_ratio, 0.5f, 0.99f),
};

const waam_setting_t *waam_wire_setting(const char *name, size_t length)
{
    return waam_setting_find(list, sizeof list / sizeof list[0], name, length);
}
