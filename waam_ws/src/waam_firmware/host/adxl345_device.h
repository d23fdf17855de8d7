/* An ADXL345 as its data sheet says, behind its SPI pins: for the virtual controller, the emulated board and the tests. */
#ifndef WAAM_ADXL345_DEVICE_H
#define WAAM_ADXL345_DEVICE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define ADXL345_DEVICE_FIFO 32u

typedef struct {
    uint8_t registers[64];
    int16_t fifo[ADXL345_DEVICE_FIFO][3];
    unsigned used;
    bool overrun;
    uint32_t due_ns;            /* time that has passed since the last sample */
    uint32_t period_ns;         /* of its samples; its oscillator is not exact */
    uint32_t taken;             /* samples since power on */
    bool torn_off;              /* its wires, or none is fitted: the bus reads ones */
} adxl345_device_t;

/* Power on. */
void adxl345_device_start(adxl345_device_t *d);
/* Time goes on by `us` under this acceleration, counts of 3.9 mg. */
void adxl345_device_run(adxl345_device_t *d, uint32_t us, const int16_t value[3]);
/* One frame of chip select: `count` bytes each way, the first one an address. `in` and `out` may be the same. */
void adxl345_device_exchange(adxl345_device_t *d, const uint8_t *out, uint8_t *in, size_t count);

#endif
