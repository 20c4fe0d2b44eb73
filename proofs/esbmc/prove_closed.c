/* SPDX-License-Identifier: Apache-2.0 */
/* What the closed form and Euler's form share, and Euler's step: from any memory within the
   invariant, for any valid words. How a kernel advances is left open in FRAME: any function that
   keeps the invariant. */
#define ANHYST_PORT_HEADER "contracts.h"
#include "any.h"

#include "compensator/closed.c"
#ifdef EULER
#define advance euler_advance
#include "compensator/euler.c"
#undef advance
#endif

#define WITHIN_ONE(a) ((a) >= -ANHYST_Q30_ONE && (a) <= ANHYST_Q30_ONE)

/* a: flux, as far as the compensator lets it; b: bounded state; c: distance or its mirror. */
static int is_memory(const anhyst_simplified_memory *memory)
{
  return memory->flux >= -ANHYST_Q30_ONE / 2 * 3 && memory->flux <= ANHYST_Q30_ONE / 2 * 3 &&
         WITHIN_ONE(memory->u) && memory->z >= -ANHYST_Q31_MAX;
}

static anhyst_simplified_memory any_memory(void)
{
  const anhyst_simplified_memory memory = {nondet_i32(), nondet_i32(), nondet_i32()};
  ASSUME(is_memory(&memory));
  return memory;
}

/* ---- contracts ---- */

#ifdef QUOTIENT_BY_CONTRACT
static inline int32_t anhyst_quotient(int32_t numerator, int32_t denominator)
{
  SHOW(numerator > 0 && denominator > 0);
  return any_within(0, ANHYST_Q31_MAX);
}
#endif

#ifdef SLOPE_BY_CONTRACT
static inline int32_t anhyst_lag_slope(const int16_t *words, int32_t p)
{
  SHOW(WITHIN_ONE(p));
  return any_within(0, ANHYST_LAG_SLOPE_MAX);
}
#endif

static void any_advance(const int16_t *words, anhyst_simplified_memory *start, int32_t way, anhyst_simplified_memory *to)
{
  SHOW(way >= 0 && is_memory(start));
  start->z = any_within(-ANHYST_Q31_MAX, ANHYST_Q31_MAX);
  to->flux = start->flux;
  to->u = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE);
  to->z = any_within(0, ANHYST_Q31_MAX);
}

/* ---- proofs ---- */

static void assume_valid(const int16_t *words) { ASSUME(anhyst_closed_is_valid(words)); }

static void prove_quotient(void)
{
  SHOW(anhyst_quotient(any_within(1, ANHYST_Q31_MAX), any_within(1, ANHYST_Q31_MAX)) >= 0);
}

static void prove_lag_slope(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS];
  assume_valid(words);
  const int32_t slope = anhyst_lag_slope(words, any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE));
  SHOW(slope >= 0 && slope <= ANHYST_LAG_SLOPE_MAX);
}

static void prove_field(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS];
  anhyst_compensator c;
  assume_valid(words);
  c.words = words;
  c.memory.simplified = any_memory();
  c.flux = any_within(-ANHYST_Q30_ONE / 2 * 3, ANHYST_Q30_ONE / 2 * 3);
  (void)anhyst_closed_field(&c, any_advance);
  SHOW(is_memory(&c.next.memory.simplified));
}

static void prove_flux(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS];
  anhyst_compensator c;
  const anhyst_arms arms = {any_within(-ANHYST_Q30_ONE / 2, ANHYST_Q30_ONE / 2),
                            (int16_t)any_within(0, ANHYST_Q15_MAX),
                            (int16_t)any_within(1, ANHYST_Q15_MAX)};
  const anhyst_memory there = {.simplified = any_memory()};
  const anhyst_candidate solved = {there, 0, 0, nondet_i16(), 0, 0, 0};
  assume_valid(words);
  c.words = words;
  c.memory.simplified = any_memory();
  c.arms = arms;
  c.next = solved;
  ASSUME(words[ANHYST_WORD_SIMPLE_ITERATIONS] <= 3);
  (void)anhyst_closed_flux(&c, nondet_i32(), any_advance);
  SHOW(is_memory(&c.next.memory.simplified));
}

#ifdef EULER
static void prove_euler(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS];
  anhyst_simplified_memory from = any_memory();
  anhyst_simplified_memory to;
  ASSUME(euler_is_valid(words));
  euler_advance(words, &from, any_within(0, ANHYST_Q31_MAX), &to);
  SHOW(is_memory(&to));
}
#endif

int main(void)
{
  PART();
  return 0;
}
