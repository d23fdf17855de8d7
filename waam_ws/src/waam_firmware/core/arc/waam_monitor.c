#include "waam_monitor.h"

/* True once a condition has lasted for `limit_us`. */
static bool lasts(uint32_t *timer_us, bool condition, uint32_t limit_us, uint32_t dt_us)
{
    *timer_us = !condition ? 0 : *timer_us > limit_us ? *timer_us : *timer_us + dt_us;
    return condition && *timer_us >= limit_us;
}

bool waam_monitor_plausible(const waam_monitor_config_t *c, float voltage_v, float current_a)
{
    return voltage_v >= c->voltage_min_v && voltage_v <= c->voltage_max_v && current_a >= c->current_min_a &&
           current_a <= c->current_max_a; /* false for what is not a number */
}

waam_trip_t waam_monitor_step(waam_monitor_t *m, const waam_monitor_config_t *c, bool on, bool burning, float setpoint_v,
                              float voltage_v, float current_a, uint32_t dt_us)
{
    bool good = waam_monitor_plausible(c, voltage_v, current_a), watched = burning && good && c->stuck_us;
    bool same_v = watched && voltage_v == m->voltage_v, same_a = watched && current_a == m->current_a;
    if (good) {
        m->voltage_v = voltage_v;
        m->current_a = current_a;
    }
    bool flows = m->current_a > c->short_a;
    if (lasts(&m->bad_us, !good, c->bad_us, dt_us))
        return WAAM_TRIP_BAD_SAMPLE;
    if (lasts(&m->short_us, burning && flows && m->voltage_v < c->short_v, c->short_us, dt_us))
        return WAAM_TRIP_SHORT;
    if (lasts(&m->long_arc_us, burning && flows && m->voltage_v > setpoint_v + c->long_arc_v, c->long_arc_us, dt_us))
        return WAAM_TRIP_LONG_ARC;
    if (lasts(&m->same_voltage_us, same_v, c->stuck_us, dt_us))
        return WAAM_TRIP_STUCK_VOLTAGE;
    if (lasts(&m->same_current_us, same_a, c->stuck_us, dt_us))
        return WAAM_TRIP_STUCK_CURRENT;
    if (lasts(&m->stray_us, !on && flows, c->stray_us, dt_us))
        return WAAM_TRIP_STRAY_CURRENT;
    return WAAM_TRIP_NONE;
}

const char *waam_trip_text(waam_trip_t trip)
{
    static const char *const texts[] = {
        "", "stubbing: the wire stays short-circuited", "burn-back: the arc climbs to the contact tip",
        "arc sensor: not a number or out of range", "arc voltage sensor stuck", "arc current sensor stuck",
        "arc current although the source is off", "the controller's tick stood still for 20 ms"};
    return texts[trip];
}
