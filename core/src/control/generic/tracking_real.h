/* SPDX-License-Identifier: Apache-2.0 */

#include "limits_real.h"

static int ANHYST_NAME(are_limits)(const ANHYST_NAME(anhyst_tracking_settings) *settings)
{
  const ANHYST_REAL range = settings->current_high - settings->current_low;
  return ANHYST_NAME(is_number)(settings->current_low) && ANHYST_NAME(is_number)(range) &&
         range >= R(0.0) && settings->current_step >= R(0.0) &&
         range <=
             R(1073741824.0) * (settings->current_step > R(0.0) ? settings->current_step : range);
}

static anhyst_status ANHYST_NAME(check_pid)(const ANHYST_NAME(anhyst_pid) *pid)
{
  return ANHYST_NAME(anhyst_biquad_check)(pid);
}

static ANHYST_REAL ANHYST_NAME(step_pid)(const ANHYST_NAME(anhyst_pid) *pid,
                                         ANHYST_NAME(anhyst_pid_state) *state, ANHYST_REAL error,
                                         ANHYST_REAL forward)
{
  return ANHYST_NAME(anhyst_biquad_step)(pid, state, error) + forward;
}
