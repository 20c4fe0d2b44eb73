/* SPDX-License-Identifier: Apache-2.0 */
/* A map of the current over force and gap with one play, in fixed point: the least that knows
   hysteresis.

     i       = map(force, gap)
     current = i + half(force, gap)*bounded((i - b)/radius)

   half is half of the loop's width, bounded(x) the number of -1..1 nearest to x, and b the play of
   i with the half-width radius: it moves only as far as |i - b| would exceed radius. A force that
   has risen for long has the current of the ascending branch, one that has fallen for long that of
   the descending branch.

   At every tick: solve once or more, limit and apply the current, then commit what was applied.
   solve does not touch the play. Any code is a valid play: the next commit brings it within radius
   of i.

   Signals are q31: force and current over their full scales, the gap 0..1.0 over its range. Error
   of a solve against exact arithmetic with the same entries: 20 units in the last place, and 2^-15
   of half. A commit of what was solved costs next to nothing; of another current at most
   force_segments + ANHYST_PLAY_STEPS + 6 evaluations of the law, which leave less than
   ANHYST_PLAY_NEAR units of the current in tables as they are measured, and less than 2^-13 of full
   scale in any. Nothing here allocates, waits, or loops a number of times that depends on a signal
   beyond that. */
#ifndef ANHYST_PLAY_MAP_H
#define ANHYST_PLAY_MAP_H

#include "anhyst/compensator/flags.h"
#include "anhyst/compensator/map.h"
#include "anhyst/numeric/factor.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_PLAY_STEPS 8              /* within a segment */
#define ANHYST_PLAY_LEAST_RADIUS 2097152 /* 2^-10 of full scale */
#define ANHYST_PLAY_NEAR 1024 /* units in the last place of a current that count as none */

/* What the map knows; constant. Along the force neither map + half nor map - half falls, nor
   leaves the format. */
typedef struct {
  anhyst_map_q31 map;      /* i */
  anhyst_map_q31 half;     /* as many entries, none below 0; may fall */
  int32_t radius;          /* of the play, ANHYST_PLAY_LEAST_RADIUS or more */
  anhyst_factor steepness; /* 1/(4*radius), normalised, above 0 */
} anhyst_play_law_q31;

#include "anhyst/numeric/q31.h"
#include "anhyst/compensator/generic/play_map.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
