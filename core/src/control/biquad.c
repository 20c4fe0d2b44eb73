/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/biquad.h"

anhyst_status anhyst_biquad_check_q31(const anhyst_biquad_q31 *filter)
{
  const int valid =
      anhyst_factor_is_valid(filter->loss) && anhyst_factor_is_valid(filter->pass) &&
      anhyst_factor_is_valid(filter->low) && anhyst_factor_is_valid(filter->through) &&
      anhyst_factor_is_valid(filter->of_fast) && anhyst_factor_is_valid(filter->of_slow);
  return valid ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

/* By the trapezoidal rule an integral ends as far beyond what it was on the way as it began before
   it: a step that cannot overflow, since the way to its middle is one that fitted. */
static int32_t gone_on(int32_t integral, int32_t middle)
{
  return anhyst_add_q31(middle, middle - integral);
}

int32_t anhyst_biquad_step_q31(const anhyst_biquad_q31 *filter, anhyst_biquad_state_q31 *state,
                               int32_t in)
{
  const int32_t x = in >> 1; /* q30 */
  const int32_t first = state->integral[0];
  const int32_t second = state->integral[1];
  const int32_t missing = anhyst_sub_q31(x, second);
  const int32_t pushed = anhyst_sub_q31(anhyst_factor_product(missing, filter->pass),
                                        anhyst_factor_product(first, filter->loss));
  const int32_t fast = anhyst_add_q31(first, pushed);
  const int32_t moved = anhyst_add_q31(anhyst_factor_product(first, filter->pass),
                                       anhyst_factor_product(missing, filter->low));
  const int32_t slow = anhyst_add_q31(second, moved);
  state->integral[0] = gone_on(first, fast);
  state->integral[1] = gone_on(second, slow);
  int32_t out = anhyst_factor_product(x, filter->through);
  out = anhyst_add_q31(out, anhyst_factor_product(fast, filter->of_fast));
  out = anhyst_add_q31(out, anhyst_factor_product(slow, filter->of_slow));
  return anhyst_shl_q31(out, 1);
}
