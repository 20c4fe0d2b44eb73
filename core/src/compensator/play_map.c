/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/play_map.h"

#include "checksum.h"
#include "map_fixed.h"

typedef anhyst_play_law_q31 law_type;
typedef anhyst_play_point_q31 point;
typedef anhyst_play_map_q31 play_type;

#define PLAY_STEPS ANHYST_PLAY_STEPS

static int is_known(number a)
{
  (void)a;
  return 1; /* every code is a number */
}

static number size_of(number a) { return anhyst_abs_q31(a); }

static number add(number a, number b) { return anhyst_add_q31(a, b); }

static number subtract(number a, number b) { return anhyst_sub_q31(a, b); }

static number limited(number a, number low, number high) { return anhyst_clamp(a, low, high); }

/* The nearest force of the map, which only pulls; the largest code is its last column. */
static number pulling(const map_type *map, number demand)
{
  (void)map;
  return demand > 0 ? demand : 0;
}

static int is_gap(const map_type *map, number gap)
{
  (void)map;
  return gap >= 0;
}

/* distance/radius; |distance| is less than the radius, so that no product leaves the format. */
static number side_of(const law_type *law, number distance)
{
  return 4 * anhyst_scale(distance * ((int32_t)1 << law->shift), law->steepness);
}

/* The difference of two currents over 4, so that it stays within the format; to be compared with
   others of its kind. */
static number difference(number a, number b) { return (a >> 2) - (b >> 2); }

/* numerator/denominator to 14 bits, at most 1, never too large; the numerator is above 0. */
static number share_of(number numerator, number denominator)
{
  if (numerator >= denominator) {
    return ONE;
  }
  const uint16_t up = anhyst_headroom(numerator);
  const uint16_t down = anhyst_headroom(denominator);
  const int32_t top = (int32_t)((uint32_t)numerator << up);
  const int32_t bottom = ((int32_t)((uint32_t)denominator << down) >> 16) + 1;
  const uint32_t ratio = (uint32_t)(top / bottom); /* below 2^17; below 2^16 if up is down */
  /* up >= down, as the numerator is smaller. NOLINTNEXTLINE(clang-analyzer-core.BitwiseShift) */
  return (int32_t)((ratio << 15) >> (up - down));
}

/* The same to 28 bits: a second digit comes from the rest. The numerator is not negative. */
static number fraction_of(number numerator, number denominator)
{
  if (numerator == 0) {
    return 0;
  }
  const number first = share_of(numerator, denominator);
  const number rest = numerator - times(denominator, first);
  return rest > 0 ? add(first, share_of(rest, denominator)) : first;
}

/* Whether a difference of currents is rounding. */
static int is_rounding(number left, number near, number far)
{
  (void)near;
  (void)far;
  return left <= ANHYST_PLAY_NEAR / 4 && left >= -(ANHYST_PLAY_NEAR / 4);
}

static int is_word(entry word, uint16_t value) { return (uint16_t)word == value; }

static uint32_t add_bits(uint32_t sum, entry word)
{
  return anhyst_checksum_add(sum, (uint16_t)word);
}

static number current_of(entry word) { return (number)word * 65536; }

/* 2^-15 of full scale: what a converter may add to a limit of the current. */
static number room_of(const entry *words)
{
  (void)words;
  return 65536;
}

/* Reads sizes and play; the range of forces begins at 0. */
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
  return init(c, words, capacity);
}

int32_t anhyst_play_map_solve_q31(anhyst_play_map_q31 *c, int32_t demand, int32_t gap)
{
  return solve(c, demand, gap);
}

int32_t anhyst_play_map_commit_q31(anhyst_play_map_q31 *c, int32_t applied, int32_t gap)
{
  return commit(c, applied, gap);
}
