/* The accelerometer: set-up, rate, order, losses and faults, from the sensor's registers to the lines of the link. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "adxl345_device.h"
#include "waam_core.h"

#define REQUIRE(condition)                                                                     \
    do {                                                                                       \
        if (!(condition)) {                                                                    \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #condition);                    \
            exit(1);                                                                           \
        }                                                                                      \
    } while (0)
#define LINES_MAX 4096

typedef struct {
    waam_core_t core;
    waam_config_t config;
    waam_inputs_t inputs;
    waam_outputs_t outputs;
    adxl345_device_t device;
    uint8_t bus[WAAM_ADXL345_BYTES];
    size_t bus_bytes;
    bool deaf;                  /* the bus finishes nothing */
    int32_t ramp;               /* x of the device's next fast tick */
    char heard[LINES_MAX][200];
    unsigned lines;
} bench_t;

static bench_t *b;

static void on_line(void *context, const char *line, size_t bytes, waam_tx_kind_t kind)
{
    (void)context, (void)kind;
    REQUIRE(bytes <= WAAM_LINE_MAX + 1 || line[0] == '$');
    if (b->lines == LINES_MAX || bytes >= sizeof b->heard[0])
        return;
    memcpy(b->heard[b->lines], line, bytes);
    b->heard[b->lines++][bytes] = '\0';
}

static void say(const char *words)
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, words);
    waam_text_seal(&text, true);
    for (size_t i = 0; i < text.length; i++)
        waam_core_rx(&b->core, (uint8_t)text.text[i]);
}

static const char *last(const char *start)
{
    for (unsigned i = b->lines; i-- > 0;)
        if (strncmp(b->heard[i], start, strlen(start)) == 0)
            return b->heard[i];
    return "";
}

static unsigned count(const char *start)
{
    unsigned found = 0;
    for (unsigned i = 0; i < b->lines; i++)
        found += strncmp(b->heard[i], start, strlen(start)) == 0;
    return found;
}

static void begin(bool accelerometer)
{
    free(b);
    b = calloc(1, sizeof *b);
    REQUIRE(b);
    b->config = waam_config_default();
    b->config.accelerometer = accelerometer;
    b->config.starts_in_alarm = false;
    b->config.start_us = 5000000;
    waam_core_init(&b->core, &b->config, on_line, NULL);
    adxl345_device_start(&b->device);
    say("$I");
}

/* Ten fast ticks of 100 us and the tick, as on the board: what an exchange read is there at the next fast tick. */
static void run(unsigned ms, bool ticks)
{
    const waam_fast_inputs_t in = {.valid = false};
    waam_fast_outputs_t out;
    for (unsigned i = 0; i < 10 * ms; i++) {
        const int16_t value[3] = {(int16_t)(b->ramp % 4000), -256, (int16_t)(-b->ramp % 4000)};
        b->ramp += 2;
        adxl345_device_run(&b->device, WAAM_FAST_US, value);
        waam_core_fast(&b->core, &in, &out);
        b->bus_bytes = waam_core_accelerometer(&b->core, b->bus, b->deaf ? 0 : b->bus_bytes, b->bus);
        if (b->bus_bytes)
            adxl345_device_exchange(&b->device, b->bus, b->bus, b->bus_bytes);
        if (ticks && i % 10 == 9)
            waam_core_tick(&b->core, 1000, &b->inputs, &b->outputs);
    }
}

typedef struct {
    unsigned long sequence, lost;
    unsigned long long t_us;
    unsigned samples;
    int value[WAAM_ACCELERATION_LINE][3];
} line_t;

static line_t parse(const char *text)
{
    line_t line = {0};
    int used = 0;
    REQUIRE(sscanf(text, "A %lu,%llu,%lu,%n", &line.sequence, &line.t_us, &line.lost, &used) == 3);
    for (text += used; *text != '*'; text += 7, line.samples++) {
        uint64_t bits = 0;
        for (unsigned i = 0; i < 7; i++) {
            REQUIRE(text[i] >= '0' && text[i] <= 'o');
            bits = bits << 6 | (uint64_t)(text[i] - '0');
        }
        for (unsigned k = 0; k < 3; k++)
            line.value[line.samples][k] = (int)(bits >> (28 - 14 * k) & 0x3FFF) - 8192;
    }
    return line;
}

