/* SPDX-License-Identifier: Apache-2.0 */
/* A position controller that runs elsewhere, at the other end of the plant bus, as a loop sees it:
   a record of what the sensors show goes out, a record of what is to flow comes back. All that
   happens here is that signals in SI units become codes, and back. Targets and commands are given
   over the controller's own link: those of the loop do not count. */
#ifndef ANHYST_PLANT_BUS_H
#define ANHYST_PLANT_BUS_H

#include <stdint.h>

#include "anhyst_plant/bus_words.h"
#include "anhyst_plant/controller.h"
#include "anhyst_plant/position.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_BUS_SAMPLE_BYTES (4 * ANHYST_BUS_SAMPLE_WORDS)
#define ANHYST_BUS_DRIVE_BYTES (4 * ANHYST_BUS_DRIVE_WORDS)

typedef struct {
  anhyst_position_scales scales;
  uint32_t tick;                          /* of the last sample; 0 before the first */
  uint32_t drive[ANHYST_BUS_DRIVE_WORDS]; /* the last answer */
  void *line;
  /* Sends a sample and waits for the answer; 0 where there is none. */
  int (*exchange)(void *line, const uint8_t *sample, uint8_t *drive);
} anhyst_bus_controller;

/* As the tick of an anhyst_loop_controller whose self is the anhyst_bus_controller. The controller
   is gone where no answer came, a damaged one, or one to another tick. */
void anhyst_bus_controller_tick(void *self, const anhyst_loop_sample *sample,
                                anhyst_loop_answer *answer);

#ifdef __cplusplus
}
#endif
#endif
