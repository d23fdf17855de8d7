/* Settings of the standoff control (the torch held at its distance while the arc burns): data only. */
#ifndef WAAM_STANDOFF_SETTINGS_H
#define WAAM_STANDOFF_SETTINGS_H

#include <stdint.h>

typedef enum {
    WAAM_STANDOFF_OFF,          /* the programmed z, nothing else */
    WAAM_STANDOFF_LASER,        /* triangulation: readings in mm */
    WAAM_STANDOFF_INFRARED,     /* GP2Y0A41SK0F behind a 10-bit converter of 5 V: readings in counts */
    WAAM_STANDOFF_ARC           /* no sensor: contact distance from current, voltage and wire speed */
} waam_standoff_source_t;

typedef enum {
    WAAM_STANDOFF_RELAY,        /* eight steps of speed */
    WAAM_STANDOFF_PID           /* on speed */
} waam_standoff_law_t;

typedef struct {
    uint32_t source, law;       /* waam_standoff_source_t, waam_standoff_law_t */
    float set_mm;               /* distance to hold: from the sensor to the metal; by the arc: contact distance */
    float dead_mm;              /* an error up to this moves nothing */
    float up_mm, down_mm;       /* greatest correction either way of the programmed z */
    float rate_mm_s, accel_mm_s2; /* of the correction */
    float rc_s;                 /* time constant of the first filter; 0 = none */
    uint32_t average;           /* readings of the moving average, 1..8 */
    float packet_s;             /* between two looks of the law */
    float pulse_mm;             /* relay: way of one pulse (lead screw of 0.02 mm per step over the step division) */
    float kp, ki, kd;           /* PID: mm/s per mm, per mm and second, per mm/s */
    float lead_mm;              /* along the path from the arc to where the sensor looks */
    float window_mm;            /* a reading further from set_mm than this is none: an edge */
    float jump_mm, confirm_s;   /* a change by more is believed when it has lasted for so long */
    float lost_s;               /* longest time without a reading that can be believed */
    float stuck_s;              /* the same reading to the last bit for so long is none; 0 = not watched */
    float settle_s;             /* after the arc is established: not followed */
    float approach_s;           /* longest time that a strike waits for the distance; 0 = no wait */
    float answer_mm;            /* correction beyond the error itself after which the error must have gone */
    float limit_s;              /* longest time at a limit */
    float cross_mm;             /* most that sensor and arc may differ; 0 = not watched */
    float arc_average_s;        /* of the contact distance by the arc */
    float arc_bend;             /* change of the exponent of the current per unit of ln(wire speed) */
    float arc_fall_a_per_v;     /* current that a longer arc takes away, per volt of it */
    float arc_wander_mm;        /* standard deviation of a wandering contact tip and wire, as a distance; 0 = steady */
    float arc_rise_mm2_s;       /* where they wander: growth of the variance of the metal's height, per s */
} waam_standoff_config_t;

#endif
