/* SPDX-License-Identifier: Apache-2.0 */
/* The map with one play of play_map.h in floating point, with the same algorithm and the same
   block. Signals are in the units of the model. A word of the block contains the value of the
   corresponding fixed-point word. An entry or a limit is a current in the unit of the input.
   steepness is in the inverse unit, and its shift is 0. A single is in the first of its two words.
   The words of the checksum contain its halves as integers; it covers the bits of the other words,
   low byte first.

   A demand or a gap that is NaN counts as its lowest value. An applied current that is NaN or above
   1e30 in size leaves the play unchanged. */
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
  anhyst_map_f64 map; /* i */
  const double *half; /* as many entries as the map, none below 0; may fall */
  double radius;      /* of the play, above 0 */
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

/* As anhyst_play_map_init_q31. */
anhyst_status anhyst_play_map_init_f64(anhyst_play_map_f64 *c, const double *words,
                                       uint16_t capacity);
anhyst_status anhyst_play_map_init_f32(anhyst_play_map_f32 *c, const float *words,
                                       uint16_t capacity);

#ifdef __cplusplus
}
#endif
#endif
