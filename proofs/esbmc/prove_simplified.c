/* SPDX-License-Identifier: Apache-2.0 */
/* How the closed form advances: from any memory within the invariant, for any valid words and any
   table that never falls below zero. */
#define ANHYST_PORT_HEADER "contracts.h"
#include "any.h"

/* What the check of a block says of every entry; proofs.toml puts it where one is read. */
#define VALID_ENTRY(entry) ASSUME((entry) >= 0);

#include "compensator/simplified.c"

enum { WORDS = ANHYST_BLOCK_MOST_WORDS };

/* Valid words; the table of the curve lies anywhere in the block. */
static void any_words(int16_t *words)
{
  ASSUME(words[ANHYST_WORD_SIMPLE_RATE] > 0 && words[ANHYST_WORD_SIMPLE_HOLD] > 0);
  ASSUME(words[ANHYST_WORD_SIMPLE_RATE_SHIFT] >= 0 && words[ANHYST_WORD_SIMPLE_RATE_SHIFT] <= 12);
  ASSUME(words[ANHYST_WORD_SIMPLE_HOLD_SHIFT] >= 0 && words[ANHYST_WORD_SIMPLE_HOLD_SHIFT] <= 12);
  ASSUME(words[ANHYST_WORD_SIMPLE_REST] > 0);
  ASSUME(words[ANHYST_WORD_SIMPLE_OCTAVES] >= 4 && words[ANHYST_WORD_SIMPLE_OCTAVES] <= 14);
  ASSUME(words[ANHYST_WORD_SIMPLE_SEGMENTS] >= 2 && words[ANHYST_WORD_SIMPLE_SEGMENTS] <= 6);
  const int32_t entries =
      ((words[ANHYST_WORD_SIMPLE_OCTAVES] + 1) << words[ANHYST_WORD_SIMPLE_SEGMENTS]) + 1;
  ASSUME(words[ANHYST_WORD_SIMPLE_CURVE] >= ANHYST_BLOCK_LEAST_WORDS);
  ASSUME(words[ANHYST_WORD_SIMPLE_CURVE] + entries <= WORDS);
}

/* ---- contracts ---- */

#ifdef LEAVES_BY_CONTRACT
static int32_t p_of(const int16_t *words, int32_t z)
{
  SHOW(z >= 0);
  return any_within(0, ANHYST_Q30_ONE);
}

static int32_t z_of(const int16_t *words, int32_t p)
{
  SHOW(p >= 0 && p <= ANHYST_Q30_ONE);
  return any_within(0, ANHYST_Q31_MAX);
}
#endif

#ifdef VALUE_BY_CONTRACT
static const int16_t *block;

static inline int32_t anhyst_value_at(anhyst_spot spot)
{
  const int32_t n = block[ANHYST_WORD_SIMPLE_SEGMENTS];
  const int16_t *first = block + block[ANHYST_WORD_SIMPLE_CURVE];
  SHOW(spot.at >= first && spot.at < first + ((block[ANHYST_WORD_SIMPLE_OCTAVES] + 1) << n));
  SHOW(spot.part >= 0 && spot.part <= 32768);
  return any_within(0, ANHYST_Q15_MAX * 32768);
}

static void prove_p_of(void)
{
  int16_t words[WORDS];
  any_words(words);
  block = words;
  const int32_t p = p_of(words, any_within(0, ANHYST_Q31_MAX));
  SHOW(p >= 0 && p <= ANHYST_Q30_ONE);
}
#endif

static void prove_advance(void)
{
  int16_t words[WORDS];
  any_words(words);
  anhyst_simplified_memory from = {nondet_i32(), any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE),
                        any_within(-ANHYST_Q31_MAX, ANHYST_Q31_MAX)};
  anhyst_simplified_memory to;
  advance(words, &from, any_within(0, ANHYST_Q31_MAX), &to);
  SHOW(to.flux == from.flux && to.z >= 0);
  SHOW(to.u >= -ANHYST_Q30_ONE && to.u <= ANHYST_Q30_ONE);
}

static void prove_z_of(void)
{
  int16_t words[WORDS];
  any_words(words);
  SHOW(z_of(words, any_within(0, ANHYST_Q30_ONE)) >= 0);
}

int main(void)
{
  PART();
  return 0;
}
