/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/pidd2.h"

static int factor_is_sound(anhyst_factor factor, int16_t low, int16_t high)
{
  return factor.shift >= low && factor.shift <= high;
}

/* -1 <= factor <= 0. */
static int smoothing_is_sound(anhyst_factor factor)
{
  return factor.mantissa <= 0 && factor_is_sound(factor, 0, 1);
}

anhyst_status anhyst_pidd2_check_q31(const anhyst_pidd2_gains_q31 *gains)
{
  const int16_t low = ANHYST_PIDD2_SHIFT_LOW;
  const int16_t high = ANHYST_PIDD2_SHIFT_HIGH;
  const int factors = factor_is_sound(gains->proportional, low, high) &&
                      factor_is_sound(gains->integral, low, high) &&
                      factor_is_sound(gains->derivative, low, high) &&
                      factor_is_sound(gains->second, low, high) &&
                      factor_is_sound(gains->load, low, high) &&
                      factor_is_sound(gains->back, low, high) && gains->back.mantissa >= 0;
  const int rest = smoothing_is_sound(gains->smoothing) && smoothing_is_sound(gains->smoothing_2) &&
                   gains->unweighted <= 0 && gains->low <= gains->high;
  return factors && rest ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

int32_t anhyst_pidd2_product(int32_t x, anhyst_factor factor)
{
  if (factor.shift >= 0) {
    /* Shifted first, so that what the product's floor cuts off is not made larger. */
    return anhyst_scale(anhyst_shl_q31(x, (uint16_t)factor.shift), factor.mantissa);
  }
  return anhyst_scale(x, factor.mantissa) >> -factor.shift;
}

int32_t anhyst_pidd2_solve_q31(const anhyst_pidd2_gains_q31 *gains,
                               const anhyst_pidd2_state_q31 *state, int32_t reference,
                               int32_t position, int32_t load,
                               anhyst_pidd2_candidate_q31 *candidate)
{
  const int32_t y = position >> 1; /* q30: differences of two such numbers fit */
  const int32_t r = reference >> 1;
  const int32_t weighted = r + anhyst_scale(reference, gains->unweighted); /* 0..r */

  /* A filter moves by the derivative it gives: differentiating costs no state of its own, and an
     error of rounding is not integrated. */
  const int32_t first = anhyst_pidd2_product(state->position - y, gains->smoothing);
  const int32_t second =
      anhyst_pidd2_product(anhyst_sub_q31(state->velocity, first), gains->smoothing_2);

  int32_t u = anhyst_pidd2_product(weighted - y, gains->proportional);
  u = anhyst_add_q31(u, state->integral >> 2);
  u = anhyst_sub_q31(u, anhyst_pidd2_product(first, gains->derivative));
  u = anhyst_sub_q31(u, anhyst_pidd2_product(second, gains->second));
  u = anhyst_add_q31(u, anhyst_pidd2_product(load, gains->load));

  candidate->next.position = state->position + first;
  candidate->next.velocity = anhyst_add_q31(state->velocity, second);
  candidate->next.integral =
      anhyst_add_q31(state->integral, anhyst_pidd2_product(r - y, gains->integral));
  candidate->wanted = u;
  candidate->output = anhyst_clamp(anhyst_shl_q31(u, 3), gains->low, gains->high);
  return candidate->output;
}

void anhyst_pidd2_commit_q31(const anhyst_pidd2_gains_q31 *gains, anhyst_pidd2_state_q31 *state,
                             const anhyst_pidd2_candidate_q31 *candidate, int32_t applied)
{
  /* Exactly zero where the output was applied as it was wanted. */
  const int32_t missing = anhyst_sub_q31(applied >> 3, candidate->wanted);
  *state = candidate->next;
  state->integral = anhyst_add_q31(state->integral, anhyst_pidd2_product(missing, gains->back));
}

/* Moves the integral so that the wanted output goes from one number to another, q28. */
static void shift_integral(anhyst_pidd2_state_q31 *state, int32_t from, int32_t to)
{
  state->integral = anhyst_add_q31(state->integral, anhyst_shl_q31(anhyst_sub_q31(to, from), 2));
}

void anhyst_pidd2_start_q31(const anhyst_pidd2_gains_q31 *gains, anhyst_pidd2_state_q31 *state,
                            int32_t reference, int32_t position, int32_t load, int32_t output)
{
  anhyst_pidd2_candidate_q31 without;
  state->position = position >> 1;
  state->velocity = 0;
  state->integral = 0;
  (void)anhyst_pidd2_solve_q31(gains, state, reference, position, load, &without);
  shift_integral(state, without.wanted, output >> 3);
}

void anhyst_pidd2_change_q31(const anhyst_pidd2_gains_q31 *from, const anhyst_pidd2_gains_q31 *to,
                             anhyst_pidd2_state_q31 *state, int32_t reference, int32_t position,
                             int32_t load)
{
  anhyst_pidd2_candidate_q31 before;
  anhyst_pidd2_candidate_q31 after;
  (void)anhyst_pidd2_solve_q31(from, state, reference, position, load, &before);
  (void)anhyst_pidd2_solve_q31(to, state, reference, position, load, &after);
  shift_integral(state, after.wanted, before.wanted);
}
