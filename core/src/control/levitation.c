/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/levitation.h"

anhyst_status anhyst_levitation_check(const anhyst_levitation_limits *limits,
                                      const anhyst_levitation_settings *settings)
{
  const int are_limits_valid =
      limits->low < limits->high && limits->step > 0 && limits->selftest > 0U;
  const int are_rates_valid = settings->detect > 0 && settings->rise > 0 && settings->descend > 0 &&
                              settings->lift > 0 && settings->set_down > 0 && settings->most > 0 &&
                              settings->press <= 0;
  return are_limits_valid && are_rates_valid ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

/* Resets phase and faults. The next position is only checked for its range. */
static void reset_phase(anhyst_levitation *l)
{
  l->phase = ANHYST_PHASE_REST;
  l->has_position = 0;
  l->is_return_ignored = 0;
  l->starts_fall = 0;
}

void anhyst_levitation_start(anhyst_levitation *levitation)
{
  anhyst_supervisor_start(&levitation->supervisor);
  reset_phase(levitation);
  levitation->position = 0;
  levitation->rest_position = 0;
  levitation->reference = 0;
  levitation->demand = 0;
  levitation->tick = 0;
  levitation->flags = 0;
  levitation->starts_control = 0;
}

static int32_t step_towards(int32_t from, int32_t to, int32_t step)
{
  return anhyst_clamp(to, anhyst_sub_q31(from, step), anhyst_add_q31(from, step));
}

/* Returns whether the change since the last plausible position is at most one step per tick. */
static int is_plausible(const anhyst_levitation *l, int32_t step, int32_t position)
{
  const int32_t ticks = (int32_t)l->supervisor.sample_age + 1;
  if (l->has_position == 0U || step > ANHYST_Q31_MAX / ticks) {
    return 1;
  }
  return anhyst_abs_q31(anhyst_sub_q31(position, l->position)) <= step * ticks;
}

static uint16_t find_fault(const anhyst_levitation *l, const anhyst_levitation_limits *limits,
                           const anhyst_levitation_input *input)
{
  if (input->dropped != 0U) {
    return ANHYST_FAULT_POSITION_MISSING;
  }
  if (input->position < limits->low || input->position > limits->high) {
    return ANHYST_FAULT_POSITION_RANGE;
  }
  return is_plausible(l, limits->step, input->position) ? ANHYST_FAULT_NONE
                                                        : ANHYST_FAULT_POSITION_STEP;
}

/* Starts a landing from any phase. Requires a known position. */
static void start_landing(anhyst_levitation *l)
{
  if (l->phase == ANHYST_PHASE_BREAKAWAY) {
    l->phase = ANHYST_PHASE_SET_DOWN;
  } else if (anhyst_levitation_controls(l)) {
    l->phase = ANHYST_PHASE_DESCEND;
  }
}

static void handle_lost_position(anhyst_levitation *l)
{
  if (anhyst_levitation_controls(l)) {
    l->phase = ANHYST_PHASE_FALL;
    l->tick = 0;
  } else if (l->phase == ANHYST_PHASE_BREAKAWAY) {
    l->phase = ANHYST_PHASE_SET_DOWN;
  }
}

/* Starts closed-loop control at the present position, with the present demand. */
static void start_control(anhyst_levitation *l, uint16_t phase)
{
  l->phase = phase;
  l->reference = l->position;
  l->starts_control = 1;
}

/* Processes a sample: may leave state SELFTEST, enter state FAULT, or leave phase FALL. */
static void process_sample(anhyst_levitation *l, const anhyst_levitation_limits *limits,
                           const anhyst_levitation_input *input)
{
  const uint16_t fault = find_fault(l, limits, input);
  if (anhyst_supervisor_sample(&l->supervisor, fault, limits->max_missing_samples,
                               limits->selftest)) {
    /* Otherwise, a position that jumped would count as plausible again after some ticks. */
    l->is_return_ignored |= fault == ANHYST_FAULT_POSITION_STEP ? 1U : 0U;
    handle_lost_position(l);
  }
  if (fault != ANHYST_FAULT_NONE) {
    l->flags |= ANHYST_SAMPLE_IMPLAUSIBLE;
    return;
  }
  l->position = input->position;
  l->has_position = 1;
  if (l->phase == ANHYST_PHASE_FALL && l->is_return_ignored == 0U) {
    start_control(l, ANHYST_PHASE_DESCEND);
  }
}

uint16_t anhyst_levitation_command(anhyst_levitation *levitation, uint16_t command,
                                   uint16_t at_zero)
{
  anhyst_levitation *l = levitation;
  const int is_resting = l->phase == ANHYST_PHASE_REST || l->phase == ANHYST_PHASE_CONDITION;
  const anhyst_body body = {1U, is_resting ? 1U : 0U, at_zero};
  const uint16_t reason = anhyst_supervisor_obstacle(&l->supervisor, command, &body);
  if (reason != ANHYST_REFUSED_NOT) {
    return reason;
  }
  anhyst_supervisor_command(&l->supervisor, command, &body);
  switch (command) {
  case ANHYST_COMMAND_LIFT:
    l->phase = ANHYST_PHASE_BREAKAWAY;
    l->demand = 0;
    l->tick = 0;
    break;
  case ANHYST_COMMAND_LAND:
  case ANHYST_COMMAND_STOP:
    start_landing(l);
    break;
  case ANHYST_COMMAND_CLEAR:
    reset_phase(l);
    break;
  default:
    break;
  }
  return ANHYST_REFUSED_NOT;
}

void anhyst_levitation_fail(anhyst_levitation *levitation, uint16_t reason, int lands)
{
  anhyst_supervisor_fail(&levitation->supervisor, reason);
  if (lands) {
    start_landing(levitation);
  } else {
    levitation->is_return_ignored = 1;
    handle_lost_position(levitation);
  }
}

static void run_breakaway(anhyst_levitation *l, const anhyst_levitation_settings *settings)
{
  if (l->tick == 0) { /* first tick after the command: the armature still rests */
    l->rest_position = l->position;
    l->tick = 1;
  }
  if (anhyst_sub_q31(l->position, l->rest_position) >= settings->detect) {
    start_control(l, ANHYST_PHASE_RISE);
  } else if (l->demand >= settings->most) {
    anhyst_supervisor_fail(&l->supervisor, ANHYST_FAULT_NO_LIFT);
    l->phase = ANHYST_PHASE_SET_DOWN;
  } else {
    l->demand = step_towards(l->demand, settings->most, settings->lift);
  }
}

static void run_set_down(anhyst_levitation *l, const anhyst_levitation_settings *settings)
{
  if (l->demand != settings->press) {
    l->demand = step_towards(l->demand, settings->press, settings->set_down);
    return;
  }
  l->phase = ANHYST_PHASE_REST;
  anhyst_supervisor_rest(&l->supervisor);
}

static void move_reference(anhyst_levitation *l, const anhyst_levitation_settings *settings,
                           int32_t target)
{
  switch (l->phase) {
  case ANHYST_PHASE_RISE:
    l->reference = step_towards(l->reference, target, settings->rise);
    if (l->reference == target) {
      l->phase = ANHYST_PHASE_HOVER;
    }
    break;
  case ANHYST_PHASE_DESCEND:
    if (l->reference == l->rest_position) {
      l->phase = ANHYST_PHASE_SET_DOWN;
    } else {
      l->reference = step_towards(l->reference, l->rest_position, settings->descend);
    }
    break;
  default: /* phase hover */
    l->reference = target;
    break;
  }
}

/* Executes one tick of the phase, and selects the next phase. */
static void advance_phase(anhyst_levitation *l, const anhyst_levitation_limits *limits,
                          const anhyst_levitation_settings *settings,
                          const anhyst_levitation_input *input)
{
  switch (l->phase) {
  case ANHYST_PHASE_BREAKAWAY:
    run_breakaway(l, settings);
    break;
  case ANHYST_PHASE_SET_DOWN:
    run_set_down(l, settings);
    break;
  case ANHYST_PHASE_FALL:
    l->starts_fall = l->tick == 0 ? 1U : 0U;
    l->tick++;
    if (l->tick > (int32_t)limits->hold) {
      l->phase = ANHYST_PHASE_REST;
    }
    break;
  case ANHYST_PHASE_REST:
  case ANHYST_PHASE_CONDITION:
    l->phase = anhyst_supervisor_condition(&l->supervisor, input->conditioning)
                   ? ANHYST_PHASE_CONDITION
                   : ANHYST_PHASE_REST;
    break;
  default:
    /* The first reference is the position itself, so that control starts without a jump. */
    if (l->starts_control == 0U) {
      move_reference(l, settings, anhyst_clamp(input->target, limits->low, limits->high));
    }
    break;
  }
}

void anhyst_levitation_tick(anhyst_levitation *levitation, const anhyst_levitation_limits *limits,
                            const anhyst_levitation_settings *settings,
                            const anhyst_levitation_input *input)
{
  levitation->flags = 0;
  levitation->starts_control = 0;
  levitation->starts_fall = 0;
  if (anhyst_levitation_controls(levitation)) {
    levitation->demand = input->demand;
  }
  anhyst_supervisor_begin(&levitation->supervisor);
  process_sample(levitation, limits, input);
  advance_phase(levitation, limits, settings, input);
}
