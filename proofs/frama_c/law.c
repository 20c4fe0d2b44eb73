/* SPDX-License-Identifier: Apache-2.0 */
/* Two functions of the full law where int has 16 bits, whose products are more than ESBMC can bound
   in time. Their contracts stand in proofs.toml and are put before them in the copy that is read.
   A table is read in its first segment, which stands for all: only the place of the two entries
   depends on the segment, and that is "full: place in a table". */
/*@ lemma product: \forall integer a, b; 0 <= a ==> 0 <= b ==> 0 <= a * b; */
#include "full.c"
