/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/axes.h"

#include "anhyst/compensator/flags.h"

static int is_number(double a) { return a >= -1e30 && a <= 1e30; }

static int are_numbers(const double *values, uint16_t rows, uint16_t columns)
{
  int found = 1;
  int i;
  for (i = 0; i < (int)rows * (int)columns; i++) {
    found = found && is_number(values[i]);
  }
  return found;
}

anhyst_status anhyst_axes_init(anhyst_axes *c, const anhyst_axes_settings *settings,
                               anhyst_force_controller_f64 *const *drive)
{
  const anhyst_axes fresh = {0};
  const uint16_t axes = settings->layout.axes;
  const double range = settings->current_high - settings->current_low;
  int valid = anhyst_wrench_check(&settings->layout) == ANHYST_OK && settings->heads >= axes &&
              are_numbers(settings->see, axes, settings->heads) &&
              are_numbers(settings->decouple, axes, axes) &&
              are_numbers(settings->weigh, axes, axes) && is_number(settings->current_low) &&
              range >= 0.0 && settings->current_step > 0.0 &&
              range <= 1073741824.0 * settings->current_step;
  int i;
  for (i = 0; valid && i < (int)axes; i++) {
    valid = anhyst_biquad_check_f64(&settings->pid[i]) == ANHYST_OK;
  }
  if (!valid) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = fresh;
  c->settings = settings;
  c->drive = drive;
  return ANHYST_OK;
}

/* found = matrix*values; rows of so many. */
static void multiply(const double *matrix, int rows, int columns, const double *values,
                     double *found)
{
  int i;
  int j;
  for (i = 0; i < rows; i++) {
    found[i] = 0.0;
    for (j = 0; j < columns; j++) {
      found[i] += matrix[i * columns + j] * values[j];
    }
  }
}

/* The wrench that errors and feedforward ask for. */
static void control(anhyst_axes *c, const anhyst_axes_sample *sample, double *wrench)
{
  const anhyst_axes_settings *settings = c->settings;
  const int axes = (int)settings->layout.axes;
  double error[ANHYST_WRENCH_AXES];
  double apart[ANHYST_WRENCH_AXES];
  int k;
  multiply(settings->see, axes, (int)settings->heads, sample->head, error);
  for (k = 0; k < axes; k++) {
    error[k] = sample->target[k] - error[k];
  }
  multiply(settings->decouple, axes, axes, error, apart);
  for (k = 0; k < axes; k++) {
    apart[k] = anhyst_biquad_step_f64(&settings->pid[k], &c->state[k], apart[k]);
  }
  multiply(settings->weigh, axes, axes, apart, wrench);
  for (k = 0; k < axes; k++) {
    wrench[k] += sample->forward[k];
  }
}

/* The nearest of the converter's currents within the limits; the lowest for what is no number. */
static double driven(const anhyst_axes_settings *settings, double wanted)
{
  const double low = settings->current_low;
  double held = wanted > low ? wanted : low;
  int32_t steps;
  held = held > settings->current_high ? settings->current_high : held;
  steps = (int32_t)((held - low) / settings->current_step + 0.5);
  return low + (double)steps * settings->current_step;
}

void anhyst_axes_tick(anhyst_axes *c, const anhyst_axes_sample *sample, anhyst_axes_answer *out)
{
  const anhyst_axes_settings *settings = c->settings;
  double force[ANHYST_WRENCH_DRIVES];
  int i;
  control(c, sample, out->demand);
  out->flags = 0;
  if (!anhyst_wrench_share(&settings->layout, out->demand, force)) {
    out->flags |= ANHYST_DEMAND_LIMITED;
  }
  for (i = 0; i < (int)settings->layout.drives; i++) {
    anhyst_force_controller_f64 *drive = c->drive[i];
    const double wanted =
        anhyst_force_controller_solve_f64(drive, force[i], sample->gap[i], sample->flux[i]);
    out->flags |= drive->flags;
    if (wanted < settings->current_low || wanted > settings->current_high) {
      out->flags |= ANHYST_CURRENT_LIMITED;
    }
    out->current[i] = driven(settings, wanted);
    (void)anhyst_force_controller_commit_f64(drive, out->current[i], sample->gap[i]);
  }
}
