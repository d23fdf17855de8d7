/* The words that set a controller at rest: `$C` with every name, `$M`, `$I`. Each line of the input is the rest of a `$` line, sealed here;
 * a line that begins with '~' is a tick, with ten fast ticks of the accelerometer.
 *
 * After every line: one answer, sealed and printable; what is refused changes nothing; what is taken lies within its range,
 * which is written down here once more; a shaper in force fits into the lead of the wire, its weights sum up to one and lie
 * within its span, and `$I` tells it; nothing has moved: with other steps per mm the place in mm is what it was, and homing
 * is lost. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "adxl345_device.h"
#include "fuzz.h"
#include "waam_core.h"

#define TICKS_MAX 40u

typedef struct {
    waam_core_t core;
    waam_config_t config;
    adxl345_device_t device;
    uint8_t bus[WAAM_ADXL345_BYTES];
    size_t bus_bytes;
    unsigned answers, ticks;
    char answer[512];
} bench_t;

static bench_t bench;
static const double place_mm[WAAM_AXES] = {123.456, 0.0, -1e6};

static void on_line(void *context, const char *line, size_t bytes, waam_tx_kind_t kind)
{
    size_t content;
    (void)context, (void)kind;
    REQUIRE(bytes > 2 && bytes <= 480 && line[bytes - 1] == '\n', "length of a sent line");
    REQUIRE(waam_check_line(line, bytes - 1, &content), "a sent line is sealed");
    for (size_t i = 0; i < content; i++)
        REQUIRE(line[i] >= ' ' && (uint8_t)line[i] <= '~', "a sent line is printable");
    if (line[0] != '$')
        return;
    memcpy(bench.answer, line, content);
    bench.answer[content] = '\0';
    bench.answers++;
}

static void require_range(double value, double low, double high, const char *what)
{
    REQUIRE(value >= low - 1e-6 && value <= high + 1e-6, what); /* false for what is not a number */
}

static void require_settings(void)
{
    const waam_config_t *c = &bench.core.config;
    for (int i = 0; i < WAAM_SHAPED_AXES; i++) {
        REQUIRE(c->shaper.axis[i].type < WAAM_SHAPER_TYPES, "shape_x, shape_y");
        require_range((double)c->shaper.axis[i].hz, 5.0, 200.0, "shape_x_hz, shape_y_hz");
        require_range((double)c->shaper.axis[i].damping, 0.0, 0.2, "shape_x_damping, shape_y_damping");
    }
    require_range((double)c->shaper.corner_mm, 0.005, 1.0, "shape_corner_mm");
    require_range(c->wire_delay_s, 0.0, 0.25, "wire_delay_s");
    require_range(c->wire_lag_s, 0.0, 0.5, "wire_lag_s");
    require_range(c->wire_response_s, 0.005, 0.25, "wire_response_s");
    require_range(c->arc.wire_fault_ratio, 0.5, 0.99, "wire_underfeed_ratio");
    for (int i = 0; i < WAAM_AXES; i++) {
        double steps = c->steps_per_mm[i], speed = c->max_speed_mm_s[i];
        require_range(steps, 10.0, 77e3 / speed, "steps_per_mm");
        REQUIRE(round(steps * 1e3) / 1e3 == steps, "steps_per_mm in thousandths");
        REQUIRE(steps == bench.core.motion.steps_per_mm[i] && steps == bench.core.kinematics.steps_per_mm[i], "in force");
    }
    for (int i = 0; i < WAAM_AXES; i++) {
        double accel = c->accel_mm_s2[i];
        require_range(accel, 50.0, 5000.0, "max_accel");
        REQUIRE(round(accel * 1e3) / 1e3 == accel, "max_accel in thousandths");
        REQUIRE(accel == bench.core.kinematics.accel_mm_s2[i], "in force");
        REQUIRE(i == 2 ? c->accel_most_mm_s2[i] == bench.config.accel_most_mm_s2[i] : accel <= c->accel_most_mm_s2[i],
                "no more than the machine has");
        require_range(c->accel_most_mm_s2[i], 50.0, 5000.0, "accel_limit");
    }
    for (int i = 0; i < WAAM_AXES; i++) {
        REQUIRE(c->limit_min_mm[i] == 0.0, "the envelope begins at 0");
        require_range(c->limit_max_mm[i], 50.0, 3500.0, "envelope");
        require_range(c->max_speed_mm_s[i], 10.0, 500.0, "max_speed");
        REQUIRE(c->max_speed_mm_s[i] == bench.core.kinematics.max_speed_mm_s[i], "in force");
        REQUIRE(abs(c->home_direction[i]) == 1 && (i < 2 || c->home_direction[i] == 1), "home_direction");
    }
    require_range(c->home_seek_mm_s, 5.0, 100.0, "home_seek_speed");
    require_range(c->home_latch_mm_s, 0.5, 5.0, "home_latch_speed");
    require_range(c->rapid_mm_s, 10.0, 500.0, "rapid_speed");
    REQUIRE(c->temperature.input <= WAAM_TEMPERATURE_AMPLIFIER, "temperature_input");
    require_range(c->temperature.low_c, -273.0, 3000.0, "temperature_low_c");
    require_range(c->temperature.high_c, -273.0, 3000.0, "temperature_high_c");
    REQUIRE(!c->temperature.input || c->temperature.high_c > c->temperature.low_c, "ends of the signal");
    REQUIRE(c->standoff.source <= 3 && c->standoff.average >= 1 && c->standoff.average <= WAAM_STANDOFF_AVERAGE, "standoff");
}

