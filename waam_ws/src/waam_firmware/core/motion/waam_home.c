#include "waam_home.h"

#include <math.h>

static const int order[WAAM_AXES] = {2, 0, 1};

int waam_home_axis(const waam_home_t *home) { return order[home->stage]; }

void waam_home_start(waam_home_t *home) { *home = (waam_home_t){.active = true}; }

static void enter(waam_home_t *home, waam_home_phase_t phase)
{
    home->phase = phase;
    home->travelled_mm = 0.0;
}

static void move(waam_home_t *home, int32_t *steps, double target_mm_s, const waam_config_t *config, double dt_s)
{
    double change = config->accel_mm_s2[waam_home_axis(home)] * dt_s, before = home->speed_mm_s;
    home->speed_mm_s = fmax(before - change, fmin(before + change, target_mm_s));
    double moved = 0.5 * (before + home->speed_mm_s) * dt_s;
    home->travelled_mm += fabs(moved);
    home->fraction_steps += moved * config->steps_per_mm[waam_home_axis(home)];
    int32_t whole = (int32_t)lround(home->fraction_steps);
    home->fraction_steps -= whole;
    *steps += whole;
}

#define BRAKE_MM 3.0 /* behind the home switch comes the limit switch */

#define USUAL_MM_S2 500.0

/* A lower acceleration brakes in no longer way, nor does a higher speed of homing. */
static double seek_mm_s(const waam_config_t *config, int axis)
{
    double most = fmin(config->home_seek_mm_s, config->max_speed_mm_s[axis]);
    double accel = config->accel_mm_s2[axis];
    most = fmin(most, sqrt(2.0 * fmax(accel, USUAL_MM_S2) * BRAKE_MM));
    return most * sqrt(fmin(1.0, accel / USUAL_MM_S2));
}

static double range(const waam_config_t *config, int axis)
{
    return config->limit_max_mm[axis] - config->limit_min_mm[axis];
}

static waam_home_result_t latched(waam_home_t *home, waam_motion_t *motion, const waam_config_t *config)
{
    int axis = waam_home_axis(home);
    double mm = config->home_direction[axis] < 0 ? config->limit_min_mm[axis] : config->limit_max_mm[axis];
    waam_motion_declare(motion, axis, (int32_t)lround(mm * config->steps_per_mm[axis]));
    home->speed_mm_s = home->fraction_steps = 0.0;
    enter(home, WAAM_HOME_SEEK);
    if (++home->stage < WAAM_AXES)
        return WAAM_HOME_BUSY;
    home->stage = 0;
    home->active = false;
    return WAAM_HOME_DONE;
}

waam_home_result_t waam_home_tick(waam_home_t *home, waam_motion_t *motion, const bool home_switch[WAAM_AXES],
                                  bool hold, const waam_config_t *config, double dt_s)
{
    int axis = waam_home_axis(home);
    double towards = config->home_direction[axis];
    bool pressed = home_switch[axis];
    int32_t *steps = &motion->steps[axis];
    if (hold) {
        move(home, steps, 0.0, config, dt_s);
        if (home->speed_mm_s == 0.0)
            waam_home_start(home);
        return WAAM_HOME_BUSY;
    }
    switch (home->phase) {
    case WAAM_HOME_SEEK:
        if (pressed)
            enter(home, WAAM_HOME_BRAKE);
        move(home, steps, pressed ? 0.0 : towards * seek_mm_s(config, axis), config, dt_s);
        return home->travelled_mm > 1.1 * range(config, axis) + 10.0 ? WAAM_HOME_FAILED : WAAM_HOME_BUSY;
    case WAAM_HOME_BRAKE:
        move(home, steps, 0.0, config, dt_s);
        if (home->speed_mm_s == 0.0)
            enter(home, WAAM_HOME_BACK_OFF);
        return WAAM_HOME_BUSY;
    case WAAM_HOME_BACK_OFF: {
        bool far = home->travelled_mm >= config->home_backoff_mm && !pressed;
        move(home, steps, far ? 0.0 : -towards * 0.25 * seek_mm_s(config, axis), config, dt_s);
        if (far && home->speed_mm_s == 0.0)
            enter(home, WAAM_HOME_LATCH);
        return home->travelled_mm > 10.0 * config->home_backoff_mm + 10.0 ? WAAM_HOME_FAILED : WAAM_HOME_BUSY;
    }
    default:
        if (pressed)
            return latched(home, motion, config);
        move(home, steps, towards * config->home_latch_mm_s, config, dt_s);
        return home->travelled_mm > 20.0 * config->home_backoff_mm + 20.0 ? WAAM_HOME_FAILED : WAAM_HOME_BUSY;
    }
}
