/* SPDX-License-Identifier: Apache-2.0 */

/* Template: allocation of a force to two drives, for every number format. The operations of a
   format are included before: allocation.c for q31, allocation_real.h for floating point. */

int anhyst_allocation_is_valid_x(const anhyst_allocation_x *allocation)
{
  if (allocation->kind == ANHYST_ALLOCATE_SINGLE) {
    return 1;
  }
  return (allocation->kind == ANHYST_ALLOCATE_BY_HALVES ||
          allocation->kind == ANHYST_ALLOCATE_CLASS_AB) &&
         is_force_valid(allocation->idle);
}

void anhyst_allocate_x(const anhyst_allocation_x *allocation, ANHYST_REAL net, ANHYST_REAL force[2])
{
  if (allocation->kind == ANHYST_ALLOCATE_CLASS_AB) {
    const ANHYST_REAL larger = larger_force(net, allocation->idle);
    const ANHYST_REAL smaller = smaller_force(larger, allocation->idle);
    force[0] = net >= 0 ? larger : smaller;
    force[1] = net >= 0 ? smaller : larger;
  } else if (allocation->kind == ANHYST_ALLOCATE_BY_HALVES) {
    force[0] = anhyst_add_x(allocation->idle, half(net));
    force[1] = anhyst_sub_x(allocation->idle, half(net));
  } else {
    force[0] = net;
    force[1] = net;
  }
}
