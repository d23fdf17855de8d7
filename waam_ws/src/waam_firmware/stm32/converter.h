/* From counts of the converter to volts and amperes of the arc, and what the converter can give at all. The scales are those
 * of the circuits in front of it (doc/stm32f407.md). */
#ifndef WAAM_STM32_CONVERTER_H
#define WAAM_STM32_CONVERTER_H

#include <stdint.h>

#include "waam_types.h"

#define CONVERTER_TOP 4095u
#define VOLT_PER_COUNT (3.3f / 4096.0f)
#define ARC_DIVIDER 25.0f
#define CURRENT_ZERO_V 0.396f /* ACS758-200U at 5 V (0.6 V), 2:3 onto the converter */
#define CURRENT_A_PER_V 75.0f /* 20 mV/A times 2/3 */

static inline float converter_v(uint32_t count) { return (float)count * VOLT_PER_COUNT; }

static inline float converter_current_a(uint32_t count)
{
    return ((float)count * VOLT_PER_COUNT - CURRENT_ZERO_V) * CURRENT_A_PER_V;
}

static inline float converter_voltage_v(uint32_t count) { return (float)count * VOLT_PER_COUNT * ARC_DIVIDER; }

/* A reading at the end of the range is no reading: the sensor is torn off, short-circuited or beyond its range. The arc
 * voltage is the exception at its lower end: without an arc it is 0. */
static inline void converter_ranges(waam_monitor_config_t *monitor)
{
    monitor->current_min_a = 0.5f * (converter_current_a(0) + converter_current_a(1));
    monitor->current_max_a = 0.5f * (converter_current_a(CONVERTER_TOP) + converter_current_a(CONVERTER_TOP - 1));
    monitor->voltage_min_v = -0.5f * converter_voltage_v(1);
    monitor->voltage_max_v = 0.5f * (converter_voltage_v(CONVERTER_TOP) + converter_voltage_v(CONVERTER_TOP - 1));
}

#endif
