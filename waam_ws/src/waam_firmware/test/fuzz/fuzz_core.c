/* The whole controller: link, parser, planner, motion, arc and supervision on a small machine with a simple plant, driven by
 * a script that the fuzzer writes. One record per line of the input, chosen by its first byte:
 *
 *     ~<n>      n ticks of 1 ms                          =<n>   heartbeat whose lease is n ms old
 *     ^<chars>  toggle inputs and faults (see toggle)    !      resynchronise to the line that is expected
 *     $...      immediate line, sealed                   N...   queued line with that number, sealed
 *     %...      these bytes and a line feed              @...   these bytes alone
 *     &         the other end hangs up                   other  queued line with the right number, sealed
 *
 * After every tick the outputs are held against what docs/link_protocol.md promises, with bookkeeping of its own. */
#include <math.h>
#include <string.h>

#include "adxl345_device.h"
#include "fuzz.h"
#include "waam_core.h"

#define TICK_US 1000u
#define TICKS_MAX 1200u
#define HEARTBEAT_US 20000u
#define STRIKE_US 3000u

typedef struct {
    waam_core_t core;
    waam_config_t config;
    waam_inputs_t inputs;
    waam_outputs_t outputs;
    unsigned ticks;
    adxl345_device_t device;
    uint8_t bus[WAAM_ADXL345_BYTES];
    size_t bus_bytes;
    bool no_heartbeat, no_current, no_gas, slow_wire, stuck, implausible;
    uint64_t arc_us;             /* output on for this long */
    uint64_t hold_arc_us;        /* ... of which in HOLD */
    uint64_t fed_us;             /* last line with a good check given to the core */
    uint64_t granted_us;         /* last heartbeat answered: no lease can be younger */
    waam_state_t announced;
    unsigned announced_code;
    uint32_t acknowledged;
    char line[WAAM_LINE_MAX + 2]; /* that the host is sending */
    size_t line_length;
    bool real_time;              /* there is such a byte in it */
} bench_t;

static bench_t bench;

/* ---- what the controller sends ---- */

static unsigned long number_after(const char *line, const char *mark)
{
    const char *at = strstr(line, mark);
    REQUIRE(at, "field of a line");
    return strtoul(at + strlen(mark), NULL, 10);
}

/* HOLD and ALARM have a code, IDLE has none. RUN has that of a fault while the arc is struck again. */
static void require_code(const char *line)
{
    if (bench.announced != WAAM_RUN || !bench.announced_code) {
        REQUIRE((bench.announced >= WAAM_HOLD) == (bench.announced_code != 0), "HOLD and ALARM have a code, IDLE has none");
        return;
    }
    REQUIRE(bench.announced_code == WAAM_E_STUBBING, "only a fault whose reaction is RETRY is told in RUN");
    REQUIRE(bench.config.policy[WAAM_FAULT_STUBBING].reaction == WAAM_REACT_RETRY, "RETRY");
    REQUIRE(strstr(line, "; try "), "a RETRY says which one it is");
}

static void on_state(const char *line)
{
    static const char *const names[] = {"! IDLE E", "! RUN E", "! HOLD E", "! ALARM E"};
    for (int i = 0; i < 4; i++)
        if (strncmp(line, names[i], strlen(names[i])) == 0) {
            if (strtoul(line + strlen(names[i]), NULL, 10) == WAAM_E_ACCELEROMETER) {
                REQUIRE(i == (int)bench.core.state && bench.core.acceleration.sensor.fault, "told, the state stays");
                return;
            }
            bench.announced = (waam_state_t)i;
            bench.announced_code = (unsigned)strtoul(line + strlen(names[i]), NULL, 10);
            REQUIRE(strlen(line) > strlen(names[i]) + 4, "a state has a reason");
            require_code(line);
            return;
        }
    REQUIRE(false, "a known state");
}

static void on_line(void *context, const char *line, size_t bytes, waam_tx_kind_t kind)
{
    char text[512];
    size_t content;
    (void)context;
    REQUIRE(bytes > 2 && bytes <= 480 && line[bytes - 1] == '\n', "length of a sent line");
    REQUIRE(waam_check_line(line, bytes - 1, &content), "a sent line is sealed");
    for (size_t i = 0; i < content; i++)
        REQUIRE(line[i] >= ' ' && (uint8_t)line[i] <= '~', "a sent line is printable");
    memcpy(text, line, content);
    text[content] = '\0';
    REQUIRE((kind == WAAM_TX_TELEMETRY) == (text[0] == 'T'), "only telemetry may be dropped");
    if (text[0] == '!')
        on_state(text);
    else if (strncmp(text, "ok N", 4) == 0)
        bench.acknowledged = (uint32_t)number_after(text, "ok N");
    else if (strncmp(text, "$H ", 3) == 0 && !strstr(text, " error "))
        bench.granted_us = bench.core.now_us;
}

