/* SPDX-License-Identifier: Apache-2.0 */
/* What outlives the power: calibrations and a parameter block, in the last two sectors of the first
   half of the flash (services/store.h says how a torn write is survived).

   Erasing a sector takes 1 to 2 s, in which the flash cannot be read: meanwhile a routine in RAM
   feeds the watchdog, interrupts are off, and no tick is computed. */
#ifndef MEMORY_H
#define MEMORY_H

#include "anhyst/compensator/layout.h"
#include "services/calibration.h"

#define MEMORY_LAYOUT 1U

/* A set; whole words. */
typedef struct {
  uint32_t layout; /* MEMORY_LAYOUT */
  calibration gap; /* codes of the converters in the chip, values q30 */
  calibration force;
  calibration current;
  calibration position; /* codes of place.h, values q31 */
  uint32_t source;      /* of the position: PLACE_ENCODER or PLACE_CONVERTER */
  uint32_t words;       /* of the block; 0: the one built in counts */
  int16_t block[ANHYST_BLOCK_MOST_WORDS];
} memory_set;

/* The set kept last. 1, or 0 where there is none: *set is as it was. */
int memory_load(memory_set *set);

/* Keeps a set; interrupts off. 1, or 0 where the flash did not: the set before is still there. */
int memory_save(const memory_set *set);

#endif
