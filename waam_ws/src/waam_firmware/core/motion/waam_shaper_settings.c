/* Settings of the input shaper: names and ranges. */
#include "waam_shaper.h"

#define AT(field) offsetof(waam_shaper_config_t, field)
#define TYPE(name, axis) {name, 0.0f, (float)(WAAM_SHAPER_TYPES - 1), WAAM_SETTING_WHOLE, AT(axis.type)}
#define NUMBER(name, field, low, high) {name, low, high, WAAM_SETTING_FLOAT, AT(field)}

const waam_setting_t waam_shaper_settings[] = {
    TYPE("shape_x", axis[0]),
    NUMBER("shape_x_hz", axis[0].hz, 5.0f, 200.0f),
    NUMBER("shape_x_damping", axis[0].damping, 0.0f, 0.2f),
    TYPE("shape_y", axis[1]),
    NUMBER("shape_y_hz", axis[1].hz, 5.0f, 200.0f),
    NUMBER("shape_y_damping", axis[1].damping, 0.0f, 0.2f),
    NUMBER("shape_corner_mm", corner_mm, 0.005f, 1.0f),
    {0}, /* ends the list */
};

waam_shaper_config_t waam_shaper_default(void)
{
    const waam_shaper_axis_t off = {.type = WAAM_SHAPER_NONE, .hz = 50.0f, .damping = 0.1f};
    return (waam_shaper_config_t){.axis = {off, off}, .corner_mm = 0.02f};
}

const char *waam_shaper_name(uint32_t type)
{
    static const char *const names[] = {"none", "zv", "zvd", "mzv", "ei", "2hump_ei", "3hump_ei"};
    return type < WAAM_SHAPER_TYPES ? names[type] : "unknown";
}