/* ---- what the controller gets ---- */

/* A line with real-time bytes may be a good one to the controller, which takes pairs of them out of it. */
static void sent(char byte)
{
    size_t content = 0;
    if (byte != '\n') {
        bench.line_length += bench.line_length < sizeof bench.line;
        bench.line[bench.line_length - 1] = byte;
        bench.real_time = bench.real_time || ((uint8_t)byte >= WAAM_BYTE_HOLD && (uint8_t)byte <= WAAM_BYTE_STOP);
        return;
    }
    if (bench.line_length && bench.line[bench.line_length - 1] == '\r')
        bench.line_length--;
    bool checked = bench.line_length <= WAAM_LINE_MAX && waam_check_line(bench.line, bench.line_length, &content);
    if (checked || bench.real_time)
        bench.fed_us = bench.core.now_us;
    bench.line_length = 0;
    bench.real_time = false;
}

static void feed_byte(char byte)
{
    sent(byte);
    waam_core_rx(&bench.core, (uint8_t)byte);
}

static void feed(const char *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++)
        feed_byte(bytes[i]);
}

static void hang_up(void)
{
    waam_core_hang_up(&bench.core);
    bench.real_time = false;
    bench.line_length = 0;
}

static void feed_sealed(const char *text, size_t count)
{
    waam_text_t line = {.length = 0};
    waam_text_bytes(&line, text, count < WAAM_LINE_MAX ? count : WAAM_LINE_MAX);
    waam_text_seal(&line, bench.core.link.strong);
    feed(line.text, line.length);
}

static void feed_numbered(const char *before, uint64_t number, const char *after, size_t count)
{
    waam_text_t line = {.length = 0};
    waam_text_add(&line, before);
    waam_text_uint(&line, number);
    waam_text_bytes(&line, after, count);
    feed_sealed(line.text, line.length);
}

static void heartbeat(uint64_t age_ms)
{
    uint64_t now = bench.core.now_us, age = age_ms * 1000u;
    feed_numbered("$H f ", age < now ? now - age : 0, "", 0);
}

static void toggle(char what)
{
    waam_inputs_t *in = &bench.inputs;
    switch (what) {
    case 'e': in->estop = !in->estop; break;
    case 'l': in->limit_switch = !in->limit_switch; break;
    case 'b': in->late = !in->late; break;
    case 'p': in->process = (waam_process_t)((in->process + 1) % 3); break;
    case 'h': bench.no_heartbeat = !bench.no_heartbeat; break;
    case 'c': bench.no_current = !bench.no_current; break;
    case 'g': bench.no_gas = !bench.no_gas; break;
    case 'w': bench.slow_wire = !bench.slow_wire; break;
    case 's': bench.stuck = !bench.stuck; break;
    case 'd': in->drive_fault = !in->drive_fault; break;
    case 't': in->over_temperature = !in->over_temperature; break;
    case 'i': in->temperature_c = in->temperature_c == 0.0 ? 95.0 : 0.0; break;
    case 'a': bench.device.torn_off = !bench.device.torn_off; break;
    case 'n': bench.implausible = !bench.implausible; break;
    default: break;
    }
}

/* ---- the plant ---- */

static void move_plant(void)
{
    static const double start_mm[WAAM_AXES] = {0.3, 0.4, 9.7};
    const waam_config_t *c = &bench.config;
    for (int i = 0; i < WAAM_AXES; i++) {
        double at = start_mm[i] + (double)bench.outputs.pulses[i] / c->steps_per_mm[i];
        bench.inputs.home_switch[i] = c->home_direction[i] < 0 ? at <= c->limit_min_mm[i] : at >= c->limit_max_mm[i];
    }
    bench.arc_us = bench.outputs.arc ? bench.arc_us + TICK_US : 0;
    bool burns = bench.arc_us >= STRIKE_US && !bench.no_current;
    bench.inputs.gas_ok = bench.outputs.gas && !bench.no_gas;
    bench.inputs.wire_mm_s = bench.outputs.wire_mm_s * (bench.slow_wire ? 0.5 : 1.0);
    bench.inputs.current_a = burns ? 180.0 : 0.0;
    bench.inputs.voltage_v = bench.stuck ? 0.5 : burns ? 22.0 : bench.outputs.arc ? 65.0 : bench.outputs.sense ? 12.0 : 0.0;
    if (bench.implausible)
        bench.inputs.voltage_v = NAN;
}

/* ---- what must hold ---- */

