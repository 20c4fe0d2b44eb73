/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/tracking.h"

#include <math.h>

#include "anhyst/numeric/f64.h"
#include "generic/limits_real.h"

anhyst_status anhyst_tracking_init(anhyst_tracking *c, const anhyst_tracking_settings *settings,
                                   anhyst_force_controller_f64 *drive,
                                   anhyst_biquad_state_f64 *filtered)
{
  const anhyst_tracking initial = {settings, drive, filtered, {{0.0, 0.0}}};
  const double range = settings->high - settings->low;
  const double step = settings->step;
  int valid = is_number(settings->low) && is_number(range) && range >= 0.0 && step >= 0.0 &&
              (step == 0.0 || range <= 1073741824.0 * step) &&
              anhyst_biquad_check_f64(&settings->pid) == ANHYST_OK;
  uint16_t i;
  for (i = 0; i < settings->filters; i++) {
    valid = valid && anhyst_biquad_check_f64(&settings->filter[i]) == ANHYST_OK;
  }
  if (!valid) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = initial;
  for (i = 0; i < settings->filters; i++) {
    filtered[i] = initial.state;
  }
  return ANHYST_OK;
}

anhyst_tracking_answer anhyst_tracking_tick(anhyst_tracking *c, double error, double forward)
{
  const anhyst_tracking_settings *settings = c->settings;
  anhyst_tracking_answer out = {error, 0.0};
  if (is_number(error)) {
    for (uint16_t i = 0; i < settings->filters; i++) {
      error = anhyst_biquad_step_f64(&settings->filter[i], &c->filtered[i], error);
    }
    out.demand = anhyst_biquad_step_f64(&settings->pid, &c->state, error) + forward;
  }
  out.output = anhyst_force_controller_solve_f64(c->drive, out.demand, 0.0, (double)NAN);
  out.output = clamp(out.output, settings->low, settings->high);
  if (settings->step > 0.0) {
    out.output = round_to_grid(out.output, settings->low, settings->high, settings->step);
  }
  (void)anhyst_force_controller_commit_f64(c->drive, out.output, 0.0);
  return out;
}
