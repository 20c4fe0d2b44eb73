/* SPDX-License-Identifier: Apache-2.0 */
#include "app/control.h"

#include <stddef.h>

static void enter_selftest(app_control *control, app_sensors *sensors)
{
  control->state = LINK_STATE_SELFTEST;
  control->fault = LINK_FAULT_NONE;
  control->passed = 0;
  control->doubtful = 0;
  app_sensor_start(&sensors->gap);
  app_sensor_start(&sensors->force);
  app_sensor_start(&sensors->current);
}

static void enter_fault(app_control *control, uint16_t fault)
{
  if (control->state != LINK_STATE_FAULT) {
    control->state = LINK_STATE_FAULT;
    control->fault = fault;
    control->step = -1;
    control->flags &= (uint16_t)~LINK_FLAG_KNOWN;
  }
}

/* Ticks of the ramp from full current to zero, at least 1. */
static uint32_t ramp_ticks(const app_board *board)
{
  const uint32_t ticks = app_board_ticks(board, board->limits->ramp_ms);
  return ticks > 0U ? ticks : 1U;
}

void app_control_start(app_control *control, app_sensors *sensors, const app_board *board)
{
  control->target = 0;
  control->demand = 0;
  control->drive = 0;
  control->step = -1;
  control->tick = 0;
  control->silent = 0;
  control->flags = LINK_FLAG_CURRENT_ZERO;
  control->missed = 0;
  control->swapped = 0;
  control->ramp = anhyst_add_q31(ANHYST_Q31_MAX / (int32_t)ramp_ticks(board), 1);
  enter_selftest(control, sensors);
  control->state = LINK_STATE_INIT;
  if (anhyst_compensator_init(&control->compensator, board->kernel, board->words,
                              board->words_capacity) != ANHYST_OK ||
      anhyst_block_misfit(board->words, board->scales) != 0U) {
    control->compensator.words = NULL;
  }
}

/* Follows the tick's number: ticks since the last one, 1 as a rule. */
static uint32_t follow_tick(app_control *control, const app_limits *limits, uint32_t tick)
{
  uint32_t ticks = tick - control->tick;
  control->tick = tick;
  if (control->state == LINK_STATE_INIT) {
    return 1; /* where a board begins to count is its own affair */
  }
  if (ticks == 0U || ticks > (uint32_t)limits->missed_ticks + 1U) {
    enter_fault(control, LINK_FAULT_MISSED_TICK);
  }
  if (ticks == 0U) {
    ticks = 1U;
  }
  control->missed = (uint16_t)(control->missed + (ticks - 1U));
  return ticks;
}

/* The reason of a fault that this sample would be, or none. All sensors are judged, so that each
   follows its own noise; the first that is wrong is told. Without a sample all values are
   PORT_RESERVED. */
static uint16_t judge(const app_control *control, app_sensors *sensors, const app_limits *limits,
                      const port_sample *sample, uint32_t ticks)
{
  const int32_t least = limits->stuck_current;
  const int32_t drive = control->drive;
  const uint16_t gap =
      app_sensor_judge(&sensors->gap, &limits->gap, least, sample->gap, ticks, drive);
  const uint16_t force =
      app_sensor_judge(&sensors->force, &limits->force, least, sample->force, ticks, drive);
  const uint16_t current = app_sensor_judge(&sensors->current, &limits->current, least,
                                            sample->current[0], ticks, drive);
  if ((sample->status & PORT_NO_SAMPLE) != 0U) {
    return LINK_FAULT_SENSOR_FAILED;
  }
  if (gap != APP_SENSOR_FINE) {
    return (uint16_t)(LINK_FAULT_GAP_RESERVED - APP_SENSOR_RESERVED + gap);
  }
  if (force != APP_SENSOR_FINE) {
    return (uint16_t)(LINK_FAULT_FORCE_RESERVED - APP_SENSOR_RESERVED + force);
  }
  if (current != APP_SENSOR_FINE) {
    return (uint16_t)(LINK_FAULT_CURRENT_RESERVED - APP_SENSOR_RESERVED + current);
  }
  return LINK_FAULT_NONE;
}

static int is_stuck(uint16_t fault)
{
  return fault == LINK_FAULT_GAP_STUCK || fault == LINK_FAULT_FORCE_STUCK ||
         fault == LINK_FAULT_CURRENT_STUCK;
}

/* The reason of the fault that the hardware reports, or none: the first of these. */
static uint16_t reported(uint32_t status)
{
  static const struct {
    uint16_t bit;
    uint16_t fault;
  } faults[] = {
      {PORT_EMERGENCY_STOP, LINK_FAULT_EMERGENCY_STOP},
      {PORT_OVER_CURRENT, LINK_FAULT_OVER_CURRENT},
      {PORT_AMPLIFIER, LINK_FAULT_AMPLIFIER},
      {PORT_SUPPLY, LINK_FAULT_SUPPLY},
      {PORT_TOO_WARM, LINK_FAULT_TOO_WARM},
  };
  for (size_t i = 0; i < sizeof faults / sizeof faults[0]; i++) {
    if ((status & faults[i].bit) != 0U) {
      return faults[i].fault;
    }
  }
  return LINK_FAULT_NONE;
}