static void require_arc(void)
{
    const waam_core_t *c = &bench.core;
    const waam_arc_config_t *arc = &bench.config.arc;
    bench.hold_arc_us = bench.outputs.arc && c->state == WAAM_HOLD ? bench.hold_arc_us + TICK_US : 0;
    uint32_t ending_us = arc->crater_us + arc->burn_back_us + arc->pulses * arc->pulse_us;
    REQUIRE(bench.hold_arc_us <= ending_us + 2 * TICK_US, "HOLD ends the arc");
    REQUIRE(bench.outputs.voltage_v >= 0.0 && bench.outputs.voltage_v <= bench.config.voltage_max_v, "voltage setpoint");
    if (!bench.outputs.arc) {
        REQUIRE(bench.outputs.voltage_v == 0.0, "no voltage without the arc");
        return;
    }
    REQUIRE(c->state == WAAM_RUN || c->state == WAAM_HOLD, "arc only in RUN, or while HOLD ends it");
    REQUIRE(c->homed, "arc only when homed");
    REQUIRE(c->armed || c->state == WAAM_HOLD, "arc only when armed");
    REQUIRE(bench.granted_us && c->now_us < bench.granted_us + bench.config.lease_us, "arc only with a lease");
}

/* The fast ticks until the next tick never do more than the last one allowed. */
static void fast_ticks(void)
{
    waam_fast_inputs_t in = {.valid = bench.inputs.process == WAAM_PROCESS_OK,
                             .voltage_v = (float)bench.inputs.voltage_v, .current_a = (float)bench.inputs.current_a};
    for (unsigned i = 0; i < TICK_US / WAAM_FAST_US; i++) {
        waam_fast_outputs_t out = {.arc = true, .voltage_v = NAN};
        waam_core_fast(&bench.core, &in, &out);
        REQUIRE(!out.arc || bench.outputs.arc, "the source is on only when the tick said so");
        REQUIRE(out.voltage_v >= 0.0f && out.voltage_v <= (float)bench.config.voltage_max_v, "setpoint of the source");
        const int16_t value[3] = {(int16_t)(bench.ticks % 4000), -4096, 4095};
        adxl345_device_run(&bench.device, WAAM_FAST_US, value);
        bench.bus_bytes = waam_core_accelerometer(&bench.core, bench.bus, bench.bus_bytes, bench.bus);
        REQUIRE(bench.bus_bytes <= WAAM_ADXL345_BYTES, "an exchange");
        if (bench.bus_bytes)
            adxl345_device_exchange(&bench.device, bench.bus, bench.bus, bench.bus_bytes);
    }
}

static void require_motion(const int64_t before[WAAM_AXES])
{
    const waam_core_t *c = &bench.core;
    for (int i = 0; i < WAAM_AXES; i++) {
        double most = c->config.max_speed_mm_s[i] * 1e-6 * TICK_US * c->config.steps_per_mm[i] + 2.0;
        REQUIRE(fabs((double)bench.outputs.pulses[i] - (double)before[i]) <= most, "no axis jumps");
        double at = (double)(c->motion.steps[i] + c->lag[i]) / c->config.steps_per_mm[i], step = 1.5 / c->config.steps_per_mm[i];
        REQUIRE(!c->homed || (at >= c->config.limit_min_mm[i] - step && at <= c->config.limit_max_mm[i] + step),
                "inside the soft limits");
    }
    REQUIRE(isfinite(c->motion.speed_mm_s) && c->motion.speed_mm_s >= 0.0, "speed");
    REQUIRE(fabs(bench.outputs.wire_mm_s) <= bench.config.wire_max_mm_s + 1e-9, "wire speed");
}

static void require_state(bool limit_before)
{
    const waam_core_t *c = &bench.core;
    REQUIRE(c->state == bench.announced && (unsigned)c->fault == bench.announced_code, "every state was announced");
    REQUIRE(!bench.inputs.estop || c->state == WAAM_ALARM, "emergency stop");
    REQUIRE(!(bench.inputs.limit_switch && !limit_before) || c->state == WAAM_ALARM, "limit switch");
    REQUIRE(c->state != WAAM_RUN || c->now_us - bench.fed_us <= bench.config.link_timeout_us, "no RUN without a host");
    REQUIRE(c->state != WAAM_ALARM || (!bench.outputs.arc && bench.outputs.wire_mm_s == 0.0 && !c->homed && !c->armed),
            "ALARM blocks all outputs");
    REQUIRE(c->planner.count <= WAAM_BLOCKS && c->link.ring_used <= WAAM_RING_BYTES, "queues");
    REQUIRE(c->link.accepted <= c->link.received && c->executed <= c->link.accepted, "line numbers");
}

static void tick(void)
{
    int64_t before[WAAM_AXES];
    bool limit_before = bench.core.limit.pressed;
    if (++bench.ticks > TICKS_MAX)
        return;
    if (!bench.no_heartbeat && bench.core.now_us % HEARTBEAT_US == 0)
        heartbeat(0);
    memcpy(before, bench.outputs.pulses, sizeof before);
    waam_core_tick(&bench.core, TICK_US, &bench.inputs, &bench.outputs);
    fast_ticks();
    require_arc();
    require_motion(before);
    require_state(limit_before);
    move_plant();
}

