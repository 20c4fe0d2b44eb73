/* SPDX-License-Identifier: Apache-2.0 */
#include "app/recorder.h"

void app_recorder_start(app_recorder *recorder)
{
  const link_recorder_setup off = {0, 0, 0, 1, 0, 0, 0};
  recorder->tick = 0;
  (void)app_recorder_setup(recorder, &off);
}

static uint16_t ones(uint16_t mask)
{
  uint16_t count = 0;
  for (; mask != 0U; mask = (uint16_t)(mask >> 1)) {
    count = (uint16_t)(count + (mask & 1U));
  }
  return count;
}

uint16_t app_recorder_setup(app_recorder *recorder, const link_recorder_setup *setup)
{
  const uint16_t width = ones(setup->mask);
  const uint16_t fit = (uint16_t)(APP_RECORDER_VALUES / (width > 0U ? width : 1));
  const uint16_t records = setup->records > 0U ? setup->records : fit;
  if ((setup->mask >> LINK_SIGNAL_COUNT) != 0U || setup->signal >= LINK_SIGNAL_COUNT ||
      setup->trigger >= LINK_TRIGGER_COUNT || setup->decimation == 0U || records > fit ||
      (width > 0U && setup->before >= records)) {
    return LINK_REASON_VALUE;
  }
  recorder->setup = *setup;
  recorder->width = width;
  recorder->records = records;
  recorder->next = 0;
  recorder->first = 0;
  recorder->before = 0;
  recorder->left = 0;
  recorder->skip = 0;
  recorder->seen = 0;
  recorder->state = width > 0U ? LINK_RECORDER_WAITING : LINK_RECORDER_OFF;
  return LINK_REASON_NONE;
}

/* Whether this record is the one that triggers. */
static int triggers(const app_recorder *recorder, int32_t now)
{
  const int32_t level = recorder->setup.level;
  switch (recorder->setup.trigger) {
  case LINK_TRIGGER_RISING:
    return recorder->seen != 0U && recorder->last < level && now >= level;
  case LINK_TRIGGER_FALLING:
    return recorder->seen != 0U && recorder->last > level && now <= level;
  default:
    return 1;
  }
}

/* Puts a record at the next place of the ring. */
static void keep(app_recorder *recorder, const int32_t *signals)
{
  uint16_t at = (uint16_t)(recorder->next * recorder->width);
  for (uint16_t i = 0; i < (uint16_t)LINK_SIGNAL_COUNT; i++) {
    if ((recorder->setup.mask & (1U << i)) != 0U) {
      recorder->values[at++] = signals[i];
    }
  }
  recorder->next = (uint16_t)(recorder->next + 1U);
  if (recorder->next == recorder->records) {
    recorder->next = 0;
  }
}

void app_recorder_tick(app_recorder *recorder, uint32_t tick, const int32_t *signals)
{
  if (recorder->state != LINK_RECORDER_WAITING && recorder->state != LINK_RECORDER_RECORDING) {
    return;
  }
  if (recorder->skip > 0U) {
    recorder->skip--;
    return;
  }
  recorder->skip = (uint16_t)(recorder->setup.decimation - 1U);
  const int32_t now = signals[recorder->setup.signal];
  if (recorder->state == LINK_RECORDER_WAITING && triggers(recorder, now)) {
    recorder->first = recorder->next >= recorder->before
                          ? (uint16_t)(recorder->next - recorder->before)
                          : (uint16_t)(recorder->next + recorder->records - recorder->before);
    recorder->left = (uint16_t)(recorder->records - recorder->before);
    recorder->tick = tick;
    recorder->state = LINK_RECORDER_RECORDING;
  }
  recorder->last = now;
  recorder->seen = 1;
  keep(recorder, signals);
  if (recorder->state == LINK_RECORDER_WAITING) {
    if (recorder->before < recorder->setup.before) {
      recorder->before++;
    }
  } else if (--recorder->left == 0U) {
    recorder->state = LINK_RECORDER_DONE;
  }
}

void app_recorder_info(const app_recorder *recorder, link_recorder_info *info)
{
  info->recorder = recorder->state;
  info->mask = recorder->setup.mask;
  info->records = recorder->records;
  info->before = recorder->before;
  info->tick = recorder->tick;
  info->decimation = recorder->setup.decimation;
}

int app_recorder_value(const app_recorder *recorder, uint32_t number, int32_t *value)
{
  if (recorder->state != LINK_RECORDER_DONE ||
      number >= (uint32_t)recorder->records * recorder->width) {
    return 0;
  }
  const uint16_t record = (uint16_t)(number / recorder->width);
  const uint32_t place = ((uint32_t)recorder->first + record) % recorder->records;
  *value = recorder->values[place * recorder->width + number % recorder->width];
  return 1;
}
