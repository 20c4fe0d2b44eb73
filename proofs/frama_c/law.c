/* SPDX-License-Identifier: Apache-2.0 */
/* Two functions of the full law where int has 16 bits, whose products are more than ESBMC can bound
   in time. Their contracts stand in proofs.toml and are put before them in the copy that is read.
   A table is read in its first segment, which stands for all: only the place of the two entries
   depends on the segment, and that is "full: place in a table". */
#include <stdint.h>

/* A lemma, called where it is needed. */
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
