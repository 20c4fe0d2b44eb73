/* SPDX-License-Identifier: Apache-2.0 */
/* The effective-field law with its exact step, in fixed point.

   In the law's own units the iron obeys h*x + m = flux, and a current gives
   flux_arm*flux + field_arm*x. Both are one equation, air*x + iron*m = target, and both slopes are
   positive, so the solution is unique. Everything happens on a path that rises: a falling one is
   mirrored, which the law does not notice. Along a path

     m = (1-c)*y + c*L(x),   y = A(x) + (y0 - A(b))*exp(-(x - b)/kappa)   beyond the departure b,

   with L the anhysteretic curve and A the ascending branch of a fully pinned iron, both tables. As
   the lag only ever forgets, an error of a table appears in y at most once, however long one goes
   on. */
#include "anhyst/compensator.h"
#include "block.h"
#include "lookup.h"

/* An interval of the field too long for a tangent to be trusted at its ends: 1/64. */
#define LONG_WAY (ANHYST_Q30_ONE / 64)

/* A step too short to matter, about what the tables leave unsure: 6e-5. */
#define SHORT_WAY (ANHYST_Q30_ONE / 16384)

/* A rising path, prepared for evaluation at many places. */
typedef struct {
  const int16_t *words;
  anhyst_memory from;
  int32_t departure;        /* of the irreversible part, q30 */
  int32_t branch_departure; /* A there, q30 */
  int16_t lead;             /* weight: (A(b) - y0)/4 */
} path;

/* What the law answers at one place of it. */
typedef struct {
  int32_t x;
  int32_t y;
  int32_t p;
  int32_t m;
  int32_t m_slope; /* dm/dx in 1/1024 */
} answer;

static anhyst_spot curve_spot(const int16_t *words, int32_t magnitude)
{
  return anhyst_spot_of(words + words[ANHYST_WORD_FULL_CURVE],
                        (uint16_t)words[ANHYST_WORD_FULL_CURVE_SEGMENTS], magnitude);
}

/* L(x) of |x| <= 1, q30, and its slope. */
static int32_t curve(const int16_t *words, int32_t x, int32_t *slope)
{
  const anhyst_spot spot = curve_spot(words, anhyst_abs_q31(x));
  const int32_t value = anhyst_value_at(spot);
  *slope = anhyst_slope_at(spot, (uint16_t)words[ANHYST_WORD_FULL_CURVE_SEGMENTS]);
  return x < 0 ? -value : value;
}

/* A(x) of |x| <= 1, q30, and its slope. */
static int32_t branch(const int16_t *words, int32_t x, int32_t *slope)
{
  const uint16_t n = (uint16_t)words[ANHYST_WORD_FULL_CURVE_SEGMENTS];
  const anhyst_spot spot = anhyst_spot_of(words + words[ANHYST_WORD_FULL_BRANCH],
                                          (uint16_t)(n + 1U), (x >> 1) + ANHYST_Q30_ONE / 2);
  *slope = anhyst_slope_at(spot, n);
  return anhyst_value_at(spot);
}

/* The field at which L reaches y, q30. */
static int32_t inverse_curve(const int16_t *words, int32_t y)
{
  const anhyst_spot spot =
      anhyst_spot_of(words + words[ANHYST_WORD_FULL_INVERSE],
                     (uint16_t)words[ANHYST_WORD_FULL_INVERSE_SEGMENTS], anhyst_abs_q31(y));
  const int32_t value = anhyst_value_at(spot);
  return y < 0 ? -value : value;
}

/* 1 - 2^(-t) for a way of t octaves, q26 in, q30 out. Below one octave a cubic for (1 - 2^-f)/f,
   whole octaves by shifting; error below 2e-5, relative to t where t is small. */
static int32_t forgotten(int32_t way)
{
  const uint16_t whole = (uint16_t)(way >> 26) & 31U; /* way is not negative */
  const int32_t rest = way & 0x3FFFFFF;
  const int16_t f = (int16_t)(rest >> 11); /* q15 */
  int16_t ratio = anhyst_sub_q15(1775, anhyst_mul_q15(241, f));
  ratio = anhyst_sub_q15(7863, anhyst_mul_q15(ratio, f));
  ratio = anhyst_sub_q15(22713, anhyst_mul_q15(ratio, f));
  const int32_t part = anhyst_scale(rest * 16, ratio) * 2;
  return whole == 0U ? part : ANHYST_Q30_ONE - ((ANHYST_Q30_ONE - part) >> whole);
}

/* m = y + c*(L - y). */
static int32_t magnetisation(const int16_t *words, int32_t y, int32_t anhysteretic)
{
  const int16_t c = words[ANHYST_WORD_FULL_REVERSIBLE];
  return y + (anhyst_scale(anhysteretic, c) - anhyst_scale(y, c)) * 2;
}

