/* SPDX-License-Identifier: Apache-2.0 */
/* The map with one play operator of play_map.h in floating point, with the same algorithm and the
   same block. Signals are in the units of the model. A word of the block contains the value of the
   corresponding fixed-point word. A table entry or a limit is a current in the unit of the input.
   The word ANHYST_WORD_PLAY_STEEPNESS is in the inverse of this unit, and its shift is 0. A number
   of the format "single" is in the first of its two words. The two words of the checksum contain
   its halves as integers. The checksum covers the bits of all other words, low byte first.

   A demand or a gap that is NaN counts as its lowest value. An applied current that is NaN, or
   whose magnitude exceeds 1e30, leaves the play unchanged. */
#ifndef ANHYST_PLAY_MAP_REAL_H
#define ANHYST_PLAY_MAP_REAL_H

#include "anhyst/compensator/flags.h"
#include "anhyst/compensator/layout.h"
#include "anhyst/compensator/map_real.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The parameters, read from a block. Along the force, map + half and map - half never fall. */
typedef struct {
  anhyst_map_f64 map; /* map of the current i */
  const double *half; /* half the loop width, >= 0; as many entries as the map, may fall */
  double radius;      /* threshold of the play, > 0 */
  double per_radius;  /* 1/radius */
} anhyst_play_law_f64;

typedef struct {
  anhyst_map_f32 map;
  const float *half;
  float radius;
  float per_radius;
} anhyst_play_law_f32;

#include "anhyst/numeric/f64.h"
#include "anhyst/compensator/generic/play_map.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/compensator/generic/play_map.h"
#include "anhyst/numeric/no_format.h"

/* Work as anhyst_play_map_init_q31. */
anhyst_status anhyst_play_map_init_f64(anhyst_play_map_f64 *c, const double *words,
                                       uint16_t capacity);
anhyst_status anhyst_play_map_init_f32(anhyst_play_map_f32 *c, const float *words,
                                       uint16_t capacity);

#ifdef __cplusplus
}
#endif
#endif
