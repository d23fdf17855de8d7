/* Sensors that lie, at random: standoff_faults [runs [seed [wander]]]. A part that rises by up to 3 mm, lies up to 3 mm lower than
 * the program takes it to be, or has a step within that; a laser, the infrared sensor or the arc; one fault at a random
 * moment. Whatever the sensor says, the torch must not come closer to the metal than half its contact distance. With `wander`
 * (mm) it is always the arc, and the control is told of a contact tip that wanders so far.
 *
 * One line per kind of fault: name, runs, smallest contact distance (mm), runs closer than half of it, runs with an alarm,
 * and runs that ended on the programmed z. Exit status 1 when any came too close. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "waam_core.h"

#define CONTACT_MM 15.0
#define LEAST_MM (0.5 * CONTACT_MM)
#define RISE_MM 3.0
#define SECONDS 14.0
#define DT_S 1e-3

typedef enum { NONE, DEAD, NO_ECHO, STUCK, DRIFT, SIGN, UNIT, DROP_OUTS, OFFSET, NOISE, GLITCHES, KINDS } kind_t;

static const char *const names[KINDS] = {"none", "dead", "no_echo", "stuck", "drift", "wrong_sign",
                                         "wrong_unit", "drop_outs", "offset", "noise", "glitches"};

static uint64_t dice;

static double chance(double low, double high) /* xorshift64* */
{
    dice ^= dice >> 12, dice ^= dice << 25, dice ^= dice >> 27;
    return low + (high - low) * (double)(dice * 0x2545F4914F6CDD1Du >> 11) * 0x1p-53;
}

static double normal(void) { return sqrt(-2.0 * log(chance(1e-12, 1.0))) * cos(6.283185307179586 * chance(0.0, 1.0)); }

/* ---- the metal: rises while it is welded, is not where it should be, has a step ---- */

typedef struct {
    double rise_mm, rise_s, offset_mm, step_mm, step_s;
} metal_t;

static metal_t random_metal(void)
{
    metal_t m = {.rise_s = chance(2.0, 20.0), .step_s = chance(1.0, SECONDS), .offset_mm = chance(-RISE_MM, 0.0)};
    double room = RISE_MM - m.offset_mm;
    m.rise_mm = chance(0.0, room);
    m.step_mm = chance(-3.0, room - m.rise_mm);
    return m;
}

static double height_mm(const metal_t *m, double t_s)
{
    double h = m->offset_mm + m->rise_mm * fmin(1.0, t_s / m->rise_s) + (t_s > m->step_s ? m->step_mm : 0.0);
    return fmax(-6.0, fmin(RISE_MM, h));
}

/* ---- sensors and arc: physics of their own ---- */

static double infrared_counts(double mm)
{
    double low = 58.0, high = 631.0; /* turned round by halving */
    for (int i = 0; i < 40; i++) {
        double u = 0.5 * (low + high);
        double l = ((((-5e-11 * u + 1e-7) * u - 8e-5) * u + 3.24e-2) * u - 6.84) * u + 698.49;
        if (l > mm)
            low = u;
        else
            high = u;
    }
    return low;
}

typedef struct {
    kind_t kind;
    double at_s, size, start;
    bool held;
} fault_t;

static fault_t random_fault(kind_t kind)
{
    static const double units[] = {1e-3, 0.1, 1.0 / 25.4, 10.0, 25.4, 1000.0, 5.0 / 3.3, 0.25};
    fault_t f = {.kind = kind, .at_s = chance(0.0, 1.0) < 0.3 ? 0.0 : chance(0.0, 0.8 * SECONDS)};
    switch (kind) {
    case DRIFT: f.size = pow(10.0, chance(-1.5, 1.0)) * (chance(0.0, 1.0) < 0.7 ? 1.0 : -1.0); break; /* mm/s */
    case UNIT: f.size = units[(int)chance(0.0, 7.999)]; break;
    case OFFSET: f.size = chance(-15.0, 15.0); break;
    case NOISE: f.size = pow(10.0, chance(-1.0, 1.5)); break;
    default: break;
    }
    return f;
}

/* What is read of a true value v around its usual one; `scale`: of one mm in units of v. */
static double faulty(fault_t *f, double v, double usual, double scale, double t_s)
{
    if (t_s < f->at_s)
        return v;
    if (!f->held)
        f->start = v, f->held = true;
    switch (f->kind) {
    case NO_ECHO: return NAN;
    case STUCK: return f->start;
    case DRIFT: return v + f->size * scale * (t_s - f->at_s);
    case SIGN: return 2.0 * usual - v;
    case UNIT: return v * f->size;
    case DROP_OUTS: return chance(0.0, 1.0) < 0.1 ? (chance(0.0, 1.0) < 0.5 ? (double)NAN : 0.0) : v;
    case OFFSET: return v + f->size * scale;
    case NOISE: return v + f->size * scale * normal();
    case GLITCHES: return chance(0.0, 1.0) < 0.1 ? v + scale * chance(-12.0, 12.0) : v;
    default: return v;
    }
}

