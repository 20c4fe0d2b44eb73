/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/axes_fixed.h"

#include <stddef.h>

#include "anhyst/compensator/flags.h"
#include "anhyst/numeric/q31.h"
#include "limits.h"

static int is_number(int32_t a) { return a != ANHYST_Q31_MIN; }
static int is_measurement_present(int32_t a) { return is_number(a); }

static int are_rows_valid(anhyst_rows_q31 rows, uint16_t count, uint16_t length)
{
  return anhyst_rows_are_valid_q31(rows, count, length);
}

static int are_limits_valid(const anhyst_axes_settings_q31 *settings)
{
  return !settings->axis && settings->current_step > 0 &&
         is_range_on_grid(settings->current_low, settings->current_high, settings->current_step);
}

static int are_axis_limits_valid(const anhyst_axes_settings_q31 *settings, int k)
{
  return settings->reach[k] > 0 && settings->lift[k] > 0;
}

static int is_coefficient_valid(int32_t a)
{
  return a >= -ANHYST_AXIS_PID_MOST && a <= ANHYST_AXIS_PID_MOST;
}

static anhyst_status check_pid(const anhyst_axis_pid_q31 *pid)
{
  const int valid = is_coefficient_valid(pid->direct) && is_coefficient_valid(pid->summed) &&
                    is_coefficient_valid(pid->lagging) && pid->decay > 0 &&
                    pid->shift <= ANHYST_AXIS_PID_SHIFT;
  return valid ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

static int32_t step_pid(const anhyst_axis_pid_q31 *pid, anhyst_axis_pid_state_q31 *state,
                        int32_t error)
{
  const int64_t max_sum = (int64_t)ANHYST_Q31_MAX * ((int64_t)1 << pid->shift);
  const int64_t sum = anhyst_clamp_wide(state->sum, max_sum);
  const int64_t lag = anhyst_clamp_wide(state->lag, ANHYST_WIDE_ONE);
  const int64_t output = anhyst_wide(pid->direct, error) + sum + lag;
  const int64_t lag_decay = anhyst_wide((int32_t)anhyst_rounded_shift(lag, 30), pid->decay);
  state->sum = anhyst_clamp_wide(sum + anhyst_wide(pid->summed, error), max_sum);
  state->lag =
      anhyst_clamp_wide(lag - lag_decay + anhyst_wide(pid->lagging, error), ANHYST_WIDE_ONE);
  return anhyst_sat_wide(anhyst_rounded_shift(output, pid->shift));
}

static int32_t times_fraction(int32_t a, int32_t f) { return anhyst_product_q31(a, f); }

static void multiply_matrix(anhyst_rows_q31 matrix, int rows, int columns, const int32_t *values,
                            int32_t *result)
{
  int i;
  for (i = 0; i < rows; i++) {
    result[i] = anhyst_row_product_q31(&matrix.number[(ptrdiff_t)i * columns], matrix.shift[i],
                                       (uint16_t)columns, values);
  }
}

static void measure_pose(const anhyst_axes_settings_q31 *settings, anhyst_rows_q31 see,
                         const int32_t *head, const int32_t *target, int32_t *pose)
{
  (void)target; /* only floating point supports sensors on the ground */
  multiply_matrix(see, (int)settings->layout.axes, (int)settings->heads, head, pose);
}

static anhyst_rows_q31 matrix_from_row(anhyst_rows_q31 matrix, int row, int columns)
{
  const anhyst_rows_q31 from = {&matrix.number[(ptrdiff_t)row * columns], &matrix.shift[row]};
  return from;
}

#include "generic/axes.h"
