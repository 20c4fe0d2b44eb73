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

/* a, or -1 - a for a mirror of -1: -a could leave the range. */
static inline number mirrored(number a, int mirror)
{
  return (number)((uint32_t)a ^ (uint32_t)(int32_t)mirror);
}

static inline number clamped(number a, number low, number high)
{
  return anhyst_clamp(a, low, high);
}

/* Whether x is within -half .. half. */
static inline int is_around_zero(number x, number half)
{
  return (uint32_t)x + (uint32_t)half < 2U * (uint32_t)half;
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
static inline number inner_limit(const entry *words, int word)
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

#if ANHYST_MEMORIES > 1
/* Solid iron. Slopes of a field over a flux have 16 bits after the point, from 0 to 32768. */

/* Smallest share of a layer in the section: 2^-9, q15. */
#define SHARE_MIN 64

static inline number own_of(const entry *words) { return (number)words[ANHYST_WORD_SOLID_OWN] * 4; }

static inline number hold_of(const entry *words)
{
  return (number)words[ANHYST_WORD_SOLID_HOLD] << words[ANHYST_WORD_SOLID_HOLD_SHIFT];
}

/* The share of each of the inner layers. */
static inline entry inner_share(entry surface, int layers)
{
  return (entry)((32768 - surface) / layers);
}

/* a times a part of 1. */
static inline number shared(number a, entry part)
{
  return anhyst_shl_q31(anhyst_scale(a, part), 1);
}

/* a times a slope that is not negative. */
static number sloped(number a, number slope)
{
  if (slope <= 0) {
    return 0;
  }
  const uint16_t up = anhyst_headroom(slope);
  const int16_t weight = (int16_t)((int32_t)((uint32_t)slope << up) >> 16);
  if (up < 16U) {
    return anhyst_shl_q31(anhyst_scale(anhyst_shl_q31(a, (uint16_t)(15U - up)), weight), 1);
  }
  return anhyst_scale(a, weight) >> (up - 16U);
}

/* The field of a flux in its own layer. */
static inline number own_field(number flux, number own)
{
  return anhyst_shl_q31(anhyst_scale(flux, (int16_t)(own >> 2)), 2);
}

/* The flux of which a layer has this share. The residual of the first quotient is added. */
static number whole_of(number a, entry share)
{
  const int32_t inverse = ANHYST_Q31_MAX / (share > 0 ? share : 1);
  const int32_t first = sloped(a, inverse);
  return anhyst_add_q31(first, sloped(anhyst_sub_q31(a, shared(first, share)), inverse));
}

/* The slope of a segment with this rise, over 4, and the field of its own. */
static inline number law_stiffness(number width, number rise, number own)
{
  const int32_t law = anhyst_quotient(width, rise > 0 ? rise : 1) >> 2;
  return law + own > 1 ? law + own : 1;
}

static inline number size_of(number a) { return anhyst_abs_q31(a); }

/* The slope between two positions; `run` is not 0. */
static inline number secant(number rise, number run)
{
  const int32_t found = anhyst_quotient(anhyst_abs_q31(rise), anhyst_abs_q31(run));
  return (rise < 0) == (run < 0) && found > 0 ? found : 1;
}

/* The field of a line: 1/16 of it, so that fields of up to 32 fit. */
static inline number coarse(number a) { return a >> 4; }

static inline number per_share(number stiff, entry share)
{
  const int32_t found = anhyst_quotient(stiff, (int32_t)share * 2);
  return found > 0 ? found : 1;
}

/* 1 over the field arm without the laminated part. */
static inline number slope_of_arm(entry field_arm, entry laminated)
{
  const int32_t arm = ((int32_t)field_arm * (32768 - laminated)) >> 15;
  return anhyst_quotient(65536, arm > 0 ? arm : 1);
}

/* The ratio of two weights above 0, a slope. */
static inline number ratio(int32_t numerator, int32_t denominator)
{
  return anhyst_quotient(numerator, denominator);
}

/* A slope divided by the part of the path that is not laminated. */
static inline number per_solid(number slope, entry laminated)
{
  return anhyst_quotient(slope, 2 * (32768 - (int32_t)laminated));
}

/* The part of a slope in the sum of two. */
static inline entry part_of_slopes(number part, number other)
{
  return anhyst_sat_q15(anhyst_quotient(part, anhyst_add_q31(other, part)) >> 1);
}

/* Whether the residual of an equation, a field, is at most 2^-15 of the largest field and that of a
   flux of 2^-19. Smaller residuals are below the resolution of the rows. */
static inline int is_residual_small(number residual, number slope)
{
  return anhyst_abs_q31(residual) <= 32768 + (slope >> 5);
}

/* The flux that a residual leaves to a layer and deeper, limited. */
static inline number owed_flux(const entry *words, number residual, number most)
{
  const int32_t inverse = ANHYST_Q31_MAX / words[ANHYST_WORD_SOLID_HOLD];
  const int32_t flux = anhyst_shl_q31(sloped(residual, inverse), 1);
  return anhyst_clamp(flux >> words[ANHYST_WORD_SOLID_HOLD_SHIFT], -most, most);
}

/* Sets the arms of the equation own*f + x = field - falls*(f - flux), halved until they fit;
   returns its target, over 4. The field is coarse. */
static inline number set_line(arms_type *arms, number field, number falls, number own, number flux)
{
  const uint16_t up = anhyst_headroom(falls > 0 ? falls : 1);
  const uint16_t up_field = anhyst_headroom(anhyst_abs_q31(field));
  const uint16_t of_falls = up < 14U ? (uint16_t)(16U - up) : 2U;
  const uint16_t of_field = up_field < 3U ? (uint16_t)(5U - up_field) : 2U;
  const uint16_t halvings = of_falls > of_field ? of_falls : of_field;
  const int16_t falling = (int16_t)(falls >> halvings);
  arms->bias = 0;
  arms->flux_arm = (int16_t)(falling + (own >> halvings));
  arms->field_arm = (int16_t)(65536 >> halvings);
  return (field >> (halvings - 2U)) + anhyst_scale(flux >> 2, falling);
}

static inline int are_solid_words_valid(const entry *words)
{
  return is_integer(words[ANHYST_WORD_SOLID_HOLD], 1, ANHYST_Q15_MAX) &&
         is_integer(words[ANHYST_WORD_SOLID_HOLD_SHIFT], 0, 15) &&
         is_integer(words[ANHYST_WORD_SOLID_OWN], -ANHYST_Q15_MAX, 0) &&
         is_integer(words[ANHYST_WORD_SOLID_SURFACE], SHARE_MIN, 32768 - 3 * SHARE_MIN) &&
         is_integer(words[ANHYST_WORD_SOLID_LAMINATED], 0, ANHYST_Q15_MAX);
}
#endif

#endif
