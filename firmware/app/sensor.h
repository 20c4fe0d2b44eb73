/* SPDX-License-Identifier: Apache-2.0 */
/* Plausibility check of a sensor value. */
#ifndef ANHYST_FIRMWARE_SENSOR_H
#define ANHYST_FIRMWARE_SENSOR_H

#include "app/board.h"

/* Result of the check, in the order of the fault reasons. */
enum {
  APP_SENSOR_FINE = 0,
  APP_SENSOR_RESERVED = 1,
  APP_SENSOR_RANGE = 2,
  APP_SENSOR_SLEW = 3,
  APP_SENSOR_STUCK = 4
};

typedef struct {
  int32_t value;              /* last plausible value, q30 */
  int32_t current_at_change;  /* driven current at the last change of the code, q31 */
  uint16_t missing_ticks;     /* ticks since the last plausible value, at most 65535 */
  uint16_t unchanged_ticks;   /* ticks with an equal code, at most 65535 */
  uint16_t has_current_moved; /* whether the current moved enough while the code was equal */
  uint16_t has_value;         /* whether a plausible value exists */
} app_sensor;

/* Converts a measured value from q30 to q31, with saturation. */
static inline int32_t app_sensor_q31(int32_t value) { return anhyst_shl_q31(value, 1); }

/* Resets the check. The next value is checked only for the reserved code and the range. */
void app_sensor_start(app_sensor *sensor);

/* Checks the value of a tick, `ticks` ticks after the last one (usually 1, never 0), and stores it
   if the result is FINE or STUCK. drive is the present driven current, q31. Returns the first error
   in the order above. The allowed change is `slew` times the ticks since the last plausible value;
   the quotient is truncated. */
uint16_t app_sensor_judge(app_sensor *sensor, const app_sensor_limits *limits,
                          int32_t stuck_current, int32_t value, uint32_t ticks, int32_t drive);

#endif
