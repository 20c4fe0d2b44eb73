/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/levitation.h"

anhyst_status anhyst_levitation_check(const anhyst_levitation_limits *limits,
                                      const anhyst_levitation_settings *settings)
{
  const int range = limits->low < limits->high && limits->step > 0 && limits->selftest > 0U;
  const int rates = settings->detect > 0 && settings->rise > 0 && settings->descend > 0 &&
                    settings->lift > 0 && settings->set_down > 0 && settings->most > 0 &&
                    settings->press <= 0;
  return range && rates ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

static void enter_selftest(anhyst_levitation *l)
{
  l->state = ANHYST_LEVITATION_SELFTEST;
  l->phase = ANHYST_PHASE_REST;
  l->fault = ANHYST_FAULT_NONE;
  l->age = 0;
  l->passed = 0;
  l->known = 0;
}

void anhyst_levitation_start(anhyst_levitation *levitation)
{
  enter_selftest(levitation);
  levitation->state = ANHYST_LEVITATION_INIT;
  levitation->position = 0;
  levitation->rest = 0;
  levitation->reference = 0;
  levitation->demand = 0;
  levitation->tick = 0;
  levitation->flags = 0;
  levitation->begins = 0;
  levitation->demagnetise = 0;
}

/* A step from one number towards another. */
static int32_t towards(int32_t from, int32_t to, int32_t step)
{
  return anhyst_clamp(to, anhyst_sub_q31(from, step), anhyst_add_q31(from, step));
}

/* Whether the change since the last plausible position can be: one step for each tick in between.
 */
static int is_reachable(const anhyst_levitation *l, int32_t step, int32_t position)
{
  const int32_t ticks = (int32_t)l->age + 1;
  if (l->known == 0U || step > ANHYST_Q31_MAX / ticks) {
    return 1;
  }
  return anhyst_abs_q31(anhyst_sub_q31(position, l->position)) <= step * ticks;
}

/* The reason of a fault that this sample would be, or none. */
static uint16_t judge(const anhyst_levitation *l, const anhyst_levitation_limits *limits,
                      const anhyst_levitation_input *input)
{
  if (input->dropped != 0U) {
    return ANHYST_FAULT_POSITION_MISSING;
  }
  if (input->position < limits->low || input->position > limits->high) {
    return ANHYST_FAULT_POSITION_RANGE;
  }
  return is_reachable(l, limits->step, input->position) ? ANHYST_FAULT_NONE
                                                        : ANHYST_FAULT_POSITION_STEP;
}

static void enter_fault(anhyst_levitation *l, uint16_t reason)
{
  if (l->state != ANHYST_LEVITATION_FAULT) {
    l->state = ANHYST_LEVITATION_FAULT;
    l->fault = reason;
  }
}

/* Comes down from wherever it is; the position is known. */
static void come_down(anhyst_levitation *l)
{
  if (l->phase == ANHYST_PHASE_BREAKAWAY) {
    l->phase = ANHYST_PHASE_SET_DOWN;
  } else if (anhyst_levitation_controls(l)) {
    l->phase = ANHYST_PHASE_DESCEND;
  }
}

static void lose_position(anhyst_levitation *l)
{
  if (anhyst_levitation_controls(l)) {
    l->phase = ANHYST_PHASE_HOLD;
    l->tick = 0;
  } else if (l->phase == ANHYST_PHASE_BREAKAWAY) {
    l->phase = ANHYST_PHASE_SET_DOWN;
  } else if (l->phase == ANHYST_PHASE_CONDITION) {
    l->phase = ANHYST_PHASE_REST;
  }
}

/* Begins to control from here, with the demand there was. */
static void begin(anhyst_levitation *l, uint16_t phase)
{
  l->phase = phase;
  l->reference = l->position;
  l->begins = 1;
}

/* Goes by the sample: on from selftest, to a fault, or back from a hold. */
static void watch(anhyst_levitation *l, const anhyst_levitation_limits *limits,
                  const anhyst_levitation_input *input)
{
  const uint16_t wrong = judge(l, limits, input);
  if (wrong != ANHYST_FAULT_NONE) {
    l->flags |= ANHYST_SAMPLE_DOUBTFUL;
    l->passed = 0;
    if (l->age < UINT16_MAX) {
      l->age++;
    }
    if (l->age > limits->patience) {
      enter_fault(l, wrong);
      lose_position(l);
    }
    return;
  }
  l->position = input->position;
  l->age = 0;
  l->known = 1;
  if (l->state == ANHYST_LEVITATION_SELFTEST) {
    l->passed++;
    l->state = l->passed >= limits->selftest ? ANHYST_LEVITATION_IDLE : ANHYST_LEVITATION_SELFTEST;
  }
  if (l->phase == ANHYST_PHASE_HOLD) {
    begin(l, ANHYST_PHASE_DESCEND);
  }
}

/* Whether a command can be done now. */
static int is_allowed(const anhyst_levitation *l, const anhyst_levitation_input *input)
{
  const int resting = l->phase == ANHYST_PHASE_REST && input->at_zero != 0U;
  switch (input->command) {
  case ANHYST_COMMAND_NONE:
    return 1;
  case ANHYST_COMMAND_CONDITION:
  case ANHYST_COMMAND_DEMAGNETISED:
    return resting && (l->state == ANHYST_LEVITATION_IDLE || l->state == ANHYST_LEVITATION_READY);
  case ANHYST_COMMAND_LIFT:
    return l->state == ANHYST_LEVITATION_READY && l->age == 0U;
  case ANHYST_COMMAND_LAND:
    return l->state == ANHYST_LEVITATION_RUN;
  case ANHYST_COMMAND_STOP:
    return l->state == ANHYST_LEVITATION_RUN || l->phase == ANHYST_PHASE_CONDITION;
  case ANHYST_COMMAND_CLEAR:
    return resting && l->state == ANHYST_LEVITATION_FAULT;
  default:
    return 0;
  }
}

static void obey(anhyst_levitation *l, const anhyst_levitation_input *input)
{
  if (!is_allowed(l, input)) {
    l->flags |= ANHYST_COMMAND_REFUSED;
    return;
  }
  switch (input->command) {
  case ANHYST_COMMAND_CONDITION:
    l->state = ANHYST_LEVITATION_IDLE;
    l->phase = ANHYST_PHASE_CONDITION;
    l->tick = -1;
    break;
  case ANHYST_COMMAND_DEMAGNETISED:
    l->state = ANHYST_LEVITATION_READY;
    l->demagnetise = 1;
    break;
  case ANHYST_COMMAND_LIFT:
    l->state = ANHYST_LEVITATION_RUN;
    l->phase = ANHYST_PHASE_BREAKAWAY;
    l->rest = l->position;
    l->demand = 0;
    break;
  case ANHYST_COMMAND_LAND:
    come_down(l);
    break;
  case ANHYST_COMMAND_STOP:
    if (l->phase == ANHYST_PHASE_CONDITION) {
      l->phase = ANHYST_PHASE_REST;
    } else {
      enter_fault(l, ANHYST_FAULT_STOPPED);
      come_down(l);
    }
    break;
  case ANHYST_COMMAND_CLEAR:
    enter_selftest(l);
    break;
  default:
    break;
  }
}

static void break_away(anhyst_levitation *l, const anhyst_levitation_settings *settings)
{
  if (anhyst_sub_q31(l->position, l->rest) >= settings->detect) {
    begin(l, ANHYST_PHASE_RISE);
  } else if (l->demand >= settings->most) {
    enter_fault(l, ANHYST_FAULT_NO_LIFT);
    l->phase = ANHYST_PHASE_SET_DOWN;
  } else {
    l->demand = towards(l->demand, settings->most, settings->lift);
  }
}

static void set_down(anhyst_levitation *l, const anhyst_levitation_settings *settings)
{
  if (l->demand != settings->press) {
    l->demand = towards(l->demand, settings->press, settings->set_down);
    return;
  }
  l->phase = ANHYST_PHASE_REST;
  if (l->state == ANHYST_LEVITATION_RUN) {
    l->state = ANHYST_LEVITATION_READY;
  }
}

static void move_reference(anhyst_levitation *l, const anhyst_levitation_settings *settings,
                           int32_t target)
{
  switch (l->phase) {
  case ANHYST_PHASE_RISE:
    l->reference = towards(l->reference, target, settings->rise);
    if (l->reference == target) {
      l->phase = ANHYST_PHASE_HOVER;
    }
    break;
  case ANHYST_PHASE_DESCEND:
    if (l->reference == l->rest) {
      l->phase = ANHYST_PHASE_SET_DOWN;
    } else {
      l->reference = towards(l->reference, l->rest, settings->descend);
    }
    break;
  default: /* hover */
    l->reference = target;
    break;
  }
}

/* Where the phase has led to by this tick. */
static void go_on(anhyst_levitation *l, const anhyst_levitation_limits *limits,
                  const anhyst_levitation_settings *settings, const anhyst_levitation_input *input)
{
  switch (l->phase) {
  case ANHYST_PHASE_BREAKAWAY:
    break_away(l, settings);
    break;
  case ANHYST_PHASE_SET_DOWN:
    set_down(l, settings);
    break;
  case ANHYST_PHASE_HOLD:
    l->tick++;
    if (l->tick > (int32_t)limits->hold) {
      l->phase = ANHYST_PHASE_REST;
    }
    break;
  case ANHYST_PHASE_CONDITION:
    l->tick++;
    if (l->tick >= input->conditioning) {
      l->phase = ANHYST_PHASE_REST;
      l->state = ANHYST_LEVITATION_READY;
    }
    break;
  case ANHYST_PHASE_REST:
    break;
  default:
    /* The first reference is the position itself, so that control begins without a jump. */
    if (l->begins == 0U) {
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
  levitation->begins = 0;
  levitation->demagnetise = 0;
  if (anhyst_levitation_controls(levitation)) {
    levitation->demand = input->demand;
  }
  if (levitation->state == ANHYST_LEVITATION_INIT) {
    levitation->state = ANHYST_LEVITATION_SELFTEST;
  }
  watch(levitation, limits, input);
  obey(levitation, input);
  go_on(levitation, limits, settings, input);
}
