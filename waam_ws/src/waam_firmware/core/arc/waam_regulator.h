/* Arc regulator: PID and Smith predictor around the source (or the wire drive), gains scheduled by current,
 * contact-tip-to-work distance and regime. The tick chooses the gains, the fast tick regulates. */
#ifndef WAAM_REGULATOR_H
#define WAAM_REGULATOR_H

#include "waam_pid.h"
#include "waam_smith_predictor.h"

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
    waam_smith_predictor_t predictor;
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
