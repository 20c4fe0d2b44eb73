/* SPDX-License-Identifier: Apache-2.0 */
/* A port header for proofs: replaces products by their proved properties, so that a whole step
   becomes a problem without products. */
#ifndef PROOF_CONTRACTS_H
#define PROOF_CONTRACTS_H

#include "any.h"

/* This contract is proved in proofs/frama_c/operators.c. */
static inline int32_t proof_scale(int32_t a, int16_t b)
{
  const int32_t r = nondet_i32();
  if (b == 0) {
    ASSUME(r == 0);
  } else if (b > 0) {
    ASSUME(a >= 0 ? r >= 0 && r <= a / 2 : r < 0 && r >= (a >> 1));
  } else {
    ASSUME(a >= 0 ? r <= 0 && r >= -(a / 2) - (a & 1) : r >= 0 && r <= -(a / 2));
  }
  return r;
}

#define ANHYST_PORT_SCALE(a, b) proof_scale((a), (b))

#endif
