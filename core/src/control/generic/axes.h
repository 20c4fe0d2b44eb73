/* SPDX-License-Identifier: Apache-2.0 */

#include "limits_real.h"

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
  int valid = ANHYST_NAME(anhyst_wrench_init)(&share, &settings->layout) == ANHYST_OK &&
              settings->heads >= axes && settings->heads <= ANHYST_AXES_HEADS &&
              ANHYST_NAME(are_numbers)(settings->see, axes, settings->heads) &&
              ANHYST_NAME(are_numbers)(settings->without, (uint16_t)(settings->heads * axes),
                                       settings->heads) &&
              ANHYST_NAME(are_numbers)(settings->decouple, axes, axes) &&
              ANHYST_NAME(are_numbers)(settings->weigh, axes, axes) &&
              ANHYST_NAME(are_numbers)(settings->reach, axes, 1) &&
              ANHYST_NAME(is_number)(settings->current_low) && range >= R(0.0) &&
              settings->current_step > R(0.0) &&
              range <= R(1073741824.0) * settings->current_step && settings->follow >= R(0.0) &&
              settings->follow <= R(1.0) && settings->slew >= R(0.0) && settings->off >= R(0.0) &&
              settings->off < R(1e30) && settings->off_ticks > 0U && settings->jump >= R(0.0) &&
              settings->jump < R(1e30) && settings->doubt > 0U &&
              ANHYST_NAME(are_numbers)(settings->land, axes, 1) &&
              ANHYST_NAME(are_numbers)(settings->lift, axes, 1);
  int i;
  for (i = 0; valid && i < (int)axes; i++) {
    valid = settings->reach[i] > R(0.0) && settings->lift[i] > R(0.0) &&
            (!settings->axis || settings->axis[i] < 6U) &&
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
  for (i = 0; settings->off > R(0.0) && i < (int)settings->layout.drives; i++) {
    const uint16_t bit = (uint16_t)(1U << i);
    const ANHYST_REAL off = ANHYST_NAME(off_its_way)(c, i, sample->current[i]);
    if ((c->share.lost & bit) || off <= settings->off) {
      c->wrong[i] = 0;
    } else if (off > settings->off) {
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
  for (j = 0; settings->jump > R(0.0) && j < (int)settings->heads; j++) {
    const uint16_t bit = (uint16_t)(1U << j);
    const int sighted = c->sighted & bit;
    const ANHYST_REAL moved = sighted ? head[j] - c->seen[j] : R(0.0) * head[j];
    if (c->blind & bit) {
      continue;
    }
    if (!(moved <= settings->jump && moved >= -settings->jump)) {
      c->doubt[j] += ANHYST_AXES_ODD;
      believed = 0;
    } else if (sighted && settings->noisy && !(moved > R(0.0)) && !(moved < R(0.0))) {
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
  const ANHYST_NAME(anhyst_biquad_state) rest = {{R(0.0), R(0.0)}};
  int left = 0;
  int k;
  if ((c->flight == ANHYST_AXES_LAND) && (c->landing++ >= settings->land_ticks)) {
    c->flight = ANHYST_AXES_REST;
  }
  for (k = 0; k < (int)settings->layout.axes; k++) {
    const ANHYST_REAL lift = settings->lift[k];
    if (c->flight == ANHYST_AXES_LAND) {
      c->away[k] += settings->land[k];
    } else if (c->flight == ANHYST_AXES_LIFT && (c->away[k] > lift || c->away[k] < -lift)) {
      c->away[k] += c->away[k] > lift ? -lift : lift;
      left = 1;
    } else {
      c->away[k] = R(0.0);
    }
    if (c->flight == ANHYST_AXES_REST) {
      c->asked[k] = R(0.0);
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
      error[k] = R(0.0);
    }
  } else if (command != ANHYST_COMMAND_NONE) {
    flags = ANHYST_COMMAND_REFUSED;
  }
  return flags;
}

/* Takes a pose that heads on the ground tell to the place where the body is now: they see what a
   turn moves there, p + target x th. */
static void ANHYST_NAME(go_along)(const ANHYST_NAME(anhyst_axes_settings) *settings,
                                  const ANHYST_REAL *target, ANHYST_REAL *pose)
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
  const ANHYST_REAL *see = settings->see;
  int plausible = ANHYST_NAME(watch_heads)(c, sample->head);
  uint16_t flags;
  int k;
  for (k = 0; k < (int)settings->heads; k++) {
    head[k] = c->blind >> k & 1 ? R(0.0) : sample->head[k];
  }
  if (c->blind) {
    see = &settings->without[(ptrdiff_t)c->gone * axes * (ptrdiff_t)settings->heads];
  }
  ANHYST_NAME(lead)(c);
  ANHYST_NAME(multiply)(see, axes, (int)settings->heads, head, error);
  if (settings->axis) {
    ANHYST_NAME(go_along)(settings, sample->target, error);
  }
  for (k = 0; k < axes; k++) {
    error[k] = c->away[k] - error[k];
    plausible = plausible && error[k] <= settings->reach[k] && error[k] >= -settings->reach[k];
  }
  flags = ANHYST_NAME(obey)(c, sample->command, plausible, error);
  ANHYST_NAME(multiply)(settings->decouple, axes, axes, error, apart);
  for (k = 0; plausible && c->flight != ANHYST_AXES_REST && k < axes; k++) {
    c->asked[k] = ANHYST_NAME(anhyst_biquad_step)(&settings->pid[k], &c->state[k], apart[k]);
  }
  ANHYST_NAME(multiply)(settings->weigh, axes, axes, c->asked, wrench);
  for (k = 0; k < axes; k++) {
    wrench[k] += sample->forward[k];
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
    ANHYST_REAL wanted = R(0.0);
    if (c->flight != ANHYST_AXES_REST && !(c->share.lost >> i & 1)) {
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
    (void)ANHYST_NAME(anhyst_force_controller_commit)(drive, out->current[i], sample->gap[i]);
  }
}
