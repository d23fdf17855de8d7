#include "waam_temperature.h"

#include <math.h>

#define AT(field) offsetof(waam_temperature_config_t, field)

const waam_setting_t waam_temperature_settings[] = {
    {"temperature_input", WAAM_TEMPERATURE_OFF, WAAM_TEMPERATURE_AMPLIFIER, WAAM_SETTING_WHOLE, AT(input)},
    {"temperature_low_c", -273.0f, 3000.0f, WAAM_SETTING_DOUBLE, AT(low_c)},
    {"temperature_high_c", -273.0f, 3000.0f, WAAM_SETTING_DOUBLE, AT(high_c)},
    {0}, /* ends the list */
};

/* V at the converter, where every circuit brings the upper end to 3 V (10 V by a divider, 20 mA by 150 ohm): both ends, and
 * beyond what it is no reading. A loop below 3.6 or above 21 mA says that its instrument has failed (NAMUR NE 43); 0 V is a
 * broken wire as well. */
static const struct {
    float low_v, high_v, least_v, most_v;
} signal[] = {
    [WAAM_TEMPERATURE_VOLTAGE] = {0.0f, 3.0f, 0.015f, 3.15f},
    [WAAM_TEMPERATURE_LOOP] = {0.6f, 3.0f, 0.54f, 3.15f},
    [WAAM_TEMPERATURE_AMPLIFIER] = {0.0f, 3.0f, 0.005f, 3.15f},
};

void waam_temperature_read(waam_temperature_t *t, const waam_temperature_config_t *config, float v)
{
    waam_temperature_fault_t fault = v < signal[config->input].least_v    ? WAAM_TEMPERATURE_BELOW
                                     : v > signal[config->input].most_v ? WAAM_TEMPERATURE_ABOVE
                                     : v == v                           ? WAAM_TEMPERATURE_KNOWN
                                                                        : WAAM_TEMPERATURE_NO_READING;
    t->count[fault]++;
    if (fault == WAAM_TEMPERATURE_KNOWN)
        t->sum_v += v;
}

static waam_temperature_fault_t most(const waam_temperature_t *t)
{
    uint32_t all = 0, worst = WAAM_TEMPERATURE_BELOW;
    for (uint32_t i = 0; i <= WAAM_TEMPERATURE_NO_READING; i++) {
        all += t->count[i];
        if (i > worst && t->count[i] > t->count[worst])
            worst = i;
    }
    return 2 * t->count[WAAM_TEMPERATURE_KNOWN] > all ? WAAM_TEMPERATURE_KNOWN : (waam_temperature_fault_t)worst;
}

bool waam_temperature_line(waam_temperature_t *t, const waam_temperature_config_t *config, uint64_t now_us, waam_text_t *line)
{
    if (now_us < t->due_us)
        return false;
    waam_temperature_fault_t fault = most(t);
    waam_text_add(line, "P ");
    waam_text_uint(line, now_us - WAAM_TEMPERATURE_US / 2);
    waam_text_char(line, ',');
    waam_text_uint(line, fault);
    waam_text_char(line, ',');
    if (fault == WAAM_TEMPERATURE_KNOWN) {
        float low_v = signal[config->input].low_v, high_v = signal[config->input].high_v;
        float share = (t->sum_v / (float)t->count[WAAM_TEMPERATURE_KNOWN] - low_v) / (high_v - low_v);
        waam_text_int(line, llround((config->low_c + (double)share * (config->high_c - config->low_c)) * 1000.0));
    }
    *t = (waam_temperature_t){.due_us = now_us + WAAM_TEMPERATURE_US};
    return true;
}
