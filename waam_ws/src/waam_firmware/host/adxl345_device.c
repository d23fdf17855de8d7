#include "adxl345_device.h"

enum { DEVID = 0x00, BW_RATE = 0x2C, POWER_CTL = 0x2D, INT_SOURCE = 0x30, DATA_FORMAT = 0x31, DATA = 0x32, FIFO_CTL = 0x38,
       FIFO_STATUS = 0x39 };

void adxl345_device_start(adxl345_device_t *d)
{
    *d = (adxl345_device_t){.period_ns = 312500u};
    d->registers[DEVID] = 0xE5;
    d->registers[BW_RATE] = 0x0A;
}

static bool streams(const adxl345_device_t *d) { return d->registers[FIFO_CTL] >> 6 == 2; }

/* Without the FIFO there is one place. At 3200 Hz the lowest bit is 0. */
static void sample(adxl345_device_t *d, const int16_t value[3])
{
    unsigned room = streams(d) ? ADXL345_DEVICE_FIFO : 1;
    if (d->used == room) {
        d->overrun = true;
        d->used--;
        for (unsigned i = 0; i < d->used; i++)
            for (unsigned k = 0; k < 3; k++)
                d->fifo[i][k] = d->fifo[i + 1][k];
    }
    for (unsigned k = 0; k < 3; k++)
        d->fifo[d->used][k] = (int16_t)(value[k] & ~1);
    d->used++;
    d->taken++;
}

void adxl345_device_run(adxl345_device_t *d, uint32_t us, const int16_t value[3])
{
    if (!(d->registers[POWER_CTL] & 0x08) || d->registers[BW_RATE] != 0x0F)
        return;
    d->due_ns += us * 1000u;
    for (; d->due_ns >= d->period_ns; d->due_ns -= d->period_ns)
        sample(d, value);
}

static uint8_t peek(const adxl345_device_t *d, unsigned at)
{
    if (at == INT_SOURCE)
        return (uint8_t)((d->used ? 0x80 : 0) | (d->overrun ? 0x01 : 0));
    if (at == FIFO_STATUS)
        return (uint8_t)d->used;
    if (at >= DATA && at < DATA + 6) {
        int16_t value = d->used ? d->fifo[0][(at - DATA) / 2] : 0;
        return (uint8_t)((uint16_t)value >> ((at - DATA) % 2 ? 8 : 0));
    }
    return d->registers[at];
}

static void pop(adxl345_device_t *d)
{
    d->overrun = false;
    if (!d->used)
        return;
    d->used--;
    for (unsigned i = 0; i < d->used; i++)
        for (unsigned k = 0; k < 3; k++)
            d->fifo[i][k] = d->fifo[i + 1][k];
}

static void write(adxl345_device_t *d, unsigned at, uint8_t value)
{
    bool may = at >= 0x1D && at != INT_SOURCE && at != FIFO_STATUS && !(at >= DATA && at < DATA + 6);
    if (!may)
        return;
    d->registers[at] = value;
    if (at == FIFO_CTL && value >> 6 == 0)
        d->used = 0;
}

void adxl345_device_exchange(adxl345_device_t *d, const uint8_t *out, uint8_t *in, size_t count)
{
    uint8_t first = out[0];
    unsigned at = first & 0x3Fu;
    bool data = false;
    if (d->torn_off) {
        for (size_t i = 0; i < count; i++)
            in[i] = 0xFF;
        return;
    }
    in[0] = 0;
    for (size_t i = 1; i < count; i++) {
        uint8_t sent = out[i];
        in[i] = first & 0x80 ? peek(d, at) : 0;
        if (!(first & 0x80))
            write(d, at, sent);
        data = data || (first & 0x80 && at >= DATA && at < DATA + 6);
        if (first & 0x40)
            at = (at + 1) & 0x3Fu;
    }
    if (data)
        pop(d);
}
