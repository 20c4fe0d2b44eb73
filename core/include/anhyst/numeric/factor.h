/* SPDX-License-Identifier: Apache-2.0 */
/* A factor with a 16-bit mantissa and an exponent, for products with q31 signals. */
#ifndef ANHYST_FACTOR_H
#define ANHYST_FACTOR_H

#include "anhyst/numeric/fixed.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_FACTOR_SHIFT_LOW (-15)
#define ANHYST_FACTOR_SHIFT_HIGH 16

/* The factor mantissa/65536*2^shift, normalised if |mantissa| >= 16384 or mantissa = 0. */
typedef struct {
  int16_t mantissa;
  int16_t shift; /* ANHYST_FACTOR_SHIFT_LOW..ANHYST_FACTOR_SHIFT_HIGH */
} anhyst_factor;

/* Returns whether the shift is in its range. */
static inline int anhyst_factor_is_valid(anhyst_factor factor)
{
  return factor.shift >= ANHYST_FACTOR_SHIFT_LOW && factor.shift <= ANHYST_FACTOR_SHIFT_HIGH;
}

/* Returns whether the factor is in -1..0, that is, the negative of a filter coefficient. Exactly -1
   is the mantissa -32768 with the shift 1, because +32768 does not fit the mantissa. */
static inline int anhyst_factor_is_share(anhyst_factor factor)
{
  return factor.mantissa <= 0 && factor.shift >= 0 && factor.shift <= 1;
}

/* Returns x*factor, rounded down. The error is below 1 LSB. Saturates if x*2^shift saturates. */
static inline int32_t anhyst_factor_product(int32_t x, anhyst_factor factor)
{
  if (factor.shift >= 0) {
    /* Shifts first, because a later shift would enlarge the rounding error of the product. */
    return anhyst_scale(anhyst_shl_q31(x, (uint16_t)factor.shift), factor.mantissa);
  }
  return anhyst_scale(x, factor.mantissa) >> -factor.shift;
}

#ifdef __cplusplus
}
#endif
#endif
