/* SPDX-License-Identifier: Apache-2.0 */
/* Proves the allocation for any net force and any valid idle force. The macros PRODUCT and RATIO
   select proofs of two functions: both return 0..2^31 - 1. The other proofs replace these functions
   by any result in this range. */
#ifndef ALLOCATE
#define ANHYST_PORT_HEADER "contracts.h"
#endif
#include "any.h"

#include "control/allocation.c"

#ifdef ALLOCATE
static int32_t product(int32_t a, int32_t b)
{
  SHOW(a >= 0 && b >= 0);
  return any_within(0, ANHYST_Q31_MAX);
}

static int32_t ratio(int32_t smaller, int32_t larger)
{
  SHOW(smaller >= 0 && larger > 0);
  return any_within(0, ANHYST_Q31_MAX);
}
#endif

int main(void)
{
#if defined(PRODUCT)
  const int32_t found = product(any_within(0, ANHYST_Q31_MAX), any_within(0, ANHYST_Q31_MAX));
  SHOW(found >= 0);
#elif defined(RATIO)
  const int32_t found = ratio(any_within(0, ANHYST_Q31_MAX), any_within(1, ANHYST_Q31_MAX));
  SHOW(found >= 0);
#else
  const anhyst_allocation_q31 allocation = {nondet_i32(), nondet_u16()};
  int32_t force[2];
  ASSUME(anhyst_allocation_is_valid_q31(&allocation));
  anhyst_allocate_q31(&allocation, nondet_i32(), force);
  SHOW(allocation.kind != ANHYST_ALLOCATE_CLASS_AB || (force[0] >= 0 && force[1] >= 0));
#endif
  return 0;
}
