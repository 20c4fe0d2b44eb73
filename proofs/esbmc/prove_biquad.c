/* SPDX-License-Identifier: Apache-2.0 */
/* A step of the filter of second order, from any state, for any valid factors and any signal. */
#define ANHYST_PORT_HEADER "contracts.h"
#include "control/biquad.c"

static anhyst_factor any_factor(void)
{
  const anhyst_factor factor = {nondet_i16(), nondet_i16()};
  return factor;
}

int main(void)
{
  const anhyst_biquad_q31 filter = {any_factor(), any_factor(), any_factor(),
                                    any_factor(), any_factor(), any_factor()};
  anhyst_biquad_state_q31 state = {{nondet_i32(), nondet_i32()}};
  ASSUME(anhyst_biquad_check_q31(&filter) == ANHYST_OK);
  (void)anhyst_biquad_step_q31(&filter, &state, nondet_i32());
  return 0;
}
