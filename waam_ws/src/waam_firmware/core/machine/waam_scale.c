#include "waam_scale.h"

#include <math.h>

#include "waam_internal.h"

#define AXIS(name, axis) \
    {name, (float)WAAM_STEPS_LEAST, (float)WAAM_STEPS_MOST, WAAM_SETTING_DOUBLE, offsetof(waam_config_t, steps_per_mm[axis])}

const waam_setting_t waam_scale_settings[] = {
    AXIS("steps_per_mm_x", 0),
    AXIS("steps_per_mm_y", 1),
    AXIS("steps_per_mm_z", 2),
    {0}, /* ends the list */
};

void waam_core_rescale(waam_core_t *core)
{
    core->kinematics = waam_kinematics(&core->config);
    for (int i = 0; i < WAAM_AXES; i++)
        core->motion.steps_per_mm[i] = core->config.steps_per_mm[i];
}

/* The place in mm, which is kept as such, stays what it was, in the new steps; no pulse is given out. */
static void keep_place(waam_core_t *core, int axis, double steps_per_mm)
{
    waam_core_absorb(core);
    core->config.steps_per_mm[axis] = steps_per_mm;
    waam_motion_declare(&core->motion, axis, (int32_t)lround(core->path_mm[axis] * steps_per_mm));
    waam_core_rescale(core);
    waam_shaper_rest(&core->shaper, waam_core_place(core));
    core->z_before = core->motion.steps[2];
    core->homed = core->plan_homed = false;
}

bool waam_core_scale(waam_core_t *core, const waam_setting_t *setting, double steps_per_mm, waam_error_t *error)
{
    int axis = (int)(setting - waam_scale_settings);
    double rounded = round(steps_per_mm * 1e3) / 1e3, speed = core->config.max_speed_mm_s[axis];
    if (!(rounded >= WAAM_STEPS_LEAST && rounded <= WAAM_STEPS_MOST))
        return waam_fail_range(error, setting);
    if (rounded * speed > WAAM_STEP_RATE_MOST) {
        waam_fail(error, WAAM_E_CONTRADICTION, 1, setting->name);
        waam_text_add(&error->text, ": at ");
        waam_text_fixed(&error->text, speed, 3);
        waam_text_add(&error->text, " mm/s there are pulses for at most ");
        waam_text_fixed(&error->text, WAAM_STEP_RATE_MOST / speed, 3);
        return false;
    }
    if (rounded == core->config.steps_per_mm[axis])
        return true;
    if (core->armed)
        return waam_fail(error, WAAM_E_NOT_NOW, 1, "steps per mm only while no job is armed");
    keep_place(core, axis, rounded);
    return true;
}
