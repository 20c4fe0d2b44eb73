/* SPDX-License-Identifier: Apache-2.0 */

static int ANHYST_NAME(is_number)(ANHYST_REAL a) { return a >= R(-1e30) && a <= R(1e30); }

static int ANHYST_NAME(are_numbers)(const ANHYST_REAL *values, uint16_t rows, uint16_t columns)
{
  int found = 1;
  int i;
  for (i = 0; i < (int)rows * (int)columns; i++) {
    found = found && ANHYST_NAME(is_number)(values[i]);
  }
  return found;
}

anhyst_status ANHYST_NAME(anhyst_axes_init)(ANHYST_NAME(anhyst_axes) *c,
                                            const ANHYST_NAME(anhyst_axes_settings) *settings,
                                            ANHYST_NAME(anhyst_force_controller) *const *drive)
{
  const ANHYST_NAME(anhyst_axes) fresh = {0};
  const uint16_t axes = settings->layout.axes;
  const ANHYST_REAL range = settings->current_high - settings->current_low;
  ANHYST_NAME(anhyst_wrench) share;
  int valid =
      ANHYST_NAME(anhyst_wrench_init)(&share, &settings->layout) == ANHYST_OK &&
      settings->heads >= axes && ANHYST_NAME(are_numbers)(settings->see, axes, settings->heads) &&
      ANHYST_NAME(are_numbers)(settings->decouple, axes, axes) &&
      ANHYST_NAME(are_numbers)(settings->weigh, axes, axes) &&
      ANHYST_NAME(are_numbers)(settings->reach, axes, 1) &&
      ANHYST_NAME(is_number)(settings->current_low) && range >= R(0.0) &&
      settings->current_step > R(0.0) && range <= R(1073741824.0) * settings->current_step &&
      settings->follow >= R(0.0) && settings->follow <= R(1.0) && settings->slew >= R(0.0) &&
      settings->off >= R(0.0) && settings->off < R(1e30) && settings->off_ticks > 0U &&
      ANHYST_NAME(are_numbers)(settings->land, axes, 1);
  int i;
  for (i = 0; valid && i < (int)axes; i++) {
    valid = settings->reach[i] > R(0.0) &&
            ANHYST_NAME(anhyst_biquad_check)(&settings->pid[i]) == ANHYST_OK;
  }
  if (!valid) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = fresh;
  c->settings = settings;
  c->drive = drive;
  c->share = share;
  return ANHYST_OK;
}

/* found = matrix*values; rows of so many. */
static void ANHYST_NAME(multiply)(const ANHYST_REAL *matrix, int rows, int columns,
                                  const ANHYST_REAL *values, ANHYST_REAL *found)
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

/* By how much a current is off the way from where it should be at least to where it was commanded
 * to go.
 */
static ANHYST_REAL ANHYST_NAME(off_its_way)(ANHYST_NAME(anhyst_axes) *c, int i, ANHYST_REAL read)
{
  const ANHYST_REAL slew = c->settings->slew;
  const ANHYST_REAL wanted = c->commanded[i];
  const ANHYST_REAL step = c->settings->follow * (wanted - c->due[i]);
  ANHYST_REAL low;
  ANHYST_REAL high;
  c->due[i] += step > slew ? slew : step < -slew ? -slew : step;
  low = wanted < c->due[i] ? wanted : c->due[i];
  high = wanted < c->due[i] ? c->due[i] : wanted;
  return read < low ? low - read : read > high ? read - high : R(0.0) * read;
}

/* Finds what is lost, and what follows from it. */
static void ANHYST_NAME(watch)(ANHYST_NAME(anhyst_axes) *c,
                               const ANHYST_NAME(anhyst_axes_sample) *sample)
{
  const ANHYST_NAME(anhyst_axes_settings) *settings = c->settings;
  int i;
  for (i = 0; settings->off > R(0.0) && i < (int)settings->layout.drives; i++) {
    const uint16_t bit = (uint16_t)(1U << i);
    const ANHYST_REAL off = ANHYST_NAME(off_its_way)(c, i, sample->current[i]);
    if ((c->share.lost & bit) || off <= settings->off) {
      c->wrong[i] = 0;
    } else if (off > settings->off) {
      c->wrong[i]++;
    }
    if (c->wrong[i] >= settings->off_ticks) {
      if (c->flight == ANHYST_AXES_FLY && (c->share.lost || !(settings->spare & bit))) {
        c->flight = ANHYST_AXES_LAND;
      }
      ANHYST_NAME(anhyst_wrench_lose)(&c->share, i);
    }
  }
  if (c->flight == ANHYST_AXES_LAND && c->landing++ >= settings->land_ticks) {
    c->flight = ANHYST_AXES_REST;
  }
}

