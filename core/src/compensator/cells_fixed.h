/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic of the law of play cells in fixed point, for generic/cells.h. Fields, plays and
   magnetisations are q30, parts of a segment q15. Sums of row values are exact. */
#ifndef ANHYST_CELLS_FIXED_H
#define ANHYST_CELLS_FIXED_H

#include "formats/block_fixed.h"

typedef unsigned grid;    /* width of a segment: 2^(15 + this), q30 */
typedef anhyst_spot spot; /* a position in a table row */

#define FIELD_MAX (ANHYST_Q30_ONE - 1)
#define FIELD_MIN (-ANHYST_Q30_ONE)
#define WHOLE_SEGMENT 0x8000 /* as a part */

/* 2^-n */
#define POWER_OF_HALF(n) (ANHYST_Q30_ONE >> (n))

/* A quarter of the largest residual that rounding alone can cause. */
#define RESIDUAL_DEADBAND 32

/* A word of a block that is an integer. */
static inline int integer_of(entry word) { return word; }

static inline int is_word_within(entry word, int low, int high)
{
  return word >= low && word <= high;
}

/* a, or -1 - a for a mirror of -1: -a could leave the range. */
static inline number mirrored(number a, int mirror)
{
  return (number)((uint32_t)a ^ (uint32_t)(int32_t)mirror);
}

static inline number clamped(number a, number low, number high)
{
  return anhyst_clamp(a, low, high);
}

/* Saturates to -1 .. 1. */
static inline number inside(number a) { return anhyst_sat_q30(a); }

/* Sum and difference; saturate. */
static inline number sum(number a, number b) { return anhyst_add_q31(a, b); }
static inline number difference(number a, number b) { return anhyst_sub_q31(a, b); }

/* Sum and difference of numbers that a damaged candidate may contain; wrap. */
static inline number unsafe_sum(number a, number b) { return (number)((uint32_t)a + (uint32_t)b); }
static inline number unsafe_difference(number a, number b)
{
  return (number)((uint32_t)a - (uint32_t)b);
}

/* a times a weight. */
static inline number scaled(number a, entry weight) { return anhyst_scale(a, weight); }

static inline number quarter(number a) { return a >> 2; }
static inline number four_times(number a) { return anhyst_shl_q31(a, 2); }

/* The number of a q15 word. */
static inline number level_of(entry word) { return (number)word * 32768; }

static inline number value_at(spot at) { return anhyst_value_at(at); }

/* What one row has beyond another at the same position; they differ by less than 1. */
static inline number between(spot of, const entry *other)
{
  const int32_t low = (int32_t)other[0] - of.at[0];
  const int32_t high = (int32_t)other[1] - of.at[1];
  return low * 32768 + (high - low) * of.part;
}

/* Segments of this many halvings of 1.0. */
static inline grid grid_of(unsigned halvings) { return 15U - halvings; }

static inline number width_of(grid width) { return (number)((uint32_t)0x8000 << width); }

/* The field at so many segments from zero. */
static inline number field_at(int segments, grid width)
{
  return (number)((uint32_t)segments << 15 << width);
}

/* The spot of a field on a row; the field 0 is at the pointer. */
static inline spot spot_from(const entry *zero, number x, grid width)
{
  const int32_t place = x >> width;
  const spot at = {zero + (place >> 15), place & 0x7FFF};
  return at;
}

/* Segments begin at multiples of their width. */
static inline number begin_of(number x, grid width)
{
  return (number)((uint32_t)(x >> width >> 15) << 15 << width);
}

/* The part of a segment before x, which lies on the segment. */
static inline number part_at(number x, number begin, grid width)
{
  (void)begin;
  return (x >> width) & 0x7FFF;
}

/* The field at a part of a segment. */
static inline number place_in(number begin, grid width, number part)
{
  return (number)((uint32_t)begin + ((uint32_t)part << width));
}

/* The largest part below the whole segment, for a part that rounding made larger. */
static inline number inner_part(number part) { return anhyst_sat_u15(part); }

/* missing/rise as a part, rounded down by up to two units; 0 <= missing < rise. */
static inline number ratio_part(number missing, number rise)
{
  const uint16_t up = anhyst_headroom(rise);
  const int32_t top = (int32_t)((uint32_t)missing << up);
  const int32_t bottom = ((int32_t)((uint32_t)rise << up) >> 15) + 1;
  return inner_part(top / bottom);
}

/* The part of a rise that belongs to a part of its segment. */
static inline number rise_share(number rise, number part)
{
  return 2 * anhyst_scale(rise, (int16_t)part);
}

/* Where the segment of a candidate is, and how wide. */
static inline int is_placed(const candidate *at) { return at->of.cells.fineness - 1U < 15U; }

static inline grid grid_at(const candidate *at) { return at->of.cells.fineness; }

static inline number begin_at(const candidate *at, number x)
{
  return begin_of(x, at->of.cells.fineness);
}

/* Sets the segment of a candidate: its word in the block, where it begins, its width, its rise. */
static inline void set_segment(candidate *at, const entry *words, int segment, number begin,
                               grid width)
{
  (void)begin;
  at->of.cells.segment = (int16_t)segment;
  at->of.cells.fineness = (uint16_t)width;
  at->of.cells.rise = (int16_t)(words[segment + 1] - words[segment]);
}

/* A quarter of what the row rises on the segment of a candidate. */
static inline number quarter_rise(const candidate *at) { return (number)at->of.cells.rise * 8192; }

/* Whether a field is below another by no more than rounding. */
static inline int is_rounding(number above, number below, grid width)
{
  return (uint32_t)above - (uint32_t)below <= (uint32_t)4 << width;
}

/* Whether a flux can be one. Every integer is a number. */
static inline int is_flux(number flux)
{
  (void)flux;
  return 1;
}

/* A limit of the current, in units of the inner current. */
static inline number current_limit(const entry *words, int word)
{
  return level_of(words[word]) >> words[ANHYST_WORD_CURRENT_SHIFT];
}

/* Parameter blocks. */

#define LEVEL_MAX ((int32_t)ANHYST_Q15_MAX * 32768) /* largest difference of two rows */
#define THRESHOLD_MIN ((entry)1)                    /* smallest half-width of a play */
#define ARM_ROUNDING 1                              /* of a weight between two entries */
#define RISE_MIN ((number)4)                        /* on a segment, more than rounding */
#define QUARTER_WEIGHT 16384

/* Bisections of the transfer: the remaining interval is 2.4e-7. */
#define CARRY_HALVINGS 24

static inline int is_weight_positive(entry word) { return word > 0; }

/* The point of a line from low to high at a part numerator/denominator. */
static inline number on_line(number low, number high, number numerator, number denominator)
{
  return low + anhyst_share(inside(high - low), anhyst_ratio(numerator, denominator));
}

/* Every field and play is on the grid of its format. */
static inline number on_coarse_grid(number a) { return a; }
#endif
