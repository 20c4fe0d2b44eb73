/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/supervisor.h"

static void enter_selftest(anhyst_supervisor *s)
{
  s->state = ANHYST_STATE_SELFTEST;
  s->fault = ANHYST_FAULT_NONE;
  s->age = 0;
  s->passed = 0;
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

int anhyst_supervisor_sample(anhyst_supervisor *s, uint16_t wrong, uint16_t max_missing_samples,
                             uint16_t selftest)
{
  if (wrong == ANHYST_FAULT_NONE) {
    s->age = 0;
    if (s->state == ANHYST_STATE_SELFTEST) {
      s->passed++;
      s->state = s->passed >= selftest ? ANHYST_STATE_IDLE : ANHYST_STATE_SELFTEST;
    }
    return 0;
  }
  s->passed = 0;
  if (s->age < UINT16_MAX) {
    s->age++;
  }
  if (s->age > max_missing_samples) {
    anhyst_supervisor_fail(s, wrong);
    return 1;
  }
  return 0;
}

/* Whether a command may come in this state, whatever flows. */
static int is_allowed(const anhyst_supervisor *s, uint16_t command, const anhyst_body *body)
{
  const int idle = s->state == ANHYST_STATE_IDLE;
  const int ready = s->state == ANHYST_STATE_READY;
  const int run = s->state == ANHYST_STATE_RUN;
  const int conditioning = s->conditioning != 0U;
  switch (command) {
  case ANHYST_COMMAND_CONDITION:
  case ANHYST_COMMAND_DEMAGNETISED:
    return (idle || ready) && !conditioning;
  case ANHYST_COMMAND_ARM:
    return idle && !conditioning;
  case ANHYST_COMMAND_LIFT:
    return ready && s->age == 0U;
  case ANHYST_COMMAND_RUN:
    return ready;
  case ANHYST_COMMAND_LAND:
    return run;
  case ANHYST_COMMAND_STOP:
    return run || conditioning;
  case ANHYST_COMMAND_IDLE:
    return idle || ready || (run && body->levitates == 0U);
  default: /* clear */
    return s->state == ANHYST_STATE_FAULT && body->resting != 0U;
  }
}

/* Whether a command begins something that must not begin while current flows. */
static int waits_for_zero(uint16_t command)
{
  return command == ANHYST_COMMAND_CONDITION || command == ANHYST_COMMAND_DEMAGNETISED ||
         command == ANHYST_COMMAND_LIFT || command == ANHYST_COMMAND_RUN ||
         command == ANHYST_COMMAND_CLEAR;
}

uint16_t anhyst_supervisor_obstacle(const anhyst_supervisor *s, uint16_t command,
                                    const anhyst_body *body)
{
  const int of_position = command == ANHYST_COMMAND_LIFT || command == ANHYST_COMMAND_LAND;
  const int of_force = command == ANHYST_COMMAND_RUN;
  if (command == ANHYST_COMMAND_NONE) {
    return ANHYST_REFUSED_NOT;
  }
  if (command >= ANHYST_COMMAND_COUNT || (of_position && body->levitates == 0U) ||
      (of_force && body->levitates != 0U)) {
    return ANHYST_REFUSED_UNKNOWN;
  }
  if (!is_allowed(s, command, body)) {
    return ANHYST_REFUSED_STATE;
  }
  return waits_for_zero(command) && body->at_zero == 0U ? ANHYST_REFUSED_CURRENT
                                                        : ANHYST_REFUSED_NOT;
}

/* Stop: of a sequence that runs, of an armature in the air, of a force. */
static void stop(anhyst_supervisor *s, const anhyst_body *body)
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
    stop(s, body);
    break;
  case ANHYST_COMMAND_IDLE:
    s->state = ANHYST_STATE_IDLE;
    s->conditioning = 0;
    break;
  case ANHYST_COMMAND_CLEAR:
    enter_selftest(s);
    break;
  default: /* none; land: the body comes to rest by itself */
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
