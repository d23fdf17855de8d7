#include "waam_standoff.h"

#include <math.h>
#include <stddef.h>

#define FRESH_S 0.05f     /* without a good reading for longer nothing is followed */
#define LEARN_S 1.0f      /* of following, in which the arc's current is compared with the distance */
#define LEARN_MM 0.5f     /* ... and the distance must be right so far */
#define ASK_MM 0.5f       /* an error above this must answer to the correction */
#define ASK_S 0.15f       /* in which the error still comes through the filters */
#define APART_S 0.5f      /* sensor and arc may differ for so long */
#define AT_LIMIT_MM 0.01f
#define NEAREST 0.6f      /* of the contact distance: a way back does not lead nearer to the metal, as the arc tells */

static float inside(float value, float low, float high) { return value > high ? high : value < low ? low : value; }

static float toward(float value, float target, float change)
{
    return value + inside(target - value, -change, change);
}

void waam_standoff_init(waam_standoff_t *s)
{
    *s = (waam_standoff_t){.distance = {.quality = WAAM_DISTANCE_NONE}, .level = waam_arc_level_new()};
}

void waam_standoff_arm(waam_standoff_t *s)
{
    s->alarm = WAAM_STANDOFF_WELL;
    s->held = s->told = s->known = s->has_before = s->asking = s->arc_known = false;
    s->integral_mm_s = s->wanted_mm_s = 0.0f;
    s->following_s = s->waited_s = s->limit_s = s->apart_s = s->packet_s = 0.0f;
    s->ahead_first = s->ahead_count = 0;
    s->level.known = false;
    waam_distance_start(&s->distance);
}

void waam_standoff_forget(waam_standoff_t *s)
{
    s->arc_learned = false;
    s->arc_bias_mm = s->arc_sum_mm = 0.0f;
    s->arc_samples = 0;
    s->level = waam_arc_level_new();
}

void waam_standoff_rest(waam_standoff_t *s) { s->level.renewed = true; }

#define BACK "; back to the programmed z"

const char *waam_standoff_text(const waam_standoff_t *s)
{
    static const char *const texts[] = {
        "the distance is followed",
        "no reading of the distance that can be believed" BACK,
        "the reading of the distance does not change any more" BACK,
        "the distance does not answer to the torch: sign, unit or place of the sensor" BACK,
        "the correction stays at its limit" BACK,
        "the distance contradicts the arc's current" BACK,
    };
    return s->held ? "the correction stays at its limit: the metal is too high, the torch stays above it" : texts[s->alarm];
}

static void raise_alarm(waam_standoff_t *s, waam_standoff_alarm_t alarm)
{
    if (s->alarm == WAAM_STANDOFF_WELL)
        s->alarms++;
    s->alarm = alarm;
    s->held = s->told = false;
    s->wanted_mm_s = s->integral_mm_s = 0.0f;
}

/* ---- what is measured ---- */

/* Contact distance by the arc, less z: I = I0 (w/w0)^(p + bend ln(w/w0)) (1 - loss (d - d0)) turned round, with the current that the present
 * length of the arc takes away put back. Samples beyond the window count for nothing. */
static void look_at_arc(waam_standoff_t *s, const waam_standoff_config_t *c, const waam_ctwd_model_t *m,
                        const waam_standoff_inputs_t *in, float dt_s)
{
    s->arc_old_s += dt_s;
    s->arc_known = s->arc_known && in->lit && s->arc_old_s <= FRESH_S;
    if (!in->lit || !(in->wire_mm_s > 1.0f) || !(in->current_a > 1.0f))
        return;
    float current = in->current_a + c->arc_fall_a_per_v * (in->voltage_v - in->source_v);
    float speed = logf(in->wire_mm_s / m->wire_mm_s);
    float expected = m->current_a * expf(speed * (m->exponent + c->arc_bend * speed));
    float mm = m->ctwd_mm + (1.0f - current / expected) / m->loss_per_mm;
    float usual_mm = c->source == WAAM_STANDOFF_ARC ? c->set_mm : m->ctwd_mm;
    if (!(fabsf(mm - s->arc_bias_mm - usual_mm) <= c->window_mm))
        return;
    mm -= in->z_mm;
    s->arc_now_mm = mm;
    s->arc_mm = s->arc_known ? s->arc_mm + dt_s / (c->arc_average_s + dt_s) * (mm - s->arc_mm) : mm;
    s->arc_old_s = 0.0f;
    s->arc_known = true;
}

