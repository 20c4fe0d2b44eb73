/* SPDX-License-Identifier: Apache-2.0 */
#include "app/settings.h"

typedef struct {
  int32_t low;
  int32_t high;
  int32_t default_value;
  uint16_t default_ms; /* default time of a setting in ticks, ms; otherwise 0 */
  uint16_t is_writable_in_run;
} setting;

static const setting table[LINK_SETTING_COUNT] = {LINK_SETTING_TABLE};

/* Returns the largest value of a setting. The board limits the times, so that a PC cannot make the
   firmware ignore a lost link or a wrong current for a long time. */
static int32_t largest_value(const app_board *board, uint16_t number)
{
  const int32_t high = table[number].high;
  if (table[number].default_ms == 0U) {
    return high;
  }
  const uint32_t limit = app_board_ticks(board, board->limits->heartbeat_ms);
  return limit < (uint32_t)high ? anhyst_clamp((int32_t)limit, table[number].low, high) : high;
}

void app_settings_start(int32_t *values, const app_board *board)
{
  for (uint16_t i = 0; i < (uint16_t)LINK_SETTING_COUNT; i++) {
    values[i] = table[i].default_value;
    if (table[i].default_ms > 0U) {
      values[i] = anhyst_clamp((int32_t)app_board_ticks(board, table[i].default_ms), table[i].low,
                               largest_value(board, i));
    }
  }
}

uint16_t app_setting_refusal(const app_board *board, uint16_t number, int32_t value, int is_running)
{
  if (number >= LINK_SETTING_COUNT || value < table[number].low ||
      value > largest_value(board, number)) {
    return LINK_REASON_VALUE;
  }
  return is_running && table[number].is_writable_in_run == 0U ? LINK_REASON_STATE
                                                              : LINK_REASON_NONE;
}
