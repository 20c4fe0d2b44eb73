/* SPDX-License-Identifier: Apache-2.0 */

typedef struct {
  ANHYST_REAL idle; /* force of each drive of a pair without a net force, > 0; kind single: 0 */
  uint16_t kind;    /* kind of allocation, see allocation_kinds.h */
} anhyst_allocation_x;

/* Returns whether the kind and the idle force are valid. */
int anhyst_allocation_is_valid_x(const anhyst_allocation_x *allocation);

/* Allocates a net force: force[0] pulls in the direction of this force, force[1] against it. */
void anhyst_allocate_x(const anhyst_allocation_x *allocation, ANHYST_REAL net,
                       ANHYST_REAL force[2]);
