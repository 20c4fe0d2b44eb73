/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic of the Jiles-Atherton law in fixed point, for generic/full.h. Internal numbers are
   q28. A sum of a few of them needs no saturation in 32 bits. Slopes are in units of 1/1024. */
#ifndef ANHYST_FULL_FIXED_H
#define ANHYST_FULL_FIXED_H

#include "formats/fixed.h"

#include "formats/block_fixed.h"

#define ONE ((number)268435456) /* 1.0 as an internal number */
#define MAX_FIELD (ONE - 1)     /* largest field */
#define RESIDUAL_DEADBAND 32    /* largest residual from rounding errors, 1.2e-7 */
#define PLAY_ROUNDING 0         /* rounding error of the play's end position */
#define MAX_TANGENT_STEP (ONE / 256)
#define MIN_SLOPE ((number)1)         /* smallest slope that is used as a divisor */
#define QUARTER_WEIGHT ((entry)16384) /* 1/4 as a weight */

#define MAX_SEGMENTS_EXPONENT 9
#define MAX_RATE_SHIFT 12
#define SEGMENT_RISE_ROUNDING 1 /* rounding error of the rise of a segment */
#define TRANSFER_BISECTIONS 24  /* number of bisections; the final interval is 2.4e-7 */

typedef int32_t slope;
typedef int16_t candidate_slope;
typedef int32_t mirror_type; /* 0 if the field rises along the path, -1 if it falls */

typedef struct {
  const entry *entries;
  uint16_t log2_segments; /* log2 of the number of segments */
} table;

/* Decay rate of the history's effect along the play. */
typedef struct {
  entry rate;
  uint16_t shift;
} decay_rate;

static inline table table_from_word(const entry *words, entry first, uint16_t n)
{
  const table t = {words + first, n};
  return t;
}

static inline decay_rate read_decay_rate(const entry *words)
{
  const decay_rate decay = {words[ANHYST_WORD_FULL_RATE],
                            (uint16_t)words[ANHYST_WORD_FULL_RATE_SHIFT]};
  return decay;
}

/* Convert a q30 of the stored state to an internal number, and back. */
static inline number to_internal(number a) { return a >> 2; }
static inline number to_stored(number a) { return a * 4; }

static inline number to_external(number a) { return anhyst_shl_q31(a, 2); } /* saturates */

static inline number limit_to_one(number a) { return anhyst_sat_q28(a); }

static inline number clamped(number a, number low, number high)
{
  return anhyst_clamp(a, low, high);
}

static inline number absolute(number a) { return a < 0 ? -a : a; }
static inline mirror_type mirror_sign(int is_falling) { return is_falling ? -1 : 0; }

/* Mirrors a number if the field falls. Uses -1 - a for -a, because -a could exceed the range. */
static inline number mirrored(number a, mirror_type mirror)
{
  return (number)((uint32_t)a ^ (uint32_t)mirror);
}

static inline int is_residual(number residual) { return absolute(residual) > RESIDUAL_DEADBAND; }
static inline number scaled(number a, entry weight) { return anhyst_scale(a, weight); }
static inline number times_fraction(number a, entry f) { return anhyst_scale(a, f) * 2; }
static inline number half(number a) { return a >> 1; }

/* Interpolates a table at 0 <= u < 1, q28. *rise is the rise of the segment, q15. */
static inline number interpolate(table t, number u, number *rise)
{
  const int32_t scaled_u = u >> (15U - t.log2_segments); /* segment, and 13 bits within it */
  const int16_t *entries = t.entries + (scaled_u >> 13);
  const int32_t low = entries[0];
  *rise = entries[1] - low;
  return low * 8192 + *rise * (scaled_u & 8191);
}

static inline slope curve_slope(table curve, number rise)
{
  return (int32_t)((uint32_t)rise << curve.log2_segments) >> 5;
}

/* Limits a slope to 0..ANHYST_MAX_SLOPE. */
static inline slope limit_slope(slope a) { return anhyst_sat_u15(a); }

/* Returns step*slope for a step of at most MAX_EXTRAPOLATION_STEP. */
static inline number multiply_by_slope(number step, slope a)
{
  return anhyst_scale(step, (int16_t)a) * 64;
}

static inline number weighted_slope(number air, entry iron, slope m_slope)
{
  return air + (((int32_t)iron * m_slope) >> 10);
}

