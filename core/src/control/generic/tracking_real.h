/* SPDX-License-Identifier: Apache-2.0 */

#include "limits_real.h"

static int are_limits(const anhyst_tracking_settings_x *settings)
{
  const ANHYST_REAL range = settings->current_high - settings->current_low;
  return is_number(settings->current_low) && is_number(range) && range >= R(0.0) &&
         settings->current_step >= R(0.0) &&
         range <=
             R(1073741824.0) * (settings->current_step > R(0.0) ? settings->current_step : range);
}

static anhyst_status check_pid(const anhyst_pid_x *pid) { return anhyst_biquad_check_x(pid); }

static ANHYST_REAL step_pid(const anhyst_pid_x *pid, anhyst_pid_state_x *state, ANHYST_REAL error,
                            ANHYST_REAL forward)
{
  return anhyst_biquad_step_x(pid, state, error) + forward;
}
