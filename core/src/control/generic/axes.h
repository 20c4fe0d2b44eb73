/* SPDX-License-Identifier: Apache-2.0 */

/* Template: the controller of a levitated body, for every number format. The operations that depend
   on the format are included before: axes_real.h for floating point, axes_fixed.c for q31. */

anhyst_status anhyst_axes_init_x(anhyst_axes_x *c, const anhyst_axes_settings_x *settings,
                                 anhyst_force_controller_x *const *drive)
{
  const anhyst_axes_x initial = {0};
  const uint16_t axes = settings->layout.axes;
  anhyst_wrench_x allocator;
  int valid =
      anhyst_wrench_init_x(&allocator, &settings->layout) == ANHYST_OK && settings->heads >= axes &&
      settings->heads <= ANHYST_AXES_HEADS &&
      are_rows_valid(settings->see, axes, settings->heads) &&
      are_rows_valid(settings->without, (uint16_t)(settings->heads * axes), settings->heads) &&
      are_rows_valid(settings->decouple, axes, axes) &&
      are_rows_valid(settings->weigh, axes, axes) && are_limits_valid(settings) &&
      settings->follow >= 0 && settings->slew >= 0 && settings->off >= 0 &&
      settings->off_ticks > 0U && settings->jump >= 0 && settings->doubt > 0U;
  int i;
  for (i = 0; valid && i < (int)axes; i++) {
    valid = are_axis_limits_valid(settings, i) && check_pid(&settings->pid[i]) == ANHYST_OK;
  }
  if (!valid) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = initial;
  c->settings = settings;
  c->drive = drive;
  c->allocator = allocator;
  return ANHYST_OK;
}

/* Returns how far a measured current is outside of the range between the slowest expected current
   and the commanded current. Advances the expected current by one tick. */
static ANHYST_REAL current_deviation(anhyst_axes_x *c, int i, ANHYST_REAL measured)
{
  const ANHYST_REAL slew = c->settings->slew;
  const ANHYST_REAL command = c->commanded_current[i];
  const ANHYST_REAL step =
      times_fraction(anhyst_sub_x(command, c->expected_current[i]), c->settings->follow);
  const ANHYST_REAL limited_step = step > slew ? slew : step < -slew ? -slew : step;
  ANHYST_REAL low;
  ANHYST_REAL high;
  c->expected_current[i] = anhyst_add_x(c->expected_current[i], limited_step);
  low = command < c->expected_current[i] ? command : c->expected_current[i];
  high = command < c->expected_current[i] ? c->expected_current[i] : command;
  if (measured < low) {
    return anhyst_sub_x(low, measured);
  }
  return measured > high ? anhyst_sub_x(measured, high) : 0;
}

/* Starts a landing, or switches all drives off if the body cannot land. */
static void start_landing(anhyst_axes_x *c, int can_land)
{
  if (!can_land) {
    c->flight_state = ANHYST_AXES_REST;
  } else if (c->flight_state == ANHYST_AXES_FLY || c->flight_state == ANHYST_AXES_LIFT) {
    c->flight_state = ANHYST_AXES_LAND;
    c->landing_ticks = 0;
  }
}

/* Detects failed drives, and starts a landing if necessary. */
static void detect_lost_drives(anhyst_axes_x *c, const anhyst_axes_sample_x *sample)
{
  const anhyst_axes_settings_x *settings = c->settings;
  int i;
  for (i = 0; settings->off > 0 && i < (int)settings->layout.drives; i++) {
    const uint16_t bit = (uint16_t)(1U << i);
    const ANHYST_REAL deviation = current_deviation(c, i, sample->current[i]);
    const int is_current_measured = is_measurement_present(sample->current[i]);
    if ((c->allocator.lost & bit) || (is_current_measured && deviation <= settings->off)) {
      c->deviating_ticks[i] = 0;
    } else if (is_current_measured) {
      c->deviating_ticks[i]++;
    }
    if (c->deviating_ticks[i] >= settings->off_ticks) {
      if (c->flight_state == ANHYST_AXES_LIFT || c->allocator.lost || !(settings->spare & bit)) {
        start_landing(c, 1);
      }
      anhyst_wrench_lose_x(&c->allocator, i);
    }
  }
}

