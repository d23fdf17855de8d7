#ifndef WAAM_STM32_CLOCK_H
#define WAAM_STM32_CLOCK_H

#include <stdbool.h>

/* 168 MHz from the crystal; from the internal oscillator (1 % off), and false, when the crystal does not start. */
bool clock_init(void);

#endif
