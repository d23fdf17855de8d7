#include "waam_scale.h"

#include <math.h>

#include "waam_internal.h"

#define AXIS(name, axis) \
    {name, (float)WAAM_STEPS_LEAST, (float)WAAM_STEPS_MOST, WAAM_SETTING_DOUBLE, offsetof(waam_config_t, steps_per_mm[axis])}

const waam_setting_t waam_scale_settings[WAAM_AXES] = {
    AXIS("steps_per_mm_x", 0),
    AXIS("steps_per_mm_y", 1),
    AXIS("steps_per_mm_z", 2),
};

const waam_setting_t *waam_scale_setting(const char *name, size_t length)
{
    return waam_setting_find(waam_scale_settings, WAAM_AXES, name, length);
}

void waam_core_rescale(waam_core_t *core)
{
    core->kinematics = waam_kinematics(&core->config);
    for (int i = 0; i < WAAM_AXES; i++)
        core->motion.steps_per_mm[i] = core->config.steps_per_mm[i];
}

/* The place in mm, which is kept as such, stays what it was, in the new steps; no pulse is given out. */
static void keep_place(waam_core_t *core, const double steps_per_mm[WAAM_AXES])
{
    waam_core_absorb(core);
    for (int i = 0; i < WAAM_AXES; i++) {
        core->config.steps_per_mm[i] = steps_per_mm[i];
        waam_motion_declare(&core->motion, i, (int32_t)lround(core->path_mm[i] * steps_per_mm[i]));
    }
    waam_core_rescale(core);
    waam_shaper_rest(&core->shaper, waam_core_place(core));
    core->z_before = core->motion.steps[2];
    core->homed = core->plan_homed = false;
}

static bool fail_axis(waam_error_t *error, waam_code_t code, int axis, const char *text, double low, const char *between,
                      double high)
{
    waam_fail(error, code, 1, waam_scale_settings[axis].name);
    waam_text_add(&error->text, text);
    waam_text_fixed(&error->text, low, 3);
    waam_text_add(&error->text, between);
    waam_text_fixed(&error->text, high, 3);
    return false;
}

static bool fits(const waam_core_t *core, int axis, double value, waam_error_t *error)
{
    double speed = core->config.max_speed_mm_s[axis];
    if (!(value >= WAAM_STEPS_LEAST && value <= WAAM_STEPS_MOST))
        return fail_axis(error, WAAM_E_NUMBER, axis, " must lie within ", WAAM_STEPS_LEAST, " .. ", WAAM_STEPS_MOST);
    if (value * speed > WAAM_STEP_RATE_MOST)
        return fail_axis(error, WAAM_E_CONTRADICTION, axis, ": at ", speed, " mm/s there are pulses for at most ",
                         WAAM_STEP_RATE_MOST / speed);
    return true;
}

bool waam_core_scale(waam_core_t *core, const double steps_per_mm[WAAM_AXES], waam_error_t *error)
{
    double rounded[WAAM_AXES];
    bool same = true;
    if (!waam_core_settable(core, error))
        return false;
    for (int i = 0; i < WAAM_AXES; i++) {
        rounded[i] = round(steps_per_mm[i] * 1e3) / 1e3;
        same = same && rounded[i] == core->config.steps_per_mm[i];
        if (!fits(core, i, rounded[i], error))
            return false;
    }
    if (same)
        return true;
    if (core->armed)
        return waam_fail(error, WAAM_E_NOT_NOW, 1, "steps per mm only while no job is armed");
    keep_place(core, rounded);
    return true;
}

bool waam_core_scale_axis(waam_core_t *core, int axis, double steps_per_mm, waam_error_t *error)
{
    double wanted[WAAM_AXES];
    for (int i = 0; i < WAAM_AXES; i++)
        wanted[i] = i == axis ? steps_per_mm : core->config.steps_per_mm[i];
    return waam_core_scale(core, wanted, error);
}
