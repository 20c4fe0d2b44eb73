/* SPDX-License-Identifier: Apache-2.0 */

#include "limits_real.h"

static int are_rows(const ANHYST_REAL *values, uint16_t rows, uint16_t columns)
{
  int found = 1;
  int i;
  for (i = 0; i < (int)rows * (int)columns; i++) {
    found = found && is_number(values[i]);
  }
  return found;
}

static int are_limits(const anhyst_axes_settings_x *settings)
{
  const ANHYST_REAL range = settings->current_high - settings->current_low;
  return is_number(settings->current_low) && range >= R(0.0) && settings->current_step > R(0.0) &&
         range <= R(1073741824.0) * settings->current_step && settings->follow <= R(1.0) &&
         settings->off < R(1e30) && settings->jump < R(1e30);
}

/* Of one axis. */
static int are_steps(const anhyst_axes_settings_x *settings, int k)
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

/* Whether it says anything. */
static int is_told(ANHYST_REAL a)
{
  return is_number(a) || a > R(0.0) || a < R(0.0); /* beyond all numbers, too */
}

static ANHYST_REAL part_of(ANHYST_REAL a, ANHYST_REAL part) { return part * a; }

/* found = matrix*values; rows of so many. */
static void multiply(const ANHYST_REAL *matrix, int rows, int columns, const ANHYST_REAL *values,
                     ANHYST_REAL *found)
{
  int i;
  int j;
  for (i = 0; i < rows; i++) {
    ANHYST_REAL sum = R(0.0); /* apart: what is written through a pointer is read again each time */
    for (j = 0; j < columns; j++) {
      sum += *matrix++ * values[j];
    }
    found[i] = sum;
  }
}

/* Takes a pose that heads on the ground tell to the place where the body is now: they see what a
   turn moves there, p + target x th. */
static void go_along(const anhyst_axes_settings_x *settings, const ANHYST_REAL *target,
                     ANHYST_REAL *pose)
{
  ANHYST_REAL way[6] = {R(0.0)};
  ANHYST_REAL told[6] = {R(0.0)};
  int i;
  for (i = 0; i < (int)settings->layout.axes; i++) {
    way[settings->axis[i]] = target[i];
    told[settings->axis[i]] = pose[i];
  }
  for (i = 0; i < (int)settings->layout.axes && settings->axis[i] < 3U; i++) {
    const int j = (settings->axis[i] + 1) % 3;
    const int k = (settings->axis[i] + 2) % 3;
    pose[i] -= way[j] * told[3 + k] - way[k] * told[3 + j];
  }
}

/* The pose that heads tell. */
static void look(const anhyst_axes_settings_x *settings, const ANHYST_REAL *see,
                 const ANHYST_REAL *head, const ANHYST_REAL *target, ANHYST_REAL *pose)
{
  multiply(see, (int)settings->layout.axes, (int)settings->heads, head, pose);
  if (settings->axis) {
    go_along(settings, target, pose);
  }
}

/* The rows from one of them on; rows of so many. */
static const ANHYST_REAL *rows_from(const ANHYST_REAL *matrix, int row, int columns)
{
  return &matrix[(ptrdiff_t)row * columns];
}
