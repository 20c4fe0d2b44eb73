/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic of the play-cell law in fixed point, for generic/cells.h. Fields, plays and
   magnetisations are q30. A fraction of a segment is q15. Sums of table values are exact. */
#ifndef ANHYST_CELLS_FIXED_H
#define ANHYST_CELLS_FIXED_H

#include "formats/block_fixed.h"

typedef unsigned segment_grid;                /* exponent n of a segment width of 2^(15 + n), q30 */
typedef anhyst_table_position table_position; /* position in a table row */

#define MAX_FIELD (ANHYST_Q30_ONE - 1)
#define MIN_FIELD (-ANHYST_Q30_ONE)
#define WHOLE_SEGMENT 0x8000 /* 1.0 as a fraction of a segment */

#define POWER_OF_HALF(n) (ANHYST_Q30_ONE >> (n))

/* Largest residual that rounding errors alone can cause, divided by 4. */
#define RESIDUAL_DEADBAND 32

static inline int integer_of(entry word) { return word; }

/* Returns a if mirror is 0, and -1 - a if mirror is -1. The value -a could exceed the range. */
static inline number mirrored(number a, int mirror)
{
  return (number)((uint32_t)a ^ (uint32_t)(int32_t)mirror);
}

static inline number clamped(number a, number low, number high)
{
  return anhyst_clamp(a, low, high);
}

static inline int is_around_zero(number x, number half)
{
  return (uint32_t)x + (uint32_t)half < 2U * (uint32_t)half;
}

/* Limits a number to -1..1. */
static inline number saturate(number a) { return anhyst_sat_q30(a); }

/* Return the saturated sum and the saturated difference of two numbers. */
static inline number sum(number a, number b) { return anhyst_add_q31(a, b); }
static inline number difference(number a, number b) { return anhyst_sub_q31(a, b); }

/* Sum and difference that wrap around on overflow. A damaged trial step may contain any number. */
static inline number unsafe_sum(number a, number b) { return (number)((uint32_t)a + (uint32_t)b); }
static inline number unsafe_difference(number a, number b)
{
  return (number)((uint32_t)a - (uint32_t)b);
}

static inline number scaled(number a, entry weight) { return anhyst_scale(a, weight); }
static inline number quarter(number a) { return a >> 2; }
static inline number four_times(number a) { return anhyst_shl_q31(a, 2); }
static inline number word_value(entry word) { return (number)word * 32768; }
static inline number row_value(table_position position) { return anhyst_table_value(position); }

/* Returns the row `other` minus the row of `position`, at this position. Requires that the two rows
   differ by less than 1. */
static inline number row_difference(table_position position, const entry *other)
{
  const int32_t low = (int32_t)other[0] - position.segment[0];
  const int32_t high = (int32_t)other[1] - position.segment[1];
  return low * 32768 + (high - low) * position.fraction;
}

static inline segment_grid grid_from_halvings(unsigned halvings) { return 15U - halvings; }
static inline number width_of(segment_grid width) { return (number)((uint32_t)0x8000 << width); }

/* Returns the field at a given number of segments from zero field. */
static inline number segments_to_field(int segments, segment_grid width)
{
  return (number)((uint32_t)segments << 15 << width);
}

/* Returns the position of a field in a table row; `zero` points to the entry for zero field. */
static inline table_position locate_from_zero(const entry *zero, number x, segment_grid width)
{
  const int32_t scaled_field = x >> width;
  const table_position position = {zero + (scaled_field >> 15), scaled_field & 0x7FFF};
  return position;
}

/* Returns the field at the lower end of the segment that contains x. */
static inline number segment_begin(number x, segment_grid width)
{
  return (number)((uint32_t)(x >> width >> 15) << 15 << width);
}

static inline number fraction_at(number x, number begin, segment_grid width)
{
  (void)begin;
  return (x >> width) & 0x7FFF;
}

static inline number field_at_fraction(number begin, segment_grid width, number fraction)
{
  return (number)((uint32_t)begin + ((uint32_t)fraction << width));
}

/* Limits a fraction of a segment to values below 1, because a rounded quotient can reach 1. */
static inline number limit_fraction(number fraction) { return anhyst_sat_u15(fraction); }

/* Returns residual/rise as a fraction, up to two LSB too small. Requires 0 <= residual < rise. */
static inline number divide_to_fraction(number residual, number rise)
{
  const uint16_t up = anhyst_headroom(rise);
  const int32_t top = (int32_t)((uint32_t)residual << up);
  const int32_t bottom = ((int32_t)((uint32_t)rise << up) >> 15) + 1;
  return limit_fraction(top / bottom);
}

