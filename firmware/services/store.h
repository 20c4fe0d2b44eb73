/* SPDX-License-Identifier: Apache-2.0 */
/* A set of words that outlives the power, in flash: two copies, each checked, the newer one counts.

   A new set goes where the older copy lies, so that the one in use is never touched. Its checksum
   is written last. Whenever the power goes, during the erasing or behind any byte, what is read
   afterwards is the old set or the new one, whole: the test cuts after every byte.

   A copy is a piece of flash that is erased alone:

     0  STORE_MAGIC          2  count                3 + count  CRC-32 of all words before,
     1  number, one more     3  the words            low byte of each word first
        than the other's

   Takes no memory of its own, waits for the flash alone. */
#ifndef ANHYST_SERVICES_STORE_H
#define ANHYST_SERVICES_STORE_H

#include <stdint.h>

#define STORE_MAGIC ((uint32_t)0x53594E41) /* "ANYS" */
#define STORE_EXTRA 4                      /* words of a copy beside the set's own */

/* What a board's flash can do. Functions return 1, or 0 where the flash refused. */
typedef struct {
  const volatile uint32_t *copy[2]; /* where the two lie, readable */
  uint32_t words;                   /* that fit into each, STORE_EXTRA or more */
  int (*erase)(uint16_t copy);      /* afterwards all bits of that copy are 1 */
  int (*program)(uint16_t copy, uint32_t at, uint32_t word); /* a word that was erased */
} store_flash;

/* The set stored last, and how many words it has; 0 where there is none. */
const volatile uint32_t *store_read(const store_flash *flash, uint32_t *count);

/* Stores a set. 1, or 0 where it does not fit, or the flash refused or did not keep it: then the
   set before is still there. May take seconds: without current alone. */
int store_write(const store_flash *flash, const uint32_t *words, uint32_t count);

#endif
