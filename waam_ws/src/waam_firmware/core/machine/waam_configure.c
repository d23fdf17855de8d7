/* Immediate line "$C <name> <value>": one setting of the standoff control, the input shaper, the wire, the axes, the gantry
 * or the temperature of the part. */
#include <math.h>

#include "waam_accel.h"
#include "waam_gantry.h"
#include "waam_request.h"
#include "waam_scale.h"
#include "waam_wire_settings.h"

static bool fail_because(waam_error_t *error, const char *name, const char *why)
{
    waam_fail(error, WAAM_E_CONTRADICTION, 1, name);
    waam_text_add(&error->text, why);
    return false;
}

static bool set_standoff(waam_core_t *core, const waam_setting_t *setting, double value, waam_error_t *error)
{
    waam_standoff_config_t changed = core->config.standoff;
    if (!waam_setting_put(setting, &changed, value))
        return waam_fail_range(error, setting);
    if (changed.source != WAAM_STANDOFF_OFF && (setting = waam_standoff_check(&changed)) != NULL)
        return fail_because(error, setting->name, " does not fit the source");
    core->config.standoff = changed;
    waam_standoff_init(&core->standoff);
    return true;
}

static bool set_shaper(waam_core_t *core, const waam_setting_t *setting, double value, waam_error_t *error)
{
    waam_shaper_config_t changed = core->config.shaper;
    if (!waam_setting_put(setting, &changed, value))
        return waam_fail_range(error, setting);
    const char *why = waam_core_tune(core, &changed);
    if (!why)
        return true;
    fail_because(error, setting->name, ": ");
    waam_text_add(&error->text, why);
    return false;
}

/* The shaper in force must still fit into the lead of the wire. */
static bool set_wire(waam_core_t *core, const waam_setting_t *setting, double value, waam_error_t *error)
{
    const waam_shaper_config_t shaper = core->config.shaper;
    double before = waam_setting_get(setting, &core->config);
    if (!waam_setting_put(setting, &core->config, value))
        return waam_fail_range(error, setting);
    const char *why = waam_core_tune(core, &shaper);
    if (!why)
        return true;
    waam_setting_put(setting, &core->config, before);
    waam_core_tune(core, &shaper);
    fail_because(error, setting->name, ": ");
    waam_text_add(&error->text, why);
    return false;
}

static bool set_temperature(waam_core_t *core, const waam_setting_t *setting, double value, waam_error_t *error)
{
    waam_temperature_config_t changed = core->config.temperature;
    if (!waam_setting_put(setting, &changed, value))
        return waam_fail_range(error, setting);
    if (!core->config.part_temperature)
        return waam_fail(error, WAAM_E_NOT_NOW, 1, "this controller has no input for it");
    if (changed.input != WAAM_TEMPERATURE_OFF && !(changed.high_c > changed.low_c))
        return fail_because(error, setting->name, ": the upper end must be above the lower one");
    core->config.temperature = changed;
    core->temperature = (waam_temperature_t){0};
    return true;
}

static const struct {
    const waam_setting_t *settings;
    bool (*set)(waam_core_t *core, const waam_setting_t *setting, double value, waam_error_t *error);
} groups[] = {
    {waam_standoff_settings, set_standoff}, {waam_shaper_settings, set_shaper}, {waam_wire_settings, set_wire},
    {waam_scale_settings, waam_core_scale}, {waam_accel_settings, waam_core_accelerate},
    {waam_gantry_settings, waam_core_set_gantry}, {waam_temperature_settings, set_temperature},
};

/* What the shaper in force does to the motion: mean delay, time to its end, and the rounding of a right angle (um per mm/s
 * of speed in the corner, and um at rest by the greater acceleration of X and Y), and the speed at which one is passed. */
static void tell_shaper(waam_request_t *r)
{
    const waam_shaper_t *s = &r->core->shaper;
    const double *accel = r->core->config.accel_mm_s2;
    const float right_angle = 1.5707963f, most = (float)fmax(accel[0], accel[1]);
    waam_text_add(&r->answer, " delay_ms=");
    waam_text_fixed(&r->answer, (double)s->delay_s * 1e3, 2);
    waam_text_add(&r->answer, " span_ms=");
    waam_text_fixed(&r->answer, s->span * r->core->shaper_tick_us * 1e-3, 1);
    waam_text_add(&r->answer, " corner_um=");
    waam_text_fixed(&r->answer, (double)waam_shaper_corner_mm(s, 1.0f, 0.0f, right_angle) * 1e3, 2);
    waam_text_char(&r->answer, ',');
    waam_text_fixed(&r->answer, (double)waam_shaper_corner_mm(s, 0.0f, most, right_angle) * 1e3, 2);
    waam_text_add(&r->answer, " corner_mm_s=");
    waam_text_fixed(&r->answer, (double)waam_rounding_corner(&r->core->planner.rounding, sinf(0.5f * right_angle), 0.0f), 2);
}

static void refuse(waam_request_t *r, const waam_error_t *error)
{
    waam_request_refuse(r, error->code, "");
    waam_text_bytes(&r->answer, error->text.text, error->text.length);
}

static void configure(waam_request_t *r, size_t group, const waam_setting_t *setting)
{
    waam_error_t error;
    double value;
    if (!waam_request_numbers(r, &value, 1))
        return;
    if (!groups[group].set(r->core, setting, value, &error)) {
        refuse(r, &error);
        return;
    }
    waam_request_ok(r);
    if (groups[group].settings == waam_shaper_settings && r->core->shaper.on)
        tell_shaper(r);
}

void waam_order_configure(waam_request_t *r)
{
    waam_error_t error;
    if (waam_at_end(&r->args)) {
        waam_request_settings(r, waam_gantry_settings, &r->core->config);
        waam_request_settings(r, waam_scale_settings, &r->core->config);
        return;
    }
    size_t start = r->args.at;
    while (r->args.at < r->args.length && r->args.text[r->args.at] > ' ')
        r->args.at++;
    if (!waam_core_settable(r->core, &error)) {
        refuse(r, &error);
        return;
    }
    for (size_t i = 0; i < sizeof groups / sizeof groups[0]; i++) {
        const waam_setting_t *setting = waam_setting_find(groups[i].settings, r->args.text + start, r->args.at - start);
        if (setting) {
            configure(r, i, setting);
            return;
        }
    }
    waam_request_refuse(r, WAAM_E_UNKNOWN_WORD, "no setting has this name");
}
