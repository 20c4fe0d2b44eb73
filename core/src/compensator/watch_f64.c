/* SPDX-License-Identifier: Apache-2.0 */
#include "formats/f64.h"
#include "generic/watch.h"

double anhyst_conditioning_step_f64(anhyst_compensator_f64 *c)
{
  const int32_t tick = next_conditioning_tick(c, anhyst_conditioning_length_f64(c));
  return anhyst_conditioning_f64(c, tick);
}

int anhyst_compensator_follows_f64(const anhyst_compensator_f64 *c, double measured,
                                   double tolerance)
{
  return absolute(measured * c->per_current - c->applied) <= tolerance * c->per_current;
}

void anhyst_compensator_commit_after_f64(anhyst_compensator_f64 *c, double applied, double gap,
                                         uint16_t ticks)
{
  for (uint16_t remaining = count_commits(c, ticks); remaining > 0U; remaining--) {
    anhyst_compensator_commit_f64(c, applied, gap);
  }
}
