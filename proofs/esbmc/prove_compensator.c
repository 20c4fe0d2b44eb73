/* SPDX-License-Identifier: Apache-2.0 */
/* Proves the code around the kernels: a whole tick of the compensator for any valid head of a
   block, any demand, gap and applied current, and any kernel that satisfies its contract. */
#define ANHYST_PORT_HEADER "contracts.h"
#include "any.h"

#include "compensator/compensator.c"

/* 0 for kernels that accept no negative flux arm */
static int32_t least_flux_arm;

/* Different words for each table, so that the replacement of interpolate_over_gap() knows the range
   of its entries. */
enum { GAIN = 101, OFFSET, BIAS, FLUX_ARM, FIELD_ARM, LAG_ARM };

static void any_head(int16_t *words)
{
  ASSUME(words[ANHYST_WORD_POWER] >= 1 && words[ANHYST_WORD_POWER] <= 2);
  ASSUME(words[ANHYST_WORD_DEMAND_LOW] <= words[ANHYST_WORD_DEMAND_HIGH]);
  ASSUME(words[ANHYST_WORD_CURRENT_LOW] <= words[ANHYST_WORD_CURRENT_HIGH]);
  ASSUME(words[ANHYST_WORD_CURRENT_SHIFT] >= 0 && words[ANHYST_WORD_CURRENT_SHIFT] <= 8);
  ASSUME(words[ANHYST_WORD_FLUX_LIMIT] >= 1 && words[ANHYST_WORD_FLUX_LIMIT] <= 16384);
  ASSUME(words[ANHYST_WORD_FLUX_SHIFT] >= 0 && words[ANHYST_WORD_FLUX_SHIFT] <= 6);
  ASSUME(words[ANHYST_WORD_GAP_SEGMENTS] >= 0 && words[ANHYST_WORD_GAP_SEGMENTS] <= 6);
  ASSUME(words[ANHYST_WORD_CONDITION_CYCLES] >= 0 && words[ANHYST_WORD_CONDITION_CYCLES] <= 64);
  ASSUME(words[ANHYST_WORD_CONDITION_TICKS] >= 2);
  ASSUME(words[ANHYST_WORD_ROOT_KNEE] >= 2 && words[ANHYST_WORD_ROOT_KNEE] <= 8);
  words[ANHYST_WORD_GAP_GAIN] = GAIN;
  words[ANHYST_WORD_GAP_OFFSET] = OFFSET;
  words[ANHYST_WORD_GAP_BIAS] = BIAS;
  words[ANHYST_WORD_GAP_FLUX_ARM] = FLUX_ARM;
  words[ANHYST_WORD_GAP_FIELD_ARM] = FIELD_ARM;
  words[ANHYST_WORD_GAP_LAG_ARM] = nondet_i16() != 0 ? LAG_ARM : 0;
  words[ANHYST_WORD_LAG_LEAKY] = (int16_t)any_within(0, ANHYST_Q15_MAX);
  words[ANHYST_WORD_LAG_KEEP] = (int16_t)any_within(0, ANHYST_Q15_MAX);
}

static int32_t any_field(anhyst_compensator *c)
{
  SHOW(c->flux >= -ANHYST_Q30_ONE && c->flux <= ANHYST_Q30_ONE);
  return any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE);
}

static int32_t any_flux(anhyst_compensator *c, int32_t current)
{
  const anhyst_arms *arms = &c->arms;
  SHOW(arms->flux_arm >= least_flux_arm && arms->field_arm > 0);
  SHOW(arms->bias >= -ANHYST_Q30_ONE / 2 && arms->bias <= ANHYST_Q30_ONE / 2);
  return nondet_i32();
}

static void any_carry(anhyst_compensator *c, const int16_t *words, int32_t flux)
{
  SHOW(flux >= -ANHYST_Q30_ONE && flux <= ANHYST_Q30_ONE);
}

static const anhyst_kernel any_kernel = {ANHYST_KIND_FULL, any_field, any_flux, 0,
                                         any_carry,        0,         0,        0};

/* ---- contracts ---- */

#ifdef LEAVES_BY_CONTRACT
static int16_t interpolate_over_gap(gap_position position, int16_t first)
{
  if (first == GAIN || first == FIELD_ARM) {
    return (int16_t)any_within(1, ANHYST_Q15_MAX);
  }
  if (first == LAG_ARM) {
    return (int16_t)any_within(0, ANHYST_Q15_MAX);
  }
  return (int16_t)any_within(first == FLUX_ARM ? least_flux_arm : -ANHYST_Q15_MAX, ANHYST_Q15_MAX);
}

static int32_t root_with_knee(int32_t a, int16_t knee)
{
  SHOW(a >= 0 && knee >= 2 && knee <= 8);
  return any_within(0, ANHYST_Q30_ONE);
}

static inline int32_t anhyst_quotient(int32_t numerator, int32_t denominator)
{
  SHOW(numerator > 0 && denominator > 0);
  return any_within(0, ANHYST_Q31_MAX);
}
#endif

/* ---- proofs ---- */

static void prove_tick(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS + 80];
  anhyst_compensator c;
  any_head(words);
  least_flux_arm = nondet_i16() != 0 ? 0 : -ANHYST_Q15_MAX;
  c.kernel = &any_kernel;
  c.words = words;
  (void)anhyst_compensator_solve_q31(&c, nondet_i32(), nondet_i32());
  anhyst_compensator_commit_q31(&c, nondet_i32(), nondet_i32());
  (void)anhyst_compensator_solve_q15(&c, nondet_i16(), nondet_i16());
  anhyst_compensator_commit_q15(&c, nondet_i16(), nondet_i16());
}

static void prove_output(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS + 80];
  anhyst_compensator c;
  any_head(words);
  c.words = words;
  (void)anhyst_compensator_output_q31(&c);
  (void)anhyst_conditioning_q15(&c, nondet_i32());
}

static void prove_swap(void)
{
  int16_t words[ANHYST_BLOCK_LEAST_WORDS + 80];
  int16_t other[ANHYST_BLOCK_LEAST_WORDS + 80];
  anhyst_compensator c;
  any_head(words);
  any_head(other);
  c.kernel = &any_kernel;
  c.words = words;
  anhyst_compensator_swap(&c, other);
  SHOW(c.words == other && c.stage == ANHYST_STAGE_UNKNOWN);
}

/* Proves the interpolation at any gap, with any table over the gap in the block. */
static void prove_over_gap(void)
{
  int16_t words[ANHYST_BLOCK_MOST_WORDS]; /* any */
  ASSUME(words[ANHYST_WORD_GAP_SEGMENTS] >= 0 && words[ANHYST_WORD_GAP_SEGMENTS] <= 6);
  const int32_t segments = 1 << words[ANHYST_WORD_GAP_SEGMENTS];
  const int16_t first = (int16_t)any_within(ANHYST_BLOCK_LEAST_WORDS, ANHYST_BLOCK_MOST_WORDS);
  ASSUME(first + segments + 1 <= ANHYST_BLOCK_MOST_WORDS);
  const gap_position position = locate_gap(words, nondet_i32());
  SHOW(position.fraction >= 0 && position.fraction <= 32767);
  const int32_t segment = (int32_t)(position.words - words);
  SHOW(segment >= 0 && segment < segments);
  const int32_t change = (int32_t)words[first + segment + 1] - words[first + segment];
  ASSUME(change >= -ANHYST_Q15_MAX && change <= ANHYST_Q15_MAX);
  (void)interpolate_over_gap(position, first);
}

int main(void)
{
  PART();
  return 0;
}
