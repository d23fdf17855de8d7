#include "waam_shaper.h"

#include <math.h>

#define PI 3.14159265f
#define TOLERANCE 0.05f /* of EI and its relatives: the vibration that is allowed at the tuned frequency */
#define SPEED 3         /* channel of the path speed */

/* ---- the shapers: amplitudes over times in units of the damped period ---- */

/* `decay`: what half a period leaves of an oscillation. The amplitudes are those of the literature: Singer and Seering (ZV,
 * ZVD), Singhose, Seering and Singer (EI and its relatives with two and three humps); MZV is the three-impulse shaper of 3-D
 * printing with impulses 3/8 of a period apart. */
static waam_impulses_t zero_vibration(float k)
{
    return (waam_impulses_t){2, {1.0f, k}, {0.0f, 0.5f}};
}

static waam_impulses_t zero_derivative(float k)
{
    return (waam_impulses_t){3, {1.0f, 2.0f * k, k * k}, {0.0f, 0.5f, 1.0f}};
}

static waam_impulses_t modified(float k)
{
    float first = 1.0f - sqrtf(0.5f), step = powf(k, 0.75f);
    return (waam_impulses_t){3, {first, (sqrtf(2.0f) - 1.0f) * step, first * step * step}, {0.0f, 0.375f, 0.75f}};
}

static waam_impulses_t insensitive(float k)
{
    float v = TOLERANCE;
    return (waam_impulses_t){
        3, {0.25f * (1.0f + v), 0.5f * (1.0f - v) * k, 0.25f * (1.0f + v) * k * k}, {0.0f, 0.5f, 1.0f}};
}

static waam_impulses_t two_humps(float k)
{
    float v = TOLERANCE * TOLERANCE, x = cbrtf(v * (sqrtf(1.0f - v) + 1.0f));
    float first = (3.0f * x * x + 2.0f * x + 3.0f * v) / (16.0f * x), second = 0.5f - first;
    return (waam_impulses_t){
        4, {first, second * k, second * k * k, first * k * k * k}, {0.0f, 0.5f, 1.0f, 1.5f}};
}

static waam_impulses_t three_humps(float k)
{
    float v = TOLERANCE, first = 0.0625f * (1.0f + 3.0f * v + 2.0f * sqrtf(2.0f * (v + 1.0f) * v));
    float second = 0.25f * (1.0f - v), third = 0.5f * (1.0f + v) - 2.0f * first, k2 = k * k;
    return (waam_impulses_t){
        5, {first, second * k, third * k2, second * k2 * k, first * k2 * k2}, {0.0f, 0.5f, 1.0f, 1.5f, 2.0f}};
}

static waam_impulses_t shape(uint32_t type, float decay)
{
    switch (type) {
    case WAAM_SHAPER_ZV: return zero_vibration(decay);
    case WAAM_SHAPER_ZVD: return zero_derivative(decay);
    case WAAM_SHAPER_MZV: return modified(decay);
    case WAAM_SHAPER_EI: return insensitive(decay);
    case WAAM_SHAPER_2HUMP_EI: return two_humps(decay);
    case WAAM_SHAPER_3HUMP_EI: return three_humps(decay);
    default: return (waam_impulses_t){1, {1.0f}, {0.0f}};
    }
}

waam_impulses_t waam_shaper_impulses(const waam_shaper_axis_t *axis)
{
    float damped = sqrtf(1.0f - axis->damping * axis->damping);
    waam_impulses_t s = shape(axis->type, expf(-axis->damping * PI / damped));
    float sum = 0.0f, period = axis->type == WAAM_SHAPER_NONE ? 0.0f : 1.0f / (axis->hz * damped);
    for (uint32_t i = 0; i < s.count; i++)
        sum += s.amplitude[i];
    for (uint32_t i = 0; i < s.count; i++) {
        s.amplitude[i] /= sum;
        s.time_s[i] *= period;
    }
    return s;
}

/* ---- impulses between ticks ---- */

typedef struct {
    uint32_t count;
    float weight[WAAM_SHAPER_TAPS], ago[WAAM_SHAPER_TAPS]; /* ago in ticks, whole */
} split_t;

static void add(split_t *split, float ago, float weight)
{
    if (weight <= 1e-7f)
        return;
    split->ago[split->count] = ago;
    split->weight[split->count++] = weight;
}

