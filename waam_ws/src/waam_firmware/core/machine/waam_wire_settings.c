#include "waam_wire_settings.h"

#include <stddef.h>

static const waam_wire_setting_t list[] = {
    {"wire_delay_s", 0.0, 0.25, offsetof(waam_config_t, wire_delay_s)},
    {"wire_lag_s", 0.0, 0.5, offsetof(waam_config_t, wire_lag_s)},
    {"wire_response_s", 0.005, 0.25, offsetof(waam_config_t, wire_response_s)},
};

const waam_wire_setting_t *waam_wire_setting(const char *name, uint32_t length)
{
    for (size_t i = 0; i < sizeof list / sizeof list[0]; i++) {
        uint32_t k = 0;
        while (k < length && list[i].name[k] == name[k] && name[k])
            k++;
        if (k == length && list[i].name[k] == '\0')
            return &list[i];
    }
    return NULL;
}

static void refuse(waam_request_t *r, const waam_wire_setting_t *setting, waam_code_t code, const char *why)
{
    waam_request_refuse(r, code, setting->name);
    waam_text_add(&r->answer, why);
}

void waam_configure_wire(waam_request_t *r, const waam_wire_setting_t *setting, double value)
{
    double *field = (double *)(void *)((char *)&r->core->config + setting->at), before = *field;
    if (!(value >= setting->lowest && value <= setting->highest)) {
        refuse(r, setting, WAAM_E_NUMBER, " must lie within ");
        waam_text_fixed(&r->answer, setting->lowest, 3);
        waam_text_add(&r->answer, " .. ");
        waam_text_fixed(&r->answer, setting->highest, 3);
        return;
    }
    *field = value;
    const waam_shaper_config_t shaper = r->core->config.shaper;
    const char *why = waam_core_tune(r->core, &shaper);
    if (why) {
        *field = before;
        waam_core_tune(r->core, &shaper);
        refuse(r, setting, WAAM_E_CONTRADICTION, ": ");
        waam_text_add(&r->answer, why);
        return;
    }
    waam_request_ok(r);
}
