/* Homing: Z first, so that the torch is up, then X, then Y. Each axis seeks its switch, backs off and comes back slowly;
 * the switch point is the end of the range on that side. */
#ifndef WAAM_HOME_H
#define WAAM_HOME_H

#include "waam_motion.h"

typedef enum { WAAM_HOME_SEEK, WAAM_HOME_BRAKE, WAAM_HOME_BACK_OFF, WAAM_HOME_LATCH } waam_home_phase_t;

typedef struct {
    bool active;
    int stage;                /* index into the order of axes */
    waam_home_phase_t phase;
    double speed_mm_s;        /* signed, of the axis that moves */
    double fraction_steps;    /* travel not yet given out as steps */
    double travelled_mm;      /* in this phase */
} waam_home_t;

typedef enum { WAAM_HOME_BUSY, WAAM_HOME_DONE, WAAM_HOME_FAILED } waam_home_result_t;

/* Begins with the first axis. */
void waam_home_start(waam_home_t *home);
/* Moves the axes and, as each switch is found, sets its axis to the coordinate of the switch. With `hold` it slows down,
 * and starts again from the beginning once it is let go. */
waam_home_result_t waam_home_tick(waam_home_t *home, waam_motion_t *motion, const bool home_switch[WAAM_AXES],
                                  bool hold, const waam_config_t *config, double dt_s);
/* The axis that moves. */
int waam_home_axis(const waam_home_t *home);

#endif
