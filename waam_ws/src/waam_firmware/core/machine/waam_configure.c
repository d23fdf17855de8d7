/* Immediate line "$C <name> <value>": one setting of the standoff control. */
#include "waam_request.h"

static void refuse_value(waam_request_t *r, const waam_standoff_setting_t *setting)
{
    waam_request_refuse(r, WAAM_E_NUMBER, "");
    waam_text_add(&r->answer, setting->name);
    waam_text_add(&r->answer, setting->whole ? " must be a whole number within " : " must lie within ");
    waam_text_fixed(&r->answer, (double)setting->lowest, 5);
    waam_text_add(&r->answer, " .. ");
    waam_text_fixed(&r->answer, (double)setting->highest, 5);
}

static const waam_standoff_setting_t *named(waam_request_t *r)
{
    waam_skip_spaces(&r->args);
    size_t start = r->args.at;
    while (r->args.at < r->args.length && r->args.text[r->args.at] > ' ')
        r->args.at++;
    return waam_standoff_setting(r->args.text + start, (uint32_t)(r->args.at - start));
}

void waam_order_configure(waam_request_t *r)
{
    waam_core_t *core = r->core;
    const waam_standoff_setting_t *setting = named(r);
    double value;
    if ((core->state != WAAM_IDLE && core->state != WAAM_ALARM) || core->planner.count > 0) {
        waam_request_refuse(r, WAAM_E_NOT_NOW, "settings only in IDLE or ALARM");
        return;
    }
    if (!setting) {
        waam_request_refuse(r, WAAM_E_UNKNOWN_WORD, "no setting has this name");
        return;
    }
    if (!waam_request_numbers(r, &value, 1))
        return;
    waam_standoff_config_t changed = core->config.standoff;
    if (!waam_standoff_set(&changed, setting, value)) {
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
