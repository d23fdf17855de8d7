/* From readings of a distance sensor to a distance: linearisation, plausibility, filters. */
#ifndef WAAM_DISTANCE_H
#define WAAM_DISTANCE_H

#include <stdbool.h>

#include "waam_standoff_settings.h"

#define WAAM_STANDOFF_AVERAGE 8u

/* Why there is no distance. */
typedef enum {
    WAAM_DISTANCE_GOOD,
    WAAM_DISTANCE_NONE,         /* no reading, or not a number */
    WAAM_DISTANCE_OUTSIDE,      /* beyond the window around the distance to hold */
    WAAM_DISTANCE_JUMP,         /* differs too much from the one before, not confirmed yet */
    WAAM_DISTANCE_STUCK
} waam_distance_quality_t;

typedef struct {
    uint32_t reading;           /* number of the last one */
    bool started;
    float raw;                  /* the last one as it came */
    float same_s, held_s;       /* for so long: the same value, no new reading */
    waam_distance_quality_t quality;
    float last_mm, candidate_mm, candidate_s;
    bool has_last, has_candidate;
    float bad_s;                /* since the last good reading */
    float rc_mm;
    bool fresh;                 /* a good reading came since the moving average took one */
    float ring[WAAM_STANDOFF_AVERAGE]; /* distance less z, mm */
    uint32_t count, next;
} waam_distance_t;

/* Distance of the infrared sensor, mm, from counts of the converter (10 bit, 5 V); good from 35 to 400 mm. The polynomial of
 * source 001; 266 counts are 99.91 mm. */
float waam_infrared_mm(float counts);

/* Forgets everything but the number of the last reading. */
void waam_distance_start(waam_distance_t *d);
/* The sensor looks at another place: its next reading is no jump. */
void waam_distance_elsewhere(waam_distance_t *d);
/* One tick. `reading` counts up with every new `value` (mm, or counts for the infrared sensor; NaN = no echo). */
void waam_distance_tick(waam_distance_t *d, const waam_standoff_config_t *c, uint32_t reading, float value, float dt_s);
/* Every packet: hands what the first filter has to the moving average. *relative_mm: mean of distance less z, so that what
 * the axis itself moves does not wait in the filter. False: nothing good came since the last packet. */
bool waam_distance_packet(waam_distance_t *d, const waam_standoff_config_t *c, float z_mm, float *relative_mm);

#endif
