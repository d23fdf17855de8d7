/* The torch held at its distance: when the standoff control may act, and its correction as steps of Z on top of the path.
 *
 * It acts while the arc burns and, with a distance sensor, while a strike waits. It stays where it is in arc start and end
 * and in HOLD, and goes back to the programmed z before anything else is done with the arc off. */
#include <math.h>

#include "waam_internal.h"

#define Z 2
#define CHORD_MM 1.0f      /* of path over which a direction is taken */
#define STRAIGHT 0.7f      /* cosine of the angle from which on the path has turned */

static bool off(const waam_core_t *core) { return core->config.standoff.source == WAAM_STANDOFF_OFF; }

bool waam_core_at_distance(waam_core_t *core)
{
    if (off(core))
        return true;
    if (core->arc.unchecked) {
        waam_arc_check(&core->arc); /* nothing moves with a wire that may be frozen */
        return false;
    }
    if (!core->approaching) {
        waam_standoff_arm(&core->standoff);
        core->tracked_mm = 0.0f;
        core->approaching = true;
    }
    core->approach_asked = !waam_standoff_ready(&core->standoff, &core->config.standoff);
    return !core->approach_asked;
}

static bool settled(const waam_core_t *core)
{
    const waam_arc_t *arc = &core->arc;
    return arc->phase == WAAM_ARC_BURNING && (float)arc->phase_us * 1e-6f >= core->config.standoff.settle_s;
}

static waam_standoff_mode_t mode(const waam_core_t *core)
{
    const waam_arc_t *arc = &core->arc;
    if (core->state != WAAM_RUN || core->stopping || core->retrying)
        return WAAM_STANDOFF_STAY;
    if (core->approach_asked)
        return WAAM_STANDOFF_APPROACH;
    if (arc->phase == WAAM_ARC_BURNING)
        return settled(core) ? WAAM_STANDOFF_FOLLOW : WAAM_STANDOFF_STAY;
    bool free = arc->phase == WAAM_ARC_OFF && !arc->unchecked && !core->arc_wanted;
    return free ? WAAM_STANDOFF_RETURN : WAAM_STANDOFF_STAY;
}

static float z_mm(const waam_core_t *core)
{
    return (float)waam_core_steps(core, Z) / (float)core->config.steps_per_mm[Z];
}

/* Way of the axis by the path in this tick. */
static float path_mm(waam_core_t *core)
{
    int32_t now = core->motion.steps[Z] + core->lag[Z], steps = now - core->z_before;
    core->z_before = now;
    return fabsf((float)steps) / (float)core->config.steps_per_mm[Z];
}

/* The path of the last millimetre goes elsewhere than that of the one before. */
static bool turned(waam_core_t *core)
{
    float at[2], way[2];
    for (int i = 0; i < 2; i++) {
        at[i] = (float)waam_core_steps(core, i) / (float)core->config.steps_per_mm[i];
        way[i] = at[i] - core->chord_mm[i];
    }
    float squared = way[0] * way[0] + way[1] * way[1];
    if (squared < CHORD_MM * CHORD_MM)
        return false;
    float length = sqrtf(squared), along = 0.0f;
    for (int i = 0; i < 2; i++) {
        along += way[i] / length * core->heading[i];
        core->heading[i] = way[i] / length;
        core->chord_mm[i] = at[i];
    }
    return along < STRAIGHT;
}

static waam_standoff_inputs_t look(waam_core_t *core, float dt_s)
{
    const waam_config_t *config = &core->config;
    const waam_inputs_t *in = &core->inputs;
    float z = z_mm(core);
    bool measured = in->process == WAAM_PROCESS_OK;
    return (waam_standoff_inputs_t){
        .mode = mode(core),
        .lit = measured && settled(core),
        .reading = in->distance_reading,
        .value = in->distance,
        .current_a = (float)in->current_a,
        .voltage_v = (float)in->voltage_v,
        .source_v = (float)waam_guard_source(core),
        .wire_mm_s = (float)in->wire_mm_s,
        .z_mm = z,
        .travelled_mm = core->tracked_mm,
        .turned = turned(core),
        .room_up_mm = (float)config->limit_max_mm[Z] - z,
        .room_down_mm = z - (float)config->limit_min_mm[Z],
        .most_mm = fmaxf(0.0f, (float)config->max_speed_mm_s[Z] * dt_s - path_mm(core)),
    };
}

void waam_core_track(waam_core_t *core, uint32_t dt_us)
{
    waam_standoff_t *s = &core->standoff;
    float dt_s = (float)dt_us * 1e-6f;
    if (off(core) || core->state == WAAM_ALARM || core->state == WAAM_IDLE) {
        core->approaching = core->approach_asked = false;
        waam_standoff_rest(&core->standoff);
        core->z_before = core->motion.steps[Z] + core->lag[Z];
        return;
    }
    if (core->arc.phase == WAAM_ARC_BURNING)
        core->tracked_mm += (float)waam_core_speed(core) * dt_s;
    core->approaching = core->approaching && (core->approach_asked || core->arc.phase != WAAM_ARC_OFF);
    const waam_standoff_inputs_t in = look(core, dt_s);
    waam_standoff_tick(s, &core->config.standoff, &core->config.regulator.ctwd, &in, dt_s);
    core->z_correction = (int32_t)lroundf(s->correction_mm * (float)core->config.steps_per_mm[Z]);
    core->approach_asked = false;
    if (s->alarm != WAAM_STANDOFF_WELL && !s->told) {
        s->told = true;
        waam_core_tell(core, WAAM_E_STANDOFF, waam_standoff_text(s));
    }
}

bool waam_core_back_on_path(waam_core_t *core)
{
    if (core->z_correction != 0 && !core->arc.unchecked && !off(core))
        return false;
    double mm = (double)core->z_correction / core->config.steps_per_mm[Z];
    core->plan_mm[Z] += mm;
    core->path_mm[Z] += mm;
    waam_core_absorb(core);
    return true;
}
