/* SPDX-License-Identifier: Apache-2.0 */

#include "limits_real.h"

static int are_rows_valid(const ANHYST_REAL *values, uint16_t rows, uint16_t columns)
{
  int is_valid = 1;
  int i;
  for (i = 0; i < (int)rows * (int)columns; i++) {
    is_valid = is_valid && is_number(values[i]);
  }
  return is_valid;
}

static int are_limits_valid(const anhyst_axes_settings_x *settings)
{
  const ANHYST_REAL range = settings->current_high - settings->current_low;
  return is_number(settings->current_low) && range >= R(0.0) && settings->current_step > R(0.0) &&
         range <= R(1073741824.0) * settings->current_step && settings->follow <= R(1.0) &&
         settings->off < R(1e30) && settings->jump < R(1e30);
}

static int are_axis_limits_valid(const anhyst_axes_settings_x *settings, int k)
{
  return is_number(settings->reach[k]) && settings->reach[k] > R(0.0) &&
         is_number(settings->lift[k]) && settings->lift[k] > R(0.0) &&
         is_number(settings->land[k]) && (!settings->axis || settings->axis[k] < 6U);
}

static anhyst_status check_pid(const anhyst_axis_pid_x *pid) { return anhyst_biquad_check_x(pid); }

static ANHYST_REAL step_pid(const anhyst_axis_pid_x *pid, anhyst_axis_pid_state_x *state,
                            ANHYST_REAL error)
{
  return anhyst_biquad_step_x(pid, state, error);
}

static int is_measurement_present(ANHYST_REAL a)
{
  return is_number(a) || a > R(0.0) || a < R(0.0); /* infinite values also count as measured */
}

static ANHYST_REAL times_fraction(ANHYST_REAL a, ANHYST_REAL f) { return f * a; }

/* Computes result = matrix*values. The matrix is stored by rows. */
static void multiply_matrix(const ANHYST_REAL *matrix, int rows, int columns,
                            const ANHYST_REAL *values, ANHYST_REAL *result)
{
  int i;
  int j;
  for (i = 0; i < rows; i++) {
    ANHYST_REAL sum = R(0.0); /* a local sum, because a sum behind a pointer is reloaded */
    for (j = 0; j < columns; j++) {
      sum += *matrix++ * values[j];
    }
    result[i] = sum;
  }
}

/* Corrects the pose of a rotated body that sensors on the ground measured, because these sensors
   then see other points of the body. Subtracts the vector product of target and rotation. */
static void correct_ground_sensors(const anhyst_axes_settings_x *settings,
                                   const ANHYST_REAL *target, ANHYST_REAL *pose)
{
  ANHYST_REAL target_by_axis[6] = {R(0.0)};
  ANHYST_REAL pose_by_axis[6] = {R(0.0)};
  int i;
  for (i = 0; i < (int)settings->layout.axes; i++) {
    target_by_axis[settings->axis[i]] = target[i];
    pose_by_axis[settings->axis[i]] = pose[i];
  }
  for (i = 0; i < (int)settings->layout.axes && settings->axis[i] < 3U; i++) {
    const int j = (settings->axis[i] + 1) % 3;
    const int k = (settings->axis[i] + 2) % 3;
    pose[i] -= target_by_axis[j] * pose_by_axis[3 + k] - target_by_axis[k] * pose_by_axis[3 + j];
  }
}

static void measure_pose(const anhyst_axes_settings_x *settings, const ANHYST_REAL *see,
                         const ANHYST_REAL *head, const ANHYST_REAL *target, ANHYST_REAL *pose)
{
  multiply_matrix(see, (int)settings->layout.axes, (int)settings->heads, head, pose);
  if (settings->axis) {
    correct_ground_sensors(settings, target, pose);
  }
}

static const ANHYST_REAL *matrix_from_row(const ANHYST_REAL *matrix, int row, int columns)
{
  return &matrix[(ptrdiff_t)row * columns];
}
