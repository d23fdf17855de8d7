#include "waam_standoff.h"

#define AT(name) offsetof(waam_standoff_config_t, name)
#define NUMBER(name, low, high) {#name, low, high, WAAM_SETTING_FLOAT, AT(name)}
#define WHOLE(name, low, high) {#name, low, high, WAAM_SETTING_WHOLE, AT(name)}

const waam_setting_t waam_standoff_settings[] = {
    WHOLE(source, 0.0f, 3.0f),
    WHOLE(law, 0.0f, 1.0f),
    NUMBER(set_mm, 5.0f, 400.0f),
    NUMBER(dead_mm, 0.0f, 2.0f),
    NUMBER(up_mm, 0.0f, 20.0f),
    NUMBER(down_mm, 0.0f, 20.0f),
    NUMBER(rate_mm_s, 0.05f, 20.0f),
    NUMBER(accel_mm_s2, 1.0f, 10000.0f),
    NUMBER(rc_s, 0.0f, 1.0f),
    WHOLE(average, 1.0f, (float)WAAM_STANDOFF_AVERAGE),
    NUMBER(packet_s, 0.001f, 0.1f),
    NUMBER(pulse_mm, 1e-5f, 0.02f),
    NUMBER(kp, 0.0f, 50.0f),
    NUMBER(ki, 0.0f, 200.0f),
    NUMBER(kd, 0.0f, 2.0f),
    NUMBER(lead_mm, 0.0f, 15.0f),
    NUMBER(window_mm, 0.5f, 50.0f),
    NUMBER(jump_mm, 0.05f, 50.0f),
    NUMBER(confirm_s, 0.0f, 1.0f),
    NUMBER(lost_s, 0.02f, 5.0f),
    NUMBER(stuck_s, 0.0f, 60.0f),
    NUMBER(settle_s, 0.0f, 10.0f),
    NUMBER(approach_s, 0.0f, 10.0f),
    NUMBER(answer_mm, 0.2f, 20.0f),
    NUMBER(limit_s, 0.1f, 60.0f),
    NUMBER(cross_mm, 0.0f, 20.0f),
    NUMBER(arc_average_s, 0.01f, 5.0f),
    NUMBER(arc_bend, -0.5f, 0.5f),
    NUMBER(arc_fall_a_per_v, 0.0f, 50.0f),
    NUMBER(arc_wander_mm, 0.0f, 5.0f),
    NUMBER(arc_rise_mm2_s, 1e-4f, 10.0f),
    {0}, /* ends the list */
};

/* The values for a laser of 0.01 mm; those of the others are in the README. */
waam_standoff_config_t waam_standoff_default(void)
{
    return (waam_standoff_config_t){
        .source = WAAM_STANDOFF_OFF,
        .law = WAAM_STANDOFF_PID,
        .set_mm = 100.0f,
        .dead_mm = 0.03f,
        .up_mm = 6.0f,
        .down_mm = 4.0f,
        .rate_mm_s = 6.0f,
        .accel_mm_s2 = 100.0f,
        .rc_s = 0.0011f,
        .average = 8,
        .packet_s = 0.01f,
        .pulse_mm = 0.00125f,
        .kp = 5.0f,
        .ki = 3.0f,
        .kd = 0.0f,
        .lead_mm = 0.0f,
        .window_mm = 12.0f,
        .jump_mm = 1.0f,
        .confirm_s = 0.1f,
        .lost_s = 0.5f,
        .stuck_s = 2.0f,
        .settle_s = 0.3f,
        .approach_s = 1.5f,
        .answer_mm = 1.0f,
        .limit_s = 1.0f,
        .cross_mm = 5.0f,
        .arc_average_s = 0.3f,
        .arc_bend = -0.044f,
        .arc_fall_a_per_v = 7.0f,
        .arc_wander_mm = 0.0f,
        .arc_rise_mm2_s = 0.2f,
    };
}

const waam_setting_t *waam_standoff_check(const waam_standoff_config_t *c)
{
    for (const waam_setting_t *setting = waam_standoff_settings; setting->name; setting++) {
        double value = waam_setting_get(setting, c);
        if (!(value >= (double)setting->lowest && value <= (double)setting->highest))
            return setting;
    }
    if (c->source == WAAM_STANDOFF_INFRARED && c->set_mm < 35.0f)
        return waam_setting_find(waam_standoff_settings, "set_mm", 6);
    if (c->source == WAAM_STANDOFF_ARC && c->down_mm > 0.5f * c->set_mm)
        return waam_setting_find(waam_standoff_settings, "down_mm", 7); /* else a wrong current could lead the torch into the metal */
    return NULL;
}
