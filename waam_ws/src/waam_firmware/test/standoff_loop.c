/* The standoff control as a shared library, without motion, arc sequence and link: whoever calls it brings sensor, arc and
 * metal (tests). One loop at a time. */
#include <string.h>

#include "waam_core.h"

static waam_standoff_t state;
static waam_standoff_config_t config;
static waam_ctwd_model_t arc;
static waam_standoff_inputs_t inputs;

typedef struct {
    float correction_mm, measured_mm;
    int32_t alarm, known, ready, alarms;
} standoff_loop_answer_t;

/* The shipped settings, nothing followed yet. */
void standoff_loop_start(void);
/* NULL, or what is wrong. */
const char *standoff_loop_set(const char *name, double value);
/* Greatest whole of the settings: NULL, or the name of the one that does not fit. */
const char *standoff_loop_check(void);
/* A new arc. */
void standoff_loop_arm(void);
/* The machine has rested: what is laid from now on follows a newer map. */
void standoff_loop_rest(void);
/* Until changed: mode (waam_standoff_mode_t), the z that the program asks for, path travelled, source voltage. */
void standoff_loop_path(int32_t mode, float z_mm, float travelled_mm, float source_v);
/* The path turns in the next millisecond. */
void standoff_loop_turn(void);
/* One millisecond. `reading` counts up with every new value; the arc's values are 0 where it does not burn. */
void standoff_loop_step(uint32_t reading, float value, float current_a, float voltage_v, float wire_mm_s,
                        standoff_loop_answer_t *answer);
float standoff_loop_infrared_mm(float counts);
uint32_t standoff_loop_pulses(float error_mm);

static float program_z_mm;

void standoff_loop_start(void)
{
    const waam_config_t all = waam_config_default();
    config = all.standoff;
    arc = all.regulator.ctwd;
    program_z_mm = 0.0f;
    inputs = (waam_standoff_inputs_t){.mode = WAAM_STANDOFF_FOLLOW, .room_up_mm = 1000.0f, .room_down_mm = 1000.0f,
                                      .most_mm = 0.1f};
    waam_standoff_init(&state);
    waam_standoff_arm(&state);
}

const char *standoff_loop_set(const char *name, double value)
{
    const waam_setting_t *setting = waam_setting_find(waam_standoff_settings, name, strlen(name));
    return !setting ? "unknown" : waam_setting_put(setting, &config, value) ? NULL : "out of range";
}

const char *standoff_loop_check(void)
{
    const waam_setting_t *wrong = waam_standoff_check(&config);
    return wrong ? wrong->name : NULL;
}

void standoff_loop_arm(void) { waam_standoff_arm(&state); }

void standoff_loop_rest(void) { waam_standoff_rest(&state); }

void standoff_loop_path(int32_t mode, float z_mm, float travelled_mm, float source_v)
{
    inputs.mode = (waam_standoff_mode_t)mode;
    program_z_mm = z_mm;
    inputs.travelled_mm = travelled_mm;
    inputs.source_v = source_v;
}

void standoff_loop_turn(void) { inputs.turned = true; }

void standoff_loop_step(uint32_t reading, float value, float current_a, float voltage_v, float wire_mm_s,
                        standoff_loop_answer_t *answer)
{
    inputs.lit = current_a > 0.0f;
    inputs.reading = reading;
    inputs.value = value;
    inputs.current_a = current_a;
    inputs.voltage_v = voltage_v;
    inputs.wire_mm_s = wire_mm_s;
    inputs.z_mm = program_z_mm + state.correction_mm;
    waam_standoff_tick(&state, &config, &arc, &inputs, 1e-3f);
    inputs.turned = false;
    *answer = (standoff_loop_answer_t){.correction_mm = state.correction_mm, .measured_mm = state.measured_mm,
                                       .alarm = (int32_t)state.alarm, .known = state.known,
                                       .ready = waam_standoff_ready(&state, &config), .alarms = (int32_t)state.alarms};
}

float standoff_loop_infrared_mm(float counts) { return waam_infrared_mm(counts); }

uint32_t standoff_loop_pulses(float error_mm) { return waam_standoff_pulses(error_mm); }
