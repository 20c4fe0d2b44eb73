/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/pidd2.h"

anhyst_status anhyst_pidd2_check_q31(const anhyst_pidd2_gains_q31 *gains)
{
  const int are_factors_valid =
      anhyst_factor_is_valid(gains->proportional) && anhyst_factor_is_valid(gains->integral) &&
      anhyst_factor_is_valid(gains->derivative) && anhyst_factor_is_valid(gains->second) &&
      anhyst_factor_is_valid(gains->load) && anhyst_factor_is_valid(gains->back) &&
      gains->back.mantissa >= 0;
  const int are_others_valid = anhyst_factor_is_share(gains->smoothing) &&
                               anhyst_factor_is_share(gains->smoothing_2) &&
                               gains->unweighted <= 0 && gains->low <= gains->high;
  return are_factors_valid && are_others_valid ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

int32_t anhyst_pidd2_solve_q31(const anhyst_pidd2_gains_q31 *gains,
                               const anhyst_pidd2_state_q31 *state, int32_t reference,
                               int32_t position, int32_t load,
                               anhyst_pidd2_candidate_q31 *candidate)
{
  const int32_t y = position >> 1; /* q30, so that differences do not overflow */
  const int32_t r = reference >> 1;
  const int32_t weighted = r + anhyst_scale(reference, gains->unweighted); /* 0..r */

  /* The change of a filter's output in a tick is the filtered derivative. Therefore, a derivative
     needs no state of its own, and rounding errors are not integrated. */
  const int32_t first = anhyst_factor_product(state->position - y, gains->smoothing);
  const int32_t second =
      anhyst_factor_product(anhyst_sub_q31(state->velocity, first), gains->smoothing_2);

  int32_t u = anhyst_factor_product(weighted - y, gains->proportional);
  u = anhyst_add_q31(u, state->integral >> 2);
  u = anhyst_sub_q31(u, anhyst_factor_product(first, gains->derivative));
  u = anhyst_sub_q31(u, anhyst_factor_product(second, gains->second));
  u = anhyst_add_q31(u, anhyst_factor_product(load, gains->load));

  candidate->next.position = state->position + first;
  candidate->next.velocity = anhyst_add_q31(state->velocity, second);
  candidate->next.integral =
      anhyst_add_q31(state->integral, anhyst_factor_product(r - y, gains->integral));
  candidate->unlimited_output = u;
  candidate->output = anhyst_clamp(anhyst_shl_q31(u, 3), gains->low, gains->high);
  return candidate->output;
}

void anhyst_pidd2_commit_q31(const anhyst_pidd2_gains_q31 *gains, anhyst_pidd2_state_q31 *state,
                             const anhyst_pidd2_candidate_q31 *candidate, int32_t applied)
{
  /* This difference is exactly zero if the output was applied unchanged. */
  const int32_t not_applied = anhyst_sub_q31(applied >> 3, candidate->unlimited_output);
  *state = candidate->next;
  state->integral =
      anhyst_add_q31(state->integral, anhyst_factor_product(not_applied, gains->back));
}

/* Shifts the integral so that the output changes by to - from, both q28. */
static void shift_integral(anhyst_pidd2_state_q31 *state, int32_t from, int32_t to)
{
  state->integral = anhyst_add_q31(state->integral, anhyst_shl_q31(anhyst_sub_q31(to, from), 2));
}

void anhyst_pidd2_start_q31(const anhyst_pidd2_gains_q31 *gains, anhyst_pidd2_state_q31 *state,
                            int32_t reference, int32_t position, int32_t load, int32_t output)
{
  anhyst_pidd2_candidate_q31 start_candidate;
  state->position = position >> 1;
  state->velocity = 0;
  state->integral = 0;
  (void)anhyst_pidd2_solve_q31(gains, state, reference, position, load, &start_candidate);
  shift_integral(state, start_candidate.unlimited_output, output >> 3);
}

void anhyst_pidd2_change_q31(const anhyst_pidd2_gains_q31 *from, const anhyst_pidd2_gains_q31 *to,
                             anhyst_pidd2_state_q31 *state, int32_t reference, int32_t position,
                             int32_t load)
{
  anhyst_pidd2_candidate_q31 old_candidate;
  anhyst_pidd2_candidate_q31 new_candidate;
  (void)anhyst_pidd2_solve_q31(from, state, reference, position, load, &old_candidate);
  (void)anhyst_pidd2_solve_q31(to, state, reference, position, load, &new_candidate);
  shift_integral(state, new_candidate.unlimited_output, old_candidate.unlimited_output);
}
