/* From the sensor to the lines of the link: samples cross from the fast tick to the tick in a ring, with their time. */
#ifndef WAAM_ACCELERATION_H
#define WAAM_ACCELERATION_H

#include "waam_adxl345.h"
#include "waam_text.h"

#define WAAM_ACCELERATION_RING 128u /* 40 ms; a power of two */
#define WAAM_ACCELERATION_LINE 16u  /* samples of one line */

typedef struct {
    int16_t value[3];           /* counts */
    uint32_t fast_tick;         /* in which it was found */
} waam_acceleration_sample_t;

typedef struct {
    volatile bool wanted;       /* by the tick */
    bool running;               /* the fast tick has begun */
    waam_adxl345_t sensor;      /* of the fast tick */
    volatile uint32_t fast_ticks, put, got, dropped; /* dropped: no room in the ring */
    waam_acceleration_sample_t ring[WAAM_ACCELERATION_RING];
    bool told;                  /* the fault was told */
    uint32_t sequence;          /* of the next line */
} waam_acceleration_t;

/* From the tick: begins or ends; what waits is forgotten, lines count from 0. */
void waam_acceleration_want(waam_acceleration_t *a, bool on);
/* In every fast tick: what came back of the last exchange (`count` 0 = none), and the next one into `out`. Returns its
 * bytes, 0 = none. */
size_t waam_acceleration_fast(waam_acceleration_t *a, const uint8_t *in, size_t count, uint8_t out[WAAM_ADXL345_BYTES]);
/* Samples lost since it began: at least so many. */
uint32_t waam_acceleration_lost(const waam_acceleration_t *a);
/* A full line "A <sequence>,<t_us of its first sample>,<lost>,<samples>" is there: appends it. `fast_us`: of a fast tick. */
bool waam_acceleration_line(waam_acceleration_t *a, uint64_t now_us, uint32_t fast_us, waam_text_t *line);
/* Seven characters, '0' to 'o', of six bits each: three times 14 bits, count plus 8192, x first. */
void waam_acceleration_pack(const int16_t value[3], char text[7]);

#endif
