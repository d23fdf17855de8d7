/* The limit switches: one chain for all ends of all axes. While it is open, an axis may move out of its switch and no axis
 * ever further into one.
 *
 * The chain does not say which end it is. The axis that moved when it opened, or shortly before, may go back where it came
 * from; the others stay. When none moved (power-up at a switch, an axis pushed by hand) or several did, the home switches
 * tell besides: an axis at its home switch may only leave it, any other may only move towards home. For this a home switch
 * must stay pressed up to the end of travel. */
#ifndef WAAM_LIMIT_H
#define WAAM_LIMIT_H

#include "waam_types.h"

/* Contacts bounce: a release counts when it has lasted for so long and the way since then is so long, or nothing moves. */
#define WAAM_LIMIT_RELEASE_US 20000u
#define WAAM_LIMIT_RELEASE_MM 0.5
#define WAAM_LIMIT_RECENT_US 100000u

typedef struct {
    bool pressed;
    uint32_t released_us;
    double released_mm;             /* way since the release */
    int movers;                     /* axes that moved when it was pressed */
    int8_t back[WAAM_AXES];         /* ... and where they came from; 0: did not move */
    int8_t out[WAAM_AXES];          /* the only direction allowed while pressed; 0 = none */
    int8_t moved[WAAM_AXES];        /* direction of the last step */
    uint32_t rested_us[WAAM_AXES];  /* since then, up to WAAM_LIMIT_RECENT_US */
    int64_t pulses[WAAM_AXES];      /* at the end of the last tick */
    double left_mm;                 /* way out that is still allowed before the switch must be released */
} waam_limit_t;

/* Before the motion of a tick. True: the switch has just been pressed. */
bool waam_limit_look(waam_limit_t *limit, bool pressed, const bool home_switch[WAAM_AXES], const waam_config_t *config,
                     uint32_t dt_us);
/* A person has looked at it (reset): the way out may be tried again. */
void waam_limit_acknowledge(waam_limit_t *limit, const waam_config_t *config);
/* May this axis move in this direction? */
bool waam_limit_allows(const waam_limit_t *limit, int axis, double delta);
/* After the motion of a tick, before its pulses are given out. NULL, or why they must not be. */
const char *waam_limit_step(waam_limit_t *limit, const int64_t pulses[WAAM_AXES], const waam_config_t *config,
                            uint32_t dt_us);

#endif
