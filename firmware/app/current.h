/* SPDX-License-Identifier: Apache-2.0 */
/* Checks the measured current of a magnet, both as any sensor value and against the driven current.

   The amplifier follows the driven current with a delay. The expected current is the slowest
   response that is allowed: a first-order low-pass with the time constant current_lag_ticks, whose
   rate is limited to the full scale in current_sweep_ticks. A measured current passes if it is
   between the expected and the driven current, or at most current_tolerance outside. More than
   current_off_ticks failed samples in a row cause the fault current_mismatch. A sample without a
   value neither counts nor resets the count.

   The check finds a disconnected sensor, a wrong gain or sign, and an amplifier that does not
   follow, if the error exceeds the tolerance. For a gain error the current must be large enough. */
#ifndef ANHYST_FIRMWARE_CURRENT_H
#define ANHYST_FIRMWARE_CURRENT_H

#include "app/sensor.h"

typedef struct {
  app_sensor sensor;
  int32_t expected_current; /* current after the slowest allowed response, q30 */
  int32_t failed_samples;   /* failed samples in a row */
} app_current;

/* Resets the check. The next measured current becomes the expected current. */
void app_current_start(app_current *current);

/* Checks the measured current of a tick (q30), `ticks` ticks after the last one. drive is the
   driven current since then, q31. Stores a plausible value in current->sensor. Returns
   ANHYST_FAULT_NONE, or the reason ANHYST_FAULT_CURRENT_... Call it only in the tick; it takes
   about 60 instructions and two divisions. */
uint16_t app_current_judge(app_current *current, const app_limits *limits, const int32_t *settings,
                           int32_t value, uint32_t ticks, int32_t drive);

/* Whether one sample with this reason is a fault; otherwise, max_implausible_samples applies. */
int app_current_is_immediate_fault(uint16_t fault);

#endif
