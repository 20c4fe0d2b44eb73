/* SPDX-License-Identifier: Apache-2.0 */
/* Proves the code that the closed form and Euler's form share, and the step of Euler's form: from
   any memory, for any valid words. The step of a path is replaced by any result within -1..1. */
#define ANHYST_PORT_HEADER "contracts.h"
#include "any.h"

#define IS_WITHIN_ONE(a) ((a) >= -ANHYST_Q30_ONE && (a) <= ANHYST_Q30_ONE)

#ifdef EULER
#include "compensator/euler.c"
#else
#include "compensator/simplified_fixed.h"

static int32_t stored_path_start(const int16_t *words, int32_t state)
{
  SHOW(IS_WITHIN_ONE(state));
  return any_within(-ANHYST_Q30_ONE, ANHYST_Q31_MAX);
}

static int32_t state_at_flux(const int16_t *words, const anhyst_simplified_memory *path,
                             int32_t flux)
{
  SHOW(IS_WITHIN_ONE(flux) && IS_WITHIN_ONE(path->start_flux) && IS_WITHIN_ONE(path->peak_flux) &&
       IS_WITHIN_ONE(path->u) && path->start_state >= -ANHYST_Q30_ONE);
  SHOW(flux > path->peak_flux && flux > path->start_flux);
  return any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE);
}

#include "compensator/generic/simplified.h"
#endif

/* Returns any memory after a step. */
static int is_memory(const anhyst_simplified_memory *memory)
{
  return IS_WITHIN_ONE(memory->flux) && IS_WITHIN_ONE(memory->u) &&
         IS_WITHIN_ONE(memory->start_flux) && IS_WITHIN_ONE(memory->peak_flux) &&
         memory->start_state >= -ANHYST_Q30_ONE;
}

static anhyst_simplified_memory any_memory(void)
{
  const anhyst_simplified_memory memory = {nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32(),
                                           nondet_i32()};
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
static inline number state_slope(const entry *words, number state)
{
  SHOW(IS_WITHIN_ONE(state));
  return any_within(0, MAX_STATE_SLOPE);
}
#endif

/* ---- proofs ---- */

static void assume_valid(const int16_t *words)
{
  ASSUME(words[ANHYST_WORD_SIMPLE_RATE] > 0 && words[ANHYST_WORD_SIMPLE_HOLD] > 0);
  ASSUME(words[ANHYST_WORD_SIMPLE_RATE_SHIFT] >= 0 && words[ANHYST_WORD_SIMPLE_RATE_SHIFT] <= 12);
  ASSUME(words[ANHYST_WORD_SIMPLE_HOLD_SHIFT] >= 0 && words[ANHYST_WORD_SIMPLE_HOLD_SHIFT] <= 12);
  ASSUME(words[ANHYST_WORD_SIMPLE_REST] > 0 && words[ANHYST_WORD_SIMPLE_BAND] >= 0);
  ASSUME(words[ANHYST_WORD_SIMPLE_ITERATIONS] >= 2);
}

static void prove_quotient(void)
{
  SHOW(anhyst_quotient(any_within(1, ANHYST_Q31_MAX), any_within(1, ANHYST_Q31_MAX)) >= 0);
}

static void prove_lag_slope(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS];
  assume_valid(words);
  const int32_t slope = state_slope(words, any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE));
  SHOW(slope >= 0 && slope <= MAX_STATE_SLOPE);
}

static void prove_field(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS];
  anhyst_compensator c;
  assume_valid(words);
  c.words = words;
  c.memory.simplified = any_memory();
  c.flux = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE);
  SHOW(IS_WITHIN_ONE(simplified_field_for_flux(&c)));
  SHOW(is_memory(&c.next.memory.simplified));
}

static void prove_flux(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS];
  anhyst_compensator c;
  const anhyst_arms arms = {any_within(-ANHYST_Q30_ONE / 2, ANHYST_Q30_ONE / 2),
                            (int16_t)any_within(0, ANHYST_Q15_MAX),
                            (int16_t)any_within(1, ANHYST_Q15_MAX)};
  assume_valid(words);
  c.words = words;
  c.memory.simplified = any_memory();
  c.next.memory.simplified = any_memory();
  c.arms = arms;
  c.stage = nondet_u16();
  ASSUME(words[ANHYST_WORD_SIMPLE_ITERATIONS] <= 3);
  SHOW(IS_WITHIN_ONE(simplified_flux_for_current(&c, nondet_i32())));
  SHOW(is_memory(&c.next.memory.simplified));
}

static void prove_transfer(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS];
  anhyst_compensator c;
  assume_valid(words);
  c.words = words;
  c.memory.simplified = any_memory();
  simplified_transfer_state(&c, words, any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE));
  SHOW(is_memory(&c.memory.simplified));
}

#ifdef EULER
static void prove_euler_step(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS];
  anhyst_simplified_memory path = any_memory();
  ASSUME(is_memory(&path));
  assume_valid(words);
  ASSUME(words[ANHYST_WORD_EULER_SUBSTEPS] >= 1 && words[ANHYST_WORD_EULER_SUBSTEPS] <= 16);
  const int32_t flux = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE);
  ASSUME(flux > path.peak_flux);
  SHOW(IS_WITHIN_ONE(state_at_flux(words, &path, flux)));
}
#endif

int main(void)
{
  PART();
  return 0;
}
