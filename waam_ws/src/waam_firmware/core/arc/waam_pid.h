/* PID in velocity form with a filtered derivative; the output is held inside its limits. */
#ifndef WAAM_PID_H
#define WAAM_PID_H

#include "waam_arc_settings.h"

/* The same, ready for use: gains divided by the gain of the plant, times by the sample time. */
typedef struct {
    float p, i, d, smooth, weight;
} waam_pid_coefficients_t;

typedef struct {
    float output;           /* before the limits */
    float rest;             /* what single precision cut off the output so far */
    float before;           /* weighted error of the last sample */
    float slope;            /* filtered derivative part */
} waam_pid_t;

/* Gains for steps of `sample_s` (s), divided by the gain of the plant; formulas in doc/arc_regulator.md. */
waam_pid_coefficients_t waam_pid_coefficients(const waam_pid_gains_t *gains, float plant_gain, float sample_s);
/* Begins at an output and an operating point without a bump. */
void waam_pid_start(waam_pid_t *pid, const waam_pid_coefficients_t *c, float output, float setpoint, float measured);
/* One sample; returns the output inside its limits. Anti-windup: at a limit the integral part does not grow towards it;
 * proportional and derivative part are remembered beyond it, else the output would leave the limit as soon as the error
 * shrinks (the usual weakness of a clamped velocity form). What is not a number leaves the output where it was. */
float waam_pid_step(waam_pid_t *pid, const waam_pid_coefficients_t *c, float setpoint, float measured, float low,
                    float high);

#endif
