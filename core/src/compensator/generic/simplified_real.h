/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic of the simplified law in floating point, for simplified.h and closed_form.h.
   ../simplified_fixed.h describes the functions. */

#include "block_real.h"

#define ONE ((number)1)
#define MAX_CURRENT ((number)1)
#define MAX_DISTANCE ((number)16)
#define MAX_WEIGHT_SHIFT 0

#define RESIDUAL_DEADBAND ((number)4 * NUMBER_EPS)

static inline number sum(number a, number b) { return a + b; }
static inline number difference(number a, number b) { return a - b; }
static inline number scaled(number a, entry weight) { return a * weight; }
static inline number weight_to_number(entry weight) { return weight; }

static inline number linear_state_change(const entry *words, number travel)
{
  return travel * words[ANHYST_WORD_SIMPLE_HOLD];
}

static inline number distance_rate(const entry *words)
{
  return (number)8 * words[ANHYST_WORD_SIMPLE_RATE];
}

static inline number distance_of_travel(const entry *words, number travel)
{
  return travel * distance_rate(words);
}

static inline number linear_distance(const entry *words, number state)
{
  return -state * words[ANHYST_WORD_SIMPLE_REST];
}

static inline number state_slope(const entry *words, number state)
{
  const number v = (number)1 - state;
  if (state < (number)0) {
    return words[ANHYST_WORD_SIMPLE_HOLD];
  }
  return distance_rate(words) * v / (state + words[ANHYST_WORD_SIMPLE_REST] * v);
}

static inline number current_slope(const arms_type *arms, number slope)
{
  return arms->flux_arm + arms->field_arm * slope;
}

static inline number newton_step(number residual, number slope) { return residual / slope; }

/* ---- table of the closed form ---- */

typedef struct {
  const entry *segment; /* lower end of the segment */
  number fraction;      /* position within the segment, 0..1 */
} table_position;

static inline number table_value(table_position position)
{
  return position.segment[0] + (position.segment[1] - position.segment[0]) * position.fraction;
}
static inline number word_value(entry word) { return word; }

static inline number fraction_at_rise(number partial_rise, entry low, entry high)
{
  return high > low ? clamp(partial_rise / (high - low), (number)0, (number)1) : (number)0;
}

/* Returns the distance at which the first octave starts, which is also the width of this octave. */
static inline number first_octave_width(const entry *words)
{
  return MAX_DISTANCE / (number)((int32_t)1 << (int32_t)words[ANHYST_WORD_SIMPLE_OCTAVES]);
}

/* Returns the table position of a distance of 0..MAX_DISTANCE. */
static table_position locate_distance(const entry *words, number z)
{
  const int32_t octaves = (int32_t)words[ANHYST_WORD_SIMPLE_OCTAVES];
  const int32_t segments = (int32_t)1 << (int32_t)words[ANHYST_WORD_SIMPLE_SEGMENTS];
  number begin = (number)0;
  number width = first_octave_width(words);
  int32_t octave = 0;
  for (; octave < octaves && z >= begin + width; octave++) {
    begin += width;
    width = begin;
  }
  const number scaled_distance = (z - begin) / width * (number)segments;
  const int32_t index =
      scaled_distance < (number)segments ? (int32_t)scaled_distance : segments - 1;
  const int32_t first = (int32_t)words[ANHYST_WORD_SIMPLE_CURVE] + octave * segments;
  const table_position found = {words + first + index, scaled_distance - (number)index};
  return found;
}

static number distance_at_fraction(const entry *words, int32_t index, number fraction)
{
  const int32_t segments = (int32_t)1 << (int32_t)words[ANHYST_WORD_SIMPLE_SEGMENTS];
  const int32_t octave = index / segments;
  const number inside = ((number)(index % segments) + fraction) / (number)segments;
  const int32_t octaves_before = octave > 0 ? octave - 1 : 0;
  const number width = first_octave_width(words) * (number)((int32_t)1 << octaves_before);
  return octave > 0 ? width + inside * width : inside * width;
}
