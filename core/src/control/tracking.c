/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/tracking.h"

#include "anhyst/numeric/q31.h"
#include "limits.h"

static int is_number(int32_t a)
{
  (void)a;
  return 1; /* every code is one */
}

static int are_limits(const anhyst_tracking_settings_q31 *settings)
{
  return are_on_grid(settings->current_low, settings->current_high, settings->current_step);
}

static anhyst_status check_pid(const anhyst_pid_q31 *pid) { return anhyst_pidd2_check_q31(pid); }

/* PIDD2 of a position that is to be zero: it lies where the error is, the other way. */
static int32_t step_pid(const anhyst_pid_q31 *pid, anhyst_pid_state_q31 *state, int32_t error,
                        int32_t forward)
{
  anhyst_pidd2_candidate_q31 candidate;
  const int32_t net =
      anhyst_pidd2_solve_q31(pid, state, 0, anhyst_sub_q31(0, error), forward, &candidate);
  anhyst_pidd2_commit_q31(pid, state, &candidate, net);
  return net;
}

#include "generic/tracking.h"
