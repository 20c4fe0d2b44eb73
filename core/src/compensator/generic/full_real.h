/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic of the law of Jiles and Atherton in floating point, for full.h. Include after f32.h or
   f64.h, and after MAX_TANGENT_STEP is defined. */
#ifndef ANHYST_FULL_REAL_H
#define ANHYST_FULL_REAL_H

#include "block_real.h"

#define UNIT ((number)1)
#define MAX_FIELD UNIT                             /* the largest field */
#define RESIDUAL_DEADBAND ((number)4 * NUMBER_EPS) /* a residual that is not more than rounding */
#define PLAY_SLACK                                                                                 \
  ((number)4 * NUMBER_EPS)       /* what rounding leaves between the play and its stop             \
                                  */
#define MIN_SLOPE ((number)1e-6) /* the least slope of a sum that is divided by */
#define MAX_SLOPE ((number)1e6)
#define QUARTER ((entry)0.25)

#define MAX_SEGMENTS_EXPONENT 12
#define MAX_RATE_SHIFT 0
#define TABLE_ROUNDING 0
#define BISECTIONS 56 /* of an interval of 4 */

typedef number slope;
typedef number candidate_slope;
typedef number mirror; /* -1: the path falls, 1: it rises */

/* A table over 0..1. */
typedef struct {
  const entry *at;
  int32_t last;    /* its last segment */
  number segments; /* their number */
} table;

/* How fast the memory fades along the play, octaves for a field of 1.0. */
typedef number fading;

static inline table table_at(const entry *words, entry first, uint16_t n)
{
  const int32_t segments = (int32_t)1 << n;
  const table t = {words + (int32_t)first, segments - 1, (number)segments};
  return t;
}

static inline fading fading_of(const entry *words)
{
  return words[ANHYST_WORD_FULL_RATE] * (number)16;
}

static inline number to_inner(number a) { return a; }

static inline number to_memory(number a) { return a; }

static inline number to_outer(number a) { return a; }

static inline number within_unit(number a) { return clamp(a, -UNIT, UNIT); }

static inline number clamped(number a, number low, number high) { return clamp(a, low, high); }

static inline mirror mirror_of(int is_falling) { return is_falling ? (mirror)-1 : (mirror)1; }

static inline number turned(number a, mirror way) { return a * way; }

/* False for what is not a number. */
static inline int is_residual(number residual) { return absolute(residual) > RESIDUAL_DEADBAND; }

static inline number scaled(number a, entry weight) { return a * weight; }

static inline number part_of(number a, entry part) { return a * part; }

static inline number half_of(number a) { return a * (number)0.5; }

/* The value of a table at u, 0 <= u <= 1; *rise is that of the segment. */
static inline number value(table t, number u, number *rise)
{
  const number place = u * t.segments;
  const int32_t found = (int32_t)place;
  const int32_t segment = found < t.last ? found : t.last;
  const entry *at = t.at + segment;
  *rise = at[1] - at[0];
  return at[0] + *rise * (place - (number)segment);
}

static inline slope slope_of(table curve, number rise) { return rise * curve.segments; }

static inline slope rising(slope a) { return clamp(a, (slope)0, MAX_SLOPE); }

static inline number along_slope(number step, slope a) { return step * a; }

static inline number slope_of_sum(entry air, entry iron, slope m_slope)
{
  return air + iron * m_slope;
}

static inline slope mixed_slope(slope y_slope, slope x_slope, entry part)
{
  return y_slope + (x_slope - y_slope) * part;
}

static inline slope pulled(number above, entry steepness) { return above * steepness; }

static inline number air_sum(entry air, entry flux_arm, entry field_arm)
{
  return field_arm + (number)4 * air * flux_arm;
}

static inline entry air_of_current(entry air, const arms_type *arms)
{
  const number sum = air_sum(air, arms->flux_arm, arms->field_arm);
  return sum > MIN_SLOPE ? sum : MIN_SLOPE;
}

static inline number sum_rounding(entry air, slope steepest)
{
  (void)air;
  (void)steepest;
  return 0;
}

static inline entry max_rise(uint16_t n)
{
  (void)n;
  return (entry)2;
}

static inline number quotient(number n, number d)
{
  const number ratio = n / d;
  return ratio < (number)4 ? ratio : (number)4;
}

static inline number tangent_step_of(entry steepness)
{
  const number step = MAX_TANGENT_STEP * (number)4 / steepness;
  return step < MAX_TANGENT_STEP ? step : MAX_TANGENT_STEP;
}

/* 1 - 2^(-t) for t octaves, t >= 0. Below one octave a polynomial for (1 - 2^-f)/f, whole octaves
   by an exact power of two. Error below 1e-9 before rounding, relative to t where t is small. */
static inline number forgotten(number t)
{
  if (t >= (number)31) {
    return UNIT;
  }
  const int32_t whole = (int32_t)t;
  const number f = t - (number)whole;
  number ratio =
      (number)0.0013299398836141 + f * ((number)-1.488923773820e-4 + f * (number)1.13038439e-5);
  ratio = (number)0.0555039138729150 + f * ((number)-0.0096169507101000 + f * ratio);
  ratio = (number)0.6931471804363274 + f * ((number)-0.2402264948347643 + f * ratio);
  return UNIT - (UNIT - f * ratio) / (number)((uint32_t)1 << whole);
}

static inline number forgotten_along(fading fades, number travel)
{
  return forgotten(travel * fades);
}

static inline number kappa_of(entry steepness) { return UNIT / steepness; }

static inline number share_of(number a, number share) { return a * share; }

static inline number lead_of(number a) { return a; }

static inline number part_of_lead(number part, number lead) { return part * lead; }

static inline number bounded(number a) { return a; }

static inline number current_limit(const entry *words, int16_t word) { return words[word]; }

#endif
