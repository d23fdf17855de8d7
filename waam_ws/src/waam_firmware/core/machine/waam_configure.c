/* Immediate line "$C <name> <value>": one setting of the standoff control, the input shaper, the wire, the axes, the gantry
 * or the temperature of the part. */
#include <math.h>

#include "waam_accel.h"
#include "waam_gantry.h"
#include "waam_request.h"
#include "waam_scale.h"
#include "waam_wire_settings.h"

typedef struct {
    const char *text;
    uint32_t length;
} name_t;

static void refuse_value(waam_request_t *r, const waam_setting_t *setting)
{
    waam_request_refuse(r, WAAM_E_NUMBER, setting->name);
    waam_setting_range(setting, &r->answer);
}

static void refuse_because(waam_request_t *r, const char *name, const char *why)
{
    waam_request_refuse(r, WAAM_E_CONTRADICTION, name);
    waam_text_add(&r->answer, ": ");
    waam_text_add(&r->answer, why);
}

static name_t read_name(waam_request_t *r)
{
    waam_skip_spaces(&r->args);
    size_t start = r->args.at;
    while (r->args.at < r->args.length && r->args.text[r->args.at] > ' ')
        r->args.at++;
    return (name_t){r->args.text + start, (uint32_t)(r->args.at - start)};
}

static void configure_standoff(waam_request_t *r, const waam_setting_t *setting, double value)
{
    waam_core_t *core = r->core;
    waam_standoff_config_t changed = core->config.standoff;
    if (!waam_setting_put(setting, &changed, value)) {
        refuse_value(r, setting);
        return;
    }
    if (changed.source != WAAM_STANDOFF_OFF && (setting = waam_standoff_check(&changed)) != NULL) {
        waam_request_refuse(r, WAAM_E_CONTRADICTION, setting->name);
        waam_text_add(&r->answer, " does not fit the source");
        return;
    }
    core->config.standoff = changed;
    waam_standoff_init(&core->standoff);
    waam_request_ok(r);
}

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

static void configure_shaper(waam_request_t *r, const waam_setting_t *setting, double value)
{
    waam_shaper_config_t changed = r->core->config.shaper;
    if (!waam_setting_put(setting, &changed, value)) {
        refuse_value(r, setting);
        return;
    }
    const char *why = waam_core_tune(r->core, &changed);
    if (why) {
        refuse_because(r, setting->name, why);
        return;
    }
    waam_request_ok(r);
    if (r->core->shaper.on)
        tell_shaper(r);
}

/* The shaper in force must still fit into the lead of the wire. */
static void configure_wire(waam_request_t *r, const waam_setting_t *setting, double value)
{
    waam_config_t *config = &r->core->config;
    const waam_shaper_config_t shaper = config->shaper;
    double before = waam_setting_get(setting, config);
    if (!waam_setting_put(setting, config, value)) {
        refuse_value(r, setting);
        return;
    }
    const char *why = waam_core_tune(r->core, &shaper);
    if (why) {
        waam_setting_put(setting, config, before);
        waam_core_tune(r->core, &shaper);
        refuse_because(r, setting->name, why);
        return;
    }
    waam_request_ok(r);
}

static void configure_temperature(waam_request_t *r, const waam_setting_t *setting, double value)
{
    waam_temperature_config_t changed = r->core->config.temperature;
    if (!waam_setting_put(setting, &changed, value)) {
        refuse_value(r, setting);
        return;
    }
    if (!r->core->config.part_temperature) {
        waam_request_refuse(r, WAAM_E_NOT_NOW, "this controller has no input for it");
        return;
    }
    if (changed.input != WAAM_TEMPERATURE_OFF && !(changed.high_c > changed.low_c)) {
        refuse_because(r, setting->name, "the upper end must be above the lower one");
        return;
    }
    r->core->config.temperature = changed;
    r->core->temperature = (waam_temperature_t){0};
    waam_request_ok(r);
}

static void refuse_error(waam_request_t *r, const waam_error_t *error)
{
    waam_request_refuse(r, error->code, "");
    waam_text_bytes(&r->answer, error->text.text, error->text.length);
}

static void configure_scale(waam_request_t *r, const waam_setting_t *setting, double value)
{
    waam_error_t error;
    if (waam_core_scale_axis(r->core, (int)(setting - waam_scale_settings), value, &error))
        waam_request_ok(r);
    else
        refuse_error(r, &error);
}

static void configure_accel(waam_request_t *r, const waam_setting_t *setting, double value)
{
    waam_error_t error;
    if (waam_core_accelerate(r->core, (int)(setting - waam_accel_settings), value, &error))
        waam_request_ok(r);
    else
        refuse_error(r, &error);
}

static void configure_gantry(waam_request_t *r, const waam_setting_t *setting, double value)
{
    waam_error_t error;
    if (waam_core_set_gantry(r->core, setting, value, &error))
        waam_request_ok(r);
    else
        refuse_error(r, &error);
}

void waam_order_configure(waam_request_t *r)
{
    if (waam_at_end(&r->args)) {
        waam_request_settings(r, waam_gantry_settings, waam_gantry_settings_count, &r->core->config);
        waam_request_settings(r, waam_scale_settings, WAAM_AXES, &r->core->config);
        return;
    }
    const name_t name = read_name(r);
    const waam_setting_t *standoff = waam_standoff_setting(name.text, name.length);
    const waam_setting_t *shaper = waam_shaper_setting(name.text, name.length);
    const waam_setting_t *wire = waam_wire_setting(name.text, name.length);
    const waam_setting_t *scale = waam_scale_setting(name.text, name.length);
    const waam_setting_t *accel = waam_accel_setting(name.text, name.length);
    const waam_setting_t *gantry = waam_gantry_setting(name.text, name.length);
    const waam_setting_t *temperature = waam_temperature_setting(name.text, name.length);
    waam_error_t error;
    double value;
    if (!waam_core_settable(r->core, &error)) {
        refuse_error(r, &error);
        return;
    }
    if (!standoff && !shaper && !wire && !scale && !accel && !gantry && !temperature) {
        waam_request_refuse(r, WAAM_E_UNKNOWN_WORD, "no setting has this name");
        return;
    }
    if (!waam_request_numbers(r, &value, 1))
        return;
    if (standoff)
        configure_standoff(r, standoff, value);
    else if (scale)
        configure_scale(r, scale, value);
    else if (accel)
        configure_accel(r, accel, value);
    else if (gantry)
        configure_gantry(r, gantry, value);
    else if (wire)
        configure_wire(r, wire, value);
    else if (temperature)
        configure_temperature(r, temperature, value);
    else
        configure_shaper(r, shaper, value);
}