/* Keeps what the sensor sees ahead until the arc is there; what is said now holds for the arc's own place. */
static float at_the_arc(waam_standoff_t *s, const waam_standoff_config_t *c, float travelled_mm, float relative_mm)
{
    uint32_t here = (uint32_t)(travelled_mm / WAAM_STANDOFF_PREVIEW_MM);
    uint32_t there = (uint32_t)((travelled_mm + c->lead_mm) / WAAM_STANDOFF_PREVIEW_MM);
    if (s->ahead_count == 0 || there >= s->ahead_first + s->ahead_count + WAAM_STANDOFF_PREVIEW) {
        s->ahead_first = there;
        s->ahead_count = 0;
    }
    uint32_t next = s->ahead_first + s->ahead_count;
    s->ahead_mm[there % WAAM_STANDOFF_PREVIEW] = relative_mm;
    for (; next <= there; next++, s->ahead_count++)
        s->ahead_mm[next % WAAM_STANDOFF_PREVIEW] = relative_mm;
    if (s->ahead_count > WAAM_STANDOFF_PREVIEW) {
        s->ahead_first += s->ahead_count - WAAM_STANDOFF_PREVIEW;
        s->ahead_count = WAAM_STANDOFF_PREVIEW;
    }
    return s->ahead_mm[(here < s->ahead_first ? s->ahead_first : here) % WAAM_STANDOFF_PREVIEW];
}

/* The spot has left the way that it looked along: what it sees from now on has nothing to do with what it saw. */
static void look_elsewhere(waam_standoff_t *s)
{
    s->ahead_count = 0;
    waam_distance_elsewhere(&s->distance);
}

/* Contact tip or wire wander, and nothing else measures the distance. */
static bool wanders(const waam_standoff_config_t *c) { return c->source == WAAM_STANDOFF_ARC && c->arc_wander_mm > 0.0f; }

/* Contact distance less z by an arc that wanders. */
static float level(waam_standoff_t *s, const waam_standoff_config_t *c, const waam_standoff_inputs_t *in, float dt_s)
{
    if (in->mode == WAAM_STANDOFF_FOLLOW && s->arc_known) {
        if (!s->level.known)
            waam_arc_level_strike(&s->level, c, s->arc_out_s);
        waam_arc_level_add(&s->level, c, s->arc_now_mm + in->z_mm - s->correction_mm - c->set_mm, dt_s);
        s->arc_out_s = 0.0f;
    } else {
        s->arc_out_s += dt_s;
    }
    return s->level.gap_mm + s->correction_mm + c->set_mm - in->z_mm;
}

static void measure(waam_standoff_t *s, const waam_standoff_config_t *c, const waam_standoff_inputs_t *in, float dt_s)
{
    float relative = s->arc_mm - s->arc_bias_mm;
    if (wanders(c)) {
        relative = level(s, c, in, dt_s);
        s->known = s->arc_known && s->level.known;
    } else if (c->source == WAAM_STANDOFF_ARC) {
        s->known = s->arc_known;
    } else {
        waam_distance_packet(&s->distance, c, in->z_mm, &relative);
        waam_distance_quality_t q = s->distance.quality; /* one reading without echo is nothing, one beyond an edge is */
        bool seen = q == WAAM_DISTANCE_GOOD || q == WAAM_DISTANCE_NONE;
        s->known = s->distance.count > 0 && s->distance.bad_s <= FRESH_S && seen;
        if (s->distance.count > 0)
            relative = at_the_arc(s, c, in->travelled_mm, relative);
    }
    s->measured_mm = relative + in->z_mm;
}

/* ---- the laws: error (wanted less measured, positive = too near) to speed upwards ---- */

