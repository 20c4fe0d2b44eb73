/* SPDX-License-Identifier: Apache-2.0 */

/* What follows is the same in every format; the few operations in which they differ stand before
   it: tracking.c for q31, generic/tracking_real.h for the others. */

anhyst_status anhyst_tracking_init_x(anhyst_tracking_x *c,
                                     const anhyst_tracking_settings_x *settings,
                                     anhyst_force_controller_x *const *drive, uint16_t drives,
                                     anhyst_biquad_state_x *filtered)
{
  const anhyst_tracking_x fresh = {0};
  const anhyst_biquad_state_x rest = {{0, 0}};
  const int paired = settings->allocation.kind == ANHYST_ALLOCATE_SINGLE || drives % 2U == 0U;
  int valid = drives > 0U && paired && anhyst_allocation_is_valid_x(&settings->allocation) &&
              are_limits(settings) && check_pid(&settings->pid) == ANHYST_OK;
  for (uint16_t i = 0; i < settings->filters; i++) {
    valid = valid && anhyst_biquad_check_x(&settings->filter[i]) == ANHYST_OK;
  }
  if (!valid) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = fresh;
  c->settings = settings;
  c->drive = drive;
  c->drives = drives;
  c->filtered = filtered;
  for (uint16_t i = 0; i < settings->filters; i++) {
    filtered[i] = rest;
  }
  return ANHYST_OK;
}

/* The net force that error and feedforward ask for; an error that is no number must not stay in a
   filter. */
static ANHYST_REAL control(anhyst_tracking_x *c, ANHYST_REAL error, ANHYST_REAL forward)
{
  const anhyst_tracking_settings_x *settings = c->settings;
  if (!is_number(error)) {
    return error;
  }
  for (uint16_t i = 0; i < settings->filters; i++) {
    error = anhyst_biquad_step_x(&settings->filter[i], &c->filtered[i], error);
  }
  return step_pid(&settings->pid, &c->state, error, forward);
}

/* The current that is driven for a wanted one. */
static ANHYST_REAL driven(const anhyst_tracking_settings_x *settings, ANHYST_REAL wanted)
{
  const ANHYST_REAL held = within(wanted, settings->current_low, settings->current_high);
  return settings->current_step > 0
             ? on_grid(held, settings->current_low, settings->current_high, settings->current_step)
             : held;
}

void anhyst_tracking_tick_x(anhyst_tracking_x *c, const anhyst_tracking_sample_x *sample,
                            anhyst_tracking_answer_x *out)
{
  const anhyst_tracking_settings_x *settings = c->settings;
  ANHYST_REAL force[2];
  out->demand = control(c, sample->error, sample->forward);
  out->flags = 0;
  if (!is_number(out->demand)) {
    out->flags |= ANHYST_DEMAND_LIMITED;
  }
  anhyst_allocate_x(&settings->allocation, out->demand, force);
  for (uint16_t i = 0; i < c->drives; i++) {
    anhyst_force_controller_x *drive = c->drive[i];
    const ANHYST_REAL wanted =
        anhyst_force_controller_solve_x(drive, force[i % 2U], sample->gap[i], sample->flux[i]);
    out->flags |= drive->flags;
    if (wanted < settings->current_low || wanted > settings->current_high) {
      out->flags |= ANHYST_CURRENT_LIMITED;
    }
    out->current[i] = driven(settings, wanted);
    (void)anhyst_force_controller_commit_x(drive, out->current[i], sample->gap[i]);
  }
}
