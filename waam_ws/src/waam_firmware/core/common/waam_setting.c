#include "waam_setting.h"

#include <math.h>
#include <stdint.h>

static bool is(const char *bytes, size_t count, const char *name)
{
    size_t k = 0;
    while (k < count && name[k] && name[k] == bytes[k])
        k++;
    return k == count && !name[k];
}

const waam_setting_t *waam_setting_find(const waam_setting_t *list, const char *name, size_t length)
{
    for (; list->name; list++)
        if (is(name, length, list->name))
            return list;
    return NULL;
}

bool waam_setting_put(const waam_setting_t *setting, void *into, double value)
{
    void *at = (char *)into + setting->at;
    if (!(value >= (double)setting->lowest && value <= (double)setting->highest))
        return false;
    if (setting->type == WAAM_SETTING_FLOAT)
        *(float *)at = (float)value;
    else if (setting->type == WAAM_SETTING_DOUBLE)
        *(double *)at = value;
    else if (setting->type == WAAM_SETTING_SIGN ? fabs(value) != 1.0 : (double)(uint32_t)value != value)
        return false;
    else if (setting->type == WAAM_SETTING_SIGN)
        *(int8_t *)at = (int8_t)value;
    else
        *(uint32_t *)at = (uint32_t)value;
    return true;
}

double waam_setting_get(const waam_setting_t *setting, const void *from)
{
    const void *at = (const char *)from + setting->at;
    if (setting->type == WAAM_SETTING_FLOAT)
        return (double)*(const float *)at;
    if (setting->type == WAAM_SETTING_SIGN)
        return (double)*(const int8_t *)at;
    return setting->type == WAAM_SETTING_DOUBLE ? *(const double *)at : (double)*(const uint32_t *)at;
}

void waam_setting_range(const waam_setting_t *setting, waam_text_t *text)
{
    if (setting->type == WAAM_SETTING_SIGN) {
        waam_text_add(text, " must be -1 or 1");
        return;
    }
    bool whole = setting->type == WAAM_SETTING_WHOLE;
    waam_text_add(text, whole ? " must be a whole number within " : " must lie within ");
    waam_text_fixed(text, (double)setting->lowest, 5);
    waam_text_add(text, " .. ");
    waam_text_fixed(text, (double)setting->highest, 5);
}
