/* Settings of the input for the temperature of the part: data only. */
#ifndef WAAM_TEMPERATURE_SETTINGS_H
#define WAAM_TEMPERATURE_SETTINGS_H

#include <stdint.h>

typedef enum {
    WAAM_TEMPERATURE_OFF,
    WAAM_TEMPERATURE_VOLTAGE,   /* 0 .. 10 V */
    WAAM_TEMPERATURE_LOOP,      /* 4 .. 20 mA */
    WAAM_TEMPERATURE_AMPLIFIER  /* of a thermocouple, 0 .. 3 V */
} waam_temperature_input_t;

typedef struct {
    uint32_t input;             /* waam_temperature_input_t */
    double low_c, high_c;       /* degC at both ends of the signal */
} waam_temperature_config_t;

#endif
