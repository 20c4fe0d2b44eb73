/* SPDX-License-Identifier: Apache-2.0 */

/* What follows is the same in every format; the few operations in which they differ stand before
   it: tracking.c for q31, generic/tracking_real.h for the others. */

anhyst_status ANHYST_NAME(anhyst_tracking_init)(
    ANHYST_NAME(anhyst_tracking) *c, const ANHYST_NAME(anhyst_tracking_settings) *settings,
    ANHYST_NAME(anhyst_force_controller) *const *drive, uint16_t drives,
    ANHYST_NAME(anhyst_biquad_state) *filtered)
{
  const ANHYST_NAME(anhyst_tracking) fresh = {0};
  const ANHYST_NAME(anhyst_biquad_state) rest = {{0, 0}};
  const int paired = settings->allocation.kind == ANHYST_ALLOCATE_SINGLE || drives % 2U == 0U;
  int valid =
      drives > 0U && paired && ANHYST_NAME(anhyst_allocation_is_valid)(&settings->allocation) &&
      ANHYST_NAME(are_limits)(settings) && ANHYST_NAME(check_pid)(&settings->pid) == ANHYST_OK;
  for (uint16_t i = 0; i < settings->filters; i++) {
    valid = valid && ANHYST_NAME(anhyst_biquad_check)(&settings->filter[i]) == ANHYST_OK;
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
static ANHYST_REAL ANHYST_NAME(control)(ANHYST_NAME(anhyst_tracking) *c, ANHYST_REAL error,
                                        ANHYST_REAL forward)
{
  const ANHYST_NAME(anhyst_tracking_settings) *settings = c->settings;
  if (!ANHYST_NAME(is_number)(error)) {
    return error;
  }
  for (uint16_t i = 0; i < settings->filters; i++) {
    error = ANHYST_NAME(anhyst_biquad_step)(&settings->filter[i], &c->filtered[i], error);
  }
  return ANHYST_NAME(step_pid)(&settings->pid, &c->state, error, forward);
}

/* The current that is driven for a wanted one. */
static ANHYST_REAL ANHYST_NAME(driven)(const ANHYST_NAME(anhyst_tracking_settings) *settings,
                                       ANHYST_REAL wanted)
{
  const ANHYST_REAL held =
      ANHYST_NAME(within)(wanted, settings->current_low, settings->current_high);
  return settings->current_step > 0
             ? ANHYST_NAME(on_grid)(held, settings->current_low, settings->current_high,
                                    settings->current_step)
             : held;
}

void ANHYST_NAME(anhyst_tracking_tick)(ANHYST_NAME(anhyst_tracking) *c,
                                       const ANHYST_NAME(anhyst_tracking_sample) *sample,
                                       ANHYST_NAME(anhyst_tracking_answer) *out)
{
  const ANHYST_NAME(anhyst_tracking_settings) *settings = c->settings;
  ANHYST_REAL force[2];
  out->demand = ANHYST_NAME(control)(c, sample->error, sample->forward);
  out->flags = 0;
  if (!ANHYST_NAME(is_number)(out->demand)) {
    out->flags |= ANHYST_DEMAND_LIMITED;
  }
  ANHYST_NAME(anhyst_allocate)(&settings->allocation, out->demand, force);
  for (uint16_t i = 0; i < c->drives; i++) {
    ANHYST_NAME(anhyst_force_controller) *drive = c->drive[i];
    const ANHYST_REAL wanted = ANHYST_NAME(anhyst_force_controller_solve)(
        drive, force[i % 2U], sample->gap[i], sample->flux[i]);
    out->flags |= drive->flags;
    if (wanted < settings->current_low || wanted > settings->current_high) {
      out->flags |= ANHYST_CURRENT_LIMITED;
    }
    out->current[i] = ANHYST_NAME(driven)(settings, wanted);
    (void)ANHYST_NAME(anhyst_force_controller_commit)(drive, out->current[i], sample->gap[i]);
  }
}
