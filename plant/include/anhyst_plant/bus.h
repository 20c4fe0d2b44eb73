/* SPDX-License-Identifier: Apache-2.0 */
/* A firmware with a position controller, as a loop sees it: what the sensors show goes in, what is
   to flow comes out. All that happens here is that signals in SI units become codes, and back.
   Targets and commands are given over the firmware's own link: those of the loop do not count. */
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
  uint32_t drive[ANHYST_BUS_DRIVE_WORDS]; /* the last answer */
  void *firmware;
  /* Its tick: words of a sample to words of a drive; NULL once it has ended. */
  void (*firmware_tick)(void *firmware, const void *sample, void *drive);
} anhyst_bus_controller;

/* As the tick of an anhyst_loop_controller whose self is the anhyst_bus_controller. The controller
   is gone where the firmware has ended, or answered another tick. */
void anhyst_bus_controller_tick(void *self, const anhyst_loop_sample *sample,
                                anhyst_loop_answer *answer);

#ifdef __cplusplus
}
#endif
#endif
