/* SPDX-License-Identifier: Apache-2.0 */
#include "force/force.h"

#include <stddef.h>

/* Resets the sensor checks: the next sample is checked for reserved code and range only. */
static void reset_sensors(app_body *body)
{
  app_sensor_start(&body->gap);
  app_sensor_start(&body->force);
  app_current_start(&body->current);
}

void app_body_start(app_body *body, const app_board *board)
{
  const uint32_t ramp_ticks = app_board_ticks(board, board->limits->ramp_ms);
  body->board = board;
  body->target = 0;
  body->demand = 0;
  body->drive = 0;
  body->flags = 0;
  body->is_ramping = 0;
  body->is_compensated = 1;
  body->ramp_step =
      anhyst_add_q31(ANHYST_Q31_MAX / (int32_t)(ramp_ticks > 0U ? ramp_ticks : 1U), 1);
  anhyst_supervisor_start(&body->supervisor);
  reset_sensors(body);
  if (anhyst_compensator_init(&body->compensator, board->kernel, board->words,
                              board->words_capacity) != ANHYST_OK ||
      anhyst_block_misfit(board->words, board->scales) != 0U) {
    body->compensator.words = NULL;
  }
}

anhyst_supervisor *app_body_states(app_body *body) { return &body->supervisor; }

anhyst_compensator *app_body_compensator(app_body *body, uint16_t magnet)
{
  return magnet == 0U ? &body->compensator : NULL;
}

void app_body_fail(app_body *body, uint16_t reason)
{
  anhyst_supervisor_fail(&body->supervisor, reason);
}

uint16_t app_body_set_reference(app_body *body, uint16_t quantity, int32_t value)
{
  if (quantity != (uint16_t)LINK_BODY_FORCE) {
    return LINK_REASON_TYPE;
  }
  body->target = value; /* the command `run` resets the demand to 0 */
  return LINK_REASON_NONE;
}

int32_t app_body_goal(const app_body *body) { return body->target; }

void app_body_swap(app_body *body, const int16_t *words)
{
  anhyst_compensator_swap(&body->compensator, words);
  body->is_ramping = 1;
  if (body->supervisor.conditioning != 0U) {
    body->supervisor.step = -1;
  }
}

uint16_t app_body_setting(app_body *body, const int32_t *settings, uint16_t number, int32_t value)
{
  (void)body;
  (void)settings;
  (void)value;
  const int is_gain =
      number >= (uint16_t)LINK_SETTING_GAINS && number <= (uint16_t)LINK_SETTING_GAIN_DD;
  return is_gain ? LINK_REASON_TYPE : LINK_REASON_NONE; /* gains belong to a position controller */
}

/* Returns the fault reason of this sample, or ANHYST_FAULT_NONE. All sensors are checked, because
   each check tracks its own noise; the first error is reported. */
static uint16_t find_fault(app_body *body, const int32_t *settings, const port_sample *sample,
                           uint32_t ticks)
{
  const app_limits *limits = body->board->limits;
  const int32_t stuck = limits->stuck_current;
  const int32_t drive = body->drive;
  const uint16_t gap = app_sensor_judge(&body->gap, &limits->gap, stuck, sample->gap, ticks, drive);
  const uint16_t force =
      app_sensor_judge(&body->force, &limits->force, stuck, sample->force, ticks, drive);
  const uint16_t current =
      app_current_judge(&body->current, limits, settings, sample->current[0], ticks, drive);
  if ((sample->status & PORT_NO_SAMPLE) != 0U) {
    return ANHYST_FAULT_SENSOR_FAILED;
  }
  if (gap != APP_SENSOR_FINE) {
    return (uint16_t)(ANHYST_FAULT_GAP_RESERVED - APP_SENSOR_RESERVED + gap);
  }
  if (force != APP_SENSOR_FINE) {
    return (uint16_t)(ANHYST_FAULT_FORCE_RESERVED - APP_SENSOR_RESERVED + force);
  }
  return current;
}

/* Checks the sample. Enters the state FAULT if necessary, or advances the self-test. */
static void check_sample(app_body *body, const int32_t *settings, const port_sample *sample,
                         uint32_t ticks)
{
  const app_limits *limits = body->board->limits;
  const uint16_t fault = find_fault(body, settings, sample, ticks);
  (void)anhyst_supervisor_sample(&body->supervisor, fault, limits->max_implausible_samples,
                                 limits->selftest_ticks);
  if (fault != ANHYST_FAULT_NONE) {
    body->flags |= ANHYST_SAMPLE_IMPLAUSIBLE;
  }
  if (fault == ANHYST_FAULT_GAP_STUCK || fault == ANHYST_FAULT_FORCE_STUCK ||
      app_current_is_immediate_fault(fault)) {
    anhyst_supervisor_fail(&body->supervisor, fault);
  }
}

/* Returns demand*ratio (q31 times q30) as q31, saturated. Only the upper 16 bits of the ratio
   count. Rounds down; the error is below 2^-15 of the demand. */
static int32_t multiply_by_ratio(int32_t demand, int32_t ratio)
{
  return anhyst_shl_q31(anhyst_scale(demand, (int16_t)(ratio >> 16)), 2);
}

