/* SPDX-License-Identifier: Apache-2.0 */
/* Proves the check of a parameter block, for any number of any words: nothing is read beyond them,
   nothing overflows, and a block that passes has the properties that the proofs of the compensators
   assume. The memory ends with the last word. The number of iterations of a
   loop over words or entries depends on the block. Therefore, proofs.toml selects an arbitrary
   iteration at the start of the body and leaves the loop after it. For tables, this is the
   iteration of `watched`, so that the checked properties of any entry are known. */
#include <stdlib.h>

#ifdef IN_UNIT
#define ANHYST_PORT_HEADER "contracts.h"
#endif
#include "any.h"

static int16_t watched;

#define SELECT_ANY_ITERATION(i, low, high)                                                         \
  (i) = watched;                                                                                   \
  ASSUME((i) >= (low) && (i) < (high));

#include "compensator/block.c"
#if defined(IN_UNIT)
#elif defined(SIMPLIFIED)
#include "compensator/simplified.c"
static const anhyst_kernel *const kernel = &anhyst_kernel_simplified;
#elif defined(EULER)
#include "compensator/euler.c"
static const anhyst_kernel *const kernel = &anhyst_kernel_euler;
#else
#include "compensator/full.c"
static const anhyst_kernel *const kernel = &anhyst_kernel_full;

#ifndef TABLE
/* Returns any result, because a solver cannot handle the products of this function. */
static int does_current_rise_with_field(const int16_t *words)
{
  (void)words;
  return nondet_i16() != 0;
}

/* Returns any result for a table in the block. TABLE proves that this is sufficient. */
static inline int is_table_rising(const entry *words, entry first, int32_t entries, entry least,
                                  entry max_rise)
{
  (void)least;
  (void)max_rise;
  return is_table_in_block(words, first, entries) && nondet_i16() != 0;
}
#endif
#endif

#ifdef IN_UNIT

/* This contract is proved in prove_map.c. */
static inline int32_t anhyst_ratio(int32_t numerator, int32_t denominator)
{
  SHOW(numerator >= 0 && numerator < denominator);
  return any_within(0, ANHYST_Q31_MAX);
}

int main(void)
{
  int16_t before[2]; /* any */
  int16_t words[2];
  ASSUME(is_single_float(before, 0) && is_single_float(words, 0));
  (void)convert_unit(any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE), before, words, 0);
  return 0;
}

#else

#ifdef TABLE

/* Proves that no table of a block is read beyond the words. */
int main(void)
{
  const uint16_t capacity = nondet_u16();
  int16_t *words = (int16_t *)malloc(2 * (size_t)capacity);
  ASSUME(words != NULL && capacity >= ANHYST_BLOCK_LEAST_WORDS);
  ASSUME(words[ANHYST_WORD_LENGTH] <= capacity);
  watched = nondet_i16();
  (void)is_table_rising(words, (entry)nondet_i16(), nondet_i32(), (entry)nondet_i16(),
                        (entry)nondet_i16());
  return 0;
}

#else

/* A table over the gap: inside the block, with known properties of the watched entry and the one
   before. */
static void show_over_gap(const int16_t *words, int16_t word, int16_t least)
{
  const int32_t first = words[word];
  const int32_t segments = 1 << words[ANHYST_WORD_GAP_SEGMENTS];
  SHOW(first >= ANHYST_BLOCK_LEAST_WORDS && first + segments < words[ANHYST_WORD_LENGTH]);
  SHOW(words[first + watched] >= least);
  if (watched > 0) {
    const int32_t change = (int32_t)words[first + watched] - words[first + watched - 1];
    SHOW(change >= -ANHYST_Q15_MAX && change <= ANHYST_Q15_MAX);
  }
}

int main(void)
{
  const uint16_t capacity = nondet_u16();
  int16_t *words = (int16_t *)malloc(2 * (size_t)capacity);
  ASSUME(words != NULL);
  watched = nondet_i16();
  if (anhyst_block_check(kernel, words, capacity) == ANHYST_OK) {
    SHOW((uint16_t)words[ANHYST_WORD_LENGTH] <= capacity);
    SHOW(words[ANHYST_WORD_CURRENT_SHIFT] >= 0 && words[ANHYST_WORD_CURRENT_SHIFT] <= 8);
    SHOW(words[ANHYST_WORD_FLUX_LIMIT] >= 1 && words[ANHYST_WORD_FLUX_LIMIT] <= 16384);
    SHOW(words[ANHYST_WORD_FLUX_SHIFT] >= 0 && words[ANHYST_WORD_FLUX_SHIFT] <= 6);
    SHOW(words[ANHYST_WORD_GAP_SEGMENTS] >= 0 && words[ANHYST_WORD_GAP_SEGMENTS] <= 6);
    SHOW(words[ANHYST_WORD_CONDITION_TICKS] >= 2);
    SHOW(words[ANHYST_WORD_ROOT_KNEE] >= 2 && words[ANHYST_WORD_ROOT_KNEE] <= 8);
    show_over_gap(words, ANHYST_WORD_GAP_GAIN, 1);
    show_over_gap(words, ANHYST_WORD_GAP_OFFSET, -ANHYST_Q15_MAX);
    show_over_gap(words, ANHYST_WORD_GAP_BIAS, -ANHYST_Q15_MAX);
    show_over_gap(words, ANHYST_WORD_GAP_FIELD_ARM, 1);
#if defined(SIMPLIFIED) || defined(EULER)
    show_over_gap(words, ANHYST_WORD_GAP_FLUX_ARM, 0);
#else
    show_over_gap(words, ANHYST_WORD_GAP_FLUX_ARM, -ANHYST_Q15_MAX);
#endif
  }
  return 0;
}

#endif
#endif
