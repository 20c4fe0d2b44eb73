/* SPDX-License-Identifier: Apache-2.0 */
/* How far an armature may have moved since its last plausible position, for every number of ticks:
   with the largest step whose product is taken, and with the next one, whose product is not. A
   smaller step has a smaller product. Compiled so that an overflow stops the program. */
#include "control/levitation.c"
#include "control/supervisor.c"

int main(void)
{
  int wrong = 0;
  for (uint32_t age = 0; age <= UINT16_MAX; age++) {
    const int32_t most = ANHYST_Q31_MAX / ((int32_t)age + 1);
    anhyst_levitation l = {0};
    l.supervisor.age = (uint16_t)age;
    l.seen = 1;
    l.position = ANHYST_Q31_MIN;
    wrong += is_plausible(&l, most, ANHYST_Q31_MIN) != 1;
    if (age > 0U) {
      wrong += is_plausible(&l, most + 1, ANHYST_Q31_MAX) != 1;
    }
  }
  return wrong == 0 ? 0 : 1;
}
