/* SPDX-License-Identifier: Apache-2.0 */
/* Arbitrary numbers, assumptions and claims for the proofs. */
#ifndef PROOF_ANY_H
#define PROOF_ANY_H

#include <stdint.h>

int16_t nondet_i16(void);
uint16_t nondet_u16(void);
int32_t nondet_i32(void);

#define ASSUME(condition) __ESBMC_assume(condition)
#define SHOW(condition) __ESBMC_assert(condition, #condition)

static inline int32_t any_within(int32_t low, int32_t high)
{
  const int32_t a = nondet_i32();
  ASSUME(low <= a && a <= high);
  return a;
}

#endif
