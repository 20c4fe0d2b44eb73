/* SPDX-License-Identifier: Apache-2.0 */
/* Checks the measured current of one magnet: by itself, as every sensor, and against the driven
   current.

   The amplifier follows the driven current with a delay. The expected current is the slowest
   response that is allowed: a low-pass of first order with the time constant current_lag_ticks that
   changes by at most the full scale in current_sweep_ticks. A measured current between the
   expected and the driven current is right, and so is one that is at most current_tolerance
   outside. More than current_off_ticks samples in a row beyond it are the fault
   current_mismatch. A sensor without a value neither counts nor ends such a row.

   So the check finds a sensor that is disconnected, a gain or sign that is wrong, and an amplifier
   that does not follow. It finds them if the error exceeds the tolerance: an error of gain does so
   if the current is large enough. */
#ifndef ANHYST_FIRMWARE_CURRENT_H
#define ANHYST_FIRMWARE_CURRENT_H

#include "app/sensor.h"

typedef struct {
  app_sensor sensor;
  int32_t expected; /* current after the slowest allowed response, q30 */
  int32_t off;      /* samples in a row beyond the tolerance */
} app_current;

/* Forgets everything: the expected current begins at the next measured one. */
void app_current_start(app_current *current);

/* Judges the measured current of a tick, q30, that came `ticks` ticks after the one before. drive:
   current driven since then, q31. Keeps a plausible value in current->sensor. Returns
   ANHYST_FAULT_NONE, or the reason ANHYST_FAULT_CURRENT_... of a fault that this sample would be.
   For the tick alone: about 60 instructions and two divisions. */
uint16_t app_current_judge(app_current *current, const app_limits *limits, const int32_t *settings,
                           int32_t value, uint32_t ticks, int32_t drive);

/* Whether a reason is a fault at the first sample that shows it. The other reasons may be bridged
   for max_implausible_samples. */
int app_current_is_certain(uint16_t fault);

#endif
