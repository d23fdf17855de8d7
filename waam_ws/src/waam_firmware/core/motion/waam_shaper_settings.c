/* Settings of the input shaper: names and ranges. */
#include <stddef.h>

#include "waam_shaper.h"

#define TYPE(name, axis) {{name, 0.0f, (float)(WAAM_SHAPER_TYPES - 1), true}, offsetof(waam_shaper_config_t, axis.type)}
#define NUMBER(name, field, low, high) {{name, low, high, false}, offsetof(waam_shaper_config_t, field)}

static const struct {
    waam_shaper_setting_t setting;
    size_t at;
} list[] = {
    TYPE("shape_x", axis[0]),
    NUMBER("shape_x_hz", axis[0].hz, 5.0f, 200.0f),
    NUMBER("shape_x_damping", axis[0].damping, 0.0f, 0.2f),
    TYPE("shape_y", axis[1]),
    NUMBER("shape_y_hz", axis[1].hz, 5.0f, 200.0f),
    NUMBER("shape_y_damping", axis[1].damping, 0.0f, 0.2f),
};

const waam_shaper_setting_t *waam_shaper_setting(const char *name, uint32_t length)
{
    for (size_t i = 0; i < sizeof list / sizeof list[0]; i++) {
        uint32_t k = 0;
        while (k < length && list[i].setting.name[k] == name[k] && name[k])
            k++;
        if (k == length && list[i].setting.name[k] == '\0')
            return &list[i].setting;
    }
    return NULL;
}

bool waam_shaper_set(waam_shaper_config_t *config, const waam_shaper_setting_t *setting, double value)
{
    size_t i = 0;
    while (&list[i].setting != setting)
        i++;
    char *at = (char *)config + list[i].at;
    if (!(value >= (double)setting->lowest && value <= (double)setting->highest))
        return false;
    if (!setting->whole) {
        *(float *)(void *)at = (float)value;
        return true;
    }
    uint32_t whole = (uint32_t)value;
    if ((double)whole != value)
        return false;
    *(uint32_t *)(void *)at = whole;
    return true;
}

waam_shaper_config_t waam_shaper_default(void)
{
    const waam_shaper_axis_t off = {.type = WAAM_SHAPER_NONE, .hz = 50.0f, .damping = 0.1f};
    return (waam_shaper_config_t){.axis = {off, off}};
}

const char *waam_shaper_name(uint32_t type)
{
    static const char *const names[] = {"none", "zv", "zvd", "mzv", "ei", "2hump_ei", "3hump_ei"};
    return type < WAAM_SHAPER_TYPES ? names[type] : "unknown";
}
