/* SPDX-License-Identifier: Apache-2.0 */
/* What the closed form and the paper's Euler form share: the law with a straight anhysteretic
   curve (eqs. 19 and 20), reduced to one state u in -1..1 that follows the flux. In the direction
   of travel, with p = u and v = 1 - p,

     dp/dflux = hold = rate/(1-nu)          while p < 0
     dp/dflux = rate*v/(1 - nu*v)           after that                    */
#ifndef ANHYST_CLOSED_H
#define ANHYST_CLOSED_H

#include "anhyst/compensator.h"
#include "lookup.h"

/* A weight with an exponent, as a slope in 1/1024. */
static inline int32_t anhyst_steepness(int16_t weight, int16_t shift)
{
  const int32_t slope = anhyst_shl_q31(weight, (uint16_t)shift) / 64;
  return slope > ANHYST_SLOPE_MAX ? ANHYST_SLOPE_MAX : slope;
}

/* dp/dflux in 1/1024, largest ANHYST_SLOPE_MAX. |p| <= 1, q30. */
static inline int32_t anhyst_lag_slope(const int16_t *words, int32_t p)
{
  if (p < 0) {
    return anhyst_steepness(words[ANHYST_WORD_SIMPLE_HOLD], words[ANHYST_WORD_SIMPLE_HOLD_SHIFT]);
  }
  const int32_t v = (ANHYST_Q30_ONE - p) >> 15; /* q15 */
  const int32_t rest = words[ANHYST_WORD_SIMPLE_REST];
  const int32_t below = rest + (((32768 - v) * (32767 - rest)) >> 15); /* 1 - nu*v, q15 */
  if (v == 0) {
    return 0;
  }
  const int32_t ratio = anhyst_quotient(v, below) >> 6;
  const int32_t rate =
      anhyst_steepness(words[ANHYST_WORD_SIMPLE_RATE], words[ANHYST_WORD_SIMPLE_RATE_SHIFT]) *
      8; /* of z, which is counted in eighths */
  const int32_t slope = (ratio > ANHYST_SLOPE_MAX ? ANHYST_SLOPE_MAX : ratio) *
                        (rate > ANHYST_SLOPE_MAX ? ANHYST_SLOPE_MAX : rate);
  const int32_t whole = slope >> 10;
  return whole > ANHYST_SLOPE_MAX ? ANHYST_SLOPE_MAX : whole;
}

/* The words that both kinds have. */
int anhyst_closed_sound(const int16_t *words);

/* Where a way in flux leads from a memory, on a rising path; way >= 0. */
typedef void anhyst_advance(const int16_t *words, const anhyst_memory *from, int32_t way,
                            anhyst_memory *to);

/* The two functions of a kernel, given how it advances. */
int32_t anhyst_closed_field(const int16_t *words, const anhyst_memory *from, int32_t flux,
                            anhyst_memory *to, anhyst_advance *advance);
int32_t anhyst_closed_flux(const int16_t *words, const anhyst_memory *from, const anhyst_arms *arms,
                           int32_t current, anhyst_memory *to, anhyst_advance *advance);

#endif
