/* SPDX-License-Identifier: Apache-2.0 */
#include "app/settings.h"

typedef struct {
  int32_t low;
  int32_t high;
  int32_t start;
  uint16_t start_ms; /* default time of a setting in ticks, ms; otherwise 0 */
  uint16_t while_running;
} setting;

static const setting table[LINK_SETTING_COUNT] = {LINK_SETTING_TABLE};

/* Returns the largest value of a setting. The board limits the times, so that a PC cannot make the
   firmware ignore a lost link or a wrong current for a long time. */
static int32_t maximum(const app_board *board, uint16_t number)
{
  const int32_t high = table[number].high;
  if (table[number].start_ms == 0U) {
    return high;
  }
  const uint32_t limit = app_board_ticks(board, board->limits->heartbeat_ms);
  return limit < (uint32_t)high ? anhyst_clamp((int32_t)limit, table[number].low, high) : high;
}

void app_settings_start(int32_t *values, const app_board *board)
{
  for (uint16_t i = 0; i < (uint16_t)LINK_SETTING_COUNT; i++) {
    values[i] = table[i].start;
    if (table[i].start_ms > 0U) {
      values[i] = anhyst_clamp((int32_t)app_board_ticks(board, table[i].start_ms), table[i].low,
                               maximum(board, i));
    }
  }
}

uint16_t app_setting_obstacle(const app_board *board, uint16_t number, int32_t value, int running)
{
  if (number >= LINK_SETTING_COUNT || value < table[number].low || value > maximum(board, number)) {
    return LINK_REASON_VALUE;
  }
  return running && table[number].while_running == 0U ? LINK_REASON_STATE : LINK_REASON_NONE;
}
