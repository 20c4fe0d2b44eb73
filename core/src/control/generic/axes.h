/* SPDX-License-Identifier: Apache-2.0 */

/* What follows is the same in every format; the few operations in which they differ stand before
   it: generic/axes_real.h for floating point, axes_fixed.c for q31. */

anhyst_status ANHYST_NAME(anhyst_axes_init)(ANHYST_NAME(anhyst_axes) *c,
                                            const ANHYST_NAME(anhyst_axes_settings) *settings,
                                            ANHYST_NAME(anhyst_force_controller) *const *drive)
{
  const ANHYST_NAME(anhyst_axes) fresh = {0};
  const uint16_t axes = settings->layout.axes;
  ANHYST_NAME(anhyst_wrench) share;
  int valid = ANHYST_NAME(anhyst_wrench_init)(&share, &settings->layout) == ANHYST_OK &&
              settings->heads >= axes && settings->heads <= ANHYST_AXES_HEADS &&
              ANHYST_NAME(are_rows)(settings->see, axes, settings->heads) &&
              ANHYST_NAME(are_rows)(settings->without, (uint16_t)(settings->heads * axes),
                                    settings->heads) &&
              ANHYST_NAME(are_rows)(settings->decouple, axes, axes) &&
              ANHYST_NAME(are_rows)(settings->weigh, axes, axes) &&
              ANHYST_NAME(are_limits)(settings) && settings->follow >= 0 && settings->slew >= 0 &&
              settings->off >= 0 && settings->off_ticks > 0U && settings->jump >= 0 &&
              settings->doubt > 0U;
  int i;
  for (i = 0; valid && i < (int)axes; i++) {
    valid = ANHYST_NAME(are_steps)(settings, i) &&
            ANHYST_NAME(check_pid)(&settings->pid[i]) == ANHYST_OK;
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

/* By how much a current is off the way from where it should be at least to where it was commanded
 * to go.
 */
static ANHYST_REAL ANHYST_NAME(off_its_way)(ANHYST_NAME(anhyst_axes) *c, int i, ANHYST_REAL read)
{
  const ANHYST_REAL slew = c->settings->slew;
  const ANHYST_REAL wanted = c->commanded[i];
  const ANHYST_REAL step =
      ANHYST_NAME(part_of)(ANHYST_NAME(anhyst_sub)(wanted, c->due[i]), c->settings->follow);
  ANHYST_REAL low;
  ANHYST_REAL high;
  c->due[i] = ANHYST_NAME(anhyst_add)(c->due[i], step > slew ? slew : step < -slew ? -slew : step);
  low = wanted < c->due[i] ? wanted : c->due[i];
  high = wanted < c->due[i] ? c->due[i] : wanted;
  if (read < low) {
    return ANHYST_NAME(anhyst_sub)(low, read);
  }
  return read > high ? ANHYST_NAME(anhyst_sub)(read, high) : 0;
}

/* Sets the body down, or lets it go. */
static void ANHYST_NAME(end)(ANHYST_NAME(anhyst_axes) *c, int seen)
{
  if (!seen) {
    c->flight = ANHYST_AXES_REST;
  } else if (c->flight == ANHYST_AXES_FLY || c->flight == ANHYST_AXES_LIFT) {
    c->flight = ANHYST_AXES_LAND;
    c->landing = 0;
  }
}

/* Finds drives that are lost, and what follows from it. */
static void ANHYST_NAME(watch)(ANHYST_NAME(anhyst_axes) *c,
                               const ANHYST_NAME(anhyst_axes_sample) *sample)
{
  const ANHYST_NAME(anhyst_axes_settings) *settings = c->settings;
  int i;
  for (i = 0; settings->off > 0 && i < (int)settings->layout.drives; i++) {
    const uint16_t bit = (uint16_t)(1U << i);
    const ANHYST_REAL off = ANHYST_NAME(off_its_way)(c, i, sample->current[i]);
    const int told = ANHYST_NAME(is_told)(sample->current[i]);
    if ((c->share.lost & bit) || (told && off <= settings->off)) {
      c->wrong[i] = 0;
    } else if (told) {
      c->wrong[i]++;
    }
    if (c->wrong[i] >= settings->off_ticks) {
      if (c->flight == ANHYST_AXES_LIFT || c->share.lost || !(settings->spare & bit)) {
        ANHYST_NAME(end)(c, 1);
      }
      ANHYST_NAME(anhyst_wrench_lose)(&c->share, i);
    }
  }
}

/* Finds heads that are lost, and what follows; whether what the others say now can be believed. */
static int ANHYST_NAME(watch_heads)(ANHYST_NAME(anhyst_axes) *c, const ANHYST_REAL *head)
{
  const ANHYST_NAME(anhyst_axes_settings) *settings = c->settings;
  int believed = 1;
  int j;
  for (j = 0; settings->jump > 0 && j < (int)settings->heads; j++) {
    const uint16_t bit = (uint16_t)(1U << j);
    const int sighted = c->sighted & bit;
    const ANHYST_REAL moved = sighted ? ANHYST_NAME(anhyst_sub)(head[j], c->seen[j]) : 0;
    if (c->blind & bit) {
      continue;
    }
    if (!ANHYST_NAME(is_number)(head[j]) || moved > settings->jump || moved < -settings->jump) {
      c->doubt[j] += ANHYST_AXES_ODD;
      believed = 0;
    } else if (sighted && settings->noisy && !(moved > 0) && !(moved < 0)) {
      c->doubt[j]++;
    } else {
      c->doubt[j] = 0;
      c->sighted |= bit;
      c->seen[j] = head[j];
    }
    if (c->doubt[j] >= settings->doubt) {
      ANHYST_NAME(end)(c, !c->blind && settings->spare_heads >> j & 1);
      c->blind |= bit;
      c->gone = (uint16_t)j;
    }
  }
  return believed;
}

/* Moves what is aimed at against the target: the way down, or up; at rest nothing is remembered. */
static void ANHYST_NAME(lead)(ANHYST_NAME(anhyst_axes) *c)
{
  const ANHYST_NAME(anhyst_axes_settings) *settings = c->settings;
  const ANHYST_NAME(anhyst_axis_pid_state) rest = {0};
  int left = 0;
  int k;
  if ((c->flight == ANHYST_AXES_LAND) && (c->landing++ >= settings->land_ticks)) {
    c->flight = ANHYST_AXES_REST;
  }
  for (k = 0; k < (int)settings->layout.axes; k++) {
    const ANHYST_REAL lift = settings->lift[k];
    if (c->flight == ANHYST_AXES_LAND) {
      c->away[k] = ANHYST_NAME(anhyst_add)(c->away[k], settings->land[k]);
    } else if (c->flight == ANHYST_AXES_LIFT && (c->away[k] > lift || c->away[k] < -lift)) {
      c->away[k] = ANHYST_NAME(anhyst_add)(c->away[k], c->away[k] > lift ? -lift : lift);
      left = 1;
    } else {
      c->away[k] = 0;
    }
    if (c->flight == ANHYST_AXES_REST) {
      c->asked[k] = 0;
      c->state[k] = rest;
    }
  }
  if ((c->flight == ANHYST_AXES_LIFT) && !left) {
    c->flight = ANHYST_AXES_FLY;
  }
}

/* Does what is commanded, the error as it is seen; flags. */
static uint16_t ANHYST_NAME(obey)(ANHYST_NAME(anhyst_axes) *c, uint16_t command, int plausible,
                                  ANHYST_REAL *error)
{
  const int rests = c->flight == ANHYST_AXES_REST;
  uint16_t flags = 0;
  int k;
  if (command == ANHYST_COMMAND_IDLE) {
    c->flight = ANHYST_AXES_REST;
  } else if (command == ANHYST_COMMAND_LAND && !rests && c->flight != ANHYST_AXES_LAND) {
    ANHYST_NAME(end)(c, 1);
  } else if (command == ANHYST_COMMAND_LIFT && rests && plausible && !c->share.lost && !c->blind) {
    c->flight = ANHYST_AXES_LIFT;
    for (k = 0; k < (int)c->settings->layout.axes; k++) {
      c->away[k] = -error[k];
      error[k] = 0;
    }
  } else if (command != ANHYST_COMMAND_NONE) {
    flags = ANHYST_COMMAND_REFUSED;
  }
  return flags;
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
  ANHYST_REAL head[ANHYST_AXES_HEADS];
  ANHYST_NAME(anhyst_rows) see = settings->see;
  int plausible = ANHYST_NAME(watch_heads)(c, sample->head);
  uint16_t flags;
  int k;
  for (k = 0; k < (int)settings->heads; k++) {
    head[k] = c->blind >> k & 1 ? 0 : sample->head[k];
    plausible = plausible && ANHYST_NAME(is_number)(head[k]);
  }
  if (c->blind) {
    see = ANHYST_NAME(rows_from)(settings->without, (int)c->gone * axes, (int)settings->heads);
  }
  ANHYST_NAME(lead)(c);
  ANHYST_NAME(look)(settings, see, head, sample->target, error);
  for (k = 0; k < axes; k++) {
    error[k] = ANHYST_NAME(anhyst_sub)(c->away[k], error[k]);
    plausible = plausible && error[k] <= settings->reach[k] && error[k] >= -settings->reach[k];
  }
  flags = ANHYST_NAME(obey)(c, sample->command, plausible, error);
  ANHYST_NAME(multiply)(settings->decouple, axes, axes, error, apart);
  for (k = 0; plausible && c->flight != ANHYST_AXES_REST && k < axes; k++) {
    c->asked[k] = ANHYST_NAME(step_pid)(&settings->pid[k], &c->state[k], apart[k]);
  }
  ANHYST_NAME(multiply)(settings->weigh, axes, axes, c->asked, wrench);
  for (k = 0; k < axes; k++) {
    wrench[k] = ANHYST_NAME(anhyst_add)(wrench[k], sample->forward[k]);
  }
  return plausible ? flags : flags | ANHYST_SAMPLE_IMPLAUSIBLE;
}

void ANHYST_NAME(anhyst_axes_tick)(ANHYST_NAME(anhyst_axes) *c,
                                   const ANHYST_NAME(anhyst_axes_sample) *sample,
                                   ANHYST_NAME(anhyst_axes_answer) *out)
{
  const ANHYST_NAME(anhyst_axes_settings) *settings = c->settings;
  ANHYST_REAL force[ANHYST_WRENCH_DRIVES];
  int i;
  ANHYST_NAME(watch)(c, sample);
  out->flags = ANHYST_NAME(control)(c, sample, out->demand);
  out->lost = c->share.lost | (uint32_t)c->blind << 16;
  out->state = c->flight;
  if (c->flight != ANHYST_AXES_REST &&
      !ANHYST_NAME(anhyst_wrench_share)(&c->share, out->demand, force)) {
    out->flags |= ANHYST_DEMAND_LIMITED;
  }
  for (i = 0; i < (int)settings->layout.drives; i++) {
    ANHYST_NAME(anhyst_force_controller) *drive = c->drive[i];
    const uint32_t lost = c->share.lost >> i & 1U;
    ANHYST_REAL wanted = 0;
    if (c->flight != ANHYST_AXES_REST && !lost) {
      wanted = ANHYST_NAME(anhyst_force_controller_solve)(drive, force[i], sample->gap[i],
                                                          sample->flux[i]);
      out->flags |= drive->flags;
    }
    if (wanted < settings->current_low || wanted > settings->current_high) {
      out->flags |= ANHYST_CURRENT_LIMITED;
    }
    out->current[i] = ANHYST_NAME(on_grid)(
        ANHYST_NAME(within)(wanted, settings->current_low, settings->current_high),
        settings->current_low, settings->current_high, settings->current_step);
    c->commanded[i] = out->current[i];
    if (!lost) { /* whose iron nobody asks again */
      (void)ANHYST_NAME(anhyst_force_controller_commit)(drive, out->current[i], sample->gap[i]);
    }
  }
}
