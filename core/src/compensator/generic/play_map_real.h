/* SPDX-License-Identifier: Apache-2.0 */
/* Operations in floating point for the templates play_block.h and play_map.h; see ../play_map.c.
   map_real.h, the types law_type, point and play_type, and MACHINE_EPSILON come before. */

#define MAX_NEWTON_STEPS 12 /* more than in fixed point because of the higher precision */

static int is_finite(number a) { return a >= -MAX_ENTRY && a <= MAX_ENTRY; }
static number absolute(number a) { return a < 0 ? -a : a; }
static number add(number a, number b) { return a + b; }
static number subtract(number a, number b) { return a - b; }

static number clamp(number a, number low, number high)
{
  if (!(a > low)) {
    return low;
  }
  return a > high ? high : a;
}

/* Limits a demand to the forces of the map. For NaN, returns the force of the map closest to 0. */
static number limit_demand(const map_type *map, number demand)
{
  if (demand >= map->force_low) {
    return clamp(demand, map->force_low, map->force_high);
  }
  return demand < map->force_low ? map->force_low : clamp(0, map->force_low, map->force_high);
}

/* Returns whether a gap is in its range, extended by 2^-15 of the range. */
static int is_gap_in_range(const map_type *map, number gap)
{
  const number tolerance = (map->gap_high - map->gap_low) / 32768;
  return gap >= map->gap_low - tolerance && gap <= map->gap_high + tolerance;
}

static number branch_position_from_distance(const law_type *law, number distance)
{
  return distance * law->per_radius;
}

/* Returns a difference of two currents. Only other results of this function have the same scale. */
static number difference(number a, number b) { return a - b; }

static number quotient_up_to_one(number numerator, number denominator)
{
  return numerator < denominator ? numerator / denominator : ONE;
}

#define precise_quotient quotient_up_to_one

static int is_rounding_error(number remaining, number start, number end)
{
  return absolute(remaining) <= 16 * MACHINE_EPSILON * (absolute(start) + absolute(end));
}

static int is_word_equal(number word, uint16_t value) { return word == (number)value; }

static uint32_t add_word_to_checksum(uint32_t sum, number word)
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

static number current_tolerance(const number *words)
{
  return words[ANHYST_WORD_SCALE_CURRENT] / 32768;
}

/* Reads table sizes, force and gap ranges, and the play's radius. Returns whether all are valid. */
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
  return is_word_equal(words[ANHYST_WORD_PLAY_SHIFT], 0) && law->radius > 0 &&
         law->radius <= MAX_ENTRY && words[ANHYST_WORD_SCALE_CURRENT] > 0 &&
         words[ANHYST_WORD_SCALE_CURRENT] <= MAX_ENTRY && law->per_radius <= MAX_ENTRY;
}

static number word_to_current(number word) { return word; }