/* ---- one run ---- */

typedef struct {
    double least_mm;
    bool alarm, programmed;
} outcome_t;

static outcome_t run(kind_t kind, float wander_mm)
{
    const waam_config_t all = waam_config_default();
    waam_standoff_config_t c = all.standoff;
    c.source = 1 + (uint32_t)chance(0.0, 2.9999);
    if (wander_mm > 0.0f)
        c.source = WAAM_STANDOFF_ARC, c.arc_wander_mm = wander_mm;
    c.law = chance(0.0, 1.0) < 0.5 ? WAAM_STANDOFF_RELAY : WAAM_STANDOFF_PID;
    bool by_arc = c.source == WAAM_STANDOFF_ARC, laser = c.source == WAAM_STANDOFF_LASER;
    if (by_arc)
        c.set_mm = (float)CONTACT_MM, c.kp = 2.0f, c.ki = 0.5f, c.answer_mm = 3.0f;
    if (c.source == WAAM_STANDOFF_INFRARED)
        c.kp = 2.0f, c.ki = 0.5f, c.jump_mm = 3.0f, c.dead_mm = 0.2f;
    metal_t metal = random_metal();
    fault_t fault = random_fault(kind);
    waam_standoff_t s;
    waam_standoff_init(&s);
    waam_standoff_arm(&s);
    waam_standoff_inputs_t in = {.room_up_mm = 100.0f, .room_down_mm = 100.0f, .most_mm = 0.1f, .source_v = 22.0f};
    outcome_t o = {.least_mm = 1e9};
    double wear = chance(0.97, 1.03), current_a = 138.0 * wear, length_v = 0.0, period_ms = laser ? 2.0 : 16.5, due_ms = 0.0;
    for (int ms = 0; ms < (int)(SECONDS / DT_S); ms++) {
        double t_s = ms * DT_S, gap = CONTACT_MM + (double)s.correction_mm - height_mm(&metal, t_s);
        o.least_mm = fmin(o.least_mm, gap);
        length_v += -length_v * 0.02 + 0.2 * 0.45 * normal();
        current_a += (138.0 * wear * (1.0 - 0.024 * (gap - 15.0)) - 7.0 * length_v - current_a) * 0.12;
        in.mode = t_s < 1.5 && !by_arc && !waam_standoff_ready(&s, &c) ? WAAM_STANDOFF_APPROACH : WAAM_STANDOFF_FOLLOW;
        in.lit = in.mode == WAAM_STANDOFF_FOLLOW;
        in.z_mm = s.correction_mm;
        in.travelled_mm = (float)(8.0 * t_s);
        in.wire_mm_s = 110.0f;
        if (ms % 10 == 0) {
            double read = current_a + 1.5 * normal();
            in.current_a = (float)(!by_arc ? read : kind == DEAD && t_s >= fault.at_s ? 0.0 : faulty(&fault, read, 138.0, -3.3, t_s));
            in.voltage_v = (float)(22.0 + length_v + 0.15 * normal());
        }
        if (ms >= due_ms && !(kind == DEAD && t_s >= fault.at_s)) {
            double mm = 85.0 + gap, v = laser ? round(100.0 * mm + normal()) / 100.0 : round(infrared_counts(mm) + 2.0 * normal());
            due_ms += period_ms;
            in.reading++;
            in.value = (float)(by_arc ? 100.0 : faulty(&fault, v, laser ? 100.0 : 266.0, laser ? 1.0 : -3.2, t_s));
        }
        waam_standoff_tick(&s, &c, &all.regulator.ctwd, &in, 1e-3f);
        if (!isfinite(s.correction_mm)) {
            o.least_mm = -1e9;
            break;
        }
    }
    o.alarm = s.alarms > 0;
    o.programmed = s.correction_mm == 0.0f;
    return o;
}

int main(int argc, char **argv)
{
    long runs = argc > 1 ? strtol(argv[1], NULL, 10) : 1000;
    float wander_mm = argc > 3 ? strtof(argv[3], NULL) : 0.0f;
    unsigned close = 0, count[KINDS] = {0}, near[KINDS] = {0}, alarms[KINDS] = {0}, home[KINDS] = {0};
    double least[KINDS];
    dice = argc > 2 ? strtoull(argv[2], NULL, 10) * 0x9E3779B97F4A7C15u + 1 : 1;
    for (int k = 0; k < KINDS; k++)
        least[k] = 1e9;
    for (long i = 0; i < runs; i++) {
        kind_t kind = (kind_t)(i % KINDS);
        outcome_t o = run(kind, wander_mm);
        count[kind]++;
        near[kind] += o.least_mm < LEAST_MM;
        close += o.least_mm < LEAST_MM;
        alarms[kind] += o.alarm;
        home[kind] += o.alarm && o.programmed;
        least[kind] = fmin(least[kind], o.least_mm);
    }
    for (int k = 0; k < KINDS; k++)
        printf("%s %u %.3f %u %u %u\n", names[k], count[k], least[k], near[k], alarms[k], home[k]);
    return close ? 1 : 0;
}
