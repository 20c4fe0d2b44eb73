/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic of the simplified law and of Euler's form in fixed point, for generic/simplified.h and
   generic/closed_form.h. Flux, hysteresis field and current are q30, distances q27, slopes q10. */
#ifndef ANHYST_SIMPLIFIED_FIXED_H
#define ANHYST_SIMPLIFIED_FIXED_H

#include "formats/fixed.h"

#include "formats/block_fixed.h"
#include "lookup.h"

#define ONE ANHYST_Q30_ONE
#define MAX_CURRENT (ANHYST_Q30_ONE - 1)
#define MAX_DISTANCE ANHYST_Q31_MAX
#define MAX_WEIGHT_SHIFT 12
#define MAX_STATE_SLOPE ((int32_t)2097152) /* 2048, the limit of a weight with exponent 12 */

/* Largest difference of two currents that rounding errors alone can cause. */
#define RESIDUAL_DEADBAND 128

static inline number sum(number a, number b) { return anhyst_add_q31(a, b); }
static inline number difference(number a, number b) { return anhyst_sub_q31(a, b); }
static inline number absolute(number a) { return anhyst_abs_q31(a); }
static inline number clamp(number a, number low, number high) { return anhyst_clamp(a, low, high); }
static inline number scaled(number a, entry weight) { return anhyst_scale(a, weight); }

/* Converts a weight of the block to q30. */
static inline number weight_to_number(entry weight) { return (number)weight * 16384; }

/* Returns travel*weight*2^shift. Requires travel >= 0. Saturates. A short travel is shifted before
   the product, so that a tiny step loses at most 1 LSB. */
static inline number scale_travel(number travel, entry weight, entry shift)
{
  const uint16_t n = (uint16_t)shift;
  if ((travel >> (31U - n)) == 0) {
    return anhyst_scale((int32_t)((uint32_t)travel << n), weight);
  }
  return anhyst_shl_q31(anhyst_scale(travel, weight), n);
}

/* Returns the change of u for a travel >= 0 of the flux, on the straight line after a reversal. */
static inline number linear_state_change(const entry *words, number travel)
{
  return scale_travel(travel, words[ANHYST_WORD_SIMPLE_HOLD], words[ANHYST_WORD_SIMPLE_HOLD_SHIFT]);
}

/* Returns the distance z for a travel of the flux. Requires travel >= 0. */
static inline number distance_of_travel(const entry *words, number travel)
{
  return scale_travel(travel, words[ANHYST_WORD_SIMPLE_RATE], words[ANHYST_WORD_SIMPLE_RATE_SHIFT]);
}

/* Returns the distance z from a negative u to u = 0. */
static inline number linear_distance(const entry *words, number state)
{
  return anhyst_scale(-state, words[ANHYST_WORD_SIMPLE_REST]) >> 2;
}

/* Returns the slope of u over the flux, 0..MAX_STATE_SLOPE. Requires |state| <= ONE. */
static inline number state_slope(const entry *words, number state)
{
  if (state < 0) {
    return anhyst_shl_q31(words[ANHYST_WORD_SIMPLE_HOLD],
                          (uint16_t)words[ANHYST_WORD_SIMPLE_HOLD_SHIFT]) >>
           6;
  }
  const int32_t v = (ANHYST_Q30_ONE - state) >> 15; /* q15 */
  const int32_t one_minus_nu = words[ANHYST_WORD_SIMPLE_REST];
  const int32_t denominator =
      one_minus_nu + (((32768 - v) * (32767 - one_minus_nu)) >> 15); /* 1 - nu*v, q15 */
  if (v == 0) {
    return 0;
  }
  /* The block states the rate for a distance in units of 8. */
  const int32_t ratio = anhyst_shl_q31(anhyst_quotient(v, denominator),
                                       (uint16_t)words[ANHYST_WORD_SIMPLE_RATE_SHIFT]);
  const int32_t slope = anhyst_scale(ratio, words[ANHYST_WORD_SIMPLE_RATE]) >> 3;
  return slope > MAX_STATE_SLOPE ? MAX_STATE_SLOPE : slope;
}

/* Returns the slope of the current over the flux, in units of 1/65536. */
static inline number current_slope(const arms_type *arms, number slope)
{
  return arms->flux_arm + anhyst_scale(slope * 64, arms->field_arm);
}

/* Returns residual/slope with 14 bits. Requires residual != 0 and slope > 0. */
static inline number newton_step(number residual, number slope)
{
  const int32_t travel = anhyst_quotient(anhyst_abs_q31(residual), slope);
  return residual < 0 ? -travel : travel;
}

/* ---- table of the closed form ---- */

typedef anhyst_table_position table_position; /* position in the table */

static inline number table_value(table_position position) { return anhyst_table_value(position); }
static inline number word_value(entry word) { return (number)word * 32768; }

/* Returns the fraction of a segment at which its line has risen by an amount, q15, rounded down. */
static inline number fraction_at_rise(number partial_rise, entry low, entry high)
{
  const int32_t rise = (int32_t)high - low;
  return rise > 0 ? anhyst_clamp(partial_rise / rise, 0, 32768) : 0;
}

/* Returns n: the first octave starts at the distance 2^n. */
static inline uint16_t first_octave_bits(const entry *words)
{
  return (uint16_t)(31 - words[ANHYST_WORD_SIMPLE_OCTAVES]);
}

/* Returns the table position of a distance. Requires z >= 0. */
static inline table_position locate_distance(const entry *words, number z)
{
  const uint16_t n = (uint16_t)words[ANHYST_WORD_SIMPLE_SEGMENTS];
  uint16_t bits = first_octave_bits(words);
  int32_t index = 0;
  int32_t remainder = z;
  if ((z >> bits) != 0) {
    const uint16_t top = (uint16_t)(30U - anhyst_headroom(z)) & 31U;
    index = (int32_t)((uint32_t)(top - bits + 1U) << n);
    bits = top;
    remainder = z - (int32_t)((uint32_t)1 << top);
  }
  const uint16_t width = (uint16_t)(bits - n);
  const int32_t segment = remainder >> width;
  remainder -= (int32_t)((uint32_t)segment << width);
  table_position found;
  found.segment = words + words[ANHYST_WORD_SIMPLE_CURVE] + index + segment;
  found.fraction =
      width >= 15U ? remainder >> (width - 15U) : (int32_t)((uint32_t)remainder << (15U - width));
  return found;
}

/* Returns the distance at a fraction of a segment, rounded down. Saturates. */
static inline number distance_at_fraction(const entry *words, int32_t index, number fraction)
{
  const uint16_t n = (uint16_t)words[ANHYST_WORD_SIMPLE_SEGMENTS];
  const uint16_t octave = (uint16_t)(index >> n);
  const uint16_t bits = (uint16_t)(first_octave_bits(words) + (octave > 0U ? octave - 1U : 0U));
  const uint16_t width = (uint16_t)(bits - n);
  const uint32_t segment = (uint32_t)index - ((uint32_t)octave << n);
  const uint32_t offset =
      width >= 15U ? (uint32_t)fraction << (width - 15U) : (uint32_t)fraction >> (15U - width);
  const uint32_t z = (octave > 0U ? (uint32_t)1 << bits : 0U) + (segment << width) + offset;
  return z > (uint32_t)ANHYST_Q31_MAX ? ANHYST_Q31_MAX : (int32_t)z;
}

#endif
