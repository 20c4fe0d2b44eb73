/* SPDX-License-Identifier: Apache-2.0 */
/* Two functions of the Jiles-Atherton law with an int of 16 bits, whose products ESBMC cannot bound
   in acceptable time. proofs.toml contains their contracts and inserts them in the copy that is
   read. Tables are read in their first segment, which represents all: only the address of the two
   entries depends on the segment, and the proof "full: place in a table" covers it. */
#include <stdint.h>

/* A lemma that other annotations call. */
/*@ ghost
  /@ requires 0 <= a && 0 <= b <= 8191;
     assigns \nothing;
     ensures 0 <= a * b <= a * 8191; @/
  void fraction_of(int32_t a, int32_t b) {
    //@ assert 0 <= a * b;
    //@ assert 0 <= a * (8191 - b);
  }
*/

#include "compensator/full.c"
