/* The accelerometer ADXL345 (Analog Devices, data sheet rev. G) as exchanges of bytes over SPI; knows no bus and no clock.
 *
 * One exchange per call, at least 3200 a second: the shell sends what waam_adxl345_ask wrote, and hands what came back to
 * waam_adxl345_answer before it asks again. Every sample is read with the register of the data format before it, so a
 * sensor that was torn off, or has lost its supply and its settings, is found by the first reading.
 */
#ifndef WAAM_ADXL345_H
#define WAAM_ADXL345_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define WAAM_ADXL345_BYTES 9u   /* of the longest exchange: an address and eight registers */
#define WAAM_ADXL345_PER_G 256  /* counts, full resolution: 3.9 mg each */
#define WAAM_ADXL345_TOP 4096   /* counts are from -4096 to 4095 */

typedef enum {
    WAAM_ADXL345_GOOD,
    WAAM_ADXL345_ABSENT,        /* another device id, or none */
    WAAM_ADXL345_DEAF,          /* does not keep its settings */
    WAAM_ADXL345_LOST,          /* answered once and does no longer, or has lost its settings */
    WAAM_ADXL345_SILENT         /* answers and has no samples */
} waam_adxl345_fault_t;

typedef struct {
    uint8_t step;               /* of the sequence in waam_adxl345.c; its last one is reading */
    uint8_t bad;                /* readings in a row that cannot be */
    uint8_t fault;              /* waam_adxl345_fault_t; it stays until waam_adxl345_start */
    uint16_t empty;             /* readings in a row without a sample */
    uint32_t overruns;          /* times that the sensor's buffer was full: at least one sample lost each */
} waam_adxl345_t;

/* Identify, set up, read; forgets the last fault. */
void waam_adxl345_start(waam_adxl345_t *s);
/* Bytes of the next exchange into `out`; 0 = nothing to say. */
size_t waam_adxl345_ask(const waam_adxl345_t *s, uint8_t out[WAAM_ADXL345_BYTES]);
/* What came back, `count` bytes, 0 = the bus did not finish. True: a sample, counts along the sensor's axes. */
bool waam_adxl345_answer(waam_adxl345_t *s, const uint8_t *in, size_t count, int16_t sample[3]);
/* What is wrong, for people. */
const char *waam_adxl345_text(waam_adxl345_fault_t fault);

#endif