/* Detects failed sensors, and may start a landing. Returns whether the other readings are valid. */
static int detect_lost_sensors(anhyst_axes_x *c, const ANHYST_REAL *head)
{
  const anhyst_axes_settings_x *settings = c->settings;
  int are_readings_valid = 1;
  int j;
  for (j = 0; settings->jump > 0 && j < (int)settings->heads; j++) {
    const uint16_t bit = (uint16_t)(1U << j);
    const int has_reading = c->valid_heads & bit;
    const ANHYST_REAL change = has_reading ? anhyst_sub_x(head[j], c->last_reading[j]) : 0;
    if (c->lost_heads & bit) {
      continue;
    }
    if (!is_number(head[j]) || change > settings->jump || change < -settings->jump) {
      c->doubt_count[j] += ANHYST_AXES_ODD;
      are_readings_valid = 0;
    } else if (has_reading && settings->noisy && !(change > 0) && !(change < 0)) {
      c->doubt_count[j]++;
    } else {
      c->doubt_count[j] = 0;
      c->valid_heads |= bit;
      c->last_reading[j] = head[j];
    }
    if (c->doubt_count[j] >= settings->doubt) {
      start_landing(c, !c->lost_heads && settings->spare_heads >> j & 1);
      c->lost_heads |= bit;
      c->last_lost_head = (uint16_t)j;
    }
  }
  return are_readings_valid;
}

/* Moves the reference relative to the target in LAND and LIFT. Resets the PIDs in state REST. */
static void move_reference(anhyst_axes_x *c)
{
  const anhyst_axes_settings_x *settings = c->settings;
  const anhyst_axis_pid_state_x rest_state = {0};
  int is_moving = 0;
  int k;
  if ((c->flight_state == ANHYST_AXES_LAND) && (c->landing_ticks++ >= settings->land_ticks)) {
    c->flight_state = ANHYST_AXES_REST;
  }
  for (k = 0; k < (int)settings->layout.axes; k++) {
    const ANHYST_REAL lift = settings->lift[k];
    if (c->flight_state == ANHYST_AXES_LAND) {
      c->reference_offset[k] = anhyst_add_x(c->reference_offset[k], settings->land[k]);
    } else if (c->flight_state == ANHYST_AXES_LIFT &&
               (c->reference_offset[k] > lift || c->reference_offset[k] < -lift)) {
      c->reference_offset[k] =
          anhyst_add_x(c->reference_offset[k], c->reference_offset[k] > lift ? -lift : lift);
      is_moving = 1;
    } else {
      c->reference_offset[k] = 0;
    }
    if (c->flight_state == ANHYST_AXES_REST) {
      c->acceleration[k] = 0;
      c->pid_state[k] = rest_state;
    }
  }
  if ((c->flight_state == ANHYST_AXES_LIFT) && !is_moving) {
    c->flight_state = ANHYST_AXES_FLY;
  }
}

static uint16_t execute_command(anhyst_axes_x *c, uint16_t command, int is_plausible,
                                ANHYST_REAL *error)
{
  const int is_at_rest = c->flight_state == ANHYST_AXES_REST;
  uint16_t flags = 0;
  int k;
  if (command == ANHYST_COMMAND_IDLE) {
    c->flight_state = ANHYST_AXES_REST;
  } else if (command == ANHYST_COMMAND_LAND && !is_at_rest && c->flight_state != ANHYST_AXES_LAND) {
    start_landing(c, 1);
  } else if (command == ANHYST_COMMAND_LIFT && is_at_rest && is_plausible && !c->allocator.lost &&
             !c->lost_heads) {
    c->flight_state = ANHYST_AXES_LIFT;
    for (k = 0; k < (int)c->settings->layout.axes; k++) {
      c->reference_offset[k] = -error[k];
      error[k] = 0;
    }
  } else if (command != ANHYST_COMMAND_NONE) {
    flags = ANHYST_COMMAND_REFUSED;
  }
  return flags;
}