/* ---- the script ---- */

static void ticks(const char *text, size_t count)
{
    unsigned long n = 0;
    for (size_t i = 0; i < count && i < 4 && text[i] >= '0' && text[i] <= '9'; i++)
        n = n * 10 + (unsigned long)(text[i] - '0');
    while (n--)
        tick();
}

static void record(const char *text, size_t count)
{
    char digits[8] = "";
    if (count == 0)
        return;
    memcpy(digits, text + 1, count - 1 < 7 ? count - 1 : 7);
    switch (text[0]) {
    case '~': ticks(text + 1, count - 1); break;
    case '=': heartbeat(strtoul(digits, NULL, 10)); break;
    case '!': feed_numbered("$L ", (uint64_t)bench.core.link.accepted + 1, "", 0); break;
    case '^':
        for (size_t i = 1; i < count; i++)
            toggle(text[i]);
        break;
    case '%': feed(text + 1, count - 1); feed("\n", 1); break;
    case '@': feed(text + 1, count - 1); break;
    case '&': hang_up(); break;
    case '$':
    case 'N': feed_sealed(text, count); break;
    default: {
        char line[WAAM_LINE_MAX];
        size_t room = count < sizeof line - 20 ? count : sizeof line - 20;
        line[0] = ' ';
        memcpy(line + 1, text, room);
        feed_numbered("N", (uint64_t)bench.core.link.received + 1, line, room + 1);
    }
    }
}

/* The machine of waam_config_default, made small and quick, so that a short script gets far. */
static waam_config_t small_machine(void)
{
    waam_config_t c = waam_config_default();
    const double size_mm[WAAM_AXES] = {20.0, 15.0, 10.0}, accel_mm_s2[WAAM_AXES] = {4000.0, 4000.0, 3000.0};
    memcpy(c.limit_max_mm, size_mm, sizeof c.limit_max_mm);
    memcpy(c.accel_mm_s2, accel_mm_s2, sizeof c.accel_mm_s2);
    memcpy(c.accel_most_mm_s2, accel_mm_s2, sizeof c.accel_most_mm_s2);
    c.boot_id = 1;
    c.home_seek_mm_s = 20.0;
    c.home_backoff_mm = 0.1;
    c.home_latch_mm_s = 20.0;
    c.telemetry_us = 40000;
    c.start_us = 1000000;
    c.arc.purge_us = 5000;
    c.arc.strike_us = 20000;
    c.arc.retry_pause_us = 5000;
    c.arc.established_us = 3000;
    c.arc.lost_us = c.arc.gas_missing_us = c.arc.wire_fault_us = 20000;
    c.arc.sense_us = 6000;
    c.arc.free_us = 2000;
    c.arc.pulse_us = 5000;
    c.arc.crater_us = 5000;
    c.arc.burn_back_us = 4000;
    c.arc.post_flow_us = 10000;
    c.link_timeout_us = c.lease_us = 60000;
    c.lease_margin_us = 2000;
    c.underrun_grace_us = 5000;
    return c;
}

static void run_script(const char *text, size_t size, waam_shaper_type_t shaper)
{
    bench = (bench_t){.config = small_machine(), .announced = WAAM_ALARM, .announced_code = WAAM_E_POWER_UP};
    for (int i = 0; i < WAAM_SHAPED_AXES; i++)
        bench.config.shaper.axis[i] = (waam_shaper_axis_t){.type = shaper, .hz = 80.0f + 40.0f * (float)i, .damping = 0.1f};
    bench.config.accelerometer = true;
    adxl345_device_start(&bench.device);
    waam_core_init(&bench.core, &bench.config, on_line, NULL);
    REQUIRE(bench.core.shaper.on == (shaper != WAAM_SHAPER_NONE), "the shaper is on");
    bench.inputs.process = WAAM_PROCESS_OK;
    bench.fed_us = bench.core.now_us;
    move_plant();
    while (size && bench.ticks <= TICKS_MAX) {
        const char *end = memchr(text, '\n', size);
        size_t length = end ? (size_t)(end - text) : size, used = end ? length + 1 : size;
        record(text, length);
        text += used;
        size -= used;
    }
    for (int i = 0; i < 30; i++) /* what the last record started */
        tick();
}

/* Every script without an input shaper and with one. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    run_script((const char *)data, size, WAAM_SHAPER_NONE);
    run_script((const char *)data, size, (waam_shaper_type_t)(1 + size % (WAAM_SHAPER_TYPES - 1)));
    return 0;
}
