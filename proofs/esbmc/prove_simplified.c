/* SPDX-License-Identifier: Apache-2.0 */
/* Proves the step of the closed form: from any path of a memory, for any valid words and any table
   that never falls below zero. */
#define ANHYST_PORT_HEADER "contracts.h"
#include "any.h"

/* The properties of every entry that the check of a block guarantees; proofs.toml inserts this
   where an entry is read. */
#define VALID_ENTRY(entry) ASSUME((entry) >= 0);

#include "compensator/simplified.c"

enum { WORDS = ANHYST_BLOCK_MOST_WORDS };

/* Fills valid words, with the table of the curve anywhere in the block. */
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
static number state_at_distance(const entry *words, number z)
{
  SHOW(z >= 0);
  return any_within(0, ANHYST_Q30_ONE);
}

static number distance_at_state(const entry *words, number state)
{
  SHOW(state >= 0 && state <= ANHYST_Q30_ONE);
  return any_within(0, ANHYST_Q31_MAX);
}
#endif

#ifdef VALUE_BY_CONTRACT
static const int16_t *block;

static inline int32_t anhyst_table_value(anhyst_table_position table_position)
{
  const int32_t n = block[ANHYST_WORD_SIMPLE_SEGMENTS];
  const int16_t *first = block + block[ANHYST_WORD_SIMPLE_CURVE];
  SHOW(table_position.segment >= first &&
       table_position.segment < first + ((block[ANHYST_WORD_SIMPLE_OCTAVES] + 1) << n));
  SHOW(table_position.fraction >= 0 && table_position.fraction <= 32768);
  return any_within(0, ANHYST_Q15_MAX * 32768);
}

static void prove_state_at_distance(void)
{
  int16_t words[WORDS];
  any_words(words);
  block = words;
  const int32_t state = state_at_distance(words, any_within(0, ANHYST_Q31_MAX));
  SHOW(state >= 0 && state <= ANHYST_Q30_ONE);
}
#endif

static void prove_step(void)
{
  int16_t words[WORDS];
  any_words(words);
  const int32_t state = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE);
  SHOW(stored_path_start(words, state) >= -ANHYST_Q30_ONE);
  anhyst_simplified_memory path = {0, state, any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE), 0,
                                   any_within(-ANHYST_Q30_ONE, ANHYST_Q31_MAX)};
  const int32_t flux = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE);
  ASSUME(flux > path.start_flux);
  const int32_t found = state_at_flux(words, &path, flux);
  SHOW(found >= -ANHYST_Q30_ONE && found <= ANHYST_Q30_ONE);
}

static void prove_distance_at_state(void)
{
  int16_t words[WORDS];
  any_words(words);
  SHOW(distance_at_state(words, any_within(0, ANHYST_Q30_ONE)) >= 0);
}

int main(void)
{
  PART();
  return 0;
}
