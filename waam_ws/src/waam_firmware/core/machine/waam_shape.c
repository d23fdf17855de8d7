/* Input shaping between the planned motion and the pulses: which motion is shaped, and when a line is told as done.
 *
 * What runs along a block is shaped; what moves the axes otherwise (homing, what a correction of z leaves) passes through,
 * for it comes only when the shaped motion stands. */
#include <math.h>

#include "waam_internal.h"

static float wire_lead_s(const waam_config_t *config)
{
    return (float)(config->wire_delay_s + config->wire_response_s);
}

const char *waam_core_tune(waam_core_t *core, const waam_shaper_config_t *settings)
{
    const char *why = waam_shaper_tune(&core->shaper, settings, (float)core->shaper_tick_us * 1e-6f,
                                       wire_lead_s(&core->config));
    if (why)
        waam_shaper_tune(&core->shaper, &core->config.shaper, (float)core->shaper_tick_us * 1e-6f,
                         wire_lead_s(&core->config));
    else
        core->config.shaper = *settings;
    core->planner.rounding = waam_rounding(&core->shaper, core->config.shaper.corner_mm);
    waam_shaper_rest(&core->shaper, waam_core_place(core));
    return why;
}

static void tell(waam_core_t *core)
{
    const waam_done_t *done = &core->done[core->done_first];
    core->executed = done->line;
    core->done_first = (core->done_first + 1) % WAAM_DONE;
    core->done_count--;
}

/* With no place left the newest line takes the others of its place with it: told later, never too early. */
void waam_core_done(waam_core_t *core, uint32_t line)
{
    core->planned = line;
    if (waam_shaper_settled(&core->shaper)) {
        core->executed = line;
        return;
    }
    core->done_count += core->done_count < WAAM_DONE;
    core->done[(core->done_first + core->done_count - 1) % WAAM_DONE] =
        (waam_done_t){line, core->shaper_ticks + core->shaper.span};
}

/* Ticks of another length: tuned anew as soon as the machine stands; off where they are too fine. */
static void retune(waam_core_t *core, uint32_t dt_us)
{
    const waam_shaper_config_t settings = core->config.shaper, none = {.axis = {{.type = WAAM_SHAPER_NONE}}, .corner_mm = settings.corner_mm};
    core->shaper_tick_us = dt_us;
    if (waam_core_tune(core, &settings))
        waam_core_tune(core, &none);
}

void waam_core_shape(waam_core_t *core, uint32_t dt_us)
{
    waam_shaper_t *shaper = &core->shaper;
    for (int i = 0; i < WAAM_AXES; i++)
        core->part[i] = core->motion.part[i];
    if (!shaper->on)
        return;
    if (waam_shaper_settled(shaper)) {
        if (dt_us != core->shaper_tick_us)
            retune(core, dt_us);
        waam_shaper_rest(shaper, waam_core_place(core));
        return;
    }
    waam_shaper_tick(shaper, waam_core_place(core), (int32_t)lround(core->motion.speed_mm_s * 1000.0), core->lag,
                     core->part, &core->shaped_um_s);
    bool settled = waam_shaper_settled(shaper);
    while (core->done_count && (settled || (int32_t)(core->shaper_ticks - core->done[core->done_first].due) >= 0))
        tell(core);
    core->shaper_ticks++;
}
