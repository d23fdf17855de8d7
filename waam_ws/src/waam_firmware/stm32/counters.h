/* Where counters that run for as long as the board is powered begin. All of them may wrap: nothing but differences of two
 * readings is used, in unsigned arithmetic. The image of a test (waam_qemu_wrap) begins shortly before they do. */
#ifndef WAAM_STM32_COUNTERS_H
#define WAAM_STM32_COUNTERS_H

#include <stdint.h>

#ifdef WAAM_COUNTERS_WRAP_SOON
#define COUNTER_START(events) (0u - (uint32_t)(events)) /* wraps after so many events */
#define POSITION_START(steps) ((int64_t)INT32_MAX - (steps)) /* leaves 32 bits after so many steps */
#else
#define COUNTER_START(events) 0u
#define POSITION_START(steps) 0
#endif

#endif