/* The wrench that errors and feedforward ask for; flags. */
static uint16_t ANHYST_NAME(control)(ANHYST_NAME(anhyst_axes) *c,
                                     const ANHYST_NAME(anhyst_axes_sample) *sample,
                                     ANHYST_REAL *wrench)
{
  const ANHYST_NAME(anhyst_axes_settings) *settings = c->settings;
  const int axes = (int)settings->layout.axes;
  ANHYST_REAL error[ANHYST_WRENCH_AXES];
  ANHYST_REAL apart[ANHYST_WRENCH_AXES];
  int plausible = 1;
  int k;
  ANHYST_NAME(multiply)(settings->see, axes, (int)settings->heads, sample->head, error);
  for (k = 0; k < axes; k++) {
    error[k] = sample->target[k] - error[k];
    if (c->landing) {
      error[k] += (ANHYST_REAL)c->landing * settings->land[k];
    }
    plausible = plausible && error[k] <= settings->reach[k] && error[k] >= -settings->reach[k];
  }
  ANHYST_NAME(multiply)(settings->decouple, axes, axes, error, apart);
  for (k = 0; plausible && k < axes; k++) {
    c->asked[k] = ANHYST_NAME(anhyst_biquad_step)(&settings->pid[k], &c->state[k], apart[k]);
  }
  ANHYST_NAME(multiply)(settings->weigh, axes, axes, c->asked, wrench);
  for (k = 0; k < axes; k++) {
    wrench[k] += sample->forward[k];
  }
  return plausible ? 0U : ANHYST_SAMPLE_IMPLAUSIBLE;
}

/* The nearest of the converter's currents within the limits; the lowest for what is no number. */
static ANHYST_REAL ANHYST_NAME(driven)(const ANHYST_NAME(anhyst_axes_settings) *settings,
                                       ANHYST_REAL wanted)
{
  const ANHYST_REAL low = settings->current_low;
  const ANHYST_REAL high = settings->current_high;
  ANHYST_REAL held = wanted > low ? wanted : low;
  int32_t steps;
  held = held > high ? high : held;
  steps = (int32_t)((held - low) / settings->current_step + R(0.5));
  held = low + (ANHYST_REAL)steps * settings->current_step;
  return held > high ? high : held;
}

void ANHYST_NAME(anhyst_axes_tick)(ANHYST_NAME(anhyst_axes) *c,
                                   const ANHYST_NAME(anhyst_axes_sample) *sample,
                                   ANHYST_NAME(anhyst_axes_answer) *out)
{
  const ANHYST_NAME(anhyst_axes_settings) *settings = c->settings;
  ANHYST_REAL force[ANHYST_WRENCH_DRIVES];
  int i;
  ANHYST_NAME(watch)(c, sample);
  out->lost = c->share.lost;
  out->state = c->flight;
  out->flags = ANHYST_NAME(control)(c, sample, out->demand);
  if (!ANHYST_NAME(anhyst_wrench_share)(&c->share, out->demand, force)) {
    out->flags |= ANHYST_DEMAND_LIMITED;
  }
  for (i = 0; i < (int)settings->layout.drives; i++) {
    ANHYST_NAME(anhyst_force_controller) *drive = c->drive[i];
    ANHYST_REAL wanted = R(0.0);
    if (c->flight != ANHYST_AXES_REST && !(c->share.lost >> i & 1)) {
      wanted = ANHYST_NAME(anhyst_force_controller_solve)(drive, force[i], sample->gap[i],
                                                          sample->flux[i]);
      out->flags |= drive->flags;
    }
    if (wanted < settings->current_low || wanted > settings->current_high) {
      out->flags |= ANHYST_CURRENT_LIMITED;
    }
    out->current[i] = ANHYST_NAME(driven)(settings, wanted);
    c->commanded[i] = out->current[i];
    (void)ANHYST_NAME(anhyst_force_controller_commit)(drive, out->current[i], sample->gap[i]);
  }
}
