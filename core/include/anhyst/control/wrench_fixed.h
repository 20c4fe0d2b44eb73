/* SPDX-License-Identifier: Apache-2.0 */
/* Allocation of a wrench as in wrench.h, in fixed point.

   No matrix is factorised at run time. The layout contains a matrix for the least-squares forces
   with all drives free, one row for each drive. The layout also contains the projection of any
   forces onto those that make no wrench. One elimination step in this projection fixes the force of
   a drive. The column of this drive states how the other drives compensate the change. Then the row
   and the column of the drive are removed. All numbers of the projection stay within -1..1. If axes
   may be given up, a second pair of matrices is used, in which the missing wrench counts as one
   drive for each axis.

   Force codes are q31 of the full scale of the force controllers, which use the same codes.
   Internally, forces are q28 (-8..8). Wrench codes have full scales of their own, which the matrix
   `make` includes. A force beyond full scale saturates, and the wrench then counts as not made. The
   error of a force without fixed drives is half an LSB of q28, plus 2^-28 of the demand of each
   axis. Each fixed drive adds about the same error for its change of force, divided by its pivot.
   For the two drives of a pair, see allocation.h.

   Each fixed drive takes one 64-bit division for each free drive. There are at most
   ANHYST_WRENCH_DRIVES*(ANHYST_WRENCH_PASSES + 1) of these divisions. Loops depend on data only as
   in wrench.h. */
#ifndef ANHYST_WRENCH_FIXED_H
#define ANHYST_WRENCH_FIXED_H

#include "anhyst/control/allocation.h"
#include "anhyst/control/wrench.h"
#include "anhyst/numeric/wide.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Matrices that convert a wrench to forces. */
typedef struct {
  anhyst_rows_q31 make; /* one row for each drive, q28 per wrench code. Of a pair, the first row
                           gives the net force, the second row is zero */
  const int32_t *apart; /* projection onto forces without a wrench, q30; rows as in `make` */
} anhyst_wrench_way_q31;

/* Arrangement of the drives; constant. */
typedef struct {
  uint16_t axes;           /* number of components of a wrench, 1..6 */
  uint16_t drives;         /* number of drives, 1..16 */
  const uint16_t *against; /* for each drive, the index of the drive that pulls against it; its own
                              index for a single drive */
  anhyst_wrench_way_q31 whole;  /* matrices for the whole wrench */
  anhyst_wrench_way_q31 yields; /* matrices if some axes are given up */
  anhyst_allocation_q31 pair;   /* allocation in pairs; kind `single` without pairs */
  int32_t least;                /* minimum force of a single drive; negative if it also pushes */
  int32_t most;                 /* largest force of every drive after one is lost; > 0 */
} anhyst_wrench_layout_q31;

typedef struct {
  const anhyst_wrench_layout_q31 *layout;
  uint32_t lost; /* bit mask of the lost drives */
} anhyst_wrench_q31;

/* Returns ANHYST_OK if the numbers, the pairs and the idle force are valid, otherwise
   ANHYST_BAD_PARAMETER. The layout must live as long as w. */
anhyst_status anhyst_wrench_init_q31(anhyst_wrench_q31 *w, const anhyst_wrench_layout_q31 *layout);

/* Excludes a lost drive from all later allocations. */
void anhyst_wrench_lose_q31(anhyst_wrench_q31 *w, int drive);

/* Sets the force codes of the drives for a wrench. Returns 1 if the drives make the wrench,
   otherwise 0. A lost drive has no force. Each single drive has at least its minimum force. */
int anhyst_wrench_share_q31(const anhyst_wrench_q31 *w, const int32_t *wrench, int32_t *force);

#ifdef __cplusplus
}
#endif
#endif
