/* SPDX-License-Identifier: Apache-2.0 */
#include "app/control.h"

#include <stddef.h>

void app_control_start(app_control *control, app_body *body, const app_board *board)
{
  control->body = body;
  control->tick = 0;
  control->silent_ticks = 0;
  control->flags = ANHYST_CURRENT_ZERO;
  control->missed_ticks = 0;
  app_body_start(body, board);
}

/* Returns the number of ticks since the last one, usually 1. Leaves the state INIT at the first
   tick; an invalid built-in block then causes a fault. */
static uint32_t update_tick(app_control *control, const app_limits *limits, uint32_t tick)
{
  uint32_t ticks = tick - control->tick;
  control->tick = tick;
  if (app_body_states(control->body)->state == ANHYST_STATE_INIT) {
    anhyst_supervisor_begin(app_body_states(control->body));
    if (app_body_compensator(control->body, 0)->words == NULL) {
      app_body_fail(control->body, ANHYST_FAULT_BLOCK);
    }
    return 1; /* the first tick number is arbitrary */
  }
  if (ticks == 0U || ticks > (uint32_t)limits->missed_ticks + 1U) {
    app_body_fail(control->body, ANHYST_FAULT_MISSED_TICK);
  }
  if (ticks == 0U) {
    ticks = 1U;
  }
  control->missed_ticks = (uint16_t)(control->missed_ticks + (ticks - 1U));
  return ticks;
}

/* Enters the state FAULT for the first hardware fault that the port reports. */
static void check_hardware(app_control *control, uint32_t status)
{
  static const struct {
    uint16_t bit;
    uint16_t fault;
  } faults[] = {
      {PORT_EMERGENCY_STOP, ANHYST_FAULT_EMERGENCY_STOP},
      {PORT_OVER_CURRENT, ANHYST_FAULT_OVER_CURRENT},
      {PORT_AMPLIFIER, ANHYST_FAULT_AMPLIFIER},
      {PORT_SUPPLY, ANHYST_FAULT_SUPPLY},
      {PORT_TOO_WARM, ANHYST_FAULT_TOO_WARM},
  };
  for (size_t i = 0; i < sizeof faults / sizeof faults[0]; i++) {
    if ((status & faults[i].bit) != 0U) {
      app_body_fail(control->body, faults[i].fault);
      return;
    }
  }
}

/* Monitors the heartbeat. A PC without requests is a fault only while current may flow. */
static void check_heartbeat(app_control *control, const int32_t *settings, uint32_t ticks)
{
  const anhyst_supervisor *states = app_body_states(control->body);
  const int is_current_allowed = states->state == ANHYST_STATE_RUN || states->conditioning != 0U;
  control->silent_ticks =
      control->silent_ticks > UINT32_MAX - ticks ? UINT32_MAX : control->silent_ticks + ticks;
  if (is_current_allowed &&
      control->silent_ticks > (uint32_t)settings[LINK_SETTING_HEARTBEAT_TICKS]) {
    app_body_fail(control->body, ANHYST_FAULT_LINK_LOST);
  }
}

/* Returns the flags that follow from the supervisor state. */
static uint16_t state_flags(const anhyst_supervisor *states)
{
  uint16_t flags = 0;
  if (states->conditioning != 0U) {
    flags |= ANHYST_CONDITIONING;
  }
  if (states->known != 0U) {
    flags |= ANHYST_KNOWN;
  }
  return flags;
}

void app_control_tick(app_control *control, const app_board *board, const int32_t *settings,
                      const port_sample *sample, int32_t *currents)
{
  const uint32_t ticks = update_tick(control, board->limits, sample->tick);
  check_hardware(control, sample->status);
  check_heartbeat(control, settings, ticks);
  control->flags = app_body_tick(control->body, settings, sample, ticks, currents);
  control->flags |= state_flags(app_body_states(control->body));
  if (currents[0] == 0 && currents[1] == 0) {
    control->flags |= ANHYST_CURRENT_ZERO;
  }
}

uint16_t app_control_command(app_control *control, uint16_t command)
{
  if (command == ANHYST_COMMAND_CLEAR && app_body_compensator(control->body, 0)->words == NULL) {
    return LINK_REASON_BLOCK;
  }
  const uint16_t refusal = app_body_command(control->body, command);
  const uint16_t other_flags = control->flags & (uint16_t)~(ANHYST_CONDITIONING | ANHYST_KNOWN);
  control->flags = other_flags | state_flags(app_body_states(control->body));
  switch (refusal) {
  case ANHYST_REFUSED_NOT:
    return LINK_REASON_NONE;
  case ANHYST_REFUSED_STATE:
    return LINK_REASON_STATE;
  case ANHYST_REFUSED_CURRENT:
    return LINK_REASON_CURRENT;
  default:
    return LINK_REASON_VALUE;
  }
}
