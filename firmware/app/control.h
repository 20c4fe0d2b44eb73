/* SPDX-License-Identifier: Apache-2.0 */
/* The control task: ticks, link and hardware watched, commands done. What it controls is the affair
   of its body (app/body.h); states, commands and faults are those of anhyst/control/supervisor.h.
   Knows neither link nor port. */
#ifndef ANHYST_FIRMWARE_CONTROL_H
#define ANHYST_FIRMWARE_CONTROL_H

#include "app/body.h"

typedef struct {
  app_body *body;
  uint32_t tick;   /* last one computed */
  uint32_t silent; /* ticks since the last new request */
  uint16_t flags;
  uint16_t missed; /* ticks left out since power on, modulo 65536 */
} app_control;

/* Starts in init with the board's block; if that is not valid, the first tick goes to fault. Not
   for an interrupt: the block is checked. */
void app_control_start(app_control *control, app_body *body, const app_board *board);

/* One tick: watches, lets the body judge the sample and find the currents to drive, q31.
   sample: without values (PORT_NO_SAMPLE) all are PORT_RESERVED. settings: the values of the
   settings, each within its range. */
void app_control_tick(app_control *control, const app_board *board, const int32_t *settings,
                      const port_sample *sample, int32_t *currents);

/* Does a command between two ticks: LINK_REASON_NONE, or why it cannot be done (state, value,
   current, block); nothing has changed then. */
uint16_t app_control_command(app_control *control, uint16_t command);

#endif
