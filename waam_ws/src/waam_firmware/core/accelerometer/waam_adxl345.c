/* Set-up and readings of the ADXL345. */
#include "waam_adxl345.h"

enum { DEVID = 0x00, BW_RATE = 0x2C, POWER_CTL = 0x2D, INT_ENABLE = 0x2E, INT_SOURCE = 0x30, DATA_FORMAT = 0x31,
       FIFO_CTL = 0x38 };
enum { READ = 0x80, SEVERAL = 0x40 }; /* in the address byte */
enum { DEVICE = 0xE5, RATE_3200 = 0x0F, FULL_16_G = 0x0B, MEASURE = 0x08, STREAM = 0x80, BYPASS = 0x00 };
enum { DATA_READY = 0x80, OVERRUN = 0x01 };
enum { BAD_MOST = 5, EMPTY_MOST = 100 };

typedef enum { IS, PUT } deed_t;

/* IS: the register must hold the value. Standby first, because the settings are to change while nothing is measured; the
 * bypass empties the buffer. */
static const struct {
    uint8_t deed, at, value, fault;
} steps[] = {
    {IS, DEVID, DEVICE, WAAM_ADXL345_ABSENT},
    {PUT, POWER_CTL, 0, 0},
    {PUT, INT_ENABLE, 0, 0},
    {PUT, BW_RATE, RATE_3200, 0},
    {PUT, DATA_FORMAT, FULL_16_G, 0},
    {PUT, FIFO_CTL, BYPASS, 0},
    {PUT, FIFO_CTL, STREAM, 0},
    {IS, BW_RATE, RATE_3200, WAAM_ADXL345_DEAF},
    {IS, DATA_FORMAT, FULL_16_G, WAAM_ADXL345_DEAF},
    {IS, FIFO_CTL, STREAM, WAAM_ADXL345_DEAF},
    {PUT, POWER_CTL, MEASURE, 0},
};
#define STEPS (sizeof steps / sizeof steps[0])

void waam_adxl345_start(waam_adxl345_t *s) { *s = (waam_adxl345_t){.step = 0}; }

size_t waam_adxl345_ask(const waam_adxl345_t *s, uint8_t out[WAAM_ADXL345_BYTES])
{
    if (s->fault)
        return 0;
    for (unsigned i = 0; i < WAAM_ADXL345_BYTES; i++)
        out[i] = 0;
    if (s->step == STEPS) {
        out[0] = READ | SEVERAL | INT_SOURCE; /* what there is, the format, six bytes of data */
        return WAAM_ADXL345_BYTES;
    }
    bool put = steps[s->step].deed == PUT;
    out[0] = (uint8_t)(steps[s->step].at | (put ? 0 : READ));
    out[1] = put ? steps[s->step].value : 0;
    return 2;
}

/* A reading that cannot be is tried again: one may be noise on the wires. */
static bool bad(waam_adxl345_t *s, waam_adxl345_fault_t fault)
{
    if (++s->bad == BAD_MOST)
        s->fault = (uint8_t)fault;
    return false;
}

static void set_up(waam_adxl345_t *s, const uint8_t *in, size_t count)
{
    if (count < 2 || (steps[s->step].deed == IS && in[1] != steps[s->step].value)) {
        bad(s, steps[s->step].fault ? (waam_adxl345_fault_t)steps[s->step].fault : WAAM_ADXL345_ABSENT);
        return;
    }
    s->bad = 0;
    s->step++;
}

/* 13 bits with their sign; anything else is no reading. */
static bool decode(const uint8_t *in, int16_t sample[3])
{
    for (unsigned i = 0; i < 3; i++) {
        uint32_t raw = (uint32_t)in[2 * i] | (uint32_t)in[2 * i + 1] << 8;
        int32_t value = (int32_t)(raw & 0x8000u ? raw | 0xFFFF0000u : raw);
        if (value < -WAAM_ADXL345_TOP || value >= WAAM_ADXL345_TOP)
            return false;
        sample[i] = (int16_t)value;
    }
    return true;
}

static bool read(waam_adxl345_t *s, const uint8_t *in, size_t count, int16_t sample[3])
{
    if (count < WAAM_ADXL345_BYTES || in[2] != FULL_16_G)
        return bad(s, WAAM_ADXL345_LOST);
    if (in[1] & OVERRUN)
        s->overruns++;
    if (!(in[1] & DATA_READY)) {
        if (++s->empty == EMPTY_MOST)
            s->fault = WAAM_ADXL345_SILENT;
        return false;
    }
    if (!decode(in + 3, sample))
        return bad(s, WAAM_ADXL345_LOST);
    s->bad = 0;
    s->empty = 0;
    return true;
}

bool waam_adxl345_answer(waam_adxl345_t *s, const uint8_t *in, size_t count, int16_t sample[3])
{
    if (s->fault)
        return false;
    if (s->step == STEPS)
        return read(s, in, count, sample);
    set_up(s, in, count);
    return false;
}

const char *waam_adxl345_text(waam_adxl345_fault_t fault)
{
    switch (fault) {
    case WAAM_ADXL345_ABSENT: return "accelerometer: no ADXL345 answers";
    case WAAM_ADXL345_DEAF: return "accelerometer: the ADXL345 does not keep its settings";
    case WAAM_ADXL345_LOST: return "accelerometer: the ADXL345 was lost";
    case WAAM_ADXL345_SILENT: return "accelerometer: the ADXL345 gives no samples";
    default: return "";
    }
}
