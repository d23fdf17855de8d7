#include "waam_limit.h"

static int8_t sign(int64_t change) { return (int8_t)((change > 0) - (change < 0)); }

static bool moves(const waam_limit_t *limit, int axis)
{
    return limit->moved[axis] && limit->rested_us[axis] < WAAM_LIMIT_RECENT_US;
}

static void remember_movers(waam_limit_t *limit)
{
    limit->movers = 0;
    for (int i = 0; i < WAAM_AXES; i++) {
        limit->back[i] = moves(limit, i) ? (int8_t)-limit->moved[i] : 0;
        limit->movers += moves(limit, i);
    }
}

static int8_t way_out(const waam_limit_t *limit, int axis, bool home_switch, int8_t home)
{
    int8_t by_switch = (int8_t)(home_switch ? -home : home), back = limit->back[axis];
    if (limit->movers == 0)
        return by_switch;
    return limit->movers == 1 || back == by_switch ? back : 0;
}

static void look_for_release(waam_limit_t *limit, bool pressed, uint32_t dt_us)
{
    bool stands = !moves(limit, 0) && !moves(limit, 1) && !moves(limit, 2);
    if (pressed) {
        limit->released_us = 0;
        limit->released_mm = 0.0;
    } else if (limit->released_us < WAAM_LIMIT_RELEASE_US) {
        limit->released_us += dt_us;
    }
    limit->pressed = limit->released_us < WAAM_LIMIT_RELEASE_US ||
                     (limit->released_mm < WAAM_LIMIT_RELEASE_MM && !stands);
}

bool waam_limit_look(waam_limit_t *limit, bool pressed, const bool home_switch[WAAM_AXES], const waam_config_t *config,
                     uint32_t dt_us)
{
    bool just = pressed && !limit->pressed;
    if (just) {
        limit->left_mm = config->limit_release_mm;
        remember_movers(limit);
    }
    if (just || limit->pressed)
        look_for_release(limit, pressed, dt_us);
    for (int i = 0; i < WAAM_AXES; i++)
        limit->out[i] = way_out(limit, i, home_switch[i], config->home_direction[i]);
    return just;
}

void waam_limit_acknowledge(waam_limit_t *limit, const waam_config_t *config)
{
    limit->left_mm = config->limit_release_mm;
}

bool waam_limit_allows(const waam_limit_t *limit, int axis, double delta)
{
    return !limit->pressed || delta == 0.0 || delta * limit->out[axis] > 0.0;
}

static void note(waam_limit_t *limit, int axis, int64_t change, uint32_t dt_us)
{
    uint32_t rested = limit->rested_us[axis];
    limit->pulses[axis] += change;
    limit->moved[axis] = change ? sign(change) : limit->moved[axis];
    limit->rested_us[axis] = change ? 0 : rested < WAAM_LIMIT_RECENT_US ? rested + dt_us : rested;
}

const char *waam_limit_step(waam_limit_t *limit, const int64_t pulses[WAAM_AXES], const waam_config_t *config,
                            uint32_t dt_us)
{
    double way_mm = 0.0;
    for (int i = 0; i < WAAM_AXES; i++) {
        int64_t change = pulses[i] - limit->pulses[i];
        if (!waam_limit_allows(limit, i, (double)change))
            return "limit switch: only the way out of it is free";
        if (change) /* a processor without doubles divides slowly */
            way_mm += (double)(change < 0 ? -change : change) / config->steps_per_mm[i];
    }
    if (limit->pressed && way_mm > limit->left_mm)
        return "limit switch: still pressed after the way out";
    limit->left_mm -= way_mm;
    limit->released_mm += way_mm;
    for (int i = 0; i < WAAM_AXES; i++)
        note(limit, i, pulses[i] - limit->pulses[i], dt_us);
    return NULL;
}
