/* SPDX-License-Identifier: Apache-2.0 */
/* Non-volatile memory: calibrations and a parameter block in the last two sectors of the first half
   of the flash. services/store.h explains the protection against interrupted writes.

   Erasing a sector takes 1 to 2 s. The flash cannot be read in this time: a routine in RAM feeds
   the watchdog, interrupts are off, and no tick is computed. */
#ifndef MEMORY_H
#define MEMORY_H

#include "anhyst/compensator/layout.h"
#include "services/calibration.h"

#define MEMORY_LAYOUT 1U

/* A set of complete 32-bit words. */
typedef struct {
  uint32_t layout; /* MEMORY_LAYOUT */
  calibration gap; /* codes of the ADCs of the chip, values q30 */
  calibration force;
  calibration current;
  calibration position; /* codes of place.h, values q31 */
  uint32_t source;      /* source of the position: PLACE_ENCODER or PLACE_CONVERTER */
  uint32_t words;       /* words of the block; 0: the built-in block is used */
  int16_t block[ANHYST_BLOCK_MOST_WORDS];
} memory_set;

/* Reads the last stored set. Returns 1, or 0 if there is none; *set is then unchanged. */
int memory_load(memory_set *set);

/* Stores a set with interrupts off. Returns 1, or 0 if the flash failed and the last set is
   unchanged. */
int memory_save(const memory_set *set);

#endif
