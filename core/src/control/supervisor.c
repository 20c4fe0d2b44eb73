/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/supervisor.h"

static void enter_selftest(anhyst_supervisor *s)
{
  s->state = ANHYST_STATE_SELFTEST;
  s->fault = ANHYST_FAULT_NONE;
  s->sample_age = 0;
  s->plausible_samples = 0;
}

void anhyst_supervisor_start(anhyst_supervisor *s)
{
  enter_selftest(s);
  s->state = ANHYST_STATE_INIT;
  s->step = 0;
  s->conditioning = 0;
  s->known = 0;
}

void anhyst_supervisor_begin(anhyst_supervisor *s)
{
  if (s->state == ANHYST_STATE_INIT) {
    s->state = ANHYST_STATE_SELFTEST;
  }
}

void anhyst_supervisor_fail(anhyst_supervisor *s, uint16_t reason)
{
  if (s->state != ANHYST_STATE_FAULT) {
    s->state = ANHYST_STATE_FAULT;
    s->fault = reason;
    s->conditioning = 0;
    s->known = 0;
  }
}

int anhyst_supervisor_sample(anhyst_supervisor *s, uint16_t fault, uint16_t max_missing_samples,
                             uint16_t selftest)
{
  if (fault == ANHYST_FAULT_NONE) {
    s->sample_age = 0;
    if (s->state == ANHYST_STATE_SELFTEST) {
      s->plausible_samples++;
      s->state = s->plausible_samples >= selftest ? ANHYST_STATE_IDLE : ANHYST_STATE_SELFTEST;
    }
    return 0;
  }
  s->plausible_samples = 0;
  if (s->sample_age < UINT16_MAX) {
    s->sample_age++;
  }
  if (s->sample_age > max_missing_samples) {
    anhyst_supervisor_fail(s, fault);
    return 1;
  }
  return 0;
}

/* Returns whether the present state accepts a command, at any current. */
static int is_command_allowed(const anhyst_supervisor *s, uint16_t command, const anhyst_body *body)
{
  const int is_idle = s->state == ANHYST_STATE_IDLE;
  const int is_ready = s->state == ANHYST_STATE_READY;
  const int is_running = s->state == ANHYST_STATE_RUN;
  const int is_conditioning = s->conditioning != 0U;
  switch (command) {
  case ANHYST_COMMAND_CONDITION:
  case ANHYST_COMMAND_DEMAGNETISED:
    return (is_idle || is_ready) && !is_conditioning;
  case ANHYST_COMMAND_ARM:
    return is_idle && !is_conditioning;
  case ANHYST_COMMAND_LIFT:
    return is_ready && s->sample_age == 0U;
  case ANHYST_COMMAND_RUN:
    return is_ready;
  case ANHYST_COMMAND_LAND:
    return is_running;
  case ANHYST_COMMAND_STOP:
    return is_running || is_conditioning;
  case ANHYST_COMMAND_IDLE:
    return is_idle || is_ready || (is_running && body->levitates == 0U);
  default: /* command clear */
    return s->state == ANHYST_STATE_FAULT && body->resting != 0U;
  }
}

static int requires_zero_current(uint16_t command)
{
  return command == ANHYST_COMMAND_CONDITION || command == ANHYST_COMMAND_DEMAGNETISED ||
         command == ANHYST_COMMAND_LIFT || command == ANHYST_COMMAND_RUN ||
         command == ANHYST_COMMAND_CLEAR;
}

uint16_t anhyst_supervisor_obstacle(const anhyst_supervisor *s, uint16_t command,
                                    const anhyst_body *body)
{
  const int is_for_position = command == ANHYST_COMMAND_LIFT || command == ANHYST_COMMAND_LAND;
  const int is_for_force = command == ANHYST_COMMAND_RUN;
  if (command == ANHYST_COMMAND_NONE) {
    return ANHYST_REFUSED_NOT;
  }
  if (command >= ANHYST_COMMAND_COUNT || (is_for_position && body->levitates == 0U) ||
      (is_for_force && body->levitates != 0U)) {
    return ANHYST_REFUSED_UNKNOWN;
  }
  if (!is_command_allowed(s, command, body)) {
    return ANHYST_REFUSED_STATE;
  }
  return requires_zero_current(command) && body->at_zero == 0U ? ANHYST_REFUSED_CURRENT
                                                               : ANHYST_REFUSED_NOT;
}

/* Stops a conditioning sequence, a levitation or a force. */
static void execute_stop(anhyst_supervisor *s, const anhyst_body *body)
{
  if (s->conditioning != 0U) {
    s->conditioning = 0;
  } else if (body->levitates != 0U) {
    anhyst_supervisor_fail(s, ANHYST_FAULT_STOPPED);
  } else {
    s->state = ANHYST_STATE_READY;
  }
}

void anhyst_supervisor_command(anhyst_supervisor *s, uint16_t command, const anhyst_body *body)
{
  switch (command) {
  case ANHYST_COMMAND_CONDITION:
    s->state = ANHYST_STATE_IDLE;
    s->known = 0;
    s->conditioning = 1;
    s->step = -1;
    break;
  case ANHYST_COMMAND_DEMAGNETISED:
  case ANHYST_COMMAND_ARM:
    s->state = ANHYST_STATE_READY;
    s->known = 1;
    break;
  case ANHYST_COMMAND_LIFT:
  case ANHYST_COMMAND_RUN:
    s->state = ANHYST_STATE_RUN;
    break;
  case ANHYST_COMMAND_STOP:
    execute_stop(s, body);
    break;
  case ANHYST_COMMAND_IDLE:
    s->state = ANHYST_STATE_IDLE;
    s->conditioning = 0;
    break;
  case ANHYST_COMMAND_CLEAR:
    enter_selftest(s);
    break;
  default: /* no command, or a landing: the body comes to rest by itself */
    break;
  }
}

int anhyst_supervisor_condition(anhyst_supervisor *s, int32_t length)
{
  if (s->conditioning == 0U) {
    return 0;
  }
  s->step++;
  if (s->step >= length) {
    s->conditioning = 0;
    s->known = 1;
    s->state = ANHYST_STATE_READY;
  }
  return s->conditioning != 0U;
}

void anhyst_supervisor_rest(anhyst_supervisor *s)
{
  if (s->state == ANHYST_STATE_RUN) {
    s->state = ANHYST_STATE_READY;
  }
}
