/* SPDX-License-Identifier: Apache-2.0 */
/* The control task: monitors ticks, link and hardware, and performs commands. The control itself is
   in the body (app/body.h). States, commands and faults are in anhyst/control/supervisor.h. This
   module does not depend on link or port. */
#ifndef ANHYST_FIRMWARE_CONTROL_H
#define ANHYST_FIRMWARE_CONTROL_H

#include "app/body.h"

typedef struct {
  app_body *body;
  uint32_t tick;         /* number of the last tick */
  uint32_t silent_ticks; /* ticks since the last new request */
  uint16_t flags;
  uint16_t missed_ticks; /* missed ticks since power-on, modulo 65536 */
} app_control;

/* Starts in the state INIT with the board's block. If the block is invalid, the first tick enters
   the state FAULT. Must not be called from an ISR, because it checks the block. */
void app_control_start(app_control *control, app_body *body, const app_board *board);

/* Runs one tick: monitors, and calls the body, which checks the sample and calculates the currents
   (q31). Requires PORT_RESERVED for all values with PORT_NO_SAMPLE, and settings in their ranges.
 */
void app_control_tick(app_control *control, const app_board *board, const int32_t *settings,
                      const port_sample *sample, int32_t *currents);

/* Performs a command between two ticks. Returns LINK_REASON_NONE, or the reason of the refusal
   (state, value, current or block). After a refusal nothing has changed. */
uint16_t app_control_command(app_control *control, uint16_t command);

#endif