static uint8_t is_compensated(const int32_t *settings)
{
  return (settings[LINK_SETTING_COMPENSATION] != 0) ? 1U : 0U;
}

/* Moves the demand by at most the slew limit and returns the current for it at this gap, q31. */
static int32_t force_current(app_body *body, const int32_t *settings, int32_t gap)
{
  const int32_t slew = settings[LINK_SETTING_DEMAND_SLEW];
  body->demand = anhyst_clamp(body->target, anhyst_sub_q31(body->demand, slew),
                              anhyst_add_q31(body->demand, slew));
  if (body->demand != body->target) {
    body->flags |= ANHYST_DEMAND_SLEWING;
  }
  const uint8_t compensated = is_compensated(settings);
  if (compensated != body->is_compensated) {
    body->is_compensated = compensated;
    body->is_ramping = 1;
  }
  if (compensated == 0U) {
    return multiply_by_ratio(body->demand, settings[LINK_SETTING_RATIO]);
  }
  const int32_t current = anhyst_compensator_solve_q31(&body->compensator, body->demand, gap);
  body->flags |= body->compensator.flags;
  return current;
}

/* Returns the driven current, moved by at most one ramp step towards another current. */
static int32_t ramp_towards(const app_body *body, int32_t current)
{
  return anhyst_clamp(current, anhyst_sub_q31(body->drive, body->ramp_step),
                      anhyst_add_q31(body->drive, body->ramp_step));
}

/* Ramps to the current after a change of block or method; later returns it unchanged. */
static int32_t ramp_after_swap(app_body *body, int32_t current)
{
  if (body->is_ramping == 0U) {
    return current;
  }
  const int32_t step = ramp_towards(body, current);
  body->is_ramping = step != current ? 1U : 0U;
  return step;
}

/* Returns the current that the state requires, before the limits of the board. */
static int32_t state_current(app_body *body, const int32_t *settings, int32_t gap)
{
  if (body->supervisor.state == ANHYST_STATE_RUN) {
    return ramp_after_swap(body, force_current(body, settings, gap));
  }
  if (body->supervisor.conditioning != 0U) {
    const int32_t length = anhyst_conditioning_length(&body->compensator);
    if (anhyst_supervisor_condition(&body->supervisor, length)) {
      return ramp_after_swap(body,
                             anhyst_conditioning_q31(&body->compensator, body->supervisor.step));
    }
  }
  body->is_ramping = 0;
  body->is_compensated = is_compensated(settings);
  return ramp_towards(body, 0);
}

uint16_t app_body_tick(app_body *body, const int32_t *settings, const port_sample *sample,
                       uint32_t ticks, int32_t *currents)
{
  const app_limits *limits = body->board->limits;
  anhyst_compensator *compensator = &body->compensator;
  const int follow = settings[LINK_SETTING_FOLLOW] != 0;
  body->flags = 0;
  check_sample(body, settings, sample, ticks);
  const int32_t gap = app_sensor_q31(anhyst_clamp(body->gap.value, 0, PORT_ONE));
  if (body->gap.value < 0 || body->gap.value > PORT_ONE) {
    body->flags |= ANHYST_GAP_LIMITED;
  }
  if (follow && compensator->words != NULL) {
    anhyst_compensator_commit_q31(compensator, app_sensor_q31(body->current.sensor.value), gap);
  }
  const int32_t required_current = state_current(body, settings, gap);
  body->drive = anhyst_clamp(required_current, limits->current_low, limits->current_high);
  if (!follow && compensator->words != NULL) {
    anhyst_compensator_commit_q31(compensator, body->drive, gap);
  }
  if (body->drive != required_current) {
    body->flags |= ANHYST_CURRENT_LIMITED;
  }
  currents[0] = body->drive;
  currents[1] = 0;
  return body->flags;
}

uint16_t app_body_command(app_body *body, uint16_t command)
{
  const anhyst_body self = {0U, 1U, body->drive == 0 ? 1U : 0U};
  const uint16_t refusal = anhyst_supervisor_obstacle(&body->supervisor, command, &self);
  if (refusal != ANHYST_REFUSED_NOT) {
    return refusal;
  }
  anhyst_supervisor_command(&body->supervisor, command, &self);
  switch (command) {
  case ANHYST_COMMAND_RUN:
    body->target = 0;
    body->demand = 0;
    break;
  case ANHYST_COMMAND_CLEAR:
    reset_sensors(body);
    break;
  case ANHYST_COMMAND_DEMAGNETISED:
    if (body->compensator.words != NULL) {
      anhyst_compensator_demagnetise(&body->compensator);
    }
    break;
  default:
    break;
  }
  return ANHYST_REFUSED_NOT;
}

void app_body_status(const app_body *body, link_status *status)
{
  status->demand = body->demand;
  status->force = body->force.value;
  status->gap = body->gap.value;
  status->current[0] = body->current.sensor.value;
  status->drive[0] = body->drive;
}

void app_body_signals(const app_body *body, const port_sample *sample, int32_t *signals)
{
  signals[LINK_SIGNAL_DEMAND] = body->demand;
  signals[LINK_SIGNAL_FORCE] = sample->force;
  signals[LINK_SIGNAL_GAP] = sample->gap;
  signals[LINK_SIGNAL_DRIVE] = body->drive;
}
