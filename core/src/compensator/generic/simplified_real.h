/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic of the simplified law in floating point, for simplified.h and closed_form.h.
   ../simplified_fixed.h describes the functions. */

#include "block_real.h"

#define ONE ((number)1)
#define CURRENT_MAX ((number)1)
#define DISTANCE_MAX ((number)16)
#define MAX_WEIGHT_SHIFT 0

#define RESIDUAL_DEADBAND ((number)4 * NUMBER_EPS)

static inline number sum(number a, number b) { return a + b; }
static inline number difference(number a, number b) { return a - b; }
static inline number scaled(number a, entry weight) { return a * weight; }
static inline number weight_to_number(entry weight) { return weight; }

static inline number hold_change(const entry *words, number travel)
{
  return travel * words[ANHYST_WORD_SIMPLE_HOLD];
}

static inline number rate_of(const entry *words)
{
  return (number)8 * words[ANHYST_WORD_SIMPLE_RATE];
}

static inline number distance_of_travel(const entry *words, number travel)
{
  return travel * rate_of(words);
}

static inline number hold_distance(const entry *words, number state)
{
  return -state * words[ANHYST_WORD_SIMPLE_REST];
}

static inline number lag_slope(const entry *words, number state)
{
  const number v = (number)1 - state;
  if (state < (number)0) {
    return words[ANHYST_WORD_SIMPLE_HOLD];
  }
  return rate_of(words) * v / (state + words[ANHYST_WORD_SIMPLE_REST] * v);
}

static inline number current_slope(const arms_type *arms, number slope)
{
  return arms->flux_arm + arms->field_arm * slope;
}

static inline number newton_step(number residual, number slope) { return residual / slope; }

/* ---- the table of the closed form ---- */

typedef struct {
  const entry *at; /* lower end of the segment */
  number part;     /* position on the segment, 0..1 */
} spot;

static inline number value_at(spot at) { return at.at[0] + (at.at[1] - at.at[0]) * at.part; }
static inline number word_value(entry word) { return word; }

static inline number part_at_rise(number rise_up_to_part, entry low, entry high)
{
  return high > low ? clamp(rise_up_to_part / (high - low), (number)0, (number)1) : (number)0;
}

/* Returns the distance at which the first octave starts. */
static inline number first_octave(const entry *words)
{
  return DISTANCE_MAX / (number)((int32_t)1 << (int32_t)words[ANHYST_WORD_SIMPLE_OCTAVES]);
}

/* Returns the position of a distance of 0..DISTANCE_MAX. */
static spot locate_distance(const entry *words, number z)
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

static number distance_at_part(const entry *words, int32_t index, number part)
{
  const int32_t segments = (int32_t)1 << (int32_t)words[ANHYST_WORD_SIMPLE_SEGMENTS];
  const int32_t octave = index / segments;
  const number inside = ((number)(index % segments) + part) / (number)segments;
  const int32_t octaves_before = octave > 0 ? octave - 1 : 0;
  const number width = first_octave(words) * (number)((int32_t)1 << octaves_before);
  return octave > 0 ? width + inside * width : inside * width;
}
