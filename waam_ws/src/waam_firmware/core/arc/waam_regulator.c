#include "waam_regulator.h"

#include <math.h>
#include <stddef.h>

static bool rising(const float *values, int count)
{
    for (int i = 1; i < count; i++)
        if (!(values[i] > values[i - 1]))
            return false;
    return true;
}

static bool gains_are_good(const waam_pid_gains_t *g)
{
    return g->kp >= 0.0f && g->ki > 0.0f && g->kd >= 0.0f && g->filter_s >= 0.0f && g->weight >= 0.0f &&
           g->weight <= 1.0f;
}

const char *waam_regulator_check(const waam_regulator_config_t *c)
{
    if (!gains_are_good(&c->fixed) || !gains_are_good(&c->scheduled))
        return "arc regulator: gains must be at or above 0 (ki above 0), weight 0..1";
    if (!(c->gain != 0.0f) || !(c->lag_s >= 0.0f) || !(c->delay_s >= 0.0f) || !(c->delay_s < 0.0255f))
        return "arc regulator: the plant needs a gain, a lag of 0 or more and a delay below 25.5 ms";
    if (c->actuator != WAAM_REGULATOR_OFF && (c->gain < 0.0f) != (c->actuator == WAAM_REGULATOR_WIRE))
        return "arc regulator: more source voltage raises the arc's, more wire lowers it";
    if (!(c->schedule.current_a[0] > 0.0f) || !rising(c->schedule.current_a, WAAM_SCHEDULE_CURRENTS) ||
        !rising(c->schedule.ctwd_mm, WAAM_SCHEDULE_DISTANCES))
        return "arc regulator: the axes of the schedule must rise, from above 0";
    for (int i = 0; i < WAAM_SCHEDULE_CURRENTS * WAAM_SCHEDULE_DISTANCES; i++)
        if (!((&c->schedule.share[0][0])[i] >= 0.2f) || (&c->schedule.share[0][0])[i] > 5.0f)
            return "arc regulator: shares of the schedule must lie in 0.2..5";
    return NULL;
}

static int cell(const float *axis, int count, float value)
{
    int i = 0;
    while (i < count - 2 && value > axis[i + 1])
        i++;
    return i;
}

static float within(float value, float from, float to)
{
    float f = (value - from) / (to - from);
    return f > 0.0f ? (f < 1.0f ? f : 1.0f) : 0.0f;
}

float waam_schedule_share(const waam_schedule_t *s, float current_a, float ctwd_mm)
{
    int i = cell(s->current_a, WAAM_SCHEDULE_CURRENTS, current_a);
    int j = cell(s->ctwd_mm, WAAM_SCHEDULE_DISTANCES, ctwd_mm);
    float f = within(1.0f / fmaxf(current_a, 1.0f), 1.0f / s->current_a[i], 1.0f / s->current_a[i + 1]);
    float g = within(ctwd_mm, s->ctwd_mm[j], s->ctwd_mm[j + 1]);
    float low = s->share[i][j] + g * (s->share[i][j + 1] - s->share[i][j]);
    float high = s->share[i + 1][j] + g * (s->share[i + 1][j + 1] - s->share[i + 1][j]);
    return low + f * (high - low);
}

void waam_scheduler_start(waam_scheduler_t *scheduler)
{
    *scheduler = (waam_scheduler_t){.current_a = -1.0f, .share = 1.0f};
}

static float distance(const waam_ctwd_model_t *m, float current_a, float wire_mm_s)
{
    float at_reference = m->current_a * powf(wire_mm_s / m->wire_mm_s, m->exponent);
    return m->ctwd_mm + (1.0f - current_a / at_reference) / m->loss_per_mm;
}

void waam_scheduler_tick(waam_scheduler_t *s, const waam_regulator_config_t *config, float dt_s, bool known,
                         float current_a, float wire_mm_s)
{
    s->burning_s += dt_s;
    s->regime = WAAM_GAINS_FIXED;
    if (!known || !(wire_mm_s > 1.0f) || !(current_a > 0.0f))
        return;
    float share = dt_s / (config->average_s + dt_s);
    s->current_a = s->current_a < 0.0f ? current_a : s->current_a + share * (current_a - s->current_a);
    s->ctwd_mm = distance(&config->ctwd, s->current_a, wire_mm_s);
    s->share = waam_schedule_share(&config->schedule, s->current_a, s->ctwd_mm);
    if (config->scheduling && s->burning_s >= config->settle_s)
        s->regime = WAAM_GAINS_SCHEDULED;
}

waam_tuning_t waam_scheduler_tuning(const waam_scheduler_t *s, const waam_regulator_config_t *config, float sample_s)
{
    bool scheduled = s->regime == WAAM_GAINS_SCHEDULED;
    float gain = scheduled ? config->gain * s->share : config->gain;
    return (waam_tuning_t){
        .pid = waam_pid_coefficients(scheduled ? &config->scheduled : &config->fixed, gain, sample_s),
        .plant_gain = gain,
        .predict = scheduled && config->predictor,
    };
}

void waam_regulator_start(waam_regulator_t *r, const waam_regulator_config_t *config, const waam_tuning_t *tuning,
                          float sample_s, float output, float setpoint, float measured)
{
    r->base = output;
    waam_pid_start(&r->pid, &tuning->pid, output, setpoint, measured);
    r->on = waam_smith_predictor_start(&r->predictor, config->lag_s, config->delay_s, sample_s);
}

float waam_regulator_step(waam_regulator_t *r, const waam_tuning_t *t, float setpoint, float measured)
{
    float expected = measured + (t->predict ? waam_smith_predictor_coming(&r->predictor) : 0.0f);
    float output = waam_pid_step(&r->pid, &t->pid, setpoint, expected, t->low, t->high);
    waam_smith_predictor_step(&r->predictor, t->plant_gain * (output - r->base));
    return output;
}
