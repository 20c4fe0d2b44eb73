/* SPDX-License-Identifier: Apache-2.0 */
/* Proves the PID of an axis in fixed point: a step from any state, with any valid coefficients and
   any error. The state stays within its bounds. */
#include "any.h"

#include "control/axes_fixed.c"

#include "wide.h"

int main(void)
{
  const anhyst_axis_pid_q31 pid = {nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32(),
                                   nondet_u16()};
  anhyst_axis_pid_state_q31 state = {nondet_i64(), nondet_i64()};
  ASSUME(check_pid(&pid) == ANHYST_OK);
  (void)step_pid(&pid, &state, nondet_i32());
  SHOW(state.lag >= -ANHYST_WIDE_ONE && state.lag <= ANHYST_WIDE_ONE);
  SHOW(state.sum >= -ANHYST_WIDE_ONE && state.sum <= ANHYST_WIDE_ONE);
  return 0;
}
