/* SPDX-License-Identifier: Apache-2.0 */

static int is_fraction(ANHYST_REAL x) { return x >= R(0.0) && x <= R(1.0); }

anhyst_status anhyst_pidd2_check_x(const anhyst_pidd2_gains_x *gains)
{
  const int are_gains_finite = isfinite(gains->proportional) && isfinite(gains->integral) &&
                               isfinite(gains->derivative) && isfinite(gains->second) &&
                               isfinite(gains->load);
  const int are_fractions_valid = is_fraction(gains->back) && is_fraction(gains->weight) &&
                                  is_fraction(gains->smoothing) && gains->smoothing > R(0.0) &&
                                  is_fraction(gains->smoothing_2) && gains->smoothing_2 > R(0.0);
  return are_gains_finite && are_fractions_valid && gains->low <= gains->high
             ? ANHYST_OK
             : ANHYST_BAD_PARAMETER;
}

ANHYST_REAL anhyst_pidd2_solve_x(const anhyst_pidd2_gains_x *gains,
                                 const anhyst_pidd2_state_x *state, ANHYST_REAL reference,
                                 ANHYST_REAL position, ANHYST_REAL load,
                                 anhyst_pidd2_candidate_x *candidate)
{
  /* The change of a filter's output in a tick is the filtered derivative. */
  const ANHYST_REAL first = gains->smoothing * (position - state->position);
  const ANHYST_REAL second = gains->smoothing_2 * (first - state->velocity);
  const ANHYST_REAL u = gains->proportional * (gains->weight * reference - position) +
                        state->integral - gains->derivative * first - gains->second * second +
                        gains->load * load;
  candidate->next.position = state->position + first;
  candidate->next.velocity = state->velocity + second;
  candidate->next.integral = state->integral + gains->integral * (reference - position);
  candidate->unlimited_output = u;
  candidate->output = u;
  if (u < gains->low) {
    candidate->output = gains->low;
  } else if (u > gains->high) {
    candidate->output = gains->high;
  }
  return candidate->output;
}

void anhyst_pidd2_commit_x(const anhyst_pidd2_gains_x *gains, anhyst_pidd2_state_x *state,
                           const anhyst_pidd2_candidate_x *candidate, ANHYST_REAL applied)
{
  *state = candidate->next;
  state->integral += gains->back * (applied - candidate->unlimited_output);
}

void anhyst_pidd2_start_x(const anhyst_pidd2_gains_x *gains, anhyst_pidd2_state_x *state,
                          ANHYST_REAL reference, ANHYST_REAL position, ANHYST_REAL load,
                          ANHYST_REAL output)
{
  anhyst_pidd2_candidate_x start_candidate;
  state->position = position;
  state->velocity = R(0.0);
  state->integral = R(0.0);
  (void)anhyst_pidd2_solve_x(gains, state, reference, position, load, &start_candidate);
  state->integral = output - start_candidate.unlimited_output;
}

void anhyst_pidd2_change_x(const anhyst_pidd2_gains_x *from, const anhyst_pidd2_gains_x *to,
                           anhyst_pidd2_state_x *state, ANHYST_REAL reference, ANHYST_REAL position,
                           ANHYST_REAL load)
{
  anhyst_pidd2_candidate_x old_candidate;
  anhyst_pidd2_candidate_x new_candidate;
  (void)anhyst_pidd2_solve_x(from, state, reference, position, load, &old_candidate);
  (void)anhyst_pidd2_solve_x(to, state, reference, position, load, &new_candidate);
  state->integral += old_candidate.unlimited_output - new_candidate.unlimited_output;
}
