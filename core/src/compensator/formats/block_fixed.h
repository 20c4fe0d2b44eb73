/* SPDX-License-Identifier: Apache-2.0 */
/* Words of a fixed-point block, for ../generic/block_checks.h. */
#ifndef ANHYST_BLOCK_FIXED_H
#define ANHYST_BLOCK_FIXED_H

#include "../lookup.h"
#include "fixed.h"

#define ENTRY_ONE ((entry)32767) /* the largest q15 */
#define ENTRY_LEAST ((entry)1)   /* the smallest weight above 0 */
#define ENTRY_MOST ((entry)32767)
#define FLUX_LIMIT_MOST ((entry)16384) /* 1.0 as a q14 */
#define MAX_CURRENT_SHIFT 8
#define MAX_FLUX_SHIFT 6
#define MAX_BLOCK_WORDS ANHYST_BLOCK_MOST_WORDS
#define WORD_HALVES 1 /* pieces of 16 bits in a word */

/* Bits of a word, 16 at a time from the lowest on. */
static inline uint16_t bits_of(entry word, uint16_t half)
{
  (void)half;
  return (uint16_t)word;
}

/* Whether a word is an integer of low..high. */
static inline int is_integer(entry word, int32_t low, int32_t high)
{
  return word >= low && word <= high;
}

/* Whether a word is exactly this unsigned integer. */
static inline int is_unsigned(entry word, uint16_t value) { return (uint16_t)word == value; }

/* Whether an entry of a table is a number that one of a block can be, given the one before. */
static inline int is_entry_after(entry word, entry before)
{
  const int32_t change = (int32_t)word - before;
  return change <= ENTRY_MOST && change >= -ENTRY_MOST;
}

/* The 32 bits of a number of two words. */
static inline uint32_t double_word(const entry *words, int16_t word)
{
  return (uint32_t)(uint16_t)words[word] | ((uint32_t)(uint16_t)words[word + 1] << 16);
}

/* Singles above 0 stand in the order of their bits: exponent, then fraction. */
#define SINGLE_LEAST ((uint32_t)(127 - 60) << 23) /* 2^-60 */
#define SINGLE_MOST ((uint32_t)(127 + 60) << 23)  /* 2^60 */
#define SINGLE_ONE ((uint32_t)1 << 23)            /* the lowest digit of the exponent */

/* Whether the word begins a single within 2^-60..2^60. */
static inline int is_single(const entry *words, int16_t word)
{
  const uint32_t bits = double_word(words, word);
  return bits >= SINGLE_LEAST && bits <= SINGLE_MOST;
}

/* Whether the scales of the signals can be computed with: nothing is, in fixed point. */
static inline int are_scales(const entry *words)
{
  (void)words;
  return 1;
}

/* The digits of a single, 2^23..2^24 - 1. */
static inline int32_t digits_of(uint32_t single)
{
  return (int32_t)((single & (SINGLE_ONE - 1U)) | SINGLE_ONE);
}

/* A number of the memory, counted in the unit at this word of the block before, in the unit of
   another block. Both blocks are valid. |a| <= 2^30, saturates. The same unit gives the same
   number; otherwise the error is below 2^-22 of the result and 8 units in the last place of the
   larger of the two. */
static inline number in_unit(number a, const entry *before, const entry *words, int16_t word)
{
  const uint32_t from = double_word(before, word);
  const uint32_t to = double_word(words, word);
  const int32_t numerator = digits_of(from);
  const int32_t denominator = digits_of(to);
  int16_t shift = (int16_t)((int16_t)(from >> 23) - (int16_t)(to >> 23));
  int32_t part;
  if (from == to) {
    return a;
  }
  if (numerator < denominator) {
    part = anhyst_share(a, anhyst_ratio(numerator, denominator));
  } else {
    part = anhyst_share(a, anhyst_ratio(numerator, 2 * denominator));
    shift = (int16_t)(shift + 1);
  }
  if (shift >= 0) {
    return anhyst_shl_q31(part, (uint16_t)(shift < 31 ? shift : 31));
  }
  return part >> (shift > -31 ? -shift : 31);
}

#include "../generic/block_checks.h"
#endif
