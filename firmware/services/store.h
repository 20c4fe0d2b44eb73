/* SPDX-License-Identifier: Apache-2.0 */
/* Stores a set of words in flash, in two copies with a checksum each. The newer valid copy counts.

   A new set overwrites the older copy, and its checksum is written last. If the power fails during
   the erase or after any byte, a later read returns the complete old set or the complete new set.
   The test interrupts the write after every byte.

   Each copy is a flash area that can be erased separately. Layout in 32-bit words:

       0  STORE_MAGIC     2  count      3 + count  CRC-32 of all words before,
       1  set number      3  the set               low byte of each word first

   The set number is one more than in the other copy. The functions use no static memory and wait
   only for the flash. */
#ifndef ANHYST_SERVICES_STORE_H
#define ANHYST_SERVICES_STORE_H

#include <stdint.h>

#define STORE_MAGIC ((uint32_t)0x53594E41) /* "ANYS" */
#define STORE_OVERHEAD_WORDS 4             /* words of a copy in addition to the set */

/* Flash access of a board. The functions return 1, or 0 if the flash reported a failure. */
typedef struct {
  const volatile uint32_t *copy[2]; /* readable addresses of the two copies */
  uint32_t words;                   /* words per copy, at least STORE_OVERHEAD_WORDS */
  int (*erase)(uint16_t copy);      /* sets all bits of the copy to 1 */
  int (*program)(uint16_t copy, uint32_t at, uint32_t word); /* writes a word that was erased */
} store_flash;

/* Returns the newest stored set and its number of words; a null pointer and 0 if there is none. */
const volatile uint32_t *store_read(const store_flash *flash, uint32_t *count);

/* Stores a set. Returns 1 if the set can be read back. Returns 0 if it does not fit or the flash
   failed; the previous set is then still valid. May take seconds: call it only at zero current. */
int store_write(const store_flash *flash, const uint32_t *words, uint32_t count);

#endif
