/* SPDX-License-Identifier: Apache-2.0 */

static int ANHYST_NAME(is_share)(ANHYST_REAL x) { return x >= R(0.0) && x <= R(1.0); }

anhyst_status ANHYST_NAME(anhyst_pidd2_check)(const ANHYST_NAME(anhyst_pidd2_gains) *gains)
{
  const int finite = isfinite(gains->proportional) && isfinite(gains->integral) &&
                     isfinite(gains->derivative) && isfinite(gains->second) &&
                     isfinite(gains->load);
  const int shares = ANHYST_NAME(is_share)(gains->back) && ANHYST_NAME(is_share)(gains->weight) &&
                     ANHYST_NAME(is_share)(gains->smoothing) && gains->smoothing > R(0.0) &&
                     ANHYST_NAME(is_share)(gains->smoothing_2) && gains->smoothing_2 > R(0.0);
  return finite && shares && gains->low <= gains->high ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

ANHYST_REAL ANHYST_NAME(anhyst_pidd2_solve)(const ANHYST_NAME(anhyst_pidd2_gains) *gains,
                                            const ANHYST_NAME(anhyst_pidd2_state) *state,
                                            ANHYST_REAL reference, ANHYST_REAL position,
                                            ANHYST_REAL load,
                                            ANHYST_NAME(anhyst_pidd2_candidate) *candidate)
{
  /* A filter moves by the derivative it gives. */
  const ANHYST_REAL first = gains->smoothing * (position - state->position);
  const ANHYST_REAL second = gains->smoothing_2 * (first - state->velocity);
  const ANHYST_REAL u = gains->proportional * (gains->weight * reference - position) +
                        state->integral - gains->derivative * first - gains->second * second +
                        gains->load * load;
  candidate->next.position = state->position + first;
  candidate->next.velocity = state->velocity + second;
  candidate->next.integral = state->integral + gains->integral * (reference - position);
  candidate->wanted = u;
  candidate->output = u;
  if (u < gains->low) {
    candidate->output = gains->low;
  } else if (u > gains->high) {
    candidate->output = gains->high;
  }
  return candidate->output;
}

void ANHYST_NAME(anhyst_pidd2_commit)(const ANHYST_NAME(anhyst_pidd2_gains) *gains,
                                      ANHYST_NAME(anhyst_pidd2_state) *state,
                                      const ANHYST_NAME(anhyst_pidd2_candidate) *candidate,
                                      ANHYST_REAL applied)
{
  *state = candidate->next;
  state->integral += gains->back * (applied - candidate->wanted);
}

void ANHYST_NAME(anhyst_pidd2_start)(const ANHYST_NAME(anhyst_pidd2_gains) *gains,
                                     ANHYST_NAME(anhyst_pidd2_state) *state, ANHYST_REAL reference,
                                     ANHYST_REAL position, ANHYST_REAL load, ANHYST_REAL output)
{
  ANHYST_NAME(anhyst_pidd2_candidate) without;
  state->position = position;
  state->velocity = R(0.0);
  state->integral = R(0.0);
  (void)ANHYST_NAME(anhyst_pidd2_solve)(gains, state, reference, position, load, &without);
  state->integral = output - without.wanted;
}

void ANHYST_NAME(anhyst_pidd2_change)(const ANHYST_NAME(anhyst_pidd2_gains) *from,
                                      const ANHYST_NAME(anhyst_pidd2_gains) *to,
                                      ANHYST_NAME(anhyst_pidd2_state) *state, ANHYST_REAL reference,
                                      ANHYST_REAL position, ANHYST_REAL load)
{
  ANHYST_NAME(anhyst_pidd2_candidate) before;
  ANHYST_NAME(anhyst_pidd2_candidate) after;
  (void)ANHYST_NAME(anhyst_pidd2_solve)(from, state, reference, position, load, &before);
  (void)ANHYST_NAME(anhyst_pidd2_solve)(to, state, reference, position, load, &after);
  state->integral += before.wanted - after.wanted;
}
