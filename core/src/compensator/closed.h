/* SPDX-License-Identifier: Apache-2.0 */
/* What the closed form and the paper's Euler form share: the law with a straight anhysteretic
   curve (eqs. 19 and 20), reduced to one state u in -1..1 that follows the flux. In the direction
   of travel, with p = u and v = 1 - p,

     dp/dflux = hold = rate/(1-nu)          while p < 0
     dp/dflux = rate*v/(1 - nu*v)           after that                    */
#ifndef ANHYST_CLOSED_H
#define ANHYST_CLOSED_H

#include "anhyst/compensator/compensator.h"
#include "lookup.h"

/* The steepest dp/dflux there is, 2048: what a weight with an exponent can say. */
#define ANHYST_LAG_SLOPE_MAX ((int32_t)2097152)

/* dp/dflux in 1/1024, 0..ANHYST_LAG_SLOPE_MAX. |p| <= 1, q30. */
static inline int32_t anhyst_lag_slope(const int16_t *words, int32_t p)
{
  if (p < 0) {
    return anhyst_shl_q31(words[ANHYST_WORD_SIMPLE_HOLD],
                          (uint16_t)words[ANHYST_WORD_SIMPLE_HOLD_SHIFT]) >>
           6;
  }
  const int32_t v = (ANHYST_Q30_ONE - p) >> 15; /* q15 */
  const int32_t rest = words[ANHYST_WORD_SIMPLE_REST];
  const int32_t below = rest + (((32768 - v) * (32767 - rest)) >> 15); /* 1 - nu*v, q15 */
  if (v == 0) {
    return 0;
  }
  /* The rate is that of z, which is counted in eighths. */
  const int32_t ratio =
      anhyst_shl_q31(anhyst_quotient(v, below), (uint16_t)words[ANHYST_WORD_SIMPLE_RATE_SHIFT]);
  const int32_t slope = anhyst_scale(ratio, words[ANHYST_WORD_SIMPLE_RATE]) >> 3;
  return slope > ANHYST_LAG_SLOPE_MAX ? ANHYST_LAG_SLOPE_MAX : slope;
}

/* The words that both kinds have. */
int anhyst_closed_is_valid(const int16_t *words);

/* Brings a memory to another block of its kind: what the iron has of its width stays; how far it
   came since is found again. */
void anhyst_closed_carry(anhyst_compensator *c, const int16_t *words, int32_t flux);

/* Where a way in flux leads from the start of a rising path; way >= 0. What of the start is not
   known is filled in, so that it is found once for all ways from there. */
typedef void anhyst_advance(const int16_t *words, anhyst_simplified_memory *start, int32_t way,
                            anhyst_simplified_memory *to);

/* The two functions of a kernel, given how it advances. */
int32_t anhyst_closed_field(anhyst_compensator *c, anhyst_advance *advance);
int32_t anhyst_closed_flux(anhyst_compensator *c, int32_t current, anhyst_advance *advance);

#endif
