/* SPDX-License-Identifier: Apache-2.0 */
/* Allocation of a wrench as in wrench.h, in fixed point.

   Nothing is factorised at run time. The layout contains the least-squares forces with all drives
   free, one row per drive, and the projection of any forces onto those that make no wrench. One
   elimination step in this projection fixes a drive: the others compensate its change along its
   column, and its row and column are removed. All numbers of the projection stay within -1..1. If
   axes may be given up, there are further rows and a further projection, in which the missing
   wrench counts as one drive per axis.

   Force codes are q31 of the full scale of the force controllers, so that they pass unchanged;
   internally they are q28 (-8..8). Wrench codes have full scales of their own, which are included
   in `make`. A force beyond full scale saturates, and the wrench counts as not made. The error of a
   force without fixed drives is half an LSB of q28, plus 2^-28 of the demand of each axis. Each
   fixed drive adds about this error of its change, divided by its pivot. For the two drives of a
   pair, see allocation.h.

   Each fixed drive takes 64-bit divisions, one for each free drive, at most
   ANHYST_WRENCH_DRIVES*(ANHYST_WRENCH_PASSES + 1). Loops depend on data only as in wrench.h. */
#ifndef ANHYST_WRENCH_FIXED_H
#define ANHYST_WRENCH_FIXED_H

#include "anhyst/control/allocation.h"
#include "anhyst/control/wrench.h"
#include "anhyst/numeric/wide.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Conversion of a wrench to forces. */
typedef struct {
  anhyst_rows_q31 make; /* one row per drive, q28 per wrench code; the first drive of a pair has the
                           row of the net force, the other one zeros */
  const int32_t *apart; /* one row per drive, q30: projection onto forces without a wrench; pairs as
                           above */
} anhyst_wrench_way_q31;

/* Arrangement of the drives; constant. */
typedef struct {
  uint16_t axes;           /* components of a wrench, 1..6 */
  uint16_t drives;         /* 1..16 */
  const uint16_t *against; /* for each drive, the index of the drive that pulls against it; its own
                              index for a single drive */
  anhyst_wrench_way_q31 whole;  /* if every axis is made */
  anhyst_wrench_way_q31 yields; /* if axes are given up */
  anhyst_allocation_q31 pair;   /* allocation in pairs; `single` without pairs */
  int32_t least;                /* minimum force of a single drive; negative if it also pushes */
  int32_t most;                 /* maximum force of every drive after one is lost; > 0 */
} anhyst_wrench_layout_q31;

typedef struct {
  const anhyst_wrench_layout_q31 *layout;
  uint32_t lost; /* lost drives, bit mask */
} anhyst_wrench_q31;

/* Returns ANHYST_OK if numbers, pairs and idle force are within their ranges, otherwise
   ANHYST_BAD_PARAMETER. The layout must live as long as w. */
anhyst_status anhyst_wrench_init_q31(anhyst_wrench_q31 *w, const anhyst_wrench_layout_q31 *layout);

/* Excludes a drive from now on. */
void anhyst_wrench_lose_q31(anhyst_wrench_q31 *w, int drive);

/* Sets the force codes of the drives for a wrench. Returns 1 if they make it. Lost drives have no
   force; each single drive has at least its minimum. */
int anhyst_wrench_share_q31(const anhyst_wrench_q31 *w, const int32_t *wrench, int32_t *force);

#ifdef __cplusplus
}
#endif
#endif
