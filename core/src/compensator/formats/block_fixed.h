/* SPDX-License-Identifier: Apache-2.0 */
/* Words of a fixed-point block, for ../generic/block_checks.h. */
#ifndef ANHYST_BLOCK_FIXED_H
#define ANHYST_BLOCK_FIXED_H

#include "../lookup.h"
#include "fixed.h"

#define ENTRY_ONE ((entry)32767) /* 1.0 as an entry: the largest q15 */
#define MIN_WEIGHT ((entry)1)    /* smallest positive weight */
#define MAX_ENTRY ((entry)32767)
#define MAX_FLUX_LIMIT ((entry)16384) /* 1.0 in q14 */
#define MAX_CURRENT_SHIFT 8
#define MAX_FLUX_SHIFT 6
#define MAX_BLOCK_WORDS ANHYST_BLOCK_MOST_WORDS
#define HALVES_PER_WORD 1 /* number of 16-bit halves in a word */

/* Returns one half of a word: the lowest 16 bits if the argument `half` is 0. */
static inline uint16_t half_word(entry word, uint16_t half)
{
  (void)half;
  return (uint16_t)word;
}

static inline int is_integer(entry word, int32_t low, int32_t high)
{
  return word >= low && word <= high;
}

static inline int equals_unsigned(entry word, uint16_t value) { return (uint16_t)word == value; }

/* Returns whether an entry of a table differs from the previous entry by at most MAX_ENTRY. */
static inline int is_entry_valid(entry word, entry previous)
{
  const int32_t change = (int32_t)word - previous;
  return change <= MAX_ENTRY && change >= -MAX_ENTRY;
}

static inline uint32_t read_double_word(const entry *words, int16_t word)
{
  return (uint32_t)(uint16_t)words[word] | ((uint32_t)(uint16_t)words[word + 1] << 16);
}

/* Positive single-precision numbers have the same order as their bits: exponent, then fraction. */
#define MIN_SINGLE_BITS ((uint32_t)(127 - 60) << 23) /* 2^-60 */
#define MAX_SINGLE_BITS ((uint32_t)(127 + 60) << 23) /* 2^60 */
#define SINGLE_EXPONENT_STEP ((uint32_t)1 << 23)     /* lowest bit of the exponent */

/* Returns whether a single-precision number in 2^-60..2^60 is stored at this word. */
static inline int is_single_float(const entry *words, int16_t word)
{
  const uint32_t bits = read_double_word(words, word);
  return bits >= MIN_SINGLE_BITS && bits <= MAX_SINGLE_BITS;
}

/* Returns 1, because fixed-point code never computes with the scales of the signals. */
static inline int are_scales_valid(const entry *words)
{
  (void)words;
  return 1;
}

/* Returns the significand of a single-precision number as an integer, 2^23..2^24 - 1. */
static inline int32_t significand_of(uint32_t single)
{
  return (int32_t)((single & (SINGLE_EXPONENT_STEP - 1U)) | SINGLE_EXPONENT_STEP);
}

/* Converts a number of the hysteresis state to the unit of another block. `word` is the index of
   the unit in both blocks. Requires valid blocks and |a| <= 2^30. Saturates. Returns a for equal
   units. Otherwise, the error is below 2^-22 of the result plus 8 LSB of the larger number. */
static inline number convert_unit(number a, const entry *old_words, const entry *new_words,
                                  int16_t word)
{
  const uint32_t from = read_double_word(old_words, word);
  const uint32_t to = read_double_word(new_words, word);
  const int32_t numerator = significand_of(from);
  const int32_t denominator = significand_of(to);
  int16_t shift = (int16_t)((int16_t)(from >> 23) - (int16_t)(to >> 23));
  int32_t scaled_number;
  if (from == to) {
    return a;
  }
  if (numerator < denominator) {
    scaled_number = anhyst_times_fraction(a, anhyst_ratio(numerator, denominator));
  } else {
    scaled_number = anhyst_times_fraction(a, anhyst_ratio(numerator, 2 * denominator));
    shift = (int16_t)(shift + 1);
  }
  if (shift >= 0) {
    return anhyst_shl_q31(scaled_number, (uint16_t)(shift < 31 ? shift : 31));
  }
  return scaled_number >> (shift > -31 ? -shift : 31);
}

#include "../generic/block_checks.h"
#endif
