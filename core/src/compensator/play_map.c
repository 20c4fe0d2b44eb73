/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/play_map.h"

#include "checksum.h"
#include "map_fixed.h"

typedef anhyst_play_law_q31 law_type;
typedef anhyst_play_point_q31 point;
typedef anhyst_play_map_q31 play_type;

#define MAX_NEWTON_STEPS ANHYST_PLAY_STEPS

static int is_finite(number a)
{
  (void)a;
  return 1; /* every code is finite */
}

static number absolute(number a) { return anhyst_abs_q31(a); }
static number add(number a, number b) { return anhyst_add_q31(a, b); }
static number subtract(number a, number b) { return anhyst_sub_q31(a, b); }
static number clamp(number a, number low, number high) { return anhyst_clamp(a, low, high); }

/* Limits a demand to the forces of the map: from 0 to the largest code, the last column. */
static number limit_demand(const map_type *map, number demand)
{
  (void)map;
  return demand > 0 ? demand : 0;
}

static int is_gap_in_range(const map_type *map, number gap)
{
  (void)map;
  return gap >= 0;
}

/* Returns distance/radius. Requires |distance| < radius, so that no product overflows. */
static number branch_position_from_distance(const law_type *law, number distance)
{
  return 4 * anhyst_scale(distance * ((int32_t)1 << law->shift), law->steepness);
}

/* Returns a difference of two currents, divided by 4 to prevent overflow. The difference is
   compared only with other results of this function. */
static number difference(number a, number b) { return (a >> 2) - (b >> 2); }

/* Returns numerator/denominator with 14 bits, at most 1, rounded down. Requires numerator > 0. */
static number quotient_up_to_one(number numerator, number denominator)
{
  if (numerator >= denominator) {
    return ONE;
  }
  const uint16_t up = anhyst_headroom(numerator);
  const uint16_t down = anhyst_headroom(denominator);
  const int32_t top = (int32_t)((uint32_t)numerator << up);
  const int32_t bottom = ((int32_t)((uint32_t)denominator << down) >> 16) + 1;
  const uint32_t ratio = (uint32_t)(top / bottom); /* below 2^17; below 2^16 if up = down */
  /* up >= down, as the numerator is smaller. NOLINTNEXTLINE(clang-analyzer-core.BitwiseShift) */
  return (int32_t)((ratio << 15) >> (up - down));
}

/* Returns numerator/denominator with 28 bits, 14 from the remainder. Requires numerator >= 0. */
static number precise_quotient(number numerator, number denominator)
{
  if (numerator == 0) {
    return 0;
  }
  const number first = quotient_up_to_one(numerator, denominator);
  const number remainder = numerator - times_fraction(denominator, first);
  return remainder > 0 ? add(first, quotient_up_to_one(remainder, denominator)) : first;
}

/* Returns whether a difference of two currents is only a rounding error. */
static int is_rounding_error(number remaining, number start, number end)
{
  (void)start;
  (void)end;
  return remaining <= ANHYST_PLAY_NEAR / 4 && remaining >= -(ANHYST_PLAY_NEAR / 4);
}

static int is_word_equal(entry word, uint16_t value) { return (uint16_t)word == value; }

static uint32_t add_word_to_checksum(uint32_t sum, entry word)
{
  return anhyst_checksum_add(sum, (uint16_t)word);
}

static number word_to_current(entry word) { return (number)word * 65536; }

/* Returns 2^-15 of full scale. Rounding in a D/A converter may exceed a limit by this amount. */
static number current_tolerance(const entry *words)
{
  (void)words;
  return 65536;
}

/* Reads the table sizes and the play. Forces start at 0. Returns whether all words are valid. */
static int read_scales(law_type *law, const entry *words)
{
  const entry steepness = words[ANHYST_WORD_PLAY_STEEPNESS];
  const entry shift = words[ANHYST_WORD_PLAY_SHIFT];
  if (steepness < 16384 || shift < 0 || shift > 9 || words[ANHYST_WORD_PLAY_DEMAND_LOW] != 0) {
    return 0;
  }
  law->map.force_segments = (uint16_t)words[ANHYST_WORD_PLAY_FORCE_SEGMENTS];
  law->map.gap_segments = (uint16_t)words[ANHYST_WORD_PLAY_GAP_SEGMENTS];
  law->steepness = steepness;
  law->shift = (uint16_t)shift;
  law->radius = (steepness > 16384 ? anhyst_ratio(16384, steepness) : ANHYST_Q31_MAX) >> shift;
  return 1;
}

#include "generic/map.h"
#include "generic/play_block.h"
#include "generic/play_map.h"

anhyst_status anhyst_play_map_init_q31(anhyst_play_map_q31 *c, const int16_t *words,
                                       uint16_t capacity)
{
  return init_play_map(c, words, capacity);
}

int32_t anhyst_play_map_solve_q31(anhyst_play_map_q31 *c, int32_t demand, int32_t gap)
{
  return solve_demand(c, demand, gap);
}

int32_t anhyst_play_map_commit_q31(anhyst_play_map_q31 *c, int32_t applied, int32_t gap)
{
  return commit_current(c, applied, gap);
}
