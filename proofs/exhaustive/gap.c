/* SPDX-License-Identifier: Apache-2.0 */
/* Interpolation over the gap, for every two neighbours of a valid table and every place between
   them: the result lies between the two, and nothing overflows on the way. Neighbours differ by at
   most 32767; what is added to the first depends on their difference alone, so 0 stands for it. */
#include "compensator/compensator.c"

int main(void)
{
  uint32_t wrong = 0;
  for (int32_t change = -ANHYST_Q15_MAX; change <= ANHYST_Q15_MAX; change++) {
    const int16_t words[2] = {0, (int16_t)change};
    const int32_t low = change < 0 ? change : 0;
    const int32_t high = change < 0 ? 0 : change;
    for (int32_t part = 0; part <= 0x7FFF; part++) {
      const place at = {words, part};
      const int32_t found = over_gap(at, 0);
      wrong += found < low || found > high;
    }
  }
  return wrong == 0 ? 0 : 1;
}
