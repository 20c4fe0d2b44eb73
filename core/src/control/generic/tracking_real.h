/* SPDX-License-Identifier: Apache-2.0 */

static int ANHYST_NAME(is_number)(ANHYST_REAL a) { return a >= R(-1e30) && a <= R(1e30); }

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

/* The lower limit for what is not a number. */
static ANHYST_REAL ANHYST_NAME(within)(ANHYST_REAL a, ANHYST_REAL low, ANHYST_REAL high)
{
  if (!(a > low)) {
    return low;
  }
  return a > high ? high : a;
}

/* The nearest of the converter's currents, for one within the limits. */
static ANHYST_REAL ANHYST_NAME(on_grid)(const ANHYST_NAME(anhyst_tracking_settings) *settings,
                                        ANHYST_REAL current)
{
  const ANHYST_REAL low = settings->current_low;
  const int32_t steps = (int32_t)((current - low) / settings->current_step + R(0.5));
  return low + (ANHYST_REAL)steps * settings->current_step;
}
