/* SPDX-License-Identifier: Apache-2.0 */
/* Proves a whole tick of the fixed-point controller, and its start and change functions, from any
   state within the invariant, for any valid gains and any signals. */
#define ANHYST_PORT_HEADER "contracts.h"
#include "control/pidd2.c"

static anhyst_factor any_factor(void)
{
  const anhyst_factor factor = {nondet_i16(), nondet_i16()};
  return factor;
}

static anhyst_pidd2_gains_q31 any_gains(void)
{
  const anhyst_pidd2_gains_q31 gains = {
      any_factor(), any_factor(), any_factor(), any_factor(), any_factor(),
      any_factor(), any_factor(), any_factor(), nondet_i16(), 0,
      nondet_i32(), nondet_i32()};
  ASSUME(anhyst_pidd2_check_q31(&gains) == ANHYST_OK);
  return gains;
}

static void show_invariant(const anhyst_pidd2_state_q31 *state)
{
  SHOW(state->position >= -ANHYST_Q30_ONE && state->position < ANHYST_Q30_ONE);
}

int main(void)
{
  const anhyst_pidd2_gains_q31 gains = any_gains();
  anhyst_pidd2_state_q31 state = {any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE - 1), nondet_i32(),
                                  nondet_i32()};
#ifdef START_AND_CHANGE
  const anhyst_pidd2_gains_q31 other = any_gains();
  anhyst_pidd2_change_q31(&gains, &other, &state, nondet_i32(), nondet_i32(), nondet_i32());
  show_invariant(&state);
  anhyst_pidd2_start_q31(&gains, &state, nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32());
  show_invariant(&state);
#else
  anhyst_pidd2_candidate_q31 candidate;
  const int32_t output =
      anhyst_pidd2_solve_q31(&gains, &state, nondet_i32(), nondet_i32(), nondet_i32(), &candidate);
  SHOW(output >= gains.low && output <= gains.high);
  show_invariant(&candidate.next);
  anhyst_pidd2_commit_q31(&gains, &state, &candidate, nondet_i32());
  show_invariant(&state);
#endif
  return 0;
}
