/* Input shaping: the planned motion of X and Y, repeated after set times with set weights, leaves a mode of the machine at
 * rest. doc/input_shaping.md has the reasons and the formulas.
 *
 * Works on parts of a step at the end of every tick: place = sum of weight * planned place some ticks ago. Rounded to whole
 * steps in every tick the motion would shake the mode anew. The weights are whole numbers that sum up to 2^30, so a machine
 * that stands is exactly where it was told. All axes have the same mean delay, so a straight line stays straight. */
#ifndef WAAM_SHAPER_H
#define WAAM_SHAPER_H

#include "waam_setting.h"
#include "waam_types.h"

#define WAAM_SHAPER_IMPULSES 5
#define WAAM_SHAPER_TAPS (2 * WAAM_SHAPER_IMPULSES)
#define WAAM_SHAPER_PAST 128        /* ticks that are remembered; a power of two */
#define WAAM_SHAPER_CHANNELS 4      /* X, Y, Z, and the speed along the path */
#define WAAM_SHAPER_ONE (1 << 30)   /* sum of the weights */

/* The shaper in continuous time: amplitudes that sum up to 1, times from 0 up. */
typedef struct {
    uint32_t count;
    float amplitude[WAAM_SHAPER_IMPULSES], time_s[WAAM_SHAPER_IMPULSES];
} waam_impulses_t;

/* The same in ticks. */
typedef struct {
    uint32_t count;
    uint32_t ago[WAAM_SHAPER_TAPS];
    int32_t weight[WAAM_SHAPER_TAPS];
} waam_taps_t;

typedef struct {
    bool on;
    waam_taps_t taps[WAAM_SHAPER_CHANNELS];
    uint32_t span;              /* ticks after which the shaped motion is where the planned one was */
    float delay_s;              /* mean delay of all axes */
    float corner_s, corner_s2;  /* how far a corner is rounded, see waam_shaper_corner_mm */
    float curve_s2;             /* sum of weight * time^2 about the mean delay: how far inside a curve the path lies */
    float reach_s;              /* from the mean delay to the farthest impulse, and a tick */
    uint32_t past[WAAM_SHAPER_CHANNELS][WAAM_SHAPER_PAST]; /* places in 1 / WAAM_PARTS of a step, modulo 2^32 */
    uint32_t at;                /* of the newest sample */
    uint32_t still;             /* ticks without motion, up to WAAM_SHAPER_PAST */
} waam_shaper_t;

waam_shaper_config_t waam_shaper_default(void);
const char *waam_shaper_name(uint32_t type);
/* Places in waam_shaper_config_t: names and ranges. */
extern const waam_setting_t waam_shaper_settings[];

waam_impulses_t waam_shaper_impulses(const waam_shaper_axis_t *axis);
/* Replaces the shaper; the machine stands. `delay_most_s`: greatest mean delay allowed. NULL, or why the settings cannot be
 * used; the shaper is then off. */
const char *waam_shaper_tune(waam_shaper_t *shaper, const waam_shaper_config_t *config, float tick_s, float delay_most_s);
/* How far the shaped path can be from a corner that is passed at `speed` with up to `accel` before and after it:
 * 2 v sin(turn/2) corner_s + a corner_s2. The path turns by `turn` rad, and is straight for span * speed on either side. */
float waam_shaper_corner_mm(const waam_shaper_t *shaper, float speed_mm_s, float accel_mm_s2, float turn_rad);

/* The planned motion goes on in this tick. */
void waam_shaper_wake(waam_shaper_t *shaper);
/* The machine stands where it was told to, and nothing of the past is under way. Always, where the shaper is off. */
bool waam_shaper_settled(const waam_shaper_t *shaper);
/* Where the axes are planned to be: whole steps, and what is beyond them in 1 / WAAM_PARTS. */
typedef struct {
    const int32_t *steps, *part; /* WAAM_AXES */
} waam_place_t;
/* The machine stands there from now on. */
void waam_shaper_rest(waam_shaper_t *shaper, waam_place_t planned);
/* At the end of a tick: planned place and path speed (um/s) in; out: how far the shaped steps are from the planned ones, and
 * what the shaped place has beyond them. */
void waam_shaper_tick(waam_shaper_t *shaper, waam_place_t planned, int32_t speed_um_s, int32_t lag[WAAM_AXES],
                      int32_t part[WAAM_AXES], int32_t *shaped_um_s);

#endif
