/* SPDX-License-Identifier: Apache-2.0 */
/* Checks the root of the compensator for every argument, because a solver cannot handle its
   divisions. The program is compiled so that undefined behaviour stops it. Only arguments from 2^29
   on are tried: smaller arguments are first shifted up to this range. */
#include "compensator/compensator.c"

int main(void)
{
  uint32_t wrong = 0;
  for (uint32_t a = 0x20000000; a <= 0x7FFFFFFF; a++) {
    const int32_t found = root_with_knee((int32_t)a, 8);
    wrong += found < 0 || found > ANHYST_Q30_ONE;
  }
  return wrong == 0 ? 0 : 1;
}
