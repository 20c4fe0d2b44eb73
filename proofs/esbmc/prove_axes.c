/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of several axes in fixed point. ROW: any valid row, any signals. PID: a step from
   any state whatever, any valid words, any error; the state keeps within its bounds. */
#include "any.h"

#include "control/axes_fixed.c"

#include "wide.h"

#ifdef ROW
static void prove_row(void)
{
  int32_t number[ANHYST_ROW_LENGTH];
  int32_t signal[ANHYST_ROW_LENGTH];
  const uint16_t shift = nondet_u16();
  const uint16_t length = nondet_u16();
  for (int i = 0; i < ANHYST_ROW_LENGTH; i++) {
    number[i] = any_within(-ANHYST_ROW_MOST, ANHYST_ROW_MOST);
    signal[i] = nondet_i32();
  }
  ASSUME(shift <= ANHYST_ROW_SHIFT && length <= ANHYST_ROW_LENGTH);
  (void)anhyst_row_product_q31(number, shift, length, signal);
}
#endif

#ifdef PID
static void prove_pid(void)
{
  const anhyst_axis_pid_q31 pid = {nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32(),
                                   nondet_u16()};
  anhyst_axis_pid_state_q31 state = {nondet_i64(), nondet_i64()};
  ASSUME(check_pid_q31(&pid) == ANHYST_OK);
  (void)step_pid_q31(&pid, &state, nondet_i32());
  SHOW(state.lag >= -ANHYST_WIDE_ONE && state.lag <= ANHYST_WIDE_ONE);
  SHOW(state.sum >= -ANHYST_WIDE_ONE && state.sum <= ANHYST_WIDE_ONE);
}
#endif

int main(void)
{
#ifdef ROW
  prove_row();
#else
  prove_pid();
#endif
  return 0;
}
