/* SPDX-License-Identifier: Apache-2.0 */
/* Words of a floating-point block, for block_checks.h. Include after f32.h or f64.h. */
#ifndef ANHYST_BLOCK_REAL_H
#define ANHYST_BLOCK_REAL_H

#define ENTRY_ONE ((entry)1)
#define MIN_WEIGHT ((entry)1e-30) /* smallest positive weight */
#define MAX_ENTRY ((entry)1e9)
#define MAX_FLUX_LIMIT ((entry)1)
#define MAX_CURRENT_SHIFT 0
#define MAX_FLUX_SHIFT 0
#define MAX_BLOCK_WORDS ANHYST_BLOCK_MOST_REAL_WORDS
/* Number of 16-bit halves in a word. */
#define HALVES_PER_WORD ((uint16_t)(sizeof(entry) / sizeof(uint16_t)))

/* Returns half of a word: the lowest 16 bits if the argument `half` is 0, for any byte order. */
static inline uint16_t half_word(entry word, uint16_t half)
{
  union {
    entry word;
    bits_type bits;
  } both;
  both.word = word;
  return (uint16_t)(both.bits >> (16U * half));
}

static inline int is_integer(entry word, int32_t low, int32_t high)
{
  return word >= (entry)low && word <= (entry)high && word == (entry)(int32_t)word;
}

/* Returns whether the bits of a word are those of an unsigned integer. */
static inline int equals_unsigned(entry word, uint16_t value)
{
  for (uint16_t half = 0; half < HALVES_PER_WORD; half++) {
    if (half_word(word, half) != half_word((entry)value, half)) {
      return 0;
    }
  }
  return 1;
}

/* Returns whether the absolute value of a table entry is at most MAX_ENTRY. */
static inline int is_entry_valid(entry word, entry previous)
{
  (void)previous;
  return word >= -MAX_ENTRY && word <= MAX_ENTRY;
}

static inline int is_single_float(const entry *words, int32_t word)
{
  return words[word] >= (entry)8.67361738e-19 && words[word] <= (entry)1.152921504606847e18 &&
         words[word + 1] == (entry)0;
}

/* Returns whether all scales are valid. The gap has an empty range if nothing depends on it. */
static inline int are_scales_valid(const entry *words)
{
  const entry low = words[ANHYST_WORD_SCALE_GAP_LOW];
  const entry high = words[ANHYST_WORD_SCALE_GAP_HIGH];
  return is_single_float(words, ANHYST_WORD_SCALE_DEMAND) &&
         is_single_float(words, ANHYST_WORD_SCALE_CURRENT) && low >= -MAX_ENTRY &&
         high <= MAX_ENTRY && (low == high || high - low >= (entry)8.67361738e-19);
}

/* Converts a number of the hysteresis state to the unit of another block. The argument `word` is
   the index of the unit in both blocks. Requires valid blocks. Returns a itself for equal units. */
static inline number convert_unit(number a, const entry *old_words, const entry *new_words,
                                  int32_t word)
{
  return old_words[word] == new_words[word] ? a : a * (old_words[word] / new_words[word]);
}

#include "block_checks.h"
#endif
