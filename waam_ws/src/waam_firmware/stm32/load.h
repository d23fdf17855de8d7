/* How much of the processor each part uses: time spent and longest run, without what interrupted it. The unit is that of
 * board_clock: cycles on the board; under QEMU nanoseconds of virtual time, which with -icount stand for instructions. */
#ifndef WAAM_STM32_LOAD_H
#define WAAM_STM32_LOAD_H

#include "board.h"

/* In the order of priority: each is interrupted only by those before it. */
typedef enum { LOAD_STEPS, LOAD_LINK, LOAD_FAST, LOAD_TICK, LOADS } load_part_t;

typedef struct {
    uint32_t runs, longest;
    uint64_t total;
} load_t;

/* Returns the stamp for load_end. */
uint32_t load_begin(load_part_t part);
void load_end(load_part_t part, uint32_t begun);
/* What was measured since the last call. */
load_t load_take(load_part_t part);

#endif
