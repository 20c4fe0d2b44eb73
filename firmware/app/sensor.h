/* SPDX-License-Identifier: Apache-2.0 */
/* Whether what a sensor shows can be. */
#ifndef ANHYST_FIRMWARE_SENSOR_H
#define ANHYST_FIRMWARE_SENSOR_H

#include "app/board.h"

/* What is wrong with a value; in the order of the reasons of a fault. */
enum {
  APP_SENSOR_FINE = 0,
  APP_SENSOR_RESERVED = 1,
  APP_SENSOR_RANGE = 2,
  APP_SENSOR_SLEW = 3,
  APP_SENSOR_STUCK = 4
};

typedef struct {
  int32_t value;  /* the last plausible one, q30 */
  int32_t anchor; /* current driven when the code changed last, q31 */
  uint16_t age;   /* ticks since the value was plausible; 0 with it, 65535 at most */
  uint16_t same;  /* ticks for which the code has been the same, 65535 at most */
  uint16_t moved; /* whether the current was moved enough in that time */
  uint16_t known; /* whether there is a plausible value at all */
} app_sensor;

/* A measured q30 as a q31; beyond full scale it saturates. */
static inline int32_t app_sensor_q31(int32_t value) { return anhyst_shl_q31(value, 1); }

/* Forgets everything: the next value is judged by code and range alone. */
void app_sensor_start(app_sensor *sensor);

/* Judges the value of a tick that came `ticks` ticks after the one before (1 as a rule, never 0),
   and keeps it if it is fine. drive: the current driven now, q31. Returns what is wrong, the first
   that holds in the order above; a value that is stuck is kept too. A change may be as large as the
   slew for each tick since the last plausible value, the fraction of a code for each given in. */
uint16_t app_sensor_judge(app_sensor *sensor, const app_sensor_limits *limits,
                          int32_t stuck_current, int32_t value, uint32_t ticks, int32_t drive);

#endif
