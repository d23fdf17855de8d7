#include "waam_decimal.h"

#include <math.h>

#define LIMB_DIGITS 9
#define LIMB 1000000000u
#define MANTISSA_BITS 53
#define SPARE_BITS 54 /* the mantissa and one bit that decides the rounding */

static const uint32_t powers[LIMB_DIGITS + 1] = {1,      10,      100,      1000,      10000,
                                                 100000, 1000000, 10000000, 100000000, LIMB};

bool waam_decimal_whole(waam_decimal_t *d, unsigned digit)
{
    if (d->whole >= LIMB / 10)
        return false;
    d->whole = d->whole * 10 + digit;
    return true;
}

void waam_decimal_fraction(waam_decimal_t *d, size_t place, unsigned digit)
{
    if (!digit || place >= WAAM_DECIMAL_LIMBS * LIMB_DIGITS)
        return;
    d->limb[place / LIMB_DIGITS] += digit * powers[LIMB_DIGITS - 1 - place % LIMB_DIGITS];
    d->decimals = (uint32_t)place + 1;
}

/* Multiplies the fraction by 2^bits (at most 29); returns what passes the point. */
static uint32_t shift(waam_decimal_t *d, unsigned bits)
{
    uint64_t carry = 0;
    for (size_t i = (d->decimals + LIMB_DIGITS - 1) / LIMB_DIGITS; i-- > 0;) {
        uint64_t value = ((uint64_t)d->limb[i] << bits) + carry;
        d->limb[i] = (uint32_t)(value % LIMB);
        carry = value / LIMB;
    }
    return (uint32_t)carry;
}

static bool rest(const waam_decimal_t *d)
{
    for (size_t i = 0; i < WAAM_DECIMAL_LIMBS; i++)
        if (d->limb[i])
            return true;
    return false;
}

/* Nine decimals or less, and a quotient of two exact doubles: one division rounds it right. */
static bool quick(const waam_decimal_t *d, double *value)
{
    if (d->decimals > LIMB_DIGITS)
        return false;
    uint64_t scale = powers[d->decimals];
    uint64_t digits = d->whole * scale + d->limb[0] / powers[LIMB_DIGITS - d->decimals];
    *value = (double)digits / (double)scale;
    return digits >> MANTISSA_BITS == 0;
}

/* Binary digits are taken off the fraction until there are enough; what is left decides a tie. */
double waam_decimal_value(waam_decimal_t *d)
{
    double value;
    if (quick(d, &value))
        return value;
    uint64_t mantissa = d->whole;
    int exponent = 0;
    while (mantissa >> (SPARE_BITS - 1) == 0) {
        unsigned bits = mantissa >> 25 == 0 ? 29 : 9;
        mantissa = mantissa << bits | shift(d, bits);
        exponent -= (int)bits;
    }
    unsigned spare = 1;
    while (mantissa >> spare >> MANTISSA_BITS)
        spare++;
    uint64_t half = (uint64_t)1 << (spare - 1), low = mantissa & (2 * half - 1);
    mantissa >>= spare;
    if (low > half || (low == half && (rest(d) || (mantissa & 1))))
        mantissa++;
    return ldexp((double)mantissa, exponent + (int)spare);
}