/* Every sample of the device once and in order, with its time. */
static void test_stream(void)
{
    unsigned seen = 0;
    int before = 0;
    unsigned long long first_us = 0, at_us = 0;
    begin(true);
    say("$M@7 1");
    REQUIRE(strncmp(last("$M"), "$M@7 ok", 7) == 0);
    run(1500, true);
    for (unsigned i = 0; i < b->lines; i++) {
        if (b->heard[i][0] != 'A')
            continue;
        line_t line = parse(b->heard[i]);
        REQUIRE(line.sequence == seen / WAAM_ACCELERATION_LINE && line.lost == 0 && line.samples == WAAM_ACCELERATION_LINE);
        for (unsigned k = 0; k < line.samples; k++, seen++) {
            int x = line.value[k][0], step = (x - before + 4000) % 4000;
            REQUIRE(seen == 0 || step == 6 || step == 8); /* three or four fast ticks of 2 apart: none is missing */
            REQUIRE(line.value[k][1] == -256 && line.value[k][2] == -x);
            before = x;
        }
        at_us = line.t_us;
        first_us = first_us ? first_us : at_us;
    }
    double rate = (seen - WAAM_ACCELERATION_LINE) / (double)(at_us - first_us) * 1e6;
    REQUIRE(seen > 4600 && fabs(rate / 3200.0 - 1.0) < 1e-3);
    REQUIRE(count("T ") >= 149); /* telemetry goes on beside it */
    say("$M 0");
    unsigned lines = count("A ");
    run(50, true);
    REQUIRE(count("A ") == lines);
}

/* A tick that does not come for long: what found no room is counted, and the line says so. */
static void test_losses(void)
{
    begin(true);
    say("$M 1");
    run(100, true);
    run(60, false);
    run(50, true);
    line_t line = parse(last("A "));
    REQUIRE(line.lost > 0);
    b->device.overrun = true; /* the sensor's own buffer was full */
    unsigned long lost = line.lost;
    run(30, true);
    REQUIRE(parse(last("A ")).lost == lost + 1);
    say("$M 1"); /* begins anew */
    run(30, true);
    REQUIRE(parse(last("A ")).lost == 0 && parse(last("A ")).sequence < 6);
}

static void expect_fault(const char *text)
{
    char wanted[120];
    snprintf(wanted, sizeof wanted, "! IDLE E213 %s", text);
    REQUIRE(count(wanted) == 1);
    unsigned lines = count("A ");
    run(50, true);
    REQUIRE(count(wanted) == 1 && count("A ") == lines && b->core.state == WAAM_IDLE && b->core.fault == WAAM_OK);
}

static void test_faults(void)
{
    begin(false);
    say("$M 1");
    REQUIRE(strncmp(last("$M"), "$M error E108", 13) == 0 && !strstr(last("$I"), "ACCEL"));

    begin(true);
    b->device.registers[0] = 0xE4;
    say("$M 1");
    run(50, true);
    expect_fault("accelerometer: no ADXL345 answers");

    begin(true);
    b->device.torn_off = true;
    say("$M 1");
    run(50, true);
    expect_fault("accelerometer: no ADXL345 answers");
    b->device.torn_off = false;
    say("$M 1");
    run(50, true);
    REQUIRE(count("A ") > 5);
    b->device.torn_off = true;
    run(50, true);
    expect_fault("accelerometer: the ADXL345 was lost");

    begin(true);
    say("$M 1");
    run(50, true);
    adxl345_device_start(&b->device); /* its supply was away for a moment */
    run(50, true);
    expect_fault("accelerometer: the ADXL345 was lost");

    begin(true);
    say("$M 1");
    run(50, true);
    b->device.period_ns = 4000000000u;
    run(50, true);
    expect_fault("accelerometer: the ADXL345 gives no samples");

    begin(true);
    b->deaf = true;
    say("$M 1");
    run(50, true);
    expect_fault("accelerometer: no ADXL345 answers");
}

/* Noise on the wires of the sensor: one reading that cannot be costs at most itself. */
static void test_noise(void)
{
    begin(true);
    say("$M 1");
    for (unsigned i = 0; i < 20; i++) {
        run(20, true);
        memset(b->bus, (int)(i * 37 % 256), sizeof b->bus);
    }
    REQUIRE(count("! ") == 0 && count("A ") > 70);
}

static void test_other_hosts(void)
{
    begin(true);
    say("$M 1");
    run(50, true);
    REQUIRE(count("A ") > 5);
    waam_core_hang_up(&b->core);
    unsigned lines = count("A ");
    run(50, true);
    REQUIRE(count("A ") == lines && !b->core.acceleration.wanted);
    const char *wrong[] = {"$M", "$M 2", "$M x", "$M 1 1", "$M -1"};
    say("$I");
    for (unsigned i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        say(wrong[i]);
        REQUIRE(strncmp(last("$M"), "$M error", 8) == 0 && !b->core.acceleration.wanted);
    }
}

/* Every count there and back. */
static void test_packing(void)
{
    for (int x = -WAAM_ADXL345_TOP; x < WAAM_ADXL345_TOP; x++) {
        const int16_t value[3] = {(int16_t)x, (int16_t)(-1 - x), (int16_t)(x / 2)};
        char text[64] = "A 0,0,0,";
        waam_acceleration_pack(value, text + 8);
        text[15] = '*';
        line_t line = parse(text);
        REQUIRE(line.samples == 1 && line.value[0][0] == x && line.value[0][1] == -1 - x && line.value[0][2] == x / 2);
    }
}

int main(void)
{
    test_packing();
    test_stream();
    test_losses();
    test_faults();
    test_noise();
    test_other_hosts();
    free(b);
    puts("acceleration: all properties hold");
    return 0;
}
