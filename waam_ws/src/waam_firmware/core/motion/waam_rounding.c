#include "waam_rounding.h"

#include <math.h>

#define CURVE_HALF 0.4f /* sin(turn / 2) up to which moves in a row are taken for a curve: 47 degrees */

waam_rounding_t waam_rounding(const waam_shaper_t *shaper, float allowed_mm)
{
    if (!shaper->on)
        return (waam_rounding_t){.allowed_mm = 0.0f};
    return (waam_rounding_t){allowed_mm, shaper->corner_s, shaper->curve_s2, shaper->reach_s};
}

float waam_rounding_curve(const waam_rounding_t *r, float radius_mm)
{
    return r->allowed_mm > 0.0f ? sqrtf(2.0f * r->allowed_mm * radius_mm / r->second_s2) : INFINITY;
}

/* Moves of a polygon lie on a circle with R = l / 2 tan(turn / 2): within the reach of the shaper are then many corners, of
 * which each would be allowed more than its share. */
float waam_rounding_corner(const waam_rounding_t *r, float half, float shorter_mm)
{
    if (r->allowed_mm <= 0.0f || half < 1e-6f)
        return INFINITY;
    float alone = 0.5f * r->allowed_mm / (r->first_s * half);
    if (half > CURVE_HALF)
        return alone;
    return fminf(alone, waam_rounding_curve(r, 0.5f * shorter_mm * sqrtf(1.0f - half * half) / half));
}

waam_slow_t waam_rounding_slow(const waam_rounding_t *r, float corner_mm_s)
{
    if (!isfinite(corner_mm_s))
        return (waam_slow_t){.length_mm = 0.0f};
    return (waam_slow_t){corner_mm_s * r->reach_s, corner_mm_s};
}
