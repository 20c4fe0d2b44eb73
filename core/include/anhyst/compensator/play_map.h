/* SPDX-License-Identifier: Apache-2.0 */
/* A map of the current over force and gap with one play, in fixed point: the simplest law with
   hysteresis.

     i       = map(force, gap)
     current = i + half(force, gap)*bounded((i - b)/radius)

   half is half of the loop's width, bounded(x) the number of -1..1 nearest to x, and b the play of
   i with the half-width radius: it moves only as far as |i - b| would exceed radius. A force that
   has risen for long has the current of the ascending branch. A force that has fallen for long has
   that of the descending branch.

   At every tick: solve once or more, limit and apply the current, then commit what was applied.
   solve does not move the play. Any code is a valid play: the next commit brings it within radius
   of i.

   Signals are q31: force and current over their full scales, the gap 0..1.0 over its range. Error
   of a solve against exact arithmetic with the same entries: 20 units in the last place, and 2^-15
   of half. A commit of what was solved is a copy. A commit of another current evaluates the law at
   most force_segments + 6 times, and then takes at most ANHYST_PLAY_STEPS steps of Newton. The
   remaining error of the current is less than ANHYST_PLAY_NEAR units in tables as they are
   measured, and less than 2^-13 of full scale in any. solve and commit may be called from an
   interrupt, one at a time. Nothing here allocates, waits, or loops a number of times that depends
   on a signal beyond these bounds. */
#ifndef ANHYST_PLAY_MAP_H
#define ANHYST_PLAY_MAP_H

#include "anhyst/compensator/flags.h"
#include "anhyst/compensator/layout.h"
#include "anhyst/compensator/map.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_PLAY_STEPS 8   /* at most, within a segment */
#define ANHYST_PLAY_NEAR 1024 /* units in the last place of a current that count as none */

/* The parameters, read from a block (layout.h). Along the force neither map + half nor map - half
   falls, nor leaves the format. */
typedef struct {
  anhyst_map_q31 map;  /* i */
  const int16_t *half; /* q15: as many entries, none below 0; may fall */
  int32_t radius;      /* of the play, 2^-10 or more */
  int16_t steepness;   /* 1/(4*radius) is steepness/65536*2^shift, shift 0..9 */
  uint16_t shift;
} anhyst_play_law_q31;

#include "anhyst/numeric/q31.h"
#include "anhyst/compensator/generic/play_map.h"
#include "anhyst/numeric/no_format.h"

/* Starts with the parameter block of a map with a play, and a play of 0. Returns ANHYST_OK, or
   ANHYST_BAD_PARAMETER if the block is not valid: magic, layout, kind, length of at most capacity
   words, checksum, every range and every table. Nothing is changed then. The block must live as
   long as the map. Reads every word: must not be called from an interrupt. */
anhyst_status anhyst_play_map_init_q31(anhyst_play_map_q31 *c, const int16_t *words,
                                       uint16_t capacity);

#ifdef __cplusplus
}
#endif
#endif