static void require_shaper(void)
{
    const waam_shaper_t *s = &bench.core.shaper;
    const waam_config_t *c = &bench.core.config;
    bool wanted = c->shaper.axis[0].type || c->shaper.axis[1].type;
    REQUIRE(s->on == wanted, "the shaper is on when an axis has one");
    if (!s->on)
        return;
    REQUIRE((double)s->delay_s <= c->wire_delay_s + c->wire_response_s + 1e-6, "the wire leads the shaped time");
    REQUIRE(s->span < WAAM_SHAPER_PAST && s->span > 0, "span");
    for (int i = 0; i < WAAM_SHAPER_CHANNELS; i++) {
        int64_t sum = 0;
        REQUIRE(s->taps[i].count >= 1 && s->taps[i].count <= WAAM_SHAPER_TAPS, "taps");
        for (uint32_t k = 0; k < s->taps[i].count; k++) {
            REQUIRE(s->taps[i].ago[k] <= s->span, "a tap lies within the span");
            sum += s->taps[i].weight[k];
        }
        REQUIRE(sum == WAAM_SHAPER_ONE, "weights sum up to one");
    }
}

static void require_rest(void)
{
    REQUIRE(bench.core.state == WAAM_ALARM || bench.core.state == WAAM_IDLE, "at rest");
    for (int i = 0; i < WAAM_AXES; i++)
        REQUIRE(bench.core.motion.steps[i] == lround(place_mm[i] * bench.core.config.steps_per_mm[i]), "the place in mm stays");
    for (int i = 0; i < WAAM_AXES; i++)
        REQUIRE(bench.core.motion.steps[i] - bench.core.motion.datum_steps[i] == 0 && bench.core.lag[i] == 0 &&
                bench.core.path_mm[i] == place_mm[i], "nothing moves");
}

