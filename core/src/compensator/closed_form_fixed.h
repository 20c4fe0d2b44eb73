/* SPDX-License-Identifier: Apache-2.0 */
/* The table of the closed form in fixed point, for generic/closed_form.h. */
#ifndef ANHYST_CLOSED_FORM_FIXED_H
#define ANHYST_CLOSED_FORM_FIXED_H

#include "simplified_fixed.h"

typedef anhyst_spot spot;

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
static spot spot_at(const entry *words, number z)
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
static number distance_at(const entry *words, int32_t index, number part)
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
