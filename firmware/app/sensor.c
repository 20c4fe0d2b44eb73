/* SPDX-License-Identifier: Apache-2.0 */
#include "app/sensor.h"

#include "port/port.h"

void app_sensor_start(app_sensor *sensor)
{
  sensor->value = 0;
  sensor->current_at_change = 0;
  sensor->missing_ticks = 0;
  sensor->unchanged_ticks = 0;
  sensor->has_current_moved = 0;
  sensor->has_value = 0;
}

static uint16_t add_saturated(uint16_t count, uint32_t more)
{
  return more < (uint32_t)(UINT16_MAX - count) ? (uint16_t)(count + more) : UINT16_MAX;
}

static int32_t distance(int32_t a, int32_t b) { return anhyst_abs_q31(anhyst_sub_q31(a, b)); }

/* Counts the ticks with an equal code, and tracks whether the current moved meanwhile. */
static void track_noise(app_sensor *sensor, int32_t stuck_current, int32_t value, uint32_t ticks,
                        int32_t drive)
{
  if (sensor->has_value == 0U || value != sensor->value) {
    sensor->current_at_change = drive;
    sensor->unchanged_ticks = 0;
    sensor->has_current_moved = 0;
    return;
  }
  sensor->unchanged_ticks = add_saturated(sensor->unchanged_ticks, ticks);
  if (distance(drive, sensor->current_at_change) >= stuck_current) {
    sensor->has_current_moved = 1;
  }
}

uint16_t app_sensor_judge(app_sensor *sensor, const app_sensor_limits *limits,
                          int32_t stuck_current, int32_t value, uint32_t ticks, int32_t drive)
{
  sensor->missing_ticks = add_saturated(sensor->missing_ticks, ticks);
  if (value == PORT_RESERVED) {
    return APP_SENSOR_RESERVED;
  }
  if (value < limits->low || value > limits->high) {
    return APP_SENSOR_RANGE;
  }
  if (sensor->has_value != 0U &&
      distance(value, sensor->value) / (int32_t)sensor->missing_ticks > limits->slew) {
    return APP_SENSOR_SLEW;
  }
  track_noise(sensor, stuck_current, value, ticks, drive);
  sensor->value = value;
  sensor->missing_ticks = 0;
  sensor->has_value = 1;
  if (limits->stuck_ticks > 0U && sensor->unchanged_ticks >= limits->stuck_ticks &&
      sensor->has_current_moved != 0U) {
    return APP_SENSOR_STUCK;
  }
  return APP_SENSOR_FINE;
}
