/* SPDX-License-Identifier: Apache-2.0 */

typedef struct {
  ANHYST_REAL idle; /* force of either drive of a pair without a net force, > 0; single: 0 */
  uint16_t kind;    /* see allocation_kinds.h */
} ANHYST_NAME(anhyst_allocation);

/* Whether kind and idle force are valid. */
int ANHYST_NAME(anhyst_allocation_is_valid)(const ANHYST_NAME(anhyst_allocation) *allocation);

/* Shares a net force out; force[0] pulls along it, force[1] against it. */
void ANHYST_NAME(anhyst_allocate)(const ANHYST_NAME(anhyst_allocation) *allocation, ANHYST_REAL net,
                                  ANHYST_REAL force[2]);