uint32_t waam_standoff_pulses(float error_mm)
{
    static const float above[] = {0.1f, 0.2f, 0.3f, 0.4f, 0.6f, 0.75f, 1.0f, 2.0f};
    static const uint8_t pulses[] = {1, 4, 7, 10, 13, 16, 19, 22};
    uint32_t count = 0;
    for (unsigned i = 0; i < sizeof pulses; i++)
        if (fabsf(error_mm) > above[i])
            count = pulses[i];
    return count;
}

static float relay(const waam_standoff_config_t *c, float error_mm)
{
    float speed = fabsf(error_mm) <= c->dead_mm ? 0.0f : (float)waam_standoff_pulses(error_mm) * c->pulse_mm / c->packet_s;
    return error_mm < 0.0f ? -speed : speed;
}

static float pid(waam_standoff_t *s, const waam_standoff_config_t *c, float error_mm)
{
    float error = fabsf(error_mm) <= c->dead_mm ? 0.0f : error_mm;
    float slope = s->has_before ? (error - s->before_mm) / c->packet_s : 0.0f;
    float grown = s->integral_mm_s + c->ki * error * c->packet_s;
    float speed = c->kp * error + grown + c->kd * slope;
    s->before_mm = error;
    s->has_before = true;
    /* no winding up: not at a limit of the speed, nor of the correction */
    bool over = fabsf(speed) > c->rate_mm_s || (s->correction_mm >= c->up_mm && error > 0.0f) ||
                (s->correction_mm <= -c->down_mm && error < 0.0f);
    if (!over || grown * error < 0.0f)
        s->integral_mm_s = grown;
    return speed;
}

/* ---- what must not be followed ---- */

/* The arc can be asked whether the sensor is right. */
static bool watched(const waam_standoff_t *s, const waam_standoff_config_t *c)
{
    return c->source != WAAM_STANDOFF_ARC && c->cross_mm > 0.0f && s->arc_known;
}

/* By how much the torch is too high by the arc, mm. */
static float high_by_arc(const waam_standoff_t *s, const waam_ctwd_model_t *m, float z_mm)
{
    return s->arc_mm + z_mm - s->arc_bias_mm - m->ctwd_mm;
}

/* Where the metal is higher than the program knows, the way back leads into it. The program itself may. */
static bool too_near(const waam_standoff_t *s, const waam_standoff_config_t *c, const waam_ctwd_model_t *m, float z_mm)
{
    return watched(s, c) && m->ctwd_mm + high_by_arc(s, m, z_mm) < NEAREST * m->ctwd_mm;
}

static bool apart(waam_standoff_t *s, const waam_standoff_config_t *c, const waam_ctwd_model_t *m, float z_mm, float dt_s)
{
    float off = high_by_arc(s, m, z_mm) - (s->measured_mm - c->set_mm);
    s->apart_s = watched(s, c) && s->arc_learned && fabsf(off) > c->cross_mm ? s->apart_s + dt_s : 0.0f;
    return s->apart_s > APART_S;
}

/* Either the sensor is right, or it lies and the program was: then the torch is too high by its correction. The arc says which
 * of the two is nearer the truth; a bias of some millimetres that nobody has learned yet does not matter for that. */
static bool arc_agrees(const waam_standoff_t *s, const waam_standoff_config_t *c, const waam_ctwd_model_t *m, float z_mm)
{
    float high = high_by_arc(s, m, z_mm);
    return watched(s, c) && fabsf(high - (s->measured_mm - c->set_mm)) < fabsf(high - s->correction_mm);
}

/* An error above ASK_MM must have gone when the correction has moved by as much and answer_mm more. */
static bool does_not_answer(waam_standoff_t *s, const waam_standoff_config_t *c, float error_mm, float dt_s)
{
    float size = fabsf(error_mm);
    if (size < ASK_MM || !s->known) {
        s->asking = s->asking && !s->known; /* what is not seen answers nothing */
        return false;
    }
    if (!s->asking) {
        s->asking = true;
        s->asked_s = s->asked_mm = 0.0f;
        s->asked_from_mm = s->correction_mm;
    }
    s->asked_s += dt_s;
    float filters_s = c->source == WAAM_STANDOFF_ARC ? ASK_S + 2.0f * c->arc_average_s : ASK_S;
    if (s->asked_s < filters_s && size > s->asked_mm)
        s->asked_mm = size;
    return fabsf(s->correction_mm - s->asked_from_mm) > s->asked_mm + c->answer_mm;
}