/* Computes the wrench for the pose errors and the feedforward. Returns flags. */
static uint16_t compute_wrench(anhyst_axes_x *c, const anhyst_axes_sample_x *sample,
                               ANHYST_REAL *wrench)
{
  const anhyst_axes_settings_x *settings = c->settings;
  const int axes = (int)settings->layout.axes;
  ANHYST_REAL error[ANHYST_WRENCH_AXES];
  ANHYST_REAL decoupled[ANHYST_WRENCH_AXES];
  ANHYST_REAL head[ANHYST_AXES_HEADS];
  anhyst_rows_x see = settings->see;
  int is_plausible = detect_lost_sensors(c, sample->head);
  uint16_t flags;
  int k;
  for (k = 0; k < (int)settings->heads; k++) {
    head[k] = c->lost_heads >> k & 1 ? 0 : sample->head[k];
    is_plausible = is_plausible && is_number(head[k]);
  }
  if (c->lost_heads) {
    see = matrix_from_row(settings->without, (int)c->last_lost_head * axes, (int)settings->heads);
  }
  move_reference(c);
  measure_pose(settings, see, head, sample->target, error);
  for (k = 0; k < axes; k++) {
    error[k] = anhyst_sub_x(c->reference_offset[k], error[k]);
    is_plausible =
        is_plausible && error[k] <= settings->reach[k] && error[k] >= -settings->reach[k];
  }
  flags = execute_command(c, sample->command, is_plausible, error);
  multiply_matrix(settings->decouple, axes, axes, error, decoupled);
  for (k = 0; is_plausible && c->flight_state != ANHYST_AXES_REST && k < axes; k++) {
    c->acceleration[k] = step_pid(&settings->pid[k], &c->pid_state[k], decoupled[k]);
  }
  multiply_matrix(settings->weigh, axes, axes, c->acceleration, wrench);
  for (k = 0; k < axes; k++) {
    wrench[k] = anhyst_add_x(wrench[k], sample->forward[k]);
  }
  return is_plausible ? flags : flags | ANHYST_SAMPLE_IMPLAUSIBLE;
}

void anhyst_axes_tick_x(anhyst_axes_x *c, const anhyst_axes_sample_x *sample,
                        anhyst_axes_answer_x *out)
{
  const anhyst_axes_settings_x *settings = c->settings;
  ANHYST_REAL force[ANHYST_WRENCH_DRIVES];
  int i;
  detect_lost_drives(c, sample);
  out->flags = compute_wrench(c, sample, out->demand);
  out->lost = c->allocator.lost | (uint32_t)c->lost_heads << 16;
  out->state = c->flight_state;
  if (c->flight_state != ANHYST_AXES_REST &&
      !anhyst_wrench_share_x(&c->allocator, out->demand, force)) {
    out->flags |= ANHYST_DEMAND_LIMITED;
  }
  for (i = 0; i < (int)settings->layout.drives; i++) {
    anhyst_force_controller_x *drive = c->drive[i];
    const int is_lost = (c->allocator.lost & ((uint32_t)1 << i)) != 0U;
    ANHYST_REAL current = 0;
    if (c->flight_state != ANHYST_AXES_REST && !is_lost) {
      current = anhyst_force_controller_solve_x(drive, force[i], sample->gap[i], sample->flux[i]);
      out->flags |= drive->flags;
    }
    if (current < settings->current_low || current > settings->current_high) {
      out->flags |= ANHYST_CURRENT_LIMITED;
    }
    out->current[i] =
        round_to_grid(clamp(current, settings->current_low, settings->current_high),
                      settings->current_low, settings->current_high, settings->current_step);
    c->commanded_current[i] = out->current[i];
    if (!is_lost) { /* a failed drive needs no commit */
      (void)anhyst_force_controller_commit_x(drive, out->current[i], sample->gap[i]);
    }
  }
}
