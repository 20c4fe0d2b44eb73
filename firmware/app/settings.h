/* SPDX-License-Identifier: Apache-2.0 */
/* The settings of link/frames.toml: 32-bit numbers, each within its range at all times. */
#ifndef ANHYST_FIRMWARE_SETTINGS_H
#define ANHYST_FIRMWARE_SETTINGS_H

#include "link/frames.h"

/* Fills the values of the start; rate: ticks a second. */
void app_settings_start(int32_t *values, uint32_t rate);

/* Why this setting cannot take this value now (value, state), or LINK_REASON_NONE.
   running: whether the state is run. */
uint16_t app_setting_obstacle(uint16_t number, int32_t value, int running);

#endif
