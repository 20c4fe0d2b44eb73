/* SPDX-License-Identifier: Apache-2.0 */
/* The map in fixed point: where a signal falls in a table of any size, and the digits of the
   inverse. */
#include "any.h"

#include "compensator/map.c"

int main(void)
{
#ifdef PLACE
  const uint16_t n = nondet_u16();
  ASSUME(n <= ANHYST_MAP_FORCE_SEGMENTS);
  const segment at = segment_of(nondet_i32(), n);
  SHOW(at.index < (1U << n));
  SHOW(at.part >= 0);
#else
  const int32_t whole = any_within(2, ANHYST_Q31_MAX);
  SHOW(anhyst_ratio(any_within(1, whole - 1), whole) >= 0);
#endif
  return 0;
}