/* Goes by the sample: to a fault, or on from init and selftest. */
static void watch_sample(app_control *control, app_sensors *sensors, const app_limits *limits,
                         const port_sample *sample, uint32_t ticks)
{
  const uint16_t wrong = judge(control, sensors, limits, sample, ticks);
  if (wrong != LINK_FAULT_NONE) {
    control->flags |= LINK_FLAG_SAMPLE_DOUBTFUL;
    control->passed = 0;
    if (control->doubtful < UINT16_MAX) {
      control->doubtful++;
    }
    if (control->doubtful > limits->doubtful_ticks || is_stuck(wrong)) {
      enter_fault(control, wrong);
    }
    return;
  }
  control->flags &= (uint16_t)~LINK_FLAG_SAMPLE_DOUBTFUL;
  control->doubtful = 0;
  if (control->state == LINK_STATE_SELFTEST) {
    control->passed++;
    if (control->passed >= limits->selftest_ticks) {
      control->state = LINK_STATE_IDLE;
    }
  }
}

/* Whether current may flow. */
static int is_live(const app_control *control)
{
  return control->state == LINK_STATE_RUN || control->step >= 0;
}

/* A measured q30 as a q31; beyond full scale it saturates. */
static int32_t full_scale(int32_t value) { return anhyst_shl_q31(value, 1); }

/* demand*ratio of q31 and q30, as a q31; rounded downwards to the 16 upper bits of the ratio,
   error below 2^-15 of the demand; saturates. */
static int32_t constant_ratio(int32_t demand, int32_t ratio)
{
  return anhyst_shl_q31(anhyst_scale(demand, (int16_t)(ratio >> 16)), 2);
}

/* The current for the demand at this gap, the demand having moved on by at most its slew. */
static int32_t force_current(app_control *control, const int32_t *settings, int32_t gap)
{
  const int32_t slew = settings[LINK_SETTING_DEMAND_SLEW];
  control->demand = anhyst_clamp(control->target, anhyst_sub_q31(control->demand, slew),
                                 anhyst_add_q31(control->demand, slew));
  if (control->demand != control->target) {
    control->flags |= LINK_FLAG_DEMAND_SLEWING;
  }
  if (settings[LINK_SETTING_COMPENSATION] == 0) {
    return constant_ratio(control->demand, settings[LINK_SETTING_RATIO]);
  }
  const int32_t current = anhyst_compensator_solve_q31(&control->compensator, control->demand, gap);
  control->flags |= control->compensator.flags;
  return current;
}

/* The next current of the conditioning sequence; after its last one the state is ready. */
static int32_t conditioning_current(app_control *control)
{
  const int32_t current = anhyst_conditioning_q31(&control->compensator, control->step);
  control->step++;
  if (control->step >= anhyst_conditioning_length(&control->compensator)) {
    control->step = -1;
    control->state = LINK_STATE_READY;
    control->flags |= LINK_FLAG_KNOWN;
  }
  return current;
}

/* A step along the ramp from the current driven towards another. */
static int32_t ramp_to(const app_control *control, int32_t current)
{
  return anhyst_clamp(current, anhyst_sub_q31(control->drive, control->ramp),
                      anhyst_add_q31(control->drive, control->ramp));
}

/* The current of a state in which it may flow, or a step towards it as long as it has not been
   reached since a block was swapped. */
static int32_t after_swap(app_control *control, int32_t current)
{
  if (control->swapped == 0U) {
    return current;
  }
  const int32_t step = ramp_to(control, current);
  control->swapped = step != current ? 1U : 0U;
  return step;
}

/* The current that this state asks for, before the limits of the board. */
static int32_t wanted_current(app_control *control, const int32_t *settings, int32_t gap)
{
  if (control->state == LINK_STATE_RUN) {
    return after_swap(control, force_current(control, settings, gap));
  }
  if (control->step >= 0) {
    return after_swap(control, conditioning_current(control));
  }
  control->swapped = 0;
  return ramp_to(control, 0);
}

void app_control_swap(app_control *control, const int16_t *words)
{
  anhyst_compensator_swap(&control->compensator, words);
  control->swapped = 1;
  if (control->step > 0) {
    control->step = 0;
  }
}

