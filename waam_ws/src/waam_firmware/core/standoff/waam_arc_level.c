#include "waam_arc_level.h"

#include <math.h>

#define EVERY_S 0.5f      /* between two steps of the filter */
#define LASTS_S 5.0f      /* correlation time of the wander: contact tip some 4 s, wire some 6 s */
#define MAP_MM 0.2f       /* standard deviation of a fresh map with the layer that is laid on it */
#define BIAS_MM 2.0f      /* ... of the current of an arc that nobody has compared, as a distance */
#define MOST_MM2 9.0f     /* of the gap, however long the arc was out */

waam_arc_level_t waam_arc_level_new(void)
{
    return (waam_arc_level_t){.bias_mm2 = BIAS_MM * BIAS_MM, .renewed = true};
}

static void wait_on(waam_arc_level_t *a, const waam_standoff_config_t *c, float seconds)
{
    a->gap_mm2 = fminf(a->gap_mm2 + c->arc_rise_mm2_s * seconds, MOST_MM2);
}

void waam_arc_level_strike(waam_arc_level_t *a, const waam_standoff_config_t *c, float out_s)
{
    if (a->renewed) {
        a->gap_mm = a->both_mm2 = 0.0f;
        a->gap_mm2 = MAP_MM * MAP_MM;
        a->renewed = false;
    } else {
        wait_on(a, c, out_s);
    }
    a->sum_mm = a->span_s = 0.0f;
    a->samples = 0;
    a->known = true;
}

void waam_arc_level_add(waam_arc_level_t *a, const waam_standoff_config_t *c, float mm, float dt_s)
{
    a->sum_mm += mm;
    a->span_s += dt_s;
    a->samples++;
    if (a->span_s < EVERY_S)
        return;
    wait_on(a, c, a->span_s);
    /* means over a time much shorter than LASTS_S, as if they were independent, with the noise of their mean in the long run */
    float noise = 2.0f * c->arc_wander_mm * c->arc_wander_mm * LASTS_S / a->span_s;
    float gap = a->gap_mm2 + a->both_mm2, bias = a->both_mm2 + a->bias_mm2, sum = gap + bias + noise;
    float off = a->sum_mm / (float)a->samples - a->gap_mm - a->bias_mm;
    a->gap_mm += gap / sum * off;
    a->bias_mm += bias / sum * off;
    a->gap_mm2 -= gap / sum * gap;
    a->both_mm2 -= gap / sum * bias;
    a->bias_mm2 -= bias / sum * bias;
    a->sum_mm = a->span_s = 0.0f;
    a->samples = 0;
}
