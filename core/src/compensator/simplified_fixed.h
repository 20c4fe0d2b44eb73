/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic of the simplified law and of Euler's in fixed point, for generic/simplified.h and
   generic/closed_form.h. Flux, bounded state and current are q30, distances q27, slopes 1/1024. */
#ifndef ANHYST_SIMPLIFIED_FIXED_H
#define ANHYST_SIMPLIFIED_FIXED_H

#include "formats/fixed.h"

#include "formats/block_fixed.h"
#include "lookup.h"

#define ONE ANHYST_Q30_ONE
#define CURRENT_MAX (ANHYST_Q30_ONE - 1)
#define DISTANCE_MAX ANHYST_Q31_MAX
#define MAX_WEIGHT_SHIFT 12
#define MAX_LAG_SLOPE ((int32_t)2097152) /* 2048: the steepest slope that a weight can say */

/* The largest difference of two currents that rounding alone can cause. */
#define RESIDUAL_DEADBAND 128

static inline number sum(number a, number b) { return anhyst_add_q31(a, b); }
static inline number difference(number a, number b) { return anhyst_sub_q31(a, b); }
static inline number absolute(number a) { return anhyst_abs_q31(a); }
static inline number clamp(number a, number low, number high) { return anhyst_clamp(a, low, high); }

/* a times a weight, floor. */
static inline number scaled(number a, entry weight) { return anhyst_scale(a, weight); }

/* The number of a weight of the block: a fraction of 1.0. */
static inline number fraction_of(entry weight) { return (number)weight * 16384; }

/* way*weight*2^shift of a way that is not negative, saturates. A short way is shifted first, so
   that a tiny step loses no more than a unit in the last place. */
static inline number stretched(number way, entry weight, entry shift)
{
  const uint16_t n = (uint16_t)shift;
  if ((way >> (31U - n)) == 0) {
    return anhyst_scale((int32_t)((uint32_t)way << n), weight);
  }
  return anhyst_shl_q31(anhyst_scale(way, weight), n);
}

/* The change of the bounded state on a way of the flux while it is held. way >= 0. */
static inline number held_change(const entry *words, number way)
{
  return stretched(way, words[ANHYST_WORD_SIMPLE_HOLD], words[ANHYST_WORD_SIMPLE_HOLD_SHIFT]);
}

/* The distance on a way of the flux. way >= 0. */
static inline number distance_on(const entry *words, number way)
{
  return stretched(way, words[ANHYST_WORD_SIMPLE_RATE], words[ANHYST_WORD_SIMPLE_RATE_SHIFT]);
}

/* The distance on the way from a bounded state below 0 to 0. */
static inline number held_distance(const entry *words, number state)
{
  return anhyst_scale(-state, words[ANHYST_WORD_SIMPLE_REST]) >> 2;
}

/* Slope of the bounded state over the flux on a rising path, 0..MAX_LAG_SLOPE. |state| <= ONE. */
static inline number lag_slope(const entry *words, number state)
{
  if (state < 0) {
    return anhyst_shl_q31(words[ANHYST_WORD_SIMPLE_HOLD],
                          (uint16_t)words[ANHYST_WORD_SIMPLE_HOLD_SHIFT]) >>
           6;
  }
  const int32_t v = (ANHYST_Q30_ONE - state) >> 15; /* q15 */
  const int32_t rest = words[ANHYST_WORD_SIMPLE_REST];
  const int32_t below = rest + (((32768 - v) * (32767 - rest)) >> 15); /* 1 - nu*v, q15 */
  if (v == 0) {
    return 0;
  }
  /* The rate is that of the distance, which is counted in eighths. */
  const int32_t ratio =
      anhyst_shl_q31(anhyst_quotient(v, below), (uint16_t)words[ANHYST_WORD_SIMPLE_RATE_SHIFT]);
  const int32_t slope = anhyst_scale(ratio, words[ANHYST_WORD_SIMPLE_RATE]) >> 3;
  return slope > MAX_LAG_SLOPE ? MAX_LAG_SLOPE : slope;
}

/* Slope of the current over the flux, 1/65536. */
static inline number current_slope(const arms_type *arms, number slope)
{
  return arms->flux_arm + anhyst_scale(slope * 64, arms->field_arm);
}

/* missing/slope to 14 bits. missing is not 0, slope > 0. */
static inline number newton_step(number missing, number slope)
{
  const int32_t way = anhyst_quotient(anhyst_abs_q31(missing), slope);
  return missing < 0 ? -way : way;
}

/* ---- the table of the closed form ---- */

typedef anhyst_spot spot; /* a position in the table */

static inline number value_at(spot at) { return anhyst_value_at(at); }

static inline number level_of(entry word) { return (number)word * 32768; }

/* The part of a segment at which its line has risen by this much, q15 within 0..1, floor. */
static inline number part_of(number risen, entry low, entry high)
{
  const int32_t rise = (int32_t)high - low;
  return rise > 0 ? anhyst_clamp(risen / rise, 0, 32768) : 0;
}

/* The first octave begins at the distance 2^this. */
static inline uint16_t first_bits(const entry *words)
{
  return (uint16_t)(31 - words[ANHYST_WORD_SIMPLE_OCTAVES]);
}

/* The spot of a distance. z >= 0. */
static inline spot spot_at(const entry *words, number z)
{
  const uint16_t n = (uint16_t)words[ANHYST_WORD_SIMPLE_SEGMENTS];
  uint16_t bits = first_bits(words);
  int32_t index = 0;
  int32_t rest = z;
  if ((z >> bits) != 0) {
    const uint16_t top = (uint16_t)(30U - anhyst_headroom(z)) & 31U;
    index = (int32_t)((uint32_t)(top - bits + 1U) << n);
    bits = top;
    rest = z - (int32_t)((uint32_t)1 << top);
  }
  const uint16_t width = (uint16_t)(bits - n);
  const int32_t inside = rest >> width;
  rest -= (int32_t)((uint32_t)inside << width);
  spot found;
  found.at = words + words[ANHYST_WORD_SIMPLE_CURVE] + index + inside;
  found.part = width >= 15U ? rest >> (width - 15U) : (int32_t)((uint32_t)rest << (15U - width));
  return found;
}

/* The distance at a part of a segment, floor; saturates. */
static inline number distance_at(const entry *words, int32_t index, number part)
{
  const uint16_t n = (uint16_t)words[ANHYST_WORD_SIMPLE_SEGMENTS];
  const uint16_t octave = (uint16_t)(index >> n);
  const uint16_t bits = (uint16_t)(first_bits(words) + (octave > 0U ? octave - 1U : 0U));
  const uint16_t width = (uint16_t)(bits - n);
  const uint32_t inside = (uint32_t)index - ((uint32_t)octave << n);
  const uint32_t fraction =
      width >= 15U ? (uint32_t)part << (width - 15U) : (uint32_t)part >> (15U - width);
  const uint32_t z = (octave > 0U ? (uint32_t)1 << bits : 0U) + (inside << width) + fraction;
  return z > (uint32_t)ANHYST_Q31_MAX ? ANHYST_Q31_MAX : (int32_t)z;
}

#endif
