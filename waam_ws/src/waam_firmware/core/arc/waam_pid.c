#include "waam_pid.h"

#define FAR 1e9f /* no sample changes an output by so much */

waam_pid_coefficients_t waam_pid_coefficients(const waam_pid_gains_t *gains, float plant_gain, float sample_s)
{
    return (waam_pid_coefficients_t){
        .p = gains->kp / plant_gain,
        .i = gains->ki / plant_gain * sample_s,
        .d = gains->kd / plant_gain / sample_s,
        .smooth = sample_s / (gains->filter_s + sample_s),
        .weight = gains->weight,
    };
}

void waam_pid_start(waam_pid_t *pid, const waam_pid_coefficients_t *c, float output, float setpoint, float measured)
{
    *pid = (waam_pid_t){.output = output, .before = c->weight * setpoint - measured};
}

/* Adds with the rounding error kept (Kahan): a step of the integral may be a millionth of the output. */
static void add(waam_pid_t *pid, float change)
{
    float exact = change - pid->rest, sum = pid->output + exact;
    pid->rest = (sum - pid->output) - exact;
    pid->output = sum;
}

static float inside(float value, float low, float high) { return value > high ? high : value < low ? low : value; }

float waam_pid_step(waam_pid_t *pid, const waam_pid_coefficients_t *c, float setpoint, float measured, float low,
                    float high)
{
    float weighted = c->weight * setpoint - measured;
    float rise = weighted - pid->before;
    float slope = pid->slope + c->smooth * (c->d * rise - pid->slope);
    float integral = c->i * (setpoint - measured);
    bool winds_up = (pid->output >= high && integral > 0.0f) || (pid->output <= low && integral < 0.0f);
    float change = c->p * rise + (winds_up ? 0.0f : integral) + (slope - pid->slope);
    if (!(change > -FAR && change < FAR))
        return inside(pid->output, low, high);
    add(pid, change);
    pid->before = weighted;
    pid->slope = slope;
    return inside(pid->output, low, high);
}
