/* Arc regulator: PID and Smith predictor around the source (or the wire drive), gains scheduled by current,
 * contact-tip-to-work distance and regime. The tick chooses the gains, the fast tick regulates. */
#ifndef WAAM_REGULATOR_H
#define WAAM_REGULATOR_H

#include "waam_pid.h"
#include "waam_smith_predictor.h"

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
    float gain;                 /* of the plant (2.26), nominal: V per unit of output */
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

typedef enum { WAAM_GAINS_FIXED, WAAM_GAINS_SCHEDULED } waam_regime_t;

/* What the tick hands to the fast tick. */
typedef struct {
    waam_pid_coefficients_t pid;
    float plant_gain;           /* of the model in the predictor */
    bool predict;
    float low, high;            /* limits of the output */
} waam_tuning_t;

typedef struct {
    float current_a;            /* averaged; below 0 = not known */
    float ctwd_mm;              /* estimated */
    float share;                /* of the nominal plant gain, in force */
    float burning_s;
    waam_regime_t regime;
} waam_scheduler_t;

typedef struct {
    bool on;
    float base;                 /* output at the start; the model counts from there */
    waam_pid_t pid;
    waam_smith_predictor_t smith;
} waam_regulator_t;

/* Null, or what is wrong. */
const char *waam_regulator_check(const waam_regulator_config_t *config);
/* Tick: follows the regime for dt; `known`: current and wire speed are measured. */
void waam_scheduler_start(waam_scheduler_t *scheduler);
void waam_scheduler_tick(waam_scheduler_t *scheduler, const waam_regulator_config_t *config, float dt_s, bool known,
                         float current_a, float wire_mm_s);
waam_tuning_t waam_scheduler_tuning(const waam_scheduler_t *scheduler, const waam_regulator_config_t *config,
                                    float sample_s);
float waam_schedule_share(const waam_schedule_t *schedule, float current_a, float ctwd_mm);

/* Fast tick. */
void waam_regulator_start(waam_regulator_t *regulator, const waam_regulator_config_t *config, const waam_tuning_t *tuning,
                          float sample_s, float output, float setpoint, float measured);
float waam_regulator_step(waam_regulator_t *regulator, const waam_tuning_t *tuning, float setpoint, float measured);

#endif
