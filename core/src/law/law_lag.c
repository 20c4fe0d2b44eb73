/* SPDX-License-Identifier: Apache-2.0 */
/* The laws with a Langevin curve, as implementations of the interface in law.h. */
#include <math.h>

#include "anhyst/law/law.h"

static int state_size(const void *law)
{
  (void)law;
  return 3;
}

static anhyst_status solve_step(const void *law, const anhyst_memory_f64 *state, double omega,
                                double r, anhyst_solution_f64 *found)
{
  anhyst_candidate_f64 candidate;
  const anhyst_status status = anhyst_solve_f64(law, &state->lag, omega, r, &candidate);
  if (status == ANHYST_OK) {
    found->x = candidate.state.x;
    found->m = candidate.m;
    found->slope = candidate.m_slope;
    found->next.lag = candidate.state;
  }
  return status;
}

static void accept_step(const void *law, anhyst_memory_f64 *state, const anhyst_solution_f64 *found)
{
  (void)law;
  state->lag = found->next.lag;
}

static void read_field_and_m(const void *law, const anhyst_memory_f64 *state, double *x, double *m)
{
  *x = state->lag.x;
  *m = anhyst_operator_m_f64(law, &state->lag);
}

static anhyst_status set_state(const void *law, const double *given, anhyst_memory_f64 *state)
{
  state->lag.x = given[0];
  state->lag.y = given[1];
  state->lag.p = given[2];
  return anhyst_state_check_f64(law, &state->lag);
}

static void read_state_numbers(const void *law, const anhyst_memory_f64 *state, double *found)
{
  (void)law;
  found[0] = state->lag.x;
  found[1] = state->lag.y;
  found[2] = state->lag.p;
}

/* Extrapolates the limit of a geometric sequence from three members. The states at the ends of
   repeated cycles approach their limit like a geometric sequence. */
static void extrapolate_drift(const void *law, const double *const ends[3],
                              anhyst_memory_f64 *state)
{
  const double first = ends[1][1] - ends[0][1];
  const double second = ends[2][1] - ends[1][1];
  const double change = second - first;
  if (!(fabs(second) < fabs(first)) || !(fabs(change) > 0.0)) {
    return;
  }
  anhyst_state_f64 limit = state->lag;
  limit.y -= second * second / change;
  if (anhyst_state_check_f64(law, &limit) == ANHYST_OK) {
    state->lag = limit;
  }
}

const anhyst_law_f64 anhyst_law_lag_f64 = {state_size,       solve_step, accept_step,
                                           read_field_and_m, set_state,  read_state_numbers,
                                           extrapolate_drift};