static void line(const char *text, size_t length)
{
    waam_text_t sealed = {.length = 0};
    waam_config_t before = bench.core.config;
    bool known = true, homed = bench.core.homed;
    for (size_t i = 0; i < length; i++) /* what a link would take out or never let through */
        known = known && text[i] >= ' ' && (uint8_t)text[i] <= '~' && text[i] != '*';
    if (!known || length > WAAM_LINE_MAX - 20 || length == 0 || !strchr("CMITL", text[0]))
        return;
    bench.answers = 0;
    waam_text_char(&sealed, '$');
    waam_text_bytes(&sealed, text, length);
    waam_text_seal(&sealed, true);
    for (size_t i = 0; i < sealed.length; i++)
        waam_core_rx(&bench.core, (uint8_t)sealed.text[i]);
    REQUIRE(bench.answers == 1, "one answer");
    bool rescaled = memcmp(before.steps_per_mm, bench.core.config.steps_per_mm, sizeof before.steps_per_mm) != 0;
    bool resized = memcmp(before.limit_max_mm, bench.core.config.limit_max_mm, sizeof before.limit_max_mm) != 0 ||
                   memcmp(before.home_direction, bench.core.config.home_direction, sizeof before.home_direction) != 0;
    REQUIRE(bench.core.homed == (homed && !rescaled && !resized), "other steps per mm, envelope, way of homing lose homing");
    REQUIRE(!resized || text[0] == 'C', "the envelope by $C only");
    REQUIRE(!rescaled || text[0] == 'C', "steps per mm by $C only");
    bool accelerated = memcmp(before.accel_mm_s2, bench.core.config.accel_mm_s2, sizeof before.accel_mm_s2) != 0;
    REQUIRE(!accelerated || text[0] == 'C', "accelerations by $C only");
    bool refused = strstr(bench.answer, " error E") != NULL;
    REQUIRE(bench.answer[1] == text[0] || (refused && bench.answer[1] == '?'), "the letter of the question");
    REQUIRE(!refused || memcmp(&before, &bench.core.config, sizeof before) == 0, "what is refused changes nothing");
    REQUIRE(refused || text[0] != 'I' || bench.core.shaper.on == (strstr(bench.answer, " shape=") != NULL), "$I tells it");
    require_settings();
    require_shaper();
    require_rest();
}

static void tick(void)
{
    const waam_inputs_t inputs = {.process = WAAM_PROCESS_OK, .part_v = 0.1f * (float)bench.ticks};
    const waam_fast_inputs_t in = {.valid = false};
    const int16_t value[3] = {(int16_t)bench.ticks, -4096, 4095};
    waam_outputs_t outputs;
    waam_fast_outputs_t out;
    if (++bench.ticks > TICKS_MAX)
        return;
    for (unsigned i = 0; i < 10; i++) {
        adxl345_device_run(&bench.device, WAAM_FAST_US, value);
        waam_core_fast(&bench.core, &in, &out);
        bench.bus_bytes = waam_core_accelerometer(&bench.core, bench.bus, bench.bus_bytes, bench.bus);
        REQUIRE(bench.bus_bytes <= WAAM_ADXL345_BYTES, "an exchange");
        if (bench.bus_bytes)
            adxl345_device_exchange(&bench.device, bench.bus, bench.bus, bench.bus_bytes);
    }
    waam_core_tick(&bench.core, 1000, &inputs, &outputs);
    require_rest();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const char *text = (const char *)data;
    bench.ticks = 0;
    bench.bus_bytes = 0;
    bench.config = waam_config_default();
    bench.config.boot_id = 1;
    bench.config.accelerometer = true;
    bench.config.part_temperature = true;
    bench.config.starts_in_alarm = size % 2;
    waam_core_init(&bench.core, &bench.config, on_line, NULL);
    bench.core.homed = !bench.config.starts_in_alarm;
    for (int i = 0; i < WAAM_AXES; i++) {
        bench.core.plan_mm[i] = bench.core.path_mm[i] = place_mm[i];
        waam_motion_declare(&bench.core.motion, i, (int32_t)lround(place_mm[i] * bench.config.steps_per_mm[i]));
    }
    adxl345_device_start(&bench.device);
    while (size) {
        const char *end = memchr(text, '\n', size);
        size_t length = end ? (size_t)(end - text) : size, used = end ? length + 1 : size;
        if (length && text[0] == '~')
            tick();
        else
            line(text, length);
        text += used;
        size -= used;
    }
    return 0;
}
