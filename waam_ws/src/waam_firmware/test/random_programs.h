/* Random programs through the whole controller: what the property tests of the shaped motion share. The test says what
 * `require` prints. */
#ifndef RANDOM_PROGRAMS_H
#define RANDOM_PROGRAMS_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "host_harness.h"
#include "waam_internal.h"

static host_harness_t machine;
static waam_core_t *const core = &machine.core;
static uint64_t seed;
static uint32_t next_line, number; /* of the line, of the program */

static void require(bool condition, const char *what, double got, double limit);

static double uniform(double low, double high) /* SplitMix64 */
{
    uint64_t z = (seed += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return low + (high - low) * (double)((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

static void on_line(void *context, const char *line, size_t bytes, waam_tx_kind_t kind)
{
    (void)context, (void)kind;
    require(bytes < 4 || (memcmp(line, "er ", 3) && memcmp(line, "rs ", 3)), line, 0.0, 0.0);
}

static void feed(const char *text)
{
    waam_text_t line = {.length = 0};
    waam_text_add(&line, text);
    waam_text_seal(&line, true);
    for (size_t i = 0; i < line.length; i++)
        waam_core_rx(core, (uint8_t)line.text[i]);
}

/* The host lives, and renews the arc lease. */
static inline void beat(void)
{
    char text[40];
    snprintf(text, sizeof text, "$H t %llu", (unsigned long long)core->now_us);
    if (core->now_us % 50000 == 0)
        feed(text);
}

static void send(const char *words)
{
    char text[120];
    snprintf(text, sizeof text, "N%u %s", (unsigned)next_line++, words);
    feed(text);
}

#endif
