/* Decimal text to double precision, correctly rounded (the nearest double, ties to even), as strtod does. */
#ifndef WAAM_DECIMAL_H
#define WAAM_DECIMAL_H

#include "waam_types.h"

#define WAAM_DECIMAL_LIMBS 18 /* 162 decimals: more than a line has bytes */

/* whole + fraction, in base 10^9; all zero is 0. */
typedef struct {
    uint32_t whole;                    /* below 10^9 */
    uint32_t limb[WAAM_DECIMAL_LIMBS]; /* of the fraction: limb[i] / 10^(9 (i + 1)) */
    uint32_t decimals;                 /* up to the last that is not 0 */
} waam_decimal_t;

/* Appends a digit before the point; false: the number reaches 10^9. */
bool waam_decimal_whole(waam_decimal_t *d, unsigned digit);
/* Sets decimal number `place` (from 0). Decimals after the 162nd are not looked at. */
void waam_decimal_fraction(waam_decimal_t *d, size_t place, unsigned digit);
/* Changes *d. */
double waam_decimal_value(waam_decimal_t *d);

#endif
