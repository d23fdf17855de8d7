/* Settings that `$C` changes: a table of names, ranges and places in a structure. */
#ifndef WAAM_SETTING_H
#define WAAM_SETTING_H

#include <stdbool.h>
#include <stddef.h>

#include "waam_text.h"

typedef enum {
    WAAM_SETTING_FLOAT,
    WAAM_SETTING_DOUBLE,
    WAAM_SETTING_WHOLE, /* uint32_t */
    WAAM_SETTING_SIGN,  /* int8_t, -1 or 1 */
} waam_setting_type_t;

typedef struct {
    const char *name;
    float lowest, highest;
    waam_setting_type_t type;
    size_t at; /* in the structure that the list is for */
} waam_setting_t;

/* NULL = none of the list, which ends with one without a name, has this name. */
const waam_setting_t *waam_setting_find(const waam_setting_t *list, const char *name, size_t length);
/* False, and nothing is changed: out of range, or not whole where it must be. */
bool waam_setting_put(const waam_setting_t *setting, void *into, double value);
double waam_setting_get(const waam_setting_t *setting, const void *from);
/* Appends " must lie within 0 .. 1", which is why waam_setting_put said no. */
void waam_setting_range(const waam_setting_t *setting, waam_text_t *text);

#endif