/* A torch that waits above for its strike does so for approach_s at most: no arc can say yet who is right. */
static bool at_limit(waam_standoff_t *s, const waam_standoff_config_t *c, bool approaches, float dt_s)
{
    if (!s->known)
        return s->limit_s > c->limit_s; /* a gap in the readings does not take it from the limit */
    bool up = s->correction_mm > c->up_mm - AT_LIMIT_MM && s->wanted_mm_s > 0.0f;
    bool down = s->correction_mm < AT_LIMIT_MM - c->down_mm && s->wanted_mm_s < 0.0f;
    s->limit_s = (up && !approaches) || down ? s->limit_s + dt_s : 0.0f;
    return s->limit_s > c->limit_s;
}

/* At the upper limit the metal is higher than the program may be corrected: the way back would lead into it. Where the arc
 * agrees with the sensor, the torch stays above; the alarm is told. */
static void stop_at_limit(waam_standoff_t *s, const waam_standoff_config_t *c, const waam_ctwd_model_t *m, float z_mm)
{
    bool above = s->correction_mm > 0.0f;
    if (above && s->held)
        return;
    raise_alarm(s, WAAM_STANDOFF_LIMIT);
    s->held = above && arc_agrees(s, c, m, z_mm);
}

static void supervise(waam_standoff_t *s, const waam_standoff_config_t *c, const waam_ctwd_model_t *m,
                      const waam_standoff_inputs_t *in, float error_mm, float dt_s)
{
    const waam_distance_t *d = &s->distance;
    bool sensor = c->source != WAAM_STANDOFF_ARC;
    if (sensor && d->bad_s > c->lost_s)
        raise_alarm(s, d->quality == WAAM_DISTANCE_STUCK ? WAAM_STANDOFF_STUCK : WAAM_STANDOFF_LOST);
    else if (!sensor && !s->arc_known && s->following_s > c->lost_s)
        raise_alarm(s, WAAM_STANDOFF_LOST);
    else if (does_not_answer(s, c, error_mm, dt_s))
        raise_alarm(s, WAAM_STANDOFF_NO_ANSWER);
    else if (apart(s, c, m, in->z_mm, dt_s))
        raise_alarm(s, WAAM_STANDOFF_CONTRADICTION);
    else if (at_limit(s, c, in->mode == WAAM_STANDOFF_APPROACH, dt_s))
        stop_at_limit(s, c, m, in->z_mm);
}

/* The arc's current differs from the model by wear, wire and calibration. What it is where the distance is right, by the sensor
 * or by the program at the start of the job, is learned once, without the filter, which keeps its first value. True: may act. */
static bool learned(waam_standoff_t *s, const waam_standoff_config_t *c, const waam_ctwd_model_t *m,
                    const waam_standoff_inputs_t *in, float error_mm)
{
    bool sensor = c->source != WAAM_STANDOFF_ARC;
    if (wanders(c))
        return true;
    if (s->arc_learned || !s->arc_known)
        return s->arc_learned || sensor;
    if (sensor && !s->known)
        return true;
    if (sensor && fabsf(error_mm) > LEARN_MM) {
        s->arc_samples = 0;
        return true;
    }
    if (s->arc_samples == 0)
        s->arc_s = s->following_s, s->arc_sum_mm = 0.0f;
    s->arc_sum_mm += s->arc_now_mm + in->z_mm - (sensor ? m->ctwd_mm - error_mm : c->set_mm);
    s->arc_samples++;
    if (s->following_s - s->arc_s >= LEARN_S) {
        s->arc_bias_mm = s->arc_sum_mm / (float)s->arc_samples;
        s->arc_learned = true;
    }
    return sensor || s->arc_learned;
}

/* ---- the correction ---- */

