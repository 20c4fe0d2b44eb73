/* SPDX-License-Identifier: Apache-2.0 */
/* Records signals at the rate of the control task, around a trigger, to be read out afterwards. */
#ifndef ANHYST_FIRMWARE_RECORDER_H
#define ANHYST_FIRMWARE_RECORDER_H

#include "link/frames.h"

/* Values that fit; four bytes each. */
#ifndef APP_RECORDER_VALUES
#define APP_RECORDER_VALUES 4096
#endif

typedef char app_recorder_counts_in_16_bits[APP_RECORDER_VALUES <= 32767 ? 1 : -1];

typedef struct {
  link_recorder_setup setup;
  uint16_t state;   /* one of LINK_RECORDER_... */
  uint16_t width;   /* values of a record */
  uint16_t records; /* of a full recording */
  uint16_t next;    /* place of the next record */
  uint16_t first;   /* place of the first record, once triggered */
  uint16_t before;  /* records kept from before the trigger */
  uint16_t left;    /* records still wanted once triggered */
  uint16_t skip;    /* ticks until the next record */
  uint16_t seen;    /* whether `last` holds */
  int32_t last;     /* triggering signal at the last record */
  uint32_t tick;    /* of the record at the trigger */
  int32_t values[APP_RECORDER_VALUES];
} app_recorder;

void app_recorder_start(app_recorder *recorder);

/* Sets up and starts, or switches off where the mask is 0: LINK_REASON_NONE. LINK_REASON_VALUE
   where a number is out of its range or the records do not fit: it goes on as it was. */
uint16_t app_recorder_setup(app_recorder *recorder, const link_recorder_setup *setup);

/* One tick. signals: the values of all signals, LINK_SIGNAL_COUNT of them. */
void app_recorder_tick(app_recorder *recorder, uint32_t tick, const int32_t *signals);

void app_recorder_info(const app_recorder *recorder, link_recorder_info *info);

/* A recorded value by its number, record by record; 1 where it exists, only when done. */
int app_recorder_value(const app_recorder *recorder, uint32_t number, int32_t *value);

#endif
