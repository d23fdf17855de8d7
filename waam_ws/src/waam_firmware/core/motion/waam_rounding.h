/* How far the input shaper may round a corner, and how slowly the corner is passed for it. doc/input_shaping.md has the reasons.
 *
 * Shaped place = sum of weight * planned place at times around now. While the planned path goes at no more than v for `reach`
 * before and after a corner, the shaped one is within 2 v m sin(turn / 2) of it, m = sum of weight * |time| / 2. So each
 * side of a corner ends and begins with a stretch of v * reach that is passed at v at the most. A curve is cut off by
 * v^2 / 2R * sum of weight * time^2. */
#ifndef WAAM_ROUNDING_H
#define WAAM_ROUNDING_H

#include "waam_shaper.h"

typedef struct {
    float allowed_mm;           /* 0 = nothing is shaped, and no corner is rounded */
    float first_s, second_s2;   /* moments of the shaper: m, and the sum of weight * time^2 */
    float reach_s;              /* the farthest impulse on either side, and a tick */
} waam_rounding_t;

/* A stretch at the beginning or end of a move. */
typedef struct {
    float length_mm;            /* 0 = none */
    float speed_mm_s;
} waam_slow_t;

/* Of the shaper in force. */
waam_rounding_t waam_rounding(const waam_shaper_t *shaper, float allowed_mm);
/* Greatest speed through a corner: `half` = sin(turn / 2), `shorter_mm` the shorter move at it. INFINITY where nothing is
 * shaped. */
float waam_rounding_corner(const waam_rounding_t *rounding, float half, float shorter_mm);
/* Greatest speed along a circle. */
float waam_rounding_curve(const waam_rounding_t *rounding, float radius_mm);
/* The stretch beside a corner with this speed. */
waam_slow_t waam_rounding_slow(const waam_rounding_t *rounding, float corner_mm_s);

#endif
