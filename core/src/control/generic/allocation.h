/* SPDX-License-Identifier: Apache-2.0 */

/* What follows is the same in every format; the few operations in which they differ stand before
   it: allocation.c for q31, generic/allocation_real.h for the others. */

int ANHYST_NAME(anhyst_allocation_is_valid)(const ANHYST_NAME(anhyst_allocation) *allocation)
{
  if (allocation->kind == ANHYST_ALLOCATE_SINGLE) {
    return 1;
  }
  return (allocation->kind == ANHYST_ALLOCATE_BY_HALVES ||
          allocation->kind == ANHYST_ALLOCATE_CLASS_AB) &&
         ANHYST_NAME(is_force)(allocation->idle);
}

void ANHYST_NAME(anhyst_allocate)(const ANHYST_NAME(anhyst_allocation) *allocation, ANHYST_REAL net,
                                  ANHYST_REAL force[2])
{
  if (allocation->kind == ANHYST_ALLOCATE_CLASS_AB) {
    const ANHYST_REAL larger = ANHYST_NAME(larger_of)(net, allocation->idle);
    const ANHYST_REAL smaller = ANHYST_NAME(smaller_of)(larger, allocation->idle);
    force[0] = net >= 0 ? larger : smaller;
    force[1] = net >= 0 ? smaller : larger;
  } else if (allocation->kind == ANHYST_ALLOCATE_BY_HALVES) {
    force[0] = ANHYST_NAME(anhyst_add)(allocation->idle, ANHYST_NAME(half)(net));
    force[1] = ANHYST_NAME(anhyst_sub)(allocation->idle, ANHYST_NAME(half)(net));
  } else {
    force[0] = net;
    force[1] = net;
  }
}