static void depart(path *along, const int16_t *words, const anhyst_memory *from)
{
  int32_t slope;
  const int32_t pull = curve(words, from->c, &slope);
  along->words = words;
  along->from = *from;
  along->departure = from->c;
  if (pull < from->b) {
    /* Held until the anhysteretic has crossed y; what b is exactly hardly matters, since y
       leaves with slope zero. */
    const int32_t crossing = inverse_curve(words, from->b);
    along->departure = crossing > from->c ? crossing : from->c;
  }
  along->branch_departure = branch(words, along->departure, &slope);
  along->lead = anhyst_sat_q15((((along->branch_departure >> 1) - (from->b >> 1)) + 0x4000) >> 15);
}

/* The irreversible part where the play stands at p; *slope is dy/dp in 1/1024. */
static int32_t irreversible(const path *along, int32_t p, int32_t *slope)
{
  const int16_t *words = along->words;
  *slope = 0;
  if (p <= along->departure) {
    return along->from.b;
  }
  int32_t rise;
  const int32_t here = branch(words, p, &rise);
  const int32_t way =
      anhyst_shl_q31(anhyst_scale(p - along->departure, words[ANHYST_WORD_FULL_RATE]),
                     (uint16_t)words[ANHYST_WORD_FULL_RATE_SHIFT]);
  const int32_t faded =
      anhyst_add_q31(along->from.b, anhyst_scale(forgotten(way), along->lead) * 4);
  const int32_t y = anhyst_clamp(anhyst_add_q31(faded, here - along->branch_departure),
                                 along->from.b, ANHYST_Q30_ONE);
  const int32_t towards = ((here >> 17) - (y >> 17)) * words[ANHYST_WORD_FULL_STEEPNESS];
  *slope = anhyst_clamp(rise + (towards >> 11), 0, ANHYST_SLOPE_MAX);
  return y;
}

static void evaluate(const path *along, int32_t x, answer *at)
{
  const int16_t *words = along->words;
  const int32_t play = (int32_t)words[ANHYST_WORD_FULL_PLAY] * 32768;
  int32_t x_slope;
  int32_t y_slope;
  const int32_t anhysteretic = curve(words, x, &x_slope);
  at->x = x;
  at->p = x - play > along->from.c ? x - play : along->from.c;
  at->y = irreversible(along, at->p, &y_slope);
  at->m = magnetisation(words, at->y, anhysteretic);
  at->m_slope = y_slope + (((x_slope - y_slope) * words[ANHYST_WORD_FULL_REVERSIBLE]) >> 15);
}

/* Where the path would meet its target if m rose like the anhysteretic curve: a guess that holds
   over long ways, where a tangent does not. residual is that at x. */
static int32_t follow_curve(const int16_t *words, int32_t x, int16_t iron, int32_t residual)
{
  int32_t slope;
  const int32_t level = curve(words, x, &slope);
  const int32_t missing = anhyst_quotient(anhyst_abs_q31(residual), iron > 0 ? iron : 1);
  const int32_t wanted =
      residual < 0 ? anhyst_add_q31(level, missing) : anhyst_sub_q31(level, missing);
  return inverse_curve(words, anhyst_clamp(wanted, -ANHYST_Q30_ONE, ANHYST_Q30_ONE));
}

/* x - residual/slope, saturating. */
static int32_t follow_tangent(int32_t x, int32_t residual, int32_t slope)
{
  if (residual == 0) {
    return x;
  }
  return residual < 0 ? anhyst_add_q31(x, anhyst_quotient(-residual, slope))
                      : anhyst_sub_q31(x, anhyst_quotient(residual, slope));
}

/* Whether a step stays inside the interval and is shorter by a quarter than the last one, since
   tangents can swing to and fro across the two bends of the curve; or is too short to matter. */
static int nearer(int32_t x, int32_t next, int32_t low, int32_t high, int32_t furthest)
{
  const int32_t way = anhyst_abs_q31(anhyst_sub_q31(next, x));
  return way <= SHORT_WAY || (next > low && next < high && way <= furthest - furthest / 4);
}

/* Solves air*x + iron*m = target along a rising path on which the residual begins below zero.
   Newton's steps inside an interval that always holds the solution; a step that leaves it follows
   the anhysteretic curve instead, or goes to the middle. The number of evaluations is fixed; what
   is left of the residual after them is part of the accuracy budget. */