/* An impulse between two ticks becomes two that move the mode just as it would have: with s its pole and d the share of the
 * tick, w1 + w2 e^(sT) = e^(s d T). A pure delay is interpolated. */
static void split_impulse(split_t *split, const waam_shaper_axis_t *axis, float at, float amplitude, float tick_s)
{
    float ago = floorf(at), d = at - ago, first = 1.0f - d, second = d;
    if (axis->type != WAAM_SHAPER_NONE) {
        float omega = 2.0f * PI * axis->hz * tick_s, rate = axis->damping * omega;
        float angle = omega * sqrtf(1.0f - axis->damping * axis->damping);
        first = expf(rate * d) * sinf((1.0f - d) * angle) / sinf(angle);
        second = expf(-rate * (1.0f - d)) * sinf(d * angle) / sinf(angle);
    }
    add(split, ago, amplitude * first);
    add(split, ago + 1.0f, amplitude * second);
}

/* Weights that sum up to 1, all impulses `later` ticks later. */
static split_t split_all(const waam_shaper_axis_t *axis, float later, float tick_s)
{
    waam_impulses_t s = waam_shaper_impulses(axis);
    split_t split = {.count = 0};
    float sum = 0.0f;
    for (uint32_t i = 0; i < s.count; i++)
        split_impulse(&split, axis, s.time_s[i] / tick_s + later, s.amplitude[i], tick_s);
    for (uint32_t i = 0; i < split.count; i++)
        sum += split.weight[i];
    for (uint32_t i = 0; i < split.count; i++)
        split.weight[i] /= sum;
    return split;
}

static float mean(const split_t *split)
{
    float sum = 0.0f;
    for (uint32_t i = 0; i < split->count; i++)
        sum += split->weight[i] * split->ago[i];
    return sum;
}

/* With this mean delay, in ticks. */
static split_t delayed(const waam_shaper_axis_t *axis, float delay, float tick_s)
{
    split_t split = split_all(axis, 0.0f, tick_s);
    float later = 0.0f;
    for (int i = 0; i < 8 && fabsf(delay - mean(&split)) > 1e-4f; i++) {
        later = fmaxf(0.0f, later + delay - mean(&split));
        split = split_all(axis, later, tick_s);
    }
    return split;
}

static waam_taps_t whole(const split_t *split)
{
    waam_taps_t taps = {.count = split->count};
    int32_t left = WAAM_SHAPER_ONE;
    uint32_t largest = 0;
    for (uint32_t i = 0; i < split->count; i++) {
        taps.ago[i] = (uint32_t)split->ago[i];
        taps.weight[i] = (int32_t)lroundf(split->weight[i] * (float)WAAM_SHAPER_ONE);
        left -= taps.weight[i];
        largest = taps.weight[i] > taps.weight[largest] ? i : largest;
    }
    taps.weight[largest] += left;
    return taps;
}

/* ---- tuning ---- */

static uint32_t last(const waam_taps_t *taps) { return taps->ago[taps->count - 1]; }

/* Moments of the impulses on either side of the mean delay: the part of a corner that is cut off. */
static void measure_corner(waam_shaper_t *shaper, const split_t *split, float delay, float tick_s)
{
    float first = 0.0f, second[2] = {0.0f, 0.0f};
    for (uint32_t i = 0; i < split->count; i++) {
        float off = (split->ago[i] - delay) * tick_s;
        first += 0.5f * split->weight[i] * fabsf(off);
        second[off > 0.0f] += split->weight[i] * off * off;
        shaper->reach_s = fmaxf(shaper->reach_s, fabsf(off) + tick_s);
    }
    shaper->corner_s = fmaxf(shaper->corner_s, first);
    shaper->corner_s2 = fmaxf(shaper->corner_s2, fmaxf(second[0], second[1]));
    shaper->curve_s2 = fmaxf(shaper->curve_s2, second[0] + second[1]);
}

