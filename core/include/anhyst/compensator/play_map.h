/* SPDX-License-Identifier: Apache-2.0 */
/* A map of the current over force and gap with one play operator, in fixed point: the simplest
   hysteresis law.

     i       = map(force, gap)
     current = i + half(force, gap)*bounded((i - b)/radius)

   The table `half` contains half the width of the loop, and bounded(x) limits x to -1..1. b is the
   position of the play: it moves only as far as |i - b| would otherwise exceed the threshold
   radius. After a long rise of the force, the current is on the ascending branch, and after a long
   fall on the descending branch.

   In each tick, call solve, limit and apply the current, then commit the current that was applied.
   solve does not move the play. Any number is a valid position of the play: the next commit limits
   its distance from i to radius.

   Signals are q31. Force and current are fractions of their full scales; a gap of 0..1.0 is the
   range of gaps. The error of a solve against exact arithmetic with the same entries is 20 LSB plus
   2^-15 of the value half. A commit of the solved current is a copy. A commit of another current
   evaluates the law at most force_segments + 6 times, and then takes at most ANHYST_PLAY_STEPS
   Newton steps. The remaining error of the current is less than ANHYST_PLAY_NEAR LSB for measured
   tables, and less than 2^-13 of full scale for any table. solve and commit may be called from an
   ISR, but not nested. No function allocates memory, waits, or exceeds these bounds on loops. */
#ifndef ANHYST_PLAY_MAP_H
#define ANHYST_PLAY_MAP_H

#include "anhyst/compensator/flags.h"
#include "anhyst/compensator/layout.h"
#include "anhyst/compensator/map.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_PLAY_STEPS 8   /* maximum number of Newton steps in a segment */
#define ANHYST_PLAY_NEAR 1024 /* current error that counts as zero, LSB of q31 */

/* The parameters, read from a block (layout.h). Along the force, map + half and map - half never
   fall, and stay within the format. */
typedef struct {
  anhyst_map_q31 map;  /* map of the current i */
  const int16_t *half; /* q15: half the loop width, >= 0; as many entries as the map, may fall */
  int32_t radius;      /* threshold of the play, at least 2^-10 */
  int16_t steepness;   /* 1/(4*radius) = steepness/65536*2^shift, shift 0..9 */
  uint16_t shift;
} anhyst_play_law_q31;

#include "anhyst/numeric/q31.h"
#include "anhyst/compensator/generic/play_map.h"
#include "anhyst/numeric/no_format.h"

/* Initialises the map from a parameter block, with a play position of 0. Returns ANHYST_OK, or
   ANHYST_BAD_PARAMETER if the block is not valid: magic, layout, kind, length (at most `capacity`
   words), checksum, all ranges and all tables. After an error, *c is unchanged. The block must live
   as long as the map. Reads every word: must not be called from an ISR. */
anhyst_status anhyst_play_map_init_q31(anhyst_play_map_q31 *c, const int16_t *words,
                                       uint16_t capacity);

#ifdef __cplusplus
}
#endif
#endif
