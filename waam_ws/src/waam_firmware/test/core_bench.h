/* The core alone, tick by tick, as the property tests have it: its inputs and outputs, the last lines that it sent, and
 * what a host says to it. */
#ifndef CORE_BENCH_H
#define CORE_BENCH_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "waam_internal.h"

#define SAID 64

static waam_core_t core;
static waam_config_t config;
static waam_inputs_t in;
static waam_outputs_t out;
static char said[SAID][256]; /* the last lines that must arrive, without their ends */
static unsigned lines;       /* so many of them so far */

#define LAST said[(lines + SAID - 1) % SAID]
#define CHECK(condition)                                                                     \
    do {                                                                                     \
        if (!(condition)) {                                                                  \
            fprintf(stderr, "%s:%d: %s (last: %s)\n", __func__, __LINE__, #condition, LAST); \
            exit(1);                                                                         \
        }                                                                                    \
    } while (0)

static inline void on_line(void *context, const char *line, size_t bytes, waam_tx_kind_t kind)
{
    (void)context;
    if (kind == WAAM_TX_ASSURED)
        snprintf(said[lines++ % SAID], sizeof said[0], "%.*s", (int)bytes - 1, line);
}

/* A controller that was just switched on, as `config` says. */
static inline void power_up(waam_tx_t send)
{
    waam_core_init(&core, &config, send, NULL);
    in = (waam_inputs_t){.process = WAAM_PROCESS_OK};
    out = (waam_outputs_t){0};
    lines = 0;
    memset(said, 0, sizeof said);
}

/* Whether one of the last lines has this text. */
static inline bool heard(const char *text)
{
    for (unsigned i = 0; i < SAID; i++)
        if (strstr(said[i], text))
            return true;
    return false;
}

static inline void say(const char *line)
{
    waam_text_t text = {.length = 0};
    waam_text_add(&text, line);
    waam_text_seal(&text, false);
    for (size_t i = 0; i < text.length; i++)
        waam_core_rx(&core, (uint8_t)text.text[i]);
}

static inline void send_line(const char *gcode)
{
    char line[140];
    snprintf(line, sizeof line, "N%u %s", (unsigned)core.link.accepted + 1, gcode);
    say(line);
}

#endif
