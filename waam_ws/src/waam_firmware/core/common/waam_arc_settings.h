/* Settings of arc, arc regulator and monitor: data only, so that the configuration of the machine can hold them. */
#ifndef WAAM_ARC_SETTINGS_H
#define WAAM_ARC_SETTINGS_H

#include <stdbool.h>
#include <stdint.h>

/* ---- regulator ---- */

typedef struct {
    float kp, ki, kd;       /* output per unit of error, per unit and second, per unit per second */
    float filter_s;         /* time constant of the derivative's filter; 0 = none */
    float weight;           /* share of a setpoint change that proportional and derivative part see, 0..1 */
} waam_pid_gains_t;

#define WAAM_SCHEDULE_CURRENTS 4
#define WAAM_SCHEDULE_DISTANCES 3

typedef enum {
    WAAM_REGULATOR_OFF,         /* the source gets its setpoint as it is */
    WAAM_REGULATOR_SOURCE,      /* arc voltage by the setpoint of the source */
    WAAM_REGULATOR_WIRE         /* arc voltage by wire speed; the plant's gain is negative */
} waam_actuator_t;

/* How much arc voltage one unit of output gives, as a share of the nominal gain, over current and distance; in between it is
 * linear in the distance and in 1/current, for so the slope of an arc's characteristic falls (Ayrton). Held at the ends. */
typedef struct {
    float current_a[WAAM_SCHEDULE_CURRENTS];   /* rising, above 0 */
    float ctwd_mm[WAAM_SCHEDULE_DISTANCES];    /* rising */
    float share[WAAM_SCHEDULE_CURRENTS][WAAM_SCHEDULE_DISTANCES];
} waam_schedule_t;

/* Contact-tip-to-work distance from current and wire speed: I = I0 (w/w0)^p (1 - loss (ctwd - ctwd0)). */
typedef struct {
    float current_a, wire_mm_s, exponent, ctwd_mm, loss_per_mm;
} waam_ctwd_model_t;

typedef struct {
    waam_actuator_t actuator;
    float gain;                 /* of the plant k / (T s + 1) with dead time, nominal: V per unit of output */
    float lag_s, delay_s;
    waam_pid_gains_t fixed;     /* hold over the whole range of plant gains; used while the regime is not known */
    waam_pid_gains_t scheduled; /* need the plant's gain to about 15 % */
    bool scheduling, predictor; /* the predictor serves the scheduled gains */
    float trim;                 /* greatest distance of the output from its feed-forward value */
    float settle_s;             /* after the start: fixed gains */
    float average_s;            /* of the current that chooses the gains */
    waam_schedule_t schedule;
    waam_ctwd_model_t ctwd;
} waam_regulator_config_t;

/* ---- monitor ---- */

typedef struct {
    float short_v, short_a;     /* below this voltage and above this current ... */
    uint32_t short_us;          /* ... for this long (dip transfer shorts last 2 to 10 ms) */
    float long_arc_v;           /* above the setpoint by this, with current flowing ... */
    uint32_t long_arc_us;
    float voltage_min_v, voltage_max_v, current_min_a, current_max_a;
    uint32_t bad_us;            /* the last good sample stands in for so long */
    uint32_t stuck_us;          /* a burning arc never reads the same to the last bit; 0 = not watched */
    uint32_t stray_us;
} waam_monitor_config_t;

/* ---- sequence ---- */

typedef struct {
    uint32_t purge_us;          /* gas before the first strike */
    uint32_t strike_us;         /* wait for current, per try */
    uint32_t retry_pause_us;
    uint32_t tries;
    double established_a;       /* arc current above this means that the arc burns */
    uint32_t established_us;    /* ... for this long */
    uint32_t lost_us;           /* ... and below it for this long means that it is lost */
    double strike_wire_factor;  /* of W while striking */
    double crater_wire_factor;  /* of W while filling the end crater */
    uint32_t crater_us;
    uint32_t burn_back_us;      /* wire stops, source still on, so that the wire does not freeze in the bead */
    uint32_t post_flow_us;
    uint32_t gas_missing_us;
    double wire_fault_ratio;    /* encoder below this share of the command ... ($C wire_underfeed_ratio) */
    uint32_t wire_underfeed_us; /* ... for so long: "underfeed" in telemetry */
    uint32_t wire_fault_us;     /* ... for this long is a wire fault */
    uint32_t sense_us;          /* stick check: longest look at the sense voltage */
    uint32_t free_us;           /* ... which must be above free_v for this long */
    double free_v;
    uint32_t pulses, pulse_us;  /* of the source, to burn off a wire that froze in the bead */
} waam_arc_config_t;

#endif
