/* SPDX-License-Identifier: Apache-2.0 */
/* Checks the allowed change of an armature's position since the last plausible sample, for every
   number of ticks and two steps. One is the largest step whose product is computed; the other is
   the next larger step, whose product is not computed. A smaller step has a smaller product. The
   program is compiled so that an overflow stops it. */
#include "control/levitation.c"
#include "control/supervisor.c"

int main(void)
{
  int fault = 0;
  for (uint32_t age = 0; age <= UINT16_MAX; age++) {
    const int32_t most = ANHYST_Q31_MAX / ((int32_t)age + 1);
    anhyst_levitation l = {0};
    l.supervisor.sample_age = (uint16_t)age;
    l.has_position = 1;
    l.position = ANHYST_Q31_MIN;
    fault += is_plausible(&l, most, ANHYST_Q31_MIN) != 1;
    if (age > 0U) {
      fault += is_plausible(&l, most + 1, ANHYST_Q31_MAX) != 1;
    }
  }
  return fault == 0 ? 0 : 1;
}
