/* What the firmware needs of the board. board_stm32.c is the real one; test/target/board_qemu.c stands in for it under
 * QEMU, which has the core, timers and serial ports of the chip, but no clock tree, converter, watchdog or machine
 * around it. */
#ifndef WAAM_STM32_BOARD_H
#define WAAM_STM32_BOARD_H

#include "waam_core.h"

#define FAST_HZ 10000u
#define FAST_US (1000000u / FAST_HZ)
#define TICK_US 1000u
#define STEP_HZ 80000u        /* slots for pulses: the most that an axis can do */
#define STEP_AXES 4u          /* X, Y, Z, wire */
#define WIRE_STEPS_PER_MM 50.0f

extern const uint32_t board_pulse; /* length of a step pulse in counts of TIM3 */

/* Clocks, pins, converters. Outputs are off. False: the board cannot be trusted (no crystal, wrong chip). */
bool board_init(void);
/* TIM3 at STEP_HZ with four pulse outputs, TIM2 at FAST_HZ, in step with each other. */
void board_start_timers(void);
void board_start_watchdog(void);
void board_feed_watchdog(void);
/* Narrows the ranges of plausible readings to what the converter can give. */
void board_ranges(waam_config_t *config);
/* Until the next interrupt. */
void board_idle(void);
/* Everything off that can hurt: arc, gas, drives, setpoints. Callable from a fault. */
void board_safe(void);
/* Never returns: the watchdog resets the processor. */
__attribute__((noreturn)) void board_await_reset(void);
/* The watchdog had reset the processor. Once only. */
bool board_was_hung(void);
/* A number that no earlier start of this controller had. */
uint32_t board_boot_id(void);
/* Free running, wraps: processor cycles, or under QEMU nanoseconds of virtual time (see load.h). */
uint32_t board_clock(void);

/* 10 kHz: looks at switches and converters; the arc's values as they are now. */
void board_sample(waam_fast_inputs_t *now);
/* 10 kHz: enable and setpoint of the source. */
void board_arc(const waam_fast_outputs_t *outputs);
/* 1 kHz: what the samples amount to. */
void board_inputs(waam_inputs_t *inputs);
/* 1 kHz: drives, gas, sense voltage, wire speed. */
void board_outputs(const waam_outputs_t *outputs);
void board_direction(unsigned axis, bool negative);

/* 10 kHz, the bus of the accelerometer. Take: what came back of the frame that the fast tick before began; its bytes, 0 =
 * none or not complete. Begin: a frame of `count` bytes, 0 = none. */
void board_bus_init(void);
size_t board_bus_take(uint8_t *in);
void board_bus_begin(const uint8_t *out, size_t count);

#endif