const char *waam_shaper_tune(waam_shaper_t *shaper, const waam_shaper_config_t *config, float tick_s, float delay_most_s)
{
    const waam_shaper_axis_t still = {.type = WAAM_SHAPER_NONE};
    const waam_shaper_axis_t *axis[WAAM_AXES] = {&config->axis[0], &config->axis[1], &still};
    float delay = 0.0f;
    *shaper = (waam_shaper_t){.on = false, .still = WAAM_SHAPER_PAST};
    for (int i = 0; i < WAAM_SHAPED_AXES; i++) {
        split_t split = split_all(axis[i], 0.0f, tick_s);
        shaper->on = shaper->on || axis[i]->type != WAAM_SHAPER_NONE;
        delay = fmaxf(delay, mean(&split));
    }
    for (int i = 0; i < WAAM_AXES && shaper->on; i++) {
        split_t split = delayed(axis[i], delay, tick_s);
        shaper->taps[i] = whole(&split);
        measure_corner(shaper, &split, delay, tick_s);
        if (last(&shaper->taps[i]) >= shaper->span) {
            shaper->span = last(&shaper->taps[i]);
            shaper->taps[SPEED] = shaper->taps[i];
        }
    }
    shaper->delay_s = delay * tick_s;
    const char *why = shaper->delay_s > delay_most_s ? "the shaper is slower than the lead of the wire"
                      : shaper->span >= WAAM_SHAPER_PAST ? "the shaper is too long" : NULL;
    shaper->on = shaper->on && !why;
    return why;
}

float waam_shaper_corner_mm(const waam_shaper_t *shaper, float speed_mm_s, float accel_mm_s2, float turn_rad)
{
    return 2.0f * speed_mm_s * fabsf(sinf(0.5f * turn_rad)) * shaper->corner_s + accel_mm_s2 * shaper->corner_s2;
}

/* ---- motion ---- */

void waam_shaper_wake(waam_shaper_t *shaper) { shaper->still = 0; }

bool waam_shaper_settled(const waam_shaper_t *shaper) { return !shaper->on || shaper->still > shaper->span; }

/* Modulo 2^32, for only differences are used. */
static uint32_t fine(waam_place_t place, int axis)
{
    return (uint32_t)place.steps[axis] * WAAM_PARTS + (uint32_t)place.part[axis];
}

void waam_shaper_rest(waam_shaper_t *shaper, waam_place_t planned)
{
    bool same = waam_shaper_settled(shaper);
    for (int i = 0; i < WAAM_AXES; i++)
        same = same && shaper->past[i][shaper->at] == fine(planned, i);
    shaper->still = WAAM_SHAPER_PAST;
    if (!shaper->on || same)
        return;
    for (int i = 0; i < WAAM_SHAPER_CHANNELS; i++)
        for (uint32_t k = 0; k < WAAM_SHAPER_PAST; k++)
            shaper->past[i][k] = i < WAAM_AXES ? fine(planned, i) : 0;
}

static int32_t floored(int64_t value, int64_t by) { return (int32_t)(value >= 0 ? value / by : -((by - 1 - value) / by)); }

/* Differences from the newest sample, so that any number of steps fits. */
static int32_t filtered(const waam_shaper_t *shaper, int channel)
{
    const waam_taps_t *taps = &shaper->taps[channel];
    const uint32_t *past = shaper->past[channel], now = past[shaper->at];
    int64_t sum = WAAM_SHAPER_ONE / 2;
    for (uint32_t i = 0; i < taps->count; i++) {
        int32_t change = (int32_t)(past[(shaper->at - taps->ago[i]) % WAAM_SHAPER_PAST] - now);
        sum += (int64_t)change * taps->weight[i];
    }
    return floored(sum, WAAM_SHAPER_ONE);
}

void waam_shaper_tick(waam_shaper_t *shaper, waam_place_t planned, int32_t speed_um_s, int32_t lag[WAAM_AXES],
                      int32_t part[WAAM_AXES], int32_t *shaped_um_s)
{
    shaper->at = (shaper->at + 1) % WAAM_SHAPER_PAST;
    for (int i = 0; i < WAAM_AXES; i++)
        shaper->past[i][shaper->at] = fine(planned, i);
    shaper->past[SPEED][shaper->at] = (uint32_t)speed_um_s;
    for (int i = 0; i < WAAM_AXES; i++) {
        int32_t beyond = planned.part[i] + filtered(shaper, i);
        lag[i] = floored(beyond + WAAM_PARTS / 2, WAAM_PARTS);
        part[i] = beyond - lag[i] * WAAM_PARTS;
    }
    *shaped_um_s = speed_um_s + filtered(shaper, SPEED);
    shaper->still += shaper->still < WAAM_SHAPER_PAST;
}
