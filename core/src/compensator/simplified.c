/* SPDX-License-Identifier: Apache-2.0 */
/* The law with a straight anhysteretic curve in its closed form: exact for a step of any size.

   While held (p < 0), p rises in proportion to the flux. Beyond, z = -ln v + nu*v - nu counts the
   distance from p = 0, where v = 1 - p; a table over z gives p back. Its segments double from
   octave to octave, since the curve is sharp at z = 0 and flat far out. The distance is kept in
   the memory as long as the direction stays, so that steps far below a unit in the last place of p
   are not lost; after a reversal it is found by searching the same table, so that there and back
   agree. */
#include "block.h"
#include "closed.h"

/* Octave and segment of a table index. */
static uint16_t first_bits(const int16_t *words)
{
  return (uint16_t)(31 - words[ANHYST_WORD_SIMPLE_OCTAVES]);
}

/* p over z, q27 in, q30 out. z >= 0. */
static int32_t p_of(const int16_t *words, int32_t z)
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
  anhyst_spot spot;
  spot.at = words + words[ANHYST_WORD_SIMPLE_CURVE] + index + inside;
  spot.part = width >= 15U ? rest >> (width - 15U) : (int32_t)((uint32_t)rest << (15U - width));
  return anhyst_value_at(spot);
}

/* z over p, q30 in, q27 out. 0 <= p <= 1. */
static int32_t z_of(const int16_t *words, int32_t p)
{
  const int16_t *table = words + words[ANHYST_WORD_SIMPLE_CURVE];
  const uint16_t n = (uint16_t)words[ANHYST_WORD_SIMPLE_SEGMENTS];
  const uint16_t segments = (uint16_t)((words[ANHYST_WORD_SIMPLE_OCTAVES] + 1) << n);
  const int16_t level = (int16_t)((p >> 15) > ANHYST_Q15_MAX ? ANHYST_Q15_MAX : p >> 15);
  uint16_t index = 0;
  for (uint16_t step = (uint16_t)(8U << n); step > 0U; step = (uint16_t)(step >> 1)) {
    if (index + step < segments && table[index + step] <= level) {
      index = (uint16_t)(index + step);
    }
  }
  const int32_t rise = (int32_t)table[index + 1] - table[index];
  const int32_t over = p - (int32_t)table[index] * 32768;
  const int32_t part = rise > 0 ? anhyst_clamp(over / rise, 0, 32768) : 0;
  const uint16_t octave = (uint16_t)(index >> n);
  const uint16_t bits = (uint16_t)(first_bits(words) + (octave > 0U ? octave - 1U : 0U));
  const uint16_t width = (uint16_t)(bits - n);
  const uint32_t inside = index - ((uint32_t)octave << n);
  const uint32_t fraction =
      width >= 15U ? (uint32_t)part << (width - 15U) : (uint32_t)part >> (15U - width);
  const uint32_t z = (octave > 0U ? (uint32_t)1 << bits : 0U) + (inside << width) + fraction;
  return z > (uint32_t)ANHYST_Q31_MAX ? ANHYST_Q31_MAX : (int32_t)z;
}

/* way*weight*2^shift of a way that is not negative, saturates. A short way is shifted first, so
   that a tiny step loses no more than a unit in the last place. */
static int32_t stretched(int32_t way, int16_t weight, int16_t shift)
{
  const uint16_t n = (uint16_t)shift;
  if ((way >> (31U - n)) == 0) {
    return anhyst_scale((int32_t)((uint32_t)way << n), weight);
  }
  return anhyst_shl_q31(anhyst_scale(way, weight), n);
}

static void advance(const int16_t *words, anhyst_simplified_memory *start, int32_t way,
                    anhyst_simplified_memory *to)
{
  int32_t distance =
      stretched(way, words[ANHYST_WORD_SIMPLE_RATE], words[ANHYST_WORD_SIMPLE_RATE_SHIFT]);
  int32_t z = 0;
  to->flux = start->flux;
  to->z = 0;
  if (start->u < 0) {
    const int32_t held =
        stretched(way, words[ANHYST_WORD_SIMPLE_HOLD], words[ANHYST_WORD_SIMPLE_HOLD_SHIFT]);
    if (held < -start->u) {
      to->u = start->u + held;
      return;
    }
    distance -= anhyst_scale(-start->u, words[ANHYST_WORD_SIMPLE_REST]) >> 2;
    distance = distance > 0 ? distance : 0;
  } else {
    if (start->z <= 0) {
      start->z = z_of(words, start->u);
    }
    z = start->z;
  }
  z = anhyst_add_q31(z, distance);
  const int32_t p = p_of(words, z);
  to->u = p > start->u ? p : start->u;
  to->z = z;
}

static int32_t simplified_field(anhyst_compensator *c) { return anhyst_closed_field(c, advance); }

static int32_t simplified_flux(anhyst_compensator *c, int32_t current)
{
  return anhyst_closed_flux(c, current, advance);
}

static int simplified_is_valid(const int16_t *words)
{
  const int16_t octaves = words[ANHYST_WORD_SIMPLE_OCTAVES];
  const int16_t n = words[ANHYST_WORD_SIMPLE_SEGMENTS];
  return anhyst_closed_is_valid(words) && anhyst_within(octaves, 4, 14) && anhyst_within(n, 2, 6) &&
         anhyst_table_rises(words, words[ANHYST_WORD_SIMPLE_CURVE],
                            (int16_t)(((octaves + 1) << n) + 1), 0, ANHYST_Q15_MAX);
}

const anhyst_kernel anhyst_kernel_simplified = {ANHYST_KIND_SIMPLIFIED,
                                                simplified_field,
                                                simplified_flux,
                                                simplified_is_valid,
                                                anhyst_closed_carry,
                                                0,
                                                0,
                                                0};
