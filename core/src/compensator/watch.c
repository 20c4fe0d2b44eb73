/* SPDX-License-Identifier: Apache-2.0 */
#include "formats/fixed.h"
#include "generic/watch.h"

int16_t anhyst_conditioning_step_q15(anhyst_compensator *c)
{
  return anhyst_conditioning_q15(c, next_conditioning_tick(c, anhyst_conditioning_length(c)));
}

int32_t anhyst_conditioning_step_q31(anhyst_compensator *c)
{
  return anhyst_conditioning_q31(c, next_conditioning_tick(c, anhyst_conditioning_length(c)));
}

int anhyst_compensator_follows_q31(const anhyst_compensator *c, int32_t measured, int32_t tolerance)
{
  return anhyst_abs_q31(anhyst_sub_q31(measured, c->applied)) <= tolerance;
}

int anhyst_compensator_follows_q15(const anhyst_compensator *c, int16_t measured, int16_t tolerance)
{
  return anhyst_compensator_follows_q31(c, (int32_t)measured * 65536, (int32_t)tolerance * 65536);
}

void anhyst_compensator_commit_after_q15(anhyst_compensator *c, int16_t applied, int16_t gap,
                                         uint16_t ticks)
{
  for (uint16_t remaining = count_commits(c, ticks); remaining > 0U; remaining--) {
    anhyst_compensator_commit_q15(c, applied, gap);
  }
}

void anhyst_compensator_commit_after_q31(anhyst_compensator *c, int32_t applied, int32_t gap,
                                         uint16_t ticks)
{
  for (uint16_t remaining = count_commits(c, ticks); remaining > 0U; remaining--) {
    anhyst_compensator_commit_q31(c, applied, gap);
  }
}