static inline slope total_m_slope(slope y_slope, slope x_slope, entry reversible)
{
  return y_slope + (((x_slope - y_slope) * reversible) >> 15);
}

/* Returns dy/dp at a distance `above` between the ascending branch and y. */
static inline slope irreversible_slope(number above, entry steepness)
{
  return ((above >> 15) * steepness) >> 11;
}

/* Return the field's weight in a current, field_arm + 4*air*flux_arm, as a number or a word > 0. */
static inline number air_weight(entry air, entry flux_arm, entry field_arm)
{
  return field_arm + (((int32_t)air * flux_arm) >> 14);
}

static inline entry air_weight_of_current(entry air, const arms_type *arms)
{
  return (entry)anhyst_clamp(air_weight(air, arms->flux_arm, arms->field_arm), 1, ANHYST_Q15_MAX);
}

/* Returns the rounding error of a current's slope: 1/2 LSB per weight and 1 LSB per product. */
static inline number slope_rounding_error(entry air, slope steepest)
{
  return 3 + (air >> 15) + (steepest >> 11);
}

/* Returns the largest rise of a segment whose slope is at most ANHYST_MAX_SLOPE. */
static inline entry max_segment_rise(uint16_t n)
{
  return (entry)(ANHYST_Q15_MAX >> (n > 5U ? n - 5U : 0U));
}

/* Returns n/d for a slope d, exact or with 14 bits, and at most 4. Requires n >= 0 and d > 0. */
static inline number quotient(number n, number d)
{
  const int32_t over = 16 - (int32_t)anhyst_headroom(n | 1);
  const int32_t down = over > 0 ? over : 0;
  const int32_t ratio = (int32_t)((uint32_t)n << (16 - down)) / d;
  const int32_t most = (ONE * 4 - 1) >> down;
  return (int32_t)((uint32_t)(ratio < most ? ratio : most) << down);
}

/* Returns the longest step along a tangent after which the law need not be evaluated again. */
static inline number max_tangent_step(entry steepness)
{
  const number step = MAX_TANGENT_STEP * 1024 / steepness;
  return step < MAX_TANGENT_STEP ? step : MAX_TANGENT_STEP;
}

/* Returns 1 - 2^(-t) for t octaves; t is q26, the result q28. Below one octave, uses a cubic
   polynomial for (1 - 2^-f)/f. Whole octaves are shifts. Error below 7e-5, 1.5e-4 of the result. */
static inline number decayed_fraction(int32_t t)
{
  const uint16_t octaves = (uint16_t)(t >> 26) & 31U; /* t is not negative */
  const int32_t octave_fraction = t & 0x3FFFFFF;
  const int32_t f = octave_fraction >> 11; /* q15 */
  int32_t ratio = 1775 - ((241 * f) >> 15);
  ratio = 7863 - ((ratio * f) >> 15);
  ratio = 22713 - ((ratio * f) >> 15);
  return ONE - ((ONE - anhyst_scale(octave_fraction * 8, (int16_t)ratio)) >> octaves);
}

/* Returns the fraction of the offset that has decayed after this travel of the play. */
static inline number decayed_fraction_after(decay_rate decay, number travel)
{
  const int32_t octaves = anhyst_scale(travel * 4, decay.rate);
  if (octaves > ANHYST_Q31_MAX >> decay.shift) { /* at longer travel, everything has decayed */
    return ONE;
  }
  return decayed_fraction((int32_t)((uint32_t)octaves << decay.shift));
}

/* Returns the field change in which the history's effect decays to 1/e, at most 1. */
static inline number decay_field(entry steepness)
{
  return steepness > 256 ? ONE / steepness * 256 : ONE;
}

static inline number multiply_by_decay(number a, number fraction)
{
  return anhyst_scale(a, anhyst_sat_q15(fraction >> 13)) * 2;
}

/* Convert a number in -2..2 to a weight of a quarter of its size; multiply by such a weight. */
static inline entry to_quarter_weight(number a) { return anhyst_sat_q15((0x2000 + a) >> 14); }
static inline number times_quarter_weight(number a, entry weight)
{
  return anhyst_scale(a, weight) * 4;
}
static inline number saturate_target(number a) { return anhyst_sat_q28(a); }

static inline number current_limit(const entry *words, int16_t word)
{
  return ((int32_t)words[word] * 8192) >> (uint16_t)words[ANHYST_WORD_CURRENT_SHIFT];
}

#endif
