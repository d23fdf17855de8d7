/* Lines of 3-D printing senders (Printrun, OctoPrint): "N<n> ... *<xor>", M105, M110 ... Pure. */
#ifndef WAAM_MARLIN_DIALECT_H
#define WAAM_MARLIN_DIALECT_H

#include "waam_text.h"

/* The number after a leading 'N'; senders may start below zero. False: the line does not begin with a number. */
bool waam_marlin_number(const char *line, size_t length, int64_t *number);
/* Is this a numbered M110? (`line` without its check) */
bool waam_marlin_renumbers(const char *line, size_t length);
/* Is this a line without number and check, as those senders write them for questions? `any`: whatever it asks. */
bool waam_marlin_unnumbered(const char *line, size_t length, bool any);
/* 110 for "M110 N5" from `at` on; -1 when no M word is there. */
int waam_marlin_m_word(const char *text, size_t length, size_t at);
/* Where the content begins after "N<n>". */
size_t waam_marlin_after_number(const char *line, size_t length);
/* What the core says, as a line for these senders: without check, state changes as echo. */
void waam_marlin_frame(const waam_text_t *said, waam_text_t *line);

#endif
