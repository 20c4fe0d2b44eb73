/* SPDX-License-Identifier: Apache-2.0 */

/* What follows is the same in every format; the few operations in which they differ stand before
   it: generic/axes_real.h for floating point, axes_fixed.c for q31. */

anhyst_status anhyst_axes_init_x(anhyst_axes_x *c, const anhyst_axes_settings_x *settings,
                                 anhyst_force_controller_x *const *drive)
{
  const anhyst_axes_x fresh = {0};
  const uint16_t axes = settings->layout.axes;
  anhyst_wrench_x share;
  int valid =
      anhyst_wrench_init_x(&share, &settings->layout) == ANHYST_OK && settings->heads >= axes &&
      settings->heads <= ANHYST_AXES_HEADS && are_rows(settings->see, axes, settings->heads) &&
      are_rows(settings->without, (uint16_t)(settings->heads * axes), settings->heads) &&
      are_rows(settings->decouple, axes, axes) && are_rows(settings->weigh, axes, axes) &&
      are_limits(settings) && settings->follow >= 0 && settings->slew >= 0 && settings->off >= 0 &&
      settings->off_ticks > 0U && settings->jump >= 0 && settings->doubt > 0U;
  int i;
  for (i = 0; valid && i < (int)axes; i++) {
    valid = are_steps(settings, i) && check_pid(&settings->pid[i]) == ANHYST_OK;
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
static ANHYST_REAL off_its_way(anhyst_axes_x *c, int i, ANHYST_REAL read)
{
  const ANHYST_REAL slew = c->settings->slew;
  const ANHYST_REAL wanted = c->commanded[i];
  const ANHYST_REAL step = part_of(anhyst_sub_x(wanted, c->due[i]), c->settings->follow);
  ANHYST_REAL low;
  ANHYST_REAL high;
  c->due[i] = anhyst_add_x(c->due[i], step > slew ? slew : step < -slew ? -slew : step);
  low = wanted < c->due[i] ? wanted : c->due[i];
  high = wanted < c->due[i] ? c->due[i] : wanted;
  if (read < low) {
    return anhyst_sub_x(low, read);
  }
  return read > high ? anhyst_sub_x(read, high) : 0;
}

/* Sets the body down, or lets it go. */
static void end(anhyst_axes_x *c, int seen)
{
  if (!seen) {
    c->flight = ANHYST_AXES_REST;
  } else if (c->flight == ANHYST_AXES_FLY || c->flight == ANHYST_AXES_LIFT) {
    c->flight = ANHYST_AXES_LAND;
    c->landing = 0;
  }
}

/* Finds drives that are lost, and what follows from it. */
static void watch(anhyst_axes_x *c, const anhyst_axes_sample_x *sample)
{
  const anhyst_axes_settings_x *settings = c->settings;
  int i;
  for (i = 0; settings->off > 0 && i < (int)settings->layout.drives; i++) {
    const uint16_t bit = (uint16_t)(1U << i);
    const ANHYST_REAL off = off_its_way(c, i, sample->current[i]);
    const int told = is_told(sample->current[i]);
    if ((c->share.lost & bit) || (told && off <= settings->off)) {
      c->wrong[i] = 0;
    } else if (told) {
      c->wrong[i]++;
    }
    if (c->wrong[i] >= settings->off_ticks) {
      if (c->flight == ANHYST_AXES_LIFT || c->share.lost || !(settings->spare & bit)) {
        end(c, 1);
      }
      anhyst_wrench_lose_x(&c->share, i);
    }
  }
}

/* Finds heads that are lost, and what follows; whether what the others say now can be believed. */
static int watch_heads(anhyst_axes_x *c, const ANHYST_REAL *head)
{
  const anhyst_axes_settings_x *settings = c->settings;
  int believed = 1;
  int j;
  for (j = 0; settings->jump > 0 && j < (int)settings->heads; j++) {
    const uint16_t bit = (uint16_t)(1U << j);
    const int sighted = c->sighted & bit;
    const ANHYST_REAL moved = sighted ? anhyst_sub_x(head[j], c->seen[j]) : 0;
    if (c->blind & bit) {
      continue;
    }
    if (!is_number(head[j]) || moved > settings->jump || moved < -settings->jump) {
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
      end(c, !c->blind && settings->spare_heads >> j & 1);
      c->blind |= bit;
      c->gone = (uint16_t)j;
    }
  }
  return believed;
}

/* Moves what is aimed at against the target: the way down, or up; at rest nothing is remembered. */
static void lead(anhyst_axes_x *c)
{
  const anhyst_axes_settings_x *settings = c->settings;
  const anhyst_axis_pid_state_x rest = {0};
  int left = 0;
  int k;
  if ((c->flight == ANHYST_AXES_LAND) && (c->landing++ >= settings->land_ticks)) {
    c->flight = ANHYST_AXES_REST;
  }
  for (k = 0; k < (int)settings->layout.axes; k++) {
    const ANHYST_REAL lift = settings->lift[k];
    if (c->flight == ANHYST_AXES_LAND) {
      c->away[k] = anhyst_add_x(c->away[k], settings->land[k]);
    } else if (c->flight == ANHYST_AXES_LIFT && (c->away[k] > lift || c->away[k] < -lift)) {
      c->away[k] = anhyst_add_x(c->away[k], c->away[k] > lift ? -lift : lift);
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
static uint16_t obey(anhyst_axes_x *c, uint16_t command, int plausible, ANHYST_REAL *error)
{
  const int rests = c->flight == ANHYST_AXES_REST;
  uint16_t flags = 0;
  int k;
  if (command == ANHYST_COMMAND_IDLE) {
    c->flight = ANHYST_AXES_REST;
  } else if (command == ANHYST_COMMAND_LAND && !rests && c->flight != ANHYST_AXES_LAND) {
    end(c, 1);
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
static uint16_t control(anhyst_axes_x *c, const anhyst_axes_sample_x *sample, ANHYST_REAL *wrench)
{
  const anhyst_axes_settings_x *settings = c->settings;
  const int axes = (int)settings->layout.axes;
  ANHYST_REAL error[ANHYST_WRENCH_AXES];
  ANHYST_REAL apart[ANHYST_WRENCH_AXES];
  ANHYST_REAL head[ANHYST_AXES_HEADS];
  anhyst_rows_x see = settings->see;
  int plausible = watch_heads(c, sample->head);
  uint16_t flags;
  int k;
  for (k = 0; k < (int)settings->heads; k++) {
    head[k] = c->blind >> k & 1 ? 0 : sample->head[k];
    plausible = plausible && is_number(head[k]);
  }
  if (c->blind) {
    see = rows_from(settings->without, (int)c->gone * axes, (int)settings->heads);
  }
  lead(c);
  look(settings, see, head, sample->target, error);
  for (k = 0; k < axes; k++) {
    error[k] = anhyst_sub_x(c->away[k], error[k]);
    plausible = plausible && error[k] <= settings->reach[k] && error[k] >= -settings->reach[k];
  }
  flags = obey(c, sample->command, plausible, error);
  multiply(settings->decouple, axes, axes, error, apart);
  for (k = 0; plausible && c->flight != ANHYST_AXES_REST && k < axes; k++) {
    c->asked[k] = step_pid(&settings->pid[k], &c->state[k], apart[k]);
  }
  multiply(settings->weigh, axes, axes, c->asked, wrench);
  for (k = 0; k < axes; k++) {
    wrench[k] = anhyst_add_x(wrench[k], sample->forward[k]);
  }
  return plausible ? flags : flags | ANHYST_SAMPLE_IMPLAUSIBLE;
}

void anhyst_axes_tick_x(anhyst_axes_x *c, const anhyst_axes_sample_x *sample,
                        anhyst_axes_answer_x *out)
{
  const anhyst_axes_settings_x *settings = c->settings;
  ANHYST_REAL force[ANHYST_WRENCH_DRIVES];
  int i;
  watch(c, sample);
  out->flags = control(c, sample, out->demand);
  out->lost = c->share.lost | (uint32_t)c->blind << 16;
  out->state = c->flight;
  if (c->flight != ANHYST_AXES_REST && !anhyst_wrench_share_x(&c->share, out->demand, force)) {
    out->flags |= ANHYST_DEMAND_LIMITED;
  }
  for (i = 0; i < (int)settings->layout.drives; i++) {
    anhyst_force_controller_x *drive = c->drive[i];
    const int is_lost = (c->share.lost & ((uint32_t)1 << i)) != 0U;
    ANHYST_REAL wanted = 0;
    if (c->flight != ANHYST_AXES_REST && !is_lost) {
      wanted = anhyst_force_controller_solve_x(drive, force[i], sample->gap[i], sample->flux[i]);
      out->flags |= drive->flags;
    }
    if (wanted < settings->current_low || wanted > settings->current_high) {
      out->flags |= ANHYST_CURRENT_LIMITED;
    }
    out->current[i] =
        on_grid(within(wanted, settings->current_low, settings->current_high),
                settings->current_low, settings->current_high, settings->current_step);
    c->commanded[i] = out->current[i];
    if (!is_lost) { /* whose iron nobody asks again */
      (void)anhyst_force_controller_commit_x(drive, out->current[i], sample->gap[i]);
    }
  }
}
