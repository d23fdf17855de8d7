#include "waam_accel.h"

#include <math.h>

#include "waam_internal.h"

#define AXIS(name, field, axis) \
    {name, (float)WAAM_ACCEL_LEAST, 1e6f, WAAM_SETTING_DOUBLE, offsetof(waam_config_t, field[axis])}

const waam_setting_t waam_accel_settings[] = {
    AXIS("max_accel_x", accel_mm_s2, 0),
    AXIS("max_accel_y", accel_mm_s2, 1),
    {0}, /* ends the list */
};

const waam_setting_t waam_accel_limits[] = {
    AXIS("accel_limit_x", accel_most_mm_s2, 0),
    AXIS("accel_limit_y", accel_most_mm_s2, 1),
    {0}, /* ends the list */
};

static bool fits(const waam_core_t *core, int axis, double value, waam_error_t *error)
{
    double most = core->config.accel_most_mm_s2[axis];
    if (value >= fmin(WAAM_ACCEL_LEAST, most) && value <= most)
        return true;
    bool above = value > most;
    waam_fail(error, above ? WAAM_E_CONTRADICTION : WAAM_E_NUMBER, 1, waam_accel_settings[axis].name);
    waam_text_add(&error->text, above ? ": the machine has at most " : " must be at least ");
    waam_text_fixed(&error->text, above ? most : fmin(WAAM_ACCEL_LEAST, most), 3);
    waam_text_add(&error->text, " mm/s^2");
    return false;
}

bool waam_core_accelerate(waam_core_t *core, const waam_setting_t *setting, double accel_mm_s2, waam_error_t *error)
{
    int axis = (int)(setting - waam_accel_settings);
    double rounded = round(accel_mm_s2 * 1e3) / 1e3;
    if (!fits(core, axis, rounded, error))
        return false;
    core->config.accel_mm_s2[axis] = rounded;
    core->kinematics = waam_kinematics(&core->config);
    return true;
}
