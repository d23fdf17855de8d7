/* The torch held at its distance: distance -> law -> correction of the programmed z, and what ends it. Single precision, no
 * library calls in the tick but logf and expf once for the arc. Source 001.
 *
 * The correction lies on top of the programmed z and is a closed loop around the distance itself. Where the program follows
 * a map that is right, the error is 0 and so is the correction: the two never add up twice. It begins at 0 with every arc. */
#ifndef WAAM_STANDOFF_H
#define WAAM_STANDOFF_H

#include "waam_arc_level.h"
#include "waam_arc_settings.h"
#include "waam_distance.h"
#include "waam_setting.h"

#define WAAM_STANDOFF_PREVIEW 32u      /* heights ahead of the arc that are remembered */
#define WAAM_STANDOFF_PREVIEW_MM 0.5f  /* of path between two of them */

typedef enum {
    WAAM_STANDOFF_WELL,
    WAAM_STANDOFF_LOST,         /* no reading that can be believed */
    WAAM_STANDOFF_STUCK,
    WAAM_STANDOFF_NO_ANSWER,    /* the error stays although the torch moves: wrong sign, wrong sensor */
    WAAM_STANDOFF_LIMIT,
    WAAM_STANDOFF_CONTRADICTION /* sensor and arc disagree */
} waam_standoff_alarm_t;

typedef enum { WAAM_STANDOFF_STAY, WAAM_STANDOFF_APPROACH, WAAM_STANDOFF_FOLLOW, WAAM_STANDOFF_RETURN } waam_standoff_mode_t;

typedef struct {
    waam_standoff_mode_t mode;  /* APPROACH: before the strike; FOLLOW: the arc burns and has settled */
    bool lit;                   /* the arc burns and has settled */
    uint32_t reading;           /* counts up with every reading of the sensor */
    float value;                /* of it: mm or counts; NaN = no echo */
    float current_a, voltage_v, source_v, wire_mm_s;
    float z_mm;                 /* of the axis, correction included */
    float travelled_mm;         /* along the path, counts up */
    bool turned;                /* the path has changed its direction: what was seen ahead lies elsewhere */
    float room_up_mm, room_down_mm; /* to the soft limits */
    float most_mm;              /* that the axis can do in this tick beside the path */
} waam_standoff_inputs_t;

typedef struct {
    float correction_mm, speed_mm_s;
    float wanted_mm_s;          /* by the law, until the next packet */
    float measured_mm;          /* filtered, at the arc */
    bool known;                 /* there is a measured distance */
    waam_standoff_alarm_t alarm;/* stands until the next arc; the torch goes back to its program, unless `held` */
    bool told;                  /* the alarm, to the host */
    bool held;                  /* the alarm is the upper limit, and the arc agrees that the metal is so high: no way back */
    uint32_t alarms;            /* since the start */
    float packet_s;
    waam_distance_t distance;
    /* PID */
    float integral_mm_s, before_mm;
    bool has_before;
    /* the way from the sensor's spot to the arc */
    float ahead_mm[WAAM_STANDOFF_PREVIEW];
    uint32_t ahead_first, ahead_count; /* numbers of the places along the path */
    /* contact distance by the arc */
    float arc_mm, arc_now_mm, arc_bias_mm, arc_sum_mm, arc_s, arc_old_s; /* arc_now_mm: not filtered */
    uint32_t arc_samples;
    bool arc_known, arc_learned;
    float arc_out_s;            /* since the arc was followed last */
    waam_arc_level_t level;     /* where contact tip or wire wander */
    float following_s, waited_s, limit_s, apart_s;
    /* does the error answer? */
    bool asking;
    float asked_s, asked_mm, asked_from_mm;
} waam_standoff_t;

void waam_standoff_init(waam_standoff_t *s);
/* A new arc: alarms are forgotten. */
void waam_standoff_arm(waam_standoff_t *s);
/* A new job: the arc's current is compared anew. */
void waam_standoff_forget(waam_standoff_t *s);
/* The machine rests: what is laid from now on may follow a newer map. */
void waam_standoff_rest(waam_standoff_t *s);
/* One tick: changes s->correction_mm. */
void waam_standoff_tick(waam_standoff_t *s, const waam_standoff_config_t *c, const waam_ctwd_model_t *arc,
                        const waam_standoff_inputs_t *in, float dt_s);
/* The strike need not wait any longer. */
bool waam_standoff_ready(const waam_standoff_t *s, const waam_standoff_config_t *c);
/* Pulses of a packet of the relay, for the size of an error in mm. */
uint32_t waam_standoff_pulses(float error_mm);
/* What is wrong, and what the torch does. */
const char *waam_standoff_text(const waam_standoff_t *s);

/* ---- settings (waam_standoff_settings.c) ---- */

waam_standoff_config_t waam_standoff_default(void);
/* Places in waam_standoff_config_t: names and ranges. */
extern const waam_setting_t waam_standoff_settings[];
/* NULL, or the setting that is out of its range or does not fit the source. */
const waam_setting_t *waam_standoff_check(const waam_standoff_config_t *c);

#endif
