/* SPDX-License-Identifier: Apache-2.0 */
/* The settings of contract/signals.toml: 32-bit numbers that are always in their ranges. */
#ifndef ANHYST_FIRMWARE_SETTINGS_H
#define ANHYST_FIRMWARE_SETTINGS_H

#include "app/board.h"
#include "link/frames.h"

/* Writes the default values. */
void app_settings_start(int32_t *values, const app_board *board);

/* Returns the reason why a setting cannot have this value now (value or state), or
   LINK_REASON_NONE. The range is that of the table; a setting in ticks is also limited to
   heartbeat_ms of the board. is_running: whether the state is RUN. */
uint16_t app_setting_refusal(const app_board *board, uint16_t number, int32_t value,
                             int is_running);

#endif
