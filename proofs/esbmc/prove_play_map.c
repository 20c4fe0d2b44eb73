/* SPDX-License-Identifier: Apache-2.0 */
/* Proves the divisions of the map with one play in fixed point, and the bounds that the check of a
   table gives. */
#include "any.h"

#include "compensator/play_map.c"

int main(void)
{
#if defined(SHARE)
  const int32_t found = quotient_up_to_one(any_within(1, ANHYST_Q31_MAX), nondet_i32());
  SHOW(found >= 0);
#else
  const int16_t entries[2] = {nondet_i16(), nondet_i16()};
  const int16_t half[2] = {nondet_i16(), nondet_i16()};
  const law_type law = {{entries, 0, 0}, half, 0, 0, 0};
  ASSUME(are_branches_rising(&law, 2));
  SHOW(half[0] >= 0 && half[1] >= 0);
  SHOW(entries[1] + half[1] >= entries[0] + half[0]);
  SHOW(entries[1] - half[1] >= entries[0] - half[0]);
  SHOW(entries[1] + half[1] <= ANHYST_Q15_MAX && entries[1] - half[1] >= -ANHYST_Q15_MAX);
#endif
  return 0;
}
