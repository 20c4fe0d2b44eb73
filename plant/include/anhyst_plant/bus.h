/* SPDX-License-Identifier: Apache-2.0 */
/* A firmware with a position controller as the controller of a loop: sensor readings in, current
   references out. This adapter only converts signals between SI units and codes. Targets and
   commands come over the firmware's own link; those of the loop have no effect. */
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
  uint32_t tick;                          /* of the last sample; 0 before the first */
  uint32_t drive[ANHYST_BUS_DRIVE_WORDS]; /* the last answer of the firmware */
  void *firmware;
  /* Tick of the firmware: words of a sample to words of a drive; NULL after its end. */
  void (*firmware_tick)(void *firmware, const void *sample, void *drive);
} anhyst_bus_controller;

/* Tick of an anhyst_loop_controller whose self is the anhyst_bus_controller. Sets `gone` if the
   firmware has ended, or has answered another tick. */
void anhyst_bus_controller_tick(void *self, const anhyst_loop_sample *sample,
                                anhyst_loop_answer *answer);

#ifdef __cplusplus
}
#endif
#endif
