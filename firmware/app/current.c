/* SPDX-License-Identifier: Apache-2.0 */
#include "app/current.h"

#include "link/frames.h"
#include "port/port.h"

void app_current_start(app_current *current)
{
  app_sensor_start(&current->sensor);
  current->expected_current = 0;
  current->failed_samples = 0;
}

/* Moves the expected current towards the driven current by one tick; both q30. */
static int32_t next_expected_current(int32_t expected, int32_t drive, const int32_t *settings)
{
  const int32_t step = anhyst_sub_q31(drive, expected);
  const int32_t limit = PORT_ONE / settings[LINK_SETTING_CURRENT_SWEEP_TICKS];
  return expected + anhyst_clamp(step / settings[LINK_SETTING_CURRENT_LAG_TICKS], -limit, limit);
}

/* Returns the distance of a value from the interval between two others, q30. */
static int32_t distance_from_interval(int32_t value, int32_t a, int32_t b)
{
  const int32_t nearest = a < b ? anhyst_clamp(value, a, b) : anhyst_clamp(value, b, a);
  return anhyst_abs_q31(anhyst_sub_q31(value, nearest));
}

static void compare_with_drive(app_current *current, const int32_t *settings, int is_new,
                               int32_t drive)
{
  const int32_t value = current->sensor.value;
  current->expected_current = next_expected_current(current->expected_current, drive, settings);
  if (!is_new) {
    return;
  }
  const int is_near = distance_from_interval(value, current->expected_current, drive) <=
                      settings[LINK_SETTING_CURRENT_TOLERANCE] / 2;
  current->failed_samples = is_near ? 0 : anhyst_add_q31(current->failed_samples, 1);
}

uint16_t app_current_judge(app_current *current, const app_limits *limits, const int32_t *settings,
                           int32_t value, uint32_t ticks, int32_t drive)
{
  const uint16_t was_known = current->sensor.has_value;
  const uint16_t error = app_sensor_judge(&current->sensor, &limits->current, limits->stuck_current,
                                          value, ticks, drive);
  if (was_known == 0U) {
    current->expected_current = current->sensor.value;
  }
  if (limits->has_current_sensor != 0U) {
    compare_with_drive(current, settings, current->sensor.missing_ticks == 0U, drive / 2);
    if (current->failed_samples > settings[LINK_SETTING_CURRENT_OFF_TICKS]) {
      return ANHYST_FAULT_CURRENT_MISMATCH;
    }
  }
  return error == APP_SENSOR_FINE
             ? ANHYST_FAULT_NONE
             : (uint16_t)(ANHYST_FAULT_CURRENT_RESERVED - APP_SENSOR_RESERVED + error);
}

int app_current_is_immediate_fault(uint16_t fault)
{
  return fault == ANHYST_FAULT_CURRENT_STUCK || fault == ANHYST_FAULT_CURRENT_MISMATCH;
}
