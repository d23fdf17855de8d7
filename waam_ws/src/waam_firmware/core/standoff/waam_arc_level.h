/* Contact distance by an arc whose contact tip and wire wander: such a wander looks like a distance, so only what lasts longer
 * is believed, and the map is the reference. */
#ifndef WAAM_ARC_LEVEL_H
#define WAAM_ARC_LEVEL_H

#include <stdbool.h>
#include <stdint.h>

#include "waam_standoff_settings.h"

/* A Kalman filter of two states; their sum is measured. */
typedef struct {
    float gap_mm;               /* contact distance beyond the one to hold, were the correction 0 */
    float bias_mm;              /* of the arc's current, by wear, wire and calibration */
    float gap_mm2, both_mm2, bias_mm2; /* covariance */
    float sum_mm, span_s;       /* of the samples that wait */
    uint32_t samples;
    bool renewed;               /* the map is newer than what is known of the gap */
    bool known;
} waam_arc_level_t;

/* A new job: nothing is known of the arc's current. */
waam_arc_level_t waam_arc_level_new(void);
/* The arc has burned again after `out_s` without. */
void waam_arc_level_strike(waam_arc_level_t *a, const waam_standoff_config_t *c, float out_s);
/* A sample: contact distance by the arc less set_mm and correction, dt_s after the one before. */
void waam_arc_level_add(waam_arc_level_t *a, const waam_standoff_config_t *c, float mm, float dt_s);

#endif
