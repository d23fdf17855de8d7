/* The input shaper as a shared library, without planner, link and machine: planned steps in, shaped steps out, for tests and
 * benches that bring their own plant. One shaper at a time. */
#include <string.h>

#include "waam_core.h"

static waam_shaper_config_t config;
static waam_shaper_t shaper;

typedef struct {
    uint32_t span;              /* ticks */
    float delay_s, corner_s, corner_s2;
} shaper_loop_figures_t;

/* The shipped settings, which shape nothing. */
void shaper_loop_start(void);
/* NULL, or what is wrong. */
const char *shaper_loop_set(const char *name, double value);
/* NULL, or why these settings cannot be used. The machine stands at 0. */
const char *shaper_loop_tune(float tick_s, float delay_most_s, shaper_loop_figures_t *figures);
/* Of axis 0 or 1, in continuous time; the number of impulses. */
uint32_t shaper_loop_impulses(uint32_t axis, float amplitude[WAAM_SHAPER_IMPULSES], float time_s[WAAM_SHAPER_IMPULSES]);
/* Of a channel (X, Y, Z, path speed), in ticks and shares of 2^30; the number of taps. */
uint32_t shaper_loop_taps(uint32_t channel, uint32_t ago[WAAM_SHAPER_TAPS], int32_t weight[WAAM_SHAPER_TAPS]);
/* `ticks` rows of planned steps in, of shaped ones out. */
void shaper_loop_run(const int32_t *planned, uint32_t ticks, int32_t *shaped);
/* The machine stands and nothing is under way. */
bool shaper_loop_settled(void);

void shaper_loop_start(void) { config = waam_shaper_default(); }

const char *shaper_loop_set(const char *name, double value)
{
    const waam_setting_t *setting = waam_setting_find(waam_shaper_settings, name, strlen(name));
    return !setting ? "unknown" : waam_setting_put(setting, &config, value) ? NULL : "out of range";
}

const char *shaper_loop_tune(float tick_s, float delay_most_s, shaper_loop_figures_t *figures)
{
    const char *why = waam_shaper_tune(&shaper, &config, tick_s, delay_most_s);
    *figures = (shaper_loop_figures_t){shaper.span, shaper.delay_s, shaper.corner_s, shaper.corner_s2};
    return why;
}

uint32_t shaper_loop_impulses(uint32_t axis, float amplitude[WAAM_SHAPER_IMPULSES], float time_s[WAAM_SHAPER_IMPULSES])
{
    waam_impulses_t s = waam_shaper_impulses(&config.axis[axis]);
    memcpy(amplitude, s.amplitude, sizeof s.amplitude);
    memcpy(time_s, s.time_s, sizeof s.time_s);
    return s.count;
}

uint32_t shaper_loop_taps(uint32_t channel, uint32_t ago[WAAM_SHAPER_TAPS], int32_t weight[WAAM_SHAPER_TAPS])
{
    memcpy(ago, shaper.taps[channel].ago, sizeof shaper.taps[channel].ago);
    memcpy(weight, shaper.taps[channel].weight, sizeof shaper.taps[channel].weight);
    return shaper.taps[channel].count;
}

void shaper_loop_run(const int32_t *planned, uint32_t ticks, int32_t *shaped)
{
    const int32_t whole[WAAM_AXES] = {0};
    int32_t before[WAAM_AXES] = {0}, lag[WAAM_AXES], part[WAAM_AXES], speed;
    for (uint32_t k = 0; k < ticks; k++, planned += WAAM_AXES, shaped += WAAM_AXES) {
        if (memcmp(before, planned, sizeof before) != 0)
            waam_shaper_wake(&shaper);
        memcpy(before, planned, sizeof before);
        waam_shaper_tick(&shaper, (waam_place_t){planned, whole}, 0, lag, part, &speed);
        for (int i = 0; i < WAAM_AXES; i++)
            shaped[i] = planned[i] + (shaper.on ? lag[i] : 0);
    }
}

bool shaper_loop_settled(void) { return waam_shaper_settled(&shaper); }
