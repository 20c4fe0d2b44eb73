/* SPDX-License-Identifier: Apache-2.0 */
/* A factor of any size in 32 bits. */
#ifndef ANHYST_FACTOR_H
#define ANHYST_FACTOR_H

#include "anhyst/numeric/fixed.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_FACTOR_SHIFT_LOW (-15)
#define ANHYST_FACTOR_SHIFT_HIGH 16

/* mantissa/65536*2^shift. Normalised: |mantissa| is at least 16384, or zero. */
typedef struct {
  int16_t mantissa;
  int16_t shift; /* ANHYST_FACTOR_SHIFT_LOW..ANHYST_FACTOR_SHIFT_HIGH */
} anhyst_factor;

/* Whether the shift is within its range. */
static inline int anhyst_factor_is_valid(anhyst_factor factor)
{
  return factor.shift >= ANHYST_FACTOR_SHIFT_LOW && factor.shift <= ANHYST_FACTOR_SHIFT_HIGH;
}

/* Whether it is minus a share, -1..0; exactly -1 is mantissa -32768 and shift 1: the negative end
   of a mantissa reaches further. */
static inline int anhyst_factor_is_share(anhyst_factor factor)
{
  return factor.mantissa <= 0 && factor.shift >= 0 && factor.shift <= 1;
}

/* x*factor, floor, error below one unit in the last place; saturates where x*2^shift does. */
static inline int32_t anhyst_factor_product(int32_t x, anhyst_factor factor)
{
  if (factor.shift >= 0) {
    /* Shifted first, so that what the product's floor cuts off is not made larger. */
    return anhyst_scale(anhyst_shl_q31(x, (uint16_t)factor.shift), factor.mantissa);
  }
  return anhyst_scale(x, factor.mantissa) >> -factor.shift;
}

#ifdef __cplusplus
}
#endif
#endif
