/* The temperature of the part, by a pyrometer or thermocouple on a converter of the board: `$C temperature_input 2`. It has
 * nothing to do with the temperature of torch and drives (waam_guard.c). */
#ifndef WAAM_TEMPERATURE_H
#define WAAM_TEMPERATURE_H

#include <stdbool.h>

#include "waam_setting.h"
#include "waam_temperature_settings.h"
#include "waam_text.h"

#define WAAM_TEMPERATURE_US 100000u /* of controller time, from line to line */

typedef enum {
    WAAM_TEMPERATURE_KNOWN,
    WAAM_TEMPERATURE_BELOW,     /* the signal is below what the instrument can give: broken wire, no supply */
    WAAM_TEMPERATURE_ABOVE,     /* above it: short circuit to the supply, open thermocouple, too hot */
    WAAM_TEMPERATURE_NO_READING /* the converter does not work */
} waam_temperature_fault_t;

/* What was read since the last line. */
typedef struct {
    float sum_v;
    uint32_t count[WAAM_TEMPERATURE_NO_READING + 1]; /* ticks by waam_temperature_fault_t */
    uint64_t due_us;
} waam_temperature_t;

/* Places in waam_temperature_config_t: names and ranges. */
extern const waam_setting_t waam_temperature_settings[];

/* One reading, V at the converter, NaN = none. */
void waam_temperature_read(waam_temperature_t *t, const waam_temperature_config_t *config, float v);
/* When a line is due: appends "P <t_us>,<fault>,<millidegrees C>", the mean of the readings since the last one; the last
 * field is empty unless more than half of them are good. */
bool waam_temperature_line(waam_temperature_t *t, const waam_temperature_config_t *config, uint64_t now_us, waam_text_t *line);

#endif
