/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/tracking.h"

#include "anhyst/numeric/q31.h"

/* The distance between two numbers in order, which may be beyond an int32_t. */
static uint32_t distance(int32_t low, int32_t high) { return (uint32_t)high - (uint32_t)low; }

static int is_number_q31(int32_t a)
{
  (void)a;
  return 1; /* every code is one */
}

/* A whole number of steps, so that no rounded current is beyond a limit. */
static int are_limits_q31(const anhyst_tracking_settings_q31 *settings)
{
  return settings->current_low <= settings->current_high && settings->current_step >= 0 &&
         (settings->current_step == 0 || distance(settings->current_low, settings->current_high) %
                                                 (uint32_t)settings->current_step ==
                                             0U);
}

static anhyst_status check_pid_q31(const anhyst_pid_q31 *pid)
{
  return anhyst_pidd2_check_q31(pid);
}

/* PIDD2 of a position that is to be zero: it lies where the error is, the other way. */
static int32_t step_pid_q31(const anhyst_pid_q31 *pid, anhyst_pid_state_q31 *state, int32_t error,
                            int32_t forward)
{
  anhyst_pidd2_candidate_q31 candidate;
  const int32_t net =
      anhyst_pidd2_solve_q31(pid, state, 0, anhyst_sub_q31(0, error), forward, &candidate);
  anhyst_pidd2_commit_q31(pid, state, &candidate, net);
  return net;
}

static int32_t within_q31(int32_t a, int32_t low, int32_t high)
{
  return anhyst_clamp(a, low, high);
}

/* The nearest of the converter's currents, for one within the limits. */
static int32_t on_grid_q31(int32_t current, int32_t low, int32_t high, int32_t grid)
{
  const uint32_t step = (uint32_t)grid;
  const uint32_t above = distance(low, current);
  const uint32_t rest = above % step;
  const uint32_t reached = rest >= step - rest ? above - rest + step : above - rest;
  (void)high; /* a whole number of steps away */
  return (int32_t)((uint32_t)low + reached);
}

#include "generic/tracking.h"
