/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic of the law of Jiles and Atherton in fixed point, for generic/full.h. Numbers inside
   are q28: sums of a few of them stay within 32 bits, so that none needs to saturate. Slopes are
   counted in 1/1024. */
#ifndef ANHYST_FULL_FIXED_H
#define ANHYST_FULL_FIXED_H

#include "formats/fixed.h"

#include "formats/block_fixed.h"

#define UNIT ((number)268435456) /* 1.0 */
#define MAX_FIELD (UNIT - 1)     /* the largest field */
#define RESIDUAL_DEADBAND 32     /* a residual that is not more than rounding, 1.2e-7 */
#define PLAY_SLACK 0             /* what rounding leaves between the play and its stop */
#define MAX_TANGENT_STEP (UNIT / 256)
#define MIN_SLOPE ((number)1)  /* the least slope of a sum that is divided by, a weight */
#define QUARTER ((entry)16384) /* 1/4 as a weight */

#define MAX_SEGMENTS_EXPONENT 9
#define MAX_RATE_SHIFT 12
#define TABLE_ROUNDING 1 /* of the rise of a segment */
#define BISECTIONS 24    /* of an interval of 4: leaves 2.4e-7 */

typedef int32_t slope;
typedef int16_t candidate_slope;
typedef int32_t mirror; /* -1: the path falls, 0: it rises */

/* A table over 0..1. */
typedef struct {
  const entry *at;
  uint16_t n; /* it has 2^n segments */
} table;

/* How fast the memory fades along the play. */
typedef struct {
  entry rate;
  uint16_t shift;
} fading;

static inline table table_at(const entry *words, entry first, uint16_t n)
{
  const table t = {words + first, n};
  return t;
}

static inline fading fading_of(const entry *words)
{
  const fading fades = {words[ANHYST_WORD_FULL_RATE], (uint16_t)words[ANHYST_WORD_FULL_RATE_SHIFT]};
  return fades;
}

/* A q30 as a number inside, and back. */
static inline number to_inner(number a) { return a >> 2; }

static inline number to_memory(number a) { return a * 4; }

static inline number to_outer(number a) { return anhyst_shl_q31(a, 2); } /* saturates */

/* The number of -1..1 nearest to a. */
static inline number within_unit(number a) { return anhyst_sat_q28(a); }

static inline number clamped(number a, number low, number high)
{
  return anhyst_clamp(a, low, high);
}

static inline number absolute(number a) { return a < 0 ? -a : a; }

static inline mirror mirror_of(int is_falling) { return is_falling ? -1 : 0; }

/* A number as it is on a path that rises. -1 - a stands for -a, which could leave the range. */
static inline number turned(number a, mirror way) { return (number)((uint32_t)a ^ (uint32_t)way); }

static inline int is_residual(number residual) { return absolute(residual) > RESIDUAL_DEADBAND; }

/* a times a weight, and a times a q15. */
static inline number scaled(number a, entry weight) { return anhyst_scale(a, weight); }

static inline number part_of(number a, entry part) { return anhyst_scale(a, part) * 2; }

static inline number half_of(number a) { return a >> 1; }

/* The value of a table at u, 0 <= u < 1, q28; *rise is that of the segment, in q15. */
static inline number value(table t, number u, number *rise)
{
  const int32_t fine = u >> (15U - t.n); /* segment and 13 bits of its part */
  const int16_t *at = t.at + (fine >> 13);
  const int32_t low = at[0];
  *rise = at[1] - low;
  return low * 8192 + *rise * (fine & 8191);
}

/* The rise of a segment of the curve as a slope. */
static inline slope slope_of(table curve, number rise)
{
  return (int32_t)((uint32_t)rise << curve.n) >> 5;
}

/* A slope within 0..ANHYST_SLOPE_MAX. */
static inline slope rising(slope a) { return anhyst_sat_u15(a); }

/* What a slope makes of a step of at most MAX_SLIDE. */
static inline number along_slope(number step, slope a)
{
  return anhyst_scale(step, (int16_t)a) * 64;
}

/* air + iron*m_slope, a weight. */
static inline number slope_of_sum(number air, entry iron, slope m_slope)
{
  return air + (((int32_t)iron * m_slope) >> 10);
}

