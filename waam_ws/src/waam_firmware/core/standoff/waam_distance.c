#include "waam_distance.h"

#include <math.h>

float waam_infrared_mm(float counts)
{
    static const float c[] = {-5e-11f, 1e-7f, -8e-5f, 3.24e-2f, -6.84f, 698.49f};
    float value = c[0];
    for (unsigned i = 1; i < sizeof c / sizeof c[0]; i++)
        value = value * counts + c[i];
    return value;
}

void waam_distance_start(waam_distance_t *d)
{
    uint32_t reading = d->reading;
    *d = (waam_distance_t){.reading = reading, .quality = WAAM_DISTANCE_NONE};
}

static float distance_mm(const waam_standoff_config_t *c, float value)
{
    if (c->source != WAAM_STANDOFF_INFRARED)
        return value;
    /* Beyond 35 to 400 mm the polynomial means nothing: no distance is better than a wrong one. */
    return value >= 58.0f && value <= 631.0f ? waam_infrared_mm(value) : NAN;
}

static void restart_filters(waam_distance_t *d, float mm)
{
    d->rc_mm = mm;
    d->count = d->next = 0;
}

void waam_distance_elsewhere(waam_distance_t *d)
{
    d->has_last = d->has_candidate = d->fresh = false;
    d->count = d->next = 0;
}

/* The metal may have a step; noise and glare do not last. */
static bool jumps(waam_distance_t *d, const waam_standoff_config_t *c, float mm, float since_s)
{
    if (!d->has_last || fabsf(mm - d->last_mm) <= c->jump_mm) {
        d->has_candidate = false;
        return false;
    }
    bool again = d->has_candidate && fabsf(mm - d->candidate_mm) <= c->jump_mm;
    d->candidate_s = again ? d->candidate_s + since_s : 0.0f;
    d->candidate_mm = mm;
    d->has_candidate = true;
    if (d->candidate_s < c->confirm_s)
        return true;
    d->has_candidate = false;
    restart_filters(d, mm);
    return false;
}

static waam_distance_quality_t judge(waam_distance_t *d, const waam_standoff_config_t *c, float mm, float since_s)
{
    if (!(mm > -1e6f && mm < 1e6f))
        return WAAM_DISTANCE_NONE;
    if (c->stuck_s > 0.0f && d->same_s > c->stuck_s)
        return WAAM_DISTANCE_STUCK;
    if (fabsf(mm - c->set_mm) > c->window_mm)
        return WAAM_DISTANCE_OUTSIDE;
    return jumps(d, c, mm, since_s) ? WAAM_DISTANCE_JUMP : WAAM_DISTANCE_GOOD;
}

static void take(waam_distance_t *d, const waam_standoff_config_t *c, float value)
{
    bool same = d->started && value == d->raw;
    float mm = distance_mm(c, value), since_s = d->held_s;
    d->same_s = same ? d->same_s + since_s : 0.0f;
    d->raw = value;
    d->held_s = 0.0f;
    d->quality = judge(d, c, mm, since_s);
    if (d->quality != WAAM_DISTANCE_GOOD)
        return;
    if (!d->has_last)
        restart_filters(d, mm);
    d->last_mm = mm;
    d->has_last = d->fresh = true;
    d->bad_s = 0.0f;
}

void waam_distance_tick(waam_distance_t *d, const waam_standoff_config_t *c, uint32_t reading, float value, float dt_s)
{
    d->held_s += dt_s;
    d->bad_s += dt_s;
    if (reading != d->reading) {
        d->reading = reading;
        take(d, c, value);
        d->started = true;
    } else if (d->held_s > c->lost_s) {
        d->quality = WAAM_DISTANCE_NONE;
    }
    if (d->has_last)
        d->rc_mm += dt_s / (c->rc_s + dt_s) * (d->last_mm - d->rc_mm);
}

bool waam_distance_packet(waam_distance_t *d, const waam_standoff_config_t *c, float z_mm, float *relative_mm)
{
    bool fresh = d->fresh;
    if (fresh) {
        d->fresh = false;
        d->ring[d->next] = d->rc_mm - z_mm;
        d->next = d->next + 1 < c->average ? d->next + 1 : 0;
        d->count += d->count < c->average;
    }
    float sum = 0.0f;
    for (uint32_t i = 0; i < d->count; i++)
        sum += d->ring[i];
    *relative_mm = d->count ? sum / (float)d->count : 0.0f;
    return fresh;
}
