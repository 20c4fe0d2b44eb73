/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic of the simplified law in floating point, for simplified.h and closed_form.h. */

#include "block_real.h"

#define ONE ((number)1)
#define CURRENT_MAX ((number)1)
#define DISTANCE_MAX ((number)16)
#define MAX_WEIGHT_SHIFT 0

/* The largest difference of two currents that rounding alone can cause. */
#define RESIDUAL_DEADBAND ((number)4 * NUMBER_EPS)

static inline number sum(number a, number b) { return a + b; }
static inline number difference(number a, number b) { return a - b; }

static inline number scaled(number a, entry weight) { return a * weight; }

/* The number of a weight of the block. */
static inline number fraction_of(entry weight) { return weight; }

/* The change of the bounded state on a way of the flux while it is held. way >= 0. */
static inline number held_change(const entry *words, number way)
{
  return way * words[ANHYST_WORD_SIMPLE_HOLD];
}

/* The slope of the distance over the flux. */
static inline number rate_of(const entry *words)
{
  return (number)8 * words[ANHYST_WORD_SIMPLE_RATE];
}

/* The distance on a way of the flux. way >= 0. */
static inline number distance_on(const entry *words, number way) { return way * rate_of(words); }

/* The distance on the way from a bounded state below 0 to 0. */
static inline number held_distance(const entry *words, number state)
{
  return -state * words[ANHYST_WORD_SIMPLE_REST];
}

/* Slope of the bounded state over the flux on a rising path. |state| <= 1. */
static inline number lag_slope(const entry *words, number state)
{
  const number v = (number)1 - state;
  if (state < (number)0) {
    return words[ANHYST_WORD_SIMPLE_HOLD];
  }
  return rate_of(words) * v / (state + words[ANHYST_WORD_SIMPLE_REST] * v);
}

/* Slope of the current over the flux. */
static inline number current_slope(const arms_type *arms, number slope)
{
  return arms->flux_arm + arms->field_arm * slope;
}

static inline number newton_step(number missing, number slope) { return missing / slope; }

/* ---- the table of the closed form ---- */

/* A position in the table. */
typedef struct {
  const entry *at; /* lower end of the segment */
  number part;     /* of the segment, 0..1 */
} spot;

static inline number value_at(spot at) { return at.at[0] + (at.at[1] - at.at[0]) * at.part; }

static inline number level_of(entry word) { return word; }

/* The part of a segment at which its line has risen by this much, 0..1. */
static inline number part_of(number risen, entry low, entry high)
{
  return high > low ? clamp(risen / (high - low), (number)0, (number)1) : (number)0;
}

/* Distance at which the first octave begins. */
static inline number first_octave(const entry *words)
{
  return DISTANCE_MAX / (number)((int32_t)1 << (int32_t)words[ANHYST_WORD_SIMPLE_OCTAVES]);
}

/* The spot of a distance of 0..DISTANCE_MAX. */
static spot spot_at(const entry *words, number z)
{
  const int32_t octaves = (int32_t)words[ANHYST_WORD_SIMPLE_OCTAVES];
  const int32_t segments = (int32_t)1 << (int32_t)words[ANHYST_WORD_SIMPLE_SEGMENTS];
  number begin = (number)0;
  number width = first_octave(words);
  int32_t octave = 0;
  for (; octave < octaves && z >= begin + width; octave++) {
    begin += width;
    width = begin;
  }
  const number place = (z - begin) / width * (number)segments;
  const int32_t index = place < (number)segments ? (int32_t)place : segments - 1;
  const int32_t first = (int32_t)words[ANHYST_WORD_SIMPLE_CURVE] + octave * segments;
  const spot found = {words + first + index, place - (number)index};
  return found;
}

/* The distance at a part of a segment. */
static number distance_at(const entry *words, int32_t index, number part)
{
  const int32_t segments = (int32_t)1 << (int32_t)words[ANHYST_WORD_SIMPLE_SEGMENTS];
  const int32_t octave = index / segments;
  const number inside = ((number)(index % segments) + part) / (number)segments;
  const int32_t octaves_before = octave > 0 ? octave - 1 : 0;
  const number width = first_octave(words) * (number)((int32_t)1 << octaves_before);
  return octave > 0 ? width + inside * width : inside * width;
}
