/* SPDX-License-Identifier: Apache-2.0 */
#include "position/position.h"

#include <stddef.h>

typedef char
    position_has_as_many_currents_as_the_port[ANHYST_POSITION_MAGNETS == PORT_CURRENTS ? 1 : -1];

static void reset_sensors(app_body *body)
{
  body->still.code = PORT_RESERVED;
  body->still.ticks = 0;
  for (int i = 0; i < PORT_CURRENTS; i++) {
    app_current_start(&body->current[i]);
  }
}

void app_body_start(app_body *body, const app_board *board)
{
  const app_plan *plan = board->plan;
  const anhyst_position_answer_q31 no_output = {{0, 0}, 0, 0, 0, 0};
  body->board = board;
  body->target = 0;
  body->answer = no_output;
  reset_sensors(body);
  for (uint16_t i = 0; i < plan->magnets; i++) {
    anhyst_force_controller_q31 *magnet = &body->magnet[i];
    magnet->method = &anhyst_force_by_compensator_q31;
    if (anhyst_force_controller_init_compensator_q31(magnet, board->kernel, board->words,
                                                     board->words_capacity) != ANHYST_OK ||
        anhyst_block_misfit(board->words, board->scales) != 0U) {
      magnet->compensator.words = NULL;
    }
  }
  if (anhyst_position_init_q31(&body->position, plan->limits, plan->settings, &body->magnet[0],
                               plan->magnets == 2U ? &body->magnet[1] : NULL) != ANHYST_OK) {
    body->magnet[0].compensator.words = NULL;
  }
}

anhyst_supervisor *app_body_states(app_body *body) { return &body->position.levitation.supervisor; }

anhyst_compensator *app_body_compensator(app_body *body, uint16_t magnet)
{
  return magnet < body->board->plan->magnets ? &body->magnet[magnet].compensator : NULL;
}

uint16_t app_body_command(app_body *body, uint16_t command)
{
  const uint16_t refusal = anhyst_position_command_q31(&body->position, command);
  if (refusal == ANHYST_REFUSED_NOT && command == ANHYST_COMMAND_CLEAR) {
    reset_sensors(body);
  }
  return refusal;
}

/* A landing needs amplifiers that follow their commands: one magnet of a pair alone would pull the
   armature to its side. If a current differs from the driven current, the sensor or the amplifier
   may be faulty. The code assumes the worse case, the amplifier. */
void app_body_fail(app_body *body, uint16_t reason)
{
  anhyst_levitation_fail(&body->position.levitation, reason,
                         reason != ANHYST_FAULT_AMPLIFIER && reason != ANHYST_FAULT_OVER_CURRENT &&
                             reason != ANHYST_FAULT_CURRENT_MISMATCH &&
                             reason != ANHYST_FAULT_BLOCK);
}

uint16_t app_body_set_reference(app_body *body, uint16_t quantity, int32_t value)
{
  const anhyst_levitation_limits *limits = &body->board->plan->limits->levitation;
  if (quantity != (uint16_t)LINK_BODY_POSITION) {
    return LINK_REASON_TYPE;
  }
  if (value < limits->low || value > limits->high) {
    return LINK_REASON_VALUE;
  }
  body->target = value;
  return LINK_REASON_NONE;
}

int32_t app_body_goal(const app_body *body) { return body->target; }

void app_body_swap(app_body *body, const int16_t *words)
{
  anhyst_position_swap_q31(&body->position, words);
}

/* Returns share*factor for a q30 share >= 0, rounded to the nearest 16-bit mantissa. */
static anhyst_factor scale_factor(anhyst_factor factor, int32_t share)
{
  const int32_t product = anhyst_scale(share, factor.mantissa); /* q30, magnitude at most 2^30 */
  const int32_t mantissa = (product + 8192) >> 14;
  anhyst_factor scaled = factor;
  if (mantissa >= INT16_MIN && mantissa <= INT16_MAX) {
    scaled.mantissa = (int16_t)mantissa;
  } else {
    scaled.mantissa = (int16_t)((product + 16384) >> 15);
    scaled.shift++;
  }
  return scaled;
}

/* Activates the built-in gains, or fractions of them, from the next tick on. */
static uint16_t apply_gains(app_body *body, const int32_t *settings, int use_tuned_gains)
{
  const anhyst_position_settings_q31 *built_in = body->board->plan->settings;
  anhyst_position_settings_q31 *to = &body->tuned[0];
  if (body->position.settings == to) {
    to = &body->tuned[1];
  }
  *to = *built_in;
  if (use_tuned_gains) {
    anhyst_pidd2_gains_q31 *gains = &to->gains;
    gains->proportional = scale_factor(gains->proportional, settings[LINK_SETTING_GAIN_P]);
    gains->integral = scale_factor(gains->integral, settings[LINK_SETTING_GAIN_I]);
    gains->derivative = scale_factor(gains->derivative, settings[LINK_SETTING_GAIN_D]);
    gains->second = scale_factor(gains->second, settings[LINK_SETTING_GAIN_DD]);
  }
  return anhyst_position_retune_q31(&body->position, to) == ANHYST_OK ? LINK_REASON_NONE
                                                                      : LINK_REASON_VALUE;
}

