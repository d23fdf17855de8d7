/* Watches every sample of arc voltage and current for what the arc does not survive and for sensors that lie. */
#ifndef WAAM_MONITOR_H
#define WAAM_MONITOR_H

#include "waam_arc_settings.h"

typedef enum {
    WAAM_TRIP_NONE,
    WAAM_TRIP_SHORT,            /* stubbing: the wire stays in the pool */
    WAAM_TRIP_LONG_ARC,         /* burn-back: the arc climbs to the contact tip */
    WAAM_TRIP_BAD_SAMPLE,       /* not a number, or outside what the sensor can give */
    WAAM_TRIP_STUCK_VOLTAGE,
    WAAM_TRIP_STUCK_CURRENT,
    WAAM_TRIP_STRAY_CURRENT,    /* current although the source is off */
    WAAM_TRIP_LATE              /* of the fast tick itself: nobody has renewed its orders */
} waam_trip_t;

typedef struct {
    float voltage_v, current_a; /* last good sample */
    uint32_t short_us, long_arc_us, bad_us, same_voltage_us, same_current_us, stray_us;
} waam_monitor_t;

/* Within what the sensors can give; false for what is not a number. */
bool waam_monitor_plausible(const waam_monitor_config_t *config, float voltage_v, float current_a);
/* One sample; `on`: the source is enabled, `burning`: the arc is established. */
waam_trip_t waam_monitor_step(waam_monitor_t *monitor, const waam_monitor_config_t *config, bool on, bool burning,
                              float setpoint_v, float voltage_v, float current_a, uint32_t dt_us);
const char *waam_trip_text(waam_trip_t trip);

#endif
