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

/* The stored set; a multiple of 32 bits. */
typedef struct {
  uint32_t layout; /* MEMORY_LAYOUT */
  calibration gap; /* calibrations of the codes of the chip's ADCs, values q30 */
  calibration force;
  calibration current;
  calibration position;     /* calibration of the codes of place.h, values q31 */
  uint32_t position_source; /* source of the position: POSITION_FROM_... */
  uint32_t words;           /* number of words of the block; 0: the built-in block is used */
  int16_t block[ANHYST_BLOCK_MOST_WORDS];
} memory_set;

/* Reads the last stored set. Returns 1, or 0 if there is none; *set is then unchanged. */
int memory_load(memory_set *set);

/* Stores a set with interrupts off. Returns 0 if the flash failed; the last set is then
   unchanged. */
int memory_save(const memory_set *set);

#endif