int32_t app_control_tick(app_control *control, app_sensors *sensors, const app_board *board,
                         const int32_t *settings, const port_sample *sample)
{
  const app_limits *limits = board->limits;
  const uint16_t lasting = LINK_FLAG_KNOWN | LINK_FLAG_SAMPLE_DOUBTFUL;
  const uint32_t ticks = follow_tick(control, limits, sample->tick);
  if (control->state == LINK_STATE_INIT) {
    control->state = LINK_STATE_SELFTEST;
    if (control->compensator.words == NULL) {
      enter_fault(control, LINK_FAULT_BLOCK);
    }
  }
  control->flags &= lasting;
  const uint16_t outside = reported(sample->status);
  if (outside != LINK_FAULT_NONE) {
    enter_fault(control, outside);
  }
  watch_sample(control, sensors, limits, sample, ticks);
  control->silent = control->silent > UINT32_MAX - ticks ? UINT32_MAX : control->silent + ticks;
  if (is_live(control) && control->silent > (uint32_t)settings[LINK_SETTING_HEARTBEAT_TICKS]) {
    enter_fault(control, LINK_FAULT_LINK_LOST);
  }
  if (control->step >= 0) {
    control->flags |= LINK_FLAG_CONDITIONING;
  }
  const int32_t gap = full_scale(anhyst_clamp(sensors->gap.value, 0, PORT_ONE));
  const int follow = settings[LINK_SETTING_FOLLOW] != 0;
  anhyst_compensator *compensator = &control->compensator;
  if (follow && compensator->words != NULL) {
    anhyst_compensator_commit_q31(compensator, full_scale(sensors->current.value), gap);
  }
  const int32_t wanted = wanted_current(control, settings, gap);
  control->drive = anhyst_clamp(wanted, limits->current_low, limits->current_high);
  if (!follow && compensator->words != NULL) {
    anhyst_compensator_commit_q31(compensator, control->drive, gap);
  }
  if (control->drive != wanted) {
    control->flags |= LINK_FLAG_CURRENT_LIMITED;
  }
  if (control->drive == 0) {
    control->flags |= LINK_FLAG_CURRENT_ZERO;
  }
  return control->drive;
}

/* Why a command cannot be done now, or none. */
static uint16_t obstacle(const app_control *control, uint16_t command)
{
  const int resting = control->state == LINK_STATE_IDLE && control->step < 0;
  int allowed = 0;
  int at_zero = 1; /* or the current has to be zero */
  switch (command) {
  case LINK_COMMAND_IDLE:
    allowed = control->state >= LINK_STATE_IDLE && control->state <= LINK_STATE_RUN;
    break;
  case LINK_COMMAND_CONDITION:
  case LINK_COMMAND_DEMAGNETISED:
    allowed = resting;
    at_zero = control->drive == 0;
    break;
  case LINK_COMMAND_ARM:
    allowed = resting;
    break;
  case LINK_COMMAND_RUN:
    /* A run begins with the current of a demand of zero: from a current on its ramp that is a jump.
     */
    allowed = control->state == LINK_STATE_READY;
    at_zero = control->drive == 0;
    break;
  case LINK_COMMAND_STOP:
    allowed = control->state == LINK_STATE_RUN;
    break;
  case LINK_COMMAND_CLEAR:
    if (control->compensator.words == NULL) {
      return LINK_REASON_BLOCK;
    }
    allowed = control->state == LINK_STATE_FAULT;
    at_zero = control->drive == 0;
    break;
  default:
    return LINK_REASON_VALUE;
  }
  if (!allowed) {
    return LINK_REASON_STATE;
  }
  return at_zero ? LINK_REASON_NONE : LINK_REASON_CURRENT;
}

uint16_t app_control_command(app_control *control, app_sensors *sensors, uint16_t command)
{
  const anhyst_memory demagnetised = {0, 0, 0, 0, 0};
  const uint16_t reason = obstacle(control, command);
  if (reason != LINK_REASON_NONE) {
    return reason;
  }
  switch (command) {
  case LINK_COMMAND_IDLE:
    control->state = LINK_STATE_IDLE;
    control->step = -1;
    break;
  case LINK_COMMAND_CONDITION:
    control->flags &= (uint16_t)~LINK_FLAG_KNOWN;
    control->flags |= LINK_FLAG_CONDITIONING;
    control->step = 0;
    break;
  case LINK_COMMAND_ARM:
    control->state = LINK_STATE_READY;
    control->flags |= LINK_FLAG_KNOWN;
    break;
  case LINK_COMMAND_RUN:
    control->target = 0;
    control->demand = 0;
    control->state = LINK_STATE_RUN;
    break;
  case LINK_COMMAND_STOP:
    control->state = LINK_STATE_READY;
    break;
  case LINK_COMMAND_CLEAR:
    enter_selftest(control, sensors);
    break;
  default: /* demagnetised, the only one left */
    control->compensator.memory = demagnetised;
    control->compensator.solved = 0;
    break;
  }
  return LINK_REASON_NONE;
}
