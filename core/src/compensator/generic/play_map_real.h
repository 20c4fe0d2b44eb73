/* SPDX-License-Identifier: Apache-2.0 */
/* Operations in floating point for the templates play_block.h and play_map.h. Before it are
   map_real.h, typedefs of law_type, point and play_type, and the constant EPSILON. */

#define PLAY_STEPS 12 /* more digits than fixed point */

static int is_known(number a) { return a >= -LARGEST && a <= LARGEST; }

static number size_of(number a) { return a < 0 ? -a : a; }

static number add(number a, number b) { return a + b; }

static number subtract(number a, number b) { return a - b; }

/* The number of low..high nearest to a; low for what is not a number. */
static number limited(number a, number low, number high)
{
  if (!(a > low)) {
    return low;
  }
  return a > high ? high : a;
}

/* The nearest force of the map. For what is not a number it is 0, or the least force above. */
static number pulling(const map_type *map, number demand)
{
  if (demand >= map->force_low) {
    return limited(demand, map->force_low, map->force_high);
  }
  return demand < map->force_low ? map->force_low : limited(0, map->force_low, map->force_high);
}

/* Whether a gap is in the range, or beyond it by no more than 2^-15 of the range. */
static int is_gap(const map_type *map, number gap)
{
  const number room = (map->gap_high - map->gap_low) / 32768;
  return gap >= map->gap_low - room && gap <= map->gap_high + room;
}

/* distance/radius; |distance| is less than the radius. */
static number side_of(const law_type *law, number distance) { return distance * law->per_radius; }

/* The difference of two currents, to be compared with others of its kind. */
static number difference(number a, number b) { return a - b; }

/* numerator/denominator, at most 1; the numerator is not negative. */
static number share_of(number numerator, number denominator)
{
  return numerator < denominator ? numerator / denominator : ONE;
}

#define fraction_of share_of

/* Whether a difference of currents of these sizes is rounding. */
static int is_rounding(number left, number near, number far)
{
  return size_of(left) <= 16 * EPSILON * (size_of(near) + size_of(far));
}

/* Whether a word is this whole number. */
static int is_word(number word, uint16_t value) { return word == (number)value; }

/* Adds the bits of a word to a checksum. */
static uint32_t add_bits(uint32_t sum, number word)
{
  union {
    number word;
    pattern bits;
  } as;
  as.word = word;
  for (size_t half = 0; half < sizeof word / 2U; half++) {
    sum = anhyst_checksum_add(sum, (uint16_t)(as.bits >> (16U * half)));
  }
  return sum;
}

static number room_of(const number *words) { return words[ANHYST_WORD_SCALE_CURRENT] / 32768; }

/* Reads sizes, the ranges of force and gap, and the play. */
static int read_scales(law_type *law, const number *words)
{
  law->map.force_segments =
      (uint16_t)((uint32_t)1U << (uint16_t)words[ANHYST_WORD_PLAY_FORCE_SEGMENTS]);
  law->map.gap_segments =
      (uint16_t)((uint32_t)1U << (uint16_t)words[ANHYST_WORD_PLAY_GAP_SEGMENTS]);
  law->map.force_low = words[ANHYST_WORD_PLAY_DEMAND_LOW];
  law->map.force_high = words[ANHYST_WORD_SCALE_DEMAND];
  law->map.gap_low = words[ANHYST_WORD_SCALE_GAP_LOW];
  law->map.gap_high = words[ANHYST_WORD_SCALE_GAP_HIGH];
  law->per_radius = 4 * words[ANHYST_WORD_PLAY_STEEPNESS];
  law->radius = law->per_radius > 0 ? 1 / law->per_radius : 0;
  return is_word(words[ANHYST_WORD_PLAY_SHIFT], 0) && law->radius > 0 && law->radius <= LARGEST &&
         words[ANHYST_WORD_SCALE_CURRENT] > 0 && words[ANHYST_WORD_SCALE_CURRENT] <= LARGEST &&
         law->per_radius <= LARGEST;
}

static number current_of(number word) { return word; }