uint16_t app_body_setting(app_body *body, const int32_t *settings, uint16_t number, int32_t value)
{
  const int needs_block =
      number == (uint16_t)LINK_SETTING_COMPENSATION || number == (uint16_t)LINK_SETTING_GAINS;
  if (needs_block && body->magnet[0].compensator.words == NULL) {
    return LINK_REASON_BLOCK;
  }
  switch (number) {
  case LINK_SETTING_COMPENSATION:
    return anhyst_position_compensate_q31(&body->position, value != 0) == ANHYST_OK
               ? LINK_REASON_NONE
               : LINK_REASON_TYPE;
  case LINK_SETTING_GAINS:
    return apply_gains(body, settings, value != 0);
  default:
    return LINK_REASON_NONE;
  }
}

/* Enters the state FAULT if a measured current is implausible for too long or does not follow the
   driven current, because the true current is then unknown. */
static void check_currents(app_body *body, const int32_t *settings, const port_sample *sample,
                           uint32_t ticks)
{
  const app_limits *limits = body->board->limits;
  for (uint16_t i = 0; i < body->board->plan->magnets; i++) {
    const uint16_t fault = app_current_judge(&body->current[i], limits, settings,
                                             sample->current[i], ticks, body->answer.current[i]);
    if (body->current[i].sensor.missing_ticks > limits->max_implausible_samples ||
        app_current_is_immediate_fault(fault)) {
      app_body_fail(body, fault);
    }
  }
}

/* Whether the position keeps its code although demanded force and current both changed. The code of
   a levitated armature always changes then. A fine encoder may keep its code while nothing moves,
   while only the current of a solid core changes, or while only the demanded force changes (switch
   to another method). Near its rest the armature is not levitated and may stand still. */
static int is_stuck(app_body *body, const port_sample *sample, uint32_t ticks)
{
  const app_limits *limits = body->board->limits;
  const anhyst_levitation *l = &body->position.levitation;
  const int32_t detect = body->board->plan->settings->levitation.detect;
  app_stillness *still = &body->still;
  const int32_t demand = body->answer.demand;
  const int32_t drive = body->answer.current[0];
  if (!anhyst_levitation_controls(l) || anhyst_sub_q31(l->position, l->rest_position) < detect ||
      sample->position != still->code) {
    still->code = sample->position;
    still->demand = demand;
    still->drive = drive;
    still->ticks = 0;
    return 0;
  }
  const int32_t demand_change = anhyst_abs_q31(anhyst_sub_q31(demand, still->demand));
  const int32_t current_change = anhyst_abs_q31(anhyst_sub_q31(drive, still->drive));
  const int has_changed =
      (demand_change >= limits->stuck_demand) && (current_change >= limits->stuck_current);
  if (has_changed || still->ticks > 0U) {
    still->ticks += ticks;
  }
  return limits->still_ticks > 0U && still->ticks > limits->still_ticks;
}

uint16_t app_body_tick(app_body *body, const int32_t *settings, const port_sample *sample,
                       uint32_t ticks, int32_t *currents)
{
  anhyst_position_sample_q31 in;
  if ((sample->status & PORT_NO_SAMPLE) == 0U) {
    check_currents(body, settings, sample, ticks);
  }
  if (is_stuck(body, sample, ticks)) {
    anhyst_levitation_fail(&body->position.levitation, ANHYST_FAULT_POSITION_STUCK, 0);
  }
  in.position = sample->position;
  in.target = body->target;
  in.load = 0;
  in.dropped = sample->position == PORT_RESERVED ? 1U : 0U;
  in.command = ANHYST_COMMAND_NONE;
  for (int i = 0; i < PORT_CURRENTS; i++) {
    in.current[i] = app_sensor_q31(body->current[i].sensor.value);
    in.flux[i] = ANHYST_NO_FLUX;
  }
  if (body->magnet[0].compensator.words == NULL) {
    currents[0] = 0;
    currents[1] = 0;
    return 0;
  }
  anhyst_position_tick_q31(&body->position, &in, &body->answer);
  currents[0] = body->answer.current[0];
  currents[1] = body->answer.current[1];
  return body->answer.flags;
}

void app_body_status(const app_body *body, link_status *status)
{
  status->demand = body->answer.demand;
  status->phase = body->position.levitation.phase;
  status->position = body->position.position;
  status->reference = body->answer.reference;
  status->current[0] = body->current[0].sensor.value;
  status->drive[0] = body->answer.current[0];
  status->current[1] = body->current[1].sensor.value;
  status->drive[1] = body->answer.current[1];
}

void app_body_signals(const app_body *body, const port_sample *sample, int32_t *signals)
{
  signals[LINK_SIGNAL_DEMAND] = body->answer.demand;
  signals[LINK_SIGNAL_GAP] = body->position.gap[0] / 2; /* q30 */
  signals[LINK_SIGNAL_DRIVE] = body->answer.current[0];
  signals[LINK_SIGNAL_POSITION] = sample->position;
  signals[LINK_SIGNAL_REFERENCE] = body->answer.reference;
  signals[LINK_SIGNAL_PHASE] = body->position.levitation.phase;
  signals[LINK_SIGNAL_CURRENT_2] = sample->current[1];
  signals[LINK_SIGNAL_DRIVE_2] = body->answer.current[1];
}