static void rise(const path *along, int16_t air, int16_t iron, int32_t target, answer *at)
{
  int32_t low = along->from.a;
  int32_t high = ANHYST_Q30_ONE - 1;
  int32_t furthest = ANHYST_Q31_MAX;
  int32_t x = low;
  for (int16_t i = along->words[ANHYST_WORD_FULL_ITERATIONS]; i > 0; i--) {
    evaluate(along, x, at);
    const int32_t residual = anhyst_scale(x, air) + anhyst_scale(at->m, iron) - target;
    int32_t next = follow_tangent(x, residual, air + ((iron * at->m_slope) >> 10));
    if (residual < 0) {
      low = x;
    } else {
      high = x;
    }
    if (nearer(x, next, low, high, furthest)) {
      next = anhyst_clamp(next, low, high);
      furthest = anhyst_abs_q31(anhyst_sub_q31(next, x));
    } else {
      next = high - low > LONG_WAY ? follow_curve(along->words, x, iron, residual) : low;
      if (next <= low || next >= high) {
        next = low + (high - low) / 2;
      }
      furthest = high - low;
    }
    x = next;
  }
  evaluate(along, x, at);
}

/* Solves air*x + iron*m = target from a memory; |target| below 1, air above 0. *at is mirrored
   back. */
static void solve(const int16_t *words, const anhyst_memory *from, int16_t air, int16_t iron,
                  int32_t target, answer *at)
{
  int32_t slope;
  anhyst_memory start = *from;
  const int32_t m = magnetisation(words, start.b, curve(words, start.a, &slope));
  const int32_t residual = anhyst_scale(start.a, air) + anhyst_scale(m, iron) - target;
  if (residual == 0) {
    at->x = start.a;
    at->y = start.b;
    at->p = start.c;
    at->m = m;
    return;
  }
  if (residual > 0) {
    start.a = -start.a;
    start.b = -start.b;
    start.c = -start.c;
    target = -target;
  }
  path along;
  depart(&along, words, &start);
  rise(&along, air, iron, target, at);
  if (residual > 0) {
    at->x = -at->x;
    at->y = -at->y;
    at->p = -at->p;
    at->m = -at->m;
  }
}

static void remember(const answer *at, anhyst_memory *to)
{
  to->a = at->x;
  to->b = at->y;
  to->c = at->p;
}

static int32_t full_field(const int16_t *words, const anhyst_memory *from, int32_t flux,
                          anhyst_memory *to)
{
  answer at;
  solve(words, from, words[ANHYST_WORD_FULL_AIR], 16384, flux >> 2, &at);
  remember(&at, to);
  return at.x;
}

static int32_t full_flux(const int16_t *words, const anhyst_memory *from, const anhyst_arms *arms,
                         int32_t current, anhyst_memory *to)
{
  const int32_t air_arm = ((int32_t)words[ANHYST_WORD_FULL_AIR] * arms->flux_arm) >> 14;
  const int16_t air = anhyst_sat_q15(arms->field_arm + air_arm);
  const int32_t target =
      anhyst_clamp(anhyst_sub_q31(current, arms->bias), -ANHYST_Q30_ONE + 1, ANHYST_Q30_ONE - 1);
  answer at;
  solve(words, from, air, arms->flux_arm, target, &at);
  remember(&at, to);
  return at.m + anhyst_scale(at.x, words[ANHYST_WORD_FULL_AIR]) * 4;
}

static int full_sound(const int16_t *words)
{
  const int16_t n = words[ANHYST_WORD_FULL_CURVE_SEGMENTS];
  const int16_t n_inverse = words[ANHYST_WORD_FULL_INVERSE_SEGMENTS];
  return words[ANHYST_WORD_FULL_AIR] > 0 && words[ANHYST_WORD_FULL_REVERSIBLE] >= 0 &&
         words[ANHYST_WORD_FULL_PLAY] >= 0 && words[ANHYST_WORD_FULL_RATE] > 0 &&
         anhyst_within(words[ANHYST_WORD_FULL_RATE_SHIFT], 0, 12) &&
         words[ANHYST_WORD_FULL_STEEPNESS] > 0 &&
         anhyst_within(words[ANHYST_WORD_FULL_ITERATIONS], 2, 16) && anhyst_within(n, 3, 9) &&
         anhyst_within(n_inverse, 3, 9) &&
         anhyst_table_rises(words, words[ANHYST_WORD_FULL_CURVE], (int16_t)((1 << n) + 1), 0) &&
         anhyst_table_rises(words, words[ANHYST_WORD_FULL_BRANCH], (int16_t)((2 << n) + 1),
                            -ANHYST_Q15_MAX) &&
         anhyst_table_rises(words, words[ANHYST_WORD_FULL_INVERSE], (int16_t)((1 << n_inverse) + 1),
                            0);
}

const anhyst_kernel anhyst_kernel_full = {ANHYST_KIND_FULL, full_field, full_flux, full_sound};