static inline number multiply_rise(number rise, number fraction)
{
  return 2 * anhyst_scale(rise, (int16_t)fraction);
}

/* Return whether the segment of a trial step is known, its width, and the field at its start. */
static inline int has_segment(const candidate *at) { return at->of.cells.log2_width - 1U < 15U; }
static inline segment_grid trial_grid(const candidate *trial) { return trial->of.cells.log2_width; }

static inline number trial_lower_end(const candidate *trial, number x)
{
  return segment_begin(x, trial->of.cells.log2_width);
}

/* Stores the segment of a trial step: the index of its first block word, its width and its rise. */
static inline void set_segment(candidate *trial, const entry *words, int segment, number begin,
                               segment_grid width)
{
  (void)begin;
  trial->of.cells.segment = (int16_t)segment;
  trial->of.cells.log2_width = (uint16_t)width;
  trial->of.cells.row_rise = (int16_t)(words[segment + 1] - words[segment]);
}

static inline number quarter_rise(const candidate *at)
{
  return (number)at->of.cells.row_rise * 8192;
}

static inline int is_rounding_error(number above, number below, segment_grid width)
{
  return (uint32_t)above - (uint32_t)below <= (uint32_t)4 << width;
}

/* Returns 1, because every integer is a valid flux. */
static inline int is_flux_valid(number flux)
{
  (void)flux;
  return 1;
}

static inline number internal_current_limit(const entry *words, int word)
{
  return word_value(words[word]) >> words[ANHYST_WORD_CURRENT_SHIFT];
}

/* Maximum difference between two table rows at the same field. */
#define MAX_ROW_DIFFERENCE ((int32_t)ANHYST_Q15_MAX * 32768)
#define MIN_THRESHOLD ((entry)1) /* smallest threshold of a play cell */
/* Rounding error of a weight that is interpolated between two table entries. */
#define WEIGHT_ROUNDING 1
/* Smallest rise of a weighted sum over a segment that is not a rounding error. */
#define MIN_SEGMENT_RISE ((number)4)
#define QUARTER_WEIGHT 16384

/* Number of bisections in a state transfer. The final field interval is 2.4e-7. */
#define TRANSFER_BISECTIONS 24

static inline int is_weight_positive(entry word) { return word > 0; }

static inline number interpolate_line(number low, number high, number numerator, number denominator)
{
  return low + anhyst_times_fraction(saturate(high - low), anhyst_ratio(numerator, denominator));
}

/* Returns a, because every field and play in fixed point is already a multiple of the step. */
static inline number round_to_coarse_grid(number a) { return a; }

#if ANHYST_MEMORIES > 1
/* Functions for a solid core. A slope, field over flux, is in 0..32768 with 16 fractional bits. */

/* Smallest fraction of the cross-section in one layer: 2^-9, q15. */
#define MIN_AREA_FRACTION 64

static inline number read_coupling_slope(const entry *words)
{
  return (number)words[ANHYST_WORD_SOLID_OWN] * 4;
}

static inline number read_diffusion_slope(const entry *words)
{
  return (number)words[ANHYST_WORD_SOLID_HOLD] << words[ANHYST_WORD_SOLID_HOLD_SHIFT];
}

/* Returns 1 - f for a positive fraction. */
static inline entry complement(entry f) { return (entry)(32768 - f); }

static inline number at_least_one_lsb(number slope) { return slope > 1 ? slope : 1; }

static inline number times_fraction(number a, entry f)
{
  return anhyst_shl_q31(anhyst_scale(a, f), 1);
}

/* Returns a*slope, or 0 if the slope is negative. */
static number multiply_by_slope(number a, number slope)
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

static inline number coupling_field(number flux, number slope)
{
  return anhyst_shl_q31(anhyst_scale(flux, (int16_t)(slope >> 2)), 2);
}

/* Returns a/fraction: the flux density of a layer from the flux of the layer. The residual of the
   first quotient is divided again, and the result is added. */
static number divide_by_fraction(number a, entry fraction)
{
  const int32_t inverse = ANHYST_Q31_MAX / (fraction > 0 ? fraction : 1);
  const int32_t first = multiply_by_slope(a, inverse);
  return anhyst_add_q31(
      first, multiply_by_slope(anhyst_sub_q31(a, times_fraction(first, fraction)), inverse));
}

