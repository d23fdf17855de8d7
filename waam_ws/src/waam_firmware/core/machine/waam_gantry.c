#include "waam_gantry.h"

#include <math.h>

#include "waam_accel.h"
#include "waam_internal.h"
#include "waam_scale.h"

#define PLACE(name, low, high, type, field) {name, (float)(low), (float)(high), type, offsetof(waam_config_t, field)}
#define EXTENT(name, axis) \
    PLACE(name, WAAM_ENVELOPE_LEAST, WAAM_ENVELOPE_MOST, WAAM_SETTING_DOUBLE, limit_max_mm[axis])
#define SPEED(name, field) PLACE(name, WAAM_SPEED_LEAST, WAAM_SPEED_MOST, WAAM_SETTING_DOUBLE, field)
#define LIMIT(name, axis) \
    PLACE(name, WAAM_ACCEL_LEAST, WAAM_ACCEL_HIGHEST, WAAM_SETTING_DOUBLE, accel_most_mm_s2[axis])
#define HOMING(name, axis) PLACE(name, -1, 1, WAAM_SETTING_SIGN, home_direction[axis])

const waam_setting_t waam_gantry_settings[] = {
    EXTENT("envelope_x", 0),
    EXTENT("envelope_y", 1),
    EXTENT("envelope_z", 2),
    SPEED("max_speed_x", max_speed_mm_s[0]),
    SPEED("max_speed_y", max_speed_mm_s[1]),
    SPEED("max_speed_z", max_speed_mm_s[2]),
    SPEED("rapid_speed", rapid_mm_s),
    PLACE("max_accel_z", WAAM_ACCEL_LEAST, WAAM_ACCEL_HIGHEST, WAAM_SETTING_DOUBLE, accel_mm_s2[2]),
    LIMIT("accel_limit_x", 0),
    LIMIT("accel_limit_y", 1),
    PLACE("home_seek_speed", 5, 100, WAAM_SETTING_DOUBLE, home_seek_mm_s),
    PLACE("home_latch_speed", 0.5, 5, WAAM_SETTING_DOUBLE, home_latch_mm_s),
    HOMING("home_direction_x", 0),
    HOMING("home_direction_y", 1),
    {0}, /* ends the list */
};
static bool steps_follow(const waam_config_t *c, const waam_setting_t *setting, waam_error_t *error)
{
    for (int i = 0; i < WAAM_AXES; i++) {
        if (c->max_speed_mm_s[i] * c->steps_per_mm[i] <= WAAM_STEP_RATE_MOST)
            continue;
        waam_fail(error, WAAM_E_CONTRADICTION, 1, setting->name);
        waam_text_add(&error->text, ": at ");
        waam_text_fixed(&error->text, c->steps_per_mm[i], 3);
        waam_text_add(&error->text, " steps per mm there are pulses for at most ");
        waam_text_fixed(&error->text, WAAM_STEP_RATE_MOST / c->steps_per_mm[i], 3);
        waam_text_add(&error->text, " mm/s");
        return false;
    }
    return true;
}

static bool moves_home(const waam_setting_t *setting)
{
    return setting->type == WAAM_SETTING_SIGN || setting < waam_gantry_settings + WAAM_AXES;
}

bool waam_core_set_gantry(waam_core_t *core, const waam_setting_t *setting, double value, waam_error_t *error)
{
    waam_config_t *c = &core->config;
    const double before = waam_setting_get(setting, c), rounded = round(value * 1e3) / 1e3;
    if (rounded == before)
        return true;
    if (!waam_setting_put(setting, c, rounded))
        return waam_fail_range(error, setting);
    if (core->armed ? waam_fail(error, WAAM_E_NOT_NOW, 1, "the gantry's settings only while no job is armed")
                    : steps_follow(c, setting, error)) {
        for (int i = 0; i < WAAM_SHAPED_AXES; i++)
            c->accel_mm_s2[i] = fmin(c->accel_mm_s2[i], c->accel_most_mm_s2[i]);
        core->homed = core->plan_homed = core->homed && !moves_home(setting);
        core->kinematics = waam_kinematics(c);
        return true;
    }
    waam_setting_put(setting, c, before);
    return false;
}
