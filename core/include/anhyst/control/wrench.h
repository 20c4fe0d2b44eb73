/* SPDX-License-Identifier: Apache-2.0 */
/* How a wanted wrench, forces and moments on a body, is shared out to drives that only pull; in
   double precision.

   Two drives that pull against each other on one line are a pair: its net force is free in sign,
   and the pair shares it out as allocation.h says. A drive that stands alone pulls at least a given
   force. The forces are those of least squares that make the wrench; what would pull less than its
   least is set to it and the rest is found again, as long as the others can still make any wrench,
   in at most ANHYST_WRENCH_PASSES passes. Each pass solves as many equations as there are axes.
   Nothing here allocates memory; loops are bounded by the numbers of axes and drives. */
#ifndef ANHYST_WRENCH_H
#define ANHYST_WRENCH_H

#include "anhyst/control/allocation_real.h"
#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_WRENCH_AXES 6
#define ANHYST_WRENCH_DRIVES 16
#define ANHYST_WRENCH_PASSES 3

/* How the drives stand; constant. */
typedef struct {
  uint16_t axes;      /* numbers of a wrench, 1..6 */
  uint16_t drives;    /* 1..16 */
  const double *pull; /* a row a drive: the wrench of 1 N of it */
  const uint16_t
      *against; /* for each drive that which pulls against it, itself where it is alone */
  anhyst_allocation_f64 pair; /* how pairs share; not single */
  double least;               /* of a drive that stands alone, N, >= 0 */
} anhyst_wrench_layout;

/* Whether numbers, pairs and idle force are valid and the drives can push along every axis, if
   those alone could push too. */
anhyst_status anhyst_wrench_check(const anhyst_wrench_layout *layout);

/* Forces of the drives, N, for a wrench. 1 where they make it; else 0, and each drive alone still
   pulls its least. */
int anhyst_wrench_share(const anhyst_wrench_layout *layout, const double *wrench, double *force);

#ifdef __cplusplus
}
#endif
#endif
