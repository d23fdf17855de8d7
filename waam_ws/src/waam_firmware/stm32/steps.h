/* Spreads the pulses of each tick over the millisecond that follows it. The timer makes the pulses by itself; its interrupt
 * only says, one slot ahead, which axes get one. */
#ifndef WAAM_STM32_STEPS_H
#define WAAM_STM32_STEPS_H

#include "board.h"

#define STEP_SLOTS (STEP_HZ / (1000000u / TICK_US)) /* per tick */

/* False: enough ticks are waiting to be given out; the next one comes later. */
bool steps_room(void);
/* Once per tick: where the axes shall be at the end of the next tick: pulses since the start, and what is beyond them in
 * 1 / WAAM_PARTS (from minus a half to below a half), which says when the pulses before and after are due. */
void steps_push(const int64_t target[STEP_AXES], const int32_t part[STEP_AXES]);
/* Pulses given out so far, modulo 2^32. */
void steps_given(int32_t at[STEP_AXES]);
/* Ticks that came too late, so that the axes stood still for a moment in between. */
uint32_t steps_starved(void);

#endif