/* Returns the slope of the field over the flux on a segment, with the coupling slope added. The
   argument `rise` is the rise of the flux, divided by 4. */
static inline number segment_field_slope(number width, number rise, number coupling_slope)
{
  const int32_t law = anhyst_quotient(width, rise > 0 ? rise : 1) >> 2;
  return law + coupling_slope > 1 ? law + coupling_slope : 1;
}

static inline number absolute(number a) { return anhyst_abs_q31(a); }

static inline number secant_slope(number rise, number run)
{
  const int32_t found = anhyst_quotient(anhyst_abs_q31(rise), anhyst_abs_q31(run));
  return (rise < 0) == (run < 0) && found > 0 ? found : 1;
}

/* Returns a field divided by 16, so that a load line can reach 32 times the largest table field. */
static inline number to_coarse_field(number a) { return a >> 4; }

static inline number divide_slope(number slope, entry fraction)
{
  const int32_t found = anhyst_quotient(slope, (int32_t)fraction * 2);
  return found > 0 ? found : 1;
}

static inline number field_slope_of_current(entry field_arm, entry laminated)
{
  const int32_t arm = ((int32_t)field_arm * (32768 - laminated)) >> 15;
  return anhyst_quotient(65536, arm > 0 ? arm : 1);
}

static inline number divide_weights(int32_t numerator, int32_t denominator)
{
  return anhyst_quotient(numerator, denominator);
}

static inline number divide_slope_by_solid(number slope, entry laminated)
{
  return anhyst_quotient(slope, 2 * (32768 - (int32_t)laminated));
}

static inline entry slope_fraction(number slope, number other)
{
  return anhyst_sat_q15(anhyst_quotient(slope, anhyst_add_q31(other, slope)) >> 1);
}

/* Returns whether a residual (a field) is at most 2^-15 of the largest field plus the field of a
   flux of 2^-19. Smaller residuals are below the resolution of the table rows. */
static inline int is_residual_small(number residual, number slope)
{
  return anhyst_abs_q31(residual) <= 32768 + (slope >> 5);
}

/* Converts a residual to the outstanding flux of a layer and all deeper layers, -most..most. */
static inline number outstanding_flux(number diffusion_slope, number residual, number most)
{
  const uint16_t up = anhyst_headroom(diffusion_slope);
  const uint16_t shift = up < 16U ? (uint16_t)(16U - up) : 0U;
  const int32_t inverse = ANHYST_Q31_MAX / (diffusion_slope >> shift);
  const int32_t flux = anhyst_shl_q31(multiply_by_slope(residual, inverse), 1);
  return anhyst_clamp(flux >> shift, -most, most);
}

/* Sets the coefficients of the equation coupling_slope*f + x = field - line_slope*(f - flux),
   halved until all of them fit into 16 bits. The argument `field` is a result of to_coarse_field.
   Returns the target of the equation, divided by 4. */
static inline number set_load_line(arms_type *arms, number field, number line_slope,
                                   number coupling_slope, number flux)
{
  const uint16_t up = anhyst_headroom(line_slope > 0 ? line_slope : 1);
  const uint16_t up_field = anhyst_headroom(anhyst_abs_q31(field));
  const uint16_t of_falls = up < 14U ? (uint16_t)(16U - up) : 2U;
  const uint16_t of_field = up_field < 3U ? (uint16_t)(5U - up_field) : 2U;
  const uint16_t halvings = of_falls > of_field ? of_falls : of_field;
  const int16_t falling = (int16_t)(line_slope >> halvings);
  arms->bias = 0;
  arms->flux_arm = (int16_t)(falling + (coupling_slope >> halvings));
  arms->field_arm = (int16_t)(65536 >> halvings);
  return (field >> (halvings - 2U)) + anhyst_scale(flux >> 2, falling);
}

static inline int are_solid_words_valid(const entry *words)
{
  return is_integer(words[ANHYST_WORD_SOLID_HOLD], 1, ANHYST_Q15_MAX) &&
         is_integer(words[ANHYST_WORD_SOLID_HOLD_SHIFT], 0, 15) &&
         is_integer(words[ANHYST_WORD_SOLID_OWN], -ANHYST_Q15_MAX, 0) &&
         is_integer(words[ANHYST_WORD_SOLID_LAMINATED], 0, ANHYST_Q15_MAX);
}
#endif

#endif
