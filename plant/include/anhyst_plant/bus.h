/* SPDX-License-Identifier: Apache-2.0 */
/* A firmware with a position controller as the controller of a simulated loop: sensor readings in,
   current references out. This adapter only converts signals between SI units and codes. Targets
   and commands of the loop have no effect: the firmware gets them over its own link. */
#ifndef ANHYST_PLANT_BUS_H
#define ANHYST_PLANT_BUS_H

#include <stdint.h>

#include "anhyst_plant/bus_words.h"
#include "anhyst_plant/controller.h"
#include "anhyst_plant/position.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  anhyst_position_scales scales;
  uint32_t tick;                          /* tick of the last sample; 0 before the first sample */
  uint32_t drive[ANHYST_BUS_DRIVE_WORDS]; /* the last record from the firmware */
  void *firmware;
  /* Runs a firmware tick: words of a sample to words of a drive. NULL after the firmware ended. */
  void (*firmware_tick)(void *firmware, const void *sample, void *drive);
} anhyst_bus_controller;

/* The tick function of an anhyst_loop_controller whose member `self` is the anhyst_bus_controller.
   Sets the member `gone` if the firmware has ended or has answered a different tick. */
void anhyst_bus_controller_tick(void *self, const anhyst_loop_sample *sample,
                                anhyst_loop_answer *answer);

#ifdef __cplusplus
}
#endif
#endif
