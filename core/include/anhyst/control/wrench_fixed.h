/* SPDX-License-Identifier: Apache-2.0 */
/* How a wanted wrench is shared out, as in wrench.h, in fixed point.

   Nothing is factorised here. Beside the forces of least squares with all drives free, a row a
   drive, stands the matrix that takes any forces to those of them that make no wrench. A drive is
   held by one step of elimination in it: the others take over what the held one gives up, along its
   column, and its row and column are gone from what is free. The numbers of that matrix stay within
   -1..1, whatever is held. Where axes may be given up there are such rows and such a matrix too, in
   which what is missing counts as a drive an axis.

   Codes of forces are q31 of the full scale of the force controllers, so that they pass unchanged;
   inside they are q28 (-8..8). Codes of a wrench have full scales of their own, in `make`. A force
   beyond full scale saturates, and is not made. Error of a force while nothing is held: half a unit
   of q28, and 2^-28 of what each axis asks for; each drive that is held adds about that of what it
   gives up over its pivot. Halves of a pair: see allocation.h.

   A held drive takes 64-bit divisions, one for each that is free, at most
   ANHYST_WRENCH_DRIVES*(ANHYST_WRENCH_PASSES + 1). No loop depends on data otherwise than wrench.h
   says. */
#ifndef ANHYST_WRENCH_FIXED_H
#define ANHYST_WRENCH_FIXED_H

#include "anhyst/control/allocation.h"
#include "anhyst/control/wrench.h"
#include "anhyst/numeric/wide.h"

#ifdef __cplusplus
extern "C" {
#endif

/* How a wrench becomes forces. */
typedef struct {
  anhyst_rows_q31 make; /* a row a drive, q28 of codes of a wrench; of a pair the first has that of
                           the net force, the other zeros */
  const int32_t *apart; /* a row a drive, q30: forces to those that make no wrench; of a pair as
                           before */
} anhyst_wrench_way_q31;

/* How the drives stand; constant. */
typedef struct {
  uint16_t axes;   /* numbers of a wrench, 1..6 */
  uint16_t drives; /* 1..16 */
  const uint16_t
      *against; /* for each drive that which pulls against it, itself where it is alone */
  anhyst_wrench_way_q31 whole;  /* as long as every axis is made */
  anhyst_wrench_way_q31 yields; /* where some is given up */
  anhyst_allocation_q31 pair;   /* how pairs share; single where there are none */
  int32_t least;                /* of a drive that stands alone; below 0 where it goes both ways */
  int32_t most;                 /* of every one once a drive is lost; > 0 */
} anhyst_wrench_layout_q31;

typedef struct {
  const anhyst_wrench_layout_q31 *layout;
  uint32_t lost; /* drives, bit by bit */
} anhyst_wrench_q31;

/* ANHYST_OK where numbers, pairs and idle force are within their ranges. The layout must live as
   long as what is made of it. */
anhyst_status anhyst_wrench_init_q31(anhyst_wrench_q31 *w, const anhyst_wrench_layout_q31 *layout);

/* Does without a drive from now on. */
void anhyst_wrench_lose_q31(anhyst_wrench_q31 *w, int drive);

/* Codes of the forces of the drives for a wrench; 1 where they make it. Lost drives pull nothing,
   each alone at least its least. */
int anhyst_wrench_share_q31(const anhyst_wrench_q31 *w, const int32_t *wrench, int32_t *force);

#ifdef __cplusplus
}
#endif
#endif
