/* SPDX-License-Identifier: Apache-2.0 */
/* Checks the interpolation over the gap, for all neighbours of a valid table and every position
   between them: the result is between the two entries, and nothing overflows. Neighbours differ by
   at most 32767. The interpolated term depends only on the difference of the neighbours, so that a
   first entry of 0 is sufficient. */
#include "compensator/compensator.c"

int main(void)
{
  uint32_t wrong = 0;
  for (int32_t change = -ANHYST_Q15_MAX; change <= ANHYST_Q15_MAX; change++) {
    const int16_t words[2] = {0, (int16_t)change};
    const int32_t low = change < 0 ? change : 0;
    const int32_t high = change < 0 ? 0 : change;
    for (int32_t part = 0; part <= 0x7FFF; part++) {
      const gap_position position = {words, part};
      const int32_t found = interpolate_over_gap(position, 0);
      wrong += found < low || found > high;
    }
  }
  return wrong == 0 ? 0 : 1;
}