static void follow(waam_standoff_t *s, const waam_standoff_config_t *c, const waam_ctwd_model_t *m,
                   const waam_standoff_inputs_t *in, float dt_s)
{
    s->packet_s += dt_s;
    if (s->packet_s < c->packet_s - 0.5f * dt_s)
        return;
    float packet = s->packet_s;
    s->packet_s = 0.0f;
    measure(s, c, in, packet);
    float error = c->set_mm - s->measured_mm;
    bool follows = in->mode == WAAM_STANDOFF_FOLLOW, approaches = in->mode == WAAM_STANDOFF_APPROACH;
    if ((s->alarm != WAAM_STANDOFF_WELL && !s->held) || !(follows || approaches)) {
        s->has_before = s->asking = false;
        s->wanted_mm_s = s->distance.bad_s = 0.0f; /* glare while the arc strikes is no fault of the sensor */
        return;
    }
    s->following_s = follows ? s->following_s + packet : 0.0f;
    s->waited_s = approaches ? s->waited_s + packet : 0.0f;
    bool may = !follows || learned(s, c, m, in, error);
    if (may && s->known && (follows || c->source != WAAM_STANDOFF_ARC)) {
        s->wanted_mm_s = c->law == WAAM_STANDOFF_RELAY ? relay(c, error) : pid(s, c, error);
    } else {
        s->wanted_mm_s = 0.0f;
        s->has_before = false;
    }
    supervise(s, c, m, in, may ? error : 0.0f, packet);
}

/* Greatest speed from which the correction can still stop on its way. */
static float braking(float way_mm, float accel) { return way_mm > 0.0f ? sqrtf(2.0f * accel * way_mm) : 0.0f; }

static void move(waam_standoff_t *s, const waam_standoff_config_t *c, const waam_standoff_inputs_t *in, float speed, float dt_s)
{
    float up = fminf(c->up_mm - s->correction_mm, in->room_up_mm);
    float down = fminf(c->down_mm + s->correction_mm, in->room_down_mm);
    float rate = fminf(c->rate_mm_s, in->most_mm / dt_s);
    speed = inside(speed, -fminf(rate, braking(down, c->accel_mm_s2)), fminf(rate, braking(up, c->accel_mm_s2)));
    s->speed_mm_s = toward(s->speed_mm_s, speed, c->accel_mm_s2 * dt_s);
    s->correction_mm += inside(s->speed_mm_s * dt_s, -fmaxf(0.0f, fminf(down, in->most_mm)), fmaxf(0.0f, fminf(up, in->most_mm)));
}

static float homeward(const waam_standoff_t *s, const waam_standoff_config_t *c)
{
    float speed = braking(fabsf(s->correction_mm), 0.5f * c->accel_mm_s2);
    return s->correction_mm > 0.0f ? -speed : speed;
}

void waam_standoff_tick(waam_standoff_t *s, const waam_standoff_config_t *c, const waam_ctwd_model_t *arc,
                        const waam_standoff_inputs_t *in, float dt_s)
{
    look_at_arc(s, c, arc, in, dt_s);
    if (c->source != WAAM_STANDOFF_ARC)
        waam_distance_tick(&s->distance, c, in->reading, in->value, dt_s);
    if (in->turned && c->lead_mm > 0.0f)
        look_elsewhere(s);
    follow(s, c, arc, in, dt_s);
    bool ended = s->alarm != WAAM_STANDOFF_WELL && !s->held;
    bool home = in->mode == WAAM_STANDOFF_RETURN || (ended && in->mode != WAAM_STANDOFF_STAY);
    float before = s->correction_mm, back = homeward(s, c);
    if (back < 0.0f && too_near(s, c, arc, in->z_mm))
        back = 0.0f;
    move(s, c, in, home ? back : in->mode == WAAM_STANDOFF_STAY ? 0.0f : s->wanted_mm_s, dt_s);
    if (home && (before * s->correction_mm <= 0.0f || fabsf(s->correction_mm) < 1e-3f))
        s->correction_mm = s->speed_mm_s = 0.0f;
}

bool waam_standoff_ready(const waam_standoff_t *s, const waam_standoff_config_t *c)
{
    if (c->source == WAAM_STANDOFF_OFF || c->source == WAAM_STANDOFF_ARC || s->alarm != WAAM_STANDOFF_WELL ||
        s->waited_s >= c->approach_s)
        return true;
    return s->known && fabsf(c->set_mm - s->measured_mm) <= 0.2f + c->dead_mm && fabsf(s->speed_mm_s) < 1.0f;
}
