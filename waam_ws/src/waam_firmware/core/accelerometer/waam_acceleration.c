/* The ring between the fast tick and the tick, and the line that its samples go out in. */
#include "waam_acceleration.h"

#include <stdatomic.h>

void waam_acceleration_want(waam_acceleration_t *a, bool on)
{
    a->wanted = false; /* the fast tick leaves the rest alone from here on */
    atomic_signal_fence(memory_order_seq_cst);
    a->put = a->got = a->dropped = a->sequence = 0;
    a->told = a->running = false;
    waam_adxl345_start(&a->sensor);
    atomic_signal_fence(memory_order_seq_cst);
    a->wanted = on;
}

static void keep(waam_acceleration_t *a, const int16_t value[3])
{
    if (a->put - a->got == WAAM_ACCELERATION_RING) {
        a->dropped = a->dropped + 1;
        return;
    }
    waam_acceleration_sample_t *at = &a->ring[a->put % WAAM_ACCELERATION_RING];
    *at = (waam_acceleration_sample_t){{value[0], value[1], value[2]}, a->fast_ticks};
    atomic_signal_fence(memory_order_release); /* the interrupt runs on the same core */
    a->put = a->put + 1;
}

size_t waam_acceleration_fast(waam_acceleration_t *a, const uint8_t *in, size_t count, uint8_t out[WAAM_ADXL345_BYTES])
{
    int16_t value[3];
    a->fast_ticks = a->fast_ticks + 1;
    if (!a->wanted)
        return 0;
    if (a->running && waam_adxl345_answer(&a->sensor, in, count, value))
        keep(a, value);
    a->running = true; /* what came back before was of another time */
    return waam_adxl345_ask(&a->sensor, out);
}

uint32_t waam_acceleration_lost(const waam_acceleration_t *a) { return a->dropped + a->sensor.overruns; }

void waam_acceleration_pack(const int16_t value[3], char text[7])
{
    uint64_t bits = 0;
    for (unsigned i = 0; i < 3; i++)
        bits = bits << 14 | ((uint32_t)((int32_t)value[i] + 8192) & 0x3FFFu);
    for (unsigned i = 7; i-- > 0; bits >>= 6)
        text[i] = (char)('0' + (bits & 63u));
}

bool waam_acceleration_line(waam_acceleration_t *a, uint64_t now_us, uint32_t fast_us, waam_text_t *line)
{
    char packed[7];
    if (!a->wanted || a->put - a->got < WAAM_ACCELERATION_LINE)
        return false;
    atomic_signal_fence(memory_order_acquire);
    uint32_t age = a->fast_ticks - a->ring[a->got % WAAM_ACCELERATION_RING].fast_tick;
    waam_text_add(line, "A ");
    waam_text_uint(line, a->sequence++);
    waam_text_char(line, ',');
    waam_text_uint(line, now_us - (uint64_t)age * fast_us);
    waam_text_char(line, ',');
    waam_text_uint(line, waam_acceleration_lost(a));
    waam_text_char(line, ',');
    for (unsigned i = 0; i < WAAM_ACCELERATION_LINE; i++) {
        waam_acceleration_pack(a->ring[(a->got + i) % WAAM_ACCELERATION_RING].value, packed);
        waam_text_bytes(line, packed, sizeof packed);
    }
    atomic_signal_fence(memory_order_release);
    a->got = a->got + WAAM_ACCELERATION_LINE;
    return true;
}
