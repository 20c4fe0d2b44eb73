/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic of the Jiles-Atherton law in floating point, for full.h. Include after f32.h or f64.h,
   and after the definition of MAX_TANGENT_STEP. */
#ifndef ANHYST_FULL_REAL_H
#define ANHYST_FULL_REAL_H

#include "block_real.h"

#define ONE ((number)1)
#define MAX_FIELD ONE /* largest field */
/* Largest residual that rounding errors alone can cause. */
#define RESIDUAL_DEADBAND ((number)4 * NUMBER_EPS)
/* Rounding error of the play's end position. */
#define PLAY_ROUNDING ((number)4 * NUMBER_EPS)
#define MIN_SLOPE ((number)1e-6) /* smallest slope that is used as a divisor */
#define MAX_SLOPE ((number)1e6)
#define QUARTER_WEIGHT ((entry)0.25)

#define MAX_SEGMENTS_EXPONENT 12
#define MAX_RATE_SHIFT 0
#define SEGMENT_RISE_ROUNDING 0
#define TRANSFER_BISECTIONS 56 /* number of bisections of an interval of 4 */

typedef number slope;
typedef number candidate_slope;
typedef number mirror_type; /* 1 if the field rises along the path, -1 if it falls */

typedef struct {
  const entry *entries;
  int32_t last_segment; /* index of the last segment */
  number segments;      /* number of segments */
} table;

/* Decay rate of the history's effect along the play, octaves for a field change of 1.0. */
typedef number decay_rate;

static inline table table_from_word(const entry *words, entry first, uint16_t n)
{
  const int32_t segments = (int32_t)1 << n;
  const table t = {words + (int32_t)first, segments - 1, (number)segments};
  return t;
}

static inline decay_rate read_decay_rate(const entry *words)
{
  return words[ANHYST_WORD_FULL_RATE] * (number)16;
}

static inline number to_internal(number a) { return a; }
static inline number to_stored(number a) { return a; }
static inline number to_external(number a) { return a; }
static inline number limit_to_one(number a) { return clamp(a, -ONE, ONE); }
static inline number clamped(number a, number low, number high) { return clamp(a, low, high); }

static inline mirror_type mirror_sign(int is_falling)
{
  return is_falling ? (mirror_type)-1 : (mirror_type)1;
}

static inline number mirrored(number a, mirror_type mirror) { return a * mirror; }

/* Returns whether a residual exceeds the rounding errors. Returns 0 for NaN. */
static inline int is_residual(number residual) { return absolute(residual) > RESIDUAL_DEADBAND; }
static inline number scaled(number a, entry weight) { return a * weight; }
static inline number times_fraction(number a, entry f) { return a * f; }
static inline number half(number a) { return a * (number)0.5; }

static inline number interpolate(table t, number u, number *rise)
{
  const number position = u * t.segments;
  const int32_t index = (int32_t)position;
  const int32_t segment = index < t.last_segment ? index : t.last_segment;
  const entry *entries = t.entries + segment;
  *rise = entries[1] - entries[0];
  return entries[0] + *rise * (position - (number)segment);
}

static inline slope curve_slope(table curve, number rise) { return rise * curve.segments; }
static inline slope limit_slope(slope a) { return clamp(a, (slope)0, MAX_SLOPE); }
static inline number multiply_by_slope(number step, slope a) { return step * a; }

static inline number weighted_slope(entry air, entry iron, slope m_slope)
{
  return air + iron * m_slope;
}

static inline slope total_m_slope(slope y_slope, slope x_slope, entry reversible)
{
  return y_slope + (x_slope - y_slope) * reversible;
}

static inline slope irreversible_slope(number above, entry steepness) { return above * steepness; }

static inline number air_weight(entry air, entry flux_arm, entry field_arm)
{
  return field_arm + (number)4 * air * flux_arm;
}

static inline entry air_weight_of_current(entry air, const arms_type *arms)
{
  const number sum = air_weight(air, arms->flux_arm, arms->field_arm);
  return sum > MIN_SLOPE ? sum : MIN_SLOPE;
}

static inline number slope_rounding_error(entry air, slope steepest)
{
  (void)air;
  (void)steepest;
  return 0;
}

static inline entry max_segment_rise(uint16_t n)
{
  (void)n;
  return (entry)2;
}

static inline number quotient(number n, number d)
{
  const number ratio = n / d;
  return ratio < (number)4 ? ratio : (number)4;
}

static inline number max_tangent_step(entry steepness)
{
  const number step = MAX_TANGENT_STEP * (number)4 / steepness;
  return step < MAX_TANGENT_STEP ? step : MAX_TANGENT_STEP;
}

/* Returns 1 - 2^(-t) for t >= 0 octaves. Below one octave, uses a polynomial for (1 - 2^-f)/f.
   Whole octaves are exact powers of two. Error before rounding below 1e-9 (for small t, 1e-9*t). */
static inline number decayed_fraction(number t)
{
  if (t >= (number)31) {
    return ONE;
  }
  const int32_t octaves = (int32_t)t;
  const number f = t - (number)octaves;
  number ratio =
      (number)0.0013299398836141 + f * ((number)-1.488923773820e-4 + f * (number)1.13038439e-5);
  ratio = (number)0.0555039138729150 + f * ((number)-0.0096169507101000 + f * ratio);
  ratio = (number)0.6931471804363274 + f * ((number)-0.2402264948347643 + f * ratio);
  return ONE - (ONE - f * ratio) / (number)((uint32_t)1 << octaves);
}

static inline number decayed_fraction_after(decay_rate decay, number travel)
{
  return decayed_fraction(travel * decay);
}

static inline number decay_field(entry steepness) { return ONE / steepness; }
static inline number multiply_by_decay(number a, number fraction) { return a * fraction; }
static inline number to_quarter_weight(number a) { return a; }
static inline number times_quarter_weight(number a, number weight) { return a * weight; }
static inline number saturate_target(number a) { return a; }
static inline number current_limit(const entry *words, int16_t word) { return words[word]; }

#endif