/* y_slope + part*(x_slope - y_slope). */
static inline slope mixed_slope(slope y_slope, slope x_slope, entry part)
{
  return y_slope + (((x_slope - y_slope) * part) >> 15);
}

/* dy/dp if the branch is this much above y. */
static inline slope pulled(number above, entry steepness)
{
  return ((above >> 15) * steepness) >> 11;
}

/* The air of a current: field_arm + 4*air*flux_arm, a weight; and as a word, above 0. */
static inline number air_sum(entry air, entry flux_arm, entry field_arm)
{
  return field_arm + (((int32_t)air * flux_arm) >> 14);
}

static inline entry air_of_current(entry air, const arms_type *arms)
{
  return (entry)anhyst_clamp(air_sum(air, arms->flux_arm, arms->field_arm), 1, ANHYST_Q15_MAX);
}

/* What rounding can remove of the slope of a current: half a unit of either arm, and one for each
   product. */
static inline number sum_rounding(entry air, slope steepest)
{
  return 3 + (air >> 15) + (steepest >> 11);
}

/* The largest rise of a segment, for which slopes stay within ANHYST_SLOPE_MAX. */
static inline entry max_rise(uint16_t n)
{
  return (entry)(ANHYST_Q15_MAX >> (n > 5U ? n - 5U : 0U));
}

/* n over the slope d for n >= 0, d > 0, to 14 bits or exact; at most 4. */
static inline number quotient(number n, number d)
{
  const int32_t over = 16 - (int32_t)anhyst_headroom(n | 1);
  const int32_t down = over > 0 ? over : 0;
  const int32_t ratio = (int32_t)((uint32_t)n << (16 - down)) / d;
  const int32_t most = (UNIT * 4 - 1) >> down;
  return (int32_t)((uint32_t)(ratio < most ? ratio : most) << down);
}

/* The longest step along a tangent that needs no evaluation after it. */
static inline number tangent_step_of(entry steepness)
{
  const number step = MAX_TANGENT_STEP * 1024 / steepness;
  return step < MAX_TANGENT_STEP ? step : MAX_TANGENT_STEP;
}

/* 1 - 2^(-t) for t octaves, q26 in, q28 out. Below one octave a cubic for (1 - 2^-f)/f, whole
   octaves by shifting; error below 7e-5, and below 1.5e-4 of the result. */
static inline number forgotten(int32_t t)
{
  const uint16_t whole = (uint16_t)(t >> 26) & 31U; /* t is not negative */
  const int32_t rest = t & 0x3FFFFFF;
  const int32_t f = rest >> 11; /* q15 */
  int32_t ratio = 1775 - ((241 * f) >> 15);
  ratio = 7863 - ((ratio * f) >> 15);
  ratio = 22713 - ((ratio * f) >> 15);
  return UNIT - ((UNIT - anhyst_scale(rest * 8, (int16_t)ratio)) >> whole);
}

/* The share of its lead that the memory has lost after this much play. */
static inline number forgotten_along(fading fades, number travel)
{
  const int32_t octaves = anhyst_scale(travel * 4, fades.rate);
  if (octaves > ANHYST_Q31_MAX >> fades.shift) { /* beyond, all is forgotten */
    return UNIT;
  }
  return forgotten((int32_t)((uint32_t)octaves << fades.shift));
}

/* The field in which the memory fades to 1/e, at most 1. */
static inline number kappa_of(entry steepness)
{
  return steepness > 256 ? UNIT / steepness * 256 : UNIT;
}

/* a*share for a share of 0..1. */
static inline number share_of(number a, number share)
{
  return anhyst_scale(a, anhyst_sat_q15(share >> 13)) * 2;
}

/* A quarter of a number of -2..2 as a weight, and a part of it. */
static inline entry lead_of(number a) { return anhyst_sat_q15((0x2000 + a) >> 14); }

static inline number part_of_lead(number part, entry lead) { return anhyst_scale(part, lead) * 4; }

static inline number bounded(number a) { return anhyst_sat_q28(a); }

/* A limit of the current at this word of the block, as a number inside. */
static inline number current_limit(const entry *words, int16_t word)
{
  return ((int32_t)words[word] * 8192) >> (uint16_t)words[ANHYST_WORD_CURRENT_SHIFT];
}

#endif
