/* SPDX-License-Identifier: Apache-2.0 */
#include "app/settings.h"

typedef struct {
  int32_t low;
  int32_t high;
  int32_t start;
  uint16_t while_running;
} setting;

static const setting table[LINK_SETTING_COUNT] = {LINK_SETTING_TABLE};

void app_settings_start(int32_t *values, uint32_t rate)
{
  for (uint16_t i = 0; i < (uint16_t)LINK_SETTING_COUNT; i++) {
    values[i] = table[i].start;
  }
  const int32_t tenth = (int32_t)(rate / 10U);
  const int32_t least = table[LINK_SETTING_HEARTBEAT_TICKS].low;
  values[LINK_SETTING_HEARTBEAT_TICKS] = tenth > least ? tenth : least;
}

uint16_t app_setting_obstacle(uint16_t number, int32_t value, int running)
{
  if (number >= LINK_SETTING_COUNT || value < table[number].low || value > table[number].high) {
    return LINK_REASON_VALUE;
  }
  return running && table[number].while_running == 0U ? LINK_REASON_STATE : LINK_REASON_NONE;
}
