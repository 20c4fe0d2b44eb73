/* SPDX-License-Identifier: Apache-2.0 */
/* Replacement of a 64-bit product. frama_c/wide.c proves that its size is at most that of the first
   number times 2^31. */
#ifndef PROOF_WIDE_H
#define PROOF_WIDE_H

int64_t nondet_i64(void);

static int64_t anhyst_wide(int32_t a, int32_t b)
{
  const int64_t found = nondet_i64();
  int bits = 31;
  (void)b;
  if (a >= -134217728 && a <= 134217728) {
    bits = 27;
  } else if (a >= -536870912 && a <= 536870912) {
    bits = 29;
  } else if (a >= -1073741824 && a <= 1073741824) {
    bits = 30;
  }
  ASSUME(found >= -((int64_t)1 << 31 << bits) && found <= (int64_t)1 << 31 << bits);
  return found;
}

#endif
