/* SPDX-License-Identifier: Apache-2.0 */
#include "formats/f32.h"
#include "generic/watch.h"

float anhyst_conditioning_step_f32(anhyst_compensator_f32 *c)
{
  const int32_t tick = next_conditioning_tick(c, anhyst_conditioning_length_f32(c));
  return anhyst_conditioning_f32(c, tick);
}

int anhyst_compensator_follows_f32(const anhyst_compensator_f32 *c, float measured, float tolerance)
{
  return absolute(measured * c->per_current - c->applied) <= tolerance * c->per_current;
}

void anhyst_compensator_commit_after_f32(anhyst_compensator_f32 *c, float applied, float gap,
                                         uint16_t ticks)
{
  for (uint16_t remaining = count_commits(c, ticks); remaining > 0U; remaining--) {
    anhyst_compensator_commit_f32(c, applied, gap);
  }
}
