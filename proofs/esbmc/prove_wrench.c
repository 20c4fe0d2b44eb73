/* SPDX-License-Identifier: Apache-2.0 */
/* Proves the two scalar functions of the fixed-point wrench allocation for a fixed drive. */
#include "any.h"

#include "control/wrench_fixed.c"

#ifndef RATIO
#include "wide.h"
#endif

int main(void)
{
#ifdef RATIO
  const int32_t pivot = any_within(1, ANHYST_Q31_MAX);
  SHOW(quotient_shift(pivot) >= 15U && quotient_shift(pivot) <= 30U);
  (void)scaled_quotient(any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE), pivot, quotient_shift(pivot));
#else
  const uint16_t n = nondet_u16();
  ASSUME(n <= 30U);
  const int32_t found = subtract_multiple(any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE), nondet_i32(),
                                          any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE), n);
  SHOW(found >= -ANHYST_Q30_ONE && found <= ANHYST_Q30_ONE);
#endif
  return 0;
}
